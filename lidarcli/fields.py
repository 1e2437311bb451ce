"""Taking values out of a TOML table, with one clear line for whatever is wrong with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from math import isfinite
from typing import NoReturn

from lidarcli.errors import OptionError

LARGEST = 1e6
"""Most that a number of a file may be from 0 [m], [m/s], [degrees] ...: no sensor reaches farther."""


class Fields:
    """One table of a file. Every key must be taken by somebody before `done`."""

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
        """True where any of the keys is given."""
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
        """A finite number within the limits; without a default the key must be there."""
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
                for limit, text in (
                    (low, f"at least {low}"),
                    (above, f"above {above}"),
                    (high, f"at most {high}"),
                )
                if limit is not None
            ]
            self.fail(key, f"must be {' and '.join(limits)}, not {_short(value)}")
        return float(value)

    def whole(self, key: str, default: int | None = None, *, low: int, high: int) -> int:
        """A whole number within the limits."""
        value = self.number(key, default, low=low, high=high, largest=max(LARGEST, high))
        if value != int(value):
            self.fail(key, f"must be a whole number, not {value}")
        return int(value)

    def text(self, key: str, default: str | None = None, choices: Sequence[str] = ()) -> str:
        """A text, one of `choices` where there are any; without a default the key must be there."""
        value = self._take(key, default)
        if not isinstance(value, str) or (not value and not choices):
            self.fail(key, f"must be a text, not {_kind(value)}")
        if choices and value not in choices:
            self.fail(key, f"must be one of {', '.join(choices)}, not '{value}'")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """true or false."""
        value = self._take(key, default)
        if not isinstance(value, bool):
            self.fail(key, f"must be true or false, not {_kind(value)}")
        return value

    def pair(self, key: str, default: tuple[float, float]) -> tuple[float, float]:
        """Two numbers."""
        value = self._take(key, list(default))
        numbers = _numbers(value)
        if numbers is None or len(numbers) != 2:
            self.fail(key, "must be two finite numbers, as [0.5, -1.0]")
        self._refuse_large(key, [numbers])
        return numbers[0], numbers[1]

    def numbers(self, key: str, *, above: float, high: float) -> list[float]:
        """A list of numbers within the limits."""
        value = self._take(key, None)
        numbers = _numbers(value)
        if not numbers:
            self.fail(key, "must be a list of finite numbers, as [0.5, 1.0]")
        for number in numbers:
            if not above < number <= high:
                self.fail(
                    key,
                    f"must hold numbers above {above:g} and at most {high:g}, not {_short(number)}",
                )
        return numbers

    def points(self, key: str, least: int) -> list[list[float]]:
        """At least so many points of two numbers each."""
        value = self._take(key, None)
        rows = [_numbers(item) for item in value] if isinstance(value, list) else []
        points = [row for row in rows if row is not None and len(row) == 2]
        if len(points) < max(least, len(rows), 1):
            self.fail(key, f"must be a list of at least {least} points, as [[0, 0], [2.5, 0]]")
        self._refuse_large(key, points)
        return points

    def items(self, key: str, least: int, most: int) -> list[object]:
        """A list of so many values."""
        value = self._take(key, None)
        if not isinstance(value, list) or not least <= len(value) <= most:
            self.fail(key, f"must be a list of {least:,} to {most:,} values")
        return value

    def table(self, key: str) -> Fields:
        """A table inside this one; an empty one where it is not given."""
        return Fields(self.file, self.inside(key), self._take(key, {}))

    def inside(self, key: str) -> str:
        """The place of what stands under a key."""
        return f"{self.place[:-1]}.{key}]" if self.place.endswith("]") else f"{self.place}, {key}"

    def done(self) -> None:
        """Refuse keys that nobody asked for: most often they are misspelt."""
        for key in self.values:
            if key not in self.asked:
                near = get_close_matches(key, self.asked, 1)
                hint = f"did you mean '{near[0]}'?" if near else f"known keys: {', '.join(self.asked)}"
                raise OptionError(f"{self.file}: {self.place}: unknown key '{key}'; {hint}")

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
    """The list as floats, None where it holds anything else."""
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
    """A number as the file has it, one of very many digits by its length."""
    return str(value) if abs(value) < 10**30 else f"{value:g}" if isinstance(value, float) else "a longer one"


def _kind(value: object) -> str:
    """What a TOML user would call the value."""
    if isinstance(value, bool):
        return "true or false"
    if isinstance(value, str):
        return f"the text '{value}'"
    if isinstance(value, list):
        return "a list"
    if isinstance(value, Mapping):
        return "a table"
    return repr(value)
