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
    START,
    WALL,
    Detection,
)
from lidarcli.formalism.difference import difference
from lidarcli.formalism.discontinuity import adaptive_threshold
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.objects import visibility
from lidarcli.formalism.parts import Parts, assemble
from lidarcli.formalism.ragged import offsets_of, span_first, span_min, span_sum, spans
from lidarcli.formalism.runs import Runs
from lidarcli.formalism.shape import classify
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
    index, _, part_offsets = spans(runs.first[parts.run], runs.size[parts.run])
    offsets = part_offsets[parts.offsets]
    owner = np.repeat(np.arange(len(begin)), np.diff(offsets))
    x, y = points.x[index], points.y[index]
    face, _, face_part_offsets = spans(faces.offsets[parts.run], np.diff(faces.offsets)[parts.run])
    face_offsets = face_part_offsets[parts.offsets]
    ranges = points.range(index)
    r_min = span_min(ranges, offsets)
    nearest = span_first(ranges == np.repeat(r_min, np.diff(offsets)), offsets)
    nearest_part = np.searchsorted(part_offsets, nearest, side="right") - 1
    nearest = index[nearest]
    size = np.diff(offsets).astype(np.float64)
    width = np.hypot(points.x[last] - points.x[first], points.y[last] - points.y[first])
    shape, round_ones, circles = classify(x, y, offsets, faces, face, face_offsets, width, sigma[row])
    hull = _hulls(
        x, y, offsets, runs, segmentation, begin, (shape == PRISMATIC) & (np.diff(parts.offsets) == 1)
    )
    box = bounding_boxes(*hull, faces, face, face_offsets, round_ones, circles)
    shape[_of_several(parts, segmentation.body)] = LEGGED
    shape[wall] = WALL

    reverse = points.geometry.reverse[row]
    beam_first = points.geometry.beam(row, points.position(first, row))
    beam_last = points.geometry.beam(row, points.position(last, row))
    object_beams = np.bincount(row[~wall], size[~wall], minlength=rows).astype(np.int32)
    past = parts.theta_i - points.theta(runs.first[parts.run], runs.row[parts.run])
    vertex_part_offsets, vertex_theta, vertex_r, vertex_kind = _vertices(runs, segmentation, parts.run, past)
    vertex_offsets = vertex_part_offsets[parts.offsets]
    vertex_kind[vertex_offsets[1:] - 1] = END
    vertex_kind[vertex_offsets[:-1]] = START
    face_theta_i, face_theta_f, face_length = _between(vertex_theta, vertex_r, vertex_part_offsets)
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
        theta_min=points.theta(nearest, row) + past[nearest_part],
        r_min=r_min,
        x=span_sum(x, offsets) / size,
        y=span_sum(y, offsets) / size,
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
        face_theta_i=face_theta_i,
        face_theta_f=face_theta_f,
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
    member = np.zeros(len(points.grid.range), np.int32)
    member[points.cell[index]] = np.where(wall, 0, number)[owner]
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
    x: Float64,
    y: Float64,
    offsets: Int64,
    runs: Runs,
    segmentation: Segmentation,
    run: Int64,
    prism: Bool,
) -> tuple[Float64, Float64, Int64]:
    """What the box of each object has to hold: its points (T,), or of a prism the vertices, which scatter less.

    Takes the points of K objects with their offsets, their first runs and which of them are prisms.
    """
    corners = segmentation.corners
    if corners is None or not prism.any():
        return x, y, offsets
    begin, count = corners.offsets[run], np.diff(corners.offsets)[run]
    size = np.where(prism, count, np.diff(offsets))
    hull_offsets = offsets_of(size)
    hull_x, hull_y = np.empty(hull_offsets[-1]), np.empty(hull_offsets[-1])
    source, _, _ = spans(offsets[:-1][~prism], size[~prism])
    target, _, _ = spans(hull_offsets[:-1][~prism], size[~prism])
    hull_x[target], hull_y[target] = x[source], y[source]
    source, _, _ = spans(begin[prism], size[prism])
    target, _, _ = spans(hull_offsets[:-1][prism], size[prism])
    hull_x[target], hull_y[target] = corners.x[source], corners.y[source]
    return hull_x, hull_y, hull_offsets


def _vertices(
    runs: Runs, segmentation: Segmentation, chosen: Int64, past: Float64
) -> tuple[Int64, Float64, Float64, UInt8]:
    """Vertices of the chosen runs (Def. 6): first point, the points between faces, last point.

    Offsets, bearings, ranges and kinds; the ends of a part inside an object are corners of it. A run of a single point
    has one vertex. `past` (P,) is what a part's bearings grow by past the seam [rad].
    """
    faces, points = segmentation.faces, runs.points
    face, _, face_offsets = spans(faces.offsets[chosen], np.diff(faces.offsets)[chosen])
    sizes = np.diff(face_offsets) + 1
    offsets = offsets_of(sizes)
    at = np.empty(offsets[-1], np.int64)
    at[offsets[:-1]] = runs.first[chosen]
    follows = np.ones(len(at), bool)
    follows[offsets[:-1]] = False
    at[follows] = faces.last[face]
    owner = np.repeat(np.arange(len(chosen)), sizes)
    theta, r = points.theta(at, runs.row[chosen][owner]), points.range(at)
    if segmentation.corners is not None:
        _move(segmentation.corners, chosen, theta, r, offsets)
    kind = np.where(segmentation.extremum[at], EXTREMUM, CORNER).astype(np.uint8)
    kind[offsets[1:] - 1] = CORNER
    kind[offsets[:-1]] = CORNER
    return offsets, theta + past[owner], r, kind


def _move(corners: Corners, chosen: Int64, theta: Float64, r: Float64, offsets: Int64) -> None:
    """Put the vertices of the chosen runs where their corners are: bearings count from that of their points."""
    has = np.diff(corners.offsets)[chosen] > 0
    source, _, _ = spans(corners.offsets[chosen[has]], np.diff(corners.offsets)[chosen[has]])
    target, _, _ = spans(offsets[:-1][has], np.diff(offsets)[has])
    source, target = source[corners.moved[source]], target[corners.moved[source]]
    x, y = corners.x[source], corners.y[source]
    cos, sin = np.cos(theta[target]), np.sin(theta[target])
    theta[target] += np.arctan2(y * cos - x * sin, x * cos + y * sin)
    r[target] = np.hypot(x, y)


def _between(vertex_theta: Float64, vertex_r: Float64, offsets: Int64) -> tuple[Float64, Float64, Float64]:
    """The faces between consecutive vertices of each part: bearings of their ends [rad], distance of these [m]."""
    starts, ends = np.ones(len(vertex_theta), bool), np.ones(len(vertex_theta), bool)
    starts[offsets[1:] - 1] = False
    ends[offsets[:-1]] = False
    theta_i, theta_f, r_i, r_f = vertex_theta[starts], vertex_theta[ends], vertex_r[starts], vertex_r[ends]
    length = np.sqrt(np.maximum(r_i * r_i + r_f * r_f - 2.0 * r_i * r_f * np.cos(theta_f - theta_i), 0.0))
    return theta_i, theta_f, length
