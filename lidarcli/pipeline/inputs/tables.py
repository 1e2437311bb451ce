"""From what a user names to the tables of a log: its objects and sweeps, its tracks, and what the metadata says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from lidarcli.choices import CHANGE_STATUSES
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.pipeline.inputs.files import Named, files_named
from lidarcli.reports.columns import Origin, Rows
from lidarcli.stores import Place, place
from lidarcli.tabular.reading import (
    MAKERS,
    HeldTable,
    Readable,
    column_names,
    note_value,
    notes_of,
    read_columns,
    read_pieces,
)
from lidarcli.tabular.schemas import CHANGES, SCHEMAS
from lidarcli.tabular.writing import DAMAGE, PARAMETERS, SOURCE, VERSION, table_suffix

_OBJECTS, _SWEEPS, _TRACKS = map(table_suffix, ("objects", "sweeps", "tracks"))
TRACK_COLUMNS = (
    *("log", "topic", "frame_id", "track", "set", "shape", "label", "sweeps", "duration"),
    *("distance", "end"),
    *("x", "y", "yaw", "length", "width", "length_sd", "width_sd"),
)
"""Columns of the tracks table that are read to compare runs."""


@dataclass(frozen=True, slots=True)
class Pair:
    """The tables of one log."""

    before: str
    """Beginning of their paths, up to the name of the table: `tables/run.` or `tables/`."""
    after: str
    """Rest of their paths after the name of the table: `.parquet` or `/run.parquet`."""

    @property
    def objects(self) -> Readable:
        """The objects table."""
        return self._table("objects")

    @property
    def sweeps(self) -> Readable:
        """The sweeps table."""
        return self._table("sweeps")

    @property
    def tracks(self) -> Readable:
        """The tracks table; it is there where things were followed."""
        return self._table("tracks")

    @property
    def trajectories(self) -> Readable:
        """The trajectories table; it need not be there."""
        return self._table("trajectories")

    @property
    def beams(self) -> Readable:
        """The beams table; it need not be there."""
        return self._table("beams")

    @property
    def events(self) -> Readable:
        """The events of zones; it need not be there."""
        return self._table("events")

    @property
    def zones(self) -> Readable:
        """The zones in every sweep; it is there where the events are."""
        return self._table("zones")

    @property
    def log(self) -> str:
        """The name of the log, as far as the paths tell it."""
        name = self.objects.name
        return name.removesuffix(_OBJECTS) if name.endswith(_OBJECTS) else name.removesuffix(".parquet")

    def _table(self, table: str) -> Readable:
        return place(f"{self.before}{table}{self.after}")


Given = str | Pair | HeldTable
"""A name of tables, the tables of a log, or a table of changes in memory."""


class Found(NamedTuple):
    """The tables that files, folders and patterns name, each once, in their order."""

    pairs: list[Pair]
    changes: list[Readable]
    """Tables of changes, which are those of several logs."""
    problems: list[UnreadableError]
    """Errors of other names."""


def find_tables(inputs: Iterable[Given]) -> Found:
    """Return the tables that files, folders and patterns name; those that are known stay as they are."""
    pairs: dict[Pair, None] = {}
    changes: dict[Readable, None] = {}
    problems = []
    for text in inputs:
        try:
            found = _tables_given(text)
        except UnreadableError as err:
            problems.append(err)
            continue
        pairs |= dict.fromkeys(found.pairs)
        changes |= dict.fromkeys(found.changes)
        problems += found.problems
    return Found([*pairs], [*changes], problems)


def find_pairs(inputs: Iterable[Given]) -> tuple[list[Pair], list[UnreadableError]]:
    """Return the tables of logs that `inputs` name, and errors of other names."""
    pairs, changes, problems = find_tables(inputs)
    others = [
        UnreadableError(f"{path}: this is the changes table of lidarcli diff; it is no table of a log")
        for path in (changes if not pairs else ())
    ]
    return pairs, [*problems, *others]


def one_pair(text: str | Pair) -> Pair:
    """Return the tables of the one log that a file, folder or pattern names.

    Raises
    ------
    UnreadableError
        There are none.
    OptionError
        There are those of several logs.
    """
    pairs, problems = find_pairs([text])
    if problems:
        raise problems[0]
    if len(pairs) > 1:
        raise OptionError(f"{text}: holds the tables of {len(pairs)} logs; name one of them")
    return pairs[0]


def table_files(inputs: Iterable[str]) -> list[Place]:
    """Return the files of all pairs that `inputs` name."""
    found = find_tables(inputs)
    changes = [path for path in found.changes if not isinstance(path, HeldTable)]
    return [*(getattr(pair, table) for pair in found.pairs for table in SCHEMAS), *changes]


def _tables_given(given: Given) -> Found:
    if isinstance(given, Pair):
        return Found([given], [], [])
    return Found([], [given], []) if isinstance(given, HeldTable) else _tables_named(given)


def _tables_named(text: str) -> Found:
    """Return the tables that a name stands for, and the errors of folders that cannot be searched."""
    named, files, denied = files_named(text)
    changes = [file for file in files if _is_of_changes(file, named)]
    tables = [(file, *known) for file in files if file not in changes and (known := _table_of(file)) is not None]
    if named is Named.FOLDER:
        # A log whose objects are gone cannot be read; it is not absent.
        tables = sorted(
            (each for each in tables if each[1] == "objects" or _is_named_below(text, each[0])),
            key=lambda each: each[1] != "objects",
        )
        if not tables and not changes and not denied:
            raise UnreadableError(f"{text}: no *{_OBJECTS} in this folder; write some with lidarcli detect")
    if not tables and not changes and not denied:
        if named is Named.FILE:
            raise UnreadableError(f"{text}: not a table of lidarcli detect (<log>{_OBJECTS} or <log>{_SWEEPS})")
        raise UnreadableError(f"{text}: no tables match this pattern")
    return Found([pair for _, _, pair in tables], [*changes], denied)


def _is_of_changes(file: Place, named: Named) -> bool:
    """Tell whether a file is a table of changes: by its name and columns; one that is named itself may have any name."""
    is_called_so = file.name == "changes.parquet" or file.name.endswith(".changes.parquet")
    is_other = named is not Named.FILE or _table_of(file) is not None
    if not is_called_so and (is_other or file.suffix != ".parquet"):
        return False
    try:
        return {*CHANGES.names} <= {*column_names(file, "changes")} or (is_called_so and not is_other)
    except UnreadableError:
        # Who reads it tells why it cannot be read.
        return is_called_so


def is_table(file: Place, table: str) -> bool:
    """Tell whether a file is such a table, by its name or by a folder above it."""
    found = _table_of(file)
    return found is not None and found[0] == table


def _is_named_below(folder: str, file: Place) -> bool:
    """Tell whether a file is a table by its path below a folder, whatever the folders above that are called."""
    root = str(place(folder)).rstrip("/")
    below = str(file).removeprefix(f"{root}/").split("/")
    return file.name.endswith(tuple(map(table_suffix, SCHEMAS))) or any(part in SCHEMAS for part in below[:-1])


def _table_of(file: Place) -> tuple[str, Pair] | None:
    """Return the name of the table that a file is, by its path, and the tables of its log; None for other files."""
    for table in SCHEMAS:
        if file.name.endswith(table_suffix(table)):
            return table, Pair(str(file).removesuffix(f"{table}.parquet"), ".parquet")
    if file.suffix != ".parquet":
        return None
    parts = str(file).split("/")
    for at in range(len(parts) - 2, -1, -1):
        if parts[at] in SCHEMAS:
            before = "".join(f"{part}/" for part in parts[:at])
            return parts[at], Pair(before, "".join(f"/{part}" for part in parts[at + 1 :]))
    return None


def read_table(pair: Pair, kind: str, columns: Iterable[str]) -> pa.Table:
    """Read columns of one of the tables of a log, or raise `UnreadableError`, of those in memory `OptionError`."""
    path = getattr(pair, kind)
    if not path.exists() and isinstance(path, HeldTable):
        raise OptionError(
            f"no {kind} table {f'of {pair.log} ' if pair.log else ''}among those in memory: give what "
            f"lidarcli.{MAKERS.get(kind, 'track')} returns as a whole"
        )
    if not path.exists():
        raise UnreadableError(f"{path}: not there; lidarcli {MAKERS.get(kind, 'detect')} writes it")
    return read_columns(path, kind, SCHEMAS[kind], columns)


def read_changes(path: Readable) -> pa.Table:
    """Read a table of changes, or raise `UnreadableError` with one line."""
    table = read_columns(path, "changes", CHANGES)
    if others := sorted({*table["status"].unique().to_pylist()} - {*CHANGE_STATUSES}):
        known = ", ".join(CHANGE_STATUSES)
        raise UnreadableError(f"{path}: column status holds {others[0]!r}; it can be one of {known}")
    return table


def read_tracks(pair: Pair, objects: pa.Table, columns: Iterable[str]) -> pa.Table | None:
    """Read columns of the tracks table of a log; None where it has none.

    Raises
    ------
    UnreadableError
        It cannot be read, or is not that of these objects: `detect` may have written them again.
    """
    if not pair.tracks.exists():
        return None
    tracks = read_table(pair, "tracks", {"topic", "track", *columns})
    known, seen = _numbers(tracks), _numbers(objects)
    if (known and not seen) or not seen <= known:
        raise UnreadableError(
            f"{pair.tracks}: does not belong to {pair.objects.name}, whose tracks are others; "
            "write both again with lidarcli track"
        )
    return tracks


def _numbers(table: pa.Table) -> set[tuple[str, float]]:
    """Return the tracks that rows are of: topic and number."""
    rows = Rows.join([table])
    code, topics = rows.words("topic")
    track = rows.numbers("track")
    mine = [np.unique(track[(code == k) & ~np.isnan(track)]) for k in range(len(topics))]
    return {(topic, number) for topic, numbers in zip(topics, mine, strict=True) for number in numbers.tolist()}


def origin_of(pair: Pair, sweeps: pa.Table) -> Origin:
    """Return the origin of a log as its sweeps table tells it; other programs that write tables may leave it out."""
    notes = notes_of(sweeps)
    origin = note_value(notes, SOURCE, dict)
    size, mask = origin.get("size"), origin.get("mask")
    # The name of the log as its rows have it: with its place below the folder that was given.
    log = str(sweeps["log"][0].as_py()) if sweeps.num_rows else pair.log
    return Origin(
        label=str(pair.objects),
        log=log,
        format=str(origin.get("format", "")),
        size=size if isinstance(size, int) else None,
        version=notes.get(VERSION, ""),
        parameters=note_value(notes, PARAMETERS, dict),
        mask=mask if isinstance(mask, dict) else {},
        damage=tuple(map(str, note_value(notes, DAMAGE, list))),
    )


def batches(pair: Pair, columns: list[str]) -> Iterator[pa.RecordBatch]:
    """Yield columns of the beams table piece by piece: it may be large."""
    return read_pieces(pair.beams, "beams", SCHEMAS["beams"], columns)


@dataclass(frozen=True, slots=True)
class TracksTable:
    """The tracks of one log."""

    path: Readable
    rows: pa.Table
    poses: dict[str, dict[str, Any]]
    """Sensor frame → the description of its poses; positions of other frames are in the sensor frame."""


def find_tracks(inputs: Iterable[str]) -> list[Place]:
    """Return the tracks tables that files, folders and patterns name, each once, in their order.

    Raises
    ------
    UnreadableError
        There is none where one was named.
    """
    found: dict[Place, None] = {}
    for text in inputs:
        found |= dict.fromkeys(_tables(text))
    return list(found)


def _tables(text: str) -> list[Place]:
    named, files, denied = files_named(text)
    if named is Named.FILE:
        return files
    if denied:
        raise denied[0]
    tables = [file for file in files if is_table(file, "tracks")]
    if not tables and named is Named.FOLDER:
        raise UnreadableError(f"{text}: no *{_TRACKS} in this folder; write some with lidarcli track")
    if not tables:
        raise UnreadableError(f"{text}: no tracks tables match this pattern")
    return tables


def read_tracks_table(path: Readable) -> TracksTable:
    """Read a tracks table, or `UnreadableError` with one line."""
    rows = read_columns(path, "tracks", SCHEMAS["tracks"], TRACK_COLUMNS)
    return TracksTable(path, rows, poses_of(note_value(notes_of(rows), SOURCE, dict)))


def poses_of(described: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the poses of each sensor frame, at least with their `world`, in what metadata say of a log."""
    poses = described.get("poses")
    found = poses.items() if isinstance(poses, dict) else ()
    return {frame: way for frame, way in found if isinstance(way, dict) and "world" in way}


def world_in(way: Mapping[str, Any], topic: str) -> str:
    """Return the fixed frame of a topic by the description of the poses of its sensor; empty where nobody tells."""
    world = way.get("world")
    world = world.get(topic) if isinstance(world, dict) else world
    return world.strip("/") if isinstance(world, str) else ""
