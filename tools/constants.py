"""The page of the site with the constants of the method: names, values, and what the code says of them."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lidarcli import formalism
from tools.reference import as_page, as_table

HEAD = """# Constants

The numbers of the method that are no options, as the code declares them. They were chosen on simulated scenes and logs
other than those that [accuracy](accuracy.md), [tracking](tracking.md) and [maps](maps.md) report on.
"""
UNLISTED = {"native", "forest", "detection", "parameters"}
"""Modules whose numbers are the layout of arrays, grown trees, and codes and options that stand on other pages."""


def constants_page() -> str:
    """docs/constants.md of the site, made from the source: compiled modules do not have their constants."""
    lines = [HEAD]
    for title, rows in constants().items():
        told = [row for row in rows if row[2]]
        lines += [f"## {title}", "", *as_table(("constant", "value", "meaning"), iter(told))] if told else []
    return as_page(lines)


def constants() -> dict[str, list[tuple[str, str, str]]]:
    """Module → (names, values, docstring or '') of the numbers that it assigns to names in capitals."""
    home = Path(formalism.__file__).parent
    found = {}
    for path in sorted(home.rglob("*.py")):
        if path.stem not in UNLISTED:
            found[path.relative_to(home).with_suffix("").as_posix()] = list(_rows(path))
    return found


def _rows(path: Path) -> Iterator[tuple[str, str, str]]:
    package = Path(formalism.__file__).parent.parent
    module = importlib.import_module(".".join(("lidarcli", *path.relative_to(package).with_suffix("").parts)))
    body = ast.parse(path.read_text(encoding="utf-8")).body
    records = {statement.name: statement for statement in body if isinstance(statement, ast.ClassDef)}
    for statement, words in _explained(body):
        if _is_borrowed(statement.value):
            continue
        names = [node.id for node in ast.walk(statement) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]
        values = [_number(getattr(module, name, None)) for name in names if name.isupper()]
        if names and len(values) == len(names) and all(values):
            yield ", ".join(f"`{name}`" for name in names), ", ".join(values), words
        elif names and isinstance(statement.value, ast.Call) and (record := records.get(ast.unparse(statement.value.func))):
            # A record of the thresholds of one stage, with the values that its class declares.
            for field, meaning in _explained(record.body):
                target = ast.unparse(field.target) if isinstance(field, ast.AnnAssign) else ""
                if value := _number(getattr(getattr(module, names[0]), target, None)):
                    yield f"`{names[0]}.{target}`", value, meaning


def _explained(body: list[ast.stmt]) -> Iterator[tuple[ast.Assign | ast.AnnAssign, str]]:
    """Yield the assignments of a module or class, each with its docstring."""
    for statement, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(statement, ast.Assign | ast.AnnAssign):
            words = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and str(after.value.value)
            yield statement, " ".join((words or "").split())


def _is_borrowed(value: ast.expr | None) -> bool:
    """True for constants of other modules: `results.MAX_LEGS`, or several of them."""
    parts = value.elts if isinstance(value, ast.Tuple) else [value]
    return all(isinstance(part, ast.Attribute) for part in parts)


def _number(value: Any) -> str:
    """A number, or a row of numbers, as the page shows it; '' for anything else."""
    if isinstance(value, tuple):
        return ", ".join(map(_number, value)) if all(map(_number, value)) else ""
    return f"{value:.6g}" if isinstance(value, int | float) else ""
