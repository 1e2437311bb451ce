"""Point clouds as messages of every layout, made by rosbags and by the published schemas."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from lidarcli.logs.base import POINTCLOUD2, Message
from tests.pose.pose_messages import Maker

KINDS = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
"""As numpy spells them → the numbers of PointField."""
Column = tuple[str, str, int]
"""Name, kind and offset of a field."""
XYZ: tuple[Column, ...] = (("x", "f4", 0), ("y", "f4", 4), ("z", "f4", 8))


def point_bytes(points: Any, columns: Sequence[Column] = XYZ, step: int = 16, big: bool = False, padding: int = 0) -> bytes:
    """Points (rows, columns, number of fields) as they lie in a message, with `padding` bytes behind each row."""
    values = np.asarray(points, np.float64)
    kinds = [(">" if big else "<") + kind for _, kind, _ in columns]
    names = [name for name, _, _ in columns]
    layout = np.dtype({"names": names, "formats": kinds, "offsets": [at for *_, at in columns], "itemsize": step})
    lying = np.zeros(values.shape[:2], layout)
    for index, name in enumerate(names):
        with np.errstate(invalid="ignore"):
            lying[name] = values[:, :, index]
    return b"".join(row.tobytes() + bytes(padding) for row in lying)


def pointcloud2(
    points: Any,
    columns: Sequence[Column] = XYZ,
    *,
    encoding: str = "cdr",
    step: int = 16,
    big: bool = False,
    big_message: bool = False,
    padding: int = 0,
    row_step: int | None = None,
    frame: str = "lidar",
    stamp_ns: int = 1_700_000_000_000_000_000,
    **changed: Any,
) -> bytes:
    """A `sensor_msgs/PointCloud2` of points (rows, columns, fields), or (N, fields) for a cloud of one row."""
    values = np.asarray(points, np.float64)
    if values.ndim == 2:
        values = values[None]
    maker = Maker(encoding, big_message)
    types = maker.store.types
    fields = [types["sensor_msgs/msg/PointField"](name, at, KINDS[kind], 1) for name, kind, at in columns]
    data = np.frombuffer(point_bytes(values, columns, step, big, padding), np.uint8)
    told = {
        "height": values.shape[0],
        "width": values.shape[1],
        "fields": fields,
        "is_bigendian": big,
        "point_step": step,
        "row_step": values.shape[1] * step + padding if row_step is None else row_step,
        "data": data,
        "is_dense": False,
    } | changed
    return maker.bytes_of(types[POINTCLOUD2](maker.header(stamp_ns, frame), **told), POINTCLOUD2)


def message(data: bytes, encoding: str = "cdr", topic: str = "/points", kind: str = POINTCLOUD2) -> Message:
    """A cloud as a log hands it out."""
    return Message(topic, kind, encoding, 1_700_000_001_000_000_000, data)
