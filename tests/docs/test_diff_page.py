"""docs/diff.md says what the code says."""

from __future__ import annotations

import re

from lidarcli.choices import CHANGE_STATUSES, CHANGE_WHYS
from tests.docs.constants import constants
from tests.places import ROOT

PAGE = (ROOT / "docs" / "diff.md").read_text(encoding="utf-8")
MODULES = tuple(
    f"matching.{name}" for name in ("differences", "pairs", "extents", "ground", "alignment", "runs")
)
NUMERICAL = {
    *("pairs.ROUNDS", "ground.FAR_CORNER", "alignment.SMALL", "runs.PROPOSALS_AT_ONCE"),
    *(f"differences.{name}" for name in ("THING", "STRUCTURE", "KNOWN", "MOVED", "NEW", "GONE", "UNCERTAIN")),
    *(
        f"differences.{name}"
        for name in ("HIDDEN", "OUT_OF_VIEW", "NO_FREE_SPACE", "SHORT", "AMBIGUOUS", "CERTAIN")
    ),
}
"""These number words, keep numbers finite and arrays small, and decide nothing."""


def test_every_constant_is_documented_with_its_value() -> None:
    rows = re.findall(r"^\| `(\w+\.\w+)` \| (-?[\d.]+) \|", PAGE, re.MULTILINE)
    assert {name: float(value) for name, value in rows} == {
        name: float(f"{value:.3g}") for name, value in constants(MODULES).items() if name not in NUMERICAL
    }


def test_every_status_and_reason_is_named() -> None:
    for word in (*CHANGE_STATUSES, *CHANGE_WHYS):
        assert f"\n| {word} | " in PAGE
