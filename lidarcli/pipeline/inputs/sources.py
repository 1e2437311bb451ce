"""One log to read: where it is, and how it is opened, on this machine or in a store."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import takewhile
from operator import attrgetter
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from lidarcli.display.texts import Unused
from lidarcli.errors import LidarcliError, NoScanError, UnreadableError
from lidarcli.files.stores import Place, State, Url, fetch, is_url, place
from lidarcli.logs import open_log
from lidarcli.logs.base import CLOUD_TYPES, POSED_TYPES, Closing, Log, OpenOptions, ReadReport, Slice, Topic
from lidarcli.logs.joined import JoinedLog, Part
from lidarcli.logs.registry import format_of
from lidarcli.logs.segments import join
from lidarcli.options.choices import JOIN
from lidarcli.sweeps.types import RawSweeps
from lidarcli.system.records import dataclass, field, replace

if TYPE_CHECKING:
    from lidarcli.pose.tracks import PoseTrack

STDIN = "-"


@dataclass(frozen=True, slots=True)
class Source:
    """One log to read: where it is, and its name, which outputs carry (`run`, or `trip/run` below a folder)."""

    path: str
    name: str
    files: tuple[str, ...] = ()
    """The files of a log that a pattern names, one sweep each; in a store, also those of a folder that is one log."""
    parts: tuple[Source, ...] = ()
    """Recordings that are joined to this one log, of which `path` is the first by name."""
    found: State | None = field(default=None, compare=False)
    """Its state when the store listed it, or before a run began."""

    @property
    def url(self) -> Url | None:
        """Its URL, if it is in a store."""
        found = place(self.path) if is_url(self.path) else None
        return found if isinstance(found, Url) else None

    @property
    def file_name(self) -> str:
        """Name of its file or folder, without what is above; where it is no single one, its name for outputs."""
        url = self.url
        # Of a store, files are also those of a folder.
        is_pattern = bool(self.files) and not (url and all(file.startswith(f"{url}/") for file in self.files))
        if self.is_stdin or is_pattern or self.parts:
            return PurePosixPath(self.name).name
        return Path(self.path).absolute().name if url is None else url.name

    @property
    def label(self) -> str:
        """Its name in messages: as the user wrote it."""
        if self.parts:
            return f"{self.path} and {len(self.parts) - 1} more"
        return "standard input" if self.is_stdin else self.path

    @property
    def is_stdin(self) -> bool:
        """True for the standard input of this process."""
        return self.path == STDIN

    @property
    def size(self) -> int:
        """Bytes on disk; 0 where unknown."""
        return 0 if (state := self.state()) is None else state.size

    def state(self) -> State | None:
        """Its size and last change; None where these are not known."""
        if self.found is not None or self.is_stdin or (is_url(self.path) and not self.parts):
            return self.found
        if self.parts:
            states = [part.state() for part in self.parts]
            known = [state for state in states if state is not None]
            size, newest = sum(it.size for it in known), max((it.mtime_ns for it in known), default=0)
            return State(size, newest) if len(known) == len(states) else None
        path = Path(self.path)
        try:
            files = [Path(file) for file in self.files] or ([*path.iterdir()] if path.is_dir() else [path])
            stats = [file.stat() for file in files if file.is_file()]
        except OSError:
            return None
        if not stats and not path.is_dir():
            return None
        return State(sum(it.st_size for it in stats), max((it.st_mtime_ns for it in stats), default=0))


@dataclass(frozen=True, slots=True)
class MissingInput:
    """An input in which there is no log to open, and why."""

    path: str
    error: LidarcliError = field(compare=False)

    @property
    def label(self) -> str:
        """Its name in messages: as the user wrote it."""
        return self.path


@contextmanager
def naming(source: Source) -> Iterator[None]:
    """Let errors of reading name the log."""
    try:
        yield
    except (NoScanError, UnreadableError) as err:
        if str(err).startswith((f"{source.path}: ", f"{source.label}: ")):
            raise
        raise type(err)(f"{source.label}: {err}") from err


@dataclass(frozen=True, slots=True)
class PoseMessages:
    """Poses of the messages of a log."""

    tracks: tuple[PoseTrack, ...]
    notes: tuple[str, ...]
    """A line for each kind of message without a pose."""
    report: ReadReport
    """Damage and refused messages of the pass over them."""


def read_pose_messages(log: Log, until_ns: int | None = None) -> PoseMessages:
    """Read all poses of a log that can be read twice, in one pass, or those that were recorded up to a time."""
    if isinstance(log, SlicedLog):
        return log.poses()
    # Most logs have no poses and should not wait for this import.
    from lidarcli.pose.tracks import PoseTracks

    tracks = PoseTracks()
    report = ReadReport()
    messages = log.messages(POSED_TYPES, report)
    tracks.add(messages if until_ns is None else takewhile(lambda one: one.record_ns <= until_ns, messages))
    found = tracks.finish()
    notes = [f"{count:,} of {topic} left out: {cause}" for (topic, cause), count in sorted(tracks.refused.items())]
    if tracks.left_out:
        notes.append(f"{tracks.left_out:,} poses left out: too many to keep")
    return PoseMessages(tuple(found), tuple(notes), report)


@contextmanager
def open_source(source: Source, opening: OpenOptions | None = None) -> Iterator[Log]:
    """Open the log of a source and close it in the end; many CSV files with one sweep each are one log.

    With a slice of point clouds, the log has the sweeps of these, too.
    """
    options = replace(opening or OpenOptions(), used=set())
    with _opened_source(source, options) as log:
        if (options.range_scale, options.angle_scale) != (1.0, 1.0) and format_of(log).in_metres:
            options.used.add("angle_scale")
            log = ChangedLog(log, partial(_in_units, scale=options.range_scale, turned=options.angle_scale))
        if options.segments == JOIN:
            log = ChangedLog(log, join)
        requested = [name for name in _OF_SOME_LOGS if getattr(options, name) != getattr(OpenOptions(), name)]
        if requested and options.slice is None:
            options.used.update("echo" for topic in log.topics() or () if topic.type.endswith("/MultiEchoLaserScan"))
            log = ChangedLog(log, partial(_tell_unused, asked=requested, used=options.used))
        yield log if options.slice is None else SlicedLog(log, options, options.slice)


_OF_SOME_LOGS = ("columns", "angle_min", "angle_increment", "fov", "range_max", "angle_scale", "echo")
"""Options of opening that only some logs need."""


def _tell_unused(
    blocks: Iterable[RawSweeps], report: ReadReport, *, asked: Sequence[str], used: Collection[str]
) -> Iterator[RawSweeps]:
    """Yield blocks, and note in the end which `requested` options had no effect."""
    yield from blocks
    names = {"angle_scale": "degrees"}
    if unused := [f"--{names.get(name, name)}".replace("_", "-") for name in asked if name not in used]:
        report.notes.append(Unused(f"no effect on this log: {', '.join(unused)}"))


@contextmanager
def _opened_source(source: Source, opening: OpenOptions | None) -> Iterator[Log]:
    with ExitStack() as stack:
        if source.parts:
            log = _joined(source, opening)
        elif (url := source.url) is not None:
            log = _fetched(url, [one for file in source.files if isinstance(one := place(file), Url)], opening, stack)
        elif source.files:
            from lidarcli.logs.csv import CsvLog

            log = CsvLog(source.files, opening)
        else:
            log = open_log(source.path, opening=opening)
        yield stack.enter_context(log)


def _joined(source: Source, opening: OpenOptions | None) -> Log:
    names = [part.file_name for part in source.parts]
    if len(set(names)) < len(names):
        names = [part.path for part in source.parts]
    return JoinedLog(
        source.label,
        [
            Part(part.path, name, part.size, lambda _, part=part: _opened_source(part, opening))  # type: ignore[misc]
            for part, name in zip(source.parts, names, strict=True)
        ],
    )


def hold_one_sweep_each(files: Sequence[Place]) -> bool:
    """Return whether several text files are the sweeps of one log, as far as the first readable one shows."""
    from lidarcli.logs.csv.layouts import PER_SWEEP, NamelessError

    if len(files) < 2:
        return False
    # One or two of the first may be no sweep (a README).
    for file in files[:3]:
        try:
            with _opened_source(Source(str(file), ""), None) as log:
                return PER_SWEEP in log.format
        except NamelessError as err:
            return err.per_sweep
        except UnreadableError:
            continue
    return False


def _fetched(url: Url, files: Sequence[Url], opening: OpenOptions | None, stack: ExitStack) -> Log:
    """Open an object, or the `files` that are one log together, copied to this machine, where `stack` removes them."""
    from lidarcli.files.newfiles import scratch_folder

    objects = files or [url]
    folder = stack.enter_context(scratch_folder()) / "log"
    # The folders below a pattern distinguish files of one name.
    shared = os.path.commonprefix([one.key.split("/")[:-1] for one in objects])  # noqa: RUF071 (of parts, not of characters)
    copies = [folder.joinpath(*one.key.split("/")[len(shared) :]) for one in objects]
    for one, copy in zip(objects, copies, strict=True):
        copy.parent.mkdir(parents=True, exist_ok=True)
        fetch(one, copy)
    try:
        if files and not all(one.key.startswith(f"{url.key}/") for one in files):
            from lidarcli.logs.csv import CsvLog

            log: Log = CsvLog(copies, opening)
        else:
            log = open_log(folder if files else copies[0], opening=opening)
    except UnreadableError as err:
        cause = str(err)
        for name in (*copies, folder):
            cause = cause.removeprefix(f"{name}: ")
        raise UnreadableError(f"{url}: {cause}") from err
    log.path = str(url)
    return log


_PIPE = (
    "a pipe is read only once: of its topics the point clouds alone, which are taken for level; give the file's name "
    "for LaserScan and transforms"
)
_NO_CLOUDS = "no point cloud in it, and --slice reads of a pipe nothing else; leave it out for LaserScan"
_NONE = "no point cloud in this log: --slice changes nothing"
MAX_WAITING = 256 << 20
"""Bytes of clouds after which none of them waits for others of its topic."""


def parts_of(log: Log) -> tuple[Part, ...]:
    """Return the recordings that a log is joined of, in their order; none of any other log."""
    return log.parts if isinstance(log, JoinedLog | ChangedLog) else ()


Change = Callable[[Iterable[RawSweeps], ReadReport], Iterator[RawSweeps]]


class ChangedLog(Closing):
    """A `Log` that changes the sweeps of another one and passes everything else on."""

    def __init__(self, log: Log, change: Change = lambda blocks, _: iter(blocks)) -> None:
        self._log, self._change = log, change
        self.path, self.format = log.path, log.format
        self.parts = parts_of(log)

    compression = property(attrgetter("_log.compression"))
    size = property(attrgetter("_log.size"))
    position = property(attrgetter("_log.position"))
    topics = property(attrgetter("_log.topics"))
    messages = property(attrgetter("_log.messages"))
    close = property(attrgetter("_log.close"))

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks as they are changed."""
        return self._change(self._log.scans(topics, report), report)


def _in_units(blocks: Iterable[RawSweeps], report: ReadReport, *, scale: float, turned: float) -> Iterator[RawSweeps]:
    """Yield sweeps of LaserScan messages in metres and radians."""
    from lidarcli.logs.blocks import as_singles, limits_in_metres

    report.takes_degrees = turned != 1.0
    for block in blocks:
        least, most = limits_in_metres(block.range_min, block.range_max, scale)
        known = ("angle_min", "angle_increment", *(["angle_max"] if block.angle_max is not None else []))
        angles = {name: getattr(block, name) * turned for name in known}
        yield replace(block, ranges=as_singles(block.ranges * scale), range_min=least, range_max=most, **angles)


class SlicedLog(ChangedLog):
    """A `Log` that also makes sweeps of another one's point clouds; the level of each is found before the first sweep."""

    def __init__(self, log: Log, options: OpenOptions, part: Slice) -> None:
        from lidarcli.logs.clouds import Bins

        super().__init__(log)
        self._part = part
        self._bins = Bins.of(options, part.bins)
        self._poses: PoseMessages | None = None

    def topics(self) -> list[Topic] | None:
        """Return all topics; those of point clouds hold sweeps."""
        topics = self._log.topics()
        return topics and [replace(topic, sliced=topic.type in CLOUD_TYPES) for topic in topics]

    def poses(self) -> PoseMessages:
        """Return the poses of the messages of the log, read once."""
        if self._poses is None:
            self._poses = read_pose_messages(self._log)
        return self._poses

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield sweeps of LaserScan topics, then those of clouds, in log order within each topic."""
        listed = self.topics()
        # The one format with clouds that may be read without knowing its topics: others list them, or hold no clouds.
        if listed is None and self.format == "mcap":
            report.notes.append(_PIPE)
            found = False
            for block in self._of_clouds(None, report):
                found = True
                yield block
            if not found and not report.refused and not report.damage:
                raise NoScanError(_NO_CLOUDS)
            return
        if listed is None:
            report.notes.append(_NONE)
            yield from self._log.scans(topics, report)
            return
        wanted = [topic for topic in listed if topic.is_scan and (topics is None or topic.name in topics)]
        if not any(topic.sliced for topic in listed):
            report.notes.append(_NONE)
        if any(not topic.sliced for topic in wanted) or not wanted:
            yield from self._log.scans(topics, report)
        clouds = {topic.name for topic in wanted if topic.sliced}
        if clouds:
            own = ReadReport()
            try:
                # The list of a log that is cut off may lack topics.
                yield from self._of_clouds(None if topics is None else clouds, own)
            finally:
                # A caller that wants no more sweeps still wants to know of the damage so far.
                report.add_new(own)

    def _of_clouds(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        from lidarcli.logs.clouds import Slicer
        from lidarcli.pose.frames import TreeLevels

        tracks = self.poses().tracks if self.size is not None else ()
        sensors = [topic.name for topic in self.topics() or () if topic.is_scan]
        slicers: dict[str, Slicer] = {}
        waiting = 0
        for message in self._log.messages(CLOUD_TYPES, report):
            if topics is not None and message.topic not in topics:
                continue
            slicer = slicers.get(message.topic)
            if slicer is None:
                levels = TreeLevels(tracks, message.topic, sensors)
                slicer = Slicer(message.topic, self._part, self._bins, levels, report)
                slicers[message.topic] = slicer
            yield from slicer.take(message)
            waiting += len(message.data)
            if waiting > MAX_WAITING:
                for each in slicers.values():
                    yield from each.flush()
                waiting = 0
        for slicer in slicers.values():
            yield from slicer.flush()
            report.notes += slicer.notes()


def made_of_clouds(log: Log) -> dict[str, str]:
    """Return the topics whose sweeps are made of point clouds, each with the type of its messages."""
    return {topic.name: topic.type for topic in log.topics() or () if topic.sliced}
