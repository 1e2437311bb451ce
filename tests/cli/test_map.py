"""`lidarcli map`: what it writes of each kind, of one log and of several, and how right it is."""

from __future__ import annotations

import errno
import json
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
from lidarcli.tabular.schemas import CLOUD
from tests.cli.maps import COUNTED, DRIVE, POSES_NOTE, Run, mapped, names, occupied, ply, still
from tests.pose.pose_messages import told_of_drive
from tests.sweeping import START


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
    ran = lidarcli(*words, tmp_path / "m.parquet")
    assert ran.code == 0
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
