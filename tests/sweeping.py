"""Blocks of sweeps for the tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from lidarcli.sweeps import RawSweeps

START = 1_700_000_000_000_000_000
"""Stamp of the first sweep [ns]."""
STEP = 100_000_000
"""From one stamp to the next: 10 Hz."""


def raw_sweeps(
    ranges: Any, *, topic: str = "/scan", frame_ids: tuple[str, ...] = ("laser",), **columns: Any
) -> RawSweeps:
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
