"""The files of SQLite byte by byte: sidecars as a killed writer leaves them, and b-trees made by hand.

The layouts are those of sqlite.org/fileformat2.html.
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
SALT = b"lidarcli"
NONCE = 20_260_101
SECTOR = 512
LOCK_BYTE = 0x40000000
"""Where SQLite locks a database: the page there is never used, and its number marks a super-journal's name."""

Insert = Sequence[tuple[Any, ...]]


def live_wal(path: Path, statement: str, rows: Insert) -> None:
    """Rows in a -wal that nobody has merged yet, as while a recorder runs."""
    writer = sqlite3.connect(path, isolation_level=None)
    writer.execute("PRAGMA journal_mode = wal").fetchall()
    writer.execute("PRAGMA wal_autocheckpoint = 0").fetchall()
    for row in rows:
        writer.execute(statement, row)
    _taken(path, "-wal", writer.close)
    wal = Path(f"{path}-wal")
    wal.write_bytes(salted(wal.read_bytes()))


def journal_of_killed_writer(path: Path, first: str, statement: str, rows: Insert) -> None:
    """A database in the middle of a transaction, with the -journal that takes it back.

    `first` changes what is there, so many rows follow that the changed pages have to leave the cache.
    """
    writer = sqlite3.connect(path, isolation_level=None)
    # So small a cache spills: pages that are not committed are in the file already.
    for pragma in ("journal_mode = delete", "cache_size = 2", "cache_spill = 1"):
        writer.execute(f"PRAGMA {pragma}").fetchall()
    writer.execute("BEGIN")
    writer.execute(first)
    for row in rows:
        writer.execute(statement, row)

    def end() -> None:
        writer.rollback()
        writer.close()

    _taken(path, "-journal", end)
    journal = Path(f"{path}-journal")
    journal.write_bytes(with_nonce(journal.read_bytes()))


def _taken(path: Path, suffix: str, end: Callable[[], None]) -> None:
    """Leave database and sidecar as they are before `end`, which is what a killed writer does."""
    names = [path, Path(f"{path}{suffix}")]
    kept = [name.read_bytes() for name in names]
    end()
    for name, data in zip(names, kept, strict=True):
        name.write_bytes(data)
    shm = Path(f"{path}-shm")
    if shm.exists():
        shm.unlink()


def salted(wal: bytes) -> bytes:
    """The same -wal with `SALT` in place of SQLite's random one, so that the same case has the same bytes."""
    order = "<" if wal[3] == 0x82 else ">"
    page = int.from_bytes(wal[8:12], "big")
    head = wal[:16] + SALT
    state = _wal_sum(head, (0, 0), order)
    out = [head, struct.pack(">II", *state)]
    for at in range(32, len(wal) - 24 - page + 1, 24 + page):
        start, content = wal[at : at + 8], wal[at + 24 : at + 24 + page]
        state = _wal_sum(content, _wal_sum(start, state, order), order)
        out += [start, SALT, struct.pack(">II", *state), content]
    return b"".join(out)


def _wal_sum(data: bytes, state: tuple[int, int], order: str) -> tuple[int, int]:
    one, two = state
    numbers = struct.unpack(f"{order}{len(data) // 4}I", data)
    for first, second in zip(numbers[::2], numbers[1::2], strict=True):
        one = (one + first + two) & 0xFFFFFFFF
        two = (two + second + one) & 0xFFFFFFFF
    return one, two


def with_nonce(journal: bytes) -> bytes:
    """The same -journal with `NONCE` in place of SQLite's random one; a writer that was killed left the count open."""
    page = int.from_bytes(journal[24:28], "big")
    sector = int.from_bytes(journal[20:24], "big")
    # -1: as many pages as the file has; SQLite writes the number only when it syncs.
    out = [JOURNAL_MAGIC, struct.pack(">iIIII", -1, NONCE, *struct.unpack(">III", journal[16:28]))]
    out.append(bytes(sector - 28))
    at = sector
    while at + 8 + page <= len(journal):
        # At each sync a header of its own follows, which starts a sector: one for all is enough.
        if journal[at : at + 8] == JOURNAL_MAGIC:
            at += sector
            continue
        number, content = journal[at : at + 4], journal[at + 4 : at + 4 + page]
        if not 0 < int.from_bytes(number, "big") < 1 << 20:
            at += sector - at % sector
            continue
        out += [number, content, struct.pack(">I", page_sum(content))]
        at += 8 + page
    return b"".join(out)


def page_sum(content: bytes) -> int:
    """The checksum of a page in a -journal: every 200th byte from its end, and the nonce."""
    return (NONCE + sum(content[at] for at in range(len(content) - 200, 0, -200))) & 0xFFFFFFFF


def journal_naming(database: bytes, name: bytes, lies: int = 0) -> bytes:
    """A hot -journal of page 1 that names a super-journal, which SQLite deletes when it has rolled back.

    `lies` is added to the name's checksum.
    """
    page = page_size(database)
    content = database[:page]
    head = JOURNAL_MAGIC + struct.pack(">IIIII", 1, NONCE, len(database) // page, SECTOR, page)
    record = struct.pack(">I", 1) + content + struct.pack(">I", page_sum(content))
    total = (sum(name) + lies) & 0xFFFFFFFF
    tail = struct.pack(">I", LOCK_BYTE // page + 1) + name + struct.pack(">II", len(name), total)
    return head.ljust(SECTOR, b"\0") + record + tail + JOURNAL_MAGIC


def page_size(database: bytes) -> int:
    """Bytes of a page by the header of the file."""
    size = int.from_bytes(database[16:18], "big")
    return 65536 if size == 1 else size


def varint(number: int) -> bytes:
    """A number as SQLite writes it: seven bits a byte, the last of nine has eight."""
    number &= (1 << 64) - 1
    if number >= 1 << 56:
        return varint_bits(number >> 8, 8) + bytes([number & 255])
    many = max(1, -(-number.bit_length() // 7))
    bits = varint_bits(number, many)
    return bits[:-1] + bytes([bits[-1] & 127])


def varint_bits(number: int, many: int) -> bytes:
    """`many` groups of seven bits, each marked as followed by another."""
    return bytes(128 | (number >> 7 * place & 127) for place in reversed(range(many)))


def record(*values: int | bytes) -> bytes:
    """A row: integers of eight bytes and blobs."""
    serials = b"".join(varint(6 if isinstance(value, int) else 12 + 2 * len(value)) for value in values)
    body = b"".join(struct.pack(">q", value) if isinstance(value, int) else value for value in values)
    return varint(len(serials) + 1) + serials + body


def cell(rowid: int, payload: bytes, claimed: int | None = None, overflow: int | None = None) -> bytes:
    """A row in a leaf; `claimed` is the length it says it has, `overflow` the page where the rest is said to be."""
    more = b"" if overflow is None else struct.pack(">I", overflow)
    return varint(len(payload) if claimed is None else claimed) + varint(rowid) + payload + more


def leaf(cells: Iterable[bytes], page: int) -> bytes:
    """A leaf page of a table."""
    return _node(b"", 0x0D, list(cells), page)


def interior(children: Sequence[tuple[int, int]], page: int) -> bytes:
    """An inner page of a table, of (page number, greatest row id) of its children."""
    cells = [struct.pack(">I", child) + varint(rowid) for child, rowid in children[:-1]]
    return _node(struct.pack(">I", children[-1][0]), 0x05, cells, page)


def _node(right: bytes, kind: int, cells: list[bytes], page: int) -> bytes:
    places, at = [], page
    for one in cells:
        at -= len(one)
        places.append(at)
    head = struct.pack(">BHHHB", kind, 0, len(cells), at % 65536, 0) + right
    pointers = b"".join(struct.pack(">H", place) for place in places)
    gap = at - len(head) - len(pointers)
    if gap < 0:
        raise ValueError("the cells need more than a page")
    return head + pointers + bytes(gap) + b"".join(reversed(cells))


def root_of(path: Path, table: str) -> int:
    """The page at which a table begins."""
    connection = sqlite3.connect(path)
    try:
        (root,) = connection.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (table,)).fetchone()
        return int(root)
    finally:
        connection.close()


def with_pages(path: Path, pages: dict[int, bytes]) -> None:
    """Replace and append pages, and let the header tell how many there are."""
    data = bytearray(path.read_bytes())
    size = page_size(bytes(data[:100]))
    for number, content in pages.items():
        data.extend(bytes(max(0, number * size - len(data))))
        data[(number - 1) * size : number * size] = content.ljust(size, b"\0")
    data[28:32] = struct.pack(">I", len(data) // size)
    data[92:96] = data[24:28]
    path.write_bytes(data)
