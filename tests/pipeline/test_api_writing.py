"""The functions for Python that write, draw, report or take what is in memory."""

from __future__ import annotations

import io
import re
import shutil
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import OptionError, OutputError, UnreadableError
from lidarcli.pipeline.api.options import several
from lidarcli.sweeps.types import STATUSES
from tests.cli.test_progress import terminal
from tests.places import SAMPLES

ROOM, DRIVE, PEOPLE = SAMPLES / "room.mcap", SAMPLES / "drive.db3", SAMPLES / "people.csv.gz"


@pytest.mark.slow
def test_an_overlay_returns_its_files(tmp_path: Path) -> None:
    mine = tmp_path / "mine.mcap"
    files = lidarcli.overlay(PEOPLE, mine, end=1)
    assert files == [str(mine), str(tmp_path / "mine.layout.json"), str(tmp_path / "mine.rviz")]
    assert lidarcli.overlay(PEOPLE, tmp_path / "mine.bag", end=1, layout=False) == [str(tmp_path / "mine.bag")]
    with pytest.raises(OutputError, match=r"mine\.mcap exists; "):
        lidarcli.overlay(PEOPLE, mine)
    assert run(["-q", "track", str(PEOPLE), "-o", str(tmp_path)]) == 0
    assert len(lidarcli.overlay(PEOPLE, mine, True, objects=tmp_path / "people.objects.parquet")) == 3


@pytest.mark.slow
def test_poses_are_those_of_the_batches(tmp_path: Path) -> None:
    (batch,) = lidarcli.read(DRIVE)
    found = lidarcli.poses(DRIVE)
    assert found.num_rows == 150
    for name in ("x", "y", "yaw"):
        assert found[name].to_pylist() == pytest.approx(getattr(batch.poses, name).tolist())
    # In a file of lines there are as many.
    lines = tmp_path / "drive.tum"
    assert lidarcli.poses(DRIVE, lines, every=3).num_rows == len(lines.read_text().splitlines()) == 50
    with pytest.raises(OutputError):
        lidarcli.poses(DRIVE, lines)
    with pytest.raises(UnreadableError, match=r"no poses: "):
        lidarcli.poses(DRIVE, pose="none")


def test_export_of_files_and_of_memory(tmp_path: Path) -> None:
    found = lidarcli.track(ROOM, end=1)
    file = tmp_path / "room.objects.parquet"
    pq.write_table(found.objects, file)
    outputs = [tmp_path / f"{name}.csv" for name in ("file", "table", "frame", "command")]
    columns = ["log", "sweep", "x", "width"]
    frame = lidarcli.tables(ROOM, end=1).objects
    for tables, output in zip((file, found.objects, frame), outputs, strict=False):
        assert lidarcli.export(tables, output, columns=columns) == found.objects.num_rows
    assert run(["-q", "export", str(file), "-o", str(outputs[3]), "--columns", ",".join(columns)]) == 0
    assert len({output.read_bytes() for output in outputs}) == 1
    assert outputs[0].read_text().splitlines()[0] == "log,sweep,x,width"
    both = tmp_path / "both.arrow"
    assert lidarcli.export([file, found.objects], both, columns="log,x") == 2 * found.objects.num_rows
    with pa.OSFile(str(both)) as source:
        assert pa.ipc.open_stream(source).read_all().column_names == ["log", "x"]
    # Any table will do.
    assert lidarcli.export(frame.groupby("track", as_index=False)["width"].mean(), tmp_path / "mean.csv") == 5
    with pytest.raises(OutputError):
        lidarcli.export(file, outputs[0])
    with pytest.raises(OptionError, match=r"^the table: no column widht; did you mean width\?$"):
        lidarcli.export(frame, tmp_path / "x.csv", columns=["widht"])
    with pytest.raises(OptionError, match=r"x\.xlsx: the suffix of a table has to be one of \.parquet, \.csv"):
        lidarcli.export(frame, tmp_path / "x.xlsx")


def test_a_simulated_log_and_what_is_beside_it(tmp_path: Path) -> None:
    scene = SAMPLES / "room.toml"
    made = lidarcli.simulate(scene, tmp_path / "mine.mcap", sweeps=3, seed=7, map=tmp_path / "true.yaml")
    assert (made.sweeps, made.log.name, made.true_map.name) == (3, "mine.mcap", "true.yaml")
    assert pq.read_table(made.truth)["sweep"].to_pylist()[-1] == 2
    with pytest.raises(OutputError):
        lidarcli.simulate(scene, made.log)
    with pytest.raises(OptionError, match=r"^--sweeps and --duration exclude each other"):
        lidarcli.simulate(scene, made.log, True, sweeps=3, duration=1.0)
    with pytest.raises(TypeError, match=r"^simulate\(\) has no option 'sweep'; did you mean 'sweeps'\?$"):
        lidarcli.simulate(scene, made.log, sweep=3)


def calls_of(name: str, folder: Path) -> dict[str, Any]:
    """What a function that reads a log takes beside it."""
    zone = folder / "near.toml"
    zone.write_text('[[zone]]\nname = "near"\ncircle = { x = 0, y = 0, radius = 2.5 }\n')
    return {"zones": {"zones": zone, "no_objects": True}, "overlay": {"output": folder / "out.mcap"}}.get(name, {})


@pytest.mark.parametrize("name", ["background", "detect", "info", "map", "overlay", "poses", "tables", "track", "zones"])
def test_progress_counts_the_bytes_of_the_log(name: str, tmp_path: Path) -> None:
    seen: list[tuple[int, int | None]] = []
    function, more = getattr(lidarcli, name), calls_of(name, tmp_path)
    function(DRIVE, progress=lambda done, total: seen.append((done, total)), **more)
    size = DRIVE.stat().st_size
    assert seen
    assert {total for _, total in seen} == {size}
    assert all(0 < done <= size for done, _ in seen)
    assert seen[-1][0] == size


def test_progress_of_several_logs_and_of_sweeps(tmp_path: Path) -> None:
    seen: list[tuple[int, int | None]] = []
    tell = lambda done, total: seen.append((done, total))  # noqa: E731
    lidarcli.detect([ROOM, DRIVE], progress=tell)
    size = ROOM.stat().st_size + DRIVE.stat().st_size
    assert seen[-1] == (size, size)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)
    seen.clear()
    lidarcli.simulate(SAMPLES / "room.toml", tmp_path / "room.mcap", sweeps=30, progress=tell)
    assert seen[-1] == (30, 30)
    seen.clear()
    lidarcli.clean(ROOM, tmp_path / "clean.mcap", pose="none", progress=tell)
    assert seen[-1] == (ROOM.stat().st_size,) * 2


@pytest.mark.slow
def test_progress_of_runs_that_are_compared(tmp_path: Path) -> None:
    seen: list[tuple[int, int | None]] = []
    shutil.copy(DRIVE, tmp_path / "again.db3")
    lidarcli.diff(DRIVE, tmp_path / "again.db3", progress=lambda *count: seen.append(count))
    assert seen[-1] == (2 * DRIVE.stat().st_size,) * 2


def test_a_bar_on_standard_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr("lidarcli.display.screen.PATIENCE", 0.0)
    with terminal() as screen:
        lidarcli.detect(ROOM, progress=True)
        lidarcli.simulate(SAMPLES / "room.toml", tmp_path / "room.mcap", sweeps=30, progress=True)
    assert "room" in screen.plain
    assert "100%" in screen.plain
    assert "30/30 sweeps" in screen.plain
    with terminal() as screen:
        lidarcli.detect(ROOM)
    assert screen.text == ""


def test_what_cannot_tell_how_far_it_is() -> None:
    with pytest.raises(TypeError, match=r"^progress is True, False or a function of what is done .*, not 'yes'$"):
        lidarcli.detect(ROOM, progress="yes")
    with pytest.raises(TypeError, match=r"^only a log can be read with progress$"):
        lidarcli.detect(next(lidarcli.read(ROOM)), progress=True)


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tables")
    assert run(["-q", "track", str(ROOM), "-o", str(folder)]) == 0
    return folder


def test_a_report_is_shown_and_written_as_the_command_does(
    tables: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    files = [tmp_path / f"room{suffix}" for suffix in (".md", ".html", ".json", ".xml")]
    report = lidarcli.report(tables, files, log=ROOM)
    for file in files:
        other = tmp_path / f"command{file.suffix}"
        assert run(["-q", "report", str(tables), "--log", str(ROOM), "-o", str(other)]) == 0
        assert file.read_bytes() == other.read_bytes()
    assert run(["-q", "report", str(tables)]) == 0
    assert str(report) == capfd.readouterr().out
    page = report._repr_html_()
    assert page.startswith('<iframe srcdoc="')
    assert unescape(page.partition('srcdoc="')[2].partition('" sandbox')[0]) == files[1].read_text("utf-8")
    # Who has written no page gets one, too.
    assert lidarcli.report(tables, log=ROOM)._repr_html_() == page


def test_what_no_report_can_be_made_of(tables: Path, tmp_path: Path) -> None:
    with pytest.raises(lidarcli.OptionError, match=r"room\.pdf: the suffix names no format \(\.txt \.md "):
        lidarcli.report(tables, tmp_path / "room.pdf")
    with pytest.raises(lidarcli.UnreadableError, match=r"nothing"):
        lidarcli.report(tmp_path / "nothing")
    with pytest.raises(lidarcli.OutputError):
        lidarcli.report(tables, tables / "room.objects.parquet" / "x.md")


def test_paths_may_be_given_by_whatever_holds_several() -> None:
    names = ["a.mcap", "b.mcap"]
    for several_of in (list, set, iter, np.array, pd.Series, lambda each: dict(enumerate(each)).values()):
        assert sorted(several(several_of(names))) == names


def test_tables_in_memory_are_no_paths() -> None:
    with pytest.raises(TypeError, match=r"^logs, files and outputs are named by their paths, not given as Table$"):
        several(pa.table({"log": ["run"]}))
    frame = lidarcli.detect(ROOM, end=0.1).to_pandas()
    with pytest.raises(TypeError, match=r"^logs, files and outputs are .*, not given as DataFrame$"):
        lidarcli.report(frame, frame)
    with pytest.raises(TypeError, match=r"^logs, files and outputs are named by their paths, not given as DataFrame$"):
        lidarcli.report(frame, log=[frame])
    with pytest.raises(TypeError, match=r"^logs, files and outputs are named by their paths, not given as DataFrame$"):
        lidarcli.overlay(ROOM, "x.mcap", objects=frame)


LATER = "no sweep 34 of /scan in this batch, whose sweeps are 0 to 9"
NO_VIEW = "--view: 'top' is not one of all, scene, sweep, map"


def pixels(data: bytes) -> np.ndarray:
    with Image.open(io.BytesIO(data)) as image:
        return np.asarray(image.convert("RGB"))


def test_a_figure_of_a_sweep() -> None:
    figure = lidarcli.plot(ROOM, sweep=34)
    assert isinstance(figure, Figure)
    assert len(figure.axes) == 3
    assert "34" in figure._suptitle.get_text()
    picture = pixels(figure._repr_png_())
    assert picture.shape[0] > 100
    assert (picture != 255).any()
    other = pixels(lidarcli.plot(ROOM, sweep=35)._repr_png_())
    assert picture.shape != other.shape or (picture != other).any()


def test_a_batch_is_drawn_like_its_log(tmp_path: Path) -> None:
    (batch,) = lidarcli.read(ROOM)
    file = tmp_path / "log.svg"
    one = lidarcli.plot(ROOM, 34, file, view="scene", max_width=1.0)
    two = lidarcli.plot(batch, 34, view="scene", max_width=1.0)
    assert one._suptitle.get_text().replace("room.mcap", "room") == two._suptitle.get_text()
    dots = [
        [each.get_xydata().tolist() for each in figure.axes[0].lines if each.get_zorder() == 3] for figure in (one, two)
    ]
    assert sum(map(len, dots[0])) == np.isfinite(batch.ranges[34]).sum()
    assert dots[0] == dots[1]


def test_tables_in_a_file_are_drawn_over_a_batch(tmp_path: Path) -> None:
    assert run(["-q", "track", str(PEOPLE), "-o", str(tmp_path)]) == 0
    (batch,) = lidarcli.read(PEOPLE)
    lidarcli.plot(batch[60], tracks=tmp_path, view="scene", output=tmp_path / "paths.svg")
    assert "track: agent" in (tmp_path / "paths.svg").read_text("utf-8")


def test_the_sweep_at_a_time() -> None:
    expected = lidarcli.plot(ROOM, 34, view="scene")._suptitle.get_text()
    for at in (3.42, "3.42s", "2023-11-14T22:13:23.42Z"):
        assert lidarcli.plot(ROOM, at=at, view="scene")._suptitle.get_text() == expected, at


def test_how_large_it_is_and_what_it_says() -> None:
    figure = lidarcli.plot(ROOM, 34, view="scene", width=89, title=False, legend=False)
    assert figure.get_size_inches()[0] * 25.4 == pytest.approx(89)
    assert figure._suptitle is None
    assert not figure.legends
    title = " ".join(lidarcli.plot(ROOM, 34, view="scene", threshold=0.3)._suptitle.get_text().split())
    assert "$d_{th}$ = 0.3 m (given), " in title


def test_on_axes_that_somebody_has() -> None:
    figure = Figure()
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    right.set_title("mine")
    assert lidarcli.plot(ROOM, 34, view="scene", axes=left) is figure
    assert lidarcli.plot(ROOM, 34, view="sweep", axes=[left, right]) is figure
    assert right.get_title() == "mine"
    assert left.has_data()
    assert right.has_data()


def test_what_cannot_be_drawn() -> None:
    with pytest.raises(OptionError, match="--sweep and --at exclude each other: leave one out"):
        lidarcli.plot(ROOM, 34, at=1.0)
    with pytest.raises(OptionError, match="--at: nan is neither a number of seconds nor a text"):
        lidarcli.plot(ROOM, at=float("nan"))
    (batch,) = lidarcli.read(ROOM, end=1.0)
    axes = Figure().subplots()
    for call, error, words in (
        (lambda: lidarcli.plot(batch, 34), lidarcli.OptionError, LATER),
        (lambda: lidarcli.plot(ROOM, 100), lidarcli.OptionError, f"{ROOM}: no sweep 100 of /scan: the last one is 99"),
        (lambda: lidarcli.plot(SAMPLES), lidarcli.OptionError, f"{SAMPLES}: holds 7 logs; name one of them"),
        (lambda: lidarcli.plot("no.bag"), lidarcli.UnreadableError, "no.bag: no such file or folder"),
        (lambda: lidarcli.plot(batch, topic="/scan"), TypeError, "only a log can be read with topic"),
        (lambda: lidarcli.plot(34), TypeError, "logs, files and outputs are named by their paths, not given as int"),  # type: ignore[arg-type]
        (lambda: lidarcli.plot([]), lidarcli.OptionError, "no log is named"),
        (
            lambda: lidarcli.plot([ROOM, ROOM]),
            lidarcli.OptionError,
            f"{ROOM} and {ROOM}: name one log; --join reads parts of one recording as one log",
        ),
        (
            lambda: lidarcli.plot(batch, axes=axes),
            lidarcli.OptionError,
            "view all has 3 panels, and there are 1 axes for it",
        ),
        (lambda: lidarcli.plot(batch, view="top"), lidarcli.OptionError, NO_VIEW),
    ):
        with pytest.raises(error) as caught:
            call()
        assert str(caught.value) == words


def test_a_sweep_is_named_by_its_number_and_the_only_one_not_at_all() -> None:
    (batch,) = lidarcli.read(ROOM)
    titles = [
        figure._suptitle.get_text().splitlines()[0]
        for figure in (
            lidarcli.plot(batch[50], view="scene"),
            lidarcli.plot(batch[50], 50, view="scene"),
            lidarcli.plot(batch, 50, view="scene"),
            lidarcli.plot(batch[50:52], view="scene"),
        )
    ]
    assert titles == ["room  /scan  sweep 50"] * 4
    with pytest.raises(OptionError, match=r"^no sweep 0 of /scan in this batch, whose sweeps are 50 to 50$"):
        lidarcli.plot(batch[50], 0)


def test_several_sweeps_and_what_moves(tmp_path: Path) -> None:
    (batch,) = lidarcli.read(ROOM)
    look = {"view": "scene", "width": 60, "dpi": 50}
    for log in (ROOM, batch):
        for sweeps in ("3,4", [3, 4], range(3, 5), np.array([3, 4])):
            lidarcli.plot(log, sweeps=sweeps, output=tmp_path / "one.png", **look)  # type: ignore[arg-type]
        lidarcli.plot(log, sweeps="3:6", animate=True, output=tmp_path / f"{type(log).__name__}.gif", fps=20, **look)  # type: ignore[arg-type]
    lidarcli.plot(ROOM, animate=True, start=0.3, end=0.6, output=tmp_path / "part.gif", **look)
    lidarcli.plot(batch[3:6], animate=True, output=tmp_path / "rest.gif", **look)
    names = ["SweepBatch.gif", "one-3.png", "one-4.png", "part.gif", "rest.gif", f"{type(ROOM).__name__}.gif"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    for path in tmp_path.glob("*.gif"):
        with Image.open(path) as film:
            assert film.n_frames == 3, path.name
    with pytest.raises(OutputError):
        lidarcli.plot(ROOM, output=tmp_path / "part.gif", animate=True, overwrite=False, **look)
    for more, words in (
        ({"sweeps": [1, 2]}, "several sweeps are files: name them by output"),
        ({"animate": True}, "several sweeps are files: name them by output"),
        ({"animate": True, "output": "a.png"}, "--output: a.png: the suffix has to be one of .gif, .mp4"),
        ({"sweeps": [1.5]}, "--sweeps: 1.5 is no whole number"),
        ({"sweeps": []}, "--sweeps: no sweep is named"),
        ({"sweep": 1, "start": 1}, "--start is for --animate without --sweep and --sweeps"),
        ({"density": True}, "--density is for --view map --tracks TABLE"),
        ({"view": "map", "axes": Figure().subplots()}, "--view map is a picture of its own, without axes of others"),
    ):
        with pytest.raises(OptionError) as caught:
            lidarcli.plot(ROOM, **more)  # type: ignore[arg-type]
        assert str(caught.value) == words
    with pytest.raises(TypeError, match="zones and maps are drawn of a log, not of a batch"):
        lidarcli.plot(batch, view="map")


def test_a_map_of_the_run_with_tracks_in_memory(tmp_path: Path) -> None:
    tracked = lidarcli.track(PEOPLE, beams=True)
    assert tracked.beams.num_rows == 80 * 1081
    file = tmp_path / "picture.svg"

    def words(**more: Any) -> list[str]:
        lidarcli.plot(PEOPLE, output=file, **more)
        return re.findall(r"<text[^>]*>([^<]*)</text>", file.read_text("utf-8"))

    assert any("time of agents in a cell" in one for one in words(view="map", tracks=tracked, density=True))
    # Numbers are those of tracks and of the axes.
    every, some = (words(view="map", tracks=tracked, only=only) for only in ((), [2]))
    assert [every.count(number) - some.count(number) for number in "246"] == [0, 1, 1]
    assert "track: agent" in words(view="scene", tracks=PEOPLE, at=3)
    assert pixels(lidarcli.plot(DRIVE, view="map")._repr_png_()).shape[0] > 100


def test_beams_of_the_objects_in_memory() -> None:
    objects, beams = lidarcli.detect(ROOM, end=1.0, beams=True)
    assert beams.num_rows == 10 * 361
    assert objects.equals(lidarcli.detect(ROOM, end=1.0))
    assert lidarcli.report(lidarcli.detect(ROOM, end=1.0, beams=True)).figures["sweeps"] == 10
    (batch,) = lidarcli.read(ROOM, end=1.0)
    assert lidarcli.detect(batch, beams=True)[1]["s"].equals(beams["s"])


def test_a_background_is_drawn_and_an_event_explained(tmp_path: Path) -> None:
    lidarcli.background(SAMPLES / "room_empty.mcap", plot=tmp_path / "empty.png")
    with Image.open(tmp_path / "empty.png") as picture:
        assert picture.size[0] > 500
    zones = tmp_path / "near.toml"
    zones.write_text('[[zone]]\nname = "near"\ncircle = { x = 0, y = 0, radius = 2.5 }\n')
    why = tmp_path / "why.html"
    events, _ = lidarcli.zones(PEOPLE, why, zones=zones, explain=3.8)
    assert events.num_rows == 2
    assert "near" in why.read_text("utf-8")
    for more, words in (
        (
            {"output": "a.parquet"},
            "--output: a.parquet is none of .html, .png, .gif, .mp4 for --explain; tables are returned",
        ),
        (
            {"explain": "worst"},
            "--explain writes a page, a picture or a film: give -o why.html, why.png, why.gif or why.mp4",
        ),
    ):
        with pytest.raises(OptionError) as caught:
            lidarcli.zones(PEOPLE, zones=zones, **more)  # type: ignore[arg-type]
        assert str(caught.value) == words


def test_checks_of_a_file_are_held(tmp_path: Path) -> None:
    checks = tmp_path / "checks.toml"
    checks.write_text('checks = ["sweeps >= 10", "objects < 50"]\n')
    report = lidarcli.report(lidarcli.detect(ROOM, end=1.0), check="sweeps == 10", checks=checks)
    assert [each.holds for each in report.checks] == [True, True, False]


def test_a_sweep_is_counted_from_the_first() -> None:
    with pytest.raises(OptionError, match=r"--sweep: -1 is below 0"):
        lidarcli.plot(ROOM, sweep=-1)


BATCH = """\
SweepBatch /scan: 150 sweeps x 361 beams
  log     drive
  topic   /scan
  frame   laser
  sweeps  0 to 149 (150 sweeps)
  time    2023-11-14T22:13:20.000Z to 2023-11-14T22:13:49.800Z
  beams   361 per sweep
  view    -180.00 to 180.00 deg
  ranges  0.757 to 8.436 m
  status  53,983 valid, 93 no_return, 0 too_close, 74 invalid
  poses   known for 150 sweeps"""
BACKGROUND = """\
Background of /scan: 1 station x 361 beams
  topic     /scan
  frame     laser
  view      -180.00 to 180.00 deg
  sweeps    100
  stations  1, the poses of 0 are known
  r_e       2.901 to 5.199 m
  support   100.0% of the sweeps (median)
  open      0 beams
  unknown   0 beams"""
POSES = """\
SweepPoses of 150 sweeps
  known      for 150 sweeps
  x          -2.63 to 2.60 m
  y          -1.95 to 1.92 m
  yaw        -179.84 to 179.70 deg
  head down  never"""
GRID = """\
Occupancy 188 x 149 cells of 0.05 m
  frame     odom
  x         -4.70 to 4.70 m
  y         -3.75 to 3.70 m
  occupied  1,407 cells
  free      24,467 cells
  unknown   2,138 cells"""


def test_they_print_what_they_are() -> None:
    (batch,) = lidarcli.read(SAMPLES / "drive.db3")
    assert str(batch) == BATCH
    assert repr([batch]) == "[<SweepBatch /scan: 150 sweeps x 361 beams>]"
    (background,) = lidarcli.background(SAMPLES / "room_empty.mcap")
    assert str(background) == BACKGROUND
    assert repr(background) == "<Background of /scan: 1 station x 361 beams>"
    grid = lidarcli.map(SAMPLES / "drive.db3")
    assert str(grid) == GRID
    assert (grid.occupied, grid.free, grid.cells.shape) == (1407, 24467, (149, 188))


def test_a_map_leaves_out_agents_and_nothing_else() -> None:
    with pytest.raises(OptionError, match=r"^--without: 'temporary' is not one of agents$"):
        lidarcli.map(SAMPLES / "drive.db3", without="temporary")
    with pytest.raises(TypeError, match=r"no option 'without_agents'; did you mean 'without'\?$"):
        lidarcli.map(SAMPLES / "drive.db3", without_agents=True)
    # Nothing moves there.
    assert str(lidarcli.map(SAMPLES / "drive.db3", without="agents")) == GRID


def test_poses_print_where_the_sensor_was() -> None:
    (batch,) = lidarcli.read(SAMPLES / "drive.db3")
    assert batch.poses is not None
    assert str(batch.poses) == POSES
    assert repr(batch.poses) == "<SweepPoses of 150 sweeps>"
    x, upside_down = batch.poses.x.copy(), np.ones(150, np.bool_)
    x[10:] = np.nan
    way = np.tile([0.03, 0.04, 0.1], (150, 1))
    odd = str(replace(batch.poses, x=x, upside_down=upside_down, way=way))
    assert "known      for 10 sweeps\n" in odd
    assert "head down  in 10 sweeps\n" in odd
    assert odd.endswith("way        0.050 m from the first beam to the last")
    none = batch.poses.rows(np.empty(0, np.int64))
    assert repr(none) == "<SweepPoses of 0 sweeps>"
    assert "x          none" in str(none)


def test_a_notebook_shows_them_as_a_table() -> None:
    (batch,) = lidarcli.read(SAMPLES / "drive.db3")
    page = replace(batch, log="<b>&", frame_ids=("",))._repr_html_()
    assert page.startswith('<table><caption style="text-align: left"><b>SweepBatch</b> /scan: 150 sweeps x 361 beams<')
    assert ">&lt;b&gt;&amp;</td>" in page
    assert ">without a name</td>" in page
    assert page.count("<tr>") == 10


def test_points_lie_where_the_beams_ended() -> None:
    batch = lidarcli.formalism.sweep([[1.0, 2.0, np.inf, 3.0]], angle_min=0.0, angle_increment=np.pi / 2)
    expected = [[[1, 0], [0, 2], [np.nan, np.nan], [0, -3]]]
    np.testing.assert_allclose(batch.points, expected, atol=1e-15)


def test_a_batch_as_a_data_frame() -> None:
    (batch,) = lidarcli.read(PEOPLE, end=0.1)
    short = replace(batch, beams=np.array([1081, 3], np.int32), status=batch.status.copy())
    short.status[1, 3:] = lidarcli.Status.PADDING
    frame = short.to_pandas()
    assert [*frame] == ["sweep", "stamp", "beam", "bearing", "range", "status", "intensity", "x", "y"]
    assert frame["intensity"].isna().all()
    (lit,) = lidarcli.read(SAMPLES / "reflectors.mcap", end=0.1)
    for each, kind in ((frame, "float32"), (lit.to_pandas(), "float32")):
        assert each["intensity"].dtype == kind
    np.testing.assert_array_equal(lit.to_pandas()["intensity"], lit.intensities.ravel())
    assert "intensities  60 to 3100 in the sensor's unit" in str(lit)
    assert "intensities" not in str(batch)
    assert frame.groupby("sweep").size().to_dict() == {0: 1081, 1: 3}
    assert [*frame["status"].cat.categories] == [*STATUSES]
    assert frame["stamp"].dtype == pd.DatetimeTZDtype("ns", "UTC")
    found = frame[frame["sweep"] == 0]
    np.testing.assert_array_equal(found["range"], batch.ranges[0])
    np.testing.assert_allclose(np.hypot(found["x"], found["y"]), found["range"], rtol=1e-6)
    np.testing.assert_allclose(np.arctan2(found["y"], found["x"]).dropna(), found["bearing"][found["x"].notna()], atol=1e-9)
    assert (found["status"] == "valid").sum() == np.isfinite(batch.ranges[0]).sum()


def test_a_batch_is_a_sequence_of_sweeps() -> None:
    (batch,) = lidarcli.read(SAMPLES / "drive.db3")
    for row in (0, 7, -1, np.int64(149)):
        one = batch[row]
        assert (len(one), one.sweep.tolist(), one.log) == (1, [row % 150], "drive")
        np.testing.assert_array_equal(one.ranges[0], batch.ranges[row])
        assert one.poses.x.tolist() == [batch.poses.x[row]]
        assert np.shares_memory(one.ranges, batch.ranges)
    assert batch[3:9:2].sweep.tolist() == [3, 5, 7]
    assert batch[[5, 2]].sweep.tolist() == batch[np.array([5, 2])].sweep.tolist() == [5, 2]
    assert batch[batch.seconds >= 29].sweep.tolist() == [145, 146, 147, 148, 149]
    assert len(batch[200:]) == 0
    assert [one.sweep.tolist() for one in batch[:3]] == [[0], [1], [2]]
    assert batch.rows(slice(2, 4)).sweep.tolist() == [2, 3]
    # Sweeps of a batch are batches, too.
    assert lidarcli.detect(batch).equals(lidarcli.detect(list(batch)))
    for row in (150, -151):
        with pytest.raises(IndexError, match=rf"^batch\[{row}\]: the batch has 150 sweeps$"):
            batch[row]
    for odd in ("0", 1.0, None, (0, 1)):
        with pytest.raises(TypeError, match=r"^batch\[.*\]: sweeps are taken by their row, a slice, or an array"):
            batch[odd]
    with pytest.raises(TypeError, match=r"^rows are given as an array, a list or a slice, not as 3: rows\(\[3\]\)$"):
        batch.rows(3)
