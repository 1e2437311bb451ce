"""What moves and what does not, in scenes of which everything is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.detection import AGENT, LEGGED, OBJECT, ROUND
from lidarcli.formalism.tracking.results import END_OF_LOG, FREE
from lidarcli.simulation import scene as make
from lidarcli.simulation.route import Waypoint, plan_route
from lidarcli.simulation.scene import Course, Entity, SceneMotion, super_ellipse
from lidarcli.sweeps.types import TURN
from tests.formalism.tracking.following import SENSOR, TrackedLog, assert_sums, follow, scene_of, simulated

CORNER = make.wall([[0.8, 4.0], [0.8, 2.6], [1.4, 2.6], [1.4, 4.0]])
ROUND_TRIP = Course(super_ellipse(2.6, 1.9, 2.5, points=36_000), speed=0.7)
STANDING = {
    "box": make.box(0.2, 0.1, 0.7, 0.4, 0.5),
    "pillar": make.cylinder(0.2, 0.1, 0.2),
    "thin pillar": make.cylinder(0.2, 0.1, 0.06),
    "person": make.person(0.2, 0.1, 0.4),
    "chair": make.legged("chair", 0.2, 0.1, 0.45, 0.45, 0.04, 0.3),
    "plant": make.plant(0.2, 0.1, 0.3),
}


def going(x: float, y: float, vx: float, vy: float, **more: float) -> Entity:
    """A box that goes straight on."""
    return make.box(x, y, 0.6, 0.4, motion=SceneMotion(velocity=(vx, vy), **more))


def on_route(*waypoints: tuple[float, float, float]) -> SceneMotion:
    """From place to place at 0.8 m/s, with a wait at each."""
    points = [Waypoint(x, y, 0.8, wait) for x, y, wait in waypoints]
    return SceneMotion(route=plan_route(points, turn_rate=TURN, corner_radius=0.5), ahead=False)


def rows_of(told: TrackedLog, number: int) -> dict[str, np.ndarray]:
    """The rows of a track."""
    at = told.of(number)
    return {name: values[at] for name, values in told.columns.items() if len(values) == len(at)} | {"sweep": told.row[at]}


def main_agent(told: TrackedLog) -> int:
    """The only thing that moves."""
    assert len(told.agents) == 1, told.agents
    return int(told.agents[0])


# A corner of the room that comes out as an object now and then, once as this piece of it and once as that.


@pytest.mark.parametrize("thing", STANDING)
@pytest.mark.parametrize("seed", [0, 1])
def test_past_a_driving_sensor_nothing_moves(thing: str, seed: int) -> None:
    scene = scene_of(STANDING[thing], CORNER, make.box(-4.2, -3.2, 0.5, 0.5), path=ROUND_TRIP)
    log = simulated(scene, 400, seed)
    told = follow(log)
    assert_sums(told, detect(log, Parameters()))
    assert told.agents.tolist() == []
    assert (told.columns["set"] == OBJECT).all()
    known = told.columns["track"] > 0
    assert known.mean() > 0.9
    # Not nearly: what stands has no speed at all.
    for name in ("vx", "vy", "moving"):
        assert (told.columns[name][known] == 0).all()
    assert (told.tracks.distance == 0).all()
    assert (told.tracks.speed_max == 0).all()
    assert (told.tracks.moved_at_ns == 0).all()


@pytest.mark.parametrize("seed", range(3))
def test_everything_around_a_sensor_that_stands_stands(seed: int) -> None:
    # Legs of a chair that are thick enough to be seen from there.
    kinds = {**STANDING, "chair": make.legged("chair", 0.2, 0.1, 0.45, 0.45, 0.09, 0.3)}
    things = [replace(thing, x=2.2 * np.cos(k), y=2.2 * np.sin(k)) for k, thing in enumerate(kinds.values())]
    sensor = replace(SENSOR, noise=0.02, lost=0.01)
    told = follow(simulated(scene_of(*things, sensor=sensor), 300, seed))
    assert told.agents.tolist() == []
    assert len(told.tracks) <= 2 * len(things)
    for thing in things:
        assert len(told.near(thing.x, thing.y)) >= 1


@pytest.mark.parametrize("speed", [0.3, 0.8, 1.4])
def test_the_speed_of_what_goes_is_known_from_its_first_row_to_its_last(speed: float) -> None:
    sweeps = int(50 / speed)
    told = follow(simulated(scene_of(going(-2.5, 2.0, speed, 0.0)), sweeps))
    rows = rows_of(told, main_agent(told))
    assert len(rows["sweep"]) == sweeps
    assert (rows["set"] == AGENT).all()
    assert np.abs(rows["vx"] - speed).max() < 0.15
    assert np.abs(rows["vy"]).max() < 0.15
    assert rows["moving"].all()
    track = main_agent(told) - 1
    assert told.tracks.distance[track] == pytest.approx(speed * (sweeps - 1) / 10, rel=0.05)
    assert told.tracks.speed_mean[track] == pytest.approx(speed, rel=0.05)
    assert told.tracks.end[track] == END_OF_LOG


def test_the_onset_is_dated_back_and_an_agent_stays_one_while_it_stands() -> None:
    route = on_route((-2.0, 2.0, 6.0), (1.0, 2.0, 8.0))
    log = simulated(scene_of(make.box(-2.0, 2.0, 0.6, 0.4, motion=route), make.cylinder(2.5, 0.0, 0.2)), 170)
    told = follow(log)
    assert_sums(told, detect(log, Parameters()))
    number = main_agent(told)
    rows = rows_of(told, number)
    # What stood where free space is seen afterwards was itself all the while.
    assert (rows["set"] == AGENT).all()
    # It sets off after 6 s, and is told so to half a second.
    onset = round((int(told.tracks.moved_at_ns[number - 1]) - int(log.stamp_ns[0])) / 1e8)
    assert 56 <= onset <= 65
    before = rows["sweep"] < onset
    assert (rows["vx"][before] == 0).all()
    assert (rows["agent_score"][before] == 0).all()
    moving = rows["moving"] == 1
    assert not moving[:onset].any()
    # 3 m at 0.8 m/s, then it stands for the rest, and is an agent all the same.
    assert moving[70:90].all()
    assert not moving[110:].any()
    assert (told.columns["agents"] == 1).all()


def test_what_comes_out_from_behind_something_keeps_its_speed() -> None:
    # A wide box hides the middle of the way.
    told = follow(simulated(scene_of(make.box(0.0, 1.2, 1.0, 0.3), going(-3.0, 2.6, 0.7, 0.0)), 85))
    number = main_agent(told)
    rows = rows_of(told, number)
    gap = np.diff(rows["sweep"]).max()
    assert gap > 8
    assert told.tracks.hidden[number - 1] == pytest.approx((gap - 1) / 10, abs=0.3)
    after = int(np.argmax(np.diff(rows["sweep"]))) + 1
    assert np.abs(rows["vx"][after - 3 : after + 3] - 0.7).max() < 0.2
    assert len(told.tracks) == 2


def test_what_stands_behind_something_that_passes_keeps_its_number() -> None:
    told = follow(simulated(scene_of(make.cylinder(0.0, 2.8, 0.2), going(-3.0, 1.4, 0.8, 0.0)), 75))
    assert len(told.tracks) == 2
    assert main_agent(told) == 2 - int(told.near(0.0, 2.8)[0] == 2)
    still = told.near(0.0, 2.8)[0]
    assert told.tracks.hidden[still - 1] > 0.3
    assert not told.tracks.moved[still - 1]


def test_what_is_gone_ends_as_free() -> None:
    gone = make.cylinder(2.0, 1.0, 0.2, motion=SceneMotion(disappears=5.0))
    told = follow(simulated(scene_of(gone, make.box(-2.0, 1.0, 0.5, 0.4)), 120))
    first, other = told.near(2.0, 1.0)[0], told.near(-2.0, 1.0)[0]
    assert told.tracks.end[first - 1] == FREE
    assert told.tracks.last_sweep[first - 1] == 49
    assert told.tracks.end[other - 1] == END_OF_LOG
    assert told.tracks.moved.sum() == 0


def test_a_person_on_two_legs_is_one_track() -> None:
    walker = make.person(-3.0, 2.0, motion=on_route((-3.0, 2.0, 0.0), (3.0, 1.5, 0.0)))
    told = follow(simulated(scene_of(walker), 75))
    number = main_agent(told)
    shares = told.of(number).mean()
    assert shares > 0.95
    rows = rows_of(told, number)
    middle = (rows["sweep"] > 15) & (rows["sweep"] < 60)
    assert np.median(rows["vx"][middle]) == pytest.approx(0.8, abs=0.1)


def passing_persons() -> TrackedLog:
    """Two persons who pass each other."""
    one = make.person(-3.0, 2.6, motion=on_route((-3.0, 2.6, 0.0), (3.0, 2.6, 0.0)))
    other = make.person(3.0, 1.4, motion=on_route((3.0, 1.4, 0.0), (-3.0, 1.4, 0.0)))
    return follow(simulated(scene_of(one, other), 75))


def test_two_persons_that_pass_each_other_keep_their_tracks() -> None:
    told = passing_persons()
    assert len(told.agents) == 2
    assert np.isin(told.columns["track"], told.agents).mean() > 0.95
    ends = [np.sign(np.median(rows_of(told, int(number))["vx"])) for number in told.agents]
    assert sorted(ends) == [-1.0, 1.0]
    assert told.tracks.sweeps[told.tracks.moved].tolist() == [75, 75]


@pytest.mark.parametrize("kind", ["chair", "table"])
def test_a_thing_on_four_legs_is_one_legged_track(kind: str) -> None:
    leg = 0.05 if kind == "chair" else 0.07
    log = simulated(scene_of(make.legged(kind, 1.6, 0.4, 0.5, 0.5, leg, 0.4)), 120)
    told = follow(log)
    assert told.tracks.shape.tolist() == [LEGGED]
    assert told.agents.tolist() == []
    assert told.of(1).mean() > 0.95
    # Several objects of a sweep share it.
    assert told.columns["objects"].max() >= 3


def test_a_pillar_is_round_and_as_wide_as_it_is() -> None:
    told = follow(simulated(scene_of(make.cylinder(1.5, 0.5, 0.2)), 60))
    assert told.tracks.shape.tolist() == [ROUND]
    assert told.tracks.length[0] == pytest.approx(0.4, abs=0.04)
    assert (told.tracks.x[0], told.tracks.y[0]) == (pytest.approx(1.5, abs=0.03), pytest.approx(0.5, abs=0.03))
