"""CONTRIBUTING.md names every file with tests that `make test` leaves out."""

from __future__ import annotations

import re

from tests.places import ROOT

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")


def test_what_make_test_leaves_out_is_listed() -> None:
    table = PAGE.split("| left out of `make test` |")[1].split("\n\n")[0]
    listed = {name for row in table.splitlines()[2:] for name in re.findall(r"`([^`]+)`", row.split("|")[1])}
    marked = {
        str(path.relative_to(ROOT))
        for path in (ROOT / "tests").rglob("test_*.py")
        if "pytest.mark.whole" in path.read_text(encoding="utf-8").replace('"pytest.mark.whole"', "")
    }
    folders = {name for name in listed if name.endswith("/")}
    assert {name for name in marked if not name.startswith(tuple(folders))} == listed - folders
    assert all(any(name.startswith(folder) for name in marked) for folder in folders)


def test_the_targets_that_are_named_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    pages = [PAGE, (ROOT / "README.md").read_text(encoding="utf-8")]
    named = {name for page in pages for name in re.findall(r"(?:^|`)make ([a-z][a-z-]*)", page, re.MULTILINE)}
    assert len(named) > 10
    assert named <= targets
