"""The columns of each table and their types, as docs/tables.md promises them."""

from __future__ import annotations

TEXT = "dictionary<values=string, indices=int32, ordered=0>"

STAMP = "timestamp[ns, tz=UTC]"

VERTICES = "list<element: struct<theta: float not null, r: float not null, kind: string not null> not null>"

FACES = (
    "list<element: struct<theta_i: float not null, theta_f: float not null, length: float not null, "
    "rms: float not null> not null>"
)

SOURCE = [("log", TEXT), ("topic", TEXT), ("frame_id", TEXT), ("sweep", "int64"), ("stamp", STAMP), ("t", "double")]


def doubles(names: str) -> list[tuple[str, str]]:
    return [(name, "double") for name in names.split()]


def floats(names: str) -> list[tuple[str, str]]:
    return [(name, "float") for name in names.split()]


def counts(names: str) -> list[tuple[str, str]]:
    return [(name, "int32") for name in names.split()]


CONTRACT = {
    "objects": [
        *SOURCE,
        ("object", "int32"),
        ("set", TEXT),
        ("shape", TEXT),
        ("visibility", TEXT),
        *counts("beam_i beam_f beams"),
        *floats("theta_i theta_f r_i r_f s_i s_f d_th theta_min r_min x y width"),
        *floats("box_x box_y box_length box_width box_yaw"),
        ("intensity", "float"),
        ("vertices", VERTICES),
        ("faces", FACES),
        ("difference", "float"),
        ("change", TEXT),
        ("track", "int64"),
        *doubles("vx vy"),
        ("moving", "bool"),
        ("agent_score", "float"),
        ("thing", "float"),
        ("label", TEXT),
        ("label_score", "float"),
        *doubles("world_x world_y world_yaw"),
        ("why", "string"),
    ],
    "sweeps": [
        *SOURCE,
        *counts("beams valid no_return too_close invalid masked"),
        ("observed", "bool"),
        *floats("nearest nearest_theta d_mean d_th noise"),
        *counts("objects agents object_beams agent_beams noise_beams"),
        *doubles("pose_x pose_y pose_yaw"),
        ("station", "int32"),
    ],
    "tracks": [
        *SOURCE[:3],
        ("track", "int64"),
        ("set", TEXT),
        ("person", "int64"),
        ("shape", TEXT),
        ("label", TEXT),
        ("label_score", "float"),
        ("first_sweep", "int64"),
        ("last_sweep", "int64"),
        ("first_stamp", STAMP),
        ("last_stamp", STAMP),
        ("duration", "double"),
        ("sweeps", "int64"),
        *doubles("hidden x y yaw"),
        *floats("length width length_sd width_sd distance distance_hidden"),
        *doubles("speed_mean speed_max"),
        ("moved_at", STAMP),
        ("agent_score", "float"),
        ("end", TEXT),
    ],
    "trajectories": [
        *SOURCE[:2],
        *SOURCE[3:],
        ("track", "int64"),
        ("frame", TEXT),
        *doubles("x y vx vy"),
        *floats("x_sd y_sd"),
        *doubles("xy_cov vx_sd vy_sd"),
        ("seen", TEXT),
        ("parts", "int32"),
    ],
    "beams": [
        *SOURCE[:2],
        SOURCE[3],
        ("beam", "int32"),
        *floats("theta r"),
        ("status", TEXT),
        ("s", "float"),
        ("set", TEXT),
        ("object", "int32"),
        ("difference", "float"),
    ],
    "events": [
        *SOURCE[:3],
        *[(name, "int64") for name in ("event", "first_sweep", "last_sweep", "sweeps")],
        *[(name, TEXT) for name in ("zone", "kind", "action", "polygon")],
        *[(name, STAMP) for name in ("start", "end")],
        *doubles("t duration hidden"),
        ("cut", "bool"),
        *counts("points agents"),
        *doubles("nearest bearing x y"),
        ("set", TEXT),
        ("track", "int64"),
        *[(name, TEXT) for name in ("label", "direction")],
        *doubles("ttc speed"),
    ],
    "zones": [
        *[one for one in SOURCE if one[0] != "frame_id"],
        ("zone", TEXT),
        *counts("points"),
        *doubles("nearest ttc"),
        ("active", "bool"),
        *counts("things agents masked"),
        ("observed", "bool"),
    ],
    "counts": [
        *SOURCE[:2],
        ("zone", TEXT),
        *[(name, STAMP) for name in ("start", "end")],
        ("direction", TEXT),
        *[(name, "int64") for name in ("count", "low", "high", "unsure")],
        *doubles("agents observed"),
    ],
}

OPEN = {
    "objects": "s_i s_f d_th intensity difference change track vx vy moving agent_score thing label label_score "
    "world_x world_y world_yaw why",
    "sweeps": "nearest nearest_theta d_mean d_th pose_x pose_y pose_yaw station",
    "tracks": "topic frame_id person label label_score length width length_sd width_sd moved_at agent_score",
    "trajectories": "",
    "beams": "r s object difference",
    "events": "polygon hidden points agents nearest bearing x y set track label direction ttc speed",
    "zones": "nearest ttc things agents",
    "counts": "high",
}
"""Columns that may be null; all others have a value in every row."""
