"""Labels on axes: set when the picture is drawn, for only then is known how large it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import IdentityTransform

from lidarcli.reports import palette
from lidarcli.reports.labels import Rectangle, Wanted, line_to, set_labels
from lidarcli.sweeps import Float64

SIZE = 6.5
"""Of the letters [pt]."""
STEPS = 8
"""Points of each piece of a line."""
AIR = 0.8
"""Around them [pt]."""
MARK = 2.0
"""What a mark takes about its point [pt]."""
MOST_POINTS = 4_000
"""Of more points some are left out: labels avoid crowds all the same."""


class Label(NamedTuple):
    """A text, and what it names."""

    text: str
    around: Float64
    """(N, 2) outline of it in the coordinates of the axes; of a mark its one point."""
    colour: str = palette.BLACK
    away: tuple[float, float] | None = None
    """From this point the label stands on the other side of its thing; None: from the origin."""


class Labels(Artist):
    """All labels of one panel."""

    def __init__(self, labels: Sequence[Label], points: Float64) -> None:
        """`points` (N, 2) are what labels had better not cover."""
        super().__init__()
        self.labels = tuple(labels)
        self.places: tuple[Rectangle, ...] = ()
        """Of the labels when they were drawn last [pixel]; those of things outside of the axes are left out."""
        self._points = points[:: max(1, -(-len(points) // MOST_POINTS))]
        self.set_in_layout(False)
        self.set_zorder(10)

    def draw(self, renderer: Any) -> None:
        """Set the labels and draw them with their lines."""
        axes, figure = self.axes, self.get_figure()
        if not self.get_visible() or not self.labels or axes is None or figure is None:
            return
        unit = renderer.points_to_pixels(1.0)
        to_pixels = axes.transData.transform
        ground = Rectangle(*axes.get_window_extent(renderer).extents)
        texts, wanted = [], []
        for label in self.labels:
            around = to_pixels(label.around)
            thing = _rectangle(around, MARK * unit if len(around) == 1 else 0.0)
            if not thing.meets(ground):
                continue
            text = self._text(label)
            box = text.get_window_extent(renderer)
            texts.append(text)
            way = around.mean(axis=0) - to_pixels(np.array([label.away or (0.0, 0.0)]))[0]
            long = float(np.hypot(*way)) or 1.0
            wanted.append(
                Wanted(
                    box.width + 2 * AIR * unit,
                    box.height + 2 * AIR * unit,
                    thing,
                    (float(way[0]) / long, float(way[1]) / long),
                )
            )
        points = to_pixels(self._points) if len(self._points) else self._points
        self.places = set_labels(wanted, points, ground, unit)
        things = [one.thing for one in wanted]
        for k, (text, place) in enumerate(zip(texts, self.places, strict=True)):
            ends = line_to(place, things[k], things[:k] + things[k + 1 :], unit)
            if ends is not None:
                self._line(renderer, ends, text.get_color())
        for text, place in zip(texts, self.places, strict=True):
            text.set_position(place.middle)
            text.draw(renderer)

    def _text(self, label: Label) -> Text:
        text = Text(
            0,
            0,
            label.text,
            color=label.colour,
            fontsize=SIZE,
            fontweight="bold",
            ha="center",
            va="center_baseline",
            transform=IdentityTransform(),
            # Not an outline: letters with one are no text in an SVG.
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.4},
        )
        text.set_figure(self.get_figure())  # type: ignore[arg-type]
        return text

    def _line(self, renderer: Any, ends: Float64, colour: Any) -> None:
        line = Line2D(ends[:, 0], ends[:, 1], color=colour, lw=0.5, transform=IdentityTransform())
        line.set_figure(self.get_figure())  # type: ignore[arg-type]
        line.draw(renderer)


def add_labels(axes: Axes, labels: Sequence[Label], points: Sequence[Float64]) -> None:
    """Put labels on axes, beside what they name and none on another; `points`, (N, 2) each, stay free where possible."""
    if labels:
        axes.add_artist(Labels(labels, np.concatenate([np.empty((0, 2)), *points])))


def along(line: Float64) -> Float64:
    """(M, 2) points all along a line of (N, 2), for labels to avoid."""
    steps = np.linspace(0.0, 1.0, STEPS, endpoint=False)[:, None]
    between: Float64 = line[:-1, None] * (1.0 - steps) + line[1:, None] * steps
    return np.concatenate([between.reshape(-1, 2), line[-1:]])


def _rectangle(around: Float64, grow: float) -> Rectangle:
    low, high = around.min(axis=0) - grow, around.max(axis=0) + grow
    return Rectangle(float(low[0]), float(low[1]), float(high[0]), float(high[1]))
