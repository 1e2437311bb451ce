"""Logs to make maps of, and what is in the files of a map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lidarcli.formalism.mapping.grid import OCCUPIED
from lidarcli.logs.batches import ReadOptions
from lidarcli.maps.grids import read_map
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.mapping import MapOptions, Mapped, MapRun
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import RawSweeps
from tests.places import SAMPLES
from tests.sweeping import raw_sweeps

Run = Callable[..., Any]
DRIVE = SAMPLES / "drive.db3"
POSES_NOTE = (
    "  note     poses from /tf and /tf_static (odom > base_link > laser): 96% of the hits agree over the run; "
    "also available: /odom (--pose TOPIC)"
)
COUNTED = (
    "  note     used 75 of 150 sweeps (one every 0.12 m, 10 degrees or 5 s; --min-move)",
    "map of 75 sweeps in odom: 9.4 x 7.5 m, 1,407 cells of 0.05 m occupied, 24,467 free",
)
WALK = """
[scene]
name = "walk"
sweeps = 120
[sensor]
beams = 361
angle_min = -180.0
angle_max = 180.0
noise = 0.01
range_max = 12.0
[robot]
waypoints = [[-1.0, 0.0], [1.5, 0.0]]
speed = 0.25
[robot.odometry]
[[wall]]
points = [[-4, -3], [4, -3], [4, 3], [-4, 3]]
closed = true
[[box]]
x = -2.0
y = -1.5
length = 0.6
width = 0.4
[[cylinder]]
radius = 0.2
[cylinder.route]
speed = 1.0
waypoints = [[-2.0, 1.5], [1.0, 1.5]]
"""
"""A robot drives through a room. A thing passes it, stops at (1, 1.5) after 3 s and stands there for the 9 s left."""
GHOST = (1.0, 1.5)


def names(folder: Path) -> list[str]:
    """All that is there, what begins with a dot, too."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def occupied(path: Path) -> set[tuple[int, int]]:
    """Column and row of the occupied cells of a map, from the origin of the world."""
    grid = read_map(path)
    rows, columns = np.nonzero(grid.cells == OCCUPIED)
    left, low = round(grid.x / grid.resolution), round(grid.y / grid.resolution)
    return set(zip((columns + left).tolist(), (rows + low).tolist(), strict=True))


def near(cells: set[tuple[int, int]], x: float, y: float, reach: float = 0.35) -> int:
    """How many cells of 0.05 m are within so much of a place, in x and in y."""
    return sum(abs(0.05 * (i + 0.5) - x) < reach and abs(0.05 * (j + 0.5) - y) < reach for i, j in cells)


def ply(path: Path) -> Any:
    """(N, 3) points of a binary PLY."""
    head, _, data = path.read_bytes().partition(b"end_header\n")
    count = next(int(line.split()[2]) for line in head.decode().splitlines() if line.startswith("element"))
    points = np.frombuffer(data, "<f8").reshape(-1, 3)
    assert len(points) == count
    return points


def mapped(logs: Sequence[Path], outputs: Sequence[Path], read: ReadOptions | None = None, **options: Any) -> Mapped:
    """A map by the pipeline."""
    told = MapOptions(read=read or ReadOptions(), **options)
    with MapRun(find_logs([str(log) for log in logs]), outputs, told) as run:
        for outcome in run.outcomes():
            assert (outcome.error, outcome.exit_code) == (None, 0)
        return run.finish()


def still(folder: Path, ranges: Any, **columns: Any) -> tuple[Path, Path]:
    """A log of such ranges, and a path on which its sensor goes 5 cm from sweep to sweep."""
    write_log(folder / "odd.mcap", [raw_sweeps(ranges, **columns)])
    lines = [f"{1_700_000_000 + k / 10:.3f} {0.05 * k:.3f} 0 0 0 0 0 1\n" for k in range(-1, len(ranges) + 2)]
    (folder / "odd.tum").write_text("".join(lines))
    return folder / "odd.mcap", folder / "odd.tum"


def fields() -> tuple[str, ...]:
    """What a block of sweeps is made of."""
    return tuple(RawSweeps.__dataclass_fields__)
