"""The work of the command line as Python functions: `lidarcli.read`, `lidarcli.learn` and `lidarcli.detect`."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Iterable, Iterator, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import pyarrow as pa

from lidarcli.formalism import Parameters
from lidarcli.formalism.background import Background
from lidarcli.logs import open_log
from lidarcli.logs.base import CsvOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.building import (
    STATION_ANGLE,
    STATION_DISTANCE,
    Building,
    BuildOptions,
    refuse_nothing,
)
from lidarcli.pipeline.detecting import DetectOptions, detect_to_stream
from lidarcli.pipeline.finding import finder
from lidarcli.pipeline.inputs import STDIN, Source, log_name
from lidarcli.pipeline.posing import Posing
from lidarcli.pipeline.subtracting import BackgroundOptions
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
    pose_delay: float = 0.0,
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
    pose_delay : the pose of a sweep is that at its header stamp and this much later [s]
    """
    options = ReadOptions(
        topics=frozenset(topics) if topics else None,
        start=start,
        end=end,
        every=every,
        rules=rules or RangeRules(),
    )
    with open_log(fspath(path), csv=csv or CsvOptions()) as log:
        posing = Posing.of(log, pose, pose_delay)
        yield from map(posing.attach, read_batches(log, options))
        _warn(fspath(path), log.report)


def learn(
    source: AnyPath | Iterable[AnyPath],
    output: AnyPath | None = None,
    *,
    station_distance: float = STATION_DISTANCE,
    station_angle: float = STATION_ANGLE,
    **reading: Any,
) -> tuple[Background, ...]:
    """The background of every sensor of one or more logs of a scene without objects of interest.

    Parameters
    ----------
    source : path of a log, or several
    output : background table to write, replaced where it exists; by default none
    station_distance, station_angle : how far apart sweeps of one place may be [m], [rad]
    reading : what `read` takes
    """
    options = BuildOptions(**_reading(reading), distance=station_distance, angle=station_angle)
    building = Building(options)
    for path in [source] if isinstance(source, str | PathLike) else source:
        summary = building.add(_source(fspath(path)))
        for line in summary.damage:
            warnings.warn(f"{fspath(path)}: {line}", stacklevel=2)
    sensors = building.sensors()
    refuse_nothing(sensors)
    if output is not None:
        building.write(Path(output), sensors)
    return tuple(sensors)


def detect(
    source: AnyPath | SweepBatch | Iterable[SweepBatch],
    parameters: Parameters | None = None,
    *,
    background: AnyPath | BackgroundOptions | Sequence[Background] | None = None,
    **reading: Any,
) -> pa.Table:
    """The objects of every sweep as an Arrow table with the schema `lidarcli.tables.OBJECTS`.

    Parameters
    ----------
    source : path of a log, a batch, or batches (of one topic, or in order of topics)
    parameters : of the detection, by default those of profile `robust`; with a background no greatest width
    background : only what differs from it is an object: a background table, what `learn` returns, or with options
    reading : what `read` takes; only with a path
    """
    if background is None:
        subtracted = None
    elif isinstance(background, BackgroundOptions):
        subtracted = background
    elif isinstance(background, str | PathLike):
        subtracted = BackgroundOptions.of(fspath(background))
    else:
        subtracted = BackgroundOptions("", tuple(background))
    parameters = parameters or (Parameters() if subtracted is None else Parameters(max_width=float("inf")))
    if isinstance(source, str | PathLike):
        return _detect_log(fspath(source), parameters, subtracted, reading)
    if reading:
        raise TypeError(f"only a path can be read with {', '.join(sorted(reading))}")
    batches = [source] if isinstance(source, SweepBatch) else source
    find = finder(parameters, subtracted)
    rows = [objects_rows("", batch, find(batch, False)) for batch in batches]
    told = {} if subtracted is None else {"background": subtracted.as_dict()}
    metadata = table_metadata(parameters.as_dict() | told)
    return pa.Table.from_batches(rows, OBJECTS).replace_schema_metadata(metadata).unify_dictionaries()


class _Collected:
    """A stream that keeps its rows."""

    def __init__(self) -> None:
        self.rows: list[pa.RecordBatch] = []

    def write(self, rows: pa.RecordBatch) -> None:
        self.rows.append(rows)

    def finish(self, metadata: dict[bytes, bytes]) -> None:
        pass


def _reading(reading: dict[str, Any]) -> dict[str, Any]:
    """What `read` takes, as the options of the pipeline."""
    left = dict(reading)
    csv, rules = left.pop("csv", None) or CsvOptions(), left.pop("rules", None) or RangeRules()
    topics, pose = left.pop("topics", None), left.pop("pose", None)
    pose_delay = left.pop("pose_delay", 0.0)
    return {
        "read": ReadOptions(topics=frozenset(topics) if topics else None, rules=rules, **left),
        "csv": csv,
        "pose": pose,
        "pose_delay": pose_delay,
    }


def _source(path: str) -> Source:
    return Source(path, "stdin" if path == STDIN else log_name(Path(path)))


def _detect_log(
    path: str, parameters: Parameters, background: BackgroundOptions | None, reading: dict[str, Any]
) -> pa.Table:
    options = DetectOptions(parameters=parameters, background=background, **_reading(reading))
    collected = _Collected()
    summary, described = detect_to_stream(_source(path), collected, options)
    for line in summary.damage:
        warnings.warn(f"{path}: {line}", stacklevel=3)
    metadata = table_metadata(options.as_dict(), described, summary.damage)
    table = pa.Table.from_batches(collected.rows, OBJECTS)
    return table.replace_schema_metadata(metadata).unify_dictionaries()


def _warn(path: str, report: ReadReport) -> None:
    for line in damage_lines(report):
        warnings.warn(f"{path}: {line}", stacklevel=3)
