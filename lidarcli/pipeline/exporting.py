"""The work of `lidarcli export`: tables that are there, as one file or stream of another format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from lidarcli.display.texts import counted, nearest
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.files.newfiles import NewFiles, refuse
from lidarcli.files.stores import Place
from lidarcli.options.choices import TABLE_BY_SUFFIX
from lidarcli.pipeline.inputs.search import files_named
from lidarcli.pipeline.inputs.tables import recording_in
from lidarcli.reports.columns import same_recording
from lidarcli.tabular.columns import in_unit, numbers
from lidarcli.tabular.reading import (
    ANY,
    Readable,
    TableInMemory,
    file_metadata,
    note_value,
    read_as_is,
    refuse_columns,
    schema_of,
)
from lidarcli.tabular.streams import write_stream
from lidarcli.tabular.writing import SOURCE, Output

MAX_COLUMNS = 1000
"""Most columns that are written: tables of lidarcli have 50; each column of others takes time and memory."""
TUM, TRACK = ".tum", "track"
PATH = "stamp", "x", "y", "vx", "vy", "seen"
"""Columns of a trajectory that are written as TUM."""
APART = "export each kind of table by itself, as '*.objects.parquet'"


@dataclass(frozen=True, slots=True)
class Export:
    """Tables with the same columns, one after the other."""

    files: tuple[Readable, ...]
    schema: pa.Schema
    """The columns that are written, with the metadata that all tables share."""
    problems: tuple[UnreadableError, ...] = ()
    """Folders that cannot be searched for more."""
    only: tuple[int, ...] = ()
    """Numbers of the tracks whose rows are written; empty: all rows are."""

    def pieces(self) -> Iterator[pa.RecordBatch]:
        """Yield all rows (`OptionError` in the end where a track is in no table)."""
        names, lacking = self.schema.names, {*self.only}
        for file in self.files:
            for rows in read_as_is(file, [*dict.fromkeys([*names, TRACK])] if self.only else names):
                if self.only:
                    tracks = numbers(rows[TRACK].cast(pa.float64()))
                    lacking -= {*tracks.tolist()}
                    rows = rows.filter(pa.array(np.isin(tracks, self.only))).select(names)
                # Types are the same but for the unit of stamps.
                yield rows.cast(self.schema.remove_metadata(), safe=False)
        if lacking:
            raise OptionError(f"{self.files[0]}: no track {', '.join(map(str, sorted(lacking)))} in it (--only)")

    def notes(self) -> list[str]:
        """Return a line where logs of one name are two recordings: no row says which of them it is of."""
        known: dict[str, tuple[Readable, dict[str, str]]] = {}
        for file in self.files:
            notes = file_metadata(file)
            name, recording = str(note_value(notes, SOURCE, dict).get("name")), recording_in(notes)
            first, other = known.setdefault(name, (file, recording))
            if same_recording(recording, other) is False:
                return [f"{first} and {file} are of two recordings, both {name}: no row tells of which it is"]
        return []


def chosen(
    tables: Sequence[str | TableInMemory], columns: Sequence[str] = (), stamps: str | None = None, only: Sequence[int] = ()
) -> Export:
    """Choose some columns, or all, of all tables that are in memory, or that files, folders and patterns name.

    `stamps` is the unit of the stamps, as of `in_unit`; `only` numbers of tracks, whose rows alone are taken.

    Raises
    ------
    UnreadableError
        There is no such table, or one cannot be read.
    OptionError
        The tables are of several kinds, or have no such column, or it is named twice.
    """
    # A table that is named twice is one.
    found = [_tables(each) for each in tables]
    files = [*dict.fromkeys(file for named, _ in found for file in named)]
    problems = tuple(problem for _, denied in found for problem in denied)
    if not files:
        raise problems[0]
    schemas = [in_unit(schema_of(file), stamps) for file in files]
    first = schemas[0]
    for name in [*columns, *([TRACK] if only else [])]:
        if name not in first.names:
            near = nearest(str(name), first.names)
            hint = f"did you mean {near[0]}?" if near else f"it has {', '.join(first.names)}"
            raise OptionError(f"{files[0]}: no column {name}; {hint}")
    names = [*columns] or [*dict.fromkeys(first.names)]
    if len(names) > MAX_COLUMNS:
        raise OptionError(
            f"{files[0]}: has {len(names):,} columns, and at most {MAX_COLUMNS:,} are written; choose some with --columns"
        )
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise OptionError(f"--columns: {', '.join(twice)} is named twice; every column of a table has its own name")
    refuse_columns(files[0], ANY, first.names, names)
    for file, schema in zip(files[1:], schemas[1:], strict=True):
        if missing := [name for name in names if name not in schema.names]:
            raise OptionError(f"{file}: no column {', '.join(missing)}, which {files[0]} has; {APART}")
        if not columns and (more := [name for name in schema.names if name not in names]):
            raise OptionError(f"{files[0]}: no column {', '.join(more)}, which {file} has; {APART}")
        refuse_columns(file, ANY, schema.names, names)
        for name in names:
            if schema.field(name).type != first.field(name).type:
                kinds = [schema.field(name).type, first.field(name).type]
                hint = "; --stamps us makes them alike" if all(map(pa.types.is_timestamp, kinds)) else ""
                raise OptionError(f"{file}: column {name} is {kinds[0]}, in {files[0]} {kinds[1]}{hint}")
    fields = [first.field(name).with_nullable(any(each.field(name).nullable for each in schemas)) for name in names]
    # The metadata that all tables share: of several logs no one is the source.
    metadata, *others = [dict(schema.metadata or {}) for schema in schemas]
    shared = {key: value for key, value in metadata.items() if all(each.get(key) == value for each in others)}
    schema = pa.schema(fields, metadata=shared)
    return Export(tuple(files), schema, problems, tuple(only))


def format_of(path: Place) -> str:
    """Return the format that the suffix of an output names (`OptionError` where it names none)."""
    known = TABLE_BY_SUFFIX | {TUM: TUM}
    form = known.get(path.suffix.lower())
    if form is None:
        raise OptionError(f"{path}: the suffix of a table has to be one of {', '.join(known)}")
    return form


def export_file(export: Export, path: Place, kind: str, overwrite: bool) -> tuple[int, list[str]]:
    """Write a file of `kind` (parquet, csv, ndjson, arrow, .tum); returns the number of rows and notes on them."""
    refuse([path], overwrite, [str(file) for file in export.files if not isinstance(file, TableInMemory)])
    with NewFiles([path], overwrite) as new:
        with new.part(path).open("wb") as out:
            rows, notes = (_write_tum if kind == TUM else export_stream)(export, out, kind, str(path))
        return rows, [*notes, *new.publish()]


def export_stream(export: Export, out: Output, kind: str, name: str = "standard output") -> tuple[int, list[str]]:
    """Write tables to a stream of `kind`; returns the number of rows and notes on them."""
    rows, notes = write_stream(out, kind, name, export.schema, dict(export.schema.metadata or {}), export.pieces())
    return rows, [*export.notes(), *notes]


def _write_tum(export: Export, out: Output, kind: str, name: str) -> tuple[int, list[str]]:
    """Write the path of one track where sweeps saw it, headed as it goes, as TUM; returns the number of poses and notes."""
    if len(export.only) != 1 or len(export.files) != 1 or {*PATH} - {*export.schema.names}:
        raise OptionError(f"{name}: a {TUM} has the path of one track: give one trajectories table, --only N, no --columns")
    from lidarcli.pose.tracks import GAP, lifted, trajectory_lines

    count, hidden, last = 0, 0, None
    for rows in export.pieces():
        x, y, vx, vy = (numbers(rows[column].cast(pa.float64())) for column in PATH[1:-1])
        stamp = rows[PATH[0]].cast(pa.timestamp("ns", "UTC")).cast(pa.int64()).to_numpy()
        if np.any(np.diff(stamp, prepend=stamp[:1] - 1 if last is None else last) <= 0):
            raise OptionError(
                f"{export.files[0]}: track {export.only[0]} has several places at a time: it is of several topics"
            )
        last = stamp[-1:]
        seen = np.array([word != "hidden" for word in rows[PATH[-1]].to_pylist()], np.bool_)
        for some in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(seen)) + 1) if len(rows) else ():
            poses = lifted((x[some], y[some], np.arctan2(vy[some], vx[some])))
            out.write((trajectory_lines(stamp[some], poses) if seen[some[0]] else f"{GAP}\n").encode())
        count, hidden = count + int(seen.sum()), hidden + int((~seen).sum())
    return count, [f"{counted(hidden, 'place')} left out, where no sweep saw it"] if hidden else []


def _tables(text: str | TableInMemory) -> tuple[list[Readable], list[UnreadableError]]:
    """Return the Parquet files that a name stands for, and the folders that cannot be searched for more."""
    if isinstance(text, TableInMemory):
        return [text], []
    _, files, denied = files_named(text)
    if not files and not denied:
        raise UnreadableError(f"{text}: no Parquet table there")
    return [*files], denied
