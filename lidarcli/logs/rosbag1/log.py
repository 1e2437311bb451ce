"""ROS 1 bags (format 2.0), whole or damaged, closed or not, uncompressed, bz2 or lz4."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO, cast

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import LASERSCAN, MULTI_ECHO, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.laserscan import Gather
from lidarcli.logs.rosbag1.reader import MessageBlock, Pass, Wanted
from lidarcli.logs.rosbag1.records import MAGIC, MAX_HEADER, Connection, Op, State, parse, read_at, read_index
from lidarcli.sweeps import RawSweeps

OLD_MAGIC = b"#ROS"
"""Every bag begins so; format 2.0 goes on with its own magic."""
DENSE = 128
"""Messages of one topic in one buffer that are decoded where they lie instead of being gathered."""
COPY = 1 << 20


class Rosbag1Log:
    """A ROS 1 bag of a path or of a stream; a stream is copied to a temporary file, whose name nobody sees."""

    format = "ros1 bag"
    position = 0

    def __init__(self, source: str | Path | BinaryIO, options: OpenOptions | None = None) -> None:
        self._echo = (options or OpenOptions()).echo
        self.path = path = str(source) if isinstance(source, str | Path) else "-"
        self._file = _open(path, source)
        try:
            self.size: int | None = self._file.seek(0, 2)
            _check_magic(path, read_at(self._file, 0, 64))
            self._index = read_index(self._file, self.size)
        except OSError as err:
            self._file.close()
            raise UnreadableError(f"{path}: cannot be read: {err.strerror or err}") from err
        except UnreadableError:
            self._file.close()
            raise
        if self._index.encryptor:
            self._file.close()
            raise UnreadableError(
                f"{path}: the bag is encrypted ({self._index.encryptor}); write a plain one with"
                " 'rosbag decrypt'"
            )
        self._scanned: list[Topic] | None = None
        self._codecs: dict[str, None] = {}

    @property
    def compression(self) -> str:
        """Compression of the chunks seen so far, or of the first one."""
        if not self._codecs:
            self._codecs.update(_first_codec(self._file))
        return "+".join(sorted(self._codecs)) or "none"

    def topics(self) -> list[Topic]:
        """All topics: from the index, or where there is none by reading the whole bag once."""
        if self._index.state is State.GOOD:
            return _topics(self._index.connections, self._index.counts())
        if self._scanned is None:
            reading = self._pass(lambda _: True, ReadReport())
            for _ in reading.blocks():
                pass
            self._scanned = _topics(reading.connections, reading.counts)
        return self._scanned

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Blocks of sweeps in log order within each topic."""

        def wanted(connection: Connection) -> bool:
            return connection.type in (LASERSCAN, MULTI_ECHO) and (
                topics is None or connection.topic in topics
            )

        gathers: dict[Connection, Gather] = {}
        reading = self._pass(wanted, report)
        for block in reading.blocks():
            for connections in _by_topic(block, reading, wanted):
                first = reading.connections[connections[0]]
                gather = gathers.setdefault(
                    first, Gather(first.topic, first.type, "ros1", report, self._echo)
                )
                yield from _decode(block, np.flatnonzero(np.isin(block.connection, connections)), gather)
            self._progress(reading)
        for gather in gathers.values():
            yield from gather.flush()
        self._progress(reading)

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Raw messages of the given types in log order."""
        reading = self._pass(lambda connection: connection.type in types, report)
        for block in reading.blocks():
            known = {
                c: reading.connections[c]
                for c in np.unique(block.connection).tolist()
                if c in reading.connections
            }
            rows = np.isin(block.connection, [c for c, it in known.items() if it.type in types])
            for row in np.flatnonzero(rows).tolist():
                connection = known[int(block.connection[row])]
                start = int(block.starts[row])
                data = block.data[start : start + int(block.lengths[row])].tobytes()
                yield Message(connection.topic, connection.type, "ros1", int(block.time_ns[row]), data)
            self._progress(reading)
        self._progress(reading)

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> Rosbag1Log:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()

    def _pass(self, wanted: Wanted, report: ReadReport) -> Pass:
        def damaged(place: str, cause: str) -> None:
            # However many records of a chunk are broken, one line tells of it.
            if all(known.place != place for known in report.damage):
                report.add_damage(place, cause)

        return Pass(self._file, self.size or 0, self._index, wanted, damaged)

    def _progress(self, reading: Pass) -> None:
        self.position = reading.at
        self._codecs.update(reading.codecs)


def _open(path: str, source: str | Path | BinaryIO) -> BinaryIO:
    """The bag as a file that can be positioned in."""
    try:
        if isinstance(source, str | Path):
            return Path(source).open("rb")
        copy = cast(BinaryIO, tempfile.TemporaryFile())  # noqa: SIM115  closed with the log
        shutil.copyfileobj(source, copy, COPY)
        return copy
    except OSError as err:
        raise UnreadableError(f"{path}: cannot be read: {err.strerror or err}") from err


def _check_magic(path: str, head: bytes) -> None:
    """Refuse what is no bag of format 2.0."""
    if head.startswith(MAGIC):
        return
    line = head.split(b"\n")[0].decode("ascii", "replace")
    if head.startswith(OLD_MAGIC) and " V" in line:
        version = line.split(" V", 1)[1].strip()[:10]
        raise UnreadableError(
            f"{path}: this ROS 1 bag has format {version}, which predates 2.0; write a new one with ROS 1's"
            " 'rosbag fix OLD.bag NEW.bag' and read that"
        )
    raise UnreadableError(f"{path}: not a ROS 1 bag (it does not begin with '#ROSBAG V2.0')")


def _first_codec(file: BinaryIO) -> dict[str, None]:
    """Compression of the first chunk."""
    bag = parse(read_at(file, len(MAGIC), 8 + MAX_HEADER), 0, len(MAGIC))
    chunk = parse(read_at(file, bag.end, 8 + MAX_HEADER), 0) if bag else None
    if chunk is None or chunk.op != Op.CHUNK:
        return {}
    return {chunk.value(b"compression").decode("utf-8", "replace"): None}


def _topics(connections: dict[int, Connection], counts: dict[int, int]) -> list[Topic]:
    """One entry per topic and type, whatever the number of its publishers."""
    totals: dict[Connection, int] = {}
    for number, connection in sorted(connections.items()):
        totals[connection] = totals.get(connection, 0) + counts.get(number, 0)
    return [Topic(it.topic, it.type, "ros1", count) for it, count in totals.items()]


def _by_topic(block: MessageBlock, reading: Pass, wanted: Wanted) -> list[list[int]]:
    """The wanted connections of a block, those of one topic and type together."""
    groups: dict[Connection, list[int]] = {}
    for number in np.unique(block.connection).tolist():
        connection = reading.connections.get(number)
        if connection is not None and wanted(connection):
            groups.setdefault(connection, []).append(number)
    return list(groups.values())


def _decode(
    block: MessageBlock, rows: np.ndarray[tuple[int], np.dtype[np.intp]], gather: Gather
) -> Iterator[RawSweeps]:
    """Decode many messages where they lie, gather few."""
    starts, lengths, times = block.starts[rows], block.lengths[rows], block.time_ns[rows]
    if len(rows) >= DENSE:
        yield from gather.decode(block.data, starts, lengths, times)
        return
    for start, length, time in zip(starts.tolist(), lengths.tolist(), times.tolist(), strict=True):
        if gather.add(block.data[start : start + length].tobytes(), time):
            yield from gather.flush()
