"""Every option, declared once.

The command line, the keywords of the Python functions, `lidarcli.toml`, the variables of the environment, docs/cli.md and
docs/python.md are made from these declarations. A group is a `TypedDict`: type checkers read the types of the keywords from
it, and each field carries an `Option` beside its type. Options of one command alone stand in the file of that command.
Nothing here imports click or numpy, so that `--help` answers soon.
"""

import math
from collections.abc import Iterable, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, TypedDict

from lidarcli.errors import OptionError
from lidarcli.options import choices
from lidarcli.options.forms import Argument, File, Number, Option, Rule, Text

if TYPE_CHECKING:
    from lidarcli.formalism.background import Background
    from lidarcli.formalism.matching.catalogue import Catalogue

AnyPath = str | PathLike[str]
Paths = AnyPath | Iterable[AnyPath]
"""One file, folder, pattern or URL, or several."""


class Table(Protocol):
    """A table in memory: of Arrow, pandas, polars or any library that hands out Arrow streams."""

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object: ...


TableOrPath = AnyPath | Table | tuple[Any, ...]
"""A table in memory or its path, or the named tuple of tables that a function returned."""
Tables = TableOrPath | Iterable[TableOrPath]
"""One table of the kinds that lidarcli makes, or several."""


class Changed(Protocol):
    """A table of changes with all that `diff` tells beside it."""

    changes: Any


STDOUT = "-"
"""As the name of an output: standard output."""

OUTPUT, MANY = "Output", "Many logs"
SELECT, POSES = "Sweeps to read", "Where the sensor was"
RANGES, GEOMETRY = "Beams", "Text logs without names or geometry"
CLOUDS, OBJECTS = "Point clouds", "Objects"
STATIONS = "Viewpoints (stations) of a moving sensor"
GRID, CLOUD = "Occupancy grid", "Point cloud"
PICTURE, LOOK, CHECKS, ZONES, FINDINGS = "Picture", "Look", "Checks", "Zones", "Findings"
PLACES, CHANGES = "Places", "What to change"
RUN, LOG = "Run", "Log"


def _time(text: str) -> Any:
    """Seconds after the first sweep, or an `Instant`."""
    from lidarcli.options.times import parse_time

    found = parse_time(text)
    if isinstance(found, float) and found < 0:
        raise OptionError(f"{text} is below 0")
    return found


def _no_return(text: str) -> str:
    """The list as it is, once its items are known to be words and ranges."""
    from lidarcli.sweeps.range_rules import parse_no_return

    parse_no_return(text)
    return text


def _threshold(text: str) -> str | float:
    """`adaptive`, `mean` or metres."""
    if text in ("adaptive", "mean"):
        return text
    try:
        float(text)
    except ValueError:
        raise OptionError(f"'{text}' is neither adaptive nor mean nor a number of metres") from None
    return WIDTH.parse(text)


def parse_removed(text: str) -> str:
    """The list as it is, once its items are known; `none` stands alone."""
    for word in text.split(",") if text.strip() != "none" else ():
        if word.strip() == "body":
            raise OptionError("the robot's own body is what --mask FILE tells")
        if word.strip() not in choices.REMOVABLE:
            raise OptionError(f"'{word.strip()}' is not one of {', '.join(choices.REMOVABLE)}")
    return text


def parse_mends(text: str) -> str:
    """The list as it is, once its items are known."""
    known = (choices.FOUND, *choices.MENDS)
    if odd := [word.strip() for word in text.split(",") if word.strip() not in known]:
        raise OptionError(f"'{odd[0]}' is not one of {', '.join(known)}")
    return text


def parse_value(text: str) -> str | float:
    """`nan`, `inf`, `above` or metres."""
    if text.lower() in choices.SAYINGS:
        return text.lower()
    try:
        float(text)
    except ValueError:
        raise OptionError(f"'{text}' is neither {', '.join(choices.SAYINGS)} nor a number of metres") from None
    return LENGTH.parse(text)


def parse_names(text: str) -> tuple[str, ...]:
    """Names of columns, comma separated."""
    return tuple(name for part in text.split(",") if (name := part.strip()))


def parse_numbers(text: str) -> tuple[int, ...]:
    """Numbers of tracks, comma separated."""
    wrong = next((part for part in text.split(",") if not part.strip().isdecimal()), None)
    if wrong is not None:
        raise OptionError(f"'{wrong}' is no number of a track; give them as 4,6")
    return tuple(dict.fromkeys(int(part) for part in text.split(",")))


def _share(text: str) -> tuple[int, int]:
    """(I, N): the I-th of N shares."""
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal()):
        raise OptionError(f"'{text}' is not I/N, as 1/8")
    if not 1 <= int(number) <= int(count) <= choices.MAX_SHARDS:
        raise OptionError(f"'{text}': shares are numbered from 1 to {count}")
    return int(number), int(count)


WIDTH, LENGTH = Number("METRES", 0, above=True), Number("METRES", 0)
COUNT, COUNT_OR_NONE = (Number("N", 1, choices.MAX_COUNT, whole=True), Number("N", 0, choices.MAX_COUNT, whole=True))
ANY_COUNT = Number("N", 0, math.inf, whole=True)
ANGLE, TURN = Number("ANGLE"), Number("DEGREES", 0, above=True)
SWEEP = Number("N", 0, choices.LAST_SWEEP, whole=True)
TIME = Text("TIME", _time)
INPUT = File("LOG")


# What several commands of the command line share, and Python does not have.


class OneLog(TypedDict, total=False):
    """One log, which may be in parts."""

    log: Annotated[tuple[str, ...], Argument("LOG...", INPUT, several=True)]


class ManyLogs(TypedDict, total=False):
    """Logs, and which of them to take."""

    logs: Annotated[tuple[str, ...], Argument("LOG...", INPUT, several=True, required=False)]
    files_from: Annotated[
        str | None,
        Option(MANY, File("FILE"), shown="none", rare=True),
        "Also read the logs that this file lists, one per line; - for standard input.",
    ]
    base: Annotated[
        str | None,
        Option(MANY, File("DIR"), shown="the folder or pattern that was given", rare=True),
        "Mirror the sub-folders of this folder or URL below DIR.",
    ]
    shard: Annotated[
        tuple[int, int] | None,
        Option(MANY, Text("I/N", _share), shown="all", rare=True),
        "Process only the I-th of N shares of the logs. The name of a log alone decides which share it is in.",
    ]
    dry_run: Annotated[bool, Option(MANY, None, False, rare=True), "Only print what would be read and written."]


def output(metavar: str, **more: Any) -> Option:
    """Return `-o`, which every command fills with something else; without a default it is required."""
    more.setdefault("required", not {"default", "shown"} & more.keys())
    return Option(OUTPUT, File(metavar, is_output=True), short="-o", **more)


class Overwrite(TypedDict, total=False):
    overwrite: Annotated[bool, Option(OUTPUT, None, False), "Replace files that exist."]


_STAMPS = "Unit of the stamps in tables; us for Spark, Iceberg and Delta, which have no ns (docs/fleet.md)."


class Stamped(Overwrite, total=False):
    """Options of a command that writes tables."""

    stamps: Annotated[Literal["ns", "us"], Option(OUTPUT, choices.STAMPS, choices.NS, rare=True), _STAMPS]


class TextOrJson(TypedDict, total=False):
    format: Annotated[Literal["text", "json"], Option(OUTPUT, ("text", "json"), "text"), "Text, or JSON for programs."]


class Reported(Stamped, TextOrJson, total=False):
    """Options of a command that writes tables, or a table among others, and prints a summary."""


_HOLDS = "`holds` of the result tells."
CHECK = Option(CHECKS, Text("EXPR", has_blanks=True), (), shown="none", several=True, python=_HOLDS)


class Checked(TypedDict, total=False):
    """Options of a command that holds what it finds against conditions."""

    checks: Annotated[
        tuple[str, ...],
        Option(CHECKS, File("FILE"), (), shown="none", several=True),
        "Also the checks of this file (TOML, docs/ci.md); may be repeated.",
    ]


class Jobs(TypedDict, total=False):
    jobs: Annotated[int | None, Option(OUTPUT, COUNT, shown="automatic", short="-j"), "Processors to use at most."]


# Groups that commands and Python functions share.


class Window(TypedDict, total=False):
    """The time from which and up to which to read."""

    start: Annotated[
        float | str | None,
        Option(SELECT, TIME, shown="0"),
        "Start at this time: seconds after the first sweep (10, 2min), or 2026-11-22T10:00:00Z.",
    ]
    end: Annotated[float | str | None, Option(SELECT, TIME, shown="the end"), "End before this time, given like --start."]


class Run(TypedDict, total=False):
    run: Annotated[
        int | None,
        Option(SELECT, COUNT, shown="all", rare=True),
        "Run to read, counted from 1, of a log whose clock starts anew (docs/poses.md).",
    ]


class _Topic(TypedDict, total=False):
    topic: Annotated[
        str | Iterable[str] | None,
        Option(SELECT, Text("NAME"), shown="all", several=True),
        "LaserScan topic to read, or a pattern, '/scan*'; may be repeated.",
    ]


class Topics(_Topic, Window, Run, total=False):
    """The sweeps of a log to read."""

    every: Annotated[int, Option(SELECT, COUNT, 1), "Take every N-th sweep."]


class Poses(TypedDict, total=False):
    """The source of the poses."""

    pose: Annotated[
        str | None,
        Option(POSES, Text("TOPIC"), shown="the best that fits the sweeps", unless=("poses",)),
        "Topic with the poses of the sensor; none; match: from the sweeps (docs/poses.md).",
    ]
    poses: Annotated[
        AnyPath | None,
        Option(POSES, File("FILE.tum"), shown="the poses in the log", unless=("pose",), rare=True),
        "Path of the sensor from a file with lines of timestamp x y z qx qy qz qw, as `lidarcli poses` and evo write it.",
    ]
    deskew: Annotated[
        bool,
        Option(POSES, None, True, rare=True),
        "Correct sweeps for the motion of the sensor while they are taken (needs poses).",
    ]
    beam_order: Annotated[
        Literal["auto", "forward", "reverse", "once"],
        Option(POSES, choices.BEAM_ORDERS, choices.BEAM_ORDERS[0], rare=True),
        "Order in which the beams of a sweep are taken: from the first to the last, in reverse, or all at once; auto: "
        "learned from the sweeps of a moving sensor, else as the headers tell.",
    ]


class Delay(TypedDict, total=False):
    """The delay of the poses."""

    pose_delay: Annotated[
        float | None,
        Option(POSES, Number("SECONDS"), shown="what fits the sweeps", rare=True),
        "Use the pose from this long after the header stamp of a sweep; negative: before it.",
    ]


class Limits(TypedDict, total=False):
    range: Annotated[
        tuple[float, float] | None,
        Option(RANGES, Number("MIN MAX", 0, count=2), shown="those of the log"),
        "Range limits [m].",
    ]
    no_return: Annotated[
        str | Iterable[str | float],
        Option(RANGES, Text("LIST", _no_return, is_list=True), "inf,zero,max,above,pile", rare=True),
        "Values that mean 'no return', comma separated: inf, zero, max, above, pile (a far range that very many beams "
        "have), nan, negative, below, or metres such as 81.91.",
    ]
    mask: Annotated[
        AnyPath | None,
        Option(RANGES, File("FILE|auto|none"), shown="none"),
        "The robot's own body: beams that end on a [[mask]] of this file (docs/formats.md) are left out; auto: find them.",
    ]
    segments: Annotated[
        Literal["join", "keep"],
        Option(SELECT, choices.SEGMENTS, choices.JOIN, rare=True),
        "Messages that go on where the one before ended: join makes sweeps of whole turns, keep takes each for a sweep.",
    ]


class Ranges(Limits, total=False):
    """Limits of ranges, and the names of columns and the geometry of beams that a log lacks."""

    columns: Annotated[
        str | Iterable[str],
        Option(GEOMETRY, Text("LIST", is_list=True), (), shown="those of the file", rare=True),
        "Names of the columns of a CSV, in place of its own: time,ranges for one sweep per row, angle,range for one beam "
        "per row (docs/formats.md).",
    ]
    angle_min: Annotated[
        float | None,
        Option(GEOMETRY, ANGLE, shown="from the file, or centred on --fov", rare=True),
        "Bearing of the first beam.",
    ]
    angle_increment: Annotated[
        float | None, Option(GEOMETRY, ANGLE, rare=True, unless=("fov",)), "Angle from beam to beam."
    ]
    fov: Annotated[
        float | None,
        Option(GEOMETRY, ANGLE, rare=True, unless=("angle_increment",)),
        "Field of view, instead of --angle-increment.",
    ]
    range_max: Annotated[
        float | None, Option(GEOMETRY, WIDTH, shown="from the file, or none", rare=True), "Greatest range of the sensor."
    ]
    degrees: Annotated[
        bool,
        Option(GEOMETRY, None, False, shown="radians", rare=True),
        "The three angles above, or without them those of the log, are in degrees.",
    ]
    range_unit: Annotated[
        Literal["m", "cm", "mm"], Option(GEOMETRY, tuple(choices.UNITS), "m", rare=True), "Unit of the ranges in the log."
    ]
    echo: Annotated[
        Literal["first", "last", "strongest"],
        Option(RANGES, choices.ECHOES, choices.ECHOES[0], rare=True),
        "Echo to take of each beam of a MultiEchoLaserScan; strongest: that of the greatest intensity.",
    ]
    slice: Annotated[
        tuple[float, float] | None,
        Option(CLOUDS, Number("ZMIN ZMAX", count=2), shown="clouds are not read", rare=True),
        "Read point clouds as sweeps: of the points between these heights [m] the nearest in each direction. "
        "Heights count from the robot's base, level by tf.",
    ]
    bins: Annotated[
        int | None,
        Option(CLOUDS, Number("N", -math.inf, math.inf, whole=True), shown=str(choices.BINS), rare=True),
        "Beams of a sweep that is made of a point cloud; their view is a full turn, or that of --angle-min and --fov.",
    ]


class Joining(TypedDict, total=False):
    join: Annotated[
        bool,
        Option(MANY, None, False, rare=True),
        "Read the parts of a recording (run_0.bag, run_1.bag) as one log, in the order of their times; of a "
        "folder those of each name.",
    ]


class Reading(Joining, Topics, Poses, Delay, Ranges, total=False):
    """Options for reading a log."""


class _Objects(TypedDict, total=False):
    """Parameters of the objects; None stands for the default of the profile."""

    profile: Annotated[
        Literal["robust", "paper"],
        Option(OBJECTS, choices.PROFILES, choices.PROFILES[0], rare=True),
        "robust: tuned for real sensors; paper: the published formulas, unchanged.",
    ]
    threshold: Annotated[
        Literal["adaptive", "mean"] | float | None,
        Option(OBJECTS, Text("adaptive|mean|METRES", _threshold), shown="adaptive; paper: mean", rare=True),
        "Jump in range that separates two surfaces: adaptive (by noise and range), mean (of |s|, the paper's Def. "
        "3), or metres; with --background the smallest difference.",
    ]
    min_beams: Annotated[
        int | None,
        Option(OBJECTS, COUNT, shown="3; paper: 1", rare=True),
        "Smallest number of valid beams that an object may have.",
    ]
    max_width: Annotated[
        float | None,
        Option(OBJECTS, WIDTH, shown="2; paper or --background: no limit"),
        "Largest object; anything wider counts as wall.",
    ]
    max_gap: Annotated[
        int | None,
        Option(OBJECTS, COUNT_OR_NONE, shown="2; paper: 0", rare=True),
        "How many missing beams in a row may be bridged within one surface.",
    ]
    group_gap: Annotated[
        float | None,
        Option(OBJECTS, LENGTH, shown="0, never", rare=True),
        "Join narrow objects (up to 0.2 m) that are closer than this: the legs of a person or chair.",
    ]
    min_thing: Annotated[
        float | None,
        Option(OBJECTS, Number("P", 0, 1), shown=str(choices.MIN_THING), rare=True),
        "Least probability, 0 to 1, that an object is a thing and not a piece of building; an object with less counts "
        "as wall.",
    ]


class Objects(_Objects, total=False):
    """Parameters of the objects, and which of them have rows; None stands for the default of the profile."""

    walls: Annotated[
        bool, Option(OBJECTS, None, False, rare=True), "Also show walls (set S), with the corners of the room."
    ]


class Comparing(TypedDict, total=False):
    """The background that sweeps are compared with."""

    background: Annotated[
        "AnyPath | Sequence[Background] | None",
        Option(OBJECTS, File("FILE"), shown="none", python="Python also takes what `background` returns."),
        "Find only what differs from this background (docs/background.md).",
    ]
    removed: Annotated[
        bool,
        Option(OBJECTS, None, False, rare=True),
        "Also report objects that have disappeared, as rows whose change is removed.",
    ]
    any_frame: Annotated[
        bool, Option(OBJECTS, None, False, rare=True), "Accept a background that was recorded under another frame_id."
    ]
    station_distance: Annotated[
        float | None,
        Option(OBJECTS, WIDTH, shown="as it was built", rare=True),
        "How far a sweep may be from a viewpoint of the background.",
    ]
    station_angle: Annotated[
        float | None,
        Option(OBJECTS, TURN, shown="as it was built", rare=True),
        "How far a sweep may be turned away from that viewpoint.",
    ]


class Things(TypedDict, total=False):
    catalogue: Annotated[
        "AnyPath | Catalogue | None",
        Option(OBJECTS, File("FILE"), shown="none", python="Python also takes what `read_catalogue` returns.", rare=True),
        "Name the objects that are one of the things of this file (TOML, docs/catalogue.md).",
    ]


class Finding(Joining, Topics, Poses, Delay, Objects, Comparing, Things, Ranges, Jobs, total=False):
    """Keywords that `detect` and `track` share."""

    explain: Annotated[
        bool,
        Option(OUTPUT, None, False, rare=True),
        "Also fill the column why: what speaks for and against each object being a thing.",
    ]


_COLUMNS = "Columns to keep, comma separated, in this order."
_MEMORY = "Decide what is a thing, and its shape, by all sweeps that saw it, not by each sweep alone."


class Detecting(Finding, total=False):
    memory: Annotated[bool, Option(OBJECTS, None, False, both=True, rare=True), _MEMORY]


class Trajectories(TypedDict, total=False):
    trajectories: Annotated[
        bool,
        Option(OUTPUT, None, True, rare=True),
        "Make the table <log>.trajectories.parquet, one row per thing and sweep, hidden sweeps too.",
    ]


class Tracking(Finding, Trajectories, total=False):
    memory: Annotated[bool, Option(OBJECTS, None, True, both=True, rare=True), _MEMORY]
    agent_score: Annotated[
        float,
        Option(OBJECTS, Number("P", 0.0, 1.0), choices.AGENT_SCORE),
        "Least probability that what moves goes by itself: it is an agent.",
    ]
    apart: Annotated[
        bool,
        Option(OBJECTS, None, False, rare=True),
        "Follow each sensor by itself, also where the places of several on one robot are known.",
    ]


class Beams(TypedDict, total=False):
    beams: Annotated[bool, Option(OUTPUT, None, False), "Also write <log>.beams.parquet, one row per beam."]


class Tabling(Tracking, Beams, total=False):
    columns: Annotated[
        str | Iterable[str],
        Option(
            OUTPUT,
            Text("LIST", parse_names, is_list=True),
            (),
            shown="all",
            python="Each table keeps those that it has; 'brief': a few of each that tell what was where.",
        ),
        _COLUMNS,
    ]


class Learning(Reading, total=False):
    station_distance: Annotated[
        float,
        Option(STATIONS, WIDTH, default=choices.STATION_DISTANCE),
        "Sweeps up to this far from a viewpoint belong to it.",
    ]
    station_angle: Annotated[
        float,
        Option(STATIONS, TURN, default=choices.STATION_DEGREES),
        "Sweeps whose heading differs by no more than this belong to a viewpoint.",
    ]


class Mapping(Reading, total=False):
    resolution: Annotated[
        float, Option(GRID, Number("METRES", *choices.MAP_RESOLUTIONS), choices.MAP_RESOLUTION), "Side of a cell."
    ]
    min_move: Annotated[
        float,
        Option(GRID, LENGTH, choices.MIN_MOVE),
        "How far the sensor goes from one sweep that counts to the next; a turn by 10 degrees and 5 s count as well. "
        "0: every sweep counts.",
    ]
    min_hits: Annotated[
        int | None,
        Option(GRID, COUNT, shown="2; with --min-move 0: 4", rare=True),
        "Minimum hits for a cell to be occupied.",
    ]
    occupied_ratio: Annotated[
        float,
        Option(GRID, Number("SHARE", 0, 1), choices.OCCUPIED_RATIO, rare=True),
        "Minimum hit ratio: hits among the sweeps that hit or passed the cell.",
    ]
    free_no_return: Annotated[
        float,
        Option(GRID, LENGTH, 0.0, shown="0, they say nothing", rare=True),
        "Take beams without a return as free up to here. Glass and black things return nothing either.",
    ]
    without: Annotated[
        Literal["agents"] | None,
        Option(GRID, ("agents",), shown="nothing"),
        "Leave out agents: what moves, by following it as `lidarcli track` does.",
    ]
    max_size: Annotated[
        float,
        Option(GRID, Number("KM2", 0, above=True), choices.MAX_MAP_KM2, rare=True),
        "Refuse a larger map; at 5 cm a km² takes about 6 GB, as far as it is seen.",
    ]
    voxel: Annotated[
        float, Option(CLOUD, LENGTH, 0.0, shown="0, all points", rare=True), "Keep one point for each square of this side."
    ]


class _Zones(TypedDict, total=False):
    zones: Annotated[
        Paths,
        Option(ZONES, File("FILE"), (), required=True, several=True),
        "Zones to watch: TOML, or the YAML of Nav2's Collision Monitor (docs/zones.md); may be repeated.",
    ]
    objects: Annotated[
        AnyPath | None,
        Option(ZONES, File("TABLE"), shown="find and follow, as track does", unless=("no_objects",)),
        "Take the objects from <log>.objects.parquet of detect or track, with the tables beside it.",
    ]
    no_objects: Annotated[
        bool,
        Option(ZONES, None, False, unless=("objects",), rare=True),
        "Count beams alone: it is not known whose they are. Takes half the time.",
    ]
    footprint: Annotated[
        str | Sequence[Sequence[float]] | None,
        Option(
            ZONES,
            Text("POINTS", has_blanks=True),
            shown="what the log tells",
            python="Python also takes the points.",
            rare=True,
        ),
        "Shape '[[x, y], ...]' [m] of zones whose shape a topic tells that is not in the log.",
    ]


class Around(TypedDict, total=False):
    around: Annotated[
        float | str,
        Option(OUTPUT, TIME, choices.AROUND, shown="5s", rare=True),
        "Time before and after each part of --clips.",
    ]


class Zoning(_Zones, Joining, Topics, Poses, Delay, Objects, Comparing, Things, Ranges, Jobs, Around, total=False):
    """Keywords of `zones`."""

    clips: Annotated[
        AnyPath | None,
        Option(OUTPUT, File("DIR", is_output=True), shown="none"),
        "Folder for a part of the log around each event.",
    ]


class Diffing(Topics, Poses, Delay, Things, Ranges, Jobs, total=False):
    align: Annotated[
        Literal["auto", "as-is", "search"],
        Option(PLACES, choices.ALIGN, choices.ALIGN[0]),
        "How runs lie on each other: as-is, as their coordinates say; search, by what both saw; auto: as-is in "
        "one frame that is no odometry.",
    ]
    min_score: Annotated[
        float,
        Option(PLACES, Number("P", 0, 1), choices.MIN_SCORE),
        "Least probability of known, moved, new and gone; below it the status is uncertain.",
    ]


class Cleaning(_Topic, Window, Run, Poses, Delay, _Objects, Limits, Jobs, Around, total=False):
    remove: Annotated[
        str | Iterable[str],
        Option(CHANGES, Text("LIST", parse_removed, is_list=True), "agents"),
        "Beams that are to say nothing, comma separated: agents (what moves by itself, from then on), temporary "
        "(what stands where the place was also seen free); or none.",
    ]
    mend: Annotated[
        str | Iterable[str] | None,
        Option(CHANGES, Text("[LIST]", parse_mends, is_list=True), shown="none", alone=choices.FOUND),
        "Mend faults: found (those of info --deep), or, comma separated, beams, stamps, angles, times, order, units, "
        "limits, no-return, frames, statics, clock (docs/clean.md).",
    ]
    merge: Annotated[
        str | None,
        Option(CHANGES, Text("TOPIC"), shown="none", unless=("mend", "clips"), rare=True),
        "Also write the sensors of a robot as one LaserScan on this topic: the nearest return by bearing (docs/clean.md).",
    ]
    merge_frame: Annotated[
        str | None, Option(CHANGES, Text("FRAME"), shown="the robot itself", rare=True), "Frame of the merged sweeps."
    ]
    clips: Annotated[
        AnyPath | None,
        Option(OUTPUT, File("FILE.parquet"), shown="none", unless=("start", "end", "run")),
        "Write a log for each row of this table (events of zones, or any with stamps) into the folder of -o.",
    ]
    value: Annotated[
        str | float,
        Option(CHANGES, Text("nan|inf|above|METRES", parse_value), "nan", rare=True),
        "What they say instead: NaN, +inf, range_max + 1 (above), or a range (docs/clean.md).",
    ]
    margin: Annotated[
        int,
        Option(CHANGES, COUNT_OR_NONE, 1, rare=True),
        "Beams beside them that say the same, for those that hit an edge.",
    ]


class Inspecting(_Topic, Run, Joining, Poses, Delay, Ranges, total=False):
    deep: Annotated[
        bool,
        Option(FINDINGS, None, False),
        "Also find what takes a second reading: mounts, the robot itself, flicker (docs/info.md).",
    ]
    map: Annotated[
        AnyPath | None,
        Option(FINDINGS, File("FILE.yaml"), shown="none"),
        "Also find where the path of the sensor is off this map, or lost (docs/poses.md).",
    ]


class Plotting(Joining, Poses, Delay, Objects, Ranges, total=False):
    at: Annotated[
        float | str | None,
        Option(PICTURE, TIME, shown="none", unless=("sweep", "sweeps", "animate")),
        "Draw the sweep nearest to this time, given like --start: 10, 2min, 2026-11-22T10:00:00Z.",
    ]
    view: Annotated[
        Literal["all", "scene", "sweep"],
        Option(PICTURE, choices.VIEWS, choices.VIEWS[0]),
        "The scene from above, its curves r(theta) and s(theta) (sweep), or both (all).",
    ]
    topic: Annotated[str | None, Option(PICTURE, Text("NAME"), shown="the first by name"), "LaserScan topic to draw."]
    background: Annotated[
        AnyPath | None,
        Option(PICTURE, File("FILE"), shown="none"),
        "Compare with this background: also r_w, r_e, r_w - r_e (docs/background.md).",
    ]
    tracks: Annotated[
        Tables | None,
        Option(PICTURE, File("FILE"), shown="none", python="Python also takes what `track` returns."),
        "Draw paths, numbers and velocities of this tracks table.",
    ]
    trail: Annotated[
        float | None,
        Option(PICTURE, Number("SECONDS", 0), shown=f"{choices.TRAIL:g}", rare=True),
        "With --tracks: how far back the paths begin.",
    ]
    zones: Annotated[
        Paths,
        Option(PICTURE, File("FILE"), (), shown="none", several=True),
        "Draw the zones of this file (docs/zones.md), those that are occupied filled; may be repeated.",
    ]
    width: Annotated[
        float | None,
        Option(LOOK, Number("MM", *choices.PICTURE_WIDTHS), shown="by --view", rare=True),
        "Width of the picture: 89 is a column of a paper, 183 are two.",
    ]
    dpi: Annotated[
        int | None,
        Option(LOOK, Number("N", *choices.PICTURE_DPI, whole=True), shown="200", rare=True),
        "Pixels per inch of a .png.",
    ]
    title: Annotated[bool, Option(LOOK, None, True, rare=True), "Write a title above the picture."]
    legend: Annotated[bool, Option(LOOK, None, True, rare=True), "Explain the marks in a legend."]
    vertices: Annotated[bool, Option(LOOK, None, False, rare=True), "Mark vertices and nearest points in the scene, too."]


class Reporting(Joining, total=False):
    check: Annotated[
        str | Iterable[str], CHECK, "Condition that must hold, else the exit code is 1; may be repeated (docs/reports.md)."
    ]
    baseline: Annotated[
        Tables,
        Option(CHECKS, File("TABLE"), (), shown="none", several=True, python="Tables in memory are taken, too."),
        "Tables to compare with, may be repeated; checks may then name delta.FIGURE.",
    ]
    log: Annotated[
        Paths,
        Option(OUTPUT, INPUT, (), shown="the beams tables, where they are", several=True),
        "Log of the tables, may be repeated: HTML then shows its raw sweeps.",
    ]


class Overlaying(Joining, Jobs, Topics, Poses, Delay, Objects, Things, Ranges, total=False):
    objects: Annotated[
        AnyPath | None,
        Option(OUTPUT, File("TABLE"), shown="find and follow, as track does"),
        "Show the objects of <log>.objects.parquet of detect or track, with the tables beside it.",
    ]
    with_log: Annotated[
        bool, Option(OUTPUT, None, False), "Copy scans, transforms, odometry and poses into the same file (not .rrd)."
    ]
    map: Annotated[
        AnyPath | None,
        Option(OUTPUT, File("FILE.yaml"), shown="none"),
        "Show this map, too, in the world frame of the log.",
    ]
    zones: Annotated[
        Paths,
        Option(OUTPUT, File("FILE"), (), shown="none", several=True),
        "Show the zones of this file, too (docs/zones.md), brighter while occupied; may be repeated.",
    ]
    layout: Annotated[
        bool,
        Option(OUTPUT, None, True, both=True, rare=True),
        "Also write settings of viewers: NAME.layout.json and NAME.rviz (not for .rrd).",
    ]


class Simulating(TypedDict, total=False):
    container: Annotated[
        Literal["mcap", "bag", "ros2", "ros2-mcap", "db3", "csv"] | None,
        Option(LOG, choices.CONTAINERS, shown="by suffix"),
        "Format, where the name does not say it.",
    ]
    compression: Annotated[
        str | None,
        Option(LOG, Text("NAME"), shown="zstd for mcap, else none"),
        "none, lz4, zstd (mcap); none, bz2, lz4 (bag); none, zstd, zstd-message (ros2).",
    ]
    encoding: Annotated[
        Literal["cdr", "ros1"] | None,
        Option(LOG, ("cdr", "ros1"), shown="cdr"),
        "Messages of an mcap: of ROS 2 or of ROS 1.",
    ]
    layout: Annotated[
        Literal["rostopic", "wide"] | None,
        Option(LOG, ("rostopic", "wide"), shown="rostopic"),
        "Layout of a csv: as rostopic echo -p writes it, or times and ranges alone.",
    ]
    clouds: Annotated[
        bool,
        Option(LOG, None, False),
        "Write point clouds with a floor and a ceiling instead of LaserScan, to be read by --slice.",
    ]
    map: Annotated[
        AnyPath | None,
        Option(LOG, File("FILE.yaml", is_output=True), shown="none"),
        "Also write the true map of the run, without noise and without what moves, in map_server format (.yaml + .pgm), "
        "for diff TRUTH.yaml MAP.yaml.",
    ]
    map_resolution: Annotated[
        float | None,
        Option(LOG, Number("METRES", *choices.MAP_RESOLUTIONS), shown=f"{choices.MAP_RESOLUTION:g}"),
        "Side of the cells of that map.",
    ]
    sweeps: Annotated[int | None, Option(RUN, ANY_COUNT, shown="from the scene", unless=("duration",)), "Number of sweeps."]
    duration: Annotated[
        float | None,
        Option(RUN, Number("SECONDS", 0, math.inf), shown="from the scene", unless=("sweeps",)),
        "Length of the run, instead of --sweeps.",
    ]
    seed: Annotated[int, Option(RUN, ANY_COUNT, 0), "Seed of noise and lost beams; the same seed gives the same bytes."]


class Exporting(TypedDict, total=False):
    columns: Annotated[
        str | Iterable[str], Option(OUTPUT, Text("LIST", parse_names, is_list=True), (), shown="all"), _COLUMNS
    ]
    stamps: Annotated[Literal["ns", "us"] | None, Option(OUTPUT, choices.STAMPS, shown="as they are"), _STAMPS]
    only: Annotated[
        int | str | Iterable[int],
        Option(OUTPUT, Text("LIST", parse_numbers, is_list=True), (), shown="all"),
        "Rows of these tracks alone, 4,6; of one track of a trajectories table a .tum can be written, for evo.",
    ]


# Combinations of options that have no meaning.

_FOUND = "is for finding objects, and --objects names some that have been found"
RULES = (
    Rule(("removed", "any_frame", "station_distance", "station_angle"), ("background",), "is for --background FILE", True),
    Rule(("jobs",), ("cluster",), "is for this machine, --cluster for others"),
    Rule(("dry_run",), ("format=json",), "prints a plan and no summary: leave out --format json"),
)
"""For whatever has these options."""
OVERLAY_RULES = (Rule((SELECT, POSES, OBJECTS, RANGES), ("objects",), _FOUND),)
ZONE_RULES = (
    Rule((OBJECTS,), ("objects",), _FOUND),
    Rule((OBJECTS,), ("no_objects",), "is for finding objects, and --no-objects finds none"),
)
PLOT_RULES = (
    Rule(("start", "end"), ("animate",), "is for --animate without --sweep and --sweeps", True),
    Rule(("start", "end"), ("sweep", "sweeps"), "is for --animate without --sweep and --sweeps"),
    Rule((POSES,), ("view=map", "background", "zones"), "is for --view map, --background and --zones", True),
    Rule(("animate", "background"), ("view=map",), "is not for --view map, which is a picture of its own"),
    Rule(("trail",), ("tracks",), "is for the paths of --tracks in the scene", True),
    Rule(("trail",), ("view=map",), "is for the paths of --tracks in the scene"),
    Rule(("tracks",), ("view=all|scene|map",), "is drawn in the scene; give --view all, scene or map", True),
    Rule(("zones",), ("view=all|scene",), "is drawn in the scene; give --view all or scene", True),
    Rule(("only", "density"), ("tracks",), "is for --view map --tracks TABLE", True),
    Rule(("only", "density"), ("view=map",), "is for --view map --tracks TABLE", True),
    Rule(("fps",), ("animate",), "is for --animate", True),
    Rule(("vertices",), ("view=all|scene",), "is for the scene; give --view all or scene", True),
)
