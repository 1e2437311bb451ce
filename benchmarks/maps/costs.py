"""The logs on which time and memory are measured, and the figures."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.maps.figures import Speed
from benchmarks.maps.program import make_map
from benchmarks.maps.recordings import RESOLUTION, Drive, write_drive
from benchmarks.maps.rules import counts_of
from lidarcli.formalism.mapping.grid import SKIPPED
from lidarcli.simulation.generate import START_NS, SimulatedPoses
from lidarcli.simulation.scene import Odometry
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import Float64, RawSweeps

ROUNDS = 20
"""How often the drive is in the long log."""
SIDE, APART, STEP, NEAR, FAR = 250.0, 40.0, 2.0, 20.0, 30.0
"""Of a wide log [m]: side of the square that it goes to and fro over, from lane to lane, from sweep to sweep, ranges."""
REPEATS = 3


def measure_costs(driven: Drive, folder: Path) -> Speed:
    """Sweeps and cells per second, and memory by the ground that is seen."""
    long, wide, narrow = (folder / f"{name}.mcap" for name in ("long", "wide", "narrow"))
    write_drive(driven, long, ROUNDS)
    lanes = _lanes()
    _write_wide(driven, lanes, wide)
    _write_wide(driven, lanes[:1], narrow)
    sweeps = ROUNDS * driven.scene.sweeps
    command = (sys.executable, "-m", "benchmarks.maps.speed", str(long), str(sweeps), str(wide), str(narrow))
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stderr)
    told = json.loads(done.stdout)
    every = ("--min-move", "0")
    areas = [make_map(log, *every).cells.size * RESOLUTION**2 / 1e6 for log in (wide, narrow)]
    peak = told["peak_mb"][0] - told["peak_mb"][1]
    return Speed(told["per_second"], told["iterate"], _kernel(driven), peak / 1e3 / (areas[0] - areas[1]))


def _kernel(driven: Drive) -> float:
    """Cells on the rays of a drive per second, in the kernel alone."""
    beams = driven.beams
    begin = np.floor(beams.poses[:, :2].T / RESOLUTION)[:, :, None]
    steps = np.abs(np.floor(beams.end / RESOLUTION) - begin).max(axis=0)
    cells = float((steps[beams.use != SKIPPED] + 1).sum())
    taken = np.ones(len(beams), np.bool_)
    times = []
    for _ in range(REPEATS):
        started = time.process_time()
        counts_of(beams, taken, RESOLUTION)
        times.append(time.process_time() - started)
    return cells / min(times)


def _lanes() -> Float64:
    """(S, 3) x, y and yaw of a sensor that goes to and fro."""
    along = np.arange(0.0, SIDE, STEP)
    lanes = np.arange(0.0, SIDE, APART)
    x = np.concatenate([along if number % 2 == 0 else along[::-1] for number in range(len(lanes))])
    return np.column_stack([x, np.repeat(lanes, len(along)), np.zeros(len(x))])


def _write_wide(driven: Drive, where: Float64, log: Path) -> None:
    """A log with ranges at random: what matters is how much ground is seen."""
    raw, sensor = driven.raw, driven.scene.sensor
    sweeps = len(where)
    rows = np.resize(np.arange(len(raw)), sweeps)
    stamp = START_NS + np.arange(sweeps) * round(1e9 / sensor.rate)
    rng = np.random.Generator(np.random.PCG64(0))
    seen: RawSweeps = replace(
        raw,
        frame=raw.frame[rows],
        stamp_ns=stamp,
        record_ns=stamp,
        angle_min=raw.angle_min[rows],
        angle_increment=raw.angle_increment[rows],
        range_min=raw.range_min[rows],
        range_max=np.full(sweeps, FAR, np.float32),
        beams=raw.beams[rows],
        ranges=rng.uniform(NEAR, FAR, (sweeps, raw.ranges.shape[1])).astype(np.float32),
        time_increment=None,
        scan_time=None,
    )
    poses = SimulatedPoses(Odometry(), sensor.frame_id, stamp, where, np.full(sweeps, STEP * sensor.rate), np.zeros(sweeps))
    write_log(log, [seen], poses=poses)
