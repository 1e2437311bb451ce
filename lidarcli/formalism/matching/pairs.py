"""Probabilities of things of two runs being one, in its place or moved (§3, matching).

Every pair of a thing of the first run and one of the second has a weight: the odds of being one thing against being two.
The probabilities of all pairs follow together by belief propagation.
"""

from __future__ import annotations

import math

import numpy as np

from lidarcli.formalism.matching.extents import BESIDE, box_of, within
from lidarcli.formalism.matching.runs import LEAST_AREA, SIZE_RANGE, Standing, alike, coded
from lidarcli.sweeps import Bool, Float64, record

SAME_PLACE = 0.2
"""[m] A thing is in its place up to this distance, …"""
PLACE_SD, UNSIZED_SD = 0.03, 0.1
"""[m] … or three standard deviations: of a thing whose sizes are known, and of others."""
REPLACED = 0.02
"""Odds of another thing having taken the place of one, against it being the same."""
MOVES = 0.08
"""Odds of a thing having been moved within its room, against one having gone and another one having come; near places are
likelier by the inverse of 1 m and the distance."""
FREE_SHARE = 0.5
"""Least share of where a thing was hit that has been seen free."""
ANY_FREE = 0.25
"""Least share of where a thing was hit that becomes free where it is moved by less than its size."""
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

    @property
    def left(self) -> Bool:
        """(N,) True if the place was seen free."""
        return self.free >= FREE_SHARE

    @property
    def stays(self) -> Bool:
        """(N,) True if hardly any of the place was seen free."""
        return self.free < ANY_FREE


def some_free(a: Side, b: Side) -> Bool:
    """Return (N, M) whether some of the place of either thing of each pair was seen free."""
    one, other = a.free >= ANY_FREE, b.free >= ANY_FREE
    return one[:, None] | other


def in_place(a: Side, b: Side) -> Bool:
    """Return (N, M) whether the things of each pair are in one place, as far as is known.

    Middles of things of which other sides were seen may be farther apart; then one is within the other, and neither place
    has become free.
    """
    away, sd = _away(a.things, b.things)
    places = [np.column_stack([each.things.x, each.things.y]) for each in (a, b)]
    inside = np.zeros(away.shape, np.bool_)
    for i in range(len(a.things)):
        inside[i] |= within(places[1], box_of(a.things, a.yaw, i), BESIDE)
    for j in range(len(b.things)):
        inside[:, j] |= within(places[0], box_of(b.things, b.yaw, j), BESIDE)
    near: Bool = (away <= np.maximum(SAME_PLACE, 3.0 * sd)) | (inside & a.stays[:, None] & b.stays)
    return near


def _away(a: Standing, b: Standing) -> tuple[Float64, Float64]:
    """Return (N, M) the distance of each pair, and its standard deviation [m]."""
    away = np.hypot(a.x[:, None] - b.x, a.y[:, None] - b.y)
    own = [np.where(np.isfinite(each.length + each.width), PLACE_SD, UNSIZED_SD) for each in (a, b)]
    return away, np.hypot(own[0][:, None], own[1])


def probabilities(a: Side, b: Side, near: Bool) -> Float64:
    """Return (N, M) the probability of each pair being one thing; `near` of `in_place`."""
    one, other = a.things, b.things
    if not len(one) or not len(other):
        return np.zeros((len(one), len(other)))
    away, sd = _away(one, other)
    off = np.minimum(away / np.maximum(sd, SAME_PLACE / 3.0), 3.0)
    like = alike(one, other)
    # What was seen through where the other one stands has to be as large.
    large = np.minimum(like, alike(one, other, STANDING_SIZE_SD, WRONG_VIEW))
    stays = np.exp(np.where(some_free(a, b), large, like) - 0.5 * off**2) / REPLACED
    sized = [np.isfinite(each.length) for each in (one, other)]
    named = (one.label >= 0)[:, None] & (one.label[:, None] == other.label)
    length, width = (np.fmax(np.nan_to_num(each.length), SAME_PLACE) for each in (one, other))
    may = (a.left[:, None] & b.left) | ((away <= np.fmin(length[:, None], width)) & ~(a.stays[:, None] & b.stays))
    may &= (sized[0][:, None] & sized[1]) | named
    moves = np.where(may, MOVES * _nearer(away, one, other) * np.exp(same_sizes(a, b)), 0.0)
    return _marginals(np.where(near, stays, moves))


def _nearer(away: Float64, one: Standing, other: Standing) -> Float64:
    """Return how much likelier than anywhere in the room in which things stand their places at a distance [m] are."""
    x, y = (np.concatenate([getattr(one, axis), getattr(other, axis)]) for axis in ("x", "y"))
    # Of places all over a disc.
    radius = math.sqrt(max(2.0 * float(np.var(x) + np.var(y)), LEAST_AREA / math.pi))
    result: Float64 = 0.5 * radius**2 / (radius - math.log1p(radius)) / (1.0 + away)
    return result


def same_sizes(a: Side, b: Side) -> Float64:
    """Return (N, M) the log-likelihood ratio of two things being one, by their sizes, shapes and labels.

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
    """Return (N, M) the log-likelihood ratio of two sides being one."""
    (a, a_sd, a_more), (b, b_sd, b_more) = one, other
    sd = np.hypot(np.hypot(a_sd[:, None], b_sd), VIEW_SIZE_SD)
    a_ends, b_ends = (1.0 / (1.0 + (more / HALF_ENDS) ** 2) for more in (a_more, b_more))
    right = np.zeros(sd.shape)
    for p, p_chance in ((0.0 * a_more, a_ends), (a_more, 1.0 - a_ends)):
        for q, q_chance in ((0.0 * b_more, b_ends), (b_more, 1.0 - b_ends)):
            apart = np.maximum(np.maximum(a[:, None] - (b + q), b - (a + p)[:, None]), 0.0)
            wide = np.hypot(math.sqrt(2.0 * math.pi) * sd, np.maximum(p[:, None], q))
            right += p_chance[:, None] * q_chance / wide * np.exp(-0.5 * (apart / sd) ** 2)
    ratio = np.log((1.0 - WRONG_VIEW) * SIZE_RANGE * right + WRONG_VIEW)
    return np.where(np.isfinite(right), ratio, 0.0)


def _marginals(weight: Float64) -> Float64:
    """Return (N, M) the probability of each pair, where every row and column is in one pair or in none.

    Parameters
    ----------
    weight : (N, M) odds of each pair against none

    >>> np.round(_marginals(np.array([[9.0, 0.0], [0.0, 1.0]])), 3).tolist()
    [[0.9, 0.0], [0.0, 0.5]]
    """
    back = np.ones(weight.shape)
    for _ in range(ROUNDS):
        through = weight * back
        to = weight / (1.0 + through.sum(axis=1, keepdims=True) - through)
        back = 1.0 / (1.0 + to.sum(axis=0, keepdims=True) - to)
    through = weight * back
    result: Float64 = through / (1.0 + through.sum(axis=1, keepdims=True))
    return result
