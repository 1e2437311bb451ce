"""A scene in the making in which things move: who may stand where, and who may go where and when."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from benchmarks.scenes.clearance import covers, distance, in_polygon, outline, to_segments
from lidarcli.simulation.route import AHEAD, Corner, Route, Waypoint
from lidarcli.simulation.scene import Course, Entity
from lidarcli.sweeps.types import Float64

Rng = np.random.Generator

STEP = 0.05
"""Movers are looked at this often [s]: at 2 m/s towards each other they come 10 cm closer."""
_APART = 0.12
"""Least distance between two things [m]."""
_FROM_SENSOR = 0.4
"""Least distance between the sensor and anything [m]."""
_FROM_WALLS = 0.06
"""Least distance between a mover and a wall [m]."""
_SHORTEST, _LONGEST = 0.6, 6.0
"""Way from one waypoint to the next [m]."""
_MAX_POINTS = 14
_TRIES = 30


@dataclass(eq=False, slots=True)
class Stage:
    """The building, the sensor's path, and what has been put there so far."""

    walls: list[Entity]
    floor: Float64
    """(P, 2) corners of the polygon on which things stand and waypoints lie."""
    path: Course | Route
    duration: float
    """Of the scene [s]."""
    standing: list[Entity] = field(default_factory=list)
    movers: list[Entity] = field(default_factory=list)
    seconds: Float64 = field(init=False)
    sensor: Float64 = field(init=False)
    """(T, 2) where the sensor is at these times."""
    sides: Float64 = field(init=False)
    """(K, 4) of all that stands."""
    tracks: list[tuple[Float64, float]] = field(default_factory=list)
    """(T, 2) places of each mover, and how far it reaches around them."""

    def __post_init__(self) -> None:
        self.seconds = np.arange(0.0, self.duration + STEP, STEP)
        self.sensor = self.path.poses(self.seconds)[:, :2]
        self.sides = np.vstack([np.empty((0, 4)), *(outline(wall) for wall in self.walls)])

    @property
    def entities(self) -> tuple[Entity, ...]:
        """All of them: walls, what stands, what moves."""
        return (*self.walls, *self.standing, *self.movers)

    def stand(self, entity: Entity) -> bool:
        """Take what stands, if nothing is in its way; before any mover."""
        if not in_polygon(np.array([entity.x, entity.y]), self.floor):
            return False
        sides, here = outline(entity), (entity.x, entity.y)
        if to_segments(self.sensor, sides).min() < _FROM_SENSOR or covers(entity, tuple(self.sensor[0])):
            return False
        if len(self.sides) and distance(sides, self.sides) < _APART:
            return False
        if any(covers(entity, (other.x, other.y)) or covers(other, here) for other in self.standing):
            return False
        self.standing.append(entity)
        self.sides = np.vstack([self.sides, sides])
        return True

    def move(self, entity: Entity) -> float | None:
        """Take a mover, if it meets nobody and nothing at any time; else when it first does [s]."""
        places, around = entity.poses(self.seconds)[:, :2], reach(entity)
        close = np.hypot(*(places - self.sensor).T) < around + _FROM_SENSOR
        for others, beside in self.tracks:
            close |= np.hypot(*(places - others).T) < around + beside + _APART
        if close.any():
            return float(self.seconds[close.argmax()])
        if not self.free(places, around):
            return 0.0
        self.movers.append(entity)
        self.tracks.append((places, around))
        return None

    def free(self, places: Float64, around: float) -> bool:
        """True where a thing that reaches so far around any of (P, 2) places stands clear of what stands."""
        if len(self.sides) and to_segments(places, self.sides).min() < around + _FROM_WALLS:
            return False
        first = (float(places[0, 0]), float(places[0, 1]))
        return not any(covers(other, first) for other in self.standing)

    def clear(self, start: Float64, end: Float64, around: float) -> bool:
        """True where nothing that stands is on the straight way, nor a parked sensor."""
        share = np.linspace(0.0, 1.0, max(2, int(np.hypot(*(end - start)) / 0.1)))[:, None]
        places = start + share * (end - start)
        if self.path.parked and np.hypot(*(places - self.sensor[0]).T).min() < around + _FROM_SENSOR:
            return False
        return self.free(places, around)

    def spot(self, rng: Rng, around: float, before: Float64 | None) -> Float64 | None:
        """A random place on the floor to which the straight way is free, None where none was found."""
        low, high = self.floor.min(axis=0), self.floor.max(axis=0)
        for _ in range(_TRIES):
            place: Float64 = rng.uniform(low, high)
            start = place if before is None else before
            way = np.hypot(*(place - start))
            fits = before is None or _SHORTEST <= way <= _LONGEST
            if fits and in_polygon(place, self.floor) and self.clear(start, place, around):
                return place
        return None

    def wander(self, rng: Rng, around: float, far: float, begin: Sequence[Float64]) -> list[Float64]:
        """Points of a random way that goes on about `far` metres from those given; short where no way is free."""
        if any(not self.clear(*step, around) for step in pairwise(begin)):
            return []
        points = list(begin)
        way = 0.0
        while (way < far or not points) and len(points) < _MAX_POINTS:
            place = self.spot(rng, around, points[-1] if points else None)
            if place is None:
                break
            way += float(np.hypot(*(place - points[-1]))) if points else 0.0
            points.append(place)
        return points


def reach(entity: Entity) -> float:
    """How far the thing reaches around its centre, whichever way it is turned [m]."""
    if entity.kind == "person":
        aside, leg = float(entity.circles[0, 1]), float(entity.circles[0, 2])
        return float(np.hypot(AHEAD * entity.motion.stride, aside)) + leg
    ends = entity.segments.reshape(-1, 2)
    corners = np.hypot(ends[:, 0], ends[:, 1]).max(initial=0.0)
    rims = np.hypot(entity.circles[:, 0], entity.circles[:, 1]) + entity.circles[:, 2]
    return float(max(corners, rims.max(initial=0.0)))


def timed(rng: Rng, points: Sequence[Float64], speed: float, stop: float, pause: float) -> list[Waypoint]:
    """Waypoints at about this speed; a share of `stop` is turned at standing, a share of `pause` waited at."""
    found = []
    for number, (x, y) in enumerate(points):
        fast = max(0.15, speed * rng.uniform(0.7, 1.0))
        late = rng.random() < (0.5 if number == 0 else pause)
        wait = rng.uniform(0.5, 3.0) if late else 0.0
        corner: Corner = "stop" if rng.random() < stop else "round"
        found.append(Waypoint(float(x), float(y), fast, wait, corner))
    return found
