"""Coordinates of one run in those of another (§3, matching), by its static objects and by what both observed of the space.

Every pair of a known object and an object of the next run is weighed: how much likelier are the measurements of both if
they are one object than if they are two? An object that is where it was is recognised by its place, one that was moved by
its size, shape and label. Every two objects of a run, together with two known ones of similar sizes and the same distance,
propose a turn and a shift; further ones come of trying all turns and shifts on coarse cells.

Two runs lie on each other where the structure of each, as far as the other observed the place, lies on that of the other.
Each proposal is refined point to line, and the one that explains most of both runs wins, unless another one explains as
much, or nothing holds it along its walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lidarcli.formalism.mapping.grid import FREE, UNKNOWN
from lidarcli.formalism.matching.assignment import assign
from lidarcli.formalism.matching.catalogue import MAX_SIZE, MIN_SIZE
from lidarcli.formalism.matching.free_space import HERE, Nearest, SpaceMap, SpaceMotion
from lidarcli.sweeps.types import TURN, Bool, Float64, Int32, Int64, record

RUN_PLACE_SD, RUN_SIZE_SD = 0.1, 0.01
"""[m] Standard deviations of the place of a static object in a run, and between two sizes of one object, in addition to
their own."""
WRONG_SIZE = 0.1
"""Share of sizes that are wrong, as of an object of which a part was never observed."""
SIZE_RANGE = MAX_SIZE - MIN_SIZE
"""[m] Range of the sizes of different objects."""
STAYS, NEARNESS = 0.9, 0.05
"""Probability that an object is where it was, and log-likelihood that each metre between two places of a moved object
costs [1/m]."""
MIN_GAIN = 2.9
"""Least log-likelihood ratio of a pair: 18 to 1."""
SAME_SHAPE, OTHER_SHAPE = 0.7, -2.0
"""Log-likelihood ratio of two known shapes, the same or another."""
SAME_LABEL, OTHER_LABEL = 2.0, -20.0
"""Log-likelihood ratio of two labels, the same or another."""
MIN_AREA = 10.0
"""[m²] Least area in which objects stand."""
MAX_THINGS, MAX_ALIGNED = 40, 100
"""Greatest number of objects of each side that propose motions, and by which runs are aligned, the largest first."""
MAX_PROPOSALS, MAX_REFINED, MIN_QUALITY = 3000, 24, 0.4
"""Most proposals, those of the most alike pairs first; most different ones that are refined; least quality of a proposal,
as a share of the best one."""
MOTION_REFINEMENTS = 6
"""Greatest number of refinements of a motion by the objects in place."""
PAIR_TOLERANCE, MIN_ALIKE, SHORTEST_PAIR = 0.3, -3.0, 0.3
"""Two pairs of the same objects: greatest difference between their distances [m], least log-likelihood ratio of two
objects, and least distance between two objects that give a direction [m]."""
MIN_IN_PLACE, MOTION_PRIOR, IN_PLACE_SDS = 3, 12.0, 4.0
"""Least number of objects in place for a turn and a shift, as two pairs of the same distance are common; for equal frames
two are enough, and another motion has to be better by so much log-likelihood. Objects are in place within so many
deviations."""
PROPOSALS_AT_ONCE = 256


@record
class StaticObjects:
    """N static objects of one run, (N,) each; lengths in metres, NaN if unknown."""

    x: Float64
    y: Float64
    length: Float64
    width: Float64
    length_sd: Float64
    width_sd: Float64
    shape: Int32
    """Code of the shape, the same in all runs; -1 if unknown."""
    label: Int32
    """Code of the label, the same in all runs; -1 for none."""

    def __len__(self) -> int:
        return len(self.x)

    def rows(self, index: Int64) -> StaticObjects:
        """Return some of the objects."""
        return StaticObjects(**{name: getattr(self, name)[index] for name in StaticObjects.__dataclass_fields__})

    @property
    def column(self) -> StaticObjects:
        """The objects as (N, 1), broadcast against those of another run: for all pairs."""
        return self.rows(np.arange(len(self))[:, None])

    def at(self, x: Float64, y: Float64) -> StaticObjects:
        """Return the objects at other places."""
        return replace(self, x=x, y=y)


def gains(known: StaticObjects, run: StaticObjects) -> Float64:
    """Return (T, N) the log-likelihood ratio of each pair being one object, in its place or moved, and not two."""
    away, like = _distance(known, run), alike(known.column, run)
    sized: Bool = np.isfinite(known.length + known.width)[:, None] & np.isfinite(run.length + run.width)
    moved = np.where(sized, like + math.log(1.0 - STAYS) - NEARNESS * away, -np.inf)
    return np.maximum(like + near(away, area(known, run)), moved)


def near(distance: Float64, room: float) -> Float64:
    """Return the log-likelihood ratio of one object at two places with a distance [m], in a room of an area [m²]."""
    return math.log(STAYS * max(room, MIN_AREA) / (4.0 * math.pi * RUN_PLACE_SD**2)) - 0.25 * (distance / RUN_PLACE_SD) ** 2


def area(known: StaticObjects, run: StaticObjects) -> float:
    """Return the area in which the objects stand [m²]."""
    sides = []
    for one, other in ((known.x, run.x), (known.y, run.y)):
        both = np.concatenate([one, other])
        sides.append(float(np.ptp(both)) + 1.0 if len(both) else 1.0)
    return max(sides[0] * sides[1], MIN_AREA)


def alike(known: StaticObjects, run: StaticObjects, size_sd: float = RUN_SIZE_SD, wrong: float = WRONG_SIZE) -> Float64:
    """Return (P,) the log-likelihood ratio of pairs of being one object by size, shape and label; 0 if these are unknown.

    `size_sd`: standard deviation between two sizes of one object, in addition to their own [m]; `wrong`: share of sizes
    that are wrong."""
    total = np.zeros(1)
    for size in ("length", "width"):
        apart = getattr(known, size) - getattr(run, size)
        sd = np.hypot(getattr(known, f"{size}_sd"), getattr(run, f"{size}_sd"))
        sd = np.hypot(np.nan_to_num(sd), size_sd)
        right = SIZE_RANGE / (math.sqrt(2.0 * math.pi) * sd) * np.exp(-0.5 * (apart / sd) ** 2)
        ratio = np.log((1.0 - wrong) * right + wrong)
        total = total + np.where(np.isfinite(apart), ratio, 0.0)
    return total + coded(known, run)


def coded(known: StaticObjects, run: StaticObjects) -> Float64:
    """Return (P,) the log-likelihood ratio of pairs of being one object by shape and label."""
    total = np.zeros(1)
    rules = ((known.shape, run.shape, SAME_SHAPE, OTHER_SHAPE), (known.label, run.label, SAME_LABEL, OTHER_LABEL))
    for one, other, same, unlike in rules:
        total = total + np.where((one >= 0) & (other >= 0), np.where(one == other, same, unlike), 0.0)
    return total


def _distance(known: StaticObjects, run: StaticObjects) -> Float64:
    """Return (T, N) the distances of objects [m]."""
    return np.hypot(known.x[:, None] - run.x, known.y[:, None] - run.y)


def align(known: StaticObjects, run: StaticObjects) -> tuple[SpaceMotion | None, float]:
    """Return the motion from the coordinates of a run to those of the known objects, and its probability; None for none."""
    if not len(known) or not len(run):
        return None, 0.0
    known, run = (each.rows(_largest(each, MAX_ALIGNED)) for each in (known, run))
    found: dict[bytes, tuple[float, SpaceMotion]] = {}
    for motion in [HERE, *proposals(known, run)]:
        refined = motion if motion == HERE else _refine(known, run, motion)
        placed = run.at(*refined.of(run.x, run.y))
        gain = gains(known, placed)
        pair = assign(gain.T - MIN_GAIN)
        one = np.flatnonzero(pair >= 0)
        standing = int(np.count_nonzero(_distance(known, placed)[pair[one], one] < IN_PLACE_SDS * RUN_PLACE_SD))
        if standing < (min(2, len(known), len(run)) if refined == HERE else MIN_IN_PLACE):
            continue
        total = float((gain[pair[one], one] - MIN_GAIN).sum()) - (0.0 if refined == HERE else MOTION_PRIOR)
        key = pair.tobytes()
        if key not in found or total > found[key][0]:
            found[key] = total, refined
    if not found:
        return None, 0.0
    # The first of equals: equal frames, then the order of the proposals.
    best, motion = max(found.values(), key=lambda each: each[0])
    if best <= 0.0:
        return None, 0.0
    return motion, 1.0 / sum(math.exp(total - best) for total, _ in found.values())


def proposals(known: StaticObjects, run: StaticObjects) -> list[SpaceMotion]:
    """Return the proposals under which most objects fall into place."""
    ours, theirs = _largest(known, MAX_THINGS), _largest(run, MAX_THINGS)
    like = alike(known.rows(ours[:, None]), run.rows(theirs))
    x0, y0, x1, y1 = known.x[ours], known.y[ours], run.x[theirs], run.y[theirs]
    a, b = (part.ravel() for part in np.nonzero(~np.eye(len(ours), dtype=bool)))
    i, j = np.triu_indices(len(theirs), 1)
    there, here = np.hypot(x0[b] - x0[a], y0[b] - y0[a]), np.hypot(x1[j] - x1[i], y1[j] - y1[i])
    first, second = like[a][:, i], like[b][:, j]
    fits = np.abs(there[:, None] - here) < PAIR_TOLERANCE
    fits &= (first > MIN_ALIKE) & (second > MIN_ALIKE) & (there[:, None] > SHORTEST_PAIR) & (here > SHORTEST_PAIR)
    p, q = np.nonzero(fits)
    weight = (first + second)[p, q] - ((there[p] - here[q]) / (2.0 * RUN_PLACE_SD)) ** 2
    order = np.lexsort((-there[p], -weight))[:MAX_PROPOSALS]
    a, b, i, j = a[p[order]], b[p[order]], i[q[order]], j[q[order]]
    angle = np.arctan2(y0[b] - y0[a], x0[b] - x0[a]) - np.arctan2(y1[j] - y1[i], x1[j] - x1[i])
    cos, sin = np.cos(angle), np.sin(angle)
    middle_x, middle_y = 0.5 * (x1[i] + x1[j]), 0.5 * (y1[i] + y1[j])
    shift_x = 0.5 * (x0[a] + x0[b]) - cos * middle_x + sin * middle_y
    shift_y = 0.5 * (y0[a] + y0[b]) - sin * middle_x - cos * middle_y
    room, quality = area(known, run), np.empty(len(order))
    for begin in range(0, len(order), PROPOSALS_AT_ONCE):
        at = slice(begin, begin + PROPOSALS_AT_ONCE)
        c, s = cos[at, None], sin[at, None]
        x = shift_x[at, None] + c * x1 - s * y1
        y = shift_y[at, None] + s * x1 + c * y1
        away = np.hypot(x[:, None, :] - x0[:, None], y[:, None, :] - y0[:, None])
        gain = np.maximum(like + near(away, room) - MIN_GAIN, 0.0)
        quality[at] = np.minimum(gain.max(axis=2).sum(axis=1), gain.max(axis=1).sum(axis=1))
    best: list[SpaceMotion] = []
    for k in np.argsort(-quality, kind="stable").tolist():
        motion = SpaceMotion(float(angle[k]), float(shift_x[k]), float(shift_y[k]))
        x, y = motion.of(x1, y1)
        places = (other.of(x1, y1) for other in best)
        if not any(np.hypot(u - x, v - y).max() < IN_PLACE_SDS * RUN_PLACE_SD for u, v in places):
            best.append(motion)
        if len(best) == MAX_REFINED or quality[k] < MIN_QUALITY * quality.max():
            break
    return best


def _largest(things: StaticObjects, most: int) -> Int64:
    """Return the indices of the largest objects."""
    size = np.nan_to_num(things.length, nan=-1.0)
    return np.sort(np.argsort(-size, kind="stable")[:most]).astype(np.int64)


def _refine(known: StaticObjects, run: StaticObjects, motion: SpaceMotion) -> SpaceMotion:
    """Return the motion that fits best the objects that fall into place."""
    like = alike(known.column, run)
    for _ in range(MOTION_REFINEMENTS):
        placed = run.at(*motion.of(run.x, run.y))
        away = _distance(known, placed)
        gain = np.where(away < IN_PLACE_SDS * RUN_PLACE_SD, like + near(away, area(known, placed)) - MIN_GAIN, -np.inf)
        pair = assign(gain.T)
        one = np.flatnonzero(pair >= 0)
        if len(one) < 2:
            return motion
        found = moved(run.x[one], run.y[one], known.x[pair[one]], known.y[pair[one]])
        if found == motion:
            break
        motion = found
    return motion


def moved(x: Float64, y: Float64, to_x: Float64, to_y: Float64) -> SpaceMotion:
    """Return the turn and shift from points to points, by least squares."""
    mean_x, mean_y, mean_u, mean_v = (float(each.mean()) for each in (x, y, to_x, to_y))
    dx, dy, du, dv = x - mean_x, y - mean_y, to_x - mean_u, to_y - mean_v
    angle = math.atan2(float((dx * dv - dy * du).sum()), float((dx * du + dy * dv).sum()))
    cos, sin = math.cos(angle), math.sin(angle)
    return SpaceMotion(angle, mean_u - cos * mean_x + sin * mean_y, mean_v - sin * mean_x - cos * mean_y)


IN_PLACE = 0.1
"""[m] Greatest distance of structure in place from that of the other run."""
MIN_COMMON = 0.2
"""Least share of the smaller structure, and of the smaller free space, that both runs have in common: rooms on both sides
of a wall do not lie on each other."""
MIN_POINTS, MIN_OVERLAP = 20, 0.6
"""Least number of occupied points that both runs have in common, and least share of the structure in place; runs with less
do not lie on each other."""
AS_MUCH, AS_MUCH_POINTS, AS_MUCH_IN_PLACE = 0.03, 40, 0.8
"""A second alignment explains as much if no more speaks against it than this share of the structure and this number of
points, which one object that was moved makes, more than against the best, and this share of what the best explains is in
place: the rest may lie in the shadow of what was moved."""
CLEARLY = 6
"""Number of points against it by which a shift along walls is clearly worse."""
HELD = 0.01
"""Least share of the structure across a direction, by the normals of its lines, that holds an alignment along it."""
MAX_POINTS = 20_000
"""Greatest number of points by which alignments are compared; of more, every second, third, … one stands for them all."""
COARSE, MAX_COARSE = 0.2, 256
"""Side of the cells on which all turns and shifts are tried [m], so large that there are no more than so many in a row."""
MAX_TURN = math.radians(4.0)
"""[rad] Greatest step of turns that are tried."""
PEAKS, MAX_CANDIDATES, APART = 4, 24, 0.5
"""Number of shifts that each turn proposes; most different proposals that are refined; proposals are different if they
bring the structure this far apart [m]."""
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

    motion: SpaceMotion
    overlap: float
    """Share of the structure in place, as far as the other run observed the place; of both runs the smaller one."""
    explained: int
    """Number of points of both runs that are in place."""
    against: int
    """Number of points of both runs where the other observed nothing of them."""
    rms: float
    """Root mean square of the distances of the points in place [m]."""
    common: bool
    """True if both runs have enough in common."""

    @property
    def lies(self) -> bool:
        """True if the runs lie on each other."""
        return self.common and self.overlap >= MIN_OVERLAP

    @property
    def gain(self) -> int:
        """Points that the motion explains, less those that speak against it."""
        return self.explained - self.against


def fit(first: Nearest, second: Nearest, motion: SpaceMotion) -> Fit:
    """Return how well a run lies on the first one, moved to its coordinates."""
    shares, explained, against, squares = [], 0, 0, 0.0
    free = np.count_nonzero(first.ground.state(*motion.of(*second.free.T)) == FREE)
    both_free = free / max(1, len(second.free)) * second.area
    common = both_free >= MIN_COMMON * min(first.area, second.area)
    for here, there, leads in ((first, second, motion), (second, first, motion.inverse)):
        x, y = leads.of(*_some(there.ground.points).T)
        every = max(1, round(len(there.ground.points) / max(1, len(x))))
        _, away = here.of(x, y)
        near = away <= IN_PLACE
        known = near | (here.ground.state(x, y) != UNKNOWN)
        both, placed = (every * int(np.count_nonzero(each)) for each in (known, near))
        shares.append(placed / both if both else 0.0)
        explained += placed
        against += both - placed
        squares += every * float((away[near] ** 2).sum())
        least = min(len(here.ground.points), len(there.ground.points))
        common &= both >= max(MIN_POINTS, MIN_COMMON * least)
    rms = math.sqrt(squares / explained) if explained else math.nan
    return Fit(motion, min(shares), explained, against, rms, common)


def _some(points: Float64) -> Float64:
    """Return points (N, 2), of many every second, third, … one."""
    return points[:: max(1, len(points) // MAX_POINTS)]


def settle(first: Nearest, second: Nearest) -> tuple[Fit, Fit | None]:
    """Return how well a run lies on the first one as it is, and a shift and turn close by that explains clearly more."""
    here = fit(first, second, HERE)
    if not len(first.ground.points) or not len(second.ground.points):
        return here, None
    better = fit(first, second, refine(first, second.ground.points, HERE))
    return here, better if better.lies and not _explains_as_much(here, better) else None


@dataclass(frozen=True, slots=True)
class Alignment:
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


def search(first: Nearest, second: Nearest, proposed: list[SpaceMotion]) -> Alignment:
    """Return the alignment of a run with the first one that explains most; objects propose further motions."""
    nothing = Fit(HERE, 0.0, 0, 0, math.nan, False)
    if not len(first.ground.points) or not len(second.ground.points):
        return Alignment(nothing)
    candidates = [HERE, *_different([*proposed, *_tried(first, second)], second.ground)]
    fits = [fit(first, second, refine(first, second.ground.points, motion)) for motion in candidates]
    here = fits[0]
    fits.sort(key=lambda each: -each.gain)
    whole = [each for each in fits if each.common] or [max(fits, key=lambda each: each.explained)]
    best = whole[0]
    # A sensor that was hardly touched is no coincidence.
    stays = (
        here.lies
        and here.motion.shift <= NEAR_HERE
        and abs(here.motion.turn) <= NEAR_HERE_TURN
        and _explains_as_much(here, best)
    )
    if stays:
        exact = fit(first, second, HERE)
        best = here if exact.gain < here.gain - CLEARLY or exact.rms > here.rms + SMALL else exact
        # A motion that explains most of what is not in place is likelier than an object that was moved just so.
        most = [each for each in whole if each.lies and 2 * (each.against + CLEARLY) < best.against]
        if most:
            best, stays, whole = most[0], False, most
    rivals = [
        each
        for each in whole
        if each.lies and _explains_as_much(each, best) and _apart(each.motion, best.motion, second.ground) > APART
    ]
    if stays:
        # What was driven on is likelier than what was turned round; then more has to speak against it.
        shifted = [
            each for each in rivals if abs(each.motion.turn) <= NEAR_HERE_TURN and each.against <= best.against + CLEARLY
        ]
        rivals, stays = (shifted, False) if shifted else (rivals, True)
    return Alignment(best, rivals[0] if rivals else None, stays, best.lies and _slides(first, second, best.motion))


def _explains_as_much(one: Fit, best: Fit) -> bool:
    """Return whether one explains as much as the best, but for noise and for what one object that was moved makes."""
    more = AS_MUCH_POINTS + AS_MUCH * (best.explained + best.against)
    return one.against <= best.against + more and one.explained >= AS_MUCH_IN_PLACE * best.explained


def _slides(first: Nearest, second: Nearest, motion: SpaceMotion) -> bool:
    """Return whether all structure in place is along one direction, so that nothing holds a motion along it."""
    index, away = first.of(*motion.of(*_some(second.ground.points).T))
    near = index[away <= IN_PLACE]
    across, is_line = first.lines(near)
    normal = across[is_line]
    if not len(normal):
        return False
    least, most = np.linalg.eigvalsh(normal.T @ normal).tolist()
    return bool(least < HELD * (least + most))


def _apart(one: SpaceMotion, other: SpaceMotion, ground: SpaceMap) -> float:
    """Return how far apart two motions bring the corners of the structure [m]."""
    x, y = _some(ground.points).T
    corners = np.array([[a, b] for a in (x.min(), x.max()) for b in (y.min(), y.max())])
    (x0, y0), (x1, y1) = (each.of(corners[:, 0], corners[:, 1]) for each in (one, other))
    return float(np.hypot(x1 - x0, y1 - y0).max())


def _different(motions: list[SpaceMotion], ground: SpaceMap) -> list[SpaceMotion]:
    """Return the first of each group of motions that are alike."""
    kept: list[SpaceMotion] = []
    for motion in motions:
        if all(_apart(motion, other, ground) > APART for other in kept):
            kept.append(motion)
        if len(kept) == MAX_CANDIDATES:
            break
    return kept


def refine(first: Nearest, points: Float64, motion: SpaceMotion, reaches: Sequence[float] = REACHES) -> SpaceMotion:
    """Return the motion that brings points (N, 2) best onto the structure of the first run."""
    points = points[:: max(1, len(points) // REFINED_POINTS)]
    middle = points.mean(axis=0)
    for reach in reaches:
        x, y = motion.of(points[:, 0], points[:, 1])
        index, away = first.of(x, y)
        near = np.flatnonzero(away <= reach)
        if len(near) < MIN_POINTS:
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
        motion = SpaceMotion(
            angle, float(to[0] - cos * middle[0] + sin * middle[1]), float(to[1] - sin * middle[0] - cos * middle[1])
        )
        if max(abs(dx), abs(dy), abs(turn)) < SMALL and reach == reaches[-1]:
            break
    return motion


def _tried(one: Nearest, other: Nearest) -> list[SpaceMotion]:
    """Return proposals by trying all turns and shifts on coarse cells, the best first."""
    first, second, free = one.ground, other.ground, other.free
    middle = second.points.mean(axis=0)
    radius = float(np.hypot(*(second.points - middle).T).max())
    left, low = first.points.min(axis=0) - COARSE
    extent = first.points.max(axis=0) - [left, low]
    side = max(COARSE, (float(extent.max()) + 2.0 * radius) / MAX_COARSE)
    wide, high = (math.ceil((float(length) + 2.0 * radius) / side) + 4 for length in extent)
    shape = _even(high), _even(wide)
    ours = _counted(first.points, left, low, side, shape)
    points = _some(second.points)
    near = _widened(ours > 0)
    our_free = _counted(one.free, left, low, side, shape) > 0
    worth = np.where(near, np.where(ours > 0, 1.0, 0.5), np.where(our_free, -1.0, 0.0))
    for_points, for_free = np.fft.rfft2(worth), np.fft.rfft2(ours)
    step = min(MAX_TURN, max(side / max(radius, side), math.radians(0.5)))
    turns = np.arange(0.0, TURN, TURN / math.ceil(TURN / step))
    found: list[tuple[float, SpaceMotion]] = []
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
            motion = SpaceMotion(
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
    """Return the cells and those next to them."""
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
