"""Paths that are matched from sweeps, beside true ones: errors over a stretch of the way, slides, gaps and cost."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import lidarcli
from benchmarks.maps.figures import TOLD, PathError
from benchmarks.maps.recordings import record_drive, write_drive
from benchmarks.maps.scenes import Kind, drive, straight
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.registry import TopicChoice
from lidarcli.options.choices import MATCH
from lidarcli.pipeline.inputs.search import find_logs
from lidarcli.pipeline.inputs.sources import MissingInput, open_source
from lidarcli.pipeline.reading.path_check import check_paths
from lidarcli.pose.fit import steps_between
from lidarcli.pose.matched import MatchedPath, Timing
from lidarcli.simulation.generate import simulate_odometry
from lidarcli.simulation.scene import Odometry, Scene
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import Float64, Int64, SweepBatch, record

STRETCH = 5.0
"""Errors are those over so much of the true way [m], or over half of one that is shorter."""
DRIFT, YAW_DRIFT = 0.05, 0.5
"""Of odometry that guides: standard deviation of the place for a metre of way [m], and of the heading for each of these."""


@record
class Followed:
    """The S sweeps of a sensor, and the path that was matched from them."""

    batches: list[SweepBatch]
    timing: Timing
    """When the beams are sent, as was learned."""
    path: MatchedPath
    poses: Float64
    """(S, 3) x, y, yaw at the header stamps, NaN without a pose."""
    seconds: float
    """Processor time of the matching alone."""

    @property
    def stamp_ns(self) -> Int64:
        """(S,) header stamps."""
        return np.concatenate([batch.stamp_ns for batch in self.batches])

    @property
    def topic(self) -> str:
        """Of the sweeps."""
        return self.batches[0].topic


def follow(log: Path) -> Followed:
    """The path of the first sensor of a log, with the poses that every command gets by `--pose match`."""
    (source,) = find_logs([str(log)])
    assert not isinstance(source, MissingInput)
    with open_source(source, OpenOptions()) as opened:
        choice = TopicChoice(ReadOptions().topics, opened.topics())
        checked = check_paths(opened, None, choice, RangeRules(), match=True)[0]
    batches = _sweeps(log, MATCH)
    first = batches[0]
    timing = checked[1, (first.topic, first.frame_ids[first.frame[0]])].timing
    path, seconds = _matched(batches, timing)
    return Followed(batches, timing, path, _poses(batches), seconds)


def guided(free: Followed, told: Float64) -> Followed:
    """The path of the same sweeps where told poses (S, 3) guide the search, as those do that fit the sweeps in part."""
    path, seconds = _matched(free.batches, free.timing, np.column_stack([told, np.zeros(len(told))]))
    return Followed(free.batches, free.timing, path, path.poses, seconds)


def told_poses(log: Path, source: str, topic: str) -> Float64:
    """(S, 3) the poses that a log tells for the sweeps of a topic, as they are."""
    return _poses([batch for batch in _sweeps(log, source) if batch.topic == topic])


def measure_loop(kind: Kind, seed: int, folder: Path) -> list[PathError]:
    """A drawn loop: the path of its sweeps alone and, in corridors, with told steps as the guess."""
    found = _measure_drawn(f"{kind} {seed}", drive(kind, seed), seed, folder, closed=True)
    return found if kind == "corridors" else found[:1]


def measure_straight(seed: int, folder: Path) -> list[PathError]:
    """A corridor whose ends are out of reach, so that every sweep slides along it; without and with told steps."""
    return _measure_drawn(f"straight corridor {seed}", straight(seed), seed, folder, closed=False)


def _measure_drawn(name: str, scene: Scene, seed: int, folder: Path, *, closed: bool) -> list[PathError]:
    driven = record_drive(scene, seed)
    log = folder / f"{scene.name}-path.mcap"
    write_drive(driven, log)
    free = follow(log)
    odometry = Odometry(noise=DRIFT, yaw_noise=YAW_DRIFT * DRIFT)
    told = simulate_odometry(replace(scene, odometry=odometry), scene.sweeps, seed)
    assert told is not None
    return [
        path_error(name, free, driven.poses, closed=closed),
        path_error(f"{name}, {TOLD}", guided(free, told.poses), driven.poses, closed=closed),
    ]


def path_error(name: str, followed: Followed, true: Float64, *, closed: bool = False) -> PathError:
    """Compare a path with the true poses (S, 3) of its sweeps.

    `closed`: the true path begins at the origin, as that of the sweeps does, and comes back, so places can be compared.
    """
    poses, path, first = followed.poses, followed.path, followed.batches[0]
    placed = np.isfinite(poses[:, 0])
    turn = abs(np.degrees(first.angle_increment[0])) * (first.beams[0] - 1)
    way = way_of(true)
    over = STRETCH if way[-1] > STRETCH else way[-1] / 2
    off, turned, length = errors_over(true, poses, over)
    apart = np.hypot(*(poses[placed, :2] - true[placed, :2]).T)
    return PathError(
        log=name,
        beams=int(first.beams[0]),
        view=float(min(turn, 360.0)),
        metres=float(way[-1]),
        over=float(over),
        median=_quantile(off, 0.5) / over,
        p95=_quantile(off, 0.95) / over,
        length=_quantile(length, 0.5),
        heading=float(np.sqrt(np.mean(turned**2))) if len(turned) else float("nan"),
        rms=float(np.sqrt(np.mean(apart**2))) if closed and len(apart) else float("nan"),
        slides=float(np.mean(np.nan_to_num(path.slides) > 0)),
        unplaced=float(1.0 - placed.mean()),
        lost=path.restarts,
        milliseconds=1e3 * followed.seconds / len(poses),
    )


def way_of(true: Float64) -> Float64:
    """(S,) length of the way to each of the poses (S, 3) [m]; unknown ones add nothing."""
    known = np.flatnonzero(np.isfinite(true[:, 0]))
    steps = np.hypot(*np.diff(true[known, :2], axis=0).T)
    at_known = np.concatenate([[0.0], np.cumsum(steps)])
    way: Float64 = np.interp(np.arange(len(true)), known, at_known)
    return way


def errors_over(true: Float64, found: Float64, over: float) -> tuple[Float64, Float64, Float64]:
    """Errors of the steps over a stretch of the true way, from each sweep whose pose is known to the first so far on.

    Parameters
    ----------
    true, found : (S, 3) x, y, yaw, NaN where they are not known
    over : length of a stretch along the way [m]

    Returns
    -------
    off : (K,) error of the place [m]
    turned : (K,) error of the heading [rad]
    length : (K,) distance from end to end in the path that was found, as a share of the true one
    """
    known = np.isfinite(true[:, 0]) & np.isfinite(found[:, 0])
    way = way_of(true)[known]
    last = np.searchsorted(way, way + over)
    first = np.flatnonzero(last < len(way))
    last = last[first]
    right, mine = (steps_between(path[known][first], path[known][last]) for path in (true, found))
    apart = steps_between(right, mine)
    far = np.maximum(np.hypot(right[:, 0], right[:, 1]), 1e-9)
    return np.hypot(apart[:, 0], apart[:, 1]), apart[:, 2], np.hypot(mine[:, 0], mine[:, 1]) / far


def _sweeps(log: Path, pose: str) -> list[SweepBatch]:
    """The sweeps of the first topic of a log."""
    batches = [batch for batch in lidarcli.read(log, pose=pose) if len(batch)]
    return [batch for batch in batches if batch.topic == batches[0].topic]


def _poses(batches: list[SweepBatch]) -> Float64:
    """(S, 3) at the header stamps."""
    rows = []
    for batch in batches:
        if batch.poses is None:
            rows.append(np.full((len(batch), 3), np.nan))
        else:
            there = batch.poses.at_stamp()
            rows.append(np.column_stack([there.x, there.y, there.yaw]))
    return np.vstack(rows)


def _matched(batches: list[SweepBatch], timing: Timing, told: Float64 | None = None) -> tuple[MatchedPath, float]:
    path, first = MatchedPath(timing), 0
    started = time.process_time()
    for batch in batches:
        path.add(batch, None if told is None else told[first : first + len(batch)])
        first += len(batch)
    return path, time.process_time() - started


def _quantile(values: Float64, share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else float("nan")
