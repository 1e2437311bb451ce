"""Every method on the sweeps judged by eye: `detect` and `track` by trees that have seen nothing of the log's recorder."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa

import lidarcli
from benchmarks.accuracy.methods import METHODS
from benchmarks.accuracy.real import centroids
from benchmarks.annotations import crossed, flicker
from benchmarks.annotations.choice import CHOSEN, Chosen
from benchmarks.annotations.crossed import Boxes
from benchmarks.annotations.flicker import Flicker
from benchmarks.annotations.methods import PUBLISHED, ROBUST, TRACK, held_out
from benchmarks.annotations.scoring import Counts, count
from benchmarks.annotations.table import Sweep, read
from benchmarks.thing.__main__ import left_out
from benchmarks.thing.grow import Grown
from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.mapping.places import StaticSensor
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.api.keywords import sources_of
from lidarcli.pipeline.inputs.sources import open_source
from lidarcli.pipeline.reading.needs import Need, PoseOptions
from lidarcli.pipeline.reading.one_log import Reading
from lidarcli.sweeps.types import Int64, SweepBatch

DRAWS = 1000
STEADY = ("fixed 0.3 m",)
"""Published methods whose flicker is told, too."""
PARKED, DRIVING = "parked", "driving"


class Key(NamedTuple):
    """What is counted apart."""

    log: str
    place: str
    motion: str
    """`PARKED` or `DRIVING`."""
    method: str


@dataclass
class ByEye:
    """Figures of a run."""

    counts: dict[Key, Counts] = field(default_factory=dict)
    flicker: dict[str, Flicker] = field(default_factory=dict)
    """Method → over all logs."""
    boxes: Boxes = field(default_factory=Boxes)
    sweeps: int = 0
    logs: int = 0
    recorders: int = 0

    def of(self, method: str, which: Callable[[Key], bool] = lambda _: True) -> Counts:
        """The counts of a method, of some sweeps or of all."""
        return sum((counts for key, counts in self.counts.items() if key.method == method and which(key)), Counts())

    def interval(self, method: str, which: Callable[[Key], bool] = lambda _: True) -> list[tuple[float, float]]:
        """Where precision and recall lie for nine of ten draws of as many logs (bootstrap): from and to of both."""
        each = [self.of(method, lambda key, log=log: key.log == log and which(key)) for log in self.names()]  # type: ignore[misc]
        generator = np.random.default_rng(0)
        draws = [sum((each[k] for k in generator.integers(len(each), size=len(each))), Counts()) for _ in range(DRAWS)]
        low, high = np.quantile([(one.precision, one.recall) for one in draws], (0.05, 0.95), axis=0)
        return [(float(low[0]), float(high[0])), (float(low[1]), float(high[1]))]

    def names(self) -> list[str]:
        """The logs that were measured."""
        return sorted({key.log for key in self.counts})


def measure(folder: Path, *, baselines: bool = True, jobs: int = 1) -> ByEye:
    """Every method on every chosen topic."""
    found = ByEye()
    told: dict[tuple[str, str], dict[int, Sweep]] = {}
    for each in read():
        told.setdefault((each.log, each.topic), {})[each.sweep] = each
    there = [chosen for chosen in CHOSEN if chosen.path(folder).exists()]
    for chosen in CHOSEN:
        if chosen not in there:
            print(f"no {chosen.log}: not measured", file=sys.stderr)
    grown = left_out(folder, jobs)
    for chosen in there:
        mine = told.get((chosen.log, chosen.topic), {})
        found.sweeps += len(mine)
        _measure(found, folder, chosen, mine, grown[chosen.recorder], baselines)
    found.logs = len({chosen.log for chosen in there})
    found.recorders = len({chosen.recorder for chosen in there})
    return found


def _as_track_reads(path: Path, topic: str) -> list[SweepBatch]:
    """The sweeps of a topic with the poses that `track` has."""
    with open_source(sources_of(path, False)[0], OpenOptions()) as log:
        return list(Reading(log, ReadOptions(frozenset({topic})), PoseOptions(), Need.MOVING).batches())


def _measure(found: ByEye, folder: Path, chosen: Chosen, told: dict[int, Sweep], grown: Grown, baselines: bool) -> None:
    """Every method on one topic."""
    path, wanted = chosen.path(folder), frozenset(told)
    batches = _as_track_reads(path, chosen.topic)
    standing = StaticSensor()
    stood = {
        int(sweep): bool(still) for batch in batches for sweep, still in zip(batch.sweep, standing.see(batch), strict=True)
    }
    labels = held_out(batches, grown, wanted)
    labels |= {name: method(batches, wanted) for name, method in PUBLISHED.items() if baselines}
    for name, got in labels.items():
        for sweep, judged in told.items():
            key = Key(chosen.log, judged.place, PARKED if stood[sweep] else DRIVING, name)
            more = count(got[sweep], *judged.beams(len(got[sweep])))
            found.counts[key] = found.counts.get(key, Counts()) + more
    tables = {
        ROBUST: lidarcli.detect(batches),
        # By its path, as its poses may be late.
        TRACK: lidarcli.track(path, topic=chosen.topic).objects,
        **{name: _objects(name, batches) for name in STEADY if baselines},
    }
    for name, objects in tables.items():
        found.flicker[name] = found.flicker.get(name, Flicker()) + flicker.measure(objects, batches)
    for batch in batches:
        parameters = Parameters()
        found.boxes += crossed.measure(batch, detect(batch, parameters), parameters.max_width)


def _objects(name: str, batches: Sequence[SweepBatch]) -> pa.Table:
    """What a published method finds, with the columns of the objects table that its flicker is told by."""
    columns: dict[str, list[Int64]] = {"sweep": [], "x": [], "y": [], "beams": []}
    for batch in batches:
        labels = METHODS[name](batch)
        row, x, y = centroids(labels, batch)
        span = int(labels.max(initial=0)) + 1
        at, beam = np.nonzero(labels > 0)
        _, beams = np.unique(at * span + labels[at, beam], return_counts=True)
        for key, values in zip(columns, (batch.sweep[row], x, y, beams), strict=True):
            columns[key].append(values)
    whole = {key: np.concatenate(values) for key, values in columns.items()}
    return pa.table({**whole, "shape": np.full(len(whole["sweep"]), "unknown")})
