"""Definition 6 as printed: the vertices of a segment, where f' = 0 and where f' jumps."""

from __future__ import annotations

from typing import Any

from lidarcli.formalism.segmentation import Points, Segments


def mark(points: Points, segments: Segments, inner: Any, extremum: Any) -> None:
    """Mark the inner vertices of all segments, and which of them are extrema of r rather than corners.

    Between beams f is monotone, so f' = 0 shows as a difference s that changes its sign or becomes 0: at local minima and
    maxima of r, and where a level stretch begins. f' jumps where two consecutive differences differ by more than d_th, the
    only threshold the paper has.

    Parameters
    ----------
    inner, extremum : of each point of the sweep
    """
    r = points.r
    for j in range(segments.count):
        for k in range(segments.first[j], segments.first[j] + segments.size[j]):
            inner[k] = extremum[k] = False
        for k in range(segments.first[j] + 1, segments.first[j] + segments.size[j] - 1):
            before, after = r[k] - r[k - 1], r[k + 1] - r[k]
            extremum[k] = before != 0 and before * after <= 0
            inner[k] = extremum[k] or abs(after - before) > points.d_th
