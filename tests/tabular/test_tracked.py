"""What tracking adds to rows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.formalism import SHAPES, Detection
from lidarcli.formalism.detection import AGENT, NOISE, WALL
from lidarcli.formalism.tracking.results import TrackedBatch
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular.columns import beams_rows, objects_rows, tracked_rows, tracks_rows
from tests.pipeline.patient import things
from tests.tabular.contract import CONTRACT
from tests.tabular.writing import STAMPS


def followed(batch: SweepBatch, detection: Detection, agents: list[int]) -> TrackedBatch:
    """The second object of the first sweep and the like are agents; the first object belongs to nothing."""
    count = len(detection)
    is_agent = np.isin(np.arange(count), agents)
    by_sweep = np.bincount(detection.row[is_agent], minlength=3).astype(np.int32)
    beams = np.bincount(detection.row[is_agent], detection.beams[is_agent], 3).astype(np.int32)
    nothing = np.arange(count) == 0
    return TrackedBatch(
        batch=batch,
        detection=detection,
        track=np.where(nothing, 0, 10 + np.arange(count)),
        vx=np.where(nothing, np.nan, 0.25),
        vy=np.where(nothing, np.nan, -0.5),
        moving=np.where(nothing, -1, is_agent).astype(np.int8),
        agent_score=np.where(nothing, np.nan, 0.75 * is_agent),
        set=np.where(is_agent, AGENT, detection.set).astype(np.uint8),
        shape=detection.shape,
        order=np.arange(count),
        object=detection.object,
        label=np.where(is_agent, 1, -1).astype(np.int32),
        label_score=np.where(is_agent, 0.5, np.nan),
        objects=detection.objects - by_sweep,
        agents=by_sweep,
        object_beams=detection.object_beams - beams,
        agent_beams=beams,
        noise_beams=detection.noise_beams,
    )


def without(found: TrackedBatch, refused: list[int]) -> TrackedBatch:
    """The same where some objects are pieces of building by all that was seen of them."""
    detection = found.detection
    building = np.isin(np.arange(len(detection)), refused)
    kind = np.where(building, NOISE, found.set).astype(np.uint8)
    order = np.lexsort((detection.theta_i, kind == NOISE, detection.row))
    number = np.empty(len(order), np.int32)
    for row in range(3):
        mine = order[detection.row[order] == row]
        number[mine] = np.arange(len(mine)) + 1
    lost = np.bincount(detection.row[building], detection.beams[building], 3).astype(np.int32)
    return replace(
        found,
        set=kind,
        shape=np.where(building, WALL, found.shape).astype(np.uint8),
        order=order,
        object=number,
        objects=found.objects - np.bincount(detection.row[building], minlength=3).astype(np.int32),
        object_beams=found.object_beams - lost,
        noise_beams=found.noise_beams + lost,
    )


def test_rows_of_objects(batch: SweepBatch, detection: Detection) -> None:
    before = objects_rows("run", batch, detection)
    found = followed(batch, detection, [1])
    rows = tracked_rows("objects", "run", found, ("box", "person"), walls=False, tracks=True)
    assert rows.schema.equals(before.schema)
    names = ("track", "set", "vx", "vy", "moving", "agent_score", "label", "label_score")
    assert [tuple(row[name] for name in names) for row in rows.to_pylist()] == [
        (None, "O", None, None, None, None, None, None),
        (11, "A", 0.25, -0.5, True, 0.75, "person", 0.5),
        (12, "O", 0.25, -0.5, False, 0.0, None, None),
        (13, "O", 0.25, -0.5, False, 0.0, None, None),
    ]
    others = [name for name in before.schema.names if name not in names]
    assert rows.select(others).equals(before.select(others))


def test_without_tracks_only_the_verdict_is_told(batch: SweepBatch, detection: Detection) -> None:
    before = objects_rows("run", batch, detection)
    rows = tracked_rows("objects", "run", followed(batch, detection, [1]), walls=False, tracks=False)
    assert rows.equals(before)


@pytest.mark.parametrize("walls", [False, True])
def test_what_is_building_after_all_is_wall_or_has_no_row(batch: SweepBatch, detection: Detection, walls: bool) -> None:
    found = without(followed(batch, detection, []), [0])
    rows = tracked_rows("objects", "run", found, walls=walls, tracks=True).to_pylist()
    here = [(row["object"], row["set"], row["shape"]) for row in rows if row["sweep"] == 0]
    shapes = [SHAPES[shape] for shape in detection.shape[detection.row == 0]]
    wall = [(len(shapes), "S", "wall")] if walls else []
    assert here == [(k, "O", shape) for k, shape in enumerate(shapes[1:], 1)] + wall
    beams = tracked_rows("beams", "run", found, walls=False, tracks=True).to_pylist()
    counts = tracked_rows("sweeps", "run", found, walls=False, tracks=True).to_pylist()[0]
    sets = [beam["set"] for beam in beams if beam["sweep"] == 0]
    assert (sets.count("O"), sets.count("S")) == (counts["object_beams"], counts["noise_beams"])
    assert counts["objects"] == len(shapes) - 1
    numbers = {beam["object"] for beam in beams if beam["sweep"] == 0} - {None}
    assert numbers == set(range(1, len(shapes)))


def test_sets_sum_over_the_tables(batch: SweepBatch, detection: Detection) -> None:
    """Def. 4: every beam is in O, A or S, and the tables agree on how many are in each."""
    found = followed(batch, detection, [1, 2])
    sweeps = tracked_rows("sweeps", "run", found, walls=False, tracks=True).to_pylist()
    beams = tracked_rows("beams", "run", found, walls=False, tracks=True).to_pylist()
    objects = tracked_rows("objects", "run", found, ("box", "person"), walls=False, tracks=True).to_pylist()
    for row in sweeps:
        here = [beam["set"] for beam in beams if beam["sweep"] == row["sweep"]]
        sums = (row["object_beams"], row["agent_beams"], row["noise_beams"])
        assert (here.count("O"), here.count("A"), here.count("S")) == sums
        assert sum(sums) == row["beams"]
        sets = [one["set"] for one in objects if one["sweep"] == row["sweep"]]
        assert (sets.count("O"), sets.count("A")) == (row["objects"], row["agents"])
    assert [row["agent_beams"] for row in sweeps] == [30, 0, 15]
    agents = {(beam["sweep"], beam["object"]) for beam in beams if beam["set"] == "A"}
    assert agents == {(0, 2), (2, 1)}


def test_beams_without_an_agent_stay_as_they_are(batch: SweepBatch, detection: Detection) -> None:
    rows = tracked_rows("beams", "run", followed(batch, detection, []), walls=False, tracks=True)
    assert rows.equals(beams_rows("run", batch, detection))


def test_rows_of_things() -> None:
    rows = tracks_rows("run", things(2, int(STAMPS[0]), 1), [("/scan", "laser")], ("box", "person"))
    assert rows.schema.names == [name for name, _ in CONTRACT["tracks"]]
    one, two = rows.to_pylist()
    assert (one["log"], one["topic"], one["frame_id"]) == ("run", "/scan", "laser")
    assert (one["track"], one["set"], one["label"], one["moved_at"], one["length"]) == (1, "O", None, None, None)
    assert (two["track"], two["set"], two["label"], two["label_score"]) == (2, "A", "person", 0.75)
    assert two["moved_at"].value == two["first_stamp"].value == STAMPS[0]
    assert (two["last_stamp"].value, two["shape"], two["end"]) == (STAMPS[0] + 10**9, "round", "lost")
