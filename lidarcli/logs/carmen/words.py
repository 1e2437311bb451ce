"""The messages of a CARMEN log by their first words: where their fields stand, and which sensor they are of."""

from __future__ import annotations

import re
from dataclasses import dataclass

FRONT, REAR = "front_laser", "rear_laser"


@dataclass(frozen=True, slots=True)
class Laser:
    """One kind of sweep."""

    topic: str
    frame: str
    geometry: bool = False
    """Seven fields before the number of ranges tell the sensor: type, first angle, view, step, greatest range, ..."""
    pairs: bool = False
    """A remission behind each range."""
    posed: bool = False
    """Poses of laser and robot behind the ranges."""

    @property
    def count(self) -> int:
        """The cell that holds the number of ranges, which follow it."""
        return 8 if self.geometry else 1


LASERS: dict[bytes, Laser] = {
    b"FLASER": Laser("/front_laser", FRONT, posed=True),
    b"RLASER": Laser("/rear_laser", REAR, posed=True),
    b"LASER3": Laser("/laser3", "laser3"),
    b"LASER4": Laser("/laser4", "laser4"),
    b"REMISSIONFLASER": Laser("/front_laser_remission", FRONT, pairs=True, posed=True),
    b"RAWLASER1": Laser("/raw_laser1", FRONT, geometry=True),
    b"RAWLASER2": Laser("/raw_laser2", REAR, geometry=True),
    b"RAWLASER3": Laser("/raw_laser3", "laser3", geometry=True),
    b"RAWLASER4": Laser("/raw_laser4", "laser4", geometry=True),
    b"ROBOTLASER1": Laser("/robot_laser1", FRONT, geometry=True, posed=True),
    b"ROBOTLASER2": Laser("/robot_laser2", REAR, geometry=True, posed=True),
}
"""First word → what it is. A sensor that is written in two ways has two topics in one frame."""
ODOM, TRUEPOS, PARAM = b"ODOM", b"TRUEPOS", b"PARAM"
POSES = (ODOM, TRUEPOS)

UNKNOWN = re.compile(rb"[A-Za-z_]\w{0,63}")
"""The first word of a message of another program, which is passed over."""
