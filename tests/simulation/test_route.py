"""Routes: exact positions and velocities within the limits of the body; and the legs of persons on them."""

import numpy as np
import pytest

from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import place
from lidarcli.simulation.route import AHEAD, Route, Waypoint, feet, plan_route, step_length
from lidarcli.simulation.scene import SceneMotion

STRAIGHT = plan_route([Waypoint(1, 2, 1.0), Waypoint(5, 2, 1.0)])
"""4 m at 1 m/s: half a second to start, half to stop, 3.5 s between."""


def random_route(seed: int) -> Route:
    rng = np.random.default_rng(seed)
    points = [
        Waypoint(*rng.uniform(-5, 5, 2), rng.uniform(0.15, 1.5), rng.choice([0, 0, 1.0]), rng.choice(["round", "stop"]))
        for _ in range(int(rng.integers(2, 7)))
    ]
    return plan_route(points, loop=bool(rng.integers(2)))


def test_a_straight_way_is_a_trapezium_of_speed():
    assert STRAIGHT.duration == pytest.approx(4.5)
    state = STRAIGHT.state(np.array([-1.0, 0.0, 0.25, 0.5, 2.0, 4.25, 4.5, 99.0]))
    assert state.x - 1 == pytest.approx([0, 0, 0.0625, 0.25, 1.75, 3.9375, 4, 4])
    assert state.y == pytest.approx(2)
    assert state.speed == pytest.approx([0, 0, 0.5, 1, 1, 0.5, 0, 0])
    assert state.speed[[0, 1, 6, 7]].tolist() == [0, 0, 0, 0]
    assert state.heading == pytest.approx(0)


def test_a_round_corner_is_an_arc_as_fast_as_the_pull_to_the_side_allows():
    route = plan_route([Waypoint(0, 0, 1.5), Waypoint(5, 0, 1.5), Waypoint(5, 5, 1.5)], corner_radius=0.5)
    seconds = np.linspace(0, route.duration, 2001)
    state = route.state(seconds)
    arc = np.abs(state.yaw_rate) > 1e-9
    away = np.hypot(state.x - 4.5, state.y - 0.5)[arc]
    assert away == pytest.approx(0.5)
    # The square root of acceleration × radius is 1 m/s.
    assert state.speed[arc].max() <= 1 + 1e-9
    assert state.yaw_rate[arc] == pytest.approx(state.speed[arc] / 0.5)
    assert state.heading[[0, -1]] == pytest.approx([0, np.pi / 2])


def test_pauses_and_turns_on_the_spot():
    points = [Waypoint(0, 0, 1.0, wait=0.5), Waypoint(1, 0, 1.0, wait=2.0), Waypoint(1, 1, 1.0)]
    route = plan_route(points, turn_rate=1.0)
    # Half a second, 1 m in 1.5 s, two seconds, a turn of π/2 at 1 rad/s at most, 1 m in 1.5 s.
    turning = 1.5 * np.pi / 2
    assert route.duration == pytest.approx(5.5 + turning)
    state = route.state(np.array([0.4, 2.1, 3.9, 4.0 + turning / 2, 4.0 + turning]))
    assert state.speed == pytest.approx(0)
    assert state.x == pytest.approx([0, 1, 1, 1, 1])
    assert state.heading == pytest.approx([0, 0, 0, np.pi / 4, np.pi / 2])
    assert state.yaw_rate == pytest.approx([0, 0, 0, 1, 0])


def test_a_loop_comes_back_and_goes_on():
    square = [Waypoint(0, 0, 1.0), Waypoint(2, 0, 1.0), Waypoint(2, 2, 1.0), Waypoint(0, 2, 1.0)]
    route = plan_route(square, loop=True)
    seconds = np.linspace(0, route.duration, 50, endpoint=False)
    first, second = route.poses(seconds), route.poses(seconds + route.duration)
    np.testing.assert_allclose(first, second, atol=1e-9)
    end = route.poses(np.array([route.duration - 1e-6]))
    np.testing.assert_allclose(end[0], [0, 0, 2 * np.pi], atol=1e-5)


@pytest.mark.parametrize("seed", range(20))
def test_velocities_are_the_slope_of_the_poses_and_bounded(seed):
    route = random_route(seed)
    # Not where a round ends and the heading falls back by whole turns.
    seconds = np.arange(-1, route.duration - 0.1, 0.01) + 0.00123
    step = 1e-6
    slope = (route.poses(seconds + step) - route.poses(seconds - step)) / (2 * step)
    velocity = route.state(seconds).velocities()
    # Only at the joints of phases does the acceleration jump within the step.
    assert np.mean(np.abs(slope - velocity).max(axis=1) > 1e-5) < 0.005
    change = np.diff(route.state(seconds).speed) / 0.01
    assert np.abs(change).max() <= 2 + 1e-6
    pull = velocity[:, 2] * np.hypot(velocity[:, 0], velocity[:, 1])
    assert np.abs(pull).max() <= 2 + 1e-6
    assert np.hypot(velocity[:, 0], velocity[:, 1]).max() <= max(point.speed for point in route.waypoints) + 1e-9


@pytest.mark.parametrize(
    ("points", "limits"),
    [
        ([Waypoint(0, 0, 1.0)], {}),
        ([Waypoint(0, 0, 1.0), Waypoint(0, 0, 1.0)], {}),
        ([Waypoint(0, 0, 1.0), Waypoint(1, 0, 1.0)], {"acceleration": 0.0}),
    ],
)
def test_what_is_no_route_is_refused(points, limits):
    with pytest.raises(ValueError, match="route"):
        plan_route(points, **limits)


GAP = 0.24
WALK = plan_route([Waypoint(0, 0, 1.0, wait=1.0), Waypoint(7, 0, 1.0)])


def test_steps_grow_with_the_speed_and_the_cadence_follows():
    assert step_length(np.array([0.2, 0.6, 1.0, 1.4, 2.0])) == pytest.approx([0.6, 0.6, 0.7, 0.8, 0.8])


def test_one_leg_stands_while_the_other_swings():
    seconds = np.arange(0, WALK.duration + 2, 0.001)
    legs = feet(WALK, GAP, seconds)
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
    legs = feet(WALK, GAP, np.array([-1.0, 0.0, 0.9, 8.6, 50.0]))
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
    person = make.person(0, 0, gap=GAP, motion=SceneMotion(route=WALK))
    seconds = np.array([0.5, 2.3, 4.1])
    origin = np.tile([1.0, -2.0, np.pi / 2], (3, 1))
    circles = place((person,), origin, seconds).circles
    legs = feet(WALK, GAP, seconds)
    # Seen by a sensor that looks along +y: x ahead is the world's y, y to the left the world's -x.
    np.testing.assert_allclose(circles[..., 0], legs[..., 1] + 2, atol=1e-12)
    np.testing.assert_allclose(circles[..., 1], 1 - legs[..., 0], atol=1e-12)
    assert person.velocities(seconds)[:, 0] == pytest.approx([0, 1, 1])
