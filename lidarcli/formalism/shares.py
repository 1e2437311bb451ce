"""How often a thing of each shape looks like each shape in one sweep: what a sweep says, and what a track adds up."""

from __future__ import annotations

import math
from collections.abc import Sequence

SEEN_AS = (
    (0.925, 0.02, 0.005, 0.05),
    (0.06, 0.855, 0.005, 0.08),
    (0.06, 0.14, 0.60, 0.20),
    (0.33, 0.13, 0.005, 0.535),
)
"""Of a thing that is prismatic, round, legged or irregular, the share of the sweeps that take it for prismatic, round,
legged or irregular (docs/accuracy.md, with more room for what is rare: one sweep is no proof). Those that take it for
nothing, as it is hit by few beams, tell nothing."""
ALIKE = (10.0, 10.0, 5.0, 4.0)
"""How alike the sweeps of one prismatic, round, legged or irregular thing are, in sweeps that such a thing is known for
beforehand: a box looks like any box, each plant is different."""


def shape_likelihood(seen: Sequence[float]) -> list[float]:
    """What many sweeps of a thing say of its shape: they are not independent of each other, and no vote.

    How often a thing is taken for each shape differs from thing to thing (Dirichlet), and its sweeps follow that.

    Parameters
    ----------
    seen : in how many sweeps it was taken for prismatic, round, legged and irregular; parts of one count, too

    Returns
    -------
    Log-likelihood of that for a thing that is prismatic, round, legged and irregular

    >>> [round(each, 2) for each in shape_likelihood([1, 0, 0, 5])]
    [-9.49, -11.31, -8.34, -3.95]
    """
    result = []
    for shares, weight in zip(SEEN_AS, ALIKE, strict=True):
        log = math.lgamma(weight) - math.lgamma(weight + sum(seen))
        for share, count in zip(shares, seen, strict=True):
            log += math.lgamma(weight * share + count) - math.lgamma(weight * share)
        result.append(log)
    return result
