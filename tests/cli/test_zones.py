"""`lidarcli zones`: outputs, exit codes and checks; logs and options of every kind."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli as package
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Odometry
from tests.cli.maps import Run, names
from tests.interrupting import MOMENTS, ended, left
from tests.pipeline.drawn import driven, round_about, told
from tests.places import SAMPLES
from tests.sweeping import raw_sweeps, round_room
from tests.zones.runs import column, odometry_of, scans, scene_of, sweeps_of, write_bag, zone_file

STOP = """
[[zone]]
name = "stop"
action = "stop"
circle = { x = 1.0, y = 0.0, radius = 0.5 }
"""
SIDE = """
[[zone]]
name = "side"
polygon = [[0.0, 0.5], [1.0, 0.5], [1.0, 3.5], [0.0, 3.5]]
hold = 0.2
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A round room of 4 m, in which something stands 1 m ahead from 1 s to 2 s."""
    ranges = np.full((60, 360), 4.0, np.float32)
    ranges[10:21, 175:186] = 1.0
    ranges[40:45, 260:280] = 2.0
    return write_bag(tmp_path_factory.mktemp("log") / "run.bag", scans([raw_sweeps(ranges)]))


def zones_of(folder: Path, *texts: str) -> list[str | Path]:
    files = [zone_file(folder, text, f"zones{number}.toml") for number, text in enumerate(texts)]
    return [word for file in files for word in ("--zones", file)]


def test_what_is_written_and_said(lidarcli: Run, log: Path, tmp_path: Path) -> None:
    ran = lidarcli("zones", log, *zones_of(tmp_path, STOP, SIDE), "--no-objects", "-o", tmp_path / "out")
    assert (ran.code, ran.out) == (0, "")
    assert names(tmp_path / "out") == ["run.events.parquet", "run.zones.parquet"]
    assert f"{log}: 60 sweeps of /scan from 2023-11-14T22:13:20.000Z, 2 zones\n" in ran.err
    assert "  stop  1 event, 1.0 s of 5.9 s, nearest 1.00 m\n" in ran.err
    assert "  side  1 event, 0.4 s of 5.9 s, nearest 2.00 m\n" in ran.err
    events = pq.read_table(tmp_path / "out" / "run.events.parquet")
    told = [(row["event"], row["zone"], row["t"], row["duration"]) for row in events.to_pylist()]
    assert told == [(1, "stop", 1.0, 1.0), (2, "side", 4.0, pytest.approx(0.4))]
    parameters = json.loads(events.schema.metadata[b"lidarcli.parameters"])
    assert [zone["name"] for zone in parameters["zones"]] == ["stop", "side"]
    assert parameters["zones"][0]["circle"] == {"x": 1.0, "y": 0.0, "radius": 0.5}
    assert parameters["find"] is False
    api = package.zones(log, zones=zones_of(tmp_path, STOP, SIDE)[1::2], no_objects=True)
    assert api.events == events
    assert api.events.schema.metadata == events.schema.metadata
    assert api.zones == pq.read_table(tmp_path / "out" / "run.zones.parquet")


def test_who_it_was_and_how_long_read_once(lidarcli: Run, tmp_path: Path) -> None:
    """A number is a track; what one sweep shows takes less than is told, a crossing no time."""
    ranges = np.full((60, 360), 4.0, np.float32)
    ranges[5:, 175:186], ranges[40, 260:280] = 1.0, 1.5
    log = write_bag(tmp_path / "run.bag", scans([raw_sweeps(ranges)]))
    ran = lidarcli("zones", log, *zones_of(tmp_path, STOP, SIDE.replace("hold = 0.2", "")))
    assert "nearest 1.00 m; 1 by other objects\n" in ran.err
    lines = ran.err.splitlines()
    at = next(at for at, line in enumerate(lines) if line.startswith("  worst "))
    assert lines[at].endswith("  lasts  nearest  by track")
    assert lines[at + 1].split()[3:] == ["stop", "5.4", "s", "1.00", "m", "object", "1"]
    assert lines[at + 2].split()[3:9] == ["side", "<", "0.1", "s", "1.50", "m"]
    line = '[[zone]]\nname = "aisle"\nline = [[3.5, 0.0], [3.5, 2.0]]\n'
    lines = lidarcli("zones", SAMPLES / "people.csv.gz", *zones_of(tmp_path, line)).err.splitlines()
    at = next(at for at, line in enumerate(lines) if line.startswith("  worst "))
    assert lines[at + 1].split()[3:] == ["aisle", "3.62", "m", "agent", "2", "in"]


def test_existing_tables_are_kept(lidarcli: Run, log: Path, tmp_path: Path) -> None:
    words = ("zones", log, *zones_of(tmp_path, STOP), "--no-objects", "-o", tmp_path)
    assert lidarcli(*words).code == 0
    before = (tmp_path / "run.events.parquet").read_bytes()
    again = lidarcli(*words, code=5)
    assert "run.events.parquet" in again.err
    assert lidarcli(*words, "--overwrite").code == 0
    assert (tmp_path / "run.events.parquet").read_bytes() == before


@pytest.mark.parametrize(
    ("check", "code", "words"),
    [
        ("zones.stop.events == 1", 0, ""),
        ("zones.stop.events == 0", 1, "check failed: zones.stop.events is 1, expected == 0"),
        ("zones.stop.nearest > 1.5", 1, "check failed: zones.stop.nearest is 1"),
        ("events where kind == occupied and zone == stop == 1", 0, ""),
        ("events where kind == occupied and action == stop == 1", 3, "incomplete: run: zone behind was never observed"),
        ("zones.behind.observed == 0", 0, ""),
        ("zones.behind.events == 0", 1, "nothing to measure"),
    ],
)
def test_checks(lidarcli: Run, log: Path, tmp_path: Path, check: str, code: int, words: str) -> None:
    """The zone `behind` is beyond the wall: it is never observed."""
    behind = STOP.replace('"stop"', '"behind"', 1).replace("x = 1.0", "x = -6.0")
    ran = lidarcli("zones", log, *zones_of(tmp_path, STOP, behind), "--no-objects", "--check", check, code=code)
    assert words in ran.err
    assert "behind  never observed" in ran.err


def test_a_log_that_is_cut(lidarcli: Run, log: Path, tmp_path: Path) -> None:
    data = log.read_bytes()
    cut = tmp_path / "cut.bag"
    cut.write_bytes(data[: len(data) // 2])
    ran = lidarcli(
        "zones", cut, *zones_of(tmp_path, STOP), "--no-objects", "-o", tmp_path / "out", "--check", "zones.stop.events == 1"
    )
    assert ran.code == 3, ran.err
    assert names(tmp_path / "out") == ["cut.events.parquet", "cut.zones.parquet"]
    table = pq.read_table(tmp_path / "out" / "cut.zones.parquet")
    assert 10 < table.num_rows < 60
    broken = tmp_path / "broken.bag"
    broken.write_bytes(b"#ROSBAG V2.0\nnothing")
    ran = lidarcli(
        "zones",
        broken,
        *zones_of(tmp_path, STOP),
        "--no-objects",
        "-o",
        tmp_path / "none",
        "--check",
        "zones.stop.events == 0",
    )
    assert (ran.code, names(tmp_path / "none") if (tmp_path / "none").exists() else []) == (3, [])


@pytest.mark.slow
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_run_that_is_ended_leaves_nothing(log: Path, tmp_path: Path, moment: str) -> None:
    ran = ended(moment, signal.SIGTERM, "zones", log, *zones_of(tmp_path, STOP), "-o", tmp_path / "out")
    assert (ran.returncode, ran.stderr) == (-signal.SIGTERM, "lidarcli: terminated\n")
    assert left(tmp_path / "out") == []


def test_nothing_leads_to_a_frame(lidarcli: Run, log: Path, tmp_path: Path) -> None:
    zones = zones_of(tmp_path, STOP + 'frame = "robot"\n')
    ran = lidarcli("zones", log, *zones, "--no-objects", "-o", tmp_path / "out", code=4)
    assert ran.err.count("\n") == 1
    assert '[[mount]] frame = "laser" parent = "base_link"' in ran.err
    assert not (tmp_path / "out").exists() or names(tmp_path / "out") == []


@pytest.mark.parametrize("options", [("--no-objects",), ()])
def test_a_zone_in_the_world_without_poses(lidarcli: Run, log: Path, tmp_path: Path, options: tuple[str, ...]) -> None:
    ran = lidarcli("zones", log, *zones_of(tmp_path, STOP + 'frame = "world"\n'), *options, "-o", tmp_path / "out", code=4)
    assert "zone 'stop' is in the world, and nothing tells where the sensor of /scan is: give --pose" in ran.err
    assert not (tmp_path / "out").exists() or names(tmp_path / "out") == []


@pytest.mark.slow
def test_poses_that_contradict_the_sweeps(lidarcli: Run, tmp_path: Path) -> None:
    poses = round_about(np.arange(200) * 0.1)
    # It is told that the robot goes the other way round, and twice as fast.
    wrong = told(round_about(np.arange(200) * -0.2), tf=True)
    assert len(poses) == 200
    log = write_bag(tmp_path / "a.bag", scans(driven(), wrong))
    for options in (["--no-objects"], []):
        out = tmp_path / f"out{len(options)}"
        ran = lidarcli("zones", log, *zones_of(tmp_path, STOP + 'frame = "world"\n'), *options, "-o", out)
        assert ran.code == 3, ran.err
        assert "contradict the sweeps of /scan; nothing written" in ran.err
        assert not out.exists() or names(out) == []
    assert lidarcli("zones", log, *zones_of(tmp_path, STOP), "--no-objects").code == 0


@pytest.mark.parametrize(
    ("zone", "options", "cause"),
    [
        ("line = [[0, 0], [1, 0]]", ("--no-objects",), "is a line, and crossings need tracks: leave out --no-objects"),
        ('circle = { x = 1, y = 0, radius = 1 }\ncount = "agents"', ("--no-objects",), "counts agents, which need"),
        ("circle = { x = 1, y = 0, radius = 1 }", ("--footprint", "[[1, 2]]"), "--footprint"),
        ("circle = { x = 1, y = 0, radius = 1 }", ("--check", "zones.other.events == 0"), "other"),
        ("circle = { x = 1, y = 0, radius = 1 }", ("--check", "objects == 0"), "objects"),
    ],
)
def test_what_is_refused(lidarcli: Run, log: Path, tmp_path: Path, zone: str, options: tuple[str, ...], cause: str) -> None:
    zones = zones_of(tmp_path, f'[[zone]]\nname = "z"\n{zone}\n')
    ran = lidarcli("zones", log, *zones, *options, "-o", tmp_path / "out")
    assert ran.code == 2, ran.err
    assert cause in ran.err
    assert not (tmp_path / "out").exists()


def test_masks_of_the_zone_file_are_masks_of_the_search_for_agents(lidarcli: Run, tmp_path: Path) -> None:
    everywhere = "circle = { x = 0.0, y = 0.0, radius = 100.0 }\n"
    both = zone_file(tmp_path, f'[[zone]]\nname = "all"\n{everywhere}[[mask]]\n{everywhere}')
    ran = lidarcli("zones", SAMPLES / "people.csv.gz", "--zones", both, "-o", tmp_path / "out")
    assert (ran.code, ran.out) == (0, "")
    rows = pq.read_table(tmp_path / "out" / "people.zones.parquet")
    assert rows.num_rows == 80
    assert {name: {*rows[name].to_pylist()} for name in ("points", "things", "agents", "active")} == {
        "points": {0},
        "things": {0},
        "agents": {0},
        "active": {False},
    }
    assert min(rows["masked"].to_pylist()) > 1000
    assert pq.read_table(tmp_path / "out" / "people.events.parquet").num_rows == 0


def test_of_several_logs_each_has_to_have_seen_a_zone(lidarcli: Run, log: Path, tmp_path: Path) -> None:
    ahead = raw_sweeps(round_room(20, 181), angle_min=-0.5 * np.pi, angle_increment=np.pi / 180)
    half = write_bag(tmp_path / "half.bag", scans([ahead]))
    behind = zone_file(tmp_path, '[[zone]]\nname = "behind"\ncircle = { x = -2.0, y = 0.0, radius = 0.5 }\n')
    check = ("--check", "zones.behind.events == 0")
    assert lidarcli("zones", log, "--zones", behind, "--no-objects", *check).code == 0
    ran = lidarcli("zones", log, half, "--zones", behind, "--no-objects", *check, code=1)
    assert "check failed: zones.behind.events has nothing to measure, expected == 0" in ran.err


@pytest.mark.slow
def test_batches_of_any_size(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    path = Course(np.array([[-2.0, 0.0], [2.0, 0.0], [2.0, 2.0], [-2.0, 2.0]]), speed=1.0)
    scene = scene_of(make.box(1.0, 1.0, 0.5, 0.5), make.box(3.0, 0.0, 0.5, 1.0), path=path, odometry=Odometry(), sweeps=60)
    log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene), odometry_of(scene)))
    zones = zone_file(
        tmp_path,
        '[[zone]]\nname = "a"\nframe = "robot"\naction = "approach"\ncircle = { x = 0, y = 0, radius = 0.4 }\n'
        '[[zone]]\nname = "w"\nframe = "world"\ncircle = { x = 1, y = 1, radius = 0.5 }\n',
    )
    found = []
    for size in (720, 7 * 720, 1 << 20):
        monkeypatch.setattr("lidarcli.logs.batches.BATCH_VALUES", size)
        found.append(package.zones(log, zones=str(zones), no_objects=True))
    assert found[0] == found[1] == found[2]
    assert any(one is not None for one in column(found[0].zones, "ttc", zone="a"))
    assert max(column(found[0].zones, "points", zone="w")) > 10


@pytest.mark.slow
def test_who_is_in_a_zone_counts_before_a_wall(lidarcli: Run, tmp_path: Path) -> None:
    """Of the office the walls are in the zone all of the time, and a person comes nearer than they are."""
    log = tmp_path / "office.mcap"
    assert lidarcli("-q", "simulate", SAMPLES / "office.toml", "-o", log, "--sweeps", "120").code == 0
    zones = tmp_path / "zones.toml"
    zones.write_text('[[zone]]\nname = "near"\ncircle = { x = 0, y = 0, radius = 1.5 }\n', "utf-8")
    check = "events where kind == occupied and set == A == 0"
    ran = lidarcli("zones", log, "--zones", zones, "-o", tmp_path / "out", "--check", check)
    assert ran.code == 1, ran.err
    events = pq.read_table(tmp_path / "out" / "office.events.parquet").to_pylist()
    (occupied,) = (event for event in events if event["kind"] == "occupied")
    (visit,) = (event for event in events if event["kind"] == "visit")
    assert (occupied["set"], occupied["track"]) == ("A", visit["track"])
