"""Differences between two runs (§3, matching): what is known, moved, new or gone, and what nobody can tell.

What is one thing in both runs is found first. A thing without a partner is new or gone only where the other run
saw its place free.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lidarcli.formalism.mapping.grid import UNKNOWN, pieces
from lidarcli.formalism.matching.alignment import MIN_AREA, SIZE_RANGE, Standing, alike, coded
from lidarcli.formalism.matching.catalogue import MAX_SIZE
from lidarcli.formalism.matching.ground import HERE, SEEN_FREE, Buckets, Ground, Motion, Nearest
from lidarcli.options.choices import CHANGE_KINDS, CHANGE_STATUSES, CHANGE_WHYS, MIN_SCORE
from lidarcli.sweeps.types import Bool, Float64, Int64, record

# Extents of standing things by what their run saw of the ground around them.
#
# A track measures a thing sweep by sweep. Of one that is partly hidden, or seen from many places, all hits together tell
# more. A side ends where free ground was seen beyond it; where nothing was seen there, it may go on.

BESIDE, OUTSIDE = 0.05, 0.1
"""[m] Points this far around a box belong to its thing; hits of a thing farther outside show that its track measured too
little."""
LINKED = 0.11
"""[m] Greatest step between the hits of one thing, along each axis; of coarse cells a little over two."""
MIN_SIDE, UNKNOWN_WIDTH = 0.06, 0.2
"""[m] Least side of a box, and width of a thing of which only one side was seen, or its length if that is less."""
MIN_HITS = 3
"""Least number of occupied cells by which a thing is measured."""
MEASURED_SD = 0.01
"""[m] Standard deviation of a side that was measured by occupied cells."""
EDGE_CELLS = 1.5
"""Cells at the edges of a face that may be seen free beside the thing."""
THIN = 0.15
"""[m] Hits of several things are those of one thin wall if they lie within this width."""
SIZES = ("length", "width")
NEAR_EDGE = 0.1
"""[m] Points farther from all edges of a rectangle count as this."""
TURNS = (np.radians(np.arange(-45.0, 45.0, 1.5)), np.radians(np.arange(-1.5, 1.75, 0.25)))
"""[rad] Directions of a rectangle that are tried, and then those around the best one."""


def box_of(things: Standing, yaw: Float64, k: int) -> Float64:
    """Return x, y, yaw, length and width of a thing; sizes that are unknown are guessed."""
    length, width = float(things.length[k]), float(things.width[k])
    length = MIN_SIDE if not length > MIN_SIDE else length
    width = min(length, UNKNOWN_WIDTH) if not width > 0 else max(width, MIN_SIDE)
    return np.array([things.x[k], things.y[k], yaw[k], length, width])


def boxes_of(things: Standing, yaw: Float64) -> Float64:
    """Return (N, 5) the boxes of things, as of `box_of`."""
    return np.array([box_of(things, yaw, k) for k in range(len(things))]).reshape(-1, 5)


def contained(boxes: Float64, points: Float64, around: float) -> tuple[Int64, Int64]:
    """Return (P,) indices of boxes (N, 5) and of the points (K, 2) that are `within` them, ascending."""
    reach = 0.5 * np.hypot(boxes[:, 3], boxes[:, 4]) + 2.0 * around
    box, point = Buckets(points).near(boxes[:, :2], reach)
    x, y = points[point, 0] - boxes[box, 0], points[point, 1] - boxes[box, 1]
    cos, sin = (np.array([turn(yaw) for yaw in boxes[:, 2].tolist()])[box] for turn in (math.cos, math.sin))
    inside = (np.abs(cos * x + sin * y) <= 0.5 * boxes[box, 3] + around) & (
        np.abs(cos * y - sin * x) <= 0.5 * boxes[box, 4] + around
    )
    return box[inside], point[inside]


def each_of(box: Int64, point: Int64, boxes: int) -> list[Int64]:
    """Return what belongs to each of so many boxes, of pairs that ascend."""
    return np.split(point, np.searchsorted(box, np.arange(1, boxes)))[:boxes]


def within(points: Float64, box: Float64, around: float) -> Bool:
    """Return (K,) whether points are in a box (x, y, yaw, length, width), or this far around it [m]."""
    x, y = points[:, 0] - box[0], points[:, 1] - box[1]
    cos, sin = math.cos(box[2]), math.sin(box[2])
    inside: Bool = (np.abs(cos * x + sin * y) <= 0.5 * box[3] + around) & (
        np.abs(cos * y - sin * x) <= 0.5 * box[4] + around
    )
    return inside


def measured(things: Standing, yaw: Float64, ground: Ground) -> tuple[Standing, Float64, Int64]:
    """Return things and the directions of their longer sides by all that their run hit of them, and their indices.

    One whose hits go on into those of another one or of the building stays as it is. Faces of one thin wall are one thing.
    """
    if not len(ground.points):
        return things, yaw, np.arange(len(things))
    owner = np.empty(len(ground.points), np.int64)
    groups = clusters(ground.points, max(LINKED, 2.1 * ground.resolution))
    for number, group in enumerate(groups):
        owner[group] = number
    inside = each_of(*contained(boxes_of(things, yaw), ground.points, BESIDE), len(things))
    hit = [np.unique(owner[mine]).tolist() for mine in inside]
    claims: dict[int, list[int]] = {}
    for k, mine in enumerate(hit):
        for number in mine:
            claims.setdefault(number, []).append(k)
    sizes = {name: getattr(things, name).copy() for name in ("x", "y", *SIZES, "length_sd", "width_sd")}
    yaw = yaw.copy()
    dropped: set[int] = set()
    for k, mine in enumerate(hit):
        points = ground.points[np.concatenate([groups[number] for number in mine])] if mine else np.empty((0, 2))
        if k in dropped or len(points) < MIN_HITS or np.ptp(points, axis=0).max() > MAX_SIZE:
            continue
        others = {other for number in mine for other in claims[number]} - {k}
        if not others and within(points, box_of(things, yaw, k), OUTSIDE).all():
            continue
        box = rectangles(points, np.zeros(1, np.int64))[0]
        if others and (box[4] > THIN or any(hit[other] != mine for other in others)):
            continue
        dropped |= others
        for name, value in zip(("x", "y", "yaw", *SIZES), box.tolist(), strict=True):
            (yaw if name == "yaw" else sizes[name])[k] = value
        sizes["length_sd"][k] = sizes["width_sd"][k] = MEASURED_SD
    kept = np.array([k for k in range(len(things)) if k not in dropped], np.int64)
    found = {name: getattr(things, name) for name in Standing.__dataclass_fields__} | sizes
    return Standing(**{name: values[kept] for name, values in found.items()}), yaw[kept], kept


def rectangles(points: Float64, starts: Int64) -> Float64:
    """Return (G, 5) x, y, yaw, length, width of rectangles near whose edges the points of groups lie; `starts` of these."""
    sizes = np.diff(np.append(starts, len(points)))
    angle, best = np.zeros(len(starts)), np.full(len(starts), np.inf)
    for turns in TURNS:
        for tried in angle + turns[:, None]:
            off = np.full(len(points), NEAR_EDGE)
            for values in _turned(points, tried, sizes):
                low, high = (np.repeat(each.reduceat(values, starts), sizes) for each in (np.minimum, np.maximum))
                off = np.minimum(off, np.minimum(values - low, high - values))
            cost = np.add.reduceat(off, starts) / sizes
            angle, best = np.where(cost < best, [tried, cost], [angle, best])
    turned = _turned(points, angle, sizes)
    low, high = (np.array([each.reduceat(u, starts) for u in turned]) for each in (np.minimum, np.maximum))
    (along, across), (length, width) = 0.5 * (low + high), high - low
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = cos * along - sin * across, sin * along + cos * across
    angle = np.where(width > length, angle + 0.5 * np.pi, angle)
    return np.column_stack([x, y, angle, np.maximum(length, width), np.minimum(length, width)])


def _turned(points: Float64, angle: Float64, sizes: Int64) -> tuple[Float64, Float64]:
    """Return the coordinates of points along and across the direction of each group."""
    cos, sin = np.repeat(np.cos(angle), sizes), np.repeat(np.sin(angle), sizes)
    return cos * points[:, 0] + sin * points[:, 1], cos * points[:, 1] - sin * points[:, 0]


def unseen_ends(things: Standing, yaw: Float64, ground: Ground | None) -> Float64:
    """Return (N, 2) how far length and width of things may go on, at both ends together, until free ground [m].

    `ground` is what their own run saw, in their coordinates; without one nothing is known to go on.
    """
    found = np.zeros((len(things), 2))
    if ground is None:
        return found
    step = 0.5 * ground.resolution
    past = np.arange(0.5, MAX_SIZE / step) * step
    for k, axis in itertools.product(range(len(things)), (0, 1)):
        box = box_of(things, yaw, k)
        along, across = 0.5 * box[3 + axis], 0.5 * box[4 - axis]
        cos, sin = math.cos(box[2] + 0.5 * axis * math.pi), math.sin(box[2] + 0.5 * axis * math.pi)
        wide = max(across - EDGE_CELLS * ground.resolution, 0.0)
        sideways = np.linspace(-wide, wide, 2 * int(wide / step) + 1)
        more = 0.0
        for side in (-1.0, 1.0):
            u, v = np.repeat(side * (along + past), len(sideways)), np.tile(sideways, len(past))
            x, y = box[0] + cos * u - sin * v, box[1] + sin * u + cos * v
            free = (ground.passed(x, y) >= SEEN_FREE).reshape(len(past), -1).any(axis=1)
            more += float(past[int(np.argmax(free))]) if free.any() else MAX_SIZE
        found[k, axis] = min(more, max(MAX_SIZE - 2.0 * along, 0.0))
    return found


def clusters(points: Float64, linked: float) -> list[Int64]:
    """Return the indices of the points of each cluster, whose steps are `linked` along each axis at most [m]."""
    if not len(points):
        return []
    cell = np.floor(points / linked).astype(np.int64)
    cell -= cell.min(axis=0) - 1
    across = int(cell[:, 0].max()) + 2
    keys, which = np.unique(cell[:, 1] * across + cell[:, 0], return_inverse=True)
    cluster = pieces(keys, across)[which]
    order = np.argsort(cluster, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(cluster[order])) + 1)


# Probabilities of things of two runs being one, in its place or moved (§3, matching).
#
# Every pair of a thing of the first run and one of the second has a weight: the odds of being one thing against being two.
# The probabilities of all pairs follow together by belief propagation.

SAME_PLACE = 0.2
"""[m] A thing is in its place up to this distance, …"""
PLACE_SD, UNSIZED_SD = 0.03, 0.1
"""[m] … or three standard deviations: of a thing whose sizes are known, and of others."""
REPLACED = 0.02
"""Odds of another thing having taken the place of one, against it being the same."""
MOVES = 0.08
"""Odds of a thing having been moved within its room, against one having gone and another one having come; near places are
likelier by the inverse of 1 m and the distance."""
FREE_SHARE, ANY_FREE = 0.5, 0.25
"""Least share of where a thing was hit that has been seen free, and that becomes free where it is moved by less than its
size."""
VIEW_SIZE_SD, WRONG_VIEW = 0.02, 0.02
"""[m] Standard deviation between two sizes of one thing that is seen from other sides, and the share of wrong ones."""
STANDING_SIZE_SD = 0.03
"""[m] The same deviation of one that stands in a place of which some was seen free, whatever is hidden of its sides."""
GRAZING_SD = 0.1
"""Standard deviation of a side, as a share of what was not seen at its ends: beams there are as far apart."""
HALF_ENDS = 0.6
"""[m] With so much unseen ground at its ends, one side in two ends where it was last seen."""
ROUNDS = 60
"""Rounds of belief propagation."""
FARTHEST = max(SAME_PLACE, 3.0 * math.hypot(UNSIZED_SD, UNSIZED_SD))
"""[m] Greatest distance of one thing in its place from itself."""
MAX_MOVED = 1000
"""Most things of each run that have left their places and are looked for elsewhere."""


@record
class Side:
    """N things of one run in the coordinates of the first one, and what is known of their places."""

    things: Standing
    yaw: Float64
    """(N,) direction of the longer side [rad]."""
    more: Float64
    """(N, 2) how far length and width may go on where the own run saw nothing [m]."""
    free: Float64
    """(N,) share of where it was hit that the other run saw free; NaN where nobody knows."""

    def rows(self, index: Int64) -> Side:
        """Return some of the things."""
        return Side(self.things.rows(index), self.yaw[index], self.more[index], self.free[index])

    @property
    def left(self) -> Bool:
        """(N,) True if the place was seen free."""
        return self.free >= FREE_SHARE

    @property
    def stays(self) -> Bool:
        """(N,) True if hardly any of the place was seen free."""
        return self.free < ANY_FREE

    @property
    def some_free(self) -> Bool:
        """(N,) True if some of the place was seen free."""
        return self.free >= ANY_FREE


class Pairs(NamedTuple):
    """P pairs of things of two runs, by index of the first and then of the second."""

    first: Int64
    second: Int64
    near: Bool
    """True if they are in one place, as far as is known."""


def pairs_of(a: Side, b: Side) -> Pairs:
    """Return all pairs that may be one thing, or hide each other; `TooManyError` if too many have left their places.

    Middles of things of which other sides were seen may be farther apart; then one is within the other, and neither place
    has become free.
    """
    places = [np.column_stack([each.things.x, each.things.y]) for each in (a, b)]
    boxes, count = [boxes_of(each.things, each.yaw) for each in (a, b)], len(b.things)
    # Anything that has left its place may be anything that has come.
    gone, come = np.flatnonzero(a.left), np.flatnonzero(b.left)
    if len(gone) * len(come) > MAX_MOVED**2:
        raise TooManyError(f"{max(len(gone), len(come)):,} things, more than are looked for ({MAX_MOVED:,})")
    (i, j), (q, p) = contained(boxes[0], places[1], BESIDE), contained(boxes[1], places[0], BESIDE)
    inside = np.concatenate([i * count + j, p * count + q])
    length = [np.fmax(np.nan_to_num(each.things.length), FARTHEST) for each in (a, b)]
    i, j = Buckets(places[1]).near(places[0], length[0])
    close = np.hypot(*(places[0][i] - places[1][j]).T) <= np.fmin(length[0][i], length[1][j])
    key = np.unique(np.concatenate([inside, (i * count + j)[close], (gone[:, None] * count + come).ravel()]))
    i, j = np.divmod(key, max(count, 1))
    one, other = a.rows(i), b.rows(j)
    away, sd = _away(one.things, other.things)
    near: Bool = (away <= np.maximum(SAME_PLACE, 3.0 * sd)) | (np.isin(key, inside) & one.stays & other.stays)
    return Pairs(i, j, near)


def _away(a: Standing, b: Standing) -> tuple[Float64, Float64]:
    """Return (P,) the distance of each pair, and its standard deviation [m]."""
    own = [np.where(np.isfinite(each.length + each.width), PLACE_SD, UNSIZED_SD) for each in (a, b)]
    return np.hypot(a.x - b.x, a.y - b.y), np.hypot(*own)


def probabilities(first: Side, second: Side, pairs: Pairs) -> Float64:
    """Return (P,) the probability of each pair being one thing."""
    if not len(pairs.first):
        return np.empty(0)
    a, b = first.rows(pairs.first), second.rows(pairs.second)
    one, other = a.things, b.things
    away, sd = _away(one, other)
    off = np.minimum(away / np.maximum(sd, SAME_PLACE / 3.0), 3.0)
    like = alike(one, other)
    # What was seen through where the other one stands has to be as large.
    large = np.minimum(like, alike(one, other, STANDING_SIZE_SD, WRONG_VIEW))
    stays = np.exp(np.where(a.some_free | b.some_free, large, like) - 0.5 * off**2) / REPLACED
    named = (one.label >= 0) & (one.label == other.label)
    length, width = (np.fmax(np.nan_to_num(each.length), SAME_PLACE) for each in (one, other))
    may = (a.left & b.left) | ((away <= np.fmin(length, width)) & ~(a.stays & b.stays))
    may &= (np.isfinite(one.length) & np.isfinite(other.length)) | named
    nearer = _nearer(away, first.things, second.things)
    moves = np.where(may, MOVES * nearer * np.exp(same_sizes(a, b)), 0.0)
    return _marginals(np.where(pairs.near, stays, moves), pairs)


def _nearer(away: Float64, one: Standing, other: Standing) -> Float64:
    """Return how much likelier than anywhere in the room in which things stand their places at a distance [m] are."""
    x, y = (np.concatenate([getattr(one, axis), getattr(other, axis)]) for axis in ("x", "y"))
    # Of places all over a disc.
    radius = math.sqrt(max(2.0 * float(np.var(x) + np.var(y)), MIN_AREA / math.pi))
    result: Float64 = 0.5 * radius**2 / (radius - math.log1p(radius)) / (1.0 + away)
    return result


def same_sizes(a: Side, b: Side) -> Float64:
    """Return (P,) the log-likelihood ratio of two things being one, by their sizes, shapes and labels.

    A side is as it was measured, or where nothing was seen beyond it anything up to its most.
    """
    one, other = _sides(a.things, a.more), _sides(b.things, b.more)
    straight = _side(one[0], other[0]) + _side(one[1], other[1])
    # Of which side too little was seen, nobody knows whether it is the longer one.
    crossed = _side(one[0], other[1]) + _side(one[1], other[0])
    result: Float64 = np.maximum(straight, crossed) + coded(a.things, b.things)
    return result


Sides = tuple[Float64, Float64, Float64]
"""Sizes of things, their standard deviations, and how far they may go on [m]."""


def _sides(things: Standing, more: Float64) -> tuple[Sides, Sides]:
    # Of what is taken for a disc only one size was measured.
    width = np.where(things.width == things.length, np.nan, things.width)
    return (
        (things.length, np.hypot(np.nan_to_num(things.length_sd), GRAZING_SD * more[:, 0]), more[:, 0]),
        (width, np.hypot(np.nan_to_num(things.width_sd), GRAZING_SD * more[:, 1]), more[:, 1]),
    )


def _side(one: Sides, other: Sides) -> Float64:
    """Return (P,) the log-likelihood ratio of two sides being one."""
    (a, a_sd, a_more), (b, b_sd, b_more) = one, other
    sd = np.hypot(np.hypot(a_sd, b_sd), VIEW_SIZE_SD)
    a_ends, b_ends = (1.0 / (1.0 + (more / HALF_ENDS) ** 2) for more in (a_more, b_more))
    right = np.zeros(1)
    for p, p_chance in ((0.0 * a_more, a_ends), (a_more, 1.0 - a_ends)):
        for q, q_chance in ((0.0 * b_more, b_ends), (b_more, 1.0 - b_ends)):
            apart = np.maximum(np.maximum(a - (b + q), b - (a + p)), 0.0)
            wide = np.hypot(math.sqrt(2.0 * math.pi) * sd, np.maximum(p, q))
            right = right + p_chance * q_chance / wide * np.exp(-0.5 * (apart / sd) ** 2)
    ratio = np.log((1.0 - WRONG_VIEW) * SIZE_RANGE * right + WRONG_VIEW)
    return np.where(np.isfinite(right), ratio, 0.0)


def _marginals(weight: Float64, pairs: Pairs) -> Float64:
    """Return (P,) the probability of each pair by its odds against none, where every thing is in one pair or in none.

    >>> pairs = Pairs(np.array([0, 1]), np.array([0, 1]), np.ones(2, np.bool_))
    >>> np.round(_marginals(np.array([9.0, 1.0]), pairs), 3).tolist()
    [0.9, 0.5]
    """
    back = np.ones(len(weight))
    for _ in range(ROUNDS):
        through = weight * back
        to = weight / (1.0 + np.bincount(pairs.first, through)[pairs.first] - through)
        back = 1.0 / (1.0 + np.bincount(pairs.second, to)[pairs.second] - to)
    through = weight * back
    result: Float64 = through / (1.0 + np.bincount(pairs.first, through)[pairs.first])
    return result


THING, STRUCTURE = range(len(CHANGE_KINDS))
KNOWN, MOVED, NEW, GONE, UNCERTAIN = range(len(CHANGE_STATUSES))
HIDDEN, OUT_OF_VIEW, NO_FREE_SPACE, SHORT, AMBIGUOUS, POSES = range(len(CHANGE_WHYS))
CERTAIN = -1
"""In place of a reason, where there is a status."""
EXPLAINED, CHANGED = 0.15, 0.15
"""[m] Changed cells this far around a thing belong to it; structure is in place up to this distance from that of the other
run."""
MIN_CHANGE, MIN_CELLS, MAX_CHANGES = 0.3, 4, 10_000
"""Least extent [m] and number of cells of a change of the structure, and most changes: runs with more are hardly of one
place."""
AROUND = 0.5
"""[m] What is this near to a place tells that it was in view."""
MAX_STATIONS = 40
"""Greatest number of places of the sensor from which a thing may have been hidden."""


class TooManyError(ValueError):
    """Two runs differ in more than `MAX_CHANGES` places or `MAX_MOVED` things; the text says in how many."""


@record
class Run:
    """Evidence of a run: N standing things, the ground, and P places of its sensors."""

    things: Standing
    yaw: Float64
    """(N,) direction of the longer side [rad]."""
    ground: Ground | None
    """None where only things are known."""
    sensors: Float64
    """(P, 2) in the coordinates of the run [m]."""

    def moved(self, motion: Motion) -> Run:
        """Return the run in other coordinates."""
        if motion == HERE:
            return self
        ground = None if self.ground is None else self.ground.moved(motion)
        things = self.things.at(*motion.of(self.things.x, self.things.y))
        sensors = np.column_stack(motion.of(self.sensors[:, 0], self.sensors[:, 1]))
        return Run(things, self.yaw + motion.angle, ground, sensors)


class Change(NamedTuple):
    """Change of a thing or piece of structure; coordinates of the first run, those of the second are in its own."""

    kind: int
    """Index into `CHANGE_KINDS`."""
    status: int
    """Index into `CHANGE_STATUSES`."""
    why: int
    """Index into `CHANGE_WHYS`, `CERTAIN` for none."""
    score: float
    """Probability of the status."""
    area: float
    """[m²]; NaN where unknown."""
    looks: tuple[int, int]
    """Sweeps of both runs that could see the place; -1 where unknown."""
    free: tuple[float, float]
    """Share of it that both runs saw free; NaN where unknown."""
    first: int = -1
    """Index of the thing of the first run; -1 for none."""
    second: int = -1
    """Index of the thing of the second run; -1 for none."""
    place: tuple[float, ...] = ()
    """x, y, yaw, length and width of a piece of structure [m, rad]; empty for things."""


class Compared:
    """Two runs in the coordinates of the first one."""

    def __init__(
        self,
        first: Run,
        second: Run,
        motion: Motion,
        nearest: tuple[Nearest | None, Nearest | None],
        chance: float = 1.0,
        least: float = MIN_SCORE,
    ) -> None:
        """`motion` leads from the coordinates of the second run to those of the first, and is right by `chance`.

        `nearest` are the nearest points of both runs, each in its own coordinates; `least` is the least score of a status.
        """
        self._runs = first, second
        self._motions = HERE, motion
        self._nearest = nearest
        self._chance, self._least = chance, least
        things = second.things
        self._things = first.things, things.at(*motion.of(things.x, things.y))
        self._yaw = first.yaw, second.yaw + motion.angle
        self._boxes = [boxes_of(self._things[side], self._yaw[side]) for side in (0, 1)]
        self._spots = [self._spots_of(side) for side in (0, 1)]
        self._changes: list[Change] = []

    def changes(self) -> list[Change]:
        """Return all changes, things first; `TooManyError` where there are too many to tell."""
        a, b = self._side(0), self._side(1)
        pairs = pairs_of(a, b)
        chance = probabilities(a, b, pairs)
        some_free = pairs.near & (a.some_free[pairs.first] | b.some_free[pairs.second])
        best = np.argsort(-chance, kind="stable")
        paired: tuple[set[int], set[int]] = set(), set()
        for i, j, near, score in zip(*(each[best].tolist() for each in (*pairs, chance * self._chance)), strict=True):
            if score < self._least:
                break
            if i in paired[0] or j in paired[1]:
                continue
            paired[0].add(i)
            paired[1].add(j)
            self._add(KNOWN if near else MOVED, CERTAIN, score, i, j)
        alone: tuple[dict[int, UnpairedStatus], dict[int, UnpairedStatus]] = {}, {}
        for side, (mine, theirs) in enumerate((pairs[:2], pairs[1::-1])):
            order = np.argsort(mine, kind="stable")
            for k, at in enumerate(each_of(mine[order], order, len(self._things[side]))):
                if k not in paired[side]:
                    taken = [other for other in theirs[at[~pairs.near[at]]].tolist() if other in paired[1 - side]]
                    alone[side][k] = self._alone(side, k, chance[at], pairs.near[at], some_free[at], taken)
        best = best[pairs.near[best]]
        self._add_rest(alone, zip(pairs.first[best].tolist(), pairs.second[best].tolist(), strict=True))
        for side in (0, 1):
            self._structure(side)
        return self._changes

    def _side(self, side: int) -> Side:
        """Return the things of a run with what is known of their places."""
        run, free = self._runs[side], [spot.free for spot in self._spots[side]]
        more = unseen_ends(run.things, run.yaw, run.ground)
        return Side(self._things[side], self._yaw[side], more, np.array(free, np.float64))

    def _add_rest(
        self, alone: tuple[dict[int, UnpairedStatus], dict[int, UnpairedStatus]], near: Iterable[tuple[int, int]]
    ) -> None:
        """Add what is in no pair yet: what is known, and what else stands in its place and is not certain, is one thing.

        `near`: pairs in one place, the most probable first.
        """
        before, after = alone
        for i, j in near:
            if i in before and j in after and {before[i].status, after[j].status} <= {KNOWN, UNCERTAIN}:
                known = [each.score for each in (before[i], after[j]) if each.status == KNOWN]
                if known:
                    self._add(KNOWN, CERTAIN, max(known), i, j)
                    del before[i], after[j]
        for i, each in before.items():
            self._add(*each, i, -1)
        for j, each in after.items():
            self._add(*each, -1, j)

    # Where a thing was hit, and what the other run saw there.

    def _spots_of(self, side: int) -> list[Spot]:
        """Return where things were hit, in the coordinates of the first run, and what the other run saw there."""
        boxes, ground = self._boxes[side], self._runs[side].ground
        points = np.empty((0, 2))
        if ground is not None:
            points = np.column_stack(self._motions[side].of(ground.points[:, 0], ground.points[:, 1]))
        hit = each_of(*contained(boxes, points, BESIDE), len(boxes))
        return [
            self._seen(1 - side, points[mine] if len(mine) else _filled(box)) for box, mine in zip(boxes, hit, strict=True)
        ]

    def _seen(self, side: int, points: Float64) -> Spot:
        """Return what a run saw of some points."""
        ground, nearest = self._runs[side].ground, self._nearest[side]
        if ground is None or nearest is None:
            return Spot(points, np.nan, 0.0, 0.0, -1, 0)
        x, y = self._motions[side].inverse.of(points[:, 0], points[:, 1])
        passed, looks = ground.passed(x, y), ground.seen(x, y)
        _, away = nearest.of(x, y)
        near = away <= CHANGED
        free = passed >= SEEN_FREE
        return Spot(
            points,
            free=float(np.mean(free & ~(away <= 0.5 * CHANGED))),
            passed=float(np.mean(passed > 0)),
            near=float(np.mean(near)),
            looks=int(np.max(looks)),
            sweeps=int(np.median(passed[free])) if free.any() else 0,
        )

    # Things.

    def _alone(self, side: int, k: int, chance: Float64, near: Bool, other: Bool, taken: list[int]) -> UnpairedStatus:
        """Return the status of a thing of one run that is certainly one with none of the other run.

        By its probability of being one thing with each of these (M,); `near` are those in its place, `other` those of which
        some of either place was seen free, `taken` those elsewhere that are certainly one with another thing.
        """
        spot = self._spots[side][k]
        there, alone = float(chance[near].sum()), max(0.0, 1.0 - float(chance.sum()))
        ambiguous = UnpairedStatus(UNCERTAIN, AMBIGUOUS, max(float(chance.max(initial=0.0)), alone) * self._chance)
        if there >= self._least:
            # It is in its place, whichever of several it is.
            status, score = KNOWN, there
        elif alone < 1.0 - self._least and not there:
            # It was moved, but nobody knows which one it is.
            return ambiguous
        elif spot.is_free and self._seen(side, spot.points).is_free:
            # Its own run saw nothing there most of the time: it flickers, or stayed for a while.
            return UnpairedStatus(UNCERTAIN, SHORT, 0.0)
        elif spot.is_free:
            # It may be one that is found elsewhere, but nothing tells so.
            status, score = (GONE if side == 0 else NEW), (1.0 - there) * spot.certainty
        elif np.isnan(spot.free):
            return UnpairedStatus(UNCERTAIN, NO_FREE_SPACE, 0.0)
        elif near.any() and other[near].all():
            # Another one took its place.
            return ambiguous
        elif spot.near >= FREE_SHARE and not self._is_covered(side, k, taken):
            # The other run takes it for a part of the building, or saw something else of it.
            status, score = KNOWN, spot.near / (spot.near + spot.free)
        elif spot.passed >= FREE_SHARE:
            return UnpairedStatus(UNCERTAIN, SHORT, 0.0)
        else:
            return UnpairedStatus(UNCERTAIN, self._out_of_sight(side, spot), 0.0)
        score *= self._chance
        if score >= self._least:
            return UnpairedStatus(status, CERTAIN, score)
        return UnpairedStatus(UNCERTAIN, SHORT if spot.is_free and not there else AMBIGUOUS, score)

    def _is_covered(self, side: int, k: int, taken: list[int]) -> bool:
        """Tell whether a thing that has another partner stands in the place of this one in the other run."""
        return bool(within(self._boxes[1 - side][taken, :2], self._boxes[side][k], BESIDE).any())

    def _out_of_sight(self, side: int, spot: Spot) -> int:
        """Tell why the other run did not see a place: what hides it was not there, or parts around it were seen."""
        run, old = self._runs[1 - side], self._nearest[side]
        nearest = self._nearest[1 - side]
        assert run.ground is not None
        assert nearest is not None
        x, y = spot.points.mean(axis=0).tolist()
        back, to_old = self._motions[1 - side].inverse, self._motions[side].inverse
        (there_x,), (there_y,) = back.of(np.array([x]), np.array([y]))
        stations = run.sensors[:: max(1, len(run.sensors) // MAX_STATIONS)]
        for begin in stations:
            ahead = np.array([there_x, there_y]) - begin
            length = float(np.hypot(*ahead))
            steps = np.arange(0.1, max(length, 0.2), 0.5 * run.ground.resolution) / max(length, 1e-9)
            ray = begin + steps[:, None] * ahead
            index, away = nearest.of(ray[:, 0], ray[:, 1])
            hit = np.flatnonzero(away <= run.ground.resolution)
            if not len(hit):
                continue
            first = run.ground.points[index[hit[0]]]
            if old is None:
                return HIDDEN
            at = self._motions[1 - side].of(first[:1], first[1:])
            _, far = old.of(*to_old.of(*at))
            if far[0] > CHANGED:
                return HIDDEN
        around = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
        ring_x, ring_y = there_x + AROUND * np.cos(around), there_y + AROUND * np.sin(around)
        known = run.ground.state(ring_x, ring_y) != UNKNOWN
        return HIDDEN if known.mean() >= 0.25 else OUT_OF_VIEW

    def _add(self, status: int, why: int, score: float, i: int, j: int) -> None:
        """Keep a thing; sizes are those of the run that has seen it, of both the second one."""
        side, k = (1, j) if j >= 0 else (0, i)
        things = self._things[side]
        area = float(things.length[k] * things.width[k])
        before = self._spots[1][j] if j >= 0 else None
        after = self._spots[0][i] if i >= 0 else None
        # What a run saw of a thing of its own is that thing.
        looks = (
            self._own_looks(0, i) if before is None else before.looks,
            self._own_looks(1, j) if after is None else after.looks,
        )
        free = math.nan if before is None else before.free, math.nan if after is None else after.free
        self._changes.append(Change(THING, status, why, score, area, looks, free, i, j))

    def _own_looks(self, side: int, k: int) -> int:
        """Return the number of sweeps that could see a thing of their own run."""
        ground = self._runs[side].ground
        if ground is None:
            return -1
        points = _filled(box_of(self._things[side], self._yaw[side], k))
        x, y = self._motions[side].inverse.of(points[:, 0], points[:, 1])
        return int(ground.seen(x, y).max())

    # Structure.

    def _structure(self, side: int) -> None:
        """Find clusters of structure of one run where the other saw free ground."""
        here, there = self._runs[side].ground, self._runs[1 - side].ground
        nearest = self._nearest[1 - side]
        if here is None or there is None or nearest is None or not len(here.points):
            return
        points = np.column_stack(self._motions[side].of(here.points[:, 0], here.points[:, 1]))
        x, y = self._motions[1 - side].inverse.of(points[:, 0], points[:, 1])
        _, away = nearest.of(x, y)
        passed = there.passed(x, y)
        changed = (away > CHANGED) & (passed >= SEEN_FREE)
        at = np.flatnonzero(changed)
        at = np.delete(at, np.concatenate([contained(boxes, points[at], EXPLAINED)[1] for boxes in self._boxes]))
        looks = here.seen(*self._motions[side].inverse.of(points[at, 0], points[at, 1]))
        others = there.seen(x[at], y[at])
        linked = max(LINKED, 2.1 * here.resolution)
        found = [each for each in clusters(points[at], linked) if len(each) >= MIN_CELLS]
        if not found:
            return
        boxes = rectangles(points[at[np.concatenate(found)]], np.cumsum([0, *map(len, found[:-1])]))
        large = np.flatnonzero(boxes[:, 3] >= MIN_CHANGE)
        if len(large) > MAX_CHANGES:
            raise TooManyError(f"{len(large):,} places of their structure, more than are told ({MAX_CHANGES:,})")
        for box, cluster in ((boxes[k], found[k]) for k in large.tolist()):
            sweeps = int(np.median(passed[at[cluster]]))
            score = (sweeps + 1) / (sweeps + 2) * self._chance
            certain = score >= self._least
            status = (NEW if side else GONE) if certain else UNCERTAIN
            pair = int(np.max(looks[cluster])), int(np.max(others[cluster]))
            free, area = (0.0, 1.0), len(cluster) * here.resolution**2
            if side:
                pair, free = pair[::-1], free[::-1]
            why = CERTAIN if certain else SHORT
            self._changes.append(Change(STRUCTURE, status, why, score, area, pair, free, place=tuple(box.tolist())))


class UnpairedStatus(NamedTuple):
    """Status of a thing that is in no pair."""

    status: int
    why: int
    score: float


@dataclass(frozen=True, slots=True)
class Spot:
    """Place of the hits of a thing, and what the other run saw of it."""

    points: Float64
    """(K, 2) in the coordinates of the first run [m]."""
    free: float
    """Share that was seen free by `SEEN_FREE` sweeps; NaN where nobody knows."""
    passed: float
    """Share that was seen free by any sweep."""
    near: float
    """Share within `CHANGED` of structure of the other run."""
    looks: int
    """Most sweeps that saw any of it; -1 where unknown."""
    sweeps: int
    """Sweeps that saw free what was free, the median."""

    @property
    def is_free(self) -> bool:
        """True if enough of it was seen free."""
        return self.free >= FREE_SHARE

    @property
    def certainty(self) -> float:
        """Probability that it was free, by the sweeps that say so."""
        return (self.sweeps + 1) / (self.sweeps + 2)


def _filled(box: Float64) -> Float64:
    """Return (K, 2) places all over a box."""
    along = np.linspace(-0.5, 0.5, max(3, int(box[3] / 0.05))) * box[3]
    across = np.linspace(-0.5, 0.5, max(3, int(box[4] / 0.05))) * box[4]
    u, v = (part.ravel() for part in np.meshgrid(along, across))
    cos, sin = math.cos(box[2]), math.sin(box[2])
    return np.column_stack([box[0] + cos * u - sin * v, box[1] + sin * u + cos * v])
