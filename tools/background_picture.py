"""The picture of docs/background.md: what `detect` finds in a log of people, without its background and with it.

`python -m tools.background_picture LOG FIG`, for the log that the page names.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import lidarcli
from lidarcli.display import palette
from lidarcli.formalism.background import Background
from lidarcli.reports.drawing import draw_marks, project_style
from lidarcli.reports.drawing import sensor as sensor_mark


def main(log: str, picture: str) -> None:
    """Learn the background from the log itself, find the objects twice, draw their centres."""
    (sensor,) = lidarcli.background(log)
    found = {
        "every sweep by itself": lidarcli.detect(log),
        "against the background": lidarcli.detect(log, background=[sensor]),
    }
    sweeps = int(sensor.sweeps[0])
    with project_style():
        figure = Figure(figsize=(7.2, 4.6), layout="constrained")
        FigureCanvasAgg(figure)
        for number, (title, table) in enumerate(found.items(), 1):
            axes = figure.add_subplot(1, 2, number)
            _background(axes, sensor)
            axes.plot(
                table["x"].to_numpy(),
                table["y"].to_numpy(),
                ".",
                color=palette.BLUE,
                markersize=2,
                alpha=0.25,
                markeredgewidth=0,
                rasterized=True,
            )
            draw_marks(axes, [sensor_mark()])
            axes.set_aspect("equal")
            axes.set_xlabel("x [m]")
            axes.set_ylabel("y [m]")
            mean = table.num_rows / sweeps
            axes.set_title(f"{title}: {table.num_rows:,} objects, {mean:.1f} per sweep")
        figure.savefig(picture, dpi=150)


def _background(axes: Any, sensor: Background) -> None:
    theta, r_e = sensor.grid.bearings, sensor.r_e[0]
    known = np.isfinite(r_e)
    axes.plot(
        (r_e * np.cos(theta))[known],
        (r_e * np.sin(theta))[known],
        ".",
        color=palette.ORANGE,
        markersize=4,
        markeredgewidth=0,
    )


if __name__ == "__main__":
    main(*sys.argv[1:3])
