"""ROS 2 bags: a folder with its storage files, or one bare SQLite file; packed by zstd or not, whole or damaged."""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from lidarcli.errors import LidarcliError, UnreadableError
from lidarcli.logs.base import LASERSCAN, MULTI_ECHO, Message, OpenOptions, ReadReport, Topic, ros_type
from lidarcli.logs.laserscan import Gather
from lidarcli.logs.rosbag2.database import Known, Row, SqliteBag, has_type
from lidarcli.logs.rosbag2.folder import METADATA, Folder, read_folder
from lidarcli.logs.unpacking import PACKED_CAUSE, ZSTD_MAGIC, Unpacking, is_zstd, unpack_file, unpack_message
from lidarcli.sweeps import RawSweeps

if TYPE_CHECKING:
    from lidarcli.logs.mcap.log import McapLog

SCANS = (LASERSCAN, MULTI_ECHO)
NO_DATA = "no data, or more than a sweep can have"
NO_TIME = "no time that is a number"


class Rosbag2Log:
    """A ROS 2 bag: its files are read one after the other, as one stream."""

    def __init__(self, path: str | Path, options: OpenOptions | None = None) -> None:
        self._options = options or OpenOptions()
        self.path = str(path)
        self.position = 0
        self._opening = ReadReport()
        self._topics: list[Topic] | None = None
        self._unpacked: tuple[Path, tempfile.TemporaryDirectory[str], str] | None = None
        self._codecs: set[str] = set()
        self._unpacking = Unpacking()
        where = Path(path)
        try:
            self._is_folder = where.is_dir()
            folder = read_folder(where) if self._is_folder else Folder([where])
            self._files = folder.files
            self._sizes = [file.stat().st_size for file in self._files]
        except OSError as err:
            raise UnreadableError(f"{path}: cannot be read: {err.strerror or err}") from err
        if not self._files:
            raise UnreadableError(f"{path}: no .db3 or .mcap file in this folder, hence no ROS 2 bag")
        self._known = [Known() for _ in self._files]
        self._opening.notes += folder.notes
        for name in folder.missing:
            self._opening.add_damage(name, f"{METADATA} names this file, but it is not there")
        self.size: int | None = sum(self._sizes)
        kinds = {"mcap" if _is_mcap(file) else "sqlite3" for file in self._files}
        self.format = f"ros2 bag ({'+'.join(sorted(kinds, reverse=True))})"
        try:
            self._probe()
        except LidarcliError:
            self.close()
            raise

    @property
    def compression(self) -> str:
        """Compression of the files opened so far, or of messages in them."""
        codecs = self._codecs - {"none"} or {"none"}
        return "+".join(sorted(codecs))

    def topics(self) -> list[Topic] | None:
        """Return topics of all files, with the sum of their messages; None where a file has no index of them."""
        if self._topics is None:
            self._topics = self._counted()
        return None if self._topics is None else list(self._topics)

    def _counted(self) -> list[Topic] | None:
        """Return the topics from a look at every file; reading meets the damage."""
        totals: dict[tuple[str, str, str], int | None] = {}
        for number in range(len(self._files)):
            with self._storage(number, ReadReport()) as (storage, _):
                if storage is None:
                    continue
                topics = _sqlite_topics(storage) if isinstance(storage, SqliteBag) else storage.topics()
            if topics is None:
                return None
            for topic in topics:
                key = (topic.name, topic.type, topic.encoding)
                before = totals.get(key, 0)
                known = before is not None and topic.messages is not None
                totals[key] = (before or 0) + (topic.messages or 0) if known else None
        return [Topic(*key, messages) for key, messages in totals.items()]

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps in log order within each topic, file after file."""
        for number, storage, own in self._storages(report):
            if isinstance(storage, SqliteBag):
                storage.report_orphans()
                yield from self._sqlite_scans(storage, topics, number, own)
            else:
                for block in storage.scans(topics, own):
                    self._advance(number, storage.position / (storage.size or 1))
                    yield block

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield raw messages of the given types in log order."""
        for _, storage, own in self._storages(report):
            if isinstance(storage, SqliteBag):
                yield from self._sqlite_messages(storage, types, own)
            else:
                yield from storage.messages(types, own)

    def close(self) -> None:
        if self._unpacked is not None:
            self._unpacked[1].cleanup()
            self._unpacked = None

    def __enter__(self) -> Rosbag2Log:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _probe(self) -> None:
        """Open the first file that can be opened; where none can, the first error is the log's."""
        first: UnreadableError | None = None
        for number in range(len(self._files)):
            try:
                self._open(number, ReadReport(), ReadReport()).close()
                return
            except UnreadableError as err:
                first = first or err
        if first is not None:
            raise first

    def _storages(self, report: ReadReport) -> Iterator[tuple[int, SqliteBag | McapLog, ReadReport]]:
        """Yield the storage files that can be opened, each with a report of its own: one pass over the log."""
        report.add(self._opening)
        self._unpacking = Unpacking()
        for number in range(len(self._files)):
            with self._storage(number, report) as (storage, own):
                if storage is not None:
                    yield number, storage, own
            self._advance(number, 1.0)

    @contextmanager
    def _storage(
        self, number: int, report: ReadReport
    ) -> Iterator[tuple[SqliteBag | McapLog | None, ReadReport]]:
        """Open one storage file, with a report of its own; None if it cannot be read."""
        file, own = self._files[number], ReadReport()
        try:
            storage = self._open(number, report, own)
        except UnreadableError as err:
            cause = str(err).removeprefix(f"{file}: ")
            report.add_damage(file.name, f"the whole file is lost: {cause}")
            yield None, own
            return
        try:
            yield storage, own
        finally:
            storage.close()
            self._codecs.update(storage.compression.split("+"))
            report.add(own, f"{file.name}: " if self._is_folder else "")

    def _open(self, number: int, report: ReadReport, own: ReadReport) -> SqliteBag | McapLog:
        """Open a storage file; `own` takes what it finds there, `report` what unpacking the file has met."""
        file = self._files[number]
        path = self._plain(file, report)
        if _is_mcap(file):
            from lidarcli.logs.mcap.log import McapLog

            storage: SqliteBag | McapLog = McapLog(str(path), self._options)
        else:
            storage = SqliteBag(path, str(file), own, self._known[number])
        self._codecs.add(storage.compression)
        return storage

    def _plain(self, file: Path, report: ReadReport) -> Path:
        """Return the file itself, or what it unpacks to; the last one unpacked is kept until the log is closed."""
        try:
            if not is_zstd(file):
                return file
            self._codecs.add("zstd")
            if self._unpacked is None or self._unpacked[0] != file:
                self.close()
                target = tempfile.TemporaryDirectory(prefix="lidarcli-")
                self._unpacked = (file, target, "")
                cause = unpack_file(file, Path(target.name) / _plain_name(file))
                self._unpacked = (file, target, cause)
        except OSError as err:
            raise UnreadableError(f"{file}: cannot be read: {err.strerror or err}") from err
        file, folder, cause = self._unpacked
        if cause:
            report.add_damage(file.name, cause)
        return Path(folder.name) / _plain_name(file)

    def _sqlite_scans(
        self, bag: SqliteBag, topics: Collection[str] | None, number: int, report: ReadReport
    ) -> Iterator[RawSweeps]:
        gathers = {
            topic.id: Gather(topic.name, ros_type(topic.type), "cdr", report, self._options.echo)
            for topic in bag.topics.values()
            if has_type(topic, SCANS) and (topics is None or topic.name in topics)
        }
        if gathers:
            for batch in bag.batches(gathers):
                for topic_id, times, messages in _by_topic(batch):
                    gather = gathers[topic_id]
                    if gather.extend(*self._usable(gather.topic, times, messages, report)):
                        self._advance(number, bag.progress)
                        yield from gather.flush()
        for gather in gathers.values():
            yield from gather.flush()

    def _sqlite_messages(
        self, bag: SqliteBag, types: Collection[str], report: ReadReport
    ) -> Iterator[Message]:
        wanted = {topic.id: topic for topic in bag.topics.values() if has_type(topic, types)}
        if wanted:
            for batch in bag.batches(wanted):
                for _, topic_id, timestamp, data in batch:
                    topic = wanted[topic_id]
                    usable = self._usable(topic.name, [timestamp], [data], report)
                    for message, time in zip(*usable, strict=True):
                        yield Message(topic.name, ros_type(topic.type), "cdr", time, message)

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
        self._codecs.add("zstd")
        unpacked = [
            (unpack_message(data, self._unpacking), time) for data, time in zip(present, at, strict=True)
        ]
        usable = [(data, time) for data, time in unpacked if data is not None]
        if len(usable) < len(unpacked):
            report.refused[(topic, PACKED_CAUSE)] += len(unpacked) - len(usable)
        return [data for data, _ in usable], [time for _, time in usable]

    def _advance(self, number: int, share: float) -> None:
        """Set the position after a share of one file."""
        self.position = sum(self._sizes[:number]) + int(self._sizes[number] * min(share, 1.0))


def _plain_name(file: Path) -> str:
    return "bag.mcap" if _is_mcap(file) else "bag.db3"


def _is_mcap(file: Path) -> bool:
    """Return True if the name of a storage file is that of an MCAP."""
    return ".mcap" in "".join(file.suffixes[-2:]).lower()


def _sqlite_topics(bag: SqliteBag) -> list[Topic]:
    counts = bag.counts()
    return [
        Topic(topic.name, ros_type(topic.type), topic.encoding, counts.get(topic.id, 0))
        for topic in bag.topics.values()
    ]


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
