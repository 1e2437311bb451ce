"""Frames live in the namespace of their topic: robots with the same frame names, and sweeps that tell their own pose."""

from __future__ import annotations

import json
from math import pi
from typing import Any

import numpy as np
import pytest

from lidarcli.foxglove import SCAN, classes
from lidarcli.logs.base import Message
from lidarcli.pose.fit import contradictions, way_findings
from lidarcli.pose.sources import FrameTree, PoseChain, PoseSources, TreeLevels, nearness
from lidarcli.pose.tracks import Track, Tracks, planar
from tests.pose.pose_messages import SECOND, Pose, message, numbers, odometry, tf

SCANS = ("/robot1/scan", "/robot2/scan")
TIMES = range(0, 101, 10)
AT = np.array([0, 50, 100])


def tracks_of(messages: list[Message]) -> list[Track]:
    tracks = Tracks()
    tracks.add(messages)
    assert not tracks.refused
    return tracks.finish()


def robot(space: str, mount: float, speed: float, *, world: str = "odom") -> list[Message]:
    """A robot that goes along x, with its laser so far ahead."""
    moving = [tf(time, world, "base_link", (speed * time, 0, 0), f"{space}/tf") for time in TIMES]
    return [*moving, tf(0, "base_link", "laser", (mount, 0, 0), f"{space}/tf_static")]


TWO = [*robot("/robot1", 0.1, 1.0), *robot("/robot2", 0.7, -1.0)]


def way_of(messages: list[Message], topic: str, wanted: str | None = None, scans: Any = SCANS) -> PoseChain | None:
    return PoseSources(tracks_of(messages), wanted, scans).chain("laser", topic)


def x_of(chain: PoseChain | None) -> list[float]:
    assert chain is not None
    return [float(x) for x in planar(chain.at(AT)).x]


@pytest.mark.parametrize("wanted", [None, "own"])
@pytest.mark.parametrize(("number", "expected"), [(1, [0.1, 50.1, 100.1]), (2, [0.7, -49.3, -99.3])])
def test_each_robot_goes_by_its_own_transforms(number: int, expected: list[float], wanted: str | None) -> None:
    named = wanted and f"/robot{number}/tf"
    chain = way_of(TWO, f"/robot{number}/scan", named)
    assert x_of(chain) == pytest.approx(expected)
    assert chain is not None
    assert chain.topics == (f"/robot{number}/tf", f"/robot{number}/tf_static")
    assert (chain.world, chain.steps[-1].target) == (f"robot{number}/odom", "odom")


def test_topics_of_another_robot_are_not_offered() -> None:
    found = PoseSources(tracks_of(TWO), None, SCANS)
    assert found.alternatives("laser", "/robot2/scan") == ()
    # A robot whose transforms are not in the log has no poses.
    alone = PoseSources(tracks_of(robot("/robot1", 0.1, 1.0)), None, SCANS)
    assert alone.chain("laser", "/robot2/scan") is None
    assert alone.alternatives("laser", "/robot2/scan") == ()


def test_odometry_of_the_namespace_comes_first() -> None:
    told = [
        odometry(time, "odom", "base_link", (speed * time, 0, 0), f"/robot{number}/odom")
        for number, speed in ((1, 1.0), (2, -1.0))
        for time in TIMES
    ]
    mounts = [tf(0, "base_link", "laser", (x, 0, 0), f"/robot{number}/tf_static") for number, x in ((1, 0.1), (2, 0.7))]
    chain = way_of([*told, *mounts], "/robot2/scan")
    assert x_of(chain) == pytest.approx([0.7, -49.3, -99.3])
    assert chain is not None
    assert chain.world == "robot2/odom"


@pytest.mark.parametrize(
    ("messages", "topic", "scans", "world"),
    [
        # One robot in a namespace, whose sweeps are in it or beside it, keeps the names of its frames.
        (robot("/robot1", 0.1, 1.0), "/robot1/front/scan", ["/robot1/front/scan", "/robot1/rear/scan"], "odom"),
        (robot("/robot1", 0.1, 1.0), "/scan", ["/scan"], "odom"),
        (robot("", 0.1, 1.0), "/front/scan", ["/front/scan", "/rear/scan"], "odom"),
        # Frames with prefixes in one tree for all need no other name.
        (robot("/robot1", 0.1, 1.0, world="robot1/odom"), "/robot1/scan", SCANS, "robot1/odom"),
        ([*robot("", 0.1, 1.0), *robot("/robot2", 0.7, -1.0)], "/scan", ["/scan", "/robot2/scan"], "odom"),
        ([*robot("", 0.1, 1.0), *robot("/robot2", 0.7, -1.0)], "/robot2/scan", ["/scan", "/robot2/scan"], "robot2/odom"),
    ],
)
def test_names_of_worlds(messages: list[Message], topic: str, scans: list[str], world: str) -> None:
    chain = way_of(messages, topic, scans=scans)
    assert chain is not None
    assert chain.world == world


def test_an_enclosing_namespace_tells_what_the_nearer_one_does_not() -> None:
    mapped = [tf(time, "map", "odom", (0, 5, 0), "/tf") for time in TIMES]
    chain = way_of([*robot("/robot2", 0.7, 1.0), *mapped], "/robot2/scan", scans=["/robot2/scan"])
    assert chain is not None
    assert chain.world == "map"
    assert planar(chain.at(AT)).y.tolist() == [5.0] * 3
    # What both tell, the nearer one tells.
    elsewhere = [tf(time, "map", "base_link", (9, 9, 0), "/tf") for time in TIMES]
    chain = way_of([*robot("/robot2", 0.7, 1.0), *elsewhere], "/robot2/scan", scans=["/robot2/scan"])
    assert chain is not None
    assert chain.world == "odom"


def test_nearness() -> None:
    assert nearness("/robot1/tf", "/robot1/front/scan") == len("robot1")
    assert nearness("/tf", "/robot1/scan", SCANS) == 0
    assert nearness("/robot1/tf", "/robot10/scan", ["/robot1/scan"]) is None
    assert nearness("/robot1/tf", "/scan", ["/scan"]) == 0


def test_points_of_clouds_are_levelled_by_their_own_robot() -> None:
    heights = [
        tf(0, "base_link", "laser", (0, 0, height, 0, 0, 0, 1), f"/robot{number}/tf_static")
        for number, height in ((1, 0.3), (2, 1.5))
    ]
    levels = TreeLevels(tracks_of(heights), "/robot2/points", ["/robot1/points", "/robot2/points"])
    found = levels.of("laser", np.zeros(1, np.int64))
    assert found is not None
    assert found.offset[0].tolist() == [0.0, 0.0, 1.5]


# --- sweeps that tell their own pose ------------------------------------------------------------------------


def scan(stamp_ns: int, frame: str, pose: Pose | None, encoding: str, topic: str = "/lidar") -> Message:
    """A foxglove.LaserScan with a pose, in whose ranges is nothing."""
    names = ("position", "orientation")
    values = dict(zip(names, (pose and numbers(pose)[:3], pose and numbers(pose)[3:]), strict=True))
    if encoding == "protobuf":
        fields = classes()[SCAN](frame_id=frame, ranges=[1.0, 2.0])
        fields.timestamp.FromNanoseconds(stamp_ns)
        for name, some in values.items():
            for axis, value in zip("xyzw", some or (), strict=False):
                setattr(getattr(fields.pose, name), axis, value)
        data = fields.SerializeToString()
    else:
        told = {name: dict(zip("xyzw", some, strict=False)) for name, some in values.items() if some}
        stamp = {"sec": stamp_ns // SECOND, "nsec": stamp_ns % SECOND}
        ranges = {"ranges": [1.0, 2.0], "frame_id": frame, "timestamp": stamp}
        data = json.dumps(ranges | ({"pose": told} if pose else {})).encode()
    return message(topic, SCAN, data, stamp_ns, encoding)


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_the_pose_of_a_sweep_is_a_link(encoding: str) -> None:
    mount = (0.5, 0.2, pi / 2)
    sweeps = [scan(time, "base_link", mount, encoding) for time in TIMES]
    links = tracks_of([*sweeps, *robot("", 9.0, 1.0)])
    tree = FrameTree(links, "/lidar")
    assert (tree.sensor("base_link"), tree.sensor("laser")) == ("/lidar", "laser")
    chain = PoseSources(links, None, ["/lidar"]).chain("/base_link", "/lidar")
    assert chain is not None
    assert chain.frames == "odom > base_link > /lidar"
    here = planar(chain.at(AT))
    np.testing.assert_allclose(np.column_stack([here.x, here.y, here.yaw]), [[x + 0.5, 0.2, pi / 2] for x in AT])
    # Named poses do not take it away, and another topic with this frame has no part in it.
    named = PoseSources(links, "/tf", ["/lidar"]).chain("base_link", "/lidar")
    assert named is not None
    assert named.frames == chain.frames
    other = PoseSources(links, None, ["/lidar"]).chain("base_link", "/scan")
    assert other is not None
    assert other.frames == "odom > base_link"


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
def test_poses_that_vary_are_a_path(encoding: str) -> None:
    # It begins where the frame does.
    sweeps = [scan(time, "map", (time, 0.0, 0.0), encoding) for time in TIMES]
    chain = PoseSources(tracks_of(sweeps), None, ["/lidar"]).chain("map", "/lidar")
    assert chain is not None
    assert (chain.world, chain.topics) == ("map", ("/lidar",))
    assert planar(chain.at(AT)).x.tolist() == [0.0, 50.0, 100.0]


@pytest.mark.parametrize("encoding", ["json", "protobuf"])
@pytest.mark.parametrize("pose", [None, (0.0, 0.0, 0.0), (0.0,) * 7])
def test_the_identity_is_no_link(encoding: str, pose: Pose | None) -> None:
    assert tracks_of([scan(time, "laser", pose, encoding) for time in TIMES]) == []


def test_what_is_no_scan_tells_no_pose() -> None:
    """Whoever reads the sweeps counts it."""
    broken = [message("/lidar", SCAN, b"{", 0, "json"), message("/lidar", SCAN, b"\xff\xff", 0, "protobuf")]
    assert tracks_of([*broken, message("/lidar", SCAN, b'{"pose": {"position": 3}}', 0, "json")]) == []


# --- contradictions -----------------------------------------------------------------------------------------


def words(*messages: Message) -> list[str]:
    return [found.message for found in contradictions(tracks_of([*messages]))]


def test_contradictions_of_one_namespace() -> None:
    static = tf(0, "base_link", "laser", (0.1, 0, 0), "/tf_static")
    moving = [tf(time, "base_link", "laser", (0.1, 0, 0), "/tf") for time in TIMES]
    turned = [tf(time, "base_link", "laser", (0.1, 0, 0.5), "/tf") for time in TIMES]
    differ = "/tf_static and /tf differ on where laser is in base_link: /tf_static counts"
    assert words(static, *moving) == []
    assert words(static, *turned) == [differ]
    elsewhere = tf(0, "base_link", "laser", (0.3, 0, 0), "/tf_static")
    twice = "/tf_static: laser is told at two places in base_link: the last counts"
    assert words(static, elsewhere) == [twice]
    parents = "frame laser has 2 parents: base_link, mast"
    assert words(static, tf(0, "mast", "laser", (0, 0, 0), "/tf_static")) == [parents]
    # Two robots may differ.
    assert words(static, tf(0, "base_link", "laser", (5, 0, 0), "/robot2/tf_static")) == []


def test_a_way_tells_only_what_spoils_it() -> None:
    doubled = tf(0, "base_link", "laser", (0.3, 0, 0), "/tf_static")
    beside = [tf(0, "base_link", "camera", (x, 0, 0), "/tf_static") for x in (0.0, 1.0)]
    links = tracks_of([*robot("", 0.1, 1.0), doubled, *beside])
    chain = PoseSources(links).chain("laser")
    assert chain is not None
    (found,) = way_findings(chain, links)
    assert found.message == "/tf_static: laser is told at two places in base_link: the last counts"


@pytest.mark.parametrize(
    ("shift", "turn", "told"), [(0.15, 0.0, "0.15 m and 0 degrees"), (0.0, 0.06, "0.00 m and 3 degrees"), (0.05, 0.02, "")]
)
def test_a_correction_of_localisation_is_told(shift: float, turn: float, told: str) -> None:
    """Where things are followed 2 m away, it moves them as they never do; the robot drives between two messages."""
    messages = [tf(0, "base_link", "laser", (0.1, 0, 0), "/tf_static")]
    for number, time in enumerate(TIMES):
        place = (shift, 0, turn) if number else (0, 0, 0)
        messages += [tf(time, "map", "odom", place, "/tf"), tf(time, "odom", "base_link", (number, 0, 0), "/tf")]
    links = tracks_of(messages)
    chain = PoseSources(links).chain("laser")
    assert chain is not None
    assert [each.message for each in way_findings(chain, links)] == (
        [f"map > odom is corrected once, by up to {told}: what stands may seem to move then; --pose match does without it"]
        if told
        else []
    )
