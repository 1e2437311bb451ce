"""Recordings of rerun, read back by rerun: beams, objects and poses are those of the tables."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN, Occupancy
from lidarcli.maps.grids import pgm_bytes, yaml_bytes
from lidarcli.pose.tracks import rotate
from lidarcli.simulation.writers import write_log
from tests.overlays.silent import silenced
from tests.places import SAMPLES
from tests.sweeping import START, room_sweeps

rerun = pytest.importorskip("rerun")
chunk = pytest.importorskip("rerun.chunk")

Run = Callable[..., Any]
DRIVE, PEOPLE = SAMPLES / "drive.db3", SAMPLES / "people.csv.gz"


class Shown:
    """All that a recording holds: entity → component → the rows of its chunks."""

    def __init__(self, path: Path) -> None:
        reader = chunk.RrdReader(path)
        self._chunks = [(each.entity_path, each.to_record_batch()) for each in reader.stream().to_chunks()]
        self.blueprint = [
            (each.entity_path, each.to_record_batch())
            for store in reader.blueprints()
            for each in reader.stream(store=store).to_chunks()
        ]

    @property
    def entities(self) -> set[str]:
        return {entity for entity, _ in self._chunks}

    @property
    def components(self) -> set[tuple[str, str]]:
        return {(entity, name) for entity, batch in self._chunks for name in batch.schema.names}

    def rows(self, entity: str, component: str) -> Iterator[tuple[int, Any]]:
        """Stamp [ns], 0 of what is static, and values of each row."""
        for name, batch in self._chunks:
            if name == entity and component in batch.schema.names:
                stamps = batch["stamp"].cast(pa.int64()).to_pylist() if "stamp" in batch.schema.names else [0] * len(batch)
                yield from zip(stamps, batch[component].to_pylist(), strict=True)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of a robot that drives and of people before a sensor that stands, and the tables of both."""
    from lidarcli.cli import run

    folder = tmp_path_factory.mktemp("recordings")
    for log in (DRIVE, PEOPLE):
        name = log.name.split(".")[0]
        assert run(["-q", "track", str(log), "-o", str(folder)]) == 0
        table = folder / f"{name}.objects.parquet"
        told = ("-o", str(folder / f"{name}.rrd"), "--objects", str(table))
        assert run(["-q", "overlay", str(log), *told]) == 0
    return folder


def test_nothing_is_written_beside_a_recording(made: Path) -> None:
    assert not [*made.glob("*.rviz"), *made.glob("*.json")]


@pytest.mark.parametrize(("name", "is_posed"), [("drive", True), ("people", False)])
def test_each_sweep_is_at_its_pose_with_its_beams(made: Path, name: str, is_posed: bool) -> None:
    shown = Shown(made / f"{name}.rrd")
    sweeps = pq.read_table(made / f"{name}.sweeps.parquet").to_pylist()
    stamps = [row["stamp"].value for row in sweeps]
    beams = list(shown.rows("/scan/beams", "Points3D:positions"))
    assert [stamp for stamp, _ in beams] == stamps
    assert [len(points) for _, points in beams] == [row["valid"] for row in sweeps]
    nearest = [np.hypot(*np.array(points).T[:2]).min() for _, points in beams]
    assert nearest == pytest.approx([row["nearest"] for row in sweeps], rel=1e-5)
    places = list(shown.rows("/scan", "Transform3D:translation"))
    turns = list(shown.rows("/scan", "Transform3D:quaternion"))
    if not is_posed:
        assert places == turns == []
        return
    assert [stamp for stamp, _ in places] == stamps
    expected = [[row["pose_x"], row["pose_y"], 0.0] for row in sweeps]
    assert np.array([place for _, (place,) in places]) == pytest.approx(np.array(expected), abs=1e-6)
    ahead = rotate(np.array([turn for _, (turn,) in turns]), np.tile([1.0, 0.0, 0.0], (len(turns), 1)))
    yaw = np.array([row["pose_yaw"] for row in sweeps])
    assert ahead[:, :2] == pytest.approx(np.column_stack([np.cos(yaw), np.sin(yaw)]), abs=1e-6)


@pytest.mark.parametrize("name", ["drive", "people"])
def test_each_sweep_has_the_bodies_of_its_objects_and_no_others(made: Path, name: str) -> None:
    shown = Shown(made / f"{name}.rrd")
    objects = pq.read_table(made / f"{name}.objects.parquet").to_pylist()
    found = [
        (stamp, *place[:2])
        for component in ("Boxes3D:centers", "Cylinders3D:centers")
        for stamp, places in shown.rows("/scan/body", component)
        for place in places
    ]
    expected = [(row["stamp"].value, row["box_x"], row["box_y"]) for row in objects]
    assert np.array(sorted(found)) == pytest.approx(np.array(sorted(expected)), abs=1e-5)
    sweeps = pq.read_metadata(made / f"{name}.sweeps.parquet").num_rows
    # A kind is told in all sweeps once there has been one: what is not seen any more goes away.
    for entity, component in (("body", "Boxes3D:centers"), ("label", "Points3D:labels")):
        assert len(list(shown.rows(f"/scan/{entity}", component))) == sweeps


@pytest.fixture(scope="module")
def room(made: Path) -> Path:
    """A map of 3 x 2 cells of 0.5 m."""
    cells = np.array([[FREE, FREE, OCCUPIED], [FREE, UNKNOWN, UNKNOWN]], np.int8)
    grid = Occupancy(0.5, -1.0, -2.0, cells)
    (made / "room.yaml").write_bytes(yaml_bytes(grid, "room.pgm"))
    (made / "room.pgm").write_bytes(pgm_bytes(grid))
    return made / "room.yaml"


def test_a_map_lies_below_the_beams(lidarcli: Run, made: Path, room: Path, tmp_path: Path) -> None:
    out = tmp_path / "o.rrd"
    told = ("--map", room, "--objects", made / "drive.objects.parquet")
    assert lidarcli("-q", "overlay", DRIVE, "-o", out, *told).code == 0
    shown = Shown(out)
    ((_, corners),) = shown.rows("/lidarcli/map", "Mesh3D:vertex_positions")
    assert np.array(corners) == pytest.approx(
        np.array([[-1.0, -2.0, -0.05], [0.5, -2.0, -0.05], [0.5, -1.0, -0.05], [-1.0, -1.0, -0.05]])
    )
    ((_, (picture,)),) = shown.rows("/lidarcli/map", "Mesh3D:albedo_texture_buffer")
    alpha = np.array(list(picture), np.uint8).reshape(2, 3, 4)[..., 3]
    # The top row of a picture is that of the greatest y.
    assert alpha.tolist() == [[255, 0, 0], [255, 255, 255]]


def test_a_map_without_poses_is_left_out(lidarcli: Run, made: Path, room: Path, tmp_path: Path) -> None:
    out = tmp_path / "o.rrd"
    ran = lidarcli("overlay", PEOPLE, "-o", out, "--map", room, "--objects", made / "people.objects.parquet")
    assert ran.code == 0
    assert "  note     the map is left out, for nothing tells where the sensor is in it" in ran.err
    assert "/lidarcli/map" not in Shown(out).entities


def hidden(shown: Shown) -> set[str]:
    """Entities that the view hides at first."""
    return {
        path.split("/overrides/")[1].removesuffix("/visualizers").replace("\\", "")
        for path, batch in shown.blueprint
        if "EntityBehavior:visible" in batch.schema.names
    }


def test_of_two_topics_of_one_frame_one_is_seen_at_first(lidarcli: Run, tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", [room_sweeps("/scan"), room_sweeps("/stable/scan")])
    ran = lidarcli("overlay", tmp_path / "run.mcap", "-o", tmp_path / "o.rrd")
    assert ran.code == 0
    assert "/stable/scan is of frame laser, as /scan is, and is hidden at first" in ran.err
    shown = Shown(tmp_path / "o.rrd")
    assert hidden(shown) == {"stable/scan"}
    assert {r"/scan/beams", r"/stable\/scan/beams"} <= shown.entities


def test_sweeps_without_a_pose_are_not_drawn_where_others_have_one(lidarcli: Run, made: Path, tmp_path: Path) -> None:
    for name in ("objects", "trajectories"):
        (tmp_path / f"drive.{name}.parquet").write_bytes((made / f"drive.{name}.parquet").read_bytes())
    table = pq.read_table(made / "drive.sweeps.parquet")
    for name in ("pose_x", "pose_y", "pose_yaw"):
        at = table.schema.get_field_index(name)
        values = [None] * 10 + table[name].to_pylist()[10:]
        table = table.set_column(at, table.schema.field(at), pa.array(values, table.schema.field(at).type))
    pq.write_table(table, tmp_path / "drive.sweeps.parquet")
    out = tmp_path / "o.rrd"
    ran = lidarcli("overlay", DRIVE, "-o", out, "--objects", tmp_path / "drive.objects.parquet")
    assert ran.code == 0
    assert "  note     10 sweeps are not drawn, for they have no pose" in ran.err.splitlines()
    drawn = [stamp for stamp, _ in Shown(out).rows("/scan/beams", "Points3D:positions")]
    assert drawn == [stamp.value for stamp in table["stamp"].to_pylist()[10:]]


def test_of_an_overlay_for_ros_rerun_draws_the_map_alone(lidarcli: Run, made: Path, tmp_path: Path) -> None:
    """As docs/overlay.md has it, of the rerun that is installed: what it draws has components of its own."""
    overlay, shown = tmp_path / "o.mcap", tmp_path / "o.rrd"
    assert lidarcli("map", DRIVE, "-o", tmp_path / "site.yaml").code == 0
    told = ("--map", tmp_path / "site.yaml", "--objects", made / "drive.objects.parquet")
    assert lidarcli("overlay", DRIVE, "-o", overlay, *told).code == 0
    convert = [sys.executable, "-m", "rerun", "mcap", "convert", str(overlay), "-o", str(shown)]
    subprocess.run(convert, env={**os.environ, "HOME": str(tmp_path)}, check=True, capture_output=True)
    of = Shown(shown)
    assert len(list(of.rows("/lidarcli/map", "GridMap:data"))) == 1
    assert len(list(of.rows("/lidarcli/objects", "visualization_msgs.msg.MarkerArray:message"))) == 150
    drawn = [name for entity, name in of.components if entity == "/lidarcli/objects" and name[0].isupper()]
    assert all(name.startswith(("McapChannel:", "McapSchema:")) for name in drawn), drawn


def test_without_rerun_the_extra_is_named(lidarcli: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "lidarcli.overlays.rrd", raising=False)
    ran = lidarcli("overlay", DRIVE, "-o", tmp_path / "o.rrd")
    assert ran.code == 2
    assert (
        "lidarcli: an overlay as .rrd needs rerun-sdk, which is not installed: pip install 'lidarcli[rerun]'"
        in ran.err.splitlines()
    )
    assert not list(tmp_path.iterdir())


def test_rerun_that_is_turned_off_is_told(
    lidarcli: Run, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RERUN", "off")
    told = ("--objects", made / "drive.objects.parquet")
    ran = lidarcli("overlay", DRIVE, "-o", tmp_path / "o.rrd", *told)
    assert ran.code == 2
    assert "the variable RERUN of the environment turns rerun off" in ran.err
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("nothing_left_behind")
def test_a_full_disk_is_told(lidarcli: Run, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise RuntimeError("File-writer thread shut down prematurely")

    monkeypatch.setattr(rerun.RecordingStream, "flush", full)
    out = tmp_path / "out"
    told = ("--objects", made / "drive.objects.parquet")
    ran = lidarcli("overlay", DRIVE, "-o", out / "o.rrd", *told)
    assert ran.code == 5
    assert f"cannot write {out / 'o.rrd'}: " in ran.err
    assert not list(out.iterdir())


def test_a_silent_topic_is_told_until_its_next_sweep(tmp_path: Path, lidarcli: Run) -> None:
    log, zones, _ = silenced(tmp_path, 0.5)
    ran = lidarcli("overlay", log, "--zones", zones, "-o", tmp_path / "o.rrd", "--pose", "none")
    assert ran.code == 0
    shown = Shown(tmp_path / "o.rrd")
    told = {(stamp - START) // 10**6: labels for stamp, labels in shown.rows("/scan/label", "Points3D:labels") if stamp}
    assert told[1_500] == ["no /scan"]
    assert told[2_200] != ["no /scan"]
    beams = dict(shown.rows("/scan/beams", "Points3D:positions"))
    assert beams[START + 1_500 * 10**6] == []
