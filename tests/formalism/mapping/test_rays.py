"""Ends of beams and the cells on their way: against one beam at a time with sets of cells, compiled and not."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from lidarcli.formalism.mapping import grid, rays
from lidarcli.formalism.mapping.grid import SKIPPED, placed
from lidarcli.system import native
from tests.formalism.mapping.seen import cells_of, counted, ends_of, random_sweeps, told

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
