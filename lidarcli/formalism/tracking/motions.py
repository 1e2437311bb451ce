"""How fast the things are that move, by what was seen of them before and after (smoothing)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lidarcli.formalism.tracking.smoothing import Smoother
from lidarcli.formalism.tracking.things import Thing, Track

AT_ONCE = 8
"""What shows to move within so many sweeps has come moving."""
ARRAYS = ("centred", "cos", "sin", "half_1", "half_2", "z", "var")


def smooth(seen: Any, things: dict[int, Thing]) -> None:
    """Fill the velocities of everything that moves, and where each begins to be an agent."""
    tracks: dict[int, tuple[Track, list[int]]] = {}
    for number in seen.spans:
        track = things[number].track
        if track is not None and track.number > 0:
            tracks.setdefault(track.number, (track, []))[1].append(number)
    moving = [(track, numbers) for track, numbers in tracks.values() if _moves(track)]
    if not moving:
        return
    spans = [
        sum(seen.spans[number].stop - seen.spans[number].start for number in numbers) for _, numbers in moving
    ]
    smoother = Smoother(max(spans))
    for track, numbers in moving:
        _smooth_track(smoother, seen, things, track, numbers)


def _moves(track: Track) -> bool:
    """A track moves once one of its bodies does: from the first onset on."""
    if not track.moved:
        onsets = [
            part.first_sweep if part.onset - part.first_sweep <= AT_ONCE else part.onset
            for part in track.parts
            if part.moved
        ]
        if onsets:
            track.moved, track.onset = True, min(onsets)
    return track.moved


def _smooth_track(
    smoother: Smoother, seen: Any, things: dict[int, Thing], track: Track, numbers: list[int]
) -> None:
    """The velocities of a track, from the sightings of all of its bodies."""
    several = track.several or any(part.has_legs for part in track.parts)
    begin = 0
    for number in numbers:
        span, thing = seen.spans[number], things[number]
        half = np.array([_half(thing, 0), _half(thing, 1)])
        sighted = {name: seen.column(name, span) for name in ARRAYS}
        begin = smoother.locate(begin, sighted, half, np.array(thing.hh), thing.kind, several)
    if len(numbers) == 1:
        at: Any = seen.spans[numbers[0]]
        order = np.arange(begin)
    else:
        places = np.concatenate([np.arange(seen.spans[n].start, seen.spans[n].stop) for n in numbers])
        order = np.argsort(seen.sweep[places], kind="stable")
        at = places[order]
    sweep = seen.sweep[at]
    onset = int(np.searchsorted(sweep, track.onset))
    keep = int(np.count_nonzero(seen.now[at]))
    if track.state is None:
        track.state = np.full(12, -1.0)
    vx, vy, moving = np.empty(begin), np.empty(begin), np.empty(begin, np.uint8)
    smoother.smooth(order, np.ascontiguousarray(seen.time[at]), track.state, keep, onset, vx, vy, moving)
    # Legs of one sweep are one thing.
    first = np.searchsorted(sweep, sweep)
    seen.vx[at], seen.vy[at], seen.moving[at] = vx[first], vy[first], moving[first]
    agent: NDArray[np.bool_] = np.arange(begin) >= onset
    seen.agent[at] = agent


def _half(thing: Thing, axis: int) -> float:
    """Half of the extent of a body along an axis, as known in the end [m]."""
    return 0.5 * thing.side[axis] if thing.side_weight[axis] > 0.0 else thing.h[axis]
