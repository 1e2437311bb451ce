"""From the cells of a block of lines to sweeps, by column."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.blocks import as_singles, keep_sound, limits_in_metres, pad, pad_cells, split_rows
from lidarcli.logs.carmen.lines import Found, Lines
from lidarcli.logs.carmen.parameters import MAX_RANGE, Parameters, geometry
from lidarcli.logs.carmen.words import LASERS, Laser
from lidarcli.logs.lines import MOST_DIGITS, as_told, full_steps, tells_geometry
from lidarcli.logs.numbers import Cells, not_a_number
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps import Float32, Float64, Int64, RawSweeps

_START, _VIEW, _STEP, _MOST = range(4)
_ROUNDED = 6e-7
"""By so much [rad] the sixth decimal of a step may be off."""
_FIRST_OF_GEOMETRY = 2
"""The cell with the first bearing; view, step and greatest range follow."""


@dataclass(slots=True)
class SweepDecoder:
    """Sweeps of the wanted topics, block by block."""

    options: OpenOptions
    report: ReadReport
    topics: Collection[str] | None
    parameters: Parameters = field(default_factory=Parameters)
    _noted: set[str] = field(default_factory=set)
    _lines: Lines = field(init=False)

    def __post_init__(self) -> None:
        wanted = [word for word, laser in LASERS.items() if self.topics is None or laser.topic in self.topics]
        self._lines = Lines(wanted, self.report)

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """The sweeps of a block, topic by topic."""
        cells, found, parameters = self._lines.read(block)
        self.parameters.add(block.line, parameters)
        for part in found:
            for rows in split_rows(part.beams):
                yield from self._decode(cells, part, rows, block.line)

    def _decode(self, cells: Cells, found: Found, some: slice, first_line: int) -> Iterator[RawSweeps]:
        laser = LASERS[found.word]
        rows, beams, stamps = found.rows[some], found.beams[some], found.stamp_ns[some]
        width = 2 if laser.pairs else 1
        scale = self.options.range_scale
        numbers = cells.numbers(
            rows, laser.count + 1, width * beams, np.float32 if scale == 1.0 else np.float64
        )
        bad = dict(numbers.bad)
        if laser.geometry:
            told = cells.numbers(rows, _FIRST_OF_GEOMETRY, np.full(len(rows), 4), np.float64)
            bad |= told.bad
            first, step, most = _of_lines(told.values.reshape(-1, 4), beams)
        else:
            first, step = self._of_parameters(laser, rows + first_line, beams)
            most = np.full(len(rows), MAX_RANGE)
        first, step = as_told(self.options, first, step, beams)
        far = self.options.range_max
        least, greatest = limits_in_metres(np.zeros(len(rows)), most, scale)
        for row, cell in sorted(bad.items()):
            self.report.add_damage(f"line {first_line + int(rows[row])}", not_a_number(cell))
        good = np.ones(len(rows), np.bool_)
        good[[*bad]] = False
        ranges = pad(numbers.values[::width], beams, scale)
        if not laser.geometry:
            cut = self.parameters.at(laser.frame, "max", rows + first_line)
            ranges[ranges == as_singles(cut * scale)[:, None]] = np.inf
        sound = keep_sound(
            RawSweeps(
                topic=laser.topic,
                frame_ids=(laser.frame,),
                frame=np.zeros(len(rows), np.int32),
                stamp_ns=stamps,
                record_ns=stamps,
                angle_min=first,
                angle_increment=step,
                range_min=least,
                range_max=greatest if far is None else as_singles(np.full(len(rows), far)),
                beams=beams.astype(np.int32),
                ranges=ranges,
                intensities=_remissions(cells, found, some, numbers.values),
            ),
            good,
            self.report,
        )
        if sound is not None:
            yield sound

    def _of_parameters(self, laser: Laser, lines: Int64, beams: Int64) -> tuple[Float64, Float64]:
        """First bearing and step of sweeps whose lines hold none."""
        first, step, guessed = geometry(
            beams, *(self.parameters.at(laser.frame, what, lines) for what in ("fov", "resolution"))
        )
        if guessed.any() and laser.topic not in self._noted and not tells_geometry(self.options):
            self._noted.add(laser.topic)
            row = int(np.argmax(guessed))
            degrees = np.degrees([first[row], step[row]])
            self.report.notes.append(
                f"{laser.topic}: no geometry in the log; by its {beams[row]} ranges it is taken to begin at "
                f"{degrees[0]:g} degrees and to go on by {degrees[1]:.4g}; --angle-min and --angle-increment tell better"
            )
        return first, step


def _remissions(cells: Cells, found: Found, some: slice, ranges: NDArray[np.floating]) -> Float32 | None:
    """(S, B) the remissions of `some` messages, NaN where a sweep has fewer of them than ranges; None where none has any.

    They stand behind each of its `ranges`, or behind all of them with their number before them.
    """
    laser, rows, beams = LASERS[found.word], found.rows[some], found.beams[some]
    if laser.pairs:
        return pad(ranges[1::2], beams, 1.0) if len(ranges) else None
    if not laser.geometry:
        return None
    after, fields = found.after[some], found.fields[some]
    count = np.zeros(len(rows), np.int64)
    for row, cell in enumerate(cells.spans(rows, after, np.minimum(fields, 1))):
        if cell.isdigit() and len(cell) <= MOST_DIGITS and int(cell) < fields[row]:
            count[row] = min(int(cell), int(beams[row]))
    if not count.any():
        return None
    return pad_cells(cells, rows, after + 1, count, int(beams.max()))


def _of_lines(told: Float64, beams: Int64) -> tuple[Float64, Float64, Float64]:
    """First bearing, step [rad] and greatest range [m] as the lines tell them; guessed where view and step are zero."""
    first, most = told[:, _START], told[:, _MOST]
    step = full_steps(told[:, _VIEW], told[:, _STEP], beams, _ROUNDED)
    nothing = (told[:, _VIEW] == 0.0) & (told[:, _STEP] == 0.0)
    if nothing.any():
        none = np.full(len(beams), np.nan)
        guessed_first, guessed_step, _ = geometry(beams, none, none)
        first, step = np.where(nothing, guessed_first, first), np.where(nothing, guessed_step, step)
    with np.errstate(invalid="ignore"):
        return first, step, np.where(most > 0, most, MAX_RANGE)
