"""From what a user names to pairs of tables: an objects and a sweeps table of the same log."""

from __future__ import annotations

import glob
import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.errors import UnreadableError
from lidarcli.reports.columns import Source
from lidarcli.tables import metadata

OBJECTS, SWEEPS, BEAMS = ".objects.parquet", ".sweeps.parquet", ".beams.parquet"


@dataclass(frozen=True, slots=True)
class Pair:
    """The tables of one log."""

    stem: Path
    """Their common path, without `.objects.parquet`."""

    @property
    def objects(self) -> Path:
        """The objects table."""
        return Path(f"{self.stem}{OBJECTS}")

    @property
    def sweeps(self) -> Path:
        """The sweeps table."""
        return Path(f"{self.stem}{SWEEPS}")

    @property
    def beams(self) -> Path:
        """The beams table; it need not be there."""
        return Path(f"{self.stem}{BEAMS}")


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


def table_files(inputs: Iterable[str]) -> list[Path]:
    """The files of all pairs that `inputs` name."""
    pairs, _ = find_pairs(inputs)
    return [path for pair in pairs for path in (pair.objects, pair.sweeps, pair.beams)]


def _stems(text: str) -> list[Path]:
    path = Path(text)
    if path.is_dir():
        # Hidden folders hold what is still being written.
        there = (file for file in path.rglob(f"*{OBJECTS}") if not _is_hidden(file.relative_to(path)))
        found = sorted(map(_stem, there))
        if not found:
            raise UnreadableError(f"{text}: no *{OBJECTS} in this folder; write some with lidarcli detect")
        return found
    if path.exists():
        return [_stem(path)]
    files = sorted(glob.glob(text)) if glob.has_magic(text) else []  # noqa: PTH207 (absolute patterns too)
    tables = [Path(file) for file in files if file.endswith((OBJECTS, SWEEPS, BEAMS))]
    if not tables:
        why = "no tables match this pattern" if glob.has_magic(text) else "no such file or folder"
        raise UnreadableError(f"{text}: {why}")
    return [_stem(table) for table in tables]


def _is_hidden(path: Path) -> bool:
    return any(part.startswith(".") for part in path.parts)


def _stem(path: Path) -> Path:
    for suffix in (OBJECTS, SWEEPS, BEAMS):
        if path.name.endswith(suffix):
            return path.with_name(path.name.removesuffix(suffix))
    raise UnreadableError(f"{path}: not a table of lidarcli detect (<log>{OBJECTS} or <log>{SWEEPS})")


def read_columns(path: Path, columns: Iterable[str]) -> pa.Table:
    """The columns of a table, or `UnreadableError` with one line."""
    wanted = sorted(set(columns))
    with _opened(path) as file:
        missing = [name for name in wanted if name not in file.schema_arrow.names]
        if missing:
            raise UnreadableError(f"{path}: not a table of lidarcli detect: no column {', '.join(missing)}")
        try:
            return file.read(columns=wanted, use_threads=False)
        except (OSError, pa.ArrowException) as err:
            raise _unreadable(path, err) from err


def read_source(pair: Pair) -> Source:
    """What the tables say of their log."""
    with _opened(pair.sweeps) as file:
        notes = file.schema_arrow.metadata or {}
    origin = _json(notes, metadata.SOURCE, dict)
    size = origin.get("size")
    return Source(
        label=str(pair.objects),
        log=pair.stem.name,
        format=str(origin.get("format", "")),
        size=size if isinstance(size, int) else None,
        version=notes.get(metadata.VERSION.encode(), b"").decode("utf-8", "replace"),
        parameters=_json(notes, metadata.PARAMETERS, dict),
        damage=tuple(map(str, _json(notes, metadata.DAMAGE, list))),
    )


def batches(path: Path, columns: list[str]) -> Iterator[pa.RecordBatch]:
    """The columns of a large table piece by piece."""
    with _opened(path) as file:
        try:
            yield from file.iter_batches(columns=columns, use_threads=False)
        except (OSError, pa.ArrowException) as err:
            raise _unreadable(path, err) from err


def _opened(path: Path) -> pq.ParquetFile:
    if not path.exists():
        raise UnreadableError(
            f"{path}: not there; a report needs both the objects and the sweeps table of a log"
        )
    try:
        return pq.ParquetFile(path)
    except (OSError, pa.ArrowException) as err:
        raise _unreadable(path, err) from err


def _unreadable(path: Path, err: Exception) -> UnreadableError:
    return UnreadableError(f"{path}: cannot be read as Parquet: {str(err).splitlines()[0]}")


def _json(notes: dict[bytes, bytes], key: str, kind: type) -> Any:
    try:
        value = json.loads(notes.get(key.encode(), b"null"))
    except ValueError:
        value = None
    return value if isinstance(value, kind) else kind()
