"""Logs in a store: an MCAP is read where it lies, everything else from a temporary file of this machine."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import Log, OpenOptions
from lidarcli.logs.registry import HEAD, MCAP, ROS1
from lidarcli.newfiles import scratch_folder
from lidarcli.stores.reading import StoreFile, fetch
from lidarcli.stores.store import PIECE
from lidarcli.stores.url import Url


@contextmanager
def open_stored(url: Url, files: Sequence[Url], opening: OpenOptions | None) -> Iterator[Log]:
    """The open log of an object, or of the `files` that are one log together; nothing of it is left here afterwards.

    Raises
    ------
    UnreadableError
        There is none of this name, the store does not hand it out, or it is no log.
    """
    with ExitStack() as stack:
        log = stack.enter_context(
            _fetched(url, files, opening, stack) if files else _opened(url, opening, stack)
        )
        log.path = str(url)
        yield log


def _opened(url: Url, opening: OpenOptions | None, stack: ExitStack) -> Log:
    """An object that is a log by itself."""
    file = stack.enter_context(StoreFile(url))
    stream = cast(BinaryIO, file)
    head = file.read(HEAD) or b""
    file.seek(0)
    if head.startswith(MCAP):
        from lidarcli.logs.mcap.log import McapLog

        file.keep()
        return McapLog(stream, opening, str(url), file.size)
    if head.startswith(ROS1):
        # Its reader makes a temporary file of a stream, which has no name: nothing is left of it whatever happens.
        from lidarcli.logs.rosbag1.log import Rosbag1Log

        with _named(url, "-"):
            return cast(Log, Rosbag1Log(stream, opening))
    copy = _scratch(stack) / url.name
    with copy.open("wb") as out:
        shutil.copyfileobj(file, out, PIECE)
    with _named(url, str(copy)):
        return open_log(copy, opening=opening)


def _fetched(url: Url, files: Sequence[Url], opening: OpenOptions | None, stack: ExitStack) -> Log:
    """A log of several objects, which are copied to this machine first."""
    folder = _scratch(stack) / "log"
    # The folders below a pattern tell apart files of one name.
    base = _common_folder(files)
    copies = [folder / file.key.removeprefix(base) for file in files]
    for file, copy in zip(files, copies, strict=True):
        copy.parent.mkdir(parents=True, exist_ok=True)
        fetch(file, copy)
    with _named(url, *map(str, [*copies, folder])):
        if all(file.key.startswith(f"{url.key}/") for file in files):
            return open_log(folder, opening=opening)
        from lidarcli.logs.csv.log import CsvLog

        return CsvLog(copies, opening)


def _scratch(stack: ExitStack) -> Path:
    return stack.enter_context(scratch_folder(Path(tempfile.gettempdir())))


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
