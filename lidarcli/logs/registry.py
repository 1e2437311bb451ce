"""The containers that lidarcli reads, and `open_log`, which finds the reader of a log by its content.

A new container is a package or a module in `logs/` and one entry in `FORMATS`.
"""

from __future__ import annotations

import codecs
import glob
import io
import os
import select
import stat
import sys
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, cast

from lidarcli.errors import UnreadableError, unreadable
from lidarcli.logs.base import BINARY_SUFFIXES, TEXT_SUFFIXES, Log, OpenOptions
from lidarcli.logs.rosbag2 import is_bag, is_storage
from lidarcli.logs.text import is_carmen, is_json_lines

HEAD = 4096
"""Number of bytes that a format is recognised by."""

GZIP = b"\x1f\x8b"
ZSTD = b"\x28\xb5\x2f\xfd"
SQLITE = b"SQLite format 3\0"
MCAP = (b"\x89MCAP0\r\n", b"\x89MCAP0\n")
ROS1 = (b"#ROSBAG V", b"#ROSRECORD")

_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True, slots=True)
class Format:
    """A container format: its name, its reader, and how its content is recognised."""

    name: str
    """Name for people: `MCAP`, `ROS 1 bag` ..."""
    module: str
    reader: str
    """The class in `module`: a `Log` whose constructor takes a path and `OpenOptions`."""
    sniff: Callable[[bytes], bool]
    """Recognises the format by the first bytes of a file or stream."""
    sniff_folder: Callable[[Path], bool] = lambda _folder: False
    streams: bool = False
    """True if the reader accepts a binary stream."""
    many: bool = False
    """True if the reader accepts a list of files that make one log."""

    def load(self) -> Any:
        """Return the reader's class; imported only now, so that a log costs the libraries of its own container alone."""
        return getattr(import_module(self.module), self.reader)


def _is_rosbag2(head: bytes) -> bool:
    return head.startswith((SQLITE, ZSTD))


def _is_rosbag2_folder(folder: Path) -> bool:
    """Return True for the folder of one bag; storage files of different names without metadata are separate logs."""
    names = [entry.name for entry in folder.iterdir() if entry.is_file()]
    return is_bag(names) or sum(map(is_storage, names)) == 1


def _is_csv(head: bytes) -> bool:
    if head.startswith(GZIP):
        head = gunzip_start(head)
        return bool(head) and _is_text(head)
    return head.startswith(_UTF16) or _is_text(head)


def _is_text(head: bytes) -> bool:
    """Return True for text: no NUL, hardly a control character, valid UTF-8 up to a cut at the end."""
    controls = sum(byte < 32 and byte not in b"\t\n\r\f" for byte in head)
    if not head or b"\0" in head or controls > len(head) // 100:
        return False
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as err:
        return err.start >= len(head) - 3 or head.count(b"\n") > 0
    return True


def _text_begins(begins: Callable[[bytes], bool]) -> Callable[[bytes], bool]:
    """Wrap a test of text so that it applies to gzip and UTF-16 as well."""
    return lambda head: begins(_as_utf8(gunzip_start(head) if head.startswith(GZIP) else head))


def _as_utf8(head: bytes) -> bytes:
    return head.decode("utf-16", "ignore").encode() if head.startswith(_UTF16) else head


def _is_csv_folder(folder: Path) -> bool:
    return has_file(folder, TEXT_SUFFIXES) and not has_file(folder, BINARY_SUFFIXES)


def gunzip_start(head: bytes) -> bytes:
    """Decompress the beginning of a gzip file; empty if it is broken."""
    try:
        return zlib.decompressobj(wbits=31).decompress(head, HEAD)
    except zlib.error:
        return b""


def has_file(folder: Path, endings: Iterable[str]) -> bool:
    """Return True if a folder directly holds a file with one of these endings, in any case."""
    return any(entry.name.lower().endswith(tuple(endings)) and entry.is_file() for entry in folder.iterdir())


FORMATS: tuple[Format, ...] = (
    Format("MCAP", "lidarcli.logs.mcap", "McapLog", lambda head: head.startswith(MCAP), streams=True),
    Format("ROS 1 bag", "lidarcli.logs.rosbag1", "Rosbag1Log", lambda head: head.startswith(ROS1), streams=True),
    Format("ROS 2 bag (folder, .db3, compressed)", "lidarcli.logs.rosbag2", "Rosbag2Log", _is_rosbag2, _is_rosbag2_folder),
    Format("CARMEN log (also .gz)", "lidarcli.logs.carmen", "CarmenLog", _text_begins(is_carmen), streams=True),
    Format(
        "JSON lines of `mcap cat` (also .gz)",
        "lidarcli.logs.jsonlines",
        "JsonLinesLog",
        _text_begins(is_json_lines),
        streams=True,
    ),
    Format(
        "CSV (also .gz, or a folder of one file per sweep)",
        "lidarcli.logs.csv.log",
        "CsvLog",
        _is_csv,
        _is_csv_folder,
        streams=True,
        many=True,
    ),
)
"""Formats in the order in which they are tried."""


PIPE_WAIT_S = 10.0
"""Longest wait for a writer of a named pipe [s]."""

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
        raise UnreadableError(f"{name}: only files of one sweep each (CSV) make one log; name other logs one by one")
    log = _read_by(known, files, options)
    log.path = name
    return log


def _open_stream(stream: BinaryIO, name: str, options: OpenOptions, owned: bool = False) -> Log:
    """Open a log from a stream; the log closes the stream in the end if it is `owned`."""
    with unreadable(name):
        head = _read_start(stream)
    known = _sniffed(head, name)
    if not known.streams:
        raise UnreadableError(f"{name}: a {known.name} cannot be read from a pipe; give the name of its file instead")
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
