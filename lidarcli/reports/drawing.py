"""Figures: marks and labels on axes, layout and legend, and the files of pictures and animations.

No display is needed; the same input gives the same bytes.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

import matplotlib
import numpy as np
from matplotlib import style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
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
NEAR = 6.0
"""Greatest distance of a label without a line to its object [pt]."""
PER_POINT, PER_OBJECT, PER_SIDE, PER_DISTANCE, PER_CROSSING, AMBIGUOUS = 0.8, 8.0, 1.2, 0.35, 6.0, 4.0
"""Costs: a drawn point under the label, an object under it, a side towards the sensor, each point [pt] of distance,
a line across another label or object, and a place that is nearer to another object."""
SIZE, AIR, MARK = 6.5, 0.8, 2.0
"""Size of the letters, margin around them, and room that a mark takes about its point [pt]."""
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
    draw_marks(axes, panel.marks)
    if panel.labels:
        drawn = [mark for mark in panel.marks if not mark.area]
        lines = [mark.xy for mark in drawn if "marker" not in mark.style]
        points = [panel.obstacles, *(mark.xy for mark in drawn if "marker" in mark.style)]
        axes.add_artist(Labels(panel.labels, lines, np.concatenate(points)))


def draw_marks(axes: Axes, marks: Iterable[Mark]) -> None:
    """Draw marks on axes."""
    for mark in marks:
        if mark.area:
            axes.add_artist(PathPatch(_outline(mark.xy), label=mark.name, **mark.style)).set_in_layout(False)
        else:
            shape = {"ls": "none", "mew": 0.0} if "marker" in mark.style else {"solid_capstyle": "butt"}
            (line,) = axes.plot(*mark.xy.T, label=mark.name, **{**shape, **mark.style})
            # Limits are given, and a layout need not look at each of thousands.
            line.set_in_layout(False)


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


class Labels(Artist):
    """All labels of one panel, and the lines and points that they avoid, (N, 2) each."""

    def __init__(self, labels: Sequence[Label], lines: Sequence[Float64], points: Float64) -> None:
        super().__init__()
        self.labels, self._lines, self._points = tuple(labels), lines, points
        self.places: Float64 = np.empty((0, 4))
        """(K, 4) left, low, right and high edges [pixel] when drawn last, of labels whose objects are in view."""
        self.set_in_layout(False)
        self.set_zorder(10)

    def draw(self, renderer: Any) -> None:
        """Place the labels, and draw them with lines to their objects."""
        axes: Any = self.axes
        unit, to_pixels = renderer.points_to_pixels(1.0), axes.transData.transform
        view = np.array(axes.get_window_extent(renderer).extents)
        texts, sizes, objects, sides = [], [], [], []
        for label in self.labels:
            around = to_pixels(label.around)
            room = MARK * unit if len(around) == 1 else 0.0
            box = np.concatenate([around.min(axis=0) - room, around.max(axis=0) + room])
            if _gaps(box[None], view[None])[0, 0] == 0.0:
                text = Text(0, 0, label.text, color=label.colour, fontsize=SIZE, fontweight="bold", ha="center")
                # Not an outline: letters with one are no text in an SVG.
                text.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.4})
                text.set(va="center_baseline", transform=IdentityTransform(), figure=axes.figure)
                side = around.mean(axis=0) - to_pixels(label.away)
                texts.append(text)
                sizes.append(text.get_window_extent(renderer).size + 2.0 * AIR * unit)
                objects.append(box)
                sides.append(side / (np.hypot(*side) or 1.0))
        drawn = np.concatenate([to_pixels(self._points), *(_sampled(to_pixels(line), 2.0 * unit) for line in self._lines)])
        self.places = place_labels(sizes, objects, sides, drawn, view + AIR * unit * np.array([1, 1, -1, -1]), unit)
        for k, (text, place) in enumerate(zip(texts, self.places, strict=True)):
            if (ends := line_to(place, k, np.array(objects), unit)) is not None:
                line = Line2D(*ends.T, color=text.get_color(), lw=0.5, transform=IdentityTransform(), figure=axes.figure)
                line.draw(renderer)
            text.set_position(place.reshape(2, 2).mean(axis=0))
        for text in texts:
            text.draw(renderer)


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
        gaps, line = _gaps(tried, others), np.linspace(centres, np.broadcast_to(middle, centres.shape), 12)
        near = drawn[_inside(drawn[None], np.hstack([tried.min(axis=0)[:2], tried.max(axis=0)[2:]])[None])[0, :, 0]]
        costs = (PER_DISTANCE * RINGS[:, None] + PER_SIDE * (1.0 - directions @ sides[k])).ravel()
        costs += PER_POINT * _inside(near[None], tried)[0].sum(axis=0) + PER_OBJECT * (gaps == 0.0).sum(axis=1)
        costs += AMBIGUOUS * (gaps < _gaps(tried, own[None])).any(axis=1)
        costs += PER_CROSSING * _inside(line, np.vstack([others, places])).any(axis=0).sum(axis=1)
        costs[(_gaps(tried, np.vstack([around, places])) == 0.0).any(axis=1)] = np.inf
        if not np.isfinite(costs).any():
            # The nearest free place of the whole panel.
            x, y = (np.arange(view[i] + half[i], view[i + 2] - half[i] + 1e-9, max(sizes[k][i], unit)) for i in (0, 1))
            centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) if len(x) and len(y) else centres
            tried = np.hstack([centres - half, centres + half])
            costs = np.hypot(*(centres - middle).T)
            costs[(_gaps(tried, places) == 0.0).any(axis=1)] = np.inf
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
    apart = np.maximum(others[None, :, :2] - boxes[:, None, 2:], boxes[:, None, :2] - others[None, :, 2:])
    return np.asarray(np.hypot(*np.moveaxis(np.maximum(apart, 0.0), 2, 0)), np.float64)


def _inside(points: Float64, boxes: Float64) -> Bool:
    """Return (S, N, R) True where a point of (S, N, 2) lies in a rectangle."""
    points = points[:, :, None]
    return np.asarray(((points > boxes[:, :2]) & (points < boxes[:, 2:])).all(axis=3), np.bool_)


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


def new_figure(width: float, height: float = 4.0, kind: type[Figure] = Figure) -> Figure:
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


def draw_title(figure: Figure, lines: Iterable[str]) -> None:
    """Write a title above all panels; lines that are too long break at commas."""
    width = figure.get_size_inches()[0]
    title = figure.suptitle("", x=0.01, ha="left", fontsize=8 if width > 4.5 else 7)
    broken: list[str] = []
    for line in lines:
        broken.append("")
        for part in line.split(", "):
            longer = f"{broken[-1]}, {part}" if broken[-1] else part
            title.set_text(longer)
            if broken[-1] and title.get_window_extent().width > 0.98 * figure.bbox.width:
                broken[-1] += ","
                longer = part
                broken.append("")
            broken[-1] = longer
    title.set_text("\n".join(broken))


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
    canvas = cast("FigureCanvasAgg", figure.canvas)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba(), np.uint8)[..., :3].copy()  # type: ignore[no-untyped-call]


def write_gif(path: Path, frames: Iterable[Pixels], fps: float) -> None:
    """Write frames (H, W, 3) that go round for ever; their colours become the nearest shade of a colour of the palette."""
    # Six shades of each colour towards white: the edges of lines and letters.
    named = np.array([[*bytes.fromhex(colour[1:])] for colour in palette.ALL], np.float64)
    share = np.linspace(1.0, 0.0, 7)[:, None, None]
    shades = np.unique((named * share + 255.0 * (1.0 - share)).round().astype(np.int64).reshape(-1, 3), axis=0)
    first, *rest = (_indexed(pixels, shades) for pixels in frames)
    duration = round(1000.0 / fps)
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=duration, loop=0, optimize=False)


def _indexed(pixels: Pixels, shades: NDArray[np.int64]) -> Image.Image:
    """Return a frame with the nearest of (N, 3) shades, which Pillow finds by and large alone."""
    packed, places = np.unique(pixels.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1]), return_inverse=True)
    colours = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1)
    nearest = ((colours[:, None] - shades) ** 2).sum(axis=2).argmin(axis=1).astype(np.uint8)
    image = Image.fromarray(nearest[places].reshape(pixels.shape[:2]))
    # From grey levels to places in the table.
    image.putpalette(shades.astype(np.uint8).ravel().tolist())
    return image
