"""The folder of a ROS 2 bag: which storage files it has, whatever its metadata.yaml says."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

METADATA = "metadata.yaml"
MAX_METADATA = 16 << 20
"""Longest metadata.yaml that is read [bytes]."""

_STORAGE = re.compile(r"\.(db3|mcap)(\.(zstd|zst))?$", re.IGNORECASE)
_PACKED = re.compile(r"\.(zstd|zst)$", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Folder:
    """Storage files in the order they were recorded, and what is wrong with the metadata."""

    files: list[Path] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    """Names of files that the metadata lists and nobody finds."""


def is_storage(name: str) -> bool:
    """Whether a file's name is that of a storage file."""
    return _STORAGE.search(name) is not None


def read_folder(folder: Path) -> Folder:
    """Find the storage files of a bag: those that are there count, the metadata gives their order."""
    there = {path.name: path for path in sorted(folder.iterdir()) if is_storage(path.name) and path.is_file()}
    named, note = _named_files(folder / METADATA)
    notes = [note] if note else []
    ordered: list[str] = []
    missing: list[str] = []
    for name in named:
        # Bags are packed, unpacked and renamed without anybody changing the metadata.
        match = next((it for it in there if it not in ordered and _same(it, name)), None)
        match = name if name in there and name not in ordered else match
        if match is not None:
            ordered.append(match)
        elif name not in ordered:
            missing.append(name)
    twins = {it for it in there for other in (ordered or there) if it != other and _same(it, other)}
    if not ordered:
        twins = {it for it in twins if _PACKED.search(it)}
    unnamed = [it for it in there if it not in ordered and it not in twins]
    if unnamed and named:
        notes.append(f"{METADATA} does not name {', '.join(sorted(unnamed, key=natural))}: read as well")
    names = sorted([*ordered, *unnamed], key=natural) if unnamed else ordered
    return Folder([there[name] for name in names], notes, missing)


def natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts `_2` before `_10`.

    >>> sorted(["bag_10.db3", "bag_2.db3"], key=natural)
    ['bag_2.db3', 'bag_10.db3']
    """
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", name)]


def _same(one: str, other: str) -> bool:
    """Whether two names differ by the packing alone."""
    return _PACKED.sub("", one).lower() == _PACKED.sub("", other).lower()


def _named_files(path: Path) -> tuple[list[str], str]:
    """File names of a metadata.yaml, and what is wrong with it."""
    try:
        if path.stat().st_size > MAX_METADATA:
            return [], f"{METADATA} is too long, it was not read"
        data = YAML(typ="safe").load(path.read_bytes())
        paths = data["rosbag2_bagfile_information"]["relative_file_paths"]
        # Old bags put the folder's name before the file's; nothing outside of the folder is ever read.
        return [PureWindowsPath(str(item)).name for item in paths], ""
    except FileNotFoundError:
        return [], f"{METADATA} is missing, the storage files were read without it"
    except OSError as err:
        return [], f"{METADATA} cannot be read ({err.strerror}), the storage files were read without it"
    except (YAMLError, UnicodeError, ValueError, RecursionError):
        return [], f"{METADATA} is not valid YAML, the storage files were read without it"
    except (TypeError, KeyError, LookupError):
        return [], f"{METADATA} lists no files, the storage files were read without it"
