"""Objects: every method on every cell, and the shapes that lidarcli gives to what it finds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.accuracy.cells import CELLS, THINGS, Cell, Things, Truth, cells_of
from benchmarks.accuracy.methods import GROUP_GAP, GROUPING, METHODS, ROBUST, Method, labels_of
from benchmarks.accuracy.scoring import Score, assign, score
from benchmarks.scenes import building
from benchmarks.scenes.random import Kind
from lidarcli.formalism import SHAPES, Parameters, detect
from lidarcli.sweeps.types import Int64, SweepBatch

SHAPE_BEAMS = 12
"""Shapes are asked of entities hit by at least so many beams."""
MISSED = len(SHAPES)
"""Column of the confusion matrix for entities that were not found."""

Key = tuple[Things, Cell, str]
"""Scenes, cell, method."""


def _no_shapes() -> Int64:
    return np.zeros((len(THINGS), len(SHAPES) + 1), np.int64)


@dataclass
class Tally:
    """Counts of a part of the benchmark; parts add up."""

    scores: dict[Key, Score] = field(default_factory=dict)
    shapes: dict[tuple[Things, float], Int64] = field(default_factory=dict)
    """(scenes, noise) → (kinds, shapes and missed)."""

    def add(self, other: Tally) -> None:
        """Take the counts of another part."""
        for key, value in other.scores.items():
            self.scores[key] = self.scores.get(key, Score()) + value
        for place, count in other.shapes.items():
            self.shapes[place] = self.shapes.get(place, _no_shapes()) + count

    def of(self, things: Things, method: str, cells: Sequence[Cell] = CELLS) -> list[Score]:
        """The scores of a method, cell by cell."""
        return [self.scores[things, cell, method] for cell in cells]

    def methods(self, things: Things) -> list[str]:
        """The methods that were run on these scenes, in their order."""
        return list(dict.fromkeys(method for scenes, _, method in self.scores if scenes == things))


@dataclass(frozen=True, slots=True)
class Part:
    """A part of the work, small enough for one process."""

    things: Things
    kind: Kind | building.Kind
    seeds: tuple[int, ...]
    baselines: bool = True


def measure(part: Part) -> Tally:
    """All cells of one kind of scene."""
    methods: dict[str, Method] = {name: method for name, method in METHODS.items() if part.baselines or name == ROBUST}
    if part.things == "whole":
        methods |= GROUPING
    tally = Tally()
    for cell, batch, truth in cells_of(part.kind, list(part.seeds), part.things):
        for name, method in methods.items():
            tally.scores[part.things, cell, name] = score(method(batch), truth, batch)
        if part.things != "legs" and cell in CELLS:
            gap = GROUP_GAP if part.things == "whole" else 0.0
            place = (part.things, cell.noise)
            tally.shapes[place] = tally.shapes.get(place, _no_shapes()) + confusion(batch, truth, gap)
    return tally


def confusion(batch: SweepBatch, truth: Truth, group_gap: float) -> Int64:
    """(kinds, shapes and missed) entities hit by enough beams, by the shape of the detection that found them."""
    detection = detect(batch, Parameters(group_gap=group_gap), per_beam=True)
    result = assign(labels_of(detection), truth, batch)
    rows = len(batch)
    shape_of = np.full((rows, int(detection.object.max(initial=0)) + 1), MISSED, np.int64)
    shape_of[detection.row, detection.object] = detection.shape
    shape = np.full(truth.kind.size, MISSED, np.int64)
    shape[result.entity[result.holds]] = shape_of[result.row, result.label][result.holds]
    asked = np.flatnonzero(result.wanted & (result.beams >= SHAPE_BEAMS))
    counts = _no_shapes()
    np.add.at(counts, (truth.kind.ravel()[asked], shape[asked]), 1)
    return counts


def total(scores: Iterable[Score]) -> Score:
    """The sum of several scores."""
    result = Score()
    for one in scores:
        result += one
    return result
