"""Scenes: a sensor, the path that carries it, entities, static or moving,, and the TOML files that hold all of these.

An entity is drawn once, in its own frame, as straight segments and circles; where it is at a time is its pose.
Lengths in metres, angles in radians (degrees in a file), times in seconds from the first sweep. samples/README.md lists
the keys of a file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import degrees, hypot, radians
from pathlib import Path
from typing import Literal, cast

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.files.configfiles import Fields, read_toml
from lidarcli.simulation.route import CORNERS, STEPS, Corner, Route, Waypoint, feet, plan_route
from lidarcli.sweeps.types import TURN, Bool, Float64

LEAST = 1e-3
"""Least of a route's speeds [m/s], accelerations [m/s²], turn rates [degrees/s], radii and distances between points [m]."""
MIN_COURSE = 1e-6
MAX_BEAMS = 100_000
MAX_SWEEPS = 10_000_000
MAX_SHAPES = 10_000
"""Most straight sides and circles of all entities: each beam meets all of them."""

LostAs = Literal["inf", "nan", "mixed", "zero", "max"]
LOST_AS: tuple[LostAs, ...] = ("inf", "nan", "mixed", "zero", "max")


@dataclass(frozen=True, slots=True)
class SceneSensor:
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

    @property
    def bearings(self) -> Float64:
        """Return (B,) bearings of an undisturbed sweep."""
        bearings: Float64 = self.angle_min + self.angle_increment * np.arange(self.beams, dtype=np.float64)
        return bearings


@dataclass(frozen=True, slots=True)
class SceneMotion:
    """Motion of an entity, and the time for which it exists."""

    velocity: tuple[float, float] = (0.0, 0.0)
    yaw_rate: float = 0.0
    appears: float = -np.inf
    disappears: float = np.inf
    stride: float = 0.0
    """Legs of a walker swing forth and back by half of this, in turn; on a route, the length of a long step [m]."""
    cadence: float = 0.0
    route: Route | None = None
    """Path through waypoints, instead of a velocity."""
    ahead: bool = True
    """On a route: whether the body turns with its heading, or at its own `yaw_rate`."""

    @property
    def still(self) -> bool:
        """True where every sweep sees the entity alike."""
        return self == STILL


STILL = SceneMotion()


@dataclass(frozen=True, eq=False, slots=True)
class Entity:
    """One object in the world: `segments` (K, 4) x0 y0 x1 y1 and `circles` (C, 3) x y radius, own frame."""

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
    motion: SceneMotion = STILL
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
        distances = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
        travelled = np.mod(self.speed * seconds, distances[-1])
        leg = np.clip(np.searchsorted(distances, travelled, side="right") - 1, 0, len(step) - 1)
        return np.column_stack(
            [
                np.interp(travelled, distances, loop[:, 0]),
                np.interp(travelled, distances, loop[:, 1]),
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
class SceneMount:
    """Mount of the laser on the robot."""

    pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """x, y, yaw in the robot's frame."""
    in_log: bool = True
    """False: the log says that the laser is where the robot is."""


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """A sensor, its path and everything it can see."""

    name: str
    sensor: SceneSensor
    entities: tuple[Entity, ...]
    path: Course | Route = PARKED
    odometry: Odometry | None = None
    sweeps: int = 100
    mount: SceneMount = SceneMount()

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


def closed(points: Float64) -> Float64:
    """Return (P, 4) the sides of a polygon with the corners (P, 2)."""
    return np.hstack([points, np.roll(points, -1, axis=0)])


def rectangle(length: float, width: float, x: float = 0.0, y: float = 0.0) -> Float64:
    """Return (4, 4) the sides of an upright rectangle around (x, y)."""
    half = np.array([length / 2, width / 2])
    return closed(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half + [x, y])


def wall(points: Sequence[Sequence[float]] | Float64) -> Entity:
    """Return a polyline of the building, fixed in the world."""
    corners = np.asarray(points, float)
    low, high = corners.min(axis=0), corners.max(axis=0)
    centre = (low + high) / 2
    local = corners - centre
    length, width = high - low
    sides: Float64 = np.hstack([local[:-1], local[1:]])
    return Entity("wall", float(centre[0]), float(centre[1]), 0.0, float(length), float(width), segments=sides)


def box(x: float, y: float, length: float, width: float, yaw: float = 0.0, motion: SceneMotion = STILL) -> Entity:
    """Return a closed rectangular box."""
    return Entity("box", x, y, yaw, length, width, segments=rectangle(length, width), motion=motion)


def cylinder(x: float, y: float, radius: float, motion: SceneMotion = STILL) -> Entity:
    """Return a round object: a pillar, a bin, a pole."""
    return Entity("cylinder", x, y, 0.0, 2 * radius, 2 * radius, circles=np.array([[0, 0, radius]]), motion=motion)


def legged(
    kind: str, x: float, y: float, length: float, width: float, leg: float, yaw: float = 0.0, motion: SceneMotion = STILL
) -> Entity:
    """Return an object on four legs of the thickness `leg`, in the corners of length × width.

    A ladder's legs are rails, twice as deep as thick; a chair's are round, a table's square.
    """
    depth = 2 * leg if kind == "ladder" else leg
    ax, ay = (length - depth) / 2, (width - leg) / 2
    corners = [(-ax, -ay), (ax, -ay), (ax, ay), (-ax, ay)]
    if kind == "chair":
        circles = np.array([[cx, cy, leg / 2] for cx, cy in corners])
        return Entity(kind, x, y, yaw, length, width, circles=circles, motion=motion)
    segments = np.vstack([rectangle(depth, leg, cx, cy) for cx, cy in corners])
    return Entity(kind, x, y, yaw, length, width, segments=segments, motion=motion)


def person(
    x: float, y: float, yaw: float = 0.0, gap: float = 0.25, leg: float = 0.12, motion: SceneMotion = STILL
) -> Entity:
    """Return two round legs of the diameter `leg`, their axes `gap` apart, facing `yaw`.

    A stride swings them; on a route they step.
    """
    if motion.route and not motion.stride:
        motion = replace(motion, stride=STEPS[1])
    circles = np.array([[0, gap / 2, leg / 2], [0, -gap / 2, leg / 2]])
    return Entity("person", x, y, yaw, motion.stride + leg, gap + leg, circles=circles, motion=motion)


def plant(x: float, y: float, radius: float, seed: int = 0, yaw: float = 0.0, motion: SceneMotion = STILL) -> Entity:
    """Return a plant: a ragged star polygon whose tips lie between half and all of the radius."""
    rng = np.random.Generator(np.random.PCG64(seed))
    leaves = int(rng.integers(9, 16))
    angle = (np.arange(2 * leaves) + rng.uniform(-0.3, 0.3, 2 * leaves)) * (TURN / (2 * leaves))
    reach = radius * rng.uniform(0.5, 1.0, 2 * leaves)
    reach[1::2] *= 0.5
    points = np.column_stack([reach * np.cos(angle), reach * np.sin(angle)])
    extent = np.abs(points).max(axis=0)
    return Entity("plant", x, y, yaw, 2 * extent[0], 2 * extent[1], segments=closed(points), motion=motion)


def load_robot(fields: Fields) -> tuple[Course | Route, Odometry | None, SceneMount]:
    """Read the table [robot]: parked at a pose, driving a closed course, or on a route through waypoints."""
    path = _route_of(fields, ("x", "y", "yaw", "speed", "waypoints", "super_ellipse")) or _course(fields)
    odometry = None
    if fields.has("odometry"):
        table = fields.table("odometry")
        default = Odometry()
        odometry = Odometry(
            topic=table.text("topic", default.topic),
            frame_id=table.text("frame_id", default.frame_id),
            child_frame_id=table.text("child_frame_id", default.child_frame_id),
            noise=table.number("noise", 0.0, low=0),
            yaw_noise=radians(table.number("yaw_noise", 0.0, low=0)),
            tf=table.flag("tf", True),
            delay=table.number("delay", 0.0, low=-10.0, high=10.0),
        )
        table.done()
    table = fields.table("mount")
    pose = table.number("x", 0.0), table.number("y", 0.0), radians(table.number("yaw", 0.0))
    mount = SceneMount(pose, table.flag("told", True))
    table.done()
    fields.done()
    return path, odometry, mount


def _route_of(fields: Fields, others: tuple[str, ...]) -> Route | None:
    """Return the route, if there is one, and refuse the keys in `others` in addition to it."""
    if not fields.has("route"):
        return None
    for key in others:
        if key in fields.values:
            fields.fail(key, "and route exclude each other: leave one out")
    return load_route(fields.table("route"))


def _course(fields: Fields) -> Course:
    """Read a parked robot, or a closed course driven at constant speed."""
    x, y = fields.number("x", 0.0), fields.number("y", 0.0)
    yaw = radians(fields.number("yaw", 0.0))
    speed = fields.number("speed", 0.0, low=0)
    points = np.array([[x, y]])
    if fields.has("waypoints"):
        if fields.has("super_ellipse"):
            fields.fail("waypoints", "and super_ellipse exclude each other: leave one out")
        points = np.array(fields.points("waypoints", 2))
    elif fields.has("super_ellipse"):
        course = fields.table("super_ellipse")
        a, b = course.number("a", above=0), course.number("b", above=0)
        points = super_ellipse(a, b, course.number("exponent", 4.0, low=0.01)) + np.array([x, y])
        course.done()
    if fields.has("waypoints", "super_ellipse") and speed == 0:
        fields.fail("speed", "must be above 0 for a robot that drives")
    if speed and len(points) > 1 and np.ptp(points, axis=0).max() < MIN_COURSE:
        driven = "waypoints" if fields.has("waypoints") else "super_ellipse"
        fields.fail(driven, f"must reach over {MIN_COURSE:g} m at least: there is no way to drive")
    return Course(points, speed, yaw)


def load_motion(fields: Fields, *others: str) -> SceneMotion:
    """Read the motion of an entity, and when it appears and disappears; keys in `others` exclude a route, too."""
    route = _route_of(fields, ("x", "y", "velocity", *others))
    return SceneMotion(
        velocity=(0.0, 0.0) if route else fields.pair("velocity", (0.0, 0.0)),
        yaw_rate=radians(fields.number("yaw_rate", 0.0)),
        appears=fields.number("appears") if fields.has("appears") else -np.inf,
        disappears=fields.number("disappears") if fields.has("disappears") else np.inf,
        route=route,
        ahead=not (route and fields.has("yaw_rate")),
    )


def load_route(table: Fields) -> Route:
    """Read the table `route` of a robot or of anything that moves."""
    speed = table.number("speed", low=LEAST)
    loop = table.flag("loop", False)
    found = []
    for number, item in enumerate(table.items("waypoints", 2, 1_000), 1):
        values = dict(zip("xy", item, strict=True)) if isinstance(item, list) and len(item) == 2 else item
        if not isinstance(values, Mapping):
            table.fail("waypoints", "must hold points, as [2.5, 0] or { x = 2.5, y = 0, wait = 1 }")
        point = Fields(table.file, f"{table.inside('waypoints')} number {number}", values)
        corner = cast(Corner, point.text("corner", "round", CORNERS))
        x, y = point.number("x"), point.number("y")
        found.append(Waypoint(x, y, point.number("speed", speed, low=LEAST), point.number("wait", 0.0, low=0), corner))
        point.done()
    ends = zip(found, found[1:] + found[: int(loop)], strict=False)
    if any(hypot(b.x - a.x, b.y - a.y) < LEAST for a, b in ends):
        table.fail(
            "waypoints", f"must be {LEAST:g} m apart at least, one from the next" + " and the last from the first" * loop
        )
    route = plan_route(
        found,
        acceleration=table.number("acceleration", 2.0, low=LEAST),
        turn_rate=radians(table.number("turn_rate", 90.0, low=LEAST)),
        corner_radius=table.number("corner_radius", 0.5, low=LEAST),
        loop=loop,
    )
    table.done()
    return route


def load_scene(path: str | Path) -> Scene:
    """Read a scene file; whatever is wrong with it is one line that names the file and the key."""
    file = str(path)
    document = read_toml(file, "scene")
    top = Fields(file, "the scene", document)
    head = Fields(file, "[scene]", document.get("scene", {}))
    sensor = _sensor(Fields(file, "[sensor]", document.get("sensor", {})))
    path_driven, odometry, mount = load_robot(Fields(file, "[robot]", document.get("robot", {})))
    found: list[Entity] = []
    for key, values in document.items():
        if key not in _ENTITIES:
            continue
        items = values if isinstance(values, list) else [values]
        for number, item in enumerate(items, 1):
            fields = Fields(file, f"[[{key}]] number {number}", item)
            lost = fields.number("lost", 0.0, low=0, high=1)
            intensity = fields.number("intensity", low=0) if fields.has("intensity") else None
            found.append(replace(_ENTITIES[key](fields), lost=lost, intensity=intensity))
            fields.done()
    shapes = sum(len(entity.segments) + len(entity.circles) for entity in found)
    if shapes > MAX_SHAPES:
        raise OptionError(f"{file}: {shapes:,} sides and circles are more than a scene may have ({MAX_SHAPES:,})")
    scene = Scene(
        name=head.text("name", Path(path).stem),
        sensor=sensor,
        entities=tuple(found),
        path=path_driven,
        odometry=odometry,
        sweeps=head.whole("sweeps", 100, low=0, high=MAX_SWEEPS),
        mount=mount,
    )
    head.done()
    top.asked = ["scene", "sensor", "robot", *_ENTITIES]
    top.done()
    return scene


def _sensor(fields: Fields) -> SceneSensor:
    """Read the table [sensor]; the view is given by its two ends, or by `fov` around straight ahead."""
    default = SceneSensor()
    beams = fields.whole("beams", default.beams, low=1, high=MAX_BEAMS)
    if fields.has("fov"):
        if fields.has("angle_min", "angle_max"):
            fields.fail("fov", "and angle_min/angle_max exclude each other: leave one out")
        view = fields.number("fov", above=0, high=360)
        # A full turn has no two ends: the beam after the last one is the first one.
        steps = beams if view == 360 else max(beams - 1, 1)
        first, step = -view / 2, view / steps
    else:
        first = fields.number("angle_min", -180.0, low=-720, high=720)
        last = fields.number("angle_max", 180.0, low=-720, high=720)
        if last <= first:
            fields.fail("angle_max", "must be above angle_min; for a sensor turning clockwise set clockwise = true")
        step = (last - first) / max(beams - 1, 1)
    if beams > 1 and step < 1e-9:
        fields.fail("beams", f"leaves {step:g} degrees from beam to beam; the least is 1e-09")
    if fields.flag("clockwise", False):
        first, step = first + step * (beams - 1), -step
    range_min = fields.number("range_min", default.range_min, low=0)
    sensor = SceneSensor(
        beams=beams,
        angle_min=radians(first),
        angle_increment=radians(step),
        range_min=range_min,
        range_max=fields.number("range_max", default.range_max, above=range_min),
        noise=fields.number("noise", 0.0, low=0),
        noise_per_metre=fields.number("noise_per_metre", 0.0, low=0, high=1),
        resolution=fields.number("resolution", 0.0, low=0, high=1),
        lost=fields.number("lost", 0.0, low=0, high=1),
        lost_as=cast(LostAs, fields.text("lost_as", "mixed", LOST_AS)),
        rate=fields.number("rate", default.rate, low=1e-3, high=1e6),
        topic=fields.text("topic", default.topic),
        frame_id=fields.text("frame_id", default.frame_id),
        beams_jitter=fields.whole("beams_jitter", 0, low=0, high=beams - 1),
        mixed_pixels=fields.number("mixed_pixels", 0.0, low=0, high=1),
        flicker=fields.number("flicker", 0.0, low=0, high=0.9),
        time_increment=fields.number("time_increment", 0.0, low=0),
    )
    if sensor.time_increment * (beams - 1) > 1 / sensor.rate:
        most = 1 / (sensor.rate * (beams - 1))
        fields.fail("time_increment", f"makes a sweep take longer than one turn; the most is {most:g}")
    fields.done()
    return sensor


def _place(fields: Fields) -> tuple[float, float]:
    """Return the position of an entity, or (0, 0) with a route."""
    return (0.0, 0.0) if fields.has("route") else (fields.number("x"), fields.number("y"))


def _yaw(fields: Fields, default: float = 0.0) -> float:
    return radians(fields.number("yaw", default))


def _wall(fields: Fields) -> Entity:
    points = fields.points("points", 2)
    return wall([*points, points[0]] if fields.flag("closed", False) else points)


def _box(fields: Fields) -> Entity:
    size = fields.number("length", above=0), fields.number("width", above=0)
    return box(*_place(fields), *size, _yaw(fields), load_motion(fields))


def _cylinder(fields: Fields) -> Entity:
    motion = load_motion(fields)
    # What is round has no side to turn ahead.
    motion = replace(motion, ahead=motion.ahead and not motion.route)
    return cylinder(*_place(fields), fields.number("radius", above=0), motion)


def _legged(kind: str, length: float, width: float, leg: float) -> Callable[[Fields], Entity]:
    """Return a loader of legged objects with these default sizes."""

    def load(fields: Fields) -> Entity:
        sizes = [fields.number(key, value, above=0) for key, value in (("length", length), ("width", width))]
        thick = fields.number("leg", leg, above=0, high=min(sizes) / 2)
        return legged(kind, *_place(fields), sizes[0], sizes[1], thick, _yaw(fields), load_motion(fields))

    return load


def _plant(fields: Fields) -> Entity:
    radius, seed = fields.number("radius", above=0), fields.whole("seed", 0, low=0, high=2**31)
    return plant(*_place(fields), radius, seed, _yaw(fields), load_motion(fields))


def _person(fields: Fields) -> Entity:
    """Read a person: two legs; a walker looks ahead and swings them in step with its speed by default."""
    motion = load_motion(fields, "yaw", "yaw_rate")
    gap, leg = fields.number("gap", 0.25, above=0), fields.number("leg", 0.12, above=0)
    if motion.route:
        return person(*_place(fields), _yaw(fields), gap, leg, motion)
    speed = hypot(*motion.velocity)
    heading = degrees(np.arctan2(motion.velocity[1], motion.velocity[0])) if speed else 0.0
    stride = fields.number("stride", 0.5 if speed else 0.0, low=0)
    cadence = fields.number("cadence", speed / (2 * stride) if stride else 0.0, low=0)
    gait = replace(motion, stride=stride, cadence=cadence)
    return person(*_place(fields), _yaw(fields, heading), gap, leg, gait)


_ENTITIES: dict[str, Callable[[Fields], Entity]] = {
    "wall": _wall,
    "box": _box,
    "cylinder": _cylinder,
    "ladder": _legged("ladder", 0.5, 0.4, 0.03),
    "chair": _legged("chair", 0.45, 0.42, 0.03),
    "table": _legged("table", 1.2, 0.7, 0.05),
    "plant": _plant,
    "person": _person,
}
