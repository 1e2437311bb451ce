"""Judging by eye: what is judged, how it is written down, and how methods are held against it."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from benchmarks.annotations import buildings, crossed, flicker
from benchmarks.annotations.choice import CHOSEN
from benchmarks.annotations.methods import from_rows
from benchmarks.annotations.pieces import pieces
from benchmarks.annotations.scoring import Counts, count
from benchmarks.annotations.table import (
    BUILDING,
    NOT_JUDGED,
    OWN,
    PLACES,
    STRAY,
    THING,
    UNCLEAR,
    Judged,
    Stretch,
    Sweep,
    answered,
    read,
    write,
)
from lidarcli.formalism import Parameters, detect, sweep
from lidarcli.simulation import scene as make
from lidarcli.simulation.scene import Course
from lidarcli.sweeps import TURN, SweepBatch
from tests.formalism.tracking.following import scene_of, simulated


def board_before_a_wall() -> SweepBatch:
    """A wall 4 m ahead with a board before it, and two lost beams."""
    bearings = -0.6 + 0.01 * np.arange(121)
    ranges = 4.0 / np.cos(bearings)
    ranges[50:70] = 2.0 / np.cos(bearings[50:70])
    ranges[20:22] = np.nan
    return sweep(ranges, angle_min=-0.6, angle_increment=0.01)


def test_pieces_end_at_steps_and_not_at_few_lost_beams() -> None:
    found = pieces(board_before_a_wall(), 0)
    assert [(piece.first, piece.last, len(piece.beams)) for piece in found] == [(0, 49, 48), (50, 69, 20), (70, 120, 51)]


def test_pieces_end_at_corners_and_may_lie_across_the_seam() -> None:
    bearings = -np.pi + TURN / 720 * np.arange(720)
    ranges = np.minimum(2.0 / np.abs(np.cos(bearings)), 2.0 / np.maximum(np.abs(np.sin(bearings)), 1e-9))
    found = pieces(sweep(ranges, angle_min=-np.pi, angle_increment=TURN / 720), 0)
    # The four walls of a room; one of them lies behind the sensor, where the sweep begins and ends.
    assert sum(len(piece.beams) for piece in found) == 720
    assert 4 <= len(found) <= 5
    assert any(piece.first > piece.last for piece in found) or len(found) == 5


def test_answers_are_read_and_written(tmp_path: Path) -> None:
    batch = board_before_a_wall()
    found = pieces(batch, 0)
    text = "thing 1\nthing 2[80-89]\nunclear 0[0-9]\nown 0[40-49]\nplace lab\n"
    place, verdict, thing = answered(text, found, ~np.isnan(batch.ranges[0]))
    assert place == "lab"
    assert (verdict[50:70] == THING).all()
    assert (thing[50:70] == 1).all()
    assert (thing[80:90] == 2).all()
    assert (verdict[0:10] == UNCLEAR).all()
    assert (verdict[40:50] == OWN).all()
    assert (verdict[90:] == BUILDING).all()
    assert (verdict[20:22] == NOT_JUDGED).all()
    path = tmp_path / "labels.csv"
    write(path, [Judged("a.bag", "/scan", 7, place, verdict, thing)])
    (again,) = read(path)
    assert (again.log, again.topic, again.sweep, again.place) == ("a.bag", "/scan", 7, "lab")
    beams, numbers = again.beams(121)
    known = verdict != NOT_JUDGED
    np.testing.assert_array_equal(beams[known], verdict[known])
    np.testing.assert_array_equal(numbers[known], thing[known])
    # The two lost beams lie within the wall.
    assert (beams[20:22] == BUILDING).all()


def test_a_stray_beam_has_no_verdict_of_its_neighbours(tmp_path: Path) -> None:
    """One to three beams with a range that lie in no piece, amid a wall of one verdict."""
    bearings = -0.6 + 0.01 * np.arange(121)
    ranges = 4.0 / np.cos(bearings)
    strays = [20, 40, 41, 60]
    ranges[strays] = [3.0, 2.5, 1.5, 6.0]
    ranges[59] = ranges[80] = np.nan
    batch = sweep(ranges, angle_min=-0.6, angle_increment=0.01)
    place, verdict, thing = answered("place room\n", pieces(batch, 0), ~np.isnan(ranges))
    assert np.flatnonzero(verdict == STRAY).tolist() == strays
    assert np.flatnonzero(verdict == NOT_JUDGED).tolist() == [59, 80]
    write(tmp_path / "labels.csv", [Judged("a.bag", "/scan", 7, place, verdict, thing)])
    (again,) = read(tmp_path / "labels.csv")
    stretches = [(each.first, each.last) for each in again.stretches]
    assert stretches == [(0, 19), (21, 39), (42, 58), (61, 120)]


@pytest.mark.parametrize("text", ["place hall\n", "thing 9\nplace lab\n", "chair 1\nplace lab\n", "thing 1\n"])
def test_answers_that_say_nothing_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="no "):
        answered(text, pieces(board_before_a_wall(), 0), np.ones(121, bool))


def test_detections_are_held_against_what_was_judged() -> None:
    verdict = np.full(100, BUILDING)
    verdict[10:20] = verdict[40:50] = THING
    thing = np.zeros(100, np.int64)
    thing[10:20], thing[40:50] = 1, 2
    verdict[80:90] = OWN
    labels = np.zeros(100, np.int64)
    labels[10:20] = 1
    labels[44:50] = 2
    labels[60:70] = 3
    labels[80:90] = 4
    # What is on the robot itself counts neither way.
    assert count(labels, verdict, thing) == Counts(detections=3, right=2, things=2, found=2)
    labels[40:50] = 0
    labels[47:50] = 2
    assert count(labels, verdict, thing) == Counts(detections=3, right=2, things=2, found=1)
    labels[10:40] = 1
    assert count(labels, verdict, thing) == Counts(detections=3, right=1, things=2, found=0)


def test_what_is_gone_in_the_next_sweep_flickers() -> None:
    still = board_before_a_wall()
    rows = np.repeat(still.ranges, 3, axis=0)
    batch = sweep(rows, angle_min=-0.6, angle_increment=0.01)

    def table(sweeps: list[int], x: list[float], shape: list[str]) -> pa.Table:
        values = {"sweep": sweeps, "x": x, "y": [0.0] * len(x), "beams": [20] * len(x), "shape": shape}
        return pa.table(values)

    steady = flicker.measure(table([0, 1, 2], [2.0, 2.1, 2.0], ["round"] * 3), [batch])
    assert (steady.detections, steady.lost, steady.pairs, steady.reshaped) == (2, 0, 2, 0)
    gone = flicker.measure(table([0, 2], [2.0, 2.0], ["round"] * 2), [batch])
    assert (gone.detections, gone.lost, gone.share) == (1, 1, 1.0)
    other = flicker.measure(table([0, 1], [2.0, 2.0], ["round", "irregular"]), [batch])
    assert (other.pairs, other.reshaped_share) == (1, 1.0)
    # A sensor that moves tells nothing.
    driven = sweep(rows + np.array([[0.0], [0.3], [0.6]]), angle_min=-0.6, angle_increment=0.01)
    assert flicker.measure(table([0, 2], [2.0, 2.0], ["round"] * 2), [driven]).detections == 0


def test_a_box_around_free_space_is_told() -> None:
    batch = board_before_a_wall()
    found = detect(batch)
    assert crossed.crossed_share(batch, found).max() < 0.2
    assert crossed.measure(batch, found, 2.0) == crossed.Boxes(1, 0, 0)
    assert crossed.measure(batch, found, 0.1).too_long == 1
    behind = found.box_x.copy()
    found.box_x[:] = 1.0
    assert crossed.crossed_share(batch, found).min() > 0.9
    found.box_x[:] = behind


def test_labels_from_rows_go_past_the_seam() -> None:
    batch = sweep(np.full(10, 2.0), angle_min=-np.pi, angle_increment=TURN / 10)
    rows = pa.table({"sweep": [0, 0], "object": [1, 2], "beam_i": [3, 8], "beam_f": [5, 1]})
    found = from_rows(rows, [batch], frozenset({0}))
    assert found[0].tolist() == [2, 2, 0, 1, 1, 1, 0, 0, 2, 2]


def test_whole_logs_are_on_one_side_and_the_table_is_what_was_chosen() -> None:
    sides: dict[str, set[str]] = {}
    for chosen in CHOSEN:
        sides.setdefault(chosen.log, set()).add(chosen.side)
    assert all(len(each) == 1 for each in sides.values())
    assert len({chosen.name for chosen in CHOSEN}) == len(CHOSEN)
    told = read()
    known = {(chosen.log, chosen.topic) for chosen in CHOSEN}
    assert {(each.log, each.topic) for each in told} == known
    assert len(told) >= 120
    assert len({each.log for each in told}) >= 18
    assert {each.place for each in told} <= set(PLACES)
    side = {(chosen.log, chosen.topic): chosen.side for chosen in CHOSEN}
    assert Counter(side[each.log, each.topic] for each in told) == {"tuning": 85, "reporting": 139}
    for each in told:
        ends = [(stretch.first, stretch.last) for stretch in each.stretches]
        assert all(first <= last for first, last in ends)
        assert all(a[1] < b[0] for a, b in zip(sorted(ends), sorted(ends)[1:], strict=False))


def test_the_map_labels_what_is_on_its_lines_and_what_stands_in_free_space() -> None:
    """A cupboard amid a room, whose wall is seen in strips past a fence; by eye all of one sweep is building."""
    cupboard = make.box(0.0, 0.6, 0.9, 0.45)
    fence = [make.box(-4.0 + 0.9 * k, 3.1, 0.5, 0.3) for k in range(9)]
    drive = Course(np.array([[-3.0, -2.0], [3.0, -2.0], [3.0, 2.0], [-3.0, 2.0]]), speed=1.0)
    batch = simulated(scene_of(cupboard, *fence, path=drive), 240)
    found = detect(batch, Parameters(min_thing=0.0), per_beam=True)
    assert batch.poses is not None
    x, y, _ = batch.poses.to_world(found.row, found.box_x, found.box_y, found.box_yaw)
    sweep_20 = Sweep("log", "scan", 20, "room", (Stretch(0, batch.width - 1, BUILDING, 0),))
    told = buildings.measure([batch], {20: sweep_20})
    wall = int(np.sum(y > 3.7))
    assert wall > 900
    assert abs(told.count(BUILDING) - wall) < 0.03 * wall
    assert told.count(THING) >= np.sum(np.hypot(x, y - 0.6) < 0.5) > 200
    assert told.kept(BUILDING, 0.0) == 1.0
    assert told.building_kept(told.votes) < told.building_kept(told.sweep)
    assert 0 < told.right < told.judged
