"""What logs and tables are without being read: their sizes and times, and which tables are there."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from lidarcli.errors import LidarcliError, OutputError, UnreadableError
from lidarcli.pipeline.inputs.files import all_files
from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.stores.url import Place, State, Url, absolute, place
from lidarcli.tabular.runs import Entry

ASKED_AT_ONCE = 16
"""Requests for what a store knows of an object: each takes tens of milliseconds."""
_DAY = re.compile(r"/date=[^/]*/")

Sources = Sequence[Source | Nothing]


def known(sources: Sources) -> list[Source | Nothing]:
    """The same inputs with their states before anything is read: what a log becomes meanwhile is another log."""
    asked = [source for source in sources if isinstance(source, Source) and source.found is None]
    with ThreadPoolExecutor(ASKED_AT_ONCE, "ask") as pool:
        found = dict(zip(asked, pool.map(_known, asked), strict=True))
    return [found.get(source, source) if isinstance(source, Source) else source for source in sources]


def _known(source: Source) -> Source:
    try:
        return replace(source, found=state_of(source.path) if source.url is not None else source.state())
    except LidarcliError:
        # Reading it says what is wrong.
        return source


def state_of(name: str) -> State | None:
    """What is known of a file; None where there is none."""
    where = place(name)
    if isinstance(where, Url):
        from lidarcli.stores.store import head

        return head(where)
    return Source(name, "").state()


def read_file(name: str) -> bytes:
    """A file as a whole; `UnreadableError` where it cannot be read."""
    where = place(name)
    if isinstance(where, Url):
        from lidarcli.stores.store import read_object

        return read_object(where)
    try:
        return where.read_bytes()
    except OSError as err:
        raise UnreadableError(f"{name}: cannot be read: {err.strerror or err}") from err


def remove_file(name: str) -> None:
    """Remove a file; `OutputError` where it cannot be removed."""
    where = place(name)
    if isinstance(where, Url):
        from lidarcli.stores.store import remove

        remove(where)
        return
    try:
        where.unlink()
    except OSError as err:
        raise OutputError(f"cannot remove {name}: {err.strerror or err}") from err


def is_unchanged(source: Source, done: Entry) -> bool:
    """Whether a log is what it was: of the same size, and of the same time or the same mark of its content."""
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
    """Which files are there; of a store all names below the folder are asked for at once."""

    def __init__(self, folder: Place) -> None:
        self._states: dict[str, State] | None = None
        self._dated: dict[str, str] = {}
        if isinstance(folder, Url):
            from lidarcli.stores.store import listing

            self._states = {str(url): state for url, state in listing(folder)}
            self._dated = {_DAY.sub("/", name): name for name in self._states}

    def __call__(self, name: str) -> bool:
        """Whether there is a file of this name."""
        return name in self._states if self._states is not None else os.path.exists(name)  # noqa: PTH110 (never raises)

    def state(self, name: str) -> State | None:
        """What is known of a file; None where there is none of this name."""
        return state_of(name) if self._states is None else self._states.get(name)

    def of_any_day(self, path: Place, log: str) -> list[str]:
        """Files of a log below the folder of a table, whichever the day is that they are filed under."""
        if isinstance(path, Url):
            name = self._dated.get(absolute(path / f"{log}.parquet"))
            return [name] if name is not None else []
        days = all_files(path, "")
        return [
            *filter(self, (absolute(day / f"{log}.parquet") for day in days if day.name.startswith("date=")))
        ]
