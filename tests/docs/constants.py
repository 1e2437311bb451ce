"""The constants that a module of the formalism has, for the tests that hold a page to them."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path


def constants(modules: tuple[str, ...], package: str = "lidarcli.formalism") -> dict[str, float]:
    """Every number that these modules of a package name in capitals and assign themselves, as `module.NAME`."""
    found = {}
    for name in modules:
        module = importlib.import_module(f"{package}.{name}")
        for statement in ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8")).body:
            if not isinstance(statement, ast.Assign):
                continue
            for node in ast.walk(statement):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id.isupper():
                    value = getattr(module, node.id)
                    if isinstance(value, int | float):
                        found[f"{name.split('.')[-1]}.{node.id}"] = float(value)
    return found
