"""Where things are over ground, and where that is in the sensor frame of a sweep: what paths are drawn from."""

from __future__ import annotations

import numpy as np

from lidarcli.records import record
from lidarcli.reports.columns import Rows
from lidarcli.sweeps import Float64, Int64


@record
class Ground:
    """K objects and S sweeps of one stream, seen from above. Without any pose the sensor is taken as standing."""

    x: Float64
    """(K,) centre of the object over ground [m], from an origin nearby; NaN where it is not known."""
    y: Float64
    pose_x: Float64
    """(S,) the sensor there [m]; NaN where no pose is known. All zero where no sweep has one."""
    pose_y: Float64
    pose_yaw: Float64
    """(S,) direction of its x axis [rad]."""
    side: float
    """-1 where the sensor hangs head down, so that its left is to the right, else 1."""
    posed: bool
    """Whether the log tells where the sensor is."""
    origin: tuple[float, float] = (0.0, 0.0)
    """That origin in the world frame [m]."""

    def to_sensor(self, sweep: int, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Points over ground in the sensor frame of a sweep [m]."""
        return self.turned(sweep, x - self.pose_x[sweep], y - self.pose_y[sweep])

    def turned(self, sweep: int, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Directions over ground, such as velocities, in the sensor frame of a sweep."""
        cos, sin = np.cos(self.pose_yaw[sweep]), np.sin(self.pose_yaw[sweep])
        return cos * x + sin * y, self.side * (cos * y - sin * x)


def ground_of(sweeps: Rows, rows: Int64, objects: Rows, members: Int64, sweep: Int64) -> Ground:
    """The ground of S sweeps and K objects of one stream.

    Parameters
    ----------
    sweeps, rows : the sweeps table, and (S,) which of its rows
    objects, members : the objects table, and (K,) which of its rows
    sweep : (K,) to which of the S sweeps each of these objects belongs
    """
    pose_x, pose_y, pose_yaw = (sweeps.numbers(name)[rows] for name in ("pose_x", "pose_y", "pose_yaw"))
    x, y = objects.numbers("box_x")[members], objects.numbers("box_y")[members]
    there = np.flatnonzero(np.isfinite(pose_x))
    if not len(there):
        zero = np.zeros(len(rows))
        return Ground(x, y, zero, zero, zero, 1.0, posed=False)
    # Far from the origin of the world a difference of two places is still exact to the millimetre.
    x0, y0 = pose_x[there[0]], pose_y[there[0]]
    pose_x, pose_y = pose_x - x0, pose_y - y0
    world_x, world_y = objects.numbers("world_x")[members] - x0, objects.numbers("world_y")[members] - y0
    # The tables do not say which way up the sensor is, but the boxes in both frames do.
    turn = pose_yaw[sweep]
    left = np.cos(turn) * (world_y - pose_y[sweep]) - np.sin(turn) * (world_x - pose_x[sweep])
    upright = np.nansum(np.abs(left - y)) <= np.nansum(np.abs(left + y))
    return Ground(
        world_x,
        world_y,
        pose_x,
        pose_y,
        pose_yaw,
        1.0 if upright else -1.0,
        posed=True,
        origin=(float(x0), float(y0)),
    )
