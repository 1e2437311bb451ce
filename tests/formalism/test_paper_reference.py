"""Profile `paper` against the slow loop of `reference.py`, beam by beam, on thousands of random sweeps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import lidarcli
from lidarcli.formalism import VERTEX_KINDS, VISIBILITIES, Detection, Parameters, detect, difference
from lidarcli.sweeps.types import SweepBatch
from tests.formalism.batches import batch_of
from tests.formalism.random_sweeps import random_sweep, small_sweeps
from tests.formalism.reference import EACH_BEARING_ONCE, FIRST_BEARING_TWICE, NO_TURN, Found, Sweep, paper

PAPER = Parameters.for_profile("paper")


def assert_close(found: object, expected: object) -> None:
    """Equal but for rounding."""
    np.testing.assert_allclose(np.asarray(found, float), np.asarray(expected, float), rtol=0, atol=1e-9)


def number(value: float | None) -> float:
    """None as the NaN of the arrays."""
    return np.nan if value is None else value


def compare(sweep: Sweep, expected: Found, found: Detection, row: int) -> None:
    """Every number the formulas define, of one sweep."""
    width = len(sweep.ranges)
    objects = expected.objects
    assert found.d_mean[row] == pytest.approx(expected.d_th, abs=1e-12)
    assert found.sweep_d_th[row] == found.d_mean[row]
    assert found.beam_s is not None
    assert found.beam_set is not None
    assert found.beam_object is not None
    s = [number(value) for value in expected.s]
    np.testing.assert_array_equal(found.beam_s[row, :width], s)
    assert np.isnan(found.beam_s[row, width:]).all()

    member = np.zeros(found.beam_object.shape[1], int)
    for k, expected_object in enumerate(objects):
        member[expected_object.members] = k + 1
    np.testing.assert_array_equal(found.beam_object[row], member)
    np.testing.assert_array_equal(found.beam_set[row], np.where(member > 0, 0, 2))
    in_objects = sum(len(one.members) for one in objects)
    assert found.objects[row] == len(objects)
    assert found.agents[row] == found.agent_beams[row] == 0
    assert found.object_beams[row] == in_objects
    assert found.noise_beams[row] == width - in_objects

    mine = np.flatnonzero(found.row == row)
    assert found.object[mine].tolist() == list(range(1, len(objects) + 1))
    for k, one in zip(mine.tolist(), objects, strict=True):
        assert (found.beam_i[k], found.beam_f[k]) == (one.beam_i, one.beam_f)
        assert found.beams[k] == len(one.members)
        assert VISIBILITIES[found.visibility[k]] == "full"
        assert found.d_th[k] == found.sweep_d_th[row]
        exact = [one.r_i, one.r_f, number(one.s_i), number(one.s_f), one.r_min]
        got = [getattr(found, name)[k] for name in ("r_i", "r_f", "s_i", "s_f", "r_min")]
        np.testing.assert_array_equal(got, exact)
        close = [one.theta_i, one.theta_f, one.theta_min, one.x, one.y, one.width]
        got = [getattr(found, name)[k] for name in ("theta_i", "theta_f", "theta_min", "x", "y", "width")]
        assert_close(got, close)

        vertices = slice(found.vertex_offsets[k], found.vertex_offsets[k + 1])
        assert [VERTEX_KINDS[kind] for kind in found.vertex_kind[vertices]] == [v[2] for v in one.vertices]
        assert_close(found.vertex_theta[vertices], [v[0] for v in one.vertices])
        np.testing.assert_array_equal(found.vertex_r[vertices], [v[1] for v in one.vertices])
        faces = slice(found.face_offsets[k], found.face_offsets[k + 1])
        assert_close(found.face_theta_i[faces], [face[0] for face in one.faces])
        assert_close(found.face_theta_f[faces], [face[1] for face in one.faces])


def hold(sweeps: list[Sweep]) -> int:
    """Compare a batch with the loop, sweep by sweep; how many objects there were."""
    batch = batch_of(sweeps)
    found = detect(batch, PAPER, per_beam=True)
    np.testing.assert_array_equal(difference(batch), found.beam_s)
    loops = [paper(sweep) for sweep in sweeps]
    for row, (sweep, loop) in enumerate(zip(sweeps, loops, strict=True)):
        compare(sweep, loop, found, row)
    by_name(batch, loops)
    return len(found)


def by_name(batch: SweepBatch, loops: list[Found]) -> None:
    """The functions that have the names of the definitions, without a word on parameters."""
    assert lidarcli.threshold(batch).tolist() == pytest.approx([loop.d_th for loop in loops], abs=1e-12)
    breaks, sets = lidarcli.discontinuities(batch), lidarcli.sets(batch)
    assert [np.flatnonzero(row).tolist() for row in breaks] == [sorted(loop.breaks) for loop in loops]
    for row, loop in enumerate(loops):
        held = {beam for one in loop.objects for beam in one.members}
        assert sets[row].tolist() == ["O" if beam in held else "S" for beam in range(len(loop.s))] + [""] * (
            batch.width - len(loop.s)
        )
    each = [one for loop in loops for one in loop.objects]
    assert lidarcli.objects(batch).theta_i.tolist() == pytest.approx([one.theta_i for one in each], abs=1e-9)
    for vertices, faces, one in zip(lidarcli.vertices(batch), lidarcli.faces(batch), each, strict=True):
        assert_close(vertices, [vertex[:2] for vertex in one.vertices])
        assert_close(faces.reshape(-1, 2), one.faces if one.faces else np.empty((0, 2)))


@pytest.mark.slow
@settings(max_examples=100)
@given(st.lists(small_sweeps(), min_size=1, max_size=4))
def test_small_sweeps_on_a_coarse_grid(sweeps: list[Sweep]) -> None:
    hold(sweeps)


@pytest.mark.slow
@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 20))
def test_random_surfaces(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    hold([random_sweep(rng) for _ in range(count)])


@pytest.mark.slow
@pytest.mark.parametrize("closing", [NO_TURN, EACH_BEARING_ONCE, FIRST_BEARING_TWICE])
def test_a_thousand_sweeps_of_each_closing(closing: str) -> None:
    rng = np.random.default_rng(20240403)
    objects = hold([random_sweep(rng, closing) for _ in range(1000)])
    # The comparison would mean little if hardly any sweep held an object.
    assert objects > 1000
