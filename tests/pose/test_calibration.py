"""The mount with which points fall together, by points and paths that are made up."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.pose.calibration import (
    Outlines,
    cells_filled,
    joined_outlines,
    overlap,
    places_beside,
    solve,
    stretches_of,
    surfaces,
)
from lidarcli.pose.fit import poses_after
from lidarcli.simulation.generate import cast, place
from lidarcli.sweeps.types import Float64
from tests.pipeline.drawn import ROOM, round_about

BEARING = np.deg2rad(np.arange(-180.0, 180.0, 2.0))
BASE = round_about(np.arange(0.0, 20.0, 0.2))


def seen(poses: Float64, noise: float = 0.01, seed: int = 0) -> Outlines:
    """What a sensor with these poses (K, 3) sees of the room."""
    ranges, _ = cast(place(ROOM, poses, np.zeros(len(poses))), np.tile(BEARING, (len(poses), 1)))
    ranges += np.random.default_rng(seed).normal(0.0, noise, ranges.shape)
    parts = []
    for number, row in enumerate(ranges):
        points, normals, beams = surfaces(BEARING, row)
        parts.append(Outlines(points, normals, np.zeros(len(beams), np.int64), np.array([number]), np.array([0.5])))
    return joined_outlines(parts)


def test_surfaces_face_the_sensor() -> None:
    # A wall 2 m ahead, and one beam without a range.
    ranges = 2.0 / np.maximum(np.cos(BEARING), 0.01)
    ranges[np.abs(BEARING) > 0.8] = np.nan
    ranges[90] = np.nan
    points, normals, beams = surfaces(BEARING, ranges)
    assert 90 not in beams
    assert len(beams) > 30
    assert points[:, 0] == pytest.approx(2.0)
    assert normals == pytest.approx(np.tile([-1.0, 0.0], (len(beams), 1)), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (-0.13, 0.05, 0.1), (0.3, -0.2, -0.2)])
def test_a_mount_is_found_from_nothing(mount: tuple[float, float, float]) -> None:
    true = np.array(mount)
    outlines = seen(poses_after(BASE, true))
    stretch = stretches_of(BASE, np.pi, 10.0)
    found = solve(outlines, lambda values: poses_after(BASE, values), np.zeros(3), np.full(3, np.inf), stretch)
    off = np.abs(found.values - true)
    assert off[:2].max() < 0.01
    assert off[2] < 0.005
    assert (off < 4.0 * found.deviations + 1e-3).all()
    assert cells_filled(outlines, poses_after(BASE, found.values)) <= cells_filled(outlines, poses_after(BASE, np.zeros(3)))


@pytest.mark.slow
def test_what_is_fixed_stays() -> None:
    outlines = seen(poses_after(BASE, np.array([0.1, 0.0, 0.0])))
    stretch = np.zeros(len(BASE), np.int64)
    found = solve(outlines, lambda values: poses_after(BASE, values), np.zeros(3), np.array([np.inf, 0.0, 0.0]), stretch)
    assert found.values[1:].tolist() == [0.0, 0.0]
    assert found.deviations[1:].tolist() == [0.0, 0.0]
    assert found.values[0] == pytest.approx(0.1, abs=0.01)


@pytest.mark.slow
def test_on_a_straight_way_the_deviations_of_a_place_are_large() -> None:
    chain = np.column_stack([np.linspace(-2.0, 2.0, 60), np.zeros(60), np.zeros(60)])
    outlines = seen(chain)
    stretch = np.arange(60) // 10
    found = solve(outlines, lambda values: poses_after(chain, values), np.zeros(3), np.full(3, 10.0), stretch)
    assert found.deviations[:2].min() > 0.05


def test_stretches_end_after_a_turn_or_a_way() -> None:
    chain = np.column_stack([np.arange(10.0), np.zeros(10), np.zeros(10)])
    expected = [0, 0, 0, 1, 1, 2, 2, 2, 3, 3]
    assert stretches_of(chain, 1.0, 2.5).tolist() == expected
    assert stretches_of(chain[:, [1, 2, 0]], 2.5, 1.0).tolist() == expected


@pytest.mark.slow
def test_one_sensor_is_laid_on_another() -> None:
    true = np.array([-0.5, 0.3, 2.0])
    first, second = seen(np.zeros((1, 3))), seen(true[None], seed=1)
    best = places_beside(first.points, second.points)
    # The room has two sides: one of the two places is the true one.
    assert min(np.hypot(*(one - true)[:2]) for one in best) < 0.2
    alike = overlap(first.points, second.points, true)
    assert alike.share > 0.8
    assert alike.against < 0.02
    assert alike.width > np.pi
    assert overlap(first.points, second.points, true + np.array([1.0, 0.0, 0.0])).against > 0.1
