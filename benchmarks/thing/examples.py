"""What the trees are grown on: bodies of sweeps whose truth is known, with the features that the core measures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.accuracy.cells import BUILDING_CELLS, CELLS, NARROW_CELLS, WALL, Things, cells_of
from benchmarks.accuracy.methods import labels_of
from benchmarks.accuracy.real import centroids, labelled_legs
from benchmarks.accuracy.scoring import assign
from lidarcli.formalism import Parameters, detect
from lidarcli.sweeps.types import Bool, Float64, SweepBatch

EVERYTHING = Parameters(min_thing=0.0)
"""Every body is reported, whatever it is."""


LEG_LOGS = ("positive_1_extracted.bag", "positive_2_extracted.bag")
"""Logs with labelled legs that are used; the others are only reported on."""
ON_LEG = 0.15
"""[m] A body with its centroid this near to a labelled leg is one."""
LEGS_BY = "leg_tracker"
"""Who recorded them."""


@dataclass(frozen=True, slots=True)
class Examples:
    """N bodies."""

    features: Float64
    """(N, F)"""
    thing: Bool
    weight: Float64

    def scaled(self, total: float) -> Examples:
        """The same with weights that sum up to a total."""
        return Examples(self.features, self.thing, self.weight * (total / max(self.weight.sum(), 1e-9)))

    def thinned(self, step: int) -> Examples:
        """Every so many of them, with the weight of all."""
        some = Examples(self.features[::step], self.thing[::step], self.weight[::step])
        return some.scaled(float(self.weight.sum()))


def together(parts: list[Examples]) -> Examples:
    """All examples of several parts."""
    return Examples(
        np.concatenate([part.features for part in parts]),
        np.concatenate([part.thing for part in parts]),
        np.concatenate([part.weight for part in parts]),
    )


def drawn(kind: str, seeds: list[int], things: Things) -> Iterator[Examples]:
    """Bodies of drawn scenes, cell by cell: right ones are things, those mostly on walls are not; the rest is left out."""
    every = (*CELLS, *BUILDING_CELLS, *NARROW_CELLS)
    for _, batch, truth in cells_of(kind, seeds, things, every):  # type: ignore[arg-type]
        found = detect(batch, EVERYTHING, per_beam=True, explain=True)
        result = assign(labels_of(found), truth, batch)
        order = np.lexsort((result.label, result.row))
        assert np.array_equal(result.row[order], found.row)
        assert np.array_equal(result.label[order], found.object)
        right, entity = result.right[order], result.entity[order]
        kept = right | (entity < 0) | (truth.kind.ravel()[entity] == WALL)
        assert found.features is not None
        yield Examples(found.features[kept], right[kept], np.ones(int(kept.sum())))


def legs(folder: Path) -> Examples:
    """Bodies on labelled legs."""
    parts = []
    for name in LEG_LOGS:
        for batch, labels in labelled_legs(folder / "leg_tracker" / name):
            found = detect(batch, EVERYTHING, per_beam=True, explain=True)
            assert found.features is not None
            row, x, y = centroids(labels_of(found), batch)
            hit = np.zeros(len(found), bool)
            for sweep, positions in enumerate(labels):
                mine = np.flatnonzero(row == sweep)
                for leg in positions:
                    off = np.hypot(x[mine] - leg[0], y[mine] - leg[1])
                    hit[mine[off <= ON_LEG]] = True
            parts.append(Examples(found.features[hit], hit[hit], np.ones(int(hit.sum()))))
    return together(parts)


def judged(batch: SweepBatch, row: int, thing: Bool, building: Bool) -> Examples:
    """Bodies of one sweep whose beams (B,) were judged by eye."""
    found = detect(batch.rows(np.array([row])), EVERYTHING, per_beam=True, explain=True)
    assert found.features is not None
    number = labels_of(found)[0]
    features, verdict = [], []
    for k, name in enumerate(found.object.tolist()):
        mine = number == name
        share = float(np.mean(thing[: len(number)][mine])), float(np.mean(building[: len(number)][mine]))
        if max(share) >= 0.7:
            features.append(found.features[k])
            verdict.append(share[0] >= 0.7)
    count = len(verdict)
    return Examples(np.array(features).reshape(count, found.features.shape[1]), np.array(verdict, bool), np.ones(count))
