"""What is known of each object once the runs are chosen: its numbers, vertices, faces, box and shape."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from lidarcli.formalism.box import bounding_boxes
from lidarcli.formalism.corners import Corners
from lidarcli.formalism.detection import (
    CORNER,
    END,
    EXTREMUM,
    LEGGED,
    NOISE,
    OBJECT,
    PRISMATIC,
    ROUND,
    START,
    WALL,
    Detection,
)
from lidarcli.formalism.difference import difference
from lidarcli.formalism.discontinuity import adaptive_threshold
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.objects import visibility
from lidarcli.formalism.overhang import overhang, stretched
from lidarcli.formalism.parts import Parts, assemble
from lidarcli.formalism.ragged import offsets_of, span_first, span_min, span_sum, spans
from lidarcli.formalism.runs import Runs
from lidarcli.formalism.shape import classify
from lidarcli.kernels import compiled
from lidarcli.sweeps import Bool, Float64, Int64, SweepBatch, UInt8


@dataclass(frozen=True, slots=True)
class Segmentation:
    """Which runs are what, and how they divide into faces."""

    faces: Faces
    extremum: Bool
    """(M,) inner vertices that are extrema of r rather than corners."""
    is_object: Bool
    """(R,)"""
    is_wall: Bool
    """(R,) walls to report."""
    label: Int64 | None = None
    """(R,) objects of the same label are one; None: each run is alone."""
    body: Int64 | None = None
    """(R,) objects of one label may have several bodies, as a chair has legs; None: they have one."""
    corners: Corners | None = None
    """Where the vertices are; None: at their points."""


def describe(
    batch: SweepBatch,
    runs: Runs,
    segmentation: Segmentation,
    d_mean: Float64,
    sweep_d_th: Float64,
    adaptive: bool,
    sigma: Float64,
    per_beam: bool,
) -> Detection:
    """Fill a `Detection` from the chosen runs.

    Parameters
    ----------
    batch : S sweeps
    runs, segmentation : R runs over M points, and which of them are objects or walls
    d_mean, sweep_d_th, sigma : (S,) Def. 3's mean, the threshold used, the noise [m]
    adaptive : whether the threshold grows with range
    per_beam : whether the beams themselves are wanted
    """
    faces, points = segmentation.faces, runs.points
    rows = len(batch)
    parts = assemble(runs, segmentation.is_object, segmentation.is_wall, segmentation.label)
    begin, end = parts.run[parts.offsets[:-1]], parts.run[parts.offsets[1:] - 1]
    row, wall = runs.row[begin], segmentation.is_wall[begin]
    count = np.bincount(row[~wall], minlength=rows)
    number = np.arange(len(begin)) - offsets_of(np.bincount(row, minlength=rows))[row] + 1

    first, last = runs.first[begin], runs.last[end]
    part_first, part_size = runs.first[parts.run], runs.size[parts.run]
    offsets, x, y, nearest, nearest_part, r_min, middle_x, middle_y, width = gathered(
        part_first, part_size, parts.offsets, points.x, points.y, points.cell, points.grid.range
    )
    face, _, face_part_offsets = spans(faces.offsets[parts.run], np.diff(faces.offsets)[parts.run])
    face_offsets = face_part_offsets[parts.offsets]
    size = np.diff(offsets)
    away = np.hypot(middle_x, middle_y)
    shape, circles = classify(x, y, offsets, faces, face, face_offsets, width, away, sigma[row])
    prism = (shape == PRISMATIC) & (np.diff(parts.offsets) == 1)
    corners = segmentation.corners
    if corners is not None:
        before, after = overhang(runs, faces, parts.run)
        corners = stretched(corners, faces, parts.run, before, after)
    hull = _hulls(x, y, offsets, corners, begin, prism)
    box = bounding_boxes(*hull, faces, face, face_offsets, shape == ROUND, circles)
    shape[_of_several(parts, segmentation.body)] = LEGGED
    shape[wall] = WALL

    reverse = points.geometry.reverse[row]
    beam_first = points.geometry.beam(row, points.position(first, row))
    beam_last = points.geometry.beam(row, points.position(last, row))
    object_beams = np.bincount(row[~wall], size[~wall], minlength=rows).astype(np.int32)
    vertex_part_offsets, vertex_theta, vertex_r, vertex_kind, face_length, moved, across, along = outlines(
        runs, faces, segmentation.corners, segmentation.extremum, parts
    )
    vertex_theta[moved] += np.arctan2(across, along)
    if corners is not None:
        some = np.flatnonzero(np.diff(face_part_offsets))
        face_length[face_part_offsets[some]] += before[some]
        face_length[face_part_offsets[some + 1] - 1] += after[some]
    vertex_offsets = vertex_part_offsets[parts.offsets]
    starts, ends = np.ones(len(vertex_theta), bool), np.ones(len(vertex_theta), bool)
    starts[vertex_part_offsets[1:] - 1] = False
    ends[vertex_part_offsets[:-1]] = False
    result = Detection(
        row=row,
        object=number.astype(np.int32),
        set=np.where(wall, NOISE, OBJECT).astype(np.uint8),
        shape=shape,
        visibility=visibility(runs.start_edge[begin], runs.end_edge[end]),
        beam_i=np.where(reverse, beam_last, beam_first).astype(np.int32),
        beam_f=np.where(reverse, beam_first, beam_last).astype(np.int32),
        beams=size.astype(np.int32),
        theta_i=parts.theta_i[parts.offsets[:-1]],
        theta_f=parts.theta_f[parts.offsets[1:] - 1],
        r_i=points.range(first),
        r_f=points.range(last),
        s_i=runs.s_start[begin],
        s_f=runs.s_end[end],
        d_th=adaptive_threshold(
            sigma[row], points.geometry.step[row], points.range(first), runs.s_start[begin]
        )
        if adaptive
        else sweep_d_th[row],
        theta_min=points.theta(nearest, row) + parts.past[nearest_part],
        r_min=r_min,
        x=middle_x,
        y=middle_y,
        width=width,
        box_x=box.x,
        box_y=box.y,
        box_length=box.length,
        box_width=box.width,
        box_yaw=box.yaw,
        vertex_offsets=vertex_offsets.astype(np.int32),
        vertex_theta=vertex_theta,
        vertex_r=vertex_r,
        vertex_kind=vertex_kind,
        face_offsets=face_offsets.astype(np.int32),
        face_theta_i=vertex_theta[starts],
        face_theta_f=vertex_theta[ends],
        face_length=face_length,
        face_rms=faces.rms[face],
        d_mean=d_mean,
        sweep_d_th=sweep_d_th,
        noise=sigma,
        objects=count.astype(np.int32),
        agents=np.zeros(rows, np.int32),
        object_beams=object_beams,
        agent_beams=np.zeros(rows, np.int32),
        noise_beams=batch.beams - object_beams,
    )
    if not per_beam:
        return result
    index, _, _ = spans(part_first, part_size)
    member = np.zeros(len(points.grid.range), np.int32)
    member[points.cell[index]] = np.repeat(np.where(wall, 0, number), size)
    beam_object = points.grid.beams(member, batch.width, 0)
    return replace(
        result,
        beam_object=beam_object,
        beam_set=np.where(beam_object > 0, OBJECT, NOISE).astype(np.uint8),
        beam_s=difference(batch),
    )


def _of_several(parts: Parts, body: Int64 | None) -> Bool:
    """(K,) which objects have more than one body."""
    several = np.zeros(len(parts.offsets) - 1, bool)
    if body is None:
        return several | (np.diff(parts.offsets) > 1)
    owner = np.repeat(np.arange(len(several)), np.diff(parts.offsets))
    label = body[parts.run]
    several[owner[1:][(label[1:] != label[:-1]) & (owner[1:] == owner[:-1])]] = True
    return several


def _hulls(
    x: Float64, y: Float64, offsets: Int64, corners: Corners | None, run: Int64, prism: Bool
) -> tuple[Float64, Float64, Int64, Int64]:
    """What the box of each object has to hold: its points (T,), or of a prism the vertices, which scatter less.

    Takes the points of K objects with their offsets, their first runs and which of them are prisms. Returns points and
    vertices, and for each object where its own begin and how many it has.
    """
    begin, size = offsets[:-1], np.diff(offsets)
    if corners is None or not prism.any():
        return x, y, begin, size
    begin = np.where(prism, len(x) + corners.offsets[run], begin)
    size = np.where(prism, corners.offsets[run + 1] - corners.offsets[run], size)
    return np.concatenate([x, corners.x]), np.concatenate([y, corners.y]), begin, size


@compiled
def gathered(
    first: Int64, size: Int64, parts: Int64, x: Float64, y: Float64, cell: Int64, ranges: Float64
) -> tuple[Int64, Float64, Float64, Int64, Int64, Float64, Float64, Float64, Float64]:
    """Join the points of K objects.

    Parameters
    ----------
    first, size : (P,) first point of each part and number of points
    parts : (K + 1,) object k has the parts `parts[k]:parts[k + 1]`
    x, y, cell : (N,) of all points [m]
    ranges : r of all cells [m]

    Returns
    -------
    offsets : (K + 1,)
    x, y : (T,) the points of the objects
    nearest, part : (K,) the nearest point of each object, and its part
    r_min, middle_x, middle_y, width : (K,) its range, the mean of the points, the distance of the first from the last
    """
    index, _, part_offsets = spans(first, size)
    offsets = part_offsets[parts]
    x, y, r = x[index], y[index], ranges[cell[index]]
    r_min = span_min(r, offsets)
    count = np.diff(offsets)
    nearest = span_first(r == np.repeat(r_min, count), offsets)
    part = np.searchsorted(part_offsets, nearest, side="right") - 1
    begin, end = offsets[:-1], offsets[1:] - 1
    dx, dy = x[end] - x[begin], y[end] - y[begin]
    width = np.sqrt(dx * dx + dy * dy)
    return (
        offsets,
        x,
        y,
        index[nearest],
        part,
        r_min,
        span_sum(x, offsets) / count,
        span_sum(y, offsets) / count,
        width,
    )


@compiled
def outlines(
    runs: Runs, faces: Faces, corners: Corners | None, extremum: Bool, parts: Parts
) -> tuple[Int64, Float64, Float64, UInt8, Float64, Int64, Float64, Float64]:
    """Vertices of the objects (Def. 6): of each part the first point, the points between its faces, the last point.

    A run of a single point has one vertex. The ends of a part inside an object are corners of it.

    Returns
    -------
    offsets : (P + 1,) the vertices of each part
    theta, r, kind : (V,) bearing of the point [rad], range [m] of the vertex, code
    length : (F,) distance between consecutive vertices of a part [m]
    moved : (D,) vertices that are where their faces meet, not at their point
    across, along : (D,) sine and cosine of the angle from the point to the vertex, but for a factor
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
    moved, across, along = at[:0], x[:0], x[:0]
    if corners is not None:
        has = np.diff(corners.offsets)[chosen] > 0
        source, _, _ = spans(corners.offsets[chosen[has]], np.diff(corners.offsets)[chosen[has]])
        target, _, _ = spans(begin[has], sizes[has])
        source, moved = source[corners.moved[source]], target[corners.moved[source]]
        to_x, to_y = corners.x[source], corners.y[source]
        across, along = to_y * x[moved] - to_x * y[moved], to_x * x[moved] + to_y * y[moved]
        x[moved], y[moved], r[moved] = to_x, to_y, np.sqrt(to_x * to_x + to_y * to_y)
    after = np.flatnonzero(follows)
    dx, dy = x[after] - x[after - 1], y[after] - y[after - 1]
    kind = np.where(extremum[at], EXTREMUM, CORNER).astype(np.uint8)
    kind[end] = CORNER
    kind[begin] = CORNER
    kind[offsets[parts.offsets[1:]] - 1] = END
    kind[offsets[parts.offsets[:-1]]] = START
    return offsets, theta, r, kind, np.sqrt(dx * dx + dy * dy), moved, across, along
