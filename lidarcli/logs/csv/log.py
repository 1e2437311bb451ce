"""CSV as a log: whatever its layout, it is read in blocks of lines and decoded by column.

`recognise` says from the first lines what a file is; `wide_form`, `list_form` and `long_form` decode it.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import BinaryIO, Protocol

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import LASERSCAN, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.csv import rplidar
from lidarcli.logs.csv.dialect import other_format
from lidarcli.logs.csv.layouts import PER_SWEEP, RPLIDAR, Layout
from lidarcli.logs.csv.long_form import LongDecoder
from lidarcli.logs.csv.named import recognise
from lidarcli.logs.csv.row_forms import ListDecoder, WideDecoder
from lidarcli.logs.text import FIRST_BLOCK, MAX_LINE, TextBlock, TextSource
from lidarcli.logs.times import time_notes, time_unit, to_ns
from lidarcli.sweeps import RawSweeps, concatenate

Paths = Sequence[str | os.PathLike[str]]


class Decoder(Protocol):
    """Lines in, sweeps out."""

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]: ...

    def finish(self) -> Iterator[RawSweeps]: ...


class CsvLog:
    """A CSV file, a stream of CSV text, or many files with one sweep each (a folder, a list of paths)."""

    def __init__(
        self, source: str | os.PathLike[str] | Paths | BinaryIO, options: OpenOptions | None = None
    ) -> None:
        self._options = options or OpenOptions()
        self._files: list[Path] = []
        self._stream: BinaryIO | None = None
        self._once = False
        self._used = False
        self._read = 0
        if isinstance(source, (str, os.PathLike)):
            self.path = os.fspath(source)
            if Path(self.path).is_dir():
                self._files = sweep_files(Path(self.path))
        elif isinstance(source, Sequence):
            self._files = in_order([Path(item) for item in source])
            self.path = os.fspath(self._files[0].parent) if self._files else ""
        else:
            self.path, self._stream, self._once = "-", source, True
        if self._files:
            self.size: int | None = sum(file.stat().st_size for file in self._files if file.is_file())
            self._layout, self.compression = self._sniff_files()
        else:
            self._text, self.size = self._open()
            self.compression = self._text.compression
            self._blocks = self._text.blocks()
            try:
                self._head = _head(self._blocks)
                self._layout = self._recognise(self._head)
            except UnreadableError:
                self.close()
                raise
        name = PER_SWEEP if self._files else self._layout.name
        self.format = f"csv ({name})"
        times = time_notes(unit for scan in self._layout.scans for unit in scan.units.values())
        self._note = "; ".join([f"CSV layout: {name}", *self._layout.notes, *times])

    def topics(self) -> list[Topic] | None:
        """The scans that the columns hold; none in a table without ranges."""
        return [Topic(scan.topic, LASERSCAN, "csv") for scan in self._layout.scans]

    @property
    def position(self) -> int:
        """Where the last pass stands [bytes]."""
        return self._read if self._files else self._text.position

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Blocks of sweeps in the order of the file."""
        report.notes.append(self._note)
        if self._files:
            if topics is None or self._layout.scans[0].topic in topics:
                yield from join_blocks(self._sweeps_of_files(report))
            return
        blocks = self._start_over(report)
        if not any(topics is None or scan.topic in topics for scan in self._layout.scans):
            return
        decoder = self._decoder(topics, report)
        for block in blocks:
            yield from map(self._stamped, decoder.feed(block))
        yield from map(self._stamped, decoder.finish())

    @property
    def is_long(self) -> bool:
        """Whether rows are beams, not sweeps."""
        return self._layout.angle >= 0

    @property
    def is_part(self) -> bool:
        """Whether it may be one of many files with one sweep each."""
        return self.is_long and self._layout.name != RPLIDAR

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Nothing: CSV holds no other messages."""
        report.notes.append(self._note)
        return iter(())

    def close(self) -> None:
        """Release the file, if it is ours."""
        if self._stream is not None and not self._once:
            self._stream.close()
            self._stream = None

    def __enter__(self) -> CsvLog:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _stamped(self, block: RawSweeps) -> RawSweeps:
        """A sweep without a time is stamped by the name of its file."""
        if PER_SWEEP not in self._layout.name or self._layout.scans[0].units or self.path == "-":
            return block
        stamp = np.full(len(block), stamp_of_name(Path(self.path).name), np.int64)
        return replace(block, stamp_ns=stamp, record_ns=stamp)

    def _decoder(self, topics: Collection[str] | None, report: ReadReport) -> Decoder:
        layout, options = self._layout, self._options
        if layout.scale is not None:
            options = replace(options, range_scale=layout.scale)
        if self.is_long:
            return LongDecoder(layout, options, report)
        if layout.listed:
            return ListDecoder(layout, options, report, topics)
        return WideDecoder(layout, options, report, topics)

    def _open(self) -> tuple[TextSource, int | None]:
        size = None
        try:
            if self._stream is None:
                self._stream = Path(self.path).open("rb")  # noqa: SIM115 (closed by close)
                status = os.fstat(self._stream.fileno())
                if stat.S_ISREG(status.st_mode):
                    size = status.st_size
                else:
                    self._once = True
            return TextSource(self._stream, size), size
        except OSError as err:
            raise UnreadableError(f"{self.path}: cannot be read: {err.strerror or err}") from err

    def _start_over(self, report: ReadReport) -> Iterator[TextBlock]:
        """The blocks from the first one on; a stream has them once."""
        head, blocks = self._head, self._blocks
        if self._used:
            if self._once:
                raise UnreadableError(f"{self.path}: a stream can be read only once")
            self.close()
            self._text, _ = self._open()
            head, blocks = [], self._text.blocks()
        self._used = True
        self._text.report_to(report)
        return chain(head, blocks)

    def _recognise(self, head: Sequence[TextBlock]) -> Layout:
        if not head:
            if self._text.report.damage:
                raise UnreadableError(f"{self.path}: {self._text.report.damage[0].cause}")
            raise UnreadableError(f"{self.path}: empty file")
        text = b"".join(block.text for block in head)
        if (layout := rplidar.recognise(text.split(b"\n")[:-1])) is not None:
            return layout
        if (other := other_format(text)) is not None:
            raise UnreadableError(f"{self.path}: {other.refusal}")
        if _is_binary(text[:FIRST_BLOCK]):
            raise UnreadableError(f"{self.path}: neither a known container nor text: not a log")
        return recognise(text.split(b"\n")[:-1], self._options, self.path)

    def _sniff_files(self) -> tuple[Layout, str]:
        """The layout of the first file that has one; that of a whole log is refused."""
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
        """The sweeps of file after file; a bad file is damage and no more."""
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
    """The first blocks: enough for three lines, or all there is."""
    head: list[TextBlock] = []
    for block in blocks:
        head.append(block)
        if sum(block.text.count(b"\n") for block in head) >= 3 or sum(len(b.text) for b in head) > MAX_LINE:
            break
    return head


def _is_binary(text: bytes) -> bool:
    """Whether control characters say that this is no text; a few NUL bytes are damage, not a format."""
    control = re.findall(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]", text)
    return len(control) > max(3, len(text) // 20) and b"\0" * len(control) not in text


SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".xy", ".scan", ".gz")
"""Files of a folder that are read; others (a README.md) are passed over."""

_NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
_BLOCK_SWEEPS = 256
_BLOCK_VALUES = 1 << 20


def sweep_files(folder: Path) -> list[Path]:
    """The files of a folder that may hold a sweep each, in order."""
    try:
        files = [item for item in folder.iterdir() if item.name[:1] != "." and item.is_file()]
    except OSError as err:
        raise UnreadableError(f"{folder}: cannot be read: {err.strerror or err}") from err
    files = [
        item
        for item in files
        if item.suffix.lower() in SUFFIXES or not item.suffix.lower().strip(".0123456789")
    ]
    if not files:
        raise UnreadableError(f"{folder}: no file in it that could hold a sweep ({' '.join(SUFFIXES)})")
    return in_order(files)


def in_order(files: Sequence[Path]) -> list[Path]:
    """Files by the numbers in their names, so that `scan_9` comes before `scan_10`."""
    stems = [_stem(file.name) for file in files]
    if all(_NUMBER.fullmatch(stem) for stem in stems):
        return [file for _, _, file in sorted(zip(map(_exact, stems), stems, files, strict=True))]
    return sorted(files, key=lambda file: (_natural(_stem(file.name)), file.name))


def stamp_of_name(name: str) -> int:
    """A file's name as a time [ns] where it is a number, else 0.

    >>> stamp_of_name("1714555596.445048407.csv"), stamp_of_name("scan_7.csv")
    (1714555596445048407, 0)
    """
    stem = _stem(name)
    unit = time_unit("", [stem.encode()]) if _NUMBER.fullmatch(stem) else None
    return 0 if unit is None else int(to_ns([stem.encode()], unit)[0][0])


def join_blocks(blocks: Iterator[RawSweeps]) -> Iterator[RawSweeps]:
    """Join small blocks of one topic into larger ones, without letting a wide sweep widen many narrow ones."""
    waiting: list[RawSweeps] = []
    rows = width = 0
    for block in blocks:
        wider = max(width, block.ranges.shape[1])
        alike = wider <= 2 * min([wider, *(b.ranges.shape[1] for b in waiting[:1])])
        if waiting and (rows + len(block) > _BLOCK_SWEEPS or (rows + 1) * wider > _BLOCK_VALUES or not alike):
            yield concatenate(waiting)
            waiting, rows, wider = [], 0, block.ranges.shape[1]
        waiting.append(block)
        rows, width = rows + len(block), wider
    if waiting:
        yield concatenate(waiting)


def _stem(name: str) -> str:
    for suffix in (".gz", *SUFFIXES):
        if name.lower().endswith(suffix):
            name = name[: -len(suffix)]
    return name


def _exact(stem: str) -> tuple[int, str]:
    """Numbers as written, in the order of their values: `-` aside, whole part then fraction."""
    whole, _, fraction = stem.partition(".")
    return int(whole), fraction


def _natural(stem: str) -> list[tuple[int, int, str]]:
    parts = re.split(r"(\d+)", stem)
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts if part]
