"""CARMEN logs (`.log`, `.clf`, `.gfs`, also packed with gzip): sweeps, poses, and the parameters that describe lasers."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import unreadable
from lidarcli.logs.base import LASERSCAN, PLANAR, PLANAR_POSE, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.blocks import as_singles, given_geometry, keep_sound, limits_in_metres, pad, pad_intensities, split_rows
from lidarcli.logs.carmen_lines import (
    CUT_AT,
    FRONT,
    LASERS,
    ODOM,
    OFFSETS,
    POSE,
    REAR,
    TRUEPOS,
    VIEW,
    CarmenLine,
    Laser,
    LineReader,
    has_pose,
)
from lidarcli.logs.cells import not_a_number, parse_rows
from lidarcli.logs.text import TextBlock, TextLog, TextSource
from lidarcli.sweeps.types import TURN, Float32, Float64, Int64, RawSweeps

ROBOT = "base_link"
ODOMETRY, CORRECTED, TRUE, MOUNTS = "/odom", "/corrected", "/truepos", "/tf_static"
TYPES = {
    ODOMETRY: "nav_msgs/msg/Odometry",
    CORRECTED: "geometry_msgs/msg/PoseStamped",
    TRUE: "geometry_msgs/msg/PoseStamped",
    MOUNTS: "tf2_msgs/msg/TFMessage",
}
"""Topic → its type. Poses are taken from the odometry unless the user asks for others."""
MAX_RANGE = 80.0
"""Greatest range [m] of a sweep whose line has none: SICK lasers write greater ones for no return.

The parameters `robot_front_laser_max` and `robot_rear_laser_max` are no such limit: they are the range up to which programs
of the robot used returns, and lines also hold what was measured beyond. A range of just this value is cut off.
"""

_STEPS = {181: 1.0, 180: 1.0, 361: 0.5, 360: 0.5, 401: 0.25, 400: 0.25}
"""Ranges → degrees from beam to beam of the SICK lasers that wrote logs without geometry."""
_ROUNDED = 6e-7
"""Greatest error [rad] of a step with six decimals."""
_SLACK = 1.5
"""Greatest difference between the number of ranges and that of view and step."""
_FARTHEST, _SAME, _ALIKE = 2.0, 1e-6, 0.01
"""Of a laser on its robot [m, rad]: greatest distance from the middle; greatest difference between its pose and that of the
robot that are one pose; and greatest change of its place, beyond which its pose has been corrected."""


class CarmenLog(TextLog):
    """A CARMEN log."""

    format = "carmen"
    _topics: list[Topic] | None = None
    _posed = False

    def topics(self) -> list[Topic] | None:
        """Return the topics by the first words of all lines, which are read once for it; None for a stream."""
        if self._topics is None and not self._once:
            with unreadable(self.path), Path(self.path).open("rb") as file:
                self._topics = self._count(TextSource(file, self.size).blocks())
        return self._topics

    def _count(self, blocks: Iterator[TextBlock]) -> list[Topic]:
        counts = dict.fromkeys((*LASERS, ODOM, TRUEPOS), 0)
        with_pose: set[bytes] = set()
        unsure = {word for word, laser in LASERS.items() if laser.posed}
        for block in blocks:
            for line in block.text.split(b"\n"):
                first = line[:17].split(None, 1)
                if not first or first[0] not in counts:
                    continue
                counts[first[0]] += 1
                if first[0] in unsure and has_pose(line, LASERS[first[0]]):
                    with_pose.add(first[0])
                    unsure.discard(first[0])
        self._posed = bool(with_pose)
        posed = sum(counts[word] for word in with_pose)
        scans = [Topic(each.topic, LASERSCAN, self.format, counts[word]) for word, each in LASERS.items() if counts[word]]
        poses = {ODOMETRY: posed or counts[ODOM], CORRECTED: posed, TRUE: counts[TRUEPOS]}
        topics = [*scans, *(Topic(name, TYPES[name], self.format, count) for name, count in poses.items() if count)]
        return [*topics, Topic(MOUNTS, TYPES[MOUNTS], self.format)] if scans and poses[ODOMETRY] else topics

    def _sweeps(
        self, blocks: Iterator[TextBlock], topics: Collection[str] | None, report: ReadReport
    ) -> Iterator[RawSweeps]:
        reader = LineReader(report, {word for word, one in LASERS.items() if topics is None or one.topic in topics})
        decoder = _SweepDecoder(self._options, report)
        for block in blocks:
            for word, lines in reader.read(block).items():
                for part in split_rows(np.array([line.beams for line in lines], np.int64)):
                    sweeps = decoder.decode(LASERS[word], lines[part])
                    if sweeps is not None:
                        yield sweeps

    def _poses(self, blocks: Iterator[TextBlock], types: Collection[str], report: ReadReport) -> Iterator[Message]:
        # Where sweeps hold the robot's poses, other lines of odometry are skipped.
        self.topics()
        reader = LineReader(report, {*LASERS, TRUEPOS, *([] if self._posed else [ODOM])})
        decoder = _PoseDecoder(report)
        for block in blocks:
            found = [each for word, lines in reader.read(block).items() for each in decoder.decode(word, lines)]
            for _, message in sorted(found, key=lambda one: one[0]):
                if message.type in types:
                    yield message
        if TYPES[MOUNTS] in types:
            yield from decoder.mounts(reader.parameters)


@dataclass(slots=True)
class _SweepDecoder:
    """Decodes the sweeps of a log in one pass."""

    options: OpenOptions
    report: ReadReport
    _noted: set[str] = field(default_factory=set)
    """Topics whose guessed bearings have been noted."""

    def decode(self, laser: Laser, lines: list[CarmenLine]) -> RawSweeps | None:
        """Return the sweeps of lines of one kind; None without any."""
        options, scale = self.options, self.options.range_scale
        beams = np.array([line.beams for line in lines], np.int64)
        number = np.float32 if scale == 1.0 else np.float64
        values = parse_rows([b" ".join(line.ranges) for line in lines], laser.width * beams, b" ", number)
        bad = values.bad
        declared: list[list[float]] = [[]] * len(lines)
        if laser.geometry:
            cells = [b" ".join(line.head[1:5]) for line in lines]
            numbers = parse_rows(cells, np.full(len(lines), 4), b" ", np.float64)
            declared, bad = numbers.values.reshape(-1, 4).tolist(), bad | numbers.bad
        for at, cell in sorted(bad.items()):
            self.report.add_damage(f"line {lines[at].number}", not_a_number(cell))
        good = np.ones(len(lines), np.bool_)
        good[list(bad)] = False
        ranges = pad(values.values[:: laser.width], beams, scale)
        if not laser.geometry:
            cut = np.array([line.parameters.get((laser.frame, CUT_AT), math.nan) for line in lines])
            ranges[ranges == as_singles(cut * scale)[:, None]] = np.inf
        geometry = [self._geometry(laser, line, numbers) for line, numbers in zip(lines, declared, strict=True)]
        first, step, most = np.array(geometry, np.float64).T
        options.used.add("range_max")
        least, greatest = limits_in_metres(np.zeros(len(lines)), most, scale)
        stamps = np.array([line.stamp_ns for line in lines], np.int64)
        block = RawSweeps(
            topic=laser.topic,
            frame_ids=(laser.frame,),
            frame=np.zeros(len(lines), np.int32),
            stamp_ns=stamps,
            record_ns=stamps,
            angle_min=first,
            angle_increment=step,
            range_min=least,
            range_max=greatest if options.range_max is None else as_singles(np.full(len(lines), options.range_max)),
            beams=beams.astype(np.int32),
            ranges=ranges,
            intensities=_remissions(laser, lines, beams, values.values),
        )
        return keep_sound(block, good, self.report)

    def _geometry(self, laser: Laser, line: CarmenLine, declared: list[float]) -> tuple[float, float, float]:
        """Return first bearing and step [rad] and greatest range [m] by options, the line or parameters."""
        options, most = self.options, MAX_RANGE
        given = given_geometry(options, line.beams)
        if laser.geometry:
            first, step = _bearings_of_line(line.beams, *declared[:3])
            most = declared[3] if declared[3] > 0 else MAX_RANGE
        else:
            fov, resolution = (line.parameters.get((laser.frame, name), math.nan) for name in VIEW)
            first, step, is_guessed = bearings_of(line.beams, fov, resolution)
            if is_guessed and given is None and laser.topic not in self._noted:
                self._noted.add(laser.topic)
                self.report.notes.append(
                    f"{laser.topic}: {line.beams} beams taken from {math.degrees(first):g} degrees by "
                    f"{math.degrees(step):.4g}: no bearings (--angle-min, --angle-increment)"
                )
        first, step = given or (first, step)
        return (
            first if options.angle_min is None else options.angle_min,
            step if options.angle_increment is None else options.angle_increment,
            most,
        )


def _remissions(laser: Laser, lines: list[CarmenLine], beams: Int64, ranges: NDArray[Any]) -> Float32 | None:
    """Return (S, B) remissions, which follow each of the `ranges`, or all of them with their number first; None without."""
    if laser.pairs:
        return pad(ranges[1::2], beams, 1.0) if len(ranges) else None
    if not laser.geometry:
        return None
    counts = [0 if (count := line.remissions) is None or count >= len(line.tail) else count for line in lines]
    few = np.minimum(counts, beams)
    parts = [b" ".join(line.tail[1 : 1 + count]) for line, count in zip(lines, few.tolist(), strict=True)]
    values = parse_rows(parts, few, b" ", np.float32).values
    return pad_intensities(np.split(values, np.cumsum(few)[:-1]), int(beams.max()))


def _bearings_of_line(beams: int, first: float, view: float, step: float) -> tuple[float, float]:
    """Return first bearing and step [rad] by those of a line; they are guessed where view and step are zero."""
    if view == 0.0 and step == 0.0:
        return bearings_of(beams, math.nan, math.nan)[:2]
    # The view has all the digits that a rounded step lacks: its part for each beam is the step where it is that of the
    # ranges, or of one more.
    parts = view / max(beams - 1, 1), view / max(beams, 1)
    nearest = min(parts, key=lambda part: abs(part - step))
    return first, nearest if abs(nearest - step) < _ROUNDED else step or parts[0]


@lru_cache(1024)
def bearings_of(beams: int, fov: float, resolution: float) -> tuple[float, float, bool]:
    """Return first bearing and step [rad] of a sweep whose line has none, and whether they are guessed.

    Parameters
    ----------
    fov, resolution : view and step by parameters [degrees], which count where they fit the number of beams; NaN without
    """
    fov, resolution = fov if fov > 0 else math.nan, resolution if resolution > 0 else math.nan
    gaps = max(beams - 1, 1)
    fits = not abs(fov / resolution - beams + 0.5) >= _SLACK
    by_step, by_view = math.isfinite(resolution) and fits, math.isfinite(fov) and fits
    if not by_step and not by_view:
        first = -50.0 if _STEPS.get(beams) == 0.25 else -90.0
        return math.radians(first), math.radians(_STEPS.get(beams, 180.0 / gaps)), True
    # 180 beams of a degree are those of half a turn without its last one.
    is_half = abs(beams * resolution - 180.0) < 1e-6
    view = fov if by_view else 180.0 if is_half else gaps * resolution
    step = resolution if by_step else view / (beams if beams in _STEPS and beams % 2 == 0 else gaps)
    return math.radians(-0.5 * view), math.radians(step), False


@dataclass(slots=True)
class _PoseDecoder:
    """Decodes the poses of robot and lasers in one pass."""

    report: ReadReport
    _first_ns: dict[str, int] = field(default_factory=dict)
    """Frame of each laser → stamp of its first sweep."""
    _mounts: dict[str, tuple[Float64, float]] = field(default_factory=dict)
    """Frame of a laser → its place on the robot by the first poses of both, and the greatest change since [m, rad]."""

    def decode(self, word: bytes, lines: list[CarmenLine]) -> list[tuple[int, Message]]:
        """Return the poses of lines with one first word, each with the number of its line."""
        if word in (ODOM, TRUEPOS):
            topic, world = (ODOMETRY, "odom") if word == ODOM else (TRUE, "world")
            some, poses = self._read([line for line in lines if len(line.tail) >= POSE], POSE)
            return _planar(topic, world, ROBOT, some, poses)
        laser = LASERS[word]
        self._first_ns.setdefault(laser.frame, lines[0].stamp_ns)
        if not laser.posed:
            return []
        for line in lines if laser.geometry else ():
            # Remissions and their number stand before the poses; old writers have left them out.
            if line.remissions is not None and line.remissions + 1 + 2 * POSE <= len(line.tail):
                line.tail = line.tail[line.remissions + 1 :]
        both, poses = self._read([line for line in lines if len(line.tail) >= 2 * POSE], 2 * POSE)
        self._compare(laser.frame, poses)
        found = _planar(CORRECTED, "map", laser.frame, both, poses[:, :POSE])
        found += _planar(ODOMETRY, "odom", ROBOT, both, poses[:, POSE:])
        # In logs of old writers no other line says where the robot was.
        alone, poses = self._read([line for line in lines if POSE <= len(line.tail) < 2 * POSE], POSE)
        return found + _planar(ODOMETRY, "odom", laser.frame, alone, poses)

    def _read(self, lines: list[CarmenLine], count: int) -> tuple[list[CarmenLine], Float64]:
        """Return the lines whose first `count` fields behind the ranges are numbers, and these (K, `count`)."""
        parts = [b" ".join(line.tail[:count]) for line in lines]
        numbers = parse_rows(parts, np.full(len(lines), count), b" ", np.float64)
        for at, cell in sorted(numbers.bad.items()):
            self.report.add_damage(f"line {lines[at].number}", "its pose: " + not_a_number(cell))
        good = [at for at in range(len(lines)) if at not in numbers.bad]
        return [lines[at] for at in good], numbers.values.reshape(-1, count)[good]

    def _compare(self, frame: str, poses: Float64) -> None:
        """Keep the place of a laser on its robot by poses (K, 6) of both, and how much it changes."""
        poses = poses[(np.abs(poses) < 1e9).all(axis=1)]
        if not len(poses):
            return
        dx, dy = poses[:, 0] - poses[:, 3], poses[:, 1] - poses[:, 4]
        cos, sin = np.cos(poses[:, 5]), np.sin(poses[:, 5])
        turn = wrapped(poses[:, 2] - poses[:, 5])
        mounts = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, turn])
        first, spread = self._mounts.get(frame, (mounts[0], 0.0))
        off = mounts - first
        off[:, 2] = wrapped(off[:, 2])
        far = float(np.abs(mounts[:, :2]).max()) > _FARTHEST
        self._mounts[frame] = first, np.inf if far else max(spread, float(np.abs(off).max()))

    def mounts(self, parameters: dict[tuple[str, str], float]) -> Iterator[Message]:
        """Yield the mounts of the lasers that had sweeps, once the whole log is read."""
        for frame, stamp_ns in self._first_ns.items():
            pose = self._mount(frame, [parameters.get((frame, name)) for name in OFFSETS])
            if pose is not None:
                yield _message(MOUNTS, ROBOT, frame, stamp_ns, pose)

    def _mount(self, frame: str, offsets: list[float | None]) -> Sequence[float] | None:
        """Return x, y [m] and yaw [rad] of a laser by parameters, else by the poses of laser and robot."""
        pose: list[float] | None = None
        if any(offset is not None for offset in offsets):
            pose = [offset or 0.0 for offset in offsets]
            # A rear laser looks backwards, unless its angle is given and says so itself.
            if frame == REAR and abs(pose[2]) < 0.5 * np.pi:
                pose[2] += np.pi
        place, spread = self._mounts.get(frame, (np.zeros(3), np.inf))
        # Where lines have one pose for both, whoever wrote them took no notice of the parameters.
        is_one = frame == FRONT and float(np.abs(place).max()) <= _SAME
        if spread <= _ALIKE and (pose is None or is_one):
            pose = list(place)
        return pose


def _planar(topic: str, parent: str, child: str, lines: list[CarmenLine], poses: Float64) -> list[tuple[int, Message]]:
    """Return poses (K, 3) of a child frame in its parent as messages, each with the number of its line."""
    pairs = zip(lines, poses.tolist(), strict=True)
    return [(line.number, _message(topic, parent, child, line.stamp_ns, pose)) for line, pose in pairs]


def _message(topic: str, parent: str, child: str, stamp_ns: int, pose: Sequence[float]) -> Message:
    """Return a pose x, y [m], yaw [rad] of a child frame in its parent as a message."""
    data = np.array((stamp_ns, *pose), PLANAR_POSE).tobytes() + f"{parent}\0{child}".encode()
    return Message(topic, TYPES[topic], PLANAR, stamp_ns, data)


def wrapped(angle: Float64) -> Float64:
    """Return angles [rad] between -π and π.

    >>> wrapped(np.array([6.0])).round(3).tolist()
    [-0.283]
    """
    within: Float64 = (angle + np.pi) % TURN - np.pi
    return within
