"""`lidarcli background`, `info` of what it writes, and `detect --background`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import lidarcli as package
from lidarcli.cli import run
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import RawSweeps
from tests.sweeping import raw_sweeps, round_room

Run = Callable[..., Any]


def empty_room(count: int = 20, beams: int = 360, frame: str = "laser", first: float = -np.pi) -> RawSweeps:
    """The round room of `room_sweeps` before anybody put a box into it."""
    ranges = round_room(count, beams)
    ranges[:, 10] = np.inf
    return raw_sweeps(ranges, frame_ids=(frame,), angle_min=first, angle_increment=np.float32(2 * np.pi / 360))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `empty.mcap` and its background, `empty.parquet`."""
    folder = tmp_path_factory.mktemp("scene")
    write_log(folder / "empty.mcap", [empty_room()])
    package.background(folder / "empty.mcap", folder / "empty.parquet")
    return folder


def notes(text: str) -> list[str]:
    return [line.removeprefix("  note     ") for line in text.splitlines() if line.startswith("  note")]


def test_build_says_what_it_learned(scene: Path, tmp_path: Path, lidarcli: Run) -> None:
    file = tmp_path / "new" / "b.parquet"
    ran = lidarcli("background", "build", scene / "empty.mcap", "-o", file)
    assert (ran.code, ran.out) == (0, "")
    lines = ran.err.splitlines()
    assert lines[0].startswith(f"{scene / 'empty.mcap'}: 20 sweeps")
    assert lines[1:] == [
        "  /scan (frame laser): 1 station of 360 beams, 20 sweeps",
        "  beams    surface 359 (99.7%), open 1 (0.3%), unknown 0 (0.0%); spread 0.000 m, support 100.0%",
        f"  wrote    {file}",
    ]
    assert file.read_bytes() == (scene / "empty.parquet").read_bytes()
    table = pq.read_table(file)
    assert table.num_rows == 360
    assert table["r_e"].to_pylist()[8:13] == [4.0, 4.0, np.inf, 4.0, 4.0]
    assert json.loads(table.schema.metadata[b"lidarcli.source"])[0]["name"] == "empty.mcap"
    parameters = json.loads(table.schema.metadata[b"lidarcli.parameters"])
    assert (parameters["station_distance"], parameters["every"]) == (0.25, 1)


def test_several_logs_make_one_background(scene: Path, logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    """The boxes are in 20 and 10 of 60 sweeps: fewer than a background needs."""
    write_log(tmp_path / "more.mcap", [empty_room(count=20)])
    inputs = (scene / "empty.mcap", tmp_path / "more.mcap", logs / "run.mcap")
    ran = lidarcli("background", "build", *inputs, "-o", tmp_path / "b.parquet", code=0)
    assert "  /scan (frame laser): 1 station of 360 beams, 60 sweeps" in ran.err.splitlines()
    table = pq.read_table(tmp_path / "b.parquet")
    r_e = np.array(table["r_e"].to_pylist())
    assert np.array_equal(np.isinf(r_e), np.arange(360) == 10)
    assert r_e[np.isfinite(r_e)] == pytest.approx(4.0)
    assert table["support"].to_pylist()[45] == pytest.approx(2 / 3)


def test_a_damaged_log_teaches_what_is_whole(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli("background", "build", logs / "cut.mcap", "-o", tmp_path / "b.parquet", code=3)
    assert ran.err.splitlines()[0].startswith(f"lidarcli: {logs / 'cut.mcap'}: ")
    metadata = pq.read_schema(tmp_path / "b.parquet").metadata
    assert json.loads(metadata[b"lidarcli.damage"])[0].startswith("cut.mcap: ")
    shown = lidarcli("info", tmp_path / "b.parquet")
    assert "  damage        cut.mcap: " in shown.out


def crowd(count: int = 60) -> RawSweeps:
    """The empty room with people before 40 of the beams in two sweeps of three, nowhere for long."""
    room = empty_room(count)
    room.ranges[count // 3 :, 100:140] = np.random.default_rng(1).uniform(0.5, 3.5, (count - count // 3, 40))
    return room


def drifting(count: int = 60) -> RawSweeps:
    """The round room, seen by a sensor that goes from one of its sides to the other."""
    bearing = np.arange(360) * 2 * np.pi / 360
    place = np.linspace(-3.0, 3.0, count)[:, None]
    way = -place * np.cos(bearing)
    ranges = way + np.sqrt(way**2 - place**2 + 16.0)
    return raw_sweeps(ranges.astype(np.float32), angle_increment=np.float32(2 * np.pi / 360))


def test_a_sensor_that_moved_without_poses_is_told(tmp_path: Path, lidarcli: Run) -> None:
    write_log(tmp_path / "moved.mcap", [drifting()])
    file = tmp_path / "b.parquet"
    ran = lidarcli("background", "build", tmp_path / "moved.mcap", "-o", file, "--pose", "none")
    (note,) = [line for line in ran.err.splitlines() if line.startswith("note: ")]
    assert ran.code == 0
    assert note.startswith("note: the sensor of /scan (laser) seems to have moved, or to have stood in several places: ")
    assert note.endswith(
        " of 360 beams do not see the same range in 80% of the sweeps; poses are needed (--pose TOPIC, docs/poses.md), "
        "or logs of a sensor parked in one place (--start, --end)"
    )
    assert f"  note          {note.removeprefix('note: ')}" in lidarcli("info", file).out.splitlines()
    (told_of,) = json.loads(lidarcli("info", file, "--format", "json").out)
    (sensor,) = told_of["sensors"]
    assert sensor["seems_moved"] is True


def test_a_background_of_another_place_is_told(scene: Path, tmp_path: Path, lidarcli: Run) -> None:
    other = empty_room()
    other.ranges[:, 20:] = 6.0
    write_log(tmp_path / "other.mcap", [other])
    write_log(tmp_path / "moved.mcap", [drifting()])
    write_log(tmp_path / "crowd.mcap", [crowd()])
    told = []
    for name in ("other", "moved", "crowd", "../empty"):
        log = scene / "empty.mcap" if name == "../empty" else tmp_path / f"{name}.mcap"
        ran = lidarcli("detect", log, "--background", scene / "empty.parquet", "-o", "-", "--format", "csv", code=0)
        told.append([note for note in notes(ran.err) if "differ from" in note])
    assert told[0] == [
        "95% of the ranges of frame laser differ from empty.parquet: it is of another place, or the sensor moved"
    ]
    assert len(told[1]) == 1
    # A crowd is no other place.
    assert told[2:] == [[], []]


def test_info_for_programs(scene: Path, lidarcli: Run) -> None:
    (told,) = json.loads(lidarcli("info", scene / "empty.parquet", "--format", "json").out)
    assert [*told] == ["path", "format", "version", "source", "parameters", "damage", "sensors"]
    assert (told["path"], told["format"]) == (str(scene / "empty.parquet"), "background")
    (source,) = told["source"]
    assert (source["format"], source["name"]) == ("mcap", "empty.mcap")
    assert source["poses"] == {"laser": {"pose_verdict": {"/scan": "none"}}}
    assert told["parameters"]["start"] is None
    (sensor,) = told["sensors"]
    assert (sensor["stations"], sensor["posed"], sensor["sweeps"], sensor["open"]) == (1, False, 20, 1)
    assert (sensor["range_max"], sensor["r_e_min"]) == (12.0, 4.0)


def test_info_knows_a_background_by_its_content(scene: Path, tmp_path: Path, lidarcli: Run) -> None:
    (tmp_path / "empty.table").write_bytes((scene / "empty.parquet").read_bytes())
    assert "  /scan (frame laser)\n    beams       360" in lidarcli("info", tmp_path / "empty.table").out
    # One that is cut off, and another table.
    (tmp_path / "cut.parquet").write_bytes((scene / "empty.parquet").read_bytes()[:500])
    pq.write_table(pq.read_table(scene / "empty.parquet", columns=["r_e"]), tmp_path / "part.parquet")
    for name, cause in (("cut", "no background: "), ("part", "not a table of lidarcli background build: no column ")):
        ran = lidarcli("info", tmp_path / f"{name}.parquet", scene / "empty.parquet")
        assert (ran.code, len(ran.err.splitlines())) == (3, 1)
        assert ran.err.startswith(f"lidarcli: {tmp_path / name}.parquet: {cause}")
        assert ran.out == lidarcli("info", scene / "empty.parquet").out


@pytest.mark.parametrize(
    "options", [("--beams",), ("--removed", "--any-frame", "--station-angle", "8"), ("--walls", "--memory")]
)
def test_subtract_writes_the_bytes_of_detect(
    scene: Path, logs: Path, tmp_path: Path, lidarcli: Run, options: tuple[str, ...]
) -> None:
    asked = (logs / "run.mcap", "--background", scene / "empty.parquet", *options)
    said = [lidarcli("detect", *asked, "-o", tmp_path), {path.name: path.read_bytes() for path in tmp_path.iterdir()}]
    again = [
        lidarcli("background", "subtract", *asked, "-o", tmp_path, "--overwrite"),
        {path.name: path.read_bytes() for path in tmp_path.iterdir()},
    ]
    assert said == again
    assert said[0].code == 0
    for words in (("detect",), ("background", "subtract")):
        assert lidarcli(*words, *asked[:3], "-o", "-").out.count('"change":"appeared"') == 30


def test_detect_finds_what_is_new(scene: Path, logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli("detect", logs / "run.mcap", "--background", scene / "empty.parquet", "-o", tmp_path, "--beams", code=0)
    assert notes(ran.err) == ["compared with empty.parquet: 30 appeared"]
    objects = pq.read_table(tmp_path / "run.objects.parquet")
    assert objects["beam_i"].to_pylist() == [40, 200] * 10 + [40] * 10
    assert objects["change"].to_pylist() == ["appeared"] * 30
    assert objects["difference"].to_pylist() == pytest.approx([-2.0, -2.5] * 10 + [-2.0] * 10)
    swept = pq.read_table(tmp_path / "run.sweeps.parquet")
    assert swept["station"].to_pylist() == [0] * 20
    sums = [swept[name].to_numpy() for name in ("object_beams", "agent_beams", "noise_beams")]
    assert sum(sums).tolist() == swept["beams"].to_pylist()
    beams = pq.read_table(tmp_path / "run.beams.parquet")
    assert beams["difference"].to_pylist()[38:42] == pytest.approx([0.0, 0.0, -2.0, -2.0])
    assert beams["difference"].to_pylist()[10] == pytest.approx(0.0)
    parameters = json.loads(objects.schema.metadata[b"lidarcli.parameters"])
    assert parameters["max_width"] is None
    assert parameters["background"]["file"] == "empty.parquet"


def test_what_has_gone_is_there_when_it_is_asked_for(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    """The background of the first second, in which the second box had not left."""
    early = tmp_path / "early.parquet"
    assert lidarcli("-q", "background", "build", logs / "run.mcap", "-o", early, "--end", "0.95").code == 0
    common = ("detect", logs / "run.mcap", "--background", early, "-o", tmp_path, "--overwrite")
    assert notes(lidarcli(*common).err) == ["compared with early.parquet: 0 appeared"]
    ran = lidarcli(*common, "--removed", "--beams")
    assert ran.err.splitlines()[0] == f"{logs / 'run.mcap'}: 20 sweeps, 0 objects"
    assert notes(ran.err) == ["compared with early.parquet: 0 appeared, 10 removed"]
    # What has gone is no object of the sweep: its beams end on the wall behind it.
    sweeps, beams = (pq.read_table(tmp_path / f"run.{table}.parquet") for table in ("sweeps", "beams"))
    assert {*sweeps["objects"].to_pylist(), *sweeps["object_beams"].to_pylist()} == {0}
    assert sweeps["noise_beams"].to_pylist() == sweeps["beams"].to_pylist()
    assert {*beams["set"].to_pylist()} == {"S"}
    assert beams["object"].null_count == beams.num_rows
    objects = pq.read_table(tmp_path / "run.objects.parquet")
    assert objects["sweep"].to_pylist() == list(range(10, 20))
    assert set(objects["change"].to_pylist()) == {"removed"}
    assert set(objects["beam_i"].to_pylist()) == {200}
    assert objects["r_i"].to_pylist() == pytest.approx([1.5] * 10)
    assert objects["difference"].to_pylist() == pytest.approx([2.5] * 10)


def test_another_frame_is_refused_unless_told(scene: Path, tmp_path: Path, lidarcli: Run) -> None:
    write_log(tmp_path / "rear.mcap", [empty_room(frame="rear")])
    subtract = ("detect", tmp_path / "rear.mcap", "--background", scene / "empty.parquet")
    ran = lidarcli(*subtract, "-o", tmp_path, code=2)
    assert ran.err == (
        f"lidarcli: {tmp_path / 'rear.mcap'}: frame rear of /scan is not in empty.parquet, which holds laser (/scan); "
        "--topic chooses what to read, --any-frame takes the background all the same\n"
    )
    assert list(tmp_path.glob("*.parquet")) == []
    assert lidarcli(*subtract, "-o", tmp_path, "--any-frame").code == 0


def lap(folder: Path, name: str, shift: float = 0.0) -> Path:
    """A log of a robot that drives past things, with odometry; `shift` moves all of what it says."""
    scene = f"""
[scene]
sweeps = 40
[sensor]
beams = 361
angle_min = -180
angle_max = 180
rate = 5
[robot]
waypoints = [[{shift}, 0], [{shift + 2}, 0], [{shift + 2}, 2], [{shift}, 2]]
speed = 0.5
[robot.odometry]
[[wall]]
points = [[{shift - 2}, -2], [{shift + 4}, -2], [{shift + 4}, 4], [{shift - 2}, 4]]
closed = true
"""
    (folder / f"{name}.toml").write_text(scene, encoding="utf-8")
    assert run(["-q", "simulate", str(folder / f"{name}.toml"), "-o", str(folder / f"{name}.mcap")]) == 0
    return folder / f"{name}.mcap"


def test_a_moving_sensor_has_stations(tmp_path: Path, lidarcli: Run) -> None:
    log, route = lap(tmp_path, "lap"), tmp_path / "route.parquet"
    ran = lidarcli("background", "build", log, "-o", route, "--station-distance", "0.35", "--station-angle", "10", code=0)
    table = pq.read_table(route).to_pandas()
    stations = table.groupby("station").first()
    assert 9 < len(stations) < 20
    assert stations.sweeps.sum() == 40
    assert stations.pose_x.between(0, 2).all()
    shown = lidarcli("info", route).out
    assert "sweeps within 0.35 m and 10 deg" in shown
    ran = lidarcli("detect", log, "--background", route, "-o", tmp_path, "--removed")
    assert notes(ran.err) == ["compared with route.parquet: 0 appeared, 0 removed"]
