"""Persons on routes: the leg that stands does not move over ground."""

import numpy as np
import pytest

from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import place
from lidarcli.simulation.route import AHEAD, Waypoint, feet, plan_route, step_length
from lidarcli.simulation.scene import Motion
from tests.simulation.test_route import random_route

GAP = 0.24
STRAIGHT = plan_route([Waypoint(0, 0, 1.0, wait=1.0), Waypoint(7, 0, 1.0)])


def test_steps_grow_with_the_speed_and_the_cadence_follows():
    assert step_length(np.array([0.2, 0.6, 1.0, 1.4, 2.0])) == pytest.approx([0.6, 0.6, 0.7, 0.8, 0.8])


def test_one_leg_stands_while_the_other_swings():
    seconds = np.arange(0, STRAIGHT.duration + 2, 0.001)
    legs = feet(STRAIGHT, GAP, seconds)
    speed = np.linalg.norm(np.diff(legs, axis=0), axis=2) / 0.001
    # At no time do both move, and most of the time on the way one of them does.
    assert (speed.min(axis=1) == 0).all()
    walking = (seconds[:-1] > 1.6) & (seconds[:-1] < 7.4)
    assert 0.7 < (speed.max(axis=1)[walking] > 0).mean() < 0.95
    # 7 m are ten steps of 0.7 m: eleven footholds, each leg on every second one.
    for side in (0, 1):
        at, times = np.unique(legs[:, side, 0].round(9), return_counts=True)
        long = at[times > 100]
        steps = [0, *np.arange(1, 10, 2), 10] if side else np.arange(0, 11, 2)
        assert long == pytest.approx(0.7 * np.array(steps))
        assert legs[:, side, 1] == pytest.approx(GAP / 2 * (1 - 2 * side))


def test_who_pauses_has_both_legs_beside_each_other():
    legs = feet(STRAIGHT, GAP, np.array([-1.0, 0.0, 0.9, 8.6, 50.0]))
    expected = [[[x, GAP / 2], [x, -GAP / 2]] for x in (0, 0, 0, 7, 7)]
    np.testing.assert_allclose(legs, expected, atol=1e-12)


@pytest.mark.parametrize("seed", range(10))
def test_on_any_route_legs_keep_apart_and_near_the_body(seed):
    route = random_route(seed)
    seconds = np.arange(0, route.duration + 1, 0.002)
    legs, body = feet(route, GAP, seconds), route.poses(seconds)[:, :2]
    apart = np.linalg.norm(legs[:, 0] - legs[:, 1], axis=1)
    assert apart.min() > 0.8 * GAP
    assert apart.max() < np.hypot(0.9, GAP)
    assert np.linalg.norm(legs - body[:, None], axis=2).max() <= np.hypot(AHEAD * 0.88, GAP / 2)
    speed = np.linalg.norm(np.diff(legs, axis=0), axis=2) / 0.002
    # Two legs move within one such moment only where one lands as the other lifts off.
    assert speed.min(axis=1).max() < 0.05
    assert speed.max() < 8


def test_turning_on_the_spot_is_done_leg_by_leg():
    route = plan_route([Waypoint(0, 0, 1.0), Waypoint(2, 0, 1.0, wait=1.0), Waypoint(0, 0, 1.0)], turn_rate=1.0)
    state = route.state(seconds := np.arange(0, route.duration, 0.005))
    turning = state.yaw_rate != 0
    legs = feet(route, GAP, seconds)[turning]
    assert np.linalg.norm(legs - [2, 0], axis=2) == pytest.approx(GAP / 2)
    # The sides are exchanged: it has turned by half a turn.
    assert legs[0, 0] == pytest.approx([2, GAP / 2], abs=0.01)
    assert legs[-1, 0] == pytest.approx([2, -GAP / 2], abs=0.01)


def test_the_sensor_sees_the_legs_where_they_are():
    person = make.person(0, 0, gap=GAP, motion=Motion(route=STRAIGHT))
    seconds = np.array([0.5, 2.3, 4.1])
    origin = np.tile([1.0, -2.0, np.pi / 2], (3, 1))
    circles = place((person,), origin, seconds).circles
    legs = feet(STRAIGHT, GAP, seconds)
    # Seen by a sensor that looks along +y: x ahead is the world's y, y to the left the world's -x.
    np.testing.assert_allclose(circles[..., 0], legs[..., 1] + 2, atol=1e-12)
    np.testing.assert_allclose(circles[..., 1], 1 - legs[..., 0], atol=1e-12)
    assert person.velocities(seconds)[:, 0] == pytest.approx([0, 1, 1])
