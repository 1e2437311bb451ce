"""Corners, faces, boxes and the frames of the real recordings, against answers in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy import boxes, real
from benchmarks.accuracy.cells import CELLS, cells_of, kind_of, simulate, with_legs_apart
from benchmarks.accuracy.objects import MISSED, Part, Tally, confusion, measure
from benchmarks.scenes.random import SENSORS
from lidarcli.formalism import SHAPES, sweep
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Scene


def test_drawn_boxes_show_two_faces() -> None:
    drawn = boxes.draw(30, 7)
    away = np.hypot(*np.moveaxis(drawn.corners, 2, 0))
    assert (away[:, 1] < away[:, [0, 2]].min(axis=1)).all(), "the nearest corner lies between the faces"
    assert (away[:, 1] >= 1).all()
    assert (away[:, 1] <= 5).all()
    bearing = np.unwrap(np.arctan2(drawn.corners[..., 1], drawn.corners[..., 0]), axis=1)
    assert (np.diff(bearing, axis=1) >= 5 * np.deg2rad(0.5) - 1e-12).all()
    sides = np.hypot(*np.moveaxis(np.diff(drawn.corners, axis=1), 2, 0))
    assert np.sort(sides, axis=1) == pytest.approx(np.sort(np.column_stack([drawn.length, drawn.width]), axis=1))
    assert drawn.corners[:, [0, 2]].mean(axis=1) == pytest.approx(np.column_stack([drawn.x, drawn.y]))


def test_the_middle_corner_of_a_box_without_noise_is_found() -> None:
    first = boxes.measure_boxes(5, 2, 3)[0]
    assert (first.sensor, first.noise, first.sweeps, first.pairs) == ("361", 0.0, 10, 5)
    assert first.found == first.corner_recall == 1.0
    assert first.turns == 0
    assert first.yaw_error < np.deg2rad(1)


def test_one_vertex_is_right_for_one_corner() -> None:
    corners = np.array([[[0.0, 0.0], [1.0, 0.0]]])
    vertices = boxes._Vertices(
        owner=np.zeros(4, np.int64),
        x=np.array([0.01, 0.03, 0.94, 5.0]),
        y=np.zeros(4),
        kind=np.full(4, boxes.CORNER),
        offsets=np.array([0, 4]),
    )
    recall, precision = boxes._corners_within(vertices, corners, np.ones(4, bool))
    assert (recall, precision) == (0.5, 0.25)


def test_distance_to_boxes() -> None:
    point = np.array([2.0, 1.0])
    centre = np.array([[0.0, 0.0], [0.0, 0.0], [2.0, 1.2], [0.0, 0.0]])
    size = np.array([[2.0, 1.0], [1.0, 2.0], [1.0, 1.0], [2.0, 1.0]])
    yaw = np.array([0.0, np.pi / 2, 0.3, np.pi / 2])
    assert real.to_boxes(point, centre, size, yaw) == pytest.approx([np.hypot(1, 0.5), np.hypot(1, 0.5), 0, 1.5])


def test_positions_in_a_moving_frame() -> None:
    origin = np.array([[1.0, 2.0, np.pi / 2], [0.0, 0.0, 0.0]])
    poses = np.array([[1.0, 5.0, 0.0], [3.0, -1.0, 2.0]])
    assert real.seen_from(origin, poses) == pytest.approx(np.array([[3.0, 0.0], [3.0, -1.0]]))


def test_centroids() -> None:
    batch = sweep([[1.0, 1.0, 2.0], [3.0, 3.0, 3.0]], angle_min=0.0, angle_increment=np.pi / 2)
    row, x, y = real.centroids(np.array([[4, 4, 0], [0, 0, 4]]), batch)
    assert row.tolist() == [0, 1]
    assert x == pytest.approx([0.5, -3.0])
    assert y == pytest.approx([0.5, 0.0], abs=1e-6)


def test_cells() -> None:
    assert len(set(CELLS)) == 27
    room = [cell for cell in CELLS if cell.kind == "room"]
    found = list(cells_of("room", [3, 4], "plain"))
    assert [cell for cell, _, _ in found] == room
    assert {len(batch) for _, batch, _ in found} == {2}
    assert all(truth.entity.shape == batch.ranges.shape for _, batch, truth in found)


def test_kinds_of_entities() -> None:
    assert kind_of(make.cylinder(0, 0, 0.06)) != kind_of(make.cylinder(0, 0, 0.07))
    scene = Scene("legs", SENSORS["361"], (make.person(2, 0), make.box(3, 3, 1, 1)))
    assert [entity.kind for entity in with_legs_apart(scene).entities] == ["leg", "leg", "box"]


def test_shapes_of_what_is_found() -> None:
    scene = Scene("box", SENSORS["720"], (make.box(2, 0, 0.6, 0.6, 0.6),))
    batch, truth = simulate([scene], [1])
    counts = confusion(batch, truth, 0.0)
    assert counts.sum() == 1
    assert counts[kind_of(make.box(0, 0, 1, 1)), SHAPES.index("prismatic")] == 1
    batch.status[:] = 1
    assert confusion(batch, truth, 0.0).sum() == 0, "no beam hits it"
    assert len(SHAPES) == MISSED


def test_parts_of_the_work_add_up() -> None:
    whole, sum_of_parts = measure(Part("plain", "room", (1, 2), False)), Tally()
    for seed in (1, 2):
        sum_of_parts.add(measure(Part("plain", "room", (seed,), False)))
    for key, score in whole.scores.items():
        other = sum_of_parts.scores[key]
        assert (score.detections, score.right) == (other.detections, other.right)
        assert (score.found == other.found).all()
    assert all((count == sum_of_parts.shapes[place]).all() for place, count in whole.shapes.items())
