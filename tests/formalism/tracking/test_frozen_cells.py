"""Scenes in which identities were lost once: two bodies took the view of one thing in turns, or a leg stayed alone."""

from __future__ import annotations

import pyarrow.compute as pc
import pytest

import lidarcli
from benchmarks.tracking.cells import APART, CELLS, REPORTING
from benchmarks.tracking.methods import OURS, PARAMETERS, follow
from benchmarks.tracking.recordings import detected, in_batches, record_cell
from benchmarks.tracking.scoring import score
from tests.places import SAMPLES


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 8])
def test_nothing_that_is_seen_all_the_time_switches_its_track(number: int) -> None:
    recording = record_cell(CELLS[number], REPORTING + APART * number)
    found = detected(in_batches(recording.batch), PARAMETERS, recording.entity)
    # There were 51 and 104, of 7 and 8 things.
    assert score(recording, found, follow(OURS, recording, found)).agreement.switches <= 10


def test_six_things_of_which_three_walk_are_six_tracks() -> None:
    tracks = lidarcli.track(SAMPLES / "people.csv.gz").tracks
    assert len(tracks) == 6
    assert pc.sum(pc.equal(tracks["set"], "A")).as_py() == 3
