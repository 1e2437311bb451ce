"""What is drawn of rows of the objects table."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

from lidarcli.display.palette import BLUE, SHAPE_COLOURS, VERMILION, on_dark
from lidarcli.overlays.markers import Kind, Markers
from lidarcli.overlays.objects import CLEAR, MIN_SIDE, PART, SOLID, PathPoses, PathRows, is_mirrored, markers_of, paths_of
from lidarcli.tabular.schemas import OBJECTS, TRAJECTORIES

NOWHERE = PathPoses(*(np.full(9, np.nan) for _ in range(3)))
PLAIN: dict[str, Any] = {
    "object": 1,
    "shape": "prismatic",
    "x": 2.0,
    "y": 1.0,
    "box_x": 2.1,
    "box_y": 1.1,
    "box_length": 0.6,
    "box_width": 0.4,
    "box_yaw": 0.5,
    "vertices": [{"theta": 0.3, "r": 2.0, "kind": "start"}, {"theta": 0.5, "r": 2.0, "kind": "end"}],
}


def rows(*objects: dict[str, Any]) -> pa.RecordBatch:
    """Rows of the objects table with these values, and otherwise those of `PLAIN`."""
    return pa.RecordBatch.from_pylist([PLAIN | each for each in objects], schema=OBJECTS)


def drawn(*objects: dict[str, Any], message: list[int] | None = None, poses: PathPoses = NOWHERE) -> list[Markers]:
    where = np.array(message if message is not None else [0] * len(objects), np.int64)
    return markers_of(rows(*objects), where, poses)


def of_kind(groups: list[Markers], kind: Kind) -> list[Markers]:
    return [group for group in groups if group.kind is kind]


def words(label: Markers) -> list[str]:
    assert label.text is not None
    return [text.decode() for text in label.text.tolist()]


def rgb(colour: str) -> list[float]:
    """The colour that takes the place of another on dark ground."""
    return [part / 255 for part in bytes.fromhex(on_dark(colour)[1:])]


def chosen(group: Markers) -> NDArray[np.float64]:
    """The colours that were chosen for markers; letters are half as far from white."""
    colour = group.colour[:, :3].astype(np.float64)
    return 2 * colour - 1 if group.kind is Kind.LABEL else colour


def test_a_plain_object_has_outline_body_and_label() -> None:
    groups = drawn({})
    assert [group.kind for group in groups] == [Kind.OUTLINE, Kind.CUBE, Kind.LABEL]
    outline, body, label = groups
    assert outline.points is not None
    expected = [[2 * np.cos(angle), 2 * np.sin(angle)] for angle in (0.3, 0.5, 0.3)]
    assert outline.points[0].tolist() == pytest.approx(np.array(expected))
    assert body.position[0, :2].tolist() == pytest.approx([2.1, 1.1])
    assert body.scale[0, :2].tolist() == pytest.approx([0.6, 0.4])
    assert body.yaw.tolist() == [0.5]
    assert words(label) == ["1 0.60 x 0.40 m"]
    assert label.position[0, 2] > body.scale[0, 2]
    assert [group.colour[0, 3] for group in groups] == pytest.approx([SOLID, CLEAR, SOLID])
    assert all(group.id.tolist() == [1] for group in groups)


def test_an_object_has_the_colour_of_its_shape() -> None:
    for shape, colour in SHAPE_COLOURS.items():
        groups = drawn({"shape": shape})
        for group in groups:
            assert chosen(group)[0].tolist() == pytest.approx(rgb(colour), abs=1e-6)
        assert bool(of_kind(groups, Kind.CYLINDER)) == (shape == "round")
        assert bool(of_kind(groups, Kind.CUBE)) != (shape == "round")


def test_a_name_of_the_catalogue_stands_before_the_size() -> None:
    (label,) = of_kind(drawn({"label": "Europalette €"}), Kind.LABEL)
    assert words(label) == ["1 Europalette € 0.60 x 0.40 m"]


@pytest.mark.parametrize("width", [None, 0.0, MIN_SIDE])
def test_the_label_tells_no_width_that_was_not_seen(width: float | None) -> None:
    (label,) = of_kind(drawn({"box_width": width}), Kind.LABEL)
    assert words(label) == ["1 0.60 m"]


@pytest.mark.parametrize(
    "vertices",
    [[], [{"theta": 0.3, "r": 2.0, "kind": "start"}], [{"theta": 0.3, "r": None, "kind": "start"}] * 3],
    ids=["none", "one", "unknown"],
)
def test_without_vertices_the_outline_is_that_of_the_box(vertices: list[dict[str, Any]]) -> None:
    # One with vertices beside it: the two must not be mixed up.
    groups = of_kind(drawn({"vertices": vertices}, {"object": 2}), Kind.OUTLINE)
    by_id = {int(number): group for group in groups for number in group.id}
    corners = by_id[1].points
    assert corners is not None
    assert corners.shape == (1, 5, 2)
    assert corners[0, 0].tolist() == corners[0, 4].tolist()
    ahead, left = np.array([np.cos(0.5), np.sin(0.5)]), np.array([-np.sin(0.5), np.cos(0.5)])
    away = corners[0] - [2.1, 1.1]
    assert np.abs(away @ ahead).tolist() == pytest.approx([0.3] * 5)
    assert np.abs(away @ left).tolist() == pytest.approx([0.2] * 5)
    assert len({tuple(np.round(corner, 9)) for corner in corners[0]}) == 4
    assert by_id[2].points is not None
    assert by_id[2].points.shape == (1, 3, 2)


def test_what_has_no_place_is_left_out() -> None:
    groups = drawn({"x": None, "box_x": None}, {"object": 2}, message=[0, 1])
    assert {(int(group.id[0]), int(group.message[0]), len(group.id)) for group in groups} == {(2, 1, 1)}


def test_a_track_has_the_colour_of_its_set_whatever_its_shape() -> None:
    groups = drawn(
        {"track": 9, "object": 1, "shape": "round", "set": "A"},
        {"track": 9, "object": 4, "shape": "irregular", "set": "A"},
        {"track": 10, "object": 5, "set": "O"},
        message=[0, 1, 1],
    )
    colours: dict[int, set[tuple[float, ...]]] = {}
    for group in groups:
        for number, colour in zip(group.id.tolist(), chosen(group).tolist(), strict=True):
            colours.setdefault(number, set()).add(tuple(round(part, 5) for part in colour))
    assert {number: len(found) for number, found in colours.items()} == {9: 1, 10: 1}
    for number, colour in ((9, VERMILION), (10, BLUE)):
        assert colours[number].pop() == pytest.approx(rgb(colour), abs=1e-5)


def test_no_two_markers_of_a_message_share_namespace_and_id() -> None:
    groups = drawn(
        {"track": 3, "object": 1},
        {"track": 3, "object": 2},
        {"track": None, "object": 3},
        {"track": 3, "object": 4},
        {"track": 3, "object": 1},
        message=[0, 0, 0, 0, 1],
    )
    (body,) = of_kind(groups, Kind.CUBE)
    assert body.id.tolist() == [3, 3 + PART, -3, 3 + 2 * PART, 3]
    labels = [
        (int(m), int(n)) for group in of_kind(groups, Kind.LABEL) for m, n in zip(group.message, group.id, strict=True)
    ]
    assert sorted(labels) == [(0, -3), (0, 3), (1, 3)]


def test_an_arrow_shows_where_a_track_goes_in_a_second() -> None:
    moving = {"track": 1, "moving": True, "vx": 0.3, "vy": 0.4}
    (arrow,) = of_kind(drawn(moving), Kind.ARROW)
    assert arrow.scale[0, 0] == pytest.approx(0.5)
    assert arrow.yaw[0] == pytest.approx(np.arctan2(0.4, 0.3))
    for still in ({"moving": False}, {"vx": None, "vy": None}, {"vx": 0.0, "vy": 0.01}, {"track": None}):
        assert not of_kind(drawn(moving | still), Kind.ARROW)


@pytest.mark.parametrize("hangs", [False, True])
def test_an_arrow_is_turned_into_the_frame_of_the_sensor(hangs: bool) -> None:
    yaw, side = 0.7, -1.0 if hangs else 1.0
    ahead, left = 2.1, side * 1.1
    world = {
        "world_x": 5 + np.cos(yaw) * ahead - np.sin(yaw) * left,
        "world_y": -3 + np.sin(yaw) * ahead + np.cos(yaw) * left,
    }
    poses = PathPoses(np.array([5.0]), np.array([-3.0]), np.array([yaw]))
    moving = {"track": 1, "moving": True, "vx": 0.3, "vy": 0.4} | world
    assert is_mirrored(rows(moving), np.array([0]), poses).tolist() == [hangs]
    (arrow,) = of_kind(drawn(moving, poses=poses), Kind.ARROW)
    turned = side * (np.arctan2(0.4, 0.3) - yaw)
    assert arrow.yaw[0] == pytest.approx(turned)
    assert arrow.scale[0, 0] == pytest.approx(0.5)


def walk(**more: Any) -> PathRows:
    """Track 3 goes 1 m/s along x from sweep 10 to 59 at 10 Hz, at y = 2 m; track 4 stands."""
    unsure = dict.fromkeys(("x_sd", "y_sd", "xy_cov", "vx_sd", "vy_sd"), 0.0)
    there = {"topic": "/scan", "frame": "sensor", "seen": "seen", "parts": 1, "vy": 0.0, "y": 2.0, **unsure, **more}
    rows = [
        {"track": track, "sweep": k, "t": k / 10, "x": speed * k / 10, "vx": speed} | there | other
        for k in range(10, 60)
        for track, speed, other in ((3, 1.0, {}), (4, 0.0, {}), (3, 5.0, {"topic": "/rear"}))
    ]
    return PathRows.of(pa.Table.from_pylist(rows, schema=TRAJECTORIES), "/scan")


def test_what_moves_has_a_path_of_the_last_seconds() -> None:
    found = paths_of(walk(), np.array([9, 10, 12, 50, 60]), NOWHERE, False)
    # One point is no line, and before and after there is none.
    assert [(one.kind, one.message.tolist(), one.id.tolist()) for one in found] == [
        (Kind.PATH, [2], [3]),
        (Kind.PATH, [3], [3]),
    ]
    short, long = found
    assert short.points is not None
    assert long.points is not None
    assert short.points[0] == pytest.approx(np.array([[1.0, 2.0], [1.1, 2.0], [1.2, 2.0]]))
    assert long.points[0, [0, -1], 0] == pytest.approx([2.0, 5.0])
    assert long.colour[0, :3].tolist() == pytest.approx(rgb(VERMILION))


def test_a_path_begins_where_it_was_hidden_last() -> None:
    walked = walk()
    walked.seen[(walked.track == 3) & (walked.sweep == 40)] = False
    (found,) = paths_of(walked, np.array([40, 50]), NOWHERE, False)
    assert found.message.tolist() == [1], "none while it is hidden"
    assert found.points is not None
    assert found.points[0, [0, -1], 0] == pytest.approx([4.1, 5.0])


def test_a_path_is_that_of_an_agent_from_where_it_began_to_move() -> None:
    """Track 3 stands in the first ten sweeps, as track 4 does in all of them, and moves in the next ten alone."""
    rows = [
        {"topic": "/scan", "track": track, "sweep": k, "t": k / 10, "x": 1.0, "y": 2.0, "vx": speed, "vy": 0.0}
        | {"frame": "sensor", "seen": "seen", "parts": 1}
        | dict.fromkeys(("x_sd", "y_sd", "xy_cov", "vx_sd", "vy_sd"), 0.0)
        for k in range(30)
        for track, speed in ((3, 1.0 if 10 <= k < 20 else 0.0), (4, 0.0), (5, 1.0 if k >= 25 else 0.0))
    ]
    table = pa.Table.from_pylist(rows, schema=TRAJECTORIES)
    found = paths_of(PathRows.of(table, "/scan"), np.array([9, 10, 29]), NOWHERE, False)
    colours = {
        (int(message), int(number)): colour.tolist()
        for group in found
        for message, number, colour in zip(group.message, group.id, group.colour[:, :3], strict=True)
    }
    expected = {(0, 3): BLUE, (1, 3): VERMILION, (2, 3): VERMILION}
    expected |= {(0, 5): BLUE, (1, 5): BLUE, (2, 5): VERMILION}
    assert colours.keys() == expected.keys()
    for key, colour in expected.items():
        assert colours[key] == pytest.approx(rgb(colour))


@pytest.mark.parametrize("hangs", [False, True])
def test_a_path_in_the_world_is_drawn_as_the_sensor_sees_it(hangs: bool) -> None:
    poses = PathPoses(np.array([1.0]), np.array([1.0]), np.array([np.pi / 2]))
    (found,) = paths_of(walk(frame="world"), np.array([11]), poses, hangs)
    assert found.points is not None
    # The sensor looks along y: what lies ahead of it in x is on its right.
    left = 1.0 if hangs else -1.0
    assert found.points[0] == pytest.approx(np.array([[1.0, 0.0], [1.0, 0.1 * left]]))
    nowhere = PathPoses(*(np.full(1, np.nan) for _ in range(3)))
    assert paths_of(walk(frame="world"), np.array([11]), nowhere, hangs) == []
