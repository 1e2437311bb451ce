"""Logs of several runs: path, tracks, maps and zones of each are those of its sweeps alone."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli import read
from lidarcli.errors import NoScanError
from lidarcli.files.stores import place
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions, TrackOptions
from tests.conftest import process
from tests.pipeline.runs import Recorded, run_of, two_runs, write_runs
from tests.places import REAL_LOGS, needs_real_logs

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:.*starts anew:UserWarning")]
Run = Callable[..., Any]
FIRST, SECOND = 120, 160
"""Sweeps of the runs."""
ZONES = """
[[zone]]
name = "spot"
frame = "world"
polygon = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
"""


@pytest.fixture(scope="module")
def runs() -> list[Recorded]:
    return two_runs(FIRST, SECOND)


@pytest.fixture(scope="module")
def alone(runs: list[Recorded], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A log of each run."""
    folder = tmp_path_factory.mktemp("alone")
    return [write_runs(folder / f"{number}.mcap", [run]) for number, run in enumerate(runs, 1)]


@pytest.fixture(scope="module")
def both(runs: list[Recorded], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of both."""
    return write_runs(tmp_path_factory.mktemp("both") / "both.mcap", runs)


def shifted(table: pa.Table, sweeps: int, tracks: int = 0) -> list[dict[str, Any]]:
    """The rows of a run, as of a log that has so many sweeps and tracks before it; its name and seconds are left out."""
    rows = table.drop_columns(
        [name for name in ("log", "t", "first_t", "last_t") if name in table.column_names]
    ).to_pylist()
    for row in rows:
        row |= {name: row[name] + sweeps for name in ("sweep", "first_sweep", "last_sweep") if name in row}
        row |= {"track": row["track"] + tracks} if row.get("track") is not None else {}
    return [{name: repr(value) for name, value in row.items()} for row in rows]


@pytest.mark.parametrize("pose", ["told", "match"])
@pytest.mark.parametrize("recorded", [True, False], ids=["recording goes on", "recorded by the same clock"])
@pytest.mark.parametrize("name", ["log.mcap", "log.bag", "log", "log.csv"])
def test_each_run_is_as_if_alone(
    name: str, recorded: bool, pose: str, runs: list[Recorded], alone: list[Path], tmp_path: Path
) -> None:
    if (pose == "told") == name.endswith("csv") or (pose == "match" and name.endswith("bag")):
        pytest.skip("a CSV has no poses, and matching is the same for all messages")
    options = {"pose": "match"} if pose == "match" else {}
    log = write_runs(tmp_path / name, runs, recorded=recorded)
    whole = lidarcli.track(log, **options)
    ones = [lidarcli.track(each, **options) for each in alone]
    for table in ("objects", "sweeps", "tracks", "trajectories"):
        parts = [getattr(one, table) for one in ones]
        expected = shifted(parts[0], 0) + shifted(parts[1], FIRST, ones[0].tracks.num_rows)
        unlike = {"record_stamp"} if not recorded or name.endswith("csv") else set()
        assert without(shifted(getattr(whole, table), 0), unlike) == without(expected, unlike)
        second = getattr(lidarcli.track(log, run=2, **options), table)
        assert without(shifted(second, 0), unlike) == without(shifted(parts[1], FIRST), unlike)


def without(rows: list[dict[str, Any]], names: set[str]) -> list[dict[str, Any]]:
    return [{name: value for name, value in row.items() if name not in names} for row in rows]


def test_tracks_end_at_the_border(both: Path) -> None:
    tracks = lidarcli.track(both, pose="none").tracks.to_pylist()
    assert all(row["last_sweep"] < FIRST or row["first_sweep"] >= FIRST for row in tracks)
    assert [row["track"] for row in tracks] == [*range(1, len(tracks) + 1)]


@pytest.mark.parametrize("size", [1, 50])
def test_batches_change_nothing(size: int, both: Path, tmp_path: Path) -> None:
    tables = []
    for batch_size in (size, 768):
        options = DetectOptions(read=ReadOptions(batch_size=batch_size), tracking=TrackOptions())
        detect_to_files(Source(str(both), "both"), place(str(tmp_path / str(batch_size))), options)
        tables.append([pq.read_table(path) for path in sorted((tmp_path / str(batch_size)).iterdir())])
    assert all(one.equals(other) for one, other in zip(*tables, strict=True))


def test_a_pipe_ends_tracks_as_well(both: Path, tmp_path: Path) -> None:
    ran = process("track", "-", "-o", tmp_path, input=both.read_bytes())
    assert ran.returncode == 0
    tracks = pq.read_table(tmp_path / "stdin.tracks.parquet").to_pylist()
    assert all(row["last_sweep"] < FIRST or row["first_sweep"] >= FIRST for row in tracks)
    assert b"run 1 from sweep 0" in ran.stderr
    ran = process("-q", "detect", "-", "--run", "2", "-o", "-", input=both.read_bytes())
    rows = ran.stdout.splitlines()
    assert ran.returncode == 0
    assert b'"sweep":%d,' % FIRST in rows[0].replace(b" ", b"")


def test_what_has_one_world_takes_the_longest_run(lidarcli: Run, both: Path, alone: list[Path], tmp_path: Path) -> None:
    words = "of 2 runs, each in its own world, run 2 is taken: the longest (--run)"
    assert f"  note     {words}" in lidarcli("map", both, "-o", tmp_path / "both.yaml").err.splitlines()
    lidarcli("map", both, "--run", "1", "-o", tmp_path / "one.yaml")
    for name, log in (("both", alone[1]), ("one", alone[0])):
        lidarcli("map", log, "-o", tmp_path / "alone.yaml", "--overwrite")
        assert (tmp_path / f"{name}.pgm").read_bytes() == (tmp_path / "alone.pgm").read_bytes()
    for command in (("poses", both, "-o", tmp_path / "a.tum"), ("background", "build", both, "-o", tmp_path / "b.parquet")):
        assert words in lidarcli(*command).err
    assert len((tmp_path / "a.tum").read_text().splitlines()) == SECOND
    differs = lidarcli("diff", alone[1], both, "-o", tmp_path / "diff.parquet")
    assert words in differs.err
    assert differs.out.splitlines()[-1].split() == ["known", "2"]


def test_what_stood_in_one_run_is_not_free_in_another(lidarcli: Run, both: Path, tmp_path: Path) -> None:
    lidarcli("clean", both, "-o", tmp_path / "both.mcap", "--remove", "temporary")
    cleaned = pq.read_table(tmp_path / "both.cleaned.parquet")
    assert cleaned.num_rows == FIRST + SECOND
    assert sum(cleaned["temporary"].to_pylist()) == 0


def test_poses_of_a_common_map_are_one_world(lidarcli: Run, tmp_path: Path) -> None:
    """All runs count where the poses of each are in one frame."""
    in_map = [
        (blocks, replace(poses, odometry=replace(poses.odometry, frame_id="map"))) for blocks, poses in two_runs(60, 60)
    ]
    log = write_runs(tmp_path / "log.mcap", in_map)
    ran = lidarcli("map", log, "-o", tmp_path / "map.yaml")
    assert ran.err.startswith(f"{log}: 120 sweeps")
    assert "run 2 is taken" not in ran.err


@pytest.mark.parametrize("recorded", [True, False])
def test_zones_are_watched_in_each_run(
    recorded: bool, lidarcli: Run, runs: list[Recorded], alone: list[Path], tmp_path: Path
) -> None:
    (tmp_path / "zones.toml").write_text(ZONES)
    log = write_runs(tmp_path / "both.mcap", runs, recorded=recorded)
    events = []
    for source in (log, *alone):
        assert lidarcli("zones", source, "--zones", tmp_path / "zones.toml", "-o", tmp_path).code == 0
        events.append(pq.read_table(tmp_path / f"{source.stem}.events.parquet").drop_columns(["log", "t", "event"]))
    names = ("first_sweep", "last_sweep", "kind", "start", "end")
    rows = [[tuple(row[name] for name in names) for row in each.to_pylist()] for each in events]
    later = [(first + FIRST, last + FIRST, *rest) for first, last, *rest in rows[2]]
    # By their starts, whatever the run.
    assert sorted(rows[0]) == sorted(rows[1] + later)
    assert [start for *_, start, _ in rows[0]] == sorted(start for *_, start, _ in rows[0])


def test_info_lists_the_runs(both: Path) -> None:
    (log,) = lidarcli.info(both)
    (found,) = [each["message"] for each in log["findings"] if each["id"] == "clock"]
    assert f"run 1 from sweep 0 (2023-11-14T22:13:20.000Z), run 2 from sweep {FIRST} (2023-11-14T22:13:20.000Z)" in found
    (log,) = lidarcli.info(both, run=2)
    assert log["scans"][0]["sweeps"] == SECOND
    assert log["scans"][0]["clock"]["monotonic"]
    assert [each["poses"] for each in log["pose_sources"]] == [SECOND]
    assert not [each for each in log["findings"] if "starts anew" in each["message"]]


@pytest.mark.parametrize(
    "command",
    [
        "detect",
        "track",
        "map -o {}/map.yaml",
        "info",
        "info --deep",
        "poses -o {}/a.tum",
        "background build -o {}/b.parquet",
    ],
)
def test_a_run_that_is_not_there(command: str, lidarcli: Run, both: Path, tmp_path: Path) -> None:
    ran = lidarcli(*command.format(tmp_path).split(), both, "--run", "3")
    assert (ran.code, ran.err) == (4, f"lidarcli: {both}: --run 3: the log holds 2 runs\n")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(NoScanError, match="--run 3"):
        list(read(both, run=3))


@pytest.mark.parametrize("command", [lidarcli.detect, lidarcli.track])
def test_poses_of_one_run_are_not_taken_for_another(command: Run, tmp_path: Path, runs: list[Recorded]) -> None:
    """The first run was recorded without odometry."""
    (first, _), (second, poses) = runs
    log = write_runs(tmp_path / "log.mcap", [(first, None), (second, poses)])
    found = command(log)
    rows = (found if isinstance(found, pa.Table) else found.objects).to_pylist()
    worlds = [{row["world_x"] for row in rows if (row["sweep"] < FIRST) == is_first} for is_first in (True, False)]
    assert None not in worlds[1]
    alone = command(write_runs(tmp_path / "first.mcap", [(first, None)]))
    rows = (alone if isinstance(alone, pa.Table) else alone.objects).to_pylist()
    assert worlds[0] == {row["world_x"] for row in rows}


def test_a_clock_of_poses_alone_is_told(lidarcli: Run, tmp_path: Path) -> None:
    """Odometry whose clock is set back while that of the sweeps goes on: nobody knows which poses are of which sweeps."""
    blocks, poses = run_of(lambda seconds: np.column_stack([0.2 * seconds, 0.0 * seconds, 0.0 * seconds]), 60)
    back = replace(poses, stamp_ns=poses.stamp_ns - 2_500_000_000 * (np.arange(60) >= 30))
    log = write_runs(tmp_path / "log.bag", [(blocks, back)])
    assert "stamps of /odom jump back once: poses there may mix two runs" in lidarcli("detect", log, "-o", tmp_path).err


@needs_real_logs
def test_a_simulation_that_was_started_twice(tmp_path: Path) -> None:
    """Two recordings of one simulation in one database, each from its start on, with topics by other numbers."""
    folder = REAL_LOGS / "my_gazebo_tutorials"
    logs = [next((folder / name).rglob("*.db3")) for name in ("20_46_08", "20_53_49")]
    log = tmp_path / "log.db3"
    log.write_bytes(logs[0].read_bytes())
    with sqlite3.connect(log) as both, sqlite3.connect(f"file:{logs[1]}?mode=ro&immutable=1", uri=True) as later:
        number = dict(both.execute("SELECT name, id FROM topics"))
        name = dict(later.execute("SELECT id, name FROM topics"))
        rows = later.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id").fetchall()
        both.executemany(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
            [(number[name[topic]], *rest) for topic, *rest in rows],
        )
    whole, *parts = (lidarcli.track(each) for each in (log, *logs))
    sweeps, tracks = parts[0].sweeps.num_rows, parts[0].tracks.num_rows
    for table in ("objects", "sweeps", "tracks"):
        one, other = (getattr(part, table) for part in parts)
        assert shifted(getattr(whole, table), 0) == shifted(one, 0) + shifted(other, sweeps, tracks)
