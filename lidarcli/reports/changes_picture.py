"""Picture of what changed from run to run: the ground grey, new vermilion, gone blue, moved as an arrow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from lidarcli.formalism.mapping.grid import OCCUPIED, UNKNOWN, Occupancy
from lidarcli.reports import palette
from lidarcli.reports.changes import FIRST, Change, RunPair
from lidarcli.reports.drawing import Entries, draw_legend, file_bytes, fit_height, new_figure, project_style
from lidarcli.reports.labels import Label, add_labels, along
from lidarcli.reports.map_picture import MOST_NUMBERS, Box, Limits, MapPicture, corners_of, limits_of, map_panel
from lidarcli.reports.picture import printable
from lidarcli.sweeps import Float64

SMALLEST = 0.1
"""Least side of a box that is drawn [m]."""
GREYS = 0.45, 0.9, 1.0
"""Greys of occupied, free and unseen cells."""
BESIDE = 0.15
"""Cells of a known thing lie this far around its box [m]."""
STANDS = 0.3
"""A sensor whose places lie within so far stands [m]."""
MOST_PLACES = 1_000
"""About so many places of a sensor are drawn."""
PANEL, WIDEST = 6.2, 24.0
"""Longest side of the ground of a panel, and greatest width of a picture of many [inch]."""
TITLE_MARKS = 90
"""Characters of a line above a panel that is `PANEL` wide."""
STYLES: dict[str, tuple[str, dict[str, Any]]] = {
    "known": (palette.DARK, {"facecolor": (*[0.85] * 3, 0.6), "lw": 1.0}),
    "moved": (palette.GREEN, {"facecolor": palette.GREEN, "alpha": 0.5, "lw": 1.0}),
    "new": (palette.VERMILION, {"facecolor": palette.VERMILION, "alpha": 0.7, "lw": 1.0}),
    "gone": (palette.BLUE, {"facecolor": palette.BLUE, "alpha": 0.7, "lw": 1.0}),
    "uncertain": (palette.PURPLE, {"facecolor": "none", "hatch": "//////", "lw": 1.0}),
}
"""Status → colour and style."""
OLD = {"facecolor": "none", "ls": (0, (3, 2)), "lw": 1.0}
"""Style of the old place of what was moved."""


@dataclass(frozen=True, slots=True)
class Sight:
    """Ground on which the changes of a run are drawn."""

    ground: Occupancy | None = None
    """That of the runs before."""
    sensors: Float64 | None = None
    """(N, 2) places of the sensor of the run [m]."""


def draw_changes(pairs: Sequence[RunPair], sights: Sequence[Sight]) -> bytes:
    """Return a .png with a panel for each run, all in the coordinates of the first one."""
    with project_style({"axes.grid": False}):
        return file_bytes(changes_figure(pairs, sights), ".png")


def changes_figure(pairs: Sequence[RunPair], sights: Sequence[Sight]) -> Figure:
    """Return a figure with a panel for each run; call it within `project_style`."""
    drawn = [_Drawn.of(pair, sight) for pair, sight in zip(pairs, sights, strict=True)]
    each = [one.limits for one in drawn]
    left, low = (min(one[k] for one in each) for k in (0, 2))
    right, high = (max(one[k] for one in each) for k in (1, 3))
    aspect = (right - left) / (high - low)
    columns = _columns(len(pairs), aspect)
    rows = -(-len(pairs) // columns)
    long = min(PANEL, WIDEST / columns)
    width, height = (long, long / aspect) if aspect > 1 else (long * aspect, long)
    width = max(width, 0.5 * long) + 0.7
    figure = new_figure(width * columns, (height + 0.9) * rows)
    panels: list[Axes] = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for spare in panels[len(pairs) :]:
        spare.remove()
    panels = panels[: len(pairs)]
    for axes, pair, one in zip(panels, pairs, drawn, strict=True):
        _panel(axes, one, (left, right, low, high))
        most = int(TITLE_MARKS * width / (PANEL + 0.7))
        axes.set_title(f"{printable(_cut(pair.title, most))}\n{printable(pair.words)}", loc="left")
    draw_legend(figure, _entries(drawn), "outside lower left")
    fit_height(figure, panels, [0.0] * len(panels), aspect)
    return figure


def _columns(count: int, aspect: float) -> int:
    """Return in how many columns panels stand so that the picture is about as wide as high."""
    return max(1, min(count, math.ceil(math.sqrt(count / min(max(aspect, 0.25), 4.0)))))


def _cut(text: str, most: int) -> str:
    return text if len(text) <= most else f"{text[: most // 2]}…{text[-(most - most // 2 - 1) :]}"


@dataclass(frozen=True, slots=True)
class _Drawn:
    """Changes of a run with their boxes."""

    changes: tuple[tuple[Change, Box, Box | None], ...]
    """Each with its box, and its old one if it was moved."""
    sensors: Float64
    """(S, 2) places of the sensor [m]."""
    cells: Float64
    """(N, 2) occupied cells of the ground [m]."""
    picture: MapPicture

    @staticmethod
    def of(pair: RunPair, sight: Sight) -> _Drawn:
        """Return the changes whose place is known."""
        ground = None if sight.ground is None else _known_part(sight.ground)
        cells = np.empty((0, 2)) if ground is None else _occupied(ground)
        found = [(one, _box(one, cells), _old(one)) for one in pair.changes]
        changes = tuple((one, box, old) for one, box, old in found if box is not None)
        boxes = [box for _, *both in changes for box in both if box is not None]
        sensors = np.empty((0, 2)) if sight.sensors is None else sight.sensors
        sensors = sensors[np.isfinite(sensors).all(axis=1)]
        return _Drawn(changes, sensors, cells, MapPicture(ground, others=boxes))

    @property
    def limits(self) -> Limits:
        """Limits of all that is drawn."""
        return limits_of(replace(self.picture, paths=[(self.sensors[:, 0], self.sensors[:, 1])]))


def _known_part(ground: Occupancy) -> Occupancy:
    """Return the part of the ground that was seen."""
    row, column = np.nonzero(ground.cells != UNKNOWN)
    if not len(row):
        return ground
    low, left = int(row.min()), int(column.min())
    return replace(
        ground,
        x=ground.x + left * ground.resolution,
        y=ground.y + low * ground.resolution,
        cells=ground.cells[low : int(row.max()) + 1, left : int(column.max()) + 1],
    )


def _occupied(ground: Occupancy) -> Float64:
    """Return (N, 2) middles of the occupied cells [m]."""
    row, column = np.nonzero(ground.cells == OCCUPIED)
    cells = np.stack([column, row], axis=1) + 0.5
    middles: Float64 = cells * ground.resolution + np.array([ground.x, ground.y])
    return middles


def _box(one: Change, cells: Float64) -> Box | None:
    """Return the box of a change in the last run that has it; a known thing takes in what the runs before saw of it."""
    place, yaw = one.place, one.yaw_a if one.x_b is None else one.yaw_b
    if place is None:
        return None
    box = _sized(one, *place, yaw or 0.0)
    if one.status != "known" or one.x_a is None or one.y_a is None:
        return box
    # Each run saw the sides that were turned to its sensor.
    cos, sin = math.cos(box.yaw), math.sin(box.yaw)
    ways = np.array([[cos, -sin], [sin, cos]])
    half = 0.5 * np.array([box.length, box.width])
    places = (cells - [box.x, box.y]) @ ways
    beyond = np.abs(places) - half
    mine = places[(beyond.max(axis=1) <= BESIDE) & (beyond.min(axis=1) <= 0.0)]
    shift = np.array([one.x_a - box.x, one.y_a - box.y]) @ ways
    all_of_it = np.concatenate([mine, [half, -half, shift + half, shift - half]])
    low, high = all_of_it.min(axis=0), all_of_it.max(axis=0)
    x, y = ways @ (0.5 * (low + high))
    length, width = high - low
    return replace(box, x=box.x + x, y=box.y + y, length=float(length), width=float(width))


def _old(one: Change) -> Box | None:
    """Return the box of what was moved in its old place."""
    if one.status != "moved" or one.x_a is None or one.y_a is None or one.x_b is None:
        return None
    return _sized(one, one.x_a, one.y_a, one.yaw_a or 0.0)


def _sized(one: Change, x: float, y: float, yaw: float) -> Box:
    length, width = (max(side or SMALLEST, SMALLEST) for side in (one.length, one.width))
    return Box(x, y, yaw, length, width)


def _panel(axes: Axes, drawn: _Drawn, limits: Limits) -> None:
    """Draw the changes of a run on its ground."""
    map_panel(axes, drawn.picture, limits, GREYS)
    ways = [drawn.sensors[:: max(1, len(drawn.sensors) // MOST_PLACES)]]
    if len(drawn.sensors):
        axes.plot(*ways[0].T, **_sensor_style(drawn.sensors), zorder=6)
    for one, box, old in drawn.changes:
        colour, style = STYLES[one.status]
        for each, look in ((box, style), *([(old, OLD)] if old is not None else [])):
            corners = corners_of(each)
            patch = Polygon(corners, edgecolor=colour, zorder=7, **look)
            # The limits are known, and layouts need not look at each of thousands.
            patch.set_in_layout(False)
            axes.add_artist(patch)
            ways.append(along(corners))
        if old is not None:
            arrow = {"arrowstyle": "->", "color": colour, "lw": 1.2, "shrinkA": 0.0, "shrinkB": 0.0}
            axes.annotate("", (box.x, box.y), (old.x, old.y), arrowprops=arrow, zorder=8)
            ways.append(along(np.array([[old.x, old.y], [box.x, box.y]])))
    ways.append(drawn.cells)
    first = sorted(drawn.changes, key=lambda each: FIRST.index(each[0].status))[:MOST_NUMBERS]
    add_labels(axes, [_label(*each) for each in first], ways)


def _label(one: Change, box: Box, old: Box | None) -> Label:
    """Return the number of a change: on the far side of the place that it comes from, else to the upper right."""
    away = (box.x - 1.0, box.y - 1.0) if old is None else (old.x, old.y)
    return Label(str(one.thing), corners_of(box), STYLES[one.status][0], away)


def _sensor_style(sensors: Float64) -> dict[str, Any]:
    """Return the style of the way of a sensor, or of the place where it stands."""
    if len(sensors) and np.ptp(sensors, axis=0).max() < STANDS:
        return {"color": palette.BLACK, "marker": "o", "ms": 4.0, "mew": 0.0, "ls": "none"}
    return {"color": palette.BLACK, "lw": 1.0}


def _entries(drawn: Sequence[_Drawn]) -> Entries:
    """Return the entries of the legend: every status, and the ground and the sensors where there are any."""
    found: Entries = {}
    if any(one.picture.grid is not None for one in drawn):
        occupied, free, unseen = map(str, GREYS)
        found["structure before"] = Patch(facecolor=occupied)
        found["free before"] = Patch(facecolor=free)
        found["unseen before"] = Patch(facecolor=unseen, edgecolor=palette.GREY, lw=0.5)
    for status, (colour, style) in STYLES.items():
        found[status] = Patch(edgecolor=colour, **style)
    found["moved"] = Line2D([], [], color=palette.GREEN, marker=r"$\rightarrow$", ms=11.0, mew=0.3, ls="none")
    for sensors in (one.sensors for one in drawn if len(one.sensors)):
        found.setdefault("sensor of the later run", Line2D([], [], **_sensor_style(sensors)))
    return found
