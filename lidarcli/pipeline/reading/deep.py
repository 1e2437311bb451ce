"""Findings that align sweeps: mounts, the times and the fit of told poses, the robot's own body, beams that flicker."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from lidarcli.display import counted
from lidarcli.errors import OptionError
from lidarcli.findings import Finding, Fix, transform_lines
from lidarcli.logs.base import Log, OpenOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.options import TopicChoice
from lidarcli.masks import Mask, Masks, Mount, Sector
from lidarcli.pipeline.inputs.masks import mask_text
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.reading.masking import MOST_SENSORS, STOOD_REACH, MaskRules, masking_of
from lidarcli.pipeline.reading.path_check import CheckedPath
from lidarcli.pipeline.reading.pose_sources import NONE, Need, PoseOptions, of_one_run
from lidarcli.pipeline.reading.posing import Posing
from lidarcli.pose.calibration import (
    Outlines,
    Settled,
    cells_filled,
    joined_outlines,
    mounted,
    overlap,
    places_beside,
    scaled_path,
    settle,
    stretches_of,
    surfaces,
)
from lidarcli.pose.fit import ACCEPTED, mount_between, pairs_of, steps_between, wrapped
from lidarcli.pose.matched import AUTO
from lidarcli.pose.messages import frame_name
from lidarcli.pose.sources import Way
from lidarcli.pose.tracks import SECOND_NS, planar
from lidarcli.pose.tree import FrameTree, Step, along
from lidarcli.range_rules import RangeRules
from lidarcli.sweeps import TURN, Float64, Int64, Status, SweepBatch, UInt8

MOST_SWEEPS, STANDING_SWEEPS = 400, 20
"""Most sweeps of a sensor that are aligned, and the first ones, which are taken though it stands."""
MOVED, TURNED = 0.02, 0.017
"""Others are taken after the sensor went so far [m] or turned so much [rad]."""
MOST_POINTS = 120
"""Points of a sweep that are aligned."""
SLOTS = 8
"""Parts of a sweep that takes time; each is placed by a pose of its own."""
DRIFTING, FIXED = (0.5 * np.pi, 5.0), (TURN, 50.0)
"""Turn [rad] and way [m] of a stretch in which poses do not drift much: of odometry, and of poses in a map."""
LEAST_TURN = np.deg2rad(120.0)
"""Turning of the poses from which on they tell a mount [rad]: of the path that is told, also to and fro."""
NEARBY = 0.1
"""A mount by steps of the path that is no farther from the told one [m, rad] is found from there."""
DEVIATIONS, LEAST_OFF, LEAST_ASKEW = 3.0, 0.02, np.deg2rad(1.0)
"""A mount is told that is off by so many deviations and by this [m, rad]."""
MOST_DEVIATION, MOST_UNSURE = 0.05, np.deg2rad(2.0)
"""Deviations of a mount that is known well enough [m, rad]."""
LEAST_DEVIATION, LEAST_UNSURE = 0.003, np.deg2rad(0.1)
"""No mount is known better: grids and ranges err, too [m, rad]."""
DELAYS, KNOWN_TIME, SCALES = 0.2, 0.1, 0.02
"""Deviations before the sweeps are seen of a delay [s], of the time of a sweep that is told, as a share of the period,
and of the scales of told lengths and turns."""
FEWER = 0.3
"""Share of cells that the matched path fills less."""
MIRRORED = -0.5
"""Correlation of told turns with those seen."""
LARGE_TURN, LEAST_TURNS = 0.08, 8
"""Turns that count [rad], and the fewest of them."""
_STAMPED = {"first": 0.0, "middle": 0.5, "last": 1.0}
"""Beam at whose time a header is stamped → its share of the time of the sweep."""
LEAST_TIME = 0.02
"""Deviation of such a share that is told at best."""
LONGEST_STEP = 0.5
"""No matched pose is between sweeps further apart [s]."""
LASER_DELAYS = 0.02
"""Deviation of the clocks of two lasers [s]."""
STAMP_OFF = 0.15
"""Greatest distance of the delay from half or all of the time of a sweep, as a share of this."""
SECTOR = np.deg2rad(30.0)
FLICKERS = 0.2
"""Share of the steps from sweep to sweep in which a beam changes between valid and no return."""
LEAST_STEPS = 20
"""Fewest steps that tell of a flicker."""
LEAST_BEAMS = 3
"""Fewest beams of a sector that tell of it."""
OTHERS_VALID = 0.5
"""Median share of valid beams of other sectors, where one has none."""
AGAINST = 2.0
"""Points against a place count so much more than points for it."""
LEAST_OVERLAP, LEAST_WIDTH, MOST_AGAINST, CLEARLY = 0.6, np.deg2rad(120.0), 0.05, 0.25
"""Of what a second laser sees while both stand: the least share that is on what the first one sees, the least width of this
[rad], the greatest share that speaks against it; and by how much the next best place is worse."""

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
    source: Source,
    opening: OpenOptions | None = None,
    rules: RangeRules | None = None,
    poses: PoseOptions | None = None,
    topics: Collection[str] | None = None,
) -> DeepFindings:
    """Align sweeps of a log, in bounded memory, and return what they contradict; `topics` are read, by default all.

    Raises
    ------
    OptionError
        The log can be read only once.
    """
    with open_source(source, opening) as log:
        if log.size is None:
            raise OptionError("--deep reads a log twice, and a pipe is read only once: give the file's name")
        return _Deep(log, rules or RangeRules(), poses or PoseOptions(), topics).findings()


class _Deep:
    """A second look at one log."""

    def __init__(self, log: Log, rules: RangeRules, poses: PoseOptions, topics: Collection[str] | None) -> None:
        choice = TopicChoice(topics, log.topics())
        self._masking, self._posing = _masking(log, rules, poses, choice)
        self._sees_poses, self._delay = poses.source != NONE, poses.delay or 0.0
        self._sensors: dict[Key, _Sensor] = {}
        for batch in read_batches(log, ReadOptions(choice.wanted or None, rules=self._masking.rules), ReadReport(), choice):
            for frame, _, mine in batch.by_frame():
                key = batch.topic, frame
                if key not in self._sensors:
                    if len(self._sensors) == MOST_SENSORS:
                        continue
                    self._sensors[key] = _Sensor(*key, self._posing.paths.get(key), self._told(*key), self._delay)
                self._sensors[key].add(mine)

    def _told(self, topic: str, frame: str) -> Way | None:
        if self._posing.found is None or not self._sees_poses:
            return None
        return self._posing.found.sources.way(frame, topic)

    def findings(self) -> DeepFindings:
        """Return the findings of all rules."""
        found: list[Finding] = []
        mounts: list[Mount] = []
        bodies, masks = self._bodies()
        for key in sorted(self._sensors):
            found += _flickering(self._sensors[key])
        firsts: dict[str, tuple[_Sensor, _Calibrated | None, bool]] = {}
        for sensor in self._sensors_of_robots():
            if mirrored := _mirrored(sensor):
                found += mirrored
                continue
            # Lasers of several robots are not beside each other.
            world = next(iter(firsts), "") if sensor.told is None else sensor.told.world
            if world not in firsts:
                calibrated = _calibrated(sensor)
                finding, mount = _mount_finding(sensor, calibrated)
                firsts[world] = sensor, calibrated, bool(mount)
                found += finding
                found += _stamp_finding(sensor, calibrated)
                found += _fit_finding(sensor, calibrated)
            else:
                first, calibrated, is_off = firsts[world]
                told = self._beside(first, sensor, calibrated if is_off else None)
                finding, mount = _lasers_findings(first, sensor, calibrated, told)
                found += finding
            mounts += mount
        order = ("pose_fit", "mirror", "stamp", "mount", "lasers", "body", "flicker")
        found = sorted([*found, *bodies], key=lambda one: (order.index(one.id), one.topic, one.frame))
        return DeepFindings(tuple(found), masks, tuple(mounts))

    def _beside(self, first: _Sensor, second: _Sensor, found: _Calibrated | None) -> Float64 | None:
        """Return where the log tells that a laser is in the frame of another, whose mount may have been found."""
        if self._posing.found is None:
            return None
        links = [one for one in self._posing.found.sources.tracks if one.is_link and one.static]
        steps = FrameTree(links, second.topic).path(frame_name(second.frame), frame_name(first.frame))
        if steps is None:
            return None
        there = planar(along(steps, np.zeros(1, np.int64)))
        place = np.column_stack([there.x, there.y, there.yaw])
        if found is not None and found.settled is not None:
            place = steps_between(found.settled.values[None, :3], mounted(found.told[None], place))
        found_at: Float64 = place[0]
        return found_at

    def _sensors_of_robots(self) -> list[_Sensor]:
        """Return one sensor for each frame of a world, the first of its topics."""
        found: dict[tuple[str, str], _Sensor] = {}
        for key in sorted(self._sensors):
            sensor = self._sensors[key]
            world = "" if sensor.told is None else sensor.told.world
            found.setdefault((world, key[1].lstrip("/")), sensor)
        return list(found.values())

    def _bodies(self) -> tuple[list[Finding], Masks]:
        """Return what is told of beams that end on the robot itself, and their mask."""
        found = []
        for topic, frame in sorted(self._sensors):
            mine = [mask for mask in self._masking.learned.masks if mask.topic == topic]
            beams = self._masking.unclear.get((topic, frame), 0)
            if mine:
                found.append(_body(topic, frame, mine, self._sensors[topic, frame].step))
            elif beams:
                why = "nothing moves" if self._sensors[topic, frame].stood else "the sensor moves too little"
                words = f"{topic}: cannot be told: {why} ({counted(beams, 'beam')} below {STOOD_REACH:g} m)"
                evidence, threshold = {"beams": beams}, {"beams": 1, "range": STOOD_REACH}
                found.append(Finding("body", "hint", topic, frame, words, evidence, threshold))
        return found, self._masking.learned


def _masking(log: Log, rules: RangeRules, poses: PoseOptions, choice: TopicChoice) -> tuple[MaskRules, Posing]:
    """Learn the mask of the robot itself, where the user gave none; return it and the poses."""
    if rules.masks is None or rules.masks.learn:
        with_mask = replace(rules, masks=Masks(learn=True))
        try:
            masking = masking_of(log, with_mask, poses, choice.wanted or None)
        except OptionError:
            masking = MaskRules(replace(rules, masks=None))
        if masking.posing is not None:
            return masking, masking.posing
    else:
        masking = masking_of(log, rules, poses, choice.wanted or None)
    return masking, Posing.of(log, poses, choice, masking.rules, need=Need.ALL)


def _body(topic: str, frame: str, masks: list[Mask], step: float) -> Finding:
    sectors = [mask.shape for mask in masks if isinstance(mask.shape, Sector)]
    beams = sum(round((one.end - one.begin) / step) for one in sectors) if step else 0
    nearest, farthest = min(one.nearest for one in sectors), max(one.farthest for one in sectors)
    words = f"{counted(beams, 'beam')} at {nearest:.2f} to {farthest:.2f} m never change"
    return Finding(
        "body",
        "warning",
        topic,
        frame,
        f"{topic}: {words}: the robot's own body?",
        {"beams": beams, "nearest": nearest, "farthest": farthest},
        {"beams": 1},
        Fix("mask", mask_text(Masks(tuple(masks)), Masks())),
    )


# --- samples of the sweeps ----------------------------------------------------------------------------------


class _Sensor:
    """Samples and counts of one topic and frame."""

    def __init__(self, topic: str, frame: str, path: CheckedPath | None, told: Way | None, delay: float) -> None:
        self.topic, self.frame, self.told, self.asked_delay = topic, frame, told, delay
        self.path = path or CheckedPath("none")
        self.delay = delay + (0.0 if self.path.fit is None else self.path.fit.delay)
        """Time after the header stamp at which poses fit the sweeps by their steps [s]."""
        self.step = 0.0
        self.flicker = _Flicker()
        self._every, self._moves = 1, 0
        self._last: tuple[float, float, float] | None = None
        self.turned = 0.0
        """Turn of the sensor in all [rad]."""
        self._begun = 0
        self._kept: list[tuple[int, int, Float64, Float64]] = []
        """Number of the move, stamp [ns], bearings and ranges of a sweep."""
        self._times: tuple[float, float] | None = None
        self._first_ns = self._last_ns = 0

    @property
    def assumes(self) -> bool:
        """True where the log does not tell of a mount."""
        return self.told is not None and bool(self.told.assumption)

    @property
    def times(self) -> tuple[float, float]:
        """Times of the first and of the last beam after the header stamp [s]."""
        return self._times or (0.0, 0.0)

    @property
    def period(self) -> float:
        """Mean time from sweep to sweep [s]."""
        return max(self._last_ns - self._first_ns, 0) / SECOND_NS / max(self._begun - 1, 1)

    @property
    def stood(self) -> bool:
        """True where nothing tells that the sensor moved."""
        return self._moves < STANDING_SWEEPS

    def add(self, batch: SweepBatch) -> None:
        """Take sweeps."""
        self.step = self.step or abs(float(batch.angle_increment[0]))
        self.flicker.add(batch)
        rows = [row for row in range(len(batch)) if self._begun + row < STANDING_SWEEPS]
        numbers = [-1] * len(rows)
        self._begun += len(batch)
        for row in self._moved(batch):
            if self._moves % self._every == 0:
                rows.append(row)
                numbers.append(self._moves)
            self._moves += 1
        if self._times is None:
            self._times = tuple(float(np.median(times)) for times in self.path.timing.of(batch))  # type: ignore[assignment]
            self._first_ns = int(batch.stamp_ns[0])
        self._last_ns = int(batch.stamp_ns[-1])
        for number, row in zip(numbers, rows, strict=True):
            bearing = batch.angle_min[row] + batch.angle_increment[row] * np.arange(batch.beams[row])
            ranges = batch.ranges[row, : batch.beams[row]].astype(np.float64)
            self._kept.append((number, int(batch.stamp_ns[row]), bearing, ranges))
            if len(self._kept) > MOST_SWEEPS:
                self._every *= 2
                self._kept = [one for one in self._kept if one[0] < 0 or one[0] % self._every == 0]

    def _moved(self, batch: SweepBatch) -> Iterator[int]:
        way = self.path.way or self.told
        if way is None:
            return
        there = planar(way.at(batch.stamp_ns))
        for row, (x, y, yaw) in enumerate(zip(there.x.tolist(), there.y.tolist(), there.yaw.tolist(), strict=True)):
            if not math.isfinite(x + y + yaw):
                continue
            if self._last is not None:
                turn = math.remainder(yaw - self._last[2], TURN)
                if math.hypot(x - self._last[0], y - self._last[1]) < MOVED and abs(turn) < TURNED:
                    continue
                self.turned += abs(turn)
                yield row
            self._last = x, y, yaw

    def outlines(self) -> Outlines:
        """Return the points of the sampled sweeps."""
        kept = sorted({one[1]: one for one in self._kept}.values(), key=lambda one: one[1])
        points, normals, slots = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros(0, np.int64)]
        for number, (_, _, bearing, ranges) in enumerate(kept):
            where, normal, beam = surfaces(bearing, ranges)
            if len(beam) > MOST_POINTS:
                some = np.linspace(0, len(beam) - 1, MOST_POINTS).astype(int)
                where, normal, beam = where[some], normal[some], beam[some]
            points.append(where)
            normals.append(normal)
            slots.append(number * SLOTS + (beam * SLOTS) // max(len(ranges), 1))
        stamp = np.repeat(np.array([one[1] for one in kept], np.int64), SLOTS)
        share = np.tile((np.arange(SLOTS) + 0.5) / SLOTS, len(kept))
        return Outlines(np.vstack(points), np.vstack(normals), np.concatenate(slots), stamp, share)

    def turns(self) -> tuple[Float64, Float64]:
        """Return turns of the told poses and those seen, of steps that turn enough (K,) [rad]."""
        if self.told is None or not len(self.path.stamp_ns):
            return np.zeros(0), np.zeros(0)
        told, mirrored = _told_at(self.told, self.path.stamp_ns)
        matched = self.path.matched * ([1.0, -1.0, -1.0] if mirrored else [1.0, 1.0, 1.0])
        seconds = (self.path.stamp_ns - self.path.stamp_ns[0]) / SECOND_NS
        begin, end = pairs_of(seconds, matched, told)
        same = self.path.pieces[begin] == self.path.pieces[end]
        begin, end = begin[same], end[same]
        seen = steps_between(matched[begin], matched[end])[:, 2]
        turn = steps_between(told[begin], told[end])[:, 2]
        large = np.maximum(np.abs(seen), np.abs(turn)) > LARGE_TURN
        return turn[large], seen[large]

    def related(self) -> tuple[float, int]:
        """Return the correlation of turns that poses tell with those seen, NaN of too few, and the number of turns."""
        turn, seen = self.turns()
        if len(turn) < LEAST_TURNS:
            return math.nan, len(turn)
        # About 0, not about the mean: a robot may turn to one side only.
        return float((turn * seen).sum() / np.sqrt((turn**2).sum() * (seen**2).sum())), len(turn)


def _told_at(way: Way, stamp_ns: Int64) -> tuple[Float64, bool]:
    """Return told poses (K, 3), and whether the sensor hangs head down."""
    there = planar(way.at(stamp_ns))
    known = np.isfinite(there.x)
    hangs = np.count_nonzero(there.upside_down & known) * 2 > np.count_nonzero(known)
    return np.column_stack([there.x, there.y, there.yaw]), bool(hangs)


def _mirrored(sensor: _Sensor) -> list[Finding]:
    """Return the finding that a sensor sees turns the other way round than poses tell."""
    related, turns = sensor.related()
    if not related < MIRRORED:
        return []
    return [
        Finding(
            "mirror",
            "error",
            sensor.topic,
            sensor.frame,
            f"{sensor.topic} turns the other way than its poses ({counted(turns, 'turn')}): its beams run the wrong way "
            "round, or the sensor hangs head down and tf does not say so",
            {"correlation": round(related, 3), "turns": turns},
            {"correlation": MIRRORED},
        )
    ]


# --- the mount, and the time of the poses -------------------------------------------------------------------


@dataclass(frozen=True, eq=False, slots=True)
class _Calibrated:
    """The mount and the delay by the sweeps of one sensor."""

    told: Float64
    """(3,) x, y [m], yaw [rad] of the mount that the log tells."""
    parent: str
    turned: float
    """Turning of the poses in all [rad]."""
    outlines: Outlines
    base: Callable[[float, float], Float64]
    """Poses (K, 3) of what carries the sensor, by the times of the first beam and from it to the last [s]."""
    start: Float64
    """(7,) unknowns of `settled` by the log alone."""
    trusted: Float64
    """(7,) their deviations."""
    stretch: Int64
    settled: Settled | None = None
    """x, y, yaw, times of the first beam and from it to the last, scales of lengths and turns."""
    cells: tuple[int, int] = 0, 0
    """Cells that are filled with the mount of the log, and with the one found."""

    @property
    def differs(self) -> bool:
        """True where the mount is known, and not the one that the log tells."""
        if self.settled is None or self.cells[1] >= self.cells[0]:
            return False
        deviation = _floored(self.settled.deviations[:3])
        return _is_known(deviation) and _differs(self.settled.values[:3] - self.told, deviation)

    def placing(self, values: Float64) -> Float64:
        """Return the poses of the sensor by the unknowns of `settled`."""
        base = self.base(float(values[3]), float(values[4]))
        return mounted(scaled_path(base, values[5], values[6]), values[:3])


def _split(way: Way) -> tuple[tuple[Step, ...], tuple[Step, ...], str]:
    """Return the steps of a way that mount the sensor, the others, and the frame between them."""
    count = next((k for k, step in enumerate(way.steps) if not step.track.static), len(way.steps))
    first = way.steps[min(count, len(way.steps) - 1)]
    return way.steps[:count], way.steps[count:], first.source or first.track.topic.strip("/")


def _based(sensor: _Sensor) -> _Calibrated | None:
    """Return what is known of the mount of a sensor before its sweeps are aligned; None without poses that move."""
    if sensor.told is None:
        return None
    mount, rest, parent = _split(sensor.told)
    if not rest:
        return None
    outlines = sensor.outlines()
    base = planar(along(rest, outlines.stamp_ns))
    reached = np.flatnonzero(np.isfinite(base.x))
    if len(reached) < 2:
        return None
    outlines = outlines.those(reached)

    @lru_cache(4)
    def poses(first: float, lasts: float) -> Float64:
        at_ns = outlines.stamp_ns + np.rint((first + lasts * outlines.share) * SECOND_NS).astype(np.int64)
        there = planar(along(rest, at_ns, held=True))
        return np.column_stack([there.x, there.y, there.yaw])

    here = planar(along(mount, np.zeros(1, np.int64)))
    if here.upside_down[0] or base.upside_down[reached[0]]:
        return None
    told = np.array([here.x[0], here.y[0], here.yaw[0]])
    path = poses(0.0, 0.0)
    turned = float(np.abs(wrapped(np.diff(path[:, 2]))).sum())
    stretch = stretches_of(path, *(DRIFTING if of_one_run(sensor.told.world) else FIXED))
    first, last = sensor.times
    start = np.array([*told, sensor.delay + first, last - first, 0.0, 0.0])
    is_known = sensor.path.timing.order != AUTO or last != first
    lasts = (KNOWN_TIME if is_known else 0.5) * sensor.period
    trusted = np.array([np.inf, np.inf, np.inf, max(DELAYS, 2.0 * abs(sensor.delay)), lasts, SCALES, SCALES])
    return _Calibrated(told, parent, turned, outlines, poses, start, trusted, stretch)


def _calibrated(sensor: _Sensor) -> _Calibrated | None:
    """Find the mount and the delay of the poses by the sweeps of a sensor; None where poses tell nothing of it."""
    based = _based(sensor)
    fit = sensor.path.fit
    if based is None or based.turned < LEAST_TURN or sensor.stood or fit is None:
        return based
    # Where steps disagree, more than a mount is wrong.
    if fit.verdict not in ("accepted", "corrected") or fit.share < ACCEPTED:
        return based
    starts = [based.start]
    guess = _hand_eye(sensor)
    if guess is not None and (np.abs(guess - based.told) > NEARBY).any():
        starts.append(np.concatenate([guess, based.start[3:]]))
    found = [settle(based.outlines, based.placing, start, based.trusted, based.stretch) for start in starts]
    filled = [cells_filled(based.outlines, based.placing(one.values), based.stretch) for one in found]
    best = int(np.argmin(filled))
    if not _differs(found[best].values[:3] - based.told, _floored(found[best].deviations[:3])):
        return replace(based, settled=found[best], cells=(filled[best], filled[best]))
    trusted = np.concatenate([np.zeros(3), based.trusted[3:]])
    fixed = settle(based.outlines, based.placing, based.start, trusted, based.stretch)
    before = cells_filled(based.outlines, based.placing(fixed.values), based.stretch)
    return replace(based, settled=found[best], cells=(before, filled[best]))


def _hand_eye(sensor: _Sensor) -> Float64 | None:
    """Return the mount by the steps of the matched path beside those of the poses; None where there are too few."""
    assert sensor.told is not None
    rest = _split(sensor.told)[1]
    at_ns = sensor.path.stamp_ns + round(sensor.delay * SECOND_NS)
    there = planar(along(rest, at_ns))
    told = np.column_stack([there.x, there.y, there.yaw])
    return _mount_by_steps(sensor.path, told)


def _mount_by_steps(path: CheckedPath, carrier: Float64) -> Float64 | None:
    seconds = (path.stamp_ns - path.stamp_ns[0]) / SECOND_NS
    begin, end = pairs_of(seconds, path.matched, carrier)
    same = path.pieces[begin] == path.pieces[end]
    begin, end = begin[same], end[same]
    if len(begin) < LEAST_TURNS:
        return None
    return np.array(
        mount_between(steps_between(path.matched[begin], path.matched[end]), steps_between(carrier[begin], carrier[end]))
    )


def _mount_finding(sensor: _Sensor, found: _Calibrated | None) -> tuple[list[Finding], list[Mount]]:
    if found is None or found.settled is None:
        return _untold(sensor, found), []
    if not found.differs:
        return [], []
    deviation = _floored(found.settled.deviations[:3])
    mount = _mount(sensor.frame, found.parent, found.settled.values)
    says = "without a mount it is taken to be at" if sensor.assumes else "tf says"
    return [
        Finding(
            "mount",
            "warning",
            sensor.topic,
            sensor.frame,
            f"{_sits(mount, deviation)}; {says} {_place(found.told)}",
            _mount_evidence(mount, deviation, found.told)
            | {"cells_told": found.cells[0], "cells": found.cells[1], "turned": round(found.turned, 3)},
            {"distance": LEAST_OFF, "yaw": round(float(LEAST_ASKEW), 4), "deviations": DEVIATIONS},
            _fix(mount),
        )
    ], [mount]


def _mount(frame: str, parent: str, values: Float64) -> Mount:
    x, y = (round(float(one), 4) for one in values[:2])
    return Mount(frame, parent, x, y, round(math.remainder(float(values[2]), TURN), 4))


def _untold(sensor: _Sensor, found: _Calibrated | None) -> list[Finding]:
    """Return a hint where poses move, but turn too little to tell the mount."""
    if found is None or sensor.stood or found.turned >= LEAST_TURN:
        return []
    turned = math.degrees(found.turned)
    return [
        Finding(
            "mount",
            "hint",
            sensor.topic,
            sensor.frame,
            f"mount of {sensor.frame or sensor.topic}: cannot be told: the poses turn by {turned:.0f} degrees, and "
            f"{math.degrees(LEAST_TURN):.0f} are needed",
            {"turned": round(found.turned, 3)},
            {"turned": round(LEAST_TURN, 3)},
        )
    ]


def _floored(deviations: Float64) -> Float64:
    return np.maximum(deviations, [LEAST_DEVIATION, LEAST_DEVIATION, LEAST_UNSURE])


def _is_known(deviation: Float64) -> bool:
    return bool(deviation[:2].max() < MOST_DEVIATION and deviation[2] < MOST_UNSURE)


def _differs(off: Float64, deviation: Float64) -> bool:
    least = np.array([LEAST_OFF, LEAST_OFF, LEAST_ASKEW])
    off = np.array([*off[:2], *wrapped(off[2:])])
    return bool((np.abs(off) > np.maximum(DEVIATIONS * deviation, least)).any())


def _place(pose: Float64) -> str:
    x, y, yaw = pose
    return f"x {x + 0.0:.2f} m, y {y + 0.0:.2f} m, yaw {math.degrees(yaw) + 0.0:.1f} degrees"


def _sits(mount: Mount, deviation: Float64) -> str:
    dx, dy, dyaw = deviation
    return (
        f"{mount.frame or 'the sensor'} sits at x {mount.x:.2f} +- {dx:.2f} m, y {mount.y:.2f} +- {dy:.2f} m, yaw "
        f"{math.degrees(mount.yaw):.1f} +- {math.degrees(dyaw):.1f} degrees in {mount.parent}"
    )


def _mount_evidence(mount: Mount, deviation: Float64, told: Float64 | None) -> dict[str, float]:
    names = ("x", "y", "yaw")
    found = {name: getattr(mount, name) for name in names}
    found |= {f"sd_{name}": round(float(one), 4) for name, one in zip(names, deviation, strict=True)}
    if told is not None:
        found |= {f"told_{name}": round(float(one), 4) for name, one in zip(names, told, strict=True)}
    return found


def _fix(mount: Mount) -> Fix | None:
    if not mount.frame or not mount.parent:
        return None
    return Fix("transform", transform_lines(mount.parent, mount.frame, mount.x, mount.y, mount.yaw))


def _stamp_finding(sensor: _Sensor, found: _Calibrated | None) -> list[Finding]:
    """Return the finding that header stamps are those of the middle or of the last beam, where the sweeps tell."""
    first, last = sensor.times
    duration = abs(last - first)
    if found is None or found.settled is None or not _is_known(found.settled.deviations[:3]) or not duration:
        return []
    values, covariance = found.settled.values, found.settled.covariance
    # The beam that is sent first is the last one of the sweep where they run backwards.
    both = np.zeros(len(values))
    both[3] = 1.0
    both[4] = float(last < first)
    begin, deviation = float(both @ values), math.sqrt(max(float(both @ covariance @ both), 0.0))
    begin -= sensor.asked_delay + min(first, last)
    share = -begin / duration
    name = min(_STAMPED, key=lambda one: abs(_STAMPED[one] - share))
    off = abs(_STAMPED[name] - share)
    unsure = max(deviation / duration, LEAST_TIME)
    if name == "first" or DEVIATIONS * unsure > 0.5 or off > max(STAMP_OFF, 2.0 * unsure):
        return []
    delay = sensor.asked_delay - _STAMPED[name] * duration
    return [
        Finding(
            "stamp",
            "warning",
            sensor.topic,
            sensor.frame,
            f"{sensor.topic}: header stamps are those of the {name} beam, not of the first one: the first is sent "
            f"{-begin:.3f} +- {deviation:.3f} s earlier, and a sweep takes {duration:.3f} s",
            {"delay": round(begin, 4), "sd_delay": round(deviation, 4), "duration": round(duration, 4)},
            {"share": STAMP_OFF, "deviations": DEVIATIONS},
            Fix("option", f"--pose-delay {delay:.3f}"),
        )
    ]


def _fit_finding(sensor: _Sensor, found: _Calibrated | None) -> list[Finding]:
    """Return the finding that the matched path fills far fewer cells than the told one, whose steps do not agree."""
    path = sensor.path
    if found is None or path.fit is None or path.fit.verdict == "unchecked" or path.follows_told or sensor.stood:
        return []
    values = found.settled.values if found.differs and found.settled is not None else found.start
    told = mounted(found.base(float(values[3]), float(values[4])), values[:3])
    first, last = sensor.times
    at_ns = found.outlines.stamp_ns + (first + (last - first) * found.outlines.share) * SECOND_NS
    matched = _matched_at(path, at_ns)
    known = np.flatnonzero(np.isfinite(matched[:, 0]))
    if len(known) < LEAST_STEPS * SLOTS:
        return []
    outlines = found.outlines.those(known)
    cells, fewer = cells_filled(outlines, told[known]), cells_filled(outlines, matched[known])
    if fewer > (1.0 - FEWER) * cells:
        return []
    return [
        Finding(
            "pose_fit",
            "warning",
            sensor.topic,
            sensor.frame,
            f"{sensor.topic}: the path that is matched from the sweeps fills {1.0 - fewer / cells:.0%} fewer cells than "
            f"that of {sensor.told.topics[0] if sensor.told else 'its poses'}: its poses are wrong",
            {"cells_told": cells, "cells_matched": fewer, "fewer": round(1.0 - fewer / cells, 3)},
            {"fewer": FEWER},
            Fix("option", "--pose match"),
        )
    ]


def _matched_at(path: CheckedPath, at_ns: Float64) -> Float64:
    """Return the matched poses (K, 3) at stamps (K,), NaN away from sweeps that have one, in the longest piece."""
    known = np.isfinite(path.matched[:, 0])
    if not known.any():
        return np.full((len(at_ns), 3), np.nan)
    pieces, counts = np.unique(path.pieces[known], return_counts=True)
    mine = known & (path.pieces == pieces[counts.argmax()])
    stamps, poses = path.stamp_ns[mine].astype(np.float64), path.matched[mine]
    poses = np.column_stack([poses[:, :2], np.unwrap(poses[:, 2])])
    found = np.column_stack([np.interp(at_ns, stamps, one) for one in poses.T])
    after = np.clip(np.searchsorted(stamps, at_ns), 1, max(len(stamps) - 1, 1))
    wide = np.full(len(at_ns), True) if len(stamps) < 2 else stamps[after] - stamps[after - 1] > LONGEST_STEP * SECOND_NS
    found[wide | (at_ns < stamps[0]) | (at_ns > stamps[-1])] = np.nan
    return found


# --- a second laser -----------------------------------------------------------------------------------------


def _lasers_findings(
    first: _Sensor, second: _Sensor, found: _Calibrated | None, told: Float64 | None
) -> tuple[list[Finding], list[Mount]]:
    """Return what is told of the place of a second laser beside the first one.

    Parameters
    ----------
    found : the mount of the first one, where it was found
    told : (3,) x, y [m], yaw [rad] of the second in the frame of the first that the log tells; None for nothing
    """
    beside = _standing(first, second) if first.stood and second.stood else _driving(first, second, found, told)
    if isinstance(beside, str):
        return [_no_lasers(first, second, beside)], []
    floor = np.array([LEAST_DEVIATION, LEAST_DEVIATION, LEAST_UNSURE]) * (3.0 if first.stood else 1.0)
    deviation = np.maximum(beside.deviations[:3], floor)
    if not _is_known(deviation):
        return [_no_lasers(first, second, "they see too little alike")], []
    if told is not None and not _differs(beside.values[:3] - told, deviation):
        return [], []
    parent, carrier = first.frame, np.zeros(3)
    carried = None if second.told is None or second.assumes else _split(second.told)[2]
    if found is not None and carried == found.parent:
        # The transform to mend is that to the robot.
        parent = found.parent
        carrier = found.settled.values[:3] if found.differs and found.settled is not None else found.told
    mount = _mount(second.frame, parent, mounted(carrier[None], beside.values[:3])[0])
    place = _mount(second.frame, first.frame, beside.values)
    says = "nothing in the log tells so" if told is None else f"tf says {_place(told)}"
    return [
        Finding(
            "lasers",
            "hint" if told is None else "warning",
            second.topic,
            second.frame,
            f"{_sits(place, deviation)}; {says}",
            _mount_evidence(place, deviation, told),
            {"distance": LEAST_OFF, "yaw": round(float(LEAST_ASKEW), 4), "deviations": DEVIATIONS},
            _fix(mount),
        )
    ], [mount]


def _no_lasers(first: _Sensor, second: _Sensor, why: str) -> Finding:
    return Finding(
        "lasers", "hint", second.topic, second.frame, f"{second.topic} beside {first.topic}: cannot be told: {why}"
    )


def _driving(first: _Sensor, second: _Sensor, found: _Calibrated | None, told: Float64 | None) -> Settled | str:
    """Place both lasers by the path of the first, and find where the second is by the map of both."""
    way = first.path.way
    if way is None or (found is not None and found.settled is None and found.turned < LEAST_TURN):
        return "the robot turns too little" if way is not None else "nothing tells how the robot drove"
    parts = [first.outlines(), second.outlines()]
    paths = [_way_at(way, part.stamp_ns, 0.0) for part in parts]
    known = [np.flatnonzero(np.isfinite(path[:, 0])) for path in paths]
    parts = [part.those(one) for part, one in zip(parts, known, strict=True)]
    if min(len(part.stamp_ns) for part in parts) < LEAST_STEPS * SLOTS:
        return "too few of their sweeps have a pose"
    outlines = joined_outlines(parts)
    here = paths[0][known[0]]

    def placing(values: Float64) -> Float64:
        there = _way_at(way, parts[1].stamp_ns, float(values[3]))
        # Nothing is known beyond the ends of the path, nor in its gaps.
        there = np.where(np.isnan(there), paths[1][known[1]], there)
        return np.vstack([here, mounted(there, values[:3])])

    both = np.vstack([here, paths[1][known[1]]])
    order = np.argsort(outlines.stamp_ns, kind="stable")
    turned = float(np.abs(wrapped(np.diff(here[:, 2]))).sum())
    if turned < LEAST_TURN:
        return f"the robot turns by {math.degrees(turned):.0f} degrees, and {math.degrees(LEAST_TURN):.0f} are needed"
    stretch = np.empty(len(both), np.int64)
    stretch[order] = stretches_of(both[order], *(DRIFTING if of_one_run(way.world) else FIXED))
    starts = [] if told is None else [told]
    if len(second.path.stamp_ns):
        guess = _mount_by_steps(second.path, _way_at(way, second.path.stamp_ns, 0.0))
        starts += [] if guess is None else [guess]
    if not starts:
        return "their paths cannot be matched"
    trusted = np.array([np.inf, np.inf, np.inf, LASER_DELAYS])
    tried = [settle(outlines, placing, np.array([*start, 0.0]), trusted, stretch) for start in starts]
    return min(tried, key=lambda one: cells_filled(outlines, placing(one.values), stretch))


def _way_at(way: Way, stamp_ns: Int64, delay: float) -> Float64:
    there = planar(way.at(stamp_ns + round(delay * SECOND_NS)))
    return np.column_stack([there.x, there.y, there.yaw])


def _standing(first: _Sensor, second: _Sensor) -> Settled | str:
    """Lay what the second laser sees on what the first one sees, while both stand."""
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
        found = settle(outlines, placing, start, np.full(3, np.inf), stretch)
        alike = overlap(parts[0].points, parts[1].points, found.values)
        tried.append((alike.share - AGAINST * alike.against, alike, found))
    tried.sort(key=lambda one: -one[0])
    best, alike, found = tried[0]
    if alike.share < LEAST_OVERLAP or alike.against > MOST_AGAINST or alike.width < LEAST_WIDTH:
        return "they see too little alike while they stand"
    if any(one[0] > best - CLEARLY for one in tried[1:] if not _is_near(one[2], found)):
        return "what they see fits in two places"
    return found


def _is_near(one: Settled, other: Settled) -> bool:
    off = one.values[:3] - other.values[:3]
    return bool(math.hypot(off[0], off[1]) < 0.2 and abs(math.remainder(off[2], TURN)) < NEARBY)


# --- beams that flicker -------------------------------------------------------------------------------------


class _Flicker:
    """Counts of beams and of their changes between valid and no return, by sectors of 30 degrees."""

    def __init__(self) -> None:
        self.sectors = round(TURN / SECTOR)
        self.steps, self.changes, self.valid, self.beams = (np.zeros(self.sectors) for _ in range(4))
        self.sweeps = 0
        self._last: UInt8 | None = None

    def add(self, batch: SweepBatch) -> None:
        """Take sweeps."""
        bearing = batch.angle_min[0] + batch.angle_increment[0] * np.arange(batch.width)
        if (batch.angle_min != batch.angle_min[0]).any() or (batch.beams != batch.width).any():
            # Beams of other sweeps look elsewhere.
            same = (batch.angle_min == batch.angle_min[0]) & (batch.beams == batch.width)
            batch = batch.rows(np.flatnonzero(same))
            if not len(batch):
                return
        sector = np.floor((bearing + 0.5 * SECTOR) % TURN / SECTOR).astype(np.int64) % self.sectors
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
            sums += np.bincount(sector, one.sum(axis=0), self.sectors)
        self.sweeps += len(batch)


_SEEING = (Status.VALID, Status.NO_RETURN, Status.TOO_CLOSE, Status.INVALID)


def _flickering(sensor: _Sensor) -> list[Finding]:
    """Return the findings on sectors that flicker, and on those that are always lost though the sensor turned."""
    counts = sensor.flicker
    if counts.sweeps <= LEAST_STEPS:
        return []
    found = []
    enough = counts.steps >= LEAST_STEPS * LEAST_BEAMS
    # Of each two changes of a beam that flickers one is back.
    share = 2.0 * counts.changes / np.maximum(counts.steps, 1.0)
    if (flickers := np.flatnonzero(enough & (share > FLICKERS))).size:
        worst = float(share[flickers].max())
        found.append(
            _sectors(
                sensor,
                flickers,
                f"change between valid and no return in up to {worst:.0%} of the steps from sweep to sweep",
                {"changes": round(worst, 3)},
                {"changes": FLICKERS},
            )
        )
    valid = counts.valid / np.maximum(counts.beams, 1.0)
    sees = counts.beams >= LEAST_BEAMS * counts.sweeps
    lost = np.flatnonzero(sees & (counts.valid == 0))
    others = valid[sees & (counts.valid > 0)]
    if len(lost) and len(others) and np.median(others) >= OTHERS_VALID and sensor.turned >= LEAST_TURN:
        found.append(
            _sectors(
                sensor,
                lost,
                f"never have a range, though the sensor turned by {math.degrees(sensor.turned):.0f} degrees",
                {"valid": 0.0, "others": round(float(np.median(others)), 3)},
                {"others": OTHERS_VALID},
            )
        )
    return found


def _sectors(
    sensor: _Sensor, sectors: Int64, words: str, evidence: dict[str, float], threshold: dict[str, float]
) -> Finding:
    middles = [round(math.degrees(math.remainder(one * SECTOR, TURN))) for one in sectors.tolist()]
    half = math.degrees(SECTOR) / 2.0
    places = ", ".join(f"{one - half:.0f} to {one + half:.0f}" for one in sorted(middles))
    return Finding(
        "flicker",
        "warning",
        sensor.topic,
        sensor.frame,
        f"{sensor.topic}: beams from {places} degrees {words}",
        {"sectors": sorted(middles), **evidence},
        threshold,
    )
