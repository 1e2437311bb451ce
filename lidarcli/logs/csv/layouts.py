"""The CSV layouts, and what a reader must know of a file that has one of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.csv.dialect import Dialect
from lidarcli.sweeps import Float64, Int64

ROSTOPIC = "rostopic echo -p"
ROS2 = "ros2 topic echo --csv"
PLOTJUGGLER = "PlotJuggler"
BAGPY = "bagpy"
MCAP_CAT = "mcap cat --format=csv"
LIST = "list of ranges"
WIDE = "plain wide"
LONG = "long form"
PER_SWEEP = "one file per sweep"
RPLIDAR = "RPLIDAR"
CORESLAM = "CoreSLAM"
LAYOUTS = (ROSTOPIC, ROS2, PLOTJUGGLER, BAGPY, MCAP_CAT, LIST, WIDE, LONG, PER_SWEEP)

MILLIMETRE = 0.001
TITLES = "above those of an RPLIDAR write `#RPLIDAR SCAN DATA` and `#Quality Angle Distance`"
"""How a table without names can be told to be of this sensor."""

DEFAULT_TOPIC = "/scan"
"""That of a file which names none."""

ABBREVIATED = "the arrays are abbreviated ('...'): record again with `ros2 topic echo --csv --full-length`"


@dataclass(frozen=True, slots=True)
class Columns:
    """Where the fields of one scan stand, and the units of its times."""

    topic: str
    fields: dict[str, int]
    units: dict[str, int] = field(default_factory=dict)
    """`record` and `stamp` → nanoseconds per unit, see `times.time_unit`."""
    ranges: Int64 = field(default_factory=lambda: np.empty(0, np.int64))
    """(B,) the column of each beam; empty where `first` says it all."""
    first: int = 0
    """The first column of ranges."""
    doubled: bool = False
    """As many intensities follow the ranges, up to the end of the row."""
    intensities: Int64 = field(default_factory=lambda: np.empty(0, np.int64))
    """(B,) the column of the intensity of each beam where they stand elsewhere; in a list form, that of the list."""
    open_end: bool = False
    """Nothing but ranges (and intensities) stands from `first` to the end of the row: rows may be ragged."""
    geometry: tuple[float, float] | None = None
    """angle_min and angle_increment where column names or options give them."""
    nearest: float = 0.0
    """The least range, where no column tells it, in the unit of ranges."""
    to_last: bool = False
    """`angle_max` is the bearing of the last beam, and tells the increment (foxglove.LaserScan)."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What a CSV is, as far as its first lines say."""

    name: str
    dialect: Dialect
    start: int
    """Number of the first line of data."""
    header: bytes = b""
    """The header line as it stands, to be left out wherever it is repeated."""
    width: int = 0
    """Cells of a regular row; 0: rows are what they are."""
    scans: tuple[Columns, ...] = ()
    sparse: bool = False
    """Rows hold one topic or another: a row without any range of a topic is no sweep of it."""
    angle: int = -1
    """Long form: the column of the bearing."""
    key: int | None = None
    """Long form: the column that changes from sweep to sweep."""
    degrees: bool = False
    flag: int = -1
    """Long form: the column that is 1 where a sweep begins."""
    spelling: str = ""
    """Long form: how tools for RPLIDAR sensors have written it (`rplidar`); bearings run clockwise."""
    scale: float | None = None
    """The unit of ranges in metres, where it is known."""
    listed: bool = False
    """One cell holds all ranges of a sweep."""
    brackets: bytes = b"["
    """How such a list begins."""
    notes: tuple[str, ...] = ()


def expected_beams(angle_min: Float64, angle_max: Float64, increment: Float64) -> Int64:
    """(K,) beams that the view and the increment make; -1 where they make none."""
    with np.errstate(all="ignore"):
        steps = (angle_max - angle_min) / increment
    sane = np.isfinite(steps) & (steps > -0.5) & (steps < 1e7)
    return np.where(sane, np.rint(np.where(sane, steps, 0)).astype(np.int64) + 1, -1)
