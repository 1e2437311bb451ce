"""`lidarcli.diff`, `export` and `simulate`: runs that are compared, and files made of tables and of scenes."""

from __future__ import annotations

from os import fspath
from typing import Unpack

from lidarcli.errors import warn
from lidarcli.options import AnyPath, Diffing, Exporting, Paths, Simulating, Tables, parse_names
from lidarcli.pipeline.api.options import (
    Progress,
    counting,
    diff_options,
    log_options,
    paths_of,
    several,
    watched,
    with_keywords,
)
from lidarcli.pipeline.differing import Difference, diff_inputs, inputs_of, refuse_outputs, write_changes
from lidarcli.pipeline.exporting import chosen, export_file, format_of
from lidarcli.pipeline.inputs.tables import tables_to_export
from lidarcli.simulation import Simulated, run
from lidarcli.stores import place


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
        tables_to_export(tables), parse_names(columns) if isinstance(columns, str) else [*columns], options["stamps"]
    )
    rows, notes = export_file(wanted, path, form, overwrite)
    for line in [*map(str, wanted.problems), *notes]:
        warn(line)
    return rows


@with_keywords
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
    how = diff_options(options, log_options(options), overwrite=overwrite)
    inputs = inputs_of(paths_of([before, *after]))
    outputs = [place(each) for each in several(output)]
    refuse_outputs(outputs, inputs, how)
    with watched(progress, [one.source for one in inputs if one.source is not None]) as report:
        found = diff_inputs(inputs, how, report)
    for line in found.damage:
        warn(line)
    write_changes(found, outputs, overwrite)
    return found
