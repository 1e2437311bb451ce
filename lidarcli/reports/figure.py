"""A picture of a sweep as a figure that a notebook shows, or on axes that somebody has."""

from __future__ import annotations

import io
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidarcli.choices import AS_IT_COMES, Look
from lidarcli.errors import OptionError
from lidarcli.reports.drawing import draw_whole, project_style
from lidarcli.reports.layout import places_of, width_of
from lidarcli.reports.picture import Picture, limits_of

__all__ = ["Axes", "Figure", "figure_of"]


class _Shown(Figure):
    """A figure of no window, which a notebook shows all the same, and once."""

    def _repr_png_(self) -> bytes:
        out = io.BytesIO()
        with project_style():
            self.savefig(out, format="png")
        return out.getvalue()


def figure_of(
    picture: Picture, view: str, axes: Sequence[Axes] | None = None, look: Look = AS_IT_COMES
) -> Figure:
    """The picture as a figure; or drawn on `axes`, one for each panel, and their figure.

    Raises
    ------
    OptionError
        There are not as many axes as panels, or those of a polar panel are not polar.
    """
    if axes is not None:
        return _on(axes, picture, view, look)
    with project_style():
        figure = _Shown(figsize=(width_of(view, look), 4.0), layout="constrained")
        FigureCanvasAgg(figure)
        draw_whole(figure, picture, view, limits_of([picture.batch]), look)
    return figure


def _on(axes: Sequence[Axes], picture: Picture, view: str, look: Look) -> Figure:
    """Draw each panel on axes that somebody has, with their own style."""
    limits = limits_of([picture.batch])
    places = places_of(picture, view, limits, look)
    if len(axes) != len(places):
        raise OptionError(
            f"view {view} has {len(places)} panel{'s' if len(places) != 1 else ''}, and there are {len(axes)} axes for it"
        )
    for mine, place in zip(axes, places, strict=True):
        if place.polar and mine.name != "polar":
            raise OptionError(f"view {view} needs polar axes: plt.subplot(projection='polar')")
        place.panel(mine, picture, limits)
    figure = axes[0].get_figure(root=True)
    assert isinstance(figure, Figure)  # every axes that is drawn on has one
    return figure
