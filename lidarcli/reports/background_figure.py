"""A background from above: where the surfaces are, how sure that is, and where the view is open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from lidarcli.formalism.background.model import Background
from lidarcli.reports import palette
from lidarcli.reports.drawing import draw_legend, entries_of, file_bytes, fit_height, project_style
from lidarcli.reports.panels import sensor as sensor_mark
from lidarcli.reports.picture import printable

SENSOR_WIDTH = 4.2
"""Width of one sensor's picture [inch]."""
MOST_POINTS = 200_000
"""More points than this are thinned out."""
SUPPORT = "share of the sweeps that saw $r_e$"
SUPPORT_COLOURS = "viridis_r"
"""Dark is sure, as printed letters are."""
OPEN_RAY = 0.06
"""Length of the stroke that stands for an open beam, as a share of the greatest range."""


def draw(sensors: Sequence[Background], suffix: str) -> bytes:
    """Return the picture of all sensors side by side as a file of the kind of `suffix`."""
    with project_style():
        return file_bytes(background_figure(sensors), suffix)


def background_figure(sensors: Sequence[Background]) -> Figure:
    """Return the picture of all sensors as a figure; call it within `project_style`."""
    figure = Figure(figsize=(SENSOR_WIDTH * max(len(sensors), 1), SENSOR_WIDTH * 0.95), layout="constrained")
    FigureCanvasAgg(figure)
    drawn = figure.subplots(1, max(len(sensors), 1), squeeze=False)[0].tolist()
    for axes, sensor in zip(drawn, sensors, strict=False):
        _panel(axes, sensor)
    draw_legend(figure, entries_of(drawn), "outside lower left")
    sides = [(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim())) for axes in drawn]
    fit_height(figure, drawn, [0.0] * len(drawn), float(min(width / height for width, height in sides)))
    return figure


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
    support = sensor.support[surface][thin]
    low, high = _shown(support)
    drawn = axes.scatter(
        x[surface][thin],
        y[surface][thin],
        c=support,
        cmap=SUPPORT_COLOURS,
        vmin=low,
        vmax=high,
        s=3.0,
        linewidths=0,
        rasterized=True,
    )
    # Beside the axes themselves, so that it is as high as they are.
    beside = axes.inset_axes((1.03, 0.0, 0.035, 1.0))
    bar = axes.figure.colorbar(drawn, cax=beside, label=SUPPORT)
    bar.ax.yaxis.set_major_formatter(PercentFormatter(1.0, decimals=0))
    if not posed:
        _open_beams(axes, sensor, direction[0] if len(sensor) else direction.reshape(-1))
    for station in range(len(sensor)):
        sensor_mark(axes, float(x0[station]), float(y0[station]), float(yaw[station]), 4.0 if posed else 6.0)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    stations = f"{len(sensor)} station{'' if len(sensor) == 1 else 's'}"
    axes.set_title(
        f"{printable(sensor.topic)}  {printable(sensor.frame_id)}: {stations}, {int(sensor.sweeps.sum()):,} sweeps"
    )


def _shown(support: np.ndarray[Any, np.dtype[Any]]) -> tuple[float, float]:
    """Return the range of the colour bar, in tenths: only support that occurs, so that small differences are seen."""
    if not len(support):
        return 0.0, 1.0
    low = np.floor(10.0 * float(support.min()) + 1e-6) / 10.0
    high = np.ceil(10.0 * float(support.max()) - 1e-6) / 10.0
    return (float(low), float(high)) if high > low else (float(high) - 0.1, float(high))


def _open_beams(axes: Axes, sensor: Background, direction: np.ndarray[Any, np.dtype[np.float64]]) -> None:
    """Draw short strokes outside everything, in the directions from which nothing returns."""
    r_e = sensor.r_e[0] if len(sensor) else np.empty(0)
    known = r_e[np.isfinite(r_e)]
    reach = float(known.max()) if len(known) else 1.0
    way = direction[np.isinf(r_e)]
    ends = np.array([1.0 + OPEN_RAY, 1.0 + 2 * OPEN_RAY]) * reach
    axes.plot(
        np.cos(way) * ends[:, None], np.sin(way) * ends[:, None], color=palette.LIGHT, linewidth=0.6, zorder=0
    )
    if len(way):
        axes.plot([], [], color=palette.LIGHT, linewidth=1.2, label="open: nothing returns")
