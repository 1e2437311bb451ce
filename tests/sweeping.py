"""Blocks of sweeps for the tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from lidarcli.sweeps.types import RawSweeps

START = 1_700_000_000_000_000_000
"""Stamp of the first sweep [ns]."""
STEP = 100_000_000
"""From one stamp to the next: 10 Hz."""
BOX = (40, 60, 2.0)
"""A box in the round room: its first beam, the beam after its last one, its range."""


def round_room(sweeps: int, beams: int = 360, *boxes: tuple[int, int, float]) -> Any:
    """(S, B) ranges of a round room with a radius of 4 m, with boxes like `BOX` in it."""
    ranges = np.full((sweeps, beams), 4.0, np.float32)
    for first, after, distance in boxes:
        ranges[:, first:after] = distance
    return ranges


def room_sweeps(topic: str = "/scan", count: int = 20, beams: int = 360) -> RawSweeps:
    """Sweeps of the round room with two boxes in it and a gap; the second box leaves after half of them."""
    ranges = round_room(count, beams, BOX)
    ranges[: count // 2, 200:230] = 1.5
    ranges[:, 10] = np.inf
    stamps = START + STEP * np.arange(count)
    return raw_sweeps(
        ranges, topic=topic, stamp_ns=stamps, record_ns=stamps + STEP // 2, angle_increment=np.float32(2 * np.pi / beams)
    )


def raw_sweeps(ranges: Any, *, topic: str = "/scan", frame_ids: tuple[str, ...] = ("laser",), **columns: Any) -> RawSweeps:
    """The sweeps of (S, B) ranges: full turns, unless `columns` (values for all, or (S,) each) say something else."""
    ranges = np.asarray(ranges, np.float32)
    rows, width = ranges.shape
    stamps = columns.get("stamp_ns", START + STEP * np.arange(rows))
    defaults = {
        "frame": (0, np.int32),
        "stamp_ns": (stamps, np.int64),
        "record_ns": (stamps, np.int64),
        "angle_min": (-np.pi, np.float64),
        "angle_increment": (2 * np.pi / max(width, 1), np.float64),
        "range_min": (0.1, np.float32),
        "range_max": (12.0, np.float32),
        "beams": (width, np.int32),
    }
    filled = {
        name: np.broadcast_to(np.asarray(columns.pop(name, value), kind), rows).copy()
        for name, (value, kind) in defaults.items()
    }
    assert not columns, f"no such columns: {columns}"
    return RawSweeps(topic=topic, frame_ids=frame_ids, ranges=ranges, **filled)
