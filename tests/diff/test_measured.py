"""Changes that are told right, over drawn pairs of rooms (docs/diff.md)."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.simulation.scene import Entity
from tests.diff.drawn import Pair, draw, write_run

PAIRS = 120
STATUSES = ("known", "moved", "new", "gone")


def place(pair: Pair, box: Entity) -> tuple[float, float]:
    """Place of a box in the coordinates of the first run."""
    if pair.odometry is not None:
        return box.x, box.y
    course = pair.courses[0]
    dx, dy = (np.array([box.x, box.y]) - course.points[0]).tolist()
    cos, sin = math.cos(course.yaw), math.sin(course.yaw)
    return cos * dx + sin * dy, cos * dy - sin * dx


def is_at(pair: Pair, row: dict[str, Any], run: str, box: Entity | None) -> bool:
    """Return True if a row is about a box: its middle may be off by what was not seen of it."""
    if box is None or row[f"x_{run}"] is None:
        return False
    x, y = place(pair, box)
    return math.hypot(row[f"x_{run}"] - x, row[f"y_{run}"] - y) < max(0.3, 0.5 * math.hypot(box.length, box.width) + 0.15)


def measure(pair: Pair, rows: list[dict[str, Any]], count: Counter[str]) -> None:
    """Count what is there and can be told, what of it is told, and what is told and right."""
    right: set[int] = set()
    for status, old, new, can_be_told in pair.truth():
        mine = [k for k, row in enumerate(rows) if is_at(pair, row, "a", old) or is_at(pair, row, "b", new)]
        good = [k for k in mine if rows[k]["status"] == status]
        if status == "moved":
            good = [k for k in good if is_at(pair, rows[k], "a", old) and is_at(pair, rows[k], "b", new)]
            # One place that became free, and another one that was taken: right, but less than could be told.
            right |= {k for k in mine if rows[k]["status"] in ("gone", "new")}
        right |= {*good}
        if can_be_told:
            count[f"there {status}"] += 1
            count[f"told {status}"] += bool(good)
    for k, row in enumerate(rows):
        count[f"said {row['status']}"] += 1
        count[f"right {row['status']}"] += k in right


def write_pair(pair: Pair, seed: int, folder: Path) -> list[str]:
    """Write the logs of both runs."""
    sweeps = 60 if pair.odometry is None else 110
    return [
        write_run(folder / f"{seed}{name}.mcap", scene, course, pair.sensor, sweeps, noise, pair.odometry)
        for name, scene, course, noise in (
            ("a", pair.before, pair.courses[0], seed),
            ("b", pair.after, pair.courses[1], seed + 1000),
        )
    ]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 80, 90])
def test_moves_of_boxes_that_tracks_measured_too_small(seed: int, tmp_path: Path) -> None:
    """All hits of a run tell both faces of a box, of which its track knew one and a part of the other."""
    pair, count = draw(seed), Counter[str]()
    measure(pair, lidarcli.diff(*write_pair(pair, seed, tmp_path)).changes.to_pylist(), count)
    assert count["there moved"] > 0
    assert count["told moved"] == count["there moved"]


@pytest.mark.whole
def test_of_drawn_pairs(tmp_path: Path) -> None:
    count: Counter[str] = Counter()
    for seed in range(PAIRS):
        pair = draw(seed)
        runs = write_pair(pair, seed, tmp_path)
        measure(pair, lidarcli.diff(*runs).changes.to_pylist(), count)
    precision = {status: count[f"right {status}"] / count[f"said {status}"] for status in STATUSES}
    recall = {status: count[f"told {status}"] / count[f"there {status}"] for status in STATUSES}
    print(count, precision, recall)
    assert min(precision.values()) >= 0.95
    assert min(recall[status] for status in ("known", "new", "gone")) >= 0.95
    # Of boxes of which one face was seen, others that are like it in one size may be the same.
    assert recall["moved"] >= 0.75
