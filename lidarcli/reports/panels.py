"""The panels of a plot: the scene from above; r(θ), s(θ), r_w beside r_e and their difference; the polar view."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import MaxNLocator

from lidarcli.formalism.detection import CORNER, SETS, VERTEX_KINDS
from lidarcli.reports import palette
from lidarcli.reports.ground import TrackPath
from lidarcli.reports.labels import Label, add_labels, along
from lidarcli.reports.picture import Limits, Picture, ZoneInSight, limits_of, printable, unwound
from lidarcli.sweeps import TURN, Float64

MANY = 60
"""Most objects that are numbered."""
DOT = 0.045
"""Diameter of a beam's dot [m], between the two below."""
LEAST_DOT, LARGEST_DOT = 1.4, 2.8
"""[pt]"""
BREAK = 0.35
"""Least distance of two beams at which the line of a wall breaks [m]."""
BREAK_STEPS = 20.0
"""Least such distance by the distance from beam to beam across their bearing; both must be exceeded."""
ARROW = {"arrowstyle": "-|>", "lw": 1.0, "mutation_scale": 6, "shrinkA": 0.0, "shrinkB": 0.0}
"""The velocity of a track: the way of one second."""
OFF_CIRCLE = 0.5
"""Greatest distance of a beam of a round object from its circle, by the radius."""
FILL, TRIGGERS = 0.25, 1.8
"""Alpha of a zone that is occupied, and size of a beam in it by that of others."""
DASH = 3.0
"""Length of the dashes of a zone that is not occupied [pt]; the gaps are half as long."""
SHADE: dict[str, Any] = {"color": palette.SKY, "alpha": 0.25, "lw": 0, "label": "bearings of an object"}
CURVE_DOT = 1.7
"""Diameter of a beam's dot [pt]."""
LINEAR = 2.0
"""Multiple of d_th up to which s(θ) is drawn in proportion; beyond it is drawn by its logarithm."""
DECADES = 0.7
"""Height of the part in proportion [decades]."""
HIGH = 8.0
"""Multiple of d_th below which all of s(θ) is drawn in proportion."""
AIR = 1.3
"""Ratio of the end of a logarithmic axis to the greatest value."""
TICKS = ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0))
"""Ticks of each decade: the first choice that gives an axis two ticks on either side."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Axes of a panel: all that is the same in most sweeps."""

    x: tuple[float, float]
    """Limits."""
    y: tuple[float, float]
    names: tuple[str, str] = ("", "")
    """Words at both axes."""
    x_ticks: tuple[float, ...] | None = None
    """Ticks; None: as matplotlib chooses them."""
    y_ticks: tuple[float, ...] | None = None
    linear: float = 0.0
    """Greatest y that is drawn in proportion, those beyond by their logarithm; 0: all are."""
    equal: bool = False
    """True if x and y have the same scale."""
    radii_at: float | None = None
    """Bearing at which the lengths of radii stand [deg]; None for axes that are not polar."""

    def on(self, axes: Axes, had: Frame | None) -> Frame:
        """Set axes that have another frame; None: none yet."""
        if self == had:
            return self
        if self.equal:
            axes.set_aspect("equal", adjustable="box", anchor="N")
        if self.linear:
            axes.set_yscale("symlog", linthresh=self.linear, linscale=DECADES)
        elif had is not None and had.linear:
            axes.set_yscale("linear")
        axes.set(xlim=self.x, ylim=self.y, xlabel=self.names[0], ylabel=self.names[1])
        if self.radii_at is not None:
            self._set_polar(axes, self.radii_at)
            return self
        if self.x_ticks is not None:
            axes.set_xticks(self.x_ticks)
        if self.y_ticks is not None:
            axes.set_yticks(self.y_ticks, [_signed(value) for value in self.y_ticks])
            axes.set_yticks([], minor=True)
        return self

    def _set_polar(self, axes: Axes, radii_at: float) -> None:
        axes.tick_params(pad=1)
        turns = [*range(0, 181, 45), *range(-135, 0, 45)]
        axes.set_xticks(np.radians(turns), [f"{_signed(turn)}°" for turn in turns])
        axes.set_xlim(*self.x)
        radii = self.y_ticks or ()
        axes.set_yticks(radii, [f"{radius:g} m" for radius in radii], zorder=9)
        axes.set_rlabel_position(radii_at)  # type: ignore[attr-defined]
        for text in axes.get_yticklabels():
            text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.4})


def _signed(value: float) -> str:
    return f"{value:g}".replace("-", "\N{MINUS SIGN}")


def scene(
    axes: Axes, picture: Picture, limits: Limits | None = None, had: Frame | None = None, *, vertices: bool = False
) -> Frame:
    """Draw one sweep in its sensor frame [m], x to the right: beams, objects with their numbers, tracks.

    Parameters
    ----------
    limits : what the axes show; None: all beams of the sweep
    had : frame that the axes have, here and below
    vertices : mark start, end and corners of each object, and the point that is nearest to the sensor
    """
    limits = limits or limits_of([picture])
    x, y = picture.points()
    frame = Frame(limits.x, limits.y, ("x [m]", "y [m]"), equal=True).on(axes, had)
    dot = _dot(axes, limits)
    scatter_beams(axes, picture, x, y, dot)
    draw_sensor(axes)
    # The gravest lie on top.
    gravity = [*palette.ZONE_COLOURS]
    ordered = sorted(picture.zones, key=lambda one: -gravity.index(one.zone.action))
    zones = [_zone(axes, one, at, x, y, dot) for one in ordered if len(at := one.in_view(limits))]
    _walls(axes, picture, x, y)
    _things(axes, picture, x, y)
    mark_vertices(axes, picture, lambda theta, r: (r * np.cos(theta), r * np.sin(theta)), vertices)
    if vertices:
        mark_nearest(axes, picture, lambda theta, r: (r * np.cos(theta), r * np.sin(theta)))
    numbers = _numbers(picture) if picture.tracks is None else _tracks(axes, picture.tracks)
    _label(axes, picture, [*numbers, *zones])
    return frame


def draw_sensor(axes: Axes, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, size: float = 6.0) -> None:
    """Draw the sensor as a triangle that points along its x axis [m, rad]."""
    turn = float(np.degrees(yaw)) - 90.0
    axes.plot([x], [y], marker=(3, 0, turn), color=palette.BLACK, ms=size, mew=0, ls="none", zorder=8, label="sensor")


def scatter_beams(axes: Axes, picture: Picture, x: Float64, y: Float64, dot: float) -> None:
    """Draw the beams with a range, coloured by their set (Def. 4); `dot` is their diameter [pt]."""
    sets = picture.detection.beam_set
    assert sets is not None  # pictures are made with `per_beam`
    for code, name in enumerate(SETS):
        mine = (sets[0] == code) & np.isfinite(picture.ranges)
        if mine.any():
            colour, mark, larger = palette.SET_STYLES[name]
            axes.scatter(
                x[mine],
                y[mine],
                s=(dot * larger) ** 2,
                c=colour,
                marker=mark,
                linewidths=0,
                zorder=3,
                label=palette.SET_LEGENDS[name],
            )


def mark_vertices(axes: Axes, picture: Picture, place: Any, every: bool) -> None:
    """Mark all vertices, or the corners of walls alone; `place` takes bearing and range to the axes."""
    found = picture.detection
    owner = np.repeat(np.arange(len(found)), np.diff(found.vertex_offsets))
    walls = np.array([picture.is_wall(k) for k in range(len(found))], bool)
    of_wall = walls[owner] if len(owner) else np.zeros(0, bool)
    for code, name in enumerate(VERTEX_KINDS):
        mine = found.vertex_kind == code
        if not every:
            mine &= of_wall & (code == CORNER)
        if mine.any():
            mark, colour = palette.VERTICES[name]
            u, v = place(found.vertex_theta[mine], found.vertex_r[mine])
            words = f"vertex: {name}" if every else "corner of a wall"
            axes.plot(u, v, mark, mfc="white", mec=colour, ms=2.4, mew=0.5, ls="none", zorder=6, label=words)


def mark_nearest(axes: Axes, picture: Picture, place: Any) -> None:
    """Draw a cross at the point of each object that is nearest to the sensor."""
    found = picture.detection
    things = np.array([not picture.is_wall(k) for k in range(len(found))], bool)
    if things.any():
        u, v = place(found.theta_min[things], found.r_min[things])
        axes.plot(u, v, "x", color=palette.VERMILION, ms=2.8, mew=0.6, zorder=7, label="nearest point")


def _dot(axes: Axes, limits: Limits) -> float:
    """Return the diameter of a dot [pt] that is `DOT` wide on these axes."""
    box = axes.get_position().size * axes.get_figure().get_size_inches() * 72.0  # type: ignore[union-attr]
    scale = min(box[0] / (limits.x[1] - limits.x[0]), box[1] / (limits.y[1] - limits.y[0]))
    return float(np.clip(DOT * scale, LEAST_DOT, LARGEST_DOT))


def _things(axes: Axes, picture: Picture, x: Float64, y: Float64) -> None:
    """Draw the outlines of objects and their faces in the colours of their shapes."""
    outlines: dict[str, list[Float64]] = {}
    faces: dict[str, list[Float64]] = {}
    for k in picture.things:
        shape = picture.shape(k)
        outlines.setdefault(shape, []).append(picture.outline(k))
        seen = [_arc(picture, k, x, y)] if picture.is_round(k) else _faces(picture, k)
        faces.setdefault(shape, []).extend(np.stack([x[beams], y[beams]], axis=1) for beams in seen)
    for shape, lines in outlines.items():
        colour, words = palette.SHAPE_COLOURS[shape], palette.SHAPE_WORDS[shape]
        dots = palette.SHAPE_DOTS.get(shape, "-")
        axes.plot(*_as_one(lines), color=colour, lw=0.7, ls=dots, zorder=4, label=words)
        axes.plot(*_as_one(faces[shape]), color=colour, lw=1.2, solid_capstyle="butt", zorder=5)


def _walls(axes: Axes, picture: Picture, x: Float64, y: Float64) -> None:
    """Draw walls as pale bands under their beams, where these lie side by side."""
    bands = []
    for k in range(len(picture.detection)):
        for beams in _faces(picture, k) if picture.is_wall(k) else ():
            step = np.hypot(np.diff(x[beams]), np.diff(y[beams]))
            across = picture.step * np.minimum(picture.ranges[beams][1:], picture.ranges[beams][:-1])
            ends = np.flatnonzero(step > np.maximum(BREAK, BREAK_STEPS * across)) + 1
            bands += [np.stack([x[run], y[run]], axis=1) for run in np.split(beams, ends) if len(run) > 1]
    if bands:
        style: dict[str, Any] = {"color": palette.WALL, "lw": 2.4, "solid_capstyle": "butt", "zorder": 2}
        axes.plot(*_as_one(bands), label=palette.SHAPE_WORDS["wall"], **style)


def _as_one(lines: Iterable[Float64]) -> tuple[Float64, Float64]:
    """Return x and y of lines, (N, 2) each, as one line that breaks between them: it is drawn much faster."""
    gap = np.full((1, 2), np.nan)
    x, y = np.concatenate([gap, *(part for line in lines for part in (line, gap))])[1:-1].T
    return x, y


def _zone(axes: Axes, one: ZoneInSight, at: Float64, x: Float64, y: Float64, dot: float) -> Label:
    """Draw the outline of a zone, filled where it is occupied, and the beams that count; return its label.

    `at`, (N, 2), is what is in view of its outline.
    """
    colour = palette.ZONE_COLOURS[one.zone.action]
    words = "zone" if one.zone.action == "none" else f"zone: {one.zone.action}"
    if one.is_occupied:
        axes.fill(*one.corners.T, color=colour, alpha=FILL, lw=0, zorder=1)
    # A dark seam lets yellow be seen on white.
    for seam, paint, order, name in ((0.5, palette.DARK, 1.5, None), (0.0, colour, 1.6, words)):
        width = (1.1 if one.is_occupied else 0.8) + seam
        dashes = "-" if one.is_occupied else (0, (DASH / width, 0.5 * DASH / width))
        axes.plot(*one.outline.T, color=paint, lw=width, ls=dashes, zorder=order, label=name)
    if one.is_occupied:
        axes.scatter(
            x[one.beams],
            y[one.beams],
            s=(TRIGGERS * dot) ** 2,
            c=colour,
            marker="s",
            edgecolors=palette.DARK,
            linewidths=0.2,
            zorder=7,
            label=f"beam in a {words}",
        )
    # At the place that is farthest to the left and ahead, as a title.
    first = at[np.argmax(at[:, 1] - 1e-3 * at[:, 0])]
    return Label(one.words, first[None], palette.BLACK)


def _arc(picture: Picture, k: int, x: Float64, y: Float64) -> Any:
    """Return the beams of a round object that end near to its circle: one beside it belongs to no arc."""
    found = picture.detection
    beams, _ = picture.members(k)
    radius = 0.5 * float(found.box_length[k])
    away = np.hypot(x[beams] - found.box_x[k], y[beams] - found.box_y[k]) - radius
    return beams[np.abs(away) <= OFF_CIRCLE * radius]


def _faces(picture: Picture, k: int) -> Iterator[Any]:
    """Yield the beams of each face of an object, by bearing."""
    beams, theta = picture.members(k)
    found, part = picture.detection, picture.faces(k)
    for low, high in zip(found.face_theta_i[part], found.face_theta_f[part], strict=True):
        yield beams[(theta >= low - 1e-6) & (theta <= high + 1e-6)]


def _label(axes: Axes, picture: Picture, labels: Iterable[Label]) -> None:
    """Set labels, which avoid beams, outlines, the sensor and the ways of tracks."""
    there = np.isfinite(picture.ranges)
    points = np.stack(picture.points(), axis=1)[there]
    lines = [picture.outline(k) for k in picture.things]
    for path in picture.tracks or ():
        way = np.stack([path.x, path.y], axis=1)
        lines.append(np.concatenate([way, way[-1:] + path.velocity]))
    add_labels(axes, [*labels], [points, np.zeros((8, 2)), *map(along, lines)])


def _numbers(picture: Picture) -> Iterator[Label]:
    """Yield the numbers of the objects; none where they are too many to be read."""
    if len(picture.things) <= MANY:
        for k in picture.things:
            yield Label(str(int(picture.detection.object[k])), picture.outline(k))


def _tracks(axes: Axes, paths: Sequence[TrackPath]) -> list[Label]:
    """Draw tracks with velocities, agents by colour and mark, hollow where hidden; return their labels."""
    labels = []
    for path in paths:
        name = "agent" if path.is_agent else "object"
        colour, mark, _ = palette.SET_STYLES["A" if path.is_agent else "O"]
        if not path.is_agent:
            mark = "o"
        axes.plot(path.x, path.y, color=colour, lw=0.9 if path.is_agent else 0.6, zorder=8)
        x, y = float(path.x[-1]), float(path.y[-1])
        face, words = (colour, f"track: {name}") if path.seen else ("white", f"track: {name}, hidden")
        axes.plot(x, y, mark, mfc=face, mec=colour, ms=3.0, mew=0.7, ls="none", zorder=9, label=words)
        vx, vy = path.velocity
        tip = (x + vx, y + vy)
        if np.hypot(vx, vy) > 0:
            arrow = {**ARROW, "color": colour}
            axes.annotate("", tip, (x, y), arrowprops=arrow, zorder=9, annotation_clip=True)
        # On the side that it does not move to, or away from the sensor.
        away = tip if np.hypot(vx, vy) > 0 else None
        words = f"{path.number} {printable(path.label)}".rstrip()
        labels.append(Label(words, np.array([[x, y]]), colour, away))
    return labels


def sweep(axes: Axes, picture: Picture, limits: Limits, had: Frame | None = None) -> Frame:
    """Draw r(θ) with the objects shaded (Def. 1)."""
    _shade(axes, picture)
    theta, ranges = np.degrees(picture.theta), picture.ranges
    axes.plot(*_broken(theta, ranges), color=palette.LIGHT, lw=0.6, zorder=2)
    scatter_beams(axes, picture, theta, ranges, CURVE_DOT)
    low = float(np.degrees(picture.view[0]))
    mark_vertices(axes, picture, lambda angle, r: (low + np.degrees(unwound(angle - np.radians(low))), r), True)
    return _curve(picture, (0.0, limits.r), r"range $r(\theta)$ [m]").on(axes, had)


def difference(axes: Axes, picture: Picture, limits: Limits, had: Frame | None = None) -> Frame:
    """Draw s(θ) as stems, ±d_th, and the discontinuities at which objects begin and end (Def. 2 and 3)."""
    _shade(axes, picture)
    signed = picture.detection.beam_s
    assert signed is not None  # pictures are made with `per_beam`
    s = signed[0]
    theta = np.degrees(picture.theta)
    d_th = float(picture.detection.sweep_d_th[0])
    there = np.isfinite(s)
    beyond = there & (np.abs(s) > d_th)
    below = there & ~beyond
    _stems(axes, theta[below], s[below], color=palette.GREY, lw=0.6, zorder=3)
    if beyond.any():
        _stems(axes, theta[beyond], s[beyond], color=palette.VERMILION, lw=0.9, zorder=4)
        axes.plot(theta[beyond], s[beyond], ".", color=palette.VERMILION, ms=3, zorder=4, label=r"$|s| > d_{th}$")
    axes.axhline(0, color=palette.BLACK, lw=0.5, zorder=2)
    for sign in (1, -1):
        axes.axhline(sign * d_th, color=palette.BLUE, lw=0.8, ls=(0, (4, 2)), zorder=5)
    axes.plot([], [], color=palette.BLUE, lw=0.8, ls=(0, (4, 2)), label=r"$\pm d_{th}$")
    _edges(axes, picture)
    # Over the seam and over lost beams differences may be greater than from beam to beam.
    values = np.abs(np.concatenate([s, picture.detection.s_i, picture.detection.s_f]))
    reach = max(limits.s, 1.1 * float(np.nanmax(values, initial=0.0)))
    return _up_to(_curve(picture, (-reach, reach), r"difference $s(\theta)$ [m]"), d_th).on(axes, had)


def backgrounds(axes: Axes, picture: Picture, limits: Limits, had: Frame | None = None) -> Frame:
    """Draw r_w, the sweep, beside r_e, the scene without the objects of interest (§3)."""
    assert picture.background is not None  # the panel is drawn only with one
    _shade(axes, picture)
    theta = np.degrees(picture.theta)
    axes.plot(*_broken(theta, picture.background), color=palette.ORANGE, lw=1.6, zorder=3, label="$r_e$, background")
    axes.plot(*_broken(theta, picture.ranges), color=palette.BLUE, lw=0.8, zorder=4, label="$r_w$, this sweep")
    return _curve(picture, (0.0, limits.r), "$r_w$, $r_e$ [m]").on(axes, had)


def subtraction(axes: Axes, picture: Picture, _: Limits, had: Frame | None = None) -> Frame:
    """Draw r_w - r_e: below zero something new stands in front, above zero something is gone."""
    assert picture.background is not None  # the panel is drawn only with one
    _shade(axes, picture)
    theta = np.degrees(picture.theta)
    change = picture.ranges - picture.background if picture.difference is None else picture.difference
    there = np.isfinite(change)
    new, gone = there & (change < 0), there & (change >= 0)
    if new.any():
        _stems(axes, theta[new], change[new], color=palette.VERMILION, lw=0.8, label="nearer")
    if gone.any():
        _stems(axes, theta[gone], change[gone], color=palette.GREEN, lw=0.8, label="farther")
    axes.axhline(0, color=palette.BLACK, lw=0.5)
    reach = max(0.1, 1.1 * float(np.abs(change[there]).max(initial=0)))
    return _curve(picture, (-reach, reach), "$r_w - r_e$ [m]").on(axes, had)


def polar(axes: Axes, picture: Picture, limits: Limits, had: Frame | None = None, *, vertices: bool = False) -> Frame:
    """Draw r(θ) in polar coordinates, the sensor in the middle, x to the right; `vertices` as for the scene."""
    found = picture.detection
    labels = []
    for k in range(len(found)):
        if picture.is_wall(k):
            continue
        width = max(float(found.theta_f[k] - found.theta_i[k]), picture.step)
        middle = 0.5 * float(found.theta_f[k] + found.theta_i[k])
        axes.bar(middle, limits.r, width=width, zorder=1, **SHADE)
        beams, theta = picture.members(k)
        if len(beams):
            labels.append((int(found.object[k]), np.stack([theta, picture.ranges[beams]], axis=1)))
    scatter_beams(axes, picture, picture.theta, picture.ranges, CURVE_DOT)
    mark_vertices(axes, picture, lambda theta, r: (theta, r), vertices)
    if vertices:
        mark_nearest(axes, picture, lambda theta, r: (theta, r))
    if len(labels) <= MANY:
        there = np.isfinite(picture.ranges)
        points = np.stack([picture.theta[there], picture.ranges[there]], axis=1)
        add_labels(axes, [Label(str(number), around) for number, around in labels], [points])
    radii = MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(0, limits.r)
    shown = tuple(float(radius) for radius in radii if 0 < radius <= limits.r)
    return Frame((-np.pi, np.pi), (0.0, limits.r), y_ticks=shown, radii_at=_free_bearing(picture)).on(axes, had)


def _free_bearing(picture: Picture) -> float:
    """Return the bearing at which the lengths of radii cover least [deg]: between two ticks, with few beams about."""
    between = np.arange(-157.5, 180.0, 45.0)
    turns = np.degrees(picture.theta[np.isfinite(picture.ranges)])
    off = np.abs((turns[None, :] - between[:, None] + 180.0) % 360.0 - 180.0)
    found = picture.detection
    middles = np.degrees(0.5 * (found.theta_i + found.theta_f))
    things = np.abs((middles[None, :] - between[:, None] + 180.0) % 360.0 - 180.0)
    # Below right, where people look for it, where nothing else decides.
    crowd = (off < 12.0).sum(axis=1) + 1000.0 * (things < 15.0).sum(axis=1)
    return float(between[np.lexsort((np.abs(between + 22.5), crowd))[0]])


def _up_to(frame: Frame, d_th: float) -> Frame:
    """Return a frame of both signs on which d_th is seen beside values that are many times as large."""
    reach = frame.y[1]
    if not d_th > 0 or reach < HIGH * d_th:
        return frame
    linear = _round_up(LINEAR * d_th)
    reach *= AIR
    decades = 10.0 ** np.arange(np.floor(np.log10(linear)), np.ceil(np.log10(reach)) + 1)
    ticks: list[float] = []
    for steps in TICKS:
        values = sorted(float(step * decade) for step in steps for decade in decades)
        ticks = [value for value in values if 1.4 * linear <= value <= reach]
        if len(ticks) >= 2:
            break
    shown = (*(-value for value in reversed(ticks)), 0.0, *ticks)
    return replace(frame, y=(-reach, reach), y_ticks=shown, linear=linear)


def _round_up(value: float) -> float:
    """Round up to 1, 2 or 5 times a power of ten, so that the axes of an animation do not creep."""
    decade = 10.0 ** np.floor(np.log10(value))
    return float(next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= 0.999 * value))


def _edges(axes: Axes, picture: Picture) -> None:
    """Mark s on entering each object, and on leaving it, which is that of the next beam."""
    found = picture.detection
    low, _ = picture.view
    places = np.concatenate([found.theta_i, found.theta_f + picture.step])
    values = np.concatenate([found.s_i, found.s_f])
    there = np.isfinite(values)
    if there.any():
        at = np.degrees(low + unwound(places[there] - low))
        # Beside lost beams the edge has a difference, though its beam has none.
        _stems(axes, at, values[there], color=palette.BLACK, lw=0.5, ls=":", zorder=2)
        axes.plot(
            at, values[there], "o", mfc="none", mec=palette.BLACK, ms=4.0, mew=0.6, zorder=6, label="edge of an object"
        )


def _stems(axes: Axes, x: Float64, y: Float64, **style: Any) -> None:
    """Draw a line from zero to each value, all as one."""
    gap = np.full(len(x), np.nan)
    axes.plot(
        np.stack([x, x, gap], axis=1).ravel(),
        np.stack([np.zeros(len(x)), y, gap], axis=1).ravel(),
        solid_capstyle="butt",
        snap=True,
        **style,
    )


def _shade(axes: Axes, picture: Picture) -> None:
    """Shade the bearings of objects."""
    found = picture.detection
    low, high = picture.view
    half = picture.step / 2
    parts: list[tuple[float, float]] = []
    for k in range(len(found)):
        if picture.is_wall(k):
            continue
        start = low + float(unwound(np.array(found.theta_i[k] - low)))
        end = start + float(found.theta_f[k] - found.theta_i[k])
        parts.append((start - half, min(end, high) + half))
        if end > high + half:
            parts.append((low, low + (end - low) % TURN + half))
    if parts:
        first, last = np.degrees(parts).T
        feet, tops = np.zeros(len(parts)), np.ones(len(parts))
        corners = np.stack([first, feet, last, feet, last, tops, first, tops], axis=1).reshape(-1, 4, 2)
        shade = Path.make_compound_path_from_polys(corners)
        # From the foot of the axes to their top.
        whole = axes.get_xaxis_transform()
        axes.add_patch(PathPatch(shade, zorder=1, transform=whole, **SHADE))


def _broken(theta: Float64, values: Float64) -> tuple[Float64, Float64]:
    """Return a line in order of bearing; it breaks where a beam has no value."""
    order = np.argsort(theta, kind="stable")
    return theta[order], values[order]


def _curve(picture: Picture, y: tuple[float, float], name: str) -> Frame:
    """Return the frame of a curve by bearing."""
    low, high = np.degrees(picture.view).tolist()
    step = 45 if high - low > 200 else 15
    ticks = tuple(tick for tick in range(-360, 361, step) if low - 1 <= tick <= high + 1)
    return Frame((low - 1, high + 1), y, (r"bearing $\theta$ [deg]", name), ticks)
