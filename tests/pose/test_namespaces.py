"""Frames live in the namespace of their topic: robots with the same frame names, and sweeps that tell their own pose."""

from __future__ import annotations

import json
from math import pi
from typing import Any

import numpy as np
import pytest

from lidarcli.logs.base import Message
from lidarcli.pose.findings import chain_findings, contradictions
from lidarcli.pose.frames import FrameTree
from lidarcli.pose.sources import PoseChain, PoseSources
from lidarcli.pose.tracks import PoseTrack, PoseTracks, planar
from lidarcli.ros.foxglove import SCAN, classes
from tests.pose.pose_messages import SECOND, Pose, message, numbers, odometry, tf

SCANS = ("/robot1/scan", "/robot2/scan")
TIMES = range(0, 101, 10)
AT = np.array([0, 50, 100])


def tracks_of(messages: list[Message]) -> list[PoseTrack]:
    tracks = PoseTracks()
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
    parents = "frame laser has 2 parents: base_link, mast; tf2 takes mast, told last"
    assert words(static, tf(0, "mast", "laser", (0, 0, 0), "/tf_static")) == [parents]
    # Two robots may differ.
    assert words(static, tf(0, "base_link", "laser", (5, 0, 0), "/robot2/tf_static")) == []
    both = [tf(time, "odom", "base_link", (x, 0, 0), "/tf") for time in TIMES for x in (1.0, 1.5)]
    assert words(*both) == ["/tf: base_link is told at two places in odom at one stamp: the first counts"]
    nearly = [tf(time, "odom", "base_link", (x, 0, 0), "/tf") for time in TIMES for x in (1.0, 1.001)]
    assert words(*nearly) == []


def test_what_counts_is_what_tf2_takes() -> None:
    """The first of one stamp; of static ones the last, also where it has another parent, if that is in the tree."""
    both = [tf(time, "odom", "base_link", (x, 0, 0), "/tf") for time in TIMES for x in (1.0, 1.5)]
    mounts = [tf(0, "base_link", "laser", (0.1, 0, 0), "/tf_static"), tf(0, "mast", "laser", (0, 0, 0), "/tf_static")]
    mast = tf(0, "base_link", "mast", (0.5, 0, 0), "/tf_static")
    for links, frames, x in (
        ([*both, *mounts, mast], "odom > base_link > mast > laser", 1.5),
        ([*both, mast, *mounts[::-1]], "odom > base_link > laser", 1.1),
        ([*both, *mounts], "odom > base_link > laser", 1.1),
    ):
        chain = PoseSources(tracks_of(links), None, ["/scan"]).chain("laser", "/scan")
        assert chain is not None
        assert chain.frames == frames
        np.testing.assert_allclose(planar(chain.at(AT)).x, x)


# --- optical frames -----------------------------------------------------------------------------------------


def looking_ahead(roll: float, yaw: float) -> tuple[float, ...]:
    """The quaternion of a roll and then a yaw."""
    sin_roll, cos_roll, sin_yaw, cos_yaw = np.sin(roll / 2), np.cos(roll / 2), np.sin(yaw / 2), np.cos(yaw / 2)
    return sin_roll * cos_yaw, sin_roll * sin_yaw, cos_roll * sin_yaw, cos_roll * cos_yaw


UPRIGHTS = {
    "exact": (-0.5, 0.5, -0.5, 0.5),
    "half turns": looking_ahead(-pi / 2, -pi / 2),
    "too little": looking_ahead(-1.57, -1.57),
    "too much": looking_ahead(-1.5708, -1.5708),
}


@pytest.mark.parametrize("spelled", UPRIGHTS)
def test_sweeps_of_an_optical_frame_are_level_however_it_is_spelled(spelled: str) -> None:
    moving = [tf(time, "odom", "base_link", (time, 0, 0.003 * time), "/tf") for time in TIMES]
    for frame, is_level in (("eye_optical_frame", True), ("eye", False)):
        pose = (0.2, 0.1, 0.3, *UPRIGHTS[spelled])
        sources = PoseSources(tracks_of([*moving, tf(0, "base_link", frame, pose, "/tf_static")]), None, ["/scan"])
        chain = sources.chain(frame, "/scan")
        assert chain is not None
        here, base = planar(chain.at(AT)), 0.003 * AT
        assert not here.upside_down.any()
        turned = 0.0 if is_level else -pi / 2
        np.testing.assert_allclose(here.yaw, base + turned, atol=0.002)
        np.testing.assert_allclose(here.x, AT + 0.2 * np.cos(base) - 0.1 * np.sin(base), atol=1e-6)
        told = [found.message for found in chain_findings(chain, ())]
        words = "frame eye_optical_frame is optical, its plane upright: sweeps are taken as level, ahead along z"
        assert told == ([words] if is_level else [])


def test_an_optical_frame_that_is_level_is_left_as_it_is() -> None:
    links = [*robot("", 0.2, 1.0), tf(0, "laser", "eye_optical", (0.1, 0, 0.5), "/tf_static")]
    chain = PoseSources(tracks_of(links), None, ["/scan"]).chain("eye_optical", "/scan")
    assert chain is not None
    np.testing.assert_allclose(planar(chain.at(AT)).yaw, 0.5)
