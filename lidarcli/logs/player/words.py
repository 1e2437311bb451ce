"""The messages of a Player log: what a line is about, and where its fields stand.

A line begins with time, host, robot, interface and index of the device. Then come the type and the subtype of the message,
or, in logs of file version 0.1, the time of the device.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

HOST, INTERFACE, KIND = 1, 3, 5
"""Cells with the host (the robot follows), the interface (the index follows), and type and subtype."""
DATA = 7
"""The first cell of the data; of file version 0.1 it is the one before."""

OLD = b"old"
"""Stands for type and subtype of file version 0.1, which has data alone."""


@dataclass(frozen=True, slots=True)
class Scan:
    """One kind of sweep: the cells of its line."""

    count: int
    """The number of ranges, which follow it."""
    width: int
    """Cells for each range: itself, then what is told beside it (its intensity)."""
    geometry: int | None = None
    """First and last bearing and the step; None where lines tell none."""
    most: int | None = None
    """The greatest range."""
    pose: int | None = None
    """Where the laser was."""
    angles: bool = False
    """Whether its bearing stands behind each range."""
    tail: bool = False
    """Whether pose and geometry may stand behind the ranges."""


SCANS: dict[tuple[bytes, bytes], Scan] = {
    (b"laser", b"001 001"): Scan(count=12, width=2, geometry=8, most=11),
    (b"laser", b"001 002"): Scan(count=15, width=2, geometry=11, most=14, pose=8),
    (b"laser", b"001 003"): Scan(count=9, width=3, most=8, angles=True),
    (b"laser", OLD): Scan(count=9, width=2, geometry=6),
    (b"ranger", b"001 001"): Scan(count=7, width=1),
    (b"ranger", b"001 002"): Scan(count=7, width=1, tail=True),
}
"""Interface, type and subtype → the sweeps they are."""
ODOMETRY: dict[tuple[bytes, bytes], int] = {
    (b"position2d", b"001 001"): DATA,
    (b"position", b"001 001"): DATA,
    (b"position", OLD): DATA - 1,
    (b"position2d", OLD): DATA - 1,
}
"""Interface, type and subtype of the poses of robots → the cell where they begin."""
GEOMETRY = b"004 001"
"""Type and subtype of what tells where a laser or a ranger is mounted."""
RESPONSE = b"004 "
"""How other responses begin: that of a ranger with seven numbers is its configuration."""
MOUNTS: dict[bytes, tuple[int, ...]] = {b"laser": (0, 1, 2), b"ranger": (0, 1, 5, 3, 4)}
"""Interface → where among the data x, y and yaw of its place on the robot are, and roll and pitch if it has any."""

HEADS = re.compile(rb"\d+(?:\.\d*)?")
"""How the first cell of a line reads: its time [s]."""


class Device(NamedTuple):
    """What a line is about."""

    robot: bytes
    """Host and robot."""
    interface: bytes
    number: int
    """Its index among those of its interface."""
    kind: bytes
    """Type and subtype, or `OLD`."""

    @property
    def scan(self) -> Scan | None:
        """Where its sweeps stand; None where it is none."""
        return SCANS.get((self.interface, self.kind))

    @property
    def odometry(self) -> int | None:
        """The cell where its pose begins; None where it is no robot's."""
        return ODOMETRY.get((self.interface, self.kind))

    @property
    def mount(self) -> tuple[int, ...] | None:
        """The data that tell where it is mounted, as of `MOUNTS`; None where they do not."""
        return MOUNTS.get(self.interface) if self.kind == GEOMETRY else None


def device_of(head: bytes, kind: bytes) -> Device | None:
    """The device and the message by cells 1 to 4 of a line and cells 5 and 6; None where they are none.

    >>> device_of(b"16777343 6665 laser 00", b"001 001").number
    0
    """
    cells = head.split(b" ")
    if len(cells) != 4 or not cells[3].isdigit() or len(cells[3]) > 3 or not cells[2][:1].isalpha():
        return None
    first, _, second = kind.partition(b" ")
    if first.isdigit() and second.isdigit():
        kind = b"%03d %03d" % (int(first[:9]), int(second[:9]))
    elif HEADS.fullmatch(first):
        kind = OLD
    else:
        return None
    return Device(b" ".join(cells[:2]), cells[2], int(cells[3]), kind)
