"""Backgrounds and sweeps for the tests: from plain lists, and from simulated scenes with their truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.accuracy.cells import WALL, Truth, judged
from benchmarks.accuracy.scoring import assign
from lidarcli.formalism import Detection, Parameters, sweep
from lidarcli.formalism.background import Background, Grid
from lidarcli.formalism.detect import noise
from lidarcli.formalism.detection import APPEARED, REMOVED
from lidarcli.formalism.learning import Learning
from lidarcli.formalism.subtraction import Subtraction, Tolerance, changes
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import Scene
from lidarcli.sweeps.types import SweepBatch, SweepPoses

WIDE = Parameters(max_width=np.inf)
"""The parameters that go with a background."""
STEP = np.pi / 180


def partial(ranges: list[list[float]] | list[float] | NDArray[np.float64], range_max: float = 12.0) -> SweepBatch:
    """Sweeps of a partial view, a degree from beam to beam."""
    table = np.atleast_2d(np.asarray(ranges, float))
    return sweep(table, angle_min=-STEP * table.shape[1] / 2, angle_increment=STEP, range_max=range_max)


def learning(batch: SweepBatch, size: int = 256, distance: float = 0.25, angle: float = 0.1) -> Learning:
    """What batches of `size` sweeps teach."""
    state = Learning(batch.topic, batch.frame_ids[0], Grid.of(batch, 0), distance, angle)
    for start in range(0, len(batch), size):
        state.add(batch.rows(np.arange(start, min(start + size, len(batch)))))
    return state


def learned(batch: SweepBatch, size: int = 256) -> Background:
    """The background that these sweeps show."""
    return learning(batch, size).background()


def found_in(
    batch: SweepBatch, background: Background, tolerance: Tolerance | None = None, parameters: Parameters = WIDE
) -> Detection:
    """What differs from a background."""
    sigma = noise(batch)
    difference = Subtraction(background, tolerance).difference(batch, sigma)
    return changes(batch, difference, parameters, sigma, per_beam=True)


def with_poses(batch: SweepBatch, poses: NDArray[np.float64]) -> SweepBatch:
    """The batch with the poses (S, 3) of its sweeps."""
    return replace(batch, poses=SweepPoses(*poses.T.copy(), np.zeros(len(batch), bool)))


def simulated(scene: Scene, sweeps: int, seed: int) -> tuple[SweepBatch, NDArray[np.int32]]:
    """Sweeps of a scene and the entity of every beam."""
    raw, hit, _ = simulate_sweep_arrays(scene, sweeps, seed)
    return judged(raw), hit


def without_faults(scene: Scene) -> Scene:
    """The same scene seen by a perfect sensor."""
    return replace(scene, sensor=replace(scene.sensor, noise=0.0, lost=0.0))


def labels(found: Detection, change: int) -> NDArray[np.int64]:
    """(S, B) number of the object of a beam that has appeared, or is gone; 0 for others."""
    assert found.beam_difference is not None
    assert found.change is not None
    held = np.zeros(found.beam_difference.shape, np.int64)
    beams = np.arange(held.shape[1])
    for k in np.flatnonzero(found.change == change).tolist():
        first, last, row = found.beam_i[k], found.beam_f[k], found.row[k]
        within = (beams >= first) & (beams <= last) if first <= last else (beams >= first) | (beams <= last)
        # What is gone owns no beam: beams go on where it was.
        differs = found.beam_difference[row] > 0 if change == REMOVED else found.beam_object[row] == found.object[k]
        held[row, within & differs] = found.object[k]
    return held


@dataclass(frozen=True)
class Counts:
    """Right and wrong, found and missed; they add up."""

    detections: int = 0
    right: int = 0
    wanted: int = 0
    found: int = 0

    def __add__(self, other: Counts) -> Counts:
        return Counts(
            self.detections + other.detections,
            self.right + other.right,
            self.wanted + other.wanted,
            self.found + other.found,
        )

    @property
    def f1(self) -> float:
        """Harmonic mean of the share of detections that are right and of things that are found."""
        precision, recall = self.right / max(self.detections, 1), self.found / max(self.wanted, 1)
        return 2 * precision * recall / max(precision + recall, 1e-9)


def score(found: Detection, change: int, entity: NDArray[np.int32], things: list[int], batch: SweepBatch) -> Counts:
    """Count against the truth: (S, B) entity of each beam, and the entities that are asked for."""
    kinds = np.full((len(batch), max(int(entity.max(initial=0)), *things) + 1), WALL, np.uint8)
    kinds[:, things] = 0
    result = assign(labels(found, change), Truth(entity, kinds), batch)
    return Counts(len(result.right), int(result.right.sum()), int(result.wanted.sum()), int(result.found.sum()))


@dataclass(frozen=True)
class Trial:
    """A scene before and after: three things new, one gone."""

    before: Scene
    after: Scene
    new: list[int]
    """Entities of `after`."""
    gone: int
    """Entity of `before`."""

    @staticmethod
    def of(scene: Scene, seed: int) -> Trial | None:
        """Draw what is new and what is gone; None for a scene with too few things."""
        things = [i for i, entity in enumerate(scene.entities) if not entity.wall]
        if len(things) < 5:
            return None
        *new, gone = np.random.default_rng(seed).permutation(things)[:4].tolist()
        before = [i for i in range(len(scene.entities)) if i not in new]
        after = [i for i in range(len(scene.entities)) if i != gone]
        return Trial(
            before=replace(scene, entities=tuple(scene.entities[i] for i in before)),
            after=replace(scene, entities=tuple(scene.entities[i] for i in after)),
            new=[after.index(i) for i in new],
            gone=before.index(gone),
        )

    def run(self, learn: int, sweeps: int, seed: int) -> tuple[Counts, Counts]:
        """Learn from some sweeps, subtract from others; counts of what appeared and of what is gone.

        What is new behind the thing that is gone stands where nobody could look: it is not asked for.
        """
        background = learned(simulated(self.before, learn, seed)[0])
        batch, hit = simulated(self.after, sweeps, seed + 1000)
        found = found_in(batch, background, Tolerance(removed=True))
        empty, first = simulated(without_faults(self.before), 1, 0)
        nearer = batch.ranges < np.where(np.isnan(empty.ranges), np.inf, empty.ranges)
        new = np.isin(hit, self.new)
        hidden = new & (first == self.gone) & ~nearer
        appeared = score(found, APPEARED, np.where(hidden, -1, hit).astype(np.int32), self.new, batch)
        was = np.where(new & nearer, -1, np.repeat(first, sweeps, axis=0)).astype(np.int32)
        sighted = replace(batch, status=np.zeros_like(batch.status))
        return appeared, score(found, REMOVED, was, [self.gone], sighted)
