"""What is known of bodies, and what is decided on it, against plain references."""

from __future__ import annotations

from math import exp, log

import numpy as np
import pytest

from lidarcli.formalism import features, forest
from tests.formalism.oracles.recording import ROBUST, State, recordings
from tests.formalism.oracles.test_sweep import EDGES


def bodies_of(state: State) -> list[tuple[int, list[int]]]:
    """Every body with its segments."""
    count = len(state.segments)
    return [(k, [j for j in range(count) if state.features.body[j] == k]) for k in range(state.features.count)]


def ends_of(state: State, k: int) -> tuple[int, int]:
    """The first and the last segment of a body."""
    begin, end = state.features.start[k], state.features.start[k + 1]
    return state.features.member[begin], state.features.member[end - 1]


def value(state: State, k: int, name: str) -> float:
    """A feature of a body."""
    return float(state.features.values[k * features.COUNT + features.NAMES.index(name)])


def test_bodies_are_what_may_be_a_thing() -> None:
    found = 0
    for one in recordings():
        state = one.after["features.measure"]
        for j in range(len(state.segments)):
            may = state.survey.candidate[j] and state.bodies.size[j] >= ROBUST.min_beams
            may = may and state.bodies.extent[j] <= ROBUST.max_width
            assert (state.features.body[j] >= 0) == bool(may)
        for k, members in bodies_of(state):
            assert len(members) == state.bodies.parts[members[0]]
            begin, end = state.features.start[k], state.features.start[k + 1]
            assert sorted(state.features.member[begin:end]) == members
            found += 1
    assert found > 1500


def test_edges_tell_how_much_further_the_neighbours_are() -> None:
    for one in recordings():
        state = one.after["features.measure"]
        for k, _ in bodies_of(state):
            head, tail = (state.segments[j] for j in ends_of(state, k))
            edges = [EDGES[head.start_edge], EDGES[tail.end_edge]]
            jumps = []
            for edge, step in zip(edges, [-head.s_start, tail.s_end], strict=True):
                known = edge in ("own", "hidden")
                jumps.append(min(max(step, -2.0), 3.0) if known else 3.0)
            if not any(np.isnan(jumps)):
                assert value(state, k, "jump_least") == pytest.approx(min(jumps))
                assert value(state, k, "jump_most") == pytest.approx(max(jumps))
            assert value(state, k, "hidden") == edges.count("hidden")
            assert value(state, k, "view") == edges.count("view")
            unseen = sum(edge in ("open", "unknown", "flickering") for edge in edges)
            assert value(state, k, "open") == unseen


def test_how_far_points_leave_the_chord() -> None:
    for one in recordings()[::5]:
        state = one.after["features.measure"]
        for k, members in bodies_of(state):
            if len(members) > 1:
                continue
            segment = state.segments[members[0]]
            places = np.array([(state.points.x[p], state.points.y[p]) for p in range(segment.first, segment.last + 1)])
            chord = places[-1] - places[0]
            width = float(np.hypot(*chord))
            assert value(state, k, "width") == pytest.approx(width)
            if width < 1e-6:
                continue
            normal = np.array([chord[1], -chord[0]]) / width
            if normal @ places[0] > 0:
                normal = -normal
            off = (places - places[0]) @ normal
            assert value(state, k, "bulge_to") == pytest.approx(max(off.max(), 0.0), abs=1e-9)
            assert value(state, k, "bulge_away") == pytest.approx(max(-off.min(), 0.0), abs=1e-9)
            rough = np.abs(np.diff(off, 2)).mean() if len(off) > 2 else 0.0
            assert value(state, k, "roughness") == pytest.approx(rough, abs=1e-9)


def test_the_direction_of_a_building_is_that_of_most_faces() -> None:
    close = 0
    for one in recordings():
        state = one.after["features.measure"]
        long = [
            face
            for face in state.faces
            if face.length >= features.DIRECTION_LENGTH and face.points >= features.DIRECTION_POINTS
        ]
        if not state.features.count or not long:
            continue
        turn = 4.0 * np.array([np.arctan2(face.direction_y, face.direction_x) for face in long])
        weight = np.array([face.length for face in long])
        mine = 4.0 * np.arctan2(state.features.sin, state.features.cos)
        off = np.abs((turn - mine + np.pi) % (2 * np.pi) - np.pi) / 4.0
        near = weight[off <= np.radians(6.0)].sum()
        # No other whole degree has more length within a degree of it.
        most = max(
            weight[np.abs((turn - 4.0 * np.radians(d) + np.pi) % (2 * np.pi) - np.pi) / 4.0 <= np.radians(1.0)].sum()
            for d in range(90)
        )
        assert near >= 0.5 * most
        close += 1
    assert close > 200


def test_support_is_the_length_of_others_on_the_same_line() -> None:
    some = 0
    for one in recordings()[::3]:
        state = one.after["features.measure"]
        known = state.features
        allowed = features.FACE_PLANE + features.FACE_PLANE_NOISE * state.points.sigma
        for k, members in bodies_of(state):
            mine = [f for f, face in enumerate(state.faces) if face.segment in members]
            longest = max((state.faces[f].length for f in mine), default=0.0)
            mine = [f for f in mine if known.aligned[f] and state.faces[f].length >= 0.5 * longest]
            if not mine:
                continue
            best, near = 0.0, 0.0
            for f in mine:
                everywhere, beside = 0.0, 0.0
                for g, face in enumerate(state.faces):
                    if face.segment in members or not known.aligned[g] or known.axis[g] != known.axis[f]:
                        continue
                    if face.points < features.FACE_POINTS or face.length <= features.FACE_LENGTH:
                        continue
                    if abs(known.offset[g] - known.offset[f]) > allowed:
                        continue
                    everywhere += face.length
                    apart = max(known.low[g] - known.high[f], known.low[f] - known.high[g])
                    beside += face.length if apart < features.LINE_NEAR else 0.0
                best, near = max(best, everywhere), max(near, beside)
            assert value(state, k, "support") == pytest.approx(log(1 + best / 0.3), abs=1e-9)
            assert value(state, k, "support_near") == pytest.approx(log(1 + near / 0.3), abs=1e-9)
            some += best > 0
    assert some > 50


def test_shares_of_lines_are_shares_and_walls_behind_are_behind() -> None:
    behind = 0
    for one in recordings():
        state = one.after["features.measure"]
        for k, _ in bodies_of(state):
            for name in ("line", "line_behind", "line_before", "cross_line"):
                assert -1e-6 <= value(state, k, name) <= 1.0
            depth = value(state, k, "depth_behind")
            assert depth == 0.0 or 0.05 < depth < 0.31
            assert value(state, k, "unbroken") <= ROBUST.max_width + 2 * features.LINE_REACH + 0.1
            assert 0.0 <= value(state, k, "grazing") <= 1.0 + 1e-9
            behind += depth > 0.0
    assert behind > 100


def by_trees(trees: forest.Trees, prior: float, values: list[float]) -> float:
    """Log-odds by walking every tree."""
    total = prior
    for questions, leaves in trees:
        n = 0
        while n < len(questions):
            feature, bound, _ = questions[n]
            n = 2 * n + (2 if values[feature] > bound else 1)
        total += leaves[n - len(questions)]
    return total


def test_trees_decide() -> None:
    seen = 0
    for one in recordings()[::4]:
        state = one.after["features.decide"]
        for k, _ in bodies_of(state):
            values = state.features.values[k * features.COUNT : (k + 1) * features.COUNT]
            odds = by_trees(forest.TREES, forest.PRIOR, values)
            assert state.verdict.thing[k] == pytest.approx(1.0 / (1.0 + exp(-odds)), abs=1e-9)
            seen += 1
    assert seen > 300


def test_what_is_likely_enough_is_an_object_and_the_rest_is_wall() -> None:
    kinds = {True: 0, False: 0}
    for one in recordings():
        state = one.after["features.choose"]
        for j, segment in enumerate(state.segments):
            k = state.features.body[j]
            thing = k >= 0 and state.verdict.thing[k] >= ROBUST.min_thing
            assert bool(state.survey.is_object[j]) == thing
            if k >= 0:
                kinds[bool(thing)] += 1
                assert state.survey.thing[j] == state.verdict.thing[k]
                if segment.size >= ROBUST.min_beams:
                    assert bool(state.survey.wall[j]) != thing
    assert min(kinds.values()) > 200
