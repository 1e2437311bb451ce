"""The figures of docs/accuracy.md: small, and the same bytes for the same numbers."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.accuracy.cells import CELLS, points_xy, simulate
from benchmarks.accuracy.methods import ROBUST, labels_of
from benchmarks.accuracy.objects import Tally
from benchmarks.scenes.random import KINDS, SENSORS, random_scene, sensor_with
from lidarcli.formalism import Parameters, detect

COLOURS = ("#0b6e4f", "#c1121f", "#e07a5f", "#3d5a80", "#5fa8d3", "#8d6a9f", "#b08900", "#7f7f7f")
_LABELS = {"room": "rooms", "corridor": "corridors", "hall": "halls"}
_METADATA = {"Software": None}
_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) / 2


def _style() -> None:
    mpl.rcdefaults()
    mpl.rc("font", size=8)
    mpl.rc("axes.spines", top=False, right=False)


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    FigureCanvasAgg(figure)
    figure.savefig(path, dpi=110, metadata=_METADATA, pil_kwargs={"optimize": True})


def plot_cells(tally: Tally, path: Path) -> None:
    """F1 of every method in every cell."""
    with mpl.rc_context():
        _style()
        figure = Figure(figsize=(9.2, 3.4), layout="constrained")
        axes = figure.subplots(1, len(KINDS), sharey=True)
        for axis, kind in zip(axes, KINDS, strict=True):
            cells = [cell for cell in CELLS if cell.kind == kind]
            for number, method in enumerate(tally.methods("plain")):
                f1 = [tally.scores["plain", cell, method].f1 for cell in cells]
                mine = method == ROBUST
                for start in range(0, len(cells), 3):
                    axis.plot(
                        range(start, start + 3),
                        f1[start : start + 3],
                        marker="o",
                        markersize=4 if mine else 2.5,
                        linewidth=2 if mine else 1,
                        color=COLOURS[number % len(COLOURS)],
                        zorder=3 if mine else 2,
                        label=method if start == 0 else None,
                    )
            axis.set_title(_LABELS[kind])
            axis.set_xticks(range(len(cells)), [f"{100 * cell.noise:.0f}" for cell in cells])
            axis.set_xlabel("σ [cm] with 361, 720, 1081 beams")
            axis.grid(axis="y", linewidth=0.4)
            axis.set_ylim(0, 1.02)
        axes[0].set_ylabel("F1")
        handles, names = axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=4, frameon=False)
        _save(figure, path)


def plot_scenes(seed: int, path: Path) -> None:
    """One scene of each kind, seen by 720 beams with σ 1 cm, and the objects found in it."""
    with mpl.rc_context():
        _style()
        figure = Figure(figsize=(9.2, 3.3), layout="constrained")
        for axis, kind in zip(figure.subplots(1, len(KINDS)), KINDS, strict=True):
            sensor = sensor_with(SENSORS["720"], 0.01, 0.003)
            batch, _ = simulate([random_scene(kind, seed, sensor, legged=False)], [seed])
            detection = detect(batch, Parameters(), per_beam=True)
            x, y = points_xy(batch)
            label = labels_of(detection)[0]
            axis.scatter(x[0, label == 0], y[0, label == 0], s=1, color="#999999", linewidths=0)
            for number in range(1, int(label.max(initial=0)) + 1):
                mine = label == number
                colour = COLOURS[number % (len(COLOURS) - 1)]
                axis.scatter(x[0, mine], y[0, mine], s=4, color=colour, linewidths=0)
            for k in range(len(detection)):
                size = np.array([detection.box_length[k], detection.box_width[k]])
                cos, sin = np.cos(detection.box_yaw[k]), np.sin(detection.box_yaw[k])
                outline = (_SQUARE * size) @ np.array([[cos, sin], [-sin, cos]])
                outline += [detection.box_x[k], detection.box_y[k]]
                axis.plot(outline[:, 0], outline[:, 1], linewidth=0.5, color="black")
            axis.plot(0, 0, marker="^", color="black", markersize=4)
            axis.set_aspect("equal", adjustable="datalim")
            axis.set_title(f"{kind}, seed {seed:,}")
            axis.tick_params(length=2)
        _save(figure, path)
