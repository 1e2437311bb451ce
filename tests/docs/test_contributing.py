"""CONTRIBUTING.md and docs/architecture.md name files, rooms and targets that are there, and leave none out."""

from __future__ import annotations

import re

from tests.places import ROOT

PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
ARCHITECTURE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PACKAGE = ROOT / "lidarcli"


def test_the_targets_that_are_named_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    pages = [PAGE, (ROOT / "README.md").read_text(encoding="utf-8")]
    named = {name for page in pages for name in re.findall(r"(?:^|`)make ([a-z][a-z-]*)", page, re.MULTILINE)}
    assert len(named) > 10
    assert named <= targets


def test_the_map_of_rooms_is_true() -> None:
    table = ARCHITECTURE.split("| room | holds |")[1].split("\n\n")[0]
    named = {name for row in table.splitlines()[2:] for name in re.findall(r"`([^`]+)`", row.split("|")[1])}
    for name in named:
        assert (PACKAGE / (name if name.endswith("/") else f"{name}.py")).exists(), name
    there = {f"{path.name}/" for path in PACKAGE.iterdir() if (path / "__init__.py").exists()}
    there |= {path.stem for path in PACKAGE.glob("*.py") if not path.stem.startswith("__")}
    assert there <= named


def test_the_files_that_are_named_are_there() -> None:
    for page in (PAGE, ARCHITECTURE):
        named = {name for name in re.findall(r"`((?:\w+/)*\w+\.py|(?:\w+/)+)(?:::\w+)?`", page) if "/" in name}
        assert len(named) > 10
        for name in named:
            homes = (ROOT, PACKAGE, PACKAGE / "formalism")
            assert any((home / name).exists() for home in homes), name


def test_a_change_takes_at_most_two_files() -> None:
    table = ARCHITECTURE.split("| to change or add |")[1].split("\n\n")[0]
    rows = [row.split("|") for row in table.splitlines()[2:]]
    assert len(rows) >= 10
    for row in rows:
        assert 1 <= len(re.findall(r"`[\w/]+(?:\.py|/)`", row[2])) <= 2, row[1]
        assert row[3].strip()
