"""The objects as lists of runs: one run each, or the parts of a thing in the order of their bearings."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.ragged import offsets_of, span_first, span_max
from lidarcli.formalism.runs import Runs
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import TURN, Bool, Float64, Int64


@record
class Parts:
    """P runs that make up K objects, ordered by (row, walls last, theta_i)."""

    run: Int64
    """(P,)"""
    theta_i: Float64
    """(P,) bearing of the first point [rad], growing past the seam within an object."""
    theta_f: Float64
    """(P,) bearing of the last point [rad]."""
    past: Float64
    """(P,) how much of these is for being past the seam: a full turn or 0 [rad]."""
    offsets: Int64
    """(K + 1,) object k has the parts `offsets[k]:offsets[k + 1]`."""


def assemble(runs: Runs, is_object: Bool, is_wall: Bool, label: Int64 | None) -> Parts:
    """Order the chosen runs, and those of one label as the parts of one object.

    Parameters
    ----------
    runs : R runs
    is_object, is_wall : (R,) which of them are objects or walls
    label : (R,) objects of the same label are one; None: each is alone
    """
    return Parts(*assembled(runs, is_object, is_wall, np.arange(len(runs)) if label is None else label))


@compiled
def assembled(
    runs: Runs, is_object: Bool, is_wall: Bool, label: Int64
) -> tuple[Int64, Float64, Float64, Float64, Int64]:
    """Columns of `Parts`."""
    run = np.flatnonzero(is_object | is_wall)
    row = runs.row[run]
    theta_i, theta_f = runs.points.theta(runs.first[run], row), runs.points.theta(runs.last[run], row)
    if not len(run):
        return run, theta_i, theta_f, theta_i, np.zeros(1, np.int64)
    is_wall, tag = is_wall[run], np.where(is_object[run], label[run], run)
    turns = runs.points.geometry.period[row] > 0
    order: Int64 = np.lexsort((theta_i, tag, is_wall, row))
    differs = (np.diff(tag[order]) != 0) | np.diff(is_wall[order])
    ends = np.append(np.flatnonzero(differs), len(order) - 1)
    size = np.diff(ends, prepend=-1)
    owner = np.repeat(np.arange(len(size)), size)
    offsets = offsets_of(size)
    past = np.where(_past_the_seam(turns[order], theta_i[order], theta_f[order], owner, offsets), TURN, 0.0)
    theta_i, theta_f = theta_i[order] + past, theta_f[order] + past
    least = np.full(len(size), np.inf)
    np.minimum.at(least, owner, theta_i)
    again = np.lexsort((theta_i, owner, least[owner], is_wall[order], row[order]))
    sizes = size[owner[again][np.flatnonzero(np.diff(owner[again], prepend=-1))]]
    return run[order[again]], theta_i[again], theta_f[again], past[again], offsets_of(sizes)


def _past_the_seam(turns: Bool, theta_i: Float64, theta_f: Float64, owner: Int64, offsets: Int64) -> Bool:
    """Which parts (P,) of an object lie past the seam: those before its widest gap, where that is not the seam."""
    if len(offsets) == len(theta_i) + 1:
        return np.zeros(len(theta_i), bool)
    first, last = offsets[:-1], offsets[1:] - 1
    gap = np.empty(len(theta_i))
    gap[1:] = theta_i[1:] - theta_f[:-1]
    gap[first] = np.where(turns[first], theta_i[first] + TURN - theta_f[last], np.inf)
    widest = span_first(gap == span_max(gap, offsets)[owner], offsets)
    past: Bool = np.arange(len(theta_i)) < widest[owner]
    return past
