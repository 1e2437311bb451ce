"""From what a user names to tracks tables, and what they say of the frames of their places."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from lidarcli.errors import UnreadableError
from lidarcli.pipeline.inputs.files import Named, files_named
from lidarcli.pipeline.inputs.tables import is_table
from lidarcli.stores.url import Place
from lidarcli.tabular import metadata
from lidarcli.tabular.files import table_suffix
from lidarcli.tabular.reading import notes_of, parsed, read_columns
from lidarcli.tabular.schemas import SCHEMAS

_TRACKS = table_suffix("tracks")
COLUMNS = (
    *("log", "topic", "frame_id", "track", "set", "shape", "label"),
    *("x", "y", "length", "width", "length_sd", "width_sd"),
)


@dataclass(frozen=True, slots=True)
class TracksTable:
    """The things of one log."""

    path: Place
    rows: pa.Table
    worlds: dict[str, str]
    """Sensor frame → the world frame that its places are in; those of other frames are the sensor's."""


def find_tracks(inputs: Iterable[str]) -> list[Place]:
    """The tracks tables that files, folders and patterns name, each once, in their order.

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


def read_tracks(path: Place) -> TracksTable:
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
