"""r_w - r_e: which beams leave the background, and the objects that they make, on sweeps with plain answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from lidarcli.formalism import Detection, sweep
from lidarcli.formalism.detection import APPEARED, REMOVED, VISIBILITIES
from lidarcli.formalism.subtraction import Tolerance
from lidarcli.sweeps.types import TURN, SweepBatch
from tests.formalism.backgrounds import found_in, learned, partial, with_poses

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
