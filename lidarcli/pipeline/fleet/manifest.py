"""The manifest of a run: what became of each log, one Parquet file per run beside the tables.

Every run has a file of its own, so that runs at the same time cannot spoil each other's; the newest row of a log counts.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.errors import UnreadableError
from lidarcli.newfiles import write_whole
from lidarcli.pipeline.inputs.files import all_files
from lidarcli.stores.url import Place
from lidarcli.tables.reading import read_columns
from lidarcli.tables.schemas import RUNS

FOLDER = "_lidarcli"
"""Readers of folders of tables skip what begins with an underscore."""
EVERY_S = 30.0
"""[s] So often the manifest is written anew while a run goes on, for the day that it is killed …"""
SHARE = 0.05
"""… but writing it takes no more than this share of the time."""
OK, DAMAGED, FAILED = "ok", "damaged", "failed"
"""Outcomes: whole; read as far as it can be; without tables."""


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


class Manifest:
    """The manifest of a run that goes on: written anew now and then, and when it is closed."""

    def __init__(self, folder: Place) -> None:
        now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%f")[:-3]
        self.path: Place = folder / FOLDER / f"run-{now}Z-{os.urandom(4).hex()}.parquet"
        self._batches: list[pa.RecordBatch] = []
        self._entries: list[Entry] = []
        self._due = time.monotonic() + EVERY_S

    def add(self, entry: Entry) -> None:
        """Take what became of one log."""
        self._entries.append(entry)
        if time.monotonic() > self._due:
            self.write()

    def write(self) -> None:
        """Write all that is known by now; nothing where there is nothing."""
        if self._entries:
            self._batches.append(_rows(self._entries))
            self._entries = []
        if not self._batches:
            return
        started = time.monotonic()
        table = pa.Table.from_batches(self._batches, RUNS).combine_chunks()
        self._batches = table.to_batches()
        out = pa.BufferOutputStream()
        pq.write_table(table, out, compression="zstd")
        write_whole(self.path, out.getvalue().to_pybytes())
        ended = time.monotonic()
        self._due = ended + max(EVERY_S, (ended - started) / SHARE)


def read_entries(folder: Place) -> tuple[list[Entry], list[str]]:
    """The rows of all manifests below a folder of tables, oldest first, and a line for each that cannot be read."""
    entries: list[Entry] = []
    problems = []
    for file in all_files(folder / FOLDER, ".parquet"):
        try:
            entries += _entries(read_columns(file, "runs", RUNS))
        except UnreadableError as err:
            problems.append(str(err))
    return sorted(entries, key=lambda entry: entry.ended), problems


def newest(entries: Iterable[Entry]) -> dict[str, Entry]:
    """URL → the newest of its entries, which come oldest first."""
    return {entry.url: entry for entry in entries}


def _rows(entries: list[Entry]) -> pa.RecordBatch:
    columns = {name: [getattr(entry, name) for entry in entries] for name in RUNS.names}
    return pa.RecordBatch.from_pydict(columns, RUNS)


def _entries(table: pa.Table) -> Iterator[Entry]:
    stamps = {"mtime", "ended"}
    plain: list[list[Any]] = [
        (table[name].cast(pa.int64()) if name in stamps else table[name]).to_pylist() for name in RUNS.names
    ]
    for values in zip(*plain, strict=True):
        row = dict(zip(RUNS.names, values, strict=True))
        yield Entry(**{**row, "outputs": row["outputs"] or []})
