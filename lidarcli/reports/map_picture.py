"""Pictures from above: a run in the world (the paper's Figs. 6 and 7), changes from run to run, and a background."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter, PercentFormatter

from lidarcli.display import palette
from lidarcli.display.texts import counted
from lidarcli.errors import OptionError
from lidarcli.formalism.background import Background
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN, Occupancy
from lidarcli.options.choices import AS_IT_COMES, Look
from lidarcli.options.times import SECOND_NS
from lidarcli.reports.columns import Rows
from lidarcli.reports.drawing import (
    Entries,
    Frame,
    Label,
    Mark,
    Panel,
    arrow,
    draw_legend,
    draw_marks,
    draw_panel,
    entries_of,
    file_bytes,
    fit_height,
    joined,
    new_figure,
    project_style,
    sensor,
)
from lidarcli.reports.run_pairs import FIRST, Change, RunPair
from lidarcli.reports.scene import MAX_NUMBERS, outline_of, printable
from lidarcli.sweeps.types import Bool, Float32, Float64, Int64

Greys = tuple[float, float, float]
"""Greys of occupied, free and unknown cells, 0 black to 1 white."""
Extent = tuple[float, float, float, float]
"""Left, right, low and high limit of what is drawn [m]."""
LONG = 7.2
"""Longest side of the drawn map [inch]."""
Y_AXIS = 0.7
"""Width of the y axis next to it [inch]."""
CHANGE_GREYS = 0.45, 0.9, 1.0
"""Greys of the cells behind changes."""
MAX_PIXELS = 4_000
"""A side of the grid with more cells than this is drawn with the darkest of each group of cells."""
COLUMNS = {
    "sweeps": ("log", "topic", "sweep", "stamp", "pose_x", "pose_y"),
    "trajectories": ("topic", "sweep", "stamp", "track", "frame", "x", "y", "seen"),
    "tracks": ("topic", "track", "set", "shape", "label", "sweeps", "x", "y", "yaw", "length", "width"),
}
"""Table → columns that `overview` needs."""
MAX_AGENTS = 200
"""Most agents whose paths are drawn: those that were observed longest."""
MAX_POINTS = 2_000
"""Points of a line that are drawn; more are thinned out evenly."""
PANEL = 6.2
"""Longest side of the map of a panel of changes [inch]."""
STYLES: dict[str, dict[str, Any]] = {
    "known": {"ec": palette.DARK, "fc": (*[0.85] * 3, 0.6)},
    "moved": {"ec": palette.GREEN, "fc": palette.GREEN, "alpha": 0.5},
    "new": {"ec": palette.VERMILION, "fc": palette.VERMILION, "alpha": 0.7},
    "gone": {"ec": palette.BLUE, "fc": palette.BLUE, "alpha": 0.7},
    "uncertain": {"ec": palette.PURPLE, "fc": "none", "hatch": "//////"},
}
"""Status of a change → style of its box."""
PLACE_COLOURS = {"fits": palette.GREEN, "off": palette.VERMILION, "lost": palette.PURPLE, "unknown": palette.BLUE}
DWELL_CELL = 0.25
"""Side of a cell in which the time of agents is summed [m]."""
SENSOR_WIDTH = 4.2
"""Width of the picture of the background of one sensor [inch]."""


class MapBox(NamedTuple):
    """A box in the world [m, rad], or a circle as wide as it is long."""

    x: float
    y: float
    yaw: float
    length: float
    width: float
    is_round: bool = False
    name: str = ""
    """Number or label next to it."""

    @property
    def outline(self) -> Float64:
        """(N, 2) corners, closed, or points of the circle [m]."""
        return outline_of(*self[:6])


@dataclass(frozen=True)
class Snapshot:
    """One sweep in the world."""

    sweep: int
    pose: tuple[float, float, float]
    """Place and heading of the sensor [m, rad]."""
    points: Float64
    """(N, 2) where its beams ended [m]."""
    boxes: tuple[MapBox, ...]
    """Boxes of the objects of the sweep."""


class Dwell(NamedTuple):
    """Time that agents spent in the cells of a grid."""

    x: float
    y: float
    """Lower left corner [m]."""
    seconds: Float64
    """(rows, columns) from below and from the left, 0 where nobody was."""


@dataclass(frozen=True)
class MapPicture:
    """Content of the picture, in metres and radians of the world frame."""

    grid: Occupancy | None
    paths: Sequence[Float64] = ()
    """(N, 2) path of each sensor."""
    boxes: Sequence[MapBox] = ()
    """Boxes of tracks that are static."""
    agents: Sequence[tuple[int, Float64]] = ()
    """Number and path, (N, 2), of what moved; NaN where no sweep saw it go on."""
    snapshot: Snapshot | None = None
    title: str = ""
    places: Sequence[tuple[str, Float64, str]] = ()
    """State of a path on the map, of `PLACE_COLOURS`, (N, 2) its places in this state, and words on them, or none."""
    dwell: Dwell | None = None
    """In place of the paths of the agents."""


def draw_map(picture: MapPicture, suffix: str, look: Look = AS_IT_COMES) -> bytes:
    """Return the picture as a file of the kind of `suffix` (.png, .svg, .pdf)."""
    with project_style({"axes.grid": False}):
        return file_bytes(map_figure(picture, look=look), suffix, look.dpi)


def map_figure(picture: MapPicture, longest: float = LONG, look: Look = AS_IT_COMES, greys: Greys | None = None) -> Figure:
    """Return a figure whose map is `longest` [inch] at its longest side; call it within `project_style`.

    Without `greys` they are those of a map by itself.
    """
    left, right, low, high = limits = limits_of(picture)
    aspect = (right - left) / (high - low)
    width = max(longest * min(aspect, 1.0), 2.2) + Y_AXIS
    figure = new_figure(look.inches(width), longest)
    axes = figure.add_subplot()
    # Behind a sweep occupied cells are paler: its points lie on them.
    _draw_grid(axes, picture.grid, greys or (0.15 if picture.snapshot is None else 0.6, 1.0, 0.85))
    panel = Panel(_frame(limits), [*_marks(picture)], [*_labels(picture)], _occupied(picture.grid))
    draw_panel(axes, panel)
    if picture.dwell is not None:
        _draw_dwell(axes, picture.dwell)
    if picture.title and look.title:
        axes.set_title(printable(picture.title), loc="left")
    if look.legend:
        draw_legend(figure, entries_of([axes]), "outside lower left")
    fit_height(figure, [axes], [0.0], aspect)
    return figure


def _frame(limits: Extent) -> Frame:
    return Frame(limits[:2], limits[2:], ("x [m]", "y [m]"), equal=True)


def limits_of(picture: MapPicture, others: Sequence[Float64] = ()) -> Extent:
    """Return left, right, low and high limits of the drawing and of other points, with some air."""
    parts = [
        np.empty((0, 2)),
        *picture.paths,
        *(places for _, places, _ in picture.places),
        *others,
        *(box.outline for box in picture.boxes),
    ]
    grid = picture.grid
    if grid is not None and grid.cells.size:
        origin = np.array([grid.x, grid.y])
        parts += [origin[None], (origin + np.array(grid.cells.shape[::-1]) * grid.resolution)[None]]
    if picture.snapshot is not None:
        parts.append(picture.snapshot.points)
    xy = np.concatenate(parts)
    xy = xy[np.isfinite(xy).all(axis=1)]
    if not len(xy):
        return -1.0, 1.0, -1.0, 1.0
    (left, low), (right, high) = xy.min(axis=0).tolist(), xy.max(axis=0).tolist()
    air = max(0.05 * max(right - left, high - low), 0.5)
    return left - air, right + air, low - air, high + air


def _draw_grid(axes: Axes, grid: Occupancy | None, greys: Greys) -> None:
    """Draw the cells in the greys of occupied, free and unknown ones."""
    if grid is None or not grid.cells.size:
        return
    occupied, free, unknown = greys
    axes.set_facecolor(str(unknown))
    grey: Float32 = np.full(grid.cells.shape, unknown, np.float32)
    grey[grid.cells == FREE] = free
    grey[grid.cells == OCCUPIED] = occupied
    step = -(-max(grey.shape) // MAX_PIXELS)
    if step > 1:
        # Thin walls must not vanish between the pixels.
        rows, columns = (-(-side // step) * step for side in grey.shape)
        spare = ((0, rows - grey.shape[0]), (0, columns - grey.shape[1]))
        wide = np.pad(grey, spare, constant_values=unknown)
        grey = wide.reshape(rows // step, step, columns // step, step).min(axis=(1, 3))
    high, wide_by = np.array(grey.shape) * grid.resolution * step
    extent = (grid.x, grid.x + wide_by, grid.y, grid.y + high)
    axes.imshow(grey, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", interpolation="nearest", extent=extent, zorder=0)


def _draw_dwell(axes: Axes, dwell: Dwell) -> None:
    high, wide = np.array(dwell.seconds.shape) * DWELL_CELL
    extent = (dwell.x, dwell.x + wide, dwell.y, dwell.y + high)
    some = np.ma.masked_equal(dwell.seconds, 0.0)
    # A few places where somebody waits must not hide the paths.
    scale = LogNorm(max(some.min(), 0.05), max(some.max(), 0.1))
    shown = axes.imshow(some, cmap="YlOrRd", norm=scale, origin="lower", interpolation="nearest", extent=extent, zorder=2)
    bar = _colour_bar(axes, shown, "time of agents in a cell of 0.25 m [s]").ax.yaxis
    bar.set_major_formatter("{x:g}")
    bar.set_minor_formatter(FuncFormatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else ""))


def _colour_bar(axes: Axes, shown: Any, words: str) -> Any:
    """Return a colour bar next to the axes themselves, so that it is as high as they are."""
    return axes.figure.colorbar(shown, cax=axes.inset_axes((1.03, 0.0, 0.035, 1.0)), label=words)


def _occupied(grid: Occupancy | None) -> Float64:
    """Return (N, 2) middles of the occupied cells [m]."""
    if grid is None:
        return np.empty((0, 2))
    cells = np.argwhere(grid.cells == OCCUPIED)[:, ::-1] + 0.5
    middles: Float64 = cells * grid.resolution + np.array([grid.x, grid.y])
    return middles


def _marks(picture: MapPicture) -> Iterator[Mark]:
    """Yield paths, boxes, agents, and the sweep."""
    shot = picture.snapshot
    for state, places, _ in picture.places:
        if len(places):
            yield Mark(places, {"marker": ".", "ls": "", "color": PLACE_COLOURS[state], "ms": 3.0, "zorder": 3}, state)
    for path in picture.paths:
        yield Mark(path, {"color": palette.GREEN, "lw": 1.0, "zorder": 3}, "path of the sensor")
        if shot is None:
            start = {"marker": "o", "color": palette.GREEN, "ms": 4.5, "zorder": 4}
            yield Mark(path[:1], start, "path of the sensor: start")
    for _, path in picture.agents:
        yield Mark(path, {"color": palette.VERMILION, "lw": 0.9, "zorder": 5}, "what moved")
        last = {"marker": "^", "color": palette.VERMILION, "ms": 3.0, "zorder": 6}
        yield Mark(path[-1:], last, "what moved: last place")
    box = {"color": palette.BLUE, "lw": 1.3, "zorder": 6}
    if picture.boxes:
        yield Mark(joined(each.outline for each in picture.boxes), box, "what stands")
    if shot is not None:
        points = {"marker": ".", "color": palette.VERMILION, "ms": 2.6, "zorder": 4}
        yield Mark(shot.points, points, f"sweep {shot.sweep}")
        if shot.boxes:
            yield Mark(joined(each.outline for each in shot.boxes), box, "objects of the sweep")
        yield sensor(*shot.pose, size=7.0)


def _labels(picture: MapPicture) -> Iterator[Label]:
    """Yield labels of static tracks, of agents at their last position, and of parts of a path."""
    for box in picture.boxes if len(picture.boxes) <= MAX_NUMBERS else ():
        if box.name:
            # To the upper right.
            yield Label(printable(box.name), box.outline, palette.BLUE, (box.x - 1.0, box.y - 1.0))
    for state, places, words in picture.places:
        if words and len(places):
            yield Label(words, places[len(places) // 2][None], PLACE_COLOURS[state])
    for track, path in picture.agents[:MAX_NUMBERS]:
        before = path[np.isfinite(path[:, 0])][-2:][0]
        yield Label(str(track), path[-1:], palette.VERMILION, (float(before[0]), float(before[1])))


def paths_of(sweeps: Rows) -> list[Float64]:
    """Return (N, 2) path of the sensor of each log and topic, in the order of the sweeps; none without a pose."""
    topic, _ = sweeps.words("topic")
    xy, index = np.column_stack([sweeps.numbers("pose_x"), sweeps.numbers("pose_y")]), sweeps.integers("sweep")
    found = []
    for key in np.unique(np.column_stack([sweeps.source, topic]), axis=0):
        rows = np.flatnonzero((sweeps.source == key[0]) & (topic == key[1]) & np.isfinite(xy[:, 0]))
        if len(rows):
            found.append(xy[_thinned(rows[np.argsort(index[rows], kind="stable")])])
    return found


def overview(
    sweeps: Rows, tracks: Rows | None, trajectories: Rows | None, stands: bool = False, *, density: bool = False
) -> MapPicture | None:
    """Return the run from above, what moved by its trajectories; None where no sweep has a pose.

    Without poses the frame of a sensor that `stands` is the world. `density`: the time of agents by place, not their paths.
    """
    paths = paths_of(sweeps)
    if not paths and not stands:
        return None
    boxes = [] if tracks is None else _track_boxes(sweeps, tracks)
    agents: list[tuple[int, Float64]] = []
    dwell = None
    if tracks is not None and trajectories is not None:
        frame = "world" if paths else "sensor"
        if density:
            dwell = _dwell(trajectories, tracks, frame)
        else:
            agents = [*_track_paths(trajectories, tracks, frame)]
    return MapPicture(None, paths, boxes, agents, dwell=dwell)


def _track_boxes(sweeps: Rows, tracks: Rows) -> list[MapBox]:
    """Return the boxes of static tracks that are visible in enough sweeps."""
    stream = [f"{source} {topic}" for source, topic in zip(sweeps.source.tolist(), sweeps.texts("topic"), strict=True)]
    counts = Counter(stream)
    for key in [*counts]:
        # Tracks of several topics.
        counts[key.partition(" ")[0] + " "] += counts[key]
    of_tracks = zip(tracks.source.tolist(), tracks.texts("topic"), strict=True)
    least = [min(5, max(1, counts[f"{source} {topic}"] // 2)) for source, topic in of_tracks]
    sides = np.column_stack([tracks.numbers(name) for name in ("x", "y", "yaw", "length", "width")])
    known = tracks.are("set", "O") & (tracks.integers("sweeps") >= least) & np.isfinite(sides).all(axis=1)
    rows = np.flatnonzero(known)
    numbers, labels = tracks.integers("track")[rows].tolist(), tracks.texts("label", rows)
    names = [f"{number} {label}".rstrip() for number, label in zip(numbers, labels, strict=True)]
    is_round = tracks.are("shape", "round")[rows].tolist()
    return [MapBox._make([*side, *more]) for side, *more in zip(sides[rows].tolist(), is_round, names, strict=True)]


def _of_agents(trajectories: Rows, tracks: Rows, frame: str) -> Iterator[tuple[int, int, Int64, Bool]]:
    """Yield each agent in a frame: its row and number, the rows of its path by time, and which steps were observed."""
    # Imported here: most pictures need no tracks.
    from lidarcli.formalism.tracking.trajectories import observed_steps

    track, stamp = trajectories.numbers("track"), trajectories.integers("stamp")
    (topic, topics), (of_track, names) = trajectories.words("topic"), tracks.words("topic")
    seen = ~trajectories.are("seen", "hidden")
    numbers = tracks.integers("track")
    known = np.flatnonzero(trajectories.are("frame", frame) & np.isfinite(trajectories.numbers("x")))
    known = known[np.lexsort((stamp[known], track[known]))]
    ordered = track[known]
    for row in np.flatnonzero(tracks.are("set", "A")).tolist():
        at = known[slice(*np.searchsorted(ordered, [numbers[row], numbers[row] + 1]))]
        # One that several topics saw has rows at the sweeps of each, others have its number in their own topics.
        alike = of_track[(numbers == numbers[row]) & (tracks.source == tracks.source[row])]
        own = [topics.index(names[code]) for code in alike.tolist() if code >= 0 and names[code] in topics]
        its = names[of_track[row]] if of_track[row] >= 0 else ""
        here = topic[at] == topics.index(its) if its in topics else ~np.isin(topic[at], own)
        at = at[here & (trajectories.source[at] == tracks.source[row])]
        if len(at):
            yield row, int(numbers[row]), at, observed_steps(stamp[at] / SECOND_NS, seen[at], topic[at])


def _track_paths(trajectories: Rows, tracks: Rows, frame: str) -> Iterator[tuple[int, Float64]]:
    """Yield number and path of each agent in a frame, with NaN before a place to which no sweep saw it go."""
    longest = np.argsort(-np.where(tracks.are("set", "A"), tracks.integers("sweeps"), 0), kind="stable")
    kept = {*longest[:MAX_AGENTS].tolist()}
    xy = np.column_stack([trajectories.numbers("x"), trajectories.numbers("y")])
    for row, number, at, steps in _of_agents(trajectories, tracks, frame):
        if row in kept:
            some = _thinned(np.arange(len(at)))
            missed = np.diff(np.cumsum(~steps)[some], prepend=1) > 0
            yield number, np.insert(xy[at[some]], np.flatnonzero(missed), np.nan, axis=0)


def _dwell(trajectories: Rows, tracks: Rows, frame: str) -> Dwell | None:
    """Return how long agents were observed at each place in a frame; None where there are none."""
    places, times = [np.empty((0, 2))], [np.empty(0)]
    xy, stamp = np.column_stack([trajectories.numbers("x"), trajectories.numbers("y")]), trajectories.integers("stamp")
    for _, _, at, steps in _of_agents(trajectories, tracks, frame):
        # Each place lasts until the next one, if sweeps saw the agent go there.
        from_here = np.flatnonzero(steps) - 1
        places.append(xy[at[from_here]])
        times.append((stamp[at[from_here + 1]] - stamp[at[from_here]]) / SECOND_NS)
    found, pause = np.concatenate(places), np.concatenate(times)
    if not len(found):
        return None
    cells = np.floor(found / DWELL_CELL).astype(np.int64)
    low = cells.min(axis=0)
    wide, high = (cells.max(axis=0) - low + 1).tolist()
    if wide * high > MAX_PIXELS**2:
        raise OptionError(
            f"--density: the paths of the agents reach over {wide * DWELL_CELL:,.0f} x {high * DWELL_CELL:,.0f} m"
        )
    at = (cells - low) @ np.array([1, wide])
    seconds = np.bincount(at, pause, minlength=wide * high).astype(np.float64)
    x, y = (low * DWELL_CELL).tolist()
    return Dwell(x, y, seconds.reshape(high, wide))


def _thinned(rows: Int64) -> Int64:
    """Return at most `MAX_POINTS` rows, evenly spaced, the last one included."""
    if len(rows) <= MAX_POINTS:
        return rows
    return rows[np.linspace(0, len(rows) - 1, MAX_POINTS).astype(np.int64)]


@dataclass(frozen=True, slots=True)
class Backdrop:
    """Map on which the changes of a run are drawn."""

    grid: Occupancy | None = None
    """That of the runs before."""
    sensors: Float64 | None = None
    """(N, 2) places of the sensor of the run [m]."""


def draw_changes(pairs: Sequence[RunPair], sights: Sequence[Backdrop]) -> bytes:
    """Return a .png with a panel for each run, all in the coordinates of the first one."""
    with project_style({"axes.grid": False}):
        return file_bytes(changes_figure(pairs, sights), ".png")


def changes_figure(pairs: Sequence[RunPair], sights: Sequence[Backdrop]) -> Figure:
    """Return a figure with a panel for each run; call it within `project_style`."""
    runs = [_ChangedRun.of(pair, sight) for pair, sight in zip(pairs, sights, strict=True)]
    each = np.array([one.limits for one in runs])
    left, low = each[:, [0, 2]].min(axis=0).tolist()
    right, high = each[:, [1, 3]].max(axis=0).tolist()
    aspect = (right - left) / (high - low)
    # About as wide as high.
    columns = max(1, min(len(pairs), math.ceil(math.sqrt(len(pairs) / min(max(aspect, 0.25), 4.0)))))
    rows = -(-len(pairs) // columns)
    longest = min(PANEL, 24.0 / columns)
    width = max(longest * min(aspect, 1.0), 0.5 * longest) + Y_AXIS
    figure = new_figure(width * columns, (longest + 0.9) * rows)
    axes: list[Axes] = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    for spare in axes[len(pairs) :]:
        spare.remove()
    axes = axes[: len(pairs)]
    # Characters of a line above a panel.
    most = int(90 * width / (PANEL + Y_AXIS))
    for own, pair, one in zip(axes, pairs, runs, strict=True):
        _draw_grid(own, one.grid, CHANGE_GREYS)
        limits = (left, right, low, high)
        obstacles = np.concatenate([_occupied(one.grid), *(corners for corners, _ in one.polygons())])
        panel = Panel(_frame(limits), [*one.marks()], [*one.labels()], obstacles)
        draw_panel(own, panel)
        title = pair.title
        if len(title) > most:
            title = f"{title[: most // 2]}…{title[-(most - most // 2 - 1) :]}"
        own.set_title(f"{printable(title)}\n{printable(pair.words)}", loc="left")
    draw_legend(figure, _change_entries(runs), "outside lower left")
    fit_height(figure, axes, [0.0] * len(axes), aspect)
    return figure


@dataclass(frozen=True, slots=True)
class _ChangedRun:
    """Changes of a run with their boxes."""

    changes: tuple[tuple[Change, MapBox, MapBox | None], ...]
    """Each with its box, and its old one if it was moved."""
    sensors: Float64
    """(S, 2) places of the sensor [m]."""
    grid: Occupancy | None

    @staticmethod
    def of(pair: RunPair, sight: Backdrop) -> _ChangedRun:
        """Return the changes whose place is known."""
        grid = None if sight.grid is None else _known_part(sight.grid)
        found = [(one, *_boxes(one)) for one in pair.changes]
        sensors = np.empty((0, 2)) if sight.sensors is None else sight.sensors
        sensors = sensors[np.isfinite(sensors).all(axis=1)]
        return _ChangedRun(tuple((one, box, old) for one, box, old in found if box is not None), sensors, grid)

    @property
    def limits(self) -> Extent:
        """Extent of all that is drawn."""
        return limits_of(MapPicture(self.grid, [self.sensors]), [corners for corners, _ in self.polygons()])

    @property
    def stands(self) -> bool:
        """True if the sensor was stationary."""
        return len(self.sensors) > 0 and bool(np.ptp(self.sensors, axis=0).max() < 0.3)

    def sensor_style(self) -> dict[str, Any]:
        """Return the style of the path of the sensor, or of its place where it is stationary."""
        dot = {"marker": "o", "ms": 4.0, "mew": 0.0, "ls": "none"} if self.stands else {"lw": 1.0}
        return {"color": palette.BLACK, "zorder": 6, **dot}

    def polygons(self) -> Iterator[tuple[Float64, dict[str, Any]]]:
        """Yield the outline of each box, (5, 2) [m], with its style."""
        for one, box, old in self.changes:
            yield box.outline, STYLES[one.status]
            if old is not None:
                yield old.outline, {"ec": STYLES[one.status]["ec"], "fc": "none", "ls": (0, (3, 2))}

    def marks(self) -> Iterator[Mark]:
        """Yield the path of the sensor, and the boxes."""
        if len(self.sensors):
            yield Mark(self.sensors[_thinned(np.arange(len(self.sensors)))], self.sensor_style())
        for corners, style in self.polygons():
            yield Mark(joined([corners]), {"lw": 1.0, "zorder": 7, **style}, area=True)
        for _, box, old in self.changes:
            if old is not None:
                yield from arrow(old[:2], box[:2], palette.GREEN, lw=1.2, zorder=8)

    def labels(self) -> Iterator[Label]:
        """Yield numbers: on the far side of the place that an object comes from, else to the upper right."""
        for one, box, old in sorted(self.changes, key=lambda each: FIRST.index(each[0].status))[:MAX_NUMBERS]:
            away = (box.x - 1.0, box.y - 1.0) if old is None else old[:2]
            yield Label(str(one.thing), box.outline, STYLES[one.status]["ec"], away)


def _known_part(grid: Occupancy) -> Occupancy:
    """Return the part of a grid that was observed."""
    row, column = np.nonzero(grid.cells != UNKNOWN)
    if not len(row):
        return grid
    low, left = int(row.min()), int(column.min())
    cells = grid.cells[low : int(row.max()) + 1, left : int(column.max()) + 1]
    return replace(grid, x=grid.x + left * grid.resolution, y=grid.y + low * grid.resolution, cells=cells)


def _boxes(one: Change) -> tuple[MapBox | None, MapBox | None]:
    """Return the box of a change in the last run that has it, and that in its old place if it was moved."""
    length, width = (max(side or 0.1, 0.1) for side in (one.length, one.width))
    before, after = (
        None if x is None or y is None else MapBox(x, y, yaw or 0.0, length, width)
        for x, y, yaw in ((one.x_a, one.y_a, one.yaw_a), (one.x_b, one.y_b, one.yaw_b))
    )
    return after or before, before if one.status == "moved" and after is not None else None


def _change_entries(runs: Sequence[_ChangedRun]) -> Entries:
    """Return the entries of the legend: every status, and the map and the sensors where there are any."""
    found: Entries = {}
    if any(one.grid is not None for one in runs):
        occupied, free, unseen = map(str, CHANGE_GREYS)
        found["structure before"] = Patch(facecolor=occupied)
        found["free before"] = Patch(facecolor=free)
        found["unseen before"] = Patch(facecolor=unseen, edgecolor=palette.GREY, lw=0.5)
    found |= {status: Patch(lw=1.0, **style) for status, style in STYLES.items()}
    found["moved"] = Line2D([], [], color=palette.GREEN, marker=r"$\rightarrow$", ms=11.0, mew=0.3, ls="none")
    for one in runs:
        if len(one.sensors):
            found.setdefault("sensor of the later run", Line2D([], [], **one.sensor_style()))
    return found


def draw_backgrounds(sensors: Sequence[Background], suffix: str) -> bytes:
    """Return the picture of all sensors side by side as a file of the kind of `suffix`."""
    with project_style():
        return file_bytes(background_figure(sensors), suffix)


def background_figure(sensors: Sequence[Background]) -> Figure:
    """Return the picture of all sensors as a figure; call it within `project_style`."""
    figure = new_figure(SENSOR_WIDTH * max(len(sensors), 1), SENSOR_WIDTH * 0.95)
    axes = figure.subplots(1, max(len(sensors), 1), squeeze=False)[0].tolist()
    for own, one in zip(axes, sensors, strict=False):
        _draw_background(own, one)
    draw_legend(figure, entries_of(axes), "outside lower left")
    sides = [(np.ptp(each.get_xlim()), np.ptp(each.get_ylim())) for each in axes]
    fit_height(figure, axes, [0.0] * len(axes), float(min(width / height for width, height in sides)))
    return figure


def _draw_background(axes: Axes, one: Background) -> None:
    """Draw the surfaces of a background of one sensor, coloured by their support, and the places of the sensor."""
    posed = bool(one.posed.any())
    x0, y0, yaw = (part if posed else np.zeros(len(one)) for part in (one.poses.x, one.poses.y, one.poses.yaw))
    mirror = np.where(one.poses.upside_down, -1.0, 1.0)
    direction = yaw[:, None] + mirror[:, None] * one.grid.bearings
    surface = np.isfinite(one.r_e)
    ahead = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    ends = np.stack([x0, y0], axis=-1)[:, None] + np.where(surface, one.r_e, 0.0)[..., None] * ahead
    thin = slice(None, None, max(1, int(np.count_nonzero(surface)) // 200_000))
    support = one.support[surface][thin]
    x, y = ends[surface][thin].T
    drawn = axes.scatter(x, y, 3.0, support, cmap="viridis_r", linewidths=0, rasterized=True)
    _colour_bar(axes, drawn, "share of the sweeps that saw $r_e$").ax.yaxis.set_major_formatter(
        PercentFormatter(1.0, decimals=0)
    )
    marks = [sensor(float(x0[k]), float(y0[k]), float(yaw[k]), 4.0 if posed else 6.0) for k in range(len(one))]
    if not posed and len(one) and np.isinf(one.r_e[0]).any():
        # Short strokes outside of everything, in the directions from which nothing returns.
        reach = float(one.r_e[0].max(initial=0.0, where=surface[0])) or 1.0
        strokes = [line * (1.0 + 0.06 * np.array([[1.0], [2.0]])) * reach for line in ahead[0][np.isinf(one.r_e[0])]]
        marks.append(Mark(joined(strokes), {"color": palette.LIGHT, "lw": 0.6, "zorder": 0}, "open: nothing returns"))
    draw_marks(axes, marks)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    counts = f"{counted(len(one), 'station')}, {counted(int(one.sweeps.sum()), 'sweep')}"
    axes.set_title(f"{printable(one.topic)}  {printable(one.frame_id)}: {counts}")
