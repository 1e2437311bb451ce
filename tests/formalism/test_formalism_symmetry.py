"""Turned, mirrored or counted the other way round, a scene holds the same objects."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from lidarcli.formalism import PROFILES, Detection, Parameters, detect
from lidarcli.sweeps import SweepBatch
from tests.formalism.batches import PER_SWEEP, batch_of
from tests.formalism.random_sweeps import random_sweep
from tests.formalism.reference import EACH_BEARING_ONCE, FIRST_BEARING_TWICE, NO_TURN, Sweep
from tests.formalism.surroundings import PARAMETERS, simulated

seeds = st.integers(0, 2**32 - 1)
every_profile = pytest.mark.parametrize("profile", PROFILES)


class Seen(NamedTuple):
    """An object in numbers that can be compared between two sweeps."""

    exact: tuple[int, ...]
    """Beams and codes."""
    floats: np.ndarray


def like_for_like(found: Detection, row: int, period: int, shift: int, turn: float) -> list[Seen]:
    """The objects of a sweep as seen by a sensor turned by `shift` beams, in an order that does not depend on it."""
    rows = []
    for k in np.flatnonzero(found.row == row).tolist():
        vertices = slice(found.vertex_offsets[k], found.vertex_offsets[k + 1])
        faces = slice(found.face_offsets[k], found.face_offsets[k + 1])
        theta_i = found.theta_i[k]
        cos, sin = np.cos(-turn), np.sin(-turn)
        floats = [
            *(getattr(found, name)[k] for name in ("r_i", "r_f", "s_i", "s_f", "d_th", "r_min", "width")),
            *(getattr(found, name)[k] for name in ("box_length", "box_width")),
            found.x[k] * cos - found.y[k] * sin,
            found.x[k] * sin + found.y[k] * cos,
            found.box_x[k] * cos - found.box_y[k] * sin,
            found.box_x[k] * sin + found.box_y[k] * cos,
            *(found.theta_f[k] - theta_i, found.theta_min[k] - theta_i),
            *(found.vertex_theta[vertices] - theta_i),
            *found.vertex_r[vertices],
            *(found.face_theta_i[faces] - theta_i),
            *(found.face_theta_f[faces] - theta_i),
            *found.face_length[faces],
            # The root of what rounding leaves of 0 is far from 0: squares compare.
            *np.square(found.face_rms[faces]),
            np.cos(theta_i - turn),
            np.sin(theta_i - turn),
        ]
        if found.beams[k] > 1:
            # A direction is known up to half a turn; that of a point is not known at all.
            yaw = 2 * (found.box_yaw[k] - turn)
            floats += [np.cos(yaw), np.sin(yaw)]
        exact = (
            (int(found.beam_i[k]) - shift) % period,
            (int(found.beam_f[k]) - shift) % period,
            int(found.beams[k]),
            int(found.set[k]),
            int(found.shape[k]),
            int(found.visibility[k]),
            *found.vertex_kind[vertices].tolist(),
        )
        rows.append(Seen(exact, np.array(floats, float)))
    return sorted(rows, key=lambda one: one.exact)


def assert_alike(some: list[Seen], others: list[Seen]) -> None:
    """Codes and beams equal, floats but for rounding."""
    assert [one.exact for one in some] == [other.exact for other in others]
    for one, other in zip(some, others, strict=True):
        np.testing.assert_allclose(one.floats, other.floats, rtol=0, atol=1e-9)


def assert_same_sweeps(found: Detection, *sweeps: Sweep) -> None:
    """What is told of two sweeps is the same, but for the bearing of the nearest beam, which is of one in each."""
    for name in PER_SWEEP:
        values = getattr(found, name)
        if name != "nearest_theta":
            assert values[1] == pytest.approx(values[0], abs=1e-12, nan_ok=True), name
    for row, sweep in enumerate(sweeps):
        if not np.isnan(found.nearest[row]):
            beam = round((found.nearest_theta[row] - sweep.angle_min) / sweep.angle_increment)
            assert np.float32(sweep.ranges[beam % len(sweep.ranges)]) == found.nearest[row]


def rotated(sweep: Sweep, beams: int) -> Sweep:
    """The same surroundings, seen by a sensor that starts `beams` beams earlier."""
    ranges = list(sweep.ranges)
    if sweep.closing == FIRST_BEARING_TWICE:
        ranges.pop()
    ranges = [float(value) for value in np.roll(ranges, beams)]
    if sweep.closing == FIRST_BEARING_TWICE:
        ranges.append(ranges[0])
    return Sweep(ranges, sweep.angle_min, sweep.angle_increment, sweep.closing)


def assert_rotation(sweep: Sweep, beams: int, parameters: Parameters) -> int:
    period = len(sweep.ranges) - (sweep.closing == FIRST_BEARING_TWICE)
    other = rotated(sweep, beams)
    found = detect(batch_of([sweep, other]), parameters, per_beam=True)
    turn = beams * sweep.angle_increment
    assert_alike(like_for_like(found, 0, period, 0, 0.0), like_for_like(found, 1, period, beams, turn))
    assert_same_sweeps(found, sweep, other)
    assert found.beam_s is not None
    np.testing.assert_array_equal(np.roll(found.beam_s[0, :period], beams), found.beam_s[1, :period])
    return len(found)


@every_profile
@settings(max_examples=150)
@given(seeds, st.integers(0, 60), st.sampled_from([EACH_BEARING_ONCE, FIRST_BEARING_TWICE]))
def test_rotating_a_turn_rotates_its_objects(profile: str, seed: int, beams: int, closing: str) -> None:
    sweep = random_sweep(np.random.default_rng(seed), closing, rough=True)
    assert_rotation(sweep, beams, PARAMETERS[profile])


def turn_of(batch: SweepBatch, row: int, closing: str) -> Sweep:
    """A simulated full turn on its exact increment, each bearing once or the first twice."""
    ranges = batch.ranges[row, : 360 if batch.beams[row] == 361 else 720].astype(float)
    ranges = np.where(batch.status[row, : len(ranges)] == 1, np.inf, ranges)
    values = ranges.tolist()
    step = 2 * pi / len(values)
    if closing == FIRST_BEARING_TWICE:
        values.append(values[0])
    return Sweep(values, -pi, step, closing)


@every_profile
@pytest.mark.parametrize("closing", [EACH_BEARING_ONCE, FIRST_BEARING_TWICE])
def test_rotating_a_simulated_turn_rotates_its_objects(profile: str, closing: str) -> None:
    batch = simulated()
    objects = 0
    for row in np.flatnonzero(batch.beams < 1000).tolist():
        objects += assert_rotation(turn_of(batch, row, closing), 1 + 37 * row % 300, PARAMETERS[profile])
    assert objects > 100


def mirrored(sweep: Sweep) -> Sweep:
    """The scene reflected about the x axis: bearing θ becomes -θ, beams counted the same way round."""
    last = sweep.angle_min + (len(sweep.ranges) - 1) * sweep.angle_increment
    ranges = sweep.ranges[::-1]
    if sweep.closing == FIRST_BEARING_TWICE:
        ranges = [sweep.ranges[0], *ranges[1:-1], sweep.ranges[0]]
    return Sweep(ranges, -last, sweep.angle_increment, sweep.closing)


def assert_mirror(sweep: Sweep, parameters: Parameters) -> None:
    beams = len(sweep.ranges)
    period = beams - (sweep.closing == FIRST_BEARING_TWICE)
    other = mirrored(sweep)
    found = detect(batch_of([sweep, other]), parameters, per_beam=True)
    swap = {0: 0, 1: 2, 2: 1, 3: 3, 4: 4}
    here: list[Seen] = []
    there: list[Seen] = []
    for k in range(len(found)):
        if found.row[k] == 0:
            ends = (found.r_i[k], found.r_f[k], found.s_i[k], found.s_f[k])
            span = (int(found.beam_i[k]), int(found.beam_f[k]), int(found.visibility[k]))
            side, lateral = here, found.y[k]
        else:
            # Walked the other way round every difference has the other sign, and P_i is P_f.
            ends = (found.r_f[k], found.r_i[k], -found.s_f[k], -found.s_i[k])
            turned = [(beams - 1 - int(beam)) % period for beam in (found.beam_f[k], found.beam_i[k])]
            span = (turned[0], turned[1], swap[int(found.visibility[k])])
            side, lateral = there, -found.y[k]
        floats = [*ends, found.r_min[k], found.width[k], found.x[k], lateral]
        exact = (*span, int(found.beams[k]), int(found.set[k]))
        side.append(Seen(exact, np.array(floats)))
    assert_alike(sorted(here, key=lambda one: one.exact), sorted(there, key=lambda one: one.exact))
    assert_same_sweeps(found, sweep, other)


@pytest.mark.slow
@every_profile
@settings(max_examples=150)
@given(seeds, st.sampled_from([NO_TURN, EACH_BEARING_ONCE, FIRST_BEARING_TWICE]))
def test_a_mirrored_scene_has_mirrored_objects(profile: str, seed: int, closing: str) -> None:
    # Longer runs may be thinned from one end on, and with decimetres of noise a whole object lies within the tolerance
    # of a face, so that where it is split depends on the end it is looked at from: symmetric but for the threshold.
    sweep = random_sweep(np.random.default_rng(seed), closing, most=30, rough=True)
    assume(profile == "paper" or detect(batch_of([sweep])).noise[0] < 0.1)
    assert_mirror(sweep, PARAMETERS[profile])


def clockwise(sweep: Sweep) -> Sweep:
    """The same beams, counted by a sensor that hangs upside down."""
    last = sweep.angle_min + (len(sweep.ranges) - 1) * sweep.angle_increment
    ranges = sweep.ranges[::-1]
    if sweep.closing == FIRST_BEARING_TWICE:
        # The beam that counts is the first of the two, here as there.
        ranges = [sweep.ranges[0], *ranges[1:-1], sweep.ranges[0]]
    return Sweep(ranges, last, -sweep.angle_increment, sweep.closing)


@pytest.mark.slow
@every_profile
@settings(max_examples=150)
@given(seeds, st.sampled_from([NO_TURN, EACH_BEARING_ONCE, FIRST_BEARING_TWICE]))
def test_a_clockwise_log_holds_the_same_objects(profile: str, seed: int, closing: str) -> None:
    sweep = random_sweep(np.random.default_rng(seed), closing, rough=True)
    assert_clockwise(sweep, PARAMETERS[profile])


def assert_clockwise(sweep: Sweep, parameters: Parameters) -> None:
    beams = len(sweep.ranges)
    period = beams - (sweep.closing == FIRST_BEARING_TWICE)
    found = detect(batch_of([sweep, clockwise(sweep)]), parameters, per_beam=True)
    assert found.beam_s is not None
    other = renumbered(found, beams, period)
    assert_alike(like_for_like(found, 0, period, 0, 0.0), like_for_like(other, 1, period, 0, 0.0))
    there = np.array([(beams - 1 - beam) % period for beam in range(period)])
    np.testing.assert_array_equal(found.beam_s[0, :period], found.beam_s[1, there])


def renumbered(found: Detection, beams: int, period: int) -> Detection:
    """The second sweep's beams renumbered the other way round; beam_i and beam_f stand in the order of the log."""
    second = found.row == 1
    beam_i = np.where(second, (beams - 1 - found.beam_f) % period, found.beam_i)
    beam_f = np.where(second, (beams - 1 - found.beam_i) % period, found.beam_f)
    return replace(found, beam_i=beam_i, beam_f=beam_f)
