"""Definition 5: the segments of a sweep between two breakpoints, and what each of their edges says."""

from __future__ import annotations

from typing import Any

from lidarcli import native
from lidarcli.formalism.sweep import points as sweep
from lidarcli.formalism.sweep.breakpoints import Breakpoints
from lidarcli.formalism.sweep.points import Points, Scans
from lidarcli.sweeps import Status

OWN, HIDDEN, OPEN, UNKNOWN, VIEW, FLICKERING = range(6)
"""An edge of a segment: the segment is the nearer side; the neighbour is, and hides the rest; a beam without a return is
beside it; an invalid or too close one is; the view ends; a beam without a return where such beams prove nothing."""
MOST_FLICKER = 0.05
"""Where more of the beams that should return do not, one that does not is no proof that nothing is there."""
NAN = float("nan")
NO_RETURN = Status.NO_RETURN.value


class Segments:
    """The `count` segments of a sweep by increasing bearing: point `first`, and `size` - 1 that follow it."""

    def __init__(self, most: int) -> None:
        """Room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.first = native.integers(self.owner, most)
        self.size = native.integers(self.owner, most)
        self.start_edge = native.integers(self.owner, most)
        self.end_edge = native.integers(self.owner, most)
        self.s_start = native.doubles(self.owner, most)
        self.s_end = native.doubles(self.owner, most)
        self.count = 0


def cut(segments: Segments, points: Points, breakpoints: Breakpoints, scans: Scans) -> None:
    """Cut the points at every breakpoint; on a full turn a segment may cross the seam, or go all around."""
    first, size, at = segments.first, segments.size, breakpoints.at
    count = segments.count = breakpoints.count
    if count == 0:
        _surround(segments, points)
        return
    for j in range(count):
        _enter(segments, points, breakpoints, scans, j)
        first[j] = at[j]
        if j > 0:
            size[j - 1] = at[j] - at[j - 1]
            _leave(segments, points, breakpoints, scans, j - 1, at[j])
    last = count - 1
    size[last] = points.count - at[last]
    if points.period > 0:
        # The first breakpoint of a full turn also ends the last segment.
        size[last] += at[0]
        _leave(segments, points, breakpoints, scans, last, at[0])
        sweep.repeat(points, at[0])
    else:
        segments.s_end[last] = NAN
        segments.end_edge[last] = _beside(points, scans, points.position[points.count - 1] + 1)


def _surround(segments: Segments, points: Points) -> None:
    """A full turn without any breakpoint is one segment, which hides no edge of its own."""
    if points.count == 0:
        return
    segments.count = 1
    segments.first[0], segments.size[0] = 0, points.count
    segments.s_start[0] = segments.s_end[0] = NAN
    segments.start_edge[0] = segments.end_edge[0] = HIDDEN


def _enter(segments: Segments, points: Points, breakpoints: Breakpoints, scans: Scans, j: int) -> None:
    """What the breakpoint before a segment says of its first edge."""
    at = breakpoints.at[j]
    if points.missing[at] > breakpoints.max_gap:
        segments.s_start[j] = NAN
        segments.start_edge[j] = _beside(points, scans, points.position[at] - 1)
    else:
        segments.s_start[j] = points.s[at]
        segments.start_edge[j] = OWN if points.s[at] < 0 else HIDDEN


def _leave(
    segments: Segments, points: Points, breakpoints: Breakpoints, scans: Scans, j: int, following: int
) -> None:
    """What the breakpoint before the following segment says of the last edge of this one."""
    before = following - 1 if following > 0 else points.count - 1
    if points.missing[following] > breakpoints.max_gap:
        segments.s_end[j] = NAN
        segments.end_edge[j] = _beside(points, scans, points.position[before] + 1)
    else:
        segments.s_end[j] = points.s[following]
        segments.end_edge[j] = OWN if points.s[following] > 0 else HIDDEN


def _beside(points: Points, scans: Scans, position: int) -> int:
    """What the beam at a position beside a segment says."""
    beam = sweep.beam_at(points, position)
    if beam < 0 or beam >= points.beams:
        return VIEW
    if scans.status[points.row * scans.width + beam] != NO_RETURN:
        return UNKNOWN
    return FLICKERING if points.flicker > MOST_FLICKER else OPEN


def copy(source: Segments, target: Segments) -> None:
    """Make all segments of one sweep those of another."""
    for j in range(source.count):
        target.first[j], target.size[j] = source.first[j], source.size[j]
        target.start_edge[j], target.end_edge[j] = source.start_edge[j], source.end_edge[j]
        target.s_start[j], target.s_end[j] = source.s_start[j], source.s_end[j]
    target.count = source.count


def last_point(segments: Segments, j: int) -> int:
    """P_f of a segment."""
    return segments.first[j] + segments.size[j] - 1


def chord(segments: Segments, points: Points, j: int) -> float:
    """Distance of the first and the last point of a segment [m]."""
    return sweep.distance(points, segments.first[j], last_point(segments, j))


def surrounds(segments: Segments, j: int) -> bool:
    """Whether a segment is a full turn without any breakpoint: both edges are hidden, by no step at all."""
    s = segments.s_start[j]
    return segments.start_edge[j] == HIDDEN and segments.end_edge[j] == HIDDEN and s != s


def following(segments: Segments, points: Points, j: int) -> int:
    """The next segment, over the seam on a full turn; itself where there is none."""
    if j + 1 < segments.count:
        return j + 1
    return 0 if points.period > 0 else j


def preceding(segments: Segments, points: Points, j: int) -> int:
    """The segment before, over the seam on a full turn; itself where there is none."""
    if j > 0:
        return j - 1
    return segments.count - 1 if points.period > 0 else j
