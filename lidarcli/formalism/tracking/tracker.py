"""Follows things from sweep to sweep: a fold over the batches of one topic (§3, matching and tracking)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detect import scans
from lidarcli.formalism.detection import AGENT, LEGGED, NOISE, OBJECT, REMOVED, WALL, Detection
from lidarcli.formalism.tracking import noting, sightings, summary
from lidarcli.formalism.tracking.bodies import Bodies
from lidarcli.formalism.tracking.fold import Fold
from lidarcli.formalism.tracking.memory import Memory
from lidarcli.formalism.tracking.parameters import TrackParameters
from lidarcli.formalism.tracking.standing import Standing
from lidarcli.formalism.tracking.tracked import Followed, Tracks
from lidarcli.formalism.tracking.views import Seen, Views
from lidarcli.formalism.tracking.windows import Register, Settled, Window
from lidarcli.sweeps import Float64, Int32, Int64, SweepBatch

if TYPE_CHECKING:
    from lidarcli.formalism.catalogue import Catalogue
    from lidarcli.formalism.tracking.naming import Naming

WINDOW = 256
"""Sweeps of a window: the rows of one are settled when the next one has been seen."""
BODIES_AT_FIRST, OBJECTS_AT_FIRST, SIGHTINGS_AT_FIRST = 64, 32, 2048


@dataclass(slots=True)
class _Waiting:
    """A batch whose objects are followed, but not settled."""

    batch: SweepBatch
    detection: Detection
    objects: int
    """Objects of the topic before."""
    stop: int
    """Sweeps of the topic up to its last one, included."""


class Tracker:
    """Follows the things of one topic. Memory is bounded; the result does not depend on how sweeps are cut into batches."""

    def __init__(
        self,
        parameters: TrackParameters | None = None,
        catalogue: Catalogue | None = None,
        min_thing: float = 0.0,
    ) -> None:
        """
        Parameters
        ----------
        parameters : what tracking may assume
        catalogue : things of interest, by which things are named
        min_thing : what is less likely a thing, by all that was seen of it, is building; only with memory
        """
        self.parameters = parameters or TrackParameters()
        self._min_thing = min_thing
        self._naming: Naming | None = None
        if catalogue is not None:
            # Who has no catalogue does not wait for this import.
            from lidarcli.formalism.tracking.naming import Naming

            self._naming = Naming(catalogue)
        self.frames: list[str] = []
        """Names of sensor frames, which `Tracks.frame` points into."""
        self.notes: list[str] = []
        """What a user should know, a line each; whole after `finish`."""
        self._first_ns: int | None = None
        self._topic = ""
        self._standing = Standing()
        self._is_corrected = False
        self._fold = Fold(
            -math.log(self.parameters.significance),
            Bodies(BODIES_AT_FIRST),
            Views(OBJECTS_AT_FIRST, 1),
            Memory(1),
        )
        self._log = sightings.room(SIGHTINGS_AT_FIRST)
        self._fold.log.attach(self._log)
        self._register = Register(
            self._naming, _least_odds(min_thing) if self.parameters.memory else -math.inf
        )
        self._waiting: deque[_Waiting] = deque()
        self._windows: deque[Window] = deque([Window(0, 0)])
        """Those that are not settled; the last one is being filled."""
        self._objects = 0
        self._settled: deque[Settled] = deque()
        """What is known of the objects that come next, in pieces."""
        self._settled_sweeps = 0

    def add(self, batch: SweepBatch, detection: Detection) -> list[Followed]:
        """Take the next sweeps of the topic; returns what is settled by now, for earlier batches, in their order.

        Parameters
        ----------
        batch, detection : the sweeps of one topic in the order of the log, and what `detect` has found in them

        Raises
        ------
        ValueError
            What `check` refuses.
        """
        if len(batch):
            self._follow(batch, detection)
        self._waiting.append(_Waiting(batch, detection, self._objects, self._fold.sweeps))
        self._objects += len(detection)
        return self._answers()

    def finish(self) -> tuple[list[Followed], Tracks]:
        """The rest, and all things."""
        self._register.collect(self._fold.bodies)
        if not self._windows[-1].index:
            self._windows.pop()
        while self._windows:
            self._settle()
        self.notes = noting.notes_of(
            self._topic, self._fold.correction, self._register.tracks, self._fold.moves, self._is_corrected
        )
        return self._answers(), summary.tracks_of(self._register, self._fold.sweeps)

    def _follow(self, batch: SweepBatch, detection: Detection) -> None:
        """Follow the sweeps of a batch, window by window."""
        if self._first_ns is None:
            self._first_ns = int(batch.stamp_ns[0])
            self._topic = batch.topic
        fold, laid_out = self._fold, scans(batch)
        poses = _poses(batch)
        seconds = (batch.stamp_ns - np.int64(self._first_ns)) / 1e9
        way, shares = _way(batch), detection.shares(batch)
        seen = Seen(detection, poses, seconds, way, shares)
        self._make_room(seen.most, batch.width)
        fold.moves = batch.poses is not None
        if batch.true_poses is not None and not self._is_corrected:
            self._is_corrected = True
            fold.correction.trust()
        fold.objects = self._objects
        frames = self._frames(batch)
        placed = np.full(len(batch), batch.poses is not None) | self._standing.see(batch)
        looks = None
        if self._naming is not None:
            then = poses[detection.row]
            then[:, 2] += shares * way[detection.row, 2]
            looks = self._naming.see(batch, detection, then)
        numbers = np.zeros(len(detection), np.int64)
        offsets = np.searchsorted(detection.row, np.arange(len(batch) + 1))
        row = 0
        while row < len(batch):
            begin, before = row, fold.sweeps
            stop = min(len(batch), row + WINDOW - before % WINDOW)
            while (row := fold.follow(seen, laid_out, row, stop, numbers)) < stop:
                self._enlarge()
            window = self._windows[-1]
            first, last = int(offsets[begin]), int(offsets[row])
            window.numbers.append(numbers[first:last])
            window.sweeps.append(detection.row[first:last] + (before - begin))
            window.index.append(batch.sweep[begin:row])
            window.stamps.append(batch.stamp_ns[begin:row])
            window.frames.append(frames[begin:row])
            window.placed.append(placed[begin:row])
            if looks is not None:
                window.looks.append(looks.rows(slice(first, last)))
            if fold.sweeps % WINDOW == 0:
                self._register.collect(fold.bodies)
                if len(self._windows) > 1:
                    self._settle()
                self._windows.append(Window(fold.sweeps, self._objects + last))

    def _frames(self, batch: SweepBatch) -> Any:
        """(S,) the frame of each sweep among those of the topic."""
        for name in batch.frame_ids:
            if name not in self.frames:
                self.frames.append(name)
        return np.array([self.frames.index(name) for name in batch.frame_ids], np.int64)[batch.frame]

    def _settle(self) -> None:
        """Settle the window that is next."""
        window = self._windows.popleft()
        log, count = self._log, self._fold.log.count
        self._settled.append(self._register.settle(window, log, count))
        self._settled_sweeps = window.begin + window.count
        done = int(np.searchsorted(log["sweep"][:count], self._settled_sweeps))
        for values in log.values():
            values[: count - done] = values[done:count].copy()
        self._fold.log.count = count - done

    def _make_room(self, objects: int, beams: int) -> None:
        """Room for sweeps of so many objects and beams."""
        fold = self._fold
        if objects > fold.views.objects or beams > fold.views.beams:
            views = Views(_power(objects, fold.views.objects), _power(beams, fold.views.beams))
            fold.fit(fold.bodies, views, _grown(fold.past, views.beams))

    def _enlarge(self) -> None:
        """Twice as much room for bodies or sightings, whichever is short."""
        fold = self._fold
        if fold.log.count + fold.views.objects > fold.log.room:
            for name, values in self._log.items():
                more = np.zeros((2 * len(values), *values.shape[1:]), values.dtype)
                more[: len(values)] = values
                self._log[name] = more
            fold.log.attach(self._log)
        if fold.bodies.high + 2 * fold.views.objects > fold.bodies.most:
            bodies = Bodies(2 * fold.bodies.most)
            bodies.grow(fold.bodies)
            fold.fit(bodies, fold.views, fold.past)

    def _answers(self) -> list[Followed]:
        """What is known of the batches whose sweeps are all settled."""
        done = []
        while self._waiting and self._waiting[0].stop <= self._settled_sweeps:
            one = self._waiting.popleft()
            done.append(
                _followed(one, self._take(len(one.detection)), self._min_thing, self.parameters.memory)
            )
        return done

    def _take(self, count: int) -> Settled:
        """What is known of the next objects."""
        parts: list[Settled] = []
        while count > 0:
            piece = self._settled.popleft()
            if len(piece.track) > count:
                self._settled.appendleft(piece.rows(slice(count, None)))
                piece = piece.rows(slice(0, count))
            parts.append(piece)
            count -= len(piece.track)
        return Settled.joined(parts)


def _followed(one: _Waiting, settled: Settled, least: float, by_memory: bool) -> Followed:
    """What is said of the objects of a batch; what has no track is a thing from a probability of `least` on."""
    found, sweeps = one.detection, len(one.batch)
    known = settled.track > 0
    kind, shape, thing = found.set.copy(), found.shape.copy(), found.thing
    if by_memory:
        judged = settled.is_thing >= 0
        thing = np.where(judged & ~np.isnan(thing), settled.thing, thing)
        refused = (kind == OBJECT) & np.where(judged, settled.is_thing == 0, thing < least)
        shape[known & (shape != LEGGED)] = settled.shape[known & (shape != LEGGED)]
        kind[refused], shape[refused] = NOISE, WALL
    kind[known & settled.agent & (kind == OBJECT)] = AGENT
    agent, thing_at = kind == AGENT, kind == OBJECT
    if found.change is not None:
        # What has gone is no object of the sweep.
        thing_at &= found.change != REMOVED
    order = np.lexsort((found.theta_i, kind == NOISE, found.row))
    agent_beams = _count(found.row[agent], found.beams[agent], sweeps)
    object_beams = _count(found.row[thing_at], found.beams[thing_at], sweeps)
    return Followed(
        track=settled.track,
        vx=settled.vx,
        vy=settled.vy,
        moving=np.where(known, settled.moving, -1).astype(np.int8),
        set=kind,
        shape=shape,
        thing=thing,
        order=order,
        object=_numbers(found.row, order),
        label=settled.label,
        label_score=settled.label_score,
        objects=_count(found.row[thing_at], None, sweeps),
        agents=_count(found.row[agent], None, sweeps),
        object_beams=object_beams,
        agent_beams=agent_beams,
        noise_beams=(one.batch.beams - object_beams - agent_beams).astype(np.int32),
    )


def _numbers(row: Int64, order: Int64) -> Int32:
    """(K,) the place of each object, from 1, among those of its row in this order."""
    sorted_row = row[order]
    numbers = np.empty(len(row), np.int32)
    numbers[order] = np.arange(len(row)) - np.searchsorted(sorted_row, sorted_row) + 1
    return numbers


def _count(rows: NDArray[np.int64], weights: NDArray[Any] | None, sweeps: int) -> Int32:
    """(S,) how many are in each row of a batch, or the sum of their weights."""
    return np.bincount(rows, weights, minlength=sweeps).astype(np.int32)


def _least_odds(share: float) -> float:
    """Log-odds of a probability."""
    if not 0.0 < share < 1.0:
        return -math.inf if share <= 0.0 else math.inf
    return math.log(share / (1.0 - share))


def _poses(batch: SweepBatch) -> Float64:
    """(S, 4) x, y, yaw and side of the sensor; a sensor whose pose nobody tells stands."""
    poses = batch.true_poses or batch.poses
    if poses is None:
        return np.tile([0.0, 0.0, 0.0, 1.0], (len(batch), 1))
    told = np.column_stack([poses.x, poses.y, poses.yaw, np.where(poses.upside_down, -1.0, 1.0)])
    told[~np.isfinite(told).all(axis=1), :3] = np.nan
    return told


def _way(batch: SweepBatch) -> Float64:
    """(S, 3) how far the sensor goes in x, y, yaw during each sweep."""
    poses = batch.true_poses or batch.poses
    return np.zeros((len(batch), 3)) if poses is None or poses.way is None else poses.way


def _power(wanted: int, at_least: int) -> int:
    """A size that is a power of two, so that it grows seldom."""
    return max(at_least, 1 << max(wanted - 1, 0).bit_length())


def _grown(past: Memory, beams: int) -> Memory:
    """What is remembered, with room for sweeps of so many beams."""
    if beams <= past.beams:
        return past
    larger = Memory(beams)
    larger.grow(past)
    return larger
