"""A sweep from above as a scene of marks and labels: beams, objects, walls, tracks and zones, in the robot's frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC
from functools import cached_property
from typing import NamedTuple

import numpy as np

from lidarcli.display import palette
from lidarcli.display.texts import counted, stamp
from lidarcli.formalism import Detection
from lidarcli.formalism.detection import CORNER, OBJECT, ROUND, SETS, SHAPES, VERTEX_KINDS, WALL
from lidarcli.options.times import TimeZone
from lidarcli.reports.drawing import Frame, Label, Mark, Panel, arrow, joined, sensor
from lidarcli.reports.world import TrackPath
from lidarcli.sweeps.masks import Mount, Polygon
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64, SweepBatch
from lidarcli.sweeps.zone import Line, Zone, inside

CIRCLE = np.stack([np.cos(turns := np.linspace(0.0, 2.0 * np.pi, 73)), np.sin(turns)], axis=1)
"""(N, 2) points of the unit circle, closed."""
FAR = 1.5
"""Greatest distance of what a scene shows of an outline, by that of its farthest beam."""
NARROW = 3.5
"""Width of one column of a paper [inch]; two are 7.2."""
MAX_NUMBERS = 60
"""Most objects of a picture that are numbered."""
LEAST_AROUND, AROUND = 2.0, 1.0
"""Least distance from the middle of a scene to its edges, and room behind the sensor, where it follows something [m]."""
LONGEST_FRAME = 20
"""A longer name of a frame at an axis loses its beginning."""
DASH = 3.0
"""Length of the dashes of a zone that is not occupied [pt]; the gaps are half as long."""


@dataclass(frozen=True, slots=True)
class ZoneInSight:
    """A zone before the sensor of one sweep."""

    zone: Zone
    corners: Float64
    """(K, 2) its outline [m]."""
    beams: Bool
    """(B,) beams that count in it."""
    is_occupied: bool

    @property
    def outline(self) -> Float64:
        """(N, 2) its outline, closed, or its line [m]."""
        closing = 0 if isinstance(self.zone.shape, Line) else 1
        return np.concatenate([self.corners, self.corners[:closing]])

    @property
    def middle(self) -> tuple[float, float]:
        """Middle of its outline [m]."""
        x, y = (0.5 * (self.corners.min(axis=0) + self.corners.max(axis=0))).tolist()
        return x, y

    def in_view(self, limits: Limits) -> Float64:
        """Return (N, 2) points of its outline in view; of a zone around all of that the upper left corner."""
        (left, right), (low, high) = limits.x, limits.y
        # Many points of each side: whichever are in view.
        along = np.linspace(0.0, 1.0, 201)[:, None, None]
        x, y = ((1.0 - along) * self.outline[:-1] + along * self.outline[1:]).reshape(-1, 2).T
        at = np.column_stack([x, y])[(left <= x) & (x <= right) & (low <= y) & (y <= high)]
        if len(at) or isinstance(self.zone.shape, Line):
            return at
        corner = np.array([[left, high]])
        around = inside(Polygon(tuple(map(tuple, self.corners.tolist()))), *corner.T)
        return corner[around]

    @property
    def words(self) -> str:
        """Name, what it asks for, and the number of its points if it is occupied."""
        action = "" if self.zone.action in ("none", self.zone.name) else f" ({self.zone.action})"
        count = int(np.count_nonzero(self.beams))
        return f"{printable(self.zone.name)}{action}" + (f": {counted(count, 'point')}" if self.is_occupied else "")


@dataclass(frozen=True)
class Picture:
    """A sweep, its detection with `per_beam`, and the words of its title."""

    log: str
    batch: SweepBatch
    """Batch of one sweep, without padding."""
    detection: Detection
    profile: str
    threshold: str
    """`adaptive`, `mean` or `given`."""
    background: Float64 | None = None
    """(B,) r_e, the range without the objects of interest [m]; NaN where unknown."""
    difference: Float64 | None = None
    """(B,) r_w - r_e of the subtraction, which also covers beams without a return [m]."""
    tracks: tuple[TrackPath, ...] | None = None
    """The tracks up to this sweep, in the sensor frame; None where none were given."""
    zones: tuple[ZoneInSight, ...] = ()
    """In the sensor frame."""
    marked: int = -1
    """Track that has a ring, as the nearest in a zone or ahead."""
    mount: Mount | None = None
    """Place of the sensor on its robot, in whose frame the scene is; None: it is in the sensor frame."""
    followed: str = ""
    """What is in the middle of the scene, such as `track 9`; empty: nothing."""
    middle: tuple[float, float] = (0.0, 0.0)
    """Where that is, in the frame of the scene [m]."""
    time_zone: TimeZone = UTC
    """Time zone of the title."""

    @property
    def sweep(self) -> int:
        """Index of the sweep within its topic."""
        return int(self.batch.sweep[0])

    @property
    def title(self) -> tuple[str, str]:
        """Two lines: names of log, topic and sweep; settings and counts."""
        objects = counted(int(np.count_nonzero(self.detection.set == OBJECT)), "object")
        tracks = ""
        if self.tracks is not None:
            agents = sum(path.is_agent for path in self.tracks)
            tracks = f", {counted(len(self.tracks), 'track')} ({counted(agents, 'agent')})"
        return (
            f"{printable(self.log)}  {printable(self.batch.topic)}  sweep {self.sweep}",
            f"{stamp(int(self.batch.stamp_ns[0]), self.time_zone)}{tracks}, profile {self.profile}, "
            f"$d_{{th}}$ = {float(self.detection.sweep_d_th[0]):.3g} m ({self.threshold}), {objects}",
        )

    @cached_property
    def theta(self) -> Float64:
        """(B,) bearing of every beam [rad]."""
        theta: Float64 = self.batch.bearings[0]
        return theta

    @property
    def view(self) -> tuple[float, float]:
        """Least and greatest bearing [rad]; of a sweep without beams both are where the first would be."""
        theta = self.theta if len(self.theta) else self.batch.angle_min
        return float(theta.min()), float(theta.max())

    @cached_property
    def ranges(self) -> Float64:
        """(B,) range of every beam [m]; NaN without one."""
        ranges: Float64 = self.batch.ranges[0].astype(np.float64)
        return ranges

    @property
    def change(self) -> Float64 | None:
        """(B,) difference from the background [m]; None without one."""
        if self.difference is not None or self.background is None:
            return self.difference
        change: Float64 = self.ranges - self.background
        return change

    @property
    def step(self) -> float:
        """Angle from beam to beam [rad], positive."""
        return abs(float(self.batch.angle_increment[0]))

    @cached_property
    def _turn(self) -> Float64:
        """(2, 2) axes of the sensor in the scene, one a row."""
        if self.mount is None:
            return np.eye(2)
        cos, sin, side = np.cos(self.mount.yaw), np.sin(self.mount.yaw), -1.0 if self.mount.upside_down else 1.0
        return np.array([[cos, sin], [-side * sin, side * cos]])

    @property
    def at(self) -> Float64:
        """(2,) where the sensor is in the scene [m]."""
        x, y = (0.0, 0.0) if self.mount is None else (self.mount.x, self.mount.y)
        return np.array([x - self.middle[0], y - self.middle[1]])

    def placed(self, xy: Float64) -> Float64:
        """Return points (N, 2) of the sensor frame in the scene [m]."""
        points: Float64 = xy @ self._turn + self.at
        return points

    @cached_property
    def points(self) -> Float64:
        """(B, 2) where every beam ended in the scene [m]; NaN without a range."""
        return self.placed(np.column_stack([self.ranges * np.cos(self.theta), self.ranges * np.sin(self.theta)]))

    @cached_property
    def paths(self) -> tuple[TrackPath, ...]:
        """The tracks in the scene."""
        return tuple(map(self._path, self.tracks or ()))

    def _path(self, one: TrackPath) -> TrackPath:
        x, y = self.placed(np.column_stack([one.x, one.y])).T
        vx, vy = (np.array(one.velocity) @ self._turn).tolist()
        point = None if one.point is None else tuple(self.placed(np.array([one.point]))[0].tolist())
        return replace(one, x=x, y=y, velocity=(vx, vy), point=point)

    @cached_property
    def areas(self) -> tuple[ZoneInSight, ...]:
        """The zones in the scene."""
        return tuple(replace(one, corners=self.placed(one.corners)) for one in self.zones)

    @property
    def axis_names(self) -> tuple[str, str]:
        """Words at the axes: of which frame they are, and from where they count."""
        frame = "" if self.mount is None else printable(self.mount.parent)
        frame = frame if len(frame) <= LONGEST_FRAME else f"...{frame[3 - LONGEST_FRAME :]}"
        words = (f" in {frame}" if frame else "") + (f" from {printable(self.followed)}" if self.followed else "")
        return f"x{words} [m]", f"y{words} [m]"

    def members(self, k: int) -> tuple[Int64, Float64]:
        """Return the beams with a range of object k and their bearings [rad], which ascend from theta_i and may pass π."""
        owner = self.detection.beam_object
        assert owner is not None  # pictures are made with `per_beam`
        start, end = float(self.detection.theta_i[k]), float(self.detection.theta_f[k])
        own = owner[0] == self.detection.object[k]
        if not (own & np.isfinite(self.ranges)).any():
            # Walls, and what has gone, own no beams: theirs are those between their edges.
            own = unwound(self.theta - start) <= end - start + 1e-6
        beams = np.flatnonzero(own & np.isfinite(self.ranges))
        theta = start + unwound(self.theta[beams] - start)
        order = np.argsort(theta, kind="stable")
        return beams[order], theta[order]

    def outline(self, k: int) -> Float64:
        """Return (N, 2) the box of object k in the scene, closed; of a round one the circle that was fitted to it [m]."""
        found = self.detection
        x, y, yaw = float(found.box_x[k]), float(found.box_y[k]), float(found.box_yaw[k])
        length, width = float(found.box_length[k]), float(found.box_width[k])
        return self.placed(outline_of(x, y, yaw, length, width, found.shape[k] == ROUND))

    @cached_property
    def things(self) -> list[int]:
        """Objects that are no walls."""
        return np.flatnonzero(self.detection.shape != WALL).tolist()

    def faces(self, k: int) -> Iterator[Int64]:
        """Yield the beams of each face of object k, by bearing."""
        beams, theta = self.members(k)
        found = self.detection
        part = slice(int(found.face_offsets[k]), int(found.face_offsets[k + 1]))
        for low, high in zip(found.face_theta_i[part], found.face_theta_f[part], strict=True):
            yield beams[(theta >= low - 1e-6) & (theta <= high + 1e-6)]


def outline_of(x: float, y: float, yaw: float, length: float, width: float, is_round: bool = False) -> Float64:
    """Return (N, 2) corners of a box, closed, or points of a circle as wide as the box is long [m, rad]."""
    if is_round:
        circle: Float64 = 0.5 * length * CIRCLE + np.array([x, y])
        return circle
    half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * 0.5 * np.array([length, width])
    cos, sin = np.cos(yaw), np.sin(yaw)
    corners: Float64 = half @ np.array([[cos, sin], [-sin, cos]]) + np.array([x, y])
    return corners


class Limits(NamedTuple):
    """Limits of the axes, common to the pictures of an animation [m]."""

    x: tuple[float, float]
    y: tuple[float, float]
    r: float
    s: float
    d_th: float = 0.0
    """The greatest one."""
    change: float = 0.0
    """The greatest difference from a background, with some air."""

    @property
    def aspect(self) -> float:
        """Width of the scene by its height."""
        return (self.x[1] - self.x[0]) / (self.y[1] - self.y[0])


def limits_of(pictures: Sequence[Picture]) -> Limits:
    """Return limits that hold the beams, objects and tracks of all pictures, with some air around them."""
    parts = [np.zeros((1, 2))]
    away = 0.0
    jump, reach, d_th, change = 0.1, 0.0, 0.0, 0.0
    for picture in pictures:
        beams = picture.points[np.isfinite(picture.ranges)]
        own = float(np.hypot(*(beams - picture.at).T).max(initial=0.0))
        others = [np.empty((0, 2)), *(picture.outline(k) for k in picture.things)]
        for path in picture.paths:
            head = np.array([path.mark])
            others += [head, head + path.velocity]
        outlines = np.concatenate(others)
        # A profile without a largest size fits circles to walls.
        parts += [picture.at[None], beams, outlines[np.hypot(*(outlines - picture.at).T) <= FAR * own]]
        seen = [one.outline for one in picture.areas if picture.followed == f"zone {one.zone.name}"]
        away = max(away, *(float(np.abs(each).max(initial=0.0)) for each in (picture.at, *seen)))
        found = picture.detection
        assert found.beam_s is not None  # pictures are made with `per_beam`
        # Over the seam and over lost beams differences may be greater than from beam to beam.
        steps = np.concatenate([np.diff(picture.ranges), found.beam_s[0], found.s_i, found.s_f])
        jump = max(jump, float(np.nanmax(np.abs(steps), initial=0.0)))
        reach, d_th = max(reach, own), max(d_th, float(found.sweep_d_th[0]))
        if picture.change is not None:
            change = max(change, float(np.nanmax(np.abs(picture.change), initial=0.0)))
    xy = np.concatenate(parts)
    low, high = xy.min(axis=0), xy.max(axis=0)
    sides = high - low
    air = max(0.09 * float(sides.min()), 0.03 * float(sides.max()), 0.1)
    (left, bottom), (right, top) = (low - air).tolist(), (high + air).tolist()
    if any(picture.followed for picture in pictures):
        right = top = max(1.1 * away + AROUND, LEAST_AROUND)
        left = bottom = -right
    return Limits((left, right), (bottom, top), max(1.05 * reach, 0.1), 1.1 * jump, d_th, max(1.1 * change, 0.1))


def unwound(angle: Float64) -> Float64:
    """Return angles from 0 to a turn; an angle a hair below 0 stays there."""
    turned: Float64 = (angle + 1e-6) % TURN - 1e-6
    return turned


def printable(text: str) -> str:
    """Return text for a title: no control characters, no mathematics."""
    clean = "".join(mark if mark.isprintable() else "?" for mark in text)
    return clean.replace("\\", "/").replace("$", r"\$")


def scene(picture: Picture, limits: Limits | None = None, width: float = NARROW, *, vertices: bool = False) -> Panel:
    """Return one sweep [m], x to the right: beams, objects with their numbers, tracks, zones.

    Parameters
    ----------
    limits : what the axes show; None: all of the sweep
    width : width of the axes, about [inch]
    vertices : mark start, end and corners of each object, and the point that is nearest to the sensor
    """
    limits = limits or limits_of([picture])
    # The dot of a beam is 4.5 cm wide, within bounds [pt].
    dot = float(np.clip(0.045 * 72.0 * width / (limits.x[1] - limits.x[0]), 1.4, 2.8))
    here, yaw = (float(picture.at[0]), float(picture.at[1])), 0.0 if picture.mount is None else picture.mount.yaw
    marks = [*beam_marks(picture, picture.points, dot), sensor(*here, yaw)]
    labels = []
    # The gravest lie on top.
    gravity = [*palette.ZONE_COLOURS]
    for zone in sorted(picture.areas, key=lambda one: -gravity.index(one.zone.action)):
        if len(at := zone.in_view(limits)):
            marks += _zone(zone, picture.points, dot)
            # At the place that is farthest to the left and ahead, as a title.
            labels.append(Label(zone.words, at[np.argmax(at[:, 1] - 1e-3 * at[:, 0])][None]))
    marks += [*_walls(picture), *_things(picture)]
    found = picture.detection
    corners = np.column_stack([found.vertex_r * np.cos(found.vertex_theta), found.vertex_r * np.sin(found.vertex_theta)])
    marks += vertex_marks(picture, picture.placed(corners), vertices)
    if vertices and picture.things:
        nearest = np.column_stack([found.r_min * np.cos(found.theta_min), found.r_min * np.sin(found.theta_min)])
        cross = {"marker": "x", "color": palette.VERMILION, "ms": 2.8, "mew": 0.6, "zorder": 7}
        marks.append(Mark(picture.placed(nearest)[picture.things], cross, "nearest point"))
    for path in picture.paths:
        marks += _track(path, "nearest in a zone or ahead" if path.number == picture.marked else "")
        words = f"{path.number} {printable(path.label)}".rstrip() + (f" in {printable(path.zone)}" if path.zone else "")
        at = np.array([path.mark])
        # On the side that it does not move to, or away from the sensor.
        ahead = (float(at[0, 0] + path.velocity[0]), float(at[0, 1] + path.velocity[1]))
        colour = palette.SET_STYLES["A" if path.is_agent else "O"][0]
        labels.append(Label(words, at, colour, ahead if any(path.velocity) else here))
    if picture.tracks is None and len(picture.things) <= MAX_NUMBERS:
        numbers = [Label(str(int(found.object[k])), picture.outline(k), away=here) for k in picture.things]
        labels = [*numbers, *labels]
    return Panel(Frame(limits.x, limits.y, picture.axis_names, equal=True), marks, labels)


def beam_marks(picture: Picture, xy: Float64, dot: float) -> Iterator[Mark]:
    """Yield the beams with a range, coloured by their set (Def. 4); `dot` is their diameter [pt]."""
    sets = picture.detection.beam_set
    assert sets is not None  # pictures are made with `per_beam`
    for code, name in enumerate(SETS):
        own = (sets[0] == code) & np.isfinite(picture.ranges)
        if own.any():
            colour, mark, larger = palette.SET_STYLES[name]
            style = {"marker": mark, "color": colour, "ms": dot * larger, "zorder": 3}
            yield Mark(xy[own], style, palette.SET_LEGENDS[name])


def vertex_marks(picture: Picture, xy: Float64, every: bool) -> Iterator[Mark]:
    """Yield all vertices, whose places are `xy`, or the corners of walls alone."""
    found = picture.detection
    of_wall = np.repeat(found.shape == WALL, np.diff(found.vertex_offsets))
    for code, name in enumerate(VERTEX_KINDS):
        own = (found.vertex_kind == code) & (every | (of_wall & (code == CORNER)))
        if own.any():
            mark, colour = palette.VERTICES[name]
            style = {"marker": mark, "mfc": "white", "mec": colour, "ms": 2.4, "mew": 0.5, "zorder": 6}
            yield Mark(xy[own], style, f"vertex: {name}" if every else "corner of a wall")


def _things(picture: Picture) -> Iterator[Mark]:
    """Yield the outlines of objects and their faces in the colours of their shapes."""
    shapes = [SHAPES[int(code)] for code in picture.detection.shape]
    for shape in dict.fromkeys(shapes[k] for k in picture.things):
        own = [k for k in picture.things if shapes[k] == shape]
        colour, dots = palette.SHAPE_COLOURS[shape], palette.SHAPE_DOTS.get(shape, "-")
        outlines = joined(picture.outline(k) for k in own)
        yield Mark(outlines, {"color": colour, "lw": 0.7, "ls": dots, "zorder": 4}, palette.SHAPE_WORDS[shape])
        faces = [face for k in own for face in ([_arc(picture, k)] if shape == "round" else picture.faces(k))]
        yield Mark(joined(picture.points[beams] for beams in faces), {"color": colour, "lw": 1.2, "zorder": 5})


def _arc(picture: Picture, k: int) -> Int64:
    """Return the beams of a round object that end within half a radius of its circle: others belong to no arc."""
    found = picture.detection
    beams, _ = picture.members(k)
    radius = 0.5 * float(found.box_length[k])
    centre = picture.placed(np.array([[found.box_x[k], found.box_y[k]]]))
    away = np.hypot(*(picture.points[beams] - centre).T) - radius
    on_it: Int64 = beams[np.abs(away) <= 0.5 * radius]
    return on_it


def _walls(picture: Picture) -> Iterator[Mark]:
    """Yield walls as pale bands under their beams, where these lie side by side."""
    bands = []
    for k in np.flatnonzero(picture.detection.shape == WALL).tolist():
        for beams in picture.faces(k):
            xy, ranges = picture.points[beams], picture.ranges[beams]
            across = picture.step * np.minimum(ranges[1:], ranges[:-1])
            ends = np.hypot(*np.diff(xy, axis=0).T) > np.maximum(0.35, 20.0 * across)
            bands += [run for run in np.split(xy, np.flatnonzero(ends) + 1) if len(run) > 1]
    if bands:
        yield Mark(joined(bands), {"color": palette.WALL, "lw": 2.4, "zorder": 2}, palette.SHAPE_WORDS["wall"])


def _zone(one: ZoneInSight, points: Float64, dot: float) -> Iterator[Mark]:
    """Yield the outline of a zone, filled where it is occupied, and the beams that count."""
    colour = palette.ZONE_COLOURS[one.zone.action]
    words = "zone" if one.zone.action == "none" else f"zone: {one.zone.action}"
    if one.is_occupied:
        yield Mark(joined([one.outline]), {"color": colour, "alpha": 0.25, "lw": 0, "zorder": 1}, area=True)
    # With a dark seam yellow is visible on white.
    for seam, paint, order, name in ((0.5, palette.DARK, 1.5, None), (0.0, colour, 1.6, words)):
        width = (1.1 if one.is_occupied else 0.8) + seam
        dashes = "-" if one.is_occupied else (0, (DASH / width, 0.5 * DASH / width))
        yield Mark(one.outline, {"color": paint, "lw": width, "ls": dashes, "zorder": order}, name)
    if one.is_occupied:
        style = {"marker": "s", "mfc": colour, "mec": palette.DARK, "mew": 0.2, "ms": 1.8 * dot, "zorder": 7}
        yield Mark(points[one.beams], style, f"beam in a {words}")


def _track(path: TrackPath, why: str) -> Iterator[Mark]:
    """Yield a track, agents by colour and mark, hollow where hidden, with the path of one second.

    It is ringed in a zone, or for the reason `why`.
    """
    name = "agent" if path.is_agent else "object"
    colour, mark, _ = palette.SET_STYLES["A" if path.is_agent else "O"]
    way, at = np.column_stack([path.x, path.y]), np.array([path.mark])
    yield Mark(way, {"color": colour, "lw": 0.9 if path.is_agent else 0.6, "zorder": 8})
    face, words = (colour, f"track: {name}") if path.seen else ("white", f"track: {name}, hidden")
    if path.zone or why:
        ring = {"marker": "o", "mfc": "none", "mec": palette.BLACK, "ms": 9.0, "mew": 1.2, "zorder": 10}
        yield Mark(at, ring, why or "track with most points in a zone")
    yield Mark(at, {"marker": mark, "mfc": face, "mec": colour, "ms": 3.0, "mew": 0.7, "zorder": 9}, words)
    if any(path.velocity):
        yield from arrow(at[0].tolist(), (at[0] + path.velocity).tolist(), colour, lw=1.0, zorder=9)
