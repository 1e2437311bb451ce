"""The background table: written when a scene has been learned, read to be subtracted."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.errors import UnreadableError
from lidarcli.formalism.background import Background
from lidarcli.formalism.grid import Grid
from lidarcli.newfiles import NewFiles
from lidarcli.sweeps import Float64, SweepPoses
from lidarcli.tables.arrays import codes, floats, plain
from lidarcli.tables.metadata import DAMAGE, PARAMETERS, SOURCE, VERSION
from lidarcli.tables.parquet import TableFile
from lidarcli.tables.schemas import BACKGROUND

GEOMETRY = "lidarcli.geometry"
"""Metadata key: what the columns do not hold of each sensor, as JSON."""

_PER_BEAM = ("r_e", "r_near", "spread", "support", "no_return")


def write_background(
    path: Path, sensors: Sequence[Background], metadata: Mapping[bytes, bytes], overwrite: bool = True
) -> list[str]:
    """Write the stations of all sensors; the file appears when it is whole. Notes as of `NewFiles.publish`."""
    geometry = json.dumps([_geometry(sensor) for sensor in sensors], sort_keys=True, ensure_ascii=False)
    with NewFiles([path], overwrite) as new, TableFile(new.part(path), BACKGROUND, path) as file:
        for sensor in sensors:
            file.write(background_rows(sensor))
        file.finish({**metadata, GEOMETRY.encode(): geometry.encode(errors="replace")})
        return new.publish()


def background_rows(sensor: Background) -> pa.RecordBatch:
    """Rows of one sensor: one per station and beam."""
    stations, beams = sensor.r_e.shape
    count = stations * beams
    each = np.repeat(np.arange(stations), beams)
    poses = sensor.poses.rows(each)
    columns = [
        codes(np.zeros(count, np.int32), (sensor.topic,)),
        codes(np.zeros(count, np.int32), (sensor.frame_id,)),
        plain(each.astype(np.int32)),
        plain(np.tile(np.arange(beams, dtype=np.int32), stations)),
        floats(np.tile(sensor.grid.bearings(), stations)),
        *(floats(getattr(sensor, name).reshape(-1)) for name in _PER_BEAM),
        plain(sensor.sweeps[each]),
        *map(floats, (poses.x, poses.y, poses.yaw)),
        pa.array(poses.upside_down.tolist(), pa.bool_()),
    ]
    return pa.record_batch(columns, schema=BACKGROUND)


def read_background(path: Path) -> tuple[list[Background], dict[str, Any]]:
    """The sensors of a background table, and what its metadata says.

    Raises
    ------
    UnreadableError
        There is no such file, it is no Parquet file, no background, or not a whole one.
    """
    try:
        table = pq.read_table(path)
    except FileNotFoundError as err:
        raise UnreadableError(f"{path}: no such file") from err
    except (OSError, pa.ArrowException) as err:
        raise UnreadableError(f"{path}: no background: {str(err).splitlines()[0]}") from err
    metadata = {key.decode(): value.decode() for key, value in (table.schema.metadata or {}).items()}
    if GEOMETRY not in metadata or not set(BACKGROUND.names) <= set(table.column_names):
        raise UnreadableError(f"{path}: no background; `lidarcli background build` makes one")
    try:
        sensors = _sensors(table, _parsed(metadata[GEOMETRY]))
        told = {key: json.loads(metadata[key]) for key in (PARAMETERS, SOURCE, DAMAGE) if key in metadata}
    except (ValueError, KeyError) as err:
        raise UnreadableError(f"{path}: its geometry and its rows do not agree; build it again") from err
    return sensors, told | {VERSION: metadata.get(VERSION, "")}


def _geometry(sensor: Background) -> dict[str, Any]:
    grid = sensor.grid
    return {
        "topic": sensor.topic,
        "frame_id": sensor.frame_id,
        "angle_min": grid.angle_min,
        "angle_increment": grid.angle_increment,
        "beams": grid.beams,
        "period": grid.period,
        "range_max": sensor.range_max if np.isfinite(sensor.range_max) else None,
        "stations": len(sensor),
        "station_distance": sensor.distance,
        "station_angle": sensor.angle,
    }


def _parsed(text: str) -> list[dict[str, Any]]:
    """The geometry of every sensor (`ValueError` where it is none)."""
    numbers = dict.fromkeys(("angle_min", "angle_increment", "station_distance", "station_angle"), float)
    kinds = {"topic": str, "frame_id": str, "beams": int, "period": int, "stations": int, **numbers}
    try:
        return [
            {name: kind(entry[name]) for name, kind in kinds.items()}
            | {"range_max": np.inf if entry["range_max"] is None else float(entry["range_max"])}
            for entry in json.loads(text)
        ]
    except TypeError as err:
        raise ValueError("no geometry") from err


def _sensors(table: pa.Table, geometries: list[dict[str, Any]]) -> list[Background]:
    rows = [entry["stations"] * entry["beams"] for entry in geometries]
    if sum(rows) != table.num_rows:
        raise ValueError("rows are missing")
    starts = np.cumsum([0, *rows]).tolist()
    return [
        _sensor(table.slice(start, count), entry)
        for start, count, entry in zip(starts, rows, geometries, strict=False)
    ]


def _sensor(table: pa.Table, entry: dict[str, Any]) -> Background:
    shape = entry["stations"], entry["beams"]

    def values(name: str) -> Float64:
        return np.asarray(table[name].to_numpy(), np.float64).reshape(shape)

    first = slice(None), slice(0, 1)

    def of_station(name: str) -> Float64:
        return np.asarray(values(name)[first].reshape(-1))

    grid = Grid(entry["angle_min"], entry["angle_increment"], entry["beams"], entry["period"])
    if not np.array_equal(values("theta"), np.tile(grid.bearings(), (shape[0], 1))):
        raise ValueError("bearings of another sensor")
    return Background(
        topic=entry["topic"],
        frame_id=entry["frame_id"],
        grid=grid,
        range_max=entry["range_max"],
        **{name: values(name) for name in _PER_BEAM},
        sweeps=of_station("sweeps").astype(np.int64),
        poses=SweepPoses(
            of_station("pose_x"),
            of_station("pose_y"),
            of_station("pose_yaw"),
            of_station("upside_down").astype(bool),
        ),
        distance=entry["station_distance"],
        angle=entry["station_angle"],
    )
