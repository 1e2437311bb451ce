"""Stamps of tables: in nanoseconds, or cut off to microseconds for programs that know no finer ones."""

from __future__ import annotations

from typing import TypeVar

import pyarrow as pa

COARSE = 1_000
"""Stamps in microseconds have lost less than this [ns]."""

Rows = TypeVar("Rows", pa.RecordBatch, pa.Table)


def in_unit(schema: pa.Schema, unit: str | None) -> pa.Schema:
    """Return a schema whose stamps count in `unit`, `ns` or `us`; None leaves them as they are."""
    for index, field in enumerate(schema) if unit is not None else ():
        if pa.types.is_timestamp(field.type) and field.type.unit != unit:
            told = field.with_metadata({**(field.metadata or {}), b"unit": unit})
            schema = schema.set(index, told.with_type(pa.timestamp(unit, field.type.tz)))
    return schema


def restamped(rows: Rows, unit: str | None) -> Rows:
    """Return rows whose stamps count in a unit, as of `in_unit`; what is finer is cut off."""
    schema = in_unit(rows.schema, unit)
    return rows if schema is rows.schema else rows.cast(schema, safe=False)
