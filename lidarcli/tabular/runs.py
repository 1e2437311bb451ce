"""Rows of a manifest: the outcome of each log in one run."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa

from lidarcli.errors import UnreadableError
from lidarcli.stores import Place
from lidarcli.tabular.reading import read_columns
from lidarcli.tabular.schemas import RUNS

FOLDER = "_lidarcli"
"""Folder of the manifests of earlier versions."""
OK, DAMAGED, FAILED = OUTCOMES = ("ok", "damaged", "failed")
"""Outcomes of a log: read whole, read as far as possible, without tables."""
_STAMPS = frozenset({"mtime", "ended"})
_BYTES = re.compile(r"\\x([89a-f][0-9a-f])")
_TEXTS = frozenset({"log", "url", "message"})
_CODES = {OK: {0, 4}, DAMAGED: {3}, FAILED: {2, 3, 4, 5, 70}}
"""Outcome → exit codes that it can have; 4 with tables: one of several topics was not there."""


@dataclass(frozen=True, slots=True)
class Entry:
    """Outcome of one log in one run: a row of the manifest."""

    log: str
    """Its name, which its tables carry."""
    url: str
    """Its place: an absolute path, or a URL."""
    size: int | None
    """Bytes."""
    etag: str | None
    mtime: int | None
    """Last change [ns since 1970]."""
    parameters: str
    """Hash of everything that the tables depend on beside the log."""
    version: str
    outcome: str
    """`ok`, `damaged` or `failed`."""
    exit_code: int
    message: str | None
    outputs: list[str] = field(default_factory=list)
    output_sizes: list[int] = field(default_factory=list)
    """Bytes of each of them."""
    sweeps: int | None = None
    rows: int | None = None
    """Rows of all its tables."""
    seconds: float | None = None
    ended: int = field(default_factory=time.time_ns)
    """[ns since 1970]"""

    @property
    def is_done(self) -> bool:
        """True where doing the log again would give no more."""
        return self.outcome in (OK, DAMAGED)


def newest(entries: Iterable[Entry]) -> dict[str, Entry]:
    """Return the last entry of each log, by its URL."""
    return {entry.url: entry for entry in sorted(entries, key=lambda entry: entry.ended)}


def run_rows(entries: Sequence[Entry]) -> pa.RecordBatch:
    """Return the rows of entries. Bytes of a name that are no UTF-8 stand as `\\xe9`."""
    columns: dict[str, list[Any]] = {name: [getattr(entry, name) for entry in entries] for name in RUNS.names}
    for name in _TEXTS:
        columns[name] = [value if value is None else _escaped(value) for value in columns[name]]
    columns["outputs"] = [[*map(_escaped, names)] for names in columns["outputs"]]
    return pa.RecordBatch.from_pydict(columns, RUNS)


def read_run(file: Place) -> list[Entry]:
    """Read the entries of a manifest, or raise `UnreadableError` with one line."""
    table = read_columns(file, "runs", RUNS)
    columns: list[list[Any]] = [
        (table[name].cast(pa.int64()) if name in _STAMPS else table[name]).to_pylist() for name in RUNS.names
    ]
    rows = (dict(zip(RUNS.names, values, strict=True)) for values in zip(*columns, strict=True))
    return [_entry(file, row) for row in rows]


def _entry(file: Place, row: dict[str, Any]) -> Entry:
    outcome, code = row["outcome"], row["exit_code"]
    if outcome not in OUTCOMES:
        *first, last = OUTCOMES
        raise UnreadableError(f"{file}: column outcome holds {outcome!r}, not {', '.join(first)} or {last}")
    if code not in _CODES[outcome]:
        raise UnreadableError(f"{file}: column exit_code holds {code}, which a log that is {outcome} has not")
    if None in (row["outputs"] or []) or None in (row["output_sizes"] or []):
        raise UnreadableError(f"{file}: column outputs holds an empty name")
    names = [_unescaped(name) for name in row["outputs"] or []]
    texts = {name: row[name] if row[name] is None else _unescaped(row[name]) for name in _TEXTS}
    return Entry(**{**row, **texts, "outputs": names, "output_sizes": row["output_sizes"] or []})


def _escaped(name: str) -> str:
    """Return a name of a file as text.

    >>> _escaped("caf\\udce9.mcap")
    'caf\\\\xe9.mcap'
    """
    try:
        name.encode()
    except UnicodeEncodeError:
        return os.fsencode(name).decode("utf-8", "backslashreplace")
    return name


def _unescaped(text: str) -> str:
    """Return the name of a file from its text."""
    return _BYTES.sub(lambda found: os.fsdecode(bytes.fromhex(found[1])), text)
