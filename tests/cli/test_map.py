"""`lidarcli map`: what it writes of each kind, what its options change, and what it refuses."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from PIL import Image

from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN
from lidarcli.logs.batches import ReadOptions
from lidarcli.maps.clouds import CloudPoints, PlyWriter
from lidarcli.maps.grids import read_map
from lidarcli.pipeline.mapping import WRITERS
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import RawSweeps
from lidarcli.tabular.schemas import CLOUD
from tests.cli.maps import COUNTED, DRIVE, GHOST, POSES_NOTE, Run, fields, mapped, names, near, occupied, ply, still
from tests.places import ROOT
from tests.pose.pose_messages import told_of_drive
from tests.sweeping import START, raw_sweeps, room_sweeps


def test_yaml(lidarcli: Run, tmp_path: Path) -> None:
    ran = lidarcli("-v", "map", DRIVE, "-o", tmp_path / "room.yaml")
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
    assert (grid.occupied, grid.free) == (1407, 24467)
    # The walls are at 4.5 and 3.5 m, as far as the odometry was right; beyond them nothing is known.
    for edge in (grid.cells[0], grid.cells[-1], grid.cells[:, 0], grid.cells[:, -1]):
        assert (edge == UNKNOWN).all()
    row, column = round(3.75 / 0.05), round(4.7 / 0.05)
    assert (grid.cells[row - 2 : row + 2, 20:30] == FREE).all()
    assert (grid.cells[row - 20 : row + 20, column + 86 : column + 94] == OCCUPIED).any(axis=1).all()


@pytest.mark.slow
def test_png(lidarcli: Run, tmp_path: Path) -> None:
    """The grid alone; its path is in the picture of `plot`."""
    for name, words in (("plain", ["map", DRIVE]), ("path", ["plot", DRIVE, "--view", "map"])):
        ran = lidarcli(*words, "-o", tmp_path / f"{name}.png")
        assert (ran.code, ran.err.splitlines()[-1]) == (0, f"  wrote    {tmp_path / f'{name}.png'}")
    with Image.open(tmp_path / "plain.png") as plain, Image.open(tmp_path / "path.png") as path:
        assert plain.size[0] > plain.size[1] > 600
        green = [
            np.asarray(image.convert("RGB")).astype(int)[..., 1] - np.asarray(image.convert("RGB")).astype(int)[..., 0]
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
    assert message.log_time == START + 148 * 200_000_000
    assert b"odom\0" in message.data[:40]


def test_clouds(lidarcli: Run, tmp_path: Path) -> None:
    outputs = [word for suffix in ("ply", "pcd", "parquet", "yaml") for word in ("-o", tmp_path / f"c.{suffix}")]
    lidarcli("map", DRIVE, *outputs, code=0)
    table = pq.read_table(tmp_path / "c.parquet")
    assert table.schema.equals(CLOUD)
    points = np.column_stack([table["x"].to_numpy(), table["y"].to_numpy(), np.zeros(len(table))])
    assert np.array_equal(ply(tmp_path / "c.ply"), points)
    head, _, data = (tmp_path / "c.pcd").read_bytes().partition(b"DATA binary\n")
    assert f"POINTS {len(points)}\n".encode() in head
    assert np.array_equal(np.frombuffer(data, "<f4").reshape(-1, 3), points.astype(np.float32))
    sweeps, counts = np.unique(table["sweep"].to_numpy(), return_counts=True)
    assert (len(sweeps), counts.max() <= 361, len(points)) == (75, True, 26_994)
    stamps = table["stamp"].cast("int64").to_numpy()
    assert np.array_equal(stamps, START + 200_000_000 * table["sweep"].to_numpy())
    assert set(table["log"].to_pylist()) == {"drive"}
    assert set(table["topic"].to_pylist()) == {"/scan"}
    assert set(table["set"].to_pylist()) == {"O", "S"}
    metadata = table.schema.metadata or {}
    parameters = json.loads(metadata[b"lidarcli.parameters"])
    assert (parameters["resolution"], parameters["min_move"], parameters["voxel"]) == (0.05, 0.12, 0.0)
    (source,) = json.loads(metadata[b"lidarcli.source"])
    assert source["poses"] == {"laser": told_of_drive("/tf", "odom")}
    # Nearly every point lies in or beside an occupied cell: all but what only one sweep hit.
    cells = occupied(tmp_path / "c.yaml")
    around = {(i + di, j + dj) for i, j in cells for di in (-1, 0, 1) for dj in (-1, 0, 1)}
    at = np.floor(points[:, :2] / 0.05).astype(int)
    there = [(i, j) in around for i, j in at.tolist()]
    assert np.mean(there) > 0.985


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


def test_two_topics_of_one_frame_count_once(lidarcli: Run, logs: Path, tmp_path: Path) -> None:
    lines = [f"{1_700_000_000 + k} {0.25 * k} 0 0 0 0 0 1\n" for k in range(-1, 4)]
    (tmp_path / "p.tum").write_text("".join(lines))
    words = ("map", logs / "two.mcap", "--poses", tmp_path / "p.tum", "--min-move", 0, "-o")
    ran = lidarcli(*words, tmp_path / "m.parquet", code=0)
    topics = pq.read_table(tmp_path / "m.parquet")["topic"].to_pylist()
    (first,) = set(topics)
    other = {"/front": "/rear", "/rear": "/front"}[first]
    assert (
        f"  note     {other} is of the same frame as {first}, most likely the same sweeps again: left out (--topic {other})"
    ) in ran.err.splitlines()
    ran = lidarcli(*words, tmp_path / "n.parquet", "--topic", "/rear", "--topic", "/front")
    assert Counter(pq.read_table(tmp_path / "n.parquet")["topic"].to_pylist()) == {
        "/front": len(topics),
        "/rear": len(topics),
    }


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


def test_names_of_files(lidarcli: Run, walk: Path, tmp_path: Path) -> None:
    for name in ("häß 'x' \"y\"", "two\nlines", "a: b #c", "-o"):
        out = tmp_path / f"{name}.yaml"
        assert lidarcli("-q", "map", walk / "walk.mcap", "-o", out).code == 0
        assert out.with_suffix(".pgm").exists()
        assert read_map(out).occupied == 1086


def test_free_no_return(lidarcli: Run, tmp_path: Path) -> None:
    sweeps = room_sweeps(count=4)
    ranges = sweeps.ranges.copy()
    ranges[:, 90:180] = np.inf
    log = tmp_path / "half.mcap"
    write_log(log, [RawSweeps(**{name: getattr(sweeps, name) for name in fields()} | {"ranges": ranges})])
    (tmp_path / "p.tum").write_text("1700000000 0 0 0 0 0 0 1\n1700000001 0.01 0 0 0 0 0 1\n")
    free = {}
    for name, options in {"none": (), "two": ("--free-no-return", 2)}.items():
        lidarcli(
            *("map", log, "--poses", tmp_path / "p.tum", "-o", tmp_path / f"{name}.yaml", "--min-move", 0, *options), code=0
        )
        free[name] = read_map(tmp_path / f"{name}.yaml").free
    # A quarter of a disc with a radius of 2 m, without the cells in which the beams end.
    assert free["two"] - free["none"] == pytest.approx(np.pi * 1.95**2 / 4 / 0.05**2, rel=0.03)


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
    assert lidarcli(*words, tmp_path / "out.yaml", "-o", tmp_path / "out.parquet", "--without", "agents").code == 0
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


@pytest.mark.parametrize(
    ("options", "cause"),
    [
        ((), "Missing option '-o' / '--output'"),
        (
            ("-o", "{}/m.xyz"),
            "lidarcli: {}/m.xyz: the suffix of a map has to be one of .yaml, .png, .mcap, .ply, .pcd, .parquet\n",
        ),
        (("-o", "{}/m"), "lidarcli: {}/m: the suffix of a map has to be one of "),
        (("-o", "-"), "lidarcli: -: the suffix of a map has to be one of "),
        (("-o", "{}/m.pgm"), ".parquet; {}/m.yaml comes with a .pgm\n"),
        (
            ("-o", "{}/m.png", "-o", "{}/m.ply", "-o", "{}/m.png"),
            "lidarcli: {}/m.png is to be written twice; give each output a name of its own\n",
        ),
        (
            ("-o", "{}/m.YAML", "-o", "{}/m.yaml"),
            "lidarcli: {}/m.pgm is to be written twice; give each output a name of its own\n",
        ),
        (("-o", "{}/m.yaml", "--resolution", "0.0001"), "'--resolution': 0.0001 is below 0.001."),
        (("-o", "{}/m.ply", "--voxel", "1e-12"), "--voxel: 1e-12 m is less than the least cell of 0.001 m; 0 keeps"),
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


def test_logs_without_poses(lidarcli: Run, tmp_path: Path) -> None:
    blind = tmp_path / "blind.mcap"
    write_log(blind, [raw_sweeps(np.full((20, 360), np.inf))])
    ran = lidarcli("map", blind, "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.ply")
    assert (ran.code, ran.out, len(ran.err.splitlines())) == (3, "", 1)
    assert ran.err.startswith(f"lidarcli: {blind}: no poses: ")
    assert "no path of frame laser: the sweeps of /scan cannot be matched" in ran.err
    assert names(tmp_path) == ["blind.mcap"]
    blind.unlink()
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


def test_a_log_without_poses_beside_a_good_one(lidarcli: Run, tmp_path: Path) -> None:
    blind = tmp_path / "blind.mcap"
    write_log(blind, [raw_sweeps(np.full((20, 360), np.inf))])
    ran = lidarcli("map", blind, DRIVE, "-o", tmp_path / "m.yaml", code=3)
    assert any(line.startswith(f"lidarcli: {blind}: no poses: ") for line in ran.err.splitlines())
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
    ran = lidarcli("map", log, "-o", tmp_path / "m.yaml", "-o", tmp_path / "m.parquet", code=3)
    assert ran.err.startswith(f"lidarcli: {log}: ")
    assert ran.err.splitlines()[-1] == f"  wrote    {tmp_path}/m.{{yaml,pgm,parquet}}"
    assert len(occupied(tmp_path / "m.yaml")) > 100
    metadata = pq.read_schema(tmp_path / "m.parquet").metadata
    assert json.loads(metadata[b"lidarcli.damage"])[0].startswith("cut.mcap: ")


BEYOND = """
import numpy as np
from lidarcli.formalism.mapping.grid import Counts, TooLargeError, placed
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import SweepPoses
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
