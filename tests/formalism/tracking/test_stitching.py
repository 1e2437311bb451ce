"""Pieces of tracks: no two that are seen at the same time become one."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lidarcli.formalism.tracking import grouping
from lidarcli.formalism.tracking.tracks import Track, Tracklet


def track_of(*spans: tuple[int, int]) -> Track:
    track = Track()
    for number, (first, last) in enumerate(spans, 1):
        track.add_part(Tracklet(number, first_sweep=first, last_sweep=last))
    return track


def test_tracks_that_are_seen_at_the_same_time_overlap() -> None:
    assert not grouping.overlap(track_of((0, 10)), track_of((11, 30)))
    assert not grouping.overlap(track_of((11, 30)), track_of((0, 10)))
    assert grouping.overlap(track_of((0, 10)), track_of((10, 30)))
    # A fits both others, but those are there at the same time.
    grown = track_of((0, 10), (20, 60))
    assert grouping.overlap(grown, track_of((15, 40)))
    assert not grouping.overlap(grown, track_of((61, 70)))


def sightings(number: int, time: np.ndarray, x: np.ndarray, now: bool) -> SimpleNamespace:
    """The sightings of one body at ten sweeps a second, in the window or in the next one."""
    return SimpleNamespace(
        time=time,
        sweep=np.round(10 * time).astype(int),
        place=x + 0j,
        now=np.full(len(x), now),
        spans={number: slice(0, len(x))},
        keyframes=None,
    )


@pytest.mark.parametrize(("begins_at", "goes_on"), [(8.0, True), (11.5, False)])
def test_a_piece_goes_on_after_a_gap_between_two_windows(begins_at: float, goes_on: bool) -> None:
    time = np.arange(50) / 10
    earlier = Tracklet(1, moved=1, last_sweep=49, last_time=4.9, has_ended=True)
    track = Track()
    track.add_part(earlier)
    of_before = sightings(1, time, 1.0 * time, now=True)
    grouping.store_end(of_before, earlier)
    assert earlier.final == pytest.approx((4.9, 1.0))
    assert not grouping.is_expired(of_before, earlier)
    # It was hidden for three seconds, and went on at 1 m/s.
    later = Tracklet(2, moved=1, first_sweep=80, last_sweep=129)
    seen = sightings(2, 8.0 + time, begins_at + 1.0 * time, now=True)
    grouping.stitch(seen, [later], {1: earlier, 2: later})
    assert (later.track is track) == goes_on


def test_a_body_is_forgotten_when_nothing_can_go_on_with_it() -> None:
    time = np.arange(200) / 10
    seen = sightings(2, time, time, now=True)
    for ago, moved, past in ((14.0, 1, False), (16.0, 1, True), (16.0, 0, False), (31.0, 0, True)):
        body = Tracklet(1, moved=moved, last_time=float(time[-1]) - ago)
        assert grouping.is_expired(seen, body) == past
