"""Plots of sweeps as files: PNG, SVG, PDF, and animations. No display is needed; the same input gives the same bytes."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from lidarcli.choices import ANIMATED_DPI, AS_IT_COMES, FRAMES_PER_SECOND, Look
from lidarcli.errors import OptionError
from lidarcli.reports import palette
from lidarcli.reports.figure_file import file_bytes
from lidarcli.reports.layout import add_axes, fit_height, places_of, width_of
from lidarcli.reports.picture import Limits, Picture, limits_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.legend import Legend

MOST_COLUMNS = 8
LEGEND_DOT = 2.8
"""Diameter of a beam's dot in the legend [pt]: some are too small to be seen alone."""
Entries = dict[str, Any]
"""What a legend names: words → a mark."""


def draw(picture: Picture, view: str, suffix: str, look: Look = AS_IT_COMES) -> bytes:
    """The picture as a file of the kind of `suffix`."""
    with project_style():
        figure = _figure(width_of(view, look))
        draw_whole(figure, picture, view, limits_of([picture.batch]), look)
        return file_bytes(figure, suffix, look.dpi)


def animate(
    pictures: Sequence[Picture],
    view: str,
    path: Path,
    look: Look = AS_IT_COMES,
    report: Callable[[int], None] | None = None,
) -> None:
    """One frame per picture, as GIF or, where ffmpeg is there, MP4; `report` hears how many are done."""
    from matplotlib.animation import FFMpegWriter

    from lidarcli.reports.gif import write_gif

    is_film = path.suffix.lower() == ".mp4"
    if is_film and not FFMpegWriter.isAvailable():
        raise OptionError(f"{path.suffix} needs ffmpeg, which is not there; write .gif instead")
    fps = look.fps or FRAMES_PER_SECOND
    with project_style():
        figure = _figure(width_of(view, look))
        figure.set_dpi(look.dpi or ANIMATED_DPI)
        frames = _frames(figure, pictures, view, look, report)
        if not is_film:
            write_gif(path, map(_pixels, frames), fps, palette.ALL)
            return
        writer = FFMpegWriter(fps=fps)  # type: ignore[arg-type]
        first = next(frames)
        with writer.saving(first, str(path), first.dpi):
            writer.grab_frame()
            for _ in frames:
                writer.grab_frame()


def _frames(
    figure: Figure,
    pictures: Sequence[Picture],
    view: str,
    look: Look,
    report: Callable[[int], None] | None,
) -> Iterator[Figure]:
    """The same figure with one picture after the other.

    Axes and legend stay where they are, and the legend names what is in any of the frames.
    """
    limits = limits_of([picture.batch for picture in pictures])
    entries: Entries = {}
    for picture in pictures:
        figure.clear()
        entries = entries_of(_fill(figure, picture, view, limits, look)) | entries
    figure.clear()
    longest = max(pictures, key=lambda picture: len(" ".join(picture.title)))
    whole = draw_whole(figure, longest, view, limits, look, entries)
    places = [axes.get_position(original=True) for axes in whole]
    columns = _columns(figure, entries)
    figure.set_layout_engine("none")
    for number, picture in enumerate(pictures, 1):
        figure.clear()
        for axes, place in zip(_fill(figure, picture, view, limits, look), places, strict=True):
            axes.set_position(place)
        _title(figure, picture, look)
        _legend(figure, entries, look, "lower left", columns)
        yield figure
        if report is not None:
            report(number)


def _pixels(figure: Figure) -> NDArray[np.uint8]:
    """(H, W, 3) what a figure shows."""
    canvas = cast("FigureCanvasAgg", figure.canvas)
    canvas.draw()  # type: ignore[no-untyped-call]
    shown = canvas.buffer_rgba()  # type: ignore[no-untyped-call]
    return np.asarray(shown, np.uint8)[..., :3].copy()


@contextmanager
def project_style(other: dict[str, Any] | None = None) -> Iterator[None]:
    """The project's style alone, whatever the user's own settings; `other` comes on top."""
    import matplotlib
    from matplotlib import style

    with style.context(["default", palette.STYLE, other or {}]), warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes; that is no news for the user.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        matplotlib.rcParams["axes.unicode_minus"] = True
        yield


def _figure(width: float) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, 4.0), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def draw_whole(
    figure: Figure, picture: Picture, view: str, limits: Limits, look: Look, entries: Entries | None = None
) -> list[Axes]:
    """Draw everything, and make the figure as high as it has to be; the axes."""
    drawn = _fill(figure, picture, view, limits, look)
    _title(figure, picture, look)
    _legend(figure, entries_of(drawn) if entries is None else entries, look, "outside lower left")
    heights = [place.height for place in places_of(picture, view, limits, look)]
    fit_height(figure, drawn, heights, limits.aspect)
    return drawn


def _fill(figure: Figure, picture: Picture, view: str, limits: Limits, look: Look) -> list[Axes]:
    """Draw the panels; their axes."""
    places = places_of(picture, view, limits, look)
    drawn = add_axes(figure, places, limits)
    for axes, place in zip(drawn, places, strict=True):
        place.panel(axes, picture, limits)
        if place.shares:
            axes.set_xlabel("")
            axes.tick_params(labelbottom=False)
    return drawn


def _title(figure: Figure, picture: Picture, look: Look) -> None:
    """Two lines about the picture, broken where it is too narrow for them."""
    if look.title:
        width = figure.get_size_inches()[0]
        size = 8 if width > 4.5 else 7
        title = figure.suptitle("", x=0.01, ha="left", fontsize=size)
        room = 0.98 * figure.bbox.width
        lines: list[str] = []
        for whole in picture.title:
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
    """What the panels show, each once."""
    entries: Entries = {}
    for axes in drawn:
        handles, labels = axes.get_legend_handles_labels()
        for label, handle in zip(labels, handles, strict=True):
            entries.setdefault(label, handle)
    return entries


def _legend(figure: Figure, entries: Entries, look: Look, place: str, columns: int = 0) -> None:
    """What the marks mean, where that is asked for."""
    if look.legend:
        draw_legend(figure, entries, place, columns)


def draw_legend(figure: Figure, entries: Entries, place: str, columns: int = 0) -> None:
    """A legend in so many columns; 0: as many as there is room for."""
    if entries:
        _add_legend(figure, entries, place, columns or _columns(figure, entries))


def _columns(figure: Figure, entries: Entries) -> int:
    """Most columns of a legend for which there is room."""
    for count in range(min(len(entries), MOST_COLUMNS), 1, -1):
        legend = _add_legend(figure, entries, "lower left", count)
        width = legend.get_window_extent().width
        legend.remove()
        if width <= 0.99 * figure.bbox.width:
            return count
    return 1


def _add_legend(figure: Figure, entries: Entries, place: Any, columns: int) -> Legend:
    """A legend in so many columns."""
    from matplotlib.collections import PathCollection

    legend = figure.legend(
        [*entries.values()],
        [*entries],
        loc=place,
        ncols=columns,
        frameon=False,
        handlelength=1.4,
        handletextpad=0.5,
        columnspacing=1.2,
        borderaxespad=0.2,
    )
    for handle in legend.legend_handles:
        if isinstance(handle, PathCollection):
            handle.set_sizes([LEGEND_DOT**2])
    return legend
