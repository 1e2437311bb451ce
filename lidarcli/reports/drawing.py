"""Plots of sweeps as files or as figures for a notebook: PNG, SVG, PDF, and animations.

No display is needed; the same input gives the same bytes.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import matplotlib
import numpy as np
from matplotlib import style
from matplotlib.animation import FFMpegWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from numpy.typing import NDArray
from PIL import Image

from lidarcli.choices import ANIMATED_DPI, AS_IT_COMES, FRAMES_PER_SECOND, Look
from lidarcli.display import counted
from lidarcli.errors import OptionError
from lidarcli.reports import palette, panels
from lidarcli.reports.panels import Frame, scene
from lidarcli.reports.picture import Limits, Picture, limits_of

Panel = Callable[["Axes", Picture, Limits, "Frame | None"], "Frame"]

WIDE, MIDDLE, NARROW = 7.2, 5.04, 3.5
"""Widths of two columns of a paper, of what is between, and of one column [inch]."""
WIDTHS = {"all": WIDE, "scene": NARROW, "polar": NARROW}
ELONGATED = 1.5
"""Least ratio of width to height of a scene that stands above its curves."""
COLUMNS = 5.0
"""Least width of a picture whose scene stands beside its curves [inch]."""
CURVE, LOW_CURVE = 1.3, 1.1
"""Height of a curve beside a scene or alone at least, and of one below a scene [inch]."""
ROUNDS = 5
ENOUGH = 0.01
"""Greatest error of a height that is kept [inch]."""
NEARLY = 0.1
"""Greatest error of a height that changes neither ticks nor what stands around the axes [inch]."""
TALLEST = 2.2
"""Greatest height of a scene by the width of its place."""
MOST_COLUMNS = 8
HANDLE, GAP, BETWEEN, BESIDE = 1.4, 0.5, 1.2, 0.4
"""Of a legend: the length of a mark, and the gaps beside it, between columns, and around all, by the size of letters."""
LEGEND_DOT = 2.8
"""Diameter of a beam's dot in the legend [pt]: smaller ones could not be seen alone."""
Entries = dict[str, Any]
"""Entries of a legend: words → a mark."""
__all__ = ["Axes", "Figure", "figure_of"]
MOST = 256
"""Colours of a GIF."""
SHADES = 6
"""Number of shades of each colour towards white: the edges of lines and letters."""
Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Place:
    """A panel of a view, in a grid."""

    panel: Panel
    rows: tuple[int, int]
    """First row and the one after the last."""
    column: int
    height: float
    """Wanted height [inch]; 0 for a scene, whose height follows from its width and content."""
    shares: bool = False
    """True if the panel below has the axis of bearings for both."""
    polar: bool = False


def width_of(view: str, look: Look) -> float:
    """Return the width of the whole picture [inch]."""
    return look.inches(WIDTHS.get(view, MIDDLE))


def is_stacked(limits: Limits, width: float) -> bool:
    """Return True if the scene of the view `all` stands above its curves."""
    return limits.aspect > ELONGATED or width < COLUMNS


def places_of(picture: Picture, view: str, limits: Limits, look: Look) -> list[Place]:
    """Return the panels of a view."""
    above = partial(scene, vertices=look.vertices)
    compared: list[Panel] = [] if picture.background is None else [panels.backgrounds, panels.subtraction]
    width = width_of(view, look)
    if view == "scene":
        return [Place(above, (0, 1), 0, 0.0)]
    if view == "polar":
        return [Place(partial(panels.polar, vertices=look.vertices), (0, 1), 0, 0.8 * width, polar=True)]
    if view != "all":
        curves = (compared or [panels.difference]) if view == "difference" else [panels.sweep, panels.difference]
        return _column(curves, 0, CURVE if len(curves) > 1 else 2.0 * CURVE)
    if is_stacked(limits, width):
        curves = [panels.sweep, panels.difference, *compared]
        return [Place(above, (0, 1), 0, 0.0), *_column(curves, 1, LOW_CURVE)]
    return [
        Place(above, (0, 2), 0, 0.0),
        Place(panels.sweep, (0, 1), 1, CURVE, shares=True),
        Place(panels.difference, (1, 2), 1, CURVE),
        *(Place(panel, (2, 3), column, CURVE) for column, panel in enumerate(compared)),
    ]


def _column(curves: Sequence[Panel], first: int, height: float) -> list[Place]:
    last = len(curves) - 1
    return [Place(panel, (first + row, first + row + 1), 0, height, shares=row < last) for row, panel in enumerate(curves)]


def add_axes(figure: Figure, places: Sequence[Place], limits: Limits) -> list[Axes]:
    """Add the axes of all panels."""
    rows = max(place.rows[1] for place in places)
    columns = max(place.column for place in places) + 1
    # As wide as the scene is at the height of two curves, as far as both stay readable.
    share = min(max(0.46 * limits.aspect, 0.3), 0.54)
    ratios = [share, 1.0 - share] if columns == 2 else [1.0]
    grid = figure.add_gridspec(rows, columns, width_ratios=ratios)
    return [
        figure.add_subplot(grid[place.rows[0] : place.rows[1], place.column], projection="polar" if place.polar else None)
        for place in places
    ]


def fit_height(figure: Figure, axes: Sequence[Axes], heights: Sequence[float], aspect: float) -> None:
    """Make the picture so high that every panel has its place and no more; its width stays.

    Parameters
    ----------
    heights : what each panel wants [inch]; 0: what its width makes of the aspect, in as many rows as it has
    aspect : how many times as wide as high is what those without a height show
    """
    grids = [one.get_subplotspec() for one in axes]
    layout = figure.get_layout_engine()
    assert layout is not None  # all figures here are made with one
    # Drawn smaller than its place, a scene would seem to need less room around it.
    scenes = [(one, one.get_aspect()) for one, wanted in zip(axes, heights, strict=True) if not wanted]
    for one, _ in scenes:
        one.set_aspect("auto")
    # A circle is not always as high as its place.
    enough = ENOUGH if any(one.name == "polar" for one in axes) else NEARLY
    # What is drawn outside of the axes may take more room once these are larger.
    for _ in range(ROUNDS):
        layout.execute(figure)
        width, height = figure.get_size_inches()
        have: dict[int, float] = {}
        want: dict[int, float] = {}
        # The scene comes first, and last here: the rows that it spans are known from the curves beside it.
        for one, grid, wanted in reversed([*zip(axes, grids, heights, strict=True)]):
            assert grid is not None  # all axes stand in one grid
            box = one.get_position(original=True)
            rows = grid.rowspan
            high = wanted or min(box.width * width / aspect, TALLEST * box.width * width)
            gap = box.height * height - sum(have[row] for row in rows) if len(rows) > 1 else 0.0
            for row in rows:
                have[row] = max(have.get(row, 0.0), box.height * height if len(rows) == 1 else 0.0)
                want[row] = max(want.get(row, 0.0), (high - gap) / len(rows))
        more = {row: want[row] - have[row] for row in sorted(want)}
        assert grids[0] is not None
        grids[0].get_gridspec().set_height_ratios([want[row] for row in more])
        if all(abs(grows) < enough for grows in more.values()):
            _stretch(figure, axes, more)
            break
        figure.set_size_inches(width, height + sum(more.values()))
    for one, kept in scenes:
        one.set_aspect(kept)
    for one in axes:
        one.apply_aspect()


def _stretch(figure: Figure, axes: Sequence[Axes], more: dict[int, float]) -> None:
    """Make rows higher by so little [inch] that what stands around the axes stays as it is."""
    width, height = figure.get_size_inches()
    whole = height + sum(more.values())
    figure.set_size_inches(width, whole)
    for one in axes:
        grid = one.get_subplotspec()
        assert grid is not None  # all axes stand in one grid
        box = one.get_position(original=True)
        low = box.y0 * height + sum(grows for row, grows in more.items() if row >= grid.rowspan.stop)
        high = box.height * height + sum(more[row] for row in grid.rowspan)
        one.set_position((box.x0, low / whole, box.width, high / whole))
        # A layout may move it again.
        one.set_in_layout(True)
    if (title := figure._suptitle) is not None:  # type: ignore[attr-defined]
        x, y = title.get_position()
        title.set_position((x, 1.0 - (1.0 - y) * height / whole))


def draw(picture: Picture, view: str, suffix: str, look: Look = AS_IT_COMES) -> bytes:
    """Return the picture as a file of the kind of `suffix`."""
    with project_style():
        figure = new_figure(width_of(view, look))
        draw_whole(figure, picture, view, limits_of([picture]), look)
        return file_bytes(figure, suffix, look.dpi)


def animate(
    pictures: Sequence[Picture],
    view: str,
    path: Path,
    look: Look = AS_IT_COMES,
    report: Callable[[int], None] | None = None,
) -> None:
    """Write one frame per picture, as GIF or, with ffmpeg, MP4; `report` takes the number of frames that are done."""
    is_film = path.suffix.lower() == ".mp4"
    if is_film and not FFMpegWriter.isAvailable():
        raise OptionError(f"{path.suffix} needs ffmpeg, which is not there; write .gif instead")
    fps = look.fps or FRAMES_PER_SECOND
    with project_style():
        figure = new_figure(width_of(view, look))
        figure.set_dpi(look.dpi or ANIMATED_DPI)
        moving = _Moving(figure, pictures, view, look)
        shown = moving.frames(report)
        if not is_film:
            write_gif(path, (moving.pixels() for _ in shown), fps, palette.ALL)
            return
        writer = FFMpegWriter(fps=fps)  # type: ignore[arg-type]
        with writer.saving(figure, str(path), figure.dpi):
            for _ in shown:
                writer.grab_frame()


class _Moving:
    """A figure that shows one picture after the other.

    Axes and legend stay where they are, and the legend names what is in any of the pictures.
    """

    def __init__(self, figure: Figure, pictures: Sequence[Picture], view: str, look: Look) -> None:
        self._figure, self._pictures, self._look = figure, pictures, look
        self._limits = limits = limits_of(pictures)
        self._places = places_of(pictures[0], view, limits, look)
        self._axes = add_axes(figure, self._places, limits)
        self._had: list[Frame | None] = [None] * len(self._places)
        self._still: Any = None
        """Pixels of what is the same in the next picture; None where they have to be drawn."""
        entries: Entries = {}
        for picture in pictures:
            self._show(picture)
            entries = entries_of(self._axes) | entries
        figure.clear()
        longest = max(pictures, key=lambda picture: len(" ".join(picture.title)))
        self._axes = draw_whole(figure, longest, view, limits, look, entries)
        self._had = [None] * len(self._places)
        figure.set_layout_engine(None)
        for legend in [*figure.legends]:
            legend.remove()
        if look.legend:
            draw_legend(figure, entries, "lower left")

    def frames(self, report: Callable[[int], None] | None) -> Iterator[None]:
        """Show each of the pictures in turn; `report` takes the number of those that are done."""
        for number, picture in enumerate(self._pictures, 1):
            self._show(picture)
            _title(self._figure, picture, self._look)
            yield
            if report is not None:
                report(number)

    def pixels(self) -> Pixels:
        """Return (H, W, 3) the pixels of the picture that is shown."""
        figure = self._figure
        canvas = cast("FigureCanvasAgg", figure.canvas)
        moving = [self._moving(axes) for axes in self._axes]
        title = figure._suptitle  # type: ignore[attr-defined]
        if self._still is None:
            for one in (artist for artists in [*moving, [title] if title else []] for artist in artists):
                one.set_animated(True)
            # All but what is animated.
            canvas.draw()  # type: ignore[no-untyped-call]
            self._still = canvas.copy_from_bbox(figure.bbox)  # type: ignore[no-untyped-call]
        canvas.restore_region(self._still)  # type: ignore[no-untyped-call]
        if title is not None:
            figure.draw_artist(title)
        for axes, artists in zip(self._axes, moving, strict=True):
            for artist in artists:
                axes.draw_artist(artist)
        return np.asarray(canvas.buffer_rgba(), np.uint8)[..., :3].copy()  # type: ignore[no-untyped-call]

    def _show(self, picture: Picture) -> None:
        """Draw the panels of a picture in place of those before."""
        for k, (axes, place) in enumerate(zip(self._axes, self._places, strict=True)):
            for artist in _content(axes):
                artist.remove()
            axes.containers.clear()
            had = self._had[k]
            self._had[k] = place.panel(axes, picture, self._limits, had)
            if self._had[k] != had:
                self._still = None
                _share(axes, place)

    @staticmethod
    def _moving(axes: Axes) -> list[Artist]:
        """Return what is drawn anew for each picture, in the order of drawing: the lines around axes lie on some of it."""
        return sorted([*_content(axes), *axes.spines.values()], key=lambda artist: artist.get_zorder())


def _content(axes: Axes) -> list[Artist]:
    """Return what was drawn on axes."""
    return [*axes._children]  # type: ignore[attr-defined]


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


def draw_whole(
    figure: Figure, picture: Picture, view: str, limits: Limits, look: Look, entries: Entries | None = None
) -> list[Axes]:
    """Draw everything, and make the figure as high as it has to be; the axes."""
    drawn = _fill(figure, picture, view, limits, look)
    _title(figure, picture, look)
    if look.legend:
        draw_legend(figure, entries_of(drawn) if entries is None else entries, "outside lower left")
    heights = [place.height for place in places_of(picture, view, limits, look)]
    fit_height(figure, drawn, heights, limits.aspect)
    return drawn


def _fill(figure: Figure, picture: Picture, view: str, limits: Limits, look: Look) -> list[Axes]:
    """Draw the panels; their axes."""
    places = places_of(picture, view, limits, look)
    drawn = add_axes(figure, places, limits)
    for axes, place in zip(drawn, places, strict=True):
        place.panel(axes, picture, limits, None)
        _share(axes, place)
    return drawn


def _share(axes: Axes, place: Place) -> None:
    """Leave the axis of bearings to the panel below."""
    if place.shares:
        axes.set_xlabel("")
        axes.tick_params(labelbottom=False)


def _title(figure: Figure, picture: Picture, look: Look) -> None:
    """Set the title: two lines, broken where the picture is too narrow for them."""
    if look.title:
        width = figure.get_size_inches()[0]
        size = 8 if width > 4.5 else 7
        title = figure.suptitle("", x=0.01, ha="left", fontsize=size)
        room = 0.98 * figure.bbox.width
        lines: list[str] = []
        for whole in picture.title:
            title.set_text(whole)
            if title.get_window_extent().width <= room:
                lines.append(whole)
                continue
            lines.append("")
            for part in whole.split(", "):
                longer = f"{lines[-1]}, {part}" if lines[-1] else part
                title.set_text(longer)
                if lines[-1] and title.get_window_extent().width > room:
                    lines[-1] += ","
                    lines.append(part)
                else:
                    lines[-1] = longer
        title.set_text("\n".join(lines))


def entries_of(drawn: Sequence[Axes]) -> Entries:
    """Return the entries of a legend of all panels, each once."""
    entries: Entries = {}
    for axes in drawn:
        handles, labels = axes.get_legend_handles_labels()
        for label, handle in zip(labels, handles, strict=True):
            entries.setdefault(label, handle)
    return entries


def draw_legend(figure: Figure, entries: Entries, place: str, columns: int = 0) -> None:
    """Draw a legend in so many columns; 0: as many as there is room for."""
    if entries:
        _add_legend(figure, entries, place, columns or _columns(figure, entries))


def _columns(figure: Figure, entries: Entries) -> int:
    """Return the most columns of a legend for which there is room."""
    legend = _add_legend(figure, entries, "lower left", 1)
    size = float(legend.get_texts()[0].get_fontsize())
    widths = [text.get_window_extent().width for text in legend.get_texts()]
    legend.remove()
    unit = size * figure.dpi / 72.0
    room = 0.99 * figure.bbox.width / unit - 2.0 * BESIDE
    for count in range(min(len(entries), MOST_COLUMNS), 1, -1):
        columns = np.array_split(np.array(widths) / unit + HANDLE + GAP, count)
        if sum(column.max() for column in columns) + (count - 1) * BETWEEN <= room:
            return count
    return 1


def _add_legend(figure: Figure, entries: Entries, place: Any, columns: int) -> Legend:
    """Add a legend in so many columns."""
    legend = figure.legend(
        [*entries.values()],
        [*entries],
        loc=place,
        ncols=columns,
        frameon=False,
        handlelength=HANDLE,
        handletextpad=GAP,
        columnspacing=BETWEEN,
        borderpad=BESIDE,
        borderaxespad=0.2,
    )
    for handle in legend.legend_handles:
        if isinstance(handle, PathCollection):
            handle.set_sizes([LEGEND_DOT**2])
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


class _Shown(Figure):
    """A figure without a window, which a notebook shows once."""

    def _repr_png_(self) -> bytes:
        out = io.BytesIO()
        with project_style():
            self.savefig(out, format="png")
        return out.getvalue()


def figure_of(picture: Picture, view: str, axes: Sequence[Axes] | None = None, look: Look = AS_IT_COMES) -> Figure:
    """Return the picture as a figure; or draw it on `axes`, one for each panel, and return their figure.

    Raises
    ------
    OptionError
        There are not as many axes as panels, or those of a polar panel are not polar.
    """
    if axes is not None:
        return _on(axes, picture, view, look)
    with project_style():
        figure = new_figure(width_of(view, look), kind=_Shown)
        draw_whole(figure, picture, view, limits_of([picture]), look)
    return figure


def _on(axes: Sequence[Axes], picture: Picture, view: str, look: Look) -> Figure:
    """Draw each panel on axes of the caller, with their own style."""
    limits = limits_of([picture])
    places = places_of(picture, view, limits, look)
    if len(axes) != len(places):
        raise OptionError(f"view {view} has {counted(len(places), 'panel')}, and there are {len(axes)} axes for it")
    for mine, place in zip(axes, places, strict=True):
        if place.polar and mine.name != "polar":
            raise OptionError(f"view {view} needs polar axes: plt.subplot(projection='polar')")
        place.panel(mine, picture, limits, None)
    figure = axes[0].get_figure(root=True)
    assert isinstance(figure, Figure)  # every axes that is drawn on has one
    return figure


def write_gif(path: Path, frames: Iterable[Pixels], fps: float, colours: Iterable[str]) -> None:
    """Write frames (H, W, 3) that go round for ever.

    Parameters
    ----------
    colours : what is drawn with, `#RRGGBB`, on white; all else is shown in the nearest shade of these
    """
    table = _table(colours)
    codes = np.full(1 << 24, -1, np.int16)
    first, *rest = (_reduced(pixels, table, codes) for pixels in frames)
    first.save(path, format="GIF", save_all=True, append_images=rest, duration=round(1000.0 / fps), loop=0, optimize=False)


def _table(colours: Iterable[str]) -> NDArray[np.int64]:
    """Return (N, 3) every shade of each colour, and white."""
    named = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in colours], np.float64)
    shade = np.linspace(0.0, 1.0, SHADES, endpoint=False)[:, None, None]
    shades = (named * (1.0 - shade) + 255.0 * shade).round().astype(np.int64).reshape(-1, 3)
    return np.unique(np.concatenate([[[255, 255, 255]], shades]), axis=0)[-MOST:]


def _reduced(pixels: Pixels, table: NDArray[np.int64], codes: NDArray[np.int16]) -> Image.Image:
    """Return a frame with the nearest colours of the table; `codes` keeps their places, by colour, -1 where not known."""
    red, green, blue = (pixels[..., k].astype(np.int32) for k in range(3))
    packed = red << 16 | green << 8 | blue
    places = codes[packed]
    if (places < 0).any():
        new = np.unique(packed[places < 0])
        parts = np.stack([new >> 16, new >> 8 & 255, new & 255], axis=1)
        codes[new] = ((parts[:, None] - table) ** 2).sum(axis=2).argmin(axis=1)
        places = codes[packed]
    image = Image.fromarray(places.astype(np.uint8))
    # From grey levels to places in the table.
    image.putpalette(table.astype(np.uint8).ravel().tolist())
    return image
