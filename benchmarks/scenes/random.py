"""Random scenes with known answers: rooms, corridors at grazing incidence, crowded halls open to infinity.

The sensor stands at a random pose; entities touch neither each other, nor the walls, nor the sensor.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchmarks.scenes.clearance import covers, distance, in_polygon, outline
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Entity, Scene, SceneSensor
from lidarcli.sweeps.types import TURN, Float64

Kind = Literal["room", "corridor", "hall"]
KINDS: tuple[Kind, ...] = ("room", "corridor", "hall")
Rng = np.random.Generator

SENSORS = {
    "361": SceneSensor(361, -np.pi, TURN / 360, 0.1, 12.0),
    "720": SceneSensor(720, 0.0, TURN / 720, 0.1, 12.0),
    "1081": SceneSensor(1081, -0.75 * np.pi, 1.5 * np.pi / 1080, 0.1, 30.0),
}
"""A closed ±180°, a [0°, 360°) and a 270° view."""
FAULTS = ((0.0, 0.0), (0.01, 0.003), (0.03, 0.01))
"""(noise [m], share of lost beams) of a perfect, a good and a poor sensor."""

_FREE = 0.15
"""Least distance between two entities [m]."""
_AROUND = 0.4
"""Least distance between the sensor and anything [m]."""
_TRIES = 60


CHEAP_NOISE = (0.005, 0.005)
"""[m], and per metre of range: of a cheap triangulating sensor."""


def cheap(sensor: SceneSensor) -> SceneSensor:
    """The same sensor made cheaply: noise that grows, ranges in steps, mixed pixels, beams that flicker or are lost."""
    return replace(
        sensor,
        noise=CHEAP_NOISE[0],
        noise_per_metre=CHEAP_NOISE[1],
        resolution=0.005,
        mixed_pixels=0.5,
        flicker=0.08,
        lost=0.01,
        lost_as="mixed",
    )


def sensor_with(sensor: SceneSensor, noise: float, lost: float) -> SceneSensor:
    """The same sensor with faults: half of the lost beams come back as inf, half as NaN."""
    return replace(sensor, noise=noise, lost=lost, lost_as="mixed")


def random_scene(kind: Kind, seed: int, sensor: SceneSensor, *, legged: bool = True) -> Scene:
    """A scene of one kind; the same seed gives the same scene for every sensor.

    Without `legged` there are no ladders, chairs, tables and two-legged persons.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([KINDS.index(kind), seed])))
    plan = {"room": _room, "corridor": _corridor, "hall": _hall}[kind](rng, legged)
    path = Course(np.array([plan.sensor[:2]]), yaw=plan.sensor[2])
    return Scene(f"{kind}-{seed}", sensor, tuple(plan.walls + plan.entities), path)


@dataclass(eq=False, slots=True)
class Plan:
    """A scene in the making."""

    walls: list[Entity]
    sensor: tuple[float, float, float]
    entities: list[Entity]
    ahead: float = 0.0
    """[m] So far the sensor is to drive, and nothing is in its way."""

    @property
    def driven(self) -> Float64:
        """(1, 4) the way of the sensor."""
        x, y, yaw = self.sensor
        return np.array([[x, y, x + self.ahead * np.cos(yaw), y + self.ahead * np.sin(yaw)]])

    def add(self, entity: Entity, from_walls: float = 0.05, inside: Float64 | None = None) -> bool:
        """Take the entity if nothing is in its way."""
        if inside is not None and not in_polygon(np.array([entity.x, entity.y]), inside):
            return False
        sides = outline(entity)
        if distance(sides, self.driven) < _AROUND or covers(entity, self.sensor[:2]):
            return False
        if any(distance(sides, outline(wall)) < from_walls for wall in self.walls):
            return False
        for other in self.entities:
            reach = np.hypot(entity.length, entity.width) + np.hypot(other.length, other.width)
            if np.hypot(entity.x - other.x, entity.y - other.y) > reach / 2 + _FREE:
                continue
            apart = distance(sides, outline(other)) >= _FREE
            if not apart or covers(entity, (other.x, other.y)) or covers(other, (entity.x, entity.y)):
                return False
        self.entities.append(entity)
        return True

    def fill(self, count: int, draw: Callable[[], Entity], from_walls: float = 0.05, inside: Float64 | None = None) -> None:
        """Add up to `count` entities, each with a bounded number of tries."""
        for _ in range(count):
            for _ in range(_TRIES):
                if self.add(draw(), from_walls, inside):
                    break


def _room(rng: Rng, legged: bool) -> Plan:
    a, b = rng.uniform(4, 10, 2)
    corners = np.array([[0, 0], [a, 0], [a, b], [0, b]])
    if rng.random() < 0.4:
        ca, cb = a * rng.uniform(0.4, 0.7), b * rng.uniform(0.4, 0.7)
        corners = np.array([[0, 0], [a, 0], [a, cb], [ca, cb], [ca, b], [0, b]])
    walls = _walls_with_doors(rng, corners, int(rng.integers(0, 3)))
    for _ in range(1000):
        spot = rng.uniform(0, 1, 2) * [a, b]
        if in_polygon(spot, corners) and distance(make.closed(corners), np.tile(spot, 2)[None]) > 0.8:
            break
    plan = Plan(walls, (spot[0], spot[1], rng.uniform(-np.pi, np.pi)), [])
    count = int(rng.integers(3, 11))
    near = int(rng.binomial(count, 0.3))
    plan.fill(near, lambda: _beside_wall(rng, corners, rng.uniform(0.1, 0.4)), 0.08, corners)
    plan.fill(
        count - near, lambda: draw_thing(rng, rng.uniform(0, a), rng.uniform(0, b), legged), rng.uniform(0.1, 0.4), corners
    )
    return plan


def _corridor(rng: Rng, legged: bool) -> Plan:
    length, width = rng.uniform(15, 40), rng.uniform(1.5, 3.0)
    walls: list[Entity] = []
    for side in (0.0, width):
        walls += _corridor_side(rng, length, side, 1.0 if side else -1.0)
    for end in (0.0, length):
        if rng.random() < 0.6:
            walls.append(make.wall([[end, 0], [end, width]]))
    spot = (rng.uniform(0.15, 0.85) * length, rng.uniform(0.35, 0.65) * width)
    heading = rng.normal(0, 0.15) + (np.pi if rng.random() < 0.5 else 0)
    plan = Plan(walls, (*spot, heading), [])
    area = np.array([[0, 0], [length, 0], [length, width], [0, width]])
    reach = 9.0

    def along() -> float:
        return float(np.clip(spot[0] + rng.uniform(-reach, reach), 0.3, length - 0.3))

    def near_wall() -> Entity:
        size = rng.uniform(0.2, 0.6, 2) * [1, 0.8]
        gap = rng.uniform(0.15, 0.35) + size[1] / 2
        turn = rng.normal(0, 0.03)
        return make.box(along(), gap if rng.random() < 0.5 else width - gap, size[0], size[1], turn)

    def pole() -> Entity:
        return make.cylinder(along(), rng.uniform(0.2, width - 0.2), rng.uniform(0.02, 0.06))

    def thing() -> Entity:
        return draw_thing(rng, along(), rng.uniform(0.3, width - 0.3), legged, largest=0.5)

    plan.fill(int(rng.integers(2, 6)), near_wall, 0.12, area)
    plan.fill(int(rng.integers(2, 5)), pole, 0.12, area)
    plan.fill(int(rng.integers(0, 3)), thing, 0.15, area)
    return plan


def _hall(rng: Rng, legged: bool) -> Plan:
    walls = []
    crowd = rng.uniform(4, 10)
    for _ in range(int(rng.choice([0, 0, 1, 2, 3]))):
        away, angle, half = crowd + rng.uniform(0.5, 2), rng.uniform(-np.pi, np.pi), rng.uniform(1, 6)
        out = np.array([np.cos(angle), np.sin(angle)])
        side = np.array([-out[1], out[0]])
        walls.append(make.wall(np.array([out * away - side * half, out * away + side * half])))
    plan = Plan(walls, (0.0, 0.0, rng.uniform(-np.pi, np.pi)), [])

    def thing() -> Entity:
        # Uniform in the distance, not over the area, which would leave the neighbourhood empty.
        away, angle = rng.uniform(0.8, crowd), rng.uniform(-np.pi, np.pi)
        return draw_thing(rng, away * np.cos(angle), away * np.sin(angle), legged)

    plan.fill(int(rng.integers(15, 41)), thing, 0.15)
    return plan


def draw_thing(rng: Rng, x: float, y: float, legged: bool, largest: float = 1.2) -> Entity:
    """Something of a random kind at the place."""
    yaw = float(rng.uniform(-np.pi, np.pi))
    kinds = ["box", "cylinder", "pole", "plant", "person", "chair", "table", "ladder"]
    odds = np.array([0.36, 0.18, 0.1, 0.08, 0.12, 0.07, 0.04, 0.05])
    if not legged:
        kinds, odds = kinds[:4], odds[:4]
    kind = str(rng.choice(kinds, p=odds / odds.sum()))
    if kind == "box":
        width, length = np.sort(rng.uniform(0.15, largest, 2))
        return make.box(x, y, length, width, yaw)
    if kind == "cylinder":
        return make.cylinder(x, y, rng.uniform(0.1, min(0.4, largest / 2)))
    if kind == "pole":
        return make.cylinder(x, y, rng.uniform(0.02, 0.06))
    if kind == "plant":
        return make.plant(x, y, rng.uniform(0.2, min(0.45, largest / 2)), int(rng.integers(1 << 30)), yaw)
    if kind == "person":
        return make.person(x, y, yaw, rng.uniform(0.18, 0.32), rng.uniform(0.09, 0.15))
    sizes = {"chair": (0.38, 0.5), "table": (0.7, min(1.4, 2 * largest)), "ladder": (0.35, 0.6)}
    length = rng.uniform(*sizes[kind])
    return make.legged(kind, x, y, length, length * rng.uniform(0.6, 1.0), rng.uniform(0.02, 0.05), yaw)


def _beside_wall(rng: Rng, corners: Float64, gap: float) -> Entity:
    """A box that stands along one of the walls of a counter-clockwise polygon."""
    number = int(rng.integers(len(corners)))
    start, end = corners[number], corners[(number + 1) % len(corners)]
    along = (end - start) / np.hypot(*(end - start))
    inward = np.array([-along[1], along[0]])
    length, width = rng.uniform(0.2, 1.2), rng.uniform(0.15, 0.6)
    place = start + along * rng.uniform(0, np.hypot(*(end - start))) + inward * (gap + width / 2)
    return make.box(place[0], place[1], length, width, float(np.arctan2(along[1], along[0])))


def _walls_with_doors(rng: Rng, corners: Float64, doors: int) -> list[Entity]:
    """The walls of a room, with doorways that open into nothing."""
    openings: dict[int, tuple[float, float]] = {}
    for side in rng.permutation(len(corners))[:doors]:
        extent = float(np.hypot(*(corners[(side + 1) % len(corners)] - corners[side])))
        gap = rng.uniform(0.8, 1.2)
        if extent > gap + 1.0:
            begin = rng.uniform(0.4, extent - gap - 0.4)
            openings[int(side)] = (begin / extent, (begin + gap) / extent)
    jamb = rng.uniform(0.08, 0.25) if openings and rng.random() < 0.4 else 0.0
    return walls_with_openings(corners, openings, jamb)


def walls_with_openings(corners: Float64, openings: dict[int, tuple[float, float]], jamb: float) -> list[Entity]:
    """The walls of a counter-clockwise polygon; side → the shares of it between which it is open. Jambs go outwards."""
    if not openings:
        return [make.wall(np.vstack([corners, corners[:1]]))]
    order = [(side + min(openings)) % len(corners) for side in range(len(corners))]
    walls, run = [], []
    for side in [*order, order[0]]:
        start, end = corners[side], corners[(side + 1) % len(corners)]
        run.append(start)
        if side in openings:
            along = (end - start) / np.hypot(*(end - start))
            outward = np.array([along[1], -along[0]]) * jamb
            first, last = (start + share * (end - start) for share in openings[side])
            run += [first, first + outward] if jamb else [first]
            walls.append(run)
            run = [last + outward, last] if jamb else [last]
    # The walk began in the middle of a run and came round to its first doorway again.
    walls = walls[1:]
    return [make.wall(points) for points in walls]


def _corridor_side(rng: Rng, length: float, y: float, outward: float) -> list[Entity]:
    """One side of a corridor: doorways of about a metre that open into nothing or into a side room."""
    walls: list[Entity] = []
    jamb = rng.uniform(0.08, 0.25) if rng.random() < 0.4 else 0.0
    run: list[list[float]] = [[0.0, y]]
    at = rng.uniform(0.5, 5)
    last_room = 0.0
    while at + 2.0 < length:
        gap = rng.uniform(0.85, 1.2)
        until = at + gap + rng.uniform(2.0, 7.0)
        run += [[at, y], [at, y + outward * jamb]] if jamb else [[at, y]]
        walls.append(make.wall(run))
        run = [[at + gap, y + outward * jamb], [at + gap, y]] if jamb else [[at + gap, y]]
        if rng.random() < 0.5:
            left = max(last_room + 0.2, at - rng.uniform(0.2, 2.0))
            right = min(until - 0.2, at + gap + rng.uniform(0.2, 2.0))
            near, far = y + outward * jamb, y + outward * rng.uniform(2.0, 5.0)
            corners = [[at, near], [left, near], [left, far], [right, far], [right, near], [at + gap, near]]
            walls.append(make.wall(corners))
            last_room = right
        else:
            last_room = at + gap
        at = until
    walls.append(make.wall([*run, [length, y]]))
    return walls
