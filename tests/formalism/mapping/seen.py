"""Sweeps for the tests of mapping, and a slow, obvious map of them."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from lidarcli.formalism.mapping.grid import CLEAR, HIT, SKIPPED, Beams, Counts, Occupancy, placed
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import Float64, SweepBatch, SweepPoses, UInt8
from tests.sweeping import raw_sweeps

RESOLUTION = 0.05
MOST = 10_000_000
Cell = tuple[int, int]
"""Column and row from the origin of the world."""


def poses_at(*places: tuple[float, ...]) -> SweepPoses:
    """Poses x, y, yaw, and where there are more numbers how far the sensor goes in each."""
    told = np.array(places, float).reshape(len(places), -1)
    way = told[:, 3:6].copy() if told.shape[1] > 3 else None
    return SweepPoses(told[:, 0], told[:, 1], told[:, 2], np.zeros(len(told), bool), way)


def random_sweeps(seed: int, sweeps: int = 12, beams: int = 40) -> tuple[SweepBatch, SweepPoses, UInt8]:
    """Sweeps of any length from anywhere, every other sensor head down, whose beams say anything."""
    random = np.random.default_rng(seed)
    ranges = random.uniform(0.0, 6.0, (sweeps, beams)).astype(np.float32)
    counts = random.integers(1, beams + 1, sweeps)
    batch = normalise(
        raw_sweeps(
            ranges,
            angle_min=random.uniform(-4.0, 4.0, sweeps),
            angle_increment=random.uniform(-0.2, 0.2, sweeps),
            beams=counts,
        ),
        np.arange(sweeps),
        RangeRules(),
    )
    use = random.choice(np.array([SKIPPED, HIT, CLEAR], np.uint8), (sweeps, beams), p=[0.2, 0.6, 0.2])
    use[np.arange(beams) >= counts[:, None]] = SKIPPED
    # What has no range says nothing, whatever is said of it.
    ranges[random.random(ranges.shape) < 0.1] = np.nan
    poses = SweepPoses(
        random.uniform(-9.0, 9.0, sweeps),
        random.uniform(-9.0, 9.0, sweeps),
        random.uniform(-4.0, 4.0, sweeps),
        random.random(sweeps) < 0.5,
        random.uniform(-0.5, 0.5, (sweeps, 3)) if seed % 3 else None,
    )
    return replace(batch, ranges=ranges), poses, use


def ends_of(batch: SweepBatch, poses: SweepPoses, use: UInt8) -> Float64:
    """(2, S, B) where the beams end, one by one."""
    end = np.full((2, *batch.ranges.shape), np.nan)
    for s in range(len(batch)):
        for k in range(batch.width):
            if use[s, k] == SKIPPED:
                continue
            (x, y, yaw), r = start_of(batch, poses, s, k), float(batch.ranges[s, k])
            bearing = float(batch.angle_min[s] + k * batch.angle_increment[s])
            yaw += -bearing if poses.upside_down[s] else bearing
            end[:, s, k] = x + r * math.cos(yaw), y + r * math.sin(yaw)
    return end


def start_of(batch: SweepBatch, poses: SweepPoses, s: int, k: int) -> tuple[float, float, float]:
    """x, y, yaw of the sensor when it takes beam k of sweep s."""
    way = (0.0, 0.0, 0.0) if poses.way is None else poses.way[s].tolist()
    share = k / (int(batch.beams[s]) - 1) if batch.beams[s] > 1 else 0.0
    return (float(poses.x[s]) + share * way[0], float(poses.y[s]) + share * way[1], float(poses.yaw[s]) + share * way[2])


def cells_of(
    batch: SweepBatch, poses: SweepPoses, use: UInt8, resolution: float = RESOLUTION
) -> tuple[Counter[Cell], Counter[Cell]]:
    """Sweeps that hit each cell, and that only pass it, by sets of cells."""
    hits: Counter[Cell] = Counter()
    passes: Counter[Cell] = Counter()
    end = ends_of(batch, poses, use)
    for s in range(len(batch)):
        hit: set[Cell] = set()
        passed: set[Cell] = set()
        for k in range(batch.width):
            there = end[0, s, k], end[1, s, k]
            if math.isnan(there[0]):
                continue
            here = start_of(batch, poses, s, k)[:2]
            if use[s, k] == HIT:
                hit.add(_cell(there, resolution))
            passed |= _on_the_way([value / resolution for value in here], [value / resolution for value in there])
        hits.update(hit)
        passes.update(passed - hit)
    return hits, passes


def _on_the_way(here: list[float], there: list[float]) -> set[Cell]:
    """One cell in each column, or row, of the longer axis, where the way is in its middle; the last one is not passed.

    Where it begins and ends in one column, that one is.
    """
    along = 0 if abs(there[0] - here[0]) >= abs(there[1] - here[1]) else 1
    first, last = math.floor(here[along]), math.floor(there[along])
    found = set()
    for number in [*(range(first, last) if first <= last else range(last + 1, first + 1))] or [first]:
        part = (number + 0.5 - here[along]) / (there[along] - here[along]) if there[along] != here[along] else 0.0
        across = math.floor(here[1 - along] + part * (there[1 - along] - here[1 - along]))
        found.add((number, across) if along == 0 else (across, number))
    return found


def _cell(point: tuple[float, float], resolution: float) -> Cell:
    return math.floor(point[0] / resolution), math.floor(point[1] / resolution)


def counted(beams: Beams, size: int | None = None, resolution: float = RESOLUTION) -> Counts:
    """The counts of beams that come in batches of so many sweeps."""
    counts = Counts(resolution, MOST)
    for part in cut(beams, size or max(len(beams), 1)):
        counts.add(part)
    return counts


def cut(beams: Beams, size: int) -> list[Beams]:
    """The beams in batches of so many sweeps."""
    return [chosen(beams, np.arange(first, min(first + size, len(beams)))) for first in range(0, len(beams), size)]


def chosen(beams: Beams, rows: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Beams:
    """The beams of some sweeps."""
    return Beams(
        np.ascontiguousarray(beams.end[:, rows]), beams.use[rows], beams.beams[rows], beams.poses[rows], beams.way[rows]
    )


def told(counts: Counts) -> tuple[Counter[Cell], Counter[Cell]]:
    """What was counted, by cell of the world."""
    parts = []
    for values in (counts.hits, counts.passes):
        row, column = np.nonzero(values)
        cells = zip((column + counts.column).tolist(), (row + counts.row).tolist(), strict=True)
        parts.append(Counter(dict(zip(cells, values[row, column].tolist(), strict=True))))
    return parts[0], parts[1]


def beams_of(ranges: object, poses: SweepPoses, use: object = HIT, **columns: object) -> Beams:
    """Beams (S, B) of ranges, all of which say the same, from poses."""
    values = np.asarray(ranges, np.float32)
    batch = normalise(raw_sweeps(values, **columns), np.arange(len(values)), RangeRules())
    says = np.broadcast_to(np.asarray(use, np.uint8), values.shape).copy()
    says[np.isnan(values)] = SKIPPED
    return placed(batch, poses, says, values)


def assert_same_map(one: Occupancy, other: Occupancy) -> None:
    """Every cell and the place of two maps is the same."""
    assert (one.x, one.y, one.resolution, one.frame_id) == (other.x, other.y, other.resolution, other.frame_id)
    np.testing.assert_array_equal(one.cells, other.cells, strict=True)
