"""Values of options: their types for Python, their limits, and how texts are parsed; headings of the help."""

from collections.abc import Iterable
from os import PathLike
from typing import TYPE_CHECKING, Any, Protocol

from lidarcli.errors import OptionError
from lidarcli.options import choices
from lidarcli.options.forms import File, Number, Text

if TYPE_CHECKING:
    from datetime import timedelta

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
CHECKS = "Checks"


def parse_time_text(text: str) -> str:
    """The text as it is, once it is known to be a time; what it means depends on the time zone."""
    from lidarcli.options.times import parse_time

    found = parse_time(text)
    if isinstance(found, float) and found < 0:
        raise OptionError(f"{text} is below 0")
    return text


def parse_zone_text(text: str) -> str:
    """The text as it is, once it is known to be a time zone."""
    from lidarcli.options.times import parse_zone

    parse_zone(text)
    return text


def parse_explained(text: str) -> Any:
    """A time as of `parse_time_text`, or the word `worst`."""
    return text if text == "worst" else parse_time_text(text)


def parse_every(text: str) -> "int | timedelta":
    """Every N-th sweep, a whole number, or an interval of time with its unit."""
    from datetime import timedelta

    from lidarcli.options.times import parse_time

    if text.isdecimal():
        return int(COUNT.parse(text))
    found = None if text[-1:].isdecimal() else parse_time(text)
    if not isinstance(found, float) or found < 1.0:
        raise OptionError(f"'{text}' is neither a number of sweeps nor an interval of a second or more (30s, 15min, 1h)")
    return timedelta(seconds=found)


def metres(text: str, words: str, form: Number) -> float:
    """A number of metres; `words` begin the refusal of what is none."""
    try:
        float(text)
    except ValueError:
        raise OptionError(f"'{text}' is {words} nor a number of metres") from None
    return form.parse(text)


def parse_names(text: str) -> tuple[str, ...]:
    """Names of columns, comma separated."""
    return tuple(name for part in text.split(",") if (name := part.strip()))


def parse_numbers(text: str) -> tuple[int, ...]:
    """Numbers of tracks, comma separated."""
    wrong = next((part for part in text.split(",") if not part.strip().isdecimal()), None)
    if wrong is not None:
        raise OptionError(f"'{wrong}' is no number of a track; give them as 4,6")
    return tuple(dict.fromkeys(int(part) for part in text.split(",")))


def parse_sweeps(text: str) -> tuple[int, ...]:
    """Numbers of sweeps, `0,50,100`, or `0:100:10` as Python counts: each once, in the order given."""
    found: dict[int, None] = {}
    for part in text.split(","):
        try:
            numbers = [int(number) for number in part.split(":")]
        except ValueError:
            raise OptionError(f"'{part}' is neither a number nor START:STOP nor START:STOP:STEP") from None
        if min(numbers) < 0 or len(numbers) > 3 or (len(numbers) == 3 and not numbers[2]):
            raise OptionError(f"'{part}' is no number of a sweep, nor a range of them")
        more = range(*numbers) if len(numbers) > 1 else numbers
        if max(numbers) > choices.LAST_SWEEP:
            raise OptionError(f"'{part[:40]}' goes beyond {choices.LAST_SWEEP:,}")
        if len(found) + len(more) > choices.MAX_COUNT:
            raise OptionError(f"'{part}' is too many sweeps")
        found |= dict.fromkeys(more)
    if not found:
        raise OptionError(f"'{text}' holds no sweep")
    return tuple(found)


WIDTH, LENGTH = Number("METRES", 0, above=True), Number("METRES", 0)
COUNT, COUNT_OR_NONE = (Number("N", 1, choices.MAX_COUNT, whole=True), Number("N", 0, choices.MAX_COUNT, whole=True))
TURN = Number("DEGREES", 0, above=True)
SWEEP = Number("N", 0, choices.LAST_SWEEP, whole=True)
TIME, TIME_ZONE = Text("TIME", parse_time_text), Text("ZONE", parse_zone_text)
INPUT = File("LOG")


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
    word = text.lower()
    return word if word in choices.SAYINGS else metres(text, f"neither {', '.join(choices.SAYINGS)}", LENGTH)
