"""The files that a name, a folder or a pattern stands for, on this machine or in a store."""

from __future__ import annotations

import errno
import glob
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from enum import Enum
from fnmatch import fnmatch, fnmatchcase
from pathlib import Path, PurePosixPath

from lidarcli.errors import UnreadableError, unreadable
from lidarcli.stores import Place, State, Url, has_bucket, listing, place, read_object

Objects = Mapping[Url, State]
"""Objects of a store, each with the state it was found in."""


class Named(Enum):
    """Kind of input that a name turned out to be."""

    FILE = "file"
    FOLDER = "folder"
    PATTERN = "pattern"


def files_named(text: str) -> tuple[Named, list[Place], list[UnreadableError]]:
    """Return the kind of a name, its files by name, and the folders that may not be searched (`UnreadableError` for none).

    Files of a folder that are hidden (`.`) or records of a run (`_lidarcli`) are left out.
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
    found, denied = matching(text)
    return Named.PATTERN, *_entered([Path(file) for file in found], denied)


def _below(folder: Path) -> tuple[list[Path], list[OSError]]:
    """Return the tables below a folder, and the errors of folders that cannot be searched."""
    found: list[Path] = []
    denied: list[OSError] = []
    for here, folders, names in os.walk(folder, onerror=denied.append):
        folders[:] = [name for name in folders if _is_shown(PurePosixPath(name))]
        found += [Path(here, name) for name in names if name.endswith(".parquet") and name[0] not in "._"]
    return sorted(found), denied


def _entered(files: Sequence[Path], denied: Sequence[OSError]) -> tuple[list[Place], list[UnreadableError]]:
    """Return the files in folders that may be entered, and an error for each folder that may not."""
    shut = [folder for folder in dict.fromkeys(file.parent for file in files) if not os.access(folder, os.X_OK)]
    lines = [
        *(f"{err.filename}: cannot be searched: {err.strerror or err}" for err in denied),
        *(f"{folder}: cannot be searched: {os.strerror(errno.EACCES)}" for folder in shut),
    ]
    return [file for file in files if file.parent not in shut], [UnreadableError(line) for line in lines]


def matching(pattern: str) -> tuple[list[str], list[OSError]]:
    """Return the files and folders that match a pattern, by name, and the errors of folders that cannot be searched.

    Matches are those of `glob` with `recursive`, which says nothing of such folders; a link in a circle is followed once.
    Each folder is listed once; one that vanishes meanwhile is left out.
    """
    walk = _Walk()
    base = fixed_part(pattern)
    wanted = tuple(part for part in pattern[len(base) :].split("/") if part)
    found = dict.fromkeys(walk.found(base, wanted, frozenset()))
    only_folders = pattern.endswith("/")
    named = sorted(path for path in found if path and (not only_folders or Path(path).is_dir()))
    return named, [*walk.denied.values()]


class _Walk:
    """One walk through the folders that a pattern leads into."""

    def __init__(self) -> None:
        self.denied: dict[str, OSError] = {}
        """Folder → why it cannot be searched."""
        self._listed: dict[str, list[tuple[str, bool]]] = {}

    def found(self, here: str, wanted: Sequence[str], above: frozenset[tuple[int, int]]) -> Iterator[str]:
        """Yield the paths below a folder that match the `wanted` parts; `above` are the folders on the way here."""
        if not wanted:
            yield here
            return
        first, rest = wanted[0], wanted[1:]
        if not glob.has_magic(first):
            if self._is_there(here, first):
                yield from self.found(_inside(here, first), rest, above)
            return
        if first == "**":
            yield from self._through(here, rest, above)
            return
        for name, is_folder in self._entries(here):
            if (is_folder or not rest) and fnmatch(name, first) and (name[0] != "." or first[0] == "."):
                yield from self.found(_inside(here, name), rest, above)

    def _through(self, here: str, rest: Sequence[str], above: frozenset[tuple[int, int]]) -> Iterator[str]:
        """Yield the paths that match the parts after `**`, below a folder and those in it at any depth."""
        try:
            known = os.stat(here or ".")  # noqa: PTH116
        except OSError as err:
            self._deny(here, err)
            return
        identity = known.st_dev, known.st_ino
        if identity in above:
            return
        yield from self.found(here, rest, above)
        for name, is_folder in self._entries(here):
            if name[0] == ".":
                continue
            if is_folder:
                yield from self._through(_inside(here, name), rest, above | {identity})
            elif not rest:
                yield _inside(here, name)

    def _is_there(self, here: str, name: str) -> bool:
        try:
            os.lstat(_inside(here, name))
        except OSError as err:
            self._deny(here, err)
            return False
        return True

    def _entries(self, here: str) -> list[tuple[str, bool]]:
        """Return the names in a folder, each with whether it is a folder."""
        if here not in self._listed:
            self._listed[here] = []
            try:
                with os.scandir(here or ".") as entries:
                    self._listed[here] = [(entry.name, _is_folder(entry)) for entry in entries]
            except OSError as err:
                self._deny(here, err)
        return self._listed[here]

    def _deny(self, here: str, err: OSError) -> None:
        if not isinstance(err, FileNotFoundError | NotADirectoryError):
            err.filename = here or "."
            self.denied.setdefault(err.filename, err)


def _inside(here: str, name: str) -> str:
    return f"{here}/{name}" if here and not here.endswith("/") else f"{here}{name}"


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        # A link in a circle.
        return False


def fixed_part(pattern: str) -> str:
    """Return the folder of a pattern before its first part with signs.

    >>> fixed_part("bags/2026-*/run.mcap"), fixed_part("*.mcap")
    ('bags/', '')
    """
    first = min(at for sign in "*?[" if (at := pattern.find(sign)) >= 0)
    return pattern[: pattern.rfind("/", 0, first) + 1]


def all_files(folder: Place, suffix: str) -> list[Place]:
    """Return the files of a folder by name; none of a missing folder, `UnreadableError` where it cannot be searched."""
    if isinstance(folder, Url):
        return [found for found, _ in listing(folder) if found.name.endswith(suffix)]
    try:
        return [folder / name for name in sorted(os.listdir(folder)) if name.endswith(suffix)]  # noqa: PTH208
    except FileNotFoundError:
        return []
    except OSError as err:
        raise UnreadableError(f"{folder}: cannot be searched: {err.strerror or err}") from err


def read_file(name: str) -> bytes:
    """Read a file as a whole; `UnreadableError` where it cannot be read."""
    where = place(name)
    if isinstance(where, Url):
        return read_object(where)
    with unreadable(name):
        return where.read_bytes()


def _stored(url: Url) -> tuple[Named, list[Place], list[UnreadableError]]:
    if url.has_magic():
        matches = matcher_of(url)
        return Named.PATTERN, [found for found in folder_of_pattern(url)[1] if matches(found.key)], []
    if url.key and url.exists():
        return Named.FILE, [url], []
    below = [found for found, _ in listing(url)]
    if not below:
        raise UnreadableError(f"{url}: {'no such object or folder' if has_bucket(url) else 'there is no such bucket'}")
    shown: list[Place] = [found for found in below if _is_shown(PurePosixPath(found.key.removeprefix(url.key).strip("/")))]
    return Named.FOLDER, shown, []


def _is_shown(path: PurePosixPath) -> bool:
    return not any(part.startswith((".", "_")) for part in path.parts)


def folder_of_pattern(pattern: Url) -> tuple[Url, Objects]:
    """Return the folder of a pattern before its first part with signs, and all that is below it."""
    base = replace(pattern, key=fixed_part(pattern.key).strip("/"))
    return base, dict(listing(base))


def matcher_of(pattern: Url) -> Callable[[str], bool]:
    """Return the function that tells whether the key of an object matches a pattern."""
    parts = pattern.key.split("/")
    return lambda key: _matches(parts, key.split("/"))


def _matches(pattern: Sequence[str], key: Sequence[str]) -> bool:
    """Match a name with a pattern, part by part as in a shell; no sign stands for the dot of a hidden name."""
    if not pattern:
        return not key
    first, rest = pattern[0], pattern[1:]
    if first == "**":
        more = bool(key) and not key[0].startswith(".") and _matches(pattern, key[1:])
        return more or _matches(rest, key)
    if not key or (key[0].startswith(".") and not first.startswith(".")):
        return False
    return fnmatchcase(key[0], first) and _matches(rest, key[1:])
