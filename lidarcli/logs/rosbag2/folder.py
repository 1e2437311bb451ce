"""Storage files in the folder of a ROS 2 bag, whatever its metadata.yaml says."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath

from lidarcli.logs.base import BINARY_SUFFIXES, TEXT_SUFFIXES
from lidarcli.ros.bag_metadata import METADATA, named_files

_STORAGE = re.compile(r"\.(db3|mcap)(\.(zstd|zst))?$", re.IGNORECASE)
_PART = re.compile(r"(.+)_(\d+)\.(?:db3|db3\.zstd|mcap\.zstd)")
_PACKED = re.compile(r"\.(zstd|zst)$", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Folder:
    """Storage files in the order they were recorded, and what is wrong with the metadata."""

    files: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    """Files that the metadata lists and that do not exist."""


def is_storage(name: str) -> bool:
    """Return True for the name of a storage file."""
    return _STORAGE.search(name) is not None


def is_bag(names: Iterable[str]) -> bool:
    """Return True if the files of a folder are those of one bag, by their names.

    A bag may have lost its metadata.yaml: then all logs in the folder are parts of one name, `NAME_0`, `NAME_1`, ...

    >>> is_bag(["run_0.db3", "run_1.db3"]), is_bag(["monday.db3", "run_0.db3"])
    (True, False)
    """
    names = list(names)
    logs = [_PART.fullmatch(name) for name in names if name.lower().endswith(BINARY_SUFFIXES)]
    stems = {part[1] if part else None for part in logs}
    return METADATA in names or (len(stems) == 1 and None not in stems)


def read_folder(folder: Path) -> Folder:
    """Find the storage files of a bag: those that are there count, the metadata gives their order."""
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    there = {path.name: path for path in files if is_storage(path.name)}
    named, cause = named_files(folder / METADATA)
    notes = [f"{cause}, the storage files were read without it"] if cause else []
    # Old bags put the folder's name before the file's; nothing outside of the folder is ever read.
    ordered, missing = _matched([PureWindowsPath(name).name for name in named], there)
    unnamed = _unnamed(ordered, there)
    if unnamed and named:
        notes.append(f"{METADATA} does not name {', '.join(sorted(unnamed, key=natural))}: read as well")
    logs = (*BINARY_SUFFIXES, *TEXT_SUFFIXES)
    others = [path.name for path in files if path.name not in there and path.name.lower().endswith(logs)]
    if others:
        notes.append(f"no part of this bag, and not read: {', '.join(others)}")
    names = sorted([*ordered, *unnamed], key=natural) if unnamed else [*ordered]
    return Folder([there[name] for name in names], notes, missing)


def _unnamed(ordered: Collection[str], there: Collection[str]) -> list[str]:
    """Return the files that the metadata does not name, except compressed or plain copies of others."""
    alike = _by_content(ordered or there)
    twins = {name for name in there if any(other != name for other in alike[_content(name)])}
    if not ordered:
        twins = {name for name in twins if _PACKED.search(name)}
    return [name for name in there if name not in ordered and name not in twins]


def natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts `_2` before `_10`.

    >>> sorted(["bag_10.db3", "bag_2.db3"], key=natural)
    ['bag_2.db3', 'bag_10.db3']
    """
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def _matched(named: Iterable[str], there: Iterable[str]) -> tuple[dict[str, None], list[str]]:
    """Return the files that the metadata names, in its order, and the names without a file.

    Bags are packed, unpacked and renamed without anybody changing the metadata.
    """
    alike = _by_content(there)
    ordered: dict[str, None] = {}
    missing: dict[str, None] = {}
    for name in named:
        left = alike[_content(name)]
        match = name if name in left else next(iter(left), None)
        if match is not None:
            left.remove(match)
            ordered[match] = None
        elif name not in ordered:
            missing[name] = None
    return ordered, list(missing)


def _by_content(names: Iterable[str]) -> defaultdict[str, list[str]]:
    """Group names that differ only in compression."""
    alike: defaultdict[str, list[str]] = defaultdict(list)
    for name in names:
        alike[_content(name)].append(name)
    return alike


def _content(name: str) -> str:
    """Return the name of a file without its compression suffix."""
    return _PACKED.sub("", name).lower()
