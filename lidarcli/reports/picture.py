"""The content of a plot: one sweep with its objects and tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from lidarcli.display import counted, stamp
from lidarcli.formalism import Detection
from lidarcli.formalism.detection import OBJECT, ROUND, SHAPES, WALL
from lidarcli.masks import Polygon
from lidarcli.reports.ground import TrackPath
from lidarcli.sweeps import TURN, Bool, Float64, Int64, SweepBatch
from lidarcli.zone import Line, Zone, inside

CIRCLE = np.stack([np.cos(turns := np.linspace(0.0, 2.0 * np.pi, 73)), np.sin(turns)], axis=1)
"""(N, 2) points of the unit circle, closed."""
FAR = 1.5
"""Greatest distance of what a scene shows of an outline, by that of its farthest beam."""


@dataclass(frozen=True, slots=True)
class ZoneInSight:
    """A zone before the sensor of one sweep."""

    zone: Zone
    corners: Float64
    """(K, 2) its outline in the sensor frame [m]."""
    beams: Bool
    """(B,) beams that count in it."""
    is_occupied: bool

    @property
    def outline(self) -> Float64:
        """(N, 2) its outline, closed, or its line [m]."""
        closing = 0 if isinstance(self.zone.shape, Line) else 1
        return np.concatenate([self.corners, self.corners[:closing]])

    def in_view(self, limits: Limits) -> Float64:
        """Return (N, 2) ends of the pieces of its outline in view; of a zone around all of that the upper left corner."""
        (left, right), (low, high) = limits.x, limits.y
        at = _clipped(self.outline, np.array([left, low]), np.array([right, high]))
        if len(at) or isinstance(self.zone.shape, Line):
            return at
        corner = np.array([[left, high]])
        around = inside(Polygon(tuple(map(tuple, self.corners.tolist()))), *corner.T)
        return corner[around]

    @property
    def words(self) -> str:
        """Name, and what it asks for; whether it is occupied is told by the number of its points."""
        asked = "" if self.zone.action in ("none", self.zone.name) else f" ({self.zone.action})"
        count = int(np.count_nonzero(self.beams))
        return f"{printable(self.zone.name)}{asked}" + (f": {counted(count, 'point')}" if self.is_occupied else "")


@dataclass(frozen=True)
class Picture:
    """A sweep, its detection with `per_beam`, and the words of its title."""

    log: str
    batch: SweepBatch
    """Batch of one sweep, without padding."""
    detection: Detection
    profile: str
    threshold: str
    """`adaptive`, `mean` or `0.3 m`."""
    background: Float64 | None = None
    """(B,) r_e, the range without the objects of interest [m]; NaN where unknown."""
    difference: Float64 | None = None
    """(B,) r_w - r_e of the subtraction, which also covers beams without a return [m]."""

    tracks: tuple[TrackPath, ...] | None = None
    """The tracks up to this sweep; None where none were given."""
    zones: tuple[ZoneInSight, ...] = ()

    @property
    def sweep(self) -> int:
        """Index of the sweep within its topic."""
        return int(self.batch.sweep[0])

    @property
    def title(self) -> tuple[str, str]:
        """Two lines: names of log, topic and sweep; settings and counts."""
        found = self.detection
        things = counted(int(np.count_nonzero(found.set == OBJECT)), "object")
        first = f"{printable(self.log)}  {printable(self.batch.topic)}  sweep {self.sweep}"
        d_th = float(found.sweep_d_th[0])
        second = (
            f"{stamp(int(self.batch.stamp_ns[0]))}{self._tracks_words}, profile {self.profile}, "
            f"$d_{{th}}$ = {d_th:.3g} m ({self.threshold}), {things}"
        )
        return first, second

    @property
    def _tracks_words(self) -> str:
        """Number of tracks that are drawn, and of agents among them, in words."""
        if self.tracks is None:
            return ""
        agents = sum(path.is_agent for path in self.tracks)
        return f", {counted(len(self.tracks), 'track')} ({counted(agents, 'agent')})"

    @property
    def theta(self) -> Float64:
        """(B,) bearing of every beam [rad]."""
        theta: Float64 = self.batch.bearings()[0]
        return theta

    @property
    def view(self) -> tuple[float, float]:
        """Least and greatest bearing [rad]; of a sweep without beams both are where the first would be."""
        theta = self.theta if len(self.theta) else self.batch.angle_min
        return float(theta.min()), float(theta.max())

    @property
    def ranges(self) -> Float64:
        """(B,) range of every beam [m]; NaN without one."""
        ranges: Float64 = self.batch.ranges[0].astype(np.float64)
        return ranges

    @property
    def step(self) -> float:
        """Angle from beam to beam [rad], positive."""
        return abs(float(self.batch.angle_increment[0]))

    def points(self) -> tuple[Float64, Float64]:
        """Return (B,) x and y of every beam [m]."""
        theta, ranges = self.theta, self.ranges
        return ranges * np.cos(theta), ranges * np.sin(theta)

    def members(self, k: int) -> tuple[Int64, Float64]:
        """Return the beams with a range of object k and their bearings [rad], which ascend from theta_i and may pass π."""
        owner = self.detection.beam_object
        assert owner is not None  # pictures are made with `per_beam`
        beams = np.flatnonzero((owner[0] == self.detection.object[k]) & np.isfinite(self.batch.ranges[0]))
        if not len(beams):
            # Walls, and what has gone, own no beams: theirs are those between their edges.
            beams = np.flatnonzero(self.between(k) & np.isfinite(self.batch.ranges[0]))
        start = float(self.detection.theta_i[k])
        theta = start + unwound(self.theta[beams] - start)
        order = np.argsort(theta, kind="stable")
        return beams[order], theta[order]

    def between(self, k: int) -> Bool:
        """Return (B,) beams between the edges of object k."""
        start, end = float(self.detection.theta_i[k]), float(self.detection.theta_f[k])
        inside: Bool = unwound(self.theta - start) <= end - start + 1e-6
        return inside

    def corners(self, k: int) -> Float64:
        """Return (5, 2) corners of the box of object k, closed [m]."""
        found = self.detection
        half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * 0.5
        half = half * np.array([found.box_length[k], found.box_width[k]])
        cos, sin = np.cos(found.box_yaw[k]), np.sin(found.box_yaw[k])
        turned = half @ np.array([[cos, sin], [-sin, cos]])
        corners: Float64 = turned + np.array([found.box_x[k], found.box_y[k]])
        return corners

    def outline(self, k: int) -> Float64:
        """Return (N, 2) the box of object k, closed; of a round one the circle that was fitted to it [m]."""
        if not self.is_round(k):
            return self.corners(k)
        found = self.detection
        outline: Float64 = 0.5 * float(found.box_length[k]) * CIRCLE + np.array([found.box_x[k], found.box_y[k]])
        return outline

    @property
    def things(self) -> list[int]:
        """Objects that are no walls."""
        return [k for k in range(len(self.detection)) if not self.is_wall(k)]

    def shape(self, k: int) -> str:
        """Return the name of the shape of object k."""
        return SHAPES[int(self.detection.shape[k])]

    def is_round(self, k: int) -> bool:
        """Return True if object k is round."""
        return int(self.detection.shape[k]) == ROUND

    def is_wall(self, k: int) -> bool:
        """Return True if object k is a wall (`--walls`)."""
        return int(self.detection.shape[k]) == WALL

    def vertices(self, k: int) -> slice:
        """Return the vertices of object k in the flat arrays."""
        return slice(int(self.detection.vertex_offsets[k]), int(self.detection.vertex_offsets[k + 1]))

    def faces(self, k: int) -> slice:
        """Return the faces of object k in the flat arrays."""
        return slice(int(self.detection.face_offsets[k]), int(self.detection.face_offsets[k + 1]))


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the axes, common to the pictures of an animation."""

    x: tuple[float, float]
    y: tuple[float, float]
    r: float
    s: float

    @property
    def aspect(self) -> float:
        """Width of the scene by its height."""
        return (self.x[1] - self.x[0]) / (self.y[1] - self.y[0])


def limits_of(pictures: Sequence[Picture]) -> Limits:
    """Return limits that hold the beams, objects and tracks of all pictures, with some air around them."""
    parts = [np.zeros((1, 2))]
    jumps = [0.1]
    reach = 0.0
    for picture in pictures:
        beams = np.stack(picture.points(), axis=1)
        beams = beams[np.isfinite(picture.ranges)]
        mine = float(np.hypot(*beams.T).max(initial=0.0))
        seen = [picture.outline(k) for k in picture.things]
        for path in picture.tracks or ():
            head = np.array([[path.x[-1], path.y[-1]]])
            seen.append(np.concatenate([head, head + path.velocity]))
        outlines = np.concatenate([np.empty((0, 2)), *seen])
        # A profile without a largest size fits circles to walls.
        parts += [beams, outlines[np.hypot(*outlines.T) <= FAR * mine]]
        jumps.append(float(np.nanmax(np.abs(np.diff(picture.ranges)), initial=0.0)))
        reach = max(reach, mine)
    xy = np.concatenate(parts).T
    low, high = xy.min(axis=1), xy.max(axis=1)
    sides = high - low
    air = max(0.09 * float(sides.min()), 0.03 * float(sides.max()), 0.1)
    return Limits(
        (float(low[0]) - air, float(high[0]) + air),
        (float(low[1]) - air, float(high[1]) + air),
        max(1.05 * reach, 0.1),
        1.1 * max(jumps),
    )


def _clipped(line: Float64, low: Float64, high: Float64) -> Float64:
    """Return (N, 2) ends of the pieces of a line, (M, 2), that lie in a rectangle of these corners."""
    start, way = line[:-1], np.diff(line, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = np.stack([(low - start) / way, (high - start) / way])
    # Along an edge all of a piece is on one side of it.
    within = np.where((low <= start) & (start <= high), np.inf, -np.inf)
    first = np.where(way == 0.0, -within, ends.min(axis=0)).max(axis=1, initial=0.0)
    last = np.where(way == 0.0, within, ends.max(axis=0)).min(axis=1, initial=1.0)
    kept = first <= last
    pieces = [start[kept] + share[kept, None] * way[kept] for share in (first, last)]
    clipped: Float64 = np.concatenate(pieces)
    return clipped


def unwound(angle: Float64) -> Float64:
    """Return angles from 0 to a turn; an angle a hair below 0 stays there."""
    turned: Float64 = (angle + 1e-6) % TURN - 1e-6
    return turned


def printable(text: str) -> str:
    """Return text for a title: no control characters, no mathematics."""
    clean = "".join(mark if mark.isprintable() else "?" for mark in text)
    return clean.replace("\\", "/").replace("$", r"\$")
