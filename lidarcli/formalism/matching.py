"""The same standing things in several runs (§3, matching): by where they stand and by what they are.

Every pair of a thing that is known and one of the next run is weighed: how much likelier is what was measured of both if
they are one thing than if they are two? One that still stands where it was is told by its place, one that was moved by its
size, shape and label. The pairs with the greatest sum win.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from lidarcli.formalism.fits import LARGEST, SMALLEST
from lidarcli.formalism.pairing import assign
from lidarcli.sweeps import Bool, Float64, Int32, Int64, record

PLACE_SD = 0.1
"""[m] Where a standing thing is found, from one run to the other."""
SIZE_SD = 0.01
"""[m] What sizes of the same thing differ by beside their standard deviations."""
SIZES = LARGEST - SMALLEST
"""[m] Sizes of different things differ by as much: they may have any."""
STAYS = 0.9
"""How likely a thing stands where it stood."""
NEARER = 0.05
"""[1/m] Of several places that a thing may have been moved to, the nearest is a little likelier."""
SURE = 2.9
"""A pair has to be likelier than this by its logarithm: 18 to 1."""
SAME_SHAPE, OTHER_SHAPE = 0.7, -2.0
"""Log-likelihood ratio of two shapes that are known: the same, or another."""
SAME_LABEL, OTHER_LABEL = 2.0, -20.0
"""Of two labels."""
MOST_EXPONENT = 100.0
LEAST_AREA = 10.0
"""[m²] Things stand anywhere in a place at least so large."""


@record
class Standing:
    """N things that stand somewhere in one run, (N,) each; lengths in metres, NaN where they are not known."""

    x: Float64
    y: Float64
    length: Float64
    width: Float64
    length_sd: Float64
    width_sd: Float64
    shape: Int32
    """A code that is the same in all runs, -1 where it is not known."""
    label: Int32
    """The same of names, -1 for none."""

    def __len__(self) -> int:
        return len(self.x)


@dataclass(frozen=True, slots=True)
class Motion:
    """A turn, then a shift: from the coordinates of a run to those of the first one."""

    angle: float = 0.0
    x: float = 0.0
    y: float = 0.0

    def of(self, x: Float64, y: Float64) -> tuple[Float64, Float64]:
        """Where places are."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return self.x + cos * x - sin * y, self.y + sin * x + cos * y


HERE = Motion()
"""Coordinates that are those of the first run already."""


@record
class Matched:
    """What became of the N things of a run, (N,) each."""

    thing: Int64
    """Number of the thing, 1, 2, ... by first sight."""
    x: Float64
    """Where it stands, in the coordinates of the first run."""
    y: Float64
    moved: Float64
    """How far from where it was last [m]; NaN for what is new."""
    score: Float64
    """How likely it is that thing and no other, 0 to 1; NaN for what is new."""


class Things:
    """The things of the runs so far."""

    def __init__(self) -> None:
        nothing, none = np.empty(0), np.empty(0, np.int32)
        self.known = Standing(nothing, nothing, nothing, nothing, nothing, nothing, none, none)
        """Where each was last, and all that is known of it; without those of runs of which nobody knows where they lie."""
        self._numbers = np.empty(0, np.int64)
        """The number of each, from 1."""
        self._count = 0

    def take(self, run: Standing, motion: Motion | None, chance: float = 1.0) -> Matched:
        """Find the things of a run among those of earlier ones; what is not found is a new thing.

        Parameters
        ----------
        run : things of a run that was not taken yet
        motion : from its coordinates to those of the first run; None where nobody knows: then all are new
        chance : how likely that motion is the right one
        """
        x, y = (motion or HERE).of(run.x, run.y)
        placed = placed_at(run, x, y)
        count, known = len(run), len(self.known)
        pair = np.full(count, -1)
        score, moved = np.full(count, np.nan), np.full(count, np.nan)
        if motion is not None and known and count:
            gain = gains(self.known, placed)
            pair = assign(gain.T - SURE)
            found = np.flatnonzero(pair >= 0)
            score[found] = chance * _score(gain, pair[found], found)
            moved[found] = np.hypot(
                x[found] - self.known.x[pair[found]], y[found] - self.known.y[pair[found]]
            )
        new = pair < 0
        number = self._count + 1 + np.arange(np.count_nonzero(new))
        self._count += len(number)
        thing = np.empty(count, np.int64)
        thing[new], thing[~new] = number, self._numbers[pair[~new]]
        if motion is not None or not known:
            # Coordinates that nobody can compare are no place to look for things again.
            pair[new] = known + np.arange(len(number))
            self._numbers = np.concatenate([self._numbers, number])
            self._learn(placed, pair)
        return Matched(thing=thing, x=x, y=y, moved=moved, score=score)

    def _learn(self, run: Standing, pair: Int64) -> None:
        """Keep where things are now, and join what is known of their sizes."""
        old, count = self.known, max(len(self.known), int(pair.max(initial=-1)) + 1)
        grown = {}
        for name in ("x", "y", "length", "width", "length_sd", "width_sd", "shape", "label"):
            before, now = getattr(old, name), getattr(run, name)
            empty = np.nan if now.dtype.kind == "f" else -1
            grown[name] = np.full(count, empty, now.dtype)
            grown[name][: len(before)] = before
        for size in ("length", "width"):
            value, sd = _joined(
                grown[size][pair],
                grown[f"{size}_sd"][pair],
                getattr(run, size),
                getattr(run, f"{size}_sd"),
            )
            grown[size][pair], grown[f"{size}_sd"][pair] = value, sd
        for name in ("x", "y"):
            grown[name][pair] = getattr(run, name)
        for name in ("shape", "label"):
            now = getattr(run, name)
            grown[name][pair] = np.where(now < 0, grown[name][pair], now)
        self.known = Standing(**grown)


def gains(known: Standing, run: Standing) -> Float64:
    """(T, N) log-likelihood ratio of each pair being one thing and not two, be it in its place or moved."""
    return np.maximum(in_place(known, run), _moved(known, run))


def in_place(known: Standing, run: Standing) -> Float64:
    """(T, N) of each pair being one thing that still stands there."""
    return alike(known, run) + near(_distance(known, run), area(known, run))


def near(distance: Float64, room: float) -> Float64:
    """What a place tells: log-likelihood ratio of standing that far apart [m], in a room of so many square metres."""
    result: Float64 = (
        math.log(STAYS * max(room, LEAST_AREA) / (4.0 * math.pi * PLACE_SD**2))
        - 0.25 * (distance / PLACE_SD) ** 2
    )
    return result


def area(known: Standing, run: Standing) -> float:
    """Of the place in which the things stand [m²]."""
    sides = []
    for one, other in ((known.x, run.x), (known.y, run.y)):
        both = np.concatenate([one, other])
        sides.append(float(np.ptp(both)) + 1.0 if len(both) else 1.0)
    return max(sides[0] * sides[1], LEAST_AREA)


def alike(known: Standing, run: Standing) -> Float64:
    """(T, N) what size, shape and label tell: log-likelihood ratio of being one thing, 0 where nothing is known."""
    total = np.zeros((len(known), len(run)))
    for size in ("length", "width"):
        apart = getattr(known, size)[:, None] - getattr(run, size)
        sd = np.hypot(getattr(known, f"{size}_sd")[:, None], getattr(run, f"{size}_sd"))
        sd = np.hypot(np.nan_to_num(sd), SIZE_SD)
        ratio = math.log(SIZES / math.sqrt(2.0 * math.pi)) - np.log(sd) - 0.5 * (apart / sd) ** 2
        total += np.where(np.isfinite(apart), ratio, 0.0)
    total += _codes(known.shape, run.shape, SAME_SHAPE, OTHER_SHAPE)
    return total + _codes(known.label, run.label, SAME_LABEL, OTHER_LABEL)


def _codes(known: Int32, run: Int32, same: float, other: float) -> Float64:
    there = (known >= 0)[:, None] & (run >= 0)
    return np.where(there, np.where(known[:, None] == run, same, other), 0.0)


def _moved(known: Standing, run: Standing) -> Float64:
    """(T, N) of each pair being one thing that was moved, which only what has a size can show."""
    sized: Bool = np.isfinite(known.length + known.width)[:, None] & np.isfinite(run.length + run.width)
    ratio = alike(known, run) + math.log(1.0 - STAYS) - NEARER * _distance(known, run)
    return np.where(sized, ratio, -np.inf)


def _distance(known: Standing, run: Standing) -> Float64:
    result: Float64 = np.hypot(known.x[:, None] - run.x, known.y[:, None] - run.y)
    return result


def _score(gain: Float64, thing: Int64, one: Int64) -> Float64:
    """How likely pairs are beside all others that each of their two could make, and beside none."""
    chosen = gain[thing, one]
    rows = np.exp(np.minimum(gain[thing] - chosen[:, None], MOST_EXPONENT)).sum(axis=1)
    columns = np.exp(np.minimum(gain[:, one] - chosen, MOST_EXPONENT)).sum(axis=0)
    # Both sums hold the pair itself.
    result: Float64 = 1.0 / (rows + columns - 1.0 + np.exp(SURE - chosen))
    return result


def _joined(known: Float64, known_sd: Float64, now: Float64, now_sd: Float64) -> tuple[Float64, Float64]:
    """What was known of sizes and what is measured now, each as heavy as it is sure, and its sd; NaN is nothing."""
    seen, was = np.isfinite(now), np.isfinite(known)
    weight = np.where(seen, 1.0 / (np.nan_to_num(now_sd) ** 2 + SIZE_SD**2), 0.0)
    old = np.where(was, 1.0 / np.where(was, known_sd, 1.0) ** 2, 0.0)
    total = weight + old
    some = total > 0.0
    share = np.divide(weight, total, out=np.zeros(len(total)), where=some)
    mean = np.where(was, known, 0.0) * (1.0 - share) + np.where(seen, now, 0.0) * share
    spread = 1.0 / np.sqrt(np.where(some, total, 1.0))
    return np.where(some, mean, np.nan), np.where(some, spread, np.nan)


def placed_at(run: Standing, x: Float64, y: Float64) -> Standing:
    """The same things elsewhere."""
    return replace(run, x=x, y=y)
