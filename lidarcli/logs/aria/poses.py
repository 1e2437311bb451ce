"""The poses that an ARIA log tells: where the robot was, and where its lasers are mounted."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.aria.lines import Lines
from lidarcli.logs.aria.sweeps import MILLI
from lidarcli.logs.aria.words import GLOBAL_POSE, ROBOT_POSE
from lidarcli.logs.base import Message, ReadReport
from lidarcli.logs.lines import Told, report_lines, sound_rows
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
from lidarcli.sweeps import Float64

TOPICS = {ROBOT_POSE: (ODOMETRY, ODOMETRY_TYPE, "odom"), GLOBAL_POSE: ("/corrected", POSE_TYPE, "map")}
"""Tag → topic, type, and the frame that its poses are in. Of these the odometry alone is used unasked."""
_WIDTH = 3


@dataclass(slots=True)
class PoseDecoder:
    """Poses of one log, block by block, and where its lasers are mounted in the end."""

    types: Collection[str]
    report: ReadReport
    _told: Told[tuple[str, str]] = field(default_factory=Told)
    _stamps: dict[str, int] = field(default_factory=dict)
    """Frame of a laser → the first stamp of its sweeps."""
    _lines: Lines = field(init=False)

    def __post_init__(self) -> None:
        self._lines = Lines(self.report)

    def feed(self, block: TextBlock) -> Iterator[Message]:
        """The poses of a block, in the order of its lines."""
        read = self._lines.read(block)
        self._told.add(block.line, read.told)
        for sensor, found in read.sweeps.items():
            if len(found.rows):
                self._stamps.setdefault(sensor.frame, int(found.stamp_ns[0]))
        bad: list[tuple[int, str]] = []
        told: list[tuple[int, Message]] = []
        for word, found in read.poses.items():
            topic, kind, world = TOPICS[word]
            if kind not in self.types:
                continue
            # A localisation that does not know where the robot is leaves its line empty.
            some = found.rows[read.cells.count[found.rows] > 1]
            short = read.cells.count[some] <= _WIDTH
            bad += [(row, "it has less numbers than a pose") for row in some[short].tolist()]
            some = some[~short]
            numbers = read.cells.numbers(some, 1, np.full(len(some), _WIDTH), np.float64)
            good, values = sound_rows(numbers, some, _WIDTH, bad, "its pose: ")
            stamps = found.stamp_ns[np.searchsorted(found.rows, some[good])]
            messages = pose_messages(topic, kind, stamps, world, ROBOT, _metres(values))
            told += zip(some[good].tolist(), messages, strict=True)
        report_lines(self.report, block.line, bad)
        yield from in_order(told)

    def finish(self) -> Iterator[Message]:
        """Where the lasers are mounted that have sweeps, as it was told last."""
        if MOUNT_TYPE not in self.types:
            return
        for frame, stamp in self._stamps.items():
            place = self._told.last((frame, "pose"))
            if place is not None:
                pose = _metres(np.array([place]))
                yield from pose_messages(MOUNTS, MOUNT_TYPE, np.array([stamp]), ROBOT, frame, pose)


def _metres(poses: Float64) -> Float64:
    """Poses (K, 3) in mm and degrees, in metres and radians."""
    return np.column_stack([poses[:, :2] * MILLI, np.radians(poses[:, 2])])
