"""What a body is by all that was seen of it: straight faces or not, and legs beside it that are too slim to be objects."""

from __future__ import annotations

import math

from lidarcli.formalism import detection
from lidarcli.formalism.segmentation import Scans
from lidarcli.formalism.tracking import bodies as things
from lidarcli.formalism.tracking import memory
from lidarcli.formalism.tracking import views as looks
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.views import Views

PRISMATIC = detection.PRISMATIC
PER_BEAM = 0.05
"""Each beam of a view counts as this share of a view, up to one."""
SLIM = 0.15
"""[m] A leg is no wider."""
AROUND = 0.75
"""[m] Legs of one thing are not further apart …"""
BESIDE = 0.1
"""[m] … and not closer together."""
SPECK = 2
"""Beams of what is too slim to be an object, at most …"""
BEHIND = 0.25
"""[m] … which is nearer than its neighbours by this."""
SAME = 0.08
"""[m] A leg is where it was, give or take this."""


def note(bodies: Bodies, b: int, views: Views, k: int) -> None:
    """Count the shape that a view has been taken for."""
    bodies.looks[5 * b + views.shape[k]] += min(views.size[k] * PER_BEAM, 1.0)
    if views.shape[k] != PRISMATIC:
        return
    for f in range(views.face_begin[k], views.face_begin[k + 1]):
        if views.face_points[f] > 4 and views.sigma > 0.0:
            bodies.bulge[b] += views.bulge[f] / (views.sigma * views.sigma)
            bodies.bulge_points[b] += views.face_points[f] - 2


def note_legs(bodies: Bodies, b: int, views: Views, k: int, scans: Scans) -> None:
    """Remember the slim things around a slim body that stands, of which beams tell too little to be objects."""
    if (
        bodies.moved[b] != 0
        or views.length[k] > SLIM
        or views.step < memory.LEAST_STEP
        or views.near[k] <= AROUND
    ):
        return
    ahead, left = looks.to_sensor(views, views.middle_x[k], views.middle_y[k])
    past = math.atan2(left, ahead) - views.first
    past -= looks.TURN * math.floor(past / looks.TURN)
    wide = math.asin(AROUND / views.near[k])
    first, last = int((past - wide) / views.step), int((past + wide) / views.step)
    last = min(last, first + views.bearings)
    run = 0
    looks.stand(views, views.share[k])
    before = memory.range_at(views, scans, first - 1)
    for position in range(first, last + 1):
        here, after = memory.range_at(views, scans, position), memory.range_at(views, scans, position + 1)
        run = run + 1 if run > 0 and abs(here - before) < SAME else (1 if before > here + BEHIND else 0)
        if 0 < run <= SPECK and here > 0.0 and after > here + BEHIND:
            theta = views.first + views.step * position
            x, y = looks.to_world(views, here * math.cos(theta), here * math.sin(theta))
            dx, dy = x - views.middle_x[k], y - views.middle_y[k]
            apart = dx * dx + dy * dy
            if BESIDE * BESIDE < apart < AROUND * AROUND:
                _note_leg(bodies, b, x, y)
        before = here
    looks.stand(views, 0.0)


def _note_leg(bodies: Bodies, b: int, x: float, y: float) -> None:
    """Remember one of them: the mean of where it was seen."""
    for i in range(things.LEGS * b, things.LEGS * b + things.LEGS):
        seen = bodies.leg_seen[i]
        dx, dy = x - bodies.leg_x[i], y - bodies.leg_y[i]
        if seen == 0 or dx * dx + dy * dy < SAME * SAME:
            bodies.leg_x[i] += dx / (seen + 1)
            bodies.leg_y[i] += dy / (seen + 1)
            bodies.leg_seen[i] += 1
            return
