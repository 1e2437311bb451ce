"""LaserScan messages of ROS 1 and ROS 2 as bytes, built in bulk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from lidarcli.sweeps import RawSweeps

_GEOMETRY = (
    "angle_min",
    "angle_max",
    "angle_increment",
    "time_increment",
    "scan_time",
    "range_min",
    "range_max",
)


def cdr_scans(raw: RawSweeps) -> list[bytes]:
    """LaserScan messages as ROS 2 serialises them (little endian), one per sweep."""

    def layout(frame: bytes) -> list[tuple[str, str]]:
        text = len(frame) + 1
        # Strings end with a zero; what follows is aligned to four bytes.
        return [
            ("magic", "<u4"),
            ("seconds", "<i4"),
            ("nanoseconds", "<u4"),
            ("text", "<u4"),
            ("frame", f"S{text + -text % 4}"),
        ]

    return _bulk(raw, layout, lambda message, frame: _set(message, magic=0x00000100, text=len(frame) + 1))


def ros1_scans(raw: RawSweeps) -> list[bytes]:
    """LaserScan messages as ROS 1 serialises them, one per sweep."""

    def layout(frame: bytes) -> list[tuple[str, str]]:
        named = [("seq", "<u4"), ("seconds", "<u4"), ("nanoseconds", "<u4"), ("text", "<u4")]
        return [*named, ("frame", f"S{len(frame)}")] if frame else named

    return _bulk(raw, layout, lambda message, frame: _set(message, text=len(frame)))


def _set(message: np.ndarray[Any, Any], **values: object) -> None:
    for name, value in values.items():
        message[name] = value


def _bulk(
    raw: RawSweeps,
    layout: Callable[[bytes], list[tuple[str, str]]],
    finish: Callable[[np.ndarray[Any, Any], bytes], None],
) -> list[bytes]:
    """Build all messages of one frame and beam count at once, and return them in the order of the sweeps."""
    out: list[bytes] = [b""] * len(raw)
    groups, member = np.unique(np.column_stack([raw.frame, raw.beams]), axis=0, return_inverse=True)
    for number, (frame_number, beams) in enumerate(groups):
        rows = np.flatnonzero(member.reshape(-1) == number)
        frame = raw.frame_ids[frame_number].encode()
        fields: list[Any] = [*layout(frame), *((name, "<f4") for name in _GEOMETRY), ("count", "<u4")]
        fields += [("ranges", "<f4", (int(beams),)), ("strengths", "<u4")]
        if raw.intensities is not None:
            fields += [("intensities", "<f4", (int(beams),))]
        message = np.zeros(len(rows), np.dtype(fields))
        seconds, nanoseconds = np.divmod(raw.stamp_ns[rows], 1_000_000_000)
        finish(message, frame)
        angle_max = raw.angle_min[rows] + (beams - 1) * raw.angle_increment[rows]
        _set(message, seconds=seconds, nanoseconds=nanoseconds, count=beams, angle_max=angle_max)
        _set(message, angle_min=raw.angle_min[rows], angle_increment=raw.angle_increment[rows])
        _set(message, range_min=raw.range_min[rows], range_max=raw.range_max[rows])
        for name in ("time_increment", "scan_time"):
            told = getattr(raw, name)
            if told is not None:
                message[name] = told[rows]
        message["ranges"] = raw.ranges[rows, :beams]
        if raw.intensities is not None:
            _set(message, strengths=beams, intensities=raw.intensities[rows, :beams])
        if frame:
            message["frame"] = frame
        data, size = message.tobytes(), message.itemsize
        for place, row in enumerate(rows.tolist()):
            out[row] = data[place * size : (place + 1) * size]
    return out
