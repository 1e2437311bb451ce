"""Pairs of drawn runs: rooms with boxes that stay, are moved, added or taken, and the truth of what can be told."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import Course, Entity, Odometry, Scene, SceneSensor, super_ellipse
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import TURN, Bool, Float64

SENSORS = (
    SceneSensor(beams=720, angle_increment=TURN / 720, noise=0.01, range_max=20.0),
    SceneSensor(
        beams=1081, angle_min=-0.375 * TURN, angle_increment=TURN / 1440, noise=0.005, range_max=30.0, flicker=0.05
    ),
    SceneSensor(beams=360, angle_increment=TURN / 360, noise=0.015, range_max=12.0, lost=0.02, mixed_pixels=0.2),
)
"""A full turn at half a degree, 270 degrees at a quarter, and a cheap one of one degree."""
ROOM = ((-4.0, -3.0), (4.0, -3.0), (4.0, 1.0), (2.5, 1.0), (2.5, 3.0), (-4.0, 3.0))
"""A room with a corner cut out."""
ODOMETRY = Odometry(frame_id="map")


def closed(corners: Sequence[tuple[float, float]]) -> Entity:
    return make.wall([[*corner] for corner in (*corners, corners[0])])


def parked(x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> Course:
    return Course(np.array([[x, y]]), 0.0, yaw)


def write_run(
    path: Path,
    entities: Sequence[Entity],
    course: Course | None = None,
    sensor: SceneSensor = SENSORS[0],
    sweeps: int = 40,
    seed: int = 0,
    odometry: Odometry | None = None,
) -> str:
    """Write the log of a run; the name of its file."""
    scene = Scene(path.stem, sensor, tuple(entities), sweeps=sweeps, path=course or parked(), odometry=odometry)
    write_log(
        path, (block.raw for block in simulate_blocks(scene, sweeps, seed)), poses=simulate_odometry(scene, sweeps, seed)
    )
    return str(path)


@dataclass(frozen=True)
class Pair:
    """Two scenes, and what became of each box: its places in both, None where it is not."""

    before: tuple[Entity, ...]
    after: tuple[Entity, ...]
    boxes: tuple[tuple[Entity | None, Entity | None], ...]
    courses: tuple[Course, Course]
    sensor: SceneSensor
    odometry: Odometry | None

    def truth(self) -> list[tuple[str, Entity | None, Entity | None, bool]]:
        """Status of each box with its places, and whether it can be told: seen, and its place in view of the other run."""
        found = []
        for old, new in self.boxes:
            there = old is not None and self._in_view(0, old, self.before, own=True)
            here = new is not None and self._in_view(1, new, self.after, own=True)
            if old is not None and new is not None:
                status = "known" if math.hypot(old.x - new.x, old.y - new.y) < 0.05 else "moved"
                told = there and here
                if status == "moved":
                    told &= self._in_view(1, old, self.after) and self._in_view(0, new, self.before)
                    told &= self._sized(0, old) and self._sized(1, new)
            else:
                status = "gone" if new is None else "new"
                told = (
                    there and self._in_view(1, old, self.after)
                    if new is None
                    else (here and self._in_view(0, new, self.before))
                )
            found.append((status, old, new, bool(told)))
        return found

    def _sized(self, run: int, box: Entity) -> bool:
        """Return True if a run sees two sides of a box well enough to measure both."""
        course = self.courses[run]
        for eye in course.points[:: max(1, len(course.points) // 16)]:
            angle = math.atan2(eye[1] - box.y, eye[0] - box.x) - box.yaw
            away = math.hypot(eye[0] - box.x, eye[1] - box.y)
            across = box.length * abs(math.sin(angle)), box.width * abs(math.cos(angle))
            if min(across) / away >= 6 * abs(self.sensor.angle_increment):
                return True
        return False

    def _in_view(self, run: int, box: Entity, scene: Sequence[Entity], own: bool = False) -> bool:
        """Return True if a run sees most of the place of a box; its own box hides nothing of itself."""
        others = [each for each in scene if not (own and each is box)]
        segments = np.concatenate([_placed(each) for each in others])
        points = _corners(box, 0.9)
        course = self.courses[run]
        eyes = course.points[:: max(1, len(course.points) // 16)]
        shares = []
        for eye in eyes:
            way = points - eye
            away = np.hypot(*way.T)
            bearing = (np.arctan2(way[:, 1], way[:, 0]) - course.yaw + math.pi) % TURN - math.pi
            clear = ~_blocked(eye, points, segments) & (away < self.sensor.range_max - 0.5)
            if course.parked and self.sensor.angle_min > -3.1:
                clear &= np.abs(bearing) < -self.sensor.angle_min - 0.05
            shares.append(clear.mean())
        return max(shares) >= 0.8


def _corners(box: Entity, share: float) -> Float64:
    u, v = (part.ravel() for part in np.meshgrid(np.linspace(-0.5, 0.5, 5), np.linspace(-0.5, 0.5, 5)))
    cos, sin = math.cos(box.yaw), math.sin(box.yaw)
    u, v = share * box.length * u, share * box.width * v
    return np.column_stack([box.x + cos * u - sin * v, box.y + sin * u + cos * v])


def _placed(entity: Entity) -> Float64:
    cos, sin = math.cos(entity.yaw), math.sin(entity.yaw)
    x0, y0, x1, y1 = entity.segments.T
    return np.column_stack(
        [
            entity.x + cos * x0 - sin * y0,
            entity.y + sin * x0 + cos * y0,
            entity.x + cos * x1 - sin * y1,
            entity.y + sin * x1 + cos * y1,
        ]
    )


def _blocked(eye: Float64, points: Float64, segments: Float64) -> Bool:
    d = points - eye
    a, b = segments[:, :2] - eye, segments[:, 2:] - segments[:, :2]
    cross = d[:, :1] * b[:, 1] - d[:, 1:] * b[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / cross
        s = (a[:, 0] * d[:, 1:] - a[:, 1] * d[:, :1]) / cross
    return ((t > 0) & (t < 0.995) & (s >= 0) & (s <= 1)).any(axis=1)


def draw(seed: int) -> Pair:
    """A pair of runs in a room with a corner cut out."""
    chance = np.random.default_rng(seed)
    width, height = chance.uniform(6, 12), chance.uniform(5, 9)
    cut_x, cut_y = chance.uniform(0.2, 0.45) * width, chance.uniform(0.2, 0.45) * height
    right, top = width / 2, height / 2
    walls = closed(
        [
            (-right, -top),
            (right, -top),
            (right, top - cut_y),
            (right - cut_x, top - cut_y),
            (right - cut_x, top),
            (-right, top),
        ]
    )
    placed: list[tuple[float, float, float]] = [
        (0.0, 0.0, 0.9),
        (right - cut_x / 2, top - cut_y / 2, max(cut_x, cut_y) * 0.75),
    ]

    def place(length: float, width_: float) -> tuple[float, float] | None:
        radius = 0.5 * math.hypot(length, width_)
        for _ in range(200):
            x = chance.uniform(-right + radius + 0.25, right - radius - 0.25)
            y = chance.uniform(-top + radius + 0.25, top - radius - 0.25)
            if all(math.hypot(x - u, y - v) > radius + r + 0.25 for u, v, r in placed):
                placed.append((x, y, radius))
                return x, y
        return None

    boxes: list[tuple[Entity | None, Entity | None]] = []
    whats = ["stay"] * int(chance.integers(4, 7)) + ["moved"] * int(chance.integers(0, 3))
    whats += ["gone"] * int(chance.integers(0, 3)) + ["new"] * int(chance.integers(0, 3))
    sizes: list[tuple[float, float]] = []
    for what in whats:
        # Of two like boxes that are moved nobody can tell which is which.
        for _ in range(100):
            length = chance.uniform(0.3, 0.9)
            breadth = chance.uniform(0.5, 1.0) * length
            if what == "stay" or all(max(abs(length - a), abs(breadth - b)) > 0.12 for a, b in sizes):
                break
        if what != "stay":
            sizes.append((length, breadth))
        where = place(length, breadth)
        if where is None:
            continue
        box = make.box(*where, length, breadth, chance.uniform(0, math.pi))
        if what == "moved":
            then = place(length, breadth)
            if then is None:
                continue
            boxes.append((box, replace(box, x=then[0], y=then[1], yaw=chance.uniform(0, math.pi))))
        else:
            boxes.append((box if what != "new" else None, box if what != "gone" else None))
    kind = int(chance.integers(0, 3))
    sensor = SENSORS[int(chance.integers(0, len(SENSORS)))]
    if kind == 2:
        # Driving around the middle, in one world.
        courses = tuple(Course(super_ellipse(0.7 * size, 0.5 * size, 2.0), 0.4) for size in chance.uniform(0.8, 1.2, 2))
        odometry: Odometry | None = ODOMETRY
    else:
        courses = tuple(
            parked(chance.uniform(-0.5, 0.5), chance.uniform(-0.5, 0.5), chance.uniform(-math.pi, math.pi))
            for _ in range(2)
        )
        if kind == 0:
            courses = courses[0], courses[0]
        odometry = None
    before = (walls, *(old for old, _ in boxes if old is not None))
    after = (walls, *(new for _, new in boxes if new is not None))
    return Pair(before, after, tuple(boxes), (courses[0], courses[1]), sensor, odometry)
