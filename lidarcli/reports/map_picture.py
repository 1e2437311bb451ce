"""Pictures from above: a run in the world (the paper's Figs. 6 and 7), and a background."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.ticker import PercentFormatter

from lidarcli.choices import AS_IT_COMES, Look
from lidarcli.display import counted
from lidarcli.formalism.background import Background
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, Occupancy
from lidarcli.reports import palette
from lidarcli.reports.columns import Rows
from lidarcli.reports.drawing import draw_legend, entries_of, file_bytes, fit_height, new_figure, project_style
from lidarcli.reports.ground import Walls
from lidarcli.reports.labels import Label, add_labels, along
from lidarcli.reports.panels import draw_sensor
from lidarcli.reports.picture import CIRCLE, printable
from lidarcli.sweeps import Float32, Float64, Int64

Greys = tuple[float, float, float]
"""Greys of occupied, free and unknown cells, 0 black to 1 white."""
Limits = tuple[float, float, float, float]
"""Left, right, low and high limit of what is drawn [m]."""
WALLS = "walls and rest"
"""Entry of legends."""
LONG, SHORT = 7.2, 2.2
"""Longest and shortest side of the drawn ground [inch]; the map decides which is which."""
BESIDE = 0.7
"""Beside the drawn ground: what the y axis takes [inch]."""
AIR = 0.05
"""Around the map, as a share of its longer side."""
OCCUPIED_GREY, FREE_GREY, UNKNOWN_GREY = 0.15, 1.0, 0.85
"""Grey of the cells."""
BEHIND_GREY = 0.6
"""Grey of occupied cells behind a sweep, whose points lie on them."""
MOST_NUMBERS = 60
"""Most boxes that are numbered."""
MOST_PIXELS = 4_000
"""A side of the grid with more cells than this is drawn with the darkest of each group of cells."""
COLUMNS = {
    "sweeps": ("log", "topic", "sweep", "pose_x", "pose_y"),
    "trajectories": ("topic", "sweep", "track", "frame", "x", "y"),
    "tracks": ("topic", "track", "set", "shape", "label", "sweeps", "x", "y", "yaw", "length", "width"),
}
"""Table → columns that it is made of."""
MOST_POINTS = 2_000
"""Points of a line that are drawn; more are thinned out evenly."""
MOST_AGENTS = 200
"""Agents whose ways are drawn, those that were seen longest."""
LEAST_SWEEPS = 5
"""Least number of sweeps that saw a track that is drawn, or half of all sweeps if that is fewer."""
SENSOR_WIDTH = 4.2
"""Width of one sensor's picture [inch]."""
MOST_SURFACES = 200_000
"""More points than this are thinned out."""
SUPPORT = "share of the sweeps that saw $r_e$"
SUPPORT_COLOURS = "viridis_r"
"""Dark is sure, as printed letters are."""
OPEN_RAY = 0.06
"""Length of the stroke that stands for an open beam, as a share of the greatest range."""


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
    """True for a circle as wide as the box is long."""


@dataclass(frozen=True)
class Snapshot:
    """One sweep in the world."""

    sweep: int
    x: float
    y: float
    yaw: float
    """Heading of the sensor [rad]."""
    points: tuple[Float64, Float64]
    """(N,) where its beams ended [m]."""
    boxes: tuple[Box, ...]
    """Boxes of the objects of the sweep."""


@dataclass(frozen=True)
class MapPicture:
    """Content of the picture, in metres and radians of the world frame."""

    grid: Occupancy | None
    paths: Sequence[tuple[Float64, Float64]] = ()
    """x and y of each sensor."""
    boxes: Sequence[Box] = ()
    """Boxes of tracks that stand."""
    agents: Sequence[tuple[int, Float64, Float64]] = ()
    """Number, x and y of what moved."""
    snapshot: Snapshot | None = None
    title: str = ""
    walls: Walls | None = None
    """Walls, drawn where there is no grid."""
    others: Sequence[Box] = ()
    """Boxes that are drawn elsewhere, and have their place here."""


def draw_map(picture: MapPicture, suffix: str, look: Look = AS_IT_COMES) -> bytes:
    """Return the picture as a file of the kind of `suffix` (.png, .svg, .pdf)."""
    with project_style({"axes.grid": False}):
        return file_bytes(map_figure(picture, look=look), suffix, look.dpi)


def map_figure(picture: MapPicture, longest: float = LONG, look: Look = AS_IT_COMES, greys: Greys | None = None) -> Figure:
    """Return a figure whose map is `longest` [inch] at its longest side; call it within `project_style`.

    Without `greys` they are those of a map by itself.
    """
    limits = limits_of(picture)
    left, right, low, high = limits
    width, height = right - left, high - low
    scale = longest / max(width, height)
    size = max(width * scale, SHORT), max(height * scale, SHORT)
    if look.width is not None:
        across = max(look.inches(0.0) - BESIDE, 0.5 * look.inches(0.0))
        size = across, across * size[1] / size[0]
    figure = new_figure(look.inches(size[0] + BESIDE), size[1] + 0.9)
    axes = figure.add_subplot()
    occupied = OCCUPIED_GREY if picture.snapshot is None else BEHIND_GREY
    map_panel(axes, picture, limits, greys or (occupied, FREE_GREY, UNKNOWN_GREY))
    if picture.title and look.title:
        axes.set_title(printable(picture.title), loc="left")
    if look.legend:
        draw_legend(figure, entries_of([axes]), "outside lower left")
    fit_height(figure, [axes], [0.0], width / height)
    return figure


def map_panel(axes: Axes, picture: MapPicture, limits: Limits, greys: Greys) -> None:
    """Draw the ground, and all that is on it, on axes with these limits."""
    left, right, low, high = limits
    _ground(axes, picture.grid, greys)
    draw_walls(axes, picture.walls)
    _marks(axes, picture)
    axes.set(aspect="equal", xlim=(left, right), ylim=(low, high), xlabel="x [m]", ylabel="y [m]")
    _scale(axes, right - left)


def limits_of(picture: MapPicture) -> Limits:
    """Return left, right, low and high limits of the drawing, with some air."""
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
    for corners in (corners_of(box) for box in (*picture.boxes, *picture.others)):
        x.append(corners[:, 0])
        y.append(corners[:, 1])
    if picture.snapshot is not None:
        x.append(picture.snapshot.points[0])
        y.append(picture.snapshot.points[1])
    flat_x, flat_y = np.concatenate([*x, np.empty(0)]), np.concatenate([*y, np.empty(0)])
    flat_x, flat_y = flat_x[np.isfinite(flat_x)], flat_y[np.isfinite(flat_y)]
    if not len(flat_x) or not len(flat_y):
        return -1.0, 1.0, -1.0, 1.0
    left, right, low, high = (float(value) for value in (flat_x.min(), flat_x.max(), flat_y.min(), flat_y.max()))
    air = max(AIR * max(right - left, high - low), 0.5)
    # The bar of the scale has its place below.
    return left - air, right + air, low - 2.0 * air, high + air


def _ground(axes: Axes, grid: Occupancy | None, greys: Greys) -> None:
    """Draw the cells in the greys of occupied, free and unknown ones."""
    if grid is None or not grid.cells.size:
        return
    occupied, free, unknown = greys
    axes.set_facecolor(str(unknown))
    grey: Float32 = np.full(grid.cells.shape, unknown, np.float32)
    grey[grid.cells == FREE] = free
    grey[grid.cells == OCCUPIED] = occupied
    step = -(-max(grey.shape) // MOST_PIXELS)
    if step > 1:
        # Thin walls must not vanish between the pixels.
        rows, columns = -(-grey.shape[0] // step) * step, -(-grey.shape[1] // step) * step
        wide = np.full((rows, columns), unknown, np.float32)
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
    """Draw paths, boxes, agents, and the sweep."""
    for x, y in picture.paths:
        axes.plot(x, y, color=palette.GREEN, lw=1.0, zorder=3, label="path of the sensor")
        if len(x) and picture.snapshot is None:
            axes.plot(x[:1], y[:1], "o", color=palette.GREEN, ms=3.5, zorder=4, label="path of the sensor: start")
    for _, x, y in picture.agents:
        axes.plot(x, y, color=palette.VERMILION, lw=0.9, zorder=5, label="what moved")
        axes.plot(x[-1:], y[-1:], "^", color=palette.VERMILION, ms=3.0, mew=0, zorder=6, label="what moved: last place")
    _boxes(axes, picture.boxes, "what stands")
    _labels(axes, picture)
    shot = picture.snapshot
    if shot is None:
        return
    axes.plot(*shot.points, ".", color=palette.VERMILION, ms=2.6, mew=0, zorder=4, label=f"sweep {shot.sweep}")
    _boxes(axes, shot.boxes, "objects of the sweep")
    draw_sensor(axes, shot.x, shot.y, shot.yaw, 7.0)


def _boxes(axes: Axes, boxes: Sequence[Box], name: str) -> None:
    for box in boxes:
        axes.plot(*corners_of(box).T, color=palette.BLUE, lw=1.3, zorder=6, label=name)


def _labels(axes: Axes, picture: MapPicture) -> None:
    """Label tracks that stand, and agents at their last position."""
    labels = []
    if len(picture.boxes) <= MOST_NUMBERS:
        for box in picture.boxes:
            if box.name:
                # To the upper right, by what lies beneath on the left.
                corners = corners_of(box)
                beneath = float(corners[:, 0].mean()) - 1.0, float(corners[:, 1].mean()) - 1.0
                labels.append(Label(printable(box.name), corners, palette.BLUE, beneath))
    for track, x, y in picture.agents[:MOST_NUMBERS]:
        if len(x):
            before = (float(x[-2]), float(y[-2])) if len(x) > 1 else None
            labels.append(Label(str(track), np.array([[x[-1], y[-1]]]), palette.VERMILION, before))
    ways = [np.stack([x, y], axis=1) for _, x, y in picture.agents]
    ways += [np.stack(path, axis=1) for path in picture.paths]
    ways += [along(corners_of(box)) for box in picture.boxes]
    grid = picture.grid
    if grid is not None:
        row, column = np.nonzero(grid.cells == OCCUPIED)
        cells = np.stack([column, row], axis=1) + 0.5
        ways.append(cells * grid.resolution + np.array([grid.x, grid.y]))
    add_labels(axes, labels, ways)


def corners_of(box: Box) -> Float64:
    """Return (N, 2) corners of a box, closed, or points of its circle [m]."""
    if box.is_round:
        circle: Float64 = 0.5 * box.length * CIRCLE + np.array([box.x, box.y])
        return circle
    half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 1]]) * 0.5 * np.array([box.length, box.width])
    cos, sin = np.cos(box.yaw), np.sin(box.yaw)
    corners: Float64 = half @ np.array([[cos, sin], [-sin, cos]]) + np.array([box.x, box.y])
    return corners


def _scale(axes: Axes, width: float) -> None:
    """Draw a bar of a round length in the lower right corner."""
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
        bbox={"facecolor": axes.get_facecolor(), "edgecolor": "none", "alpha": 0.75, "pad": 0.4},
    )


def paths_of(sweeps: Rows) -> list[tuple[Float64, Float64]]:
    """Return x and y of the sensor of each log and topic, in the order of the sweeps; none without a pose."""
    topic, _ = sweeps.words("topic")
    x, y, index = sweeps.numbers("pose_x"), sweeps.numbers("pose_y"), sweeps.integers("sweep")
    found = []
    for key in np.unique(np.column_stack([sweeps.source, topic]), axis=0):
        rows = np.flatnonzero((sweeps.source == key[0]) & (topic == key[1]) & np.isfinite(x))
        rows = _thinned(rows[np.argsort(index[rows], kind="stable")])
        if len(rows):
            found.append((x[rows], y[rows]))
    return found


def overview(sweeps: Rows, tracks: Rows | None, trajectories: Rows | None, stands: bool = False) -> MapPicture | None:
    """Return the run from above, what moved by its trajectories; None where no sweep has a pose.

    Without poses the frame of a sensor that `stands` is the world.
    """
    paths = paths_of(sweeps)
    if not paths and not stands:
        return None
    boxes: list[Box] = []
    agents: list[tuple[int, Float64, Float64]] = []
    if tracks is not None:
        boxes = _track_boxes(sweeps, tracks)
        frame = "world" if paths else "sensor"
        agents = [] if trajectories is None else _track_ways(trajectories, tracks, frame)
    return MapPicture(None, paths, boxes, agents)


def _track_boxes(sweeps: Rows, tracks: Rows) -> list[Box]:
    """Return the boxes of tracks that stand and that enough sweeps have seen."""
    of_sweep, topics = sweeps.words("topic")
    of_track, names = tracks.words("topic")
    rows = [
        np.count_nonzero((sweeps.source == source) & (of_sweep == topics.index(names[code])))
        if names[code] in topics
        else 0
        for source, code in zip(tracks.source.tolist(), of_track.tolist(), strict=True)
    ]
    least = np.minimum(LEAST_SWEEPS, np.maximum(1, np.array(rows, np.int64) // 2))
    enough = tracks.integers("sweeps") >= least
    columns = {name: tracks.numbers(name) for name in ("x", "y", "yaw", "length", "width")}
    known = np.logical_and.reduce([np.isfinite(values) for values in columns.values()])
    labels, words = tracks.words("label")
    number = tracks.integers("track")
    is_round = tracks.are("shape", "round")
    return [
        Box(
            **{name: float(values[row]) for name, values in columns.items()},
            is_round=bool(is_round[row]),
            name=str(number[row]) if labels[row] < 0 else f"{number[row]} {words[labels[row]]}",
        )
        for row in np.flatnonzero(tracks.are("set", "O") & enough & known).tolist()
    ]


def _track_ways(trajectories: Rows, tracks: Rows, frame: str) -> list[tuple[int, Float64, Float64]]:
    """Return number, x and y of each agent in a frame."""
    rows = np.flatnonzero(tracks.are("set", "A"))
    rows = rows[np.argsort(-tracks.integers("sweeps")[rows], kind="stable")][:MOST_AGENTS]
    x, y, track = (trajectories.numbers(name) for name in ("x", "y", "track"))
    sweep = trajectories.integers("sweep")
    code, names = trajectories.words("topic")
    of_track, topics = tracks.words("topic")
    numbers = tracks.integers("track")
    known = trajectories.are("frame", frame) & np.isfinite(x)
    found = []
    for row in sorted(rows.tolist()):
        topic = topics[of_track[row]]
        mine = np.flatnonzero(
            known
            & (track == numbers[row])
            & (trajectories.source == tracks.source[row])
            & (code == (names.index(topic) if topic in names else -2))
        )
        if len(mine):
            kept = _thinned(mine[np.argsort(sweep[mine], kind="stable")])
            found.append((int(numbers[row]), x[kept], y[kept]))
    return found


def _thinned(rows: Int64) -> Int64:
    """Return at most `MOST_POINTS` rows, evenly spaced, the last one included."""
    if len(rows) <= MOST_POINTS:
        return rows
    return rows[np.linspace(0, len(rows) - 1, MOST_POINTS).astype(np.int64)]


def draw_walls(axes: Axes, walls: Walls | None) -> None:
    """Draw cells in which beams ended that lie on no object."""
    if walls is not None and len(walls.x):
        corner = np.column_stack([walls.x, walls.y]) - walls.cell / 2
        shape = squares(corner, walls.cell)
        axes.add_patch(PathPatch(shape, facecolor=palette.GREY, lw=0, alpha=0.6, zorder=1, label=WALLS))
        axes.update_datalim(np.vstack([corner, corner + walls.cell]))


def squares(corner: Float64, side: float) -> Path:
    """Return one path of squares by their lower left corners (N, 2)."""
    points = corner[:, None] + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(corner))
    return Path(points.reshape(-1, 2), codes)


def draw_backgrounds(sensors: Sequence[Background], suffix: str) -> bytes:
    """Return the picture of all sensors side by side as a file of the kind of `suffix`."""
    with project_style():
        return file_bytes(background_figure(sensors), suffix)


def background_figure(sensors: Sequence[Background]) -> Figure:
    """Return the picture of all sensors as a figure; call it within `project_style`."""
    figure = new_figure(SENSOR_WIDTH * max(len(sensors), 1), SENSOR_WIDTH * 0.95)
    drawn = figure.subplots(1, max(len(sensors), 1), squeeze=False)[0].tolist()
    for axes, sensor in zip(drawn, sensors, strict=False):
        _background_panel(axes, sensor)
    draw_legend(figure, entries_of(drawn), "outside lower left")
    sides = [(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())) for axes in drawn]
    fit_height(figure, drawn, [0.0] * len(drawn), float(min(width / height for width, height in sides)))
    return figure


def _background_panel(axes: Axes, sensor: Background) -> None:
    theta = np.tile(sensor.grid.bearings(), (len(sensor), 1))
    posed = bool(sensor.posed.any())
    x0, y0, yaw = sensor.poses.x, sensor.poses.y, sensor.poses.yaw
    if not posed:
        x0, y0, yaw = np.zeros(len(sensor)), np.zeros(len(sensor)), np.zeros(len(sensor))
    side = np.where(sensor.poses.upside_down, -1.0, 1.0)
    direction = yaw[:, None] + side[:, None] * theta
    surface = np.isfinite(sensor.r_e)
    distance = np.where(surface, sensor.r_e, 0.0)
    x, y = x0[:, None] + distance * np.cos(direction), y0[:, None] + distance * np.sin(direction)
    thin = slice(None, None, max(1, int(np.count_nonzero(surface)) // MOST_SURFACES))
    support = sensor.support[surface][thin]
    low, high = _support_range(support)
    drawn = axes.scatter(
        x[surface][thin],
        y[surface][thin],
        c=support,
        cmap=SUPPORT_COLOURS,
        vmin=low,
        vmax=high,
        s=3.0,
        linewidths=0,
        rasterized=True,
    )
    # Beside the axes themselves, so that it is as high as they are.
    beside = axes.inset_axes((1.03, 0.0, 0.035, 1.0))
    bar = axes.figure.colorbar(drawn, cax=beside, label=SUPPORT)
    bar.ax.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    if not posed:
        _open_beams(axes, sensor, direction[0] if len(sensor) else direction.reshape(-1))
    for station in range(len(sensor)):
        draw_sensor(axes, float(x0[station]), float(y0[station]), float(yaw[station]), 4.0 if posed else 6.0)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    counts = f"{counted(len(sensor), 'station')}, {counted(int(sensor.sweeps.sum()), 'sweep')}"
    axes.set_title(f"{printable(sensor.topic)}  {printable(sensor.frame_id)}: {counts}")


def _support_range(support: np.ndarray[Any, np.dtype[Any]]) -> tuple[float, float]:
    """Return the range of the colour bar, in tenths: only support that occurs, so that small differences are seen."""
    if not len(support):
        return 0.0, 1.0
    low = np.floor(10.0 * float(support.min()) + 1e-6) / 10.0
    high = np.ceil(10.0 * float(support.max()) - 1e-6) / 10.0
    return (float(low), float(high)) if high > low else (float(high) - 0.1, float(high))


def _open_beams(axes: Axes, sensor: Background, direction: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    """Draw short strokes outside everything, in the directions from which nothing returns."""
    r_e = sensor.r_e[0] if len(sensor) else np.empty(0)
    known = r_e[np.isfinite(r_e)]
    reach = float(known.max()) if len(known) else 1.0
    way = direction[np.isinf(r_e)]
    ends = np.array([1.0 + OPEN_RAY, 1.0 + 2 * OPEN_RAY]) * reach
    axes.plot(np.cos(way) * ends[:, None], np.sin(way) * ends[:, None], color=palette.LIGHT, linewidth=0.6, zorder=0)
    if len(way):
        axes.plot([], [], color=palette.LIGHT, linewidth=1.2, label="open: nothing returns")
