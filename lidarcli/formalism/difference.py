"""Definition 2: the signed difference function s(θ_n) = r(θ_n) - r(θ_{n-1})."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.points import Cloud, Points, collect
from lidarcli.sweeps import Float64, SweepBatch


def predecessor_gap(points: Points) -> tuple[Float64, Float64]:
    """s of each point towards its predecessor, and how many beams without a range lie between (Def. 2).

    Parameters
    ----------
    points : Points, M of them

    Returns
    -------
    s : (M,) r(θ_n) - r(previous point) [m]; NaN for the first point of a partial view and for a lone point of a turn
    missing : (M,) number of beams without a range between the two; inf where there is no predecessor
    """
    count = len(points)
    s = np.full(count, np.nan)
    missing = np.full(count, np.inf)
    if not count:
        return s, missing
    s[1:] = np.diff(points.range)
    missing[1:] = np.diff(points.position) - 1
    sizes = np.diff(points.start)
    first = points.start[:-1][sizes > 0]
    last = points.start[1:][sizes > 0] - 1
    period = points.geometry.period[sizes > 0]
    closes = (period > 0) & (last > first)
    s[first] = np.where(closes, points.range[first] - points.range[last], np.nan)
    missing[first] = np.where(closes, points.position[first] + period - points.position[last] - 1, np.inf)
    return s, missing


def difference(batch: SweepBatch) -> Float64:
    """The difference function s of every beam (Def. 2), in the log's own beam order.

    Parameters
    ----------
    batch : SweepBatch, S sweeps of up to B beams

    Returns
    -------
    (S, B) signed differences [m] towards the neighbour at the next smaller bearing. NaN where the beam or that neighbour
    has no range, and for the first beam of a partial view. On a full turn the predecessor of the first bearing is the
    last; a bearing that is measured twice counts once, its repetition is NaN.

    Examples
    --------
    >>> import numpy as np
    >>> from lidarcli.formalism import sweep
    >>> difference(sweep([2.0, 2.0, 1.0, 2.0], angle_min=0.0, angle_increment=np.pi / 2))
    array([[ 0.,  0., -1.,  1.]])
    """
    points = collect(batch)
    s, missing = predecessor_gap(points)
    s = np.where(missing == 0, s, np.nan)
    beams: Float64 = scatter(points, s, batch.width, np.nan)
    return beams


def scatter(points: Points | Cloud, values: NDArray[Any], width: int, fill: float) -> NDArray[Any]:
    """(S, width) array with `values` (M,) at the beams of `points`, `fill` elsewhere."""
    out = np.full((len(points.start) - 1, width), fill, dtype=values.dtype)
    out[points.row, points.geometry.beam(points.row, points.position)] = values
    return out
