"""A column is declared once: name, type, unit and meaning stand on one field or in one line of `schemas.py`."""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

import lidarcli
from lidarcli.columns import Column, columns_of
from lidarcli.formalism.detection import COLUMNS, Detection
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks
from lidarcli.sweeps import Float64, record
from lidarcli.tabular.schemas import KINDS, TABLES

PACKAGE = Path(lidarcli.__file__).parent
SCHEMAS = ("tabular/schemas.py", "simulation/truth.py")
"""Files that turn declarations into the schemas of Arrow."""


SOURCES = {path.relative_to(PACKAGE).as_posix(): path.read_text("utf-8") for path in PACKAGE.rglob("*.py")}


def calls(*names: str) -> Iterator[tuple[str, ast.Call]]:
    """Every call of these functions in the package, with its file."""
    for file, text in sorted(SOURCES.items()):
        if any(f"{name}(" in text for name in names):
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
                    name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
                    if name in names:
                        yield file, node


def test_no_meaning_is_told_twice() -> None:
    told = Counter(
        text.value
        for _, call in calls("column", "Column")
        for text in call.args[1:]
        if isinstance(text, ast.Constant) and isinstance(text.value, str) and " " in text.value.strip()
    )
    assert len(told) > 100
    assert [meaning for meaning, count in told.items() if count > 1] == []


def test_a_meaning_stands_only_where_it_is_declared() -> None:
    meanings = {one.meaning for table in TABLES.values() for one in table if one.meaning.count(" ") > 3}
    found = Counter(meaning for text in SOURCES.values() for meaning in meanings for _ in range(text.count(f'"{meaning}"')))
    assert len(found) > 50
    assert [meaning for meaning, count in found.items() if count > 1] == []


def test_only_declarations_make_columns_of_units_and_meanings() -> None:
    for file, call in calls("schema", "field", "struct"):
        assert file in SCHEMAS or "description" not in ast.unparse(call), f"{file}:{call.lineno}"


@pytest.mark.parametrize("kind", [Detection, TrackedBatch, Tracks])
def test_columns_of_a_record_have_its_names_and_types(kind: type) -> None:
    for name, one in columns_of(kind).items():
        assert one.field == name
        assert one.kind in KINDS
        assert one.dtype in ("int8", "uint8", "int32", "int64", "float32", "float64")


def test_names_leave_out_what_entries_and_units_say() -> None:
    tracks = columns_of(Tracks)
    assert (COLUMNS["vertex_theta"].name, tracks["first_stamp_ns"].name) == ("theta", "first_stamp")
    assert (COLUMNS["sweep_d_th"].name, COLUMNS["beam_i"].name) == ("d_th", "beam_i")
    assert (tracks["first_stamp_ns"].kind, COLUMNS["set"].kind, COLUMNS["r_min"].kind) == ("stamp", "text", "float32")


def test_fields_without_a_declaration_are_no_columns() -> None:
    assert "order" not in columns_of(TrackedBatch)

    @record
    class Plain:
        x: Float64

    assert columns_of(Plain) == {}


def test_every_table_has_each_name_once() -> None:
    for name, table in TABLES.items():
        assert all(isinstance(one, Column) for one in table)
        assert max(Counter(one.name for one in table).values()) == 1, name
