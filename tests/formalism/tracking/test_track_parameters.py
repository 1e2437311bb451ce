"""What tracking may be told, what it refuses, and headers that would keep it busy for ever."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.errors import OptionError
from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.detection import REMOVED
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.simulation import scene as make
from lidarcli.sweeps.range_rules import RangeRules, normalise
from tests.formalism.tracking.following import follow, scene_of, simulated
from tests.sweeping import raw_sweeps


@pytest.mark.parametrize("score", [0.0, 1.0, -0.5, 1.5, float("nan"), float("inf")])
def test_an_agent_score_that_is_no_probability_is_refused(score: float) -> None:
    with pytest.raises(OptionError, match="--agent-score"):
        TrackParameters(score)


def test_a_batch_that_is_none_is_refused() -> None:
    log = simulated(scene_of(make.box(2.0, 0.0, 0.5, 0.5)), 3)
    found = detect(log, Parameters())
    with pytest.raises(ValueError, match="beams"):
        Tracker().add(replace(log, beams=log.beams + 1), found)


def test_what_is_gone_from_a_background_is_nothing_to_follow() -> None:
    log = simulated(scene_of(make.box(2.0, 0.0, 0.5, 0.5), make.cylinder(-2.0, 0.5, 0.2)), 40)
    found = detect(log, Parameters())
    gone = np.where(found.x < 0, REMOVED, 0).astype(np.int8)
    tracker = Tracker()
    followed = tracker.add(log, replace(found, change=gone))
    rest, tracks = tracker.finish()
    (one,) = followed + rest
    assert len(tracks) == 1
    assert (one.track > 0).tolist() == (found.x > 0).tolist()


def follow_hardly_turning() -> None:
    """Something that is gone, between beams that are hardly apart."""
    ranges = np.full((12, 60), 4.0)
    ranges[:6, 20:30] = 1.0
    raw = raw_sweeps(ranges, angle_min=0.0, angle_increment=1e-9)
    follow(normalise(raw, np.arange(12), RangeRules()))


if __name__ == "__main__":
    follow_hardly_turning()
