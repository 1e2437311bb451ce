"""Standing things that are the same in several runs (§3, matching), by their places and by what they are.

Every pair of a known thing and a thing of the next run is weighed: how much likelier are the measurements of both if they
are one thing than if they are two? A thing that stands where it stood is recognised by its place, one that was moved by its
size, shape and label. The pairs with the greatest sum win.

Where the coordinates of a run are unknown, they follow from the constellation of its things. Every two things of the run,
beside two known ones of similar sizes and the same distance, propose a turn and a shift. The proposal under which most
things fall into place wins, and its probability beside the others is its chance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lidarcli.formalism.matching.catalogue import LARGEST_SIZE, SMALLEST_SIZE
from lidarcli.sweeps import Bool, Float64, Int32, Int64, record

RUN_PLACE_SD = 0.1
"""[m] Standard deviation of the place of a standing thing in a run."""
RUN_SIZE_SD = 0.01
"""[m] Standard deviation between two sizes of the same thing, beside their own."""
WRONG_SIZE = 0.1
"""Share of sizes that are wrong, as of a thing of which a part was never seen."""
SIZE_RANGE = LARGEST_SIZE - SMALLEST_SIZE
"""[m] Range of the sizes of different things."""
STAYS = 0.9
"""Probability that a thing stands where it stood."""
NEARNESS = 0.05
"""[1/m] Log-likelihood that is lost with each metre between two places of a moved thing."""
LEAST_GAIN = 2.9
"""Least log-likelihood ratio of a pair: 18 to 1."""
SAME_SHAPE, OTHER_SHAPE = 0.7, -2.0
"""Log-likelihood ratio of two known shapes, the same or another."""
SAME_LABEL, OTHER_LABEL = 2.0, -20.0
"""Log-likelihood ratio of two labels, the same or another."""
LEAST_AREA = 10.0
"""[m²] Least area in which things stand."""
MOST_THINGS = 40
"""Greatest number of things of each side that propose motions, the largest first."""
MOST_ALIGNED = 100
"""Greatest number of things of each side by which runs are aligned, the largest first."""
MOST_PROPOSALS = 3000
"""Greatest number of proposals, those of the most alike pairs first."""
MOST_REFINED = 24
"""Greatest number of different proposals that are refined."""
LEAST_QUALITY = 0.4
"""Least quality of a proposal, as a share of the best one."""
MOTION_REFINEMENTS = 6
"""Greatest number of refinements of a motion by the things in place."""
PAIR_TOLERANCE = 0.3
"""[m] Greatest difference between the distances of two pairs of the same things."""
LEAST_ALIKE = -3.0
"""Least log-likelihood ratio of two things that may be the same, by size, shape and label."""
SHORTEST_PAIR = 0.3
"""[m] Least distance between two things that give a direction."""
LEAST_IN_PLACE = 3
"""Least number of things in place for a turn and a shift, as two pairs of the same distance are common. If the frames are
the same, two are enough."""
MOTION_PRIOR = 12.0
"""Log-likelihood by which a turn and a shift have to be better than equal frames."""
IN_PLACE_SDS = 4.0
"""Greatest distance of a thing from its place, in standard deviations."""
PROPOSALS_AT_ONCE = 256


@record
class Standing:
    """N standing things of one run, (N,) each; lengths in metres, NaN if unknown."""

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


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion from the coordinates of a run to those of the first one: a turn [rad], then a shift [m]."""

    angle: float = 0.0
    x: float = 0.0
    y: float = 0.0

    def of(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Return places in the coordinates of the first run [m]."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return self.x + cos * x - sin * y, self.y + sin * x + cos * y

    @property
    def inverse(self) -> Motion:
        """The motion back."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return Motion(-self.angle, -cos * self.x - sin * self.y, sin * self.x - cos * self.y)


HERE = Motion()
"""Motion of a run in the coordinates of the first one."""


def gains(known: Standing, run: Standing) -> Float64:
    """Return (T, N) the log-likelihood ratio of each pair being one thing, in its place or moved, and not two."""
    return np.maximum(in_place(known, run), _moved(known, run))


def in_place(known: Standing, run: Standing) -> Float64:
    """Return (T, N) the log-likelihood ratio of each pair being one thing that was not moved."""
    return alike(known, run) + near(_distance(known, run), area(known, run))


def near(distance: Float64, room: float) -> Float64:
    """Return the log-likelihood ratio of one thing at two places with a distance [m], in a room of an area [m²]."""
    result: Float64 = (
        math.log(STAYS * max(room, LEAST_AREA) / (4.0 * math.pi * RUN_PLACE_SD**2)) - 0.25 * (distance / RUN_PLACE_SD) ** 2
    )
    return result


def area(known: Standing, run: Standing) -> float:
    """Return the area in which the things stand [m²]."""
    sides = []
    for one, other in ((known.x, run.x), (known.y, run.y)):
        both = np.concatenate([one, other])
        sides.append(float(np.ptp(both)) + 1.0 if len(both) else 1.0)
    return max(sides[0] * sides[1], LEAST_AREA)


def alike(known: Standing, run: Standing, size_sd: float = RUN_SIZE_SD, wrong: float = WRONG_SIZE) -> Float64:
    """Return (T, N) the log-likelihood ratio of being one thing by size, shape and label; 0 if these are unknown.

    Parameters
    ----------
    size_sd : standard deviation between two sizes of the same thing, beside their own [m]
    wrong : share of sizes that are wrong
    """
    total = np.zeros((len(known), len(run)))
    for size in ("length", "width"):
        apart = getattr(known, size)[:, None] - getattr(run, size)
        sd = np.hypot(getattr(known, f"{size}_sd")[:, None], getattr(run, f"{size}_sd"))
        sd = np.hypot(np.nan_to_num(sd), size_sd)
        right = SIZE_RANGE / (math.sqrt(2.0 * math.pi) * sd) * np.exp(-0.5 * (apart / sd) ** 2)
        ratio = np.log((1.0 - wrong) * right + wrong)
        total += np.where(np.isfinite(apart), ratio, 0.0)
    return total + coded(known, run)


def coded(known: Standing, run: Standing) -> Float64:
    """Return (T, N) the log-likelihood ratio of being one thing by shape and label."""
    return _codes(known.shape, run.shape, SAME_SHAPE, OTHER_SHAPE) + _codes(known.label, run.label, SAME_LABEL, OTHER_LABEL)


def _codes(known: Int32, run: Int32, same: float, other: float) -> Float64:
    """Return (T, N) the log-likelihood ratio by two codes."""
    there = (known >= 0)[:, None] & (run >= 0)
    return np.where(there, np.where(known[:, None] == run, same, other), 0.0)


def _moved(known: Standing, run: Standing) -> Float64:
    """Return (T, N) the log-likelihood ratio of each pair being one thing that was moved; -inf without sizes."""
    sized: Bool = np.isfinite(known.length + known.width)[:, None] & np.isfinite(run.length + run.width)
    ratio = alike(known, run) + math.log(1.0 - STAYS) - NEARNESS * _distance(known, run)
    return np.where(sized, ratio, -np.inf)


def _distance(known: Standing, run: Standing) -> Float64:
    """Return (T, N) the distances of things [m]."""
    result: Float64 = np.hypot(known.x[:, None] - run.x, known.y[:, None] - run.y)
    return result


def placed_at(run: Standing, x: Float64, y: Float64) -> Standing:
    """Return the things at other places."""
    return replace(run, x=x, y=y)


def assign(gain: Float64) -> Int64:
    """Return the pairs with the greatest sum of gains, by shortest augmenting paths; none has a gain of 0 or less.

    The choice among equal sums is always the same.

    Parameters
    ----------
    gain : (N, M) gain of each pair of row and column, -inf for pairs that are ruled out

    Returns
    -------
    (N,) column of each row, -1 for none

    >>> assign(np.array([[3.0, 2.0], [2.0, -1.0]])).tolist()
    [1, 0]
    """
    rows, columns = gain.shape
    # Behind the others every row has a column of its own with no gain.
    cost = np.full((rows, columns + rows), np.inf)
    cost[:, :columns] = np.where(gain > 0.0, -gain, np.inf)
    cost[np.arange(rows), columns + np.arange(rows)] = 0.0
    row_of = np.full(columns + rows, -1)
    column_of = np.full(rows, -1)
    price = np.zeros(columns + rows)
    for row in range(rows):
        _augment(cost, row, price, row_of, column_of)
    result: Int64 = np.where(column_of < columns, column_of, -1)
    return result


def _augment(cost: Float64, start: int, price: Float64, row_of: Int64, column_of: Int64) -> None:
    """Give a row a column along the cheapest path of changes of the other rows."""
    distance = np.full(cost.shape[1], np.inf)
    before = np.full(cost.shape[1], start)
    done = np.zeros(cost.shape[1], np.bool_)
    row, way = start, 0.0
    while True:
        # By the prices, pairs that exist cost nothing along the path.
        level = 0.0 if row == start else cost[row, column_of[row]] - price[column_of[row]]
        through = way + cost[row] - price - level
        shorter = ~done & (through < distance)
        distance[shorter], before[shorter] = through[shorter], row
        column = int(np.argmin(np.where(done, np.inf, distance)))
        way = float(distance[column])
        done[column] = True
        if row_of[column] < 0:
            break
        row = int(row_of[column])
    price[done] += distance[done] - way
    while True:
        row = int(before[column])
        row_of[column] = row
        column_of[row], column = column, int(column_of[row])
        if row == start:
            return


def align(known: Standing, run: Standing) -> tuple[Motion | None, float]:
    """Return the motion from the coordinates of a run to those of the known things, and its probability; None without one.

    Parameters
    ----------
    known, run : things of the runs so far, and of another run
    """
    if not len(known) or not len(run):
        return None, 0.0
    known, run = (_rows(each, _chosen(each, MOST_ALIGNED)) for each in (known, run))
    found: dict[bytes, tuple[float, Motion]] = {}
    for motion in [HERE, *proposals(known, run)]:
        refined = motion if motion == HERE else _refine(known, run, motion)
        placed = placed_at(run, *refined.of(run.x, run.y))
        gain = gains(known, placed)
        pair = assign(gain.T - LEAST_GAIN)
        one = np.flatnonzero(pair >= 0)
        standing = int(np.count_nonzero(_distance(known, placed)[pair[one], one] < IN_PLACE_SDS * RUN_PLACE_SD))
        if standing < (min(2, len(known), len(run)) if refined == HERE else LEAST_IN_PLACE):
            continue
        total = float((gain[pair[one], one] - LEAST_GAIN).sum()) - (0.0 if refined == HERE else MOTION_PRIOR)
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


def proposals(known: Standing, run: Standing) -> list[Motion]:
    """Return the proposals under which most things fall into place."""
    ours, theirs = _chosen(known, MOST_THINGS), _chosen(run, MOST_THINGS)
    like = alike(known, run)[np.ix_(ours, theirs)]
    x0, y0, x1, y1 = known.x[ours], known.y[ours], run.x[theirs], run.y[theirs]
    a, b = (part.ravel() for part in np.nonzero(~np.eye(len(ours), dtype=bool)))
    i, j = np.triu_indices(len(theirs), 1)
    there, here = np.hypot(x0[b] - x0[a], y0[b] - y0[a]), np.hypot(x1[j] - x1[i], y1[j] - y1[i])
    first, second = like[a][:, i], like[b][:, j]
    fits = np.abs(there[:, None] - here) < PAIR_TOLERANCE
    fits &= (first > LEAST_ALIKE) & (second > LEAST_ALIKE) & (there[:, None] > SHORTEST_PAIR) & (here > SHORTEST_PAIR)
    p, q = np.nonzero(fits)
    weight = (first + second)[p, q] - ((there[p] - here[q]) / (2.0 * RUN_PLACE_SD)) ** 2
    order = np.lexsort((-there[p], -weight))[:MOST_PROPOSALS]
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
        gain = np.maximum(like + near(away, room) - LEAST_GAIN, 0.0)
        quality[at] = np.minimum(gain.max(axis=2).sum(axis=1), gain.max(axis=1).sum(axis=1))
    best: list[Motion] = []
    for k in np.argsort(-quality, kind="stable").tolist():
        motion = Motion(float(angle[k]), float(shift_x[k]), float(shift_y[k]))
        if not any(_same(motion, other, x1, y1) for other in best):
            best.append(motion)
        if len(best) == MOST_REFINED or quality[k] < LEAST_QUALITY * quality.max():
            break
    return best


def _same(one: Motion, other: Motion, x: Float64, y: Float64) -> bool:
    """Return whether two motions bring all things to the same places."""
    (x0, y0), (x1, y1) = one.of(x, y), other.of(x, y)
    return bool(np.hypot(x1 - x0, y1 - y0).max() < IN_PLACE_SDS * RUN_PLACE_SD)


def _chosen(things: Standing, most: int) -> Int64:
    """Return the indices of the largest things."""
    size = np.nan_to_num(things.length, nan=-1.0)
    return np.sort(np.argsort(-size, kind="stable")[:most]).astype(np.int64)


def _rows(things: Standing, index: Int64) -> Standing:
    return Standing(**{name: getattr(things, name)[index] for name in Standing.__dataclass_fields__})


def _refine(known: Standing, run: Standing, motion: Motion) -> Motion:
    """Return the motion that fits best the things that fall into place."""
    like = alike(known, run)
    for _ in range(MOTION_REFINEMENTS):
        placed = placed_at(run, *motion.of(run.x, run.y))
        away = _distance(known, placed)
        gain = np.where(away < IN_PLACE_SDS * RUN_PLACE_SD, like + near(away, area(known, placed)) - LEAST_GAIN, -np.inf)
        pair = assign(gain.T)
        one = np.flatnonzero(pair >= 0)
        if len(one) < 2:
            return motion
        moved = _fit(run.x[one], run.y[one], known.x[pair[one]], known.y[pair[one]])
        if moved == motion:
            break
        motion = moved
    return motion


def _fit(x: Float64, y: Float64, to_x: Float64, to_y: Float64) -> Motion:
    """Return the turn and shift from points to points, by least squares."""
    mean_x, mean_y, mean_u, mean_v = (float(each.mean()) for each in (x, y, to_x, to_y))
    dx, dy, du, dv = x - mean_x, y - mean_y, to_x - mean_u, to_y - mean_v
    angle = math.atan2(float((dx * dv - dy * du).sum()), float((dx * du + dy * dv).sum()))
    cos, sin = math.cos(angle), math.sin(angle)
    return Motion(angle, mean_u - cos * mean_x + sin * mean_y, mean_v - sin * mean_x - cos * mean_y)
