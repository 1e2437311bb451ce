"""Values of options: their types for Python, their limits, and how texts are parsed; headings of the help."""

import math
from collections.abc import Iterable
from os import PathLike
from typing import Any, Protocol

from lidarcli.errors import OptionError
from lidarcli.options import choices
from lidarcli.options.forms import File, Number, Text

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
    """A table of changes with all else that `diff` returns."""

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


def parse_time_text(text: str) -> Any:
    """Seconds after the first sweep, or an `Instant`."""
    from lidarcli.options.times import parse_time

    found = parse_time(text)
    if isinstance(found, float) and found < 0:
        raise OptionError(f"{text} is below 0")
    return found


def parse_no_return_words(text: str) -> str:
    """The list as it is, once its items are known to be words and ranges."""
    from lidarcli.sweeps.range_rules import parse_no_return

    parse_no_return(text)
    return text


def parse_threshold(text: str) -> str | float:
    """`adaptive`, `mean` or metres."""
    if text in ("adaptive", "mean"):
        return text
    try:
        float(text)
    except ValueError:
        raise OptionError(f"'{text}' is neither adaptive nor mean nor a number of metres") from None
    return WIDTH.parse(text)


def parse_removed(text: str) -> str:
    """The list as it is, once its items are known; `none` excludes all others."""
    for word in text.split(",") if text.strip() != "none" else ():
        if word.strip() == "body":
            raise OptionError("the robot's own body is what --mask FILE tells")
        if word.strip() not in choices.REMOVABLE:
            raise OptionError(f"'{word.strip()}' is not one of {', '.join(choices.REMOVABLE)}")
    return text


def parse_mends(text: str) -> str:
    """The list as it is, once its items are known."""
    known = (choices.FOUND, *choices.MENDS)
    if unknown := [word.strip() for word in text.split(",") if word.strip() not in known]:
        raise OptionError(f"'{unknown[0]}' is not one of {', '.join(known)}")
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


def parse_shard(text: str) -> tuple[int, int]:
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
TIME = Text("TIME", parse_time_text)
INPUT = File("LOG")
