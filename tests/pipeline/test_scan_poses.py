"""Recordings of foxglove.LaserScan without transforms, whose sweeps tell where each was taken."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

import lidarcli
from lidarcli.pipeline.inputs.tables import poses_of
from lidarcli.ros.foxglove import SCAN
from lidarcli.sweeps.types import Float64
from lidarcli.tabular.reading import note_value, notes_of
from lidarcli.tabular.writing import SOURCE
from tests.pipeline.drawn import driven, round_about
from tests.pose.test_namespaces import scan
from tests.sweeping import START, STEP
from tests.text_logs.foxglove import json_schema

COUNT = 40


def write_scans(path: Path, frame: str, poses: Float64, ranges: Float64) -> Path:
    """Sweeps in JSON, full turns, each with its pose in a frame."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(SCAN, "jsonschema", json_schema(SCAN).encode())
        channel = writer.register_channel("/lidar", "json", schema)
        bearings = f'"start_angle": {-np.pi}, "end_angle": {np.pi * (1.0 - 2.0 / ranges.shape[1])}'.encode()
        for k, (pose, row) in enumerate(zip(poses, ranges, strict=True)):
            at = START + k * STEP
            data = scan(at, frame, tuple(pose), "json").data
            data = data.replace(b"[1.0, 2.0]", json.dumps(row.tolist()).encode())
            writer.add_message(channel, at, data[:-1] + b", " + bearings + b"}", at)
        writer.finish()
    return path


@pytest.mark.slow
def test_a_path_that_sweeps_tell(tmp_path: Path) -> None:
    path = round_about(np.arange(COUNT) * 0.1)
    ranges = np.concatenate([block.ranges for block in driven()[:COUNT]]).astype(np.float64)
    log = write_scans(tmp_path / "run.mcap", "map", path, ranges)
    table = lidarcli.poses(log)
    found = np.column_stack([table[name].to_numpy() for name in ("x", "y")])
    np.testing.assert_allclose(found, path[:, :2], atol=1e-6)
    assert poses_of(note_value(notes_of(table), SOURCE, dict))["map"]["world"] == "map"
    (info,) = lidarcli.info(log)
    assert info["scans"][0]["pose"] == "/lidar (map > /lidar)"
    assert info["scans"][0]["pose_verdict"] == "told"


def test_a_mount_that_sweeps_tell(tmp_path: Path) -> None:
    """The sensor looks to the left of the robot: what is ahead of it is to the left."""
    ranges = np.full((COUNT, 360), 5.0)
    ranges[:, 170:190] = 2.0
    mount = np.tile([0.5, 0.2, 0.5 * np.pi], (COUNT, 1))
    log = write_scans(tmp_path / "run.mcap", "base_link", mount, ranges)
    zones = tmp_path / "zones.toml"
    text = '[[zone]]\nname = "{}"\nframe = "{}"\ncircle = {{ x = {}, y = {}, radius = 0.3 }}\n'
    zones.write_text(
        "".join(
            text.format(*each)
            for each in (("left", "base_link", 0.5, 2.2), ("ahead", "base_link", 2.5, 0.2), ("own", "sensor", 2.0, 0.0))
        )
    )
    events = lidarcli.zones(log, zones=str(zones), no_objects=True).events
    assert sorted(events["zone"].to_pylist()) == ["left", "own"]
    assert {round(x, 1) for x in events["nearest"].to_pylist()} == {2.0}
