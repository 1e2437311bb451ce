"""The noise σ of the ranges of a sweep, from the median of its second differences.

On a straight surface 1/r is a sinusoid of the bearing, so u₋ + u₊ - 2 cos Δθ u vanishes for u = 1/r whatever the
incidence: what is left is noise. The median does not see the few triples that straddle an edge.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Scans
from lidarcli.system import native

NOISE_FLOOR = 0.003
"""[m] No scanner is better than this; keeps a noise-free simulation from splitting on rounding."""
MEDIAN_TO_SIGMA = 1.0 / 0.6744897501960817
"""The standard deviation of a normal distribution, as a multiple of the median of its absolute values."""
SECOND_DIFFERENCE_GAIN = math.sqrt(6.0)
"""Standard deviation of n₋ - 2 n + n₊ for independent n of standard deviation 1."""
TO_SIGMA = MEDIAN_TO_SIGMA / SECOND_DIFFERENCE_GAIN
FEW_VALUES = 24
"""Greatest number of values among which a rank is found by counting."""
SINGLE_ONE, SINGLE_NAN, SINGLE_INFINITY = 1.0, float("nan"), float("inf")
"""Infinity in single precision, as the ranges are."""
GUESS_LOW, GUESS_HIGH = 0.8, 1.25
"""The median of a sweep mostly lies between these multiples of that of the sweep before."""


class Noise:
    """Room for the second differences of a sweep, in single precision as the ranges are."""

    def __init__(self, most: int) -> None:
        """Make room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        most += 2
        self.u = native.singles(self.owner, most)
        self.around = native.singles(self.owner, most)
        self.second = native.singles(self.owner, most)
        self.some = native.singles(self.owner, most)
        self.guess = 0.0


def sigma_of(noise: Noise, scans: Scans, row: int) -> float:
    """σ of the sweep in a row of a batch [m], at least `NOISE_FLOOR`."""
    if scans.has_sigma:
        return scans.sigma[row]
    return max(middle_second_difference(noise, scans, row) * TO_SIGMA, NOISE_FLOOR)


def middle_second_difference(noise: Noise, scans: Scans, row: int) -> float:
    """The lower median of r² |u₋ + u₊ - 2 cos Δθ u| [m], 0 where no beam has a range and two neighbours that do."""
    width, begin, beams = scans.width, row * scans.width, scans.beams[row]
    if width < 3:
        return 0.0
    u, around, second, r = noise.u, noise.around, noise.second, scans.ranges
    # Storing rounds to single precision, so every step is stored.
    around[0] = 2.0 * math.cos(scans.angle_increment[row])
    cosine = around[0]
    one = SINGLE_ONE
    for k in range(width):
        u[k] = one / r[begin + k]
    around[0] = around[width - 1] = SINGLE_NAN
    for k in range(1, width - 1):
        around[k] = u[k - 1] + u[k + 1]
    if scans.closure[row] != segmentation.OPEN_TURN:
        last = beams - 1
        if scans.closure[row] == segmentation.SHARED_TURN:
            around[last] = SINGLE_NAN
            last -= 1
        around[0] = u[last] + u[1]
        around[last] = u[last - 1] + u[0]
    for k in range(width):
        u[k] = cosine * u[k]
        second[k] = around[k] - u[k]
        around[k] = r[begin + k] * r[begin + k]
        second[k] = abs(second[k] * around[k])
    noise.guess = lower_median(noise, width)
    return noise.guess


def lower_median(noise: Noise, count: int) -> float:
    """The lower median of the first `count` second differences that are numbers, 0 where there is none.

    A good guess saves most of the work: sweeps of one sensor are alike.
    """
    values, some = noise.second, noise.some
    low, high = noise.guess * GUESS_LOW, noise.guess * GUESS_HIGH
    numbers, below, within = 0, 0, 0
    for k in range(count):
        numbers += values[k] == values[k]
        below += values[k] < low
        within += values[k] <= high
    if numbers == 0:
        return 0.0
    rank = (numbers - 1) // 2
    if not (below <= rank and rank < within):
        low, high, below = 0.0, SINGLE_INFINITY, 0
    elif within - below > FEW_VALUES:
        # Where among these it is likely to be: as far as its rank, give or take two standard deviations.
        some_low = low + (high - low) * (rank - below + 0.5) / (within - below)
        margin = (high - low) / math.sqrt(within - below)
        some_low, some_high = some_low - margin, some_low + margin
        below_some, within_some = 0, 0
        for k in range(count):
            below_some += values[k] < some_low
            within_some += values[k] <= some_high
        if below_some <= rank and rank < within_some:
            low, high, below = some_low, some_high, below_some
    kept, k = 0, 0
    while k < count:
        last = min(k + 24, count)
        if last < k + 24 or _any_between(values, k, low, high):
            for i in range(k, last):
                some[kept] = values[i]
                kept += (values[i] >= low) & (values[i] <= high)
        k = last
    return smallest(noise, kept, rank - below)


def _any_between(values: Any, at: int, low: float, high: float) -> bool:
    """Return whether any of 24 values from a place on lies between two bounds."""
    some = 0
    for k in range(24):
        some |= (values[at + k] >= low) & (values[at + k] <= high)
    return some != 0


def smallest(noise: Noise, count: int, rank: int) -> float:
    """The value that has this rank among the first `count` that are kept; leaves them in another order."""
    some = noise.some
    low, high = 0, count - 1
    while high - low >= FEW_VALUES:
        a, b, c = some[low], some[(low + high) // 2], some[high]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while some[i] < pivot:
                i += 1
            while some[j] > pivot:
                j -= 1
            if i <= j:
                some[i], some[j] = some[j], some[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            return some[rank]
    # Without a branch per value this is faster than putting them in order.
    for i in range(low, high + 1):
        below, within = low, low
        for j in range(low, high + 1):
            below += some[j] < some[i]
            within += some[j] <= some[i]
        if below <= rank and rank < within:
            return some[i]
    return some[low]
