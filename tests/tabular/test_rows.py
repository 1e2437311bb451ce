"""Rows of tables: of a detection, and what tracking adds to them."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from lidarcli.formalism import SETS, SHAPES, VERTEX_KINDS, VISIBILITIES, Detection, Parameters, detect
from lidarcli.formalism.detection import AGENT, NOISE, WALL
from lidarcli.formalism.tracking.results import TrackedBatch
from lidarcli.sweeps.types import Status, SweepBatch
from lidarcli.tabular.columns import beams_rows, objects_rows, sweeps_rows, tracked_rows, tracks_rows
from tests.pipeline.patient import things
from tests.tabular.contract import CONTRACT
from tests.tabular.writing import STAMPS


def test_object_rows_equal_the_detection(batch: SweepBatch, detection: Detection) -> None:
    rows = objects_rows("run", batch, detection).to_pylist()
    assert len(rows) == len(detection) >= 4
    for k, row in enumerate(rows):
        at = detection.row[k]
        assert (row["log"], row["topic"], row["sweep"]) == ("run", "/scan", at)
        assert row["frame_id"] == "abb"[at]
        assert row["stamp"].value == STAMPS[at]
        assert row["set"] == SETS[detection.set[k]]
        assert row["shape"] == SHAPES[detection.shape[k]]
        assert row["visibility"] == VISIBILITIES[detection.visibility[k]]
        for name, kind in CONTRACT["objects"]:
            value = getattr(detection, name, None)
            if value is not None and kind in ("double", "float", "int32") and name not in ("row",):
                expected = None if np.isnan(value[k]) else np.float32(value[k]) if kind == "float" else value[k]
                assert row[name] == expected, name
        first, last = detection.vertex_offsets[k : k + 2]
        assert row["vertices"] == [
            {
                "theta": np.float32(detection.vertex_theta[v]),
                "r": np.float32(detection.vertex_r[v]),
                "kind": VERTEX_KINDS[detection.vertex_kind[v]],
            }
            for v in range(first, last)
        ]
        first, last = detection.face_offsets[k : k + 2]
        lengths = detection.face_length[first:last].astype(np.float32).tolist()
        assert [face["length"] for face in row["faces"]] == lengths
        assert row["t"] == (STAMPS[at] - STAMPS[0]) / 1e9
        tracked = ("track", "vx", "vy", "moving", "agent_score", "label", "label_score")
        unknown = ("difference", "change", *tracked, "world_x", "world_y", "world_yaw")
        assert [row[name] for name in unknown] == [None] * 12


def test_single_precision_keeps_the_order(batch: SweepBatch, detection: Detection) -> None:
    nearest = sweeps_rows("run", batch, detection)["nearest"].to_pylist()
    for row in objects_rows("run", batch, detection).to_pylist():
        assert row["theta_i"] <= row["theta_min"] <= row["theta_f"]
        assert nearest[row["sweep"]] <= row["r_min"] <= min(row["r_i"], row["r_f"])
        assert row["box_width"] <= row["box_length"]
        theta = [vertex["theta"] for vertex in row["vertices"]]
        assert theta == sorted(theta)
        assert [(face["theta_i"], face["theta_f"]) for face in row["faces"]] == [*pairwise(theta)]


def test_an_unknown_intensity_is_null(batch: SweepBatch, detection: Detection) -> None:
    assert detection.intensity is not None
    some = detection.intensity.copy()
    some[::2] = np.nan
    column = objects_rows("run", batch, replace(detection, intensity=some))["intensity"]
    assert column.to_pylist() == [None if np.isnan(value) else value for value in some.tolist()]
    assert column.null_count == -(-len(some) // 2)
    bare = objects_rows("run", batch, replace(detection, intensity=None))["intensity"]
    assert (str(bare.type), bare.null_count) == ("float", len(some))


def test_sweep_rows_count_beams(batch: SweepBatch, detection: Detection) -> None:
    rows = sweeps_rows("run", batch, detection).to_pylist()
    assert [row["beams"] for row in rows] == [360, 360, 360]
    assert [row["t"] for row in rows] == [0.0, 0.1, 0.2]
    assert [(row["valid"], row["no_return"], row["too_close"], row["invalid"]) for row in rows] == [
        (359, 1, 0, 0),
        (360, 0, 0, 0),
        (359, 0, 0, 1),
    ]
    assert [row["objects"] for row in rows] == detection.objects.tolist()
    assert [row["d_mean"] for row in rows] == detection.d_mean.astype(np.float32).tolist()
    assert [row["d_th"] for row in rows] == detection.sweep_d_th.astype(np.float32).tolist()
    for row in rows:
        assert row["object_beams"] + row["agent_beams"] + row["noise_beams"] == row["beams"]


def test_beam_rows_leave_padding_out(batch: SweepBatch) -> None:
    status = batch.status.copy()
    status[1, 350:] = Status.PADDING
    padded = replace(batch, beams=np.array([360, 350, 360], np.int32), status=status)
    detection = detect(padded, Parameters(), per_beam=True)
    rows = beams_rows("run", padded, detection)
    assert rows.num_rows == 1070
    assert rows["beam"].to_pylist() == [*range(360), *range(350), *range(360)]
    assert set(rows["status"].to_pylist()) == {"valid", "no_return", "invalid"}
    assert rows["r"][5].as_py() is None
    in_object = [row for row in rows.to_pylist() if row["object"] is not None]
    assert {row["set"] for row in in_object} == {"O"}
    assert len(in_object) == detection.object_beams.sum()
    assert beams_rows("run", padded, detection)["theta"][0].as_py() == np.float32(padded.angle_min[0])


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
