"""§3, Fig. 8: categories by the topology of the faces that join the vertices."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.detection import IRREGULAR, PRISMATIC, ROUND, UNKNOWN
from lidarcli.formalism.points import Cloud
from lidarcli.formalism.ragged import span_sum
from lidarcli.sweeps import Float64, Int64, UInt8

ENOUGH_BEAMS = 5
"""Fewer beams cannot tell a corner from an arc."""


def circle_fit(
    x: Float64, y: Float64, owner: Int64, offsets: Int64
) -> tuple[Float64, Float64, Float64, Float64]:
    """Algebraic least squares circle through the points of each object (Kåsa 1976).

    Returns centre x, y, radius, rms of the distances from the circle [m], (K,) each; NaN where the points are collinear.
    """
    count = np.diff(offsets).astype(np.float64)
    middle_x, middle_y = span_sum(x, offsets) / count, span_sum(y, offsets) / count
    u, v = x - middle_x[owner], y - middle_y[owner]
    w = u * u + v * v
    uu, vv, uv = span_sum(u * u, offsets), span_sum(v * v, offsets), span_sum(u * v, offsets)
    uw, vw = 0.5 * span_sum(u * w, offsets), 0.5 * span_sum(v * w, offsets)
    determinant = uu * vv - uv * uv
    with np.errstate(divide="ignore", invalid="ignore"):
        a = np.where(determinant > 1e-12 * (uu + vv) ** 2, (uw * vv - vw * uv) / determinant, np.nan)
        b = np.where(determinant > 1e-12 * (uu + vv) ** 2, (vw * uu - uw * uv) / determinant, np.nan)
        radius = np.sqrt(a * a + b * b + (uu + vv) / count)
        residual = np.hypot(u - a[owner], v - b[owner]) - radius[owner]
        rms = np.sqrt(span_sum(residual * residual, offsets) / count)
    return a + middle_x, b + middle_y, radius, rms


def classify(
    points: Cloud,
    index: Int64,
    owner: Int64,
    offsets: Int64,
    faces: Int64,
    worst_rms: Float64,
    width: Float64,
    sigma: Float64,
) -> UInt8:
    """Shape codes of K objects.

    Parameters
    ----------
    points, index, owner, offsets : the points of the objects, joined
    faces : (K,) number of faces
    worst_rms : (K,) largest rms of a straight fit [m]
    width : (K,) chord P_i–P_f [m]
    sigma : (K,) noise of the ranges [m]
    """
    beams = np.diff(offsets)
    x, y = points.x[index], points.y[index]
    centre_x, centre_y, radius, rms = circle_fit(x, y, owner, offsets)
    first, last = offsets[:-1], offsets[1:] - 1
    chord_middle = np.hypot(0.5 * (x[first] + x[last]), 0.5 * (y[first] + y[last]))
    bulge = np.hypot(centre_x, centre_y) > chord_middle - 0.5 * radius
    straight = worst_rms <= np.maximum(2.0 * sigma, 0.01)
    with np.errstate(invalid="ignore"):
        arc = (
            bulge
            & (rms <= np.maximum(1.5 * sigma, 0.01))
            & (radius < 1.0)
            & (width > 0.8 * radius)
            & (width < 2.2 * radius)
        )
    codes = np.full(len(beams), IRREGULAR, np.uint8)
    codes[straight & (faces <= 3)] = PRISMATIC
    codes[arc & (faces != 1)] = ROUND
    codes[beams < ENOUGH_BEAMS] = UNKNOWN
    return codes
