"""Rows of a SQLite file that SQLite itself refuses: truncated, or with broken pages.

The file's table leaf pages are read one by one, wherever they stand, without following the tree above them
(the file format is public: https://www.sqlite.org/fileformat2.html). Tables are recognised by the shape of their rows.
"""

from __future__ import annotations

from array import array
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import BinaryIO, NamedTuple

import numpy as np

from lidarcli.logs.base import LASERSCAN, MAX_MESSAGE, ReadReport
from lidarcli.logs.laserscan import decode_blocks

MAGIC = b"SQLite format 3\0"
LEAF = 0x0D
HEADER = 100
"""Bytes of the file header, which stands before the first page's own."""
PIECE = 4 << 20
"""Bytes read at a time while looking for rows."""

BEFORE_ALL = -(1 << 63) - 1
"""A row id below all others."""

_INT_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8, 8: 0, 9: 0}
"""Serial types of integers → bytes; 8 and 9 are the constants 0 and 1."""


class TopicRow(NamedTuple):
    """A row of the topics table."""

    id: int
    name: str
    type: str
    encoding: str


class MessageRow(NamedTuple):
    """A row of the messages table."""

    id: int
    topic_id: int
    timestamp: int
    data: bytes


class _Cell(NamedTuple):
    """A row as its leaf page holds it."""

    rowid: int
    size: int
    """Bytes of the whole row."""
    start: int
    """Start of the row in its page, which holds `local` bytes of it."""
    local: int
    overflow: int
    """First page of the rest; 0 without one."""


@dataclass(slots=True)
class RecoveredPages:
    """Contents of the leaf pages of a file: places of messages, and topics."""

    topics: dict[int, TopicRow] = field(default_factory=dict)
    rowids: array[int] = field(default_factory=lambda: array("q"))
    topic_ids: array[int] = field(default_factory=lambda: array("q"))
    places: array[int] = field(default_factory=lambda: array("q"))
    """Byte position of each message's cell in the file."""

    def order(self) -> list[int]:
        """Return indices of the messages by row id, each id once."""
        _, first = np.unique(np.array(self.rowids, np.int64), return_index=True)
        return [int(index) for index in first]

    @property
    def missing(self) -> int:
        """Number of row ids missing between the first message (row 1) and the last one found."""
        ids = np.unique(np.array(self.rowids, np.int64))
        ids = ids[ids > 0]
        return max(0, int(ids[-1]) - len(ids)) if len(ids) and ids[-1] < 1 << 40 else 0


class Salvage:
    """Reads rows of a ROS 2 bag's tables straight from the pages of the file."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._size = file.seek(0, 2)
        self._page, self._usable = self._page_size()
        self._wasted = 0
        """Bytes of chains that came to nothing: pages may lead to one another for ever."""

    def find(self) -> RecoveredPages:
        """Go through all pages once."""
        found = RecoveredPages()
        whole = PIECE // self._page * self._page
        for base in range(0, self._size, whole):
            piece = self._at(base, whole)
            firsts = np.frombuffer(piece, np.uint8)[:: self._page]
            starts = (np.flatnonzero(firsts == LEAF) * self._page).tolist()
            if base == 0 and piece[HEADER : HEADER + 1] == bytes([LEAF]):
                starts.insert(0, 0)
            for start in starts:
                self._leaf(piece[start : start + self._page], base + start, found)
        return found

    def messages(self, found: RecoveredPages, topics: Collection[int], after: int) -> Iterator[MessageRow | int]:
        """Yield messages of the topics with a row id above `after`, in order; the id alone where one is not whole.

        No byte of a sound file stands in two messages: once they are longer than the file, none is believed.
        """
        left = self._size
        for index in found.order():
            rowid = found.rowids[index]
            if rowid <= after or found.topic_ids[index] not in topics:
                continue
            row = self._message(found.places[index]) if left > 0 and self._wasted <= self._size else None
            left -= len(row.data) if row is not None else 0
            yield row or rowid

    def _page_size(self) -> tuple[int, int]:
        """Return page size and its usable part; 4096, which ROS writes, where the header is broken."""
        head = self._at(0, HEADER)
        size = int.from_bytes(head[16:18], "big")
        size = 65536 if size == 1 else size
        if len(head) < HEADER or not head.startswith(MAGIC) or size < 512 or size & (size - 1):
            return 4096, 4096
        return size, size - head[20]

    def _at(self, at: int, size: int) -> bytes:
        self._file.seek(at)
        return self._file.read(max(0, size))

    def _leaf(self, page: bytes, base: int, found: RecoveredPages) -> None:
        """Note the rows of one leaf page; what is no row is left out."""
        at = HEADER if base == 0 else 0
        count = int.from_bytes(page[at + 3 : at + 5], "big")
        pointers = page[at + 8 : at + 8 + 2 * count]
        for index in range(0, len(pointers) - 1, 2):
            place = int.from_bytes(pointers[index : index + 2], "big")
            cell = self._cell(page, place) if at + 8 <= place < len(page) else None
            if cell is not None:
                self._row(page, cell, base + place, found)

    def _cell(self, page: bytes, at: int) -> _Cell | None:
        """Return the cell at a position of a page, None where it cannot be one."""
        size, at = _varint(page, at)
        rowid, at = _varint(page, at)
        rowid = rowid - (1 << 64) if rowid >> 63 else rowid
        most = self._usable - 35
        local = size
        if size > most:
            least = (self._usable - 12) * 32 // 255 - 23
            local = least + (size - least) % (self._usable - 4)
            local = local if local <= most else least
        end = at + local
        if at < 0 or end + (4 if size > local else 0) > len(page):
            return None
        overflow = int.from_bytes(page[end : end + 4], "big") if size > local else 0
        return _Cell(rowid, size, at, local, overflow)

    def _row(self, page: bytes, cell: _Cell, place: int, found: RecoveredPages) -> None:
        """Note a row if it is a message or a topic."""
        local = page[cell.start : cell.start + cell.local]
        types = _serial_types(local) or []
        # The first column is the id: NULL, as it is the row's own number, unless a table keeps it in a column, too.
        if len(types) == 4 and types[1] in _INT_BYTES and types[2] in _INT_BYTES:
            if types[3] >= 12 and types[3] % 2 == 0:
                head = _varint(local, 0)[0] + _width(types[0])
                found.rowids.append(cell.rowid)
                found.topic_ids.append(_number(local, head, types[1]))
                found.places.append(place)
        elif 4 <= len(types) <= 8 and types[0] == 0 and all(t >= 13 and t % 2 for t in types[1:4]):
            topic = _topic_row(local, cell.rowid, types)
            if topic is not None:
                found.topics.setdefault(cell.rowid, topic)

    def _message(self, place: int) -> MessageRow | None:
        """Return the message whose cell stands at a byte of the file, None where a part of it is lost."""
        at = place % self._page
        page = self._at(place - at, self._page)
        cell = self._cell(page, at)
        if cell is None or cell.size > MAX_MESSAGE:
            return None
        row = page[cell.start : cell.start + cell.local]
        if cell.overflow:
            rest = self._chain(cell.overflow, cell.size - cell.local)
            if rest is None:
                return None
            row += rest
        types = _serial_types(row)
        if types is None or len(types) != 4:
            return None
        at, numbers = _varint(row, 0)[0] + _width(types[0]), []
        for serial in types[1:3]:
            numbers.append(_number(row, at, serial))
            at += _INT_BYTES.get(serial, 0)
        size = (types[3] - 12) // 2
        if at + size != len(row):
            return None
        return MessageRow(cell.rowid, numbers[0], numbers[1], row[at:])

    def _chain(self, page: int, size: int) -> bytes | None:
        """Bytes of a chain of overflow pages, which mostly stand one behind the other; None where it is not whole."""
        each = self._usable - 4
        if size > self._size // self._page * each:
            return None
        parts: list[bytes] = []
        span, first, ahead = b"", 0, 1
        while size > 0:
            offset = (page - first) * self._page
            if not first or not 0 <= offset < len(span):
                # Twice as many pages each time that one stands behind the other; one where they lie scattered.
                ahead = 2 * ahead if first and offset == len(span) else 1
                first, offset = page, 0
                most = min(PIECE, (size // each + 1) * self._page)
                span = self._at((page - 1) * self._page, min(ahead * self._page, most)) if page else b""
            part = span[offset + 4 : offset + 4 + min(size, each)]
            if len(part) < min(size, each):
                break
            parts.append(part)
            page = int.from_bytes(span[offset : offset + 4], "big")
            size -= len(part)
        # The last page of a chain has none behind it.
        if size == 0 and page == 0:
            return b"".join(parts)
        self._wasted += sum(map(len, parts))
        return None


def _width(serial: int) -> int:
    """Return bytes of a value of this serial type."""
    return _INT_BYTES.get(serial, 8 if serial == 7 else max(0, (serial - 12) // 2))


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """Return a big-endian number of 7 bits per byte, and where it ends; an end of -1 where it is not whole."""
    value = 0
    for index in range(9):
        if not 0 <= at + index < len(data):
            return 0, -1
        byte = data[at + index]
        if index == 8:
            return value << 8 | byte, at + 9
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            return value, at + index + 1
    return 0, -1


def _serial_types(row: bytes) -> list[int] | None:
    """Return the types of a row's columns, None where its header cannot be one. Bags have at most 8 columns."""
    head, at = _varint(row, 0)
    if not 2 <= head <= len(row) or head > 64:
        return None
    types = []
    while 0 <= at < head:
        serial, at = _varint(row, at)
        types.append(serial)
    return types if at == head else None


def _number(row: bytes, at: int, serial: int) -> int:
    """Return the integer of this serial type at a byte of a row; 8 and 9 stand for 0 and 1."""
    return serial - 8 if serial > 6 else int.from_bytes(row[at : at + _INT_BYTES.get(serial, 0)], "big", signed=True)


def _topic_row(row: bytes, rowid: int, types: list[int]) -> TopicRow | None:
    """Return a row of three texts behind its id as a topic; None if it is no topic."""
    at, texts = _varint(row, 0)[0], []
    for serial in types[1:4]:
        texts.append(row[at : at + (serial - 13) // 2].decode("utf-8", "replace"))
        at += (serial - 13) // 2
    name, kind, encoding = texts
    # The table of message definitions has the same shape, but an encoding of definitions.
    is_topic = at <= len(row) and "/" in kind and not encoding.startswith("ros2")
    return TopicRow(rowid, name, kind, encoding) if is_topic else None


def guess_topics(salvage: Salvage, found: RecoveredPages) -> dict[int, TopicRow]:
    """Return LaserScan topics of a bag that lost its topics table: those whose first messages make sane sweeps."""
    guessed = {}
    for topic in sorted(set(found.topic_ids)):
        rows = islice(salvage.messages(found, {topic}, BEFORE_ALL), 5)
        sample = [row.data for row in rows if isinstance(row, MessageRow)]
        if sample and all(map(_is_scan, sample)):
            guessed[topic] = TopicRow(topic, f"/topic_{topic}", LASERSCAN, "cdr")
    return guessed


def _is_scan(data: bytes) -> bool:
    """Return True if a message decodes to a sweep with the geometry of a real scanner."""
    whole, start = np.array([len(data)]), np.array([0])
    for one in decode_blocks("", np.frombuffer(data, np.uint8), start, whole, start, "cdr", ReadReport()):
        sane = (one.beams > 1) & (np.abs(one.angle_min) < 10) & (np.abs(one.angle_increment) < 1)
        return bool((sane & (one.range_min >= 0) & (one.range_max > one.range_min)).all())
    return False
