"""How a run has read its log, from the parameters in the metadata of its tables: what `reading_as_dict` wrote."""

from __future__ import annotations

from typing import Any

from lidarcli.choices import ECHOES
from lidarcli.judging import NO_RETURN_WORDS, RangeRules
from lidarcli.logs.base import MAX_BEAMS, OpenOptions, Slice
from lidarcli.pipeline.reading.reading import GEOMETRY
from lidarcli.tabular.reading import GREATEST_VALUE


def rules_of(parameters: dict[str, Any]) -> RangeRules:
    """How the run has judged ranges."""
    limits = parameters.get("range")
    no_return = parameters.get("no_return")
    if not isinstance(no_return, list):
        return RangeRules()
    known = isinstance(limits, list) and len(limits) == 2 and all(map(_is_number, limits))
    return RangeRules(
        no_return=frozenset(word for word in NO_RETURN_WORDS if word in no_return),
        markers=tuple(float(value) for value in no_return if _is_number(value)),
        limits=(float(limits[0]), float(limits[1])) if known and limits else None,
    )


def opening_of(parameters: dict[str, Any]) -> OpenOptions:
    """What the run has been told of its log."""
    told, echo = parameters.get("csv"), parameters.get("echo")
    told = told if isinstance(told, dict) else {}
    known: dict[str, Any] = {
        name: float(value) for name, value in told.items() if name in GEOMETRY and _is_number(value)
    }
    if echo in ECHOES:
        known["echo"] = echo
    heights, bins = parameters.get("slice"), parameters.get("bins")
    are_heights = isinstance(heights, list) and len(heights) == 2 and all(map(_is_number, heights))
    if are_heights and heights and isinstance(bins, int) and 0 < bins <= MAX_BEAMS:
        known["slice"] = Slice(float(heights[0]), float(heights[1]), bins, rules_of(parameters).limits)
    return OpenOptions(**known)


def _is_number(value: object) -> bool:
    """Whether a value of the metadata, which anybody may have written, is a number to compute with."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= GREATEST_VALUE
