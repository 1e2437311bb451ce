"""Where two tables differ: row by row and column by column, sweeps with other numbers of rows apart."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from lidarcli.sweeps.types import Bool, Float64, Int64

TOLERANCE = 1e-9
"""Numbers that differ by no more are the same [m], [rad]."""
SINGLE = 1e-6
"""Relative difference of numbers that are the same where one side keeps them in single precision."""
UNDIRECTED = ("box_yaw", "world_yaw")
"""Directions of lines, which are the same after half a turn."""
KEYS = {"background": ["topic", "frame_id", "station"], "tracks": ["topic", "track"]}
"""Columns whose rows belong together; by default those of a sweep."""
SWEEP = ["topic", "sweep"]


@dataclass(frozen=True)
class Difference:
    """How one column of two tables differs."""

    column: str
    other: int
    """Rows of another value: of anything but a number, or of one that only one side has."""
    beyond: int
    """Rows whose numbers differ by more than the tolerance."""
    greatest: float
    """Greatest difference of two numbers."""
    example: str = ""

    @property
    def matters(self) -> bool:
        """Whether it is more than rounding."""
        return bool(self.other or self.beyond)


def compare_files(kind: str, one: Path, other: Path) -> Iterator[Difference]:
    """Yield the differences of two files of a kind; none where they are the same bytes.

    Of tables whose bytes differ, columns and metadata are compared, and at the end the bytes count as rounding.
    """
    before, after = one.read_bytes(), other.read_bytes()
    if before == after:
        return
    if one.suffix != ".parquet":
        yield Difference("(bytes)", 1, 0, 0.0, f"{len(before)} -> {len(after)} bytes")
        return
    tables = pq.read_table(one), pq.read_table(other)
    yield from compare_metadata(*(table.schema.metadata or {} for table in tables))
    yield from compare_tables(*tables, KEYS.get(kind, SWEEP))
    yield Difference("(bytes)", 0, 0, 0.0)


def compare_metadata(one: dict[bytes, bytes], other: dict[bytes, bytes]) -> Iterator[Difference]:
    """Yield each entry of the metadata that differs."""
    for key in sorted(one.keys() | other.keys()):
        values = one.get(key), other.get(key)
        if values[0] != values[1]:
            example = " -> ".join("none" if value is None else value.decode() for value in values)
            yield Difference(f"({key.decode()})", 1, 0, 0.0, example)


Place = Callable[[int], str]
"""Says which row of a table is meant."""


def compare_tables(one: pa.Table, other: pa.Table, keys: list[str]) -> Iterator[Difference]:
    """The differences of two tables, columns that are the same left out.

    Rows are compared in their order. Those of a sweep with another number of rows count as such and are not compared.
    Numbers of single and of double precision are compared; that a type is another one of these is rounding.
    """
    shared = []
    for name in dict.fromkeys([*one.column_names, *other.column_names]):
        types = [table.schema.field(name).type if name in table.schema.names else None for table in (one, other)]
        if types[0] != types[1]:
            rounding = None not in types and _precise(types[0]) == _precise(types[1])
            rows = 0 if rounding else max(len(one), len(other))
            yield Difference(name, rows, 0, 0.0, f"type {types[0]} -> {types[1]}")
            if not rounding:
                continue
        shared.append(name)
    groups = [pd.MultiIndex.from_frame(table.select(keys).to_pandas()) for table in (one, other)]
    before, after = groups[0].value_counts().align(groups[1].value_counts(), fill_value=0)
    unequal = before.index[(before != after).to_numpy()]
    if len(unequal):
        first = unequal[0]
        named = ", ".join(f"{key} {value}" for key, value in zip(keys, first, strict=True))
        example = f"{len(unequal)} times, first {named}: {before[first]:.0f} -> {after[first]:.0f} rows"
        yield Difference("(rows)", int((before - after).abs().sum()), 0, 0.0, example)
    one, other = (table.filter(pa.array(~group.isin(unequal))) for table, group in zip((one, other), groups, strict=True))

    def place(row: int) -> str:
        named = [*keys, *(key for key in ("object", "beam") if key in one.column_names)]
        return ", ".join(f"{key} {one[key][row].as_py()}" for key in named)

    for name in shared:
        for found in _compare(name, one[name].combine_chunks(), other[name].combine_chunks(), place):
            if found.other or found.greatest:
                yield found


def _precise(kind: pa.DataType) -> str:
    """Return the name of a type, whatever its precision, and whether it may be null."""
    return str(kind).replace("float", "double").replace(" not null", "")


def _compare(name: str, one: pa.Array, other: pa.Array, place: Place) -> Iterator[Difference]:
    """Of one column; of a column of lists their lengths, and then each field of their items."""
    rows = np.arange(len(one))
    if not pa.types.is_list(one.type):
        yield _values(name, one, other, rows, place)
        return
    lengths = [array.value_lengths() for array in (one, other)]
    apart = _unequal(*lengths)
    yield _difference(name, (lengths[0], lengths[1]), apart, rows, place)
    alike = ~apart & _plain(one.is_valid())
    owner = rows[alike].repeat(_plain(pc.filter(lengths[0], pa.array(alike))))
    items = [pc.filter(array, pa.array(alike)).flatten() for array in (one, other)]
    for number, field in enumerate(one.type.value_type):
        fields = [item.flatten()[number] for item in items]
        yield _values(f"{name}.{field.name}", fields[0], fields[1], owner, place)


def _values(name: str, one: pa.Array, other: pa.Array, owner: Int64, place: Place) -> Difference:
    """Of flat values; `owner` is the row of each."""
    if not pa.types.is_floating(one.type):
        return _difference(name, (one, other), _unequal(one, other), owner, place)
    before, after = (np.asarray(_plain(array), np.float64) for array in (one, other))
    single = any(pa.types.is_float32(array.type) for array in (one, other))
    finite = np.isfinite(before) & np.isfinite(after)
    apart = np.zeros(len(finite))
    apart[finite] = np.abs(before[finite] - after[finite])
    if name in UNDIRECTED:
        apart = np.minimum(apart % np.pi, np.pi - apart % np.pi)
    unequal = ~finite & (before != after) & ~(np.isnan(before) & np.isnan(after))
    unequal |= _plain(one.is_null()) != _plain(other.is_null())
    tolerance = TOLERANCE + SINGLE * np.abs(before) if single else TOLERANCE
    return _difference(name, (one, other), unequal, owner, place, apart, apart > tolerance)


def _unequal(one: pa.Array, other: pa.Array) -> Bool:
    """Which values differ, or are there on one side alone."""
    if pa.types.is_dictionary(one.type):
        one, other = one.dictionary_decode(), other.dictionary_decode()
    unequal: Bool = _plain(pc.fill_null(pc.not_equal(one, other), False)).copy()
    unequal |= _plain(one.is_null()) != _plain(other.is_null())
    return unequal


def _plain(array: pa.Array) -> Any:
    return array.to_numpy(zero_copy_only=False)


def _difference(
    name: str,
    values: tuple[pa.Array, pa.Array],
    unequal: Bool,
    owner: Int64,
    place: Place,
    apart: Float64 | None = None,
    beyond: Bool | None = None,
) -> Difference:
    """Counted by row, with the place of the worst."""
    if apart is None or beyond is None:
        apart, beyond = np.zeros(len(unequal)), np.zeros(len(unequal), bool)
    greatest = float(apart.max(initial=0.0))
    example = ""
    if unequal.any() or greatest:
        at = int(unequal.argmax() if unequal.any() else apart.argmax())
        example = f"{place(int(owner[at]))}: {values[0][at].as_py()!r} -> {values[1][at].as_py()!r}"
    rows = [len(np.unique(owner[which])) for which in (unequal, beyond)]
    return Difference(name, rows[0], rows[1], greatest, example)
