"""TOML files that a user wrote: read within bounds, and their values checked, with one clear line for each error."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from lidarcli.display.texts import clipped, nearest
from lidarcli.errors import OptionError, UnreadableError

if TYPE_CHECKING:
    from ruamel.yaml.nodes import Node, ScalarNode

MAX_DEPTH = 16
"""Most levels of brackets, and of the parts of a dotted key."""
_TEXTS = r""""(?:\\.|[^"\\\n])*"?|'[^'\n]*'?|\#[^\n]*"""
_BETWEEN_KEYS = r"[^\w \t.-]"


def read_toml(file: str, what: str) -> dict[str, Any]:
    """Read a TOML file, which errors call a `what` (scene, catalogue)."""
    import tomllib

    text = read_text(file, what, "TOML")
    _refuse_nested(file, text)
    try:
        return tomllib.loads(text)
    except ValueError as err:
        raise UnreadableError(f"{file}: not valid TOML: {err}") from err


def read_text(file: str, what: str, language: str, most: int = 1_000_000) -> str:
    """Read the text of a file, a `what` in a `language`, of `most` bytes at most."""
    try:
        with Path(file).open("rb") as opened:
            data = opened.read(most + 1)
    except OSError as err:
        raise UnreadableError(f"{file}: cannot read the {what}: {err.strerror or err}") from err
    if len(data) > most:
        raise UnreadableError(f"{file}: larger than a {what} may be ({most:,} bytes)")
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as err:
        raise UnreadableError(f"{file}: byte {err.start}: not UTF-8 text; a {what} is a {language} file") from err


def _refuse_nested(file: str, text: str) -> None:
    """Refuse a document that would take the parser far more memory than its size."""
    depth = 0
    # With a letter in place of each text, and without comments.
    for number, line in enumerate(re.sub(_TEXTS, "x", text).split("\n"), 1):
        if any(part.count(".") > MAX_DEPTH for part in re.split(_BETWEEN_KEYS, line)):
            raise UnreadableError(f"{file}: line {number}: a key of more than {MAX_DEPTH} parts")
        for mark in line:
            depth += (mark in "[{") - (mark in "]}")
            if depth > MAX_DEPTH:
                raise UnreadableError(f"{file}: line {number}: more than {MAX_DEPTH} brackets are open")


LARGEST = 1e6
"""Greatest magnitude of a number [m], [m/s], [degrees] ...: no sensor reaches farther."""


class Fields:
    """One table of a file. Every key must be read before `done`."""

    def __init__(self, file: str, place: str, values: object) -> None:
        self.file, self.place = file, place
        self.asked: list[str] = []
        if not isinstance(values, Mapping):
            raise OptionError(f"{file}: {place} must be a table of keys, not {_kind(values)}")
        self.values: Mapping[str, object] = values

    def fail(self, key: str, cause: str) -> NoReturn:
        """Refuse the value of `key`."""
        raise OptionError(f"{self.file}: {self.place}: '{key}' {cause}")

    def has(self, *keys: str) -> bool:
        """Return whether any of the keys is given."""
        self.asked += keys
        return any(key in self.values for key in keys)

    def number(
        self,
        key: str,
        default: float | None = None,
        *,
        low: float | None = None,
        high: float | None = None,
        above: float | None = None,
        largest: float = LARGEST,
    ) -> float:
        """Return a finite number within the limits; without a default the key must be there."""
        value = self._take(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.fail(key, f"must be a number, not {_kind(value)}")
        # A whole number of TOML may have more digits than a float can take.
        if not isinstance(value, int) and not isfinite(value):
            self.fail(key, f"must be finite, not {value}")
        if abs(value) > largest and (high is None or high > largest):
            self.fail(key, f"must be between {-largest:g} and {largest:g}, not {_short(value)}")
        if (
            (low is not None and value < low)
            or (high is not None and value > high)
            or (above is not None and value <= above)
        ):
            limits = [
                text
                for limit, text in ((low, f"at least {low}"), (above, f"above {above}"), (high, f"at most {high}"))
                if limit is not None
            ]
            self.fail(key, f"must be {' and '.join(limits)}, not {_short(value)}")
        return float(value)

    def whole(self, key: str, default: int | None = None, *, low: int, high: int) -> int:
        """Return a whole number within the limits."""
        value = self.number(key, default, low=low, high=high, largest=max(LARGEST, high))
        if value != int(value):
            self.fail(key, f"must be a whole number, not {value}")
        return int(value)

    def text(self, key: str, default: str | None = None, choices: Sequence[str] = ()) -> str:
        """Return a text, one of `choices` if there are any; without a default the key must be there."""
        value = self._take(key, default)
        if not isinstance(value, str) or (not value and not choices):
            self.fail(key, f"must be a text, not {_kind(value)}")
        if choices and value not in choices:
            self.fail(key, f"must be one of {', '.join(choices)}, not '{clipped(value)}'")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self._take(key, default)
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, not {_kind(value)}")
        return value

    def pair(self, key: str, default: tuple[float, float]) -> tuple[float, float]:
        """Return two numbers."""
        value = self._take(key, list(default))
        numbers = _numbers(value)
        if numbers is None or len(numbers) != 2:
            self.fail(key, "must be two finite numbers, as [0.5, -1.0]")
        self._refuse_large(key, [numbers])
        return numbers[0], numbers[1]

    def numbers(self, key: str, *, above: float, high: float) -> list[float]:
        """Return a list of numbers within the limits."""
        value = self._take(key, None)
        numbers = _numbers(value)
        if not numbers:
            self.fail(key, "must be a list of finite numbers, as [0.5, 1.0]")
        for number in numbers:
            if not above < number <= high:
                self.fail(key, f"must hold numbers above {above:g} and at most {high:g}, not {_short(number)}")
        return numbers

    def points(self, key: str, least: int) -> list[list[float]]:
        """Return a list of at least so many points of two numbers each."""
        value = self._take(key, None)
        rows = [_numbers(item) for item in value] if isinstance(value, list) else []
        points = [row for row in rows if row is not None and len(row) == 2]
        if len(points) < max(least, len(rows), 1):
            self.fail(key, f"must be a list of at least {least} points of finite numbers, as [[0, 0], [2.5, 0]]")
        self._refuse_large(key, points)
        return points

    def items(self, key: str, least: int, most: int) -> list[object]:
        """Return a list of so many values."""
        value = self._take(key, None)
        if not isinstance(value, list) or not least <= len(value) <= most:
            self.fail(key, f"must be a list of {least:,} to {most:,} values")
        return value

    def table(self, key: str) -> Fields:
        """Return a table inside this one, an empty one where it is not given."""
        return Fields(self.file, self.inside(key), self._take(key, {}))

    def inside(self, key: str) -> str:
        """Return the place of a key, for messages."""
        return f"{self.place[:-1]}.{key}]" if self.place.endswith("]") else f"{self.place}, {key}"

    def done(self) -> None:
        """Refuse keys that were not read: most often they are misspelt."""
        for key in self.values:
            if key not in self.asked:
                near = nearest(key, self.asked)
                hint = f"did you mean '{near[0]}'?" if near else f"known keys: {', '.join(self.asked)}"
                raise OptionError(f"{self.file}: {self.place}: unknown key '{clipped(key)}'; {hint}")

    def _refuse_large(self, key: str, points: Sequence[Sequence[float]]) -> None:
        largest = max((abs(value) for point in points for value in point), default=0.0)
        if largest > LARGEST:
            self.fail(key, f"must hold numbers between {-LARGEST:g} and {LARGEST:g}, not {_short(largest)}")

    def _take(self, key: str, default: object) -> object:
        self.asked.append(key)
        value = self.values.get(key, default)
        if value is None:
            raise OptionError(f"{self.file}: {self.place}: '{key}' is missing")
        return value


def _numbers(value: object) -> list[float] | None:
    """Return the list as floats, None where it holds anything else."""
    if not isinstance(value, list):
        return None
    if any(isinstance(item, bool) or not isinstance(item, int | float) for item in value):
        return None
    try:
        numbers = [float(item) for item in value]
    except OverflowError:
        return None
    return numbers if all(map(isfinite, numbers)) else None


def _short(value: float) -> str:
    """Return the text of a number; one of very many digits is only called long."""
    return str(value) if abs(value) < 10**30 else f"{value:g}" if isinstance(value, float) else "a longer one"


def _kind(value: object) -> str:
    """Return the name of the kind of a value, as a user of TOML knows it."""
    if isinstance(value, bool):
        return "true or false"
    if isinstance(value, str):
        return f"the text '{clipped(value)}'"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, Mapping):
        return "a table"
    return repr(value)


_TRUTHS = {
    spelling: truth
    for words, truth in (("y yes true on", True), ("n no false off", False))
    for word in words.split()
    for spelling in (word, word.title(), word.upper())
}
_INTEGER = r"[-+]?(?:0[0-7]*|0[xX][0-9a-fA-F]+|[1-9][0-9]*)"
_MAX_DIGITS = 64
_DOUBLE = (
    r"(?i)[-+]?(?:inf(?:inity)?|nan(?:\(\w*\))?|0x(?:[0-9a-f]+\.?[0-9a-f]*|\.[0-9a-f]+)(?:p[-+]?[0-9]+)?"
    r"|(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[-+]?[0-9]+)?)"
)
"""What the C function `strtod` takes as a whole."""
_DOTTED = r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN)"
_STRING = r"(?:&\S+\s+)?!(?:!str|<tag:yaml\.org,2002:str>)(?!\w)"
_LEAST = 2.2250738585072014e-308
"""Least normal double: `strtod` tells of an error below it, and beyond the greatest one."""


def read_yaml(file: str, what: str) -> dict[str, Any]:
    """Read a YAML file, a `what`, into plain values; as in ROS without aliases, a few lines of which can take hours."""
    from ruamel.yaml import YAML
    from ruamel.yaml.nodes import MappingNode

    # All parameters of Nav2 take some 20,000 bytes, and parsing is slow.
    text = read_text(file, what, "YAML", most=1 << 17)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            root = YAML(typ="safe", pure=True).compose(text)
    except RecursionError as err:
        raise UnreadableError(f"{file}: more than {MAX_DEPTH} levels") from err
    # Whatever the parser stumbles over, the file is at fault: it may come from anywhere.
    except Exception as err:
        raise UnreadableError(f"{file}: not valid YAML: {_reason(err)}") from err
    if not isinstance(root, MappingNode):
        raise UnreadableError(f"{file}: not valid YAML of a {what}: it has no keys")
    values: dict[str, Any] = _value(file, text, root, set(), 0)
    return values


def _value(file: str, source: str, node: Node, above: set[int], depth: int) -> Any:
    """Return the value of a node of the text `source`."""
    from ruamel.yaml.nodes import MappingNode, ScalarNode, SequenceNode

    place = f"{file}: line {node.start_mark.line + 1}"
    if id(node) in above:
        raise UnreadableError(f"{place}: an anchor that is used twice, which ROS does not know")
    if depth > MAX_DEPTH:
        raise UnreadableError(f"{place}: more than {MAX_DEPTH} levels")
    above.add(id(node))
    if isinstance(node, ScalarNode):
        return _scalar(node, is_text=re.compile(_STRING).match(source, node.start_mark.index) is not None)
    if isinstance(node, SequenceNode):
        return [_value(file, source, item, above, depth + 1) for item in node.value]
    assert isinstance(node, MappingNode)
    values: dict[str, Any] = {}
    for key, value in node.value:
        name = str(key.value) if isinstance(key, ScalarNode) else ""
        if not name:
            raise UnreadableError(f"{place}: a key that is no name")
        if name in values:
            raise UnreadableError(f"{file}: line {key.start_mark.line + 1}: key '{name}' is there twice")
        values[name] = _value(file, source, value, above, depth + 1)
    return values


def _scalar(node: ScalarNode, is_text: bool) -> Any:
    """Return a text, number or boolean as the parser of ROS 2 does (rcl_yaml_param_parser, `get_value`); None for nothing.

    This one looks at no tag but `!!str`, and takes a number that is out of range for a text.
    """
    text = str(node.value)
    if is_text or node.style in ("'", '"'):
        return text
    if not text:
        return None
    if text in _TRUTHS:
        return _TRUTHS[text]
    if re.fullmatch(_INTEGER, text) and len(text) <= _MAX_DIGITS:
        digits = text.lower().lstrip("+-")
        number = int(text, 16 if digits.startswith("0x") else 8 if digits.startswith("0") else 10)
        if -(1 << 63) <= number < 1 << 63:
            return number
    if re.fullmatch(_DOTTED, text):
        return float(text.replace(".", ""))
    if re.fullmatch(_DOUBLE, text):
        plain = text.lower().partition("(")[0]
        mantissa = plain.partition("p" if "x" in plain else "e")[0]
        with suppress(OverflowError):
            value = float.fromhex(plain) if "x" in plain else float(plain)
            in_range = isfinite(value) and (abs(value) >= _LEAST or not set(mantissa) & set("123456789abcdef"))
            if "n" in plain or in_range:
                return value
    return text


def _reason(err: Exception) -> str:
    """Return the cause that a parser reports, in one line, with the place."""
    mark = getattr(err, "problem_mark", None)
    given = [text for name in ("context", "problem") if (text := getattr(err, name, None))]
    if mark is None or not given:
        return " ".join(str(err).split()) or type(err).__name__
    return f"line {mark.line + 1}: {', '.join(given)}"
