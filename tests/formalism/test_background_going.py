"""Backgrounds by sweeps that take time: each beam is seen from where the sensor was when it was taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.formalism.background import Grid, Shift, align, expected, lines, project, shift
from lidarcli.simulation import scene as make
from lidarcli.sweeps.types import Float64, SweepBatch
from tests.going import SENSORS, Drive, seen_going

ROOM = make.wall([[-5, -4], [5, -4], [5, 4], [-5, 4], [-5, -4]])
THINGS = (ROOM, make.box(2.4, 0.5, 0.6, 0.4, 0.5), make.cylinder(-1.5, 2.0, 0.3))
START = (0.2, -0.3, 0.4)
FAST = np.radians(60.0)
RATES = (
    (0.0, 0.0, FAST),
    (0.0, 0.0, -FAST),
    (0.8, 0.6, 0.0),
    (-0.8, -0.6, 0.5),
    (0.0, 0.0, 1.3 * FAST),
    (0.0, 0.0, -1.3 * FAST),
    (0.5, -0.8, 0.8),
    (-0.5, 0.8, -0.8),
)
"""Ways through one and the same place, as many one way round as the other."""


def going(rate: tuple[float, float, float], sensor: str = "full turn", upside_down: bool = False) -> SweepBatch:
    """A sweep that begins at the place."""
    return seen_going(SENSORS[sensor], Drive(START, rate), *THINGS, upside_down=upside_down)


def parked(sensor: str = "full turn", upside_down: bool = False) -> SweepBatch:
    return going((0.0, 0.0, 0.0), sensor, upside_down)


def without_way(batch: SweepBatch) -> SweepBatch:
    """The same sweeps, as if they took no time."""
    assert batch.poses is not None
    return replace(batch, poses=replace(batch.poses, way=None))


def onto(batch: SweepBatch, still: SweepBatch) -> Shift:
    """Where a sensor was, seen from the parked one."""
    assert batch.poses is not None
    assert still.poses is not None
    return shift(batch.poses, still.poses)


def off(beam: np.ndarray, ranges: Float64, truth: Float64) -> Float64:  # type: ignore[type-arg]
    """How far projected ranges of a sweep are from those of the parked sensor at the same beam [m]."""
    there = (beam >= 0) & ~np.isnan(ranges)
    return np.abs(ranges[there] - truth[beam[there]])


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("rate", RATES[::2])
def test_a_sweep_on_the_way_is_projected_as_the_parked_sensor_sees_it(
    rate: tuple[float, float, float], sensor: str, upside_down: bool
) -> None:
    still, batch = parked(sensor, upside_down), going(rate, sensor, upside_down)
    grid = Grid.of(still, 0)
    truth = still.ranges[0].astype(np.float64)
    right = off(*(part[0] for part in project(batch, grid, onto(batch, still))), truth)
    wrong = off(*(part[0] for part in project(batch, grid, onto(without_way(batch), still))), truth)
    assert np.quantile(right, 0.8) < 0.03
    assert np.mean(wrong) > 4 * np.mean(np.minimum(right, 0.2))


@pytest.mark.parametrize("upside_down", [False, True])
@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("rate", RATES[::2])
def test_what_the_station_sees_is_expected_at_the_beams_of_a_sweep_on_the_way(
    rate: tuple[float, float, float], sensor: str, upside_down: bool
) -> None:
    still, batch = parked(sensor, upside_down), going(rate, sensor, upside_down)
    grid, truth = Grid.of(still, 0), still.ranges.astype(np.float64)
    errors = []
    for each in (batch, without_way(batch)):
        seen = expected(each, grid, truth, onto(each, still))[0]
        known = np.isfinite(seen) & ~np.isnan(batch.ranges[0])
        assert known.mean() > 0.9
        errors.append(np.abs(seen - batch.ranges[0])[known])
    right, wrong = errors
    assert np.quantile(right, 0.8) < 0.03
    assert np.mean(wrong) > 4 * np.mean(np.minimum(right, 0.2))


@pytest.mark.parametrize("rate", RATES)
def test_a_sweep_on_the_way_is_laid_onto_its_station(rate: tuple[float, float, float]) -> None:
    still, batch = parked(), going(rate)
    grid = Grid.of(still, 0)
    known, station = lines(grid, still.ranges.astype(np.float64)), np.zeros(1, np.int64)
    start = onto(batch, still)
    # The odometry is off by 10 cm and two degrees.
    start = replace(start, x=start.x + 0.1, y=start.y - 0.07, yaw=start.yaw + 0.035)
    got = align(batch, grid, known, station, start)
    assert np.hypot(got.x, got.y)[0] < 0.012
    assert abs(got.yaw[0]) < np.deg2rad(0.25)
    assert got.way is start.way
    instant = align(batch, grid, known, station, replace(start, way=None))
    assert abs(instant.yaw[0]) + np.hypot(instant.x, instant.y)[0] > 0.02
