"""The circle through the points of a round object: algebraic first guess, then least squares of the true distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.ragged import span_sum
from lidarcli.sweeps import Float64, Int64

REFINEMENTS = 4
"""Gauss-Newton steps; the algebraic guess is near enough that more change nothing that matters."""
LARGEST = 2.0
"""[m] A circle larger than this is taken for a straight line: its centre is not determined."""


@dataclass(frozen=True, slots=True)
class Circles:
    """(K,) each, metres: centre, radius and root mean square distance from the circle; rms inf where there is none."""

    x: Float64
    y: Float64
    radius: Float64
    rms: Float64


def fit_circles(x: Float64, y: Float64, offsets: Int64) -> Circles:
    """Circle through the points of each object, by the least squares of their distances from it.

    The algebraic circle (Kåsa 1976), which is too small for short noisy arcs, is the start of a Gauss-Newton descent.

    Parameters
    ----------
    x, y : (T,) points of K objects, joined [m]
    offsets : (K + 1,)

    Returns
    -------
    Circles of K objects

    Examples
    --------
    >>> angle = np.linspace(2.0, 4.0, 9)
    >>> found = fit_circles(3 + 0.5 * np.cos(angle), 0.5 * np.sin(angle), np.array([0, 9]))
    >>> found.x.round(6).tolist(), found.radius.round(6).tolist()
    ([3.0], [0.5])
    """
    size = np.diff(offsets)
    share = 1.0 / size
    middle_x, middle_y = span_sum(x, offsets) * share, span_sum(y, offsets) * share
    u, v = x - np.repeat(middle_x, size), y - np.repeat(middle_y, size)
    a, b, radius, known = _algebraic(u, v, offsets, share)
    for _ in range(REFINEMENTS):
        a, b, radius, known = _refined(u, v, offsets, size, share, a, b, radius, known)
    distance = np.hypot(u - np.repeat(a, size), v - np.repeat(b, size)) - np.repeat(radius, size)
    rms = np.sqrt(span_sum(distance * distance, offsets) * share)
    known &= radius < LARGEST
    return Circles(a + middle_x, b + middle_y, radius, np.where(known, rms, np.inf))


def _algebraic(
    u: Float64, v: Float64, offsets: Int64, share: Float64
) -> tuple[Float64, Float64, Float64, np.ndarray]:
    """Centre a, b and radius of the algebraic circle of centred points, and whether there is one."""
    uu, vv, uv = span_sum(u * u, offsets), span_sum(v * v, offsets), span_sum(u * v, offsets)
    w = u * u + v * v
    uw, vw = 0.5 * span_sum(u * w, offsets), 0.5 * span_sum(v * w, offsets)
    determinant = uu * vv - uv * uv
    known = determinant > 1e-9 * np.square(uu + vv)
    scale = 1.0 / np.where(known, determinant, 1.0)
    a, b = (uw * vv - vw * uv) * scale * known, (vw * uu - uw * uv) * scale * known
    return a, b, np.sqrt(a * a + b * b + (uu + vv) * share), known


def _refined(
    u: Float64,
    v: Float64,
    offsets: Int64,
    size: Int64,
    share: Float64,
    a: Float64,
    b: Float64,
    radius: Float64,
    known: np.ndarray,
) -> tuple[Float64, Float64, Float64, np.ndarray]:
    """One Gauss-Newton step; the radius is eliminated, which leaves two equations for the centre."""
    dx, dy = u - np.repeat(a, size), v - np.repeat(b, size)
    distance = np.hypot(dx, dy)
    inverse = 1.0 / np.maximum(distance, 1e-9)
    dx *= inverse
    dy *= inverse
    mean = span_sum(distance, offsets) * share
    mean_x, mean_y = span_sum(dx, offsets) * share, span_sum(dy, offsets) * share
    residual = distance - np.repeat(mean, size)
    jx, jy = np.repeat(mean_x, size) - dx, np.repeat(mean_y, size) - dy
    xx, yy, xy = span_sum(jx * jx, offsets), span_sum(jy * jy, offsets), span_sum(jx * jy, offsets)
    rx, ry = span_sum(jx * residual, offsets), span_sum(jy * residual, offsets)
    determinant = xx * yy - xy * xy
    known = known & (determinant > 1e-12 * np.square(xx + yy))
    scale = known / np.where(known, determinant, 1.0)
    step_x, step_y = (ry * xy - rx * yy) * scale, (rx * xy - ry * xx) * scale
    # No step beyond the radius: a nearly straight arc would throw the centre to infinity.
    length = np.hypot(step_x, step_y)
    limit = np.minimum(1.0, np.maximum(radius, 1e-9) / np.maximum(length, 1e-9))
    a, b = a + step_x * limit, b + step_y * limit
    distance = np.hypot(u - np.repeat(a, size), v - np.repeat(b, size))
    return a, b, span_sum(distance, offsets) * share, known
