"""Columns of tables: name, type, unit and meaning of each stand once, on the field of the record that holds its array."""

from __future__ import annotations

from dataclasses import MISSING, field, fields
from typing import Any, Literal, NamedTuple

Unit = Literal["", "1", "m", "rad", "s", "ns", "m/s", "rad/s", "Hz", "1/s", "byte", "m²"]
"""Units as tables and reports spell them: `1` for a count, an index or a share, empty for text, yes and no."""
Per = Literal["object", "vertex", "face", "offset", "sweep", "beam", "track", "trajectory"]
"""Entries of an array: one per object, vertex, face, sweep, beam (S, B) or track, or per track and sweep;
offsets have one more than objects."""


SINGLE: tuple[Unit, ...] = ("m", "rad", "1")
"""Units of numbers that tables keep in single precision: a range has 24 bits, and so has what is measured by ranges.

Times, velocities and covariances stay double, and what is declared so: places and headings in the world.
"""


class Column(NamedTuple):
    """Declaration of a column, which schemas, compiled loops, checks and docs follow."""

    name: str
    kind: Any
    """Type in the table: of numpy (`float32`), `text` (a dictionary), `string`, `stamp`, `bool`, or a type of Arrow."""
    unit: Unit
    meaning: str
    """One line for readers of the table."""
    words: tuple[str, ...] = ()
    """Names that the array has codes for."""
    nullable: bool = False
    """True for a column that may be null."""
    infinite: bool = False
    """True for a column that may be infinite."""
    per: Per | Literal[""] = ""
    """Entries of the array in the record; empty for a column that is not of a record."""
    field: str = ""
    """Name of the array in the record."""
    dtype: str = ""
    """Type of the array; codes stand for words, for instance."""


def column(
    unit: Unit,
    meaning: str,
    *,
    per: Per = "object",
    name: str = "",
    kind: str = "",
    words: tuple[str, ...] = (),
    nullable: bool = False,
    default: Any = MISSING,
) -> Any:
    """Declare the column of a field of a record. Name and type are by default those of the field.

    The default name drops what the entries and the unit say already: `vertex_theta` is `theta`, `first_stamp_ns` is
    `first_stamp`. The default type of a double follows from its unit (`SINGLE`).
    """
    kind = kind or ("text" if words else "stamp" if unit == "ns" else "")
    known = Column(name, kind, unit, meaning, words, nullable, per=per)
    # mypy takes `default` for a value of the field.
    return field(default=default, metadata={"column": known})


def columns_of(cls: type) -> dict[str, Column]:
    """Return the columns that a record declares: name of the field → column."""
    found = {}
    for each in fields(cls):
        known: Column | None = each.metadata.get("column")
        if known is not None:
            name = known.name or each.name.removeprefix(f"{known.per}_").removesuffix("_ns")
            # The annotation is text: `Float32 | None` is an array of float32.
            dtype = str(each.type).removesuffix(" | None").lower()
            kind = "float32" if dtype == "float64" and known.unit in SINGLE else dtype
            found[each.name] = known._replace(name=name, kind=known.kind or kind, field=each.name, dtype=dtype)
    return found
