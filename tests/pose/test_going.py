"""How far a sensor goes during each of its sweeps, by the poses of the log."""

from __future__ import annotations

from dataclasses import replace
from math import cos, sin

import numpy as np
import pytest

from lidarcli.logs.base import Message
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.sweeps.types import SweepBatch
from tests.pose.pose_messages import SECOND, odometry, tf
from tests.pose.test_posing import PosesLog, batch_of, cut, posing_of
from tests.sweeping import START

TENTH = SECOND // 10


def lasting(seconds: float | list[float], count: int = 40) -> SweepBatch:
    """Sweeps at 10 Hz that take so long."""
    return replace(batch_of(count), duration=np.broadcast_to(np.asarray(seconds, float), count).copy())


def along(start: int = -5, stop: int = 60, frame: str = "laser") -> list[Message]:
    """A robot goes at 1 m/s along x and 0.5 m/s against y, and turns by 1 rad/s; a pose each tenth of a second."""
    return [odometry(START + k * TENTH, "odom", frame, (0.1 * k, -0.05 * k, 0.1 * k)) for k in range(start, stop)]


def ways(batch: SweepBatch, messages: list[Message], options: PoseOptions | None = None) -> np.ndarray:  # type: ignore[type-arg]
    """(S, 3) how far it goes."""
    poses = posing_of(PosesLog(messages), options).attach(batch).poses
    assert poses is not None
    assert poses.way is not None
    return poses.way


@pytest.mark.parametrize("seconds", [0.1, 0.04, -0.1, -0.07, 0.25])
def test_the_way_from_the_first_beam_to_the_last(seconds: float) -> None:
    chain = ways(lasting(seconds), along())
    np.testing.assert_allclose(chain, np.tile([seconds, -0.5 * seconds, seconds], (40, 1)), atol=1e-9)


def test_turns_go_the_short_way() -> None:
    messages = [
        odometry(START + k * TENTH, "odom", "laser", (0.0, 0.0, float(np.angle(np.exp(1j * (3.0 + 0.3 * k))))))
        for k in range(60)
    ]
    chain = ways(lasting(0.1), messages)
    np.testing.assert_allclose(chain[:, 2], 0.3, atol=1e-9)


def test_the_way_of_a_sensor_head_down() -> None:
    # Turned by half a turn about its x axis, and then by its heading in the world.
    messages = []
    for k in range(60):
        half = 0.05 * k
        over = (0.1 * k, 0.0, 0.0, cos(half), sin(half), 0.0, 0.0)
        messages.append(tf(START + k * TENTH, "map", "laser", over))
    poses = posing_of(PosesLog(messages)).attach(lasting(0.1)).poses
    assert poses is not None
    assert poses.way is not None
    assert poses.upside_down.all()
    np.testing.assert_allclose(np.sin(poses.yaw - 0.1 * np.arange(40)), 0.0, atol=1e-9)
    np.testing.assert_allclose(poses.way, np.tile([0.1, 0.0, 0.1], (40, 1)), atol=1e-9)
    # Seen by itself it turns the other way round.
    own = poses.own_way()
    assert own is not None
    np.testing.assert_allclose(own[:, 2], -0.1, atol=1e-9)


@pytest.mark.parametrize("size", [1, 7])
def test_the_batch_size_does_not_matter(size: int) -> None:
    batch, posing, parts = lasting(0.1), posing_of(PosesLog(along())), []
    whole = posing_of(PosesLog(along())).attach(batch).poses
    for first, part in zip(range(0, 40, size), cut(batch, size), strict=True):
        assert batch.duration is not None
        poses = posing.attach(replace(part, duration=batch.duration[first : first + size])).poses
        assert poses is not None
        parts.append(poses)
    assert whole is not None
    for name in ("x", "y", "yaw", "way"):
        assert np.array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name))
    assert posing.notes() == ["poses from /odom (odom > laser)"]


@pytest.mark.parametrize("seconds", [0.1, 0.05])
def test_after_its_last_pose_a_sensor_goes_on_as_before(seconds: float) -> None:
    # A pose for each sweep, as many robots tell them: where the last sweep ends nobody says.
    chain = ways(lasting(seconds), along(0, 40))
    np.testing.assert_allclose(chain, np.tile([seconds, -0.5 * seconds, seconds], (40, 1)), atol=1e-9)
