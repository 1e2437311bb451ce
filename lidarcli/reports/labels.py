"""The labels of a picture: beside what they name, none on another, and away from what is drawn.

They are set when the picture is drawn, for only then is known how large it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import IdentityTransform
from numpy.typing import NDArray

from lidarcli.reports import palette
from lidarcli.sweeps import Float64, Int64

RINGS = (1.0, 3.0, 6.0, 10.0, 15.0, 21.0, 28.0, 38.0, 52.0)
"""Distances from an object at which its label is tried [pt]."""
WAYS = 24
"""Number of directions in which a label is tried."""
ROUNDS = 3
"""The first round sets every label, the others move those that a later one left in a bad place."""
NEAR = 6.0
"""Greatest distance of a label without a line to its object [pt]."""
PER_POINT, PER_THING, PER_WAY, PER_DISTANCE, PER_CROSSING, AMBIGUOUS = 0.8, 8.0, 1.2, 0.35, 6.0, 4.0
"""Costs: a point under the label, another object under it, a side towards the sensor, each point [pt] of distance,
a line across another label or object, and a place that is nearer to another object."""

FORBIDDEN = 1e6
"""Cost of a place that is taken or lies outside."""
SIZE = 6.5
"""Size of the letters [pt]."""
STEPS = 8
"""Points of each piece of a line."""
AIR = 0.8
"""Margin around the letters [pt]."""
MARK = 2.0
"""Room that a mark takes about its point [pt]."""
MOST_POINTS = 4_000
"""Most points that labels avoid; of more some are left out."""


class Rectangle(NamedTuple):
    """An upright rectangle, in pixels."""

    left: float
    low: float
    right: float
    high: float

    def meets(self, other: Rectangle) -> bool:
        """Return True if the two rectangles overlap."""
        return self.left < other.right and other.left < self.right and self.low < other.high and other.low < self.high

    @property
    def middle(self) -> tuple[float, float]:
        """Centre of the rectangle."""
        return 0.5 * (self.left + self.right), 0.5 * (self.low + self.high)

    def nearest(self, x: float, y: float) -> tuple[float, float]:
        """Return the point of the rectangle that is nearest to another point."""
        return min(max(x, self.left), self.right), min(max(y, self.low), self.high)


class Wanted(NamedTuple):
    """A label to set, in pixels."""

    width: float
    height: float
    thing: Rectangle
    """Rectangle around the object of the label."""
    way: tuple[float, float]
    """Unit vector from the object to the best side for the label."""


def set_labels(wanted: Sequence[Wanted], points: Float64, ground: Rectangle, unit: float) -> tuple[Rectangle, ...]:
    """Return a place for each label in `ground`; no two of them overlap while there is room.

    Parameters
    ----------
    points : (N, 2) what labels had better not cover [pixel]
    unit : pixels of a typographic point
    """
    if not wanted:
        return ()
    things = np.array([one.thing for one in wanted], np.float64).reshape(-1, 4)
    counts = _Counts(points, ground, unit)
    tried = [_Tried(wanted, k, things, counts, ground, unit) for k in range(len(wanted))]
    places: dict[int, Rectangle] = {}
    for _ in range(ROUNDS):
        before = dict(places)
        for k, one in enumerate(tried):
            places[k] = one.best([place for other, place in places.items() if other != k])
        if places == before:
            break
    return tuple(places[k] for k in range(len(wanted)))


def line_to(place: Rectangle, thing: Rectangle, others: Sequence[Rectangle], unit: float) -> Float64 | None:
    """Return (2, 2) ends of the line from a label to what it names; None where it stands close to that alone."""
    x, y = place.middle
    end = thing.nearest(x, y)
    start = place.nearest(*end)
    mine = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    crowd = any(_distance(place, other) < 1.3 * mine for other in others)
    if mine <= (0.5 * NEAR if crowd else NEAR) * unit:
        return None
    return np.array([start, end])


def _distance(one: Rectangle, other: Rectangle) -> float:
    across = max(other.left - one.right, one.left - other.right, 0.0)
    along = max(other.low - one.high, one.low - other.high, 0.0)
    return float(np.hypot(across, along))


class _Counts:
    """Numbers of points in rectangles of the ground, in cells of a typographic point: each is four look-ups."""

    def __init__(self, points: Float64, ground: Rectangle, unit: float) -> None:
        self._origin, self._unit = np.array([ground.left, ground.low]), unit
        size = np.maximum(np.ceil((np.array([ground.right, ground.high]) - self._origin) / unit), 1)
        self._shape = size.astype(np.int64)
        cells = np.floor((points - self._origin) / unit).astype(np.int64)
        x, y = cells[((cells >= 0) & (cells < self._shape)).all(axis=1)].T
        columns, rows = self._shape.tolist()
        counts = np.bincount(x * rows + y, minlength=columns * rows).reshape(columns, rows)
        # Of each corner the points below and to the left of it.
        self._below = np.pad(counts.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))

    def within(self, low: Float64, high: Float64) -> Int64:
        """Return (C,) points of the cells that rectangles (C, 2) touch."""
        first = np.clip(np.floor((low - self._origin) / self._unit), 0, self._shape).astype(np.int64)
        last = np.clip(np.ceil((high - self._origin) / self._unit), 0, self._shape).astype(np.int64)
        (x0, y0), (x1, y1), below = first.T, last.T, self._below
        within: Int64 = below[x1, y1] - below[x0, y1] - below[x1, y0] + below[x0, y0]
        return within


class _Tried:
    """The places that are tried for one label, and the cost of each."""

    def __init__(
        self, wanted: Sequence[Wanted], k: int, things: Float64, counts: _Counts, ground: Rectangle, unit: float
    ) -> None:
        mine = wanted[k]
        self._thing = mine.thing
        turns = np.arange(WAYS) * (2.0 * np.pi / WAYS)
        ways = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        # On a rectangle around the thing, so that the label never stands on what it names.
        edge = ways / np.abs(ways).max(axis=1, keepdims=True)
        rings = np.array(RINGS) * unit
        size = np.array([mine.width, mine.height])
        half = 0.5 * (np.array([mine.thing.right - mine.thing.left, mine.thing.high - mine.thing.low]) + size)
        centre = np.array(mine.thing.middle)
        middles = centre + (edge[None] * (half + rings[:, None, None])).reshape(-1, 2)
        costs = np.repeat(PER_DISTANCE * rings / unit, WAYS)
        costs += np.tile(PER_WAY * (1.0 - ways @ np.array(mine.way)), len(rings))
        self._low, self._high = middles - 0.5 * size, middles + 0.5 * size
        inside = (
            (self._low[:, 0] >= ground.left)
            & (self._low[:, 1] >= ground.low)
            & (self._high[:, 0] <= ground.right)
            & (self._high[:, 1] <= ground.high)
        )
        costs += PER_POINT * counts.within(self._low, self._high)
        others = np.delete(things, k, axis=0)
        costs += PER_THING * _meeting(self._low, self._high, others).sum(axis=1)
        gaps = self._gaps(others)
        mine_gap = self._gaps(np.array([mine.thing]))
        costs += AMBIGUOUS * (gaps < mine_gap).any(axis=1)
        costs += PER_CROSSING * self._crossed(middles, centre, others).sum(axis=1)
        self._costs = np.where(inside, costs, FORBIDDEN)
        self._middles, self._centre, self._size, self._ground = middles, centre, size, ground

    def best(self, taken: Sequence[Rectangle]) -> Rectangle:
        """Return the cheapest place that no other label has."""
        costs = self._costs
        if taken:
            others = np.array(taken)
            costs = costs + PER_CROSSING * self._crossed(self._middles, self._centre, others).sum(axis=1)
            costs = np.where(_meeting(self._low, self._high, others).any(axis=1), FORBIDDEN, costs)
        at = int(np.argmin(costs))
        if costs[at] >= FORBIDDEN and (anywhere := self._anywhere(taken)) is not None:
            return anywhere
        return Rectangle(*map(float, (*self._low[at], *self._high[at])))

    def _anywhere(self, taken: Sequence[Rectangle]) -> Rectangle | None:
        """Return the nearest free place of the whole ground."""
        middles = _everywhere(self._ground, self._size)
        low, high = middles - 0.5 * self._size, middles + 0.5 * self._size
        free = ~_meeting(low, high, np.array(taken, np.float64).reshape(-1, 4)).any(axis=1)
        if not free.any():
            return None
        far = np.where(free, np.hypot(*(middles - self._centre).T), np.inf)
        at = int(np.argmin(far))
        return Rectangle(*map(float, (*low[at], *high[at])))

    def _gaps(self, others: Float64) -> Float64:
        """Return (C, R) distance of each place from rectangles."""
        low, high = self._low[:, None], self._high[:, None]
        apart = np.maximum(np.maximum(others[None, :, :2] - high, low - others[None, :, 2:]), 0.0)
        gaps: Float64 = np.hypot(apart[..., 0], apart[..., 1])
        return gaps

    @staticmethod
    def _crossed(start: Float64, end: Float64, others: Float64) -> NDArray[np.bool_]:
        """Return (C, R) True where a rectangle lies on the line from a place to the thing."""
        way = (end - start)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            low, high = ((others[None, :, :2] - start[:, None]) / way, (others[None, :, 2:] - start[:, None]) / way)
        enters = np.minimum(low, high).max(axis=2)
        leaves = np.maximum(low, high).min(axis=2)
        crossed: NDArray[np.bool_] = (enters < leaves) & (enters < 1.0) & (leaves > 0.0)
        return crossed


def _meeting(low: Float64, high: Float64, others: Float64) -> NDArray[np.bool_]:
    """Return (C, R) True where a place overlaps a rectangle."""
    met = (low[:, None] < others[:, 2:]) & (others[:, :2] < high[:, None])
    return np.asarray(met.all(axis=2), np.bool_)


def _everywhere(ground: Rectangle, size: Float64) -> Float64:
    """Return (N, 2) middles of places all over the ground."""
    x = np.arange(ground.left + 0.5 * size[0], ground.right - 0.5 * size[0] + 1e-9, max(size[0], 1.0))
    y = np.arange(ground.low + 0.5 * size[1], ground.high - 0.5 * size[1] + 1e-9, max(size[1], 1.0))
    across, along = np.meshgrid(x[:60], y[:60])
    return np.stack([across.ravel(), along.ravel()], axis=1)


class Label(NamedTuple):
    """A text and the object that it names."""

    text: str
    around: Float64
    """(N, 2) outline of the object in the coordinates of the axes; of a mark its one point."""
    colour: str = palette.BLACK
    away: tuple[float, float] | None = None
    """Point on the far side of the object from the label; None: the origin."""


class Labels(Artist):
    """All labels of one panel."""

    def __init__(self, labels: Sequence[Label], points: Float64) -> None:
        """Keep labels, and (N, 2) points that they had better not cover."""
        super().__init__()
        self.labels = tuple(labels)
        self.places: tuple[Rectangle, ...] = ()
        """Places of the labels when they were drawn last [pixel], without labels of things outside of the axes."""
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
        edge = AIR * unit
        inner = Rectangle(ground.left + edge, ground.low + edge, ground.right - edge, ground.high - edge)
        self.places = set_labels(wanted, points, inner, unit)
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
    """Return (M, 2) points all along a line of (N, 2), for labels to avoid."""
    steps = np.linspace(0.0, 1.0, STEPS, endpoint=False)[:, None]
    between: Float64 = line[:-1, None] * (1.0 - steps) + line[1:, None] * steps
    return np.concatenate([between.reshape(-1, 2), line[-1:]])


def _rectangle(around: Float64, grow: float) -> Rectangle:
    low, high = around.min(axis=0) - grow, around.max(axis=0) + grow
    return Rectangle(float(low[0]), float(low[1]), float(high[0]), float(high[1]))
