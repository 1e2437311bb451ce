"""Pictures to judge by: the numbered pieces of a sweep, the same near the sensor, and what the sweeps around it saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from benchmarks.annotations.pieces import Piece, pieces
from benchmarks.annotations.sweeps import Row
from lidarcli.sweeps.types import Float64, SweepBatch

NEAR = 3.0
"""[m] from the sensor to the borders of the near picture."""
BESIDE = 40
"""Sweeps before and after that are shown too."""
COLOURS = ("#c1121f", "#1d70b8", "#0b6e4f", "#8d4a9f", "#b06500", "#008080", "#d6336c", "#4d4d00")


@dataclass(frozen=True, slots=True)
class Place:
    """Where a sweep lies in the frame of another: x, y [m], yaw [rad]."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def moved(self, points: Float64) -> Float64:
        """(N, 2) points of the sweep in that frame."""
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        moved: Float64 = points @ np.array([[cos, sin], [-sin, cos]]) + [self.x, self.y]
        return moved

    def after(self, other: Place) -> Place:
        """This place, seen from where `other` is seen from."""
        at = other.moved(np.array([[self.x, self.y]]))[0]
        return Place(float(at[0]), float(at[1]), self.yaw + other.yaw)


def points_of(batch: SweepBatch, row: int) -> Float64:
    """(N, 2) the points of a sweep [m]."""
    ranges = batch.ranges[row].astype(float)
    known = np.isfinite(ranges)
    bearing = batch.angle_min[row] + batch.angle_increment[row] * np.flatnonzero(known)
    found: Float64 = np.column_stack([ranges[known] * np.cos(bearing), ranges[known] * np.sin(bearing)])
    return found


def register(points: Float64, known: Float64, start: Place) -> Place:
    """Where points lie in the frame of others: iterated closest points, the worse third left out."""
    if len(points) < 10 or len(known) < 10:
        return start
    tree, place = cKDTree(known), start
    for _ in range(25):
        moved = place.moved(points)
        away, nearest = tree.query(moved)
        kept = away <= max(np.quantile(away, 0.67), 0.01)
        a, b = moved[kept], known[nearest[kept]]
        mean_a, mean_b = a.mean(axis=0), b.mean(axis=0)
        u, _, v = np.linalg.svd((a - mean_a).T @ (b - mean_b))
        turn = (u @ np.diag([1.0, np.linalg.det(u @ v)]) @ v).T
        yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
        shift = mean_b - turn @ mean_a
        place = place.after(Place(float(shift[0]), float(shift[1]), yaw))
        if abs(yaw) < 1e-4 and np.hypot(*shift) < 1e-4:
            break
    return place


def around(sweeps: Sequence[Row], at: int, beside: int = BESIDE) -> dict[int, Float64]:
    """Points of the sweeps around one of a topic, in its frame, by their position."""
    here = points_of(*sweeps[at])
    found = {at: here}
    for way in (-1, 1):
        place, before = Place(), here
        for other in range(at + way, at + way * (beside + 1), way):
            if not 0 <= other < len(sweeps):
                break
            points = points_of(*sweeps[other])
            step = _step(sweeps[other - way], sweeps[other]) or register(points, before, Place())
            place, before = step.after(place), points
            found[other] = place.moved(points)
    return found


def _step(first: Row, second: Row) -> Place | None:
    """The place of the second sweep in the frame of the first by their poses; None where these do not tell it."""
    if first[0].poses is None or second[0].poses is None or first[0].poses.upside_down[first[1]]:
        return None
    (x, y, yaw), (to_x, to_y, to_yaw) = (
        (poses.x[row], poses.y[row], poses.yaw[row])
        for poses, row in ((first[0].poses, first[1]), (second[0].poses, second[1]))
    )
    if not np.isfinite(x + to_x):
        return None
    cos, sin, dx, dy = np.cos(yaw), np.sin(yaw), to_x - x, to_y - y
    return Place(float(cos * dx + sin * dy), float(cos * dy - sin * dx), float(to_yaw - yaw))


def _sweep(axes: Axes, batch: SweepBatch, row: int, found: list[Piece], limit: float, *, number: bool) -> None:
    points = points_of(batch, row)
    axes.fill(*np.vstack([[0, 0], points]).T, color="#eef3f7", zorder=0)
    axes.plot(*points.T, ".", color="#bbbbbb", markersize=3, zorder=1)
    axes.plot(0, 0, "k^", markersize=9)
    for k, piece in enumerate(found):
        colour = COLOURS[k % len(COLOURS)]
        axes.plot(piece.x, piece.y, ".-", color=colour, markersize=4, linewidth=1, zorder=2)
        if not number:
            continue
        middle = np.array([piece.x.mean(), piece.y.mean()])
        if np.abs(middle).max() > limit:
            continue
        out = middle / max(np.hypot(*middle), 1e-6)
        axes.annotate(
            str(k),
            (float(middle[0]), float(middle[1])),
            xytext=tuple(out * (14 + 10 * (k % 3))),
            textcoords="offset points",
            color=colour,
            fontsize=9,
            ha="center",
            va="center",
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.4},
            zorder=3,
        )
    axes.set_xlim(-limit, limit)
    axes.set_ylim(-limit, limit)
    axes.set_aspect("equal")
    axes.grid(visible=True, color="#dddddd", linewidth=0.4)


def _figure(title: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(13, 13), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.set_title(title)
    return figure, axes


def draw(sweeps: Sequence[Row], at: int, title: str, folder: Path, name: str) -> None:
    """Three pictures of a sweep and the list of its pieces."""
    folder.mkdir(parents=True, exist_ok=True)
    batch, row = sweeps[at]
    found = pieces(batch, row)
    points = points_of(batch, row)
    far = (float(np.quantile(np.abs(points), 0.995)) if len(points) else 0.0) + 0.3
    for limit, part in ((far, "whole"), (min(NEAR, far), "near")):
        figure, axes = _figure(f"{title}: {part}")
        _sweep(axes, batch, row, found, limit, number=True)
        figure.savefig(folder / f"{name}-{part}.png", dpi=95)
    figure, axes = _figure(f"{title}: sweeps around it (blue before, red after), this one black")
    for other, points in around(sweeps, at).items():
        share = (other - at) / BESIDE
        colour = (max(share, 0) * 0.8 + 0.2, 0.3, max(-share, 0) * 0.8 + 0.2)
        axes.plot(*points.T, ".", color=colour, markersize=1.5, alpha=0.4)
    axes.plot(*points_of(batch, row).T, "k.", markersize=3)
    axes.plot(0, 0, "k^", markersize=9)
    axes.set_xlim(-far, far)
    axes.set_ylim(-far, far)
    axes.set_aspect("equal")
    axes.grid(visible=True, color="#dddddd", linewidth=0.4)
    figure.savefig(folder / f"{name}-around.png", dpi=95)
    lines = []
    for k, piece in enumerate(found):
        long = float(np.hypot(piece.x[-1] - piece.x[0], piece.y[-1] - piece.y[0]))
        near = float(np.hypot(piece.x, piece.y).min())
        lines.append(
            f"{k:3d}: beams {piece.first}-{piece.last} ({len(piece.beams)}), "
            f"at x {piece.x.mean():.2f} y {piece.y.mean():.2f}, {near:.2f} m away, ends {long:.2f} m apart"
        )
    (folder / f"{name}.txt").write_text("\n".join([title, *lines]) + "\n", encoding="utf-8")
