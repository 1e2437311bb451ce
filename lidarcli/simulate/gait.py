"""How a person walks along a route: one leg stands on its foothold while the other swings to its next one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lidarcli.simulate.route import Route, smooth
from lidarcli.sweeps import Float64

_Index = NDArray[np.int64]

STEPS = (0.6, 0.8)
"""Length of a step [m] at a stroll and at a brisk walk, of the speeds …"""
SPEEDS = (0.6, 1.4)
"""… [m/s]; slower and faster walkers keep these steps and change their cadence."""
AHEAD = 0.63
"""How far a leg gets ahead of the body, or stays behind, in steps: just before it lands."""
_BOTH = 0.1
"""Share of a step, at its beginning and at its end, in which both legs stand."""
_STRETCH = 0.1
"""Steps may be longer by this share, so that a run is a whole number of them."""
_TURN = np.radians(60)
"""Most that a foot turns on the spot before the other one follows."""


def step_length(speed: Float64) -> Float64:
    """Length of the steps [m] at a speed [m/s]; the cadence is the speed over it."""
    return np.interp(speed, SPEEDS, STEPS)


def feet(route: Route, gap: float, seconds: Float64) -> Float64:
    """(S, 2, 2) where the left and the right leg stand in the world at each of the (S,) times.

    Each run from stop to stop has a whole number of like steps, begins and ends with both legs beside each other, `gap`
    metres apart. A leg that stands does not move at all.
    """
    state = route.state(seconds)
    phases = route.phases
    walks = (phases.speed[state.phase] != 0) | (phases.acceleration[state.phase] != 0)
    found = np.empty((len(seconds), 2, 2))
    if walks.any():
        found[walks] = _walking(route, gap, phases.run[state.phase[walks]], state.way[walks])
    rows = np.flatnonzero(~walks)
    if len(rows):
        phase, body = state.phase[rows], np.column_stack([state.x[rows], state.y[rows]])
        before, turn = phases.off[phase, 0], np.diff(phases.off[phase], axis=1)[:, 0]
        ahead = route.pieces.at(phases.piece[phase], phases.along[phase])[1] + before
        share = np.clip(state.since[rows] / phases.length[phase], 0.0, 1.0)
        for side, turned in enumerate(_turning(share, turn)):
            found[rows, side] = _beside(body, ahead + turned, gap, side)
    return found


def _walking(route: Route, gap: float, run: _Index, way: Float64) -> Float64:
    """(S, 2, 2) the legs of a body that is `way` metres on its round, in the given runs."""
    phases, pieces = route.phases, route.pieces
    moving = (phases.speed != 0) | (phases.acceleration != 0)
    first, last, begin, step, count = (np.empty(int(run.max()) + 1) for _ in range(5))
    for number in np.unique(run):
        mine = moving & (phases.run == number)
        first[number], last[number] = phases.piece[mine].min(), phases.piece[mine].max()
        begin[number] = pieces.way[int(first[number])]
        length = pieces.way[int(last[number]) + 1] - begin[number]
        reached = phases.speed[mine] + phases.acceleration[mine] * phases.length[mine]
        fastest = np.maximum(phases.speed[mine], reached).max()
        count[number] = max(1.0, np.ceil(length / step_length(fastest) - _STRETCH))
        step[number] = length / count[number]
    done = np.clip((way - begin[run]) / step[run], 0.0, count[run])
    # The body is above the foothold k while the other leg goes from k - 1 to k + 1; the first and the last are half steps.
    foothold = np.floor(done + 0.5)
    low = np.maximum(foothold - 0.5, 0.0)
    high = np.minimum(foothold + 0.5, count[run])
    share = np.where(high > low, (done - low) / np.where(high > low, high - low, 1.0), 1.0)
    swung = smooth(np.clip((share - _BOTH) / (1 - 2 * _BOTH), 0.0, 1.0))

    def at(number: Float64, side: _Index) -> Float64:
        place = begin[run] + number * step[run]
        piece = np.searchsorted(pieces.way, place, side="right") - 1
        piece = np.clip(piece, first[run].astype(np.int64), last[run].astype(np.int64))
        points, heading = pieces.at(piece, place - pieces.way[piece])
        return _beside(points, heading, gap, side)

    stands = foothold.astype(np.int64) % 2
    found = np.empty((len(way), 2, 2))
    row = np.arange(len(way))
    found[row, stands] = at(foothold, stands)
    # Over the ground the swinging leg keeps to its own side of the way. Exactly 1 at its end: it lands where it will stand.
    begun, ended = np.maximum(foothold - 1, 0.0), np.minimum(foothold + 1, count[run])
    found[row, 1 - stands] = at(np.where(swung < 1, begun + swung * (ended - begun), ended), 1 - stands)
    return found


def _turning(share: Float64, turn: Float64) -> tuple[Float64, Float64]:
    """(S,) how far each leg of a body has turned on the spot [rad]: one goes ahead, the other follows."""
    parts = np.maximum(np.ceil(np.abs(turn) / _TURN), 1.0)
    part = np.minimum(np.floor(share * parts), parts - 1)
    rest = 2 * (share * parts - part)
    each = turn / parts
    leading = each * (part + smooth(np.clip(rest, 0.0, 1.0)))
    following = each * (part + smooth(np.clip(rest - 1, 0.0, 1.0)))
    return leading, following


def _beside(points: Float64, heading: Float64, gap: float, side: _Index | int) -> Float64:
    """Half the gap to the left (side 0) or to the right (1) of the points."""
    out = (gap / 2) * (1 - 2 * np.asarray(side))
    return points + np.column_stack([-np.sin(heading) * out, np.cos(heading) * out])
