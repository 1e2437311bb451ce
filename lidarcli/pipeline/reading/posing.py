"""Attaches poses to the sweeps of a log, batch by batch, after a first pass over its pose messages."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from lidarcli.display.texts import Routine, Unused, headed, moment, some_of
from lidarcli.errors import UnreadableError
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import ReadOptions
from lidarcli.logs.clock import SECOND
from lidarcli.logs.registry import TopicChoice, format_of
from lidarcli.logs.scan_checks import Went
from lidarcli.options.choices import BEAM_ORDERS, MATCH
from lidarcli.pipeline.inputs.sources import made_of_clouds, read_pose_messages
from lidarcli.pipeline.reading.found_poses import FoundPoses, find_poses
from lidarcli.pipeline.reading.needs import NONE, UNPLACED, Need, PoseOptions, of_one_run
from lidarcli.sweeps.findings import Finding
from lidarcli.sweeps.masks import Masks
from lidarcli.sweeps.types import Int64, SweepBatch, SweepPoses
from lidarcli.system.records import dataclass, field, replace

if TYPE_CHECKING:
    from lidarcli.pipeline.reading.path_choice import CheckedPath, StaticWatch
    from lidarcli.pose.sources import GivenPaths, PoseChain, PoseSources
    from lidarcli.pose.tracks import PoseMotion


AUTO, _, REVERSE, _ = BEAM_ORDERS
_PIPE = "poses, if there are any, are not used: a pipe is read only once; give the file's name for them"
MAX_NOTED_RUNS = 8
"""Runs of a log of whose poses there are notes."""


@dataclass(slots=True)
class FrameStats:
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
class PoseAttacher:
    """Attaches poses to batches, and counts for its notes."""

    found: FoundPoses | None
    missed: str = ""
    """Reason for which there are no poses though the log may have some."""
    file: str = ""
    """Name of the file of the poses, if they are from one."""
    delay: float = 0.0
    """The pose of a sweep is that at its header stamp and this much later [s], as the user says."""
    order: str = AUTO
    """Order in which the beams are sent, of `BEAM_ORDERS`."""
    deskew: bool = True
    """True where batches also have the motion of the sensor during a sweep."""
    levelled: Collection[str] = ()
    """Topics of point clouds, whose sweeps are level however their sensor leans."""
    stats: dict[tuple[str, str], FrameStats] = field(default_factory=dict)
    """Frame and namespace of sweeps → their counts."""
    paths: Mapping[tuple[str, str], CheckedPath] = field(default_factory=dict)
    """Topic and frame → what a first pass over its sweeps shows of its path."""
    named: str = ""
    """Why the poses are taken as they are; empty where the sweeps choose."""
    run: int = 1
    """Run of the log whose poses these are."""
    runs: dict[int, PoseAttacher] = field(default_factory=dict)
    """Run → the attacher of its poses; none where the log holds one run."""
    longest: int | None = None
    """The longest run of a log whose odometry begins again in each."""
    robots: Mapping[str, tuple[tuple[str, str], ...]] = field(default_factory=dict)
    """Topic → topics and frames of the sensors that are followed together with it."""
    remarks: Sequence[str] = ()
    """Notes on these."""
    watch: StaticWatch | None = None
    """Gives the path of the only sensor as long as it stands, until all sweeps are read."""

    @classmethod
    def of(
        cls, log: Log, options: PoseOptions, choice: TopicChoice, read: ReadOptions, *, need: Need = Need.TOLD
    ) -> PoseAttacher:
        """Find the poses of a log, as far as it has some and can be read twice, and check them by its sweeps.

        `choice` are the topics to read, `read` tells the run and judges ranges; `need` are the sensors whose path is
        matched where the log gives none.
        """
        found = find_poses(log, options)
        is_pipe = log.size is None and log.topics() is None and format_of(log).has_poses
        missed = _PIPE if is_pipe and found is None and options.source != NONE else ""
        clouds = frozenset(made_of_clouds(log))
        posing = cls(found, missed, str(options.file or ""), options.delay or 0.0, options.order, options.deskew, clouds)
        chosen = options.source, options.file, options.delay, options.given
        if found is not None and (options.on_map or any(one is not None for one in chosen)):
            posing.named = "they are what is judged" if options.on_map else "they were named"
        match = options.source == MATCH
        is_all = (read.start, read.end, read.every, read.rules.masks) == (None, None, 1, None) and not (read.run or match)
        if need is Need.STANDING and found is None and log.size is not None and is_all and len(choice.chosen) == 1:
            from lidarcli.pipeline.reading.path_choice import StaticWatch

            return replace(posing, watch=StaticWatch(options.order))
        need = Need.MOVING if need is Need.STANDING else need
        if log.size is not None and need is not Need.NONE and (found is not None or need is not Need.TOLD or match):
            from lidarcli.pipeline.reading.path_check import check_paths

            paths, sweeps = check_paths(
                log,
                None if found is None else found.sources,
                choice,
                read.rules,
                by_run=() if found is None else found.by_run,
                run=read.run,
                delay_ns=round(posing.delay / SECOND),
                named=posing.named,
                match=match,
                need=need,
                wanted=options.source != NONE,
                order=options.order,
            )
            worlds = {path.chain.world for path in paths.values() if path.chain is not None}
            if len(sweeps) > 1 and any(map(of_one_run, worlds)):
                posing.longest = max(sweeps, key=lambda each: sweeps[each])
            for number in sorted(sweeps):
                its_poses = found
                if found is not None and len(found.by_run) == len(sweeps):
                    its_poses = replace(found, sources=found.by_run[number - 1], whole=None if read.run else found.sources)
                its = {key: path for (of, key), path in paths.items() if of == number}
                posing.runs[number] = replace(posing, found=its_poses, paths=its, run=number, stats={})
            if options.together and options.source != NONE:
                _join(log, [*posing.runs.values()], read.rules.masks)
            if sweeps:
                posing = posing.runs[1].of_run(read.run if len(sweeps) > 1 else 1)
        return posing

    def anew(self) -> PoseAttacher:
        """Return one for another pass over the log: sources and paths are known, and nothing is counted yet."""
        runs: dict[int, PoseAttacher] = {}
        for run, one in self.runs.items():
            runs[run] = replace(one, stats={}, runs=runs)
        return runs.get(self.run, replace(self, stats={}))

    def close(self) -> None:
        """Take the path of a sensor that was taken to be static, by all sweeps (`SensorMovedError`: it moves)."""
        if self.watch is not None:
            self.paths, self.watch = self.watch.paths(None), None

    def of_run(self, run: int | None) -> PoseAttacher:
        """Return the attacher of one run alone, or of all."""
        return replace(self.runs[run], runs={}) if run in self.runs else self

    @property
    def went(self) -> Went | None:
        """Whether a sensor moves by its poses; None where there are none."""
        if self.found is None:
            return None
        from lidarcli.pose.sources import went

        return partial(went, self.found.whole or self.found.sources)

    @property
    def every(self) -> list[PoseAttacher]:
        """The attachers of all runs; itself where the log holds one run."""
        return [*self.runs.values()] or [self]

    def together(self, report: ReadReport) -> ReadReport:
        """Return the report of both passes, over sweeps and poses, with poses of another time as damage."""
        if self.found is None:
            return report
        both = self.found.together(report)
        if gap := self.file_gap:
            stats = [stats for each in self.every for stats in each.stats.values()]
            first, last = min(frame.first_ns for frame in stats), max(frame.last_ns for frame in stats)
            both.add_damage(
                f"--poses {self.file}",
                f"none of its poses is from the time of the sweeps, {moment(first)} to {moment(last)}: they {gap}: "
                "is it of another log, or of another clock (--pose-delay)?",
            )
        return both

    @property
    def file_gap(self) -> str:
        """When the poses of a file begin, none of which is from the time of the sweeps; empty where some are."""
        stats = [stats for each in self.every for stats in each.stats.values()]
        if not self.file or self.found is None or not stats or any(frame.without < frame.sweeps for frame in stats):
            return ""
        return _begins(self.found.sources.tracks[0].span_ns, min(frame.first_ns for frame in stats))

    def attach(self, batch: SweepBatch) -> SweepBatch:
        """Return the batch with its poses, if the log has some for its sensor."""
        if self.watch is not None:
            self.paths = self.watch.paths(batch)
        if batch.run != self.run and batch.run in self.runs:
            return self.runs[batch.run].attach(batch)
        if (self.found is None and not self.paths) or not len(batch):
            return batch
        from lidarcli.pose.frames import namespace
        from lidarcli.pose.sources import later
        from lidarcli.pose.tracks import planar, tilt

        some = False
        takes_time = batch.duration is not None or any(path.timing.takes_time for path in self.paths.values())
        orders = (self.order, *(path.timing.order for path in self.paths.values()))
        poses = _nowhere(len(batch), self.deskew and takes_time, REVERSE in orders)
        still, knows = np.zeros(len(batch), bool), False
        fits, absent = np.ones(len(batch), bool), np.zeros(len(batch), bool)
        for frame, rows, sweeps in batch.by_frame():
            path = self.paths.get((batch.topic, frame))
            stats = self.stats.setdefault((frame, namespace(batch.topic)), FrameStats(batch.topic))
            stats.add(sweeps.stamp_ns, sweeps.record_ns)
            if path is not None and len(path.still):
                knows, still[rows] = True, path.was_still(sweeps.stamp_ns)
            if (chain := self._chain_of(batch.topic, frame)) is None:
                absent[rows] = True
                continue
            some = True
            fits[rows] = bool(self.named) or path is None or not path.is_contradicted
            first_ns, lasts_ns = self._times_ns(sweeps, path)
            at_ns = later(sweeps.stamp_ns, first_ns)
            motion = chain.at(at_ns)
            here = planar(motion)
            poses.x[rows], poses.y[rows], poses.yaw[rows], poses.upside_down[rows] = (
                here.x,
                here.y,
                here.yaw,
                here.upside_down,
            )
            going = chain.going(here, at_ns, lasts_ns).way
            if going is not None and poses.way is not None:
                poses.way[rows] = going
            if poses.reverse is not None and lasts_ns is not None:
                poses.reverse[rows] = first_ns > 0
            stats.without += int(np.count_nonzero(np.isnan(here.x)))
            if batch.topic not in self.levelled:
                stats.tilt = max(stats.tilt, tilt(motion))
        poses = replace(poses, absent=absent) if absent.any() else poses
        return replace(
            batch,
            poses=poses if some else None,
            still=still if knows else None,
            fits=fits if some else None,
            robot=self.robots.get(batch.topic, ()),
        )

    def motions(self, batch: SweepBatch) -> Iterator[tuple[str, Int64, PoseMotion, str]]:
        """Yield for each frame of a batch that has poses: its name, its rows, their poses in space, and the world frame."""
        if batch.run != self.run and batch.run in self.runs:
            yield from self.runs[batch.run].motions(batch)
            return
        for frame, rows, sweeps in batch.by_frame():
            if (chain := self._chain_of(batch.topic, frame)) is not None:
                yield frame, rows, chain.at(sweeps.stamp_ns), chain.world

    def world_of(self, topic: str, frame: str) -> str:
        """Return the fixed frame of the poses of a sensor; empty where there are none."""
        chain = self._chain_of(topic, frame)
        return "" if chain is None else chain.world

    def _chain_of(self, topic: str, frame: str) -> PoseChain | None:
        """Return the path to use for the sweeps of a topic and frame."""
        if (path := self.paths.get((topic, frame))) is not None:
            return path.chain
        chain = None if self.found is None else self.found.sources.chain(frame, topic)
        if chain is None or not self.delay:
            return chain
        from lidarcli.pose.sources import Correction

        return replace(chain, correction=Correction(round(self.delay / SECOND)))

    def _times_ns(self, sweeps: SweepBatch, path: CheckedPath | None) -> tuple[Int64, Int64 | None]:
        """Return the times of the first beams after the header stamps, and from the first beam to the last [ns]."""
        if not self.deskew or (path is None and sweeps.duration is None):
            return np.zeros(len(sweeps), np.int64), None
        from lidarcli.pose.matched import Timing, headers_of

        timing = Timing(self.order) if path is None else path.timing
        firsts, lasts = (np.rint(times / SECOND).astype(np.int64) for times in timing.of(headers_of(sweeps)))
        return firsts, lasts - firsts

    def notes(self) -> list[str]:
        """Return notes on the choice of poses, its alternatives and its gaps, a line each."""
        every = [*self.runs.values()][:MAX_NOTED_RUNS]
        stated = [headed(f"run {one.run}: ", line) for one in every for line in one.own_notes()]
        return stated if every else self.own_notes()

    def refuse_apart(self) -> None:
        """Refuse a matched path in place of one that the log gives, of which no sweep has a pose (`UnreadableError`)."""
        for path in (path for each in self.every for path in each.paths.values()):
            if path.verdict == "matched" and path.apart is not None:
                raise UnreadableError(f"{path.apart.message}; or --pose match, the path matched from the sweeps")

    @property
    def is_other(self) -> bool:
        """True where a path is not the one by which the robot knew where it was on its map, though the log gives that."""
        if self.named or self.found is None or not hasattr(sources := self.found.sources, "localised"):
            return False
        every = ((sources.localised(frame, topic), path) for (topic, frame), path in self.paths.items())
        return any(own is not None and (path.chain is None or path.chain.steps != own.steps) for own, path in every)

    @property
    def unused(self) -> str:
        """A note on options that change nothing without poses; empty where there are none."""
        names = ["--pose-delay"] * bool(self.delay)
        if not self.named and not self.paths:
            names += ["--beam-order"] * (self.order != AUTO) + ["--no-deskew"] * (not self.deskew)
        return Unused(f"no poses in this log: {', '.join(names)} change{'s' * (len(names) < 2)} nothing") if names else ""

    def own_notes(self) -> list[str]:
        """Return the notes on one run."""
        if self.found is None:
            return [line for line in (self.missed or self.unused, *self.remarks) if line] + self.path_notes()
        lines: list[str] = []
        for frame, space in sorted(self.stats):
            lines += self._frame_notes(frame, self.stats[frame, space], self.found.sources)
        return [*dict.fromkeys(lines), *self.remarks, *self.found.notes, *self.path_notes()]

    def path_notes(self) -> list[str]:
        """Return the notes on the paths that were checked or matched, and the messages of the findings among them."""
        # What is said of a matched path also says that it is one: why it is needed is routine then.
        weak = {key for key, note in self._of_paths() if not isinstance(note, Finding | Routine)}
        words = [(key, note if isinstance(note, str) else note.message, note) for key, note in self._of_paths()]
        stated = [(key, Routine(line) if note is not line and key in weak else line) for key, line, note in words]
        return [self._of_sensor(key, line) for key, line in stated]

    def findings(self, keys: Iterable[tuple[str, str]]) -> tuple[list[str], list[Finding]]:
        """Return the notes on the paths without the findings; and these, with those on the poses of topics and frames."""
        if not self.runs:
            return self.own_findings(keys)
        stated = [(f"run {one.run}: ", *one.own_findings(keys)) for one in [*self.runs.values()][:MAX_NOTED_RUNS]]
        notes = [headed(head, note) for head, notes, _ in stated for note in notes]
        return notes, [replace(each, message=head + each.message) for head, _, found in stated for each in found]

    def own_findings(self, keys: Iterable[tuple[str, str]]) -> tuple[list[str], list[Finding]]:
        """Return those of one run."""
        keyed = list(self._of_paths())
        found = [note for _, note in keyed if isinstance(note, Finding)]
        if self.found is not None:
            from lidarcli.pose.findings import pose_findings

            found += pose_findings(self.found.sources, keys)
        notes = [
            self._of_sensor(key, f"poses from {path.chain.topics[0]}: {path.remark}")
            for key, path in sorted(self.paths.items(), key=lambda one: one[0])
            if path.chain is not None and path.remark
        ]
        notes += [self._of_sensor(key, note) for key, note in keyed if not isinstance(note, Finding)]
        return notes, found

    def _of_paths(self) -> Iterator[tuple[tuple[str, str], str | Finding]]:
        for key, path in sorted(self.paths.items(), key=lambda one: one[0]):
            for note in path.notes:
                yield key, note

    def _of_sensor(self, key: tuple[str, str], note: str) -> str:
        """Return a note on the path of a sensor, with its topic where there are several, or also its frame."""
        topic, frame = key
        if sum(topic == other for other, _ in self.paths) > 1:
            return headed(f"{topic} ({frame}): ", note)
        return note if topic in note or len(self.paths) < 2 else headed(f"{topic}: ", note)

    def leave_out(self, topics: Collection[str]) -> None:
        """Forget the paths of topics whose sweeps turned out to be unused."""
        for each in self.every:
            each.paths = {key: path for key, path in each.paths.items() if key[0] not in topics}

    def described(self) -> dict[str, dict[str, Any]]:
        """Return the poses of each sensor frame and the verdict on them, for the tables' metadata.

        The verdict has a value per topic, as of `CheckedPath.facts`. So have `world` and `topic` where sensors of the same
        frame have several worlds.
        """
        found: dict[str, dict[str, Any]] = {}
        read = groupby(sorted(self.stats.items()), key=lambda each: each[0][0])
        known_paths = sorted(self.paths.items(), key=lambda each: (each[0][1], each[0][0]))
        paths_of = {frame: [*own] for frame, own in groupby(known_paths, key=lambda each: each[0][1])}
        for frame, own in read:
            paths = [(topic, path) for (topic, _), path in paths_of.get(frame, ())]
            topics = [topic for topic, _ in paths] or [stats.topic for _, stats in own]
            known = {topic: chain for topic in topics if (chain := self._chain_of(topic, frame)) is not None}
            chains = [*known.values()]
            if len({chain.world for chain in chains}) > 1:
                found[frame] = {
                    "world": {topic: chain.world for topic, chain in known.items()},
                    "topic": {topic: chain.topics[0] for topic, chain in known.items()},
                }
            elif chains:
                found[frame] = {"world": chains[0].world, "topic": chains[0].topics[0]}
                is_laid = chains[0].correction is not None and chains[0].correction.laid is not None
                if not is_laid and (fixed := chains[0].steps[-1].target) != chains[0].world:
                    found[frame]["fixed_frame"] = fixed
            for topic, path in paths:
                for key, value in path.facts().items():
                    found.setdefault(frame, {}).setdefault(key, {})[topic] = value
        return found

    def _frame_notes(self, frame: str, stats: FrameStats, sources: PoseSources | GivenPaths) -> list[str]:
        chain, others = sources.chain(frame, stats.topic), sources.alternatives(frame, stats.topic)
        name = frame or "without a name"
        if chain is None and stats.topic in self.robots:
            return []
        path = self.paths.get((stats.topic, frame))
        is_matched = path is not None and path.chain is not None and path.verdict == "matched"
        if chain is None and (alike := sources.alike(frame, stats.topic)):
            return [alike_note(frame, alike, others, is_matched)]
        from lidarcli.pose.findings import chain_findings, unplaced
        from lidarcli.pose.frames import nearness
        from lidarcli.pose.sources import MOUNTLESS

        if chain is None:
            missing = unplaced(frame, others, "", sources.tracks).message
            # A path that is matched, or a sensor that is static, needs none.
            head = "the path is matched from the sweeps: " if is_matched else ""
            return [Routine(head + missing) if head or (path is not None and not path.notes) else missing]
        lines: list[str] = [Routine(_chosen(chain, others, path.remark if path else ""))]
        # Where a sensor that is static is on its robot matters little.
        if chain.assumption.endswith(MOUNTLESS) and not (path is not None and path.hardly_moves):
            lines.append(chain.assumption)
        if path is not None and path.is_doubtful and not path.notes:
            lines.append(f"poses from {chain.topics[0]} are {path.remark}")
        if stats.without and not is_matched and not (path is not None and path.apart in path.notes):
            gap = _gap(name, chain, stats)
            lines.append(gap if stats.without > UNPLACED * stats.sweeps else Routine(gap))
        if stats.tilt > np.deg2rad(10.0):
            degrees = np.rad2deg(stats.tilt)
            lines.append(f"frame {name} leans by up to {degrees:.0f} degrees: its poses are their projection")
        links = [one for one in sources.tracks if one.is_link and nearness(one.topic, stats.topic) is not None]
        # Whether a mount that is given twice is right, the sweeps say.
        is_evaluated = is_matched or (path is not None and path.fit is not None and path.fit.is_evaluated)
        for each in chain_findings(chain, links):
            is_routine = is_evaluated and each.id == "frames" and each.level != "error"
            lines.append(Routine(each.message) if is_routine else each.message)
        return lines


def _join(log: Log, runs: Sequence[PoseAttacher], masks: Masks | None) -> None:
    """Find the sensors of one robot, which are followed together; `masks` may say how they are mounted."""
    several = [one for one in runs if len(one.paths) > 1]
    if not several:
        return
    from lidarcli.pipeline.reading.robots import robots_in

    scans = [topic.name for topic in log.topics() or () if topic.is_scan]
    mounts = () if masks is None else masks.mounts
    found = []
    for one in several:
        tracks = one.found.sources.tracks if one.found is not None else read_pose_messages(log).tracks
        found.append(robots_in(one.paths, tracks, mounts, scans))
    # Tracks have one robot in all of the log.
    is_same = all(each.of == found[0].of for each in found)
    for one, each in zip(several, found, strict=True):
        one.remarks = each.notes if is_same else ("sensors are followed apart: they belong together in some runs alone",)
        one.paths = {**one.paths, **each.paths} if is_same else one.paths
    for one in runs if is_same else ():
        one.robots = found[0].of


def alike_note(frame: str, alike: Sequence[str], others: Sequence[str], is_matched: bool = False) -> str:
    """Return the note on a frame without given poses for which several topics are alike."""
    also = f"; also available: {some_of(others)}" if others and not is_matched else ""
    begin = "the path is matched from the sweeps" if is_matched else f"no pose for frame {frame or 'without a name'}"
    return f"{begin}: {some_of(alike)} are alike (--pose TOPIC){also}"


def _nowhere(sweeps: int, moving: bool, reverse: bool) -> SweepPoses:
    """Return unknown poses to fill in; `moving`: with the motion during each sweep, `reverse`: from its end."""
    x, y, yaw = (np.full(sweeps, np.nan) for _ in range(3))
    return SweepPoses(
        x,
        y,
        yaw,
        np.zeros(sweeps, bool),
        np.zeros((sweeps, 3)) if moving else None,
        np.zeros(sweeps, bool) if moving and reverse else None,
    )


def _chosen(chain: PoseChain, others: Sequence[str], remark: str) -> str:
    line = f"poses from {' and '.join(chain.topics)} ({chain.frames})" + (f": {remark}" if remark else "")
    if chain.assumption:
        line += f"; {chain.assumption}"
    return line + (f"; also available: {some_of(others)} (--pose TOPIC)" if others else "")


def _gap(name: str, chain: PoseChain, stats: FrameStats) -> str:
    span = chain.span_ns
    line = f"{stats.without:,} of {stats.sweeps:,} sweeps of frame {name} have no pose"
    if span is None:
        return line
    if span[0] > span[1]:
        return f"{line}: the links {chain.frames} are never known at the same time"
    delay_ns = chain.recorded_delay_ns((stats.first_ns, stats.last_ns), stats.record_ns)
    if stats.without == stats.sweeps and delay_ns:
        from lidarcli.pose.findings import clock_words

        return f"{line}: {clock_words(chain.topics[0], delay_ns * SECOND)}"
    when = f", whose poses {_begins(span, stats.first_ns)}" if stats.without == stats.sweeps else ""
    return f"{line}: they are outside the span of {chain.topics[0]}{when}"


def _begins(span_ns: tuple[int, int], first_ns: int) -> str:
    """Return when poses begin, counted from the first sweep."""
    seconds = (span_ns[0] - first_ns) * SECOND
    return f"begin {abs(seconds):,.2f} s {'after' if seconds > 0.0 else 'before'} the sweeps"
