"""docs/background.md says what the code says: constants, columns, options."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

from lidarcli.tables.schemas import BACKGROUND
from tests.places import ROOT

PAGE = (ROOT / "docs" / "background.md").read_text(encoding="utf-8")
MODULES = ("alignment", "model", "cells", "grid", "learning", "stations", "subtraction")


def constants() -> dict[str, float]:
    """Every number that these modules name in capitals and assign themselves."""
    found = {}
    for name in MODULES:
        module = importlib.import_module(f"lidarcli.formalism.background.{name}")
        for statement in ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")).body:
            if not isinstance(statement, ast.Assign):
                continue
            for node in ast.walk(statement):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id.isupper():
                    value = getattr(module, node.id)
                    if isinstance(value, int | float):
                        found[f"{name}.{node.id}"] = float(value)
    return found


def test_every_constant_is_documented_with_its_value() -> None:
    rows = re.findall(r"^\| `(\w+\.\w+)` \| ([\d.]+) \|", PAGE, re.MULTILINE)
    assert {name: float(value) for name, value in rows} == constants()


def test_the_columns_that_need_a_word_have_one() -> None:
    meaning = PAGE.partition("## What the figures mean")[2].partition("\n## ")[0]
    for column in ("r_e", "spread", "support", "no_return", "r_near"):
        assert f"`{column}`" in meaning
        assert column in BACKGROUND.names
