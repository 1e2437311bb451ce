"""Figures: marks and labels on axes, layout and legend, and the files of pictures and animations.

No display is needed; the same input gives the same bytes.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import matplotlib
import numpy as np
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from matplotlib.text import Text
from matplotlib.transforms import IdentityTransform
from numpy.typing import NDArray
from PIL import Image

from lidarcli.display import palette
from lidarcli.sweeps.types import Bool, Float64

HANDLE, GAP, BETWEEN, BORDER = 1.4, 0.5, 1.2, 0.4
"""Of a legend: length of a mark, gap after it, gap between columns, margin; each by the size of letters."""
RINGS = np.array([1.0, 3.0, 6.0, 10.0, 15.0, 21.0, 28.0, 38.0, 52.0])
TURNS = np.arange(24) * (2.0 * np.pi / 24)
"""Distances [pt] and directions [rad] from an object at which its label is tried."""
FEW = 24
"""Places of a label that are looked at first: those that cost least by themselves."""
NEAR = 6.0
"""Greatest distance of a label without a line to its object [pt]."""
PER_POINT, PER_OBJECT, PER_SIDE, PER_DISTANCE, PER_CROSSING, AMBIGUOUS = 0.8, 8.0, 1.2, 0.35, 6.0, 4.0
"""Costs: a drawn point under the label, an object under it, a side towards the sensor, each point [pt] of distance,
a line across another label or object, and a place that is nearer to another object."""
SIZE, AIR, MARK = 6.5, 0.8, 2.0
"""Size of the letters, margin around them, and room that a mark takes about its point [pt]."""
ROOM = 4
"""Pixels around a text that is drawn by itself."""
_PARTS = re.compile(r"\$[^$]*\$|\d|(?:\\\$|[^$\d])+")
"""Formulas, digits, and what is between them."""
Entries = dict[str, Any]
"""Entries of a legend: words → a mark."""
Pixels = NDArray[np.uint8]


class Mark(NamedTuple):
    """One artist of a panel: a line, points or polygons."""

    xy: Float64
    """(N, 2) in the coordinates of the axes; after a row of NaN another line or polygon begins."""
    style: dict[str, Any]
    """Properties of matplotlib: of a line, of points (with `marker`) or of an area."""
    name: str | None = None
    """Its words in the legend."""
    area: bool = False
    """True for polygons that are filled."""


@dataclass(frozen=True, slots=True)
class Frame:
    """Axes of a panel: all that is the same in most sweeps."""

    x: tuple[float, float]
    """Limits."""
    y: tuple[float, float]
    names: tuple[str, str]
    """Words at both axes."""
    x_ticks: tuple[float, ...] | None = None
    """Ticks; None: as matplotlib chooses them."""
    y_ticks: tuple[float, ...] | None = None
    linear: float = 0.0
    """Greatest y that is drawn in proportion, those beyond by their logarithm; 0: all are."""
    equal: bool = False
    """True if x and y have the same scale."""

    def set(self, axes: Axes) -> None:
        """Set limits, scales, ticks and words of axes."""
        if self.equal:
            axes.set_aspect("equal", adjustable="box", anchor="N")
        if self.linear:
            axes.set_yscale("symlog", linthresh=self.linear, linscale=0.7)
        else:
            axes.set_yscale("linear")
        axes.set(xlim=self.x, ylim=self.y, xlabel=self.names[0], ylabel=self.names[1])
        if self.x_ticks is not None:
            axes.set_xticks(self.x_ticks)
        if self.y_ticks is not None:
            axes.set_yticks(self.y_ticks, [f"{value:g}".replace("-", "\N{MINUS SIGN}") for value in self.y_ticks])
            axes.set_yticks([], minor=True)


class Label(NamedTuple):
    """A text and the object that it names."""

    text: str
    around: Float64
    """(N, 2) outline of the object in the coordinates of the axes; of a mark its one point."""
    colour: str = palette.BLACK
    away: tuple[float, float] = (0.0, 0.0)
    """Point on the far side of the object from the label."""


class Panel(NamedTuple):
    """Content of axes."""

    frame: Frame
    marks: Sequence[Mark]
    labels: Sequence[Label] = ()
    obstacles: Float64 = np.empty((0, 2))
    """(N, 2) what labels avoid besides the marks."""


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw a panel on axes."""
    panel.frame.set(axes)
    draw_content(axes, panel)


def draw_content(axes: Axes, panel: Panel, stamps: Stamps | None = None) -> None:
    """Draw marks and labels of a panel on axes that have its frame."""
    draw_marks(axes, panel.marks)
    if panel.labels:
        marks = [mark for mark in panel.marks if not mark.area]
        lines = [mark.xy for mark in marks if "marker" not in mark.style]
        points = [panel.obstacles, *(mark.xy for mark in marks if "marker" in mark.style)]
        axes.add_artist(Labels(panel.labels, lines, np.concatenate(points), stamps))


def draw_marks(axes: Axes, marks: Iterable[Mark]) -> None:
    """Draw marks on axes."""
    for mark in marks:
        # Limits are given, and a layout need not look at each of thousands.
        axes.add_artist(artist_of(mark)).set_in_layout(False)


def artist_of(mark: Mark) -> PathPatch | Line2D:
    """Return the artist of a mark."""
    if mark.area:
        return PathPatch(_outline(mark.xy), label=mark.name, **mark.style)
    shape = {"ls": "none", "mew": 0.0} if "marker" in mark.style else {"solid_capstyle": "butt"}
    return Line2D(*mark.xy.T, label=mark.name, **{**shape, **mark.style})


def _outline(xy: Float64) -> Outline:
    """Return the path of polygons that are separated by NaN."""
    gaps = np.isnan(xy[:, 0])
    codes = np.full(len(xy), Outline.LINETO, np.uint8)
    codes[0] = Outline.MOVETO
    codes[1:][gaps[:-1]] = Outline.MOVETO
    codes[gaps] = Outline.CLOSEPOLY
    return Outline(np.nan_to_num(xy), codes)


def joined(lines: Iterable[Float64]) -> Float64:
    """Return lines or polygons, (N, 2) each, as one that breaks between them: it is drawn much faster."""
    gap = np.full((1, 2), np.nan)
    return np.concatenate([np.empty((0, 2)), *(part for line in lines for part in (line, gap))])


def arrow(tail: Sequence[float], head: Sequence[float], colour: str, **line: Any) -> tuple[Mark, Mark]:
    """Return an arrow between two points of axes with equal scales: its line and its head."""
    ends = np.array([tail, head], np.float64)
    turn = float(np.degrees(np.arctan2(*(ends[1] - ends[0])[::-1])))
    point = {"marker": (3, 0, turn - 90.0), "ms": 5.0, "color": colour, "zorder": line["zorder"]}
    return Mark(ends, {"color": colour, **line}), Mark(ends[1:], point)


def sensor(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, size: float = 6.0) -> Mark:
    """Return the sensor as a triangle that points along its x axis [m, rad]."""
    shape = (3, 0, float(np.degrees(yaw)) - 90.0)
    return Mark(np.array([[x, y]]), {"marker": shape, "color": palette.BLACK, "ms": size, "zorder": 8}, "sensor")


class Stamps:
    """Texts of an animation: each is drawn once, and its pixels are used again."""

    def __init__(self) -> None:
        self._sizes: dict[Hashable, Float64] = {}
        self._pixels: dict[Hashable, tuple[NDArray[np.int64], Pixels]] = {}

    def size(self, key: Hashable, text: Callable[[], Text], renderer: Any) -> Float64:
        """Return width and height of the text of a key [pixel]."""
        if key not in self._sizes:
            self._sizes[key] = np.array(text().get_window_extent(renderer).size)
        return self._sizes[key]

    def draw(self, key: Hashable, text: Callable[[], Text], at: Sequence[float], renderer: Any) -> None:
        """Draw the text of a key, to the quarter of a pixel in x and the whole pixel in y."""
        (x, part), y = divmod(int(4.0 * at[0]), 4), round(at[1])
        if (key, part) not in self._pixels:
            drawn, shift = text(), np.array([0.25 * part, 0.0])
            drawn.set_position(tuple(shift))
            box = np.array(drawn.get_window_extent(renderer).get_points())
            corner = np.floor(box[0]).astype(np.int64) - ROOM
            small: Any = RendererAgg(*np.ceil(box[1] - corner + ROOM).tolist(), renderer.dpi)  # type: ignore[call-arg, no-untyped-call]
            drawn.set_position(tuple(shift - corner))
            drawn.draw(small)
            # An image begins with its lowest row.
            self._pixels[key, part] = corner, np.asarray(small.buffer_rgba(), np.uint8)[::-1].copy()
        corner, pixels = self._pixels[key, part]
        renderer.draw_image(renderer.new_gc(), x + int(corner[0]), y + int(corner[1]), pixels)


class Labels(Artist):
    """All labels of one panel, and the lines and points that they avoid, (N, 2) each; `stamps` are those of others."""

    def __init__(
        self, labels: Sequence[Label], lines: Sequence[Float64], points: Float64, stamps: Stamps | None = None
    ) -> None:
        super().__init__()
        self.labels, self._lines, self._points, self._stamps = tuple(labels), lines, points, stamps
        self.places: Float64 = np.empty((0, 4))
        """(K, 4) left, low, right and high edges [pixel] when drawn last, of labels whose objects are in view."""
        self.set_in_layout(False)
        self.set_zorder(10)

    def draw(self, renderer: Any) -> None:
        """Place the labels, and draw them with lines to their objects."""
        axes: Any = self.axes
        unit, to_pixels = renderer.points_to_pixels(1.0), axes.transData.transform
        view = np.array(axes.get_window_extent(renderer).extents)
        stamps = self._stamps or Stamps()
        shown, sizes, objects, sides = [], [], [], []
        for label in self.labels:
            around = to_pixels(label.around)
            room = MARK * unit if len(around) == 1 else 0.0
            box = np.concatenate([around.min(axis=0) - room, around.max(axis=0) + room])
            if _touch(box[None], view[None])[0, 0]:
                side = around.mean(axis=0) - to_pixels(label.away)
                shown.append(((label.text, label.colour), partial(self._text, label)))
                sizes.append(stamps.size(*shown[-1], renderer) + 2.0 * AIR * unit)
                objects.append(box)
                sides.append(side / (np.hypot(*side) or 1.0))
        drawn = np.concatenate([to_pixels(self._points), *(_sampled(to_pixels(line), 2.0 * unit) for line in self._lines)])
        self.places = place_labels(sizes, objects, sides, drawn, view + AIR * unit * np.array([1, 1, -1, -1]), unit)
        for k, (((_, colour), _), place) in enumerate(zip(shown, self.places, strict=True)):
            if (ends := line_to(place, k, np.array(objects), unit)) is not None:
                line = Line2D(*ends.T, color=colour, lw=0.5, transform=IdentityTransform(), figure=axes.figure)
                line.draw(renderer)
        for (key, text), place in zip(shown, self.places, strict=True):
            middle = place.reshape(2, 2).mean(axis=0)
            if self._stamps is not None:
                stamps.draw(key, text, middle, renderer)
            else:
                (own := text()).set_position(middle)
                own.draw(renderer)

    def _text(self, label: Label) -> Text:
        text = Text(0, 0, label.text, color=label.colour, fontsize=SIZE, fontweight="bold", ha="center")
        # Not an outline: letters with one are no text in an SVG.
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.4})
        text.set(va="center_baseline", transform=IdentityTransform(), figure=self.figure)
        return text


def place_labels(
    sizes: Sequence[Float64],
    objects: Sequence[Float64],
    sides: Sequence[Float64],
    drawn: Float64,
    view: Float64,
    unit: float,
) -> Float64:
    """Return (K, 4) places, for one label after the other the cheapest; none overlap while there is room.

    Parameters
    ----------
    sizes : (2,) width and height of each label [pixel]
    objects : (4,) left, low, right and high edge of the object of each label [pixel]
    sides : (2,) unit vector from each object to the best side for its label
    drawn : (N, 2) points that labels avoid [pixel]
    view : (4,) edges within which labels are placed [pixel]
    unit : pixels of a typographic point
    """
    places, boxes = np.full((len(sizes), 4), np.inf), np.reshape(objects, (-1, 4))
    directions = np.column_stack([np.cos(TURNS), np.sin(TURNS)])
    # On a rectangle around the object, so that the label never covers what it names.
    edge, rings = directions / np.abs(directions).max(axis=1, keepdims=True), RINGS[:, None, None] * unit
    (left, low, right, high), far = view, np.inf
    around = [[-far, -far, left, far], [right, -far, far, far], [-far, -far, far, low], [-far, high, far, far]]
    # Those with the most neighbours come first.
    for k in np.argsort(-(_gaps(boxes, boxes) < RINGS[-1] * unit).sum(axis=1), kind="stable").tolist():
        own, others, half = boxes[k], np.delete(boxes, k, axis=0), 0.5 * sizes[k]
        middle = 0.5 * (own[:2] + own[2:])
        centres = (middle + edge * (own[2:] - middle + half + rings)).reshape(-1, 2)
        tried = np.hstack([centres - half, centres + half])
        least = (PER_DISTANCE * RINGS[:, None] + PER_SIDE * (1.0 - directions @ sides[k])).ravel()
        least[_touch(tried, np.vstack([around, places])).any(axis=1)] = np.inf
        costs, order = np.full(len(tried), np.inf), np.argsort(least)
        for part in (order[:FEW], order[FEW:]):
            # What cannot become cheaper than the best one needs no closer look.
            part = part[least[part] <= costs.min()]
            if not len(part):
                continue
            boxes_there, cost = tried[part], least[part]
            gaps = _gaps(boxes_there, others)
            line = np.linspace(centres[part], np.broadcast_to(middle, (len(part), 2)), 12)
            near = drawn[_inside(drawn, np.hstack([boxes_there.min(axis=0)[:2], boxes_there.max(axis=0)[2:]])[None])[:, 0]]
            cost += PER_POINT * _inside(near, boxes_there).sum(axis=0) + PER_OBJECT * (gaps == 0.0).sum(axis=1)
            cost += AMBIGUOUS * (gaps < _gaps(boxes_there, own[None])).any(axis=1)
            cost += PER_CROSSING * _inside(line, np.vstack([others, places])).any(axis=0).sum(axis=1)
            costs[part] = cost
        if not np.isfinite(costs).any():
            # The nearest free place of the whole panel.
            x, y = (np.arange(view[i] + half[i], view[i + 2] - half[i] + 1e-9, max(sizes[k][i], unit)) for i in (0, 1))
            centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) if len(x) and len(y) else centres
            tried = np.hstack([centres - half, centres + half])
            costs = np.hypot(*(centres - middle).T)
            costs[_touch(tried, places).any(axis=1)] = np.inf
        places[k] = tried[int(np.argmin(costs))]
    return places


def line_to(place: Float64, k: int, objects: Float64, unit: float) -> Float64 | None:
    """Return (2, 2) ends of the line from a label to object k; None where it is close to that alone."""
    end = np.clip(0.5 * (place[:2] + place[2:]), objects[k, :2], objects[k, 2:])
    start = np.clip(end, place[:2], place[2:])
    long = float(np.hypot(*(end - start)))
    crowded = (_gaps(place[None], np.delete(objects, k, axis=0)) < 1.3 * long).any()
    return None if long <= (0.5 * NEAR if crowded else NEAR) * unit else np.array([start, end])


def _gaps(boxes: Float64, others: Float64) -> Float64:
    """Return (C, R) distances between rectangles; 0 where they overlap or touch."""
    (left, low, right, high), there = boxes.T[:, :, None], others.T
    apart = np.maximum(there[0] - right, left - there[2]), np.maximum(there[1] - high, low - there[3])
    return np.asarray(np.hypot(*(np.maximum(each, 0.0) for each in apart)), np.float64)


def _touch(boxes: Float64, others: Float64) -> Bool:
    """Return (C, R) True where rectangles overlap or touch."""
    (left, low, right, high), there = boxes.T[:, :, None], others.T
    return np.asarray((there[0] <= right) & (left <= there[2]) & (there[1] <= high) & (low <= there[3]), np.bool_)


def _inside(points: Float64, boxes: Float64) -> Bool:
    """Return (..., R) True where a point of (..., 2) lies in a rectangle."""
    x, y = points[..., :1], points[..., 1:]
    left, low, right, high = boxes.T
    return np.asarray((x > left) & (x < right) & (y > low) & (y < high), np.bool_)


def _sampled(line: Float64, step: float) -> Float64:
    """Return (M, 2) points along a line, `step` apart or more."""
    along = np.concatenate([[0.0], np.cumsum(np.nan_to_num(np.hypot(*np.diff(line, axis=0).T)))])
    at = np.linspace(0.0, along[-1], int(min(along[-1] / step + 2, 200)))
    return np.column_stack([np.interp(at, along, line[:, k]) for k in (0, 1)])


@contextmanager
def project_style(other: dict[str, Any] | None = None) -> Iterator[None]:
    """Set the project's style alone, whatever the user's own settings; `other` comes on top."""
    with style.context(["default", palette.STYLE, other or {}]), warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes; that is no news for the user.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        matplotlib.rcParams["axes.unicode_minus"] = True
        yield


class _Canvas(FigureCanvasAgg):
    """A canvas that parses formulas once, not again for each figure and each size of it."""

    parser: Any = None

    def get_renderer(self) -> Any:
        renderer: Any = super().get_renderer()  # type: ignore[no-untyped-call]
        _Canvas.parser = renderer.mathtext_parser = _Canvas.parser or renderer.mathtext_parser
        return renderer


class _Shown(Figure):
    """A figure without a window, which a notebook shows once."""

    def _repr_png_(self) -> bytes:
        out = io.BytesIO()
        with project_style():
            self.savefig(out, format="png")
        return out.getvalue()


def new_figure(width: float, height: float = 4.0, kind: type[Figure] = _Shown) -> Figure:
    """Return an empty figure of this size [inch] without a window."""
    figure = kind(figsize=(width, height), layout="constrained")
    _Canvas(figure)
    return figure


def fit_height(figure: Figure, axes: Sequence[Axes], heights: Sequence[float], aspect: float) -> None:
    """Make the figure so high that every panel has its place and no more; its width stays.

    Parameters
    ----------
    heights : what each panel wants [inch]; 0: what its width makes of the aspect, in as many rows as it has
    aspect : how many times as wide as high is what those without a height show
    """
    layout = figure.get_layout_engine()
    assert layout is not None  # all figures here are made with one
    # Drawn smaller than its place, a scene would seem to need less room around it.
    scenes = [(one, one.get_aspect()) for one, wanted in zip(axes, heights, strict=True) if not wanted]
    for one, _ in scenes:
        one.set_aspect("auto")
    grids = [grid for one in axes if (grid := one.get_subplotspec()) is not None]
    have, more = np.zeros((2, grids[0].get_gridspec().nrows))
    # What is drawn outside of the axes may take more room once these are larger.
    for _ in range(5):
        layout.execute(figure)
        width, height = figure.get_size_inches()
        have[:], more[:] = 0.0, -np.inf
        for one, grid, wanted in zip(axes, grids, heights, strict=True):
            box, rows = one.get_position(original=True), list(grid.rowspan)
            lacks = (wanted or min(1.0 / aspect, 2.2) * box.width * width) - box.height * height
            more[rows] = np.maximum(more[rows], lacks / len(rows))
            if len(rows) == 1:
                have[rows] = np.maximum(have[rows], box.height * height)
        if np.abs(more).max() < 0.02:
            break
        grids[0].get_gridspec().set_height_ratios((have + more).tolist())
        figure.set_size_inches(width, height + more.sum())
    else:
        layout.execute(figure)
    for one, kept in scenes:
        one.set_aspect(kept)
        one.apply_aspect()


def draw_title(figure: Figure, lines: Iterable[str]) -> Text:
    """Write a title above all panels; lines that are too long break at commas."""
    width = figure.get_size_inches()[0]
    title = figure.suptitle("", x=0.01, ha="left", fontsize=8 if width > 4.5 else 7)

    def width_of(line: str) -> float:
        title.set_text(line)
        return float(title.get_window_extent().width)

    title.set_text("\n".join(_broken(lines, width_of, 0.98 * figure.bbox.width)))
    return title


def draw_title_again(title: Text, lines: Iterable[str], stamps: Stamps, renderer: Any) -> None:
    """Draw other lines in the place of a title, put together of single digits and what is between them."""

    def text(words: str, row: int) -> Text:
        look: Any = {"font": title.get_fontproperties(), "transform": IdentityTransform(), "figure": title.figure}
        return Text(0, 0, "\n" * row + words, va="top", **look)

    def part(words: str, row: int = 0) -> tuple[tuple[str, int], Callable[[], Text]]:
        return (words, row), partial(text, words, row)

    def width_of(line: str) -> float:
        return sum(float(stamps.size(*part(words), renderer)[0]) for words in _PARTS.findall(line))

    left, y = title.get_transform().transform(title.get_position())
    for row, line in enumerate(_broken(lines, width_of, 0.98 * renderer.width)):
        x = left
        for words in _PARTS.findall(line):
            stamps.draw(*part(words, row), (x, y), renderer)
            x += width_of(words)


def _broken(lines: Iterable[str], width_of: Callable[[str], float], most: float) -> list[str]:
    """Return lines broken at commas where they are wider."""
    broken: list[str] = []
    for line in lines:
        broken.append("")
        for part in [line] if width_of(line) <= most else line.split(", "):
            longer = f"{broken[-1]}, {part}" if broken[-1] else part
            if broken[-1] and width_of(longer) > most:
                broken[-1] += ","
                longer = part
                broken.append("")
            broken[-1] = longer
    return broken


def entries_of(drawn: Iterable[Axes]) -> Entries:
    """Return the entries of a legend of all panels, each once."""
    entries: Entries = {}
    for axes in drawn:
        for handle, words in zip(*axes.get_legend_handles_labels(), strict=True):
            entries.setdefault(words, handle)
    return entries


def draw_legend(figure: Figure, entries: Entries, place: str) -> None:
    """Draw a legend in as many columns as there is room for."""
    if not entries:
        return
    legend = _add_legend(figure, entries, place, 1)
    texts = legend.get_texts()
    unit = float(texts[0].get_fontsize()) * figure.dpi / 72.0
    widths = np.array([text.get_window_extent().width for text in texts]) / unit + HANDLE + GAP
    room = 0.99 * figure.bbox.width / unit - 2.0 * BORDER
    for count in range(min(len(entries), 8), 1, -1):
        columns = np.array_split(widths, count)
        if sum(column.max() for column in columns) + (count - 1) * BETWEEN <= room:
            legend.remove()
            _add_legend(figure, entries, place, count)
            break


def _add_legend(figure: Figure, entries: Entries, place: Any, columns: int) -> Legend:
    legend = figure.legend(
        [*entries.values()],
        [*entries],
        loc=place,
        ncols=columns,
        frameon=False,
        handlelength=HANDLE,
        handletextpad=GAP,
        columnspacing=BETWEEN,
        borderpad=BORDER,
        borderaxespad=0.2,
    )
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D):
            handle.set_markersize(max(handle.get_markersize(), 2.8))
    return legend


def file_bytes(figure: Figure, suffix: str, dpi: int | None = None) -> bytes:
    """Return a figure as a file of the kind of `suffix` (.png, .svg, .pdf), without a date and with text as text."""
    out = io.BytesIO()
    # It would lay everything out again.
    figure.set_layout_engine(None)
    if suffix == ".png":
        figure.set_dpi(dpi or figure.dpi)
        # Compressed in half the time of the usual level, to 3 % more bytes.
        Image.fromarray(pixels_of(figure)).save(out, "PNG", compress_level=3, dpi=(figure.dpi, figure.dpi))
    else:
        date = {"Date" if suffix == ".svg" else "CreationDate": None}
        with matplotlib.rc_context({"svg.fonttype": "none"}):
            figure.savefig(out, format=suffix[1:], dpi=dpi or "figure", metadata=date)
    return out.getvalue()


def pixels_of(figure: Figure) -> Pixels:
    """Return (H, W, 3) the pixels of a figure."""
    cast("FigureCanvasAgg", figure.canvas).draw()  # type: ignore[no-untyped-call]
    return shown_on(figure)[..., :3].copy()


def shown_on(figure: Figure) -> Pixels:
    """Return (H, W, 4) the pixels of the canvas of a figure, which change with it."""
    canvas = cast("FigureCanvasAgg", figure.canvas)
    return np.asarray(canvas.buffer_rgba(), np.uint8)  # type: ignore[no-untyped-call]


def write_gif(path: Path, frames: Iterable[Pixels], fps: float) -> None:
    """Write frames (H, W, 4) that go round for ever; their colours become the nearest shade of a colour of the palette."""
    # Six shades of each colour towards white: the edges of lines and letters.
    named = np.array([[*bytes.fromhex(colour[1:])] for colour in palette.ALL], np.float64)
    share = np.linspace(1.0, 0.0, 7)[:, None, None]
    shades = np.unique((named * share + 255.0 * (1.0 - share)).round().astype(np.int64).reshape(-1, 3), axis=0)
    # Place + 1 of the nearest shade of each colour; 0 where it is yet to be found.
    nearest = np.zeros(1 << 24, np.uint8)
    first, *rest = (_indexed(pixels, shades, nearest) for pixels in frames)
    duration = round(1000.0 / fps)
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=duration, loop=0, optimize=False)


def _indexed(pixels: Pixels, shades: NDArray[np.int64], nearest: Pixels) -> Image.Image:
    """Return a frame with the nearest of (N, 3) shades, which Pillow finds by and large alone."""
    # Blue, green, red.
    packed = pixels.view("<u4")[..., 0] & 0xFFFFFF
    places = nearest[packed]
    if not places.all():
        new = np.unique(packed[places == 0])
        colours = np.stack([new & 255, new >> 8 & 255, new >> 16], axis=1)
        nearest[new] = ((colours[:, None] - shades) ** 2).sum(axis=2).argmin(axis=1) + 1
        places = nearest[packed]
    image = Image.fromarray(places - 1)
    # From grey levels to places in the table.
    image.putpalette(shades.astype(np.uint8).ravel().tolist())
    return image
