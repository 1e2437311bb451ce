"""The objects of a sweep as lists of segments: one segment each, or the parts of a thing in the order of their bearings."""

from __future__ import annotations

from typing import Any

from lidarcli import native
from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces.survey import Survey

INFINITY = float("inf")


class Parts:
    """The `count` segments that make up `objects` objects, ordered by (walls last, theta_i).

    Object k has the parts `segment[i]` with i from `begin[k]` to `begin[k + 1]` - 1.
    """

    def __init__(self, most: int) -> None:
        """Room for sweeps of up to so many beams."""
        self.owner: list[Any] = []
        self.count = 0
        self.objects = 0
        self.segment = native.integers(self.owner, most)
        self.begin = native.integers(self.owner, most + 1)
        # In the order of their labels, and what is known of each then.
        self.sorted = native.integers(self.owner, most)
        self.starts = native.integers(self.owner, most + 1)
        self.rank = native.integers(self.owner, most)
        self.least = native.doubles(self.owner, most)
        # Of each segment that is a part.
        self.theta_i = native.doubles(self.owner, most)
        """Bearing of the first point [rad], growing past the seam within an object."""
        self.theta_f = native.doubles(self.owner, most)
        """Bearing of the last point [rad]."""
        self.past = native.doubles(self.owner, most)
        """How much of these is for being past the seam: a full turn or 0 [rad]."""


def assemble(parts: Parts, survey: Survey, points: Points, segments: Segments, walls: bool) -> None:
    """Order the segments that are objects, and walls where these are wanted; those of one label are one object."""
    _sort(parts, survey, points, segments, walls)
    _divide(parts, survey)
    for k in range(parts.objects):
        _unwrap(parts, points, k)
    _rank(parts, survey)
    count = 0
    for k in range(parts.objects):
        parts.begin[k] = count
        begin, end = parts.starts[parts.rank[k]], parts.starts[parts.rank[k] + 1]
        for i in range(begin, end):
            j, at = parts.sorted[i], count
            while at > parts.begin[k] and parts.theta_i[j] < parts.theta_i[parts.segment[at - 1]]:
                parts.segment[at] = parts.segment[at - 1]
                at -= 1
            parts.segment[at] = j
            count += 1
    parts.begin[parts.objects] = count


def _sort(parts: Parts, survey: Survey, points: Points, segments: Segments, walls: bool) -> None:
    """By kind, label and bearing."""
    parts.count = 0
    _insert(parts, survey, points, segments, True)
    if walls:
        _insert(parts, survey, points, segments, False)


def _insert(parts: Parts, survey: Survey, points: Points, segments: Segments, objects: bool) -> None:
    """Add the objects, or the walls, in their order: by insertion, as they are nearly in order already."""
    count = parts.count
    for j in range(segments.count):
        if survey.is_object[j] != objects or not (objects or survey.wall[j]):
            continue
        if not survey.is_object[j]:
            survey.label[j] = j
        parts.theta_i[j] = segmentation.bearing(points, segments.first[j])
        parts.theta_f[j] = segmentation.bearing(points, segmentation.last_point(segments, j))
        k = count
        while k > 0 and _comes_before(parts, survey, j, parts.sorted[k - 1]):
            parts.sorted[k] = parts.sorted[k - 1]
            k -= 1
        parts.sorted[k] = j
        count += 1
    parts.count = count


def _comes_before(parts: Parts, survey: Survey, a: int, b: int) -> bool:
    if survey.is_object[a] != survey.is_object[b]:
        return survey.is_object[a] != 0
    if survey.label[a] != survey.label[b]:
        return survey.label[a] < survey.label[b]
    return parts.theta_i[a] < parts.theta_i[b]


def _divide(parts: Parts, survey: Survey) -> None:
    """Where the parts of each object begin among the sorted ones."""
    parts.objects = 0
    for i in range(parts.count):
        a, b = parts.sorted[i], parts.sorted[i - 1] if i > 0 else -1
        if i == 0 or survey.is_object[a] != survey.is_object[b] or survey.label[a] != survey.label[b]:
            parts.starts[parts.objects] = i
            parts.objects += 1
    parts.starts[parts.objects] = parts.count


def _unwrap(parts: Parts, points: Points, k: int) -> None:
    """Let the bearings of an object grow past the seam: those before its widest gap do, where that is not the seam."""
    begin, end = parts.starts[k], parts.starts[k + 1]
    first, last = parts.sorted[begin], parts.sorted[end - 1]
    most = begin
    if end - begin > 1 and points.period > 0:
        widest = parts.theta_i[first] + segmentation.TURN - parts.theta_f[last]
        for i in range(begin + 1, end):
            gap = parts.theta_i[parts.sorted[i]] - parts.theta_f[parts.sorted[i - 1]]
            if gap > widest:
                widest, most = gap, i
    parts.least[k] = INFINITY
    for i in range(begin, end):
        j = parts.sorted[i]
        parts.past[j] = segmentation.TURN if i < most else 0.0
        parts.theta_i[j] += parts.past[j]
        parts.theta_f[j] += parts.past[j]
        parts.least[k] = min(parts.least[k], parts.theta_i[j])


def _rank(parts: Parts, survey: Survey) -> None:
    """The order of the objects: by kind and least bearing."""
    for k in range(parts.objects):
        at = k
        while at > 0 and _is_earlier(parts, survey, k, parts.rank[at - 1]):
            parts.rank[at] = parts.rank[at - 1]
            at -= 1
        parts.rank[at] = k


def _is_earlier(parts: Parts, survey: Survey, a: int, b: int) -> bool:
    """Whether one object comes before another."""
    one, other = parts.sorted[parts.starts[a]], parts.sorted[parts.starts[b]]
    if survey.is_object[one] != survey.is_object[other]:
        return survey.is_object[one] != 0
    return parts.least[a] < parts.least[b]
