"""Functions for whole logs: `lidarcli.read`, `info`, `map`, `clean`, `diff`, `zones` and others."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from os import fspath
from typing import Any, Unpack

import pyarrow as pa

from lidarcli.display.texts import Unused
from lidarcli.errors import OptionError, warn
from lidarcli.files.stores import place
from lidarcli.formalism.background import Background
from lidarcli.formalism.mapping.grid import Occupancy
from lidarcli.logs.base import ReadReport
from lidarcli.logs.batches import read_batches
from lidarcli.logs.registry import TopicChoice
from lidarcli.options.choices import EXPLAINED, IMAGES
from lidarcli.options.forms import options_of
from lidarcli.options.groups import (
    OVERLAY_RULES,
    ZONE_RULES,
    Cleaning,
    Diffing,
    Inspecting,
    LearningGroup,
    MappingGroup,
    Overlaying,
    Simulating,
    Zoning,
)
from lidarcli.options.reading import ReadingGroup
from lidarcli.options.values import AnyPath, Paths
from lidarcli.pipeline.api.keywords import (
    Progress,
    counting,
    of_one_log,
    over_logs,
    sources_of,
    warn_of,
    watched,
    with_keywords,
)
from lidarcli.pipeline.api.options import (
    LogOptions,
    clean_options,
    diff_options,
    explained,
    given,
    log_options,
    overlay_options,
    path_text,
    place_of,
    several,
    zone_options,
)
from lidarcli.pipeline.building import BackgroundBuilder, BuildOptions, draw_background, refuse_nothing, refuse_output
from lidarcli.pipeline.clean.log import clean_log
from lidarcli.pipeline.detecting import ErrorCollector
from lidarcli.pipeline.differences.changes import Difference, refuse_outputs, write_changes
from lidarcli.pipeline.differences.comparison import diff_inputs
from lidarcli.pipeline.differences.inputs import inputs_of
from lidarcli.pipeline.inputs.search import one_log
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.inspecting import info_dict, inspect_log
from lidarcli.pipeline.localising import localise, read_site, refuse_judged
from lidarcli.pipeline.mapping import MapOptions, MapRun
from lidarcli.pipeline.overlay.files import refuse_overlay, write_overlay
from lidarcli.pipeline.reading.masking import masking_of
from lidarcli.pipeline.reading.one_log import damage_lines
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.pipeline.runs.over_logs import progress_of
from lidarcli.pipeline.trajectories import PathOptions, refuse_path, write_path
from lidarcli.pipeline.zones.run import refuse_outputs as refuse_zone_outputs
from lidarcli.pipeline.zones.run import watch
from lidarcli.pipeline.zones.summary import CountedTables, ZoneTables
from lidarcli.simulation import Simulated, run
from lidarcli.sweeps.types import SweepBatch


@with_keywords()
def read(log: Paths, **options: Unpack[ReadingGroup]) -> Iterator[SweepBatch]:
    """Batches of sweeps of one or more logs in any format, log after log.

    A damaged part is warned of and left out.

    Parameters
    ----------
    log : file, ROS 2 bag folder, folder to search, pattern, URL, or `-` for standard input; or several of them

    Returns
    -------
    Iterator of SweepBatch
        Each holds sweeps of one topic, in the order of the log.

    Raises
    ------
    UnreadableError
        There is no such file, or no log in it: at the call where nothing is there, else when it is read.
    NoScanError
        There is no LaserScan in a log, or not the topic that was asked for.
    OptionError
        A value has no meaning.
    """
    return _batches(sources_of(log, options["join"]), log_options(options))


def _batches(sources: Sequence[Source], options: LogOptions) -> Iterator[SweepBatch]:
    read, opening, poses = options
    errors = ErrorCollector(len(sources))
    for source in sources:
        with errors.noted(source), open_source(source, opening) as log:
            masking = masking_of(log, read.rules, poses, read.topics)
            reading = replace(read, rules=masking.rules)
            posing = PoseAttacher.of(log, poses, TopicChoice(read.topics, log.topics()), reading)
            report = ReadReport()
            is_empty = True
            for batch in read_batches(log, reading, report):
                is_empty = False
                yield replace(posing.attach(batch), log=source.name)
            # Notes are for reading, but a log without a sweep needs its reason, and ranges that are none theirs.
            unused = [note for note in [*report.notes, *posing.notes()] if isinstance(note, Unused)]
            notes = [*masking.doubts, *(report.notes if is_empty else unused), *report.doubted()]
            warn_of(source, [*damage_lines(posing.together(report)), *notes])
    errors.conclude()


@with_keywords()
def info(log: Paths, *, progress: Progress = False, **options: Unpack[Inspecting]) -> list[dict[str, Any]]:
    """Topics, sweeps, geometry, clocks, beams, poses, findings and damage of a log, which is read from end to end.

    Parameters
    ----------
    log : as of `read`

    Returns
    -------
    list of dict
        One for each log, with the keys of `lidarcli info --format json` (docs/info.md).

    Raises
    ------
    UnreadableError, OptionError
        As of `read`. A log without LaserScan is warned of.
    """
    read, opening, poses = log_options(options)
    deep, site = options["deep"], given(fspath, options["map"])
    found = over_logs(
        sources_of(log, options["join"]),
        progress,
        lambda source, bar: inspect_log(source, opening, read, poses, bar, deep, site),
    )
    return [info_dict(each) for each in found]


@with_keywords()
def background(
    log: Paths,
    output: AnyPath | None = None,
    overwrite: bool = True,
    *,
    plot: AnyPath | None = None,
    progress: Progress = False,
    **options: Unpack[LearningGroup],
) -> tuple[Background, ...]:
    """The background of every sensor of one or more logs of a scene without objects of interest.

    Parameters
    ----------
    log : as of `read`
    output : background table to write; by default none
    overwrite : False to refuse files that exist
    plot : picture of it to write: .png, .svg or .pdf; by default none

    Returns
    -------
    tuple of Background
        One for each sensor; all of them are what `detect(..., background=)` takes.

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`.
    OutputError
        The table cannot be written.
    """
    building = BackgroundBuilder(
        BuildOptions(
            *log_options(options), distance=options["station_distance"], angle=math.radians(options["station_angle"])
        )
    )
    sources = sources_of(log, options["join"])
    path, figure = given(place_of, output), given(place_of, plot)
    if figure is not None and figure.suffix.lower() not in IMAGES:
        raise OptionError(f"--plot: {figure} is none of {', '.join(IMAGES)}")
    refuse_output([each for each in (path, figure) if each is not None], sources, overwrite)
    with watched(progress, sources) as report:
        for source in sources:
            warn_of(source, building.add(source, progress_of(source, report)).warnings)
    sensors = building.sensors()
    refuse_nothing(sensors)
    notes = [] if path is None else building.write(path, sensors, overwrite)
    for note in [*notes, *([] if figure is None else draw_background(figure, sensors, overwrite))]:
        warn(note)
    return tuple(sensors)


@with_keywords()
def map(
    log: Paths, output: Paths = (), overwrite: bool = True, *, progress: Progress = False, **options: Unpack[MappingGroup]
) -> Occupancy:
    """One occupancy grid of one or several logs whose sensors moved.

    Parameters
    ----------
    log : as of `read`
    output : files to write, each of the kind that its suffix says; by default none
    overwrite : False to refuse files that exist

    Returns
    -------
    Occupancy
        `cells` (H, W) int8: -1 unknown, 0 free, 100 occupied; `x`, `y` of the lower left corner and `resolution` [m].

    Raises
    ------
    UnreadableError
        As of `read`, or nothing tells where the sensor was.
    NoScanError, OptionError
        As of `read`.
    OutputError
        A file cannot be written.
    """
    made_with = MapOptions(
        *log_options(options),
        overwrite=overwrite,
        **{name: value for name, value in options.items() if name not in options_of(ReadingGroup)},  # type: ignore[arg-type]
    )
    sources = sources_of(log, options["join"])
    with MapRun(sources, [place(each) for each in several(output)], made_with) as run:
        over_logs(sources, progress, run.add)
        mapped = run.finish()
    for note in mapped.notes:
        warn(note)
    return mapped.grid


@with_keywords()
def poses(
    log: Paths,
    output: AnyPath | None = None,
    overwrite: bool = False,
    *,
    map: AnyPath | None = None,
    relocate: bool = False,
    progress: Progress = False,
    **options: Unpack[ReadingGroup],
) -> pa.Table:
    """The poses of the sensors of a log, one for each sweep where it is known.

    Parameters
    ----------
    log : one log as of `read`, with `join` its parts
    output : file to write: .tum or .txt (lines of timestamp x y z qx qy qz qw, of one sensor), or .parquet, with a `map`
        also .png; by default none
    overwrite : True to replace a file that exists
    map : map of map_server (.yaml) that judges the path, by default none; a warning tells where it explains too little
    relocate : True to correct poses that are off the map, and leave out those of a lost robot

    Returns
    -------
    pyarrow.Table
        One row per pose, as `lidarcli poses` writes it (docs/poses.md); with an `output` of lines those that are in it.
        With a `map` its columns `map_state` and others are filled.

    Raises
    ------
    UnreadableError
        As of `read`, or nothing tells where the sensor was.
    NoScanError, OptionError
        As of `read`; also where several sensors are to go into a file of lines.
    OutputError
        The file exists, or cannot be written.
    """
    source, parsed = one_log(several(log), options["join"]), PathOptions(*log_options(options), overwrite)
    path = given(place_of, output)
    if map is None:
        if relocate:
            raise OptionError("relocate needs a map")
        if path is not None:
            refuse_path(path, source, parsed)
        return of_one_log(source, progress, lambda one, bar: write_path(one, path, parsed, bar)).table
    if path is not None:
        refuse_judged(path, source, parsed, fspath(map))
    site = read_site(fspath(map))
    found = of_one_log(source, progress, lambda one, bar: localise(one, path, parsed, site, relocate, progress=bar))
    if not found.tells or found.least is not None:
        warn_of(source, found.lines)
    return found.table


@with_keywords()
def simulate(
    scene: AnyPath, output: AnyPath, overwrite: bool = False, *, progress: Progress = False, **options: Unpack[Simulating]
) -> Simulated:
    """Ray-cast a scene into a log, with the truth beside it.

    Parameters
    ----------
    scene : scene file (TOML, samples/README.md)
    output : log to write; its suffix names the container, no suffix a ROS 2 bag folder
    overwrite : True to replace files that exist

    Returns
    -------
    Simulated
        `log`, `truth`, `truth_beams` and `true_map`, the files that were written, and the number of `sweeps`.

    Raises
    ------
    UnreadableError
        The scene cannot be read.
    OptionError
        The scene or a value has no meaning.
    OutputError
        A file exists, or cannot be written.
    """
    name = fspath(scene)
    with counting(progress, name, "sweeps") as report:
        made = run.simulate(name, fspath(output), overwrite=overwrite, progress=report, **options)
    for note in made.notes:
        warn(note)
    return made


@with_keywords()
def clean(
    log: AnyPath, output: AnyPath, overwrite: bool = False, *, progress: Progress = False, **options: Unpack[Cleaning]
) -> pa.Table:
    """Write a log once more, bit for bit but for the beams of what moves and what is mended, or parts of it.

    Parameters
    ----------
    log : MCAP, ROS 1 bag or ROS 2 bag
    output : log to write, in the same container; with `clips` the folder of the logs
    overwrite : True to replace files that exist

    Returns
    -------
    pyarrow.Table
        One row per sweep with the beams that were left out, by reason, as the command line writes it beside the log
        (docs/clean.md); empty where none are to be.

    Raises
    ------
    OptionError
        The log is of another container, or the output is the log, or what is to be mended cannot be.
    UnreadableError, NoScanError
        As of `read`; also where it is not known how the sensor moved.
    OutputError
        A file exists, or cannot be written.
    """
    source = one_log([path_text(log)], False)
    parsed = clean_options(options, overwrite=overwrite)
    return of_one_log(source, progress, lambda one, bar: clean_log(one, place_of(output), parsed, bar)).table


@with_keywords()
def diff(
    before: AnyPath,
    *after: AnyPath,
    output: Paths = (),
    overwrite: bool = False,
    progress: Progress = False,
    **options: Unpack[Diffing],
) -> Difference:
    """Find what changed from run to run.

    Parameters
    ----------
    before : a run: a log, a tracks table of `track`, a background, or a map (.yaml of map_server)
    after : one or more later runs, like this
    output : files to write: .parquet or .csv (table of changes), .png (picture)
    overwrite : replace files that exist

    Returns
    -------
    Difference
        `changes`, a pyarrow.Table with a row for each object and each change of the structure (docs/diff.md), `figures`,
        and `steps`, how each run lies on those before it.

    Raises
    ------
    OptionError
        There are fewer than two runs, or an output is of no known kind.
    UnreadableError
        A run cannot be read, or does not lie on those before it, or does so in several ways or anywhere along its walls.
    NoScanError
        As of `read`.
    OutputError
        An output exists, or cannot be written.
    """
    parsed = diff_options(options, log_options(options), overwrite=overwrite)
    inputs = inputs_of(several([before, *after]))
    outputs = [place(each) for each in several(output)]
    refuse_outputs(outputs, inputs, parsed)
    with watched(progress, [one.source for one in inputs if one.source is not None]) as report:
        found = diff_inputs(inputs, parsed, report)
    for line in found.damage:
        warn(line)
    write_changes(found, outputs, overwrite)
    return found


@with_keywords(*OVERLAY_RULES)
def overlay(
    log: Paths, output: AnyPath, overwrite: bool = False, *, progress: Progress = False, **options: Unpack[Overlaying]
) -> list[str]:
    """Write objects and tracks as markers that viewers play in step with the log.

    Parameters
    ----------
    log : one log as of `read`, with `join` its parts
    output : file to write: .mcap (ROS 2) or .bag (ROS 1)
    overwrite : True to replace files that exist

    Returns
    -------
    list of str
        The files that were written: the overlay, and beside it settings of viewers.

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`; also where the tables or the map cannot be read, or the suffix names no overlay.
    OutputError
        A file exists, or cannot be written.
    """
    parsed = overlay_options(options, log_options(options), overwrite=overwrite)
    source, path = one_log(several(log), options["join"]), place_of(output)
    refuse_overlay(path, source, parsed)
    return of_one_log(source, progress, lambda one, bar: write_overlay(one, path, parsed, bar)).outputs


@with_keywords(*ZONE_RULES)
def zones(
    log: Paths, output: Paths = (), overwrite: bool = False, *, progress: Progress = False, **options: Unpack[Zoning]
) -> ZoneTables | CountedTables:
    """Tell who or what was in a zone, when, and how near: an offline check of a recording, no safety function.

    Parameters
    ----------
    log : logs as of `read`, each of which is a log of its own in the tables
    output : files to write with what `explain` answers: .html, .png, .gif or .mp4
    overwrite : True to replace files that exist

    Returns
    -------
    ZoneTables
        `events`, one row per event, and `zones`, one row per sweep and zone, each a pyarrow.Table as the command line
        writes it (docs/zones.md). With an interval of time as `every` also `counts`, one row per line, interval and
        direction (`CountedTables`).

    Raises
    ------
    OptionError
        A zone file does not say what a zone is, or zones that need objects are watched without.
    UnreadableError, NoScanError
        As of `read`; also where nothing leads to the frame of a zone, or poses contradict the sweeps.
    OutputError
        A file exists, or cannot be written.
    """
    if not options["zones"]:
        raise TypeError("zones() needs zones=FILE")
    paths, why = [place(each) for each in several(output)], options["explain"]
    for path in paths:
        if why is None or path.suffix.lower() not in EXPLAINED:
            raise OptionError(f"--output: {path} is none of {', '.join(EXPLAINED)} for --explain; tables are returned")
    parsed = explained(zone_options(options, log_options(options), overwrite=overwrite), why, paths, lambda *_: ())
    sources = sources_of(log, options["join"])
    if why is not None and len(sources) != 1:
        raise OptionError(f"--explain is for one log, and these are {len(sources):,}")
    refuse_zone_outputs(sources, None, parsed)
    found = [one.tables for one in over_logs(sources, progress, lambda one, bar: watch(one, parsed, progress=bar))]
    if len(found) == 1:
        return found[0]
    return type(found[0])(*(pa.concat_tables(tables).unify_dictionaries() for tables in zip(*found, strict=True)))
