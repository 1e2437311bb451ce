"""The lines of a block of text by the devices that they are about."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.base import ReadReport
from lidarcli.logs.lines import CUT, Apart, cells_of, report_lines
from lidarcli.logs.numbers import Cells, say
from lidarcli.logs.planar import ROBOT
from lidarcli.logs.player.words import DATA, HEADS, HOST, KIND, OLD, Device, device_of
from lidarcli.logs.text import TextBlock
from lidarcli.logs.times import S, to_ns
from lidarcli.sweeps import Int64

_HEAD = KIND - HOST
NO_TIME = "no time at its beginning"


@dataclass(slots=True)
class Names:
    """The names of devices: those of the first robot of a log are bare, others begin with the robot's."""

    _robots: dict[bytes, str] = field(default_factory=dict)
    _taken: set[str] = field(default_factory=set)

    def of(self, robot: bytes) -> str:
        """What the names of a robot's devices begin with."""
        prefix = self._robots.get(robot)
        if prefix is None:
            host, _, port = robot.decode("utf-8", "replace").partition(" ")
            prefix = f"{port}/" if self._robots else ""
            if prefix in self._taken:
                prefix = f"{host}_{port}/"
            self._robots[robot] = prefix
            self._taken.add(prefix)
        return prefix

    def topic(self, device: Device) -> str:
        """The topic of what a device measures."""
        return f"/{self.frame(device)}"

    def frame(self, device: Device) -> str:
        """The frame of a device."""
        return f"{self.of(device.robot)}{device.interface.decode()}{device.number}"

    def base(self, device: Device) -> str:
        """The frame of its robot."""
        return f"{self.of(device.robot)}{ROBOT}"


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """R lines of one device and kind in a block of text, in the order of the log."""

    device: Device
    rows: Int64
    """(R,) the lines, counted from the first of the block."""
    stamp_ns: Int64
    """(R,) of equal times that follow each other each is a nanosecond after the one before it."""


class Lines:
    """Reads blocks of one log, one after the other; what cannot be a message goes to the report."""

    def __init__(self, wanted: Callable[[Device], bool], report: ReadReport, names: Names) -> None:
        self._wanted = wanted
        self._report = report
        self._names = names
        self._apart = Apart()

    def read(self, block: TextBlock) -> tuple[Cells, list[Found]]:
        """The cells of a block, and the messages that are wanted."""
        cells = cells_of(block.text)
        bad: list[tuple[int, str]] = []
        devices = _by_device(cells, bad, len(cells.count) - 1 if block.cut else -1)
        found = []
        for device, some in devices.items():
            self._names.of(device.robot)
            if not self._wanted(device):
                continue
            rows = np.array(some, np.int64)
            stamps, wrong = to_ns(cells.column(rows, 0), S)
            if wrong is not None:
                bad += [(row, NO_TIME) for row in rows[wrong].tolist()]
                rows, stamps = rows[~wrong], stamps[~wrong]
            kind = b" ".join([device.robot, device.interface, b"%d" % device.number, device.kind])
            found.append(Found(device, rows, self._apart.of(kind, stamps)))
        report_lines(self._report, block.line, bad)
        return cells, [part for part in found if len(part.rows)]


def _by_device(cells: Cells, bad: list[tuple[int, str]], cut: int) -> dict[Device, list[int]]:
    """The rows of each device and kind of message; what has none is told in `bad`."""
    every = np.arange(len(cells.count))
    first = cells.column(every, 0)
    heads = cells.spans(every, HOST, np.clip(cells.count - HOST, 0, _HEAD))
    kinds = cells.spans(every, KIND, np.clip(cells.count - KIND, 0, 2))
    known: dict[tuple[bytes, bytes], Device | None] = {}
    devices: dict[Device, list[int]] = {}
    for row, (begin, head, kind) in enumerate(zip(first, heads, kinds, strict=True)):
        if not begin or begin[:1] == b"#":
            continue
        key = head, OLD if b"." in kind.partition(b" ")[0] else kind
        if key not in known:
            known[key] = device_of(head, kind)
        device = known[key]
        # Of a line that is cut before its data the type may be cut as well.
        if row == cut and (device is None or cells.count[row] <= DATA):
            bad.append((row, CUT))
        elif device is not None and HEADS.fullmatch(begin):
            devices.setdefault(device, []).append(row)
        else:
            bad.append((row, f"{say(begin)} begins no message"))
    return devices


@dataclass(slots=True)
class Index:
    """What a log holds, by the beginnings of its lines."""

    lines: dict[Device, int] = field(default_factory=dict)
    """Device and kind of message → lines, in the order of their first ones."""
    names: Names = field(default_factory=Names)

    @classmethod
    def of(cls, blocks: Iterable[TextBlock]) -> Index:
        """The index of a whole text."""
        index = cls()
        for block in blocks:
            for device, rows in _by_device(cells_of(block.text), [], -1).items():
                index.names.of(device.robot)
                index.lines[device] = index.lines.get(device, 0) + len(rows)
        return index
