"""The objects as lists of runs: one run each, or the parts of a thing in the order of their bearings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.ragged import offsets_of, span_first, span_max
from lidarcli.formalism.runs import Runs
from lidarcli.sweeps import TURN, Bool, Float64, Int64


@dataclass(frozen=True, slots=True)
class Parts:
    """P runs that make up K objects, ordered by (row, walls last, theta_i)."""

    run: Int64
    """(P,)"""
    theta_i: Float64
    """(P,) bearing of the first point [rad], growing past the seam within an object."""
    theta_f: Float64
    """(P,) bearing of the last point [rad]."""
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
    run = np.flatnonzero(is_object | is_wall)
    row = runs.row[run]
    theta_i, theta_f = runs.points.theta(runs.first[run], row), runs.points.theta(runs.last[run], row)
    if label is None and not is_wall.any():
        return Parts(run, theta_i, theta_f, np.arange(len(run) + 1))
    tag = run if label is None else np.where(is_object[run], label[run], run)
    order = np.lexsort((theta_i, tag, is_wall[run], row))
    run, row, tag, theta_i, theta_f = run[order], row[order], tag[order], theta_i[order], theta_f[order]
    begins = np.ones(len(run), bool)
    begins[1:] = tag[1:] != tag[:-1]
    offsets = np.append(np.flatnonzero(begins), len(run))
    size = np.diff(offsets)
    owner = np.repeat(np.arange(len(size)), size)
    beyond = _past_the_seam(runs.points.geometry.period[row] > 0, theta_i, theta_f, owner, offsets)
    theta_i, theta_f = theta_i + TURN * beyond, theta_f + TURN * beyond
    least = np.full(len(size), np.inf)
    np.minimum.at(least, owner, theta_i)
    order = np.lexsort((theta_i, owner, least[owner], is_wall[run], row))
    sizes = size[owner[order][np.flatnonzero(np.diff(owner[order], prepend=-1))]]
    return Parts(run[order], theta_i[order], theta_f[order], offsets_of(sizes))


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
