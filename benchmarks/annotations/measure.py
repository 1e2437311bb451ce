"""Everything that the judged sweeps and their logs tell of the methods, in one place."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa

import lidarcli
from benchmarks.accuracy.methods import METHODS
from benchmarks.accuracy.real import centroids
from benchmarks.annotations import buildings, crossed, flicker
from benchmarks.annotations.buildings import Building
from benchmarks.annotations.choice import CHOSEN, Chosen, Side
from benchmarks.annotations.crossed import Boxes
from benchmarks.annotations.flicker import Flicker
from benchmarks.annotations.methods import COMPARED, ROBUST, TRACK, from_rows
from benchmarks.annotations.scoring import Counts, count
from benchmarks.annotations.table import Sweep, read
from lidarcli.formalism import Parameters, detect
from lidarcli.sweeps import Int64, SweepBatch

DRAWS = 1000
STEADY = ("fixed 0.3 m",)
"""Published methods whose flicker is told, too."""


@dataclass
class ByEye:
    """Figures of a run."""

    counts: dict[tuple[Side, str, str, str], Counts] = field(default_factory=dict)
    """Side, log, place and method."""
    flicker: dict[str, Flicker] = field(default_factory=dict)
    """Method → over all logs."""
    boxes: Boxes = field(default_factory=Boxes)
    sweeps: dict[Side, int] = field(default_factory=dict)
    logs: dict[Side, int] = field(default_factory=dict)
    buildings: dict[str, Building] = field(default_factory=dict)
    """Log → its bodies that its map tells."""

    def of(self, side: Side, method: str, *, place: str | None = None, log: str | None = None) -> Counts:
        """The counts of a method, of one kind of place, of one log, or of all."""
        total = Counts()
        for (where, told, kind, name), counts in self.counts.items():
            if (where, name) == (side, method) and place in (None, kind) and log in (None, told):
                total += counts
        return total

    def interval(self, side: Side, method: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Where precision and recall lie for nine of ten draws of as many logs (bootstrap): from and to of both."""
        each = [self.of(side, method, log=log) for log in self.names(side)]
        generator = np.random.default_rng(0)
        draws = [sum((each[k] for k in generator.integers(len(each), size=len(each))), Counts()) for _ in range(DRAWS)]
        low, high = np.quantile([(one.precision, one.recall) for one in draws], (0.05, 0.95), axis=0)
        return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))

    def names(self, side: Side) -> list[str]:
        """The logs of a side that were measured."""
        return sorted({log for where, log, _, _ in self.counts if where == side})

    def places(self, side: Side) -> list[str]:
        """The kinds of place on a side."""
        return sorted({place for where, _, place, _ in self.counts if where == side})


def measure(folder: Path, *, baselines: bool = True) -> ByEye:
    """Every method on every chosen topic."""
    found = ByEye()
    told: dict[tuple[str, str], dict[int, Sweep]] = {}
    for each in read():
        told.setdefault((each.log, each.topic), {})[each.sweep] = each
    logs: dict[Side, set[str]] = {}
    for chosen in CHOSEN:
        if not chosen.path(folder).exists():
            print(f"no {chosen.log}: not measured", file=sys.stderr)
            continue
        mine = told.get((chosen.log, chosen.topic), {})
        logs.setdefault(chosen.side, set()).add(chosen.log)
        found.sweeps[chosen.side] = found.sweeps.get(chosen.side, 0) + len(mine)
        _measure(found, folder, chosen, mine, baselines)
    found.logs = {side: len(names) for side, names in logs.items()}
    for chosen in buildings.chosen_logs(folder):
        judged = told.get((chosen.log, chosen.topic), {})
        found.buildings[chosen.log] = buildings.measure(buildings.sweeps_of(folder, chosen), judged)
    return found


def _measure(found: ByEye, folder: Path, chosen: Chosen, told: dict[int, Sweep], baselines: bool) -> None:
    """Every method on one topic."""
    path = chosen.path(folder)
    batches = list(lidarcli.read(path, topic=chosen.topic))
    rows = {
        ROBUST: lidarcli.detect(batches),
        # By its path, as its poses may be late.
        TRACK: lidarcli.track(path, topic=chosen.topic).objects,
    }
    wanted = frozenset(told)
    for name, method in COMPARED.items():
        if name not in rows and not baselines:
            continue
        got = from_rows(rows[name], batches, wanted) if name in rows else method(batches, wanted)
        for sweep, judged in told.items():
            labels = got[sweep]
            key = (chosen.side, chosen.log, judged.place, name)
            more = count(labels, *judged.beams(len(labels)))
            found.counts[key] = found.counts.get(key, Counts()) + more
    steady = {**rows, **{name: _objects(name, batches) for name in STEADY if baselines}}
    for name, objects in steady.items():
        more_flicker = flicker.measure(objects, batches)
        found.flicker[name] = found.flicker.get(name, Flicker()) + more_flicker
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
