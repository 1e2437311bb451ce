"""docs/track.md names the columns, ends and look-ahead that there are."""

from __future__ import annotations

import re

from lidarcli.formalism.tracking.results import ENDS
from lidarcli.tabular import SCHEMAS
from tests.pipeline.test_following import CHANGED
from tests.places import ROOT

PAGE = (ROOT / "docs" / "track.md").read_text(encoding="utf-8")


def test_the_columns_that_tracking_changes_are_named() -> None:
    rows = re.findall(r"^\| (\w+)[^|]* \| (`.*`) \|$", PAGE, re.MULTILINE)
    named = {table: set(re.findall(r"`(\w+)`", columns)) for table, columns in rows}
    assert named == CHANGED
    assert all(columns <= {*SCHEMAS[table].names} for table, columns in named.items())


def test_every_end_is_explained() -> None:
    assert [end for end in ENDS if f"(`{end}`)" not in PAGE] == []
