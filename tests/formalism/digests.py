"""Print a digest of every detection of many batches: the compiled core and its source have to print the same."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import fields

import numpy as np

from benchmarks.scenes.random import FAULTS, KINDS, SENSORS, random_scene, sensor_with
from lidarcli.formalism import Detection, Parameters, detect, noise
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import SweepBatch, concatenate
from tests.formalism.odd_batches import odd_batches

PARAMETERS = [
    Parameters.for_profile("robust"),
    Parameters.for_profile("paper"),
    Parameters.for_profile("robust", walls=True, group_gap=0.45),
    Parameters.for_profile("robust", max_gap=0, min_beams=1),
]


def batches(logs: list[str], scenes: int) -> Iterator[SweepBatch]:
    """Of every kind of scene, sensor and fault, of odd geometries, and of the logs."""
    for kind in KINDS:
        for sensor in SENSORS.values():
            for level, lost in FAULTS:
                scene = [random_scene(kind, seed, sensor_with(sensor, level, lost)) for seed in range(scenes)]
                raw = concatenate([simulate_sweep_arrays(one, 1, 0)[0] for one in scene])
                yield normalise(raw, np.arange(len(raw)), RangeRules())
    yield from odd_batches()
    for log in logs:
        with open_log(log) as source:
            yield from read_batches(source, ReadOptions(every=10), ReadReport())


def digest(found: Detection) -> str:
    """A few letters that differ where any bit of any array does, the sign of NaN apart."""
    total = hashlib.sha256()
    for field in fields(found):
        values = getattr(found, field.name)
        if values is not None:
            if values.dtype.kind == "f":
                values = np.where(np.isnan(values), np.nan, values)
            total.update(f"{field.name} {values.dtype} {values.shape} ".encode() + values.tobytes())
    return total.hexdigest()[:16]


if __name__ == "__main__":
    random = np.random.default_rng(0)
    for number, batch in enumerate(batches(sys.argv[1:], 2)):
        within = np.repeat(random.random((len(batch), batch.width // 7 + 1)) < 0.4, 7, axis=1)[:, : batch.width]
        for parameters in PARAMETERS:
            for mask in (None, within):
                print(number, digest(detect(batch, parameters, per_beam=True, within=mask)))
        print(number, noise(batch).tobytes().hex())
