"""Motion along a route: waypoints, stops, turns and bounded acceleration; and the gait of persons.

The path is made of straight pieces and arcs, the time of phases of constant acceleration, so that position and velocity
are exact at any time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lidarcli.sweeps.types import Float64

Corner = Literal["round", "stop"]
CORNERS: tuple[Corner, ...] = ("round", "stop")
_Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Waypoint:
    """A point of a route."""

    x: float
    y: float
    speed: float
    """Most speed from here to the next point [m/s]."""
    wait: float = 0.0
    corner: Corner = "round"
    """`round`: passed on an arc; `stop`: the body stops and turns on the spot. With a `wait` it stops anyway."""


@dataclass(frozen=True, eq=False, slots=True)
class Pieces:
    """The (G,) straight pieces and arcs of a path."""

    start: Float64
    heading: Float64
    """At the start of each [rad], not wrapped: it goes on from piece to piece."""
    curvature: Float64
    """[1/m], 0 for straight pieces, positive to the left."""
    arc: Float64
    """(G + 1,) length of the path up to each piece [m]."""

    def at(self, piece: _Index, along: Float64) -> tuple[Float64, Float64]:
        """Return (S, 2) points and (S,) headings `along` metres from the starts of the pieces."""
        heading, curvature = self.heading[piece], self.curvature[piece]
        turned = heading + curvature * along
        bent = curvature != 0
        radius = 1 / np.where(bent, curvature, 1.0)
        x = np.where(bent, radius * (np.sin(turned) - np.sin(heading)), along * np.cos(heading))
        y = np.where(bent, radius * (np.cos(heading) - np.cos(turned)), along * np.sin(heading))
        return self.start[piece] + np.column_stack([x, y]), turned


@dataclass(frozen=True, eq=False, slots=True)
class Phases:
    """The (P,) phases of a journey, each of constant acceleration, standing ones of a smooth turn or none."""

    time: Float64
    """(P,) when each begins [s]; the last one has no end."""
    length: Float64
    """(P,) how long each lasts [s]."""
    piece: _Index
    along: Float64
    """Distance from the start of the piece [m], as the phase begins."""
    speed: Float64
    acceleration: Float64
    off: Float64
    """(P, 2) heading before and after the phase, from that of the piece [rad]; 0 where the body moves."""
    run: _Index
    """Number of the run, the path between two stops, that the phase belongs to."""


@dataclass(frozen=True, eq=False, slots=True)
class RouteState:
    """A body on its route at (S,) times."""

    x: Float64
    y: Float64
    heading: Float64
    speed: Float64
    yaw_rate: Float64
    phase: _Index
    since: Float64
    arc: Float64
    """Length of the path so far [m], counted from the start of the round."""

    def velocities(self) -> Float64:
        """Return (S, 3) vx, vy [m/s] and the rate of the heading [rad/s]."""
        cos, sin = np.cos(self.heading), np.sin(self.heading)
        return np.column_stack([self.speed * cos, self.speed * sin, self.yaw_rate])


@dataclass(frozen=True, eq=False, slots=True)
class Route:
    """A planned journey; made by `plan_route`."""

    waypoints: tuple[Waypoint, ...]
    loop: bool
    pieces: Pieces
    phases: Phases
    duration: float
    """Duration of the journey, or of a round of a loop [s]."""
    parked = False

    def state(self, seconds: Float64) -> RouteState:
        """Return position and motion at (S,) times [s]; before 0 the body is at the first point."""
        phases = self.phases
        time = np.maximum(seconds, 0.0)
        if self.loop:
            time = np.mod(time, self.duration)
        phase = np.searchsorted(phases.time, time, side="right") - 1
        since = time - phases.time[phase]
        piece, acceleration = phases.piece[phase], phases.acceleration[phase]
        speed = phases.speed[phase] + acceleration * since
        along = phases.along[phase] + (phases.speed[phase] + acceleration / 2 * since) * since
        points, heading = self.pieces.at(piece, along)
        share = np.clip(since / phases.length[phase], 0.0, 1.0)
        before, turn = phases.off[phase, 0], np.diff(phases.off[phase], axis=1)[:, 0]
        return RouteState(
            x=points[:, 0],
            y=points[:, 1],
            heading=heading + before + turn * smooth(share),
            speed=speed,
            yaw_rate=self.pieces.curvature[piece] * speed + turn * 6 * share * (1 - share) / phases.length[phase],
            phase=phase,
            since=since,
            arc=self.pieces.arc[piece] + along,
        )

    def poses(self, seconds: Float64) -> Float64:
        """Return (S, 3) world x, y, heading at the given times."""
        state = self.state(seconds)
        return np.column_stack([state.x, state.y, state.heading])

    def speeds(self, seconds: Float64) -> Float64:
        """Return (S,) speed ahead at the given times [m/s]."""
        return self.state(seconds).speed


def smooth(share: Float64) -> Float64:
    """Ease a share from 0 to 1 with no speed at either end; 1.5 times the mean speed in the middle."""
    eased: Float64 = share * share * (3 - 2 * share)
    return eased


@dataclass(slots=True)
class _Piece:
    """A piece in the making; `pause` where the body stops after it."""

    start: Float64
    heading: float
    curvature: float
    length: float
    fastest: float
    pause: tuple[float, float] | None = None
    """Seconds of waiting, and the turn on the spot after it [rad]."""


def plan_route(
    waypoints: Sequence[Waypoint],
    *,
    acceleration: float = 2.0,
    turn_rate: float = np.pi / 2,
    corner_radius: float = 0.5,
    loop: bool = False,
) -> Route:
    """Plan the fastest journey through the waypoints within the limits, from rest to rest.

    `acceleration` [m/s²] bounds speeding up, slowing down, and the pull to the side on an arc; `turn_rate` [rad/s] turns on
    the spot. Arcs have `corner_radius` [m], less where a neighbour is near. A `loop` comes back to its first
    point, stops there and begins again. Raises ValueError for fewer than two points, points in one place, and limits
    that are not above 0.
    """
    if len(waypoints) < 2 or not all(limit > 0 for limit in (acceleration, turn_rate, corner_radius)):
        raise ValueError("a route needs two points at least, and limits above 0")
    pieces = _pieces(list(waypoints), corner_radius, acceleration, loop)
    phases, duration = _phases(pieces, waypoints[0].wait, acceleration, turn_rate)
    lengths = [piece.length for piece in pieces]
    geometry = Pieces(
        start=np.array([piece.start for piece in pieces]),
        heading=np.array([piece.heading for piece in pieces]),
        curvature=np.array([piece.curvature for piece in pieces]),
        arc=np.concatenate([[0.0], np.cumsum(lengths)]),
    )
    return Route(tuple(waypoints), loop, geometry, phases, duration)


def _pieces(waypoints: list[Waypoint], radius: float, acceleration: float, loop: bool) -> list[_Piece]:
    """Return the path as straight pieces with arcs between them."""
    if loop:
        waypoints = [*waypoints, waypoints[0]]
    points = np.array([[point.x, point.y] for point in waypoints])
    step = np.diff(points, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    if not (length > 0).all():
        raise ValueError("two points of a route that follow each other are in one place")
    absolute = np.arctan2(step[:, 1], step[:, 0])
    turns = np.mod(np.diff(absolute, append=absolute[0]) + np.pi, 2 * np.pi) - np.pi
    heading = absolute[0] + np.concatenate([[0.0], np.cumsum(turns[:-1])])

    found: list[_Piece] = []
    begin = 0.0
    for number, point in enumerate(waypoints[:-1]):
        after = waypoints[number + 1]
        last = number == len(length) - 1
        turn = float(turns[number]) if loop or not last else 0.0
        # The arc of a sharper corner would be a point.
        standing = last or after.wait > 0 or after.corner == "stop" or abs(turn) > np.radians(150)
        cut = bend = 0.0
        if not standing and abs(turn) > 1e-9:
            # The arcs at both ends share a straight piece.
            room = 0.45 * min(length[number], length[number + 1])
            cut = min(radius * np.tan(abs(turn) / 2), room)
            bend = cut / np.tan(abs(turn) / 2)
        ahead = np.array([np.cos(heading[number]), np.sin(heading[number])])
        straight = _Piece(points[number] + begin * ahead, heading[number], 0.0, length[number] - begin - cut, point.speed)
        found.append(straight)
        if standing:
            straight.pause = (0.0 if last else after.wait, turn)
        elif bend:
            fastest = min(point.speed, after.speed, float(np.sqrt(acceleration * bend)))
            corner = points[number + 1] - cut * ahead
            found.append(_Piece(corner, heading[number], np.sign(turn) / bend, bend * abs(turn), fastest))
        begin = cut
    return found


def _phases(pieces: list[_Piece], first_wait: float, acceleration: float, turn_rate: float) -> tuple[Phases, float]:
    """Return the journey over the pieces, as fast as the limits let it be."""
    # Squared speeds at the ends of the pieces, first what the pieces allow, then what can be reached and left again.
    squared = [0.0] * (len(pieces) + 1)
    for number in range(1, len(pieces)):
        if pieces[number - 1].pause is None:
            squared[number] = min(pieces[number - 1].fastest, pieces[number].fastest) ** 2
    for number, piece in enumerate(pieces):
        squared[number + 1] = min(squared[number + 1], squared[number] + 2 * acceleration * piece.length)
    for number in range(len(pieces) - 1, -1, -1):
        squared[number] = min(squared[number], squared[number + 1] + 2 * acceleration * pieces[number].length)

    rows: list[tuple[float, ...]] = []
    time, run = 0.0, 0

    def add(length: float, piece: int, along: float, speed: float, faster: float, *off: float) -> None:
        nonlocal time
        if length > 0:
            rows.append((time, length, piece, along, speed, faster, off[0], off[1], run))
            time += length

    add(first_wait, 0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for number, piece in enumerate(pieces):
        low, high = squared[number], squared[number + 1]
        top = min(piece.fastest**2, (low + high) / 2 + acceleration * piece.length)
        fast, slow, end = top**0.5, low**0.5, high**0.5
        gained, lost = (top - low) / (2 * acceleration), (top - high) / (2 * acceleration)
        cruised = max(piece.length - gained - lost, 0.0)
        add((fast - slow) / acceleration, number, 0.0, slow, acceleration, 0.0, 0.0)
        add(cruised / fast, number, gained, fast, 0.0, 0.0, 0.0)
        add((fast - end) / acceleration, number, gained + cruised, fast, -acceleration, 0.0, 0.0)
        if piece.pause is None:
            continue
        wait, turn = piece.pause
        run += 1
        following = number + 1
        if following == len(pieces):
            # What comes after the end is the end of the last piece; a loop turns there for its next round.
            add(wait, number, piece.length, 0.0, 0.0, 0.0, 0.0)
            add(1.5 * abs(turn) / turn_rate, number, piece.length, 0.0, 0.0, 0.0, turn)
        else:
            add(wait, following, 0.0, 0.0, 0.0, -turn, -turn)
            add(1.5 * abs(turn) / turn_rate, following, 0.0, 0.0, 0.0, -turn, 0.0)
    duration = time
    add(np.inf, len(pieces) - 1, pieces[-1].length, 0.0, 0.0, 0.0, 0.0)
    table = np.array(rows)
    phases = Phases(
        time=table[:, 0],
        length=table[:, 1],
        piece=table[:, 2].astype(np.int64),
        along=table[:, 3],
        speed=table[:, 4],
        acceleration=table[:, 5],
        off=table[:, 6:8],
        run=table[:, 8].astype(np.int64),
    )
    return phases, duration


STEPS = (0.6, 0.8)
"""Lengths of a step [m] at the speeds `SPEEDS`."""
SPEEDS = (0.6, 1.4)
"""Speeds of a stroll and a brisk walk [m/s]; beyond them only the cadence changes."""
AHEAD = 0.63
"""Distance of a leg ahead of or behind the body, in steps, just before it lands."""


def step_length(speed: Float64) -> Float64:
    """Return the length of steps [m] at a speed [m/s]; the cadence is the speed over it."""
    return np.interp(speed, SPEEDS, STEPS)


def feet(route: Route, gap: float, seconds: Float64) -> Float64:
    """Return (S, 2, 2) positions of the left and right leg in the world at (S,) times.

    Each run from stop to stop has a whole number of like steps, begins and ends with both legs next to each other, `gap`
    metres apart. A leg that bears the body does not move at all.
    """
    state = route.state(seconds)
    phases = route.phases
    walks = (phases.speed[state.phase] != 0) | (phases.acceleration[state.phase] != 0)
    found = np.empty((len(seconds), 2, 2))
    if walks.any():
        found[walks] = _walking(route, gap, phases.run[state.phase[walks]], state.arc[walks])
    rows = np.flatnonzero(~walks)
    if len(rows):
        phase, body = state.phase[rows], np.column_stack([state.x[rows], state.y[rows]])
        before, turn = phases.off[phase, 0], np.diff(phases.off[phase], axis=1)[:, 0]
        ahead = route.pieces.at(phases.piece[phase], phases.along[phase])[1] + before
        share = np.clip(state.since[rows] / phases.length[phase], 0.0, 1.0)
        for side, turned in enumerate(_turning(share, turn)):
            found[rows, side] = _next_to(body, ahead + turned, gap, side)
    return found


def _walking(route: Route, gap: float, run: _Index, arc: Float64) -> Float64:
    """Return (S, 2, 2) the legs of a body that is `arc` metres on its round, in the given runs."""
    phases, pieces = route.phases, route.pieces
    moving = (phases.speed != 0) | (phases.acceleration != 0)
    first, last, begin, step, count = (np.empty(int(run.max()) + 1) for _ in range(5))
    for number in np.unique(run):
        own = moving & (phases.run == number)
        first[number], last[number] = phases.piece[own].min(), phases.piece[own].max()
        begin[number] = pieces.arc[int(first[number])]
        length = pieces.arc[int(last[number]) + 1] - begin[number]
        reached = phases.speed[own] + phases.acceleration[own] * phases.length[own]
        fastest = np.maximum(phases.speed[own], reached).max()
        # Steps may be 10 % longer, so that a run is a whole number of them.
        count[number] = max(1.0, np.ceil(length / step_length(fastest) - 0.1))
        step[number] = length / count[number]
    done = np.clip((arc - begin[run]) / step[run], 0.0, count[run])
    # The body is above the foothold k while the other leg goes from k - 1 to k + 1; the first and the last are half steps.
    foothold = np.floor(done + 0.5)
    low = np.maximum(foothold - 0.5, 0.0)
    high = np.minimum(foothold + 0.5, count[run])
    share = np.where(high > low, (done - low) / np.where(high > low, high - low, 1.0), 1.0)
    # In the first and the last tenth of a step both legs are on the ground.
    swung = smooth(np.clip((share - 0.1) / (1 - 2 * 0.1), 0.0, 1.0))

    def at(number: Float64, side: _Index) -> Float64:
        place = begin[run] + number * step[run]
        piece = np.searchsorted(pieces.arc, place, side="right") - 1
        piece = np.clip(piece, first[run].astype(np.int64), last[run].astype(np.int64))
        points, heading = pieces.at(piece, place - pieces.arc[piece])
        return _next_to(points, heading, gap, side)

    stands = foothold.astype(np.int64) % 2
    found = np.empty((len(arc), 2, 2))
    row = np.arange(len(arc))
    found[row, stands] = at(foothold, stands)
    # Over the ground the swinging leg keeps to its own side of the path. Exactly 1 at its end: it lands where it will rest.
    begun, ended = np.maximum(foothold - 1, 0.0), np.minimum(foothold + 1, count[run])
    found[row, 1 - stands] = at(np.where(swung < 1, begun + swung * (ended - begun), ended), 1 - stands)
    return found


def _turning(share: Float64, turn: Float64) -> tuple[Float64, Float64]:
    """Return (S,) how far each leg of a body has turned on the spot [rad]: one goes ahead, the other follows."""
    # A foot turns by 60 degrees at most before the other one follows.
    parts = np.maximum(np.ceil(np.abs(turn) / np.radians(60)), 1.0)
    part = np.minimum(np.floor(share * parts), parts - 1)
    rest = 2 * (share * parts - part)
    each = turn / parts
    leading = each * (part + smooth(np.clip(rest, 0.0, 1.0)))
    following = each * (part + smooth(np.clip(rest - 1, 0.0, 1.0)))
    return leading, following


def _next_to(points: Float64, heading: Float64, gap: float, side: _Index | int) -> Float64:
    """Return points half the gap to the left (side 0) or to the right (1)."""
    out = (gap / 2) * (1 - 2 * np.asarray(side))
    return points + np.column_stack([-np.sin(heading) * out, np.cos(heading) * out])
