"""Differences between two runs (§3, matching): what is known, moved, new or gone, and what cannot be decided.

What is one object in both runs is found first. An object without a partner is new or gone only where the other run observed
its place to be free.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lidarcli.formalism.mapping.grid import UNKNOWN
from lidarcli.formalism.matching.alignment import REACHES, StaticObjects, moved, refine
from lidarcli.formalism.matching.extents import (
    BESIDE,
    LINKED,
    box_of,
    boxes_of,
    clusters,
    contained,
    each_of,
    rectangles,
    unseen_ends,
    within,
)
from lidarcli.formalism.matching.free_space import HERE, OBSERVED_FREE, Buckets, Nearest, SpaceMap, SpaceMotion
from lidarcli.formalism.matching.pairs import FREE_SHARE, Side, TooManyError, pairs_of, probabilities
from lidarcli.options.choices import CHANGE_KINDS, CHANGE_STATUSES, CHANGE_WHYS, MIN_SCORE
from lidarcli.sweeps.types import Bool, Float64, record

THING, STRUCTURE = range(len(CHANGE_KINDS))
KNOWN, MOVED, NEW, GONE, UNCERTAIN = range(len(CHANGE_STATUSES))
HIDDEN, OUT_OF_VIEW, NO_FREE_SPACE, SHORT, AMBIGUOUS, POSES, DRIFT = range(len(CHANGE_WHYS))
CERTAIN = -1
"""In place of a reason, where there is a status."""
CHANGED = 0.15
"""[m] Changed cells this far around an object belong to it; structure is in place up to this distance from that of the
other run."""
MIN_CHANGE, MIN_CELLS, MAX_CHANGES = 0.3, 4, 10_000
"""Least extent [m] and number of cells of a change of the structure, and most changes: runs with more are hardly of one
place."""
AROUND = 0.5
"""[m] What is this near to a place tells that it was in view."""
MAX_DRIFT, AROUND_DRIFT, STRETCH, LOCAL_POINTS = 1.5, 5.0, 2.0, 120
"""[m] Greatest shift by which a stretch of a run is aligned anew, how far from a place its structure counts, and length of
its way; number of points by which it is aligned."""
SMEARED = 0.05
"""Least share of the sweeps that hit a place that was not free all the time: a path that is off smears what stands."""
MAX_STATIONS = 40
"""Greatest number of places of the sensor from which an object may have been hidden."""


@record
class RunEvidence:
    """Evidence of a run: N static objects, the space, and P places of its sensors."""

    things: StaticObjects
    yaw: Float64
    """(N,) direction of the longer side [rad]."""
    ground: SpaceMap | None
    """None where only objects are known."""
    sensors: Float64
    """(P, 2) in the coordinates of the run [m]."""

    def moved(self, motion: SpaceMotion) -> RunEvidence:
        """Return the run in other coordinates."""
        if motion == HERE:
            return self
        ground = None if self.ground is None else self.ground.moved(motion)
        things = self.things.at(*motion.of(self.things.x, self.things.y))
        sensors = np.column_stack(motion.of(self.sensors[:, 0], self.sensors[:, 1]))
        return RunEvidence(things, self.yaw + motion.angle, ground, sensors)


class FoundChange(NamedTuple):
    """Change of an object or piece of structure; coordinates of the first run, those of the second are in its own."""

    kind: int
    """Index into `CHANGE_KINDS`."""
    status: int
    """Index into `CHANGE_STATUSES`."""
    why: int
    """Index into `CHANGE_WHYS`, `CERTAIN` for none."""
    score: float
    """Probability of the status."""
    area: float
    """[m²]; NaN where unknown."""
    looks: tuple[int, int]
    """Sweeps of both runs that could see the place; -1 where unknown."""
    free: tuple[float, float]
    """Share of it that both runs observed free; NaN where unknown."""
    first: int = -1
    """Index of the object of the first run; -1 for none."""
    second: int = -1
    """Index of the object of the second run; -1 for none."""
    place: tuple[float, ...] = ()
    """x, y, yaw, length and width of a piece of structure [m, rad]; empty for objects."""
    drift: float = math.nan
    """By how much a path would be off if nothing had changed [m]; NaN where that is no reason."""


class Compared:
    """Two runs in the coordinates of the first one."""

    def __init__(
        self,
        first: RunEvidence,
        second: RunEvidence,
        motion: SpaceMotion,
        nearest: tuple[Nearest | None, Nearest | None],
        chance: float = 1.0,
        least: float = MIN_SCORE,
    ) -> None:
        """`motion` leads from the coordinates of the second run to those of the first, and is right by `chance`.

        `nearest` are the nearest points of both runs, each in its own coordinates; `least` is the least score of a status.
        """
        self._runs = first, second
        self._motions = HERE, motion
        self._nearest = nearest
        self._chance, self._least = chance, least
        things = second.things
        self._things = first.things, things.at(*motion.of(things.x, things.y))
        self._yaw = first.yaw, second.yaw + motion.angle
        self._boxes = [boxes_of(self._things[side], self._yaw[side]) for side in (0, 1)]
        self._points = [
            np.empty((0, 2)) if run.ground is None else np.column_stack(lead.of(*run.ground.points.T))
            for run, lead in zip(self._runs, self._motions, strict=True)
        ]
        self._spots = [self._spots_of(side) for side in (0, 1)]
        self._changes: list[FoundChange] = []

    def changes(self) -> list[FoundChange]:
        """Return all changes, objects first; `TooManyError` where there are too many to tell."""
        a, b = self._side(0), self._side(1)
        pairs = pairs_of(a, b)
        chance = probabilities(a, b, pairs)
        some_free = pairs.near & (a.some_free[pairs.first] | b.some_free[pairs.second])
        best = np.argsort(-chance, kind="stable")
        paired: tuple[set[int], set[int]] = set(), set()
        for i, j, near, score in zip(*(each[best].tolist() for each in (*pairs, chance * self._chance)), strict=True):
            if score < self._least:
                break
            if i in paired[0] or j in paired[1]:
                continue
            paired[0].add(i)
            paired[1].add(j)
            self._add(KNOWN if near else MOVED, CERTAIN, score, i, j)
        alone: tuple[dict[int, UnpairedStatus], dict[int, UnpairedStatus]] = {}, {}
        for side, (mine, theirs) in enumerate((pairs[:2], pairs[1::-1])):
            order = np.argsort(mine, kind="stable")
            for k, at in enumerate(each_of(mine[order], order, len(self._things[side]))):
                if k not in paired[side]:
                    taken = [other for other in theirs[at[~pairs.near[at]]].tolist() if other in paired[1 - side]]
                    alone[side][k] = self._alone(side, k, chance[at], pairs.near[at], some_free[at], taken)
        best = best[pairs.near[best]]
        self._add_rest(alone, zip(pairs.first[best].tolist(), pairs.second[best].tolist(), strict=True))
        for side in (0, 1):
            self._structure(side)
        return [self.unless_drift(each) for each in self._changes]

    def _side(self, side: int) -> Side:
        """Return the objects of a run with what is known of their places."""
        run, free = self._runs[side], [spot.free for spot in self._spots[side]]
        more = unseen_ends(run.things, run.yaw, run.ground)
        return Side(self._things[side], self._yaw[side], more, np.array(free, np.float64))

    def _add_rest(
        self, alone: tuple[dict[int, UnpairedStatus], dict[int, UnpairedStatus]], near: Iterable[tuple[int, int]]
    ) -> None:
        """Add what is in no pair yet: what is known, and what else stands in its place and is not certain, is one object.

        `near`: pairs in one place, the most probable first.
        """
        before, after = alone
        for i, j in near:
            if i in before and j in after and {before[i].status, after[j].status} <= {KNOWN, UNCERTAIN}:
                known = [each.score for each in (before[i], after[j]) if each.status == KNOWN]
                if known:
                    self._add(KNOWN, CERTAIN, max(known), i, j)
                    del before[i], after[j]
        for i, each in before.items():
            self._add(*each, i, -1)
        for j, each in after.items():
            self._add(*each, -1, j)

    # Where an object was hit, and what the other run observed there.

    def _spots_of(self, side: int) -> list[Spot]:
        """Return where objects were hit, in the coordinates of the first run, and what the other run observed there."""
        boxes, points = self._boxes[side], self._points[side]
        hit = each_of(*contained(boxes, points, BESIDE), len(boxes))
        return [
            self._seen(1 - side, points[mine] if len(mine) else _filled(box)) for box, mine in zip(boxes, hit, strict=True)
        ]

    def _seen(self, side: int, points: Float64) -> Spot:
        """Return what a run observed of some points."""
        ground, nearest = self._runs[side].ground, self._nearest[side]
        if ground is None or nearest is None:
            return Spot(points, np.nan, 0.0, 0.0, -1, 0)
        x, y = self._motions[side].inverse.of(points[:, 0], points[:, 1])
        passed, looks = ground.passed(x, y), ground.seen(x, y)
        _, away = nearest.of(x, y)
        near = away <= CHANGED
        free = passed >= OBSERVED_FREE
        return Spot(
            points,
            free=float(np.mean(free & ~(away <= 0.5 * CHANGED))),
            passed=float(np.mean(passed > 0)),
            near=float(np.mean(near)),
            looks=int(np.max(looks)),
            sweeps=int(np.median(passed[free])) if free.any() else 0,
        )

    # Objects.

    def _alone(self, side: int, k: int, chance: Float64, near: Bool, other: Bool, taken: list[int]) -> UnpairedStatus:
        """Return the status of an object of one run that is certainly one with none of the other run.

        By its probability of being one object with each of these (M,); `near` are those in its place, `other` those of
        which some of either place was observed free, `taken` those elsewhere that are certainly one with another object.
        """
        spot = self._spots[side][k]
        there, alone = float(chance[near].sum()), max(0.0, 1.0 - float(chance.sum()))
        ambiguous = UnpairedStatus(UNCERTAIN, AMBIGUOUS, max(float(chance.max(initial=0.0)), alone) * self._chance)
        if there >= self._least:
            # It is in its place, whichever of several it is.
            status, score = KNOWN, there
        elif alone < 1.0 - self._least and not there:
            # It was moved, but it is unknown which one it is.
            return ambiguous
        elif spot.is_free and self._seen(side, spot.points).is_free:
            # Its own run observed nothing there most of the time: it flickers, or stayed for a while.
            return UnpairedStatus(UNCERTAIN, SHORT, 0.0)
        elif spot.is_free:
            # It may be one that is found elsewhere, but nothing tells so.
            status, score = (GONE if side == 0 else NEW), (1.0 - there) * spot.certainty
        elif np.isnan(spot.free):
            return UnpairedStatus(UNCERTAIN, NO_FREE_SPACE, 0.0)
        elif near.any() and other[near].all():
            # Another one took its place.
            return ambiguous
        elif spot.near >= FREE_SHARE and not self._is_covered(side, k, taken):
            # The other run takes it for a part of the building, or observed something else of it.
            status, score = KNOWN, spot.near / (spot.near + spot.free)
        elif spot.passed >= FREE_SHARE:
            return UnpairedStatus(UNCERTAIN, SHORT, 0.0)
        else:
            return UnpairedStatus(UNCERTAIN, self._out_of_sight(side, spot), 0.0)
        score *= self._chance
        if score >= self._least:
            return UnpairedStatus(status, CERTAIN, score)
        return UnpairedStatus(UNCERTAIN, SHORT if spot.is_free and not there else AMBIGUOUS, score)

    def _is_covered(self, side: int, k: int, taken: list[int]) -> bool:
        """Return whether an object that has another partner stands in the place of this one in the other run."""
        return bool(within(self._boxes[1 - side][taken, :2], self._boxes[side][k], BESIDE).any())

    def _out_of_sight(self, side: int, spot: Spot) -> int:
        """Return why the other run did not see a place: what hides it was not there, or parts around it were observed."""
        run, old = self._runs[1 - side], self._nearest[side]
        nearest = self._nearest[1 - side]
        assert run.ground is not None
        assert nearest is not None
        x, y = spot.points.mean(axis=0).tolist()
        back, to_old = self._motions[1 - side].inverse, self._motions[side].inverse
        (there_x,), (there_y,) = back.of(np.array([x]), np.array([y]))
        stations = run.sensors[:: max(1, len(run.sensors) // MAX_STATIONS)]
        for begin in stations:
            ahead = np.array([there_x, there_y]) - begin
            length = float(np.hypot(*ahead))
            steps = np.arange(0.1, max(length, 0.2), 0.5 * run.ground.resolution) / max(length, 1e-9)
            ray = begin + steps[:, None] * ahead
            index, away = nearest.of(ray[:, 0], ray[:, 1])
            hit = np.flatnonzero(away <= run.ground.resolution)
            if not len(hit):
                continue
            first = run.ground.points[index[hit[0]]]
            if old is None:
                return HIDDEN
            at = self._motions[1 - side].of(first[:1], first[1:])
            _, far = old.of(*to_old.of(*at))
            if far[0] > CHANGED:
                return HIDDEN
        around = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
        ring_x, ring_y = there_x + AROUND * np.cos(around), there_y + AROUND * np.sin(around)
        known = run.ground.state(ring_x, ring_y) != UNKNOWN
        return HIDDEN if known.mean() >= 0.25 else OUT_OF_VIEW

    def _add(self, status: int, why: int, score: float, i: int, j: int) -> None:
        """Keep an object; sizes are those of the run that has observed it, of both the second one."""
        side, k = (1, j) if j >= 0 else (0, i)
        things = self._things[side]
        area = float(things.length[k] * things.width[k])
        before = self._spots[1][j] if j >= 0 else None
        after = self._spots[0][i] if i >= 0 else None
        # What a run observed of an object of its own is that object.
        looks = (
            self._own_looks(0, i) if before is None else before.looks,
            self._own_looks(1, j) if after is None else after.looks,
        )
        free = math.nan if before is None else before.free, math.nan if after is None else after.free
        self._changes.append(FoundChange(THING, status, why, score, area, looks, free, i, j))

    def _own_looks(self, side: int, k: int) -> int:
        """Return the number of sweeps that could see an object of their own run."""
        ground = self._runs[side].ground
        if ground is None:
            return -1
        points = _filled(box_of(self._things[side], self._yaw[side], k))
        x, y = self._motions[side].inverse.of(points[:, 0], points[:, 1])
        return int(ground.seen(x, y).max())

    # Structure.

    def _structure(self, side: int) -> None:
        """Find clusters of structure of one run where the other observed free space."""
        here, there = self._runs[side].ground, self._runs[1 - side].ground
        nearest = self._nearest[1 - side]
        if here is None or there is None or nearest is None or not len(here.points):
            return
        points = self._points[side]
        x, y = self._motions[1 - side].inverse.of(*points.T)
        _, away = nearest.of(x, y)
        passed = there.passed(x, y)
        changed = (away > CHANGED) & (passed >= OBSERVED_FREE)
        at = np.flatnonzero(changed)
        at = np.delete(at, np.concatenate([contained(boxes, points[at], CHANGED)[1] for boxes in self._boxes]))
        looks = here.seen(*self._motions[side].inverse.of(points[at, 0], points[at, 1]))
        others = there.seen(x[at], y[at])
        linked = max(LINKED, 2.1 * here.resolution)
        found = [each for each in clusters(points[at], linked) if len(each) >= MIN_CELLS]
        if not found:
            return
        boxes = rectangles(points[at[np.concatenate(found)]], np.cumsum([0, *map(len, found[:-1])]))
        large = np.flatnonzero(boxes[:, 3] >= MIN_CHANGE)
        if len(large) > MAX_CHANGES:
            raise TooManyError(f"{len(large):,} places of their structure, more than are told ({MAX_CHANGES:,})")
        for box, cluster in ((boxes[k], found[k]) for k in large.tolist()):
            sweeps = int(np.median(passed[at[cluster]]))
            score = (sweeps + 1) / (sweeps + 2) * self._chance
            certain = score >= self._least
            status = (NEW if side else GONE) if certain else UNCERTAIN
            pair = int(np.max(looks[cluster])), int(np.max(others[cluster]))
            free, area = (0.0, 1.0), len(cluster) * here.resolution**2
            if side:
                pair, free = pair[::-1], free[::-1]
            why = CERTAIN if certain else SHORT
            self._changes.append(FoundChange(STRUCTURE, status, why, score, area, pair, free, place=tuple(box.tolist())))

    # Drift.

    def unless_drift(self, change: FoundChange) -> FoundChange:
        """Return a change, as uncertain where nothing has changed if a path is off around the place."""
        if change.status not in (MOVED, NEW, GONE):
            return change
        hit = [(side, self._spots[side][k].points) for side, k in enumerate((change.first, change.second)) if k >= 0]
        if change.kind == STRUCTURE:
            side = int(change.status == NEW)
            hit = [(side, self._points[side][contained(np.array([change.place]), self._points[side], BESIDE)[1]])]
        drift = max(self._drift(*each) or self._smear(*each) for each in hit)
        return change._replace(status=UNCERTAIN, why=DRIFT, score=0.0, drift=drift) if drift else change

    def _smear(self, side: int, points: Float64) -> float:
        """Return how far from points of a run the other one hit something that more sweeps passed [m]; 0 for nowhere."""
        ground = self._runs[1 - side].ground
        if ground is None:
            return 0.0
        reach = round(CHANGED / ground.resolution)
        around = ground.resolution * np.arange(-reach, reach + 1)
        dx, dy = (each.ravel() for each in np.meshgrid(around, around))
        x, y = self._motions[1 - side].inverse.of(*points.T)
        x, y = (x[:, None] + dx).ravel(), (y[:, None] + dy).ravel()
        looks = ground.seen(x, y)
        is_hit = looks - ground.passed(x, y) >= np.maximum(OBSERVED_FREE, SMEARED * looks)
        away = np.where(is_hit.reshape(len(points), -1), np.hypot(dx, dy), np.inf).min(axis=1)
        off = float(np.median(away))
        return max(off, ground.resolution) if math.isfinite(off) else 0.0

    def _drift(self, side: int, points: Float64) -> float:
        """Return by how much a path would be off around points of a run if they were no change [m]; 0 where it is not.

        Each stretch of either run that hit something close by is aligned anew, on its own.
        """
        middle = points.mean(axis=0)
        for run in (side, 1 - side):
            ground, known = self._runs[run].ground, self._points[run]
            if ground is None or self._nearest[1 - run] is None:
                return 0.0
            near = Buckets(known).near(points, np.full(len(points), BESIDE if run == side else MAX_DRIFT))[1]
            around = np.hypot(*(known - middle).T) <= AROUND_DRIFT + 0.5 * np.hypot(*np.ptp(points, axis=0))
            way, spread = ground.way.T
            for stretch in np.unique(np.floor(way[near] / STRETCH)):
                mine = around & (np.abs(way - (stretch + 0.5) * STRETCH) <= STRETCH + 2.0 * spread)
                local = self._local(run, known[mine])
                local = local if run == side else local.inverse
                there = np.column_stack(local.of(*points.T))
                is_in_place = np.mean(self._worth(side, *there.T) == -1.0) < FREE_SHARE
                smear = 0.0 if is_in_place else self._smear(side, there)
                if is_in_place or smear:
                    return smear + float(np.hypot(*(there.mean(axis=0) - middle)))
        return 0.0

    def _local(self, side: int, points: Float64) -> SpaceMotion:
        """Return the motion by which some points of a run lie best on the other run."""
        points = points[:: max(1, len(points) // LOCAL_POINTS)]
        steps = np.arange(-MAX_DRIFT, MAX_DRIFT + CHANGED, CHANGED)
        shifts = np.array(np.meshgrid(steps, steps)).reshape(2, -1)
        x, y = (values[:, None] + shift for values, shift in zip(points.T, shifts, strict=True))
        best = shifts[:, np.argmax(self._worth(side, x.ravel(), y.ravel()).reshape(x.shape).sum(axis=0))]
        there, lead = self._nearest[1 - side], self._motions[1 - side]
        assert there is not None
        tried, near = [HERE], [reach for reach in REACHES if reach <= 2.0 * CHANGED]
        for shift in ((0.0, 0.0), best):
            own = np.column_stack(lead.inverse.of(*(points + shift).T))
            x, y = lead.of(*refine(there, own, HERE, near).of(*own.T))
            tried.append(moved(points[:, 0], points[:, 1], x, y))
        return max(tried, key=lambda each: float(self._worth(side, *each.of(*points.T)).sum()))

    def _worth(self, side: int, x: Float64, y: Float64) -> Float64:
        """Return (K,) how well structure of a run at places would lie on the other: 1 exactly, -½ unknown, -1 free."""
        ground, nearest = self._runs[1 - side].ground, self._nearest[1 - side]
        assert ground is not None
        assert nearest is not None
        x, y = self._motions[1 - side].inverse.of(x, y)
        _, away = nearest.of(x, y)
        return np.where(away <= CHANGED, 1.0 - away / CHANGED, np.where(ground.passed(x, y) >= OBSERVED_FREE, -1.0, -0.5))


class UnpairedStatus(NamedTuple):
    """Status of an object that is in no pair."""

    status: int
    why: int
    score: float


@dataclass(frozen=True, slots=True)
class Spot:
    """Place of the hits of an object, and what the other run observed of it."""

    points: Float64
    """(K, 2) in the coordinates of the first run [m]."""
    free: float
    """Share that was observed free by `OBSERVED_FREE` sweeps; NaN where it is unknown."""
    passed: float
    """Share that was observed free by any sweep."""
    near: float
    """Share within `CHANGED` of structure of the other run."""
    looks: int
    """Most sweeps that observed any of it; -1 where unknown."""
    sweeps: int
    """Sweeps that observed free what was free, the median."""

    @property
    def is_free(self) -> bool:
        """True if enough of it was observed free."""
        return self.free >= FREE_SHARE

    @property
    def certainty(self) -> float:
        """Probability that it was free, by the sweeps that say so."""
        return (self.sweeps + 1) / (self.sweeps + 2)


def _filled(box: Float64) -> Float64:
    """Return (K, 2) places all over a box."""
    along = np.linspace(-0.5, 0.5, max(3, int(box[3] / 0.05))) * box[3]
    across = np.linspace(-0.5, 0.5, max(3, int(box[4] / 0.05))) * box[4]
    u, v = (part.ravel() for part in np.meshgrid(along, across))
    cos, sin = math.cos(box[2]), math.sin(box[2])
    return np.column_stack([box[0] + cos * u - sin * v, box[1] + sin * u + cos * v])
