"""docs/diff.md says what the code says, and shows the picture that its commands make.

`python -m tests.docs.test_diff_page` writes it anew.
"""

from __future__ import annotations

import re
import tempfile
from pathlib import Path

import numpy as np
import pytest

from lidarcli.choices import CHANGE_STATUSES, CHANGE_WHYS
from tests.docs.constants import constants
from tests.docs.running import run_page
from tests.docs.test_paper_page import LIKENESS, pixels, reduced
from tests.places import ROOT

PAGE = (ROOT / "docs" / "diff.md").read_text(encoding="utf-8")
PICTURE = ROOT / "docs" / "images" / "diff.png"
MODULES = tuple(f"matching.{name}" for name in ("differences", "ground", "alignment"))
NUMERICAL = {
    *("differences.ROUNDS", "ground.FAR_CORNER", "alignment.SMALL", "alignment.PROPOSALS_AT_ONCE", "ground.AT_ONCE"),
    *(f"differences.{name}" for name in ("THING", "STRUCTURE", "KNOWN", "MOVED", "NEW", "GONE", "UNCERTAIN")),
    *(f"differences.{name}" for name in ("HIDDEN", "OUT_OF_VIEW", "NO_FREE_SPACE", "SHORT", "AMBIGUOUS", "CERTAIN")),
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


@pytest.mark.whole
def test_the_commands_make_the_picture(tmp_path: Path) -> None:
    run_page("docs/diff.md", tmp_path)
    today, shown = pixels(reduced(tmp_path / "changes.png")), pixels(PICTURE.read_bytes())
    assert today.shape == shown.shape, "run `python -m tests.docs.test_diff_page`"
    assert np.abs(today - shown).mean() < LIKENESS, "run `python -m tests.docs.test_diff_page`"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        run_page("docs/diff.md", Path(name))
        PICTURE.write_bytes(reduced(Path(name) / "changes.png"))
