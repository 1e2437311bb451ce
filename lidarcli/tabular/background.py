"""Background table: written when a scene has been learned, read to be subtracted."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.errors import UnreadableError
from lidarcli.files.newfiles import NewFiles
from lidarcli.files.stores import Place
from lidarcli.formalism.background import SAME_BEAM, Background, Grid
from lidarcli.sweeps.types import Float64, SweepPoses
from lidarcli.tabular.columns import codes, floats, plain
from lidarcli.tabular.reading import MAX_VALUE, note_value, notes_of, parsed, read_columns
from lidarcli.tabular.schemas import BACKGROUND
from lidarcli.tabular.writing import DAMAGE, PARAMETERS, SOURCE, VERSION, ParquetSink

GEOMETRY = "lidarcli.geometry"
"""Metadata key of the geometry of each sensor, as JSON."""

_PER_BEAM = ("r_e", "r_near", "spread", "support", "no_return")
NEAREST = 1e-9
"""Smallest range of a background [m]: no sensor measures that near, and steps of bearings are divided by it."""


def write_background(
    path: Place, sensors: Sequence[Background], metadata: Mapping[bytes, bytes], overwrite: bool = True
) -> list[str]:
    """Write the stations of all sensors; the file appears when it is whole. Notes as of `NewFiles.publish`."""
    geometry = json.dumps([_geometry(sensor) for sensor in sensors], sort_keys=True, ensure_ascii=False)
    with NewFiles([path], overwrite) as new, ParquetSink(new.part(path), BACKGROUND, path) as file:
        for sensor in sensors:
            file.write(background_rows(sensor))
        file.finish({**metadata, GEOMETRY.encode(): geometry.encode(errors="replace")})
        return new.publish()


def background_rows(sensor: Background) -> pa.RecordBatch:
    """Return the rows of one sensor: one per station and beam."""
    stations, beams = sensor.r_e.shape
    count = stations * beams
    each = np.repeat(np.arange(stations), beams)
    poses = sensor.poses.rows(each)
    columns = [
        codes(np.zeros(count, np.int32), (sensor.topic,)),
        codes(np.zeros(count, np.int32), (sensor.frame_id,)),
        plain(each.astype(np.int32)),
        plain(np.tile(np.arange(beams, dtype=np.int32), stations)),
        floats(np.tile(sensor.grid.bearings, stations)),
        *(floats(getattr(sensor, name).reshape(-1)) for name in _PER_BEAM),
        plain(sensor.sweeps[each]),
        *map(floats, (poses.x, poses.y, poses.yaw)),
        pa.array(poses.upside_down.tolist(), pa.bool_()),
    ]
    return pa.record_batch(columns, schema=BACKGROUND)


def read_background(path: Place) -> tuple[list[Background], dict[str, Any]]:
    """Read the sensors of a background table, and its metadata.

    Raises
    ------
    UnreadableError
        There is no such file, it is no Parquet file, no background, or not a whole one.
    """
    table = read_columns(path, "background", BACKGROUND)
    notes = notes_of(table)
    if GEOMETRY not in notes:
        raise UnreadableError(
            f"{path}: no {GEOMETRY} in its metadata, which other programs leave out when they write a table; "
            "build it again with lidarcli background build"
        )
    for name in _PER_BEAM:
        least = NEAREST if name.startswith("r_") else 0.0
        wrong = (values := _values(table, name)) < least
        if wrong.any():
            raise UnreadableError(
                f"{path}: column {name} holds {values[wrong][0]:g}; the least that it can be is {least:g}"
            )
    try:
        sensors = _sensors(table, parsed(notes[GEOMETRY]))
    except ValueError as err:
        raise UnreadableError(f"{path}: its geometry and its rows do not agree; build it again") from err
    logs = [log for log in note_value(notes, SOURCE, list) if isinstance(log, dict)]
    damage = [str(line) for line in note_value(notes, DAMAGE, list)]
    making = {PARAMETERS: note_value(notes, PARAMETERS, dict), SOURCE: logs, DAMAGE: damage}
    return sensors, {key: value for key, value in making.items() if value} | {VERSION: notes.get(VERSION, "")}


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


def _entry(entry: Any) -> dict[str, Any]:
    """Return the geometry of one sensor, checked: the table may come from any program."""
    kinds = {
        **dict.fromkeys(("topic", "frame_id"), str),
        **dict.fromkeys(("beams", "period", "stations"), int),
        **dict.fromkeys(("angle_min", "angle_increment", "station_distance", "station_angle"), float),
    }
    try:
        found: dict[str, Any] = {name: kind(entry[name]) for name, kind in kinds.items()}
        limit = entry["range_max"]
        found["range_max"] = np.inf if limit is None else float(limit)
    except (TypeError, KeyError, OverflowError) as err:
        raise ValueError("no geometry") from err
    angles = abs(found["angle_min"]), abs(found["angle_increment"])
    stations = found["station_distance"], found["station_angle"]
    if (
        not (0 <= found["beams"] <= 10_000_000 and 0 <= found["period"] <= found["beams"])
        or found["stations"] < 0
        or not max(*angles, *stations) <= MAX_VALUE
        or (found["beams"] > 1 and angles[1] < 1e-9)
        or not min(stations) > 0
        or not found["range_max"] > 0
    ):
        raise ValueError("no geometry of a sensor")
    return found


def _sensors(table: pa.Table, entries: Any) -> list[Background]:
    """Return the sensors of the rows of a table by their geometry (`ValueError` where it is none)."""
    if not isinstance(entries, list):
        raise ValueError("no geometry")
    geometries = [_entry(entry) for entry in entries]
    rows = [entry["stations"] * entry["beams"] for entry in geometries]
    if sum(rows) != table.num_rows:
        raise ValueError("rows are missing")
    starts = np.cumsum([0, *rows]).tolist()
    return [
        _sensor(table.slice(start, count), entry) for start, count, entry in zip(starts, rows, geometries, strict=False)
    ]


def _values(table: pa.Table, name: str) -> Float64:
    """Return a column as double precision, NaN for null."""
    return np.asarray(table[name].to_numpy(), np.float64)


def _sensor(table: pa.Table, entry: dict[str, Any]) -> Background:
    shape = entry["stations"], entry["beams"]
    values = {name: _values(table, name).reshape(shape) for name in BACKGROUND.names[2:]}
    # What is the same for all beams of a station.
    of_station = {
        name: values[name][:, :1].reshape(-1) for name in ("sweeps", "pose_x", "pose_y", "pose_yaw", "upside_down")
    }
    grid = Grid(entry["angle_min"], entry["angle_increment"], entry["beams"], entry["period"])
    # Other programs may keep single precision, of a relative precision of 1e-6.
    off = np.abs(values["theta"] - grid.bearings) if shape[0] else np.zeros(0)
    if not (off <= SAME_BEAM * abs(grid.angle_increment) + 1e-6 * abs(grid.angle_min)).all():
        raise ValueError("bearings of another sensor")
    station, beam = np.indices(shape)
    if not (np.array_equal(values["station"], station) and np.array_equal(values["beam"], beam)):
        raise ValueError("rows in another order")
    return Background(
        topic=entry["topic"],
        frame_id=entry["frame_id"],
        grid=grid,
        range_max=entry["range_max"],
        **{name: values[name] for name in _PER_BEAM},
        sweeps=of_station["sweeps"].astype(np.int64),
        poses=SweepPoses(
            of_station["pose_x"], of_station["pose_y"], of_station["pose_yaw"], of_station["upside_down"].astype(bool)
        ),
        distance=entry["station_distance"],
        angle=entry["station_angle"],
    )
