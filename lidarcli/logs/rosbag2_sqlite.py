"""Storage files of ROS 2 bags in SQLite: by SQLite as far as it goes, then straight from the pages.

Nothing is ever written next to a bag: a database that was not closed properly is merged with its journal in a copy.
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

from lidarcli.errors import UnreadableError, unreadable
from lidarcli.files.newfiles import scratch_folder
from lidarcli.logs.base import MAX_MESSAGE, Closing, Message, OpenOptions, ReadReport, Topic, ros_type
from lidarcli.logs.laserscan import MessageBatcher, scan_type
from lidarcli.logs.rosbag2_salvage import (
    BEFORE_ALL,
    HEADER,
    MAGIC,
    MessageRow,
    RecoveredPages,
    Salvage,
    TopicRow,
    guess_topics,
)
from lidarcli.logs.unpacking import PACKED_CAUSE, ZSTD_MAGIC, DecompressionBudget, unpack_message
from lidarcli.sweeps.types import RawSweeps

NO_DATA = "no data, or more than a sweep can have"
NO_TIME = "no time that is a number"
JOURNAL, WAL = "-journal", "-wal"


class UnsoundError(Exception):
    """A database that SQLite cannot read in bounded time and memory, or only by running its SQL."""


SQLITE_ERRORS = (sqlite3.Error, UnicodeDecodeError, UnsoundError)
"""Errors of reading a damaged database with SQLite; its messages may quote bytes that are no text."""
BATCH = 32

MAX_TEXT = 1 << 16
"""Longest text of the schema and of the topics table that is read [bytes]."""
ASKED_EVERY = 10_000
STEPS, STEPS_PER_BYTE = 1_000_000, 4
"""Most steps of a statement, and for each byte of the file: a row, of ten bytes or more, takes about 20."""

_SCHEMA = "SELECT type, name, sql FROM sqlite_master"
_PLAIN = re.compile(r"CREATE (TABLE|(UNIQUE )?INDEX)\b", re.IGNORECASE)
"""Definitions of plain tables and indexes, as SQLite stores them."""
_TABLES = ("topics", "messages", "message_definitions")
_PRAGMAS = (
    *("temp_store", "cell_size_check", "table_xinfo", "index_list", "index_xinfo"),
    *("ignore_check_constraints", "quick_check"),
)
ROWID = "_rowid_"
# Rows come in the order of their numbers, in which tables keep them: sorting would hold all of them. The column `id` is
# that number in what rosbag2 writes, and may be any other where somebody else has written the table.
_TOPICS = "SELECT id, name, type, serialization_format FROM topics NOT INDEXED"
_TYPES = (int, str, str, str)
_PROFILES = "SELECT id, offered_qos_profiles FROM topics NOT INDEXED"
_DEFINITIONS = (
    "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions NOT INDEXED"
    " WHERE typeof(topic_type) || typeof(encoding) || typeof(encoded_message_definition) = 'texttexttext'"
)
_NEWEST = "SELECT max({}) FROM messages"
_COUNTED = (
    "SELECT CASE WHEN CAST(topic_id AS INTEGER) = topic_id THEN CAST(topic_id AS INTEGER) ELSE typeof(topic_id) END"
    " FROM messages"
)
_ROWS = (
    "SELECT {}, CAST(topic_id AS INTEGER), CASE WHEN typeof(timestamp) IN ('integer', 'real') THEN"
    " CAST(timestamp AS INTEGER) END,"
    f" CASE WHEN typeof(data) = 'blob' AND length(data) <= {MAX_MESSAGE} THEN data END"
    " FROM messages NOT INDEXED WHERE topic_id IN ({})"
)
_ALLOWED = {
    sqlite3.SQLITE_SELECT: None,
    sqlite3.SQLITE_READ: {"sqlite_master", *_TABLES},
    sqlite3.SQLITE_PRAGMA: {*_PRAGMAS},
    sqlite3.SQLITE_FUNCTION: {"max", "typeof", "length"},
}

Row = tuple[int, int, int | None, bytes | None]
"""Row id, topic id, time [ns] and message; None where it has none that can be used."""


@dataclass(slots=True)
class Known:
    """Knowledge of one look at a whole storage file, so that no pass over the file needs a second look."""

    counts: Counter[int] | None = None
    orphans: dict[int, int] = field(default_factory=dict)
    """Number of messages of each missing or broken topic."""
    found: RecoveredPages | None = None
    size: int = 0


def merge(database: Path, source: Path) -> None:
    """Let SQLite merge the journals next to `source` into its copy `database`, and delete those of the copy.

    A rollback journal may name a super-journal at its end, which SQLite deletes wherever it is: that name is spoiled.
    """
    for suffix in _sidecars(source):
        sidecar = Path(f"{database}{suffix}")
        shutil.copyfile(f"{source}{suffix}", sidecar)
        with sidecar.open("ab") as file:
            file.write(bytes(8) if suffix == JOURNAL else b"")
        with closing(sqlite3.connect(database, isolation_level=None)) as connection:
            # The first look at the file rolls back what its journal holds.
            connection.execute("PRAGMA schema_version").fetchall()
            if suffix == WAL:
                connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        sidecar.unlink(missing_ok=True)


def _sidecars(database: Path) -> list[str]:
    """Return the suffixes of the files next to a database that may hold a part of it."""
    sidecar = {suffix: Path(f"{database}{suffix}") for suffix in (JOURNAL, WAL)}
    return [suffix for suffix, path in sidecar.items() if path.is_file() and path.stat().st_size > 0]


class SqliteLog(Closing):
    """One storage file of SQLite as a `Log`: by SQLite as far as it goes, then straight from the pages."""

    format = "ros2 bag (sqlite3)"
    number = ROWID
    """Column with the number of each row of the messages."""

    def __init__(self, file: Path, path: str, options: OpenOptions, known: Known) -> None:
        """`path` names the file in errors; `known` is what is known of it, and takes what is found."""
        self.path, self.file = path, file
        self.compression = "none"
        self.topic_rows: dict[int, TopicRow] = {}
        self.met = ReadReport()
        """Takes the damage of the file; that of messages goes to the report of the pass."""
        self._options, self._known = options, known
        self._budget = DecompressionBudget()
        self._read_as: dict[str, str] = {}
        self._last, self._newest = 0, 0
        self._stack = ExitStack()
        self._database: sqlite3.Connection | None = None
        self._file: BinaryIO | None = None
        self._cause = ""
        self._size = self._steps = 0
        try:
            with unreadable(path):
                self.size: int | None = file.stat().st_size
                self._open(file)
        except UnreadableError:
            self.close()
            raise

    @property
    def position(self) -> int:
        """Share of the file that has been read, in its bytes."""
        return int((self.size or 0) * max(0.0, self._last / self._newest if self._newest > 0 else 0.0))

    def topics(self) -> list[Topic] | None:
        """Return the topics with the number of their messages."""
        counts = self.counts()
        return [
            Topic(it.name, ros_type(it.type), it.encoding, counts.get(it.id, 0), self.read_as(it))
            for it in self.topic_rows.values()
        ]

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps in log order within each topic."""
        gathers = {}
        for topic in self.topic_rows.values():
            kind = self.read_as(topic)
            if not kind or (topics is not None and topic.name not in topics):
                continue
            if is_cdr(topic):
                gathers[topic.id] = MessageBatcher(topic.name, kind, "cdr", report, self._options.echo)
            elif count := self.counts().get(topic.id, 0):
                report.refused[(topic.name, f"the encoding '{topic.encoding}' is not read")] += count
        try:
            self.counts()
            if orphans := self._known.orphans:
                which = ", ".join(repr(topic) for topic in sorted(orphans, key=repr)[:5])
                lost = f"has no topic {which}; messages lost: {sum(orphans.values()):,}"
                self.met.add_damage("topics table", lost)
            for row in chain.from_iterable(self.batches(gathers)) if gathers else ():
                gather = gathers[row[1]]
                if (message := self._message(gather.topic, row, report)) is not None and gather.add(*message):
                    yield from gather.flush()
            for gather in gathers.values():
                yield from gather.flush()
        finally:
            report.add(self.met)

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield raw messages of the given types in log order."""
        wanted = {topic.id: topic for topic in self.topic_rows.values() if is_cdr(topic) and ros_type(topic.type) in types}
        try:
            for row in chain.from_iterable(self.batches(wanted)) if wanted else ():
                topic = wanted[row[1]]
                if (message := self._message(topic.name, row, report)) is not None:
                    yield Message(topic.name, ros_type(topic.type), "cdr", message[1], message[0])
        finally:
            report.add(self.met)

    def sound_file(self) -> Path | None:
        """Return the database with its journal merged in; None where SQLite refuses it or finds a damaged page."""
        if self._database is not None:
            try:
                # What a column or an index is computed by is SQL of the log.
                for kind, name, _ in self._ask(self._database, _SCHEMA):
                    if kind == "table":
                        _refuse_computed(self._database, name)
                for _, name, *_, is_partial in self._ask(self._database, "PRAGMA index_list(messages)"):
                    columns = self._database.execute(f"PRAGMA index_xinfo({_quoted(name)})")
                    if is_partial or any(column == -2 for _, column, *_ in columns):
                        raise UnsoundError(f"{name} is an index that would be computed")
                self._database.execute("PRAGMA ignore_check_constraints = on")
                if self._ask(self._database, "PRAGMA quick_check(1)").fetchone() == ("ok",):
                    return self.file
            except SQLITE_ERRORS as err:
                self._cause = _cause(err)
                self.met.add_damage("database", f"{self._cause}; topics and messages alone are copied")
        return None

    def read_as(self, topic: TopicRow) -> str:
        """Return the type as which the messages of a topic are read as sweeps; empty where they are none."""
        return self._read_as.get(topic.type, scan_type(ros_type(topic.type)))

    def counts(self) -> Counter[int]:
        """Return the number of messages by topic id."""
        known = self._known
        if known.counts is None and self._database is not None:
            try:
                # GROUP BY would take as long, for the time goes into reading pages, and sort all rows in memory.
                known.counts = Counter(chain.from_iterable(self._ask(self._database, _COUNTED)))
                known.orphans = {id_: n for id_, n in known.counts.items() if id_ not in self.topic_rows}
            except SQLITE_ERRORS as err:
                self._cause = _cause(err)
        if known.counts is None:
            known.counts = Counter(self._salvage()[1].topic_ids)
        return known.counts

    def profiles(self) -> dict[int, str]:
        """Return how each topic was offered, by its id, as far as SQLite can read it."""
        found: dict[int, str] = {}
        if self._database is not None:
            with suppress(*SQLITE_ERRORS):
                found |= {id_: text for id_, text in self._ask(self._database, _PROFILES) if isinstance(text, str)}
        return found

    def batches(self, topics: Collection[int]) -> Iterator[list[Row]]:
        """Yield messages of the given topic ids in the order they were recorded, a few at a time."""
        self._last = BEFORE_ALL
        if self._database is not None:
            try:
                (newest,) = self._ask(self._database, _NEWEST.format(self.number)).fetchone()
                self._newest = newest if isinstance(newest, int) else 0
                sql = _ROWS.format(self.number, ", ".join(map(str, topics)))
                cursor = self._ask(self._database, sql)
                left = self._size
                while rows := _fetch(cursor):
                    ids = [self._last, *(row[0] for row in rows)]
                    if not _ascending(ids):
                        raise UnsoundError("row numbers are out of order")
                    left -= sum(len(row[3]) for row in rows if row[3] is not None)
                    if left < 0:
                        raise UnsoundError("its rows hold more bytes than the file")
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
        self._stack.close()

    def _open(self, path: Path) -> None:
        self._file = path.open("rb")
        if path.stat().st_size == 0:
            raise UnreadableError(f"{self.path}: the file is empty")
        path = self.file = self._merged(path)
        self._size = path.stat().st_size
        self._cause = self._cause or _wrong_size(self._file.read(HEADER), self._size)
        if self._cause:
            return self._open_damaged()
        try:
            self._database = self._connect(path)
            rows = self._ask(self._database, _TOPICS)
            topics = list(_bounded((row for row in rows if all(map(isinstance, row, _TYPES))), self._size))
            if not _ascending([row[0] for row in topics]):
                raise UnsoundError("row numbers of topics are out of order")
            self.topic_rows = {row[0]: TopicRow(*row) for row in topics}
            # Bags before ROS 2 Iron have no definitions.
            with suppress(*SQLITE_ERRORS):
                for kind, *definition in _bounded(self._ask(self._database, _DEFINITIONS), self._size):
                    self._read_as[kind] = scan_type(ros_type(kind), *definition)
            self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_MESSAGE + MAX_TEXT)
            self._ask(self._database, _NEWEST.format(self.number)).fetchone()
        except SQLITE_ERRORS as err:
            self._cause = _cause(err)
            if self._database is not None:
                self._database.close()
                self._database = None
            self._open_damaged()

    def _connect(self, path: Path) -> sqlite3.Connection:
        """Connect for reading rows of plain tables in bounded time (`UnsoundError` where SQL of the log would run)."""
        # `immutable` keeps SQLite from making files next to the log, from looking for a journal there, and works in a
        # read-only folder.
        where = f"file:{quote(str(path.absolute()))}?mode=ro&immutable=1"
        database = self._database = sqlite3.connect(where, uri=True, check_same_thread=False)
        database.text_factory = lambda text: text.decode("utf-8", "replace")
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_TEXT)
        database.setlimit(sqlite3.SQLITE_LIMIT_ATTACHED, 0)
        database.set_progress_handler(self._is_endless, ASKED_EVERY)
        database.set_authorizer(_authorize)
        database.execute("PRAGMA temp_store = memory")
        database.execute("PRAGMA cell_size_check = on")
        for kind, name, sql in self._ask(database, _SCHEMA):
            if sql is not None and not (isinstance(sql, str) and _PLAIN.match(sql)):
                raise UnsoundError(f"{name} is a {kind} that would run; a bag has plain tables and indexes alone")
        for table in _TABLES:
            _refuse_computed(database, table)
        columns = {str(column[1]).lower() for column in database.execute("PRAGMA table_xinfo(messages)")}
        try:
            database.execute(f"SELECT {ROWID} FROM messages LIMIT 0")
            self.number = "id" if ROWID in columns else ROWID
        except sqlite3.OperationalError:
            self.number = "id"
        return database

    def _ask(self, database: sqlite3.Connection, sql: str) -> sqlite3.Cursor:
        """Run a statement, which gets its own number of steps."""
        self._steps = 0
        return database.execute(sql)

    def _is_endless(self) -> bool:
        """Return True after more steps than a sound file of this size needs."""
        self._steps += ASKED_EVERY
        return self._steps > STEPS + STEPS_PER_BYTE * self._size

    def _merged(self, path: Path) -> Path:
        """Return the storage file, or a copy of it with its journals merged in."""
        sidecars = [Path(f"{path}{suffix}") for suffix in _sidecars(path)]
        copy = self._copy(path, sidecars) if sidecars else None
        if copy is None:
            return path
        try:
            merge(copy, path)
        except SQLITE_ERRORS as err:
            self._cause = _cause(err)
        most = sum(file.stat().st_size for file in [path, *sidecars])
        if copy.stat().st_size > most:
            self._cause = f"{sidecars[-1].name} declares more pages than there are"
            os.truncate(copy, most)
        if self._file is not None:
            self._file.close()
        self._file = copy.open("rb")
        return copy

    def _open_damaged(self) -> None:
        """SQLite refuses the file: find its topics by reading pages."""
        salvage, found = self._salvage()
        self.topic_rows = dict(sorted(found.topics.items()))
        if not self.topic_rows and found.rowids:
            self.topic_rows = guess_topics(salvage, found)
        if not self.topic_rows:
            raise UnreadableError(f"{self.path}: holds no ROS 2 messages ({self._cause})")

    def _copy(self, path: Path, sidecars: list[Path]) -> Path | None:
        """Return a copy in a temporary folder, as nothing is changed next to the log; None if it has no room."""
        target = self._stack.enter_context(scratch_folder()) / "bag.db3"
        needed = 2 * sum(file.stat().st_size for file in [path, *sidecars])
        if needed > 0.9 * shutil.disk_usage(target.parent).free:
            names = ", ".join(sidecar.name for sidecar in sidecars)
            self.met.add_damage(names, "not read: no room in the temporary folder to merge it into a copy of the bag")
            return None
        shutil.copyfile(path, target)
        return target

    def _salvage(self) -> tuple[Salvage, RecoveredPages]:
        if self._file is None:
            raise ValueError("the storage file is closed")
        salvage, known = Salvage(self._file), self._known
        if known.found is None or known.size != self._size:
            known.found, known.size = salvage.find(), self._size
        return salvage, known.found

    def _salvaged(self, topics: Collection[int], last: int) -> Iterator[list[Row]]:
        """Yield messages behind row `last`, page by page."""
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
        self.met.add_damage("database", cause)

    def _message(self, topic: str, row: Row, report: ReadReport) -> tuple[bytes, int] | None:
        """Return the message of a row, unpacked if it is packed, and its time; None where it is refused."""
        _, _, time, data = row
        cause = NO_DATA if data is None else NO_TIME
        # Plain CDR never begins as zstd does.
        if data is not None and time is not None and data.startswith(ZSTD_MAGIC):
            self.compression = "zstd"
            data, cause = unpack_message(data, self._budget), PACKED_CAUSE
        if data is None or time is None:
            report.refused[(topic, cause)] += 1
            return None
        return data, time


def _wrong_size(header: bytes, size: int) -> str:
    """Return what is wrong with the file size by its own header; SQLite would read on in silence."""
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


def _quoted(name: object) -> str:
    """Return a name as SQL writes it (`UnsoundError` where it cannot)."""
    if not isinstance(name, str) or "\0" in name:
        raise UnsoundError("a table has no name that can be written")
    return '"' + name.replace('"', '""') + '"'


def _refuse_computed(database: sqlite3.Connection, table: object) -> None:
    """Refuse a table that is not read without running SQL (`UnsoundError`)."""
    if any(column[-1] for column in database.execute(f"PRAGMA table_xinfo({_quoted(table)})")):
        raise UnsoundError(f"{table} has columns that would be computed")


def _authorize(action: int, first: str | None, second: str | None, _database: str | None, inside: str | None) -> int:
    """Authorize an action of a statement; nothing in a view or a trigger is allowed."""
    wanted = second if action == sqlite3.SQLITE_FUNCTION else first
    allowed: Collection[str] | None = _ALLOWED.get(action, ())
    fine = inside is None and (allowed is None or str(wanted).lower() in allowed)
    return sqlite3.SQLITE_OK if fine else sqlite3.SQLITE_DENY


def _bounded(rows: Iterable[tuple[Any, ...]], most: int) -> Iterator[tuple[Any, ...]]:
    """Yield rows whose texts together are no longer than the file that they come from [bytes]."""
    for row in rows:
        most -= sum(map(len, row[1:]))
        if most < 0:
            raise UnsoundError("its topics hold more text than the file")
        yield row


def _ascending(ids: Sequence[object]) -> bool:
    """Return True for increasing whole numbers."""
    whole = [value for value in ids if isinstance(value, int)]
    return len(whole) == len(ids) and all(before < after for before, after in pairwise(whole))


def _cause(err: Exception) -> str:
    if isinstance(err, UnsoundError):
        return str(err)
    if "interrupted" in str(err):
        return "reading it takes far more steps than a sound file of its size needs"
    return f"SQLite says: {err if isinstance(err, sqlite3.Error) else 'malformed database schema'}"


def _fetch(cursor: sqlite3.Cursor) -> list[Row]:
    """Return the next messages, as many as are held at a time; none at the end."""
    rows: list[Row] = []
    size = 0
    while len(rows) < BATCH and size < 16 << 20 and (row := cursor.fetchone()) is not None:
        rows.append(row)
        size += len(row[3] or b"")
    return rows


def is_cdr(topic: TopicRow) -> bool:
    """Return True if the messages of a topic are serialised as in ROS 2."""
    return topic.encoding.lower() == "cdr"
