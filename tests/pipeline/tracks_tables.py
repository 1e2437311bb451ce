"""Tracks tables as `track` writes them, of things that the tests make up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.tabular.reading import read_schema
from lidarcli.tabular.schemas import TRACKS
from lidarcli.tabular.writing import table_metadata

ROOM: tuple[dict[str, Any], ...] = (
    {"x": 2.0, "y": -1.4, "length": 0.8, "width": 0.6, "shape": "prismatic", "label": "brown box"},
    {"x": 2.5, "y": 0.8, "length": 0.7, "width": 0.5, "shape": "prismatic", "label": "brown box"},
    {"x": 0.9, "y": 2.1, "length": 0.55, "width": 0.45, "shape": "legged"},
    {"x": -1.5, "y": 1.7, "length": 0.5, "width": 0.5, "shape": "irregular"},
    {"x": -1.9, "y": -0.9, "length": 0.4, "width": 0.3, "shape": "prismatic"},
)
"""The five things of the sample room."""
_PLAIN: dict[str, Any] = {
    "topic": "/scan",
    "frame_id": "laser",
    "set": "O",
    "shape": "unknown",
    "first_sweep": 0,
    "last_sweep": 99,
    "first_stamp": 0,
    "last_stamp": 9_900_000_000,
    "duration": 9.9,
    "sweeps": 100,
    "length_sd": 0.01,
    "width_sd": 0.01,
    "end": "end of log",
}


def write_tracks(path: Path, log: str, things: Sequence[dict[str, Any]], world: str | None = None) -> Path:
    """A table of these things, numbered from 1, whose log has poses in `world`."""
    rows = [{"log": log, "track": number, **_PLAIN, **thing} for number, thing in enumerate(things, 1)]
    # A program that knows no column to be required: some are null here.
    schema = read_schema(TRACKS)
    columns = [pa.array([row.get(field.name) for row in rows], field.type) for field in schema]
    poses = {} if world is None else {"poses": {"laser": {"world": world, "topic": "/tf"}}}
    told = table_metadata({}, {"name": f"{log}.mcap", "size": 1, "format": "mcap", **poses})
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.Table.from_arrays(columns, schema=schema.with_metadata(told)), path)
    return path


def turned(things: Sequence[dict[str, Any]], angle: float, x: float, y: float) -> list[dict[str, Any]]:
    """The same things, turned about the origin and then shifted."""
    cos, sin = math.cos(angle), math.sin(angle)
    return [
        {**thing, "x": x + cos * thing["x"] - sin * thing["y"], "y": y + sin * thing["x"] + cos * thing["y"]}
        for thing in things
    ]
