"""The columns of the tracks table agree with each other and with the rows of the objects."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from lidarcli.formalism.detection import AGENT
from lidarcli.formalism.tracking.results import ENDS
from tests.formalism.tracking.following import TrackedLog, follow, moving_log, repeated

LOGS = (("room", False), ("hall", True), ("crossing", False), ("people", False))


@cache
def told_of(kind: str, driving: bool) -> TrackedLog:
    """A log of four windows."""
    return follow(repeated(moving_log(kind, 5, driving=driving), 3))  # type: ignore[arg-type]


@pytest.mark.parametrize(("kind", "driving"), LOGS)
def test_a_track_is_an_agent_from_its_onset_to_its_end(kind: str, driving: bool) -> None:
    told = told_of(kind, driving)
    for number, moved in zip(told.tracks.track, told.tracks.moved, strict=True):
        at = told.of(number)
        agent, rows = told.columns["set"][at] == AGENT, told.row[at]
        assert agent.any() == moved
        if moved:
            assert agent[rows > rows[agent][0]].all()
        # What is no agent yet has no speed.
        assert (told.columns["vx"][at][~agent] == 0).all()
        assert (told.columns["vy"][at][~agent] == 0).all()
        assert (told.columns["moving"][at][~agent] == 0).all()
    np.testing.assert_array_equal(told.tracks.set == AGENT, told.tracks.moved)


@pytest.mark.parametrize(("kind", "driving"), LOGS)
def test_numbers_are_finite_and_fit_together(kind: str, driving: bool) -> None:
    tracks = told_of(kind, driving).tracks
    for name in ("x", "y", "yaw", "duration", "hidden", "distance", "speed_mean", "speed_max"):
        assert np.isfinite(getattr(tracks, name)).all(), name
    assert (tracks.first_stamp_ns <= tracks.last_stamp_ns).all()
    assert tracks.duration == pytest.approx((tracks.last_stamp_ns - tracks.first_stamp_ns) / 1e9)
    assert (tracks.hidden >= -1e-9).all()
    assert (tracks.hidden <= tracks.duration + 1e-9).all()
    # At a steady rate what was not seen was hidden.
    lasts = tracks.last_sweep - tracks.first_sweep + 1
    assert tracks.hidden == pytest.approx((lasts - tracks.sweeps) / 10, abs=0.01)
    assert (tracks.distance[~tracks.moved] == 0).all()
    assert (tracks.speed_mean <= tracks.speed_max + 1e-9).all()
    assert (tracks.end < len(ENDS)).all()
    assert (tracks.yaw > -np.pi / 2).all()
    assert (tracks.yaw <= np.pi / 2).all()
    known = ~np.isnan(tracks.length) & ~np.isnan(tracks.width)
    assert (tracks.length[known] >= tracks.width[known]).all()
    for size in ("length", "width"):
        np.testing.assert_array_equal(np.isnan(getattr(tracks, size)), np.isnan(getattr(tracks, f"{size}_sd")))
    assert (tracks.length_sd[known] > 0).all()
