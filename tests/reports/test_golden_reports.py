"""`report` says of a sample what it said when somebody last looked (`make golden` accepts a change)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tools.golden import alike
from tools.golden_reports import FOLDER, SUFFIXES, golden_path, reports


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    return reports(tmp_path_factory.mktemp("golden"))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_report_of_a_sample(found: dict[str, str], suffix: str) -> None:
    expected = golden_path(suffix).read_text("utf-8")
    if suffix == "json":
        assert alike(json.loads(found[suffix]), json.loads(expected)), found[suffix]
    else:
        assert found[suffix] == expected


def test_no_golden_report_is_left_over() -> None:
    assert {path.name for path in Path(FOLDER).iterdir()} == {golden_path(suffix).name for suffix in SUFFIXES}
