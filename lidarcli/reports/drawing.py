"""Plots of sweeps as files: PNG, SVG, PDF, and animations. No display is needed; the same input gives the same bytes."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidarcli.errors import OptionError
from lidarcli.reports import palette, panels
from lidarcli.reports.picture import Limits, Picture, limits_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE, NARROW = 7.2, 3.5
"""Widths of two columns and of one column of a paper [inch]."""
NARROW_VIEWS = ("scene", "polar")
FRAMES_PER_SECOND = 10


def draw(picture: Picture, view: str, suffix: str, limits: Limits | None = None) -> bytes:
    """The picture as a file of the kind of `suffix`."""
    with project_style():
        figure = _figure(view, picture)
        drawn = _fill(figure, picture, view, limits or limits_of([picture.batch]))
        _legend(figure, _entries(drawn), view)
        out = io.BytesIO()
        # No date in the file.
        dates: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
        figure.savefig(out, format=suffix[1:], metadata=dates.get(suffix))
    return out.getvalue()


def animate(pictures: Sequence[Picture], view: str, path: Path) -> None:
    """One frame per picture, as GIF or, where ffmpeg is there, MP4."""
    from matplotlib.animation import FFMpegWriter, PillowWriter

    kind = FFMpegWriter if path.suffix.lower() == ".mp4" else PillowWriter
    if not kind.isAvailable():
        raise OptionError(f"{path.suffix} needs ffmpeg, which is not there; write .gif instead")
    limits = limits_of([picture.batch for picture in pictures])
    with project_style():
        figure = _figure(view, pictures[0])
        # The legend of every frame names what is in any of them, so that it does not jump.
        entries: dict[str, Any] = {}
        for picture in pictures:
            figure.clear()
            entries = _entries(_fill(figure, picture, view, limits)) | entries
        writer = kind(fps=FRAMES_PER_SECOND)
        with writer.saving(figure, str(path), 120):
            for picture in pictures:
                figure.clear()
                _fill(figure, picture, view, limits)
                _legend(figure, entries, view)
                writer.grab_frame()


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


def _figure(view: str, picture: Picture) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height = {"all": 4.3, "scene": 3.9, "sweep": 3.6, "difference": 3.6, "polar": 4.0}[view]
    width = {"all": WIDE, "scene": NARROW, "polar": NARROW}.get(view, WIDE * 0.7)
    if view == "all" and picture.background is not None:
        height += 1.7
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _fill(figure: Figure, picture: Picture, view: str, limits: Limits) -> list[Axes]:
    """Draw all but the legend; the axes."""
    drawn = _axes(figure, picture, view)
    for axes, panel in drawn:
        panel(axes, picture, limits)
    for axes, _ in drawn[:-1] if view != "all" else drawn[1:2]:
        axes.set_xlabel("")
        axes.tick_params(labelbottom=False)
    first, second = picture.title
    narrow = view in NARROW_VIEWS
    if narrow:
        second = second.replace(", profile", "\nprofile")
    figure.suptitle(f"{first}\n{second}", x=0.01, ha="left", fontsize=7 if narrow else 8)
    return [axes for axes, _ in drawn]


def _axes(figure: Figure, picture: Picture, view: str) -> list[tuple[Axes, Any]]:
    """The panels of a view; those that share their bearings with the panel below come before it."""
    if view == "scene":
        return [(figure.add_subplot(), panels.scene)]
    if view == "polar":
        return [(figure.add_subplot(projection="polar"), panels.polar)]
    compared: list[Any] = [] if picture.background is None else [panels.backgrounds, panels.subtraction]
    if view != "all":
        rows = (
            (compared or [panels.difference]) if view == "difference" else [panels.sweep, panels.difference]
        )
        grid = figure.add_gridspec(len(rows), 1)
        return [(figure.add_subplot(grid[row, 0]), panel) for row, panel in enumerate(rows)]
    grid = figure.add_gridspec(3 if compared else 2, 2, width_ratios=[1.05, 1.0])
    return [
        (figure.add_subplot(grid[:2, 0]), panels.scene),
        (figure.add_subplot(grid[0, 1]), panels.sweep),
        (figure.add_subplot(grid[1, 1]), panels.difference),
        *((figure.add_subplot(grid[2, column]), panel) for column, panel in enumerate(compared)),
    ]


def _entries(drawn: Sequence[Axes]) -> dict[str, Any]:
    """What the panels show: name → a mark of it, each once."""
    entries: dict[str, Any] = {}
    for axes in drawn:
        handles, labels = axes.get_legend_handles_labels()
        for label, handle in zip(labels, handles, strict=True):
            entries.setdefault(label, handle)
    return entries


def _legend(figure: Figure, entries: dict[str, Any], view: str) -> None:
    if entries:
        figure.legend(
            entries.values(),
            entries.keys(),
            loc="outside lower left",
            ncols=3 if view in NARROW_VIEWS else 6 if view == "all" else 4,
            frameon=False,
            handlelength=1.6,
            columnspacing=1.2,
            borderaxespad=0.2,
        )
