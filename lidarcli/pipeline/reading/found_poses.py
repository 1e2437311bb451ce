"""The sources of poses of a log, by a first pass over its pose messages, and the contents of their topics."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from lidarcli.errors import NoScanError, OptionError
from lidarcli.logs.base import POSE_TYPES, POSED_TYPES, Log, ReadReport, Topic
from lidarcli.logs.clock import SECOND
from lidarcli.options.choices import MATCH
from lidarcli.pipeline.inputs.sources import read_pose_messages
from lidarcli.pipeline.reading.needs import NONE, PoseOptions
from lidarcli.system.records import dataclass, field

if TYPE_CHECKING:
    from lidarcli.pose.sources import GivenPaths, PoseSources


@dataclass(frozen=True, slots=True)
class FoundPoses:
    """Pose sources of a log, with the notes and the report of reading them."""

    sources: PoseSources | GivenPaths
    notes: tuple[str, ...] = ()
    report: ReadReport = field(default_factory=ReadReport)
    """Damage and refused messages of the pass over their messages."""
    by_run: tuple[PoseSources, ...] = ()
    """Those of each run, where the clock of the poses starts again."""
    whole: PoseSources | GivenPaths | None = None
    """Those of all runs, where `sources` are of one of them."""

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
    if options.given is not None:
        return FoundPoses(options.given)
    if options.source == NONE:
        return None
    if options.file is not None:
        from lidarcli.pose.sources import GivenPaths
        from lidarcli.pose.tracks import read_trajectory

        track, gaps = read_trajectory(Path(options.file))
        return FoundPoses(GivenPaths((track,), gaps))
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

    read = read_pose_messages(log)
    if not there and not read.tracks:
        return None
    scans = [topic.name for topic in listed if topic.is_scan]
    runs = max((len(track.parts) for track in read.tracks), default=0)
    parts = [[one for track in read.tracks if (one := track.parts[run] if track.parts else track)] for run in range(runs)]
    whole, *by_run = (PoseSources(one, wanted, scans, on_map=options.on_map) for one in (read.tracks, *parts))
    return FoundPoses(whole, read.notes, read.report, tuple(by_run))


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
    sources = found.whole or found.sources
    for topic in sources.topics:
        own = sorted((one for one in sources.tracks if one.topic == topic), key=lambda one: -one.messages)
        firsts, lasts = zip(*(track.span_ns for track in own), strict=True)
        rate = max((track.rate for track in own if track.rate is not None), default=None)
        frames = tuple((track.parent, track.child) for track in own)
        poses = sum(track.messages for track in own)
        infos.append(PoseInfo(topic, own[0].type, poses, rate, min(firsts), max(lasts), frames))
    return tuple(infos)


def _absent(wanted: str, topics: Sequence[Topic], there: Sequence[Topic]) -> str:
    types = {topic.name.strip("/"): topic.type for topic in topics}
    if wanted.strip("/") in types:
        return f"topic {wanted} is {types[wanted.strip('/')]}, which holds no pose"
    names = ", ".join(sorted({topic.name for topic in there}))
    return f"no topic {wanted} with poses in this log ({f'it has {names}' if names else 'it has none'})"
