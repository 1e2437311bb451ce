"""The poses that a CARMEN log tells, as messages: where the robot was by its wheels, and where the laser was."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.base import Message, ReadReport
from lidarcli.logs.carmen.lines import Found, Lines
from lidarcli.logs.carmen.parameters import Parameters
from lidarcli.logs.carmen.words import FRONT, LASERS, ODOM, TRUEPOS
from lidarcli.logs.numbers import Cells, not_a_number, parse_rows
from lidarcli.logs.planar import (
    MOUNT_TYPE,
    MOUNTS,
    ODOMETRY,
    ODOMETRY_TYPE,
    POSE_TYPE,
    ROBOT,
    in_order,
    pose_messages,
)
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps import TURN, Float64, Int64

CORRECTED, TRUE = "/corrected", "/truepos"
TYPES = {ODOMETRY: ODOMETRY_TYPE, CORRECTED: POSE_TYPE, TRUE: POSE_TYPE, MOUNTS: MOUNT_TYPE}
"""Topic → its type. Of these the odometry alone is used unasked."""

_POSE = 3
_FARTHEST = 2.0
"""No laser is mounted farther from where the robot is [m]."""
_SAME = 1e-6
"""Poses of laser and robot that differ by no more [m, rad] are one."""
_ALIKE = 0.01
"""A laser whose place on the robot changes by more than this [m, rad] is not mounted there: its pose has been corrected."""


@dataclass(slots=True)
class _Mount:
    """Where a laser is on the robot, as long as the poses of both tell the same."""

    first: Float64
    spread: float = 0.0


@dataclass(slots=True)
class PoseDecoder:
    """Poses of one log, block by block, and where its lasers are mounted in the end."""

    types: Collection[str]
    report: ReadReport
    with_odom: bool
    """Whether lines that hold nothing but odometry tell where the robot is: no sweep does."""
    parameters: Parameters = field(default_factory=Parameters)
    _mounts: dict[str, _Mount] = field(default_factory=dict)
    _frames: dict[str, int] = field(default_factory=dict)
    """Frame of a sensor → the first stamp of its sweeps."""
    _lines: Lines = field(init=False)

    def __post_init__(self) -> None:
        odom = [ODOM] if self.with_odom else []
        self._lines = Lines([*LASERS, TRUEPOS, *odom], self.report)

    def feed(self, block: TextBlock) -> Iterator[Message]:
        """The poses of a block, in the order of its lines."""
        cells, found, parameters = self._lines.read(block)
        self.parameters.add(block.line, parameters)
        told: list[tuple[int, Message]] = []
        for part in found:
            if part.word in LASERS:
                self._frames.setdefault(LASERS[part.word].frame, int(part.stamp_ns[0]))
            for rows, stamps, topic, parent, child, poses in self._poses(cells, part, block.line):
                if TYPES[topic] in self.types:
                    messages = pose_messages(topic, TYPES[topic], stamps, parent, child, poses)
                    told += zip(rows.tolist(), messages, strict=True)
        yield from in_order(told)

    def finish(self) -> Iterator[Message]:
        """Where the lasers are mounted, as far as parameters or poses tell."""
        if MOUNT_TYPE not in self.types:
            return
        for frame, stamp_ns in self._frames.items():
            pose = self.parameters.mount(frame)
            mount = self._mounts.get(frame)
            if mount is not None and mount.spread <= _ALIKE:
                same = frame == FRONT and float(np.abs(mount.first).max()) <= _SAME
                # Where lines tell one pose for both, whoever wrote them took no notice of the parameters.
                if pose is None or same:
                    pose = tuple(mount.first.tolist())
            if pose is not None:
                yield from pose_messages(
                    MOUNTS, MOUNT_TYPE, np.array([stamp_ns]), ROBOT, frame, np.array([pose])
                )

    def _poses(
        self, cells: Cells, found: Found, first_line: int
    ) -> Iterator[tuple[Int64, Int64, str, str, str, Float64]]:
        """Rows, stamps, topic, frames and poses (K, 3) of what one kind of message tells."""
        if found.word in (ODOM, TRUEPOS):
            some, poses = self._numbers(cells, found, found.after, found.fields >= _POSE, _POSE, first_line)
            topic, world = (ODOMETRY, "odom") if found.word == ODOM else (TRUE, "world")
            yield found.rows[some], found.stamp_ns[some], topic, world, ROBOT, poses
            return
        laser = LASERS[found.word]
        if not laser.posed:
            return
        begin, fields = found.after, found.fields
        if laser.geometry:
            skip = _remissions(cells, found)
            begin, fields = begin + skip, fields - skip
        both = fields >= 2 * _POSE
        some, poses = self._numbers(cells, found, begin, both, 2 * _POSE, first_line)
        if len(some):
            rows, stamps = found.rows[some], found.stamp_ns[some]
            self._compare(laser.frame, poses)
            yield rows, stamps, CORRECTED, "map", laser.frame, poses[:, :_POSE]
            yield rows, stamps, ODOMETRY, "odom", ROBOT, poses[:, _POSE:]
        alone, poses = self._numbers(cells, found, begin, (fields >= _POSE) & ~both, _POSE, first_line)
        if len(alone):
            # Of old writers: nothing else says where the robot was.
            yield found.rows[alone], found.stamp_ns[alone], ODOMETRY, "odom", laser.frame, poses

    def _numbers(
        self, cells: Cells, found: Found, begin: Int64, which: np.ndarray, count: int, first_line: int
    ) -> tuple[Int64, Float64]:
        """Of the messages `which` is true of: those whose `count` cells from `begin` on are numbers, and these."""
        some = np.flatnonzero(which)
        parts = cells.spans(found.rows[some], begin[some], count)
        numbers = parse_rows(parts, np.full(len(some), count), b" ", np.float64)
        for at, cell in sorted(numbers.bad.items()):
            place = f"line {first_line + int(found.rows[some[at]])}"
            self.report.add_damage(place, f"its pose: {not_a_number(cell)}")
        good = np.ones(len(some), np.bool_)
        good[[*numbers.bad]] = False
        return some[good], numbers.values.reshape(-1, count)[good]

    def _compare(self, frame: str, poses: Float64) -> None:
        """Remember where a laser is on the robot by poses (K, 6) of both, and whether that stays so."""
        poses = poses[(np.abs(poses) < 1e9).all(axis=1)]
        if not len(poses):
            return
        dx, dy = poses[:, 0] - poses[:, 3], poses[:, 1] - poses[:, 4]
        cos, sin = np.cos(poses[:, 5]), np.sin(poses[:, 5])
        turn = _wrapped(poses[:, 2] - poses[:, 5])
        mounts = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, turn])
        mount = self._mounts.setdefault(frame, _Mount(mounts[0]))
        off = mounts - mount.first
        off[:, 2] = _wrapped(off[:, 2])
        far = float(np.abs(mounts[:, :2]).max()) > _FARTHEST
        mount.spread = np.inf if far else max(mount.spread, float(np.abs(off).max()))


def _wrapped(angle: Float64) -> Float64:
    wrapped: Float64 = (angle + np.pi) % TURN - np.pi
    return wrapped


def _remissions(cells: Cells, found: Found) -> Int64:
    """Cells that remissions take behind the ranges, their number among them; none where an old writer has left them out."""
    skip = np.zeros(len(found.rows), np.int64)
    told = cells.spans(found.rows, found.after, np.minimum(found.fields, 1))
    for at, (cell, fields) in enumerate(zip(told, found.fields.tolist(), strict=True)):
        # Numbers of remissions are whole, poses most often have a point; what leaves no room for the poses is none.
        if cell.isdigit() and len(cell) <= 7 and 1 + int(cell) + 2 * _POSE <= fields:
            skip[at] = 1 + int(cell)
    return skip
