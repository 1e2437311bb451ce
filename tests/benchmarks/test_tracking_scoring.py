"""The scoring of `make tracking`, on cases small enough to count by hand, and the truth of a simulated log."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.tracking.bodies import bodies
from benchmarks.tracking.cells import Cell
from benchmarks.tracking.methods import ORACLE, OURS, PARAMETERS, Result, follow
from benchmarks.tracking.recordings import Detected, Recording, detected, in_batches, majority, record_cell, simulate
from benchmarks.tracking.scoring import Share, score, too_small, undetected
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course, Scene, SceneMotion, SceneSensor
from lidarcli.sweeps.types import Float64

WALL, BOX, MOVER = 0, 1, 2


def scene(*, turned: float = 0.0, driven: bool = False) -> Scene:
    """A wall, a box that stands, and a box that goes along y with 0.5 m/s."""
    things = (
        make.wall([[-4, 4], [4, 4], [4, -4]]),
        make.box(2.0, -1.0, 0.4, 0.4),
        make.box(2.5, 0.5, 0.4, 0.3, motion=SceneMotion((0.0, 0.5))),
    )
    path = Course(np.array([[0.0, 0.0], [1.0, 0.0]]), 0.5) if driven else Course(np.zeros((1, 2)), yaw=turned)
    return Scene("three things", SceneSensor(), things, path, sweeps=20)


def found_in(recording: Recording) -> Detected:
    return detected(in_batches(recording.batch), PARAMETERS, recording.entity)


def judged(found: Detected, *, track: list[int], agent: list[bool], speed: Float64) -> Result:
    """A method that says the same of each entity at all times."""
    return Result(np.array(track)[found.entity], speed[found.entity], np.array(agent)[found.entity], 1.0)


def test_the_entity_of_most_beams() -> None:
    labels = np.array([[0, 0, 0, 1, 1, -1, 2]])
    assert majority(labels, np.array([[4, 4, 3, 6, 5, 5, -1]]), 3).tolist() == [4, 5, -1]


def test_what_is_not_detected_or_too_small() -> None:
    truth = np.array([[0, 0, 1, 1, 1, -1]])
    nothing = np.empty(0, np.int64)
    found = Detected([], [], np.array([0, 0]), nothing, np.array([1, -1]), 0.0)
    assert undetected(truth, found).tolist() == [[True, True, False, False, False, False]]
    assert too_small(truth).tolist() == [[True, True, False, False, False, False]]


def test_velocities_are_those_of_the_sensors_axes_without_poses() -> None:
    still = simulate(scene(turned=np.pi / 2), 0, poses=False)
    assert still.batch.poses is None
    assert still.velocity[0, MOVER] == pytest.approx([0.5, 0.0])
    assert simulate(scene(turned=np.pi / 2), 0, poses=True).velocity[0, MOVER] == pytest.approx([0.0, 0.5])


def test_late_poses_are_those_of_before() -> None:
    true = simulate(scene(driven=True), 0, poses=True).batch.poses
    late = simulate(scene(driven=True), 0, poses=True, delay=0.1).batch.poses
    assert true is not None
    assert late is not None
    assert late.x[1:] == pytest.approx(true.x[:-1])
    assert true.x[1:3] == pytest.approx([0.05, 0.1])


def test_drift_grows_with_the_way() -> None:
    true = simulate(scene(driven=True), 0, poses=True).batch.poses
    poor = simulate(scene(driven=True), 0, poses=True, drift=0.01).batch.poses
    assert true is not None
    assert poor is not None
    assert poor.x[0] == true.x[0]
    assert 0 < np.hypot(poor.x[-1] - true.x[-1], poor.y[-1] - true.y[-1]) < 0.1


def test_the_truth_about_each_object_is_right() -> None:
    recording = simulate(scene(), 0, poses=False)
    found = found_in(recording)
    assert set(found.entity.tolist()) == {BOX, MOVER}
    one = score(recording, found, follow(ORACLE, recording, found))
    assert (one.agreement.idf1, one.agreement.switches, one.agreement.entities) == (1.0, 0, 2)
    assert one.agreement.hota > 0.95
    assert (one.movers_in_a, one.standing_in_a) == (Share(20, 20), Share(0, 20))
    assert one.moving_errors.tolist() == [0.0] * 20


def test_errors_and_shares() -> None:
    recording = simulate(scene(), 0, poses=False)
    found = found_in(recording)
    speed = np.array([[0.0, 0.0], [0.1, 0.0], [0.3, 0.1]])
    one = score(recording, found, judged(found, track=[0, 1, 2], agent=[False, True, False], speed=speed))
    assert one.standing_errors == pytest.approx([0.1] * 20)
    assert one.moving_errors == pytest.approx([0.5] * 20)
    assert (one.movers_in_a, one.standing_in_a) == (Share(0, 20), Share(20, 20))
    # A mover that nobody follows is not in A, and has no velocity.
    one = score(recording, found, judged(found, track=[0, 1, 0], agent=[False, False, False], speed=speed))
    assert (one.movers_in_a, len(one.moving_errors)) == (Share(0, 20), 0)


def test_every_method_answers_for_every_object() -> None:
    recording = record_cell(Cell("room", "361", 0.01, "driving"), 5)
    found = found_in(recording)
    told = follow(OURS, recording, found)
    assert len(told.track) == len(told.velocity) == len(told.agent) == len(found.row)
    assert told.tracks is not None
    known = bodies(recording, found, told)
    assert len(known.length_errors) == len(known.width_errors)
