"""Bodies that are one thing: legs that go together, and pieces of a track before and after a gap."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from lidarcli.formalism.tracking.things import Thing, Track
from lidarcli.formalism.tracking.tracked import DISC, PERSON

PERSON_WIDTH = 0.65
"""[m] Nobody on two legs is wider there."""
TOGETHER = 3
"""Sweeps in which two legs have to be seen, at least …"""
TOGETHER_SHARE = 0.3
"""… and this share of those of the one that is seen less."""
STEADY = 0.03
"""[m] The distance between two legs of a thing that stands varies no more than this."""
STANDING_WIDTH = 0.16
"""[m] Legs of things that stand are no wider …"""
STANDING_APART = 0.65
"""[m] … and not further apart from the next one."""
DOUBLE = 0.1
"""[m] A body whose centre is no further outside of another one was split from that."""
PACE_SIGHTINGS = 12
"""Sightings that tell the speed of a piece at its end."""
MOST_GAP = 15.0
"""[s] A piece of a track goes on after a gap that is no longer."""
NEAR = 0.35
"""[m] It does so this near to where it is expected, and …"""
ASTRAY = 0.9
"""[m/s] … further away by this for every second, …"""
MOST_ASTRAY = 3.0
"""[m] … but not further than this altogether."""
ASTRAY_STILL, MOST_ASTRAY_STILL = 0.6, 2.0
"""The same of what stands when it is seen again."""
SIZE_DIFFERENCE = 0.2
"""[m] Two pieces of one thing do not differ in size by more than this, …"""
SIZE_SHARE = 0.3
"""… and not by more than this share of it."""


def join(seen: Any, things: dict[int, Thing], begin: int, stop: int) -> None:
    """Let the bodies that are new in a window become parts of tracks, where they are.

    Parameters
    ----------
    seen : sightings of the window and the one after
    things : by the number of their body
    begin, stop : sweeps of the topic before the window, and up to its end
    """
    new = [things[number] for number in seen.in_window if things[number].track is None]
    if not new:
        return
    _join_doubles(new, things)
    _join_legs(seen, things)
    _stitch(seen, [thing for thing in new if thing.track is None or thing.track.number == 0], things)


def _join_doubles(new: list[Thing], things: dict[int, Thing]) -> None:
    """A body that was within another one all the time is that one."""
    for thing in new:
        if thing.kind == PERSON and thing.track is None:
            # A leg that was followed before it was known whose it is has brought its track.
            legs = (leg for leg in things.values() if leg.same_as == thing.number and leg.track is not None)
            leg = min(legs, key=lambda leg: leg.number, default=None)
            if leg is not None:
                _track_of(leg).absorb(thing)
    for thing in new:
        if thing.track is not None:
            continue
        other = things.get(thing.same_as)
        if other is None or other is thing:
            continue
        if other.kind == PERSON or (other.moved == thing.moved and _is_inside(thing, other)):
            _track_of(other).absorb(thing)


def _is_inside(thing: Thing, other: Thing) -> bool:
    """Whether a body is still where another one is."""
    x, y = thing.place(still=not thing.moved)
    other_x, other_y = other.place(still=not other.moved)
    return math.hypot(x - other_x, y - other_y) < math.hypot(*other.h) + DOUBLE


def _track_of(thing: Thing) -> Track:
    if thing.track is None:
        Track().absorb(thing)
    assert thing.track is not None
    return thing.track


@dataclass(slots=True)
class _Piece:
    """The end of one body, or the beginning of another."""

    thing: Thing
    sweep: int
    time: float
    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0


def _stitch(seen: Any, new: list[Thing], things: dict[int, Thing]) -> None:
    """Pieces that begin where another one, which is seen no more, would be by now."""
    # Legs come and go with their persons.
    begins = [_beginning(seen, thing) for thing in new if not thing.member]
    if not begins:
        return
    last_sweep = int(seen.sweep.max(initial=0))
    ends = [
        _ending(seen, thing)
        for thing in things.values()
        if thing.last_sweep < last_sweep and not thing.member
    ]
    pairs = []
    for later in begins:
        for earlier in ends:
            gap = later.time - earlier.time
            if (
                not 0.0 < gap <= MOST_GAP
                or _differ(earlier.thing, later.thing)
                or not _is_over(earlier, later)
            ):
                continue
            allowed = _allowed(earlier.thing, later.thing, gap)
            off = _apart(earlier, later, gap)
            if off < allowed:
                pairs.append((off / allowed, later.thing.number, earlier.thing.number))
    taken: set[int] = set()
    for _, number, before in sorted(pairs):
        if number in taken or -before in taken:
            continue
        taken |= {number, -before}
        later_thing, earlier_thing = things[number], things[before]
        track, other = _track_of(earlier_thing), _track_of(later_thing)
        if track is other or other.number > 0 or _overlap(track, other):
            # What was stitched since then may be seen at the same time.
            continue
        track.several = track.several or other.several
        for part in [*other.parts]:
            track.absorb(part)
        if earlier_thing.moved and not later_thing.moved:
            later_thing.moved, later_thing.onset = 1, later_thing.first_sweep


def _overlap(one: Track, other: Track) -> bool:
    """Whether two tracks are seen at the same time."""
    return any(
        a.last_sweep >= b.first_sweep and b.last_sweep >= a.first_sweep
        for a in one.parts
        for b in other.parts
    )


def _allowed(earlier: Thing, later: Thing, gap: float) -> float:
    """How far from where it is expected a piece may begin after a gap [m]."""
    if not earlier.moved:
        # What was never shown to move has hardly gone far in the shadow.
        return min(NEAR + ASTRAY_STILL * gap, MOST_ASTRAY_STILL) if later.moved else NEAR
    if later.moved:
        return min(NEAR + ASTRAY * gap, MOST_ASTRAY)
    # What stands now may have moved while it was hidden, but then it has hardly been far.
    return min(NEAR + ASTRAY_STILL * gap, MOST_ASTRAY_STILL)


def _is_over(earlier: _Piece, later: _Piece) -> bool:
    """Whether all of what the earlier piece belongs to was seen before the later one alone."""
    track = earlier.thing.track
    if track is None:
        return earlier.thing is not later.thing
    return track is not later.thing.track and all(part.last_sweep < later.sweep for part in track.parts)


def _apart(earlier: _Piece, later: _Piece, gap: float) -> float:
    """How far two pieces miss each other [m]: going on as they went, half of the way each, or staying where they were."""
    dx, dy = later.x - earlier.x, later.y - earlier.y
    half = 0.5 * gap
    going = math.hypot(dx - earlier.vx * gap, dy - earlier.vy * gap)
    meeting = math.hypot(dx - (earlier.vx + later.vx) * half, dy - (earlier.vy + later.vy) * half)
    # Who turned back, or stopped, is where it was last.
    staying = math.hypot(dx, dy) + 0.1
    return min(going, meeting, staying)


def _beginning(seen: Any, thing: Thing) -> _Piece:
    """Where a body was first, and how fast."""
    i = seen.spans[thing.number].start
    piece = _Piece(thing, int(seen.sweep[i]), float(seen.time[i]), float(seen.x[i]), float(seen.y[i]))
    if thing.moved:
        piece.vx, piece.vy = _speed(seen, slice(i, min(i + PACE_SIGHTINGS, seen.spans[thing.number].stop)))
    return piece


def _ending(seen: Any, thing: Thing) -> _Piece:
    """Where a body was last, and how fast; one that never moved still stands."""
    span = seen.spans.get(thing.number)
    x, y = thing.place(still=not thing.moved)
    piece = _Piece(thing, thing.last_sweep, thing.seen_at, x, y)
    if span is not None:
        piece.x, piece.y = float(seen.x[span.stop - 1]), float(seen.y[span.stop - 1])
        if thing.moved:
            piece.vx, piece.vy = _speed(seen, slice(max(span.start, span.stop - PACE_SIGHTINGS), span.stop))
    return piece


def _speed(seen: Any, at: slice) -> tuple[float, float]:
    """Velocity of a body over some sightings [m/s], by the line through its places."""
    time = seen.time[at] - seen.time[at].mean()
    spread = float((time * time).sum())
    if spread <= 0.0:
        return 0.0, 0.0
    return float((time * seen.x[at]).sum()) / spread, float((time * seen.y[at]).sum()) / spread


def _differ(one: Thing, other: Thing) -> bool:
    """Whether two bodies that were both seen whole differ in size too much to be one."""
    if one.has_legs or other.has_legs:
        # Somebody on two legs is no box, nor anything large.
        single = other if one.has_legs else one
        return not single.has_legs and single.size_is_known and single.size > PERSON_WIDTH
    if not (one.size_is_known and other.size_is_known):
        return False
    return abs(one.size - other.size) > max(SIZE_DIFFERENCE, SIZE_SHARE * max(one.size, other.size))


def _join_legs(seen: Any, things: dict[int, Thing]) -> None:
    """Slim things that stand and keep their distance are the legs of one; those that are new join those that are known.

    Legs that walk are a matter of `persons`.
    """
    legs = [things[number] for number in sorted(seen.spans) if _is_leg(things[number])]
    pairs = []
    for i, one in enumerate(legs):
        for other in legs[i + 1 :]:
            if one.track is None or other.track is None:
                x, y = one.place(still=True)
                other_x, other_y = other.place(still=True)
                apart = math.hypot(x - other_x, y - other_y)
                if apart < STANDING_APART:
                    pairs.append((apart, one, other))
    for _, one, other in sorted(pairs, key=lambda pair: (pair[0], pair[1].number, pair[2].number)):
        if one.track is not None and other.track is not None:
            continue
        if one.track is None and other.track is not None:
            one, other = other, one
        # Now the first has a track, if either has.
        if _are_seen_together(seen, one, other):
            track = _track_of(one)
            track.several = True
            track.absorb(other)


def _is_leg(thing: Thing) -> bool:
    """Whether a body may be a leg of something that stands."""
    return not (thing.moved or thing.member) and thing.kind == DISC and 2.0 * max(thing.h) <= STANDING_WIDTH


def _are_seen_together(seen: Any, one: Thing, other: Thing) -> bool:
    """Whether two bodies are often seen in the same sweeps, at a steady distance."""
    at, among = seen.spans[one.number], seen.spans[other.number]
    _, i, j = np.intersect1d(seen.sweep[at], seen.sweep[among], assume_unique=True, return_indices=True)
    if len(i) < max(TOGETHER, TOGETHER_SHARE * min(at.stop - at.start, among.stop - among.start)):
        return False
    apart = np.hypot(seen.x[at][i] - seen.x[among][j], seen.y[at][i] - seen.y[among][j])
    return float(apart.std()) < STEADY
