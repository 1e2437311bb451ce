"""Every target of the fuzzer, a bounded number of cases each; `make fuzz` runs as many as one likes."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path
from typing import IO

import pytest

from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from tests.waiting import HANG
from tools.fuzz import run
from tools.fuzz.containers import CONTAINERS
from tools.fuzz.databases import KINDS
from tools.fuzz.libraries import LIBRARY_LOGS, SWEEPS, library_sample, stamp_of
from tools.fuzz.place import VICTIMS, Place, snapshot
from tools.fuzz.run import Case, Plan, fuzz
from tools.fuzz.targets import TARGETS

pytestmark = pytest.mark.whole

GROUPS: dict[str, tuple[tuple[str, ...], int]] = {
    **{
        group: (tuple(name for name in CONTAINERS if name.split("-")[0] in group.split("/")), 6)
        for group in ("mcap", "bag/db3/ros2", "csv", "carmen", "rplidar", "jsonl", "clouds")
    },
    "libraries": (LIBRARY_LOGS, 4),
    "databases": (("db3-crafted",), len(KINDS) + 10),
    "hostile logs": (("logs-crafted",), 8),
    "geometry": (("geometry",), 50),
    "texts": (("metadata", "scenes", "checks", "numbers"), 20),
    "counts": (("counts",), 30),
    "maps": (("maps", "poses-map"), 40),
    "masks": (("masks",), 25),
    "diff": (("diff",), 30),
    "zones": (("zones-toml", "zones-yaml"), 15),
    "copies": (("clean", "clean-mend"), 25),
    "copies of databases": (("clean-db3",), len(KINDS) + 5),
    "parts and merged": (("clips", "merge"), 30),
    "trajectories": (("trajectories",), 25),
    "tables": (("tables", "baseline"), 10),
    "names of tables": (("table-names",), 7),
    "settings": (("settings",), 20),
    "links": (("links",), 35),
    "two at once": (("twice",), 1),
}
"""Targets, and cases of each: what is known to have found something, and a few more."""


def test_every_target_is_in_a_group() -> None:
    assert sorted(name for names, _ in GROUPS.values() for name in names) == sorted(TARGETS)


@pytest.fixture(autouse=True)
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """How long a case takes is judged by `make fuzz`, on a machine that does nothing else."""
    monkeypatch.setenv("FUZZ_SECONDS", "60")
    for limit in ("WALL", "SETUP"):
        monkeypatch.setattr(run, limit, HANG)


@pytest.mark.parametrize("group", GROUPS)
def test_any_mutation_ends_in_tables_or_one_line(group: str) -> None:
    """No error but the project's own, no hang, no memory beyond the bound, no file touched or left (judge.py)."""
    names, cases = GROUPS[group]
    done, failures = fuzz(Plan(names, seed=1, cases=cases))
    assert failures == []
    assert done == cases * len(names)


def test_a_case_is_the_same_every_time(tmp_path: Path) -> None:
    place = Place(tmp_path / "case")
    for target in TARGETS.values():
        found = []
        for _ in range(2):
            Case(target.name, 5, target.known + 3).write(place)
            found.append(
                {
                    f"{folder.name}/{name}": (mode, size, content)
                    for folder in (place.input, place.out, place.victims)
                    for name, (mode, size, _, content) in snapshot(folder).items()
                }
            )
        assert found[0] == found[1], target.name
        assert {f"victims/{name}" for name in VICTIMS} <= found[0].keys()


@pytest.mark.parametrize("name", LIBRARY_LOGS)
def test_logs_of_libraries_are_read_whole_as_they_are(name: str, tmp_path: Path) -> None:
    sample = library_sample(name)
    for file, data in sample.files.items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes(data)
    with open_log(tmp_path / sample.log) as log:
        sweeps = sum(len(block) for block in log.scans(None, ReadReport()))
        assert sweeps == (7 if name == "db3-by-sqlite-deleted" else SWEEPS)


@pytest.mark.parametrize("name", ["db3-by-sqlite-wal", "db3-by-sqlite-journal"])
def test_sidecars_are_as_a_killed_writer_leaves_them(name: str, tmp_path: Path) -> None:
    """SQLite itself takes the rows of the -wal, and takes back those that were not committed."""
    files = library_sample(name).files
    assert len(files) == 2
    for file, data in files.items():
        (tmp_path / file).write_bytes(data)
    stamps = "SELECT timestamp FROM messages ORDER BY id"
    database = sqlite3.connect(tmp_path / "run.db3")
    assert [stamp for (stamp,) in database.execute(stamps)] == list(map(stamp_of, range(SWEEPS)))
    database.close()
    (tmp_path / "alone.db3").write_bytes(files["run.db3"])
    database = sqlite3.connect(f"file:{tmp_path / 'alone.db3'}?immutable=1", uri=True)
    assert [stamp for (stamp,) in database.execute(stamps)] != list(map(stamp_of, range(SWEEPS)))
    database.close()


def test_a_journal_that_names_a_victim_makes_sqlite_delete_it(tmp_path: Path) -> None:
    """Otherwise the case of that name would find nothing."""
    place = Place(tmp_path / "case")
    Case("db3-crafted", 1, list(KINDS).index("super-journal thesis")).write(place)
    shutil.copytree(place.input, tmp_path / "copy")
    database = sqlite3.connect(tmp_path / "copy" / "run.db3")
    database.execute("SELECT count(*) FROM messages").fetchone()
    database.close()
    assert not (place.victims / "thesis").exists()


_KEPT: list[IO[str]] = []
