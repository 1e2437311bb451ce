"""`lidarcli poses` and `--poses`: the path of the sensor as a file, and back."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.simulation.writers import write_log
from lidarcli.tabular.schemas import POSES
from tests.places import SAMPLES
from tests.pose.pose_messages import told_of_drive
from tests.sweeping import START, STEP, raw_sweeps, round_room

Run = Callable[..., Any]
DRIVE = SAMPLES / "drive.db3"
POSES_NOTE = (
    "  note     poses from /tf and /tf_static (odom > base_link > laser): 96% of the hits agree over the run; "
    "also available: /odom (--pose TOPIC)"
)


def names(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def lines_of(path: Path) -> Any:
    """(N,) stamps [ns], and (N, 7) x, y, z and the quaternion."""
    words = [line.split(" ") for line in path.read_text("ascii").splitlines()]
    whole = [word[0].partition(".") for word in words]
    assert all(len(after) == 9 for _, _, after in whole)
    return np.array([int(one + after) for one, _, after in whole]), np.array([word[1:] for word in words], float)


def columns(path: Path, *wanted: str) -> Any:
    """(N, K) numbers of a table."""
    table = pq.read_table(path)
    return np.column_stack([table[name].to_numpy(zero_copy_only=False) for name in wanted])


@pytest.fixture
def tables(lidarcli: Run, tmp_path: Path) -> Path:
    """What `detect` says of the sample by its own poses."""
    assert lidarcli("-q", "detect", DRIVE, "-o", tmp_path / "log").code == 0
    return tmp_path / "log"


def test_tum(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.tum"
    ran = lidarcli("-v", "poses", DRIVE, "-o", out)
    assert (ran.code, ran.out) == (0, "")
    lines = ran.err.splitlines()
    assert lines[0].startswith(f"{DRIVE}: 150 sweeps")
    assert lines[1:] == [POSES_NOTE, "  note     150 poses", f"  wrote    {out}"]
    assert out.read_text().splitlines()[1] == (
        "1700000000.200000000 2.603073 0.100326 0.000000 0.000000000 0.000000000 0.706726729 0.707486629"
    )
    stamps, numbers = lines_of(out)
    assert np.array_equal(stamps, START + 200_000_000 * np.arange(150))
    assert np.linalg.norm(numbers[:, 3:], axis=1) == pytest.approx(np.ones(150), abs=1e-8)
    pose = columns(tables / "drive.sweeps.parquet", "pose_x", "pose_y", "pose_yaw")
    assert numbers[:, :2] == pytest.approx(pose[:, :2], abs=5.1e-7)
    yaw = 2 * np.arctan2(numbers[:, 5], numbers[:, 6])
    assert np.abs((yaw - pose[:, 2] + np.pi) % (2 * np.pi) - np.pi).max() < 1e-8
    assert (numbers[:, 6] >= 0).all()
    assert "-0.000000 " not in out.read_text()


def test_parquet(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.parquet"
    assert lidarcli("-q", "poses", DRIVE, "-o", out).code == 0
    table = pq.read_table(out)
    assert table.schema.equals(POSES)
    assert table.num_rows == 150
    for name, value in {"log": "drive", "topic": "/scan", "frame_id": "laser", "world": "odom"}.items():
        assert set(table[name].to_pylist()) == {value}
    assert table["sweep"].to_pylist() == list(range(150))
    assert table["stamp"].cast("int64").to_pylist() == [START + 200_000_000 * k for k in range(150)]
    assert np.array_equal(
        columns(out, "x", "y", "yaw"), columns(tables / "drive.sweeps.parquet", "pose_x", "pose_y", "pose_yaw")
    )
    assert lidarcli("-q", "poses", DRIVE, "-o", tmp_path / "run.tum").code == 0
    _, numbers = lines_of(tmp_path / "run.tum")
    assert columns(out, "x", "y", "z", "qx", "qy", "qz", "qw") == pytest.approx(numbers, abs=5.1e-7)
    metadata = table.schema.metadata or {}
    assert json.loads(metadata[b"lidarcli.source"])["poses"] == {"laser": told_of_drive("/tf", "odom")}


@pytest.mark.parametrize(
    ("source", "options"), [(DRIVE, ()), pytest.param(DRIVE, ("--no-deskew",), marks=pytest.mark.slow)]
)
def test_and_back(lidarcli: Run, tables: Path, tmp_path: Path, source: Path, options: tuple[str, ...]) -> None:
    path = tmp_path / "run.tum"
    assert lidarcli("-q", "poses", source, "-o", path).code == 0
    ran = lidarcli("-v", "detect", source, "-o", tmp_path / "back", "--poses", path, *options)
    assert ran.code == 0
    assert "  note     poses from run.tum (world > laser): 96% of the hits agree over the run" in ran.err.splitlines()
    for table, wanted in {
        "objects": ("world_x", "world_y", "world_yaw"),
        "sweeps": ("pose_x", "pose_y", "pose_yaw"),
    }.items():
        here, back = (columns(folder / f"drive.{table}.parquet", *wanted) for folder in (tables, tmp_path / "back"))
        apart = here - back
        turn = np.pi if table == "objects" else 2 * np.pi
        apart[:, 2] = (apart[:, 2] + turn / 2) % turn - turn / 2
        assert np.abs(apart).max() < 1e-6
    metadata = pq.read_schema(tmp_path / "back" / "drive.sweeps.parquet").metadata
    assert json.loads(metadata[b"lidarcli.parameters"])["poses"] == "run.tum"
    assert json.loads(metadata[b"lidarcli.source"])["poses"] == {"laser": told_of_drive("run.tum", "world")}


def two(folder: Path) -> tuple[Path, Path]:
    """A log of two sensors, and a path that is right for any."""
    log, path = folder / "two.mcap", folder / "in.tum"
    write_log(log, [raw_sweeps(round_room(4), topic=f"/{name}", frame_ids=(name,)) for name in ("front", "rear")])
    path.write_text("1700000000 0 0 0 0 0 0 1\n1700000001 1 0 0 0 0 0 1\n")
    return log, path


def test_one_file_has_one_sensor(lidarcli: Run, tmp_path: Path) -> None:
    log, path = two(tmp_path)
    words = ("poses", log, "--poses", path, "-o")
    ran = lidarcli(*words, tmp_path / "out.tum")
    assert (ran.code, ran.out, ran.err) == (
        2,
        "",
        f"lidarcli: {log}: a TUM file holds the path of one sensor, and the log has /front (front) and /rear (rear): "
        "choose one with --topic, or write a .parquet\n",
    )
    assert names(tmp_path) == ["in.tum", "two.mcap"]
    assert lidarcli(*words, tmp_path / "out.tum", "--topic", "rear").code == 0
    assert len((tmp_path / "out.tum").read_text().splitlines()) == 4
    assert lidarcli(*words, tmp_path / "out.parquet").code == 0
    table = pq.read_table(tmp_path / "out.parquet")
    assert table["frame_id"].to_pylist() == ["front"] * 4 + ["rear"] * 4
    assert table["topic"].to_pylist() == ["/front"] * 4 + ["/rear"] * 4


def test_stamps_that_jump_back(lidarcli: Run, tmp_path: Path) -> None:
    log, path, out = tmp_path / "run.mcap", tmp_path / "in.tum", tmp_path / "out.tum"
    order = np.array([0, 1, 2, 1, 2, 2, 3])
    sweeps = raw_sweeps(round_room(7), stamp_ns=START + STEP * order, record_ns=START + STEP * np.arange(7))
    write_log(log, [sweeps])
    path.write_text("1700000000 0 0 0 0 0 0 1\n1700000001 1 0 0 0 0 0 1\n")
    ran = lidarcli("poses", log, "--poses", path, "-o", out)
    assert ran.code == 0
    assert ran.err.splitlines()[1:3] == [
        "  note     left out, as their stamps are not after those before and evo reads none of these: 3",
        "  note     4 poses",
    ]
    stamps, numbers = lines_of(out)
    assert stamps.tolist() == (START + STEP * np.arange(4)).tolist()
    assert numbers[:, 0] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    # A table has room for all.
    assert lidarcli("-q", "poses", log, "--poses", path, "-o", tmp_path / "out.parquet").code == 0
    assert pq.read_table(tmp_path / "out.parquet")["sweep"].to_pylist() == list(range(7))


def test_what_is_read_is_not_written(lidarcli: Run, tmp_path: Path) -> None:
    path = tmp_path / "in.tum"
    path.write_text("1700000000 0 0 0 0 0 0 1\n")
    for output, source in ((path, DRIVE), (tmp_path / "log.tum", tmp_path / "log.tum")):
        (tmp_path / "log.tum").write_bytes(b"log")
        ran = lidarcli("poses", source, "--poses", path, "-o", output, "--overwrite")
        assert (ran.code, ran.err) == (
            5,
            f"lidarcli: {output} is an input of this run ({output}); write elsewhere with -o\n",
        )
    assert lidarcli("-q", "poses", DRIVE, "-o", tmp_path / "log.tum", "--overwrite").code == 0
    assert len((tmp_path / "log.tum").read_text().splitlines()) == 150


@pytest.mark.parametrize("far", [-400.0, 400.0])
def test_a_path_of_another_time(lidarcli: Run, logs: Path, tmp_path: Path, far: float) -> None:
    """No sweep has a place, and it is told why."""
    side = "after" if far > 0 else "before"
    path = tmp_path / "in.tum"
    path.write_text("".join(f"{1_700_000_000 + far + k / 10:.1f} {k} 0 0 0 0 0 1\n" for k in range(20)))
    ran = lidarcli("detect", logs / "run.mcap", "--poses", path, "-o", tmp_path / "tables")
    assert ran.code == 3
    assert ran.err.splitlines()[0] == (
        f"lidarcli: {logs / 'run.mcap'}: --poses {path}: none of its poses is from the time of the sweeps, "
        f"2023-11-14T22:13:20.000Z to 2023-11-14T22:13:21.900Z: they begin 400.00 s {side} the sweeps: "
        "is it of another log, or of another clock (--pose-delay)?"
    )
    assert (
        "  note     20 of 20 sweeps of frame laser have no pose: they are outside the span of in.tum, "
        f"whose poses begin 400.00 s {side} the sweeps" in ran.err.splitlines()
    )
    objects = pq.read_table(tmp_path / "tables" / "run.objects.parquet")
    sweeps = pq.read_table(tmp_path / "tables" / "run.sweeps.parquet")
    for table, wanted in ((objects, ("world_x", "world_y", "world_yaw")), (sweeps, ("pose_x", "pose_y", "pose_yaw"))):
        for name in wanted:
            assert table[name].null_count == table.num_rows > 0
    ran = lidarcli("poses", logs / "run.mcap", "--poses", path, "-o", tmp_path / "out.tum")
    assert (ran.code, ran.out, len(ran.err.splitlines())) == (3, "", 1)
    assert "20 of 20 sweeps of frame laser have no pose" in ran.err
    assert not (tmp_path / "out.tum").exists()
