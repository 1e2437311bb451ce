"""Conditions on the rows of a table: `width > 0.5 and moving and not (shape == prismatic or track is null)`."""

from __future__ import annotations

import difflib
import operator
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lidarcli.columns import Column
from lidarcli.errors import OptionError
from lidarcli.reports.columns import BEAMS_OF_OBJECTS, OBJECTS_OF_SWEEP, Rows
from lidarcli.sweeps import Bool, Float64
from lidarcli.tabular.schemas import TABLES

_TOKEN = re.compile(
    r"""\s*(?:
    (?P<number>[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.]))
  | (?P<name>(?:(?:delta\.)?zones\.[\w-]+|[A-Za-z_]\w*)(?:\.[A-Za-z_]\w*)*)
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
COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
COUNTED = {name: {one.name: one for one in TABLES[name]} for name in ("objects", "sweeps", "tracks", "events")}
"""The tables whose rows can be counted, and their columns by name."""
ALIASES = {
    "objects": {"range_min": "r_min", "range": "r_min", "bearing": "theta_min"},
    "sweeps": dict[str, str](),
    "tracks": dict[str, str](),
    "events": dict[str, str](),
}
"""Table → other names of its columns."""
SUMS = {"sweeps": {"objects": OBJECTS_OF_SWEEP, "object_beams": BEAMS_OF_OBJECTS}}
"""Table → name → columns that it sums up: a name means the same in checks of figures and of rows."""
CLOSE = 0.7
"""Least likeness (difflib) of a name that may have been meant."""
DEEPEST = 50
"""Most brackets that are open at once in a condition."""
TRUTH = {"true": True, "false": False}
KEYWORDS = frozenset({"and", "or", "not", "between", "is", "null", "where", *TRUTH})
Truths = tuple[Bool, Bool]
"""(K,) values, and (K,) True where they are known: a comparison with null is neither true nor false."""


@dataclass(frozen=True, slots=True)
class Token:
    """One word of a check and where it begins."""

    kind: str
    """`number`, `name`, `operator`, `bracket`, `text` or `end`."""
    text: str
    place: int


class Tokens:
    """The words of one check, read from left to right."""

    def __init__(self, expression: str) -> None:
        self.expression = expression
        if len(expression) > LONGEST_CHECK:
            raise OptionError(
                f"--check '{expression[:20]}...': {len(expression):,} characters are more than a check may have "
                f"({LONGEST_CHECK:,})"
            )
        self._all = self._split()
        self._at = 0

    @property
    def next(self) -> Token:
        """The word that comes next."""
        return self._all[self._at]

    @property
    def after_next(self) -> Token:
        """The word after that."""
        return self._all[min(self._at + 1, len(self._all) - 1)]

    def take(self) -> Token:
        """Take the next word."""
        token = self.next
        self._at = min(self._at + 1, len(self._all) - 1)
        return token

    def take_if(self, *texts: str) -> str | None:
        """Take the next word if it is one of these keywords or signs."""
        if self.next.kind in ("name", "operator", "bracket") and self.next.text in texts:
            return self.take().text
        return None

    def expect(self, kind: str, wanted: str) -> Token:
        """Take the next word, which has to be of this kind."""
        if self.next.kind != kind:
            raise self.error(f"expected {wanted}")
        return self.take()

    def error(self, problem: str, token: Token | None = None) -> OptionError:
        """Return the error of this check at the next word, or at the one given."""
        at = token or self.next
        where = "at the end" if at.kind == "end" else f"at '{at.text}', column {at.place + 1}"
        shown = self.expression if len(self.expression) <= SHOWN_OF_CHECK else f"{self.expression[:SHOWN_OF_CHECK]}..."
        return OptionError(f"--check '{shown}': {problem} {where}")

    def _split(self) -> list[Token]:
        text, place, found = self.expression.rstrip(), 0, []
        while place < len(text):
            match = _TOKEN.match(text, place)
            if match is None:
                start = place + len(text[place:]) - len(text[place:].lstrip())
                raise self.error("cannot be read", Token("unknown", text[start], start))
            kind = str(match.lastgroup)
            found.append(Token("text" if kind in ("double", "single") else kind, match[kind], match.start(kind)))
            place = match.end()
        return [*found, Token("end", "", len(self.expression))]


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition: the columns that it needs, and its function of rows."""

    columns: frozenset[str]
    judge: Callable[[Rows], Truths]

    def holds(self, rows: Rows) -> Bool:
        """Return (K,) rows for which the condition is known to hold."""
        value, known = self.judge(rows)
        return value & known


def column_names(table: str) -> list[str]:
    """Return the columns of a table that a condition may name."""
    return [name for name, one in COUNTED[table].items() if one.kind != "stamp"]


def parse_condition(tokens: Tokens, table: str, depth: int = 0) -> Condition:
    """Parse `term or term or ...` to its end; `depth` brackets are open."""
    found = [_term(tokens, table, depth)]
    while tokens.take_if("or"):
        found.append(_term(tokens, table, depth))
    return found[0] if len(found) == 1 else _any_of(found)


def _term(tokens: Tokens, table: str, depth: int) -> Condition:
    found = [_factor(tokens, table, depth)]
    while tokens.take_if("and"):
        found.append(_factor(tokens, table, depth))
    return found[0] if len(found) == 1 else _all_of(found)


def _factor(tokens: Tokens, table: str, depth: int) -> Condition:
    negated = False
    while tokens.take_if("not"):
        negated = not negated
    found = _plain_factor(tokens, table, depth)
    return _negated(found) if negated else found


def _plain_factor(tokens: Tokens, table: str, depth: int) -> Condition:
    if not tokens.take_if("("):
        return _comparison(tokens, table)
    if depth == DEEPEST:
        raise tokens.error(f"more than {DEEPEST} brackets are open")
    found = parse_condition(tokens, table, depth + 1)
    if not tokens.take_if(")"):
        raise tokens.error("expected ')'")
    return found


def _comparison(tokens: Tokens, table: str) -> Condition:
    name = _column(tokens, table)
    column = COUNTED[table][name]
    if tokens.take_if("is"):
        wanted = tokens.take_if("not") is None
        if not tokens.take_if("null"):
            raise tokens.error("expected null")
        return _null(name, wanted)
    if column.kind == "text":
        return _word(tokens, column)
    if column.kind == "bool":
        return _truth(tokens, name)
    summed = SUMS.get(table, {}).get(name, (name,))
    if tokens.take_if("between"):
        low, high = read_limits(tokens)
        return _number(summed, lambda values: (values >= low) & (values <= high))
    sign = tokens.expect("operator", f"a comparison ({', '.join(COMPARE)}, between, is) of {name}").text
    limit = read_number(tokens)
    return _number(summed, lambda values: COMPARE[sign](values, limit))


def _column(tokens: Tokens, table: str) -> str:
    token = tokens.next
    aliases = ALIASES[table]
    known = column_names(table)
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

    def judge(rows: Rows) -> Truths:
        codes, names = rows.words(name)
        equal = codes == names.index(token.text) if token.text in names else np.zeros(len(codes), bool)
        return (equal if sign == "==" else ~equal), codes >= 0

    return Condition(frozenset({name}), judge)


def _truth(tokens: Tokens, name: str) -> Condition:
    """Parse `moving`, `moving == true`, `moving != false`; a sign before anything else belongs to the check."""
    wanted = True
    if tokens.next.text in ("==", "!=") and tokens.after_next.text in TRUTH:
        equal = tokens.take().text == "=="
        wanted = TRUTH[tokens.take().text] == equal
    return _number((name,), lambda values: (values != 0) == wanted)


def _number(names: Sequence[str], test: Callable[[Float64], Bool]) -> Condition:
    """Return the condition that a test of a column holds, or of the sum of some columns."""

    def judge(rows: Rows) -> Truths:
        values = rows.total(names)
        return test(values), ~np.isnan(values)

    return Condition(frozenset(names), judge)


def _null(name: str, wanted: bool) -> Condition:
    def judge(rows: Rows) -> Truths:
        null = rows.table[name].is_null().to_numpy(zero_copy_only=False).astype(bool)
        return null == wanted, np.ones(len(rows), bool)

    return Condition(frozenset({name}), judge)


def _negated(one: Condition) -> Condition:
    def judge(rows: Rows) -> Truths:
        value, known = one.judge(rows)
        return ~value, known

    return Condition(one.columns, judge)


def _all_of(conditions: Sequence[Condition]) -> Condition:
    """Join conditions by `and`: known to be false where one is, known to be true where all are."""

    def judge(rows: Rows) -> Truths:
        true, false = np.ones(len(rows), bool), np.zeros(len(rows), bool)
        for condition in conditions:
            value, known = condition.judge(rows)
            true &= value & known
            false |= ~value & known
        return true, true | false

    return Condition(_columns(conditions), judge)


def _any_of(conditions: Sequence[Condition]) -> Condition:
    """Join conditions by `or`: known to be true where one is, known to be false where all are."""
    return _negated(_all_of([*map(_negated, conditions)]))


def _columns(conditions: Sequence[Condition]) -> frozenset[str]:
    return frozenset().union(*(condition.columns for condition in conditions))


def read_number(tokens: Tokens) -> float:
    """Take the number that comes next."""
    return float(tokens.expect("number", "a number").text)


def read_limits(tokens: Tokens) -> tuple[float, float]:
    """Take `A and B`, after `between`."""
    first = tokens.next
    low = read_number(tokens)
    if not tokens.take_if("and"):
        raise tokens.error("expected 'and'")
    high = read_number(tokens)
    if low > high:
        raise tokens.error(f"{low:g} is above {high:g}: nothing is between them,", first)
    return low, high
