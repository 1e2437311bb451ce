"""Sweeps as a CSV holds them."""

from __future__ import annotations

import numpy as np

from lidarcli.sweeps.types import RawSweeps
from tests.sweeping import raw_sweeps

START = 1_714_555_596_445_048_407
FIRST, STEP = float(np.float32(-2.0862)), float(np.float32(0.1131))


def sweeps(rows: int = 40, width: int = 37, ragged: bool = False, topic: str = "/scan") -> RawSweeps:
    """Random sweeps with every kind of missing range."""
    random = np.random.default_rng(rows + width)
    ranges = random.uniform(0.1, 12, (rows, width)).astype(np.float32)
    for odd in (np.inf, -np.inf, np.nan, 0.0, -0.099, 1e-30, 65.533):
        ranges[random.random((rows, width)) < 0.02] = odd
    beams = random.integers(width - 3, width + 1, rows) if ragged else np.full(rows, width)
    stamp = START + 100_000_001 * np.arange(rows)
    return raw_sweeps(
        ranges,
        topic=topic,
        stamp_ns=stamp,
        record_ns=stamp + 12_345,
        angle_min=FIRST,
        angle_increment=STEP,
        range_min=0.02,
        range_max=5.6,
        beams=beams,
    )
