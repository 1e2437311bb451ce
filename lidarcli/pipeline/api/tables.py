"""`lidarcli.detect`, `track`, `tables` and `export`: objects, and their tracks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any, NamedTuple, Unpack

import pyarrow as pa

from lidarcli.display.texts import nearest
from lidarcli.errors import OptionError, warn
from lidarcli.files.stores import place
from lidarcli.formalism import Parameters
from lidarcli.options.groups import Exporting
from lidarcli.options.objects import Detecting, Tabling, Tracking
from lidarcli.options.reading import ReadingGroup
from lidarcli.options.values import AnyPath, Paths, parse_names, parse_numbers
from lidarcli.options.values import Tables as GivenTables
from lidarcli.pipeline.api.keywords import Progress, sources_of, watched, with_keywords
from lidarcli.pipeline.api.options import (
    Values,
    detect_options,
    listed,
    log_options,
    memory_of,
    refuse_reading,
    tracking_of,
)
from lidarcli.pipeline.detecting import TrackTables, of_batches, of_logs
from lidarcli.pipeline.exporting import chosen, export_file, format_of
from lidarcli.pipeline.inputs.tables import remember_sweeps, tables_to_export
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular.reading import notes_of
from lidarcli.tabular.schemas import BRIEF

if TYPE_CHECKING:
    import pandas as pd

    from lidarcli.pipeline.objects.detection import TrackOptions

LogsOrBatches = Paths | SweepBatch | Iterable[SweepBatch]


@with_keywords()
def detect(
    log: LogsOrBatches, parameters: Parameters | None = None, *, progress: Progress = False, **options: Unpack[Detecting]
) -> pa.Table:
    """The objects of every sweep as a table.

    Parameters
    ----------
    log : logs as of `read`, each of which is a log of its own in the table; or a batch, or batches (of one topic, or in
        order of topics)
    parameters : replaces the keywords from `profile` to `walls`

    Returns
    -------
    pyarrow.Table
        One row per object per sweep (docs/tables.md); `.to_pandas()` makes a data frame of it. With `beams=True` a tuple of
        this table and that of the beams.

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`.
    """
    made = _found(
        log, ["objects", "sweeps", *["beams"] * options["beams"]], parameters, options, memory_of(options), progress
    )
    remember_sweeps(objects := made["objects"], made.pop("sweeps"))
    return (objects, made["beams"]) if options["beams"] else objects


@with_keywords()
def track(
    log: LogsOrBatches, parameters: Parameters | None = None, *, progress: Progress = False, **options: Unpack[Tracking]
) -> TrackTables:
    """The objects and the sweeps of every log, and the tracks of its objects, as tables.

    Parameters
    ----------
    log : as of `detect`; batches of a log and topic have to come in the order of the log
    parameters : replaces the keywords from `profile` to `walls`

    Returns
    -------
    TrackTables
        `objects`, `sweeps` and `tracks`, each a pyarrow.Table as the command line writes it (docs/tables.md); and
        `trajectories` and `beams`, which unpacking leaves out.

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`.
    """
    more = [name for name in ("trajectories", "beams") if options[name]]
    made = _found(log, [*TrackTables._fields, *more], parameters, options, tracking_of(options), progress)
    remember_sweeps(made["objects"], made["sweeps"])
    aside = {name: made.pop(name) for name in more}
    found = TrackTables(**made)
    for name, table in aside.items():
        setattr(found, name, table)
    return found


class _CollectedTables(NamedTuple):
    objects: pd.DataFrame
    """One row per object per sweep."""
    sweeps: pd.DataFrame
    """One row per sweep."""
    tracks: pd.DataFrame
    """One row per track."""
    beams: pd.DataFrame | None = None
    """One row per beam of each sweep, where that was asked for."""


class Tables(_CollectedTables):
    """The tables of logs as pandas data frames, with the columns of docs/tables.md; the first four can be unpacked."""

    trajectories: pd.DataFrame | None = None
    """One row per track and sweep, from its first sight to its last, unless they were left out."""


@with_keywords()
def tables(
    log: LogsOrBatches, parameters: Parameters | None = None, *, progress: Progress = False, **options: Unpack[Tabling]
) -> Tables:
    """All tables of one or more logs as pandas data frames: what `track` finds.

    Stamps are `datetime64[ns, UTC]`, names (log, topic, set, shape, label) categories, whole numbers `Int64` or
    `Int32`, truths `boolean`, and vertices and faces lists of dicts.

    Parameters
    ----------
    log : as of `track`
    parameters : replaces the keywords from `profile` to `walls`

    Returns
    -------
    Tables
        `objects`, `sweeps`, `tracks`, `trajectories` unless `trajectories=False`, and, with `beams=True`, `beams`: each
        a pandas.DataFrame.

    Raises
    ------
    UnreadableError, NoScanError, OptionError
        As of `read`.
    """
    more = [name for name in ("trajectories", "beams") if options[name]]
    names = ("objects", "sweeps", "tracks", *more)
    # Here the name is that of the columns of the tables.
    columns, options["columns"] = options["columns"], ()
    made = _found(log, names, parameters, options, tracking_of(options), progress)
    if chosen := listed(columns, parse_names):
        made = narrowed(made, chosen)
    frames = {name: _frame(table) for name, table in made.items()}
    remember_sweeps(frames["objects"], made["sweeps"])
    trajectories = frames.pop("trajectories", None)
    found = Tables(**frames)
    found.trajectories = trajectories
    return found


def narrowed(tables: Mapping[str, pa.Table], columns: Sequence[str]) -> dict[str, pa.Table]:
    """Return of each table the columns that it has (`OptionError` where none has one)."""
    if [*columns] == ["brief"]:
        return {name: table.select(BRIEF[name]) for name, table in tables.items()}
    known = [*dict.fromkeys(name for table in tables.values() for name in table.column_names)]
    for name in columns:
        if name not in known:
            near = nearest(str(name), known)
            hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(known)}"
            raise OptionError(f"--columns: no table has a column {name}; {hint}")
    return {kind: table.select([name for name in columns if name in table.column_names]) for kind, table in tables.items()}


def _frame(table: pa.Table) -> pd.DataFrame:
    """A data frame whose types depend on the schema alone, not on what is missing."""
    import pandas as pd

    # Numbers and truths that may be missing: numpy would make fractions of one, and objects of the other.
    nullable = {pa.int32(): pd.Int32Dtype(), pa.int64(): pd.Int64Dtype(), pa.bool_(): pd.BooleanDtype()}
    frame: pd.DataFrame = table.to_pandas(types_mapper=nullable.get)
    # What a report says on the run, and on damage.
    frame.attrs = dict[Any, Any](notes_of(table))
    return frame


def _found(
    log: Any,
    tables: Sequence[str],
    parameters: Parameters | None,
    options: Values,
    tracking: TrackOptions | None,
    progress: Progress,
) -> dict[str, pa.Table]:
    """Some tables of logs or of batches, by their names."""
    parsed = detect_options(options, log_options(options), tracking, parameters)
    is_one = isinstance(log, str | PathLike | SweepBatch)
    # What is no path is refused as such.
    items: Iterator[Any] = iter(log if isinstance(log, Iterable) and not is_one else [log])
    first = next(items, items)
    if not isinstance(first, SweepBatch):
        sources = sources_of([] if first is items else [first, *items], options["join"])
        with watched(progress, sources) as report:
            return of_logs(sources, tables, parsed, report)
    refuse_reading({**options, "progress": progress or None}, ReadingGroup, "jobs", "progress")
    return of_batches(chain([first], items), tables, parsed)


@with_keywords()
def export(tables: GivenTables, output: AnyPath, overwrite: bool = False, **options: Unpack[Exporting]) -> int:
    """Write tables of one kind as CSV, NDJSON, Arrow or Parquet, one after the other.

    Parameters
    ----------
    tables : Parquet tables, folders to search or patterns; Arrow tables or data frames; or several of all
    output : file to write: .csv, .ndjson, .arrow, .parquet or, of one track of a trajectories table, .tum
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
    columns, only = listed(options["columns"], parse_names), listed(options["only"], parse_numbers)
    path = place(fspath(output))
    form = format_of(path)
    wanted = chosen(tables_to_export(tables), columns, options["stamps"], only)
    rows, notes = export_file(wanted, path, form, overwrite)
    for line in [*map(str, wanted.problems), *notes]:
        warn(line)
    return rows
