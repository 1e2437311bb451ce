"""§3, Fig. 8: categories by the topology of the faces that join the vertices."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.circle import Circles, fit_circles
from lidarcli.formalism.detection import IRREGULAR, PRISMATIC, ROUND, UNKNOWN
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.ragged import span_sum, spans
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


def classify(
    x: Float64,
    y: Float64,
    offsets: Int64,
    faces: Faces,
    face: Int64,
    face_offsets: Int64,
    width: Float64,
    sigma: Float64,
) -> tuple[UInt8, Int64, Circles]:
    """Shape of K objects: the simpler of straight faces and a circle that explains the points.

    Both are compared by their Bayesian information: n log rms² + p log n, with p parameters.

    Parameters
    ----------
    x, y, offsets : the points of the objects, joined [m]
    faces, face, face_offsets : all faces; object k has the faces `face[face_offsets[k]:face_offsets[k + 1]]`
    width : (K,) chord P_i–P_f [m]
    sigma : (K,) noise of the ranges [m]

    Returns
    -------
    codes : (K,) PRISMATIC, ROUND, IRREGULAR or UNKNOWN
    round_ones : (C,) objects that are round
    circles : their circles
    """
    beams = np.diff(offsets)
    count = np.diff(face_offsets)
    rms = _straight_rms(faces, face, face_offsets)
    codes = np.full(len(beams), IRREGULAR, np.uint8)
    straight = rms <= np.maximum(2.0 * sigma, STRAIGHT_FIT)
    codes[straight & (count <= MOST_FACES) & _square(faces, face, face_offsets)] = PRISMATIC
    codes[beams < ENOUGH_BEAMS] = UNKNOWN
    able = np.flatnonzero((beams >= ENOUGH_BEAMS) & ((count > 1) | (rms > FIT_FLOOR)))
    index, _, able_offsets = spans(offsets[able], beams[able])
    size, floor = beams[able], np.square(np.maximum(0.5 * sigma[able], FIT_FLOOR))
    penalty = np.log(size)
    # A circle that fits so much worse than the faces cannot win, not even after its refinement.
    rival = np.sqrt(np.maximum(np.square(rms[able]), floor)) * np.exp(
        (1.5 * count[able] - 2.0) * penalty / size
    )
    circles = fit_circles(x[index], y[index], able_offsets, WORSE * rival)
    of_circle = size * np.log(np.maximum(np.square(circles.rms), floor)) + 3.0 * penalty
    of_faces = size * np.log(np.maximum(np.square(rms[able]), floor)) + (3.0 * count[able] - 1.0) * penalty
    near_side = np.hypot(circles.x, circles.y) > np.hypot(
        span_sum(x[index], able_offsets) / size, span_sum(y[index], able_offsets) / size
    )
    arc = (
        (of_circle < of_faces)
        & near_side
        & (circles.rms <= np.maximum(2.0 * sigma[able], STRAIGHT_FIT))
        & (width[able] > ARC * circles.radius)
    )
    codes[able[arc]] = ROUND
    chosen = Circles(circles.x[arc], circles.y[arc], circles.radius[arc], circles.rms[arc])
    return codes, able[arc], chosen


def _straight_rms(faces: Faces, face: Int64, face_offsets: Int64) -> Float64:
    """(K,) root mean square distance of the points of each object from its faces [m]; 0 without faces."""
    rms = np.zeros(len(face_offsets) - 1)
    filled = np.flatnonzero(np.diff(face_offsets) > 0)
    offsets = np.append(face_offsets[filled], len(face))
    points = faces.points[face].astype(np.float64)
    total = span_sum(points * np.square(faces.rms[face]), offsets)
    rms[filled] = np.sqrt(total / np.maximum(span_sum(points, offsets), 1.0))
    return rms


def _square(faces: Faces, face: Int64, face_offsets: Int64) -> Bool:
    """(K,) whether the faces of each object meet at right angles that point at the sensor."""
    square = np.ones(len(face_offsets) - 1, bool)
    owner = np.repeat(np.arange(len(square)), np.diff(face_offsets))
    angle = faces.angle[face]
    turn = angle[1:] - angle[:-1]
    # Walking counter-clockwise around the sensor, the outline turns right at a corner that points at it.
    skew = np.abs((turn + 0.5 * np.pi + np.pi) % (2.0 * np.pi) - np.pi) > SQUARE
    square[owner[1:][skew & (owner[1:] == owner[:-1])]] = False
    return square
