"""Tables in memory in the place of files: Arrow tables, data frames, and what the Python functions return."""

from __future__ import annotations

import json
import sys
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from typing import Any

import pyarrow as pa

from lidarcli.errors import OptionError
from lidarcli.pipeline.inputs.tables import Given, Pair
from lidarcli.tabular.reading import HeldTable, is_text, note_value, notes_of
from lidarcli.tabular.schemas import SCHEMAS
from lidarcli.tabular.writing import DAMAGE, SOURCE

KEYS = ("log", "topic")
"""Columns of every table of logs."""
CHANGES_KEYS = frozenset(("log_a", "log_b", "status"))
"""Columns by which a table of changes is known."""
_BESIDE: dict[int, tuple[Any, ...]] = {}
"""Identity of an objects table that is in memory → the other tables of its logs."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldPair(Pair):
    """The tables of one log that are in memory, named as files of them would be."""

    held: dict[str, pa.Table]

    def _table(self, table: str) -> HeldTable:
        return HeldTable(f"{self.before}{table}{self.after}", self.held.get(table))


def remember(objects: Any, others: Sequence[Any]) -> None:
    """Remember the tables beside an objects table while somebody holds it: by itself it tells of no empty sweep."""
    _BESIDE[id(objects)] = tuple(others)
    weakref.finalize(objects, _BESIDE.pop, id(objects), None).atexit = False


def is_table(value: Any) -> bool:
    """Tell whether a value is a table: of Arrow, pandas, polars or any library that hands out Arrow streams."""
    # A series of paths hands out a stream, too, but has no columns.
    return _is_frame(value) or (hasattr(value, "__arrow_c_stream__") and hasattr(value, "columns"))


def arrow_of(value: Any) -> pa.Table:
    """Return a table as one of Arrow; the metadata of a data frame are its `attrs`."""
    if isinstance(value, pa.Table):
        return value
    try:
        if not _is_frame(value):
            return pa.table(value)
        table = pa.Table.from_pandas(value, preserve_index=False)
    except (pa.ArrowException, ValueError, TypeError) as err:
        raise OptionError(f"a {type(value).__name__} that is no table: {' '.join(str(err).split())}") from None
    # A category without a value has no type.
    for at, field in enumerate(table.schema):
        if pa.types.is_dictionary(field.type) and pa.types.is_null(field.type.value_type):
            table = table.set_column(at, field.name, pa.nulls(table.num_rows))
    notes = {key: note for key, note in value.attrs.items() if isinstance(key, str) and isinstance(note, str)}
    return table.replace_schema_metadata(notes)


def pairs_of(tables: Sequence[Any]) -> list[HeldPair]:
    """Return the tables of each log, of some that belong together: at most one of each kind holds rows of a log.

    Raises
    ------
    OptionError
        One is no table of lidarcli, or two of a kind are of the same log.
    """
    known = [(_kind_of(table), table) for table in map(arrow_of, tables)]
    kinds = {kind for kind, _ in known}
    beside = [other for table in tables for other in _BESIDE.get(id(table), ())]
    known += [(kind, table) for table in map(arrow_of, beside) if (kind := _kind_of(table)) not in kinds]
    split = [(kind, table, _by_log(table)) for kind, table in known]
    # The order of the logs is that of their sweeps, which every log has.
    ordered = sorted(split, key=lambda each: each[0] != "sweeps")
    logs = dict.fromkeys(log for _, _, parts in ordered for log in parts)
    found = []
    for log in logs or {"": None}:
        held: dict[str, pa.Table] = {}
        for kind, table, parts in split:
            part = parts.get(log)
            if part is None and kind in held:
                continue
            if part is not None and kind in held and held[kind].num_rows:
                raise OptionError(f"two {kind} tables hold rows of {log}: name one of them")
            held[kind] = _told_of(table.slice(0, 0) if part is None else part, log, [*logs])
        found.append(HeldPair(f"{log}." if log else "", ".parquet", held))
    return found


def tables_of(values: Any) -> list[Given]:
    """Return tables, each named by a path or in memory: those of a tuple that a function returned belong together.

    Raises
    ------
    TypeError
        One is neither a path nor a table.
    OptionError
        One is no table of lidarcli, or two of a kind are of the same log.
    """
    found: list[Given] = []
    pairs: list[HeldPair] = []
    loose: list[Any] = []
    for each in _each_table(values):
        if isinstance(each, str):
            found.append(each)
        elif isinstance(each, list):
            pairs += pairs_of(each)
        elif {*(table := arrow_of(each)).column_names} >= CHANGES_KEYS:
            found.append(HeldTable("changes.parquet", table))
        else:
            loose.append(each)
    return [*found, *_joined([*pairs, *(pairs_of(loose) if loose else ())])]


def tables_to_export(values: Any) -> list[str | HeldTable]:
    """Return tables of any kind, each named by a path or in memory (`TypeError` if one is neither)."""
    given = [*_each_table(values)]
    if any(isinstance(each, list) for each in given):
        raise TypeError("tables of one kind are exported at a time: give one of these, as .objects")
    return [each if isinstance(each, str) else HeldTable("the table", arrow_of(each)) for each in given]


def _each_table(values: Any) -> Iterator[Any]:
    """Yield the path of each table as text, a table itself, or the list of those that a function returned together."""
    made = (isinstance(values, tuple) and hasattr(values, "_fields")) or _has_changes(values)
    given = [values] if isinstance(values, str | PathLike) or is_table(values) or made else values
    if not isinstance(given, Iterable) or isinstance(given, Mapping):
        raise TypeError(_no_table(values))
    for each in given:
        if isinstance(each, str | PathLike):
            yield fspath(each)
        elif is_table(each):
            yield each
        elif isinstance(each, tuple) and hasattr(each, "_fields"):
            together = [*each, getattr(each, "trajectories", None)]
            yield [table for table in together if table is not None]
        elif _has_changes(each):
            yield each.changes
        else:
            raise TypeError(_no_table(each))


def _no_table(value: Any) -> str:
    return (
        "tables are named by their paths, or are what detect, track, tables, zones and diff return, Arrow tables or "
        f"data frames, not {type(value).__name__}"
    )


def _has_changes(value: Any) -> bool:
    """Tell whether a value is what `diff` returns."""
    return is_table(getattr(value, "changes", None))


def _joined(pairs: Sequence[HeldPair]) -> list[HeldPair]:
    """Return the pairs, those of one log as one where they hold other kinds, as what `track` and `zones` return."""
    found: list[HeldPair] = []
    for pair in pairs:
        same = next((k for k, one in enumerate(found) if _belong(one, pair)), None)
        if same is None:
            found.append(pair)
        else:
            found[same] = replace(pair, held=found[same].held | pair.held)
    return found


def _belong(one: HeldPair, other: HeldPair) -> bool:
    return (one.before, one.after) == (other.before, other.after) and not one.held.keys() & other.held.keys()


def _is_frame(value: Any) -> bool:
    """Tell whether a value is a data frame of pandas, which nobody imports for the question."""
    pandas = sys.modules.get("pandas")
    return pandas is not None and isinstance(value, pandas.DataFrame)


def _kind_of(table: pa.Table) -> str:
    """Return the kind of a table, by its columns: that which has most of them."""
    names = {*table.column_names}
    if not names.issuperset(KEYS):
        some = ", ".join(table.column_names[:10])
        raise OptionError(f"a table with the columns {some} is none of lidarcli: no column {' or '.join(KEYS)}")
    for name in KEYS:
        if (times := table.column_names.count(name)) > 1:
            raise OptionError(f"a table in memory has {times} columns {name}, not one")
    return max(SCHEMAS, key=lambda kind: len(names & {*SCHEMAS[kind].names}) - len(SCHEMAS[kind]) / 1000)


def _by_log(table: pa.Table) -> dict[str, pa.Table]:
    """Return the rows of each log."""
    import pyarrow.compute as pc

    if not is_text(table["log"].type):
        raise OptionError(f"column log is {table['log'].type}, not text: it names the log of each row")
    names = table["log"].cast(pa.string())
    logs = names.unique().drop_null().to_pylist()
    return {log: table if len(logs) == 1 else table.filter(pc.equal(names, log)) for log in logs}


def _told_of(table: pa.Table, log: str, logs: Sequence[str]) -> pa.Table:
    """Return the rows of one of several logs with the metadata that are about it."""
    notes = notes_of(table)
    sources, damage = note_value(notes, SOURCE, list), note_value(notes, DAMAGE, list)
    if not sources:
        return table
    if len(sources) == len(logs) and log in logs:
        notes[SOURCE] = json.dumps(sources[logs.index(log)])
    else:
        notes.pop(SOURCE)
    if DAMAGE in notes:
        notes[DAMAGE] = json.dumps([*_lines_of(damage, log, logs)])
    return table.replace_schema_metadata(notes)


def _lines_of(damage: Sequence[Any], log: str, logs: Sequence[str]) -> Iterator[Any]:
    """Yield the lines that name a log; those that name none are the first one's."""
    for line in damage:
        of = next((each for each in logs if str(line).startswith(f"{each}: ")), logs[0] if logs else log)
        if of == log:
            yield line
