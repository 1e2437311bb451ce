"""Things and building: what single features say of scenes that are known, and why a verdict was what it was."""

from __future__ import annotations

import numpy as np

from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.formalism.detect import KINDS, START, contributions, reasons
from tests.formalism.batches import batch_of
from tests.formalism.test_robust_scenes import turn

ALL = Parameters(min_thing=0.0)
Segment = tuple[float, float, float, float]


def seen(segments: list[Segment], beams: int = 720) -> Detection:
    """All bodies of a drawn scene, with their features."""
    return detect(batch_of([turn(segments, beams=beams)]), ALL, explain=True)


def wall(y: float, *spans: tuple[float, float]) -> list[Segment]:
    """Pieces of a wall along x."""
    return [(low, y, high, y) for low, high in spans]


def test_a_wall_in_pieces_is_building_and_what_stands_free_is_a_thing() -> None:
    pieces = [(-4.5, -3.2), (-2.2, -0.9), (0.1, 1.4), (2.4, 3.7)]
    room = [*wall(2.0, *pieces), *wall(-2.0, *pieces), (5.0, -2.0, 5.0, 2.0), (-5.0, -2.0, -5.0, 2.0)]
    box = [(1.0, -0.4, 1.5, -0.9), (1.5, -0.9, 2.0, -0.4)]
    found = detect(batch_of([turn([*room, *box], beams=1440)]))
    assert len(found) > 0
    assert (np.hypot(found.x - 1.5, found.y + 0.65) < 0.4).all()


def test_what_each_kind_of_evidence_adds_is_all_there_is() -> None:
    found = seen([*wall(2.0, (-3.0, -1.6), (-0.6, 0.6), (1.6, 3.0)), *wall(-1.5, (-0.2, 0.2)), *wall(5.0, (-8, 8))])
    assert found.features is not None
    told = contributions(found.features)
    assert [*told] == [START, *KINDS]
    odds = np.log(found.thing / (1.0 - found.thing))
    np.testing.assert_allclose(sum(told.values()), odds, atol=1e-6)
    lines = reasons(found.features, found.thing)
    assert all(line is not None and line.split(", ")[0].split()[0] in told for line in lines)
    assert reasons(found.features[:1], np.array([np.nan])) == [None]
