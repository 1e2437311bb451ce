"""Sweeps, the one type that all rooms share; and records of arrays, whose columns in tables stand on their fields.

A log is a stream of sweeps; sweeps travel in batches of 2-D arrays, row = sweep, column = beam. Sensors whose
beam count changes from turn to turn stay in one batch: short rows are padded, padding has its own status.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from enum import IntEnum
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, SupportsIndex, TypeVar, dataclass_transform

import numpy as np
from numpy.typing import NDArray

from lidarcli.display.texts import Facts, counted, moment, shown, span
from lidarcli.system.records import MISSING, dataclass, declared, field, replace

if TYPE_CHECKING:
    import pandas as pd

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
Int8 = NDArray[np.int8]
UInt8 = NDArray[np.uint8]
UInt64 = NDArray[np.uint64]
Bool = NDArray[np.bool_]

TURN = 2.0 * np.pi

Unit = Literal["", "1", "m", "rad", "s", "ns", "m/s", "rad/s", "Hz", "1/s", "byte", "m²"]
"""Units as tables and reports spell them: `1` for a count, an index or a share, empty for text, yes and no."""
Per = Literal["object", "vertex", "face", "offset", "sweep", "beam", "track", "trajectory"]
"""Entries of an array: one per object, vertex, face, sweep, beam (S, B) or track, or per track and sweep;
offsets have one more than objects."""


SINGLE: tuple[Unit, ...] = ("m", "rad", "1")
"""Units of numbers that tables keep in single precision: a range has 24 bits, and so has what is measured by ranges.

Times, velocities and covariances stay double, and what is declared so: places and headings in the world.
"""


class Column(NamedTuple):
    """Declaration of a column, which schemas, compiled loops, checks and docs follow."""

    name: str
    kind: Any
    """Type in the table: of numpy (`float32`), `text` (a dictionary), `string`, `stamp`, `bool`, or a type of Arrow."""
    unit: Unit
    meaning: str
    words: tuple[str, ...] = ()
    """Names that the array has codes for."""
    nullable: bool = False
    infinite: bool = False
    per: Per | Literal[""] = ""
    """Entries of the array in the record; empty for a column that is not of a record."""
    field: str = ""
    """Name of the array in the record."""
    dtype: str = ""
    """Type of the array; codes stand for words, for instance."""


def column(
    unit: Unit,
    meaning: str,
    *,
    per: Per = "object",
    name: str = "",
    kind: str = "",
    words: tuple[str, ...] = (),
    nullable: bool = False,
    default: Any = MISSING,
) -> Any:
    """Declare the column of a field of a record. Name and type are by default those of the field.

    The default name drops what the entries and the unit say already: `vertex_theta` is `theta`, `first_stamp_ns` is
    `first_stamp`. The default type of a double follows from its unit (`SINGLE`).
    """
    kind = kind or ("text" if words else "stamp" if unit == "ns" else "")
    known = Column(name, kind, unit, meaning, words, nullable, per=per)
    # mypy takes `default` for a value of the field.
    return field(default=default, metadata={"column": known})


def columns_of(cls: type) -> dict[str, Column]:
    """Return the columns that a record declares: name of the field → column."""
    found = {}
    for own, each in declared(cls).items():
        known: Column | None = each.metadata.get("column")
        if known is not None:
            name = known.name or own.removeprefix(f"{known.per}_").removesuffix("_ns")
            # The annotation is text: `Float32 | None` is an array of float32.
            dtype = cls.__annotations__[own].removesuffix(" | None").lower()
            kind = "float32" if dtype == "float64" and known.unit in SINGLE else dtype
            found[own] = known._replace(name=name, kind=known.kind or kind, field=own, dtype=dtype)
    return found


T = TypeVar("T")


@dataclass_transform(frozen_default=True, eq_default=False, field_specifiers=(column,))
def record(cls: type[T]) -> type[T]:
    """A dataclass whose fields are arrays: they stay what they are, as the type checker ensures.

    Arrays have no equality that is true or false, so neither have records. Without that, their text and a guard at run
    time a class is made in a third of the time; there are some forty of them, and most runs are short.
    """
    return dataclass(slots=True, eq=False, repr=False)(cls)


class Status(IntEnum):
    """Status of a beam: it has a range, or why it has none (ROS REP 117, and what drivers really write)."""

    VALID = 0
    NO_RETURN = 1
    TOO_CLOSE = 2
    INVALID = 3
    MASKED = 4
    """Its range lies under the mask of the robot itself (`masks`)."""
    PADDING = 5


STATUSES = tuple(status.name.lower() for status in Status if status != Status.PADDING)
"""Names of `Status` by code; padding is no beam and has none."""


def worth_telling(statuses: Mapping[str, int]) -> dict[str, int]:
    """Return the numbers of beams by status for people, who need not know of masks where there is none."""
    return {name: count for name, count in statuses.items() if count or name != Status.MASKED.name.lower()}


def median(values: Float64 | Int64) -> Float64:
    """Return the median of the rows of an array without NaN; that of numpy would import the masked arrays."""
    ordered = np.sort(values, axis=0)
    middle: Float64 = 0.5 * (ordered[(len(values) - 1) // 2] + ordered[len(values) // 2])
    return middle


def spared(sweeps: int) -> int:
    """Return how many sweeps may show nothing where all should show something: one, or one in a hundred up to ten."""
    return max(1, min(sweeps // 100, 10))


class Closure(IntEnum):
    """Kind of closure of a sweep to a full turn (docs/formalism.md, *Full turn*)."""

    OPEN = 0
    """A partial view: the first beam has no predecessor."""
    CLOSED = 1
    """N |Δθ| ≈ 2π: N distinct bearings."""
    SHARED = 2
    """(N - 1) |Δθ| ≈ 2π: the first and the last beam share one bearing, which counts once."""


@record
class RawSweeps:
    """Sweeps of one topic as a log holds them, in log order, before any range is judged.

    Shapes: S sweeps, B = the largest beam count of the block. Angles in radians, ranges in metres, times in int64
    nanoseconds since the epoch of their clock. `ranges[i, beams[i]:]` is padding of any value.
    """

    topic: str
    frame_ids: tuple[str, ...]
    """Distinct frame names of the block."""
    frame: Int32
    """(S,) index into `frame_ids`."""
    stamp_ns: Int64
    """(S,) header stamp; 0 where the header has none."""
    record_ns: Int64
    """(S,) time at which the log recorded the message; equal to `stamp_ns` where the log has none (CSV)."""
    angle_min: Float64
    angle_increment: Float64
    range_min: Float32
    range_max: Float32
    beams: Int32
    """(S,) number of ranges of each sweep."""
    ranges: Float32
    """(S, B)"""
    time_increment: Float32 | None = None
    """(S,) from beam to beam [s]; None where the log does not tell."""
    scan_time: Float32 | None = None
    """(S,) from sweep to sweep [s]; None where the log does not tell."""
    intensities: Float32 | None = None
    """(S, B) how strong each return is, in the sensor's own unit; NaN where none is told. None: no sweep tells any."""
    angle_max: Float64 | None = None
    """(S,) bearing of the last beam [rad] as the log tells it; the increment counts. None where it does not tell."""
    mended_ns: Int64 | None = None
    """(S,) time of each sweep where some stamps are no times among the others (`logs.clock.mended`); None: all are."""
    run: int = 1
    """Run of the log that they are of, counted from 1: the clock starts anew in each."""

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @property
    def time_ns(self) -> Int64:
        """(S,) time of each sweep: its header stamp, or the record time where the header has none, or a mended one."""
        if self.mended_ns is not None:
            return self.mended_ns
        return np.where(self.stamp_ns == 0, self.record_ns, self.stamp_ns)

    def rows(self, index: slice | NDArray[np.intp] | Bool) -> RawSweeps:
        """Return a block of the rows of `index` alone."""
        picked = {name: getattr(self, name)[index] for name in _ROW_FIELDS}
        given = {name: values[index] for name in _OPTIONAL if (values := getattr(self, name)) is not None}
        return replace(self, **picked, **given)

    def narrowed(self, width: int) -> RawSweeps:
        """Return the sweeps in fewer columns, which none of them exceeds."""
        intensities = None if self.intensities is None else self.intensities[:, :width]
        return replace(self, ranges=self.ranges[:, :width], intensities=intensities)


_TIMES = ("time_increment", "scan_time", "angle_max")
_OPTIONAL = (*_TIMES, "intensities", "mended_ns")
_ROW_FIELDS = (
    "frame",
    "stamp_ns",
    "record_ns",
    "angle_min",
    "angle_increment",
    "range_min",
    "range_max",
    "beams",
    "ranges",
)


def concatenate(blocks: list[RawSweeps]) -> RawSweeps:
    """Join blocks of one topic into one, padded to the widest, with one list of frames."""
    if len(blocks) == 1:
        return blocks[0]
    frame_ids = tuple(dict.fromkeys(name for block in blocks for name in block.frame_ids))
    code = {name: i for i, name in enumerate(frame_ids)}
    frames = [np.array([code[name] for name in block.frame_ids], np.int32)[block.frame] for block in blocks]
    joined = {
        name: np.concatenate([getattr(block, name) for block in blocks])
        for name in _ROW_FIELDS
        if name not in ("frame", "ranges")
    }
    for name in _TIMES:
        values = [some for block in blocks if (some := getattr(block, name)) is not None]
        if len(values) == len(blocks):
            joined[name] = np.concatenate(values)
    if any(block.mended_ns is not None for block in blocks):
        joined["mended_ns"] = np.concatenate([block.time_ns for block in blocks])
    if any(block.intensities is not None for block in blocks):
        joined["intensities"] = _stacked(blocks, "intensities")
    return RawSweeps(
        topic=blocks[0].topic,
        frame_ids=frame_ids,
        frame=np.concatenate(frames),
        ranges=_stacked(blocks, "ranges"),
        run=blocks[0].run,
        **joined,
    )


def _stacked(blocks: list[RawSweeps], name: str) -> Float32:
    """Return the values of all beams, one block below the other; NaN where a block has none."""
    width = max(block.ranges.shape[1] for block in blocks)
    stacked = np.empty((sum(map(len, blocks)), width), np.float32)
    row = 0
    for block in blocks:
        rows, columns = block.ranges.shape
        values = getattr(block, name)
        stacked[row : row + rows, :columns] = np.nan if values is None else values
        stacked[row : row + rows, columns:] = np.nan
        row += rows
    return stacked


@shown
@record
class SweepPoses:
    """Poses of the sensor at the first beams of S sweeps, seen from above, in the world frame. NaN where unknown."""

    x: Float64
    """(S,) metres."""
    y: Float64
    yaw: Float64
    """(S,) direction of the sensor's x axis [rad]."""
    upside_down: Bool
    """(S,) whether the sensor hangs head down, so that its bearings run clockwise in the world."""
    way: Float64 | None = None
    """(S, 3) way in x, y [m] and yaw [rad] from the first beam to the last; None: sweeps take no time."""
    reverse: Bool | None = None
    """(S,) True where the last beam is taken first, at the header stamp; None: nowhere."""
    absent: Bool | None = None
    """(S,) True for sensors of which nothing ever tells a pose, as if there were none; None: nowhere."""

    def facts(self) -> Facts:
        """Return the description of these poses."""
        known = ~np.isnan(self.x)
        turned = int(np.count_nonzero(self.upside_down & known))
        rows = [
            ("known", f"for {counted(int(np.count_nonzero(known)), 'sweep')}"),
            ("x", span(self.x[known].tolist(), ".2f", "m")),
            ("y", span(self.y[known].tolist(), ".2f", "m")),
            ("yaw", span(np.degrees(self.yaw[known]).tolist(), ".2f", "deg")),
            ("head down", f"in {counted(turned, 'sweep')}" if turned else "never"),
        ]
        if self.way is not None:
            gone = np.hypot(*self.way[known, :2].T)
            rows.append(("way", span(gone[~np.isnan(gone)].tolist(), ".3f", "m from the first beam to the last")))
        return Facts(f"of {counted(len(self.x), 'sweep')}", tuple(rows))

    def rows(self, index: NDArray[np.intp] | Int64 | slice) -> SweepPoses:
        """Return the poses of `index`, which may repeat."""
        way = None if self.way is None else self.way[index]
        reverse, absent = (None if one is None else one[index] for one in (self.reverse, self.absent))
        return SweepPoses(self.x[index], self.y[index], self.yaw[index], self.upside_down[index], way, reverse, absent)

    def at_stamp(self) -> SweepPoses:
        """Return the poses at the header stamps: those of the first beams, or of the last ones in reverse."""
        if self.reverse is None:
            return self
        return self.during(np.arange(len(self.x)), self.reverse.astype(np.float64))

    def during(self, row: Int64 | NDArray[np.intp], share: Float64) -> SweepPoses:
        """Return the poses during sweeps `row` (K,), at a `share` (K,) of their time; the sensor moves evenly meanwhile."""
        here = self.rows(row)
        if here.way is None:
            return here
        dx, dy, turn = (here.way * share[:, None]).T
        return SweepPoses(here.x + dx, here.y + dy, here.yaw + turn, here.upside_down)

    def own_way(self) -> Float64 | None:
        """Return the way during each sweep in the sensor frame of its first beam (S, 3): ahead, left [m], turned [rad]."""
        if self.way is None:
            return None
        dx, dy, turn = self.way.T
        side = np.where(self.upside_down, -1.0, 1.0)
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        way = np.column_stack([cos * dx + sin * dy, side * (cos * dy - sin * dx), side * turn])
        # A sensor without a pose is taken as standing.
        way[np.isnan(way)] = 0.0
        return way

    def to_world(
        self, row: Int64 | NDArray[np.intp], x: Float64, y: Float64, yaw: Float64, share: Float64 | None = None
    ) -> tuple[Float64, Float64, Float64]:
        """Transform points and undirected lines from the sensor frame of sweep `row` (K,) to the world frame.

        With a `share` (K,) they are seen from where the sensor was at that share of the time of the sweep.
        Returns x, y [m] and the direction in (-π/2, π/2] [rad], (K,) each.
        """
        here = self.rows(row) if share is None else self.during(row, share)
        side = np.where(here.upside_down, -1.0, 1.0)
        cos, sin = np.cos(here.yaw), np.sin(here.yaw)
        left = side * y
        world_yaw = 0.5 * np.pi - (0.5 * np.pi - (here.yaw + side * yaw)) % np.pi
        return here.x + cos * x - sin * left, here.y + sin * x + cos * left, world_yaw


@shown
@record
class SweepBatch:
    """S sweeps of one topic in log order, their ranges judged. Rows are sweeps, columns are beams.

    What has a value for each sweep or beam is an attribute; `bearings`, `points` and `seconds` are worked out at each use.
    Angles are radians, ranges metres, times nanoseconds since the epoch.

    Attributes
    ----------
    topic : name of the LaserScan topic
    frame_ids : distinct names of the frames of these sweeps
    frame : (S,) int32, index into `frame_ids`
    sweep : (S,) int64, index of the sweep within its topic, in log order, from 0
    stamp_ns : (S,) int64, header stamp, or the record time where the header has none
    record_ns : (S,) int64, when the log recorded it
    angle_min, angle_increment : (S,) float64, bearing of the first beam, and from beam to beam [rad]
    range_min, range_max : (S,) float32, limits of the sensor [m]
    beams : (S,) int32, number of beams of each sweep; B is the greatest
    ranges : (S, B) float32, metres; NaN wherever `status` is not VALID
    status : (S, B) uint8, a `Status`; PADDING from `beams[i]` on
    closure : (S,) uint8, a `Closure`: whether the sweep is a full turn; derived from the geometry
    duration : (S,) float64, from the first beam to the last [s], negative where the last is taken first; None: nobody tells
    first_ns : stamp of the first sweep of the topic in the log, whether or not it is among these
    intensities : (S, B) float32, how strong each return is, in the sensor's own unit; NaN where the log does not tell, and
        in sweeps where all are 0, which nobody has measured. None: no sweep of these has any
    poses : where the sensor was (`SweepPoses`), where that has been asked for and the log tells
    observed : (S,) True where the sweep shows anything: it has a range, and does not repeat an older sweep (docs/tables.md)
    still : (S,) True where the sensor stood since the sweep before, where that is known
    fits : (S,) True where the sweeps do not contradict `poses`, or the user named them; None: nobody has looked
    log : name of the log that it was read from, where that has been told
    run : run of the log that these sweeps are of, from 1: the clock starts anew in each (docs/poses.md)
    robot : topics and frames of the sensors of a robot, this one among them, whose tracks are one; empty: its own are
    """

    topic: str
    frame_ids: tuple[str, ...]
    frame: Int32
    sweep: Int64
    stamp_ns: Int64
    record_ns: Int64
    angle_min: Float64
    angle_increment: Float64
    range_min: Float32
    range_max: Float32
    beams: Int32
    ranges: Float32
    status: UInt8
    closure: UInt8 = field(default_factory=lambda: np.empty(0, np.uint8))
    observed: Bool = field(default_factory=lambda: np.empty(0, np.bool_))
    duration: Float64 | None = None
    first_ns: int = 0
    intensities: Float32 | None = None
    poses: SweepPoses | None = None
    still: Bool | None = None
    fits: Bool | None = None
    log: str = ""
    run: int = 1
    robot: tuple[tuple[str, str], ...] = ()

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def __getitem__(self, index: SupportsIndex | slice | list[int] | NDArray[Any]) -> SweepBatch:
        """Return a batch of one sweep, or of those of a slice (which shares their values), rows or truth values (S,)."""
        if isinstance(index, slice | list | np.ndarray):
            return self.rows(np.asarray(index) if isinstance(index, list) else index)
        if not isinstance(index, SupportsIndex):
            raise TypeError(f"batch[{index!r}]: sweeps are taken by their row, a slice, or an array of rows")
        row = int(index.__index__())
        if not -len(self) <= row < len(self):
            raise IndexError(f"batch[{row}]: the batch has {counted(len(self), 'sweep')}")
        row %= len(self)
        return self.rows(slice(row, row + 1))

    def __iter__(self) -> Iterator[SweepBatch]:
        """Yield each sweep as a batch of its own."""
        return (self.rows(slice(row, row + 1)) for row in range(len(self)))

    def rows(self, index: NDArray[np.intp] | Int64 | slice) -> SweepBatch:
        """Return a batch of the sweeps of `index` alone: (K,) rows, truth values (S,), or a slice."""
        if not isinstance(index, slice) and np.ndim(index) != 1:
            raise TypeError(f"rows are given as an array, a list or a slice, not as {index!r}: rows([{index!r}])")
        picked = {name: getattr(self, name)[index] for name in _BATCH_ROW_FIELDS}
        picked["poses"] = None if self.poses is None else self.poses.rows(index)
        for name in ("duration", "intensities", "still", "fits"):
            values = getattr(self, name)
            picked[name] = None if values is None else values[index]
        return replace(self, **picked)

    def by_frame(self) -> Iterator[tuple[str, Int64, SweepBatch]]:
        """Yield the sweeps of each frame: its name, its rows, and a batch of them."""
        # `np.unique` would import the masked arrays, which costs every short run.
        for code in np.flatnonzero(np.bincount(self.frame)).tolist():
            rows = np.flatnonzero(self.frame == code)
            yield self.frame_ids[code], rows, self if len(rows) == len(self) else self.rows(rows)

    @property
    def width(self) -> int:
        """B, the number of columns."""
        return int(self.ranges.shape[1])

    @property
    def stamps(self) -> NDArray[np.datetime64]:
        """(S,) datetime64[ns] in UTC: `stamp_ns`, as pandas and matplotlib take times."""
        return self.stamp_ns.view("datetime64[ns]")

    def facts(self) -> Facts:
        """Return the description of these sweeps."""
        real = self.status != Status.PADDING
        counts = np.bincount(self.status[real], minlength=len(Status)).tolist()
        numbers = worth_telling(dict(zip(STATUSES, counts, strict=False)))
        last = self.angle_min + self.angle_increment * np.maximum(self.beams - 1, 0)
        angles = np.degrees(np.concatenate([self.angle_min, last]))
        posed = 0 if self.poses is None else int(np.count_nonzero(~np.isnan(self.poses.x)))
        # Clocks may jump back.
        times = [moment(int(stamp)) for stamp in self.stamp_ns[[0, -1]]] if len(self) else []
        rows = [
            ("log", self.log or "not told"),
            ("topic", self.topic),
            ("frame", ", ".join(name or "without a name" for name in self.frame_ids)),
            ("sweeps", span(self.sweep.tolist(), "d", f"({counted(len(self), 'sweep')})")),
            ("time", " to ".join(times) or "none"),
            ("beams", span(self.beams.tolist(), ",", "per sweep")),
            ("view", span(angles.tolist(), ".2f", "deg")),
            ("ranges", span(self.ranges[self.status == Status.VALID].tolist(), ".3f", "m")),
            ("status", ", ".join(f"{count:,} {name}" for name, count in numbers.items())),
            ("poses", f"known for {counted(posed, 'sweep')}" if posed else "none"),
        ]
        if self.intensities is not None:
            known = self.intensities[np.isfinite(self.intensities)].tolist()
            rows.insert(-1, ("intensities", span(known, "g", "in the sensor's unit")))
        return Facts(f"{self.topic}: {counted(len(self), 'sweep')} x {counted(self.width, 'beam')}", tuple(rows))

    @property
    def seconds(self) -> Float64:
        """(S,) since the first sweep of the topic [s]; below 0 where the sensor's clock was set back."""
        seconds: Float64 = (self.stamp_ns - self.first_ns) / 1e9
        # A broken header may be farther away than int64 can tell.
        beyond = (self.stamp_ns < self.first_ns) != (seconds < 0)
        if beyond.any():
            seconds[beyond] = self.stamp_ns[beyond] / 1e9 - self.first_ns / 1e9
        return seconds

    @property
    def bearings(self) -> Float64:
        """(S, B) θ_n = angle_min + n angle_increment [rad], also for padding."""
        columns = np.arange(self.width)
        return self.angle_min[:, None] + self.angle_increment[:, None] * columns

    @property
    def points(self) -> Float64:
        """(S, B, 2) where each beam ended in the sensor frame: x ahead, y to the left [m]; NaN where it has no range."""
        bearings = self.bearings
        points: Float64 = self.ranges[..., None] * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
        return points

    def to_pandas(self) -> pd.DataFrame:
        """One row for each beam: sweep, stamp, beam, bearing [rad], range [m], status, intensity, x, y [m]."""
        # Only data frames need this import, which takes long.
        import pandas as pd

        row, beam = np.nonzero(self.status != Status.PADDING)
        x, y = self.points[row, beam].T
        return pd.DataFrame(
            {
                "sweep": self.sweep[row],
                "stamp": pd.DatetimeIndex(self.stamps[row], tz="UTC"),
                "beam": beam,
                "bearing": self.bearings[row, beam],
                "range": self.ranges[row, beam],
                "status": pd.Categorical.from_codes(self.status[row, beam], categories=pd.Index(STATUSES)),
                "intensity": np.float32(np.nan) if self.intensities is None else self.intensities[row, beam],
                "x": x,
                "y": y,
            }
        )

    def all_shares(self) -> Float64:
        """(S, B) the share of the time of its sweep that has passed at each beam; above 1 for padding."""
        return self.shares(np.arange(len(self))[:, None], np.arange(self.width))

    def shares(self, row: Int64 | NDArray[np.intp], beam: Float64 | Int64 | Int32 | NDArray[np.intp]) -> Float64:
        """The share of the time of sweep `row` that has passed at `beam`, of any shape: 0 for the first, 1 for the last."""
        shares: Float64 = beam / np.maximum(self.beams[row] - 1.0, 1.0)
        return shares


_BATCH_ROW_FIELDS = (*_ROW_FIELDS, "sweep", "status", "closure", "observed")
