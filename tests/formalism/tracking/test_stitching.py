"""Pieces of tracks: one goes on with another that begins after it has ended, and only once."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lidarcli.formalism.tracking import joins
from lidarcli.formalism.tracking.tracks import Track, Tracklet


def sightings(number: int, time: np.ndarray, x: np.ndarray, now: bool) -> SimpleNamespace:
    """The sightings of one body at ten sweeps a second, in the window or in the next one."""
    return SimpleNamespace(
        time=time,
        sweep=np.round(10 * time).astype(int),
        place=x + 0j,
        now=np.full(len(x), now),
        owner=np.full(len(x), number),
        spans={number: slice(0, len(x))},
        keyframes=None,
        is_placed=False,
    )


@pytest.mark.parametrize(("begins_at", "goes_on"), [(8.0, True), (11.5, False)])
def test_a_piece_goes_on_after_a_gap_between_two_windows(begins_at: float, goes_on: bool) -> None:
    time = np.arange(50) / 10
    earlier = Tracklet(1, moved=1, last_sweep=49, last_time=4.9, has_ended=True)
    track = Track()
    track.add_part(earlier)
    of_before = sightings(1, time, 1.0 * time, now=True)
    joins.store_end(of_before, earlier)
    assert earlier.final == pytest.approx((4.9, 1.0))
    assert not joins.is_expired(earlier, 4.9)
    # It was hidden for three seconds, and went on at 1 m/s.
    later = Tracklet(2, moved=1, first_sweep=80, last_sweep=129)
    seen = sightings(2, 8.0 + time, begins_at + 1.0 * time, now=True)
    joins.stitch(seen, [later], {1: earlier, 2: later})
    assert (later.track is track) == goes_on


@pytest.mark.parametrize(
    ("others", "goes_on"),
    [
        ((), True),
        # Its track has gone on elsewhere, and ended there.
        (((60, 70),), False),
        # It still goes on elsewhere.
        (((45, 90),), False),
        # One that began before was seen longer.
        (((10, 85),), False),
        # A leg is that of another person by now.
        (((45, 90, 7),), True),
    ],
)
def test_a_piece_with_a_successor_is_no_end(others: tuple[tuple[int, ...], ...], goes_on: bool) -> None:
    earlier = Tracklet(1, moved=1, first_sweep=0, last_sweep=49, last_time=4.9, has_ended=True, final=(4.9, 1.0))
    track = Track()
    track.add_part(earlier)
    for number, (first, last, *member) in enumerate(others, 3):
        track.add_part(Tracklet(number, first_sweep=first, last_sweep=last, member=sum(member), has_ended=True))
    later = Tracklet(2, moved=1, first_sweep=80, last_sweep=129)
    time = np.arange(50) / 10
    seen = sightings(2, 8.0 + time, 8.0 + time, now=True)
    joins.stitch(seen, [later], {part.number: part for part in (*track.parts, later)})
    assert (later.track is track) == goes_on


def test_a_body_is_forgotten_when_nothing_can_go_on_with_it() -> None:
    time = np.arange(200) / 10
    for ago, moved, past in ((14.0, 1, False), (16.0, 1, True), (16.0, 0, False), (31.0, 0, True)):
        body = Tracklet(1, moved=moved, last_time=float(time[-1]) - ago)
        assert joins.is_expired(body, float(time[-1])) == past
