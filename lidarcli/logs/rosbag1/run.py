"""A run of message and connection records in a ROS 1 bag, read from a feed whatever is broken in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np

from lidarcli.logs.base import MAX_MESSAGE
from lidarcli.logs.rosbag1.feeds import Feed
from lidarcli.logs.rosbag1.records import (
    MAX_HEADER,
    OVERLAP,
    Judged,
    Op,
    Record,
    Search,
    Walk,
    judge,
    parse,
    walk,
)
from lidarcli.sweeps import Int64, UInt8

WINDOW = 1 << 20
"""Bytes read at a time."""
MAX_WINDOW = 4 << 20
"""Most bytes read at once to have a whole chunk in one piece."""
BEHIND = 1024
"""Bytes read beyond a chunk, so that the record behind it proves its end."""


@dataclass(frozen=True, slots=True)
class MessageBlock:
    """Messages in a buffer, by column, and the connections that were declared among them."""

    data: UInt8
    connection: Int64
    time_ns: Int64
    starts: Int64
    """Where each message's own bytes begin."""
    lengths: Int64
    connections: list[tuple[Record, bytes]]
    """Connection records and their data."""


class Stop(Enum):
    """Why a run ended."""

    END = "the feed ended with a whole record"
    CUT = "the feed ended inside a record"
    OTHER = "a record of another kind stands here"
    LARGE = "a record too large for memory stands here"


class RecordRun:
    """Reads records until the feed ends or, where `others_end` says so, until a record of another kind."""

    def __init__(
        self,
        feed: Feed,
        search: Search,
        damaged: Callable[[int, str], None],
        *,
        others_end: bool,
        lost: bool = False,
        expected: int = WINDOW,
    ) -> None:
        """`damaged` is told the position in the feed and the cause; with `lost` a record must be found first.

        `expected` is how long the run should be, if its chunk is right about that: it is read in one piece then.
        """
        self.stop = Stop.END
        self.at = 0
        """Position in the feed where the run stopped, or how far it has come."""
        self._feed, self._search, self._damaged, self._others_end = feed, search, damaged, others_end
        self._data = b""
        self._base = 0
        """Position of the window in the feed."""
        self._at = 0
        """Where the next record should begin in the window."""
        self._ended = self._done = False
        self._lost: int | None = 0 if lost else None
        self._window = min(max(expected, OVERLAP), MAX_WINDOW) + BEHIND

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages, window by window."""
        self._slide(0)
        while not self._done and (self._lost is None or self._find()):
            walked = walk(self._data, self._at)
            yield from self._step(walked, judge(self._data, walked))

    def _step(self, walked: Walk, judged: Judged) -> Iterator[MessageBlock]:
        """The messages of what has been walked of a window, and on to where the next step begins."""
        whole = judged.good == len(walked.starts)
        self._at = walked.stop if whole else int(walked.starts[judged.good])
        record = parse(self._data, self._at) if whole else judged.foreign
        left = len(self._data) - self._at
        if record is not None and self._others_end and record.op not in (Op.MESSAGE, Op.CONNECTION):
            yield self._block(walked, judged)
            self._finish(Stop.OTHER, self._at)
        elif not whole or (record is None and left >= 8 + MAX_HEADER):
            yield self._broken(walked, judged)
        elif record is not None and record.end - self._at > MAX_MESSAGE:
            yield self._block(walked, judged)
            yield from self._large(record)
        elif not self._ended:
            # The last whole record waits: only a sane record behind it proves its length.
            held = max(0, judged.good - 1)
            yield self._block(walked, judged, rows=held)
            keep = int(walked.starts[held]) if judged.good else self._at
            self._slide(keep, 0 if record is None else record.end - self._at)
        else:
            yield self._block(walked, judged)
            yield from self._end(record)

    def _broken(self, walked: Walk, judged: Judged) -> MessageBlock:
        """The messages before a broken record, which the last of them may have swallowed."""
        cut = self._end_of_last(walked, judged.good, self._at)
        block = self._block(walked, judged, cut=cut)
        if cut is None:
            self._lose(self._at + 1)
        else:
            self._at = cut
        return block

    def _large(self, record: Record) -> Iterator[MessageBlock]:
        """A record too large for memory: where it ends behind the feed, its length is wrong."""
        if record.end - len(self._data) <= self._feed.left:
            if self._others_end:
                self._finish(Stop.LARGE, self._at)
            else:
                self._skip(record)
            return
        after = self._search.next(self._data, record.data_start)
        if after is None:
            self._lose(record.data_start)
        else:
            yield from self._shorten(record, after)

    def _end(self, record: Record | None) -> Iterator[MessageBlock]:
        """The feed has ended: what is left is no whole record, but others may stand in it."""
        at = self._at
        if at == len(self._data):
            self._finish(Stop.END, at)
            return
        after = self._search.next(self._data, at + 1 if record is None else record.data_start)
        if after is None:
            self._finish(Stop.CUT, at)
        elif record is None:
            self._damaged(self._base + at, f"{after - at:,} bytes are broken and were skipped")
            self._at = after
        else:
            yield from self._shorten(record, after)

    def _shorten(self, record: Record, end: int) -> Iterator[MessageBlock]:
        """A record whose own length is too large ends where the next one begins."""
        self._damaged(self._base + record.start, "a record has a wrong length")
        self._at = end
        if record.op == Op.MESSAGE:
            yield _single(self._data, record, end)

    def _slide(self, keep: int, need: int = 0) -> None:
        """Drop what stands before `keep` and read on."""
        more = max(self._window, need)
        self._window = WINDOW
        new = self._feed.read(more)
        self._ended = len(new) < more
        self._base += keep
        self.at = self._base
        self._data = self._data[keep:] + new
        self._at = 0

    def _skip(self, record: Record) -> None:
        """Read past a record that is too large for memory."""
        self._damaged(self._base + record.start, f"a message of {record.data_length:,} bytes was not read")
        missing = record.end - len(self._data)
        self._base += record.end
        self._data = b""
        while missing > 0 and (data := self._feed.read(min(missing, WINDOW))):
            missing -= len(data)
        self._slide(0)

    def _finish(self, stop: Stop, at: int) -> None:
        self.stop, self.at, self._done = stop, self._base + at, True

    def _lose(self, search_from: int) -> None:
        """A broken record stands here: the next one is looked for from `search_from` on."""
        self._lost = self._base + self._at
        self._at = search_from

    def _find(self) -> bool:
        """Go to the next plausible record; False where there is none up to the feed's end."""
        lost = self._lost or 0
        while (found := self._search.next(self._data, self._at)) is None:
            if self._ended or self._search.budget <= 0:
                self._finish(Stop.CUT, lost - self._base)
                return False
            self._slide(max(self._at, len(self._data) - OVERLAP))
        self._damaged(lost, f"{self._base + found - lost:,} bytes are broken and were skipped")
        self._lost, self._at = None, found
        return True

    def _end_of_last(self, walked: Walk, good: int, at: int) -> int | None:
        """Where the record before the broken one at `at` really ends, if it swallowed the start of others."""
        if not good:
            return None
        start = int(walked.starts[good - 1] + 8 + walked.header_lengths[good - 1])
        inside = self._search.next(self._data, start)
        if inside is None or inside >= at:
            return None
        self._damaged(self._base + inside, "a record has a wrong length")
        return inside

    def _block(
        self, walked: Walk, judged: Judged, cut: int | None = None, rows: int | None = None
    ) -> MessageBlock:
        """The first rows of a walk; `cut` is where the last of them really ends."""
        rows = judged.good if rows is None else rows
        starts = walked.starts[:rows] + 8 + walked.header_lengths[:rows]
        lengths = walked.data_lengths[:rows].copy()
        if cut is not None:
            lengths[-1] = cut - starts[-1]
        connections = [
            (record, self._data[starts[row] : starts[row] + lengths[row]])
            for row, record in judged.others
            if row < rows
        ]
        data = np.frombuffer(self._data, np.uint8)
        return MessageBlock(
            data, judged.connection[:rows], judged.time_ns[:rows], starts, lengths, connections
        )


def _single(data: bytes, record: Record, end: int) -> MessageBlock:
    """One message, whose own length is wrong: it ends where the next record begins."""
    seconds, nanoseconds = np.frombuffer(record.value(b"time"), "<u4").tolist()
    return MessageBlock(
        np.frombuffer(data, np.uint8),
        np.array([record.number(b"conn")]),
        np.array([seconds * 1_000_000_000 + nanoseconds]),
        np.array([record.data_start]),
        np.array([end - record.data_start]),
        [],
    )
