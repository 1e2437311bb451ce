"""How one run lies beside others, by the constellation of what stands still: pairs of things as far apart as other pairs.

Every two things of the run, beside two known ones of like sizes and the same distance, propose a turn and a shift. The one
under which most of what was seen falls into its place wins; how likely it is beside the others is its chance.
"""

from __future__ import annotations

import math

import numpy as np

from lidarcli.formalism.matching import (
    HERE,
    PLACE_SD,
    SURE,
    Motion,
    Standing,
    alike,
    area,
    gains,
    near,
    placed_at,
)
from lidarcli.formalism.pairing import assign
from lidarcli.sweeps import Float64, Int64

MOST_THINGS = 40
"""So many things of each side propose: those whose sizes are known, the largest first."""
MOST_PROPOSALS = 3000
"""So many proposals are looked at, those of the most alike pairs first."""
BEST = 24
"""So many of them that differ are refined."""
WORTH = 0.4
"""A proposal that explains less than this share of what the best one does is none."""
REFINEMENTS = 6
"""Steps from the things in place to the motion that fits them best, and on."""
APART = 0.3
"""[m] Distances of pairs that differ by more are not those of the same things."""
UNLIKE = -3.0
"""Things whose sizes, shapes and labels are less alike than this are not the same."""
SHORT = 0.3
"""[m] Things closer together do not tell a direction."""
LEAST_IN_PLACE = 3
"""Fewer things in place do not tell a turn and a shift: two pairs of the same distance there are always. Where the
frames are the same, two are enough."""
PRIOR = 12.0
"""A turn and a shift have to explain this much more, by its logarithm, than that the sensor's frames are the same."""
IN_PLACE = 4.0
"""Standard deviations within which a thing is in its place."""
CHUNK = 256


def align(known: Standing, run: Standing) -> tuple[Motion | None, float]:
    """The motion from the coordinates of a run to those of the known things, and how likely it is; None where none fits.

    Parameters
    ----------
    known, run : the things of the runs so far, and of another one
    """
    if not len(known) or not len(run):
        return None, 0.0
    found: dict[bytes, tuple[float, Motion]] = {}
    for motion in [HERE, *_best(known, run)]:
        refined = motion if motion == HERE else _refine(known, run, motion)
        placed = placed_at(run, *refined.of(run.x, run.y))
        gain = gains(known, placed)
        pair = assign(gain.T - SURE)
        one = np.flatnonzero(pair >= 0)
        standing = int(np.count_nonzero(_away(known, placed)[pair[one], one] < IN_PLACE * PLACE_SD))
        if standing < (min(2, len(known), len(run)) if refined == HERE else LEAST_IN_PLACE):
            continue
        total = float((gain[pair[one], one] - SURE).sum()) - (0.0 if refined == HERE else PRIOR)
        key = pair.tobytes()
        if key not in found or total > found[key][0]:
            found[key] = total, refined
    if not found:
        return None, 0.0
    # Of equals the first: as the frames are, then in the order of the proposals.
    best, motion = max(found.values(), key=lambda each: each[0])
    if best <= 0.0:
        return None, 0.0
    return motion, 1.0 / sum(math.exp(total - best) for total, _ in found.values())


def _best(known: Standing, run: Standing) -> list[Motion]:
    """The proposals under which most falls into its place."""
    ours, theirs = _chosen(known), _chosen(run)
    like = alike(known, run)[np.ix_(ours, theirs)]
    x0, y0, x1, y1 = known.x[ours], known.y[ours], run.x[theirs], run.y[theirs]
    a, b = (part.ravel() for part in np.nonzero(~np.eye(len(ours), dtype=bool)))
    i, j = np.triu_indices(len(theirs), 1)
    there, here = np.hypot(x0[b] - x0[a], y0[b] - y0[a]), np.hypot(x1[j] - x1[i], y1[j] - y1[i])
    first, second = like[a][:, i], like[b][:, j]
    fits = np.abs(there[:, None] - here) < APART
    fits &= (first > UNLIKE) & (second > UNLIKE) & (there[:, None] > SHORT) & (here > SHORT)
    p, q = np.nonzero(fits)
    weight = (first + second)[p, q] - ((there[p] - here[q]) / (2.0 * PLACE_SD)) ** 2
    order = np.lexsort((-there[p], -weight))[:MOST_PROPOSALS]
    a, b, i, j = a[p[order]], b[p[order]], i[q[order]], j[q[order]]
    angle = np.arctan2(y0[b] - y0[a], x0[b] - x0[a]) - np.arctan2(y1[j] - y1[i], x1[j] - x1[i])
    cos, sin = np.cos(angle), np.sin(angle)
    middle_x, middle_y = 0.5 * (x1[i] + x1[j]), 0.5 * (y1[i] + y1[j])
    shift_x = 0.5 * (x0[a] + x0[b]) - cos * middle_x + sin * middle_y
    shift_y = 0.5 * (y0[a] + y0[b]) - sin * middle_x - cos * middle_y
    room, quality = area(known, run), np.empty(len(order))
    for begin in range(0, len(order), CHUNK):
        at = slice(begin, begin + CHUNK)
        c, s = cos[at, None], sin[at, None]
        x = shift_x[at, None] + c * x1 - s * y1
        y = shift_y[at, None] + s * x1 + c * y1
        away = np.hypot(x[:, None, :] - x0[:, None], y[:, None, :] - y0[:, None])
        gain = np.maximum(like + near(away, room) - SURE, 0.0)
        quality[at] = np.minimum(gain.max(axis=2).sum(axis=1), gain.max(axis=1).sum(axis=1))
    best: list[Motion] = []
    for k in np.argsort(-quality, kind="stable").tolist():
        motion = Motion(float(angle[k]), float(shift_x[k]), float(shift_y[k]))
        if not any(_same(motion, other, x1, y1) for other in best):
            best.append(motion)
        if len(best) == BEST or quality[k] < WORTH * quality.max():
            break
    return best


def _same(one: Motion, other: Motion, x: Float64, y: Float64) -> bool:
    """Whether two motions bring all things to the same places."""
    (x0, y0), (x1, y1) = one.of(x, y), other.of(x, y)
    return bool(np.hypot(x1 - x0, y1 - y0).max() < IN_PLACE * PLACE_SD)


def _chosen(things: Standing) -> Int64:
    """The things that propose."""
    size = np.nan_to_num(things.length, nan=-1.0)
    return np.sort(np.argsort(-size, kind="stable")[:MOST_THINGS]).astype(np.int64)


def _refine(known: Standing, run: Standing, motion: Motion) -> Motion:
    """The motion that fits those things best that fall into their places."""
    like = alike(known, run)
    for _ in range(REFINEMENTS):
        placed = placed_at(run, *motion.of(run.x, run.y))
        away = _away(known, placed)
        gain = np.where(away < IN_PLACE * PLACE_SD, like + near(away, area(known, placed)) - SURE, -np.inf)
        pair = assign(gain.T)
        one = np.flatnonzero(pair >= 0)
        if len(one) < 2:
            return motion
        moved = _fit(run.x[one], run.y[one], known.x[pair[one]], known.y[pair[one]])
        if moved == motion:
            break
        motion = moved
    return motion


def _away(known: Standing, run: Standing) -> Float64:
    result: Float64 = np.hypot(known.x[:, None] - run.x, known.y[:, None] - run.y)
    return result


def _fit(x: Float64, y: Float64, to_x: Float64, to_y: Float64) -> Motion:
    """The turn and shift of least squares from points to points."""
    mean_x, mean_y, mean_u, mean_v = (float(each.mean()) for each in (x, y, to_x, to_y))
    dx, dy, du, dv = x - mean_x, y - mean_y, to_x - mean_u, to_y - mean_v
    angle = math.atan2(float((dx * dv - dy * du).sum()), float((dx * du + dy * dv).sum()))
    cos, sin = math.cos(angle), math.sin(angle)
    return Motion(angle, mean_u - cos * mean_x + sin * mean_y, mean_v - sin * mean_x - cos * mean_y)
