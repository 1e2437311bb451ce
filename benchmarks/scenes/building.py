"""Random scenes that look like real buildings: corridors and rooms of thick walls in pieces, with all that walls carry.

Between doorways stand pieces of wall of 0.25 to 4 m; pilasters, radiators and skirting stand out from them, niches go in,
door leaves stand ajar, side rooms and a second corridor are seen through the gaps. Things stand square to the walls, close
to them, against them, or free. The sensor drives 1.5 m if it is let, and stands otherwise.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from benchmarks.scenes.clearance import distance, outline
from benchmarks.scenes.random import Plan, Rng, draw_thing
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Entity, Scene, SceneSensor
from lidarcli.sweeps.types import Float64

Kind = Literal["passage", "chamber"]
KINDS: tuple[Kind, ...] = ("passage", "chamber")
WAY = 1.5
"""[m] that the sensor drives."""
SWEEPS = 20
"""in which it does."""
_CLEAR = 0.4
"""Least distance between the way of the sensor and anything [m]."""
_TRIES = 60
_DARK = (0.3, 0.8)
"""Shares of the beams that black things and panes swallow."""


def building_scene(kind: Kind, seed: int, sensor: SceneSensor, *, driving: bool = False, legged: bool = True) -> Scene:
    """A scene of one kind; the same seed gives the same building for every sensor.

    With `driving` the sensor goes 1.5 m straight ahead within 20 sweeps. Without `legged` there are no ladders, chairs,
    tables and two-legged persons.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([3, KINDS.index(kind), seed])))
    while True:
        plan = _plan(rng, kind, legged)
        if plan is not None:
            break
    x, y, yaw = plan.sensor
    # Around a thin loop: it never comes as far as the turn.
    end = np.array([x + 2 * WAY * np.cos(yaw), y + 2 * WAY * np.sin(yaw)])
    if driving:
        path = Course(np.array([[x, y], end]), speed=WAY * sensor.rate / SWEEPS)
    else:
        path = Course(np.array([[x, y]]), yaw=yaw)
    entities = tuple(_blackened(rng, entity) for entity in plan.walls + plan.entities)
    return Scene(f"{kind}-{seed}", sensor, entities, path, sweeps=SWEEPS)


def _blackened(rng: np.random.Generator, entity: Entity) -> Entity:
    """Now and then a thing is black, or a piece of wall a pane."""
    chance = 0.03 if entity.wall else 0.04
    return replace(entity, lost=float(rng.uniform(*_DARK))) if rng.random() < chance else entity


def _plan(rng: Rng, kind: Kind, legged: bool) -> Plan | None:
    """A building with its things; None where there is no way for the sensor."""
    if kind == "passage":
        a, b = rng.uniform(12, 30), rng.uniform(1.6, 3.2)
    else:
        a, b = rng.uniform(3.5, 9, 2)
    thick = rng.uniform(0.1, 0.35)
    floor = np.array([[0, 0], [a, 0], [a, b], [0, b]])
    building = _Building(rng, thick)
    building.ring(floor, decorated=True)
    behind = rng.uniform(1.4, 4.5)
    out = behind + thick
    building.ring(np.array([[-out, -out], [a + out, -out], [a + out, b + out], [-out, b + out]]))
    building.partitions(a, b, behind)
    sensor = _way(rng, building.walls, a, b)
    if sensor is None:
        return None
    plan = Plan(building.walls, sensor, [], ahead=WAY)
    reach = 8.0

    def spot() -> Float64:
        place = rng.uniform([0, 0], [a, b])
        if kind == "passage":
            place[0] = np.clip(sensor[0] + rng.uniform(-reach, reach), 0.3, a - 0.3)
        return place

    count = int(rng.integers(4, 12))
    near = int(rng.binomial(count, 0.3))
    for _ in range(near):
        _against_wall(rng, plan, building)
    largest = 0.5 if kind == "passage" else 1.2

    def free() -> Entity:
        x, y = spot()
        return draw_thing(rng, float(x), float(y), legged, largest=largest)

    plan.fill(count - near, free, rng.uniform(0.05, 0.3), floor)
    # A few stand in the rooms behind.
    low, high = np.array([-behind, -behind]), np.array([a + behind, b + behind])
    plan.fill(int(rng.integers(0, 2)), lambda: _behind(rng, low, high, floor, legged), 0.05)
    return plan


def _behind(rng: Rng, low: Float64, high: Float64, floor: Float64, legged: bool) -> Entity:
    """Something in the rooms around the one that the sensor is in."""
    while True:
        x, y = rng.uniform(low, high)
        if not (floor[0, 0] - 0.5 < x < floor[2, 0] + 0.5 and floor[0, 1] - 0.5 < y < floor[2, 1] + 0.5):
            return draw_thing(rng, float(x), float(y), legged, largest=1.0)


def _way(rng: Rng, walls: list[Entity], a: float, b: float) -> tuple[float, float, float] | None:
    """Where the sensor begins to drive, and its heading."""
    sides = np.vstack([outline(wall) for wall in walls])
    for _ in range(_TRIES):
        x, y = rng.uniform([0.1 * a, 0.25 * b], [0.9 * a, 0.75 * b])
        yaw = rng.uniform(-np.pi, np.pi)
        end = x + WAY * np.cos(yaw), y + WAY * np.sin(yaw)
        if not (0 < end[0] < a and 0 < end[1] < b):
            continue
        if distance(sides, np.array([[x, y, *end]])) >= _CLEAR:
            return float(x), float(y), float(yaw)
    return None


def _against_wall(rng: Rng, plan: Plan, building: _Building) -> None:
    """A box square to one of the walls: a little before it, or touching it and deeper than what belongs to a wall."""
    for _ in range(_TRIES):
        start, end = building.faces[int(rng.integers(len(building.faces)))]
        long = float(np.hypot(*(end - start)))
        along = (end - start) / long
        inward = np.array([-along[1], along[0]])
        touching = rng.random() < 0.12
        gap = 0.0 if touching else rng.uniform(0.05, 0.4)
        length = rng.uniform(0.2, 1.3)
        width = rng.uniform(0.35, 0.65) if touching else rng.uniform(0.15, 0.65)
        place = start + along * rng.uniform(0, long) + inward * (gap + width / 2 + 1e-3)
        yaw = float(np.arctan2(along[1], along[0])) + rng.normal(0, 0.02) * (not touching)
        box = make.box(float(place[0]), float(place[1]), length, width, yaw)
        if plan.add(box, 0.0 if touching else 0.02):
            return


class _Building:
    """Walls in the making."""

    def __init__(self, rng: Rng, thick: float) -> None:
        self.rng = rng
        self.thick = thick
        self.walls: list[Entity] = []
        self.faces: list[tuple[Float64, Float64]] = []
        """The inner sides of the pieces of wall around the floor, counter-clockwise."""

    def block(self, origin: Float64, along: Float64, begin: float, end: float, low: float, high: float) -> None:
        """A solid piece from `begin` to `end` along a line, from `low` to `high` outwards of it."""
        outward = np.array([along[1], -along[0]])
        corners = [
            origin + along * at + outward * out
            for at, out in ((begin, low), (end, low), (end, high), (begin, high), (begin, low))
        ]
        self.walls.append(make.wall(np.array(corners)))

    def ring(self, corners: Float64, *, decorated: bool = False) -> None:
        """The walls around a counter-clockwise polygon, in pieces between doorways."""
        for number in range(len(corners)):
            start, end = corners[number], corners[(number + 1) % len(corners)]
            long = float(np.hypot(*(end - start)))
            along = (end - start) / long
            for begin, until in self.pieces(long):
                # The corner is filled by the piece that begins there.
                low = begin - self.thick if begin == 0 else begin
                high = until + self.thick if until == long else until
                if not (decorated and self.niche(start, along, low, high)):
                    self.block(start, along, low, high, 0.0, self.thick)
                    if decorated:
                        self.faces.append((start + along * begin, start + along * until))
                        self.carry(start, along, begin, until)

    def pieces(self, long: float) -> list[tuple[float, float]]:
        """Stretches of a side that are wall, of 0.25 to 4 m."""
        rng = self.rng
        if rng.random() < 0.2:
            return [(0.0, long)]
        found: list[tuple[float, float]] = []
        at = 0.0
        while True:
            length = float(np.exp(rng.uniform(np.log(0.25), np.log(4.0))))
            gap = rng.uniform(0.7, 1.3) if rng.random() < 0.85 else rng.uniform(0.1, 0.5)
            if at + length + gap + 0.25 > long:
                return [*found, (at, long)]
            found.append((at, at + length))
            at += length + gap

    def niche(self, start: Float64, along: Float64, begin: float, end: float) -> bool:
        """Now and then an alcove in a piece, whose back wall lies deeper."""
        rng, long = self.rng, end - begin
        if long < 1.0 or rng.random() > 0.2:
            return False
        width = rng.uniform(0.4, min(1.6, long - 0.4))
        left = begin + rng.uniform(0.2, long - width - 0.2)
        depth = rng.uniform(0.1, 0.6)
        right = left + width
        self.block(start, along, begin, left, 0.0, self.thick + depth)
        self.block(start, along, right, end, 0.0, self.thick + depth)
        self.block(start, along, left, right, depth, self.thick + depth)
        return True

    def carry(self, start: Float64, along: Float64, begin: float, end: float) -> None:
        """What stands out from a piece of wall: pilasters, radiators, skirting, a door leaf at its end."""
        rng, long = self.rng, end - begin
        if long > 0.5 and rng.random() < 0.35:
            for _ in range(int(rng.integers(1, 3))):
                width = rng.uniform(0.12, 0.6)
                if width < long:
                    at = begin + rng.uniform(0, long - width)
                    self.block(start, along, at, at + width, -rng.uniform(0.04, 0.3), 0.0)
        if long > 1.0 and rng.random() < 0.2:
            width = rng.uniform(0.4, min(1.6, long - 0.1))
            at = begin + rng.uniform(0, long - width)
            before = rng.uniform(0.02, 0.06)
            self.block(start, along, at, at + width, -before - rng.uniform(0.05, 0.12), -before)
        if rng.random() < 0.15:
            self.block(start, along, begin, end, -rng.uniform(0.008, 0.025), 0.0)
        if rng.random() < 0.25:
            # A leaf hangs at the end of the piece and is open by some angle, into the room or out of it.
            angle, wide = rng.uniform(0.2, 2.0), rng.uniform(0.65, 0.95)
            inward = 1.0 if rng.random() < 0.6 else -1.0
            side = np.array([-along[1], along[0]]) * inward
            hinge = start + along * (end + 0.01) + (0.0 if inward > 0 else self.thick) * side
            heading = along * np.cos(angle) + side * np.sin(angle)
            across = np.array([-heading[1], heading[0]]) * 0.02
            ends = (hinge - across, hinge + heading * wide - across, hinge + heading * wide + across, hinge + across)
            self.walls.append(make.wall(np.array([*ends, ends[0]])))

    def partitions(self, a: float, b: float, behind: float) -> None:
        """Walls across the space behind the first ones, which make rooms of it."""
        for (x, y), along, long in (
            ((0.0, 0.0), (1.0, 0.0), a),
            ((a, 0.0), (0.0, 1.0), b),
            ((a, b), (-1.0, 0.0), a),
            ((0.0, b), (0.0, -1.0), b),
        ):
            at = self.rng.uniform(0.3, 3.0)
            while at < long:
                self.block(np.array([x, y]), np.array(along), at, at + self.thick, self.thick, self.thick + behind)
                at += self.rng.uniform(1.5, 6.0)
