"""The scoring of `make accuracy`, on cases small enough to count by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy.cells import THINGS, WALL, Truth
from benchmarks.accuracy.scoring import BEAMS, Score, assign, score
from lidarcli.formalism import sweep
from lidarcli.sweeps.types import Int64, SweepBatch

BOX, POLE = THINGS.index("box"), THINGS.index("pole")


def scene(entity: list[list[int]], kinds: list[list[int]]) -> tuple[SweepBatch, Truth]:
    """Sweeps whose beams all have a range, and hit these entities."""
    hits = np.array(entity, np.int32)
    batch = sweep(np.full(hits.shape, 2.0), angle_min=0.0, angle_increment=0.01)
    return batch, Truth(hits, np.array(kinds, np.uint8))


def judge(labels: list[list[int]], batch: SweepBatch, truth: Truth) -> Score:
    return score(np.array(labels, np.int64), truth, batch)


def test_a_perfect_answer() -> None:
    batch, truth = scene([[0, 0, 1, 1, 1, 0, 2, 2, 2, 2]], [[WALL, BOX, POLE]])
    result = judge([[0, 0, 1, 1, 1, 0, 2, 2, 2, 2]], batch, truth)
    assert (result.detections, result.right, result.on_walls, result.mixed) == (2, 2, 0, 0)
    assert (result.precision, result.recall, result.f1) == (1.0, 1.0, 1.0)
    assert result.entities[BOX].tolist() == result.found[BOX].tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize(("of_the_box", "right"), [(7, True), (6, False)])
def test_a_detection_is_right_from_seventy_percent_on(of_the_box: int, right: bool) -> None:
    batch, truth = scene([[1] * of_the_box + [0] * (10 - of_the_box)], [[WALL, BOX]])
    result = judge([[1] * 10], batch, truth)
    assert result.right == int(right)
    assert result.found.sum() == int(right)
    assert result.mixed == int(not right), "most of its beams hit the box, so it is not the wall's"


@pytest.mark.parametrize(("held", "found", "parts"), [(5, 1, 0), (4, 0, 1)])
def test_an_entity_is_found_when_one_detection_holds_half_of_it(held: int, found: int, parts: int) -> None:
    batch, truth = scene([[0] * 10], [[BOX]])
    result = judge([[1] * held + [0] * (10 - held)], batch, truth)
    assert (result.right, int(result.found.sum()), int(result.parts.sum())) == (1, found, parts)


def test_walls_are_wrong_and_not_asked_for() -> None:
    batch, truth = scene([[0, 0, 0, 0]], [[WALL, BOX]])
    result = judge([[1, 1, 1, 1]], batch, truth)
    assert (result.right, result.on_walls, int(result.entities.sum())) == (0, 1, 0)
    assert (result.precision, result.recall, result.f1) == (0.0, 1.0, 0.0)


def test_classes_of_beams() -> None:
    assert BEAMS == (3, 5, 12, 40)
    batch, truth = scene([[0] * 4 + [1] * 5 + [2] * 40], [[BOX, BOX, BOX]])
    assert judge([[0] * 49], batch, truth).entities[BOX].tolist() == [1, 1, 0, 1]


def test_against_a_slow_count() -> None:
    rng = np.random.default_rng(5)
    for _ in range(50):
        rows, beams, most = 3, 30, 4
        entity = rng.integers(-1, most, (rows, beams))
        entity = np.repeat(entity, 2, axis=1)
        kinds = rng.choice([BOX, POLE, WALL], (rows, most))
        batch, truth = scene(entity.tolist(), kinds.tolist())
        batch.status[rng.random(entity.shape) < 0.1] = 1
        labels = np.repeat(rng.integers(0, 6, (rows, 10)), 6, axis=1)
        labels[batch.status > 0] = 0
        result = score(labels, truth, batch)
        assert slow(labels, truth, batch) == (
            result.detections,
            result.right,
            int(result.entities.sum()),
            int(result.found.sum()),
        )


def slow(labels: Int64, truth: Truth, batch: SweepBatch) -> tuple[int, int, int, int]:
    """The rules of the score, sweep by sweep and detection by detection."""
    detections = right = wanted = found = 0
    for hits, kinds, mine, status in zip(truth.entity, truth.kind, labels, batch.status, strict=True):
        size = [int(((hits == e) & (status == 0)).sum()) for e in range(len(kinds))]
        real = [e for e in range(len(kinds)) if size[e] >= 3 and kinds[e] != WALL]
        wanted += len(real)
        seen = set()
        for label in set(mine.tolist()) - {0}:
            part = hits[mine == label]
            detections += 1
            for e in range(len(kinds)):
                share = (part == e).mean()
                if share >= 0.7 and kinds[e] != WALL:
                    right += 1
                    if (part == e).sum() >= 0.5 * size[e]:
                        seen.add(e)
        found += len(seen & set(real))
    return detections, right, wanted, found


def test_the_assignment_names_the_entity() -> None:
    batch, truth = scene([[0, 0, 0, 1, 1, 1]], [[WALL, POLE]])
    result = assign(np.array([[0, 0, 0, 7, 7, 7]]), truth, batch)
    assert (result.row.tolist(), result.label.tolist(), result.entity.tolist()) == ([0], [7], [1])
    assert result.right.tolist() == result.holds.tolist() == [True]
    assert result.found.tolist() == [False, True]
