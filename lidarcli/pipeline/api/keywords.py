"""The keywords of the Python functions: each with its type, its default and what it means, written once.

Names, units and defaults are those of the options of the command line; a flag `--no-deskew` is `deskew=False`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from os import PathLike
from typing import Annotated, Any, Literal, NamedTuple, TypedDict, get_args, get_type_hints

from lidarcli.choices import (
    BINS,
    ECHOES,
    GREATEST_COUNT,
    GREATEST_NUMBER,
    MAP_RESOLUTION,
    MAP_RESOLUTIONS,
    MAX_MAP_KM2,
    MIN_MOVE,
    OCCUPIED_RATIO,
    PICTURE_DPI,
    PICTURE_WIDTHS,
    SIGNIFICANCE,
    STATION_DEGREES,
    STATION_DISTANCE,
)
from lidarcli.formalism.background.model import Background
from lidarcli.formalism.matching.catalogue import Catalogue
from lidarcli.formalism.parameters import Profile

AnyPath = str | PathLike[str]
Paths = AnyPath | Iterable[AnyPath]
"""One file, folder, pattern or URL, or several."""
View = Literal["all", "scene", "sweep", "difference", "polar"]


class Limits(NamedTuple):
    """What a number has to be, as the option of the command line has it."""

    least: float = 0.0
    most: float = GREATEST_NUMBER
    above: bool = False
    """Whether `least` itself is too little."""
    whole: bool = False


LENGTH, SOME, COUNT = Limits(), Limits(above=True), Limits(1, GREATEST_COUNT, whole=True)


class Keyword(NamedTuple):
    """What stands beside the type of a keyword."""

    meaning: str
    default: Any = None
    limits: Limits | None = None
    """Of a number that the room which takes it does not judge."""


def keywords_of(group: type) -> dict[str, tuple[Any, Keyword]]:
    """The keywords of a group, each with its type and what stands beside it."""
    hints = get_type_hints(group, include_extras=True)
    return {name: get_args(hint)[:2] for name, hint in hints.items()}


def defaults_of(group: type) -> dict[str, Any]:
    """What every keyword of a group is where nobody says it."""
    return {name: keyword.default for name, (_, keyword) in keywords_of(group).items()}


class Topics(TypedDict, total=False):
    """Which sweeps of a log to read."""

    topic: Annotated[
        str | Iterable[str] | None,
        Keyword("LaserScan topic to read, or a pattern such as `/scan*`, or several; by default all of them"),
    ]
    start: Annotated[
        float | str | None,
        Keyword("begin at this time: seconds after the first sweep, `2min`, or `2026-11-22T10:00:00Z`"),
    ]
    end: Annotated[float | str | None, Keyword("end before this time, given like `start`")]
    every: Annotated[int, Keyword("take every n-th sweep", 1)]


class Poses(TypedDict, total=False):
    """Where the poses of a log come from."""

    pose: Annotated[
        str | None,
        Keyword(
            "topic that tells where the sensor was; `none` for no poses, `match` to find its path from the sweeps; by "
            "default the best there is"
        ),
    ]
    poses: Annotated[
        AnyPath | None, Keyword("path of the sensor from a file (TUM), instead of what the log tells")
    ]
    deskew: Annotated[
        bool, Keyword("see each beam from where the sensor was at its own time, where that is known", True)
    ]


class Delay(TypedDict, total=False):
    """How late the poses are."""

    pose_delay: Annotated[
        float | None,
        Keyword(
            "take the pose of a sweep this much after its header stamp [s]; by default 0, for tracks and maps what fits "
            "best"
        ),
    ]


class Ranges(TypedDict, total=False):
    """What is a range, and where a log lacks the geometry of its beams."""

    range: Annotated[
        tuple[float, float] | None, Keyword("least and greatest range [m], instead of those of the log")
    ]
    no_return: Annotated[
        str | Iterable[str | float],
        Keyword(
            "what a driver writes for 'no return': inf, zero, max, above, pile, nan, negative, below, or metres such as "
            "81.91; as a list or separated by commas",
            "inf,zero,max,above,pile",
        ),
    ]
    angle_min: Annotated[
        float | None, Keyword("bearing of the first beam of a text log [rad, or degrees with `degrees`]")
    ]
    angle_increment: Annotated[
        float | None, Keyword("angle from beam to beam of a text log [rad, or degrees with `degrees`]")
    ]
    fov: Annotated[
        float | None,
        Keyword("field of view of a text log instead of `angle_increment` [rad, or degrees with `degrees`]"),
    ]
    range_max: Annotated[float | None, Keyword("greatest range of the sensor of a text log [m]")]
    degrees: Annotated[
        bool, Keyword("the three angles above are in degrees; without, they are radians", False)
    ]
    range_unit: Annotated[Literal["m", "cm", "mm"], Keyword("unit of the ranges in the log", "m")]
    slice: Annotated[
        tuple[float, float] | None,
        Keyword(
            "read point clouds as sweeps: of the points between these heights above the robot's base [m] the nearest "
            "in each direction"
        ),
    ]
    bins: Annotated[
        int | None,
        Keyword(f"beams of such a sweep, {BINS}; a full turn, or `angle_min` and `fov`", None, COUNT),
    ]
    echo: Annotated[
        Literal["first", "last", "strongest"],
        Keyword("which echo to take of each beam of a MultiEchoLaserScan", ECHOES[0]),
    ]


class Reading(Topics, Poses, Delay, Ranges, total=False):
    """How a log is read."""


class Objects(TypedDict, total=False):
    """What an object is; None stands for the default of the profile."""

    profile: Annotated[
        Profile, Keyword("`robust`: estimates for real sensors; `paper`: the published formulas", "robust")
    ]
    threshold: Annotated[
        Literal["adaptive", "mean"] | float | None,
        Keyword(
            "discontinuity: `adaptive` (noise and range), `mean` (Def. 3) or fixed [m]; adaptive, paper: mean"
        ),
    ]
    min_beams: Annotated[int | None, Keyword("least valid beams of an object; 3, paper: 1")]
    max_width: Annotated[
        float | None, Keyword("what is wider is background [m]; 2, paper or with a background: no limit")
    ]
    max_gap: Annotated[int | None, Keyword("lost beams bridged inside one surface; 2, paper: 0")]
    group_gap: Annotated[float | None, Keyword("slim objects closer than this are one [m]; 0: never")]
    min_thing: Annotated[
        float | None, Keyword("what is less likely a thing, and not a piece of building, is wall; 0.3")
    ]
    walls: Annotated[bool, Keyword("also rows for walls (set S), with the corners of the room", False)]


class Comparing(TypedDict, total=False):
    """The background that sweeps are compared with."""

    background: Annotated[
        AnyPath | Sequence[Background] | None,
        Keyword("only what differs from it is an object: a background table, or what `learn` returns"),
    ]
    removed: Annotated[bool, Keyword("also what has gone, as rows of change `removed`", False)]
    any_frame: Annotated[bool, Keyword("take the background for a sensor of another name, too", False)]
    station_distance: Annotated[
        float | None,
        Keyword("how far a sweep may be from a station of it [m]; by default as it was built", None, SOME),
    ]
    station_angle: Annotated[
        float | None,
        Keyword("how far it may be turned away from it [degrees]; by default as it was built", None, SOME),
    ]


class Finding(Reading, Objects, Comparing, total=False):
    """What `detect` and `track` share."""

    catalogue: Annotated[
        AnyPath | Catalogue | None,
        Keyword(
            "things of interest, which objects are named by: a file, or what `read_catalogue` makes of it"
        ),
    ]
    explain: Annotated[
        bool, Keyword("also fill the column `why`: what speaks for and against each object", False)
    ]
    jobs: Annotated[int | None, Keyword("processors to use at most; by default as many as pay", None, COUNT)]


_MEMORY = "decide what is a thing, and its shape, by all sweeps that saw it, not anew in each"


class Detecting(Finding, total=False):
    """Keywords of `detect`."""

    memory: Annotated[bool, Keyword(_MEMORY, False)]


class Tracking(Finding, total=False):
    """Keywords of `track`."""

    memory: Annotated[bool, Keyword(_MEMORY, True)]
    significance: Annotated[
        float,
        Keyword(
            "share of the standing things that may pass for moving by chance, 1e-12 to 0.1", SIGNIFICANCE
        ),
    ]


class Tabling(Tracking, total=False):
    """Keywords of `tables`."""

    beams: Annotated[bool, Keyword("also the table of beams, one row for each of every sweep", False)]


class Learning(Reading, total=False):
    """Keywords of `learn`."""

    station_distance: Annotated[
        float, Keyword("sweeps up to this far from a station belong to it [m]", STATION_DISTANCE, SOME)
    ]
    station_angle: Annotated[
        float, Keyword("if their heading differs by no more than this [degrees]", STATION_DEGREES, SOME)
    ]


class Mapping(Reading, total=False):
    """Keywords of `map`."""

    resolution: Annotated[float, Keyword("side of a cell [m]", MAP_RESOLUTION, Limits(*MAP_RESOLUTIONS))]
    min_move: Annotated[
        float,
        Keyword(
            "how far the sensor goes from one sweep that counts to the next [m]; 0: every one",
            MIN_MOVE,
            LENGTH,
        ),
    ]
    min_hits: Annotated[
        int | None, Keyword("sweeps that have to hit an occupied cell; 2, with `min_move=0`: 4", None, COUNT)
    ]
    occupied_ratio: Annotated[
        float,
        Keyword("and more than this share of the sweeps that hit or passed it", OCCUPIED_RATIO, Limits(0, 1)),
    ]
    free_no_return: Annotated[float, Keyword("beams without a return are free up to here [m]", 0.0, LENGTH)]
    voxel: Annotated[
        float, Keyword("clouds have one point in each square of this side [m]; 0: all", 0.0, LENGTH)
    ]
    without_agents: Annotated[bool, Keyword("leave out what moves", False)]
    max_size: Annotated[float, Keyword("largest ground of a map [km²]", MAX_MAP_KM2, SOME)]
    path: Annotated[bool, Keyword("draw the path of the sensor into a picture", False)]


class Inspecting(Poses, Ranges, total=False):
    """Keywords of `info`."""


class Plotting(Poses, Delay, Ranges, Objects, total=False):
    """Keywords of `plot`."""

    view: Annotated[
        View, Keyword("scene from above, r(θ) with s(θ), the difference, polar, or scene and curves", "all")
    ]
    at: Annotated[
        float | str | None,
        Keyword(
            "draw the sweep nearest to this time, in seconds after the first or by date, instead of `sweep`"
        ),
    ]
    topic: Annotated[str | None, Keyword("LaserScan topic to draw; by default the first by name")]
    background: Annotated[AnyPath | None, Keyword("background table to compare with: also r_w, r_e")]
    tracks: Annotated[AnyPath | None, Keyword("table of `track`: paths up to the sweep, numbers, velocities")]
    width: Annotated[
        float | None,
        Keyword(
            "width of the whole picture [mm]; by default that of its view", None, Limits(*PICTURE_WIDTHS)
        ),
    ]
    dpi: Annotated[
        int | None, Keyword("pixels per inch of a .png; 200", None, Limits(*PICTURE_DPI, whole=True))
    ]
    title: Annotated[bool, Keyword("write what it is above the picture", True)]
    legend: Annotated[bool, Keyword("explain the marks below the picture", True)]
    vertices: Annotated[bool, Keyword("mark vertices and nearest points in the scene, too", False)]


class Reporting(TypedDict, total=False):
    """Keywords of `report`."""

    check: Annotated[
        str | Iterable[str], Keyword("conditions that the tables have to hold (docs/reports.md)", ())
    ]
    baseline: Annotated[Paths, Keyword("tables to compare with; checks may then name delta.FIGURE", ())]
    log: Annotated[Paths, Keyword("logs of the tables, whose raw sweeps the HTML then shows", ())]
