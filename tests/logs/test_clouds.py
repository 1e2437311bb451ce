"""Point clouds as sweeps: every layout of points reads the same, and what cannot be a cloud is refused alone."""

from __future__ import annotations

import base64
import json
from collections import Counter
from typing import Any

import numpy as np
import pytest

from lidarcli.logs import clouds
from lidarcli.logs.base import Message, OpenOptions, ReadReport, Slice
from lidarcli.logs.clouds import Bins, Levelled, Slicer, slice_cloud
from lidarcli.ros import cursor
from lidarcli.ros.foxglove import CLOUD, classes
from lidarcli.sweeps.types import TURN
from tests.logs.cloud_messages import XYZ, message, point_bytes
from tests.logs.cloud_messages import pointcloud2 as make
from tests.pose.pose_messages import Pose

NAN = float("nan")
POINTS = np.array(
    [
        [[2.0, 0.0, 0.1], [0.0, 3.0, -0.2], [-1.5, 0.0, 0.0], [0.0, -4.0, 0.3]],
        [[1.0, 0.0, 2.0], [0.0, 3.5, 0.0], [NAN, NAN, NAN], [0.0, -3.0, -0.9]],
    ]
)
"""Two rows of points; from -0.5 to 0.5 m the nearest are 2 m ahead, 3 m to the left, 1.5 m behind, 4 m to the right."""
NEAREST = [1.5, 4.0, 2.0, 3.0]
"""By four bins that begin behind."""
PART = Slice(-0.5, 0.5, 4)
MIXED = (("x", "f8", 5), ("rgb", "u4", 1), ("z", "f4", 21), ("y", "f8", 13))
"""Fields of different types in no order, at odd places."""


def decode(data: bytes, encoding: str) -> clouds.Cloud:
    return clouds.decode(Message("/points", "", encoding, 0, data))


def sweep(data: bytes, encoding: str = "cdr", part: Slice = PART, **told: Any) -> list[float]:
    """The ranges of the sweep of one PointCloud2, as it lies in the sensor's frame."""
    bins = Bins.of(OpenOptions(**told), part.bins)
    ranges: list[float] = slice_cloud(decode(data, encoding), part, bins, np.eye(3), np.zeros(3)).ranges.tolist()
    return ranges


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
@pytest.mark.parametrize(
    "layout",
    [
        {},
        {"columns": tuple((name, "f8", 8 * at) for at, (name, *_) in enumerate(XYZ)), "step": 24},
        {"big": True},
        {"step": 48},
        {"padding": 7},
        {"row_step": 0},
        {"row_step": 1 << 30},
        {"is_dense": True},
    ],
    ids=lambda layout: "-".join(layout) or "plain",
)
def test_every_layout_reads_the_same(layout: dict[str, Any], encoding: str) -> None:
    assert sweep(make(POINTS, encoding=encoding, **layout), encoding) == NEAREST


def test_fields_of_different_types_at_odd_places() -> None:
    points = np.stack([POINTS[..., 0], np.zeros(POINTS.shape[:2]), POINTS[..., 2], POINTS[..., 1]], axis=-1)
    assert sweep(make(points, MIXED, step=29)) == NEAREST


def test_a_message_of_the_other_byte_order() -> None:
    assert sweep(make(POINTS, big_message=True)) == NEAREST


def test_an_unorganised_cloud() -> None:
    assert sweep(make(POINTS.reshape(-1, 3))) == NEAREST


def test_a_cloud_without_heights_lies_in_the_plane() -> None:
    assert sweep(make(POINTS[:1, :, :2], XYZ[:2])) == NEAREST
    assert sweep(make(POINTS[:1, :, :2], XYZ[:2]), part=Slice(0.1, 1.0, 4)) == [np.inf] * 4


def test_a_cloud_without_points_is_a_sweep_without_returns() -> None:
    assert sweep(make(np.zeros((0, 3)))) == [np.inf] * 4
    assert sweep(make(np.zeros((3, 0, 3)))) == [np.inf] * 4


def test_heights_are_inclusive_to_the_digits_of_the_log() -> None:
    cloud = make([[1.0, 0.0, 0.1], [-1.0, 0.0, 0.3]])
    assert sweep(cloud, part=Slice(0.1, 0.3, 4)) == [1.0, np.inf, 1.0, np.inf]
    assert sweep(cloud, part=Slice(0.101, 0.299, 4)) == [np.inf] * 4


@pytest.mark.parametrize(("name", "kind"), [("intensity", "f4"), ("intensity", "u1"), ("reflectivity", "u2"), ("i", "f4")])
def test_the_intensity_is_that_of_the_nearest_point(name: str, kind: str) -> None:
    points = np.concatenate([POINTS, np.arange(10.0, 18.0).reshape(2, 4, 1)], axis=-1)
    data = make(points, (*XYZ, (name, kind, 12)))
    part, bins = PART, Bins.of(OpenOptions(), 5)
    seen = slice_cloud(decode(data, "cdr"), part, bins, np.eye(3), np.zeros(3))
    if name == "i":
        assert seen.intensities is None
        return
    assert seen.intensities is not None
    of_range = dict(zip(seen.ranges.tolist(), seen.intensities.tolist(), strict=True))
    assert {at: of_range[at] for at in (1.5, 2.0, 3.0, 4.0)} == {1.5: 12.0, 2.0: 10.0, 3.0: 11.0, 4.0: 13.0}
    assert np.isnan(of_range[np.inf])


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_every_bearing_of_a_full_turn_has_its_bin(kind: type) -> None:
    count = 1023
    bins = Bins.of(OpenOptions(), count)
    bearing = (bins.first + bins.step * np.arange(count)).astype(kind)
    which, point = bins.nearest(np.cos(bearing), np.sin(bearing), 0.1, 9.0)
    assert which.tolist() == point.tolist() == list(range(count))


def test_a_partial_view_and_one_that_runs_backwards() -> None:
    bearing = np.array([-3.0, -1.0, 0.0, 1.0, 1.6])
    x, y = np.cos(bearing), np.sin(bearing)
    view = Bins.of(OpenOptions(fov=2.0), 3)
    assert (view.first, view.step) == (-1.0, 1.0)
    which, point = view.nearest(x, y, 0.1, 9.0)
    assert (which.tolist(), point.tolist()) == ([0, 1, 2], [1, 2, 3])
    back = Bins.of(OpenOptions(angle_min=1.0, angle_increment=-1.0), 3)
    which, point = back.nearest(x, y, 0.1, 9.0)
    assert (which.tolist(), point.tolist()) == ([0, 1, 2], [3, 2, 1])


def test_a_step_of_next_to_nothing_has_no_bin_for_what_is_beside_it() -> None:
    bins = Bins(0.0, 1e-300, 5)
    bearing = np.array([-1.0, 1.0, 3.0])
    with np.errstate(over="ignore"):
        which, point = bins.nearest(np.cos(bearing), np.sin(bearing), 0.1, 9.0)
    assert (which.tolist(), point.tolist()) == ([], [])


def test_a_whole_sensor_agrees_with_a_look_at_every_point() -> None:
    random = np.random.default_rng(5)
    points = random.uniform(-10, 10, (16, 200, 3)) * [1, 1, 0.1]
    points[random.uniform(size=(16, 200)) < 0.1] = NAN
    part, bins = Slice(-0.3, 0.6, 90, (1.0, 9.0)), Bins.of(OpenOptions(), 90)
    expected = np.full(90, np.inf)
    for x, y, z in points.astype(np.float32).astype(float).reshape(-1, 3):
        distance = np.hypot(x, y)
        if -0.3 <= z <= 0.6 and 1.0 <= distance <= 9.0:
            index = round((np.arctan2(y, x) + np.pi) / (TURN / 90)) % 90
            expected[index] = min(expected[index], distance)
    found = slice_cloud(decode(make(points), "cdr"), part, bins, np.eye(3), np.zeros(3))
    np.testing.assert_allclose(found.ranges, expected, rtol=2e-7)


def foxglove_cloud(points: Any = POINTS, pose: Pose | None = None, **changed: Any) -> dict[str, Any]:
    """A `foxglove.PointCloud` as plain values."""
    kinds = ("x", "y", "z")
    told: dict[str, Any] = {
        "timestamp": {"sec": 1_700_000_000, "nsec": 5},
        "frame_id": "lidar",
        "point_stride": 16,
        "fields": [{"name": name, "offset": 4 * at, "type": 7} for at, name in enumerate(kinds)],
        "data": point_bytes(points),
    }
    if pose is not None:
        told["pose"] = {
            "position": dict(zip("xyz", pose[:3], strict=True)),
            "orientation": dict(zip("xyzw", pose[3:], strict=True)),
        }
    return told | changed


def packed(told: dict[str, Any], encoding: str) -> bytes:
    """The message of plain values."""
    if encoding == "json":
        return json.dumps(told | {"data": base64.b64encode(told["data"]).decode()}).encode()
    stamp = told.pop("timestamp")
    filled = classes()[CLOUD](**told)
    filled.timestamp.seconds, filled.timestamp.nanos = stamp["sec"], stamp["nsec"]
    data: bytes = filled.SerializeToString()
    return data


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_foxglove_clouds(encoding: str) -> None:
    data = packed(foxglove_cloud(), encoding)
    cloud = decode(data, encoding)
    assert (cloud.frame_id, cloud.stamp_ns, len(cloud.layout)) == ("lidar", 1_700_000_000_000_000_005, 8)
    assert sweep(data, encoding) == NEAREST


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_the_pose_of_a_foxglove_cloud_moves_its_points(encoding: str) -> None:
    # A quarter of a turn to the left, half a metre up: what is ahead comes to the left, what was too low is in the slice.
    half = float(np.sqrt(0.5))
    data = packed(foxglove_cloud([[[1.0, 0.0, -0.9], [2.0, 0.0, 0.1]]], (0.0, 0.0, 0.5, 0.0, 0.0, half, half)), encoding)
    assert sweep(data, encoding) == pytest.approx([np.inf, np.inf, np.inf, 1.0])
    turned = packed(foxglove_cloud([[[1.0, 0.0, 0.0]]], (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)), encoding)
    assert sweep(turned, encoding) == [np.inf, np.inf, 2.0, np.inf]


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_a_quaternion_of_any_length_is_a_turn(encoding: str) -> None:
    assert sweep(packed(foxglove_cloud(POINTS, (0, 0, 0, 0, 0, 0, 1e200)), encoding), encoding) == NEAREST
    beyond = packed(foxglove_cloud(POINTS, (1e308, 1e308, 0, 0, 0, 0.6, 0.8)), encoding)
    assert sweep(beyond, encoding) == [np.inf] * 4


@pytest.mark.parametrize(
    ("data", "encoding", "cause"),
    [
        (make(POINTS)[:2], "cdr", cursor.ENCAPSULATION),
        (make(POINTS)[:40], "cdr", cursor.SHORT),
        (make(POINTS)[:-30], "cdr", cursor.SHORT),
        (make(POINTS, width=9), "cdr", clouds.TOO_FEW),
        (make(POINTS, width=(1 << 32) - 1, height=(1 << 32) - 1), "cdr", clouds.TOO_FEW),
        (make(POINTS, point_step=8), "cdr", clouds.OUTSIDE),
        (make(POINTS, point_step=0), "cdr", clouds.OUTSIDE),
        (make(POINTS, (("x", "f4", 0), ("y", "f4", 0), ("z", "f4", 0)), step=4), "cdr", clouds.OUTSIDE),
        (make(POINTS, (("x", "f4", 0), ("a", "f4", 4), ("z", "f4", 8))), "cdr", clouds.NO_COORDINATES),
        (make(POINTS, (("x", "i2", 0), ("y", "i2", 4), ("z", "i2", 8))), "cdr", clouds.NO_COORDINATES),
        (make(POINTS, frame="f" * 5000), "cdr", cursor.NAME_LONG),
        (b"{", "json", clouds.NOT_JSON),
        (b"[1]", "json", clouds.NOT_CLOUD),
        (b'{"point_stride": 4, "fields": 7}', "json", clouds.NOT_CLOUD),
        (packed(foxglove_cloud(), "json").replace(b'"data": "', b'"data": "*'), "json", clouds.NOT_CLOUD),
        (packed(foxglove_cloud(point_stride=0), "json"), "json", clouds.OUTSIDE),
        (packed(foxglove_cloud(fields=[]), "protobuf"), "protobuf", clouds.NO_COORDINATES),
        (packed(foxglove_cloud(timestamp={"sec": 1 << 62, "nsec": 0}), "json"), "json", clouds.STAMP),
        (packed(foxglove_cloud(pose=(NAN, 0, 0, 0, 0, 0, 1)), "protobuf"), "protobuf", clouds.NOT_FINITE),
        (packed(foxglove_cloud(frame_id="f" * 5000), "json"), "json", cursor.NAME_LONG),
        (b"\xff\xff", "protobuf", clouds.NOT_PROTOBUF),
    ],
)
def test_what_is_no_cloud_is_refused(data: bytes, encoding: str, cause: str) -> None:
    with pytest.raises(clouds.BadCloudError) as refused:
        decode(data, encoding)
    assert str(refused.value) == cause


@pytest.mark.parametrize("encoding", ["cdr", "ros1", "json", "protobuf"])
def test_a_cut_message_is_refused_wherever_it_is_cut(encoding: str) -> None:
    is_ros = encoding in ("cdr", "ros1")
    whole = make(POINTS, encoding=encoding) if is_ros else packed(foxglove_cloud(), encoding)
    # The last byte of a PointCloud2 says whether it is dense, which does not matter; protobuf may end behind any field.
    ends = range(len(whole) - 1) if encoding != "protobuf" else [len(whole) // 2, len(whole) - 1]
    for end in ends:
        with pytest.raises(clouds.BadCloudError):
            decode(whole[:end], encoding)


class Flat:
    """Nothing leans."""

    def of(self, frame_id: str, stamp_ns: Any) -> None:
        return None

    def words(self, frame_id: str) -> str:
        return f"above {frame_id}"


def slicer(report: ReadReport, part: Slice = PART) -> Slicer:
    """What makes sweeps of the clouds of /points."""
    return Slicer("/points", part, Bins.of(OpenOptions(), part.bins), Flat(), report)


def test_clouds_become_blocks_of_sweeps_and_bad_ones_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clouds, "ROWS", 4)
    report = ReadReport()
    made = slicer(report, Slice(-0.5, 0.5, 4, (0.5, 30.0)))
    good = [make(POINTS, frame=frame, stamp_ns=at) for at, frame in enumerate("aabaa", 1)]
    messages = [message(data) for data in (*good[:2], b"", *good[2:], make(POINTS, point_step=0))]
    messages.insert(4, message(b"", "avro"))
    blocks = [block for each in messages for block in made.take(each)] + list(made.flush())
    assert [(block.frame_ids, block.stamp_ns.tolist()) for block in blocks] == [
        (("a",), [1, 2]),
        (("b",), [3]),
        (("a",), [4]),
        (("a",), [5]),
    ]
    assert {tuple(row) for block in blocks for row in block.ranges.tolist()} == {tuple(NEAREST)}
    first = blocks[0]
    assert (first.topic, first.beams.tolist(), first.angle_min.tolist()) == ("/points", [4, 4], [-np.pi] * 2)
    assert (first.range_min.tolist(), first.range_max.tolist()) == ([0.5, 0.5], [30.0, 30.0])
    assert first.record_ns.tolist() == [message(b"").record_ns] * 2
    assert report.refused == Counter(
        {
            ("/points", cursor.ENCAPSULATION): 1,
            ("/points", clouds.OUTSIDE): 1,
            ("/points", "the encoding 'avro' is not read"): 1,
        }
    )
    assert made.notes()[:2] == [
        "/points: sweeps of the points from -0.5 to 0.5 m above a",
        "/points: sweeps of the points from -0.5 to 0.5 m above b",
    ]


def test_clouds_that_nobody_knows_the_place_of_are_left_out() -> None:
    class Late(Flat):
        """From stamp 3 on a metre higher."""

        def of(self, frame_id: str, stamp_ns: Any) -> Any:
            known = np.where(stamp_ns < 3, np.nan, 1.0)[:, None, None]
            return Levelled("base_link", np.eye(3) * known, np.array([[0.0, 0.0, 1.0]] * len(stamp_ns)))

    made = Slicer("/points", Slice(0.5, 1.5, 4), Bins.of(OpenOptions(), 4), Late(), ReadReport())
    for at in (1, 2, 3):
        assert list(made.take(message(make(POINTS, stamp_ns=at)))) == []
    (block,) = made.flush()
    assert (block.stamp_ns.tolist(), block.ranges.tolist()) == ([3], [NEAREST])
    assert "/points: 2 clouds left out: no transform tells where the robot was then" in made.notes()
    made.take(message(make(POINTS, stamp_ns=1)))
    assert list(made.flush()) == []


def test_zeros_are_no_point_wherever_the_sensor_is() -> None:
    points = [[[0.0, 0.0, 0.0], [0.0, 3.0, 0.0], [-9.0, 0.0, 0.0]]]
    ahead = packed(foxglove_cloud(points, (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)), "protobuf")
    assert sweep(ahead, "protobuf") == pytest.approx([8.0, np.inf, np.inf, np.sqrt(10.0)])
