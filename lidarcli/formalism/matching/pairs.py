"""Probabilities of static objects of two runs being one object, in its place or moved (§3, matching).

Every pair of an object of the first run and one of the second has a weight: the odds of being one object against being two.
The probabilities of all pairs follow together by belief propagation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from lidarcli.formalism.matching.alignment import MIN_AREA, SIZE_RANGE, StaticObjects, alike, coded
from lidarcli.formalism.matching.extents import BESIDE, boxes_of, contained
from lidarcli.formalism.matching.free_space import Buckets
from lidarcli.sweeps.types import Bool, Float64, Int64, record

SAME_PLACE = 0.2
"""[m] An object is in its place up to this distance, …"""
PLACE_SD, UNSIZED_SD = 0.03, 0.1
"""[m] … or three standard deviations: of an object whose sizes are known, and of others."""
REPLACED = 0.02
"""Odds of another object having taken the place of one, against it being the same."""
MOVES = 0.08
"""Odds of an object having been moved within its room, against one having gone and another one having come; near places are
likelier by the inverse of 1 m and the distance."""
FREE_SHARE, ANY_FREE = 0.5, 0.25
"""Least share of where an object was hit that has been observed free, and that becomes free where it is moved by less than
its size."""
VIEW_SIZE_SD, WRONG_VIEW = 0.02, 0.02
"""[m] Standard deviation between two sizes of one object that is observed from other sides, and the share of wrong ones."""
STANDING_SIZE_SD = 0.03
"""[m] The same deviation of one that is static in a place of which some was observed free, whatever is hidden of its
sides."""
GRAZING_SD = 0.1
"""Standard deviation of a side, as a share of what was not observed at its ends: beams there are as far apart."""
HALF_ENDS = 0.6
"""[m] With so much unobserved space at its ends, one side in two ends where it was last observed."""
ROUNDS = 60
"""Rounds of belief propagation."""
FARTHEST = max(SAME_PLACE, 3.0 * math.hypot(UNSIZED_SD, UNSIZED_SD))
"""[m] Greatest distance of one object in its place from itself."""
MAX_MOVED = 1000
"""Most objects of each run that have left their places and are looked for elsewhere."""


@record
class Side:
    """N objects of one run in the coordinates of the first one, and what is known of their places."""

    things: StaticObjects
    yaw: Float64
    """(N,) direction of the longer side [rad]."""
    more: Float64
    """(N, 2) how far length and width may go on where the own run observed nothing [m]."""
    free: Float64
    """(N,) share of where it was hit that the other run observed free; NaN where it is unknown."""

    def rows(self, index: Int64) -> Side:
        """Return some of the objects."""
        return Side(self.things.rows(index), self.yaw[index], self.more[index], self.free[index])

    @property
    def left(self) -> Bool:
        """(N,) True if the place was observed free."""
        return self.free >= FREE_SHARE

    @property
    def stays(self) -> Bool:
        """(N,) True if hardly any of the place was observed free."""
        return self.free < ANY_FREE

    @property
    def some_free(self) -> Bool:
        """(N,) True if some of the place was observed free."""
        return self.free >= ANY_FREE


class Pairs(NamedTuple):
    """P pairs of objects of two runs, by index of the first and then of the second."""

    first: Int64
    second: Int64
    near: Bool
    """True if they are in one place, as far as is known."""


def pairs_of(a: Side, b: Side) -> Pairs:
    """Return all pairs that may be one object, or hide each other; `TooManyError` if too many have left their places.

    Middles of objects of which other sides were observed may be farther apart; then one is within the other, and neither
    place has become free."""
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


def _away(a: StaticObjects, b: StaticObjects) -> tuple[Float64, Float64]:
    """Return (P,) the distance of each pair, and its standard deviation [m]."""
    own = [np.where(np.isfinite(each.length + each.width), PLACE_SD, UNSIZED_SD) for each in (a, b)]
    return np.hypot(a.x - b.x, a.y - b.y), np.hypot(*own)


def probabilities(first: Side, second: Side, pairs: Pairs) -> Float64:
    """Return (P,) the probability of each pair being one object."""
    if not len(pairs.first):
        return np.empty(0)
    a, b = first.rows(pairs.first), second.rows(pairs.second)
    one, other = a.things, b.things
    away, sd = _away(one, other)
    off = np.minimum(away / np.maximum(sd, SAME_PLACE / 3.0), 3.0)
    like = alike(one, other)
    # What was observed through where the other one stands has to be as large.
    large = np.minimum(like, alike(one, other, STANDING_SIZE_SD, WRONG_VIEW))
    stays = np.exp(np.where(a.some_free | b.some_free, large, like) - 0.5 * off**2) / REPLACED
    named = (one.label >= 0) & (one.label == other.label)
    length, width = (np.fmax(np.nan_to_num(each.length), SAME_PLACE) for each in (one, other))
    may = (a.left & b.left) | ((away <= np.fmin(length, width)) & ~(a.stays & b.stays))
    may &= (np.isfinite(one.length) & np.isfinite(other.length)) | named
    nearer = _nearer(away, first.things, second.things)
    moves = np.where(may, MOVES * nearer * np.exp(same_sizes(a, b)), 0.0)
    return _marginals(np.where(pairs.near, stays, moves), pairs)


def _nearer(away: Float64, one: StaticObjects, other: StaticObjects) -> Float64:
    """Return how much likelier than anywhere in the room in which objects stand their places at a distance [m] are."""
    x, y = (np.concatenate([getattr(one, axis), getattr(other, axis)]) for axis in ("x", "y"))
    # Of places all over a disc.
    radius = math.sqrt(max(2.0 * float(np.var(x) + np.var(y)), MIN_AREA / math.pi))
    return 0.5 * radius**2 / (radius - math.log1p(radius)) / (1.0 + away)


def same_sizes(a: Side, b: Side) -> Float64:
    """Return (P,) the log-likelihood ratio of two objects being one, by their sizes, shapes and labels.

    A side is as it was measured, or where nothing was observed beyond it anything up to its most.
    """
    one, other = _sides(a.things, a.more), _sides(b.things, b.more)
    straight = _side(one[0], other[0]) + _side(one[1], other[1])
    # Of which side too little was observed, it is unknown whether it is the longer one.
    crossed = _side(one[0], other[1]) + _side(one[1], other[0])
    return np.maximum(straight, crossed) + coded(a.things, b.things)


Sides = tuple[Float64, Float64, Float64]
"""Sizes of objects, their standard deviations, and how far they may go on [m]."""


def _sides(things: StaticObjects, more: Float64) -> tuple[Sides, Sides]:
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
    return through / (1.0 + np.bincount(pairs.first, through)[pairs.first])


class TooManyError(ValueError):
    """Two runs differ in more places or objects than are compared; the text says in how many."""
