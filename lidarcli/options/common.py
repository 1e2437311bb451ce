"""Options that many commands share: their logs, their outputs, and the checks of what they find."""

from typing import Annotated, Any, Literal, TypedDict

from lidarcli.errors import OptionError
from lidarcli.options import choices
from lidarcli.options.forms import Argument, File, Option, OptionRule, Text
from lidarcli.options.values import CHECKS, COUNT, INPUT, MANY, OUTPUT, Paths


def parse_shard(text: str) -> tuple[int, int]:
    """(I, N): the I-th of N shares."""
    number, _, count = text.partition("/")
    if not (number.isdecimal() and count.isdecimal()):
        raise OptionError(f"'{text}' is not I/N, as 1/8")
    if not 1 <= int(number) <= int(count) <= choices.MAX_SHARDS:
        raise OptionError(f"'{text}': shares are numbered from 1 to {count}")
    return int(number), int(count)


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
        Option(MANY, Text("I/N", parse_shard), shown="all", rare=True),
        "Process only the I-th of N shares of the logs. The name of a log alone decides which share it is in.",
    ]
    dry_run: Annotated[bool, Option(MANY, None, False, rare=True), "Only print what would be read and written."]


def output(metavar: str, **more: Any) -> Option:
    """Return `-o`, which every command fills with something else; without a default it is required."""
    more.setdefault("required", not {"default", "shown"} & more.keys())
    return Option(OUTPUT, File(metavar, is_output=True), short="-o", **more)


class Overwrite(TypedDict, total=False):
    overwrite: Annotated[bool, Option(OUTPUT, None, False), "Replace files that exist."]


STAMPS_HELP = "Unit of the stamps in tables; us for Spark, Delta and Iceberg before v3, which have no ns (docs/fleet.md)."


class Stamped(Overwrite, total=False):
    """Options of a command that writes tables."""

    stamps: Annotated[Literal["ns", "us"], Option(OUTPUT, choices.STAMPS, choices.NS, rare=True), STAMPS_HELP]


class TextOrJson(TypedDict, total=False):
    format: Annotated[Literal["text", "json"], Option(OUTPUT, ("text", "json"), "text"), "Text, or JSON for programs."]


class Reported(Stamped, TextOrJson, total=False):
    """Options of a command that writes tables, or a table among others, and prints a summary."""


_HOLDS = "`holds` of the result tells."
CHECK = Option(CHECKS, Text("EXPR", has_blanks=True), (), shown="none", several=True, python=_HOLDS)


class Checked(TypedDict, total=False):
    """Options of a command that holds what it finds against conditions."""

    checks: Annotated[
        Paths,
        Option(CHECKS, File("FILE"), (), shown="none", several=True),
        "Also the checks of this file, for each log (TOML, docs/ci.md); may be repeated.",
    ]


class Jobs(TypedDict, total=False):
    jobs: Annotated[int | None, Option(OUTPUT, COUNT, shown="automatic", short="-j"), "Processors to use at most."]


RULES = (
    OptionRule(
        ("removed", "any_frame", "station_distance", "station_angle"), ("background",), "is for --background FILE", True
    ),
    OptionRule(("jobs",), ("cluster",), "is for this machine, --cluster for others"),
    OptionRule(("dry_run",), ("format=json",), "prints a plan and no summary: leave out --format json"),
)
"""For whatever has these options."""
