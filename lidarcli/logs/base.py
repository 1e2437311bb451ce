"""The interface of an open log, and the types that all containers share."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from typing import NamedTuple, Protocol, Self

import numpy as np

from lidarcli.display.texts import Routine
from lidarcli.errors import OptionError
from lidarcli.options.choices import ECHOES, SEGMENTS
from lidarcli.ros import foxglove
from lidarcli.sweeps.findings import Finding
from lidarcli.sweeps.types import RawSweeps
from lidarcli.system.records import dataclass, field, replace

LASERSCAN = "sensor_msgs/msg/LaserScan"
MULTI_ECHO = "sensor_msgs/msg/MultiEchoLaserScan"
PROTOBUF_SCANS = ("ros.sensor_msgs.LaserScan", "gz.msgs.LaserScan", "ignition.msgs.LaserScan")
SCAN_TYPES = frozenset({LASERSCAN, MULTI_ECHO, *PROTOBUF_SCANS, foxglove.SCAN})

POINTCLOUD2 = "sensor_msgs/msg/PointCloud2"
CLOUD_TYPES = frozenset({POINTCLOUD2, foxglove.CLOUD})
"""Point clouds, of which `OpenOptions.slice` makes sweeps."""

POSE_TYPES = frozenset(
    {
        "nav_msgs/msg/Odometry",
        "tf2_msgs/msg/TFMessage",
        "tf/msg/tfMessage",
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        foxglove.POSE,
        foxglove.TRANSFORM,
    }
)

STATIC = "/tf_static"
"""Topic of the transforms that are sent once and for all."""

POSED_TYPES = POSE_TYPES | {foxglove.SCAN}
"""With those of sweeps that may hold the pose of each."""

MAX_MESSAGE = 64 << 20
"""Longest message that is read into memory [bytes]: any sweep, and clouds of a million points and more."""
MAX_BEAMS = 400_000
"""A sweep that declares more beams than this is refused: no 2D LiDAR comes near it."""


def ros_type(name: str) -> str:
    """Return a message type in one spelling: `sensor_msgs/LaserScan` → `sensor_msgs/msg/LaserScan`.

    >>> ros_type("sensor_msgs/LaserScan")
    'sensor_msgs/msg/LaserScan'
    """
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic of a log; `messages` is None where they were not counted."""

    name: str
    type: str
    """As `ros_type` spells it, or the schema's name (`foxglove.LaserScan`)."""
    encoding: str
    """`cdr`, `ros1`, `json`, `protobuf`, `csv` or `carmen`."""
    messages: int | None = None
    read_as: str = field(default="", compare=False)
    """Type as which messages are read as sweeps, where they are; a LaserScan of messages that begin with one."""
    sliced: bool = False
    """True for point clouds that are read as sweeps."""

    @property
    def is_scan(self) -> bool:
        """True if sweeps are read from this topic."""
        return self.type in SCAN_TYPES or self.sliced or self.read_as != ""

    @property
    def is_laserscan(self) -> bool:
        """True for a LaserScan of ROS."""
        return self.encoding in ("cdr", "ros1") and self.type == LASERSCAN


@dataclass(frozen=True, slots=True)
class Damage:
    """A part of a log that could not be read: one line for the user."""

    place: str
    """For example `byte 1234`, `line 12`, `chunk at byte 99`, `metadata.yaml`."""
    cause: str


class Message(NamedTuple):
    """One raw message of a topic that is not a LaserScan (poses), undecoded."""

    topic: str
    type: str
    encoding: str
    record_ns: int
    data: bytes


PLANAR = "planar"
"""Encoding of poses of text logs: x, y and yaw, as `PLANAR_POSE` and the names of the parent frame, NUL and child frame."""
PLANAR_POSE = np.dtype([("stamp_ns", "<i8"), ("x", "<f8"), ("y", "<f8"), ("yaw", "<f8")])


@dataclass(slots=True)
class ReadReport:
    """Findings of one pass over a log. The caller of the pass owns the report; readers append to it."""

    damage: list[Damage] = field(default_factory=list)
    """Damaged parts (exit code 3). At most `MAX_DAMAGE` are kept, the rest is counted in `damage_more`."""
    damage_more: int = 0
    refused: Counter[tuple[str, str]] = field(default_factory=Counter)
    """(topic, cause) → messages that were whole but cannot be a sweep (NaN geometry, count beyond the message)."""
    notes: list[str] = field(default_factory=list)
    """Choices the reader made that a user should know (the CSV layout taken, a missing metadata.yaml)."""
    segments: set[str] = field(default_factory=set)
    no_return: dict[str, float] = field(default_factory=dict)
    """Topic → the range [m] from which on there is no return, by a pile of values (`logs.piles`)."""
    unread: dict[str, str] = field(default_factory=dict)
    """Topic → a note on a column of times that is not understood."""
    numbered: set[str] = field(default_factory=set)
    """Topics whose bearings follow from the number of a beam alone: the log has none."""
    doubts: dict[str, tuple[Finding, ...]] = field(default_factory=dict)
    """Topic → findings on how its ranges are evaluated, and on what looks wrong in its sweeps."""

    takes_degrees: bool = False
    """True for a pass over a log whose angles are known to be degrees: steps too large for radians are not refused."""

    MAX_DAMAGE = 20

    def add_damage(self, place: str, cause: str) -> None:
        """Record damage, bounded whatever a hostile file does."""
        if len(self.damage) < ReadReport.MAX_DAMAGE:
            self.damage.append(Damage(place, cause))
        else:
            self.damage_more += 1

    def add_new(self, other: ReadReport) -> None:
        """Take over what another pass over the same log has met, of its damage only what this report lacks."""
        met = {part.place for part in self.damage}
        self.add(replace(other, damage=[], damage_more=0, doubts={}))
        for part in other.damage:
            if part.place not in met:
                self.add_damage(part.place, part.cause)
        if not met:
            # Past the limit nobody knows which parts are the same; where this pass met none, none are.
            self.damage_more += other.damage_more

    def add(self, other: ReadReport, within: str = "") -> None:
        """Take over what else has been met; `within` names the part of the log in which the places of `other` are."""
        for part in other.damage:
            self.add_damage(within + part.place, part.cause)
        self.damage_more += other.damage_more
        self.refused.update(other.refused)
        self.notes += [note for note in other.notes if note not in self.notes]
        self.segments |= other.segments
        self.numbered |= other.numbered
        self.no_return.update(other.no_return)
        self.unread.update(other.unread)
        for topic, findings in other.doubts.items():
            self.add_doubts(topic, findings)

    def add_doubts(self, topic: str, findings: Iterable[Finding]) -> None:
        """Add findings on the sweeps of a topic, each message once."""
        known = {found.message: found for found in (*self.doubts.get(topic, ()), *findings)}
        if known:
            self.doubts[topic] = tuple(known.values())

    def findings(self) -> list[Finding]:
        """Return the findings on the sweeps, topic by topic."""
        return [found for findings in self.doubts.values() for found in findings]

    def doubted(self) -> list[str]:
        """Return the findings on the sweeps as notes, topic by topic."""
        return [Routine(found.message) if found.level == "hint" else found.message for found in self.findings()]


@dataclass(frozen=True, slots=True)
class Slice:
    """Part of a point cloud that becomes a sweep: points of some heights, the nearest in each direction."""

    low: float
    high: float
    bins: int
    limits: tuple[float, float] | None = None
    """Least and greatest distance that counts [m]; nearer points belong to the robot."""


@dataclass(frozen=True, slots=True)
class OpenOptions:
    """Geometry and units that a log does not contain. Angles in radians, ranges in metres."""

    angle_min: float | None = None
    angle_increment: float | None = None
    fov: float | None = None
    range_max: float | None = None
    range_scale: float = 1.0
    """Factor from the log's unit to metres (`--range-unit mm`: 0.001)."""
    angle_scale: float = 1.0
    """Factor from the unit of the angles in the log to radians (`--degrees` without another angle)."""
    slice: Slice | None = None
    """Slice of point clouds that becomes a sweep; None: point clouds are not read."""
    echo: str = ECHOES[0]
    """Echo taken of a beam that has several: one of `choices.ECHOES`."""
    segments: str = SEGMENTS[0]
    """Use of messages that are segments of a turn: one of `choices.SEGMENTS`."""
    columns: tuple[str, ...] = ()
    """Names of the columns of a CSV, in place of its own, as `--columns` takes them; empty for its own."""
    used: set[str] = field(default_factory=set, compare=False)
    """Fields that had an effect on the log that is read with them."""

    def __post_init__(self) -> None:
        """Refuse a word without a meaning (`OptionError`)."""
        if self.segments not in SEGMENTS:
            raise OptionError(f"--segments: '{self.segments}' is not one of {', '.join(SEGMENTS)}")


class Closing:
    """An object that is closed at the end of a `with`."""

    def close(self) -> None:
        """Release what is open."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class Log(Protocol):
    """One open log. Closing it releases files; using it as a context manager closes it.

    A constructor reads as little as it needs to know the format and raises `UnreadableError` when nothing at all can be
    read. Later damage never raises: it goes to the report that the caller of a pass (`scans`, `messages`) hands in, and
    everything readable is still yielded. A report holds all that its pass has met, and what opening has met before.

    A log may be read as often as one likes; a second pass over a stream raises `UnreadableError`. Sweeps without limits of
    their own have 0 and infinity, those without a time of recording their stamp. A reader of text applies all
    `OpenOptions` itself; for `Format.in_metres` the pipeline applies `range_scale`, and messages hold their `range_max`.
    """

    path: str
    """As the user wrote it; `-` for standard input."""
    format: str
    """For people: `Format.kind`, and what else distinguishes kinds: `ros2 bag (sqlite3)`, `csv (rostopic echo -p)`."""

    @property
    def compression(self) -> str:
        """`none`, `lz4`, `zstd`, `bz2`, `gzip`, or several joined by `+`."""

    @property
    def size(self) -> int | None:
        """Bytes of the source; None where unknown (a pipe)."""

    @property
    def position(self) -> int:
        """Position of the last pass in the source [bytes]."""

    def topics(self) -> list[Topic] | None:
        """Return all topics where the log has an index of them, else None (a pipe, a log that lost its summary)."""

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Yield blocks of sweeps in log order within each topic; `topics` None means every LaserScan topic."""

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """Yield raw messages of the given types in log order (poses)."""

    def close(self) -> None: ...

    def __enter__(self) -> Log: ...

    def __exit__(self, *exc: object) -> None: ...
