"""docs/background.md says what the code says: constants, columns, options."""

from __future__ import annotations

import re

from lidarcli.tabular.schemas import BACKGROUND
from tests.docs.constants import constants
from tests.places import ROOT

PAGE = (ROOT / "docs" / "background.md").read_text(encoding="utf-8")
MODULES = ("background", "learning", "subtraction")


def test_every_constant_is_documented_with_its_value() -> None:
    rows = re.findall(r"^\| `(\w+\.\w+)` \| ([\d.]+) \|", PAGE, re.MULTILINE)
    assert {name: float(value) for name, value in rows} == constants(MODULES)


def test_the_columns_that_need_a_word_have_one() -> None:
    meaning = PAGE.partition("## What the figures mean")[2].partition("\n## ")[0]
    for column in ("r_e", "spread", "support", "no_return", "r_near"):
        assert f"`{column}`" in meaning
        assert column in BACKGROUND.names
