"""docs/formalism.md says what the code says: functions, defaults and constants."""

from __future__ import annotations

import ast
import importlib
import re
from dataclasses import fields
from pathlib import Path
from types import ModuleType

from lidarcli import formalism
from lidarcli.formalism import Detection, Parameters
from lidarcli.sweeps import SweepBatch
from tests.places import ROOT

PAGE = (ROOT / "docs" / "formalism.md").read_text(encoding="utf-8")
DERIVED = {
    "threshold.MEDIAN_TO_SIGMA",
    "threshold.SECOND_DIFFERENCE_GAIN",
    "objects.STRAIGHT",
    "objects.CONVEX",
    "objects.CONCAVE",
}
"""Factors of the normal distribution: the page names the distribution."""
CODES = ("detection", "points", "runs")
"""Modules whose numbers are codes or the layout of arrays, not constants of the method."""


def section(title: str) -> str:
    """The text under a heading, up to the next one."""
    match = re.search(rf"^#+ {re.escape(title)}\n(.*?)(?=^#|\Z)", PAGE, re.MULTILINE | re.DOTALL)
    assert match is not None, title
    return match.group(1)


def table(title: str) -> list[list[str]]:
    """The cells of the table in a section, without its head."""
    lines = [line for line in section(title).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines[2:]]


def modules() -> dict[str, ModuleType]:
    """The modules of the formalism by name."""
    folder = Path(formalism.__file__).parent
    names = sorted(path.stem for path in folder.glob("*.py") if path.stem != "__init__")
    return {name: importlib.import_module(f"lidarcli.formalism.{name}") for name in names}


BACKGROUND = {
    "alignment",
    "background",
    "cells",
    "combine",
    "grid",
    "learning",
    "mask",
    "stations",
    "subtraction",
}
"""The subtraction of a background has a page of its own, docs/background.md."""


def constants() -> dict[str, float]:
    """Every number that a module of the formalism names in capitals and assigns itself."""
    found = {}
    for name, module in modules().items():
        if name in CODES or name in BACKGROUND:
            continue
        tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
        assigned = {
            node.id
            for statement in tree.body
            if isinstance(statement, ast.Assign | ast.AnnAssign)
            for node in ast.walk(statement)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        }
        for constant in sorted(name for name in assigned if name.isupper()):
            value = getattr(module, constant)
            if isinstance(value, int | float):
                found[f"{name}.{constant}"] = float(value)
    return found


def test_every_constant_is_documented_with_its_value() -> None:
    documented = {row[0].strip("`"): float(row[1]) for row in table("Constants")}
    assert documented == {name: value for name, value in constants().items() if name not in DERIVED}


def test_every_parameter_is_documented_with_its_defaults() -> None:
    spell = {"inf": "no limit", "False": "off", "`adaptive`": "`adaptive`", "0.0": "0"}
    documented = [(row[0].strip("`"), row[3], row[4]) for row in table("Parameters")]
    expected = []
    for field in fields(Parameters):
        if field.name == "profile":
            continue
        values = [getattr(Parameters.for_profile(profile), field.name) for profile in ("robust", "paper")]
        text = [f"`{value}`" if isinstance(value, str) else str(value) for value in values]
        expected.append((field.name, *(spell.get(value, value) for value in text)))
    assert documented == expected


def test_every_function_of_the_definitions_exists() -> None:
    known = modules()
    for row in table("Definitions and functions"):
        named = re.findall(r"`([A-Za-z_.]+)`", row[2])
        assert named, row
        for name in named:
            if name.startswith("SweepBatch."):
                assert hasattr(SweepBatch, name.partition(".")[2]), name
            elif "." not in name or name.startswith("Detection."):
                assert name.rpartition(".")[2] in {field.name for field in fields(Detection)}, name
            else:
                module, _, attribute = name.partition(".")
                assert hasattr(known[module], attribute), name


def test_the_links_within_the_page_lead_somewhere() -> None:
    anchors = {
        re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-")
        for heading in re.findall(r"^#+ (.*)$", PAGE, re.MULTILINE)
    }
    links = set(re.findall(r"\]\(#([^)]+)\)", PAGE))
    assert len(links) >= 6
    assert links <= anchors
