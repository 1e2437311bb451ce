"""§3, Fig. 8: things of several parts. Legs that stand close together, and pieces of one thing behind a thin occluder."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.points import Cloud
from lidarcli.formalism.ragged import span_max, span_min, span_sum, spans
from lidarcli.formalism.runs import Runs
from lidarcli.sweeps import Float64, Int64

LEG_WIDTH = 0.2
"""[m] Legs are no wider than this; what is stands by itself."""


def close_pairs(runs: Runs, chosen: Int64, gap: float) -> tuple[Int64, Int64]:
    """Pairs of runs of one sweep that come closer together than `gap`.

    Parameters
    ----------
    runs : R runs
    chosen : (K,) runs to look at, in increasing order
    gap : greatest distance between the nearest points of the two [m]

    Returns
    -------
    a, b : (P,) runs, a < b
    """
    if len(chosen) < 2:
        return chosen[:0], chosen[:0]
    cloud = runs.points
    index, owner, offsets = spans(runs.first[chosen], runs.size[chosen])
    x, y = cloud.x[index], cloud.y[index]
    size = np.diff(offsets)
    middle_x, middle_y = span_sum(x, offsets) / size, span_sum(y, offsets) / size
    radius = np.sqrt(span_max(np.square(x - middle_x[owner]) + np.square(y - middle_y[owner]), offsets))
    a, b = _pairs_within_rows(runs.row[chosen])
    apart = np.hypot(middle_x[a] - middle_x[b], middle_y[a] - middle_y[b]) - radius[a] - radius[b]
    near = apart <= gap
    a, b = a[near], b[near]
    close = _least_distance(cloud, runs.first[chosen[a]], size[a], runs.first[chosen[b]], size[b]) <= gap
    return chosen[a[close]], chosen[b[close]]


def _pairs_within_rows(row: Int64) -> tuple[Int64, Int64]:
    """All pairs a < b with the same row; `row` (K,) is sorted."""
    until = np.searchsorted(row, row, side="right")
    b, a, _ = spans(np.arange(len(row)) + 1, until - np.arange(len(row)) - 1)
    return a, b


def _least_distance(cloud: Cloud, first_a: Int64, size_a: Int64, first_b: Int64, size_b: Int64) -> Float64:
    """(P,) distance between the nearest points of two stretches of points each [m]."""
    point, pair, _ = spans(first_a, size_a)
    other, owner, offsets = spans(first_b[pair], size_b[pair])
    squared = np.square(cloud.x[other] - cloud.x[point][owner]) + np.square(
        cloud.y[other] - cloud.y[point][owner]
    )
    nearest = span_min(squared, offsets)
    _, _, pair_offsets = spans(first_a, size_a)
    distance: Float64 = np.sqrt(span_min(nearest, pair_offsets))
    return distance


def joined(count: int, a: Int64, b: Int64) -> Int64:
    """Connected components: the least run that each run is linked to, directly or through others.

    Parameters
    ----------
    count : number of runs R
    a, b : (P,) linked runs

    Returns
    -------
    (R,) label of each run; its own index where it is linked to none before it

    >>> joined(5, np.array([1, 3]), np.array([3, 4])).tolist()
    [0, 1, 2, 1, 1]
    """
    label = np.arange(count)
    while True:
        least = np.minimum(label[a], label[b])
        if (label[a] == least).all() and (label[b] == least).all():
            return label
        np.minimum.at(label, label[a], least)
        np.minimum.at(label, label[b], least)
        np.minimum.at(label, a, least)
        np.minimum.at(label, b, least)
        label = label[label]
