"""A background from above: where the surfaces are, how sure that is, and where the view is open."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.formalism.background.model import Background
from lidarcli.reports import palette
from lidarcli.reports.drawing import project_style
from lidarcli.reports.picture import printable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SENSOR_WIDTH = 4.2
"""Width of one sensor's picture [inch]."""
MOST_POINTS = 200_000
"""More points than this are thinned out."""
OPEN_RAY = 0.06
"""Length of the stroke that stands for an open beam, as a share of the greatest range."""


def draw(sensors: Sequence[Background], suffix: str) -> bytes:
    """The picture of all sensors side by side as a file of the kind of `suffix`; the same background, the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with project_style():
        figure = Figure(
            figsize=(SENSOR_WIDTH * max(len(sensors), 1), SENSOR_WIDTH * 0.95), layout="constrained"
        )
        FigureCanvasAgg(figure)
        for number, sensor in enumerate(sensors, 1):
            _panel(figure.add_subplot(1, len(sensors), number), sensor)
        out = io.BytesIO()
        dates: dict[str, dict[str, Any]] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
        figure.savefig(out, format=suffix[1:], metadata=dates.get(suffix))
    return out.getvalue()


def _panel(axes: Axes, sensor: Background) -> None:
    theta = np.tile(sensor.grid.bearings(), (len(sensor), 1))
    posed = bool(sensor.posed.any())
    x0, y0, yaw = sensor.poses.x, sensor.poses.y, sensor.poses.yaw
    if not posed:
        x0, y0, yaw = np.zeros(len(sensor)), np.zeros(len(sensor)), np.zeros(len(sensor))
    side = np.where(sensor.poses.upside_down, -1.0, 1.0)
    direction = yaw[:, None] + side[:, None] * theta
    surface = np.isfinite(sensor.r_e)
    distance = np.where(surface, sensor.r_e, 0.0)
    x, y = x0[:, None] + distance * np.cos(direction), y0[:, None] + distance * np.sin(direction)
    thin = slice(None, None, max(1, int(np.count_nonzero(surface)) // MOST_POINTS))
    drawn = axes.scatter(
        x[surface][thin],
        y[surface][thin],
        c=sensor.support[surface][thin],
        cmap="viridis_r",
        vmin=0.0,
        vmax=1.0,
        s=3.0,
        linewidths=0,
        rasterized=True,
    )
    axes.figure.colorbar(drawn, ax=axes, label="support of $r_e$", shrink=0.8)
    if not posed:
        _open_beams(axes, sensor, direction[0] if len(sensor) else direction.reshape(-1))
    axes.plot(x0, y0, marker="^", linestyle="none", color=palette.VERMILION, markersize=4 if posed else 6)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    stations = f"{len(sensor)} station{'' if len(sensor) == 1 else 's'}"
    axes.set_title(
        f"{printable(sensor.topic)}  {printable(sensor.frame_id)}: {stations}, {int(sensor.sweeps.sum()):,} sweeps"
    )


def _open_beams(axes: Axes, sensor: Background, direction: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    """Short strokes outside everything, in the directions from which nothing returns."""
    r_e = sensor.r_e[0] if len(sensor) else np.empty(0)
    known = r_e[np.isfinite(r_e)]
    reach = float(known.max()) if len(known) else 1.0
    way = direction[np.isinf(r_e)]
    ends = np.array([1.0 + OPEN_RAY, 1.0 + 2 * OPEN_RAY]) * reach
    axes.plot(
        np.cos(way) * ends[:, None], np.sin(way) * ends[:, None], color=palette.LIGHT, linewidth=0.6, zorder=0
    )
