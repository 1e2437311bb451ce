"""The metrics of `make tracking`: cases small enough to count by hand, and one checked with a published library."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.tracking.metrics import HALF, Agreement, Overlaps, agreement, overlaps
from lidarcli.sweeps.types import Int64


def judge(truth: list[list[int]], tracks: list[list[int]]) -> Agreement:
    return agreement(overlaps(np.array(truth), np.array(tracks)))


def test_a_perfect_answer() -> None:
    labels = [[0, 0, -1, 1, 1], [0, 0, -1, 1, 1]]
    assert judge(labels, labels) == Agreement(1.0, 1.0, 1.0, 1.0, 1.0, 0, 2, 2)


def test_an_entity_with_another_track_from_its_middle_on() -> None:
    found = judge([[0, 0]] * 4, [[1, 1], [1, 1], [2, 2], [2, 2]])
    # Each of the 4 matches: 2 of the 4 rows of the entity have its track.
    assert found.association == pytest.approx(0.5)
    assert (found.detection, found.hota) == (pytest.approx(1.0), pytest.approx(np.sqrt(0.5)))
    # One track for all: 2 right of 4 + 4 rows. One switch, nothing missed.
    assert (found.idf1, found.mota, found.switches) == (pytest.approx(0.5), pytest.approx(0.75), 1)


def test_the_parts_of_a_track_are_one_set_of_beams() -> None:
    assert judge([[0, 0, -1, 0, 0]] * 2, [[7, 7, -1, 7, 7]] * 2).hota == 1.0
    assert judge([[0, 0, -1, 0, 0]] * 2, [[7, 7, -1, 8, 8]] * 2).hota < 0.75


def test_tracks_on_what_is_not_asked_for_count_for_nothing() -> None:
    truth, tracks = np.array([[0, 0, 1, 1, 1]]), np.array([[4, 4, 5, 5, 5]])
    found = agreement(overlaps(truth, tracks, truth == 1))
    assert found == Agreement(1.0, 1.0, 1.0, 1.0, 1.0, 0, 1, 1)


def test_nothing_at_all() -> None:
    nothing = -np.ones((2, 3), np.int64)
    assert agreement(overlaps(nothing, nothing)).tracks == 0
    assert agreement(overlaps(np.zeros((2, 3), np.int64), nothing)) == Agreement(0, 0, 0, 0, 0, 0, 1, 0)


def recorded() -> Overlaps:
    """Eight entities in 60 sweeps, followed by somebody who misses, merges, swaps, cuts short and makes things up."""
    rng = np.random.Generator(np.random.PCG64(14))
    truth = -np.ones((60, 120), np.int64)
    tracks = truth.copy()
    owner = np.arange(8) + 10
    fresh = 100
    for sweep in range(60):
        for entity in range(8):
            begin = 15 * entity + int(4 + 3 * np.sin(sweep / 9 + entity))
            size = 4 + entity % 4
            truth[sweep, begin : begin + size] = entity
            if rng.random() < 0.01:
                owner[entity], fresh = fresh, fresh + 1
            if rng.random() < 0.006:
                other = (entity + 1) % 8
                owner[[entity, other]] = owner[[other, entity]]
            if rng.random() < 0.9:
                first, last = rng.integers(0, 3, 2)
                tracks[sweep, begin + first : begin + size + 1 - last] = owner[entity]
        if rng.random() < 0.3:
            start = int(rng.integers(0, 117))
            tracks[sweep, start : start + 3] = 500
    return overlaps(truth, tracks)


def test_a_recorded_case() -> None:
    found = agreement(recorded())
    assert (found.entities, found.tracks) == (8, 13)
    # What py-motmetrics 1.4.0 says, which the next test asks where it is installed …
    assert (found.mota, found.idf1) == (pytest.approx(0.7125), pytest.approx(0.6313513513513513))
    assert found.switches == 17
    # … and TrackEval 1.3.0.
    assert found.hota == pytest.approx(0.47492735942421666)
    assert found.detection == pytest.approx(0.5772725901888425)
    assert found.association == pytest.approx(0.3911730395346719)


@pytest.mark.filterwarnings("ignore")
def test_the_recorded_case_with_a_published_library() -> None:
    motmetrics = pytest.importorskip("motmetrics")
    found = recorded()
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for sweep in range(found.sweeps):
        truth, track = np.flatnonzero(found.truth_sweep == sweep), np.flatnonzero(found.track_sweep == sweep)
        distance = np.full((len(truth), len(track)), np.nan)
        for row, column, similarity in zip(found.pair_truth, found.pair_track, found.similarity, strict=True):
            if found.truth_sweep[row] == sweep and similarity >= HALF:
                distance[np.flatnonzero(truth == row)[0], np.flatnonzero(track == column)[0]] = 1 - similarity
        accumulator.update(ids(found.truth[truth]), ids(found.track[track]), distance)
    names = ["mota", "idf1", "num_switches"]
    told = motmetrics.metrics.create().compute(accumulator, metrics=names).iloc[0]
    ours = agreement(found)
    assert (ours.mota, ours.idf1) == (pytest.approx(told["mota"]), pytest.approx(told["idf1"]))
    assert ours.switches == told["num_switches"]


def ids(numbers: Int64) -> list[int]:
    return [int(number) for number in numbers]
