"""Batches that no sensor of the simulation gives: few beams or none, every row another geometry, nothing seen."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lidarcli.options.choices import NO_RETURN_WORDS
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import SweepBatch
from tests.sweeping import raw_sweeps


def odd_batches(seed: int = 0) -> Iterator[SweepBatch]:
    """Random ranges with steps, gaps and lost beams, on every kind of geometry."""
    random = np.random.default_rng(seed)
    for width in (0, 1, 2, 3, 4, 5, 24, 25, 60, 361, 1081):
        for lost in (0.0, 0.1, 0.6, 1.0):
            for alike in (True, False):
                yield _batch(random, width, lost, alike)
    yield _batch(random, 30, 0.1, True).rows(np.empty(0, np.int64))


def _batch(random: np.random.Generator, width: int, lost: float, alike: bool) -> SweepBatch:
    rows = 12
    beams = np.full(rows, width) if alike else random.integers(0, width + 1, rows)
    # A partial view, a turn, and a turn whose last beam repeats the first bearing; in both senses of rotation.
    turn = random.choice([1.0, 2.0 * np.pi], rows) / np.maximum(beams - random.integers(0, 2, rows), 1)
    increment = turn * random.choice([-1.0, 1.0], rows)
    if alike:
        increment[:] = increment[0]
    levels = random.choice([1.0, 1.3, 4.0, 9.0], (rows, width // 6 + 1)).repeat(6, axis=1)[:, :width]
    ranges = (levels + random.normal(0.0, 0.01, (rows, width))).astype(np.float32)
    bad = random.random((rows, width)) < lost
    ranges[bad] = random.choice(np.array([np.nan, np.inf, -np.inf, 0, -1, 0.01, 9, 10, 99, 2e6], np.float32), bad.sum())
    raw = raw_sweeps(
        ranges,
        stamp_ns=0,
        angle_min=np.full(rows, -1.0) if alike else random.uniform(-3.0, 3.0, rows),
        angle_increment=increment,
        range_min=random.choice(np.array([0.1, 0.1, 1.15, np.nan, 2e6], np.float32), rows),
        range_max=random.choice(np.array([10.0, 10.0, 9.0, np.inf, 3e6], np.float32), rows),
        beams=beams,
    )
    words = random.choice(NO_RETURN_WORDS, random.integers(0, len(NO_RETURN_WORDS)), replace=False)
    return normalise(raw, np.arange(rows), RangeRules(frozenset(words.tolist())))
