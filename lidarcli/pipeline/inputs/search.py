"""From what a user names to files and logs: files, folders, URLs, patterns, lists and shares of them."""

from __future__ import annotations

import codecs
import errno
import os
import stat
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from enum import Enum
from fnmatch import fnmatchcase
from glob import has_magic
from pathlib import Path, PurePath, PurePosixPath
from typing import Any, NamedTuple

from lidarcli.display.texts import counted
from lidarcli.errors import LidarcliError, OptionError, UnreadableError, unreadable
from lidarcli.files.stores import (
    Place,
    State,
    Url,
    absolute,
    has_bucket,
    head,
    is_folder,
    is_url,
    listing,
    place,
    read_object,
)
from lidarcli.logs import open_log
from lidarcli.logs.joined import Numbered, natural, numbered
from lidarcli.logs.registry import BINARY_SUFFIXES, FORMATS, SUFFIXES, TEXT_SUFFIXES, is_bag
from lidarcli.pipeline.inputs.sources import STDIN, MissingInput, Source, hold_one_sweep_each

_WRAPPER = (".gz", ".zstd", ".active")
_CONTAINER = {suffix for known in FORMATS for suffix in (*known.suffixes, *known.vague)}.difference(_WRAPPER)
_SINGLE = tuple(suffix for known in FORMATS if not known.many for suffix in known.suffixes)
"""Suffixes of files that are a complete log each."""
Logs = list[Source | MissingInput]


class Named(Enum):
    """Kind of input that a name turned out to be."""

    FILE = "file"
    FOLDER = "folder"
    PATTERN = "pattern"


class _Listing(NamedTuple):
    """The files below a folder."""

    base: Place
    files: dict[str, Place]
    """Name below the folder, parts between slashes → file."""
    states: Mapping[Any, State]
    """Those of objects of a store."""
    denied: dict[str, str]
    """Folder that cannot be searched → why."""


def _named(text: str) -> tuple[Named, Place, State | None]:
    """Return the kind of a name, its place, and the state of an object; `UnreadableError` where there is nothing."""
    where = place(text)
    if isinstance(where, Url):
        # Not requested of what can only be a folder or a pattern; names may hold brackets.
        if where.key and not text.endswith("/") and "*" not in where.key and (state := head(where)) is not None:
            return Named.FILE, where, state
        is_pattern = where.has_magic() and ("*" in where.key or not is_folder(where))
        return Named.PATTERN if is_pattern else Named.FOLDER, where, None
    try:
        mode = where.stat().st_mode
    except PermissionError as err:
        raise UnreadableError(f"{text}: cannot be opened: {err.strerror}") from err
    except (OSError, ValueError) as err:
        if has_magic(text):
            return Named.PATTERN, where, None
        raise UnreadableError(f"{text}: {_absent(where)}") from err
    return Named.FOLDER if stat.S_ISDIR(mode) else Named.FILE, where, None


def _absent(where: Place) -> str:
    if not isinstance(where, Url):
        return "no such file or folder"
    return "no such object or folder" if has_bucket(where) else "there is no such bucket"


def _listed(base: Place, enters: Callable[[str], bool] = lambda _: True) -> _Listing:
    """List a folder; below those of this machine only what `enters` takes, and each folder once, as links may circle."""
    if isinstance(base, Url):
        states = dict(listing(base))
        return _Listing(base, {url.key.removeprefix(base.key).strip("/"): url for url in states}, states, {})
    files: dict[str, Place] = {}
    denied: list[OSError] = []
    entered: set[tuple[int, int]] = set()
    for here, folders, names in os.walk(base, followlinks=True, onerror=denied.append):
        below = os.path.relpath(here, base)
        prefix = "" if below == "." else f"{below}/"
        try:
            known = os.stat(here)  # noqa: PTH116
            if not os.access(here, os.X_OK):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), here)
        except OSError as err:
            denied.append(err)
            folders.clear()
            continue
        is_new = (known.st_dev, known.st_ino) not in entered
        entered.add((known.st_dev, known.st_ino))
        folders[:] = sorted(name for name in folders if is_new and enters(f"{prefix}{name}"))
        files |= {f"{prefix}{name}": Path(here, name) for name in names if is_new}
    # What vanished meanwhile is left out.
    gone = FileNotFoundError, NotADirectoryError
    return _Listing(
        base,
        files,
        {},
        {str(Path(os.fsdecode(err.filename))): str(err.strerror) for err in denied if not isinstance(err, gone)},
    )


def _matching(pattern: Place) -> tuple[_Listing, list[str]]:
    """List what is below the part of a pattern without signs; return also the parts of the rest."""
    text = pattern.key if isinstance(pattern, Url) else str(pattern)
    fixed = fixed_part(text)
    parts = text[len(fixed) :].split("/")
    base = replace(pattern, key=fixed.strip("/")) if isinstance(pattern, Url) else Path(fixed)
    return _listed(base, lambda below: _leads(parts, below.split("/"))), parts


def fixed_part(pattern: str) -> str:
    """Return the folder of a pattern before its first part with signs.

    >>> fixed_part("bags/2026-*/run.mcap"), fixed_part("*.mcap")
    ('bags/', '')
    """
    first = min(at for sign in "*?[" if (at := pattern.find(sign)) >= 0)
    return pattern[: pattern.rfind("/", 0, first) + 1]


def _matches(pattern: Sequence[str], names: Sequence[str]) -> bool:
    """Match parts of a name with those of a pattern as a shell does; no sign stands for the dot of a hidden name."""
    if not pattern:
        return not names
    first, rest = pattern[0], pattern[1:]
    if first == "**":
        more = bool(names) and not names[0].startswith(".") and _matches(pattern, names[1:])
        return more or _matches(rest, names)
    return bool(names) and _stands_for(first, names[0]) and _matches(rest, names[1:])


def _leads(pattern: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether a folder may hold a match, or is below one."""
    if not pattern or not names:
        return True
    if pattern[0] == "**":
        return not names[0].startswith(".") or _leads(pattern[1:], names)
    return _stands_for(pattern[0], names[0]) and _leads(pattern[1:], names[1:])


def _stands_for(part: str, name: str) -> bool:
    return fnmatchcase(name, part) and (part.startswith(".") or not name.startswith("."))


def files_named(text: str) -> tuple[Named, list[Place], list[UnreadableError]]:
    """Return the kind of a name, its files by name, and the folders that may not be searched (`UnreadableError` for none).

    Of folders only tables count, and none that are hidden (`.`) or records of a run (`_lidarcli`).
    """
    named, where, _ = _named(text)
    if named is Named.FILE:
        return named, [where], []
    if named is Named.PATTERN:
        listed, parts = _matching(where)
        files = [file for below, file in listed.files.items() if _matches(parts, below.split("/"))]
    else:
        listed = _listed(where)
        if isinstance(where, Url) and not listed.files:
            raise UnreadableError(f"{where}: {_absent(where)}")
        shown = {below: file for below, file in listed.files.items() if below.endswith(".parquet")}
        files = [file for below, file in shown.items() if not any(part[0] in "._" for part in below.split("/"))]
    denied = [UnreadableError(f"{folder}: cannot be searched: {why}") for folder, why in listed.denied.items()]
    return named, sorted(files, key=str), denied


def find_logs(inputs: Iterable[str], join: bool = False, note: Callable[[str], None] | None = None) -> Logs:
    """Return the logs that `inputs` name, in their order; a folder, also of a store, is searched, its logs sorted.

    `note` hears of logs in folders that a search leaves out.

    With `join`, the logs that are named are one log, which comes first, and so are those of each recording in parts that a
    search has found. Where one that is named is not there, none of them is read.
    """
    left = None if note is None else Counter[str]()
    found = [(text, _logs_named(text, left)) for text in inputs]
    if note is not None and left:
        names = ", ".join(f"{counted(count, 'file')} {name}" for name, count in sorted(left.items()))
        note(f"{names} {'was not looked at: name it' if left.total() == 1 else 'were not looked at: name them'}")
    if not join:
        return [source for _, here in found for source in here]
    named: list[Source] = []
    absent: Logs = []
    searched: Logs = []
    for text, here in found:
        first = here[0]
        if len(here) > 1 or first.path not in (text, str(place(text))):
            searched += here
        elif isinstance(first, Source):
            named.append(first)
        else:
            absent.append(first)
    return [*(absent or ([joined(named)] if named else [])), *joined_by_name(searched)]


def _logs_named(text: str, left: Counter[str] | None) -> Logs:
    """Return the logs that one name means, or a `MissingInput`."""
    if text == STDIN:
        return [Source(STDIN, "stdin")]
    try:
        named, where, state = _named(text)
        if named is Named.FILE:
            return [Source(str(where) if isinstance(where, Url) else text, stem_of(where.name), found=state)]
        if named is Named.PATTERN:
            found = _logs_of_pattern(where)
            why = "" if found else _absent(where)
        else:
            listed = _listed(where)
            found = _logs_below(listed, left)
            if isinstance(where, Path) and [one.path for one in found if isinstance(one, Source)] == [str(where)]:
                # The folder itself is one log.
                return [Source(text, log_name(where))]
            is_there = not isinstance(where, Url) or listed.files
            known = " ".join(f"*{suffix}" for suffix in SUFFIXES)
            why = f"no log in this folder (searched for {known})" if is_there else _absent(where)
    except UnreadableError as err:
        return [MissingInput(text, UnreadableError(str(err).removeprefix(f"{place(text)}: ").removeprefix(f"{text}: ")))]
    return found or [MissingInput(text, UnreadableError(why))]


def _logs_below(listed: _Listing, left: Counter[str] | None = None, pattern: Sequence[str] | None = None) -> Logs:
    """Return all logs below a folder, by name: bags and folders of sweeps, each as one log, and files by their suffix.

    With a pattern those below the folders that match it, and the files that do.
    """
    found: dict[str, Source | MissingInput | None] = {
        os.path.relpath(folder, str(listed.base)): MissingInput(folder, UnreadableError(f"cannot be searched: {why}"))
        for folder, why in listed.denied.items()
    }
    folders: dict[str, dict[str, Place]] = {}
    for below, where in listed.files.items():
        names = below.split("/")
        first = next((k for k in range(len(names)) if pattern is None or _matches(pattern, names[:k])), None)
        if first is None:
            found[below] = _source(where, below, listed) if pattern and _matches(pattern, names) else None
        # Hidden files are no logs: macOS puts a `._run.bag` next to every `run.bag` on foreign disks.
        elif not any(name.startswith(".") for name in names[first:]):
            folders.setdefault(below.rpartition("/")[0], {})[below] = where
    whole: list[str] = []
    for folder, files in sorted(folders.items()):
        if any(one in ("", folder) or folder.startswith(f"{one}/") for one in whole):
            continue
        inside = [*files.values()]
        if _are_one_log(inside):
            whole.append(folder)
            here = listed.base / folder if folder else listed.base
            is_stored = isinstance(here, Url)
            found[folder] = _together(str(here), folder or here.name, inside if is_stored else (), listed)
            continue
        for below, where in files.items():
            if where.name.lower().endswith(SUFFIXES):
                found[below] = _source(where, below, listed)
            elif left is not None and _is_readable(where):
                left["*" + "".join(PurePath(where.name).suffixes[-2 if where.suffix == ".gz" else -1 :])] += 1
    return [source for below in sorted(found, key=PurePosixPath) if (source := found[below]) is not None]


def _logs_of_pattern(pattern: Place) -> Logs:
    """Return the logs of a pattern, by their places below its part without signs; one where files hold one sweep each."""
    listed, parts = _matching(pattern)
    named = sorted((file for below, file in listed.files.items() if _matches(parts, below.split("/"))), key=str)
    is_other = any(file.name.lower().endswith(_SINGLE) for file in named)
    if not is_other and hold_one_sweep_each(named):
        return [_together(str(pattern), named[0].parent.name, named, listed)]
    return _logs_below(listed, pattern=parts)


def _source(where: Place, below: str, listed: _Listing) -> Source | MissingInput | None:
    """Return a file as a log; None for what is no file, as a pipe would wait for a writer for ever."""
    name = str(PurePosixPath(below).with_name(stem_of(where.name)))
    try:
        if isinstance(where, Path):
            return Source(str(where), name) if stat.S_ISREG(where.stat().st_mode) else None
        if place(str(where)) == where:
            return Source(str(where), name, found=listed.states[where])
    except OSError as err:
        return MissingInput(str(where), UnreadableError(f"cannot be opened: {err.strerror}"))
    except OptionError:
        pass
    return MissingInput(str(where), UnreadableError("its name cannot be that of a URL; rename the object"))


def _together(path: str, name: str, files: Sequence[Place], listed: _Listing) -> Source:
    """Return one log of several files; none are given of a folder of this machine, which its reader lists."""
    states = [listed.states[file] for file in files if file in listed.states]
    state = State(sum(one.size for one in states), max(one.mtime_ns for one in states)) if states else None
    return Source(path, name, tuple(map(str, files)), found=state)


def one_log(logs: Sequence[str], join: bool = False) -> Source:
    """Return the one log of a name, or with `join` of several (`OptionError` for more, `UnreadableError` for none)."""
    if not logs:
        raise OptionError("no log is named")
    log = logs[0]
    if len(logs) > 1 and not join:
        raise OptionError(f"{log} and {logs[1]}: name one log; --join reads parts of one recording as one log")
    sources = find_logs(logs, join)
    first = sources[0]
    if isinstance(first, MissingInput) and (join or len(sources) == 1):
        raise UnreadableError(f"{first.path}: {first.error}")
    if len(sources) > 1 or isinstance(first, MissingInput):
        hint = "" if join or not split_notes(sources) else ", or read those of one recording as one by --join"
        raise OptionError(f"{log}: holds {len(sources)} logs; name one of them{hint}")
    return first


def files_of(sources: Iterable[Source | MissingInput]) -> list[str]:
    """Return the files that sources are read from, none of which may be an output."""
    found: list[str] = []
    for source in sources:
        if isinstance(source, Source) and source.parts:
            found += files_of(source.parts)
            continue
        found += source.files if isinstance(source, Source) and source.files else [source.path]
        with suppress(OSError), os.scandir(source.path) as entries:
            # Of a store nothing is there.
            found += [entry.path for entry in entries]
    return found


def refuse_clashes(sources: Sequence[Source | MissingInput]) -> None:
    """Refuse two logs whose outputs would have the same name (`OptionError`)."""
    taken: dict[str, str] = {}
    for source in sources:
        if isinstance(source, Source) and (first := taken.setdefault(source.name, source.label)) != source.label:
            raise OptionError(f"{first} and {source.label} would both write {source.name}.*; run them apart with -o")


def log_name(path: Path) -> str:
    """Return the name of a log: its file name without container suffixes, or the name of its folder.

    >>> [log_name(Path(name)) for name in ("run.mcap", "x.csv.gz", "a.bag.active", "b.v2.db3")]
    ['run', 'x', 'a', 'b.v2']
    """
    name = path.name or path.resolve().name
    return name if path.is_dir() else stem_of(name)


def stem_of(name: str) -> str:
    """Return the name of a file without container suffixes."""
    known = False
    for suffixes in (_WRAPPER, _CONTAINER):
        stem, suffix = os.path.splitext(name)  # noqa: PTH122 (names, not paths)
        if stem and suffix.lower() in suffixes:
            name, known = stem, True
    return name if known else PurePath(name).stem


def _are_one_log(files: Sequence[Place]) -> bool:
    """Return whether the files of a folder are one log: a ROS 2 bag, or CSV files with one sweep each."""
    names = [file.name for file in files]
    if is_bag(names):
        return True
    if any(name.lower().endswith(BINARY_SUFFIXES) for name in names):
        return False
    return hold_one_sweep_each([file for file in files if file.name.lower().endswith(TEXT_SUFFIXES)])


def _is_readable(path: Place) -> bool:
    """Return whether a file whose name does not say so is a log."""
    with suppress(LidarcliError, OSError):
        if isinstance(path, Path) and stat.S_ISREG(path.stat().st_mode):
            open_log(path).close()
            return True
    return False


Shard = tuple[int, int]


def choose(
    logs: Sequence[str],
    listed: str | None = None,
    base: str | None = None,
    shard: Shard | None = None,
    join: bool = False,
    note: Callable[[str], None] | None = None,
) -> Logs:
    """Choose the logs of a run: those that are named, then those of the list (`-`: standard input), one a line.

    Their names have their places below `base`. Of a `shard` (I, N) only the I-th of N shares is taken, which a log belongs
    to by its name alone. `note` hears of logs that look like parts and are not joined, and of those that are left out.
    """
    found = find_logs(logs, join, note)
    if listed is not None:
        below: Logs = []
        for number, line in _lines(listed):
            for source in _logs_of_line(line):
                place_in_list = f"{listed}: line {number}: {source.path}"
                below.append(replace(source, path=place_in_list) if isinstance(source, MissingInput) else source)
        found += joined_by_name(below) if join else below
    if note is not None and not join:
        for words in split_notes(found):
            note(words)
    if base is not None:
        found = [_named_below(source, base) if isinstance(source, Source) else source for source in found]
    if shard is not None:
        found = [one for one in found if is_in_shard(one.name if isinstance(one, Source) else one.path, shard)]
    return found


def is_in_shard(key: str, shard: Shard) -> bool:
    """Return whether a log of this name belongs to a share, whatever others there are.

    >>> [key for key in ("run", "trip/run", "hall") if is_in_shard(key, (1, 2))]
    ['trip/run']
    """
    from hashlib import blake2b

    number, count = shard
    digest = blake2b(os.fsencode(key), digest_size=8).digest()
    return int.from_bytes(digest, "big") % count == number - 1


def _lines(listed: str) -> list[tuple[int, str]]:
    """Read the lines of a list that name something, with their numbers."""
    where = place(listed)
    with unreadable(listed):
        if listed == STDIN:
            data = sys.stdin.buffer.read()
        else:
            data = read_object(where) if isinstance(where, Url) else where.read_bytes()
    data = data.removeprefix(codecs.BOM_UTF8)
    if b"\0" in data:
        raise UnreadableError(f"{listed}: is no list of logs: it holds NUL bytes; write one name a line, in UTF-8")
    lines = [(number, os.fsdecode(line).strip()) for number, line in enumerate(data.split(b"\n"), 1)]
    return [(number, line) for number, line in lines if line and not line.startswith("#")]


def _logs_of_line(line: str) -> Logs:
    """Return the logs that a line of a list names; no request to a store for what can only be one log."""
    url = place(line) if is_url(line) and not line.endswith("/") else None
    if isinstance(url, Url) and not url.has_magic() and url.name.lower().endswith((*_SINGLE, *TEXT_SUFFIXES)):
        return [Source(str(url), stem_of(url.name))]
    return find_logs([line])


def _named_below(source: Source, base: str) -> Source:
    """Return the log with its place below `base` in its name."""
    below = PurePosixPath(os.path.relpath(absolute(source.path), absolute(base)))
    if is_url(source.path) != is_url(base) or below.parts[:1] in ((), ("..",)):
        raise OptionError(f"{source.path}: is not below --base {base}")
    return replace(source, name=str(below.with_name(PurePosixPath(source.name).name)))


_MOST = 3
"""Recordings in parts that notes name."""


def joined(parts: Sequence[Source]) -> Source:
    """Return one log of recordings that a user names, called by what their names share, or the only one as it is."""
    if len(parts) < 2:
        return parts[0]
    taken: set[str] = set()
    for part in parts:
        if part.is_stdin:
            raise OptionError("--join opens logs more than once: give the name of a file instead of -")
        where = part.path if is_url(part.path) else os.path.realpath(part.path)
        if where in taken:
            raise OptionError(f"--join: {part.path} is named twice")
        taken.add(where)
    ordered = sorted(parts, key=lambda part: natural(part.path))
    names = [numbered(part.name) for part in ordered]
    is_split = names[0] is not None and len({name.stem if name else None for name in names}) == 1
    return _of(ordered, names[0].log if is_split and names[0] else ordered[0].name)


def joined_by_name(found: Sequence[Source | MissingInput]) -> Logs:
    """Return logs with the parts of each recording as one log, in the place of its first part."""
    whole: dict[str, Source] = {}
    behind: set[str] = set()
    for name, group in _groups(found):
        whole[group[0].path] = _of(group, str(PurePosixPath(group[0].name).with_name(name.log)))
        behind |= {part.path for part in group[1:]}
    return [whole.get(source.path, source) for source in found if source.path not in behind]


def split_notes(found: Sequence[Source | MissingInput]) -> list[str]:
    """Return notes on logs that look like parts of one recording."""
    groups = [group for _, group in _groups(found)]
    notes = [
        f"{group[0].path} and {len(group) - 1} more look like parts of one recording: --join reads them as one log"
        for group in groups[:_MOST]
    ]
    if len(groups) > _MOST:
        notes.append(f"so do the files of {counted(len(groups) - _MOST, 'more recording')}")
    return notes


def _of(parts: Sequence[Source], name: str) -> Source:
    return replace(parts[0], name=name, files=(), parts=tuple(parts), found=None)


def _groups(found: Iterable[Source | MissingInput]) -> Iterator[tuple[Numbered, list[Source]]]:
    """Yield the name of each recording and its several parts: files of one folder and stem, numbered from 0 on.

    Without a number 0 files are no parts: days of a month and robots are numbered, too.
    """
    alike: dict[tuple[str, str, str], list[tuple[str, int, Numbered, Source]]] = {}
    for source in found:
        name = numbered(source.file_name) if isinstance(source, Source) and not (source.files or source.parts) else None
        if isinstance(source, Source) and name is not None and name.suffix in (".bag", ".mcap", ".db3"):
            key = str(place(source.path).parent), name.stem, name.suffix
            # Names of one stem differ in their dates, which sort by time.
            alike.setdefault(key, []).append((name.log, name.number, name, source))
    for parts in alike.values():
        groups: list[list[tuple[str, int, Numbered, Source]]] = []
        last = -1
        for part in sorted(parts, key=lambda part: part[:2]):
            if part[1] == 0 or part[1] <= last:
                groups.append([])
            if groups and (groups[-1] or part[1] == 0):
                groups[-1].append(part)
            last = part[1]
        yield from ((group[0][2], [part[3] for part in group]) for group in groups if len(group) > 1)
