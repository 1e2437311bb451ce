"""The schema of every table, made of declared columns: those of records, and those that only tables have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial

import pyarrow as pa

from lidarcli.formalism.detection import COLUMNS, SETS, fields_per
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks, Trajectories
from lidarcli.options.choices import CHANGE_KINDS, CHANGE_STATUSES, CHANGE_WHYS, MAP_STATES
from lidarcli.sweeps.types import STATUSES, Column, columns_of
from lidarcli.sweeps.zone import ACTIONS

TEXT = pa.dictionary(pa.int32(), pa.string())
STAMP = pa.timestamp("ns", tz="UTC")
FLOAT = pa.float64()
KINDS = {
    "text": TEXT,
    "string": pa.string(),
    "stamp": STAMP,
    "bool": pa.bool_(),
    "int32": pa.int32(),
    "int64": pa.int64(),
    "float32": pa.float32(),
    "float64": FLOAT,
}
"""Type of a declared column → its type in Arrow."""


def field_of(one: Column) -> pa.Field:
    """Return a column as Arrow has it, with unit and meaning as its metadata."""
    metadata = {b"unit": one.unit.encode(), b"description": one.meaning.encode()}
    return pa.field(one.name, KINDS.get(one.kind, one.kind), nullable=one.nullable, metadata=metadata)


def schema_of(columns: Iterable[Column]) -> pa.Schema:
    """Return the schema of a table that has these columns."""
    return pa.schema([field_of(one) for one in columns])


def _list(item: pa.DataType) -> pa.DataType:
    # The element is named as Parquet names it, whatever the default of the pyarrow at hand.
    return pa.list_(pa.field("element", item, nullable=False))


def _between(columns: Mapping[str, Column], first: str, last: str) -> list[Column]:
    """Return the columns of a record from one field to another, both included."""
    names = [*columns]
    return [columns[name] for name in names[names.index(first) : names.index(last) + 1]]


VERTICES, FACES = (_list(pa.struct([field_of(COLUMNS[name]) for name in fields_per(each)])) for each in ("vertex", "face"))

_FOLLOWED, _TRACKS, _TRAJECTORIES = map(columns_of, (TrackedBatch, Tracks, Trajectories))

_open = partial(Column, nullable=True)
_LOG = Column("log", "text", "", "log the sweep comes from")
_TOPIC = Column("topic", "text", "", "LaserScan topic")
_FRAME = Column("frame_id", "text", "", "sensor frame of the sweep")
_SWEEP = Column("sweep", "int64", "1", "index of the sweep within its topic, in log order, from 0")
_STAMP = Column("stamp", "stamp", "ns", "header stamp, or the log's record time where the header has none")
_SECONDS = Column("t", "float64", "s", "seconds since the first sweep of the topic in the log")
_BEAM = Column("beam", "int32", "1", "index of the beam in its sweep, from 0")
BEAM_OF_SENSOR = Column("beam", "int32", "1", "index of the beam, from 0")
_THETA = Column("theta", "float32", "rad", "bearing of the beam")
_POSE = (
    *(_open(f"pose_{axis}", "float64", "m", "sensor position in the world frame; null without a pose") for axis in "xy"),
    _open("pose_yaw", "float64", "rad", "sensor yaw in the world frame; null without a pose"),
)
EVENT_KINDS = ("occupied", "approach", "visit", "crossing", "stale", "nav2", "stop")
DIRECTIONS = ("in", "out")
_NAME = _open("label", "text", "", "its name in the catalogue; null without one")
_ZONE = Column("zone", "text", "", "name of the zone")
_LABEL, _LABEL_SCORE = COLUMNS["label"], COLUMNS["label_score"]
_STATUSES = {
    "valid": "beams with a range",
    "no_return": "beams without a return",
    "too_close": "beams below the range limit",
    "invalid": "beams without a usable value",
    "masked": "beams whose range is left out, as that of the robot itself",
}
"""Status of a beam → meaning of the column that counts such beams."""

TABLES: dict[str, tuple[Column, ...]] = {
    "objects": (
        *(_LOG, _TOPIC, _FRAME, _SWEEP, _STAMP, _SECONDS),
        *_between(COLUMNS, "object", "box_yaw"),
        COLUMNS["intensity"],
        Column("vertices", VERTICES, "", "vertices in order of bearing"),
        Column("faces", FACES, "", "faces between the vertices"),
        *(COLUMNS["difference"], COLUMNS["change"]),
        *_between(_FOLLOWED, "track", "agent_score"),
        *(COLUMNS["thing"], _LABEL, _LABEL_SCORE),
        *(_open(f"world_{axis}", "float64", "m", "box centre in the world frame; null without a pose") for axis in "xy"),
        _open("world_yaw", "float64", "rad", "box yaw in the world frame; null without a pose"),
        _open(
            "why",
            "string",
            "",
            "what each kind of evidence of this sweep adds to the log-odds of a thing; null without --explain",
        ),
    ),
    "sweeps": (
        *(_LOG, _TOPIC, _FRAME, _SWEEP, _STAMP, _SECONDS),
        Column("beams", "int32", "1", "beams of the sweep"),
        *(Column(name, "int32", "1", _STATUSES[name]) for name in STATUSES),
        Column(
            "observed",
            "bool",
            "",
            "whether the sweep shows anything: it has a range, and does not repeat a sweep of over half a second ago "
            "bit for bit, with its noise or while the poses move",
        ),
        *_between(COLUMNS, "nearest", "noise_beams"),
        *_POSE,
        COLUMNS["station"],
    ),
    "tracks": (
        _LOG,
        _TOPIC._replace(meaning="LaserScan topic; null where sensors of several saw it", nullable=True),
        _FRAME._replace(meaning="sensor frame; null where several sensors saw it", nullable=True),
        *_between(_TRACKS, "track", "shape"),
        *(_LABEL, _LABEL_SCORE),
        *_between(_TRACKS, "first_sweep", "end"),
    ),
    "trajectories": (*(_LOG, _TOPIC, _SWEEP, _STAMP, _SECONDS), *_TRAJECTORIES.values()),
    "beams": (
        *(_LOG, _TOPIC, _SWEEP, _BEAM, _THETA),
        _open("r", "float32", "m", "range; null where the beam has none"),
        Column("status", "text", "", "valid, no_return, too_close, invalid or masked", words=STATUSES),
        *(COLUMNS[name] for name in ("beam_s", "beam_set", "beam_object", "beam_difference")),
    ),
    "events": (
        _LOG,
        _TOPIC._replace(meaning="scan topic with most of the points; of `stale` the one that tells nothing"),
        _FRAME,
        Column("event", "int64", "1", "number of the event in its log, 1, 2, ... by its start"),
        Column("first_sweep", "int64", "1", "sweep of the topic with which it begins"),
        Column("last_sweep", "int64", "1", "last sweep of the topic that belongs to it"),
        Column("sweeps", "int64", "1", "sweeps with enough points, or that see its agent"),
        _ZONE,
        Column("kind", "text", "", "occupied, approach, visit, crossing, stale, nav2 or stop", words=EVENT_KINDS),
        Column("action", "text", "", "what the zone asks for: stop, slowdown, limit, approach or none", words=ACTIONS),
        _open("polygon", "text", "", "part of a velocity_polygon that counted; null elsewhere"),
        Column("start", "stamp", "ns", "stamp with which it begins"),
        Column("end", "stamp", "ns", "last stamp that belongs to it"),
        Column("t", "float64", "s", "begin, in seconds since the first sweep of the log's zones"),
        Column("duration", "float64", "s", "from start to end"),
        _open("hidden", "float64", "s", "time of a visit in which its agent is not seen; else null"),
        Column("cut", "bool", "", "true where it goes on at an end of the log"),
        _open("points", "int32", "1", "most points at once; null where none are counted"),
        _open("agents", "int32", "1", "most agents at once; null without tracks"),
        _open("nearest", "float64", "m", "least distance from the sensor; null where nothing is measured"),
        _open("bearing", "float64", "rad", "bearing there, seen from the sensor; null like `nearest`"),
        *(_open(axis, "float64", "m", "nearest point in the frame of the zone; null like `nearest`") for axis in "xy"),
        _open(
            "set",
            "text",
            "",
            "set of most points at that moment: O, A or S (walls and the rest); null where no objects are known",
            words=SETS,
        ),
        _open("track", "int64", "1", "track of most points at that moment; null without one"),
        _NAME,
        _open("direction", "text", "", "of a crossing: in or out; null elsewhere", words=DIRECTIONS),
        _open("ttc", "float64", "s", "least time to collision; null where none was found"),
        _open(
            "speed",
            "float64",
            "m/s",
            "greatest speed of the robot meanwhile; of a stop the median from 1.5 to 0.5 s before, by odometry negative "
            "backwards; null where it is not known",
        ),
    ),
    "zones": (
        *(_LOG, _TOPIC, _SWEEP, _STAMP, _SECONDS),
        _ZONE,
        Column("points", "int32", "1", "points in the zone, with the newest ones of other sensors"),
        _open("nearest", "float64", "m", "least distance of such a point from its sensor; null without one"),
        _open("ttc", "float64", "s", "time to collision; null where none is near"),
        Column("active", "bool", "", "whether an event of the zone goes on"),
        _open("things", "int32", "1", "tracks or objects of sets O and A with points in it; null without objects"),
        _open("agents", "int32", "1", "agents in it that are seen; null without tracks"),
        Column("masked", "int32", "1", "points in it that a mask leaves out"),
        Column(
            "observed",
            "bool",
            "",
            "whether something in it could have made an event: enough beams reach it, for long enough (docs/zones.md)",
        ),
    ),
    "counts": (
        *(_LOG, _TOPIC._replace(meaning="scan topic, the first of those that count"), _ZONE),
        Column("start", "stamp", "ns", "begin of the interval of time"),
        Column("end", "stamp", "ns", "its end"),
        Column("direction", "text", "", "in or out", words=DIRECTIONS),
        Column("count", "int64", "1", "crossings that were seen, those by several tracks of one person once"),
        Column("low", "int64", "1", "least number of true ones (docs/counting.md)"),
        _open("high", "int64", "1", "greatest number; null where the line was not observed"),
        Column("unsure", "int64", "1", "crossings out of sight, or seen on one side alone: not counted, but below `high`"),
        Column("agents", "float64", "1", "mean number of agents at once, of the sweeps that see any"),
        Column("observed", "float64", "1", "share of the time in which the line was observed"),
    ),
    "cleaned": (
        *(_LOG, _TOPIC, _SWEEP, _STAMP),
        Column("agents", "int32", "1", "beams on agents, from the moment on at which each began to move"),
        Column("temporary", "int32", "1", "beams on what stands where the place was also seen free"),
        Column("body", "int32", "1", "beams under a mask"),
        Column("margin", "int32", "1", "beams beside such beams"),
    ),
    "background": (
        *(_TOPIC, _FRAME),
        Column("station", "int32", "1", "place and heading of the sensor, from 0 for each topic and frame"),
        BEAM_OF_SENSOR,
        # All in double precision: a background that is read again is the one that was learned.
        _THETA._replace(kind="float64"),
        _open(
            "r_e", "float64", "m", "range of the background; inf: open, nothing returns; null: nothing known", infinite=True
        ),
        _open(
            "r_near",
            "float64",
            "m",
            "nearest surface with as much support as r_e needs; r_e but for depth edges; null where nothing is known",
            infinite=True,
        ),
        _open(
            "spread", "float64", "m", "robust standard deviation of the ranges that back r_e; null where that is no range"
        ),
        Column("support", "float64", "1", "share of the observations that back r_e"),
        Column("no_return", "float64", "1", "share of the observations without a return"),
        Column("sweeps", "int64", "1", "sweeps of the station"),
        *_POSE,
        Column("upside_down", "bool", "", "whether the sensor hangs head down"),
    ),
    "changes": (
        Column("log_a", "text", "", "run that saw the place before"),
        Column("log_b", "text", "", "run that is compared with it"),
        Column("thing", "int64", "1", "number of the row, 1, 2, ..."),
        Column("kind", "text", "", "thing, or structure: what no thing explains", words=CHANGE_KINDS),
        Column("status", "text", "", "known, moved, new, gone or uncertain", words=CHANGE_STATUSES),
        _open(
            "why",
            "text",
            "",
            "why nobody can tell: hidden, out of view, no free space, short, ambiguous or poses; null where it can be told",
            words=CHANGE_WHYS,
        ),
        _open("score", "float64", "1", "probability of the status, 0 to 1; 0 where nothing tells"),
        *(
            column
            for run, words in (("a", "where it was in log_a"), ("b", "where it is in log_b"))
            for column in (
                *(
                    _open(
                        f"{axis}_{run}",
                        "float64",
                        "m",
                        f"{words}, in the coordinates of the first run; null where that run has it not",
                    )
                    for axis in "xy"
                ),
                _open(f"yaw_{run}", "float64", "rad", f"direction of its longer side in log_{run}"),
            )
        ),
        _open("moved", "float64", "m", "distance between both places; of drift by how much a path would be off; else null"),
        _open("turned", "float64", "rad", "turn between both, -π/2 to π/2; null without both"),
        _open("length", "float64", "m", "longer side; null where unknown"),
        _open("width", "float64", "m", "shorter side; null where unknown"),
        _open("area", "float64", "m²", "its area, of structure that of its cells; null where unknown"),
        *(
            _open(
                f"track_{run}", "int64", "1", f"its number in the tracks table of log_{run}; null where that run has it not"
            )
            for run in "ab"
        ),
        _NAME,
        *(
            _open(f"sweeps_{run}", "int64", "1", f"sweeps of log_{run} that could see the place; null where unknown")
            for run in "ab"
        ),
        *(_open(f"free_{run}", "float64", "1", f"share of it that log_{run} saw free; null where unknown") for run in "ab"),
    ),
    "cloud": (
        *(_LOG, _TOPIC, _SWEEP, _BEAM),
        Column("stamp", "stamp", "ns", "time of the beam"),
        *(Column(axis, "float64", "m", "point in the world frame") for axis in "xy"),
        COLUMNS["beam_set"]._replace(
            nullable=True, meaning=f"{COLUMNS['beam_set'].meaning}; null where the beams were not told apart"
        ),
    ),
    "poses": (
        *(_LOG, _TOPIC, _FRAME),
        Column("world", "text", "", "the fixed frame"),
        *(_SWEEP, _STAMP),
        Column("x", "float64", "m", "where the sensor was at the stamp of the sweep"),
        *(Column(axis, "float64", "m", "where it was") for axis in "yz"),
        Column("qx", "float64", "1", "its rotation, a unit quaternion"),
        *(Column(axis, "float64", "1", "its rotation") for axis in ("qy", "qz")),
        Column("qw", "float64", "1", "its rotation, 0 or more"),
        Column("yaw", "float64", "rad", "direction of its x axis, seen from above"),
        Column(
            "map_state",
            "text",
            "",
            "by a map (`--map`): the path fits it, is off, lost, or that is unknown; null without a verdict",
            words=MAP_STATES,
            nullable=True,
        ),
        Column("map_share", "float64", "1", "share of the beams of its second that the map explains", nullable=True),
        *(
            Column(f"map_d{axis}", "float64", "m", "correction that lays it on the map; null without one", nullable=True)
            for axis in "xy"
        ),
        Column("map_dyaw", "float64", "rad", "turn of this correction", nullable=True),
    ),
}
"""Table → its columns, in order."""

(OBJECTS, SWEEPS, TRACKS, TRAJECTORIES, BEAMS, EVENTS, ZONES, COUNTS, CLEANED, BACKGROUND, CHANGES, CLOUD, POSES) = map(
    schema_of, TABLES.values()
)
SCHEMAS = dict(zip(TABLES, (OBJECTS, SWEEPS, TRACKS, TRAJECTORIES, BEAMS, EVENTS, ZONES, COUNTS), strict=False))
"""Table name, as in the file name `<log>.<table>.parquet` → schema."""

NULLABLE = {name: frozenset(one.name for one in table if one.nullable) for name, table in TABLES.items()}
"""Table → columns that may be null."""
INFINITE = frozenset(one.name for table in TABLES.values() for one in table if one.infinite)
"""Columns that may be infinite: in these directions the scene is open."""

BRIEF = {
    "objects": (
        *("log", "topic", "sweep", "t", "object", "set", "track", "shape", "label", "r_min", "width"),
        *("box_x", "box_y", "vx", "vy", "world_x", "world_y"),
    ),
    "sweeps": (
        *("log", "topic", "sweep", "t", "beams", "valid", "nearest", "objects", "agents"),
        *("pose_x", "pose_y", "pose_yaw"),
    ),
    "tracks": (
        *("log", "topic", "track", "set", "shape", "label", "sweeps", "duration"),
        *("x", "y", "length", "width", "distance", "speed_mean", "speed_max"),
    ),
    "trajectories": ("log", "topic", "sweep", "t", "track", "x", "y", "vx", "vy", "seen"),
    "beams": ("log", "topic", "sweep", "beam", "theta", "r", "status", "set", "object"),
}
"""Table → a few columns that tell what was where: names, time, set and size, distance, place and velocity."""
