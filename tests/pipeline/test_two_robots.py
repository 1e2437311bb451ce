"""Logs of two robots with the same frame names, each in its namespace: their worlds are never one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.errors import NoScanError, OptionError
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inputs.tables import poses_of, read_tracks_table, world_in
from lidarcli.pipeline.mapping import GrowingMap, MapOptions
from lidarcli.simulation.writers import ROS1_BYTES, outgoing
from lidarcli.tabular.reading import note_value, notes_of
from lidarcli.tabular.writing import SOURCE
from tests.pipeline.drawn import driven, round_about, told, write_messages

PART = 40
"""Sweeps of each robot."""
PATH = round_about(np.arange(PART) * 0.1)
PATHS = {"robot1": PATH, "robot2": PATH + np.array([5.0, 3.0, 0.0])}
"""The same way, from two origins of odometry."""
SCANS = [f"/{name}/scan" for name in PATHS]


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    messages = [
        message._replace(topic=f"/{name}{message.topic}")
        for name, path in PATHS.items()
        for message in outgoing(driven()[:PART], told(path, tf=True), ROS1_BYTES)
    ]
    path = tmp_path_factory.mktemp("robots") / "two.bag"
    return write_messages(path, sorted(messages, key=lambda one: one.record_ns))


@pytest.mark.slow
def test_poses_of_each(robots: Path, tmp_path: Path) -> None:
    table = lidarcli.poses(robots)
    rows = table.to_pandas()
    for name, path in PATHS.items():
        mine = rows[rows.topic == f"/{name}/scan"]
        np.testing.assert_allclose(mine[["x", "y"]], path[:, :2], atol=1e-6)
        assert {*mine.world} == {f"{name}/odom"}
    (way,) = poses_of(note_value(notes_of(table), SOURCE, dict)).values()
    assert [world_in(way, topic) for topic in SCANS] == ["robot1/odom", "robot2/odom"]
    assert way["topic"] == {"/robot1/scan": "/robot1/tf", "/robot2/scan": "/robot2/tf"}
    with pytest.raises(OptionError, match="choose one with --topic"):
        lidarcli.poses(robots, tmp_path / "both.tum")
    # Poses that are named mount the sensor by the transforms beside them.
    named = lidarcli.poses(robots, topic="/robot2/scan", pose="/robot2/tf")
    assert named["x"].to_pylist() == rows[rows.topic == "/robot2/scan"].x.to_list()


def test_one_alone_is_told_as_its_transforms_name_it(robots: Path) -> None:
    table = lidarcli.poses(robots, topic="/robot2/scan")
    (way,) = poses_of(note_value(notes_of(table), SOURCE, dict)).values()
    assert (way["world"], way["fixed_frame"], way["topic"]) == ("robot2/odom", "odom", "/robot2/tf")


@pytest.mark.slow
@pytest.mark.parametrize("named", [False, True])
def test_a_map_has_one_world(robots: Path, named: bool) -> None:
    mapping = GrowingMap(MapOptions(read=ReadOptions(SCANS if named else None)))
    summary = mapping.add(Source(str(robots), "two"))
    assert [*mapping.worlds] == ["robot1/odom"]
    assert [path.topic for path in mapping.paths] == ["/robot1/scan"]
    left_out = "/robot2/scan is in the frame robot2/odom, not in robot1/odom: left out (--topic /robot2/scan)"
    assert left_out in summary.notes
    alone = GrowingMap(MapOptions(read=ReadOptions(["/robot2/scan"])))
    alone.add(Source(str(robots), "two"))
    assert [*alone.worlds] == ["robot2/odom"]
    assert alone.paths[0].x[0] == pytest.approx(PATHS["robot2"][0, 0], abs=1e-6)


ZONE = '[[zone]]\nname = "near"\nframe = "{}"\ncircle = {{ x = 0.0, y = 0.0, radius = 1.0 }}\n{}'


@pytest.mark.slow
@pytest.mark.parametrize("frame", ["world", "odom"])
def test_a_zone_lies_in_one_world(robots: Path, tmp_path: Path, frame: str) -> None:
    zones = tmp_path / "zones.toml"
    zones.write_text(ZONE.format(frame, ""))
    with pytest.raises(NoScanError, match="its sensors have each a world of its own"):
        lidarcli.zones(robots, zones=str(zones), no_objects=True)
    zones.write_text(ZONE.format(frame, 'topic = "/robot1/scan"\n'))
    found = lidarcli.zones(robots, zones=str(zones), no_objects=True).zones
    assert {*found["topic"].to_pylist()} == {"/robot1/scan"}


@pytest.mark.slow
def test_tracks_and_what_changed_from_run_to_run(robots: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["track", str(robots), "-o", str(tmp_path / "t")]) == 0
    table = read_tracks_table(tmp_path / "t" / "two.tracks.parquet")
    assert {world_in(table.poses["laser"], topic) for topic in SCANS} == {"robot1/odom", "robot2/odom"}
    capsys.readouterr()
    assert run(["diff", str(robots), str(robots), "-o", str(tmp_path / "d.parquet")]) == 0
    assert "only what lies in the frame robot1/odom is compared, not in robot2/odom" in capsys.readouterr().err
    assert run(["overlay", str(robots), "-o", str(tmp_path / "o.mcap")]) == 0
    assert "/robot2/scan is in the frame robot2/odom, not in robot1/odom, and is hidden" in capsys.readouterr().err
    assert run(["info", str(robots), "--format", "json"]) == 0
    (info,) = json.loads(capsys.readouterr().out)
    assert [scan["pose"] for scan in info["scans"]] == [
        f"/{name}/tf and /{name}/tf_static (odom > base_link > laser)" for name in PATHS
    ]
