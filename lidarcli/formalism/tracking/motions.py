"""How fast the things are that move, by what was seen of them before and after (smoothing)."""

from __future__ import annotations

from typing import Any

import numpy as np

from lidarcli.formalism.tracking.smoothing import Smoother
from lidarcli.formalism.tracking.things import Thing, Track
from lidarcli.formalism.tracking.tracked import BOX
from lidarcli.sweeps import Bool, Float64

UNKNOWN_VAR = 100.0
"""[m²] A side that was not seen tells nothing."""
LEAST_SPEED = 0.1
"""[m/s] What is slower stands …"""
SURE = 2.0
"""… and so is what may as well stand: a speed has to be this many standard deviations."""
PART_VAR = 0.0625
"""[m²] Variance of where one leg is in a body of several: (25 cm)²."""
AT_ONCE = 8
"""What shows to move within so many sweeps has come moving."""
CHANGE_VAR = 0.0025
"""[m²] More variance where a box was still taken for a disc: (5 cm)²."""


def smooth(seen: Any, things: dict[int, Thing], stop: int) -> None:
    """Fill the velocities of everything that moves, and where each begins to be an agent."""
    tracks: dict[int, tuple[Track, list[int]]] = {}
    for number in seen.spans:
        track = things[number].track
        if track is not None and track.number > 0:
            tracks.setdefault(track.number, (track, []))[1].append(number)
    for track, numbers in tracks.values():
        _judge(track)
        if track.moved:
            _smooth_track(seen, things, track, numbers, stop)


def _judge(track: Track) -> None:
    """A track moves once one of its bodies does: from the first onset on."""
    if track.moved:
        return
    onsets = [
        part.first_sweep if part.onset - part.first_sweep <= AT_ONCE else part.onset
        for part in track.parts
        if part.moved
    ]
    if onsets:
        track.moved, track.onset = True, min(onsets)


def _smooth_track(seen: Any, things: dict[int, Thing], track: Track, numbers: list[int], stop: int) -> None:
    parts = [np.arange(seen.spans[number].start, seen.spans[number].stop) for number in numbers]
    at = parts[0] if len(parts) == 1 else np.concatenate(parts)
    several = track.several or any(part.has_legs for part in track.parts)
    places = np.concatenate(
        [_places(seen, things[number], part) for number, part in zip(numbers, parts, strict=True)]
    )
    order = np.argsort(seen.sweep[at], kind="stable")
    at, places = at[order], places[order]
    if several:
        places[:, 2:] += PART_VAR
    count = len(at)
    keep = int(np.count_nonzero(seen.now[at]))
    if track.state is None:
        track.state = np.full((2, 6), -1.0)
    smoother = Smoother(count)
    time = np.ascontiguousarray(seen.time[at])
    velocity, var = np.empty((2, count)), np.empty((2, count))
    for axis in range(2):
        z, noise = places[:, axis].copy(), places[:, 2 + axis].copy()
        smoother.smooth(time, z, noise, velocity[axis], var[axis], track.state[axis], keep)
    speed = np.hypot(velocity[0], velocity[1])
    sd = np.sqrt(0.5 * (var[0] + var[1]))
    agent: Bool = seen.sweep[at] >= track.onset
    seen.agent[at] = agent
    seen.vx[at], seen.vy[at] = np.where(agent, velocity[0], 0.0), np.where(agent, velocity[1], 0.0)
    seen.moving[at] = agent & (speed > LEAST_SPEED) & (speed > SURE * sd)


def _places(seen: Any, thing: Thing, at: Any) -> Float64:
    """(N, 4) where a body was at its sightings, x, y [m] in the world, and the variances of these."""
    z, var = seen.z[at], seen.var[at]
    centred = seen.centred[at] != 0
    cos, sin = seen.cos[at], seen.sin[at]
    # By its final size, which early sightings did not know.
    middle, noise = np.empty((len(at), 2)), np.empty((len(at), 2))
    for axis, half_then in enumerate((seen.half_1[at], seen.half_2[at])):
        half = np.where(centred | (thing.kind != BOX), half_then, _half(thing, axis))
        low, high = z[:, 2 * axis], z[:, 2 * axis + 1]
        low_var, high_var = var[:, 2 * axis], var[:, 2 * axis + 1]
        has_low, has_high = low_var >= 0.0, high_var >= 0.0
        both = has_low & has_high
        half_var = thing.hh[axis]
        middle[:, axis] = np.where(
            both,
            0.5 * (low + high),
            np.where(has_low, low + half, np.where(has_high, high - half, 0.5 * (low + high))),
        )
        noise[:, axis] = np.where(
            both,
            0.25 * (low_var + high_var),
            np.where(has_low, low_var + half_var, np.where(has_high, high_var + half_var, UNKNOWN_VAR)),
        )
        middle[centred, axis] = low[centred]
        noise[centred, axis] = low_var[centred] + (CHANGE_VAR if thing.kind == BOX else 0.0)
    x = cos * middle[:, 0] - sin * middle[:, 1]
    y = sin * middle[:, 0] + cos * middle[:, 1]
    return np.column_stack(
        [
            x,
            y,
            cos * cos * noise[:, 0] + sin * sin * noise[:, 1],
            sin * sin * noise[:, 0] + cos * cos * noise[:, 1],
        ]
    )


def _half(thing: Thing, axis: int) -> float:
    """Half of the extent of a body along an axis, as known in the end [m]."""
    return 0.5 * thing.side[axis] if thing.side_weight[axis] > 0.0 else thing.h[axis]
