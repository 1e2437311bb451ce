"""§3, Fig. 8: categories by the topology of the faces that join the vertices."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.detection import IRREGULAR, PRISMATIC, ROUND, UNKNOWN
from lidarcli.formalism.ragged import span_sum, spans
from lidarcli.sweeps import Bool, Float64, Int64, UInt8

ENOUGH_BEAMS = 5
"""Fewer beams cannot tell a corner from an arc."""


def circle_fit(x: Float64, y: Float64, offsets: Int64) -> tuple[Float64, Float64, Float64, Float64]:
    """Algebraic least squares circle through the points of each object (Kåsa 1976).

    Returns centre x, y, radius, rms of the distances from the circle [m], (K,) each; NaN where the points are collinear.
    """
    size = np.diff(offsets)
    share = 1.0 / size
    middle_x, middle_y = span_sum(x, offsets) * share, span_sum(y, offsets) * share
    u, v = x - np.repeat(middle_x, size), y - np.repeat(middle_y, size)
    u_squared, v_squared = u * u, v * v
    w = u_squared + v_squared
    uu, vv, uv = span_sum(u_squared, offsets), span_sum(v_squared, offsets), span_sum(u * v, offsets)
    uw, vw = 0.5 * span_sum(u * w, offsets), 0.5 * span_sum(v * w, offsets)
    determinant = uu * vv - uv * uv
    determinant[determinant <= 1e-12 * np.square(uu + vv)] = np.nan
    a, b = (uw * vv - vw * uv) / determinant, (vw * uu - uw * uv) / determinant
    radius = np.sqrt(a * a + b * b + (uu + vv) * share)
    u -= np.repeat(a, size)
    v -= np.repeat(b, size)
    u *= u
    v *= v
    u += v
    residual = np.sqrt(u) - np.repeat(radius, size)
    residual *= residual
    rms = np.sqrt(span_sum(residual, offsets) * share)
    return a + middle_x, b + middle_y, radius, rms


def classify(
    x: Float64,
    y: Float64,
    offsets: Int64,
    faces: Int64,
    worst_rms: Float64,
    width: Float64,
    sigma: Float64,
) -> UInt8:
    """Shape codes of K objects.

    Parameters
    ----------
    x, y, offsets : the points of the objects, joined [m]
    faces : (K,) number of faces
    worst_rms : (K,) largest rms of a straight fit [m]
    width : (K,) chord P_i–P_f [m]
    sigma : (K,) noise of the ranges [m]
    """
    beams = np.diff(offsets)
    straight = worst_rms <= np.maximum(2.0 * sigma, 0.01)
    codes = np.full(len(beams), IRREGULAR, np.uint8)
    codes[straight & (faces <= 3)] = PRISMATIC
    codes[beams < ENOUGH_BEAMS] = UNKNOWN
    curved = np.flatnonzero((beams >= ENOUGH_BEAMS) & (faces != 1))
    part, _, part_offsets = spans(offsets[curved], beams[curved])
    arc = _is_arc(x[part], y[part], part_offsets, width[curved], sigma[curved])
    codes[curved[arc]] = ROUND
    return codes


def _is_arc(x: Float64, y: Float64, offsets: Int64, width: Float64, sigma: Float64) -> Bool:
    """Whether the points of an object lie on the near side of a circle, and on enough of it to tell. (K,)"""
    centre_x, centre_y, radius, rms = circle_fit(x, y, offsets)
    first, last = offsets[:-1], offsets[1:] - 1
    chord_middle = np.hypot(0.5 * (x[first] + x[last]), 0.5 * (y[first] + y[last]))
    arc: Bool = (
        (np.hypot(centre_x, centre_y) > chord_middle - 0.5 * radius)
        & (rms <= np.maximum(1.5 * sigma, 0.01))
        & (radius < 1.0)
        & (width > 0.8 * radius)
        & (width < 2.2 * radius)
    )
    return arc
