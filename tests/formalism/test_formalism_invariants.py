"""What must hold for any sweep and both profiles: the partition of Def. 4, and what must not change a result."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lidarcli.formalism import PROFILES, SETS, Detection, detect
from lidarcli.sweeps.types import Closure, SweepBatch
from tests.formalism.batches import PER_BEAM, PER_FACE, PER_OBJECT, PER_SWEEP, PER_VERTEX, batch_of, joined, rows_of
from tests.formalism.random_sweeps import random_sweep
from tests.formalism.reference import Sweep
from tests.formalism.surroundings import PARAMETERS, awkward, simulated

seeds = st.integers(0, 2**32 - 1)
every_profile = pytest.mark.parametrize("profile", PROFILES)


def assert_partition(batch: SweepBatch, found: Detection) -> None:
    """Def. 4: every beam in exactly one set, nothing twice, nothing lost."""
    beams = batch.beams.astype(int)
    assert (found.object_beams >= 0).all()
    assert (found.noise_beams >= 0).all()
    np.testing.assert_array_equal(found.object_beams + found.agent_beams + found.noise_beams, beams)
    in_o, in_a = found.set == SETS.index("O"), found.set == SETS.index("A")
    rows = len(batch)
    np.testing.assert_array_equal(np.bincount(found.row[in_o], found.beams[in_o], minlength=rows), found.object_beams)
    np.testing.assert_array_equal(np.bincount(found.row[in_o], minlength=rows), found.objects)
    np.testing.assert_array_equal(np.bincount(found.row[in_a], minlength=rows), found.agents)

    assert found.beam_set is not None
    assert found.beam_object is not None
    there = np.arange(batch.width) < beams[:, None]
    for name, counts in (("O", found.object_beams), ("A", found.agent_beams), ("S", found.noise_beams)):
        members = (found.beam_set == SETS.index(name)) & there
        np.testing.assert_array_equal(members.sum(axis=1), counts)
    assert ((found.beam_object > 0) == (found.beam_set != SETS.index("S"))).all()
    # A beam names an object of its own sweep; only beams with a range belong to one.
    for row in range(rows):
        mine = (found.row == row) & ~(found.set == SETS.index("S"))
        numbers, sizes = np.unique(found.beam_object[row], return_counts=True)
        stated = dict(zip(found.object[mine].tolist(), found.beams[mine].tolist(), strict=True))
        assert dict(zip(numbers[numbers > 0].tolist(), sizes[numbers > 0].tolist(), strict=True)) == stated
    assert (batch.status[found.beam_object > 0] == 0).all()


@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize("make", [simulated, awkward])
def test_every_beam_is_in_exactly_one_set(name: str, make: Callable[[], SweepBatch]) -> None:
    batch = make()
    assert_partition(batch, detect(batch, PARAMETERS[name], per_beam=True))


@settings(max_examples=60)
@given(seeds, st.sampled_from(sorted(PARAMETERS)))
def test_every_beam_of_random_sweeps_is_in_exactly_one_set(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    batch = batch_of([random_sweep(rng) for _ in range(8)])
    assert_partition(batch, detect(batch, PARAMETERS[name], per_beam=True))


@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize("make", [simulated, awkward])
@pytest.mark.parametrize("size", [1, 7, 1024])
def test_the_batch_size_changes_no_bit(name: str, make: Callable[[], SweepBatch], size: int) -> None:
    batch = make()
    whole = detect(batch, PARAMETERS[name], per_beam=True)
    parts = [rows_of(batch, slice(at, at + size)) for at in range(0, len(batch), size)]
    together = joined([detect(part, PARAMETERS[name], per_beam=True) for part in parts], [len(part) for part in parts])
    for field, values in together.items():
        expected = getattr(whole, field)
        if field.endswith("offsets"):
            expected = np.diff(expected)
        np.testing.assert_array_equal(values, expected, err_msg=field)
        assert values.tobytes() == expected.tobytes() or np.issubdtype(values.dtype, np.floating), field


@every_profile
def test_padding_changes_nothing(profile: str) -> None:
    rng = np.random.default_rng(11)
    sweeps = [random_sweep(rng) for _ in range(100)]
    narrow, wide = (detect(batch_of(sweeps, width), PARAMETERS[profile], per_beam=True) for width in (None, 200))
    for field in (*PER_OBJECT, *PER_VERTEX, *PER_FACE, *PER_SWEEP):
        np.testing.assert_array_equal(getattr(narrow, field), getattr(wide, field), err_msg=field)
    width = max(len(sweep.ranges) for sweep in sweeps)
    for field in PER_BEAM:
        np.testing.assert_array_equal(getattr(narrow, field), getattr(wide, field)[:, :width], err_msg=field)
    assert wide.beam_set is not None
    assert (wide.beam_set[:, width:] == SETS.index("S")).all()


@every_profile
@pytest.mark.parametrize(
    "ranges",
    [[], [[]], [[], []], [[nan]], [[2.0]], [[inf] * 7], [[nan] * 3, [-inf] * 2, []]],
    ids=["no rows", "no beams", "two rows without beams", "one lost", "one", "no return", "nothing valid"],
)
def test_sweeps_that_hold_nothing(profile: str, ranges: list[list[float]]) -> None:
    sweeps = [Sweep(row, 0.0, 0.1) for row in ranges]
    batch = batch_of(sweeps)
    found = detect(batch, PARAMETERS[profile], per_beam=True)
    assert len(found) == 0
    assert found.vertex_offsets.tolist() == found.face_offsets.tolist() == [0]
    for name in (*PER_OBJECT, *PER_VERTEX, *PER_FACE, "row"):
        assert len(getattr(found, name)) == 0, name
    assert found.noise_beams.tolist() == [len(row) for row in ranges]
    some = [row == [2.0] for row in ranges]
    assert found.nearest.tolist() == pytest.approx([2.0 if one else nan for one in some], nan_ok=True)
    assert found.nearest_theta.tolist() == pytest.approx([0.0 if one else nan for one in some], nan_ok=True)
    assert found.d_mean.tolist() == [0.0] * len(ranges)
    assert found.objects.tolist() == found.object_beams.tolist() == [0] * len(ranges)
    for name in PER_BEAM:
        assert getattr(found, name).shape == batch.ranges.shape


@every_profile
@settings(max_examples=30, deadline=None)
@given(seed=seeds)
def test_the_nearest_beam_is_that_of_the_whole_sweep(profile: str, seed: int) -> None:
    """Walls included, at the bearing of the beam in the log; a mask of objects changes nothing."""
    batch = batch_of([random_sweep(np.random.default_rng(seed + k)) for k in range(4)])
    within = np.random.default_rng(seed).random(batch.ranges.shape) < 0.5
    for mask in (None, within & np.isfinite(batch.ranges)):
        found = detect(batch, PARAMETERS[profile], within=mask)
        for row in range(len(batch)):
            ranges = batch.ranges[row].astype(float)
            known = np.isfinite(ranges)
            if not known.any():
                assert np.isnan([found.nearest[row], found.nearest_theta[row]]).all()
                continue
            # A bearing that a sweep has twice counts once.
            turn_over = batch.closure[row] == Closure.SHARED.value
            ranges = ranges[: batch.beams[row] - turn_over]
            assert found.nearest[row] == np.nanmin(ranges)
            assert np.isclose(batch.bearings[row, : len(ranges)], found.nearest_theta[row])[
                ranges == found.nearest[row]
            ].any()


def test_objects_are_ordered_and_numbered_by_bearing() -> None:
    for parameters in PARAMETERS.values():
        found = detect(simulated(), parameters)
        assert (np.diff(found.row) >= 0).all()
        same = np.diff(found.row) == 0
        assert (np.diff(found.object)[same] == 1).all()
        assert (found.object[np.append(True, ~same)] == 1).all()
        numbered = same & (np.diff(found.set) == 0)
        assert (np.diff(found.theta_i)[numbered] > 0).all()
        assert (found.theta_f >= found.theta_i).all()
        inside = (found.theta_min >= found.theta_i) & (found.theta_min <= found.theta_f)
        assert inside.all()
