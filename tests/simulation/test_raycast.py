"""Ray casting against closed forms and against an obvious slow loop."""

import numpy as np
import pytest

from benchmarks.accuracy.cells import legs_of
from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import cast, place
from lidarcli.simulation.scene import SceneMotion

STILL = np.zeros(1)


def look(entities, bearings, pose=(0.0, 0.0, 0.0), seconds=STILL):
    poses = np.tile(np.asarray(pose, float), (len(seconds), 1))
    return cast(place(tuple(entities), poses, np.asarray(seconds, float)), np.asarray(bearings, float))


def test_the_sensor_pose_moves_the_world_the_other_way():
    things = [make.box(4, 3, 0.6, 0.4, 0.3), make.cylinder(-2, 1, 0.3), make.wall([[-5, -5], [5, -5]])]
    bearings = np.linspace(-np.pi, np.pi, 500, endpoint=False)
    turned, _ = look(things, bearings, pose=(0.5, -0.25, 0.7))
    moved, _ = look(things, bearings + 0.7, pose=(0.5, -0.25, 0.0))
    np.testing.assert_allclose(turned, moved, rtol=1e-9)


def slow_range(entities, x, y, bearing):
    """One beam, one primitive at a time, by solving the 2 × 2 system and the quadratic."""
    direction = np.array([np.cos(bearing), np.sin(bearing)])
    nearest, hit = np.inf, -1
    for number, thing in enumerate(entities):
        cos, sin = np.cos(thing.yaw), np.sin(thing.yaw)
        turn = np.array([[cos, -sin], [sin, cos]])
        origin = np.array([thing.x - x, thing.y - y])
        for x0, y0, x1, y1 in thing.segments:
            a, b = turn @ [x0, y0] + origin, turn @ [x1, y1] + origin
            system = np.column_stack([direction, a - b])
            if abs(np.linalg.det(system)) < 1e-15:
                continue
            distance, along = np.linalg.solve(system, a)
            if distance > 0 and 0 <= along <= 1 and distance < nearest:
                nearest, hit = distance, number
        for cx, cy, radius in thing.circles:
            centre = turn @ [cx, cy] + origin
            roots = np.roots([1.0, -2 * centre @ direction, centre @ centre - radius**2])
            if np.isreal(roots).all() and roots.real.min() > 0 and roots.real.min() < nearest:
                nearest, hit = roots.real.min(), number
    return nearest, hit


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_random_things_agree_with_the_slow_loop(seed):
    rng = np.random.default_rng(seed)
    things = [
        make.box(*rng.uniform(-4, 4, 2), 0.5, 0.3, rng.uniform(-3, 3)),
        make.legged("ladder", *rng.uniform(-4, 4, 2), 0.6, 0.4, 0.04, rng.uniform(-3, 3)),
        make.legged("chair", *rng.uniform(-4, 4, 2), 0.5, 0.5, 0.03, rng.uniform(-3, 3)),
        make.plant(*rng.uniform(-4, 4, 2), 0.4, seed),
        make.wall(rng.uniform(-6, 6, (4, 2))),
    ]
    bearings = rng.uniform(-np.pi, np.pi, 100)
    ranges, entity = look(things, bearings, pose=(0.1, 0.2, 0.0))
    slow = [slow_range(things, 0.1, 0.2, bearing) for bearing in bearings]
    np.testing.assert_allclose(ranges[0], [distance for distance, _ in slow], rtol=1e-9)
    assert entity[0].tolist() == [hit for _, hit in slow]


def test_legs_as_entities_of_their_own_cast_the_same():
    motion = SceneMotion(velocity=(0.3, 0.1), stride=0.5, cadence=0.7)
    things = [
        make.person(2, 0.5, 0.4, motion=motion),
        make.legged("table", -2, 1, 1.2, 0.7, 0.05, 0.5),
        make.legged("chair", -1, -2, 0.5, 0.5, 0.03, 0.2),
        make.box(0, 3, 1, 1),
    ]
    legs = [leg for thing in things for leg in legs_of(thing)]
    assert [leg.kind for leg in legs] == ["leg"] * 10 + ["box"]
    seconds, bearings = np.linspace(0, 2, 9), np.linspace(-np.pi, np.pi, 2000)
    whole, owner = look(things, bearings, seconds=seconds)
    apart, leg = look(legs, bearings, seconds=seconds)
    np.testing.assert_allclose(apart, whole, rtol=1e-9)
    assert (np.append(np.repeat(np.arange(4), [2, 4, 4, 1]), -1)[leg] == owner).all()
