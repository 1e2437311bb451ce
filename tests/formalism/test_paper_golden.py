"""Profile `paper` on sweeps small enough to be worked out by hand; the arithmetic stands beside each."""

from __future__ import annotations

import pytest

from lidarcli.formalism import Detection, Parameters, detect
from tests.formalism.batches import batch_of, spans
from tests.formalism.reference import Sweep


def paper(sweep: Sweep) -> Detection:
    """The literal profile on one sweep."""
    return detect(batch_of([sweep]), Parameters.for_profile("paper"), per_beam=True)


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
