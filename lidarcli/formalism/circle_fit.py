"""The circle through the points of a round object: an algebraic first guess, then least squares of the true distances."""

from __future__ import annotations

import math
from typing import Any

from lidarcli.system import native

REFINEMENTS = 4
"""Gauss-Newton steps; the algebraic guess is near enough that more change nothing that matters."""
LARGEST = 2.0
"""[m] A circle larger than this is taken for a straight line: its centre is not determined."""
INFINITY = float("inf")


class Circle:
    """A circle and the `n` points it is fitted to, joined from the parts of an object."""

    def __init__(self, most: int) -> None:
        """Make room for so many points."""
        self.owner: list[Any] = []
        self.n = 0
        self.x = native.doubles(self.owner, most)
        """Points, forward [m]."""
        self.y = native.doubles(self.owner, most)
        self.centre_x = 0.0
        """[m]"""
        self.centre_y = 0.0
        self.radius = 0.0
        self.rms = INFINITY
        """Root mean square distance of the points from the circle [m]; inf where there is none."""
        # The points from their middle, from the centre, and how far they are from that.
        self.middle_x = 0.0
        self.middle_y = 0.0
        self.known = False
        self.u = native.doubles(self.owner, most)
        self.v = native.doubles(self.owner, most)
        self.from_x = native.doubles(self.owner, most)
        self.from_y = native.doubles(self.owner, most)
        self.distance = native.doubles(self.owner, most)


def fit_circle(circle: Circle, within: float) -> None:
    """Fit the circle to the points, by the least squares of their distances from it.

    The algebraic circle (Kåsa 1976), which is too small for short noisy arcs, is the start of a Gauss-Newton descent; one
    that fits worse than `within` [m] is not refined, and its rms is inf.
    """
    _algebraic(circle)
    rms = _rms(circle) if circle.known else INFINITY
    circle.rms = INFINITY
    if rms <= within:
        for _ in range(REFINEMENTS):
            _refine(circle)
        if circle.known and circle.radius < LARGEST:
            circle.rms = _rms(circle)
    circle.centre_x += circle.middle_x
    circle.centre_y += circle.middle_y


def _algebraic(circle: Circle) -> None:
    """The circle from linear equations, about the middle of the points."""
    n, u, v = circle.n, circle.u, circle.v
    sum_x, sum_y = 0.0, 0.0
    for k in range(n):
        sum_x += circle.x[k]
        sum_y += circle.y[k]
    middle_x, middle_y = sum_x / n, sum_y / n
    for k in range(n):
        u[k] = circle.x[k] - middle_x
        v[k] = circle.y[k] - middle_y
    circle.middle_x, circle.middle_y = middle_x, middle_y
    uu, vv, uv, uw, vw = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        w = u[k] * u[k] + v[k] * v[k]
        uu += u[k] * u[k]
        vv += v[k] * v[k]
        uv += u[k] * v[k]
        uw += u[k] * w
        vw += v[k] * w
    determinant = uu * vv - uv * uv
    circle.known = determinant > 1e-9 * ((uu + vv) * (uu + vv))
    circle.centre_x = circle.centre_y = 0.0
    if circle.known:
        circle.centre_x = 0.5 * (uw * vv - vw * uv) / determinant
        circle.centre_y = 0.5 * (vw * uu - uw * uv) / determinant
    a, b = circle.centre_x, circle.centre_y
    circle.radius = math.sqrt(a * a + b * b + (uu + vv) / n)
    _measure(circle)


def _measure(circle: Circle) -> None:
    """Compute the distances and directions of the points from the centre."""
    from_x, from_y, distance = circle.from_x, circle.from_y, circle.distance
    centre_x, centre_y = circle.centre_x, circle.centre_y
    for k in range(circle.n):
        dx, dy = circle.u[k] - centre_x, circle.v[k] - centre_y
        from_x[k], from_y[k] = dx, dy
        distance[k] = math.sqrt(dx * dx + dy * dy)


def _rms(circle: Circle) -> float:
    total = 0.0
    for k in range(circle.n):
        total += (circle.distance[k] - circle.radius) * (circle.distance[k] - circle.radius)
    return math.sqrt(total / circle.n)


def _refine(circle: Circle) -> None:
    """One Gauss-Newton step; the radius is eliminated, which leaves two equations for the centre."""
    n, distance, from_x, from_y = circle.n, circle.distance, circle.from_x, circle.from_y
    mean, mean_x, mean_y = 0.0, 0.0, 0.0
    for k in range(n):
        inverse = 1.0 / max(distance[k], 1e-9)
        from_x[k] *= inverse
        from_y[k] *= inverse
    for k in range(n):
        mean += distance[k]
        mean_x += from_x[k]
        mean_y += from_y[k]
    mean, mean_x, mean_y = mean / n, mean_x / n, mean_y / n
    xx, yy, xy, rx, ry = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        jx, jy, residual = mean_x - from_x[k], mean_y - from_y[k], distance[k] - mean
        xx += jx * jx
        yy += jy * jy
        xy += jx * jy
        rx += jx * residual
        ry += jy * residual
    determinant = xx * yy - xy * xy
    circle.known = circle.known and determinant > 1e-12 * ((xx + yy) * (xx + yy))
    if circle.known:
        step_x, step_y = (ry * xy - rx * yy) / determinant, (rx * xy - ry * xx) / determinant
        # No step beyond the radius: a nearly straight arc would throw the centre to infinity.
        length = math.sqrt(step_x * step_x + step_y * step_y)
        limit = min(1.0, max(circle.radius, 1e-9) / max(length, 1e-9))
        circle.centre_x += step_x * limit
        circle.centre_y += step_y * limit
    _measure(circle)
    total = 0.0
    for k in range(n):
        total += distance[k]
    circle.radius = total / n
