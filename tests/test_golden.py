"""`detect` finds in the samples what it found when somebody last looked (`make golden` accepts a change)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tools.golden import CASES, DECIMALS, FOLDER, golden_path, rows


@pytest.mark.parametrize(("sample", "profile"), CASES)
def test_the_tables_of_a_sample(sample: str, profile: str, tmp_path: Path) -> None:
    expected = [json.loads(line) for line in golden_path(sample, profile).read_text("utf-8").splitlines()]
    found = rows(sample, profile, tmp_path)
    assert [row["table"] for row in found] == [row["table"] for row in expected]
    for row, want in zip(found, expected, strict=True):
        assert row == nearly(want), f"sweep {want['sweep']}, object {want.get('object')}"


def nearly(value: Any) -> Any:
    """Floats that compare equal within the rounding of the golden tables; everything else as it is."""
    if isinstance(value, float):
        return pytest.approx(value, abs=2 * 10**-DECIMALS, rel=0)
    if isinstance(value, list):
        return [nearly(item) for item in value]
    if isinstance(value, dict):
        return {name: nearly(item) for name, item in value.items()}
    return value


def test_no_golden_table_is_left_over() -> None:
    assert {path.name for path in FOLDER.iterdir() if path.is_file()} == {
        golden_path(*case).name for case in CASES
    }
