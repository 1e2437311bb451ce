"""Shapes of what is followed do not change from sweep to sweep; which bodies are followed is decided before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lidarcli
from lidarcli.formalism import Detection, Parameters, detect
from lidarcli.formalism.parameters import TrackParameters
from lidarcli.formalism.tracking.results import TrackedBatch, Tracks
from lidarcli.formalism.tracking.tracker import Tracker
from lidarcli.simulation import scene as make
from lidarcli.sweeps.types import SweepBatch
from tests.formalism.tracking.following import scene_of, simulated

SWEEPS = 60


def log() -> tuple[SweepBatch, Detection]:
    """Two boxes that stand, one to the left and one to the right."""
    batch = simulated(scene_of(make.box(2.0, 1.0, 0.5, 0.4), make.box(2.0, -1.0, 0.4, 0.5)), SWEEPS)
    return batch, detect(batch, Parameters(min_thing=0.0))


def told(batch: SweepBatch, found: Detection, *, memory: bool = True) -> tuple[TrackedBatch, Tracks]:
    """What a tracker says of one batch."""
    tracker = Tracker(TrackParameters(memory=memory))
    answers = tracker.add(batch, found)
    rest, tracks = tracker.finish()
    (one,) = answers + rest
    return one, tracks


def test_shapes_do_not_change_from_sweep_to_sweep() -> None:
    batch, found = log()
    shapes = found.shape.copy()
    shapes[::9] = 3
    one, _ = told(batch, replace(found, shape=shapes))
    assert len(np.unique(one.shape[found.y > 0])) == 1
    again, _ = told(batch, replace(found, shape=shapes), memory=False)
    np.testing.assert_array_equal(again.shape, shapes)


@pytest.mark.parametrize("memory", [False, True])
def test_memory_is_an_option_of_detect_and_of_track(memory: bool) -> None:
    batch, _ = log()
    objects = lidarcli.detect(batch, memory=memory)
    assert objects["track"].null_count == len(objects) == 2 * SWEEPS
    tables = lidarcli.track(batch, memory=memory)
    assert tables.objects["track"].null_count == 0
    assert set(tables.objects["shape"].to_pylist()) <= {"prismatic", "round", "unknown"}
    if memory:
        assert objects["shape"].to_pylist() == tables.objects["shape"].to_pylist()
