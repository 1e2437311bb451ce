"""Where a thing ends: somewhere between the last beam that hits it and the next one, which passes it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lidarcli.formalism.corners import Corners
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.runs import OPEN, OWN, Runs
from lidarcli.sweeps import Float64, Int64, UInt8


def overhang(runs: Runs, faces: Faces, chosen: Int64) -> tuple[Float64, Float64]:
    """How far runs go on, on average, past their first and their last point.

    Nothing tells where between two beams an edge is, so the middle is the best guess: the bearing half a step further, on
    the line of the face that ends there. Only an edge of its own ends a thing; what is hidden may go on for longer.

    Parameters
    ----------
    runs, faces : R runs and their F faces
    chosen : (C,) runs

    Returns
    -------
    before, after : (C,) metres along the first and the last face; 0 at other edges and without faces
    """
    both = np.zeros((2, len(chosen)))
    some = np.flatnonzero(faces.offsets[chosen + 1] > faces.offsets[chosen])
    chosen = chosen[some]
    first, last = runs.first[chosen], runs.last[chosen]
    half = 0.5 * runs.points.geometry.step[runs.row[chosen]]
    lead, end = faces.offsets[chosen], faces.offsets[chosen + 1] - 1
    both[0, some] = _past(runs, faces, first, first + 1, lead, -half, runs.start_edge[chosen])
    both[1, some] = _past(runs, faces, last, last - 1, end, half, runs.end_edge[chosen])
    return both[0], both[1]


def stretched(corners: Corners, faces: Faces, chosen: Int64, before: Float64, after: Float64) -> Corners:
    """The same corners with the first and the last one of the chosen runs (C,) moved out by their overhang [m]."""
    some = np.flatnonzero(faces.offsets[chosen + 1] > faces.offsets[chosen])
    run = chosen[some]
    x, y = corners.x.copy(), corners.y.copy()
    for vertex, face, way in (
        (corners.offsets[run], faces.offsets[run], -before[some]),
        (corners.offsets[run + 1] - 1, faces.offsets[run + 1] - 1, after[some]),
    ):
        x[vertex] += way * faces.direction_x[face]
        y[vertex] += way * faces.direction_y[face]
    return replace(corners, x=x, y=y)


def _past(
    runs: Runs, faces: Faces, at: Int64, inner: Int64, face: Int64, turn: Float64, edge: UInt8
) -> Float64:
    """Way along `face` from the point `at` to the bearing `turn` [rad] past it; `inner` is the point next to it."""
    x, y = runs.points.x[at], runs.points.y[at]
    along_x, along_y = faces.direction_x[face], faces.direction_y[face]
    cos, sin = np.cos(turn), np.sin(turn)
    ray_x, ray_y = x * cos - y * sin, x * sin + y * cos
    across = along_x * ray_y - along_y * ray_x
    with np.errstate(divide="ignore", invalid="ignore"):
        way = np.abs((x * x + y * y) * sin / across)
    # Seen at a grazing angle, the line of a face may meet that bearing anywhere: not further than its last two points.
    spacing = np.abs((x - runs.points.x[inner]) * along_x + (y - runs.points.y[inner]) * along_y)
    past: Float64 = np.where((edge == OWN) | (edge == OPEN), np.fmin(way, spacing), 0.0)
    return past
