"""§3, Fig. 8: categories by the topology of the faces that join the vertices."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.circle import Circles, fit_circles
from lidarcli.formalism.detection import IRREGULAR, PRISMATIC, ROUND, UNKNOWN
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.members import Members
from lidarcli.formalism.outlines import Outlines
from lidarcli.kernels import compiled
from lidarcli.sweeps import Bool, Float64, Int64, UInt8

ENOUGH_BEAMS = 5
"""Fewer beams cannot tell a corner from an arc."""
FIT_FLOOR = 0.004
"""[m] Fits better than this are equally good."""
STRAIGHT_FIT = 0.012
"""[m] Points of a face may scatter this much, or twice the noise."""
SQUARE = np.deg2rad(35.0)
"""Faces of a prism meet within this of a right angle, and point their corner at the sensor."""
MOST_FACES = 3
"""Of a box no more are seen, be it from its inside."""
WORSE = 1.5
"""The algebraic circle may fit this much worse than the best one."""
ARC = 0.6
"""A circle is believed where the chord of its arc is longer than this share of its radius."""


def classify(members: Members, outlines: Outlines, faces: Faces, sigma: Float64) -> tuple[UInt8, Circles]:
    """Shape of K objects: the simpler of straight faces and a circle that explains the points.

    Both are compared by their Bayesian information: n log rms² + p log n, with p parameters.

    Parameters
    ----------
    members, outlines : their points and faces
    faces : all faces
    sigma : (K,) noise of the ranges [m]

    Returns
    -------
    codes : (K,) PRISMATIC, ROUND, IRREGULAR or UNKNOWN
    circles : circles of the objects, of which those of round ones tell something
    """
    beams, count = np.diff(members.offsets), np.diff(outlines.face_offsets)
    # A circle has three parameters, c faces have 3c - 1.
    handicap = np.exp((1.5 * count - 2.0) * np.log(beams) / beams)
    codes, rival, within = by_faces(
        faces, outlines.face, outlines.face_offsets, beams, sigma, handicap, np.cos(SQUARE)
    )
    circles = fit_circles(members.point_x, members.point_y, members.offsets, within)
    codes[better_as_arcs(members, circles, sigma, rival)] = ROUND
    return codes, circles


@compiled
def by_faces(
    faces: Faces,
    face: Int64,
    offsets: Int64,
    beams: Int64,
    sigma: Float64,
    handicap: Float64,
    least: float,
) -> tuple[UInt8, Float64, Float64]:
    """What K objects are by their faces alone.

    Parameters
    ----------
    faces, face, offsets, least : see `straightness`
    beams, sigma : (K,) number of points, and noise of the ranges [m]
    handicap : (K,) so many times worse than the faces may a circle fit to be the simpler explanation

    Returns
    -------
    codes : (K,) PRISMATIC, IRREGULAR or UNKNOWN
    rival : (K,) a circle has to fit better than this [m]
    within : (K,) one that fits worse than this cannot win, not even after its refinement [m]; negative: none can
    """
    count = np.diff(offsets)
    rms, square = straightness(faces, face, offsets, least)
    codes = np.full(len(beams), IRREGULAR, np.uint8)
    codes[(rms <= np.maximum(2.0 * sigma, STRAIGHT_FIT)) & (count <= MOST_FACES) & square] = PRISMATIC
    codes[beams < ENOUGH_BEAMS] = UNKNOWN
    able = (beams >= ENOUGH_BEAMS) & ((count > 1) | (rms > FIT_FLOOR))
    rival = np.maximum(rms, np.maximum(0.5 * sigma, FIT_FLOOR)) * handicap
    return codes, rival, np.where(able, WORSE * rival, -1.0)


@compiled
def better_as_arcs(members: Members, circles: Circles, sigma: Float64, rival: Float64) -> Bool:
    """(K,) which objects their circles explain better than their faces do, see `by_faces`."""
    arc: Bool = (
        (np.maximum(circles.rms, np.maximum(0.5 * sigma, FIT_FLOOR)) < rival)
        & (np.square(circles.x) + np.square(circles.y) > np.square(members.x) + np.square(members.y))
        & (circles.rms <= np.maximum(2.0 * sigma, STRAIGHT_FIT))
        & (members.width > ARC * circles.radius)
    )
    return arc


def straightness(faces: Faces, face: Int64, offsets: Int64, least: float) -> tuple[Float64, Bool]:
    """How well the faces of each of K objects explain its points, and whether they meet as those of a box do.

    Parameters
    ----------
    faces : all faces
    face, offsets : object k has the faces `face[offsets[k]:offsets[k + 1]]`
    least : sine of the least angle by which the outline of a box turns right at a corner

    Returns
    -------
    rms : (K,) root mean square distance of the points from the faces [m]; 0 without faces
    square : (K,) whether all faces meet at right angles that point at the sensor
    """
    objects = len(offsets) - 1
    owner = np.repeat(np.arange(objects), np.diff(offsets))
    weight = faces.points[face].astype(np.float64)
    total = np.bincount(owner, weight * np.square(faces.rms[face]), minlength=objects)
    scatter: Float64 = np.sqrt(total / np.maximum(np.bincount(owner, weight, minlength=objects), 1.0))
    # Walking counter-clockwise around the sensor, the outline turns right at a corner that points at it.
    x, y = faces.direction_x[face], faces.direction_y[face]
    right = y[:-1] * x[1:] - x[:-1] * y[1:]
    square = np.ones(objects, bool)
    square[owner[1:][(right < least) & (owner[1:] == owner[:-1])]] = False
    return scatter, square
