"""Arrays that do not fit each other are refused: the compiled loops would read memory that is not theirs."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism import definitions, detect, noise, sweep
from lidarcli.formalism.parameters import check
from lidarcli.sweeps.range_rules import RangeRules as Rules
from lidarcli.sweeps.range_rules import count_statuses, normalise
from lidarcli.sweeps.types import SweepBatch
from tests.sweeping import room_sweeps

BATCH = sweep(np.tile([4.0, 4.0, 4.0, 2.0, 2.0, 2.0, 4.0, 4.0], (3, 1)), angle_increment=0.01)
FEW = np.array([8, 2, 8], np.int32)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"closure": np.zeros(0, np.uint8)}, r"closure of shape \(0,\) in place of \(3,\)"),
        ({"beams": FEW[:1]}, r"beams of shape \(1,\) in place of \(3,\)"),
        ({"angle_min": np.zeros(1)}, r"angle_min of shape \(1,\)"),
        ({"status": BATCH.status[:, :5]}, r"status of shape \(3, 5\) in place of \(3, 8\)"),
        ({"ranges": BATCH.ranges[0]}, r"ranges of shape \(8,\)"),
        ({"beams": FEW + 1}, r"sweep 0 of /scan: 9 beams in 8 columns"),
        ({"beams": FEW - 3}, r"sweep 1 of /scan: -1 beams"),
        ({"beams": FEW, "closure": np.ones(3, np.uint8)}, r"sweep 1 of /scan: a full turn of 2 beams"),
        ({"ranges": np.where(BATCH.ranges == 2, 0, BATCH.ranges)}, r"sweep 0 of /scan: 0 m is no range"),
        ({"ranges": -BATCH.ranges}, r"-4 m is no range"),
        ({"ranges": np.full((3, 8), np.inf)}, r"inf m is no range"),
    ],
)
@pytest.mark.parametrize("function", [check, detect, noise, *(getattr(definitions, name) for name in definitions.__all__)])
def test_batches_that_do_not_fit_are_refused(
    changed: dict[str, Any], message: str, function: Callable[[SweepBatch], Any]
) -> None:
    with pytest.raises(ValueError, match=message):
        function(replace(BATCH, **changed))


def test_masks_and_noise_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match=r"within of shape \(1, 8\) in place of \(3, 8\)"):
        detect(BATCH, within=np.ones((1, 8), bool))
    with pytest.raises(ValueError, match=r"sigma of shape \(2,\) in place of \(3,\)"):
        detect(BATCH, sigma=np.zeros(2))


def test_raw_sweeps_that_do_not_fit_are_refused() -> None:
    raw = room_sweeps(count=4)
    for changed in ({"beams": raw.beams - 400}, {"beams": raw.beams + 1}, {"range_min": raw.range_min[:1]}):
        with pytest.raises(ValueError, match="do not fit 4 sweeps of up to 360 ranges"):
            normalise(replace(raw, **changed), np.arange(4), Rules())
    with pytest.raises(ValueError, match="7 is no status"):
        count_statuses(np.full((2, 3), 7, np.uint8))


def test_threads_do_not_meet() -> None:
    batch = normalise(room_sweeps(count=50), np.arange(50), Rules())
    expected = detect(batch)
    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(detect, [batch] * 40):
            np.testing.assert_array_equal(found.box_yaw, expected.box_yaw)
