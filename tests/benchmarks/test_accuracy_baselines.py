"""The published segmentations that `make accuracy` compares with, on sweeps worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy.baselines import (
    BASELINES,
    Threshold,
    borges_aldon,
    by_distance,
    dietmayer,
    fixed,
    proportional,
    segments,
    valid_points,
)
from lidarcli.formalism import sweep
from lidarcli.sweeps import TURN, SweepBatch

DEGREE = np.pi / 180


def arc(ranges: list[float], step: float = DEGREE, start: float = 0.0) -> SweepBatch:
    return sweep(ranges, angle_min=start, angle_increment=step)


def groups(batch: SweepBatch, threshold: Threshold) -> list[int]:
    """Segment of every point, renumbered by first appearance."""
    number = segments(valid_points(batch), threshold).tolist()
    order = list(dict.fromkeys(number))
    return [order.index(one) for one in number]


@pytest.mark.parametrize(
    ("threshold", "expected"),
    [
        (fixed, [0.3, 0.3]),
        (proportional, [0.1 + 0.00628 * 2.0, 0.1 + 0.00628 * 5.0]),
        (dietmayer, [0.3 + 2 * np.sin(DEGREE / 2) * 2.0, 0.3 + 2 * np.sin(DEGREE / 2) * 4.0]),
        (
            borges_aldon,
            [3.0 * np.sin(DEGREE) / np.sin(9 * DEGREE) + 0.09, 4.0 * np.sin(DEGREE) / np.sin(9 * DEGREE) + 0.09],
        ),
    ],
    ids=["fixed", "proportional", "dietmayer", "borges_aldon"],
)
def test_formulas(threshold: Threshold, expected: list[float]) -> None:
    here, before = np.array([2.0, 5.0]), np.array([3.0, 4.0])
    assert threshold(here, before, np.full(2, DEGREE)) == pytest.approx(expected, rel=1e-12)


def test_a_step_breaks_where_it_exceeds_the_threshold() -> None:
    ranges = [2.0, 2.0, 2.0, 2.29, 2.29, 2.6, 2.6]
    assert groups(arc(ranges, step=1e-6), fixed) == [0, 0, 0, 0, 0, 1, 1]


def test_distances_are_euclidean() -> None:
    """At 20 m neighbouring beams of one degree are 0.349 m apart, whatever their ranges."""
    assert groups(arc([20.0] * 3), fixed) == [0, 1, 2]
    assert groups(arc([20.0] * 3), dietmayer) == [0, 0, 0]


def test_a_lost_beam_is_skipped() -> None:
    assert groups(arc([2.0, 2.0, np.inf, 2.0, np.nan, 2.0]), fixed) == [0, 0, 0, 0]


@pytest.mark.parametrize("beams", [360, 361])
def test_the_seam_of_a_full_turn_is_closed(beams: int) -> None:
    ranges = [9.0] * beams
    ranges[:3] = ranges[-3:] = [1.0] * 3
    number = groups(sweep(ranges, angle_min=-np.pi, angle_increment=TURN / 360), dietmayer)
    assert number[:3] == number[-3:] == [0, 0, 0]
    assert set(number[3:-3]) == {1}


def test_the_seam_of_a_partial_view_is_not() -> None:
    number = groups(arc([1.0] * 3 + [9.0] * 200 + [1.0] * 3), dietmayer)
    assert number[:3] == [0, 0, 0]
    assert number[-3:] == [2, 2, 2]


def test_a_turn_of_one_surface_is_one_segment() -> None:
    assert set(groups(sweep([2.0] * 360, angle_increment=TURN / 360), fixed)) == {0}


def test_rows_do_not_touch_each_other() -> None:
    batch = sweep([[2.0] * 3, [np.inf] * 3, [2.0] * 3], angle_min=0.0, angle_increment=DEGREE)
    assert groups(batch, fixed) == [0, 0, 0, 1, 1, 1]


@pytest.mark.parametrize("name", BASELINES)
def test_detections_have_three_points_and_two_metres(name: str) -> None:
    """Background at 9 m; a thing of two points, one of three, and a wall across the view."""
    ranges = np.full(720, np.inf)
    ranges[100:102] = 3.0
    ranges[200:203] = 3.0
    wall = np.arange(300, 420)
    ranges[wall] = 2.0 / np.cos((wall - 360) * TURN / 720)
    labels = BASELINES[name](sweep(ranges.tolist(), angle_min=0.0, angle_increment=TURN / 720))
    assert np.flatnonzero(labels[0]).tolist() == [200, 201, 202]
    assert len(np.unique(labels[0])) == 2


def test_width_is_measured_in_every_direction() -> None:
    """A wall around the sensor has a chord of nothing, yet is no object; neither is a diagonal of 2.1 m."""
    round_wall = sweep([2.0] * 360, angle_min=0.0, angle_increment=TURN / 360)
    assert not by_distance(fixed)(round_wall).any()
    ranges = [1.05 / np.cos((n - 45) * DEGREE) for n in range(91)]
    assert not by_distance(fixed)(arc(ranges)).any(), "2.1 m from end to end"
    shorter = [0.97 / np.cos((n - 45) * DEGREE) for n in range(91)]
    assert by_distance(fixed)(arc(shorter)).all(), "1.94 m from end to end"


def test_no_points_no_detections() -> None:
    batch = arc([np.inf] * 5)
    for method in BASELINES.values():
        assert not method(batch).any()
