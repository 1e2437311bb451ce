"""Functions with keywords: shown, checked, and complete; and the loop over logs that they share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import wraps
from inspect import Parameter, cleandoc, signature
from textwrap import fill
from typing import Any, Protocol, TypeVar, cast, get_type_hints

from lidarcli.display.screen import Screen, byte_bar, count_bar
from lidarcli.display.texts import nearest
from lidarcli.errors import OptionError, warn
from lidarcli.formalism.background import Background
from lidarcli.formalism.matching.catalogue import Catalogue
from lidarcli.options.common import RULES
from lidarcli.options.forms import (
    File,
    Number,
    OptionRule,
    Text,
    defaults_of,
    options_of,
    python_words,
    refuse_combinations,
)
from lidarcli.options.values import AnyPath
from lidarcli.pipeline.api.options import refuse_lost, several
from lidarcli.pipeline.detecting import ErrorCollector
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.reading.one_log import Progress as Position
from lidarcli.pipeline.runs.over_logs import LogProgress, progress_of, summed

F = TypeVar("F", bound=Callable[..., Any])


class LogSummary(Protocol):
    """What is found in one log."""

    @property
    def warnings(self) -> Sequence[str]:
        """What a user has to know of it."""


Found = TypeVar("Found", bound=LogSummary)


WIDTH = 100
"""Columns of a docstring."""
Progress = bool | Callable[[int, int | None], object]
"""Wish to see how far the work is."""


def with_keywords(*rules: OptionRule) -> Callable[[F], F]:
    """Decorate a function whose `**options: Unpack[...]` are shown, checked by name and limits, and complete.

    Type checkers and editors that read sources understand `Unpack`; those that look at the living function, as IPython and
    help() do, get a signature and a docstring with every keyword. `rules` are refused in addition to `RULES`.
    """

    def decorate(function: F) -> F:
        group = function.__globals__[function.__annotations__["options"].removeprefix("Unpack[").removesuffix("]")]
        known, defaults = options_of(group), defaults_of(group)
        own = signature(function, eval_str=True)
        positional = [one for one in own.parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
        names = [one.name for one in positional] + list(known)

        @wraps(function)
        def called(*arguments: Any, **given: Any) -> Any:
            for at, value in enumerate(arguments):
                refuse_lost(names[min(at, len(positional) - 1)], value)
            for name, value in given.items():
                if name not in names:
                    close = nearest(name, names)
                    hint = f"did you mean '{close[0]}'?" if close else f"there are {', '.join(names)}"
                    raise TypeError(f"{function.__name__}() has no option '{name}'; {hint}")
                if name in known:
                    _check(name, known[name].value, value)
                else:
                    refuse_lost(name, value)
            values = {**defaults, **given}
            refuse_combinations((*RULES, *rules), known, values, lambda name: known[name].is_changed(values[name]))
            return function(*arguments, **values)

        types = keyword_types(group)
        keyword_only = [
            Parameter(name, Parameter.KEYWORD_ONLY, default=defaults[name], annotation=types[name]) for name in known
        ]
        called.__signature__ = own.replace(parameters=[*positional, *keyword_only])  # type: ignore[attr-defined]
        progress = "True for a bar on standard error, or a function of how much is done and how much there is"
        meanings = [f"progress : {progress} (docs/python.md)"] if "progress" in own.parameters else []
        meanings += [f"{name} : {python_words(name, option)}" for name, option in known.items()]
        lines = [fill(each, WIDTH, subsequent_indent="    ") for each in meanings]
        # They come at the end of the list of parameters.
        text = cleandoc(function.__doc__ or "")
        mark = next(mark for mark in ("\n\nReturns\n", "\n\nRaises\n") if mark in text)
        called.__doc__ = text.replace(mark, "\n".join(["", *lines]) + mark, 1)
        return cast(F, called)

    return decorate


def keyword_types(group: type) -> dict[str, Any]:
    """Return the types of the keywords of a group."""
    return get_type_hints(
        group, None, {each.__name__: each for each in (Background, Catalogue, Sequence)} | {"AnyPath": AnyPath}
    )


def _check(name: str, form: Any, value: Any) -> None:
    """Refuse a number out of its limits, or a word that is none of a choice (`OptionError`); None stands for a default."""
    option = f"--{name.replace('_', '-')}"
    if isinstance(form, tuple) and value is not None and value not in form:
        raise OptionError(f"{option}: '{value}' is not one of {', '.join(form)}")
    if isinstance(form, Text | File):
        refuse_lost(option, value, is_alone=isinstance(form, Text) and not form.is_list)
    if value is None or not isinstance(form, Number):
        return
    try:
        for number in value if form.count > 1 else (value,):
            form.check(number)
    except OptionError as err:
        raise OptionError(f"{option}: {err}") from None


# Logs.


def sources_of(log: Any, join: bool) -> list[Source]:
    """Return the logs that are meant, each with a name of its own; `UnreadableError` where one that is named is none."""
    named = several(log)
    found = find_logs(named, join, warn)
    for each in found:
        if isinstance(each, MissingInput):
            error = type(each.error)(f"{each.path}: {each.error}")
            # A log that is named has to be there; of a folder the rest is read.
            if each.path in named:
                raise error
            warn(str(error))
    sources = [each for each in found if isinstance(each, Source)]
    names = Counter(each.name for each in sources)
    return [replace(each, name=each.path) if names[each.name] > 1 else each for each in sources]


@contextmanager
def watched(progress: Progress, sources: Sequence[Source | MissingInput]) -> Iterator[LogProgress | None]:
    """Yield what the work on some logs calls with a log and the position in it; None where nobody wants to know."""
    if progress is True:
        with byte_bar(Screen()) as show:
            yield summed(sources, show)
    else:
        show_sum = _function(progress)
        yield None if show_sum is None else summed(sources, lambda done, total, _: show_sum(done, total))


def over_logs(
    sources: Sequence[Source], progress: Progress, work: Callable[[Source, Position | None], Found]
) -> list[Found]:
    """Return what the work on each log gives, with its warnings; the first error is raised where every log fails."""
    errors = ErrorCollector(len(sources))
    found = []
    with watched(progress, sources) as report:
        for source in sources:
            with errors.noted(source):
                found.append(work(source, progress_of(source, report)))
                warn_of(source, found[-1].warnings)
    errors.conclude()
    return found


def of_one_log(source: Source, progress: Progress, work: Callable[[Source, Position | None], Found]) -> Found:
    """Return what the work on one log gives, with its warnings."""
    with watched(progress, [source]) as report:
        found = work(source, progress_of(source, report))
    warn_of(source, found.warnings)
    return found


def warn_of(source: Source, lines: Iterable[str]) -> None:
    """Warn of one log."""
    for line in lines:
        warn(f"{source.label}: {line}")


@contextmanager
def counting(progress: Progress, description: str, unit: str) -> Iterator[Callable[[int, int | None], object] | None]:
    """Yield what work that is no reading calls with the number of things done, and of all."""
    if progress is True:
        with count_bar(description, None, unit, Screen()) as show:
            yield show
    else:
        yield _function(progress)


def _function(progress: Progress) -> Callable[[int, int | None], object] | None:
    if progress is False:
        return None
    if not callable(progress):
        raise TypeError(f"progress is True, False or a function of what is done and of all, not {progress!r}")
    return progress
