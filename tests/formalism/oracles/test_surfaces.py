"""Faces, what touches walls, walls, torn things, legs and objects of every sweep against their references."""

from __future__ import annotations

from math import dist

import numpy as np
import pytest

from lidarcli.formalism.surfaces import Faces, meeting, turn
from tests.formalism.oracles import surfaces
from tests.formalism.oracles.recording import ROBUST, Recorded, Segment, State, recordings
from tests.formalism.oracles.recording import Face as CoreFace
from tests.formalism.oracles.surfaces import Ambiguous, Place
from tests.formalism.oracles.test_sweep import EDGES


def places_of(state: State, segment: Segment) -> list[Place]:
    """Where the points of a segment are."""
    at = range(segment.first, segment.last + 1)
    return [(state.points.x[k], state.points.y[k]) for k in at]


def tolerance_of(state: State) -> float:
    """2 cm + 3σ."""
    return 0.02 + 3 * float(state.points.sigma)


def plain_faces(state: State, j: int) -> list[surfaces.Face]:
    """The faces the core has, counted from the first point of their segment."""
    first = state.segments[j].first
    return [
        surfaces.Face(
            face.first - first,
            face.last - first,
            face.points,
            (face.middle_x, face.middle_y),
            (face.direction_x, face.direction_y),
            face.rms,
            face.length,
            True,
        )
        for face in state.faces_of(j)
    ]


def assert_same_faces(found: list[CoreFace], expected: list[surfaces.Face], first: int, kept: list[int]) -> None:
    """The same stretches, and lines."""
    ends = [(first + kept[one.first], first + kept[one.last]) for one in expected]
    assert [(one.first, one.last) for one in found] == ends
    for one, other in zip(found, expected, strict=True):
        assert one.points == other.points
        assert (one.middle_x, one.middle_y) == pytest.approx(other.middle, abs=1e-9)
        assert one.rms**2 == pytest.approx(other.rms**2, abs=1e-12)
        if other.is_sure:
            assert (one.direction_x, one.direction_y) == pytest.approx(other.direction, abs=1e-6)
            assert one.length == pytest.approx(other.length, abs=1e-6)


def thinned(state: State, segment: Segment) -> tuple[list[Place], list[int]]:
    """Of what is too wide for an object every fourth point, but 32 where there are as many, and which they are."""
    places, kept = places_of(state, segment), list(range(segment.size))
    if surfaces.length(places) > ROBUST.max_width:
        most = max(-(-segment.size // 4), min(segment.size, 32))
        last = segment.size - 1
        if most <= last:
            most += most % 2 == 1 and last % 2 == 1
            half = [i * last // (most - 1) for i in range((most + 1) // 2)]
            kept = sorted({*half, *(last - k for k in half)})
            places = [places[k] for k in kept]
    elif segment.size < ROBUST.min_beams:
        places = places[:1]
    return places, kept


def test_faces_by_splitting_at_the_farthest_point() -> None:
    sure, ambiguous, split = 0, 0, 0
    for one in recordings():
        state = one.after["surfaces.find_faces"]
        for j, segment in enumerate(state.segments):
            places, kept = thinned(state, segment)
            try:
                vertices = surfaces.split(places, tolerance_of(state))
            except Ambiguous:
                ambiguous += 1
                continue
            expected = surfaces.faces_between(places, vertices)
            assert_same_faces(state.faces_of(j), expected, segment.first, kept)
            sure, split = sure + 1, split + len(vertices)
    assert ambiguous < 0.02 * sure
    assert split > 500


def test_settled_faces_have_one_vertex_for_each_corner() -> None:
    sure, ambiguous, dropped = 0, 0, 0
    for one in recordings():
        state = one.after["core._settle"]
        for j, segment in enumerate(state.segments):
            if not (state.survey.is_object[j] or state.survey.wall[j]):
                assert state.faces_of(j) == []
                continue
            places = places_of(state, segment)
            try:
                vertices = surfaces.split(places, tolerance_of(state))
                flat = surfaces.without_flat(places, vertices, tolerance_of(state))
                settled = surfaces.without_doubled(places, flat)
            except Ambiguous:
                ambiguous += 1
                continue
            expected = surfaces.faces_between(places, settled)
            assert_same_faces(state.faces_of(j), expected, segment.first, list(range(segment.size)))
            sure, dropped = sure + 1, dropped + len(vertices) - len(settled)
    # Sweeps that count in coarse steps have many points equally far from a chord.
    assert ambiguous < 0.04 * sure
    assert dropped > 50


def test_no_point_is_farther_from_its_chord_than_the_tolerance() -> None:
    for one in recordings():
        state = one.after["surfaces.find_faces"]
        for j, segment in enumerate(state.segments):
            if segment.size < ROBUST.min_beams or state.survey.chord[j] > ROBUST.max_width:
                continue
            places = places_of(state, segment)
            for face in plain_faces(state, j):
                a, b = places[face.first], places[face.last]
                for place in places[face.first + 1 : face.last]:
                    off = min(dist(place, a), surfaces.chord_distance(a, place, b) if a != b else np.inf)
                    assert off <= tolerance_of(state) + 1e-9


def test_where_the_lines_of_two_faces_meet() -> None:
    rng = np.random.default_rng(1)
    met = 0
    for _ in range(300):
        faces = Faces(8)
        corner = rng.uniform(-5, 5, 2)
        angles = rng.uniform(0, 2 * np.pi, 2)
        plain = []
        for f, angle in enumerate(angles):
            direction = np.array([np.cos(angle), np.sin(angle)])
            middle = corner + rng.uniform(-3, 3) * direction
            faces.middle_x[f], faces.middle_y[f] = middle
            faces.direction_x[f], faces.direction_y[f] = direction
            plain.append(surfaces.Face(0, 0, 2, tuple(middle), tuple(direction), 0.0, 1.0, True))
        usable, x, y = meeting(faces, 0, 1)
        expected = surfaces.meeting(*plain)
        assert usable == (expected is not None)
        assert turn(faces, 0, 1) == pytest.approx(surfaces.turn(*plain), abs=1e-12)
        if expected is not None:
            assert (x, y) == pytest.approx(expected, abs=1e-9)
            assert (x, y) == pytest.approx(tuple(corner), abs=1e-9)
            met += 1
    assert met > 200


def past_edges(state: State, j: int) -> tuple[Place, Place]:
    """The last point of the segment before and the first of the one after."""
    count, turn = len(state.segments), state.points.period > 0
    before = (j - 1) % count if turn or j > 0 else j
    after = (j + 1) % count if turn or j + 1 < count else j
    last, first = state.segments[before].last, state.segments[after].first
    points = state.points
    return (points.x[last], points.y[last]), (points.x[first], points.y[first])


def expected_protrusions(state: State) -> list[tuple[int, int, int]]:
    """All of a sweep, from the faces the core has."""
    found = []
    for j, segment in enumerate(state.segments):
        if segment.size < ROBUST.min_beams:
            continue
        own = (EDGES[segment.start_edge] == "own", EDGES[segment.end_edge] == "own")
        stretches = surfaces.protrusions(
            places_of(state, segment), plain_faces(state, j), own, past_edges(state, j), state.points.sigma
        )
        found += [(j, segment.first + first, segment.first + last) for first, last in stretches]
    return found


def test_things_that_touch_a_wall() -> None:
    found = 0
    for one in recordings():
        state = one.after["objects.find_protrusions"]
        assert state.protrusions == expected_protrusions(state)
        found += len(state.protrusions)
    assert found > 40


def test_segments_are_divided_at_what_touches_a_wall() -> None:
    for one in recordings():
        before, state = one.after["objects.find_protrusions"], one.after["objects.divide"]
        things = {(first, last) for _, first, last in before.protrusions}
        parts = {(part.first, part.last): j for j, part in enumerate(state.segments)}
        assert things == {span for span, j in parts.items() if things and state.survey.protrusion[j]}
        # Every point stays in one part, in order, and outer edges are what they were.
        points = [k for part in state.segments for k in range(part.first, part.last + 1)]
        assert points == [k for whole in before.segments for k in range(whole.first, whole.last + 1)]
        for whole in before.segments:
            inner = [p for p in state.segments if whole.first <= p.first and p.last <= whole.last]
            assert inner[0].start_edge == whole.start_edge
            assert inner[-1].end_edge == whole.end_edge
            for part in inner:
                edge = "own" if (part.first, part.last) in things else "hidden"
                assert part == inner[0] or EDGES[part.start_edge] == edge
                assert part == inner[-1] or EDGES[part.end_edge] == edge
        # A face belongs to the part that holds more of its points.
        for face in state.faces:
            held = [
                len(set(range(face.first, face.last + 1)) & set(range(part.first, part.last + 1)))
                for part in state.segments
            ]
            assert held[face.segment] == max(held) or len(things) > 1


def seen_of(one: Recorded, step: str) -> list[surfaces.Seen]:
    """What the core knows of the segments, for the references of what follows."""
    state = one.after[step]
    return [
        surfaces.Seen(
            size=segment.size,
            chord=state.survey.chord[j],
            reach=state.survey.extent[j],
            edges=(EDGES[segment.start_edge], EDGES[segment.end_edge]),
            is_protrusion=bool(state.survey.protrusion[j]),
            faces=plain_faces(state, j),
        )
        for j, segment in enumerate(state.segments)
    ]


def test_how_far_segments_reach() -> None:
    for one in recordings():
        state = one.after["surfaces.measure_extent"]
        for j, segment in enumerate(state.segments):
            faces = plain_faces(state, j)
            if len(one.after["objects.find_protrusions"].segments) != len(state.segments):
                # Where a thing was cut out a face may belong to both.
                continue
            inner = [face.last for face in faces[:-1]]
            expected = surfaces.farthest_vertex(places_of(state, segment), inner)
            assert state.survey.extent[j] == pytest.approx(expected, abs=1e-9)


def test_walls_by_their_extent() -> None:
    found = 0
    for one in recordings():
        state, seen = one.after["objects.pieces"], seen_of(one, "objects.pieces")
        wide = surfaces.too_wide(seen, ROBUST.min_beams, ROBUST.max_width)
        assert [bool(wall) for wall in state.survey.wall[: len(seen)]] == wide
        found += sum(wide)
    assert found > 100


def test_torn_things_are_one_body() -> None:
    joined = 0
    for one in recordings():
        before, state = one.after["objects.pieces"], one.after["objects.join_fragments"]
        seen = seen_of(one, "objects.pieces")
        places = [places_of(state, segment) for segment in state.segments]
        may = [bool(loose) for loose in before.survey.loose[: len(seen)]]
        lost = [state.points.missing[(segment.last + 1) % state.points.count] for segment in state.segments]
        expected = surfaces.bodies(seen, places, lost, may, state.points.period > 0)
        for body in expected:
            for j in body.members:
                assert state.bodies.label[j] == min(body.members)
                assert state.bodies.parts[j] == len(body.members)
                assert state.bodies.size[j] == body.size
                assert state.bodies.extent[j] == pytest.approx(body.reach, abs=1e-9)
                assert (EDGES[state.bodies.start_edge[j]], EDGES[state.bodies.end_edge[j]]) == body.edges
            joined += len(body.members) > 1
    assert joined > 20


def test_what_may_be_an_object_is_no_wall() -> None:
    for one in recordings():
        state, seen = one.after["objects.pieces"], seen_of(one, "objects.pieces")
        for j, segment in enumerate(state.segments):
            around = len(seen) == 1 and seen[j].edges == ("hidden", "hidden") and np.isnan(segment.s_start)
            expected = not state.survey.wall[j] and not around
            expected &= seen[j].chord <= ROBUST.max_width
            assert bool(state.survey.candidate[j]) == expected
            assert bool(state.survey.loose[j]) == (expected and not seen[j].is_protrusion)


def test_legs_are_joined_through_others_whatever_their_order() -> None:
    grouped = 0
    for one in recordings():
        before, state = one.after["verdict.choose"], one.after["objects.group_legs"]
        seen = seen_of(one, "verdict.choose")
        places = [places_of(state, segment) for segment in state.segments]
        is_leg = [bool(before.survey.is_object[j]) and seen[j].chord <= 0.2 for j in range(len(seen))]
        body = before.bodies.label
        near: dict[tuple[int, int], bool] = {}

        def linked(
            a: int,
            b: int,
            near: dict[tuple[int, int], bool] = near,
            body: list[int] = body,
            is_leg: list[bool] = is_leg,
            places: list[list[Place]] = places,
        ) -> bool:
            if (a, b) not in near:
                near[a, b] = body[a] == body[b] or (
                    is_leg[a] and is_leg[b] and surfaces.gap_between(places[a], places[b]) <= ROBUST.group_gap
                )
            return near[a, b]

        for group in surfaces.flood(len(seen), linked):
            assert {state.survey.label[j] for j in group} == {min(group)}
            grouped += len({body[j] for j in group}) > 2
    # Joined through others, that is.
    assert grouped > 10
