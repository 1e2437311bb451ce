"""The poses that a Player log tells: where robots were by their wheels, where lasers were, and where they are mounted."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.base import Message, ReadReport
from lidarcli.logs.lines import report_lines, sound_rows
from lidarcli.logs.numbers import Cells
from lidarcli.logs.planar import MOUNT_TYPE, MOUNTS, ODOMETRY_TYPE, POSE_TYPE, in_order, pose_messages
from lidarcli.logs.player.geometry import tails
from lidarcli.logs.player.lines import Found, Lines, Names
from lidarcli.logs.player.sweeps import framed
from lidarcli.logs.player.words import DATA, Device
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps import Float64, Int64

POSE, GEOMETRY = "/pose", "/geometry"
"""What the topics with places of a laser and of a ranger end with. The second must be asked for: it may be a mount."""
_WIDTH = 3
_LEVEL = 0.1
"""A ranger that is tilted by more [rad] does not look along the plane in which poses are."""


def path_topic(names: Names, device: Device) -> str | None:
    """The topic that tells where the sensor itself was; None where its lines do not."""
    scan = device.scan
    if scan is None or not (scan.tail or scan.pose):
        return None
    return names.topic(device) + (GEOMETRY if scan.tail else POSE)


@dataclass(slots=True)
class PoseDecoder:
    """Poses of one log, block by block, and where its lasers are mounted in the end."""

    types: Collection[str]
    report: ReadReport
    names: Names = field(default_factory=Names)
    _mounts: dict[str, tuple[str, Float64]] = field(default_factory=dict)
    """Frame of a sensor → that of its robot, and its place there."""
    _stamps: dict[str, int] = field(default_factory=dict)
    """Frame of a sensor → the first stamp of its sweeps."""
    _lines: Lines = field(init=False)

    def __post_init__(self) -> None:
        self._lines = Lines(self._is_wanted, self.report, self.names)

    def _is_wanted(self, device: Device) -> bool:
        return device.scan is not None or device.odometry is not None or device.mount is not None

    def feed(self, block: TextBlock) -> Iterator[Message]:
        """The poses of a block, in the order of its lines."""
        cells, found = self._lines.read(block)
        bad: list[tuple[int, str]] = []
        cut = len(cells.count) - 1 if block.cut else -1
        told: list[tuple[int, Message]] = []
        for part in found:
            device = part.device
            if device.scan is not None:
                self._stamps.setdefault(self.names.frame(device), int(part.stamp_ns[0]))
            if device.mount is not None:
                self._mount(cells, part, np.array(device.mount), bad)
            elif device.odometry is not None and ODOMETRY_TYPE in self.types:
                some, poses = _numbers(cells, part.rows, device.odometry, bad)
                world = f"{self.names.of(device.robot)}odom{device.number or ''}"
                told += self._messages(
                    part,
                    some,
                    self.names.topic(device),
                    ODOMETRY_TYPE,
                    (world, self.names.base(device)),
                    poses,
                )
            elif (topic := path_topic(self.names, device)) is not None and POSE_TYPE in self.types:
                some, poses = _of_sweeps(cells, part, bad, cut)
                frames = f"{self.names.of(device.robot)}map", self.names.frame(device)
                told += self._messages(part, some, topic, POSE_TYPE, frames, poses)
        report_lines(self.report, block.line, bad)
        yield from in_order(told)

    def finish(self) -> Iterator[Message]:
        """Where the lasers are mounted that have sweeps."""
        if MOUNT_TYPE not in self.types:
            return
        for frame, stamp in self._stamps.items():
            if frame in self._mounts:
                base, pose = self._mounts[frame]
                yield from pose_messages(MOUNTS, MOUNT_TYPE, np.array([stamp]), base, frame, pose)

    def _messages(
        self, found: Found, some: Int64, topic: str, kind: str, frames: tuple[str, str], poses: Float64
    ) -> Iterator[tuple[int, Message]]:
        messages = pose_messages(topic, kind, found.stamp_ns[some], *frames, poses)
        return zip(found.rows[some].tolist(), messages, strict=True)

    def _mount(self, cells: Cells, found: Found, columns: Int64, bad: list[tuple[int, str]]) -> None:
        """Remember where a sensor is on its robot, by the last that is told."""
        width = int(columns.max()) + 1
        rows = found.rows[cells.count[found.rows] >= DATA + width]
        numbers = cells.numbers(rows, DATA, np.full(len(rows), width), np.float64)
        _, values = sound_rows(numbers, rows, width, bad, "its place: ")
        if not len(values):
            return
        frame = self.names.frame(found.device)
        told = values[-1, columns]
        if np.abs(told[_WIDTH:]).max(initial=0.0) > _LEVEL:
            note = f"{frame}: mounted with a tilt, which is not read: its place is left out"
            self.report.notes += [note] if note not in self.report.notes else []
            return
        self._mounts[frame] = self.names.base(found.device), told[None, :_WIDTH]


def _numbers(cells: Cells, rows: Int64, at: int, bad: list[tuple[int, str]]) -> tuple[Int64, Float64]:
    """Of the lines with numbers in three cells from `at` on: which they are, and these."""
    whole = np.flatnonzero(cells.count[rows] >= at + _WIDTH)
    bad += [(int(row), "it has less numbers than a pose") for row in rows[cells.count[rows] < at + _WIDTH]]
    numbers = cells.numbers(rows[whole], at, np.full(len(whole), _WIDTH), np.float64)
    good, values = sound_rows(numbers, rows[whole], _WIDTH, bad, "its pose: ")
    return whole[good], values


def _of_sweeps(cells: Cells, found: Found, bad: list[tuple[int, str]], cut: int) -> tuple[Int64, Float64]:
    """The sweeps of a block that tell where the sensor was, and the poses (K, 3)."""
    scan = found.device.scan
    if scan is None:
        return np.empty(0, np.int64), np.empty((0, _WIDTH))
    told = framed(cells, found, scan, bad, cut)
    whole = np.array(
        [at for at in range(len(found.rows)) if at not in told.causes and at not in told.refused], np.int64
    )
    rows = found.rows[whole]
    if scan.pose is not None:
        good, poses = _numbers(cells, rows, scan.pose, bad)
        return whole[good], poses
    poses, _ = tails(cells, rows, told.after[whole], bad)
    known = ~np.isnan(poses).any(axis=1)
    return whole[known], poses[known]
