"""A first pass over a log for its poses: those that its messages tell, or those that its sweeps do."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from lidarcli.choices import MATCH
from lidarcli.errors import NoScanError, OptionError
from lidarcli.judging import RangeRules
from lidarcli.logs.base import POSE_TYPES, Log, ReadReport, Topic
from lidarcli.logs.choice import TopicChoice
from lidarcli.pipeline.inputs.pose_messages import read_pose_messages
from lidarcli.pipeline.inputs.sliced import SlicedLog
from lidarcli.pipeline.reading.delays import SECOND
from lidarcli.pipeline.reading.pose_options import NONE, PoseOptions

if TYPE_CHECKING:
    from lidarcli.poses.sources import PoseSources, Told

MOST_MATCHED = 16
"""Sensors of a log whose paths are found from their sweeps: each has a map of what it saw in memory."""


@dataclass(frozen=True, slots=True)
class FoundPoses:
    """The pose sources of a log, and what reading them has met."""

    sources: PoseSources | Told
    notes: tuple[str, ...] = ()
    report: ReadReport = field(default_factory=ReadReport)
    """What the pass over their messages has met."""

    def together(self, sweeps: ReadReport) -> ReadReport:
        """What the passes over poses and sweeps have met, each damaged part once: the sweeps may have met it, too."""
        both = ReadReport()
        both.add(sweeps)
        both.add_new(self.report)
        return both


def find_poses(
    log: Log,
    options: PoseOptions | None = None,
    topics: Collection[str] | None = None,
    rules: RangeRules | None = None,
) -> FoundPoses | None:
    """Read the poses of a log that has some and can be read twice, or those that are told in their place.

    Parameters
    ----------
    topics, rules : the LaserScan topics that matter, by default all, and how their ranges are judged: for `--pose match`

    Raises
    ------
    NoScanError
        The topic that is wanted is not there.
    OptionError
        The sweeps cannot be matched: the log can be read only once, or what matches them is not installed.
    UnreadableError
        The trajectory is none.
    """
    options = options or PoseOptions()
    if options.source == NONE:
        return None
    if options.file is not None:
        from lidarcli.poses.sources import Told
        from lidarcli.poses.trajectory import read_trajectory

        return FoundPoses(Told((read_trajectory(Path(options.file)),)))
    if options.source == MATCH:
        return _matched(log, topics, rules or RangeRules())
    wanted = options.source
    listed = log.topics()
    if listed is None or log.size is None:
        return None
    there = [topic for topic in listed if topic.type in POSE_TYPES]
    if wanted is not None and wanted.strip("/") not in {topic.name.strip("/") for topic in there}:
        raise NoScanError(_absent(wanted, listed, there))
    if not any(topic.messages != 0 for topic in there):
        return None
    # Most logs have no poses and need not wait for the import.
    from lidarcli.poses.sources import PoseSources

    told = log.poses() if isinstance(log, SlicedLog) else read_pose_messages(log)
    return FoundPoses(PoseSources(told.tracks, wanted), told.notes, told.report)


def _matched(log: Log, topics: Collection[str] | None, rules: RangeRules) -> FoundPoses:
    """The path of every sensor of a log from its own sweeps: of each frame, from the first topic that has it."""
    from lidarcli.logs.batches import ReadOptions, read_batches
    from lidarcli.poses.matched import Matching
    from lidarcli.poses.sources import Told

    if log.size is None:
        raise OptionError(
            "--pose match reads a log twice, and a pipe is read only once: give the file's name"
        )
    report = ReadReport()
    paths: dict[str, tuple[str, Matching]] = {}
    for batch in read_batches(
        log, ReadOptions(topics, rules=rules), report, TopicChoice(topics, log.topics())
    ):
        for frame, _, mine in batch.by_frame():
            if frame not in paths:
                if len(paths) == MOST_MATCHED:
                    raise OptionError(
                        f"--pose match: the log has more than {MOST_MATCHED} sensor frames; name a topic with --topic"
                    )
                paths[frame] = batch.topic, Matching()
            topic, path = paths[frame]
            if topic == batch.topic:
                path.add(mine)
    found = [(topic, frame, path.track(topic, frame)) for frame, (topic, path) in sorted(paths.items())]
    notes = [
        f"no path of frame {frame or 'without a name'}: the sweeps of {topic} cannot be matched"
        for topic, frame, track in found
        if track is None
    ]
    notes += [
        f"the path of frame {frame or 'without a name'} was lost {path.restarts:,} times, and begins anew at its last "
        "known pose: what was driven unseen is missing"
        for frame, (_, path) in sorted(paths.items())
        if path.restarts
    ]
    if len(paths) > 1:
        notes.append(
            f"the paths of {len(paths)} sensors are matched each by itself: every frame has a world of its own"
        )
    return FoundPoses(Told(tuple(track for *_, track in found if track is not None)), tuple(notes), report)


@dataclass(frozen=True, slots=True)
class PoseInfo:
    """One topic with poses."""

    topic: str
    type: str
    poses: int
    """Poses (transforms) told."""
    rate: float | None
    """Of its fastest pair of frames, on average [Hz]; None for single poses."""
    start_ns: int
    end_ns: int
    frames: tuple[tuple[str, str], ...]
    """(frame in which, frame that is told of), the most told first; the latter empty where messages do not name it."""

    @property
    def span(self) -> float:
        """From the first to the last stamp [s]."""
        return (self.end_ns - self.start_ns) * SECOND


def pose_infos(found: FoundPoses) -> tuple[PoseInfo, ...]:
    """What every pose topic of a log holds."""
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
