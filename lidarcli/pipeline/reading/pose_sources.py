"""Poses of a log: the options for them, the first pass that finds them, and their delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lidarcli.choices import BEAM_ORDERS, MATCH
from lidarcli.errors import NoScanError, OptionError
from lidarcli.logs.base import POSE_TYPES, POSED_TYPES, Log, ReadReport, Topic
from lidarcli.pipeline.inputs.sources import read_pose_messages

if TYPE_CHECKING:
    from lidarcli.pose.sources import GivenPaths, PoseSources

SECOND = 1e-9
NONE = "none"
"""Value of `--pose` for no poses at all."""
MOST_DELAY = 3600.0
"""Greatest `--pose-delay` [s], either way: what is more is another clock."""

_ODOMETRY = "odom"
"""Part of the names of worlds that begin anew in every run."""


def of_one_run(world: str) -> bool:
    """Tell whether a world frame begins anew in every run: that of odometry, or of a path that was matched.

    >>> [of_one_run(name) for name in ("odom", "robot_0/odom", "match", "map")]
    [True, True, True, False]
    """
    return _ODOMETRY in world or world == MATCH


class Need(Enum):
    """Sensors whose path a command needs."""

    TOLD = "told"
    """None but those that the log tells."""
    MOVING = "moving"
    """Those of moving sensors as well."""
    ALL = "all"
    """Those of all sensors."""


@dataclass(frozen=True, slots=True)
class PoseOptions:
    """Options for the poses of sweeps: their source, their delay and their use."""

    source: str | None = None
    """Topic of the poses; `none` for no poses; `match` for poses matched from the sweeps; None: the best of the log."""
    file: str | None = None
    """Trajectory of the sensor (TUM), instead of what the log tells."""
    delay: float | None = None
    """Time after its header stamp at which the pose of a sweep is taken [s]; None: what fits the sweeps."""
    order: str = BEAM_ORDERS[0]
    """Order in which the beams of a sweep are sent, of `BEAM_ORDERS`."""
    deskew: bool = True
    """True to place every beam by the pose at its own time, where headers tell how long a sweep takes."""

    def __post_init__(self) -> None:
        """Refuse options that exclude each other."""
        if self.source is not None and self.file is not None:
            raise OptionError(f"--pose {self.source} and --poses {self.file} exclude each other: leave one out")
        if self.delay is None:
            return
        if not abs(self.delay) <= MOST_DELAY:
            raise OptionError(f"--pose-delay: {self.delay:g} s is not within {MOST_DELAY:,.0f} s")
        if self.source == NONE and self.delay:
            raise OptionError("--pose-delay is for poses, and --pose none leaves them out")
        if self.source == MATCH and self.delay:
            raise OptionError("--pose-delay is for poses of the log, and --pose match finds them in its sweeps")

    def as_dict(self) -> dict[str, Any]:
        """Return the options that are not the default, as plain values, for the tables' metadata."""
        asked = {"pose": self.source, "poses": self.file and Path(self.file).name}
        told: dict[str, Any] = {name: value for name, value in asked.items() if value is not None}
        if self.delay:
            told["pose_delay"] = self.delay
        if self.order != BEAM_ORDERS[0]:
            told["beam_order"] = self.order
        return told if self.deskew else told | {"deskew": False}


NO_POSES = PoseOptions(NONE)


@dataclass(frozen=True, slots=True)
class FoundPoses:
    """Pose sources of a log, with the notes and the report of reading them."""

    sources: PoseSources | GivenPaths
    notes: tuple[str, ...] = ()
    report: ReadReport = field(default_factory=ReadReport)
    """Damage and refused messages of the pass over their messages."""

    def together(self, sweeps: ReadReport) -> ReadReport:
        """Return the report of both passes, over poses and sweeps, with each damaged part once."""
        both = ReadReport()
        both.add(sweeps)
        both.add_new(self.report)
        return both


def find_poses(log: Log, options: PoseOptions | None = None) -> FoundPoses | None:
    """Read the poses of a log that has some and can be read twice, or those of a file.

    Raises
    ------
    NoScanError
        The topic that is wanted is not there.
    OptionError
        The sweeps cannot be matched, because the log can be read only once.
    UnreadableError
        The trajectory is none.
    """
    options = options or PoseOptions()
    if options.source == NONE:
        return None
    if options.file is not None:
        from lidarcli.pose.sources import GivenPaths
        from lidarcli.pose.tracks import read_trajectory

        return FoundPoses(GivenPaths((read_trajectory(Path(options.file)),)))
    if options.source == MATCH:
        if log.size is None:
            raise OptionError("--pose match reads a log twice, and a pipe is read only once: give the file's name")
        return None
    wanted = options.source
    listed = log.topics()
    if listed is None or log.size is None:
        return None
    there = [topic for topic in listed if topic.type in POSE_TYPES]
    if wanted is not None and wanted.strip("/") not in {topic.name.strip("/") for topic in there}:
        raise NoScanError(_absent(wanted, listed, there))
    if not any(topic.messages != 0 for topic in listed if topic.type in POSED_TYPES):
        return None
    # Most logs have no poses and should not wait for this import.
    from lidarcli.pose.sources import PoseSources

    told = read_pose_messages(log)
    if not there and not told.tracks:
        return None
    scans = [topic.name for topic in listed if topic.is_scan]
    return FoundPoses(PoseSources(told.tracks, wanted, scans), told.notes, told.report)


@dataclass(frozen=True, slots=True)
class PoseInfo:
    """Contents of one topic with poses."""

    topic: str
    type: str
    poses: int
    """Number of poses (transforms)."""
    rate: float | None
    """Mean rate of its fastest pair of frames [Hz]; None for single poses."""
    start_ns: int
    end_ns: int
    frames: tuple[tuple[str, str], ...]
    """Pairs (parent, child), the most frequent first; the child is empty where messages do not name it."""

    @property
    def span(self) -> float:
        """From the first to the last stamp [s]."""
        return (self.end_ns - self.start_ns) * SECOND


def pose_infos(found: FoundPoses) -> tuple[PoseInfo, ...]:
    """Return the contents of every pose topic of a log."""
    infos = []
    for topic in found.sources.topics:
        mine = [track for track in found.sources.tracks if track.topic == topic]
        mine.sort(key=lambda track: -track.messages)
        spans = [track.span_ns for track in mine]
        infos.append(
            PoseInfo(
                topic=topic,
                type=mine[0].type,
                poses=sum(track.messages for track in mine),
                rate=max((track.rate for track in mine if track.rate is not None), default=None),
                start_ns=min(first for first, _ in spans),
                end_ns=max(last for _, last in spans),
                frames=tuple((track.parent, track.child) for track in mine),
            )
        )
    return tuple(infos)


def _absent(wanted: str, topics: Sequence[Topic], there: Sequence[Topic]) -> str:
    types = {topic.name.strip("/"): topic.type for topic in topics}
    if wanted.strip("/") in types:
        return f"topic {wanted} is {types[wanted.strip('/')]}, which holds no pose"
    names = ", ".join(sorted({topic.name for topic in there}))
    return f"no topic {wanted} with poses in this log ({f'it has {names}' if names else 'it has none'})"
