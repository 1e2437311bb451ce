"""`open_log`: from a name, or a stream, to the reader of its content."""

from __future__ import annotations

import glob
import io
import os
import select
import stat
import sys
from pathlib import Path
from typing import BinaryIO, cast

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import BINARY_SUFFIXES, Log, OpenOptions
from lidarcli.logs.registry import (
    FORMATS,
    GZIP,
    HEAD,
    MCAP,
    ROS1,
    SQLITE,
    ZSTD,
    Format,
    gunzip_start,
    has_file,
)

PIPE_WAIT_S = 10.0
"""A named pipe that nobody writes to for so long is given up [s]."""

_BINARY = (*MCAP, *ROS1, SQLITE, ZSTD)


def open_log(source: str | Path | BinaryIO, *, opening: OpenOptions | None = None) -> Log:
    """Open a log by its content: a file, a folder, `-` for standard input, or a binary stream.

    A pattern (`sweeps/*.csv`) is one log made of the files that match it. Raises `UnreadableError` with one line where
    there is nothing to read.
    """
    options = opening or OpenOptions()
    if not isinstance(source, str | Path):
        return _open_stream(source, str(getattr(source, "name", "-")), options)
    name = str(source)
    if name == "-":
        return _open_stream(sys.stdin.buffer, name, options)
    path = Path(source)
    try:
        if glob.has_magic(name) and not path.exists():
            return _open_pattern(name, options)
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            return _open_folder(path, name, options)
        if stat.S_ISFIFO(mode):
            pipe = _open_pipe(path, name)
            try:
                return _open_stream(pipe, name, options, owned=True)
            except UnreadableError:
                pipe.close()
                raise
        if not stat.S_ISREG(mode):
            raise UnreadableError(f"{name}: is neither a file nor a folder nor a pipe")
        with path.open("rb") as file:
            head = file.read(HEAD)
    except OSError as err:
        raise UnreadableError(f"{name}: cannot be opened: {err.strerror or err}") from err
    except ValueError as err:
        raise UnreadableError(f"{name!r}: cannot be the name of a file") from err
    return _read_by(_sniffed(head, name), path, options)


def _read_by(known: Format, source: object, options: OpenOptions) -> Log:
    return cast(Log, known.load()(source, options))


def _sniffed(head: bytes, name: str) -> Format:
    if not head:
        raise UnreadableError(f"{name}: is empty")
    if head.startswith(GZIP) and gunzip_start(head).startswith(_BINARY):
        raise UnreadableError(f"{name}: a log packed with gzip; unpack it first (gunzip)")
    for known in FORMATS:
        if known.sniff(head):
            return known
    raise UnreadableError(f"{name}: not a log lidarcli knows; it reads {_known()}")


def _known() -> str:
    return ", ".join(known.name for known in FORMATS)


def _open_folder(path: Path, name: str, options: OpenOptions) -> Log:
    for known in FORMATS:
        if known.sniff_folder(path):
            return _read_by(known, path, options)
    if has_file(path, BINARY_SUFFIXES):
        raise UnreadableError(f"{name}: a folder of several logs; name one of them")
    raise UnreadableError(f"{name}: a folder without a log; lidarcli reads {_known()}")


def _open_pattern(name: str, options: OpenOptions) -> Log:
    files = [Path(match) for match in sorted(glob.glob(name))]  # noqa: PTH207 (absolute patterns too)
    if not files:
        raise UnreadableError(f"{name}: no file matches this pattern")
    kinds = set()
    for file in files:
        with file.open("rb") as stream:
            kinds.add(_sniffed(stream.read(HEAD), str(file)))
    known = kinds.pop()
    if kinds or not known.many:
        raise UnreadableError(
            f"{name}: only files of one sweep each (CSV) make one log; name other logs one by one"
        )
    log = _read_by(known, files, options)
    log.path = name
    return log


def _open_stream(stream: BinaryIO, name: str, options: OpenOptions, owned: bool = False) -> Log:
    """A log from a stream, which the log closes in the end if it is `owned`."""
    try:
        head = _read_start(stream)
    except OSError as err:
        raise UnreadableError(f"{name}: cannot be read: {err.strerror or err}") from err
    known = _sniffed(head, name)
    if not known.streams:
        raise UnreadableError(
            f"{name}: a {known.name} cannot be read from a pipe; give the name of its file instead"
        )
    whole = cast(BinaryIO, io.BufferedReader(_Rejoined(head, stream, owned), 1 << 16))
    try:
        log = _read_by(known, whole, options)
    except UnreadableError as err:
        raise UnreadableError(f"{name}: {str(err).removeprefix('-: ')}") from err
    log.path = name
    return log


def _read_start(stream: BinaryIO) -> bytes:
    head = b""
    while len(head) < HEAD and (piece := stream.read(HEAD - len(head))):
        head += piece
    return head


def _open_pipe(path: Path, name: str) -> BinaryIO:
    """Open a named pipe without waiting forever for somebody to write to it."""
    file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    poll = select.poll()
    poll.register(file, select.POLLIN | select.POLLHUP)
    if not poll.poll(PIPE_WAIT_S * 1000):
        os.close(file)
        raise UnreadableError(f"{name}: nobody has written to this pipe for {PIPE_WAIT_S:g} s")
    os.set_blocking(file, True)
    return os.fdopen(file, "rb", buffering=0)


class _Rejoined(io.RawIOBase):
    """A stream whose first bytes have been read already, put together again."""

    def __init__(self, head: bytes, rest: BinaryIO, owned: bool) -> None:
        super().__init__()
        self._head = head
        self._rest = rest
        self._owned = owned

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        data = self._head[: len(buffer)] if self._head else self._rest.read(len(buffer))
        self._head = self._head[len(data) :]
        buffer[: len(data)] = data
        return len(data)

    def close(self) -> None:
        if self._owned:
            self._rest.close()
        super().close()
