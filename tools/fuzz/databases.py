"""Storage files of ROS 2 bags made to harm: views, generated columns, b-trees in circles, journals that name victims."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from tools.fuzz import sqlite_files as raw
from tools.fuzz.libraries import INDEX, MESSAGES, SCAN, SWEEPS, TOPICS, altered, database, scan_cdr, stamp_of
from tools.fuzz.logs import judge_log
from tools.fuzz.mutate import mutate
from tools.fuzz.place import VICTIMS, Place
from tools.fuzz.target import Random, Target

LOG = "run.db3"
METADATA = "metadata.yaml"
ENDLESS = "WITH RECURSIVE r(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM r)"


@dataclass(frozen=True, slots=True)
class Crafted:
    """One kind of database."""

    make: Callable[[Path, Random, Place], None]
    """Write a database to a path, and what belongs beside it."""
    least: int = 0
    """Sweeps it has for whoever ends without an error."""
    in_folder: bool = False
    """Whether it harms only as the folder of a bag."""


def write(place: Place, number: int, random: Random) -> None:
    """Each of `KINDS` as it is, then any of them, bare or in the folder of a bag, often with bytes changed."""
    names = list(KINDS)
    drawn = number >= len(names)
    name = names[int(random.integers(len(names)))] if drawn else names[number]
    in_folder = KINDS[name].in_folder or (drawn and bool(random.integers(2)))
    folder = place.input / "run" if in_folder else place.input
    folder.mkdir(exist_ok=True)
    KINDS[name].make(folder / LOG, random, place)
    metadata = folder / METADATA
    if in_folder and not os.path.lexists(metadata):
        text = f"rosbag2_bagfile_information:\n  relative_file_paths:\n    - {LOG}\n"
        metadata.write_text(text, encoding="utf-8")
    changed = drawn and bool(random.integers(3))
    if changed:
        files = sorted(path for path in folder.iterdir() if path.is_file())
        path = files[int(random.integers(len(files)))]
        path.write_bytes(mutate(path.read_bytes(), random))
    place.note(log="run" if in_folder else LOG, least=0 if changed else KINDS[name].least, kind=name)


def judge(place: Place) -> list[str]:
    """As any other log."""
    given = place.noted()
    return [f"{given['kind']}: {problem}" for problem in judge_log(place, place.input / given["log"], given["least"])]


def database_targets() -> list[Target]:
    """Crafted databases, and what may lie beside one."""
    return [Target("db3-crafted", write, judge, weight=150, known=len(KINDS))]


def _sql(*statements: str) -> Crafted:
    """A sound bag, then statements, those alone left out that this SQLite cannot do."""

    def make(path: Path, random: Random, place: Place) -> None:
        database(path)
        for statement in statements:
            with suppress(sqlite3.OperationalError):
                altered(path, statement)

    return Crafted(make)


def _view(table: str, columns: str, source: str = ENDLESS, where: str = "") -> Crafted:
    """A table of the bag is a view."""
    return _sql(
        f"ALTER TABLE {table} RENAME TO was_{table}", f"CREATE VIEW {table} AS {source} SELECT {columns} FROM r {where}"
    )


def _generated(column: str, source: str = MESSAGES) -> Crafted:
    """Messages whose data SQLite computes."""

    def make(path: Path, random: Random, place: Place) -> None:
        table = source.replace("data BLOB NOT NULL", column)
        connection = sqlite3.connect(path)
        for statement in (TOPICS, table, INDEX):
            connection.execute(statement)
        connection.execute("INSERT INTO topics VALUES (1, '/scan', ?, 'cdr', '')", (SCAN,))
        for number in range(3):
            connection.execute(
                "INSERT INTO messages (id, topic_id, timestamp) VALUES (?, 1, ?)", (number, stamp_of(number))
            )
        connection.commit()
        connection.close()

    return Crafted(make)


def _generated_name(path: Path, random: Random, place: Place) -> None:
    """The name of a topic is what SQLite computes, half a gigabyte of it."""
    database(path)
    altered(
        path,
        "ALTER TABLE topics RENAME TO was_topics",
        "CREATE TABLE topics (id INTEGER PRIMARY KEY, type TEXT, serialization_format TEXT,"
        " name TEXT GENERATED ALWAYS AS (hex(zeroblob(250000000))) VIRTUAL)",
        f"INSERT INTO topics VALUES (1, '{SCAN}', 'cdr')",
    )


def _rows(*rowids: int) -> Crafted:
    """Sound sweeps at odd row numbers."""

    def make(path: Path, random: Random, place: Place) -> None:
        database(path, sweeps=0)
        connection = sqlite3.connect(path)
        for number, rowid in enumerate(rowids):
            row = (rowid, 1, stamp_of(number), scan_cdr(number))
            connection.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", row)
        connection.commit()
        connection.close()

    return Crafted(make, len(rowids))


_PAYLOAD = 103 + 1020 * 8000
"""[bytes] In pages of 1,024 bytes a row of this length has 103 bytes in its leaf, the rest in overflow pages."""


def _overflow(itself: bool) -> Crafted:
    """Rows of 8 MB whose overflow page names itself, or all rows one chain of two pages that name each other."""

    def make(path: Path, random: Random, place: Place) -> None:
        database(path, "page_size = 1024", sweeps=0)
        blob = _PAYLOAD - 8 - 8
        # The header of the row: its length, the key (null), 1, an integer of eight bytes, a blob.
        start = bytes([8, 0, 9, 6]) + raw.varint(12 + 2 * blob) + stamp_of(1).to_bytes(8, "big")
        local = (start + scan_cdr(1))[:103]
        chain = len(path.read_bytes()) // 1024 + 1
        cells = [(rowid, raw.cell(rowid, local, _PAYLOAD, chain)) for rowid in range(1, 3001)]
        after = chain if itself else chain + 1
        pages = {chain: after.to_bytes(4, "big"), chain + 1: chain.to_bytes(4, "big")}
        _grown(path, cells, pages, 1024, chain + 2)

    return Crafted(make)


def _grown(path: Path, cells: list[tuple[int, bytes]], pages: dict[int, bytes], size: int, free: int) -> None:
    """Put the messages' b-tree of these cells behind the file, from page `free` on."""
    level: list[tuple[int, int]] = []
    many = (size - 16) // (max(len(one) for _, one in cells) + 2)
    for first in range(0, len(cells), many):
        part = cells[first : first + many]
        pages[free] = raw.leaf([one for _, one in part], size)
        level.append((free, part[-1][0]))
        free += 1
    while len(level) > 1:
        upper: list[tuple[int, int]] = []
        for first in range(0, len(level), 60):
            pages[free] = raw.interior(level[first : first + 60], size)
            upper.append((free, level[first : first + 60][-1][1]))
            free += 1
        level = upper
    pages[raw.root_of(path, "messages")] = pages[level[0][0]]
    raw.with_pages(path, pages)


def _tree(children: Callable[[int, int], list[tuple[int, int]]]) -> Crafted:
    """The root of the messages is an inner page with children of one's choice: of (root, a sound leaf)."""

    def make(path: Path, random: Random, place: Place) -> None:
        database(path, sweeps=0)
        root = raw.root_of(path, "messages")
        free = len(path.read_bytes()) // 4096 + 1
        cells = [raw.cell(number + 1, raw.record(0, 1, stamp_of(number), scan_cdr(number))) for number in range(SWEEPS)]
        # The key stands in the cell, in the row it is null.
        sound = raw.leaf(cells, 4096)
        raw.with_pages(path, {free: sound, root: raw.interior(children(root, free), 4096)})

    return Crafted(make)


def _text(path: Path, random: Random, place: Place) -> None:
    database(path)
    altered(
        path,
        "UPDATE messages SET data = CAST(hex(data) AS TEXT) WHERE id % 2",
        "UPDATE messages SET timestamp = 'now' WHERE id = 4",
        "UPDATE topics SET name = x'2fff00'",
    )


def _journal(victim: str, lies: int = 0, there: bool = True) -> Crafted:
    """A hot journal that names a victim as its super-journal."""

    def make(path: Path, random: Random, place: Place) -> None:
        database(path)
        name = os.fsencode(place.victims / victim)
        # A name without an absolute path is sought in the folder in which the program runs.
        name = name if there else os.fsencode(os.path.relpath(place.victims / victim, place.root))
        Path(f"{path}-journal").write_bytes(raw.journal_naming(path.read_bytes(), name, lies))

    return Crafted(make)


def _wal(change: Callable[[bytearray], None], suffix: str = "-wal") -> Crafted:
    def make(path: Path, random: Random, place: Place) -> None:
        database(path, "journal_mode = wal", sweeps=SWEEPS // 2)
        rows = [(number + 1, 1, stamp_of(number), scan_cdr(number)) for number in range(5, 10)]
        raw.live_wal(path, "INSERT INTO messages VALUES (?, ?, ?, ?)", rows)
        wal = Path(f"{path}-wal")
        data = bytearray(wal.read_bytes())
        change(data)
        wal.write_bytes(data)

    return Crafted(make)


def _break_frames(wal: bytearray) -> None:
    for at in range(32 + 16, len(wal), 24 + 4096):
        wal[at] ^= 255


def _break_header(wal: bytearray) -> None:
    wal[24] ^= 255


def _other_page_size(wal: bytearray) -> None:
    wal[8:12] = (512).to_bytes(4, "big")


def _great_page(wal: bytearray) -> None:
    """The first frame is of the last page there may be."""
    wal[32:36] = (0xFFFFFFFE).to_bytes(4, "big")
    wal[:] = raw.salted(bytes(wal))


def _sidecar(suffix: str, kind: str, wal: bool = False) -> Crafted:
    """A folder, a pipe, or a link to a victim in the place of a sidecar."""

    def make(path: Path, random: Random, place: Place) -> None:
        database(path, f"journal_mode = {'wal' if wal else 'delete'}")
        _odd(Path(f"{path}{suffix}"), kind, place)

    return Crafted(make, SWEEPS)


def _odd(path: Path, kind: str, place: Place) -> None:
    if kind == "folder":
        path.mkdir()
        (path / "inside").write_bytes(b"inside")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "endless":
        path.symlink_to("/dev/zero")
    else:
        path.symlink_to(place.victims / kind)


def _metadata(kind: str) -> Crafted:
    def make(path: Path, random: Random, place: Place) -> None:
        database(path)
        _odd(path.parent / METADATA, kind, place)

    return Crafted(make, in_folder=True)


KINDS: dict[str, Crafted] = {
    "messages endless": _view("messages", "i id, 1 topic_id, i timestamp, x'00' data"),
    "topics endless": _view("topics", f"i id, 'n' || i name, '{SCAN}' type, 'cdr' serialization_format"),
    "randomblob": _view("messages", "i id, 1 topic_id, i timestamp, randomblob(8000000) data", where="WHERE i < 100000"),
    "zeroblob name": _view(
        "topics",
        f"1 id, hex(zeroblob(250000000)) name, '{SCAN}' type, 'cdr' serialization_format",
        source="WITH r(i) AS (SELECT 1)",
    ),
    "view of itself": _sql(
        "ALTER TABLE messages RENAME TO was_messages",
        "CREATE VIEW messages AS SELECT a.* FROM was_messages a, was_messages b, was_messages c,"
        " was_messages d, was_messages e, was_messages f, was_messages g, was_messages h",
    ),
    "triggers": _sql(
        "CREATE TRIGGER t AFTER INSERT ON messages BEGIN DELETE FROM messages; END",
        "CREATE TRIGGER u AFTER UPDATE ON topics BEGIN DELETE FROM topics; END",
    ),
    "trigger on a view": _sql(
        "CREATE VIEW v AS SELECT * FROM messages", "CREATE TRIGGER w INSTEAD OF DELETE ON v BEGIN DELETE FROM messages; END"
    ),
    "generated virtual": _generated("data BLOB GENERATED ALWAYS AS (zeroblob(800000000)) VIRTUAL"),
    "generated stored": _generated("data BLOB GENERATED ALWAYS AS (zeroblob(300000)) STORED"),
    "generated random": _generated("data BLOB GENERATED ALWAYS AS (hex(zeroblob(id + 200000000))) VIRTUAL"),
    "generated name": Crafted(_generated_name),
    "default huge": _sql("ALTER TABLE messages ADD COLUMN more BLOB DEFAULT (x'00')"),
    "expression index": _sql("CREATE INDEX e ON messages (hex(data))"),
    "check": _sql("CREATE TABLE c (a CHECK (length(hex(zeroblob(200000000))) > 0))", "INSERT INTO c VALUES (1)"),
    "fts5": _sql(
        "ALTER TABLE messages RENAME TO was_messages",
        "CREATE VIRTUAL TABLE messages USING fts5(id, topic_id, timestamp, data)",
        "INSERT INTO messages SELECT * FROM was_messages",
    ),
    "rtree": _sql(
        "ALTER TABLE messages RENAME TO was_messages",
        "CREATE VIRTUAL TABLE messages USING rtree_i32(id, topic_id, timestamp, data, more)",
    ),
    "dbstat": _sql("ALTER TABLE topics RENAME TO was_topics", "CREATE VIRTUAL TABLE topics USING dbstat(main)"),
    "unknown module": _sql(
        "PRAGMA writable_schema = on",
        "INSERT INTO sqlite_master VALUES ('table', 'x', 'x', 0, 'CREATE VIRTUAL TABLE x USING nothing(a)')",
    ),
    "overflow of itself": _overflow(itself=True),
    "overflow in a circle": _overflow(itself=False),
    "tree in a circle": _tree(lambda root, leaf: [(root, 5), (root, 9)]),
    "tree with a loop": _tree(lambda root, leaf: [(leaf, 10), (root, 20), (leaf, 30)]),
    "same child often": _tree(lambda root, leaf: [(leaf, number) for number in range(1, 400)]),
    "child beyond the end": _tree(lambda root, leaf: [(leaf, 10), (2**31 - 1, 20), (0, 30)]),
    "last rows": _rows(1, 2, 2**63 - 2, 2**63 - 1),
    "first rows": _rows(-(2**63), -(2**63) + 1, 1),
    "negative rows": _rows(-5, -4, -1, 0, 3),
    "text for blobs": Crafted(_text),
    **{f"super-journal {victim}": _journal(victim) for victim in VICTIMS},
    "super-journal folder": _journal("folder"),
    "super-journal by relative path": _journal("thesis", there=False),
    "super-journal with a wrong sum": _journal("thesis", lies=1),
    "wal with broken frames": _wal(_break_frames),
    "wal with a broken header": _wal(_break_header),
    "wal of other pages": _wal(_other_page_size),
    "wal of a great page": _wal(_great_page),
    **{
        f"{suffix} is {kind}": _sidecar(suffix, kind, wal)
        for suffix, wal in (("-wal", True), ("-journal", False), ("-shm", True))
        for kind in ("folder", "pipe", "thesis", "thesis.db3")
    },
    **{f"metadata is {kind}": _metadata(kind) for kind in ("pipe", "folder", "thesis", "endless")},
}
