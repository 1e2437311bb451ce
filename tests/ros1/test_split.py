"""A bag that ROS 1's own rosbag has split is read as the whole one."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from lidarcli.cli import run
from tests.places import SAMPLES
from tests.ros1.tools import HERE, PYTHON, needs_rosbag


@needs_rosbag
@pytest.mark.slow
def test_tables_of_parts_are_those_of_the_whole_bag(tmp_path: Path) -> None:
    """Parts have the names that `rosbag record --split` gives them: every one is dated."""
    whole = tmp_path / "drive.bag"
    assert run(["-q", "simulate", str(SAMPLES / "drive.toml"), "-o", str(whole), "--sweeps", "120"]) == 0
    (tmp_path / "parts").mkdir()
    parts = [tmp_path / "parts" / f"drive_2024-01-01-10-0{number}-00_{number}.bag" for number in range(3)]
    subprocess.run([PYTHON, HERE / "split.py", whole, *parts], check=True)
    assert run(["-q", "track", str(whole), "-o", str(tmp_path)]) == 0
    assert run(["-q", "track", "--join", str(tmp_path / "parts"), "-o", str(tmp_path)]) == 0
    for table in ("objects", "sweeps", "tracks"):
        expected = pq.read_table(tmp_path / f"drive.{table}.parquet")
        found = pq.read_table(tmp_path / f"drive_2024-01-01-10-00-00.{table}.parquet")
        assert expected.num_rows > 0
        assert found.drop_columns("log").equals(expected.drop_columns("log")), table
