"""`lidarcli.overlay`, `lidarcli.export` and `lidarcli.simulate`: files made of logs, of tables and of scenes."""

from __future__ import annotations

from os import fspath
from pathlib import Path
from typing import Unpack

from lidarcli.choices import SIGNIFICANCE
from lidarcli.errors import warn
from lidarcli.options import (
    OF_FINDING,
    AnyPath,
    Exporting,
    Overlaying,
    Paths,
    Simulating,
    Tables,
    parse_names,
)
from lidarcli.pipeline.api.options import (
    LogOptions,
    Progress,
    Values,
    counting,
    detect_options,
    log_options,
    path_text,
    paths_of,
    refuse_finding,
    several,
    tables_to_export,
    tracking_of,
    watched,
    with_keywords,
)
from lidarcli.pipeline.exporting import chosen, export_file, format_of
from lidarcli.pipeline.inputs.search import one_log
from lidarcli.pipeline.inputs.zones import read_zones
from lidarcli.pipeline.overlaying import OverlayOptions, refuse_overlay, write_overlay
from lidarcli.pipeline.runs.over_logs import progress_of
from lidarcli.simulation import Simulated, run
from lidarcli.stores.url import place


@with_keywords
def overlay(
    log: Paths,
    output: AnyPath,
    overwrite: bool = False,
    *,
    progress: Progress = False,
    **options: Unpack[Overlaying],
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
    how = overlay_options(options, log_options(options), overwrite=overwrite)
    if how.objects is not None:
        refuse_finding(options, Overlaying, OF_FINDING, "--objects names some that have been found")
    source, path = one_log(paths_of(log), options["join"]), place(fspath(output))
    refuse_overlay(path, source, how)
    with watched(progress, [source]) as report:
        summary = write_overlay(source, path, how, progress_of(source, report))
    for line in summary.damage:
        warn(f"{source.label}: {line}")
    return summary.outputs


def overlay_options(told: Values, logs: LogOptions, *, overwrite: bool = False) -> OverlayOptions:
    """Return what is shown, and how it is found."""
    objects, map_file = told["objects"], told["map"]
    return OverlayOptions(
        detect_options(told, logs, tracking_of({"significance": SIGNIFICANCE, "memory": True})),
        None if objects is None else path_text(objects),
        told["with_log"],
        None if map_file is None else Path(map_file),
        read_zones(several(told["zones"])) if told["zones"] else None,
        told["layout"],
        overwrite,
    )


@with_keywords
def export(tables: Tables, output: AnyPath, overwrite: bool = False, **options: Unpack[Exporting]) -> int:
    """Write tables of one kind as CSV, NDJSON, Arrow or Parquet, one after the other.

    Parameters
    ----------
    tables : Parquet tables, folders to search or patterns; Arrow tables or data frames; or several of all
    output : file to write: .csv, .ndjson, .arrow or .parquet
    overwrite : True to replace a file that exists

    Returns
    -------
    int
        The number of rows.

    Raises
    ------
    UnreadableError
        There is no such table, or one cannot be read.
    OptionError
        The tables are of several kinds, or have no such column, or the suffix names no format.
    OutputError
        The file exists, or cannot be written.
    """
    columns = options["columns"]
    path = place(fspath(output))
    form = format_of(path)
    wanted = chosen(
        tables_to_export(tables), parse_names(columns) if isinstance(columns, str) else [*columns]
    )
    rows, notes = export_file(wanted, path, form, overwrite)
    for line in [*map(str, wanted.problems), *notes]:
        warn(line)
    return rows


@with_keywords
def simulate(
    scene: AnyPath,
    output: AnyPath,
    overwrite: bool = False,
    *,
    progress: Progress = False,
    **options: Unpack[Simulating],
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
