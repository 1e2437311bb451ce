"""Several sensors on one robot: what they see is followed once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions, TrackOptions
from lidarcli.pipeline.reading.needs import PoseOptions
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Scene, super_ellipse
from tests.places import SAMPLES
from tests.robots import CORNERS, SIDES, Carried, Place, robot_log, robot_messages
from tests.zones.runs import PARKED, scene_of, walker, write_bag

HALL = make.wall([[-6.0, -5.0], [6.0, -5.0], [6.0, 3.0], [3.0, 3.0], [3.0, 5.0], [-6.0, 5.0], [-6.0, -5.0]])
THINGS = (make.box(-4.5, 3.5, 0.8, 0.5), make.cylinder(4.5, -3.8, 0.25), make.box(5.0, 1.5, 0.5, 0.5))
ROUND = Course(super_ellipse(1.2, 0.9, 2.5), speed=0.5)

Tables = dict[str, pa.Table]


def walked(path: Course = PARKED, sweeps: int = 100) -> Scene:
    """Two walk past the robot, from the view of one sensor into that of the other."""
    people = (walker((-4.5, 2.4), (4.0, 2.6)), walker((4.5, -2.6), (-4.0, -2.4)))
    return scene_of(*THINGS, *people, room=(HALL,), sweeps=sweeps, path=path)


def tracked(log: Path, capsys: pytest.CaptureFixture[str], *more: str) -> tuple[Tables, list[str]]:
    """The tables of a log, and the notes."""
    assert run(["-v", "track", str(log), "-o", str(log.parent), "--overwrite", *more]) == 0
    lines = capsys.readouterr().err.splitlines()
    names = ("objects", "sweeps", "tracks", "trajectories")
    tables = {name: pq.read_table(log.parent / f"{log.stem}.{name}.parquet") for name in names}
    return tables, [line.split(None, 1)[1] for line in lines if line.startswith("  note ")]


def agents_of(tables: Tables) -> list[dict[str, object]]:
    return [row for row in tables["tracks"].to_pylist() if row["set"] == "A"]


def seen_once(tables: Tables) -> tuple[int, int]:
    """How many pairs of sweeps at about one time that both see an agent give it one number, and how many there are."""
    rows = [row for row in tables["objects"].to_pylist() if row["set"] == "A"]
    once = every = 0
    for one in rows:
        for other in rows:
            if one["topic"] >= other["topic"] or abs((one["stamp"] - other["stamp"]).total_seconds()) > 0.04:
                continue
            if np.hypot(one["world_x"] - other["world_x"], one["world_y"] - other["world_y"]) < 0.4:
                every += 1
                once += one["track"] == other["track"]
    return once, every


@pytest.mark.slow
@pytest.mark.parametrize("odometry", [True, False], ids=["odometry", "none"])
@pytest.mark.parametrize("path", [PARKED, ROUND], ids=["stands", "drives"])
@pytest.mark.parametrize("carried", [CORNERS, SIDES], ids=["corners", "sides"])
def test_who_is_seen_by_several_is_one_track(
    carried: Sequence[Carried], path: Course, odometry: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = robot_log(tmp_path / "run.bag", walked(path), carried, odometry=odometry)
    tables, notes = tracked(log, capsys)
    names = " and ".join(sorted(f"/{one.name}" for one in carried))
    world = "on a robot that stands" if path.parked else "in odom" if odometry else "in match"
    assert f"{names} are taken together, {world}; track --apart takes each by itself" in notes
    agents = agents_of(tables)
    assert len(agents) == 2
    assert [(row["topic"], row["frame_id"]) for row in agents] == [(None, None)] * 2
    assert min(row["duration"] for row in agents) > 6.0
    assert max(row["hidden"] for row in agents) < 2.0
    once, every = seen_once(tables)
    assert once >= 0.95 * every > 20
    # A row at the sweeps of each, whoever sees it.
    paths = tables["trajectories"].to_pylist()
    for row in agents:
        mine = [one for one in paths if one["track"] == row["track"]]
        assert {one["topic"] for one in mine} == {f"/{one.name}" for one in carried}
        stamps = [one["stamp"] for one in mine]
        assert stamps == sorted(stamps)
    apart, notes = tracked(log, capsys, "--apart")
    assert not any("together" in note for note in notes)
    assert len(agents_of(apart)) > 2
    assert not apart["tracks"]["topic"].null_count


@pytest.mark.slow
@pytest.mark.parametrize("path", [PARKED, ROUND], ids=["stands", "drives"])
@pytest.mark.parametrize("off", [(0.02, 0.0, 0.0), (0.0, -0.02, 0.0), (0.0, 0.0, 0.0165)])
def test_a_mount_that_is_off_a_little_does_no_harm(
    off: Place, path: Course, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = robot_log(tmp_path / "run.bag", walked(path), (CORNERS[0], CORNERS[1]._replace(off=off)))
    tables, notes = tracked(log, capsys)
    assert any("taken together" in note for note in notes)
    assert len(agents_of(tables)) == 2
    once, every = seen_once(tables)
    assert once >= 0.95 * every > 20


@pytest.mark.slow
@pytest.mark.parametrize("path", [PARKED, ROUND], ids=["stands", "drives"])
@pytest.mark.parametrize("off", [(0.1, 0.0, 0.0), (0.0, 0.0, 0.1), (0.6, -0.3, 0.0), (0.0, 0.0, np.pi)])
def test_a_mount_that_is_wrong_is_told_and_each_is_followed_by_itself(
    off: Place, path: Course, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = robot_log(tmp_path / "run.bag", walked(path), (CORNERS[0], CORNERS[1]._replace(off=off)))
    tables, notes = tracked(log, capsys)
    assert sum("/rear is followed apart: " in note for note in notes) == 1
    assert not tables["tracks"]["topic"].null_count


@pytest.mark.slow
def test_mounts_of_a_file_count_before_those_of_the_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with ZipFile(SAMPLES / "two_lasers.zip") as packed:
        packed.extractall(tmp_path)
    mount = '[[mount]]\nframe = "{}"\nparent = "base_link"\nx = {}\ny = {}\nyaw = {}\n'
    # Followed apart, who leaves the view of a laser comes back as another one.
    for x, agents in ((-0.35, 2), (-0.45, 6)):
        told = tmp_path / "mounts.toml"
        told.write_text(mount.format("front", 0.35, 0.25, 45) + mount.format("rear", x, -0.25, -135), "utf-8")
        tables, notes = tracked(tmp_path / "two_lasers.bag", capsys, "--mask", str(told))
        assert len(agents_of(tables)) == agents
        apart = [note for note in notes if note.startswith("/rear is followed apart: by what both see it is 0.1")]
        assert len(apart) == (agents == 6), notes


def test_without_a_mount_a_line_says_what_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = robot_log(tmp_path / "run.bag", walked(sweeps=30), told=False)
    tables, notes = tracked(log, capsys)
    (note,) = (note for note in notes if "apart" in note)
    assert note == "followed apart: nothing tells where /front, /rear are (info --deep)"
    apart, notes = tracked(log, capsys, "--apart")
    assert not any("apart" in note for note in notes)
    assert all(tables[name].equals(apart[name]) for name in tables)
    mounts = "".join(
        f'[[mount]]\nframe = "{one.name}"\nparent = "base_link"\nx = {one.place[0]}\ny = {one.place[1]}\n'
        f"yaw = {np.degrees(one.place[2])}\n"
        for one in CORNERS
    )
    (tmp_path / "mounts.toml").write_text(mounts)
    _, notes = tracked(log, capsys, "--mask", str(tmp_path / "mounts.toml"))
    assert any("/front and /rear are taken together" in note for note in notes)


def test_the_same_rows_for_any_batch_size(tmp_path: Path) -> None:
    log = robot_log(tmp_path / "run.bag", walked(ROUND, 60), (CORNERS[0], SIDES[1]))
    found = {}
    for size in (768, 7):
        options = DetectOptions(
            read=ReadOptions(batch_size=size), poses=PoseOptions(together=True), tracking=TrackOptions(), overwrite=True
        )
        detect_to_files(Source(str(log), "run"), tmp_path, options)
        found[size] = {path.name: pq.read_table(path) for path in tmp_path.glob("run.*.parquet")}
    assert len(found[7]) == 4
    assert any(row["topic"] is None for row in found[7]["run.tracks.parquet"].to_pylist())
    for name, table in found[768].items():
        assert table.equals(found[7][name]), name


def test_what_both_see_is_cleaned_from_both(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = robot_log(tmp_path / "run.bag", walked())
    assert run(["clean", str(log), "-o", str(tmp_path / "clean.bag")]) == 0
    removed = pq.read_table(tmp_path / "clean.cleaned.parquet").to_pandas().groupby("topic")["agents"].sum()
    assert removed["/front"] > 500
    assert removed["/rear"] > 500


def test_a_visit_is_one_whoever_sees_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = robot_log(tmp_path / "run.bag", walked())
    zone = '[[zone]]\nname = "beside"\nframe = "robot"\npolygon = [[3.0, 1.5], [3.0, 3.5], [-3.0, 3.5], [-3.0, 1.5]]\n'
    line = '[[zone]]\nname = "line"\nframe = "robot"\nline = [[0.0, 1.0], [0.0, 4.0]]\n'
    (tmp_path / "zones.toml").write_text(zone + line)
    assert run(["zones", str(log), "--zones", str(tmp_path / "zones.toml"), "-o", str(tmp_path)]) == 0
    events = pq.read_table(tmp_path / "run.events.parquet").to_pylist()
    assert [event["zone"] for event in events if event["kind"] in ("visit", "crossing")] == ["beside", "line"]
    assert max(pq.read_table(tmp_path / "run.zones.parquet")["agents"].to_pylist()) == 1
    (visit,) = (event for event in events if event["kind"] == "visit")
    assert visit["duration"] == pytest.approx(6.2, abs=0.5)


@pytest.mark.parametrize(("path", "world"), [(ROUND, "match"), (PARKED, "robot")], ids=["drives", "stands"])
def test_one_map_of_what_all_see(path: Course, world: str, tmp_path: Path) -> None:
    scene = scene_of(*THINGS, room=(HALL,), sweeps=80, path=path)
    one, both = (
        lidarcli.map(robot_log(tmp_path / f"{len(carried)}.bag", scene, carried, odometry=False))
        for carried in (CORNERS[:1], CORNERS)
    )
    assert both.frame_id == world
    # Walls that do not lie on each other would be twice as many cells.
    walls, more = (np.count_nonzero(grid.cells == 100) for grid in (one, both))
    assert walls < more < 1.7 * walls


def test_each_of_two_robots_has_tracks_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Their frames have the same names; no two shared tracks have one number."""
    beside = Course(np.array([[1.5, 0.5]]), 0.0, 0.4)
    robots = [robot_messages(walked(path), space=space) for space, path in (("/r1", PARKED), ("/r2", beside))]
    tables, notes = tracked(write_bag(tmp_path / "run.bag", *robots[0], *robots[1]), capsys)
    assert sum("/front and /r" in note and "are taken together" in note for note in notes) == 2
    numbers = {
        space: {row["track"] for row in tables["objects"].to_pylist() if row["topic"].startswith(space) and row["track"]}
        for space in ("/r1", "/r2")
    }
    assert numbers["/r1"].isdisjoint(numbers["/r2"])
    assert sorted(tables["tracks"]["track"].to_pylist()) == sorted(numbers["/r1"] | numbers["/r2"])
    assert len(agents_of(tables)) == 4


@pytest.mark.slow
@pytest.mark.parametrize("path", [PARKED, ROUND], ids=["stands", "drives"])
def test_what_any_of_them_sees_is_compared(path: Course, tmp_path: Path) -> None:
    """Behind the robot, where one sensor alone looks, a cupboard is gone from one place and new in another."""
    logs = [
        robot_log(tmp_path / f"{y}.bag", scene_of(*THINGS, make.box(-3.5, y, 0.9, 0.6), room=(HALL,), path=path))
        for y in (-3.0, 1.0)
    ]
    found = [row for row in lidarcli.diff(*logs).changes.to_pylist() if row["status"] != "known"]
    assert [row["status"] for row in found] in (["moved"], ["gone", "new"], ["new", "gone"])
