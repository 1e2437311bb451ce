"""The tracker: follows objects from sweep to sweep, batch by batch of one topic (§3, matching and tracking).

Every sensor frame of the topic has a tracker of its own: what one sensor saw says nothing of what another one sees.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detect import scans
from lidarcli.formalism.detection import AGENT, LEGGED, NOISE, OBJECT, REMOVED, Detection
from lidarcli.formalism.mapping.places import MOST_SENSORS, Standing
from lidarcli.formalism.matching.catalogue import Catalogue
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.kalman import PoseErrorFilter, Targets
from lidarcli.formalism.tracking.keyframes import Keyframes
from lidarcli.formalism.tracking.measurement import Detections, Measurements
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks, Trajectories
from lidarcli.formalism.tracking.sweep_tracker import SweepTracker
from lidarcli.formalism.tracking.tracks import Naming, Track, standing, tracks_of
from lidarcli.formalism.tracking.windows import RESULT, TrackRegistry, Window, WindowResult
from lidarcli.sweeps import Bool, Float64, Int32, Int64, SweepBatch

WINDOW = 256
"""Number of sweeps of a window. Its rows are settled once the next window has been seen.

The windows of all sensors of a topic end together, as soon as that of one of them is full.
"""
TARGETS_AT_FIRST, MEASUREMENTS_AT_FIRST, SIGHTINGS_AT_FIRST = 64, 32, 2048
"""Room for so many tracklets, objects of a sweep, and sightings before it grows."""
NOTED_WAY = 1.0
"""[m] Least distance that the sensor has gone for a note on its poses."""
NOTED_SDS = 3.0
"""Least delay or distance of a note, in standard deviations."""
NOTED_DELAY, NOTED_DISTANCE = 0.02, 0.05
"""[s], [m] Least delay and least distance of a note."""
LONG_TRACK, MOST_MOVING, LEAST_TRACKS = 20, 0.6, 4
"""Least number of sweeps of a track that counts for a note on motion; share of these tracks that move above which the
sensor seems to move; least number of them."""


@dataclass(slots=True)
class _PendingBatch:
    """A batch that waits until the windows of all its sweeps are settled."""

    batch: SweepBatch
    detection: Detection
    sensor: Int64
    """(K,) index of the sensor of each object."""
    stop: int
    """Number of sweeps of the topic up to its last one."""


class _SensorTracker:
    """The tracker of one sensor, its tracks, and the results that no batch has taken yet."""

    def __init__(self, register: TrackRegistry) -> None:
        self.tracker = SweepTracker(Targets(TARGETS_AT_FIRST), Measurements(MEASUREMENTS_AT_FIRST, 1), Keyframes(1))
        self.register = register
        self.standing = Standing()
        self.tracker.sightings.resize(SIGHTINGS_AT_FIRST)
        self.results: deque[WindowResult] = deque()
        """Results for the next objects, in pieces."""

    def settle(self, window: Window) -> None:
        """Settle its oldest window."""
        sightings = self.tracker.sightings
        self.results.append(self.register.settle(window, sightings, self.tracker.frames))
        count = sightings.count
        done = int(np.searchsorted(sightings.arrays["sweep"][:count], window.begin + window.count))
        for values in sightings.arrays.values():
            values[: count - done] = values[done:count].copy()
        sightings.count = count - done

    def make_room(self, objects: int, beams: int) -> None:
        """Make room for sweeps of so many objects and beams."""
        tracker = self.tracker
        if objects > tracker.measurements.objects or beams > tracker.measurements.beams:
            rooms = (objects, tracker.measurements.objects), (beams, tracker.measurements.beams)
            # Powers of two, so that they grow seldom.
            measurements = Measurements(*(max(room, 1 << max(wanted - 1, 0).bit_length()) for wanted, room in rooms))
            history = tracker.frames
            if measurements.beams > history.beams:
                history = Keyframes(measurements.beams)
                history.grow(tracker.frames)
            tracker.resize(tracker.targets, measurements, history)

    def enlarge(self) -> None:
        """Double the room for tracklets or sightings, whichever is short."""
        tracker = self.tracker
        if tracker.sightings.count + tracker.measurements.objects > tracker.sightings.capacity:
            tracker.sightings.resize(2 * tracker.sightings.capacity)
        if tracker.targets.slots_used + 2 * tracker.measurements.objects > tracker.targets.capacity:
            targets = Targets(2 * tracker.targets.capacity)
            targets.grow(tracker.targets)
            tracker.resize(targets, tracker.measurements, tracker.frames)

    def take(self, count: int) -> WindowResult:
        """Return the results for the next objects."""
        parts = [np.empty(0, RESULT)]
        while count > 0:
            piece = self.results.popleft()
            if len(piece) > count:
                self.results.appendleft(piece[count:])
                piece = piece[:count]
            parts.append(piece)
            count -= len(piece)
        return np.concatenate(parts)


class Tracker:
    """Tracks the objects of one topic in bounded memory; the size of the batches does not change the result."""

    def __init__(self, parameters: TrackParameters | None = None, catalogue: Catalogue | None = None) -> None:
        """
        Parameters
        ----------
        parameters : parameters of the tracking
        catalogue : things of interest, which give tracks their names
        """
        self.parameters = parameters or TrackParameters()
        self._catalogue = catalogue
        self.frames: list[str] = []
        """Names of sensor frames, by index (`Tracks.frame`)."""
        self.notes: list[str] = []
        """Notes for the user, a line each; complete after `finish`."""
        self._first_ns: int | None = None
        self._topic = ""
        self._run = 1
        self._sensors: list[_SensorTracker] = []
        """By the index of the frame."""
        self._tracks: list[Track] = []
        """Those of all sensors, by number."""
        self._pending: deque[_PendingBatch] = deque()
        self._windows: deque[dict[int, Window]] = deque([{}])
        """Windows of the sensors that are not settled; the last ones are being filled."""
        self._objects = self._sweeps = self._settled_sweeps = 0

    def add(self, batch: SweepBatch, detection: Detection) -> list[TrackedBatch]:
        """Take the next sweeps of the topic, and return the results for earlier batches that are settled by now, in order.

        Parameters
        ----------
        batch : sweeps of one topic, in the order of the log
        detection : result of `detect` for them

        Raises
        ------
        ValueError
            The arrays of the batch do not fit together (`detect.check`).
        """
        if batch.run != self._run and len(batch):
            self._end_run()
            self._run = batch.run
        frames = self._frames(batch)
        which = np.minimum(frames, MOST_SENSORS - 1)
        if len(batch):
            self._process(batch, detection, frames, which)
        self._pending.append(_PendingBatch(batch, detection, which[detection.row], self._sweeps))
        self._objects += len(detection)
        return self._results()

    def finish(self) -> tuple[list[TrackedBatch], Tracks]:
        """Settle everything, and return the remaining results and all tracks."""
        self._settle_all()
        return self._results(), tracks_of(self._tracks)

    def _settle_all(self) -> None:
        """Settle everything so far."""
        for sensor in self._sensors:
            sensor.register.collect(sensor.tracker.targets)
        if not self._windows[-1]:
            self._windows.pop()
        while self._windows:
            self._settle()
        for frame, sensor in zip(self.frames, self._sensors, strict=False):
            name = self._topic if len(self._sensors) == 1 else f"{self._topic} ({frame or 'without a name'})"
            self.notes += notes_of(name, sensor.tracker.pose_error, sensor.register.tracks, sensor.tracker.moves)

    def _end_run(self) -> None:
        """End all tracks, as the clock starts anew; numbers go on."""
        self._settle_all()
        self._windows.append({})
        self._first_ns = None
        for index, ended in enumerate(self._sensors):
            sensor = self._sensors[index] = self._sensor()
            sensor.results = ended.results
            sensor.register.trajectories = [
                *ended.register.trajectories,
                *standing(ended.register.sweeps, ended.register.tracks),
            ]

    def trajectories(self) -> Iterator[Trajectories]:
        """Yield the rows that are settled and were not yielded before: of what moves; after `finish` all that are left."""
        for sensor in self._sensors:
            rows, sensor.register.trajectories = sensor.register.trajectories, []
            yield from rows
            if not self._windows:
                yield from standing(sensor.register.sweeps, sensor.register.tracks)

    def _process(self, batch: SweepBatch, detection: Detection, frames: Int64, which: Int64) -> None:
        """Track the sweeps of a batch, run by run of one sensor, and window by window."""
        if self._first_ns is None:
            self._first_ns = int(batch.stamp_ns[0])
            self._topic = batch.topic
        scans_of_batch = scans(batch)
        poses = _poses(batch)
        seconds = (batch.stamp_ns - np.int64(self._first_ns)) / 1e9
        motion = np.zeros((len(batch), 3))
        if batch.poses is not None and batch.poses.way is not None:
            motion = batch.poses.way
        shares = detection.shares(batch)
        posed = _posed(batch)
        placed = posed.copy() if batch.still is None else posed | batch.still
        for name, rows, mine in batch.by_frame() if batch.still is None else ():
            sensor = self._sensors[min(self.frames.index(name), MOST_SENSORS - 1)]
            placed[rows] |= sensor.standing.see(mine)
        detections = Detections(detection, poses, seconds, motion, shares, placed)
        for index in np.flatnonzero(np.bincount(which)).tolist():
            sensor = self._sensors[index]
            sensor.make_room(detections.max_objects, batch.width)
            sensor.tracker.objects = self._objects
        times = batch.seconds()
        sizes = None
        if (naming := self._sensors[0].register.naming) is not None:
            then = poses[detection.row]
            then[:, 2] += shares * motion[detection.row, 2]
            sizes = naming.measure(batch, detection, then)
        numbers = np.zeros(len(detection), np.int64)
        offsets = np.searchsorted(detection.row, np.arange(len(batch) + 1))
        row = 0
        for end in [*(np.flatnonzero(np.diff(which)) + 1).tolist(), len(batch)]:
            index = int(which[row])
            sensor = self._sensors[index]
            tracker, register = sensor.tracker, sensor.register
            while row < end:
                begin, before = row, tracker.sweeps
                tracker.moves = bool(posed[row])
                window = self._windows[-1].setdefault(index, Window(before))
                stop = min(end, row + WINDOW - (before - window.begin))
                while (row := tracker.process(detections, scans_of_batch, row, stop, numbers)) < stop:
                    sensor.enlarge()
                first, last = int(offsets[begin]), int(offsets[row])
                window.numbers.append(numbers[first:last])
                window.sweeps.append(detection.row[first:last] + (before - begin))
                window.count += row - begin
                some = slice(begin, row)
                register.sweeps.add(
                    batch.sweep[some], batch.stamp_ns[some], times[some], tracker.moves, frames[some], placed[some]
                )
                if sizes is not None:
                    window.sizes.append(sizes[first:last])
                if tracker.sweeps - window.begin == WINDOW:
                    # All windows end together, and those before are settled.
                    for each in self._sensors:
                        each.register.collect(each.tracker.targets)
                    if len(self._windows) > 1:
                        self._settle()
                    self._windows.append({})
        self._sweeps += len(batch)

    def _frames(self, batch: SweepBatch) -> Int64:
        """Return (S,) the index into `frames` of each sweep; new frames get a sensor while there is room."""
        for name in batch.frame_ids:
            if name in self.frames:
                continue
            self.frames.append(name)
            if len(self._sensors) < MOST_SENSORS:
                self._sensors.append(self._sensor())
        numbers: Int64 = np.array([self.frames.index(name) for name in batch.frame_ids], np.int64)
        return numbers[batch.frame]

    def _sensor(self) -> _SensorTracker:
        """Return the tracker of a sensor that has seen nothing yet."""
        naming = None if self._catalogue is None else Naming(self._catalogue)
        return _SensorTracker(TrackRegistry(self.parameters.agent_score, naming, self._tracks))

    def _settle(self) -> None:
        """Settle the oldest window of each sensor."""
        for index, window in sorted(self._windows.popleft().items()):
            self._sensors[index].settle(window)
            self._settled_sweeps += window.count

    def _results(self) -> list[TrackedBatch]:
        """Return the results for the batches whose sweeps are all settled."""
        done = []
        while self._pending and self._pending[0].stop <= self._settled_sweeps:
            one = self._pending.popleft()
            done.append(_tracked_batch(one, self._take(one), self.parameters.memory))
        return done

    def _take(self, one: _PendingBatch) -> WindowResult:
        """Return the results for the objects of a batch."""
        counts = np.bincount(one.sensor).tolist()
        parts = [self._sensors[index].take(count) for index, count in enumerate(counts) if count]
        if len(parts) == 1:
            return parts[0]
        found = np.concatenate([np.empty(0, RESULT), *parts])
        return found[np.argsort(np.argsort(one.sensor, kind="stable"))]


def _tracked_batch(one: _PendingBatch, settled: WindowResult, by_memory: bool) -> TrackedBatch:
    """Return the results for a batch; by memory, objects have the shapes of their tracks."""
    found, sweeps = one.detection, len(one.batch)
    known = settled["track"] > 0
    kind, shape = found.set.copy(), found.shape.copy()
    if by_memory:
        shape[known & (shape != LEGGED)] = settled["shape"][known & (shape != LEGGED)]
    kind[known & settled["agent"] & (kind == OBJECT)] = AGENT
    agent, thing_at = kind == AGENT, kind == OBJECT
    if found.change is not None:
        # An object that was removed is not in the sweep.
        thing_at &= found.change != REMOVED
    order = np.lexsort((found.theta_i, kind == NOISE, found.row))
    number, row = np.empty(len(order), np.int32), found.row[order]
    number[order] = np.arange(len(order)) - np.searchsorted(row, row) + 1
    agent_beams = _count(found.row[agent], found.beams[agent], sweeps)
    object_beams = _count(found.row[thing_at], found.beams[thing_at], sweeps)
    return TrackedBatch(
        track=settled["track"].copy(),
        vx=settled["vx"].copy(),
        vy=settled["vy"].copy(),
        moving=np.where(known, settled["moving"], -1).astype(np.int8),
        agent_score=settled["agent_score"].copy(),
        set=kind,
        shape=shape,
        thing=found.thing,
        order=order,
        object=number,
        label=settled["label"].copy(),
        label_score=settled["label_score"].copy(),
        objects=_count(found.row[thing_at], None, sweeps),
        agents=_count(found.row[agent], None, sweeps),
        object_beams=object_beams,
        agent_beams=agent_beams,
        noise_beams=(one.batch.beams - object_beams - agent_beams).astype(np.int32),
    )


def _count(rows: NDArray[np.int64], weights: NDArray[Any] | None, sweeps: int) -> Int32:
    """Return (S,) how many are in each row of a batch, or the sum of their weights."""
    return np.bincount(rows, weights, minlength=sweeps).astype(np.int32)


def _posed(batch: SweepBatch) -> Bool:
    """Return (S,) True where the log gives poses of the sensor, be they known at the time or not."""
    if batch.poses is None or batch.poses.absent is None:
        return np.full(len(batch), batch.poses is not None)
    return ~batch.poses.absent


def _poses(batch: SweepBatch) -> Float64:
    """Return (S, 4) x, y, yaw and side of the sensor; without poses it is taken to stand."""
    poses = batch.poses
    if poses is None:
        return np.tile([0.0, 0.0, 0.0, 1.0], (len(batch), 1))
    columns = np.column_stack([poses.x, poses.y, poses.yaw, np.where(poses.upside_down, -1.0, 1.0)])
    columns[~np.isfinite(columns).all(axis=1), :3] = np.nan
    columns[~_posed(batch)] = [0.0, 0.0, 0.0, 1.0]
    return columns


def share_moving(sweeps: Sequence[int], moved: Sequence[bool]) -> float | None:
    """Return the share of long tracks that move, if it is so great that the sensor seems to; else None.

    Parameters
    ----------
    sweeps, moved : for each track the sweeps that saw it, and whether it ever moved
    """
    long = [moves for count, moves in zip(sweeps, moved, strict=True) if count >= LONG_TRACK]
    if len(long) < LEAST_TRACKS or sum(long) <= MOST_MOVING * len(long):
        return None
    return sum(long) / len(long)


def notes_of(topic: str, pose_error: PoseErrorFilter, tracks: list[Track], has_poses: bool) -> list[str]:
    """Return notes for the user on a topic that was tracked: the error of its poses, or that it should have some."""
    notes = []
    if has_poses and pose_error.travelled >= NOTED_WAY:
        delay, ahead, left, delay_sd, place_sd = pose_error.estimate()
        if abs(delay) > max(NOTED_DELAY, NOTED_SDS * delay_sd):
            when = "late" if delay > 0 else "early"
            notes.append(f"static objects show the poses {abs(delay):.2f} s {when}: corrected for tracks")
        if math.hypot(ahead, left) > max(NOTED_DISTANCE, NOTED_SDS * place_sd):
            sides = (ahead, "ahead" if ahead > 0 else "behind"), (left, f"to the {'left' if left > 0 else 'right'}")
            where = " and ".join(f"{abs(off):.2f} m {words}" for off, words in sides if abs(off) >= 0.01)
            notes.append(f"static objects show the sensor {where} of where its poses are told: corrected for tracks")
    if share_moving([track.sweeps for track in tracks], [track.moved for track in tracks]) is not None:
        long = [track.moved for track in tracks if track.sweeps >= LONG_TRACK]
        why = "without poses the sensor is taken as standing; if it drives, tracks need a log with its poses (tf, odometry)"
        if has_poses:
            why = "the poses may be wrong, or sweeps take long (--pose match|TOPIC|none, docs/poses.md)"
        counted = f"{sum(long)} of {len(long)} tracks count as moving, which is unlikely"
        notes.append(f"{counted}: do not trust agents here; {why}")
    return [f"{topic}: {note}" for note in notes]
