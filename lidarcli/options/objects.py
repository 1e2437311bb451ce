"""Options for finding objects and following them."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Annotated, Literal, TypedDict

from lidarcli.options import choices
from lidarcli.options.common import Jobs
from lidarcli.options.forms import File, Number, Option, Text
from lidarcli.options.reading import Delay, Joining, PoseGroup, Ranges, Topics
from lidarcli.options.values import COUNT, COUNT_OR_NONE, LENGTH, OUTPUT, TURN, WIDTH, AnyPath, metres, parse_names

if TYPE_CHECKING:
    from lidarcli.formalism.background import Background
    from lidarcli.formalism.matching.catalogue import Catalogue


OBJECTS = "Objects"


def parse_threshold(text: str) -> str | float:
    """`adaptive`, `mean` or metres."""
    return text if text in ("adaptive", "mean") else metres(text, "neither adaptive nor mean", WIDTH)


class ObjectParameters(TypedDict, total=False):
    """Parameters of the objects; None stands for the default of the profile."""

    profile: Annotated[
        Literal["robust", "paper"],
        Option(OBJECTS, choices.PROFILES, choices.PROFILES[0], rare=True),
        "robust: tuned for real sensors; paper: the published formulas, unchanged.",
    ]
    threshold: Annotated[
        Literal["adaptive", "mean"] | float | None,
        Option(OBJECTS, Text("adaptive|mean|METRES", parse_threshold), shown="adaptive; paper: mean", rare=True),
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


class ObjectGroup(ObjectParameters, total=False):
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


class FindingGroup(Joining, Topics, PoseGroup, Delay, ObjectGroup, Comparing, Things, Ranges, Jobs, total=False):
    """Keywords that `detect` and `track` share."""

    explain: Annotated[
        bool,
        Option(OUTPUT, None, False, rare=True),
        "Also fill the column why: what speaks for and against each object being a thing.",
    ]


COLUMNS_HELP = "Columns to keep, comma separated, in this order."
_MEMORY = "Decide what is a thing, and its shape, by all sweeps that saw it, not by each sweep alone."


class BeamGroup(TypedDict, total=False):
    beams: Annotated[bool, Option(OUTPUT, None, False), "Also make the table <log>.beams.parquet, one row per beam."]


class Detecting(FindingGroup, BeamGroup, total=False):
    memory: Annotated[bool, Option(OBJECTS, None, False, both=True, rare=True), _MEMORY]


class TrajectoryGroup(TypedDict, total=False):
    trajectories: Annotated[
        bool,
        Option(OUTPUT, None, True, rare=True),
        "Make the table <log>.trajectories.parquet, one row per thing and sweep, hidden sweeps too.",
    ]


class Tracking(FindingGroup, TrajectoryGroup, BeamGroup, total=False):
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


class Tabling(Tracking, total=False):
    columns: Annotated[
        str | Iterable[str],
        Option(
            OUTPUT,
            Text("LIST", parse_names, is_list=True),
            (),
            shown="all",
            python="Each table keeps those that it has; 'brief': a few of each that tell what was where.",
        ),
        COLUMNS_HELP,
    ]
