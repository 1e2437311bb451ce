"""§3: sweeps of a moving sensor laid onto what a station has seen, because odometry alone is not exact enough."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism.background.grid import Grid
from lidarcli.formalism.background.stations import Shift
from lidarcli.sweeps import Float64, Int64, SweepBatch, record

WINDOW = 0.035
"""[rad] Lines are fitted to the beams this far to either side of each: 2°."""
STRAIGHT = 0.05
"""[m] rms of a line that is one."""
POINTS = 180
"""Points of a sweep that are looked at."""
REACHES = (0.4, 0.4, 0.3, 0.2, 0.15, 0.1, 0.1)
"""[m] How far a point may be from its line, round by round."""
POINT_ERROR = 0.03
"""[m] of a point across its line."""
POSE_ERROR, HEADING_ERROR = 0.1, 0.05
"""[m], [rad] What odometry is trusted with where the lines do not tell: along a corridor."""


@record
class Lines:
    """The straight surface at each beam of K stations, n · q = d; NaN where there is none. (K, B) each."""

    normal_x: Float64
    normal_y: Float64
    offset: Float64
    """d [m]"""


def lines(grid: Grid, ranges: Float64) -> Lines:
    """Fit a line to the neighbourhood of every beam; u = 1/r of a line is a sinusoid, nearly linear over a few degrees.

    Parameters
    ----------
    grid : B bearings
    ranges : (K, B) metres, NaN or inf without a range
    """
    step = grid.angle_increment
    reach = max(2, round(WINDOW / abs(step)))
    known = np.isfinite(ranges) & (ranges > 0)
    u = 1.0 / np.where(known, ranges, 1.0)
    offset = np.arange(-reach, reach + 1)
    beam = np.arange(grid.beams)[:, None] + offset
    beam = beam % grid.period if grid.period else np.clip(beam, 0, grid.beams - 1)
    count = len(offset)
    mean, slope, square = (np.zeros_like(u) for _ in range(3))
    whole = np.ones(u.shape, bool)
    for column, k in enumerate(offset.tolist()):
        beside = u[:, beam[:, column]]
        mean += beside
        slope += k * beside
        square += beside * beside
        whole &= known[:, beam[:, column]]
    mean /= count
    moment = float(np.square(offset).sum())
    slope /= moment
    rms = np.sqrt(np.maximum(square / count - mean * mean - slope * slope * moment / count, 0.0))
    straight = whole & (rms < STRAIGHT * mean * mean)
    if not grid.period:
        straight[:, :reach] = False
        straight[:, grid.beams - reach :] = False
    tilt = slope / step
    direction = grid.bearings() + np.arctan2(tilt, mean)
    return Lines(
        np.where(straight, np.cos(direction), np.nan),
        np.where(straight, np.sin(direction), np.nan),
        np.where(straight, 1.0 / np.hypot(mean, tilt), np.nan),
    )


def align(batch: SweepBatch, grid: Grid, known: Lines, station: Int64, start: Shift) -> Shift:
    """Where the sensor was, as seen from a station, by laying each sweep onto the lines of its station.

    Points look for the line in their direction; their distances are made small by robust least squares. Where the lines
    leave a direction open, as in a corridor, `start` decides. People and new things are too far from any line to count.

    Parameters
    ----------
    batch : S sweeps, all of which have a pose
    grid, known : bearings and lines of K stations
    station : (S,) station of each sweep
    start : (S,) what the poses say
    """
    # The same columns whatever the widest sweep of the batch is, so that sums do not depend on it.
    column = np.arange(0, grid.beams, max(1, -(-grid.beams // POINTS)))
    bearing = batch.angle_min[:, None] + batch.angle_increment[:, None] * column
    there = np.minimum(column, max(batch.width - 1, 0))
    ranges = batch.ranges[:, there].astype(np.float64)
    valid = ~np.isnan(ranges) & (column < batch.beams[:, None])
    ranges = np.where(valid, ranges, 0.0)
    ahead, left, turn = start.during(batch.shares(np.arange(len(batch))[:, None], column))
    x, y = ranges * np.cos(bearing + turn) + ahead, ranges * np.sin(bearing + turn) + left
    pose = np.stack([start.x, start.y, start.yaw], axis=1)
    guess = pose.copy()
    prior = np.diag(1.0 / np.square([POSE_ERROR, POSE_ERROR, HEADING_ERROR]))
    row = station[:, None]
    for reach in REACHES:
        cos, sin = np.cos(pose[:, 2:]), np.sin(pose[:, 2:])
        turned_x, turned_y = cos * x - sin * y, sin * x + cos * y
        at_x, at_y = turned_x + pose[:, :1], turned_y + pose[:, 1:2]
        beam = grid.beam(np.arctan2(at_y, at_x))
        normal_x, normal_y = known.normal_x[row, beam], known.normal_y[row, beam]
        away = normal_x * at_x + normal_y * at_y - known.offset[row, beam]
        with np.errstate(invalid="ignore"):
            near = valid & (beam >= 0) & (np.abs(away) < reach)
        away = np.where(near, away, 0.0)
        weight = np.where(near, np.square(1.0 - np.square(away / reach)), 0.0) / POINT_ERROR**2
        lever = np.where(near, normal_y * turned_x - normal_x * turned_y, 0.0)
        parts = (np.where(near, normal_x, 0.0), np.where(near, normal_y, 0.0), lever)
        weighted = [weight * part for part in parts]
        normal = np.empty((len(batch), 3, 3))
        for i in range(3):
            for j in range(i, 3):
                normal[:, i, j] = normal[:, j, i] = np.einsum("sm,sm->s", weighted[i], parts[j])
        right = np.stack([np.einsum("sm,sm->s", part, away) for part in weighted], axis=1)
        right += (pose - guess) @ prior
        pose = pose - np.linalg.solve(normal + prior, right[:, :, None])[:, :, 0]
    return Shift(pose[:, 0], pose[:, 1], pose[:, 2], start.way)
