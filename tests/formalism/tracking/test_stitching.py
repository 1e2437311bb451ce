"""Pieces of tracks: no two that are seen at the same time become one."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from lidarcli.formalism.tracking import grouping
from lidarcli.formalism.tracking.tracks import Tracklet


def sightings(number: int, time: np.ndarray, x: np.ndarray, now: bool) -> SimpleNamespace:
    """The sightings of one body at ten sweeps a second, in the window or in the next one."""
    return SimpleNamespace(
        time=time,
        sweep=np.round(10 * time).astype(int),
        place=x + 0j,
        now=np.full(len(x), now),
        spans={number: slice(0, len(x))},
    )


def test_a_body_is_forgotten_when_nothing_can_go_on_with_it() -> None:
    time = np.arange(200) / 10
    seen = sightings(2, time, time, now=True)
    for ago, moved, past in ((14.0, 1, False), (16.0, 1, True), (16.0, 0, False), (31.0, 0, True)):
        body = Tracklet(1, moved=moved, last_time=float(time[-1]) - ago)
        assert grouping.is_expired(seen, body) == past
