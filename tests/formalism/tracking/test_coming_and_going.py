"""People who come and go before a parked sensor: each is counted once, and nothing is told where no sweep saw them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism.tracking.results import HIDDEN, LEFT_VIEW
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import simulate_sweep_arrays
from lidarcli.simulation.scene import PARKED, Entity, Scene, SceneMotion, SceneSensor
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN
from tests.formalism.tracking.following import TrackedLog, follow

HALF_TURN = SceneSensor(beams=512, angle_min=-TURN / 4, angle_increment=TURN / 1024, noise=0.01, range_max=5.6, rate=10.0)
"""A scanner at a wall that sees 5.6 m, as those with which people are counted."""
FASTEST = 4.0
"""[m/s] No person is faster."""


def walker(begin: tuple[float, float], end: tuple[float, float], at: float, speed: float) -> Entity:
    """A person who walks from one place to another, and is there only then."""
    way = np.subtract(end, begin)
    length = float(np.hypot(*way))
    velocity = speed / length * way
    start = np.subtract(begin, at * velocity)
    motion = SceneMotion(
        velocity=(float(velocity[0]), float(velocity[1])),
        appears=at,
        disappears=at + length / speed,
        stride=0.6,
        cadence=0.75 * speed,
    )
    return make.person(*start.tolist(), yaw=float(np.arctan2(way[1], way[0])), leg=0.14, motion=motion)


def hall(seed: int) -> tuple[Entity, ...]:
    """Sixteen people who cross, in lanes that lead one way."""
    rng = np.random.Generator(np.random.PCG64(seed))
    people = []
    for k in range(16):
        x, upwards = 0.8 + 0.95 * (k % 5), k % 5 in (0, 2, 3)
        ends = ((x, -6.5), (x + rng.uniform(-0.1, 0.1), 6.5))
        begin, end = ends if upwards else ends[::-1]
        people.append(walker(begin, end, 1.0 + 2.2 * k + rng.uniform(0.0, 0.5), rng.uniform(0.9, 1.4)))
    return (make.box(1.3, 5.0, 0.4, 0.4), make.box(4.9, -3.8, 0.5, 0.4), *people)


def corridor(seed: int) -> tuple[Entity, ...]:
    """Fourteen people who pass each other in a corridor, on whose wall the sensor is."""
    rng = np.random.Generator(np.random.PCG64(seed))
    people = []
    for k in range(14):
        side = rng.random() < 0.5
        x, ends = 0.9 if side else 1.8, (-7.0, 7.0) if side else (7.0, -7.0)
        # Nobody walks through somebody.
        people.append(walker((x, ends[0]), (x, ends[1]), 1.0 + 2.6 * k + rng.uniform(0.0, 0.5), 1.2 if side else 1.0))
    return (make.wall([[2.6, -9.0], [2.6, 1.0]]), make.wall([[2.6, 2.2], [2.6, 9.0]]), *people)


def followed(entities: tuple[Entity, ...], seconds: float, seed: int) -> tuple[TrackedLog, Any]:
    """What the tracker says, and (K,) the entity that most beams of each object hit."""
    scene, count = Scene("hall", HALF_TURN, entities, PARKED), int(seconds * HALF_TURN.rate)
    raw, hit, _ = simulate_sweep_arrays(scene, count, seed)
    batch = normalise(raw, np.arange(count), RangeRules())
    told = follow(replace(batch, still=np.ones(count, np.bool_)))
    found = told.detection
    beam = np.round((np.arctan2(found["y"], found["x"]) - HALF_TURN.angle_min) / HALF_TURN.angle_increment)
    return told, hit[told.row, np.clip(beam.astype(int), 0, HALF_TURN.beams - 1)]


def steps_of(told: TrackedLog, number: int) -> Any:
    """(N,) speeds [m/s] at which a track goes from one sweep that saw it to the next, and (N,) ways [m]."""
    mine = told.of(number)
    sweeps, first = np.unique(told.row[mine], return_inverse=True)
    place = [np.bincount(first, told.detection[axis][mine]) / np.bincount(first) for axis in "xy"]
    way = np.hypot(*(np.diff(axis) for axis in place))
    return way / (np.diff(sweeps) / HALF_TURN.rate), way


@pytest.mark.slow
@pytest.mark.parametrize("scene", [hall, corridor])
def test_people_who_come_and_go_are_counted_once(scene: Any) -> None:
    people = agents = 0
    for seed in range(4):
        told, entity = followed(scene(seed), 48.0, seed)
        people += sum(one.kind == "person" for one in scene(seed))
        agents += len(told.agents)
        for number in told.agents.tolist():
            seen = np.bincount(entity[told.of(number) & (entity >= 0)])
            # Legs that two who pass each other lend for a moment make no track of both.
            assert (seen >= 5).sum() <= 1, (seed, number, seen)
            speed, way = steps_of(told, number)
            assert not ((speed > FASTEST) & (way > 1.0)).any()
    assert abs(agents - people) <= 0.05 * people, (agents, people)


@pytest.mark.parametrize("pause", [2.5, 6.0, 9.0, 13.0])
@pytest.mark.parametrize("back", [(0.3, -6.2), (1.5, -6.0)], ids=["where they left", "elsewhere"])
def test_the_next_person_is_another_one(pause: float, back: tuple[float, float]) -> None:
    inside, out = (4.4, 1.0), (0.3, -6.2)
    first = walker(inside, out, 0.0, 1.0)
    left = first.motion.disappears
    second = walker(back, inside, left + pause, 1.0)
    told, entity = followed((make.box(3.2, -1.2, 0.5, 0.5), first, second), left + pause + 6.0, 6)
    assert len(told.agents) == 2
    assert told.tracks.end[told.agents[0] - 1] == LEFT_VIEW
    for number, person in zip(told.agents.tolist(), (1, 2), strict=True):
        assert set(entity[told.of(number) & (entity > 0)].tolist()) == {person}
    # No sweep saw anybody beyond the range of the sensor.
    rows = [each for each in told.tracker.trajectories() if len(each)]
    assert max(np.hypot(each.x, each.y).max() for each in rows) < 6.0
    assert np.concatenate([each.seen == HIDDEN for each in rows]).mean() < 0.1


def test_who_walks_on_behind_a_pillar_keeps_the_number() -> None:
    pillar = make.box(2.0, 0.0, 0.3, 0.8)
    told, _ = followed((make.wall([[5.0, -4.0], [5.0, 4.0]]), pillar, walker((3.5, -4.5), (3.5, 4.5), 0.0, 1.0)), 9.0, 1)
    assert len(told.agents) == 1
    assert told.tracks.hidden[told.agents[0] - 1] > 0.7
