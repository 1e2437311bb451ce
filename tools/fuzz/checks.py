"""Expressions of `--check`: grown from their grammar (docs/reports.md), then spoilt, and very long or deep ones."""

from __future__ import annotations

from tools.fuzz.commands import judge_commands
from tools.fuzz.place import Place
from tools.fuzz.tables import FORMATS, put
from tools.fuzz.target import Random, Target
from tools.fuzz.words import mutate_words

FIGURES = (
    *("sweeps", "objects", "valid_share", "rate", "gaps", "objects_per_sweep.p95", "width.mean", "nothing"),
    *("delta.sweeps", "added_sweeps", "agents", "objects_per_sweep", "range.max"),
)
COLUMNS = (
    *("width", "r_min", "range_min", "bearing", "shape", "visibility", "topic", "set", "change", "track"),
    *("objects", "valid", "noise", "vertices", "pose_x", "nothing", "stamp"),
)
SIGNS = ("==", "!=", "<=", ">=", "<", ">")
WORDS = ("round", "full", "'/scan'", '"/scan"', "O", "'\x01'", "'\x1b[31m'", "appeared", "null", "'<&>'")
NUMBERS = ("0", "1", "-1", "0.5", "1e308", "1e400", "-0", "99999999999999999999", "nan", "inf", ".5", "5.")
_DEPTH = 6
_LONGEST = 100_000
"""Characters: what a system takes as one argument is 131,072 bytes."""

KNOWN: tuple[str, ...] = (
    "sweeps >= 1",
    "objects where " + "(" * 3000 + "width > 1" + ")" * 3000 + " == 0",
    "objects where " + "not " * 5000 + "width > 1 == 0",
    "objects where " + "width > 1 or " * 3000 + "width > 2 == 0",
    "objects where " + "width > 1 and " * 3000 + "width > 2 == 0",
    "objects where topic == '\x01' == 0",
    "objects where topic == '\x1b[31m' == 0",
    "objects where topic == '\ufffe' == 0",
    "objects where topic == '\udcff' == 0",
    "objects where topic == ']]><b>&' == 0",
    "objects where topic == '" + "a" * 50_000 + "' == 0",
    "(" * 20_000,
    "9" * 50_000,
    "sweeps == " + "9" * 50_000,
    "a." * 20_000 + "a == 1",
    "sweeps == 1e400",
    "sweeps == nan",
    "",
    "'",
    "\x07",
)


def write(place: Place, number: int, random: Random) -> None:
    """Sound tables, and one check or two."""
    put(place)
    if number < len(KNOWN):
        formats, given = ["text", "html", "junit"], [KNOWN[number]]
    else:
        given = [_expression(random) for _ in range(int(random.integers(1, 3)))]
        formats = [FORMATS[int(random.integers(len(FORMATS)))]]
    options = [part for expression in given for part in ("--check", expression)]
    tables = ["report", "in/run.objects.parquet"]
    place.note(commands=[[*tables, "--format", form, *options] for form in formats])


def _expression(random: Random) -> str:
    text = _check(random)
    if random.integers(2):
        text = mutate_words(text, random)
    # No argument of a process holds a zero byte.
    return text.replace("\0", "")[:_LONGEST]


def _one(choice: tuple[str, ...], random: Random) -> str:
    return choice[int(random.integers(len(choice)))]


def _check(random: Random) -> str:
    measure = _one(FIGURES, random)
    if random.integers(3):
        measure = f"{_one(('objects', 'sweeps'), random)} where {_condition(random, _DEPTH)}"
    if random.integers(4):
        return f"{measure} {_one(SIGNS, random)} {_one(NUMBERS, random)}"
    return f"{measure} between {_one(NUMBERS, random)} and {_one(NUMBERS, random)}"


def _condition(random: Random, depth: int) -> str:
    kind = int(random.integers(7)) if depth else 0
    if kind < 3:
        return _comparison(random)
    inner = _condition(random, depth - 1)
    if kind == 3:
        return f"not {inner}"
    if kind == 4:
        return f"({inner})"
    return f"{inner} {_one(('or', 'and'), random)} {_condition(random, depth - 1)}"


def _comparison(random: Random) -> str:
    column = _one(COLUMNS, random)
    kind = int(random.integers(4))
    if kind == 0:
        return f"{column} is {_one(('', 'not '), random)}null"
    if kind == 1:
        return f"{column} between {_one(NUMBERS, random)} and {_one(NUMBERS, random)}"
    return f"{column} {_one(SIGNS, random)} {_one((NUMBERS, WORDS)[kind - 2], random)}"


def check_targets() -> list[Target]:
    """Checks."""
    return [Target("checks", write, judge_commands, weight=150, known=len(KNOWN))]
