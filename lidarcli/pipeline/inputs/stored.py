"""Logs in a store: an MCAP is read where it lies, everything else from a temporary file of this machine."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import CsvOptions, Log
from lidarcli.logs.registry import HEAD, MCAP, ROS1
from lidarcli.newfiles import scratch_folder
from lidarcli.stores.reading import StoreFile
from lidarcli.stores.store import fetch, read_object
from lidarcli.stores.url import Url


@contextmanager
def open_stored(url: Url, files: Sequence[Url], csv: CsvOptions | None) -> Iterator[Log]:
    """The open log of an object, or of the `files` that are one log together; nothing of it is left here afterwards.

    Raises
    ------
    UnreadableError
        There is none of this name, the store does not hand it out, or it is no log.
    """
    with ExitStack() as stack:
        log = stack.enter_context(_fetched(url, files, csv, stack) if files else _opened(url, csv, stack))
        log.path = str(url)
        yield log


def _opened(url: Url, csv: CsvOptions | None, stack: ExitStack) -> Log:
    """An object that is a log by itself."""
    head = read_object(url, HEAD)
    if head.startswith(MCAP):
        from lidarcli.logs.mcap.log import McapLog

        file = stack.enter_context(StoreFile(url))
        return McapLog(cast(BinaryIO, file), str(url), file.size)
    if head.startswith(ROS1):
        # Its reader makes a temporary file of a stream, which has no name: nothing is left of it whatever happens.
        from lidarcli.logs.rosbag1.log import Rosbag1Log

        with _named(url, "-"), StoreFile(url, keep=False) as stream:
            return cast(Log, Rosbag1Log(cast(BinaryIO, stream)))
    return _fetched(url, [url], csv, stack)


def _fetched(url: Url, files: Sequence[Url], csv: CsvOptions | None, stack: ExitStack) -> Log:
    """A log whose files are copied to this machine first."""
    scratch = stack.enter_context(scratch_folder(Path(tempfile.gettempdir())))
    # The folders below a pattern tell apart files of one name.
    base = "" if files == [url] else _common_folder(files)
    copies = [scratch / "log" / file.key.removeprefix(base).strip("/") for file in files]
    if files == [url]:
        copies = [scratch / url.name]
    for file, copy in zip(files, copies, strict=True):
        copy.parent.mkdir(parents=True, exist_ok=True)
        fetch(file, copy)
    with _named(url, *map(str, [*copies, scratch / "log"])):
        if files == [url]:
            return open_log(copies[0], csv=csv)
        if url.has_magic():
            from lidarcli.logs.csv.log import CsvLog

            return CsvLog(copies, csv)
        return open_log(scratch / "log", csv=csv)


def _common_folder(files: Sequence[Url]) -> str:
    """What the names of all files begin with, up to a slash."""
    folders = [file.key.split("/")[:-1] for file in files]
    shared = []
    for parts in zip(*folders, strict=False):
        if len(set(parts)) > 1:
            break
        shared.append(parts[0])
    return "".join(f"{part}/" for part in shared)


@contextmanager
def _named(url: Url, *names: str) -> Iterator[None]:
    """Put the name of the object where errors name the copy of it."""
    try:
        yield
    except UnreadableError as err:
        words = str(err)
        for name in names:
            words = words.replace(f"{name}: ", f"{url}: ", 1) if words.startswith(f"{name}: ") else words
        raise UnreadableError(words) from err
