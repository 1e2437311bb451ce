"""Pairs with the greatest sum, beside every way to pair."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from lidarcli.formalism.matching.assignment import assign


def greatest(gain: np.ndarray) -> float:
    """The greatest sum of all ways to pair, found by trying them."""
    rows, columns = gain.shape
    ways = set(permutations([*range(columns), *[-1] * rows], rows))
    return max(sum(gain[row, at] for row, at in enumerate(way) if at >= 0) for way in ways)


@pytest.mark.parametrize("seed", range(8))
def test_no_way_to_pair_gains_more(seed: int) -> None:
    rng = np.random.Generator(np.random.PCG64(seed))
    for _ in range(20):
        gain = rng.normal(size=rng.integers(1, 5, 2))
        gain[rng.random(gain.shape) < 0.2] = -np.inf
        found = assign(gain)
        paired = found[found >= 0]
        assert len(set(paired.tolist())) == len(paired)
        chosen = gain[np.flatnonzero(found >= 0), paired]
        assert (chosen > 0).all()
        assert chosen.sum() == pytest.approx(greatest(gain), abs=1e-12)


def test_the_greedy_pair_gives_way() -> None:
    assert assign(np.array([[10.0, 9.0], [9.0, 1.0]])).tolist() == [1, 0]
