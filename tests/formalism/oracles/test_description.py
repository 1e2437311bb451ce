"""The objects of every sweep, their parts, vertices, boxes and shapes against their references."""

from __future__ import annotations

from functools import cache
from math import cos, dist, hypot, inf, pi, sin
from typing import Any, NamedTuple

import numpy as np
import pytest

from lidarcli.formalism import SETS, SHAPES, VISIBILITIES, Detection, circle_fit
from tests.formalism.oracles import descriptions, surfaces
from tests.formalism.oracles.recording import ROBUST, Recorded, Segment, State, recordings
from tests.formalism.oracles.surfaces import Ambiguous, Face, Place
from tests.formalism.oracles.test_surfaces import places_of, plain_faces, tolerance_of
from tests.formalism.oracles.test_sweep import EDGES, circle_of

NOISY = 0.02
"""[m] With more noise than this the four steps from the algebraic circle may end short of the best one."""


class Thing(NamedTuple):
    """An object or a wall: its segments in order."""

    members: list[int]
    is_wall: bool
    theta: list[float]
    """Bearings of its points, part by part."""


def bearings_of(one: Recorded, state: State, segment: Segment) -> list[float]:
    """Of the points of a segment, growing past the seam."""
    circle = circle_of(one)
    theta = [circle.bearings[state.points.position[k]] for k in range(segment.first, segment.last + 1)]
    return [value + 2 * pi if value < theta[0] else value for value in theta]


@cache
def things(one: Recorded) -> list[Thing]:
    """What is to be reported, in its order: objects, then walls, each by their first bearing."""
    state = one.after["core._settle"]
    groups: dict[tuple[bool, int], list[int]] = {}
    for j in range(len(state.segments)):
        if state.survey.is_object[j]:
            groups.setdefault((False, state.survey.label[j]), []).append(j)
        elif state.survey.wall[j]:
            groups[True, j] = [j]
    found = []
    for (is_wall, _), members in groups.items():
        theta = {j: bearings_of(one, state, state.segments[j]) for j in members}
        spans = [(theta[j][0], theta[j][-1]) for j in members]
        ordered = [members[k] for k in descriptions.in_order(spans, state.points.period > 0)]
        grown: list[float] = []
        for j in ordered:
            past = 2 * pi if grown and theta[j][0] < grown[-1] else 0.0
            grown += [value + past for value in theta[j]]
        found.append(Thing(ordered, is_wall, grown))
    return sorted(found, key=lambda thing: (thing.is_wall, thing.theta[0]))


def columns(found: Detection, names: str, k: int) -> list[Any]:
    """Some numbers of an object."""
    return [getattr(found, name)[k] for name in names.split()]


def lies_past_the_seam(one: Recorded) -> bool:
    """Whether a part of a segment that was divided lies wholly past the seam, where θ_i should be in the turn again."""
    state = one.after["core._settle"]
    return any(segment.first >= state.points.count for segment in state.segments)


@cache
def all_things() -> list[tuple[Recorded, State, int, Thing]]:
    """Of every sweep every object with its number in the detection."""
    return [
        (one, one.after["core._settle"], k, thing)
        for one in recordings()
        if not lies_past_the_seam(one)
        for k, thing in enumerate(things(one))
    ]


def joined(state: State, thing: Thing) -> list[Place]:
    """All its points."""
    return [place for j in thing.members for place in places_of(state, state.segments[j])]


def faces_of(state: State, thing: Thing) -> list[Face]:
    """All its faces."""
    return [face for j in thing.members for face in plain_faces(state, j)]


def test_every_object_is_reported_in_order_and_numbered() -> None:
    several = 0
    for one in recordings():
        if lies_past_the_seam(one):
            continue
        expected = things(one)
        assert one.found is not None
        assert len(one.found) == len(expected)
        assert one.found.object.tolist() == list(range(1, len(expected) + 1))
        assert [SETS[code] for code in one.found.set] == ["S" if thing.is_wall else "O" for thing in expected]
        assert one.found.objects[0] == sum(not thing.is_wall for thing in expected)
        state = one.after["objects.assemble"]
        begin = state.parts.begin
        parts = [state.parts.segment[begin[k] : begin[k + 1]] for k in range(state.parts.objects)]
        assert parts == [thing.members for thing in expected]
        several += sum(len(thing.members) > 1 for thing in expected)
    assert several > 50


@pytest.mark.xfail(strict=True, reason="θ_i of what lies wholly past the seam is a turn too large")
def test_what_was_cut_past_the_seam_begins_within_the_turn() -> None:
    for one in recordings():
        assert one.found is not None
        circle = circle_of(one)
        assert not len(one.found) or max(one.found.theta_i) <= max(circle.bearings) + 1e-9


def test_what_the_points_of_an_object_say() -> None:
    seen = set()
    for one, state, k, thing in all_things():
        found = one.found
        assert found is not None
        first, last = state.segments[thing.members[0]], state.segments[thing.members[-1]]
        circle = circle_of(one)
        position = state.points.position
        at = [position[p] for j in thing.members for p in range(state.segments[j].first, state.segments[j].last + 1)]
        beams = [circle.beams[n].number for n in at]
        ends = [beams[0], beams[-1]]
        assert columns(found, "beam_i beam_f", k) == (ends[::-1] if one.batch.angle_increment[0] < 0 else ends)
        assert found.beams[k] == len(beams)
        assert found.beam_object is not None
        expected = 0 if thing.is_wall else k + 1
        assert set(found.beam_object[0][beams].tolist()) == {expected}
        r = [circle.beams[n].r for n in at]
        nearest = r.index(min(r))
        places = joined(state, thing)
        exact = columns(found, "r_i r_f r_min s_i s_f", k)
        np.testing.assert_array_equal(exact, [r[0], r[-1], min(r), first.s_start, last.s_end])
        close = columns(found, "theta_i theta_f x y width", k)
        middle = np.mean(places, axis=0).tolist()
        assert close == pytest.approx([thing.theta[0], thing.theta[-1], *middle, dist(places[0], places[-1])], abs=1e-9)
        assert r.count(min(r)) > 1 or found.theta_min[k] == pytest.approx(thing.theta[nearest], abs=1e-9)
        visible = descriptions.visibility((EDGES[first.start_edge], EDGES[last.end_edge]))
        assert VISIBILITIES[found.visibility[k]] == visible
        seen.add(visible)
    assert seen == set(VISIBILITIES)


def expected_outline(one: Recorded, state: State, thing: Thing) -> tuple[list[Place], list[Place], list[float]]:
    """Vertices as they are reported, as the box has them, and lengths of the faces."""
    reported, drawn, lengths = [], [], []
    for j in thing.members:
        segment = state.segments[j]
        ends = tuple(EDGES[edge] in ("own", "open") for edge in (segment.start_edge, segment.end_edge))
        part = descriptions.outline(
            places_of(state, segment),
            plain_faces(state, j),
            tolerance_of(state),
            (ends[0], ends[1]),
            abs(float(one.batch.angle_increment[0])),
        )
        for all_of_them, some in zip((reported, drawn, lengths), part, strict=True):
            all_of_them += some  # type: ignore[operator]
    return reported, drawn, lengths


def test_vertices_where_lines_meet_and_edges_half_a_beam_further() -> None:
    moved, longer = 0, 0
    for one, state, k, thing in all_things():
        found = one.found
        assert found is not None
        reported, _, lengths = expected_outline(one, state, thing)
        vertices = slice(found.vertex_offsets[k], found.vertex_offsets[k + 1])
        theta, r = found.vertex_theta[vertices], found.vertex_r[vertices]
        places = list(zip(r * np.cos(theta), r * np.sin(theta), strict=True))
        assert len(places) == len(reported)
        np.testing.assert_allclose(places, reported, rtol=0, atol=1e-8)
        assert (theta[0], theta[-1]) == pytest.approx((thing.theta[0], thing.theta[-1]), abs=1e-9)
        faces = slice(found.face_offsets[k], found.face_offsets[k + 1])
        np.testing.assert_allclose(found.face_length[faces], lengths, rtol=0, atol=1e-8)
        rms = [face.rms for face in faces_of(state, thing)]
        np.testing.assert_array_equal(found.face_rms[faces], rms)
        points = set(joined(state, thing))
        moved += sum(min(dist(place, point) for point in points) > 1e-6 for place in reported[1:-1])
        longer += len(lengths) == 1 and lengths[0] > found.width[k] + 1e-6
    assert moved > 100
    assert longer > 100


def described(state: State, thing: Thing) -> tuple[list[Place], list[Face]]:
    """The points and faces that shape and box are told by."""
    places, faces = joined(state, thing), faces_of(state, thing)
    return descriptions.without_stray(places, faces) if len(thing.members) == 1 else (places, faces)


def shape_of(found: Detection, k: int) -> str:
    """By name."""
    return SHAPES[found.shape[k]]


def test_shapes_by_their_information() -> None:
    names: dict[str, int] = {}
    ambiguous, short = 0, 0
    for one, state, k, thing in all_things():
        assert one.found is not None
        bodies = {state.bodies.label[j] for j in thing.members}
        if thing.is_wall or len(bodies) > 1:
            assert shape_of(one.found, k) == ("wall" if thing.is_wall else "legged")
            continue
        try:
            whole = joined(state, thing)
            places, faces = described(state, thing)
            expected = descriptions.shape(places, faces, state.points.sigma, max_width=ROBUST.max_width, whole=whole)
        except Ambiguous:
            ambiguous += 1
            continue
        if state.points.sigma > NOISY and shape_of(one.found, k) != expected:
            short += 1
            continue
        assert shape_of(one.found, k) == expected
        names[expected] = names.get(expected, 0) + 1
    assert min(names[name] for name in ("prismatic", "round", "irregular", "unknown")) > 50
    assert ambiguous < 0.02 * sum(names.values())
    assert short < 0.005 * sum(names.values())


def test_boxes_hold_what_they_are_drawn_around() -> None:
    ambiguous, drawn_around, square = 0, 0, 0
    for one, state, k, thing in all_things():
        found = one.found
        assert found is not None
        centre, yaw = (found.box_x[k], found.box_y[k]), found.box_yaw[k]
        length, width = found.box_length[k], found.box_width[k]
        assert length >= width >= 0
        assert -pi / 2 < yaw <= pi / 2
        shape = shape_of(found, k)
        if shape in ("wall", "legged"):
            # Their own shape is not told.
            continue
        places, faces = described(state, thing)
        is_stray = len(places) < len(joined(state, thing))
        if shape == "round":
            assert length == width
            assert abs(cos(yaw) * centre[1] - sin(yaw) * centre[0]) < 1e-9 * hypot(*centre)
            square += 1
            continue
        if shape == "prismatic" and len(thing.members) == 1 and not is_stray:
            places = expected_outline(one, state, thing)[1]
            drawn_around += 1
        # Seen in its own frame every place is within half of its sides.
        away = np.abs((np.array(places) - centre) @ np.array([[cos(yaw), -sin(yaw)], [sin(yaw), cos(yaw)]]))
        assert (away <= np.array([length, width]) / 2 + 1e-8).all()
        try:
            wanted, wanted_length, wanted_width, wanted_yaw = descriptions.box(places, faces)
        except Ambiguous:
            ambiguous += 1
            continue
        assert centre == pytest.approx(wanted, abs=1e-8)
        assert (length, width) == pytest.approx((wanted_length, wanted_width), abs=1e-8)
        if length - width > 1e-6:
            assert cos(2 * yaw - 2 * wanted_yaw) == pytest.approx(1, abs=1e-9)
    assert drawn_around > 200
    assert square > 50
    assert ambiguous < 50


def test_no_other_circle_fits_a_round_object_better() -> None:
    found_round = 0
    for one, state, k, thing in all_things():
        found = one.found
        assert found is not None
        if shape_of(found, k) != "round":
            continue
        places, _ = described(state, thing)
        centre, radius = (found.box_x[k], found.box_y[k]), found.box_length[k] / 2
        rms = descriptions.circle_rms(places, centre, radius)
        best = descriptions.best_circle(places)[2]
        assert best - 1e-9 <= rms <= (1.1 if state.points.sigma > NOISY else 1.01) * best + 1e-6
        found_round += 1
    assert found_round > 50


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.02])
def test_circles_through_noisy_arcs(noise: float) -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        count = int(rng.integers(5, 40))
        radius, centre = rng.uniform(0.05, 1.0), rng.uniform(-5, 5, 2)
        angles = rng.uniform(0, 2 * pi) + np.sort(rng.uniform(0, rng.uniform(1.5, 3.0), count))
        r = radius + noise * radius * rng.standard_normal(count)
        places = [(float(x), float(y)) for x, y in centre + np.stack([r * np.cos(angles), r * np.sin(angles)], 1)]
        circle = circle_fit.Circle(count)
        circle.n = count
        for k, place in enumerate(places):
            circle.x[k], circle.y[k] = place
        circle_fit.fit_circle(circle, inf)
        rms = descriptions.circle_rms(places, (circle.centre_x, circle.centre_y), circle.radius)
        assert circle.rms == pytest.approx(rms, abs=1e-12)
        assert rms <= 1.01 * descriptions.best_circle(places)[2] + 1e-6


def test_what_is_too_wide_or_too_small_is_no_object() -> None:
    for _one, state, _, thing in all_things():
        if thing.is_wall:
            continue
        for j in thing.members:
            reach = surfaces.farthest_vertex(places_of(state, state.segments[j]), [])
            assert reach <= ROBUST.max_width
