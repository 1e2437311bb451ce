"""The columns that the objects of a batch are written to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli import native

_WHOLE: dict[str, Any] = {"row": np.int64, "object": np.int32, "set": np.uint8, "shape": np.uint8}
_WHOLE |= {"visibility": np.uint8, "beam_i": np.int32, "beam_f": np.int32, "beams": np.int32}
_MEASURED = (
    *("theta_i", "theta_f", "r_i", "r_f", "s_i", "s_f", "d_th", "theta_min", "r_min", "x", "y", "width"),
    *("box_x", "box_y", "box_length", "box_width", "box_yaw", "thing"),
)
OBJECT: dict[str, Any] = _WHOLE | dict.fromkeys(_MEASURED, np.float64)
OFFSETS: dict[str, Any] = {"vertex_offsets": np.int32, "face_offsets": np.int32}
VERTEX: dict[str, Any] = {"vertex_theta": np.float64, "vertex_r": np.float64, "vertex_kind": np.uint8}
FACE: dict[str, Any] = dict.fromkeys(("face_theta_i", "face_theta_f", "face_length", "face_rms"), np.float64)
SWEEP: dict[str, Any] = dict.fromkeys(
    ("nearest", "nearest_theta", "d_mean", "sweep_d_th", "noise"), np.float64
)
SWEEP |= dict.fromkeys(("objects", "object_beams"), np.int32)
BEAM: dict[str, Any] = {"beam_object": np.int32, "beam_s": np.float64}


class Columns:
    """Columns of a `Detection`, of which `objects`, `vertices` and `faces` entries are filled."""

    def __init__(self) -> None:
        self.objects = 0
        self.vertices = 0
        self.faces = 0
        self.room_objects = 0
        self.room_vertices = 0
        self.room_faces = 0
        self.per_beam = False
        self.explained = False
        self.beam_width = 0

    def attach(self, arrays: dict[str, NDArray[Any]], per_beam: bool) -> None:
        """Write to these arrays from now on, which are to be kept as long."""
        self.room_objects = len(arrays["row"])
        self.room_vertices = len(arrays["vertex_r"])
        self.room_faces = len(arrays["face_rms"])
        self.per_beam = per_beam
        self.row = native.at_longs(arrays["row"])
        self.object = native.at_ints(arrays["object"])
        self.set = native.at_bytes(arrays["set"])
        self.shape = native.at_bytes(arrays["shape"])
        self.visibility = native.at_bytes(arrays["visibility"])
        self.beam_i = native.at_ints(arrays["beam_i"])
        self.beam_f = native.at_ints(arrays["beam_f"])
        self.beams = native.at_ints(arrays["beams"])
        self.theta_i = native.at_doubles(arrays["theta_i"])
        self.theta_f = native.at_doubles(arrays["theta_f"])
        self.r_i = native.at_doubles(arrays["r_i"])
        self.r_f = native.at_doubles(arrays["r_f"])
        self.s_i = native.at_doubles(arrays["s_i"])
        self.s_f = native.at_doubles(arrays["s_f"])
        self.d_th = native.at_doubles(arrays["d_th"])
        self.theta_min = native.at_doubles(arrays["theta_min"])
        self.r_min = native.at_doubles(arrays["r_min"])
        self.x = native.at_doubles(arrays["x"])
        self.y = native.at_doubles(arrays["y"])
        self.width = native.at_doubles(arrays["width"])
        self.box_x = native.at_doubles(arrays["box_x"])
        self.box_y = native.at_doubles(arrays["box_y"])
        self.box_length = native.at_doubles(arrays["box_length"])
        self.box_width = native.at_doubles(arrays["box_width"])
        self.box_yaw = native.at_doubles(arrays["box_yaw"])
        self.thing = native.at_doubles(arrays["thing"])
        self.vertex_offsets = native.at_ints(arrays["vertex_offsets"])
        self.vertex_theta = native.at_doubles(arrays["vertex_theta"])
        self.vertex_r = native.at_doubles(arrays["vertex_r"])
        self.vertex_kind = native.at_bytes(arrays["vertex_kind"])
        self.face_offsets = native.at_ints(arrays["face_offsets"])
        self.face_theta_i = native.at_doubles(arrays["face_theta_i"])
        self.face_theta_f = native.at_doubles(arrays["face_theta_f"])
        self.face_length = native.at_doubles(arrays["face_length"])
        self.face_rms = native.at_doubles(arrays["face_rms"])
        self.nearest = native.at_doubles(arrays["nearest"])
        self.nearest_theta = native.at_doubles(arrays["nearest_theta"])
        self.d_mean = native.at_doubles(arrays["d_mean"])
        self.sweep_d_th = native.at_doubles(arrays["sweep_d_th"])
        self.noise = native.at_doubles(arrays["noise"])
        self.sweep_objects = native.at_ints(arrays["objects"])
        self.object_beams = native.at_ints(arrays["object_beams"])
        self.explained = "features" in arrays
        if self.explained:
            self.features = native.at_doubles(arrays["features"])
        if per_beam:
            self.beam_object = native.at_ints(arrays["beam_object"])
            self.beam_s = native.at_doubles(arrays["beam_s"])
            self.beam_width = arrays["beam_s"].shape[1]


def has_room(columns: Columns, beams: int) -> bool:
    """Whether all objects of another sweep of so many beams can be added, however many there are."""
    return (
        columns.objects + beams <= columns.room_objects
        and columns.vertices + 2 * beams <= columns.room_vertices
        and columns.faces + beams <= columns.room_faces
    )
