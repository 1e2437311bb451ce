"""One log with intensities, written in every container that has a place for them, gives them back."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests.places import SAMPLES
from tests.sweeping import raw_sweeps
from tests.text_logs import write_log
from tools.fuzz.containers import poses

ROWS, BEAMS = 6, 11
WITH = ("rostopic", "ros2", "plotjuggler", "bagpy", "mcap", "list")
"""Layouts of a CSV that have a place for intensities."""

CASES: dict[str, tuple[str, dict[str, Any]]] = {
    **{f"mcap-{encoding}": ("run.mcap", {"encoding": encoding}) for encoding in ("cdr", "ros1", "json", "protobuf")},
    "bag": ("run.bag", {}),
    "db3": ("run.db3", {}),
    "folder": ("run", {}),
    "folder-mcap": ("run", {"container": "ros2-mcap"}),
    **{f"csv-{layout}": ("run.csv", {"layout": layout}) for layout in WITH},
    "rawlaser": ("run.log", {}),
    "jsonl": ("run.jsonl", {}),
}


def lit(topic: str = "/scan") -> RawSweeps:
    """Sweeps whose beams all have another intensity, one of which is not known; one sweep has fewer beams."""
    ranges = np.linspace(1.0, 5.0, ROWS * BEAMS).reshape(ROWS, BEAMS)
    ranges[:, 4] = np.nan
    intensities = (np.arange(ROWS * BEAMS).reshape(ROWS, BEAMS) + 0.5).astype(np.float32)
    intensities[2, 3] = np.nan
    beams = np.full(ROWS, BEAMS, np.int32)
    beams[3] = BEAMS - 2
    intensities[3, BEAMS - 2 :] = np.nan
    ranges[3, BEAMS - 2 :] = np.nan
    raw = raw_sweeps(ranges, topic=topic, angle_min=-1.0, angle_increment=0.2, beams=beams)
    return replace(raw, intensities=intensities)


def read(path: Path, topic: str | None = None) -> tuple[RawSweeps, ReadReport]:
    report = ReadReport()
    with open_log(path) as log:
        blocks = [block for block in log.scans(None, report) if topic in (None, block.topic)]
    return concatenate(blocks), report


@pytest.mark.parametrize("case", CASES)
def test_intensities_come_back(case: str, tmp_path: Path) -> None:
    name, options = CASES[case]
    raw = lit()
    write_log(tmp_path / name, [raw.rows(slice(0, 2)), raw.rows(slice(2, None))], **options)
    found, report = read(tmp_path / name)
    assert (report.damage, report.refused) == ([], {})
    assert found.beams.tolist() == raw.beams.tolist()
    np.testing.assert_array_equal(found.ranges, raw.ranges)
    np.testing.assert_array_equal(found.intensities, raw.intensities)


@pytest.mark.parametrize("case", CASES)
def test_sweeps_with_and_without_intensities_on_one_topic(case: str, tmp_path: Path) -> None:
    name, options = CASES[case]
    raw = lit()
    bare = replace(raw.rows(slice(0, 2)), intensities=None)
    if case == "csv-bagpy":
        # Its columns are those of the whole file.
        bare = replace(bare, intensities=np.full(bare.ranges.shape, np.nan, np.float32))
    write_log(tmp_path / name, [bare, raw.rows(slice(2, None))], **options)
    (batch,) = lidarcli.read(tmp_path / name)
    assert batch.intensities is not None
    assert raw.intensities is not None
    assert np.isnan(batch.intensities[:2]).all()
    np.testing.assert_array_equal(batch.intensities[2:], raw.intensities[2:])


def test_remissions_are_lines_of_their_own(tmp_path: Path) -> None:
    """With poses: sweeps with remissions are another kind of line than those without, hence another topic."""
    raw = replace(lit(), beams=np.full(ROWS, BEAMS, np.int32))
    bare = replace(raw.rows(slice(0, 2)), intensities=None)
    write_log(tmp_path / "run.log", [bare, raw.rows(slice(2, None))], poses=poses())
    found, report = read(tmp_path / "run.log", "/front_laser_remission")
    assert (report.damage, report.refused) == ([], {})
    np.testing.assert_array_equal(found.ranges, raw.ranges[2:])
    assert raw.intensities is not None
    np.testing.assert_array_equal(found.intensities, raw.intensities[2:])
    found, _ = read(tmp_path / "run.log", "/front_laser")
    np.testing.assert_array_equal(found.ranges, raw.ranges[:2])
    assert found.intensities is None


@pytest.mark.parametrize("case", CASES)
def test_sweeps_without_intensities_come_back_without(case: str, tmp_path: Path) -> None:
    """Also from layouts of a CSV that have a place for them, which is filled with zeros."""
    name, options = CASES[case]
    write_log(tmp_path / name, [replace(lit(), intensities=None)], **options)
    (batch,) = lidarcli.read(tmp_path / name)
    assert batch.intensities is None


def test_several_topics_of_one_table(tmp_path: Path) -> None:
    """Columns of one scan do not go to another."""
    front, rear = lit(), replace(lit("/rear"), intensities=None)
    write_log(tmp_path / "run.csv", [front, rear], layout="plotjuggler")
    assert read(tmp_path / "run.csv", "/rear")[0].intensities is None
    np.testing.assert_array_equal(read(tmp_path / "run.csv", "/scan")[0].intensities, front.intensities)


@pytest.mark.parametrize(
    ("cells", "kept"),
    [
        ("7,8,9", [7.0, 8.0, 9.0]),
        ("7,,9", [7.0, np.nan, 9.0]),
        ("7,bright,9", [np.nan] * 3),
        ("nan,inf,9", [np.nan, np.inf, 9.0]),
    ],
)
def test_cells_that_are_no_intensity_cost_no_sweep(cells: str, kept: list[float], tmp_path: Path) -> None:
    names = [f"{name}_{beam}" for name in ("ranges", "intensities") for beam in range(3)]
    head = ["Time", "header.frame_id", "angle_min", "angle_max", "angle_increment", *names]
    rows = [f"17000000{row}.0,laser,-0.5,0.5,0.5,1,2,3,{cells}" for row in range(10, 13)]
    (tmp_path / "run.csv").write_text("\n".join([",".join(head), *rows, ""]))
    found, report = read(tmp_path / "run.csv")
    assert (found.ranges.tolist(), report.damage) == ([[1.0, 2.0, 3.0]] * 3, [])
    if np.isnan(kept).all():
        assert found.intensities is None or np.isnan(found.intensities).all()
    else:
        np.testing.assert_array_equal(found.intensities, np.float32([kept] * 3))


def test_remissions_that_are_odd_cost_no_sweep(tmp_path: Path) -> None:
    """None that is a number, more, fewer; where their number does not fit, that of the ranges is doubted, too."""
    head = "RAWLASER1 0 -1.0 2.0 0.5 80.0 0.01 0 3 1.0 2.0 3.0"
    tails = ["3 7 8 9", "3 a b c", "4 7 8 9 10", "2 7 8", "0", "99 7 8 9", "x"]
    lines = [f"{head} {tail} {second}.5 nohost {second}.5\n" for second, tail in enumerate(tails, 1)]
    (tmp_path / "run.log").write_text("# CARMEN Logfile\n" + "".join(lines))
    found, report = read(tmp_path / "run.log")
    assert found.ranges.tolist() == [[1.0, 2.0, 3.0]] * 5
    assert [one.place for one in report.damage] == ["line 7", "line 8"]
    nothing = [np.nan] * 3
    kept = [[7, 8, 9], nothing, [7, 8, 9], [7, 8, np.nan], nothing]
    np.testing.assert_array_equal(found.intensities, np.float32(kept))


@pytest.mark.parametrize("value", ['"bright"', '["x"]', "7", '{"a": 1}', "[1e999, [2]]", "null"])
def test_json_that_holds_no_intensities_costs_no_sweep(value: str) -> None:
    from lidarcli.logs.foxglove import decode_each, decode_json

    text = '{"timestamp": {"sec": 1, "nsec": 0}, "start_angle": 0, "end_angle": 1, "ranges": [1, 2], "intensities": %s}'
    report = ReadReport()
    good = text % "[5, 6, 7]"
    (block,) = decode_each("/scan", [(0, (text % value).encode()), (1, good.encode())], decode_json, report)
    assert block.ranges.tolist() == [[1.0, 2.0]] * 2
    np.testing.assert_array_equal(block.intensities, np.float32([[np.nan] * 2, [5, 6]]))
    assert not report.refused


def test_objects_of_a_scene_have_the_intensity_that_it_tells(tmp_path: Path) -> None:
    table = lidarcli.detect(SAMPLES / "reflectors.mcap")
    assert Counter(table["intensity"].to_pylist()) == dict.fromkeys([60.0, 90.0, 120.0, 2800.0, 3100.0], 60)
    bare = lidarcli.detect(SAMPLES / "room.mcap")
    assert bare["intensity"].null_count == bare.num_rows > 0
