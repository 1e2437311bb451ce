"""§3, Fig. 8: things of several legs that stand close together, such as a chair."""

from __future__ import annotations

import math

from lidarcli.formalism.segmentation import Points, Segments
from lidarcli.formalism.surfaces.survey import Survey

LEG_WIDTH = 0.2
"""[m] Legs are no wider than this; what is stands by itself."""


def group(survey: Survey, points: Points, segments: Segments, gap: float) -> None:
    """Give objects that are narrow as legs and come closer together than `gap` [m] the same label."""
    for a in range(segments.count):
        if not _is_leg(survey, a):
            continue
        for b in range(a + 1, segments.count):
            if _is_leg(survey, b) and _are_close(points, segments, a, b, gap):
                one, other = _root(survey, a), _root(survey, b)
                survey.label[max(one, other)] = min(one, other)
    for j in range(segments.count):
        survey.label[j] = _root(survey, j)


def _is_leg(survey: Survey, j: int) -> bool:
    return survey.is_object[j] != 0 and survey.chord[j] <= LEG_WIDTH


def _root(survey: Survey, j: int) -> int:
    """The least segment that one is linked to, directly or through others."""
    while survey.label[j] != j:
        j = survey.label[j]
    return j


def _are_close(points: Points, segments: Segments, a: int, b: int, gap: float) -> bool:
    """Whether the nearest points of two segments are no further apart than a gap."""
    x, y, begin, end = points.x, points.y, segments.first[b], segments.first[b] + segments.size[b]
    # No point of b is further from its first one than this: most pairs are told apart by that alone.
    radius = 0.0
    for k in range(begin, end):
        dx, dy = x[k] - x[begin], y[k] - y[begin]
        radius = max(radius, math.sqrt(dx * dx + dy * dy))
    for i in range(segments.first[a], segments.first[a] + segments.size[a]):
        dx, dy = x[i] - x[begin], y[i] - y[begin]
        if math.sqrt(dx * dx + dy * dy) > gap + radius + 1e-9:
            continue
        for k in range(begin, end):
            dx, dy = x[k] - x[i], y[k] - y[i]
            if math.sqrt(dx * dx + dy * dy) <= gap:
                return True
    return False
