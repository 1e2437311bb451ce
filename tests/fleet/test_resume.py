"""`--resume` does what is left: the tables tell which logs are done."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.dataset as ds
import pytest

from lidarcli.simulation.writers import write_log
from tests import unprivileged
from tests.conftest import Ran
from tests.fleet.conftest import tables
from tests.sweeping import room_sweeps

CommandLine = Callable[..., Ran]


@pytest.fixture
def done(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> Path:
    """The tables of a run over all logs, one of which is no log and one of which is cut."""
    (bags / "bad.mcap").write_text("nothing")
    data = (bags / "two.mcap").read_bytes()
    (bags / "cut.mcap").write_bytes(data[: len(data) * 2 // 3])
    assert lidarcli("detect", bags, "-o", tmp_path / "out", "--resume").code == 3
    return tmp_path / "out"


def test_only_what_failed_is_done_again(done: Path, bags: Path, lidarcli: CommandLine, small: bytes) -> None:
    before = {path: path.stat().st_mtime_ns for path in done.glob("*.parquet")}
    ran = lidarcli("detect", bags, "-o", done, "--resume")
    assert (ran.code, "8 logs, 2 with errors, 7 done before" in ran.err) == (3, True)
    assert f"{bags}/cut.mcap: " in ran.err
    (bags / "bad.mcap").write_bytes(small)
    (bags / "cut.mcap").write_bytes(small)
    ran = lidarcli("detect", bags, "-o", done, "--resume")
    assert (ran.code, "8 logs, 6 done before" in ran.err) == (0, True)
    after = {path: path.stat().st_mtime_ns for path in done.glob("*.parquet")}
    changed = {path.name for path in after if before.get(path) != after[path]}
    assert changed == {f"{log}.{table}.parquet" for log in ("bad", "cut") for table in ("objects", "sweeps")}


def test_other_parameters_are_another_run(done: Path, bags: Path, lidarcli: CommandLine) -> None:
    ran = lidarcli("detect", bags / "one.mcap", "-o", done, "--resume", "--walls")
    assert (ran.code, "done before" in ran.err) == (0, False)
    ran = lidarcli("detect", bags / "one.mcap", bags / "two.mcap", "-o", done, "--resume", "--walls")
    assert "1 done before" in ran.err


def test_every_table_of_a_log_counts(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    log, out = bags / "one.mcap", tmp_path / "out"
    assert lidarcli("detect", log, "-o", out, "--beams", "--walls").code == 0
    assert lidarcli("detect", log, "-o", out, "--overwrite").code == 0
    assert "done before" not in lidarcli("detect", log, "-o", out, "--beams", "--resume").err
    assert lidarcli("detect", log, "-o", out, "--beams", "--resume").err == "1 log, done before\n"
    (out / "one.sweeps.parquet").unlink()
    assert "done before" not in lidarcli("detect", log, "-o", out, "--resume").err
    assert (out / "one.sweeps.parquet").exists()


def test_a_log_that_is_newer_than_its_tables_is_done_again(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    command = ("detect", bags, "-o", tmp_path / "out", "--resume")
    assert lidarcli(*command).code == 0
    assert "6 done before" in lidarcli(*command).err
    later = (bags / "one.mcap").stat().st_mtime + 1000
    os.utime(bags / "one.mcap", (later, later))
    assert "5 done before" in lidarcli(*command).err


def test_tables_of_another_log_are_not_replaced(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "one.objects.parquet").write_text("mine")
    ran = lidarcli("detect", bags, "-o", out, "--resume")
    assert (ran.code, "exists and is not of this log" in ran.err) == (5, True)
    assert (out / "one.objects.parquet").read_text() == "mine"
    assert (out / "two.objects.parquet").exists()


@pytest.mark.parametrize("layout", ["table", "date"])
def test_tables_in_folders(layout: str, bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    flat, out = tmp_path / "flat", tmp_path / "out"
    assert lidarcli("track", bags, "-o", flat).code == 0
    assert lidarcli("track", bags, "-o", out, "--partition", layout).code == 0
    day = "date=2023-11-14/" if layout == "date" else ""
    names = {name: name.split(".") for name in tables(flat)}
    assert tables(out) == {f"{names[name][1]}/{day}{names[name][0]}.parquet": data for name, data in tables(flat).items()}
    figures = [json.loads(lidarcli("report", each, "--format", "json").out)["figures"] for each in (flat, out)]
    assert figures[0] == figures[1]
    assert lidarcli("track", bags, "-o", out, "--partition", layout).code == 5
    assert "6 done before" in lidarcli("track", bags, "-o", out, "--partition", layout, "--resume").err
    if layout == "date":
        assert "date" in ds.dataset(out / "objects", partitioning="hive").schema.names


def test_files_that_parameters_name_are_older_than_the_tables(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    catalogue = tmp_path / "things.toml"
    catalogue.write_text('[[thing]]\nname = "post"\ndiameter = 0.2\n')
    command = ("detect", bags, "-o", tmp_path / "out", "--resume", "--catalogue", catalogue)
    assert lidarcli(*command).code == 0
    assert "6 done before" in lidarcli(*command).err
    later = catalogue.stat().st_mtime + 1000
    os.utime(catalogue, (later, later))
    assert "done before" not in lidarcli(*command).err
    catalogue.unlink()
    ran = lidarcli(*command)
    assert (ran.code, len(ran.err.splitlines())) == (3, 1)


def test_a_log_that_has_another_day_now_is_there_once(tmp_path: Path, lidarcli: CommandLine) -> None:
    def log(first: int) -> None:
        sweeps = replace(room_sweeps(count=5), stamp_ns=np.arange(5) * 10**8 + first * 10**9)
        (tmp_path / "run.mcap").unlink(missing_ok=True)
        write_log(tmp_path / "run.mcap", [sweeps])

    command = ("detect", tmp_path / "run.mcap", "-o", tmp_path / "out", "--partition", "date", "--resume")
    for first in (1_700_000_000, 1_710_000_000):
        log(first)
        assert lidarcli(*command).code == 0
    days = {path.parent.name for path in (tmp_path / "out").rglob("run.parquet")}
    assert days == {"date=2024-03-09"}
    # Without --resume or --overwrite it may be another log of the same name.
    log(1_720_000_000)
    ran = lidarcli(*command[:-1])
    assert (ran.code, "date=2024-03-09/run.parquet exists; use --overwrite" in ran.err) == (5, True)
    assert {path.parent.name for path in (tmp_path / "out").rglob("run.parquet")} == days


@pytest.mark.slow
@pytest.mark.parametrize("more", [("--resume",), ("--resume", "--partition", "date"), ("--dry-run",)])
def test_a_folder_that_may_not_be_looked_into_is_one_line(more: tuple[str, ...], bags: Path, tmp_path: Path) -> None:
    shut = tmp_path / "shut"
    shut.mkdir()
    shut.chmod(0o000)
    code, err = unprivileged.lidarcli("detect", bags / "one.mcap", "-o", shut, *more)
    shut.chmod(0o700)
    assert "Traceback" not in err
    assert code == (0 if more == ("--dry-run",) else 5)
    assert len(err.splitlines()) == (0 if more == ("--dry-run",) else 1)
    assert [*shut.iterdir()] == []
