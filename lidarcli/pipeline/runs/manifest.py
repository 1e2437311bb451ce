"""The manifest of a run: one Parquet file per run beside the tables, with a row for each log; and the states of files.

Every run has a file of its own, so that runs at the same time cannot spoil each other's; the newest row of a log counts.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.errors import LidarcliError, OutputError, UnreadableError
from lidarcli.newfiles import write_whole
from lidarcli.pipeline.inputs.files import all_files
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.stores.url import Place, State, Url, absolute, place
from lidarcli.tabular.runs import Entry, read_run, run_rows
from lidarcli.tabular.schemas import RUNS

ASKED_AT_ONCE = 16
"""Requests for the state of an object at a time: each takes tens of milliseconds."""
_DAY = re.compile(r"/date=[^/]*/")

Sources = Sequence[Source | MissingInput]


def known(sources: Sources) -> list[Source | MissingInput]:
    """Return the inputs with their states before anything is read: a log that changes meanwhile is another log."""
    asked = [source for source in sources if isinstance(source, Source) and source.found is None]
    with ThreadPoolExecutor(ASKED_AT_ONCE, "ask") as pool:
        found = dict(zip(asked, pool.map(_known, asked), strict=True))
    return [found.get(source, source) if isinstance(source, Source) else source for source in sources]


def _known(source: Source) -> Source:
    if source.parts:
        source = replace(source, parts=tuple(map(_known, source.parts)))
        return replace(source, found=source.state())
    try:
        return replace(source, found=state_of(source.path) if source.url is not None else source.state())
    except LidarcliError:
        # Reading it raises the error.
        return source


def state_of(name: str) -> State | None:
    """Return size and time of a file; None where there is none."""
    where = place(name)
    if isinstance(where, Url):
        from lidarcli.stores.url import head

        return head(where)
    return Source(name, "").state()


def remove_file(name: str) -> None:
    """Remove a file; `OutputError` where it cannot be removed."""
    where = place(name)
    if isinstance(where, Url):
        from lidarcli.stores.url import remove

        remove(where)
        return
    try:
        where.unlink()
    except OSError as err:
        raise OutputError(f"cannot remove {name}: {err.strerror or err}") from err


def is_unchanged(source: Source, done: Entry) -> bool:
    """Tell whether a log has not changed: the same size, and the same time or the same mark of its content."""
    state = source.state()
    if state is None or state.size != done.size:
        return False
    if state.mtime_ns == done.mtime:
        return True
    if not done.etag or source.url is None or source.files:
        return False
    # A listing does not tell it.
    now = state if state.etag else state_of(source.path)
    return now is not None and now.etag == done.etag


class There:
    """Files that are there; of a store all names below the folder are listed at once."""

    def __init__(self, folder: Place) -> None:
        self._states: dict[str, State] | None = None
        self._dated: dict[str, str] = {}
        if isinstance(folder, Url):
            from lidarcli.stores.url import listing

            self._states = {str(url): state for url, state in listing(folder)}
            self._dated = {_DAY.sub("/", name): name for name in self._states}

    def __call__(self, name: str) -> bool:
        """Tell whether there is a file of this name."""
        return name in self._states if self._states is not None else os.path.exists(name)  # noqa: PTH110 (never raises)

    def state(self, name: str) -> State | None:
        """Return size and time of a file; None where there is none of this name."""
        return state_of(name) if self._states is None else self._states.get(name)

    def of_any_day(self, path: Place, log: str) -> list[str]:
        """Return the files of a log below the folder of a table, of whatever day."""
        if isinstance(path, Url):
            name = self._dated.get(absolute(path / f"{log}.parquet"))
            return [name] if name is not None else []
        days = all_files(path, "")
        return [*filter(self, (absolute(day / f"{log}.parquet") for day in days if day.name.startswith("date=")))]


FOLDER = "_lidarcli"
"""Folder of the manifests: readers of folders of tables skip names that begin with an underscore."""
PACKED = 250
"""Most entries that are kept as objects: as columns they take a tenth of the memory."""
EVERY_S = 30.0
"""Time between writes of the manifest while a run goes on [s], in case the run is killed."""
SHARE = 0.05
"""Greatest share of the time that these writes take."""


class Manifest:
    """The manifest of a run that goes on: written anew now and then, and when it is closed."""

    def __init__(self, folder: Place) -> None:
        now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%f")[:-3]
        self.path: Place = folder / FOLDER / f"run-{now}Z-{os.urandom(4).hex()}.parquet"
        self._batches: list[pa.RecordBatch] = []
        self._entries: list[Entry] = []
        self._due = time.monotonic() + EVERY_S

    def add(self, entry: Entry) -> None:
        """Add the entry of one log."""
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
        """Write all entries so far; no file without any."""
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
        from lidarcli.stores.url import has_bucket

        try:
            there = has_bucket(folder)
        except UnreadableError as err:
            raise OutputError(f"cannot write {err}") from err
        if not there:
            raise OutputError(f"cannot write {folder}: there is no such bucket")
    elif os.path.lexists(folder / FOLDER) and not os.path.isdir(folder / FOLDER):  # noqa: PTH112 (never raises)
        raise OutputError(f"{folder / FOLDER}: is no folder, and manifests of runs belong there; write elsewhere with -o")


def read_entries(folder: Place) -> tuple[list[Entry], list[str]]:
    """Read the entries of all manifests below a folder of tables; also a line for each that cannot be read."""
    entries: list[Entry] = []
    problems = []
    for file in all_files(folder / FOLDER, ".parquet"):
        try:
            entries += read_run(file)
        except UnreadableError as err:
            problems.append(str(err))
    return entries, problems
