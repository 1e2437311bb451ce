"""The sensors of a robot as one LaserScan: the nearest return by bearing, from one frame of the robot (docs/clean.md)."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from lidarcli.copying.copying import Copy, Edit, Met, renamed
from lidarcli.copying.mends import merged
from lidarcli.display.texts import counted
from lidarcli.errors import OptionError
from lidarcli.formalism.mapping.grid import CLEAR, HIT, SKIPPED, placed
from lidarcli.logs.base import Log
from lidarcli.logs.blocks import ScanLayout
from lidarcli.options.times import SECOND_NS
from lidarcli.pipeline.inputs.sources import read_pose_messages
from lidarcli.pipeline.reading.one_log import Reading
from lidarcli.pipeline.reading.robots import mount_on
from lidarcli.pose.findings import Key
from lidarcli.pose.sources import PoseChain
from lidarcli.pose.tracks import planar
from lidarcli.sweeps.types import TURN, Bool, Float64, Status, SweepBatch, UInt8

OLDEST = 0.25
"""A sweep that is older than this [s] adds nothing to one of the first sensor."""
MAX_BEAMS = 100_000
"""Most beams of a merged sweep: no sensor has steps below 0.004 degrees."""


class _PlacedSweep(NamedTuple):
    """A sweep, its beams in the world."""

    stamp_ns: int
    end: Float64
    """(2, B) ends of its beams [m]."""
    use: UInt8
    """(B,) as of `placed`."""
    range_max: float
    base: Float64
    """x, y and yaw of the frame of the merged sweeps [m, rad]; of the first sensor alone."""


@dataclass(slots=True)
class Merging:
    """The merged sweeps of a log, made while it is copied: for each sweep of the first sensor one, with its stamp."""

    topic: str
    encoding: str
    keys: tuple[Key, ...]
    batches: Iterator[SweepBatch]
    """The sweeps of all these, with their poses."""
    mount: PoseChain
    """Chain from the first sensor to the frame of the merged sweeps."""
    inner: Edit | None = None
    """The edit that each message gets before."""
    copies: Counter[int] | None = None
    """Number of times that each sweep of the first sensor is copied; None: all are, once."""
    missed: int = 0
    """Sweeps of the first sensor that are copied without a merged one, for they have no place."""
    lacking: Counter[str] = field(default_factory=Counter)
    """Topic → merged sweeps to which it adds nothing."""
    _beams: int = 0
    _waiting: dict[str, deque[tuple[int, _PlacedSweep | None]]] = field(default_factory=dict)
    _latest: dict[str, tuple[_PlacedSweep, Bool]] = field(default_factory=dict)
    """Topic → its last sweep, and (B,) True for the beams that are removed."""
    _made: bytes | None = None
    _origins: dict[object, tuple[Any, Any]] = field(default_factory=dict)

    def __call__(self, topic: str, number: int, data: bytes, written: ScanLayout) -> bytes:
        """Return the message to write, as `copying.Edit`."""
        new = data if self.inner is None else self.inner(topic, number, data, written)
        if topic not in {name for name, _ in self.keys}:
            return new
        first = self.keys[0][0]
        times = (1 if self.copies is None else self.copies[number]) if topic == first else 0
        if (sweep := self._sweep(topic, number)) is None:
            self.missed += times
            return new
        hidden = np.zeros(len(sweep.use), np.bool_)
        if new is not data and len(new) == len(data):
            before, after = (np.frombuffer(each, np.uint8) for each in (data, new))
            wide = written.place[:, None] + np.arange(np.dtype(written.kind).itemsize)
            hidden[written.beam[(before[wide] != after[wide]).any(axis=1)]] = True
        self._latest[topic] = sweep, hidden
        if topic == first:
            there = [name for name, (one, _) in self._latest.items() if self._is_recent(one, sweep)]
            self._made = self._merged(sweep, there, data)
            self.missed += times * (self._made is None)
            for name in {name for name, _ in self.keys} - {*there} if times else ():
                self.lacking[name] += times
        return new

    def copy(self, copy: Copy) -> Copy:
        """Return a copy that writes the merged sweeps, too."""
        self.inner = copy.edit
        return replace(copy, edit=self, after=self.after)

    def notes(self) -> list[str]:
        """Return what the run has to say."""
        names = ", ".join(name for name, _ in self.keys)
        missed = f"; {self.missed:,} of these have no place, and no merged one" if self.missed else ""
        lacking = [
            f"{counted(number, 'sweep')} of {self.topic} without {name}, which has none at most {OLDEST} s before"
            for name, number in sorted(self.lacking.items())
        ]
        made = f"{self.topic} is {names} merged, in {self.mount.world}: a sweep for each of {self.keys[0][0]}{missed}"
        return [made, *lacking]

    def after(self, met: Met) -> Sequence[Met]:
        """Return what is written after a message."""
        data, self._made = self._made, None
        return () if data is None else (renamed(met, self.topic, data, self._origins),)

    def _sweep(self, topic: str, number: int) -> _PlacedSweep | None:
        """Return a sweep; None where its place is unknown."""
        waiting = self._waiting.setdefault(topic, deque())
        while not waiting or waiting[-1][0] < number:
            if (batch := next(self.batches, None)) is None:
                return None
            self._take(batch)
        while waiting[0][0] < number:
            waiting.popleft()
        return waiting[0][1] if waiting[0][0] == number else None

    def _take(self, batch: SweepBatch) -> None:
        poses, waiting = batch.poses, self._waiting.setdefault(batch.topic, deque())
        if poses is None or not batch.robot:
            waiting += [(number, None) for number in batch.sweep.tolist()]
            return
        is_clear = batch.status == Status.NO_RETURN
        use = np.where(batch.status == Status.VALID, HIT, np.where(is_clear, CLEAR, SKIPPED)).astype(np.uint8)
        # A beam without a return counts in its direction alone.
        end = placed(batch, poses, use, np.where(is_clear, np.float32(10.0), batch.ranges)).end
        base = np.zeros((len(batch), 3))
        if batch.topic == self.keys[0][0]:
            step = abs(float(batch.angle_increment[0]))
            if not self._beams and step * MAX_BEAMS < TURN:
                raise OptionError(
                    f"--merge: the first beams of {batch.topic} are {step:g} rad apart, which makes more than "
                    f"{MAX_BEAMS:,} of a turn"
                )
            self._beams = self._beams or round(TURN / step)
            mount = planar(self.mount.at(batch.stamp_ns))
            yaw = poses.yaw - mount.yaw
            cos, sin = np.cos(yaw), np.sin(yaw)
            base = np.column_stack([poses.x - cos * mount.x + sin * mount.y, poses.y - sin * mount.x - cos * mount.y, yaw])
        known = np.isfinite(poses.x) & np.isfinite(poses.yaw) & np.isfinite(base).all(axis=1)
        for row, number in enumerate(batch.sweep.tolist()):
            stamp_ns, most = int(batch.stamp_ns[row]), float(batch.range_max[row])
            sweep = _PlacedSweep(stamp_ns, end[:, row, : batch.beams[row]], use[row, : batch.beams[row]], most, base[row])
            waiting.append((number, sweep if known[row] else None))

    def _is_recent(self, sweep: _PlacedSweep, first: _PlacedSweep) -> bool:
        """Return whether a sweep is recent enough to be merged with one of the first sensor."""
        return abs(first.stamp_ns - sweep.stamp_ns) <= OLDEST * SECOND_NS

    def _merged(self, first: _PlacedSweep, topics: Sequence[str], data: bytes) -> bytes | None:
        """Return the message for a sweep of the first sensor, which is `data`, with the last sweeps of some topics."""
        x, y, yaw = first.base
        cos, sin = np.cos(yaw), np.sin(yaw)
        nearest, clear, most = np.full(self._beams, np.inf), np.zeros(self._beams, np.bool_), 0.0
        for sweep, hidden in map(self._latest.__getitem__, topics):
            right, up = sweep.end[0] - x, sweep.end[1] - y
            bearing = np.arctan2(cos * up - sin * right, cos * right + sin * up) + TURN / 2
            at = np.rint(np.nan_to_num(bearing) * (self._beams / TURN)).astype(np.int64) % self._beams
            hit, free = ((sweep.use == use) & ~hidden for use in (HIT, CLEAR))
            np.minimum.at(nearest, at[hit], np.hypot(right, up)[hit])
            clear[at[free]] = True
            most = max(most, sweep.range_max)
        ranges = np.where(np.isinf(nearest) & ~clear, np.nan, nearest).astype(np.float32)
        return merged(data, self.encoding, self.mount.world, ranges, most)


def merging_of(log: Log, reading: Reading, topic: str, frame: str | None) -> Merging:
    """Return what merges the sensors of the robot of a log into a topic; `reading` has their sweeps.

    `OptionError`: the log has the topic, or no sensors that can be merged, or no such frame.
    """
    topics = {each.name: each for each in log.topics() or ()}
    if not topic.strip("/ "):
        raise OptionError("--merge: give the topic a name, as /scan")
    if topic in topics:
        raise OptionError(f"--merge: the log has a topic {topic}; give another name")
    robots = {keys for one in reading.posing.every for keys in one.robots.values()}
    if len(robots) != 1:
        why = "several robots; choose one by --topic" if robots else "; ".join(reading.posing.remarks) or "one sensor"
        raise OptionError(f"--merge: no sensors of one robot: {why}")
    (keys,) = robots
    if odd := [name for name, _ in keys if not topics[name].is_laserscan]:
        raise OptionError(f"--merge: {odd[0]} is a {topics[odd[0]].type}, and only a LaserScan of ROS is merged")
    posing = reading.posing
    tracks = posing.found.sources.tracks if posing.found is not None else read_pose_messages(log).tracks
    masks = reading.masking.rules.masks
    scans = [each.name for each in topics.values() if each.is_scan]
    mount = mount_on(keys[0], frame, tracks, () if masks is None else masks.mounts, scans)
    return Merging(topic, topics[keys[0][0]].encoding, keys, reading.batches(), mount)
