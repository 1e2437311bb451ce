"""Conditions on the rows of a table: `width > 0.5 and not (shape == prismatic or track is null)`."""

from __future__ import annotations

import operator
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa

from lidarcli.formalism.detection import SETS, SHAPES, VISIBILITIES
from lidarcli.reports.columns import Rows
from lidarcli.reports.tokens import Tokens
from lidarcli.sweeps import Bool, Float64
from lidarcli.tables.schemas import OBJECTS, SWEEPS

COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "==": operator.eq,
    "!=": operator.ne,
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
ALIASES = {"range_min": "r_min", "range": "r_min", "bearing": "theta_min"}
"""Other names of columns of the objects table."""
VOCABULARY = {
    "set": SETS,
    "shape": SHAPES,
    "visibility": VISIBILITIES,
    "change": ("appeared", "removed"),
}
KEYWORDS = frozenset({"and", "or", "not", "between", "is", "null", "where"})

Verdict = tuple[Bool, Bool]
"""(K,) what holds, and what is known: a comparison with null is neither true nor false."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A condition: the columns it needs and what it says of rows."""

    columns: frozenset[str]
    judge: Callable[[Rows], Verdict]

    def holds(self, rows: Rows) -> Bool:
        """(K,) rows for which the condition is known to hold."""
        value, known = self.judge(rows)
        return value & known


def column_names(schema: pa.Schema) -> list[str]:
    """The columns that a condition may name."""
    return [field.name for field in schema if not pa.types.is_timestamp(field.type)]


def parse_condition(tokens: Tokens, schema: pa.Schema) -> Condition:
    """`term or term or ...`; stops where the condition ends."""
    found = _term(tokens, schema)
    while tokens.take_if("or"):
        found = _either(found, _term(tokens, schema))
    return found


def _term(tokens: Tokens, schema: pa.Schema) -> Condition:
    found = _factor(tokens, schema)
    while tokens.take_if("and"):
        found = _both(found, _factor(tokens, schema))
    return found


def _factor(tokens: Tokens, schema: pa.Schema) -> Condition:
    if tokens.take_if("not"):
        return _negated(_factor(tokens, schema))
    if tokens.take_if("("):
        found = parse_condition(tokens, schema)
        if not tokens.take_if(")"):
            raise tokens.error("expected ')'")
        return found
    return _comparison(tokens, schema)


def _comparison(tokens: Tokens, schema: pa.Schema) -> Condition:
    name = _column(tokens, schema)
    kind = schema.field(name).type
    if tokens.take_if("is"):
        wanted = tokens.take_if("not") is None
        if not tokens.take_if("null"):
            raise tokens.error("expected null")
        return _null(name, wanted)
    if pa.types.is_dictionary(kind):
        return _word(tokens, name)
    if tokens.take_if("between"):
        low, high = between(tokens)
        return _number(name, lambda values: (values >= low) & (values <= high))
    sign = tokens.expect("operator", f"a comparison ({', '.join(COMPARE)}, between, is) of {name}").text
    limit = number(tokens)
    return _number(name, lambda values: COMPARE[sign](values, limit))


def _column(tokens: Tokens, schema: pa.Schema) -> str:
    token = tokens.next
    known = column_names(schema)
    name = ALIASES.get(token.text, token.text) if schema is OBJECTS else token.text
    if token.kind != "name" or token.text in KEYWORDS or name not in known:
        table = "objects" if schema is OBJECTS else "sweeps"
        what = (
            "unknown column" if token.kind == "name" and token.text not in KEYWORDS else "expected a column"
        )
        aliases = [*ALIASES] if schema is OBJECTS else []
        raise tokens.error(f"{what} of {table} ({', '.join([*known, *aliases])})")
    tokens.take()
    return name


def _word(tokens: Tokens, name: str) -> Condition:
    sign = tokens.take_if("==", "!=")
    if sign is None:
        raise tokens.error(f"expected ==, != or is (column {name} holds names)")
    token = tokens.next
    known: Collection[str] = VOCABULARY.get(name, ())
    choice = f" ({', '.join(known)})" if known else ""
    if token.kind not in ("name", "text", "number"):
        raise tokens.error(f"expected a value of {name}{choice}")
    if known and token.text not in known:
        raise tokens.error(f"unknown {name}{choice}")
    tokens.take()

    def judge(rows: Rows) -> Verdict:
        codes, names = rows.words(name)
        equal = codes == names.index(token.text) if token.text in names else np.zeros(len(codes), bool)
        return (equal if sign == "==" else ~equal), codes >= 0

    return Condition(frozenset({name}), judge)


def _number(name: str, test: Callable[[Float64], Bool]) -> Condition:
    def judge(rows: Rows) -> Verdict:
        values = rows.numbers(name)
        return test(values), ~np.isnan(values)

    return Condition(frozenset({name}), judge)


def _null(name: str, wanted: bool) -> Condition:
    def judge(rows: Rows) -> Verdict:
        null = rows.table[name].is_null().to_numpy(zero_copy_only=False).astype(bool)
        return null == wanted, np.ones(len(rows), bool)

    return Condition(frozenset({name}), judge)


def _negated(one: Condition) -> Condition:
    def judge(rows: Rows) -> Verdict:
        value, known = one.judge(rows)
        return ~value, known

    return Condition(one.columns, judge)


def _both(one: Condition, other: Condition) -> Condition:
    def judge(rows: Rows) -> Verdict:
        (a, a_known), (b, b_known) = one.judge(rows), other.judge(rows)
        return a & b, (a_known & b_known) | (a_known & ~a) | (b_known & ~b)

    return Condition(one.columns | other.columns, judge)


def _either(one: Condition, other: Condition) -> Condition:
    def judge(rows: Rows) -> Verdict:
        (a, a_known), (b, b_known) = one.judge(rows), other.judge(rows)
        return (a & a_known) | (b & b_known), (a_known & b_known) | (a & a_known) | (b & b_known)

    return Condition(one.columns | other.columns, judge)


def number(tokens: Tokens) -> float:
    """The number that comes next."""
    return float(tokens.expect("number", "a number").text)


def between(tokens: Tokens) -> tuple[float, float]:
    """`A and B`, after `between`."""
    first = tokens.next
    low = number(tokens)
    if not tokens.take_if("and"):
        raise tokens.error("expected 'and'")
    high = number(tokens)
    if low > high:
        raise tokens.error(f"{low:g} is above {high:g}: nothing is between them,", first)
    return low, high


def schemas() -> Iterator[tuple[str, pa.Schema]]:
    """Name and schema of the tables whose rows can be counted."""
    yield "objects", OBJECTS
    yield "sweeps", SWEEPS
