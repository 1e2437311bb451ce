"""Walls and the rest, as far as the sweeps of a report show them: cells that beams have hit that lie on no object."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from lidarcli.records import record
from lidarcli.reports.columns import Run
from lidarcli.reports.distributions import round_up
from lidarcli.reports.ground import ground_of
from lidarcli.reports.raw import Raw
from lidarcli.sweeps import TURN, Bool, Float64, Int64

CELLS = 160
"""Cells along the longer side of what was seen, about."""
FINEST = 0.05
"""[m]"""
LEAST_HITS, LEAST_SHARE = 2, 0.05
"""A cell is a wall where so many beams, and this share of the most that hit any cell, ended in it."""
MOST = 4_000
"""Most cells that are drawn, those that were hit most."""
LEAST_STEP, MOST_ANGLE = 1e-6, 100.0
"""[rad] Finer steps from beam to beam, and edges at greater bearings, are not those of any sensor."""
STANDS, HEADS = 0.05, 0.02
"""A sensor whose poses stay within this distance [m] and angle [rad] stands."""


@record
class Walls:
    """Square cells of the ground in a frame."""

    cell: float
    """[m]"""
    x: Float64
    """(N,) their centres [m]."""
    y: Float64


def walls_of(run: Run, raw: Mapping[tuple[int, str], Raw]) -> dict[str, Walls]:
    """Frame (`sensor`, `world`) → its walls; of one log, and in the sensor frame only of one sensor that stands."""
    if len(run.sources) != 1:
        return {}
    found: dict[str, list[tuple[Float64, Float64]]] = {"sensor": [], "world": []}
    for (_, topic), sweeps in raw.items():
        for frame, x, y in _points(run, topic, sweeps):
            found[frame].append((x, y))
    if len(raw) > 1:
        found["sensor"] = []
    made = {}
    for frame, parts in found.items():
        walls = _cells(*(np.concatenate(column) for column in zip(*parts, strict=True))) if parts else None
        if walls is not None:
            made[frame] = walls
    return made


def _points(run: Run, topic: str, raw: Raw) -> Iterator[tuple[str, Float64, Float64]]:
    """Frame, x and y of the ends of beams that lie on no object."""
    rows = np.flatnonzero(run.sweeps.are("topic", topic))
    index = run.sweeps.integers("sweep")[rows]
    order = np.argsort(index, kind="stable")
    rows, index = rows[order], index[order]
    there = np.isin(raw.sweep, index)
    if not there.any():
        return
    at = np.searchsorted(index, raw.sweep[there])
    rows = rows[at]
    members, sweep = _members(run, topic, raw.sweep[there])
    ranges = raw.ranges[there]
    theta = raw.angle_min[there, None] + np.arange(ranges.shape[1]) * raw.angle_increment[there, None]
    hit = np.isfinite(ranges) & np.isfinite(theta) & ~_on_objects(run, raw, there, members, sweep)
    x, y = ranges[hit] * np.cos(theta[hit]), ranges[hit] * np.sin(theta[hit])
    which = np.nonzero(hit)[0]
    ground = ground_of(run.sweeps, rows, run.objects, members, sweep)
    if not ground.posed or _stands(ground.pose_x, ground.pose_y, ground.pose_yaw):
        yield "sensor", x, y
    if ground.posed:
        cos, sin = np.cos(ground.pose_yaw[which]), np.sin(ground.pose_yaw[which])
        world_x = ground.origin[0] + ground.pose_x[which] + cos * x - ground.side * sin * y
        world_y = ground.origin[1] + ground.pose_y[which] + sin * x + ground.side * cos * y
        known = np.isfinite(world_x) & np.isfinite(world_y)
        yield "world", world_x[known], world_y[known]


def _members(run: Run, topic: str, sweeps: Int64) -> tuple[Int64, Int64]:
    """Rows of the objects of these sweeps, and the place of the sweep of each among them."""
    index = run.objects.integers("sweep")
    mine = run.objects.are("topic", topic) & run.is_object & np.isin(index, sweeps)
    members = np.flatnonzero(mine)
    return members, np.searchsorted(sweeps, index[members])


def _on_objects(run: Run, raw: Raw, there: Bool, members: Int64, sweep: Int64) -> Bool:
    """(K, B) beams between the edges of an object."""
    angle_min, step = raw.angle_min[there][sweep], raw.angle_increment[there][sweep]
    first, last = (run.objects.numbers(name)[members] for name in ("theta_i", "theta_f"))
    # What another program has written may be anything.
    known = (np.abs(step) > LEAST_STEP) & (np.abs([first, last, angle_min]).max(axis=0) < MOST_ANGLE)
    sweep, step, angle_min = sweep[known], step[known], angle_min[known]
    first, last = first[known], last[known]
    marked = np.zeros((int(there.sum()), raw.ranges.shape[1]), bool)
    beams = marked.shape[1]
    # From beam to beam of a full turn, which may go past its end; the sweep is the beginning of the turn.
    turn = np.maximum(np.round(TURN / np.abs(step)), 1).astype(np.int64)
    begin = np.round((np.where(step > 0, first, last) - angle_min) / step).astype(np.int64) % turn
    end = begin + np.round(np.abs((last - first) / step)).astype(np.int64) + 1
    for low, high in ((begin, end), (np.zeros_like(begin), end - turn)):
        size = np.maximum(np.minimum(high, beams) - low, 0)
        inside = np.arange(size.sum()) - np.repeat(np.cumsum(size) - size, size)
        marked[np.repeat(sweep, size), np.repeat(low, size) + inside] = True
    return marked


def _stands(x: Float64, y: Float64, yaw: Float64) -> bool:
    there = np.isfinite(x)
    turned = np.unwrap(yaw[there])
    way = max(float(np.ptp(x[there])), float(np.ptp(y[there])))
    return way <= STANDS and float(np.ptp(turned)) <= HEADS


def _cells(x: Float64, y: Float64) -> Walls | None:
    """The cells that enough of these points lie in."""
    if not len(x):
        return None
    x0, y0 = float(x.min()), float(y.min())
    cell = max(round_up(max(float(np.ptp(x)), float(np.ptp(y)), 1e-3) / CELLS), FINEST)
    ix, iy = np.floor((x - x0) / cell).astype(np.int64), np.floor((y - y0) / cell).astype(np.int64)
    width = int(iy.max()) + 1
    place, hits = np.unique(ix * width + iy, return_counts=True)
    enough = np.flatnonzero(hits >= max(LEAST_HITS, LEAST_SHARE * np.percentile(hits, 90)))
    kept = np.sort(enough[np.argsort(-hits[enough], kind="stable")[:MOST]])
    return Walls(cell, x0 + (place[kept] // width + 0.5) * cell, y0 + (place[kept] % width + 0.5) * cell)
