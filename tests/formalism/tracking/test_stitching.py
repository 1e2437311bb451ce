"""Pieces of tracks: no two that are seen at the same time become one."""

from __future__ import annotations

from lidarcli.formalism.tracking import grouping
from lidarcli.formalism.tracking.tracks import Body, Track


def track_of(*spans: tuple[int, int]) -> Track:
    track = Track()
    for number, (first, last) in enumerate(spans, 1):
        track.absorb(Body(number, first_sweep=first, last_sweep=last))
    return track


def test_tracks_that_are_seen_at_the_same_time_overlap() -> None:
    assert not grouping._overlap(track_of((0, 10)), track_of((11, 30)))
    assert not grouping._overlap(track_of((11, 30)), track_of((0, 10)))
    assert grouping._overlap(track_of((0, 10)), track_of((10, 30)))
    # A fits both others, but those are there at the same time.
    grown = track_of((0, 10), (20, 60))
    assert grouping._overlap(grown, track_of((15, 40)))
    assert not grouping._overlap(grown, track_of((61, 70)))
