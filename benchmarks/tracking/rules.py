"""Published trackers: their association, gates, motion models and lives, written anew from their code.

All follow the same detections, at the log's own rate. Where one publishes a track only after some sightings, its first
rows count as well, once it is published.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks.tracking.filters import Filters
from lidarcli.sweeps.types import Float64, Int64, record


@record
class Seen:
    """The K objects of one sweep, in the frame in which things are followed."""

    seconds: float
    """Since the sweep before."""
    place: Float64
    """(K, 2) centroid of the points [m]."""
    width: Float64
    """(K,) from the first to the last point [m]."""
    corners: Float64
    """(K, 4, 2) of the oriented box, the one nearest to the sensor first."""


_FAR = 1e6
"""A cost that nothing within a gate reaches."""


class Rules(Protocol):
    """A tracker."""

    SIGHTINGS: int
    """Tracks with fewer are not published."""

    def step(self, seen: Seen) -> tuple[Int64, Float64]:
        """The tracks (K,) of the objects of the next sweep, 0 for none, and their velocities (K, 2) [m/s]."""


def velocities(filters: Filters, track: Int64) -> Float64:
    """(K, 2) of tracks by number, NaN for those that are none."""
    velocity = np.full((len(track), 2), np.nan)
    order = np.argsort(filters.number)
    at = np.searchsorted(filters.number[order], track)
    at = order[np.minimum(at, max(len(order) - 1, 0))] if len(order) else at
    if len(order):
        known = filters.number[at] == track
        velocity[known] = filters.velocity[at[known]]
    return velocity


def distances(a: Float64, b: Float64) -> Float64:
    """(A, B) between places."""
    distances: Float64 = np.hypot(*(a[:, None] - b[None]).transpose(2, 0, 1))
    return distances


def one_to_one(cost: Float64, gate: float) -> tuple[Int64, Int64]:
    """Rows and columns of the assignment with the least sum, as far as they are within the gate."""
    rows, columns = linear_sum_assignment(np.where(cost < gate, cost, _FAR))
    near = cost[rows, columns] < gate
    return rows[near], columns[near]


def _argmin(cost: Float64) -> Int64:
    """(A,) the column of the least value of each row of (A, B), -1 where none is finite."""
    if not cost.size:
        return np.full(len(cost), -1)
    return np.where(np.isfinite(cost.min(axis=1)), cost.argmin(axis=1), -1)


class Datmo:
    """kostaskonkk/datmo: every track takes what is nearest; forgotten as soon as it misses one sweep.

    A filter with constant acceleration follows a corner of the box. The corner that is nearest to the predicted one is
    taken, which spares it the jumps of the published code.
    """

    SIGHTINGS = 1
    GATE = 0.25
    """[m], sum of the distances along x and y."""

    def __init__(self) -> None:
        self.filters = Filters(np.ones(3), np.array([1.0, 10.0, 20.0]), 0.1)
        self.centroid = np.empty((0, 2))

    def step(self, seen: Seen) -> tuple[Int64, Float64]:
        """See `Rules`."""
        filters, track = self.filters, np.zeros(len(seen.place), np.int64)
        filters.predict(seen.seconds)
        away = np.abs(self.centroid[:, None] - seen.place[None]).sum(axis=-1)
        matched = np.zeros(len(filters.number), np.bool_)
        if away.size:
            nearest = away.argmin(axis=1)
            matched = away[np.arange(len(away)), nearest] < self.GATE
            which = np.flatnonzero(matched)
            taken = nearest[which]
            corners = seen.corners[taken]
            off = np.hypot(*(corners - filters.place[which, None]).transpose(2, 0, 1))
            filters.correct(which, corners[np.arange(len(which)), off.argmin(axis=1)])
            # Two tracks may have taken the same: the older one has it.
            track[taken[::-1]] = filters.number[which[::-1]]
            self.centroid[which] = seen.place[taken]
        filters.keep(matched)
        new = track == 0
        track[new] = filters.add(seen.corners[new, 0])
        self.centroid = np.concatenate([self.centroid[matched], seen.place[new]])
        return track, velocities(filters, track)


class DynamicObstacleDetector:
    """robotics-upo/dynamic_obstacle_detector: one after the other, each track takes the nearest that is free."""

    SIGHTINGS = 2
    GATE = 0.55
    """[m]"""
    LIFE = 1.0
    """[s]"""

    def __init__(self) -> None:
        self.filters = Filters(np.array([0.1, 1.0]), np.array([0.0, 0.2]), 0.2)
        self.missed = np.empty(0)

    def step(self, seen: Seen) -> tuple[Int64, Float64]:
        """See `Rules`."""
        filters, track = self.filters, np.zeros(len(seen.place), np.int64)
        self.missed = self.missed + seen.seconds
        # The published code looks around the place where a track was last, without a prediction.
        away = distances(filters.place, seen.place)
        pairs = []
        for which in range(len(away)):
            if away.shape[1]:
                nearest = int(away[which].argmin())
                if away[which, nearest] < self.GATE:
                    pairs.append((which, nearest))
                    away[:, nearest] = np.inf
        if pairs:
            which, taken = np.array(pairs).T
            self._update(which, seen.place[taken])
            track[taken] = filters.number[which]
        alive = self.missed < self.LIFE
        filters.keep(alive)
        new = track == 0
        track[new] = filters.add(seen.place[new])
        self.missed = np.concatenate([self.missed[alive], np.zeros(np.count_nonzero(new))])
        return track, velocities(filters, track)

    def _update(self, which: Int64, place: Float64) -> None:
        filters = self.filters
        state, covariance = filters.state.copy(), filters.covariance.copy()
        filters.predict(self.missed)
        # Its noise of a step is variance × t².
        filters.covariance[:, 1, 1] += filters.process[1, 1] * (np.square(self.missed) - 1.0)
        filters.correct(which, place)
        others = np.ones(len(state), np.bool_)
        others[which] = False
        filters.state[others], filters.covariance[others] = state[others], covariance[others]
        self.missed[which] = 0.0


class ObstacleDetector:
    """tysik/obstacle_detector: least distance of place and radius, fusion and fission, two sightings, 2 s of life.

    Between two sweeps its filters are corrected a hundred times a second with the measurement of the last sweep.
    """

    SIGHTINGS = 2
    GATE = 0.3
    """[m]"""
    LIFE = 2.0
    """[s]"""
    STEP = 0.01
    """[s]"""
    CIRCLE = 1.0 / np.sqrt(3.0)
    """Radius of the circle around an object, of its width."""

    def __init__(self) -> None:
        self.filters = Filters(np.ones(2), np.array([0.01, 0.1]), 1.0)
        self.measured = np.empty((0, 3))
        """(T, 3) x, y, radius as last seen."""
        self.missed = np.empty(0)
        self.once = np.empty((0, 3))
        """(U, 3) what has been seen once, in the sweep before."""
        self.once_number = np.empty(0, np.int64)

    def step(self, seen: Seen) -> tuple[Int64, Float64]:
        """See `Rules`."""
        self._wait(seen.seconds)
        filters = self.filters
        circles = np.column_stack([seen.place, self.CIRCLE * seen.width])
        tracked = len(filters.number)
        old = np.concatenate([np.column_stack([filters.place, self.measured[:, 2]]), self.once])
        away = np.sqrt(((circles[:, None] - old[None]) ** 2).sum(axis=-1))
        away[away >= self.GATE] = np.inf
        of_new = _argmin(away)
        of_old = _argmin(away.T)
        track = np.zeros(len(circles), np.int64)
        gone = np.zeros(tracked, np.bool_)
        born: list[tuple[int, Float64]] = []

        for new in np.unique(of_old[:tracked][of_old[:tracked] >= 0]).tolist():
            together = np.flatnonzero(of_old[:tracked] == new)
            if len(together) > 1:
                gone[together] = True
                born.append((new, filters.state[together].mean(axis=0)))
                track[new] = -1
        for which in range(tracked):
            parts = np.flatnonzero((of_new == which) & (track == 0))
            if gone[which]:
                continue
            if len(parts) > 1:
                gone[which] = True
                born += [(int(part), filters.state[which]) for part in parts]
                track[parts] = -1
            elif len(parts) == 1:
                filters.correct(np.array([which]), circles[parts, :2])
                self.measured[which], self.missed[which] = circles[parts[0]], 0.0
                track[parts] = filters.number[which]
        once = np.flatnonzero((of_new >= tracked) & (track == 0))
        first = np.flatnonzero((of_new < 0) & (track == 0))

        filters.keep(~gone)
        self.measured, self.missed = self.measured[~gone], self.missed[~gone]
        for new, state in born:
            track[new] = self._found(circles[new], state, 0)
        for new in once.tolist():
            before = self.once[of_new[new] - tracked]
            state = np.array([before[:2], [0.0, 0.0]])
            track[new] = self._found(circles[new], state, int(self.once_number[of_new[new] - tracked]))
        numbers = np.arange(filters.last + 1, filters.last + len(first) + 1)
        filters.last += len(first)
        track[first] = numbers
        self.once, self.once_number = circles[first], numbers
        track[track < 0] = 0
        return track, velocities(filters, track)

    def _wait(self, seconds: float) -> None:
        for _ in range(round(seconds / self.STEP)):
            self.filters.predict(self.STEP)
            self.filters.correct(np.arange(len(self.measured)), self.measured[:, :2])
        self.missed = self.missed + seconds
        alive = self.missed < self.LIFE
        self.filters.keep(alive)
        self.measured, self.missed = self.measured[alive], self.missed[alive]

    def _found(self, circle: Float64, state: Float64, number: int) -> int:
        """A new track with a state to begin with; returns its number."""
        last = self.filters.last
        given = int(self.filters.add(circle[None, :2])[0])
        self.filters.state[-1] = state
        self.filters.correct(np.array([len(self.filters.number) - 1]), circle[None, :2])
        if number:
            self.filters.number[-1], self.filters.last = number, last
        self.measured = np.vstack([self.measured, circle])
        self.missed = np.append(self.missed, 0.0)
        return number or given
