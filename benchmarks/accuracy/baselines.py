"""Published segmentations of a sweep, reimplemented from their formulas, to compare with.

Each walks the valid points of a sweep in order, closes the seam of a full turn, and begins a new segment where the
Euclidean distance to the previous point exceeds a threshold. A segment is a detection if it is big enough to be seen
and small enough to be no wall: the same filter for all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from sklearn.cluster import DBSCAN

from lidarcli.sweeps.types import Closure, Float64, Int64, Status, SweepBatch

MIN_POINTS = 3
MAX_WIDTH = 2.0
"""[m] of a detection, in any direction."""
_DIRECTIONS = 16
"""Widths are measured in so many directions: at most 0.5 % too small."""

FIXED = 0.3
"""[m]"""
PROPORTIONAL = (0.1, 0.00628)
"""Przybyła 2017: [m], and per metre of range."""
DIETMAYER_NOISE = 0.3
"""Dietmayer et al. 2001: the part that does not grow with range [m]."""
BORGES_ANGLE = np.deg2rad(10.0)
"""Borges & Aldon 2004: worst angle of incidence at which a surface stays whole."""
BORGES_NOISE = 0.03
"""σ of the ranges [m]."""
DBSCAN_REACH = 0.3
"""[m]"""
DBSCAN_POINTS = 3


@dataclass(frozen=True, slots=True)
class Points:
    """The M valid points of a batch, row by row in the order of the beams."""

    row: Int64
    beam: Int64
    range: Float64
    x: Float64
    y: Float64
    first: Int64
    """(S,) index of the first point of each row."""
    count: Int64
    """(S,)"""
    previous: Int64
    """(M,) the point before, across the seam of a full turn; -1: none."""
    step: Float64
    """(M,) angle from beam to beam [rad]."""


Threshold = Callable[[Float64, Float64, Float64], Float64]
"""Range, range of the previous point, angular step → greatest distance within one segment [m]."""


def valid_points(batch: SweepBatch) -> Points:
    """The points of a batch and their predecessors."""
    row, beam = np.nonzero(batch.status == Status.VALID)
    ranges = batch.ranges[row, beam].astype(np.float64)
    bearing = batch.angle_min[row] + batch.angle_increment[row] * beam
    count = np.bincount(row, minlength=len(batch))
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    previous = np.arange(len(row)) - 1
    some = count > 0
    closed = batch.closure != Closure.OPEN
    previous[first[some]] = np.where(closed & (count > 1), first + count - 1, -1)[some]
    step = np.abs(batch.angle_increment)[row]
    return Points(row, beam, ranges, ranges * np.cos(bearing), ranges * np.sin(bearing), first, count, previous, step)


def fixed(near: Float64, before: Float64, step: Float64) -> Float64:
    """The same distance everywhere."""
    return np.full(len(near), FIXED)


def proportional(near: Float64, before: Float64, step: Float64) -> Float64:
    """A distance that grows with range."""
    return PROPORTIONAL[0] + PROPORTIONAL[1] * near


def dietmayer(near: Float64, before: Float64, step: Float64) -> Float64:
    """The chord between two beams at the nearer range, and a constant."""
    chord: Float64 = np.sqrt(2.0 * (1.0 - np.cos(step))) * np.minimum(near, before)
    return DIETMAYER_NOISE + chord


def borges_aldon(near: Float64, before: Float64, step: Float64) -> Float64:
    """How far the next point of a surface seen at the worst angle can be."""
    reach: Float64 = before * np.sin(step) / np.sin(BORGES_ANGLE - step)
    return reach + 3.0 * BORGES_NOISE


def segments(points: Points, threshold: Threshold) -> Int64:
    """(M,) number of the segment of each point."""
    before = points.previous
    distance = np.hypot(points.x - points.x[before], points.y - points.y[before])
    jump = distance > threshold(points.range, points.range[before], points.step)
    jump |= before < 0
    starts = jump.copy()
    filled = points.first[points.count > 0]
    starts[filled] = True
    number = np.cumsum(starts)
    # A row whose first point goes on from its last: its first segment is the end of its last one.
    joined = filled[~jump[filled]]
    rename = np.arange(len(points.row) + 1)
    rename[number[joined]] = number[before[joined]]
    return rename[number]


def dbscan(points: Points) -> Int64:
    """(M,) number of the cluster of each point, row by row; 0 for noise."""
    number = np.zeros(len(points.row), np.int64)
    used = 0
    for first, count in zip(points.first, points.count, strict=True):
        if count:
            part = slice(first, first + count)
            xy = np.column_stack([points.x[part], points.y[part]])
            label = DBSCAN(eps=DBSCAN_REACH, min_samples=DBSCAN_POINTS).fit_predict(xy)
            number[part] = np.where(label >= 0, label + 1 + used, 0)
            used += int(label.max()) + 1
    return number


def detections(batch: SweepBatch, points: Points, number: Int64) -> Int64:
    """(S, B) number of the detection that a beam belongs to, 0 for none: segments of the right size."""
    labels = np.zeros(batch.ranges.shape, np.int64)
    if not len(number):
        return labels
    order = np.argsort(number, kind="stable")
    names, starts, inverse = np.unique(number[order], return_index=True, return_inverse=True)
    x, y = points.x[order], points.y[order]
    width = np.zeros(len(names))
    for angle in np.arange(_DIRECTIONS) * (np.pi / _DIRECTIONS):
        along = x * np.cos(angle) + y * np.sin(angle)
        extent = np.maximum.reduceat(along, starts) - np.minimum.reduceat(along, starts)
        width = np.maximum(width, extent)
    kept = (names > 0) & (np.bincount(inverse) >= MIN_POINTS) & (width <= MAX_WIDTH)
    labels[points.row[order], points.beam[order]] = np.where(kept, names, 0)[inverse]
    return labels


def by_distance(threshold: Threshold) -> Callable[[SweepBatch], Int64]:
    """A method from its threshold."""

    def method(batch: SweepBatch) -> Int64:
        points = valid_points(batch)
        return detections(batch, points, segments(points, threshold))

    return method


def by_density(batch: SweepBatch) -> Int64:
    """DBSCAN of every sweep."""
    points = valid_points(batch)
    return detections(batch, points, dbscan(points))


BASELINES: dict[str, Callable[[SweepBatch], Int64]] = {
    "fixed 0.3 m": by_distance(fixed),
    "0.1 m + 0.00628 r": by_distance(proportional),
    "Dietmayer": by_distance(dietmayer),
    "Borges & Aldon": by_distance(borges_aldon),
    "DBSCAN(0.3, 3)": by_density,
}
