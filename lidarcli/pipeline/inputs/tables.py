"""From what a user names to the tables of a log: objects and sweeps, and what else there is of it."""

from __future__ import annotations

import glob
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.reports.columns import Origin
from lidarcli.tables import metadata
from lidarcli.tables.files import table_suffix
from lidarcli.tables.reading import column_names, notes_of, parsed, read_columns, read_pieces
from lidarcli.tables.schemas import SCHEMAS

_OBJECTS, _SWEEPS, _TRACKS, _BEAMS = map(table_suffix, SCHEMAS)


@dataclass(frozen=True, slots=True)
class Pair:
    """The tables of one log."""

    stem: Path
    """Their common path, without `.objects.parquet`."""

    @property
    def objects(self) -> Path:
        """The objects table."""
        return Path(f"{self.stem}{_OBJECTS}")

    @property
    def sweeps(self) -> Path:
        """The sweeps table."""
        return Path(f"{self.stem}{_SWEEPS}")

    @property
    def tracks(self) -> Path:
        """The tracks table; it is there where things were followed."""
        return Path(f"{self.stem}{_TRACKS}")

    @property
    def beams(self) -> Path:
        """The beams table; it need not be there."""
        return Path(f"{self.stem}{_BEAMS}")


def find_pairs(inputs: Iterable[str]) -> tuple[list[Pair], list[UnreadableError]]:
    """The pairs that files, folders and patterns name, each once, in their order, and what is no table."""
    stems: dict[Path, None] = {}
    problems = []
    for text in inputs:
        try:
            stems |= dict.fromkeys(_stems(text))
        except UnreadableError as err:
            problems.append(err)
    return [Pair(stem) for stem in stems], problems


def one_pair(text: str) -> Pair:
    """The tables of the one log that a file, folder or pattern names.

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


def table_files(inputs: Iterable[str]) -> list[Path]:
    """The files of all pairs that `inputs` name."""
    pairs, _ = find_pairs(inputs)
    return [path for pair in pairs for path in (pair.objects, pair.sweeps, pair.tracks, pair.beams)]


def _stems(text: str) -> list[Path]:
    path = Path(text)
    if path.is_dir():
        # Hidden folders hold what is still being written.
        there = (file for file in path.rglob(f"*{_OBJECTS}") if not _is_hidden(file.relative_to(path)))
        found = sorted(map(_stem, there))
        if not found:
            raise UnreadableError(f"{text}: no *{_OBJECTS} in this folder; write some with lidarcli detect")
        return found
    if path.exists():
        return [_stem(path)]
    files = sorted(glob.glob(text)) if glob.has_magic(text) else []  # noqa: PTH207 (absolute patterns too)
    tables = [Path(file) for file in files if file.endswith((_OBJECTS, _SWEEPS, _TRACKS, _BEAMS))]
    if not tables:
        why = "no tables match this pattern" if glob.has_magic(text) else "no such file or folder"
        raise UnreadableError(f"{text}: {why}")
    return [_stem(table) for table in tables]


def _is_hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)


def _stem(path: Path) -> Path:
    for suffix in (_OBJECTS, _SWEEPS, _TRACKS, _BEAMS):
        if path.name.endswith(suffix):
            return path.with_name(path.name.removesuffix(suffix))
    raise UnreadableError(f"{path}: not a table of lidarcli detect (<log>{_OBJECTS} or <log>{_SWEEPS})")


def read_table(pair: Pair, kind: str, columns: Iterable[str]) -> pa.Table:
    """Columns of one of the tables of a log, or `UnreadableError` with one line."""
    path = getattr(pair, kind)
    if not path.exists():
        raise UnreadableError(
            f"{path}: not there; a report needs both the objects and the sweeps table of a log"
        )
    return read_columns(path, kind, SCHEMAS[kind], columns)


def require(pair: Pair, kind: str, columns: Collection[str]) -> None:
    """Refuse a table without these columns, which are null where an older version has written it."""
    there = column_names(getattr(pair, kind), kind) if columns else []
    missing = sorted({*columns} - {*there})
    if missing:
        raise UnreadableError(
            f"{getattr(pair, kind)}: no column {', '.join(missing)}, which a check asks for; "
            "an older version has written this table"
        )


def read_tracks(pair: Pair, objects: pa.Table, columns: Iterable[str]) -> pa.Table | None:
    """Columns of the tracks table of a log, None where it has none.

    Raises
    ------
    UnreadableError
        It cannot be read, or is not that of these objects: `detect` may have written them again.
    """
    if not pair.tracks.exists():
        return None
    tracks = read_table(pair, "tracks", {"topic", "track", *columns})
    known = {(row["topic"], row["track"]) for row in tracks.select(["topic", "track"]).to_pylist()}
    rows = objects.select(["topic", "track"]).drop_null()
    seen = rows.group_by(["topic", "track"]).aggregate([]).to_pylist()
    if (known and not seen) or any((row["topic"], row["track"]) not in known for row in seen):
        raise UnreadableError(
            f"{pair.tracks}: does not belong to {pair.objects.name}, whose tracks are others; "
            "write both again with lidarcli track"
        )
    return tracks


def origin_of(pair: Pair, sweeps: pa.Table) -> Origin:
    """What the sweeps table says of the log; another program that wrote it may have left that out."""
    notes = notes_of(sweeps)
    origin = _value(notes, metadata.SOURCE, dict)
    size = origin.get("size")
    # The name of the log as its rows have it: with its place below the folder that was given.
    log = str(sweeps["log"][0].as_py()) if sweeps.num_rows else pair.stem.name
    return Origin(
        label=str(pair.objects),
        log=log,
        format=str(origin.get("format", "")),
        size=size if isinstance(size, int) else None,
        version=notes.get(metadata.VERSION, ""),
        parameters=_value(notes, metadata.PARAMETERS, dict),
        damage=tuple(map(str, _value(notes, metadata.DAMAGE, list))),
    )


def batches(pair: Pair, columns: list[str]) -> Iterator[pa.RecordBatch]:
    """Columns of the beams table piece by piece: it may be large."""
    return read_pieces(pair.beams, "beams", SCHEMAS["beams"], columns)


def _value(notes: dict[str, str], key: str, kind: type) -> Any:
    try:
        value = parsed(notes.get(key, "null"))
    except ValueError:
        value = None
    return value if isinstance(value, kind) else kind()
