"""Sweeps as point clouds, as a 3D LiDAR would see the scene: a ring for each sweep, between a floor and a ceiling."""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from lidarcli import foxglove
from lidarcli.ros.messages import ROS1, ROS2
from lidarcli.simulate.foxglove import JSON, json_bytes, protobuf_bytes, stamp_of, standing
from lidarcli.simulate.messages import CDR, ROS1_BYTES, Encoding
from lidarcli.sweeps import RawSweeps

POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"
FLOOR, CEILING = -0.5, 2.0
"""Heights of what lies below and above the sensor [m]."""
NEAR = 0.6
"""Floor and ceiling are seen at so much of the range of what is behind them."""

_POINT = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("intensity", "<f4"), ("ring", "<u2")])
_FLOAT32, _UINT16 = 7, 4
"""Types of numbers in PointField."""


def as_clouds(encoding: Encoding) -> Encoding:
    """The encoding that writes a point cloud for each sweep."""
    if encoding in (CDR, ROS1_BYTES):
        is_ros1 = encoding is ROS1_BYTES
        serialize = ROS1.serialize_ros1 if is_ros1 else ROS2.serialize_cdr
        return replace(
            encoding,
            scan_type=POINTCLOUD2,
            scans=lambda raw: _ros_clouds(raw, ROS1 if is_ros1 else ROS2, serialize, is_ros1),
        )
    return replace(encoding, scan_type=foxglove.CLOUD, scans=lambda raw: _foxglove_clouds(raw, encoding))


def _points(raw: RawSweeps, row: int) -> np.ndarray[tuple[int, int], np.dtype[Any]]:
    """(3, B) points of one sweep: on the floor, at the height of the sensor, at the ceiling; NaN without a range."""
    beams = int(raw.beams[row])
    bearing = raw.angle_min[row] + raw.angle_increment[row] * np.arange(beams)
    ranges = raw.ranges[row, :beams].astype(np.float64)
    ranges[~np.isfinite(ranges) | (ranges <= 0)] = np.nan
    points = np.zeros((3, beams), _POINT)
    for ring, (share, height) in enumerate(((NEAR, FLOOR), (1.0, 0.0), (NEAR, CEILING))):
        points["x"][ring] = share * ranges * np.cos(bearing)
        points["y"][ring] = share * ranges * np.sin(bearing)
        points["z"][ring] = np.where(np.isnan(ranges), np.nan, height)
        points["ring"][ring] = ring
        if raw.intensities is not None:
            points["intensity"][ring] = raw.intensities[row, :beams]
    return points


def _fields(floats: int, integers: int) -> list[tuple[str, int, int]]:
    """Name, offset and type of the fields of a point."""
    kinds = (("x", floats), ("y", floats), ("z", floats), ("intensity", floats), ("ring", integers))
    offsets = {name: int(place[1]) for name, place in (_POINT.fields or {}).items()}
    return [(name, offsets[name], kind) for name, kind in kinds]


def _ros_clouds(raw: RawSweeps, store: Any, serialize: Callable[[Any, str], Any], ros1: bool) -> list[bytes]:
    types = store.types
    fields = [types["sensor_msgs/msg/PointField"](*each, 1) for each in _fields(_FLOAT32, _UINT16)]
    messages = []
    for row in range(len(raw)):
        points = _points(raw, row)
        stamp = types["builtin_interfaces/msg/Time"](*divmod(int(raw.stamp_ns[row]), 10**9))
        header = types["std_msgs/msg/Header"](*([0] if ros1 else []), stamp, raw.frame_ids[raw.frame[row]])
        height, width = points.shape
        step = points.itemsize
        message = types[POINTCLOUD2](
            header, height, width, fields, False, step, step * width, points.reshape(-1).view(np.uint8), False
        )
        messages.append(bytes(serialize(message, POINTCLOUD2)))
    return messages


def _foxglove_clouds(raw: RawSweeps, encoding: Encoding) -> list[bytes]:
    pack = json_bytes if encoding is JSON else protobuf_bytes
    kinds = foxglove.NUMBER_KINDS
    fields = [
        {"name": name, "offset": offset, "type": kind}
        for name, offset, kind in _fields(kinds.index("f4"), kinds.index("u2"))
    ]
    clouds = []
    for row in range(len(raw)):
        points = _points(raw, row).tobytes()
        clouds.append(
            pack(
                foxglove.CLOUD,
                {
                    "timestamp": stamp_of(int(raw.stamp_ns[row])),
                    "frame_id": raw.frame_ids[raw.frame[row]],
                    "pose": standing(),
                    "point_stride": _POINT.itemsize,
                    "fields": fields,
                    "data": base64.b64encode(points).decode() if encoding is JSON else points,
                },
            )
        )
    return clouds
