"""A run from above, in the world (the paper's Figs. 6 and 7): map, path, tracks, and the boxes of what stands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from lidarcli.choices import AS_IT_COMES, Look
from lidarcli.formalism.mapping.occupancy import FREE, OCCUPIED, Occupancy
from lidarcli.reports import palette
from lidarcli.reports.chart_maps import draw_walls
from lidarcli.reports.drawing import draw_legend, entries_of, project_style
from lidarcli.reports.figure_file import file_bytes
from lidarcli.reports.layout import fit_height
from lidarcli.reports.picture import printable
from lidarcli.reports.scene import CIRCLE, sensor
from lidarcli.reports.walls import Walls
from lidarcli.sweeps import Float32, Float64

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LONG, SHORT = 7.2, 2.2
"""Longest and shortest side of the drawn ground [inch]; the map decides which is which."""
BESIDE = 0.7
"""Beside the drawn ground: what the y axis takes [inch]."""
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
    is_round: bool = False
    """It is a circle as wide as the box is long."""


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


def draw_map(picture: MapPicture, suffix: str, look: Look = AS_IT_COMES) -> bytes:
    """The picture as a file of the kind of `suffix` (.png, .svg, .pdf); the same map, the same bytes."""
    with project_style({"axes.grid": False}):
        return file_bytes(map_figure(picture, look=look), suffix, look.dpi)


def map_figure(picture: MapPicture, longest: float = LONG, look: Look = AS_IT_COMES) -> Figure:
    """The picture as a figure whose ground is so long at its longest [inch]; to be called in the project's style."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    left, right, low, high = _limits(picture)
    width, height = right - left, high - low
    scale = longest / max(width, height)
    size = max(width * scale, SHORT), max(height * scale, SHORT)
    if look.width is not None:
        across = max(look.inches(0.0) - BESIDE, 0.5 * look.inches(0.0))
        size = across, across * size[1] / size[0]
    figure = Figure(figsize=(look.inches(size[0] + BESIDE), size[1] + 0.9), layout="constrained")
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
    if picture.title and look.title:
        axes.set_title(printable(picture.title), loc="left")
    _scale(axes, right - left)
    if look.legend:
        draw_legend(figure, entries_of([axes]), "outside lower left")
    fit_height(figure, [axes], [0.0], width / height)
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
    _boxes(axes, picture.boxes, "what stands")
    _labels(axes, picture)
    shot = picture.snapshot
    if shot is None:
        return
    axes.plot(
        *shot.points, ".", color=palette.VERMILION, ms=2.6, mew=0, zorder=4, label=f"sweep {shot.sweep}"
    )
    _boxes(axes, shot.boxes, "objects of the sweep")
    sensor(axes, shot.x, shot.y, shot.yaw, 7.0)


def _boxes(axes: Axes, boxes: Sequence[Box], name: str) -> None:
    for number, box in enumerate(boxes):
        corners = _corners(box)
        axes.plot(
            corners[:, 0], corners[:, 1], color=palette.BLUE, lw=1.3, zorder=6, label="" if number else name
        )


def _labels(axes: Axes, picture: MapPicture) -> None:
    """Numbers of what stands, and of what moved where it was last."""
    from lidarcli.reports.labelling import Label, add_labels, along

    labels = []
    if len(picture.boxes) <= MOST_NUMBERS:
        for box in picture.boxes:
            if box.name:
                # To the upper right, by what lies beneath on the left.
                corners = _corners(box)
                beneath = float(corners[:, 0].mean()) - 1.0, float(corners[:, 1].mean()) - 1.0
                labels.append(Label(printable(box.name), corners, palette.BLUE, beneath))
    for track, x, y in picture.agents[:MOST_NUMBERS]:
        if len(x):
            before = (float(x[-2]), float(y[-2])) if len(x) > 1 else None
            labels.append(Label(str(track), np.array([[x[-1], y[-1]]]), palette.VERMILION, before))
    ways = [np.stack([x, y], axis=1) for _, x, y in picture.agents]
    ways += [np.stack(path, axis=1) for path in picture.paths]
    ways += [along(_corners(box)) for box in picture.boxes]
    grid = picture.grid
    if grid is not None:
        row, column = np.nonzero(grid.cells == OCCUPIED)
        cells = np.stack([column, row], axis=1) + 0.5
        ways.append(cells * grid.resolution + np.array([grid.x, grid.y]))
    add_labels(axes, labels, ways)


def _corners(box: Box) -> Float64:
    """(N, 2) corners of a box, closed, or points of its circle [m]."""
    if box.is_round:
        circle: Float64 = 0.5 * box.length * CIRCLE + np.array([box.x, box.y])
        return circle
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
