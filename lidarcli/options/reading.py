"""Options for reading logs: which sweeps, where the sensor was, and what ranges mean."""

import math
from collections.abc import Iterable
from typing import Annotated, Literal, TypedDict

from lidarcli.errors import OptionError
from lidarcli.options import choices
from lidarcli.options.forms import File, Number, Option, Text
from lidarcli.options.values import COUNT, MANY, TIME, TIME_ZONE, WIDTH, AnyPath

SELECT, POSES = "Sweeps to read", "Where the sensor was"
RANGES, GEOMETRY = "Beams", "Text logs without names or geometry"
POINT_CLOUDS = "Point clouds"
ANGLE = Number("ANGLE")


def parse_no_return(text: str) -> tuple[frozenset[str], tuple[float, ...]]:
    """Split a `--no-return` list (`zero,max,81.91`) into its words and its markers [m].

    >>> parse_no_return("zero,81.91")
    (frozenset({'zero'}), (81.91,))
    """
    words, markers = set(), []
    for item in filter(None, (part.strip().lower() for part in text.split(","))):
        if item in choices.NO_RETURN_WORDS:
            words.add(item)
            continue
        try:
            marker = float(item)
        except ValueError:
            raise OptionError(
                f"--no-return: '{item}' is neither a number nor one of {', '.join(choices.NO_RETURN_WORDS)}"
            ) from None
        if not abs(marker) <= choices.MAX_NUMBER:
            raise OptionError(f"--no-return: {marker:g} is no range")
        markers.append(marker)
    return frozenset(words), tuple(markers)


def parse_no_return_words(text: str) -> str:
    """The list as it is, once its items are known to be words and ranges."""
    parse_no_return(text)
    return text


class ClockGroup(TypedDict, total=False):
    time_zone: Annotated[str, Option(SELECT, TIME_ZONE, "UTC", rare=True), "For times: Europe/Berlin, +02:00 or local."]


class WindowGroup(ClockGroup, total=False):
    """The time from which and up to which to read."""

    start: Annotated[
        float | str | None,
        Option(SELECT, TIME, shown="0"),
        "Start at this time: seconds after the first sweep (10, 2min), 14:02:17 (--time-zone), or 2026-11-22T10:00:00Z.",
    ]
    end: Annotated[float | str | None, Option(SELECT, TIME, shown="the end"), "End before this time, like --start."]


class RunGroup(TypedDict, total=False):
    run: Annotated[
        int | None,
        Option(SELECT, COUNT, shown="all", rare=True),
        "Run to read, counted from 1, of a log whose clock starts anew (docs/poses.md).",
    ]


class TopicGroup(TypedDict, total=False):
    topic: Annotated[
        str | Iterable[str] | None,
        Option(SELECT, Text("NAME"), shown="all", several=True),
        "LaserScan topic to read, or a pattern, '/scan*'; may be repeated.",
    ]


class Selecting(TopicGroup, WindowGroup, RunGroup, total=False):
    """The part of a log to read."""


class Topics(Selecting, total=False):
    """The sweeps of a log to read."""

    every: Annotated[int, Option(SELECT, COUNT, 1), "Take every N-th sweep."]


class PoseGroup(TypedDict, total=False):
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


class LimitsGroup(TypedDict, total=False):
    range: Annotated[
        tuple[float, float] | None,
        Option(RANGES, Number("MIN MAX", 0, count=2), shown="those of the log"),
        "Range limits [m].",
    ]
    no_return: Annotated[
        str | Iterable[str | float],
        Option(RANGES, Text("LIST", parse_no_return_words, is_list=True), "inf,zero,max,above,pile", rare=True),
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


class Ranges(LimitsGroup, total=False):
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
        Option(POINT_CLOUDS, Number("ZMIN ZMAX", count=2), shown="clouds are not read", rare=True),
        "Read point clouds as sweeps: of the points between these heights [m] the nearest in each direction. "
        "Heights count from the robot's base, level by tf.",
    ]
    bins: Annotated[
        int | None,
        Option(POINT_CLOUDS, Number("N", -math.inf, math.inf, whole=True), shown=str(choices.BINS), rare=True),
        "Beams of a sweep that is made of a point cloud; their view is a full turn, or that of --angle-min and --fov.",
    ]


class Joining(TypedDict, total=False):
    join: Annotated[
        bool,
        Option(MANY, None, False, rare=True),
        "Read the parts of a recording (run_0.bag, run_1.bag) as one log, in the order of their times; of a "
        "folder those of each name.",
    ]


class ReadingGroup(Joining, Topics, PoseGroup, Delay, Ranges, total=False):
    """Options for reading a log."""
