"""Definitions 6 and 7: the vertices of each object, and the faces between them."""

from __future__ import annotations

from typing import Any

import numpy as np

from lidarcli.formalism.corners import Corners
from lidarcli.formalism.detection import CORNER, END, EXTREMUM, START
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.parts import Parts
from lidarcli.formalism.ragged import offsets_of, spans
from lidarcli.formalism.runs import Runs
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int64, UInt8


@record
class Outlines:
    """V vertices and F faces of K objects: of each part the first point, those between its faces, the last point.

    A run of a single point has one vertex. The ends of a part inside an object are corners of it.
    """

    face_offsets: Int64
    """(K + 1,) object k has the faces `face[face_offsets[k]:face_offsets[k + 1]]`."""
    face: Int64
    """(F,) index among all faces."""
    begin: Int64
    """(F,) the vertex where it begins; the next one is where it ends."""
    length: Float64
    """(F,) distance of these [m]."""
    offsets: Int64
    """(K + 1,) object k has the vertices `offsets[k]:offsets[k + 1]`."""
    x: Float64
    """(V,) where its faces put the vertex, or its point where they do not: forward [m]."""
    y: Float64
    """(V,) left [m]."""
    kind: UInt8
    """(V,) codes into `VERTEX_KINDS`."""
    r: Float64
    """(V,) range [m]."""
    theta: Float64
    """(V,) bearing [rad]."""


def trace(runs: Runs, faces: Faces, corners: Corners | None, extremum: Bool, parts: Parts) -> Outlines:
    """Find the vertices and faces of the objects (Def. 6).

    Parameters
    ----------
    runs, faces : R runs over M points, and their faces
    corners : where the vertices are; None: at their points
    extremum : (M,) inner vertices that are extrema of r rather than corners
    parts : K objects as lists of runs
    """
    *columns, moved, across, along = traced(runs, faces, corners, extremum, parts)
    outlines = Outlines(*columns)
    outlines.theta[moved] += np.arctan2(across, along)
    return outlines


@compiled
def traced(
    runs: Runs, faces: Faces, corners: Corners | None, extremum: Bool, parts: Parts
) -> tuple[Any, ...]:
    """Columns of `Outlines`, with the bearings of the points in place of those of the vertices; and how these differ.

    The last are (D,) each: the vertices that are not at their points, sine and cosine of the angle from the point to the
    vertex, but for a factor.
    """
    chosen, points = parts.run, runs.points
    face, _, face_offsets = spans(faces.offsets[chosen], np.diff(faces.offsets)[chosen])
    sizes = np.diff(face_offsets) + 1
    offsets = offsets_of(sizes)
    begin, end = offsets[:-1], offsets[1:] - 1
    at = np.empty(offsets[-1], np.int64)
    at[begin] = runs.first[chosen]
    follows = np.ones(len(at), bool)
    follows[begin] = False
    at[follows] = faces.last[face]
    owner = np.repeat(np.arange(len(chosen)), sizes)
    theta = points.theta(at, runs.row[chosen][owner]) + parts.past[owner]
    x, y, r = points.x[at], points.y[at], points.range(at)
    on_x, on_y = x.copy(), y.copy()
    moved, across, along = at[:0], x[:0], x[:0]
    if corners is not None:
        has = np.diff(corners.offsets)[chosen] > 0
        source, _, _ = spans(corners.offsets[chosen[has]], np.diff(corners.offsets)[chosen[has]])
        target, _, _ = spans(begin[has], sizes[has])
        on_x[target], on_y[target] = corners.x[source], corners.y[source]
        source, moved = source[corners.moved[source]], target[corners.moved[source]]
        to_x, to_y = corners.x[source], corners.y[source]
        across, along = to_y * x[moved] - to_x * y[moved], to_x * x[moved] + to_y * y[moved]
        x[moved], y[moved], r[moved] = to_x, to_y, np.sqrt(to_x * to_x + to_y * to_y)
    before = np.flatnonzero(follows) - 1
    dx, dy = x[before + 1] - x[before], y[before + 1] - y[before]
    kind = np.where(extremum[at], EXTREMUM, CORNER).astype(np.uint8)
    kind[end] = CORNER
    kind[begin] = CORNER
    vertex_offsets = offsets[parts.offsets]
    kind[vertex_offsets[1:] - 1] = END
    kind[vertex_offsets[:-1]] = START
    return (
        face_offsets[parts.offsets],
        face,
        before,
        np.sqrt(dx * dx + dy * dy),
        vertex_offsets,
        on_x,
        on_y,
        kind,
        r,
        theta,
        moved,
        across,
        along,
    )
