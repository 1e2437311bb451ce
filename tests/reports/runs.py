"""Runs made by hand, for the tests of the reports."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lidarcli.pipeline.reporting import ReportOptions, make_report
from lidarcli.reports.columns import Origin, Rows, Run, ZoneRows
from lidarcli.reports.report import Report
from lidarcli.tabular.reading import read_schema
from lidarcli.tabular.schemas import EVENTS, OBJECTS, SWEEPS, TRACKS, TRAJECTORIES, ZONES
from lidarcli.tabular.writing import table_metadata

START = 1_700_000_000_000_000_000
TENTH = 100_000_000


def table(schema: pa.Schema, rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Rows of a schema, as a program writes them that declares no column required; what a row does not name is null."""
    schema = read_schema(schema)
    columns = [pa.array([row.get(field.name) for row in rows], field.type) for field in schema]
    return pa.Table.from_arrays(columns, schema=schema)


def at(index: int, **where: Any) -> dict[str, Any]:
    """What every row of a sweep tells of it."""
    return {"log": "run", "topic": "/scan", "sweep": index, "stamp": START + TENTH * index, **where}


def sweep(index: int, objects: int = 0, **other: Any) -> dict[str, Any]:
    """A sweep of 100 beams, one of them lost, at 10 Hz."""
    status = {"valid": 99, "no_return": 1, "too_close": 0, "invalid": 0, "masked": 0, "observed": True}
    beams = {"beams": 100, "object_beams": 5 * objects, "agent_beams": 0, "noise_beams": 100 - 5 * objects}
    found = {"d_mean": 0.5, "d_th": 0.1, "noise": 0.01, "objects": objects, "agents": 0}
    return at(index, frame_id="laser") | status | beams | found | other


def thing(index: int, number: int, **other: Any) -> dict[str, Any]:
    """An object of sweep `index`: a box of 0.4 m, 2 m ahead."""
    kind = {"object": number, "set": "O", "shape": "prismatic", "visibility": "full", "vertices": [], "faces": []}
    beams = {"beam_i": 10 * number, "beam_f": 10 * number + 4, "beams": 5}
    place = {"theta_min": 0.0, "r_min": 2.0, "x": 2.0, "y": 0.0, "width": 0.4}
    box = {"box_x": 2.1, "box_y": 0.0, "box_length": 0.4, "box_width": 0.2, "box_yaw": 0.5}
    return at(index, frame_id="laser") | kind | beams | place | box | other


def track(number: int, first: int = 0, last: int = 9, **other: Any) -> dict[str, Any]:
    """A thing that stands still from one sweep to another: the box of `thing`."""
    kind = {"log": "run", "topic": "/scan", "frame_id": "laser", "track": number, "set": "O", "shape": "prismatic"}
    span = {"first_sweep": first, "last_sweep": last, "sweeps": last - first + 1, "hidden": 0.0, "end": "end of log"}
    span |= {"first_stamp": START + TENTH * first, "last_stamp": START + TENTH * last, "duration": (last - first) / 10}
    box = {"x": 2.1, "y": 0.0, "yaw": 0.5, "length": 0.4, "width": 0.2, "length_sd": 0.01, "width_sd": 0.01}
    return kind | span | box | {"distance": 0.0, "speed_mean": 0.0, "speed_max": 0.0} | other


def run_of(
    sweeps: Sequence[Mapping[str, Any]],
    objects: Sequence[Mapping[str, Any]] = (),
    tracks: Sequence[Mapping[str, Any]] | None = None,
) -> Run:
    """A run of one log."""
    source = Origin("run.objects.parquet", "run", "mcap", 1000, "1", {"profile": "robust"}, tracked=tracks is not None)
    things = None if tracks is None else Rows.join([table(TRACKS, tracks)])
    paths = None if tracks is None else Rows.join([table(TRAJECTORIES, trajectories(sweeps, objects))])
    return Run((source,), Rows.join([table(SWEEPS, sweeps)]), Rows.join([table(OBJECTS, objects)]), things, paths)


def trajectories(sweeps: Sequence[Mapping[str, Any]], objects: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Where the tracks of these objects are in each sweep: amid their objects, and while hidden where they were."""
    rows: list[dict[str, Any]] = []
    followed = {(row["topic"], row["track"]) for row in objects if row.get("track") is not None}
    for topic, number in sorted(followed):
        mine = [row for row in objects if (row["topic"], row.get("track")) == (topic, number)]
        first, last = (end(row["sweep"] for row in mine) for end in (min, max))
        for one in sweeps:
            if one["topic"] != topic or not first <= one["sweep"] <= last:
                continue
            here = [row for row in mine if row["sweep"] == one["sweep"]]
            if here:
                frame = "world" if here[0].get("world_x") is not None else "sensor"
                names = {"world": "world_", "sensor": "box_"}[frame]
                place = {axis: sum(row[names + axis] for row in here) / len(here) for axis in "xy"}
                moves = bool(here[0].get("moving"))
                speed = {axis: here[0][axis] if moves else 0.0 for axis in ("vx", "vy")}
            source = {name: one[name] for name in ("log", "topic", "sweep", "stamp")} | {"t": one["sweep"] / 10}
            seen = {"seen": "seen" if here else "hidden", "parts": len(here)}
            unsure = dict.fromkeys(("x_sd", "y_sd", "xy_cov", "vx_sd", "vy_sd"), 0.0)
            rows.append(source | {"track": number, "frame": frame} | place | speed | unsure | seen)
    return rows


def crossing(log: str = "run") -> dict[str, list[dict[str, Any]]]:
    """The tables of ten sweeps: a pallet stands at x = 2 m, a person passes it on two legs, a robot comes later.

    The person (track 2) walks at 1 m/s along y from sweep 0 to 7, two objects in each sweep; the robot (track 3) drives at
    0.5 m/s along x from sweep 5 on. Of 100 beams the pallet has 5, each leg 2, the robot 6.
    """
    here = {"log": log}
    sweeps, objects = [], []
    for k in range(10):
        walks, drives = k < 8, k >= 5
        agent_beams = 4 * walks + 6 * drives
        counts = {"agents": 2 * walks + drives, "agent_beams": agent_beams, "noise_beams": 95 - agent_beams}
        sweeps.append(sweep(k, 1, **{**here, **counts, "t": k / 10}))
        still = {"vx": 0.0, "vy": 0.0, "moving": False}
        rows = [thing(k, 1, track=1, label="pallet", label_score=0.9, **still)]
        for leg in (-0.1, 0.1) if walks else ():
            place = {"x": 3.0 + leg, "y": -0.5 + 0.1 * k, "box_x": 3.0 + leg, "box_y": -0.5 + 0.1 * k}
            gait = {"vx": 0.0, "vy": 1.0, "moving": True, "shape": "legged", "beams": 2}
            rows.append(thing(k, len(rows) + 1, track=2, set="A", **place, **gait))
        if drives:
            place = {"x": 1.0 + 0.05 * k, "y": 1.0, "box_x": 1.0 + 0.05 * k, "box_y": 1.0}
            drive = {"vx": 0.5, "vy": 0.0, "moving": True, "shape": "round", "beams": 6}
            rows.append(thing(k, len(rows) + 1, track=3, set="A", **place, **drive))
        objects += [row | here for row in rows]
    moved = {"set": "A", "hidden": 0.0}
    tracks = [
        track(1, label="pallet", label_score=0.9, **here),
        track(2, 0, 7, shape="legged", distance=0.7, speed_mean=1.0, speed_max=1.2, end="left view", **moved),
        track(3, 5, 9, shape="round", distance=0.2, speed_mean=0.5, speed_max=0.5, **moved),
    ]
    return {"sweeps": sweeps, "objects": objects, "tracks": [row | here for row in tracks]}


def write_run(
    folder: Path,
    sweeps: Sequence[Mapping[str, Any]],
    objects: Sequence[Mapping[str, Any]] = (),
    name: str = "run",
    damage: Sequence[str] = (),
    tracks: Sequence[Mapping[str, Any]] | None = None,
    parameters: Mapping[str, Any] | None = None,
    recording: Mapping[str, str] | None = None,
) -> Path:
    """The tables of one log in `folder`, that of the tracks where there are any; the path of the objects table."""
    folder.mkdir(parents=True, exist_ok=True)
    origin = {"name": f"{name}.mcap", "size": 1000, "format": "mcap", **({"recording": recording} if recording else {})}
    metadata = table_metadata({"profile": "robust", "every": 1, **(parameters or {})}, origin, damage)
    tables = {"objects": (OBJECTS, objects), "sweeps": (SWEEPS, sweeps)}
    if tracks is not None:
        tables["tracks"] = (TRACKS, tracks)
        tables["trajectories"] = (TRAJECTORIES, trajectories(sweeps, objects))
    for kind, (schema, rows) in tables.items():
        found = table(schema, rows).replace_schema_metadata(metadata)
        pq.write_table(found, folder / f"{name}.{kind}.parquet")
    return folder / f"{name}.objects.parquet"


def event(number: int, zone: str, kind: str = "occupied", begin: int = 0, last: int = 0, **other: Any) -> dict[str, Any]:
    """An event of a zone that lasts from one sweep to another, at 10 Hz."""
    what = {"log": "run", "topic": "/scan", "frame_id": "laser", "event": number, "zone": zone, "kind": kind}
    span = {"first_sweep": begin, "last_sweep": last, "sweeps": last - begin + 1, "cut": False, "action": "stop"}
    span |= {
        "start": START + TENTH * begin,
        "end": START + TENTH * last,
        "t": 0.1 * begin,
        "duration": 0.1 * (last - begin),
    }
    return what | span | other


def watch(index: int, zone: str, points: int = 0, **other: Any) -> dict[str, Any]:
    """A zone in sweep `index`: in view, and free unless there are points."""
    counts = {"points": points, "agents": 0, "things": 0, "masked": 0, "active": False, "observed": True}
    return at(index, t=0.1 * index, zone=zone) | counts | other


def watched_of(events: Sequence[Mapping[str, Any]], zones: Sequence[Mapping[str, Any]]) -> ZoneRows:
    """Zones as they come out of their tables."""
    return ZoneRows(Rows.join([table(EVENTS, events)]), Rows.join([table(ZONES, zones)]))


def write_zones(
    folder: Path,
    events: Sequence[Mapping[str, Any]],
    zones: Sequence[Mapping[str, Any]],
    name: str = "run",
    shapes: Sequence[Mapping[str, Any]] = (),
    damage: Sequence[str] = (),
) -> Path:
    """The tables of the zones of one log in `folder`; the path of that of the events."""
    folder.mkdir(parents=True, exist_ok=True)
    origin = {"name": f"{name}.mcap", "size": 1000, "format": "mcap"}
    metadata = table_metadata({"zones": [*shapes]}, origin, damage)
    for kind, schema, rows in (("events", EVENTS, events), ("zones", ZONES, zones)):
        mine = [{**row, "log": name} for row in rows]
        pq.write_table(table(schema, mine).replace_schema_metadata(metadata), folder / f"{name}.{kind}.parquet")
    return folder / f"{name}.events.parquet"


def made(*tables: Path, checks: Sequence[str] = (), viewer: bool = False) -> Report:
    """The report on some tables."""
    return make_report(ReportOptions(tuple(map(str, tables)), tuple(checks)), viewer=viewer)


def array(one: dict[str, str], kind: type[np.generic]) -> np.ndarray[Any, Any]:
    """An array as pages hold it."""
    return np.frombuffer(zlib.decompress(base64.b64decode(one["packed"])), kind)
