"""Buildings in which a robot drives a loop while people walk about: a ring of corridors, and rooms behind rooms.

The robot begins at the origin of the world and heads along x, so that the world of a path that is matched from the sweeps
is that of the scene; the walls stand at any angle to it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from benchmarks.scenes.clearance import in_polygon, to_segments
from benchmarks.scenes.random import draw_thing
from benchmarks.scenes.stage import Rng, Stage, timed
from lidarcli.simulation import scene as make
from lidarcli.simulation.route import Route, Waypoint, plan_route
from lidarcli.simulation.scene import Entity, Odometry, Scene, SceneMotion, SceneSensor
from lidarcli.sweeps.types import TURN, Bool, Float64

Kind = Literal["corridors", "rooms"]
KINDS: tuple[Kind, ...] = ("corridors", "rooms")
SWEEPS, RATE = 1200, 10.0
"""Length of a drive that is not told how fast it goes, and sweeps per second."""
NOISE, MIXED, LOST = 0.01, 0.3, 0.005
"""Standard deviation of a range [m]; share of the beams at an edge that end between two surfaces, and of beams lost."""
PEOPLE, THINGS = 16, 40
"""Who is to walk about, and what is to stand in a building: as far as there is room."""
FAST = 1.0
"""Of the drives in which sweeps take their time [m/s]."""
STRAIGHT_WAY, STRAIGHT_SPEED = 40.0, 0.6
"""Of the drive along a straight corridor [m, m/s]."""
_RADIUS, _ACCELERATION, _TURN_RATE = 0.95, 1.0, np.radians(60) / 1.5
"""How the robot takes corners [m], [m/s²]; on the spot the fastest is 1.5 times the mean [rad/s]."""
_AT_DOOR = 1.1
"""How far before and behind a doorway the robot goes straight [m]."""
_ASIDE, _APART = 0.4, 0.8
"""Least distance of the middle of somebody who walks from what stands, and from the robot and other people [m]."""
_SQUARE = 0.1
"""Side of the squares in which it is looked up where people can walk [m]."""
_STRAIGHT = (1.0, 7.0)
"""Length of the straight pieces of their ways [m]."""
_TRIES, _REPAIRS = 60, 40
_Laid = Callable[[Float64], Float64]
"""Points of the plan in the world."""

SENSOR = SceneSensor(
    beams=361,
    angle_min=-TURN / 2,
    angle_increment=TURN / 360,
    range_max=12.0,
    noise=NOISE,
    lost=LOST,
    mixed_pixels=MIXED,
    rate=RATE,
)
ROLLING = replace(SENSOR, time_increment=1 / RATE / SENSOR.beams)
"""The same, but a sweep takes the whole time until the next one."""


@dataclass(slots=True)
class _Plan:
    """A building on paper, in coordinates of its own."""

    walls: list[Float64] = field(default_factory=list)
    """(P, 2) closed polygons."""
    way: list[tuple[float, float]] = field(default_factory=list)
    """Points that the robot goes through; it comes back to the first one."""
    places: list[tuple[float, float, float, float]] = field(default_factory=list)
    """Where people walk, in turn: x0, y0, x1, y1."""
    floor: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def slab(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """A solid piece of wall."""
        self.walls.append(_rectangle(x0, y0, x1, y1))

    def run(self, rng: Rng, start: float, end: float, across: float, thick: float, *, upright: bool = False) -> None:
        """A wall in pieces between doorways, along x or upright along y."""
        at = start
        while True:
            long, gap = rng.uniform(1.2, 4.5), rng.uniform(0.8, 1.5)
            last = at + long + gap + 0.6 > end
            until = end if last else at + long
            if upright:
                self.slab(across, at, across + thick, until)
            else:
                self.slab(at, across, until, across + thick)
            if last:
                return
            at = until + gap

    def door(
        self, start: float, end: float, across: float, middle: float, wide: float, thick: float, *, upright: bool
    ) -> None:
        """A wall with one doorway."""
        for low, high in ((start, middle - wide / 2), (middle + wide / 2, end)):
            if upright:
                self.slab(across, low, across + thick, high)
            else:
                self.slab(low, across, high, across + thick)


def drive(kind: Kind, seed: int, sensor: SceneSensor = SENSOR, speed: float | None = None) -> Scene:
    """A robot that drives a loop with true poses; the same kind and seed give the same building for every sensor.

    Without a `speed` [m/s] the loop takes `SWEEPS`; with one it takes as many sweeps as it needs.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([5, KINDS.index(kind), seed])))
    plan = {"corridors": _corridors, "rooms": _rooms}[kind](rng)
    way = np.array(plan.way)
    begin, ahead = way[0], way[1] - way[0]
    yaw = float(np.arctan2(ahead[1], ahead[0]))

    def laid(points: Float64) -> Float64:
        cos, sin = np.cos(yaw), np.sin(yaw)
        there: Float64 = (points - begin) @ np.array([[cos, -sin], [sin, cos]])
        return there

    way = laid(way)
    path = _at_speed(way, speed) if speed else _in_time(way, SWEEPS / sensor.rate)
    sweeps = int(np.ceil(path.duration * sensor.rate)) if speed else SWEEPS
    stage = Stage(
        [make.wall(laid(corners)) for corners in plan.walls], laid(_rectangle(*plan.floor)[:4]), path, sweeps / sensor.rate
    )
    _furnish(rng, stage)
    room = _room(stage)
    places = [plan.places[number % len(plan.places)] for number in range(PEOPLE)]
    sent = [_send(rng, stage, room, laid, place) for place in places]
    people = tuple(person for person in sent if person is not None)
    return Scene(f"{kind}-{seed}", sensor, (*stage.entities, *people), path, odometry=Odometry(), sweeps=sweeps)


def straight(seed: int) -> Scene:
    """A robot in a corridor without doors or things, whose ends its sensor does not reach."""
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([6, seed])))
    wide, side, thick = rng.uniform(1.4, 3.0), rng.uniform(0.35, 0.65), 0.15
    first, last = -2.0 * SENSOR.range_max, STRAIGHT_WAY + 2.0 * SENSOR.range_max
    walls = [make.wall(_rectangle(first, y, last, y + thick)) for y in (-side * wide - thick, (1.0 - side) * wide)]
    # It sways, as robots do.
    middle = [(x, rng.uniform(-0.1, 0.1)) for x in np.arange(5.0, STRAIGHT_WAY, 5.0)]
    way = np.array([(0.0, 0.0), (1.0, 0.0), *middle, (STRAIGHT_WAY, 0.0)])
    points = [Waypoint(float(x), float(y), STRAIGHT_SPEED) for x, y in way]
    path = plan_route(points, acceleration=_ACCELERATION, turn_rate=_TURN_RATE, corner_radius=_RADIUS)
    sweeps = int(path.duration * SENSOR.rate)
    return Scene(f"straight-{seed}", SENSOR, tuple(walls), path, odometry=Odometry(), sweeps=sweeps)


def walkers(scene: Scene) -> list[Entity]:
    """The people who walk."""
    return [entity for entity in scene.entities if entity.kind == "person" and not entity.motion.still]


def length(scene: Scene) -> float:
    """How far the robot goes [m]."""
    poses = scene.sensor_poses(np.arange(scene.sweeps) / scene.sensor.rate)
    return float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum())


def fastest_turn(scene: Scene) -> float:
    """Of the robot [rad/s], from sweep to sweep."""
    yaw = scene.sensor_poses(np.arange(scene.sweeps) / scene.sensor.rate)[:, 2]
    return float(np.abs(np.diff(np.unwrap(yaw))).max() * scene.sensor.rate)


def _corridors(rng: Rng) -> _Plan:
    """A ring of corridors around a core, with rooms on both sides."""
    thick, half, deep = 0.15, rng.uniform(1.3, 1.5), rng.uniform(3.0, 4.0)
    a = rng.uniform(20.0, 24.0)
    b = 36.0 - a
    plan = _Plan()
    for y in (half, b - half - thick):
        plan.run(rng, half, a - half, y, thick)
    for x in (half, a - half - thick):
        plan.run(rng, half + thick, b - half - thick, x, thick, upright=True)
    for y in (-half - thick, b + half):
        plan.run(rng, -half, a + half, y, thick)
    for x in (-half - thick, a + half):
        plan.run(rng, -half, b + half, x, thick, upright=True)
    out = half + thick + deep
    plan.slab(-out, -out - thick, a + out, -out)
    plan.slab(-out, b + out, a + out, b + out + thick)
    plan.slab(-out - thick, -out, -out, b + out)
    plan.slab(a + out, -out, a + out + thick, b + out)
    for y in (-out, b + half + thick):
        at = -half
        while at < a + half:
            plan.slab(at, y, at + thick, y + deep)
            at += rng.uniform(2.5, 6.0)
    for x in (-out, a + half + thick):
        at = 0.0
        while at < b:
            plan.slab(x, at, x + deep, at + thick)
            at += rng.uniform(2.5, 6.0)
    at = half + rng.uniform(2.5, 5.0)
    while at < a - half - 2.0:
        plan.slab(at, half + thick, at + thick, b - half - thick)
        at += rng.uniform(3.0, 6.0)
    plan.slab(half + thick, b / 2 - thick / 2, a - half - thick, b / 2 + thick / 2)
    # It keeps to the right, and people have room to pass on the left.
    side = rng.uniform(0.25, 0.4)
    plan.way = [(a / 2, -side), (a + side, -side), (a + side, b + side), (-side, b + side), (-side, -side)]
    plan.places = [
        (-half, -half, a + half, half),
        (a - half, -half, a + half, b + half),
        (-half, b - half, a + half, b + half),
        (-half, -half, half, b + half),
        (-out, -out, a + out, b + out),
    ]
    plan.floor = (-out, -out, a + out, b + out)
    return plan


def _rooms(rng: Rng) -> _Plan:
    """Two rows of three rooms, each open to the next."""
    thick = rng.uniform(0.1, 0.2)
    x = np.concatenate([[0.0], np.cumsum(rng.uniform(9.5, 12.0, 3))])
    y = np.concatenate([[0.0], np.cumsum(rng.uniform(8.0, 10.0, 2))])
    plan = _Plan()
    plan.slab(-thick, -thick, x[3] + thick, 0.0)
    plan.slab(-thick, y[2], x[3] + thick, y[2] + thick)
    plan.slab(-thick, 0.0, 0.0, y[2])
    plan.slab(x[3], 0.0, x[3] + thick, y[2])
    cells = [(column, row) for row in range(2) for column in range(3)]
    ring = [(0, 0), (1, 0), (2, 0), (2, 1), (1, 1), (0, 1)]
    doors = {}
    for column, row in cells:
        if column < 2:
            at = rng.uniform(y[row] + 1.8, y[row + 1] - 1.8)
            plan.door(y[row], y[row + 1], x[column + 1], at, rng.uniform(1.2, 1.6), thick, upright=True)
            doors[(column, row), (column + 1, row)] = (x[column + 1] + thick / 2, at)
        if row == 0:
            at = rng.uniform(x[column] + 1.8, x[column + 1] - 1.8)
            plan.door(x[column], x[column + 1], y[1], at, rng.uniform(1.2, 1.6), thick, upright=False)
            doors[(column, 0), (column, 1)] = (at, y[1] + thick / 2)
    for number, (column, row) in enumerate(ring):
        middle = np.array([x[column] + x[column + 1], y[row] + y[row + 1]]) / 2
        plan.way.append(tuple(middle + rng.uniform(-1.2, 1.2, 2)))
        after = ring[(number + 1) % len(ring)]
        door = np.array(doors.get(((column, row), after)) or doors[after, (column, row)])
        step = np.array([after[0] - column, after[1] - row]) * _AT_DOOR
        plan.way += [tuple(door - step), tuple(door + step)]
        plan.places.append((x[column], y[row], x[column + 1], y[row + 1]))
    plan.floor = (0.0, 0.0, x[3], y[2])
    return plan


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> Float64:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])


def _at_speed(way: Float64, speed: float) -> Route:
    """The loop at this speed, and to its beginning again."""
    points = [Waypoint(float(x), float(y), speed) for x, y in (*way, way[0])]
    return plan_route(points, acceleration=_ACCELERATION, turn_rate=_TURN_RATE, corner_radius=_RADIUS)


def _in_time(way: Float64, seconds: float) -> Route:
    """The loop at the speed at which it takes so long."""
    slow, fast = 0.05, 5.0
    for _ in range(40):
        speed = (slow + fast) / 2
        slow, fast = (speed, fast) if _at_speed(way, speed).duration > seconds else (slow, speed)
    return _at_speed(way, fast)


def _furnish(rng: Rng, stage: Stage) -> None:
    """Put up to `THINGS` where nothing is in their way."""
    low, high = stage.floor.min(axis=0), stage.floor.max(axis=0)
    for _ in range(THINGS):
        for _ in range(_TRIES):
            x, y = (float(value) for value in rng.uniform(low, high))
            if rng.random() < 0.25:
                wide, yaw = rng.uniform(0.38, 0.5), rng.uniform(-np.pi, np.pi)
                thing = make.legged("chair", x, y, wide, wide, 0.04, yaw)
            else:
                thing = draw_thing(rng, x, y, legged=False, largest=1.2)
            if stage.stand(thing):
                break


@dataclass(frozen=True, eq=False, slots=True)
class _Room:
    """Where people can walk, looked up on a raster: thousands of ways are tried."""

    low: Float64
    """(2,) lower left corner of the raster [m]."""
    free: Bool
    """(columns, rows) whether the middle of each of its squares is far enough from all that stands."""

    def clear(self, here: Float64, there: Float64) -> bool:
        """True where the straight way is free."""
        # Most ways that are not free end where nobody can be.
        x, y = ((here + (there - here) - self.low) / _SQUARE).tolist()
        columns, rows = self.free.shape
        if not (0 <= x < columns and 0 <= y < rows and self.free[int(x), int(y)]):
            return False
        count = max(2, int(np.hypot(*(there - here)) / _SQUARE))
        places = here + np.linspace(0.0, 1.0, count)[:, None] * (there - here)
        at = np.floor((places - self.low) / _SQUARE).astype(np.int64)
        inside = (at >= 0).all() and (at < self.free.shape).all()
        return bool(inside and self.free[at[:, 0], at[:, 1]].all())


def _room(stage: Stage) -> _Room:
    low = stage.floor.min(axis=0)
    shape = np.ceil((stage.floor.max(axis=0) - low) / _SQUARE).astype(np.int64)
    free = np.empty(shape, np.bool_)
    for column in range(shape[0]):
        middles = low + (np.column_stack([np.full(shape[1], column), np.arange(shape[1])]) + 0.5) * _SQUARE
        free[column] = to_segments(middles, stage.sides) > _ASIDE
    return _Room(low, free)


def _send(rng: Rng, stage: Stage, room: _Room, laid: _Laid, place: tuple[float, float, float, float]) -> Entity | None:
    """Somebody who walks about all the time, beginning in this place, and pauses here and there for up to 3 s."""
    gap, leg = rng.uniform(0.18, 0.3), rng.uniform(0.09, 0.15)
    speed = rng.uniform(0.7, 1.4)
    for _ in range(_TRIES):
        start = laid(rng.uniform(place[:2], place[2:])[None])[0]
        route = _stroll(rng, stage, room, start, speed) if stage.clear(start, start, _ASIDE) else None
        if route is not None:
            return make.person(float(start[0]), float(start[1]), 0.0, gap, leg, SceneMotion(route=route))
    return None


def _stroll(rng: Rng, stage: Stage, room: _Room, start: Float64, speed: float) -> Route | None:
    """A way from there that lasts, None where none was found; who would meet somebody goes elsewhere before."""
    points = [start]
    for _ in range(_REPAIRS):
        way = np.hypot(*np.diff(points, axis=0).T).sum()
        # The pauses, and what is lost at corners, only make it last longer.
        while way < speed * stage.duration:
            there = _elsewhere(rng, stage, room, points[-1])
            if there is None:
                return None
            way += np.hypot(*(there - points[-1]))
            points.append(there)
        route = plan_route(timed(rng, points, speed, stop=0.3, pause=0.2), turn_rate=np.radians(120), corner_radius=0.4)
        state = route.state(stage.seconds)
        places = np.column_stack([state.x, state.y])
        met = np.zeros(len(places), np.bool_)
        for others in (stage.sensor, *(track for track, _ in stage.tracks)):
            met |= np.hypot(*(places - others).T) < _APART
        if not met.any():
            stage.tracks.append((places, _ASIDE))
            return route
        passed = np.cumsum(np.hypot(*np.diff(points, axis=0).T))
        kept = int(np.searchsorted(passed, state.arc[met.argmax()])) + 1 - int(rng.integers(3))
        del points[max(kept, 1) :]
    return None


def _elsewhere(rng: Rng, stage: Stage, room: _Room, here: Float64) -> Float64 | None:
    """A place near by to which the straight way is free, None where none was found."""
    for _ in range(_TRIES):
        angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(*_STRAIGHT)
        there = here + away * np.array([np.cos(angle), np.sin(angle)])
        if room.clear(here, there) and in_polygon(there, stage.floor):
            return there
    return None
