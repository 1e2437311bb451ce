"""Databases made to do harm: nothing but their own rows is read, in bounded time, and nothing else is touched."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Callable
from pathlib import Path

import pytest

from lidarcli.cli import run
from lidarcli.errors import UnreadableError
from lidarcli.logs.rosbag2_salvage import Salvage
from tests.logs.hostile_databases import HOSTILE, JOURNAL_MAGIC, MESSAGES, PAGE, bag, killed, name_super_journal
from tests.logs.numbered import indices
from tests.logs.numbered import read_bag as read
from tests.logs.watched import Rosbag2Log

pytestmark = pytest.mark.usefixtures("nothing_left_behind")


def content(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


# Rollback journals.


def test_a_journal_brings_back_what_stood_before_the_transaction(tmp_path: Path) -> None:
    path = killed(tmp_path)
    before = content(tmp_path)
    assert Path(f"{path}-journal").read_bytes().startswith(JOURNAL_MAGIC)
    assert read(path) == (list(range(30)), [])
    assert content(tmp_path) == before
    # Without it, pages that the transaction changed stand in the file.
    assert b"\0" * 200 in path.read_bytes()


def read_blocks(path: Path) -> tuple[list[tuple[int, bytes]], dict[tuple[str, str], int], list[str]]:
    with Rosbag2Log(str(path)) as log:
        blocks = [(int(block.stamp_ns[0]), block.ranges.tobytes()) for block in log.scans()]
        return blocks, dict(log.report.refused), [damage.cause for damage in log.report.damage]


@pytest.mark.slow
@pytest.mark.parametrize("cut", [0, 3, 28, 500, 512, 3000, 5000, 9000, 20_000])
def test_a_journal_is_applied_as_sqlite_does(tmp_path: Path, cut: int) -> None:
    """The journal was cut, or is damaged there: pages are put back as far as its checksums hold."""
    path = killed(tmp_path)
    journal = Path(f"{path}-journal")
    data = bytearray(journal.read_bytes())
    if cut % 3:
        data[cut % len(data)] ^= 0x55
    else:
        del data[cut:]
    journal.write_bytes(data)
    found = read_blocks(path)
    theirs = sqlite3.connect(path)
    theirs.execute("SELECT count(*) FROM sqlite_master").fetchone()
    theirs.close()
    journal.unlink(missing_ok=True)
    assert found == read_blocks(path)


@pytest.mark.parametrize("command", ["info", "detect"])
@pytest.mark.parametrize("whole", [True, False])
def test_no_file_that_a_journal_names_is_touched(tmp_path: Path, command: str, whole: bool) -> None:
    """SQLite deletes what a hot journal names as its super-journal: any file of the user."""
    victims = tmp_path / "victims"
    victims.mkdir()
    victim = victims / "thesis.tex"
    victim.write_text("years of work")
    stamp = victim.stat().st_mtime_ns
    log = tmp_path / "log"
    log.mkdir()
    if whole:
        path = killed(log)
    else:
        path = log / "run.db3"
        bag(path, sweeps=30).close()
        first = path.read_bytes()[:PAGE]
        checksum = 7 + sum(first[at] for at in range(PAGE - 200, 0, -200)) & 0xFFFFFFFF
        head = JOURNAL_MAGIC + struct.pack(">IIIII", 1, 7, path.stat().st_size // PAGE, 512, PAGE)
        Path(f"{path}-journal").write_bytes(
            head.ljust(512, b"\0") + struct.pack(">I", 1) + first + struct.pack(">I", checksum)
        )
    name_super_journal(Path(f"{path}-journal"), str(victim))
    before = content(tmp_path)
    out = ["-o", str(tmp_path / "out")] if command == "detect" else []
    for target in (path, log):
        assert run(["-q", command, str(target), *out, *(["--overwrite"] if out else [])]) == 0
    assert {name: data for name, data in content(tmp_path).items() if "/out/" not in name} == before
    assert victim.stat().st_mtime_ns == stamp
    assert read(path) == (list(range(30)), [])


def test_a_write_ahead_log_cannot_make_the_copy_huge(tmp_path: Path) -> None:
    """The last frame declares how many pages the database has then: four thousand million, of which none is there."""
    work = tmp_path / "work.db3"
    database = bag(work, sweeps=5)
    database.execute("PRAGMA journal_mode = wal")
    database.execute("PRAGMA wal_autocheckpoint = 0")
    database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 5, x'00')")
    path = tmp_path / "run.db3"
    shutil.copy(work, path)
    wal = bytearray(Path(f"{work}-wal").read_bytes())
    database.close()
    big = struct.unpack(">I", wal[:4])[0] & 1
    at = 32
    first, second = struct.unpack(">II", wal[24:32])
    frames = (len(wal) - 32) // (24 + PAGE)
    for frame in range(frames):
        if frame == frames - 1:
            wal[at + 4 : at + 8] = struct.pack(">I", 0x7FFFFFF0)
        words = struct.unpack(f"{'>' if big else '<'}{2 + PAGE // 4}I", wal[at : at + 8] + wal[at + 24 : at + 24 + PAGE])
        for one, other in zip(words[::2], words[1::2], strict=True):
            first = (first + one + second) & 0xFFFFFFFF
            second = (second + other + first) & 0xFFFFFFFF
        wal[at + 16 : at + 24] = struct.pack(">II", first, second)
        at += 24 + PAGE
    Path(f"{path}-wal").write_bytes(wal)
    found, damage = read(path)
    assert found == [*range(5)]
    assert damage != []


def test_a_write_ahead_log_beside_a_schema_that_is_no_text(tmp_path: Path) -> None:
    """What SQLite says of it quotes bytes that are no text either."""
    work, path = tmp_path / "work.db3", tmp_path / "run.db3"
    database = bag(work)
    database.execute("PRAGMA journal_mode = wal")
    database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 5, x'00')")
    for suffix in ("", "-wal"):
        shutil.copy(f"{work}{suffix}", f"{path}{suffix}")
    database.close()
    data = path.read_bytes().replace(b"CREATE TABLE messages(id", b"CREATE TABLE (essages id")
    path.write_bytes(data.replace(b"tablemessages", b"tablem\x94ssages"))
    found, damage = read(path)
    assert found == list(range(20))
    assert damage[0].startswith("database: SQLite says: malformed database schema; read page by page: ")


# Views, triggers, computed columns, virtual tables: SQL of the file's own.


@pytest.mark.parametrize("kind", HOSTILE)
def test_sql_of_the_file_is_not_run(tmp_path: Path, kind: str) -> None:
    statements, cause = HOSTILE[kind]
    path = tmp_path / "run.db3"
    database = bag(path)
    for statement in statements:
        database.execute(statement)
    database.close()
    assert read(path) == (
        list(range(20)),
        [
            f"database: {cause}; a bag has plain tables and indexes alone; read page by page: 20 messages recovered"
            if "would run" in cause
            else f"database: {cause}; read page by page: 20 messages recovered"
        ],
    )


def test_a_view_that_is_entered_as_a_table_is_not_run(tmp_path: Path) -> None:
    """The schema's own columns may lie: what counts is the statement that SQLite would parse."""
    path = tmp_path / "run.db3"
    database = bag(path)
    database.execute("ALTER TABLE messages RENAME TO m")
    database.execute("CREATE VIEW messages AS SELECT * FROM m")
    database.execute("PRAGMA writable_schema = on")
    database.execute("UPDATE sqlite_master SET type = 'table', name = 'innocent' WHERE type = 'view'")
    database.close()
    found, damage = read(path)
    assert found == list(range(20))
    assert "innocent is a table that would run" in damage[0] or "SQLite says: malformed" in damage[0]


@pytest.mark.parametrize("key", ["INTEGER", "INT PRIMARY KEY", "INTEGER PRIMARY KEY DESC"])
def test_ids_that_are_no_row_numbers_need_no_sorting(tmp_path: Path, key: str) -> None:
    """Sorting would hold all messages in memory; a recorder writes them in order."""
    path = tmp_path / "run.db3"
    database = bag(path)
    database.execute("ALTER TABLE messages RENAME TO m")
    database.execute(MESSAGES.replace("INTEGER PRIMARY KEY", key))
    database.execute("INSERT INTO messages SELECT * FROM m")
    database.execute("DROP TABLE m")
    database.close()
    assert read(path) == (list(range(20)), [])


@pytest.mark.slow
@pytest.mark.parametrize("wanted", ["messages", "topics"])
def test_a_page_that_names_itself_many_times_ends(tmp_path: Path, wanted: str) -> None:
    """A tree whose pages lead to one another has more rows than anybody can read."""
    path = tmp_path / "run.db3"
    database = bag(path, sweeps=300)
    if wanted == "topics":
        database.executemany("INSERT INTO topics VALUES (?, ?, 'x', 'cdr')", [(i, "n" * 3000) for i in range(2, 50)])
    (root,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (wanted,)).fetchone()
    database.close()
    data = bytearray(path.read_bytes())
    at = (root - 1) * PAGE
    assert data[at] == 5
    cells = struct.unpack(">H", data[at + 3 : at + 5])[0]
    places = struct.unpack(f">{cells}H", data[at + 12 : at + 12 + 2 * cells])
    leaf = data[at + places[0] : at + places[0] + 4]
    for place in places:
        data[at + place : at + place + 4] = leaf
    path.write_bytes(data)
    try:
        found, damage = read(path)
    except UnreadableError as err:
        assert wanted == "topics"
        damage = [str(err)]
    else:
        assert len(found) == len(set(found))
    assert damage != []


def large_rows(path: Path, rows: int, follow: Callable[[int, int], tuple[int, int]]) -> None:
    """A database whose rows of 8 MB all go on at one overflow page; `follow` says which pages that and another one name."""
    database = bag(path, sweeps=3)
    database.execute("PRAGMA user_version = 1")
    database.close()
    pages = [path.read_bytes()[at : at + PAGE] for at in range(0, path.stat().st_size, PAGE)]
    # How many of its bytes stand in its leaf page, as the file format says.
    size, local = 8_000_000, 489 + (8_000_000 - 489) % (PAGE - 4)
    local = local if local <= PAGE - 35 else 489
    count = len(pages) + rows
    first, second = count + 1, count + 1100
    for row in range(rows):
        record = bytes([8, 0, 9, 6]) + varint(12 + 2 * (size - 16)) + struct.pack(">q", row)
        cell = varint(size) + varint(1000 + row) + record.ljust(local, b"\0") + struct.pack(">I", first)
        page = bytearray(PAGE)
        page[0], page[3:5] = 13, struct.pack(">H", 1)
        page[8:10] = struct.pack(">H", PAGE - len(cell))
        page[PAGE - len(cell) :] = cell
        pages.append(bytes(page))
    pages += [bytes(PAGE)] * (second - count)
    for number, named in zip((first, second), follow(first, second), strict=True):
        pages[number - 1] = struct.pack(">I", named).ljust(PAGE, b"\0")
    path.write_bytes(b"".join(pages))


def varint(number: int) -> bytes:
    parts = [number & 0x7F]
    while number := number >> 7:
        parts.append(0x80 | number & 0x7F)
    return bytes(reversed(parts))


@pytest.mark.parametrize(
    "follow", [lambda one, other: (one, one), lambda one, other: (other, one)], ids=["itself", "each other"]
)
def test_overflow_pages_that_lead_to_themselves(
    tmp_path: Path, follow: Callable[[int, int], tuple[int, int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every row would be 8 MB; what is read for them is bounded by the file, which is read a few times over."""
    path = tmp_path / "run.db3"
    large_rows(path, 1500, follow)
    taken: list[int] = []
    at = Salvage._at
    monkeypatch.setattr(Salvage, "_at", lambda self, place, size: taken.append(size) or at(self, place, size))
    with Rosbag2Log(str(path)) as log:
        assert [round(float(block.ranges[row, 0])) for block in log.scans() for row in range(len(block))][:3] == [0, 1, 2]
        (damage,) = log.report.damage
    assert "; read page by page: 3 messages recovered, 1,500 not whole" in damage.cause
    assert sum(taken) < 20 * path.stat().st_size


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 15, 16, 17, 20, 99, 100, 101, 512])
def test_a_database_of_a_few_bytes(tmp_path: Path, size: int) -> None:
    path = tmp_path / "run.db3"
    bag(path).close()
    path.write_bytes(path.read_bytes()[:size])
    with pytest.raises(UnreadableError, match=r"run\.db3: holds no ROS 2 messages \(.*\)$"):
        Rosbag2Log(str(path))


# Row ids.


def test_times_that_are_no_whole_numbers(tmp_path: Path) -> None:
    """They were left out without a word."""
    path = tmp_path / "run.db3"
    database = bag(path)
    database.execute("UPDATE messages SET timestamp = NULL WHERE id IN (3, 5)")
    database.execute("UPDATE messages SET timestamp = 'noon' WHERE id = 7")
    database.close()
    with Rosbag2Log(str(path)) as log:
        assert indices(log) == [index for index in range(20) if index not in (2, 4, 6)]
        assert dict(log.report.refused) == {("/scan", "no time that is a number"): 3}
    database = sqlite3.connect(path, isolation_level=None)
    database.execute("ALTER TABLE messages RENAME TO m")
    database.execute(MESSAGES.replace("timestamp INTEGER", "timestamp REAL"))
    database.execute("INSERT INTO messages SELECT * FROM m")
    database.execute("DROP TABLE m")
    database.close()
    with Rosbag2Log(str(path)) as log:
        assert sum(len(block) for block in log.scans()) == 17
        assert dict(log.report.refused) == {("/scan", "no time that is a number"): 3}


def test_names_and_messages_of_megabytes(tmp_path: Path) -> None:
    path = tmp_path / "run.db3"
    database = bag(path)
    database.execute("INSERT INTO topics VALUES (2, ?, 'x', 'cdr')", ("n" * 3_000_000,))
    database.close()
    found, damage = read(path)
    assert found == list(range(20))
    assert damage == ["database: SQLite says: string or blob too big; read page by page: 20 messages recovered"]
