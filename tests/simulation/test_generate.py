"""The sensor's faults: how many, of which kind, and the same for the same seed."""

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import START_NS, simulate_blocks, simulate_sweep_arrays
from lidarcli.simulation.scene import Motion, Scene, Sensor
from lidarcli.sweeps.types import concatenate

ROOM = (make.wall([[-3, -3], [3, -3], [3, 3], [-3, 3], [-3, -3]]),)
HALF = (make.wall([[3, -30], [3, 30]]),)


def scene(entities=ROOM, **sensor):
    return Scene("test", replace(Sensor(), **sensor), entities)


def test_a_perfect_sensor_reports_the_geometry():
    raw, entity, things = simulate_sweep_arrays(scene(), 3)
    bearing = np.radians(np.arange(-180, 181))
    expected = 3 / np.maximum(np.abs(np.cos(bearing)), np.abs(np.sin(bearing)))
    np.testing.assert_allclose(raw.ranges, np.tile(expected, (3, 1)), rtol=1e-6)
    assert (entity == 0).all()
    assert things == ROOM
    assert raw.stamp_ns.tolist() == [START_NS, START_NS + 100_000_000, START_NS + 200_000_000]
    assert raw.beams.tolist() == [361] * 3
    assert raw.frame_ids == ("laser",)


@pytest.mark.parametrize(
    ("lost_as", "value"), [("inf", np.inf), ("nan", np.nan), ("zero", 0.0), ("max", 12.0), ("mixed", np.inf)]
)
def test_where_nothing_is_the_sensor_says_so_in_its_way(lost_as, value):
    raw, entity, _ = simulate_sweep_arrays(scene(HALF, lost_as=lost_as, angle_min=-np.pi), 1)
    behind = raw.ranges[0, 0]
    assert np.array_equal(behind, np.float32(value), equal_nan=True)
    assert entity[0, 0] == -1
    assert raw.ranges[0, 180] == 3.0


def test_what_is_too_close_is_minus_infinity():
    raw, entity, _ = simulate_sweep_arrays(scene((make.cylinder(0.1, 0, 0.05),)), 1)
    assert raw.ranges[0, 180] == -np.inf
    assert entity[0, 180] == -1


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("jitter", [0, 3])
def test_neither_blocks_nor_the_length_of_the_run_change_a_sweep(moving, jitter):
    motion = Motion(velocity=(0.2, 0.1)) if moving else Motion()
    things = (*HALF, make.box(1.5, 0, 0.4, 0.3, 0.2, motion))
    faulty = scene(things, noise=0.01, lost=0.05, mixed_pixels=0.5, beams_jitter=jitter)
    whole, entity, _ = simulate_sweep_arrays(faulty, 20, seed=5)
    for size in (1, 7):
        blocks = list(simulate_blocks(faulty, 13, seed=5, size=size))
        joined = concatenate([block.raw for block in blocks])
        width = joined.ranges.shape[1]
        assert np.array_equal(joined.ranges, whole.ranges[:13, :width], equal_nan=True)
        assert np.array_equal(joined.angle_increment, whole.angle_increment[:13])
        owners = [np.pad(b.entity, ((0, 0), (0, width - b.entity.shape[1])), constant_values=-1) for b in blocks]
        assert np.array_equal(np.concatenate(owners), entity[:13, :width])


def test_changing_beam_counts_keep_the_view():
    raw, entity, _ = simulate_sweep_arrays(scene(beams=360, beams_jitter=4), 50)
    assert raw.beams.min() == 356
    assert raw.beams.max() == 364
    np.testing.assert_allclose(raw.angle_increment * raw.beams, np.radians(1) * 360, rtol=1e-6)
    padding = np.arange(raw.ranges.shape[1]) >= raw.beams[:, None]
    assert np.isnan(raw.ranges[padding]).all()
    assert (entity[padding] == -1).all()
    assert (entity[~padding] == 0).all()


def test_mixed_pixels_lie_between_the_surfaces_and_belong_to_nobody():
    things = (*ROOM, make.box(1.5, 0, 0.4, 0.4))
    clean, owner, _ = simulate_sweep_arrays(scene(things), 1)
    raw, entity, _ = simulate_sweep_arrays(scene(things, mixed_pixels=1.0), 1)
    changed = np.flatnonzero(raw.ranges[0] != clean.ranges[0])
    edges = np.flatnonzero(owner[0] == 1)[[0, -1]]
    assert changed.tolist() == edges.tolist()
    assert ((raw.ranges[0, edges] > clean.ranges[0, edges]) & (raw.ranges[0, edges] < 3.1)).all()
    assert (entity[0, edges] == -1).all()
