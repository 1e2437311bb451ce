"""Definition 5: which segments are objects."""

from __future__ import annotations

from lidarcli.formalism import segmentation
from lidarcli.formalism.segmentation import Segments
from lidarcli.formalism.surfaces import survey as surveys
from lidarcli.formalism.surfaces.features import Features
from lidarcli.formalism.surfaces.fragments import Bodies
from lidarcli.formalism.surfaces.survey import Survey
from lidarcli.formalism.surfaces.verdict import Verdict


def fully_visible(survey: Survey, segments: Segments) -> None:
    """Profile `paper`: segments whose edges are both their own, with points enough and no wider than an object.

    Beside a beam without a return the background is beyond range.
    """
    for j in range(segments.count):
        survey.is_object[j] = not surveys.is_partial(segments, j) and _may_be(survey, segments, j)


def known(survey: Survey, segments: Segments) -> None:
    """The same of the segments of which the background tells (`candidate`), whatever their edges."""
    for j in range(segments.count):
        survey.is_object[j] = survey.candidate[j] and _may_be(survey, segments, j)


def _may_be(survey: Survey, segments: Segments, j: int) -> bool:
    return segments.size[j] >= survey.min_beams and survey.reach[j] <= survey.max_width


def pieces(survey: Survey, segments: Segments) -> None:
    """Profile `robust`: which segments reach too far for objects, and which may be some or fragments of some."""
    for j in range(segments.count):
        wide = not survey.reach[j] <= survey.max_width and not survey.protrusion[j]
        survey.wall[j] = segments.size[j] >= survey.min_beams and wide
        survey.candidate[j] = (
            survey.chord[j] <= survey.max_width
            and not survey.wall[j]
            and not segmentation.surrounds(segments, j)
        )
        survey.loose[j] = survey.candidate[j] and not survey.protrusion[j]


def known_bodies(survey: Survey, segments: Segments, bodies: Bodies) -> None:
    """Which of the segments of which the background tells are objects, with what tore them apart undone."""
    for j in range(segments.count):
        survey.is_object[j] = survey.candidate[j] and _is_whole(survey, bodies, j)


def choose(survey: Survey, segments: Segments, features: Features, verdict: Verdict) -> None:
    """Profile `robust`: which segments are objects or fragments of some, and which are pieces of building."""
    for j in range(segments.count):
        body = features.body[j]
        survey.thing[j] = verdict.thing[body] if body >= 0 else 0.0
        survey.is_object[j] = body >= 0 and survey.thing[j] >= verdict.least
        if body >= 0 and not survey.is_object[j] and segments.size[j] >= survey.min_beams:
            survey.wall[j] = True


def _is_whole(survey: Survey, bodies: Bodies, j: int) -> bool:
    return bodies.size[j] >= survey.min_beams and bodies.reach[j] <= survey.max_width
