"""Scenes like real buildings: what they hold, and that the same seed gives the same."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.scenes.building import KINDS, SWEEPS, WAY, building_scene
from benchmarks.scenes.clearance import distance, outline
from benchmarks.scenes.random import SENSORS, cheap
from lidarcli.simulation.generate import simulate_sweep_arrays

SENSOR = SENSORS["361"]


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_building(kind):
    one, other = (building_scene(kind, 7, SENSOR) for _ in range(2))
    assert len(one.entities) == len(other.entities)
    for a, b in zip(one.entities, other.entities, strict=True):
        assert (a.kind, a.x, a.y, a.lost) == (b.kind, b.x, b.y, b.lost)
        np.testing.assert_array_equal(a.segments, b.segments)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(5))
def test_the_sensor_drives_through_nothing(kind, seed):
    scene = building_scene(kind, seed, SENSOR, driving=True)
    poses = scene.sensor_poses(np.arange(SWEEPS) / SENSOR.rate)
    way = np.hypot(*np.diff(poses[[0, -1], :2], axis=0)[0])
    assert way == pytest.approx(WAY * (SWEEPS - 1) / SWEEPS)
    driven = np.array([[*poses[0, :2], *poses[-1, :2]]])
    assert min(distance(outline(entity), driven) for entity in scene.entities) > 0.3


@pytest.mark.parametrize("kind", KINDS)
def test_walls_are_in_pieces_and_things_are_among_them(kind):
    pieces, things = 0, 0
    for seed in range(8):
        scene = building_scene(kind, seed, SENSOR, legged=False)
        _, hit, entities = simulate_sweep_arrays(scene, 1, seed)
        seen = {entities[k].kind for k in np.unique(hit[hit >= 0])}
        pieces += sum(entities[k].wall for k in np.unique(hit[hit >= 0]))
        things += bool(seen - {"wall"})
    assert pieces > 8 * 5
    assert things == 8


def test_a_cheap_sensor_is_noisier_far_away():
    scene = building_scene("chamber", 3, cheap(SENSOR))
    raw, _, _ = simulate_sweep_arrays(scene, 400, 0)
    still = np.isfinite(raw.ranges).mean(axis=0) > 0.5
    ranges = np.where(np.isfinite(raw.ranges), raw.ranges, np.nan)[:, still]
    middle, spread = np.nanmedian(ranges, axis=0), np.nanstd(ranges, axis=0)
    near, far = middle < 1.5, middle > 3.0
    assert np.median(spread[far]) > 1.5 * np.median(spread[near])
    steps = ranges[np.isfinite(ranges) & (ranges < scene.sensor.range_max)] / scene.sensor.resolution
    assert np.abs(steps - np.rint(steps)).max() < 1e-2
