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

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from lidarcli.errors import OptionError
from lidarcli.reports import figures
from lidarcli.reports.columns import Run, Watched
from lidarcli.reports.conditions import (
    COMPARE,
    COUNTED,
    Condition,
    Token,
    Tokens,
    column_names,
    nearest,
    parse_condition,
    read_limits,
    read_number,
)
from lidarcli.reports.figures import STATISTICS
from lidarcli.sweeps import Bool

OFFERED = 3
"""Most figures that a message offers for an unknown one."""
OF_TRACKS = frozenset({"vx", "vy", "moving"})
"""Columns of the objects table that are empty without tracks: a check of them would always hold."""


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
        return self.name.removeprefix(figures.DELTA)

    @property
    def needs_tracks(self) -> bool:
        """True if the check cannot be judged without tracks tables."""
        if self.condition is None:
            return self.figure in figures.track_names()
        return self.name == "tracks" or (self.name == "objects" and bool(self.condition.columns & OF_TRACKS))

    @property
    def needs_changes(self) -> bool:
        """True if the check cannot be judged without tables of changes."""
        return self.condition is None and self.name in {*figures.OF_CHANGES, *figures.OF_MAPS}

    @property
    def needs_zones(self) -> bool:
        """True if the check cannot be judged without tables of zones."""
        return self.name == "events" if self.condition else figures.zone_of(self.name) is not None

    def admits(self, value: float) -> bool:
        """Return True if a value is as expected."""
        if self.sign == "between":
            return self.low <= value <= self.high
        return bool(COMPARE[self.sign](value, self.low))


_COMPARISON = re.compile(r"\s*(==|!=|<=|>=|<|>|\bbetween\b)[^=!<>]*$")
"""The end of a check, from its comparison on."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of a check."""

    expression: str
    expected: str
    found: float | None
    """Value that was measured; None where there was none, and the check does not hold."""
    holds: bool

    def as_dict(self) -> dict[str, Any]:
        """Return the result as plain values."""
        told = {"check": self.expression, "holds": self.holds, "expected": self.expected}
        return told | {"found": figures.plain_number(self.found)}

    @property
    def failure(self) -> str:
        """The check and why it fails, for people."""
        found = "has nothing to measure" if self.found is None else f"is {self.words}"
        return f"{_COMPARISON.sub('', self.expression)} {found}, expected {self.expected}"

    @property
    def words(self) -> str:
        """Value that was found, for people."""
        if self.found is None:
            return "nothing to measure"
        return f"{self.found:,.0f}" if self.found == int(self.found) else f"{self.found:.6g}"


def parse_check(
    expression: str,
    compared: bool = False,
    only: Collection[str] | None = None,
    rows: Collection[str] | None = None,
    zones: Collection[str] | None = None,
    page: str = "docs/reports.md",
) -> Check:
    """Understand a check.

    Parameters
    ----------
    compared : whether there is a baseline
    only : the figures that there are beside those of zones, where the check is not about tables of `detect`
    rows : the tables whose rows can be counted; by default all, with `only` none
    zones : the zones that there are; where that is not known yet, a zone may have any name
    page : page of the documentation that lists these

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
        if zones is not None:
            _refuse_of_objects(tokens, token)
        raise _unknown(tokens, token, only, page, zones or ())
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
    # Tracks tables that could not be read leave nothing to measure.
    return verdict_of(check, values.get(check.name) if check.condition is None else _count(check, check.condition, run))


def verdict_of(check: Check, found: float | None) -> Verdict:
    """Hold a check against what was found; None where there was nothing to measure."""
    holds = found is not None and check.admits(found)
    return Verdict(check.expression, f"{check.expected}", found, holds)


def _count(check: Check, condition: Condition, run: Run) -> float | None:
    """Return the number of rows for which a condition holds; None without the table."""
    if check.name == "events":
        return None if run.zones is None else count_events(condition, run.zones)
    rows = {"objects": run.objects, "sweeps": run.sweeps, "tracks": run.tracks}[check.name]
    if rows is None:
        return None
    chosen = condition.holds(rows)
    if check.name == "objects":
        # Walls, and what has gone from a background, count only where the condition asks for them.
        chosen &= run.is_object | _asked_for(condition, run)
    return float(chosen.sum())


def count_events(condition: Condition, watched: Watched) -> float | None:
    """Return the number of events for which a condition holds; None if no zone was ever observed."""
    if not watched.zones.numbers("observed").any():
        return None
    return float(condition.holds(watched.events).sum())


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
    if token.text.startswith(figures.DELTA) and not compared:
        raise tokens.error(f"{token.text} needs a --baseline to compare with;")


def _known(tokens: Tokens, token: Token, compared: bool, zones: Collection[str] | None) -> None:
    """Refuse a figure that no tables of objects or changes have."""
    name = token.text
    plain = name.removeprefix(figures.DELTA)
    names = [*figures.names(), *figures.track_names()]
    of_changes = [*figures.OF_CHANGES, *figures.OF_MAPS]
    if name in of_changes:
        return
    spreads = figures.SPREADS | figures.TRACK_SPREADS
    if plain in names or name in figures.COMPARED:
        if not compared and (name != plain or name in figures.COMPARED):
            raise tokens.error(f"{name} needs a --baseline to compare with;")
        return
    if plain in spreads:
        raise tokens.error(f"{name} has several values, choose one of .{', .'.join(STATISTICS)};")
    known = [*names, *spreads]
    delta = [*figures.COMPARED, *(figures.DELTA + other for other in known)]
    raise _unknown(tokens, token, dict.fromkeys([*known, *of_changes, *delta]), zones=zones)


def _refuse_of_objects(tokens: Tokens, token: Token) -> None:
    """Refuse a figure of tables of objects where there are those of zones alone."""
    name = token.text.removeprefix(figures.DELTA)
    maker = "track" if name in figures.track_names() else "detect or track" if name in figures.names() else ""
    if maker:
        raise tokens.error(
            f"unknown figure '{name}' of zones; it is of the tables of lidarcli {maker}, which report takes beside these;",
            token,
        )


def _unknown(
    tokens: Tokens, token: Token, known: Collection[str], page: str = "docs/reports.md", zones: Collection[str] | None = ()
) -> OptionError:
    """Return the error of an unknown figure; `zones` as of `parse_check`."""
    hint = nearest(token.text, known, OFFERED) or ";"
    zone, zoned = token.text.partition(".")[0], f"{figures.ZONES}{token.text}"
    if zoned in figures.zone_names(zone) and (zones is None or zone in zones):
        hint = f"; did you mean {zoned}?"
    return tokens.error(f"unknown figure '{token.text}'{hint} {page} has all;", token)
