"""Two more published trackers, in the way of `rules`: SORT, and the one that knows people by their legs."""

from __future__ import annotations

import numpy as np

from benchmarks.tracking.filters import Filters
from benchmarks.tracking.rules import Seen, distances, one_to_one, velocities
from lidarcli.sweeps.types import Bool, Float64, Int64


class Sort:
    """abewley/sort: overlap of upright boxes, one filter step a sweep, three sightings, gone after two misses."""

    SIGHTINGS = 3
    OVERLAP = 0.3
    MISSES = 1

    def __init__(self) -> None:
        # Its velocities are per sweep; so is this filter's time.
        self.filters = Filters(np.array([10.0, 1e4]), np.array([1.0, 0.01]), 1.0)
        self.half = np.empty((0, 2))
        """(T, 2) half of the sides of the box as last seen [m]."""
        self.missed = np.empty(0, np.int64)

    def step(self, seen: Seen) -> tuple[Int64, Float64]:
        """See `Rules`."""
        filters = self.filters
        filters.predict(1.0)
        low, high = seen.corners.min(axis=1), seen.corners.max(axis=1)
        centre, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-3)
        track = np.zeros(len(centre), np.int64)
        overlap = _overlap(filters.place, self.half, centre, half)
        which, taken = one_to_one(1.0 - overlap, 1.0 - self.OVERLAP)
        filters.correct(which, centre[taken])
        self.half[which] = half[taken]
        self.missed += 1
        self.missed[which] = 0
        track[taken] = filters.number[which]
        alive = self.missed <= self.MISSES
        filters.keep(alive)
        new = track == 0
        track[new] = filters.add(centre[new])
        self.half = np.concatenate([self.half[alive], half[new]])
        self.missed = np.concatenate([self.missed[alive], np.zeros(np.count_nonzero(new), np.int64)])
        return track, velocities(filters, track) / seen.seconds


def _overlap(centre: Float64, half: Float64, others: Float64, other_half: Float64) -> Float64:
    """(A, B) intersection over union of upright boxes."""
    low = np.maximum((centre - half)[:, None], (others - other_half)[None])
    high = np.minimum((centre + half)[:, None], (others + other_half)[None])
    shared = np.maximum(high - low, 0.0).prod(axis=-1)
    size, other = 4 * half.prod(axis=1), 4 * other_half.prod(axis=1)
    overlap: Float64 = shared / (size[:, None] + other[None] - shared)
    return overlap


class LegTracker:
    """angusleigh/leg_tracker: the best assignment in all; two slim tracks that walk together become a person.

    A person may take two objects of a sweep, and is followed by their mean. Whether a thing is a leg is told by its width
    in place of the published forest of decision trees, and all places count as free.
    """

    SIGHTINGS = 1
    GATE = 1.645
    """Standard deviations."""
    EXTRA = 0.5**2
    """[m²] Variance that is added for the gate, and for the end of a track."""
    END = 0.9**2
    """[m²]"""
    NOISE = ((7.5, 0.06666), (10.0, 0.05), (15.0, 0.03333))
    """Sweeps per second, and standard deviation of a step's noise: the rate nearest to the log's is taken."""
    LEG = 0.25
    """[m] Nothing wider is a leg."""
    APART = 0.8
    """[m] The legs of a person are no further apart …"""
    TOGETHER = 0.5
    """[m] … and have come so far together …"""
    STEP = 0.01
    """[m] … in steps that are longer than this."""

    def __init__(self) -> None:
        self.filters = Filters(np.array([0.5, 0.5]), np.ones(2), 0.1**2)
        self.person = np.empty(0, np.bool_)
        self.way = np.empty(0)
        """(T,) travelled [m]."""
        self.slim = np.empty(0, np.bool_)
        self.pairs: dict[tuple[int, int], tuple[float, float]] = {}
        """Tracks that may be the legs of one person: the ways that both had come when they met."""

    def step(self, seen: Seen) -> tuple[Int64, Float64]:
        """See `Rules`."""
        filters, track = self.filters, np.zeros(len(seen.place), np.int64)
        rate = 1.0 / seen.seconds
        noise = min(self.NOISE, key=lambda one: abs(one[0] - rate))[1]
        before = filters.place.copy()
        filters.predict(seen.seconds, noise**2)

        # A person has a second row.
        row = np.concatenate([np.arange(len(before)), np.flatnonzero(self.person)])
        deviation = np.sqrt(filters.covariance[row, 0, 0] + self.EXTRA)
        away = distances(filters.place[row], seen.place) / deviation[:, None]
        rows, taken = one_to_one(away, self.GATE)
        owner = row[rows]
        track[taken] = filters.number[owner]
        hits = np.bincount(owner, minlength=len(before))
        total = np.zeros((len(before), 2))
        np.add.at(total, owner, seen.place[taken])
        # With one leg alone the other one is taken to be where the person was predicted.
        alone = self.person & (hits == 1)
        total[alone] += filters.place[alone]
        which = np.flatnonzero(hits)
        filters.correct(which, total[which] / np.where(self.person[which], 2, hits[which])[:, None])
        self.slim[owner] = seen.width[taken] <= self.LEG

        step = np.hypot(*(filters.place - before).T)
        self.way += np.where(step > self.STEP, step, 0.0)
        alive = filters.covariance[:, 0, 0] + self.EXTRA <= self.END
        self._keep(alive)
        new = track == 0
        track[new] = self._add(seen.place[new], seen.width[new] <= self.LEG, False)
        self._join(set(track.tolist()))
        return track, velocities(filters, track)

    def _keep(self, kept: Bool) -> None:
        self.filters.keep(kept)
        self.person, self.way, self.slim = self.person[kept], self.way[kept], self.slim[kept]

    def _add(self, place: Float64, slim: Bool, person: bool) -> Int64:
        count = len(place)
        self.person = np.concatenate([self.person, np.full(count, person)])
        self.way = np.concatenate([self.way, np.zeros(count)])
        self.slim = np.concatenate([self.slim, slim])
        return self.filters.add(place)

    def _join(self, here: set[int]) -> None:
        """Make persons of legs that have come far enough together, and give lone legs to the person beside them."""
        filters = self.filters
        legs = np.flatnonzero(self.slim | self.person)
        off = distances(filters.place[legs], filters.place[legs])
        near: dict[tuple[int, int], tuple[float, float]] = {}
        gone = np.zeros(len(self.way), np.bool_)
        born = []
        for a, b in zip(*np.nonzero(np.triu(off <= self.APART, 1)), strict=True):
            one, two = int(legs[a]), int(legs[b])
            if (self.person[one] and self.person[two]) or gone[one] or gone[two]:
                continue
            key = int(filters.number[one]), int(filters.number[two])
            start = self.pairs.get(key, (float(self.way[one]), float(self.way[two])))
            come = min(self.way[one] - start[0], self.way[two] - start[1])
            if come <= self.TOGETHER or not here.issuperset(key):
                near[key] = start
                continue
            gone[[one, two]] = ~self.person[[one, two]]
            if not (self.person[one] or self.person[two]):
                born.append((filters.place[one] + filters.place[two]) / 2)
        self.pairs = near
        if gone.any():
            self._keep(~gone)
            if born:
                self._add(np.array(born), np.ones(len(born), np.bool_), True)
