"""How well a size that was measured, or that a thing has at least, fits the one that it should have.

Everything is beside a thing of any size between `SMALLEST` and `LARGEST`: a log-likelihood of 0 tells nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from lidarcli.sweeps import Bool, Float64, record

SMALLEST, LARGEST = 0.05, 2.0
"""[m] A thing that is not in the catalogue may have any size between these."""
FLOOR = 0.001
"""[m] No size is known better than this."""
LEAST_SHARE = 0.05
"""Share of the unknown things that may be as large as anything that was seen."""
TINY = 1e-300
"""Least density: its logarithm is finite."""


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
    value, spread = np.where(seen, value, low), np.where(seen, np.hypot(sd, FLOOR), 1.0)
    off = np.maximum(np.maximum(low - value, value - high), 0.0) / spread
    if high - low > FLOOR:
        density = (below((value - low) / spread) - below((value - high) / spread)) / (high - low)
        log_density = np.log(np.maximum(density, TINY))
    else:
        log_density = -0.5 * off**2 - np.log(spread * math.sqrt(2.0 * math.pi))
    ratio = log_density + math.log(LARGEST - SMALLEST)
    return Fit(np.where(seen, ratio, 0.0), np.where(seen, off**2, 0.0), seen.astype(np.float64))


def at_least(least: Float64, sd: Float64, size: float) -> Fit:
    """Things that are at least so long, beside a size: only a shorter one is contradicted; NaN tells nothing.

    Parameters
    ----------
    least, sd : (M,) the length and its standard deviation, with the tolerance in it [m]
    size : [m]
    """
    seen = np.isfinite(least)
    least, spread = np.where(seen, least, 0.0), np.where(seen, np.hypot(sd, FLOOR), 1.0)
    off = (least - size) / spread
    longer = np.clip((LARGEST - least) / (LARGEST - SMALLEST), LEAST_SHARE, 1.0)
    ratio = np.log(np.maximum(below(-off), TINY)) - np.log(longer)
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
