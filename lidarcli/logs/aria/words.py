"""The lines of an ARIA log by their tags: a word with a colon at its end, then data. Lengths are mm, angles degrees."""

from __future__ import annotations

import re
from dataclasses import dataclass

VERSION, CREATED = b"version:", b"#Created"
TIMES = (b"time:", b"logTime:")
"""Seconds since the start of the log. Since version 4 the second one is written."""
ROBOT_POSE, GLOBAL_POSE = b"robot:", b"robotGlobal:"
"""Where the robot was by its wheels, and where a localisation takes it to be: x, y, heading."""

UNKNOWN = re.compile(rb"[A-Za-z_][\w-]{0,63}:")
"""The tag of a line that holds nothing of what is read, which is passed over."""

_SENSOR = re.compile(rb"(sick|scan|urg|laser|lms|lidar)(\d{0,3})(pose|conf)?:")
_OF_DAY = re.compile(rb"(\d{1,2}):(\d{1,2}):(\d{1,2})")
_ARIA = (b"ARIA", b"ArLaserLogger", b"ArSickLogger")
_PADDED = 4
"""Since this version the milliseconds of times have leading zeros."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """A laser by the way its sweeps are written."""

    name: str
    number: int
    part: str = ""
    """`pose`, `conf`, or empty for a sweep."""

    @property
    def topic(self) -> str:
        """The topic of its sweeps."""
        return f"/{self.name}{self.number}"

    @property
    def frame(self) -> str:
        """Its frame: `sick` and `scan` with the same number are one laser, written in two ways."""
        return f"{'laser' if self.is_points or self.name == 'sick' else self.name}{self.number}"

    @property
    def is_points(self) -> bool:
        """Whether its sweeps are points, where nothing tells better."""
        return self.name == "scan"


def sensor_of(word: bytes) -> Sensor | None:
    """The sensor that a line is of; None where it is of none.

    >>> sensor_of(b"sick1conf:")
    Sensor(name='sick', number=1, part='conf')
    >>> sensor_of(b"scan1Id:")
    """
    match = _SENSOR.fullmatch(word)
    if match is None:
        return None
    name, number, part = match.groups(b"")
    return Sensor(name.decode(), int(number or 1), part.decode())


def is_unpadded(created: bytes, version: bytes) -> bool:
    """Whether milliseconds have no leading zeros: so wrote ARIA itself up to version 3.

    >>> is_unpadded(b"by ARIA's ArSickLogger", b"2"), is_unpadded(b"by hand", b"2")
    (True, False)
    """
    return any(name in created for name in _ARIA) and not (version.isdigit() and int(version[:9]) >= _PADDED)


def of_day(cell: bytes) -> bytes:
    """A time of day, as some other programs write it, in seconds.

    >>> of_day(b"12:30:01"), of_day(b"12.5")
    (b'45001', b'12.5')
    """
    match = _OF_DAY.fullmatch(cell)
    if match is None:
        return cell
    hours, minutes, seconds = map(int, match.groups())
    return b"%d" % (3600 * hours + 60 * minutes + seconds)


def padded(cell: bytes) -> bytes:
    """A time whose milliseconds have no leading zeros, as a decimal number.

    >>> padded(b"12.5")
    b'12.005'
    """
    whole, point, fraction = cell.partition(b".")
    return whole + point + fraction.rjust(3, b"0")
