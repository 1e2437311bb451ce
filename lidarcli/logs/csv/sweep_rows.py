"""One sweep per row, with a column for each beam or all ranges in one cell; and the common base of all forms."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice

import numpy as np

from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.blocks import (
    as_singles,
    given_geometries,
    keep_sound,
    limits_in_metres,
    pad,
    pad_intensities,
    split_rows,
)
from lidarcli.logs.cells import (
    DATED,
    NS,
    Cells,
    going_on,
    not_a_number,
    pad_cells,
    parse_number,
    parse_rows,
    seconds_and_parts,
    shown,
    to_ns,
)
from lidarcli.logs.csv.layouts import Layout, ScanColumns, expected_beams
from lidarcli.logs.csv.table import csv_cells, plain_lists, read_lines
from lidarcli.logs.text import MAX_LINE, TextBlock
from lidarcli.sweeps.types import Bool, Float32, Float64, Int32, Int64, RawSweeps

_GEOMETRY = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
_LIST_GEOMETRY = ("angle_min", "angle_increment", "range_min", "range_max")
_VIEW = ("angle_min", "angle_max", "angle_increment")
NO_TIME = "the time cannot be read"

_SECONDS = re.compile(r"\bsecs?['\"]?\s*[:=]\s*(-?\d+)")
_NANOSECONDS = re.compile(r"\bn(?:ano)?secs?['\"]?\s*[:=]\s*(\d+)")
_FRAME = re.compile(r"frame_id['\"]?\s*[:=]\s*(?:'([^']*)'|\"([^\"]*)\"|([^\s,'\"})]*))")
_PARENTHESES = re.compile(rb'(?<![\w.])(?:"\s*)?\(([^()]*)\)(?:\s*")?')
_MAX_LISTS = 64
"""Most lists of one record; with more it is garbage."""

Frames = tuple[Int32, tuple[str, ...]]
"""Index of the frame of each sweep, and the names of the frames."""
Ends = dict[tuple[str, str], tuple[int, int]]
"""Topic and field → where its times have ended, see `times.going_on`."""
Column = Callable[[int], Sequence[bytes]]


@dataclass(slots=True)
class Decoder(ABC):
    """Turns blocks of lines into blocks of sweeps in one pass; a subclass for each form."""

    layout: Layout
    options: OpenOptions
    report: ReadReport
    topics: Collection[str] | None
    last: Ends = field(default_factory=dict)

    @abstractmethod
    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of a block of lines."""

    def finish(self) -> Iterator[RawSweeps]:
        """Yield the sweeps that are left at the end of the text."""
        return iter(())

    @property
    def _scans(self) -> list[ScanColumns]:
        """The wanted scans."""
        return [scan for scan in self.layout.scans if self.topics is None or scan.topic in self.topics]

    @property
    def _number(self) -> type[np.floating]:
        """Type of ranges: float32, or float64 where they are scaled before they are rounded."""
        return np.float32 if self.options.range_scale == 1.0 else np.float64

    def _damage(self, line: int, cause: str) -> None:
        self.report.add_damage(f"line {line}", cause)

    def _bad_cells(self, bad: dict[int, bytes], lines: Int64) -> None:
        """Report rows of `lines` (R,) that are dropped for a cell that is no number."""
        for row, cell in sorted(bad.items()):
            # Only what is kept is put into words.
            if len(self.report.damage) < ReadReport.MAX_DAMAGE:
                self._damage(int(lines[row]), not_a_number(cell))
            else:
                self.report.damage_more += 1

    def _block(
        self,
        scan: ScanColumns,
        times: tuple[Int64, Int64],
        frames: Frames,
        known: Mapping[str, Float64],
        beams: Int64,
        ranges: Float32,
        good: Bool,
        intensities: Float32 | None = None,
    ) -> RawSweeps | None:
        """Make a block of the `good` sweeps (S,) by the `known` geometry of the file; the options fill in the rest."""
        rows = len(beams)
        if self.layout.angle < 0 and "angle_min" in known:
            self.options.used.add("angle_scale")
            known = {
                name: values * (self.options.angle_scale if "angle" in name else 1.0) for name, values in known.items()
            }
        if "angle_min" in known and "angle_increment" in known:
            first, step = known["angle_min"], known["angle_increment"]
        elif scan.to_last:
            first = known["angle_min"]
            step = (known["angle_max"] - first) / np.maximum(beams - 1, 1)
        else:
            self.report.numbered.add(scan.topic)
            first, step = given_geometries(self.options, beams)
        least = known.get("range_min", np.zeros(rows))
        most = known.get("range_max", np.full(rows, np.inf))
        range_min, range_max = limits_in_metres(least, most, self.options.range_scale)
        if "range_max" not in known and self.options.range_max is not None:
            self.options.used.add("range_max")
            range_max = as_singles(np.full(rows, self.options.range_max))
        seconds = {name: as_singles(known[name]) for name in ("time_increment", "scan_time") if name in known}
        block = RawSweeps(
            topic=scan.topic,
            frame_ids=frames[1],
            frame=frames[0],
            stamp_ns=times[0],
            record_ns=times[1],
            angle_min=first,
            angle_increment=step,
            range_min=range_min,
            range_max=range_max,
            beams=beams.astype(np.int32),
            ranges=ranges,
            time_increment=seconds.get("time_increment"),
            scan_time=seconds.get("scan_time"),
            intensities=intensities,
            angle_max=known.get("angle_max"),
        )
        return keep_sound(block, good, self.report)


def read_times(scan: ScanColumns, column: Column, rows: int, last: Ends) -> tuple[Int64, Int64, Bool]:
    """Return stamps and record times (R,) [ns] of rows, and (R,) True where they cannot be read.

    Where a file has only one of the two, it stands for both. `last` keeps the last time of each column.
    """
    fields, units = scan.fields, scan.units
    bad = np.zeros(rows, np.bool_)
    found: dict[str, Int64] = {}
    if "seconds" in fields:
        whole, parts = (column(fields[name]) for name in ("seconds", "nanoseconds"))
        found["stamp"], bad = seconds_and_parts(whole, parts, units.get("nanoseconds", NS))
    for name in ("stamp", "record"):
        if name in units and name not in found:
            times, wrong = to_ns(column(fields[name]), units[name])
            bad = bad | wrong
            if units[name] == DATED:
                days, wrong = to_ns(column(fields["date"]), units["date"])
                times, bad = times + days, bad | wrong
            if not bad.all():
                key = scan.topic, name
                times[~bad], last[key] = going_on(times[~bad], units[name], last.get(key))
            found[name] = times
    stamp = found.get("stamp", found.get("record", np.zeros(rows, np.int64)))
    return stamp, found.get("record", stamp), bad


def read_frames(scan: ScanColumns, column: Column, rows: int) -> Frames:
    """Return the frames of rows; one without a name where the file has none."""
    if "frame" in scan.fields:
        return encode_frames(column(scan.fields["frame"]))
    return np.zeros(rows, np.int32), ("",)


def encode_frames(names: Sequence[bytes]) -> Frames:
    """Return the index of each name among the distinct ones, and these."""
    distinct = {name: code for code, name in enumerate(dict.fromkeys(names))}
    if len(distinct) == 1:
        codes = np.zeros(len(names), np.int32)
    else:
        codes = np.fromiter((distinct[name] for name in names), np.int32, len(names))
    # Spellings that differ by spaces alone are one frame to people, two codes here: harmless.
    return codes, tuple(name.strip(b" \"'").decode("utf-8", "replace") for name in distinct)


@dataclass(slots=True)
class WideDecoder(Decoder):
    """Decodes one sweep per row: rostopic, ros2 topic echo, PlotJuggler, bagpy, and plain wide tables."""

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of one block."""
        layout = self.layout
        lines = read_lines(block, layout.dialect, layout.header, layout.start, self.report)
        if not len(lines.numbers):
            return
        cells = Cells(lines.text, layout.dialect.separator)
        rows = np.arange(len(cells.count))
        single = np.flatnonzero(cells.count == 1)
        if len(single):
            blank = [not cell.strip() for cell in cells.column(single, 0)]
            rows = np.delete(rows, single[blank])
        if lines.cut and len(rows):
            rows = self._drop_cut(cells, rows, lines.numbers)
        for scan in self._scans:
            yield from self._sweeps(scan, cells, rows, lines.numbers)

    def _drop_cut(self, cells: Cells, rows: Int64, numbers: Int64) -> Int64:
        """Drop the last row where the file ends in the middle of it."""
        last = rows[-1:]
        count = int(cells.count[last[0]])
        end = cells.column(last, count - 1)[0].strip()
        if count >= self.layout.width and end and end[-1:] not in b".-+eE":
            return rows
        self._damage(numbers[last[0]], f"the file ends within this row ({count} cells): its sweep is dropped")
        return rows[:-1]

    def _sweeps(self, scan: ScanColumns, cells: Cells, rows: Int64, numbers: Int64) -> Iterator[RawSweeps]:
        need = max([scan.first - 1, *scan.fields.values(), *([] if scan.open_end else scan.ranges.tolist())]) + 1
        enough = cells.count[rows] >= need
        self._misfits(cells, rows[~enough], numbers)
        rows = rows[enough]
        if not len(rows):
            return
        known, odd = self._geometry(scan, cells, rows)
        if odd:
            self._bad_cells(odd, numbers[rows])
            keep = np.delete(np.arange(len(rows)), list(odd))
            rows, known = rows[keep], {name: values[keep] for name, values in known.items()}
        view = np.full(len(rows), -1)
        if set(_VIEW) <= known.keys():
            view = expected_beams(*(known[name] for name in _VIEW))
        beams = self._beams(scan, cells, rows, view)
        fits = beams >= 0
        self._misfits(cells, rows[~fits], numbers)
        rows, beams, view = rows[fits], beams[fits], view[fits]
        known = {name: values[fits] for name, values in known.items()}
        for part in split_rows(beams):
            some_rows, given = rows[part], beams[part]
            ranges, kept, good, bad = self._ranges(scan, cells, some_rows, given, view[part])
            intensities = _intensity_columns(scan, cells, some_rows, given, ranges.shape[1])
            self._bad_cells(bad, numbers[some_rows])
            column = partial(cells.column, some_rows)
            *times, untimed = read_times(scan, column, len(some_rows), self.last)
            for line in numbers[some_rows[untimed & good]].tolist():
                self._damage(line, NO_TIME)
            frames = read_frames(scan, column, len(some_rows))
            some = {name: values[part] for name, values in known.items()}
            block = self._block(scan, (times[0], times[1]), frames, some, kept, ranges, good & ~untimed, intensities)
            if block is not None:
                yield block

    def _ranges(
        self, scan: ScanColumns, cells: Cells, rows: Int64, beams: Int64, view: Int64
    ) -> tuple[Float32, Int64, Bool, dict[int, bytes]]:
        """Return ranges, beam counts, True for rows that are sweeps, and the bad cells of the others."""
        first, span, order = scan.first, beams, None
        if len(scan.ranges) and not scan.open_end:
            first = int(scan.ranges.min())
            span = np.full(len(rows), int(scan.ranges.max()) + 1 - first)
            order = scan.ranges - first
        found = cells.numbers(rows, first, span, self._number)
        ranges = pad(found.values, span, self.options.range_scale)
        good = np.ones(len(rows), np.bool_)
        good[list(found.bad)] = False
        empty = None if found.empty is None else pad(found.empty.astype(np.float32), span, 1.0) == 1.0
        if order is not None and (len(order) != span[0] or (np.diff(order) != 1).any()):
            ranges, empty = ranges[:, order], None if empty is None else empty[:, order]
        if empty is not None and empty.size:
            beams = _without_trailing(empty, beams, np.zeros_like(beams) if scan.to_last else view - scan.ends_before)
            if self.layout.sparse:
                good &= ~empty.all(axis=1)
        return ranges, beams, good, found.bad

    def _geometry(self, scan: ScanColumns, cells: Cells, rows: Int64) -> tuple[dict[str, Float64], dict[int, bytes]]:
        """Return the geometry of each row, as exact as its message has it, and the bad cells of rows without."""
        columns = {name: scan.fields[name] for name in _GEOMETRY if name in scan.fields}
        if not columns:
            return {}, {}
        number = np.float64 if scan.to_last else np.float32
        low, high = min(columns.values()), max(columns.values())
        if high - low + 1 == len(columns):
            found = cells.numbers(rows, low, np.full(len(rows), len(columns)), number)
            table = found.values.reshape(len(rows), len(columns)).astype(np.float64)
            return {name: table[:, column - low] for name, column in columns.items()}, found.bad
        values: dict[str, Float64] = {}
        bad: dict[int, bytes] = {}
        for name, column in columns.items():
            found = cells.numbers(rows, column, np.ones(len(rows), np.int64), number)
            values[name] = found.values.astype(np.float64)
            bad |= found.bad
        return values, bad

    def _beams(self, scan: ScanColumns, cells: Cells, rows: Int64, view: Int64) -> Int64:
        """Return the number of ranges of each row; -1 where its cells fit no number of beams."""
        count = cells.count[rows]
        named = len(scan.ranges)
        if not scan.open_end:
            return np.where(count <= self.layout.width, named, -1)
        rest = count - scan.first
        regular = count == self.layout.width
        if not named:
            # An empty array is written as one empty cell.
            last = np.where(rest > 0, 1, 0)
            rest = rest - np.array([not cell.strip() for cell in cells.spans(rows, count - 1, last)])
        half = np.where(rest % 2 == 0, rest // 2, -1)
        ranged = half if scan.doubled else rest
        full = np.full(len(rows), named) if named else ranged
        near_half = (half >= 0) & (view >= 0) & (np.abs(half - view) <= 1)
        near_rest = (view >= 0) & (np.abs(rest - view) <= 1)
        other = np.where(near_rest, rest, np.where(near_half & (scan.doubled or not named), half, -1))
        beams: Int64 = np.where(regular, full, np.where((view < 0) & (rest > 0), ranged, other))
        return beams

    def _misfits(self, cells: Cells, rows: Int64, numbers: Int64) -> None:
        for line, count in zip(numbers[rows].tolist(), cells.count[rows].tolist(), strict=True):
            self._damage(line, f"{count} cells where {self.layout.width} are usual: the row is dropped")


def _intensity_columns(scan: ScanColumns, cells: Cells, rows: Int64, beams: Int64, width: int) -> Float32 | None:
    """Return intensities (S, `width`) of rows of so many ranges, NaN for a row without; None where no row has any."""
    count = cells.count[rows]
    if scan.doubled:
        return pad_cells(cells, rows, scan.first + beams, np.where(count >= scan.first + 2 * beams, beams, 0), width)
    columns = scan.intensities
    if not len(columns):
        return None
    first, last = int(columns.min()), int(columns.max())
    spans = np.where(count > last, last + 1 - first, 0)
    values = pad_cells(cells, rows, np.full(len(rows), first), spans, last + 1 - first)
    return None if values is None else pad_intensities([*values[:, columns - first]], width)


def _without_trailing(empty: Bool, beams: Int64, view: Int64) -> Int64:
    """Return beam counts without trailing empty cells a step or more outside of the view; one of 0 is what is filled."""
    filled = np.where(empty.all(axis=1), 0, empty.shape[1] - np.argmin(empty[:, ::-1], axis=1))
    view = np.where((view == 0) | (filled == view + 1), filled, view)
    return np.where((view >= filled) & (view < beams), view, beams)


@dataclass(frozen=True, slots=True)
class _Record:
    """A sweep with its ranges in one cell."""

    line: int
    ranges: bytes
    intensities: bytes
    cells: list[str]
    """All cells, with the number of a list in place of each."""


@dataclass(slots=True)
class ListDecoder(Decoder):
    """Decodes records with their ranges in one cell: `"[1.0, inf, nan]"`, `"array('f', [1.0])"`, `"(1.0, 2.0)"`.

    A record whose quotes are open goes on in the next block.
    """

    _open: list[bytes] = field(default_factory=list)
    _open_line: int = 0
    _open_size: int = 0

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of a block of lines."""
        if not self._scans:
            return
        lines = read_lines(block, None, self.layout.header, self.layout.start, self.report)
        records = []
        for number, line in zip(lines.numbers.tolist(), lines.text.split(b"\n"), strict=False):
            for start, text in self._whole(number, line) if line.strip() else ():
                record = self._read(start, text)
                if record is not None:
                    records.append(record)
        yield from self._sweeps(self._scans[0], records)

    def finish(self) -> Iterator[RawSweeps]:
        """Report a record that is still open at the end."""
        if self._open:
            self._damage(self._open_line, "the file ends within this record")
            self._open = []
        return iter(())

    def _whole(self, number: int, line: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield the records that `line` completes, with their first lines: lists may span lines while a quote is open."""
        odd = line.count(b'"') % 2 == 1
        if not self._open:
            if odd:
                self._open, self._open_line, self._open_size = [line], number, len(line)
            else:
                yield number, line
            return
        if not odd and (b"[" in line or b"(" in line) and self._split(line) is not None:
            # The open quote was damage: do not let it swallow the records that follow.
            self._damage(self._open_line, "a quote without its end: the record is dropped")
            self._open = []
            yield number, line
            return
        self._open.append(line)
        self._open_size += len(line)
        if odd:
            start, text = self._open_line, b" ".join(self._open)
            self._open = []
            yield start, text
        elif len(self._open) > 100_000 or self._open_size > MAX_LINE:
            self._damage(self._open_line, "a quote that never ends: its lines are dropped")
            self._open = []

    def _split(self, text: bytes) -> tuple[list[bytes], list[str]] | None:
        """Return the lists of a record, and its cells with the number of a list in place of each."""
        text = plain_lists(text)
        if self.layout.brackets not in text and text.count(self.layout.dialect.separator) < 2:
            return None
        lists: list[bytes] = []
        plain: list[bytes] = []
        place = 0
        if self.layout.brackets == b"(":
            for match in islice(_PARENTHESES.finditer(text), _MAX_LISTS):
                plain += [text[place : match.start()], b"\x01%d" % len(lists)]
                lists.append(match[1])
                place = match.end()
        else:
            while (begin := text.find(b"[", place)) >= 0 and (end := text.find(b"]", begin)) >= 0:
                if len(lists) == _MAX_LISTS:
                    return None
                plain += [text[place:begin], b"\x01%d" % len(lists)]
                lists.append(text[begin + 1 : end])
                place = end + 1
        plain.append(text[place:])
        if sum(map(len, plain)) > 1 << 20:
            return None
        try:
            cells = csv_cells(b"".join(plain).decode("utf-8", "replace"), self.layout.dialect.separator.decode())
        except ValueError:
            return None
        if self.layout.dialect.trailing and cells and not cells[-1]:
            cells.pop()
        return (lists, cells) if len(cells) == self.layout.width else None

    def _read(self, line: int, text: bytes) -> _Record | None:
        found = self._split(text)
        if found is None:
            self._damage(line, "not a whole record: it is dropped")
            return None
        lists, cells = found
        scan = self.layout.scans[0]
        bare = not self.layout.brackets
        ranges = cells[scan.first].encode() if bare else _list_of(cells[scan.first], lists)
        if ranges is None:
            self._damage(line, f"{shown(cells[scan.first].encode())} is no list of ranges")
            return None
        others = [cells[column] for column in scan.intensities.tolist()]
        intensities = [cell.encode() if bare else _list_of(cell, lists) or b"" for cell in others]
        return _Record(line, ranges, b"".join(intensities), cells)

    def _sweeps(self, scan: ScanColumns, records: list[_Record]) -> Iterator[RawSweeps]:
        parts = [_plain_list(record.ranges) for record in records]
        counts = _counts(parts)
        for rows in split_rows(counts):
            block = self._decode(scan, records[rows], parts[rows], counts[rows])
            if block is not None:
                yield block

    def _decode(
        self, scan: ScanColumns, records: list[_Record], parts: list[bytes], counts: np.ndarray
    ) -> RawSweeps | None:
        found = parse_rows(parts, counts, b",", self._number)
        causes = {row: not_a_number(cell) for row, cell in found.bad.items()}
        known: dict[str, np.ndarray] = {}
        for name in _LIST_GEOMETRY:
            if name in scan.fields:
                known[name], wrong = _numbers([record.cells[scan.fields[name]] for record in records])
                causes = dict.fromkeys(wrong, f"{name} is not a number") | causes

        def column(index: int) -> list[bytes]:
            return [record.cells[index].encode() for record in records]

        stamp, record_ns, untimed = read_times(scan, column, len(records), self.last)
        frames = read_frames(scan, column, len(records))
        if "header" in scan.fields:
            headers = [record.cells[scan.fields["header"]] for record in records]
            if "stamp" not in scan.units and "seconds" not in scan.fields:
                stamp = _header_stamps(headers, stamp)
                record_ns = record_ns if "record" in scan.units else stamp
            if "frame" not in scan.fields:
                named = (_FRAME.search(header) for header in headers)
                frames = encode_frames([b"" if it is None else (it[1] or it[2] or it[3] or "").encode() for it in named])
        causes = dict.fromkeys(np.flatnonzero(untimed).tolist(), NO_TIME) | causes
        for row, cause in sorted(causes.items()):
            self._damage(records[row].line, cause)
        good = np.ones(len(records), np.bool_)
        good[list(causes)] = False
        ranges = pad(found.values, counts, self.options.range_scale)
        parts = [_plain_list(record.intensities) for record in records]
        lengths = _counts(parts)
        strengths = np.split(parse_rows(parts, lengths, b",", np.float32).values, np.cumsum(lengths)[:-1])
        intensities = pad_intensities(strengths, ranges.shape[1])
        return self._block(scan, (stamp, record_ns), frames, known, counts, ranges, good, intensities)


def _list_of(cell: str, lists: list[bytes]) -> bytes | None:
    """Return the text of the list in a cell, empty for an empty list; None where it is no list."""
    _, mark, number = cell.partition("\x01")
    digits = re.match(r"\d+", number)
    if digits is not None and int(digits[0]) < len(lists):
        return lists[int(digits[0])]
    is_empty = not mark and cell.strip().rstrip("()[]'f").strip() in ("", "array", "array('f'")
    return b"" if is_empty else None


def _counts(parts: list[bytes]) -> Int64:
    return np.array([part.count(b",") + 1 if part else 0 for part in parts], np.int64)


def _plain_list(text: bytes) -> bytes:
    """Return the numbers of a list, set apart by commas: numpy's spelling has spaces."""
    text = text.strip().replace(b";", b",").replace(b"|", b",").removesuffix(b",")
    return text if b"," in text else b",".join(text.split())


def _numbers(cells: list[str]) -> tuple[np.ndarray, list[int]]:
    """Return each cell as the float32 a LaserScan holds, and the rows where it is none."""
    values = np.full(len(cells), np.nan)
    wrong = []
    parsed: dict[str, float] = {}
    for row, cell in enumerate(cells):
        if cell not in parsed:
            try:
                number = parse_number(cell.encode())
            except ValueError:
                wrong.append(row)
                continue
            parsed[cell] = np.nan if number is None else number
        values[row] = parsed[cell]
    with np.errstate(over="ignore"):
        return values.astype(np.float32).astype(np.float64), wrong


def _header_stamps(headers: list[str], otherwise: np.ndarray) -> np.ndarray:
    """Return the stamp inside each printed header; the other time where it holds none."""
    stamps = otherwise.copy()
    for row, header in enumerate(headers):
        seconds, rest = _SECONDS.search(header), _NANOSECONDS.search(header)
        if seconds is not None:
            total = int(seconds[1]) * 1_000_000_000 + int(rest[1] if rest else 0)
            if abs(total) < 1 << 63:
                stamps[row] = total
    return stamps
