"""One beam per row: rows with one key, or between two restarts of the bearing, are a sweep on an even grid.

Text of tools for RPLIDAR sensors becomes such rows: start of a sweep, quality, bearing, distance. The sensor counts its
bearings in degrees clockwise, seen from above, and its distances in millimetres; 0 is no return.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.base import MAX_BEAMS, OpenOptions, ReadReport
from lidarcli.logs.blocks import TOO_MANY, given_geometry, pad, split_rows
from lidarcli.logs.cells import Cells, shown
from lidarcli.logs.csv.layouts import DEFAULT_TOPIC, PER_SWEEP, RPLIDAR, Layout, ScanColumns, cut_restarts, unread_times
from lidarcli.logs.csv.sweep_rows import NO_TIME, Decoder, read_frames, read_times
from lidarcli.logs.csv.table import Dialect, Head, PlainLines, read_lines
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64, RawSweeps

_NO_LINES = PlainLines(b"", np.empty(0, np.int64), False)
CUT = "the file ends within this sweep: it is dropped"
CUT_BEAM = "the file ends within this row: its beam is dropped"
CUT_ROW = "the file ends within the first row of a sweep: it is dropped"

ONE_BEAM = "a sweep of one beam, whose increment nobody knows"
UNEVEN = "bearings without a common step"
TURNS = "bearings over more than a turn in one sweep: several layers or sweeps under one key"
BACK = "bearings start over within one sweep: several layers or sweeps under one key"
DOUBLED = "several ranges for most bearings of one sweep: layers or echoes under one key"
MAX_VIEW = 1.1 * TURN
"""Greatest view of a sweep [rad]; a turn whose start and end overlap stays below it."""


@dataclass(frozen=True, slots=True)
class _Rows:
    """Rows of a block by column; texts are kept as codes into their distinct values."""

    angle: Float64
    ranges: NDArray[np.floating]
    texts: dict[int, tuple[Int64, list[bytes]]]

    def column(self, index: int, at: Int64) -> list[bytes]:
        codes, distinct = self.texts[index]
        return [distinct[code] for code in codes[at].tolist()]


@dataclass(slots=True)
class LongDecoder(Decoder):
    """Decodes one beam per row; the lines of the last sweep wait for the next block."""

    _carry: PlainLines = _NO_LINES
    _cut: bool = False
    """True once the text has ended within a line."""
    _broken: bool = False
    _usual: int = 0
    _noted: bool = False
    _numbers: tuple[float, int] | None = None
    """Lowest number of a beam, and the beams from it to the highest one."""

    @property
    def _scan(self) -> ScanColumns:
        return self.layout.scans[0]

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of a block that must be whole."""
        layout = self.layout
        if layout.spelling:
            lines = read_rows(block, layout, self.report)
        else:
            lines = read_lines(block, layout.dialect, layout.header, layout.start, self.report)
        self._cut |= lines.cut
        numbers = np.concatenate([self._carry.numbers, lines.numbers])
        yield from self._take(PlainLines(self._carry.text + lines.text, numbers, lines.cut), last=False)

    def finish(self) -> Iterator[RawSweeps]:
        """Yield the last sweep."""
        yield from self._take(replace(self._carry, cut=self._cut), last=True)

    def _take(self, lines: PlainLines, last: bool) -> Iterator[RawSweeps]:
        self._carry = _NO_LINES
        cells, whole = self._whole_rows(lines)
        if not len(whole):
            return
        rows, good = self._parse(cells, whole, lines.numbers)
        whole = whole[good]
        if not len(whole):
            return
        starts = self._starts(rows)
        ends = np.append(starts[1:], len(rows.angle))
        if not last:
            self._keep(cells, whole[starts[-1] :], lines.numbers)
            starts, ends = starts[:-1], ends[:-1]
        elif self._is_cut(int(ends[-1] - starts[-1])):
            self._damage(lines.numbers[whole[starts[-1]]], CUT)
            starts, ends = starts[:-1], ends[:-1]
        elif self._broken:
            cause = CUT_BEAM if self.layout.key is None else CUT_ROW
            self.report.add_damage(f"after line {lines.numbers[whole[-1]]}", cause)
        if len(starts):
            self._usual = int(ends[-1] - starts[-1])
            yield from self._sweeps(rows, starts, ends, lines.numbers[whole])

    def _whole_rows(self, lines: PlainLines) -> tuple[Cells, Int64]:
        """Find the rows with the right number of cells; the others are damage."""
        cells = Cells(lines.text, self.layout.dialect.separator)
        fits = cells.count == self.layout.width
        if lines.cut and len(fits) and fits[-1]:
            end = cells.column(np.array([len(fits) - 1]), self.layout.width - 1)[0].strip()
            fits[-1] = bool(end) and end[-1:] not in b".-+eE"
        for row in np.flatnonzero(~fits).tolist():
            if cells.length[row]:
                if lines.cut and row == len(fits) - 1:
                    self._broken = True
                    continue
                usual = self.layout.width
                self._damage(lines.numbers[row], f"{cells.count[row]} cells where {usual} are usual: the row is dropped")
        return cells, np.flatnonzero(fits)

    def _is_cut(self, beams: int) -> bool:
        """Return whether the last sweep has lost its end: the text stops well before the usual end, or within a row."""
        if self.layout.key is None or not self._cut:
            # Who stops a recording does so within a turn, and beams without a return may not be written.
            return False
        if self._broken:
            # With as many beams as the sweep before, it is whole, and the broken row would begin the next.
            return self._usual == 0 or beams < self._usual
        return beams < 0.9 * self._usual

    def _parse(self, cells: Cells, whole: Int64, numbers: Int64) -> tuple[_Rows, NDArray[np.intp]]:
        """Return the columns of `whole` rows, and which of these could be parsed."""
        layout = self.layout
        wanted = {*self._scan.fields.values(), *([] if layout.key is None else [layout.key])}
        wanted |= {layout.flag} if layout.flag >= 0 else set()
        wanted -= {layout.angle, self._scan.first}
        ones = np.ones(len(whole), np.int64)
        angle = cells.numbers(whole, layout.angle, ones, np.float64)
        ranges = cells.numbers(whole, self._scan.first, ones, self._number)
        bad = angle.bad | ranges.bad
        self._bad_cells(bad, numbers[whole])
        good = np.delete(np.arange(len(whole)), list(bad))
        texts = {column: cells.codes(whole[good], column) for column in sorted(wanted)}
        bearing = angle.values[good]
        if layout.degrees or (self.options.angle_scale != 1.0 and not layout.numbered):
            self.options.used.update([] if layout.degrees else ["angle_scale"])
            bearing = np.deg2rad(bearing)
        if layout.clockwise:
            bearing = 0.0 - bearing
        return _Rows(bearing, ranges.values[good], texts), good

    def _starts(self, rows: _Rows) -> Int64:
        """Return the first row of each sweep."""
        if self.layout.flag >= 0:
            codes, distinct = rows.texts[self.layout.flag]
            return cut_turns(rows.angle, np.array([cell == b"1" for cell in distinct], np.bool_)[codes])
        if self.layout.key is None:
            return cut_restarts(rows.angle)
        codes = rows.texts[self.layout.key][0]
        return np.concatenate([np.zeros(1, np.int64), np.flatnonzero(np.diff(codes)) + 1])

    def _keep(self, cells: Cells, rows: Int64, numbers: Int64) -> None:
        """Keep the lines of the last sweep, unless it has grown beyond all bounds."""
        if len(rows) > MAX_BEAMS:
            self.report.refused[(self._scan.topic, TOO_MANY)] += 1
        else:
            text = b"".join(line + b"\n" for line in cells.spans(rows, 0, self.layout.width))
            self._carry = PlainLines(text, numbers[rows], False)

    def _bearings(self, number: Float64) -> Float64:
        """Return the bearings [rad] of beams by their numbers; the first sweeps tell how many there are."""
        if self._numbers is None:
            known = number[np.isfinite(number)]
            low, high = (known.min(), known.max()) if len(known) else (0.0, 0.0)
            self._numbers = float(low), int(min(high - low, MAX_BEAMS)) + 1
        first, step = given_geometry(self.options, self._numbers[1]) or (np.nan, np.nan)
        return np.asarray(first + step * (number - self._numbers[0]))

    def _sweeps(self, rows: _Rows, starts: Int64, ends: Int64, numbers: Int64) -> Iterator[RawSweeps]:
        angle = rows.angle
        if self.layout.clockwise:
            angle = within_turns(angle, starts)
        elif self.layout.numbered:
            angle = self._bearings(angle)
        begin, end = int(starts[0]), int(ends[-1])
        parts, first, step, causes, gridded = even_sweeps(
            angle[begin:end], rows.ranges[begin:end], starts - begin, ends - starts
        )
        if gridded and not self._noted:
            self._noted = True
            self.report.notes.append("bearings are not evenly spaced: beams are placed on a grid, gaps have no range")
        if self.layout.numbered:
            # Numbers with gaps are those of the sensor; without, they may be places in a list.
            (self.report.numbered.discard if self._noted else self.report.numbered.add)(self._scan.topic)
        for cause in filter(None, causes):
            self.report.refused[(self._scan.topic, cause)] += 1
        kept = np.array([not cause for cause in causes], np.bool_)
        parts, starts = [part for part, good in zip(parts, kept.tolist(), strict=True) if good], starts[kept]
        geometry = {"angle_min": first[kept], "angle_increment": step[kept]}
        column = partial(rows.column, at=starts)
        stamp, record, untimed = read_times(self._scan, column, len(starts), self.last)
        for line in numbers[starts[untimed]].tolist():
            self._damage(line, NO_TIME)
        codes, names = read_frames(self._scan, column, len(starts))
        lengths = np.array([*map(len, parts)], np.int64)
        for some in split_rows(lengths):
            block = self._block(
                self._scan,
                (stamp[some], record[some]),
                (codes[some], names),
                {name: values[some] for name, values in geometry.items()},
                lengths[some],
                pad(np.concatenate(parts[some]), lengths[some], self.options.range_scale),
                ~untimed[some],
            )
            if block is not None:
                yield block


def cut_turns(angle: Float64, begins: Bool) -> Int64:
    """Return the first row of each sweep in rows of which some are flagged as such.

    A flag may stand on the last beam before the bearing starts over, where beams were sorted by bearing. Where flags
    are missing, and sweeps would go on for more than a turn, these are cut by their bearings.

    >>> cut_turns(np.array([0.1, 3.0, 6.2, 0.2, 3.0, 6.1]), np.array([False, False, True, False, False, False])).tolist()
    [0, 3]
    """
    start = np.zeros(1, np.int64)
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.abs(np.diff(angle))
        usual = steps <= 1.5 * np.median(np.minimum(steps, np.abs(TURN - steps))) if len(steps) else steps > 0
        ahead, behind = np.append(steps, np.inf), np.append(False, usual)
        flags = np.flatnonzero(begins)
        # What ends a turn goes on as the turn did, and the bearing, if any follows, starts over.
        flags = flags + (behind[flags] & (ahead[flags] > 0.5 * TURN))
        flags = flags[flags < len(angle)]
        if not len(flags):
            return cut_restarts(angle)
        flags = np.unique(np.concatenate([start, flags]))
        turned = np.unwrap(angle)
        ends = np.append(flags[1:], len(angle))
        long = np.abs(turned[ends - 1] - turned[flags]) > MAX_VIEW
    parts = [cut_restarts(angle[flags[at] : ends[at]]) + flags[at] for at in np.flatnonzero(long).tolist()]
    return np.unique(np.concatenate([flags, *parts]))


def within_turns(angle: Float64, starts: Int64) -> Float64:
    """Return bearings (K,) that begin within half a turn to either side in each sweep, and go on without a jump."""
    with np.errstate(invalid="ignore", over="ignore"):
        turned = np.unwrap(angle)
        offset = TURN * np.rint(turned[starts] / TURN)
        within: Float64 = turned - np.repeat(offset, np.diff(np.append(starts, len(angle))))
    return within


def even_sweeps(
    angle: Float64, values: NDArray[np.floating], starts: Int64, lengths: Int64
) -> tuple[list[NDArray[np.floating]], Float64, Float64, list[str], bool]:
    """Return sweeps of even step.

    Parameters
    ----------
    angle, values : (K,) bearings [rad] and ranges of the rows of many sweeps, one after the other
    starts, lengths : (S,) first row and rows of each sweep, the first one at row 0

    Returns
    -------
    values : of each sweep, in steps
    first, step : (S,) first bearing and step [rad]
    causes : (S,) the reason for each sweep that is none, else ''
    gridded : True where some bearings are not even
    """
    first = angle[starts]
    steps = np.maximum(lengths - 1, 1)
    place = np.arange(len(angle)) - np.repeat(starts, lengths)
    with np.errstate(invalid="ignore", over="ignore"):
        step = (angle[starts + lengths - 1] - first) / steps
        off = np.abs(angle - (np.repeat(first, lengths) + place * np.repeat(step, lengths)))
        # No bearing is more than a quarter of a step off its place.
        even = np.maximum.reduceat(off, starts) <= 0.25 * np.abs(step)
        even &= (lengths > 1) & (np.abs(step) * steps <= MAX_VIEW)
    first, step = _snap(first, first, np.ones(len(first))), _snap(step, first, steps)
    parts, causes = np.split(values, starts[1:]), [""] * len(starts)
    for sweep in np.flatnonzero(~even).tolist():
        at = int(starts[sweep])
        grid = _on_grid(angle[at : at + int(lengths[sweep])], parts[sweep])
        if isinstance(grid, str):
            causes[sweep] = grid
        else:
            parts[sweep], first[sweep], step[sweep] = grid
    return parts, first, step, causes, not even.all()


def _snap(values: Float64, angles: Float64, steps: NDArray[np.floating]) -> Float64:
    """Return angles as the float32 of the sensor's message, where they differ from it by the rounding of decimals alone."""
    with np.errstate(over="ignore", invalid="ignore"):
        single = values.astype(np.float32).astype(np.float64)
        slack = 16 * np.finfo(np.float64).eps * np.maximum(np.abs(angles), np.pi) / steps
        return np.where(np.abs(values - single) <= slack, single, values)


def _on_grid(angle: Float64, values: NDArray[np.floating]) -> tuple[NDArray[np.floating], float, float] | str:
    """Return ranges on a grid of the median step, first bearing and step, or the reason why there is no such grid."""
    known = np.isfinite(angle)
    if known.sum() < 2:
        return ONE_BEAM if len(angle) == 1 else UNEVEN
    turned = np.unwrap(angle[known])
    if np.ptp(turned) > MAX_VIEW:
        return TURNS
    if len(cut_restarts(turned)) > 1:
        return BACK
    values = values[known]
    steps = np.diff(turned)
    descending = np.median(steps) < 0
    order = np.argsort(turned, kind="stable")
    turned, values = turned[order], values[order]
    gaps = np.diff(turned)
    if (gaps <= 1e-9).mean() > 0.25:
        return DOUBLED
    gaps = gaps[gaps > 1e-9]
    step = float(np.median(gaps))
    place = np.rint((turned - turned[0]) / step)
    if place[-1] >= min(4 * len(turned) + 16, MAX_BEAMS):
        return UNEVEN
    step = float((turned[-1] - turned[0]) / place[-1])
    place = np.rint((turned - turned[0]) / step).astype(np.int64)
    grid = np.full(int(place[-1]) + 1, np.nan, values.dtype)
    # Of two beams on one place the nearer counts, and any return before none.
    with np.errstate(invalid="ignore"):
        far = np.where(values > 0, values, np.inf)
    order = np.lexsort((far, place))[::-1]
    grid[place[order]] = values[order]
    if descending:
        return grid[::-1], float(turned[-1]), -step
    return grid, float(turned[0]), step


PRINTED = "lines of theta, Dist, Q"
MEASURED = "lines of new_scan, quality, angle, distance"
LISTED = "lists of quality, angle, distance"
SAVED = "turns as frame_grabber saves them"

_NUMBER = rb"\d++(?:\.\d*+)?+"
_PRINTED = re.compile(
    rb"[ \t]*+(?:(S)[ \t]*+)?theta:[ \t]*+(%s)[ \t]++Dist:[ \t]*+(%s)[ \t]++Q:[ \t]*+(\d++)[ \t]*+" % (_NUMBER, _NUMBER)
)
_MEASURED = re.compile(rb"\s*\(?(?:True|False)[ \t,;]+\d+[ \t,;]+%s[ \t,;]+%s\)?\s*" % (_NUMBER, _NUMBER))
_NEW_SCAN = re.compile(rb"\W*new_scan\W+quality\W+angle\W+distance\W*", re.IGNORECASE)
_LISTED = re.compile(rb"\s*\[\(\d+(?:\.\d*)?, ?%s, ?%s\)(?:,|\])" % (_NUMBER, _NUMBER))
_BEAM = re.compile(rb"(\d+)[ \t,;]+(%s)[ \t,;]+(%s)" % (_NUMBER, _NUMBER))
_SAVED = re.compile(rb"\s*#\s*RPLIDAR\s+SCAN\s+DATA\b", re.IGNORECASE)
_NAMES = {b"angle": "angle", b"angule": "angle", b"distance": "distance", b"quality": "quality", b"time": "time"}
_WORD = re.compile(rb"[A-Za-z]+")


def recognise(lines: Sequence[bytes]) -> Layout | None:
    """Return the layout of a text that begins with `lines`, where a tool for RPLIDAR sensors has written it; else None."""
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    for number, line in numbered[:100]:
        if _PRINTED.fullmatch(line):
            return _layout(PRINTED, number, 1, 2)
    if not numbered:
        return None
    if _SAVED.match(numbered[0][1]):
        return _saved(numbered)
    data = [(number, line) for number, line in numbered if line.lstrip()[:1] != b"#"]
    if not data:
        return None
    if len(data) > 1 and _NEW_SCAN.fullmatch(data[0][1]):
        data.pop(0)
    start, first = data[0]
    if _MEASURED.fullmatch(first) and _are_beams([line for _, line in data]):
        return _layout(MEASURED, start, 2, 3)
    if _LISTED.match(first) and _are_beams([line for _, line in data]):
        return _layout(LISTED, start, 2, 3)
    return None


def _layout(spelling: str, start: int, angle: int, distance: int, width: int = 4) -> Layout:
    notes = ["bearings run clockwise, distances are millimetres"]
    name = f"{RPLIDAR}, {PER_SWEEP}" if spelling == SAVED else RPLIDAR
    if spelling != SAVED:
        notes.append("no times: all stamps are 0")
    return Layout(
        name,
        Dialect(b" "),
        start,
        width=width,
        scans=(ScanColumns(DEFAULT_TOPIC, {}, first=distance),),
        angle=angle,
        degrees=True,
        clockwise=True,
        flag=0,
        spelling=spelling,
        scale=0.001,
        notes=(spelling, *notes),
    )


def _saved(numbered: Sequence[tuple[int, bytes]]) -> Layout | None:
    """Return the layout of saved turns, whose comments name the columns; None where they do not."""
    names: list[str] = []
    for number, line in numbered:
        if line.lstrip()[:1] != b"#":
            if not {"angle", "distance"} <= set(names):
                return None
            # Before the columns of the file stands the flag of a turn.
            names = ["", *names]
            rows = [[b"", *_plain(row).split()] for _, row in numbered if row.lstrip()[:1] != b"#"]
            head = Head("", Dialect(b" "), names, b"", number, [], rows, OpenOptions())
            layout = _layout(SAVED, number, names.index("angle"), names.index("distance"), len(names))
            fields = {"record": names.index("time")} if "time" in names else {}
            scan = replace(layout.scans[0], fields=fields, units=head.units(fields))
            return replace(layout, scans=(scan,), unread=unread_times(head, [scan]))
        words = [_NAMES.get(word.lower(), "") for word in _WORD.findall(line)]
        if words and all(words):
            names = words
    return None


def _are_beams(lines: Sequence[bytes]) -> bool:
    """Return whether triples of numbers may be quality, angle and millimetres."""
    beams = [map(float, beam) for line in lines for beam in _BEAM.findall(line[: 64 << 10])]
    quality, angle, distance = np.array([[*beam] for beam in beams], np.float64).T
    returns = distance[distance > 0]
    return bool(
        np.mean((quality <= 255.0) & (angle <= 361.0)) >= 0.9
        # Of distances in millimetres most are above 0.1 m, and a damaged beam in ten is no reason to doubt.
        and (np.median(returns) > 100.0 if len(returns) else True)
    )


def read_rows(block: TextBlock, layout: Layout, report: ReadReport) -> PlainLines:
    """Return the rows of a block: 1 where a sweep begins, else 0, and the numbers of a beam, set apart by spaces."""
    lines = read_lines(block, None, b"", layout.start, report)
    if layout.spelling == LISTED:
        return _listed(lines, report)
    if layout.spelling == PRINTED:
        text = _printed(lines.text)
    elif layout.spelling == MEASURED:
        text = _plain(lines.text).replace(b"True", b"1").replace(b"False", b"0")
    else:
        text = _begun(block, lines, _plain(lines.text))
    return PlainLines(text, lines.numbers, lines.cut)


def _plain(text: bytes) -> bytes:
    """Return numbers set apart by one space each."""
    text = text.translate(bytes.maketrans(b"(),;\t", b"     "))
    if b"  " in text or b" \n" in text or b"\n " in text or text[:1] == b" ":
        text = b"".join(b" ".join(line.split()) + b"\n" for line in text.split(b"\n")[:-1])
    return text


def _printed(text: bytes) -> bytes:
    # What the SDK prints has always the same blanks: nothing is looked for line by line.
    plain = text.replace(b"S  theta: ", b"1 ").replace(b"   theta: ", b"0 ").replace(b" Dist: ", b" ")
    plain = plain.replace(b" Q: ", b" ").replace(b" \n", b"\n")
    if b"t" not in plain and b"  " not in plain:
        return plain
    rows = []
    for line in text.split(b"\n")[:-1]:
        match = _PRINTED.fullmatch(line)
        flag = b"1" if match and match[1] else b"0"
        rows.append(b" ".join([flag, *match.group(2, 3, 4)]) if match else line)
    return b"".join(row + b"\n" for row in rows)


def _begun(block: TextBlock, lines: PlainLines, text: bytes) -> bytes:
    """Begin rows with 1 below a title, which stands before each sweep, else with 0."""
    rows = text.split(b"\n")[:-1]
    flags = [b"0 "] * len(rows)
    if b"#" in block.text:
        titles = [n for n, line in enumerate(block.text.split(b"\n"), block.line) if _SAVED.match(line)]
        for row in np.searchsorted(lines.numbers, titles).tolist():
            if row < len(flags):
                flags[row] = b"1 "
    return b"".join(flag + row + b"\n" for flag, row in zip(flags, rows, strict=True))


def _listed(lines: PlainLines, report: ReadReport) -> PlainLines:
    """Make a row of each beam of each list."""
    rows: list[bytes] = []
    counts = np.zeros(len(lines.numbers), np.int64)
    for at, (number, raw) in enumerate(zip(lines.numbers.tolist(), lines.text.split(b"\n"), strict=False)):
        line = raw.strip()
        if lines.cut and at == len(counts) - 1 and not line.endswith(b"]"):
            report.add_damage(f"line {number}", "the file ends within this line: its sweep is dropped")
        elif not line.startswith(b"[(") or not line.endswith(b")]"):
            if line not in (b"", b"[]"):
                report.add_damage(f"line {number}", f"{shown(line)} is no list of beams")
        else:
            beams = line[2:-2].replace(b" ", b"").split(b"),(")
            counts[at] = len(beams)
            rows.append(b"1 " + b"\n0 ".join(beams).replace(b",", b" ") + b"\n")
    return PlainLines(b"".join(rows), np.repeat(lines.numbers, counts), False)
