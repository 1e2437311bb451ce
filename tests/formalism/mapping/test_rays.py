"""Ends of beams and the cells on their way: against one beam at a time with sets of cells, compiled and not."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from lidarcli import native
from lidarcli.formalism.mapping import grid, rays
from lidarcli.formalism.mapping.grid import SKIPPED, Counts, placed
from tests.formalism.mapping.seen import (
    MOST,
    RESOLUTION,
    beams_of,
    cells_of,
    counted,
    ends_of,
    poses_at,
    random_sweeps,
    told,
)

SEEDS = range(12)


@pytest.fixture(scope="module")
def source() -> ModuleType:
    """The source of the loops as plain Python, whatever was built from it."""
    path = Path(rays.__file__).parent / "rays.py"
    spec = importlib.util.spec_from_file_location("plain_rays", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("seed", SEEDS)
def test_beams_end_where_each_alone_ends(seed: int) -> None:
    batch, poses, use = random_sweeps(seed)
    beams = placed(batch, poses, use)
    expected = ends_of(batch, poses, use)
    np.testing.assert_allclose(beams.end, expected, rtol=0, atol=1e-12)
    assert (np.isnan(beams.end[0]) == ((use == SKIPPED) | np.isnan(batch.ranges))).all()


@pytest.mark.parametrize("seed", SEEDS)
def test_hits_and_passes_are_those_of_sets_of_cells(seed: int) -> None:
    batch, poses, use = random_sweeps(seed)
    counts = counted(placed(batch, poses, use))
    hits, passes = told(counts)
    expected_hits, expected_passes = cells_of(batch, poses, use)
    assert hits == expected_hits
    assert passes == expected_passes
    # A cell counts once in a sweep: as hit, or else as passed.
    assert sum(hits.values()) > 50 < sum(passes.values())
    assert int((counts.hits + counts.passes).max()) <= len(batch)


def test_a_row_of_cells_by_hand() -> None:
    # Along x through the middle of a row: from cell 2 to cell 6, ahead and back.
    ahead = beams_of([[0.2]], poses_at((0.125, 0.025, 0.0)), angle_min=0.0)
    hits, passes = told(counted(ahead))
    assert hits == {(6, 0): 1}
    assert passes == {(column, 0): 1 for column in (2, 3, 4, 5)}
    back = beams_of([[0.2]], poses_at((0.125, 0.025, np.pi)), angle_min=0.0)
    hits, passes = told(counted(back))
    assert hits == {(-2, 0): 1}
    assert passes == {(column, 0): 1 for column in (2, 1, 0, -1)}


def test_each_beam_starts_where_the_sensor_is_then() -> None:
    # It goes 1 m to the left while it looks ahead three times, and turns back by what the beams are apart.
    beams = beams_of([[1.0, 1.0, 1.0]], poses_at((0.0, 0.0, 0.0, 0.0, 1.0, -0.2)), angle_min=0.0, angle_increment=0.1)
    np.testing.assert_allclose(beams.end[:, 0], [[1.0, 1.0, 1.0], [0.0, 0.5, 1.0]], atol=1e-15)
    off_the_edges = np.array([0.01, 0.01, 0.0, 0.0])
    beams = replace(beams, end=beams.end + 0.01, poses=beams.poses + off_the_edges)
    hits, passes = told(counted(beams))
    assert hits == {(20, 0): 1, (20, 10): 1, (20, 20): 1}
    assert passes == {(column, row): 1 for column in range(20) for row in (0, 10, 20)}


def test_head_down_bearings_run_the_other_way() -> None:
    poses = poses_at((0.0, 0.0, 0.5))
    hung = replace(poses, upside_down=np.ones(1, bool))
    (x, y), (hung_x, hung_y) = (beams_of([[2.0]], each, angle_min=0.3).end[:, 0, 0] for each in (poses, hung))
    assert (x, y) == pytest.approx((2 * np.cos(0.8), 2 * np.sin(0.8)))
    assert (hung_x, hung_y) == pytest.approx((2 * np.cos(0.2), 2 * np.sin(0.2)))


@pytest.mark.skipif(rays.__file__.endswith(".py"), reason="the core was not compiled")
@pytest.mark.parametrize("seed", SEEDS)
def test_compiled_and_source_give_the_same_bits(source: ModuleType, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "_BOUNDS", True)
    batch, poses, use = random_sweeps(seed)
    one = counted(one_beams := placed(batch, poses, use), 5)
    monkeypatch.setattr(grid, "rays", source)
    other = counted(other_beams := placed(batch, poses, use), 5)
    assert one_beams.end.tobytes() == other_beams.end.tobytes()
    assert (one.column, one.row) == (other.column, other.row)
    for name in ("hits", "passes", "_stamps"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), strict=True)
    assert one.hits.sum() > 50


def test_no_index_is_out_of_bounds(source: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    # The source refuses negative indices and those beyond the end, which the compiled loops take for memory.
    monkeypatch.setattr(native, "_BOUNDS", True)
    monkeypatch.setattr(grid, "rays", source)
    for seed in SEEDS:
        batch, poses, use = random_sweeps(seed, sweeps=3)
        for resolution in (RESOLUTION, 0.7, 1000.0):
            tight = Counts(resolution, MOST)
            monkeypatch.setattr(grid, "BLOCK", 1)
            tight.add(placed(batch, poses, use))
            assert told(tight) == cells_of(batch, poses, use, resolution)
