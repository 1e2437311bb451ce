"""Profile `paper` on sweeps small enough to be worked out by hand; the arithmetic stands beside each."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest

from lidarcli.formalism import VERTEX_KINDS, Detection, Parameters, detect
from tests.formalism.batches import batch_of, spans
from tests.formalism.reference import Sweep


def paper(sweep: Sweep) -> Detection:
    """The literal profile on one sweep."""
    return detect(batch_of([sweep]), Parameters.for_profile("paper"), per_beam=True)


def vertices(found: Detection) -> list[tuple[float, float, str]]:
    """(θ, r, kind) of every vertex."""
    kinds = [VERTEX_KINDS[kind] for kind in found.vertex_kind]
    return list(zip(found.vertex_theta.tolist(), found.vertex_r.tolist(), kinds, strict=True))


def test_a_box_before_a_wall() -> None:
    # s = –, 0, -2, 0, 2;  d_th = (0 + 2 + 0 + 2) / 4 = 1: f breaks before beams 2 and 4.
    found = paper(Sweep([4, 4, 2, 2, 4], angle_min=-0.5, angle_increment=0.25))
    assert found.d_mean.tolist() == [1.0]
    assert found.sweep_d_th.tolist() == [1.0]
    assert spans(found) == [(2, 3)]
    assert (found.theta_i[0], found.theta_f[0]) == (0.0, 0.25)
    assert (found.s_i[0], found.s_f[0]) == (-2.0, 2.0)
    assert (found.r_i[0], found.r_f[0], found.r_min[0]) == (2.0, 2.0, 2.0)
    # Chord of two points 2 m away, 0.25 rad apart: 2 · 2 · sin(0.125).
    assert found.width[0] == pytest.approx(4 * np.sin(0.125), abs=1e-12)
    assert vertices(found) == [(0.0, 2.0, "start"), (0.25, 2.0, "end")]
    assert (found.face_theta_i.tolist(), found.face_theta_f.tolist()) == ([0.0], [0.25])
    assert found.face_length[0] == pytest.approx(4 * np.sin(0.125), abs=1e-12)
    assert (found.object_beams[0], found.agent_beams[0], found.noise_beams[0]) == (2, 0, 3)
    np.testing.assert_array_equal(found.beam_s, [[nan, 0, -2, 0, 2]])


def test_beams_without_a_range_end_a_surface_and_stay_out_of_the_mean() -> None:
    # Differences exist at beams 2 (0.5) and 5 (0.25) alone: d_th = 0.375, so f also breaks before beam 2.
    # Beam 1: no return on its left, further beam on its right: object. Beam 2: hidden by beam 1.
    # Beams 4–5: an invalid beam on the left proves nothing: no object, though the right is open.
    found = paper(Sweep([inf, 2, 2.5, nan, 3, 3.25, inf], 0.0, 0.125))
    assert found.d_mean.tolist() == [0.375]
    assert spans(found) == [(1, 1)]
    # Entering from beyond range there is no difference; it leaves to 2.5 m.
    assert np.isnan(found.s_i[0])
    assert found.s_f[0] == 0.5
    # One beam: P_i and P_f coincide, one vertex, no face.
    assert vertices(found) == [(0.125, 2.0, "start")]
    assert (found.theta_i[0], found.theta_f[0], found.width[0]) == (0.125, 0.125, 0.0)
    assert found.face_offsets.tolist() == [0, 0]
    np.testing.assert_array_equal(found.beam_s, [[nan, nan, 0.5, nan, nan, 0.25, nan]])


@pytest.mark.parametrize(
    ("overrides", "expected"),
    [
        # s = –, 0, -2, 2, 0, -2, 0, 2: d_th = 8/7, objects 2 and 5–6.
        ({}, [(2, 2), (5, 6)]),
        ({"min_beams": 2}, [(5, 6)]),
        # The chord of beams 5 and 6 is 4 sin(0.0625) = 0.2498 m.
        ({"max_width": 0.24}, [(2, 2)]),
        ({"threshold": 1.9}, [(2, 2), (5, 6)]),
        ({"threshold": 2.0}, []),
    ],
)
def test_overrides_of_the_literal_profile(overrides: dict[str, float], expected: list[tuple[int, int]]) -> None:
    sweep = Sweep([4, 4, 2, 4, 4, 2, 2, 4], 0.0, 0.125)
    found = detect(batch_of([sweep]), Parameters.for_profile("paper", **overrides))
    assert spans(found) == expected
    assert found.d_mean[0] == pytest.approx(8 / 7, abs=1e-15)
    assert found.sweep_d_th[0] == overrides.get("threshold", found.d_mean[0])
