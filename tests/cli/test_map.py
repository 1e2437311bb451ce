"""`lidarcli map`: what it writes of each kind, what it refuses, and what the options change."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from PIL import Image

from lidarcli.formalism.mapping.comparison import FARTHEST, compare
from lidarcli.formalism.mapping.occupancy import FREE, OCCUPIED, UNKNOWN, Occupancy
from lidarcli.logs.batches import ReadOptions
from lidarcli.maps.clouds import CloudPoints, PlyWriter
from lidarcli.maps.mapserver import read_map
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.map_files import WRITERS, Mapped, MapRun
from lidarcli.pipeline.mapping import MapOptions
from lidarcli.pipeline.reading.pose_options import PoseOptions
from lidarcli.pipeline.running import outcomes
from lidarcli.simulate.writers import write_log
from lidarcli.sweeps import RawSweeps
from lidarcli.tabular.schemas import CLOUD
from tests.places import ROOT, SAMPLES
from tests.sweeping import START, STEP, raw_sweeps, room_sweeps, round_room

Run = Callable[..., Any]
DRIVE = SAMPLES / "drive.db3"
POSES_NOTE = (
    "  note     poses by /tf and /tf_static (odom > base_link > laser); also there: /odom (--pose TOPIC)"
)
COUNTED = (
    "  note     64 of 150 sweeps count: one for each 0.2 m, 10 degrees or 5 s of the way (--min-move)",
    "map of 64 sweeps in odom: 9.4 x 7.5 m, 1,401 cells of 0.05 m occupied, 24,452 free",
)
WALK = """
[scene]
name = "walk"
sweeps = 120
[sensor]
beams = 361
angle_min = -180.0
angle_max = 180.0
noise = 0.01
range_max = 12.0
[robot]
waypoints = [[-1.0, 0.0], [1.5, 0.0]]
speed = 0.25
[robot.odometry]
[[wall]]
points = [[-4, -3], [4, -3], [4, 3], [-4, 3]]
closed = true
[[box]]
x = -2.0
y = -1.5
length = 0.6
width = 0.4
[[cylinder]]
radius = 0.2
[cylinder.route]
speed = 1.0
waypoints = [[-2.0, 1.5], [1.0, 1.5]]
"""
"""A robot drives through a room. A thing passes it, stops at (1, 1.5) after 3 s and stands there for the 9 s left."""
GHOST = (1.0, 1.5)


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`walk.mcap` in a room with a thing that comes and stops, and `truth.yaml`, its true map."""
    from lidarcli.cli import run

    folder = tmp_path_factory.mktemp("walk")
    (folder / "walk.toml").write_text(WALK)
    words = (
        "-q",
        "simulate",
        folder / "walk.toml",
        "-o",
        folder / "walk.mcap",
        "--map",
        folder / "truth.yaml",
    )
    assert run([str(word) for word in words]) == 0
    return folder


def names(folder: Path) -> list[str]:
    """All that is there, what begins with a dot, too."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def occupied(path: Path) -> set[tuple[int, int]]:
    """Column and row of the occupied cells of a map, from the origin of the world."""
    grid = read_map(path)
    rows, columns = np.nonzero(grid.cells == OCCUPIED)
    left, low = round(grid.x / grid.resolution), round(grid.y / grid.resolution)
    return set(zip((columns + left).tolist(), (rows + low).tolist(), strict=True))


def near(cells: set[tuple[int, int]], x: float, y: float, reach: float = 0.35) -> int:
    """How many cells of 0.05 m are within so much of a place, in x and in y."""
    return sum(abs(0.05 * (i + 0.5) - x) < reach and abs(0.05 * (j + 0.5) - y) < reach for i, j in cells)


def ply(path: Path) -> Any:
    """(N, 3) points of a binary PLY."""
    head, _, data = path.read_bytes().partition(b"end_header\n")
    count = next(int(line.split()[2]) for line in head.decode().splitlines() if line.startswith("element"))
    points = np.frombuffer(data, "<f8").reshape(-1, 3)
    assert len(points) == count
    return points


def mapped(
    logs: Sequence[Path], outputs: Sequence[Path], read: ReadOptions | None = None, **options: Any
) -> Mapped:
    """A map by the pipeline."""
    told = MapOptions(read=read or ReadOptions(), **options)
    with MapRun(find_logs([str(log) for log in logs]), outputs, told) as run:
        for outcome in run.outcomes():
            assert (outcome.error, outcome.exit_code) == (None, 0)
        return run.finish()


def test_yaml(lidarcli: Run, tmp_path: Path) -> None:
    ran = lidarcli("map", DRIVE, "-o", tmp_path / "room.yaml")
    assert (ran.code, ran.out) == (0, "")
    lines = ran.err.splitlines()
    assert lines[0].startswith(f"{DRIVE}: 150 sweeps")
    wrote = [f"  wrote    {tmp_path / name}" for name in ("room.yaml", "room.pgm")]
    assert lines[1:] == [POSES_NOTE, *COUNTED, *wrote]
    assert names(tmp_path) == ["room.pgm", "room.yaml"]
    assert (tmp_path / "room.yaml").read_text() == (
        "image: room.pgm\nmode: trinary\nresolution: 0.050\norigin: [-4.700, -3.750, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    grid = read_map(tmp_path / "room.yaml")
    assert (grid.resolution, grid.x, grid.y, grid.cells.shape) == (0.05, -4.7, -3.75, (149, 188))
    assert (grid.occupied, grid.free) == (1401, 24452)
    # The walls are at 4.5 and 3.5 m, as far as the odometry was right; beyond them nothing is known.
    for edge in (grid.cells[0], grid.cells[-1], grid.cells[:, 0], grid.cells[:, -1]):
        assert (edge == UNKNOWN).all()
    row, column = round(3.75 / 0.05), round(4.7 / 0.05)
    assert (grid.cells[row - 2 : row + 2, 20:30] == FREE).all()
    assert (grid.cells[row - 20 : row + 20, column + 86 : column + 94] == OCCUPIED).any(axis=1).all()


@pytest.mark.slow
def test_png(lidarcli: Run, tmp_path: Path) -> None:
    for name, options in (("plain", []), ("path", ["--path"])):
        ran = lidarcli("map", DRIVE, "-o", tmp_path / f"{name}.png", *options)
        assert (ran.code, ran.err.splitlines()[-1]) == (0, f"  wrote    {tmp_path / f'{name}.png'}")
    with Image.open(tmp_path / "plain.png") as plain, Image.open(tmp_path / "path.png") as path:
        assert plain.size[0] > plain.size[1] > 600
        green = [
            np.asarray(image.convert("RGB")).astype(int)[..., 1]
            - np.asarray(image.convert("RGB")).astype(int)[..., 0]
            for image in (plain, path)
        ]
    assert [(part > 80).any() for part in green] == [False, True]


def test_mcap(lidarcli: Run, tmp_path: Path) -> None:
    assert lidarcli("map", DRIVE, "-o", tmp_path / "m.mcap", "-o", tmp_path / "m.yaml").code == 0
    with (tmp_path / "m.mcap").open("rb") as file:
        ((schema, channel, message),) = make_reader(file).iter_messages()
    assert schema is not None
    assert (schema.name, channel.topic) == ("nav_msgs/msg/OccupancyGrid", "/map")
    assert "durability: 1" in channel.metadata["offered_qos_profiles"]
    grid = read_map(tmp_path / "m.yaml")
    assert message.data[-grid.cells.size :] == grid.cells.tobytes()
    assert message.log_time == START + 149 * 200_000_000 - 200_000_000 * 2
    assert b"odom\0" in message.data[:40]


def test_clouds(lidarcli: Run, tmp_path: Path) -> None:
    outputs = [
        word for suffix in ("ply", "pcd", "parquet", "yaml") for word in ("-o", tmp_path / f"c.{suffix}")
    ]
    ran = lidarcli("map", DRIVE, *outputs)
    assert ran.code == 0
    table = pq.read_table(tmp_path / "c.parquet")
    assert table.schema.equals(CLOUD)
    points = np.column_stack([table["x"].to_numpy(), table["y"].to_numpy(), np.zeros(len(table))])
    assert np.array_equal(ply(tmp_path / "c.ply"), points)
    head, _, data = (tmp_path / "c.pcd").read_bytes().partition(b"DATA binary\n")
    assert f"POINTS {len(points)}\n".encode() in head
    assert np.array_equal(np.frombuffer(data, "<f4").reshape(-1, 3), points.astype(np.float32))
    sweeps, counts = np.unique(table["sweep"].to_numpy(), return_counts=True)
    assert (len(sweeps), counts.max() <= 361, len(points)) == (64, True, 23_031)
    stamps = table["stamp"].cast("int64").to_numpy()
    assert np.array_equal(stamps, START + 200_000_000 * table["sweep"].to_numpy())
    assert set(table["log"].to_pylist()) == {"drive"}
    assert set(table["topic"].to_pylist()) == {"/scan"}
    assert set(table["set"].to_pylist()) == {"O", "S"}
    metadata = table.schema.metadata or {}
    parameters = json.loads(metadata[b"lidarcli.parameters"])
    assert (parameters["resolution"], parameters["min_move"], parameters["voxel"]) == (0.05, 0.2, 0.0)
    (source,) = json.loads(metadata[b"lidarcli.source"])
    assert source["poses"] == {"laser": {"topic": "/tf", "world": "odom"}}
    # Nearly every point lies in or beside an occupied cell: all but what only one sweep hit.
    cells = occupied(tmp_path / "c.yaml")
    around = {(i + di, j + dj) for i, j in cells for di in (-1, 0, 1) for dj in (-1, 0, 1)}
    at = np.floor(points[:, :2] / 0.05).astype(int)
    there = [(i, j) in around for i, j in at.tolist()]
    assert np.mean(there) > 0.985


@pytest.mark.slow
def test_everything_at_once_twice_and_quietly(lidarcli: Run, tmp_path: Path) -> None:
    for folder in ("a", "b"):
        outputs = [
            word
            for name in ("m.yaml", "m.png", "m.mcap", "m.ply", "m.pcd")
            for word in ("-o", tmp_path / folder / name)
        ]
        ran = lidarcli("-q", "map", DRIVE, *outputs, "--path")
        assert (ran.code, ran.out, ran.err) == (0, "", "")
    assert names(tmp_path / "a") == ["m.mcap", "m.pcd", "m.pgm", "m.ply", "m.png", "m.yaml"]
    for name in names(tmp_path / "a"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


@pytest.mark.slow
def test_the_table_twice(lidarcli: Run, tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert lidarcli("-q", "map", DRIVE, "-o", tmp_path / f"{name}.parquet", "--voxel", "0.05").code == 0
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


@pytest.mark.parametrize("size", [7, pytest.param(1, marks=pytest.mark.slow)])
def test_batches_do_not_matter(tmp_path: Path, size: int) -> None:
    options: dict[str, Any] = {"free_no_return": 2.0, "voxel": 0.02}
    for folder, batch_size in (("whole", 768), ("cut", size)):
        outputs = [tmp_path / folder / f"m.{suffix}" for suffix in ("yaml", "mcap", "ply", "parquet")]
        mapped([DRIVE], outputs, ReadOptions(batch_size=batch_size), **options)
    for name in ("m.pgm", "m.yaml", "m.mcap", "m.ply"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "cut" / name).read_bytes(), name
    whole, cut = (pq.read_table(tmp_path / folder / "m.parquet") for folder in ("whole", "cut"))
    assert whole.equals(cut)


def test_agents_are_left_out_whatever_the_batches(walk: Path, tmp_path: Path) -> None:
    for size in (768, 11):
        mapped(
            [walk / "walk.mcap"],
            [tmp_path / f"{size}.yaml"],
            ReadOptions(batch_size=size),
            without_agents=True,
        )
    assert (tmp_path / "768.pgm").read_bytes() == (tmp_path / "11.pgm").read_bytes()


def two_sensors(folder: Path) -> tuple[Path, Path]:
    """A log of two topics of different frames, recorded by turns, and a path for both."""
    path = folder / "two.mcap"
    parts = []
    for k in range(20):
        for name, radius in (("/a", 3.0), ("/b", 3.01)):
            block = raw_sweeps(
                round_room(1, 90) * np.float32(radius / 4),
                topic=name,
                frame_ids=(f"frame{name[1:]}",),
                stamp_ns=START + STEP * k + (name == "/b"),
            )
            parts.append(block)
    write_log(path, parts)
    lines = [f"{1_700_000_000 + k / 10:.9f} {0.1 * k:.3f} 0 0 0 0 0 1\n" for k in range(-1, 22)]
    (folder / "two.tum").write_text("".join(lines))
    return path, folder / "two.tum"


def test_clouds_of_two_sensors_have_the_same_points_whatever_the_batches(tmp_path: Path) -> None:
    """Topics take turns by batches, and with them the points."""
    log, path = two_sensors(tmp_path)
    found = []
    for size in (768, 3):
        out = tmp_path / f"{size}.parquet"
        mapped([log], [out], ReadOptions(batch_size=size), poses=PoseOptions(file=str(path)))
        order = [("topic", "ascending"), ("sweep", "ascending"), ("beam", "ascending")]
        names = ["topic", "sweep", "beam", "x", "y"]
        table = pq.read_table(out, columns=names)
        found.append(table.set_column(0, "topic", table["topic"].cast("string")).sort_by(order))
    assert found[0].equals(found[1])
    assert len(found[0]) > 100


def test_two_sensors_are_both_in_the_map(lidarcli: Run, tmp_path: Path) -> None:
    log, path = two_sensors(tmp_path)
    ran = lidarcli("map", log, "--poses", path, "-o", tmp_path / "m.parquet", "--min-move", 0)
    assert ran.code == 0
    table = pq.read_table(tmp_path / "m.parquet")
    assert Counter(table["topic"].to_pylist()) == {"/a": 20 * 90, "/b": 20 * 90}
    ran = lidarcli("map", log, "--poses", path, "-o", tmp_path / "b.parquet", "--topic", "b")
    assert ran.code == 0
    assert set(pq.read_table(tmp_path / "b.parquet")["topic"].to_pylist()) == {"/b"}


def test_two_topics_of_one_frame_count_once(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    lines = [f"{1_700_000_000 + k} {0.25 * k} 0 0 0 0 0 1\n" for k in range(-1, 4)]
    (tmp_path / "p.tum").write_text("".join(lines))
    words = ("map", logs / "two.mcap", "--poses", tmp_path / "p.tum", "--min-move", 0, "-o")
    ran = lidarcli(*words, tmp_path / "m.parquet")
    assert ran.code == 0
    topics = pq.read_table(tmp_path / "m.parquet")["topic"].to_pylist()
    (first,) = set(topics)
    other = {"/front": "/rear", "/rear": "/front"}[first]
    assert (
        f"  note     {other} is of the same frame as {first}, most likely the same sweeps again: left out "
        f"(--topic {other})"
    ) in ran.err.splitlines()
    ran = lidarcli(*words, tmp_path / "n.parquet", "--topic", "/rear", "--topic", "/front")
    assert Counter(pq.read_table(tmp_path / "n.parquet")["topic"].to_pylist()) == {
        "/front": len(topics),
        "/rear": len(topics),
    }


def test_a_log_twice_counts_double(lidarcli: Run, tmp_path: Path) -> None:
    """Twice the hits, twice the threshold: the same cells, by the same shares."""
    once = lidarcli("map", DRIVE, "-o", tmp_path / "once.yaml", "--min-hits", 2)
    twice = lidarcli("map", DRIVE, DRIVE, "-o", tmp_path / "twice.yaml", "--min-hits", 4)
    assert (once.code, twice.code) == (0, 0)
    assert (tmp_path / "once.pgm").read_bytes() == (tmp_path / "twice.pgm").read_bytes()
    assert f"map of 128 sweeps in odom: {COUNTED[1].partition(': ')[2]}" in twice.err.splitlines()
    assert (
        "  note     2 logs are laid onto each other in the frame odom: odometry begins anew in each, so give poses of a "
        "common map (--pose TOPIC, --poses FILE.tum)"
    ) in twice.err.splitlines()
    assert lidarcli("-q", "map", DRIVE, DRIVE, "-o", tmp_path / "loose.yaml").code == 0
    assert occupied(tmp_path / "once.yaml") < occupied(tmp_path / "loose.yaml")


@pytest.mark.slow
def test_a_log_twice_side_by_side(lidarcli: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both are done before the first log, which takes longer."""
    monkeypatch.setattr(outcomes, "WORTH_A_PROCESS", 1)
    for name, count in (("long", 3000), ("short", 5)):
        write_log(tmp_path / f"{name}.mcap", [raw_sweeps(round_room(count))])
    (tmp_path / "p.tum").write_text("1699999999 0 0 0 0 0 0 1\n1700001000 9 0 0 0 0 0 1\n")
    logs = [tmp_path / f"{name}.mcap" for name in ("long", "short", "short")]
    for jobs in (1, 2):
        options = ("--poses", tmp_path / "p.tum", "--min-move", 0, "--jobs", jobs)
        ran = lidarcli("map", *logs, "-o", tmp_path / str(jobs) / "m.yaml", *options)
        assert ran.code == 0, ran.err
        assert "map of 3,010 sweeps in world: " in ran.err
    assert (tmp_path / "1" / "m.pgm").read_bytes() == (tmp_path / "2" / "m.pgm").read_bytes()


class Broken(PlyWriter):
    """A cloud on a disk that is full for a moment, at the third time that it is written to."""

    times = 0

    def write(self, points: CloudPoints) -> None:
        Broken.times += 1
        if Broken.times == 3:
            raise OSError(errno.ENOSPC, "No space left on device")
        super().write(points)


def test_a_cloud_that_cannot_be_written_ends_the_run(
    lidarcli: Run, walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, path = still(tmp_path, np.full((9, 90), 3.0, np.float32))
    monkeypatch.setattr(Broken, "times", 2)
    monkeypatch.setitem(WRITERS, ".ply", Broken)
    words = ("--poses", path, "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.ply", "--min-move", 0)
    ran = lidarcli("map", log, log, *words)
    assert (ran.code, ran.out) == (5, "")
    assert names(tmp_path) == ["odd.mcap", "odd.tum"]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["ply", "pcd", "parquet"])
def test_no_room_for_a_cloud(walk: Path, tmp_path: Path, suffix: str) -> None:
    """A limit on the size of files, met when the last bytes are written."""
    command = ["sh", "-c", 'ulimit -f 1; exec "$@"', "sh", sys.executable, "-m", "lidarcli", "-q", "map"]
    words = [str(walk / "walk.mcap"), "-o", str(tmp_path / f"m.{suffix}"), "--voxel", "0.5"]
    ran = subprocess.run([*command, *words], capture_output=True, text=True, check=False)
    assert (ran.returncode, len(ran.stderr.splitlines())) == (5, 1)
    assert f"cannot write {tmp_path / f'm.{suffix}'}: " in ran.stderr
    assert names(tmp_path) == []


def test_the_order_of_logs_does_not_matter(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    for name, logs in (("ab", (DRIVE, walk / "walk.mcap")), ("ba", (walk / "walk.mcap", DRIVE))):
        assert lidarcli("-q", "map", *logs, "-o", tmp_path / name / "m.yaml").code == 0
    for name in ("m.yaml", "m.pgm"):
        assert (tmp_path / "ab" / name).read_bytes() == (tmp_path / "ba" / name).read_bytes()


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        ((), "nothing to write: give -o FILE, or --compare TRUTH.yaml"),
        (("-o", "{}/m.yaml", "--format", "json"), "--format is for what --compare prints"),
        (
            ("-o", "{}/m.xyz"),
            "lidarcli: {}/m.xyz: the suffix of a map has to be one of .yaml, .png, .mcap, .ply, .pcd, .parquet\n",
        ),
        (("-o", "{}/m"), "lidarcli: {}/m: the suffix of a map has to be one of "),
        (("-o", "-"), "lidarcli: -: the suffix of a map has to be one of "),
        (("-o", "{}/m.pgm"), ".parquet; {}/m.yaml comes with a .pgm\n"),
        (
            ("-o", "{}/m.png", "-o", "{}/m.ply", "-o", "{}/m.png"),
            "lidarcli: {}/m.png and {}/m.png would be written to the same file\n",
        ),
        (
            ("-o", "{}/m.YAML", "-o", "{}/m.yaml"),
            "lidarcli: {}/m.YAML and {}/m.yaml would be written to the same file\n",
        ),
        (("-o", "{}/m.yaml", "--pose", "/odom", "--poses", "f.tum"), "exclude each other: leave one out\n"),
        (("-o", "{}/m.yaml", "--resolution", "0.0001"), "'--resolution': 0.0001 is below 0.001."),
        (("-o", "{}/m.yaml", "--resolution", "nan"), "Invalid value for '--resolution'"),
        (("-o", "{}/m.yaml", "--occupied-ratio", "1.5"), "Invalid value for '--occupied-ratio'"),
        (("-o", "{}/m.yaml", "--min-hits", "0"), "Invalid value for '--min-hits'"),
        (("-o", "{}/m.yaml", "--max-size", "0"), "Invalid value for '--max-size'"),
        (("-o", "{}/m.yaml", "--min-move", "-1"), "Invalid value for '--min-move'"),
        (("-o", "{}/m.yaml", "--voxel", "inf"), "Invalid value for '--voxel'"),
        (
            ("-o", "{}/m.yaml", "-o", "{}/m.ply", "--max-size", "0.00001"),
            f"lidarcli: {DRIVE}: the map would reach over 9 x 7 m, more than 1e-05 km²: a pose or a range may be far off; "
            "limit the log (--range, --start, --end), take a coarser --resolution, or allow more with --max-size\n",
        ),
    ],
)
def test_what_is_refused(lidarcli: Run, tmp_path: Path, options: tuple[str, ...], cause: str) -> None:
    ran = lidarcli("map", DRIVE, *(option.replace("{}", str(tmp_path)) for option in options))
    assert (ran.code, ran.out) == (2, "")
    assert cause.replace("{}", str(tmp_path)) in ran.err
    assert names(tmp_path) == []


@pytest.mark.parametrize("other", ["folder/../m.png", "link/m.png"])
def test_one_file_by_two_names(lidarcli: Run, tmp_path: Path, other: str) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path)
    ran = lidarcli("map", DRIVE, "-o", tmp_path / "m.png", "-o", tmp_path / other)
    assert (ran.code, (tmp_path / "m.png").exists()) == (2, False)
    assert "would be written to the same file" in ran.err


@pytest.mark.parametrize("there", ["m.yaml", "m.pgm", "m.ply"])
def test_what_exists_is_not_replaced_unasked(lidarcli: Run, tmp_path: Path, there: str) -> None:
    (tmp_path / there).write_text("mine")
    words = ("map", DRIVE, "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.ply")
    ran = lidarcli(*words)
    assert (ran.code, ran.err) == (
        5,
        f"lidarcli: {tmp_path / there} exists; use --overwrite to replace it, or -o to write elsewhere\n",
    )
    assert (names(tmp_path), (tmp_path / there).read_text()) == ([there], "mine")
    assert lidarcli("-q", *words, "--overwrite").code == 0
    assert names(tmp_path) == ["m.pgm", "m.ply", "m.yaml"]


def test_an_output_that_is_an_input(lidarcli: Run, logs: Path, walk: Path, tmp_path: Path) -> None:
    log = tmp_path / "run.mcap"
    log.write_bytes((walk / "walk.mcap").read_bytes())
    before = log.read_bytes()
    ran = lidarcli("map", log, "-o", log, "--overwrite")
    assert (ran.code, ran.err) == (
        5,
        f"lidarcli: {log} is an input of this run ({log}); write elsewhere with -o\n",
    )
    assert log.read_bytes() == before
    truth = walk / "truth.yaml"
    ran = lidarcli("map", log, "-o", truth, "--compare", truth, "--overwrite")
    assert (ran.code, ran.err) == (
        5,
        f"lidarcli: {truth} is an input of this run ({truth}); write elsewhere with -o\n",
    )


def test_the_image_of_the_true_map_is_an_input(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    truth = tmp_path / "truth.yaml"
    truth.write_bytes((walk / "truth.yaml").read_bytes().replace(b"truth.pgm", b"m.pgm"))
    (tmp_path / "m.pgm").write_bytes((walk / "truth.pgm").read_bytes())
    ran = lidarcli("map", walk / "walk.mcap", "-o", tmp_path / "m.yaml", "--compare", truth, "--overwrite")
    assert (ran.code, (tmp_path / "m.pgm").read_bytes()) == (5, (walk / "truth.pgm").read_bytes())


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (None, "No such file or directory; name the YAML file of a map"),
        ("image: none.pgm\n", "no resolution, origin, negate, occupied_thresh, free_thresh"),
        ("\0", "not YAML: "),
        ("[1, 2]", "not the YAML of a map: it has no keys"),
    ],
)
def test_a_true_map_that_is_none(lidarcli: Run, tmp_path: Path, text: str | None, cause: str) -> None:
    truth = tmp_path / "truth.yaml"
    if text is not None:
        truth.write_text(text)
    before = names(tmp_path)
    ran = lidarcli("map", DRIVE, "--compare", truth, "-o", tmp_path / "m.yaml")
    assert (ran.code, ran.out, len(ran.err.splitlines())) == (3, "", 1)
    assert ran.err.startswith(f"lidarcli: {truth}: {cause}")
    assert names(tmp_path) == before


def test_a_true_map_of_another_resolution(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    words = ("-q", "map", walk / "walk.mcap", "--compare", walk / "truth.yaml", "-o", tmp_path / "m.ply")
    ran = lidarcli(*words, "--resolution", "0.1")
    assert (ran.code, ran.out, ran.err) == (
        2,
        "",
        "lidarcli: --compare: cells of 0.1 m cannot be compared with cells of 0.05 m; give --resolution 0.05\n",
    )
    assert names(tmp_path) == []


def slow_compare(found: Occupancy, true: Occupancy) -> dict[str, float]:
    """The figures by looking at every pair of cells."""

    def cells(grid: Occupancy) -> Any:
        rows, columns = np.nonzero(grid.cells == OCCUPIED)
        return np.column_stack([columns + round(grid.x / 0.05), rows + round(grid.y / 0.05)])

    mine, theirs = cells(found), cells(true)
    apart = np.abs(mine[:, None] - theirs)
    touching = apart.max(axis=2) <= 1
    precision, recall = float(touching.any(axis=1).mean()), float(touching.any(axis=0).mean())
    distance = np.minimum(np.hypot(*np.moveaxis(apart, 2, 0)).min(axis=0), FARTHEST)
    return {
        "cells": len(mine),
        "true_cells": len(theirs),
        "precision": precision,
        "recall": recall,
        "f1": 2 * precision * recall / (precision + recall),
        "mean_distance": float(distance.mean()) * 0.05,
    }


def test_compare(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    words = ("map", walk / "walk.mcap", "--compare", walk / "truth.yaml")
    ran = lidarcli("-q", *words, "--format", "json", "-o", tmp_path / "m.yaml")
    assert (ran.code, ran.err) == (0, "")
    found = json.loads(ran.out)
    grid, true = read_map(tmp_path / "m.yaml"), read_map(walk / "truth.yaml")
    right = compare(grid, true)
    assert found == {name: getattr(right, name) for name in found}
    assert found == pytest.approx(slow_compare(grid, true))
    assert (found["cells"], found["true_cells"]) == (1029, 583)
    assert (found["precision"], found["recall"]) == pytest.approx((0.9854, 0.9777), abs=1e-4)
    ran = lidarcli(*words)
    assert ran.code == 0
    assert ran.out == (
        "occupied cells    1,029\nof the true map   583\nprecision         0.9854\nrecall            0.9777\n"
        "F1                0.9815\nmean distance     0.009 m\n"
    )
    assert "wrote" not in ran.err


def test_compare_of_nothing(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    ran = lidarcli(
        "-q",
        "map",
        walk / "walk.mcap",
        "--compare",
        walk / "truth.yaml",
        "--format",
        "json",
        "--min-hits",
        1000,
    )
    assert (ran.code, json.loads(ran.out)) == (
        0,
        {
            "cells": 0,
            "true_cells": 583,
            "precision": None,
            "recall": 0.0,
            "f1": None,
            "mean_distance": 2.0,
        },
    )


def test_logs_without_poses(lidarcli: Run, tmp_path: Path) -> None:
    people = SAMPLES / "people.csv.gz"
    ran = lidarcli("map", people, "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.ply")
    assert (ran.code, ran.out, len(ran.err.splitlines())) == (3, "", 1)
    assert ran.err.startswith(f"lidarcli: {people}: no poses: ")
    assert ran.err.endswith("find its path with --pose match, or give --poses FILE.tum\n")
    assert names(tmp_path) == []
    ran = lidarcli("map", DRIVE, "--pose", "none", "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.parquet")
    assert (ran.code, ran.err) == (
        3,
        f"lidarcli: {DRIVE}: no poses: --pose none leaves them out; find its path with --pose match, or give "
        "--poses FILE.tum\n",
    )
    assert names(tmp_path) == []
    ran = lidarcli("map", DRIVE, "--pose", "/nowhere", "-o", tmp_path / "m.yaml")
    assert (ran.code, ran.err) == (
        4,
        f"lidarcli: {DRIVE}: no topic /nowhere with poses in this log (it has /odom, /tf, /tf_static)\n",
    )
    assert names(tmp_path) == []


def test_a_log_without_poses_beside_a_good_one(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    ran = lidarcli("map", logs / "run.mcap", DRIVE, "-o", tmp_path / "m.yaml")
    assert ran.code == 3
    assert ran.err.splitlines()[0].startswith(f"lidarcli: {logs / 'run.mcap'}: no poses: ")
    assert COUNTED[1] in ran.err.splitlines()
    assert lidarcli("-q", "map", DRIVE, "-o", tmp_path / "alone.yaml").code == 0
    assert (tmp_path / "m.pgm").read_bytes() == (tmp_path / "alone.pgm").read_bytes()
    ran = lidarcli("-q", "map", DRIVE, tmp_path / "missing.mcap", "-o", tmp_path / "n.yaml")
    assert (ran.code, ran.err) == (3, f"lidarcli: {tmp_path / 'missing.mcap'}: no such file or folder\n")
    assert (tmp_path / "n.pgm").read_bytes() == (tmp_path / "alone.pgm").read_bytes()


def test_a_damaged_log_is_mapped_as_far_as_it_can_be_read(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    log = tmp_path / "cut.mcap"
    data = (walk / "walk.mcap").read_bytes()
    log.write_bytes(data[: len(data) * 9 // 10])
    ran = lidarcli("map", log, "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.parquet")
    assert ran.code == 3
    assert ran.err.startswith(f"lidarcli: {log}: ")
    assert ran.err.splitlines()[-1] == f"  wrote    {tmp_path / 'm.parquet'}"
    assert len(occupied(tmp_path / "m.yaml")) > 100
    metadata = pq.read_schema(tmp_path / "m.parquet").metadata
    assert json.loads(metadata[b"lidarcli.damage"])[0].startswith("cut.mcap: ")


def test_a_damaged_database_is_mapped_as_far_as_it_can_be_read(lidarcli: Run, tmp_path: Path) -> None:
    log = tmp_path / "cut.db3"
    data = DRIVE.read_bytes()
    log.write_bytes(data[: len(data) * 3 // 4])
    ran = lidarcli("map", log, "-o", tmp_path / "m.yaml")
    assert ran.code == 3
    assert ran.err.startswith(f"lidarcli: {log}: ")
    assert names(tmp_path) == ["cut.db3", "m.pgm", "m.yaml"]
    assert len(occupied(tmp_path / "m.yaml")) > 100


def points_of(path: Path) -> Any:
    table = pq.read_table(path)
    return table["sweep"].to_numpy(), np.column_stack([table["x"].to_numpy(), table["y"].to_numpy()])


@pytest.mark.slow
def test_start_end_every_range_min_move(lidarcli: Run, tmp_path: Path) -> None:
    def sweeps(*options: object) -> tuple[list[int], Any]:
        out = tmp_path / "m.parquet"
        assert lidarcli("-q", "map", DRIVE, "-o", out, "--overwrite", *options).code == 0
        index, points = points_of(out)
        return sorted(set(index.tolist())), points

    whole, points = sweeps()
    assert (whole[0], len(whole)) == (0, 64)
    every, _ = sweeps("--min-move", 0, "--start", 1, "--end", 3)
    assert every == list(range(5, 15))
    third, _ = sweeps("--min-move", 0, "--every", 3, "--end", 3)
    assert third == [0, 3, 6, 9, 12]
    coarse, _ = sweeps("--min-move", 1)
    assert len(coarse) < len(whole)
    _, close = sweeps("--range", "0.1", "3")
    assert 0 < len(close) < len(points)


def test_range_leaves_walls_out(lidarcli: Run, tmp_path: Path) -> None:
    for name, options in (("all", ()), ("near", ("--range", "0.1", "1.5"))):
        assert lidarcli("-q", "map", DRIVE, "-o", tmp_path / f"{name}.yaml", *options).code == 0
    every, close = occupied(tmp_path / "all.yaml"), occupied(tmp_path / "near.yaml")
    assert 0 < len(close) < 0.7 * len(every)


@pytest.mark.slow
def test_min_hits_and_ratio(lidarcli: Run, tmp_path: Path) -> None:
    found = {}
    for name, options in {
        "default": (),
        "two": ("--min-hits", 2),
        "one": ("--min-hits", 1),
        "nine": ("--min-hits", 9),
        "share": ("--occupied-ratio", 0.8),
        "any": ("--occupied-ratio", 0),
        "all": ("--occupied-ratio", 1),
    }.items():
        assert lidarcli("-q", "map", DRIVE, "-o", tmp_path / f"{name}.yaml", *options).code == 0
        found[name] = occupied(tmp_path / f"{name}.yaml")
    assert found["two"] == found["default"]
    assert found["nine"] < found["two"] < found["one"]
    assert found["share"] < found["default"] < found["any"]
    # More than all of them never hit.
    assert found["all"] == set()
    ran = lidarcli("map", DRIVE, "-o", tmp_path / "none.yaml", "--min-hits", 65)
    assert (
        "  note     no cell is occupied: 64 sweeps count, and a cell has to be hit by 65 (--min-hits, --min-move)"
        in ran.err.splitlines()
    )
    # Four hits by default where every sweep counts.
    for name, options in {"a": ("--min-move", 0), "b": ("--min-move", 0, "--min-hits", 4)}.items():
        assert lidarcli("-q", "map", DRIVE, "-o", tmp_path / f"{name}.yaml", *options).code == 0
    assert (tmp_path / "a.pgm").read_bytes() == (tmp_path / "b.pgm").read_bytes()


def test_free_no_return(lidarcli: Run, tmp_path: Path) -> None:
    sweeps = room_sweeps(count=4)
    ranges = sweeps.ranges.copy()
    ranges[:, 90:180] = np.inf
    log = tmp_path / "half.mcap"
    write_log(log, [RawSweeps(**{name: getattr(sweeps, name) for name in fields()} | {"ranges": ranges})])
    (tmp_path / "p.tum").write_text("1700000000 0 0 0 0 0 0 1\n1700000001 0.01 0 0 0 0 0 1\n")
    free = {}
    for name, options in {"none": (), "two": ("--free-no-return", 2)}.items():
        ran = lidarcli(
            *(
                "map",
                log,
                "--poses",
                tmp_path / "p.tum",
                "-o",
                tmp_path / f"{name}.yaml",
                "--min-move",
                0,
                *options,
            )
        )
        assert ran.code == 0
        free[name] = read_map(tmp_path / f"{name}.yaml").free
    # A quarter of a disc with a radius of 2 m, without the cells in which the beams end.
    assert free["two"] - free["none"] == pytest.approx(np.pi * 1.95**2 / 4 / 0.05**2, rel=0.03)


def fields() -> tuple[str, ...]:
    """What a block of sweeps is made of."""
    return tuple(RawSweeps.__dataclass_fields__)


def test_voxel(lidarcli: Run, tmp_path: Path) -> None:
    counts = {}
    for size in (0, 0.05, 0.2):
        out = tmp_path / f"{size}.ply"
        assert lidarcli("-q", "map", DRIVE, "-o", out, "--voxel", size).code == 0
        points = ply(out)
        counts[size] = len(points)
        if size:
            assert len(np.unique(np.floor(points / size), axis=0)) == len(points)
    assert counts[0] > counts[0.05] > counts[0.2] > 100


def test_agents(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    """Who came and stays is a ghost in the map, unless agents are left out; what has always stood stays."""
    words = ("-q", "map", walk / "walk.mcap", "--min-move", 0, "-o")
    assert lidarcli(*words, tmp_path / "with.yaml", "-o", tmp_path / "with.parquet").code == 0
    assert (
        lidarcli(*words, tmp_path / "out.yaml", "-o", tmp_path / "out.parquet", "--without-agents").code == 0
    )
    ghost, gone = occupied(tmp_path / "with.yaml"), occupied(tmp_path / "out.yaml")
    assert (near(ghost, *GHOST) > 8, near(gone, *GHOST)) == (True, 0)
    assert near(ghost, -2, -1.5, 0.5) == near(gone, -2, -1.5, 0.5) > 20
    assert read_map(tmp_path / "out.yaml").cells[round((1.5 + 3.1) / 0.05), round(5.1 / 0.05)] != OCCUPIED
    sets = {}
    for name in ("with", "out"):
        table = pq.read_table(tmp_path / f"{name}.parquet")
        sets[name] = Counter(table["set"].to_pylist())
    assert {*sets["with"]} == {"O", "A", "S"}
    assert sets["with"]["A"] > 1000
    assert sets["out"] == {"O": sets["with"]["O"], "S": sets["with"]["S"]}


def still(folder: Path, ranges: Any, **columns: Any) -> tuple[Path, Path]:
    """A log of such ranges, and a path on which its sensor goes 5 cm from sweep to sweep."""
    write_log(folder / "odd.mcap", [raw_sweeps(ranges, **columns)])
    lines = [f"{1_700_000_000 + k / 10:.3f} {0.05 * k:.3f} 0 0 0 0 0 1\n" for k in range(-1, len(ranges) + 2)]
    (folder / "odd.tum").write_text("".join(lines))
    return folder / "odd.mcap", folder / "odd.tum"


@pytest.mark.parametrize("kind", ["nothing", "zero"])
@pytest.mark.parametrize("suffix", ["mcap", "yaml", "png", "ply"])
def test_sweeps_that_see_nothing(lidarcli: Run, tmp_path: Path, kind: str, suffix: str) -> None:
    """A map without a cell is refused, or whoever reads it gets along with it."""
    ranges = np.full((5, 90 if kind == "nothing" else 0), np.nan, np.float32)
    log, path = still(tmp_path, ranges)
    out = tmp_path / f"m.{suffix}"
    ran = lidarcli("map", log, "--poses", path, "-o", out)
    assert ran.code in (0, 3)
    assert "internal error" not in ran.err
    if suffix == "yaml" and out.exists():
        assert read_map(out).occupied == 0


@pytest.mark.parametrize("beams", [1, 2])
def test_sweeps_of_few_beams(lidarcli: Run, tmp_path: Path, beams: int) -> None:
    log, path = still(tmp_path, np.full((5, beams), 2.02, np.float32), angle_min=0.0)
    thresholds = ("--min-move", 0, "--min-hits", 1, "--occupied-ratio", 0)
    ran = lidarcli("map", log, "--poses", path, "-o", tmp_path / "m.yaml", *thresholds)
    assert ran.code == 0
    ahead, behind = {*range(40, 45)}, {*range(-41, -36)}
    assert {i for i, _ in occupied(tmp_path / "m.yaml")} == ahead | (behind if beams == 2 else set())


@pytest.mark.slow
def test_a_sweep_of_many_beams(lidarcli: Run, tmp_path: Path) -> None:
    log, path = still(tmp_path, np.full((3, 400_000), 4.0, np.float32))
    ran = lidarcli("map", log, "--poses", path, "-o", tmp_path / "m.yaml", "--min-move", 0, "--min-hits", 1)
    assert ran.code == 0
    # Some cells of the circle are passed by the two other sweeps, which is not enough to free them.
    assert len(occupied(tmp_path / "m.yaml")) > 8 * 4.0 / 0.05 - 20


@pytest.mark.parametrize("step", [np.nan, np.inf, -np.inf, 1e30, -1e30, 1e-45])
def test_odd_times_of_beams_change_nothing(lidarcli: Run, tmp_path: Path, step: float) -> None:
    blocks = raw_sweeps(np.full((9, 90), 3.0, np.float32))
    for name, time in (("odd", step), ("none", 0.0)):
        told = {"time_increment": np.full(9, time, np.float32), "scan_time": np.full(9, time, np.float32)}
        values = {each: getattr(blocks, each) for each in fields()} | told
        write_log(tmp_path / f"{name}.mcap", [RawSweeps(**values)])
    lines = [f"{1_700_000_000 + k / 10:.3f} {0.3 * k:.3f} 0 0 0 0 0 1\n" for k in range(-1, 11)]
    (tmp_path / "p.tum").write_text("".join(lines))
    for name in ("odd", "none"):
        words = ("-q", "map", tmp_path / f"{name}.mcap", "--poses", tmp_path / "p.tum")
        assert lidarcli(*words, "-o", tmp_path / name / "m.yaml", "-o", tmp_path / name / "m.ply").code == 0
    for name in ("m.pgm", "m.ply"):
        assert (tmp_path / "odd" / name).read_bytes() == (tmp_path / "none" / name).read_bytes()


def test_deskewing_sharpens(lidarcli: Run, tmp_path: Path) -> None:
    """A sensor that goes 2 m/s and takes 0.1 s for a turn: without deskewing beams are up to 0.2 m off."""
    beams, count = 360, 30
    bearing = -np.pi + 2 * np.pi / beams * np.arange(beams)
    lines = [f"{1_700_000_000 + k / 10:.3f} {0.2 * k:.3f} 0 0 0 0 0 1\n" for k in range(-1, count + 2)]
    (tmp_path / "p.tum").write_text("".join(lines))
    rows = []
    for k in range(count):
        x = 0.2 * (k + np.arange(beams) / (beams - 1) * 0.999)
        with np.errstate(divide="ignore"):
            # A wall at x = 9.52 before, and one at x = -3.02 behind.
            distance = np.where(np.cos(bearing) > 0, 9.52 - x, -3.02 - x) / np.cos(bearing)
        rows.append(np.where(distance < 15, distance, np.inf))
    block = raw_sweeps(np.array(rows, np.float32), range_max=20.0)
    told = {"time_increment": np.full(count, 0.0999 / (beams - 1), np.float32)}
    write_log(tmp_path / "run.mcap", [RawSweeps(**{name: getattr(block, name) for name in fields()} | told)])
    spread = {}
    for name, options in {"sharp": (), "skewed": ("--no-deskew",)}.items():
        out = tmp_path / f"{name}.ply"
        words = (
            "-q",
            "map",
            tmp_path / "run.mcap",
            "--poses",
            tmp_path / "p.tum",
            "--pose-delay",
            0,
            "-o",
            out,
        )
        assert lidarcli(*words, *options).code == 0
        x = ply(out)[:, 0]
        spread[name] = float(np.abs(x[x > 5] - 9.52).max())
    assert spread["sharp"] < 0.005
    assert spread["skewed"] > 0.05


def test_poses_far_away(lidarcli: Run, tmp_path: Path) -> None:
    """A map in coordinates of a map projection, and one at 1e8 m, is the same map elsewhere."""
    log, _ = still(tmp_path, np.full((9, 90), 3.02, np.float32))
    shapes = []
    for far in (0, 500_000, 100_000_000, -100_000_000):
        lines = [f"{1_700_000_000 + k / 10:.3f} {far + 0.3 * k:.3f} {far} 0 0 0 0 1\n" for k in range(-1, 11)]
        (tmp_path / "p.tum").write_text("".join(lines))
        ran = lidarcli("-q", "map", log, "--poses", tmp_path / "p.tum", "-o", tmp_path / f"{far}.yaml")
        assert ran.code == 0
        grid = read_map(tmp_path / f"{far}.yaml")
        assert grid.x - far == pytest.approx(-3.1, abs=0.06)
        shapes.append((grid.cells == OCCUPIED).sum())
    assert max(shapes) - min(shapes) <= 0.15 * max(shapes)


BEYOND = """
import numpy as np
from lidarcli.formalism.mapping.counts import Counts, TooLargeError, placed
from lidarcli.sweeps import RangeRules, SweepPoses, normalise
from tests.sweeping import raw_sweeps, round_room
batch = normalise(raw_sweeps(round_room(1, 90)), np.arange(1), RangeRules())
for far in (1e12, 1e13, 1e15, 1.98e15, -1.98e15, 1e17, 1e25, 1e300):
    for resolution in (0.05, 0.001):
        poses = SweepPoses(np.array([far]), np.array([far]), np.zeros(1), np.zeros(1, bool))
        try:
            Counts(resolution, 10**9).add(placed(batch, poses, np.ones((1, 90), np.uint8)))
        except TooLargeError:
            pass
"""


@pytest.mark.slow
def test_no_cell_outside_is_counted() -> None:
    """Chains of tf may add up to more than the 1e12 m of a single pose. Compiled, such a cell is somebody else's memory."""
    checked = {**os.environ, "LIDARCLI_COMPILED": "no", "LIDARCLI_BOUNDS": "1"}
    command = [sys.executable, "-W", "ignore", "-c", BEYOND]
    ran = subprocess.run(command, cwd=ROOT, env=checked, capture_output=True, text=True, check=False)
    assert ran.stderr == ""


def test_a_pose_that_jumps_far(lidarcli: Run, tmp_path: Path) -> None:
    log, _ = still(tmp_path, np.full((9, 90), 3.0, np.float32))
    (tmp_path / "p.tum").write_text("1700000000 0 0 0 0 0 0 1\n1700000001 1000000 0 0 0 0 0 1\n")
    ran = lidarcli("map", log, "--poses", tmp_path / "p.tum", "-o", tmp_path / "m.yaml")
    assert (ran.code, len(ran.err.splitlines())) == (2, 1)
    assert f"{log}: the map would reach over " in ran.err
    assert not (tmp_path / "m.yaml").exists()


def test_a_pipe_with_a_path_from_a_file(process: Run, tmp_path: Path) -> None:
    log, path = still(tmp_path, np.full((9, 90), 3.0, np.float32))
    words = ("map", "-", "--poses", path, "-o", tmp_path / "m.yaml")
    ran = process(*words, input=log.read_bytes())
    assert (ran.returncode, (tmp_path / "m.yaml").exists()) == (0, True), ran.stderr


def test_names_of_files(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    for name in ("häß 'x' \"y\"", "two\nlines", "a: b #c", "-o"):
        out = tmp_path / f"{name}.yaml"
        assert lidarcli("-q", "map", walk / "walk.mcap", "-o", out).code == 0
        assert out.with_suffix(".pgm").exists()
        assert read_map(out).occupied == 1029


def test_a_folder_that_is_not_there_is_made(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    assert lidarcli("-q", "map", walk / "walk.mcap", "-o", tmp_path / "a" / "b" / "m.yaml").code == 0
    assert names(tmp_path) == ["a", "a/b", "a/b/m.pgm", "a/b/m.yaml"]
    (tmp_path / "file").touch()
    ran = lidarcli("map", walk / "walk.mcap", "-o", tmp_path / "file" / "m.yaml")
    assert (ran.code, len(ran.err.splitlines())) == (5, 1)


@pytest.mark.parametrize(
    ("words", "cause"),
    [
        (("--path", "-o", "m.yaml"), "--path is drawn into a picture: give -o FILE.png"),
        (
            ("--voxel", "0.1", "-o", "m.png"),
            "--voxel is for a point cloud: give -o with .ply, .pcd, .parquet",
        ),
    ],
)
def test_an_option_without_its_output(lidarcli: Run, words: tuple[str, ...], cause: str) -> None:
    ran = lidarcli("map", DRIVE, *words)
    assert ran.code == 2
    assert cause in ran.err
