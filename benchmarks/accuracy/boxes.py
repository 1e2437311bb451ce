"""Corners, faces and boxes of simulated boxes that show two faces, and the circle of a simulated cylinder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy.cells import Truth, simulate
from benchmarks.accuracy.methods import labels_of
from benchmarks.accuracy.scoring import assign
from benchmarks.scenes.random import SENSORS, sensor_with
from lidarcli.formalism import SHAPES, VERTEX_KINDS, Detection, detect
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Entity, Scene, SceneSensor
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64, SweepBatch

NEAR = 0.05
"""A vertex is right within this distance of a corner [m]."""
NOISES = (0.0, 0.01, 0.03)
BOX_SENSORS = ("361", "720", "1081")
SIZES = (0.3, 1.2)
"""Sides of the boxes [m]."""
DISTANCES = (1.0, 5.0)
"""From the sensor to the nearest corner [m]."""
BEARINGS = np.deg2rad(110.0)
FACE_BEAMS = 5
"""Both faces must be hit by so many beams of each sensor."""
ROOM = 7.0
"""Half the side of the empty room around [m]."""
CYLINDER = (2.0, 0.25)
"""Distance of the axis and radius [m]."""
HEADING = 1.0
"""Of the sensor before the cylinder [rad]."""
CORNER = VERTEX_KINDS.index("corner")
ROUND = SHAPES.index("round")


@dataclass(frozen=True, slots=True)
class Boxes:
    """N boxes in the sensor frame."""

    x: Float64
    y: Float64
    length: Float64
    width: Float64
    yaw: Float64
    corners: Float64
    """(N, 3, 2) the ends of the two visible faces, counter-clockwise seen from the sensor; the nearest one between."""


@dataclass(frozen=True, slots=True)
class BoxResult:
    """Figures of one sensor with one noise."""

    sensor: str
    noise: float
    sweeps: int
    found: float
    """Share of the boxes that one detection holds."""
    corner_recall: float
    """Of the corners between the two faces."""
    corner_precision: float
    """Of the vertices of kind `corner`."""
    vertex_recall: float
    """Of all three visible corners, by vertices of any kind."""
    vertex_precision: float
    face_error: float
    """Median error of the length of a visible face [m]."""
    length_error: float
    width_error: float
    """Median errors of the oriented bounding box [m]."""
    centre_error: float
    yaw_error: float
    """Median error modulo 90° [rad]."""
    turns: int
    """Pairs of consecutive sweeps of a box between which `box_yaw` turns by about 90°."""
    pairs: int


@dataclass(frozen=True, slots=True)
class CylinderResult:
    """Figures of a cylinder; errors are medians over the sweeps [m]."""

    sensor: str
    noise: float
    round_share: float
    centre_error: float
    radius_error: float


def draw(count: int, seed: int) -> Boxes:
    """Random boxes that show two faces, each hit by enough beams."""
    rng = np.random.Generator(np.random.PCG64(seed))
    kept: list[tuple[Float64, Float64]] = []
    steps = max(SENSORS[name].angle_increment for name in BOX_SENSORS)
    while len(kept) < count:
        length, width = rng.uniform(*SIZES, 2)
        away, bearing, yaw = rng.uniform(*DISTANCES), rng.uniform(-BEARINGS, BEARINGS), rng.uniform(0, TURN)
        cos, sin = np.cos(yaw), np.sin(yaw)
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [length / 2, width / 2]
        corners = corners @ np.array([[cos, sin], [-sin, cos]])
        near = away * np.array([np.cos(bearing), np.sin(bearing)])
        # The first corner is put where the sensor looks; only where it is the nearest do two faces show.
        centre = near - corners[0]
        corners = corners + centre
        ends = corners[[1, 0, 3]]
        if np.hypot(*corners.T).argmin() != 0 or np.hypot(*centre) < away:
            continue
        angles = np.unwrap(np.arctan2(ends[:, 1], ends[:, 0]))
        spans = np.diff(angles)
        if (spans < FACE_BEAMS * steps).any() or np.abs(angles).max() > 0.74 * np.pi:
            continue
        kept.append((np.array([*centre, length, width, yaw]), ends))
    numbers = np.array([numbers for numbers, _ in kept])
    x, y, length, width, yaw = numbers.T
    return Boxes(x, y, length, width, yaw, np.array([ends for _, ends in kept]))


def _room() -> list[Entity]:
    corners = ROOM * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    return [make.wall(corners)]


def _scenes(boxes: Boxes, sensor: SceneSensor) -> list[Scene]:
    path = Course(np.zeros((1, 2)))
    scenes = []
    for x, y, length, width, yaw in zip(boxes.x, boxes.y, boxes.length, boxes.width, boxes.yaw, strict=True):
        scenes.append(Scene("box", sensor, (make.box(x, y, length, width, yaw), *_room()), path))
    return scenes


def measure_boxes(count: int, sweeps: int, seed: int) -> list[BoxResult]:
    """All sensors and noises, without lost beams."""
    boxes = draw(count, seed)
    results = []
    for name in BOX_SENSORS:
        for noise in NOISES:
            scenes = _scenes(boxes, sensor_with(SENSORS[name], noise, 0.0))
            batch, truth = simulate(scenes, [seed + number for number in range(count)], sweeps)
            results.append(judge_boxes(name, noise, boxes, batch, truth, sweeps))
    return results


def judge_boxes(name: str, noise: float, boxes: Boxes, batch: SweepBatch, truth: Truth, sweeps: int) -> BoxResult:
    """Compare the detections of each box, entity 0 of its scene, with the box."""
    detection = detect(batch, per_beam=True)
    found = of_first_entity(detection, batch, truth)
    here = np.flatnonzero(found >= 0)
    k = found[here]
    box = here // sweeps
    corners = boxes.corners[box]
    vertices = _vertices(detection, k)
    recall, precision = _corners_within(vertices, corners[:, 1:2], vertices.kind == CORNER)
    all_recall, all_precision = _corners_within(vertices, corners, np.ones(len(vertices.kind), bool))
    share = len(here) / len(found)
    long, short = np.maximum(boxes.length, boxes.width)[box], np.minimum(boxes.length, boxes.width)[box]
    yaw_off = (detection.box_yaw[k] - boxes.yaw[box] + np.pi / 4) % (np.pi / 2) - np.pi / 4
    turned, pairs = _turns(detection, found, sweeps)
    return BoxResult(
        sensor=name,
        noise=noise,
        sweeps=len(found),
        found=share,
        corner_recall=recall * share,
        corner_precision=precision,
        vertex_recall=all_recall * share,
        vertex_precision=all_precision,
        face_error=float(np.median(_face_errors(detection, k, vertices, corners))),
        length_error=float(np.median(np.abs(detection.box_length[k] - long))),
        width_error=float(np.median(np.abs(detection.box_width[k] - short))),
        centre_error=float(np.median(np.hypot(detection.box_x[k] - boxes.x[box], detection.box_y[k] - boxes.y[box]))),
        yaw_error=float(np.median(np.abs(yaw_off))),
        turns=turned,
        pairs=pairs,
    )


def of_first_entity(detection: Detection, batch: SweepBatch, truth: Truth) -> Int64:
    """(S,) index of the detection that holds entity 0 of each sweep, -1 where there is none."""
    result = assign(labels_of(detection), truth, batch)
    most = truth.kind.shape[1]
    mine = result.holds & (result.entity % most == 0)
    number = np.full((len(batch), int(detection.object.max(initial=0)) + 1), -1)
    number[detection.row, detection.object] = np.arange(len(detection))
    found = np.full(len(batch), -1)
    found[result.row[mine]] = number[result.row[mine], result.label[mine]]
    return found


@dataclass(frozen=True, slots=True)
class _Vertices:
    """The vertices of D chosen detections, flat."""

    owner: Int64
    """(V,) 0 … D - 1."""
    x: Float64
    y: Float64
    kind: Int64
    offsets: Int64
    """(D + 1,)"""


def _vertices(detection: Detection, k: Int64) -> _Vertices:
    begin, end = detection.vertex_offsets[k].astype(np.int64), detection.vertex_offsets[k + 1]
    size = end - begin
    offsets = np.concatenate([[0], np.cumsum(size)])
    owner = np.repeat(np.arange(len(k)), size)
    index = begin[owner] + np.arange(len(owner)) - offsets[owner]
    theta, r = detection.vertex_theta[index], detection.vertex_r[index]
    kind = detection.vertex_kind[index].astype(np.int64)
    return _Vertices(owner, r * np.cos(theta), r * np.sin(theta), kind, offsets)


def _corners_within(vertices: _Vertices, corners: Float64, chosen: Bool) -> tuple[float, float]:
    """Share of the (D, C, 2) corners with a vertex near, and of the chosen vertices that are it: one for each."""
    owner = vertices.owner[chosen]
    x, y = vertices.x[chosen, None], vertices.y[chosen, None]
    away = np.hypot(x - corners[owner, :, 0], y - corners[owner, :, 1])
    count = corners.shape[1]
    nearest = away.argmin(axis=1)
    near = away[np.arange(len(owner)), nearest] <= NEAR
    pairs = len(np.unique(owner[near] * count + nearest[near]))
    return pairs / max(len(corners) * count, 1), pairs / len(owner) if len(owner) else 1.0


def _face_errors(detection: Detection, k: Int64, vertices: _Vertices, corners: Float64) -> Float64:
    """(D, 2) error of the reported face whose middle is nearest to the middle of each true one [m]."""
    first = np.flatnonzero(vertices.owner[:-1] == vertices.owner[1:])
    owner = vertices.owner[first]
    middle = np.column_stack([vertices.x[first] + vertices.x[first + 1], vertices.y[first] + vertices.y[first + 1]])
    length = detection.face_length[detection.face_offsets[k][owner] + first - vertices.offsets[owner]]
    true = np.hypot(*np.moveaxis(np.diff(corners, axis=1), 2, 0))
    errors: Float64 = true.copy()
    for side in range(2):
        target = corners[owner, side] + corners[owner, side + 1]
        order = np.lexsort((-np.hypot(*(middle - target).T), owner))
        # Of each detection's faces the nearest comes last and stays.
        errors[owner[order], side] = np.abs(length[order] - true[owner[order], side])
    return errors


def _turns(detection: Detection, found: Int64, sweeps: int) -> tuple[int, int]:
    """How often the box turns by about 90° from a sweep to the next, of how many pairs of sweeps."""
    table = found.reshape(-1, sweeps)
    both = (table[:, :-1] >= 0) & (table[:, 1:] >= 0)
    yaw = detection.box_yaw[table]
    change = np.diff(yaw, axis=1)[both]
    turned = np.abs(np.sin(change)) > np.sin(np.pi / 4)
    return int(turned.sum()), int(both.sum())


def measure_cylinder(sweeps: int, seed: int) -> list[CylinderResult]:
    """The circle of a cylinder in front of the sensor: a round object's box is the square around it."""
    away, radius = CYLINDER
    thing = make.cylinder(away, 0.0, radius)
    results = []
    for name, sensor in SENSORS.items():
        for noise in NOISES:
            # A heading that puts no beam on the axis by design.
            path = Course(np.zeros((1, 2)), yaw=HEADING)
            scene = Scene("cylinder", sensor_with(sensor, noise, 0.0), (thing, *_room()), path)
            batch, truth = simulate([scene], [seed], sweeps)
            detection = detect(batch, per_beam=True)
            k = of_first_entity(detection, batch, truth)
            k = k[k >= 0]
            centre = away * np.array([np.cos(HEADING), -np.sin(HEADING)])
            off = np.hypot(detection.box_x[k] - centre[0], detection.box_y[k] - centre[1])
            results.append(
                CylinderResult(
                    sensor=name,
                    noise=noise,
                    round_share=int((detection.shape[k] == ROUND).sum()) / sweeps,
                    centre_error=float(np.median(off)),
                    radius_error=float(np.median(np.abs(detection.box_length[k] / 2 - radius))),
                )
            )
    return results
