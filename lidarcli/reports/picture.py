"""A sweep as a picture: its scene and its curves on a figure, as a file or an animation."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, cast

from matplotlib.animation import FFMpegWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lidarcli.display.texts import counted
from lidarcli.errors import OptionError
from lidarcli.options.choices import ANIMATED_DPI, AS_IT_COMES, FRAMES_PER_SECOND, Look
from lidarcli.reports.curves import backgrounds, difference, subtraction, sweep
from lidarcli.reports.drawing import (
    Entries,
    Mark,
    Panel,
    Pixels,
    Stamps,
    artist_of,
    draw_content,
    draw_legend,
    draw_panel,
    draw_title,
    draw_title_again,
    entries_of,
    file_bytes,
    fit_height,
    new_figure,
    pixels_of,
    project_style,
    shown_on,
    write_gif,
)
from lidarcli.reports.map_picture import MapPicture, map_figure
from lidarcli.reports.scene import NARROW, Limits, Picture, limits_of, scene

__all__ = ["Axes", "Figure", "figure_of"]
WIDTHS = {"all": 7.2, "scene": NARROW, "sweep": 5.04}
"""View → width of the whole picture [inch]: two columns of a paper, one, or between."""
TICK = 0.26
"""Room for the words of a tick on the axis of bearings [inch]."""
CURVE, LOW_CURVE = 1.3, 1.1
"""Height of a curve next to a scene or alone, and of one below a scene [inch]."""


class PanelPlace(NamedTuple):
    """A panel of a view, in a grid."""

    panel: Callable[[Picture, Limits], Panel]
    rows: slice
    column: int
    height: float
    """Height [inch]; 0 for a scene, whose height follows from its width and content."""
    shares: bool = False
    """True if the panel below has the axis of bearings for both."""
    width: float = math.inf
    """Width [inch]."""

    def content(self, picture: Picture, limits: Limits) -> Panel:
        """Return the panel of a picture, here."""
        panel = self.panel(picture, limits)
        frame = panel.frame
        if self.shares:
            frame = replace(frame, names=("", frame.names[1]))
        while (ticks := frame.x_ticks) is not None and len(ticks) * TICK > self.width:
            # Every other one, with 0.
            frame = replace(frame, x_ticks=ticks[ticks.index(0.0) % 2 :: 2] if 0.0 in ticks else ticks[::2])
        return panel._replace(frame=frame)


def width_of(view: str, look: Look) -> float:
    """Return the width of the whole picture [inch]."""
    return look.inches(WIDTHS[view])


def _share(limits: Limits) -> float:
    """Return the share of the width for a scene next to its curves: as high as two, as far as all stay readable."""
    return min(max(0.46 * limits.aspect, 0.3), 0.54)


def places_of(picture: Picture, view: str, limits: Limits, look: Look) -> list[PanelPlace]:
    """Return the panels of a view."""
    compared = [] if picture.background is None else [backgrounds, subtraction]
    curves, width = [sweep, difference, *compared], width_of(view, look)
    # A scene that is elongated, or in a narrow picture, is above its curves.
    side_by_side = view == "all" and limits.aspect <= 1.5 and width >= 5.0

    def above(picture: Picture, limits: Limits) -> Panel:
        return scene(picture, limits, 0.85 * width * (_share(limits) if side_by_side else 1.0), vertices=look.vertices)

    # Words on the left take a tenth or so.
    room = [0.85 * width * each for each in (_share(limits), 1.0 - _share(limits))] if side_by_side else [0.85 * width]
    if side_by_side:
        return [
            PanelPlace(above, slice(0, 2), 0, 0.0),
            PanelPlace(sweep, slice(0, 1), 1, CURVE, shares=True, width=room[1]),
            PanelPlace(difference, slice(1, 2), 1, CURVE, width=room[1]),
            *(PanelPlace(panel, slice(2, 3), at, CURVE, width=room[at]) for at, panel in enumerate(compared)),
        ]
    shown = [] if view == "sweep" else [PanelPlace(above, slice(0, 1), 0, 0.0)]
    for panel in [] if view == "scene" else curves:
        row, height = len(shown), CURVE if view == "sweep" else LOW_CURVE
        shown.append(PanelPlace(panel, slice(row, row + 1), 0, height, panel is not curves[-1], room[0]))
    return shown


def draw_whole(
    figure: Figure, picture: Picture, view: str, limits: Limits, look: Look, entries: Entries | None = None
) -> list[Axes]:
    """Draw all panels, and make the figure as high as it has to be; return the axes."""
    places = places_of(picture, view, limits, look)
    columns = max(place.column for place in places) + 1
    ratios = [_share(limits), 1.0 - _share(limits)] if columns == 2 else [1.0]
    grid = figure.add_gridspec(max(place.rows.stop for place in places), columns, width_ratios=ratios)
    drawn = [figure.add_subplot(grid[place.rows, place.column]) for place in places]
    for axes, place in zip(drawn, places, strict=True):
        draw_panel(axes, place.content(picture, limits))
        axes.tick_params(labelbottom=not place.shares)
    if look.title:
        draw_title(figure, picture.title)
    if look.legend:
        draw_legend(figure, entries_of(drawn) if entries is None else entries, "outside lower left")
    fit_height(figure, drawn, [place.height for place in places], limits.aspect)
    return drawn


def draw(picture: Picture, view: str, suffix: str, look: Look = AS_IT_COMES) -> bytes:
    """Return the picture as a file of the kind of `suffix` (.png, .svg, .pdf)."""
    with project_style():
        figure = new_figure(width_of(view, look))
        draw_whole(figure, picture, view, limits_of([picture]), look)
        return file_bytes(figure, suffix, look.dpi)


def figure_of(picture: Picture, view: str, axes: Sequence[Axes] | None = None, look: Look = AS_IT_COMES) -> Figure:
    """Return the picture as a figure; or draw it on `axes`, one for each panel, and return the figure of these.

    Raises
    ------
    OptionError
        There are not as many axes as panels.
    """
    limits = limits_of([picture])
    if axes is None:
        with project_style():
            figure = new_figure(width_of(view, look))
            draw_whole(figure, picture, view, limits, look)
        return figure
    places = places_of(picture, view, limits, look)
    if len(axes) != len(places):
        raise OptionError(f"view {view} has {counted(len(places), 'panel')}, and there are {len(axes)} axes for it")
    for own, place in zip(axes, places, strict=True):
        draw_panel(own, place.panel(picture, limits))
    return cast("Figure", axes[0].get_figure(root=True))


def figure_of_map(picture: MapPicture, look: Look = AS_IT_COMES) -> Figure:
    """Return a map as a figure, which a notebook shows."""
    with project_style({"axes.grid": False}):
        return map_figure(picture, look=look)


def animate(
    pictures: Sequence[Picture],
    view: str,
    path: Path,
    look: Look = AS_IT_COMES,
    report: Callable[[int], None] | None = None,
    limits: Limits | None = None,
) -> None:
    """Write one frame per picture, as GIF or, with ffmpeg, MP4; `report` takes the number of frames that are done.

    `limits`: what the axes show; None: all of the pictures.
    """
    is_film = path.suffix.lower() == ".mp4"
    if is_film and not FFMpegWriter.isAvailable():
        raise OptionError(f"{path.suffix} needs ffmpeg, which is not there; write .gif instead")
    fps = look.fps or FRAMES_PER_SECOND
    with project_style():
        figure = new_figure(width_of(view, look), kind=_Film)
        figure.set_dpi(look.dpi or ANIMATED_DPI)
        axes, panels = _laid_out(figure, pictures, view, look, limits)
        shown = _frames(figure, axes, panels, [one.title for one in pictures if look.title], report)
        if is_film:
            writer = FFMpegWriter(fps=fps)  # type: ignore[arg-type]
            with writer.saving(figure, str(path), figure.dpi):
                for _ in shown:
                    writer.grab_frame()
        else:
            write_gif(path, (shown_on(figure) for _ in shown), fps)


class _Film(Figure):
    """A figure that is saved as its canvas shows it."""

    def savefig(self, fname: Any, **_: Any) -> None:
        fname.write(shown_on(self))


def _laid_out(
    figure: Figure, pictures: Sequence[Picture], view: str, look: Look, limits: Limits | None
) -> tuple[list[Axes], list[list[Panel]]]:
    """Lay out a figure for all of the pictures, with a legend of what is in any of them; return axes, and all panels."""
    limits = limits or limits_of(pictures)
    places = places_of(pictures[0], view, limits, look)
    panels = [[place.content(picture, limits) for place in places] for picture in pictures]
    marks: dict[str, Mark] = {}
    for some in panels:
        named = [(mark.name, mark) for panel in some for mark in panel.marks if mark.name is not None]
        # Of several with a name the first one counts.
        marks = dict(named) | dict(reversed(named)) | marks
    longest = max(pictures, key=lambda picture: len(" ".join(picture.title)))
    axes = draw_whole(figure, longest, view, limits, look, {name: artist_of(mark) for name, mark in marks.items()})
    figure.set_layout_engine(None)
    return axes, panels


def frames(pictures: Sequence[Picture], view: str, look: Look, limits: Limits | None = None) -> Iterator[Pixels]:
    """Yield the pixels (H, W, 3) of a frame per picture, as of `animate`."""
    with project_style():
        figure = new_figure(width_of(view, look), kind=_Film)
        figure.set_dpi(look.dpi or ANIMATED_DPI)
        axes, panels = _laid_out(figure, pictures, view, look, limits)
        for _ in _frames(figure, axes, panels, [one.title for one in pictures if look.title], None):
            yield shown_on(figure)[..., :3].copy()


def _frames(
    figure: Figure,
    axes: Sequence[Axes],
    panels: Sequence[Sequence[Panel]],
    titles: Sequence[Sequence[str]],
    report: Callable[[int], None] | None,
) -> Iterator[None]:
    """Draw each of the pictures in turn on the canvas; axes that are the same in all of them are drawn once."""
    still = [len({some[k].frame for some in panels}) == 1 for k in range(len(axes))]
    for one, stays in zip(axes, still, strict=True):
        _clear(one)
        one.set_animated(not stays)
    title, stamps = draw_title(figure, titles[0] if titles else ()), Stamps()
    title.set_animated(True)
    background = pixels_of(figure)
    renderer = cast("Any", figure.canvas).get_renderer()
    for one, stays in zip(axes, still, strict=True):
        for artist in (one.patch, one.xaxis, one.yaxis):
            artist.set_visible(not stays)
    for number, some in enumerate(panels):
        shown_on(figure)[..., :3] = background
        for one, panel, stays in zip(axes, some, still, strict=True):
            if not stays:
                panel.frame.set(one)
            draw_content(one, panel, stamps)
            one.draw(renderer)
            _clear(one)
        draw_title_again(title, titles[number] if titles else (), stamps, renderer)
        yield
        if report is not None:
            report(number + 1)


def _clear(axes: Axes) -> None:
    """Remove the content of axes."""
    for artist in [*axes.lines, *axes.patches, *axes.texts, *axes.artists]:
        artist.remove()
