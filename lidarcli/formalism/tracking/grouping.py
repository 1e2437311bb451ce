"""Bodies that belong to one track: legs that go together, and pieces before and after a gap."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lidarcli.formalism.tracking import settling
from lidarcli.formalism.tracking.results import DISC, PERSON
from lidarcli.formalism.tracking.tracks import Track, Tracklet
from lidarcli.sweeps import Float64

PERSON_WIDTH = 0.65
"""[m] Greatest width of a person at the legs."""
PERSON_LEGS = 2
"""Legs of a person. What stands on more is no person who stopped."""
TOGETHER_SWEEPS = 3
"""Least number of sweeps in which two legs are seen together."""
TOGETHER_SHARE = 0.3
"""Least share of the sightings of the leg that is seen less in which both are seen."""
LEGS_STEADY_SD = 0.03
"""[m] Greatest standard deviation of the distance between two legs of a thing that stands."""
STANDING_LEG_WIDTH = 0.16
"""[m] Greatest width of the body of such a leg."""
STANDING_LEGS_APART = 0.65
"""[m] Greatest distance between the bodies of two such legs."""
DUPLICATE_MARGIN = 0.1
"""[m] Greatest distance of the centre of a body outside of another one from which it was split."""
PACE_SIGHTINGS = 12
"""Sightings that give the velocity of a piece at its end."""
LONGEST_STITCH_GAP, LONGEST_STANDING_GAP = 15.0, 30.0
"""[s] Longest gap between two pieces of a track, and between two that both stand."""
STITCH_DISTANCE = 0.35
"""[m] Greatest distance of a piece from where it is expected, without a gap."""
STITCH_SPEED = 0.9
"""[m/s] Growth of that distance with the gap."""
MOST_STITCH_DISTANCE = 3.0
"""[m] Greatest distance after any gap."""
STANDING_STITCH_SPEED, MOST_STANDING_STITCH_DISTANCE = 0.6, 2.0
"""[m/s], [m] Growth and greatest distance where one of the pieces stands."""
SIZE_DIFFERENCE = 0.2
"""[m] Greatest difference in size between two pieces, unless `SIZE_SHARE` allows more."""
SIZE_SHARE = 0.3
"""Greatest difference in size, as a share of the larger size."""


def join(sightings: Any, tracklets: dict[int, Tracklet], is_placed: bool) -> None:
    """Join the bodies that are new in a window to the tracks that they belong to.

    Parameters
    ----------
    seen : sightings of the window and the next one (`windows.WindowSightings`)
    bodies : bodies that were seen often enough, by number
    is_placed : True if the place of the sensor is known: then legs beside a person are given to that person
    """
    new = [tracklets[number] for number in sightings.in_window if tracklets[number].track is None]
    _merge_duplicates(sightings, new, tracklets)
    _join_legs(sightings, tracklets)
    if is_placed:
        settling.assign_legs(sightings, tracklets)
    is_longer = _stitch(sightings, [tracklet for tracklet in new if _is_new(sightings, tracklet)], tracklets)
    if is_placed and is_longer:
        # The pieces of a person make a longer path.
        settling.assign_legs(sightings, tracklets)


def _merge_duplicates(sightings: Any, new: list[Tracklet], tracklets: dict[int, Tracklet]) -> None:
    """Join bodies that were inside another one all the time."""
    for tracklet in new:
        if tracklet.kind == PERSON and tracklet.track is None:
            # A leg that was followed before its person was founded brings its track.
            legs = (leg for leg in tracklets.values() if leg.same_as == tracklet.number and leg.track is not None)
            leg = min(legs, key=lambda leg: leg.number, default=None)
            if leg is not None:
                _track_of(leg).add_part(tracklet)
    for tracklet in new:
        if tracklet.track is not None:
            continue
        other = tracklets.get(tracklet.same_as)
        if other is None or other is tracklet:
            continue
        if (
            _goes_with(sightings, tracklet, other)
            if other.kind == PERSON
            else other.moved == tracklet.moved and _is_inside(tracklet, other)
        ):
            _track_of(other).add_part(tracklet)


def _goes_with(sightings: Any, tracklet: Tracklet, person: Tracklet) -> bool:
    """Return whether a body is slim enough for legs, and mostly within a step of where its person was at that time."""
    if 2.0 * max(tracklet.h) > PERSON_WIDTH:
        return False
    at, path = sightings.spans[tracklet.number], sightings.spans.get(person.number)
    if path is None:
        return not person.has_ended
    time, then = sightings.time[at], sightings.time[path]
    early = np.maximum(np.maximum(then[0] - time, time - then[-1]), 0.0)
    off = sightings.place[at] - np.interp(time, then, sightings.place[path])
    return bool(np.median(np.abs(off) - STITCH_SPEED * early) <= settling.STEP)


def _is_inside(tracklet: Tracklet, other: Tracklet) -> bool:
    """Return whether a body is still where another one is."""
    x, y = tracklet.place(still=not tracklet.moved)
    other_x, other_y = other.place(still=not other.moved)
    return math.hypot(x - other_x, y - other_y) < math.hypot(*other.h) + DUPLICATE_MARGIN


def _track_of(tracklet: Tracklet) -> Track:
    if tracklet.track is None:
        Track().add_part(tracklet)
    assert tracklet.track is not None
    return tracklet.track


@dataclass(slots=True)
class TrackEnd:
    """The end of one body, or the beginning of another: sweep, time [s], place x + iy [m] and velocity [m/s]."""

    tracklet: Tracklet
    sweep: int
    time: float
    place: complex
    velocity: complex = 0.0


def _stitch(sightings: Any, new: list[Tracklet], tracklets: dict[int, Tracklet]) -> bool:
    """Join pieces to tracks that have ended where the piece begins, or would be there by now; True if persons were."""
    # Legs come and go with their persons.
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
    off = _stitch_costs(ends, begins)
    for i, k in np.argwhere(off < 1.0).tolist():
        earlier, later = ends[i], begins[k]
        if earlier.tracklet.moved and _stands_on_legs(later.tracklet):
            continue
        if not _differ(earlier.tracklet, later.tracklet) and _is_over(earlier, later):
            pairs.append((off.item(i, k), later.tracklet.number, earlier.tracklet.number))
    used: set[int] = set()
    persons = False
    for _, number, before in sorted(pairs):
        if number in used or -before in used:
            continue
        used |= {number, -before}
        later_body, earlier_body = tracklets[number], tracklets[before]
        track, other = _track_of(earlier_body), _track_of(later_body)
        if track is other or other.number > 0 or _overlap(track, other):
            # A part that was stitched just before may be seen at the same time.
            continue
        track.several = track.several or other.several
        for part in [*other.parts]:
            track.add_part(part)
        persons = persons or any(part.kind == PERSON for part in track.parts)
        if earlier_body.moved and not later_body.moved:
            later_body.moved, later_body.onset = 1, later_body.first_sweep
    return persons


def _overlap(one: Track, other: Track) -> bool:
    """Return whether two tracks are seen at the same time."""
    return any(a.last_sweep >= b.first_sweep and b.last_sweep >= a.first_sweep for a in one.parts for b in other.parts)


def _stitch_costs(ends: list[TrackEnd], begins: list[TrackEnd]) -> Float64:
    """Return (E, B) distances of beginnings from expected places, over the greatest allowed; inf after long gaps."""
    times = [np.array([piece.time for piece in pieces]) for pieces in (ends, begins)]
    places = [np.array([piece.place for piece in pieces]) for pieces in (ends, begins)]
    ahead = [np.array([piece.velocity for piece in pieces]) for pieces in (ends, begins)]
    earlier, later = (np.array([piece.tracklet.moved for piece in pieces]) > 0 for pieces in (ends, begins))
    after = times[1] - times[0][:, None]
    gap = np.maximum(after, 0.0)
    one, both = earlier[:, None] | later, earlier[:, None] & later
    # A body that was never shown to move has hardly gone far in the shadow; one that stands now may have moved while it was
    # hidden, but hardly far either.
    allowed = STITCH_DISTANCE + np.where(both, STITCH_SPEED, np.where(one, STANDING_STITCH_SPEED, 0.0)) * gap
    allowed = np.minimum(allowed, np.where(both, MOST_STITCH_DISTANCE, MOST_STANDING_STITCH_DISTANCE))
    apart = places[1] - places[0][:, None]
    going = np.abs(apart - ahead[0][:, None] * gap)
    meeting = np.abs(apart - (ahead[0][:, None] + ahead[1]) * (0.5 * gap))
    # A body that turned back or stopped is where it was last.
    staying = np.abs(apart) + 0.1
    off = np.minimum(np.minimum(going, meeting), staying) / allowed
    in_time = (after > 0.0) & (gap <= np.where(one, LONGEST_STITCH_GAP, LONGEST_STANDING_GAP))
    return np.where(in_time, off, math.inf)


def _is_new(sightings: Any, tracklet: Tracklet) -> bool:
    """Return whether a body has sightings of its own, and its track no row yet."""
    if tracklet.track is not None and tracklet.track.number > 0:
        return False
    span = sightings.spans[tracklet.number]
    return bool((sightings.owner[span] == tracklet.number).any())


def _is_over(earlier: TrackEnd, later: TrackEnd) -> bool:
    """Return whether the whole track of the earlier piece was seen before the later piece only."""
    track = earlier.tracklet.track
    if track is None:
        return earlier.tracklet is not later.tracklet
    return track is not later.tracklet.track and all(part.last_sweep < later.sweep for part in track.parts)


def _first_end(sightings: Any, tracklet: Tracklet) -> TrackEnd:
    """Return the first place of a body and its velocity there."""
    i = sightings.spans[tracklet.number].start
    piece = TrackEnd(tracklet, int(sightings.sweep[i]), float(sightings.time[i]), complex(sightings.place[i]))
    if tracklet.moved:
        piece.velocity = _speed(sightings, slice(i, min(i + PACE_SIGHTINGS, sightings.spans[tracklet.number].stop)))
    return piece


def _last_end(sightings: Any, tracklet: Tracklet) -> TrackEnd:
    """Return the last place of a body and its velocity there; one that never moved still stands."""
    piece = TrackEnd(tracklet, tracklet.last_sweep, tracklet.last_time, complex(*tracklet.place(still=not tracklet.moved)))
    if tracklet.final is not None:
        piece.place, piece.velocity = tracklet.final
    elif (span := sightings.spans.get(tracklet.number)) is not None:
        piece.place = complex(sightings.place[span.stop - 1])
        if tracklet.moved:
            piece.velocity = _speed(sightings, slice(max(span.start, span.stop - PACE_SIGHTINGS), span.stop))
    return piece


def store_end(sightings: Any, tracklet: Tracklet) -> None:
    """Keep the last place and velocity of a body whose sightings are settled."""
    if tracklet.final is None:
        piece = _last_end(sightings, tracklet)
        tracklet.final = piece.place, piece.velocity


def is_expired(sightings: Any, tracklet: Tracklet) -> bool:
    """Return whether no piece that begins after the window can be joined to a body that has ended."""
    longest = LONGEST_STITCH_GAP if tracklet.moved else LONGEST_STANDING_GAP
    return float(sightings.time[sightings.now].max(initial=-math.inf)) - tracklet.last_time > longest


def _speed(sightings: Any, at: slice) -> complex:
    """Return the velocity of a body over some sightings [m/s], by the line through its places."""
    time = sightings.time[at] - sightings.time[at].mean()
    spread = float(time @ time)
    return complex(time @ sightings.place[at]) / spread if spread > 0.0 else 0.0


def _differ(one: Tracklet, other: Tracklet) -> bool:
    """Return whether two bodies that were both seen whole differ too much in size to be one."""
    if one.has_legs or other.has_legs:
        # A person on two legs is not large.
        single = other if one.has_legs else one
        return not single.has_legs and single.size_is_known and single.size > PERSON_WIDTH
    if not (one.size_is_known and other.size_is_known):
        return False
    return abs(one.size - other.size) > max(SIZE_DIFFERENCE, SIZE_SHARE * max(one.size, other.size))


def _join_legs(sightings: Any, tracklets: dict[int, Tracklet]) -> None:
    """Join slim bodies that stand at a steady distance: they are the legs of one thing.

    Legs that walk belong to persons (`association`).
    """
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
    """Return whether a body may be a leg of a thing that stands."""
    return not (tracklet.moved or tracklet.member) and tracklet.kind == DISC and 2.0 * max(tracklet.h) <= STANDING_LEG_WIDTH


def _stands_on_legs(tracklet: Tracklet) -> bool:
    """Return whether a body is a leg of a thing that stands on more legs than a person has."""
    return _is_leg(tracklet) and tracklet.track is not None and sum(map(_is_leg, tracklet.track.parts)) > PERSON_LEGS


def _are_seen_together(sightings: Any, one: Tracklet, other: Tracklet) -> bool:
    """Return whether two bodies are often seen in the same sweeps, at a steady distance."""
    at, among = sightings.spans[one.number], sightings.spans[other.number]
    _, i, j = np.intersect1d(sightings.sweep[at], sightings.sweep[among], assume_unique=True, return_indices=True)
    if len(i) < max(TOGETHER_SWEEPS, TOGETHER_SHARE * min(at.stop - at.start, among.stop - among.start)):
        return False
    return float(np.abs(sightings.place[at][i] - sightings.place[among][j]).std()) < LEGS_STEADY_SD
