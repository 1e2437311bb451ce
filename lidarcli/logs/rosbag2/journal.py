"""What stands beside a SQLite file when its writer was killed, brought into a copy of it.

The rollback journal is applied here and not by SQLite: SQLite then also deletes the file that the journal names as its
super-journal, wherever that is (the formats are public: https://www.sqlite.org/fileformat2.html).
"""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import BinaryIO, NamedTuple

MAGIC = bytes.fromhex("d9d505f920a163d7")
JOURNAL, WAL = "-journal", "-wal"
"""What the names of the two files end with."""

_HEAD = struct.Struct(">8s5I")
_NUMBER = struct.Struct(">I")
_TO_THE_END = 0xFFFFFFFF
"""As the number of records: as many as there are."""
_LOCKED_BYTE = 1 << 30
"""The page that holds this byte is never in a journal."""
_SUMMED = 200
"""Every 200th byte of a page is in its checksum, from its end on."""


class _Head(NamedTuple):
    """The head of one part of a journal."""

    records: int
    nonce: int
    pages: int
    """Pages of the database before the transaction."""
    sector: int
    """Bytes of the head with its padding."""
    page: int
    """Bytes of a page."""


def merge(database: Path, source: Path) -> None:
    """Bring the files beside `source` into its copy `database`, which nothing stands beside afterwards.

    Raises
    ------
    OSError, sqlite3.Error
        They cannot be read, or the copy cannot be written.
    """
    if is_needed(source, JOURNAL):
        roll_back(database, Path(f"{source}{JOURNAL}"))
    if is_needed(source, WAL):
        beside = Path(f"{database}{WAL}")
        shutil.copyfile(f"{source}{WAL}", beside)
        # Its frames hold pages and no names of files: what SQLite writes stays beside the copy.
        with closing(sqlite3.connect(database, isolation_level=None)) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        beside.unlink(missing_ok=True)


def is_needed(database: Path, suffix: str) -> bool:
    """Whether the file of this kind beside a database may hold a part of it."""
    beside = Path(f"{database}{suffix}")
    return beside.is_file() and beside.stat().st_size > 0


def roll_back(database: Path, journal: Path) -> None:
    """Put the pages back that a transaction had changed before it was broken off, as far as their checksums hold."""
    with journal.open("rb") as pages, database.open("r+b") as target:
        first = _head(pages, 0)
        if first is None:
            return
        most = pages.seek(0, 2) + target.seek(0, 2)
        restored: set[int] = set()
        for number, page in _pages(pages, first):
            end = number * first.page
            if number not in restored and end <= most:
                restored.add(number)
                target.seek(end - first.page)
                target.write(page)
        if target.seek(0, 2) > first.pages * first.page:
            target.truncate(first.pages * first.page)


def _pages(journal: BinaryIO, first: _Head) -> Iterator[tuple[int, bytes]]:
    """Number and content of each page that a journal holds, up to the first record that was not written whole."""
    size, place, head = journal.seek(0, 2), 0, _head(journal, 0)
    record = first.page + 2 * _NUMBER.size
    while head is not None:
        place += first.sector
        left = (size - place) // record
        count = left if head.records == _TO_THE_END else head.records
        for _ in range(min(count, left)):
            number, page = _record(journal, place, first.page, head.nonce)
            if not number:
                return
            if number <= head.pages:
                yield number, page
            place += record
        if count > left:
            return
        place = -(-place // first.sector) * first.sector
        head = _head(journal, place)


def _head(journal: BinaryIO, place: int) -> _Head | None:
    """The head at a byte of the journal; None where there is none: the journal ends, or was never in force."""
    journal.seek(place)
    data = journal.read(_HEAD.size)
    if len(data) < _HEAD.size or not data.startswith(MAGIC):
        return None
    head = _Head(*_HEAD.unpack(data)[1:])
    sizes = (head.sector, 32), (head.page, 512)
    sound = all(least <= size <= 1 << 16 and size & (size - 1) == 0 for size, least in sizes)
    return head if sound and (place or head.pages) else None


def _record(journal: BinaryIO, place: int, size: int, nonce: int) -> tuple[int, bytes]:
    """Number and content of the page of a record; 0 where the record was not written whole."""
    journal.seek(place)
    data = journal.read(size + 2 * _NUMBER.size)
    number = _NUMBER.unpack_from(data)[0]
    page = data[_NUMBER.size : _NUMBER.size + size]
    checksum = nonce + sum(page[at] for at in range(size - _SUMMED, 0, -_SUMMED))
    held = checksum & 0xFFFFFFFF == _NUMBER.unpack_from(data, _NUMBER.size + size)[0]
    return (number if held and number != _LOCKED_BYTE // size + 1 else 0), page
