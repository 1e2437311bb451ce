"""Parts of a scene: a sensor, the path that carries it, and entities that stand or move.

An entity is drawn once, in its own frame, as straight segments and circles; where it stands at a time is its
pose. Lengths in metres, angles in radians, times in seconds from the first sweep.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from lidarcli.simulation.route import Route, feet
from lidarcli.sweeps import TURN, Bool, Float64

LostAs = Literal["inf", "nan", "mixed", "zero", "max"]
LOST_AS: tuple[LostAs, ...] = ("inf", "nan", "mixed", "zero", "max")


@dataclass(frozen=True, slots=True)
class Sensor:
    """A 2D LiDAR: its beams, its limits and its faults."""

    beams: int = 361
    angle_min: float = -np.pi
    angle_increment: float = TURN / 360
    """Negative for a sensor mounted upside down."""
    range_min: float = 0.1
    range_max: float = 12.0
    noise: float = 0.0
    """Standard deviation of a range along its beam [m]."""
    noise_per_metre: float = 0.0
    """Growth of the noise per metre of range, as of a cheap triangulating sensor."""
    resolution: float = 0.0
    """Ranges come in steps of this [m]; 0 for none."""
    lost: float = 0.0
    """Share of the beams that return nothing although something is there."""
    lost_as: LostAs = "mixed"
    """Value of a beam without a return; `mixed`: inf where nothing is, inf or NaN where lost."""
    rate: float = 10.0
    """Sweeps per second."""
    topic: str = "/scan"
    frame_id: str = "laser"
    beams_jitter: int = 0
    """Beam counts vary by up to this many from sweep to sweep, as on real 360° sensors."""
    mixed_pixels: float = 0.0
    """Share of the beams at an edge that report a range between the two surfaces."""
    flicker: float = 0.0
    """Share of the beams that would hit something and return nothing, in runs, where it is far or dark."""
    time_increment: float = 0.0
    """Time from beam to beam [s]; 0 for a sweep taken in an instant."""

    def bearings(self) -> Float64:
        """Return (B,) bearings of an undisturbed sweep."""
        bearings: Float64 = self.angle_min + self.angle_increment * np.arange(self.beams, dtype=np.float64)
        return bearings


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of an entity, and the time for which it exists."""

    velocity: tuple[float, float] = (0.0, 0.0)
    """World frame [m/s]."""
    yaw_rate: float = 0.0
    appears: float = -np.inf
    disappears: float = np.inf
    stride: float = 0.0
    """Legs of a walker swing forth and back by half of this, in turn; on a route, the length of a long step [m]."""
    cadence: float = 0.0
    """Full swings per second."""
    route: Route | None = None
    """Way through waypoints, instead of a velocity."""
    ahead: bool = True
    """On a route: whether the body turns with its heading, or at its own `yaw_rate`."""

    @property
    def still(self) -> bool:
        """True where every sweep sees the entity alike."""
        return self == STILL


STILL = Motion()


@dataclass(frozen=True, eq=False, slots=True)
class Entity:
    """One thing in the world: `segments` (K, 4) x0 y0 x1 y1 and `circles` (C, 3) x y radius, own frame."""

    kind: str
    """`box`, `cylinder`, `ladder`, `chair`, `table`, `plant`, `person`, `leg` or `wall`."""
    x: float
    y: float
    yaw: float
    length: float
    """Extent along its own x axis, symmetric about its origin."""
    width: float
    segments: Float64 = field(default_factory=lambda: np.empty((0, 4)))
    circles: Float64 = field(default_factory=lambda: np.empty((0, 3)))
    motion: Motion = STILL
    lost: float = 0.0
    """Share of lost beams among those that hit it: it is black, or of glass."""
    intensity: float | None = None
    """Intensity of returns from it, in the unit of the sensor; None if unknown."""

    @property
    def wall(self) -> bool:
        """True for what is part of the building."""
        return self.kind == "wall"

    def poses(self, seconds: Float64) -> Float64:
        """Return (S, 3) world x, y, yaw at the given times."""
        velocity, route = self.motion.velocity, self.motion.route
        if route is not None:
            poses = route.poses(seconds)
            own: Float64 = self.motion.yaw_rate * seconds
            poses[:, 2] = self.yaw + (poses[:, 2] if self.motion.ahead else own)
            return poses
        return np.column_stack(
            [self.x + velocity[0] * seconds, self.y + velocity[1] * seconds, self.yaw + self.motion.yaw_rate * seconds]
        )

    def velocities(self, seconds: Float64) -> Float64:
        """Return (S, 3) world vx, vy [m/s] and rate of the yaw [rad/s] at the given times; of a person, of its body."""
        motion = self.motion
        if motion.route is None:
            return np.tile([*motion.velocity, motion.yaw_rate], (len(seconds), 1))
        velocities = motion.route.state(seconds).velocities()
        if not motion.ahead:
            velocities[:, 2] = motion.yaw_rate
        return velocities

    def feet(self, seconds: Float64) -> Float64 | None:
        """Return (S, 2, 2) world x, y of the legs of a person who walks a route; None for anything else."""
        if self.kind != "person" or self.motion.route is None:
            return None
        return feet(self.motion.route, 2 * float(self.circles[0, 1]), seconds)

    def present(self, seconds: Float64) -> Bool:
        """Return (S,) True while the entity is there."""
        there: Bool = (seconds >= self.motion.appears) & (seconds < self.motion.disappears)
        return there


@dataclass(frozen=True, eq=False, slots=True)
class Course:
    """A closed polyline driven at constant speed, facing ahead; one point is a parked sensor."""

    points: Float64
    """(P, 2) corners, the last one joins the first."""
    speed: float = 0.0
    yaw: float = 0.0
    """Heading of a parked sensor."""

    @property
    def parked(self) -> bool:
        """True where every sweep is taken from one pose."""
        return len(self.points) < 2 or self.speed == 0

    def poses(self, seconds: Float64) -> Float64:
        """Return (S, 3) world x, y, yaw at the given times."""
        if self.parked:
            return np.tile([self.points[0, 0], self.points[0, 1], self.yaw], (len(seconds), 1))
        loop = np.vstack([self.points, self.points[:1]])
        step = np.diff(loop, axis=0)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
        travelled = np.mod(self.speed * seconds, way[-1])
        leg = np.clip(np.searchsorted(way, travelled, side="right") - 1, 0, len(step) - 1)
        return np.column_stack(
            [
                np.interp(travelled, way, loop[:, 0]),
                np.interp(travelled, way, loop[:, 1]),
                np.arctan2(step[leg, 1], step[leg, 0]),
            ]
        )

    def speeds(self, seconds: Float64) -> Float64:
        """Return (S,) speed ahead at the given times [m/s]."""
        return np.full(len(seconds), 0.0 if self.parked else self.speed)


def super_ellipse(a: float, b: float, exponent: float, points: int = 720) -> Float64:
    """Return (points, 2) of |x/a|^n + |y/b|^n = 1, counter-clockwise from (a, 0): the course of the paper's robot.

    >>> super_ellipse(2.0, 1.0, 4.0, points=4).round(6).tolist()
    [[2.0, 0.0], [0.0, 1.0], [-2.0, 0.0], [0.0, -1.0]]
    """
    angle = np.arange(points) * (TURN / points)
    cos, sin = np.cos(angle).round(15), np.sin(angle).round(15)
    power = 2.0 / exponent
    return np.column_stack([a * np.sign(cos) * np.abs(cos) ** power, b * np.sign(sin) * np.abs(sin) ** power])


PARKED = Course(np.zeros((1, 2)))


@dataclass(frozen=True, slots=True)
class Odometry:
    """Odometry of the robot. Noise accumulates with the distance."""

    topic: str = "/odom"
    frame_id: str = "odom"
    child_frame_id: str = "base_link"
    noise: float = 0.0
    """Standard deviation of the position's drift after one metre [m]."""
    yaw_noise: float = 0.0
    """Standard deviation of the heading's drift after one metre [rad]."""
    tf: bool = True
    """True: /tf and /tf_static are written, too."""
    delay: float = 0.0
    """Delay of the stamps of poses [s]; negative for early ones."""


@dataclass(frozen=True, slots=True)
class Mount:
    """Mount of the laser on the robot."""

    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y, yaw in the robot's frame."""
    told: bool = True
    """False: the log says that the laser is where the robot is."""


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """A sensor, its path and everything it can see."""

    name: str
    sensor: Sensor
    entities: tuple[Entity, ...]
    path: Course | Route = PARKED
    odometry: Odometry | None = None
    sweeps: int = 100
    """Default number of sweeps of a run."""
    mount: Mount = Mount()

    @property
    def still(self) -> bool:
        """True where every sweep sees the same, noise aside."""
        return self.path.parked and all(entity.motion.still for entity in self.entities)

    def sensor_poses(self, seconds: Float64) -> Float64:
        """Return (S, 3) world x, y, yaw of the laser at the given times."""
        poses = self.path.poses(seconds)
        x, y, yaw = self.mount.pose
        if x or y or yaw:
            cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
            poses += np.column_stack([cos * x - sin * y, sin * x + cos * y, np.full(len(poses), yaw)])
        return poses
