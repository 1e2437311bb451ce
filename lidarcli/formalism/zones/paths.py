"""Visits of zones and crossings of lines by agents, and agents that two sensors see."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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


def visits(shape: Circle | Polygon, path: Path) -> list[Visit]:
    """Return the visits of an area: from the first sweep inside to the last that is no farther than `MARGIN` outside."""
    with np.errstate(invalid="ignore"):
        within = inside(shape, path.x, path.y)
        # A place that is not known ends a visit.
        left = ~(distance_to(shape, path.x, path.y) <= MARGIN)
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
            if passed and passed == now:
                if begun and side == -now:
                    found.append(Crossing(after, now > 0))
                elif not begun:
                    one_sided += 1
            side, passed, begun = now, 0, True
    return found, one_sided + (passed != 0)


def same_agents(sensors: Sequence[dict[int, Path]]) -> dict[tuple[int, int], int]:
    """Number the agents that several sensors follow, each once.

    Parameters
    ----------
    sensors : of each sensor the paths of its agents by track, all in one frame

    Returns
    -------
    (sensor, track) → number of the agent, 0, 1, ...
    """
    number: dict[tuple[int, int], int] = {}
    members: dict[int, set[int]] = {}
    for sensor, paths in enumerate(sensors):
        for track, path in sorted(paths.items()):
            near = [
                (apart, number[other, its])
                for other in range(sensor)
                for its, apart in _together(path, sensors[other])
                if sensor not in members[number[other, its]]
                or _is_free(number, sensors, sensor, number[other, its], path)
            ]
            agent = min(near)[1] if near else len(members)
            number[sensor, track] = agent
            members.setdefault(agent, set()).add(sensor)
    return number


def _together(path: Path, others: dict[int, Path]) -> Iterator[tuple[int, float]]:
    """Yield the tracks that are where a path is, and how far apart they are on average [m]."""
    for track, other in others.items():
        times = path.time_ns
        common = (times >= other.time_ns[0]) & (times <= other.time_ns[-1])
        if not common.any():
            continue
        x = np.interp(times[common], other.time_ns, other.x)
        y = np.interp(times[common], other.time_ns, other.y)
        apart = np.hypot(path.x[common] - x, path.y[common] - y)
        close = apart <= TOGETHER
        if np.count_nonzero(close) >= max(SHARED * len(apart), 1):
            yield track, float(apart[close].mean())


def _is_free(
    number: dict[tuple[int, int], int],
    sensors: Sequence[dict[int, Path]],
    sensor: int,
    agent: int,
    path: Path,
) -> bool:
    """Return True where no other track of the sensor is this agent at the time of the path."""
    mine = [sensors[sensor][track] for (one, track), its in number.items() if one == sensor and its == agent]
    return all(each.time_ns[-1] < path.time_ns[0] or path.time_ns[-1] < each.time_ns[0] for each in mine)
