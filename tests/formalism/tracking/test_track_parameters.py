"""What tracking may be told, what it refuses, and headers that would keep it busy for ever."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from lidarcli.errors import OptionError
from lidarcli.formalism import Parameters, detect
from lidarcli.formalism.detection import REMOVED
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.range_rules import RangeRules, normalise
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Motion
from tests.formalism.tracking.following import follow, scene_of, simulated
from tests.places import ROOT
from tests.sweeping import raw_sweeps
from tests.waiting import HANG


@pytest.mark.parametrize("share", [0.0, -1.0, 1e-13, 0.2, float("nan"), float("inf")])
def test_a_significance_that_is_none_is_refused(share: float) -> None:
    with pytest.raises(OptionError, match="--significance"):
        TrackParameters(share)


def test_parameters_are_told_as_plain_values() -> None:
    assert TrackParameters(1e-3).as_dict() == {"significance": 1e-3, "memory": True}


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


def test_frames_are_named_by_first_sight() -> None:
    log = simulated(scene_of(make.box(2.0, 0.0, 0.5, 0.5)), 20)
    new = make.cylinder(-2.0, 0.5, 0.2, motion=Motion(appears=1.0))
    later = simulated(scene_of(make.box(2.0, 0.0, 0.5, 0.5), new), 20)
    both = replace(later, frame_ids=("b", "a"), frame=np.repeat(np.array([1, 0], np.int32), 10))
    told = follow([replace(log, frame_ids=("a",)), both])
    assert told.tracker.frames == ["a", "b"]
    assert told.tracks.frame.tolist() == [0, 1, 1]
    assert told.tracks.track.tolist() == [1, 2, 3]


@pytest.mark.slow
def test_a_header_with_hardly_any_increment_takes_no_time() -> None:
    """Not compiled, a look at every bearing between two beams would take hours."""
    module = "tests.formalism.tracking.test_track_parameters"
    slowly = os.environ | {"LIDARCLI_COMPILED": "no"}
    done = subprocess.run(
        [sys.executable, "-m", module], cwd=ROOT, env=slowly, timeout=HANG, capture_output=True, check=False
    )
    assert done.returncode == 0


def follow_hardly_turning() -> None:
    """Something that is gone, between beams that are hardly apart."""
    ranges = np.full((12, 60), 4.0)
    ranges[:6, 20:30] = 1.0
    raw = raw_sweeps(ranges, angle_min=0.0, angle_increment=1e-9)
    follow(normalise(raw, np.arange(12), RangeRules()))


if __name__ == "__main__":
    follow_hardly_turning()
