"""Things of interest (§3, matching): the entry of a catalogue that explains what was seen of a thing.

Only what was seen may contradict an entry: one face of 1.2 m or 0.8 m makes a pallet possible, two faces make it certain.
Every entry is compared with "none of them", a thing of any size between `SMALLEST_SIZE` and `LARGEST_SIZE`. A name is given
where one entry is probable beside the others and none, and also a good fit by chi-square.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lidarcli.formalism.detection import IRREGULAR, LEGGED, PRISMATIC, ROUND, SHAPES
from lidarcli.sweeps import Bool, Float64, Int32, record

KINDS = tuple(SHAPES[code] for code in (PRISMATIC, ROUND, LEGGED, IRREGULAR))
"""Shapes of things, in the order of `Evidence.shape`."""
LEAST_PROBABILITY = 0.95
"""A name is given from this probability on, ..."""
LEAST_FIT = 0.01
"""... if what was seen is no less likely than this where the name is right."""
ALL_LEGS_SEEN = 0.5
"""How often all legs of a legged thing are seen at once."""
MOST_UNKNOWN_LEGS = 8
"""An unknown thing of several parts has up to so many."""
INTENSITY_SHARE = 0.03
"""Share of the unknown things whose intensity is within the limits of an entry: these are set for what stands out."""
SMALLEST_SIZE, LARGEST_SIZE = 0.05, 2.0
"""[m] A thing that is not in the catalogue may have any size between these."""
LEAST_FIT_SD = 0.001
"""[m] No size is known better than this."""
LEAST_LARGER_SHARE = 0.05
"""Share of the unknown things that may be as large as anything that was seen."""
LEAST_DENSITY = 1e-300
"""Least density: its logarithm is finite."""


@dataclass(frozen=True, slots=True)
class Thing:
    """An entry of a catalogue. Its size is two sides, a diameter, or legs with the distances of their axes [m]."""

    name: str
    shape: str | None = None
    """One of `KINDS`; None where any will do."""
    length: float | None = None
    width: float | None = None
    diameter: float | None = None
    legs: int = 0
    spacing: tuple[float, ...] = ()
    """Of the axes of the legs: one for two legs, along and across for more."""
    tolerance: float = 0.02
    """Standard deviation of the sizes of such things [m]."""
    moves: bool = True
    """False for what never moves: what has moved is something else."""
    intensity_min: float | None = None
    """Its returns are no weaker than this, in the sensor's own unit ..."""
    intensity_max: float | None = None
    """... and no stronger than this."""

    def as_dict(self) -> dict[str, Any]:
        """Plain values, of what is given."""
        given = {name: value for name, value in asdict(self).items() if value not in (None, ())}
        if not self.legs:
            del given["legs"]
        return given | {"tolerance": self.tolerance, "moves": self.moves}


@dataclass(frozen=True, slots=True)
class Catalogue:
    """Things of interest."""

    things: tuple[Thing, ...]
    path: str = ""
    """Where it was read, if it was."""

    @property
    def names(self) -> tuple[str, ...]:
        """What the labels of `name` point into."""
        return tuple(thing.name for thing in self.things)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for the tables' metadata."""
        return {"things": [thing.as_dict() for thing in self.things]}


def names_in(catalogue: Catalogue | None) -> tuple[str, ...]:
    """What labels point into; without a catalogue there are no names."""
    return () if catalogue is None else catalogue.names


@record
class Evidence:
    """What was seen of M things: (M,) each, NaN where nothing was. Only what was seen may contradict.

    Standard deviations are those of the estimate: what more sweeps of the same beams do not mend is to be in them.
    """

    shape: Float64
    """(M, 4) log-likelihood of what was seen under each of `KINDS`; all equal where it tells nothing."""
    side_1: Float64
    """Side of the thing along its axis 1, where both its ends were seen [m]."""
    side_1_sd: Float64
    side_2: Float64
    """The same along axis 2, across it; 1 need not be the longer."""
    side_2_sd: Float64
    least_1: Float64
    """At least so long along axis 1, whatever was hidden [m]."""
    least_2: Float64
    least_sd: Float64
    """Of both."""
    across: Float64
    """Extent across the line of sight where both its ends were seen, a diameter where there is one [m]."""
    across_sd: Float64
    legs: Int32
    """Separate slim parts seen at most at once; 0 where it is not a thing of several parts."""
    span_1: Float64
    """Distances of the axes of its parts, along axis 1 and ... [m]"""
    span_2: Float64
    """... across it; NaN for a thing of two parts."""
    span_sd: Float64
    moved: Bool
    """Whether it ever moved."""
    intensity: Float64
    """Median intensity of its returns, in the sensor's own unit."""

    def __len__(self) -> int:
        return len(self.moved)


@record
class Comparison:
    """M things beside E entries of a catalogue, (M, E) each."""

    ratio: Float64
    """Log-likelihood of what was seen under the entry, less that under "none of them"; -inf where it is impossible."""
    fit: Float64
    """How likely it is to see no better a fit where the entry is right, 0 to 1."""
    certain: Bool
    """Whether all sizes that the entry has were seen: less makes it possible, not certain."""


def name(evidence: Evidence, catalogue: Catalogue) -> tuple[Int32, Float64]:
    """The entries that things are, and how probable that is.

    Parameters
    ----------
    evidence : what was seen of M things
    catalogue : entries, each as likely beforehand as none of them

    Returns
    -------
    (M,) index of the entry, -1 for none; (M,) its probability, NaN for none
    """
    compared = compare(evidence, catalogue)
    probability = _probability(compared.ratio)
    good = (probability >= LEAST_PROBABILITY) & (compared.fit >= LEAST_FIT) & compared.certain
    # Probabilities sum to one: no more than one entry can be good.
    found = good.any(axis=1)
    best = np.argmax(good, axis=1) if catalogue.things else np.zeros(len(evidence), np.intp)
    label = np.where(found, best, -1).astype(np.int32)
    score = np.full(len(evidence), np.nan)
    score[found] = probability[found, best[found]]
    return label, score


def possible(evidence: Evidence, catalogue: Catalogue) -> Bool:
    """Which entries nothing that was seen contradicts: (M, E)."""
    compared = compare(evidence, catalogue)
    contradicted: Bool = (compared.fit < LEAST_FIT) | np.isneginf(compared.ratio)
    return ~contradicted


def compare(evidence: Evidence, catalogue: Catalogue) -> Comparison:
    """Hold every thing against every entry."""
    count = len(evidence)
    # Of many sweeps nothing is likely: only what is likelier counts.
    shape = evidence.shape - evidence.shape.max(axis=1)[:, None]
    shape -= np.log(np.exp(shape).mean(axis=1))[:, None]
    columns = [_compare(evidence, thing, shape) for thing in catalogue.things]
    ratio, fit = np.zeros((count, len(columns))), np.zeros((count, len(columns)))
    certain = np.zeros((count, len(columns)), np.bool_)
    for i, column in enumerate(columns):
        ratio[:, i], fit[:, i], certain[:, i] = column
    return Comparison(ratio=ratio, fit=fit, certain=certain)


def _probability(ratio: Float64) -> Float64:
    """(M, E) of each entry, where an entry and "none of them" are equally likely beforehand."""
    top = np.maximum(ratio.max(axis=1, initial=0.0), 0.0)[:, None]
    weight = np.exp(ratio - top)
    result: Float64 = weight / (weight.sum(axis=1, keepdims=True) + np.exp(-top))
    return result


def _compare(evidence: Evidence, thing: Thing, shape: Float64) -> tuple[Float64, Float64, Bool]:
    """The columns of one entry; `shape` is less the mean over the shapes."""
    if thing.legs or thing.spacing:
        ratio, fit, certain = _by_legs(evidence, thing)
    elif thing.diameter is not None:
        ratio, fit, certain = _by_extent(evidence, thing.diameter, thing.diameter, thing.tolerance)
    elif thing.length is not None and thing.width is not None:
        # The sides of what has no straight ones are how far it reaches, seen from anywhere.
        by = _by_extent if thing.shape == "irregular" else _by_sides
        ratio, fit, certain = by(evidence, thing.length, thing.width, thing.tolerance)
    else:
        count = len(evidence)
        ratio, fit, certain = np.zeros(count), np.ones(count), np.ones(count, bool)
    if thing.shape is not None:
        mine = shape[:, KINDS.index(thing.shape)]
        ratio = ratio + mine
        fit = np.minimum(fit, np.exp(mine - shape.max(axis=1)))
    if not thing.moves:
        ratio = np.where(evidence.moved, -np.inf, ratio)
    if thing.intensity_min is not None or thing.intensity_max is not None:
        known, within = _within_limits(evidence, thing)
        ratio = np.where(within, ratio - np.log(INTENSITY_SHARE), np.where(known, -np.inf, ratio))
        certain = certain & known
    return ratio, fit, certain


def _within_limits(evidence: Evidence, thing: Thing) -> tuple[Bool, Bool]:
    """(M,) whether the intensity is known, and whether it is within the limits of an entry."""
    known = ~np.isnan(evidence.intensity)
    with np.errstate(invalid="ignore"):
        within = known.copy()
        if thing.intensity_min is not None:
            within &= evidence.intensity >= thing.intensity_min
        if thing.intensity_max is not None:
            within &= evidence.intensity <= thing.intensity_max
    return known, within


def _by_sides(
    evidence: Evidence, length: float, width: float, tolerance: float
) -> tuple[Float64, Float64, Bool]:
    """Two sides, either of which may be the longer."""
    seen_1, seen_2 = np.isfinite(evidence.side_1), np.isfinite(evidence.side_2)
    sd_1, sd_2, least_sd = (
        np.hypot(sd, tolerance) for sd in (evidence.side_1_sd, evidence.side_2_sd, evidence.least_sd)
    )
    ways = []
    for a, b in ((length, width), (width, length)):
        one = either(seen_1, measured(evidence.side_1, sd_1, a, a), at_least(evidence.least_1, least_sd, a))
        two = either(seen_2, measured(evidence.side_2, sd_2, b, b), at_least(evidence.least_2, least_sd, b))
        ways.append(one.plus(two))
    return *any_way(ways), seen_1 & seen_2


def _by_extent(
    evidence: Evidence, length: float, width: float, tolerance: float
) -> tuple[Float64, Float64, Bool]:
    """An extent across the line of sight, which is neither below the width nor above the length."""
    low, high = min(length, width), max(length, width)
    seen = np.isfinite(evidence.across)
    across = measured(evidence.across, np.hypot(evidence.across_sd, tolerance), low, high)
    least = np.fmax(evidence.least_1, evidence.least_2)
    longer = at_least(least, np.hypot(evidence.least_sd, tolerance), high)
    return *any_way([either(seen, across, longer)]), seen


def _by_legs(evidence: Evidence, thing: Thing) -> tuple[Float64, Float64, Bool]:
    """So many legs at most, at such distances."""
    count, seen = len(evidence), evidence.legs > 0
    ratio, fit, certain = np.zeros(count), np.ones(count), seen
    if thing.spacing:
        two, sd = len(thing.spacing) == 1, np.hypot(evidence.span_sd, thing.tolerance)
        a, b = thing.spacing[0], thing.spacing[-1]
        one, other = (measured(evidence.span_1, sd, side, side) for side in (a, b))
        if two:
            ratio, fit = any_way([one])
        else:
            along, across = (measured(evidence.span_2, sd, side, side) for side in (a, b))
            ratio, fit = any_way([one.plus(across), other.plus(along)])
        certain = seen & np.isfinite(evidence.span_1) & (two | np.isfinite(evidence.span_2))
    if thing.legs:
        hidden = (1.0 - ALL_LEGS_SEEN) / max(thing.legs - 1, 1)
        chance = np.log(np.where(evidence.legs == thing.legs, ALL_LEGS_SEEN, hidden) * MOST_UNKNOWN_LEGS)
        too_many = evidence.legs > thing.legs
        ratio = np.where(too_many, -np.inf, ratio + np.where(seen, chance, 0.0))
        fit = np.where(too_many, 0.0, fit)
    return ratio, fit, certain


@record
class Fit:
    """How sizes fit, (M,) each."""

    ratio: Float64
    """Log-likelihood less that under a thing of any size."""
    chi: Float64
    """Sum of squares of what was seen, in standard deviations, ..."""
    freedom: Float64
    """... and the number of them: 0, 1 or 2."""

    def plus(self, other: Fit) -> Fit:
        """Both sizes together."""
        return Fit(self.ratio + other.ratio, self.chi + other.chi, self.freedom + other.freedom)

    def likely(self) -> Float64:
        """How likely it is to see no better a fit where the size is right, 0 to 1."""
        one = 2.0 * below(-np.sqrt(self.chi))
        two = np.exp(-0.5 * self.chi)
        result: Float64 = np.where(self.freedom == 0, 1.0, np.where(self.freedom == 1, one, two))
        return result


def measured(value: Float64, sd: Float64, low: float, high: float) -> Fit:
    """Sizes that were measured, beside one that lies anywhere between `low` and `high`; NaN tells nothing.

    Parameters
    ----------
    value, sd : (M,) the size and its standard deviation, with the tolerance in it [m]
    low, high : [m]; the same for a size that is known
    """
    seen = np.isfinite(value)
    value, spread = np.where(seen, value, low), np.where(seen, np.hypot(sd, LEAST_FIT_SD), 1.0)
    off = np.maximum(np.maximum(low - value, value - high), 0.0) / spread
    if high - low > LEAST_FIT_SD:
        density = (below((value - low) / spread) - below((value - high) / spread)) / (high - low)
        log_density = np.log(np.maximum(density, LEAST_DENSITY))
    else:
        log_density = -0.5 * off**2 - np.log(spread * math.sqrt(2.0 * math.pi))
    ratio = log_density + math.log(LARGEST_SIZE - SMALLEST_SIZE)
    return Fit(np.where(seen, ratio, 0.0), np.where(seen, off**2, 0.0), seen.astype(np.float64))


def at_least(least: Float64, sd: Float64, size: float) -> Fit:
    """Things that are at least so long, beside a size: only a shorter one is contradicted; NaN tells nothing.

    Parameters
    ----------
    least, sd : (M,) the length and its standard deviation, with the tolerance in it [m]
    size : [m]
    """
    seen = np.isfinite(least)
    least, spread = np.where(seen, least, 0.0), np.where(seen, np.hypot(sd, LEAST_FIT_SD), 1.0)
    off = (least - size) / spread
    longer = np.clip((LARGEST_SIZE - least) / (LARGEST_SIZE - SMALLEST_SIZE), LEAST_LARGER_SHARE, 1.0)
    ratio = np.log(np.maximum(below(-off), LEAST_DENSITY)) - np.log(longer)
    exceeds = seen & (off > 0.0)
    return Fit(np.where(seen, ratio, 0.0), np.where(exceeds, off**2, 0.0), exceeds.astype(np.float64))


def either(known: Bool, one: Fit, other: Fit) -> Fit:
    """The one fit where something is known, elsewhere the other."""
    return Fit(
        np.where(known, one.ratio, other.ratio),
        np.where(known, one.chi, other.chi),
        np.where(known, one.freedom, other.freedom),
    )


def any_way(ways: Sequence[Fit]) -> tuple[Float64, Float64]:
    """Log-likelihood ratio where each way is as likely as the others, and the fit of the best: (M,) each."""
    ratio: Float64 = np.logaddexp.reduce([way.ratio for way in ways]) - math.log(len(ways))
    fit: Float64 = np.max([way.likely() for way in ways], axis=0)
    return ratio, fit


def below(z: Float64) -> Float64:
    """Share of a normal distribution below so many standard deviations: 1e-7 exact (numpy has no error function).

    Abramowitz and Stegun 1964, 26.2.17.

    >>> below(np.array([0.0, 1.0, -3.0])).round(6).tolist()
    [0.5, 0.841345, 0.00135]
    """
    t = 1.0 / (1.0 + 0.2316419 * np.abs(z))
    sum_ = t * (0.319381530 + t * (-0.356563782 + t * (1.781477937 + t * (-1.821255978 + t * 1.330274429))))
    tail = np.exp(-0.5 * np.square(z)) / math.sqrt(2.0 * math.pi) * sum_
    result: Float64 = np.where(z > 0, 1.0 - tail, tail)
    return result
