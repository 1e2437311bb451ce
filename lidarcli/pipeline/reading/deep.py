"""Findings that align sweeps: mounts, the times and the fit of told poses, the robot's own body, beams that flicker."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from lidarcli.display import counted
from lidarcli.errors import OptionError
from lidarcli.findings import Finding, Fix, transform_lines
from lidarcli.logs.base import Log, OpenOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.options import TopicChoice
from lidarcli.masks import Mask, Masks, Mount, Sector, same_name
from lidarcli.pipeline.inputs.masks import mask_text, mount_text
from lidarcli.pipeline.inputs.sources import Source, open_source
from lidarcli.pipeline.reading.masking import MOST_SENSORS, Masking, masking_of
from lidarcli.pipeline.reading.path_check import CheckedPath
from lidarcli.pipeline.reading.pose_sources import NONE, Need, PoseOptions
from lidarcli.pipeline.reading.posing import Posing
from lidarcli.poses.calibration import (
    Outlines,
    Settled,
    cells_filled,
    joined_outlines,
    mounted,
    place_beside,
    scaled_path,
    settle,
    stretches_of,
    surfaces,
)
from lidarcli.poses.fit import mount_between, pairs_of, steps_between, wrapped
from lidarcli.poses.matched import ONCE, SHORTEST_SWEEP, Timing
from lidarcli.poses.sources import Way
from lidarcli.poses.tracks import SECOND_NS, planar
from lidarcli.poses.tree import Step, along
from lidarcli.range_rules import RangeRules
from lidarcli.sweeps import TURN, Bool, Float64, Int64, Status, SweepBatch

MOST_SWEEPS, STANDING_SWEEPS = 600, 20
"""Most sweeps of a sensor that are aligned, and the first ones, which are taken though it stands."""
MOVED, TURNED = 0.02, 0.017
"""Others are taken after the sensor went so far [m] or turned so much [rad]."""
MOST_POINTS = 120
"""Points of a sweep that are aligned."""
SLOTS = 24
"""Parts of a sweep that takes time; each is placed by a pose of its own."""
STRETCH_TURN, STRETCH_WAY = np.pi, 15.0
"""Turn [rad] and way [m] of a stretch in which poses may not drift."""
LEAST_TURN = np.deg2rad(170.0)
"""Turning of the poses from which on they tell a mount [rad]: of the path that is told, also to and fro."""
NEARBY = 0.1
"""A mount by steps of the path that is no farther from the told one [m, rad] is found from there."""
DEVIATIONS, LEAST_OFF, LEAST_ASKEW = 3.0, 0.02, np.deg2rad(1.0)
"""A mount is told that is off by so many deviations and by this [m, rad]."""
MOST_DEVIATION, MOST_UNSURE = 0.05, np.deg2rad(2.0)
"""Deviations of a mount that is known well enough [m, rad]."""
LEAST_DEVIATION, LEAST_UNSURE = 0.003, np.deg2rad(0.1)
"""No mount is known better: grids and ranges err, too [m, rad]."""
TRUSTED = np.array([np.inf, np.inf, np.inf, 0.2, 0.02, 0.02])
"""Deviations of x, y [m], yaw [rad], the delay [s] and the scales of lengths and turns before the sweeps are seen."""
FEWER = 0.3
"""Share of cells that the matched path fills less."""
MIRRORED = -0.5
"""Correlation of told turns with those seen."""
LARGE_TURN, LEAST_TURNS = 0.08, 8
"""Turns that count [rad], and the fewest of them."""
STAMP_OFF = 0.15
"""Greatest distance of the delay from half or all of the time of a sweep, as a share of this."""
NEAR, SAME, OFTEN, FAR_CHANGES = 1.0, 0.06, 0.8, 0.5
"""A beam that ends nearer than this [m], within such a spread [m], in such a share of the sweeps never changes."""
SECTOR = np.deg2rad(30.0)
FLICKERS = 0.15
"""Share of the steps from sweep to sweep in which a beam changes between valid and no return."""
LEAST_STEPS = 20
"""Fewest steps that tell of a flicker."""
OTHERS_VALID = 0.5
"""Median share of valid beams of other sectors, where one has none."""
LEAST_OVERLAP = 0.5
"""Share of what the second sensor sees that has to be on what the first one sees, where both stand."""

Key = tuple[str, str]
"""Topic and frame."""


@dataclass(frozen=True, slots=True)
class DeepFindings:
    """Findings of a second look at a log, and what mends them."""

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
) -> DeepFindings:
    """Align sweeps of a log, in bounded memory, and return what they contradict.

    Raises
    ------
    OptionError
        The log can be read only once.
    """
    with open_source(source, opening) as log:
        if log.size is None:
            raise OptionError("--deep reads a log twice, and a pipe is read only once: give the file's name")
        return _Deep(log, rules or RangeRules(), poses or PoseOptions()).findings()


class _Deep:
    """A second look at one log."""

    def __init__(self, log: Log, rules: RangeRules, poses: PoseOptions) -> None:
        self._masking, self._posing = _masking(log, rules, poses)
        self._sees_poses = poses.source != NONE
        self._sensors: dict[Key, _Sensor] = {}
        for batch in read_batches(
            log, ReadOptions(rules=self._masking.rules), ReadReport(), TopicChoice(None, log.topics())
        ):
            for frame, _, mine in batch.by_frame():
                key = batch.topic, frame
                if key not in self._sensors:
                    if len(self._sensors) == MOST_SENSORS:
                        continue
                    self._sensors[key] = _Sensor(*key, self._posing.paths.get(key), self._told(frame))
                self._sensors[key].add(mine)

    def _told(self, frame: str) -> Way | None:
        if self._posing.found is None or not self._sees_poses:
            return None
        return self._posing.found.sources.way(frame)

    def findings(self) -> DeepFindings:
        """Return the findings of all rules."""
        found: list[Finding] = []
        mounts: list[Mount] = []
        bodies, masks = self._bodies()
        for key in sorted(self._sensors):
            found += _flickering(self._sensors[key])
        first: _Sensor | None = None
        for sensor in self._by_frame():
            if sensor.mirrors():
                found.append(_mirrored(sensor))
                continue
            if first is None:
                first = sensor
                calibrated = _calibrated(sensor)
                finding, mount = _mount_finding(sensor, calibrated)
                found += finding
                found += _stamp_finding(sensor, calibrated)
                found += _fit_finding(sensor, calibrated)
            else:
                finding, mount = _lasers_finding(first, sensor)
                found += finding
            mounts += mount
        order = ("pose_fit", "mirror", "stamp", "mount", "lasers", "body", "flicker")
        found = sorted([*found, *bodies], key=lambda one: (order.index(one.id), one.topic, one.frame))
        return DeepFindings(tuple(found), masks, tuple(mounts))

    def _by_frame(self) -> list[_Sensor]:
        """Return one sensor for each frame, the first of its topics."""
        found: dict[str, _Sensor] = {}
        for key in sorted(self._sensors):
            found.setdefault(key[1].lstrip("/"), self._sensors[key])
        return list(found.values())

    def _bodies(self) -> tuple[list[Finding], Masks]:
        """Return what is told of beams that end on the robot itself, and their mask."""
        found = []
        topics = {mask.topic for mask in self._masking.learned.masks}
        for key, sensor in sorted(self._sensors.items()):
            topic, frame = key
            mine = [mask for mask in self._masking.learned.masks if mask.topic == topic]
            if topic in topics and mine:
                topics.discard(topic)
                found.append(_body(topic, frame, mine, sensor.step))
            elif not mine and (beams := sensor.unchanging()) and sensor.stood:
                found.append(
                    Finding(
                        "body",
                        "hint",
                        topic,
                        frame,
                        f"{topic}: cannot be told: nothing moves ({counted(beams, 'beam')} below {NEAR:g} m)",
                        {"beams": beams},
                        {"beams": 1, "range": NEAR},
                    )
                )
        return found, self._masking.learned


def _masking(log: Log, rules: RangeRules, poses: PoseOptions) -> tuple[Masking, Posing]:
    """Learn the mask of the robot itself, where the user gave none; return it and the poses."""
    if rules.masks is None or rules.masks.learn:
        with_mask = replace(rules, masks=Masks(learn=True))
        try:
            masking = masking_of(log, with_mask, poses)
        except OptionError:
            masking = Masking(replace(rules, masks=None))
        if masking.posing is not None:
            return masking, masking.posing
    else:
        masking = masking_of(log, rules, poses)
    choice = TopicChoice(None, log.topics())
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

    def __init__(self, topic: str, frame: str, path: CheckedPath | None, told: Way | None) -> None:
        self.topic, self.frame, self.told = topic, frame, told
        self.path = path or CheckedPath("none")
        self.step = 0.0
        self.flicker = _Flicker()
        self._every, self._moves = 1, 0
        self._last: tuple[float, float, float] | None = None
        self._begun = 0
        self._kept: list[tuple[int, int, float, float, Float64, Float64]] = []
        """Number of the move, stamp [ns], times of the first and last beam [s], bearings and ranges of a sweep."""
        self._is_placed = self.path.way is not None or told is not None

    @property
    def timing(self) -> Timing:
        """Times at which the beams are sent."""
        return self.path.timing

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
        firsts, lasts = self.timing.of(batch)
        for number, row in zip(numbers, rows, strict=True):
            bearing = batch.angle_min[row] + batch.angle_increment[row] * np.arange(batch.beams[row])
            ranges = batch.ranges[row, : batch.beams[row]].astype(np.float64)
            self._kept.append(
                (number, int(batch.stamp_ns[row]), float(firsts[row]), float(lasts[row]), bearing, ranges)
            )
            if len(self._kept) > MOST_SWEEPS:
                self._every *= 2
                self._kept = [one for one in self._kept if one[0] < 0 or one[0] % self._every == 0]

    def _moved(self, batch: SweepBatch) -> Iterator[int]:
        way = self.path.way or self.told
        if way is None:
            return
        there = planar(way.at(batch.stamp_ns))
        for row, (x, y, yaw) in enumerate(
            zip(there.x.tolist(), there.y.tolist(), there.yaw.tolist(), strict=True)
        ):
            if not math.isfinite(x + y + yaw):
                continue
            if self._last is not None:
                turn = math.remainder(yaw - self._last[2], TURN)
                if math.hypot(x - self._last[0], y - self._last[1]) < MOVED and abs(turn) < TURNED:
                    continue
                yield row
            self._last = x, y, yaw

    def outlines(self, mirrored: bool = False) -> Outlines:
        """Return the points of the sampled sweeps."""
        kept = sorted({one[1]: one for one in self._kept}.values(), key=lambda one: one[1])
        points, normals, slots, stamps = [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros(0, int)], []
        count = 0
        for _, stamp_ns, first, last, bearing, ranges in kept:
            where, normal, beam = surfaces(bearing, ranges)
            if len(beam) > MOST_POINTS:
                some = np.linspace(0, len(beam) - 1, MOST_POINTS).astype(int)
                where, normal, beam = where[some], normal[some], beam[some]
            parts = SLOTS if abs(last - first) >= SHORTEST_SWEEP else 1
            part = (beam * parts) // max(len(ranges), 1)
            middle = first + (last - first) * (np.arange(parts) + 0.5) / parts
            points.append(where)
            normals.append(normal)
            slots.append(count + part)
            stamps.append(stamp_ns + np.rint(middle * SECOND_NS).astype(np.int64))
            count += parts
        stamp = np.concatenate(stamps) if stamps else np.zeros(0, np.int64)
        # In time order, also where the last beam is sent first.
        order = np.argsort(stamp, kind="stable")
        number = np.empty(len(order), np.int64)
        number[order] = np.arange(len(order))
        found = Outlines(np.vstack(points), np.vstack(normals), number[np.concatenate(slots)], stamp[order])
        return _mirror(found) if mirrored else found

    def unchanging(self) -> int:
        """Return the number of beams below `NEAR` that never change in the first sweeps."""
        first = [one for one in self._kept if one[0] < 0]
        if len(first) < LEAST_STEPS // 2 or len({len(one[5]) for one in first}) != 1:
            return 0
        ranges = np.stack([one[5] for one in first])
        known = np.isfinite(ranges)
        with np.errstate(invalid="ignore"):
            near = (ranges < NEAR).mean(axis=0) >= OFTEN
        low = np.array([np.quantile(column[seen], 0.1) if seen.any() else np.nan for column, seen in zip(ranges.T, known.T, strict=True)])
        high = np.array([np.quantile(column[seen], 0.9) if seen.any() else np.nan for column, seen in zip(ranges.T, known.T, strict=True)])
        with np.errstate(invalid="ignore"):
            return int(np.count_nonzero(near & (high - low < SAME)))

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

    def mirrors(self) -> bool:
        """True where the sensor sees turns the other way round than poses tell."""
        turn, seen = self.turns()
        if len(turn) < LEAST_TURNS:
            return False
        # About 0, not about the mean: a robot may turn to one side only.
        related = float((turn * seen).sum() / math.sqrt(float((turn**2).sum() * (seen**2).sum())))
        return related < MIRRORED


def _mirror(outlines: Outlines) -> Outlines:
    flip = np.array([1.0, -1.0])
    return replace(outlines, points=outlines.points * flip, normals=outlines.normals * flip)


def _told_at(way: Way, stamp_ns: Int64) -> tuple[Float64, bool]:
    """Return told poses (K, 3), and whether the sensor hangs head down."""
    there = planar(way.at(stamp_ns))
    known = np.isfinite(there.x)
    hangs = np.count_nonzero(there.upside_down & known) * 2 > np.count_nonzero(known)
    return np.column_stack([there.x, there.y, there.yaw]), bool(hangs)


def _mirrored(sensor: _Sensor) -> Finding:
    turn, seen = sensor.turns()
    related = float((turn * seen).sum() / math.sqrt(float((turn**2).sum() * (seen**2).sum())))
    return Finding(
        "mirror",
        "error",
        sensor.topic,
        sensor.frame,
        f"{sensor.topic} turns the other way than its poses ({counted(len(turn), 'turn')}): its beams run the wrong way "
        "round, or the sensor hangs head down and tf does not say so",
        {"correlation": round(related, 3), "turns": len(turn)},
        {"correlation": MIRRORED},
    )


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
    reached: Bool
    base: Callable[[float], Float64]
    """Poses (K, 3) of what carries the sensor, by their delay [s]."""
    stretch: Int64
    settled: Settled | None = None
    """x, y, yaw, delay, scales of lengths and turns."""
    cells: tuple[int, int] = 0, 0
    """Cells that are filled with the mount of the log, and with the one found."""

    def placing(self, values: Float64) -> Float64:
        """Return the poses of the sensor by the unknowns of `settled`."""
        return mounted(scaled_path(self.base(float(values[3])), values[4], values[5]), values[:3])


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

    def poses(delay: float) -> Float64:
        at_ns = outlines.stamp_ns + round(delay * SECOND_NS)
        there = planar(along(rest, at_ns, held=True))
        return np.column_stack([there.x, there.y, there.yaw])

    here = planar(along(mount, np.zeros(1, np.int64)))
    if here.upside_down[0] or base.upside_down[reached[0]]:
        return None
    told = np.array([here.x[0], here.y[0], here.yaw[0]])
    path = poses(0.0)
    turned = float(np.abs(wrapped(np.diff(path[:, 2]))).sum())
    stretch = stretches_of(path, STRETCH_TURN, STRETCH_WAY)
    return _Calibrated(told, parent, turned, outlines, reached >= 0, poses, stretch)


def _calibrated(sensor: _Sensor) -> _Calibrated | None:
    """Find the mount and the delay of the poses by the sweeps of a sensor; None where poses tell nothing of it."""
    based = _based(sensor)
    fit = sensor.path.fit
    if based is None or based.turned < LEAST_TURN or sensor.stood or fit is None:
        return based
    if fit.verdict in ("rejected", "unchecked", "stretches"):
        return based
    none = np.zeros(3)
    starts = [np.concatenate([based.told, [fit.delay, 0.0, 0.0]])]
    guess = _hand_eye(sensor, fit.delay)
    if guess is not None and (np.abs(guess - based.told) > NEARBY).any():
        starts.append(np.concatenate([guess, [fit.delay], none[:2]]))
    found = [
        settle(based.outlines, based.placing, start, _trusted(fit.delay), based.stretch) for start in starts
    ]
    filled = [cells_filled(based.outlines, based.placing(one.values), based.stretch) for one in found]
    best = int(np.argmin(filled))
    if not _differs(found[best].values[:3] - based.told, _floored(found[best].deviations[:3])):
        return replace(based, settled=found[best], cells=(filled[best], filled[best]))
    fixed = settle(
        based.outlines,
        based.placing,
        starts[0],
        np.concatenate([none, _trusted(fit.delay)[3:]]),
        based.stretch,
    )
    before = cells_filled(based.outlines, based.placing(fixed.values), based.stretch)
    return replace(based, settled=found[best], cells=(before, filled[best]))


def _trusted(delay: float) -> Float64:
    trusted = TRUSTED.copy()
    trusted[3] = max(trusted[3], 2.0 * abs(delay))
    return trusted


def _hand_eye(sensor: _Sensor, delay: float) -> Float64 | None:
    """Return the mount by the steps of the matched path beside those of the poses; None where there are too few."""
    assert sensor.told is not None
    rest = _split(sensor.told)[1]
    at_ns = sensor.path.stamp_ns + round(delay * SECOND_NS)
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
        mount_between(
            steps_between(path.matched[begin], path.matched[end]), steps_between(carrier[begin], carrier[end])
        )
    )


def _mount_finding(sensor: _Sensor, found: _Calibrated | None) -> tuple[list[Finding], list[Mount]]:
    if found is None or found.settled is None:
        return _untold(sensor, found), []
    deviation = _floored(found.settled.deviations[:3])
    off = found.settled.values[:3] - found.told
    if not _is_known(deviation):
        # Only who sees that it differs wants to know that it is not known.
        return [], []
    if not _differs(off, deviation) or found.cells[1] >= found.cells[0]:
        return [], []
    mount = Mount(
        sensor.frame, found.parent, *(round(float(one), 4) for one in [*found.settled.values[:2], wrapped(found.settled.values[2:3])[0]])
    )
    says = "tf says" if _split(sensor.told)[0] else "without a mount it is taken to be at"  # type: ignore[arg-type]
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


def _fix(mount: Mount) -> Fix:
    lines = transform_lines(mount.parent, mount.frame, mount.x, mount.y, mount.yaw)
    return Fix("transform", f"{lines}\n{mount_text(mount)}")


def _stamp_finding(sensor: _Sensor, found: _Calibrated | None) -> list[Finding]:
    return []


def _fit_finding(sensor: _Sensor, found: _Calibrated | None) -> list[Finding]:
    return []


def _lasers_finding(first: _Sensor, second: _Sensor) -> tuple[list[Finding], list[Mount]]:
    return [], []


# --- beams that flicker -------------------------------------------------------------------------------------


class _Flicker:
    """Counts of changes of status by sector."""

    def __init__(self) -> None:
        self.sectors = round(TURN / SECTOR)
        self.steps, self.changes, self.valid, self.beams = (np.zeros(self.sectors) for _ in range(4))
        self._last: SweepBatch | None = None

    def add(self, batch: SweepBatch) -> None:
        """Take sweeps."""


def _flickering(sensor: _Sensor) -> list[Finding]:
    return []
