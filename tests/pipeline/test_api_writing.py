"""`lidarcli.overlay`, `poses`, `export` and `simulate`: the files of the commands; and how far the work is."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import OptionError, OutputError, UnreadableError
from tests.cli.test_progress import terminal
from tests.places import SAMPLES

ROOM, DRIVE, PEOPLE = SAMPLES / "room.mcap", SAMPLES / "drive.db3", SAMPLES / "people.csv.gz"


@pytest.mark.slow
def test_an_overlay_is_that_of_the_command(tmp_path: Path) -> None:
    mine, command = tmp_path / "mine.mcap", tmp_path / "command.mcap"
    files = lidarcli.overlay(PEOPLE, mine, end=1, max_width=1.5)
    assert files == [str(mine), str(tmp_path / "mine.layout.json"), str(tmp_path / "mine.rviz")]
    assert run(["-q", "overlay", str(PEOPLE), "-o", str(command), "--end", "1", "--max-width", "1.5"]) == 0
    assert mine.read_bytes() == command.read_bytes()
    assert lidarcli.overlay(PEOPLE, tmp_path / "mine.bag", end=1, layout=False) == [str(tmp_path / "mine.bag")]
    with pytest.raises(OutputError, match=r"mine\.mcap exists; "):
        lidarcli.overlay(PEOPLE, mine)
    lidarcli.overlay(PEOPLE, mine, True, end=1)
    with pytest.raises(OptionError, match=r"mine\.txt: the suffix of an overlay has to be one of"):
        lidarcli.overlay(PEOPLE, tmp_path / "mine.txt")


def test_tables_that_are_shown_leave_nothing_to_find(tmp_path: Path) -> None:
    assert run(["-q", "track", str(PEOPLE), "-o", str(tmp_path)]) == 0
    objects, out = tmp_path / "people.objects.parquet", tmp_path / "shown.mcap"
    assert len(lidarcli.overlay(PEOPLE, out, objects=objects)) == 3
    with pytest.raises(OptionError, match=r"^--max-width is for finding objects, and --objects names some"):
        lidarcli.overlay(PEOPLE, out, True, objects=objects, max_width=1.0)
    with pytest.raises(OptionError, match=r"^--min-beams is for finding objects, and --no-objects finds none$"):
        lidarcli.zones(PEOPLE, zones=tmp_path / "near.toml", no_objects=True, min_beams=4)


@pytest.mark.slow
def test_poses_are_those_of_the_batches_and_of_the_command(tmp_path: Path) -> None:
    (batch,) = lidarcli.read(DRIVE)
    found = lidarcli.poses(DRIVE)
    assert found.num_rows == 150
    for name in ("x", "y", "yaw"):
        assert found[name].to_pylist() == pytest.approx(getattr(batch.poses, name).tolist())
    file = tmp_path / "drive.parquet"
    assert run(["-q", "poses", str(DRIVE), "-o", str(file)]) == 0
    assert found.equals(pq.read_table(file), check_metadata=True)
    # In a file of lines there are as many.
    lines = tmp_path / "drive.tum"
    assert lidarcli.poses(DRIVE, lines, every=3).num_rows == len(lines.read_text().splitlines()) == 50
    assert run(["-q", "poses", str(DRIVE), "-o", str(tmp_path / "two.tum"), "--every", "3"]) == 0
    assert lines.read_bytes() == (tmp_path / "two.tum").read_bytes()
    with pytest.raises(OutputError):
        lidarcli.poses(DRIVE, lines)
    with pytest.raises(UnreadableError, match=r"no poses: "):
        lidarcli.poses(DRIVE, pose="none")
    with pytest.raises(OptionError, match=r"a\.csv: the suffix of a trajectory has to be one of"):
        lidarcli.poses(DRIVE, "a.csv")


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


def test_a_simulated_log_is_that_of_the_command(tmp_path: Path) -> None:
    scene = SAMPLES / "room.toml"
    made = lidarcli.simulate(scene, tmp_path / "mine.mcap", sweeps=3, seed=7, map=tmp_path / "true.yaml")
    assert (made.sweeps, made.log.name, made.true_map.name) == (3, "mine.mcap", "true.yaml")
    command = ["-q", "simulate", str(scene), "-o", str(tmp_path / "command.mcap"), "--sweeps", "3", "--seed", "7"]
    assert run(command) == 0
    assert made.log.read_bytes() == (tmp_path / "command.mcap").read_bytes()
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
