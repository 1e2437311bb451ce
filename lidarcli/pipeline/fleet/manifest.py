"""The manifest of a run: what became of each log, one Parquet file per run beside the tables.

Every run has a file of its own, so that runs at the same time cannot spoil each other's; the newest row of a log counts.
"""

from __future__ import annotations

import os
import time
from datetime import UTC, datetime

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.errors import OutputError, UnreadableError
from lidarcli.newfiles import write_whole
from lidarcli.pipeline.inputs.files import all_files
from lidarcli.stores.url import Place, Url
from lidarcli.tabular.runs import Entry, read_run, run_rows
from lidarcli.tabular.schemas import RUNS

FOLDER = "_lidarcli"
"""Readers of folders of tables skip what begins with an underscore."""
PACKED = 250
"""Entries that are kept as such: as columns they take a tenth of the memory."""
EVERY_S = 30.0
"""[s] So often the manifest is written anew while a run goes on, for the day that it is killed …"""
SHARE = 0.05
"""… but writing it takes no more than this share of the time."""


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
        if len(self._entries) >= PACKED:
            self._pack()
        if time.monotonic() > self._due:
            self.write()

    def _pack(self) -> None:
        if self._entries:
            self._batches.append(run_rows(self._entries))
            self._entries = []

    def write(self) -> None:
        """Write all that is known by now; nothing where there is nothing."""
        self._pack()
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


def refuse_folder(folder: Place) -> None:
    """Refuse a folder of tables that cannot have manifests, before any log is read (`OutputError`)."""
    if isinstance(folder, Url):
        from lidarcli.stores.store import has_bucket

        try:
            there = has_bucket(folder)
        except UnreadableError as err:
            raise OutputError(f"cannot write {err}") from err
        if not there:
            raise OutputError(f"cannot write {folder}: there is no such bucket")
    elif os.path.lexists(folder / FOLDER) and not os.path.isdir(folder / FOLDER):  # noqa: PTH112 (never raises)
        raise OutputError(
            f"{folder / FOLDER}: is no folder, and manifests of runs belong there; write elsewhere with -o"
        )


def read_entries(folder: Place) -> tuple[list[Entry], list[str]]:
    """The rows of all manifests below a folder of tables, and a line for each that cannot be read."""
    entries: list[Entry] = []
    problems = []
    for file in all_files(folder / FOLDER, ".parquet"):
        try:
            entries += read_run(file)
        except UnreadableError as err:
            problems.append(str(err))
    return entries, problems
