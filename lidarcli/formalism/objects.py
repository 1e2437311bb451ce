"""Definition 5: which runs are objects."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.detection import BOTH_HIDDEN, CUT, END_HIDDEN, FULL, START_HIDDEN
from lidarcli.formalism.runs import EDGES, HIDDEN, OPEN, OWN, UNKNOWN, VIEW, Runs
from lidarcli.sweeps import Bool, UInt8

NO_NEIGHBOUR = (OPEN, UNKNOWN)
"""Beside the run is no range at all: nothing is seen behind it, and scanners also lose the beam that grazes an edge."""


def fully_visible(runs: Runs) -> Bool:
    """Profile `paper`: runs whose edges are both their own; beside a beam without a return the background is beyond range.

    (R,)
    """
    own_start = (runs.start_edge == OWN) | (runs.start_edge == OPEN)
    own_end = (runs.end_edge == OWN) | (runs.end_edge == OPEN)
    both: Bool = own_start & own_end
    return both


def partly_visible(runs: Runs, enclosed: Bool, slight: Bool) -> Bool:
    """Profile `robust`: runs that show enough of their outline to be more than a piece of the background.

    Between walls a run needs an edge of its own, an end in the open on both sides, or one such end if it is slight:
    what else is seen there is wall. Where no walls surround the sensor even a run that is hidden on both sides is
    some thing.

    Parameters
    ----------
    runs : R runs
    enclosed : (S,) sweeps surrounded by walls
    slight : (R,) runs too short to be the free end of a wall

    Returns
    -------
    (R,)
    """
    own = (runs.start_edge == OWN) | (runs.end_edge == OWN)
    open_start, open_end = _is_one_of(runs.start_edge, NO_NEIGHBOUR), _is_one_of(runs.end_edge, NO_NEIGHBOUR)
    free = np.where(slight, open_start | open_end, open_start & open_end)
    # A turn without any discontinuity surrounds the sensor: both its edges are hidden, by no step at all.
    surrounding = (runs.start_edge == HIDDEN) & (runs.end_edge == HIDDEN) & np.isnan(runs.s_start)
    visible: Bool = (own | free | ~enclosed[runs.row]) & ~surrounding
    return visible


def partly_hidden(runs: Runs) -> Bool:
    """Runs that may go on where an edge is hidden, beyond the view or unknown. (R,)"""
    seen = (OWN, OPEN)
    partial: Bool = ~(_is_one_of(runs.start_edge, seen) & _is_one_of(runs.end_edge, seen))
    return partial


def _is_one_of(edge: UInt8, kinds: tuple[int, int]) -> Bool:
    """Which edges are of one of two kinds."""
    result: Bool = (edge == kinds[0]) | (edge == kinds[1])
    return result


def _together() -> UInt8:
    """(5, 5) what every start edge (row) and end edge (column) say together."""
    codes = np.full((len(EDGES), len(EDGES)), FULL, np.uint8)
    codes[HIDDEN] = START_HIDDEN
    codes[:, HIDDEN] = END_HIDDEN
    codes[HIDDEN, HIDDEN] = BOTH_HIDDEN
    codes[VIEW] = CUT
    codes[:, VIEW] = CUT
    return codes


_TOGETHER = _together()


def visibility(start_edge: UInt8, end_edge: UInt8) -> UInt8:
    """(K,) codes into `VISIBILITIES`: what the two edges of an object say together."""
    hidden_start, hidden_end = start_edge == HIDDEN, end_edge == HIDDEN
    codes = np.full(len(start_edge), FULL, np.uint8)
    codes[hidden_start] = START_HIDDEN
    codes[hidden_end] = END_HIDDEN
    codes[hidden_start & hidden_end] = BOTH_HIDDEN
    codes[(start_edge == VIEW) | (end_edge == VIEW)] = CUT
    return codes
