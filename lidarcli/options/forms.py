"""The form of an option: what it takes, its limits and its default, for the command line and for Python."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral, Real
from typing import Any, get_args

from lidarcli.errors import OptionError
from lidarcli.options.choices import MAX_NUMBER
from lidarcli.system.records import dataclass, replace


@dataclass(frozen=True, slots=True)
class Number:
    """A number with limits, which the command line and Python check alike."""

    metavar: str
    """Placeholder in the help; it names the unit."""
    least: float = -MAX_NUMBER
    most: float = MAX_NUMBER
    above: bool = False
    """True to refuse `least` itself."""
    whole: bool = False
    count: int = 1
    """Count of such numbers that the option takes."""

    def parse(self, text: str) -> float:
        """Return the number that a text of the command line holds (`OptionError` if it holds none)."""
        try:
            number = int(text) if self.whole else float(text)
        except ValueError:
            raise OptionError(f"'{text}' is not a {'whole ' if self.whole else ''}number") from None
        if not self.whole and not math.isfinite(number):
            raise OptionError(f"'{text}' is not a finite number")
        self._check(number, text)
        return number

    def check(self, value: Any) -> None:
        """Refuse a value of Python that is no such number (`OptionError`)."""
        if not isinstance(value, Integral if self.whole else Real) or isinstance(value, bool):
            raise OptionError(f"{value!r} is no {'whole ' if self.whole else ''}number")
        if not math.isfinite(value):
            raise OptionError(f"{value} is not a finite number")
        self._check(value, f"{value:g}")  # type: ignore[arg-type]

    def _check(self, number: float, words: str) -> None:
        if not (number > self.least if self.above else number >= self.least):
            raise OptionError(f"{words} is {'not above' if self.above else 'below'} {self._words(self.least)}")
        if number > self.most:
            raise OptionError(f"{words} is above {self._words(self.most)}")

    def _words(self, limit: float) -> str:
        return str(limit) if self.whole else f"{limit:g}"


@dataclass(frozen=True, slots=True)
class Text:
    """A text, or what `parse` makes of it."""

    metavar: str
    parse: Callable[[str], Any] | None = None
    """Returns the value of a text; raises `OptionError`."""
    is_list: bool = False
    """True if a comma separates items within the text."""
    has_blanks: bool = False
    """True if the text may hold blanks: a variable of the environment then has one text per line."""

    @staticmethod
    def lost(text: str, *, is_alone: bool = True) -> str:
        """Return why a text is no value, else '': it is empty, or, where only one item is expected, it is an option."""
        is_option = is_alone and re.match("-{1,2}[A-Za-z]", text)
        return f"'{text}' is an option, not a value" if is_option else "" if text else "an empty text names nothing"


@dataclass(frozen=True, slots=True)
class File:
    """The path or URL of a file or folder."""

    metavar: str
    """Placeholder; words after `|` may be given in place of a path."""
    is_output: bool = False

    @property
    def words(self) -> list[str]:
        """Words that are no path: `auto` and `none` of `FILE|auto|none`."""
        return self.metavar.split("|")[1:]


Value = Number | Text | File | tuple[str, ...] | None
"""Form of the value of an option; a tuple holds the words to choose from, None is a flag."""


@dataclass(frozen=True, slots=True)
class Option:
    """One option. Its name is that of the field: `max_width` is `--max-width` on the command line."""

    heading: str
    value: Value
    default: Any = None
    """Plain value; a flag that is on by default is `--no-NAME` on the command line."""
    shown: str = ""
    """Default in words; empty where the plain value says it."""
    short: str = ""
    python: str = ""
    """Sentence on what Python takes besides."""
    rare: bool = False
    """True if only some logs need it: `--help` leaves it out, `--help-all` shows it."""
    several: bool = False
    both: bool = False
    """True for a flag that is spelled both `--NAME` and `--no-NAME`."""
    required: bool = False
    alone: str | None = None
    """Value where the command line gives the name alone."""
    unless: tuple[str, ...] = ()
    """Fields that it excludes; one of them on the command line goes before a setting of this one."""
    help: str = ""

    @property
    def is_negated(self) -> bool:
        """True if the command line spells the flag `--no-NAME` alone."""
        return self.value is None and self.default is True and not self.both

    def spelled(self, name: str) -> str:
        """Return the name on the command line."""
        return f"--{'no-' if self.is_negated else ''}{name.replace('_', '-')}"

    def is_changed(self, value: Any) -> bool:
        """Return True for a value that is not the default."""
        if self.default is None or value is None:
            return value is not self.default
        return bool((tuple(value) if isinstance(value, list) else value) != self.default)

    def default_words(self, name: str) -> str:
        """The default as help shows it; empty where there is none to show."""
        if self.shown or self.default is None or self.required:
            return self.shown
        if self.both:
            return name if self.default else f"no-{name}"
        return "" if self.value is None or self.default == () else str(self.default)


@dataclass(frozen=True, slots=True)
class Argument:
    """An argument of a command, which has no name on the command line."""

    metavar: str
    value: Value
    several: bool = False
    required: bool = True


def options_of(group: type) -> dict[str, Option]:
    """Return the options of a group by their fields, in order."""
    declared = {name: get_args(hint)[1:] for name, hint in group.__annotations__.items()}
    return {name: replace(each, help=words[0]) for name, (each, *words) in declared.items() if isinstance(each, Option)}


def arguments_of(group: type) -> dict[str, Argument]:
    """Return the arguments of a group by their fields, in order."""
    declared = {name: get_args(hint)[1] for name, hint in group.__annotations__.items()}
    return {name: each for name, each in declared.items() if isinstance(each, Argument)}


def defaults_of(group: type) -> dict[str, Any]:
    """Return the defaults of the options of a group."""
    return {name: option.default for name, option in options_of(group).items()}


@dataclass(frozen=True, slots=True)
class OptionRule:
    """Options that exclude others, or that need one of them: for the command line and Python alike."""

    names: tuple[str, ...]
    """Fields, or headings of the help: all fields below them."""
    others: tuple[str, ...]
    """Fields; `field=one|two` is met by these values alone."""
    words: str
    """Words of the refusal, after the name of the option."""
    needs: bool = False
    """True if one of `others` has to be given, too; False if none may be."""

    def broken(self, options: Mapping[str, Option], values: Mapping[str, Any], is_given: Callable[[str], bool]) -> str:
        """Return what is wrong with some values, in words; empty where nothing is.

        Parameters
        ----------
        options : those of a command or function, by their fields
        values : their values
        is_given : returns whether the user gave an option
        """
        met = []
        for name, mark, wanted in (other.partition("=") for other in self.others):
            if name in options:
                value = values[name]
                met.append(value in wanted.split("|") if mark else options[name].is_changed(value))
        if not met or any(met) is self.needs:
            return ""
        meant = (name for name, option in options.items() if not {name, option.heading}.isdisjoint(self.names))
        return next((f"{options[name].spelled(name)} {self.words}" for name in meant if is_given(name)), "")


def refuse_combinations(
    rules: Iterable[OptionRule], options: Mapping[str, Option], values: Mapping[str, Any], is_given: Callable[[str], bool]
) -> None:
    """Refuse options that exclude or need each other (`OptionError`), by `unless` and by rules: arguments as of those."""
    for name, option in options.items():
        for other in option.unless:
            if other in options and option.is_changed(values[name]) and options[other].is_changed(values[other]):
                raise OptionError(
                    f"{option.spelled(name)} and {options[other].spelled(other)} exclude each other: leave one out"
                )
    for rule in rules:
        if words := rule.broken(options, values, is_given):
            raise OptionError(words)


_OPTION_NAME = r"--(?:no-)?([a-z][a-z-]*)"
_CLAUSE = r"(?=[.;:,](?:\s|$))"
_UNIT_OF = {
    "METRES": "m",
    "SECONDS": "s",
    "DEGREES": "degrees",
    "ANGLE": "rad, or degrees with `degrees`",
    "MM": "mm",
    "KM2": "km²",
}


def python_words(name: str, option: Option) -> str:
    """Return what a keyword means: the words of the command line with names as Python spells them, and the unit."""

    def spelled(words: str) -> str:
        return re.sub(_OPTION_NAME, lambda found: f"`{found[1].replace('-', '_')}`", words)

    words = spelled(option.help)
    if isinstance(option.value, Number) and (unit := _UNIT_OF.get(option.value.metavar)):
        words = re.sub(_CLAUSE, f" [{unit}]", words, count=1)
    if option.several or (isinstance(option.value, Text) and option.value.is_list):
        words = f"{words} Python {'takes' if option.several else 'also takes'} a list."
    if option.python:
        words = f"{words} {option.python}"
    # The signature shows a plain default.
    default = option.shown if option.default is None else ""
    return f"{words} [default: {spelled(default)}]" if default else words
