"""The circle through the points of a round object: algebraic first guess, then least squares of the true distances."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.ragged import spans
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int64

REFINEMENTS = 4
"""Gauss-Newton steps; the algebraic guess is near enough that more change nothing that matters."""
LARGEST = 2.0
"""[m] A circle larger than this is taken for a straight line: its centre is not determined."""


@record
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
    owner, share = np.repeat(np.arange(len(size)), size), 1.0 / size
    middle_x, middle_y = _sum(x, owner, share) * share, _sum(y, owner, share) * share
    u, v = x - middle_x[owner], y - middle_y[owner]
    a, b, radius, known = _algebraic(u, v, owner, share)
    rms = np.where(known, _rms(u, v, owner, share, a, b, radius), np.inf)
    near = np.flatnonzero(rms <= within)
    index, owner, _ = spans(offsets[near], size[near])
    u, v, share = u[index], v[index], share[near]
    fit = a[near], b[near], radius[near], known[near]
    for _ in range(REFINEMENTS):
        fit = _refined(u, v, owner, share, *fit)
    a[near], b[near], radius[near] = fit[:3]
    good = fit[3] & (fit[2] < LARGEST)
    rms = np.full(len(a), np.inf)
    rms[near] = np.where(good, _rms(u, v, owner, share, *fit[:3]), np.inf)
    return a + middle_x, b + middle_y, radius, rms


def _sum(values: Float64, owner: Int64, share: Float64) -> Float64:
    """Sum of the values of the points of each object, of which there are as many as of `share`."""
    return np.bincount(owner, values, len(share)).astype(np.float64, copy=False)


def _rms(
    u: Float64, v: Float64, owner: Int64, share: Float64, a: Float64, b: Float64, radius: Float64
) -> Float64:
    """Root mean square distance of the points of each object from a circle [m]."""
    distance = _distance(u, v, owner, a, b)
    distance -= radius[owner]
    distance *= distance
    rms: Float64 = np.sqrt(_sum(distance, owner, share) * share)
    return rms


def _distance(u: Float64, v: Float64, owner: Int64, a: Float64, b: Float64) -> Float64:
    """Distance of points from the centre of their object's circle [m]."""
    dx, dy = u - a[owner], v - b[owner]
    dx *= dx
    dy *= dy
    dx += dy
    distance: Float64 = np.sqrt(dx, out=dx)
    return distance


def _algebraic(
    u: Float64, v: Float64, owner: Int64, share: Float64
) -> tuple[Float64, Float64, Float64, Bool]:
    """Centre a, b and radius of the algebraic circle of centred points, and whether there is one."""
    uu, vv, uv = _sum(u * u, owner, share), _sum(v * v, owner, share), _sum(u * v, owner, share)
    w = u * u + v * v
    uw, vw = 0.5 * _sum(u * w, owner, share), 0.5 * _sum(v * w, owner, share)
    determinant = uu * vv - uv * uv
    known = determinant > 1e-9 * np.square(uu + vv)
    scale = 1.0 / np.where(known, determinant, 1.0)
    a, b = (uw * vv - vw * uv) * scale * known, (vw * uu - uw * uv) * scale * known
    return a, b, np.sqrt(a * a + b * b + (uu + vv) * share), known


def _refined(
    u: Float64,
    v: Float64,
    owner: Int64,
    share: Float64,
    a: Float64,
    b: Float64,
    radius: Float64,
    known: Bool,
) -> tuple[Float64, Float64, Float64, Bool]:
    """One Gauss-Newton step; the radius is eliminated, which leaves two equations for the centre."""
    dx, dy = u - a[owner], v - b[owner]
    distance = np.sqrt(dx * dx + dy * dy)
    inverse = 1.0 / np.maximum(distance, 1e-9)
    dx *= inverse
    dy *= inverse
    mean = _sum(distance, owner, share) * share
    mean_x, mean_y = _sum(dx, owner, share) * share, _sum(dy, owner, share) * share
    residual = distance - mean[owner]
    jx, jy = mean_x[owner] - dx, mean_y[owner] - dy
    xx, yy, xy = _sum(jx * jx, owner, share), _sum(jy * jy, owner, share), _sum(jx * jy, owner, share)
    rx, ry = _sum(jx * residual, owner, share), _sum(jy * residual, owner, share)
    determinant = xx * yy - xy * xy
    known = known & (determinant > 1e-12 * np.square(xx + yy))
    scale = known / np.where(known, determinant, 1.0)
    step_x, step_y = (ry * xy - rx * yy) * scale, (rx * xy - ry * xx) * scale
    # No step beyond the radius: a nearly straight arc would throw the centre to infinity.
    length = np.sqrt(step_x * step_x + step_y * step_y)
    limit = np.minimum(1.0, np.maximum(radius, 1e-9) / np.maximum(length, 1e-9))
    a, b = a + step_x * limit, b + step_y * limit
    return a, b, _sum(_distance(u, v, owner, a, b), owner, share) * share, known
