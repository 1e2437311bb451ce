"""The pieces that describe an object, each by itself, on random points; and the room they are given."""

from __future__ import annotations

import itertools
from dataclasses import fields
from math import cos, hypot, inf, pi, sin

import numpy as np
import pytest

from lidarcli.formalism import SHAPES, Detection, Parameters, circle_fit, description
from lidarcli.formalism.detect import detect
from lidarcli.formalism.detection import COLUMNS, REQUIRED
from lidarcli.formalism.surfaces import Faces
from lidarcli.system import native
from tests.formalism.oracles import descriptions, surfaces
from tests.formalism.oracles.recording import random_batches
from tests.formalism.oracles.surfaces import Ambiguous, Place


def corner(rng: np.random.Generator, noise: float) -> tuple[list[Place], list[surfaces.Face]]:
    """Points on two faces of a box, and these."""
    sides, points = rng.uniform(0.2, 1.0, 2), rng.integers(4, 15, 2)
    yaw, centre = rng.uniform(0, 2 * pi), rng.uniform(1, 4)
    local = [(sides[0] * (1 - k / points[0]), 0.0) for k in range(points[0])]
    local += [(0.0, sides[1] * k / points[1]) for k in range(points[1])]
    turned = np.array(local) @ np.array([[cos(yaw), sin(yaw)], [-sin(yaw), cos(yaw)]])
    places = [(float(x), float(y)) for x, y in turned + [centre, 0] + noise * rng.standard_normal(turned.shape)]
    return places, surfaces.faces_between(places, [int(points[0])])


def core_faces(faces: list[surfaces.Face]) -> Faces:
    """The same as the core has them."""
    found = Faces(8)
    for f, face in enumerate(faces):
        found.points[f] = face.points
        found.middle_x[f], found.middle_y[f] = face.middle
        found.direction_x[f], found.direction_y[f] = face.direction
        found.rms[f], found.length[f] = face.rms, face.length
    return found


def look_at(faces: list[surfaces.Face]) -> description.FaceFit:
    """What the core sees of them."""
    look = description.FaceFit()
    order = sorted(range(len(faces)), key=lambda f: -faces[f].length)
    look.longest, look.second = [*order, -1, -1][:2]
    look.count, look.rms = len(faces), descriptions.faces_rms(faces)
    look.square = all(surfaces.turn(b, a) >= cos(description.SQUARE) for a, b in itertools.pairwise(faces))
    return look


def test_no_box_along_either_face_is_smaller() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        places, faces = corner(rng, float(rng.choice([0.0, 0.03])))
        box = description.Box()
        x, y = ([place[k] for place in places] for k in (0, 1))
        description.around_points(box, look_at(faces), core_faces(faces), x, y, len(places))
        try:
            centre, length, width, yaw = descriptions.box(places, faces)
        except Ambiguous:
            continue
        assert (box.x, box.y) == pytest.approx(centre, abs=1e-9)
        assert (box.length, box.width) == pytest.approx((length, width), abs=1e-9)
        assert cos(2 * box.yaw - 2 * yaw) == pytest.approx(1, abs=1e-9) or length == pytest.approx(width)
        assert -pi / 2 < box.yaw <= pi / 2


@pytest.mark.parametrize("noise", [0.001, 0.005])
def test_boxes_and_posts_have_their_shapes(noise: float) -> None:
    rng = np.random.default_rng(6)
    seen = set()
    for number in range(120):
        if number % 2:
            places, faces = corner(rng, noise)
        else:
            radius, count = rng.uniform(0.1, 0.4), int(rng.integers(8, 30))
            angles = np.linspace(-pi / 2 + 0.1, pi / 2 - 0.1, count) + pi
            r = radius + noise * rng.standard_normal(count)
            cloud = np.stack([2 + r * np.cos(angles), r * np.sin(angles)], 1)[::-1]
            places = [(float(x), float(y)) for x, y in cloud]
            faces = surfaces.faces_between(places, surfaces.split(places, 0.02 + 3 * noise))
        circle = circle_fit.Circle(len(places))
        circle.n = len(places)
        for k, place in enumerate(places):
            circle.x[k], circle.y[k] = place
        x, y = np.mean(places, axis=0).tolist()
        chord = hypot(places[-1][0] - places[0][0], places[-1][1] - places[0][1])
        found = SHAPES[description.classify(look_at(faces), circle, noise, chord, x, y, inf)]
        try:
            assert found == descriptions.shape(places, faces, noise)
        except Ambiguous:
            continue
        seen.add(found)
    assert {"round", "prismatic"} <= seen


def test_columns_have_the_names_of_a_detection() -> None:
    assert list(COLUMNS) == [field.name for field in fields(Detection)]
    found = detect(random_batches()[0], Parameters(), per_beam=True, explain=True)
    there = [name for name in COLUMNS if getattr(found, name) is not None]
    assert {*there} >= {*REQUIRED, "beam_set", "beam_object", "beam_s", "features"}
    for name in there:
        assert getattr(found, name).dtype == COLUMNS[name].dtype, name


def test_room_is_zero_at_first_and_rounds_where_it_is_single() -> None:
    owner: list[object] = []
    assert list(native.doubles(owner, 3)) == [0.0, 0.0, 0.0]
    assert list(native.integers(owner, 2)) == [0, 0]
    singles = native.singles(owner, 1)
    singles[0] = 0.1
    assert singles[0] == float(np.float32(0.1))
    values = np.arange(4.0)
    native.at_doubles(values)[2] = 7.0
    assert values.tolist() == [0.0, 1.0, 7.0, 3.0]


def test_checked_room_has_no_negative_indices() -> None:
    checked = native._Checked([1, 2])
    checked[1] = 5
    assert checked[1] == 5
    for index in (-1, 2):
        with pytest.raises(IndexError):
            checked[index]
        with pytest.raises(IndexError):
            checked[index] = 0
