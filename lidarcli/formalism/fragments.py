"""Parts of one thing that a step of its own surface tore apart: a leaf before a stem, the front and the side of a box."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.grouping import joined
from lidarcli.formalism.ragged import offsets_of
from lidarcli.formalism.runs import HIDDEN, OWN, Runs
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int64, UInt8

GAP = 0.16
"""[m] Things stand further apart than this; steps below it are within one."""
EXTENT = 0.9
"""[m] Greatest distance between the far ends of two parts."""


def next_run(runs: Runs) -> Int64:
    """(R,) the run that follows each one in its sweep, over the seam on a full turn; itself where there is none."""
    count = np.bincount(runs.row, minlength=len(runs.points.start) - 1)
    begin = offsets_of(count)
    following = np.arange(1, len(runs) + 1)
    at_end = following == begin[runs.row + 1]
    turns = runs.points.geometry.period[runs.row] > 0
    alone = at_end & ~turns
    following[at_end] = begin[runs.row[at_end]]
    following[alone] -= begin[runs.row[alone]] - np.flatnonzero(alone)
    return following


@compiled
def torn(runs: Runs, piece: Bool, reach: Float64) -> tuple[Int64, Int64]:
    """Pairs of neighbouring runs that a small step divides.

    Parameters
    ----------
    runs : R runs
    piece : (R,) runs that may be parts: no walls
    reach : (R,) their extent [m]

    Returns
    -------
    a, b : (P,) runs, b following a
    """
    x, y = runs.points.x, runs.points.y
    b = next_run(runs)
    a = np.arange(len(runs))
    stepped = (runs.end_edge == OWN) | (runs.end_edge == HIDDEN)
    may = np.flatnonzero(piece & piece[b] & stepped & (a != b) & (reach < EXTENT) & (reach[b] < EXTENT))
    a, b = may, b[may]
    gap = np.square(x[runs.last[a]] - x[runs.first[b]]) + np.square(y[runs.last[a]] - y[runs.first[b]])
    span = np.square(x[runs.first[a]] - x[runs.last[b]]) + np.square(y[runs.first[a]] - y[runs.last[b]])
    close = (gap < GAP * GAP) & (span < EXTENT * EXTENT)
    return a[close], b[close]


@record
class Bodies:
    """Runs with what tore them apart undone: (R,) each, equal for all runs of a body."""

    label: Int64
    """Least run of the body."""
    start_edge: UInt8
    end_edge: UInt8
    size: Int64
    """Number of points."""
    reach: Float64
    """Extent [m]."""
    parts: Int64
    """Number of runs."""


def bodies(runs: Runs, reach: Float64, a: Int64, b: Int64) -> Bodies:
    """Join R runs of extent `reach` [m] where b follows a within one body (P,)."""
    if not len(a):
        return Bodies(
            np.arange(len(runs)),
            runs.start_edge,
            runs.end_edge,
            runs.size,
            reach,
            np.ones(len(runs), np.int64),
        )
    label = joined(len(runs), a, b)
    first, last = np.arange(len(runs)), np.arange(len(runs))
    begins, ends = np.ones(len(runs), bool), np.ones(len(runs), bool)
    begins[b] = False
    ends[a] = False
    first[label[begins]] = np.flatnonzero(begins)
    last[label[ends]] = np.flatnonzero(ends)
    first, last = first[label], last[label]
    x, y = runs.points.x, runs.points.y
    across = np.hypot(x[runs.last[last]] - x[runs.first[first]], y[runs.last[last]] - y[runs.first[first]])
    widest = reach.copy()
    np.maximum.at(widest, label, reach)
    count = np.bincount(label, minlength=len(runs))[label]
    return Bodies(
        label=label,
        start_edge=runs.start_edge[first],
        end_edge=runs.end_edge[last],
        size=np.bincount(label, runs.size, minlength=len(runs)).astype(np.int64)[label],
        reach=np.where(count > 1, np.maximum(widest[label], across), reach),
        parts=count,
    )
