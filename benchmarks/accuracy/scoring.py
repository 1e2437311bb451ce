"""Right and wrong detections, found and missed entities."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.accuracy.cells import THINGS, WALL, Truth
from lidarcli.sweeps.types import Bool, Int64, Status, SweepBatch

PURE = 0.7
"""A detection is right when this share of its beams hit one entity that is no wall."""
HALF = 0.5
"""An entity is found when one right detection holds this share of its beams."""
LEAST = 3
"""Entities hit by fewer beams are not asked for."""
BEAMS = (3, 5, 12, 40)
"""Entities are also counted by the beams that hit them: from each of these on."""


@dataclass(frozen=True, slots=True)
class Assignment:
    """Which entity each detection is. D detections, entities flattened to (S * E,)."""

    row: Int64
    """(D,)"""
    label: Int64
    """(D,) as in the labels."""
    entity: Int64
    """(D,) flat index of the entity that most of its beams hit, -1 for none."""
    right: Bool
    holds: Bool
    """(D,) right, and holding half of the entity's beams."""
    beams: Int64
    """(S * E,) valid beams that hit each entity."""
    wanted: Bool
    """(S * E,) entities to be found."""
    found: Bool


def assign(labels: Int64, truth: Truth, batch: SweepBatch) -> Assignment:
    """Compare the labels (S, B) of a method, 0 for none, with the truth."""
    rows, most = truth.kind.shape
    cells = rows * most
    known = (batch.status == Status.VALID) & (truth.entity >= 0)
    flat = np.where(known, np.arange(rows)[:, None] * most + truth.entity, -1)
    beams = np.bincount(flat[known], minlength=cells)
    thing = truth.kind.ravel() != WALL
    wanted = (beams >= LEAST) & thing

    row, beam = np.nonzero(labels > 0)
    span = int(labels.max(initial=0)) + 1
    names, detection = np.unique(row * span + labels[row, beam], return_inverse=True)
    size = np.bincount(detection, minlength=len(names))
    hit = flat[row, beam]
    pairs, count = np.unique((detection * cells + hit)[hit >= 0], return_counts=True)
    which, entity = np.divmod(pairs, max(cells, 1))
    # The last of each detection's pairs in this order is the one with the most beams.
    order = np.lexsort((count, which))
    best, most_hits = np.full(len(names), -1), np.zeros(len(names), np.int64)
    best[which[order]] = entity[order]
    most_hits[which[order]] = count[order]
    right = (best >= 0) & (most_hits >= PURE * size) & thing[best]
    holds = right & (most_hits >= HALF * beams[best])
    found = np.zeros(cells, bool)
    found[best[holds]] = True
    return Assignment(names // span, names % span, best, right, holds, beams, wanted, found & wanted)


def _zeros() -> Int64:
    return np.zeros((len(THINGS), len(BEAMS)), np.int64)


@dataclass(frozen=True, slots=True)
class Score:
    """Counts over many sweeps; they add up."""

    detections: int = 0
    right: int = 0
    on_walls: int = 0
    """Wrong detections most of whose beams hit a wall."""
    mixed: int = 0
    """Wrong detections of more than one thing."""
    entities: Int64 = field(default_factory=_zeros)
    """(kinds, classes of beams) entities to be found."""
    found: Int64 = field(default_factory=_zeros)
    parts: Int64 = field(default_factory=_zeros)
    """Right detections of less than half of an entity."""

    def __add__(self, other: Score) -> Score:
        return Score(
            self.detections + other.detections,
            self.right + other.right,
            self.on_walls + other.on_walls,
            self.mixed + other.mixed,
            self.entities + other.entities,
            self.found + other.found,
            self.parts + other.parts,
        )

    @property
    def precision(self) -> float:
        """Share of the detections that are right; 1 without any."""
        return self.right / self.detections if self.detections else 1.0

    @property
    def recall(self) -> float:
        """Share of the entities that are found; 1 without any."""
        wanted = int(self.entities.sum())
        return int(self.found.sum()) / wanted if wanted else 1.0

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall."""
        both = self.precision + self.recall
        return 2.0 * self.precision * self.recall / both if both else 0.0


def score(labels: Int64, truth: Truth, batch: SweepBatch) -> Score:
    """Count what a method found in a batch."""
    result = assign(labels, truth, batch)
    kind = truth.kind.ravel().astype(np.int64)
    wrong = ~result.right
    wall = wrong & (result.entity >= 0) & (kind[result.entity] == WALL)
    return Score(
        detections=len(result.right),
        right=int(result.right.sum()),
        on_walls=int(wall.sum()),
        mixed=int((wrong & ~wall).sum()),
        entities=_table(np.flatnonzero(result.wanted), kind, result.beams),
        found=_table(np.flatnonzero(result.found), kind, result.beams),
        parts=_table(result.entity[result.right & ~result.holds], kind, result.beams),
    )


def _table(entities: Int64, kind: Int64, beams: Int64) -> Int64:
    """Count entities by kind and class of beams."""
    table = _zeros()
    size = np.maximum(np.searchsorted(BEAMS, beams[entities], side="right") - 1, 0)
    np.add.at(table, (kind[entities], size), 1)
    return table
