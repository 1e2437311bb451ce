"""How many people, and how sure: which agents are one person, and the interval about a number of crossings."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from lidarcli.formalism.detection import AGENT, starts
from lidarcli.formalism.tracking.results import HIDDEN, Tracks, Trajectories

MIN_WAY, MAX_LENGTH = 2.0, 1.2
"""[m] Who was seen to go less, or is known to be longer, is not counted."""
APART, SHARE, SWEEPS = 0.5, 0.8, 5
"""The middles of two people are so far apart [m]: tracks that are closer in this share of the sweeps that see both, which
are so many or more, are one person."""
GAP, MISS = 0.5, 0.5
"""A track goes on with another one that begins so soon after its end, or before [s], if the velocities of both lead from
one to the other, on average to this [m]."""


class PersonFinder:
    """Finds which tracks of one tracker are one person, from their trajectories, piece by piece."""

    def __init__(self) -> None:
        self._first: dict[int, list[float]] = {}
        self._last: dict[int, list[float]] = {}
        """First and last sight of each track: stamp [ns], x, y [m], vx, vy [m/s]."""
        self._both: Counter[tuple[int, int]] = Counter()
        self._close: Counter[tuple[int, int]] = Counter()
        """Two tracks → sweeps that see both, and of these those in which they are close."""

    def add(self, rows: Trajectories) -> None:
        """Take the next rows; all that moves in a sweep comes at once."""
        seen = np.flatnonzero(rows.seen != HIDDEN)
        if not len(seen):
            return
        by_track = seen[np.lexsort((rows.stamp_ns[seen], rows.track[seen]))]
        begin = starts(rows.track[by_track])
        ends = by_track[np.array([begin, np.append(begin[1:], len(by_track)) - 1])]
        columns = np.array([each[ends] for each in (rows.stamp_ns, rows.x, rows.y, rows.vx, rows.vy)]).T.tolist()
        for number, (first, last) in zip(rows.track[ends[0]].tolist(), columns, strict=True):
            self._first[number] = min(first, self._first.get(number, first))
            self._last[number] = max(last, self._last.get(number, last))
        # There are many things that stand.
        seen = seen[(rows.vx[seen] != 0.0) | (rows.vy[seen] != 0.0)]
        order = seen[np.lexsort((rows.track[seen], rows.sensor[seen], rows.stamp_ns[seen]))]
        track, stamp, sensor, x, y = (each[order] for each in (rows.track, rows.stamp_ns, rows.sensor, rows.x, rows.y))
        for step in range(1, len(order)):
            # Each row of a sweep beside the next one, the one after that, and so on.
            same = np.flatnonzero((stamp[step:] == stamp[:-step]) & (sensor[step:] == sensor[:-step]))
            if not len(same):
                break
            near = same[np.hypot(x[same + step] - x[same], y[same + step] - y[same]) < APART]
            for counts, some in ((self._both, same), (self._close, near)):
                counts.update(zip(track[some].tolist(), track[some + step].tolist(), strict=True))

    def find(self, tracks: Tracks) -> Tracks:
        """Return tracks with the person that each is counted as: the number of its first track, 0 for none."""
        own = (tracks.set == AGENT) & ~(tracks.length > MAX_LENGTH)
        person = {one: one for one in tracks.track[own].tolist() if one in self._first}
        one_place = [pair for pair, both in self._both.items() if self._close[pair] >= SHARE * both >= SHARE * SWEEPS]
        goes_on: dict[int, int] = {}
        for _, one, other in sorted(self._following([*person])):
            if one not in goes_on and other not in goes_on.values():
                goes_on[one] = other
        for pair in [*one_place, *goes_on.items()]:
            if person.keys() >= {*pair}:
                first, second = sorted(person[one] for one in pair)
                person |= {one: first for one, known in person.items() if known == second}
        ways: Counter[int] = Counter()
        for one, way in zip(tracks.track.tolist(), tracks.distance.tolist(), strict=True):
            ways[person.get(one, 0)] += way
        numbers = [first if ways[first := person.get(one, 0)] >= MIN_WAY else 0 for one in tracks.track.tolist()]
        return replace(tracks, person=np.array(numbers, np.int64))

    def _following(self, agents: list[int]) -> list[tuple[float, int, int]]:
        """Return agents of which the second may begin where the first ends, with the distance that is left [m]."""
        found = []
        agents.sort(key=lambda one: self._first[one])
        begins = [self._first[one][0] for one in agents]
        for one in agents:
            then, x, y, *velocity = self._last[one]
            low, high = np.searchsorted(begins, [then - GAP * 1e9, then + GAP * 1e9]).tolist()
            for other in agents[low:high]:
                stamp, to_x, to_y, *its = self._first[other]
                off = [
                    math.hypot(to_x - x - vx * (stamp - then) * 1e-9, to_y - y - vy * (stamp - then) * 1e-9)
                    for vx, vy in (velocity, its)
                ]
                if stamp > self._first[one][0] and sum(off) <= 2.0 * MISS:
                    found.append((sum(off), one, other))
        return found


MISSED, DOUBLED = 0.01, 0.003
"""Share of the crossings that is missed, and of those counted that is none, for each agent that is seen at once."""
SIDE, DEVIATIONS, MANY = 0.05, 1.645, 100.0
"""Probability that the true number is beyond a bound, on each side; that bound of a normal distribution, which numbers have
whose mean is greater than the last one."""
LEAST_OBSERVED = 0.01
"""Where less of the time is observed, nobody knows how many."""


class Interval(NamedTuple):
    """Least and greatest number; `high` is None where nothing was observed."""

    low: int
    high: int | None


def interval(count: int, unsure: int, observed: float, agents: float) -> Interval:
    """Return in which interval the true number of crossings lies, of `count` that were seen.

    Each one is counted with the probability s = `observed` · (1 - MISSED · `agents`): until one more is counted, as many
    are missed as the negative binomial distribution tells. Each that is counted is none with the probability
    DOUBLED · `agents`. Those that were seen in part (`unsure`) may all be true. `observed` is a share of the time,
    `agents` a mean at once.
    """
    none = min(DOUBLED * agents, 0.5)
    odds = none / (1.0 - none)
    doubled = _upper((1.0 - none) ** count, lambda n: (count - n) / (n + 1) * odds, count * none, count * none)
    share = observed * (1.0 - min(MISSED * agents, 0.5))
    if share < LEAST_OBSERVED:
        return Interval(count - doubled, None)
    mean = (count + 1) * (1.0 - share) / share
    missed = _upper(share ** (count + 1), lambda n: (n + count + 1) / (n + 1) * (1.0 - share), mean, mean / share)
    return Interval(count - doubled, count + unsure + missed)


def in_all(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the row of the table of counts of all the time of some, one after the other: its number, and its interval."""
    spans = [row["end"] - row["start"] for row in rows]
    # Where many cross, there are many to miss.
    weights = [(row["count"] + 1) * (row["agents"] > 0.0) for row in rows]
    agents = sum(row["agents"] * weight for row, weight in zip(rows, weights, strict=True)) / max(sum(weights), 1)
    observed = sum(row["observed"] * span for row, span in zip(rows, spans, strict=True)) / max(sum(spans), 1)
    count, unsure = (sum(row[name] for row in rows) for name in ("count", "unsure"))
    known = {"unsure": unsure, "observed": observed, "agents": agents}
    found = {"count": count, **interval(count, **known)._asdict(), **known}
    return {**rows[0], "end": rows[-1]["end"], **found}


def _upper(none: float, ratio: Callable[[int], float], mean: float, variance: float) -> int:
    """Return the upper bound of a number, of the probability of 0 and the ratio of each probability to the one before."""
    if mean > MANY:
        return math.ceil(mean + DEVIATIONS * math.sqrt(variance))
    number, term, total = 0, none, none
    while total < 1.0 - SIDE:
        term *= ratio(number)
        number, total = number + 1, total + term
    return number
