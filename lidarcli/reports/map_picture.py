"""A run from above, in the world (the paper's Figs. 6 and 7): map, path, tracks, and the boxes of what stands."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.formalism.mapping.occupancy import FREE, OCCUPIED, Occupancy
from lidarcli.reports import palette
from lidarcli.reports.chart_maps import draw_walls
from lidarcli.reports.drawing import project_style
from lidarcli.reports.picture import printable
from lidarcli.reports.walls import Walls
from lidarcli.sweeps import Float32, Float64

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LONG, SHORT = 7.2, 2.2
"""Longest and shortest side of the drawn ground [inch]; the map decides which is which."""
AIR = 0.05
"""Around the map, as a share of its longer side."""
OCCUPIED_GREY, FREE_GREY, UNKNOWN_GREY = 0.15, 1.0, 0.85
"""Grey of the cells …"""
BEHIND_GREY = 0.6
"""… and of the occupied ones behind a sweep, whose points lie on them."""
MOST_NUMBERS = 60
"""Of more boxes no numbers are drawn: nobody could read them."""
MOST_PIXELS = 4_000
"""A side of the grid with more cells than this is drawn with the darkest of each group of cells."""


@dataclass(frozen=True)
class Box:
    """A box in the world."""

    x: float
    y: float
    yaw: float
    length: float
    width: float
    name: str = ""
    """Number or label beside it."""


@dataclass(frozen=True)
class Snapshot:
    """One sweep in the world."""

    sweep: int
    x: float
    y: float
    yaw: float
    """Where the sensor was."""
    points: tuple[Float64, Float64]
    """(N,) where its beams ended [m]."""
    boxes: tuple[Box, ...]
    """Of its objects."""


@dataclass(frozen=True)
class MapPicture:
    """What is drawn; metres and radians in the world frame."""

    grid: Occupancy | None
    paths: Sequence[tuple[Float64, Float64]] = ()
    """x and y of each sensor."""
    boxes: Sequence[Box] = ()
    """Of what stands."""
    agents: Sequence[tuple[int, Float64, Float64]] = ()
    """Number, x and y of what moved."""
    snapshot: Snapshot | None = None
    title: str = ""
    walls: Walls | None = None
    """What is drawn as the ground where there is no grid."""


def draw_map(picture: MapPicture, suffix: str) -> bytes:
    """The picture as a file of the kind of `suffix` (.png, .svg, .pdf); the same map, the same bytes."""
    with project_style({"axes.grid": False}):
        out = io.BytesIO()
        dates: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
        map_figure(picture).savefig(out, format=suffix[1:], metadata=dates.get(suffix))
    return out.getvalue()


def map_figure(picture: MapPicture, longest: float = LONG) -> Figure:
    """The picture as a figure whose ground is so long at its longest [inch]; to be called in the project's style."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    left, right, low, high = _limits(picture)
    width, height = right - left, high - low
    scale = longest / max(width, height)
    size = max(width * scale, SHORT), max(height * scale, SHORT)
    figure = Figure(figsize=(size[0] + 0.7, size[1] + 0.9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    _ground(axes, picture.grid, OCCUPIED_GREY if picture.snapshot is None else BEHIND_GREY)
    draw_walls(axes, picture.walls)
    _marks(axes, picture)
    axes.set_aspect("equal")
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    if picture.title:
        axes.set_title(printable(picture.title), loc="left")
    _scale(axes, right - left)
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower left", ncols=4, frameon=False, handlelength=1.6)
    return figure


def _limits(picture: MapPicture) -> tuple[float, float, float, float]:
    """Left, right, low and high of what is drawn, with some air."""
    x: list[Float64] = [path[0] for path in picture.paths]
    y: list[Float64] = [path[1] for path in picture.paths]
    grid = picture.grid
    if grid is not None and grid.cells.size:
        rows, columns = grid.cells.shape
        x.append(np.array([grid.x, grid.x + columns * grid.resolution]))
        y.append(np.array([grid.y, grid.y + rows * grid.resolution]))
    if picture.walls is not None:
        x.append(picture.walls.x)
        y.append(picture.walls.y)
    for corners in (_corners(box) for box in picture.boxes):
        x.append(corners[:, 0])
        y.append(corners[:, 1])
    if picture.snapshot is not None:
        x.append(picture.snapshot.points[0])
        y.append(picture.snapshot.points[1])
    flat_x, flat_y = np.concatenate([*x, np.empty(0)]), np.concatenate([*y, np.empty(0)])
    flat_x, flat_y = flat_x[np.isfinite(flat_x)], flat_y[np.isfinite(flat_y)]
    if not len(flat_x) or not len(flat_y):
        return -1.0, 1.0, -1.0, 1.0
    left, right, low, high = (
        float(value) for value in (flat_x.min(), flat_x.max(), flat_y.min(), flat_y.max())
    )
    air = max(AIR * max(right - left, high - low), 0.5)
    # The bar of the scale has its place below.
    return left - air, right + air, low - 2.0 * air, high + air


def _ground(axes: Axes, grid: Occupancy | None, occupied: float) -> None:
    """The cells: occupied dark, of this grey, free white, unknown grey."""
    if grid is None or not grid.cells.size:
        return
    axes.set_facecolor(str(UNKNOWN_GREY))
    grey: Float32 = np.full(grid.cells.shape, UNKNOWN_GREY, np.float32)
    grey[grid.cells == FREE] = FREE_GREY
    grey[grid.cells == OCCUPIED] = occupied
    step = -(-max(grey.shape) // MOST_PIXELS)
    if step > 1:
        # Thin walls must not vanish between the pixels.
        rows, columns = -(-grey.shape[0] // step) * step, -(-grey.shape[1] // step) * step
        wide = np.full((rows, columns), UNKNOWN_GREY, np.float32)
        wide[: grey.shape[0], : grey.shape[1]] = grey
        grey = wide.reshape(rows // step, step, columns // step, step).min(axis=(1, 3))
    side = grid.resolution * step
    axes.imshow(
        grey,
        cmap="gray",
        vmin=0.0,
        vmax=1.0,
        origin="lower",
        interpolation="nearest",
        extent=(grid.x, grid.x + grey.shape[1] * side, grid.y, grid.y + grey.shape[0] * side),
        zorder=0,
    )


def _marks(axes: Axes, picture: MapPicture) -> None:
    """Paths, boxes, agents, and one sweep."""
    for number, (x, y) in enumerate(picture.paths):
        axes.plot(x, y, color=palette.GREEN, lw=1.0, zorder=3, label="" if number else "path of the sensor")
        if len(x) and picture.snapshot is None:
            axes.plot(x[:1], y[:1], "o", color=palette.GREEN, ms=3.5, zorder=4)
    for number, (_, x, y) in enumerate(picture.agents):
        axes.plot(x, y, color=palette.VERMILION, lw=0.9, zorder=5, label="" if number else "what moved")
    for number, (track, x, y) in enumerate(picture.agents):
        if number < MOST_NUMBERS and len(x):
            _number(axes, float(x[-1]), float(y[-1]), str(track), palette.VERMILION)
    _boxes(axes, picture.boxes, "what stands")
    shot = picture.snapshot
    if shot is None:
        return
    axes.plot(
        *shot.points, ".", color=palette.VERMILION, ms=2.6, mew=0, zorder=4, label=f"sweep {shot.sweep}"
    )
    _boxes(axes, shot.boxes, "objects of the sweep")
    turn = float(np.degrees(shot.yaw)) - 90.0
    axes.plot(
        [shot.x],
        [shot.y],
        marker=(3, 0, turn),
        color=palette.BLACK,
        ms=7,
        ls="none",
        zorder=8,
        label="sensor",
    )


def _boxes(axes: Axes, boxes: Sequence[Box], name: str) -> None:
    for number, box in enumerate(boxes):
        corners = _corners(box)
        axes.plot(
            corners[:, 0], corners[:, 1], color=palette.BLUE, lw=1.3, zorder=6, label="" if number else name
        )
        if box.name and len(boxes) <= MOST_NUMBERS:
            _number(axes, float(corners[:, 0].max()), float(corners[:, 1].max()), box.name, palette.BLUE)


def _number(axes: Axes, x: float, y: float, text: str, colour: str) -> None:
    axes.annotate(
        printable(text), (x, y), (1.5, 1.5), textcoords="offset points", fontsize=6, color=colour, zorder=7
    )


def _corners(box: Box) -> Float64:
    """(5, 2) corners of a box, closed [m]."""
    half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * 0.5 * np.array([box.length, box.width])
    cos, sin = np.cos(box.yaw), np.sin(box.yaw)
    corners: Float64 = half @ np.array([[cos, sin], [-sin, cos]]) + np.array([box.x, box.y])
    return corners


def _scale(axes: Axes, width: float) -> None:
    """A bar of a round length in the lower right corner."""
    about = 0.2 * width
    power = 10.0 ** np.floor(np.log10(about))
    length = float(max(step * power for step in (1, 2, 5) if step * power <= about))
    share = length / width
    axes.plot(
        [0.97 - share, 0.97],
        [0.03, 0.03],
        transform=axes.transAxes,
        color=palette.BLACK,
        lw=2.0,
        zorder=9,
        solid_capstyle="butt",
    )
    axes.text(
        0.97 - 0.5 * share,
        0.04,
        f"{length:g} m",
        transform=axes.transAxes,
        ha="center",
        va="bottom",
        zorder=9,
    )
