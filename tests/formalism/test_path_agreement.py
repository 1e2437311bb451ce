"""The agreement of sweeps with one static world: of a square room, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.formalism.path_agreement import Agreement, agreement
from lidarcli.sweeps.types import Float64

SWEEPS, BEAMS = 60, 120
STEP = 2.0 * np.pi / BEAMS
PARTS = np.arange(SWEEPS) // 3
"""Of the room a sensor sees the same walls again and again."""
PATH = np.column_stack([np.sin(0.4 * np.arange(SWEEPS)), np.cos(0.3 * np.arange(SWEEPS)), 0.05 * np.arange(SWEEPS)])


def ranges() -> Float64:
    """Return the ranges in a room of 8 m by 8 m about the origin."""
    bearing = PATH[:, 2:] + STEP * np.arange(BEAMS)
    sides = [(axis, side) for axis in (0, 1) for side in (-4.0, 4.0)]
    with np.errstate(divide="ignore"):
        walls = [(side - PATH[:, [axis]]) / (np.sin if axis else np.cos)(bearing) for axis, side in sides]
    ahead = np.where(np.array(walls) > 0.0, walls, np.inf)
    return np.asarray(ahead.min(axis=0), np.float64)


def under(path: Float64, parts: Float64 = PARTS, sweeps: slice = slice(None)) -> Agreement:
    """Return the agreement under a path."""
    count = len(path[sweeps])
    still = np.zeros((count, 3))
    return agreement(ranges()[sweeps], np.zeros(count), np.full(count, STEP), path[sweeps], still, parts[sweeps])


def test_the_true_path_agrees_and_a_drifting_one_does_not() -> None:
    true = under(PATH)
    assert min(true.near, true.far, true.all) > 0.95
    assert (true.again > 0.9, true.placed) == (True, 1.0)
    drifting = PATH + np.outer(np.arange(SWEEPS), [0.02, 0.0, 0.0])
    found = under(drifting)
    assert found.far < 0.7
    assert found.near - found.far > 0.1


def test_the_order_of_the_sweeps_does_not_matter() -> None:
    """Stamps may jump back: the first part that is handed in is not the earliest, nor the last one the latest."""
    order = np.random.default_rng(3).permutation(SWEEPS)
    count = np.zeros(SWEEPS)
    mixed = agreement(ranges()[order], count, count + STEP, PATH[order], np.zeros((SWEEPS, 3)), PARTS[order])
    assert mixed == pytest.approx(under(PATH), abs=1e-12)


def test_too_little_tells_nothing() -> None:
    for sweeps in (slice(0), slice(1)):
        assert np.isnan(under(PATH, sweeps=sweeps)[:3]).all()
    unknown = np.where(np.arange(SWEEPS)[:, None] % 2, np.nan, PATH)
    assert under(unknown).placed == 0.5
    assert under(np.full_like(PATH, np.inf)).placed == 0.0
