"""The declared schema of every table: columns, types, and the unit and meaning of each column."""

from __future__ import annotations

import pyarrow as pa

TEXT = pa.dictionary(pa.int32(), pa.string())
STAMP = pa.timestamp("ns", tz="UTC")
INT32, INT64, FLOAT, SINGLE, BOOL = pa.int32(), pa.int64(), pa.float64(), pa.float32(), pa.bool_()


def column(name: str, kind: pa.DataType, unit: str, description: str) -> pa.Field:
    """A column with its unit (`1` for a count or an index, empty for text) and one line of meaning."""
    return pa.field(name, kind, metadata={b"unit": unit.encode(), b"description": description.encode()})


VERTEX = pa.struct(
    [
        column("theta", FLOAT, "rad", "bearing of the vertex"),
        column("r", FLOAT, "m", "range of the vertex"),
        column("kind", pa.string(), "", "start, end, corner or extremum"),
    ]
)
FACE = pa.struct(
    [
        column("theta_i", FLOAT, "rad", "bearing where the face begins"),
        column("theta_f", FLOAT, "rad", "bearing where the face ends"),
        column("length", FLOAT, "m", "length of the face"),
        column("rms", FLOAT, "m", "rms distance of its points from a straight face"),
    ]
)


def _list(item: pa.DataType) -> pa.DataType:
    # The element is named as Parquet names it, whatever the default of the pyarrow at hand.
    return pa.list_(pa.field("element", item))


_LOG = column("log", TEXT, "", "log the sweep comes from")
_TOPIC = column("topic", TEXT, "", "LaserScan topic")
_FRAME = column("frame_id", TEXT, "", "sensor frame of the sweep")
_SWEEP = column("sweep", INT64, "1", "index of the sweep within its topic, in log order, from 0")
_STAMP = column("stamp", STAMP, "ns", "header stamp, or the log's record time where the header has none")
_SECONDS = column("t", FLOAT, "s", "seconds since the first sweep of the topic in the log")
_LABEL = column(
    "label", TEXT, "", "name in the catalogue; null without a catalogue, or where nothing in it fits"
)
_LABEL_SCORE = column("label_score", FLOAT, "1", "how well the label fits, 0 to 1; null without one")

OBJECTS = pa.schema(
    [
        _LOG,
        _TOPIC,
        _FRAME,
        _SWEEP,
        _STAMP,
        _SECONDS,
        column("object", INT32, "1", "number of the object in its sweep, 1, 2, ... by increasing theta_i"),
        column("set", TEXT, "", "O object, A agent (moves by itself), S wall (with --walls)"),
        column("shape", TEXT, "", "prismatic, round, legged, irregular, unknown or wall"),
        column("visibility", TEXT, "", "full, start_hidden, end_hidden, both_hidden or cut"),
        column(
            "beam_i", INT32, "1", "first beam, from 0; greater than beam_f when the object crosses the seam"
        ),
        column("beam_f", INT32, "1", "last beam, inclusive"),
        column("beams", INT32, "1", "number of valid beams of the object"),
        column("theta_i", FLOAT, "rad", "bearing of the first point P_i"),
        column("theta_f", FLOAT, "rad", "bearing of the last point P_f; may pass pi, never below theta_i"),
        column("r_i", FLOAT, "m", "range of P_i"),
        column("r_f", FLOAT, "m", "range of P_f"),
        column("s_i", FLOAT, "m", "signed difference on entering the object; null where undefined"),
        column("s_f", FLOAT, "m", "signed difference on leaving the object; null where undefined"),
        column("d_th", FLOAT, "m", "threshold of a discontinuity that was used"),
        column("theta_min", FLOAT, "rad", "bearing of the point nearest to the scanner"),
        column("r_min", FLOAT, "m", "range of the point nearest to the scanner"),
        column("x", FLOAT, "m", "centroid of the points, sensor frame, forward"),
        column("y", FLOAT, "m", "centroid of the points, sensor frame, left"),
        column("width", FLOAT, "m", "chord from P_i to P_f"),
        column("box_x", FLOAT, "m", "centre of the oriented bounding box, sensor frame, forward"),
        column("box_y", FLOAT, "m", "centre of the oriented bounding box, sensor frame, left"),
        column("box_length", FLOAT, "m", "longer side of the box"),
        column("box_width", FLOAT, "m", "shorter side of the box"),
        column("box_yaw", FLOAT, "rad", "direction of the longer side, sensor frame"),
        column(
            "intensity",
            SINGLE,
            "1",
            "median intensity of its beams, in the sensor's own unit; null where the log has none",
        ),
        column("vertices", _list(VERTEX), "", "vertices in order of bearing"),
        column("faces", _list(FACE), "", "faces between the vertices"),
        column("difference", FLOAT, "m", "median of r_w - r_e over its beams; null without a background"),
        column("change", TEXT, "", "appeared or removed; null without a background"),
        column(
            "track",
            INT64,
            "1",
            "thing that the object belongs to, 1, 2, ... by first sight; null until tracked",
        ),
        column(
            "vx",
            FLOAT,
            "m/s",
            "velocity of the thing over ground, world frame or else sensor frame; null until tracked",
        ),
        column("vy", FLOAT, "m/s", "velocity of the thing over ground; null until tracked"),
        column("moving", BOOL, "", "whether the thing moves in this sweep; null until tracked"),
        column(
            "thing",
            FLOAT,
            "1",
            "how likely it is a thing and not a piece of building, 0 to 1; null with a background or profile paper",
        ),
        _LABEL,
        _LABEL_SCORE,
        column("world_x", FLOAT, "m", "box centre in the world frame; null without a pose"),
        column("world_y", FLOAT, "m", "box centre in the world frame; null without a pose"),
        column("world_yaw", FLOAT, "rad", "box yaw in the world frame; null without a pose"),
        column(
            "why",
            pa.string(),
            "",
            "what each kind of evidence of this sweep adds to the log-odds of a thing; null without --explain",
        ),
    ]
)

SWEEPS = pa.schema(
    [
        _LOG,
        _TOPIC,
        _FRAME,
        _SWEEP,
        _STAMP,
        _SECONDS,
        column("beams", INT32, "1", "beams of the sweep"),
        column("valid", INT32, "1", "beams with a range"),
        column("no_return", INT32, "1", "beams without a return"),
        column("too_close", INT32, "1", "beams below the range limit"),
        column("invalid", INT32, "1", "beams without a usable value"),
        column(
            "nearest",
            FLOAT,
            "m",
            "least range of the sweep, be it of an object or a wall; null without a range",
        ),
        column("nearest_theta", FLOAT, "rad", "bearing of the beam with that range; null without one"),
        column("d_mean", FLOAT, "m", "mean of |s|, the threshold of Def. 3; null without a difference"),
        column("d_th", FLOAT, "m", "threshold of a discontinuity that was used"),
        column("noise", FLOAT, "m", "noise of the ranges: their estimated standard deviation sigma"),
        column("objects", INT32, "1", "objects in the sweep (set O)"),
        column("agents", INT32, "1", "agents in the sweep (set A)"),
        column("object_beams", INT32, "1", "beams on objects (set O)"),
        column("agent_beams", INT32, "1", "beams on agents (set A)"),
        column(
            "noise_beams",
            INT32,
            "1",
            "beams on walls and the rest (set S): in no object; the three sets sum to beams (Def. 4)",
        ),
        column("pose_x", FLOAT, "m", "sensor position in the world frame; null without a pose"),
        column("pose_y", FLOAT, "m", "sensor position in the world frame; null without a pose"),
        column("pose_yaw", FLOAT, "rad", "sensor yaw in the world frame; null without a pose"),
        column(
            "station", INT32, "1", "station of the background that it was compared with; null without one"
        ),
    ]
)

TRACKS = pa.schema(
    [
        _LOG,
        _TOPIC,
        _FRAME,
        column("track", INT64, "1", "number of the thing, 1, 2, ... by first sight within its topic"),
        column("set", TEXT, "", "A agent: it has moved by itself; O object: it has not"),
        column(
            "shape", TEXT, "", "prismatic, round, legged, irregular or unknown, by all that was seen of it"
        ),
        _LABEL,
        _LABEL_SCORE,
        column("first_sweep", INT64, "1", "sweep in which it was first seen"),
        column("last_sweep", INT64, "1", "sweep in which it was last seen"),
        column("first_stamp", STAMP, "ns", "stamp of the first of these sweeps"),
        column("last_stamp", STAMP, "ns", "stamp of the last"),
        column("duration", FLOAT, "s", "from the first sight to the last"),
        column("sweeps", INT64, "1", "sweeps in which it was seen"),
        column("hidden", FLOAT, "s", "time between first and last sight in which it was not seen"),
        column("x", FLOAT, "m", "centre, world frame or else sensor frame; of an agent where it was last"),
        column("y", FLOAT, "m", "centre, world frame or else sensor frame"),
        column("yaw", FLOAT, "rad", "direction of the longer side"),
        column("length", FLOAT, "m", "longer side by all that was seen of it; null where unknown"),
        column("width", FLOAT, "m", "shorter side by all that was seen of it; null where unknown"),
        column("length_sd", FLOAT, "m", "standard deviation of the length"),
        column("width_sd", FLOAT, "m", "standard deviation of the width"),
        column("distance", FLOAT, "m", "way travelled over ground, in the sweeps in which it moves"),
        column("speed_mean", FLOAT, "m/s", "mean speed from the first sight to the last"),
        column("speed_max", FLOAT, "m/s", "greatest speed"),
        column("moved_at", STAMP, "ns", "stamp at which it began to move; null for what never moved"),
        column("end", TEXT, "", "left view, free, lost or end of log: why it ends"),
    ]
)

BEAMS = pa.schema(
    [
        _LOG,
        _TOPIC,
        _SWEEP,
        column("beam", INT32, "1", "index of the beam in its sweep, from 0"),
        column("theta", FLOAT, "rad", "bearing of the beam"),
        column("r", FLOAT, "m", "range; null where the beam has none"),
        column("status", TEXT, "", "valid, no_return, too_close or invalid"),
        column("s", FLOAT, "m", "signed difference to the beam before; null where undefined"),
        column("set", TEXT, "", "O, A or S (Def. 4)"),
        column("object", INT32, "1", "number of the object the beam belongs to; null in S"),
        column("difference", FLOAT, "m", "r_w - r_e; null without a background"),
    ]
)

BACKGROUND = pa.schema(
    [
        _TOPIC,
        _FRAME,
        column("station", INT32, "1", "place and heading of the sensor, from 0 for each topic and frame"),
        column("beam", INT32, "1", "index of the beam, from 0"),
        column("theta", FLOAT, "rad", "bearing of the beam"),
        column("r_e", FLOAT, "m", "range of the background; inf: open, nothing returns; null: nothing known"),
        column(
            "r_near", FLOAT, "m", "nearest surface with as much support as r_e needs; r_e but for depth edges"
        ),
        column("spread", FLOAT, "m", "robust standard deviation of the ranges that back r_e"),
        column("support", FLOAT, "1", "share of the observations that back r_e"),
        column("no_return", FLOAT, "1", "share of the observations without a return"),
        column("sweeps", INT64, "1", "sweeps of the station"),
        column("pose_x", FLOAT, "m", "sensor position in the world frame; null without a pose"),
        column("pose_y", FLOAT, "m", "sensor position in the world frame; null without a pose"),
        column("pose_yaw", FLOAT, "rad", "sensor yaw in the world frame; null without a pose"),
        column("upside_down", BOOL, "", "whether the sensor hangs head down"),
    ]
)

MATCHES = pa.schema(
    [
        column("thing", INT64, "1", "number of the thing, 1, 2, ... by first sight in the order of the runs"),
        column("log", TEXT, "", "log in which it was seen; its table where several logs have one name"),
        _TOPIC,
        column("track", INT64, "1", "its number in the tracks table of that log"),
        column("x", FLOAT, "m", "where it stands, in the coordinates of the first run that is matched"),
        column("y", FLOAT, "m", "where it stands"),
        column(
            "moved", FLOAT, "m", "how far from where it was in the run before that has it; null in the first"
        ),
        column("score", FLOAT, "1", "how likely it is that thing and no other, 0 to 1; null in the first"),
    ]
)

CLOUD = pa.schema(
    [
        _LOG,
        _TOPIC,
        _SWEEP,
        column("beam", INT32, "1", "index of the beam in its sweep, from 0"),
        column("stamp", STAMP, "ns", "time of the beam"),
        column("x", FLOAT, "m", "point in the world frame"),
        column("y", FLOAT, "m", "point in the world frame"),
        column("set", TEXT, "", "O, A or S (Def. 4); null where the beams were not told apart"),
    ]
)

POSES = pa.schema(
    [
        _LOG,
        _TOPIC,
        _FRAME,
        column("world", TEXT, "", "the fixed frame"),
        _SWEEP,
        _STAMP,
        column("x", FLOAT, "m", "where the sensor was at the stamp of the sweep"),
        column("y", FLOAT, "m", "where it was"),
        column("z", FLOAT, "m", "where it was"),
        column("qx", FLOAT, "1", "its rotation, a unit quaternion"),
        column("qy", FLOAT, "1", "its rotation"),
        column("qz", FLOAT, "1", "its rotation"),
        column("qw", FLOAT, "1", "its rotation, 0 or more"),
        column("yaw", FLOAT, "rad", "direction of its x axis, seen from above"),
    ]
)

RUNS = pa.schema(
    [
        column("log", pa.string(), "", "name of the log, which its tables carry"),
        column("url", pa.string(), "", "where it is: an absolute path, or the URL of an object"),
        column("size", INT64, "byte", "its size; null where unknown"),
        column("etag", pa.string(), "", "the store's mark of its content; null outside of stores"),
        column("mtime", STAMP, "ns", "its last change; null where unknown"),
        column("parameters", pa.string(), "", "hash of all that the tables depend on beside the log"),
        column("version", pa.string(), "", "version of lidarcli"),
        column("outcome", TEXT, "", "ok, damaged (read as far as it can be) or failed (no tables)"),
        column("exit_code", INT32, "1", "that of a run over this log alone"),
        column("message", pa.string(), "", "why, where the outcome is not ok"),
        column("outputs", _list(pa.string()), "", "files that were written"),
        column("output_sizes", _list(INT64), "byte", "size of each of them"),
        column("sweeps", INT64, "1", "sweeps that were read; null where the log failed"),
        column("rows", INT64, "1", "rows of all its tables; null where the log failed"),
        column("seconds", FLOAT, "s", "how long it took; null where the log failed"),
        column("ended", STAMP, "ns", "when it was done"),
    ]
)

SCHEMAS = {"objects": OBJECTS, "sweeps": SWEEPS, "tracks": TRACKS, "beams": BEAMS}
"""Table name, as in the file name `<log>.<table>.parquet` → schema."""

NULLABLE = {
    "objects": frozenset({"change", "track", "moving", "label", "why"}),
    "sweeps": frozenset({"station"}),
    "tracks": frozenset({"label", "moved_at"}),
    "beams": frozenset({"object"}),
    "background": frozenset[str](),
    "matches": frozenset[str](),
    "runs": frozenset({"size", "etag", "mtime", "message", "outputs", "output_sizes", "sweeps", "rows"}),
}
"""Table → columns that may be null beside those of floating point, which all may: null is what was not measured."""
LATER = {
    "objects": frozenset({"t", "vx", "vy", "moving", "thing", "label", "label_score", "why", "intensity"}),
    "sweeps": frozenset({"t", "nearest", "nearest_theta"}),
}
"""Table → columns that tables of earlier versions do not have: read as null."""
INFINITE = frozenset({"r_e", "r_near"})
"""Columns that may be infinite: in these directions the scene is open."""
