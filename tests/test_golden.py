"""`detect` finds in the samples what it found when somebody last looked (`make golden` accepts a change)."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.golden import CASES, FOLDER, differences, expected, golden_path, rows


@pytest.mark.parametrize(("sample", "profile"), CASES)
def test_the_tables_of_a_sample(sample: str, profile: str, tmp_path: Path) -> None:
    assert differences(rows(sample, profile, tmp_path), expected(sample, profile)) == []


def test_differences_are_seen() -> None:
    (row, *others) = expected("room.mcap", "robust")
    assert differences([row | {"noise": row["noise"] + 1e-5}, *others], [row, *others]) == []
    for other in ({"noise": row["noise"] + 3e-5}, {"objects": row["objects"] + 1}, {"more": 1}):
        (line,) = differences([row | other, *others], [row, *others])
        assert line.startswith("sweeps, sweep 0, object None: ")
    assert differences(others, [row, *others]) == [f"{len(others)} rows instead of {len(others) + 1}"]


def test_no_golden_table_is_left_over() -> None:
    assert {path.name for path in FOLDER.iterdir() if path.is_file()} == {golden_path(*case).name for case in CASES}
