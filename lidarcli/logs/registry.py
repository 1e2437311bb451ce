"""The containers lidarcli reads. A new one is a package in `logs/` and one entry here."""

from __future__ import annotations

import codecs
import zlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from lidarcli.logs.base import BINARY_SUFFIXES, TEXT_SUFFIXES
from lidarcli.logs.beginnings import is_aria, is_carmen, is_json_lines, is_player
from lidarcli.logs.rosbag2.folder import is_bag, is_storage

HEAD = 4096
"""Bytes that a sniffer sees."""

GZIP = b"\x1f\x8b"
ZSTD = b"\x28\xb5\x2f\xfd"
SQLITE = b"SQLite format 3\0"
MCAP = (b"\x89MCAP0\r\n", b"\x89MCAP0\n")
ROS1 = (b"#ROSBAG V", b"#ROSRECORD")

_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True, slots=True)
class Format:
    """One container: what it is called, where its reader is, and how its content is known."""

    name: str
    """For people: `MCAP`, `ROS 1 bag` ..."""
    module: str
    reader: str
    """The class in `module`: a `Log` whose constructor takes a path and `OpenOptions`."""
    sniff: Callable[[bytes], bool]
    """Does a file, or a stream, that begins like this hold it?"""
    sniff_folder: Callable[[Path], bool] = lambda _folder: False
    streams: bool = False
    """Whether the reader also takes a binary stream."""
    many: bool = False
    """Whether the reader also takes a list of files that make one log."""

    def load(self) -> Any:
        """The reader's class; imported only now, so that a log costs the libraries of its own container alone."""
        return getattr(import_module(self.module), self.reader)


def _is_rosbag2(head: bytes) -> bool:
    return head.startswith((SQLITE, ZSTD))


def _is_rosbag2_folder(folder: Path) -> bool:
    """Whether it is one bag: several storage files without metadata and of different names are logs of their own."""
    names = [entry.name for entry in folder.iterdir() if entry.is_file()]
    return is_bag(names) or sum(map(is_storage, names)) == 1


def _is_csv(head: bytes) -> bool:
    if head.startswith(GZIP):
        head = gunzip_start(head)
        return bool(head) and _is_text(head)
    return head.startswith(_UTF16) or _is_text(head)


def _is_text(head: bytes) -> bool:
    """No NUL, hardly a control character, and valid UTF-8 apart from a character cut off at the end."""
    controls = sum(byte < 32 and byte not in b"\t\n\r\f" for byte in head)
    if not head or b"\0" in head or controls > len(head) // 100:
        return False
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as err:
        return err.start >= len(head) - 3 or head.count(b"\n") > 0
    return True


def _text_begins(begins: Callable[[bytes], bool]) -> Callable[[bytes], bool]:
    """The same question of a text that may be packed with gzip, and may be UTF-16."""
    return lambda head: begins(_as_utf8(gunzip_start(head) if head.startswith(GZIP) else head))


def _as_utf8(head: bytes) -> bytes:
    return head.decode("utf-16", "ignore").encode() if head.startswith(_UTF16) else head


def _is_csv_folder(folder: Path) -> bool:
    return has_file(folder, TEXT_SUFFIXES) and not has_file(folder, BINARY_SUFFIXES)


def gunzip_start(head: bytes) -> bytes:
    """What the beginning of a gzip file decompresses to; empty where it is broken."""
    try:
        return zlib.decompressobj(wbits=31).decompress(head, HEAD)
    except zlib.error:
        return b""


def has_file(folder: Path, endings: Iterable[str]) -> bool:
    """Whether a folder itself holds a file whose name ends so, in any case."""
    return any(entry.name.lower().endswith(tuple(endings)) and entry.is_file() for entry in folder.iterdir())


FORMATS: tuple[Format, ...] = (
    Format(
        "MCAP",
        "lidarcli.logs.mcap.log",
        "McapLog",
        lambda head: head.startswith(MCAP),
        streams=True,
    ),
    Format(
        "ROS 1 bag",
        "lidarcli.logs.rosbag1.log",
        "Rosbag1Log",
        lambda head: head.startswith(ROS1),
        streams=True,
    ),
    Format(
        "ROS 2 bag (folder, .db3, compressed)",
        "lidarcli.logs.rosbag2.log",
        "Rosbag2Log",
        _is_rosbag2,
        _is_rosbag2_folder,
    ),
    Format(
        "CARMEN log (also .gz)",
        "lidarcli.logs.carmen.log",
        "CarmenLog",
        _text_begins(is_carmen),
        streams=True,
    ),
    Format(
        "ARIA log (.2d, also .gz)",
        "lidarcli.logs.aria.log",
        "AriaLog",
        _text_begins(is_aria),
        streams=True,
    ),
    Format(
        "Player log (also .gz)",
        "lidarcli.logs.player.log",
        "PlayerLog",
        _text_begins(is_player),
        streams=True,
    ),
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
"""In the order in which they are asked."""
