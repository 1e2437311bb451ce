"""Poses of a sensor as tf2_msgs/TFMessage, for logs that have none for a viewer."""

from __future__ import annotations

import numpy as np

from lidarcli.overlays.markers import within_ros
from lidarcli.overlays.wire import LayoutBuilder
from lidarcli.sweeps import Bool, Float64, Int64


def transforms(
    stamp_ns: Int64, world: str, frame: str, pose: Float64, upside_down: Bool, *, cdr: bool
) -> list[bytes]:
    """S messages, each with the pose of a sensor in the world.

    Parameters
    ----------
    stamp_ns : (S,) [ns]
    world, frame : parent and child
    pose : (S, 3) x, y [m], yaw [rad]
    upside_down : (S,) whether the sensor hangs head down
    cdr : whether for ROS 2, else for ROS 1
    """
    builder = LayoutBuilder(cdr)
    builder.number("I", 1)
    if not cdr:
        builder.number("I", 0)  # Header.seq
    builder.field("seconds", "i")
    builder.field("nanoseconds", "I")
    builder.text(world.encode("utf-8", "replace"))
    builder.text(frame.encode("utf-8", "replace"))
    builder.field("position", "d", (3,))
    builder.field("turn", "d", (4,))
    items = builder.layout().filled(len(stamp_ns))
    items["seconds"], items["nanoseconds"] = within_ros(stamp_ns)
    items["position"][:, :2] = pose[:, :2]
    sin, cos = np.sin(0.5 * pose[:, 2]), np.cos(0.5 * pose[:, 2])
    zero = np.zeros_like(sin)
    upright = np.column_stack([zero, zero, sin, cos])
    # Turned by half a turn about its own x axis first.
    hanging = np.column_stack([cos, sin, zero, zero])
    items["turn"] = np.where(upside_down[:, None], hanging, upright)
    head = b"\0\1\0\0" if cdr else b""
    return [head + item.tobytes() for item in items]
