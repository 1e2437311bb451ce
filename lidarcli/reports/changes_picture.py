"""Picture of what changed from run to run: the ground grey, new vermilion, gone blue, moved as an arrow."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from lidarcli.formalism.mapping.occupancy import Occupancy
from lidarcli.reports import palette
from lidarcli.reports.drawing import file_bytes, project_style
from lidarcli.reports.map_picture import Box, MapPicture, corners_of, map_figure

SMALLEST = 0.1
"""Least side of a box that is drawn [m]."""
GREYS = 0.45, 0.9, 1.0
"""Greys of occupied, free and unseen cells."""
HATCH = "////"
STYLES: dict[str, tuple[str, str, dict[str, Any]]] = {
    "known": (palette.DARK, "known", {"fill": False, "lw": 0.8}),
    "moved": (palette.GREEN, "moved", {"alpha": 0.5, "lw": 1.0}),
    "new": (palette.VERMILION, "new", {"alpha": 0.7, "lw": 1.0}),
    "gone": (palette.BLUE, "gone", {"alpha": 0.7, "lw": 1.0}),
    "uncertain": (palette.GREY, "uncertain", {"fill": False, "hatch": HATCH, "lw": 0.6}),
}
"""Status → colour, words of the legend and style."""


def draw_changes(changes: pa.Table, ground: Occupancy | None) -> bytes:
    """Return the changes, a table with the schema `CHANGES`, on the ground of the first run, as a .png."""
    rows = changes.to_pylist()
    boxes = [(row, _box(row, run)) for row in rows for run in _runs(row)]

    def draw(axes: Axes) -> None:
        for row, box in boxes:
            _patch(axes, row["status"], box)
        for row in rows:
            if row["status"] == "moved":
                axes.annotate(
                    "",
                    (row["x_b"], row["y_b"]),
                    (row["x_a"], row["y_a"]),
                    arrowprops={"arrowstyle": "->", "color": palette.GREEN, "lw": 1.2},
                    zorder=8,
                )

    picture = MapPicture(ground, others=[box for _, box in boxes])
    with project_style({"axes.grid": False}):
        return file_bytes(map_figure(picture, greys=GREYS, draw=draw), ".png")


def _runs(row: dict[str, Any]) -> tuple[str, ...]:
    """Return the runs in which a thing is drawn: both of what was moved, else the last that has it."""
    if row["status"] == "moved":
        return "a", "b"
    return ("a",) if row["x_b"] is None else ("b",)


def _box(row: dict[str, Any], run: str) -> Box:
    length = max(row["length"] or SMALLEST, SMALLEST)
    return Box(
        row[f"x_{run}"], row[f"y_{run}"], row[f"yaw_{run}"], length, max(row["width"] or SMALLEST, SMALLEST)
    )


def _patch(axes: Axes, status: str, box: Box) -> None:
    """Draw one thing; the first of a status is in the legend."""
    colour, words, style = STYLES[status]
    drawn = {patch.get_label() for patch in axes.patches}
    axes.add_patch(
        Polygon(
            np.asarray(corners_of(box)),
            label=f"_{words}" if words in drawn else words,
            edgecolor=colour,
            facecolor=colour if style.get("fill", True) else "none",
            zorder=7,
            **style,
        )
    )
