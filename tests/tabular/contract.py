"""The columns of each table and their types, as docs/tables.md promises them."""

from __future__ import annotations

TEXT = "dictionary<values=string, indices=int32, ordered=0>"

STAMP = "timestamp[ns, tz=UTC]"

VERTICES = "list<element: struct<theta: double, r: double, kind: string>>"

FACES = "list<element: struct<theta_i: double, theta_f: double, length: double, rms: double>>"

SOURCE = [
    ("log", TEXT),
    ("topic", TEXT),
    ("frame_id", TEXT),
    ("sweep", "int64"),
    ("stamp", STAMP),
    ("t", "double"),
]


def doubles(names: str) -> list[tuple[str, str]]:
    return [(name, "double") for name in names.split()]


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
        *doubles("theta_i theta_f r_i r_f s_i s_f d_th theta_min r_min x y width"),
        *doubles("box_x box_y box_length box_width box_yaw"),
        ("intensity", "float"),
        ("vertices", VERTICES),
        ("faces", FACES),
        ("difference", "double"),
        ("change", TEXT),
        ("track", "int64"),
        *doubles("vx vy"),
        ("moving", "bool"),
        ("thing", "double"),
        ("label", TEXT),
        ("label_score", "double"),
        *doubles("world_x world_y world_yaw"),
        ("why", "string"),
    ],
    "sweeps": [
        *SOURCE,
        *counts("beams valid no_return too_close invalid masked"),
        *doubles("nearest nearest_theta d_mean d_th noise"),
        *counts("objects agents object_beams agent_beams noise_beams"),
        *doubles("pose_x pose_y pose_yaw"),
        ("station", "int32"),
    ],
    "tracks": [
        *SOURCE[:3],
        ("track", "int64"),
        ("set", TEXT),
        ("shape", TEXT),
        ("label", TEXT),
        ("label_score", "double"),
        ("first_sweep", "int64"),
        ("last_sweep", "int64"),
        ("first_stamp", STAMP),
        ("last_stamp", STAMP),
        ("duration", "double"),
        ("sweeps", "int64"),
        *doubles("hidden x y yaw length width length_sd width_sd distance speed_mean speed_max"),
        ("moved_at", STAMP),
        ("end", TEXT),
    ],
    "trajectories": [
        *SOURCE[:2],
        *SOURCE[3:],
        ("track", "int64"),
        ("frame", TEXT),
        *doubles("x y vx vy x_sd y_sd xy_cov vx_sd vy_sd"),
        ("seen", TEXT),
        ("parts", "int32"),
    ],
    "beams": [
        *SOURCE[:2],
        SOURCE[3],
        ("beam", "int32"),
        *doubles("theta r"),
        ("status", TEXT),
        ("s", "double"),
        ("set", TEXT),
        ("object", "int32"),
        ("difference", "double"),
    ],
}
