"""Recordings that are joined: those that a user names, and parts of one recording by their names."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import PurePosixPath

from lidarcli.display import counted
from lidarcli.errors import OptionError
from lidarcli.logs.joined import Numbered, numbered
from lidarcli.logs.rosbag2.folder import natural
from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.stores import is_url, place

_RECORDED = (".bag", ".mcap", ".db3")
"""Suffixes of what recorders split."""
_MOST = 3
"""Recordings in parts that notes name."""


def joined(parts: Sequence[Source]) -> Source:
    """Return one log of recordings that a user names, or the only one of them as it is.

    Its name is what their names have in common without their numbers, else that of the first by name.

    Raises
    ------
    OptionError
        One of them is named twice, or is standard input.
    """
    if len(parts) < 2:
        return parts[0]
    seen: set[str] = set()
    for part in parts:
        if part.is_stdin:
            raise OptionError("--join opens logs more than once: give the name of a file instead of -")
        where = part.path if is_url(part.path) else os.path.realpath(part.path)
        if where in seen:
            raise OptionError(f"--join: {part.path} is named twice")
        seen.add(where)
    ordered = sorted(parts, key=lambda part: natural(part.path))
    names = [numbered(part.name) for part in ordered]
    is_split = names[0] is not None and len({name.stem if name else None for name in names}) == 1
    return _of(ordered, names[0].log if is_split and names[0] else ordered[0].name)


def joined_by_name(found: Sequence[Source | Nothing]) -> list[Source | Nothing]:
    """Return logs with the parts of each recording as one log, in the place of its first part."""
    whole: dict[str, Source] = {}
    behind: set[str] = set()
    for group in _groups(found):
        name = numbered(group[0].file_name)
        assert name is not None, "all parts are numbered"
        first = PurePosixPath(group[0].name)
        whole[group[0].path] = _of(group, str(first.with_name(name.log)))
        behind |= {part.path for part in group[1:]}
    return [whole.get(source.path, source) for source in found if source.path not in behind]


def split_notes(found: Sequence[Source | Nothing]) -> list[str]:
    """Return notes on logs that look like parts of one recording."""
    groups = _groups(found)
    notes = [
        f"{group[0].path} and {len(group) - 1} more look like parts of one recording: --join reads them as one log"
        for group in groups[:_MOST]
    ]
    if len(groups) > _MOST:
        notes.append(f"so do the files of {counted(len(groups) - _MOST, 'more recording')}")
    return notes


def _of(parts: Sequence[Source], name: str) -> Source:
    return replace(parts[0], name=name, files=(), parts=tuple(parts), found=None)


def _groups(found: Iterable[Source | Nothing]) -> list[list[Source]]:
    """Return the parts of each recording, in their order: files of one folder and stem, numbered from 0 on."""
    alike: dict[tuple[str, str, str], list[tuple[str, int, Source]]] = {}
    for source in found:
        if isinstance(source, Source) and (name := _recorded(source)) is not None:
            key = str(place(source.path).parent), name.stem, name.suffix
            # Names of one stem differ in their dates, which sort by time.
            alike.setdefault(key, []).append((name.log, name.number, source))
    return [group for parts in alike.values() for group in _split(sorted(parts, key=lambda part: part[:2]))]


def _recorded(source: Source) -> Numbered | None:
    name = None if source.files or source.parts else numbered(source.file_name)
    return name if name is not None and name.suffix in _RECORDED else None


def _split(parts: Sequence[tuple[str, int, Source]]) -> Iterator[list[Source]]:
    """Yield the groups of several parts: each begins with number 0, from which numbers rise.

    Without a number 0 files are no parts: days of a month and robots are numbered, too.
    """
    group: list[Source] = []
    last = -1
    for _, number, source in parts:
        if number == 0 or number <= last:
            if len(group) > 1:
                yield group
            group = []
        if group or number == 0:
            group.append(source)
        last = number
    if len(group) > 1:
        yield group
