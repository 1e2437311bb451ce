"""Logs that no robot writes: random ranges that keep a little of the sweep before, random geometries, poses and stamps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from lidarcli.formalism import Parameters
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import SweepBatch, SweepPoses
from tests.sweeping import START, raw_sweeps

PARAMETERS = (
    Parameters(),
    Parameters.for_profile("paper"),
    Parameters.for_profile("robust", walls=True, group_gap=0.45),
    Parameters.for_profile("robust", max_gap=0, min_beams=1, max_width=float("inf")),
)
WIDTHS = (0, 1, 2, 3, 4, 5, 12, 25, 60, 90, 181)
SWEEPS = 24
"""Of each log."""


def hostile_logs(count: int, seed: int = 0) -> Iterator[tuple[list[SweepBatch], Parameters]]:
    """So many logs in batches of any widths, and what to detect in them."""
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        stamps, poses = _stamps(rng, SWEEPS), _poses(rng, SWEEPS)
        bounds = np.sort(rng.integers(0, SWEEPS + 1, int(rng.integers(0, 4))))
        batches = []
        for rows in np.split(np.arange(SWEEPS), bounds):
            batch = _batch(rng, rows, stamps)
            if poses is not None:
                batch = replace(batch, poses=poses.rows(rows))
            batches.append(batch)
        yield batches, PARAMETERS[number % len(PARAMETERS)]


def _batch(rng: np.random.Generator, rows: Any, stamps: Any) -> SweepBatch:
    """Sweeps of one width, all of one geometry or each of its own."""
    count, width = len(rows), int(rng.choice(WIDTHS))
    beams = np.full(count, width) if rng.random() < 0.6 else rng.integers(0, width + 1, count)
    turn = rng.choice([0.7, 2.0 * np.pi]) / np.maximum(beams - int(rng.integers(0, 2)), 1)
    increment = turn * rng.choice([-1.0, 1.0])
    if rng.random() < 0.1:
        increment = rng.choice([0.0, 1.0, -4.0, 7.0], count)
    raw = raw_sweeps(
        _ranges(rng, count, width),
        stamp_ns=stamps[rows],
        angle_min=rng.uniform(-4.0, 4.0, count) if rng.random() < 0.2 else rng.uniform(-4.0, 4.0),
        angle_increment=increment,
        range_min=0.0,
        range_max=rng.choice([10.0, np.inf]),
        beams=beams,
    )
    return normalise(raw, rows, RangeRules())


def _ranges(rng: np.random.Generator, count: int, width: int) -> Any:
    """(S, B): pieces at some depth, most of them where they were a sweep before, or a little further."""
    ranges = np.empty((count, width), np.float32)
    if not width:
        return ranges
    size = int(rng.integers(1, 9))
    levels = rng.choice([0.05, 0.7, 1.0, 1.3, 4.0, 9.0], width // size + 1)
    slip, fresh = float(rng.choice([0.0, 0.02, 0.1])), float(rng.choice([0.0, 0.05, 0.5]))
    noise, lost = float(rng.choice([0.0, 0.01, 0.3])), float(rng.choice([0.0, 0.1, 0.6]))
    for row in range(count):
        levels = np.where(rng.random(len(levels)) < fresh, rng.choice([0.7, 1.0, 4.0, 9.0], len(levels)), levels)
        levels = np.maximum(levels + slip * rng.normal(size=len(levels)), 0.01)
        shift = row % size if slip else 0
        ranges[row] = np.roll(np.repeat(levels, size), shift)[:width]
    ranges = np.abs(ranges + noise * rng.normal(size=ranges.shape)).astype(np.float32)
    bad = rng.random(ranges.shape) < lost * rng.random()
    ranges[bad] = rng.choice(np.array([np.nan, np.inf, 0, -1, 1e-6, 9e5], np.float32), int(bad.sum()))
    return ranges


def _stamps(rng: np.random.Generator, count: int) -> Any:
    """(S,) [ns]: steady, standing still, jumping back and forth, or anything that int64 holds."""
    kind = rng.integers(5)
    if kind == 0:
        return np.full(count, START)
    if kind == 1:
        return rng.integers(-(2**62), 2**62, count)
    steps = rng.choice([0, 1, 10**8, 10**8, 10**8, -(10**9), 10**11], count) if kind == 2 else 10**8
    stamps: Any = START + np.cumsum(np.broadcast_to(np.asarray(steps, np.int64), count))
    return stamps


def _poses(rng: np.random.Generator, count: int) -> SweepPoses | None:
    """None, a walk, jumps, places at the end of the world; some unknown."""
    kind = rng.integers(5)
    if kind == 0:
        return None
    scale = [0.01, 0.1, 3.0, 1e7][int(kind) - 1]
    x, y, yaw = np.cumsum(scale * rng.normal(size=(3, count)), axis=1)
    unknown = rng.random(count) < rng.choice([0.0, 0.3])
    for values in (x, y, yaw):
        values[unknown] = np.nan
    return SweepPoses(x, y, yaw, rng.random(count) < rng.choice([0.0, 0.5, 1.0]))
