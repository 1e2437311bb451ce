"""Which logs a run is about: those that are named or listed, and of these one share."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path, PurePosixPath

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.logs.base import BINARY_SUFFIXES, TEXT_SUFFIXES
from lidarcli.pipeline.inputs.search import find_logs, stem_of
from lidarcli.pipeline.inputs.sources import STDIN, Nothing, Source
from lidarcli.stores.url import Url, is_url, place

Shard = tuple[int, int]


def choose(
    logs: Sequence[str], listed: str | None = None, base: str | None = None, shard: Shard | None = None
) -> list[Source | Nothing]:
    """The logs of a run, in the order in which they are named, those of a list last.

    Parameters
    ----------
    logs : files, folders, patterns and URLs
    listed : file (`-` for standard input) with one of these a line; empty lines and those after `#` are left out
    base : folder below which a log keeps its place in its name; by default the one that was searched
    shard : (I, N), 1 to N: only the I-th of N shares, which a log belongs to by its name alone

    Raises
    ------
    OptionError
        A log is not below `base`.
    UnreadableError
        The list cannot be read.
    """
    found = find_logs(logs)
    if listed is not None:
        for line in _lines(listed):
            found += [_object(line)] if _is_object(line) else find_logs([line])
    if base is not None:
        found = [_named_below(source, base) if isinstance(source, Source) else source for source in found]
    if shard is not None:
        found = [source for source in found if is_in_shard(_key(source), shard)]
    return found


def is_in_shard(key: str, shard: Shard) -> bool:
    """Whether a log of this name belongs to a share, whatever others there are.

    >>> [key for key in ("run", "trip/run", "hall") if is_in_shard(key, (1, 2))]
    ['trip/run']
    """
    number, count = shard
    digest = blake2b(os.fsencode(key), digest_size=8).digest()
    return int.from_bytes(digest, "big") % count == number - 1


def _key(source: Source | Nothing) -> str:
    return source.name if isinstance(source, Source) else source.path


def _lines(listed: str) -> list[str]:
    try:
        if listed == STDIN:
            data = sys.stdin.buffer.read()
        elif isinstance(where := place(listed), Url):
            from lidarcli.stores.store import read_object

            data = read_object(where)
        else:
            data = where.read_bytes()
    except OSError as err:
        raise UnreadableError(f"{listed}: the list of logs cannot be read: {err.strerror or err}") from err
    lines = [os.fsdecode(line).strip() for line in data.split(b"\n")]
    return [line for line in lines if line and not line.startswith("#")]


def _is_object(line: str) -> bool:
    """Whether a line can only be one log in a store: nobody need be asked before it is opened."""
    if not is_url(line) or line.endswith("/"):
        return False
    url = place(line)
    return (
        isinstance(url, Url)
        and not url.has_magic()
        and url.name.lower().endswith((*BINARY_SUFFIXES, *TEXT_SUFFIXES))
    )


def _object(line: str) -> Source:
    url = place(line)
    return Source(str(url), stem_of(url.name))


def _named_below(source: Source, base: str) -> Source:
    """The same log with its place below `base` in its name."""
    where, top = place(source.path), place(base)
    if isinstance(where, Url) and isinstance(top, Url):
        inside = where.bucket == top.bucket and f"{where.key}/".startswith(f"{top.key}/" if top.key else "")
        below = PurePosixPath(where.key.removeprefix(top.key).strip("/"))
    elif isinstance(where, Path) and isinstance(top, Path):
        relative = os.path.relpath(where.absolute(), top.absolute())
        inside, below = not relative.startswith(".."), PurePosixPath(Path(relative).as_posix())
    else:
        inside, below = False, PurePosixPath()
    if not inside:
        raise OptionError(f"{source.path}: is not below --base {base}")
    return replace(source, name=str(below.with_name(PurePosixPath(source.name).name)))
