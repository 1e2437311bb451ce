"""What must hold for any sweep and both profiles: the partition, and what must not change the result."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from math import inf, nan, pi

import numpy as np
import pytest
from batches import (
    PER_BEAM,
    PER_FACE,
    PER_OBJECT,
    PER_SWEEP,
    PER_VERTEX,
    batch_of,
    joined,
    raw_of,
    rows_of,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from random_sweeps import random_sweep
from reference import EACH_BEARING_ONCE, FIRST_BEARING_TWICE, NO_TURN, Sweep

from lidarcli.formalism import PROFILES, SETS, Detection, Parameters, detect
from lidarcli.simulate.generate import simulate_sweep_arrays
from lidarcli.simulate.random_scenes import FAULTS, KINDS, SENSORS, random_scene, sensor_with
from lidarcli.sweeps import RangeRules, SweepBatch, concatenate, normalise

PARAMETERS = {
    "paper": Parameters.for_profile("paper"),
    "robust": Parameters.for_profile("robust"),
    "robust, walls": Parameters.for_profile("robust", walls=True),
    "robust, mean": Parameters.for_profile("robust", threshold="mean"),
    "paper, walls": Parameters.for_profile("paper", walls=True),
}
seeds = st.integers(0, 2**32 - 1)
every_profile = pytest.mark.parametrize("profile", PROFILES)


@cache
def simulated() -> SweepBatch:
    """Rooms, corridors and halls through every sensor, perfect, good and poor: a batch of three widths."""
    blocks = []
    for number, kind in enumerate(KINDS):
        for sensor in SENSORS.values():
            for noise, lost in FAULTS:
                scene = random_scene(kind, 40 + number, sensor_with(sensor, noise, lost))
                blocks.append(simulate_sweep_arrays(scene, 2, seed=number)[0])
    raw = concatenate(blocks)
    return normalise(raw, np.arange(len(raw)), RangeRules())


@cache
def awkward() -> SweepBatch:
    """Random surfaces of every closing and direction, and rows that hold nothing or nearly nothing."""
    rng = np.random.default_rng(7)
    sweeps = [random_sweep(rng) for _ in range(200)]
    for row, ranges in enumerate(([], [inf], [nan] * 5, [2.0], [nan, 2.0, nan], [inf, 2.0, -inf])):
        sweeps.insert(17 * row, Sweep(list(ranges), 0.0, 0.1))
    sweeps.append(Sweep([nan, nan, 3.0, nan], -pi, pi / 2, EACH_BEARING_ONCE))
    sweeps.append(Sweep([nan] * 4, -pi, pi / 2, EACH_BEARING_ONCE))
    return batch_of(sweeps)


def assert_partition(batch: SweepBatch, found: Detection) -> None:
    """Def. 4: every beam in exactly one set, nothing twice, nothing lost."""
    beams = batch.beams.astype(int)
    assert (found.object_beams >= 0).all()
    assert (found.noise_beams >= 0).all()
    np.testing.assert_array_equal(found.object_beams + found.agent_beams + found.noise_beams, beams)
    in_o, in_a = found.set == SETS.index("O"), found.set == SETS.index("A")
    rows = len(batch)
    np.testing.assert_array_equal(
        np.bincount(found.row[in_o], found.beams[in_o], minlength=rows), found.object_beams
    )
    np.testing.assert_array_equal(np.bincount(found.row[in_o], minlength=rows), found.objects)
    np.testing.assert_array_equal(np.bincount(found.row[in_a], minlength=rows), found.agents)

    assert found.beam_set is not None
    assert found.beam_object is not None
    there = np.arange(batch.width) < beams[:, None]
    for name, counts in (("O", found.object_beams), ("A", found.agent_beams), ("S", found.noise_beams)):
        members = (found.beam_set == SETS.index(name)) & there
        np.testing.assert_array_equal(members.sum(axis=1), counts)
    assert ((found.beam_object > 0) == (found.beam_set != SETS.index("S"))).all()
    # A beam names an object of its own sweep; only beams with a range belong to one.
    for row in range(rows):
        mine = (found.row == row) & ~(found.set == SETS.index("S"))
        numbers, sizes = np.unique(found.beam_object[row], return_counts=True)
        stated = dict(zip(found.object[mine].tolist(), found.beams[mine].tolist(), strict=True))
        assert dict(zip(numbers[numbers > 0].tolist(), sizes[numbers > 0].tolist(), strict=True)) == stated
    assert (batch.status[found.beam_object > 0] == 0).all()


@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize("make", [simulated, awkward])
def test_every_beam_is_in_exactly_one_set(name: str, make: object) -> None:
    batch = make()  # type: ignore[operator]
    assert_partition(batch, detect(batch, PARAMETERS[name], per_beam=True))


@settings(max_examples=60, deadline=None)
@given(seeds, st.sampled_from(sorted(PARAMETERS)))
def test_every_beam_of_random_sweeps_is_in_exactly_one_set(seed: int, name: str) -> None:
    rng = np.random.default_rng(seed)
    batch = batch_of([random_sweep(rng) for _ in range(8)])
    assert_partition(batch, detect(batch, PARAMETERS[name], per_beam=True))


@pytest.mark.parametrize("name", PARAMETERS)
@pytest.mark.parametrize("make", [simulated, awkward])
@pytest.mark.parametrize("size", [1, 7, 1024])
def test_the_batch_size_changes_no_bit(name: str, make: object, size: int) -> None:
    batch = make()  # type: ignore[operator]
    whole = detect(batch, PARAMETERS[name], per_beam=True)
    parts = [rows_of(batch, slice(at, at + size)) for at in range(0, len(batch), size)]
    together = joined(
        [detect(part, PARAMETERS[name], per_beam=True) for part in parts], [len(part) for part in parts]
    )
    for field, values in together.items():
        expected = getattr(whole, field)
        if field.endswith("offsets"):
            expected = np.diff(expected)
        np.testing.assert_array_equal(values, expected, err_msg=field)
        assert values.tobytes() == expected.tobytes() or np.issubdtype(values.dtype, np.floating), field


@every_profile
def test_padding_changes_nothing(profile: str) -> None:
    rng = np.random.default_rng(11)
    sweeps = [random_sweep(rng) for _ in range(100)]
    narrow, wide = (
        detect(batch_of(sweeps, width), PARAMETERS[profile], per_beam=True) for width in (None, 200)
    )
    for field in (*PER_OBJECT, *PER_VERTEX, *PER_FACE, *PER_SWEEP):
        np.testing.assert_array_equal(getattr(narrow, field), getattr(wide, field), err_msg=field)
    width = max(len(sweep.ranges) for sweep in sweeps)
    for field in PER_BEAM:
        np.testing.assert_array_equal(getattr(narrow, field), getattr(wide, field)[:, :width], err_msg=field)
    assert wide.beam_set is not None
    assert (wide.beam_set[:, width:] == SETS.index("S")).all()


def like_for_like(
    found: Detection, row: int, period: int, shift: int, turn: float
) -> list[tuple[object, ...]]:
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
            tuple(found.vertex_kind[vertices].tolist()),
        )
        rows.append((*exact, np.array(floats, float)))
    return sorted(rows, key=lambda entry: entry[:6])


def assert_alike(
    one: list[tuple[object, ...]], other: list[tuple[object, ...]], tolerance: float = 1e-9
) -> None:
    """Codes and beams equal, floats but for rounding."""
    assert [entry[:-1] for entry in one] == [entry[:-1] for entry in other]
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a[-1], b[-1], rtol=0, atol=tolerance)  # type: ignore[arg-type]


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
    found = detect(batch_of([sweep, rotated(sweep, beams)]), parameters, per_beam=True)
    turn = beams * sweep.angle_increment
    assert_alike(like_for_like(found, 0, period, 0, 0.0), like_for_like(found, 1, period, beams, turn))
    for name in PER_SWEEP:
        values = getattr(found, name)
        assert values[1] == pytest.approx(values[0], abs=1e-12), name
    assert found.beam_s is not None
    np.testing.assert_array_equal(np.roll(found.beam_s[0, :period], beams), found.beam_s[1, :period])
    return len(found)


@every_profile
@settings(max_examples=150, deadline=None)
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
    found = detect(batch_of([sweep, mirrored(sweep)]), parameters, per_beam=True)
    swap = {0: 0, 1: 2, 2: 1, 3: 3, 4: 4}
    here, there = [], []
    for k in range(len(found)):
        if found.row[k] == 0:
            ends = (found.r_i[k], found.r_f[k], found.s_i[k], found.s_f[k])
            span = (int(found.beam_i[k]), int(found.beam_f[k]), int(found.visibility[k]))
            side, lateral = here, found.y[k]
        else:
            # Walked the other way round every difference has the other sign, and P_i is P_f.
            ends = (found.r_f[k], found.r_i[k], -found.s_f[k], -found.s_i[k])
            turned = [(beams - 1 - int(beam)) % period for beam in (found.beam_f[k], found.beam_i[k])]
            span = (*turned, swap[int(found.visibility[k])])
            side, lateral = there, -found.y[k]
        floats = [*ends, found.r_min[k], found.width[k], found.x[k], lateral]
        side.append((*span, int(found.beams[k]), int(found.set[k]), np.array(floats)))
    assert_alike(sorted(here, key=lambda e: e[:5]), sorted(there, key=lambda e: e[:5]))
    for name in PER_SWEEP:
        values = getattr(found, name)
        assert values[1] == pytest.approx(values[0], abs=1e-12), name


@every_profile
@settings(max_examples=150, deadline=None)
@given(seeds, st.sampled_from([NO_TURN, EACH_BEARING_ONCE, FIRST_BEARING_TWICE]))
def test_a_mirrored_scene_has_mirrored_objects(profile: str, seed: int, closing: str) -> None:
    # Longer runs may be thinned from one end on, and with decimetres of noise a whole object lies within the tolerance
    # of a face, so that where it is split depends on the end it is looked at from: symmetric but for the threshold.
    sweep = random_sweep(np.random.default_rng(seed), closing, most=30, rough=True)
    assume(profile == "paper" or detect(batch_of([sweep])).noise[0] < 0.1)
    assert_mirror(sweep, PARAMETERS[profile])


def sweep_of(batch: SweepBatch, row: int) -> Sweep:
    """A row of a batch as a sweep; a turn on its exact increment."""
    beams = int(batch.beams[row])
    ranges = np.where(batch.status[row, :beams] == 1, np.inf, batch.ranges[row, :beams].astype(float))
    closing = [NO_TURN, EACH_BEARING_ONCE, FIRST_BEARING_TWICE][batch.closure[row]]
    step = [float(batch.angle_increment[row]), 2 * pi / beams, 2 * pi / (beams - 1)][batch.closure[row]]
    return Sweep(ranges.tolist(), float(batch.angle_min[row]), step, closing)


@every_profile
def test_a_mirrored_simulated_scene_has_mirrored_objects(profile: str) -> None:
    batch = simulated()
    for row in range(0, len(batch), 2):
        assert_mirror(sweep_of(batch, row), PARAMETERS[profile])


def clockwise(sweep: Sweep) -> Sweep:
    """The same beams, counted by a sensor that hangs upside down."""
    last = sweep.angle_min + (len(sweep.ranges) - 1) * sweep.angle_increment
    ranges = sweep.ranges[::-1]
    if sweep.closing == FIRST_BEARING_TWICE:
        # The beam that counts is the first of the two, here as there.
        ranges = [sweep.ranges[0], *ranges[1:-1], sweep.ranges[0]]
    return Sweep(ranges, last, -sweep.angle_increment, sweep.closing)


@every_profile
@settings(max_examples=150, deadline=None)
@given(seeds, st.sampled_from([NO_TURN, EACH_BEARING_ONCE, FIRST_BEARING_TWICE]))
def test_a_clockwise_log_holds_the_same_objects(profile: str, seed: int, closing: str) -> None:
    sweep = random_sweep(np.random.default_rng(seed), closing, rough=True)
    assert_clockwise(sweep, PARAMETERS[profile])


@every_profile
def test_a_clockwise_simulated_log_holds_the_same_objects(profile: str) -> None:
    batch = simulated()
    for row in range(0, len(batch), 2):
        assert_clockwise(sweep_of(batch, row), PARAMETERS[profile])


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


@every_profile
@pytest.mark.parametrize(
    "ranges",
    [
        [],
        [[]],
        [[], []],
        [[nan]],
        [[2.0]],
        [[inf] * 7],
        [[nan] * 3, [-inf] * 2, []],
    ],
    ids=["no rows", "no beams", "two rows without beams", "one lost", "one", "no return", "nothing valid"],
)
def test_sweeps_that_hold_nothing(profile: str, ranges: list[list[float]]) -> None:
    sweeps = [Sweep(row, 0.0, 0.1) for row in ranges]
    batch = batch_of(sweeps)
    found = detect(batch, PARAMETERS[profile], per_beam=True)
    assert len(found) == 0
    assert found.vertex_offsets.tolist() == found.face_offsets.tolist() == [0]
    for name in (*PER_OBJECT, *PER_VERTEX, *PER_FACE, "row"):
        assert len(getattr(found, name)) == 0, name
    assert found.noise_beams.tolist() == [len(row) for row in ranges]
    assert found.d_mean.tolist() == [0.0] * len(ranges)
    assert found.objects.tolist() == found.object_beams.tolist() == [0] * len(ranges)
    for name in PER_BEAM:
        assert getattr(found, name).shape == batch.ranges.shape


@every_profile
def test_a_lone_beam_of_a_turn_sees_no_difference(profile: str) -> None:
    lone = Sweep([inf, 2.0, inf, inf], -pi, pi / 2, EACH_BEARING_ONCE)
    found = detect(batch_of([lone]), PARAMETERS[profile], per_beam=True)
    # Nothing returns beside it: an object by the letter; the default asks for more beams.
    assert len(found) == (1 if profile == "paper" else 0)
    assert np.isnan(found.s_i).all()
    assert found.d_mean.tolist() == [0.0]


def test_objects_are_ordered_and_numbered_by_bearing() -> None:
    for parameters in PARAMETERS.values():
        found = detect(simulated(), parameters)
        assert (np.diff(found.row) >= 0).all()
        same = np.diff(found.row) == 0
        assert (np.diff(found.object)[same] == 1).all()
        assert (found.object[np.append(True, ~same)] == 1).all()
        numbered = same & (np.diff(found.set) == 0)
        assert (np.diff(found.theta_i)[numbered] > 0).all()
        assert (found.theta_f >= found.theta_i).all()
        inside = (found.theta_min >= found.theta_i) & (found.theta_min <= found.theta_f)
        assert inside.all()


def test_what_padding_holds_does_not_matter() -> None:
    rng = np.random.default_rng(5)
    sweeps = [random_sweep(rng) for _ in range(50)]
    raw = raw_of(sweeps, 90)
    padding = np.arange(90) >= raw.beams[:, None]
    other = replace(raw, ranges=np.where(padding, np.float32(np.nan), raw.ranges))
    one, two = (detect(normalise(block, np.arange(50), RangeRules())) for block in (raw, other))
    for name in (*PER_OBJECT, *PER_SWEEP):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)
