"""Sweeps whose values tell their number, for logs that are written by `rosbags`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.logs.watched import Rosbag2Log

EPOCH = 1_700_000_000


def ranges_of(index: int, beams: int = 37) -> Any:
    return (index + np.linspace(0, 0.4, beams)).astype(np.float32)


def record_time(index: int) -> int:
    return (EPOCH + 5) * 10**9 + index * 10**8


def header(types: Any, index: int, **more: Any) -> Any:
    """The header of a sweep; `more` is what it has beyond stamp and frame."""
    stamp = types["builtin_interfaces/msg/Time"](sec=EPOCH + index // 10, nanosec=index % 10 * 10**8)
    return types["std_msgs/msg/Header"](stamp=stamp, frame_id="laser", **more)


def laser_scan(types: Any, index: int, beams: int = 37, **more: Any) -> Any:
    """The message of a sweep; `more` for its header."""
    return types["sensor_msgs/msg/LaserScan"](
        header=header(types, index, **more),
        angle_min=-1.5,
        angle_max=1.5,
        angle_increment=3.0 / (beams - 1),
        time_increment=0.0,
        scan_time=0.1,
        range_min=0.05,
        range_max=12.0,
        ranges=ranges_of(index, beams),
        intensities=np.zeros(0, np.float32),
    )


def indices(log: Any, **options: Any) -> list[int]:
    """The index of every sweep read, each checked against the values that were written for it."""
    found: list[int] = []
    for block in log.scans(**options):
        for row in range(len(block)):
            beams = int(block.beams[row])
            index = round(float(block.ranges[row, 0]))
            np.testing.assert_array_equal(block.ranges[row, :beams], ranges_of(index, beams))
            assert block.stamp_ns[row] == EPOCH * 10**9 + index * 10**8
            assert block.record_ns[row] == record_time(index)
            assert block.frame_ids[block.frame[row]] == "laser"
            found.append(index)
    return found


def read_bag(path: Path) -> tuple[list[int], list[str]]:
    """Indices of the sweeps of a ROS 2 bag, and its damage."""
    with Rosbag2Log(str(path)) as log:
        found = indices(log)
        return found, [f"{item.place}: {item.cause}" for item in log.report.damage]
