"""`lidarcli clean`: what it tells, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer

import lidarcli as package
from lidarcli.tabular.schemas import CLEANED
from tests.places import SAMPLES
from tests.sweeping import START, STEP, room_sweeps
from tests.text_logs import write_log

Run = Callable[..., Any]
BOX = 30
"""Beams of the second box of `room_sweeps`, which leaves after half of them."""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A round room with a box that stands there, and one that is gone after 40 of 80 sweeps."""
    path = tmp_path / "run.mcap"
    write_log(path, [room_sweeps(count=80)])
    return path


@pytest.mark.slow
def test_what_is_told_and_written(log: Path, tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli(
        "clean", log, "-o", tmp_path / "out.clean.mcap", "--remove", "agents,temporary", "--value", "inf", code=0
    )
    assert ran.err.splitlines() == [
        f"{log}: 80 sweeps; 1,280 of 28,800 beams (4.4%) say inf: agents 0, temporary 1,200, margin 80",
        "  copied   80 messages of 1 topic",
        "  note     inf says that nothing is there: costmaps with inf_is_valid free beams beyond walls",
        f"  wrote    {tmp_path}/out.clean.{{mcap,cleaned.parquet}}",
    ]
    table = pq.read_table(tmp_path / "out.clean.cleaned.parquet")
    assert table.schema.names == CLEANED.names
    assert table["sweep"].to_pylist() == [*range(80)]
    assert table["temporary"].to_pylist() == [BOX] * 40 + [0] * 40
    assert table["log"].unique().to_pylist() == ["run"]
    parameters = json.loads(table.schema.metadata[b"lidarcli.parameters"])
    assert (parameters["remove"], parameters["value"], parameters["margin"]) == (["agents", "temporary"], "inf", 1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "removes"),
    [
        ((), True),
        (("--margin", "2"), True),
        (("--mend",), False),
        (("--mend", "limits"), False),
        (("--start", "0s"), False),
        (("--run", "1"), False),
        (("--mend", "limits", "--remove", "agents"), True),
    ],
)
def test_nobody_is_taken_out_by_another_job(tmp_path: Path, lidarcli: Run, words: tuple[str, ...], removes: bool) -> None:
    log, out = tmp_path / "people.mcap", tmp_path / "out.mcap"
    lidarcli("-q", "simulate", SAMPLES / "people.toml", "-o", log, "--sweeps", 40, code=0)
    lidarcli("clean", log, "-o", out, *words, code=0)
    assert (tmp_path / "out.cleaned.parquet").exists() is removes
    before, after = (sum(int(np.isnan(each.ranges).sum()) for each in package.read(path)) for path in (log, out))
    assert (after > before) is removes


@pytest.mark.slow
def test_clouds_and_other_scans_may_show_the_same(tmp_path: Path, lidarcli: Run) -> None:
    first, second = tmp_path / "run.mcap", tmp_path / "out.mcap"
    with first.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        from lidarcli.ros.messages import cdr_scans, ros2_definition

        ids = {}
        for topic, kind in (("/scan", "LaserScan"), ("/rear", "LaserScan"), ("/points", "PointCloud2")):
            name = f"sensor_msgs/msg/{kind}"
            schema = writer.register_schema(name, "ros2msg", ros2_definition(name).encode())
            ids[topic] = writer.register_channel(topic, "cdr", schema)
        for row, data in enumerate(cdr_scans(room_sweeps(count=30))):
            for topic in ("/scan", "/rear", "/points"):
                writer.add_message(ids[topic], START + row * STEP, data, START + row * STEP)
        writer.finish()  # type: ignore[no-untyped-call]
    ran = lidarcli("clean", first, "-o", second, "--topic", "/scan", code=0)
    assert "copied   90 messages of 3 topics; /points (PointCloud2), /rear (LaserScan) may show the same" in ran.err


def refused(lidarcli: Run, code: int, words: str, *command: object) -> None:
    ran = lidarcli("clean", *command, code=code)
    assert words in ran.err
    assert ran.out == ""


def test_what_cannot_be_cleaned_is_refused_before_any_work(log: Path, tmp_path: Path, lidarcli: Run) -> None:
    text, bag, as_json = tmp_path / "run.csv", tmp_path / "run.bag", tmp_path / "json.mcap"
    write_log(text, [room_sweeps()])
    write_log(bag, [room_sweeps()])
    write_log(as_json, [room_sweeps()], encoding="json")
    before = sorted(each.name for each in tmp_path.iterdir())
    out = tmp_path / "out.mcap"
    refused(lidarcli, 2, "only MCAP and ROS bags can be cleaned", text, "-o", tmp_path / "o.csv")
    refused(lidarcli, 2, "/scan is in JSON, which has no NaN", as_json, "-o", out)
    refused(lidarcli, 2, "has to have the suffix .bag; clean changes no container", bag, "-o", out)
    refused(lidarcli, 2, "is the log that is read", log, "-o", log)
    refused(lidarcli, 2, "no text for standard output", log, "-o", "-")
    refused(lidarcli, 2, "by reading it twice", "-", "-o", out)
    refused(lidarcli, 2, "the robot's own body is what --mask FILE tells", log, "-o", out, "--remove", "body")
    refused(lidarcli, 2, "'people' is not one of agents, temporary", log, "-o", out, "--remove", "people")
    refused(lidarcli, 2, "-1 is below 0", log, "-o", out, "--margin", "-1")
    refused(lidarcli, 2, "neither nan, inf, above nor a number", log, "-o", out, "--value", "far")
    refused(lidarcli, 2, "No such option", log, "-o", out, "--walls")
    refused(lidarcli, 4, "no LaserScan topic /other", log, "-o", out, "--topic", "/other")
    refused(lidarcli, 3, "no such file", tmp_path / "none.mcap", "-o", out)
    refused(lidarcli, 5, "exists; use --overwrite", bag, "-o", _touched(tmp_path / "there.bag"))
    refused(lidarcli, 5, "exists; use --overwrite", bag, "-o", _touched(tmp_path / "x.cleaned.parquet", "x.bag"))
    left = {each.name for each in tmp_path.iterdir()} - {"there.bag", "x.cleaned.parquet"}
    assert sorted(left) == before


def _touched(path: Path, name: str = "") -> Path:
    path.touch()
    return path.with_name(name) if name else path


def test_a_folder_that_holds_more_than_a_bag_is_not_replaced(tmp_path: Path, lidarcli: Run) -> None:
    write_log(tmp_path / "run", [room_sweeps()])
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").touch()
    words = "holds more than a ROS 2 bag"
    refused(lidarcli, 5, words, tmp_path / "run", "-o", tmp_path / "notes", "--overwrite")
    (tmp_path / "link").symlink_to(tmp_path / "run")
    for inside in (tmp_path / "run" / "clean", tmp_path / "link" / "clean"):
        refused(lidarcli, 2, "is the log that is read", tmp_path / "run", "-o", inside)
    (tmp_path / "runs").mkdir()
    (tmp_path / "run").rename(tmp_path / "runs" / "day.mcap")
    (tmp_path / "runs" / "metadata.yaml").write_text("relative_file_paths: [day.mcap]")
    refused(lidarcli, 5, words, tmp_path / "runs" / "day.mcap", "-o", tmp_path / "runs", "--overwrite")
    (tmp_path / "runs" / "day.mcap").rename(tmp_path / "run")
    words = f"run is a ROS 2 bag folder, and clean changes no container: name a folder, e.g. -o {tmp_path / 'out.clean'}\n"
    refused(lidarcli, 2, words, tmp_path / "run", "-o", tmp_path / "out.clean.mcap")
    assert (tmp_path / "notes" / "mine.txt").exists()


@pytest.mark.slow
def test_overwriting_and_a_folder(tmp_path: Path, lidarcli: Run) -> None:
    log, out = tmp_path / "run", tmp_path / "copy"
    write_log(log, [room_sweeps(count=30)])
    for more in ((), ("--overwrite",)):
        assert lidarcli("-q", "clean", log, "-o", out, *more).code == 0
        assert sorted(each.name for each in out.iterdir()) == sorted(each.name for each in log.iterdir())
        assert (out / "metadata.yaml").read_bytes() == (log / "metadata.yaml").read_bytes()
