"""Maps of the HTML report: where objects were, over the walls that beams have hit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from lidarcli.reports import palette
from lidarcli.reports.distributions import Density
from lidarcli.reports.page_colours import HEAT
from lidarcli.reports.walls import Walls
from lidarcli.sweeps import Float64, Int64

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path

WALLS = "walls and rest"
"""How the legends call them."""
MOST_CELLS = 60
"""Most cells along a side of the picture."""
SIDE, LEAST, WIDEST = 3.4, 2.6, 1.5
"""Side of a square map, least width [inch], and the longest sides by the shortest."""
SEAM = 0.06
"""What each cell leaves free on its sides, so that cells can be told apart."""


def places(axes: Axes, found: Density, walls: Walls | None) -> None:
    """How often each cell had an object, in a few steps from pale to dark."""
    from matplotlib.patches import PathPatch

    draw_walls(axes, walls)
    counts, cell = _coarse(found, walls)
    ix, iy = np.nonzero(counts)
    number = counts[ix, iy]
    level = np.ceil(len(HEAT) * np.sqrt(number / number.max(initial=1))).astype(np.int64) - 1
    for step, colour in enumerate(HEAT):
        mine = level == step
        if mine.any():
            corner = np.column_stack([found.x0 + ix[mine] * cell, found.y0 + iy[mine] * cell])
            squares = _squares(corner + SEAM * cell, (1 - 2 * SEAM) * cell)
            low, high = int(number[mine].min()), int(number[mine].max())
            label = f"{low:,}" if low == high else f"{low:,} to {high:,}"
            axes.add_patch(PathPatch(squares, facecolor=colour, lw=0, zorder=3, label=label))
    if found.frame == "sensor":
        axes.plot(0, 0, marker=(3, 0, -90), color=palette.VERMILION, ms=6, ls="none", zorder=4)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    nx, ny = counts.shape
    axes.update_datalim([(found.x0, found.y0), (found.x0 + nx * cell, found.y0 + ny * cell)])
    axes.autoscale_view()
    width, height = (high - low for low, high in (axes.get_xlim(), axes.get_ylim()))
    figure = axes.get_figure(root=True)
    assert figure is not None
    across = SIDE * min(max(width / height, 1 / WIDEST), WIDEST)
    handles, labels = axes.get_legend_handles_labels()
    # What the title is about comes first.
    order = sorted(range(len(labels)), key=lambda k: labels[k] == WALLS)
    legend = figure.legend(
        [handles[k] for k in order],
        [labels[k] for k in order],
        title=f"objects in a cell of {cell:g} m",
        loc="outside lower left",
        ncols=3,
        frameon=False,
        fontsize=7,
        title_fontsize=7,
        alignment="left",
    )
    rows = -(-len(legend.get_texts()) // 3)
    figure.set_size_inches(max(across, LEAST) + 0.6, across * height / width + 0.65 + 0.14 * rows)


def _coarse(found: Density, walls: Walls | None) -> tuple[Int64, float]:
    """Counts of cells, several in one where the walls are so far away that one could not be seen, and their side."""
    nx, ny = found.counts.shape
    extent = max(nx, ny) * found.cell
    if walls is not None and len(walls.x):
        extent = max(extent, float(np.ptp(walls.x)), float(np.ptp(walls.y)))
    block = max(1, math.ceil(extent / MOST_CELLS / found.cell - 1e-9))
    along_x = np.add.reduceat(found.counts, np.arange(0, nx, block), axis=0)
    counts: Int64 = np.add.reduceat(along_x, np.arange(0, ny, block), axis=1)
    return counts, block * found.cell


def draw_walls(axes: Axes, walls: Walls | None) -> None:
    """Cells that beams have hit that lie on no object."""
    from matplotlib.patches import PathPatch

    if walls is not None and len(walls.x):
        corner = np.column_stack([walls.x, walls.y]) - walls.cell / 2
        squares = _squares(corner, walls.cell)
        axes.add_patch(PathPatch(squares, facecolor=palette.GREY, lw=0, alpha=0.6, zorder=1, label=WALLS))
        axes.update_datalim(np.vstack([corner, corner + walls.cell]))


def _squares(corner: Float64, side: float) -> Path:
    """One path of squares by their lower left corners (N, 2)."""
    from matplotlib.path import Path

    points = corner[:, None] + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(corner))
    return Path(points.reshape(-1, 2), codes)
