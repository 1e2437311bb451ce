"""One log through the formalism into tables: files in, files out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from lidarcli.errors import NoScanError
from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.logs.base import CsvOptions, Log
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.inputs import Source
from lidarcli.pipeline.opening import open_source
from lidarcli.pipeline.posing import Posing
from lidarcli.pipeline.summary import RunSummary
from lidarcli.pipeline.topics import absent, choose, nothing_read, scan_topics
from lidarcli.sweeps import SweepBatch
from lidarcli.tables.files import TableFiles, refuse_existing, table_path
from lidarcli.tables.metadata import table_metadata
from lidarcli.tables.order import TopicOrder
from lidarcli.tables.rows import beams_rows, objects_rows, sweeps_rows
from lidarcli.tables.schemas import OBJECTS
from lidarcli.tables.stream import RowStream

Progress = Callable[[int], None]
"""Called with the position in the source [bytes]."""


@dataclass(frozen=True, slots=True)
class DetectOptions:
    """Everything that `detect` lets a user choose, apart from inputs and outputs."""

    parameters: Parameters = field(default_factory=Parameters)
    read: ReadOptions = field(default_factory=ReadOptions)
    csv: CsvOptions = field(default_factory=CsvOptions)
    pose: str | None = None
    """Topic whose poses to take, `none` for no poses; by default the best there is."""
    beams: bool = False
    """Also write the beams table."""
    overwrite: bool = False

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables to write."""
        return ("objects", "sweeps", "beams") if self.beams else ("objects", "sweeps")

    def as_dict(self) -> dict[str, Any]:
        """Everything that the result depends on, as plain values, for the tables' metadata."""
        rules = self.read.rules
        geometry = {
            name: getattr(self.csv, name) for name in ("angle_min", "angle_increment", "fov", "range_max")
        }
        told = {name: value for name, value in geometry.items() if value is not None}
        if self.csv.range_scale != 1.0:
            told["range_scale"] = self.csv.range_scale
        return {
            **self.parameters.as_dict(),
            "topics": sorted(self.read.topics) if self.read.topics else None,
            "start": self.read.start,
            "end": self.read.end,
            "every": self.read.every,
            "range": list(rules.limits) if rules.limits else None,
            "no_return": [*sorted(rules.no_return), *sorted(rules.markers)],
            **({"csv": told} if told else {}),
            **({"pose": self.pose} if self.pose is not None else {}),
        }


def detect_to_files(
    source: Source, folder: Path, options: DetectOptions, progress: Progress | None = None
) -> RunSummary:
    """Write the tables of one log below `folder`; they appear when all of them are whole, or not at all."""
    if not options.overwrite:
        refuse_existing([table_path(folder, source.name, table) for table in options.tables])
    with open_source(source, options.csv) as log:
        run = _Run(log, options)
        with TableFiles(folder, source.name, options.tables, run.first) as files:
            for batch, detection in run.detections(options.beams, progress):
                files.write("objects", batch.topic, objects_rows(source.name, batch, detection))
                files.write("sweeps", batch.topic, sweeps_rows(source.name, batch, detection))
                if options.beams:
                    files.write("beams", batch.topic, beams_rows(source.name, batch, detection))
            summary = run.close()
            described = run.describe(source)
            files.publish(table_metadata(options.as_dict(), described, summary.damage))
            summary.outputs = [str(path) for path in files.paths]
    return summary


def detect_to_stream(
    source: Source, stream: RowStream, options: DetectOptions, progress: Progress | None = None
) -> tuple[RunSummary, dict[str, Any]]:
    """Pass the objects of one log to `stream`, in the order of the table; also the description of the source."""
    with open_source(source, options.csv) as log:
        run = _Run(log, options)
        with TopicOrder(stream, OBJECTS, run.first, None) as order:
            for batch, detection in run.detections(False, progress):
                order.write(batch.topic, objects_rows(source.name, batch, detection))
            summary = run.close()
            order.drain()
        return summary, run.describe(source)


def describe_source(source: Source, log: Log) -> dict[str, Any]:
    """What the tables' metadata says of the source: nothing that depends on where it lay."""
    name = source.name if source.is_stdin or source.files else Path(source.path).absolute().name
    return {"name": name, "size": log.size, "format": log.format}


class _Run:
    """The sweeps of one log on their way through the formalism, counted."""

    def __init__(self, log: Log, options: DetectOptions) -> None:
        self._log = log
        self._options = options
        self._wanted = sorted(options.read.topics or ())
        self._summary = RunSummary()
        self._read = options.read
        self.first: str | None = None
        """The topic that comes first in the tables, where that is known before reading."""
        topics = log.topics()
        self._known = topics is not None
        self._started = time.perf_counter()
        if topics is not None:
            try:
                chosen, self._summary.missing_topics = choose(topics, self._wanted)
            except NoScanError as err:
                # Listing topics reports no damage; reading does, and steps over whatever is not wanted.
                for _ in log.scans(frozenset(self._wanted) or None):
                    pass
                raise nothing_read(self._damage(), err, self._wanted) from None
            self._read = replace(options.read, topics=frozenset(chosen))
            self.first = chosen[0]
        elif len(self._wanted) == 1:
            self.first = self._wanted[0]
        self._posing = Posing.of(log, options.pose)

    def detections(self, per_beam: bool, progress: Progress | None) -> Iterator[tuple[SweepBatch, Detection]]:
        """Every batch with its objects."""
        for raw in read_batches(self._log, self._read):
            batch = self._posing.attach(raw)
            detection = detect(batch, self._options.parameters, per_beam=per_beam)
            self._summary.add(batch, detection)
            yield batch, detection
            if progress is not None:
                progress(self._log.report.bytes_read)

    def close(self) -> RunSummary:
        """The counts, or the error of a log that turned out to have no LaserScan."""
        summary = self._summary
        summary.close(self._log.report, self._posing)
        summary.seconds = time.perf_counter() - self._started
        if not self._known:
            self._judge_topics()
        return summary

    def describe(self, source: Source) -> dict[str, Any]:
        """What the tables' metadata says of the source, and of its poses where it has some."""
        poses = self._posing.described()
        return describe_source(source, self._log) | ({"poses": poses} if poses else {})

    def _judge_topics(self) -> None:
        """A log without an index shows its topics only in the end."""
        summary = self._summary
        topics = self._log.topics()
        seen = {name.lstrip("/") for name in summary.topics}
        seen |= {topic.lstrip("/") for topic, _, _ in summary.dropped}
        if topics is not None:
            seen |= {name.lstrip("/") for name in scan_topics(topics)}
        missing = tuple(name for name in self._wanted if name.lstrip("/") not in seen)
        if seen and not missing:
            return
        if missing:
            error = NoScanError(absent(missing, topics or ()))
            if len(missing) < len(self._wanted):
                summary.missing_topics = missing
                return
        else:
            error = NoScanError("no LaserScan in it")
        raise nothing_read(summary.damage, error, self._wanted)

    def _damage(self) -> list[str]:
        summary = RunSummary()
        summary.close(self._log.report)
        return summary.damage
