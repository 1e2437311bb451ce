"""`lidarcli plot --view map`: the run from above as a picture."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.mapping import MapOptions
from lidarcli.pipeline.plotting import take_map
from tests.places import SAMPLES

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
    for suffix, start in (("png", b"\x89PNG\r\n"), ("svg", b"<?xml"), ("pdf", b"%PDF")):
        out, again = (tmp_path / f"{name}.{suffix}" for name in "ab")
        ran = lidarcli("plot", DRIVE, "--view", "map", "-o", out)
        assert (ran.code, ran.out) == (0, "")
        assert ran.err.splitlines() == [
            "  note     poses from /tf and /tf_static (odom > base_link > laser); also available: /odom (--pose TOPIC)",
            "  note     poses from /tf fit the sweeps: 100% of 147 steps",
            "  note     used 75 of 150 sweeps (one every 0.12 m, 10 degrees or 5 s; --min-move)",
            f"  wrote    {out}",
        ]
        ran = lidarcli("-q", "plot", DRIVE, "--view", "map", "-o", again)
        assert (ran.code, ran.out, ran.err) == (0, "", "")
        assert out.read_bytes().startswith(start)
        assert out.read_bytes() == again.read_bytes()
    words = words_of(tmp_path / "a.svg")
    assert "path of the sensor" in words
    assert "path of the sensor: start" in words
    assert "drive  frame odom" in words


def test_a_sweep(lidarcli: Run, tmp_path: Path) -> None:
    out = tmp_path / "m.svg"
    assert lidarcli("plot", DRIVE, "--view", "map", "--sweep", 70, "-o", out).code == 0
    words = words_of(out)
    for word in ("sweep 70", "objects of the sweep", "sensor", "path of the sensor"):
        assert word in words.splitlines()
    assert "drive  sweep 70" in words


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
        column = np.floor((shot.points[0] - grid.x) / grid.resolution).astype(int)
        row = np.floor((shot.points[1] - grid.y) / grid.resolution).astype(int)
        near = [
            (grid.cells[j - 1 : j + 2, i - 1 : i + 2] == 100).any() for i, j in zip(column, row, strict=True)
        ]
        assert len(near) > 300
        assert np.mean(near) > 0.94
        assert len(shot.boxes) >= 2
        (path,) = picture.paths
        assert np.hypot(path[0] - shot.x, path[1] - shot.y).min() < 0.21


@pytest.mark.slow
def test_several_sweeps(lidarcli: Run, tmp_path: Path) -> None:
    ran = lidarcli("plot", DRIVE, "--view", "map", "--sweeps", "3,80", "-o", tmp_path / "m.png")
    assert (ran.code, names(tmp_path)) == (0, ["m-3.png", "m-80.png"])
    assert ran.err.splitlines()[-2:] == [f"  wrote    {tmp_path / f'm-{k}.png'}" for k in (3, 80)]
    assert (tmp_path / "m-3.png").read_bytes() != (tmp_path / "m-80.png").read_bytes()
    with Image.open(tmp_path / "m-3.png") as image:
        assert image.size[0] > 800


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
        f"lidarcli: {tables}: its sweeps have no poses: things have no place in the world\n",
    )
    assert not (tmp_path / "m.png").exists()


def test_tables_of_another_log(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    log = tmp_path / "other.db3"
    log.write_bytes(DRIVE.read_bytes())
    ran = lidarcli("plot", log, "--view", "map", "--tracks", tables, "-o", tmp_path / "m.svg")
    assert (ran.code, ran.err) == (2, f"lidarcli: {tables}: is of the log drive, not of {log}\n")
    assert not (tmp_path / "m.svg").exists()


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        (("--sweep", 150), f"{DRIVE}: no sweep 150 with a pose in this log"),
        (("--sweeps", "3,400"), f"{DRIVE}: no sweep 400 with a pose in this log"),
        (("--map",), "Error: --map is gone: give --view map\n"),
        (
            ("--background", "x.parquet"),
            "--view map is a picture of its own, without --animate and --background",
        ),
        (("--animate",), "the suffix has to be one of .gif, .mp4"),
        (("--sweep", 1, "--sweeps", "2"), "--sweep and --sweeps exclude each other"),
        (("--pose", "match", "--poses", "x.tum"), "exclude each other"),
    ],
)
def test_what_is_refused(lidarcli: Run, tmp_path: Path, options: tuple[object, ...], cause: str) -> None:
    ran = lidarcli("plot", DRIVE, "--view", "map", *options, "-o", tmp_path / "m.png")
    assert (ran.code, ran.out) == (2, "")
    assert cause in ran.err
    assert names(tmp_path) == []


def test_an_animation_is_refused(lidarcli: Run, tmp_path: Path) -> None:
    ran = lidarcli("plot", DRIVE, "--view", "map", "--animate", "-o", tmp_path / "m.gif")
    assert (ran.code, names(tmp_path)) == (2, [])
    assert "--view map is a picture of its own, without --animate and --background" in ran.err


def test_without_poses(lidarcli: Run, tmp_path: Path) -> None:
    room = SAMPLES / "room.mcap"
    ran = lidarcli("plot", room, "--view", "map", "-o", tmp_path / "m.png", "--pose", "none")
    assert (ran.code, ran.out, len(ran.err.splitlines())) == (3, "", 1)
    assert ran.err.startswith(f"lidarcli: {room}: no poses: --pose none leaves them out; ")
    assert names(tmp_path) == []
    assert lidarcli("plot", room, "--view", "map", "-o", tmp_path / "m.png").code == 0
    assert names(tmp_path) == ["m.png"]


def test_what_exists_is_not_replaced_unasked(lidarcli: Run, tmp_path: Path) -> None:
    (tmp_path / "m-3.svg").write_text("mine")
    words = ("plot", DRIVE, "--view", "map", "--sweeps", "3,4", "-o", tmp_path / "m.svg")
    ran = lidarcli(*words)
    assert (ran.code, names(tmp_path)) == (5, ["m-3.svg"])
    assert (tmp_path / "m-3.svg").read_text() == "mine"


def test_the_path_is_an_input(lidarcli: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.svg"
    assert lidarcli("-q", "poses", DRIVE, "-o", tmp_path / "run.tum").code == 0
    path.write_bytes((tmp_path / "run.tum").read_bytes())
    ran = lidarcli("plot", DRIVE, "--view", "map", "--poses", path, "-o", path, "--overwrite")
    assert (ran.code, path.read_bytes()) == (5, (tmp_path / "run.tum").read_bytes())


@pytest.mark.slow
def test_standard_output(process: Run, lidarcli: Run, tmp_path: Path) -> None:
    ran = process("-q", "plot", DRIVE, "--view", "map", "-o", "-")
    assert (ran.returncode, ran.stderr) == (0, b"")
    assert lidarcli("-q", "plot", DRIVE, "--view", "map", "-o", tmp_path / "m.png").code == 0
    assert ran.stdout == (tmp_path / "m.png").read_bytes()
    ran = process("plot", DRIVE, "--view", "map", "--sweeps", "1,2", "-o", "-")
    assert (ran.returncode, ran.stdout) == (2, b"")
    assert b"standard output takes one picture; give -o FIG" in ran.stderr
