"""`benchmarks.same` sees what differs between two tables, and nothing where the code is the same."""

from __future__ import annotations

import json
import sys
from math import nan, pi
from pathlib import Path
from subprocess import run

import numpy as np
import pyarrow as pa
import pytest

from benchmarks.same.differences import SWEEP, Difference, compare_tables
from benchmarks.same.odd import odd_logs
from benchmarks.same.sides import Side

ROOT = Path(__file__).parents[2]


def table(**columns: object) -> pa.Table:
    """Three objects in two sweeps."""
    rows = {
        "topic": pa.array(["/scan"] * 3).dictionary_encode(),
        "sweep": [0, 0, 1],
        "object": pa.array([1, 2, 1], pa.int32()),
        "shape": pa.array(["round", "round", None]).dictionary_encode(),
        "x": [1.0, nan, None],
        "box_yaw": [0.5, 1.5, -0.5],
        "faces": pa.array([[{"length": 1.0}], [], [{"length": 2.0}, {"length": 3.0}]]),
    }
    return pa.table(rows | columns)


def differences(**columns: object) -> list[Difference]:
    return list(compare_tables(table(), table(**columns), SWEEP))


def test_equal_tables_have_no_difference() -> None:
    assert differences() == []


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        ({"object": pa.array([1, 3, 1], pa.int32())}, ("object", 1, 0, 0.0)),
        ({"shape": pa.array(["round", None, "legged"]).dictionary_encode()}, ("shape", 2, 0, 0.0)),
        ({"x": [1.0 + 2**-40, nan, None]}, ("x", 0, 0, 2**-40)),
        ({"x": [1.25, nan, None]}, ("x", 0, 1, 0.25)),
        ({"x": [1.0, None, None]}, ("x", 1, 0, 0.0)),
        ({"x": [np.inf, 1.0, None]}, ("x", 2, 0, 0.0)),
        ({"faces": pa.array([[{"length": 1.0}], [], [{"length": 2.5}, {"length": 3.5}]])}, ("faces.length", 0, 1, 0.5)),
        ({"faces": pa.array([[], [], [{"length": 2.0}, {"length": 3.0}]])}, ("faces", 1, 0, 0.0)),
        ({"object": [1, 2, 1]}, ("object", 3, 0, 0.0)),
        ({"more": [1, 2, 3]}, ("more", 3, 0, 0.0)),
    ],
)  # fmt: skip
def test_a_difference_of_one_column(columns: dict[str, object], expected: tuple[str, int, int, float]) -> None:
    (found,) = differences(**columns)
    assert (found.column, found.other, found.beyond, found.greatest) == expected
    assert found.matters == (found.greatest != 2**-40)


@pytest.mark.parametrize(("value", "beyond"), [(4.0 + 3e-6, 0), (4.0 + 5e-6, 1)])
def test_single_precision_is_rounding(value: float, beyond: int) -> None:
    single = pa.array([value, nan, None], pa.float32())
    kind, found = compare_tables(table(x=[4.0, nan, None]), table(x=single), SWEEP)
    assert (kind.column, kind.other, kind.matters, kind.example) == ("x", 0, False, "type double -> float")
    assert (found.column, found.other, found.beyond) == ("x", 0, beyond)
    assert found.greatest == pytest.approx(value - 4.0, abs=5e-7)


def test_single_precision_inside_of_lists_is_rounding() -> None:
    faces = table()["faces"].cast(pa.list_(pa.struct([pa.field("length", pa.float32(), nullable=False)])))
    (kind,) = differences(faces=faces)
    assert (kind.column, kind.matters) == ("faces", False)


def test_a_line_has_no_direction() -> None:
    (turned,) = differences(box_yaw=[0.5 - pi, 1.5 - pi, -0.5 + pi + 0.125])
    assert (turned.column, turned.other, turned.beyond) == ("box_yaw", 0, 1)
    assert turned.greatest == pytest.approx(0.125, abs=1e-12)
    assert turned.example.startswith("topic /scan, sweep 1, object 1: ")


def test_sweeps_with_other_numbers_of_rows_are_not_compared() -> None:
    longer = pa.concat_tables([table(x=[9.0, 9.0, None]), table().slice(2)])
    rows, *others = compare_tables(table(), longer, SWEEP)
    assert (rows.column, rows.other) == ("(rows)", 1)
    assert [(found.column, found.other, found.beyond) for found in others] == [("x", 1, 1)]
    assert rows.example == "1 times, first topic /scan, sweep 1: 1 -> 2 rows"


def test_odd_logs_repeat() -> None:
    for (name, one), (again, other) in zip(odd_logs(20), odd_logs(20), strict=True):
        assert name == again
        assert one.ranges.tobytes() == other.ranges.tobytes()
        assert one.angle_increment.tobytes() == other.angle_increment.tobytes()


@pytest.mark.whole
def test_a_tree_finds_what_it_has_found_and_tells_what_it_has_not(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.same", str(ROOT), "--cache", str(tmp_path)]
    command += ["--scenes", "1", "--odd", "8", "--only", "--profile robust --max-width 0.5"]
    first = run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert first.returncode == 0, first.stdout + first.stderr
    assert "; 0 of 28 runs of the base were known" in first.stdout
    assert first.stdout.endswith("\nno run differs\n")

    (folder,) = {path.parent for path in (tmp_path / "results").rglob("room.objects.parquet")}
    assert Side(ROOT, tmp_path).digest == folder.parent.name
    answer = json.loads((folder / "done.json").read_text("utf-8"))
    (folder / "done.json").write_text(json.dumps(answer | {"codes": [3]}), "utf-8")
    (folder / "room.sweeps.parquet").unlink()
    second = run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert second.returncode == 1, second.stdout + second.stderr
    assert "; 28 of 28 runs of the base were known" in second.stdout
    assert "run: exit code, words" in second.stdout
    assert "samples/room.mcap --profile robust --max-width 0.5: none -> there" in second.stdout
    assert second.stdout.endswith("\n1 of 28 runs differ\n")
