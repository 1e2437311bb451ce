"""Beams that flicker: so many as wanted, in runs, others in every sweep, most where it is far or dark."""

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import Scene, Sensor

ROOM = make.wall([[-8, -2], [8, -2], [8, 2], [-8, 2], [-8, -2]])
SENSOR = Sensor(beams=720, angle_increment=2 * np.pi / 720, flicker=0.2)


def gone_of(sensor, things=(ROOM,), sweeps=200, seed=0):
    raw, entity, _ = simulate_sweep_arrays(Scene("", sensor, things), sweeps, seed)
    gone = ~np.isfinite(raw.ranges)
    assert (entity[gone] == -1).all()
    assert (entity[~gone] >= 0).all()
    return gone


@pytest.mark.parametrize("share", [0.05, 0.2, 0.6])
def test_so_many_as_wanted_in_every_sweep(share):
    gone = gone_of(replace(SENSOR, flicker=share))
    assert gone.mean() == pytest.approx(share, rel=0.03)


def test_only_what_would_return_counts():
    # Half of the view holds nothing: of the other half, a fifth flickers.
    wall = make.wall([[2, -300], [2, 300]])
    gone = gone_of(replace(SENSOR, range_max=500.0), (wall,))
    bearing = np.abs(SENSOR.bearings())
    assert gone[:, bearing > np.pi / 2].all()
    assert gone[:, bearing < 1.55].mean() == pytest.approx(0.2, rel=0.05)


def test_far_beams_flicker_more_than_near_ones():
    quiet = replace(SENSOR, flicker=0.0)
    raw, _, _ = simulate_sweep_arrays(Scene("", quiet, (ROOM,)), 1)
    ratio = []
    for seed in range(20):
        gone = gone_of(SENSOR, sweeps=20, seed=seed)
        ratio.append((gone[:, raw.ranges[0] > 6].mean(), gone[:, raw.ranges[0] < 3].mean()))
    far, near = np.mean(ratio, axis=0)
    assert far > 2.5 * near


def test_dark_things_flicker_more():
    things = [make.cylinder(3 * np.cos(a), 3 * np.sin(a), 0.5) for a in np.arange(8) * np.pi / 4]
    _, entity, _ = simulate_sweep_arrays(Scene("", replace(SENSOR, flicker=0.0), tuple(things)), 1)
    gone = gone_of(SENSOR, tuple(things), seed=3)
    shares = [gone[:, entity[0] == number].mean() for number in range(8)]
    assert max(shares) > 2 * np.median(shares)
