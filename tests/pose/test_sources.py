"""The tree of frames and the choice of a source, with answers known by hand."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.logs.base import Message
from lidarcli.pose.sources import PoseSources
from lidarcli.pose.tracks import PoseTracks, planar
from lidarcli.sweeps.types import Int64
from tests.pose.pose_messages import Pose, odometry, pose_stamped, tf


def sources(messages: list[Message], wanted: str | None = None) -> PoseSources:
    tracks = PoseTracks()
    tracks.add(messages)
    return PoseSources(tracks.finish(), wanted)


def moving(parent: str, child: str, topic: str = "/tf", speed: float = 1.0) -> list[Message]:
    """A link that goes along x by `speed` from 0 to 100 ns, told every 10."""
    return [tf(stamp, parent, child, (speed * stamp, 0, 0), topic) for stamp in range(0, 101, 10)]


def static(parent: str, child: str, pose: Pose = (0, 0, 0)) -> list[Message]:
    return [tf(0, parent, child, pose, "/tf_static")]


def driven(parent: str, child: str, topic: str = "/odom") -> list[Message]:
    return [odometry(stamp, parent, child, (0, stamp, 0), topic) for stamp in range(0, 101, 10)]


def placed(parent: str, topic: str, covariance: bool = False) -> list[Message]:
    return [pose_stamped(stamp, parent, (-stamp, 0, 0), topic, covariance) for stamp in range(0, 101, 10)]


def taken(messages: list[Message], frame: str = "laser", wanted: str | None = None) -> tuple[str, str] | None:
    """(topic, world) of the choice."""
    chain = sources(messages, wanted).chain(frame)
    return None if chain is None else (chain.topics[0], chain.world)


AT: Int64 = np.array([0, 5, 33, 100])


def test_a_chain_with_a_static_mount() -> None:
    mount = (0.5, 0.0, np.pi / 2)
    turned = [tf(stamp, "odom", "base_link", (1, 0, stamp * np.pi / 200), "/tf") for stamp in range(0, 101, 20)]
    chain = sources([*turned, *static("base_link", "laser", mount)]).chain("/laser")
    assert chain is not None
    assert (chain.topics, chain.world, chain.frames) == (("/tf", "/tf_static"), "odom", "odom > base_link > laser")
    poses = planar(chain.at(AT))
    yaw = AT * np.pi / 200
    np.testing.assert_allclose(poses.x, 1 + 0.5 * np.cos(yaw))
    np.testing.assert_allclose(poses.y, 0.5 * np.sin(yaw), atol=1e-15)
    np.testing.assert_allclose(np.cos(poses.yaw - yaw - np.pi / 2), 1)
    # Beyond its span a link holds for two of its steps.
    np.testing.assert_array_equal(chain.at(np.array([-40, 140])).position, chain.at(np.array([0, 100])).position)
    assert np.isnan(planar(chain.at(np.array([-41, 141]))).x).all()


def test_the_order_of_sources() -> None:
    pose = placed("map", "/robot/pose")
    amcl = placed("map", "/amcl_pose", covariance=True)
    odom = driven("odom", "base_link")
    tree = [*moving("odom", "base_link"), *static("base_link", "laser")]
    assert taken(pose) == ("/robot/pose", "map")
    assert taken([*pose, *amcl]) == ("/amcl_pose", "map")
    assert taken([*pose, *amcl, *odom]) == ("/odom", "odom")
    assert taken([*pose, *amcl, *odom, *tree]) == ("/tf", "odom")
    found = sources([*pose, *amcl, *odom, *tree])
    assert set(found.alternatives("laser")) == {"/robot/pose", "/amcl_pose", "/odom"}
    # The tree does not reach another sensor.
    assert taken([*pose, *amcl, *odom, *tree], "camera") == ("/odom", "odom")


def test_odometry_with_its_mount() -> None:
    mount = [*static("base_footprint", "base_link", (0, 0, 0)), *static("base_link", "laser", (0.2, 0, 1.0))]
    chain = sources([*driven("odom", "base_link"), *mount]).chain("laser")
    assert chain is not None
    assert (chain.topics, chain.frames, chain.assumption) == (("/odom", "/tf_static"), "odom > base_link > laser", "")
    poses = planar(chain.at(AT))
    np.testing.assert_allclose(poses.x, 0.2)
    np.testing.assert_allclose(poses.y, AT)
    np.testing.assert_allclose(poses.yaw, 1.0)
    # Its child may also be a frame beside the way from the sensor to the root.
    chain = sources([*driven("odom", "base_footprint"), *mount[1:], *static("base_link", "base_footprint", (1, 0, 0))])
    beside = chain.chain("laser")
    assert beside is not None
    np.testing.assert_allclose(planar(beside.at(AT)).x, -0.8)


def test_odometry_without_a_mount_is_that_of_the_sensor() -> None:
    chain = sources(driven("odom", "base_link")).chain("laser")
    assert chain is not None
    assert chain.assumption == "the sensor laser is taken to be at base_link: its mount is not in the log"
    np.testing.assert_allclose(planar(chain.at(AT)).y, AT)
    nameless = sources(driven("odom", "")).chain("laser")
    assert nameless is not None
    assert nameless.assumption == "the sensor laser is taken to be at the pose itself"
    own = sources(driven("odom", "/laser")).chain("laser")
    assert own is not None
    assert own.assumption == ""


@pytest.mark.parametrize(
    "messages",
    [
        [*placed("map", "/robot_1"), *placed("map", "/robot_2")],
        [*placed("map", "/robot_1"), *placed("other", "/robot_2"), *placed("map", "/mocap_pose")],
        [*placed("map", "/robot_1/pose"), *placed("map", "/robot_2/pose")[:3]],
        [*placed("map", "/vrpn/red/pose"), *placed("map", "/vrpn/blue/pose")],
        [*placed("map", "/a/amcl_pose", True), *placed("map", "/b/amcl_pose", True), *placed("map", "/ego_pose")],
        [*driven("odom", "a/base", "/a/odom"), *driven("odom", "b/base", "/b/odom")],
    ],
)
def test_of_topics_that_are_alike_none_is_taken_unasked(messages: list[Message]) -> None:
    """They may be those of several robots."""
    found = sources(messages)
    assert taken(messages) is None
    topics = found.topics
    assert set(found.alike("laser")) == set(topics[:2])
    assert found.alternatives("laser") == topics[2:]
    for topic in topics:
        chain = sources(messages, topic).chain("laser")
        assert chain is not None
        assert chain.topics == (topic,)
        assert sources(messages, topic).alike("laser") == ()


def test_a_mount_or_the_tree_decides_between_topics_that_are_alike() -> None:
    mount = static("b/base", "laser")
    both = [*driven("odom", "a/base", "/a/odom"), *driven("odom", "b/base", "/b/odom")]
    assert taken([*both, *mount]) == ("/b/odom", "odom")
    assert taken([*both, *mount, *moving("odom", "b/base")]) == ("/tf", "odom")
    # Two topics that tell of one frame are of one robot.
    assert taken([*driven("odom", "base", "/a/odom"), *driven("odom", "base", "/b/odom")]) == ("/a/odom", "odom")


@pytest.mark.parametrize(
    "topic", ["/move_base_simple/goal", "/initialpose", "/target_pose", "/red_pose", "/clicked_pose", "/robot/goal_pose"]
)
def test_poses_of_something_else_must_be_asked_for(topic: str) -> None:
    messages = placed("map", topic, covariance=topic == "/initialpose")
    assert taken(messages) is None
    assert sources(messages).alternatives("laser") == (topic,)
    assert taken(messages, wanted=topic) == (topic, "map")
    assert taken(messages, wanted=topic.strip("/")) == (topic, "map")


def test_a_topic_of_links_may_be_asked_for() -> None:
    mount = static("base", "laser", (3, 0, 0))
    messages = [*moving("map", "base", "/a/tf"), *moving("map", "base", "/b/tf", speed=2.0), *mount]
    for topic, speed in (("/a/tf", 1.0), ("/b/tf", 2.0)):
        chain = sources(messages, topic).chain("laser")
        assert chain is not None
        assert chain.topics == (topic, "/tf_static")
        np.testing.assert_allclose(planar(chain.at(AT)).x, 3 + speed * AT)
    assert taken(messages, wanted="/tf_static") is None
