"""Learning a background: a fold whose result depends neither on batches nor on order, stations, bounded memory."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.scenes.random import KINDS, SENSORS, random_scene, sensor_with
from lidarcli.formalism import learning as module
from lidarcli.formalism.background import Background, Grid, Shift, align, expected, gather, lines, project, shift
from lidarcli.formalism.learning import Estimate
from lidarcli.sweeps.types import TURN, SweepBatch, SweepPoses
from tests.formalism.backgrounds import STEP, learned, learning, partial, simulated, with_poses

PER_BEAM = [field.name for field in fields(Estimate)]


def equal(a: Background, b: Background) -> bool:
    same = all(np.array_equal(getattr(a, name), getattr(b, name), equal_nan=True) for name in PER_BEAM)
    return same and np.array_equal(a.sweeps, b.sweeps) and np.array_equal(a.poses.x, b.poses.x, equal_nan=True)


def room(sweeps: int, seed: int = 0, sensor: str = "361") -> SweepBatch:
    return simulated(random_scene("room", 3, sensor_with(SENSORS[sensor], 0.01, 0.003)), sweeps, seed)[0]


@pytest.fixture(scope="module")
def drive() -> SweepBatch:
    """A robot that drives past the same scene twice, with and without sweeps that have no pose."""
    batch = room(40)
    poses = np.zeros((40, 3))
    poses[:, 0] = np.tile(np.linspace(0.0, 1.0, 20), 2)
    poses[17] = np.nan
    return with_poses(batch, poses)


@pytest.mark.parametrize("size", [1, 7, 1024])
def test_the_batch_size_makes_no_difference(size: int, drive: SweepBatch) -> None:
    batch = room(60)
    assert equal(learned(batch, size), learned(batch))
    assert equal(learned(drive, size), learned(drive))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_r_e_is_the_scene(kind: str, noise: float) -> None:
    sensor = sensor_with(SENSORS["361"], noise, 0.01)
    scene = random_scene(kind, 3, sensor)  # type: ignore[arg-type]
    truth = simulated(replace(scene, sensor=SENSORS["361"]), 1, 0)[0].ranges[0]
    found = learned(simulated(scene, 200, 1)[0])
    known = ~np.isnan(truth)
    assert np.array_equal(np.isinf(found.r_e[0]), ~known)
    assert np.abs(found.r_e[0] - truth)[known].max() < noise / 2
    assert np.median(found.spread[0][known]) == pytest.approx(noise, rel=0.1)
    assert found.no_return[0][known].max() < 0.06


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("walking", [False, True])
def test_people_in_every_direction_for_thirty_percent(kind: str, walking: bool) -> None:
    """Each beam meets somebody in 30 % of the sweeps: one who stands there all that time, or many who pass."""
    sensor = sensor_with(SENSORS["361"], 0.03, 0.01)
    batch = simulated(random_scene(kind, 5, sensor), 200, 1)[0]  # type: ignore[arg-type]
    clean = learned(batch).r_e[0]
    reach = np.minimum(np.where(np.isfinite(clean), clean, 12.0), 12.0)
    rng = np.random.default_rng(4)
    ranges, status = batch.ranges.copy(), batch.status.copy()
    for beam in range(batch.width):
        rows = rng.permutation(200)[:60] if walking else (np.arange(60) + 7 * (beam // 20)) % 200
        place = rng.uniform(0.3, 0.95, 60) if walking else np.full(60, 0.3 + 0.06 * (beam // 20 % 11))
        ranges[rows, beam] = reach[beam] * place + 0.03 * rng.standard_normal(60)
        status[rows, beam] = 0
    crowded = learned(replace(batch, ranges=ranges, status=status)).r_e[0]
    open_still = np.isinf(crowded) & np.isinf(clean)
    with np.errstate(invalid="ignore"):
        near = np.abs(crowded - clean) <= 0.02
    assert np.mean(near | open_still) >= 0.99


def test_a_sensor_that_moves_without_poses_seems_to_have_moved() -> None:
    """Towards a wall, from 6 to 2 m."""
    away = np.linspace(6.0, 2.0, 80)
    batch = partial(away[:, None] / np.cos(np.deg2rad(np.arange(-30, 30))))
    assert learned(batch).seems_moved
    # With poses every place has a background of its own.
    poses = np.column_stack([6.0 - away, np.zeros(80), np.zeros(80)])
    assert not learned(with_poses(batch, poses)).seems_moved


def test_memory_is_bounded(monkeypatch: pytest.MonkeyPatch, drive: SweepBatch) -> None:
    monkeypatch.setattr(module, "MAX_CELLS", 361 * 2)
    state = learning(drive, 5)
    assert state.stations <= 2
    assert state.left_out > 10
    assert state.background().sweeps.sum() + state.left_out == 40
    monkeypatch.setattr(module, "MAX_CELLS", 2000)
    monkeypatch.setattr(module, "MAX_PENDING", 10)
    crowded = room(400, seed=2)
    rng = np.random.default_rng(0)
    crowded = replace(crowded, ranges=rng.uniform(1, 9, crowded.ranges.shape).astype(np.float32))
    state = learning(crowded, 4)
    assert state.left_out > 300


# Stations, slowly.


def opened_one_by_one(poses: NDArray[np.float64], distance: float, angle: float) -> tuple[list[int], list[int]]:
    """Each pose goes to the nearest station, or opens one; the reference for `gather`."""
    stations: list[int] = []
    chosen = []
    for i, (x, y, yaw) in enumerate(poses):
        best, least = -1, np.inf
        for number, row in enumerate(stations):
            apart = np.hypot(x - poses[row, 0], y - poses[row, 1])
            turn = abs((yaw - poses[row, 2] + np.pi) % TURN - np.pi)
            cost = (apart / distance) ** 2 + (turn / angle) ** 2
            if apart <= distance and turn <= angle and cost < least:
                best, least = number, cost
        if best < 0:
            stations.append(i)
            best = len(stations) - 1
        chosen.append(best)
    return chosen, stations


@pytest.mark.parametrize("cut", [0, 13, 60])
def test_gather_agrees_with_one_by_one(cut: int) -> None:
    rng = np.random.default_rng(5)
    poses = np.column_stack([rng.uniform(0, 1, (60, 2)), rng.uniform(3.0, 3.4, 60)])
    expected_station, opened = opened_one_by_one(poses, 0.3, 0.15)
    places = SweepPoses(*np.empty((3, 0)), np.empty(0, bool))
    station: list[int] = []
    for part in (poses[:cut], poses[cut:]):
        some, places = gather(SweepPoses(*part.T, np.zeros(len(part), bool)), places, 0.3, 0.15, 1000)
        station += some.tolist()
    assert station == expected_station
    assert places.x.tolist() == poses[opened, 0].tolist()


# Seen from elsewhere.


@pytest.mark.parametrize("upside_down", [False, True])
def test_a_shift_takes_points_to_where_the_station_sees_them(upside_down: bool) -> None:
    rng = np.random.default_rng(6)
    flip = np.full(2, upside_down)
    x, y, yaw = rng.uniform(-1, 1, (3, 2))
    both = SweepPoses(x, y, yaw, flip)
    moved = shift(both.rows(np.array([0])), both.rows(np.array([1])))
    point = np.array([1.3, 0.4])
    c, s = np.cos(moved.yaw[0]), np.sin(moved.yaw[0])
    seen = np.array([c * point[0] - s * point[1] + moved.x[0], s * point[0] + c * point[1] + moved.y[0]])
    for row, (px, py) in ((0, point), (1, seen)):
        world = both.to_world(np.array([row]), np.array([px]), np.array([py]), np.zeros(1))
        if row == 0:
            first = world[:2]
    assert np.allclose(first, world[:2])


def test_project_and_expected_undo_each_other() -> None:
    batch = room(1, sensor="720")
    grid = Grid.of(batch, 0)
    none = Shift(np.zeros(1), np.zeros(1), np.zeros(1))
    beam, ranges = project(batch, grid, none)
    known = ~np.isnan(batch.ranges[0])
    assert beam[0][known].tolist() == np.flatnonzero(known).tolist()
    seen = expected(batch, grid, ranges, none)
    assert seen[0][known] == pytest.approx(batch.ranges[0][known])
    turned = Shift(np.zeros(1), np.zeros(1), np.array([10 * grid.angle_increment]))
    assert project(batch, grid, turned)[0][0][known].tolist() == ((np.flatnonzero(known) + 10) % 720).tolist()
    assert np.roll(seen[0], -10) == pytest.approx(expected(batch, grid, ranges, turned)[0], nan_ok=True)


def test_sweeps_are_laid_onto_a_station() -> None:
    """A sensor 12 cm and 2 degrees off what its odometry says is put right to a centimetre and a tenth of a degree."""
    sensor = sensor_with(SENSORS["720"], 0.01, 0.003)
    scene = random_scene("room", 3, sensor)
    first = simulated(replace(scene, sensor=SENSORS["720"]), 1, 0)[0]
    grid = Grid.of(first, 0)
    x, y = scene.path.points[0]
    cos, sin = np.cos(scene.path.yaw), np.sin(scene.path.yaw)
    true = np.array([[0.1, -0.06, 0.05], [-0.15, 0.1, -0.04], [0.0, 0.0, 0.0]])
    for dx, dy, turn in true:
        points = np.array([[x + cos * dx - sin * dy, y + sin * dx + cos * dy]])
        course = replace(scene.path, points=points, yaw=scene.path.yaw + turn)
        batch = simulated(replace(scene, path=course), 1, 1)[0]
        start = Shift(np.array([dx + 0.1]), np.array([dy - 0.07]), np.array([turn + 0.035]))
        got = align(batch, grid, lines(grid, first.ranges.astype(float)), np.zeros(1, np.int64), start)
        assert np.hypot(got.x - dx, got.y - dy)[0] < 0.01
        assert abs(got.yaw[0] - turn) < np.deg2rad(0.1)


def test_lines_are_exact_on_a_wall() -> None:
    batch = partial(2.0 / np.cos((np.arange(81) - 40.5) * STEP))
    grid = Grid.of(batch, 0)
    found = lines(grid, batch.ranges.astype(float))
    inner = slice(10, -10)
    assert found.offset[0, inner] == pytest.approx(2.0, abs=0.002)
    assert found.normal_x[0, inner] == pytest.approx(1.0, abs=1e-3)
    assert np.isnan(found.offset[0, :2]).all()
