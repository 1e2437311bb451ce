"""Curves of a sweep by bearing as marks: r(θ) and s(θ), and a comparison with a background."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lidarcli.display import palette
from lidarcli.reports.drawing import Frame, Mark, Panel, joined
from lidarcli.reports.scene import Limits, Picture, beam_marks, unwound, vertex_marks
from lidarcli.sweeps.types import TURN, Float64

LINEAR = 2.0
"""Multiple of d_th up to which s(θ) is drawn in proportion; beyond it is drawn by its logarithm."""


def sweep(picture: Picture, limits: Limits) -> Panel:
    """Return r(θ) with the objects shaded (Def. 1)."""
    theta, found = np.degrees(picture.theta), picture.detection
    low = float(np.degrees(picture.view[0]))
    bearing = low + np.degrees(unwound(found.vertex_theta - np.radians(low)))
    marks = [
        _by_bearing(theta, picture.ranges, {"color": palette.LIGHT, "lw": 0.6, "zorder": 2}),
        *beam_marks(picture, np.column_stack([theta, picture.ranges]), 1.7),
        *vertex_marks(picture, np.column_stack([bearing, found.vertex_r]), True),
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
        # Next to lost beams the edge has a difference, though its beam has none.
        marks.append(_stems(at, edges[there], {"color": palette.BLACK, "lw": 0.5, "ls": ":", "zorder": 2}))
        ring = {"marker": "o", "mfc": "none", "mec": palette.BLACK, "ms": 4.0, "mew": 0.6, "zorder": 6}
        marks.append(Mark(np.column_stack([at, edges[there]]), ring, "edge of an object"))
    return _curve(picture, marks, limits.s, r"difference $s(\theta)$ [m]", d_th=limits.d_th)


def backgrounds(picture: Picture, limits: Limits) -> Panel:
    """Return r_w, the sweep, and r_e, the scene without the objects of interest (§3)."""
    assert picture.background is not None  # the panel is drawn only with one
    theta = np.degrees(picture.theta)
    behind, front = ({"color": palette.ORANGE, "lw": 1.6, "zorder": 3}, {"color": palette.BLUE, "lw": 0.8, "zorder": 4})
    marks = [
        _by_bearing(theta, picture.background, behind, "$r_e$, background"),
        _by_bearing(theta, picture.ranges, front, "$r_w$, this sweep"),
    ]
    return _curve(picture, marks, limits.r, "$r_w$, $r_e$ [m]", low=0.0)


def subtraction(picture: Picture, limits: Limits) -> Panel:
    """Return r_w - r_e: below zero something new is in front, above zero something is gone."""
    change, theta, (first, last) = picture.change, np.degrees(picture.theta), np.degrees(picture.view)
    assert change is not None  # the panel is drawn only with a background
    marks = [
        _stems(theta[part], change[part], {"color": colour, "lw": 0.8}, name)
        for part, colour, name in ((change < 0, palette.VERMILION, "nearer"), (change >= 0, palette.GREEN, "farther"))
        if part.any()
    ]
    marks.append(Mark(np.array([[first - 1.0, 0.0], [last + 1.0, 0.0]]), {"color": palette.BLACK, "lw": 0.5}))
    return _curve(picture, marks, limits.change, "$r_w - r_e$ [m]")


def _curve(
    picture: Picture, marks: Sequence[Mark], reach: float, name: str, low: float | None = None, d_th: float = 0.0
) -> Panel:
    """Return a curve by bearing up to `reach`, with the bearings of objects shaded; `low`: the least value, else -reach."""
    first, last = np.degrees(picture.view).tolist()
    step = 45 if last - first > 200 else 15
    ticks = tuple(tick for tick in range(-360, 361, step) if first - 1 <= tick <= last + 1)
    names = (r"bearing $\theta$ [deg]", name)
    frame = Frame((first - 1, last + 1), (-reach if low is None else low, reach), names, ticks)
    # Of less reach all of s(θ) is drawn in proportion.
    if d_th > 0.0 and reach >= 8.0 * d_th:
        frame = _logarithmic(frame, d_th)
    return Panel(frame, [*_shade(picture, frame.y), *marks])


def _logarithmic(frame: Frame, d_th: float) -> Frame:
    """Return a frame of both signs on which d_th is visible next to values that are many times as large."""
    # Rounded up, so that the axes of an animation do not creep.
    decade = 10.0 ** np.floor(np.log10(LINEAR * d_th))
    linear = next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= 0.999 * LINEAR * d_th)
    reach = 1.3 * frame.y[1]
    decades = 10.0 ** np.arange(np.floor(np.log10(linear)), np.ceil(np.log10(reach)) + 1)
    ticks: list[float] = []
    # Of each decade the first choice of ticks that gives two on either side.
    for steps in ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0)):
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
