"""From the cells of a block of lines to sweeps, by column."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.blocks import as_singles, keep_sound, limits_in_metres, pad, split_rows
from lidarcli.logs.lines import (
    CUT,
    TELL_BEARINGS,
    Declared,
    Told,
    as_told,
    declared,
    left_over,
    refuse,
    report_lines,
)
from lidarcli.logs.numbers import Cells, not_a_number
from lidarcli.logs.player.geometry import (
    CONFIG,
    Geometry,
    configuration,
    of_bearings,
    of_laser,
    of_ranger,
    tails,
)
from lidarcli.logs.player.lines import Found, Lines, Names
from lidarcli.logs.player.words import GEOMETRY, RESPONSE, Device, Scan
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps import Int64, RawSweeps

NO_GEOMETRY = f"no geometry in the log {TELL_BEARINGS}"
UNEVEN = "beams that are not evenly spread"


@dataclass(slots=True)
class SweepDecoder:
    """Sweeps of the wanted topics, block by block."""

    options: OpenOptions
    report: ReadReport
    topics: Collection[str] | None
    names: Names = field(default_factory=Names)
    _configs: Told[str] = field(default_factory=Told)
    """Topic of a ranger → its configuration."""
    _lines: Lines = field(init=False)

    def __post_init__(self) -> None:
        self._lines = Lines(self._is_wanted, self.report, self.names)

    def _is_wanted(self, device: Device) -> bool:
        if device.scan is None and not _is_config(device):
            return False
        return self.topics is None or self.names.topic(device) in self.topics

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """The sweeps of a block, topic by topic."""
        cells, found = self._lines.read(block)
        self._configs.add(
            block.line,
            sorted(
                (row, self.names.topic(part.device), values)
                for part in found
                if _is_config(part.device)
                for row, values in configuration(cells, part.rows)
            ),
        )
        bad: list[tuple[int, str]] = []
        cut = len(cells.count) - 1 if block.cut else -1
        for part in found:
            if part.device.scan is not None:
                yield from self._decode(cells, part, part.device.scan, block.line, bad, cut)
        report_lines(self.report, block.line, bad)

    def _decode(
        self, cells: Cells, found: Found, scan: Scan, line: int, bad: list[tuple[int, str]], cut: int
    ) -> Iterator[RawSweeps]:
        """The sweeps of one device in a block of lines that begins at `line`."""
        told = framed(cells, found, scan, bad, cut)
        refuse(self.report, self.names.topic(found.device), told.refused)
        some = np.ones(len(found.rows), np.bool_)
        some[[*told.causes, *told.refused]] = False
        rows, beams, after = found.rows[some], told.beams[some], told.after[some]
        stamps = found.stamp_ns[some]
        for part in split_rows(beams):
            sound = self._block(
                cells, found.device, scan, (rows[part], beams[part], after[part], stamps[part]), line, bad
            )
            if sound is not None:
                yield sound

    def _block(
        self,
        cells: Cells,
        device: Device,
        scan: Scan,
        some: tuple[Int64, Int64, Int64, Int64],
        line: int,
        bad: list[tuple[int, str]],
    ) -> RawSweeps | None:
        """Sweeps that may be padded to one width."""
        rows, beams, after, stamps = some
        scale, topic = self.options.range_scale, self.names.topic(device)
        numbers = cells.numbers(
            rows, scan.count + 1, scan.width * beams, np.float32 if scale == 1.0 else np.float64
        )
        before = len(bad)
        bad += [(int(rows[row]), not_a_number(cell)) for row, cell in numbers.bad.items()]
        uneven = np.zeros(len(rows), np.bool_)
        if device.interface == b"laser":
            known = of_laser(cells, rows, beams, scan, bad)
            if scan.angles:
                first, step, uneven = of_bearings(numbers.values[1 :: scan.width].astype(np.float64), beams)
                known = known._replace(first=first, step=step)
        else:
            known = self._of_ranger(cells, scan, topic, (rows, beams, after), line, bad)
        first, step = as_told(self.options, known.first, known.step, beams)
        good = np.ones(len(rows), np.bool_)
        good[np.isin(rows, [row for row, _ in bad[before:]])] = False
        for without, cause in ((uneven, UNEVEN), (np.isnan(first) | np.isnan(step), NO_GEOMETRY)):
            if (fresh := good & without).any():
                self.report.refused[(topic, cause)] += int(fresh.sum())
                good &= ~fresh
        far = self.options.range_max
        with np.errstate(invalid="ignore"):
            least, most = limits_in_metres(
                np.where(known.least > 0, known.least, 0.0),
                np.where(known.most > 0, known.most, np.inf),
                scale,
            )
        return keep_sound(
            RawSweeps(
                topic=topic,
                frame_ids=(self.names.frame(device),),
                frame=np.zeros(len(rows), np.int32),
                stamp_ns=stamps,
                record_ns=stamps,
                angle_min=first,
                angle_increment=step,
                range_min=least,
                range_max=most if far is None else as_singles(np.full(len(rows), far)),
                beams=beams.astype(np.int32),
                ranges=pad(numbers.values[:: scan.width], beams, scale),
                # A laser tells how strong each return was, behind all else of its beam.
                intensities=pad(numbers.values[scan.width - 1 :: scan.width], beams, 1.0)
                if scan.width > 1
                else None,
            ),
            good,
            self.report,
        )

    def _of_ranger(
        self,
        cells: Cells,
        scan: Scan,
        topic: str,
        some: tuple[Int64, Int64, Int64],
        line: int,
        bad: list[tuple[int, str]],
    ) -> Geometry:
        """What the lines of a ranger tell themselves, else what its configuration does."""
        rows, beams, after = some
        told = self._configs.at(topic, rows + line, CONFIG)
        if scan.tail:
            _, own = tails(cells, rows, after, bad)
            told = np.where(np.isnan(own[:, :1]), told, own)
        return of_ranger(told, beams)


def framed(cells: Cells, found: Found, scan: Scan, bad: list[tuple[int, str]], cut: int) -> Declared:
    """The ranges of sweeps; those that are none are told in `bad`."""
    told = declared(cells, found.rows, scan.count, scan.width)
    if not scan.tail:
        over = cells.count[found.rows] - told.after
        for at in np.flatnonzero(over > 0).tolist():
            told.causes.setdefault(at, left_over(int(over[at]), int(told.beams[at])))
    last = len(found.rows) - 1
    # Of the last line without an end the last number may be cut: only where it is beside a range does that not matter.
    if (
        last >= 0
        and found.rows[last] == cut
        and (scan.width == 1 or not told.beams[last] or last in told.causes)
    ):
        told.causes[last] = CUT
    bad += [(int(found.rows[at]), cause) for at, cause in told.causes.items() if at not in told.refused]
    return told


def _is_config(device: Device) -> bool:
    return device.interface == b"ranger" and device.kind.startswith(RESPONSE) and device.kind != GEOMETRY
