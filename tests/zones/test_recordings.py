"""Zones over public recordings, with figures that were counted independently."""

from __future__ import annotations

from pathlib import Path

import pytest

import lidarcli
from tests.places import REAL_LOGS, needs_real_logs
from tests.zones.runs import rows, sound, zone_file

pytestmark = [needs_real_logs, pytest.mark.slow]
LOG = REAL_LOGS / "comprobo24" / "test-bag"
NAV2 = """
monitor:
  ros__parameters:
    base_frame_id: base_laser_link
    observation_sources: [scan]
    scan: {type: scan, topic: /scan}
    polygons: [half, once, twice, thrice]
    half: {type: circle, radius: 0.5, action_type: stop, min_points: 4}
    once: {type: circle, radius: 1.0, action_type: stop, min_points: 4}
    twice: {type: circle, radius: 1.0, action_type: stop, min_points: 4,
      trigger_consecutive_points: 2, release_consecutive_points: 2}
    thrice: {type: circle, radius: 1.0, action_type: stop, min_points: 4,
      release_consecutive_points: 3}
"""


def test_a_robot_that_a_person_walks_around(tmp_path: Path) -> None:
    tables = sound(
        lidarcli.zones(
            LOG, zones=str(zone_file(tmp_path, NAV2, "nav2.yaml")), topic=["/scan"], no_objects=True, pose="none"
        )
    )
    first, second = rows(tables.events, zone="half")
    assert (first["t"], first["duration"]) == (pytest.approx(26.194, abs=1e-3), pytest.approx(3.343, abs=1e-3))
    assert (first["points"], first["nearest"]) == (26, pytest.approx(0.324))
    assert (second["t"], second["points"], second["nearest"]) == (pytest.approx(32.462, abs=1e-3), 5, pytest.approx(0.494))
    assert [len(rows(tables.events, zone=name)) for name in ("once", "twice", "thrice")] == [7, 3, 2]
