"""A sweep as a picture: the scene from above, r(θ) and s(θ), a comparison with a background; as a file or an animation."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lidarcli.display import palette
from lidarcli.display.texts import counted, stamp
from lidarcli.errors import OptionError
from lidarcli.formalism import Detection
from lidarcli.formalism.detection import CORNER, OBJECT, ROUND, SETS, SHAPES, VERTEX_KINDS, WALL
from lidarcli.options.choices import ANIMATED_DPI, AS_IT_COMES, FRAMES_PER_SECOND, Look
from lidarcli.reports.drawing import (
    Entries,
    Frame,
    Label,
    Mark,
    Panel,
    arrow,
    draw_legend,
    draw_panel,
    draw_title,
    entries_of,
    file_bytes,
    fit_height,
    joined,
    new_figure,
    pixels_of,
    project_style,
    sensor,
    write_gif,
)
from lidarcli.reports.ground import TrackPath
from lidarcli.sweeps.masks import Polygon
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64, SweepBatch
from lidarcli.sweeps.zone import Line, Zone, inside

__all__ = ["Axes", "Figure", "figure_of"]
CIRCLE = np.stack([np.cos(turns := np.linspace(0.0, 2.0 * np.pi, 73)), np.sin(turns)], axis=1)
"""(N, 2) points of the unit circle, closed."""
FAR = 1.5
"""Greatest distance of what a scene shows of an outline, by that of its farthest beam."""
WIDE, MIDDLE, NARROW = 7.2, 5.04, 3.5
"""Widths of two columns of a paper, of what is between, and of one column [inch]."""
WIDTHS = {"all": WIDE, "scene": NARROW, "sweep": MIDDLE}
ELONGATED = 1.5
"""Least ratio of width to height of a scene that stands above its curves."""
MIN_WIDE = 5.0
"""Least width of a picture whose scene stands beside its curves [inch]."""
CURVE, LOW_CURVE = 1.3, 1.1
"""Height of a curve beside a scene or alone, and of one below a scene [inch]."""
MAX_NUMBERS = 60
"""Most objects that are numbered."""
DOT, MIN_DOT, MAX_DOT = 0.045, 1.4, 2.8
"""Diameter of a beam's dot [m], and its bounds [pt]."""
CURVE_DOT = 1.7
"""Diameter of a beam's dot in a curve [pt]."""
BREAK, BREAK_STEPS = 0.35, 20.0
"""Least distance of two beams at which the line of a wall breaks [m], and by their distance across their bearing."""
OFF_CIRCLE = 0.5
"""Greatest distance of a beam of a round object from its circle, by the radius."""
FILL, TRIGGERS = 0.25, 1.8
"""Alpha of a zone that is occupied, and size of a beam in it by that of others."""
PER_SIDE = 201
"""Points of each side of a zone that are looked for in the picture."""
DASH = 3.0
"""Length of the dashes of a zone that is not occupied [pt]; the gaps are half as long."""
LINEAR = 2.0
"""Multiple of d_th up to which s(θ) is drawn in proportion; beyond it is drawn by its logarithm."""
HIGH = 8.0
"""Multiple of d_th below which all of s(θ) is drawn in proportion."""
AIR = 1.3
"""Ratio of the end of a logarithmic axis to the greatest value."""
TICKS = ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0))
"""Ticks of each decade: the first choice that gives an axis two ticks on either side."""


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
        """Return (N, 2) points of its outline in view; of a zone around all of that the upper left corner."""
        (left, right), (low, high) = limits.x, limits.y
        along = np.linspace(0.0, 1.0, PER_SIDE)[:, None, None]
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
        objects = counted(int(np.count_nonzero(self.detection.set == OBJECT)), "object")
        tracks = ""
        if self.tracks is not None:
            agents = sum(path.is_agent for path in self.tracks)
            tracks = f", {counted(len(self.tracks), 'track')} ({counted(agents, 'agent')})"
        return (
            f"{printable(self.log)}  {printable(self.batch.topic)}  sweep {self.sweep}",
            f"{stamp(int(self.batch.stamp_ns[0]))}{tracks}, profile {self.profile}, "
            f"$d_{{th}}$ = {float(self.detection.sweep_d_th[0]):.3g} m ({self.threshold}), {objects}",
        )

    @cached_property
    def theta(self) -> Float64:
        """(B,) bearing of every beam [rad]."""
        theta: Float64 = self.batch.bearings()[0]
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
    def step(self) -> float:
        """Angle from beam to beam [rad], positive."""
        return abs(float(self.batch.angle_increment[0]))

    @cached_property
    def points(self) -> Float64:
        """(B, 2) where every beam ended in the sensor frame [m]; NaN without a range."""
        return np.column_stack([self.ranges * np.cos(self.theta), self.ranges * np.sin(self.theta)])

    def members(self, k: int) -> tuple[Int64, Float64]:
        """Return the beams with a range of object k and their bearings [rad], which ascend from theta_i and may pass π."""
        owner = self.detection.beam_object
        assert owner is not None  # pictures are made with `per_beam`
        start, end = float(self.detection.theta_i[k]), float(self.detection.theta_f[k])
        mine = owner[0] == self.detection.object[k]
        if not (mine & np.isfinite(self.ranges)).any():
            # Walls, and what has gone, own no beams: theirs are those between their edges.
            mine = unwound(self.theta - start) <= end - start + 1e-6
        beams = np.flatnonzero(mine & np.isfinite(self.ranges))
        theta = start + unwound(self.theta[beams] - start)
        order = np.argsort(theta, kind="stable")
        return beams[order], theta[order]

    def outline(self, k: int) -> Float64:
        """Return (N, 2) the box of object k, closed; of a round one the circle that was fitted to it [m]."""
        found = self.detection
        x, y, yaw = float(found.box_x[k]), float(found.box_y[k]), float(found.box_yaw[k])
        return outline_of(x, y, yaw, float(found.box_length[k]), float(found.box_width[k]), found.shape[k] == ROUND)

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

    @property
    def aspect(self) -> float:
        """Width of the scene by its height."""
        return (self.x[1] - self.x[0]) / (self.y[1] - self.y[0])


def limits_of(pictures: Sequence[Picture]) -> Limits:
    """Return limits that hold the beams, objects and tracks of all pictures, with some air around them."""
    parts = [np.zeros((1, 2))]
    jump, reach = 0.1, 0.0
    for picture in pictures:
        beams = picture.points[np.isfinite(picture.ranges)]
        mine = float(np.hypot(*beams.T).max(initial=0.0))
        others = [np.empty((0, 2)), *(picture.outline(k) for k in picture.things)]
        for path in picture.tracks or ():
            head = np.array([path.mark])
            others += [head, head + path.velocity]
        outlines = np.concatenate(others)
        # A profile without a largest size fits circles to walls.
        parts += [beams, outlines[np.hypot(*outlines.T) <= FAR * mine]]
        jump = max(jump, float(np.nanmax(np.abs(np.diff(picture.ranges)), initial=0.0)))
        reach = max(reach, mine)
    xy = np.concatenate(parts)
    low, high = xy.min(axis=0), xy.max(axis=0)
    sides = high - low
    air = max(0.09 * float(sides.min()), 0.03 * float(sides.max()), 0.1)
    (left, bottom), (right, top) = (low - air).tolist(), (high + air).tolist()
    return Limits((left, right), (bottom, top), max(1.05 * reach, 0.1), 1.1 * jump)


def unwound(angle: Float64) -> Float64:
    """Return angles from 0 to a turn; an angle a hair below 0 stays there."""
    turned: Float64 = (angle + 1e-6) % TURN - 1e-6
    return turned


def printable(text: str) -> str:
    """Return text for a title: no control characters, no mathematics."""
    clean = "".join(mark if mark.isprintable() else "?" for mark in text)
    return clean.replace("\\", "/").replace("$", r"\$")


def scene(picture: Picture, limits: Limits | None = None, width: float = NARROW, *, vertices: bool = False) -> Panel:
    """Return one sweep in its sensor frame [m], x to the right: beams, objects with their numbers, tracks, zones.

    Parameters
    ----------
    limits : what the axes show; None: all of the sweep
    width : width of the axes, about [inch]
    vertices : mark start, end and corners of each object, and the point that is nearest to the sensor
    """
    limits = limits or limits_of([picture])
    dot = float(np.clip(DOT * 72.0 * width / (limits.x[1] - limits.x[0]), MIN_DOT, MAX_DOT))
    marks = [*_beams(picture, picture.points, dot), sensor()]
    labels = []
    # The gravest lie on top.
    gravity = [*palette.ZONE_COLOURS]
    for zone in sorted(picture.zones, key=lambda one: -gravity.index(one.zone.action)):
        if len(at := zone.in_view(limits)):
            marks += _zone(zone, picture.points, dot)
            # At the place that is farthest to the left and ahead, as a title.
            labels.append(Label(zone.words, at[np.argmax(at[:, 1] - 1e-3 * at[:, 0])][None]))
    marks += [*_walls(picture), *_things(picture)]
    found = picture.detection
    corners = np.column_stack([found.vertex_r * np.cos(found.vertex_theta), found.vertex_r * np.sin(found.vertex_theta)])
    marks += _vertices(picture, corners, vertices)
    if vertices and picture.things:
        nearest = np.column_stack([found.r_min * np.cos(found.theta_min), found.r_min * np.sin(found.theta_min)])
        cross = {"marker": "x", "color": palette.VERMILION, "ms": 2.8, "mew": 0.6, "zorder": 7}
        marks.append(Mark(nearest[picture.things], cross, "nearest point"))
    for path in picture.tracks or ():
        marks += _track(path)
        words = f"{path.number} {printable(path.label)}".rstrip() + (f" in {printable(path.zone)}" if path.zone else "")
        at = np.array([path.mark])
        # On the side that it does not move to, or away from the sensor.
        ahead = (float(at[0, 0] + path.velocity[0]), float(at[0, 1] + path.velocity[1]))
        colour = palette.SET_STYLES["A" if path.is_agent else "O"][0]
        labels.append(Label(words, at, colour, ahead if any(path.velocity) else (0.0, 0.0)))
    if picture.tracks is None and len(picture.things) <= MAX_NUMBERS:
        labels = [*(Label(str(int(found.object[k])), picture.outline(k)) for k in picture.things), *labels]
    return Panel(Frame(limits.x, limits.y, ("x [m]", "y [m]"), equal=True), marks, labels)


def _beams(picture: Picture, xy: Float64, dot: float) -> Iterator[Mark]:
    """Yield the beams with a range, coloured by their set (Def. 4); `dot` is their diameter [pt]."""
    sets = picture.detection.beam_set
    assert sets is not None  # pictures are made with `per_beam`
    for code, name in enumerate(SETS):
        mine = (sets[0] == code) & np.isfinite(picture.ranges)
        if mine.any():
            colour, mark, larger = palette.SET_STYLES[name]
            style = {"marker": mark, "color": colour, "ms": dot * larger, "zorder": 3}
            yield Mark(xy[mine], style, palette.SET_LEGENDS[name])


def _vertices(picture: Picture, xy: Float64, every: bool) -> Iterator[Mark]:
    """Yield all vertices, whose places are `xy`, or the corners of walls alone."""
    found = picture.detection
    of_wall = np.repeat(found.shape == WALL, np.diff(found.vertex_offsets))
    for code, name in enumerate(VERTEX_KINDS):
        mine = (found.vertex_kind == code) & (every | (of_wall & (code == CORNER)))
        if mine.any():
            mark, colour = palette.VERTICES[name]
            style = {"marker": mark, "mfc": "white", "mec": colour, "ms": 2.4, "mew": 0.5, "zorder": 6}
            yield Mark(xy[mine], style, f"vertex: {name}" if every else "corner of a wall")


def _things(picture: Picture) -> Iterator[Mark]:
    """Yield the outlines of objects and their faces in the colours of their shapes."""
    shapes = [SHAPES[int(code)] for code in picture.detection.shape]
    for shape in dict.fromkeys(shapes[k] for k in picture.things):
        mine = [k for k in picture.things if shapes[k] == shape]
        colour, dots = palette.SHAPE_COLOURS[shape], palette.SHAPE_DOTS.get(shape, "-")
        outlines = joined(picture.outline(k) for k in mine)
        yield Mark(outlines, {"color": colour, "lw": 0.7, "ls": dots, "zorder": 4}, palette.SHAPE_WORDS[shape])
        faces = [face for k in mine for face in ([_arc(picture, k)] if shape == "round" else picture.faces(k))]
        yield Mark(joined(picture.points[beams] for beams in faces), {"color": colour, "lw": 1.2, "zorder": 5})


def _arc(picture: Picture, k: int) -> Int64:
    """Return the beams of a round object that end near to its circle: one beside it belongs to no arc."""
    found = picture.detection
    beams, _ = picture.members(k)
    radius = 0.5 * float(found.box_length[k])
    away = np.hypot(*(picture.points[beams] - [found.box_x[k], found.box_y[k]]).T) - radius
    on_it: Int64 = beams[np.abs(away) <= OFF_CIRCLE * radius]
    return on_it


def _walls(picture: Picture) -> Iterator[Mark]:
    """Yield walls as pale bands under their beams, where these lie side by side."""
    bands = []
    for k in np.flatnonzero(picture.detection.shape == WALL).tolist():
        for beams in picture.faces(k):
            xy, ranges = picture.points[beams], picture.ranges[beams]
            across = picture.step * np.minimum(ranges[1:], ranges[:-1])
            ends = np.hypot(*np.diff(xy, axis=0).T) > np.maximum(BREAK, BREAK_STEPS * across)
            bands += [run for run in np.split(xy, np.flatnonzero(ends) + 1) if len(run) > 1]
    if bands:
        yield Mark(joined(bands), {"color": palette.WALL, "lw": 2.4, "zorder": 2}, palette.SHAPE_WORDS["wall"])


def _zone(one: ZoneInSight, points: Float64, dot: float) -> Iterator[Mark]:
    """Yield the outline of a zone, filled where it is occupied, and the beams that count."""
    colour = palette.ZONE_COLOURS[one.zone.action]
    words = "zone" if one.zone.action == "none" else f"zone: {one.zone.action}"
    if one.is_occupied:
        yield Mark(joined([one.outline]), {"color": colour, "alpha": FILL, "lw": 0, "zorder": 1}, area=True)
    # A dark seam lets yellow be seen on white.
    for seam, paint, order, name in ((0.5, palette.DARK, 1.5, None), (0.0, colour, 1.6, words)):
        width = (1.1 if one.is_occupied else 0.8) + seam
        dashes = "-" if one.is_occupied else (0, (DASH / width, 0.5 * DASH / width))
        yield Mark(one.outline, {"color": paint, "lw": width, "ls": dashes, "zorder": order}, name)
    if one.is_occupied:
        style = {"marker": "s", "mfc": colour, "mec": palette.DARK, "mew": 0.2, "ms": TRIGGERS * dot, "zorder": 7}
        yield Mark(points[one.beams], style, f"beam in a {words}")


def _track(path: TrackPath) -> Iterator[Mark]:
    """Yield a track, agents by colour and mark, hollow where hidden, with the way of one second; ringed in a zone."""
    name = "agent" if path.is_agent else "object"
    colour, mark, _ = palette.SET_STYLES["A" if path.is_agent else "O"]
    way, at = np.column_stack([path.x, path.y]), np.array([path.mark])
    yield Mark(way, {"color": colour, "lw": 0.9 if path.is_agent else 0.6, "zorder": 8})
    face, words = (colour, f"track: {name}") if path.seen else ("white", f"track: {name}, hidden")
    if path.zone:
        ring = {"marker": "o", "mfc": "none", "mec": palette.BLACK, "ms": 9.0, "mew": 1.2, "zorder": 10}
        yield Mark(at, ring, "track with most points in a zone")
    yield Mark(at, {"marker": mark, "mfc": face, "mec": colour, "ms": 3.0, "mew": 0.7, "zorder": 9}, words)
    if any(path.velocity):
        yield from arrow(at[0].tolist(), (at[0] + path.velocity).tolist(), colour, lw=1.0, zorder=9)


def sweep(picture: Picture, limits: Limits) -> Panel:
    """Return r(θ) with the objects shaded (Def. 1)."""
    theta, found = np.degrees(picture.theta), picture.detection
    low = float(np.degrees(picture.view[0]))
    bearing = low + np.degrees(unwound(found.vertex_theta - np.radians(low)))
    marks = [
        _by_bearing(theta, picture.ranges, {"color": palette.LIGHT, "lw": 0.6, "zorder": 2}),
        *_beams(picture, np.column_stack([theta, picture.ranges]), CURVE_DOT),
        *_vertices(picture, np.column_stack([bearing, found.vertex_r]), True),
    ]
    return _curve(picture, marks, limits.r, r"range $r(\theta)$ [m]", low=0.0)


def difference(picture: Picture, limits: Limits) -> Panel:
    """Return s(θ) as stems, ±d_th, and the discontinuities at which objects begin and end (Def. 2 and 3)."""
    found, theta = picture.detection, np.degrees(picture.theta)
    assert found.beam_s is not None  # pictures are made with `per_beam`
    s, d_th, (first, last) = found.beam_s[0], float(found.sweep_d_th[0]), np.degrees(picture.view)
    beyond = np.abs(s) > d_th
    marks = [_stems(theta, np.where(beyond, np.nan, s), {"color": palette.GREY, "lw": 0.6, "zorder": 3})]
    if beyond.any():
        style: dict[str, Any] = {"color": palette.VERMILION, "zorder": 4}
        marks.append(_stems(theta[beyond], s[beyond], {**style, "lw": 0.9}))
        tips = np.column_stack([theta[beyond], s[beyond]])
        marks.append(Mark(tips, {**style, "marker": ".", "ms": 3.0, "mew": 1.0}, r"$|s| > d_{th}$"))
    across = np.array([[first - 1.0, 0.0], [last + 1.0, 0.0]])
    marks.append(Mark(across, {"color": palette.BLACK, "lw": 0.5, "zorder": 2}))
    both = joined([across + np.array([0.0, sign * d_th]) for sign in (1, -1)])
    marks.append(Mark(both, {"color": palette.BLUE, "lw": 0.8, "ls": (0, (4, 2)), "zorder": 5}, r"$\pm d_{th}$"))
    # s on entering each object, and on leaving it, which is that of the next beam.
    edges = np.concatenate([found.s_i, found.s_f])
    places = np.concatenate([found.theta_i, found.theta_f + picture.step])
    there = np.isfinite(edges)
    if there.any():
        at = np.degrees(picture.view[0] + unwound(places[there] - picture.view[0]))
        # Beside lost beams the edge has a difference, though its beam has none.
        marks.append(_stems(at, edges[there], {"color": palette.BLACK, "lw": 0.5, "ls": ":", "zorder": 2}))
        ring = {"marker": "o", "mfc": "none", "mec": palette.BLACK, "ms": 4.0, "mew": 0.6, "zorder": 6}
        marks.append(Mark(np.column_stack([at, edges[there]]), ring, "edge of an object"))
    # Over the seam and over lost beams differences may be greater than from beam to beam.
    reach = max(limits.s, 1.1 * float(np.nanmax(np.abs(np.concatenate([s, edges])), initial=0.0)))
    return _curve(picture, marks, reach, r"difference $s(\theta)$ [m]", d_th=d_th)


def backgrounds(picture: Picture, limits: Limits) -> Panel:
    """Return r_w, the sweep, beside r_e, the scene without the objects of interest (§3)."""
    assert picture.background is not None  # the panel is drawn only with one
    theta = np.degrees(picture.theta)
    behind, front = ({"color": palette.ORANGE, "lw": 1.6, "zorder": 3}, {"color": palette.BLUE, "lw": 0.8, "zorder": 4})
    marks = [
        _by_bearing(theta, picture.background, behind, "$r_e$, background"),
        _by_bearing(theta, picture.ranges, front, "$r_w$, this sweep"),
    ]
    return _curve(picture, marks, limits.r, "$r_w$, $r_e$ [m]", low=0.0)


def subtraction(picture: Picture, _: Limits) -> Panel:
    """Return r_w - r_e: below zero something new stands in front, above zero something is gone."""
    assert picture.background is not None  # the panel is drawn only with one
    theta, (first, last) = np.degrees(picture.theta), np.degrees(picture.view)
    change = picture.ranges - picture.background if picture.difference is None else picture.difference
    marks = [
        _stems(theta[part], change[part], {"color": colour, "lw": 0.8}, name)
        for part, colour, name in ((change < 0, palette.VERMILION, "nearer"), (change >= 0, palette.GREEN, "farther"))
        if part.any()
    ]
    marks.append(Mark(np.array([[first - 1.0, 0.0], [last + 1.0, 0.0]]), {"color": palette.BLACK, "lw": 0.5}))
    reach = max(0.1, 1.1 * float(np.nanmax(np.abs(change), initial=0.0)))
    return _curve(picture, marks, reach, "$r_w - r_e$ [m]")


def _curve(
    picture: Picture, marks: Sequence[Mark], reach: float, name: str, low: float | None = None, d_th: float = 0.0
) -> Panel:
    """Return a curve by bearing up to `reach`, with the bearings of objects shaded; `low`: the least value, else -reach."""
    first, last = np.degrees(picture.view).tolist()
    step = 45 if last - first > 200 else 15
    ticks = tuple(tick for tick in range(-360, 361, step) if first - 1 <= tick <= last + 1)
    names = (r"bearing $\theta$ [deg]", name)
    frame = Frame((first - 1, last + 1), (-reach if low is None else low, reach), names, ticks)
    if d_th > 0.0 and reach >= HIGH * d_th:
        frame = _logarithmic(frame, d_th)
    return Panel(frame, [*_shade(picture, frame.y), *marks])


def _logarithmic(frame: Frame, d_th: float) -> Frame:
    """Return a frame of both signs on which d_th is seen beside values that are many times as large."""
    # Rounded up, so that the axes of an animation do not creep.
    decade = 10.0 ** np.floor(np.log10(LINEAR * d_th))
    linear = next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= 0.999 * LINEAR * d_th)
    reach = AIR * frame.y[1]
    decades = 10.0 ** np.arange(np.floor(np.log10(linear)), np.ceil(np.log10(reach)) + 1)
    ticks: list[float] = []
    for steps in TICKS:
        values = sorted(float(step * decade) for step in steps for decade in decades)
        ticks = [value for value in values if 1.4 * linear <= value <= reach]
        if len(ticks) >= 2:
            break
    shown = (*(-value for value in reversed(ticks)), 0.0, *ticks)
    return replace(frame, y=(-reach, reach), y_ticks=shown, linear=float(linear))


def _stems(x: Float64, y: Float64, style: dict[str, Any], name: str | None = None) -> Mark:
    """Return a line from zero to each value, all as one."""
    gap = np.full(len(x), np.nan)
    ends = np.stack([x, x, gap, np.zeros(len(x)), y, gap]).reshape(2, 3, -1)
    return Mark(ends.transpose(2, 1, 0).reshape(-1, 2), {"snap": True, **style}, name)


def _shade(picture: Picture, y: tuple[float, float]) -> Iterator[Mark]:
    """Yield the bearings of objects, from the foot of the axes to their top."""
    found, (low, high), half = picture.detection, picture.view, picture.step / 2
    parts: list[tuple[float, float]] = []
    for k in picture.things:
        start = low + float(unwound(np.array(found.theta_i[k] - low)))
        end = start + float(found.theta_f[k] - found.theta_i[k])
        parts.append((start - half, min(end, high) + half))
        if end > high + half:
            parts.append((low, low + (end - low) % TURN + half))
    if parts:
        corners = [np.array([[a, y[0]], [b, y[0]], [b, y[1]], [a, y[1]]]) for a, b in np.degrees(parts)]
        style = {"color": palette.SKY, "alpha": 0.25, "lw": 0, "zorder": 1}
        yield Mark(joined(corners), style, "bearings of an object", area=True)


def _by_bearing(theta: Float64, values: Float64, style: dict[str, Any], name: str | None = None) -> Mark:
    """Return a line in order of bearing; it breaks where a beam has no value."""
    order = np.argsort(theta, kind="stable")
    return Mark(np.column_stack([theta, values])[order], style, name)


class Place(NamedTuple):
    """A panel of a view, in a grid."""

    panel: Callable[[Picture, Limits], Panel]
    rows: slice
    column: int
    height: float
    """Height [inch]; 0 for a scene, whose height follows from its width and content."""
    shares: bool = False
    """True if the panel below has the axis of bearings for both."""


def width_of(view: str, look: Look) -> float:
    """Return the width of the whole picture [inch]."""
    return look.inches(WIDTHS[view])


def _share(limits: Limits) -> float:
    """Return the share of the width for a scene beside its curves: as high as two, as far as all stay readable."""
    return min(max(0.46 * limits.aspect, 0.3), 0.54)


def places_of(picture: Picture, view: str, limits: Limits, look: Look) -> list[Place]:
    """Return the panels of a view."""
    compared = [] if picture.background is None else [backgrounds, subtraction]
    curves, width = [sweep, difference, *compared], width_of(view, look)
    side_by_side = view == "all" and limits.aspect <= ELONGATED and width >= MIN_WIDE

    def above(picture: Picture, limits: Limits) -> Panel:
        return scene(picture, limits, 0.85 * width * (_share(limits) if side_by_side else 1.0), vertices=look.vertices)

    if side_by_side:
        return [
            Place(above, slice(0, 2), 0, 0.0),
            Place(sweep, slice(0, 1), 1, CURVE, shares=True),
            Place(difference, slice(1, 2), 1, CURVE),
            *(Place(panel, slice(2, 3), column, CURVE) for column, panel in enumerate(compared)),
        ]
    shown = [] if view == "sweep" else [Place(above, slice(0, 1), 0, 0.0)]
    for panel in [] if view == "scene" else curves:
        row, height = len(shown), CURVE if view == "sweep" else LOW_CURVE
        shown.append(Place(panel, slice(row, row + 1), 0, height, shares=panel is not curves[-1]))
    return shown


def draw_whole(
    figure: Figure, picture: Picture, view: str, limits: Limits, look: Look, entries: Entries | None = None
) -> list[Axes]:
    """Draw all panels, and make the figure as high as it has to be; return the axes."""
    places = places_of(picture, view, limits, look)
    columns = max(place.column for place in places) + 1
    ratios = [_share(limits), 1.0 - _share(limits)] if columns == 2 else [1.0]
    grid = figure.add_gridspec(max(place.rows.stop for place in places), columns, width_ratios=ratios)
    drawn = [figure.add_subplot(grid[place.rows, place.column]) for place in places]
    for axes, place in zip(drawn, places, strict=True):
        draw_panel(axes, place.panel(picture, limits))
        _share_axis(axes, place)
    if look.title:
        draw_title(figure, picture.title)
    if look.legend:
        draw_legend(figure, entries_of(drawn) if entries is None else entries, "outside lower left")
    fit_height(figure, drawn, [place.height for place in places], limits.aspect)
    return drawn


def _share_axis(axes: Axes, place: Place) -> None:
    """Leave the axis of bearings to the panel below."""
    if place.shares:
        axes.set_xlabel("")
        axes.tick_params(labelbottom=False)


def draw(picture: Picture, view: str, suffix: str, look: Look = AS_IT_COMES) -> bytes:
    """Return the picture as a file of the kind of `suffix` (.png, .svg, .pdf)."""
    with project_style():
        figure = new_figure(width_of(view, look))
        draw_whole(figure, picture, view, limits_of([picture]), look)
        return file_bytes(figure, suffix, look.dpi)


class _Shown(Figure):
    """A figure without a window, which a notebook shows once."""

    def _repr_png_(self) -> bytes:
        out = io.BytesIO()
        with project_style():
            self.savefig(out, format="png")
        return out.getvalue()


def figure_of(picture: Picture, view: str, axes: Sequence[Axes] | None = None, look: Look = AS_IT_COMES) -> Figure:
    """Return the picture as a figure; or draw it on `axes`, one for each panel, and return the figure of these.

    Raises
    ------
    OptionError
        There are not as many axes as panels.
    """
    limits = limits_of([picture])
    if axes is None:
        with project_style():
            figure = new_figure(width_of(view, look), kind=_Shown)
            draw_whole(figure, picture, view, limits, look)
        return figure
    places = places_of(picture, view, limits, look)
    if len(axes) != len(places):
        raise OptionError(f"view {view} has {counted(len(places), 'panel')}, and there are {len(axes)} axes for it")
    for mine, place in zip(axes, places, strict=True):
        draw_panel(mine, place.panel(picture, limits))
    return cast("Figure", axes[0].get_figure(root=True))


def animate(
    pictures: Sequence[Picture],
    view: str,
    path: Path,
    look: Look = AS_IT_COMES,
    report: Callable[[int], None] | None = None,
) -> None:
    """Write one frame per picture, as GIF or, with ffmpeg, MP4; `report` takes the number of frames that are done."""
    is_film = path.suffix.lower() == ".mp4"
    if is_film and not FFMpegWriter.isAvailable():
        raise OptionError(f"{path.suffix} needs ffmpeg, which is not there; write .gif instead")
    fps = look.fps or FRAMES_PER_SECOND
    with project_style():
        figure = new_figure(width_of(view, look))
        figure.set_dpi(look.dpi or ANIMATED_DPI)
        shown = _frames(figure, pictures, view, look, report)
        if is_film:
            writer = FFMpegWriter(fps=fps)  # type: ignore[arg-type]
            with writer.saving(figure, str(path), figure.dpi):
                for _ in shown:
                    writer.grab_frame()
        else:
            write_gif(path, (pixels_of(figure) for _ in shown), fps)


def _frames(
    figure: Figure, pictures: Sequence[Picture], view: str, look: Look, report: Callable[[int], None] | None
) -> Iterator[None]:
    """Draw each of the pictures in turn; axes and legend stay, and the legend names what is in any of the pictures."""
    limits = limits_of(pictures)
    places = places_of(pictures[0], view, limits, look)
    axes = [figure.add_subplot() for _ in places]
    entries: Entries = {}
    for picture in pictures:
        _draw_anew(axes, places, picture, limits)
        entries = entries_of(axes) | entries
    figure.clear()
    longest = max(pictures, key=lambda picture: len(" ".join(picture.title)))
    axes = draw_whole(figure, longest, view, limits, look, entries)
    figure.set_layout_engine(None)
    for number, picture in enumerate(pictures, 1):
        _draw_anew(axes, places, picture, limits)
        if look.title:
            draw_title(figure, picture.title)
        yield
        if report is not None:
            report(number)


def _draw_anew(axes: Iterable[Axes], places: Iterable[Place], picture: Picture, limits: Limits) -> None:
    """Draw the panels of a picture in place of those before."""
    for one, place in zip(axes, places, strict=True):
        for artist in [*one.lines, *one.patches, *one.texts, *one.artists]:
            artist.remove()
        draw_panel(one, place.panel(picture, limits))
        _share_axis(one, place)
