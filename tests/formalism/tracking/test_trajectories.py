"""Trajectories: every sweep of every track, close to where things truly were, with honest standard deviations."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.tracking.bodies import paths
from benchmarks.tracking.cells import Cell
from benchmarks.tracking.methods import lidarcli
from benchmarks.tracking.recordings import Detected, Recording, detected, in_batches, record_cell
from lidarcli.formalism import Parameters
from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.tracking.results import FRAMES, HIDDEN, PARTLY, Tracks, Trajectories
from lidarcli.formalism.tracking.tracks import Track
from lidarcli.formalism.tracking.trajectories import (
    PARTLY_BIT,
    PARTS_MASK,
    SWEEP,
    Sweeps,
    TrackPiece,
    joined,
    observed_steps,
)
from lidarcli.sweeps.types import Int64

WALKERS = Cell("people", "1081", 0.01, "parked")
DRIVEN = Cell("room", "720", 0.01, "driving")
SEED = 300
Run = tuple[Cell, Recording, Detected, Int64, Tracks, Trajectories]


@pytest.fixture(scope="module", params=[WALKERS, DRIVEN], ids=["walkers", "driven"])
def run(request: pytest.FixtureRequest) -> Run:
    recording = record_cell(request.param, SEED)
    found = detected(in_batches(recording.batch), Parameters(), recording.entity)
    result = lidarcli(found)
    assert result.tracks is not None
    assert result.trajectories is not None
    return request.param, recording, found, result.track, result.tracks, result.trajectories


def test_every_track_has_a_row_in_every_sweep_from_its_first_to_its_last(run: Run) -> None:
    cell, recording, found, track, tracks, rows = run
    assert {*rows.track.tolist()} == {*tracks.track.tolist()}
    assert {FRAMES[code] for code in rows.frame} == {"world" if cell.driving else "sensor"}
    assert rows.stamp_ns.tolist() == recording.batch.stamp_ns[rows.sweep].tolist()
    for number in tracks.track.tolist():
        mine = rows.track == number
        first, last = tracks.first_sweep[number - 1], tracks.last_sweep[number - 1]
        assert rows.sweep[mine].tolist() == list(range(first, last + 1))
        # Its parts are the objects that bear its number.
        parts = np.bincount(found.row[track == number], minlength=len(recording.batch))[first : last + 1]
        assert rows.parts[mine].tolist() == parts.tolist()
        assert ((rows.seen[mine] == HIDDEN) == (parts == 0)).all()
    assert 0 < np.mean(rows.seen == PARTLY) < 0.5
    assert all(np.isfinite(values).all() for values in (rows.x, rows.y, rows.vx, rows.vy, rows.x_sd, rows.vx_sd))
    assert (rows.xy_cov**2 <= (rows.x_sd * rows.y_sd) ** 2 * (1 + 1e-9)).all()


def test_what_stands_has_one_place_and_no_velocity(run: Run) -> None:
    _, _, _, _, tracks, rows = run
    stands = tracks.set[rows.track - 1] != AGENT
    assert 0.1 < stands.mean() < 1.0
    assert (rows.x[stands] == tracks.x[rows.track[stands] - 1]).all()
    assert (rows.y[stands] == tracks.y[rows.track[stands] - 1]).all()
    assert not rows.vx[stands].any()
    assert not rows.vx_sd[stands].any()
    assert (rows.x_sd[stands] < 0.3).mean() > 0.9


def test_what_moves_is_where_it_truly_was(run: Run) -> None:
    found = paths(*run[1:])
    assert len(found.ratios) >= 3
    assert np.sqrt(np.mean(found.place_errors**2)) < 0.1
    assert np.median(found.place_errors) < 0.03
    assert np.median(found.speed_errors) < 0.05
    assert 0.95 < np.median(found.ratios) < 1.05
    assert np.mean(found.deviations < 2) > 0.75


def test_the_way_of_a_track_goes_on_from_piece_to_piece() -> None:
    sweeps, track = Sweeps(), Track(number=3)
    rows = [(40 + each, each * 10**8, each / 10, False, 0, True) for each in range(20)]
    sweeps.add(np.array(rows, SWEEP))
    way = np.zeros((10, 9))
    way[:, 0], way[:, 2], way[:, 4:7] = 0.1 * np.arange(10), 1.0, [4e-4, 1e-4, 9e-4]
    codes = np.full(10, 1, np.uint8)
    codes[4:6], codes[8] = 0, 2 | PARTLY_BIT
    for begin in (5, 10):
        piece = slice(begin - 5, begin)
        path = TrackPiece(track, begin, way[piece], codes[piece], np.ones(5, np.uint8))
        joined(sweeps, [path])
        path.add_to_track()
    # No sweep saw the way from 0.3 m to 0.6 m.
    assert (track.distance, track.distance_hidden, track.seen_ns) == pytest.approx((0.6, 0.3, 6 * 10**8))
    assert (track.speed_max, track.x, track.path_stop) == pytest.approx((1.0, 0.9, 15))
    rows = joined(sweeps, [TrackPiece(track, 5, way, codes, np.ones(10, np.uint8))])
    assert rows.sweep.tolist() == list(range(45, 55))
    assert rows.parts.tolist() == (codes & PARTS_MASK).tolist()
    assert rows.seen[[4, 8]].tolist() == [HIDDEN, PARTLY]
    assert (rows.x_sd[0], rows.y_sd[0], rows.xy_cov[0]) == pytest.approx((0.02, 0.03, 1e-4))


def test_only_what_lies_between_two_sightings_in_a_row_was_seen() -> None:
    def told(seen: str, sensors: str = "", times: list[float] | None = None) -> str:
        seconds = np.arange(len(seen)) / 10 if times is None else np.array(times)
        sensor = np.array([*map(int, sensors or "0" * len(seen))], np.int32)
        return "".join("-+"[int(step)] for step in observed_steps(seconds, np.array([*seen]) == "x", sensor))

    assert told("xxx..xx.x") == "-++---+--"
    # Of two sensors in turn the second one never sees it, or sees it later.
    assert told("x.x.x.x", "0101010") == "-++++++"
    assert told("x.x..x.x", "01010101") == "-++---++"
    # In a pause of the log nobody saw anything.
    assert told("xxxx", times=[0.0, 0.1, 5.0, 5.1]) == "-+-+"
    assert told("xxxx", times=[0.0, 4.0, 8.0, 12.0]) == "-+++"
    assert told("x") == "-"
    assert told("") == ""
