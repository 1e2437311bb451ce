"""Rows of trajectories that are seen lie at the objects of their tracks in that sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import lidarcli
from tests.places import REAL_LOGS, SAMPLES, needs_real_logs

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::UserWarning")]
NEAR = 0.3
"""[m] Greatest distance of a row from the box of its object, or from its own box there."""
KEYS = ["topic", "track"]


def distances(log: Path) -> Any:
    """(N,) distances [m] of the seen rows of agents from the nearest box of theirs, less half the diagonal of their own."""
    found = lidarcli.track(str(log))
    objects, tracks, rows = (pd.DataFrame(table.to_pydict()) for table in (found.objects, found.tracks, found.trajectories))
    agents = tracks[tracks["set"] == "A"]
    half = 0.5 * np.hypot(agents.length.fillna(0.0), agents.width.fillna(0.0))
    rows = rows[rows.seen != "hidden"].merge(agents[KEYS].assign(half=half), on=KEYS)
    places = objects.merge(rows[[*KEYS, "sweep", "x", "y", "half", "frame"]], on=[*KEYS, "sweep"], suffixes=("", "_row"))
    world = places.frame == "world"
    x, y, yaw = (places[f"world_{name}"].where(world, places[f"box_{name}"]).astype(float) for name in ("x", "y", "yaw"))
    dx, dy = places.x_row - x, places.y_row - y
    along = np.abs(np.cos(yaw) * dx + np.sin(yaw) * dy) - 0.5 * places.box_length
    across = np.abs(np.cos(yaw) * dy - np.sin(yaw) * dx) - 0.5 * places.box_width
    off = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0)) - places.half
    nearest = off.groupby([places[name] for name in (*KEYS, "sweep")]).min()
    assert len(nearest) == len(rows)
    return nearest.to_numpy()


@pytest.mark.parametrize("name", ["people.csv.gz", "drive.db3", "hall", "corridor.bag", "room.mcap"])
def test_those_of_samples(name: str) -> None:
    assert (distances(SAMPLES / name) <= NEAR).all()


@needs_real_logs
@pytest.mark.parametrize(
    "name",
    [
        "obstacle_detector/scans_demo.bag",
        pytest.param(
            "leg_tracker/demo_stationary_simple_environment.bag",
            marks=pytest.mark.xfail(
                reason="a row of 3,461 is 0.84 m off, where legs are one object across lost beams", strict=True
            ),
        ),
        "leg_tracker/positive_1_extracted.bag",
        "leg_tracker/positive_3_raw.bag",
        "hrp_mpc_lidar/mylaserdata2.bag",
        "datmo/overtake_ego.bag",
        pytest.param(
            "datmo/parallel.bag", marks=pytest.mark.xfail(reason="7 of 219 rows are 0.30 to 0.33 m off", strict=True)
        ),
    ],
)
def test_those_of_real_logs(name: str) -> None:
    """A row in a hundred lies farther off, where legs of two who pass each other are mixed for a moment."""
    off = distances(REAL_LOGS / name)
    assert (off <= NEAR).mean() > 0.98
    assert off.max(initial=0.0) < 0.7
