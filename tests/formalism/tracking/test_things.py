"""Bodies that become tracks: small pieces with answers by hand."""

from __future__ import annotations

import math
from dataclasses import fields
from types import SimpleNamespace

import numpy as np
import pytest

from lidarcli.formalism.detection import LEGGED, PRISMATIC, UNKNOWN
from lidarcli.formalism.tracking import grouping, motions, sightings, summary
from lidarcli.formalism.tracking.things import PAIRS, Thing, Track
from lidarcli.formalism.tracking.tracked import BOX, DISC, PERSON
from lidarcli.formalism.tracking.windows import Settled, Window


def test_where_a_body_and_its_twin_are() -> None:
    thing = Thing(1, yaw=math.pi / 2, c=(1.0, 2.0), still_c=(3.0, 0.0))
    assert thing.place(still=False) == pytest.approx((-2.0, 1.0))
    assert thing.place(still=True) == pytest.approx((0.0, 3.0))


def test_a_size_is_known_once_it_was_seen_often() -> None:
    assert not Thing(1, whole=PAIRS - 1, size=0.5).size_is_known
    assert Thing(1, whole=PAIRS, size=0.5).size_is_known
    assert Thing(1, kind=PERSON, whole=PAIRS).has_legs
    assert not Thing(1, kind=DISC, whole=PAIRS).has_legs


def test_two_sizes_that_differ_are_two_things() -> None:
    small, large = (Thing(n, kind=BOX, whole=PAIRS, size=size) for n, size in ((1, 0.3), (2, 1.5)))
    assert grouping._differ(small, large)
    assert not grouping._differ(small, Thing(3, kind=BOX, whole=PAIRS, size=0.35))
    # Of what was never seen whole nobody knows.
    assert not grouping._differ(small, Thing(4, kind=BOX, whole=0, size=1.5))
    person = Thing(5, kind=PERSON, whole=PAIRS, size=0.4)
    assert grouping._differ(person, large)
    assert not grouping._differ(person, small)


def test_a_piece_goes_on_where_the_one_before_would_be() -> None:
    before = grouping._Piece(Thing(1, moved=1), 10, 1.0, 0.0, 0.0, vx=1.0)
    for x, off in ((2.0, 0.0), (2.3, 0.3), (0.0, 0.1)):
        after = grouping._Piece(Thing(2, moved=1), 30, 3.0, x, 0.0, vx=1.0)
        assert grouping._apart(before, after, 2.0) == pytest.approx(off)
    assert grouping._allowed(before.thing, Thing(2, moved=1), 1e3) == grouping.MOST_ASTRAY
    assert grouping._allowed(before.thing, Thing(2), 1e3) == grouping.MOST_ASTRAY_STILL
    assert grouping._allowed(Thing(1), Thing(2), 1e3) == grouping.NEAR


def test_the_pace_is_that_of_the_line_through_its_places() -> None:
    time = np.arange(10) / 10
    seen = SimpleNamespace(time=time, x=2.0 * time + 1.0, y=-0.5 * time)
    assert grouping._speed(seen, slice(0, 10)) == pytest.approx((2.0, -0.5))
    assert grouping._speed(seen, slice(3, 4)) == (0.0, 0.0)


def test_a_track_moves_from_the_first_onset_of_its_bodies() -> None:
    track = Track()
    for number, (moved, first, onset) in enumerate(((0, 0, 3), (1, 20, 50), (1, 40, 40 + motions.AT_ONCE))):
        track.absorb(Thing(number, moved=moved, first_sweep=first, onset=onset))
    assert motions._moves(track)
    # What shows at once has come moving.
    assert (track.moved, track.onset) == (True, 40)
    assert all(part.track is track for part in track.parts)
    still = Track()
    still.absorb(Thing(9))
    assert not motions._moves(still)


def test_a_side_is_known_by_sightings_or_by_the_estimate() -> None:
    assert summary._side(Thing(1, side=(0.6, 0.0), side_weight=(400.0, 0.0)), 0) == (0.6, pytest.approx(0.05))
    assert summary._side(Thing(1, h=(0.3, 0.0), hh=(1e-4, 0.0)), 0) == (0.6, pytest.approx(0.02))
    unsure = summary._side(Thing(1, h=(0.3, 0.0), hh=(summary.SURE_SIZE**2, 0.0)), 0)
    assert np.isnan(unsure).all()


def test_the_shape_is_the_likeliest_if_it_is_likelier() -> None:
    """`looks` counts the views that took it for prismatic, round, legged and irregular."""
    track = Track()
    boxy = (40.0, 1.0, 0.0, 2.0)
    assert summary._shape(track, Thing(1, looks=boxy)) == PRISMATIC
    assert summary._shape(track, Thing(1, looks=(0.0,) * 4)) == UNKNOWN
    assert summary._shape(track, Thing(1, looks=boxy, bulge=400.0, bulge_points=100.0)) != PRISMATIC
    track.several = True
    assert summary._shape(track, Thing(1, looks=boxy)) == LEGGED
    # However long it is seen.
    assert summary._shape(track, Thing(1, looks=tuple(1000.0 * count for count in boxy))) == LEGGED


def test_what_is_settled_is_joined_and_taken_apart() -> None:
    nothing = Settled.joined([])
    names = [each.name for each in fields(Settled)]
    assert [len(getattr(nothing, name)) for name in names] == [0] * len(names)
    some = Settled(
        track=np.arange(5),
        vx=np.arange(5.0),
        vy=np.zeros(5),
        moving=np.zeros(5, np.bool_),
        agent=np.array([0, 0, 1, 1, 1], np.bool_),
        label=np.arange(5, dtype=np.int32),
        label_score=np.linspace(0.0, 1.0, 5),
        is_thing=np.array([-1, 0, 1, 1, 1], np.int8),
        thing=np.linspace(0.0, 1.0, 5),
        shape=np.arange(5, dtype=np.uint8),
    )
    again = Settled.joined([some.rows(slice(0, 2)), some.rows(slice(2, None))])
    for name in names:
        np.testing.assert_array_equal(getattr(again, name), getattr(some, name), strict=True)
    assert Window(0, 0).count == 0
    assert Window(0, 0, index=[np.arange(3), np.arange(4)]).count == 7


def test_room_for_sightings() -> None:
    arrays = sightings.room(7)
    assert {values.shape for values in arrays.values()} == {(7,), (7, 4)}
    log = sightings.Sightings()
    log.attach(arrays)
    assert (log.count, log.room) == (0, 7)
