"""Sweeps whose geometry, limits, units and stamps are odd, alone and together: read, doubted or refused, never a bug."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from lidarcli.simulation.writers import write_log
from tools.fuzz.containers import SWEEPS, sweeps
from tools.fuzz.logs import judge_log
from tools.fuzz.place import Place
from tools.fuzz.target import Random, Target

ANGLES = (0.0, -180.0, 360.0, 1e-12, 1e-300, 0.9, 1.0, 57.3, -1.0, 1e6, 1e30, np.inf, -np.inf, np.nan)
LIMITS = (0.0, -1.0, 1e-3, 0.5, 12.0, 1000.0, 12000.0, 3.4e38, np.inf, -np.inf, np.nan)
FACTORS = (0.0, 1e-6, -1.0, 100.0, 1000.0, 1e30, np.inf, np.nan)
STAMPS = (0, 1, 100, -1, -(10**9), 3600 * 10**9, 365 * 86400 * 10**9, -(2**62), 2**61)
COUNTS = (0, 1, 2, 3)
ODD = (
    *(("angle_min", value) for value in ANGLES),
    *(("angle_increment", value) for value in ANGLES),
    *((name, value) for name in ("range_min", "range_max") for value in LIMITS),
    *(("ranges", value) for value in FACTORS),
    *(("stamp_ns", value) for value in STAMPS),
    *(("beams", value) for value in COUNTS),
    *(("time_increment", value) for value in ANGLES),
)
"""Field of the sweeps, and what it gets: ranges are multiplied by it, stamps go on by it, counts are cut to it."""


def write(place: Place, number: int, random: Random) -> None:
    """One field of all sweeps, then several of some."""
    block = sweeps(seed=number % 7)
    drawn = [number] if number < len(ODD) else random.integers(len(ODD), size=1 + int(random.integers(4))).tolist()
    for index in drawn:
        name, value = ODD[index]
        rows = np.ones(SWEEPS, np.bool_) if number < len(ODD) else random.random(SWEEPS) < 0.7
        told = getattr(block, name)
        told = np.zeros(SWEEPS, np.float32) if told is None else told.copy()
        with np.errstate(all="ignore"):
            if name == "ranges":
                told[rows] *= np.float32(value)
            elif name == "stamp_ns":
                told[rows] = block.record_ns[0] + np.int64(value) * np.arange(SWEEPS)[rows] % 2**62
            else:
                told[rows] = value
        changed: dict[str, Any] = {name: told}
        block = replace(block, **changed)
    with np.errstate(all="ignore"):
        write_log(place.input / "run.mcap", [block])


def judge(place: Place) -> Iterable[str]:
    """Read it."""
    return judge_log(place, place.input / "run.mcap")


def geometry_targets() -> list[Target]:
    """Sweeps."""
    return [Target("geometry", write, judge, weight=4, known=len(ODD))]
