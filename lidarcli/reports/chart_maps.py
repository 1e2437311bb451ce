"""Maps of the HTML report: where objects were, over the walls that beams have hit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from lidarcli.reports import palette
from lidarcli.reports.distributions import Density
from lidarcli.reports.page_colours import HEAT
from lidarcli.reports.walls import Walls
from lidarcli.sweeps import Float64

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.path import Path

SEAM = 0.06
"""What each cell leaves free on its sides, so that cells can be told apart."""


def places(axes: Axes, found: Density, walls: Walls | None) -> None:
    """How often each cell had an object, in a few steps from pale to dark."""
    from matplotlib.patches import Patch, PathPatch

    draw_walls(axes, walls)
    ix, iy = np.nonzero(found.counts)
    counts = found.counts[ix, iy]
    most = int(counts.max(initial=1))
    level = np.ceil(len(HEAT) * np.sqrt(counts / most)).astype(np.int64) - 1
    handles = []
    for step, colour in enumerate(HEAT):
        mine = level == step
        if mine.any():
            corner = np.column_stack([found.x0 + ix[mine] * found.cell, found.y0 + iy[mine] * found.cell])
            squares = _squares(corner + SEAM * found.cell, (1 - 2 * SEAM) * found.cell)
            axes.add_patch(PathPatch(squares, facecolor=colour, lw=0, zorder=3))
            low, high = int(counts[mine].min()), int(counts[mine].max())
            handles.append(Patch(color=colour, label=f"{low:,}" if low == high else f"{low:,} to {high:,}"))
    if walls is not None:
        handles.append(Patch(color=palette.GREY, label="walls and rest"))
    if found.frame == "sensor":
        axes.plot(0, 0, marker=(3, 0, -90), color=palette.VERMILION, ms=6, ls="none", zorder=4)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    nx, ny = found.counts.shape
    axes.update_datalim([(found.x0, found.y0), (found.x0 + nx * found.cell, found.y0 + ny * found.cell)])
    axes.autoscale_view()
    assert axes.figure is not None
    axes.figure.legend(
        handles=handles,
        title=f"objects in a cell of {found.cell:g} m",
        loc="outside right upper",
        frameon=False,
        fontsize=7,
        title_fontsize=7,
    )


def draw_walls(axes: Axes, walls: Walls | None) -> None:
    """Cells that beams have hit that lie on no object."""
    from matplotlib.patches import PathPatch

    if walls is not None and len(walls.x):
        corner = np.column_stack([walls.x, walls.y]) - walls.cell / 2
        axes.add_patch(
            PathPatch(_squares(corner, walls.cell), facecolor=palette.GREY, lw=0, alpha=0.6, zorder=1)
        )
        axes.update_datalim(np.vstack([corner, corner + walls.cell]))


def _squares(corner: Float64, side: float) -> Path:
    """One path of squares by their lower left corners (N, 2)."""
    from matplotlib.path import Path

    points = corner[:, None] + side * np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])
    codes = np.tile([Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY], len(corner))
    return Path(points.reshape(-1, 2), codes)
