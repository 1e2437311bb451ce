"""The logs that a user of the Python functions names, found as the command line finds them."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from os import PathLike, fspath
from typing import Any

from lidarcli.errors import warn
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Nothing, Source


def sources_of(log: Any) -> list[Source]:
    """The logs that are meant, each with a name of its own.

    Raises
    ------
    UnreadableError
        What was named is not there, or holds no log.
    """
    paths: list[Any] = [log] if isinstance(log, str | PathLike) else list(log)
    named = [path_of(path) for path in paths]
    found = find_logs(named)
    for each in found:
        if isinstance(each, Nothing):
            error = type(each.error)(f"{each.path}: {each.error}")
            # What was asked for has to be there; of a folder the rest is read.
            if each.path in named:
                raise error
            warn(str(error))
    sources = [each for each in found if isinstance(each, Source)]
    names = Counter(each.name for each in sources)
    return [replace(each, name=each.path) if names[each.name] > 1 else each for each in sources]


def path_of(log: Any) -> str:
    """The path of a log as text (`TypeError` where it is none)."""
    if not isinstance(log, str | PathLike):
        raise TypeError(f"a log is the path of a file or folder, not {type(log).__name__}")
    return fspath(log)
