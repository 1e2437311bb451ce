"""§3, Fig. 8: categories by the topology of the faces that join the vertices."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.circle import Circles, fit_circles
from lidarcli.formalism.detection import IRREGULAR, PRISMATIC, ROUND, UNKNOWN
from lidarcli.formalism.faces import Faces
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


def classify(
    x: Float64,
    y: Float64,
    offsets: Int64,
    faces: Faces,
    face: Int64,
    face_offsets: Int64,
    width: Float64,
    away: Float64,
    sigma: Float64,
) -> tuple[UInt8, Circles]:
    """Shape of K objects: the simpler of straight faces and a circle that explains the points.

    Both are compared by their Bayesian information: n log rms² + p log n, with p parameters.

    Parameters
    ----------
    x, y, offsets : the points of the objects, joined [m]
    faces, face, face_offsets : all faces; object k has the faces `face[face_offsets[k]:face_offsets[k + 1]]`
    width : (K,) chord P_i–P_f [m]
    away : (K,) distance of the mean of the points from the sensor [m]
    sigma : (K,) noise of the ranges [m]

    Returns
    -------
    codes : (K,) PRISMATIC, ROUND, IRREGULAR or UNKNOWN
    circles : circles of the objects, of which those of round ones tell something
    """
    beams, count = np.diff(offsets), np.diff(face_offsets)
    rms, square = straightness(
        faces.points, faces.rms, faces.direction_x, faces.direction_y, face, face_offsets, np.cos(SQUARE)
    )
    codes = np.full(len(beams), IRREGULAR, np.uint8)
    most = np.maximum(2.0 * sigma, STRAIGHT_FIT)
    codes[(rms <= most) & (count <= MOST_FACES) & square] = PRISMATIC
    codes[beams < ENOUGH_BEAMS] = UNKNOWN
    able = (beams >= ENOUGH_BEAMS) & ((count > 1) | (rms > FIT_FLOOR))
    # A circle has three parameters, c faces have 3c - 1: so well must it fit to be the simpler explanation.
    floor = np.maximum(0.5 * sigma, FIT_FLOOR)
    rival = np.maximum(rms, floor) * np.exp((1.5 * count - 2.0) * np.log(beams) / beams)
    # One that fits so much worse cannot win, not even after its refinement.
    circles = fit_circles(x, y, offsets, np.where(able, WORSE * rival, -1.0))
    arc = (
        (np.maximum(circles.rms, floor) < rival)
        & (circles.x * circles.x + circles.y * circles.y > away * away)
        & (circles.rms <= most)
        & (width > ARC * circles.radius)
    )
    codes[arc] = ROUND
    return codes, circles


@compiled
def straightness(
    points: Int64,
    rms: Float64,
    direction_x: Float64,
    direction_y: Float64,
    face: Int64,
    offsets: Int64,
    least: float,
) -> tuple[Float64, Bool]:
    """How well the faces of each of K objects explain its points, and whether they meet as those of a box do.

    Parameters
    ----------
    points, rms, direction_x, direction_y : (F,) of all faces
    face, offsets : object k has the faces `face[offsets[k]:offsets[k + 1]]`
    least : sine of the least angle by which the outline of a box turns right at a corner

    Returns
    -------
    rms : (K,) root mean square distance of the points from the faces [m]; 0 without faces
    square : (K,) whether all faces meet at right angles that point at the sensor
    """
    objects = len(offsets) - 1
    owner = np.repeat(np.arange(objects), np.diff(offsets))
    weight = points[face].astype(np.float64)
    total = np.bincount(owner, weight * np.square(rms[face]), minlength=objects)
    scatter: Float64 = np.sqrt(total / np.maximum(np.bincount(owner, weight, minlength=objects), 1.0))
    # Walking counter-clockwise around the sensor, the outline turns right at a corner that points at it.
    x, y = direction_x[face], direction_y[face]
    right = y[:-1] * x[1:] - x[:-1] * y[1:]
    square = np.ones(objects, bool)
    square[owner[1:][(right < least) & (owner[1:] == owner[:-1])]] = False
    return scatter, square
