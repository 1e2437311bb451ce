"""The circle through the points of a round object: algebraic first guess, then least squares of the true distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.ragged import span_sum, spans
from lidarcli.kernels import compiled
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


def fit_circles(x: Float64, y: Float64, offsets: Int64, within: Float64 | None = None) -> Circles:
    """Circle through the points of each object, by the least squares of their distances from it.

    The algebraic circle (Kåsa 1976), which is too small for short noisy arcs, is the start of a Gauss-Newton descent.

    Parameters
    ----------
    x, y : (T,) points of K objects, joined [m]
    offsets : (K + 1,)
    within : (K,) objects whose algebraic circle fits worse than this [m] are not looked at further, and those where it is
        negative not at all: their rms is inf

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
    return Circles(
        *least_squares(x, y, offsets, np.full(len(offsets) - 1, np.inf) if within is None else within)
    )


@compiled
def least_squares(
    x: Float64, y: Float64, offsets: Int64, within: Float64
) -> tuple[Float64, Float64, Float64, Float64]:
    """Centre x, y, radius and rms of the circles of `fit_circles`, (K,) each; all 0 but the rms where none is sought."""
    sought = np.flatnonzero(within >= 0.0)
    columns = np.zeros((4, len(within)))
    columns[3] = np.inf
    index, _, part = spans(offsets[sought], np.diff(offsets)[sought])
    columns[:, sought] = _fit(x[index], y[index], part, within[sought])
    return columns[0], columns[1], columns[2], columns[3]


def _fit(
    x: Float64, y: Float64, offsets: Int64, within: Float64
) -> tuple[Float64, Float64, Float64, Float64]:
    """`least_squares` of objects of which all are sought."""
    size = np.diff(offsets)
    share = 1.0 / size
    middle_x, middle_y = span_sum(x, offsets) * share, span_sum(y, offsets) * share
    u, v = x - np.repeat(middle_x, size), y - np.repeat(middle_y, size)
    a, b, radius, known = _algebraic(u, v, offsets, share)
    rms = np.where(known, _rms(u, v, offsets, size, share, a, b, radius), np.inf)
    near = np.flatnonzero(rms <= within)
    index, _, part = spans(offsets[near], size[near])
    u, v, size, share = u[index], v[index], size[near], share[near]
    fit = a[near], b[near], radius[near], known[near]
    for _ in range(REFINEMENTS):
        fit = _refined(u, v, part, size, share, *fit)
    a[near], b[near], radius[near] = fit[:3]
    good = fit[3] & (fit[2] < LARGEST)
    rms = np.full(len(a), np.inf)
    rms[near] = np.where(good, _rms(u, v, part, size, share, *fit[:3]), np.inf)
    return a + middle_x, b + middle_y, radius, rms


def _rms(
    u: Float64,
    v: Float64,
    offsets: Int64,
    size: Int64,
    share: Float64,
    a: Float64,
    b: Float64,
    radius: Float64,
) -> Float64:
    """Root mean square distance of the points of each object from a circle [m]."""
    distance = _distance(u, v, size, a, b)
    distance -= np.repeat(radius, size)
    distance *= distance
    rms: Float64 = np.sqrt(span_sum(distance, offsets) * share)
    return rms


def _distance(u: Float64, v: Float64, size: Int64, a: Float64, b: Float64) -> Float64:
    """Distance of points from the centre of their object's circle [m]."""
    dx, dy = u - np.repeat(a, size), v - np.repeat(b, size)
    dx *= dx
    dy *= dy
    dx += dy
    distance: Float64 = np.sqrt(dx, out=dx)
    return distance


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
    distance = np.sqrt(dx * dx + dy * dy)
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
    length = np.sqrt(step_x * step_x + step_y * step_y)
    limit = np.minimum(1.0, np.maximum(radius, 1e-9) / np.maximum(length, 1e-9))
    a, b = a + step_x * limit, b + step_y * limit
    return a, b, span_sum(_distance(u, v, size, a, b), offsets) * share, known
