"""Zones: areas and lines that are watched, by the rules of Nav2's Collision Monitor, and who counts in them.

An offline check of a recording, no safety function.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from lidarcli.sweeps.masks import Circle, Masks, Polygon, same_name
from lidarcli.sweeps.types import TURN, Bool, Float64, SweepPoses
from lidarcli.system.records import dataclass, field

SENSOR, ROBOT, WORLD = "sensor", "robot", "world"
"""Names of frames that every log has; any other name is that of a frame of its transforms."""
Action = Literal["stop", "slowdown", "limit", "approach", "none"]
ACTIONS: tuple[Action, ...] = ("stop", "slowdown", "limit", "approach", "none")
Count = Literal["beams", "things", "agents"]
COUNTS: tuple[Count, ...] = ("beams", "things", "agents")
"""Beams that count: every valid one, those on objects (sets O and A), those on agents (set A)."""
MIN_POINTS = 4
HOLD = 0.5
"""Time below `min_points` until an event ends [s]."""
TIMEOUT = 2.0
"""Age from which on the last sweep of a sensor tells nothing of now [s]."""
UNSEEN = 0.5
"""Longest time without a sweep in which nobody comes and goes unobserved [s]; that of slow sensors is a step and a half."""
TIME_BEFORE_COLLISION, TIME_STEP = 2.0, 0.1
"""Time that `approach` looks ahead, and the steps in which it does [s]."""

ROUND = 64
"""Corners with which a circle is drawn."""


@dataclass(frozen=True, slots=True)
class Line:
    """A line from one point to another [m]; `in` is across it to the left of this way."""

    first: tuple[float, float]
    second: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Case:
    """A polygon that counts while the robot has some velocities; limits are included."""

    name: str
    shape: Polygon
    linear: tuple[float, float]
    """Least and greatest velocity ahead [m/s]; of a holonomic robot its speed."""
    turning: tuple[float, float]
    """Least and greatest turn rate [rad/s]."""
    direction: tuple[float, float] | None = None
    """Of a holonomic robot: first and last direction of its velocity, counted against the clock [rad]."""

    def covers(self, velocity: Float64) -> Bool:
        """Return (S,) whether it counts at velocities (S, 3): ahead, left [m/s], turning [rad/s]."""
        ahead, left, turning = velocity.T
        speed = ahead if self.direction is None else np.hypot(ahead, left)
        covered: Bool = (self.turning[0] <= turning) & (turning <= self.turning[1])
        covered &= (self.linear[0] <= speed) & (speed <= self.linear[1])
        if self.direction is not None:
            first, last = self.direction
            # At rest it is 0, where the arc tangent has the signs of zeros.
            direction = np.where(speed > 0.0, np.arctan2(left, ahead), 0.0)
            after, before = first <= direction, direction <= last
            covered &= after & before if first <= last else after | before
        return covered


@dataclass(frozen=True, slots=True)
class Zone:
    """An area or line that is watched. Metres, seconds."""

    name: str
    shape: Circle | Polygon | Line | None
    """None where it is one of the `cases`, or told by `shape_topic`."""
    frame: str = SENSOR
    action: Action = "none"
    count: Count = "beams"
    min_points: int = MIN_POINTS
    """Fewest points with which it is occupied."""
    trigger: int = 1
    """Sweeps in a row until an event begins."""
    release: int = 1
    """Sweeps in a row with fewer points until it ends."""
    hold: float = 0.0
    """Time that has to pass after the last sweep with enough points until it ends [s]."""
    topics: tuple[str, ...] = ()
    """Scan topics whose points count; all by default."""
    timeout: float = TIMEOUT
    """Age from which on the last sweep of a topic does not count [s]; 0: never too old."""
    cases: tuple[Case, ...] = ()
    """Polygons by velocity: the first that covers it counts; where none does, that of the sweep before goes on."""
    shape_topic: str = ""
    """Topic of geometry_msgs/PolygonStamped with its shape."""
    footprint: Polygon | None = None
    """Shape for a log without that topic."""
    velocity_topic: str = ""
    """Topic of geometry_msgs/Twist(Stamped) that tells the velocity; where the log has none, poses do."""
    time_before_collision: float = TIME_BEFORE_COLLISION
    time_step: float = TIME_STEP
    """As of `TIME_BEFORE_COLLISION`."""

    def is_for(self, topic: str) -> bool:
        """Return True if the points of a scan topic count in it."""
        return not self.topics or any(same_name(name, topic) for name in self.topics)


@dataclass(frozen=True, slots=True)
class Zones:
    """The zones of a file, and what else it tells."""

    zones: tuple[Zone, ...]
    masks: Masks = field(default_factory=Masks)
    """Masks of what never counts, and the mounts of sensors; a mask of frame `robot` is in the frame of the robot."""
    notes: tuple[str, ...] = ()
    """Parts of the file that are not used."""
    robot: str = ""
    """Name of the frame `robot`, where the file tells it."""


def inside(shape: Circle | Polygon, x: Float64, y: Float64) -> Bool:
    """Return which points (N,) [m] are inside of a shape: strictly within a circle, by the even-odd rule in a polygon.

    The edges of a polygon are half open, as in the Collision Monitor: a point on an edge of two polygons is in one of them.
    """
    if isinstance(shape, Circle):
        dx, dy = x - shape.x, y - shape.y
        within: Bool = dx * dx + dy * dy < shape.radius * shape.radius
        return within
    odd = np.zeros(x.shape, np.bool_)
    before_x, before_y = shape.corners[-1]
    for corner_x, corner_y in shape.corners:
        crosses = (y <= before_y) == (y > corner_y)
        if crosses.any():
            at = before_x + (y - before_y) * (corner_x - before_x) / (corner_y - before_y)
            odd ^= crosses & (at > x)
        before_x, before_y = corner_x, corner_y
    return odd


def outline(shape: Circle | Polygon | Line) -> Float64:
    """Return the corners (K, 2) of a shape [m]: `ROUND` of a circle, the two ends of a line."""
    if isinstance(shape, Circle):
        around = np.arange(ROUND) * (TURN / ROUND)
        corners: Float64 = np.column_stack(
            [shape.x + shape.radius * np.cos(around), shape.y + shape.radius * np.sin(around)]
        )
        return corners
    points = (shape.first, shape.second) if isinstance(shape, Line) else shape.corners
    return np.array(points, np.float64)


def placed(shape: Circle | Polygon | Line, place: SweepPoses) -> Float64:
    """Return the corners (S, K, 2) of a shape, as `outline` has them, in the frame of the sensor at S sweeps [m].

    Parameters
    ----------
    place : poses of the sensor in the frame of the shape; of one that is not known the corners are NaN
    """
    here = place.at_stamp()
    x, y = (corner - at[:, None] for corner, at in zip(outline(shape).T, (here.x, here.y), strict=True))
    cos, sin = np.cos(here.yaw)[:, None], np.sin(here.yaw)[:, None]
    side = np.where(here.upside_down, -1.0, 1.0)[:, None]
    return np.stack([cos * x + sin * y, side * (cos * y - sin * x)], axis=-1)


def crossing_edges(shape: Polygon) -> tuple[int, int] | None:
    """Return the first two edges of a polygon that cross or touch each other.

    Edge 1 leads from the first corner to the second. Neighbours may share a corner, and a corner may be repeated.
    """
    corners = np.array(shape.corners)
    edges = np.flatnonzero((np.roll(corners, -1, axis=0) != corners).any(axis=1))
    begin, end = corners[edges], np.roll(corners, -1, axis=0)[edges]
    ways = end - begin
    # Sides of each edge (row) on which the ends of each edge lie.
    sides = [
        np.sign(ways[:, None, 0] * apart[..., 1] - ways[:, None, 1] * apart[..., 0])
        for apart in (begin - begin[:, None], end - begin[:, None])
    ]
    parted = sides[0] * sides[1] <= 0.0
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    near = (low[:, None] <= high).all(axis=2)
    meets = np.triu(parted & parted.T & near & near.T, 2)
    # The last edge is next to the first.
    meets[:1, -1:] = False
    found = np.argwhere(meets)
    return (int(edges[found[0, 0]]) + 1, int(edges[found[0, 1]]) + 1) if len(found) else None


def on_one_line(shape: Polygon) -> bool:
    """Return whether all corners of a polygon lie on one line, so that it has no area."""
    return bool(np.linalg.matrix_rank(np.subtract(shape.corners, shape.corners[0])) < 2)
