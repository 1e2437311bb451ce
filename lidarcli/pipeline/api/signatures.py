"""Public functions with their keywords in sight: what help(), an editor and a wrong name have to say of them."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, cleandoc, signature
from numbers import Integral, Real
from textwrap import fill
from typing import Any, TypeVar, cast

from lidarcli.errors import OptionError
from lidarcli.pipeline.api.keywords import Keyword, Limits, keywords_of

F = TypeVar("F", bound=Callable[..., Any])
WIDTH = 100
"""Of a docstring."""


def with_keywords(function: F) -> F:
    """A function whose `**options: Unpack[...]` are shown, checked by name, and complete with their defaults.

    Type checkers and editors that read sources understand `Unpack`; those that look at the living function, as IPython and
    help() do, get a signature and a docstring with every keyword.
    """
    known = _keywords(function)
    own = signature(function, eval_str=True)
    shown = [one for one in own.parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
    names = [one.name for one in shown] + list(known)
    defaults = {name: keyword.default for name, (_, keyword) in known.items()}

    @wraps(function)
    def called(*arguments: Any, **given: Any) -> Any:
        for name in given:
            if name not in names:
                raise TypeError(_unknown(function.__name__, name, names))
            if name in known and (limits := known[name][1].limits) is not None:
                _refuse(name, given[name], limits)
        return function(*arguments, **{**defaults, **given})

    keyword_only = [
        Parameter(name, Parameter.KEYWORD_ONLY, default=keyword.default, annotation=kind)
        for name, (kind, keyword) in known.items()
    ]
    called.__signature__ = own.replace(parameters=[*shown, *keyword_only])  # type: ignore[attr-defined]
    called.__doc__ = _documented(cleandoc(function.__doc__ or ""), known)
    return cast(F, called)


def _keywords(function: Callable[..., Any]) -> dict[str, tuple[Any, Keyword]]:
    told: str = function.__annotations__["options"]
    return keywords_of(function.__globals__[told.removeprefix("Unpack[").removesuffix("]")])


def _unknown(function: str, name: str, names: list[str]) -> str:
    close = get_close_matches(name, names, 1)
    hint = f"did you mean '{close[0]}'?" if close else f"there are {', '.join(names)}"
    return f"{function}() has no option '{name}'; {hint}"


def _refuse(name: str, value: Any, limits: Limits) -> None:
    """Refuse a number that is out of its limits (`OptionError`); None stands for a default."""
    if value is None:
        return
    option, kind = f"--{name.replace('_', '-')}", Integral if limits.whole else Real
    if not isinstance(value, kind) or isinstance(value, bool):
        raise OptionError(f"{option}: {value!r} is no {'whole ' if limits.whole else ''}number")
    number = cast(float, value)
    if not (number > limits.least if limits.above else number >= limits.least):
        raise OptionError(
            f"{option}: {value:g} is {'not above' if limits.above else 'below'} {limits.least:g}"
        )
    if number > limits.most:
        raise OptionError(f"{option}: {value:g} is above {limits.most:g}")


def _documented(text: str, known: dict[str, tuple[Any, Keyword]]) -> str:
    """The docstring with the meanings of the keywords, in the end of its list of parameters."""
    lines = [
        fill(f"{name} : {keyword.meaning}", WIDTH, subsequent_indent="    ")
        for name, (_, keyword) in known.items()
    ]
    head, mark, tail = text.partition("\n\nReturns\n")
    if not mark:
        head, mark, tail = text.partition("\n\nRaises\n")
    return "\n".join([head, *lines]) + mark + tail
