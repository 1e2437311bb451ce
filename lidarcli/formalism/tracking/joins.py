"""Tracklets that belong to one track: legs that go together, and pieces before and after a gap."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lidarcli.formalism.tracking.legs import LEGS
from lidarcli.formalism.tracking.results import DISC, LEFT_VIEW, MIN_WAY, PERSON, SHORTEST_STAND
from lidarcli.formalism.tracking.tracks import STANDING_LEGS_APART, Track, Tracklet
from lidarcli.sweeps.types import Float64, Int64


@dataclass(frozen=True)
class JoinRules:
    """When tracklets are parts of one track."""

    person_width: float = 0.65
    """[m] What is wider at the legs is no person."""
    together_sweeps: int = 3
    """Two legs of one object are measured together in so many sweeps, ..."""
    together_share: float = 0.3
    """... and in this share of the sightings of the one that is visible less often."""
    leg_width: float = 0.16
    """[m] What is wider is no leg of a static object."""
    leg_distance_sd: float = 0.03
    """[m] The distance of two legs of one static object varies by less than this standard deviation."""
    duplicate_margin: float = 0.1
    """[m] A tracklet is one with the one that it was split from while its centre is no further outside."""
    longest_shared: float = 2.0
    """[s] A moving object is measured in two parts for no longer than this, until the later part goes on alone."""
    leg_share: float = 0.9
    """A leg is all of its person where this share of its sightings is within a step of it."""
    pace_sightings: int = 12
    """Sightings that give the velocity of a piece at its end."""
    longest_gap: float = 15.0
    """[s] Pieces further apart in time are two tracks, ..."""
    longest_static_gap: float = 30.0
    """[s] ... and pieces that are both static after this gap."""
    longest_uncovered: float = 0.7
    """[s] A gap in which nothing hid the object for longer parts two tracks."""
    distance: float = 0.35
    """[m] A piece may begin so far from where it is expected without a gap; ..."""
    speed: float = 0.9
    """[m/s] ... this grows with the gap where either piece moves, ..."""
    max_distance: float = 3.0
    """[m] ... up to this."""
    slow_walk: float = 0.2
    """[m/s] Who walks on behind something is no slower than this."""
    size_difference: float = 0.2
    """[m] Pieces whose sizes differ by more are two objects, if also by more than ..."""
    size_share: float = 0.3
    """... this share of the larger size."""


JOIN = JoinRules()


def merge_duplicates(sightings: Any, new: list[Tracklet], tracklets: dict[int, Tracklet]) -> None:
    """Join tracklets that were inside another one all the time."""
    for tracklet in new:
        if tracklet.kind == PERSON and tracklet.track is None:
            # A leg that was followed before its person was founded brings its track.
            legs = (leg for leg in tracklets.values() if leg.same_as == tracklet.number and leg.track is not None)
            legs = (leg for leg in legs if leg.number not in sightings.spans or _goes_with(sightings, leg, tracklet))
            leg = min(legs, key=lambda leg: leg.number, default=None)
            if leg is not None:
                _track_of(leg).add_part(tracklet)
    for tracklet in new:
        if tracklet.track is not None:
            continue
        other = tracklets.get(tracklet.same_as)
        if other is None or other is tracklet:
            continue
        if other.kind == PERSON:
            is_same = _goes_with(sightings, tracklet, other)
        else:
            # A tracklet that is still where the other one is.
            x, y = tracklet.place(still=not tracklet.moved)
            other_x, other_y = other.place(still=not other.moved)
            is_near = math.hypot(x - other_x, y - other_y) < math.hypot(*other.h) + JOIN.duplicate_margin
            is_same = other.moved == tracklet.moved and is_near
        if is_same:
            _track_of(other).add_part(tracklet)


def _goes_with(sightings: Any, tracklet: Tracklet, person: Tracklet) -> bool:
    """Return whether a tracklet is slim enough for a leg, and is within a step of its person in nearly all sightings."""
    if 2.0 * max(tracklet.h) > JOIN.person_width:
        return False
    at, path = sightings.spans[tracklet.number], sightings.spans.get(person.number)
    if path is None:
        return not person.has_ended
    time, then = sightings.time[at], sightings.time[path]
    early, late = np.maximum(then[0] - time, 0.0), np.maximum(time - then[-1], 0.0)
    off = sightings.place[at] - np.interp(time, then, sightings.place[path])
    near = (np.abs(off) <= LEGS.step + JOIN.speed * (early + late)) & (late <= LEGS.path_margin)
    # Of those before the person was founded the last one counts.
    near = near[max(np.count_nonzero(early > 0.0) - 1, 0) :]
    return bool(near.mean() >= JOIN.leg_share)


def _track_of(tracklet: Tracklet) -> Track:
    if tracklet.track is None:
        Track().add_part(tracklet)
    assert tracklet.track is not None
    return tracklet.track


def join_halves(sightings: Any, new: list[Tracklet], tracklets: dict[int, Tracklet]) -> None:
    """Join two moving tracklets that are one object in two parts: the later begins next to the earlier, which ends
    there."""
    for later in new:
        if later.member or not later.moved:
            continue
        for earlier in tracklets.values():
            shared = earlier.last_time - later.first_time
            if earlier.member or not earlier.moved or not earlier.has_ended or not 0.0 <= shared <= JOIN.longest_shared:
                continue
            if earlier.first_time >= later.first_time or earlier.last_time >= later.last_time:
                continue
            track, other = _track_of(earlier), _track_of(later)
            ends = all(part.last_sweep <= earlier.last_sweep for part in track.parts if not part.member)
            if track is other or other.number > 0 or not ends or differ(earlier, later):
                continue
            at, span = (sightings.spans.get(part.number, slice(0, 0)) for part in (earlier, later))
            both = span.start + np.flatnonzero(sightings.time[span] <= earlier.last_time)
            if at.start == at.stop or not len(both):
                continue
            off = sightings.place[both] - np.interp(sightings.time[both], sightings.time[at], sightings.place[at])
            if np.abs(off).max() <= LEGS.step:
                for part in [*other.parts]:
                    track.add_part(part)
                break


@dataclass(slots=True)
class TrackEnd:
    """The end of one tracklet, or the beginning of another: sweep, time [s], place x + iy [m] and velocity [m/s]."""

    tracklet: Tracklet
    sweep: int
    time: float
    place: complex
    velocity: complex = 0.0


def stitch(sightings: Any, new: list[Tracklet], tracklets: dict[int, Tracklet]) -> bool:
    """Join new tracklets to tracks that ended near there, or would be there by now; return whether persons were joined."""
    # Legs begin and end with their persons.
    begins = [_first_end(sightings, tracklet) for tracklet in new if not tracklet.member]
    if not begins:
        return False
    last_sweep = int(sightings.sweep.max(initial=0))
    ends = [
        _last_end(sightings, tracklet)
        for tracklet in tracklets.values()
        if tracklet.last_sweep < last_sweep and not tracklet.member
    ]
    pairs = []
    off = stitch_costs(ends, begins)
    for i, k in np.argwhere(off < 1.0).tolist():
        earlier, later = ends[i], begins[k]
        if not _follows(earlier, later) or differ(earlier.tracklet, later.tracklet):
            continue
        if not _stood(sightings, earlier, later) and _may_be_one(sightings, earlier, later):
            pairs.append((off.item(i, k), later.tracklet.number, earlier.tracklet.number, earlier, later))
    used: set[int] = set()
    persons = False
    for _, number, before, earlier, later in sorted(pairs, key=lambda pair: pair[:3]):
        if number in used or -before in used:
            continue
        used |= {number, -before}
        later_body, earlier_body = later.tracklet, earlier.tracklet
        track, other = _track_of(earlier_body), _track_of(later_body)
        # Another part may have been stitched to either just before.
        if other.number > 0 or not _follows(earlier, later):
            continue
        track.several = track.several or other.several
        for part in [*other.parts]:
            track.add_part(part)
        persons = persons or any(part.kind == PERSON for part in track.parts)
        if earlier_body.moved and not later_body.moved:
            later_body.moved, later_body.onset = 1, later_body.first_sweep
    return persons


def stitch_costs(ends: list[TrackEnd], begins: list[TrackEnd]) -> Float64:
    """Return (E, B) distances of beginnings from expected places, over the greatest allowed; inf after long gaps."""
    times = [np.array([piece.time for piece in pieces]) for pieces in (ends, begins)]
    places = [np.array([piece.place for piece in pieces]) for pieces in (ends, begins)]
    ahead = [np.array([piece.velocity for piece in pieces]) for pieces in (ends, begins)]
    earlier, later = (np.array([piece.tracklet.moved for piece in pieces]) > 0 for pieces in (ends, begins))
    after = times[1] - times[0][:, None]
    gap = np.maximum(after, 0.0)
    # One that is static now may have moved while hidden.
    one = earlier[:, None] | later
    allowed = np.minimum(JOIN.distance + np.where(one, JOIN.speed, 0.0) * gap, JOIN.max_distance)
    apart = places[1] - places[0][:, None]
    going = np.abs(apart - ahead[0][:, None] * gap)
    meeting = np.abs(apart - (ahead[0][:, None] + ahead[1]) * (0.5 * gap))
    # A tracklet that turned back or stopped is where it was last.
    staying = np.abs(apart) + 0.1
    off = np.minimum(np.minimum(going, meeting), staying) / allowed
    in_time = (after > 0.0) & (gap <= np.where(one, JOIN.longest_gap, JOIN.longest_static_gap))
    return np.where(in_time, off, math.inf)


def _follows(earlier: TrackEnd, later: TrackEnd) -> bool:
    """Return whether the track of one piece ends with it before that of another one begins with that."""
    one, other = earlier.tracklet, later.tracklet
    if one is other or one.track is other.track is not None:
        return False
    # A leg may be that of another person by now.
    before, after = (
        [] if piece.track is None else [part for part in piece.track.parts if part is not piece and not part.member]
        for piece in (one, other)
    )
    return (
        earlier.sweep < later.sweep
        and all(part.last_sweep < later.sweep and part.first_sweep <= earlier.sweep for part in before)
        and all(part.first_sweep >= later.sweep for part in after)
    )


def _may_be_one(sightings: Any, earlier: TrackEnd, later: TrackEnd) -> bool:
    """Return whether one object can be both pieces: it was hidden in between, and has not left the view."""
    pieces, gap = (earlier.tracklet, later.tracklet), later.time - earlier.time
    if not sightings.is_placed:
        return True
    sensor = int(sightings.column("sensor", sightings.spans[pieces[1].number].start))
    width = 2.0 * max(*pieces[0].h, *pieces[1].h)
    free, outside, left = sightings.keyframes.uncovered(sensor, earlier.time, earlier.place, later.time, later.place, width)
    stood = [piece.last_time - piece.first_time for piece in pieces if not piece.moved]
    if len(stood) == 2:
        # What was static for a while is known by its place.
        return bool(free <= JOIN.longest_uncovered or max(stood) >= SHORTEST_STAND)
    if all(piece.kind != PERSON for piece in pieces):
        return bool(free + outside <= JOIN.longest_uncovered)
    # The next person looks the same.
    if (pieces[0].moved and pieces[0].end == LEFT_VIEW) or any(gap > max(seen, SHORTEST_STAND) for seen in stood):
        return False
    # Who walks on behind something has the time that this takes.
    goes_on = (earlier.velocity * later.velocity.conjugate()).real >= 0.0
    walk = abs(later.place - earlier.place) / JOIN.slow_walk if goes_on else 0.0
    return bool(free + outside + max(left - walk, 0.0) <= JOIN.longest_uncovered)


def _stood(sightings: Any, earlier: TrackEnd, later: TrackEnd) -> bool:
    """Return whether a later piece stood where it begins while the earlier one was observed elsewhere."""
    if sightings.keyframes is None or abs(later.place - earlier.place) <= 2.0 * max(earlier.tracklet.h) + MIN_WAY:
        return False
    row = sightings.keep[sightings.spans[later.tracklet.number].start]
    # What is static now is who has gone only if its place was observed free.
    stands = earlier.tracklet.moved and not later.tracklet.moved
    return bool(sightings.keyframes.stood(sightings.recorded, int(row), -math.inf, earlier.time, bool(stands)))


def _first_end(sightings: Any, tracklet: Tracklet) -> TrackEnd:
    """Return the first place of a tracklet that is its own, and its velocity there."""
    at = _own(sightings, tracklet)[: JOIN.pace_sightings]
    i = at[0]
    piece = TrackEnd(tracklet, int(sightings.sweep[i]), float(sightings.time[i]), complex(sightings.place[i]))
    if tracklet.moved:
        piece.velocity = _speed(sightings, at)
    return piece


def _last_end(sightings: Any, tracklet: Tracklet) -> TrackEnd:
    """Return the last place of a tracklet that is its own, and its velocity there; one that never moved is still static."""
    piece = TrackEnd(tracklet, tracklet.last_sweep, tracklet.last_time, complex(*tracklet.place(still=not tracklet.moved)))
    if tracklet.final is not None:
        piece.place, piece.velocity = tracklet.final
    elif len(at := _own(sightings, tracklet)[-JOIN.pace_sightings :]):
        piece.sweep, piece.time = int(sightings.sweep[at[-1]]), float(sightings.time[at[-1]])
        piece.place = complex(sightings.place[at[-1]])
        if tracklet.moved:
            piece.velocity = _speed(sightings, at)
    return piece


def _own(sightings: Any, tracklet: Tracklet) -> Int64:
    """Return the sightings of a tracklet that are not those of a person whose leg it is then."""
    span = sightings.spans.get(tracklet.number, slice(0, 0))
    own: Int64 = span.start + np.flatnonzero(sightings.owner[span] == tracklet.number)
    return own


def store_end(sightings: Any, tracklet: Tracklet) -> None:
    """Keep the last place and velocity of a tracklet whose sightings are settled."""
    if tracklet.final is None:
        piece = _last_end(sightings, tracklet)
        tracklet.final = piece.place, piece.velocity


def is_expired(tracklet: Tracklet, until: float) -> bool:
    """Return whether no piece that begins after `until` [s] can be joined to a tracklet that has ended."""
    return until - tracklet.last_time > (JOIN.longest_gap if tracklet.moved else JOIN.longest_static_gap)


def _speed(sightings: Any, at: Int64) -> complex:
    """Return the velocity of a tracklet over some sightings [m/s], by the line through its places."""
    time = sightings.time[at] - sightings.time[at].mean()
    spread = float(time @ time)
    return complex(time @ sightings.place[at]) / spread if spread > 0.0 else 0.0


def differ(one: Tracklet, other: Tracklet) -> bool:
    """Return whether two tracklets that were both observed whole differ too much in size to be one."""
    if one.has_legs or other.has_legs:
        # A person on two legs is not large.
        single = other if one.has_legs else one
        return not single.has_legs and single.size_is_known and single.size > JOIN.person_width
    if not (one.size_is_known and other.size_is_known):
        return False
    return abs(one.size - other.size) > max(JOIN.size_difference, JOIN.size_share * max(one.size, other.size))


def join_legs(sightings: Any, tracklets: dict[int, Tracklet]) -> None:
    """Join slim tracklets that are static at a steady distance: they are the legs of one object."""
    legs = [tracklets[number] for number in sorted(sightings.spans) if _is_leg(tracklets[number])]
    place = np.array([complex(*leg.place(still=True)) for leg in legs])
    apart = np.abs(place - place[:, None])
    some = np.array([leg.track is None for leg in legs], np.bool_)
    near = np.argwhere(np.triu((apart < STANDING_LEGS_APART) & (some | some[:, None]), 1)).tolist()
    for i, k in sorted(near, key=lambda pair: (apart.item(*pair), *pair)):
        one, other = legs[i], legs[k]
        if one.track is not None and other.track is not None:
            continue
        if one.track is None and other.track is not None:
            one, other = other, one
        # Now the first one has a track, if either has.
        if _are_seen_together(sightings, one, other):
            track = _track_of(one)
            track.several = True
            track.add_part(other)


def _is_leg(tracklet: Tracklet) -> bool:
    """Return whether a tracklet may be a leg of a static object."""
    return not (tracklet.moved or tracklet.member) and tracklet.kind == DISC and 2.0 * max(tracklet.h) <= JOIN.leg_width


def _are_seen_together(sightings: Any, one: Tracklet, other: Tracklet) -> bool:
    """Return whether two tracklets are often observed in the same sweeps, at a steady distance."""
    at, among = sightings.spans[one.number], sightings.spans[other.number]
    _, i, j = np.intersect1d(sightings.sweep[at], sightings.sweep[among], assume_unique=True, return_indices=True)
    if len(i) < max(JOIN.together_sweeps, JOIN.together_share * min(at.stop - at.start, among.stop - among.start)):
        return False
    return float(np.abs(sightings.place[at][i] - sightings.place[among][j]).std()) < JOIN.leg_distance_sd
