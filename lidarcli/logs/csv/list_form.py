"""One sweep per record, its ranges in one cell: `"[1.0, inf, nan]"`, `"array('f', [1.0])"`, `"(1.0, 2.0)"`."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np

from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.blocks import keep_sound, pad, pad_intensities, split_rows
from lidarcli.logs.csv.dialect import csv_cells, read_lines
from lidarcli.logs.csv.layouts import Columns, Layout
from lidarcli.logs.csv.raw_sweeps import (
    NO_TIME,
    build,
    encode_frames,
    number_type,
    read_times,
)
from lidarcli.logs.numbers import not_a_number, parse_number, parse_rows, say
from lidarcli.logs.text import MAX_LINE, TextBlock
from lidarcli.sweeps import Float32, Int32, RawSweeps

_SECONDS = re.compile(r"\bsecs?['\"]?\s*[:=]\s*(-?\d+)")
_NANOSECONDS = re.compile(r"\bn(?:ano)?secs?['\"]?\s*[:=]\s*(\d+)")
_FRAME = re.compile(r"frame_id['\"]?\s*[:=]\s*(?:'([^']*)'|\"([^\"]*)\"|([^\s,'\"})]*))")
_PARENTHESES = re.compile(rb'"\s*\(([^()]*)\)\s*"')
_CALLS = re.compile(rb"[A-Za-z_][\w.]*\(([^()]*)\)")
_GEOMETRY = ("angle_min", "angle_increment", "range_min", "range_max")
_MOST_LISTS = 64
"""A record with more lists than this is garbage."""
_MOST_TEXT = 1 << 20
"""Most bytes of a record outside its lists."""
_MOST_LINES = 100_000
"""Most lines that one record may span."""


@dataclass(frozen=True, slots=True)
class _Record:
    """One record: its line, the text of its ranges and intensities, all other cells."""

    line: int
    ranges: bytes
    intensities: bytes
    cells: list[str]


class ListDecoder:
    """Blocks of lines → blocks of sweeps; a record whose quotes are open goes on in the next block."""

    def __init__(
        self, layout: Layout, options: OpenOptions, report: ReadReport, topics: Collection[str] | None
    ) -> None:
        self._layout = layout
        self._options = options
        self._report = report
        scan = layout.scans[0]
        self._scan = scan if topics is None or scan.topic in topics else None
        self._open: list[bytes] = []
        self._open_line = self._open_size = 0

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """The sweeps of one block."""
        if self._scan is None:
            return
        lines = read_lines(block, None, self._layout.header, self._layout.start, self._report)
        records = []
        for number, line in zip(lines.numbers.tolist(), lines.text.split(b"\n"), strict=False):
            for start, text in self._whole(number, line) if line.strip() else ():
                record = self._read(start, text)
                if record is not None:
                    records.append(record)
        yield from self._sweeps(self._scan, records)

    def finish(self) -> Iterator[RawSweeps]:
        """What is still open at the end is a record that was cut off."""
        if self._open:
            self._report.add_damage(f"line {self._open_line}", "the file ends within this record")
            self._open = []
        return iter(())

    def _whole(self, number: int, line: bytes) -> Iterator[tuple[int, bytes]]:
        """Records that are whole once `line` is read: lists may span lines while a quote is open."""
        odd = line.count(b'"') % 2 == 1
        if not self._open:
            if odd:
                self._open, self._open_line, self._open_size = [line], number, len(line)
            else:
                yield number, line
            return
        if not odd and self._is_record(line):
            # The open quote was damage: do not let it swallow the records that follow.
            self._report.add_damage(
                f"line {self._open_line}", "a quote without its end: the record is dropped"
            )
            self._open = []
            yield number, line
            return
        self._open.append(line)
        self._open_size += len(line)
        if odd:
            start, text = self._open_line, b" ".join(self._open)
            self._open = []
            yield start, text
        elif len(self._open) > _MOST_LINES or self._open_size > MAX_LINE:
            self._report.add_damage(
                f"line {self._open_line}", "a quote that never ends: its lines are dropped"
            )
            self._open = []

    def _is_record(self, line: bytes) -> bool:
        return line.count(b"[") + line.count(b"(") > 0 and self._split(line) is not None

    def _split(self, text: bytes) -> tuple[list[bytes], list[str]] | None:
        """The lists of a record, and its cells with the number of a list in place of each."""
        if self._layout.brackets not in text and text.count(self._layout.dialect.separator) < 2:
            return None
        lists: list[bytes] = []
        plain: list[bytes] = []
        place = 0
        if self._layout.brackets == b"(":
            for match in islice(_PARENTHESES.finditer(text), _MOST_LISTS):
                plain += [text[place : match.start()], b"\x01%d" % len(lists)]
                lists.append(match[1])
                place = match.end()
        else:
            while (begin := text.find(b"[", place)) >= 0 and (end := text.find(b"]", begin)) >= 0:
                if len(lists) == _MOST_LISTS:
                    return None
                plain += [text[place:begin], b"\x01%d" % len(lists)]
                lists.append(text[begin + 1 : end])
                place = end + 1
        plain.append(text[place:])
        if sum(map(len, plain)) > _MOST_TEXT:
            return None
        try:
            cells = csv_cells(
                b"".join(plain).decode("utf-8", "replace"), self._layout.dialect.separator.decode()
            )
        except ValueError:
            return None
        if self._layout.dialect.trailing and cells and not cells[-1]:
            cells.pop()
        return (lists, cells) if len(cells) == self._layout.width else None

    def _read(self, line: int, text: bytes) -> _Record | None:
        found = self._split(text)
        if found is None:
            self._report.add_damage(f"line {line}", "not a whole record: it is dropped")
            return None
        lists, cells = found
        scan = self._layout.scans[0]
        ranges = _list_of(cells[scan.first], lists)
        if ranges is None:
            self._report.add_damage(f"line {line}", f"{say(cells[scan.first].encode())} is no list of ranges")
            return None
        beside = [_list_of(cells[column], lists) or b"" for column in scan.intensities.tolist()]
        return _Record(line, ranges, b"".join(beside), cells)

    def _sweeps(self, scan: Columns, records: list[_Record]) -> Iterator[RawSweeps]:
        parts = [_plain_list(record.ranges) for record in records]
        counts = np.array([part.count(b",") + 1 if part else 0 for part in parts], np.int64)
        for rows in split_rows(counts):
            block = self._decode(scan, records[rows], parts[rows], counts[rows])
            if block is not None:
                yield block

    def _decode(
        self, scan: Columns, records: list[_Record], parts: list[bytes], counts: np.ndarray
    ) -> RawSweeps | None:
        found = parse_rows(parts, counts, b",", number_type(self._options))
        causes = {row: not_a_number(cell) for row, cell in found.bad.items()}
        known: dict[str, np.ndarray] = {}
        for name in _GEOMETRY:
            if name in scan.fields:
                values, wrong = _numbers([record.cells[scan.fields[name]] for record in records])
                known[name] = values
                causes = dict.fromkeys(wrong, f"{name} is not a number") | causes
        stamp, record_ns, untimed = read_times(
            scan, lambda index: [record.cells[index].encode() for record in records], len(records)
        )
        frame: tuple[Int32, tuple[str, ...]] = np.zeros(len(records), np.int32), ("",)
        if "frame" in scan.fields:
            frame = encode_frames([record.cells[scan.fields["frame"]].encode() for record in records])
        if "header" in scan.fields:
            headers = [record.cells[scan.fields["header"]] for record in records]
            if "stamp" not in scan.units and "seconds" not in scan.fields:
                stamp = _header_stamps(headers, stamp)
                record_ns = record_ns if "record" in scan.units else stamp
            if "frame" not in scan.fields:
                frame = encode_frames([_header_frame(header) for header in headers])
        if untimed is not None:
            causes = dict.fromkeys(np.flatnonzero(untimed).tolist(), NO_TIME) | causes
        for row, cause in sorted(causes.items()):
            self._report.add_damage(f"line {records[row].line}", cause)
        good = np.ones(len(records), np.bool_)
        good[list(causes)] = False
        ranges = pad(found.values, counts, self._options.range_scale)
        intensities = _intensities(records, ranges.shape[1])
        block = build(scan, (stamp, record_ns), frame, known, counts, ranges, self._options, intensities)
        return keep_sound(block, good, self._report)


def _list_of(cell: str, lists: list[bytes]) -> bytes | None:
    """The text of the list that a cell stands for, empty where it is an empty one; None where it is no list."""
    _, mark, number = cell.partition("\x01")
    digits = re.match(r"\d+", number)
    if digits is not None and int(digits[0]) < len(lists):
        return lists[int(digits[0])]
    is_empty = not mark and cell.strip().rstrip("()[]'f").strip() in ("", "array", "array('f'")
    return b"" if is_empty else None


def _intensities(records: list[_Record], width: int) -> Float32 | None:
    """(S, `width`) the intensities beside the ranges, padded with NaN; None where no record has any."""
    parts = [_plain_list(record.intensities) for record in records]
    counts = np.array([part.count(b",") + 1 if part else 0 for part in parts], np.int64)
    found = parse_rows(parts, counts, b",", np.float32)
    return pad_intensities(np.split(found.values, np.cumsum(counts)[:-1]), width)


def _plain_list(text: bytes) -> bytes:
    """The numbers of a list, set apart by commas: numpy's spelling has spaces, `np.float32(1.0)` has calls."""
    if b"(" in text:
        text = _CALLS.sub(rb"\1", text)
    text = text.strip().removesuffix(b",")
    return text if b"," in text else b",".join(text.split())


def _numbers(cells: list[str]) -> tuple[np.ndarray, list[int]]:
    """Each cell as the float32 a LaserScan holds, and the rows where it is none."""
    values = np.full(len(cells), np.nan)
    wrong = []
    seen: dict[str, float] = {}
    for row, cell in enumerate(cells):
        if cell not in seen:
            try:
                number = parse_number(cell.encode())
            except ValueError:
                wrong.append(row)
                continue
            seen[cell] = np.nan if number is None else number
        values[row] = seen[cell]
    with np.errstate(over="ignore"):
        return values.astype(np.float32).astype(np.float64), wrong


def _header_stamps(headers: list[str], otherwise: np.ndarray) -> np.ndarray:
    """The stamp inside each printed header; the other time where it holds none."""
    stamps = otherwise.copy()
    for row, header in enumerate(headers):
        seconds, rest = _SECONDS.search(header), _NANOSECONDS.search(header)
        if seconds is not None:
            total = int(seconds[1]) * 1_000_000_000 + int(rest[1] if rest else 0)
            if abs(total) < 1 << 63:
                stamps[row] = total
    return stamps


def _header_frame(header: str) -> bytes:
    match = _FRAME.search(header)
    return b"" if match is None else (match[1] or match[2] or match[3] or "").encode()
