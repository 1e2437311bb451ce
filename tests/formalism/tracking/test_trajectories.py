"""Trajectories: every sweep of every track, close to where things truly were, with honest standard deviations."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from benchmarks.tracking.cells import Cell, scene_of
from benchmarks.tracking.recordings import Detected, Recording, detected, in_batches, record_cell
from lidarcli.formalism import Parameters
from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.tracking.results import FRAMES, HIDDEN, PARTLY, Tracks, Trajectories
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.sweeps import Float64, Int64

WALKERS = Cell("people", "1081", 0.01, "parked")
DRIVEN = Cell("room", "720", 0.01, "driving")
SEED = 300


def told(recording: Recording) -> tuple[Detected, Int64, Tracks, Trajectories]:
    """What was found, the track of each object, the tracks, and all rows of their trajectories."""
    found = detected(in_batches(recording.batch), Parameters(), recording.entity)
    tracker = Tracker()
    followed, rows = [], []
    for batch, detection in zip(found.batches, found.detections, strict=True):
        followed += tracker.add(batch, detection)
        rows += tracker.trajectories()
    rest, tracks = tracker.finish()
    rows += tracker.trajectories()
    whole = Trajectories(
        *(np.concatenate([getattr(one, field.name) for one in rows]) for field in fields(Trajectories))
    )
    return found, np.concatenate([one.track for one in followed + rest]), tracks, whole


@pytest.fixture(scope="module", params=[WALKERS, DRIVEN], ids=["walkers", "driven"])
def run(request: pytest.FixtureRequest) -> tuple[Cell, Recording, Detected, Int64, Tracks, Trajectories]:
    recording = record_cell(request.param, SEED)
    return (request.param, recording, *told(recording))


Run = tuple[Cell, Recording, Detected, Int64, Tracks, Trajectories]


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
    assert all(
        np.isfinite(values).all() for values in (rows.x, rows.y, rows.vx, rows.vy, rows.x_sd, rows.vx_sd)
    )
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


def errors(run: Run) -> tuple[Float64, Float64, Float64, Float64]:
    """Of agents in sweeps that show one entity alone: error and deviation of place, error of velocity, path ratios."""
    cell, recording, found, track, tracks, rows = run
    scene = scene_of(cell, SEED)
    seconds = np.arange(len(recording.batch)) / scene.sensor.rate
    place = np.stack([entity.poses(seconds)[:, :2] for entity in scene.entities], axis=1)
    if not cell.driving:
        x, y, yaw = scene.path.poses(seconds)[0]
        place = (place - [x, y]) @ np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    velocity = np.gradient(place, seconds, axis=0)
    off, deviation, off_v, ratios = [], [], [], []
    for number in tracks.track[tracks.set == AGENT].tolist():
        mine = np.flatnonzero(track == number)
        entity = int(np.bincount(found.entity[mine] + 1).argmax()) - 1
        mixed = np.unique(found.row[mine[found.entity[mine] != entity]])
        at = np.flatnonzero((rows.track == number) & (rows.seen != HIDDEN) & ~np.isin(rows.sweep, mixed))
        if entity < 0 or not recording.begun[-1, entity] or len(at) < 20:
            continue
        sweep = rows.sweep[at]
        path, true = np.column_stack([rows.x[at], rows.y[at]]), place[sweep, entity]
        off.append(np.hypot(*(path - true).T))
        deviation.append(np.hypot(rows.x_sd[at], rows.y_sd[at]))
        off_v.append(np.hypot(*(np.column_stack([rows.vx[at], rows.vy[at]]) - velocity[sweep, entity]).T))
        ways = [float(np.hypot(*np.diff(one, axis=0).T).sum()) for one in (path, true)]
        ratios.append(ways[0] / ways[1])
    assert len(ratios) >= 3
    return np.concatenate(off), np.concatenate(deviation), np.concatenate(off_v), np.array(ratios)


def test_what_moves_is_where_it_truly_was(run: Run) -> None:
    off, deviation, off_v, ratios = errors(run)
    assert np.sqrt(np.mean(off**2)) < 0.1
    assert np.median(off) < 0.03
    assert np.median(off_v) < 0.05
    assert 0.95 < np.median(ratios) < 1.05
    assert np.mean(off < 2 * deviation) > 0.75
