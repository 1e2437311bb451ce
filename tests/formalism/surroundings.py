"""Batches that several tests look at: simulated scenes through several sensors, and rows as awkward as logs hold them."""

from __future__ import annotations

from functools import cache
from math import inf, nan, pi

import numpy as np

from benchmarks.scenes.random import FAULTS, KINDS, SENSORS, random_scene, sensor_with
from lidarcli.formalism import Parameters
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import SweepBatch, concatenate
from tests.formalism.batches import batch_of
from tests.formalism.random_sweeps import random_sweep
from tests.formalism.reference import EACH_BEARING_ONCE, Sweep

PARAMETERS = {
    "paper": Parameters.for_profile("paper"),
    "robust": Parameters.for_profile("robust"),
    "robust, walls": Parameters.for_profile("robust", walls=True),
    "robust, mean": Parameters.for_profile("robust", threshold="mean"),
    "paper, walls": Parameters.for_profile("paper", walls=True),
}


@cache
def simulated() -> SweepBatch:
    """Rooms, corridors and halls through every sensor, perfect, good and poor: a batch of three widths."""
    blocks = []
    for number, kind in enumerate(KINDS):
        for sensor in SENSORS.values():
            for noise, lost in FAULTS:
                scene = random_scene(kind, 40 + number, sensor_with(sensor, noise, lost))
                blocks.append(simulate_sweep_arrays(scene, 2, seed=number)[0])
    raw = concatenate(blocks)
    return normalise(raw, np.arange(len(raw)), RangeRules())


@cache
def awkward() -> SweepBatch:
    """Random surfaces of every closing and direction, and rows that hold nothing or nearly nothing."""
    rng = np.random.default_rng(7)
    sweeps = [random_sweep(rng) for _ in range(200)]
    for row, ranges in enumerate(([], [inf], [nan] * 5, [2.0], [nan, 2.0, nan], [inf, 2.0, -inf])):
        sweeps.insert(17 * row, Sweep(list(ranges), 0.0, 0.1))
    sweeps.append(Sweep([nan, nan, 3.0, nan], -pi, pi / 2, EACH_BEARING_ONCE))
    sweeps.append(Sweep([nan] * 4, -pi, pi / 2, EACH_BEARING_ONCE))
    return batch_of(sweeps)
