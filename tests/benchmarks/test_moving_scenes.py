"""Moving scenes: nobody walks through anybody, and what the truth says of speeds is so."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.scenes.clearance import distance
from benchmarks.scenes.moving import DRIVEN, FASTEST_TURN, KINDS, moving_scene
from benchmarks.scenes.random import SENSORS
from lidarcli.errors import OptionError
from lidarcli.simulation.generate import place, simulate_sweep_arrays
from lidarcli.simulation.scene import Entity
from lidarcli.sweeps import TURN, Float64

CELLS = [*((kind, False) for kind in KINDS), *((kind, True) for kind in DRIVEN)]
RIM = np.arange(13) * (TURN / 12)


def made(kind, driving, seed=0):
    return moving_scene(kind, seed, SENSORS["361"], driving=driving)


def drawn(entity: Entity, seconds: Float64) -> Float64:
    """(S, K, 4) the sides of the entity in the world, circles as polygons of twelve."""
    shapes = place((entity,), np.zeros((len(seconds), 3)), seconds)
    x, y, radius = (shapes.circles[..., i, None] for i in range(3))
    rims = np.stack([x + radius * np.cos(RIM), y + radius * np.sin(RIM)], axis=-1)
    sides = np.concatenate([rims[:, :, :-1], rims[:, :, 1:]], axis=-1)
    return np.concatenate([shapes.segments, sides.reshape(len(seconds), -1, 4)], axis=1)


def movers(scene):
    return [entity for entity in scene.entities if entity.motion.route]


@pytest.mark.whole
@pytest.mark.parametrize(("kind", "driving"), CELLS)
def test_nothing_meets_anything_else(kind, driving):
    scene = made(kind, driving, seed=3)
    seconds = np.arange(0, scene.sweeps / scene.sensor.rate, 0.25)
    shapes = [drawn(entity, seconds) for entity in scene.entities]
    sensor = np.tile(scene.path.poses(seconds)[:, None, :2], 2)
    for number, entity in enumerate(scene.entities):
        assert min(map(distance, shapes[number], sensor)) > 0.3
        if entity.motion.route:
            for other, theirs in enumerate(shapes):
                assert other == number or min(map(distance, shapes[number], theirs)) > 0.02


@pytest.mark.whole
@pytest.mark.parametrize(("kind", "driving"), CELLS)
def test_what_moves_and_how(kind, driving):
    moving = []
    for seed in range(3):
        scene = made(kind, driving, seed)
        assert 300 <= scene.sweeps <= 400
        assert scene.path.parked != driving
        things = [entity for entity in scene.entities if not entity.wall]
        least, most = {"room": (3, 10), "hall": (8, 25), "crossing": (3, 12), "people": (4, 11)}[kind]
        assert least <= len(things) <= most
        assert len(movers(scene)) >= 2
        assert all(entity.motion.appears == -np.inf for entity in things)
        assert all(entity.motion.disappears == np.inf for entity in things)
        seconds = np.arange(0, scene.sweeps / scene.sensor.rate, 0.05)
        for entity in movers(scene):
            velocity = entity.velocities(seconds)
            speed = np.hypot(velocity[:, 0], velocity[:, 1])
            assert speed.max() <= 1.5 + 1e-9
            assert np.abs(np.diff(speed)).max() <= 2 * 0.05 + 1e-9
            if entity.kind == "box":
                assert np.abs(velocity[:, 2]).max() <= FASTEST_TURN + 1e-9
            moving.append((speed > 0).mean())
    assert 0.3 < np.mean(moving) < 0.95


@pytest.mark.whole
def test_people_are_four_to_eight_walkers():
    for seed in range(4):
        walkers = movers(made("people", False, seed))
        assert 4 <= len(walkers) <= 8
        assert {entity.kind for entity in walkers} == {"person"}


def test_the_same_seed_gives_the_same_scene_for_every_sensor():
    first, second, other = made("room", False, 1), made("room", False, 1), made("room", False, 2)
    wide = moving_scene("room", 1, SENSORS["1081"])
    seconds = np.arange(0, 30, 0.5)

    def places(scene):
        return np.concatenate([entity.poses(seconds) for entity in scene.entities])

    assert np.array_equal(places(first), places(second))
    assert np.array_equal(places(first), places(wide))
    assert not np.array_equal(first.path.points, other.path.points)
    assert wide.sensor == SENSORS["1081"]


def test_without_legs_all_is_rigid():
    for kind in ("room", "hall", "crossing"):
        scene = moving_scene(kind, 0, SENSORS["361"], legged=False)
        assert {entity.kind for entity in scene.entities} <= {"wall", "box", "cylinder", "plant"}


def test_movers_are_seen():
    scene = made("room", False)
    _, entity, things = simulate_sweep_arrays(replace(scene, sweeps=40), 40)
    seen = {things[number].kind for number in np.unique(entity[entity >= 0])}
    assert "wall" in seen
    assert any(things[number].motion.route for number in np.unique(entity[entity >= 0]))


def test_no_room_for_a_driving_sensor_and_no_such_kind():
    with pytest.raises(OptionError, match="driving sensor"):
        moving_scene("people", 0, SENSORS["361"], driving=True)
    with pytest.raises(OptionError, match="garden"):
        moving_scene("garden", 0, SENSORS["361"])  # type: ignore[arg-type]
