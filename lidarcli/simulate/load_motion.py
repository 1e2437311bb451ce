"""What moves in a scene file: the robot on its course or route, and what entities do."""

from __future__ import annotations

from collections.abc import Mapping
from math import hypot, radians

import numpy as np

from lidarcli.simulate.route import CORNERS, Corner, Route, Waypoint, plan_route
from lidarcli.simulate.scene import Course, Motion, Mount, Odometry, super_ellipse
from lidarcli.tomlfiles import Fields

MAX_WAYPOINTS = 1_000
LEAST = 1e-3
"""Least of a route's speeds [m/s], accelerations [m/s²], turn rates [degrees/s], radii and ways between points [m]."""
MAX_DELAY = 10.0
"""Most that the stamps of poses may be off [s]."""
LEAST_COURSE = 1e-6
"""Least length of a course that is driven [m]."""


def load_robot(fields: Fields) -> tuple[Course | Route, Odometry | None, Mount]:
    """The table [robot]: parked at a pose, driving a closed course, or on a route through waypoints."""
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
    """The route, where there is one; then `others`, which say the same in another way, must not be there."""
    if not fields.has("route"):
        return None
    refuse_beside_route(fields, others)
    return load_route(fields.table("route"))


def refuse_beside_route(fields: Fields, keys: tuple[str, ...]) -> None:
    """Refuse keys of which a route takes the place."""
    for key in keys:
        if key in fields.values:
            fields.fail(key, "and route exclude each other: leave one out")


def _course(fields: Fields) -> Course:
    """A parked robot, or one that drives a closed course at constant speed."""
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
    """The keys of whatever moves, appears or disappears."""
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
    """The table `route` of a robot or of anything that moves."""
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
        found.append(
            Waypoint(x, y, point.number("speed", speed, low=LEAST), point.number("wait", 0.0, low=0), corner)
        )
        point.done()
    ends = zip(found, found[1:] + found[: int(loop)], strict=False)
    if any(hypot(b.x - a.x, b.y - a.y) < LEAST for a, b in ends):
        table.fail(
            "waypoints",
            f"must be {LEAST:g} m apart at least, one from the next" + " and the last from the first" * loop,
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
