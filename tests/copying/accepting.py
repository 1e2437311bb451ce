"""Sweeps that other programs refuse: their own rules, read in their sources, on messages that rosbags decodes.

- slam_toolbox, src/laser_utils.cpp lines 103 to 121 at 0b8ad824 (`makeLaser`): angles, step and limits of the first message
  are the sensor; in a full turn the ends are a turn apart within a step, and the beams are not one more than the steps.
- slam_toolbox, lib/karto_sdk/include/karto_sdk/Karto.h at 01c5d4cd, `LaserRangeFinder::Update`: it has round(view / step)
  beams, and one more unless it is a full turn; `SetRangeThreshold`: the limit lies between least and greatest range.
- slam_toolbox, lib/karto_sdk/src/Karto.cpp, `LaserRangeFinder::Validate`: a message of another number of beams is no sweep
  ("LaserRangeScan contains 449 range readings, expected 450").
- AMCL of Nav2, nav2_amcl/src/amcl_node.cpp, `updateFilter`: a message whose range_max is 0 or less is left out ("wrong
  range_max of laser_scan data"); a range up to range_min counts as range_max.
- Collision Monitor of Nav2, nav2_collision_monitor/src/scan.cpp line 90 at 0148fcb3: only ranges within the limits count.
- Costmaps of Nav2 by laser_geometry, src/laser_geometry.cpp, `transformLaserScanToPointCloud_`: transforms have to be there
  at the stamp and at the stamp of the last beam.
- Cartographer, cartographer_ros/msg_conversion.cc at 8ea07d2c, `LaserScanToPointCloudWithIntensities`: range_min is not
  negative, range_max not less, the last bearing on the side to which the steps go, intensities none or as many; no time is
  behind that of the last beam.
- tf2, tf2/src/buffer_core.cpp, `validateFrameId`: a frame has a name, which begins with no slash.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from lidarcli.ros.messages import ROS1, ROS2
from tests.copying.reading import Message, messages

SECOND = 1_000_000_000


def decoded(found: Iterable[Message]) -> list[Any]:
    """The LaserScan messages, by their fields."""
    scans = [each for each in found if each.type.endswith("/LaserScan")]
    kind = "sensor_msgs/msg/LaserScan"
    return [
        ROS2.deserialize_cdr(each.data, kind) if "/msg/" in each.type else ROS1.deserialize_ros1(each.data, kind)
        for each in scans
    ]


def stamp(scan: Any) -> int:
    """Its stamp [ns]."""
    return int(scan.header.stamp.sec) * SECOND + int(scan.header.stamp.nanosec)


def expected_beams(scan: Any) -> int:
    """How many beams slam_toolbox expects, by the header of the first message."""
    view, step = abs(np.float32(scan.angle_max) - np.float32(scan.angle_min)), float(scan.angle_increment)
    is_turn = abs(view - 2.0 * math.pi) < step - np.finfo(np.float32).eps * 2.0 * math.pi
    if view > 6.10865 and round(view / step) + 1 == len(scan.ranges):
        is_turn = False
    return round((scan.angle_max - scan.angle_min) / step) + (0 if is_turn else 1)


def refusals(path: Path) -> set[str]:
    """Programs that refuse sweeps of a log of one sensor, with what they refuse."""
    scans = decoded(messages(path))
    assert scans
    expected, times = expected_beams(scans[0]), [stamp(each) for each in scans]
    steps = np.diff(times)
    found = set()
    for scan in scans:
        ranges, low, high = np.asarray(scan.ranges), scan.range_min, scan.range_max
        found |= {"slam_toolbox: beams"} if len(ranges) != expected else set()
        found |= {"slam_toolbox: limits"} if not low <= min(25.0, high) <= high else set()
        found |= {"AMCL: range_max"} if not high > 0 else set()
        found |= {"AMCL: no return"} if (ranges == 0).any() else set()
        found |= {"Collision Monitor: limits"} if not ((ranges >= low) & (ranges <= high)).any() else set()
        found |= {"Cartographer: limits"} if not (low >= 0 and high >= low) else set()
        ahead = scan.angle_max > scan.angle_min
        found |= {"Cartographer: angles"} if ahead != (scan.angle_increment > 0) else set()
        found |= {"Cartographer: intensities"} if len(scan.intensities) not in (0, len(ranges)) else set()
        seconds = scan.time_increment * (len(ranges) - 1)
        found |= {"Cartographer: times"} if seconds < 0 else set()
        if seconds * SECOND > 1.5 * float(np.median(steps[steps > 0], axis=None) if (steps > 0).any() else 0):
            found.add("laser_geometry: times")
        found |= {"tf2: frame"} if not scan.header.frame_id or scan.header.frame_id.startswith("/") else set()
    if (steps <= 0).any() or 0 in times:
        found.add("message filters: stamps")
    return found
