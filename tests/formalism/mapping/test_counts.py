"""Counts add up in any order and any cut, take no more memory than the ground that was seen, and make the grid."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

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
from lidarcli.sweeps import Float64
from tests.formalism.mapping.seen import (
    MOST,
    RESOLUTION,
    assert_same_map,
    beams_of,
    chosen,
    counted,
    cut,
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
    return Counts(0.5, MOST, 9, column, row, *values, np.zeros_like(values[0]))


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


@pytest.mark.parametrize("most", [1_000, 40_000, 200_000, 300_000, 400_000])
def test_whether_the_ground_is_too_large_does_not_depend_on_the_cut(most: int) -> None:
    # 364 x 25 cells, in two pieces that lie apart.
    pieces = beams_of([[7.0], [10.0]], poses_at((7.02, 0.02, 0.0), (6.02, 0.5, np.pi)), angle_min=0.0)
    fits = []
    for order, size in (([0, 1], 1), ([1, 0], 1), ([0, 1], 2)):
        counts = Counts(RESOLUTION, most)
        try:
            for part in cut(chosen(pieces, np.array(order)), size):
                counts.add(part)
        except TooLargeError:
            fits.append(False)
        else:
            fits.append(True)
    assert fits in ([False] * 3, [True] * 3)
    if most in (1_000, 400_000):
        assert fits[0] == (most == 400_000)


def test_a_point_on_the_edge_of_a_cell_is_in_the_same_one_whatever_came_before() -> None:
    # 0.7 - 0.5 is a little less than 0.2: 3.999999999999999 cells of 5 cm, but 260 with 256 more.
    edge = beams_of([[0.5]], poses_at((0.7, 0.02, np.pi)), angle_min=0.0)
    assert edge.end[0, 0, 0] == 0.7 - 0.5 < 0.2
    far = line_of(-3.02, 5.02)
    alone = told(counted(edge)), told(counted(far))
    for order in ((edge, far), (far, edge)):
        counts = Counts(RESOLUTION, MOST)
        for beams in order:
            counts.add(beams)
        hits, passes = told(counts)
        assert hits == alone[0][0] + alone[1][0]
        assert passes == alone[0][1] + alone[1][1]


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


@pytest.mark.parametrize(
    ("min_hits", "ratio", "occupied"),
    [(1, 0.0, 5), (2, 0.0, 4), (3, 0.0, 3), (4, 0.0, 1), (1, 0.25, 4), (1, 0.5, 3), (1, 0.74, 3), (1, 1.0, 0)],
)
def test_hits_and_ratio(min_hits: int, ratio: float, occupied: int) -> None:
    # Shares of hits: 1, 1, 3/4, 1/4 of 12, 1/2.
    counts = of_cells([[1, 3, 9, 3, 2]], [[0, 0, 3, 9, 2]], 0, 0)
    expected = [n >= min_hits and n / (n + m) > ratio for n, m in ((1, 0), (3, 0), (9, 3), (3, 9), (2, 2))]
    assert counts.occupancy(min_hits, ratio, "map").occupied == sum(expected) == occupied


@pytest.mark.parametrize("resolution", [0.05, 0.03, 0.1, 1 / 3])
def test_the_origin_is_a_whole_number_of_cells(resolution: float) -> None:
    for x, y in ((0.3, 0.15), (-7.7, 1234.5), (-0.001, -0.001)):
        counts = counted(line_of(x, y), resolution=resolution)
        grid = grid_of(counts)
        for value in (grid.x, grid.y):
            assert value / resolution == pytest.approx(round(value / resolution), abs=1e-6)
            assert value == round(value, 9)
        # The beam's own cells are where they belong.
        row, column = np.nonzero(grid.cells == OCCUPIED)
        assert grid.x + column[0] * resolution <= x + 1.0 + 1e-9 <= grid.x + (column[0] + 1) * resolution + 1e-8
        assert grid.y + row[0] * resolution <= y + 1e-9 <= grid.y + (row[0] + 1) * resolution + 1e-8
    assert counted(line_of(0.22, 0.22)).occupancy(1, 0.0, "map").x == 0.15


def test_nothing_seen_is_an_empty_map() -> None:
    for counts in (Counts(RESOLUTION, MOST), counted(beams_of([[np.nan]], poses_at((3.0, 4.0, 0.0))))):
        grid = grid_of(counts)
        # An image has to have some pixels: the margin.
        assert grid.cells.tolist() == [[UNKNOWN] * 2] * 2
        assert (grid.occupied, grid.free) == (0, 0)
        assert grid.frame_id == "odom"


def test_a_room_of_four_walls() -> None:
    # 3 by 2 m, seen from three places: its walls are occupied, its inside is free, the outside unknown.
    poses = poses_at((0.513, 0.487, 0.0), (2.411, 1.533, 1.0), (1.207, 0.911, 2.5))
    bearing = np.linspace(-np.pi, np.pi, 721)[:-1]
    ranges = np.array([_to_walls(x, y, yaw + bearing) for x, y, yaw in zip(poses.x, poses.y, poses.yaw, strict=True)])
    beams = beams_of(ranges, poses, angle_min=-np.pi, angle_increment=2 * np.pi / 720)
    grid = counted(beams).occupancy(1, 0.3, "map")
    row, column = np.indices(grid.cells.shape)
    x, y = grid.x + (column + 0.5) * RESOLUTION, grid.y + (row + 0.5) * RESOLUTION
    outside = np.maximum(np.maximum(-x, x - 3.0), np.maximum(-y, y - 2.0))
    assert (grid.cells[outside < -RESOLUTION] == FREE).all()
    assert (grid.cells[outside > RESOLUTION] == UNKNOWN).all()
    wall = grid.cells == OCCUPIED
    assert np.abs(outside[wall]).max() < RESOLUTION
    assert wall.sum() > 0.9 * 2 * (3.0 + 2.0) / RESOLUTION


def _to_walls(x: float, y: float, bearing: Float64) -> NDArray[np.float64]:
    """(B,) how far it is to the walls of the room of 3 x 2 m."""
    cos, sin = np.cos(bearing), np.sin(bearing)
    with np.errstate(divide="ignore"):
        along = np.where(cos > 0, 3.0 - x, x) / np.abs(cos)
        across = np.where(sin > 0, 2.0 - y, y) / np.abs(sin)
    return np.minimum(along, across)
