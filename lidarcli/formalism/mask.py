"""§3: beams that are known to differ from the background, as bounds of runs."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.difference import Steps
from lidarcli.formalism.points import MARGIN, Points
from lidarcli.formalism.runs import Runs
from lidarcli.sweeps import Bool, Float64


def lay_out(points: Points, within: Bool) -> Bool:
    """The cells of the beams of a mask.

    Parameters
    ----------
    points : M points of S sweeps
    within : (S, B) beams, in the order of the log

    Returns
    -------
    (S * stride,) True in their cells, where these hold a point
    """
    width = within.shape[1]
    table = np.zeros((len(within), points.stride), bool)
    table[:, MARGIN : MARGIN + width] = within
    rows = np.flatnonzero(points.geometry.reverse)
    if len(rows):
        beam = points.geometry.bearings[rows, None] - 1 - np.arange(width)
        table[rows, MARGIN : MARGIN + width] = within[rows[:, None], np.maximum(beam, 0)]
    cells: Bool = table.reshape(-1) & points.valid
    return cells


def bordered(points: Points, steepness: Float64, inside: Bool) -> Float64:
    """|s| of every cell with ∞ where the mask begins or ends, so that every border is a step to look at."""
    border = np.zeros(len(inside), bool)
    np.not_equal(inside[1:], inside[:-1], out=border[1:])
    border &= points.valid
    return np.where(border, np.inf, steepness)


def crossing(steps: Steps, inside: Bool) -> Bool:
    """(E,) whether the mask begins or ends between a point and its predecessor."""
    result: Bool = inside[steps.cell] != inside[steps.before]
    return result


def of_runs(runs: Runs, inside: Bool) -> Bool:
    """(R,) the runs that lie within the mask: no run crosses its border."""
    result: Bool = inside[runs.points.cell[runs.first]]
    return result
