"""Runs made by hand, for the tests of the reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.reports.columns import Origin, Rows, Run
from lidarcli.tables.metadata import table_metadata
from lidarcli.tables.schemas import OBJECTS, SWEEPS

START = 1_700_000_000_000_000_000
TENTH = 100_000_000


def table(schema: pa.Schema, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows of a schema; what a row does not name is null."""
    columns = [pa.array([row.get(field.name) for row in rows], field.type) for field in schema]
    return pa.Table.from_arrays(columns, schema=schema)


def sweep(index: int, objects: int = 0, **other: Any) -> dict[str, Any]:
    """A sweep of 100 beams, one of them lost, at 10 Hz."""
    return {
        "log": "run",
        "topic": "/scan",
        "frame_id": "laser",
        "sweep": index,
        "stamp": START + TENTH * index,
        "beams": 100,
        "valid": 99,
        "no_return": 1,
        "too_close": 0,
        "invalid": 0,
        "d_mean": 0.5,
        "d_th": 0.1,
        "noise": 0.01,
        "objects": objects,
        "agents": 0,
        "object_beams": 5 * objects,
        "agent_beams": 0,
        "noise_beams": 100 - 5 * objects,
        **other,
    }


def thing(index: int, number: int, **other: Any) -> dict[str, Any]:
    """An object of sweep `index`: a box of 0.4 m, 2 m ahead."""
    return {
        "log": "run",
        "topic": "/scan",
        "frame_id": "laser",
        "sweep": index,
        "stamp": START + TENTH * index,
        "object": number,
        "set": "O",
        "shape": "prismatic",
        "visibility": "full",
        "beam_i": 10 * number,
        "beam_f": 10 * number + 4,
        "beams": 5,
        "theta_min": 0.0,
        "r_min": 2.0,
        "x": 2.0,
        "y": 0.0,
        "width": 0.4,
        "box_x": 2.1,
        "box_y": 0.0,
        "box_length": 0.4,
        "box_width": 0.2,
        "box_yaw": 0.5,
        "vertices": [],
        "faces": [],
        **other,
    }


def run_of(sweeps: Sequence[Mapping[str, Any]], objects: Sequence[Mapping[str, Any]] = ()) -> Run:
    """A run of one log."""
    source = Origin("run.objects.parquet", "run", "mcap", 1000, "1", {"profile": "robust"})
    return Run((source,), Rows.join([table(SWEEPS, sweeps)]), Rows.join([table(OBJECTS, objects)]))


def write_run(
    folder: Path,
    sweeps: Sequence[Mapping[str, Any]],
    objects: Sequence[Mapping[str, Any]] = (),
    name: str = "run",
    damage: Sequence[str] = (),
) -> Path:
    """The tables of one log in `folder`; the path of the objects table."""
    folder.mkdir(parents=True, exist_ok=True)
    origin = {"name": f"{name}.mcap", "size": 1000, "format": "mcap"}
    metadata = table_metadata({"profile": "robust", "every": 1}, origin, damage)
    for kind, schema, rows in (("objects", OBJECTS, objects), ("sweeps", SWEEPS, sweeps)):
        found = table(schema, rows).replace_schema_metadata(metadata)
        pq.write_table(found, folder / f"{name}.{kind}.parquet")
    return folder / f"{name}.objects.parquet"
