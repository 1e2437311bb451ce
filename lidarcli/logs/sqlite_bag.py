"""One SQLite storage file of a ROS 2 bag, whole or damaged; nothing is ever written beside it."""

from __future__ import annotations

import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import LASERSCAN, ReadReport, ros_type
from lidarcli.logs.laserscan import decode
from lidarcli.logs.sqlite_salvage import HEADER, MAGIC, MAX_BLOB, Found, MessageRow, Salvage, TopicRow

SIDECARS = ("-wal", "-journal")
"""Files beside a database that hold a part of it when the recorder was not stopped properly."""
SQLITE_ERRORS = (sqlite3.Error, UnicodeDecodeError)
"""What SQLite raises for a damaged database: its message may quote bytes of it that are no text."""
DISK_SHARE = 0.9
BATCH = 32
"""Messages fetched at a time: at most BATCH times `MAX_BLOB` bytes are held."""

_TOPICS = "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
_TYPES = (int, str, str, str)
_ROWS = (
    "SELECT id, topic_id, timestamp,"
    f" CASE WHEN typeof(data) = 'blob' AND length(data) <= {MAX_BLOB} THEN data END"
    " FROM messages WHERE id > ? AND typeof(timestamp) = 'integer' AND topic_id IN ({}) ORDER BY id"
)


Row = tuple[int, int, int, bytes | None]
"""Row id, topic id, time [ns] and message; None where it has none that can be used."""


class SqliteBag:
    """Topics and messages of one storage file: by SQLite as far as it goes, then straight from the pages."""

    def __init__(self, path: Path, shown: str, damaged: Callable[[str, str], None]) -> None:
        """`shown` names the file in errors, `damaged` takes place and cause."""
        self.topics: dict[int, TopicRow] = {}
        self._last, self._newest = 0, 0
        self._shown, self._damaged = shown, damaged
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._database: sqlite3.Connection | None = None
        self._file: BinaryIO | None = None
        self._found: Found | None = None
        self._cause = ""
        self._orphans_told = False
        try:
            self._open(path)
        except OSError as err:
            self.close()
            raise UnreadableError(f"{shown}: cannot be read: {err.strerror or err}") from err
        except UnreadableError:
            self.close()
            raise

    @property
    def progress(self) -> float:
        """How much of the file has been read, from 0 to 1."""
        return self._last / self._newest if self._newest > 0 else 0.0

    def counts(self) -> dict[int, int]:
        """Topic id → messages."""
        if self._database is not None:
            try:
                found = Counter(topic for (topic,) in self._database.execute("SELECT topic_id FROM messages"))
                self._report_orphans(found)
                return found
            except SQLITE_ERRORS as err:
                self._cause = _cause(err)
        return Counter(self._salvage()[1].topic_ids)

    def _report_orphans(self, counts: Mapping[int, int]) -> None:
        """Messages of a topic that is not there, or whose row is broken, are a loss: once is enough to say so."""
        orphans = {topic: count for topic, count in counts.items() if topic not in self.topics}
        if orphans and not self._orphans_told:
            self._orphans_told = True
            which = ", ".join(repr(topic) for topic in sorted(orphans, key=repr)[:5])
            self._damaged("topics table", f"has no topic {which}; messages lost: {sum(orphans.values()):,}")

    def batches(self, topics: Collection[int]) -> Iterator[list[Row]]:
        """Messages of the given topic ids in the order they were recorded, a few at a time."""
        self._last = -1 << 63
        if self._database is not None:
            try:
                (newest,) = self._database.execute("SELECT max(id) FROM messages").fetchone()
                self._newest = newest or 0
                sql = _ROWS.format(", ".join(map(str, topics)))
                cursor = self._database.execute(sql, (self._last,))
                while rows := cursor.fetchmany(BATCH):
                    ids = [self._last, *(row[0] for row in rows)]
                    if ids != sorted(ids):
                        raise sqlite3.DatabaseError("row numbers are out of order")
                    self._last = ids[-1]
                    yield rows
                return
            except SQLITE_ERRORS as err:
                self._cause = _cause(err)
        yield from self._salvaged(topics, self._last)

    def close(self) -> None:
        """Release and delete all that was opened and copied."""
        if self._database is not None:
            self._database.close()
        if self._file is not None:
            self._file.close()
        if self._folder is not None:
            self._folder.cleanup()

    def _open(self, path: Path) -> None:
        self._file = path.open("rb")
        if path.stat().st_size == 0:
            raise UnreadableError(f"{self._shown}: the file is empty")
        sidecars = [Path(f"{path}{suffix}") for suffix in SIDECARS]
        sidecars = [sidecar for sidecar in sidecars if sidecar.is_file() and sidecar.stat().st_size]
        copy = self._copy(path, sidecars) if sidecars else None
        if copy is not None:
            self._file.close()
            self._file = copy.open("rb")
        else:
            self._cause = _wrong_size(self._file.read(HEADER), path.stat().st_size)
            if self._cause:
                return self._open_damaged()
        # `immutable` keeps SQLite from making files beside the log and works in a read-only folder.
        options = "mode=ro&immutable=1" if copy is None else "mode=rw"
        where = quote(str((copy or path).absolute()))
        try:
            self._database = sqlite3.connect(f"file:{where}?{options}", uri=True, check_same_thread=False)
            self._database.text_factory = lambda text: text.decode("utf-8", "replace")
            self._database.execute("PRAGMA temp_store = memory")
            self._database.execute("PRAGMA cell_size_check = on")
            rows = self._database.execute(_TOPICS)
            self.topics = {row[0]: TopicRow(*row) for row in rows if all(map(isinstance, row, _TYPES))}
            self._database.execute("SELECT max(id) FROM messages").fetchone()
        except SQLITE_ERRORS as err:
            self._cause = _cause(err)
            if self._database is not None:
                self._database.close()
                self._database = None
            self._open_damaged()

    def _open_damaged(self) -> None:
        """SQLite refuses the file: find its topics by reading pages."""
        salvage, found = self._salvage()
        self.topics = dict(sorted(found.topics.items()))
        if not self.topics and found.rowids:
            self.topics = _guess_topics(salvage, found)
        if not self.topics:
            raise UnreadableError(f"{self._shown}: holds no ROS 2 messages ({self._cause})")

    def _copy(self, path: Path, sidecars: list[Path]) -> Path | None:
        """A copy in a temporary folder: SQLite merges the sidecars into it, and may not do so beside the log."""
        self._folder = tempfile.TemporaryDirectory(prefix="lidarcli-")
        target = Path(self._folder.name) / "bag.db3"
        needed = 2 * sum(file.stat().st_size for file in [path, *sidecars])
        if needed > DISK_SHARE * shutil.disk_usage(target.parent).free:
            names = ", ".join(sidecar.name for sidecar in sidecars)
            self._damaged(
                names, "not read: no room in the temporary folder to merge it into a copy of the bag"
            )
            return None
        shutil.copyfile(path, target)
        for sidecar in sidecars:
            shutil.copyfile(sidecar, f"{target}{sidecar.name.removeprefix(path.name)}")
        return target

    def _salvage(self) -> tuple[Salvage, Found]:
        if self._file is None:
            raise ValueError("the storage file is closed")
        salvage = Salvage(self._file)
        if self._found is None:
            self._found = salvage.find()
        return salvage, self._found

    def _salvaged(self, topics: Collection[int], last: int) -> Iterator[list[Row]]:
        """Messages behind row `last`, page by page."""
        salvage, found = self._salvage()
        self._newest = max(found.rowids, default=0)
        lost = 0
        batch: list[Row] = []
        for row in salvage.messages(found, topics, last):
            if isinstance(row, MessageRow):
                self._last = row.id
                batch.append(row)
                if len(batch) == BATCH:
                    yield batch
                    batch = []
            else:
                lost += 1
        if batch:
            yield batch
        wanted = sum(found.topic_ids[index] in topics for index in found.order())
        cause = f"{self._cause}; read page by page: {wanted - lost:,} messages recovered"
        if lost:
            cause += f", {lost:,} not whole"
        if found.missing:
            cause += f", {found.missing:,} of all topics missing before the last"
        self._damaged("database", cause)


def _wrong_size(header: bytes, size: int) -> str:
    """What is wrong with the file's size by its own header, if anything: SQLite reads over either in silence."""
    page = int.from_bytes(header[16:18], "big")
    page = 65536 if page == 1 else page
    if not header.startswith(MAGIC) or header[24:28] != header[92:96]:
        return ""
    whole = page * int.from_bytes(header[28:32], "big")
    if size < whole:
        return f"cut off: {size:,} of {whole:,} bytes"
    if size > whole:
        return f"not closed properly: {size - whole:,} bytes behind its declared end"
    return ""


def _cause(err: Exception) -> str:
    cause = str(err) if isinstance(err, sqlite3.Error) else "malformed database schema"
    return f"SQLite says: {cause}"


def _guess_topics(salvage: Salvage, found: Found) -> dict[int, TopicRow]:
    """LaserScan topics of a bag that lost its topics table: those whose first messages make sane sweeps."""
    guessed = {}
    for topic in sorted(set(found.topic_ids)):
        sample = [
            row.data
            for row in islice(salvage.messages(found, {topic}, -1 << 63), 5)
            if isinstance(row, MessageRow)
        ]
        if sample and all(map(_is_scan, sample)):
            guessed[topic] = TopicRow(topic, f"/topic_{topic}", LASERSCAN, "cdr")
    return guessed


def _is_scan(data: bytes) -> bool:
    """Whether a message decodes to a sweep with a geometry that a scanner can have."""
    whole = np.array([len(data)])
    start = np.array([0])
    sweeps = decode("", np.frombuffer(data, np.uint8), start, whole, start, "cdr", ReadReport())
    if sweeps is None:
        return False
    sane = (sweeps.beams > 1) & (np.abs(sweeps.angle_min) < 10) & (np.abs(sweeps.angle_increment) < 1)
    return bool((sane & (sweeps.range_min >= 0) & (sweeps.range_max > sweeps.range_min)).all())


def has_type(topic: TopicRow, types: Collection[str]) -> bool:
    """Whether a topic is of one of the types, serialised as ROS 2 does."""
    return topic.encoding.lower() == "cdr" and ros_type(topic.type) in types
