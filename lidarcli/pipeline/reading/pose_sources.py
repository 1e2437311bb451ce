"""Poses of a log: the options for them, the first pass that finds them, and their delay."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.choices import MATCH
from lidarcli.errors import NoScanError, OptionError
from lidarcli.logs.base import POSE_TYPES, Log, ReadReport, Topic
from lidarcli.logs.options import TopicChoice
from lidarcli.logs.piles import Settling
from lidarcli.pipeline.inputs.sources import SlicedLog, read_pose_messages
from lidarcli.range_rules import RangeRules
from lidarcli.sweeps import Int64, RawSweeps

if TYPE_CHECKING:
    from lidarcli.poses.delay import DelaySample
    from lidarcli.poses.sources import GivenPaths, PoseSources

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


@dataclass(frozen=True, slots=True)
class PoseOptions:
    """Options for the poses of sweeps: their source, their delay and their use."""

    source: str | None = None
    """Topic of the poses; `none` for no poses; `match` for poses matched from the sweeps; None: the best of the log."""
    file: str | None = None
    """Trajectory of the sensor (TUM), instead of what the log tells."""
    delay: float | None = None
    """Time after its header stamp at which the pose of a sweep is taken [s]; None: the stamp itself, and for tracks the
    delay that fits best."""
    deskew: bool = True
    """True to place every beam by the pose at its own time, where headers tell how long a sweep takes."""

    def __post_init__(self) -> None:
        """Refuse options that exclude each other."""
        if self.source is not None and self.file is not None:
            raise OptionError(
                f"--pose {self.source} and --poses {self.file} exclude each other: leave one out"
            )
        if self.delay is None:
            return
        if not abs(self.delay) <= MOST_DELAY:
            raise OptionError(f"--pose-delay: {self.delay:g} s is not within {MOST_DELAY:,.0f} s")
        if self.source == NONE and self.delay:
            raise OptionError("--pose-delay is for poses, and --pose none leaves them out")
        if self.source == MATCH and self.delay:
            raise OptionError(
                "--pose-delay is for poses of the log, and --pose match finds them in its sweeps"
            )

    def as_dict(self) -> dict[str, Any]:
        """Return the options that are not the default, as plain values, for the tables' metadata."""
        asked = {"pose": self.source, "poses": self.file and Path(self.file).name}
        told: dict[str, Any] = {name: value for name, value in asked.items() if value is not None}
        if self.delay:
            told["pose_delay"] = self.delay
        return told if self.deskew else told | {"deskew": False}


NO_POSES = PoseOptions(NONE)


MAX_DELAYS = 4
"""Most topics and frames whose delay is looked for: each takes 0.1 s and a megabyte."""
MOST_SWEEPS = 10_000
"""Sweeps that are read for the delay beforehand: a sensor that has hardly moved by then has none."""
SECOND = 1e-9
TRACKS, MAP = "tracks", "the map"
"""Purposes for which a delay that fits better is used unasked."""


@dataclass(frozen=True, slots=True)
class Delay:
    """Delay of poses that fits the sweeps of a topic and frame best."""

    seconds: float
    """The pose of a sweep is that at its header stamp and this much later."""
    saved: float
    """Share of the cells of the world that the points no longer fill, 0 to 1."""

    def note(self, topic: str) -> str:
        """Return the note on a delay that fits better."""
        return (
            f"{self._fits(topic)}: its points fill {self.saved:.0%} fewer cells of the world "
            f"(--pose-delay {self.seconds:.2f})"
        )

    def note_of_use(self, topic: str, purpose: str) -> str:
        """Return the note on the unasked use of a delay, for a purpose such as `TRACKS`."""
        also = " also for the world columns" if purpose == TRACKS else "; 0 takes them as they are"
        return f"{self._fits(topic)}: used for {purpose} (--pose-delay {self.seconds:.2f}{also})"

    def _fits(self, topic: str) -> str:
        side = "after" if self.seconds > 0 else "before"
        return f"poses {abs(self.seconds):.2f} s {side} the header stamps of {topic} fit better"


class DelaySearch:
    """Looks for the delays of the first topics and frames of a log, block by block."""

    def __init__(self, sources: PoseSources | GivenPaths, deskew: bool = True) -> None:
        self._sources = sources
        self._deskew = deskew
        self._samples: dict[tuple[str, str], DelaySample | None] = {}

    def add(self, block: RawSweeps, rules: RangeRules) -> None:
        """Take the sweeps of a block, in the order of the log."""
        for code in np.unique(block.frame).tolist():
            key = block.topic, block.frame_ids[code]
            if key not in self._samples and len(self._samples) < MAX_DELAYS:
                self._samples[key] = self._sample(key[1])
            sample = self._samples.get(key)
            if sample is not None and not sample.full:
                sample.add_raw(block.rows(block.frame == code), rules)

    def whole(self, topics: set[str]) -> bool:
        """Tell whether all delays of a log with these topics are settled."""
        seen = {topic for topic, _ in self._samples}
        all_there = len(self._samples) == MAX_DELAYS or seen >= topics
        return all_there and all(sample is None or sample.full for sample in self._samples.values())

    def best(self) -> dict[tuple[str, str], Delay]:
        """Return the delay of each topic and frame where one is clearly better than none."""
        found = {key: sample.best() for key, sample in sorted(self._samples.items()) if sample is not None}
        return {key: Delay(*best) for key, best in found.items() if best is not None}

    def _sample(self, frame: str) -> DelaySample | None:
        """Return the search for the delay of a frame with moving poses; None for other frames."""
        way = self._sources.way(frame)
        if way is None or way.span_ns is None:
            return None
        # Most logs have no poses and should not wait for this import.
        from lidarcli.poses.delay import DelaySample

        return DelaySample(way, self._deskew)


def later(stamp_ns: Int64, delay: float) -> Int64:
    """Add a delay [s] to stamps (N,) [ns], limited to the range of int64."""
    by = round(delay / SECOND)
    most = np.iinfo(np.int64).max - abs(by)
    moved: Int64 = np.clip(stamp_ns, -most, most) + by if by else stamp_ns
    return moved


def first_delays(
    log: Log, sources: PoseSources | GivenPaths, choice: TopicChoice, rules: RangeRules, deskew: bool = True
) -> Mapping[tuple[str, str], Delay]:
    """Return the delay of the poses of each topic and frame, by the first sweeps of a log that can be read twice.

    `--start`, `--end` and `--every` do not matter here: the clocks do not change, and the whole way is needed.
    """
    search = DelaySearch(sources, deskew)
    empty = {topic.name for topic in log.topics() or () if topic.messages == 0}
    topics, sweeps = set(choice.chosen) - empty, 0
    # The pass over all sweeps reports the damage.
    report = ReadReport()
    for block, judging in Settling(rules, report).blocks(log.scans(choice.asked, report)):
        search.add(block, judging)
        sweeps += len(block)
        if sweeps >= MOST_SWEEPS or search.whole(topics):
            break
    return search.best()


MOST_MATCHED = 16
"""Most sensors of a log whose paths are matched: each has a map in memory."""


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


def find_poses(
    log: Log,
    options: PoseOptions | None = None,
    topics: Collection[str] | None = None,
    rules: RangeRules | None = None,
) -> FoundPoses | None:
    """Read the poses of a log that has some and can be read twice, or those of a file or of matching.

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
        from lidarcli.poses.sources import GivenPaths
        from lidarcli.poses.tracks import read_trajectory

        return FoundPoses(GivenPaths((read_trajectory(Path(options.file)),)))
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
    # Most logs have no poses and should not wait for this import.
    from lidarcli.poses.sources import PoseSources

    told = log.poses() if isinstance(log, SlicedLog) else read_pose_messages(log)
    return FoundPoses(PoseSources(told.tracks, wanted), told.notes, told.report)


def _matched(log: Log, topics: Collection[str] | None, rules: RangeRules) -> FoundPoses:
    """Match the path of every sensor of a log from its own sweeps: of each frame, from the first topic that has it."""
    from lidarcli.logs.batches import ReadOptions, read_batches
    from lidarcli.poses.matched import MatchedPath
    from lidarcli.poses.sources import GivenPaths

    if log.size is None:
        raise OptionError(
            "--pose match reads a log twice, and a pipe is read only once: give the file's name"
        )
    report = ReadReport()
    paths: dict[str, tuple[str, MatchedPath]] = {}
    for batch in read_batches(
        log, ReadOptions(topics, rules=rules), report, TopicChoice(topics, log.topics())
    ):
        for frame, _, mine in batch.by_frame():
            if frame not in paths:
                if len(paths) == MOST_MATCHED:
                    raise OptionError(
                        f"--pose match: the log has more than {MOST_MATCHED} sensor frames; name a topic with --topic"
                    )
                paths[frame] = batch.topic, MatchedPath()
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
    return FoundPoses(
        GivenPaths(tuple(track for *_, track in found if track is not None)), tuple(notes), report
    )


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
