"""Logs whose sweeps are changed or made: ranges in another unit, point clouds as sweeps."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Self

from lidarcli.errors import NoScanError
from lidarcli.logs.base import CLOUD_TYPES, Log, Message, OpenOptions, ReadReport, Slice, Topic
from lidarcli.logs.blocks import as_singles, limits_in_metres
from lidarcli.logs.clouds.bins import Bins
from lidarcli.logs.clouds.slicing import Slicer
from lidarcli.pipeline.inputs.pose_messages import PoseMessages, read_pose_messages
from lidarcli.sweeps import RawSweeps

if TYPE_CHECKING:
    from lidarcli.poses.level import TreeLevels

_PIPE = (
    "a pipe is read only once: of its topics the point clouds alone, which are taken for level; give the file's name "
    "for LaserScan and transforms"
)
_NO_CLOUDS = "no point cloud in it, and --slice reads of a pipe nothing else; leave it out for LaserScan"
_PIPED = "mcap"
"""The one format with clouds that may be read without knowing its topics: others list them, or hold no clouds."""
_NONE = "no point cloud in this log: --slice changes nothing"
MOST_WAITING = 256 << 20
"""After so many bytes of clouds none of them waits for others of its topic."""


class ChangedLog:
    """A `Log` that changes the sweeps of another one, and is else as that one."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self.path, self.format = log.path, log.format

    @property
    def compression(self) -> str:
        """As of the log itself."""
        return self._log.compression

    @property
    def size(self) -> int | None:
        """As of the log itself."""
        return self._log.size

    @property
    def position(self) -> int:
        """As of the log itself."""
        return self._log.position

    def topics(self) -> list[Topic] | None:
        """As of the log itself."""
        return self._log.topics()

    def messages(self, types: Collection[str], report: ReadReport) -> Iterator[Message]:
        """As of the log itself."""
        return self._log.messages(types, report)

    def close(self) -> None:
        """Close the log itself."""
        self._log.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


class ScaledLog(ChangedLog):
    """A `Log` whose LaserScan messages have ranges in another unit than metres."""

    def __init__(self, log: Log, scale: float) -> None:
        super().__init__(log)
        self._scale = scale

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """The sweeps in metres."""
        for block in self._log.scans(topics, report):
            least, most = limits_in_metres(block.range_min, block.range_max, self._scale)
            yield replace(
                block, ranges=as_singles(block.ranges * self._scale), range_min=least, range_max=most
            )


class SlicedLog(ChangedLog):
    """A `Log` that makes sweeps of another one's point clouds as well; what is level is found before the first."""

    def __init__(self, log: Log, options: OpenOptions, part: Slice) -> None:
        super().__init__(log)
        self._part = part
        self._bins = Bins.of(options, part.bins)
        self._poses: PoseMessages | None = None
        self._levels: TreeLevels | None = None

    def topics(self) -> list[Topic] | None:
        """All topics; those of point clouds hold sweeps."""
        topics = self._log.topics()
        return topics and [replace(topic, sliced=topic.type in CLOUD_TYPES) for topic in topics]

    def poses(self) -> PoseMessages:
        """What the log tells of poses, read once."""
        if self._poses is None:
            self._poses = read_pose_messages(self._log)
        return self._poses

    def scans(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        """Sweeps of LaserScan topics, then those of clouds, in log order within each topic."""
        listed = self.topics()
        if listed is None and self.format == _PIPED:
            report.notes.append(_PIPE)
            found = False
            for block in self._of_clouds(None, report):
                found = True
                yield block
            if not found and not report.refused and not report.damage:
                raise NoScanError(_NO_CLOUDS)
            return
        if listed is None:
            report.notes.append(_NONE)
            yield from self._log.scans(topics, report)
            return
        wanted = [topic for topic in listed if topic.is_scan and (topics is None or topic.name in topics)]
        if not any(topic.sliced for topic in listed):
            report.notes.append(_NONE)
        if any(not topic.sliced for topic in wanted) or not wanted:
            yield from self._log.scans(topics, report)
        clouds = {topic.name for topic in wanted if topic.sliced}
        if clouds:
            own = ReadReport()
            try:
                # The list of a log that is cut off may lack topics.
                yield from self._of_clouds(None if topics is None else clouds, own)
            finally:
                # Who wants no more sweeps still wants to know what was lost so far.
                report.add_new(own)

    def _of_clouds(self, topics: Collection[str] | None, report: ReadReport) -> Iterator[RawSweeps]:
        from lidarcli.poses.level import TreeLevels

        if self._levels is None:
            self._levels = TreeLevels(self.poses().tracks if self.size is not None else ())
        slicers: dict[str, Slicer] = {}
        waiting = 0
        for message in self._log.messages(CLOUD_TYPES, report):
            if topics is not None and message.topic not in topics:
                continue
            slicer = slicers.get(message.topic)
            if slicer is None:
                slicer = Slicer(message.topic, self._part, self._bins, self._levels, report)
                slicers[message.topic] = slicer
            yield from slicer.take(message)
            waiting += len(message.data)
            if waiting > MOST_WAITING:
                for each in slicers.values():
                    yield from each.flush()
                waiting = 0
        for slicer in slicers.values():
            yield from slicer.flush()
            report.notes += slicer.notes()


def made_of_clouds(log: Log) -> dict[str, str]:
    """Topics whose sweeps are made of point clouds → the type of their messages."""
    return {topic.name: topic.type for topic in log.topics() or () if topic.sliced}
