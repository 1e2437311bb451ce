"""The work of the command line as Python functions: `lidarcli.read` and `lidarcli.detect`."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Iterator
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import pyarrow as pa

from lidarcli.formalism import Parameters
from lidarcli.formalism import detect as detect_batch
from lidarcli.logs import open_log
from lidarcli.logs.base import CsvOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.detecting import DetectOptions, detect_to_stream
from lidarcli.pipeline.inputs import STDIN, Source, log_name
from lidarcli.pipeline.posing import Posing
from lidarcli.pipeline.summary import damage_lines
from lidarcli.sweeps import RangeRules, SweepBatch
from lidarcli.tables.metadata import table_metadata
from lidarcli.tables.rows import objects_rows
from lidarcli.tables.schemas import OBJECTS

AnyPath = str | PathLike[str]


def read(
    path: AnyPath,
    *,
    topics: Collection[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    every: int = 1,
    rules: RangeRules | None = None,
    csv: CsvOptions | None = None,
    pose: str | None = None,
) -> Iterator[SweepBatch]:
    """Batches of sweeps of a log in any format; a damaged part is warned of and left out.

    Parameters
    ----------
    path : file, ROS 2 bag folder, or `-` for standard input
    topics : LaserScan topics to read, by default all
    start, end : seconds from the first sweep
    every : take every n-th sweep
    rules : how ranges are judged
    csv : what a CSV file may need to be told
    pose : topic whose poses the batches get, `none` for no poses; by default the best there is
    """
    options = ReadOptions(
        topics=frozenset(topics) if topics else None,
        start=start,
        end=end,
        every=every,
        rules=rules or RangeRules(),
    )
    with open_log(fspath(path), csv=csv or CsvOptions()) as log:
        posing = Posing.of(log, pose)
        yield from map(posing.attach, read_batches(log, options))
        _warn(fspath(path), log.report)


def detect(
    source: AnyPath | SweepBatch | Iterable[SweepBatch], parameters: Parameters | None = None, **reading: Any
) -> pa.Table:
    """The objects of every sweep as an Arrow table with the schema `lidarcli.tables.OBJECTS`.

    Parameters
    ----------
    source : path of a log, a batch, or batches (of one topic, or in order of topics)
    parameters : of the detection, by default those of profile `robust`
    reading : what `read` takes; only with a path
    """
    parameters = parameters or Parameters()
    if isinstance(source, str | PathLike):
        return _detect_log(fspath(source), parameters, reading)
    if reading:
        raise TypeError(f"only a path can be read with {', '.join(sorted(reading))}")
    batches = [source] if isinstance(source, SweepBatch) else source
    rows = [objects_rows("", batch, detect_batch(batch, parameters)) for batch in batches]
    metadata = table_metadata(parameters.as_dict())
    return pa.Table.from_batches(rows, OBJECTS).replace_schema_metadata(metadata).unify_dictionaries()


class _Collected:
    """A stream that keeps its rows."""

    def __init__(self) -> None:
        self.rows: list[pa.RecordBatch] = []

    def write(self, rows: pa.RecordBatch) -> None:
        self.rows.append(rows)

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        pass


def _detect_log(path: str, parameters: Parameters, reading: dict[str, Any]) -> pa.Table:
    csv = reading.pop("csv", None) or CsvOptions()
    rules = reading.pop("rules", None) or RangeRules()
    topics, pose = reading.pop("topics", None), reading.pop("pose", None)
    read_options = ReadOptions(topics=frozenset(topics) if topics else None, rules=rules, **reading)
    options = DetectOptions(parameters=parameters, read=read_options, csv=csv, pose=pose)
    source = Source(path, "stdin" if path == STDIN else log_name(Path(path)))
    collected = _Collected()
    summary, described = detect_to_stream(source, collected, options)
    for line in summary.damage:
        warnings.warn(f"{path}: {line}", stacklevel=3)
    metadata = table_metadata(options.as_dict(), described, summary.damage)
    table = pa.Table.from_batches(collected.rows, OBJECTS)
    return table.replace_schema_metadata(metadata).unify_dictionaries()


def _warn(path: str, report: ReadReport) -> None:
    for line in damage_lines(report):
        warnings.warn(f"{path}: {line}", stacklevel=3)
