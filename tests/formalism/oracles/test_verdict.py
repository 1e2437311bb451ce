"""What is known of bodies, and what is decided on it, against plain references."""

from __future__ import annotations

from math import exp, log
from typing import Any

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


def share(off: Any, allowed: float) -> Any:
    """How much of what is so far off counts, by the distance that is allowed."""
    return np.clip(1.5 - np.abs(off) / allowed, 0.0, 1.0)


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
                assert value(state, k, "jump") == pytest.approx(min(jumps))


def test_the_outline_of_a_body() -> None:
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
            assert value(state, k, "range") == pytest.approx(np.hypot(*(places[0] + places[-1]) / 2))
            if width < 1e-6:
                continue
            normal = np.array([chord[1], -chord[0]]) / width
            # A chord through the sensor has no far side.
            normal *= np.sign(normal @ places[0]) * (abs(normal @ places[0]) >= features.SHORTEST)
            assert value(state, k, "bulge_away") == pytest.approx(max(((places - places[0]) @ normal).max(), 0.0), abs=1e-9)
            steps = np.sqrt(len(places) * np.square(np.diff(places, axis=0)).sum())
            assert value(state, k, "arc") == pytest.approx(min(steps / max(width, 0.01), 5.0))


def test_what_is_past_the_ends_of_a_body() -> None:
    some = 0
    for one in recordings()[::3]:
        state = one.after["features.measure"]
        points, count = state.points, state.points.count
        # The range at each position of the sweep.
        ranges = np.full(points.bearings, np.nan)
        ranges[[points.position[p] for p in range(count)]] = [points.r[p] for p in range(count)]
        for k, _ in bodies_of(state):
            ends = [(state.features.first[k], -1), (state.features.last[k], 1)]

            def depth(end: tuple[int, int], beams: int, r: Any = ranges, seen: Any = points) -> float:
                at = seen.position[end[0]] + end[1] * beams
                if not seen.period and not 0 <= at < seen.bearings:
                    return features.OUTSIDE
                away = r[at % seen.bearings] - seen.r[end[0]]
                return 5.0 if np.isnan(away) else float(np.clip(away, -3.0, 5.0))

            for name, degrees in (("beside", 1), ("around", 4)):
                beams = max(int(np.radians(degrees) / points.step + 0.5), 1)
                depths = [depth(end, beams) for end in ends]
                # Ranges are laid out in double precision, and read in single.
                assert value(state, k, name) == pytest.approx(min(depths), abs=1e-5)
            beams = max(int(np.radians(20) / points.step + 0.5), 1)
            looks = [depth(end, i) for i in range(1, beams + 1, max(beams // 5, 1)) for end in ends]
            seen = [each for each in looks if each > features.OUTSIDE]
            deeper = float(np.mean([1.0 - share(max(each, 0.0), 0.4) for each in seen])) if seen else 0.0
            assert value(state, k, "deeper") == pytest.approx(deeper, abs=1e-5)
            some += 1
    assert some > 300


def test_other_bodies_and_walls_around() -> None:
    for one in recordings()[::3]:
        state = one.after["features.measure"]
        known, count = state.features, state.features.count
        middles = np.array([(known.x[k], known.y[k]) for k in range(count)]).reshape(-1, 2)
        for k, members in bodies_of(state):
            away = np.hypot(*(middles - middles[k]).T)
            assert value(state, k, "bodies") == pytest.approx(share(away, 3.0).sum())
            slim = [away[i] for i in range(count) if i != k and value(state, i, "width") < 0.3]
            assert value(state, k, "slim") == pytest.approx(min([2.0, *slim]))
            walls = [(3.0, 3.0)]
            for face in state.faces:
                if face.length < 1.0 or face.segment in members:
                    continue
                off = middles[k] - (face.middle_x, face.middle_y)
                normal = np.array((face.direction_y, -face.direction_x))
                # Before a wall is where the sensor is.
                before = float(off @ normal) * (-1.0 if normal @ (face.middle_x, face.middle_y) > 0.0 else 1.0)
                past = max(abs(off @ (face.direction_x, face.direction_y)) - face.length / 2, 0.0)
                walls.append((round(float(np.hypot(before, past)), 6), before))
            assert value(state, k, "wall_before") == pytest.approx(float(np.clip(min(walls)[1], -1.0, 3.0)), abs=1e-5)


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
        allowed = features.PLANE + features.PLANE_NOISE * state.points.sigma
        for k, members in bodies_of(state):
            mine = [f for f, face in enumerate(state.faces) if face.segment in members]
            lengths = sorted((state.faces[f].length for f in mine), reverse=True)
            mine = [f for f in mine if state.faces[f].length in lengths[:2]]
            # Where no face is along or across the building, its lines through the middle of the body tell half of it.
            if len(mine) > 2 or all(known.aligned[f] < 1.0 for f in mine):
                continue
            best = 0.0
            for f in mine:
                others = [
                    face.length * known.aligned[g] * share(known.offset[g] - known.offset[f], allowed)
                    for g, face in enumerate(state.faces)
                    if face.segment not in members
                    and known.axis[g] == known.axis[f]
                    and face.points >= features.LINE_POINTS
                ]
                told = known.aligned[f] * (1.0 - share(state.faces[f].length, features.ARM * lengths[0]))
                best = max(best, told * sum(others))
            assert value(state, k, "support") == pytest.approx(log(1 + best / 0.3), abs=1e-9)
            some += best > 0
    assert some > 50


def test_shares_of_lines_are_shares() -> None:
    met = 0
    for one in recordings():
        state = one.after["features.measure"]
        for k, _ in bodies_of(state):
            assert 0.0 <= value(state, k, "line") < 1.0
            assert 0.0 <= value(state, k, "beyond") <= 1.0
            assert value(state, k, "arms") >= 0.0
            assert value(state, k, "unbroken") <= ROBUST.max_width + 2 * features.LINE_REACH + 0.1
            met += value(state, k, "line") > 0.0
    assert met > 500


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
        state = one.after["verdict.decide"]
        for k, _ in bodies_of(state):
            values = state.features.values[k * features.COUNT : (k + 1) * features.COUNT]
            odds = by_trees(forest.TREES, forest.PRIOR, values)
            assert state.verdict.thing[k] == pytest.approx(1.0 / (1.0 + exp(-odds)), abs=1e-9)
            seen += 1
    assert seen > 300


def test_what_is_likely_enough_is_an_object_and_the_rest_is_wall() -> None:
    kinds = {True: 0, False: 0}
    for one in recordings():
        state = one.after["verdict.choose"]
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
