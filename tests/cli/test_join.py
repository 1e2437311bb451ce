"""A recording in parts is read as the whole one is: the same rows, poses, maps and pictures."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests.conftest import Ran
from tests.places import SAMPLES
from tests.splitting import split_mcap

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
    ran = lidarcli("-v", "track", "--join", *parts(drive, *order), "-o", tmp_path / "joined")
    assert ran.code == 0
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
    ran = lidarcli("track", "--join", tmp_path / "parts", "-o", tmp_path / "out")
    assert ran.code == 3
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
    first = lidarcli(*run, "--jobs", 2)
    assert first.code == 0
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
    ran = lidarcli("detect", "--join", tmp_path / "run.csv", *parts(drive, 0), "-o", tmp_path)
    assert ran.code == 2
    assert "run.csv is csv (rostopic echo -p) and drive_0.mcap is mcap: CSV is joined with CSV" in ran.err
    assert lidarcli("poses", *parts(drive, 0, 1), "-o", tmp_path / "x.tum").code == 2
    assert not [*tmp_path.glob("*.objects.parquet")]
