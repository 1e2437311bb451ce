"""Things of several parts: legs that stand close together are one object, also across the seam."""

from __future__ import annotations

from math import hypot

import numpy as np
import pytest

from lidarcli.formalism import SHAPES, VISIBILITIES, Detection, Parameters, detect
from lidarcli.formalism.parameters import Profile
from lidarcli.options.choices import PROFILES
from tests.formalism.batches import batch_of
from tests.formalism.reference import EACH_BEARING_ONCE, Sweep

STEP = 2 * np.pi / 720
LEGS = ((352, 356), (359, 363), (366, 370))
"""First and last beam of three legs 2 m away, with two beams between each two: too few to be anything."""


def room_with_legs(turned: int, legs: tuple[tuple[int, int], ...] = LEGS) -> Sweep:
    """A round room of 4 m with legs of 2 m, turned by so many beams."""
    ranges = np.full(720, 4.0)
    for first, last in legs:
        ranges[first : last + 1] = 2.0
    return Sweep(np.roll(ranges, turned).tolist(), -np.pi, STEP, EACH_BEARING_ONCE)


def found(sweep: Sweep, gap: float, profile: Profile = "robust") -> Detection:
    return detect(batch_of([sweep]), Parameters.for_profile(profile, group_gap=gap), per_beam=True)


GAP = 2 * hypot(np.cos(3 * STEP) - 1, np.sin(3 * STEP))
"""Distance between the nearest points of two legs [m]."""


@pytest.mark.parametrize("profile", PROFILES)
def test_legs_closer_than_the_gap_are_one_thing(profile: Profile) -> None:
    apart = found(room_with_legs(0), 0.99 * GAP, profile)
    assert apart.beam_i.tolist() == [352, 359, 366]
    together = found(room_with_legs(0), 1.01 * GAP, profile)
    assert (together.beam_i.tolist(), together.beam_f.tolist()) == ([352], [370])
    assert together.beams.tolist() == [15]
    assert together.object_beams.tolist() == [15]
    assert [SHAPES[code] for code in together.shape] == ["legged"]
    assert [VISIBILITIES[code] for code in together.visibility] == ["full"]
    assert together.s_i[0] == pytest.approx(-2.0)
    assert together.s_f[0] == pytest.approx(2.0)
    assert together.width[0] == pytest.approx(4 * np.sin(18 * STEP / 2))
    assert together.beam_object is not None
    assert np.flatnonzero(together.beam_object[0]).tolist() == [
        beam for first, last in LEGS for beam in range(first, last + 1)
    ]
    # Each leg keeps its own vertices and faces.
    assert np.diff(together.vertex_offsets).tolist() == [np.diff(apart.vertex_offsets).sum()]
    assert np.diff(together.face_offsets).tolist() == [np.diff(apart.face_offsets).sum()]


@pytest.mark.parametrize("turned", [340, 346, 352, 356, 362, 366])
def test_a_thing_of_parts_may_stand_across_the_seam(turned: int) -> None:
    one, other = found(room_with_legs(0), 1.01 * GAP), found(room_with_legs(turned), 1.01 * GAP)
    assert len(other) == 1
    assert (other.beam_i[0] - turned) % 720 == 352
    assert (other.beam_f[0] - turned) % 720 == 370
    assert other.theta_f - other.theta_i == pytest.approx(one.theta_f - one.theta_i)
    assert np.all(np.diff(other.vertex_theta) > 0)
    assert other.theta_i[0] <= other.theta_min[0] <= other.theta_f[0]
