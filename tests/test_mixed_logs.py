"""Logs as robots leave them, from end to end: mixed topics and publishers, odd clocks, odd sweeps, odd folders."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.cli import run
from lidarcli.logs.mcap import McapLog
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import RawSweeps
from tests.sweeping import START, STEP, raw_sweeps, round_room

YEAR = 365 * 86400 * 10**9
CONTAINERS = ("run.mcap", "run.bag", "run.db3")


def block(sweeps: int = 6, beams: int = 90, **changes: Any) -> RawSweeps:
    """Sweeps of a part of the round room with a box in it, at 10 Hz."""
    ranges = round_room(sweeps, beams, (10, 20, 2.0))
    return raw_sweeps(**{"ranges": ranges, "angle_min": -1.0, "angle_increment": 0.0125, **changes})


@pytest.fixture
def detect(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, Any]]:
    """Run `detect`; its exit code, what it said, and the rows of a table."""

    def call(*arguments: object, table: str = "sweeps") -> tuple[int, str, list[dict[str, Any]]]:
        out = tmp_path / "tables"
        shutil.rmtree(out, ignore_errors=True)
        code = run(["-q", "detect", *map(str, arguments), "-o", str(out)])
        files = sorted(out.rglob(f"*.{table}.parquet")) if out.exists() else []
        return code, capfd.readouterr().err, [row for file in files for row in rows_of(file)]

    return call


def rows_of(file: Path) -> list[dict[str, Any]]:
    """The rows of a table, stamps in nanoseconds."""
    table = pq.read_table(file)
    if "stamp" in table.column_names:
        index = table.column_names.index("stamp")
        table = table.set_column(index, "stamp", table["stamp"].cast(pa.int64()))
    rows: list[dict[str, Any]] = table.to_pylist()
    return rows


@pytest.fixture
def info(capfd: pytest.CaptureFixture[str]) -> Callable[..., dict[str, Any]]:
    """What `info` tells of one log."""

    def call(path: Path) -> dict[str, Any]:
        run(["info", str(path), "--format", "json"])
        (told,) = json.loads(capfd.readouterr().out)
        return dict(told)

    return call


# Mixed topics and publishers.


def two_publishers(sweeps: int = 12) -> RawSweeps:
    """On one topic, in turns: a scanner with a wall clock, and one upside down with a clock that started at 0."""
    second = np.arange(sweeps) % 2 == 1
    mixed = block(sweeps, 90)
    ranges = mixed.ranges.copy()
    ranges[second] = 3.0
    ranges[second, 30:40] = 1.0
    return replace(
        mixed,
        frame_ids=("front", "rear"),
        frame=second.astype(np.int32),
        stamp_ns=np.where(second, 5_000_000_000 + STEP * np.arange(sweeps), mixed.stamp_ns),
        record_ns=mixed.record_ns,
        angle_min=np.where(second, 1.5, -1.0),
        angle_increment=np.where(second, -0.0625, 0.0125),
        range_max=np.where(second, 5.0, 12.0).astype(np.float32),
        beams=np.where(second, 48, 90).astype(np.int32),
        ranges=ranges,
    )


@pytest.mark.slow
def test_more_topics_than_any_robot_has(tmp_path: Path, detect: Callable[..., Any]) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, [block(sweeps=1, beams=20, topic=f"/scan_{number}") for number in range(1030)])
    code, err, rows = detect(path)
    assert (code, len(rows), len({row["topic"] for row in rows})) == (3, 1000, 1000)
    assert err == (
        f"lidarcli: {path}: topics: 30 sweeps of 30 LaserScan topics are not read: the log has more than 1,000; "
        "name some of them with --topic\n"
    )
    code, err, rows = detect(path, "--topic", "/scan_1029")
    assert (code, err, [row["topic"] for row in rows]) == (0, "", ["/scan_1029"])


@pytest.mark.parametrize("name", CONTAINERS)
def test_two_publishers_on_one_topic(name: str, tmp_path: Path, detect: Any, info: Any) -> None:
    write_log(tmp_path / name, [two_publishers()])
    code, err, rows = detect(tmp_path / name)
    assert (code, err) == (0, "")
    assert [(row["sweep"], row["frame_id"], row["beams"]) for row in rows] == [
        (k, *(("rear", 48) if k % 2 else ("front", 90))) for k in range(12)
    ]
    assert [row["stamp"] for row in rows] == two_publishers().stamp_ns.tolist()
    _, _, objects = detect(tmp_path / name, "--min-thing", "0.5", table="objects")
    assert {(row["frame_id"], row["beam_i"], row["beam_f"], round(row["theta_i"], 4)) for row in objects} == {
        ("front", 10, 19, -0.875),
        ("rear", 30, 39, round(1.5 - 39 * 0.0625, 4)),
    }
    front, rear = info(tmp_path / name)["scans"]
    assert (front["frame_id"], front["sweeps"], front["beams"], front["range_max"]) == (
        "front", 6, [90, 90], [12.0, 12.0],
    )  # fmt: skip
    assert (rear["frame_id"], rear["sweeps"], rear["beams"], rear["range_max"]) == (
        "rear", 6, [48, 48], [5.0, 5.0],
    )  # fmt: skip
    assert rear["angle_increment"] == [-0.0625, -0.0625]
    assert [scan["clock"]["monotonic"] for scan in (front, rear)] == [True, True]
    assert [scan["rate"] for scan in (front, rear)] == [pytest.approx(5.0)] * 2
    assert front["clock"]["record_minus_header"] == 0.0
    assert rear["clock"]["record_minus_header"] == pytest.approx((START - 5_000_000_000) / 1e9)


@pytest.mark.parametrize("name", CONTAINERS)
def test_the_first_sweep_is_that_of_each_publisher(name: str, tmp_path: Path, detect: Any) -> None:
    write_log(tmp_path / name, [two_publishers()])
    _, _, rows = detect(tmp_path / name, "--start", 0.35, "--end", 0.85)
    assert [row["sweep"] for row in rows] == [4, 5, 6, 7, 8, 9]


def test_several_topics_in_one_pass(tmp_path: Path, detect: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = [
        block(2, topic=topic, stamp_ns=START + STEP * np.arange(k, k + 2))
        for k in (0, 2, 4)
        for topic in ("/front", "/left", "/rear")
    ]
    write_log(tmp_path / "run.mcap", parts, chunk_size=500)
    passes = []
    scans = McapLog.scans
    monkeypatch.setattr(McapLog, "scans", lambda log, topics, report: passes.append(topics) or scans(log, topics, report))
    code, _, rows = detect(tmp_path / "run.mcap")
    assert (code, len(passes)) == (0, 1)
    assert [(row["topic"], row["sweep"]) for row in rows] == [
        (topic, sweep) for topic in ("/front", "/left", "/rear") for sweep in range(6)
    ]


@pytest.mark.parametrize("asked", ["/scan", "scan"])
@pytest.mark.parametrize("topic", ["/scan", "scan"])
@pytest.mark.parametrize("name", CONTAINERS)
def test_a_topic_without_a_leading_slash(name: str, topic: str, asked: str, tmp_path: Path, detect: Any) -> None:
    write_log(tmp_path / name, [block(topic=topic)])
    code, err, rows = detect(tmp_path / name, "--topic", asked)
    assert (code, err, [row["topic"] for row in rows]) == (0, "", [topic] * 6)


@pytest.mark.parametrize("name", CONTAINERS)
def test_geometry_that_changes_from_sweep_to_sweep(name: str, tmp_path: Path, detect: Any, info: Any) -> None:
    """As real sensors do it: each turn has its own number of beams, hence its own increment."""
    beams = np.array([452, 456, 453, 719, 706, 455], np.int32)
    ranges = np.full((6, 719), 4.0, np.float32)
    for row, count in enumerate(beams):
        ranges[row, count // 4 : count // 4 + 20] = 2.0
    increment = (2 * np.pi / beams).astype(np.float32).astype(float)
    changes = {"beams": beams, "angle_increment": increment, "angle_min": np.full(6, -np.pi), "ranges": ranges}
    raw = replace(block(6), **changes)
    write_log(tmp_path / name, [raw])
    code, _, rows = detect(tmp_path / name, table="objects")
    assert code == 0
    assert [(row["beam_i"], row["beam_f"]) for row in rows] == [(n // 4, n // 4 + 19) for n in beams.tolist()]
    assert [row["theta_i"] for row in rows] == pytest.approx(-np.pi + (beams // 4) * increment, abs=1e-6)
    (scan,) = info(tmp_path / name)["scans"]
    assert (scan["beams"], scan["closure"]) == ([452, 719], ["closed"])
    assert scan["angle_increment"] == pytest.approx([increment.min(), increment.max()])


@pytest.mark.parametrize("name", CONTAINERS)
def test_bad_sweeps_are_counted_and_the_others_kept(name: str, tmp_path: Path, detect: Any) -> None:
    raw = block(8)
    raw.angle_min[1] = np.nan
    raw.angle_increment[3] = np.inf
    raw.angle_increment[5] = 0.0
    raw.angle_increment[6] *= -1
    raw.range_max[7] = np.nan
    write_log(tmp_path / name, [raw])
    code, err, rows = detect(tmp_path / name)
    assert code == 3
    path = tmp_path / name
    assert err.splitlines() == [
        f"lidarcli: {path}: topic /scan: 1 message left out: angle_increment is not finite",
        f"lidarcli: {path}: topic /scan: 1 message left out: angle_increment is zero",
        f"lidarcli: {path}: topic /scan: 1 message left out: angle_min is not finite",
    ]
    kept = [0, 2, 4, 6, 7]
    assert [row["stamp"] for row in rows] == raw.stamp_ns[kept].tolist()
    assert [row["sweep"] for row in rows] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("name", CONTAINERS)
def test_empty_sweeps_are_sweeps(name: str, tmp_path: Path, detect: Any) -> None:
    raw = block(4, beams=90)
    raw.beams[:] = [90, 0, 1, 90]
    write_log(tmp_path / name, [raw])
    code, err, rows = detect(tmp_path / name, "--min-thing", "0.5")
    assert (code, err) == (0, "")
    assert [(row["beams"], row["valid"], row["objects"]) for row in rows] == [
        (90, 90, 1),
        (0, 0, 0),
        (1, 1, 0),
        (90, 90, 1),
    ]


@pytest.mark.parametrize("name", CONTAINERS)
def test_a_hundred_thousand_beams(name: str, tmp_path: Path, detect: Any) -> None:
    beams = 100_000
    wide = block(3, beams, angle_increment=np.full(3, 2e-5))
    wide.ranges[:, 50_000:60_000] = 1.0
    write_log(tmp_path / name, [block(3), wide, block(3)])
    code, _, rows = detect(tmp_path / name, "--max-width", "9")
    assert code == 0
    assert [row["beams"] for row in rows] == [90] * 3 + [beams] * 3 + [90] * 3
    assert all(row["object_beams"] + row["agent_beams"] + row["noise_beams"] == row["beams"] for row in rows)


@pytest.mark.parametrize(
    ("stamps", "records", "said"),
    [
        (np.zeros(6), START + STEP * np.arange(6), "all are zero; the times of the recording are taken"),
        (
            START - YEAR + STEP * np.arange(6),
            START + np.arange(6) * 50_000,
            "increasing; recorded 31535999.750 s after the header stamp",
        ),
        (
            START + np.array([0, 1, 2, -3, -2, -1]) * STEP,
            START + STEP * np.arange(6),
            "go back once, by 0.500 s; recorded 0.300 s after the header stamp",
        ),
        (
            START + STEP * np.arange(6) + 130 * 10**9,
            START + STEP * np.arange(6),
            "increasing; recorded 130.000 s before the header stamp",
        ),
    ],
    ids=["zero", "a-year-off", "backward", "ahead"],
)
@pytest.mark.parametrize("name", CONTAINERS)
def test_clocks(
    name: str, stamps: Any, records: Any, said: str, tmp_path: Path, detect: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    """Sweeps stay in the order of the log, and the header's stamp is what the tables carry, unless there is none."""
    stamps, records = stamps.astype(np.int64), records.astype(np.int64)
    raw = block(6, stamp_ns=stamps, record_ns=records)
    raw.ranges[:, 50] = np.arange(1, 7)
    write_log(tmp_path / name, [raw])
    code, err, rows = detect(tmp_path / name, "--beams", table="beams")
    assert (code, err) == (0, "")
    assert [row["r"] for row in rows if row["beam"] == 50] == [1, 2, 3, 4, 5, 6]
    _, _, rows = detect(tmp_path / name)
    known = np.where(stamps == 0, records, stamps)
    assert [row["stamp"] for row in rows] == known.tolist()
    run(["info", str(tmp_path / name)])
    (line,) = [line for line in capfd.readouterr().out.splitlines() if line.startswith("    stamps")]
    assert line.split(maxsplit=1)[1] == said
    first = (known - known[0]) / 1e9
    _, _, rows = detect(tmp_path / name, "--start", 0.15, "--end", 0.35)
    assert [row["sweep"] for row in rows] == np.flatnonzero((first >= 0.15) & (first < 0.35)).tolist()
