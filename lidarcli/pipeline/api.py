"""The work of the command line as Python functions: `lidarcli.read`, `learn`, `detect`, `track` and `map`."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from difflib import get_close_matches
from itertools import chain
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from lidarcli.choices import (
    MAP_RESOLUTION,
    MAX_MAP_KM2,
    MIN_MOVE,
    OCCUPIED_RATIO,
    SIGNIFICANCE,
    STATION_ANGLE,
    STATION_DISTANCE,
)
from lidarcli.errors import OptionError
from lidarcli.formalism import Parameters
from lidarcli.formalism.background.model import Background
from lidarcli.formalism.catalogue import Catalogue
from lidarcli.logs.base import CsvOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline.building import (
    Building,
    BuildOptions,
    refuse_nothing,
    refuse_output,
)
from lidarcli.pipeline.collecting import Failed, TrackTables, of_batches, of_logs
from lidarcli.pipeline.detecting import DetectOptions
from lidarcli.pipeline.inputs.catalogue import read_catalogue
from lidarcli.pipeline.inputs.opening import open_source
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.pipeline.objects.subtracting import BackgroundOptions
from lidarcli.pipeline.reading.pose_options import PoseOptions
from lidarcli.pipeline.reading.posing import Posing
from lidarcli.pipeline.reading.summary import damage_lines
from lidarcli.stores.url import place
from lidarcli.sweeps import RangeRules, SweepBatch

if TYPE_CHECKING:
    from lidarcli.formalism.mapping.occupancy import Occupancy
    from lidarcli.pipeline.objects.following import TrackOptions

AnyPath = str | PathLike[str]


def read(
    source: AnyPath | Iterable[AnyPath],
    *,
    topics: str | Collection[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    every: int = 1,
    rules: RangeRules | None = None,
    csv: CsvOptions | None = None,
    pose: str | None = None,
    poses: AnyPath | None = None,
    pose_delay: float = 0.0,
    deskew: bool = True,
) -> Iterator[SweepBatch]:
    """Batches of sweeps of one or more logs in any format, log after log; a damaged part is warned of and left out.

    Parameters
    ----------
    source : file, ROS 2 bag folder, folder to search, or `-` for standard input; or several of them
    topics : LaserScan topic to read, or topics, by default all
    start, end : seconds from the first sweep
    every : take every n-th sweep
    rules : how ranges are judged
    csv : what a CSV file may need to be told
    pose : topic whose poses the batches get, `none` for no poses, `match` for those that the sweeps tell; by default the
        best there is
    poses : trajectory of the sensor (TUM), instead of what the log tells
    pose_delay : the pose of a sweep is that at its header stamp and this much later [s]
    deskew : whether poses also tell how far the sensor goes during each sweep

    Raises
    ------
    UnreadableError
        There is no such file, or no log in it.
    NoScanError
        There is no LaserScan in a log, or not the topic that was asked for.
    """
    options = _read_options(topics, start, end, every, rules)
    told = _pose_options(pose, poses, pose_delay, deskew)
    return _batches(_sources(source), options, csv or CsvOptions(), told)


def _batches(
    sources: Sequence[Source], options: ReadOptions, csv: CsvOptions, poses: PoseOptions
) -> Iterator[SweepBatch]:
    failed = Failed(len(sources))
    for source in sources:
        with failed.noted(source), open_source(source, csv) as log:
            posing = Posing.of(log, poses, options.topics, options.rules)
            report = ReadReport()
            for batch in read_batches(log, options, report):
                yield replace(posing.attach(batch), log=source.name)
            for line in damage_lines(posing.together(report)):
                warnings.warn(f"{source.path}: {line}", stacklevel=2)
    failed.conclude()


def learn(
    source: AnyPath | Iterable[AnyPath],
    output: AnyPath | None = None,
    *,
    station_distance: float = STATION_DISTANCE,
    station_angle: float = STATION_ANGLE,
    topics: str | Collection[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    every: int = 1,
    rules: RangeRules | None = None,
    csv: CsvOptions | None = None,
    pose: str | None = None,
    poses: AnyPath | None = None,
    pose_delay: float = 0.0,
    deskew: bool = True,
) -> tuple[Background, ...]:
    """The background of every sensor of one or more logs of a scene without objects of interest.

    Parameters
    ----------
    source : as of `read`
    output : background table to write, replaced where it exists; by default none
    station_distance, station_angle : how far apart sweeps of one place may be [m], [rad]
    topics, start, end, every, rules, csv, pose, poses, pose_delay, deskew : as of `read`
    """
    options = BuildOptions(
        read=_read_options(topics, start, end, every, rules),
        csv=csv or CsvOptions(),
        poses=_pose_options(pose, poses, pose_delay, deskew),
        distance=station_distance,
        angle=station_angle,
    )
    sources = _sources(source)
    if output is not None:
        refuse_output(place(fspath(output)), sources, overwrite=True)
    building = Building(options)
    for log in sources:
        for line in building.add(log).damage:
            warnings.warn(f"{log.path}: {line}", stacklevel=2)
    sensors = building.sensors()
    refuse_nothing(sensors)
    if output is not None:
        for note in building.write(place(fspath(output)), sensors):
            warnings.warn(note, stacklevel=2)
    return tuple(sensors)


def detect(
    source: AnyPath | SweepBatch | Iterable[AnyPath] | Iterable[SweepBatch],
    parameters: Parameters | None = None,
    *,
    background: AnyPath | BackgroundOptions | Sequence[Background] | None = None,
    catalogue: AnyPath | Catalogue | None = None,
    topics: str | Collection[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    every: int = 1,
    rules: RangeRules | None = None,
    csv: CsvOptions | None = None,
    pose: str | None = None,
    poses: AnyPath | None = None,
    pose_delay: float = 0.0,
    deskew: bool = True,
    memory: bool = False,
    **objects: Any,
) -> pa.Table:
    """The objects of every sweep as an Arrow table with the schema `lidarcli.tabular.OBJECTS`.

    Parameters
    ----------
    source : logs as of `read`, each of which is a log of its own in the table; or a batch, or batches (of one topic, or in
        order of topics)
    parameters : of the detection, by default those of profile `robust`; with a background no greatest width
    background : only what differs from it is an object: a background table, what `learn` returns, or with options
    catalogue : things of interest, which objects are named by: a catalogue file, or what `read_catalogue` makes of it
    topics, start, end, every, rules, csv, pose, poses, pose_delay, deskew : as of `read`; only for logs
    memory : decide what is a thing, and its shape, by all sweeps that saw it, as `track` does
    objects : single parameters (`max_width=1.0`, `profile="paper"`), instead of `parameters`
    """
    tracking = None
    if memory:
        # Who does not track does not wait for this import.
        from lidarcli.pipeline.objects.following import TrackOptions

        tracking = TrackOptions(tracks=False)
    reading: dict[str, Any] = {"topics": topics, "start": start, "end": end, "every": every, "rules": rules}
    reading |= {"csv": csv, "pose": pose, "poses": poses, "pose_delay": pose_delay, "deskew": deskew}
    subtracted = _background(background)
    parameters = _parameters("detect", parameters, objects, subtracted is not None)
    return _tables(source, ("objects",), parameters, subtracted, catalogue, reading, tracking)["objects"]


def track(
    source: AnyPath | SweepBatch | Iterable[AnyPath] | Iterable[SweepBatch],
    parameters: Parameters | None = None,
    *,
    significance: float = SIGNIFICANCE,
    background: AnyPath | BackgroundOptions | Sequence[Background] | None = None,
    catalogue: AnyPath | Catalogue | None = None,
    topics: str | Collection[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    every: int = 1,
    rules: RangeRules | None = None,
    csv: CsvOptions | None = None,
    pose: str | None = None,
    poses: AnyPath | None = None,
    pose_delay: float | None = None,
    deskew: bool = True,
    memory: bool = True,
    **objects: Any,
) -> TrackTables:
    """The objects and the sweeps of every log, and the things that its objects belong to, as Arrow tables.

    Parameters
    ----------
    source : as of `detect`; batches of a log and topic have to come in the order of the log
    significance : share of the standing things that may pass for moving by chance, 1e-12 to 0.1
    catalogue : as of `detect`; things are named by all that was seen of them
    memory : decide what is a thing, and its shape, by all sweeps that saw it, not anew in each
    parameters, background, topics, start, end, every, rules, csv, pose, poses, deskew, objects : as of `detect`
    pose_delay : as of `read`; by default 0, but things are followed by the poses of the delay that fits best

    Returns
    -------
    TrackTables
        `objects`, `sweeps` and `tracks`, as the command line writes them (docs/tables.md).
    """
    # Who does not track does not wait for these imports.
    from lidarcli.formalism.tracking.parameters import TrackParameters
    from lidarcli.pipeline.objects.following import TrackOptions

    reading: dict[str, Any] = {"topics": topics, "start": start, "end": end, "every": every, "rules": rules}
    reading |= {"csv": csv, "pose": pose, "poses": poses, "pose_delay": pose_delay, "deskew": deskew}
    tracking = TrackOptions(TrackParameters(significance=significance, memory=memory))
    subtracted = _background(background)
    parameters = _parameters("track", parameters, objects, subtracted is not None)
    tables = _tables(source, TrackTables._fields, parameters, subtracted, catalogue, reading, tracking)
    return TrackTables(**tables)


def map(
    source: AnyPath | Iterable[AnyPath],
    output: AnyPath | Iterable[AnyPath] | None = None,
    *,
    resolution: float = MAP_RESOLUTION,
    min_move: float = MIN_MOVE,
    min_hits: int | None = None,
    occupied_ratio: float = OCCUPIED_RATIO,
    free_no_return: float = 0.0,
    voxel: float = 0.0,
    without_agents: bool = False,
    max_size: float = MAX_MAP_KM2,
    path: bool = False,
    topics: str | Collection[str] | None = None,
    start: float | None = None,
    end: float | None = None,
    every: int = 1,
    rules: RangeRules | None = None,
    csv: CsvOptions | None = None,
    pose: str | None = None,
    poses: AnyPath | None = None,
    pose_delay: float | None = None,
    deskew: bool = True,
) -> Occupancy:
    """One occupancy grid of one or several logs whose sensors moved.

    Parameters
    ----------
    source : as of `read`
    output : files to write, replaced where they exist, each of the kind that its suffix says; by default none
    resolution : side of a cell [m]
    min_move : how far the sensor goes from one sweep that counts to the next [m]; 0: every sweep counts
    min_hits, occupied_ratio : sweeps that have to hit an occupied cell, and their share of those that hit or passed it
    free_no_return : beams without a return are free up to here [m]
    voxel : clouds have one point in each square of this side [m]; 0: all
    without_agents : leave out what moves
    max_size : largest ground [km²]
    path : draw the path of the sensor into a picture
    topics, start, end, every, rules, csv, pose, poses, deskew : as of `read`
    pose_delay : as of `read`; by default the delay that fits best

    Returns
    -------
    Occupancy
        `cells` (H, W) int8: -1 unknown, 0 free, 100 occupied; `x`, `y` of the lower left corner and `resolution` [m].
    """
    # Who makes no map does not wait for these imports.
    from lidarcli.pipeline.map_files import MapRun
    from lidarcli.pipeline.mapping import MapOptions

    outputs = [] if output is None else [output] if isinstance(output, str | PathLike) else [*output]
    options = MapOptions(
        read=_read_options(topics, start, end, every, rules),
        csv=csv or CsvOptions(),
        poses=_pose_options(pose, poses, pose_delay, deskew),
        resolution=resolution,
        min_move=min_move,
        min_hits=min_hits,
        occupied_ratio=occupied_ratio,
        free_no_return=free_no_return,
        voxel=voxel,
        without_agents=without_agents,
        max_size=max_size,
        path=path,
        overwrite=True,
    )
    sources = _sources(source)
    failed = Failed(len(sources))
    with MapRun(sources, [place(fspath(each)) for each in outputs], options) as run:
        for log in sources:
            with failed.noted(log):
                for line in run.add(log).damage:
                    warnings.warn(f"{log.path}: {line}", stacklevel=2)
        failed.conclude()
        mapped = run.finish()
    for note in mapped.notes:
        warnings.warn(note, stacklevel=2)
    return mapped.grid


def _tables(
    source: Any,
    tables: Sequence[str],
    parameters: Parameters,
    background: BackgroundOptions | None,
    catalogue: AnyPath | Catalogue | None,
    reading: dict[str, Any],
    tracking: TrackOptions | None = None,
) -> dict[str, pa.Table]:
    """Some tables of logs or of batches, by their names; `reading` holds what only a log can be read with."""
    things = read_catalogue(catalogue) if isinstance(catalogue, str | PathLike) else catalogue
    items: Iterator[Any] = iter([source] if isinstance(source, str | PathLike | SweepBatch) else source)
    first = next(items, None)
    if isinstance(first, SweepBatch):
        if asked := [
            name for name, value in reading.items() if value is not None and value != _UNASKED.get(name)
        ]:
            raise TypeError(f"only a log can be read with {', '.join(asked)}")
        return of_batches(chain([first], items), tables, parameters, background, things, tracking)
    options = DetectOptions(
        parameters=parameters,
        read=_read_options(*(reading[name] for name in ("topics", "start", "end", "every", "rules"))),
        csv=reading["csv"] or CsvOptions(),
        poses=_pose_options(*(reading[name] for name in ("pose", "poses", "pose_delay", "deskew"))),
        background=background,
        catalogue=things,
        tracking=tracking,
    )
    return of_logs(_sources([] if first is None else [first, *items], level=4), tables, options)


_UNASKED = {"every": 1, "pose_delay": 0.0, "deskew": True}
"""What is said of reading where nothing was asked for, if not None."""


def _read_options(
    topics: str | Collection[str] | None,
    start: float | None,
    end: float | None,
    every: int,
    rules: RangeRules | None,
) -> ReadOptions:
    names = ([topics] if topics else None) if isinstance(topics, str) else topics
    return ReadOptions(
        topics=frozenset(names) if names else None,
        start=start,
        end=end,
        every=every,
        rules=rules or RangeRules(),
    )


def _pose_options(pose: str | None, poses: AnyPath | None, delay: float | None, deskew: bool) -> PoseOptions:
    return PoseOptions(pose, None if poses is None else fspath(poses), delay, deskew)


def _sources(source: Any, level: int = 3) -> list[Source]:
    """The logs that are meant, as the command line finds them: each with a name of its own; `level` of warnings."""
    paths: list[Any] = [source] if isinstance(source, str | PathLike) else list(source)
    for path in paths:
        if not isinstance(path, str | PathLike):
            raise TypeError(f"a log is the path of a file or folder, not {type(path).__name__}")
    named = [fspath(path) for path in paths]
    found = find_logs(named)
    for each in found:
        if isinstance(each, Nothing):
            error = type(each.error)(f"{each.path}: {each.error}")
            # What was asked for has to be there; of a folder the rest is read.
            if each.path in named:
                raise error
            warnings.warn(str(error), stacklevel=level)
    sources = [each for each in found if isinstance(each, Source)]
    names = Counter(each.name for each in sources)
    return [replace(each, name=each.path) if names[each.name] > 1 else each for each in sources]


def _background(
    background: AnyPath | BackgroundOptions | Sequence[Background] | None,
) -> BackgroundOptions | None:
    if background is None or isinstance(background, BackgroundOptions):
        return background
    if isinstance(background, str | PathLike):
        return BackgroundOptions.of(fspath(background))
    if not background:
        raise OptionError("a background of no sensor: nothing can be compared with it")
    return BackgroundOptions("the background", tuple(background))


def _parameters(
    function: str, parameters: Parameters | None, objects: Mapping[str, Any], subtracted: bool
) -> Parameters:
    """The parameters as such, or from single ones."""
    if parameters is not None:
        if not isinstance(parameters, Parameters):
            raise TypeError(f"parameters have to be Parameters, not {type(parameters).__name__}")
        if objects:
            raise TypeError(f"give either parameters or {', '.join(sorted(objects))}")
        return parameters
    known = [field.name for field in fields(Parameters)]
    options = [*_OPTIONS, *(["significance"] if function == "track" else [])]
    for name in objects:
        if name not in known:
            close = get_close_matches(name, [*known, *options], 1)
            hint = (
                f"; did you mean '{close[0]}'?" if close else f"; there are {', '.join([*options, *known])}"
            )
            raise TypeError(f"{function}() has no option '{name}'{hint}")
    # What differs from a background is no wall, however wide it is.
    return Parameters.for_profile(**{"max_width": float("inf") if subtracted else None, **objects})


_OPTIONS = (
    "background",
    "catalogue",
    "topics",
    "start",
    "end",
    "every",
    "rules",
    "csv",
    "pose",
    "poses",
    "pose_delay",
    "deskew",
    "memory",
)
