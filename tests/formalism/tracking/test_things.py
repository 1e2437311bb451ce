"""Bodies that become tracks: small pieces with answers by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from lidarcli.formalism.detection import LEGGED, PRISMATIC, UNKNOWN
from lidarcli.formalism.tracking import grouping, tracks, windows
from lidarcli.formalism.tracking.results import BOX, DISC, PERSON
from lidarcli.formalism.tracking.tracks import WHOLE_SIGHTINGS, Track, Tracklet


def test_where_a_body_and_its_twin_are() -> None:
    thing = Tracklet(1, yaw=math.pi / 2, c=(1.0, 2.0), static_c=(3.0, 0.0))
    assert thing.place(still=False) == pytest.approx((-2.0, 1.0))
    assert thing.place(still=True) == pytest.approx((0.0, 3.0))


def test_a_size_is_known_once_it_was_seen_often() -> None:
    assert not Tracklet(1, whole=WHOLE_SIGHTINGS - 1, size=0.5).size_is_known
    assert Tracklet(1, whole=WHOLE_SIGHTINGS, size=0.5).size_is_known
    assert Tracklet(1, kind=PERSON, whole=WHOLE_SIGHTINGS).has_legs
    assert not Tracklet(1, kind=DISC, whole=WHOLE_SIGHTINGS).has_legs


def test_two_sizes_that_differ_are_two_things() -> None:
    small, large = (Tracklet(n, kind=BOX, whole=WHOLE_SIGHTINGS, size=size) for n, size in ((1, 0.3), (2, 1.5)))
    assert grouping.differ(small, large)
    assert not grouping.differ(small, Tracklet(3, kind=BOX, whole=WHOLE_SIGHTINGS, size=0.35))
    # Of what was never seen whole nobody knows.
    assert not grouping.differ(small, Tracklet(4, kind=BOX, whole=0, size=1.5))
    person = Tracklet(5, kind=PERSON, whole=WHOLE_SIGHTINGS, size=0.4)
    assert grouping.differ(person, large)
    assert not grouping.differ(person, small)


def test_a_piece_goes_on_where_the_one_before_would_be() -> None:
    moved, static_codes = Tracklet(1, moved=1), Tracklet(2)
    before = grouping.TrackEnd(moved, 10, 1.0, 0.0, velocity=1.0)
    places = 2.0, 2.3, 0.0
    after = [grouping.TrackEnd(Tracklet(3, moved=1), 30, 3.0, x, velocity=1.0) for x in places]
    allowed = grouping.STITCH_DISTANCE + 2.0 * grouping.STITCH_SPEED
    assert grouping.stitch_costs([before], after)[0] == pytest.approx(np.array([0.0, 0.3, 0.1]) / allowed)
    late = [grouping.TrackEnd(body, 130, 15.0, 0.4) for body in (moved, static_codes)]
    ends = [before, grouping.TrackEnd(static_codes, 10, 1.0, 0.0)]
    greatest = [
        [grouping.MOST_STITCH_DISTANCE, grouping.MOST_STANDING_STITCH_DISTANCE],
        [grouping.MOST_STANDING_STITCH_DISTANCE, grouping.STITCH_DISTANCE],
    ]
    # Both went to and fro, or one of them.
    off = [[0.5, 0.5], [0.4, 0.4]]
    assert grouping.stitch_costs(ends, late) == pytest.approx(np.array(off) / greatest)
    for gone, longest in ((moved, grouping.LONGEST_STITCH_GAP), (static_codes, grouping.LONGEST_STANDING_GAP)):
        end = grouping.TrackEnd(gone, 10, 1.0, 0.0)
        begins = [grouping.TrackEnd(static_codes, 30, 1.0 + gap, 0.0) for gap in (-0.1, 0.0, longest, longest + 0.1)]
        assert np.isfinite(grouping.stitch_costs([end], begins)[0]).tolist() == [False, False, True, False]


def test_a_track_moves_from_the_first_onset_of_its_bodies() -> None:
    track = Track()
    for number, (moved, first, onset) in enumerate(((0, 0, 3), (1, 20, 50), (1, 40, 40 + windows.ARRIVAL_SWEEPS))):
        track.add_part(Tracklet(number, moved=moved, first_sweep=first, onset=onset))
    seen, at = sightings(0.1 * np.arange(40.0)), np.arange(40)
    assert windows.is_moving(seen, track, at)
    # What shows at once has come moving.
    assert (track.moved, track.onset) == (True, 40)
    assert all(part.track is track for part in track.parts)
    still = Track()
    still.add_part(Tracklet(9))
    assert not windows.is_moving(seen, still, at)


def sightings(x: np.ndarray, width: float = 0.5) -> SimpleNamespace:
    """A body that was seen at these places, in ten sweeps a second."""
    sweep = np.arange(len(x))
    return SimpleNamespace(sweep=sweep, time=sweep / 10, place=x + 0j, width=np.full(len(x), width))


@pytest.mark.parametrize(
    ("x", "width", "left"),
    [
        pytest.param(np.zeros(60), 0.5, False, id="stands"),
        pytest.param(0.1 * np.arange(60.0), 0.5, True, id="goes"),
        pytest.param(0.015 * np.arange(60.0), 0.5, True, id="creeps"),
        pytest.param(np.repeat([0.0, 0.5], 30), 0.1, True, id="a person makes a step"),
        pytest.param(np.repeat([0.0, 0.25], 30), 0.5, True, id="is pushed"),
        pytest.param(np.repeat([0.0, 0.15], 30), 0.5, False, id="less than 20 cm"),
        pytest.param(np.repeat([0.0, 0.8, 0.0], [30, 6, 30]), 0.5, False, id="taken for what passes"),
        pytest.param(np.repeat([0.8, 0.0], [6, 60]), 0.5, True, id="comes and stops"),
        pytest.param(np.repeat([0.0, 0.8], [60, 6]), 0.5, True, id="goes at last"),
        pytest.param(np.tile(np.repeat([0.0, 0.6], 10), 4), 0.1, False, id="two legs of a chair"),
        pytest.param(0.3 * (np.arange(60) % 7 > 3), 0.5, False, id="to and fro"),
        pytest.param(4.0 * np.abs(np.arange(200) / 50 % 2 - 1), 0.5, True, id="walks up and down"),
        pytest.param(np.zeros(windows.STAYED_SIGHTINGS - 1), 0.5, True, id="seen too seldom"),
        pytest.param(np.repeat([0.0, 0.8], 250), 0.5, True, id="long"),
    ],
)
def test_what_is_seen_again_where_it_was_does_not_move(x: np.ndarray, width: float, left: bool) -> None:
    track = Track()
    track.add_part(Tracklet(1, moved=1, first_sweep=0, onset=12))
    assert windows.is_moving(sightings(x, width), track, np.arange(len(x))) == left
    assert track.moved == left


@pytest.mark.parametrize(("legs", "moves"), [(2, True), (4, False)], ids=["a person", "a chair"])
def test_what_shows_more_legs_than_a_person_has_to_travel(legs: int, moves: bool) -> None:
    # A leg of something else was seen at first.
    x = np.append(np.repeat(1.5, 6), np.tile(0.1 * np.arange(legs), 60))
    seen = sightings(x, 0.05)
    seen.sweep = np.append(np.arange(6), 6 + np.repeat(np.arange(60), legs))
    seen.time = seen.sweep / 10
    track = Track()
    track.add_part(Tracklet(1, kind=PERSON, moved=1))
    assert windows.is_moving(seen, track, np.arange(len(x))) == moves


def test_what_had_stayed_moves_from_where_it_left() -> None:
    track = Track(path_stop=10)
    track.add_part(Tracklet(1, moved=1, first_sweep=0, onset=9))
    assert windows.is_moving(sightings(np.repeat([0.0, 0.8], [40, 20])), track, np.arange(60))
    # Hardly any of the 20 places after the 25th are that of before, and none after the 40th.
    assert 25 < track.onset <= 40


@pytest.mark.parametrize(
    ("half", "off", "joins"), [(0.1, 0.3, True), (0.6, 0.3, False), (0.1, 1.5, False)], ids=["leg", "wall", "pole"]
)
def test_only_what_is_slim_and_goes_with_a_person_joins_it(half: float, off: float, joins: bool) -> None:
    time = np.arange(10) / 10
    seen = SimpleNamespace(
        spans={1: slice(0, 5), 2: slice(5, 10)},
        time=np.append(time[5:], time[:5]),
        # The person goes at 1 m/s; the other was seen just before.
        place=np.append(time[5:], time[:5]) + 1j * np.repeat([0.0, off], 5),
    )
    person, other = Tracklet(1, kind=PERSON, moved=1, h=(0.2, 0.2)), Tracklet(2, same_as=1, h=(half, 0.05))
    grouping.merge_duplicates(seen, [other], {1: person, 2: other})
    assert (other.track is not None) == joins
    assert other.track is person.track


def test_the_shape_is_the_likeliest_if_it_is_likelier() -> None:
    """`shape_votes` counts the views that took it for prismatic, round, legged and irregular."""
    track = Track()
    boxy = (40.0, 1.0, 0.0, 2.0)
    assert tracks.shape_of(track, Tracklet(1, shape_votes=boxy)) == PRISMATIC
    assert tracks.shape_of(track, Tracklet(1, shape_votes=(0.0,) * 4)) == UNKNOWN
    assert tracks.shape_of(track, Tracklet(1, shape_votes=boxy, bulge=400.0, bulge_points=100.0)) != PRISMATIC
    track.several = True
    assert tracks.shape_of(track, Tracklet(1, shape_votes=boxy)) == LEGGED
    # However long it is seen.
    assert tracks.shape_of(track, Tracklet(1, shape_votes=tuple(1000.0 * count for count in boxy))) == LEGGED
