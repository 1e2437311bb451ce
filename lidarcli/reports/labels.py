"""The labels of a panel: beside what they name, none on another, and away from what is drawn.

They are placed when the figure is drawn, for only then is known how large it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import IdentityTransform

from lidarcli import palette
from lidarcli.sweeps import Bool, Float64

RINGS = np.array([1.0, 3.0, 6.0, 10.0, 15.0, 21.0, 28.0, 38.0, 52.0])
"""Distances from an object at which its label is tried [pt]."""
TURNS = np.arange(24) * (2.0 * np.pi / 24)
"""Directions in which a label is tried [rad]."""
NEAR = 6.0
"""Greatest distance of a label without a line to its object [pt]."""
PER_POINT, PER_OBJECT, PER_SIDE, PER_DISTANCE, PER_CROSSING, AMBIGUOUS = 0.8, 8.0, 1.2, 0.35, 6.0, 4.0
"""Costs: a drawn point under the label, an object under it, a side towards the sensor, each point [pt] of distance,
a line across another label or object, and a place that is nearer to another object."""
SIZE, AIR, MARK = 6.5, 0.8, 2.0
"""Size of the letters, margin around them, and room that a mark takes about its point [pt]."""


class Label(NamedTuple):
    """A text and the object that it names."""

    text: str
    around: Float64
    """(N, 2) outline of the object in the coordinates of the axes; of a mark its one point."""
    colour: str = palette.BLACK
    away: tuple[float, float] = (0.0, 0.0)
    """Point on the far side of the object from the label."""


class Labels(Artist):
    """All labels of one panel."""

    def __init__(self, labels: Sequence[Label], lines: Sequence[Float64], points: Float64) -> None:
        """Keep labels, and lines and points that they avoid, (N, 2) each."""
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
                line = Line2D(*ends.T, color=text.get_color(), lw=0.5, transform=IdentityTransform())
                line.set(figure=axes.figure)
                line.draw(renderer)
            text.set_position((0.5 * (place[0] + place[2]), 0.5 * (place[1] + place[3])))
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
    view : (4,) edges within which labels stand [pixel]
    unit : pixels of a typographic point
    """
    places, boxes = np.full((len(sizes), 4), np.inf), np.reshape(objects, (-1, 4))
    ways = np.column_stack([np.cos(TURNS), np.sin(TURNS)])
    # On a rectangle around the object, so that the label never stands on what it names.
    edge, rings = ways / np.abs(ways).max(axis=1, keepdims=True), RINGS[:, None, None] * unit
    # Those with the most neighbours come first.
    for k in np.argsort(-(_gaps(boxes, boxes) < RINGS[-1] * unit).sum(axis=1), kind="stable").tolist():
        own, others, half = boxes[k], np.delete(boxes, k, axis=0), 0.5 * sizes[k]
        middle = 0.5 * (own[:2] + own[2:])
        centres = (middle + edge * (own[2:] - middle + half + rings)).reshape(-1, 2)
        tried = np.hstack([centres - half, centres + half])
        gaps, line = _gaps(tried, others), np.linspace(centres, np.broadcast_to(middle, centres.shape), 12)
        near = drawn[_inside(drawn[None], np.hstack([tried.min(axis=0)[:2], tried.max(axis=0)[2:]])[None])[0, :, 0]]
        costs = (PER_DISTANCE * RINGS[:, None] + PER_SIDE * (1.0 - ways @ sides[k])).ravel()
        costs += PER_POINT * _inside(near[None], tried)[0].sum(axis=0) + PER_OBJECT * (gaps == 0.0).sum(axis=1)
        costs += AMBIGUOUS * (gaps < _gaps(tried, own[None])).any(axis=1)
        costs += PER_CROSSING * _inside(line, np.vstack([others, places])).any(axis=0).sum(axis=1)
        if not np.isfinite(costs := costs + _barred(tried, view, places)).any():
            # The nearest free place of the whole panel.
            x, y = (np.arange(view[i] + half[i], view[i + 2] - half[i] + 1e-9, max(sizes[k][i], unit)) for i in (0, 1))
            centres = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) if len(x) and len(y) else centres
            tried = np.hstack([centres - half, centres + half])
            costs = np.hypot(*(centres - middle).T) + _barred(tried, view, places)
        places[k] = tried[int(np.argmin(costs))]
    return places


def line_to(place: Float64, k: int, objects: Float64, unit: float) -> Float64 | None:
    """Return (2, 2) ends of the line from a label to object k; None where it stands close to that alone."""
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


def _barred(boxes: Float64, view: Float64, places: Float64) -> Float64:
    """Return (C,) infinity for rectangles that are taken or reach out of the view, else 0."""
    outside = (boxes[:, :2] < view[:2] - 1e-6).any(axis=1) | (boxes[:, 2:] > view[2:] + 1e-6).any(axis=1)
    return np.where(outside | (_gaps(boxes, places) == 0.0).any(axis=1), np.inf, 0.0)


def _sampled(line: Float64, step: float) -> Float64:
    """Return (M, 2) points along a line, `step` apart or more."""
    along = np.concatenate([[0.0], np.cumsum(np.nan_to_num(np.hypot(*np.diff(line, axis=0).T)))])
    at = np.linspace(0.0, along[-1], int(min(along[-1] / step + 2, 200)))
    return np.column_stack([np.interp(at, along, line[:, k]) for k in (0, 1)])
