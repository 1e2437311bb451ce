"""Boxes of things by all that a run hit of them, and how far their sides may go on, on a drawn ground."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN, Occupancy
from lidarcli.formalism.matching.alignment import StaticObjects
from lidarcli.formalism.matching.extents import boxes_of, contained, each_of, measured, rectangles, within
from lidarcli.formalism.matching.free_space import SpaceMap, of_map
from lidarcli.formalism.matching.pairs import Pairs, Side, pairs_of, probabilities, same_sizes
from lidarcli.sweeps.types import Float64

SIDE = 0.05


def ground(*hits: Float64, unseen: Float64 | None = None) -> SpaceMap:
    """A square of 6 m that was seen free but for some hits (K, 2), and a box that was not seen."""
    cells = np.full((120, 120), FREE, np.int8)
    row, column = np.indices(cells.shape)
    middle = np.column_stack([column.ravel(), row.ravel()]) * SIDE + 0.5 * SIDE - 3.0
    if unseen is not None:
        cells[within(middle, unseen, 0.0).reshape(cells.shape)] = UNKNOWN
    for points in hits:
        at = np.floor((points + 3.0) / SIDE).astype(int)
        cells[at[:, 1], at[:, 0]] = OCCUPIED
    return of_map(Occupancy(SIDE, -3.0, -3.0, cells))


def line(x0: float, y0: float, x1: float, y1: float) -> Float64:
    steps = np.linspace(0.0, 1.0, 60)[:, None]
    points: Float64 = np.array([x0, y0]) + steps * np.array([x1 - x0, y1 - y0])
    return points


def standing(*rows: tuple[float, float, float, float]) -> StaticObjects:
    x, y, length, width = np.array(rows, float).reshape(-1, 4).T
    code = np.full(len(x), -1, np.int32)
    return StaticObjects(x, y, length, width, np.full(len(x), 0.003), np.full(len(x), 0.003), code, code)


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.2, -0.7])
def test_two_faces_tell_a_rectangle(angle: float) -> None:
    faces = np.concatenate([line(-0.4, -0.25, 0.4, -0.25), line(0.4, -0.25, 0.4, 0.25)])
    cos, sin = math.cos(angle), math.sin(angle)
    places = faces @ np.array([[cos, sin], [-sin, cos]]) + [1.0, 2.0]
    x, y, yaw, length, width = rectangles(places, np.zeros(1, np.int64))[0]
    assert (x, y, length, width) == pytest.approx((1.0, 2.0, 0.8, 0.5), abs=0.01)
    assert math.sin(yaw - angle) == pytest.approx(0.0, abs=0.01)


def test_a_track_that_measured_too_little_is_measured_by_its_hits() -> None:
    """Both faces were hit, and what is behind them was not seen; the track knew one end of one face."""
    front, end = line(-0.4, -0.25, 0.4, -0.25), line(0.4, -0.25, 0.4, 0.25)
    seen = ground(front, end, unseen=np.array([0.0, 0.0, 0.0, 0.78, 0.5]))
    small = standing((0.2, -0.2, 0.4, 0.1))
    things, yaw, kept = measured(small, np.zeros(1), seen)
    assert (things.length[0], things.width[0]) == pytest.approx((0.8, 0.5), abs=0.06)
    assert (things.x[0], things.y[0], yaw[0]) == pytest.approx((0.0, 0.0, 0.0), abs=0.05)
    assert kept.tolist() == [0]
    # What holds all of its hits stays as the track measured it, which is finer.
    right = standing((0.0, 0.0, 0.8, 0.5))
    assert measured(right, np.zeros(1), seen)[0].length.tolist() == [0.8]


def side(things: StaticObjects, more: tuple[float, float]) -> Side:
    count = len(things)
    return Side(things, np.zeros(count), np.tile(more, (count, 1)), np.ones(count))


def test_a_hidden_side_is_a_least_one() -> None:
    """A face of 0.8 m with up to 1 m of unseen ground behind it may be that of a box with such a side, and of no other."""
    face = side(standing((0.0, 0.0, 0.8, 0.06)), (0.0, 1.0))
    boxes = side(
        standing((2.0, 0.0, 0.8, 0.5), (2.0, 0.0, 0.9, 0.8), (2.0, 0.0, 0.7, 0.5), (2.0, 0.0, 1.5, 0.8)), (0.0, 0.0)
    )
    hidden, crossed, short, long = same_sizes(face, boxes).tolist()
    assert hidden > 2.5
    assert crossed == pytest.approx(hidden, abs=0.1)
    assert short < 0.0
    assert long < hidden - 2.0
    whole = side(face.things, (0.0, 0.0))
    assert same_sizes(whole, boxes)[0] < 0.0


def test_of_two_candidates_the_one_that_fits_is_it_and_of_like_ones_none() -> None:
    here = side(standing((0.0, 0.0, 0.8, 0.5)), (0.0, 0.0))
    there = side(standing((2.0, 0.0, 0.81, 0.49), (0.0, 2.0, 0.6, 0.5)), (0.0, 0.0))
    pairs = Pairs(np.array([0, 0]), np.array([0, 1]), np.zeros(2, bool))
    first, second = probabilities(here, there, pairs).tolist()
    assert first > 0.9
    assert second < 0.05
    like = side(standing((2.0, 0.0, 0.8, 0.5), (0.0, 2.0, 0.8, 0.5)), (0.0, 0.0))
    assert probabilities(here, like, pairs).tolist() == pytest.approx([0.49, 0.49], abs=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_pairs_leave_out_only_those_that_cannot_be_one_thing(seed: int) -> None:
    """A hall of 300 things, of which some were moved, gone or come: the same probabilities as of all pairs."""
    rng = np.random.default_rng(seed)
    spread, sizes = 40.0, np.sort(rng.uniform(0.2, 2.0, (300, 2)), axis=1)[:, ::-1]
    places = rng.uniform(0.0, spread, (300, 2))
    moved = np.where(
        rng.random((300, 1)) < 0.1, rng.uniform(0.0, spread, (300, 2)), places + rng.normal(0.0, 0.05, (300, 2))
    )
    things = [standing(*np.column_stack([each, sizes])[rng.random(300) < 0.9]) for each in (places, moved)]
    one, other = (
        Side(each, rng.uniform(0.0, 3.0, len(each)), np.zeros((len(each), 2)), rng.random(len(each)) ** 4)
        for each in things
    )
    some = pairs_of(one, other)
    assert len(some.first) < 0.1 * len(things[0]) * len(things[1])
    near = np.zeros((len(things[0]), len(things[1])), np.bool_)
    near[some.first, some.second] = some.near
    i, j = (part.ravel() for part in np.indices(near.shape))
    every = probabilities(one, other, Pairs(i, j, near.ravel()))
    chance = np.zeros(near.shape)
    chance[some.first, some.second] = probabilities(one, other, some)
    np.testing.assert_allclose(chance.ravel(), every, rtol=0.0, atol=1e-12)
    boxes, points = boxes_of(one.things, one.yaw), rng.uniform(0.0, spread, (2000, 2))
    inside = each_of(*contained(boxes, points, 0.05), len(boxes))
    assert [each.tolist() for each in inside] == [np.flatnonzero(within(points, box, 0.05)).tolist() for box in boxes]
    close = np.hypot(*(things[0].column.x - things[1].x, things[0].column.y - things[1].y)) <= 0.2
    assert near[close].all()
