"""One SQLite storage file of a ROS 2 bag, whole or damaged, with its journal; nothing is ever written beside it.

The rollback journal is applied here to a copy, and not by SQLite: SQLite then also deletes the file that the journal
names as its super-journal, wherever that is (the formats are public: https://www.sqlite.org/fileformat2.html).
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import struct
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from itertools import chain, pairwise
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple
from urllib.parse import quote

from lidarcli.errors import UnreadableError, unreadable
from lidarcli.logs.base import MAX_MESSAGE, ReadReport, ros_type
from lidarcli.logs.laserscan import scan_type
from lidarcli.logs.rosbag2.salvage import BEFORE_ALL, HEADER, MAGIC, Found, MessageRow, Salvage, TopicRow, guess_topics
from lidarcli.newfiles import scratch_folder

JOURNAL_MAGIC = bytes.fromhex("d9d505f920a163d7")
JOURNAL, WAL = "-journal", "-wal"
"""Suffixes of the rollback journal and the write-ahead log."""

_HEAD = struct.Struct(">8s5I")
_NUMBER = struct.Struct(">I")
_TO_THE_END = 0xFFFFFFFF
"""Number of records that stands for all there are."""
_LOCKED_BYTE = 1 << 30
"""The page that holds this byte is never in a journal."""
_SUMMED = 200
"""Every 200th byte of a page is in its checksum, from its end on."""


class _Head(NamedTuple):
    """The head of one part of a journal."""

    records: int
    nonce: int
    pages: int
    """Pages of the database before the transaction."""
    sector: int
    """Bytes of the head with its padding."""
    page: int
    """Bytes of a page."""


def merge(database: Path, source: Path) -> None:
    """Bring the files beside `source` into its copy `database`, which nothing stands beside afterwards.

    Raises
    ------
    OSError, sqlite3.Error
        They cannot be read, or the copy cannot be written.
    """
    if is_needed(source, JOURNAL):
        roll_back(database, Path(f"{source}{JOURNAL}"))
    if is_needed(source, WAL):
        beside = Path(f"{database}{WAL}")
        shutil.copyfile(f"{source}{WAL}", beside)
        # Its frames hold pages and no names of files: what SQLite writes stays beside the copy.
        with closing(sqlite3.connect(database, isolation_level=None)) as connection:
            connection.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
        beside.unlink(missing_ok=True)


def is_needed(database: Path, suffix: str) -> bool:
    """Return True if the file with this suffix beside a database may hold a part of it."""
    beside = Path(f"{database}{suffix}")
    return beside.is_file() and beside.stat().st_size > 0


def roll_back(database: Path, journal: Path) -> None:
    """Put the pages back that a transaction had changed before it was broken off, as far as their checksums hold."""
    with journal.open("rb") as pages, database.open("r+b") as target:
        first = _head(pages, 0)
        if first is None:
            return
        most = pages.seek(0, 2) + target.seek(0, 2)
        restored: set[int] = set()
        for number, page in _pages(pages, first):
            end = number * first.page
            if number not in restored and end <= most:
                restored.add(number)
                target.seek(end - first.page)
                target.write(page)
        if target.seek(0, 2) > first.pages * first.page:
            target.truncate(first.pages * first.page)


def _pages(journal: BinaryIO, first: _Head) -> Iterator[tuple[int, bytes]]:
    """Number and content of each page that a journal holds, up to the first record that was not written whole."""
    size, place, head = journal.seek(0, 2), 0, _head(journal, 0)
    record = first.page + 2 * _NUMBER.size
    while head is not None:
        place += first.sector
        left = (size - place) // record
        count = left if head.records == _TO_THE_END else head.records
        for _ in range(min(count, left)):
            number, page = _record(journal, place, first.page, head.nonce)
            if not number:
                return
            if number <= head.pages:
                yield number, page
            place += record
        if count > left:
            return
        place = -(-place // first.sector) * first.sector
        head = _head(journal, place)


def _head(journal: BinaryIO, place: int) -> _Head | None:
    """Return the head at a byte of the journal; None at its end, or if it was never in force."""
    journal.seek(place)
    data = journal.read(_HEAD.size)
    if len(data) < _HEAD.size or not data.startswith(JOURNAL_MAGIC):
        return None
    head = _Head(*_HEAD.unpack(data)[1:])
    sizes = (head.sector, 32), (head.page, 512)
    sound = all(least <= size <= 1 << 16 and size & (size - 1) == 0 for size, least in sizes)
    return head if sound and (place or head.pages) else None


def _record(journal: BinaryIO, place: int, size: int, nonce: int) -> tuple[int, bytes]:
    """Number and content of the page of a record; 0 where the record was not written whole."""
    journal.seek(place)
    data = journal.read(size + 2 * _NUMBER.size)
    number = _NUMBER.unpack_from(data)[0]
    page = data[_NUMBER.size : _NUMBER.size + size]
    checksum = nonce + sum(page[at] for at in range(size - _SUMMED, 0, -_SUMMED))
    held = checksum & 0xFFFFFFFF == _NUMBER.unpack_from(data, _NUMBER.size + size)[0]
    return (number if held and number != _LOCKED_BYTE // size + 1 else 0), page


SIDECARS = (JOURNAL, WAL)
"""Files beside a database that hold a part of it when the recorder was not stopped properly."""


class UnsoundError(Exception):
    """A database that SQLite cannot read in bounded time and memory, or only by running its SQL."""


SQLITE_ERRORS = (sqlite3.Error, UnicodeDecodeError, UnsoundError)
"""Errors of reading a damaged database with SQLite; its messages may quote bytes that are no text."""
DISK_SHARE = 0.9
BATCH = 32
"""Most messages fetched at a time."""
BATCH_BYTES = 16 << 20
"""Bytes after which no further message is fetched."""

MAX_TEXT = 1 << 16
"""Longest text of the schema and of the topics table that is read [bytes]."""
STEPS_PER_BYTE = 4
"""Most steps of SQLite's machine per statement and byte; a row, of ten bytes or more, takes about 20."""
STEPS = 1_000_000
"""Steps that are always allowed."""
ASKED_EVERY = 10_000
"""Steps between two checks of the bound."""

_SCHEMA = "SELECT type, name, sql FROM sqlite_master"
_PLAIN = re.compile(r"CREATE (TABLE|(UNIQUE )?INDEX)\b", re.IGNORECASE)
"""Definitions of plain tables and indexes, as SQLite stores them."""
_TABLES = ("topics", "messages", "message_definitions")
_PRAGMAS = ("temp_store", "cell_size_check", "table_xinfo", "ignore_check_constraints", "quick_check")
ROWID = "_rowid_"
# Rows come in the order of their numbers, in which tables keep them: sorting would hold all of them. The column `id` is
# that number in what rosbag2 writes, and may be any other where somebody else has written the table.
_TOPICS = "SELECT id, name, type, serialization_format FROM topics NOT INDEXED"
_TYPES = (int, str, str, str)
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
"""Allowed actions of statements, and their objects."""

Row = tuple[int, int, int | None, bytes | None]
"""Row id, topic id, time [ns] and message; None where it has none that can be used."""


@dataclass(slots=True)
class Known:
    """Knowledge of one look at a whole storage file, so that no pass over the file needs a second look."""

    counts: Counter[int] | None = None
    """Topic id → messages."""
    orphans: dict[int, int] = field(default_factory=dict)
    """Number of messages of each missing or broken topic."""
    found: Found | None = None
    """Contents of the pages, if SQLite refuses the file."""
    size: int = 0
    """Size of the examined file [bytes]."""


class SqliteBag:
    """Topics and messages of one storage file: by SQLite as far as it goes, then straight from the pages."""

    compression = "none"
    number = ROWID
    """Column that tells the rows of the messages apart."""

    def __init__(self, path: Path, shown: str, report: ReadReport, known: Known) -> None:
        """`shown` names the file in errors; `known` is what is known of it, and takes what is found."""
        self.topics: dict[int, TopicRow] = {}
        self._read_as: dict[str, str] = {}
        self._last, self._newest = 0, 0
        self._shown, self._report, self._known = shown, report, known
        self._stack = ExitStack()
        self._database: sqlite3.Connection | None = None
        self._file: BinaryIO | None = None
        self._cause = ""
        self._path = path
        self._size = self._steps = 0
        try:
            with unreadable(shown):
                self._open(path)
        except UnreadableError:
            self.close()
            raise

    @property
    def progress(self) -> float:
        """Share of the file that has been read, from 0 to 1."""
        return max(0.0, self._last / self._newest) if self._newest > 0 else 0.0

    def sound_file(self) -> Path | None:
        """Return the database with its journal merged in; None where SQLite refuses it or finds a damaged page."""
        if self._database is not None:
            try:
                # What a column is computed by, or held against, is SQL of the log.
                for kind, name, _ in self._ask(self._database, _SCHEMA):
                    if kind == "table":
                        _refuse_computed(self._database, name)
                self._database.execute("PRAGMA ignore_check_constraints = on")
                if self._ask(self._database, "PRAGMA quick_check(1)").fetchone() == ("ok",):
                    return self._path
            except SQLITE_ERRORS as err:
                self._cause = _cause(err)
                self._report.add_damage("database", f"{self._cause}; topics and messages alone are copied")
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
                known.orphans = {id_: n for id_, n in known.counts.items() if id_ not in self.topics}
            except SQLITE_ERRORS as err:
                self._cause = _cause(err)
        if known.counts is None:
            known.counts = Counter(self._salvage()[1].topic_ids)
        return known.counts

    def report_orphans(self) -> None:
        """Report messages of missing or broken topics as lost."""
        self.counts()
        if orphans := self._known.orphans:
            which = ", ".join(repr(topic) for topic in sorted(orphans, key=repr)[:5])
            lost = f"has no topic {which}; messages lost: {sum(orphans.values()):,}"
            self._report.add_damage("topics table", lost)

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
            raise UnreadableError(f"{self._shown}: the file is empty")
        path = self._path = self._merged(path)
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
            self.topics = {row[0]: TopicRow(*row) for row in topics}
            # Bags before ROS 2 Iron have no definitions.
            with suppress(*SQLITE_ERRORS):
                for kind, *told in _bounded(self._ask(self._database, _DEFINITIONS), self._size):
                    self._read_as[kind] = scan_type(ros_type(kind), *told)
            self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_MESSAGE + MAX_TEXT)
            self._ask(self._database, _NEWEST.format(self.number)).fetchone()
        except SQLITE_ERRORS as err:
            self._cause = _cause(err)
            if self._database is not None:
                self._database.close()
                self._database = None
            self._open_damaged()

    def _connect(self, path: Path) -> sqlite3.Connection:
        """Connect to the database for reading rows of plain tables in bounded time, and nothing else.

        Raises
        ------
        UnsoundError
            The database holds more than rows: SQL of its own would run whenever it is read.
        """
        # `immutable` keeps SQLite from making files beside the log, from looking for a journal there, and works in a
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
        """Return the storage file, or a copy of it with what stands beside it."""
        sidecars = [Path(f"{path}{suffix}") for suffix in SIDECARS if is_needed(path, suffix)]
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
        self.topics = dict(sorted(found.topics.items()))
        if not self.topics and found.rowids:
            self.topics = guess_topics(salvage, found)
        if not self.topics:
            raise UnreadableError(f"{self._shown}: holds no ROS 2 messages ({self._cause})")

    def _copy(self, path: Path, sidecars: list[Path]) -> Path | None:
        """Return a copy in a temporary folder, as nothing is changed beside the log; None if it has no room."""
        target = self._stack.enter_context(scratch_folder()) / "bag.db3"
        needed = 2 * sum(file.stat().st_size for file in [path, *sidecars])
        if needed > DISK_SHARE * shutil.disk_usage(target.parent).free:
            names = ", ".join(sidecar.name for sidecar in sidecars)
            self._report.add_damage(names, "not read: no room in the temporary folder to merge it into a copy of the bag")
            return None
        shutil.copyfile(path, target)
        return target

    def _salvage(self) -> tuple[Salvage, Found]:
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
        self._report.add_damage("database", cause)


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


def quoted(name: object) -> str:
    """Return a name as SQL writes it (`UnsoundError` where it cannot)."""
    if not isinstance(name, str) or "\0" in name:
        raise UnsoundError("a table has no name that can be written")
    return '"' + name.replace('"', '""') + '"'


def _refuse_computed(database: sqlite3.Connection, table: object) -> None:
    """Refuse a table that is not read without running SQL (`UnsoundError`)."""
    if any(column[-1] for column in database.execute(f"PRAGMA table_xinfo({quoted(table)})")):
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
    while len(rows) < BATCH and size < BATCH_BYTES and (row := cursor.fetchone()) is not None:
        rows.append(row)
        size += len(row[3] or b"")
    return rows


def is_cdr(topic: TopicRow) -> bool:
    """Return True if the messages of a topic are serialised as in ROS 2."""
    return topic.encoding.lower() == "cdr"
