"""Samples of zones, what a sweep sees of them, and distances, by closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.zones import SAMPLES, bounds, samples, seen
from lidarcli.masks import Circle, Polygon
from lidarcli.range_rules import RangeRules, normalise
from lidarcli.sweeps import SweepPoses
from lidarcli.zone import inside
from tests.sweeping import raw_sweeps, round_room

SQUARE = Polygon(((1.0, -1.0), (3.0, -1.0), (3.0, 1.0), (1.0, 1.0)))


def here(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, down: bool = False) -> SweepPoses:
    return SweepPoses(np.array([x]), np.array([y]), np.array([yaw]), np.array([down]))


@pytest.mark.parametrize("shape", [SQUARE, Circle(0.5, -2.0, 0.3), Polygon(((0, 0), (9, 0.1), (9, 0)))])
def test_samples_fill_a_shape_evenly(shape: Polygon | Circle) -> None:
    places = samples(shape)
    assert places.shape == (SAMPLES, 2)
    assert inside(shape, *places.T).all()
    x, y, radius = bounds(shape)
    assert np.hypot(places[:, 0] - x, places[:, 1] - y).max() <= radius
    middle = np.median(places, axis=0)
    quarters = (places[:, 0] > middle[0]).astype(int) * 2 + (places[:, 1] > middle[1])
    assert len(np.unique(places.round(9), axis=0)) == SAMPLES
    if shape is SQUARE:
        assert np.bincount(quarters).tolist() == pytest.approx([16] * 4, abs=4)


@pytest.mark.parametrize("down", [False, True])
def test_a_wall_hides_what_is_behind_it_and_the_view_ends(down: bool) -> None:
    # Half a turn ahead, a wall at 2 m to the left of the sensor's x axis, 4 m to its right.
    ranges = round_room(1, 181)
    ranges[:, 90:] = 2.0
    raw = raw_sweeps(ranges, angle_min=-0.5 * math.pi, angle_increment=math.pi / 180)
    batch = normalise(raw, np.arange(1), RangeRules())
    places = np.array([[1.0, 1.0], [2.0, 2.0], [2.0, -2.0], [-1.0, 0.1], [0.05, 0.0], [3.9, -0.5], [4.2, -0.5]])
    told = seen(batch, here(down=down), places * (1.0, -1.0 if down else 1.0))[0]
    assert told.tolist() == [True, False, True, False, False, True, False]
    turned = seen(batch, here(yaw=math.pi, down=down), -places * (1.0, -1.0 if down else 1.0))[0]
    assert turned.tolist() == told.tolist()
