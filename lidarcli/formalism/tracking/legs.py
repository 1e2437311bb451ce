"""Legs of persons: sightings of slim tracks next to a person become those of the person, one by one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.detection import starts
from lidarcli.formalism.tracking.results import PERSON
from lidarcli.formalism.tracking.tracks import Tracklet
from lidarcli.sweeps.types import Bool, Float64, Int64


@dataclass(frozen=True)
class LegRules:
    """When sightings of a slim track are those of a person next to it."""

    width: float = 0.35
    """[m] Wider measurements are not of one leg, as a rule."""
    step: float = 0.7
    """[m] A leg is no further from the path of its person than this."""
    pause: float = 0.6
    """[s] Two legs that are visible in turn are measured no later than this one after the other."""
    run_sweeps: int = 4
    """Sweeps that a leg goes next to a person before they count, and sweeps without it that end them."""
    share: float = 0.5
    """Share of the sweeps with both, and of all sweeps of a static leg, below which a leg is not of the person."""
    max_crowded: float = 0.15
    """Share of sweeps in which both have more than two measurements, above which they are two persons."""
    path_time: float = 0.5
    """[s] The path is the mean of the places so long before and after: longer hides more of the swing of the legs."""
    path_sweeps: int = 6
    """A person of fewer sweeps has no path; so many give the velocity at its ends."""
    path_margin: float = 1.0
    """[s] Sightings so long before and after a path are compared with it."""


LEGS = LegRules()


Places: TypeAlias = NDArray[np.complex128]
"""Places x + iy [m]: sums, means and distances take one operation for both."""


@dataclass(slots=True, eq=False)
class LegTrajectory:
    """Sightings of a slim track, or of a slim tracklet without one, and the places of its S sweeps."""

    owner: int
    """Number of the tracklet that was observed most."""
    at: Int64
    """(N,) sightings, in the order of the log after `compute`."""
    moves: bool
    """True if it was shown to move."""
    is_person: bool
    has_rows: bool
    """True if it had rows in earlier windows."""
    sweep: Int64 = field(init=False)
    count: Int64 = field(init=False)
    """(S,) number of measurements in each sweep."""
    time: Float64 = field(init=False)
    place: Places = field(init=False)
    """(S,) time [s], and mean of the places [m]."""
    box: tuple[complex, complex] = field(init=False)
    """Least and greatest x and y of the places [m]."""
    _path: Places | None = None

    @property
    def path(self) -> Places:
        """(S,) places without the swing of the legs [m]: the means over as many sweeps before as after."""
        if self._path is None:
            here = np.arange(len(self.time))
            first = np.searchsorted(self.time, self.time - LEGS.path_time)
            stop = np.searchsorted(self.time, self.time + LEGS.path_time, side="right")
            half = np.minimum(here - first, stop - 1 - here)
            total = np.append(0.0, np.cumsum(self.place))
            self._path = (total[here + half + 1] - total[here - half]) / (2 * half + 1)
        return self._path


def compute(sightings: Any, legs: list[LegTrajectory]) -> None:
    """Compute the places of some trajectories by their sightings, of which none is without."""
    at, lengths = np.concatenate([leg.at for leg in legs]), np.array([len(leg.at) for leg in legs])
    key = (np.repeat(np.arange(len(legs)), lengths) << 32) + sightings.sweep[at]
    order = np.argsort(key, kind="stable")
    at, key = at[order], key[order]
    first = starts(key)
    sweep, time = sightings.sweep[at[first]], sightings.time[at[first]]
    count = np.diff(first, append=len(at))
    place: Any = np.add.reduceat(sightings.place[at], first) / count
    stops = np.cumsum(lengths)
    begins = np.searchsorted(first, stops - lengths).tolist()
    sides = [most.reduceat(axis, begins).tolist() for most in (np.minimum, np.maximum) for axis in (place.real, place.imag)]
    for leg, begin, end, stop, *box in zip(legs, begins, [*begins[1:], len(first)], stops.tolist(), *sides, strict=True):
        leg.at, leg.sweep, leg.count = at[stop - len(leg.at) : stop], sweep[begin:end], count[begin:end]
        leg.time, leg.place, leg._path = time[begin:end], place[begin:end], None
        leg.box = complex(*box[:2]), complex(*box[2:])


def assign_legs(sightings: Any, tracklets: dict[int, Tracklet]) -> None:
    """Give sightings of legs to their persons, among those of a window and the next one.

    Parameters
    ----------
    sightings : the sightings (`windows.WindowSightings`), of which `owner` changes
    tracklets : confirmed tracklets, by number
    """
    legs = _leg_trajectories(sightings, tracklets)
    if not legs:
        return
    _merge_legs(sightings, legs)
    legs = [leg for leg in legs if len(leg.at)]
    persons = [leg for leg in legs if leg.is_person and len(leg.sweep) >= LEGS.path_sweeps]
    persons.sort(key=lambda leg: (-len(leg.sweep), leg.owner))
    _gather_fragments(sightings, legs, persons)
    _gather_views(sightings, [leg for leg in persons if len(leg.at)])


def _leg_trajectories(sightings: Any, tracklets: dict[int, Tracklet]) -> list[LegTrajectory]:
    """Return the slim tracks, and slim tracklets without one, in the order of their first sweeps.

    Without persons there are none, and tracks with rows are left out where no person comes near.
    """
    order = np.argsort(sightings.owner, kind="stable")
    order = order[np.searchsorted(sightings.owner[order], 1) :]
    owner = sightings.owner[order]
    begins = starts(owner)
    if not len(begins):
        return []
    slim = np.add.reduceat((sightings.width[order] < LEGS.width).astype(np.int64), begins).tolist()
    ends = np.append(begins[1:], len(owner)).tolist()
    place = sightings.place[order]
    sides = [end.reduceat(axis, begins).tolist() for end in (np.minimum, np.maximum) for axis in (place.real, place.imag)]
    groups: dict[int, list[tuple[int, int, int, int, tuple[float, ...]]]] = {}
    for number, begin, end, few, *box in zip(owner[begins].tolist(), begins.tolist(), ends, slim, *sides, strict=True):
        track = tracklets[number].track
        groups.setdefault(number if track is None else -id(track), []).append((number, begin, end, few, tuple(box)))
    legs = []
    for parts in groups.values():
        if 2 * sum(part[3] for part in parts) <= sum(part[2] - part[1] for part in parts):
            continue
        owner_of_most = max(parts, key=lambda part: part[2] - part[1])[0]
        track = tracklets[owner_of_most].track
        members = [tracklets[owner_of_most]] if track is None else track.parts
        leg = LegTrajectory(
            owner=owner_of_most,
            at=np.concatenate([order[part[1] : part[2]] for part in parts]),
            moves=any(part.moved for part in members) or (track is not None and track.moved),
            is_person=any(part.kind == PERSON for part in members),
            has_rows=track is not None and track.number > 0,
        )
        x, y, x_most, y_most = zip(*(part[4] for part in parts), strict=True)
        leg.box = complex(min(x), min(y)), complex(max(x_most), max(y_most))
        legs.append(leg)
    persons = [leg for leg in legs if leg.is_person]
    if not persons:
        return []
    legs = [leg for leg in legs if not leg.has_rows or any(_gap(leg, person) < 2.0 * LEGS.step for person in persons)]
    compute(sightings, legs)
    return sorted(legs, key=lambda leg: (int(leg.sweep[0]), leg.owner))


def _merge_legs(sightings: Any, legs: list[LegTrajectory]) -> None:
    """Give a track that goes next to a person to that person, run by run."""
    first, last = (np.array([leg.sweep[i] for leg in legs]) for i in (0, -1))
    persons = np.array([leg.is_person for leg in legs])
    together = (first <= last[:, None]) & (persons | persons[:, None])
    low, high = (np.array([leg.box[i] for leg in legs]) for i in (0, 1))
    together &= (low.real - LEGS.step < high.real[:, None]) & (low.real[:, None] - LEGS.step < high.real)
    together &= (low.imag - LEGS.step < high.imag[:, None]) & (low.imag[:, None] - LEGS.step < high.imag)
    pairs = []
    for i, k in np.argwhere(np.triu(together, 1)).tolist():
        one, other = legs[i], legs[k]
        pairs.append((min(len(one.at), len(other.at)), one.owner, other.owner, one, other))
    for _, _, _, one, other in sorted(pairs, key=lambda pair: pair[:3]):
        if len(one.at) and len(other.at):
            leads = one.is_person and (len(one.at) >= len(other.at) or not other.is_person)
            person, leg = (one, other) if leads else (other, one)
            _give_runs(sightings, person, leg)


def _give_runs(sightings: Any, person: LegTrajectory, leg: LegTrajectory) -> None:
    """Give the sightings of a leg to a person in the runs of sweeps in which it is next to that person."""
    after = np.minimum(np.searchsorted(person.sweep, leg.sweep), len(person.sweep) - 1)
    before = np.maximum(after - 1, 0)
    pause = np.minimum(np.abs(leg.time - person.time[before]), np.abs(leg.time - person.time[after]))
    both = np.flatnonzero(pause < LEGS.pause)
    near = both[np.abs(leg.place[both] - np.interp(leg.time[both], person.time, person.place)) < LEGS.step]
    # Two who pass each other are near for a while only.
    if len(near) < max(LEGS.share * len(both), 2):
        return
    measurements = leg.count + np.where(person.sweep[after] == leg.sweep, person.count[after], 0)
    given = np.zeros(len(leg.sweep), bool)
    for run in np.split(near, np.flatnonzero(np.diff(near) >= LEGS.run_sweeps) + 1):
        is_whole = len(run) >= LEGS.share * len(leg.sweep)
        is_leg = is_whole or (leg.moves and len(run) >= LEGS.run_sweeps)
        given[run] = is_leg and np.mean(measurements[run] > 2) <= LEGS.max_crowded
    if given.any():
        _give(sightings, person, leg, np.repeat(given, leg.count))


def _give(sightings: Any, person: LegTrajectory, leg: LegTrajectory, given: Bool) -> None:
    """Give some sightings of a leg to a person."""
    sightings.owner[leg.at[given]] = person.owner
    person.at, leg.at = np.sort(np.concatenate([person.at, leg.at[given]])), leg.at[~given]
    leg.sweep = leg.sweep[:0]
    compute(sightings, [person, leg] if len(leg.at) else [person])


def _gather_fragments(sightings: Any, legs: list[LegTrajectory], persons: list[LegTrajectory]) -> None:
    """Give the new tracks that are never further than a step from the path of a person to that person."""
    for leg in sorted(legs, key=lambda leg: (len(leg.sweep), leg.owner)):
        if leg.has_rows:
            continue
        for person in persons:
            if len(person.sweep) <= len(leg.sweep) or not _may_be_beside(leg, person):
                continue
            if _away(leg.time, leg.place, person).max() < LEGS.step:
                _give(sightings, person, leg, np.ones(len(leg.at), bool))
                break


def _gather_views(sightings: Any, persons: list[LegTrajectory]) -> None:
    """Give sightings without a track within a step of a person's path to that person, up to two legs in a sweep."""
    loose = np.flatnonzero((sightings.owner == 0) & (sightings.width < LEGS.width))
    for person in persons if len(loose) else ():
        time = sightings.time[loose]
        near = loose[(time >= person.time[0] - LEGS.path_margin) & (time <= person.time[-1] + LEGS.path_margin)]
        near = near[_away(sightings.time[near], sightings.place[near], person) < LEGS.step]
        if not len(near):
            continue
        legs = dict(zip(person.sweep.tolist(), person.count.tolist(), strict=True))
        for i, sweep in zip(near.tolist(), sightings.sweep[near].tolist(), strict=True):
            legs[sweep] = legs.get(sweep, 0) + 1
            if legs[sweep] <= 2:
                sightings.owner[i] = person.owner
        loose = loose[sightings.owner[loose] == 0]


def _may_be_beside(leg: LegTrajectory, person: LegTrajectory) -> bool:
    """Return whether a trajectory may be within a step of that of a person, by its ends and the rectangles around both."""
    begin, end, first, last = leg.time[0], leg.time[-1], person.time[0], person.time[-1]
    if begin < first or end > last:
        return bool(begin >= first - LEGS.path_margin and end <= last + LEGS.path_margin)
    return _gap(leg, person) < LEGS.step


def _gap(leg: LegTrajectory, person: LegTrajectory) -> float:
    """Return the distance between the rectangles around two trajectories, along x or y [m]; negative where they overlap."""
    over, under = person.box[0] - leg.box[1], leg.box[0] - person.box[1]
    return max(over.real, over.imag, under.real, under.imag)


def _away(time: Float64, place: Places, person: LegTrajectory) -> Float64:
    """Return (N,) the distances [m] of places from the path of a person, which goes on at both ends at its speed there."""
    early, late = np.minimum(time - person.time[0], 0.0), np.maximum(time - person.time[-1], 0.0)
    few = min(LEGS.path_sweeps, len(person.time)) - 1
    path = person.path
    begin = (path[few] - path[0]) / max(person.time[few] - person.time[0], 1e-3)
    end = (path[-1] - path[-1 - few]) / max(person.time[-1] - person.time[-1 - few], 1e-3)
    away: Float64 = np.abs(place - np.interp(time, person.time, path) - early * begin - late * end)
    return away
