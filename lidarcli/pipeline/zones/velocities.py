"""Velocities of the robot at the sweeps: logged ones, and those of its poses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidarcli.sweeps.types import Float64, Int64, SweepBatch, SweepPoses

OLDEST_NS = 2_000_000_000
"""Age from which on a velocity may be that of another time [ns]."""
VELOCITY_SPAN_NS = 200_000_000
"""Least time over which poses tell a velocity [ns]."""


class Velocities(NamedTuple):
    """Velocities that a log tells."""

    stamp_ns: Int64
    velocity: Float64
    recorded: bool
    """True where the stamps are those of the recording."""

    def at(self, batch: SweepBatch) -> tuple[Float64, int]:
        """Return the newest velocity (S, 3) before each sweep, NaN before the first; and how many are too old."""
        times = batch.record_ns if self.recorded else batch.stamp_ns
        index = np.searchsorted(self.stamp_ns, times, side="right") - 1
        newest: Float64 = np.where(index[:, None] < 0, np.nan, self.velocity[np.maximum(index, 0)])
        old = (index >= 0) & (times - self.stamp_ns[np.maximum(index, 0)] > OLDEST_NS)
        return newest, int(np.count_nonzero(old))


def carrier_pose(sensor: SweepPoses, carried: SweepPoses) -> SweepPoses:
    """Return the poses of what carries a sensor, from those of the sensor and its places on what carries it."""
    turned_over = sensor.upside_down != carried.upside_down
    side = np.where(turned_over, -1.0, 1.0)
    yaw = sensor.yaw - side * carried.yaw
    cos, sin = np.cos(yaw), np.sin(yaw)
    x = sensor.x - cos * carried.x + side * sin * carried.y
    y = sensor.y - sin * carried.x - side * cos * carried.y
    return SweepPoses(x, y, yaw, turned_over)


def velocity_of(velocity: Float64, place: SweepPoses, carried: SweepPoses) -> Float64:
    """Return the velocity (S, 3) of a frame in its own axes, from that of the robot that carries it.

    Parameters
    ----------
    place, carried : where the sensor is in the frame, and on the robot
    """
    frame = carrier_pose(carried, place)
    turning = velocity[:, 2]
    dx, dy = velocity[:, 0] - turning * frame.y, velocity[:, 1] + turning * frame.x
    cos, sin = np.cos(frame.yaw), np.sin(frame.yaw)
    # In a frame that hangs head down left is right.
    side = np.where(frame.upside_down, -1.0, 1.0)
    return np.column_stack([cos * dx + sin * dy, side * (cos * dy - sin * dx), side * turning])
