"""The containers that lidarcli reads, and `open_log`, which finds the reader of a log by its content.

A new container is a package or a module in `logs/` and one entry in `FORMATS`, which has all that others know of it.
"""

from __future__ import annotations

import codecs
import glob
import io
import os
import re
import select
import stat
import sys
import zlib
from collections.abc import Callable, Collection, Iterable, Sequence
from fnmatch import fnmatchcase
from importlib import import_module
from pathlib import Path
from typing import BinaryIO, cast

from lidarcli.errors import LidarcliError, NoScanError, UnreadableError, unreadable
from lidarcli.logs.base import CLOUD_TYPES, LASERSCAN, SCAN_TYPES, Log, OpenOptions, Topic
from lidarcli.logs.text import is_carmen, is_json_lines
from lidarcli.ros.bag_metadata import METADATA
from lidarcli.system.records import dataclass

HEAD = 4096

GZIP = b"\x1f\x8b"
ZSTD = b"\x28\xb5\x2f\xfd"
SQLITE = b"SQLite format 3\0"
MCAP = (b"\x89MCAP0\r\n", b"\x89MCAP0\n")
ROS1 = (b"#ROSBAG V", b"#ROSRECORD")

_STORAGE = re.compile(r"\.(db3|mcap)(\.(zstd|zst))?$", re.IGNORECASE)
_PART = re.compile(r"(.+)_(\d+)\.(?:db3|db3\.zstd|mcap\.zstd)")
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@dataclass(frozen=True, slots=True)
class Format:
    """A container format: its names, its reader, how its content is recognised, and what holds for all its logs."""

    kind: str
    """Beginning of `Log.format` of its logs."""
    name: str
    """Name for people: `MCAP`, `ROS 1 bag` ..."""
    module: str
    reader: str
    """The class in `module`: a `Log` whose constructor takes a path and `OpenOptions`."""
    suffixes: tuple[str, ...]
    """Suffixes of its files in a folder that is searched; a file that is named is opened whatever its suffix."""
    vague: tuple[str, ...] = ()
    """Suffixes that its files may have, as others that are no logs."""
    magic: tuple[bytes, ...] = ()
    """Beginnings of its files; none for text."""
    begins: Callable[[bytes], bool] = lambda _text: False
    """Recognises a text by its beginning, with gzip and UTF-16 undone."""
    sniff_folder: Callable[[Path], bool] = lambda _folder: False
    in_metres: bool = True
    """True where ranges are metres unless an option says otherwise; readers of text know their units."""
    has_poses: bool = True
    streams: bool = False
    many: bool = False
    """True if the reader accepts a list of files that make one log."""

    def sniff(self, head: bytes) -> bool:
        """Return True for the first bytes of a file of this format."""
        if self.magic:
            return head.startswith(self.magic)
        text = gunzip_start(head) if head.startswith(GZIP) else head
        return self.begins(text.decode("utf-16", "ignore").encode() if text.startswith(_UTF16) else text)

    def open(self, source: object, options: OpenOptions) -> Log:
        """Open a log; the reader is imported only now, so that a log costs the libraries of its own container alone."""
        return cast(Log, getattr(import_module(self.module), self.reader)(source, options))


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


def _is_rosbag2_folder(folder: Path) -> bool:
    """Return True for the folder of one bag; storage files of different names without metadata are separate logs."""
    names = [entry.name for entry in folder.iterdir() if entry.is_file()]
    return is_bag(names) or sum(map(is_storage, names)) == 1


def _is_text(head: bytes) -> bool:
    """Return True for text: no NUL, hardly a control character, valid UTF-8 up to a cut at the end."""
    controls = sum(byte < 32 and byte not in b"\t\n\r\f" for byte in head)
    if not head or b"\0" in head or controls > len(head) // 100:
        return False
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as err:
        return err.start >= len(head) - 3 or head.count(b"\n") > 0
    return True


def gunzip_start(head: bytes) -> bytes:
    """Decompress the beginning of a gzip file; empty if it is broken."""
    try:
        return zlib.decompressobj(wbits=31).decompress(head, HEAD)
    except zlib.error:
        return b""


def has_file(folder: Path, endings: Iterable[str]) -> bool:
    """Return True if a folder directly holds a file with one of these endings, in any case."""
    return any(entry.name.lower().endswith(tuple(endings)) and entry.is_file() for entry in folder.iterdir())


def _is_csv_folder(folder: Path) -> bool:
    return has_file(folder, TEXT_SUFFIXES) and not has_file(folder, BINARY_SUFFIXES)


FORMATS: tuple[Format, ...] = (
    Format("mcap", "MCAP", "lidarcli.logs.mcap", "McapLog", (".mcap",), magic=MCAP, streams=True),
    Format("ros1 bag", "ROS 1 bag", "lidarcli.logs.rosbag1", "Rosbag1Log", (".bag", ".active"), magic=ROS1, streams=True),
    Format(
        "ros2 bag",
        "ROS 2 bag (folder, .db3, compressed)",
        "lidarcli.logs.rosbag2",
        "Rosbag2Log",
        (".db3", ".zstd"),
        magic=(SQLITE, ZSTD),
        sniff_folder=_is_rosbag2_folder,
    ),
    Format(
        "carmen",
        "CARMEN log (also .gz)",
        "lidarcli.logs.carmen",
        "CarmenLog",
        (".clf", ".gfs", ".clf.gz", ".gfs.gz"),
        (".log",),
        begins=is_carmen,
        in_metres=False,
        streams=True,
    ),
    Format(
        "json lines",
        "JSON lines of `mcap cat` (also .gz)",
        "lidarcli.logs.foxglove",
        "JsonLinesLog",
        (),
        (".jsonl", ".ndjson"),
        begins=is_json_lines,
        has_poses=False,
        streams=True,
    ),
    Format(
        "csv",
        "CSV (also .gz, or a folder of one file per sweep)",
        "lidarcli.logs.csv",
        "CsvLog",
        (".csv", ".csv.gz"),
        (".tsv", ".txt", ".tsv.gz", ".txt.gz"),
        begins=_is_text,
        sniff_folder=_is_csv_folder,
        in_metres=False,
        has_poses=False,
        streams=True,
        many=True,
    ),
)
SUFFIXES = tuple(suffix for known in FORMATS for suffix in known.suffixes)
"""Suffixes of logs in a folder that is searched."""
BINARY_SUFFIXES = tuple(suffix for known in FORMATS if known.magic for suffix in known.suffixes)
TEXT_SUFFIXES = tuple(suffix for known in FORMATS if known.many for suffix in (*known.suffixes, *known.vague))
"""Suffixes of files that may be one sweep each."""

_KNOWN = ", ".join(known.name for known in FORMATS)
PIPE_WAIT_S = 10.0


def format_of(log: Log) -> Format:
    """Return the format of an open log; of one that is joined of several parts that of its first one."""
    return next(known for known in FORMATS if log.format.startswith(known.kind))


def open_log(source: str | Path | BinaryIO, *, opening: OpenOptions | None = None) -> Log:
    """Open a log by its content: a file, a folder, `-` for standard input, or a binary stream.

    A pattern (`sweeps/*.csv`) is one log made of the files that match it. Raises `UnreadableError` with one line where
    there is nothing to read.
    """
    options = opening or OpenOptions()
    if not isinstance(source, str | Path):
        return _open_stream(source, str(getattr(source, "name", "-")), options)
    name = str(source)
    if name == "-":
        return _open_stream(sys.stdin.buffer, name, options)
    path = Path(source)
    try:
        if glob.has_magic(name) and not path.exists():
            return _open_pattern(name, options)
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            return _open_folder(path, name, options)
        if stat.S_ISFIFO(mode):
            pipe = _open_pipe(path, name)
            try:
                return _open_stream(pipe, name, options, owned=True)
            except UnreadableError:
                pipe.close()
                raise
        if not stat.S_ISREG(mode):
            raise UnreadableError(f"{name}: is neither a file nor a folder nor a pipe")
        with path.open("rb") as file:
            head = file.read(HEAD)
    except OSError as err:
        raise UnreadableError(f"{name}: cannot be opened: {err.strerror or err}") from err
    except ValueError as err:
        raise UnreadableError(f"{name!r}: cannot be the name of a file") from err
    return _sniffed(head, name).open(path, options)


def _sniffed(head: bytes, name: str) -> Format:
    if not head:
        raise UnreadableError(f"{name}: is empty")
    if head.startswith(GZIP) and gunzip_start(head).startswith(tuple(magic for known in FORMATS for magic in known.magic)):
        raise UnreadableError(f"{name}: a log packed with gzip; unpack it first (gunzip)")
    for known in FORMATS:
        if known.sniff(head):
            return known
    raise UnreadableError(f"{name}: not a log lidarcli knows; it reads {_KNOWN}")


def _open_folder(path: Path, name: str, options: OpenOptions) -> Log:
    for known in FORMATS:
        if known.sniff_folder(path):
            return known.open(path, options)
    if has_file(path, BINARY_SUFFIXES):
        raise UnreadableError(f"{name}: a folder of several logs; name one of them")
    raise UnreadableError(f"{name}: a folder without a log; lidarcli reads {_KNOWN}")


def _open_pattern(name: str, options: OpenOptions) -> Log:
    files = [Path(match) for match in sorted(glob.glob(name))]  # noqa: PTH207 (absolute patterns too)
    if not files:
        raise UnreadableError(f"{name}: no file matches this pattern")
    kinds = set()
    for file in files:
        with file.open("rb") as stream:
            kinds.add(_sniffed(stream.read(HEAD), str(file)))
    known = kinds.pop()
    if kinds or not known.many:
        raise UnreadableError(f"{name}: only files of one sweep each (CSV) make one log; name other logs one by one")
    log = known.open(files, options)
    log.path = name
    return log


def _open_stream(stream: BinaryIO, name: str, options: OpenOptions, owned: bool = False) -> Log:
    """Open a log from a stream; the log closes the stream in the end if it is `owned`."""
    with unreadable(name):
        head = _read_start(stream)
    known = _sniffed(head, name)
    if not known.streams:
        raise UnreadableError(f"{name}: a {known.name} cannot be read from a pipe; give the name of its file instead")
    whole = cast(BinaryIO, io.BufferedReader(_Rejoined(head, stream, owned), 1 << 16))
    try:
        log = known.open(whole, options)
    except UnreadableError as err:
        raise UnreadableError(f"{name}: {str(err).removeprefix('-: ')}") from err
    log.path = name
    return log


def _read_start(stream: BinaryIO) -> bytes:
    head = b""
    while len(head) < HEAD and (piece := stream.read(HEAD - len(head))):
        head += piece
    return head


def _open_pipe(path: Path, name: str) -> BinaryIO:
    """Open a named pipe without waiting forever for somebody to write to it."""
    file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    poll = select.poll()
    poll.register(file, select.POLLIN | select.POLLHUP)
    if not poll.poll(PIPE_WAIT_S * 1000):
        os.close(file)
        raise UnreadableError(f"{name}: nobody has written to this pipe for {PIPE_WAIT_S:g} s")
    os.set_blocking(file, True)
    return os.fdopen(file, "rb", buffering=0)


class _Rejoined(io.RawIOBase):
    """A stream whose first bytes have been read already, put together again."""

    def __init__(self, head: bytes, rest: BinaryIO, owned: bool) -> None:
        super().__init__()
        self._head = head
        self._rest = rest
        self._owned = owned

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        data = self._head[: len(buffer)] if self._head else self._rest.read(len(buffer))
        self._head = self._head[len(data) :]
        buffer[: len(data)] = data
        return len(data)

    def close(self) -> None:
        if self._owned:
            self._rest.close()
        super().close()


_SHOWN = 5


def scan_topics(topics: Iterable[Topic]) -> list[str]:
    """Return the sorted names of topics that sweeps are read from."""
    return sorted({topic.name for topic in topics if topic.is_scan})


def bare(name: str) -> str:
    """Return a topic name without leading slash, for comparison: old logs have none.

    >>> bare("/scan") == bare("scan")
    True
    """
    return name.lstrip("/")


def is_pattern(name: str) -> bool:
    """Return True for a pattern: `*` for any text, `?` for any character, `[ab]` for one of these."""
    return any(mark in name for mark in "*?[")


def means(wanted: str, topic: str) -> bool:
    """Return True if a wanted name or pattern means a topic.

    >>> means("scan", "/scan"), means("/scan*", "/scan_front"), means("/scan", "/scan_front")
    (True, True, False)
    """
    if bare(wanted) == bare(topic):
        return True
    return is_pattern(wanted) and fnmatchcase(bare(topic), bare(wanted))


def no_scan_topic(names: Sequence[str] = ()) -> str:
    """Return words for missing topics: the wanted ones, or any."""
    return f"no LaserScan topic{_named(names)} in this log"


def clouds_hint(topics: Iterable[Topic]) -> str:
    """Return a hint for topics that hold point clouds; empty without any."""
    clouds = sorted(topic.name for topic in topics if topic.type in CLOUD_TYPES)
    if not clouds:
        return ""
    return f"; to read the point clouds of {_some(clouds)} as sweeps, add --slice ZMIN ZMAX (heights in metres)"


class TopicChoice:
    """Wanted LaserScan topics of a log, existing ones, and those met while reading.

    A wanted name may be a pattern. A leading slash counts only where a log has both names. A log without an index shows its
    topics while it is read: `takes` remembers them.
    """

    def __init__(self, wanted: Collection[str] | None, topics: Sequence[Topic] | None) -> None:
        """`topics` are those that the log lists, None where it lists none; without any `wanted` all are read."""
        self.wanted = tuple(sorted(set(wanted or ())))
        self.is_listed = topics is not None
        self._topics = topics or ()
        self._there = set(scan_topics(self._topics))

    @property
    def there(self) -> list[str]:
        """LaserScan topics that the log lists, or that were met."""
        return sorted(self._there)

    @property
    def chosen(self) -> list[str]:
        """Topics that are read."""
        if not self.wanted:
            return self.there
        if not self.is_listed:
            return [name for name in self.there if any(means(wanted, name) for wanted in self.wanted)]
        return sorted({name for wanted in self.wanted for name in self._found(wanted)})

    @property
    def asked(self) -> frozenset[str] | None:
        """Names to ask of the log, as it spells them; None for all."""
        return frozenset(self.chosen) if self.wanted and self.is_listed else None

    @property
    def first(self) -> str | None:
        """First topic of the tables, where that is known before reading."""
        known = self.chosen if self.is_listed else self.wanted if len(self.wanted) == 1 else ()
        if not self.is_listed and any(map(is_pattern, known)):
            return None
        return next(iter(known), None)

    @property
    def missing(self) -> tuple[str, ...]:
        """Wanted names that match no topic."""
        return tuple(name for name in self.wanted if not self._found(name))

    def takes(self, topic: str) -> bool:
        """Return True if the sweeps of a topic met while reading are wanted; remember the topic."""
        self._there.add(topic)
        return not self.wanted or self.is_listed or any(means(wanted, topic) for wanted in self.wanted)

    def error(self, every: bool = False) -> NoScanError | None:
        """Return the error if nothing can be read; with `every`, also if any wanted topic is missing."""
        missing = self.missing
        if missing and (every or len(missing) == len(self.wanted)):
            return NoScanError(self._absent(missing))
        if self.wanted or self._there:
            return None
        words = f"{no_scan_topic()} ({self._list()})" if self.is_listed else "no LaserScan in it"
        return NoScanError(words + self._hint(topic.name for topic in self._topics))

    def _found(self, name: str) -> list[str]:
        """Return the topics that a name or pattern means: the exact one if it exists."""
        if name in self._there:
            return [name]
        there = [each for each in self.there if means(name, each)]
        return there if is_pattern(name) else there[:1]

    def _absent(self, missing: Sequence[str]) -> str:
        types = {bare(topic.name): topic.type for topic in self._topics}
        kind = types.get(bare(missing[0]), LASERSCAN)
        hint = self._hint(missing)
        if kind not in SCAN_TYPES:
            return f"topic {missing[0]} is {kind}, not a LaserScan{hint}"
        has = f"its LaserScan topics: {', '.join(self.there)}" if self._there else self._list()
        return f"{no_scan_topic(missing)} ({has})"

    def _hint(self, names: Iterable[str]) -> str:
        """Return a hint if some of these topics hold point clouds."""
        named = {bare(name) for name in names}
        return clouds_hint(topic for topic in self._topics if bare(topic.name) in named)

    def _list(self) -> str:
        """Return the topics of the log as words."""
        if not self._topics:
            return "it has no topics"
        names = [f"{topic.name} {topic.type}" for topic in sorted(self._topics, key=lambda topic: topic.name)]
        return f"its topics: {_some(names)}"


def nothing_read(damage: Sequence[str], error: NoScanError, wanted: Sequence[str]) -> LidarcliError:
    """Return the error of a log without LaserScan; a damaged log counts as unreadable, as scans may be in the lost part."""
    if not damage:
        return error
    topics = f" topic{_named(wanted)}" if wanted else ""
    return UnreadableError(f"no LaserScan{topics} in the part that could be read; {damage[0]}")


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return f"{', '.join(names[:_SHOWN])}{more}"


def _named(names: Sequence[str]) -> str:
    return f" {' or '.join(names)}" if names else ""
