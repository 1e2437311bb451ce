"""Objects from beams that are known to belong to them: their borders are borders of runs."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.formalism import Parameters, detect, sweep
from lidarcli.sweeps.types import TURN
from tests.formalism.batches import spans

WIDE = Parameters(max_width=np.inf)


def test_runs_end_with_the_mask_and_at_discontinuities_within() -> None:
    ranges = np.full(60, 4.0)
    ranges[20:25], ranges[25:30] = 3.9, 2.0
    batch = sweep(ranges, angle_min=-0.3, angle_increment=0.01)
    within = np.zeros((1, 60), bool)
    within[0, 18:30] = True
    found = detect(batch, WIDE, per_beam=True, within=within)
    assert spans(found) == [(18, 24), (25, 29)]
    assert found.s_i.tolist() == pytest.approx([0.0, -1.9], abs=1e-6)
    assert found.beam_object is not None
    assert found.beam_object[0].tolist() == [0] * 18 + [1] * 7 + [2] * 5 + [0] * 30


@pytest.mark.parametrize("ends", [0, 1])
def test_a_mask_across_the_seam_is_one_run(ends: int) -> None:
    ranges = np.full(360 + ends, 4.0)
    within = np.zeros((1, 360 + ends), bool)
    within[0, :5] = within[0, 350:] = True
    found = detect(sweep(ranges, angle_increment=TURN / 360), WIDE, within=within)
    assert spans(found) == [(350, 4)]


def test_a_lost_beam_inside_the_mask_is_bridged_and_one_outside_does_not_matter() -> None:
    ranges = np.full(60, 4.0)
    ranges[20:30] = 2.0
    ranges[[24, 30, 19]] = np.nan
    batch = sweep(ranges, angle_min=-0.3, angle_increment=0.01)
    assert spans(detect(batch, WIDE, within=batch.ranges < 3)) == [(20, 29)]


def test_the_paper_s_profile_takes_the_mask_for_its_edges() -> None:
    ranges = np.full(60, 4.0)
    ranges[20:30] = 2.0
    ranges[30:40] = 1.0
    batch = sweep(ranges, angle_min=-0.3, angle_increment=0.01)
    paper = Parameters.for_profile("paper")
    assert spans(detect(batch, paper)) == [(30, 39)]
    assert spans(detect(batch, paper, within=batch.ranges < 3)) == [(20, 29), (30, 39)]
