"""Episodes of a zone: from the sweep in which it is occupied long enough to the last one before it is free."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidarcli.sweeps import Bool, Int64


class Episode(NamedTuple):
    """One time in which a zone is occupied, by index of its sweeps."""

    first: int
    """The sweep that completes the trigger."""
    last: int
    """The last one with enough points."""
    cut: bool
    """True where it goes on at an end of the log."""


def episodes(
    enough: Bool, time_ns: Int64, *, trigger: int, release: int, hold_ns: int, longest_gap_ns: int
) -> list[Episode]:
    """Return the episodes of sweeps (S,) in the order of time.

    An episode begins with the sweep that is the `trigger`-th in a row with enough points. It ends as soon as `release`
    sweeps in a row have fewer and `hold_ns` have passed since the last one with enough. Nobody knows what was in a gap
    between two sweeps that is longer than `longest_gap_ns`: an episode ends before it, and all counts begin anew.
    """
    found: list[Episode] = []
    if not len(enough):
        return found
    breaks = np.diff(time_ns) > longest_gap_ns
    edges = np.flatnonzero((np.diff(enough.astype(np.int8)) != 0) | breaks) + 1
    begins, ends = np.concatenate([[0], edges]), np.concatenate([edges, [len(enough)]])
    first = last = -1
    for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
        if begin and breaks[begin - 1] and first >= 0:
            found.append(Episode(first, last, first == trigger - 1))
            first = -1
        if enough[begin]:
            if first < 0 and end - begin >= trigger:
                first = begin + trigger - 1
            last = end - 1
        elif first >= 0 and (time_ns[begin:end] - time_ns[last] >= hold_ns)[release - 1 :].any():
            found.append(Episode(first, last, first == trigger - 1))
            first = -1
    if first >= 0:
        found.append(Episode(first, last, cut=True))
    return found
