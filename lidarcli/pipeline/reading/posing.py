"""Gives every sweep its pose: a first pass over the pose messages of the log, then batch by batch."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.errors import NoScanError, OptionError
from lidarcli.logs.base import POSE_TYPES, Log, ReadReport, Topic
from lidarcli.logs.choice import TopicChoice
from lidarcli.pipeline.reading.delays import SECOND, TRACKS, Delay, later
from lidarcli.sweeps import Int64, RangeRules, SweepBatch, SweepPoses

if TYPE_CHECKING:
    from lidarcli.poses.motion import Motion
    from lidarcli.poses.sources import PoseSources, Told, Way

NONE = "none"
"""What `--pose` takes for no poses at all."""
MATCH = "match"
"""What `--pose` takes for poses that the sweeps themselves tell."""
TILTED = np.deg2rad(10.0)
"""A sensor that leans more than this is worth a note."""
MOST_DELAY = 3600.0
"""Greatest `--pose-delay` [s], either way: what is more is another clock."""

_ODOMETRY = "odom"
"""A world whose name holds this begins anew in every run …"""

_PIPE = "poses, if there are any, are not used: a pipe is read only once; give the file's name for them"
_SHOWN = 4
MOST_MATCHED = 16
"""Sensors of a log whose paths are found from their sweeps: each has a map of what it saw in memory."""


def of_one_run(world: str) -> bool:
    """Whether a world frame begins anew in every run: that of odometry, or of a path that was matched.

    >>> [of_one_run(name) for name in ("odom", "robot_0/odom", "match", "map")]
    [True, True, True, False]
    """
    return _ODOMETRY in world or world == MATCH


@dataclass(frozen=True, slots=True)
class PoseOptions:
    """Where the poses of the sweeps come from, and how they are used."""

    source: str | None = None
    """Topic whose poses to take; `none` for no poses; `match` for those that the sweeps themselves tell; by default the
    best that the log has."""
    file: str | None = None
    """Trajectory of the sensor (TUM), instead of what the log tells."""
    delay: float | None = None
    """The pose of a sweep is that at its header stamp and this much later [s]; None: nobody has asked for any, and things
    are followed by the delay that fits best."""
    deskew: bool = True
    """Whether every beam is seen from where the sensor was at its own time, where headers tell how long a sweep takes."""

    def __post_init__(self) -> None:
        """Refuse what no log could be read with."""
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
        """What the result depends on, as plain values, for the tables' metadata: what is not the default."""
        asked = {"pose": self.source, "poses": self.file and Path(self.file).name}
        told: dict[str, Any] = {name: value for name, value in asked.items() if value is not None}
        if self.delay:
            told["pose_delay"] = self.delay
        return told if self.deskew else told | {"deskew": False}


NO_POSES = PoseOptions(NONE)


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
        both.add(replace(self.report, damage=[], damage_more=0))
        both.add(sweeps)
        met = {part.place for part in sweeps.damage}
        for part in self.report.damage:
            if part.place not in met:
                both.add_damage(part.place, part.cause)
        if not met:
            # Past the limit nobody knows which parts are the same; where the sweeps met none, none are.
            both.damage_more += self.report.damage_more
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
    # Most logs have no poses and need not wait for the imports.
    from lidarcli.poses.sources import PoseSources
    from lidarcli.poses.tracks import Tracks

    tracks = Tracks()
    report = ReadReport()
    tracks.add(log.messages(POSE_TYPES, report))
    found = tracks.finish()
    notes = [
        f"{count:,} of {topic} left out: {cause}" for (topic, cause), count in sorted(tracks.refused.items())
    ]
    if tracks.left_out:
        notes.append(f"{tracks.left_out:,} poses left out: too many to keep")
    return FoundPoses(PoseSources(found, wanted), tuple(notes), report)


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


@dataclass(slots=True)
class _Seen:
    """What became of the sweeps of one frame."""

    sweeps: int = 0
    without: int = 0
    tilt: float = 0.0
    first_ns: int = np.iinfo(np.int64).max
    last_ns: int = np.iinfo(np.int64).min
    record_ns: tuple[int, int] = (np.iinfo(np.int64).max, np.iinfo(np.int64).min)

    def add(self, stamps: Int64, records: Int64) -> None:
        """Take the times of some sweeps: those of their poses, and those of the recording."""
        self.sweeps += len(stamps)
        self.first_ns, self.last_ns = (
            min(self.first_ns, int(stamps.min())),
            max(self.last_ns, int(stamps.max())),
        )
        low, high = self.record_ns
        self.record_ns = min(low, int(records.min())), max(high, int(records.max()))


@dataclass(slots=True)
class Posing:
    """Attaches poses to batches and remembers what a user should know of it."""

    found: FoundPoses | None
    missed: str = ""
    """Why there are no poses though there may be some in the log."""
    delay: float = 0.0
    """The pose of a sweep is that at its header stamp and this much later [s]."""
    deskew: bool = True
    """Whether batches also tell how far the sensor goes during a sweep."""
    delays: Mapping[tuple[str, str], Delay] = field(default_factory=dict)
    """Topic and frame → the delay that fits better, where it is another one …"""
    purpose: str = TRACKS
    """… and what for it is used unasked."""
    seen: dict[str, _Seen] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        log: Log,
        options: PoseOptions | None = None,
        topics: Collection[str] | None = None,
        rules: RangeRules | None = None,
    ) -> Posing:
        """The poses of a log, as far as it has some and can be read twice; parameters as of `find_poses`."""
        options = options or PoseOptions()
        found = find_poses(log, options, topics, rules)
        is_pipe = log.size is None and log.topics() is None and not log.format.startswith("csv")
        missed = _PIPE if is_pipe and found is None and options.source != NONE else ""
        return cls(found, missed, options.delay or 0.0, options.deskew)

    def together(self, report: ReadReport) -> ReadReport:
        """What reading the log has met: the pass over its sweeps, and the one over its poses."""
        return report if self.found is None else self.found.together(report)

    def attach(self, batch: SweepBatch) -> SweepBatch:
        """The batch with its poses, if the log has some for its sensor: what nothing tells of is taken as standing."""
        if self.found is None or not len(batch):
            return batch
        from lidarcli.poses.motion import planar, tilt

        better: list[tuple[Int64, SweepPoses]] = []
        some = False
        poses = _nowhere(len(batch), self.deskew and batch.duration is not None)
        for code in np.unique(batch.frame).tolist():
            rows = np.flatnonzero(batch.frame == code)
            seen = self.seen.setdefault(batch.frame_ids[code], _Seen())
            at_ns = later(batch.stamp_ns[rows], self.delay)
            seen.add(at_ns, batch.record_ns[rows])
            way = self.found.sources.way(batch.frame_ids[code])
            if way is None:
                continue
            some = True
            motion = way.at(at_ns)
            here = planar(motion)
            lasts_ns = self._lasts_ns(batch, rows)
            _put(poses, rows, way.going(here, at_ns, lasts_ns))
            seen.without += int(np.count_nonzero(np.isnan(here.x)))
            seen.tilt = max(seen.tilt, tilt(motion))
            if (best := self.delays.get((batch.topic, batch.frame_ids[code]))) is not None:
                true_ns = later(at_ns, best.seconds)
                better.append((rows, way.going(planar(way.at(true_ns)), true_ns, lasts_ns)))
        if not some:
            return batch
        if not better:
            return replace(batch, poses=poses)
        true = poses.rows(np.arange(len(batch)))
        for rows, there in better:
            _put(true, rows, there)
        return replace(batch, poses=poses, true_poses=true)

    def motions(self, batch: SweepBatch) -> Iterator[tuple[str, Int64, Motion, str]]:
        """Of each frame of a batch that has poses: its name, its rows, their poses in space, and the world frame."""
        if self.found is None:
            return
        for frame, rows, mine in batch.by_frame():
            if (way := self.found.sources.way(frame)) is not None:
                yield frame, rows, way.at(later(mine.stamp_ns, self.delay)), way.world

    def _lasts_ns(self, batch: SweepBatch, rows: Int64) -> Int64 | None:
        """How long some sweeps take [ns]; None where that does not matter."""
        if not self.deskew or batch.duration is None:
            return None
        return np.rint(batch.duration[rows] / SECOND).astype(np.int64)

    def notes(self) -> list[str]:
        """The choice, its alternatives and its gaps, a line each."""
        if self.found is None:
            unused = "no poses in this log: --pose-delay changes nothing" if self.delay else ""
            return [line for line in (self.missed or unused,) if line]
        lines: list[str] = []
        for frame in sorted(self.seen):
            lines += self._frame_notes(frame, self.found.sources)
        lines += [delay.note_of_use(topic, self.purpose) for (topic, _), delay in sorted(self.delays.items())]
        return [*dict.fromkeys(lines), *self.found.notes]

    def described(self) -> dict[str, dict[str, Any]]:
        """Sensor frame → where its poses come from, for the tables' metadata."""
        if self.found is None:
            return {}
        ways = {frame: self.found.sources.way(frame) for frame in sorted(self.seen)}
        return {
            frame: {"world": way.world, "topic": way.topics[0], **self._delays_of(frame)}
            for frame, way in ways.items()
            if way is not None
        }

    def _delays_of(self, frame: str) -> dict[str, dict[str, float]]:
        """The delays that are used unasked in a frame, for the tables' metadata."""
        mine = {topic: best.seconds for (topic, name), best in sorted(self.delays.items()) if name == frame}
        return {"track_delay" if self.purpose == TRACKS else "map_delay": mine} if mine else {}

    def _frame_notes(self, frame: str, sources: PoseSources | Told) -> list[str]:
        way, seen, others = sources.way(frame), self.seen[frame], sources.alternatives(frame)
        name = frame or "without a name"
        if way is None and (alike := sources.alike(frame)):
            return [alike_note(frame, alike, others)]
        if way is None:
            hint = f"; --pose may name {_some(others)}" if others else ""
            return [f"no pose for frame {name}: nothing leads from it to a fixed frame{hint}"]
        lines = [_chosen(way, others)]
        if seen.without:
            lines.append(_gap(name, way, seen))
        if seen.tilt > TILTED:
            lines.append(
                f"frame {name} leans by up to {np.rad2deg(seen.tilt):.0f} degrees: its poses are their projection"
            )
        for step in way.steps:
            if step.track.jumps_back:
                lines.append(
                    f"stamps of {step.track.topic} jump back {step.track.jumps_back:,} times: "
                    "poses there may mix two runs"
                )
        return lines


def alike_note(frame: str, alike: Sequence[str], others: Sequence[str]) -> str:
    """Why no pose is taken for a frame, though several topics may be the right one."""
    also = f"; also there: {_some(others)}" if others else ""
    return (
        f"no pose for frame {frame or 'without a name'}: {_some(alike)} are alike, and nothing tells which is that of the "
        f"sensor (--pose TOPIC){also}"
    )


def _nowhere(sweeps: int, moving: bool) -> SweepPoses:
    """So many poses that nobody knows, to put others in their place; `moving`: with the way during each sweep."""
    x, y, yaw = (np.full(sweeps, np.nan) for _ in range(3))
    return SweepPoses(x, y, yaw, np.zeros(sweeps, bool), np.zeros((sweeps, 3)) if moving else None)


def _put(poses: SweepPoses, rows: Int64, here: SweepPoses) -> None:
    """Put poses in the place of those of some sweeps."""
    poses.x[rows], poses.y[rows], poses.yaw[rows] = here.x, here.y, here.yaw
    poses.upside_down[rows] = here.upside_down
    if here.way is not None and poses.way is not None:
        poses.way[rows] = here.way


def _chosen(way: Way, others: Sequence[str]) -> str:
    line = f"poses by {' and '.join(way.topics)} ({way.chain})"
    if way.assumption:
        line += f"; {way.assumption}"
    return line + (f"; also there: {_some(others)} (--pose TOPIC)" if others else "")


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _gap(name: str, way: Way, seen: _Seen) -> str:
    span = way.span_ns
    line = f"without a pose: {seen.without:,} of {seen.sweeps:,} sweeps of frame {name}"
    if span is None:
        return line
    if span[0] > span[1]:
        return f"{line}; the links {way.chain} are never known at the same time"
    apart = max(span[0] - seen.last_ns, seen.first_ns - span[1])
    records = way.record_ns
    together = records[0] <= seen.record_ns[1] and seen.record_ns[0] <= records[1]
    if seen.without == seen.sweeps and apart > 0 and together:
        return (
            f"{line}; their header stamps and those of {way.topics[0]} are {apart * SECOND:,.3f} s apart, though both "
            "were recorded at the same time: the clocks differ"
        )
    return f"{line}, whose stamps are outside the span of {way.topics[0]}"
