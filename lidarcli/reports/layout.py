"""Which panels a view has, where they stand, and how large the picture is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from lidarcli.choices import Look
from lidarcli.reports import panels
from lidarcli.reports.picture import Limits, Picture
from lidarcli.reports.scene import scene

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Panel = Callable[["Axes", Picture, Limits], None]

WIDE, MIDDLE, NARROW = 7.2, 5.04, 3.5
"""Widths of two columns of a paper, of what is between, and of one column [inch]."""
WIDTHS = {"all": WIDE, "scene": NARROW, "polar": NARROW}
ELONGATED = 1.5
"""A scene that is so many times as wide as high stands above its curves …"""
COLUMNS = 5.0
"""… and so does every scene in a picture narrower than this [inch]."""
CURVE, LOW_CURVE = 1.3, 1.1
"""Height of a curve beside a scene or alone at least, and of one below a scene [inch]."""
ROUNDS = 5
ENOUGH = 0.01
"""A height that is as right as this [inch] is not tried again."""
TALLEST = 2.2
"""A scene is at most so many times as high as its place is wide."""


@dataclass(frozen=True, slots=True)
class Place:
    """A panel of a view, in a grid."""

    panel: Panel
    rows: tuple[int, int]
    """First row and the one after the last."""
    column: int
    height: float
    """What it wants [inch]; 0 for a scene, which wants what its width and its content make."""
    shares: bool = False
    """Whether the panel below tells the bearings of both."""
    polar: bool = False


def width_of(view: str, look: Look) -> float:
    """Width of the whole picture [inch]."""
    return look.inches(WIDTHS.get(view, MIDDLE))


def is_stacked(limits: Limits, width: float) -> bool:
    """Whether the scene of the view `all` stands above its curves."""
    return limits.aspect > ELONGATED or width < COLUMNS


def places_of(picture: Picture, view: str, limits: Limits, look: Look) -> list[Place]:
    """The panels of a view."""
    above = partial(scene, vertices=look.vertices)
    compared: list[Panel] = [] if picture.background is None else [panels.backgrounds, panels.subtraction]
    width = width_of(view, look)
    if view == "scene":
        return [Place(above, (0, 1), 0, 0.0)]
    if view == "polar":
        return [Place(partial(panels.polar, vertices=look.vertices), (0, 1), 0, 0.8 * width, polar=True)]
    if view != "all":
        curves = (
            (compared or [panels.difference]) if view == "difference" else [panels.sweep, panels.difference]
        )
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
    return [
        Place(panel, (first + row, first + row + 1), 0, height, shares=row < last)
        for row, panel in enumerate(curves)
    ]


def add_axes(figure: Figure, places: Sequence[Place], limits: Limits) -> list[Axes]:
    """The axes of all panels."""
    rows = max(place.rows[1] for place in places)
    columns = max(place.column for place in places) + 1
    # As wide as the scene is at the height of two curves, as far as both stay readable.
    share = min(max(0.46 * limits.aspect, 0.3), 0.54)
    ratios = [share, 1.0 - share] if columns == 2 else [1.0]
    grid = figure.add_gridspec(rows, columns, width_ratios=ratios)
    return [
        figure.add_subplot(
            grid[place.rows[0] : place.rows[1], place.column],
            projection="polar" if place.polar else None,
        )
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
    # What is drawn outside of the axes may take more room once these are larger.
    for _ in range(ROUNDS):
        figure.draw_without_rendering()
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
        assert grids[0] is not None
        grids[0].get_gridspec().set_height_ratios([want[row] for row in sorted(want)])
        more = sum(want.values()) - sum(have.values())
        figure.set_size_inches(width, height + more)
        if abs(more) < ENOUGH:
            break
    figure.draw_without_rendering()
