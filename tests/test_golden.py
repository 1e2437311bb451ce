"""`detect` finds in the samples what it found when somebody last looked (`make golden` accepts a change)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.nearly import nearly
from tools.golden import CASES, FOLDER, golden_path, rows


@pytest.mark.parametrize(("sample", "profile"), CASES)
def test_the_tables_of_a_sample(sample: str, profile: str, tmp_path: Path) -> None:
    expected = [json.loads(line) for line in golden_path(sample, profile).read_text("utf-8").splitlines()]
    found = rows(sample, profile, tmp_path)
    assert [row["table"] for row in found] == [row["table"] for row in expected]
    for row, want in zip(found, expected, strict=True):
        assert row == nearly(want), f"sweep {want['sweep']}, object {want.get('object')}"


def test_no_golden_table_is_left_over() -> None:
    assert {path.name for path in FOLDER.iterdir() if path.is_file()} == {
        golden_path(*case).name for case in CASES
    }
