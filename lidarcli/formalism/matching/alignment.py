"""Coordinates of one run in those of another (§3, matching), by what both saw of the ground.

Two runs lie on each other where the structure of each, as far as the other saw the place, lies on that of the other. A turn
and a shift are proposed by the arrangement of things, and by trying all turns and shifts on coarse cells. Each proposal is
refined point to line, and the one that explains most of both runs wins, unless another one explains as much, or nothing
holds it along its walls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from lidarcli.formalism.mapping.occupancy import FREE, UNKNOWN
from lidarcli.formalism.matching.ground import Ground, Nearest
from lidarcli.formalism.matching.runs import HERE, Motion
from lidarcli.sweeps import TURN, Bool, Float64

IN_PLACE = 0.1
"""[m] Greatest distance of structure in place from that of the other run."""
LEAST_COMMON = 0.2
"""Least share of the smaller structure, and of the smaller free ground, that both runs have in common: rooms on both sides
of a wall do not lie on each other."""
LEAST_POINTS = 20
"""Least number of occupied points that both runs have in common."""
LEAST_OVERLAP = 0.6
"""Least share of the structure in place; runs with less do not lie on each other."""
AS_MUCH = 0.03
"""A second alignment explains as much if no more speaks against it than this share of the structure, …"""
AS_MUCH_POINTS = 40
"""… and this number of points, which one thing that was moved makes, more than against the best, …"""
AS_MUCH_IN_PLACE = 0.8
"""… and this share of what the best explains is in place: the rest may lie in the shadow of what was moved."""
CLEARLY = 6
"""Number of points against it by which a shift along walls is clearly worse."""
HELD = 0.01
"""Least share of the structure across a direction, by the normals of its lines, that holds an alignment along it."""
MOST_POINTS = 20_000
"""Greatest number of points by which alignments are compared; of more, every second, third, … one stands for them all."""
COARSE = 0.2
"""[m] Side of the cells on which all turns and shifts are tried; …"""
MOST_COARSE = 256
"""… so large that there are no more than so many in a row."""
MOST_TURN = math.radians(4.0)
"""[rad] Greatest step of turns that are tried."""
PEAKS = 4
"""Number of shifts that each turn proposes."""
MOST_CANDIDATES = 24
"""Greatest number of different proposals that are refined."""
APART = 0.5
"""[m] Proposals are different if they bring the structure this far apart."""
NEAR_HERE, NEAR_HERE_TURN = 0.3, math.radians(5.0)
"""[m], [rad] Greatest shift and turn of a sensor that was hardly touched."""
REFINED_POINTS = 3000
"""Greatest number of points by which an alignment is refined."""
REACHES = (0.6, 0.6, 0.5, 0.4, 0.3, 0.3, 0.2, 0.2, 0.15, 0.15, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1)
"""[m] Greatest distance of a point from its nearest one, round by round."""
POINT_WEIGHT = 0.1
"""Weight of a point that lies on no line."""
SMALL = 1e-5
"""[m], [rad] A refinement has converged at a smaller step."""


@dataclass(frozen=True, slots=True)
class Fit:
    """Quality of an alignment of two runs."""

    motion: Motion
    overlap: float
    """Share of the structure in place, as far as the other run saw the place; of both runs the smaller one."""
    explained: int
    """Number of points of both runs that are in place."""
    against: int
    """Number of points of both runs where the other saw nothing of them."""
    rms: float
    """Root mean square of the distances of the points in place [m]."""
    common: bool
    """True if both runs have enough in common."""

    @property
    def lies(self) -> bool:
        """True if the runs lie on each other."""
        return self.common and self.overlap >= LEAST_OVERLAP

    @property
    def gain(self) -> int:
        """Points that the motion explains, less those that speak against it."""
        return self.explained - self.against


def fit(first: Nearest, second: Nearest, motion: Motion) -> Fit:
    """Return how well a run lies on the first one, moved to its coordinates."""
    shares, explained, against, squares = [], 0, 0, 0.0
    free = np.count_nonzero(first.ground.state(*motion.of(*second.free.T)) == FREE)
    both_free = free / max(1, len(second.free)) * second.area
    common = both_free >= LEAST_COMMON * min(first.area, second.area)
    for here, there, way in ((first, second, motion), (second, first, motion.inverse)):
        x, y = way.of(*_some(there.ground.points).T)
        every = max(1, round(len(there.ground.points) / max(1, len(x))))
        _, away = here.of(x, y)
        near = away <= IN_PLACE
        seen = near | (here.ground.state(x, y) != UNKNOWN)
        both, placed = (every * int(np.count_nonzero(each)) for each in (seen, near))
        shares.append(placed / both if both else 0.0)
        explained += placed
        against += both - placed
        squares += every * float((away[near] ** 2).sum())
        least = min(len(here.ground.points), len(there.ground.points))
        common &= both >= max(LEAST_POINTS, LEAST_COMMON * least)
    rms = math.sqrt(squares / explained) if explained else math.nan
    return Fit(motion, min(shares), explained, against, rms, common)


def _some(points: Float64) -> Float64:
    """Return points (N, 2), of many every second, third, … one."""
    return points[:: max(1, len(points) // MOST_POINTS)]


def settle(first: Nearest, second: Nearest) -> tuple[Fit, Fit | None]:
    """Return how well a run lies on the first one as it is, and a shift and turn close by that explains clearly more."""
    here = fit(first, second, HERE)
    if not len(first.ground.points) or not len(second.ground.points):
        return here, None
    better = _fitted(first, second, HERE)
    return here, better if better.lies and not _explains_as_much(here, better) else None


@dataclass(frozen=True, slots=True)
class Found:
    """The best alignment, and what speaks against taking it."""

    best: Fit
    rival: Fit | None = None
    """Another one that explains as much."""
    stays: bool = False
    """True if the sensor hardly moved by the best one: then a rival that is turned, or worse, is no reason to doubt it."""
    slides: bool = False
    """True if nothing holds the best one along its walls."""

    @property
    def is_certain(self) -> bool:
        """True if the best alignment is the only one, or a rival no reason to doubt it."""
        return not self.slides and (self.rival is None or self.stays)


def search(first: Nearest, second: Nearest, proposed: list[Motion]) -> Found:
    """Return the alignment of a run with the first one that explains most.

    Parameters
    ----------
    proposed : motions by the arrangement of things
    """
    nothing = Fit(HERE, 0.0, 0, 0, math.nan, False)
    if not len(first.ground.points) or not len(second.ground.points):
        return Found(nothing)
    here = _fitted(first, second, HERE)
    candidates = _different([*proposed, *_tried(first, second)], second.ground)
    fits = [here, *(_fitted(first, second, motion) for motion in candidates)]
    fits.sort(key=lambda each: -each.gain)
    whole = [each for each in fits if each.common] or [max(fits, key=lambda each: each.explained)]
    best = whole[0]
    # A sensor that was hardly touched is no coincidence.
    stays = here.lies and _is_near(here.motion) and _explains_as_much(here, best)
    if stays:
        exact = fit(first, second, HERE)
        best = here if exact.gain < here.gain - CLEARLY or exact.rms > here.rms + SMALL else exact
    rivals = [
        each
        for each in whole
        if each.lies and _explains_as_much(each, best) and _distance(each.motion, best.motion, second.ground) > APART
    ]
    if stays:
        # What was driven on is likelier than what was turned round; then more has to speak against it.
        shifted = [
            each for each in rivals if abs(_turn(each.motion)) <= NEAR_HERE_TURN and each.against <= best.against + CLEARLY
        ]
        rivals, stays = (shifted, False) if shifted else (rivals, True)
    return Found(best, rivals[0] if rivals else None, stays, best.lies and _slides(first, second, best.motion))


def _explains_as_much(one: Fit, best: Fit) -> bool:
    """Tell whether one explains as much as the best, but for noise and for what one thing that was moved makes."""
    more = AS_MUCH_POINTS + AS_MUCH * (best.explained + best.against)
    return one.against <= best.against + more and one.explained >= AS_MUCH_IN_PLACE * best.explained


def _slides(first: Nearest, second: Nearest, motion: Motion) -> bool:
    """Tell whether all structure in place is along one direction, so that nothing holds a motion along it."""
    index, away = first.of(*motion.of(*_some(second.ground.points).T))
    near = index[away <= IN_PLACE]
    across, is_line = first.lines(near)
    normal = across[is_line]
    if not len(normal):
        return False
    least, most = np.linalg.eigvalsh(normal.T @ normal).tolist()
    return bool(least < HELD * (least + most))


def _is_near(motion: Motion) -> bool:
    return math.hypot(motion.x, motion.y) <= NEAR_HERE and abs(_turn(motion)) <= NEAR_HERE_TURN


def _turn(motion: Motion) -> float:
    """Return the turn of a motion, -π to π [rad]."""
    return (motion.angle + 0.5 * TURN) % TURN - 0.5 * TURN


def _distance(one: Motion, other: Motion, ground: Ground) -> float:
    """Return how far apart two motions bring the corners of the structure [m]."""
    x, y = _some(ground.points).T
    corners = np.array([[a, b] for a in (x.min(), x.max()) for b in (y.min(), y.max())])
    (x0, y0), (x1, y1) = (each.of(corners[:, 0], corners[:, 1]) for each in (one, other))
    return float(np.hypot(x1 - x0, y1 - y0).max())


def _different(motions: list[Motion], ground: Ground) -> list[Motion]:
    """Return the first of each group of motions that are alike."""
    kept: list[Motion] = []
    for motion in motions:
        if all(_distance(motion, other, ground) > APART for other in kept):
            kept.append(motion)
        if len(kept) == MOST_CANDIDATES:
            break
    return kept


def _fitted(first: Nearest, second: Nearest, motion: Motion) -> Fit:
    """Return the fit of a motion, refined."""
    return fit(first, second, refine(first, second.ground.points, motion))


def refine(first: Nearest, points: Float64, motion: Motion) -> Motion:
    """Return the motion that brings points (N, 2) best onto the structure of the first run."""
    points = points[:: max(1, len(points) // REFINED_POINTS)]
    middle = points.mean(axis=0)
    for reach in REACHES:
        x, y = motion.of(points[:, 0], points[:, 1])
        index, away = first.of(x, y)
        near = np.flatnonzero(away <= reach)
        if len(near) < LEAST_POINTS:
            break
        target = first.ground.points[index[near]]
        normal, on_line = first.lines(index[near])
        off = np.column_stack([x[near], y[near]]) - target
        weight = 1.0 / (1.0 + (away[near] / (0.5 * reach)) ** 2) ** 2
        # About the middle of the points, a turn and a shift are nearly independent.
        centre = np.array(motion.of(middle[:1], middle[1:])).ravel()
        lever = np.column_stack([x[near], y[near]]) - centre
        rows, values, weights = [], [], []
        for direction, chosen in (
            (normal, weight * on_line),
            (np.tile([1.0, 0.0], (len(near), 1)), POINT_WEIGHT * weight * ~on_line),
            (np.tile([0.0, 1.0], (len(near), 1)), POINT_WEIGHT * weight * ~on_line),
        ):
            turned = direction[:, 1] * lever[:, 0] - direction[:, 0] * lever[:, 1]
            rows.append(np.column_stack([direction, turned]))
            values.append(-(direction * off).sum(axis=1))
            weights.append(chosen)
        matrix, value, weight = np.concatenate(rows), np.concatenate(values), np.concatenate(weights)
        square = (matrix * weight[:, None]).T @ matrix + 1e-6 * max(weight.sum(), 1e-6) * np.eye(3)
        dx, dy, turn = np.linalg.solve(square, (matrix * weight[:, None]).T @ value).tolist()
        angle = motion.angle + turn
        cos, sin = math.cos(angle), math.sin(angle)
        to = centre + np.array([dx, dy])
        motion = Motion(
            angle, float(to[0] - cos * middle[0] + sin * middle[1]), float(to[1] - sin * middle[0] - cos * middle[1])
        )
        if max(abs(dx), abs(dy), abs(turn)) < SMALL and reach == REACHES[-1]:
            break
    return motion


def _tried(one: Nearest, other: Nearest) -> list[Motion]:
    """Return proposals by trying all turns and shifts on coarse cells, the best first."""
    first, second, free = one.ground, other.ground, other.free
    middle = second.points.mean(axis=0)
    radius = float(np.hypot(*(second.points - middle).T).max())
    left, low = first.points.min(axis=0) - COARSE
    extent = first.points.max(axis=0) - [left, low]
    side = max(COARSE, (float(extent.max()) + 2.0 * radius) / MOST_COARSE)
    wide, high = (math.ceil((float(length) + 2.0 * radius) / side) + 4 for length in extent)
    shape = _even(high), _even(wide)
    ours = _counted(first.points, left, low, side, shape)
    points = _some(second.points)
    near = _widened(ours > 0)
    our_free = _counted(one.free, left, low, side, shape) > 0
    worth = np.where(near, np.where(ours > 0, 1.0, 0.5), np.where(our_free, -1.0, 0.0))
    for_points, for_free = np.fft.rfft2(worth), np.fft.rfft2(ours)
    step = min(MOST_TURN, max(side / max(radius, side), math.radians(0.5)))
    turns = np.arange(0.0, TURN, TURN / math.ceil(TURN / step))
    found: list[tuple[float, Motion]] = []
    for angle in turns.tolist():
        cos, sin = math.cos(angle), math.sin(angle)
        turn = np.array([[cos, sin], [-sin, cos]])
        theirs = _counted((points - middle) @ turn, -radius, -radius, side, shape)
        space = _counted((free - middle) @ turn, -radius, -radius, side, shape) > 0
        space &= ~_widened(theirs > 0)
        score = np.fft.irfft2(
            for_points * np.conj(np.fft.rfft2(theirs)) - for_free * np.conj(np.fft.rfft2(space.astype(float))), shape
        )
        for _ in range(PEAKS):
            at = int(np.argmax(score))
            worth_it = float(score.flat[at])
            row, column = divmod(at, shape[1])
            rows, columns = (np.arange(-2, 3) + each for each in (row, column))
            score[np.ix_(rows % shape[0], columns % shape[1])] = -np.inf
            # Shifts to before the first cell come out at the far end.
            row -= shape[0] if row * side > extent[1] + side else 0
            column -= shape[1] if column * side > extent[0] + side else 0
            x, y = left + column * side + radius, low + row * side + radius
            motion = Motion(
                angle, float(x - cos * middle[0] + sin * middle[1]), float(y - sin * middle[0] - cos * middle[1])
            )
            found.append((worth_it, motion))
    found.sort(key=lambda each: -each[0])
    return [motion for _, motion in found]


def _counted(points: Float64, left: float, low: float, side: float, shape: tuple[int, int]) -> Float64:
    """Return (H, W) the number of points in each coarse cell; those outside are left out."""
    column = np.floor((points[:, 0] - left) / side).astype(np.int64)
    row = np.floor((points[:, 1] - low) / side).astype(np.int64)
    inside = (row >= 0) & (column >= 0) & (row < shape[0]) & (column < shape[1])
    counts = np.bincount(row[inside] * shape[1] + column[inside], minlength=shape[0] * shape[1])
    return counts.reshape(shape).astype(np.float64)


def _widened(cells: Bool) -> Bool:
    """Return the cells and those beside them."""
    wide = cells.copy()
    for axis in (0, 1):
        before = wide.copy()
        for step in (-1, 1):
            wide |= np.roll(before, step, axis)
    return wide


def _even(length: int) -> int:
    """Return the next length of which transforms are fast."""
    size = 1
    while size < length:
        size *= 2
    return size if 3 * size // 4 < length else 3 * size // 4
