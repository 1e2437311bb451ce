"""Who is an agent: what goes through places that are free, and not what jumps, slides, or belongs to the robot."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.tracking import agents, tracks
from lidarcli.options.choices import AGENT_SCORE
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import PARKED, Course, SceneMotion
from lidarcli.sweeps.types import Status, SweepBatch
from tests.formalism.tracking.following import SENSOR, TrackedLog, follow, scene_of, simulated
from tests.formalism.tracking.test_motion_of_things import CORNER, ROUND_TRIP, STANDING, on_route

ALONG = Course(np.array([[-3.5, -1.5], [3.5, -1.5]]), speed=0.7)
"""Past a wall, 10 s."""


class Looks:
    """Looks that find every place free before, or what stands at some of them."""

    def __init__(self, place: Any, balance: Any, stood: tuple[float, ...]) -> None:
        self.place, self.balance, self.stand = place, balance, stood

    def count_looks(self, recorded: Any, rows: Any, looks: Any) -> None:
        looks[:, :2], looks[:, 2:] = 0.0, 0.0
        looks[:, 0], looks[:, 1] = 2.0 + 2.0 * self.balance[rows], 2.0 - 2.0 * self.balance[rows]

    def stood(self, recorded: Any, row: int, since: float, until: float) -> bool:
        return any(abs(self.place[row] - x) < 0.3 for x in self.stand)


def judged(
    x: Any,
    *,
    rate: float = 10.0,
    free: Any = True,
    stood: tuple[float, ...] = (),
    own: Any = False,
    track: tracks.Track | None = None,
    least: float = AGENT_SCORE,
) -> agents.AgentVerdict:
    """The verdict on something of 0.4 m that is seen at places x along a line, of which some are seen to be free."""
    count, place = len(x), np.asarray(x) + 0j
    track = track or tracks.Track()
    if not track.parts:
        track.add_part(tracks.Tracklet(1, moved=1, h=(0.2, 0.2)))
    every = np.arange(count)
    sightings = SimpleNamespace(
        keyframes=Looks(place, np.where(free, 1.0, -1.0) * np.ones(count), stood),
        view=place,
        keep=every,
        sweep=every,
        now=np.ones(count, bool),
        own=np.broadcast_to(own, count),
        recorded=None,
        is_placed=True,
    )
    return agents.judge(sightings, track, every, every, every / rate, np.ones(count, np.uint8), least)


WALKS = 0.1 * np.arange(40.0)


@pytest.mark.parametrize(
    ("x", "rate"),
    [
        pytest.param(WALKS, 10.0, id="walks"),
        pytest.param(0.015 * np.arange(200.0), 10.0, id="a slow cart"),
        pytest.param(0.8 * np.arange(12.0), 1.0, id="a sweep a second"),
        pytest.param(np.append(WALKS, WALKS[::-1]), 10.0, id="comes back"),
        pytest.param(np.repeat([*WALKS[:20], 2.0, *WALKS[20:]], [1] * 20 + [60] + [1] * 20), 10.0, id="rests on its way"),
    ],
)
def test_what_goes_through_free_places_is_an_agent(x: Any, rate: float) -> None:
    verdict = judged(x, rate=rate)
    assert verdict.agent.all()
    assert (verdict.score > 0.8).all()
    assert not judged(x, rate=rate, free=False).agent.any()


@pytest.mark.parametrize(
    "x",
    [
        pytest.param(np.zeros(60), id="stands"),
        pytest.param(np.repeat([0.0, 2.0], 30), id="jumps"),
        pytest.param(np.tile(np.repeat([0.0, 0.6], 10), 4), id="legs of a chair in turn"),
        pytest.param(0.3 * (np.arange(60) % 7 > 3), id="to and fro"),
    ],
)
def test_what_jumps_between_places_is_no_agent(x: Any) -> None:
    assert not judged(x).agent.any()
    assert not judged(x, stood=(0.0, 0.3, 0.6, 2.0)).agent.any()


@pytest.mark.parametrize("stands", [True, False])
def test_a_jump_to_what_stood_there_does_not_make_it_an_agent(stands: bool) -> None:
    """It walks 4 m, then it is seen 2 m farther on, where it stays."""
    x = np.append(WALKS, np.repeat(5.9, 30))
    verdict = judged(x, stood=(5.9,) if stands else ())
    assert verdict.agent[:40].all()
    assert verdict.agent[40:].all() == (not stands)
    if stands:
        assert not verdict.agent[40:].any()
        assert (verdict.score[40:] < AGENT_SCORE).all()
    # In the next window it is the same.
    track = tracks.Track(was_agent=not stands, agent_score=0.9, last_view=5.9 + 0j, last_time=7.0)
    assert judged(np.repeat(5.9, 30), track=track).agent.all() == (not stands)


def test_what_has_gone_is_an_agent_where_it_rests() -> None:
    verdict = judged(np.append(WALKS, np.repeat(WALKS[-1], 100)), free=np.arange(140) < 40)
    assert verdict.agent.all()
    track = tracks.Track(was_agent=True, agent_score=0.9, last_view=complex(WALKS[-1]), last_time=0.0)
    later = judged(np.repeat(WALKS[-1], 50), free=False, track=track)
    assert later.agent.all()
    assert (later.score == 0.9).all()


def test_an_agent_begins_a_second_before_it_goes_through_free_places() -> None:
    """What stood for long, and is seen to leave, was no agent before."""
    x = np.append(np.zeros(60), WALKS)
    verdict = judged(x, free=np.arange(100) > 62)
    first = int(np.flatnonzero(verdict.agent)[0])
    assert 50 <= first <= 62
    assert verdict.agent[first:].all()


def test_the_score_that_is_asked_for_decides() -> None:
    chance = judged(WALKS).score.max()
    assert 0.5 < chance < 1.0
    assert judged(WALKS, least=chance - 1e-6).agent.all()
    assert not judged(WALKS, least=chance + 1e-6).agent.any()


def test_the_robot_itself_is_no_agent() -> None:
    assert not judged(WALKS, own=True).agent.any()
    half = judged(WALKS, own=np.arange(40) < 20)
    assert not half.agent[:20].any()
    assert half.agent[20:].all()


def test_without_a_place_of_the_sensor_there_is_no_score() -> None:
    walker = make.box(-2.5, 2.0, 0.6, 0.4, motion=SceneMotion(velocity=(0.7, 0.0)))
    told = follow(simulated(scene_of(walker, path=ROUND_TRIP), 70, poses=False))
    known = told.columns["track"] > 0
    assert np.isnan(told.columns["agent_score"][known]).all()
    assert np.isnan(told.tracks.agent_score).all()
    placed = follow(simulated(scene_of(walker, path=ROUND_TRIP), 70))
    known = placed.columns["track"] > 0
    assert not np.isnan(placed.columns["agent_score"][known]).any()
    assert ((placed.tracks.agent_score > AGENT_SCORE) == placed.tracks.moved).all()


def seen_on_robot(batch: SweepBatch, *posts: tuple[int, int, float]) -> SweepBatch:
    """The batch, with parts of the robot itself at some beams, so near."""
    ranges, status = batch.ranges.copy(), batch.status.copy()
    noise = np.random.default_rng(1).normal(scale=0.004, size=ranges.shape)
    for first, stop, r in posts:
        ranges[:, first:stop] = r + noise[:, first:stop]
        status[:, first:stop] = Status.VALID.value
    return replace(batch, ranges=ranges, status=status)


@pytest.mark.parametrize("seed", range(2))
def test_parts_of_a_robot_that_drives_are_no_agents(seed: int) -> None:
    log = simulated(scene_of(*STANDING.values(), CORNER, path=ROUND_TRIP), 300, seed)
    told = follow(seen_on_robot(log, (100, 130, 0.35), (400, 440, 0.5)))
    assert told.agents.tolist() == []
    # A person beside it is one.
    walker = make.person(-3.0, 3.2, motion=on_route((-3.0, 3.2, 0.0), (3.0, 3.2, 0.0)))
    log = simulated(scene_of(walker, path=ROUND_TRIP), 80, seed)
    told = follow(seen_on_robot(log, (100, 130, 0.35), (400, 440, 0.5)))
    assert len(told.agents) == 1
    agent = told.columns["set"] == AGENT
    assert (np.hypot(told.detection["x"], told.detection["y"])[agent] > 0.7).all()


def share_in_a(told: TrackedLog, sweeps: int) -> float:
    """Share of the sweeps in which something is an agent."""
    return len(np.unique(told.row[told.columns["set"] == AGENT])) / sweeps


@pytest.mark.parametrize("driving", [False, True])
def test_a_slow_cart_goes(driving: bool) -> None:
    cart = make.box(-1.5, 3.0, 0.6, 0.4, motion=SceneMotion(velocity=(0.15, 0.0)))
    told = follow(simulated(scene_of(cart, make.box(3.0, -3.0, 0.5, 0.4), path=ROUND_TRIP if driving else PARKED), 200))
    assert len(told.agents) == 1
    assert share_in_a(told, 200) > 0.9
    middle = told.of(int(told.agents[0]))
    assert np.median(told.columns["vx"][middle]) == pytest.approx(0.15, abs=0.03)


@pytest.mark.parametrize("rate", [1.0, 2.0, 5.0])
def test_sparse_sweeps_show_who_goes(rate: float) -> None:
    walker = make.box(-3.5, 2.0, 0.5, 0.4, motion=SceneMotion(velocity=(0.35, 0.0)))
    sensor = replace(SENSOR, rate=rate)
    sweeps = int(18 * rate)
    told = follow(simulated(scene_of(walker, make.box(2.0, -2.0, 0.5, 0.4), CORNER, sensor=sensor), sweeps))
    assert len(told.agents) == 1
    assert share_in_a(told, sweeps) > 0.8
    still = follow(simulated(scene_of(make.box(2.0, -2.0, 0.5, 0.4), CORNER, path=ROUND_TRIP, sensor=sensor), sweeps))
    assert still.agents.tolist() == []


@pytest.mark.parametrize("greatest", [8.0, 15.0, 30.0])
def test_a_mesh_that_returns_only_near_the_perpendicular_does_not_go(greatest: float) -> None:
    """A piece of a long fence beside the way, always the one abreast of the sensor, slides along with it."""
    log = simulated(scene_of(make.wall([[-4.9, 0.5], [4.9, 0.5]]), path=ALONG), 100)
    assert log.poses is not None
    world = log.bearings + log.poses.yaw[:, None]
    y = log.poses.y[:, None] + log.ranges * np.sin(world)
    fence = (np.abs(y - 0.5) < 0.1) & (np.abs(np.angle(np.exp(1j * (world - np.pi / 2)))) > np.radians(greatest))
    ranges, status = log.ranges.copy(), log.status.copy()
    ranges[fence], status[fence] = np.nan, Status.NO_RETURN.value
    told = follow(replace(log, ranges=ranges, status=status))
    assert told.agents.tolist() == []


def test_who_goes_behind_something_does_not_come_out_as_a_chair() -> None:
    """A person goes behind a screen and stays there; a chair beyond it was seen all the time."""
    walker = make.person(-3.0, 2.8, motion=on_route((-3.0, 2.8, 0.0), (0.3, 2.8, 100.0)))
    chair = make.legged("chair", 1.6, 2.6, 0.45, 0.45, 0.06, 0.3)
    told = follow(simulated(scene_of(walker, make.box(0.0, 1.4, 1.6, 0.2), chair), 200))
    (number,) = told.agents
    chairs = told.near(1.6, 2.6, 0.5)
    assert number not in chairs
    agent = told.columns["set"] == AGENT
    assert (told.detection["x"][agent] < 1.0).all()
