"""Pose messages decoded by column, against the bytes that rosbags and the simulator write."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest

from lidarcli.pose import messages
from lidarcli.pose.messages import PoseRows
from lidarcli.ros import cursor
from lidarcli.simulation.generate import SimulatedPoses
from lidarcli.simulation.scene import Odometry
from tests.pose.pose_messages import ODOMETRY, OLD_TF, POSE, TF, WITH_COVARIANCE, Maker, numbers
from tests.text_logs.foxglove import JSON, PROTOBUF

MAKERS = {"cdr": Maker("cdr"), "cdr, big endian": Maker("cdr", big_endian=True), "ros1": Maker("ros1")}
POSES = [(1.0, 2.0, 0.3), (-4.0, 5.5, -3.0), (0.0, 0.0, 0.0), (1.0, -1.0, 0.5, 0.5, 0.5, 0.5, 0.5)]
FRAMES = ["odom", "/odom", "a", "robot_0/odom", "ab", "abc", "abcd", "abcde", ""]


def decoded(kind: str, encoding: str, data: Sequence[bytes]) -> list[PoseRows]:
    refused: Counter[str] = Counter()
    rows = list(messages.decode_ros(kind, encoding, data, refused))
    assert not refused
    return rows


def flattened(rows: Sequence[PoseRows]) -> list[tuple[int, str, str, int, list[float]]]:
    """(message, parent, child, stamp, numbers) in the order of the tracks."""
    return sorted(
        (int(row), part.parent, part.child, int(stamp), values.tolist())
        for part in rows
        for row, stamp, values in zip(part.row, part.stamp_ns, part.numbers, strict=True)
    )


@pytest.mark.parametrize("maker", MAKERS.values(), ids=MAKERS)
@pytest.mark.parametrize("kind", [ODOMETRY, POSE, WITH_COVARIANCE, TF, OLD_TF])
def test_every_type_in_every_serialisation(kind: str, maker: Maker) -> None:
    data, expected = [], []
    for index in range(60):
        stamp = 1_700_000_000_123_456_789 + index * 20_000_000
        parent, child = FRAMES[index % len(FRAMES)], FRAMES[(index // 2) % len(FRAMES)]
        pose = POSES[index % len(POSES)]
        if kind == ODOMETRY:
            data.append(maker.odometry(stamp, parent, child, pose))
        elif kind in (TF, OLD_TF):
            data.append(maker.transforms((stamp, parent, child, pose), name=kind))
        else:
            data.append(maker.pose(stamp, parent, pose, covariance=kind == WITH_COVARIANCE))
            child = ""
        expected.append((index, parent.strip("/"), child.strip("/"), stamp, numbers(pose)))
    assert flattened(decoded(kind, maker.encoding, data)) == sorted(expected)


def test_stamps_before_1970_in_ros2_and_after_2038_in_ros1() -> None:
    (rows,) = decoded(POSE, "cdr", [MAKERS["cdr"].pose(-1_000_000_000, "map", (0.0, 0.0, 0.0))])
    assert rows.stamp_ns.tolist() == [-1_000_000_000]
    data = MAKERS["ros1"].pose(5, "map", (0.0, 0.0, 0.0))
    late = data[:4] + (4_000_000_000).to_bytes(4, "little") + data[8:]
    (rows,) = decoded(POSE, "ros1", [late])
    assert rows.stamp_ns.tolist() == [4_000_000_000_000_000_005]


@pytest.mark.parametrize("maker", [MAKERS["cdr"], MAKERS["ros1"]], ids=["cdr", "ros1"])
@pytest.mark.parametrize("kind", [ODOMETRY, POSE, TF])
def test_a_message_that_is_cut_anywhere_is_refused(kind: str, maker: Maker) -> None:
    whole = {
        ODOMETRY: maker.odometry(1, "odom", "base", (1.0, 2.0, 3.0)),
        POSE: maker.pose(1, "odom", (1.0, 2.0, 3.0)),
        TF: maker.transforms((1, "odom", "base", (1.0, 2.0, 3.0)), (1, "a", "b", (1.0, 2.0, 3.0))),
    }[kind]
    needed = len(whole) - (36 * 8 + 48 + 36 * 8 if kind == ODOMETRY else 0)
    for length in range(len(whole)):
        refused: Counter[str] = Counter()
        rows = list(messages.decode_ros(kind, maker.encoding, [whole[:length]], refused))
        assert (len(rows) == 0) == (length < needed), length
        assert (refused.total() == 1) == (length < needed), length


def test_causes_of_refusal() -> None:
    cdr = MAKERS["cdr"]
    good = cdr.pose(5, "odom", (1.0, 2.0, 3.0))
    long_name = good[:12] + (5000).to_bytes(4, "little") + good[16:]
    many = (1 << 30).to_bytes(4, "little")
    refused: Counter[str] = Counter()
    (rows,) = messages.decode_ros(POSE, "cdr", [b"", b"\1\2\3\4" + good[4:], long_name, good], refused)
    assert rows.row.tolist() == [3]
    assert refused == {cursor.ENCAPSULATION: 2, cursor.NAME_LONG: 1}
    refused.clear()
    assert not list(messages.decode_ros(TF, "cdr", [good[:4] + many, good[:4]], refused))
    assert refused == {messages.TOO_MANY: 1, cursor.SHORT: 1}


def test_random_bytes_do_no_harm() -> None:
    random = np.random.default_rng(3)
    good = MAKERS["cdr"].transforms((1, "odom", "base", (1.0, 2.0, 3.0)))
    for _ in range(300):
        data = bytearray(good)
        for at in random.integers(0, len(data), 3):
            data[at] = random.integers(256)
        refused: Counter[str] = Counter()
        # What can be read is read, the rest is counted.
        assert list(messages.decode_ros(TF, "cdr", [bytes(data)], refused)) or refused.total()


def simulated(count: int = 5) -> SimulatedPoses:
    poses = np.column_stack([np.arange(count), -np.arange(count), 0.1 * np.arange(count)]).astype(float)
    stamps = 1_700_000_000_000_000_000 + np.arange(count) * 100_000_000
    frames = Odometry(topic="/odom", frame_id="odom", child_frame_id="base_link", tf=True)
    return SimulatedPoses(frames, "laser", stamps, poses, np.zeros(count), np.zeros(count))


@pytest.mark.parametrize("encoding", [JSON, PROTOBUF], ids=["json", "protobuf"])
def test_foxglove(encoding: object) -> None:
    rows = simulated()
    refused: Counter[str] = Counter()
    for kind, write, child in (
        ("foxglove.PoseInFrame", encoding.odometry, ""),  # type: ignore[attr-defined]
        ("foxglove.FrameTransform", encoding.transform, "base_link"),  # type: ignore[attr-defined]
    ):
        name = encoding.name  # type: ignore[attr-defined]
        (read,) = messages.decode_foxglove(kind, name, [write(rows, row) for row in range(5)], refused)
        assert (read.parent, read.child, refused) == ("odom", child, Counter())
        np.testing.assert_array_equal(read.stamp_ns, rows.stamp_ns)
        np.testing.assert_allclose(read.numbers, [numbers(tuple(pose)) for pose in rows.poses], atol=1e-15)


def test_foxglove_messages_that_are_none() -> None:
    refused: Counter[str] = Counter()
    bad = [b"{", b"[]", b"{}", b'{"pose": 3}', json.dumps({"pose": {"position": {}}}).encode()]
    assert not list(messages.decode_foxglove("foxglove.PoseInFrame", "json", bad, refused))
    assert refused == {messages.NOT_JSON: 1, messages.NOT_POSE: 4}
    refused.clear()
    assert not list(messages.decode_foxglove("foxglove.PoseInFrame", "protobuf", [b"\xff\xff"], refused))
    assert refused == {messages.NOT_PROTOBUF: 1}
    late = {"timestamp": {"sec": 10**12}, "pose": {"position": {}, "orientation": {"w": 1}}}
    assert not list(messages.decode_foxglove("foxglove.PoseInFrame", "json", [json.dumps(late).encode()], refused))
    assert refused["timestamp out of range"] == 1
