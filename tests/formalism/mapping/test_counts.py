"""Counts add up in any order and any cut, take no more memory than the ground that was seen, and make the grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from lidarcli.formalism.mapping.grid import (
    BLOCK,
    CELL_BYTES,
    FREE,
    OCCUPIED,
    UNKNOWN,
    Beams,
    Counts,
    Occupancy,
    TooLargeError,
    placed,
)
from tests.formalism.mapping.seen import (
    MOST,
    RESOLUTION,
    assert_same_map,
    beams_of,
    chosen,
    counted,
    poses_at,
    random_sweeps,
    told,
)


def random_beams(seed: int, sweeps: int = 30) -> Beams:
    return placed(*random_sweeps(seed, sweeps))


def grid_of(counts: Counts) -> Occupancy:
    return counts.occupancy(1, 0.3, "odom")


def of_cells(hits: Sequence[Sequence[int]], passes: Sequence[Sequence[int]], column: int, row: int) -> Counts:
    """Counts as they are after sweeps that hit and pass these cells so often."""
    values = [np.array(each, np.int32) for each in (hits, passes)]
    return Counts(0.5, MOST, column, row, sweeps=9, hits=values[0], passes=values[1], _stamps=np.zeros_like(values[0]))


def line_of(x: float, y: float, reach: float = 1.0) -> Beams:
    """One beam straight ahead from there."""
    return beams_of([[reach]], poses_at((x, y, 0.0)), angle_min=0.0)


@pytest.mark.parametrize("size", [1, 7, 1000])
@pytest.mark.parametrize("seed", [0, 1])
def test_the_cut_into_batches_makes_no_difference(seed: int, size: int) -> None:
    beams = random_beams(seed)
    whole, parts = counted(beams), counted(beams, size)
    assert told(parts) == told(whole)
    assert parts.sweeps == whole.sweeps == 30
    assert_same_map(grid_of(parts), grid_of(whole))


@pytest.mark.parametrize("seed", range(4))
def test_the_order_makes_no_difference(seed: int) -> None:
    beams = random_beams(seed)
    order = np.random.default_rng(seed).permutation(len(beams))
    whole, other = counted(beams, 4), counted(chosen(beams, order), 3)
    assert told(other) == told(whole)
    assert_same_map(grid_of(other), grid_of(whole))


@pytest.mark.parametrize("seed", range(4))
def test_merging_is_counting_all(seed: int) -> None:
    beams = random_beams(seed)
    first, second = counted(chosen(beams, np.arange(11))), counted(chosen(beams, np.arange(11, 30)), 5)
    for one, other in ((first, second), (second, first)):
        merged = counted(chosen(beams, np.arange(0)))
        merged.merge(one)
        merged.merge(other)
        assert merged.sweeps == 30
        assert told(merged) == told(counted(beams))
        assert_same_map(grid_of(merged), grid_of(counted(beams)))
    # What was merged counts on: a sweep after it is a new one in every cell.
    first.merge(second)
    first.add(beams)
    twice = counted(beams)
    twice.add(beams)
    assert told(first) == told(twice)


def test_memory_is_that_of_the_ground_that_was_seen() -> None:
    # Far from the origin of the world it takes no more than beside it.
    for x, y in ((0.02, 0.02), (-5000.02, 7000.02), (9000.02, -80.02)):
        counts = counted(line_of(x, y))
        height, width = counts.hits.shape
        assert height % BLOCK == width % BLOCK == 0
        assert max(height, width) <= 2 * BLOCK
        stored = counts.hits.nbytes + counts.passes.nbytes + counts._stamps.nbytes
        assert stored == CELL_BYTES * height * width
    # What was seen again takes nothing.
    shape = counts.hits.shape
    for _ in range(20):
        counts.add(line_of(9000.02, -80.02))
    assert counts.hits.shape == shape


def test_no_more_ground_than_allowed() -> None:
    counts = Counts(RESOLUTION, 600 * 600)
    counts.add(line_of(0.02, 0.02))
    before = told(counts)
    for far in (line_of(50.02, 30.02), line_of(-9000.02, 5.02), beams_of([[5000.0]], poses_at((0.0, 0.0, 0.7)))):
        with pytest.raises(TooLargeError, match=r"^[\d,]+ x [\d,]+ m$"):
            counts.add(far)
        with pytest.raises(TooLargeError):
            counts.merge(counted(line_of(50.02, 30.02)))
        assert told(counts) == before
        assert counts.sweeps == 1
    # It goes on as if nothing had been.
    counts.add(line_of(0.02, 0.02))
    hits, passes = told(counts)
    assert (hits, passes) == tuple(each + each for each in before)


def test_what_is_occupied_free_and_unknown() -> None:
    counts = of_cells([[0, 1, 2, 3, 3, 3], [0, 0, 5, 0, 1, 0]], [[0, 0, 0, 3, 2, 1], [0, 1, 5, 0, 0, 9]], -4, 6)
    grid = counts.occupancy(2, 0.5, "odom")
    # Hit once is too seldom; by exactly half of those that saw it is not by more than half.
    expected = [[UNKNOWN, UNKNOWN, OCCUPIED, FREE, OCCUPIED, OCCUPIED], [UNKNOWN, FREE, FREE, UNKNOWN, UNKNOWN, FREE]]
    inner = grid.cells[1:-1, 1:-1]
    # The first column is not known at all: the map begins after it.
    assert inner.tolist() == [row[1:] for row in expected]
    assert (grid.x, grid.y) == ((-4 + 1 - 1) * 0.5, (6 - 1) * 0.5)
    assert (grid.resolution, grid.frame_id) == (0.5, "odom")
    assert (grid.occupied, grid.free) == (3, 4)
    assert grid.cells.dtype == np.int8
