"""Every option, declared once: the groups of single commands, made of those in the modules beside this one.

The command line, the keywords of the Python functions, `lidarcli.toml`, the variables of the environment, docs/cli.md and
docs/python.md are made from these declarations. A group is a `TypedDict`: type checkers read the types of the keywords from
it, and each field carries an `Option` beside its type. Options of one command alone stand in the file of that command.
Nothing here imports click or numpy, so that `--help` answers soon.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Annotated, Literal, TypedDict

from lidarcli.options import choices
from lidarcli.options.common import CHECK, STAMPS_HELP, Checked, Jobs
from lidarcli.options.forms import File, Number, Option, OptionRule, Text
from lidarcli.options.objects import COLUMNS_HELP, OBJECTS, Comparing, ObjectGroup, ObjectParameters, Things
from lidarcli.options.reading import (
    POSES,
    RANGES,
    SELECT,
    ClockGroup,
    Delay,
    Joining,
    LimitsGroup,
    PoseGroup,
    Ranges,
    ReadingGroup,
    RunGroup,
    Selecting,
    TopicGroup,
    Topics,
    WindowGroup,
)
from lidarcli.options.values import (
    CHECKS,
    COUNT,
    COUNT_OR_NONE,
    INPUT,
    LENGTH,
    OUTPUT,
    SWEEP,
    TIME,
    TURN,
    WIDTH,
    AnyPath,
    Paths,
    Tables,
    parse_every,
    parse_explained,
    parse_mends,
    parse_names,
    parse_numbers,
    parse_removed,
    parse_sweeps,
    parse_value,
)

STATIONS = "Viewpoints (stations) of a moving sensor"
GRID, CLOUD = "Occupancy grid", "Point cloud"
PICTURE, LOOK, ZONES, FINDINGS = "Picture", "Look", "Zones", "Findings"
PLACES, CHANGES = "Places", "What to change"
RUN, LOG = "Run", "Log"
ANY_COUNT = Number("N", 0, math.inf, whole=True)


class LearningGroup(ReadingGroup, total=False):
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


class MappingGroup(ReadingGroup, total=False):
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
        Option(ZONES, File("TABLE"), shown="find and follow", unless=("no_objects",)),
        "Take objects from <log>.objects.parquet of detect or track.",
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
    stops: Annotated[bool, Option(ZONES, None, False), "Also tell when the robot stood after a drive, and what was ahead."]


class Around(TypedDict, total=False):
    around: Annotated[
        float | str,
        Option(OUTPUT, TIME, choices.AROUND, shown="5s", rare=True),
        "Time before and after each part of --clips.",
    ]


class Zoning(
    _Zones, Joining, Selecting, PoseGroup, Delay, ObjectGroup, Comparing, Things, Ranges, Jobs, Around, total=False
):
    """Keywords of `zones`."""

    explain: Annotated[
        float | str | None,
        Option(ZONES, Text("TIME|worst", parse_explained), shown="none"),
        "Answer why the robot stopped then: -o why.html, .png or .gif; worst: the five worst.",
    ]
    every: Annotated[
        int | str,
        Option(SELECT, Text("N|TIME", parse_every), 1),
        "Count who crosses lines by this time (1min, 1h); of a whole number: take every N-th sweep.",
    ]

    clips: Annotated[
        AnyPath | None,
        Option(OUTPUT, File("DIR", is_output=True), shown="none"),
        "Folder for a part of the log around each event.",
    ]


class Diffing(Topics, PoseGroup, Delay, Things, Ranges, Jobs, total=False):
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


class Cleaning(
    TopicGroup, WindowGroup, RunGroup, PoseGroup, Delay, ObjectParameters, LimitsGroup, Jobs, Around, total=False
):
    remove: Annotated[
        str | Iterable[str] | None,
        Option(CHANGES, Text("LIST", parse_removed, is_list=True), shown="agents; with --mend, --merge or a part none"),
        "Beams that are to say nothing, comma separated: agents (what moves by itself, from then on), temporary "
        "(what stands where the place was also seen free); or none.",
    ]
    mend: Annotated[
        str | Iterable[str] | None,
        Option(CHANGES, Text("[LIST]", parse_mends, is_list=True), shown="none", alone=choices.FOUND),
        "Mend faults: found (those of info --deep), or, comma separated, beams, stamps, angles, times, order, intensities, "
        "units, limits, no-return, frames, statics, clock (docs/clean.md).",
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


class Inspecting(TopicGroup, ClockGroup, RunGroup, Joining, PoseGroup, Delay, Ranges, total=False):
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


class SweepGroup(TypedDict, total=False):
    sweep: Annotated[int | None, Option(PICTURE, SWEEP, shown="0", unless=("sweeps", "at")), "Sweep to draw."]


class Plotting(WindowGroup, Joining, PoseGroup, Delay, ObjectGroup, Ranges, total=False):
    """Options of `plot` but the sweep, which Python also takes by its place."""

    sweeps: Annotated[
        str | Iterable[int] | None,
        Option(PICTURE, Text("LIST", parse_sweeps), shown="with --animate all", unless=("sweep", "at")),
        "Sweeps to draw, 0,50,100 or 0:100:10; each gets a file, FIG-N.png.",
    ]
    animate: Annotated[
        bool, Option(PICTURE, None, False), "One moving picture of --sweeps, or of those from --start to --end."
    ]
    at: Annotated[
        float | str | None,
        Option(PICTURE, TIME, shown="none", unless=("sweep", "sweeps", "animate")),
        "Draw the sweep nearest to this time, like --start: 2min, 14:02:17.",
    ]
    view: Annotated[
        Literal["all", "scene", "sweep", "map"],
        Option(PICTURE, (*choices.VIEWS, choices.MAP), choices.VIEWS[0]),
        "The scene from above, its curves r(theta) and s(theta) (sweep), or both (all). map: the run in the world and the "
        "path of the sensor, with --sweep its points, with --tracks what stands and moved.",
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
        "Draw paths, numbers and velocities of this tracks table. Given LOG itself, its things are followed first.",
    ]
    only: Annotated[
        str | int | Iterable[int],
        Option(PICTURE, Text("LIST", parse_numbers), (), shown="all"),
        "With --view map --tracks: numbers of the tracks to draw, 4,6,10.",
    ]
    density: Annotated[
        bool, Option(PICTURE, None, False), "With --view map --tracks: how long agents were where, in place of their paths."
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
    follow: Annotated[
        str | int | None, Option(PICTURE, Text("TRACK|ZONE"), shown="none"), "Track or zone in the middle of the scene."
    ]
    width: Annotated[
        float | None,
        Option(LOOK, Number("MM", *choices.PICTURE_WIDTHS), shown="by --view", rare=True),
        "Width of the picture: 89 is a column of a paper, 183 are two.",
    ]
    dpi: Annotated[
        int | None,
        Option(LOOK, Number("N", *choices.PICTURE_DPI, whole=True), shown=f"200; moving {choices.ANIMATED_DPI}", rare=True),
        "Pixels per inch of PNG and of animations.",
    ]
    fps: Annotated[
        float | None,
        Option(LOOK, Number("NUMBER", 0.1, choices.MAX_FRAMES), shown=f"{choices.FRAMES_PER_SECOND:g}", rare=True),
        "Sweeps per second of --animate.",
    ]
    title: Annotated[bool, Option(LOOK, None, True, rare=True), "Write a title above the picture."]
    legend: Annotated[bool, Option(LOOK, None, True, rare=True), "Explain the marks in a legend."]
    vertices: Annotated[bool, Option(LOOK, None, False, rare=True), "Mark vertices and nearest points in the scene, too."]


class Reporting(ClockGroup, Joining, Checked, total=False):
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


class Overlaying(Joining, Jobs, Topics, PoseGroup, Delay, ObjectGroup, Things, Ranges, total=False):
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
        str | Iterable[str], Option(OUTPUT, Text("LIST", parse_names, is_list=True), (), shown="all"), COLUMNS_HELP
    ]
    stamps: Annotated[Literal["ns", "us"] | None, Option(OUTPUT, choices.STAMPS, shown="as they are"), STAMPS_HELP]
    only: Annotated[
        int | str | Iterable[int],
        Option(OUTPUT, Text("LIST", parse_numbers, is_list=True), (), shown="all"),
        "Rows of these tracks alone, 4,6; of one track of a trajectories table a .tum can be written, for evo.",
    ]


# Combinations of options that have no meaning.

_FOUND = "is for finding objects, and --objects names some that have been found"
OVERLAY_RULES = (OptionRule((SELECT, POSES, OBJECTS, RANGES), ("objects",), _FOUND),)
ZONE_RULES = (
    OptionRule((OBJECTS,), ("objects",), _FOUND),
    OptionRule((OBJECTS,), ("no_objects",), "is for finding objects, and --no-objects finds none"),
)
PLOT_RULES = (
    OptionRule(("start", "end"), ("animate",), "is for --animate without --sweep and --sweeps", True),
    OptionRule(("start", "end"), ("sweep", "sweeps"), "is for --animate without --sweep and --sweeps"),
    OptionRule((POSES,), ("view=map", "background", "zones"), "is for --view map, --background and --zones", True),
    OptionRule(("animate", "background"), ("view=map",), "is not for --view map, which is a picture of its own"),
    OptionRule(("trail",), ("tracks",), "is for the paths of --tracks in the scene", True),
    OptionRule(("trail",), ("view=map",), "is for the paths of --tracks in the scene"),
    OptionRule(("tracks",), ("view=all|scene|map",), "is drawn in the scene; give --view all, scene or map", True),
    OptionRule(("zones",), ("view=all|scene",), "is drawn in the scene; give --view all or scene", True),
    OptionRule(("follow",), ("tracks", "zones"), "keeps a track of --tracks or a zone of --zones in the middle", True),
    OptionRule(("follow",), ("view=all|scene",), "is for the scene; give --view all or scene", True),
    OptionRule(("only", "density"), ("tracks",), "is for --view map --tracks TABLE", True),
    OptionRule(("only", "density"), ("view=map",), "is for --view map --tracks TABLE", True),
    OptionRule(("fps",), ("animate",), "is for --animate", True),
    OptionRule(("vertices",), ("view=all|scene",), "is for the scene; give --view all or scene", True),
)
