"""The schemas are those of the contract, each column with its unit and meaning."""

from __future__ import annotations

import pyarrow as pa
import pytest

from lidarcli.tabular import SCHEMAS
from tests.tabular.contract import CONTRACT, OPEN


@pytest.mark.parametrize("table", sorted(CONTRACT))
def test_schema_is_the_contract(table: str) -> None:
    assert [(field.name, str(field.type)) for field in SCHEMAS[table]] == CONTRACT[table]
    assert [field.name for field in SCHEMAS[table] if field.nullable] == OPEN[table].split()


@pytest.mark.parametrize("table", sorted(CONTRACT))
def test_every_column_has_unit_and_description(table: str) -> None:
    def leaves(field: pa.Field) -> list[pa.Field]:
        if pa.types.is_list(field.type):
            return [field, *field.type.value_type]
        return [field]

    units = {leaf.name: leaf.metadata[b"unit"] for field in SCHEMAS[table] for leaf in leaves(field)}
    assert all(leaf.metadata[b"description"] for field in SCHEMAS[table] for leaf in leaves(field))
    assert set(units.values()) <= {b"rad", b"m", b"m/s", b"s", b"1", b"ns", "m²".encode(), b""}
    assert all(units[name] == b"rad" for name in units if name.startswith("theta") or name.endswith("yaw"))
