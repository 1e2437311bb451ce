"""From what a user names to tracks tables, and what they say of the frames of their places."""

from __future__ import annotations

import glob
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from lidarcli.errors import UnreadableError
from lidarcli.tables import metadata
from lidarcli.tables.files import table_suffix
from lidarcli.tables.reading import notes_of, parsed, read_columns
from lidarcli.tables.schemas import SCHEMAS

_TRACKS = table_suffix("tracks")
COLUMNS = (
    *("log", "topic", "frame_id", "track", "set", "shape", "label"),
    *("x", "y", "length", "width", "length_sd", "width_sd"),
)


@dataclass(frozen=True, slots=True)
class TracksTable:
    """The things of one log."""

    path: Path
    rows: pa.Table
    worlds: dict[str, str]
    """Sensor frame → the world frame that its places are in; those of other frames are the sensor's."""


def find_tracks(inputs: Iterable[str]) -> list[Path]:
    """The tracks tables that files, folders and patterns name, each once, in their order.

    Raises
    ------
    UnreadableError
        There is none where one was named.
    """
    found: dict[Path, None] = {}
    for text in inputs:
        found |= dict.fromkeys(_tables(text))
    return list(found)


def _tables(text: str) -> list[Path]:
    path = Path(text)
    if path.is_dir():
        # Hidden folders hold what is still being written.
        there = sorted(path.rglob(f"*{_TRACKS}"))
        files = [
            file for file in there if not any(part.startswith(".") for part in file.relative_to(path).parts)
        ]
        if not files:
            raise UnreadableError(f"{text}: no *{_TRACKS} in this folder; write some with lidarcli track")
        return files
    if path.exists():
        return [path]
    matching = sorted(glob.glob(text)) if glob.has_magic(text) else []  # noqa: PTH207 (absolute patterns too)
    files = [Path(file) for file in matching if file.endswith(_TRACKS)]
    if not files:
        why = "no tracks tables match this pattern" if glob.has_magic(text) else "no such file or folder"
        raise UnreadableError(f"{text}: {why}")
    return files


def read_tracks(path: Path) -> TracksTable:
    """Read a tracks table, or `UnreadableError` with one line."""
    rows = read_columns(path, "tracks", SCHEMAS["tracks"], COLUMNS)
    return TracksTable(path, rows, _worlds(notes_of(rows)))


def _worlds(notes: dict[str, str]) -> dict[str, str]:
    """The world of each sensor frame, as far as the metadata says; another program may have left it out."""
    try:
        source = parsed(notes.get(metadata.SOURCE, "null"))
    except ValueError:
        return {}
    poses: Any = source.get("poses") if isinstance(source, dict) else None
    if not isinstance(poses, dict):
        return {}
    return {
        frame: way["world"].strip("/")
        for frame, way in poses.items()
        if isinstance(way, dict) and isinstance(way.get("world"), str)
    }
