"""Points, differences, noise, breakpoints and segments of every sweep against their references."""

from __future__ import annotations

from functools import cache
from math import inf, nan, sqrt

import numpy as np
import pytest

import lidarcli
from lidarcli.formalism import segmentation
from lidarcli.sweeps.types import Closure, Status
from tests.formalism.oracles import sweeps
from tests.formalism.oracles.recording import ROBUST, Recorded, recordings

EDGES = {
    segmentation.OWN: "own",
    segmentation.HIDDEN: "hidden",
    segmentation.OPEN: "open",
    segmentation.UNKNOWN: "unknown",
    segmentation.VIEW: "view",
    segmentation.FLICKERING: "flickering",
}


@cache
def circle_of(one: Recorded) -> sweeps.Circle:
    """A recorded sweep as the references read it."""
    batch = one.batch
    beams = int(batch.beams[0])
    ranges = [float(r) for r in batch.ranges[0, :beams]]
    names = {Status.VALID.value: sweeps.RANGE, Status.NO_RETURN.value: sweeps.NO_RETURN}
    statuses = [names.get(int(status), "nothing") for status in batch.status[0, :beams]]
    closure = int(batch.closure[0])
    return sweeps.lay_out(
        ranges,
        statuses,
        float(batch.angle_min[0]),
        float(batch.angle_increment[0]),
        closure != Closure.OPEN.value,
        closure == Closure.SHARED.value,
    )


def test_points_lie_where_their_range_and_bearing_say() -> None:
    for one in recordings():
        circle, points = circle_of(one), one.after["segmentation.load"].points
        assert points.position[: points.count] == circle.points
        expected = [sweeps.place(circle, n) for n in circle.points]
        found = list(zip(points.x[: points.count], points.y[: points.count], strict=True))
        assert found == [pytest.approx(place, abs=1e-9) for place in expected]


def test_differences_and_their_mean() -> None:
    for one in recordings():
        circle, points = circle_of(one), one.after["segmentation.differences"].points
        expected = {step.after: step for step in sweeps.steps(circle)}
        for k, n in enumerate(circle.points):
            if n not in expected:
                assert np.isnan(points.s[k])
                continue
            assert points.s[k] == sweeps.difference(circle, expected[n])
            assert points.missing[k] == expected[n].lost
        assert one.found is not None
        assert one.found.d_mean[0] == pytest.approx(sweeps.mean_difference(circle), abs=1e-12)


def test_noise_is_the_median_of_second_differences() -> None:
    above_floor = 0
    for one in recordings():
        expected = sweeps.noise(circle_of(one))
        # The core estimates it in single precision, of which second differences of 8 m lose a micrometre or a few.
        assert one.after["range_noise.sigma_of"].result == pytest.approx(expected, rel=1e-4, abs=1e-5)
        above_floor += expected > 0.003
    assert above_floor > 100


def test_breakpoints_by_one_sided_limits() -> None:
    explained, found = 0, 0
    for one in recordings():
        circle, state = circle_of(one), one.after["segmentation.find_breakpoints"]
        sigma = state.points.sigma
        expected = sweeps.breakpoints(circle, sigma, ROBUST.max_gap)
        assert [circle.points[k] for k in state.breaks] == expected
        beams = sorted(circle.beams[n].number for n in expected)
        assert np.flatnonzero(lidarcli.discontinuities(one.batch, ROBUST)[0]).tolist() == beams
        assert lidarcli.threshold(one.batch, ROBUST)[0] == pytest.approx(max(3.5 * sqrt(2) * sigma, 0.08), abs=1e-12)
        found += len(state.breaks)
        explained += sum(
            abs(sweeps.difference(circle, step)) > sweeps.threshold(circle, sigma, step)
            and not sweeps.is_discontinuous(circle, sigma, step, ROBUST.max_gap)
            for step in sweeps.steps(circle)
        )
    # Both what breaks and what is steep but explained come up.
    assert found > 2000
    assert explained > 300


@pytest.mark.parametrize("max_gap", [0, 1, 5])
def test_the_gentlest_slope_of_either_side(max_gap: int) -> None:
    looked_at = 0
    for one in recordings()[::3]:
        circle, points = circle_of(one), one.after["segmentation.differences"].points
        for k, n in enumerate(circle.points):
            for way in (-1, 1):
                expected = sweeps.slope(circle, n, way, max_gap) * way
                assert segmentation.slope(points, k, way, max_gap) == pytest.approx(expected, rel=1e-9, abs=1e-12)
                looked_at += expected != 0
    assert looked_at > 1000


def test_segments_and_their_edges() -> None:
    seen: set[str] = set()
    across = 0
    for one in recordings():
        circle, state = circle_of(one), one.after["segmentation.cut"]
        expected = sweeps.segments(circle, [circle.points[k] for k in state.breaks], ROBUST.max_gap)
        assert len(state.segments) == len(expected)
        for segment, wanted in zip(state.segments, expected, strict=True):
            at = range(segment.first, segment.first + segment.size)
            assert [state.points.position[k] for k in at] == wanted.points
            assert (EDGES[segment.start_edge], EDGES[segment.end_edge]) == wanted.edges
            np.testing.assert_array_equal((segment.s_start, segment.s_end), wanted.s)
            seen |= {*wanted.edges}
            across += wanted.points[0] > wanted.points[-1]
            theta = sweeps.grows([circle.bearings[n] for n in wanted.points])
            found = [segmentation.bearing(state.points, k) for k in at]
            np.testing.assert_allclose(found, theta, rtol=0, atol=1e-9)
    assert seen == set(EDGES.values())
    assert across > 30


def test_the_thresholds_of_objects() -> None:
    for one in recordings():
        circle, found = circle_of(one), one.found
        assert found is not None
        sigma = one.after["segmentation.find_breakpoints"].points.sigma
        onto = {step.after: step for step in sweeps.steps(circle)}
        beam_at_start = found.beam_f if one.batch.angle_increment[0] < 0 else found.beam_i
        numbers = [beam.number for beam in circle.beams]
        for k, beam in enumerate(beam_at_start.tolist()):
            n = numbers.index(beam)
            # Beside lost beams there is no nearer neighbour.
            alone = sweeps.Step(n, n, 0)
            expected = sweeps.threshold(circle, sigma, alone if np.isnan(found.s_i[k]) else onto[n])
            assert found.d_th[k] == pytest.approx(expected, abs=1e-12)


def test_the_references_know_simple_answers() -> None:
    """A wall and a box before it."""
    ranges = [4.0, 4.0, 2.0, 2.0, 4.0, 4.0, nan, 4.0]
    statuses = [sweeps.RANGE] * 6 + [sweeps.NO_RETURN, sweeps.RANGE]
    view = sweeps.lay_out(ranges, statuses, 0.0, 0.01, False, False)
    assert sweeps.breakpoints(view, 0.003, 0) == [0, 2, 4, 7]
    assert [one.edges for one in sweeps.segments(view, [0, 2, 4, 7], 0)] == [
        ("view", "hidden"),
        ("own", "own"),
        ("hidden", "flickering"),
        ("flickering", "view"),
    ]
    assert sweeps.foreseen(view, 3, 1, 1, 0) < inf
