"""Runs that go on where others have ended."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
import pytest

from lidarcli import __version__
from lidarcli.pipeline.runs.manifest import read_entries
from lidarcli.simulation.writers import write_log
from lidarcli.tabular.reading import read_schema
from lidarcli.tabular.schemas import RUNS
from tests import unprivileged
from tests.conftest import Ran
from tests.fleet.conftest import tables
from tests.places import SAMPLES
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


def test_the_manifest_tells_of_every_log(done: Path, bags: Path) -> None:
    entries, problems = read_entries(done)
    assert problems == []
    by_log = {entry.log: entry for entry in entries}
    assert sorted(by_log) == ["a/run", "b/run", "bad", "cut", "four", "one", "three", "two"]
    one, bad, cut = by_log["one"], by_log["bad"], by_log["cut"]
    stat = (bags / "one.mcap").stat()
    assert (one.url, one.size, one.mtime) == (str(bags / "one.mcap"), stat.st_size, stat.st_mtime_ns)
    assert (one.outcome, one.exit_code, one.message, one.version) == ("ok", 0, None, __version__)
    assert one.outputs == [str(done / "one.objects.parquet"), str(done / "one.sweeps.parquet")]
    assert one.sweeps == 5
    objects = ds.dataset(done / "one.objects.parquet").count_rows()
    assert one.rows == objects + 5
    assert (bad.outcome, bad.exit_code, bad.rows, bad.outputs) == ("failed", 3, None, [])
    assert bad.message is not None
    assert "nothing" in bad.message
    assert (cut.outcome, cut.exit_code) == ("damaged", 3)


def test_only_what_failed_is_done_again(done: Path, bags: Path, lidarcli: CommandLine, small: bytes) -> None:
    before = {path: path.stat().st_mtime_ns for path in done.glob("*.parquet")}
    ran = lidarcli("-v", "detect", bags, "-o", done, "--resume")
    assert ran.code == 3
    assert "8 logs, 2 with errors, 7 done before" in ran.err
    assert f"{bags}/cut.mcap: " in ran.err
    (bags / "bad.mcap").write_bytes(small)
    (bags / "cut.mcap").write_bytes(small)
    ran = lidarcli("detect", bags, "-o", done, "--resume")
    assert ran.code == 0
    assert "8 logs, 6 done before" in ran.err
    after = {path: path.stat().st_mtime_ns for path in done.glob("*.parquet")}
    changed = {path.name for path in after if before.get(path) != after[path]}
    assert changed == {f"{log}.{table}.parquet" for log in ("bad", "cut") for table in ("objects", "sweeps")}


def test_other_parameters_are_another_run(done: Path, bags: Path, lidarcli: CommandLine) -> None:
    ran = lidarcli("detect", bags / "one.mcap", "-o", done, "--resume", "--walls")
    assert (ran.code, "done before" in ran.err) == (0, False)
    ran = lidarcli("detect", bags / "one.mcap", bags / "two.mcap", "-o", done, "--resume", "--walls")
    assert "1 done before" in ran.err


def test_tables_that_are_gone_are_written_again(done: Path, bags: Path, lidarcli: CommandLine) -> None:
    (done / "one.sweeps.parquet").unlink()
    assert "5 logs" not in lidarcli("detect", bags / "one.mcap", "-o", done, "--resume").err
    assert (done / "one.sweeps.parquet").exists()


def test_without_a_manifest_the_tables_tell(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    out = tmp_path / "out"
    assert lidarcli("detect", bags, "-o", out).code == 0
    assert not (out / "_lidarcli").exists()
    ran = lidarcli("detect", bags, "-o", out, "--resume")
    assert (ran.code, "6 done before" in ran.err) == (0, True)
    later = (bags / "one.mcap").stat().st_mtime + 1000
    os.utime(bags / "one.mcap", (later, later))
    assert "5 done before" in lidarcli("detect", bags, "-o", out, "--resume").err


def test_tables_of_another_log_are_not_replaced(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "one.objects.parquet").write_text("mine")
    ran = lidarcli("detect", bags, "-o", out, "--resume")
    assert ran.code == 5
    assert "exists and is not of this log" in ran.err
    assert (out / "one.objects.parquet").read_text() == "mine"
    assert (out / "two.objects.parquet").exists()


def test_runs_at_the_same_time_have_manifests_of_their_own(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    for number in (1, 2, 3):
        assert lidarcli("detect", bags, "-o", tmp_path / "out", "--shard", f"{number}/3").code == 0
    entries, _ = read_entries(tmp_path / "out")
    assert sorted(entry.log for entry in entries) == ["a/run", "b/run", "four", "one", "three", "two"]
    assert "6 done before" in lidarcli("detect", bags, "-o", tmp_path / "out", "--resume").err


def test_a_broken_manifest_is_told_of_and_not_used(done: Path, bags: Path, lidarcli: CommandLine) -> None:
    (done / "_lidarcli" / "run-x.parquet").write_text("nothing")
    ran = lidarcli("detect", bags / "one.mcap", bags / "two.mcap", "-o", done, "--resume")
    assert ran.code == 0
    assert "run-x.parquet: cannot be read as Parquet" in ran.err
    assert "2 done before" in ran.err


@pytest.mark.parametrize("layout", ["table", "date"])
def test_tables_in_folders(layout: str, bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    flat, out = tmp_path / "flat", tmp_path / "out"
    assert lidarcli("track", bags, "-o", flat).code == 0
    assert lidarcli("track", bags, "-o", out, "--partition", layout).code == 0
    day = "date=2023-11-14/" if layout == "date" else ""
    found = tables(out)
    assert found == {f"{name.split('.')[1]}/{day}{name.split('.')[0]}.parquet": data for name, data in tables(flat).items()}
    figures = [json.loads(lidarcli("report", each, "--format", "json").out)["figures"] for each in (flat, out)]
    assert figures[0] == figures[1]
    assert lidarcli("track", bags, "-o", out, "--partition", layout).code == 5
    assert "6 done before" in lidarcli("track", bags, "-o", out, "--partition", layout, "--resume").err
    if layout == "date":
        dataset = ds.dataset(out / "objects", partitioning="hive")
        assert "date" in dataset.schema.names


def test_tables_that_another_run_has_replaced_are_not_taken_for_those(
    done: Path, bags: Path, lidarcli: CommandLine
) -> None:
    log = bags / "one.mcap"
    wanted = (done / "one.objects.parquet").read_bytes()
    assert lidarcli("detect", log, "-o", done, "--overwrite", "--walls").code == 0
    assert (done / "one.objects.parquet").read_bytes() != wanted
    assert "done before" not in lidarcli("detect", log, "-o", done, "--resume").err
    assert (done / "one.objects.parquet").read_bytes() == wanted
    assert lidarcli("detect", log, "-o", done, "--overwrite").code == 0
    assert "1 log, done before" in lidarcli("detect", log, "-o", done, "--resume").err


def test_files_that_parameters_name_count_by_their_content(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    catalogue = tmp_path / "things.toml"
    catalogue.write_text('[[thing]]\nname = "post"\ndiameter = 0.2\n')
    command = ("detect", bags, "-o", tmp_path / "out", "--resume", "--catalogue", catalogue)
    assert lidarcli(*command).code == 0
    os.utime(catalogue, (1, 1))
    assert "6 done before" in lidarcli(*command).err
    catalogue.write_text('[[thing]]\nname = "post"\ndiameter = 0.3\n')
    assert "done before" not in lidarcli(*command).err


def test_tables_that_were_destroyed_are_written_again(done: Path, bags: Path, lidarcli: CommandLine) -> None:
    table = done / "one.objects.parquet"
    wanted = table.read_bytes()
    table.write_bytes(b"")
    ran = lidarcli("detect", bags / "one.mcap", "-o", done, "--resume")
    assert (ran.code, "done before" in ran.err) == (0, False)
    assert table.read_bytes() == wanted


def test_names_that_are_no_text_are_done_once(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    (bags / "one.mcap").rename(bags / "caf\udce9.mcap")
    assert lidarcli("detect", bags, "-o", tmp_path / "out", "--resume").code == 0
    entries, _ = read_entries(tmp_path / "out")
    assert f"{bags}/caf\udce9.mcap" in {entry.url for entry in entries}
    assert "6 done before" in lidarcli("detect", bags, "-o", tmp_path / "out", "--resume").err


def test_a_log_that_has_another_day_now_is_there_once(tmp_path: Path, lidarcli: CommandLine) -> None:
    def log(first: int) -> None:
        sweeps = replace(room_sweeps(count=5), stamp_ns=np.arange(5) * 10**8 + first * 10**9)
        (tmp_path / "run.mcap").unlink(missing_ok=True)
        write_log(tmp_path / "run.mcap", [sweeps])

    command = ("detect", tmp_path / "run.mcap", "-o", tmp_path / "out", "--partition", "date", "--resume")
    log(1_700_000_000)
    assert lidarcli(*command).code == 0
    log(1_710_000_000)
    assert lidarcli(*command).code == 0
    days = {path.parent.name for path in (tmp_path / "out").rglob("run.parquet")}
    assert days == {"date=2024-03-09"}
    # Without --resume or --overwrite it may be another log of the same name.
    log(1_720_000_000)
    ran = lidarcli(*command[:-1])
    assert (ran.code, "date=2024-03-09/run.parquet exists; use --overwrite" in ran.err) == (5, True)
    assert {path.parent.name for path in (tmp_path / "out").rglob("run.parquet")} == days


def test_a_bag_in_a_folder_is_told_by_its_tables(tmp_path: Path, lidarcli: CommandLine) -> None:
    bag = tmp_path / "hall"
    shutil.copytree(SAMPLES / "hall", bag)
    assert lidarcli("detect", bag, "-o", tmp_path / "out").code == 0
    assert "1 log, done before" in lidarcli("detect", bag, "-o", tmp_path / "out", "--resume").err


def test_a_file_that_parameters_name_and_is_not_there_is_one_line(
    bags: Path, tmp_path: Path, lidarcli: CommandLine
) -> None:
    for more in ((), ("--resume",)):
        ran = lidarcli("detect", bags / "one.mcap", "-o", tmp_path / "out", "--poses", tmp_path / "none", *more)
        assert ran.code == 3
        assert "none: " in ran.err
        assert len(ran.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"outputs": [None], "output_sizes": [1]}, "column outputs holds an empty name"),
        ({"exit_code": 300}, "column exit_code holds 300, which a log that is ok has not"),
        ({"outcome": "fine"}, "column outcome holds 'fine'"),
    ],
)
def test_a_manifest_with_odd_values_is_not_used(
    change: dict[str, object], cause: str, done: Path, bags: Path, lidarcli: CommandLine
) -> None:
    (file,) = (done / "_lidarcli").iterdir()
    rows = [{**row, **change} for row in pq.read_table(file).to_pylist()]
    pq.write_table(pa.Table.from_pylist(rows, read_schema(RUNS)), file)
    ran = lidarcli("detect", bags / "one.mcap", "-o", done, "--resume")
    assert ran.code == 0, ran.err
    assert f"{file}: {cause}" in ran.err
    assert "1 log, done before" in ran.err


def test_a_place_where_no_manifest_can_be_is_told_before_the_work(
    bags: Path, tmp_path: Path, lidarcli: CommandLine
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "_lidarcli").touch()
    ran = lidarcli("detect", bags, "-o", tmp_path / "out", "--resume")
    assert (ran.code, len(ran.err.splitlines())) == (5, 1)
    assert [*(tmp_path / "out").glob("*.parquet")] == []


def test_tables_of_other_options_that_stay_are_told_of(bags: Path, tmp_path: Path, lidarcli: CommandLine) -> None:
    log, out = bags / "one.mcap", tmp_path / "out"
    assert lidarcli("track", log, "-o", out, "--resume").code == 0
    ran = lidarcli("detect", log, "-o", out, "--resume")
    assert ran.code == 0
    assert f"note     {out}/one.tracks.parquet is of an earlier run with other options" in ran.err
    assert lidarcli("detect", log, "-o", out, "--resume").err == "1 log, done before\n"


@pytest.mark.slow
@pytest.mark.parametrize("more", [("--resume",), ("--resume", "--partition", "date"), ("--dry-run",)])
def test_a_folder_that_may_not_be_looked_into_is_one_line(more: tuple[str, ...], bags: Path, tmp_path: Path) -> None:
    shut = tmp_path / "shut"
    shut.mkdir()
    shut.chmod(0o000)
    code, err = unprivileged.lidarcli("detect", bags / "one.mcap", "-o", shut, *more)
    shut.chmod(0o700)
    assert "Traceback" not in err
    assert code == (0 if more == ("--dry-run",) else 3)
    assert len(err.splitlines()) == (0 if more == ("--dry-run",) else 1)
    assert [*shut.iterdir()] == []


def hostile(out: Path, **change: object) -> None:
    """Let the one manifest say something else of `one`."""
    (file,) = (out / "_lidarcli").iterdir()
    rows = [
        {**row, **(change if row["log"] == "one" else {}), "ended": row["ended"]} for row in pq.read_table(file).to_pylist()
    ]
    pq.write_table(pa.Table.from_pylist(rows, RUNS), file)


@pytest.mark.parametrize(
    "outputs",
    [
        [],
        ["/etc/passwd"],
        ["/etc/passwd", "{out}/one.sweeps.parquet"],
        ["{out}/one.objects.parquet"],
        ["{out}/two.objects.parquet", "{out}/two.sweeps.parquet"],
        ["{out}/../out/one.objects.parquet", "{out}/one.sweeps.parquet"],
        ["s3://b/x?endpoint_override=127.0.0.1:1&scheme=http", "{out}/one.sweeps.parquet"],
        ["https://host/x", "s3://AK:SK@b/x"],
    ],
)
def test_a_manifest_is_believed_of_the_tables_of_the_log_alone(
    outputs: list[str], bags: Path, tmp_path: Path, lidarcli: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    out, log = tmp_path / "out", bags / "one.mcap"
    assert lidarcli("detect", log, "-o", out, "--resume").code == 0
    names = [name.format(out=out) for name in outputs]
    sizes = [os.path.getsize(name) if os.path.exists(name) else 1 for name in names]  # noqa: PTH110, PTH202
    hostile(out, outputs=names, output_sizes=sizes)

    def asked(*_: object) -> None:
        raise AssertionError("a store is asked")

    monkeypatch.setattr("lidarcli.stores.url.head", asked)
    ran = lidarcli("detect", log, "-o", out, "--resume")
    assert (ran.code, "done before" in ran.err) == (0, False)
    assert all("/etc" not in line and "://" not in line for line in ran.err.splitlines())
    assert "1 log, done before" in lidarcli("detect", log, "-o", out, "--resume").err


@pytest.mark.parametrize("layout", [(), ("--partition", "date")])
def test_logs_that_their_tables_tell_of_are_in_the_manifest(
    layout: tuple[str, ...], bags: Path, tmp_path: Path, lidarcli: CommandLine
) -> None:
    out = tmp_path / "out"
    (bags / "bad.mcap").write_text("nothing")
    assert lidarcli("detect", bags, "-o", out, *layout).code == 3
    if layout:
        (manifest,) = (out / "_lidarcli").iterdir()
        manifest.unlink()
    assert lidarcli("detect", bags, "-o", out, *layout, "--resume").code == 3
    entries, _ = read_entries(out)
    outcomes = {entry.log: entry.outcome for entry in entries}
    good = {"a/run", "b/run", "four", "one", "three", "two"}
    assert outcomes == {**dict.fromkeys(good, "ok"), "bad": "failed"}
    assert all(len(entry.outputs) == len(entry.output_sizes) == 2 for entry in entries if entry.is_done)
    ran = lidarcli("report", out / "_lidarcli", "--check", "ok == 6", "--check", "failed == 1")
    assert ran.code == 0, ran.out
