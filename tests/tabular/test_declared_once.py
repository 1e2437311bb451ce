"""A column is declared once: name, type, unit and meaning stand on one field or in one line of `schemas.py`."""

from __future__ import annotations

from collections import Counter

import pytest

from lidarcli.formalism.detection import Detection
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks
from lidarcli.sweeps import Column, Float64, columns_of, record
from lidarcli.tabular.schemas import KINDS, TABLES


@pytest.mark.parametrize("kind", [Detection, TrackedBatch, Tracks])
def test_columns_of_a_record_have_its_names_and_types(kind: type) -> None:
    for name, one in columns_of(kind).items():
        assert one.field == name
        assert one.kind in KINDS
        assert one.dtype in ("int8", "uint8", "int32", "int64", "float32", "float64")


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
