"""The truth tables agree with the sweeps and with each other."""

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from lidarcli.simulation import scene as make
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry, simulate_sweep_arrays
from lidarcli.simulation.route import Waypoint, plan_route
from lidarcli.simulation.scene import Course, Odometry, Scene, SceneMotion, SceneSensor
from lidarcli.simulation.truth import TRUTH, TRUTH_BEAMS, TruthWriter, truth_rows

THINGS = (
    make.wall([[-3, -3], [3, -3], [3, 3], [-3, 3], [-3, -3]]),
    make.box(-2.0, 0.0, 0.8, 0.4, 0.5, SceneMotion(velocity=(0.1, 0.0), yaw_rate=0.2)),
    make.cylinder(1.5, 1.0, 0.2, SceneMotion(appears=0.35)),
    make.cylinder(2.0, 4.0, 0.2),
)
SCENE = Scene("test", SceneSensor(noise=0.01, lost=0.01), THINGS, Course(np.array([[0.2, 0.1]]), yaw=0.05))


@pytest.fixture(scope="module")
def tables(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truth")
    with TruthWriter(folder / "truth", folder / "beams", SCENE, 4) as writer:
        for block in simulate_blocks(SCENE, 10, 4, size=3):
            writer.write(block)
    return pq.read_table(folder / "truth"), pq.read_table(folder / "beams")


def test_beams_hold_the_entity_of_every_beam(tables):
    _, entity, _ = simulate_sweep_arrays(SCENE, 10, 4)
    beams = tables[1]
    assert beams.schema.equals(TRUTH_BEAMS)
    assert beams["sweep"].to_pylist() == np.repeat(np.arange(10), 361).tolist()
    assert beams["beam"].to_pylist() == np.tile(np.arange(361), 10).tolist()
    assert beams["entity"].to_pylist() == entity.ravel().tolist()


def test_rows_count_exactly_the_beams(tables):
    truth, beams = tables
    assert truth.schema.equals(TRUTH)
    counted = (
        beams.filter(pc.greater_equal(beams["entity"], 0)).group_by(["sweep", "entity"]).aggregate([([], "count_all")])
    )
    expected = {(r["sweep"], r["entity"]): r["count_all"] for r in counted.to_pylist()}
    assert {(r["sweep"], r["entity"]): r["beams"] for r in truth.to_pylist()} == expected
    assert truth.select(["sweep", "entity"]).to_pylist() == [{"sweep": s, "entity": e} for s, e in sorted(expected)]


def test_who_is_there_and_where(tables):
    rows = tables[0].to_pylist()
    assert {row["entity"] for row in rows} == {0, 1, 2}
    assert {row["sweep"] for row in rows if row["entity"] == 2} == set(range(4, 10))
    assert {(row["entity"], row["kind"], row["wall"]) for row in rows} == {
        (0, "wall", True),
        (1, "box", False),
        (2, "cylinder", False),
    }
    box = [row for row in rows if row["entity"] == 1]
    for row in box:
        second = row["sweep"] / 10
        assert (row["world_x"], row["world_y"]) == pytest.approx((-2 + 0.1 * second, 0))
        assert row["world_yaw"] == pytest.approx(0.5 + 0.2 * second)
        dx, dy = row["world_x"] - 0.2, row["world_y"] - 0.1
        assert row["x"] == pytest.approx(np.cos(0.05) * dx + np.sin(0.05) * dy)
        assert row["y"] == pytest.approx(np.cos(0.05) * dy - np.sin(0.05) * dx)
        assert row["yaw"] == pytest.approx(row["world_yaw"] - 0.05)
        assert (row["length"], row["width"]) == (0.8, 0.4)
        assert (row["vx"], row["vy"], row["yaw_rate"], row["moving"]) == (0.1, 0.0, 0.2, True)
    for row in rows:
        if row["entity"] != 1:
            assert (row["vx"], row["vy"], row["yaw_rate"], row["moving"]) == (0.0, 0.0, 0.0, False)


def test_velocities_on_a_route_are_those_of_the_body():
    route = plan_route([Waypoint(2, -1, 1.0, wait=0.5), Waypoint(2, 1, 1.0)])
    scene = Scene("", SceneSensor(), (make.person(0, 0, motion=SceneMotion(route=route)),))
    (block,) = simulate_blocks(scene, 40)
    rows = truth_rows(block, scene).to_pylist()
    # Half a second of waiting, half to start, one and a half on the way, half to stop.
    assert [row["vy"] for row in rows] == pytest.approx(
        [0] * 5 + [0, 0.2, 0.4, 0.6, 0.8] + [1] * 15 + [1, 0.8, 0.6, 0.4, 0.2] + [0] * 10, abs=1e-9
    )
    assert [row["moving"] for row in rows] == [False] * 6 + [True] * 24 + [False] * 10
    assert {row["entity"] for row in rows} == {0}
    assert rows[-1]["beams"] == np.count_nonzero(block.entity[-1] == 0)
    assert rows[-1]["world_yaw"] == pytest.approx(np.pi / 2)


def test_bearings_of_an_entity_pass_the_seam(tables):
    truth, beams = tables
    entity = np.array(beams["entity"]).reshape(10, 361)
    bearing = np.radians(np.arange(-180, 181))
    for row in truth.to_pylist():
        if row["wall"]:
            assert row["theta_i"] is None
            assert row["theta_f"] is None
            continue
        mine = bearing[entity[row["sweep"]] == row["entity"]]
        centre = np.arctan2(row["y"], row["x"])
        offset = np.mod(mine - centre + np.pi, 2 * np.pi) - np.pi
        assert row["theta_f"] - row["theta_i"] == pytest.approx(np.ptp(offset), abs=1e-6)
        assert np.cos(row["theta_i"] - centre - offset.min()) == pytest.approx(1)
        assert -np.pi <= row["theta_i"] <= row["theta_f"]
    box = [row for row in truth.to_pylist() if row["entity"] == 1]
    assert all(row["theta_f"] > np.pi for row in box)


def test_an_empty_run_has_the_full_schema(tmp_path):
    with TruthWriter(tmp_path / "truth", tmp_path / "beams", SCENE, 0):
        pass
    assert pq.read_table(tmp_path / "truth").schema.equals(TRUTH)
    assert pq.read_table(tmp_path / "beams").num_rows == 0


def test_odometry_without_noise_is_the_truth_and_with_noise_drifts():
    course = Course(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]]), speed=0.5)
    exact = simulate_odometry(Scene("", SceneSensor(), (), course, Odometry()), 200)
    assert exact is not None
    true = course.poses(np.arange(200) / 10)
    np.testing.assert_allclose(exact.poses[:, :2], true[:, :2], atol=1e-9)
    np.testing.assert_allclose(np.cos(exact.poses[:, 2] - true[:, 2]), 1, atol=1e-9)
    finals = []
    for seed in range(200):
        noisy = simulate_odometry(Scene("", SceneSensor(), (), course, Odometry(noise=0.05)), 81, seed)
        assert noisy is not None
        finals.append(noisy.poses[-1, :2] - true[80, :2])
    # Four metres driven: the drift of one metre times the square root of four.
    assert np.std(finals) == pytest.approx(0.1, rel=0.15)
    assert simulate_odometry(SCENE, 10) is None
