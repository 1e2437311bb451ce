"""Logs in parts: recordings that are joined, and messages that are segments of a turn."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer

import lidarcli
from lidarcli.cli import run
from lidarcli.ros.messages import SCAN, cdr_scans, ros2_definition
from lidarcli.sweeps.types import RawSweeps
from tests.conftest import Ran
from tests.logs.test_segments import DEGREE, TURN_NS, cut
from tests.places import SAMPLES
from tests.splitting import split_mcap
from tests.sweeping import START, raw_sweeps

Run = Callable[..., Ran]
TABLES = ("objects", "sweeps", "tracks")
SWEEPS = 90


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`drive.mcap` of a robot that drives, with `parts/drive_0.mcap` to `drive_2.mcap` of its messages.

    A static transform tells in the first part alone where the sensor is on the robot.
    """
    from lidarcli.cli import run

    folder = tmp_path_factory.mktemp("drive")
    words = ("-q", "simulate", SAMPLES / "drive.toml", "-o", folder / "drive.mcap", "--sweeps", SWEEPS)
    assert run([str(word) for word in words]) == 0
    split_mcap(folder / "drive.mcap", folder / "parts")
    return folder


def parts(drive: Path, *order: int) -> list[Path]:
    return [drive / "parts" / f"drive_{number}.mcap" for number in order]


def assert_same_tables(one: Path, other: Path, tables: tuple[str, ...] = TABLES) -> None:
    for table in tables:
        expected, found = (pq.read_table(folder / f"drive.{table}.parquet") for folder in (one, other))
        assert expected.num_rows > 0
        assert found.equals(expected), table


def source_of(table: Path) -> dict[str, object]:
    told: dict[str, object] = json.loads(pq.read_schema(table).metadata[b"lidarcli.source"])
    return told


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_tables_are_those_of_the_whole_log(order: tuple[int, ...], drive: Path, lidarcli: Run, tmp_path: Path) -> None:
    lidarcli("-q", "track", drive / "drive.mcap", "-o", tmp_path / "whole")
    ran = lidarcli("-v", "track", "--join", *parts(drive, *order), "-o", tmp_path / "joined", code=0)
    assert f"{drive}/parts/drive_0.mcap and 2 more: {SWEEPS} sweeps" in ran.err.replace("\n", " ")
    assert "poses from /tf and /tf_static (odom > base_link > laser)" in ran.err
    assert_same_tables(tmp_path / "whole", tmp_path / "joined")
    told = source_of(tmp_path / "joined" / "drive.objects.parquet")
    files = [(path.name, path.stat().st_size) for path in parts(drive, 0, 1, 2)]
    assert told["parts"] == [{"name": name, "size": size} for name, size in files]
    assert (told["name"], told["size"], told["format"]) == ("drive", sum(size for _, size in files), "mcap")
    # Each by itself, the later parts know no transform to the sensor.
    alone = lidarcli("track", parts(drive, 1)[0], "-o", tmp_path / "alone")
    assert "its mount is not in the log" in alone.err.replace("\n", " ")


def test_a_damaged_part_is_named_and_the_rest_is_read(drive: Path, lidarcli: Run, tmp_path: Path) -> None:
    shutil.copytree(drive / "parts", tmp_path / "parts")
    middle, last = tmp_path / "parts" / "drive_1.mcap", tmp_path / "parts" / "drive_2.mcap"
    os.truncate(middle, middle.stat().st_size // 2)
    last.write_bytes(b"")
    ran = lidarcli("track", "--join", tmp_path / "parts", "-o", tmp_path / "out", code=3)
    log = f"lidarcli: {tmp_path}/parts/drive_0.mcap and 2 more: "
    first, second = (line.removeprefix(log) for line in ran.err.splitlines() if line.startswith(log))
    assert first.startswith("drive_1.mcap: byte ")
    assert second == "drive_2.mcap: the whole file is lost: is empty"
    table = pq.read_table(tmp_path / "out" / "drive.sweeps.parquet")
    assert SWEEPS / 3 <= table.num_rows < SWEEPS
    damage = json.loads(table.schema.metadata[b"lidarcli.damage"])
    assert damage == [first, second]


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        ("poses", "run.tum"),
        ("poses", "run.tum", "--pose", "match"),
        ("map", "run.pgm", "--jobs", "2"),
        ("overlay", "run.mcap", "--with-log"),
        ("plot", "run.svg", "--sweep", "70", "--no-title"),
        ("plot", "run.svg", "--view", "map", "--no-title"),
    ],
    ids=" ".join,
)
def test_what_is_made_of_the_parts_has_the_same_bytes(
    command: tuple[str, ...], drive: Path, lidarcli: Run, tmp_path: Path
) -> None:
    verb, file, *options = command
    made = []
    for name, log in (("whole", [drive / "drive.mcap"]), ("joined", ["--join", *parts(drive, 1, 2, 0)])):
        (tmp_path / name).mkdir()
        output = tmp_path / name / file.replace(".pgm", ".yaml")
        ran = lidarcli("-q", verb, *log, "-o", output, *options)
        assert (ran.code, ran.err) == (0, "")
        made.append((tmp_path / name / file).read_bytes())
    assert made[0] == made[1]


def test_info_tells_the_parts_in_their_order(drive: Path, lidarcli: Run) -> None:
    whole, joined = (
        json.loads(lidarcli("info", *log, "--format", "json").out)[0]
        for log in ([drive / "drive.mcap"], ["--join", *parts(drive, 1, 0, 2)])
    )
    sizes = [path.stat().st_size for path in parts(drive, 0, 1, 2)]
    told = [{"name": f"drive_{number}.mcap", "size": size} for number, size in enumerate(sizes)]
    assert (whole["parts"], joined["parts"]) == ([], told)
    for key in ("topics", "scans", "pose_sources", "notes", "damage"):
        assert joined[key] == whole[key], key
    text = lidarcli("info", "--join", drive / "parts").out.splitlines()
    assert text[0] == f"{drive}/parts/drive_0.mcap and 2 more"
    assert text[3:6] == [
        f"  {'parts' if not number else '':10}  drive_{number}.mcap ({size:,} bytes)" for number, size in enumerate(sizes)
    ]


@pytest.mark.slow
def test_a_joined_log_is_one_log_of_a_run(drive: Path, lidarcli: Run, tmp_path: Path) -> None:
    shutil.copytree(drive / "parts", tmp_path / "bags" / "parts")
    shutil.copy(SAMPLES / "room.mcap", tmp_path / "bags")
    (tmp_path / "list.txt").write_text(f"{tmp_path}/bags\n")
    run = ("detect", "--join", "--files-from", tmp_path / "list.txt", "-o", tmp_path / "out", "--resume")
    lidarcli(*run, "--jobs", 2, code=0)
    assert sorted(path.name for path in (tmp_path / "out" / "parts").iterdir()) == [
        "drive.objects.parquet",
        "drive.sweeps.parquet",
    ]
    read = [line for line in lidarcli(*run, "--dry-run").out.splitlines() if not line.startswith("write")]
    assert [line.split()[0] for line in read] == ["skip", "skip"]
    # Another part makes it another log, whose tables are its own.
    more = split_mcap(SAMPLES / "room_empty.mcap", tmp_path / "more", 1)[0]
    shutil.move(more, tmp_path / "bags" / "parts" / "drive_3.mcap")
    words = [line.split()[0] for line in lidarcli(*run, "--dry-run").out.splitlines()]
    assert words == ["read", "write", "write", "skip"]
    assert lidarcli("-q", *run).code == 0
    read = [line for line in lidarcli(*run, "--dry-run").out.splitlines() if not line.startswith("write")]
    assert [line.split()[0] for line in read] == ["skip", "skip"]


def test_what_makes_no_sense_is_refused(drive: Path, lidarcli: Run, tmp_path: Path) -> None:
    lidarcli("-q", "simulate", SAMPLES / "drive.toml", "-o", tmp_path / "run.csv", "--sweeps", 3)
    ran = lidarcli("detect", "--join", tmp_path / "run.csv", *parts(drive, 0), "-o", tmp_path, code=2)
    assert "run.csv is csv (rostopic echo -p) and drive_0.mcap is mcap: CSV is joined with CSV" in ran.err
    assert lidarcli("poses", *parts(drive, 0, 1), "-o", tmp_path / "x.tum").code == 2
    assert not [*tmp_path.glob("*.objects.parquet")]


NOTE = "/scan: segments of 30 deg are joined to turns of 270 deg; --segments keep leaves them"
ZONE = '[[zone]]\nname = "near"\ncircle = { x = 0, y = 0, radius = 2.5 }\nmin_points = 12\ntrigger = 3\nhold = 0.1\n'


def room(count: int = 30) -> RawSweeps:
    """Turns of a round room in which somebody passes the border of two segments."""
    ranges = np.random.default_rng(3).normal(4.0, 0.005, (count, 270)).astype(np.float32)
    for row in range(count):
        ranges[row, 165 + row : 181 + row] = 2.0
    return replace(
        raw_sweeps(
            ranges, angle_min=-135 * DEGREE, angle_increment=np.float32(DEGREE), stamp_ns=START + TURN_NS * np.arange(count)
        ),
        time_increment=np.full(count, TURN_NS / 360e9, np.float32),
    )


def written(path: Path, raw: RawSweeps) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        channel = writer.register_channel(
            "/scan", "cdr", writer.register_schema(SCAN, "ros2msg", ros2_definition(SCAN).encode())
        )
        for stamp, data in zip(raw.stamp_ns.tolist(), cdr_scans(raw), strict=True):
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    return path


@pytest.fixture
def logs(tmp_path: Path) -> tuple[Path, Path]:
    return written(tmp_path / "full.mcap", room()), written(tmp_path / "segments.mcap", cut(room(), 30))


def test_turns_of_segments_are_the_sweeps_of_the_full_log(
    logs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full, segments = logs
    (tmp_path / "zones.toml").write_text(ZONE)
    zones = ["--zones", str(tmp_path / "zones.toml"), "--check", "zones.near.events == 1"]
    assert run(["zones", str(full), *zones]) == run(["-v", "zones", str(segments), *zones]) == 0
    assert run(["zones", str(segments), *zones, "--segments", "keep"]) == 1
    assert capsys.readouterr().err.count(NOTE) == 1
    assert run(["detect", str(full), str(segments), "-o", str(tmp_path)]) == 0
    one, other = (
        pq.read_table(tmp_path / f"{name}.objects.parquet").drop_columns(["log"]) for name in ("full", "segments")
    )
    assert one.num_rows == 30
    columns = ["sweep", "stamp", "x", "y"]
    assert one.select(columns) == other.select(columns)
    source = json.loads(other.schema.metadata[b"lidarcli.source"])
    assert source["segments"] == ["/scan"]


def test_clean_names_the_way_out(logs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "clean.mcap"
    assert run(["clean", str(logs[1]), "-o", str(out)]) == 2
    assert (
        f"lidarcli: {logs[1]}: messages of /scan are segments of a turn, which clean cannot write back; --segments keep "
        "cleans each alone\n"
    ) == capsys.readouterr().err
    assert not out.exists()
    assert run(["clean", str(logs[1]), "-o", str(out), "--segments", "keep"]) == 0
    assert sum(map(len, lidarcli.read(out, segments="keep"))) == 270


@pytest.mark.parametrize("parts", [4, 9, 12])
def test_a_turn_in_any_number_of_segments_is_the_same_turn(parts: int, tmp_path: Path) -> None:
    """Objects, zones, map and background of the same scans in one message and in several."""
    turns = room(40)
    files = written(tmp_path / "one.mcap", turns), written(tmp_path / "cut.mcap", cut(turns, -(-270 // parts)))
    (tmp_path / "zones.toml").write_text(ZONE)
    found = []
    for log in files:
        tables = lidarcli.track(log)
        zones = lidarcli.zones(log, zones=str(tmp_path / "zones.toml"))
        grid = lidarcli.map(log)
        assert run(["background", "build", str(log), "-o", str(log.with_suffix(".parquet"))]) == 0
        model = pq.read_table(log.with_suffix(".parquet"))
        found.append((tables, zones, grid, model))
    (tables, zones, grid, model), (others, other_zones, other_grid, other_model) = found
    every = [*zip(tables, others, strict=True), *zip(zones, other_zones, strict=True), (model, other_model)]
    for table, other in every:
        assert table.num_rows == other.num_rows
        for name in table.column_names:
            ours, its = (each[name].to_pylist() for each in (table, other))
            if name != "log" and ours and isinstance(next((value for value in ours if value is not None), None), float):
                nan = float("nan")
                one, two = ([nan if value is None else value for value in values] for values in (ours, its))
                np.testing.assert_allclose(two, one, rtol=1e-5, atol=1e-5, err_msg=name)
            elif name not in ("log", "vertices", "faces"):
                assert its == ours, name
    assert zones.events.num_rows > 0
    np.testing.assert_array_equal(grid.cells, other_grid.cells)
