"""One log through the formalism into tables: files in, files out."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.logs.base import CsvOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.inputs import Source
from lidarcli.pipeline.opening import open_source
from lidarcli.pipeline.reading import Progress, Reading, reading_as_dict
from lidarcli.pipeline.subtracting import BackgroundOptions, Subtracting
from lidarcli.pipeline.summary import RunSummary
from lidarcli.sweeps import SweepBatch
from lidarcli.tables.files import TableFiles, refuse_existing, table_path
from lidarcli.tables.metadata import table_metadata
from lidarcli.tables.order import TopicOrder
from lidarcli.tables.rows import beams_rows, objects_rows, sweeps_rows
from lidarcli.tables.schemas import OBJECTS
from lidarcli.tables.stream import RowStream


@dataclass(frozen=True, slots=True)
class DetectOptions:
    """Everything that `detect` lets a user choose, apart from inputs and outputs."""

    parameters: Parameters = field(default_factory=Parameters)
    read: ReadOptions = field(default_factory=ReadOptions)
    csv: CsvOptions = field(default_factory=CsvOptions)
    pose: str | None = None
    """Topic whose poses to take, `none` for no poses; by default the best there is."""
    background: BackgroundOptions | None = None
    """Only what differs from this background is an object."""
    beams: bool = False
    """Also write the beams table."""
    overwrite: bool = False

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables to write."""
        return ("objects", "sweeps", "beams") if self.beams else ("objects", "sweeps")

    def as_dict(self) -> dict[str, Any]:
        """Everything that the result depends on, as plain values, for the tables' metadata."""
        background = {} if self.background is None else {"background": self.background.as_dict()}
        return {
            **self.parameters.as_dict(),
            **reading_as_dict(self.read, self.csv, self.pose),
            **background,
        }


def detect_to_files(
    source: Source, folder: Path, options: DetectOptions, progress: Progress | None = None
) -> RunSummary:
    """Write the tables of one log below `folder`; they appear when all of them are whole, or not at all."""
    if not options.overwrite:
        refuse_existing([table_path(folder, source.name, table) for table in options.tables])
    with open_source(source, options.csv) as log:
        reading = Reading(log, options.read, options.pose)
        find = finder(options)
        with TableFiles(folder, source.name, options.tables, reading.first) as files:
            for batch in reading.batches(progress):
                detection = find(batch, options.beams)
                reading.summary.add_objects(detection)
                files.write("objects", batch.topic, objects_rows(source.name, batch, detection))
                files.write("sweeps", batch.topic, sweeps_rows(source.name, batch, detection))
                if options.beams:
                    files.write("beams", batch.topic, beams_rows(source.name, batch, detection))
            summary = reading.close()
            summary.notes += find.notes()
            described = reading.describe(source)
            files.publish(table_metadata(options.as_dict(), described, summary.damage))
            summary.outputs = [str(path) for path in files.paths]
    return summary


def detect_to_stream(
    source: Source, stream: RowStream, options: DetectOptions, progress: Progress | None = None
) -> tuple[RunSummary, dict[str, Any]]:
    """Pass the objects of one log to `stream`, in the order of the table; also the description of the source."""
    with open_source(source, options.csv) as log:
        reading = Reading(log, options.read, options.pose)
        find = finder(options)
        with TopicOrder(stream, OBJECTS, reading.first, None) as order:
            for batch in reading.batches(progress):
                detection = find(batch, False)
                reading.summary.add_objects(detection)
                order.write(batch.topic, objects_rows(source.name, batch, detection))
            summary = reading.close()
            summary.notes += find.notes()
            order.drain()
        return summary, reading.describe(source)


class Finder(Protocol):
    """Finds the objects of batches."""

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection: ...

    def notes(self) -> list[str]:
        """What a user should know of it in the end, a line each."""


def finder(options: DetectOptions) -> Finder:
    """Each sweep by itself, or what differs from a background."""
    if options.background is None:
        return _Alone(options.parameters)
    return Subtracting(options.background, options.parameters)


class _Alone:
    """Finds objects by the sweep alone."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters

    def __call__(self, batch: SweepBatch, per_beam: bool) -> Detection:
        return detect(batch, self._parameters, per_beam=per_beam)

    def notes(self) -> list[str]:
        """Nothing."""
        return []
