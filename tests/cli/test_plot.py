"""`lidarcli plot`: which sweeps are drawn, animations, and the map of a run."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from PIL import Image

from lidarcli.errors import OptionError
from lidarcli.formalism import Parameters
from lidarcli.formalism.detection import SETS
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.pipeline import plotting
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.mapping import MapOptions
from lidarcli.pipeline.plotting import PlotOptions, take_map, take_pictures
from lidarcli.reports.columns import Rows
from lidarcli.reports.map_picture import overview
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Odometry
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular import TRAJECTORIES
from tests.places import SAMPLES
from tests.reports.runs import trajectories
from tests.zones.runs import odometry_of, scans, scene_of, sweeps_of, walker, write_bag

Run = Callable[..., Any]


def test_one_sweep(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "sweep.png"
    ran = lidarcli("plot", logs / "run.mcap", "--sweep", 5, "-o", out)
    assert (ran.code, ran.out, ran.err) == (0, "", f"  wrote    {out}\n")
    with Image.open(out) as image:
        assert image.size == (1440, pytest.approx(805, abs=10))
    assert [path.name for path in out.parent.iterdir()] == ["sweep.png"]
    assert lidarcli("plot", logs / "run.mcap", "-o", out, "--overwrite").code == 0


@pytest.mark.usefixtures("undrawn")
def test_of_several_topics_the_first_is_drawn(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    ran = lidarcli("plot", logs / "two.mcap", "-o", tmp_path / "a.png")
    assert ran.err.splitlines()[0] == "  note     drawn is /front; also available: /rear (--topic NAME)"
    ran = lidarcli("plot", logs / "two.mcap", "--topic", "rear", "-o", tmp_path / "b.png")
    assert ran.err == f"  wrote    {tmp_path / 'b.png'}\n"


@pytest.mark.slow
def test_a_background(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    table = tmp_path / "empty.parquet"
    assert lidarcli("-q", "background", "build", logs / "run.mcap", "-o", table).code == 0
    out = tmp_path / "change.png"
    ran = lidarcli("plot", logs / "run.mcap", "--sweep", 15, "--background", table, "-o", out, code=0)
    assert ran.err.splitlines()[0].startswith("  note     compared with empty.parquet: ")
    with Image.open(out) as image:
        assert image.size == (1440, pytest.approx(1128, abs=10))
    ran = lidarcli("plot", logs / "run.mcap", "--background", logs / "run.mcap", "-o", tmp_path / "b.png")
    way_out = "no Parquet file; give the table of lidarcli background build"
    assert (ran.code, ran.err) == (3, f"lidarcli: {logs / 'run.mcap'}: {way_out}\n")


@pytest.fixture
def tracked(lidarcli: Run, logs: Path, tmp_path: Path) -> Path:
    """The tables of run.mcap, its first box followed by hand."""
    folder = tmp_path / "tables"
    assert lidarcli("-q", "detect", logs / "run.mcap", "-o", folder).code == 0
    path = folder / "run.objects.parquet"
    table = pq.read_table(path)
    rows = table.to_pylist()
    for row in rows:
        if row["object"] == 1:
            row |= {"track": 3, "set": "A", "vx": 0.5, "vy": 0.0, "moving": True, "label": "box"}
    pq.write_table(pa.Table.from_pylist(rows, schema=table.schema), path)
    sweeps = pq.read_table(folder / "run.sweeps.parquet").to_pylist()
    paths = pa.Table.from_pylist(trajectories(sweeps, rows), schema=TRAJECTORIES)
    pq.write_table(paths, folder / "run.trajectories.parquet")
    return path


def test_without_a_name_the_picture_is_named_after_the_log(
    lidarcli: Run, logs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = lidarcli("plot", logs / "run.mcap", "--view", "scene")
    assert (ran.code, ran.out, ran.err) == (0, "", "  wrote    run-0.png\n")
    assert lidarcli("-q", "plot", logs / "run.mcap", "--view", "scene", "--sweeps", "3,4").code == 0
    words = ("--sweeps", "3,4", "--view", "scene", "--animate", "--width", 60, "--dpi", 50)
    ran = lidarcli("plot", logs / "run.mcap", *words)
    assert ran.err == "  wrote    run.gif\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run-0.png", "run-3.png", "run-4.png", "run.gif"]


def test_size_title_and_legend(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    words = ("-q", "plot", logs / "run.mcap", "--sweep", 5, "--view", "scene", "--width", 89, "-o")
    assert lidarcli(*words, tmp_path / "a.png", "--dpi", 100).code == 0
    assert lidarcli(*words, tmp_path / "b.png", "--dpi", 100, "--no-title", "--no-legend").code == 0
    sizes = []
    for name in ("a", "b"):
        with Image.open(tmp_path / f"{name}.png") as image:
            sizes.append(image.size)
    # 89 mm at 100 pixels per inch; without title and legend the scene is as large, and the picture lower.
    assert sizes[0][0] == sizes[1][0] == int(89 / 25.4 * 100) == 350
    assert 40 < sizes[0][1] - sizes[1][1] < 160
    for name, more in (("a", ()), ("b", ("--no-title",)), ("c", ("--no-legend",)), ("d", ("--vertices",))):
        assert lidarcli(*words, tmp_path / f"{name}.svg", *more).code == 0
    texts = {name: words_of(tmp_path / f"{name}.svg") for name in "abcd"}
    # Text is text: it can be edited, and found.
    assert "run.mcap  /scan  sweep 5" in texts["a"]
    assert "run.mcap  /scan  sweep 5" not in texts["b"]
    assert ("walls and rest" in texts["a"], "walls and rest" in texts["c"]) == (True, False)
    assert ("vertex: corner" in texts["a"], "vertex: corner" in texts["d"]) == (False, True)


def words_of(path: Path) -> list[str]:
    """What is written in an SVG."""
    return re.findall(r"<text[^>]*>([^<]*)</text>", path.read_text("utf-8"))


def test_tracks_are_drawn(lidarcli: Run, logs: Path, tracked: Path, tmp_path: Path) -> None:
    words = ("plot", logs / "run.mcap", "--sweep", 5, "--view", "scene", "-o")
    assert lidarcli(*words, tmp_path / "without.svg").code == 0
    for name in (tracked, tracked.with_name("run.sweeps.parquet"), tracked.parent):
        assert lidarcli(*words, tmp_path / "with.svg", "--tracks", name, "--overwrite").code == 0
    without, found = (words_of(tmp_path / f"{name}.svg") for name in ("without", "with"))
    assert ("track: agent" in without, "track: agent" in found) == (False, True)
    # The objects of the sweep have numbers, or their tracks.
    assert ("1" in without, "3 box" in without) == (True, False)
    assert ("1" in found, "3 box" in found) == (False, True)


@pytest.mark.parametrize("kind", ["A", "O"])
def test_what_stands_and_is_hidden_is_not_drawn(
    lidarcli: Run, logs: Path, tracked: Path, tmp_path: Path, kind: str
) -> None:
    rows = pq.read_table(tracked).to_pylist()
    for row in rows:
        row["set"] = kind if row["track"] == 3 else row["set"]
    pq.write_table(pa.Table.from_pylist(rows, schema=pq.read_schema(tracked)), tracked)
    path = tracked.with_name("run.trajectories.parquet")
    places = [row | {"seen": "hidden" if row["sweep"] == 5 else "seen"} for row in pq.read_table(path).to_pylist()]
    pq.write_table(pa.Table.from_pylist(places, schema=TRAJECTORIES), path)
    for number, seen in ((4, True), (5, False)):
        words = ("plot", logs / "run.mcap", "--sweep", number, "--view", "scene", "--tracks", tracked)
        assert lidarcli(*words, "-o", tmp_path / "a.svg", "--overwrite").code == 0
        found = words_of(tmp_path / "a.svg")
        name = {"A": "agent", "O": "object"}[kind]
        assert (f"track: {name}" in found) == seen
        assert (f"track: {name}, hidden" in found) == (not seen and kind == "A")
        assert ("3 box" in found) == (seen or kind == "A")


@pytest.mark.slow
def test_beams_on_agents_are_those_that_the_tables_count(lidarcli: Run, tmp_path: Path) -> None:
    log = SAMPLES / "people.csv.gz"
    assert lidarcli("-q", "track", log, "-o", tmp_path).code == 0
    counted = pq.read_table(tmp_path / "people.sweeps.parquet")["agent_beams"].to_pylist()
    sweeps = (0, 20, 40, 60, 79)
    source = Source(str(log), "people")
    # Also where other options than those of the tables join the legs of a person.
    for parameters in (Parameters(), Parameters(group_gap=0.6)):
        options = PlotOptions(sweeps, parameters=parameters, tracks=str(tmp_path))
        drawn = take_pictures(source, options).pictures
        found = [np.count_nonzero(one.detection.beam_set == SETS.index("A")) for one in drawn]
        assert found == [counted[k] for k in sweeps]
        assert min(found) > 15
    out = tmp_path / "a.svg"
    assert lidarcli("plot", log, "--sweep", 40, "--tracks", tmp_path, "-o", out).code == 0
    assert "beams on agents" in words_of(out)


def test_tracks_that_cannot_be_drawn(lidarcli: Run, logs: Path, tracked: Path, tmp_path: Path) -> None:
    words = ("plot", logs / "run.mcap", "--sweep", 5, "-o", tmp_path / "a.png", "--tracks", tracked)
    sweeps = tracked.with_name("run.sweeps.parquet")
    table = pq.read_table(sweeps)
    pq.write_table(table.slice(0, 5), sweeps)
    ran = lidarcli(*words)
    assert (ran.code, ran.err) == (2, f"lidarcli: {tracked}: no sweep 5 of /scan in it\n")
    paths = tracked.with_name("run.trajectories.parquet")
    pq.write_table(pq.read_table(paths).slice(0, 0), paths)
    ran = lidarcli(*words)
    assert (ran.code, ran.err) == (2, f"lidarcli: {tracked}: no tracks of /scan in it; lidarcli track LOG writes them\n")
    paths.unlink()
    ran = lidarcli(*words)
    assert (ran.code, ran.err.endswith(f"{paths}: not there; lidarcli track writes it\n")) == (3, True)
    sweeps.unlink()
    assert lidarcli(*words).code == 3
    for name in ("a", "b"):
        (tmp_path / f"{name}.objects.parquet").touch()
    ran = lidarcli(*words[:-1], tmp_path)
    assert (ran.code, "holds the tables of 3 logs; name one of them" in ran.err) == (2, True)
    assert not (tmp_path / "a.png").exists()


@pytest.mark.slow
def test_an_animation_of_a_time(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    found = find_logs([str(logs / "run.mcap")])[0]
    assert isinstance(found, Source)
    drawn = plotting.take_pictures(found, plotting.PlotOptions(None, start=0.3, end=0.65))
    stamps = [int(picture.batch.stamp_ns[0]) for picture in drawn.pictures]
    assert [picture.sweep for picture in drawn.pictures] == [3, 4, 5, 6]
    assert (stamps[-1] - stamps[0]) / 1e9 == pytest.approx(0.3)
    words = ("plot", logs / "run.mcap", "--animate", "--view", "scene", "-o", tmp_path / "a.gif")
    ran = lidarcli(*words, "--start", 0.3, "--end", 0.65, "--width", 60)
    assert (ran.code, ran.err) == (0, f"  wrote    {tmp_path / 'a.gif'}\n")
    ran = lidarcli(*words, "--start", 100, "--overwrite")
    assert (ran.code, ran.out) == (2, "")
    assert "no sweep of /scan from 100 s on: its sweeps lie between 0.0 and 1.9 s" in ran.err
    for more in (("--sweeps", "1,2"), ("--sweep", 3)):
        assert lidarcli(*words, *more, "--start", 1, "--overwrite").code == 2


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (("--end", 5, "-o", "a.png"), 2, "--end is for --animate"),
        (("--width", 10, "-o", "a.png"), 2, "'--width'"),
        (("--fps", 60, "--animate", "-o", "a.gif"), 2, "'--fps'"),
        (("--sweep", 20, "-o", "a.png"), 2, "no sweep 20 of /scan: the last one is 19"),
        (("--sweep", -1, "-o", "a.png"), 2, "'--sweep'"),
        (("--sweeps", "1,x", "-o", "a.png"), 2, "'x' is neither a number nor START:STOP"),
        (("--sweeps", "5:5", "-o", "a.png"), 2, "'5:5' holds no sweep"),
        (("--sweeps", "0:9:0", "-o", "a.png"), 2, "'0:9:0' is no number of a sweep"),
        (("--at", 1, "--sweep", "2", "-o", "a.png"), 2, "--at"),
        (("-o", "a.jpg"), 2, "a.jpg: the suffix has to be one of .png, .svg, .pdf"),
        (("--animate", "-o", "a.png"), 2, "a.png: the suffix has to be one of .gif, .mp4"),
        (("--sweeps", "1,2", "-o", "-"), 2, "standard output takes one picture"),
        (("--tracks", "none.tracks.parquet", "-o", "a.png"), 3, "none.tracks.parquet: no such file or folder"),
        (("--topic", "/no", "-o", "a.png"), 4, "run.mcap: no LaserScan topic /no in this log"),
        (("--view", "map", "--background", "x.parquet", "-o", "a.png"), 2, "--background"),
    ],
)
def test_mistakes(lidarcli: Run, logs: Path, arguments: tuple[object, ...], code: int, words: str) -> None:
    ran = lidarcli("plot", logs / "run.mcap", *arguments)
    assert (ran.code, ran.out) == (code, "")
    assert words in ran.err
    assert not Path("a.png").exists()


@pytest.mark.usefixtures("undrawn")
def test_a_damaged_log(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    ran = lidarcli("plot", logs / "cut.mcap", "--sweep", 10, "-o", tmp_path / "a.png")
    assert (ran.code, (tmp_path / "a.png").exists()) == (3, True)
    ran = lidarcli("plot", logs / "cut.mcap", "--sweep", 399, "-o", tmp_path / "b.png")
    assert (ran.code, (tmp_path / "b.png").exists()) == (3, False)
    assert "no sweep 399 of /scan: the last one is" in ran.err
    assert " in the part that could be read; " in ran.err


def test_the_log_is_read_only_up_to_the_sweep(large: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "large.mcap").write_bytes(large)
    seen: list[int] = []

    def counted(log: Log, options: ReadOptions, report: ReadReport) -> Iterator[SweepBatch]:
        for batch in read_batches(log, options, report):
            seen.append(len(batch))
            yield batch

    monkeypatch.setattr(plotting, "read_batches", counted)
    found = find_logs([str(tmp_path / "large.mcap")])[0]
    assert isinstance(found, Source)
    drawn = plotting.take_pictures(found, plotting.PlotOptions((70, 3)))
    assert [picture.sweep for picture in drawn.pictures] == [70, 3]
    assert sum(seen) <= 128


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("time", "sweep"), [("1724ms", 34), ("1726ms", 35), ("2023-11-14T22:13:21.7Z", 34), ("22:13:21.7", 34), ("4.5s", 79)]
)
def test_the_sweep_at_a_time(lidarcli: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, time: str, sweep: int) -> None:
    monkeypatch.chdir(tmp_path)
    ran = lidarcli("plot", SAMPLES / "people.csv.gz", "--at", time, "--view", "sweep", "--dpi", 30)
    assert (ran.code, ran.err.splitlines()[-1]) == (0, f"  wrote    people-{sweep}.png")


@pytest.mark.parametrize(
    ("time", "shown", "nearest"),
    [
        ("9999-01-01", "9999-01-01T00:00:00Z", "sweep 79, is 251,670,764,796.0 s away"),
        ("0001-01-01", "0001-01-01T00:00:00Z", "sweep 0, is 63,835,596,800.0 s away"),
        ("100", "100 s", "sweep 79, is 96.0 s away"),
        ("22:13", "22:13:00 UTC", "sweep 0, is 20.0 s away"),
    ],
)
def test_a_time_without_a_sweep_near_it(lidarcli: Run, time: str, shown: str, nearest: str) -> None:
    """Also where int64 cannot count the nanoseconds between them."""
    log = SAMPLES / "people.csv.gz"
    ran = lidarcli("plot", log, "--at", time)
    assert (ran.code, ran.err) == (2, f"lidarcli: {log}: no sweep of /scan at {shown}: the nearest, {nearest}\n")


def test_a_time_of_day_that_the_log_lacks(lidarcli: Run) -> None:
    log = SAMPLES / "people.csv.gz"
    ran = lidarcli("plot", log, "--at", "22:13:21", "--time-zone", "Europe/Berlin")
    assert (ran.code, ran.err) == (
        2,
        f"lidarcli: {log}: no sweep of /scan at 22:13:21 Europe/Berlin: its sweeps lie between "
        "2023-11-14T23:13:20.000+01:00 and 2023-11-14T23:13:23.950+01:00\n",
    )


@pytest.mark.usefixtures("undrawn")
def test_the_time_zone_is_an_option_and_a_setting(lidarcli: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    words = ("plot", SAMPLES / "people.csv.gz", "--view", "sweep", "--dpi", 30, "--overwrite", "--at")
    ran = lidarcli(*words, "23:13:21.7", "--time-zone", "Europe/Berlin")
    assert (ran.code, ran.err.splitlines()[-1]) == (0, "  wrote    people-34.png")
    (tmp_path / "lab.toml").write_text('time-zone = "+05:30"\n[plot]\nat = 03:43:21.7\n')
    ran = lidarcli("--config", "lab.toml", *words[:-1])
    assert (ran.code, ran.err.splitlines()[-1]) == (0, "  wrote    people-34.png")
    monkeypatch.setenv("LIDARCLI_PLOT_TIME_ZONE", "Mars")
    ran = lidarcli(*words, "22:13:21.7")
    assert (ran.code, ran.err.splitlines()[-1]) == (
        2,
        "Error: Invalid value for '--time-zone': 'Mars' is no time zone: give a name such as Europe/Berlin, an offset such "
        "as +02:00, or local (set in LIDARCLI_PLOT_TIME_ZONE).",
    )


DRIVE = SAMPLES / "drive.db3"


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def labels_of(path: Path) -> str:
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
    words = labels_of(tmp_path / "a.svg")
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
    lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "-o", tmp_path / "m.svg", code=0)
    assert "what stands" in labels_of(tmp_path / "m.svg").splitlines()
    drawn = take_map(source(), MapOptions(), tracks=str(tables))
    (picture,) = drawn.pictures
    assert len(picture.boxes) >= 5
    assert [mark for mark in labels_of(tmp_path / "m.svg").splitlines() if mark.startswith("path")] == [
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
        ran = lidarcli("plot", DRIVE, *option, code=2)
        assert f"{option[0]} is for --view map --tracks TABLE" in ran.err
    out = tmp_path / "some.svg"
    ran = lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "--density", "-o", out, code=0)
    assert "A" not in pq.read_table(tables, columns=["set"])["set"].to_pylist()
    assert "  note     no agents: --density has nothing to draw" in ran.err.splitlines()
    assert "time of agents in a cell" not in labels_of(out)
    assert lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "--only", "1,x").code == 2


def test_tables_of_a_part_are_told(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    for name, part, some in (("end", ("--end", "2s"), "(0.0 s to 1.8 s)"), ("every", ("--every", "2"), " of ")):
        assert lidarcli("-q", "track", DRIVE, "-o", tmp_path / name, *part).code == 0
        of_part = tmp_path / name / "drive.tracks.parquet"
        for more in ((), ("--density",)):
            ran = lidarcli(
                "plot", DRIVE, "--view", "map", "--tracks", of_part, *more, "-o", tmp_path / "a.png", "--overwrite", code=0
            )
            (note,) = (line for line in ran.err.splitlines() if "what is in the others is not drawn" in line)
            assert some in note
    ran = lidarcli("plot", DRIVE, "--view", "map", "--tracks", tables, "-o", tmp_path / "b.png")
    assert "is not drawn" not in ran.err


BACKWARD = """
[sensor]
beams = 360
angle_min = -180.0
angle_max = 179.0
rate = 10.0
[robot.route]
waypoints = [[0.0, 0.0], [3.0, 0.0]]
speed = 0.5
[robot.mount]
x = 0.2
yaw = 180.0
[robot.odometry]
[[wall]]
points = [[-1.0, -2.0], [8.0, -2.0], [8.0, 2.0], [-1.0, 2.0]]
closed = true
"""


def test_a_robot_with_its_laser_mounted_backward_drives_to_the_right(lidarcli: Run, tmp_path: Path) -> None:
    (tmp_path / "back.toml").write_text(BACKWARD)
    log = tmp_path / "back.mcap"
    assert lidarcli("-q", "simulate", tmp_path / "back.toml", "-o", log, "--sweeps", 30).code == 0
    first, last = (one.points for one in take_pictures(Source(str(log), "back"), PlotOptions((0, 29))).pictures)
    # The wall ahead comes nearer, the one behind stays behind.
    assert np.nanmax(first[:, 0]) == pytest.approx(8.0, abs=0.1)
    assert np.nanmax(last[:, 0]) == pytest.approx(8.0 - 29 * 0.05, abs=0.1)
    assert np.nanmin(last[:, 0]) == pytest.approx(-1.0 - 29 * 0.05, abs=0.1)
    out = tmp_path / "a.svg"
    assert lidarcli("-q", "plot", log, "--sweep", 3, "--view", "scene", "-o", out).code == 0
    assert "x in base_link [m]" in words_of(out)


def test_a_track_or_a_zone_is_followed(lidarcli: Run, logs: Path, tracked: Path, tmp_path: Path) -> None:
    (source,) = find_logs([str(logs / "run.mcap")])
    assert isinstance(source, Source)
    # The track ends after half of the sweeps; there the middle stays.
    path = tracked.with_name("run.trajectories.parquet")
    pq.write_table((table := pq.read_table(path)).filter(pc.less(table["sweep"], 10)), path)
    plain = take_pictures(source, PlotOptions((0, 5, 15), tracks=str(tracked))).pictures
    taken = take_pictures(source, PlotOptions((0, 5, 15), tracks=str(tracked), follow="3")).pictures
    assert [one.followed for one in taken] == ["track 3"] * 3
    for one, other in zip(taken[:2], plain, strict=False):
        assert one.middle == pytest.approx(other.paths[0].mark)
        assert one.paths[0].mark == pytest.approx((0.0, 0.0))
    assert not taken[2].paths
    assert taken[2].middle == taken[1].middle
    words = ("plot", logs / "run.mcap", "--view", "scene", "--sweep", 5, "-o", tmp_path / "a.svg")
    assert lidarcli(*words, "--tracks", tracked, "--follow", 3).code == 0
    assert "x from track 3 [m]" in words_of(tmp_path / "a.svg")
    (tmp_path / "zones.toml").write_text('[[zone]]\nname = "gate"\npolygon = [[1, 0], [2, 0], [2, 1], [1, 1]]\n')
    assert lidarcli(*words, "--overwrite", "--zones", tmp_path / "zones.toml", "--follow", "gate").code == 0
    assert "x from zone gate [m]" in words_of(tmp_path / "a.svg")
    ran = lidarcli(*words, "--overwrite", "--tracks", tracked, "--follow", 8)
    assert (ran.code, ran.err) == (
        2,
        f"lidarcli: {logs / 'run.mcap'}: no track or zone 8 in what is drawn, but track 3 (--follow)\n",
    )
