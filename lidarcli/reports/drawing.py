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
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from numpy.typing import NDArray
from PIL import Image

from lidarcli import palette
from lidarcli.reports.labels import Label, Labels
from lidarcli.sweeps import Float64

ROUNDS = 5
"""Most times that a figure is laid out to find its height."""
ENOUGH = 0.02
"""Greatest error of the height of a row [inch]."""
TALLEST = 2.2
"""Greatest height of a scene by the width of its place."""
MOST_COLUMNS = 8
"""Most columns of a legend."""
HANDLE, GAP, BETWEEN, BORDER = 1.4, 0.5, 1.2, 0.4
"""Of a legend: length of a mark, gap after it, gap between columns, margin; each by the size of letters."""
LEGEND_DOT = 2.8
"""Least diameter of a dot in the legend [pt]."""
DECADES = 0.7
"""Height of the part of a logarithmic axis that is in proportion [decades]."""
HEAD = 5.0
"""Size of the head of an arrow [pt]."""
SHADES = 6
"""Number of shades of each colour of a GIF towards white: the edges of lines and letters."""
Entries = dict[str, Any]
"""Entries of a legend: words → a mark."""
Pixels = NDArray[np.uint8]


class Mark(NamedTuple):
    """One artist of a panel: a line, points, polygons or a text."""

    xy: Float64
    """(N, 2) in the coordinates of the axes; after a row of NaN another line or polygon begins."""
    style: dict[str, Any]
    """Properties of matplotlib: of a line or of points (with `marker`), of an area, or of a text."""
    name: str | None = None
    """Its words in the legend."""
    area: bool = False
    """True for polygons that are filled."""
    text: str = ""
    """Text at the first point."""


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
            axes.set_yscale("symlog", linthresh=self.linear, linscale=DECADES)
        else:
            axes.set_yscale("linear")
        axes.set(xlim=self.x, ylim=self.y, xlabel=self.names[0], ylabel=self.names[1])
        if self.x_ticks is not None:
            axes.set_xticks(self.x_ticks)
        if self.y_ticks is not None:
            axes.set_yticks(self.y_ticks, [f"{value:g}".replace("-", "\N{MINUS SIGN}") for value in self.y_ticks])
            axes.set_yticks([], minor=True)


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
        drawn = [mark for mark in panel.marks if not (mark.area or mark.text)]
        lines = [mark.xy for mark in drawn if "marker" not in mark.style]
        points = [panel.obstacles, *(mark.xy for mark in drawn if "marker" in mark.style)]
        axes.add_artist(Labels(panel.labels, lines, np.concatenate(points)))


def draw_marks(axes: Axes, marks: Iterable[Mark]) -> None:
    """Draw marks on axes."""
    for mark in marks:
        if mark.text:
            axes.text(float(mark.xy[0, 0]), float(mark.xy[0, 1]), mark.text, **mark.style)
        elif mark.area:
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
    point = {"marker": (3, 0, turn - 90.0), "ms": HEAD, "color": colour, "zorder": line["zorder"]}
    return Mark(ends, {"color": colour, **line}), Mark(ends[1:], point)


def sensor(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, size: float = 6.0) -> Mark:
    """Return the sensor as a triangle that points along its x axis [m, rad]."""
    shape = (3, 0, float(np.degrees(yaw)) - 90.0)
    return Mark(np.array([[x, y]]), {"marker": shape, "color": palette.BLACK, "ms": size, "zorder": 8}, "sensor")


@contextmanager
def project_style(other: dict[str, Any] | None = None) -> Iterator[None]:
    """Set the project's style alone, whatever the user's own settings; `other` comes on top."""
    with style.context(["default", palette.STYLE, other or {}]), warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes; that is no news for the user.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        matplotlib.rcParams["axes.unicode_minus"] = True
        yield


def new_figure(width: float, height: float = 4.0, kind: type[Figure] = Figure) -> Figure:
    """Return an empty figure of this size [inch] without a window."""
    figure = kind(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
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
    for _ in range(ROUNDS):
        layout.execute(figure)
        width, height = figure.get_size_inches()
        have[:], more[:] = 0.0, -np.inf
        for one, grid, wanted in zip(axes, grids, heights, strict=True):
            box, rows = one.get_position(original=True), list(grid.rowspan)
            lacks = (wanted or min(1.0 / aspect, TALLEST) * box.width * width) - box.height * height
            more[rows] = np.maximum(more[rows], lacks / len(rows))
            if len(rows) == 1:
                have[rows] = np.maximum(have[rows], box.height * height)
        if np.abs(more).max() < ENOUGH:
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
    for count in range(min(len(entries), MOST_COLUMNS), 1, -1):
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
            handle.set_markersize(max(handle.get_markersize(), LEGEND_DOT))
    return legend


def file_bytes(figure: Figure, suffix: str, dpi: int | None = None) -> bytes:
    """Return a figure as a file of the kind of `suffix` (.png, .svg, .pdf), without a date and with text as text."""
    out = io.BytesIO()
    # It would lay everything out again.
    figure.set_layout_engine(None)
    dates: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        figure.savefig(out, format=suffix[1:], dpi=dpi or "figure", metadata=dates.get(suffix))
    return out.getvalue()


def pixels_of(figure: Figure) -> Pixels:
    """Return (H, W, 3) the pixels of a figure."""
    canvas = cast("FigureCanvasAgg", figure.canvas)
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba(), np.uint8)[..., :3].copy()  # type: ignore[no-untyped-call]


def write_gif(path: Path, frames: Iterable[Pixels], fps: float) -> None:
    """Write frames (H, W, 3) that go round for ever; their colours become the nearest shade of a colour of the palette."""
    named = np.array([[*bytes.fromhex(colour[1:])] for colour in palette.ALL], np.float64)
    share = np.linspace(1.0, 0.0, SHADES + 1)[:, None, None]
    shades = np.unique((named * share + 255.0 * (1.0 - share)).round().astype(np.int64).reshape(-1, 3), axis=0)
    first, *rest = (_indexed(pixels, shades) for pixels in frames)
    duration = round(1000.0 / fps)
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=duration, loop=0, optimize=False)


def _indexed(pixels: Pixels, shades: NDArray[np.int64]) -> Image.Image:
    """Return a frame with the nearest of (N, 3) shades."""
    packed, places = np.unique(pixels.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1]), return_inverse=True)
    colours = np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1)
    nearest = ((colours[:, None] - shades) ** 2).sum(axis=2).argmin(axis=1).astype(np.uint8)
    image = Image.fromarray(nearest[places].reshape(pixels.shape[:2]))
    # From grey levels to places in the table.
    image.putpalette(shades.astype(np.uint8).ravel().tolist())
    return image
