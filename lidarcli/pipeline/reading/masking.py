"""The mask of the robot itself for one log: frames that its transforms place, and beams that a first pass learns."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping

import numpy as np

from lidarcli.display.texts import counted
from lidarcli.errors import OptionError
from lidarcli.logs.base import Log, ReadReport
from lidarcli.logs.batches import LogBatcher, ReadOptions
from lidarcli.logs.registry import TopicChoice
from lidarcli.pipeline.inputs.sources import read_pose_messages
from lidarcli.pipeline.reading.needs import NONE, Need, PoseOptions
from lidarcli.pipeline.reading.posing import PoseAttacher
from lidarcli.sweeps.masks import Mask, Masks, Mount, Sector, same_name
from lidarcli.sweeps.range_rules import RangeRules
from lidarcli.sweeps.types import TURN, Float32, Float64, Int32, Int64, SweepBatch
from lidarcli.system.records import dataclass, field, replace

WINDOW, SHARE = 0.08, 0.6
"""A beam ends on the robot where it ends within so short a stretch [m] in at least this share of the sweeps."""
REACH = 1.2
"""Greatest range at which it does [m]."""
GRAZED = 0.2
"""Least share of the sweeps where next to it is such a beam, as near: it grazes the robot."""
GRAIN = 0.005
"""Step in which ranges are counted [m]."""
MIN_DISTANCE, MIN_TURN = 3.0, 2.0
"""Least distance [m] and turn [rad] of a sensor: the robot carries what stays before it all the time."""
MOVED, TURNED = 0.05, 0.05
"""A sweep counts where the sensor went so far [m] or turned so much [rad] since the last one that did."""
FAR_GRAIN, FAR_WINDOW, FAR_REACH = 0.25, 0.5, 60.0
"""A sensor was static, whatever poses say, if most beams that end farther away do so within such a stretch [m]."""
SEEN = 0.3
"""Least share of the sweeps in which such a beam ends farther away than `REACH`."""
LONGEST = 0.16
"""Neighbouring beams share one sector as long as it spans no more than this [m]."""
STOOD_REACH, STOOD_WIDTH, DETACHED = 0.45, 0.2, 0.15
"""Of what a parked sensor sees, what is so near, so narrow and so far before objects next to it [m] may be the robot."""
MIN_SWEEPS = 10
"""Fewest sweeps of a sensor that show anything."""
MAX_BEAMS, MAX_SENSORS = 10_000, 16
"""Most beams of a sweep, and most sensors, of which the mask is learned: ranges are counted for each beam."""
_PIPE = "--mask auto reads a log twice, and a pipe is read only once: give the file's name, or a mask FILE"


@dataclass(frozen=True, slots=True)
class MaskRules:
    """The rules for the ranges of one log with its mask, and notes on it."""

    rules: RangeRules
    remarks: tuple[str, ...] = ()
    """Notes on what is masked."""
    doubts: tuple[str, ...] = ()
    """Notes on what is not masked, though that was requested."""
    learned: Masks = field(default_factory=Masks)
    """Mask by the log itself."""
    proposed: Masks = field(default_factory=Masks)
    """Mask of what looks like the robot itself before sensors that stood; it is not used."""
    unclear: Mapping[tuple[str, str], int] = field(default_factory=dict)
    """Topic and frame → beams that mostly end within one window below `STOOD_REACH`, on what is unknown."""
    posing: PoseAttacher | None = None
    """The poses by which the mask was learned; None where it was not."""

    @property
    def notes(self) -> tuple[str, ...]:
        """All notes."""
        return (*self.remarks, *self.doubts)


def masking_of(
    log: Log, rules: RangeRules, poses: PoseOptions | None = None, topics: Collection[str] | None = None
) -> MaskRules:
    """Return the rules for the ranges of a log, with its mask learned and placed where that is requested.

    `poses` and `topics`, by default all, are for `--mask auto`: `OptionError` of a log that can be read only once.
    """
    masks = rules.masks
    if masks is None:
        return MaskRules(rules)
    if masks.learn:
        return _learn(log, rules, poses or PoseOptions(), topics)
    listed = log.topics()
    if listed is None or log.size is None:
        return MaskRules(rules)
    absent = {
        mask.topic: None
        for mask in masks.masks
        if mask.topic and not any(same_name(mask.topic, topic.name) for topic in listed)
    }
    doubts = tuple(f"--mask: no topic {name} in this log, for which a [[mask]] is" for name in absent)
    if frames := {mask.frame for mask in masks.masks if mask.frame}:
        mounts = dict.fromkeys((*masks.mounts, *_mounts(log, sorted(frames))))
        masks = replace(masks, mounts=tuple(mounts))
    return MaskRules(replace(rules, masks=masks), doubts=doubts)


def _mounts(log: Log, frames: list[str]) -> Iterator[Mount]:
    """Yield where the static transforms of a log place its frames in others."""
    from lidarcli.pose.frames import FrameTree, along
    from lidarcli.pose.messages import frame_name
    from lidarcli.pose.tracks import planar

    messages = read_pose_messages(log)
    links = [track for track in messages.tracks if track.is_link and track.static]
    tree = FrameTree(links)
    for frame in dict.fromkeys(name for link in links for name in (link.child, link.parent)):
        for target in map(frame_name, frames):
            if steps := tree.path(tree.sensor(frame), target):
                here = planar(along(steps, np.zeros(1, np.int64)))
                x, y, yaw = (float(each[0]) for each in (here.x, here.y, here.yaw))
                yield Mount(frame, target, x, y, yaw, bool(here.upside_down[0]))


def _learn(log: Log, rules: RangeRules, poses: PoseOptions, topics: Collection[str] | None) -> MaskRules:
    if log.size is None:
        raise OptionError(_PIPE)
    rules = replace(rules, masks=None)
    poses = replace(poses, source=None) if poses.source == NONE else poses
    bodies, posing = _count_ranges(log, rules, poses, topics)
    masks: list[Mask] = []
    proposed: list[Mask] = []
    unclear: dict[tuple[str, str], int] = {}
    remarks: list[str] = []
    doubts: list[str] = []
    sensors = Counter(topic for topic, _ in bodies)
    for (topic, frame), body in sorted(bodies.items()):
        doubt = body.doubt() if sensors[topic] == 1 else "several sensors share the topic"
        runs = body.proposals() if doubt else body.own()
        if doubt and (beams := body.unchanging()):
            unclear[topic, frame] = beams
        into = proposed if doubt else masks
        into += [body.mask(topic, run) for run in runs]
        if doubt:
            doubts.append(f"{topic}: nothing is masked: {doubt}")
        if runs or not doubt:
            (doubts if doubt else remarks).append(f"{topic}: {_described(runs, proposed=bool(doubt))}")
    learned = Masks(tuple(masks))
    return MaskRules(
        replace(rules, masks=learned if masks else None),
        tuple(remarks),
        tuple(doubts),
        learned,
        Masks(tuple(proposed)),
        unclear,
        posing,
    )


def _count_ranges(
    log: Log, rules: RangeRules, poses: PoseOptions, topics: Collection[str] | None
) -> tuple[dict[tuple[str, str], _Body], PoseAttacher]:
    """Count the ranges of each topic and frame of a log; return the counts and the poses by which it was done."""
    choice = TopicChoice(topics, log.topics())
    read = ReadOptions(topics, rules=rules)
    posing = PoseAttacher.of(log, poses, choice, read, need=Need.ALL)
    bodies: dict[tuple[str, str], _Body] = {}
    # The pass over all sweeps reports the damage.
    for batch in LogBatcher(log, read, ReadReport(), choice).batches():
        for frame, _, sweeps in posing.attach(batch).by_frame():
            key = batch.topic, frame
            if key not in bodies:
                if len(bodies) == MAX_SENSORS:
                    raise OptionError(f"--mask auto: the log has more than {MAX_SENSORS} sensors; name some with --topic")
                bodies[key] = _Body(sweeps)
            bodies[key].add(sweeps)
    return bodies, posing


class _Counts:
    """Counts of how often each beam ended in each step of range."""

    def __init__(self, beams: int, grain: float, reach: float) -> None:
        self._grain, self._steps = grain, round(reach / grain)
        self._cells = np.zeros(beams * self._steps, np.int32)
        self.sweeps = 0

    def add(self, ranges: Float32) -> None:
        """Take sweeps (S, B)."""
        with np.errstate(invalid="ignore"):
            row, beam = np.nonzero(ranges < np.float32(self._grain * self._steps))
        step = np.minimum((ranges[row, beam] / self._grain).astype(np.int64), self._steps - 1)
        self._cells += np.bincount(beam * self._steps + step, minlength=len(self._cells)).astype(np.int32)
        self.sweeps += len(ranges)

    def beyond(self, least: float) -> Int64:
        """Return how often each beam (B,) ended from a range on."""
        counts: Int64 = self._table()[:, round(least / self._grain) :].sum(axis=1, dtype=np.int64)
        return counts

    def fullest(self, window: float, least: float = 0.0) -> tuple[Int64, Float64]:
        """Return for each beam (B,) the most that one window holds, and where the middle one of such windows begins [m]."""
        width = round(window / self._grain)
        ends = np.cumsum(np.pad(self._table(), ((0, 0), (1, 0))), axis=1, dtype=np.int64)
        counted = (ends[:, width:] - ends[:, :-width])[:, round(least / self._grain) :]
        first, last = counted.argmax(axis=1), counted.shape[1] - 1 - counted[:, ::-1].argmax(axis=1)
        return counted.max(axis=1), least + 0.5 * (first + last) * self._grain

    def _table(self) -> Int32:
        return self._cells.reshape(-1, self._steps)


class MovedPath:
    """The path of a sensor, taken in steps that are long enough."""

    def __init__(self, step: float, turn: float) -> None:
        self._step, self._turn = step, turn
        self.last: tuple[float, float, float] | None = None
        """Its last pose; None where nothing shows one."""
        self.distance = self.turned = self._heading = 0.0
        """Length of the path [m], and all its turns together [rad]."""
        self.turns = 0.0, 0.0
        """Least and greatest turn since it began [rad]."""

    def moved(self, poses: Float64) -> Iterator[int]:
        """Yield those poses (K, 3) before which the sensor has moved."""
        for row, (x, y, yaw) in enumerate(poses.tolist()):
            if not math.isfinite(x + y + yaw):
                continue
            self.last = self.last or (x, y, yaw)
            step = math.hypot(x - self.last[0], y - self.last[1])
            turn = math.remainder(yaw - self.last[2], TURN)
            if step < self._step and abs(turn) < self._turn:
                continue
            self.last = x, y, yaw
            self.distance += step
            self.turned += abs(turn)
            self._heading += turn
            self.turns = min(self.turns[0], self._heading), max(self.turns[1], self._heading)
            yield row


Run = list[tuple[int, float]]
"""Neighbouring beams, and for each the range at which its window begins [m]."""


class _Body:
    """Search for what stays before one sensor: a fold over its sweeps, with beams distinguished by their bearings."""

    def __init__(self, batch: SweepBatch) -> None:
        self._beams = batch.width
        self._first, self._step = float(batch.angle_min[0]), float(batch.angle_increment[0])
        self._is_countable = self._beams <= MAX_BEAMS and self._step != 0.0
        beams = self._beams if self._is_countable else 0
        self._always, self._driving = (_Counts(beams, GRAIN, REACH) for _ in range(2))
        self._far = _Counts(beams, FAR_GRAIN, FAR_REACH)
        self._path = MovedPath(MOVED, TURNED)

    def add(self, batch: SweepBatch) -> None:
        """Take sweeps."""
        if not self._is_countable:
            return
        ranges = self._in_columns(batch)
        self._always.add(ranges)
        poses = batch.poses
        moved = [] if poses is None else list(self._path.moved(np.column_stack([poses.x, poses.y, poses.yaw])))
        self._driving.add(ranges[moved])
        self._far.add(ranges[moved])

    def _in_columns(self, batch: SweepBatch) -> Float32:
        """Return the ranges (S, B) by the beams of the first sweep, which others may not share."""
        if (
            batch.width == self._beams
            and (batch.angle_min == self._first).all()
            and (batch.angle_increment == self._step).all()
        ):
            return batch.ranges
        # A header may say anything.
        with np.errstate(over="ignore", invalid="ignore"):
            columns = np.rint((batch.bearings - self._first) / self._step)
        row, beam = np.nonzero((columns >= 0) & (columns < self._beams))
        ranges = np.full((len(batch), self._beams), np.nan, np.float32)
        ranges[row, columns[row, beam].astype(np.int64)] = batch.ranges[row, beam]
        return ranges

    def doubt(self) -> str:
        """Return why the robot itself cannot be distinguished from what is around; empty where it can."""
        if not self._is_countable:
            return f"its sweeps have more than {MAX_BEAMS:,} beams, or no step between them"
        if self._path.last is None:
            return "nothing tells whether the sensor drove"
        turned, distance = self._path.turns[1] - self._path.turns[0], self._path.distance
        if distance < MIN_DISTANCE or turned < MIN_TURN or self._driving.sweeps < MIN_SWEEPS:
            return (
                f"the sensor drove {distance:.1f} m and turned by {math.degrees(turned):.0f} degrees; to tell its "
                f"own body from what stands around takes {MIN_DISTANCE:g} m and {math.degrees(MIN_TURN):.0f} degrees"
            )
        least = SHARE * self._far.sweeps
        far_beams = self._far.beyond(REACH) >= SEEN * self._far.sweeps
        same = far_beams & (self._far.fullest(FAR_WINDOW, REACH)[0] >= least)
        if 2 * np.count_nonzero(same) >= np.count_nonzero(far_beams):
            return "most of what the sensor sees stays where it is, though poses tell that it drove"
        return ""

    def own(self) -> list[Run]:
        """Return the beams that end on the robot itself, of a sensor that drove."""
        return _runs(self._driving, GRAZED)

    def unchanging(self) -> int:
        """Return the number of beams that mostly end within one window below `STOOD_REACH`."""
        if self._always.sweeps < MIN_SWEEPS:
            return 0
        return sum(low + WINDOW <= STOOD_REACH for run in _runs(self._always, SHARE) for _, low in run)

    def proposals(self) -> list[Run]:
        """Return the beams that look like that, of one that stood."""
        if self._always.sweeps < MIN_SWEEPS:
            return []
        runs = _runs(self._always, SHARE)
        at = {beam: low for run in runs for beam, low in run}
        found = []
        for run in runs:
            near, far = min(low for _, low in run), max(low for _, low in run)
            neighbours = [at.get(beam, math.inf) for beam in (run[0][0] - 1, run[-1][0] + 1)]
            width = len(run) * abs(self._step) * (far + WINDOW)
            if far + WINDOW <= STOOD_REACH and width < STOOD_WIDTH and min(neighbours) > near + DETACHED:
                found.append(run)
        return found

    def mask(self, topic: str, run: Run) -> Mask:
        """Return the mask of such beams: half a step around them."""
        ends = [self._first + (beam + side) * self._step for beam, side in ((run[0][0], -0.5), (run[-1][0], 0.5))]
        low, high = min(low for _, low in run), max(low for _, low in run) + WINDOW
        return Mask(Sector(min(ends), max(ends), low, high), topic)


def _runs(counts: _Counts, neighbours: float) -> list[Run]:
    """Return the beams that mostly end within one window, neighbours together; `neighbours`: least share of a neighbour."""
    counted, low = counts.fullest(WINDOW)
    beams = set(np.flatnonzero(counted >= max(SHARE * counts.sweeps, 1)).tolist())
    for step in (1, -1):
        for beam in sorted(beams, reverse=step < 0):
            after = beam + step
            while after not in beams and 0 <= after < len(counted):
                if counted[after] < neighbours * counts.sweeps or abs(low[after] - low[after - step]) > WINDOW:
                    break
                beams.add(after)
                after += step
    runs: list[Run] = []
    for beam in sorted(beams):
        begin = float(low[beam])
        last = runs[-1] if runs else []
        lows = [begin, *(other for _, other in last)]
        if last and last[-1][0] == beam - 1 and max(lows) - min(lows) + WINDOW <= LONGEST:
            last.append((beam, begin))
        else:
            runs.append([(beam, begin)])
    return runs


def _described(runs: list[Run], proposed: bool) -> str:
    if not runs:
        return "no beam sees the robot itself"
    beams = counted(sum(map(len, runs)), "beam")
    lows = [low for run in runs for _, low in run]
    where = f"{beams} at {min(lows):.2f} to {max(lows) + WINDOW:.2f} m"
    if proposed:
        return f"{where} look like the robot itself: --mask FILE masks them (lidarcli info proposes one, docs/formats.md)"
    return f"{where} see the robot itself: masked"
