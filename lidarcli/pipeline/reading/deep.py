"""Findings that align sweeps: mounts, the times and the fit of told poses, the robot's own body, beams that flicker."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import SimpleNamespace

import numpy as np

from lidarcli.display.texts import counted, visible
from lidarcli.errors import OptionError
from lidarcli.logs.base import Log, OpenOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.registry import TopicChoice
from lidarcli.pipeline.inputs.declared import mask_text
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.reading.masking import MAX_SENSORS, STOOD_REACH, MaskRules, MovedPath, masking_of
from lidarcli.pipeline.reading.path_check import DRIFT_NOTED, CheckedPath
from lidarcli.pipeline.reading.posing import NONE, Need, PoseAttacher, PoseOptions, of_one_run
from lidarcli.pose import calibration
from lidarcli.pose.fit import ACCEPTED, AUTO, headers_of, mount_between, pairs_of, poses_after, steps_between, wrapped
from lidarcli.pose.sources import FrameTree, PoseChain, Step, along
from lidarcli.pose.tracks import SECOND_NS, flat, frame_name, planar
from lidarcli.sweeps.finding_rules import (
    BODY,
    BODY_UNKNOWN,
    DEVIATIONS,
    FLICKER,
    FLICKERS,
    LASERS,
    LASERS_UNKNOWN,
    LASERS_UNTOLD,
    LOST_SECTORS,
    MIN_ASKEW,
    MIN_OFF,
    MIN_TURN,
    MIRROR,
    MOUNT,
    MOUNT_UNKNOWN,
    STAMP,
    judge,
)
from lidarcli.sweeps.findings import IDS, Finding, Fix, Sensor, transform_lines
from lidarcli.sweeps.masks import Mask, Masks, Mount, Sector
from lidarcli.sweeps.types import TURN, Bool, Float64, Int64, Status, SweepBatch, UInt8

MAX_SWEEPS, STANDING_SWEEPS = 400, 20
"""Most sweeps of a sensor that are aligned, and the first ones, which are taken though it stands."""
MOVED, TURNED = 0.02, 0.017
"""Others are taken after the sensor went so far [m] or turned so much [rad]."""
MAX_POINTS = 120
"""Points of a sweep that are aligned."""
DRIFTING, FIXED = (0.5 * np.pi, 5.0), (TURN, 50.0)
"""Turn [rad] and distance [m] of a stretch in which poses do not drift much: of odometry, and of poses in a map."""
NEARBY = 0.1
"""A mount by steps of the path that is no farther from the told one [m, rad] is found from there."""
UNSURE = np.array([0.05, 0.05, np.deg2rad(2.0)])
"""Deviations of a mount that is known well enough [m, rad]."""
SURE = np.array([0.003, 0.003, np.deg2rad(0.1)])
"""No mount is known better: grids and ranges err, too [m, rad]."""
DELAYS, KNOWN_TIME, SCALES = 0.2, 0.1, 0.02
"""Deviations before the sweeps are looked at of a delay [s], of the time of a sweep that is told, as a share of the period,
and of the scales of told lengths and turns."""
LARGE_TURN, MIN_TURNS = 0.08, 8
"""Turns that count [rad], and the fewest of them."""
_STAMPED = {"first": 0.0, "middle": 0.5, "last": 1.0}
"""Beam at whose time a header is stamped → its share of the time of the sweep."""
MIN_TIME = 0.02
"""Deviation of such a share that is told at best."""
LASER_DELAYS = 0.02
"""Deviation of the clocks of two lasers [s]."""
MIN_STEPS, MIN_BEAMS = 20, 3
"""Fewest steps that tell of a flicker, and fewest beams of a sector."""
AGAINST, CLEARLY = 2.0, 0.25
"""Points against a place count so much more than points for it; and by how much the next best place is worse."""
MIN_OVERLAP, MIN_WIDTH, MAX_AGAINST = 0.6, np.deg2rad(120.0), 0.05
"""Of what a second laser sees while both stand: the least share that is on what the first one sees, the least width of this
[rad], and the greatest share that speaks against it."""

Key = tuple[str, str]
"""Topic and frame."""


@dataclass(frozen=True, slots=True)
class DeepFindings:
    """Findings of a second look at a log, and how to fix them."""

    findings: tuple[Finding, ...] = ()
    masks: Masks = field(default_factory=Masks)
    """Mask of the robot itself."""
    mounts: tuple[Mount, ...] = ()
    """Mounts that differ from what the log tells, or that it does not tell."""


def deep_findings(
    source: Source, opening: OpenOptions | None = None, read: ReadOptions | None = None, poses: PoseOptions | None = None
) -> DeepFindings:
    """Align sweeps of a log, in bounded memory, and return what they contradict; of several runs the longest is read."""
    poses, read = poses or PoseOptions(), read or ReadOptions()
    with open_source(source, opening) as log:
        choice = TopicChoice(read.topics, log.topics())
        masking, posing = _masking(log, read, poses, choice)
        read = ReadOptions(choice.wanted or None, run=read.run or posing.longest, rules=masking.rules)
        posing = posing.of_run(read.run)
        sources = None if posing.found is None else posing.found.sources
        sensors: dict[Key, _Sensor] = {}
        for batch in read_batches(log, read, ReadReport(), choice):
            for frame, _, mine in batch.by_frame():
                key = batch.topic, frame
                if key not in sensors:
                    if len(sensors) == MAX_SENSORS:
                        continue
                    chain = None if sources is None or poses.source == NONE else sources.chain(frame, batch.topic)
                    sensors[key] = _Sensor(*key, posing.paths.get(key), chain, poses.delay or 0.0)
                sensors[key].add(mine)
        links = [] if sources is None else [one for one in sources.tracks if one.is_link and one.static]
        findings: list[Finding] = []
        mounts: list[Mount] = []
        firsts: dict[str, tuple[_Sensor, _Calibrated | None]] = {}
        frames: set[Key] = set()
        for key in sorted(sensors):
            sensor = sensors[key]
            findings += _body(sensor, masking) + _flickering(sensor)
            world = "" if sensor.chain is None else sensor.chain.world
            # One sensor for each frame of a world, the first of its topics.
            if (world, key[1].lstrip("/")) in frames:
                continue
            frames.add((world, key[1].lstrip("/")))
            if mirrored := sensor.mirrored():
                findings += mirrored
                continue
            # Lasers of several robots are not beside each other.
            world = next(iter(firsts), "") if sensor.chain is None else world
            if world not in firsts:
                calibrated = _calibrated(sensor)
                finding, mount = _mount_finding(sensor, calibrated)
                firsts[world] = sensor, calibrated
                findings += finding + _stamp_finding(sensor, calibrated)
            else:
                finding, mount = _lasers_finding(*firsts[world], sensor, FrameTree(links, sensor.topic))
                findings += finding
            mounts += mount
        findings.sort(key=lambda one: (IDS.index(one.id), one.topic, one.frame))
        return DeepFindings(tuple(findings), masking.learned, tuple(mounts))


def _masking(log: Log, read: ReadOptions, poses: PoseOptions, choice: TopicChoice) -> tuple[MaskRules, PoseAttacher]:
    """Learn the mask of the robot itself, where the user gave none; return it and the poses."""
    rules = read.rules
    if rules.masks is None or rules.masks.learn:
        try:
            masking = masking_of(log, replace(rules, masks=Masks(learn=True)), poses, choice.wanted or None)
        except OptionError:
            masking = MaskRules(replace(rules, masks=None))
        if masking.posing is not None:
            return masking, masking.posing
    else:
        masking = masking_of(log, rules, poses, choice.wanted or None)
    return masking, PoseAttacher.of(log, poses, choice, replace(read, rules=masking.rules), need=Need.ALL)


def _body(sensor: _Sensor, masking: MaskRules) -> list[Finding]:
    """Return what is told of beams that end on the robot itself."""
    masks: list[Mask] = [mask for mask in masking.learned.masks if mask.topic == sensor.topic]
    if not masks:
        beams = masking.unclear.get((sensor.topic, sensor.frame), 0)
        why = "nothing moves" if sensor.stood else "the sensor moves too little"
        unclear = SimpleNamespace(beams=beams, beams_shown=counted(beams, "beam"), why=why, reach=STOOD_REACH)
        return judge([BODY_UNKNOWN], unclear, sensor.named)
    sectors = [mask.shape for mask in masks if isinstance(mask.shape, Sector)]
    beams = sum(round((one.end - one.begin) / sensor.step) for one in sectors) if sensor.step else 0
    body = SimpleNamespace(
        masks=masks,
        beams=beams,
        beams_shown=counted(beams, "beam"),
        nearest=min(one.nearest for one in sectors),
        farthest=max(one.farthest for one in sectors),
        fix=Fix("mask", mask_text(Masks(tuple(masks)), Masks())),
    )
    return judge([BODY], body, sensor.named)


class _Sensor:
    """Samples and counts of one topic and frame."""

    def __init__(self, topic: str, frame: str, path: CheckedPath | None, chain: PoseChain | None, delay: float) -> None:
        self.topic, self.frame, self.chain, self.asked_delay = topic, frame, chain, delay
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
    def stood(self) -> bool:
        """True where nothing tells that the sensor moved."""
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

    def outlines(self) -> calibration.Outlines:
        """Return the points of the sampled sweeps."""
        kept = sorted({one[1]: one[1:] for one in self._kept}.values(), key=lambda one: one[0])
        return calibration.outlines_of(kept, calibration.SLOTS, MAX_POINTS)

    def mirrored(self) -> list[Finding]:
        """Return the finding that the sensor sees turns the other way round than poses tell."""
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
    begin, end = pairs_of(seconds, matched, others)
    same = path.pieces[begin] == path.pieces[end]
    begin, end = begin[same], end[same]
    return steps_between(others[begin], others[end]), steps_between(matched[begin], matched[end])


@dataclass(frozen=True, eq=False, slots=True)
class _Calibrated:
    """The mount and the delay by the sweeps of one sensor."""

    logged: Float64
    """(3,) x, y [m], yaw [rad] of the mount that the log tells."""
    parent: str
    turned: float
    """Turning of the poses in all [rad]."""
    outlines: calibration.Outlines
    base: Callable[[float, float], Float64]
    """Poses (K, 3) of what carries the sensor, by the times of the first beam and from it to the last [s]."""
    start: Float64
    """(7,) unknowns of `settled` by the log alone."""
    trusted: Float64
    """(7,) their deviations."""
    stretch: Int64
    settled: calibration.CalibrationResult | None = None
    """x, y, yaw, times of the first beam and from it to the last, scales of lengths and turns."""
    cells: tuple[int, int] = 0, 0
    """Cells that are filled with the mount of the log, and with the one found."""

    @property
    def differs(self) -> bool:
        """True where the mount is known, and not the one that the log tells."""
        if self.settled is None or self.cells[1] >= self.cells[0]:
            return False
        deviation = np.maximum(self.settled.deviations[:3], SURE)
        return bool((deviation < UNSURE).all()) and differs(self.settled.values[:3] - self.logged, deviation)

    @property
    def mount(self) -> Float64:
        """(3,) the mount that counts: the one found where it differs."""
        return self.settled.values[:3] if self.settled is not None and self.differs else self.logged

    def placing(self, values: Float64) -> Float64:
        """Return the poses of the sensor by the unknowns of `settled`."""
        base = self.base(float(values[3]), float(values[4]))
        return poses_after(calibration.scaled_path(base, values[5], values[6]), values[:3])


def _split(chain: PoseChain) -> tuple[tuple[Step, ...], tuple[Step, ...], str]:
    """Return the steps of a chain that mount the sensor, the others, and the frame between them."""
    count = next((k for k, step in enumerate(chain.steps) if not step.track.static), len(chain.steps))
    first = chain.steps[min(count, len(chain.steps) - 1)]
    return chain.steps[:count], chain.steps[count:], first.source or first.track.topic.strip("/")


def _by_log(sensor: _Sensor) -> _Calibrated | None:
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
    stretch = calibration.stretches_of(path, *(DRIFTING if of_one_run(sensor.chain.world) else FIXED))
    first, last = sensor.times
    start = np.array([*logged, sensor.delay + first, last - first, 0.0, 0.0])
    is_known = sensor.path.timing.order != AUTO or last != first
    lasts = (KNOWN_TIME if is_known else 0.5) * sensor.period
    trusted = np.array([np.inf, np.inf, np.inf, max(DELAYS, 2.0 * abs(sensor.delay)), lasts, SCALES, SCALES])
    return _Calibrated(logged, parent, turned, outlines, poses, start, trusted, stretch)


def _calibrated(sensor: _Sensor) -> _Calibrated | None:
    """Find the mount and the delay of the poses by the sweeps of a sensor; None where poses tell nothing of it."""
    by_log, fit = _by_log(sensor), sensor.path.fit
    if by_log is None or by_log.turned < MIN_TURN or sensor.stood or fit is None:
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

    def tried(start: Float64, trusted: Float64) -> tuple[calibration.CalibrationResult, int]:
        found = calibration.settle(by_log.outlines, by_log.placing, start, trusted, by_log.stretch)
        return found, calibration.cells_filled(by_log.outlines, by_log.placing(found.values), by_log.stretch)

    best, filled = min((tried(start, by_log.trusted) for start in starts), key=lambda one: one[1])
    if not differs(best.values[:3] - by_log.logged, np.maximum(best.deviations[:3], SURE)):
        return replace(by_log, settled=best, cells=(filled, filled))
    _, before = tried(by_log.start, np.concatenate([np.zeros(3), by_log.trusted[3:]]))
    return replace(by_log, settled=best, cells=(before, filled))


def _mount_by_steps(path: CheckedPath, carrier: Float64) -> Float64 | None:
    """Return the mount by the steps of the matched path and those of what carries the sensor; None where they are few."""
    logged, matched = _steps(path, path.matched, carrier)
    return np.array(mount_between(matched, logged)) if len(logged) >= MIN_TURNS else None


def differs(off: Float64, deviation: Float64) -> bool:
    """Return whether a mount is off (3,) by more than its deviations explain [m, rad]."""
    off = np.array([*off[:2], *wrapped(off[2:])])
    return bool((np.abs(off) > np.maximum(DEVIATIONS * deviation, [MIN_OFF, MIN_OFF, MIN_ASKEW])).any())


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


def _mount_finding(sensor: _Sensor, found: _Calibrated | None) -> tuple[list[Finding], list[Mount]]:
    """Return the finding on a mount, and the mount that was found where it is another one."""
    if found is None:
        return [], []
    if found.settled is None:
        if sensor.stood:
            return [], []
        degrees, child = math.degrees(found.turned), sensor.frame or sensor.topic
        stats = SimpleNamespace(turned=round(found.turned, 3), turned_degrees=degrees, child=child)
        return (judge([MOUNT_UNKNOWN], stats, sensor.named) if found.turned < MIN_TURN else []), []
    if not found.differs:
        return [], []
    mount = _mount(sensor.frame, found.parent, found.settled.values)
    cells = {"cells_told": found.cells[0], "cells": found.cells[1], "turned": round(found.turned, 3)}
    stats = _placed(mount, np.maximum(found.settled.deviations[:3], SURE), found.logged, mount, **cells)
    assumed = sensor.chain is not None and sensor.chain.assumption
    stats.says, stats.differs = "without a mount it is taken to be at" if assumed else "tf says", True
    return judge([MOUNT], stats, sensor.named), [mount]


def _stamp_finding(sensor: _Sensor, found: _Calibrated | None) -> list[Finding]:
    """Return the finding that header stamps are those of the middle or of the last beam, where the sweeps tell."""
    first, last = sensor.times
    duration = abs(last - first)
    if found is None or found.settled is None or not duration:
        return []
    if not (found.settled.deviations[:3] < UNSURE).all():
        return []
    # The beam that is sent first is the last one of the sweep where they run backwards.
    both = np.zeros(len(found.settled.values))
    both[3:5] = 1.0, float(last < first)
    begin, variance = float(both @ found.settled.values), float(both @ found.settled.covariance @ both)
    begin -= sensor.asked_delay + min(first, last)
    deviation, share = math.sqrt(max(variance, 0.0)), -begin / duration
    beam = min(_STAMPED, key=lambda one: abs(_STAMPED[one] - share))
    stats = SimpleNamespace(
        beam=beam,
        off=abs(_STAMPED[beam] - share),
        unsure=max(deviation / duration, MIN_TIME),
        early=-begin,
        deviation=deviation,
        seconds=duration,
        mends=sensor.asked_delay - _STAMPED[beam] * duration,
        delay=round(begin, 4),
        sd_delay=round(deviation, 4),
        duration=round(duration, 4),
    )
    return judge([STAMP], stats, sensor.named)


def _lasers_finding(
    first: _Sensor, found: _Calibrated | None, second: _Sensor, tree: FrameTree
) -> tuple[list[Finding], list[Mount]]:
    """Return the finding on the place of a second laser in the frame of the first one, and its mount; `tree`: static."""
    logged = None
    if (steps := tree.path(frame_name(second.frame), frame_name(first.frame))) is not None:
        place = flat(along(steps, np.zeros(1, np.int64)))
        if found is not None and found.settled is not None and found.differs:
            place = steps_between(found.mount[None], poses_after(found.logged[None], place))
        logged = place[0]
    place_of = _standing(first, second) if first.stood and second.stood else _driving(first, second, found, logged)
    if isinstance(place_of, str):
        return judge([LASERS_UNKNOWN], SimpleNamespace(first=first.topic, why=place_of), second.named), []
    deviation = np.maximum(place_of.deviations[:3], SURE * (3.0 if first.stood else 1.0))
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
    first: _Sensor, second: _Sensor, found: _Calibrated | None, logged: Float64 | None
) -> calibration.CalibrationResult | str:
    """Place both lasers by the path of the first, and find where the second is by the map of both; else why not."""
    chain = first.path.chain
    if chain is None:
        return "nothing tells how the robot drove"
    if found is not None and found.settled is None and found.turned < MIN_TURN:
        return "the robot turns too little"
    parts = [first.outlines(), second.outlines()]
    paths = [flat(chain.at(part.stamp_ns)) for part in parts]
    reached = [np.flatnonzero(np.isfinite(path[:, 0])) for path in paths]
    parts = [part.those(one) for part, one in zip(parts, reached, strict=True)]
    if min(len(part.stamp_ns) for part in parts) < MIN_STEPS * calibration.SLOTS:
        return "too few of their sweeps have a pose"
    outlines = calibration.joined_outlines(parts)
    here, other = (path[one] for path, one in zip(paths, reached, strict=True))

    def placing(values: Float64) -> Float64:
        there = flat(chain.at(parts[1].stamp_ns + round(float(values[3]) * SECOND_NS)))
        # Nothing is known beyond the ends of the path, nor in its gaps.
        return np.vstack([here, poses_after(np.where(np.isnan(there), other, there), values[:3])])

    turned = float(np.abs(wrapped(np.diff(here[:, 2]))).sum())
    if turned < MIN_TURN:
        return f"the robot turns by {math.degrees(turned):.0f} degrees, and {math.degrees(MIN_TURN):.0f} are needed"
    both = np.vstack([here, other])
    order = np.argsort(outlines.stamp_ns, kind="stable")
    stretch = np.empty(len(both), np.int64)
    stretch[order] = calibration.stretches_of(both[order], *(DRIFTING if of_one_run(chain.world) else FIXED))
    starts = [] if logged is None else [logged]
    if len(second.path.stamp_ns):
        guess = _mount_by_steps(second.path, flat(chain.at(second.path.stamp_ns)))
        starts += [] if guess is None else [guess]
    if not starts:
        return "their paths cannot be matched"
    trusted = np.array([np.inf, np.inf, np.inf, LASER_DELAYS])
    tried = [calibration.settle(outlines, placing, np.array([*start, 0.0]), trusted, stretch) for start in starts]
    return min(tried, key=lambda one: calibration.cells_filled(outlines, placing(one.values), stretch))


def _standing(first: _Sensor, second: _Sensor) -> calibration.CalibrationResult | str:
    """Lay what the second laser sees on what the first one sees, while both stand; else return why that cannot be."""
    parts = [first.outlines(), second.outlines()]
    if not all(len(part) for part in parts):
        return "they see nothing"
    outlines = calibration.joined_outlines(parts)
    counts = [len(part.stamp_ns) for part in parts]

    def placing(values: Float64) -> Float64:
        return np.vstack([np.zeros((counts[0], 3)), np.tile(values, (counts[1], 1))])

    stretch = np.zeros(sum(counts), np.int64)
    tried = []
    for start in calibration.places_beside(parts[0].points, parts[1].points):
        found = calibration.settle(outlines, placing, start, np.full(3, np.inf), stretch)
        alike = calibration.overlap(parts[0].points, parts[1].points, found.values)
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


def _flickering(sensor: _Sensor) -> list[Finding]:
    """Return the findings on sectors that flicker, and on those that are always lost though the sensor turned."""
    counts = sensor.flicker
    if counts.sweeps <= MIN_STEPS:
        return []
    # Of each two changes of a beam that flickers one is back.
    share = 2.0 * counts.changes / np.maximum(counts.steps, 1.0)
    flickers = (counts.steps >= MIN_STEPS * MIN_BEAMS) & (share > FLICKERS)
    worst = float(share[flickers].max(initial=0.0))
    sees = counts.beams >= MIN_BEAMS * counts.sweeps
    others = (counts.valid / np.maximum(counts.beams, 1.0))[sees & (counts.valid > 0)]
    median = float(np.median(others)) if len(others) else 0.0
    lost = _in_sectors(sees & (counts.valid == 0), others_share=median, others=round(median, 3), valid=0.0)
    lost.turned, lost.turned_degrees = sensor.moves.turned, math.degrees(sensor.moves.turned)
    return judge([FLICKER], _in_sectors(flickers, worst=worst, changes=round(worst, 3)), sensor.named) + judge(
        [LOST_SECTORS], lost, sensor.named
    )


def _in_sectors(chosen: Bool, **more: float) -> SimpleNamespace:
    """Return what the rules of sectors ask: the middles of the chosen ones [deg], also as words."""
    middles = sorted(round(math.degrees(math.remainder(one * SECTOR, TURN))) for one in np.flatnonzero(chosen).tolist())
    half = math.degrees(SECTOR) / 2.0
    places = ", ".join(f"{one - half:.0f} to {one + half:.0f}" for one in middles)
    return SimpleNamespace(sectors=middles, places=places, **more)
