"""What the robot believes of its way: the true path with a drift that grows with the distance, told late or in time."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import numpy as np

from lidarcli.simulate.generate import START_NS
from lidarcli.simulate.scene import Odometry, Scene
from lidarcli.sweeps import TURN, Float64, Int64


@dataclass(frozen=True, eq=False, slots=True)
class SimulatedPoses:
    """One pose per sweep, as the robot reports it, and the frames it speaks of."""

    odometry: Odometry
    laser_frame: str
    stamp_ns: Int64
    poses: Float64
    """(S, 3) x, y, yaw in the odometry frame."""
    speed: Float64
    """(S,) forward [m/s]."""
    yaw_rate: Float64
    """(S,) [rad/s]."""
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y, yaw of the laser on the robot, as the log tells it."""

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def at(self, stamp_ns: Int64) -> Float64:
        """(K, 3) x, y, yaw of the robot at other times, between the poses that are told."""
        since = (self.stamp_ns - self.stamp_ns[0]).astype(np.float64)
        wanted = (stamp_ns - self.stamp_ns[0]).astype(np.float64)
        return np.column_stack([np.interp(wanted, since, self.poses[:, column]) for column in range(3)])


def simulate_odometry(scene: Scene, sweeps: int, seed: int = 0) -> SimulatedPoses | None:
    """The odometry of a run, None for a scene without any. Without noise it is the true pose.

    Where stamps are late or early, further poses from before or after the run make up for it.
    """
    if scene.odometry is None or sweeps == 0:
        return None
    delay = scene.odometry.delay
    before, after = (ceil(max(late, 0.0) * scene.sensor.rate) for late in (delay, -delay))
    seconds = np.arange(-before, sweeps + after) / scene.sensor.rate
    count = len(seconds)
    true = scene.path.poses(seconds)
    step = np.diff(true, axis=0)
    step[:, 2] = np.mod(step[:, 2] + np.pi, TURN) - np.pi
    cos, sin = np.cos(true[:-1, 2]), np.sin(true[:-1, 2])
    ahead = np.column_stack([cos * step[:, 0] + sin * step[:, 1], cos * step[:, 1] - sin * step[:, 0]])
    way = np.hypot(ahead[:, 0], ahead[:, 1])

    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, 1])))
    drift = rng.standard_normal((count - 1, 3)) * np.sqrt(way)[:, None]
    ahead += drift[:, :2] * scene.odometry.noise
    yaw = true[0, 2] + np.concatenate([[0.0], np.cumsum(step[:, 2] + drift[:, 2] * scene.odometry.yaw_noise)])
    cos, sin = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    moved = np.column_stack([cos * ahead[:, 0] - sin * ahead[:, 1], sin * ahead[:, 0] + cos * ahead[:, 1]])
    believed = np.column_stack([true[0, :2] + np.vstack([np.zeros((1, 2)), np.cumsum(moved, axis=0)]), yaw])
    last = np.vstack([step, step[-1:]]) if count > 1 else np.zeros((1, 3))
    return SimulatedPoses(
        odometry=scene.odometry,
        laser_frame=scene.sensor.frame_id,
        stamp_ns=START_NS + np.rint((seconds + delay) * 1e9).astype(np.int64),
        poses=believed,
        speed=scene.path.speeds(seconds),
        yaw_rate=last[:, 2] * scene.sensor.rate,
        mount=scene.mount.pose if scene.mount.told else (0.0, 0.0, 0.0),
    )
