"""`lidarcli.clean`, `diff`, `overlay` and `zones`: functions that follow things through whole logs."""

from __future__ import annotations

from os import fspath
from typing import Unpack

import pyarrow as pa

from lidarcli.errors import warn
from lidarcli.options import OVERLAY_RULES, ZONE_RULES, AnyPath, Cleaning, Diffing, Overlaying, Paths, Zoning
from lidarcli.pipeline.api.options import (
    Progress,
    clean_options,
    diff_options,
    log_options,
    overlay_options,
    path_of,
    paths_of,
    several,
    sources_of,
    watched,
    with_keywords,
    zone_options,
)
from lidarcli.pipeline.cleaning import clean_log
from lidarcli.pipeline.detecting import ErrorCollector
from lidarcli.pipeline.differing import Difference, diff_inputs, inputs_of, refuse_outputs, write_changes
from lidarcli.pipeline.inputs.search import one_log
from lidarcli.pipeline.overlaying import refuse_overlay, write_overlay
from lidarcli.pipeline.runs.over_logs import progress_of
from lidarcli.pipeline.zoning import ZoneTables, watch
from lidarcli.stores import place


@with_keywords
def clean(
    log: AnyPath, output: AnyPath, overwrite: bool = False, *, progress: Progress = False, **options: Unpack[Cleaning]
) -> pa.Table:
    """Write a log once more, bit for bit but for the beams of what moves, and beside it the table `.cleaned.parquet`.

    Parameters
    ----------
    log : MCAP, ROS 1 bag or ROS 2 bag
    output : log to write, in the same container
    overwrite : True to replace files that exist

    Returns
    -------
    pyarrow.Table
        One row per sweep with the beams that were left out, by reason, as the command line writes it (docs/clean.md).

    Raises
    ------
    OptionError
        The log is of another container, or the output is the log.
    UnreadableError, NoScanError
        As of `read`; also where it is not known how the sensor moved.
    OutputError
        A file exists, or cannot be written.
    """
    source = one_log([path_of(log)], False)
    parsed = clean_options(options, overwrite=overwrite)
    with watched(progress, [source]) as report:
        summary = clean_log(source, place(fspath(output)), parsed, progress_of(source, report))
    for line in summary.damage:
        warn(f"{source.label}: {line}")
    return summary.table


@with_keywords
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
        `changes`, a pyarrow.Table with a row for each thing and each change of the structure (docs/diff.md), `figures`,
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
    inputs = inputs_of(paths_of([before, *after]))
    outputs = [place(each) for each in several(output)]
    refuse_outputs(outputs, inputs, parsed)
    with watched(progress, [one.source for one in inputs if one.source is not None]) as report:
        found = diff_inputs(inputs, parsed, report)
    for line in found.damage:
        warn(line)
    write_changes(found, outputs, overwrite)
    return found


@with_keywords(OVERLAY_RULES)
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
    source, path = one_log(paths_of(log), options["join"]), place(fspath(output))
    refuse_overlay(path, source, parsed)
    with watched(progress, [source]) as report:
        summary = write_overlay(source, path, parsed, progress_of(source, report))
    for line in summary.damage:
        warn(f"{source.label}: {line}")
    return summary.outputs


@with_keywords(ZONE_RULES)
def zones(log: Paths, *, progress: Progress = False, **options: Unpack[Zoning]) -> ZoneTables:
    """Tell who or what was in a zone, when, and how near: an offline check of a recording, no safety function.

    Parameters
    ----------
    log : logs as of `read`, each of which is a log of its own in the tables

    Returns
    -------
    ZoneTables
        `events`, one row per event, and `zones`, one row per sweep and zone, each a pyarrow.Table as the command line
        writes it (docs/zones.md).

    Raises
    ------
    OptionError
        A zone file does not say what a zone is, or zones that need objects are watched without.
    UnreadableError, NoScanError
        As of `read`; also where nothing leads to the frame of a zone, or poses contradict the sweeps.
    """
    if not options["zones"]:
        raise TypeError("zones() needs zones=FILE")
    parsed = zone_options(options, log_options(options))
    sources = sources_of(log, options["join"])
    failed = ErrorCollector(len(sources))
    found: list[ZoneTables] = []
    with watched(progress, sources) as report:
        for source in sources:
            with failed.noted(source):
                summary = watch(source, parsed, progress=progress_of(source, report))
                found.append(summary.tables)
                for line in summary.damage:
                    warn(f"{source.label}: {line}")
    failed.conclude()
    if len(found) == 1:
        return found[0]
    events, rows = (pa.concat_tables(tables) for tables in zip(*found, strict=True))
    return ZoneTables(events.unify_dictionaries(), rows.unify_dictionaries())
