"""The layouts of CSV, and the head of a file by which its layout is recognised."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.blocks import given_geometry
from lidarcli.logs.clock import NO_STAMPS
from lidarcli.logs.csv.dialect import Dialect, guess_dialect, split_line
from lidarcli.logs.numbers import parse_number
from lidarcli.logs.times import DATED, NS, TIME_OF_DAY, time_unit
from lidarcli.sweeps import TURN, Float64, Int64

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
"""Advice for tables of this sensor without names."""

DEFAULT_TOPIC = "/scan"
"""Topic of a file that names none."""

ABBREVIATED = "the arrays are abbreviated ('...'): record again with `ros2 topic echo --csv --full-length`"

SAMPLE_LINES = 3000
SAMPLE_BYTES = 256 << 10
"""Most lines and bytes by which a layout is recognised; two lines at least."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns of one scan, and the units of its times."""

    topic: str
    fields: dict[str, int]
    units: dict[str, int] = field(default_factory=dict)
    """`record`, `stamp` and `date` → nanoseconds per unit, see `times.time_unit`."""
    ranges: Int64 = field(default_factory=lambda: np.empty(0, np.int64))
    """(B,) Column of each beam; empty where `first` is enough."""
    first: int = 0
    """First column of ranges."""
    doubled: bool = False
    """True where as many intensities follow the ranges, up to the end of the row."""
    intensities: Int64 = field(default_factory=lambda: np.empty(0, np.int64))
    """(B,) Column of each intensity where they stand elsewhere; of a list of ranges, the column of their list."""
    open_end: bool = False
    """True where only ranges (and intensities) stand from `first` to the end of a row: rows may be ragged."""
    geometry: tuple[float, float] | None = None
    """angle_min and angle_increment [rad] by the names of columns."""
    nearest: float = 0.0
    """Least range without a column of it, in the unit of ranges."""
    to_last: bool = False
    """True where `angle_max` is the bearing of the last beam and gives the increment (foxglove.LaserScan)."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of a CSV, as far as its first lines show it."""

    name: str
    dialect: Dialect
    start: int
    """Number of the first line of data."""
    header: bytes = b""
    """Header line as it stands; it is left out wherever it is repeated."""
    width: int = 0
    """Cells of a regular row; 0 where rows differ."""
    scans: tuple[Columns, ...] = ()
    sparse: bool = False
    """True where rows hold one topic or another: a row without any range of a topic is no sweep of it."""
    angle: int = -1
    """Long form: column of the bearing; -1 in other forms."""
    key: int | None = None
    """Long form: column that changes from sweep to sweep."""
    degrees: bool = False
    flag: int = -1
    """Long form: column that is 1 at the start of a sweep; -1 without."""
    spelling: str = ""
    """Long form: format of a tool for RPLIDAR sensors (`rplidar`), whose bearings run clockwise; empty otherwise."""
    scale: float | None = None
    """Unit of ranges [m], where it is known."""
    listed: bool = False
    """True where one cell holds all ranges of a sweep."""
    brackets: bytes = b"["
    """First character of such a list."""
    notes: tuple[str, ...] = ()
    unread: dict[str, str] = field(default_factory=dict)
    """Topic → a note on a column of times that is not understood."""


def expected_beams(angle_min: Float64, angle_max: Float64, increment: Float64) -> Int64:
    """Return the beams (K,) of views and increments; -1 where these make none."""
    with np.errstate(all="ignore"):
        steps = (angle_max - angle_min) / increment
    sane = np.isfinite(steps) & (steps > -0.5) & (steps < 1e7)
    return np.where(sane, np.rint(np.where(sane, steps, 0)).astype(np.int64) + 1, -1)


@dataclass(frozen=True, slots=True)
class Head:
    """First lines of a file: names of columns, if any, and rows as text and as cells."""

    path: str
    dialect: Dialect
    names: list[str]
    header: bytes
    start: int
    lines: list[bytes]
    rows: list[list[bytes]]
    options: OpenOptions

    def column(self, index: int) -> list[bytes]:
        """Return the cells of a column that are not empty, in rows as long as the header where there is one."""
        least = len(self.names) or index + 1
        cells = [row[index] for row in self.rows if len(row) >= least and row[index]]
        return cells or [row[index] for row in self.rows if len(row) > index and row[index]]

    @property
    def usual(self) -> int:
        """Cells of more than half of the rows; 0 where rows differ."""
        counts = Counter(map(len, self.rows))
        return next((cells for cells, rows in counts.items() if 2 * rows > len(self.rows)), 0)

    def units(self, fields: dict[str, int]) -> dict[str, int]:
        """Return the units of the time columns among `fields`; a column that holds no times has none."""
        found: dict[str, int] = {}
        for name in {"record", "stamp", "date"} & fields.keys():
            if self.names and self.names[0].strip().lower() == "%time" and name != "date":
                found[name] = NS
                continue
            column = fields[name]
            unit = time_unit(self.names[column] if self.names else "", self.column(column))
            if unit is not None:
                found[name] = unit
        if "date" in found and found.get("record") == TIME_OF_DAY:
            found["record"] = DATED
        else:
            found.pop("date", None)
        return found

    def unread_times(self, scans: Sequence[Columns]) -> dict[str, str]:
        """Return a note for each topic with a column of times that is not understood."""
        found: dict[str, str] = {}
        for scan in scans:
            for name in sorted({"record", "stamp"} & scan.fields.keys() - scan.units.keys()):
                column = scan.fields[name]
                other = scan.units or {"seconds", "header"} & scan.fields.keys()
                so = "another column tells them" if other else NO_STAMPS
                named = self.names[column] if self.names else str(column + 1)
                value = shown(next(iter(self.column(column)), b"empty"), 30)[1:-1]
                found[scan.topic] = f"times of column `{named}` are not understood ({value}): {so}"
        return found

    def need_geometry(self, name: str) -> None:
        """Raise UnreadableError, with the options that help, where neither file nor options give the bearings."""
        if given_geometry(self.options, 2) is None:
            raise UnreadableError(
                f"{self.path}: CSV ({name}) without geometry: give --angle-min and --angle-increment, or --fov"
                " (radians, or degrees with --degrees)"
            )

    def unknown(self, found: str) -> UnreadableError:
        """Return the error for a table that no layout fits."""
        return UnreadableError(f"{self.path}: {found} is none of the CSV layouts: {'; '.join(LAYOUTS)}")

    def long_layout(
        self, angle: int, distance: int, key: int | None, degrees: bool | None, fields: dict[str, int]
    ) -> Layout:
        """Return the layout of one beam per row; bearings of unknown unit beyond a turn in radians are degrees."""
        notes = []
        if degrees is None:
            numbers = [abs(value) for cell in self.column(angle) if (value := value_of(cell)) is not None]
            degrees = bool(numbers) and max(numbers) > TURN + 0.1
            if degrees:
                notes.append("bearings beyond a turn in radians: taken as degrees")
        scan = Columns(DEFAULT_TOPIC, fields, self.units(fields), first=distance)
        width = len(self.names) or len(self.rows[0])
        return Layout(
            PER_SWEEP if key is None else LONG,
            self.dialect,
            self.start,
            self.header,
            width,
            (scan,),
            angle=angle,
            key=key,
            degrees=degrees,
            notes=tuple(notes),
        )


def read_head(lines: Sequence[bytes], options: OpenOptions, path: str) -> Head:
    """Find the table, its dialect and its names; UnreadableError where there is no table."""
    numbered = [(number, line) for number, line in enumerate(lines, 1) if line.strip()]
    # Spreadsheets name their separator so.
    numbered = numbered[bool(numbered and re.fullmatch(rb'\s*"?sep=."?\s*', numbered[0][1], re.IGNORECASE)) :]
    comment = b""
    while numbered and numbered[0][1].lstrip()[:1] == b"#":
        comment = numbered.pop(0)[1]
    numbered = _sample([(number, line) for number, line in numbered if line.lstrip()[:1] != b"#"])
    if not numbered:
        raise UnreadableError(f"{path}: no data in it, only comments or blank lines")
    dialect = guess_dialect([line for _, line in numbered])
    if dialect is None:
        raise UnreadableError(f"{path}: text, but no table with columns: {shown(numbered[0][1])}")
    # A title above the table has a single cell.
    while len(numbered) > 1 and dialect.separator not in numbered[0][1].strip():
        numbered.pop(0)
    cells = [split_line(line, dialect) for _, line in numbered]
    number, first = numbered[0]
    if is_header(cells[0]):
        names = [*map(_name, cells[0])]
        return Head(path, dialect, names, first, number + 1, [line for _, line in numbered[1:]], cells[1:], options)
    names = []
    if comment:
        words = split_line(comment.lstrip().lstrip(b"#").lstrip(), dialect)
        if len(words) == len(cells[0]) and is_header(words):
            names = [*map(_name, words)]
    return Head(path, dialect, names, b"", number, [line for _, line in numbered], cells, options)


def _name(cell: bytes) -> str:
    """Return the text of a name: in UTF-8, else in GBK where all bytes beyond ASCII are pairs, else in Latin-1."""
    try:
        return cell.decode()
    except UnicodeDecodeError:
        pairs = re.fullmatch(rb"(?:[\0-\x7f]|[\xa1-\xf7][\xa1-\xfe])*", cell)
        return cell.decode("gbk" if pairs else "latin-1", "replace")


def _sample(numbered: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
    size = 0
    for place, (_, line) in enumerate(numbered):
        size += len(line)
        if place >= 2 and (size > SAMPLE_BYTES or place >= SAMPLE_LINES):
            return numbered[:place]
    return numbered


def is_header(cells: Sequence[bytes]) -> bool:
    """Tell whether cells are names: the first one that is not blank is neither a number nor a time."""
    named = [cell for cell in cells if cell]
    return bool(named) and not numeric(named[0]) and time_unit("", [named[0]]) is None


def repeats(cells: Sequence[bytes]) -> bool:
    """Tell whether neighbours share a value, as the beams of one sweep do."""
    return sum(a == b for a, b in pairwise(cells)) > len(cells) // 3


def value_of(cell: bytes) -> float | None:
    """Return the number of a cell; None where it holds none."""
    try:
        return parse_number(cell)
    except ValueError:
        return None


def numeric(cell: bytes, empty: bool = True) -> bool:
    """Tell whether a cell can stand for a number; an empty one counts where `empty` says so."""
    try:
        return parse_number(cell) is not None or empty
    except ValueError:
        return False


def shown(text: bytes, most: int = 60) -> str:
    """Return a piece of text for a message: one line, printable, short."""
    plain = "".join(c if c.isprintable() else "?" for c in text.decode("utf-8", "replace").strip())
    return f"'{plain[:most]}…'" if len(plain) > most else f"'{plain}'"
