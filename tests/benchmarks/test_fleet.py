"""The measurements of runs over many logs run."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import fleet

pytestmark = pytest.mark.whole


def test_a_store_a_killed_worker_and_a_log_that_kills(tmp_path: Path) -> None:
    found = fleet.many(tmp_path, 40)
    assert (found["exit"], found["equal tables"]) == (3, 80)
    assert found["workers killed"]
    assert len(found["said"]) == 1
    assert "s3://robots/logs/killer.mcap: ends every worker that reads it" in found["said"][0]
    assert found["resume"]["exit"] == 0
    assert found["resume"]["logs read"] == ["killer.mcap"]


def test_requests_are_counted(tmp_path: Path) -> None:
    asked = fleet.requests(tmp_path, 200)["requests"]
    assert asked["GET"] == 1
    assert asked["PUT"] == 2
    assert 2 <= asked["HEAD"] <= 6


def test_the_memory_of_the_driver_is_measured() -> None:
    found = fleet.memory([20])["20 logs"]
    assert 0 < found["before [MB]"] <= found["after [MB]"]
