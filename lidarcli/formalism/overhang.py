"""Where a thing ends: somewhere between the last beam that hits it and the next one, which passes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lidarcli.formalism.corners import Corners
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.ragged import offsets_of
from lidarcli.formalism.runs import OPEN, OWN, Runs
from lidarcli.kernels import compiled
from lidarcli.sweeps import Float64, Int64, UInt8


def overhang(runs: Runs, faces: Faces, corners: Corners, chosen: Int64) -> tuple[Float64, Float64, Corners]:
    """How far runs go on, on average, past their first and their last point.

    Nothing tells where between two beams an edge is, so the middle is the best guess: the bearing half a step further, on
    the line of the face that ends there. Only an edge of its own ends a thing; what is hidden may go on for longer.

    Parameters
    ----------
    runs, faces, corners : R runs with their faces and where these meet
    chosen : (C,) runs

    Returns
    -------
    before, after : (C,) metres along the first and the last face; 0 at other edges and without faces
    corners : with the first and the last one of the chosen runs moved out by so much
    """
    half = 0.5 * runs.points.geometry.step
    before, after, x, y = stretched(runs, faces, corners, chosen, np.cos(half), np.sin(half))
    return before, after, replace(corners, x=x, y=y)


@compiled
def stretched(
    runs: Runs, faces: Faces, corners: Corners, chosen: Int64, cos: Float64, sin: Float64
) -> tuple[Float64, Float64, Float64, Float64]:
    """What `overhang` returns, of the corners their x and y [m]; `cos` and `sin` (S,) are those of half a step."""
    both = np.zeros((2, len(chosen)))
    some = np.flatnonzero(faces.offsets[chosen + 1] > faces.offsets[chosen])
    run = chosen[some]
    cos, sin = cos[runs.row[run]], sin[runs.row[run]]
    x, y = corners.x.copy(), corners.y.copy()
    for side, at, inner, face, vertex, edge, way in (
        (
            0,
            runs.first[run],
            runs.first[run] + 1,
            faces.offsets[run],
            corners.offsets[run],
            runs.start_edge,
            -1,
        ),
        (
            1,
            runs.last[run],
            runs.last[run] - 1,
            faces.offsets[run + 1] - 1,
            corners.offsets[run + 1] - 1,
            runs.end_edge,
            1,
        ),
    ):
        past = _past(runs, faces, at, inner, face, cos, way * sin, edge[run])
        both[side, some] = past
        x[vertex] += way * past * faces.direction_x[face]
        y[vertex] += way * past * faces.direction_y[face]
    return both[0], both[1], x, y


def _past(
    runs: Runs, faces: Faces, at: Int64, inner: Int64, face: Int64, cos: Float64, sin: Float64, edge: UInt8
) -> Float64:
    """Way along `face` from the point `at` to the bearing past it, turned by `cos`, `sin`; `inner` is the point next to
    it."""
    x, y = runs.points.x[at], runs.points.y[at]
    along_x, along_y = faces.direction_x[face], faces.direction_y[face]
    ray_x, ray_y = x * cos - y * sin, x * sin + y * cos
    across = along_x * ray_y - along_y * ray_x
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.abs((x * x + y * y) * sin / across)
    # Seen at a grazing angle, the line of a face may meet that bearing anywhere: not further than its last two points.
    spacing = np.abs((x - runs.points.x[inner]) * along_x + (y - runs.points.y[inner]) * along_y)
    past: Float64 = np.where((edge == OWN) | (edge == OPEN), np.fmin(way, spacing), 0.0)
    return past


@compiled
def lengthen(length: Float64, offsets: Int64, chosen: Int64, before: Float64, after: Float64) -> None:
    """Add to the lengths of the faces of the chosen runs, one run after the other, their overhang; in place.

    Parameters
    ----------
    length : (F,) [m]
    offsets : (R + 1,) run j has the faces `offsets[j]` to `offsets[j + 1] - 1`
    chosen : (C,) runs
    before, after : (C,) [m]
    """
    ends = offsets_of(np.diff(offsets)[chosen])
    some = np.flatnonzero(np.diff(ends))
    length[ends[some]] += before[some]
    length[ends[some + 1] - 1] += after[some]
