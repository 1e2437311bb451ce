"""Attaches poses to the sweeps of a log, batch by batch, after a first pass over its pose messages."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.choices import BEAM_ORDERS, MATCH
from lidarcli.display import moment, some_of
from lidarcli.findings import Finding
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.options import TopicChoice
from lidarcli.pipeline.inputs.sources import made_of_clouds
from lidarcli.pipeline.reading.pose_sources import NONE, SECOND, FoundPoses, Need, PoseOptions, find_poses
from lidarcli.range_rules import RangeRules
from lidarcli.sweeps import Int64, SweepBatch, SweepPoses

if TYPE_CHECKING:
    from lidarcli.pipeline.reading.path_check import CheckedPath
    from lidarcli.pose.sources import GivenPaths, PoseSources, Way
    from lidarcli.pose.tracks import Motion

AUTO, _, REVERSE, _ = BEAM_ORDERS
TILTED = np.deg2rad(10.0)
"""Lean of a sensor from which on there is a note [rad]."""
_WITHOUT_POSES = ("csv", "json lines")
"""Beginnings of formats that tell no poses, also from a file."""
_PIPE = "poses, if there are any, are not used: a pipe is read only once; give the file's name for them"


@dataclass(slots=True)
class _Seen:
    """Counts and times of the sweeps of one frame in a namespace."""

    topic: str
    """The first of their topics."""
    sweeps: int = 0
    without: int = 0
    tilt: float = 0.0
    first_ns: int = np.iinfo(np.int64).max
    last_ns: int = np.iinfo(np.int64).min
    record_ns: tuple[int, int] = (np.iinfo(np.int64).max, np.iinfo(np.int64).min)

    def add(self, stamps: Int64, records: Int64) -> None:
        """Add the times of some sweeps: those of their poses, and those of the recording."""
        self.sweeps += len(stamps)
        self.first_ns, self.last_ns = (min(self.first_ns, int(stamps.min())), max(self.last_ns, int(stamps.max())))
        low, high = self.record_ns
        self.record_ns = min(low, int(records.min())), max(high, int(records.max()))


@dataclass(slots=True)
class Posing:
    """Attaches poses to batches, and counts for its notes."""

    found: FoundPoses | None
    missed: str = ""
    """Reason for which there are no poses though the log may have some."""
    file: str = ""
    """Name of the file of the poses, if they are from one."""
    delay: float = 0.0
    """The pose of a sweep is told at its header stamp and this much later [s], as the user says."""
    order: str = AUTO
    """Order in which the beams are sent, of `BEAM_ORDERS`."""
    deskew: bool = True
    """True where batches also tell the way of the sensor during a sweep."""
    levelled: Collection[str] = ()
    """Topics of point clouds, whose sweeps are level however their sensor leans."""
    seen: dict[tuple[str, str], _Seen] = field(default_factory=dict)
    """Frame and namespace of sweeps → their counts."""
    paths: Mapping[tuple[str, str], CheckedPath] = field(default_factory=dict)
    """Topic and frame → what a first pass over its sweeps tells of its path."""
    named: bool = False
    """True where the user chose the poses."""

    @classmethod
    def of(
        cls, log: Log, options: PoseOptions, choice: TopicChoice, rules: RangeRules, *, need: Need = Need.TOLD
    ) -> Posing:
        """Find the poses of a log, as far as it has some and can be read twice, and check them by its sweeps.

        Parameters
        ----------
        choice, rules : the topics to read, and how their ranges are judged
        need : sensors whose path is matched where the log tells none
        """
        found = find_poses(log, options)
        is_pipe = log.size is None and log.topics() is None and not log.format.startswith(_WITHOUT_POSES)
        missed = _PIPE if is_pipe and found is None and options.source != NONE else ""
        posing = cls(
            found,
            missed,
            str(options.file or ""),
            options.delay or 0.0,
            options.order,
            options.deskew,
            levelled=frozenset(made_of_clouds(log)),
        )
        posing.named = found is not None and any(one is not None for one in (options.source, options.file, options.delay))
        match = options.source == MATCH
        if log.size is not None and (found is not None or need is not Need.TOLD or match):
            from lidarcli.pipeline.reading.path_check import check_paths

            posing.paths = check_paths(
                log,
                None if found is None else found.sources,
                choice,
                rules,
                delay_ns=round(posing.delay / SECOND),
                named=posing.named,
                match=match,
                need=need,
                wanted=options.source != NONE,
                order=options.order,
            )
        return posing

    def together(self, report: ReadReport) -> ReadReport:
        """Return the report of both passes, over sweeps and poses, with poses of another time as damage."""
        if self.found is None:
            return report
        both = self.found.together(report)
        seen = list(self.seen.values())
        if self.file and seen and all(frame.without == frame.sweeps for frame in seen):
            first, last = min(frame.first_ns for frame in seen), max(frame.last_ns for frame in seen)
            both.add_damage(
                f"--poses {self.file}",
                f"none of its poses is from the time of the sweeps, {moment(first)} to {moment(last)}: "
                "is it of another log?",
            )
        return both

    def attach(self, batch: SweepBatch) -> SweepBatch:
        """Return the batch with its poses, if the log has some for its sensor."""
        if (self.found is None and not self.paths) or not len(batch):
            return batch
        from lidarcli.pose.sources import later
        from lidarcli.pose.tracks import planar, tilt
        from lidarcli.pose.tree import namespace

        some = False
        takes_time = batch.duration is not None or any(path.timing.takes_time for path in self.paths.values())
        orders = (self.order, *(path.timing.order for path in self.paths.values()))
        poses = _nowhere(len(batch), self.deskew and takes_time, REVERSE in orders)
        still, knows = np.zeros(len(batch), bool), False
        fits, absent = np.ones(len(batch), bool), np.zeros(len(batch), bool)
        for frame, rows, mine in batch.by_frame():
            path = self.paths.get((batch.topic, frame))
            seen = self.seen.setdefault((frame, namespace(batch.topic)), _Seen(batch.topic))
            seen.add(mine.stamp_ns, mine.record_ns)
            if path is not None and len(path.still):
                knows, still[rows] = True, path.stood(mine.stamp_ns)
            if (way := self._way(batch.topic, frame)) is None:
                absent[rows] = True
                continue
            some = True
            fits[rows] = self.named or path is None or path.verdict != "unchecked"
            first_ns, lasts_ns = self._times_ns(mine, path)
            at_ns = later(mine.stamp_ns, first_ns)
            motion = way.at(at_ns)
            here = planar(motion)
            _put(poses, rows, way.going(here, at_ns, lasts_ns))
            if poses.reverse is not None and lasts_ns is not None:
                poses.reverse[rows] = first_ns > 0
            seen.without += int(np.count_nonzero(np.isnan(here.x)))
            if batch.topic not in self.levelled:
                seen.tilt = max(seen.tilt, tilt(motion))
        poses = replace(poses, absent=absent) if absent.any() else poses
        return replace(batch, poses=poses if some else None, still=still if knows else None, fits=fits if some else None)

    def motions(self, batch: SweepBatch) -> Iterator[tuple[str, Int64, Motion, str]]:
        """Yield for each frame of a batch that has poses: its name, its rows, their poses in space, and the world frame."""
        for frame, rows, mine in batch.by_frame():
            if (way := self._way(batch.topic, frame)) is not None:
                yield frame, rows, way.at(mine.stamp_ns), way.world

    def world_of(self, topic: str, frame: str) -> str:
        """Return the fixed frame of the poses of a sensor; empty where there are none."""
        way = self._way(topic, frame)
        return "" if way is None else way.world

    def _way(self, topic: str, frame: str) -> Way | None:
        """Return the path to use for the sweeps of a topic and frame."""
        if (path := self.paths.get((topic, frame))) is not None:
            return path.way
        way = None if self.found is None else self.found.sources.way(frame, topic)
        if way is None or not self.delay:
            return way
        from lidarcli.pose.sources import Correction

        return replace(way, correction=Correction(round(self.delay / SECOND)))

    def _times_ns(self, sweeps: SweepBatch, path: CheckedPath | None) -> tuple[Int64, Int64 | None]:
        """Return the times of the first beams after the header stamps, and from the first beam to the last [ns]."""
        if not self.deskew or (path is None and sweeps.duration is None):
            return np.zeros(len(sweeps), np.int64), None
        from lidarcli.pose.matched import Timing

        timing = Timing(self.order) if path is None else path.timing
        firsts, lasts = (np.rint(times / SECOND).astype(np.int64) for times in timing.of(sweeps))
        return firsts, lasts - firsts

    def notes(self) -> list[str]:
        """Return notes on the choice of poses, its alternatives and its gaps, a line each."""
        if self.found is None:
            unused = "no poses in this log: --pose-delay changes nothing" if self.delay else ""
            return [line for line in (self.missed or unused,) if line] + self.path_notes()
        lines: list[str] = []
        for frame, space in sorted(self.seen):
            lines += self._frame_notes(frame, self.seen[frame, space], self.found.sources)
        return [*dict.fromkeys(lines), *self.found.notes, *self.path_notes()]

    def path_notes(self) -> list[str]:
        """Return the notes on the paths that were checked or matched, and the messages of the findings among them."""
        return [self._of_sensor(key, note.message if isinstance(note, Finding) else note) for key, note in self._of_paths()]

    def findings(self, keys: Iterable[tuple[str, str]]) -> tuple[list[str], list[Finding]]:
        """Return the notes on the paths without the findings; and these, with those on the poses of topics and frames."""
        told = list(self._of_paths())
        found = [note for _, note in told if isinstance(note, Finding)]
        if self.found is not None:
            from lidarcli.pose.faults import pose_findings

            jumping = {(each.topic, each.frame) for each in found if each.id == "steps"}
            found += pose_findings(self.found.sources, keys, jumping)
        notes = [self._of_sensor(key, note) for key, note in told if not isinstance(note, Finding)]
        return notes, found

    def _of_paths(self) -> Iterator[tuple[tuple[str, str], str | Finding]]:
        for key, path in sorted(self.paths.items(), key=lambda one: one[0]):
            for note in path.notes:
                yield key, note

    def _of_sensor(self, key: tuple[str, str], note: str) -> str:
        """Return a note on the path of a sensor, with its topic where there are several, or also its frame."""
        topic, frame = key
        if sum(topic == other for other, _ in self.paths) > 1:
            return f"{topic} ({frame}): {note}"
        return note if topic in note or len(self.paths) < 2 else f"{topic}: {note}"

    def leave_out(self, topics: Collection[str]) -> None:
        """Forget the paths of topics whose sweeps turned out to be unused."""
        self.paths = {key: path for key, path in self.paths.items() if key[0] not in topics}

    def described(self) -> dict[str, dict[str, Any]]:
        """Return the poses of each sensor frame and the verdict on them, for the tables' metadata.

        The verdict has a value per topic: `pose_verdict`, `pose_fit`, `pose_delay` [s], `pose_cuts`, `beam_order`. So have
        `world` and `topic` where sensors of the same frame have several worlds.
        """
        found: dict[str, dict[str, Any]] = {}
        for frame in sorted({frame for frame, _ in self.seen}):
            paths = [(topic, path) for (topic, name), path in sorted(self.paths.items()) if name == frame]
            topics = [topic for topic, _ in paths] or [
                seen.topic for (name, _), seen in sorted(self.seen.items()) if name == frame
            ]
            known = {topic: way for topic in topics if (way := self._way(topic, frame)) is not None}
            ways = [*known.values()]
            if len({way.world for way in ways}) > 1:
                found[frame] = {
                    "world": {topic: way.world for topic, way in known.items()},
                    "topic": {topic: way.topics[0] for topic, way in known.items()},
                }
            elif ways:
                found[frame] = {"world": ways[0].world, "topic": ways[0].topics[0]}
                if (fixed := ways[0].steps[-1].target) != ways[0].world:
                    found[frame]["fixed_frame"] = fixed
            for topic, path in paths:
                for key, value in path.facts().items():
                    found.setdefault(frame, {}).setdefault(key, {})[topic] = value
        return found

    def _frame_notes(self, frame: str, seen: _Seen, sources: PoseSources | GivenPaths) -> list[str]:
        way, others = sources.way(frame, seen.topic), sources.alternatives(frame, seen.topic)
        name = frame or "without a name"
        if way is None and (alike := sources.alike(frame, seen.topic)):
            return [alike_note(frame, alike, others)]
        from lidarcli.pose.faults import unplaced, way_findings
        from lidarcli.pose.tree import nearness

        if way is None:
            return [unplaced(frame, others, "", sources.tracks).message]
        lines = [_chosen(way, others)]
        if seen.without:
            lines.append(_gap(name, way, seen))
        if seen.tilt > TILTED:
            lines.append(f"frame {name} leans by up to {np.rad2deg(seen.tilt):.0f} degrees: its poses are their projection")
        links = [one for one in sources.tracks if one.is_link and nearness(one.topic, seen.topic) is not None]
        return lines + [found.message for found in way_findings(way, links)]


def alike_note(frame: str, alike: Sequence[str], others: Sequence[str]) -> str:
    """Return the note on a frame without poses for which several topics are alike."""
    also = f"; also available: {some_of(others)}" if others else ""
    return (
        f"no pose for frame {frame or 'without a name'}: {some_of(alike)} are alike, and nothing tells which is that of "
        f"the sensor (--pose TOPIC){also}"
    )


def _nowhere(sweeps: int, moving: bool, reverse: bool) -> SweepPoses:
    """Return so many unknown poses, to be filled in; `moving`: with the way during each sweep, `reverse`: from its end."""
    x, y, yaw = (np.full(sweeps, np.nan) for _ in range(3))
    return SweepPoses(
        x,
        y,
        yaw,
        np.zeros(sweeps, bool),
        np.zeros((sweeps, 3)) if moving else None,
        np.zeros(sweeps, bool) if moving and reverse else None,
    )


def _put(poses: SweepPoses, rows: Int64, here: SweepPoses) -> None:
    """Fill in the poses of some sweeps."""
    poses.x[rows], poses.y[rows], poses.yaw[rows] = here.x, here.y, here.yaw
    poses.upside_down[rows] = here.upside_down
    if here.way is not None and poses.way is not None:
        poses.way[rows] = here.way


def _chosen(way: Way, others: Sequence[str]) -> str:
    line = f"poses from {' and '.join(way.topics)} ({way.chain})"
    if way.assumption:
        line += f"; {way.assumption}"
    return line + (f"; also available: {some_of(others)} (--pose TOPIC)" if others else "")


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
