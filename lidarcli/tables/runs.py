"""The rows of a manifest: what became of each log in one run."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import pyarrow as pa

from lidarcli.errors import UnreadableError
from lidarcli.stores.url import Place
from lidarcli.tables.reading import read_columns
from lidarcli.tables.schemas import RUNS

OK, DAMAGED, FAILED = OUTCOMES = ("ok", "damaged", "failed")
"""What may become of a log: read whole, read as far as it can be, without tables."""
_STAMPS = frozenset({"mtime", "ended"})


@dataclass(frozen=True, slots=True)
class Entry:
    """What became of one log in one run: a row of the manifest."""

    log: str
    """Its name, which its tables carry."""
    url: str
    """Where it is: an absolute path, or a URL."""
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
    sweeps: int | None = None
    rows: int | None = None
    """Rows of all its tables."""
    seconds: float | None = None
    ended: int = field(default_factory=time.time_ns)
    """[ns since 1970]"""

    @property
    def is_done(self) -> bool:
        """Whether there is no more to be got out of the log."""
        return self.outcome in (OK, DAMAGED)


def newest(entries: Iterable[Entry]) -> dict[str, Entry]:
    """URL → the entry of a log that ended last."""
    return {entry.url: entry for entry in sorted(entries, key=lambda entry: entry.ended)}


def run_rows(entries: Sequence[Entry]) -> pa.RecordBatch:
    """The rows of entries."""
    columns = {name: [getattr(entry, name) for entry in entries] for name in RUNS.names}
    return pa.RecordBatch.from_pydict(columns, RUNS)


def read_run(file: Place) -> list[Entry]:
    """The entries of a manifest, or `UnreadableError` with one line."""
    table = read_columns(file, "runs", RUNS)
    odd = sorted({*table["outcome"].unique().to_pylist()} - {*OUTCOMES})
    if odd:
        *first, last = OUTCOMES
        raise UnreadableError(f"{file}: column outcome holds {odd[0]!r}, not {', '.join(first)} or {last}")
    columns: list[list[Any]] = [
        (table[name].cast(pa.int64()) if name in _STAMPS else table[name]).to_pylist() for name in RUNS.names
    ]
    rows = (dict(zip(RUNS.names, values, strict=True)) for values in zip(*columns, strict=True))
    return [Entry(**{**row, "outputs": row["outputs"] or []}) for row in rows]
