"""The mount of a sensor from its sweeps: the one with which what it saw from different places falls together.

Points of sweeps are placed in the world by poses with a mount, cut into stretches between which poses may drift. In each
cell of a stretch lie points of one surface; their spread along its normal is the less, the truer the mount is. As unknown
next to the mount count the delay of the poses and the scales of their lengths and turns, so that none of them passes for a
mount; the deviations of what is found are those between stretches (cluster-robust).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from lidarcli.pose.fit import steps_between
from lidarcli.pose.matched import wrapped
from lidarcli.sweeps.finding_rules import DEVIATIONS, MIN_ASKEW, MIN_OFF
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64

SLOTS = 8
"""Parts of a sweep that takes time; each is placed by a pose of its own."""
CELL, GRID_TURNS = 0.05, tuple(np.deg2rad([7.0, 31.0, 53.0, 76.0]).tolist())
"""Side of the cells that are counted [m], and the directions of their grids [rad]."""
HALF_CHORD, MAX_BESIDE, MAX_CHORD, MAX_OFF = 0.12, 12, 0.6, 0.03
"""The normal at a point is that of the chord between beams so far to its sides [m], so many at most; the chord is no longer
than this and the point no farther off it [m]."""
DIRECTIONS = 12
"""Directions of normals that are distinguished: the two sides of a board are two surfaces."""
LADDER = ((0.8, 0.3, 4), (0.4, 0.1, 4), (0.3, 0.05, 8))
"""Sides of cells, scales of the robust weights [m], and most steps of the search with these."""
CONVERGED, MAX_STEP, MIN_IN_CELL = 5e-4, 0.3, 4
"""The search ends with steps below this [m, rad]; its greatest step [m, rad]; fewest points of a cell that count."""
BESIDE_CELL, BESIDE_CELLS, BESIDE_REACH, BESIDE_TURN = 0.1, 256, 3.0, np.deg2rad(2.0)
"""Side of the cells in which two sensors are laid on each other [m], cells to each side, and the farthest place [m] and the
steps of the turns [rad] that are tried."""
TOGETHER = 50.0
"""Points that count as one compared with what is trusted: those near each other err together."""
FEW_CLUSTERS, MIN_DEGREES, CLUSTERS = 1.5, 2.0, 12
"""Deviations by K clusters are too small by such a share over K, as 95 % of a t distribution are within two of them;
degrees of freedom of clusters that are no more than the unknowns; least number of parts of a run between which deviations
are measured."""
BESIDE_APART, BESIDE_TRIED = np.deg2rad(15.0), 4
"""Turns that are apart from each other [rad], and the most that are looked at closely."""
SEEN_STEP, SEEN_OFF = np.deg2rad(4.0), 0.2
"""Directions that are distinguished [rad], and how far a ray passes through something [m]."""
DRIFTING, FIXED = (0.5 * np.pi, 5.0), (TURN, 50.0)
"""Turn [rad] and distance [m] of a stretch in which poses do not drift much: of odometry, and of poses in a map."""
UNSURE = np.array([0.05, 0.05, np.deg2rad(2.0)])
"""Deviations of a mount that is known well enough [m, rad]."""
SURE = np.array([0.003, 0.003, np.deg2rad(0.1)])
"""No mount is known better: grids and ranges err, too [m, rad]."""


@dataclass(frozen=True, eq=False, slots=True)
class Outlines:
    """Points on surfaces as sensors observed them, and the slots in which that was: parts of sweeps, in time order.

    Shapes: N points, K slots.
    """

    points: Float64
    """(N, 2) x, y in the frame of the sensor [m]."""
    normals: Float64
    """(N, 2) towards the sensor."""
    slot: Int64
    """(N,)"""
    stamp_ns: Int64
    """(K,) stamp of the sweep of each slot [ns]."""
    share: Float64
    """(K,) share of the beams of its sweep before the middle of each slot."""

    def __len__(self) -> int:
        return len(self.slot)

    def those(self, slots: Int64) -> Outlines:
        """Return the points of some slots (M,), which are numbered again."""
        number = np.full(len(self.stamp_ns), -1)
        number[slots] = np.arange(len(slots))
        own = number[self.slot] >= 0
        return Outlines(
            self.points[own], self.normals[own], number[self.slot[own]], self.stamp_ns[slots], self.share[slots]
        )


def outlines_of(sweeps: Sequence[tuple[int, Float64, Float64]], slots: int, most: int) -> Outlines:
    """Return the points of some sweeps in the order of time: stamps [ns], bearings and ranges (B,).

    `slots` are the parts of each, `most` the points of each.
    """
    points, normals, slot = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros(0, np.int64)]
    for number, (_, bearing, ranges) in enumerate(sweeps):
        where, normal, beam = surfaces(bearing, ranges)
        if len(beam) > most:
            some = np.linspace(0, len(beam) - 1, most).astype(int)
            where, normal, beam = where[some], normal[some], beam[some]
        points.append(where)
        normals.append(normal)
        slot.append(number * slots + (beam * slots) // max(len(ranges), 1))
    stamp = np.repeat(np.array([one[0] for one in sweeps], np.int64), slots)
    share = np.tile((np.arange(slots) + 0.5) / slots, len(sweeps))
    return Outlines(np.vstack(points), np.vstack(normals), np.concatenate(slot), stamp, share)


def joined_outlines(parts: Sequence[Outlines]) -> Outlines:
    """Return the points of several sensors, the slots of each behind those of the one before."""
    begin = np.cumsum([0, *(len(part.stamp_ns) for part in parts[:-1])])
    return Outlines(
        np.vstack([part.points for part in parts]),
        np.vstack([part.normals for part in parts]),
        np.concatenate([part.slot + first for part, first in zip(parts, begin.tolist(), strict=True)]),
        np.concatenate([part.stamp_ns for part in parts]),
        np.concatenate([part.share for part in parts]),
    )


def surfaces(bearing: Float64, ranges: Float64) -> tuple[Float64, Float64, Int64]:
    """Return the points of a sweep on surfaces (K, 2), their normals (K, 2) and their beams (K,).

    Parameters
    ----------
    bearing, ranges : (B,) of neighbouring beams [rad, m], NaN without a range
    """
    beams = len(ranges)
    points = ranges[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    step = abs(float(bearing[1] - bearing[0])) if beams > 1 else 0.0
    with np.errstate(invalid="ignore", divide="ignore"):
        offset = np.clip(np.ceil(HALF_CHORD / (ranges * step)), 1, MAX_BESIDE)
    known = np.flatnonzero(np.isfinite(offset))
    offset = offset[known].astype(np.int64)
    inside = (known >= offset) & (known + offset < beams)
    known, offset = known[inside], offset[inside]
    here, chord = points[known], points[known + offset] - points[known - offset]
    length = np.hypot(*chord.T)
    with np.errstate(invalid="ignore", divide="ignore"):
        normal = np.column_stack([-chord[:, 1], chord[:, 0]]) / length[:, None]
        normal *= -np.sign((normal * here).sum(1))[:, None]
        off = np.abs((normal * (here - points[known - offset])).sum(1))
        good = (length < MAX_CHORD) & (off < MAX_OFF) & (length > 0.0)
    return here[good], normal[good], known[good]


Placing = Callable[[Float64], Float64]
"""Gives for unknowns (P,) the poses of the sensor (K, 3) in all slots."""


@dataclass(frozen=True, eq=False, slots=True)
class CalibrationResult:
    """Unknowns (P,) with which points fall together best."""

    values: Float64
    covariance: Float64
    """(P, P)"""
    spread: float
    """Robust spread of the points along the normals of their surfaces [m]."""

    @property
    def deviations(self) -> Float64:
        """(P,) standard deviations."""
        found: Float64 = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        return found


def placed(outlines: Outlines, poses: Float64) -> Float64:
    """Return the points (N, 2) in the world, by the poses of their slots (K, 3)."""
    return _seen_at(outlines.points, poses, outlines.slot)


def _seen_at(points: Float64, poses: Float64, slot: Int64) -> Float64:
    cos, sin = np.cos(poses[slot, 2]), np.sin(poses[slot, 2])
    x, y = points.T
    return np.column_stack([poses[slot, 0] + cos * x - sin * y, poses[slot, 1] + sin * x + cos * y])


def cells_filled(outlines: Outlines, poses: Float64, stretch: Int64 | None = None) -> int:
    """Return the number of cells of `CELL` that the points fill, each stretch (K,) of slots for itself.

    It is the mean over some directions of the grid: walls along it fill fewer cells than others.
    """
    points, counts = placed(outlines, poses), []
    for turn in GRID_TURNS:
        column, row = np.floor(mounted_points(points, np.array([0.0, 0.0, turn])) / CELL).astype(np.int64).T
        key = (column << 24) + row
        if stretch is not None:
            key += stretch[outlines.slot] << 50
        counts.append(len(np.unique(key)))
    return round(float(np.mean(counts)))


def solve(outlines: Outlines, placing: Placing, start: Float64, trusted: Float64, stretch: Int64) -> CalibrationResult:
    """Find the unknowns with which the points of each stretch fall together best.

    Parameters
    ----------
    placing : gives the poses of the slots
    start : (P,) where the search begins
    trusted : (P,) standard deviations of the unknowns from 0 before any point is seen; inf for no knowledge, 0 for fixed
    stretch : (K,) number of the stretch of each slot
    """
    values = start.astype(np.float64)
    free = np.flatnonzero(trusted > 0.0)
    prior = np.zeros(len(values))
    prior[free] = 1.0 / trusted[free] ** 2
    for cell, scale, most in LADDER:
        for number in range(most):
            sums = _sums(outlines, placing, values, free, stretch, (cell, 0.5 * cell * (number % 2), scale))
            ridge = np.diag(prior[free]) * sums.spread**2 * TOGETHER
            step = -np.linalg.lstsq(sums.normal + ridge, sums.slope + ridge @ values[free], rcond=1e-9)[0]
            step *= min(1.0, MAX_STEP / max(float(np.abs(step).max()), 1e-12))
            values[free] += step
            if number > 1 and np.abs(step).max() < CONVERGED:
                break
    return CalibrationResult(values, _covariance(sums, ridge, free, len(values)), sums.spread)


@dataclass(frozen=True, eq=False, slots=True)
class _Sums:
    """Sums over all points for a step of the search."""

    normal: Float64
    slope: Float64
    by_cluster: Float64
    """(C, F) slopes of parts of the run."""
    by_stretch: Float64
    spread: float


def _sums(
    outlines: Outlines, placing: Placing, values: Float64, free: Int64, stretch: Int64, grid: tuple[float, float, float]
) -> _Sums:
    cell, shift, scale = grid
    poses, slot = placing(values), outlines.slot
    changes = np.empty((len(free), *poses.shape))
    for number, at in enumerate(free.tolist()):
        apart = np.zeros(len(values))
        apart[at] = 1e-3
        change = placing(values + apart) - placing(values - apart)
        change[:, 2] = wrapped(change[:, 2])
        changes[number] = change / 2e-3
    points = _seen_at(outlines.points, poses, slot)
    turned = poses.copy()
    turned[:, :2] = 0.0
    normals = _seen_at(outlines.normals, turned, slot)
    facing = np.arctan2(normals[:, 1], normals[:, 0]) / (2.0 * np.pi) * DIRECTIONS + shift / cell
    column, row = np.floor((points + shift) / cell).astype(np.int64).T
    key = ((column << 20) + row) * DIRECTIONS + np.floor(facing).astype(np.int64) % DIRECTIONS
    key += stretch[slot] << 50
    _, which, count = np.unique(key, return_inverse=True, return_counts=True)
    which = which.reshape(-1)
    enough = count[which] >= MIN_IN_CELL

    def middle(of: Float64) -> Float64:
        found: Float64 = np.bincount(which, of) / count
        return found[which]

    nx, ny = middle(normals[:, 0]), middle(normals[:, 1])
    length = np.hypot(nx, ny)
    nx, ny = nx / np.maximum(length, 1e-9), ny / np.maximum(length, 1e-9)
    off = nx * points[:, 0] + ny * points[:, 1]
    # A first middle by all points, then one by those near it: a cell may hold something else besides.
    weight = enough & (length > 0.7)
    for _ in range(2):
        total = np.bincount(which, weight) + 1e-9
        left = off - (np.bincount(which, weight * off) / total)[which]
        weight = np.where(enough & (length > 0.7), 1.0 / (1.0 + (left / scale) ** 2) ** 2, 0.0)
    total = np.bincount(which, weight) + 1e-9
    left = off - (np.bincount(which, weight * off) / total)[which]
    arm = points - poses[slot, :2]
    # Where all that is in a cell turns, its normal turns with it, and nothing comes apart.
    lever = nx * points[:, 1] - ny * points[:, 0]
    lever -= (np.bincount(which, weight * lever) / total)[which]
    slopes = np.empty((len(free), len(off)))
    for number, change in enumerate(changes):
        own = change[slot]
        moved = nx * (own[:, 0] - own[:, 2] * arm[:, 1]) + ny * (own[:, 1] + own[:, 2] * arm[:, 0])
        turned_by = (np.bincount(which, weight * own[:, 2]) / total)[which]
        slopes[number] = moved - (np.bincount(which, weight * moved) / total)[which] + turned_by * lever
    pull = weight * left * slopes
    part = np.empty(len(stretch), np.int64)
    part[np.argsort(outlines.stamp_ns, kind="stable")] = np.arange(len(stretch)) * CLUSTERS // len(stretch)
    spread = float(np.sqrt((weight * left**2).sum() / max(weight.sum(), 1e-9)))
    return _Sums(
        (weight * slopes) @ slopes.T,
        pull.sum(1),
        np.array([np.bincount(part[slot], one, CLUSTERS) for one in pull]).T,
        np.array([np.bincount(stretch[slot], one, int(stretch.max()) + 1) for one in pull]).T,
        max(spread, 1e-4),
    )


def _covariance(sums: _Sums, ridge: Float64, free: Int64, unknowns: int) -> Float64:
    inverse = np.linalg.pinv(sums.normal + ridge, rcond=1e-12, hermitian=True)
    found = np.zeros((unknowns, unknowns))
    for slopes in (sums.by_cluster, sums.by_stretch):
        slopes = slopes[(slopes != 0.0).any(axis=1)]
        if len(slopes) <= 2:
            continue
        slopes = slopes - slopes.mean(axis=0)
        # The slopes of the clusters sum up to about nothing, and what was fitted to them makes them smaller yet.
        degrees = max(float(len(slopes) - len(free)), MIN_DEGREES)
        share = len(slopes) / degrees * (1.0 + FEW_CLUSTERS / degrees) ** 2
        own = inverse @ (slopes.T @ slopes * share + ridge) @ inverse
        if np.trace(own) > np.trace(found):
            found[np.ix_(free, free)] = own
    return found


def scaled_path(poses: Float64, length: float, turn: float) -> Float64:
    """Return a path (K, 3) whose steps are longer by a share `length`, and turn more by a share `turn`."""
    step = steps_between(poses[:-1], poses[1:])
    yaw = poses[0, 2] + np.concatenate([[0.0], np.cumsum(step[:, 2] * (1.0 + turn))])
    cos, sin = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    x, y = step[:, 0] * (1.0 + length), step[:, 1] * (1.0 + length)
    place = np.cumsum(np.column_stack([cos * x - sin * y, sin * x + cos * y]), axis=0)
    return np.column_stack([np.vstack([poses[:1, :2], poses[0, :2] + place]), yaw])


def stretches_of(poses: Float64, most_turn: float, most_length: float) -> Int64:
    """Return (K,) the number of the stretch of each pose: one ends after so much turning or so long a path [rad, m]."""
    step = steps_between(poses[:-1], poses[1:])
    gone = np.cumsum(np.abs(step[:, 2]) / most_turn + np.hypot(step[:, 0], step[:, 1]) / most_length)
    return np.concatenate([[0], np.floor(gone)]).astype(np.int64)


def stretches_over(poses: Float64, stamp_ns: Int64, *, drifts: bool) -> Int64:
    """Return (K,) the number of the stretch of each pose, in order of their stamps; `drifts`: they do so as odometry."""
    order = np.argsort(stamp_ns, kind="stable")
    stretch = np.empty(len(poses), np.int64)
    stretch[order] = stretches_of(poses[order], *(DRIFTING if drifts else FIXED))
    return stretch


def mounted_points(points: Float64, mount: Float64) -> Float64:
    """Return points (N, 2) of a sensor in the frame in which it is mounted so (3,)."""
    return _seen_at(points, mount[None], np.zeros(len(points), np.int64))


def places_beside(points: Float64, other: Float64) -> Float64:
    """Return x, y [m] and yaw [rad] (P, 3) by which other points (M, 2) lie well on points (N, 2), the best first.

    All turns are tried, and places that are near.
    """
    own = _raster(points)
    # What is near counts too: turns are tried in steps.
    there = np.conj(np.fft.rfft2(own * 1.0 + _widened(own)))
    reach = round(BESIDE_REACH / BESIDE_CELL)
    tried = []
    for yaw in np.arange(-np.pi, np.pi, BESIDE_TURN):
        turned = mounted_points(other, np.array([0.0, 0.0, yaw]))
        found = np.fft.irfft2(np.conj(there * np.fft.rfft2(_raster(turned) * 1.0)), own.shape)
        found = np.roll(found, (reach, reach), (0, 1))[: 2 * reach + 1, : 2 * reach + 1]
        at = divmod(int(found.argmax()), found.shape[1])
        x, y = ((one - reach) * BESIDE_CELL for one in at)
        tried.append((float(found[at]), x, y, float(yaw)))
    best: list[Float64] = []
    for _, x, y, yaw in sorted(tried, reverse=True):
        if all(abs(math.remainder(yaw - one[2], TURN)) > BESIDE_APART for one in best):
            best.append(np.array([x, y, yaw]))
        if len(best) == BESIDE_TRIED:
            break
    return np.array(best)


@dataclass(frozen=True, slots=True)
class Overlap:
    """Points that two sensors see alike that stand next to each other."""

    share: float
    """Share of the cells of the second that are on cells of the first, or next to them."""
    against: float
    """Share of the points of each, the larger one, through which the other sees."""
    width: float
    """Directions in which the first sees what both see [rad]."""


def overlap(points: Float64, other: Float64, place: Float64) -> Overlap:
    """Return what points (N, 2) of a sensor and those (M, 2) of one at `place` (3,) next to it have in common."""
    there = mounted_points(other, place)
    own, its = _raster(points), _raster(there)
    both = its & _widened(own)
    back = steps_between(place[None], np.zeros((1, 3)))[0]
    against = max(_seen_through(points, there), _seen_through(other, mounted_points(points, back)))
    column, row = np.nonzero(both)
    side = own.shape[0] // 2
    directions = np.unique(np.floor(np.arctan2(row - side, column - side) / SEEN_STEP))
    share = both.sum() / max(int(its.sum()), 1)
    return Overlap(float(share), against, float(len(directions) * SEEN_STEP))


def _seen_through(points: Float64, other: Float64) -> float:
    """Return the share of other points (M, 2) that are nearer than all that a sensor at 0 sees in their directions."""
    steps = round(2.0 * np.pi / SEEN_STEP)
    nearest = np.full(steps, np.inf)

    def polar(of: Float64) -> tuple[Int64, Float64]:
        step = np.floor(np.arctan2(of[:, 1], of[:, 0]) / SEEN_STEP).astype(np.int64) % steps
        return step, np.hypot(of[:, 0], of[:, 1])

    step, reach = polar(points)
    np.minimum.at(nearest, step, reach)
    # Things at the edge of a step may be visible in the next one.
    nearest = np.minimum(nearest, np.minimum(np.roll(nearest, 1), np.roll(nearest, -1)))
    step, reach = polar(other)
    covered = np.isfinite(nearest[step])
    return float((reach[covered] < nearest[step[covered]] - SEEN_OFF).sum() / max(len(other), 1))


def _widened(cells: Bool) -> Bool:
    """Return the cells and their neighbours."""
    found: Bool = np.any([np.roll(cells, (dx, dy), (0, 1)) for dx in (-1, 0, 1) for dy in (-1, 0, 1)], axis=0)
    return found


def _raster(points: Float64) -> Bool:
    side = BESIDE_CELLS
    found = np.zeros((side, side), bool)
    at = np.floor(points / BESIDE_CELL).astype(np.int64) + side // 2
    at = at[((at >= 0) & (at < side)).all(axis=1)]
    found[at[:, 0], at[:, 1]] = True
    return found


def differs(off: Float64, deviation: Float64) -> bool:
    """Return whether a mount is off (3,) by more than its deviations explain [m, rad]."""
    off = np.array([*off[:2], *wrapped(off[2:])])
    return bool((np.abs(off) > np.maximum(DEVIATIONS * deviation, [MIN_OFF, MIN_OFF, MIN_ASKEW])).any())
