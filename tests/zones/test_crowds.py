"""A crowd before a sensor that stands: many tracks move, which is no reason to doubt its poses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from lidarcli.formalism.tracking.tracker import share_moving
from lidarcli.simulation.scene import Odometry
from tests.zones.runs import odometry_of, scans, scene_of, sweeps_of, walker, write_bag


@pytest.mark.slow
@pytest.mark.parametrize("more", [(), ("--pose", "none")], ids=["told", "none"])
def test_a_crowd_is_no_fault_of_the_poses(lidarcli: Callable[..., Any], tmp_path: Path, more: tuple[str, ...]) -> None:
    people = [walker((1.5 + k, -5.0 + k), (1.5 + k, 5.0)) for k in range(5)]
    scene = scene_of(*people, sweeps=70, odometry=Odometry())
    log = write_bag(tmp_path / "a.bag", scans(sweeps_of(scene), odometry_of(scene)))
    ran = lidarcli("track", log, *more, "-o", tmp_path)
    tracks = pq.read_table(tmp_path / "a.tracks.parquet").to_pydict()
    assert share_moving(tracks["sweeps"], [kind == "A" for kind in tracks["set"]]) is not None
    assert "do not trust" not in ran.out + ran.err
