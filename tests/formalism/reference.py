"""The paper's formulas written down beam by beam, slow and obvious: what profile `paper` is held to.

Nothing here is shared with the package, and nothing is vectorised. docs/formalism.md gives the readings followed here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, fsum, hypot, inf, isfinite, isnan, pi, sin

NO_TURN, EACH_BEARING_ONCE, FIRST_BEARING_TWICE = ("partial view", "full turn", "full turn, first bearing twice")


@dataclass
class Sweep:
    """One sweep as a log tells it: inf is a beam without a return, NaN and -inf are beams that say nothing."""

    ranges: list[float]
    angle_min: float
    angle_increment: float
    closing: str = NO_TURN


@dataclass
class FoundObject:
    """One object O of Def. 5 with its vertices (Def. 6) and faces (Def. 7)."""

    members: list[int]
    """Beams in the log's numbering, counter-clockwise from P_i to P_f."""
    beam_i: int
    beam_f: int
    theta_i: float
    theta_f: float
    r_i: float
    r_f: float
    s_i: float | None
    s_f: float | None
    theta_min: float
    r_min: float
    x: float
    y: float
    width: float
    vertices: list[tuple[float, float, str]]
    faces: list[tuple[float, float]]


@dataclass
class Found:
    """What the formulas say about one sweep."""

    d_th: float
    s: list[float | None]
    """Def. 2, in the log's numbering."""
    breaks: list[int]
    """Def. 3: beams before which f is discontinuous, in the log's numbering."""
    objects: list[FoundObject] = field(default_factory=list)


def paper(sweep: Sweep) -> Found:
    """Definitions 2, 3, 5, 6 and 7, one beam after the other."""
    # Θ: every bearing once, counter-clockwise. The second beam on the first bearing says nothing new.
    bearings = list(range(len(sweep.ranges)))
    if sweep.closing == FIRST_BEARING_TWICE:
        bearings.pop()
    if sweep.angle_increment < 0:
        bearings.reverse()
    count = len(bearings)
    r = [sweep.ranges[beam] for beam in bearings]
    is_turn = sweep.closing != NO_TURN

    def before(n: int) -> int | None:
        if n > 0:
            return n - 1
        return count - 1 if is_turn else None

    def after(n: int) -> int | None:
        if n < count - 1:
            return n + 1
        return 0 if is_turn else None

    # Definition 2.
    s: list[float | None] = []
    for n in range(count):
        previous = before(n)
        if previous is None or not isfinite(r[n]) or not isfinite(r[previous]):
            s.append(None)
        else:
            s.append(r[n] - r[previous])

    # Definition 3.
    known = [abs(value) for value in s if value is not None]
    d_th = fsum(known) / len(known) if known else 0.0

    def discontinuous_before(n: int) -> bool:
        """Whether f breaks between θ_{n-1} and θ_n."""
        value = s[n]
        return value is None or abs(value) > d_th

    breaks = [bearings[n] for n in range(count) if isfinite(r[n]) and discontinuous_before(n)]
    found = Found(d_th, [None] * len(sweep.ranges), breaks)
    for n in range(count):
        found.s[bearings[n]] = s[n]

    # Definition 5: from one discontinuity counter-clockwise to the next.
    for start in range(count):
        if not isfinite(r[start]) or not discontinuous_before(start):
            continue
        run = [start]
        while True:
            following = after(run[-1])
            if following is None or following == start:
                break
            if not isfinite(r[following]) or discontinuous_before(following):
                break
            run.append(following)
        previous, following = before(run[0]), after(run[-1])
        if not _own_edge(r, run[0], previous) or not _own_edge(r, run[-1], following):
            continue
        s_f = None if following is None else s[following]
        found.objects.append(_object(sweep, bearings, r, run, s[start], s_f, d_th))
    return found


def _own_edge(r: list[float], here: int, beside: int | None) -> bool:
    """Whether what lies beside the edge is further away: a greater range, or nothing that returns the beam."""
    if beside is None or isnan(r[beside]) or r[beside] == -inf:
        return False
    return r[beside] > r[here]


def _object(
    sweep: Sweep, bearings: list[int], r: list[float], run: list[int], s_i: float | None, s_f: float | None, d_th: float
) -> FoundObject:
    theta = []
    for n in run:
        angle = sweep.angle_min + bearings[n] * sweep.angle_increment
        # Over the seam bearings go on growing.
        theta.append(angle + 2 * pi if n < run[0] else angle)
    distance = [r[n] for n in run]
    members = [bearings[n] for n in run]
    beam_i, beam_f = members[0], members[-1]
    if sweep.angle_increment < 0:
        beam_i, beam_f = beam_f, beam_i

    # Definition 6.
    vertices = [(theta[0], distance[0], "start")]
    at = [0]
    for k in range(1, len(run) - 1):
        rise_before, rise_after = distance[k] - distance[k - 1], distance[k + 1] - distance[k]
        kind = None
        highest = rise_before > 0 and rise_after <= 0
        lowest = rise_before < 0 and rise_after >= 0
        if highest or lowest:
            kind = "extremum"
        elif abs(rise_after - rise_before) > d_th:
            kind = "corner"
        if kind is not None:
            vertices.append((theta[k], distance[k], kind))
            at.append(k)
    if len(run) > 1:
        vertices.append((theta[-1], distance[-1], "end"))
        at.append(len(run) - 1)

    # Definition 7.
    faces = [(theta[a], theta[b]) for a, b in pairwise(at)]

    xs = [d * cos(t) for d, t in zip(distance, theta, strict=True)]
    ys = [d * sin(t) for d, t in zip(distance, theta, strict=True)]
    nearest = distance.index(min(distance))
    return FoundObject(
        members=members,
        beam_i=beam_i,
        beam_f=beam_f,
        theta_i=theta[0],
        theta_f=theta[-1],
        r_i=distance[0],
        r_f=distance[-1],
        s_i=s_i,
        s_f=s_f,
        theta_min=theta[nearest],
        r_min=distance[nearest],
        x=sum(xs) / len(xs),
        y=sum(ys) / len(ys),
        width=hypot(xs[-1] - xs[0], ys[-1] - ys[0]),
        vertices=vertices,
        faces=faces,
    )
