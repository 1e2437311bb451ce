"""From the cells of a block of lines to sweeps, by column."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.aria.lines import Lines, Read
from lidarcli.logs.aria.points import Points, Readings, by_bearing
from lidarcli.logs.aria.words import Sensor
from lidarcli.logs.base import MAX_BEAMS, OpenOptions, ReadReport
from lidarcli.logs.blocks import TOO_MANY, as_singles, keep_sound, pad, split_rows
from lidarcli.logs.lines import CUT, TELL_BEARINGS, Told, as_told, report_lines
from lidarcli.logs.numbers import not_a_number
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps import Bool, Float32, Float64, Int64, RawSweeps

MILLI = 0.001
"""Metres in the unit of lengths."""
_LEAST_STEP = 0.02
"""No laser has its beams closer to each other [degrees]."""
_FEW, _SPARSE = 1000, 2
"""A sweep of points may have so many beams, or so many for each number in its line, however few points there are."""
FAR_FEWER = "far fewer points than the laser has beams"
_PARTS = 3
"""Numbers of a pose and of a configuration."""


@dataclass(slots=True)
class SweepDecoder:
    """Sweeps of the wanted topics, block by block."""

    options: OpenOptions
    report: ReadReport
    topics: Collection[str] | None
    _told: Told[tuple[str, str]] = field(default_factory=Told)
    _readings: Readings = field(init=False)
    _lines: Lines = field(init=False)

    def __post_init__(self) -> None:
        self._lines = Lines(self.report)
        self._readings = Readings(self.report)

    def feed(self, block: TextBlock) -> Iterator[RawSweeps]:
        """The sweeps of a block, topic by topic."""
        read = self._lines.read(block)
        self._told.add(block.line, read.told)
        bad: list[tuple[int, str]] = []
        cut = len(read.cells.count) - 1 if block.cut else -1
        for sensor in read.sweeps:
            if self.topics is None or sensor.topic in self.topics:
                yield from self._decode(read, sensor, block.line, bad, cut)
        report_lines(self.report, block.line, bad)

    def _decode(
        self, read: Read, sensor: Sensor, line: int, bad: list[tuple[int, str]], cut: int
    ) -> Iterator[RawSweeps]:
        found = read.sweeps[sensor]
        rows = found.rows
        conf = self._told.at((sensor.frame, "conf"), rows + line, _PARTS)
        # A logger that starts before its laser writes zeros.
        conf[~((conf[:, 2] >= 1) & (conf[:, 2] <= 1e9))] = np.nan
        samples = np.nan_to_num(conf[:, 2], nan=-1).astype(np.int64)
        count = read.cells.count[rows] - 1
        points = _are_points(sensor, samples, count)
        # By their bearings points make as many beams as the laser has; in their order they are the beams.
        beams = np.where(points, np.where(samples < 0, count // 2, samples), count)
        good = np.ones(len(rows), np.bool_)
        many = np.maximum(beams, count // 2) > MAX_BEAMS
        if many.any():
            self.report.refused[(sensor.topic, TOO_MANY)] += int(many.sum())
        sparse = points & ~many & (beams > np.maximum(_FEW, _SPARSE * count))
        if sparse.any():
            self.report.refused[(sensor.topic, FAR_FEWER)] += int(sparse.sum())
        odd = points & (count % 2 == 1) & ~many
        bad += [(row, "a point has one number only") for row in rows[odd & (rows != cut)].tolist()]
        if (rows == cut).any():
            bad.append((cut, CUT))
        good &= ~many & ~odd & ~sparse & (rows != cut)
        some = np.flatnonzero(good)
        for part in split_rows(np.maximum(beams, count)[some]):
            which = some[part]
            sound = self._block(read, sensor, which, points[which], beams[which], conf[which], line, bad)
            if sound is not None:
                yield sound

    def _block(
        self,
        read: Read,
        sensor: Sensor,
        which: Int64,
        points: Bool,
        beams: Int64,
        conf: Float64,
        line: int,
        bad: list[tuple[int, str]],
    ) -> RawSweeps | None:
        """Sweeps that may be padded to one width."""
        found = read.sweeps[sensor]
        rows, stamps = found.rows[which], found.stamp_ns[which]
        count = read.cells.count[rows] - 1
        numbers = read.cells.numbers(rows, 1, count, np.float64)
        bad += [(int(rows[row]), not_a_number(cell)) for row, cell in numbers.bad.items()]
        good = np.ones(len(rows), np.bool_)
        good[[*numbers.bad]] = False
        with np.errstate(invalid="ignore", divide="ignore"):
            gaps = np.maximum(conf[:, 2] - 1, 1)
            # ARIA writes -180 degrees as 180: of a full circle hardly any view is left then.
            narrow = np.abs(conf[:, 1] - conf[:, 0]) < _LEAST_STEP * gaps
            begin = np.where(narrow & (conf[:, 2] > 1), conf[:, 0] - 360.0, conf[:, 0])
            first, step = np.radians(begin), np.radians(conf[:, 1] - begin) / gaps
        first, step = as_told(self.options, first, step, beams)
        if points.any():
            # Angles beyond all numbers are refused below.
            with np.errstate(over="ignore", invalid="ignore"):
                first, step, ranges = self._of_points(
                    read, sensor, rows, numbers.values, count, (first, step, beams), points, line
                )
        else:
            ranges = pad(numbers.values, count, MILLI)
        unknown = good & (np.isnan(first) | np.isnan(step))
        if unknown.any():
            cause = f"no angles of {sensor.name}{sensor.number} before it {TELL_BEARINGS}"
            self.report.refused[(sensor.topic, cause)] += int(unknown.sum())
        most = np.inf if self.options.range_max is None else self.options.range_max
        return keep_sound(
            RawSweeps(
                topic=sensor.topic,
                frame_ids=(sensor.frame,),
                frame=np.zeros(len(rows), np.int32),
                stamp_ns=stamps,
                record_ns=stamps,
                angle_min=first,
                angle_increment=step,
                range_min=np.zeros(len(rows), np.float32),
                range_max=np.full(len(rows), most, np.float32),
                beams=beams.astype(np.int32),
                ranges=ranges,
            ),
            good & ~unknown,
            self.report,
        )

    def _of_points(
        self,
        read: Read,
        sensor: Sensor,
        rows: Int64,
        values: Float64,
        count: Int64,
        geometry: tuple[Float64, Float64, Int64],
        points: Bool,
        line: int,
    ) -> tuple[Float64, Float64, Float32]:
        """First bearings, steps and ranges of sweeps of which some or all are `points`."""
        first, step, beams = geometry
        mount = np.nan_to_num(self._told.at((sensor.frame, "pose"), rows + line, _PARTS))
        mount = np.column_stack([mount[:, :2] * MILLI, np.radians(mount[:, 2])])
        sizes = np.where(points, count // 2, 0)
        row = np.repeat(np.arange(len(rows)), sizes)
        place = np.arange(len(row)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        pairs = values[np.repeat(points, count)].reshape(-1, 2) * MILLI
        cloud = Points(pairs[:, 0], pairs[:, 1], row, place, mount)
        last = first + (beams - 1) * step
        how = self._readings.of(
            sensor.topic,
            _number(read.version),
            cloud,
            first[row] + place * step[row],
            last[row] - place * step[row],
        )
        if how.backwards:
            first, step = np.where(points, last, first), np.where(points, -step, step)
        ranges, bearing = cloud.seen(how)
        ranges = np.where(cloud.there, ranges, 0.0)
        flat = np.empty(int(beams.sum()))
        in_order = points & (sizes == beams) & how.in_order
        beam_row = np.repeat(np.arange(len(rows)), beams)
        flat[in_order[beam_row]] = ranges[in_order[row]]
        flat[~points[beam_row]] = values[~np.repeat(points, count)] * MILLI
        turned = points & ~in_order
        if turned.any():
            mine = turned[row]
            cloud = Points(cloud.x[mine], cloud.y[mine], row[mine], place[mine], mount)
            sizes = np.where(turned, beams, 0)
            placed, lost = by_bearing(ranges[mine], bearing[mine], cloud, first, step, sizes)
            flat[turned[beam_row]] = placed
            for at in np.flatnonzero(lost).tolist():
                self.report.add_damage(
                    f"line {line + int(rows[at])}", f"{lost[at]} points are beside the view of the laser"
                )
        return first, step, pad(as_singles(flat), beams, 1.0)


def _are_points(sensor: Sensor, samples: Int64, count: Int64) -> Bool:
    """Which of some lines hold points: two numbers for each sample, or what their tag says where that does not tell."""
    usual = np.full(len(count), sensor.is_points)
    told = (samples > 0) & ((count == samples) | (count == 2 * samples))
    return np.where(told, count == 2 * samples, usual)


def _number(version: bytes) -> int:
    return int(version[:9]) if version.isdigit() else 0
