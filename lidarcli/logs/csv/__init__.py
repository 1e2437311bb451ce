"""CSV as a log: recognised by its first lines, read in blocks of lines, decoded by column.

`table` finds the head of a table, `layouts` and `rplidar` its layout; `sweep_rows` and `beam_rows` decode it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import BinaryIO

import numpy as np

from lidarcli.display.texts import Routine, some_of
from lidarcli.errors import UnreadableError, unreadable
from lidarcli.logs.base import LASERSCAN, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.cells import time_notes, time_unit, to_ns
from lidarcli.logs.csv import beam_rows
from lidarcli.logs.csv.beam_rows import LongDecoder
from lidarcli.logs.csv.layouts import PER_SWEEP, RPLIDAR, Layout, layout_of
from lidarcli.logs.csv.sweep_rows import Decoder, ListDecoder, WideDecoder
from lidarcli.logs.csv.table import other_format, read_head
from lidarcli.logs.joined import natural
from lidarcli.logs.text import FIRST_BLOCK, MAX_LINE, TextBlock, TextLog
from lidarcli.sweeps.types import RawSweeps, concatenate

_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".xy", ".scan", ".gz")
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")

Paths = Sequence[str | os.PathLike[str]]


class CsvLog(TextLog):
    """A CSV file, a stream of CSV text, or many files with one sweep each (a folder, a list of paths)."""

    def __init__(self, source: str | os.PathLike[str] | Paths | BinaryIO, options: OpenOptions | None = None) -> None:
        self._read = 0
        self._files: list[Path] = []
        if isinstance(source, Sequence) and not isinstance(source, str):
            self._files = _in_order([Path(item) for item in source])
            self._open_files(os.fspath(self._files[0].parent) if self._files else "", options)
        elif isinstance(source, str | os.PathLike) and Path(source).is_dir():
            self._files = _sweep_files(Path(source))
            self._open_files(os.fspath(source), options)
        else:
            super().__init__(source, options)
            self._rest = self._text.blocks()
            try:
                self._head = _head(self._rest)
                self._layout = self._recognise(self._head)
            except UnreadableError:
                self.close()
                raise
        name = PER_SWEEP if self._files else self._layout.name
        self.format = f"csv ({name})"
        times = time_notes([unit for scan in self._layout.scans for unit in scan.units.values()])
        layout = self._layout
        passed = [f"columns passed over: {some_of(layout.passed)}"] if layout.passed else []
        timed = any(scan.units or {"seconds", "header"} & scan.fields.keys() for scan in layout.scans)
        units = (
            [f"ranges are {'milli' if layout.scale == 0.001 else 'centi'}metres"]
            if layout.scale and not layout.spelling
            else []
        )
        is_news = times or units or (passed and not timed)
        notes = [f"CSV layout: {name}", *layout.notes, *units, *times, *passed]
        self._note = (str if is_news else Routine)("; ".join(notes))

    def _open_files(self, path: str, options: OpenOptions | None) -> None:
        self.path = path
        self._options = options or OpenOptions()
        self._stream = None
        self.size = sum(file.stat().st_size for file in self._files if file.is_file())
        self._layout, self.compression = self._sniff_files()

    def topics(self) -> list[Topic] | None:
        """Return the scans that the columns hold; none in a table without ranges."""
        return [Topic(scan.topic, LASERSCAN, "csv") for scan in self._layout.scans]

    @property
    def position(self) -> int:
        """Bytes of the source that the last pass has read."""
        return self._read if self._files else super().position

    @property
    def is_long(self) -> bool:
        """True where rows are beams, not sweeps."""
        return self._layout.angle >= 0

    @property
    def is_part(self) -> bool:
        """True where the file may be one of many with one sweep each."""
        return self.is_long and self._layout.name != RPLIDAR

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Return blocks of sweeps in the order of the file."""
        report.notes.append(self._note)
        report.unread.update(self._layout.unread)
        if not self._files:
            return self._sweeps(self._blocks(report), topics, report)
        if topics is None or self._layout.scans[0].topic in topics:
            return _joined(self._sweeps_of_files(report))
        return iter(())

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Return nothing: CSV holds sweeps alone."""
        report.notes.append(self._note)
        return iter(())

    def _sweeps(
        self, blocks: Iterator[TextBlock], topics: Collection[str] | None, report: ReadReport
    ) -> Iterator[RawSweeps]:
        if not any(topics is None or scan.topic in topics for scan in self._layout.scans):
            return
        layout, options = self._layout, self._options
        if layout.scale is not None:
            options = replace(options, range_scale=layout.scale)
        form = LongDecoder if self.is_long else ListDecoder if layout.listed else WideDecoder
        decoder: Decoder = form(layout, options, report, topics)
        for block in blocks:
            yield from map(self._stamped, decoder.feed(block))
        yield from map(self._stamped, decoder.finish())

    def _stamped(self, block: RawSweeps) -> RawSweeps:
        """Stamp a sweep without a time by the name of its file."""
        if PER_SWEEP not in self._layout.name or self._layout.scans[0].units or self.path == "-":
            return block
        stamp = np.full(len(block), stamp_of_name(Path(self.path).name), np.int64)
        return replace(block, stamp_ns=stamp, record_ns=stamp)

    def _blocks(self, report: ReadReport) -> Iterator[TextBlock]:
        """Start a pass: return all blocks, of the first pass those of recognition first."""
        if self._used:
            return super()._blocks(report)
        self._used = True
        self._text.report_to(report)
        return chain(self._head, self._rest)

    def _recognise(self, head: Sequence[TextBlock]) -> Layout:
        """Return the layout by the first lines, never by the name of the file."""
        if not head:
            if self._text.report.damage:
                raise UnreadableError(f"{self.path}: {self._text.report.damage[0].cause}")
            raise UnreadableError(f"{self.path}: empty file")
        text = b"".join(block.text for block in head)
        lines = text.split(b"\n")[:-1]
        if not self._options.columns and (layout := beam_rows.recognise(lines)) is not None:
            return layout
        if (other := other_format(text)) is not None:
            raise UnreadableError(f"{self.path}: {other.refusal}")
        if _is_binary(text[:FIRST_BLOCK]):
            raise UnreadableError(f"{self.path}: neither a known container nor text: not a log")
        return layout_of(read_head(lines, self._options, self.path))

    def _sniff_files(self) -> tuple[Layout, str]:
        """Return layout and compression of the first file that has a layout; that of a whole log is refused."""
        error: UnreadableError | None = None
        for file in self._files:
            try:
                with CsvLog(file, self._options) as log:
                    if not log.is_part:
                        raise UnreadableError(
                            f"{self.path}: {file.name} is a log of its own ({log.format}), not one sweep (bearing,"
                            " range): name the files one by one"
                        )
                    return log._layout, log.compression
            except UnreadableError as err:
                error = error or err
        raise error or UnreadableError(f"{self.path}: no file in it")

    def _sweeps_of_files(self, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield the sweeps of file after file; a bad file is damage and no more."""
        self._read = 0
        for file in self._files:
            met = ReadReport()
            try:
                with CsvLog(file, self._options) as log:
                    if not log.is_part:
                        raise UnreadableError(f"{file}: {log.format}, not one sweep (bearing, range)")
                    found = list(log.scans(None, met))
            except UnreadableError as err:
                report.add_damage(file.name, str(err).removeprefix(f"{file}: "))
                continue
            self._read += log.position
            # The note on the layout is that of all files.
            met.notes.clear()
            report.add(met, f"{file.name}: ")
            yield from found


def _head(blocks: Iterator[TextBlock]) -> list[TextBlock]:
    """Take the first blocks: enough for three lines, or all there is."""
    head: list[TextBlock] = []
    for block in blocks:
        head.append(block)
        if sum(block.text.count(b"\n") for block in head) >= 3 or sum(len(b.text) for b in head) > MAX_LINE:
            break
    return head


def _is_binary(text: bytes) -> bool:
    """Return whether control characters say that this is no text; a few NUL bytes are damage, not a format."""
    control = re.findall(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]", text)
    return len(control) > max(3, len(text) // 20) and b"\0" * len(control) not in text


def _sweep_files(folder: Path) -> list[Path]:
    """Return the files of a folder that may hold a sweep each, in order."""
    with unreadable(folder):
        files = [item for item in folder.iterdir() if item.name[:1] != "." and item.is_file()]
    files = [item for item in files if item.suffix.lower() in _SUFFIXES or not item.suffix.lower().strip(".0123456789")]
    if not files:
        raise UnreadableError(f"{folder}: no file in it that could hold a sweep ({' '.join(_SUFFIXES)})")
    return _in_order(files)


def _in_order(files: Sequence[Path]) -> list[Path]:
    """Sort files by the numbers in their names, so that `scan_9` comes before `scan_10`."""
    stems = [_stem(file.name) for file in files]
    if all(_NUMBER.fullmatch(stem) for stem in stems):
        numbers = [(int(whole), fraction) for whole, _, fraction in (stem.partition(".") for stem in stems)]
        return [file for _, _, file in sorted(zip(numbers, stems, files, strict=True))]
    return sorted(files, key=lambda file: (natural(_stem(file.name)), file.name))


def stamp_of_name(name: str) -> int:
    """Return the time [ns] in the name of a file; 0 where it is no number.

    >>> stamp_of_name("1714555596.445048407.csv"), stamp_of_name("scan_7.csv")
    (1714555596445048407, 0)
    """
    stem = _stem(name)
    unit = time_unit("", [stem.encode()]) if _NUMBER.fullmatch(stem) else None
    return 0 if unit is None else int(to_ns([stem.encode()], unit)[0][0])


def _joined(blocks: Iterator[RawSweeps]) -> Iterator[RawSweeps]:
    """Join small blocks of one topic into larger ones, without letting a wide sweep widen many narrow ones."""
    waiting: list[RawSweeps] = []
    rows = width = 0
    for block in blocks:
        wider = max(width, block.ranges.shape[1])
        alike = wider <= 2 * min([wider, *(b.ranges.shape[1] for b in waiting[:1])])
        if waiting and (rows + len(block) > 256 or (rows + 1) * wider > 1 << 20 or not alike):
            yield concatenate(waiting)
            waiting, rows, wider = [], 0, block.ranges.shape[1]
        waiting.append(block)
        rows, width = rows + len(block), wider
    if waiting:
        yield concatenate(waiting)


def _stem(name: str) -> str:
    for suffix in (".gz", *_SUFFIXES):
        if name.lower().endswith(suffix):
            name = name[: -len(suffix)]
    return name
