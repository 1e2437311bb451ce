"""The tracker: follows objects from sweep to sweep (§3, matching and tracking).

Sensors whose places in one world are known are followed together, sweep by sweep in the order of time: an object has one
track, whichever sensor observes it. Any other sensor has a follower of its own: it says nothing of what another one
observes."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.display.texts import Routine, headed
from lidarcli.formalism.detect import scans
from lidarcli.formalism.detection import AGENT, LEGGED, NOISE, OBJECT, REMOVED, Detection
from lidarcli.formalism.mapping.places import MAX_SENSORS, StaticSensor
from lidarcli.formalism.matching.catalogue import Catalogue
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.kalman import Targets
from lidarcli.formalism.tracking.keyframes import Keyframes
from lidarcli.formalism.tracking.measurement import Detections, Measurements
from lidarcli.formalism.tracking.pose_filter import PoseErrorFilter
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks, Trajectories
from lidarcli.formalism.tracking.sweep_tracker import SweepTracker
from lidarcli.formalism.tracking.track_labels import SizeMeasurements, TrackLabels
from lidarcli.formalism.tracking.tracks import Track, tracks_of
from lidarcli.formalism.tracking.trajectories import SWEEP, standing
from lidarcli.formalism.tracking.windows import RESULT, TrackRegistry, Window, WindowResult
from lidarcli.sweeps.types import Bool, Float64, Int32, Int64, SweepBatch

WINDOW = 256
"""Number of sweeps of a window, for each sensor. Its rows are settled once the next window has been observed.

The windows of all followers end together, as soon as that of one of them is full.
"""
TARGETS_AT_FIRST, MEASUREMENTS_AT_FIRST, SIGHTINGS_AT_FIRST = 64, 32, 2048
"""Room for so many tracklets, objects of a sweep, and sightings before it grows."""


@dataclass(frozen=True)
class NoteRules:
    """When a note says that poses are off, or that a sensor without poses seems to move."""

    min_path: float = 1.0
    """[m] Poses are noted once the sensor has gone so far."""
    deviations: float = 3.0
    """A delay or distance is noted that is so many standard deviations, ..."""
    min_delay: float = 0.02
    """[s] ... and this delay, ..."""
    min_distance: float = 0.05
    """[m] ... or this distance."""
    static_share: float = 0.9
    """A sensor without poses that was static at this share of the sweeps does not move."""
    long_track: int = 20
    """Tracks of so many sweeps count."""
    max_moving: float = 0.6
    """The sensor seems to move where a larger share of these moves, ..."""
    min_tracks: int = 4
    """... if there are so many."""


NOTES = NoteRules()


@dataclass(slots=True)
class _PendingBatch:
    """A batch that waits until the windows of all its sweeps are settled."""

    batch: SweepBatch
    detection: Detection
    settled: WindowResult
    """(K,) the results for its objects so far."""
    left: int
    """Number of its sweeps that are not settled."""


@dataclass(slots=True)
class _Progress:
    """A batch whose sweeps are followed, up to `row`."""

    pending: _PendingBatch
    scans: Any
    detections: Detections
    sensor: Int64
    """(S,) index of the sensor of each sweep."""
    rows: NDArray[np.void]
    """(S,) `SWEEP`."""
    sizes: SizeMeasurements | None
    numbers: Int64
    """(K,) number of the tracklet of each object."""
    offsets: list[int]
    """S + 1 numbers of objects before each sweep."""
    row: int = 0

    @property
    def is_done(self) -> bool:
        """True where all of its sweeps have been followed."""
        return self.row == len(self.sensor)

    def turn_of(self, row: int) -> tuple[int, int, str]:
        """Return run, stamp and topic of a sweep: the lowest one has its turn."""
        batch = self.pending.batch
        return batch.run, batch.stamp_ns.item(row), batch.topic

    @property
    def turn(self) -> tuple[int, int, str]:
        """That of its next sweep."""
        return self.turn_of(self.row)


class _Follower:
    """The tracker of one sensor, or of several in one world, and the tracks."""

    def __init__(self, register: TrackRegistry, sensors: int = 1) -> None:
        frames = Keyframes(1, sensors)
        self.tracker = SweepTracker(Targets(TARGETS_AT_FIRST), Measurements(MEASUREMENTS_AT_FIRST, 1), frames)
        self.register = register
        self.window = WINDOW * sensors
        self.tracker.sightings.resize(SIGHTINGS_AT_FIRST)

    def settle(self, window: Window) -> None:
        """Settle its oldest window."""
        sightings = self.tracker.sightings
        settled, begin = self.register.settle(window, sightings, self.tracker.frames), 0
        for pending, objects, sweeps in window.pieces:
            end = begin + objects.stop - objects.start
            pending.settled[objects], begin = settled[begin:end], end
            pending.left -= sweeps
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
                history = Keyframes(measurements.beams, history.sensors)
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


class Tracker:
    """Tracks the objects of one topic, or of the sensors of a robot, in bounded memory.

    The size of the batches does not change the result.
    """

    def __init__(
        self,
        parameters: TrackParameters | None = None,
        catalogue: Catalogue | None = None,
        *,
        together: Sequence[tuple[str, str]] = (),
        before: int = 0,
    ) -> None:
        """
        Parameters
        ----------
        parameters : parameters of the tracking
        catalogue : objects of interest, which give tracks their names
        together : topics and frames of the sensors whose poses are in one world, where they follow the same objects
        before : number of tracks of other trackers: numbers go on
        """
        self.parameters = parameters or TrackParameters()
        self._catalogue = catalogue
        self.sensors: list[tuple[str, str]] = [*together]
        """Topics and frames of the sensors, by index (`Tracks.sensor`)."""
        self.notes: list[str] = []
        """Notes for the user, a line each; complete after `finish`."""
        self._together, self._before = len(together), before
        self._lacking = {topic for topic, _ in together}
        self._going: list[_Progress] = []
        """Batches that are followed together, one of each topic."""
        self._first_ns: dict[int, int] = {}
        self._run = 0
        self._tracks: list[Track] = []
        """Those of all sensors, by number."""
        self._followers: list[_Follower] = []
        self._doubted: set[tuple[str, str]] = set()
        """Sensors whose poses some of their sweeps contradict."""
        self._static: dict[tuple[int, int], StaticSensor] = {}
        """Run and sensor → whether it is static, where nothing else tells."""
        self._settled_paths: list[Trajectories] = []
        """Rows of runs that have ended."""
        self._pending: list[_PendingBatch] = []
        self._windows: deque[dict[int, Window]] = deque([{}])
        """Windows of the followers that are not settled; the last ones are being filled."""
        if together:
            self._followers.append(self._follower(0))

    @property
    def lacks(self) -> str | None:
        """The topic whose next sweeps are needed before those of others can be followed; None where none is."""
        return min(self._lacking, default=None)

    def add(self, batch: SweepBatch, detection: Detection) -> list[TrackedBatch]:
        """Take the next sweeps of a topic, and return the results for earlier batches that are settled by now, in order.

        Sweeps of sensors that are followed together are taken in the order of time: they wait until each topic has given
        some (`lacks`).

        Parameters
        ----------
        batch : sweeps of one topic, in the order of the log
        detection : result of `detect` for them

        Raises
        ------
        ValueError
            The arrays of the batch do not fit together (`detect.check`).
        """
        going = self._begin(batch, detection)
        if not self._together:
            self._follow(going, len(batch))
        elif len(batch):
            self._lacking.discard(batch.topic)
            self._going.append(going)
            self._follow_in_turn()
        return self._results()

    def end(self, topic: str) -> list[TrackedBatch]:
        """Learn that a topic has no more sweeps, and return results as `add`."""
        self._lacking.discard(topic)
        self._follow_in_turn()
        return self._results()

    def finish(self) -> tuple[list[TrackedBatch], Tracks]:
        """Settle everything, and return the remaining results and all tracks."""
        self._settle_all()
        return self._results(), tracks_of(self._tracks)

    def _settle_all(self) -> None:
        """Settle everything so far."""
        for follower in self._followers:
            follower.register.collect(follower.tracker.targets)
        if not self._windows[-1]:
            self._windows.pop()
        while self._windows:
            self._settle()
        for index, follower in enumerate(self._followers):
            sensors = [self.sensors[k] for k in range(len(self.sensors)) if self._follower_of(k) == index]
            name = " and ".join(dict.fromkeys(topic for topic, _ in sensors))
            if len(self._followers) > 1:
                name += f" ({sensors[0][1] or 'without a name'})"
            pose_error, moves = follower.tracker.pose_error, follower.tracker.moves
            sweeps = follower.register.sweeps
            # Many objects may move where a sensor is static, and about one whose poses fit.
            placed = sweeps.of(0, sweeps.count)["placed"]
            doubted = any(sensor in self._doubted for sensor in sensors) if moves else placed.mean() < NOTES.static_share
            self.notes += notes_of(name, pose_error, follower.register.tracks if doubted else [], moves)

    def _end_run(self) -> None:
        """End all tracks, as the clock starts again; numbers go on."""
        self._settle_all()
        self._windows.append({})
        for index, ended in enumerate(self._followers):
            rows = [*ended.register.trajectories, *standing(ended.register.sweeps, ended.register.tracks)]
            self._followers[index] = self._follower(index)
            self._settled_paths += rows

    def trajectories(self) -> Iterator[Trajectories]:
        """Yield the rows that are settled and were not yielded before: of what moves; after `finish` all that are left."""
        rows, self._settled_paths = self._settled_paths, []
        yield from rows
        for follower in self._followers:
            rows, follower.register.trajectories = follower.register.trajectories, []
            yield from rows
            if not self._windows:
                yield from standing(follower.register.sweeps, follower.register.tracks)

    def _follow_in_turn(self) -> None:
        """Follow the sweeps of all topics in the order of time, until those of one are needed."""
        while self._going and not self._lacking:
            self._going.sort(key=lambda one: one.turn)
            one, stop = self._going[0], self._going[0].row + 1
            while stop < len(one.sensor) and (len(self._going) == 1 or one.turn_of(stop) < self._going[1].turn):
                stop += 1
            self._follow(one, stop)
            if one.is_done:
                self._lacking.add(one.pending.batch.topic)
                del self._going[0]

    def _begin(self, batch: SweepBatch, detection: Detection) -> _Progress:
        """Return a batch whose sweeps can be followed."""
        scans_of_batch = scans(batch)
        sensor = self._sensors_of(batch)
        first_ns = self._first_ns.setdefault(batch.run, int(batch.stamp_ns[0])) if len(batch) else 0
        poses = _poses(batch)
        seconds = (batch.stamp_ns - np.int64(first_ns)) / 1e9
        motion = np.zeros((len(batch), 3))
        if batch.poses is not None and batch.poses.way is not None:
            motion = batch.poses.way
        shares = detection.shares(batch)
        posed = _posed(batch)
        placed = posed.copy() if batch.still is None else posed | batch.still
        if batch.fits is not None:
            self._doubted |= {(batch.topic, batch.frame_ids[one]) for one in np.unique(batch.frame[~batch.fits]).tolist()}
        for name, rows, mine in batch.by_frame() if batch.still is None and len(batch) else ():
            key = batch.run, min(self.sensors.index((batch.topic, name)), MAX_SENSORS - 1)
            placed[rows] |= self._static.setdefault(key, StaticSensor()).see(mine)
        sizes = None
        if self._catalogue is not None:
            then = poses[detection.row]
            then[:, 2] += shares * motion[detection.row, 2]
            sizes = TrackLabels(self._catalogue).measure(batch, detection, then)
        pending = _PendingBatch(batch, detection, np.empty(len(detection), RESULT), len(batch))
        self._pending.append(pending)
        each = (batch.sweep, batch.stamp_ns, batch.seconds, posed, sensor, placed)
        all_rows: NDArray[np.void] = np.empty(len(batch), SWEEP)
        for name, values in zip(SWEEP.names or (), each, strict=True):
            all_rows[name] = values
        return _Progress(
            pending,
            scans_of_batch,
            Detections(detection, poses, seconds, motion, shares, placed),
            sensor,
            all_rows,
            sizes,
            np.zeros(len(detection), np.int64),
            np.searchsorted(detection.row, np.arange(len(batch) + 1)).tolist(),
        )

    def _follow(self, going: _Progress, end: int) -> None:
        """Follow the sweeps of a batch up to a row, run by run of one sensor, and window by window."""
        if going.row == end:
            return
        batch = going.pending.batch
        if batch.run != self._run:
            if self._run:
                self._end_run()
            self._run = batch.run
        sensors = going.sensor[going.row : end]
        edges = (np.flatnonzero(np.diff(sensors)) + going.row + 1).tolist() if len(batch.frame_ids) > 1 else []
        for stop in [*edges, end]:
            sensor = going.sensor.item(going.row)
            index = self._follower_of(sensor)
            follower = self._followers[index]
            follower.make_room(going.detections.max_objects, batch.width)
            follower.tracker.sensor = sensor if sensor < self._together else 0
            while going.row < stop:
                self._follow_in_window(going, index, stop)

    def _follow_in_window(self, going: _Progress, index: int, stop: int) -> None:
        """Follow sweeps of one sensor up to a row or to the end of the window."""
        follower = self._followers[index]
        tracker, register = follower.tracker, follower.register
        begin, before = going.row, tracker.sweeps
        tracker.moves = bool(going.rows["posed"][begin])
        window = self._windows[-1].setdefault(index, Window(before))
        row, stop = begin, min(stop, begin + follower.window - (before - window.begin))
        while (row := tracker.process(going.detections, going.scans, row, stop, going.numbers)) < stop:
            follower.enlarge()
        going.row = row
        objects = slice(going.offsets[begin], going.offsets[row])
        window.numbers.append(going.numbers[objects])
        window.sweeps.append(going.pending.detection.row[objects] + (before - begin))
        window.pieces.append((going.pending, objects, row - begin))
        window.count += row - begin
        register.sweeps.add(going.rows[begin:row])
        if going.sizes is not None:
            window.sizes.append(going.sizes[objects])
        if tracker.sweeps - window.begin == follower.window:
            # All windows end together, and those before are settled.
            for each in self._followers:
                each.register.collect(each.tracker.targets)
            if len(self._windows) > 1:
                self._settle()
            self._windows.append({})

    def _sensors_of(self, batch: SweepBatch) -> Int64:
        """Return (S,) the index of the sensor of each sweep; new ones get a follower while there is room."""
        known = {sensor: index for index, sensor in enumerate(self.sensors)}
        for name in batch.frame_ids:
            if known.setdefault((batch.topic, name), len(self.sensors)) == len(self.sensors):
                self.sensors.append((batch.topic, name))
                index = self._follower_of(len(self.sensors) - 1)
                if index == len(self._followers):
                    self._followers.append(self._follower(index))
        numbers = np.array([known[batch.topic, name] for name in batch.frame_ids], np.int64)
        return numbers[batch.frame]

    def _follower_of(self, sensor: int) -> int:
        """Return the index of the follower of a sensor: the first is that of those who are followed together."""
        if sensor < self._together:
            return 0
        return min(sensor - self._together + (self._together > 0), MAX_SENSORS - 1)

    def _follower(self, index: int) -> _Follower:
        """Return a follower that has observed nothing yet."""
        labels = None if self._catalogue is None else TrackLabels(self._catalogue)
        register = TrackRegistry(self.parameters.agent_score, labels, self._tracks, self._before)
        return _Follower(register, self._together if self._together and not index else 1)

    def _settle(self) -> None:
        """Settle the oldest window of each follower."""
        for index, window in sorted(self._windows.popleft().items()):
            self._followers[index].settle(window)

    def _results(self) -> list[TrackedBatch]:
        """Return the results for the batches whose sweeps are all settled, those of a topic in their order."""
        done, left = [], []
        waiting: set[str] = set()
        for one in self._pending:
            if one.left or one.batch.topic in waiting:
                waiting.add(one.batch.topic)
                left.append(one)
            else:
                done.append(_tracked_batch(one, self.parameters.memory))
        self._pending = left
        return done


def _tracked_batch(one: _PendingBatch, by_memory: bool) -> TrackedBatch:
    """Return the results for a batch; by memory, objects have the shapes of their tracks."""
    found, sweeps, settled = one.detection, len(one.batch), one.settled
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
        batch=one.batch,
        detection=found,
        track=settled["track"].copy(),
        vx=settled["vx"].copy(),
        vy=settled["vy"].copy(),
        moving=np.where(known, settled["moving"], -1).astype(np.int8),
        agent_score=settled["agent_score"].copy(),
        set=kind,
        shape=shape,
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
    """Return (S, 4) x, y, yaw and side of the sensor; without poses it is taken as static."""
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
    sweeps, moved : for each track the sweeps that observed it, and whether it ever moved
    """
    long = [moves for count, moves in zip(sweeps, moved, strict=True) if count >= NOTES.long_track]
    if len(long) < NOTES.min_tracks or sum(long) <= NOTES.max_moving * len(long):
        return None
    return sum(long) / len(long)


def notes_of(topic: str, pose_error: PoseErrorFilter, tracks: list[Track], has_poses: bool) -> list[str]:
    """Return notes for the user on a topic that was tracked: the error of its poses, or that it should have some."""
    notes: list[str] = []
    if has_poses and pose_error.travelled >= NOTES.min_path:
        delay, ahead, left, delay_sd, place_sd = pose_error.estimate()
        if abs(delay) > max(NOTES.min_delay, NOTES.deviations * delay_sd):
            when = "late" if delay > 0 else "early"
            notes.append(Routine(f"standing things show the poses {abs(delay):.2f} s {when}: corrected for tracks"))
        if math.hypot(ahead, left) > max(NOTES.min_distance, NOTES.deviations * place_sd):
            sides = (ahead, "ahead" if ahead > 0 else "behind"), (left, f"to the {'left' if left > 0 else 'right'}")
            where = " and ".join(f"{abs(off):.2f} m {words}" for off, words in sides if abs(off) >= 0.01)
            notes.append(Routine(f"standing things show the sensor {where} of its told place: corrected for tracks"))
    if share_moving([track.sweeps for track in tracks], [track.moved for track in tracks]) is not None:
        long = [track.moved for track in tracks if track.sweeps >= NOTES.long_track]
        why = "the poses may be wrong (--pose match)" if has_poses else "if the sensor drives, it needs poses"
        notes.append(f"{sum(long)} of {len(long)} tracks move: do not trust agents; {why}")
    return [headed(f"{topic}: ", note) for note in notes]
