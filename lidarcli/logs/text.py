"""Text as blocks of whole lines: gzip, UTF-16, byte order marks and all line ends are undone; how text logs begin."""

from __future__ import annotations

import codecs
import os
import re
import stat
import zlib
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from itertools import chain
from pathlib import Path
from typing import BinaryIO

from lidarcli.errors import UnreadableError, unreadable
from lidarcli.logs.base import POSE_TYPES, Closing, Message, OpenOptions, ReadReport
from lidarcli.sweeps.types import RawSweeps
from lidarcli.system.records import dataclass, replace

MAX_LINE = 8 << 20
"""Bytes of the longest line that is read (100,000 beams with intensities fit); a longer one is skipped and reported."""
FIRST_BLOCK = 64 << 10
BLOCK = 512 << 10
_CHUNK = 256 << 10


@dataclass(frozen=True, slots=True)
class TextBlock:
    """Whole lines of a text, each ended by one newline."""

    text: bytes
    line: int
    """Number of the first line, counted from 1."""
    lines: int
    cut: bool = False
    """The last line had no line end: the text may have been cut off there."""


class TextSource:
    """Lines of a byte stream, which `blocks` reads once, in bounded memory.

    `limit` bounds the bytes taken from the stream, so that a file that grows while it is read has an end.
    """

    def __init__(self, stream: BinaryIO, limit: int | None = None) -> None:
        self._stream = stream
        self.report = ReadReport()
        """Damage since the last call of `report_to`."""
        self.position = 0
        self._left = limit
        self._first = self._read(FIRST_BLOCK)
        self.compression = "gzip" if self._first[:2] == b"\x1f\x8b" else "none"

    def report_to(self, report: ReadReport) -> None:
        """Move the damage met so far to `report`, and add all further damage there."""
        report.add(self.report)
        self.report = report

    def blocks(self) -> Iterator[TextBlock]:
        """Yield blocks of lines: a small first one for recognition, then larger ones."""
        chunks = self._chunks()
        if self.compression == "gzip":
            chunks = self._gunzip(chunks)
        return _line_ends(self._whole_lines(_newlines(_as_utf8(chunks))))

    def _read(self, size: int) -> bytes:
        if self._left is not None:
            size = min(size, self._left)
        data = self._stream.read(size) if size else b""
        if self._left is not None:
            self._left -= len(data)
        self.position += len(data)
        return data

    def _chunks(self) -> Iterator[bytes]:
        chunk = self._first
        while chunk:
            yield chunk
            try:
                chunk = self._read(_CHUNK)
            except OSError as err:
                self.report.add_damage(f"byte {self.position}", f"reading failed: {err.strerror}")
                return

    def _gunzip(self, chunks: Iterator[bytes]) -> Iterator[bytes]:
        """Yield every byte that can be unpacked, member by member, in pieces of bounded size."""
        unpack = zlib.decompressobj(31)
        fresh = True
        for chunk in chunks:
            data = chunk
            while data:
                if fresh and not data.strip(b"\0"):
                    break
                fresh = False
                try:
                    piece = unpack.decompress(data, _CHUNK)
                except zlib.error as err:
                    place = f"compressed byte {self.position - len(data)}"
                    self._lost(place, f"gzip data is damaged ({err}); what follows is lost")
                    return
                if piece:
                    yield piece
                data = unpack.unused_data if unpack.eof else unpack.unconsumed_tail
                if unpack.eof:
                    unpack = zlib.decompressobj(31)
                    fresh = True
        if not fresh:
            if rest := unpack.flush():
                yield rest
            self._lost(f"compressed byte {self.position}", "gzip data ends early; what follows is lost")

    def _lost(self, place: str, cause: str) -> None:
        """Record the end of all data, even where the report is full of lesser damage."""
        if len(self.report.damage) >= ReadReport.MAX_DAMAGE:
            self.report.damage.pop()
            self.report.damage_more += 1
        self.report.add_damage(place, cause)

    def _whole_lines(self, chunks: Iterator[bytes]) -> Iterator[TextBlock]:
        """Cut chunks into blocks at line ends, and drop lines beyond `MAX_LINE`."""
        line, target = 1, FIRST_BLOCK
        whole: list[bytes] = []
        tail: list[bytes] = []
        size = tail_size = 0
        skipping = False
        for piece in chunks:
            chunk = piece
            if skipping:
                after = chunk.find(b"\n") + 1
                if not after:
                    continue
                chunk, skipping = chunk[after:], False
                line += 1
            end = chunk.rfind(b"\n") + 1
            if end:
                whole += [*tail, chunk[:end]]
                size += tail_size + end
                tail, tail_size = [], 0
            if end < len(chunk):
                tail.append(chunk[end:])
                tail_size += len(chunk) - end
            too_long = tail_size > MAX_LINE
            if size >= target or (too_long and size):
                text = b"".join(whole)
                yield TextBlock(text, line, count := text.count(b"\n"))
                line += count
                whole, size, target = [], 0, BLOCK
            if too_long:
                self.report.add_damage(f"line {line}", f"longer than {MAX_LINE >> 20} MiB: skipped")
                tail, tail_size, skipping = [], 0, True
        if size + tail_size:
            end_of_file = [b"\n"] if tail else []
            text = b"".join(whole + tail + end_of_file)
            yield TextBlock(text, line, text.count(b"\n"), cut=bool(tail))


def _as_utf8(chunks: Iterator[bytes]) -> Iterator[bytes]:
    """Drop a byte order mark; turn UTF-16, with or without one, into UTF-8."""
    first = next(chunks, b"")
    encoding = ""
    if first[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        encoding = "utf-16"
    elif len(first) >= 4 and 0 not in first[0:64:2] and not any(first[1:64:2]):
        encoding = "utf-16-le"
    elif len(first) >= 4 and 0 not in first[1:64:2] and not any(first[0:64:2]):
        encoding = "utf-16-be"
    if not encoding:
        yield first.removeprefix(codecs.BOM_UTF8)
        yield from chunks
        return
    decoder = codecs.getincrementaldecoder(encoding)(errors="replace")
    yield decoder.decode(first).encode()
    for chunk in chunks:
        yield decoder.decode(chunk).encode()


def _newlines(chunks: Iterator[bytes]) -> Iterator[bytes]:
    """Replace carriage returns by newlines in a text whose lines end with carriage returns alone."""
    first = next(chunks, b"")
    alone = b"\r" in first[:-1] and b"\n" not in first
    for chunk in chain([first], chunks):
        yield chunk.replace(b"\r", b"\n") if alone else chunk


def _line_ends(blocks: Iterator[TextBlock]) -> Iterator[TextBlock]:
    """Write every line end as one newline, a stray carriage return as a space, and lines as `unprinted` has them."""
    for block in blocks:
        text = unprinted(block.text.replace(b"\r\n", b"\n").replace(b"\r", b" "))
        yield block if text is block.text else replace(block, text=text)


_PRINTED = re.compile(rb"""^b(['"])(.*)\1[ \t]*$""", re.MULTILINE)


def unprinted(text: bytes) -> bytes:
    """Return the lines of a text of which most are bytes as Python prints them, as of a subprocess or a serial port.

    >>> unprinted(b"b'0.5,2.1\\\\r\\\\n'\\nb'1.0,2.0\\\\r\\\\n'\\n")
    b'0.5,2.1\\n1.0,2.0\\n'
    """
    begun = text[:2] in (b"b'", b'b"') or b"\nb'" in text or b'\nb"' in text
    if not begun or 2 * len(_PRINTED.findall(text)) <= text.count(b"\n"):
        return text

    def plain(match: re.Match[bytes]) -> bytes:
        return match[2].replace(b"\\t", b"\t").removesuffix(b"\\n").removesuffix(b"\\r")

    return _PRINTED.sub(plain, text)


class TextLog(Closing, ABC):
    """A log of text, from a file or a stream; subclasses decode its lines."""

    def __init__(self, source: str | os.PathLike[str] | BinaryIO, options: OpenOptions | None = None) -> None:
        self._options = options or OpenOptions()
        self._stream: BinaryIO | None = None
        self._once = not isinstance(source, str | os.PathLike)
        self._used = False
        self.size: int | None = None
        if isinstance(source, str | os.PathLike):
            self.path = os.fspath(source)
        else:
            self.path, self._stream = "-", source
        self._text = self._open()
        self.compression = self._text.compression

    @property
    def position(self) -> int:
        """Bytes of the source that the last pass has read."""
        return self._text.position

    @abstractmethod
    def _sweeps(
        self, blocks: Iterator[TextBlock], topics: Collection[str] | None, report: ReadReport
    ) -> Iterator[RawSweeps]:
        """Decode the sweeps of one pass."""

    def _poses(self, blocks: Iterator[TextBlock], types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Decode the poses of one pass; logs without any are read for their damage alone."""
        for _ in blocks:
            yield from ()

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Return blocks of sweeps in the order of the file within each topic."""
        return self._sweeps(self._blocks(report), topics, report)

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield poses of the given types."""
        if POSE_TYPES.intersection(types):
            yield from self._poses(self._blocks(report), types, report)

    def close(self) -> None:
        """Close the file, unless it is a stream of the caller."""
        if self._stream is not None and not self._once:
            self._stream.close()
            self._stream = None

    def _blocks(self, report: ReadReport) -> Iterator[TextBlock]:
        """Start a pass: return all blocks; UnreadableError for the second pass over a stream."""
        if self._used:
            if self._once:
                raise UnreadableError(f"{self.path}: a stream can be read only once")
            self.close()
            self._text = self._open()
        self._used = True
        self._text.report_to(report)
        return self._text.blocks()

    def _open(self) -> TextSource:
        with unreadable(self.path):
            if self._stream is None:
                self._stream = Path(self.path).open("rb")  # noqa: SIM115 (closed by close)
                status = os.fstat(self._stream.fileno())
                if stat.S_ISREG(status.st_mode):
                    self.size = status.st_size
                else:
                    self._once = True
            return TextSource(self._stream, self.size)


JSON_LINE = (
    rb'\s*\{\s*"topic"\s*:\s*("(?:[^"\\]|\\.)*+")\s*,\s*"sequence"\s*:\s*\d+\s*,'
    rb'\s*"log_time"\s*:\s*"?([^",{}\s]+)"?\s*,'
)
"""Start of a line of `mcap cat --json`; its groups are the topic, as JSON, and the time of the record."""

_BOM = rb"(?:\xef\xbb\xbf)?"
_COMMENTS = _BOM + rb"(?:[ \t]*(?:#[^\n]*)?\r?\n)*[ \t]*"
_CARMEN_HEADER = _BOM + rb"# (?:CARMEN Logfile|message_name \[message contents\] ipc_timestamp)"
_CARMEN_LINE = (
    _COMMENTS + rb"(?:[FR]LASER|LASER[34]|REMISSIONFLASER|R(?:AW|OBOT)LASER[1-4]|ODOM|TRUEPOS|PARAM|SYNC"
    rb"|GLOBALPOS|NMEAGGA|NMEARMC|SONAR|BUMPER|IMU|GRIDMAP|SCANMARK|POSITIONLASER)[ \t]+[^\s,;]"
)


def is_carmen(head: bytes) -> bool:
    """Return whether a text is a CARMEN log: by its header, or by the first word that is no comment.

    >>> is_carmen(b"# made by hand\\nODOM 0 0 0 0 0 0 1.5 host 1.5\\n"), is_carmen(b"time,r0,r1")
    (True, False)
    """
    head = unprinted(head)
    return re.match(_CARMEN_HEADER, head) is not None or re.match(_CARMEN_LINE, head) is not None


def is_json_lines(head: bytes) -> bool:
    """Return whether a text is what `mcap cat --json` prints: by its first line.

    >>> is_json_lines(b'{"topic":"/scan","sequence":0,"log_time":1.5,"data":{}}'), is_json_lines(b'{"ranges": []}')
    (True, False)
    """
    return re.match(JSON_LINE, unprinted(head).removeprefix(codecs.BOM_UTF8)) is not None
