"""`lidarcli plot --view map`: the run from above as a picture."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.errors import OptionError
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.mapping import MapOptions
from lidarcli.pipeline.plotting import take_map
from lidarcli.reports.columns import Rows
from lidarcli.reports.map_picture import overview
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Odometry
from tests.places import SAMPLES
from tests.zones.runs import odometry_of, scans, scene_of, sweeps_of, walker, write_bag

Run = Callable[..., Any]
DRIVE = SAMPLES / "drive.db3"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def words_of(path: Path) -> str:
    """All that is written in an SVG, where text is text."""
    return "\n".join(re.findall(r"<text[^>]*>(.*?)</text>", path.read_text("utf-8")))


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `track` says of the sample."""
    from lidarcli.cli import run

    folder = tmp_path_factory.mktemp("tables")
    assert run(["-q", "track", str(DRIVE), "-o", str(folder)]) == 0
    return folder / "drive.tracks.parquet"


@pytest.mark.slow
def test_every_format_and_what_is_said(lidarcli: Run, tmp_path: Path) -> None:
    for suffix, start in (("png", b"\x89PNG\r\n"), ("svg", b"<?xml")):
        out, again = (tmp_path / f"{name}.{suffix}" for name in "ab")
        ran = lidarcli("plot", DRIVE, "--view", "map", "-o", out)
        assert (ran.code, ran.out) == (0, "")
        assert ran.err.splitlines() == [f"  wrote    {out}"]
        ran = lidarcli("-q", "plot", DRIVE, "--view", "map", "-o", again)
        assert (ran.code, ran.out, ran.err) == (0, "", "")
        assert out.read_bytes().startswith(start)
        assert out.read_bytes() == again.read_bytes()
    words = words_of(tmp_path / "a.svg")
    assert "path of the sensor" in words
    assert "path of the sensor: start" in words
    assert "drive  frame odom" in words


def source() -> Source:
    (found,) = find_logs([str(DRIVE)])
    assert isinstance(found, Source)
    return found


def test_points_of_a_sweep_lie_on_the_map() -> None:
    drawn = take_map(source(), MapOptions(min_move=0.2), sweeps=[70, 5])
    assert [picture.snapshot.sweep for picture in drawn.pictures if picture.snapshot] == [70, 5]
    for picture in drawn.pictures:
        grid, shot = picture.grid, picture.snapshot
        assert grid is not None
        assert shot is not None
        column = np.floor((shot.points[:, 0] - grid.x) / grid.resolution).astype(int)
        row = np.floor((shot.points[:, 1] - grid.y) / grid.resolution).astype(int)
        near = [(grid.cells[j - 1 : j + 2, i - 1 : i + 2] == 100).any() for i, j in zip(column, row, strict=True)]
        assert len(near) > 300
        assert np.mean(near) > 0.94
        assert len(shot.boxes) >= 2
        (path,) = picture.paths
        assert np.hypot(*(path - shot.pose[:2]).T).min() < 0.21


def test_tracks(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    ran = lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "-o", tmp_path / "m.svg")
    assert ran.code == 0
    assert "what stands" in words_of(tmp_path / "m.svg").splitlines()
    drawn = take_map(source(), MapOptions(), tracks=str(tables))
    (picture,) = drawn.pictures
    assert len(picture.boxes) >= 5
    assert [mark for mark in words_of(tmp_path / "m.svg").splitlines() if mark.startswith("path")] == [
        "path of the sensor",
        "path of the sensor: start",
    ]
    assert all(-4.6 < box.x < 4.6 and -3.6 < box.y < 3.6 for box in picture.boxes)


@pytest.mark.slow
def test_tables_of_another_world(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    out = tmp_path / "m.png"
    ran = lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "--pose", "match", "-o", out)
    assert (ran.code, ran.err.splitlines()[-1]) == (
        2,
        f"lidarcli: {tables}: tracked in another world (frame odom) than that of the map (path matched from the sweeps); "
        "give both commands the same --pose",
    )
    assert not out.exists()


def test_tables_without_poses(lidarcli: Run, tmp_path: Path) -> None:
    assert lidarcli("-q", "track", DRIVE, "-o", tmp_path, "--pose", "none").code == 0
    tables = tmp_path / "drive.tracks.parquet"
    ran = lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "-o", tmp_path / "m.png")
    assert (ran.code, ran.out, ran.err) == (
        2,
        "",
        f"lidarcli: {tables}: its sweeps have no poses: things have no place in the world; give track and plot the same "
        "--pose\n",
    )
    assert not (tmp_path / "m.png").exists()


@pytest.mark.slow
def test_the_world_of_a_sensor_that_stands_without_poses_is_its_frame(lidarcli: Run, tmp_path: Path) -> None:
    people = SAMPLES / "people.csv.gz"
    assert lidarcli("-q", "track", people, "-o", tmp_path).code == 0
    tracks = pq.read_table(tmp_path / "people.tracks.parquet").to_pylist()
    (log,) = find_logs([str(people)])
    assert isinstance(log, Source)
    (picture,) = take_map(log, MapOptions(), tracks=str(tmp_path)).pictures
    stand = {(row["x"], row["y"]) for row in tracks if row["set"] == "O"}
    assert {(box.x, box.y) for box in picture.boxes} <= stand
    assert len(picture.boxes) >= 2
    assert [number for number, _ in picture.agents] == [row["track"] for row in tracks if row["set"] == "A"]
    ways = pq.read_table(tmp_path / "people.trajectories.parquet").to_pylist()
    for number, path in picture.agents:
        # Of what nobody saw there is a break in the line.
        x, y = path[np.isfinite(path[:, 0])].T
        mine = [(row["x"], row["y"]) for row in ways if row["track"] == number]
        assert [*zip(x.tolist(), y.tolist(), strict=True)] == mine
    # Of a sensor that drives nobody knows where its things are, be the path matched or not.
    assert lidarcli("-q", "track", DRIVE, "-o", tmp_path / "none", "--pose", "none").code == 0
    words = ("plot", DRIVE, "--view", "map", "--tracks", tmp_path / "none", "--pose", "match")
    ran = lidarcli(*words, "-o", tmp_path / "m.png")
    assert (ran.code, "things have no place in the world" in ran.err) == (2, True)


@pytest.mark.slow
def test_tracks_of_other_topics_are_left_out(lidarcli: Run, tmp_path: Path) -> None:
    scene = scene_of(
        walker((3.0, -3.0), (3.0, 3.0)),
        make.box(-2.0, 2.0, 0.5, 0.5),
        path=Course(np.array([[0.0, 0.0], [2.0, 0.0]]), speed=0.3),
        odometry=Odometry(),
        sweeps=60,
    )
    log = write_bag(
        tmp_path / "a.bag", scans(sweeps_of(scene), odometry_of(scene)), scans(sweeps_of(scene, topic="/again"))
    )
    assert lidarcli("-q", "track", log, "-o", tmp_path).code == 0
    tracks = pq.read_table(tmp_path / "a.tracks.parquet").to_pylist()
    assert {row["topic"] for row in tracks if row["set"] == "A"} == {"/scan", "/again"}
    (found,) = find_logs([str(log)])
    assert isinstance(found, Source)
    for topic in ("/scan", "/again"):
        read = ReadOptions(topics=frozenset({topic}))
        (picture,) = take_map(found, MapOptions(read), tracks=str(tmp_path)).pictures
        mine = [row for row in tracks if row["topic"] == topic]
        assert [number for number, _ in picture.agents] == [row["track"] for row in mine if row["set"] == "A"]
        assert [box.name for box in picture.boxes] == [str(row["track"]) for row in mine if row["set"] == "O"]
        assert len(picture.paths) == 1
    assert lidarcli("-q", "track", log, "-o", tmp_path / "one", "--topic", "/scan").code == 0
    words = ("plot", log, "--view", "map", "--topic", "/again", "--tracks", tmp_path / "one")
    ran = lidarcli(*words, "-o", tmp_path / "m.png")
    assert (ran.code, ran.err.splitlines()[-1]) == (
        2,
        f"lidarcli: {tmp_path / 'one'}: no tracks of /again in it; lidarcli track LOG writes them",
    )


def test_tables_of_another_log(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    log = tmp_path / "other.db3"
    log.write_bytes(DRIVE.read_bytes())
    ran = lidarcli("plot", log, "--view", "map", "--tracks", tables, "-o", tmp_path / "m.svg")
    assert (ran.code, ran.err) == (2, f"lidarcli: {tables}: is of the log drive, not of {log}\n")
    assert not (tmp_path / "m.svg").exists()


@pytest.mark.parametrize("sweeps", ["150", "3,400"])
def test_a_sweep_that_is_not_there(lidarcli: Run, tmp_path: Path, sweeps: str) -> None:
    ran = lidarcli("plot", DRIVE, "--view", "map", "--sweeps", sweeps, "-o", tmp_path / "m.png")
    assert (ran.code, ran.out, names(tmp_path)) == (2, "", [])
    assert f"{DRIVE}: no sweep {sweeps.rpartition(',')[2]} with a pose in this log" in ran.err


def test_without_poses(lidarcli: Run, tmp_path: Path) -> None:
    room = SAMPLES / "room.mcap"
    ran = lidarcli("plot", room, "--view", "map", "-o", tmp_path / "m.png", "--pose", "none")
    assert (ran.code, ran.out, len(ran.err.splitlines())) == (3, "", 1)
    assert ran.err.startswith(f"lidarcli: {room}: no poses: --pose none leaves them out; ")
    assert names(tmp_path) == []
    assert lidarcli("plot", room, "--view", "map", "-o", tmp_path / "m.png").code == 0
    assert names(tmp_path) == ["m.png"]


def test_only_some_tracks_are_drawn(tables: Path) -> None:
    drawn = take_map(source(), MapOptions(), tracks=str(tables))
    (picture,) = drawn.pictures
    stands = [box.name for box in picture.boxes]
    assert len(stands) > 1
    (some,) = take_map(source(), MapOptions(), tracks=str(tables), only=[int(stands[0])]).pictures
    assert [box.name for box in some.boxes] == stands[:1]
    assert not some.agents
    with pytest.raises(OptionError, match=r"no track 98, 99 in it \(--only\)"):
        take_map(source(), MapOptions(), tracks=str(tables), only=[99, 98])


def test_density_is_the_time_of_agents_by_place() -> None:
    def table(**columns: Any) -> Rows:
        names = {name for name, values in columns.items() if isinstance(values[0], str)}
        arrays = {name: pa.array(v).dictionary_encode() if name in names else pa.array(v) for name, v in columns.items()}
        return Rows.join([pa.table(arrays)])

    sweeps = table(topic=["/scan"] * 2, sweep=[0, 1], pose_x=[0.0, 0.1], pose_y=[0.0, 0.0])
    sides = {name: [0.1, 0.1] for name in ("yaw", "length", "width")}
    named = {"topic": ["/scan"] * 2, "set": ["A", "O"], "shape": ["legged"] * 2, "label": ["", ""]}
    tracks = table(track=[1, 2], sweeps=[4, 4], x=[0.0, 0.0], y=[0.0, 0.0], **sides, **named)
    # Half a second in one cell and a quarter in the next, where it is hidden then; in a gap nobody saw it, and what stands
    # counts nothing.
    stamps = pa.array([*range(0, 1_500_000_000, 250_000_000), 5_000_000_000, 0], pa.timestamp("ns", "UTC"))
    trajectories = table(
        topic=["/scan"] * 8,
        sweep=[0, 1, 2, 3, 4, 5, 6, 0],
        stamp=stamps,
        track=[1] * 7 + [2],
        frame=["world"] * 8,
        x=[0.1, 0.15, 0.3, 0.3, 0.6, 0.9, 1.9, 9.0],
        y=[0.1] * 8,
        seen=["seen", "seen", "partly", "seen", "hidden", "seen", "seen", "seen"],
    )
    found = overview(sweeps, tracks, trajectories, density=True)
    assert found is not None
    assert found.dwell is not None
    assert found.dwell[:2] == (0.0, 0.0)
    assert found.dwell.seconds.tolist() == [[0.5, 0.25]]
    assert not found.agents
    found = overview(sweeps, tracks, trajectories)
    assert found is not None
    ((number, path),) = found.agents
    assert number == 1
    # No line leads to where it was hidden, from there, or over the gap.
    assert np.flatnonzero(np.isnan(path[:, 0])).tolist() == [4, 6, 8]


@pytest.mark.slow
def test_options_of_tracks_need_them(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    for option in (("--only", "1"), ("--density",)):
        ran = lidarcli("plot", DRIVE, *option)
        assert ran.code == 2
        assert f"{option[0]} is for --view map --tracks TABLE" in ran.err
    out = tmp_path / "some.svg"
    ran = lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "--density", "-o", out)
    assert ran.code == 0
    assert "A" not in pq.read_table(tables, columns=["set"])["set"].to_pylist()
    assert "  note     no agents: --density has nothing to draw" in ran.err.splitlines()
    assert "time of agents in a cell" not in words_of(out)
    assert lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "--only", "1,x").code == 2


def test_tables_of_a_part_are_told(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    for name, part, some in (("end", ("--end", "2s"), "(0.0 s to 1.8 s)"), ("every", ("--every", "2"), " of ")):
        assert lidarcli("-q", "track", DRIVE, "-o", tmp_path / name, *part).code == 0
        of_part = tmp_path / name / "drive.tracks.parquet"
        for more in ((), ("--density",)):
            ran = lidarcli(
                "plot", DRIVE, "--view", "map", "--tracks", of_part, *more, "-o", tmp_path / "a.png", "--overwrite"
            )
            assert ran.code == 0
            (note,) = (line for line in ran.err.splitlines() if "what is in the others is not drawn" in line)
            assert some in note
    ran = lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "-o", tmp_path / "b.png")
    assert "is not drawn" not in ran.err
