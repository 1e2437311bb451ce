"""What is known of each object once the runs are chosen: its numbers, vertices, faces, box and shape."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lidarcli.formalism.box import bounding_boxes
from lidarcli.formalism.corners import Corners
from lidarcli.formalism.detection import (
    LEGGED,
    NOISE,
    OBJECT,
    PRISMATIC,
    ROUND,
    WALL,
    Detection,
)
from lidarcli.formalism.difference import difference
from lidarcli.formalism.discontinuity import adaptive_threshold
from lidarcli.formalism.faces import Faces
from lidarcli.formalism.members import Members, gather
from lidarcli.formalism.objects import visibility
from lidarcli.formalism.outlines import Outlines, trace
from lidarcli.formalism.overhang import lengthen, overhang
from lidarcli.formalism.parts import assemble
from lidarcli.formalism.ragged import spans
from lidarcli.formalism.runs import Runs
from lidarcli.formalism.shape import classify
from lidarcli.kernels import compiled
from lidarcli.records import record
from lidarcli.sweeps import Bool, Float64, Int32, Int64, SweepBatch, UInt8


@record
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


@compiled
def tallied(
    members: Members,
    outlines: Outlines,
    faces: Faces,
    step: Float64,
    sweep_d_th: Float64,
    sigma: Float64,
    adaptive: bool,
) -> tuple[UInt8, UInt8, Int32, Float64, Int32, Int32, Float64, Float64, Float64, Int32, Int32]:
    """What follows for the columns of a `Detection` from the members, outlines and faces of its objects.

    Parameters
    ----------
    members, outlines, faces : of K objects
    step, sweep_d_th, sigma : (S,) |Δθ| [rad], the threshold and the noise [m]
    adaptive : whether the threshold grows with range

    Returns
    -------
    set, visibility, beams, d_th : (K,)
    vertex_offsets, face_offsets : (K + 1,)
    face_theta_i, face_theta_f, face_rms : (F,)
    objects, object_beams : (S,)
    """
    row, wall, size = members.row, members.is_wall, np.diff(members.offsets)
    sets = np.where(wall, np.uint8(NOISE), np.uint8(OBJECT))
    count = np.bincount(row[~wall], minlength=len(sigma)).astype(np.int32)
    object_beams = np.bincount(row[~wall], size[~wall], minlength=len(sigma)).astype(np.int32)
    d_th = (
        adaptive_threshold(sigma[row], step[row], members.r_i, members.s_i) if adaptive else sweep_d_th[row]
    )
    return (
        sets,
        visibility(members.start_edge, members.end_edge),
        size.astype(np.int32),
        d_th,
        outlines.offsets.astype(np.int32),
        outlines.face_offsets.astype(np.int32),
        outlines.theta[outlines.begin],
        outlines.theta[outlines.begin + 1],
        faces.rms[outlines.face],
        count,
        object_beams,
    )


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
    corners = segmentation.corners
    parts = assemble(runs, segmentation.is_object, segmentation.is_wall, segmentation.label)
    members = gather(runs, parts, segmentation.is_wall, segmentation.body)
    row, wall = members.row, members.is_wall
    if corners is not None:
        before, after, corners = overhang(runs, faces, corners, parts.run)
    outlines = trace(runs, faces, corners, segmentation.extremum, parts)
    if corners is not None:
        lengthen(outlines.length, faces.offsets, parts.run, before, after)
    shape, circles = classify(members, outlines, faces, sigma[row])
    # The vertices of a prism scatter less than its points.
    hull = (shape == PRISMATIC) & (np.diff(parts.offsets) == 1) & (corners is not None)
    box = bounding_boxes(members, outlines, hull, faces, shape == ROUND, circles)
    shape[members.several] = LEGGED
    shape[wall] = WALL
    (
        sets,
        visible,
        beams,
        d_th,
        vertex_offsets,
        face_offsets,
        face_theta_i,
        face_theta_f,
        face_rms,
        objects,
        object_beams,
    ) = tallied(members, outlines, faces, points.geometry.step, sweep_d_th, sigma, adaptive)
    result = Detection(
        row=row,
        object=members.number,
        set=sets,
        shape=shape,
        visibility=visible,
        beam_i=members.beam_i,
        beam_f=members.beam_f,
        beams=beams,
        theta_i=members.theta_i,
        theta_f=members.theta_f,
        r_i=members.r_i,
        r_f=members.r_f,
        s_i=members.s_i,
        s_f=members.s_f,
        d_th=d_th,
        theta_min=members.theta_min,
        r_min=members.r_min,
        x=members.x,
        y=members.y,
        width=members.width,
        box_x=box.x,
        box_y=box.y,
        box_length=box.length,
        box_width=box.width,
        box_yaw=box.yaw,
        vertex_offsets=vertex_offsets,
        vertex_theta=outlines.theta,
        vertex_r=outlines.r,
        vertex_kind=outlines.kind,
        face_offsets=face_offsets,
        face_theta_i=face_theta_i,
        face_theta_f=face_theta_f,
        face_length=outlines.length,
        face_rms=face_rms,
        d_mean=d_mean,
        sweep_d_th=sweep_d_th,
        noise=sigma,
        objects=objects,
        agents=np.zeros(rows, np.int32),
        object_beams=object_beams,
        agent_beams=np.zeros(rows, np.int32),
        noise_beams=batch.beams - object_beams,
    )
    if not per_beam:
        return result
    index, _, _ = spans(runs.first[parts.run], runs.size[parts.run])
    member = np.zeros(len(points.grid.range), np.int32)
    member[points.cell[index]] = np.repeat(np.where(wall, 0, members.number), beams)
    beam_object = points.grid.beams(member, batch.width, 0)
    return replace(
        result,
        beam_object=beam_object,
        beam_set=np.where(beam_object > 0, OBJECT, NOISE).astype(np.uint8),
        beam_s=difference(batch),
    )
