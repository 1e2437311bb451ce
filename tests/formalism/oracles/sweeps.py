"""Definitions 1 to 3 and 5 of profile `robust` in plain words: points, noise, discontinuities, segments."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from math import cos, inf, nan, pi, sin, sqrt
from statistics import median_low

RANGE, NO_RETURN = "range", "no return"


@dataclass(frozen=True)
class Beam:
    """One beam of a log."""

    number: int
    """In the log."""
    r: float
    """NaN without a range."""
    status: str

    @property
    def has_range(self) -> bool:
        """Whether it is a point."""
        return self.status == RANGE


@dataclass(frozen=True)
class Circle:
    """All bearings of a sweep once, counter-clockwise: a list of beams, closed on a full turn."""

    beams: list[Beam]
    bearings: list[float]
    step: float
    is_turn: bool

    @cached_property
    def points(self) -> list[int]:
        """Places of the beams that have a range."""
        return [n for n, beam in enumerate(self.beams) if beam.has_range]

    @cached_property
    def rank(self) -> dict[int, int]:
        """The how-manieth point is at a place."""
        return {n: k for k, n in enumerate(self.points)}


def lay_out(
    ranges: list[float], statuses: list[str], angle_min: float, increment: float, is_turn: bool, twice: bool
) -> Circle:
    """Every bearing once, by increasing bearing. The second beam on the first bearing is left out."""
    beams = [Beam(n, r, status) for n, (r, status) in enumerate(zip(ranges, statuses, strict=True))]
    if twice:
        beams = beams[:-1]
    if increment < 0:
        beams = beams[::-1]
    return Circle(beams, [angle_min + beam.number * increment for beam in beams], abs(increment), is_turn)


def place(circle: Circle, n: int) -> tuple[float, float]:
    """Where a point is [m]."""
    return circle.beams[n].r * cos(circle.bearings[n]), circle.beams[n].r * sin(circle.bearings[n])


def noise(circle: Circle) -> float:
    """σ: the median of r² |u₋ + u₊ - 2 cos Δθ u| for u = 1/r, over 0.6745 and √6, at least 3 mm."""
    count, seconds = len(circle.beams), []
    for n, beam in enumerate(circle.beams):
        if not circle.is_turn and n in (0, count - 1):
            continue
        before, after = circle.beams[n - 1], circle.beams[(n + 1) % count]
        if beam.has_range and before.has_range and after.has_range:
            u = 1 / beam.r
            seconds.append(beam.r**2 * abs(1 / before.r + 1 / after.r - 2 * cos(circle.step) * u))
    return max(median_low(seconds) / 0.6744897501960817 / sqrt(6), 0.003) if seconds else 0.003


@dataclass(frozen=True)
class Step:
    """From one point to the next one counter-clockwise, over lost beams or none."""

    before: int
    after: int
    lost: int


def steps(circle: Circle) -> list[Step]:
    """One step onto each point; onto the first of a partial view there is none."""
    points = circle.points
    found = [Step(a, b, b - a - 1) for a, b in itertools.pairwise(points)]
    if circle.is_turn and len(points) > 1:
        found.insert(0, Step(points[-1], points[0], points[0] + len(circle.beams) - points[-1] - 1))
    return found


def difference(circle: Circle, step: Step) -> float:
    """Def. 2."""
    return circle.beams[step.after].r - circle.beams[step.before].r


def mean_difference(circle: Circle) -> float:
    """Def. 3's mean over neighbouring beams that both have a range."""
    known = [abs(difference(circle, step)) for step in steps(circle) if step.lost == 0]
    return sum(known) / len(known) if known else 0.0


def threshold(circle: Circle, sigma: float, step: Step) -> float:
    """d_th of a step: max(3.5·√2·σ, 8 cm) + r·Δθ, with r the nearer of the two ranges."""
    nearer = min(circle.beams[step.before].r, circle.beams[step.after].r)
    return max(3.5 * sqrt(2) * sigma, 0.08) + nearer * circle.step


def slope(circle: Circle, at: int, way: int, max_gap: int) -> float:
    """d(1/r) per beam, walking away from a point: the gentlest of those to the next three, level if they disagree.

    Lost beams on the way say nothing: with more than `max_gap` of them, or past the end of the view, a point is too far.
    """
    points, count = circle.points, len(circle.beams)
    slopes = []
    k, beams_away = circle.rank[at], 0
    for lag in (1, 2, 3):
        following = k + way
        if not circle.is_turn and not 0 <= following < len(points):
            break
        following %= len(points)
        # A lone point is a full turn away from itself.
        beams_away += (way * (points[following] - points[k]) - 1) % count + 1
        k = following
        if beams_away - lag <= max_gap:
            slopes.append((1 / circle.beams[points[k]].r - 1 / circle.beams[at].r) / beams_away)
    if slopes and (all(value > 0 for value in slopes) or all(value < 0 for value in slopes)):
        return min(slopes, key=abs)
    return 0.0


def foreseen(circle: Circle, at: int, way: int, beams: int, max_gap: int) -> float:
    """The range that a surface foresees so many beams beyond its last point: 1/r is linear in the bearing."""
    u = 1 / circle.beams[at].r - beams * slope(circle, at, way, max_gap)
    return 1 / u if u > 0 else inf


def is_discontinuous(circle: Circle, sigma: float, step: Step, max_gap: int) -> bool:
    """Def. 3 by one-sided limits: neither side's surface explains the step, give or take d_th."""
    if step.lost > max_gap:
        return True
    s, allowed = difference(circle, step), threshold(circle, sigma, step)
    before, after = circle.beams[step.before].r, circle.beams[step.after].r
    from_left = foreseen(circle, step.before, -1, step.lost + 1, max_gap) - before
    from_right = after - foreseen(circle, step.after, 1, step.lost + 1, max_gap)
    return all(not min(0.0, limit) - allowed <= s <= max(0.0, limit) + allowed for limit in (from_left, from_right))


def breakpoints(circle: Circle, sigma: float, max_gap: int) -> list[int]:
    """The points before which f is discontinuous; the first of a partial view begins something, too."""
    found = [step.after for step in steps(circle) if is_discontinuous(circle, sigma, step, max_gap)]
    points = circle.points
    # A lone point of a turn: all others are lost.
    if points and (not circle.is_turn or len(points) == 1):
        found.insert(0, points[0])
    return found


@dataclass(frozen=True)
class Segment:
    """The points between two breakpoints, and what its edges are."""

    points: list[int]
    edges: tuple[str, str]
    s: tuple[float, float]


def beside(circle: Circle, n: int) -> str:
    """What a beam without a range says of the surface that ends beside it."""
    if circle.is_turn:
        n %= len(circle.beams)
    elif not 0 <= n < len(circle.beams):
        return "view"
    if circle.beams[n].status != NO_RETURN:
        return "unknown"
    return "flickering" if flicker(circle) > 0.05 else "open"


def flicker(circle: Circle) -> float:
    """The share of beams without a return, up to three in a row, within surfaces that go on past them."""
    points, count = circle.points, len(circle.beams)
    gone = 0
    for k, n in enumerate(points):
        if k == 0 and not circle.is_turn:
            continue
        before = points[k - 1]
        lost = (n - before) % count - 1 if circle.is_turn else n - before - 1
        near, far = circle.beams[before].r, circle.beams[n].r
        if not 1 <= lost <= 3 or abs(far - near) > 0.1 + 0.02 * min(near, far):
            continue
        gone += sum(circle.beams[(n - back) % count].status == NO_RETURN for back in range(1, lost + 1))
    return gone / max(gone + len(points), 1)


def segments(circle: Circle, breaks: list[int], max_gap: int) -> list[Segment]:
    """Cut at every breakpoint; what is nearer at a step owns the edge, what is farther is hidden."""
    points = circle.points
    if not points:
        return []
    if not breaks:
        return [Segment(points, ("hidden", "hidden"), (nan, nan))]
    onto = {step.after: step for step in steps(circle)}
    runs = []
    for a, b in zip(breaks, [*breaks[1:], None], strict=True):
        first = circle.rank[a]
        if b is not None:
            runs.append(points[first : circle.rank[b]])
        else:
            runs.append(points[first:] + (points[: circle.rank[breaks[0]]] if circle.is_turn else []))
    found = []
    for number, run in enumerate(runs):
        edges, differences = [], []
        into = onto.get(run[0])
        following = runs[(number + 1) % len(runs)][0]
        out = onto.get(following) if circle.is_turn or number + 1 < len(runs) else None
        for step, way, beam in ((into, -1, run[0]), (out, 1, run[-1])):
            if step is None or step.lost > max_gap:
                edges.append(beside(circle, beam + way))
                differences.append(nan)
            else:
                s = difference(circle, step)
                differences.append(s)
                edges.append("own" if s * way > 0 else "hidden")
        found.append(Segment(run, (edges[0], edges[1]), (differences[0], differences[1])))
    return found


def grows(bearings: list[float]) -> list[float]:
    """Bearings of neighbouring points that grow past the seam."""
    grown = bearings[:1]
    for theta in bearings[1:]:
        grown.append(theta + 2 * pi if theta < grown[-1] else theta)
    return grown
