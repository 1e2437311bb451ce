"""From what a user names or holds in memory to the tables of a log: files, Arrow tables, data frames."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np
import pyarrow as pa

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.files.stores import Place, place
from lidarcli.options.choices import CHANGE_STATUSES
from lidarcli.options.times import SAME_STAMP
from lidarcli.pipeline.inputs.search import Named, files_named
from lidarcli.reports.columns import Origin, Rows, places, same_recording
from lidarcli.tabular.reading import (
    MAKERS,
    Readable,
    StoredTable,
    TableInMemory,
    column_names,
    file_metadata,
    is_text,
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
class TableSet:
    """The tables of one log."""

    before: str
    """Beginning of their paths, up to the name of the table: `tables/run.` or `tables/`."""
    after: str
    """Rest of their paths after the name of the table: `.parquet` or `/run.parquet`."""

    def __str__(self) -> str:
        return f"tables of {self.log}"

    def __getattr__(self, kind: str) -> Readable:
        """Return the table of a kind, such as `objects`; it need not be there."""
        if kind not in SCHEMAS:
            raise AttributeError(kind)
        return self._table(kind)

    @property
    def log(self) -> str:
        """The name of the log by the paths."""
        name = self.objects.name
        return name.removesuffix(_OBJECTS) if name.endswith(_OBJECTS) else name.removesuffix(".parquet")

    def _table(self, table: str) -> Readable:
        return place(f"{self.before}{table}{self.after}")


Given = str | TableSet | TableInMemory
"""A name of tables, the tables of a log, or a table of changes in memory."""


class NamedTables(NamedTuple):
    """The tables that files, folders and patterns name, each once, in their order."""

    table_sets: list[TableSet]
    changes: list[Readable]
    """Tables of changes, which are those of several logs."""
    problems: list[UnreadableError]
    """Errors of other names."""


def find_tables(inputs: Iterable[Given]) -> NamedTables:
    """Return the tables that files, folders and patterns name; those that are known stay as they are."""
    table_sets: dict[TableSet, None] = {}
    changes: dict[Readable, None] = {}
    problems = []
    for given in inputs:
        if isinstance(given, TableSet):
            table_sets[given] = None
        elif isinstance(given, TableInMemory):
            changes[given] = None
        else:
            try:
                named = _tables_named(given)
            except UnreadableError as err:
                problems.append(err)
                continue
            table_sets |= dict.fromkeys(named.table_sets)
            changes |= dict.fromkeys(named.changes)
            problems += named.problems
    return NamedTables([*table_sets], [*changes], problems)


def find_table_sets(inputs: Iterable[Given]) -> tuple[list[TableSet], list[UnreadableError]]:
    """Return the tables of logs that `inputs` name, and errors of other names."""
    table_sets, changes, problems = find_tables(inputs)
    for path in () if table_sets else changes:
        problems.append(UnreadableError(f"{path}: this is the changes table of lidarcli diff; it is no table of a log"))
    return table_sets, problems


def one_table_set(text: str | TableSet) -> TableSet:
    """Return the tables of the one log that a name stands for (`UnreadableError` for none, `OptionError` for several)."""
    table_sets, problems = find_table_sets([text])
    if problems:
        raise problems[0]
    if len(table_sets) > 1:
        raise OptionError(f"{text}: holds the tables of {len(table_sets)} logs; name one of them")
    return table_sets[0]


def table_files(inputs: Iterable[str]) -> list[Place]:
    """Return the files of all pairs that `inputs` name."""
    found = find_tables(inputs)
    changes = [path for path in found.changes if not isinstance(path, TableInMemory)]
    return [*(getattr(table_set, table) for table_set in found.table_sets for table in SCHEMAS), *changes]


def _tables_named(text: str) -> NamedTables:
    """Return the tables that a name stands for, and the errors of folders that cannot be searched."""
    named, files, denied = files_named(text)
    changes: list[Readable] = []
    tables: list[tuple[str, TableSet]] = []
    for file in files:
        known = _table_of(file)
        if _is_of_changes(file, any_name=named is Named.FILE and known is None):
            changes.append(file)
        # A log whose objects are gone cannot be read; it is not absent.
        elif known and (named is not Named.FOLDER or known[0] == "objects" or _is_named_below(text, file)):
            tables.append(known)
    if named is Named.FOLDER:
        tables.sort(key=lambda each: each[0] != "objects")
    if not tables and not changes and not denied:
        cause = {
            Named.FOLDER: f"no *{_OBJECTS} in this folder; write some with lidarcli detect",
            Named.FILE: f"not a table of lidarcli detect (<log>{_OBJECTS} or <log>{_SWEEPS})",
            Named.PATTERN: "no tables match this pattern",
        }
        raise UnreadableError(f"{text}: {cause[named]}")
    return NamedTables([table_set for _, table_set in tables], changes, denied)


def _is_of_changes(file: Place, any_name: bool) -> bool:
    """Return whether a file is a table of changes, by its name and columns, or by its columns alone."""
    is_called_so = f".{file.name}".endswith(".changes.parquet")
    if not is_called_so and not (any_name and file.suffix == ".parquet"):
        return False
    try:
        return {*CHANGES.names} <= {*column_names(file, "changes")} or (is_called_so and any_name)
    except UnreadableError:
        # Its reader reports why it cannot be read.
        return is_called_so


def _is_named_below(folder: str, file: Place) -> bool:
    """Return whether a file is a table by its path below a folder, whatever the folders above that are called."""
    root = str(place(folder)).rstrip("/")
    below = str(file).removeprefix(f"{root}/").split("/")
    return file.name.endswith(tuple(map(table_suffix, SCHEMAS))) or any(part in SCHEMAS for part in below[:-1])


def _table_of(file: Place) -> tuple[str, TableSet] | None:
    """Return the name of the table that a file is, by its path, and the tables of its log; None for other files."""
    for table in SCHEMAS:
        if file.name.endswith(table_suffix(table)):
            return table, TableSet(str(file).removesuffix(f"{table}.parquet"), ".parquet")
    if file.suffix != ".parquet":
        return None
    parts = str(file).split("/")
    for at in range(len(parts) - 2, -1, -1):
        if parts[at] in SCHEMAS:
            before = "".join(f"{part}/" for part in parts[:at])
            return parts[at], TableSet(before, "".join(f"/{part}" for part in parts[at + 1 :]))
    return None


def read_table(table_set: TableSet, kind: str, columns: Iterable[str], *, stored: bool = False) -> pa.Table | StoredTable:
    """Read columns of one of the tables of a log, or raise `UnreadableError`, of those in memory `OptionError`.

    `stored`: check them, and leave them where they are until they are asked for.
    """
    path = getattr(table_set, kind)
    if not path.exists() and isinstance(path, TableInMemory):
        raise OptionError(
            f"no {kind} table {f'of {table_set.log} ' if table_set.log else ''}among those in memory: give what "
            f"lidarcli.{MAKERS.get(kind, 'track')} returns as a whole"
        )
    if not path.exists():
        raise UnreadableError(f"{path}: not there; lidarcli {MAKERS.get(kind, 'detect')} writes it")
    return StoredTable.of(path, kind, columns) if stored else read_columns(path, kind, SCHEMAS[kind], columns)


def read_together(table_set: TableSet, columns: Mapping[str, Iterable[str]]) -> dict[str, pa.Table]:
    """Read some tables of a log, each with its columns (`UnreadableError` also where they are of several logs)."""
    read = {kind: read_table(table_set, kind, names) for kind, names in columns.items()}
    refuse_mixed(table_set, read)
    return read


def tables_together(text: str | TableSet) -> TableSet:
    """Return `one_table_set`, once it is known that its tables are of one log (`UnreadableError`)."""
    table_set = one_table_set(text)
    keys = {"sweeps": ("topic", "sweep", "stamp"), "objects": ("topic",), "tracks": ("topic",)}
    keys["trajectories"] = keys["sweeps"]
    if found := {kind: names for kind, names in keys.items() if getattr(table_set, kind).exists()}:
        read_together(table_set, found)
    return table_set


def read_changes(path: Readable) -> pa.Table:
    """Read a table of changes, or raise `UnreadableError` with one line."""
    table = read_columns(path, "changes", CHANGES)
    if others := sorted({*table["status"].unique().to_pylist()} - {*CHANGE_STATUSES}):
        known = ", ".join(CHANGE_STATUSES)
        raise UnreadableError(f"{path}: column status holds {others[0]!r}; it can be one of {known}")
    return table


def read_tracks(table_set: TableSet, objects: pa.Table | StoredTable, columns: Iterable[str]) -> pa.Table | None:
    """Read columns of the tracks table of a log; None where it has none.

    `UnreadableError`: it cannot be read, or is not that of these objects: `detect` may have written them again.
    """
    if not table_set.tracks.exists():
        return None
    tracks = read_table(table_set, "tracks", {"topic", "track", *columns})
    known, used = _numbers(tracks), _numbers(objects)
    # Tracks without a topic are those of several.
    shared = {number for topic, number in known if not topic}
    if (known and not used) or any(each not in known and each[1] not in shared for each in used):
        raise UnreadableError(
            f"{table_set.tracks}: does not belong to {table_set.objects.name}, whose tracks are others; "
            "write both again with lidarcli track"
        )
    return tracks


def _numbers(table: pa.Table | StoredTable) -> set[tuple[str, float]]:
    """Return the tracks that rows are of: topic and number."""
    found: set[tuple[str, float]] = set()
    names = ("topic", "track")
    for piece in table.batches(names) if isinstance(table, StoredTable) else table.select(names).to_batches():
        rows = Rows.join([pa.Table.from_batches([piece])])
        code, topics = rows.words("topic")
        track = rows.numbers("track")
        own = [np.unique(track[(code == k) & ~np.isnan(track)]) for k in range(-1, len(topics))]
        found |= {(topic, number) for topic, numbers in zip(["", *topics], own, strict=True) for number in numbers.tolist()}
    return found


def origin_of(table_set: TableSet, sweeps: pa.Table | StoredTable) -> Origin:
    """Return the origin of a log by its sweeps table; other programs that write tables may leave it out."""
    notes = notes_of(sweeps)
    origin = note_value(notes, SOURCE, dict)
    size, mask = origin.get("size"), origin.get("mask")
    # The name of the log as its rows have it: with its place below the folder that was given.
    log = str(sweeps["log"][0].as_py()) if sweeps.num_rows else table_set.log
    return Origin(
        label=str(table_set.objects),
        log=log,
        format=str(origin.get("format", "")),
        size=size if isinstance(size, int) else None,
        version=notes.get(VERSION, ""),
        parameters=note_value(notes, PARAMETERS, dict),
        mask=mask if isinstance(mask, dict) else {},
        damage=tuple(map(str, note_value(notes, DAMAGE, list))),
        recording=recording_in(notes),
    )


def batches(table_set: TableSet, columns: list[str]) -> Iterator[pa.RecordBatch]:
    """Yield columns of the beams table piece by piece: it may be large."""
    return read_pieces(table_set.beams, "beams", SCHEMAS["beams"], columns)


@dataclass(frozen=True, slots=True)
class TracksTable:
    """The tracks of one log."""

    path: Readable
    rows: pa.Table
    poses: dict[str, dict[str, Any]]
    """Sensor frame → the description of its poses; positions of other frames are in the sensor frame."""


def find_tracks(inputs: Iterable[str]) -> list[Place]:
    """Return the tracks tables that files, folders and patterns name, each once (`UnreadableError` where there is none)."""
    tracks: dict[Place, None] = {}
    for text in inputs:
        named, files, denied = files_named(text)
        if denied:
            raise denied[0]
        if named is not Named.FILE:
            files = [file for file in files if (known := _table_of(file)) is not None and known[0] == "tracks"]
        if not files:
            in_folder = f"no *{_TRACKS} in this folder; write some with lidarcli track"
            raise UnreadableError(
                f"{text}: {in_folder if named is Named.FOLDER else 'no tracks tables match this pattern'}"
            )
        tracks |= dict.fromkeys(files)
    return [*tracks]


def read_tracks_table(path: Readable) -> TracksTable:
    """Read a tracks table, or `UnreadableError` with one line."""
    rows = read_columns(path, "tracks", SCHEMAS["tracks"], TRACK_COLUMNS)
    return TracksTable(path, rows, poses_of(note_value(notes_of(rows), SOURCE, dict)))


def poses_of(described: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the poses of each sensor frame, at least with their `world`, in what metadata say of a log."""
    poses = described.get("poses")
    found = poses.items() if isinstance(poses, dict) else ()
    return {frame: pose for frame, pose in found if isinstance(pose, dict) and "world" in pose}


def world_in(description: Mapping[str, Any], topic: str) -> str:
    """Return the fixed frame of a topic by the description of the poses of its sensor; empty where it is not known."""
    world = description.get("world")
    world = world.get(topic) if isinstance(world, dict) else world
    return world.strip("/") if isinstance(world, str) else ""


def contradicted(description: Mapping[str, Any], gap: str = "") -> dict[str, tuple[str, bool]]:
    """Return the topics whose sweeps contradict the given poses, by the description of the poses of a sensor: what is wrong
    and the remedy in words, and True where no sweep has a pose, as clocks differ; `gap`: when poses of a file begin.
    """
    from lidarcli.pose.findings import clock_words
    from lidarcli.pose.fit import CORRECTED

    fits, delays, found = description.get("pose_fit"), description.get("pose_delay"), {}
    for topic, fit in fits.items() if isinstance(fits, dict) else ():
        if not isinstance(fit, int | float) or not fit < CORRECTED:
            continue
        delay = delays.get(topic) if isinstance(delays, dict) else 0.0
        is_apart = fit == 0.0 and bool(delay is None or delay)
        words = f"contradict the sweeps of {topic}; nothing written; give other poses (--pose TOPIC, --poses FILE)"
        if is_apart:
            why = clock_words("these", delay) if delay else f"they {gap}" if gap else "no sweep has one"
            way = "--pose-delay" if gap else "--pose-delay or clean --mend clock"
            words = f"are of other times than {topic}, {why}; nothing written; {way} may help"
        found[topic] = words, is_apart
    return found


WHOLE: dict[str, Any] = {"start": None, "end": None, "run": None, "every": 1}
"""Parameters of the part of a recording that tables are of; the values for all of it."""


def recording_in(notes: Mapping[str, str]) -> dict[str, str]:
    """Return what metadata say of the recording of a log (`LogBatcher.recording`)."""
    found = note_value(notes, SOURCE, dict).get("recording")
    return found if isinstance(found, dict) else {}


def other_recording(table_set: TableSet, recording: Mapping[str, str]) -> list[str]:
    """Return a note where the tables are not of the recording that is read, though its sweeps have the same stamps."""
    if same_recording(recording_in(file_metadata(table_set.sweeps)), recording) is not False:
        return []
    return [f"{table_set.sweeps}: of another recording with the same stamps, or of a changed copy"]


def refuse_mixed(table_set: TableSet, tables: Mapping[str, pa.Table | StoredTable]) -> None:
    """Refuse tables that were named as those of one log and are not: of another recording, or of another part of it.

    `tables` by their kind, that of the sweeps first; those that other programs wrote are known by their stamps alone.
    """
    (first, sweeps), *others = tables.items()
    notes, keys = notes_of(sweeps), {"topic", "sweep", "stamp"}
    for kind, table in others:
        own, why = notes_of(table), ""
        reported = [WHOLE | note_value(each, PARAMETERS, dict) for each in (notes, own)]
        if PARAMETERS in notes.keys() & own.keys() and any(reported[0][name] != reported[1][name] for name in WHOLE):
            why = "is of another part of the log: make both with the same --start, --end, --run and --every"
        if keys <= {*sweeps.column_names} & {*table.column_names} and min(len(sweeps), len(table)):
            rows = Rows.join([sweeps]), Rows.join([table])
            here, there = places(*rows)
            _, at, which = np.intersect1d(here, there, return_indices=True)
            stamps = rows[0].integers("stamp")[at] - rows[1].integers("stamp")[which]
            shared = rows[0].counts("topic").keys() & rows[1].counts("topic").keys()
            if (np.abs(stamps) > SAME_STAMP).any() or (shared and not len(at)):
                why = "has sweeps of other stamps: it is of another log"
        if same_recording(*map(recording_in, (notes, own))) is False:
            why = "is of another recording"
        if why:
            raise UnreadableError(f"{getattr(table_set, kind)}: does not belong to {getattr(table_set, first).name}: {why}")


KEYS = ("log", "topic")
"""Columns of every table of logs."""
_SWEEPS_OF: dict[int, tuple[pa.Table, int]] = {}
"""Objects table in memory, by its identity, that a Python function returned → its sweeps table, and its own rows then."""


@dataclass(frozen=True, slots=True, eq=False)
class HeldTableSet(TableSet):
    """The tables of one log that are in memory, named as files of them would be."""

    held: dict[str, pa.Table]

    def _table(self, table: str) -> TableInMemory:
        return TableInMemory(f"{self.before}{table}{self.after}", self.held.get(table))


def remember_sweeps(objects: Any, sweeps: pa.Table) -> None:
    """Remember the sweeps table of an objects table while that lives: by itself it has no sweep without objects."""
    _SWEEPS_OF[id(objects)] = sweeps, len(objects)
    finalize(objects, _SWEEPS_OF.pop, id(objects), None)


def is_in_memory(value: Any) -> bool:
    """Return whether a value is a table: of Arrow, pandas, polars or any library that hands out Arrow streams."""
    # A series of paths hands out a stream, too, but has no columns.
    return _is_frame(value) or (hasattr(value, "__arrow_c_stream__") and hasattr(value, "columns"))


def arrow_of(value: Any) -> pa.Table:
    """Return a table as one of Arrow; the metadata of a data frame are its `attrs`."""
    if isinstance(value, pa.Table):
        return value
    try:
        if not _is_frame(value):
            return pa.table(value)
        table = pa.Table.from_pandas(value, preserve_index=False)
    except (pa.ArrowException, ValueError, TypeError) as err:
        raise OptionError(f"a {type(value).__name__} that is no table: {' '.join(str(err).split())}") from None
    # A category without a value has no type.
    for at, field in enumerate(table.schema):
        if pa.types.is_dictionary(field.type) and pa.types.is_null(field.type.value_type):
            table = table.set_column(at, field.name, pa.nulls(table.num_rows))
    notes = {key: note for key, note in value.attrs.items() if isinstance(key, str) and isinstance(note, str)}
    return table.replace_schema_metadata(notes)


def table_sets_of(tables: Sequence[Any]) -> list[HeldTableSet]:
    """Return the tables of each log, of some that belong together (`OptionError` where two of a kind are of one log)."""
    known = [(_kind_of(table), table) for table in map(arrow_of, tables)]
    if all(kind != "sweeps" for kind, _ in known):
        for table in tables:
            sweeps, rows = _SWEEPS_OF.get(id(table), (None, 0))
            if sweeps is not None and rows == len(table):
                known.append(("sweeps", sweeps))
    split = [(kind, table, _by_log(table)) for kind, table in known]
    # The order of the logs is that of their sweeps, which every log has.
    ordered = sorted(split, key=lambda each: each[0] != "sweeps")
    logs = dict.fromkeys(log for _, _, parts in ordered for log in parts)
    found = []
    for log in logs or {"": None}:
        held: dict[str, pa.Table] = {}
        for kind, table, parts in split:
            part = parts.get(log)
            if part is None and kind in held:
                continue
            if part is not None and kind in held and held[kind].num_rows:
                raise OptionError(f"two {kind} tables hold rows of {log}: name one of them")
            held[kind] = _rows_of_log(table.slice(0, 0) if part is None else part, log, [*logs])
        found.append(HeldTableSet(f"{log}." if log else "", ".parquet", held))
    return found


def tables_of(values: Any) -> list[Given]:
    """Return tables, each named by a path or in memory (`TypeError`); those of a tuple belong together."""
    found: list[Given] = []
    table_sets: list[HeldTableSet] = []
    loose: list[Any] = []
    for each in _each_table(values):
        if isinstance(each, str):
            found.append(each)
        elif isinstance(each, list):
            table_sets += table_sets_of(each)
        elif {*(table := arrow_of(each)).column_names} >= {"log_a", "log_b", "status"}:
            found.append(TableInMemory("changes.parquet", table))
        else:
            loose.append(each)
    return [*found, *_joined([*table_sets, *(table_sets_of(loose) if loose else ())])]


def tables_to_export(values: Any) -> list[str | TableInMemory]:
    """Return tables of any kind, each named by a path or in memory (`TypeError` if one is neither)."""
    given = [*_each_table(values)]
    if any(isinstance(each, list) for each in given):
        raise TypeError("tables of one kind are exported at a time: give one of these, as .objects")
    return [each if isinstance(each, str) else TableInMemory("the table", arrow_of(each)) for each in given]


def _each_table(values: Any) -> Iterator[Any]:
    """Yield the path of each table as text, a table itself, or the list of those that a function returned together."""
    made = (isinstance(values, tuple) and hasattr(values, "_fields")) or _has_changes(values)
    given = [values] if isinstance(values, str | PathLike) or is_in_memory(values) or made else values
    if not isinstance(given, Iterable) or isinstance(given, Mapping):
        raise TypeError(_no_table(values))
    for each in given:
        if isinstance(each, str | PathLike):
            yield fspath(each)
        elif is_in_memory(each):
            yield each
        elif isinstance(each, tuple) and hasattr(each, "_fields"):
            together = [*each, *(getattr(each, name, None) for name in ("trajectories", "beams"))]
            yield [*{id(table): table for table in together if table is not None}.values()]
        elif _has_changes(each):
            yield each.changes
        else:
            raise TypeError(_no_table(each))


def _no_table(value: Any) -> str:
    return (
        "tables are named by their paths, or are what detect, track, tables, zones and diff return, Arrow tables or "
        f"data frames, not {type(value).__name__}"
    )


def _has_changes(value: Any) -> bool:
    """Return whether a value is what `diff` returns."""
    return is_in_memory(getattr(value, "changes", None))


def _joined(table_sets: Sequence[HeldTableSet]) -> list[HeldTableSet]:
    """Return table sets, those of one log as one where they hold other kinds, as what `track` and `zones` return."""
    found: list[HeldTableSet] = []
    for new in table_sets:
        same = [k for k, one in enumerate(found) if one.before == new.before and not one.held.keys() & new.held.keys()]
        if same:
            found[same[0]] = replace(new, held=found[same[0]].held | new.held)
        else:
            found.append(new)
    return found


def _is_frame(value: Any) -> bool:
    """Return whether a value is a data frame of pandas, which nobody imports for the question."""
    pandas = sys.modules.get("pandas")
    return pandas is not None and isinstance(value, pandas.DataFrame)


def _kind_of(table: pa.Table) -> str:
    """Return the kind of a table, by its columns: that which has most of them."""
    names = {*table.column_names}
    if not names.issuperset(KEYS):
        some = ", ".join(table.column_names[:10])
        raise OptionError(f"a table with the columns {some} is none of lidarcli: no column {' or '.join(KEYS)}")
    for name in KEYS:
        if (times := table.column_names.count(name)) > 1:
            raise OptionError(f"a table in memory has {times} columns {name}, not one")
    return max(SCHEMAS, key=lambda kind: len(names & {*SCHEMAS[kind].names}) - len(SCHEMAS[kind]) / 1000)


def _by_log(table: pa.Table) -> dict[str, pa.Table]:
    """Return the rows of each log."""
    import pyarrow.compute as pc

    if not is_text(table["log"].type):
        raise OptionError(f"column log is {table['log'].type}, not text: it names the log of each row")
    names = table["log"].cast(pa.string())
    logs = names.unique().drop_null().to_pylist()
    return {log: table if len(logs) == 1 else table.filter(pc.equal(names, log)) for log in logs}


def _rows_of_log(table: pa.Table, log: str, logs: Sequence[str]) -> pa.Table:
    """Return the rows of one of several logs with the metadata that are about it."""
    notes = notes_of(table)
    sources, damage = note_value(notes, SOURCE, list), note_value(notes, DAMAGE, list)
    if not sources:
        return table
    if len(sources) == len(logs) and log in logs:
        notes[SOURCE] = json.dumps(sources[logs.index(log)])
    else:
        notes.pop(SOURCE)
    if DAMAGE in notes:
        # Lines that name no log are the first one's.
        owners = [next((each for each in logs if str(line).startswith(f"{each}: ")), logs[0]) for line in damage]
        notes[DAMAGE] = json.dumps([line for line, owner in zip(damage, owners, strict=True) if owner == log])
    return table.replace_schema_metadata(notes)
