"""ROS 2 bags: a folder with its storage files, or one bare SQLite file; packed by zstd or not, whole or damaged."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from lidarcli.errors import LidarcliError, UnreadableError, unreadable
from lidarcli.logs.base import Log, Message, OpenOptions, ReadReport, Topic, ros_type
from lidarcli.logs.joined import Part, PartedLog
from lidarcli.logs.laserscan import Gather
from lidarcli.logs.rosbag2.database import Known, Row, SqliteBag, is_cdr
from lidarcli.logs.rosbag2.folder import Folder, read_folder
from lidarcli.logs.unpacking import PACKED_CAUSE, ZSTD_MAGIC, Unpacking, is_zstd, unpack_file, unpack_message
from lidarcli.newfiles import scratch_folder
from lidarcli.ros.bag_metadata import METADATA
from lidarcli.sweeps import RawSweeps

NO_DATA = "no data, or more than a sweep can have"
NO_TIME = "no time that is a number"


class Rosbag2Log(PartedLog):
    """A ROS 2 bag: its files are read one after the other, as one stream."""

    def __init__(self, path: str | Path, options: OpenOptions | None = None) -> None:
        self._options = options or OpenOptions()
        self._unpacked: tuple[Path, Path, str] | None = None
        """File that is unpacked, what it unpacks to, and what is wrong with it."""
        self._stack = ExitStack()
        where = Path(path)
        with unreadable(path):
            is_folder = where.is_dir()
            folder = read_folder(where) if is_folder else Folder([where])
            parts = [
                Part(str(file), file.name, file.stat().st_size, partial(self._storage, file, Known()))
                for file in folder.files
            ]
        if not parts:
            raise UnreadableError(f"{path}: no .db3 or .mcap file in this folder, hence no ROS 2 bag")
        super().__init__(str(path), parts, names_parts=is_folder)
        self._opening.notes += folder.notes
        for name in folder.missing:
            self._opening.add_damage(name, f"{METADATA} names this file, but it is not there")
        kinds = {"mcap" if _is_mcap(file) else "sqlite3" for file in folder.files}
        self.format = f"ros2 bag ({'+'.join(sorted(kinds, reverse=True))})"
        try:
            self._probe()
        except LidarcliError:
            self.close()
            raise

    def close(self) -> None:
        """Delete what was unpacked."""
        self._unpacked = None
        self._stack.close()

    def _probe(self) -> None:
        """Open the first file that can be opened; where none can, the first error is the log's."""
        first: UnreadableError | None = None
        for part in self.parts:
            try:
                with part.open(ReadReport()) as storage:
                    self._codecs.add(storage.compression)
                return
            except UnreadableError as err:
                first = first or err
        if first is not None:
            raise first

    @contextmanager
    def _storage(self, file: Path, known: Known, report: ReadReport) -> Iterator[Log]:
        """Open a storage file; the report takes what unpacking the file has met."""
        path = self._plain(file, report)
        if _is_mcap(file):
            from lidarcli.logs.mcap.log import McapLog

            opened: Log = McapLog(str(path), self._options)
        else:
            opened = DatabaseLog(path, str(file), self._options, known)
        with opened as storage:
            yield storage

    def _plain(self, file: Path, report: ReadReport) -> Path:
        """Return the file itself, or what it unpacks to; the last one unpacked is kept until the log is closed."""
        with unreadable(file):
            if not is_zstd(file):
                return file
            self._codecs.add("zstd")
            if self._unpacked is None or self._unpacked[0] != file:
                self.close()
                plain = self._stack.enter_context(scratch_folder()) / _plain_name(file)
                self._unpacked = (file, plain, unpack_file(file, plain))
        file, plain, cause = self._unpacked
        if cause:
            report.add_damage(file.name, cause)
        return plain


class DatabaseLog:
    """One storage file of SQLite as a `Log` for one pass."""

    format = "ros2 bag (sqlite3)"

    def __init__(self, path: Path, shown: str, options: OpenOptions, known: Known) -> None:
        """`shown` names the file in errors; `known` is what is known of it, and takes what is found."""
        self.path = shown
        self.compression = "none"
        self._options = options
        self._unpacking = Unpacking()
        self.met = ReadReport()
        """Takes the damage of the file; that of messages goes to the report of the pass."""
        self.bag = SqliteBag(path, shown, self.met, known)
        self.size: int | None = path.stat().st_size

    @property
    def position(self) -> int:
        """Share of the file that has been read, in its bytes."""
        return int((self.size or 0) * self.bag.progress)

    def topics(self) -> list[Topic] | None:
        """Return the topics with the number of their messages."""
        counts = self.bag.counts()
        return [
            Topic(it.name, ros_type(it.type), it.encoding, counts.get(it.id, 0), self.bag.read_as(it))
            for it in self.bag.topics.values()
        ]

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps in log order within each topic."""
        gathers = {}
        for topic in self.bag.topics.values():
            kind = self.bag.read_as(topic)
            if not kind or (topics is not None and topic.name not in topics):
                continue
            if is_cdr(topic):
                gathers[topic.id] = Gather(topic.name, kind, "cdr", report, self._options.echo)
            elif count := self.bag.counts().get(topic.id, 0):
                report.refused[(topic.name, f"the encoding '{topic.encoding}' is not read")] += count
        try:
            self.bag.report_orphans()
            for batch in self.bag.batches(gathers) if gathers else ():
                for topic_id, times, messages in _by_topic(batch):
                    gather = gathers[topic_id]
                    if gather.extend(*self._usable(gather.topic, times, messages, report)):
                        yield from gather.flush()
            for gather in gathers.values():
                yield from gather.flush()
        finally:
            report.add(self.met)

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield raw messages of the given types in log order."""
        wanted = {topic.id: topic for topic in self.bag.topics.values() if is_cdr(topic) and ros_type(topic.type) in types}
        try:
            for batch in self.bag.batches(wanted) if wanted else ():
                for _, topic_id, timestamp, data in batch:
                    topic = wanted[topic_id]
                    usable = self._usable(topic.name, [timestamp], [data], report)
                    for message, time in zip(*usable, strict=True):
                        yield Message(topic.name, ros_type(topic.type), "cdr", time, message)
        finally:
            report.add(self.met)

    def close(self) -> None:
        """Close the file."""
        self.bag.close()

    def __enter__(self) -> DatabaseLog:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _usable(
        self, topic: str, times: Sequence[int | None], messages: Sequence[bytes | None], report: ReadReport
    ) -> tuple[Sequence[bytes], Sequence[int]]:
        """Return the messages that there are and their times, unpacked if they are packed.

        A bag packs all its messages or none; plain CDR never begins as zstd does.
        """
        with_data = [(time, data) for time, data in zip(times, messages, strict=True) if data is not None]
        rows = [(time, data) for time, data in with_data if time is not None]
        for cause, lost in ((NO_DATA, len(messages) - len(with_data)), (NO_TIME, len(with_data) - len(rows))):
            if lost:
                report.refused[(topic, cause)] += lost
        at, present = [time for time, _ in rows], [data for _, data in rows]
        if not present or not present[0].startswith(ZSTD_MAGIC):
            return present, at
        self.compression = "zstd"
        unpacked = [(unpack_message(data, self._unpacking), time) for data, time in zip(present, at, strict=True)]
        usable = [(data, time) for data, time in unpacked if data is not None]
        if len(usable) < len(unpacked):
            report.refused[(topic, PACKED_CAUSE)] += len(unpacked) - len(usable)
        return [data for data, _ in usable], [time for _, time in usable]


def _plain_name(file: Path) -> str:
    return "bag.mcap" if _is_mcap(file) else "bag.db3"


def _is_mcap(file: Path) -> bool:
    """Return True if the name of a storage file is that of an MCAP."""
    return ".mcap" in "".join(file.suffixes[-2:]).lower()


def _by_topic(batch: list[Row]) -> Iterator[tuple[int, Sequence[int | None], Sequence[bytes | None]]]:
    """Yield topic id, times and messages of a batch, for each of its topics."""
    _, topic_ids, times, messages = zip(*batch, strict=True)
    present = set(topic_ids)
    if len(present) == 1:
        yield topic_ids[0], times, messages
        return
    for topic in sorted(present):
        rows = [row for row in batch if row[1] == topic]
        yield topic, [row[2] for row in rows], [row[3] for row in rows]
