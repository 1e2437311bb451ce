"""Profile `paper` on sweeps small enough to be worked out by hand; the arithmetic stands beside each."""

from __future__ import annotations

from math import inf, nan, pi

import numpy as np
import pytest

from lidarcli.formalism import VERTEX_KINDS, Detection, Parameters, detect
from tests.formalism.batches import batch_of, spans
from tests.formalism.reference import EACH_BEARING_ONCE, Sweep


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


def test_the_edge_nearest_to_the_scanner_is_a_local_minimum() -> None:
    # s = –, -3, -0.5, -0.5, 0.5, 0.5, 3;  d_th = (3 + 0.5 + 0.5 + 0.5 + 0.5 + 3) / 6 = 8/6.
    # Inside beams 1 … 5 s changes its sign at beam 3: f' = 0 there, an edge between two faces.
    found = paper(Sweep([6, 3, 2.5, 2, 2.5, 3, 6], angle_min=0.0, angle_increment=0.125))
    assert found.d_mean[0] == pytest.approx(8 / 6, abs=1e-15)
    assert spans(found) == [(1, 5)]
    assert vertices(found) == [(0.125, 3.0, "start"), (0.375, 2.0, "extremum"), (0.625, 3.0, "end")]
    assert found.face_theta_i.tolist() == [0.125, 0.375]
    assert found.face_theta_f.tolist() == [0.375, 0.625]
    assert (found.theta_min[0], found.r_min[0]) == (0.375, 2.0)


def test_an_object_across_the_seam_is_one_object() -> None:
    # s_0 = 1 - 1 = 0 (its predecessor is beam 5), then 2, 0, 0, -2, 0;  d_th = 4/6.
    # f breaks before beam 1 (something nearer has ended) and before beam 4 (something nearer begins).
    found = paper(Sweep([1, 3, 3, 3, 1, 1], -pi, pi / 3, EACH_BEARING_ONCE))
    assert found.d_mean[0] == pytest.approx(4 / 6, abs=1e-15)
    assert spans(found) == [(4, 0)]
    assert found.beams.tolist() == [3]
    # θ_i = -π + 4π/3; θ_f = -π + 2π: bearings grow past the seam.
    assert found.theta_i[0] == pytest.approx(pi / 3, abs=1e-12)
    assert found.theta_f[0] == pytest.approx(pi, abs=1e-12)
    assert found.beam_object is not None
    assert found.beam_object.tolist() == [[1, 0, 0, 0, 1, 1]]


def test_a_difference_equal_to_the_threshold_is_no_discontinuity() -> None:
    # |s| = 1 at every beam, so d_th = 1, and no |s| > d_th.
    found = paper(Sweep([2, 1, 2, 1], -pi, pi / 2, EACH_BEARING_ONCE))
    assert found.d_mean.tolist() == [1.0]
    assert len(found) == 0
    assert found.noise_beams.tolist() == [4]


def test_partly_hidden_runs_and_the_edges_of_the_view_are_not_objects() -> None:
    # s = –, 0, -2, 0, -1, 0, 3, 0;  d_th = 6/7.
    # Runs: 0–1 ends at the view; 2–3 is nearer than 0–1 but hidden by 4–5; 4–5 is nearest; 6–7 ends at the view.
    found = paper(Sweep([5, 5, 3, 3, 2, 2, 5, 5], 0.0, 0.125))
    assert found.d_mean[0] == pytest.approx(6 / 7, abs=1e-15)
    assert spans(found) == [(4, 5)]
    assert (found.s_i[0], found.s_f[0]) == (-1.0, 3.0)


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


def test_a_clockwise_log_is_walked_counter_clockwise() -> None:
    # Bearings 0.5, 0.25, 0, -0.25, -0.5. Counter-clockwise: 4, 4, 2.5, 2, 4, so s = –, 0, -1.5, -0.5, 2; d_th = 4/4.
    found = paper(Sweep([4, 2, 2.5, 4, 4], 0.5, -0.25))
    assert found.d_mean.tolist() == [1.0]
    # Beams in the order of the log, P_i at the smaller bearing.
    assert spans(found) == [(1, 2)]
    assert (found.theta_i[0], found.theta_f[0]) == (0.0, 0.25)
    assert (found.r_i[0], found.r_f[0]) == (2.5, 2.0)
    assert (found.s_i[0], found.s_f[0]) == (-1.5, 2.0)
    np.testing.assert_array_equal(found.beam_s, [[2, -0.5, -1.5, 0, nan]])


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


def test_a_jump_of_the_slope_never_reaches_the_only_threshold() -> None:
    # Inside an object every |s| ≤ d_th. Two differences of one sign then differ by d_th at most, so with the paper's
    # one threshold a jump of f' shows only where s changes its sign, and there it is an extremum already.
    # s = –, -4, 0, 0.875, 0.875, 0, 3.25;  d_th = 9/6: at beam 2 f' jumps from 0 to 0.875 unnoticed.
    found = paper(Sweep([6, 2, 2, 2.875, 3.75, 3.75, 7], 0.0, 0.125))
    assert [kind for _, _, kind in vertices(found)] == ["start", "extremum", "end"]
