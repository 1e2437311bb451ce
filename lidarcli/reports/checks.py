"""Gates on named figures: `sweeps >= 100`, `tracks where distance > 1 == 4`, `delta.objects between -5 and 5`.

check      = measure ( sign number | "between" number "and" number )
measure    = figure | ( "objects" | "sweeps" | "tracks" | "events" ) "where" condition
condition  = term { "or" term }
term       = factor { "and" factor }
factor     = "not" factor | "(" condition ")" | comparison
comparison = column sign value | column "between" number "and" number | column "is" [ "not" ] "null" | column
sign       = "==" | "!=" | "<" | "<=" | ">" | ">="
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from lidarcli.display.texts import counted, some_of
from lidarcli.errors import OptionError
from lidarcli.reports import figures
from lidarcli.reports.columns import BEAMS_OF_OBJECTS, OBJECTS_OF_SWEEP, Rows, Run, ZoneRows
from lidarcli.reports.figures import STATISTICS
from lidarcli.sweeps.types import Bool, Column, Float64, Int64
from lidarcli.tabular.schemas import TABLES

_TOKEN = re.compile(
    r"""\s*(?:
    (?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.]))
  | (?P<name>(?:(?:(?:delta|percent)\.)?zones\.[\w-]+|[A-Za-z_]\w*)(?:\.[A-Za-z_]\w*)*)
  | (?P<operator>==|!=|<=|>=|<|>)
  | (?P<bracket>[()])
  | "(?P<double>[^"]*)" | '(?P<single>[^']*)'
    )""",
    re.VERBOSE,
)
LONGEST_CHECK = 10_000
"""Most characters of a check."""
SHOWN_OF_CHECK = 200
"""Most characters of a check that an error repeats."""
COMPARE: dict[str, Callable[[Any, float, float], Any]] = {
    "==": lambda value, low, _: value == low,
    "!=": lambda value, low, _: value != low,
    "<=": lambda value, low, _: value <= low,
    ">=": lambda value, low, _: value >= low,
    "<": lambda value, low, _: value < low,
    ">": lambda value, low, _: value > low,
    "between": lambda value, low, high: (low <= value) & (value <= high),
}
"""Sign → the comparison of a value with one or two limits."""
SIGNS = ", ".join(COMPARE)
COUNTED = {name: {one.name: one for one in TABLES[name]} for name in ("objects", "sweeps", "tracks", "events")}
"""The tables whose rows can be counted, and their columns by name."""
ALIASES = {"objects": {"range_min": "r_min", "range": "r_min", "bearing": "theta_min"}}
"""Table → other names of its columns."""
SUMS = {"sweeps": {"objects": OBJECTS_OF_SWEEP, "object_beams": BEAMS_OF_OBJECTS}}
"""Table → name → columns that it sums up: a name means the same in checks of figures and of rows."""
CLOSE = 0.7
"""Least likeness (difflib) of a name that may have been meant."""
DEEPEST = 50
"""Most brackets that are open at once in a condition."""
TRUTH = {"true": True, "false": False}
KEYWORDS = frozenset({"and", "or", "not", "between", "is", "null", "where", *TRUTH})
UNKNOWN = 0.5
"""Truth of a comparison with null, between those of what is false and what is true."""
OFFERED = 3
"""Most figures that a message offers for an unknown one."""
OF_TRACKS = frozenset({"vx", "vy", "moving"})
"""Columns of the objects table that are empty without tracks: a check of them would always hold."""
_COMPARISON = re.compile(r"\s*(==|!=|<=|>=|<|>|\bbetween\b)[^=!<>]*$")
"""The end of a check, from its comparison on."""


class OfEachLog(str):
    """A check of a `file`: each of several logs has to hold it by itself, not all of them together."""

    file = ""


class Token(NamedTuple):
    """One word of a check and where it begins."""

    kind: str
    """`number`, `name`, `operator`, `bracket`, `text` or `end`."""
    text: str
    place: int


class Tokens:
    """The words of one check, read from left to right."""

    def __init__(self, expression: str) -> None:
        self.expression = text = expression
        if len(text) > LONGEST_CHECK:
            raise OptionError(
                f"--check '{text[:20]}...': {len(text):,} characters are more than a check may have ({LONGEST_CHECK:,})"
            )
        self._left: list[Token] = []
        place, end = 0, len(text.rstrip())
        while place < end:
            match = _TOKEN.match(text, place)
            if match is None:
                start = end - len(text[place:end].lstrip())
                raise self.error("cannot be read", Token("unknown", text[start], start))
            kind = str(match.lastgroup)
            self._left.append(Token("text" if kind in ("double", "single") else kind, match[kind], match.start(kind)))
            place = match.end()
        # Two ends: the parser looks at most at the word after the next one.
        self._left += [Token("end", "", len(text))] * 2
        self._left.reverse()

    @property
    def next(self) -> Token:
        """The word that comes next."""
        return self._left[-1]

    def take(self) -> Token:
        """Take the next word; the end stays."""
        return self._left.pop() if self.next.kind != "end" else self.next

    def take_if(self, *texts: str) -> str | None:
        """Take the next word if it is one of these keywords or signs."""
        if self.next.kind in ("name", "operator", "bracket") and self.next.text in texts:
            return self.take().text
        return None

    def take_truth(self) -> bool:
        """Take `== true` or `!= false`, and the like; without one, as where a sign belongs to the check, it is true."""
        if self.next.text not in ("==", "!=") or self._left[-2].text not in TRUTH:
            return True
        equal = self.take().text == "=="
        return TRUTH[self.take().text] == equal

    def take_number(self) -> float:
        """Take a number."""
        if self.next.kind != "number":
            raise self.error("expected a number")
        return float(self.take().text)

    def take_limits(self, of: str = "", more: str = "") -> tuple[str, float, float]:
        """Take a sign and a number, or `between A and B`: the sign, and the least and the greatest limit.

        `of` and `more` are for the message: the column that is compared, and what else is allowed here.
        """
        if not self.take_if("between"):
            if self.next.kind != "operator":
                raise self.error(f"expected a comparison ({SIGNS}{more}){of}")
            sign, number = self.take().text, self.take_number()
            return sign, number, number
        first, low = self.next, self.take_number()
        if not self.take_if("and"):
            raise self.error("expected 'and'")
        high = self.take_number()
        if low > high:
            raise self.error(f"{low:g} is above {high:g}: nothing is between them,", first)
        return "between", low, high

    def error(self, problem: str, token: Token | None = None) -> OptionError:
        """Return the error of this check at the next word, or at the one given."""
        at = token or self.next
        where = "at the end" if at.kind == "end" else f"at '{at.text}', column {at.place + 1}"
        shown = self.expression if len(self.expression) <= SHOWN_OF_CHECK else f"{self.expression[:SHOWN_OF_CHECK]}..."
        return OptionError(f"--check '{shown}': {problem} {where}")


class Condition(NamedTuple):
    """A condition: the columns that it needs, and its function of rows."""

    columns: frozenset[str]
    truth: Callable[[Rows], Float64]
    """Returns (K,) 0, 1 or `UNKNOWN`."""

    def holds(self, rows: Rows) -> Bool:
        """Return (K,) rows for which the condition is known to hold."""
        known: Bool = self.truth(rows) == 1.0
        return known


def column_names(table: str) -> list[str]:
    """Return the columns of a table that a condition may name."""
    return [name for name, one in COUNTED[table].items() if one.kind != "stamp"]


def parse_condition(tokens: Tokens, table: str, depth: int = 0) -> Condition:
    """Parse `term or term or ...` to its end; `depth` brackets are open."""
    return _joined(tokens, "or", np.maximum, lambda: _term(tokens, table, depth))


def _term(tokens: Tokens, table: str, depth: int) -> Condition:
    return _joined(tokens, "and", np.minimum, lambda: _factor(tokens, table, depth))


def _joined(tokens: Tokens, word: str, join: np.ufunc, parse: Callable[[], Condition]) -> Condition:
    """Parse conditions with a word between them."""
    parts = [parse()]
    while tokens.take_if(word):
        parts.append(parse())
    columns = frozenset[str]().union(*(part.columns for part in parts))
    return Condition(columns, lambda rows: reduce(join, (part.truth(rows) for part in parts)))


def _factor(tokens: Tokens, table: str, depth: int) -> Condition:
    negated = False
    while tokens.take_if("not"):
        negated = not negated
    if not tokens.take_if("("):
        found = _comparison(tokens, table)
    elif depth == DEEPEST:
        raise tokens.error(f"more than {DEEPEST} brackets are open")
    else:
        found = parse_condition(tokens, table, depth + 1)
        if not tokens.take_if(")"):
            raise tokens.error("expected ')'")
    return Condition(found.columns, lambda rows: 1.0 - found.truth(rows)) if negated else found


def _comparison(tokens: Tokens, table: str) -> Condition:
    name = _column(tokens, table)
    column = COUNTED[table][name]
    if tokens.take_if("is"):
        is_null = tokens.take_if("not") is None
        if not tokens.take_if("null"):
            raise tokens.error("expected null")

        def null(rows: Rows) -> Float64:
            return np.asarray(rows.table[name].is_null().to_numpy(zero_copy_only=False) == is_null, np.float64)

        return Condition(frozenset({name}), null)
    if column.kind == "text":
        return _word(tokens, column)
    names = SUMS.get(table, {}).get(name, (name,))
    sign, low, high = (
        ("!=" if tokens.take_truth() else "==", 0.0, 0.0)
        if column.kind == "bool"
        else tokens.take_limits(f" of {name}", ", is")
    )

    def truth(rows: Rows) -> Float64:
        values = rows.total(names)
        return np.where(np.isnan(values), UNKNOWN, COMPARE[sign](values, low, high))

    return Condition(frozenset(names), truth)


def _column(tokens: Tokens, table: str) -> str:
    token, known, aliases = tokens.next, column_names(table), ALIASES.get(table, {})
    name = aliases.get(token.text, token.text)
    names = [*known, *aliases]
    if token.kind != "name" or token.text in KEYWORDS:
        raise tokens.error(f"expected a column of {table}: {', '.join(names)};")
    if name not in known:
        hint = nearest(token.text, names) or ";"
        raise tokens.error(f"unknown column '{token.text}' of {table}{hint} available: {', '.join(names)};")
    tokens.take()
    return name


def nearest(text: str, names: Collection[str], most: int = 1) -> str:
    """Return the names that may have been meant, as the end of a message, or nothing.

    >>> nearest("widht", ["width", "x"]), nearest("sweps", ["x", "sweep", "sweeps", "steps"], 3)
    ('; did you mean width?', '; did you mean sweeps, sweep or steps?')
    """
    close = difflib.get_close_matches(text, names, most, CLOSE)
    words = [", ".join(close[:-1]), *close[-1:]] if len(close) > 1 else close
    return f"; did you mean {' or '.join(words)}?" if close else ""


def _word(tokens: Tokens, column: Column) -> Condition:
    name, known = column.name, column.words
    sign = tokens.take_if("==", "!=")
    if sign is None:
        raise tokens.error(f"expected ==, != or is (column {name} holds names)")
    token = tokens.next
    choice = f" ({', '.join(known)})" if known else ""
    if token.kind not in ("name", "text", "number"):
        raise tokens.error(f"expected a value of {name}{choice}")
    if known and token.text not in known:
        raise tokens.error(f"unknown {name}{choice}{nearest(token.text, known)}")
    tokens.take()

    def truth(rows: Rows) -> Float64:
        codes, _ = rows.words(name)
        return np.where(codes < 0, UNKNOWN, rows.are(name, token.text) == (sign == "=="))

    return Condition(frozenset({name}), truth)


@dataclass(frozen=True, slots=True)
class Check:
    """A check, parsed."""

    expression: str
    name: str
    """Name of the figure, or of the table whose rows are counted."""
    condition: Condition | None
    sign: str
    """A comparison, or `between`."""
    low: float
    high: float

    @property
    def expected(self) -> str:
        """Expected comparison, without the figure."""
        if self.sign == "between":
            return f"between {self.low:g} and {self.high:g}"
        return f"{self.sign} {self.low:g}"

    @property
    def figure(self) -> str:
        """Name of the figure, be it the value or its difference from a baseline."""
        return figures.plain_name(self.name)

    @property
    def is_of_each(self) -> bool:
        """True if each log has to hold it by itself."""
        return isinstance(self.expression, OfEachLog) and self.name == self.figure

    @property
    def needs_tracks(self) -> bool:
        """True if the check cannot be evaluated without tracks tables."""
        if self.condition is None:
            return self.figure in figures.track_names()
        return self.name == "tracks" or (self.name == "objects" and bool(self.condition.columns & OF_TRACKS))

    @property
    def needs_changes(self) -> bool:
        """True if the check cannot be evaluated without tables of changes."""
        return self.condition is None and self.name in {*figures.OF_CHANGES, *figures.OF_MAPS}

    @property
    def needs_zones(self) -> bool:
        """True if the check cannot be evaluated without tables of zones."""
        return self.name == "events" if self.condition else figures.zone_of(self.name) is not None

    def admits(self, value: float) -> bool:
        """Return True if a value is as expected."""
        return bool(COMPARE[self.sign](value, self.low, self.high))


@dataclass(frozen=True, slots=True)
class CheckVerdict:
    """The result of a check."""

    expression: str
    expected: str
    found: float | None
    """Value that was measured; None where there was none, and the check does not hold."""
    holds: bool
    logs: tuple[tuple[str, CheckVerdict], ...] = ()
    """Logs and their verdicts, where each of several has to hold it; found is that of the first that fails, if any."""

    def as_dict(self) -> dict[str, Any]:
        """Return the result as plain values."""
        shown = {"check": self.expression, "holds": self.holds, "expected": self.expected}
        logs = [{"log": log, "holds": one.holds, "found": figures.plain_number(one.found)} for log, one in self.logs]
        return shown | {"found": figures.plain_number(self.found)} | ({"logs": logs} if logs else {})

    @property
    def failure(self) -> str:
        """The check and why it fails, for people."""
        found = "has nothing to measure" if self.found is None and not self.logs else f"is {self.words}"
        return f"{_COMPARISON.sub('', self.expression)} {found}, expected {self.expected}"

    @property
    def words(self) -> str:
        """Value that was found, for people; of several logs those that fail."""
        if self.logs:
            values = sorted((one for _, one in self.logs), key=lambda one: -np.inf if one.found is None else one.found)
            failed = [f"{one.words} in {log}" for log, one in self.logs if not one.holds]
            span, every = dict.fromkeys((values[0].words, values[-1].words)), counted(len(self.logs), "log")
            return f"{some_of(failed)} ({len(failed):,} of {every})" if failed else f"{' to '.join(span)} in {every}"
        if self.found is None:
            return "nothing to measure"
        return f"{self.found:,.0f}" if self.found == int(self.found) else f"{self.found:.6g}"


class OneRun(NamedTuple):
    """One of several logs, or tables of changes, by itself."""

    log: str
    start_ns: int | None
    """First stamp; None where it is not known."""
    figures: Mapping[str, float | None]
    verdicts: Mapping[str, CheckVerdict] = MappingProxyType({})
    """Results of the checks of rows that it has to hold."""

    @staticmethod
    def of(
        log: str, stamps: Int64, found: Mapping[str, float | None], rows: Run | ZoneRows, checks: Sequence[Check]
    ) -> OneRun:
        """Return one of several logs by its stamps, its figures and its rows."""
        each = (one for one in checks if one.is_of_each and one.condition)
        verdicts = {one.expression: judge(one, found, rows) for one in each}
        return OneRun(log, min(stamps.tolist(), default=None), found, verdicts)


def held(
    check: Check, runs: Sequence[OneRun], found: Mapping[str, float | None], rows: Run | ZoneRows | None
) -> CheckVerdict:
    """Hold a check against each of several runs, if it is about each, or against the figures and rows of all."""
    own = [one for one in runs if check.is_of_each and check.needs_changes == ("known" in one.figures)]
    logs = [(one.log, one.verdicts.get(check.expression) or verdict_of(check, one.figures.get(check.name))) for one in own]
    if not logs:
        return judge(check, found, rows)
    return replace(next((one for _, one in logs if not one.holds), logs[0][1]), logs=tuple(logs))


def parse_check(
    expression: str,
    compared: bool = False,
    only: Collection[str] | None = None,
    rows: Collection[str] | None = None,
    zones: Collection[str] | None = None,
) -> Check:
    """Understand a check.

    Parameters
    ----------
    compared : whether there is a baseline
    only : the figures that there are in addition to those of zones, where the check is not about tables of `detect`
    rows : the tables whose rows can be counted; by default all, with `only` none
    zones : the zones that there are; where that is not known yet, a zone may have any name

    Raises
    ------
    OptionError
        Bad syntax, or a name that does not exist; the message names what is near.

    >>> parse_check("objects_per_sweep.p95 <= 12").expected
    '<= 12'
    """
    if rows is None:
        rows = COUNTED if only is None else ()
    tokens = Tokens(expression)
    token = tokens.next
    if token.kind != "name":
        raise tokens.error("expected a figure such as sweeps or objects_per_sweep.mean")
    tokens.take()
    condition = None
    if rows and tokens.take_if("where"):
        if token.text not in rows:
            hint = nearest(token.text, rows) or ";"
            there = ", ".join(rows)
            raise tokens.error(f"unknown table '{token.text}' before where{hint} available: {there};", token)
        condition = parse_condition(tokens, token.text)
    elif figures.zone_of(token.text) is not None and (only is None or zones is not None):
        _known_of_zone(tokens, token, compared, zones)
    elif only is None:
        _known(tokens, token, compared, zones)
    elif token.text not in only:
        raise _unknown(tokens, token, only, zones or (), bool(only))
    sign, low, high = tokens.take_limits()
    if tokens.next.kind != "end":
        raise tokens.error("expected nothing more")
    return Check(expression, token.text, condition, sign, low, high)


def judge(check: Check, values: Mapping[str, float | None], rows: Run | ZoneRows | None) -> CheckVerdict:
    """Hold a check against the figures of a run or of zones, or against their rows."""
    # Tracks tables that could not be read leave nothing to measure.
    if check.condition is None or rows is None:
        return verdict_of(check, values.get(check.name))
    return verdict_of(check, _count(check, check.condition, rows))


def verdict_of(check: Check, found: float | None) -> CheckVerdict:
    """Hold a check against what was found; None where there was nothing to measure."""
    holds = found is not None and check.admits(found)
    return CheckVerdict(str(check.expression), check.expected, found, holds)


def _count(check: Check, condition: Condition, run: Run | ZoneRows) -> float | None:
    """Return the number of rows for which a condition holds; None without the table, or what its columns need."""
    if not isinstance(run, Run):
        # If no zone was ever observed, nobody knows.
        return float(condition.holds(run.events).sum()) if run.zones.numbers("observed").any() else None
    if check.name == "events":
        return None if run.zones is None else _count(check, condition, run.zones)
    rows = {"objects": run.objects, "sweeps": run.sweeps, "tracks": run.tracks}[check.name]
    if rows is None:
        return None
    # What is asked of an empty column has no answer, unless it is asked for being empty.
    truth = condition.truth(rows)
    if (truth == UNKNOWN).any() and not all(run.knows(rows, name) for name in condition.columns):
        return None
    chosen = truth == 1.0
    if check.name == "objects":
        # Walls, and what has gone from a background, count only where the condition asks for them.
        chosen &= run.is_object | _asked_for(condition, run)
    return float(chosen.sum())


def _asked_for(condition: Condition, run: Run) -> Bool:
    """Return (K,) the rows of walls or removed objects, if the condition names `set` or `change`."""
    walls, gone = run.objects.are("set", "S"), run.objects.are("change", "removed")
    return (walls & ("set" in condition.columns)) | (gone & ("change" in condition.columns))


def columns_needed(checks: Sequence[Check], table: str) -> frozenset[str]:
    """Return the columns of a table that the checks need, for conditions or for figures of the same name."""
    conditions = [check.condition for check in checks if check.name == table and check.condition is not None]
    figures_of = {check.figure.split(".")[0] for check in checks if check.condition is None}
    return frozenset(figures_of & {*column_names(table)}).union(*(condition.columns for condition in conditions))


def accepts(checks: Sequence[Check], *names: str) -> bool:
    """Return True if a check is about one of these figures, and so says how much of it is accepted."""
    return any(check.condition is None and check.figure in names for check in checks)


def _known_of_zone(tokens: Tokens, token: Token, compared: bool, zones: Collection[str] | None) -> None:
    """Refuse a figure that no zone has, or that is of none of the `zones`."""
    zone, rest = figures.zone_of(token.text) or ("", "")
    if zones is not None and zone not in zones:
        hint = nearest(zone, zones, OFFERED) or f"; there {'is' if len(zones) == 1 else 'are'} {', '.join(zones)};"
        raise tokens.error(f"unknown zone '{zone}'{hint}", token)
    start = f"{figures.ZONES}{zone}."
    names = [name.removeprefix(start) for name in figures.zone_names(zone)]
    if rest in figures.ZONE_SPREADS:
        raise tokens.error(f"{token.text} has several values, choose one of .{', .'.join(STATISTICS)};")
    if rest not in names:
        there = ", ".join([*figures.ZONE_COUNTS, *(f"{name}.mean" for name in figures.ZONE_SPREADS)])
        hint = nearest(rest, names, OFFERED) or f"; there are {there};"
        raise tokens.error(f"unknown figure '{rest}' of zone {zone}{hint}", token)
    if token.text != figures.plain_name(token.text) and not compared:
        raise tokens.error(f"{token.text} needs a --baseline to compare with;")


def _known(tokens: Tokens, token: Token, compared: bool, zones: Collection[str] | None) -> None:
    """Refuse a figure that no tables of objects or changes have."""
    name, plain = token.text, figures.plain_name(token.text)
    names, of_changes = [*figures.names(), *figures.track_names()], [*figures.OF_CHANGES, *figures.OF_MAPS]
    spreads = figures.SPREADS | figures.TRACK_SPREADS
    if plain in names or name in figures.COMPARED:
        if not compared and (name != plain or name in figures.COMPARED):
            raise tokens.error(f"{name} needs a --baseline to compare with;")
    elif plain in spreads and name not in of_changes:
        raise tokens.error(f"{name} has several values, choose one of .{', .'.join(STATISTICS)};")
    elif name not in of_changes:
        known = [*names, *spreads]
        delta = [*figures.COMPARED, *(figures.DELTA + other for other in known)]
        raise _unknown(tokens, token, dict.fromkeys([*known, *of_changes, *delta]), zones)


def _unknown(
    tokens: Tokens, token: Token, known: Collection[str], zones: Collection[str] | None, few: bool = False
) -> OptionError:
    """Return the error of an unknown figure, which names what is near, or else the `known` ones if they are `few`."""
    hint = nearest(token.text, known, OFFERED) or ";"
    zone, zoned = token.text.partition(".")[0], f"{figures.ZONES}{token.text}"
    if zoned in figures.zone_names(zone) and (zones is None or zone in zones):
        hint = f"; did you mean {zoned}?"
    if not few:
        hint += " docs/reports.md has all;"
    elif hint == ";":
        hint = f"; there are {', '.join(known)};"
    return tokens.error(f"unknown figure '{token.text}'{hint}", token)
