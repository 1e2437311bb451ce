"""The files that a name, a folder or a pattern stands for, on this machine or in a store."""

from __future__ import annotations

import errno
import glob
import os
from collections.abc import Sequence
from enum import Enum
from fnmatch import fnmatch
from pathlib import Path, PurePosixPath

from lidarcli.errors import UnreadableError
from lidarcli.stores.url import Place, Url, place


class Named(Enum):
    """What a name turned out to be."""

    FILE = "file"
    FOLDER = "folder"
    PATTERN = "pattern"


def files_named(text: str) -> tuple[Named, list[Place], list[UnreadableError]]:
    """The files by name, and the folders among them that nobody may look into.

    Below a folder these are all but those that are hidden (`.`) or nobody's table (`_lidarcli`).

    Raises
    ------
    UnreadableError
        There is no such file or folder, or the store does not say.
    """
    named = place(text)
    if isinstance(named, Url):
        return _stored(named)
    try:
        if named.is_dir():
            return Named.FOLDER, *_entered(*_below(named))
        if named.exists():
            return Named.FILE, [named], []
    except PermissionError as err:
        raise UnreadableError(f"{text}: cannot be opened: {err.strerror}") from err
    if not glob.has_magic(text):
        raise UnreadableError(f"{text}: no such file or folder")
    files = [Path(file) for file in sorted(glob.glob(text, recursive=True))]  # noqa: PTH207 (absolute patterns too)
    return Named.PATTERN, *_entered(files, denied_to(text))


def _below(folder: Path) -> tuple[list[Path], list[OSError]]:
    """The tables below a folder, and why others cannot be searched."""
    found: list[Path] = []
    denied: list[OSError] = []
    for here, folders, names in os.walk(folder, onerror=denied.append):
        folders[:] = [name for name in folders if _is_shown(PurePosixPath(name))]
        found += [Path(here, name) for name in names if name.endswith(".parquet") and name[0] not in "._"]
    return sorted(found), denied


def _entered(files: Sequence[Path], denied: Sequence[OSError]) -> tuple[list[Place], list[UnreadableError]]:
    """The files that lie where one may go, and a line for each folder that is shut: some show only their names."""
    shut = [
        folder for folder in dict.fromkeys(file.parent for file in files) if not os.access(folder, os.X_OK)
    ]
    lines = [
        *(f"{err.filename}: cannot be searched: {err.strerror or err}" for err in denied),
        *(f"{folder}: cannot be searched: {os.strerror(errno.EACCES)}" for folder in shut),
    ]
    return [file for file in files if file.parent not in shut], [UnreadableError(line) for line in lines]


def denied_to(pattern: str) -> list[OSError]:
    """Why folders that a pattern leads into cannot be searched: `glob` passes over them."""
    base = fixed_part(pattern)
    wanted = PurePosixPath(pattern[len(base) :]).parts
    denied: list[OSError] = []
    seen: set[tuple[int, int]] = set()
    for here, folders, _ in os.walk(base or ".", followlinks=True, onerror=denied.append):
        known = os.stat(here)  # noqa: PTH116
        at = PurePosixPath(os.path.relpath(here, base or ".")).parts
        if (known.st_dev, known.st_ino) in seen:
            folders.clear()
        seen.add((known.st_dev, known.st_ino))
        folders[:] = sorted(name for name in folders if _leads_into((*at, name), wanted))
    return [err for err in denied if not isinstance(err, FileNotFoundError)]


def _leads_into(folder: Sequence[str], pattern: Sequence[str]) -> bool:
    """Whether a pattern asks for something in a folder, both below the same place.

    >>> [_leads_into(("a", "b"), pattern) for pattern in (("**", "*.mcap"), ("*", "b", "x"), ("*.mcap",), ("a", "b"))]
    [True, True, False, False]
    """
    if not folder or not pattern:
        return bool(pattern)
    name, wanted = folder[0], pattern[0]
    if name.startswith(".") and not wanted.startswith("."):
        return wanted == "**" and _leads_into(folder, pattern[1:])
    if wanted == "**":
        return _leads_into(folder[1:], pattern) or _leads_into(folder, pattern[1:])
    return fnmatch(name, wanted) and _leads_into(folder[1:], pattern[1:])


def fixed_part(pattern: str) -> str:
    """The folder up to which a pattern says what it means.

    >>> fixed_part("bags/2026-*/run.mcap"), fixed_part("*.mcap")
    ('bags/', '')
    """
    first = min(at for sign in "*?[" if (at := pattern.find(sign)) >= 0)
    return pattern[: pattern.rfind("/", 0, first) + 1]


def all_files(folder: Place, suffix: str) -> list[Place]:
    """The files of a folder, by name; none where there is no such folder, `UnreadableError` where nobody may look."""
    if isinstance(folder, Url):
        from lidarcli.stores.store import listing

        return [found for found, _ in listing(folder) if found.name.endswith(suffix)]
    try:
        return [folder / name for name in sorted(os.listdir(folder)) if name.endswith(suffix)]  # noqa: PTH208
    except FileNotFoundError:
        return []
    except OSError as err:
        raise UnreadableError(f"{folder}: cannot be searched: {err.strerror or err}") from err


def _stored(url: Url) -> tuple[Named, list[Place], list[UnreadableError]]:
    from lidarcli.pipeline.inputs.store_search import objects_matching
    from lidarcli.stores.store import has_bucket, listing

    if url.has_magic():
        return Named.PATTERN, [*objects_matching(url)], []
    if url.key and url.exists():
        return Named.FILE, [url], []
    below = [found for found, _ in listing(url)]
    if not below:
        raise UnreadableError(
            f"{url}: {'no such object or folder' if has_bucket(url) else 'there is no such bucket'}"
        )
    shown: list[Place] = [
        found for found in below if _is_shown(PurePosixPath(found.key.removeprefix(url.key).strip("/")))
    ]
    return Named.FOLDER, shown, []


def _is_shown(path: PurePosixPath) -> bool:
    return not any(part.startswith((".", "_")) for part in path.parts)
