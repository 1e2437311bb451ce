"""Beams that tell one range wherever the robot goes: no measurements."""

from __future__ import annotations

import numpy as np

from lidarcli.range_rules import same_range
from lidarcli.sweeps import Bool, Float32

LEAST_SWEEPS = 10
"""Fewer show nothing."""
STEADY = 0.95
"""Share of the sweeps in which such a beam has its range."""
BODY = 1.0
"""What is no farther [m] is a part of the robot."""
MOST_STUCK = 0.02
"""Share of all beams: more of them see something that goes along."""
MOST_ELSEWHERE = 0.001
"""Share of the other beams that have the same range: what more have is no matter of one beam."""
MOVED, LEAST_MOVED = 0.05, 0.2
"""A beam sees another place when its range changes by this share, and no less [m], leaving out a tenth at either end …"""
MOVING = 0.25
"""… and a robot that drives about changes this share of its beams."""
APART, MOSTLY = 0.1, 0.9
"""The beams beside it differ from it by this share of its range, in this share of the sweeps."""


def find_stuck(ranges: Float32) -> dict[int, float]:
    """The beams of (S, B) ranges, NaN where there is none, that tell the same all the time, and what [m]."""
    if len(ranges) < LEAST_SWEEPS:
        return {}
    usual = ranges[len(ranges) // 2]
    same = same_range(ranges, usual)
    stuck = (same.mean(axis=0) >= STEADY) & (usual > BODY)
    if not 0 < np.count_nonzero(stuck) <= max(1.0, MOST_STUCK * len(stuck)) or not _moves(ranges):
        return {}
    return {
        beam: float(str(usual[beam]))
        for beam in np.flatnonzero(stuck).tolist()
        if same_range(ranges[:, ~stuck], usual[beam]).mean() <= MOST_ELSEWHERE
        and all(_differs(ranges[:, other], float(usual[beam])) for other in _beside(stuck, beam))
    }


def _moves(ranges: Float32) -> bool:
    """Whether a robot drives about: many beams see other places, not for a moment alone."""
    known = np.count_nonzero(~np.isnan(ranges), axis=0)
    seen = np.flatnonzero(2 * known >= len(ranges))
    ordered, last = np.sort(ranges[:, seen], axis=0), known[seen] - 1
    beams = np.arange(len(seen))
    low, high = (ordered[(share * last).astype(np.int64), beams] for share in (0.1, 0.9))
    moved = high - low > np.maximum(LEAST_MOVED, MOVED * high)
    return len(seen) > 0 and bool(np.count_nonzero(moved) >= MOVING * len(seen))


def _beside(stuck: Bool, beam: int) -> list[int]:
    """The next beam on either side that is not stuck, too."""
    others = np.flatnonzero(~stuck)
    return [*others[others < beam][-1:].tolist(), *others[others > beam][:1].tolist()]


def _differs(ranges: Float32, value: float) -> bool:
    with np.errstate(invalid="ignore"):
        return float(np.mean(~(np.abs(ranges - value) <= APART * value))) >= MOSTLY
