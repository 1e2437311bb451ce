"""Sweeps that no sensor of the simulation gives: ties, steps and gaps on every kind of geometry, few beams or none."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lidarcli.sweeps.types import TURN, Bool, Float32, Float64, Int32, RawSweeps

LOST = np.array([np.inf, np.inf, np.nan, -np.inf], np.float32)
BAD = np.array([np.nan, np.inf, -np.inf, 0, -1, 0.01, 9, 10, 99, 2e6], np.float32)
WIDTHS = (1, 2, 3, 4, 5, 24, 25, 60, 361, 1081)
PERIOD_NS = 100_000_000


def odd_logs(sweeps: int, seed: int = 0) -> Iterator[tuple[str, RawSweeps]]:
    """Name and content of every odd log; the largest ones have this many sweeps."""
    rng = np.random.default_rng(seed)
    yield "ties", _ties(rng, sweeps)
    yield "pieces", _pieces(rng, sweeps)
    for width in WIDTHS:
        yield f"steps-{width}", _steps(rng, max(8, sweeps // 20), width)


def sweeps_of(
    ranges: Float32, beams: Int32, geometry: tuple[Float64, Float64], limits: tuple[Float32, Float32] | None = None
) -> RawSweeps:
    """One topic at 10 Hz with the angles that a message can hold; `geometry`: first bearings and increments."""
    rows = len(ranges)
    stamp_ns = PERIOD_NS * np.arange(1, rows + 1)
    if limits is None:
        limits = np.zeros(rows, np.float32), np.full(rows, 100.0, np.float32)
    angle_min, increment = (angle.astype(np.float32).astype(np.float64) for angle in geometry)
    return RawSweeps(
        topic="/scan",
        frame_ids=("laser",),
        frame=np.zeros(rows, np.int32),
        stamp_ns=stamp_ns,
        record_ns=stamp_ns,
        angle_min=angle_min,
        angle_increment=increment,
        range_min=limits[0],
        range_max=limits[1],
        beams=beams,
        ranges=ranges,
    )


def _geometry(rng: np.random.Generator, beams: Int32) -> tuple[Float64, Float64]:
    """Partial views, turns, and turns whose last beam repeats the first bearing, in both directions."""
    rows = len(beams)
    many = np.maximum(beams, 1).astype(np.float64)
    partial = np.minimum(0.02, 4.0 / many)
    closing = rng.integers(0, 3, rows)
    closing[beams < 4] = 0
    increment = np.choose(closing, [partial, TURN / many, TURN / np.maximum(many - 1, 1)])
    start = np.choose(rng.integers(0, 3, rows), [-np.pi, 0.0, rng.uniform(-np.pi, np.pi, rows)])
    return start, np.where(rng.random(rows) < 0.4, -increment, increment)


def _ties(rng: np.random.Generator, rows: int) -> RawSweeps:
    """Up to 12 beams on a coarse grid of ranges: level stretches, equal differences, |s| = d_th."""
    beams = rng.integers(0, 13, rows).astype(np.int32)
    values = np.array([1.0, 1.125, 1.5, 2.0, 2.0, 3.0, *LOST], np.float32)
    ranges = rng.choice(values, (rows, 12))
    return sweeps_of(ranges, beams, _geometry(rng, beams))


def _pieces(rng: np.random.Generator, rows: int, most: int = 120) -> RawSweeps:
    """Level, slanted, straight and round surfaces with noise, rounding, lost beams and gaps."""
    beams = rng.integers(1, most + 1, rows).astype(np.int32)
    ranges = np.empty((rows, most), np.float32)
    for row in range(rows):
        surfaces = np.concatenate([_surface(rng) for _ in range(most)])[:most]
        noise = rng.choice([0.0, 0.0, 0.003, 0.03, 0.3])
        values = 0.05 + np.abs(surfaces + noise * rng.standard_normal(most))
        if rng.random() < 0.3:
            # Sensors that count in millimetres or worse: differences of exactly 0 and exactly d_th.
            values = np.maximum(np.round(values * 32) / 32, 1 / 32)
        ranges[row] = values
    share = rng.choice([0.0, 0.02, 0.2, 0.9], rows, p=[0.5, 0.25, 0.2, 0.05])
    lost = rng.random(ranges.shape) < share[:, None]
    ranges[lost] = rng.choice(LOST, int(lost.sum()))
    gap = _gaps(rng, beams, most)
    ranges[gap] = rng.choice(LOST, rows).repeat(gap.sum(axis=1))
    return sweeps_of(ranges, beams, _geometry(rng, beams))


def _surface(rng: np.random.Generator) -> Float64:
    """Ranges of up to 15 beams on one surface."""
    size = int(rng.integers(1, 16))
    k = np.linspace(-0.5, 0.5, size) if size > 1 else np.zeros(1)
    distance = rng.uniform(0.5, 8.0)
    shapes: tuple[Float64, ...] = (
        np.ones(size),
        1 + rng.uniform(-0.5, 0.5) * k,
        1 / np.cos(k * rng.uniform(0.0, 1.5) + rng.uniform(-0.5, 0.5)),
        1.3 - 0.3 * np.cos(2.0 * k),
        1 + rng.uniform(0, 0.3) * np.abs(k),
    )
    return distance * shapes[int(rng.integers(len(shapes)))]


def _gaps(rng: np.random.Generator, beams: Int32, width: int) -> Bool:
    """(S, B) beams of a run of up to 11 without a range, in a fifth of the sweeps."""
    begin = rng.integers(0, beams)
    until = np.where(rng.random(len(beams)) < 0.2, begin + rng.integers(1, 12, len(beams)), begin)
    column = np.arange(width)
    gap: Bool = (column >= begin[:, None]) & (column < until[:, None])
    return gap


def _steps(rng: np.random.Generator, rows: int, width: int) -> RawSweeps:
    """Four levels, every kind of value that is no range, and limits that are none."""
    beams = np.where(rng.random(rows) < 0.5, width, rng.integers(0, width + 1, rows)).astype(np.int32)
    levels = rng.choice([1.0, 1.3, 4.0, 9.0], (rows, width // 6 + 1)).repeat(6, axis=1)[:, :width]
    ranges = (levels + rng.normal(0.0, 0.01, (rows, width))).astype(np.float32)
    bad = rng.random((rows, width)) < rng.choice([0.0, 0.1, 0.6, 1.0], rows)[:, None]
    ranges[bad] = rng.choice(BAD, int(bad.sum()))
    limits = (
        rng.choice(np.array([0.1, 0.1, 1.15, np.nan, 2e6], np.float32), rows),
        rng.choice(np.array([10.0, 10.0, 9.0, np.inf, 3e6], np.float32), rows),
    )
    return sweeps_of(ranges, beams, _geometry(rng, beams), limits)
