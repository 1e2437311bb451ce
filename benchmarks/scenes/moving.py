"""Random scenes in which things move, with known answers: rooms, halls, crossings of corridors, people.

Movers start, stop, turn and pause; none touches another, a wall, what stands or the sensor. Nobody appears or is gone in
mid-air: who comes in or leaves does so through a doorway, round a corner or beyond the sensor's range.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from benchmarks.scenes.random import draw_thing, walls_with_openings
from benchmarks.scenes.stage import Rng, Stage, reach, timed
from lidarcli.errors import OptionError
from lidarcli.simulation import scene as make
from lidarcli.simulation.route import STEPS, Route, plan_route
from lidarcli.simulation.scene import Course, Entity, Scene, SceneMotion, SceneSensor, super_ellipse
from lidarcli.sweeps.types import TURN, Float64

Kind = Literal["room", "hall", "crossing", "people"]
KINDS: tuple[Kind, ...] = ("room", "hall", "crossing", "people")
DRIVEN: tuple[Kind, ...] = ("room", "hall")
"""Kinds with room for a driving sensor."""
SPEEDS = (0.15, 1.5)
"""Slowest and fastest of the movers [m/s]."""
FASTEST_TURN = np.radians(20)
"""Of boxes [rad/s]."""
_TRIES = 40
_REPAIRS = 12
"""Times that a way is changed because somebody was met on it."""
_PATIENCE = 0.9
"""How often it is changed by waiting, not by going less far."""


def moving_scene(kind: Kind, seed: int, sensor: SceneSensor, *, driving: bool = False, legged: bool = True) -> Scene:
    """A scene of 300 to 400 sweeps; the same kind, seed, rate and options give the same scene for every sensor.

    With `driving` the sensor drives, by turns on a super-ellipse and along waypoints with stops. Without `legged` there are
    neither persons nor things on four legs; kind `people` has its persons anyway. Raises OptionError for a kind that is
    none, and for a driving sensor where there is no room for it.
    """
    if kind not in KINDS or (driving and kind not in DRIVEN):
        known = DRIVEN if driving else KINDS
        raise OptionError(f"no {'driving sensor in' if driving else 'moving scene of kind'} '{kind}': choose from {known}")
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([2, KINDS.index(kind), seed, driving])))
    sweeps = int(rng.integers(300, 401))
    build = {"room": _room, "hall": _hall, "crossing": _crossing, "people": _people}[kind]
    stage = build(rng, sweeps / sensor.rate, driving, legged)
    name = f"{kind}-{'driving-' if driving else ''}{seed}"
    return Scene(name, sensor, stage.entities, stage.path, sweeps=sweeps)


def _room(rng: Rng, duration: float, driving: bool, legged: bool) -> Stage:
    """A room with up to two doorways, 3 to 10 bodies, of which at least two move."""
    a, b = rng.uniform(7, 10, 2) if driving else rng.uniform(5, 10, 2)
    stage, doors = _chamber(rng, a, b, driving, duration)
    bodies = int(rng.integers(3, 11))
    moving = int(np.clip(round(bodies * rng.uniform(0.4, 0.8)), 2, 7))
    _furnish(rng, stage, bodies - moving, legged)
    _populate(rng, stage, moving, 2, 0.3 if legged else 0.0, doors)
    return stage


def _people(rng: Rng, duration: float, driving: bool, legged: bool) -> Stage:
    """A room with 4 to 8 walkers and little else."""
    a, b = rng.uniform(8, 12, 2)
    stage, doors = _chamber(rng, a, b, driving, duration)
    _furnish(rng, stage, int(rng.integers(0, 4)), legged=False)
    _populate(rng, stage, int(rng.integers(4, 9)), 4, 1.0, doors)
    return stage


def _hall(rng: Rng, duration: float, driving: bool, legged: bool) -> Stage:
    """A hall open to infinity with a few pieces of wall and up to 25 bodies; some come from far away or leave."""
    crowd = rng.uniform(5, 9)
    walls = []
    for _ in range(int(rng.choice([0, 0, 1, 2, 3]))):
        away, angle, half = crowd + rng.uniform(0.5, 2), rng.uniform(-np.pi, np.pi), rng.uniform(1, 5)
        out = np.array([np.cos(angle), np.sin(angle)])
        side = np.array([-out[1], out[0]])
        walls.append(make.wall(np.array([out * away - side * half, out * away + side * half])))
    around = np.arange(24) * (TURN / 24)
    floor = crowd * np.column_stack([np.cos(around), np.sin(around)])
    path = _drive(rng, np.zeros(2), crowd * 0.6, crowd * 0.6) if driving else _parked(rng, np.zeros(2))
    stage = Stage(walls, floor, path, duration)
    bodies = int(rng.integers(12, 26))
    moving = int(bodies * rng.uniform(0.35, 0.6))
    _furnish(rng, stage, bodies - moving, legged)
    # Beyond the longest range of the usual sensors, or so far away that it makes no difference.
    gates = [[point * (14.5 / crowd), point] for point in floor[rng.permutation(24)[:6]]]
    _populate(rng, stage, moving, 4, 0.25 if legged else 0.0, gates)
    return stage


def _crossing(rng: Rng, duration: float, driving: bool, legged: bool) -> Stage:
    """Two corridors that cross; the sensor stands by a corner, and who comes round another one was hidden."""
    wide = rng.uniform(2.4, 3.4, 2)
    long = 15.0
    walls = []
    for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        x, y = sx * wide[0] / 2, sy * wide[1] / 2
        walls.append(make.wall([[x, sy * long], [x, y], [sx * long, y]]))
    half = wide / 2
    place = rng.choice([-1, 1], 2) * (half - rng.uniform(0.3, 0.4, 2))
    floor = long * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    stage = Stage(walls, floor, _parked(rng, place), duration)
    for _ in range(int(rng.integers(1, 5))):
        _beside_corridor(rng, stage, wide)
    wanted = int(rng.integers(4, 9))
    for _ in range(wanted):
        for _ in range(_TRIES):
            come, leave = rng.permutation(4)[:2]
            points = _lane(rng, int(come), int(leave), half)
            walker = legged and rng.random() < 0.6
            if _send(rng, stage, walker, points, roam=0.0):
                break
    return stage


def _lane(rng: Rng, come: int, leave: int, half: Float64) -> list[Float64]:
    """From the arm `come` of a crossing to the arm `leave`, on the right; arms count from +x counter-clockwise."""
    aside = half * rng.uniform(0.3, 0.5)

    def out(arm: int, away: float, side: float) -> Float64:
        ahead = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]][arm], float)
        left = np.array([-ahead[1], ahead[0]])
        place: Float64 = ahead * away + left * side * (aside[1] if arm % 2 == 0 else aside[0])
        return place

    far_from, far_to = rng.uniform(4, 13.5), rng.uniform(4, 13.5)
    begin, end = out(come, far_from, 1.0), out(leave, far_to, -1.0)
    if (come - leave) % 2 == 0:
        return [begin, end]
    # The corner is where the lane of one corridor meets that of the other.
    corner = np.array([end[0], begin[1]] if come % 2 == 0 else [begin[0], end[1]])
    return [begin, corner, end]


def _beside_corridor(rng: Rng, stage: Stage, wide: Float64) -> None:
    """Something that stands by the wall of one of the arms."""
    along = rng.choice([-1, 1]) * rng.uniform(2.5, 9.0)
    size = rng.uniform(0.2, 0.45, 2)
    if rng.random() < 0.5:
        y = rng.choice([-1, 1]) * (wide[1] / 2 - size[1] / 2 - 0.15)
        stage.stand(make.box(along, y, size[0], size[1], rng.normal(0, 0.03)))
    else:
        x = rng.choice([-1, 1]) * (wide[0] / 2 - size[1] / 2 - 0.15)
        stage.stand(make.box(x, along, size[0], size[1], np.pi / 2 + rng.normal(0, 0.03)))


def _chamber(rng: Rng, a: float, b: float, driving: bool, duration: float) -> tuple[Stage, list[list[Float64]]]:
    """A rectangular or L-shaped room with up to two doorways: the stage, and the ways in, each by its points."""
    corners = np.array([[0, 0], [a, 0], [a, b], [0, b]])
    if rng.random() < 0.4 and not driving:
        ca, cb = a * rng.uniform(0.5, 0.7), b * rng.uniform(0.5, 0.7)
        corners = np.array([[0, 0], [a, 0], [a, cb], [ca, cb], [ca, b], [0, b]])
    openings: dict[int, tuple[float, float]] = {}
    ways: list[list[Float64]] = []
    # The first two sides have nothing of the room behind them.
    for side in rng.permutation(2)[: int(rng.integers(0, 3))]:
        start, end = corners[side], corners[side + 1]
        long = float(np.hypot(*(end - start)))
        gap = rng.uniform(1.3, 1.7)
        begin = rng.uniform(0.6, long - gap - 0.6)
        openings[int(side)] = (begin / long, (begin + gap) / long)
        along = (end - start) / long
        outward = np.array([along[1], -along[0]])
        middle = start + along * (begin + gap / 2)
        hidden = middle + outward * 1.2 + along * rng.choice([-1, 1]) * (gap / 2 + rng.uniform(1.2, 2.0))
        ways.append([hidden, middle + outward * 1.2, middle - outward * 0.9])
    walls = walls_with_openings(corners, openings, 0.0)
    if driving:
        path: Course | Route = _drive(rng, np.array([a, b]) / 2, a / 2 - 1.0, b / 2 - 1.0)
    else:
        path = _parked(rng, rng.uniform(0.15, 0.45, 2) * [a, b])
    return Stage(walls, corners, path, duration), ways


def _parked(rng: Rng, place: Float64) -> Course:
    return Course(place[None], yaw=float(rng.uniform(-np.pi, np.pi)))


def _drive(rng: Rng, centre: Float64, a: float, b: float) -> Course | Route:
    """A sensor that drives around the centre, reaching ± a and ± b: on a super-ellipse, or from stop to stop."""
    speed = rng.uniform(0.3, 0.8)
    if rng.random() < 0.5:
        size = np.array([a, b]) * rng.uniform(0.6, 0.95, 2)
        return Course(super_ellipse(size[0], size[1], rng.uniform(2.5, 4.0)) + centre, speed=speed)
    count = int(rng.integers(4, 7))
    angle = np.sort(rng.uniform(0, 0.5, count) / count + np.arange(count) / count) * TURN
    away = rng.uniform(0.55, 1.0, count)
    points = centre + np.column_stack([a * away * np.cos(angle), b * away * np.sin(angle)])
    waypoints = timed(rng, list(points), speed, stop=0.25, pause=0.2)
    return plan_route(waypoints, turn_rate=rng.uniform(0.6, 1.2), corner_radius=rng.uniform(0.4, 1.0), loop=True)


def _furnish(rng: Rng, stage: Stage, count: int, legged: bool) -> None:
    """Put up to `count` standing things on the floor."""
    low, high = stage.floor.min(axis=0), stage.floor.max(axis=0)
    for _ in range(count):
        for _ in range(_TRIES):
            x, y = rng.uniform(low, high)
            if stage.stand(draw_thing(rng, float(x), float(y), legged, largest=1.0)):
                break


def _populate(rng: Rng, stage: Stage, count: int, least: int, walkers: float, doors: list[list[Float64]]) -> None:
    """Send `count` movers about, a few less where it is crowded; a share of `walkers` are persons, some use the doors."""
    for number in range(count):
        walker = rng.random() < walkers
        tries = _TRIES if number >= least else 10 * _TRIES
        for attempt in range(tries):
            begin = list(doors[int(rng.integers(len(doors)))]) if doors and rng.random() < 0.35 else []
            # A shorter way meets fewer others.
            if _send(rng, stage, walker, begin, roam=1.0 - 0.7 * attempt / tries):
                break


def _send(rng: Rng, stage: Stage, walker: bool, begin: list[Float64], *, roam: float) -> bool:
    """Draw one mover and its way, which begins, or by chance ends, with the points given; True if it fits.

    It goes on from there at random for the share `roam` of what it has time for.
    """
    speed = rng.uniform(0.5, SPEEDS[1]) if walker else rng.uniform(*SPEEDS)
    body = _body(rng, walker, 0.5 if begin else 0.8)
    far = roam * speed * stage.duration * rng.uniform(0.4, 1.0)
    points = stage.wander(rng, reach(body), far, begin)
    if len(points) < 2:
        return False
    if begin and roam and rng.random() < 0.5:
        points = points[::-1]
    body = replace(body, x=float(points[0][0]), y=float(points[0][1]))
    motion, turn_rate, radius = _manner(rng, body, walker)
    waypoints = timed(rng, points, speed, stop=0.3 if radius else 1.0, pause=0.3)
    for _ in range(_REPAIRS):
        if len(waypoints) < max(len(begin), 2):
            return False
        route = plan_route(waypoints, turn_rate=turn_rate, corner_radius=radius or 1.0)
        met = stage.move(replace(body, motion=replace(motion, route=route)))
        if met is None:
            return True
        # Wait longer where it last could, until the other one has passed; or go no farther.
        last = _passed(route, met)
        if rng.random() < _PATIENCE:
            waypoints[last] = replace(waypoints[last], wait=waypoints[last].wait + rng.uniform(0.3, 2.0))
        else:
            waypoints = waypoints[: last + 1]
    return False


def _passed(route: Route, second: float) -> int:
    """The last waypoint of a route that has been passed by this time."""
    points = np.array([[point.x, point.y] for point in route.waypoints])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    way = route.state(np.array([second])).arc[0]
    return max(int(np.searchsorted(along, way, side="right")) - 1, 0)


def _manner(rng: Rng, body: Entity, walker: bool) -> tuple[SceneMotion, float, float]:
    """How a body goes about: its motion without a route, its turns on the spot [rad/s], the radius of its arcs [m]."""
    if walker:
        return body.motion, np.radians(120), rng.uniform(0.3, 0.8)
    if body.kind == "box" and rng.random() < 0.5:
        # Turns its front ahead, slowly and on the spot alone.
        return SceneMotion(), FASTEST_TURN, 0.0
    turns = body.kind == "box" and rng.random() < 0.7
    rate = rng.uniform(-1, 1) * FASTEST_TURN if turns else 0.0
    # What has no front takes no time to turn it.
    return SceneMotion(yaw_rate=rate, ahead=False), TURN, rng.uniform(0.3, 0.8)


def _body(rng: Rng, walker: bool, largest: float) -> Entity:
    """What moves: a person, a box, or something round."""
    yaw = float(rng.uniform(-np.pi, np.pi))
    if walker:
        gap, leg = rng.uniform(0.18, 0.3), rng.uniform(0.09, 0.15)
        return make.person(0.0, 0.0, 0.0, gap, leg, SceneMotion(stride=STEPS[1]))
    if rng.random() < 0.7:
        width, length = np.sort(rng.uniform(0.2, largest, 2))
        return make.box(0.0, 0.0, float(length), float(width), yaw if rng.random() < 0.5 else 0.0)
    return make.cylinder(0.0, 0.0, rng.uniform(0.1, min(0.3, largest / 2)))
