"""What every decoder of pose messages hands out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarcli.sweeps import Float64, Int64

TRANSFORMS = frozenset({"tf2_msgs/msg/TFMessage", "tf/msg/tfMessage", "foxglove.FrameTransform"})
"""Types that are links of the tree of frames."""
ODOMETRY = "nav_msgs/msg/Odometry"
WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"

MAX_TRANSFORMS = 10_000
"""Most transforms of one message that are believed."""


class BadPoseError(ValueError):
    """A message that cannot be a pose; the text is the cause."""


@dataclass(frozen=True, eq=False, slots=True)
class PoseRows:
    """Poses of one frame in another, from some messages of one topic."""

    parent: str
    child: str
    """Empty where the message does not name it (PoseStamped)."""
    row: NDArray[np.intp]
    """(K,) the message, among those that were handed in."""
    stamp_ns: Int64
    """(K,) header stamps."""
    numbers: Float64
    """(K, 7) x, y, z and the quaternion's x, y, z, w."""


def frame_name(name: str) -> str:
    """One spelling for a frame: `/odom` and `odom` are one.

    >>> frame_name("/robot_0/odom")
    'robot_0/odom'
    """
    return name.strip("/")
