"""Tracks named by all that was seen of them: boxes that are alike, looks that say the same, legs, and what has moved."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from lidarcli.formalism.detection import LEGGED, ROUND
from lidarcli.formalism.matching.catalogue import Catalogue, Thing
from lidarcli.formalism.tracking import tracks
from lidarcli.formalism.tracking.results import BOX, DISC
from lidarcli.formalism.tracking.tracks import LEAST_SIZE_SD, SHARED_SD_SHARE, Naming, SizeMeasurements, Track, Tracklet
from tests.formalism.three_boxes import Named, named

PALLET = Catalogue((Thing("pallet", "prismatic", length=1.2, width=0.8, moves=False),))


def looks(sizes: Any, edges: Any, sd: float = 0.02, yaw: float = 0.0) -> SizeMeasurements:
    """Sightings of both sides."""
    size = np.column_stack([np.atleast_2d(sizes), np.full(len(edges), np.nan)])
    return SizeMeasurements(
        size=size,
        sd=np.where(np.isfinite(size), sd, np.nan),
        yaw=np.full(len(size), yaw),
        blur=np.full(len(size), 0.03),
        intensity=np.full(len(size), np.nan),
        edges=np.asarray(edges, np.int64),
    )


def body(**known: Any) -> Tracklet:
    return Tracklet(7, **{"kind": BOX, "sightings": 50, "shape_votes": (50.0, 0.0, 0.0, 0.0), **known})


def label_of(track: Track, *seen: SizeMeasurements) -> tuple[int, float]:
    """The label of a track of one body after some windows."""
    names = Naming(PALLET)
    for one in seen:
        number, axes = np.full(len(one.yaw), 7), np.zeros(len(one.yaw))
        names.take([one], number, axes, {7: track.parts[0]})
        names.name([track])
    return track.label, track.label_score


def a_track(thing: Tracklet, **known: Any) -> Track:
    track = Track(**known)
    track.add_part(thing)
    return track


def test_the_same_beams_say_nothing_new() -> None:
    """A thousand sweeps by the same beams know a side as well as one; by other beams they know it better."""
    same = tracks._mean(np.array([1000.0]), np.array([1 / 0.02**2]), np.array([1.2]))
    assert same == pytest.approx((1.2, math.hypot(0.02, LEAST_SIZE_SD)))
    other = tracks._mean(np.full(100, 5.0), np.full(100, 1 / 0.02**2), np.full(100, 1.2))
    assert other[1] == pytest.approx(math.hypot(0.02 * math.sqrt(0.01 + 0.99 * SHARED_SD_SHARE**2), LEAST_SIZE_SD))


def test_a_look_that_is_far_off_counts_little() -> None:
    sizes = np.array([1.2] * 9 + [0.4])
    size, _ = tracks._mean(np.full(10, 5.0), np.full(10, 1 / 0.02**2), sizes)
    assert size == pytest.approx(1.2, abs=0.001)


def test_names_come_once_enough_was_seen_and_stay() -> None:
    nothing = looks([[1.2, np.nan]] * 5, [1] * 5)
    assert label_of(a_track(body()), nothing)[0] == -1
    label, score = label_of(a_track(body()), nothing, looks([[np.nan, 0.8]] * 5, [2] * 5), nothing)
    assert (label, score > 0.95) == (0, True)


def test_sides_are_those_of_the_body_however_its_box_lies() -> None:
    """A quarter turn makes the first axis of a box the second one of its body."""
    seen = looks([[1.2, 0.8]] * 5, [1] * 5), looks([[0.8, 1.2]] * 5, [2] * 5, yaw=-math.pi / 2)
    names = Naming(PALLET)
    for one in seen:
        names.take([one], np.full(5, 7), np.full(5, 0.1), {7: body()})
    assert names._sizes[7].estimate()[:2, 0] == pytest.approx([1.2, 0.8])


def test_what_never_moves_and_has_moved_is_something_else() -> None:
    seen = looks([[1.2, 0.8]] * 5, [1] * 5)
    assert label_of(a_track(body(), moved=True), seen) == (-1, pytest.approx(math.nan, nan_ok=True))


def test_the_intensity_of_a_track_is_the_mean_of_its_sweeps() -> None:
    """Of those in which it is known, however they come in windows; it outlives the looks."""
    names, thing = Naming(PALLET), body()
    assert np.isnan(names._evidence([a_track(thing)]).intensity).all()
    parts = [[math.nan, math.nan], [100.0, math.nan, 400.0], [700.0]]
    for told in parts:
        seen = replace(looks([[1.2, 0.8]] * len(told), range(len(told))), intensity=np.array(told))
        names.take([seen], np.full(len(told), 7), np.zeros(len(told)), {7: thing})
    assert names._evidence([a_track(thing)]).intensity.tolist() == [pytest.approx(400.0)]
    names.forget([7])
    assert names._evidence([a_track(thing)]).intensity.tolist() == [pytest.approx(400.0)]


def test_what_is_over_is_remembered_in_short() -> None:
    names, thing = Naming(PALLET), body()
    names.take([looks([[1.2, 0.8]] * 5, [1, 2, 3, 4, 5])], np.full(5, 7), np.zeros(5), {7: thing})
    before = names._sizes[7].estimate()
    names.forget([7, 8])
    assert not names._sizes[7].looks
    assert np.array_equal(names._sizes[7].estimate(), before, equal_nan=True)
    track = a_track(thing)
    names.name([track])
    assert track.label == 0


def test_who_walks_on_several_legs_has_two_and_no_sides() -> None:
    """How far apart they are changes with every step."""
    names, leg = Naming(PALLET), body(kind=DISC, shape_votes=(2.0, 20.0, 0.0, 1.0))
    names.take([looks([[0.1, 0.1]], [1])], np.array([7]), np.array([math.nan]), {7: leg})
    evidence = names._evidence([a_track(leg, several=True, moved=True), a_track(leg, moved=True)])
    assert evidence.legs.tolist() == [2, 0]
    assert evidence.shape.argmax(axis=1).tolist() == [LEGGED, ROUND]
    assert np.isnan(evidence.side_1).tolist() == [True, False]
    assert np.isnan(evidence.span_1).all()


@pytest.mark.slow
def test_like_boxes_are_told_apart_by_a_sensor_that_drives() -> None:
    """Sides that differ by 5 cm, 361 beams, 1 cm of noise: 98 % are named, of 1,020 none wrongly; here 60 of these."""
    found = Named()
    for seed in range(20):
        found += named(seed, driving=True)
    assert found.boxes == 60
    assert found.right >= 57
    assert found.wrong == 0


@pytest.mark.slow
def test_like_boxes_are_not_told_apart_where_beams_are_too_far_apart() -> None:
    """Parked, the beams are 3 to 6 cm apart: most boxes get no name, and none a wrong one."""
    found = Named()
    for seed in range(20):
        found += named(seed, driving=False)
    assert 5 <= found.right <= 25
    assert found.wrong == 0
