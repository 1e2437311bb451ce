"""The logs that two checkouts are compared on: samples, random scenes, odd sweeps, each made once into a folder."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks.bench import HERE
from benchmarks.same.odd import odd_logs
from benchmarks.scenes.random import FAULTS, KINDS, SENSORS, random_scene, sensor_with
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import LOST_AS, SceneSensor
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import TURN, RawSweeps, concatenate

SAMPLES = HERE.parent / "samples"
SAMPLE_LOGS = ("room.mcap", "room_empty.mcap", "corridor.bag", "hall", "people.csv.gz", "drive.db3")
CELLS = tuple((sensor, *fault) for sensor in SENSORS for fault in FAULTS)
"""Sensor, noise and share of lost beams: every scene is seen by each."""


@dataclass(frozen=True)
class NamedLog:
    """A log and the group that it counts in."""

    group: str
    path: Path

    @property
    def name(self) -> str:
        """How reports call it."""
        return self.path.name

    @cached_property
    def digest(self) -> str:
        """What is in it, whatever its place."""
        files = sorted(self.path.rglob("*")) if self.path.is_dir() else [self.path]
        return digest_of((file.name, file.read_bytes()) for file in files if file.is_file())


def digest_of(named: Iterable[tuple[str, bytes]]) -> str:
    """A short name for contents that have names."""
    total = hashlib.sha256()
    for name, content in named:
        total.update(f"{name}\0{len(content)}\0".encode())
        total.update(content)
    return total.hexdigest()[:20]


def sample_logs() -> list[NamedLog]:
    """The logs of the samples folder."""
    return [NamedLog("samples", SAMPLES / name) for name in SAMPLE_LOGS]


def given_logs(paths: Iterable[str]) -> list[NamedLog]:
    """The logs that paths mean, as the command line finds them."""
    logs = []
    for found in find_logs(paths):
        if not isinstance(found, Source):
            raise SystemExit(f"{found.path}: {found.error}")
        if found.files:
            raise SystemExit(f"{found.path}: name the folder of these files")
        logs.append(NamedLog("given", Path(found.path).resolve()))
    return logs


def scene_logs(folder: Path, scenes: int) -> list[NamedLog]:
    """Logs of random scenes: one of each kind, sensor and fault, and one of odd sensors."""
    folder = folder / f"scenes-{scenes}"
    names = [f"{kind}-{_cell_name(cell)}" for kind in KINDS for cell in range(len(CELLS))]
    if not folder.exists():
        with ProcessPoolExecutor(os.cpu_count()) as pool:
            seen = list(pool.map(_sweeps_of_scene, range(scenes), chunksize=8))
        logs: dict[str, list[RawSweeps]] = {name: [] for name in [*names, "odd-sensors"]}
        for seed, (regular, odd) in enumerate(seen):
            for cell, sweep in enumerate(regular):
                logs[f"{_kind(seed)}-{_cell_name(cell)}"].append(sweep)
            logs["odd-sensors"].append(odd)
        _write(folder, ((name, concatenate(sweeps)) for name, sweeps in logs.items() if sweeps))
    return [NamedLog("scenes", path) for path in sorted(folder.iterdir())]


def odd_sweep_logs(folder: Path, sweeps: int) -> list[NamedLog]:
    """Logs of sweeps that no sensor gives."""
    folder = folder / f"odd-{sweeps}"
    if not folder.exists():
        _write(folder, odd_logs(sweeps))
    return [NamedLog("odd", path) for path in sorted(folder.iterdir())]


def _write(folder: Path, logs: Iterable[tuple[str, RawSweeps]]) -> None:
    """All logs, or no folder of this name."""
    part = folder.with_name(f"{folder.name}.{os.getpid()}.part")
    part.mkdir(parents=True)
    for name, raw in logs:
        stamp_ns = raw.stamp_ns[:1] + 100_000_000 * np.arange(len(raw))
        write_log(part / f"{name}.mcap", [replace(raw, stamp_ns=stamp_ns, record_ns=stamp_ns)])
    part.rename(folder)


def _kind(seed: int) -> str:
    return KINDS[seed % len(KINDS)]


def _cell_name(cell: int) -> str:
    sensor, noise, _ = CELLS[cell]
    return f"{sensor}-{1000 * noise:.0f}mm"


def _sweeps_of_scene(seed: int) -> tuple[list[RawSweeps], RawSweeps]:
    """A scene as every cell sees it, a sweep each, and two sweeps of an odd sensor."""
    scene = random_scene(KINDS[seed % len(KINDS)], seed, SENSORS["361"])
    sensors = [sensor_with(SENSORS[name], noise, lost) for name, noise, lost in CELLS]
    regular = [simulate_sweep_arrays(replace(scene, sensor=sensor), 1, seed)[0] for sensor in sensors]
    return regular, simulate_sweep_arrays(replace(scene, sensor=_odd_sensor(seed)), 2, seed)[0]


def _odd_sensor(seed: int) -> SceneSensor:
    """Any number of beams over any view, in both directions, with every fault."""
    rng = np.random.default_rng([seed, 1])
    beams = int(np.exp(rng.uniform(np.log(8), np.log(1500))))
    view = float(rng.choice([TURN * (beams - 1) / beams, TURN, rng.uniform(0.3, TURN)]))
    increment = view / (beams - 1) * (-1 if rng.random() < 0.4 else 1)
    return SceneSensor(
        beams=beams,
        angle_min=float(rng.uniform(-np.pi, np.pi)),
        angle_increment=increment,
        range_max=float(rng.choice([4.0, 12.0, 30.0])),
        noise=float(rng.choice([0.0, 0.003, 0.02, 0.1])),
        lost=float(rng.choice([0.0, 0.05, 0.5])),
        lost_as=LOST_AS[int(rng.integers(len(LOST_AS)))],
        beams_jitter=int(rng.integers(0, 4)),
        mixed_pixels=float(rng.choice([0.0, 0.3])),
    )
