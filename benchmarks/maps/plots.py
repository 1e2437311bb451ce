"""The picture of a simulated drive in docs/maps.md: its map beside the true one."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from benchmarks.maps.recordings import Drive
from benchmarks.maps.scenes import walkers
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, Occupancy

GREYS = {OCCUPIED: 0.05, FREE: 1.0}
UNKNOWN_GREY = 0.85
COLOURS = 24
"""Of the file: it is a fourth as long with so few."""


def plot(driven: Drive, grid: Occupancy, target: Path) -> None:
    """The ways of robot and people on the true map, and the map that was made."""
    seconds = np.arange(driven.scene.sweeps) / driven.scene.sensor.rate
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rc("font", size=8)
        figure = Figure(figsize=(9.2, 3.8), layout="constrained")
        left = figure.add_subplot(1, 2, 1)
        right = figure.add_subplot(1, 2, 2, sharex=left, sharey=left)
        _ground(left, driven.true)
        for number, walker in enumerate(walkers(driven.scene)):
            x, y, _ = walker.poses(seconds).T
            left.plot(x, y, color="tab:orange", linewidth=0.4, label="" if number else "people")
        left.plot(*driven.poses[:, :2].T, color="tab:green", linewidth=1.2, label="robot")
        left.set_title("true map, and who goes about")
        left.legend(loc="lower right", frameon=True)
        _ground(right, grid)
        right.set_title("lidarcli map")
        for axes in (left, right):
            axes.set(aspect="equal", xlabel="x [m]")
        left.set_ylabel("y [m]")
        FigureCanvasAgg(figure)
        drawn = io.BytesIO()
        figure.savefig(drawn, dpi=100, metadata={"Software": None})
    target.parent.mkdir(parents=True, exist_ok=True)
    with Image.open(drawn) as picture:
        picture.convert("RGB").quantize(COLOURS).save(target, optimize=True)


def _ground(axes: Axes, grid: Occupancy) -> None:
    grey = np.full(grid.cells.shape, UNKNOWN_GREY)
    for state, shade in GREYS.items():
        grey[grid.cells == state] = shade
    rows, columns = grid.cells.shape
    side = grid.resolution
    extent = (grid.x, grid.x + columns * side, grid.y, grid.y + rows * side)
    axes.imshow(grey, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", interpolation="antialiased", extent=extent)
