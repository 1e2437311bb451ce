"""Scene files: TOML → `Scene`. Degrees in the file, radians from here on; samples/README.md lists the keys."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import degrees, hypot, radians
from pathlib import Path

import numpy as np

from lidarcli.configfiles import Fields, read_toml
from lidarcli.errors import OptionError
from lidarcli.simulation.entities import box, cylinder, legged, person, plant, wall
from lidarcli.simulation.route import CORNERS, Corner, Route, Waypoint, plan_route
from lidarcli.simulation.scene import LOST_AS, Course, Entity, LostAs, Motion, Mount, Odometry, Scene, Sensor, super_ellipse

MAX_WAYPOINTS = 1_000
LEAST = 1e-3
"""Least of a route's speeds [m/s], accelerations [m/s²], turn rates [degrees/s], radii and ways between points [m]."""
MAX_DELAY = 10.0
"""Most that the stamps of poses may be off [s]."""
LEAST_COURSE = 1e-6
"""Least length of a course that is driven [m]."""


def load_robot(fields: Fields) -> tuple[Course | Route, Odometry | None, Mount]:
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
            delay=table.number("delay", 0.0, low=-MAX_DELAY, high=MAX_DELAY),
        )
        table.done()
    table = fields.table("mount")
    pose = table.number("x", 0.0), table.number("y", 0.0), radians(table.number("yaw", 0.0))
    mount = Mount(pose, table.flag("told", True))
    table.done()
    fields.done()
    return path, odometry, mount


def _route_of(fields: Fields, others: tuple[str, ...]) -> Route | None:
    """Return the route, if there is one, and refuse the keys in `others` beside it."""
    if not fields.has("route"):
        return None
    refuse_beside_route(fields, others)
    return load_route(fields.table("route"))


def refuse_beside_route(fields: Fields, keys: tuple[str, ...]) -> None:
    """Refuse keys that a route replaces."""
    for key in keys:
        if key in fields.values:
            fields.fail(key, "and route exclude each other: leave one out")


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
    if speed and len(points) > 1 and np.ptp(points, axis=0).max() < LEAST_COURSE:
        driven = "waypoints" if fields.has("waypoints") else "super_ellipse"
        fields.fail(driven, f"must reach over {LEAST_COURSE:g} m at least: there is no way to drive")
    return Course(points, speed, yaw)


def load_motion(fields: Fields) -> Motion:
    """Read the motion of an entity, and when it appears and disappears."""
    route = _route_of(fields, ("x", "y", "velocity"))
    return Motion(
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
    for number, item in enumerate(table.items("waypoints", 2, MAX_WAYPOINTS), 1):
        values = dict(zip("xy", item, strict=True)) if isinstance(item, list) and len(item) == 2 else item
        if not isinstance(values, Mapping):
            table.fail("waypoints", "must hold points, as [2.5, 0] or { x = 2.5, y = 0, wait = 1 }")
        point = Fields(table.file, f"{table.inside('waypoints')} number {number}", values)
        corner: Corner = "round"
        named = point.text("corner", corner, CORNERS)
        corner = next(name for name in CORNERS if name == named)
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


MAX_BEAMS = 100_000
MAX_SWEEPS = 10_000_000
"""Most sweeps of a log."""
MAX_SHAPES = 10_000
"""Most straight sides and circles of all entities: each beam meets all of them."""
MAX_FLICKER = 0.9
"""Largest share of the beams that may flicker."""
LEAST_RATE = 1e-3
"""Fewest sweeps per second."""
LEAST_STEP = 1e-9
"""Least angle from beam to beam [degrees]."""


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


def _sensor(fields: Fields) -> Sensor:
    """Read the table [sensor]; the view is given by its two ends, or by `fov` around straight ahead."""
    default = Sensor()
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
    if beams > 1 and step < LEAST_STEP:
        fields.fail("beams", f"leaves {step:g} degrees from beam to beam; the least is {LEAST_STEP:g}")
    if fields.flag("clockwise", False):
        first, step = first + step * (beams - 1), -step
    range_min = fields.number("range_min", default.range_min, low=0)
    lost_as: LostAs = "mixed"
    named = fields.text("lost_as", lost_as, LOST_AS)
    lost_as = next(name for name in LOST_AS if name == named)
    sensor = Sensor(
        beams=beams,
        angle_min=radians(first),
        angle_increment=radians(step),
        range_min=range_min,
        range_max=fields.number("range_max", default.range_max, above=range_min),
        noise=fields.number("noise", 0.0, low=0),
        noise_per_metre=fields.number("noise_per_metre", 0.0, low=0, high=1),
        resolution=fields.number("resolution", 0.0, low=0, high=1),
        lost=fields.number("lost", 0.0, low=0, high=1),
        lost_as=lost_as,
        rate=fields.number("rate", default.rate, low=LEAST_RATE, high=1e6),
        topic=fields.text("topic", default.topic),
        frame_id=fields.text("frame_id", default.frame_id),
        beams_jitter=fields.whole("beams_jitter", 0, low=0, high=beams - 1),
        mixed_pixels=fields.number("mixed_pixels", 0.0, low=0, high=1),
        flicker=fields.number("flicker", 0.0, low=0, high=MAX_FLICKER),
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
    if fields.flag("closed", False):
        points = [*points, points[0]]
    return wall(points)


def _box(fields: Fields) -> Entity:
    size = fields.number("length", above=0), fields.number("width", above=0)
    return box(*_place(fields), *size, _yaw(fields), load_motion(fields))


def _cylinder(fields: Fields) -> Entity:
    motion = load_motion(fields)
    # What is round has no side to turn ahead.
    motion = replace(motion, ahead=motion.ahead and not motion.route)
    return cylinder(*_place(fields), fields.number("radius", above=0), motion)


def _legged(kind: str, length: float, width: float, leg: float) -> Callable[[Fields], Entity]:
    """Return a loader of legged things with these default sizes."""

    def load(fields: Fields) -> Entity:
        sizes = [fields.number(key, value, above=0) for key, value in (("length", length), ("width", width))]
        thick = fields.number("leg", leg, above=0, high=min(sizes) / 2)
        return legged(kind, *_place(fields), sizes[0], sizes[1], thick, _yaw(fields), load_motion(fields))

    return load


def _plant(fields: Fields) -> Entity:
    radius, seed = fields.number("radius", above=0), fields.whole("seed", 0, low=0, high=2**31)
    return plant(*_place(fields), radius, seed, _yaw(fields), load_motion(fields))


def _person(fields: Fields) -> Entity:
    """Read a person: two legs; a walker looks ahead and swings them in step with its speed unless told otherwise."""
    motion = load_motion(fields)
    gap, leg = fields.number("gap", 0.25, above=0), fields.number("leg", 0.12, above=0)
    if motion.route:
        refuse_beside_route(fields, ("yaw", "yaw_rate"))
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
