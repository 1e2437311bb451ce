"""Poses of text logs: plane, in radians, with the names of their frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from lidarcli.logs.planar import RECORD
from lidarcli.poses.rows import PoseRows


def decode(messages: Sequence[bytes]) -> Iterator[PoseRows]:
    """The poses of messages as `logs.planar` makes them."""
    size = RECORD.itemsize
    found: dict[bytes, list[int]] = {}
    for index, data in enumerate(messages):
        found.setdefault(data[size:], []).append(index)
    for names, some in found.items():
        parent, _, child = names.decode().partition("\0")
        records = np.frombuffer(b"".join(messages[index][:size] for index in some), RECORD)
        numbers = np.zeros((len(some), 7))
        numbers[:, 0], numbers[:, 1] = records["x"], records["y"]
        # The sine of infinity is none; poses that are not finite are counted where all are.
        with np.errstate(invalid="ignore"):
            numbers[:, 5], numbers[:, 6] = np.sin(0.5 * records["yaw"]), np.cos(0.5 * records["yaw"])
        yield PoseRows(parent, child, np.array(some, np.intp), records["stamp_ns"].astype(np.int64), numbers)
