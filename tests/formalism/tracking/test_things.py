"""Bodies that become tracks: small pieces with answers by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from lidarcli.formalism.detection import LEGGED, PRISMATIC, UNKNOWN
from lidarcli.formalism.tracking import joins, tracks
from lidarcli.formalism.tracking.results import BOX, DISC, PERSON
from lidarcli.formalism.tracking.tracks import LEG_DISTANCE_SD, WHOLE_SIGHTINGS, Track, Tracklet, frame_of_legs


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
    assert joins.differ(small, large)
    assert not joins.differ(small, Tracklet(3, kind=BOX, whole=WHOLE_SIGHTINGS, size=0.35))
    # Of what was never seen whole nobody knows.
    assert not joins.differ(small, Tracklet(4, kind=BOX, whole=0, size=1.5))
    person = Tracklet(5, kind=PERSON, whole=WHOLE_SIGHTINGS, size=0.4)
    assert joins.differ(person, large)
    assert not joins.differ(person, small)


def test_a_piece_goes_on_where_the_one_before_would_be() -> None:
    moved, static_codes = Tracklet(1, moved=1), Tracklet(2)
    before = joins.TrackEnd(moved, 10, 1.0, 0.0, velocity=1.0)
    places = 2.0, 2.3, 0.0
    after = [joins.TrackEnd(Tracklet(3, moved=1), 30, 3.0, x, velocity=1.0) for x in places]
    allowed = joins.JOIN.distance + 2.0 * joins.JOIN.speed
    assert joins.stitch_costs([before], after)[0] == pytest.approx(np.array([0.0, 0.3, 0.1]) / allowed)
    late = [joins.TrackEnd(body, 130, 15.0, 0.4) for body in (moved, static_codes)]
    ends = [before, joins.TrackEnd(static_codes, 10, 1.0, 0.0)]
    greatest = [[joins.JOIN.max_distance] * 2, [joins.JOIN.max_distance, joins.JOIN.distance]]
    # Both went to and fro, or one of them.
    off = [[0.5, 0.5], [0.4, 0.4]]
    assert joins.stitch_costs(ends, late) == pytest.approx(np.array(off) / greatest)
    for gone, longest in ((moved, joins.JOIN.longest_gap), (static_codes, joins.JOIN.longest_static_gap)):
        end = joins.TrackEnd(gone, 10, 1.0, 0.0)
        begins = [joins.TrackEnd(static_codes, 30, 1.0 + gap, 0.0) for gap in (-0.1, 0.0, longest, longest + 0.1)]
        assert np.isfinite(joins.stitch_costs([end], begins)[0]).tolist() == [False, False, True, False]


@pytest.mark.parametrize(
    ("half", "off", "is_joined"), [(0.1, 0.3, True), (0.6, 0.3, False), (0.1, 1.5, False)], ids=["leg", "wall", "pole"]
)
def test_only_what_is_slim_and_goes_with_a_person_joins_it(half: float, off: float, is_joined: bool) -> None:
    time = np.arange(10) / 10
    seen = SimpleNamespace(
        spans={1: slice(0, 5), 2: slice(5, 10)},
        time=np.append(time[5:], time[:5]),
        # The person goes at 1 m/s; the other was seen just before.
        place=np.append(time[5:], time[:5]) + 1j * np.repeat([0.0, off], 5),
    )
    person, other = Tracklet(1, kind=PERSON, moved=1, h=(0.2, 0.2)), Tracklet(2, same_as=1, h=(half, 0.05))
    joins.merge_duplicates(seen, [other], {1: person, 2: other})
    assert (other.track is not None) == is_joined
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


def legged(*parts: tuple[float, float, int, int], kind: int = DISC) -> Track:
    """A track of legs: place [m], and first and last sweep of each."""
    track = Track(several=True)
    for number, (x, y, first, last) in enumerate(parts, 1):
        seen = {"sightings": last - first + 1, "first_sweep": first, "last_sweep": last}
        track.add_part(Tracklet(number, kind=kind, static_c=(x, y), static_cc=(4e-4, 1e-4), **seen))
    return track


def test_a_frame_is_as_long_as_its_legs_at_one_time() -> None:
    chair = legged((0.0, 0.0, 0, 90), (0.4, 0.0, 3, 90), (0.0, 0.5, 0, 80), (0.4, 0.5, 5, 60))
    frame = frame_of_legs(chair)
    assert frame is not None
    assert (frame["legs"], frame["length"], frame["width"]) == pytest.approx((4, 0.5, 0.4))
    # As sure as the places of its legs, not more.
    assert frame["sd"] == pytest.approx(math.hypot(LEG_DISTANCE_SD, 0.02 * math.sqrt(2)))
    # Later, other legs took the place of the first ones, 0.6 m further each time.
    later = ((0.4 + 0.6 * k, 0.0, 50 * k + 50, 50 * k + 80) for k in (1, 2, 3))
    frame = frame_of_legs(legged((0.0, 0.0, 0, 90), (0.4, 0.0, 0, 90), *later))
    assert frame is not None
    assert frame["length"] == pytest.approx(0.4)
    # What stands metres away is no leg of it, whatever brought the two together, nor is a person.
    assert frame_of_legs(legged((0.0, 0.0, 0, 90), (2.3, 0.9, 10, 90))) is None
    chair.add_part(Tracklet(9, kind=PERSON, sightings=80, last_sweep=90, static_c=(0.9, 0.0)))
    frame = frame_of_legs(chair)
    assert frame is not None
    assert frame["length"] == pytest.approx(0.5)
