"""The oriented bounding box of an object (§3, Fig. 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.faces import Faces
from lidarcli.formalism.points import Cloud
from lidarcli.formalism.ragged import span_max, span_min
from lidarcli.sweeps import Float64, Int64

DIRECTIONS = 3
"""How many of its longest faces propose the direction of a box."""


@dataclass(frozen=True, slots=True)
class Boxes:
    """(K,) each: centre [m], length ≥ width [m], yaw of the long side in (-π/2, π/2] [rad]."""

    x: Float64
    y: Float64
    length: Float64
    width: Float64
    yaw: Float64


def bounding_boxes(
    points: Cloud, index: Int64, owner: Int64, offsets: Int64, faces: Faces, face: Int64, face_offsets: Int64
) -> Boxes:
    """Smallest of the rectangles around each object that have a side along one of its longest faces, or its chord.

    Parameters
    ----------
    points : the points of the batch
    index, owner, offsets : the points of K objects, joined
    faces : all faces; object k has the faces `face[face_offsets[k]:face_offsets[k + 1]]`

    Returns
    -------
    Boxes of K objects
    """
    x, y = points.x[index], points.y[index]
    count = len(offsets) - 1
    angles = _face_angles(faces, face, face_offsets, count)
    chord = np.arctan2(y[offsets[1:] - 1] - y[offsets[:-1]], x[offsets[1:] - 1] - x[offsets[:-1]])
    angles.append(np.where(np.diff(offsets) > 1, chord, 0.0))
    best = None
    for angle in angles:
        cos, sin = np.cos(angle), np.sin(angle)
        along = x * cos[owner] + y * sin[owner]
        across = y * cos[owner] - x * sin[owner]
        low_u, high_u = span_min(along, offsets), span_max(along, offsets)
        low_v, high_v = span_min(across, offsets), span_max(across, offsets)
        area = (high_u - low_u) * (high_v - low_v)
        found = np.stack([area, angle, low_u, high_u, low_v, high_v])
        best = found if best is None else np.where(area < best[0], found, best)
    if best is None:
        best = np.zeros((6, count))
    _, angle, low_u, high_u, low_v, high_v = best
    middle_u, middle_v = 0.5 * (low_u + high_u), 0.5 * (low_v + high_v)
    cos, sin = np.cos(angle), np.sin(angle)
    length, width = high_u - low_u, high_v - low_v
    turn = width > length
    yaw = np.where(turn, angle + 0.5 * np.pi, angle)
    return Boxes(
        x=middle_u * cos - middle_v * sin,
        y=middle_u * sin + middle_v * cos,
        length=np.where(turn, width, length),
        width=np.where(turn, length, width),
        yaw=0.5 * np.pi - (0.5 * np.pi - yaw) % np.pi,
    )


def _face_angles(faces: Faces, face: Int64, face_offsets: Int64, count: int) -> list[Float64]:
    """Directions [rad] of the `DIRECTIONS` longest faces of each object; the longest again where there are fewer."""
    sizes = np.diff(face_offsets)
    owner = np.repeat(np.arange(count), sizes)
    order = np.lexsort((-faces.length[face], owner))
    ranked = face[order]
    angles = []
    for rank in range(DIRECTIONS):
        has = sizes > rank
        if not has.any():
            break
        pick = face_offsets[:-1] + np.where(has, rank, 0)
        chosen = ranked[np.minimum(pick, len(ranked) - 1)]
        angle = np.arctan2(faces.direction_y[chosen], faces.direction_x[chosen])
        angles.append(np.where(sizes > 0, angle, 0.0))
    return angles
