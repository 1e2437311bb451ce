"""Visits of zones and crossings of lines by agents, and agents that two sensors see."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lidarcli.formalism.zones.points import distance_to
from lidarcli.masks import Circle, Polygon
from lidarcli.sweeps import Float64, Int64
from lidarcli.zone import Line, inside

MARGIN = 0.1
"""A visit ends so far outside of the zone [m]."""
CLEAR = 0.2
"""An agent has crossed a line when it was so far away from it on both sides [m]."""
TOGETHER = 0.5
"""Two tracks of different sensors are one agent where they are no farther apart than this at one time [m]."""
SHARED = 0.5
"""Least share of the times that two such tracks have in common at which they are together."""


class Path(NamedTuple):
    """The smoothed path of one track, in the order of time."""

    time_ns: Int64
    """(N,) stamps of its sweeps."""
    x: Float64
    y: Float64
    """(N,) [m]; NaN where its place in the frame is not known."""


class Visit(NamedTuple):
    """One visit of an area, by index into the path."""

    first: int
    last: int
    cut: bool
    """True where the path begins or ends in the area."""


class Crossing(NamedTuple):
    """One crossing of a line: the index into the path after it, and its direction."""

    after: int
    inwards: bool


def visits(shapes: Sequence[Circle | Polygon], which: Int64, path: Path) -> list[Visit]:
    """Return the visits of an area: from the first sweep inside to the last that is no farther than `MARGIN` outside.

    Parameters
    ----------
    which : (N,) index of the shape that the area has at each sweep of the path, -1 for none
    """
    within, left = np.zeros(len(path.x), np.bool_), np.ones(len(path.x), np.bool_)
    for number in np.unique(which[which >= 0]).tolist():
        mine = np.flatnonzero(which == number)
        x, y = path.x[mine], path.y[mine]
        with np.errstate(invalid="ignore"):
            within[mine] = inside(shapes[number], x, y)
            # A place that is not known ends a visit.
            left[mine] = ~(distance_to(shapes[number], x, y) <= MARGIN)
    found = []
    at, count = 0, len(within)
    while at < count and within[at:].any():
        first = at + int(within[at:].argmax())
        gone = left[first:]
        last = first + int(gone.argmax()) - 1 if gone.any() else count - 1
        found.append(Visit(first, last, first == 0 or last == count - 1))
        at = last + 1
    return found


def crossings(line: Line, path: Path) -> tuple[list[Crossing], int]:
    """Return the crossings of a line, and how often the path went through it but was clear of it on one side alone.

    A crossing is a path through the line, between its ends, from `CLEAR` away on one side to as far on the other; it goes
    in where it arrives to the left of the way from the first end to the second.
    """
    (first_x, first_y), (second_x, second_y) = line.first, line.second
    length = np.hypot(second_x - first_x, second_y - first_y)
    ahead_x, ahead_y = (second_x - first_x) / length, (second_y - first_y) / length
    dx, dy = path.x - first_x, path.y - first_y
    left, along = ahead_x * dy - ahead_y * dx, ahead_x * dx + ahead_y * dy
    known = np.flatnonzero(np.isfinite(left))
    found: list[Crossing] = []
    one_sided = 0
    side, passed, after = 0, 0, -1
    begun = False
    """True once the path was clear of the line."""
    for before, here in zip([-1, *known[:-1].tolist()], known.tolist(), strict=True):
        if before >= 0 and (left[before] > 0.0) != (left[here] > 0.0):
            share = left[before] / (left[before] - left[here])
            if 0.0 <= along[before] + share * (along[here] - along[before]) <= length:
                passed += 1 if left[here] > 0.0 else -1
                after = here
        if abs(left[here]) >= CLEAR:
            now = 1 if left[here] > 0.0 else -1
            if passed * now > 0:
                if begun and side == -now:
                    found.append(Crossing(after, now > 0))
                elif not begun:
                    one_sided += 1
            side, passed, begun = now, 0, True
    return found, one_sided + (passed != 0)


def same_agents(sensors: Sequence[dict[int, Path]]) -> dict[tuple[int, int], int]:
    """Number the agents that several sensors follow, each once.

    Tracks of two sensors that are together are one agent, the nearest ones first, and so are all that are one with either;
    but no two tracks of one sensor that are there at one time.

    Parameters
    ----------
    sensors : of each sensor the paths of its agents by track, all in one frame

    Returns
    -------
    (sensor, track) → number of the agent, 0, 1, ...
    """
    paths = {(sensor, track): path for sensor, own in enumerate(sensors) for track, path in sorted(own.items())}
    members = {name: [name] for name in paths}
    together: list[tuple[float, tuple[int, int], tuple[int, int]]] = []
    there: list[tuple[int, int]] = []
    """Those that go on when the next one begins."""
    for name in sorted(paths, key=lambda each: int(paths[each].time_ns[0])):
        there = [each for each in there if _at_one_time(paths[each], paths[name])]
        for each in there:
            other, one = sorted((each, name))
            if other[0] < one[0] and (apart := _apart(paths[one], paths[other])) is not None:
                together.append((apart, one, other))
        there.append(name)
    for _, one, other in sorted(together):
        mine, its = members[one], members[other]
        if mine is not its and not any(a[0] == b[0] and _at_one_time(paths[a], paths[b]) for a in mine for b in its):
            mine += its
            members |= dict.fromkeys(its, mine)
    number: dict[int, int] = {}
    return {name: number.setdefault(id(members[name]), len(number)) for name in paths}


def _at_one_time(one: Path, other: Path) -> bool:
    return bool(one.time_ns[0] <= other.time_ns[-1] and other.time_ns[0] <= one.time_ns[-1])


def _apart(path: Path, other: Path) -> float | None:
    """Return how far apart two paths are on average while they are together [m]; None where they are not."""
    times = path.time_ns
    common = (times >= other.time_ns[0]) & (times <= other.time_ns[-1])
    x, y = (np.interp(times[common], other.time_ns, values) for values in (other.x, other.y))
    apart = np.hypot(path.x[common] - x, path.y[common] - y)
    close = apart <= TOGETHER
    return float(apart[close].mean()) if np.count_nonzero(close) >= max(SHARED * len(apart), 1) else None
