"""Gives every sweep its pose: a first pass over the pose messages of the log, then batch by batch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.errors import NoScanError, OptionError
from lidarcli.logs.base import POSE_TYPES, Log, ReadReport, Topic
from lidarcli.pipeline.reading.delays import SECOND, Delay, later
from lidarcli.sweeps import Int64, SweepBatch, SweepPoses

if TYPE_CHECKING:
    from lidarcli.poses.sources import PoseSources, Way

NONE = "none"
"""What `--pose` takes for no poses at all."""
TILTED = np.deg2rad(10.0)
"""A sensor that leans more than this is worth a note."""
MOST_DELAY = 3600.0
"""Greatest `--pose-delay` [s], either way: what is more is another clock."""

_PIPE = "poses, if there are any, are not used: a pipe is read only once; give the file's name for them"
_SHOWN = 4


def refuse_delay(wanted: str | None, delay: float | None) -> None:
    """Refuse a delay of the poses that is none, or that there are no poses for."""
    if delay is None:
        return
    if not abs(delay) <= MOST_DELAY:
        raise OptionError(f"--pose-delay: {delay:g} s is not within {MOST_DELAY:,.0f} s")
    if wanted == NONE and delay:
        raise OptionError("--pose-delay is for poses, and --pose none leaves them out")


@dataclass(frozen=True, slots=True)
class FoundPoses:
    """The pose sources of a log, and what reading them has met."""

    sources: PoseSources
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


def find_poses(log: Log, wanted: str | None = None) -> FoundPoses | None:
    """Read the poses of a log that has some and can be read twice.

    Raises
    ------
    NoScanError
        The topic that is wanted is not there.
    """
    if wanted == NONE:
        return None
    topics = log.topics()
    if topics is None or log.size is None:
        return None
    there = [topic for topic in topics if topic.type in POSE_TYPES]
    if wanted is not None and wanted.strip("/") not in {topic.name.strip("/") for topic in there}:
        raise NoScanError(_absent(wanted, topics, there))
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
    delays: Mapping[tuple[str, str], Delay] = field(default_factory=dict)
    """Topic and frame → the delay by which things are followed, where it is another one."""
    seen: dict[str, _Seen] = field(default_factory=dict)

    @classmethod
    def of(cls, log: Log, wanted: str | None = None, delay: float = 0.0) -> Posing:
        """The poses of a log, as far as it has some and can be read twice."""
        refuse_delay(wanted, delay)
        pipe = (
            wanted != NONE and log.size is None and log.topics() is None and not log.format.startswith("csv")
        )
        return cls(find_poses(log, wanted), _PIPE if pipe else "", delay)

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
        poses = _nowhere(len(batch))
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
            _put(poses, rows, here)
            seen.without += int(np.count_nonzero(np.isnan(here.x)))
            seen.tilt = max(seen.tilt, tilt(motion))
            if (best := self.delays.get((batch.topic, batch.frame_ids[code]))) is not None:
                better.append((rows, planar(way.at(later(at_ns, best.seconds)))))
        if not some:
            return batch
        if not better:
            return replace(batch, poses=poses)
        true = poses.rows(np.arange(len(batch)))
        for rows, there in better:
            _put(true, rows, there)
        return replace(batch, poses=poses, true_poses=true)

    def notes(self) -> list[str]:
        """The choice, its alternatives and its gaps, a line each."""
        if self.found is None:
            unused = "no poses in this log: --pose-delay changes nothing" if self.delay else ""
            return [line for line in (self.missed or unused,) if line]
        lines: list[str] = []
        for frame in sorted(self.seen):
            lines += self._frame_notes(frame, self.found.sources)
        lines += [delay.note_of_use(topic) for (topic, _), delay in sorted(self.delays.items())]
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
        """The delays by which things are followed in a frame, for the tables' metadata."""
        mine = {topic: best.seconds for (topic, name), best in sorted(self.delays.items()) if name == frame}
        return {"track_delay": mine} if mine else {}

    def _frame_notes(self, frame: str, sources: PoseSources) -> list[str]:
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


def _nowhere(sweeps: int) -> SweepPoses:
    """So many poses that nobody knows, to put others in their place."""
    x, y, yaw = (np.full(sweeps, np.nan) for _ in range(3))
    return SweepPoses(x, y, yaw, np.zeros(sweeps, bool))


def _put(poses: SweepPoses, rows: Int64, here: SweepPoses) -> None:
    """Put poses in the place of those of some sweeps."""
    poses.x[rows], poses.y[rows], poses.yaw[rows] = here.x, here.y, here.yaw
    poses.upside_down[rows] = here.upside_down


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
