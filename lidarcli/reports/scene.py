"""The scene from above: one sweep with its objects, on any axes of matplotlib."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.formalism.detection import CORNER, ROUND, SETS, VERTEX_KINDS
from lidarcli.reports import palette
from lidarcli.reports.paths import TrackPath
from lidarcli.reports.picture import Limits, Picture, limits_of, printable
from lidarcli.sweeps import Float64

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from lidarcli.reports.labelling import Label

MANY = 60
"""Of more objects only the outlines are drawn, without numbers."""
DOT = 0.045
"""Diameter of a beam's dot [m], between the two below."""
LEAST_DOT, LARGEST_DOT = 1.4, 2.8
"""[pt]"""
BREAK = 0.35
"""Between beams farther apart than this [m] the line of a wall breaks, if they are also farther apart than …"""
BREAK_STEPS = 20.0
"""… so many times the way from beam to beam across their bearing."""
ARROW = {"arrowstyle": "-|>", "lw": 1.0, "mutation_scale": 6, "shrinkA": 0.0, "shrinkB": 0.0}
"""The velocity of a track: the way of one second."""
CIRCLE = np.stack([np.cos(turns := np.linspace(0.0, 2.0 * np.pi, 73)), np.sin(turns)], axis=1)
"""(N, 2) points of the unit circle, closed."""


def scene(axes: Axes, picture: Picture, limits: Limits | None = None, vertices: bool = False) -> None:
    """Draw one sweep in its sensor frame [m], x to the right: beams, objects with their numbers, tracks.

    Parameters
    ----------
    limits : what the axes show; None: all beams of the sweep
    vertices : mark start, end and corners of each object, and the point that is nearest to the sensor
    """
    limits = limits or limits_of([picture.batch])
    x, y = picture.points()
    axes.set_aspect("equal", adjustable="box", anchor="N")
    axes.set(xlim=limits.x, ylim=limits.y, xlabel="x [m]", ylabel="y [m]")
    scatter_beams(axes, picture, x, y, _dot(axes, limits))
    sensor(axes)
    found = picture.detection
    for k in range(len(found)):
        if picture.is_wall(k):
            _wall(axes, picture, k, x, y)
        else:
            _thing(axes, picture, k, x, y)
    mark_vertices(axes, picture, lambda theta, r: (r * np.cos(theta), r * np.sin(theta)), vertices)
    if vertices:
        mark_nearest(axes, picture, lambda theta, r: (r * np.cos(theta), r * np.sin(theta)))
    _label(axes, picture, _numbers(picture) if picture.tracks is None else _tracks(axes, picture.tracks))


def sensor(axes: Axes, x: float = 0.0, y: float = 0.0, yaw: float = 0.0, size: float = 6.0) -> None:
    """The sensor as a triangle that points where it looks [m, rad]."""
    turn = float(np.degrees(yaw)) - 90.0
    axes.plot(
        [x],
        [y],
        marker=(3, 0, turn),
        color=palette.BLACK,
        ms=size,
        mew=0,
        ls="none",
        zorder=8,
        label="sensor",
    )


def scatter_beams(axes: Axes, picture: Picture, x: Float64, y: Float64, dot: float) -> None:
    """The beams with a range, coloured by their set (Def. 4); `dot` is their diameter [pt]."""
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
    """Marks at the vertices: all of them, or the corners of walls alone; `place` takes bearing and range to the axes."""
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
    """A cross at the point of each object that is nearest to the sensor."""
    found = picture.detection
    things = np.array([not picture.is_wall(k) for k in range(len(found))], bool)
    if things.any():
        u, v = place(found.theta_min[things], found.r_min[things])
        axes.plot(u, v, "x", color=palette.VERMILION, ms=2.8, mew=0.6, zorder=7, label="nearest point")


def _dot(axes: Axes, limits: Limits) -> float:
    """Diameter of a dot [pt] that is `DOT` wide on these axes."""
    box = axes.get_position().size * axes.get_figure().get_size_inches() * 72.0  # type: ignore[union-attr]
    scale = min(box[0] / (limits.x[1] - limits.x[0]), box[1] / (limits.y[1] - limits.y[0]))
    return float(np.clip(DOT * scale, LEAST_DOT, LARGEST_DOT))


def _thing(axes: Axes, picture: Picture, k: int, x: Float64, y: Float64) -> None:
    """The outline of an object, and the faces that were seen of it, in the colour of its shape."""
    shape = picture.shape(k)
    colour = palette.SHAPE_COLOURS[shape]
    outline = _outline(picture, k)
    axes.plot(outline[:, 0], outline[:, 1], color=colour, lw=0.7, zorder=4, label=palette.SHAPE_WORDS[shape])
    for beams in _faces(picture, k):
        axes.plot(x[beams], y[beams], color=colour, lw=1.2, solid_capstyle="butt", zorder=5)


def _wall(axes: Axes, picture: Picture, k: int, x: Float64, y: Float64) -> None:
    """A wall as a pale band under its beams, where these lie side by side."""
    words = palette.SHAPE_WORDS["wall"]
    for beams in _faces(picture, k):
        step = np.hypot(np.diff(x[beams]), np.diff(y[beams]))
        across = picture.step * np.minimum(picture.ranges[beams][1:], picture.ranges[beams][:-1])
        ends = np.flatnonzero(step > np.maximum(BREAK, BREAK_STEPS * across)) + 1
        for run in np.split(beams, ends):
            if len(run) > 1:
                axes.plot(
                    x[run], y[run], color=palette.WALL, lw=2.4, solid_capstyle="butt", zorder=2, label=words
                )


def _outline(picture: Picture, k: int) -> Float64:
    """(N, 2) the box of an object, closed; of a round one the circle that was fitted to it [m]."""
    found = picture.detection
    if int(found.shape[k]) != ROUND:
        return picture.corners(k)
    outline: Float64 = 0.5 * float(found.box_length[k]) * CIRCLE + np.array([found.box_x[k], found.box_y[k]])
    return outline


def _faces(picture: Picture, k: int) -> Iterator[Any]:
    """The beams of each face of an object, by bearing."""
    beams, theta = picture.members(k)
    found, part = picture.detection, picture.faces(k)
    for low, high in zip(found.face_theta_i[part], found.face_theta_f[part], strict=True):
        yield beams[(theta >= low - 1e-6) & (theta <= high + 1e-6)]


def _label(axes: Axes, picture: Picture, labels: Iterable[Label]) -> None:
    """Set labels, which avoid beams, outlines, the sensor and the ways of tracks."""
    from lidarcli.reports.labelling import add_labels, along

    there = np.isfinite(picture.ranges)
    points = np.stack(picture.points(), axis=1)[there]
    lines = [_outline(picture, k) for k in range(len(picture.detection)) if not picture.is_wall(k)]
    for path in picture.tracks or ():
        way = np.stack([path.x, path.y], axis=1)
        lines.append(np.concatenate([way, way[-1:] + path.velocity]))
    add_labels(axes, [*labels], [points, np.zeros((8, 2)), *map(along, lines)])


def _numbers(picture: Picture) -> Iterator[Label]:
    """The numbers of the objects; none where they are too many to be read."""
    from lidarcli.reports.labelling import Label

    found = picture.detection
    things = [k for k in range(len(found)) if not picture.is_wall(k)]
    if len(things) <= MANY:
        for k in things:
            yield Label(str(int(found.object[k])), _outline(picture, k))


def _tracks(axes: Axes, paths: Sequence[TrackPath]) -> list[Label]:
    """Paths with velocities, agents apart by colour and mark, hollow where hidden; their numbers, to be set."""
    from lidarcli.reports.labelling import Label

    labels = []
    for path in paths:
        name = "agent" if path.is_agent else "object"
        colour, mark, _ = palette.SET_STYLES["A" if path.is_agent else "O"]
        if not path.is_agent:
            mark = "o"
        axes.plot(path.x, path.y, color=colour, lw=0.9 if path.is_agent else 0.6, zorder=8)
        x, y = float(path.x[-1]), float(path.y[-1])
        face = colour if path.seen else "white"
        axes.plot(
            x, y, mark, mfc=face, mec=colour, ms=3.0, mew=0.7, ls="none", zorder=9, label=f"track: {name}"
        )
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
