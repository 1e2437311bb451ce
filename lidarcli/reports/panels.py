"""The panels of a plot: the scene from above, r(θ), s(θ), r_w beside r_e, their difference, the polar view."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.formalism.detection import SETS, VERTEX_KINDS
from lidarcli.reports import palette
from lidarcli.reports.paths import TrackPath
from lidarcli.reports.picture import Limits, Picture, printable, unwound
from lidarcli.sweeps import TURN, Float64

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MANY = 40
"""Of more objects only the boxes are drawn, without numbers."""
ARROW = {"arrowstyle": "-|>", "lw": 1.0, "mutation_scale": 6, "shrinkA": 0.0, "shrinkB": 0.0}
"""The velocity of a track: the way of one second."""


def scene(axes: Axes, picture: Picture, limits: Limits) -> None:
    """Beams by set, faces by shape, boxes, numbers, vertices and nearest points in the sensor frame."""
    x, y = picture.points()
    _beams(axes, picture, x, y)
    axes.plot(
        0, 0, marker=(3, 0, -90), color=palette.BLACK, markersize=6, ls="none", zorder=6, label="sensor"
    )
    found = picture.detection
    for k in range(len(found)):
        _faces(axes, picture, k, x, y)
        if not picture.is_wall(k):
            corners = picture.corners(k)
            axes.plot(corners[:, 0], corners[:, 1], color=palette.BLACK, lw=0.7, zorder=4)
            # Where there are tracks the numbers are theirs.
            if picture.tracks is None:
                _number(axes, picture, k, corners, limits)
    _vertices(axes, picture, lambda theta, r: (r * np.cos(theta), r * np.sin(theta)))
    near = np.array([not picture.is_wall(k) for k in range(len(found))], bool)
    if near.any():
        theta, r = found.theta_min[near], found.r_min[near]
        axes.plot(
            r * np.cos(theta),
            r * np.sin(theta),
            "x",
            color=palette.VERMILION,
            ms=3.2,
            mew=0.8,
            zorder=7,
            label="nearest point",
        )
    _tracks(axes, picture.tracks or (), limits)
    axes.set_aspect("equal", adjustable="box", anchor="N")
    axes.set(xlim=limits.x, ylim=limits.y, xlabel="x [m]", ylabel="y [m]")


def sweep(axes: Axes, picture: Picture, limits: Limits) -> None:
    """r(θ) with the objects shaded (Def. 1)."""
    _shade(axes, picture)
    theta, ranges = np.degrees(picture.theta), picture.ranges
    axes.plot(*_broken(theta, ranges), color=palette.LIGHT, lw=0.6, zorder=2)
    _beams(axes, picture, theta, ranges)
    low = float(np.degrees(picture.theta.min()))
    _vertices(axes, picture, lambda angle, r: (low + np.degrees(unwound(angle - np.radians(low))), r))
    axes.set(ylim=(0, limits.r), ylabel=r"$r(\theta)$ [m]")
    _bearings(axes, picture)


def difference(axes: Axes, picture: Picture, limits: Limits) -> None:
    """s(θ) as stems, ±d_th, and the discontinuities at which objects begin and end (Def. 2 and 3)."""
    _shade(axes, picture)
    signed = picture.detection.beam_s
    assert signed is not None  # pictures are made with `per_beam`
    s = signed[0]
    theta = np.degrees(picture.theta)
    d_th = float(picture.detection.sweep_d_th[0])
    there = np.isfinite(s)
    beyond = there & (np.abs(s) > d_th)
    below = there & ~beyond
    axes.vlines(theta[below], 0, s[below], color=palette.GREY, lw=0.6, zorder=3)
    axes.vlines(theta[beyond], 0, s[beyond], color=palette.VERMILION, lw=0.9, zorder=4)
    axes.plot(theta[beyond], s[beyond], ".", color=palette.VERMILION, ms=3, zorder=4, label=r"$|s| > d_{th}$")
    axes.axhline(0, color=palette.BLACK, lw=0.5, zorder=2)
    for sign in (1, -1):
        axes.axhline(sign * d_th, color=palette.BLUE, lw=0.8, ls=(0, (4, 2)), zorder=5)
    axes.plot([], [], color=palette.BLUE, lw=0.8, ls=(0, (4, 2)), label=r"$\pm d_{th}$")
    _edges(axes, picture)
    # Over the seam and over lost beams differences may be greater than from beam to beam.
    values = np.abs(np.concatenate([s, picture.detection.s_i, picture.detection.s_f]))
    reach = max(limits.s, 1.1 * float(np.nanmax(values, initial=0.0)))
    axes.set(ylim=(-reach, reach), ylabel=r"$s(\theta)$ [m]")
    _bearings(axes, picture)


def backgrounds(axes: Axes, picture: Picture, limits: Limits) -> None:
    """r_w, the sweep, beside r_e, the scene without the objects of interest (§3)."""
    assert picture.background is not None  # the panel is drawn only with one
    _shade(axes, picture)
    theta = np.degrees(picture.theta)
    axes.plot(*_broken(theta, picture.background), color=palette.ORANGE, lw=1.6, zorder=3, label="$r_e$")
    axes.plot(*_broken(theta, picture.ranges), color=palette.BLUE, lw=0.8, zorder=4, label="$r_w$")
    axes.set(ylim=(0, limits.r), ylabel="$r_w$, $r_e$ [m]")
    _bearings(axes, picture)


def subtraction(axes: Axes, picture: Picture, _: Limits) -> None:
    """r_w - r_e: below zero something new stands in front, above zero something is gone."""
    assert picture.background is not None  # the panel is drawn only with one
    _shade(axes, picture)
    theta = np.degrees(picture.theta)
    change = picture.ranges - picture.background if picture.difference is None else picture.difference
    there = np.isfinite(change)
    new, gone = there & (change < 0), there & (change >= 0)
    axes.vlines(theta[new], 0, change[new], color=palette.VERMILION, lw=0.8, label="nearer")
    axes.vlines(theta[gone], 0, change[gone], color=palette.GREEN, lw=0.8, label="farther")
    axes.axhline(0, color=palette.BLACK, lw=0.5)
    reach = max(0.1, 1.1 * float(np.abs(change[there]).max(initial=0)))
    axes.set(ylim=(-reach, reach), ylabel="$r_w - r_e$ [m]")
    _bearings(axes, picture)


def polar(axes: Axes, picture: Picture, limits: Limits) -> None:
    """r(θ) in polar coordinates, the sensor in the middle, x to the right."""
    found = picture.detection
    for k in range(len(found)):
        if not picture.is_wall(k):
            width = max(float(found.theta_f[k] - found.theta_i[k]), picture.step)
            middle = 0.5 * float(found.theta_f[k] + found.theta_i[k])
            axes.bar(middle, limits.r, width=width, color=palette.SKY, alpha=0.25, lw=0, zorder=1)
    _beams(axes, picture, picture.theta, picture.ranges)
    _vertices(axes, picture, lambda theta, r: (theta, r))
    axes.set_ylim(0, limits.r)
    axes.tick_params(pad=1)
    axes.set_rlabel_position(22.5)  # type: ignore[attr-defined]


def _beams(axes: Axes, picture: Picture, x: Float64, y: Float64) -> None:
    sets = picture.detection.beam_set
    assert sets is not None  # pictures are made with `per_beam`
    for code, name in enumerate(SETS):
        mine = (sets[0] == code) & np.isfinite(picture.ranges)
        if mine.any():
            colour, mark, size = palette.SET_STYLES[name]
            axes.scatter(
                x[mine], y[mine], s=size, c=colour, marker=mark, linewidths=0, zorder=3, label=f"set {name}"
            )


def _faces(axes: Axes, picture: Picture, k: int, x: Float64, y: Float64) -> None:
    beams, theta = picture.members(k)
    colour = palette.SHAPE_COLOURS[picture.shape(k)]
    found, part = picture.detection, picture.faces(k)
    for low, high in zip(found.face_theta_i[part], found.face_theta_f[part], strict=True):
        mine = beams[(theta >= low - 1e-6) & (theta <= high + 1e-6)]
        axes.plot(
            x[mine],
            y[mine],
            color=colour,
            lw=3.6,
            alpha=0.8,
            solid_capstyle="butt",
            zorder=2,
            label=f"face, {picture.shape(k)}",
        )


def _vertices(axes: Axes, picture: Picture, place: Any) -> None:
    found = picture.detection
    for code, name in enumerate(VERTEX_KINDS):
        mine = found.vertex_kind == code
        if mine.any():
            mark, colour = palette.VERTICES[name]
            u, v = place(found.vertex_theta[mine], found.vertex_r[mine])
            axes.plot(
                u,
                v,
                mark,
                mfc="white",
                mec=colour,
                ms=2.6,
                mew=0.6,
                ls="none",
                zorder=5,
                label=f"vertex, {name}",
            )


def _tracks(axes: Axes, paths: Sequence[TrackPath], limits: Limits) -> None:
    """Paths with their numbers and velocities; agents apart by colour and mark, hollow where hidden."""
    from matplotlib.patheffects import withStroke

    air = 0.035 * (limits.x[1] - limits.x[0])
    for path in paths:
        name = "agent" if path.is_agent else "object"
        colour, mark, _ = palette.SET_STYLES["A" if path.is_agent else "O"]
        axes.plot(path.x, path.y, color=colour, lw=1.1 if path.is_agent else 0.6, zorder=8)
        x, y = float(path.x[-1]), float(path.y[-1])
        face = colour if path.seen else "white"
        axes.plot(
            x, y, mark, mfc=face, mec=colour, ms=3.4, mew=0.8, ls="none", zorder=9, label=f"track, {name}"
        )
        vx, vy = path.velocity
        speed = float(np.hypot(vx, vy))
        if speed > 0:
            axes.annotate(
                "",
                (x + vx, y + vy),
                (x, y),
                arrowprops={**ARROW, "color": colour},
                zorder=9,
                annotation_clip=True,
            )
        # On the side that it does not move to, or away from the sensor.
        far = float(np.hypot(x, y)) or 1.0
        way = (-vx / speed, -vy / speed) if speed > 0 else (x / far, y / far)
        axes.text(
            x + 1.3 * air * way[0],
            y + 1.3 * air * way[1],
            f"{path.number} {printable(path.label)}".rstrip(),
            color=colour,
            ha="center" if not path.label else ("left" if way[0] >= 0 else "right"),
            va="center",
            fontsize=7,
            fontweight="bold",
            zorder=10,
            clip_on=True,
            path_effects=[withStroke(linewidth=1.8, foreground="white")],
        )


def _number(axes: Axes, picture: Picture, k: int, corners: Float64, limits: Limits) -> None:
    """The object's number on the side away from the sensor, where no beam is."""
    if len(picture.detection) > MANY:
        return
    from matplotlib.patheffects import withStroke

    centre = corners[:4].mean(axis=0)
    distance = float(np.hypot(*centre)) or 1.0
    ahead = centre / distance
    reach = float(((corners[:4] - centre) @ ahead).max())
    air = 0.035 * (limits.x[1] - limits.x[0])
    place = centre + ahead * (reach + air)
    axes.text(
        place[0],
        place[1],
        str(int(picture.detection.object[k])),
        ha="center",
        va="center",
        fontsize=7,
        fontweight="bold",
        zorder=8,
        clip_on=True,
        path_effects=[withStroke(linewidth=1.8, foreground="white")],
    )


def _edges(axes: Axes, picture: Picture) -> None:
    """s on entering each object, and on leaving it, which is the next beam's."""
    found = picture.detection
    low = float(picture.theta.min())
    places = np.concatenate([found.theta_i, found.theta_f + picture.step])
    values = np.concatenate([found.s_i, found.s_f])
    there = np.isfinite(values)
    if there.any():
        at = np.degrees(low + unwound(places[there] - low))
        # Beside lost beams the edge has a difference, though its beam has none.
        axes.vlines(at, 0, values[there], color=palette.BLACK, lw=0.5, ls=":", zorder=2)
        axes.plot(
            at,
            values[there],
            "o",
            mfc="none",
            mec=palette.BLACK,
            ms=4.5,
            mew=0.7,
            zorder=6,
            label="edge of an object",
        )


def _shade(axes: Axes, picture: Picture) -> None:
    found = picture.detection
    low, high = float(picture.theta.min()), float(picture.theta.max())
    half = picture.step / 2
    for k in range(len(found)):
        if picture.is_wall(k):
            continue
        start = low + float(unwound(np.array(found.theta_i[k] - low)))
        end = start + float(found.theta_f[k] - found.theta_i[k])
        parts = [(start - half, min(end, high) + half)]
        if end > high + half:
            parts.append((low, low + (end - low) % TURN + half))
        for first, last in parts:
            axes.axvspan(np.degrees(first), np.degrees(last), color=palette.SKY, alpha=0.25, lw=0, zorder=1)


def _broken(theta: Float64, values: Float64) -> tuple[Float64, Float64]:
    """A line in order of bearing; it breaks where a beam has no value."""
    order = np.argsort(theta, kind="stable")
    return theta[order], values[order]


def _bearings(axes: Axes, picture: Picture) -> None:
    low, high = np.degrees(picture.theta.min()), np.degrees(picture.theta.max())
    axes.set(xlim=(low - 1, high + 1), xlabel=r"$\theta$ [deg]")
    wide = high - low > 200
    axes.set_xticks([tick for tick in range(-360, 361, 45 if wide else 15) if low - 1 <= tick <= high + 1])
