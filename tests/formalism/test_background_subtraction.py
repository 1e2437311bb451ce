"""r_w - r_e: which beams leave the background, and the objects that they make, on sweeps with plain answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lidarcli.formalism import Detection, Parameters, detect, sweep
from lidarcli.formalism.background import surroundings
from lidarcli.formalism.detect import noise
from lidarcli.formalism.detection import APPEARED, REMOVED, SHAPES, VISIBILITIES
from lidarcli.formalism.subtraction import BESIDE_SHARE, Difference, Subtraction, Tolerance, _runs, changes, combine, select
from lidarcli.sweeps import TURN, Status, SweepBatch
from tests.formalism.backgrounds import STEP, WIDE, found_in, learned, partial, with_poses

GONE = Tolerance(removed=True)


def flat(beams: int = 60, r: float = 4.0) -> NDArray[np.float64]:
    return np.full(beams, r)


def spans(found: Detection) -> list[tuple[int, int, int]]:
    """(row, beam_i, beam_f) of every object."""
    return list(zip(found.row.tolist(), found.beam_i.tolist(), found.beam_f.tolist(), strict=True))


def of(ranges: NDArray[np.float64], empty: NDArray[np.float64], tolerance: Tolerance | None = None) -> Detection:
    """What differs between a sweep and the scene before."""
    return found_in(partial(ranges), learned(partial(np.stack([empty] * 5))), tolerance)


def test_what_appeared_is_an_object_with_all_its_columns() -> None:
    empty, now = flat(), flat()
    now[20:28] = 2.5
    found = of(now, empty)
    assert spans(found) == [(0, 20, 27)]
    assert found.change is not None
    assert found.change.tolist() == [APPEARED]
    assert found.difference is not None
    assert found.difference[0] == pytest.approx(-1.5)
    assert (found.s_i[0], found.s_f[0]) == pytest.approx((-1.5, 1.5))
    assert VISIBILITIES[found.visibility[0]] == "full"
    # Half a beam at either end is added to what the seven steps between its beams span.
    assert found.box_length[0] == pytest.approx(found.width[0] * 8 / 7, rel=0.01)
    assert found.vertex_offsets.tolist()[-1] == len(found.vertex_theta) >= 2
    assert found.face_offsets.tolist()[-1] == len(found.face_length) >= 1
    assert (found.objects[0], found.object_beams[0], found.noise_beams[0]) == (1, 8, 52)
    assert found.beam_difference is not None
    assert found.beam_difference[0] == pytest.approx(now - empty, abs=1e-6)


def test_the_unchanged_scene_holds_nothing() -> None:
    empty = flat()
    empty[10:30] = np.linspace(1.0, 3.0, 20)
    found = of(empty, empty, GONE)
    assert spans(found) == []
    assert found.noise_beams.tolist() == [60]


def test_a_thing_before_open_space_is_found() -> None:
    empty, now = np.full(60, np.inf), np.full(60, np.inf)
    now[20:28] = 2.5
    found = of(now, empty)
    assert spans(found) == [(0, 20, 27)]
    assert found.difference is not None
    # Nothing comes back from beyond the greatest range: the background is that far at least.
    assert found.difference[0] == pytest.approx(2.5 - 12.0)


def test_without_a_greatest_range_the_difference_from_open_space_is_not_known() -> None:
    empty, now = np.full(60, np.inf), np.full(60, np.inf)
    now[20:28] = 2.5
    found = found_in(partial(now, np.inf), learned(partial([empty.tolist()] * 3, np.inf)))
    assert spans(found) == [(0, 20, 27)]
    assert found.difference is not None
    assert np.isnan(found.difference[0])


@pytest.mark.parametrize("written", [0.0, -1.0, np.nan, np.inf])
def test_a_greatest_range_that_is_none(written: float) -> None:
    empty, now = np.full(60, np.inf), np.full(60, np.inf)
    now[20:28] = 2.5
    old, new = (replace(partial(ranges, np.inf), range_max=np.full(1, written, np.float32)) for ranges in (empty, now))
    background = learned(old)
    assert background.range_max == np.inf
    assert spans(found_in(new, background)) == [(0, 20, 27)]


def test_what_returns_at_the_limit_of_the_sensor_is_no_news() -> None:
    now = np.full(60, np.inf)
    now[20:28] = 11.97
    assert spans(of(now, np.full(60, np.inf))) == []


@pytest.mark.parametrize("gone_to", [4.0, np.inf])
def test_what_is_gone_is_built_from_the_background(gone_to: float) -> None:
    empty, now = flat(r=gone_to), flat(r=gone_to)
    empty[20:30] = 2.5
    empty[26:30] = 2.2
    assert spans(of(now, empty)) == []
    found = of(now, empty, GONE)
    assert spans(found) == [(0, 20, 25), (0, 26, 29)]
    assert found.change is not None
    assert found.change.tolist() == [REMOVED] * 2
    assert found.r_i.tolist() == pytest.approx([2.5, 2.2])
    assert found.s_f[0] == pytest.approx(-0.3)
    beyond = 4.0 if np.isfinite(gone_to) else 12.0
    assert found.difference is not None
    assert found.difference.tolist() == pytest.approx([beyond - 2.5, beyond - 2.2])
    assert found.beam_object is not None
    assert found.beams.tolist() == [6, 4]
    assert found.beam_object[0].tolist() == [0] * 60
    assert (found.objects[0], found.object_beams[0], found.noise_beams[0]) == (0, 0, 60)


def test_lost_beams_are_not_gone() -> None:
    now = flat()
    now[[5, 20, 21, 40]] = np.inf
    now[[30, 31, 32]] = np.nan
    assert spans(of(now, flat(), GONE)) == []
    now[22] = np.inf
    assert spans(of(now, flat(), GONE)) == [(0, 20, 22)]
    assert spans(of(now, flat(), replace(GONE, max_gap=3))) == []


def test_beams_that_often_return_nothing_are_not_gone_by_that() -> None:
    seen = np.tile(flat(), (10, 1))
    seen[::5, 20:30] = np.inf
    now = flat()
    now[20:30] = np.inf
    assert spans(found_in(partial(now), learned(partial(seen)), GONE)) == []


def test_a_moved_thing_has_appeared_and_is_gone() -> None:
    empty, now = flat(), flat()
    empty[10:18], now[30:38] = 2.0, 2.0
    found = of(now, empty, GONE)
    assert spans(found) == [(0, 10, 17), (0, 30, 37)]
    assert found.change is not None
    assert found.change.tolist() == [REMOVED, APPEARED]
    assert found.object.tolist() == [1, 2]
    assert found.beam_object is not None
    # The beams that pass where it stood end on the wall: no object of the sweep is there.
    assert found.beam_object[0, [10, 17, 18, 30, 37, 38]].tolist() == [0, 0, 0, 2, 2, 0]
    assert (found.objects[0], found.object_beams[0]) == (1, 8)


def test_depth_edges_may_jitter_by_a_beam() -> None:
    empty = flat()
    empty[20:30] = 2.0
    for start, end in ((19, 30), (21, 30), (20, 31), (19, 31), (21, 29)):
        now = flat()
        now[start:end] = 2.0
        assert spans(of(now, empty, GONE)) == []


def test_a_wall_at_grazing_incidence_may_shake() -> None:
    """A beam further on the wall is 0.9 m farther away: no constant threshold would do."""
    bearing = (np.arange(60) - 30) * STEP
    wall = np.clip(0.4 / np.cos(bearing + np.deg2rad(60.0)), 0.4, 11.0)
    assert np.abs(np.diff(wall)).max() > 0.5
    for shake in (-0.9, 0.9):
        now = np.clip(0.4 / np.cos(bearing + np.deg2rad(60.0 + shake)), 0.4, 11.0)
        assert spans(of(now, wall, GONE)) == []


def test_a_thing_that_leans_on_the_wall_is_not_hidden_by_it() -> None:
    empty, now = flat(), flat()
    now[20:30] = np.linspace(3.3, 3.98, 10)
    found = of(now, empty)
    assert spans(found)[0][1] == 20
    assert VISIBILITIES[found.visibility[0]] == "full"


def test_a_new_thing_that_another_hides_says_so() -> None:
    empty, now = flat(), flat()
    now[20:30], now[25:35] = 3.0, 2.0
    found = of(now, empty)
    assert spans(found) == [(0, 20, 24), (0, 25, 34)]
    assert [VISIBILITIES[code] for code in found.visibility] == ["end_hidden", "full"]


def test_new_things_at_the_edge_of_the_view_are_cut() -> None:
    now = flat()
    now[:6] = 2.0
    found = of(now, flat())
    assert VISIBILITIES[found.visibility[0]] == "cut"


def test_walls_as_wide_as_can_be_may_appear() -> None:
    now = flat()
    now[5:55] = 3.0
    found = of(now, flat())
    assert spans(found) == [(0, 5, 54)]
    narrow = found_in(partial(now), learned(partial(flat())), parameters=Parameters(max_width=1.0))
    assert spans(narrow) == []


def test_few_beams_are_noise() -> None:
    now = flat()
    now[20:22] = 2.0
    assert spans(of(now, flat())) == []


def test_two_legs_are_two_though_a_single_beam_looks_between_them() -> None:
    now = flat()
    now[20:24], now[25:29] = 2.0, 2.0
    assert spans(of(now, flat())) == [(0, 20, 23), (0, 25, 28)]


def test_a_weak_beam_inside_an_object_does_not_split_it() -> None:
    now = flat()
    now[20:30] = 3.88
    now[25] = 3.97
    assert spans(of(now, flat())) == [(0, 20, 29)]


def test_a_threshold_in_metres() -> None:
    now = flat()
    now[20:30] = 3.6
    assert spans(of(now, flat(), Tolerance(threshold=0.3))) == [(0, 20, 29)]
    assert spans(of(now, flat(), Tolerance(threshold=0.5))) == []


def test_noise_of_the_sweep_and_of_the_background_count() -> None:
    rng = np.random.default_rng(0)
    calm = learned(partial(np.stack([flat()] * 20)))
    noisy = learned(partial(flat() + 0.05 * rng.standard_normal((200, 60))))
    now = flat() - 0.15
    assert len(found_in(partial(now), calm)) == 1
    assert len(found_in(partial(now), noisy)) == 0
    assert len(found_in(partial(now + 0.1 + 0.05 * rng.standard_normal(60)), calm)) == 0


def test_a_door_that_was_open_or_shut() -> None:
    """Both are background; between them and beyond there is room for something new."""
    seen = np.tile(flat(r=6.0), (10, 1))
    seen[::2, 20:40] = 3.0
    background = learned(partial(seen))
    for now in seen[:2]:
        assert spans(found_in(partial(now), background, GONE)) == []
    now = seen[1].copy()
    now[25:35] = 4.5
    assert spans(found_in(partial(now), background)) == [(0, 25, 34)]


def test_what_nobody_knows_is_not_compared() -> None:
    seen, now = flat(), flat(r=2.0)
    seen[20:40] = np.nan
    found = of(now, seen)
    assert spans(found) == [(0, 0, 19), (0, 40, 59)]
    background = learned(partial(seen))
    batch = partial(now)
    known = Subtraction(background).difference(batch, noise(batch)).known
    assert known[0].tolist() == [True] * 20 + [False] * 20 + [True] * 20


# Other bearings, other places.


def turned(ranges: NDArray[np.float64], first: float, step: float, range_max: float = 12.0) -> SweepBatch:
    return sweep(ranges, angle_min=np.deg2rad(first), angle_increment=np.deg2rad(step), range_max=range_max)


def test_another_resolution_is_compared_by_bearing() -> None:
    background = learned(turned(np.stack([flat(181)] * 3), -90, 1.0))
    for step in (0.25, 0.5, 2.0, -0.5):
        beams = int(100 / abs(step)) + 1
        first = -np.copysign(50, step)
        bearing = first + step * np.arange(beams)
        now = np.where(np.abs(bearing - 10.1) < 8, 2.0, 4.0)
        found = found_in(turned(now, first, step), background)
        assert found.theta_i == pytest.approx([np.deg2rad(10.1 - 8)], abs=np.deg2rad(2.1))
        assert found.theta_f == pytest.approx([np.deg2rad(10.1 + 8)], abs=np.deg2rad(2.1))
        assert len(found_in(turned(flat(beams), first, step), background, GONE)) == 0


def test_a_coarse_sweep_may_look_between_its_beams() -> None:
    """A fine background has an edge; where exactly a beam four times as wide falls beside it is chance."""
    empty = np.where(np.arange(361) < 180, 2.0, 4.0)
    background = learned(turned(np.stack([empty] * 3), -45, 0.25))
    now = np.where(np.arange(91) < 46, 2.0, 4.0)
    assert len(found_in(turned(now, -45, 1.0), background, GONE)) == 0


def test_beams_out_of_the_background_s_view_are_not_compared() -> None:
    background = learned(turned(np.stack([flat(91)] * 3), -45, 1.0))
    batch = turned(np.full(181, 2.0), -90, 1.0)
    found = found_in(batch, background)
    assert spans(found) == [(0, 45, 135)]
    known = Subtraction(background).difference(batch, noise(batch)).known
    assert int(known.sum()) == 91


def test_a_thing_across_the_seam_is_one() -> None:
    empty = np.full(360, 4.0)
    now = empty.copy()
    now[:6], now[-6:] = 2.0, 2.0
    for ends in ([], [2.0]):
        step = TURN / 360
        batch = sweep([*now, *ends], angle_min=-np.pi, angle_increment=step)
        old = sweep([[*empty, *[4.0 for _ in ends]]] * 3, angle_min=-np.pi, angle_increment=step)
        found = found_in(batch, learned(old))
        assert spans(found) == [(0, 354, 5)]
        assert found.difference is not None
        assert found.difference[0] == pytest.approx(-2.0)


@pytest.mark.slow
@given(st.integers(1, 59), st.lists(st.tuples(st.integers(0, 59), st.integers(1, 12), st.floats(0.5, 7.0)), max_size=4))
def test_turning_and_mirroring_the_sensor_changes_nothing(k: int, things: list[tuple[int, int, float]]) -> None:
    step = TURN / 60
    empty, now = 4.0 + np.sin(np.arange(60)), 4.0 + np.sin(np.arange(60))
    for at, size, r in things:
        now[np.arange(at, at + size) % 60] = r
    old = sweep(np.stack([empty] * 3), angle_min=0.0, angle_increment=step)
    found = found_in(sweep(now, angle_min=0.0, angle_increment=step), learned(old), GONE)
    rolled = found_in(
        sweep(np.roll(now, -k), angle_min=k * step, angle_increment=step),
        learned(sweep(np.stack([np.roll(empty, -k)] * 3), angle_min=k * step, angle_increment=step)),
        GONE,
    )
    mirrored = found_in(
        sweep(now[::-1], angle_min=59 * step, angle_increment=-step),
        learned(sweep(np.stack([empty[::-1]] * 3), angle_min=59 * step, angle_increment=-step)),
        GONE,
    )
    assert found.beam_object is not None
    assert rolled.beam_object is not None
    assert mirrored.beam_object is not None
    members = found.beam_object[0] > 0
    # Runs of candidates end at the first and the last beam of the log; only there may the seam tell.
    inner = np.ones(60, bool)
    for edge in (0, k):
        inner[(edge + np.arange(-13, 13)) % 60] = False
    assert np.array_equal(np.roll(rolled.beam_object[0], k)[inner] > 0, members[inner])
    assert np.array_equal(mirrored.beam_object[0, ::-1][inner] > 0, members[inner])


def test_padding_is_no_beam() -> None:
    wide, narrow = partial(flat(60)), partial(flat(40, 2.0))
    batch = replace(
        wide.rows(np.zeros(2, np.int64)),
        angle_min=np.array([wide.angle_min[0], narrow.angle_min[0]]),
        beams=np.array([60, 40], np.int32),
        ranges=np.stack([flat(60), np.append(flat(40, 2.0), np.full(20, np.nan))]).astype(np.float32),
        status=np.stack([np.zeros(60), np.repeat([0, Status.PADDING], [40, 20])]).astype(np.uint8),
    )
    found = found_in(batch, learned(wide), GONE)
    assert spans(found) == [(1, 0, 39)]
    assert found.noise_beams.tolist() == [60, 0]


def test_sweeps_without_a_station_are_not_compared() -> None:
    old = partial(np.stack([flat()] * 4))
    poses = np.zeros((4, 3))
    background = learned(with_poses(old, poses))
    now = partial(np.stack([flat(r=2.0)] * 4))
    elsewhere = np.array([[0.0, 0, 0], [3.0, 0, 0], [0.0, 0, 1.0], [np.nan] * 3])
    batch = with_poses(now, elsewhere)
    found = found_in(batch, background)
    assert found.station is not None
    assert found.station.tolist() == [0, -1, -1, -1]
    assert spans(found) == [(0, 0, 59)]
    assert found.noise_beams.tolist() == [0, 60, 60, 60]
    wider = found_in(batch, background, Tolerance(distance=5.0, angle=2.0))
    assert wider.station is not None
    assert wider.station.tolist() == [0, 0, 0, -1]
    parked = found_in(now, background)
    assert parked.station is not None
    assert parked.station.tolist() == [0] * 4


def test_without_poses_only_a_background_of_one_place_can_be_used() -> None:
    poses = np.array([[0.0, 0, 0], [2.0, 0, 0]])
    background = learned(with_poses(partial(np.stack([flat()] * 2)), poses))
    found = found_in(partial(flat(r=2.0)), background)
    assert found.station is not None
    assert found.station.tolist() == [-1]


def test_an_empty_background_and_an_empty_batch() -> None:
    background = learned(partial(flat()))
    nothing = replace(
        background,
        r_e=background.r_e[:0],
        r_near=background.r_near[:0],
        spread=background.spread[:0],
        support=background.support[:0],
        no_return=background.no_return[:0],
        sweeps=background.sweeps[:0],
        poses=background.poses.rows(slice(0)),
    )
    found = found_in(partial(flat(r=2.0)), nothing)
    assert found.station is not None
    assert found.station.tolist() == [-1]
    assert len(found_in(partial(flat()).rows(np.empty(0, np.int64)), background)) == 0


@pytest.mark.parametrize("size", [1, 7])
def test_the_batch_size_makes_no_difference(size: int) -> None:
    rng = np.random.default_rng(1)
    empty = 4.0 + np.sin(np.arange(60) / 9)
    seen = empty + 0.02 * rng.standard_normal((30, 60))
    now = np.where(rng.random((30, 60)) < 0.02, np.inf, seen)
    for row in range(30):
        at = rng.integers(0, 50)
        now[row, at : at + 7] *= rng.choice([0.5, 1.5])
    poses = np.column_stack([rng.uniform(-0.1, 0.1, (30, 2)), np.zeros(30)])
    poses[::3] = 0.0
    for batch, old in ((partial(now), partial(seen)), (with_poses(partial(now), poses), with_poses(partial(seen), poses))):
        background = learned(old)
        whole = found_in(batch, background, GONE)
        parts = [
            found_in(batch.rows(np.arange(start, min(start + size, 30))), background, GONE) for start in range(0, 30, size)
        ]
        assert sum(map(len, parts)) == len(whole) > 5
        for name in ("beam_i", "beam_f", "difference", "change", "theta_i", "box_x", "vertex_r", "objects"):
            assert np.array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name))


# Runs of beams, slowly.


def runs_one_by_one(
    own: NDArray[np.float32], beyond: NDArray[np.float32], threshold: float, lost: NDArray[np.bool_], most: int
) -> NDArray[np.bool_]:
    """The reference for `_runs`, a sweep and a beam at a time."""
    result = np.zeros(own.shape, bool)
    for row in range(len(own)):
        candidate = [
            bool(own[row, n] > np.float32(BESIDE_SHARE) * np.float32(threshold) or lost[row, n])
            for n in range(own.shape[1])
        ]
        n = 0
        while n < len(candidate):
            end = n
            while end < len(candidate) and candidate[end]:
                end += 1
            strong = any(beyond[row, k] > np.float32(threshold) for k in range(n, end))
            if end > n and (strong or lost[row, n:end].sum() > most):
                result[row, n:end] = True
            n = max(end, n + 1)
        for k in range(1, own.shape[1] - 1):
            if not candidate[k] and result[row, k - 1] and result[row, k + 1] and own[row, k] > 0:
                result[row, k] = True
    return result


@given(
    st.lists(
        st.lists(st.sampled_from([-1.0, 0.0, 0.01, 0.05, 0.09, 0.5, np.nan]), min_size=12, max_size=12),
        min_size=1,
        max_size=4,
    ),
    st.integers(0, 4095),
    st.integers(0, 4095),
    st.integers(0, 3),
)
def test_runs_agree_with_one_by_one(own: list[list[float]], edges: int, losses: int, most: int) -> None:
    table = np.array(own, np.float32)
    bits = np.arange(12)
    beyond = np.where((edges >> bits) & 1, -1.0, table).astype(np.float32)
    lost = np.broadcast_to(((losses >> bits) & 1).astype(bool), table.shape) & np.isnan(table)
    threshold = np.full((1, 1), 0.08, np.float32)
    got = _runs(table, beyond, threshold, lost, most)
    assert np.array_equal(got, runs_one_by_one(table, beyond, 0.08, lost, most))
    none = np.zeros(table.shape, bool)
    assert np.array_equal(_runs(table, beyond, threshold), runs_one_by_one(table, beyond, 0.08, none, 0))


def test_the_surroundings_take_in_the_neighbours() -> None:
    empty = np.array([4.0, 4.0, 2.0, 5.0, np.inf, np.nan, 3.0])
    background = learned(partial(np.stack([empty] * 3)))
    around = surroundings(background, 1)
    assert around.near[0].tolist() == pytest.approx([4, 2, 2, 2, 5, np.nan, 3], nan_ok=True)
    assert around.far[0].tolist() == pytest.approx([4, 4, 5, np.inf, np.inf, np.nan, 3], nan_ok=True)
    assert around.returns[0].tolist() == [True, True, True, False, False, False, True]


# Two detections as one.


def test_objects_of_two_detections_are_ordered_and_numbered_anew() -> None:
    first, second = flat(), flat()
    first[5:10], first[40:45] = 2.0, 2.5
    second[20:25], second[50:55] = 1.5, 3.0
    rows = partial(np.stack([flat(), first, first]))
    a = detect(rows, WIDE, per_beam=True, within=rows.ranges < 3.5)
    other = partial(np.stack([second, second]))
    b = detect(other, WIDE, per_beam=True, within=other.ranges < 3.5)
    none = {"difference": np.zeros(4), "change": np.zeros(4, np.int8)}
    both = combine(replace(a, **none), replace(b, **none), np.array([0, 2]))  # type: ignore[arg-type]
    assert both.row.tolist() == [0, 0, 1, 1, 2, 2, 2, 2]
    assert both.object.tolist() == [1, 2, 1, 2, 1, 2, 3, 4]
    assert both.beam_i.tolist() == [20, 50, 5, 40, 5, 20, 40, 50]
    # What the second tells of is not in the sweeps.
    assert both.objects.tolist() == [0, 2, 2]
    assert both.object_beams.tolist() == [0, 10, 10]
    assert (both.object_beams + both.noise_beams).tolist() == [60] * 3
    assert both.beam_object is not None
    assert both.beam_set is not None
    assert both.beam_object[2, [5, 20, 40, 50, 0]].tolist() == [1, 0, 3, 0, 0]
    assert np.array_equal(both.beam_set == 0, both.beam_object > 0)
    for k in range(len(both)):
        vertices = both.vertex_theta[both.vertex_offsets[k] : both.vertex_offsets[k + 1]]
        assert (vertices[0], vertices[-1]) == pytest.approx((both.theta_i[k], both.theta_f[k]))
        faces = slice(*both.face_offsets[k : k + 2])
        assert both.face_theta_i[faces][0] == pytest.approx(both.theta_i[k])
        assert both.face_theta_f[faces][-1] == pytest.approx(both.theta_f[k])
    some = select(both, both.beam_i == 40)
    assert some.row.tolist() == [1, 2]
    assert some.vertex_r[some.vertex_offsets[:-1]] == pytest.approx([2.5, 2.5])


def test_walls_come_after_what_differs() -> None:
    empty, now = flat(120), flat(120)
    now[40:50] = 2.0
    found = found_in(partial(now), learned(partial(np.stack([empty] * 3))), parameters=replace(WIDE, walls=True))
    assert [SHAPES[code] for code in found.shape][1:] == ["wall", "wall"]
    assert found.change is not None
    assert found.change.tolist() == [APPEARED, -1, -1]
    assert found.difference is not None
    assert np.isnan(found.difference[1:]).all()
    assert found.object.tolist() == [1, 2, 3]
    assert (found.objects[0], found.object_beams[0]) == (1, 10)


def test_the_partition_of_every_sweep() -> None:
    """Def. 4: a beam belongs to what appeared or to the noise, also where it passes through what is gone."""
    rng = np.random.default_rng(7)
    background = learned(partial(4.0 + 0.02 * rng.standard_normal((40, 60))))
    ranges = 4.0 + 0.02 * rng.standard_normal((50, 60))
    for row in range(50):
        for factor in (0.5, 1.6):
            at = rng.integers(0, 50)
            ranges[row, at : at + rng.integers(2, 12)] *= factor
    batch = partial(ranges)
    sigma = noise(batch)
    difference: Difference = Subtraction(background, GONE).difference(batch, sigma)
    assert not (difference.appeared & difference.removed).any()
    found = changes(batch, difference, WIDE, sigma, per_beam=True)
    assert found.beam_object is not None
    assert found.change is not None
    assert {*found.change.tolist()} == {APPEARED, REMOVED}
    there = found.change == APPEARED
    per_sweep = np.bincount(found.row[there], found.beams[there], minlength=50)
    assert np.array_equal(per_sweep, found.object_beams)
    assert np.array_equal(np.bincount(found.row[there], minlength=50), found.objects)
    assert np.array_equal((found.beam_object > 0).sum(axis=1), found.object_beams)
    assert np.array_equal(found.object_beams + found.noise_beams, batch.beams)


@pytest.mark.parametrize("depth", [0.3, 0.6, 1.0])
@pytest.mark.parametrize("gaps", [0.0, 0.12])
def test_foliage_beside_a_wall_is_background(depth: float, gaps: float) -> None:
    """A bush before a wall that shows through it now and then, another leaf in every sweep."""
    rng = np.random.default_rng(8)

    def bush(count: int) -> SweepBatch:
        ranges = 4.0 + 0.01 * rng.standard_normal((count, 180))
        leaves = rng.uniform(4.0, 4.0 + depth, (count, 40))
        behind = 6.0 + 0.01 * rng.standard_normal(leaves.shape)
        ranges[:, 60:100] = np.where(rng.random(leaves.shape) < gaps, behind, leaves)
        return partial(ranges)

    found = found_in(bush(200), learned(bush(400)))
    assert found.beam_object is not None
    assert (found.beam_object > 0).mean() < 0.01


def test_padding_beyond_the_bearings_of_the_background_is_nothing() -> None:
    """Of a batch of several widths the sweeps of one may be picked: they keep the columns of the widest."""
    empty, now = flat(), flat()
    now[20:28] = 2.5
    batch = partial(np.stack([now] * 3))
    padding = ((0, 0), (0, 10))
    wide = replace(
        batch,
        ranges=np.pad(batch.ranges, padding, constant_values=np.nan),
        status=np.pad(batch.status, padding, constant_values=np.uint8(Status.PADDING)),
    )
    found = found_in(wide, learned(partial(np.stack([empty] * 5))))
    assert spans(found) == [(row, 20, 27) for row in range(3)]
