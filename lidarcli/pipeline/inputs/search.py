"""From what a user names to the logs it means: files, folders, URLs, patterns, lists and shares of them."""

from __future__ import annotations

import codecs
import glob
import os
import re
import stat
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path, PurePath, PurePosixPath

from lidarcli.display import counted
from lidarcli.errors import LidarcliError, OptionError, UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import BINARY_SUFFIXES, TEXT_LOG_SUFFIXES, TEXT_SUFFIXES
from lidarcli.logs.joined import Numbered, natural, numbered
from lidarcli.logs.registry import is_bag
from lidarcli.pipeline.inputs.files import Objects, fixed_part, folder_of_pattern, matcher_of, matching, read_file
from lidarcli.pipeline.inputs.sources import STDIN, MissingInput, Source, hold_one_sweep_each
from lidarcli.stores import Place, State, Url, has_bucket, head, is_folder, is_url, listing, place

SUFFIXES = (".mcap", ".bag", ".active", ".db3", ".csv", ".csv.gz", ".zstd", *TEXT_LOG_SUFFIXES)
"""Suffixes of logs in a folder that is searched; a file that is named is opened whatever its suffix."""

_CONTAINER = (".mcap", ".bag", ".db3", ".csv", ".tsv", ".txt", ".log", ".clf", ".gfs", ".jsonl", ".ndjson")
_WRAPPER = (".gz", ".zstd", ".active")


def find_logs(
    inputs: Iterable[str], join: bool = False, note: Callable[[str], None] | None = None
) -> list[Source | MissingInput]:
    """Return the logs that `inputs` name, in their order; a folder, also of a store, is searched, its logs sorted.

    `note` hears of logs in folders that a search leaves out.

    With `join`, the logs that are named are one log, which comes first, and so are those of each recording in parts that a
    search has found. Where one that is named is not there, none of them is read.
    """
    left = None if note is None else Counter[str]()
    found = [(text, _named(text, left)) for text in inputs]
    if note is not None and left:
        note(left_out(left))
    if not join:
        return [source for _, here in found for source in here]
    named: list[Source] = []
    absent: list[Source | MissingInput] = []
    searched: list[Source | MissingInput] = []
    for text, here in found:
        first = here[0]
        if len(here) > 1 or (first.path != text and not (is_url(text) and first.path == str(place(text)))):
            searched += here
        elif isinstance(first, Source):
            named.append(first)
        else:
            absent.append(first)
    return [*(absent or ([joined(named)] if named else [])), *joined_by_name(searched)]


def _named(text: str, left: Counter[str] | None) -> list[Source | MissingInput]:
    """Return the logs that one name means, or a `MissingInput`."""
    if is_url(text):
        return find_stored(text)
    path = Path(text)
    if text == STDIN:
        return [Source(STDIN, "stdin")]
    if (denied := _denied(path)) is not None:
        return [MissingInput(text, UnreadableError(f"cannot be opened: {denied}"))]
    if not path.exists():
        return [*_pattern(text)]
    if path.is_dir() and not is_one_log(path):
        return _search(path, left) or [MissingInput(text, UnreadableError(f"no log in this folder ({known_suffixes()})"))]
    return [Source(text, log_name(path))]


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
        if isinstance(source, MissingInput):
            continue
        if source.name in taken:
            first, second = taken[source.name], source.label
            raise OptionError(f"{first} and {second} would both write {source.name}.*; run them apart with -o")
        taken[source.name] = source.label


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


def is_one_log(folder: Path) -> bool:
    """Return whether a folder is one log: a ROS 2 bag, or CSV files with one sweep each."""
    try:
        names = sorted(item.name for item in folder.iterdir() if item.is_file())
    except OSError:
        return False
    return are_one_log(folder, names)


def are_one_log(folder: Place, names: Sequence[str]) -> bool:
    """Return whether a folder with files of these names is one log, as `is_one_log` does."""
    if is_bag(names):
        return True
    if any(name.lower().endswith(BINARY_SUFFIXES) for name in names):
        return False
    return hold_one_sweep_each([folder / name for name in names if name.lower().endswith(TEXT_SUFFIXES)])


def left_out(left: Counter[str]) -> str:
    """Return a note on logs that a search has left out."""
    parts = [f"{counted(count, 'file')} {where}" for where, count in sorted(left.items())]
    were = "was not looked at: name it" if left.total() == 1 else "were not looked at: name them"
    return f"{', '.join(parts)} {were}"


def _is_readable(path: Path) -> bool:
    """Return whether a file whose name does not say so is a log."""
    with suppress(LidarcliError, OSError):
        if stat.S_ISREG(path.stat().st_mode):
            open_log(path).close()
            return True
    return False


def _search(folder: Path, left: Counter[str] | None) -> list[Source | MissingInput]:
    """Return the logs below a folder by path, and the folders that could not be searched.

    Links are followed; a folder that was seen already is not entered again.
    """
    visited: set[tuple[int, int]] = set()
    found: dict[Path, Source | MissingInput] = {}

    def unreadable(err: OSError, cannot: str = "cannot be searched") -> None:
        path = Path(os.fsdecode(err.filename))
        found[path] = MissingInput(str(path), UnreadableError(f"{cannot}: {err.strerror}"))

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
        if (known.st_dev, known.st_ino) in visited:
            folders.clear()
            continue
        visited.add((known.st_dev, known.st_ino))
        # Hidden files are no logs: macOS puts a `._run.bag` beside every `run.bag` on foreign disks.
        shut = [at / name for name in folders if name.startswith(".")]
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        logs = [at / name for name in folders if is_one_log(at / name)]
        folders[:] = [name for name in folders if at / name not in logs]
        names = (name for name in files if not name.startswith(".") and name.lower().endswith(SUFFIXES))
        logs += filter(is_log, (at / name for name in names))
        if left is not None:
            for log in (log for log in logs if log.is_dir()):
                shut += [inside for inside in log.iterdir() if inside.is_dir()]
            for each in shut:
                with suppress(OSError):
                    left.update(f"in {each}" for item in each.iterdir() if item.name.lower().endswith(SUFFIXES))
            others = (at / name for name in files if name[0] != "." and not name.lower().endswith(SUFFIXES))
            for path in filter(_is_readable, others):
                left["*" + "".join(path.suffixes[-2 if path.suffix == ".gz" else -1 :])] += 1
        found |= {log: Source(str(log), _below(folder, log)) for log in logs}
    return [found[path] for path in sorted(found)]


def _denied(path: Path) -> str | None:
    """Return the reason for which the system does not even say whether there is something; None where it does."""
    try:
        path.stat()
    except PermissionError as err:
        return err.strerror
    except (OSError, ValueError):
        return None
    return None


def _below(folder: Path, log: Path) -> str:
    return log.relative_to(folder).with_name(log_name(log)).as_posix()


def _pattern(text: str) -> Iterator[Source | MissingInput]:
    """Yield the logs of a pattern that no shell has expanded; one log where its files hold one sweep each."""
    if Path(text).is_symlink():
        yield MissingInput(text, UnreadableError("the link leads to nothing"))
        return
    files, denied = matching(text) if glob.has_magic(text) else ([], [])
    for err in denied:
        yield MissingInput(os.fsdecode(err.filename), UnreadableError(f"cannot be searched: {err.strerror}"))
    if not files and not denied:
        hint = "; URLs of stores begin with s3://, gs:// or az://" if re.match(r"[a-z0-9]+:/", text) else ""
        yield MissingInput(text, UnreadableError(f"no such file or folder{hint}"))
    elif files and hold_one_sweep_each([Path(file) for file in files]):
        yield Source(text, log_name(Path(files[0]).parent), tuple(files))
    elif files:
        yield from _keyed(text, find_logs(files))


def _keyed(pattern: str, found: Iterable[Source | MissingInput]) -> Iterator[Source | MissingInput]:
    """Yield the logs of a pattern, named by their places below its part without signs, which keeps names apart."""
    base = fixed_part(pattern)
    visited: set[str] = set()
    for source in found:
        # `**` names a folder and what is in it.
        above = {str(parent) for parent in PurePath(source.path).parents}
        if source.path in visited or any(path in visited and Path(path).is_dir() for path in above):
            continue
        visited.add(source.path)
        if isinstance(source, Source) and not PurePath(source.name).parent.parts:
            below = os.path.relpath(source.path, base or ".")
            name = PurePath(below).with_name(source.name).as_posix()
            yield source if name.split("/")[0] == ".." else replace(source, name=name)
        else:
            yield source


def known_suffixes() -> str:
    return "searched for " + " ".join(f"*{suffix}" for suffix in SUFFIXES)


def find_stored(text: str) -> list[Source | MissingInput]:
    """Return the logs of a URL: an object, all below a folder, or those that match a pattern; sorted by name.

    In a pattern `*` and `?` stop at a slash and `**/` stands for any folders. Where listing fails, one
    `MissingInput` says why.
    """
    url = place(text)
    assert isinstance(url, Url)
    try:
        # Not asked of what can only be a folder or a pattern; names may hold brackets.
        if url.key and not text.endswith("/") and "*" not in url.key and (state := head(url)) is not None:
            return [Source(str(url), stem_of(url.name), found=state)]
        if url.has_magic() and ("*" in url.key or not is_folder(url)):
            return _matching(text, url)
        objects = dict(listing(url))
        found = _stored_below(url, objects)
        if found:
            return found
        why = "no such object or folder" if has_bucket(url) else "there is no such bucket"
        return [MissingInput(text, UnreadableError(f"no log in this folder ({known_suffixes()})" if objects else why))]
    except UnreadableError as err:
        return [MissingInput(text, UnreadableError(str(err).removeprefix(f"{url}: ")))]


def _stored_below(base: Url, objects: Objects) -> list[Source | MissingInput]:
    """Return all logs below a folder: bags and folders of sweeps, each as one log, and objects by their suffix."""
    folders: dict[str, list[Url]] = {"": []}
    found: dict[PurePosixPath, Source | MissingInput] = {}
    for url in objects:
        below = url.key.removeprefix(base.key).strip("/")
        if {".", ".."} & {*below.split("/")} and url.name.lower().endswith(SUFFIXES):
            found[PurePosixPath(below)] = _odd(url, "has a part that is . or ..")
        elif not any(part.startswith(".") for part in below.split("/")):
            folders.setdefault(below.rpartition("/")[0], []).append(url)
    whole: list[str] = []
    for folder, urls in sorted(folders.items()):
        if any(folder == one or folder.startswith(f"{one}/") or not one for one in whole):
            continue
        here = base / folder if folder else base
        if are_one_log(here, [url.name for url in urls]):
            whole.append(folder)
            found[PurePosixPath(folder)] = _of_objects(str(here), folder or base.name, urls, objects)
            continue
        for url in urls:
            if url.name.lower().endswith(SUFFIXES):
                key = PurePosixPath(folder) / url.name
                name = str(key.with_name(stem_of(url.name)))
                found[key] = _source(url, name, objects)
    return [found[key] for key in sorted(found)]


def _matching(text: str, pattern: Url) -> list[Source | MissingInput]:
    """Return the logs of a pattern, by their places below its part without signs."""
    base, objects = folder_of_pattern(pattern)
    matches = matcher_of(pattern)
    urls = [url for url in objects if matches(url.key)]
    if hold_one_sweep_each([url for url in urls if url.suffix in (".csv", ".tsv", ".txt")]):
        return [_of_objects(str(pattern), urls[0].parent.name, urls, objects)]
    found: dict[str, Source | MissingInput] = {}
    # A pattern may also name folders: bags, or some to search; what is in a bag is no log of its own.
    folders = {str(parent) for url in objects for parent in PurePosixPath(url.key).parents} - {".", base.key}
    for folder in sorted(filter(matches, folders)):
        inside = {url: state for url, state in objects.items() if url.key.startswith(f"{folder}/")}
        here = replace(base, key=folder)
        prefix = folder.removeprefix(base.key).strip("/")
        for source in _stored_below(here, inside):
            if isinstance(source, Source):
                name = prefix if source.path == str(here) else f"{prefix}/{source.name}"
                found[source.path] = replace(source, name=name)
            else:
                found[source.path] = source
    in_bags = {file for source in found.values() if isinstance(source, Source) for file in source.files}
    for url in urls:
        below = PurePosixPath(url.key.removeprefix(base.key).strip("/"))
        if str(url) not in found and str(url) not in in_bags:
            found[str(url)] = _source(url, str(below.with_name(stem_of(url.name))), objects)
    if found:
        return [found[path] for path in sorted(found)]
    why = "no object matches this pattern" if objects or has_bucket(pattern) else "there is no such bucket"
    return [MissingInput(text, UnreadableError(why))]


def _source(url: Url, name: str, objects: Objects) -> Source | MissingInput:
    """Return an object as a log, unless its URL reads like one with credentials."""
    try:
        is_same = place(str(url)) == url
    except OptionError:
        is_same = False
    if not is_same:
        return _odd(url, "has an empty part (//)" if "//" in url.key else "reads like credentials")
    return Source(str(url), name, found=objects[url])


def _odd(url: Url, why: str) -> MissingInput:
    """Return the error of an object whose name cannot be used."""
    return MissingInput(str(url), UnreadableError(f"its name {why}; rename the object"))


def _of_objects(path: str, name: str, urls: list[Url], objects: Objects) -> Source:
    """Return several objects as one log."""
    size = sum(objects[url].size for url in urls)
    state = State(size, max(objects[url].mtime_ns for url in urls))
    return Source(path, name, tuple(map(str, urls)), found=state)


Shard = tuple[int, int]


def choose(
    logs: Sequence[str],
    listed: str | None = None,
    base: str | None = None,
    shard: Shard | None = None,
    join: bool = False,
    note: Callable[[str], None] | None = None,
) -> list[Source | MissingInput]:
    """Choose the logs of a run: those that are named, then those of the list (`-`: standard input), one a line.

    Their names have their places below `base`. Of a `shard` (I, N) only the I-th of N shares is taken, which a log belongs
    to by its name alone. `note` hears of logs that look like parts and are not joined, and of those that are left out.
    """
    found = find_logs(logs, join, note)
    if listed is not None:
        below: list[Source | MissingInput] = []
        for number, line in _lines(listed):
            for source in _listed(line):
                place_in_list = f"{listed}: line {number}: {source.path}"
                below.append(replace(source, path=place_in_list) if isinstance(source, MissingInput) else source)
        found += joined_by_name(below) if join else below
    if note is not None and not join:
        for words in split_notes(found):
            note(words)
    if base is not None:
        found = [_named_below(source, base) if isinstance(source, Source) else source for source in found]
    if shard is not None:
        found = [source for source in found if is_in_shard(_key(source), shard)]
    return found


def is_in_shard(key: str, shard: Shard) -> bool:
    """Return whether a log of this name belongs to a share, whatever others there are.

    >>> [key for key in ("run", "trip/run", "hall") if is_in_shard(key, (1, 2))]
    ['trip/run']
    """
    number, count = shard
    digest = blake2b(os.fsencode(key), digest_size=8).digest()
    return int.from_bytes(digest, "big") % count == number - 1


def _key(source: Source | MissingInput) -> str:
    return source.name if isinstance(source, Source) else source.path


def _lines(listed: str) -> list[tuple[int, str]]:
    """Read the lines of a list that name something, with their numbers."""
    data = sys.stdin.buffer.read() if listed == STDIN else read_file(listed)
    data = data.removeprefix(codecs.BOM_UTF8)
    if b"\0" in data:
        raise UnreadableError(f"{listed}: is no list of logs: it holds NUL bytes; write one name a line, in UTF-8")
    lines = [(number, os.fsdecode(line).strip()) for number, line in enumerate(data.split(b"\n"), 1)]
    return [(number, line) for number, line in lines if line and not line.startswith("#")]


def _listed(line: str) -> list[Source | MissingInput]:
    """Return the logs that a line of a list names."""
    return [_object(line)] if _is_object(line) else find_logs([line])


def _is_object(line: str) -> bool:
    """Return whether a line can only be one log in a store, so that the store need not be asked before it is opened."""
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
    """Return the log with its place below `base` in its name."""
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


_RECORDED = (".bag", ".mcap", ".db3")
"""Suffixes of what recorders split."""
_MOST = 3
"""Recordings in parts that notes name."""


def joined(parts: Sequence[Source]) -> Source:
    """Return one log of recordings that a user names, called by what their names share, or the only one as it is."""
    if len(parts) < 2:
        return parts[0]
    visited: set[str] = set()
    for part in parts:
        if part.is_stdin:
            raise OptionError("--join opens logs more than once: give the name of a file instead of -")
        where = part.path if is_url(part.path) else os.path.realpath(part.path)
        if where in visited:
            raise OptionError(f"--join: {part.path} is named twice")
        visited.add(where)
    ordered = sorted(parts, key=lambda part: natural(part.path))
    names = [numbered(part.name) for part in ordered]
    is_split = names[0] is not None and len({name.stem if name else None for name in names}) == 1
    return _of(ordered, names[0].log if is_split and names[0] else ordered[0].name)


def joined_by_name(found: Sequence[Source | MissingInput]) -> list[Source | MissingInput]:
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


def split_notes(found: Sequence[Source | MissingInput]) -> list[str]:
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


def _groups(found: Iterable[Source | MissingInput]) -> list[list[Source]]:
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
