"""A picture of a sweep as a figure that a notebook shows, or on axes that somebody has."""

from __future__ import annotations

import io
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from lidarcli.errors import OptionError
from lidarcli.reports.drawing import _axes, _entries, _figure, _fill, _legend, project_style
from lidarcli.reports.picture import Picture, limits_of

__all__ = ["Axes", "Figure", "figure_of"]


class _Shown(Figure):
    """A figure of no window, which a notebook shows all the same, and once."""

    def _repr_png_(self) -> bytes:
        out = io.BytesIO()
        with project_style():
            self.savefig(out, format="png")
        return out.getvalue()


def figure_of(picture: Picture, view: str, axes: Sequence[Axes] | None = None) -> Figure:
    """The picture as a figure; or drawn on `axes`, one for each panel, and their figure.

    Raises
    ------
    OptionError
        There are not as many axes as panels, or those of a polar panel are not polar.
    """
    limits = limits_of([picture.batch])
    if axes is not None:
        return _on(axes, picture, view)
    with project_style():
        size = _figure(view, picture).get_size_inches()
        figure = _Shown(figsize=(float(size[0]), float(size[1])), layout="constrained")
        FigureCanvasAgg(figure)
        drawn = _fill(figure, picture, view, limits)
        _legend(figure, _entries(drawn), view)
    return figure


def _on(axes: Sequence[Axes], picture: Picture, view: str) -> Figure:
    """Draw each panel on axes that somebody has, with their own style."""
    panels = [(panel, place.name) for place, panel in _axes(Figure(), picture, view)]
    if len(axes) != len(panels):
        raise OptionError(
            f"view {view} has {len(panels)} panel{'s' if len(panels) != 1 else ''}, and there are {len(axes)} axes for it"
        )
    for place, (panel, kind) in zip(axes, panels, strict=True):
        if kind == "polar" and place.name != kind:
            raise OptionError(f"view {view} needs polar axes: plt.subplot(projection='polar')")
        panel(place, picture, limits_of([picture.batch]))
    figure = axes[0].get_figure(root=True)
    assert isinstance(figure, Figure)  # every axes that is drawn on has one
    return figure
