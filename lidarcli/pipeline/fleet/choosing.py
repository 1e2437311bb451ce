"""Which logs a run is about: those that are named or listed, and of these one share."""

from __future__ import annotations

import codecs
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path, PurePosixPath

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.logs.base import BINARY_SUFFIXES, TEXT_LOG_SUFFIXES, TEXT_SUFFIXES
from lidarcli.pipeline.fleet.states import read_file
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
        for number, line in _lines(listed):
            for source in _listed(line):
                place_in_list = f"{listed}: line {number}: {source.path}"
                found.append(replace(source, path=place_in_list) if isinstance(source, Nothing) else source)
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


def _lines(listed: str) -> list[tuple[int, str]]:
    """The lines of a list that name something, with their numbers."""
    data = sys.stdin.buffer.read() if listed == STDIN else read_file(listed)
    data = data.removeprefix(codecs.BOM_UTF8)
    if b"\0" in data:
        raise UnreadableError(
            f"{listed}: is no list of logs: it holds NUL bytes; write one name a line, in UTF-8"
        )
    lines = [(number, os.fsdecode(line).strip()) for number, line in enumerate(data.split(b"\n"), 1)]
    return [(number, line) for number, line in lines if line and not line.startswith("#")]


def _listed(line: str) -> list[Source | Nothing]:
    """The logs that a line of a list means."""
    where = place(line) if is_url(line) else None
    if isinstance(where, Url) and where.options:
        error = UnreadableError(
            "a list takes no options of a URL (?endpoint_override=): they say where credentials are sent; name the log on "
            "the command line, or set AWS_ENDPOINT_URL"
        )
        return [Nothing(line, error)]
    return [_object(line)] if _is_object(line) else find_logs([line])


def _is_object(line: str) -> bool:
    """Whether a line can only be one log in a store: nobody need be asked before it is opened."""
    if not is_url(line) or line.endswith("/"):
        return False
    url = place(line)
    return (
        isinstance(url, Url)
        and not url.has_magic()
        and url.name.lower().endswith((*BINARY_SUFFIXES, *TEXT_LOG_SUFFIXES, *TEXT_SUFFIXES))
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
        inside, below = Path(relative).parts[:1] != ("..",), PurePosixPath(Path(relative).as_posix())
    else:
        inside, below = False, PurePosixPath()
    if not inside or not below.name:
        raise OptionError(f"{source.path}: is not below --base {base}")
    return replace(source, name=str(below.with_name(PurePosixPath(source.name).name)))
