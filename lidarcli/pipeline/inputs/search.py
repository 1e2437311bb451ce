"""From what a user names to the logs it means: files, folders to search, ROS 2 bags, standard input."""

from __future__ import annotations

import glob
import os
import re
import stat
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path, PurePath

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.logs.base import BINARY_SUFFIXES, TEXT_LOG_SUFFIXES, TEXT_SUFFIXES
from lidarcli.logs.rosbag2.folder import is_bag
from lidarcli.pipeline.inputs.files import fixed_part, matching
from lidarcli.pipeline.inputs.opening import hold_one_sweep_each
from lidarcli.pipeline.inputs.sources import STDIN, Nothing, Source
from lidarcli.stores.url import Place, is_url

SUFFIXES = (".mcap", ".bag", ".active", ".db3", ".csv", ".csv.gz", ".zstd", *TEXT_LOG_SUFFIXES)
"""What a search of a folder takes for a log; a file that is named is opened whatever its suffix."""

_CONTAINER = (
    ".mcap",
    ".bag",
    ".db3",
    ".csv",
    ".tsv",
    ".txt",
    ".log",
    ".clf",
    ".gfs",
    ".2d",
    ".jsonl",
    ".ndjson",
)
_WRAPPER = (".gz", ".zstd", ".active")


def find_logs(inputs: Iterable[str]) -> list[Source | Nothing]:
    """The logs that `inputs` mean, in their order; a folder, also of a store, is searched and its logs come sorted."""
    found: list[Source | Nothing] = []
    for text in inputs:
        if is_url(text):
            # Who reads no store does not wait for this import.
            from lidarcli.pipeline.inputs.store_search import find_stored

            found.extend(find_stored(text))
            continue
        path = Path(text)
        if text == STDIN:
            found.append(Source(STDIN, "stdin"))
        elif (denied := _denied(path)) is not None:
            found.append(Nothing(text, UnreadableError(f"cannot be opened: {denied}")))
        elif not path.exists():
            found.extend(_pattern(text))
        elif path.is_dir() and not is_one_log(path):
            below = _search(path)
            found.extend(
                below or [Nothing(text, UnreadableError(f"no log in this folder ({known_suffixes()})"))]
            )
        else:
            found.append(Source(text, log_name(path)))
    return found


def one_log(log: str) -> Source:
    """The one log that is meant, which may be the only one in a folder.

    Raises
    ------
    OptionError
        There are several.
    UnreadableError
        There is none.
    """
    sources = find_logs([log])
    if len(sources) > 1:
        raise OptionError(f"{log}: holds {len(sources)} logs; name one of them")
    if isinstance(sources[0], Nothing):
        raise UnreadableError(f"{log}: {sources[0].error}")
    return sources[0]


def files_of(sources: Iterable[Source | Nothing]) -> list[str]:
    """The files that sources are read from: outputs must be none of them."""
    found: list[str] = []
    for source in sources:
        found += source.files if isinstance(source, Source) and source.files else [source.path]
        with suppress(OSError), os.scandir(source.path) as entries:
            # Of a store nothing is there.
            found += [entry.path for entry in entries]
    return found


def refuse_clashes(sources: Sequence[Source | Nothing]) -> None:
    """Refuse two logs whose outputs would have the same name (`OptionError`)."""
    taken: dict[str, str] = {}
    for source in sources:
        if isinstance(source, Nothing):
            continue
        if source.name in taken:
            first, second = taken[source.name], source.label
            raise OptionError(
                f"{first} and {second} would both write {source.name}.*; run them apart with -o"
            )
        taken[source.name] = source.label


def log_name(path: Path) -> str:
    """Name of a log: its file name without container suffixes, or the name of its folder.

    >>> [log_name(Path(name)) for name in ("run.mcap", "x.csv.gz", "a.bag.active", "b.v2.db3")]
    ['run', 'x', 'a', 'b.v2']
    """
    name = path.name or path.resolve().name
    return name if path.is_dir() else stem_of(name)


def stem_of(name: str) -> str:
    """The name of a file without container suffixes."""
    known = False
    for suffixes in (_WRAPPER, _CONTAINER):
        stem, suffix = os.path.splitext(name)  # noqa: PTH122 (names, not paths)
        if stem and suffix.lower() in suffixes:
            name, known = stem, True
    return name if known else PurePath(name).stem


def is_one_log(folder: Path) -> bool:
    """Whether a folder is one log: a ROS 2 bag, or CSV files with one sweep each."""
    try:
        names = sorted(item.name for item in folder.iterdir() if item.is_file())
    except OSError:
        return False
    return are_one_log(folder, names)


def are_one_log(folder: Place, names: Sequence[str]) -> bool:
    """The same of a folder whose files are known."""
    if is_bag(names):
        return True
    if any(name.lower().endswith(BINARY_SUFFIXES) for name in names):
        return False
    return hold_one_sweep_each([folder / name for name in names if name.lower().endswith(TEXT_SUFFIXES)])


def _search(folder: Path) -> list[Source | Nothing]:
    """Logs below a folder by path, and what could not be looked into.

    Links are followed; a folder that was seen already is not entered again.
    """
    seen: set[tuple[int, int]] = set()
    found: dict[Path, Source | Nothing] = {}

    def unreadable(err: OSError, cannot: str = "cannot be searched") -> None:
        path = Path(os.fsdecode(err.filename))
        found[path] = Nothing(str(path), UnreadableError(f"{cannot}: {err.strerror}"))

    def is_log(path: Path) -> bool:
        try:
            # Only regular files: a FIFO found by a search would wait for a writer for ever.
            return stat.S_ISREG(path.stat().st_mode)
        except OSError as err:
            if not isinstance(err, FileNotFoundError) or path.is_symlink():
                unreadable(err, "cannot be opened")
            return False

    for here, folders, files in os.walk(folder, followlinks=True, onerror=unreadable):
        at = Path(here)
        try:
            known = at.stat()
        except OSError as err:
            unreadable(err)
            continue
        if (known.st_dev, known.st_ino) in seen:
            folders.clear()
            continue
        seen.add((known.st_dev, known.st_ino))
        # Hidden things are nobody's logs: macOS puts a `._run.bag` beside every `run.bag` on foreign disks.
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        logs = [at / name for name in folders if is_one_log(at / name)]
        folders[:] = [name for name in folders if at / name not in logs]
        names = (name for name in files if not name.startswith(".") and name.lower().endswith(SUFFIXES))
        logs += filter(is_log, (at / name for name in names))
        found |= {log: Source(str(log), _below(folder, log)) for log in logs}
    return [found[path] for path in sorted(found)]


def _denied(path: Path) -> str | None:
    """Why nobody may even ask whether something is there."""
    try:
        path.stat()
    except PermissionError as err:
        return err.strerror
    except (OSError, ValueError):
        return None
    return None


def _below(folder: Path, log: Path) -> str:
    return log.relative_to(folder).with_name(log_name(log)).as_posix()


def _pattern(text: str) -> Iterator[Source | Nothing]:
    """The logs that a pattern names which no shell has expanded; one log where they hold one sweep each."""
    if Path(text).is_symlink():
        yield Nothing(text, UnreadableError("the link leads to nothing"))
        return
    files, denied = matching(text) if glob.has_magic(text) else ([], [])
    for err in denied:
        yield Nothing(os.fsdecode(err.filename), UnreadableError(f"cannot be searched: {err.strerror}"))
    if not files and not denied:
        hint = "; URLs of stores begin with s3://, gs:// or az://" if re.match(r"[a-z0-9]+:/", text) else ""
        yield Nothing(text, UnreadableError(f"no such file or folder{hint}"))
    elif files and hold_one_sweep_each([Path(file) for file in files]):
        yield Source(text, log_name(Path(files[0]).parent), tuple(files))
    elif files:
        yield from _keyed(text, find_logs(files))


def _keyed(pattern: str, found: Iterable[Source | Nothing]) -> Iterator[Source | Nothing]:
    """The logs of a pattern, named by their places below its part without signs: equal names in two folders are two."""
    base = fixed_part(pattern)
    seen: set[str] = set()
    for source in found:
        # `**` names a folder and what is in it.
        above = {str(parent) for parent in PurePath(source.path).parents}
        if source.path in seen or any(path in seen and Path(path).is_dir() for path in above):
            continue
        seen.add(source.path)
        if isinstance(source, Source) and not PurePath(source.name).parent.parts:
            below = os.path.relpath(source.path, base or ".")
            name = PurePath(below).with_name(source.name).as_posix()
            yield source if name.split("/")[0] == ".." else replace(source, name=name)
        else:
            yield source


def known_suffixes() -> str:
    return "searched for " + " ".join(f"*{suffix}" for suffix in SUFFIXES)
