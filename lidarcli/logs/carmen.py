"""CARMEN logs (`.log`, `.clf`, `.gfs`, also packed with gzip): sweeps, poses, and the parameters that describe lasers."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lidarcli.errors import unreadable
from lidarcli.logs.base import LASERSCAN, Message, OpenOptions, ReadReport, Topic
from lidarcli.logs.blocks import as_singles, given_geometries, given_geometry, keep_sound, limits_in_metres, pad, split_rows
from lidarcli.logs.carmen_lines import (
    FRONT,
    LASERS,
    ODOM,
    POSE,
    REAR,
    TRUEPOS,
    CarmenLines,
    Framing,
    Laser,
    LineBlock,
    count_in,
    has_pose,
    is_number,
)
from lidarcli.logs.numbers import Cells, not_a_number, pad_cells
from lidarcli.logs.planar import MOUNT_TYPE, MOUNTS, ODOMETRY, ODOMETRY_TYPE, POSE_TYPE, ROBOT, PlanarPoses, wrapped
from lidarcli.logs.text import TextBlock, TextLog, TextSource
from lidarcli.sweeps import Bool, Float32, Float64, Int64, RawSweeps

CORRECTED, TRUE = "/corrected", "/truepos"
TYPES = {ODOMETRY: ODOMETRY_TYPE, CORRECTED: POSE_TYPE, TRUE: POSE_TYPE, MOUNTS: MOUNT_TYPE}
"""Topic → its type. Poses are taken from the odometry unless the user asks for others."""
MAX_RANGE = 80.0
"""Greatest range [m] of a sweep whose line has none: SICK lasers write greater ones for no return.

The parameters `robot_front_laser_max` and `robot_rear_laser_max` are no such limit: they are the range up to which programs
of the robot used returns, and lines also hold what was measured beyond. A range of just this value is cut off.
"""
_GEOMETRY = 2
"""Cell with the first bearing; view, step and greatest range follow."""
_ROUNDED = 6e-7
"""Greatest error [rad] of a step with six decimals."""

_PARAMETERS = {
    (frame, what): pattern.format(name).encode()
    for frame, name in {FRONT: "front", REAR: "rear"}.items()
    for what, pattern in {
        "fov": "laser_{}_laser_fov",
        "resolution": "laser_{}_laser_resolution",
        "max": "robot_{}_laser_max",
        "forward": "robot_{}laser_offset",
        "side": "robot_{}laser_side_offset",
        "angular": "robot_{}laser_angular_offset",
    }.items()
}
"""Frame and quantity → name of the parameter. Views and steps are degrees, offsets metres and radians."""
_KNOWN = frozenset(_PARAMETERS.values())
_STARTS_NUMBER = re.compile(rb"[-+.\d]")

_STEPS = {181: 1.0, 180: 1.0, 361: 0.5, 360: 0.5, 401: 0.25, 400: 0.25}
"""Ranges → degrees from beam to beam of the SICK lasers that wrote logs without geometry."""
_WITHOUT_LAST = [beams for beams in _STEPS if beams % 2 == 0]
"""Those whose view ends one step beyond the last range."""
_FIRST = {401: -50.0, 400: -50.0}
"""Ranges → first bearing [degrees]; -90 for all others."""
_SLACK = 1.5
"""Greatest difference between the number of ranges and that of view and step."""

_FARTHEST = 2.0
"""Greatest distance of a laser from the middle of its robot [m]."""
_SAME = 1e-6
"""Greatest difference [m, rad] between poses of laser and robot that are one pose."""
_ALIKE = 0.01
"""Greatest change of a laser's place on its robot [m, rad]; with a greater one its pose has been corrected."""
_LONGEST_WORD = 17


class CarmenLog(TextLog):
    """A CARMEN log."""

    format = "carmen"
    _topics: list[Topic] | None = None
    _posed = False
    """True where sweeps of the log hold poses."""

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
                first = line[:_LONGEST_WORD].split(None, 1)
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
        return [*topics, Topic(MOUNTS, MOUNT_TYPE, self.format)] if scans and poses[ODOMETRY] else topics

    def _sweeps(
        self, blocks: Iterator[TextBlock], topics: Collection[str] | None, report: ReadReport
    ) -> Iterator[RawSweeps]:
        decoder = _Decoder(
            self._options, report, {word for word, one in LASERS.items() if topics is None or one.topic in topics}
        )
        for block in blocks:
            yield from decoder.sweeps(block)

    def _poses(self, blocks: Iterator[TextBlock], types: Collection[str], report: ReadReport) -> Iterator[Message]:
        # Where sweeps hold the robot's poses, other lines of odometry are skipped.
        self.topics()
        decoder = _Decoder(self._options, report, {*LASERS, TRUEPOS, *([] if self._posed else [ODOM])})
        for block in blocks:
            yield from decoder.poses(block, types)
        if MOUNT_TYPE in types:
            yield from decoder.mounts()


class _Parameters:
    """Values of parameters; each holds for the lines after it, until the next one of its name."""

    def __init__(self) -> None:
        self._values: dict[bytes, tuple[list[int], list[float]]] = {}
        """Name → lines and values: those of the last block, and of earlier blocks the last one."""

    def add(self, first_line: int, parameters: list[tuple[int, bytes, bytes]]) -> None:
        """Take row, name and value of the parameters of a block; those without a number count for nothing."""
        for lines, values in self._values.values():
            del lines[:-1], values[:-1]
        for row, name, value in parameters:
            if name in _KNOWN and _STARTS_NUMBER.match(value) and is_number(value):
                lines, values = self._values.setdefault(name, ([], []))
                lines.append(first_line + row)
                values.append(float(value))

    def at(self, frame: str, what: str, lines: Int64) -> Float64:
        """(R,) Value of a parameter at each line; NaN before the first one."""
        places, values = self._values.get(_PARAMETERS.get((frame, what), b""), ([], []))
        return np.array([np.nan, *values])[np.searchsorted(np.array(places, np.int64), lines)]

    def last(self, frame: str, what: str) -> float | None:
        """Return the latest value of a parameter; None without any."""
        _, values = self._values.get(_PARAMETERS.get((frame, what), b""), ([], []))
        return values[-1] if values else None


@dataclass(slots=True)
class _Mount:
    """Place of a laser on its robot, as the poses of both give it."""

    first: Float64
    spread: float = 0.0
    """Greatest change since then [m, rad]."""


@dataclass
class _Decoder:
    """Decodes the lines of a log in one pass, block after block."""

    options: OpenOptions
    report: ReadReport
    wanted: set[bytes]
    """First words of the lines that are decoded."""
    parameters: _Parameters = field(default_factory=_Parameters)
    first_ns: dict[str, int] = field(default_factory=dict)
    """Frame of each laser → stamp of its first sweep, in a pass for poses."""
    _noted: set[str] = field(default_factory=set)
    """Topics whose guessed bearings have been noted."""
    _mounts: dict[str, _Mount] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._framing = Framing(self.report)

    def _read(self, block: TextBlock) -> tuple[LineBlock, list[CarmenLines]]:
        """Find the wanted messages of a block; keep the parameters of lasers."""
        lines = LineBlock.of(block)
        messages, parameters = self._framing.read(lines, self.wanted)
        self.parameters.add(lines.line, parameters)
        lines.report_bad(self.report)
        return lines, [some for some in messages if len(some.rows)]

    def sweeps(self, block: TextBlock) -> Iterator[RawSweeps]:
        """Yield the sweeps of a block, topic by topic."""
        lines, messages = self._read(block)
        for some in messages:
            for part in split_rows(some.beams):
                sweeps = self._decode(lines, some.of(part))
                lines.report_bad(self.report)
                if sweeps is not None:
                    yield sweeps

    def _decode(self, lines: LineBlock, messages: CarmenLines) -> RawSweeps | None:
        laser, rows, beams, scale = LASERS[messages.word], messages.rows, messages.beams, self.options.range_scale
        number = np.float32 if scale == 1.0 else np.float64
        values = lines.cells.numbers(rows, laser.count + 1, laser.width * beams, number)
        bad = values.bad
        if laser.geometry:
            declared = lines.cells.numbers(rows, _GEOMETRY, np.full(len(rows), 4), np.float64)
            bad = bad | declared.bad
            first, step, most = _of_lines(declared.values.reshape(-1, 4), beams)
        else:
            first, step = self._of_parameters(laser, rows + lines.line, beams)
            most = np.full(len(rows), MAX_RANGE)
        lines.bad = [(int(rows[at]), not_a_number(cell)) for at, cell in bad.items()]
        good = np.ones(len(rows), np.bool_)
        good[list(bad)] = False
        ranges = pad(values.values[:: laser.width], beams, scale)
        if not laser.geometry:
            cut = self.parameters.at(laser.frame, "max", rows + lines.line)
            ranges[ranges == as_singles(cut * scale)[:, None]] = np.inf
        options = self.options
        if given_geometry(options, 2) is not None:
            first, step = given_geometries(options, beams)
        if options.angle_increment is not None:
            step = np.full(len(beams), options.angle_increment)
        if options.angle_min is not None:
            first = np.full(len(beams), options.angle_min)
        limits = limits_in_metres(np.zeros(len(rows)), most, scale)
        block = RawSweeps(
            topic=laser.topic,
            frame_ids=(laser.frame,),
            frame=np.zeros(len(rows), np.int32),
            stamp_ns=messages.stamp_ns,
            record_ns=messages.stamp_ns,
            angle_min=first,
            angle_increment=step,
            range_min=limits[0],
            range_max=limits[1] if options.range_max is None else as_singles(np.full(len(rows), options.range_max)),
            beams=beams.astype(np.int32),
            ranges=ranges,
            intensities=_remissions(lines.cells, laser, messages, values.values),
        )
        return keep_sound(block, good, self.report)

    def _of_parameters(self, laser: Laser, lines: Int64, beams: Int64) -> tuple[Float64, Float64]:
        """Return first bearings and steps of sweeps whose lines have none."""
        fov, resolution = (self.parameters.at(laser.frame, what, lines) for what in ("fov", "resolution"))
        first, step, guessed = bearings_of(beams, fov, resolution)
        if guessed.any() and laser.topic not in self._noted and given_geometry(self.options, 2) is None:
            self._noted.add(laser.topic)
            row = int(np.argmax(guessed))
            degrees = np.degrees([first[row], step[row]])
            self.report.notes.append(
                f"{laser.topic}: no geometry in the log; by its {beams[row]} ranges it is taken to begin at "
                f"{degrees[0]:g} degrees and to go on by {degrees[1]:.4g}; --angle-min and --angle-increment tell better"
            )
        return first, step

    def poses(self, block: TextBlock, types: Collection[str]) -> Iterator[Message]:
        """Yield the poses of a block of the given types, in the order of its lines."""
        lines, found = self._read(block)
        messages: list[tuple[int, Message]] = []
        for some in found:
            if some.word in LASERS:
                self.first_ns.setdefault(LASERS[some.word].frame, int(some.stamp_ns[0]))
            for poses in self._poses_of(lines, some):
                if poses.type in types:
                    messages += zip(poses.rows.tolist(), poses.messages(), strict=True)
        lines.report_bad(self.report)
        for _, message in sorted(messages, key=lambda one: one[0]):
            yield message

    def _poses_of(self, lines: LineBlock, messages: CarmenLines) -> Iterator[PlanarPoses]:
        """Decode the poses of robot and laser."""

        def read(some: CarmenLines, count: int) -> tuple[CarmenLines, Float64]:
            good, values = lines.poses(some.rows, some.after, count)
            lines.report_bad(self.report)
            return some.of(good), values

        def track(topic: str, parent: str, child: str, some: CarmenLines, poses: Float64) -> PlanarPoses:
            return PlanarPoses(topic, TYPES[topic], parent, child, some.rows, some.stamp_ns, poses)

        if messages.word in (ODOM, TRUEPOS):
            topic, world = (ODOMETRY, "odom") if messages.word == ODOM else (TRUE, "world")
            yield track(topic, world, ROBOT, *read(messages.of(messages.behind >= POSE), POSE))
            return
        laser = LASERS[messages.word]
        if not laser.posed:
            return
        # Remissions and their number stand before the poses; old writers have left them out.
        if laser.geometry:
            count = _remission_counts(lines.cells, messages)
            skip = np.where((count >= 0) & (count + 1 + 2 * POSE <= messages.behind), count + 1, 0)
            messages = replace(messages, after=messages.after + skip, behind=messages.behind - skip)
        both = messages.behind >= 2 * POSE
        whole, poses = read(messages.of(both), 2 * POSE)
        if len(poses):
            self._compare(laser.frame, poses)
            yield track(CORRECTED, "map", laser.frame, whole, poses[:, :POSE])
            yield track(ODOMETRY, "odom", ROBOT, whole, poses[:, POSE:])
        whole, poses = read(messages.of((messages.behind >= POSE) & ~both), POSE)
        if len(poses):
            # In logs of old writers no other line says where the robot was.
            yield track(ODOMETRY, "odom", laser.frame, whole, poses)

    def _compare(self, frame: str, poses: Float64) -> None:
        """Keep the place of a laser on its robot by poses (K, 6) of both, and how much it changes."""
        poses = poses[(np.abs(poses) < 1e9).all(axis=1)]
        if not len(poses):
            return
        dx, dy = poses[:, 0] - poses[:, 3], poses[:, 1] - poses[:, 4]
        cos, sin = np.cos(poses[:, 5]), np.sin(poses[:, 5])
        turn = wrapped(poses[:, 2] - poses[:, 5])
        mounts = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, turn])
        mount = self._mounts.setdefault(frame, _Mount(mounts[0]))
        off = mounts - mount.first
        off[:, 2] = wrapped(off[:, 2])
        far = float(np.abs(mounts[:, :2]).max()) > _FARTHEST
        mount.spread = np.inf if far else max(mount.spread, float(np.abs(off).max()))

    def mounts(self) -> Iterator[Message]:
        """Yield the mounts of the lasers that had sweeps, once the whole log is read."""
        for frame, stamp_ns in self.first_ns.items():
            if (pose := self._mount(frame)) is not None:
                row, stamp = np.zeros(1, np.int64), np.array([stamp_ns])
                yield from PlanarPoses(MOUNTS, MOUNT_TYPE, ROBOT, frame, row, stamp, np.array([pose])).messages()

    def _mount(self, frame: str) -> Sequence[float] | None:
        """Return x, y [m] and yaw [rad] of a laser by parameters, else by the poses of laser and robot."""
        offsets = [self.parameters.last(frame, what) for what in ("forward", "side", "angular")]
        pose: list[float] | None = None
        if any(offset is not None for offset in offsets):
            pose = [offset or 0.0 for offset in offsets]
            # A rear laser looks backwards, unless its angle is given and says so itself.
            if frame == REAR and abs(pose[2]) < 0.5 * np.pi:
                pose[2] += np.pi
        mount = self._mounts.get(frame)
        if mount is not None and mount.spread <= _ALIKE:
            same = frame == FRONT and float(np.abs(mount.first).max()) <= _SAME
            # Where lines have one pose for both, whoever wrote them took no notice of the parameters.
            if pose is None or same:
                pose = list(mount.first)
        return pose


def _remission_counts(cells: Cells, messages: CarmenLines) -> Int64:
    """(R,) Count in the cell behind the ranges of each message; -1 where there is none."""
    counts = [count_in(cell) for cell in cells.spans(messages.rows, messages.after, np.minimum(messages.behind, 1))]
    return np.array([-1 if count is None else count for count in counts], np.int64)


def _remissions(cells: Cells, laser: Laser, messages: CarmenLines, ranges: NDArray[np.floating]) -> Float32 | None:
    """(S, B) Remissions of sweeps, NaN where one has fewer of them than ranges; None where none has any.

    They follow each of the `ranges`, or all of them with their number first.
    """
    beams = messages.beams
    if laser.pairs:
        return pad(ranges[1::2], beams, 1.0) if len(ranges) else None
    if not laser.geometry:
        return None
    count = _remission_counts(cells, messages)
    count = np.where(count < messages.behind, np.clip(count, 0, beams), 0)
    if not count.any():
        return None
    return pad_cells(cells, messages.rows, messages.after + 1, count, int(beams.max()))


def _of_lines(geometry: Float64, beams: Int64) -> tuple[Float64, Float64, Float64]:
    """Return first bearings, steps [rad] and greatest ranges [m] by lines (S, 4): first bearing, view, step, range.

    The view has all the digits that a rounded step lacks: its part for each beam is the step where it is that of the
    ranges, or of one more. Bearings are guessed where view and step are zero.
    """
    first, view, step, most = geometry.T
    nothing = (view == 0.0) & (step == 0.0)
    gaps = np.maximum(beams - 1, 1)
    parts = np.stack([view / gaps, view / np.maximum(beams, 1)])
    off = np.abs(parts - step)
    nearest = np.take_along_axis(parts, np.argmin(off, axis=0)[None], axis=0)[0]
    step = np.where(off.min(axis=0) < _ROUNDED, nearest, np.where(step == 0.0, view / gaps, step))
    if nothing.any():
        none = np.full(len(beams), np.nan)
        guessed_first, guessed_step, _ = bearings_of(beams, none, none)
        first, step = np.where(nothing, guessed_first, first), np.where(nothing, guessed_step, step)
    with np.errstate(invalid="ignore"):
        return first, step, np.where(most > 0, most, MAX_RANGE)


def bearings_of(beams: Int64, fov: Float64, resolution: Float64) -> tuple[Float64, Float64, Bool]:
    """Return first bearings and steps of sweeps whose lines have none.

    Parameters
    ----------
    beams : (R,) ranges of each sweep
    fov, resolution : (R,) view and step by parameters [degrees]; NaN without

    Returns
    -------
    first, step : (R,) [rad]
    guessed : (R,) True where parameters say nothing, or contradict the number of ranges
    """
    gaps = np.maximum(beams - 1, 1)
    with np.errstate(all="ignore"):
        fov, resolution = np.where(fov > 0, fov, np.nan), np.where(resolution > 0, resolution, np.nan)
        steps = fov / resolution
    fits = ~(np.abs(steps - beams + 0.5) >= _SLACK)
    by_step = np.isfinite(resolution) & fits
    by_view = np.isfinite(fov) & fits
    # 180 beams of a degree are those of half a turn without its last one.
    half = np.abs(beams * resolution - 180.0) < 1e-6
    view = np.where(by_view, fov, np.where(half, 180.0, gaps * resolution))
    distinct, inverse = np.unique(beams, return_inverse=True)
    guesses = [(_STEPS.get(count, 180.0 / max(count - 1, 1)), _FIRST.get(count, -90.0)) for count in distinct.tolist()]
    guessed_step, guessed_first = np.array(guesses, np.float64).reshape(-1, 2)[inverse.ravel()].T
    known = by_step | by_view
    step = np.where(by_step, resolution, view / np.where(np.isin(beams, _WITHOUT_LAST), beams, gaps))
    step = np.where(known, step, guessed_step)
    first = np.where(known, -0.5 * view, guessed_first)
    return np.radians(first), np.radians(step), ~known
