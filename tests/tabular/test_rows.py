"""Rows equal the detection."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from lidarcli.formalism import SETS, SHAPES, VERTEX_KINDS, VISIBILITIES, Detection, Parameters, detect
from lidarcli.sweeps.types import Status, SweepBatch
from lidarcli.tabular.columns import beams_rows, objects_rows, sweeps_rows
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
