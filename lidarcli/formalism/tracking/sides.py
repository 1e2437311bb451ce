"""What a view of a body says of its sides: scalar measurements along its axes, one-sided where an edge is hidden.

There is no reference point that could jump from corner to corner. A side that faces the sensor is where its face is; a side
that is seen to end is where its edge is; of any other side it is only known that it is not nearer than the last point seen.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism import detection
from lidarcli.formalism.tracking import bodies as things
from lidarcli.formalism.tracking import views as looks
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.views import Views

ROUND = detection.ROUND
LEGGED = detection.LEGGED
AT_LEAST = -1.0
"""In place of a variance: the side goes on at least so far."""
COS_ALONG = math.cos(math.radians(20.0))
"""A face belongs to the side whose normal is this close to its own."""
SIN_BEHIND = math.sin(math.radians(10.0))
"""A side that looks away from the sensor by more than this may go on behind the last point."""
AT_END = 0.03
"""[m] An end of the points that is this close to the outermost one is it."""
FLOOR = 1.6e-5
"""[m²] No surface is smoother and no scanner better: (4 mm)²."""
CROOKED = 0.25
"""Share of the mean squared distance of points from their face that its place is uncertain by."""
RAGGED = 0.12
"""Share of its size by which the middle of a thing without faces is uncertain."""
OPEN_VAR = 0.01
"""[m²] Variance of an edge that may be one of returns rather than of a thing: (10 cm)²."""
LEGGED_VAR = 0.0081
"""[m²] Variance of the middle of a group of legs: (9 cm)²."""


class Sides:
    """What one view says of one body: of sides 0 to 3 (axis 0 low and high, axis 1 low and high) or of its centre."""

    def __init__(self) -> None:
        self.owner: list[Any] = []
        self.z = native.doubles(self.owner, 4)
        """Where the side is along its axis [m]."""
        self.var = native.doubles(self.owner, 4)
        """Its variance [m²], or `AT_LEAST`."""
        self.by_centre = False
        """Whether z[0] and z[2] are the centre of a disc; then `half` is its radius with the variance `half_var`."""
        self.lasting_var = 0.0
        """Variance of the centre that more sightings do not mend, as they see the same raggedness [m²]."""
        self.is_doubtful = False
        """Whether the centre is that of returns which come and go."""
        self.half = 0.0
        self.half_var = 0.0


def measure(sides: Sides, views: Views, k: int, bodies: Bodies, b: int, pose_var: float) -> None:
    """What view k says of a body.

    Parameters
    ----------
    pose_var : variance that the pose of the sensor gives to a point there [m²]
    """
    if bodies.kind[b] == things.DISC:
        radius = 0.5 * (bodies.h[2 * b] + bodies.h[2 * b + 1])
        var = 0.5 * (bodies.hh[2 * b] + bodies.hh[2 * b + 1])
        of_disc(sides, views, k, radius, var, pose_var)
    else:
        of_box(sides, views, k, bodies.cos[b], bodies.sin[b], pose_var)


def of_box(sides: Sides, views: Views, k: int, cos: float, sin: float, pose_var: float) -> None:
    """The sides of a rectangle whose first axis has the direction cos, sin."""
    sides.by_centre = False
    looks.stand(views, views.share[k])
    first, last = views.begin[k], views.begin[k + 1] - 1
    for side in range(4):
        sides.var[side] = AT_LEAST
    for p in range(first, last + 1):
        along = cos * views.point_x[p] + sin * views.point_y[p]
        across = cos * views.point_y[p] - sin * views.point_x[p]
        if p == first:
            sides.z[0] = sides.z[1] = along
            sides.z[2] = sides.z[3] = across
        if along < sides.z[0]:
            sides.z[0] = along
        if along > sides.z[1]:
            sides.z[1] = along
        if across < sides.z[2]:
            sides.z[2] = across
        if across > sides.z[3]:
            sides.z[3] = across
    own_start = views.start[k] != looks.HIDDEN
    own_end = views.end[k] != looks.HIDDEN
    if own_start:
        _end_at(sides, views, k, first, -1.0, cos, sin, pose_var + _doubt(views.start[k]))
    if own_end:
        _end_at(sides, views, k, last, 1.0, cos, sin, pose_var + _doubt(views.end[k]))
    for f in range(views.face_begin[k], views.face_begin[k + 1]):
        _face_at(sides, views, f, cos, sin, pose_var)
    looks.stand(views, 0.0)


def _doubt(edge: int) -> float:
    """Further variance of an edge beside beams without a return, where such beams come and go [m²]."""
    return OPEN_VAR if edge == looks.OPEN else 0.0


def _face_at(sides: Sides, views: Views, f: int, cos: float, sin: float, pose_var: float) -> None:
    """A face is the near side of its axis."""
    x, y = views.face_x[f], views.face_y[f]
    normal_x, normal_y = views.along_y[f], -views.along_x[f]
    if normal_x * (views.x - x) + normal_y * (views.y - y) < 0.0:
        normal_x, normal_y = -normal_x, -normal_y
    along, across = cos * normal_x + sin * normal_y, cos * normal_y - sin * normal_x
    var = views.sigma * views.sigma / views.face_points[f] + FLOOR + pose_var
    # What is not straight is not where its line is.
    var += CROOKED * views.bulge[f] / views.face_points[f]
    if abs(along) > COS_ALONG:
        side = 1 if along > 0.0 else 0
        sides.z[side], sides.var[side] = cos * x + sin * y, var
    elif abs(across) > COS_ALONG:
        side = 3 if across > 0.0 else 2
        sides.z[side], sides.var[side] = cos * y - sin * x, var


def _end_at(
    sides: Sides, views: Views, k: int, p: int, way: float, cos: float, sin: float, pose_var: float
) -> None:
    """Where the thing itself ends, its sides end: half a beam past the last point, on average."""
    x, y = views.point_x[p], views.point_y[p]
    far_x, far_y = x - views.x, y - views.y
    r = math.sqrt(far_x * far_x + far_y * far_y)
    if r <= 0.0:
        return
    far_x, far_y = far_x / r, far_y / r
    # Outwards, as the bearings run.
    way *= views.side
    out_x, out_y = -way * far_y, way * far_x
    # The face that ends there, if one does.
    face = -1
    for f in range(views.face_begin[k], views.face_begin[k + 1]):
        if views.face_first[f] == p or views.face_last[f] == p:
            face = f
    for side in range(4):
        u_x, u_y = (cos, sin) if side < 2 else (-sin, cos)
        if side == 0 or side == 2:
            u_x, u_y = -u_x, -u_y
        sign = 1.0 if side == 1 or side == 3 else -1.0
        if u_x * x + u_y * y < sign * sides.z[side] - AT_END:
            continue
        if face >= 0 and abs(views.along_x[face] * u_x + views.along_y[face] * u_y) > COS_ALONG:
            gap = views.extent[face] / (views.face_points[face] - 1)
            sides.z[side] = sign * (u_x * x + u_y * y + 0.5 * gap)
            sides.var[side] = gap * gap / 12.0 + FLOOR + pose_var
        elif u_x * far_x + u_y * far_y <= SIN_BEHIND:
            gap = max(u_x * out_x + u_y * out_y, 0.0) * r * views.step
            depth = views.sigma * (u_x * far_x + u_y * far_y)
            sides.z[side] = sign * (u_x * x + u_y * y + 0.5 * gap)
            sides.var[side] = gap * gap / 12.0 + depth * depth + FLOOR + pose_var


def of_disc(sides: Sides, views: Views, k: int, radius: float, radius_var: float, pose_var: float) -> None:
    """The centre of a disc, in the axes of the world.

    Parameters
    ----------
    radius, radius_var : what is known of its radius [m, m²]; a negative variance: nothing
    """
    sides.by_centre = True
    looks.stand(views, views.share[k])
    first, last = views.begin[k], views.begin[k + 1] - 1
    sigma = views.sigma
    own_start = views.start[k] != looks.HIDDEN
    own_end = views.end[k] != looks.HIDDEN
    first_x, first_y = _direction(views, views.point_x[first], views.point_y[first])
    last_x, last_y = _direction(views, views.point_x[last], views.point_y[last])
    near = views.near[k]
    half_angle = 0.5 * (
        math.atan2(abs(first_x * last_y - first_y * last_x), first_x * last_x + first_y * last_y) + views.step
    )
    gap = near * views.step
    sine = math.sin(min(half_angle, 1.2))
    seen = near * sine / (1.0 - sine)
    seen = min(seen, 0.6 * max(views.length[k], views.chord[k]) + gap)
    sides.half_var = AT_LEAST
    if own_start and own_end:
        sides.half, sides.half_var = seen, gap * gap / 24.0 + FLOOR + RAGGED * RAGGED * seen * seen
    if radius_var < 0.0:
        radius, radius_var = seen, 0.0025
        if sides.half_var >= 0.0:
            radius_var = sides.half_var
    mid_x, mid_y = first_x + last_x, first_y + last_y
    norm = math.sqrt(mid_x * mid_x + mid_y * mid_y)
    if norm > 0.0:
        mid_x, mid_y = mid_x / norm, mid_y / norm
    else:
        mid_x, mid_y = first_x, first_y
    across_var = 0.0
    if own_start and own_end:
        across_var = gap * gap / 24.0
    elif own_start or own_end:
        # From the edge that is its own, the centre is a radius away.
        inwards = math.asin(min(radius / (near + radius), 1.0)) - 0.5 * views.step
        if own_start:
            mid_x, mid_y = _turned(first_x, first_y, views.side * inwards)
        else:
            mid_x, mid_y = _turned(last_x, last_y, -views.side * inwards)
        across_var = gap * gap / 12.0 + radius_var
    else:
        across_var = 0.25 * views.chord[k] * views.chord[k] + radius_var + 0.01
    centre_x, centre_y = views.x + mid_x * (near + radius), views.y + mid_y * (near + radius)
    depth_var = sigma * sigma + radius_var
    if views.shape[k] == ROUND and own_start and own_end:
        centre_x, centre_y = views.centre_x[k], views.centre_y[k]
        sides.half = 0.5 * views.length[k]
        sides.half_var = 4.0 * sigma * sigma / views.size[k] + FLOOR
        depth_var = sides.half_var
    elif views.shape[k] == LEGGED:
        centre_x, centre_y = views.middle_x[k], views.middle_y[k]
        depth_var = across_var = LEGGED_VAR
    ragged = 0.0 if views.shape[k] == ROUND else RAGGED * views.length[k]
    sides.lasting_var = ragged * ragged
    more = FLOOR + pose_var + sides.lasting_var
    across_var += more
    # Of what is round the arc tells the middle, wherever it ends.
    sides.is_doubtful = views.shape[k] != ROUND and (
        views.start[k] == looks.OPEN or views.end[k] == looks.OPEN
    )
    if sides.is_doubtful:
        across_var += _doubt(views.start[k]) + _doubt(views.end[k])
    depth_var += more
    sides.z[0] = sides.z[1] = centre_x
    sides.z[2] = sides.z[3] = centre_y
    sides.var[0] = sides.var[1] = mid_x * mid_x * depth_var + mid_y * mid_y * across_var
    sides.var[2] = sides.var[3] = mid_y * mid_y * depth_var + mid_x * mid_x * across_var
    looks.stand(views, 0.0)


def _direction(views: Views, x: float, y: float) -> tuple[float, float]:
    """Unit vector from the sensor to a point."""
    dx, dy = x - views.x, y - views.y
    r = math.sqrt(dx * dx + dy * dy)
    return (dx / r, dy / r) if r > 0.0 else (1.0, 0.0)


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    cos, sin = math.cos(angle), math.sin(angle)
    return cos * x - sin * y, sin * x + cos * y


def is_partial(views: Views, k: int) -> bool:
    """Whether a view may not reach to both ends of a thing."""
    return views.start[k] != looks.OWN or views.end[k] != looks.OWN
