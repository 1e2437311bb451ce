"""One sweep per row: rostopic, ros2 topic echo, PlotJuggler, bagpy, and plain wide tables."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.blocks import keep_sound, pad, pad_cells, pad_intensities, split_rows
from lidarcli.logs.csv.dialect import read_lines
from lidarcli.logs.csv.layouts import Columns, Layout, expected_beams
from lidarcli.logs.csv.raw_sweeps import (
    GEOMETRY,
    NO_TIME,
    bad_cell,
    build,
    encode_frames,
    number_type,
    read_times,
)
from lidarcli.logs.numbers import Cells
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps import Bool, Float32, Float64, Int32, Int64, RawSweeps

VIEW = ("angle_min", "angle_max", "angle_increment")


class WideDecoder:
    """Blocks of lines → blocks of sweeps, topic by topic; no state is kept but the usual number of cells."""

    def __init__(
        self, layout: Layout, options: OpenOptions, report: ReadReport, topics: Collection[str] | None
    ) -> None:
        self._layout = layout
        self._options = options
        self._report = report
        self._scans = [scan for scan in layout.scans if topics is None or scan.topic in topics]
        self._usual = layout.width

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """The sweeps of one block."""
        layout = self._layout
        lines = read_lines(block, layout.dialect, layout.header, layout.start, self._report)
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
        if len(rows):
            self._usual = self._usual or int(cells.count[rows[-1]])
        for scan in self._scans:
            yield from self._sweeps(scan, cells, rows, lines.numbers)

    def finish(self) -> Iterator[RawSweeps]:
        """Nothing is left over."""
        return iter(())

    def _drop_cut(self, cells: Cells, rows: Int64, numbers: Int64) -> Int64:
        """Drop the last row where the file ends in the middle of it."""
        last = rows[-1:]
        count = int(cells.count[last[0]])
        usual = self._layout.width or (int(cells.count[rows[-2]]) if len(rows) > 1 else self._usual)
        end = cells.column(last, count - 1)[0].strip()
        if count >= usual and end and end[-1:] not in b".-+eE":
            return rows
        self._report.add_damage(
            f"line {numbers[last[0]]}", f"the file ends within this row ({count} cells): its sweep is dropped"
        )
        return rows[:-1]

    def _sweeps(self, scan: Columns, cells: Cells, rows: Int64, numbers: Int64) -> Iterator[RawSweeps]:
        rows = self._long_enough(scan, cells, rows, numbers)
        if not len(rows):
            return
        known, odd = self._geometry(scan, cells, rows)
        if odd:
            self._bad_cells(odd, numbers[rows])
            keep = np.delete(np.arange(len(rows)), list(odd))
            rows, known = rows[keep], {name: values[keep] for name, values in known.items()}
        view = np.full(len(rows), -1)
        if set(VIEW) <= known.keys():
            view = expected_beams(*(known[name] for name in VIEW))
        beams = self._beams(scan, cells, rows, view)
        fits = beams >= 0
        if not fits.all():
            self._misfits(cells, rows[~fits], numbers)
            rows, beams, view = rows[fits], beams[fits], view[fits]
            known = {name: values[fits] for name, values in known.items()}
        for part in split_rows(beams):
            some = {name: values[part] for name, values in known.items()}
            block = self._decode(scan, cells, rows[part], numbers, some, beams[part], view[part])
            if block is not None:
                yield block

    def _decode(
        self,
        scan: Columns,
        cells: Cells,
        rows: Int64,
        numbers: Int64,
        known: dict[str, Float64],
        beams: Int64,
        view: Int64,
    ) -> RawSweeps | None:
        """Rows of known beam counts → one block, without the rows that turn out to be none."""
        given = beams
        ranges, beams, good, bad = self._ranges(scan, cells, rows, beams, view)
        intensities = _intensities(scan, cells, rows, given, ranges.shape[1])
        stamp, record, untimed = read_times(scan, lambda index: cells.column(rows, index), len(rows))
        self._bad_cells(bad, numbers[rows])
        if untimed is not None:
            for line in numbers[rows[untimed & good]].tolist():
                self._report.add_damage(f"line {line}", NO_TIME)
            good &= ~untimed
        frame: tuple[Int32, tuple[str, ...]] = np.zeros(len(rows), np.int32), ("",)
        if "frame" in scan.fields:
            frame = encode_frames(cells.column(rows, scan.fields["frame"]))
        times = (stamp, record)
        block = build(scan, times, frame, known, beams, ranges, self._options, intensities)
        return keep_sound(block, good, self._report)

    def _ranges(
        self, scan: Columns, cells: Cells, rows: Int64, beams: Int64, view: Int64
    ) -> tuple[Float32, Int64, Bool, dict[int, bytes]]:
        """Ranges, beam counts, which rows are sweeps, and what the others have in place of a number."""
        first, span, order = scan.first, beams, None
        if len(scan.ranges) and not scan.open_end:
            first = int(scan.ranges.min())
            span = np.full(len(rows), int(scan.ranges.max()) + 1 - first)
            order = scan.ranges - first
        found = cells.numbers(rows, first, span, number_type(self._options))
        ranges = pad(found.values, span, self._options.range_scale)
        good = np.ones(len(rows), np.bool_)
        good[list(found.bad)] = False
        empty = None if found.empty is None else pad(found.empty.astype(np.float32), span, 1.0) == 1.0
        if order is not None and len(order) != span[0]:
            ranges = ranges[:, order]
            empty = None if empty is None else empty[:, order]
        elif order is not None and (np.diff(order) != 1).any():
            ranges, empty = ranges[:, order], None if empty is None else empty[:, order]
        if empty is not None and empty.size:
            beams = _without_trailing(empty, beams, np.zeros_like(beams) if scan.to_last else view)
            if self._layout.sparse:
                good &= ~empty.all(axis=1)
        return ranges, beams, good, found.bad

    def _long_enough(self, scan: Columns, cells: Cells, rows: Int64, numbers: Int64) -> Int64:
        need = (
            max([scan.first - 1, *scan.fields.values(), *([] if scan.open_end else scan.ranges.tolist())]) + 1
        )
        enough = cells.count[rows] >= need
        if not enough.all():
            self._misfits(cells, rows[~enough], numbers)
        kept: Int64 = rows[enough]
        return kept

    def _geometry(
        self, scan: Columns, cells: Cells, rows: Int64
    ) -> tuple[dict[str, Float64], dict[int, bytes]]:
        """The geometry of each row, as exact as its message has it, and rows whose geometry is no number."""
        columns = {name: scan.fields[name] for name in GEOMETRY if name in scan.fields}
        number = np.float64 if scan.to_last else np.float32
        if not columns:
            return {}, {}
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

    def _beams(self, scan: Columns, cells: Cells, rows: Int64, view: Int64) -> Int64:
        """The number of ranges of each row; -1 where its cells fit no number of beams."""
        count = cells.count[rows]
        named = len(scan.ranges)
        if not scan.open_end:
            return np.where(count <= self._layout.width, named, -1)
        rest = count - scan.first
        if not self._layout.width:
            return np.where(rest > 0, rest, -1)
        regular = count == self._layout.width
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
        usual = f"{self._usual} are usual" if self._usual else "there should be more"
        for line, count in zip(numbers[rows].tolist(), cells.count[rows].tolist(), strict=True):
            self._report.add_damage(f"line {line}", f"{count} cells where {usual}: the row is dropped")

    def _bad_cells(self, bad: dict[int, bytes], numbers: Int64) -> None:
        for row, cell in sorted(bad.items()):
            bad_cell(self._report, int(numbers[row]), cell)


def _intensities(scan: Columns, cells: Cells, rows: Int64, beams: Int64, width: int) -> Float32 | None:
    """(S, `width`) the intensities of rows of so many ranges, NaN for a row without; None where no row has any."""
    count = cells.count[rows]
    if scan.doubled:
        return pad_cells(
            cells, rows, scan.first + beams, np.where(count >= scan.first + 2 * beams, beams, 0), width
        )
    columns = scan.intensities
    if not len(columns):
        return None
    first, last = int(columns.min()), int(columns.max())
    spans = np.where(count > last, last + 1 - first, 0)
    values = pad_cells(cells, rows, np.full(len(rows), first), spans, last + 1 - first)
    return None if values is None else pad_intensities([*values[:, columns - first]], width)


def _without_trailing(empty: Bool, beams: Int64, view: Int64) -> Int64:
    """Beam counts without trailing empty cells, where the row's own view says that no beam stood there.

    A view of 0 has as many beams as cells are filled.
    """
    filled = np.where(empty.all(axis=1), 0, empty.shape[1] - np.argmin(empty[:, ::-1], axis=1))
    view = np.where(view == 0, filled, view)
    return np.where((view >= filled) & (view < beams), view, beams)
