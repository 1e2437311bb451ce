"""Whether a body is a thing or building is decided by all sweeps that saw its place."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism import Detection, Parameters, detect, sweep
from lidarcli.formalism.detection import NOISE, OBJECT, WALL
from lidarcli.formalism.mapping import places, rays
from lidarcli.formalism.mapping.places import Places
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Entity
from lidarcli.sweeps.types import SweepBatch
from lidarcli.system import native
from tests.formalism.tracking.following import batches, scene_of, simulated

EVERYTHING = Parameters(min_thing=0.0)
SWEEPS = 60
DRIVE = Course(np.array([[-3.0, -2.0], [3.0, -2.0], [3.0, 2.0], [-3.0, 2.0]]), speed=1.0)
BOXES = make.box(2.0, 1.0, 0.5, 0.4), make.box(2.0, -1.0, 0.4, 0.5)


def judged(*pieces: SweepBatch) -> list[Detection]:
    """What is found in the batches of one topic, as its places say in the end."""
    known = Places()
    found = [detect(each, EVERYTHING) for each in pieces]
    worlds = [known.add(each, one) for each, one in zip(pieces, found, strict=True)]
    return [known.judged(*each, 0.0) for each in zip(pieces, found, worlds, strict=True)]


def parked(*entities: Entity, sweeps: int = SWEEPS) -> SweepBatch:
    return simulated(scene_of(*entities), sweeps)


def by_places(batch: SweepBatch, found: Detection, least: float = 0.3) -> Detection:
    known = Places()
    return known.judged(batch, found, known.add(batch, found), least)


def with_shares(found: Detection, left: Any) -> Detection:
    """As if what is to the left were a thing with these probabilities, sweep by sweep, and the rest surely."""
    return replace(found, thing=np.where(found.y > 0, left[found.row], 0.95))


def test_what_is_mostly_taken_for_building_is_building_in_every_sweep() -> None:
    batch = parked(*BOXES)
    shares = np.full(SWEEPS, 0.1)
    shares[::6] = 0.8
    found = with_shares(detect(batch, EVERYTHING), shares)
    one = by_places(batch, found)
    left = found.y > 0
    assert (one.set[left] == NOISE).all()
    assert (one.shape[left] == WALL).all()
    assert (one.set[~left] == OBJECT).all()


def test_a_sensor_that_stands_has_a_place_for_every_stop() -> None:
    batch = parked(*BOXES)
    still = np.ones(SWEEPS, np.bool_)
    still[[20, 40]] = False
    shares = np.repeat([0.9, 0.05, 0.9], SWEEPS // 3)
    found = with_shares(detect(batch, EVERYTHING), shares)
    one = by_places(replace(batch, still=still, poses=None), found)
    left = found.y > 0
    # The sweep with which a stop begins is not known to stand.
    middle = (found.row >= 20) & (found.row < 40)
    np.testing.assert_array_equal(one.set[left & middle], NOISE)
    np.testing.assert_array_equal(one.set[left & ~middle], OBJECT)


def test_a_cupboard_is_told_from_a_short_wall_over_a_drive() -> None:
    """Single sweeps are in doubt of both; past the gaps of a fence a wall is seen in strips."""
    cupboard = make.box(0.0, 0.6, 0.9, 0.45)
    fence = [make.box(-4.0 + 0.9 * k, 3.1, 0.5, 0.3) for k in range(9)]
    batch = simulated(scene_of(cupboard, *fence, path=DRIVE), 240)
    found = detect(batch, EVERYTHING)
    assert batch.poses is not None
    x, y, _ = batch.poses.to_world(found.row, found.box_x, found.box_y, found.box_yaw)
    thing, wall = np.hypot(x, y - 0.6) < 0.5, y > 3.7
    assert thing.sum() > 200
    assert wall.sum() > 200
    odds = np.where(wall, -0.5, 0.5) + np.random.default_rng(7).normal(0.0, 2.0, len(found))
    doubtful = replace(found, thing=1.0 / (1.0 + np.exp(-odds)))
    alone, by_place = doubtful.thing >= 0.5, by_places(batch, doubtful, 0.5).set == OBJECT
    assert alone[thing].mean() < 0.8
    assert by_place[thing].all()
    assert alone[wall].mean() > 0.3
    assert by_place[wall].mean() < 0.1


@pytest.mark.parametrize(("path", "stops"), [(None, 0), (DRIVE, 0), (DRIVE, 17)])
def test_batches_of_any_size_give_the_same(path: Course | None, stops: int) -> None:
    scene = scene_of(*BOXES) if path is None else scene_of(*BOXES, path=path)
    batch = simulated(scene, SWEEPS)
    if stops:
        # During some sweeps the sensor goes on.
        assert batch.poses is not None
        way = np.tile([0.1, 0.02, 0.01], (SWEEPS, 1))
        way[stops : 2 * stops] = 0.0
        batch = replace(batch, poses=replace(batch.poses, way=way))
    (whole,) = judged(batch)
    for size in (1, 7, 31):
        parts = judged(*batches(batch, size))
        for name in ("thing", "place"):
            np.testing.assert_array_equal(
                np.concatenate([getattr(each, name) for each in parts]), getattr(whole, name), strict=True
            )


def test_sweeps_far_away_and_many_stops_take_no_memory() -> None:
    batch = simulated(scene_of(*BOXES, path=DRIVE), SWEEPS)
    assert batch.poses is not None
    x = batch.poses.x.copy()
    x[10:20] += 1e7
    x[20:25] = np.nan
    wild = replace(batch, poses=replace(batch.poses, x=x), still=np.zeros(SWEEPS, np.bool_))
    found = detect(wild, EVERYTHING)
    np.testing.assert_array_equal(np.isnan(by_places(wild, found).place), (found.row >= 10) & (found.row < 25))
    known = Places()
    still = np.arange(SWEEPS) % 2 > 0
    stops = replace(batch, poses=None, still=still)
    worlds = known.add(stops, detect(stops, EVERYTHING))
    assert len(np.unique(worlds[worlds >= 0])) == len(known._grounds) <= places.MAX_STOPS


def plain(name: str) -> ModuleType:
    """The source of the loops as plain Python, whatever was built from it."""
    path = Path(rays.__file__).parent / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"plain_{name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_source_gives_the_same_bits_with_every_index_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    batch = simulated(scene_of(*BOXES, path=DRIVE), 12)
    (compiled,) = judged(batch)
    monkeypatch.setattr(native, "_BOUNDS", True)
    source = plain("rays")
    monkeypatch.setattr(places, "rays", source)
    (checked,) = judged(batch)
    for name in ("thing", "place"):
        np.testing.assert_array_equal(getattr(compiled, name), getattr(checked, name), strict=True)


def heard(ranges: list[float], begin: list[int], end: list[int]) -> list[tuple[int, int]]:
    """Sum and number of the votes in the cell that each beam ends in; body k votes k + 1, a surface -9."""
    seen = sweep(ranges, angle_min=0.0, angle_increment=0.1)
    bodies: Any = SimpleNamespace(row=np.zeros(len(begin)), beam_i=np.array(begin), beam_f=np.array(end))
    ends = rays.Ends(seen, bodies, np.array([[0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 3)), 15.0, 0.3)
    cells, row = np.zeros((400, 400), np.int64), np.zeros(1, np.int64)
    rays.cast(ends, row, np.arange(len(begin)) + 1, -9, cells, 0.1, -200, -200)
    theta = seen.bearings[0]
    x, y = seen.ranges[0] * np.cos(theta), seen.ranges[0] * np.sin(theta)
    column, line = (np.floor(np.where(seen.ranges[0] <= 15.0, at, 19.9) / 0.1).astype(int) + 200 for at in (x, y))
    # Only the source shows its constants.
    total, count = np.divmod(cells[line, column], 1 << plain("rays").COUNT_BITS)
    return list(zip(total.tolist(), count.tolist(), strict=True))


def test_a_body_within_another_has_its_own_beams_and_scraps_are_no_surface() -> None:
    nothing, surface = (0, 0), (-9, 1)
    ranges = 11 * [3.0] + 2 * [2.0] + 2 * [3.0] + [np.nan] + 4 * [15.1]
    row = [nothing, (1, 1), (1, 1), (2, 1), (1, 1), nothing, (3, 1), (3, 1), nothing, surface] + 10 * [nothing]
    assert heard(ranges, [1, 3, 6], [4, 3, 7]) == row
    # Across the seam.
    whole = heard(16 * [3.0], [14], [1])
    assert [k for k, told in enumerate(whole) if told == (1, 1)] == [0, 1, 14, 15]
    assert whole[2:14] == [nothing, *(10 * [surface]), nothing]


def test_each_sensor_of_a_topic_has_places_of_its_own() -> None:
    """What one of two sensors in turns sees as building is at the same place before it as a thing before the other one."""
    batch = parked(make.box(2.0, 1.0, 0.5, 0.4))
    found = detect(batch, EVERYTHING)
    rear = np.arange(SWEEPS) % 2
    found = replace(found, thing=np.where(rear[found.row] == 1, 0.05, 0.95))
    both = replace(batch, frame_ids=("front", "rear"), frame=rear.astype(np.int32))
    one = by_places(both, found)
    np.testing.assert_array_equal(one.set == OBJECT, rear[found.row] == 0)
    assert len({*Places().add(both, found).tolist()}) == 2
    # All of them together say neither.
    assert len({*by_places(batch, found).set.tolist()}) == 1


def test_the_sensors_of_a_robot_judge_one_place_together() -> None:
    """What one of two sensors sees as building and the other one as a thing is the same for both, by all their sweeps."""
    batch = simulated(scene_of(make.box(2.0, 1.0, 0.5, 0.4), path=DRIVE), SWEEPS)
    found = detect(batch, EVERYTHING)
    keys = tuple((topic, batch.frame_ids[0]) for topic in ("/front", "/rear"))
    sets = {}
    for robot in ((), keys):
        known = Places()
        sensors = [
            (replace(batch, topic=topic, robot=robot), replace(found, thing=np.full(len(found), share)))
            for (topic, _), share in zip(keys, (0.95, 0.2), strict=True)
        ]
        worlds = [known.add(*each) for each in sensors]
        sets[robot] = [known.judged(*each, there, 0.3).set for each, there in zip(sensors, worlds, strict=True)]
    assert set(sets[()][0].tolist()) == {OBJECT}
    assert set(sets[()][1].tolist()) == {NOISE}
    np.testing.assert_array_equal(*sets[keys])
    assert set(sets[keys][0].tolist()) == {OBJECT}
