"""Scenes like real buildings seen by a sensor that drives: what 20 sweeps tell together, beside each by itself."""

from __future__ import annotations

from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pyarrow as pa

import lidarcli
from benchmarks.accuracy.cells import BUILDING_CELLS, Cell, Truth, judged, kind_of
from benchmarks.accuracy.methods import ROBUST
from benchmarks.accuracy.scoring import Score, score
from benchmarks.annotations.methods import TRACK, from_rows
from benchmarks.scenes.building import KINDS, SWEEPS, building_scene
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.sweeps.types import Int64, SweepBatch, SweepPoses

Driven = dict[tuple[str, str], Score]
"""Kind of sensor and method → score over all sweeps."""
SCENES = 20
"""Of each kind, by each sensor."""


def measure(first: int, scenes: int, jobs: int) -> Driven:
    """Both methods on every cell."""
    total: Driven = {}
    work = [(cell, seed) for cell in BUILDING_CELLS for seed in range(first, first + scenes)]
    with ProcessPoolExecutor(jobs) as pool:
        for found in pool.map(_measure, work, chunksize=4):
            for key, value in found.items():
                total[key] = total.get(key, Score()) + value
    return total


def _measure(work: tuple[Cell, int]) -> Driven:
    cell, seed = work
    assert cell.kind in KINDS
    scene = building_scene(cell.kind, seed, cell.fitted(), driving=True, legged=False)
    raw, hit, entities = simulate_sweep_arrays(scene, SWEEPS, seed)
    poses = scene.sensor_poses(np.arange(SWEEPS) / scene.sensor.rate)
    x, y, yaw = poses.T
    batch = replace(judged(raw), poses=SweepPoses(x, y, yaw, np.zeros(SWEEPS, bool)))
    kind = np.array([kind_of(entity) for entity in entities], np.uint8)
    truth = Truth(hit, np.tile(kind, (SWEEPS, 1)))
    group = "cheap sensors" if cell.cheap else "good sensors"
    tables = {ROBUST: lidarcli.detect(batch), TRACK: lidarcli.track(batch).objects}
    return {(group, name): score(_labels(table, batch), truth, batch) for name, table in tables.items()}


def _labels(objects: pa.Table, batch: SweepBatch) -> Int64:
    """(S, B) number of the object of every beam."""
    found = from_rows(objects, [batch], frozenset(batch.sweep.tolist()))
    return np.stack([found[sweep] for sweep in batch.sweep.tolist()])


def rows(found: Driven) -> Iterable[list[str]]:
    """The rows of a table: one for each method."""
    groups = sorted({group for group, _ in found}, reverse=True)
    for method in (ROBUST, TRACK):
        numbers = [found[group, method] for group in groups]
        yield [method, *(f"{each.precision:.3f} / {each.recall:.3f}" for each in numbers)]
