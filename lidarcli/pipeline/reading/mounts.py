"""Mounts of lasers and the times of their stamps, by aligning sweeps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np

from lidarcli.display.texts import counted, visible
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.reading.masking import MovedPath
from lidarcli.pipeline.reading.needs import of_one_run
from lidarcli.pipeline.reading.path_choice import DRIFT_NOTED, CheckedPath
from lidarcli.pose.calibration import (
    SLOTS,
    SURE,
    UNSURE,
    CalibrationResult,
    Outlines,
    cells_filled,
    differs,
    joined_outlines,
    outlines_of,
    overlap,
    places_beside,
    scaled_path,
    solve,
    stretches_over,
)
from lidarcli.pose.fit import ACCEPTED, FAR_TURN, LARGE_TURN, mount_between, pairs_of, poses_after, steps_between
from lidarcli.pose.frames import FrameTree, Step, along
from lidarcli.pose.matched import AUTO, headers_of, wrapped
from lidarcli.pose.messages import frame_name
from lidarcli.pose.sources import PoseChain
from lidarcli.pose.tracks import flat, planar
from lidarcli.sweeps.finding_rules import (
    LASERS,
    LASERS_UNKNOWN,
    LASERS_UNTOLD,
    MIN_TURN,
    MIRROR,
    MOUNT,
    MOUNT_UNKNOWN,
    STAMP,
    judge,
)
from lidarcli.sweeps.findings import Finding, Fix, Sensor, transform_lines
from lidarcli.sweeps.masks import Mount
from lidarcli.sweeps.types import TURN, Float64, Int64, Status, SweepBatch, UInt8

MAX_SWEEPS, STANDING_SWEEPS = 400, 20
"""Most sweeps of a sensor that are aligned, and the first ones, which are taken though it stands."""
MOVED, TURNED = 0.02, 0.017
"""Others are taken after the sensor went so far [m] or turned so much [rad]."""
MAX_POINTS = 120
"""Points of a sweep that are aligned."""
NEARBY = 0.1
"""A mount by steps of the path that is no farther from the given one [m, rad] is found from there."""
DELAYS, KNOWN_TIME, SCALES = 0.2, 0.1, 0.02
"""Prior deviations: of a delay [s], of the time of a sweep that is given, as a share of the period, and of the scales of
given lengths and turns."""
MIN_TURNS = 8
"""Fewest turns that show a mount or a mirror."""
_STAMPED = {"first": 0.0, "middle": 0.5, "last": 1.0}
"""Beam at whose time a header is stamped → its share of the time of the sweep."""
MIN_STEPS, MIN_BEAMS = 20, 3
"""Fewest steps that show a flicker, and fewest beams of a sector."""
AGAINST, CLEARLY = 2.0, 0.25
"""Points against a place count so much more than points for it; and by how much the next best place is worse."""
MIN_OVERLAP, MIN_WIDTH, MAX_AGAINST = 0.6, np.deg2rad(120.0), 0.05
"""Of the points of a second laser while both are static: the least share that lies on those of the first one, the least
width of this [rad], and the greatest share that speaks against it."""


class SensorSamples:
    """Samples and counts of one topic and frame."""

    def __init__(self, topic: str, frame: str, path: CheckedPath | None, chain: PoseChain | None, delay: float) -> None:
        self.topic, self.frame, self.chain, self.requested_delay = topic, frame, chain, delay
        self.named = Sensor(topic, frame, topic)
        self.path = path or CheckedPath("none")
        self.delay = delay + (0.0 if self.path.fit is None else self.path.fit.delay)
        """Time after the header stamp at which poses fit the sweeps by their steps [s]."""
        self.step = 0.0
        self.flicker = _Flicker()
        self.times = 0.0, 0.0
        """Times of the first and of the last beam after the header stamp [s]."""
        self._every, self._moves, self._sweeps = 1, 0, 0
        self.moves = MovedPath(MOVED, TURNED)
        self._kept: list[tuple[int, int, Float64, Float64]] = []
        """Number of the move, stamp [ns], bearings and ranges of a sweep."""
        self._first_ns = self._last_ns = 0

    @property
    def period(self) -> float:
        """Mean time from sweep to sweep [s]."""
        return max(self._last_ns - self._first_ns, 0) / SECOND_NS / max(self._sweeps - 1, 1)

    @property
    def was_static(self) -> bool:
        """True where nothing shows that the sensor moved."""
        return self._moves < STANDING_SWEEPS

    def add(self, batch: SweepBatch) -> None:
        """Take sweeps."""
        if not self._sweeps:
            self.times = tuple(float(np.median(times)) for times in self.path.timing.of(headers_of(batch)))  # type: ignore[assignment]
            self._first_ns = int(batch.stamp_ns[0])
        self.step = self.step or abs(float(batch.angle_increment[0]))
        self.flicker.add(batch)
        rows = [(-1, row) for row in range(len(batch)) if self._sweeps + row < STANDING_SWEEPS]
        self._sweeps += len(batch)
        chain = self.path.chain or self.chain
        for row in self.moves.moved(np.zeros((0, 3)) if chain is None else flat(chain.at(batch.stamp_ns))):
            if self._moves % self._every == 0:
                rows.append((self._moves, row))
            self._moves += 1
        self._last_ns = int(batch.stamp_ns[-1])
        for number, row in rows:
            bearing = batch.angle_min[row] + batch.angle_increment[row] * np.arange(batch.beams[row])
            ranges = batch.ranges[row, : batch.beams[row]].astype(np.float64)
            self._kept.append((number, int(batch.stamp_ns[row]), bearing, ranges))
            if len(self._kept) > MAX_SWEEPS:
                self._every *= 2
                self._kept = [one for one in self._kept if one[0] < 0 or one[0] % self._every == 0]

    def outlines(self) -> Outlines:
        """Return the points of the sampled sweeps."""
        kept = sorted({one[1]: one[1:] for one in self._kept}.values(), key=lambda one: one[0])
        return outlines_of(kept, SLOTS, MAX_POINTS)

    def mirrored(self) -> list[Finding]:
        """Return the finding that the sensor sees turns the other way round than poses say."""
        if self.chain is None or not len(self.path.stamp_ns):
            return []
        there = planar(self.chain.at(self.path.stamp_ns))
        reached = np.isfinite(there.x)
        hangs = np.count_nonzero(there.upside_down & reached) * 2 > np.count_nonzero(reached)
        matched = self.path.matched * ([1.0, -1.0, -1.0] if hangs else [1.0, 1.0, 1.0])
        logged, turn_seen = _steps(self.path, matched, flat(self.chain.at(self.path.stamp_ns)))
        turn, turn_seen = logged[:, 2], turn_seen[:, 2]
        large = np.maximum(np.abs(turn_seen), np.abs(turn)) > LARGE_TURN
        turn, turn_seen = turn[large], turn_seen[large]
        if len(turn) < MIN_TURNS:
            return []
        # About 0, not about the mean: a robot may turn to one side only.
        related = float((turn * turn_seen).sum() / np.sqrt((turn**2).sum() * (turn_seen**2).sum()))
        stats = SimpleNamespace(
            related=related, correlation=round(related, 3), turns=len(turn), turns_shown=counted(len(turn), "turn")
        )
        return judge([MIRROR], stats, self.named)


def _steps(path: CheckedPath, matched: Float64, others: Float64) -> tuple[Float64, Float64]:
    """Return steps (K, 3) of other poses (S, 3), and those of the matched path between the same sweeps of one piece."""
    seconds = (path.stamp_ns - path.stamp_ns[0]) / SECOND_NS
    begin, end = pairs_of(seconds, matched, others, path.pieces)
    return steps_between(others[begin], others[end]), steps_between(matched[begin], matched[end])


@dataclass(frozen=True, eq=False, slots=True)
class Calibrated:
    """The mount and the delay by the sweeps of one sensor."""

    logged: Float64
    """(3,) x, y [m], yaw [rad] of the mount that the log gives."""
    parent: str
    turned: float
    """Turning of the poses in all [rad]."""
    outlines: Outlines
    base: Callable[[float, float], Float64]
    """Poses (K, 3) of what carries the sensor, by the times of the first beam and from it to the last [s]."""
    start: Float64
    """(7,) unknowns of `solution` by the log alone."""
    trusted: Float64
    """(7,) their deviations."""
    stretch: Int64
    solution: CalibrationResult | None = None
    """x, y, yaw, times of the first beam and from it to the last, scales of lengths and turns."""
    cells: tuple[int, int] = 0, 0
    """Cells that are filled with the mount of the log, and with the one found."""

    @property
    def differs(self) -> bool:
        """True where the mount is known, and not the one that the log gives."""
        if self.solution is None or self.cells[1] >= self.cells[0]:
            return False
        deviation = np.maximum(self.solution.deviations[:3], SURE)
        return bool((deviation < UNSURE).all()) and differs(self.solution.values[:3] - self.logged, deviation)

    @property
    def mount(self) -> Float64:
        """(3,) the mount that counts: the one found where it differs."""
        return self.solution.values[:3] if self.solution is not None and self.differs else self.logged

    def placing(self, values: Float64) -> Float64:
        """Return the poses of the sensor by the unknowns of `solution`."""
        base = self.base(float(values[3]), float(values[4]))
        return poses_after(scaled_path(base, values[5], values[6]), values[:3])


def _split(chain: PoseChain) -> tuple[tuple[Step, ...], tuple[Step, ...], str]:
    """Return the steps of a chain that mount the sensor, the others, and the frame between them."""
    count = next((k for k, step in enumerate(chain.steps) if not step.track.static), len(chain.steps))
    first = chain.steps[min(count, len(chain.steps) - 1)]
    return chain.steps[:count], chain.steps[count:], first.source or first.track.topic.strip("/")


def _by_log(sensor: SensorSamples) -> Calibrated | None:
    """Return what is known of the mount of a sensor before its sweeps are aligned; None without poses that move."""
    if sensor.chain is None:
        return None
    mount, rest, parent = _split(sensor.chain)
    if not rest:
        return None
    outlines = sensor.outlines()
    base = planar(along(rest, outlines.stamp_ns))
    reached = np.flatnonzero(np.isfinite(base.x))
    here = planar(along(mount, np.zeros(1, np.int64)))
    if len(reached) < 2 or here.upside_down[0] or base.upside_down[reached[0]]:
        return None
    outlines = outlines.those(reached)

    @lru_cache(4)
    def poses(first: float, lasts: float) -> Float64:
        at_ns = outlines.stamp_ns + np.rint((first + lasts * outlines.share) * SECOND_NS).astype(np.int64)
        return flat(along(rest, at_ns, held=True))

    logged = np.array([here.x[0], here.y[0], here.yaw[0]])
    path = poses(0.0, 0.0)
    turned = float(np.abs(wrapped(np.diff(path[:, 2]))).sum())
    stretch = stretches_over(path, outlines.stamp_ns, drifts=of_one_run(sensor.chain.world))
    first, last = sensor.times
    start = np.array([*logged, sensor.delay + first, last - first, 0.0, 0.0])
    is_known = sensor.path.timing.order != AUTO or last != first
    lasts = (KNOWN_TIME if is_known else 0.5) * sensor.period
    trusted = np.array([np.inf, np.inf, np.inf, max(DELAYS, 2.0 * abs(sensor.delay)), lasts, SCALES, SCALES])
    return Calibrated(logged, parent, turned, outlines, poses, start, trusted, stretch)


def calibrate(sensor: SensorSamples) -> Calibrated | None:
    """Find the mount and the delay of the poses by the sweeps of a sensor; None where poses say nothing of it."""
    by_log, fit = _by_log(sensor), sensor.path.fit
    if by_log is None or by_log.turned < MIN_TURN or sensor.was_static or fit is None:
        return by_log
    # Where steps disagree or the poses drift, more than a mount is wrong.
    if fit.verdict not in ("accepted", "corrected") or fit.share < ACCEPTED or sensor.path.drift > DRIFT_NOTED:
        return by_log
    starts = [by_log.start]
    assert sensor.chain is not None
    carrier = along(_split(sensor.chain)[1], sensor.path.stamp_ns + round(sensor.delay * SECOND_NS))
    guess = _mount_by_steps(sensor.path, flat(carrier))
    if guess is not None and (np.abs(guess - by_log.logged) > NEARBY).any():
        starts.append(np.concatenate([guess, by_log.start[3:]]))

    def tried(start: Float64, trusted: Float64) -> tuple[CalibrationResult, int]:
        found = solve(by_log.outlines, by_log.placing, start, trusted, by_log.stretch)
        return found, cells_filled(by_log.outlines, by_log.placing(found.values), by_log.stretch)

    best, filled = min((tried(start, by_log.trusted) for start in starts), key=lambda one: one[1])
    if not differs(best.values[:3] - by_log.logged, np.maximum(best.deviations[:3], SURE)):
        return replace(by_log, solution=best, cells=(filled, filled))
    _, before = tried(by_log.start, np.concatenate([np.zeros(3), by_log.trusted[3:]]))
    return replace(by_log, solution=best, cells=(before, filled))


def _mount_by_steps(path: CheckedPath, carrier: Float64) -> Float64 | None:
    """Return the mount by the steps of the matched path and those of what carries the sensor; None where they are few."""
    logged, matched = _steps(path, path.matched, carrier)
    return np.array(mount_between(matched, logged)) if len(logged) >= MIN_TURNS else None


def _mount(frame: str, parent: str, values: Float64) -> Mount:
    x, y = (round(float(one), 4) for one in values[:2])
    return Mount(frame, parent, x, y, round(math.remainder(float(values[2]), TURN), 4))


def _placed(place: Mount, deviation: Float64, logged: Float64 | None, fixed: Mount, **more: float) -> SimpleNamespace:
    """Return what the rules of mounts ask; `fixed` is the transform to publish."""
    names = ("x", "y", "yaw")
    evidence = {name: getattr(place, name) for name in names}
    evidence |= {f"sd_{name}": round(float(one), 4) for name, one in zip(names, deviation, strict=True)}
    shown = ""
    if logged is not None:
        evidence |= {f"told_{name}": round(float(one), 4) for name, one in zip(names, logged, strict=True)}
        shown = f"x {logged[0] + 0.0:.2f} m, y {logged[1] + 0.0:.2f} m, yaw {math.degrees(logged[2]) + 0.0:.1f} degrees"
    lines = transform_lines(visible(fixed.parent), visible(fixed.frame), fixed.x, fixed.y, fixed.yaw)
    return SimpleNamespace(
        child=place.frame or "the sensor",
        parent=place.parent,
        x=place.x,
        y=place.y,
        sd=deviation,
        yaw_degrees=math.degrees(place.yaw),
        sd_degrees=math.degrees(deviation[2]),
        is_told=logged is not None,
        told_shown=shown,
        evidence=evidence | more,
        fix=Fix("transform", lines) if fixed.frame and fixed.parent else None,
    )


def mount_finding(sensor: SensorSamples, found: Calibrated | None) -> tuple[list[Finding], list[Mount]]:
    """Return the finding on a mount, and the mount that was found where it is another one."""
    if found is None:
        return [], []
    if found.solution is None:
        if sensor.was_static:
            return [], []
        degrees, child = math.degrees(found.turned), sensor.frame or sensor.topic
        stats = SimpleNamespace(turned=round(found.turned, 3), turned_degrees=degrees, child=child)
        return (judge([MOUNT_UNKNOWN], stats, sensor.named) if found.turned < MIN_TURN else []), []
    if not found.differs:
        return [], []
    mount = _mount(sensor.frame, found.parent, found.solution.values)
    cells = {"cells_told": found.cells[0], "cells": found.cells[1], "turned": round(found.turned, 3)}
    stats = _placed(mount, np.maximum(found.solution.deviations[:3], SURE), found.logged, mount, **cells)
    assumed = sensor.chain is not None and sensor.chain.assumption
    stats.says, stats.differs = "without a mount it is taken to be at" if assumed else "tf says", True
    is_turned = abs(math.remainder(float(found.solution.values[2] - found.logged[2]), TURN)) > FAR_TURN
    stats.cause = "; or its first beam is elsewhere (angle_min)" if is_turned else ""
    return judge([MOUNT], stats, sensor.named), [mount]


def stamp_finding(sensor: SensorSamples, found: Calibrated | None) -> list[Finding]:
    """Return the finding that header stamps are those of the middle or of the last beam, where the sweeps show."""
    first, last = sensor.times
    duration = abs(last - first)
    if found is None or found.solution is None or not duration:
        return []
    if not (found.solution.deviations[:3] < UNSURE).all():
        return []
    # The beam that is sent first is the last one of the sweep where they run backwards.
    both = np.zeros(len(found.solution.values))
    both[3:5] = 1.0, float(last < first)
    begin, variance = float(both @ found.solution.values), float(both @ found.solution.covariance @ both)
    begin -= sensor.requested_delay + min(first, last)
    deviation, share = math.sqrt(max(variance, 0.0)), -begin / duration
    beam = min(_STAMPED, key=lambda one: abs(_STAMPED[one] - share))
    stats = SimpleNamespace(
        beam=beam,
        off=abs(_STAMPED[beam] - share),
        unsure=max(deviation / duration, 0.02),
        early=-begin,
        deviation=deviation,
        seconds=duration,
        mends=sensor.requested_delay - _STAMPED[beam] * duration,
        delay=round(begin, 4),
        sd_delay=round(deviation, 4),
        duration=round(duration, 4),
    )
    return judge([STAMP], stats, sensor.named)


def lasers_finding(
    first: SensorSamples, found: Calibrated | None, second: SensorSamples, tree: FrameTree
) -> tuple[list[Finding], list[Mount]]:
    """Return the finding on the place of a second laser in the frame of the first one, and its mount; `tree`: static."""
    logged = None
    if (steps := tree.path(frame_name(second.frame), frame_name(first.frame))) is not None:
        place = flat(along(steps, np.zeros(1, np.int64)))
        if found is not None and found.solution is not None and found.differs:
            place = steps_between(found.mount[None], poses_after(found.logged[None], place))
        logged = place[0]
    place_of = (
        _standing(first, second) if first.was_static and second.was_static else _driving(first, second, found, logged)
    )
    if isinstance(place_of, str):
        return judge([LASERS_UNKNOWN], SimpleNamespace(first=first.topic, why=place_of), second.named), []
    deviation = np.maximum(place_of.deviations[:3], SURE * (3.0 if first.was_static else 1.0))
    if not (deviation < UNSURE).all():
        stats = SimpleNamespace(first=first.topic, why="they see too little alike")
        return judge([LASERS_UNKNOWN], stats, second.named), []
    if logged is not None and not differs(place_of.values[:3] - logged, deviation):
        return [], []
    parent, carrier = first.frame, np.zeros(3)
    carried = None if second.chain is None or second.chain.assumption else _split(second.chain)[2]
    if found is not None and carried == found.parent:
        # The transform to mend is that to the robot.
        parent, carrier = found.parent, found.mount
    mount = _mount(second.frame, parent, poses_after(carrier[None], place_of.values[:3])[0])
    stats = _placed(_mount(second.frame, first.frame, place_of.values), deviation, logged, mount)
    return judge([LASERS, LASERS_UNTOLD], stats, second.named), [mount]


def _driving(
    first: SensorSamples, second: SensorSamples, found: Calibrated | None, logged: Float64 | None
) -> CalibrationResult | str:
    """Place both lasers by the path of the first, and find where the second is by the map of both; else why not."""
    chain = first.path.chain
    if chain is None:
        return "nothing tells how the robot drove"
    if found is not None and found.solution is None and found.turned < MIN_TURN:
        return "the robot turns too little"
    parts = [first.outlines(), second.outlines()]
    paths = [flat(chain.at(part.stamp_ns)) for part in parts]
    reached = [np.flatnonzero(np.isfinite(path[:, 0])) for path in paths]
    parts = [part.those(one) for part, one in zip(parts, reached, strict=True)]
    if min(len(part.stamp_ns) for part in parts) < MIN_STEPS * SLOTS:
        return "too few of their sweeps have a pose"
    outlines = joined_outlines(parts)
    here, other = (path[one] for path, one in zip(paths, reached, strict=True))

    def placing(values: Float64) -> Float64:
        there = flat(chain.at(parts[1].stamp_ns + round(float(values[3]) * SECOND_NS)))
        # Nothing is known beyond the ends of the path, nor in its gaps.
        return np.vstack([here, poses_after(np.where(np.isnan(there), other, there), values[:3])])

    turned = float(np.abs(wrapped(np.diff(here[:, 2]))).sum())
    if turned < MIN_TURN:
        return f"the robot turns by {math.degrees(turned):.0f} degrees, and {math.degrees(MIN_TURN):.0f} are needed"
    both = np.vstack([here, other])
    stretch = stretches_over(both, outlines.stamp_ns, drifts=of_one_run(chain.world))
    starts = [] if logged is None else [logged]
    if len(second.path.stamp_ns):
        guess = _mount_by_steps(second.path, flat(chain.at(second.path.stamp_ns)))
        starts += [] if guess is None else [guess]
    if not starts:
        return "their paths cannot be matched"
    # The clocks of two lasers differ by about 20 ms.
    trusted = np.array([np.inf, np.inf, np.inf, 0.02])
    tried = [solve(outlines, placing, np.array([*start, 0.0]), trusted, stretch) for start in starts]
    return min(tried, key=lambda one: cells_filled(outlines, placing(one.values), stretch))


def _standing(first: SensorSamples, second: SensorSamples) -> CalibrationResult | str:
    """Lay what the second laser sees on what the first one sees, while both are static; else return why that cannot be."""
    parts = [first.outlines(), second.outlines()]
    if not all(len(part) for part in parts):
        return "they see nothing"
    outlines = joined_outlines(parts)
    counts = [len(part.stamp_ns) for part in parts]

    def placing(values: Float64) -> Float64:
        return np.vstack([np.zeros((counts[0], 3)), np.tile(values, (counts[1], 1))])

    stretch = np.zeros(sum(counts), np.int64)
    tried = []
    for start in places_beside(parts[0].points, parts[1].points):
        found = solve(outlines, placing, start, np.full(3, np.inf), stretch)
        alike = overlap(parts[0].points, parts[1].points, found.values)
        tried.append((alike.share - AGAINST * alike.against, alike, found))
    tried.sort(key=lambda one: -one[0])
    best, alike, found = tried[0]
    if alike.share < MIN_OVERLAP or alike.against > MAX_AGAINST or alike.width < MIN_WIDTH:
        return "they see too little alike while they stand"
    for score, _, other in tried[1:]:
        x, y, yaw = other.values[:3] - found.values[:3]
        is_near = math.hypot(x, y) < 0.2 and abs(math.remainder(yaw, TURN)) < NEARBY
        if score > best - CLEARLY and not is_near:
            return "what they see fits in two places"
    return found


SECTOR, SECTORS = np.deg2rad(30.0), 12
_SEEING = (Status.VALID, Status.NO_RETURN, Status.TOO_CLOSE, Status.INVALID)


class _Flicker:
    """Counts of beams and of their changes between valid and no return, by sectors of 30 degrees."""

    def __init__(self) -> None:
        self.steps, self.changes, self.valid, self.beams = (np.zeros(SECTORS) for _ in range(4))
        self.sweeps = 0
        self._last: UInt8 | None = None

    def add(self, batch: SweepBatch) -> None:
        """Take sweeps."""
        bearing = batch.angle_min[0] + batch.angle_increment[0] * np.arange(batch.width)
        # Beams of other sweeps look elsewhere.
        same = (batch.angle_min == batch.angle_min[0]) & (batch.beams == batch.width)
        if not same.any():
            return
        batch = batch if same.all() else batch.rows(np.flatnonzero(same))
        sector = np.floor((bearing + 0.5 * SECTOR) % TURN / SECTOR).astype(np.int64) % SECTORS
        status = batch.status
        if self._last is not None and self._last.shape[1] == batch.width:
            status = np.vstack([self._last, status])
        self._last = status[-2:]
        is_valid, is_lost = status == Status.VALID, status == Status.NO_RETURN
        either = is_valid | is_lost
        steps = either[2:] & either[1:-1] & either[:-2]
        # What passes by changes once; what flickers changes back at once.
        changes = steps & (is_valid[1:-1] != is_valid[:-2]) & (is_valid[2:] == is_valid[:-2])
        counts = (steps, changes, batch.status == Status.VALID, np.isin(batch.status, _SEEING))
        for sums, one in zip((self.steps, self.changes, self.valid, self.beams), counts, strict=True):
            sums += np.bincount(sector, one.sum(axis=0), SECTORS)
        self.sweeps += len(batch)
