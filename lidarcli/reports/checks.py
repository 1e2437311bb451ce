"""Gates on named figures: `sweeps >= 100`, `objects where width > 0.5 == 0`, `delta.objects between -5 and 5`.

check      = measure ( sign number | "between" number "and" number )
measure    = figure | ( "objects" | "sweeps" ) "where" condition
condition  = term { "or" term }
term       = factor { "and" factor }
factor     = "not" factor | "(" condition ")" | comparison
comparison = column sign value | column "between" number "and" number | column "is" [ "not" ] "null"
sign       = "==" | "!=" | "<" | "<=" | ">" | ">="
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from lidarcli.reports import figures
from lidarcli.reports.columns import Run
from lidarcli.reports.conditions import COMPARE, Condition, parse_condition, read_limits, read_number, schemas
from lidarcli.reports.spread import STATISTICS
from lidarcli.reports.tokens import Tokens


@dataclass(frozen=True, slots=True)
class Check:
    """A gate that has been understood."""

    expression: str
    name: str
    """The figure, or `objects` or `sweeps` where rows are counted."""
    condition: Condition | None
    sign: str
    """A comparison, or `between`."""
    low: float
    high: float

    @property
    def expected(self) -> str:
        """What has to hold, without what is measured."""
        if self.sign == "between":
            return f"between {self.low:g} and {self.high:g}"
        return f"{self.sign} {self.low:g}"

    def admits(self, value: float) -> bool:
        """Whether a value is as expected."""
        if self.sign == "between":
            return self.low <= value <= self.high
        return bool(COMPARE[self.sign](value, self.low))


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a check."""

    expression: str
    expected: str
    found: float | None
    """None where there was nothing to measure; then the check does not hold."""
    holds: bool

    @property
    def words(self) -> str:
        """What was found, for people."""
        if self.found is None:
            return "nothing to measure"
        return f"{self.found:,.0f}" if self.found == int(self.found) else f"{self.found:.6g}"


def parse_check(expression: str, compared: bool = False) -> Check:
    """Understand a check; `compared` when there is a baseline.

    Raises
    ------
    OptionError
        Bad syntax, or a name that does not exist; the message lists those that do.

    >>> parse_check("objects_per_sweep.p95 <= 12").expected
    '<= 12'
    """
    tokens = Tokens(expression)
    token = tokens.next
    if token.kind != "name":
        raise tokens.error("expected a figure such as sweeps or objects_per_sweep.mean")
    tokens.take()
    condition = None
    if tokens.take_if("where"):
        tables = dict(schemas())
        if token.text not in tables:
            raise tokens.error(f"only {' and '.join(tables)} can be counted with where, not", token)
        condition = parse_condition(tokens, tables[token.text])
    else:
        _known(tokens, token.text, compared)
    if tokens.take_if("between"):
        sign = "between"
        low, high = read_limits(tokens)
    else:
        sign = tokens.expect("operator", f"a comparison ({', '.join(COMPARE)}, between)").text
        low = high = read_number(tokens)
    if tokens.next.kind != "end":
        raise tokens.error("expected nothing more")
    return Check(expression, token.text, condition, sign, low, high)


def judge(check: Check, values: Mapping[str, float | None], run: Run) -> Verdict:
    """Hold a check against the figures of a run, or against its rows."""
    if check.condition is None:
        found = values[check.name]
    else:
        rows = run.objects if check.name == "objects" else run.sweeps
        chosen = check.condition.holds(rows)
        # Walls and agents count only where the condition asks for them.
        if check.name == "objects" and "set" not in check.condition.columns:
            chosen &= run.is_object
        found = float(chosen.sum())
    holds = found is not None and check.admits(found)
    return Verdict(check.expression, f"{check.expected}", found, holds)


def columns_needed(checks: Sequence[Check], table: str) -> frozenset[str]:
    """Columns of a table that the checks look at."""
    conditions = [check.condition for check in checks if check.name == table and check.condition is not None]
    return frozenset().union(*(condition.columns for condition in conditions))


def _known(tokens: Tokens, name: str, compared: bool) -> None:
    plain = name.removeprefix(figures.DELTA)
    names = figures.names()
    if plain in names or name in figures.COMPARED:
        if not compared and (name != plain or name in figures.COMPARED):
            raise tokens.error(f"{name} needs a --baseline to compare with;")
        return
    if plain in figures.SPREADS:
        raise tokens.error(f"{name} has several values, choose one of .{', .'.join(STATISTICS)};")
    close = difflib.get_close_matches(plain, [*names, *figures.SPREADS, *figures.COMPARED], 1)
    hint = f"did you mean {close[0]}? " if close else ""
    kinds = [f"{name}.{kind}" for name, values in figures.CATEGORIES.items() for kind in values]
    several = f"{{{', '.join(figures.SPREADS)}}}.{{{', '.join(STATISTICS)}}}"
    there = ", ".join([*figures.COUNTS, several, *kinds, "objects where ...", "sweeps where ..."])
    more = f", with --baseline also delta.NAME, {', '.join(figures.COMPARED)}"
    raise tokens.error(f"unknown figure '{name}'; {hint}available: {there}{more};")
