"""The background table: written and read back, by every reader, and refused where it is none."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.errors import UnreadableError
from lidarcli.formalism import sweep
from lidarcli.formalism.background import Background, Grid
from lidarcli.formalism.learning import Estimate, Learning
from lidarcli.sweeps.types import SweepPoses
from lidarcli.tabular.background import GEOMETRY, read_background, write_background
from lidarcli.tabular.schemas import BACKGROUND
from lidarcli.tabular.writing import PARAMETERS, SOURCE, VERSION, table_metadata

CONTRACT = [
    ("topic", "dictionary<values=string, indices=int32, ordered=0>"),
    ("frame_id", "dictionary<values=string, indices=int32, ordered=0>"),
    ("station", "int32"),
    ("beam", "int32"),
    *((name, "double") for name in ("theta", "r_e", "r_near", "spread", "support", "no_return")),
    ("sweeps", "int64"),
    *((name, "double") for name in ("pose_x", "pose_y", "pose_yaw")),
    ("upside_down", "bool"),
]
METADATA = table_metadata({"every": 1}, [{"name": "a.mcap"}])


def sensor(posed: bool = False, topic: str = "/scan") -> Background:
    """Five beams: a surface, an edge, an open beam, one that nobody knows, and one with noise."""
    ranges = np.array([[2.0, 3.0, np.inf, np.nan, 4.0], [2.0, 5.0, np.inf, np.nan, 4.1], [2.0, 5.0, np.inf, np.nan, 4.1]])
    batch = sweep(ranges, angle_min=-0.2, angle_increment=0.1, range_max=10.0)
    if posed:
        places = np.array([0.0, 0.0, 1.0])
        batch = replace(batch, poses=SweepPoses(places, 2 * places, places / 3, np.zeros(3, bool)))
    learning = Learning(topic, "laser", Grid.of(batch, 0), 0.25, 0.1)
    learning.add(batch)
    return learning.background()


@pytest.fixture
def path(tmp_path: Path) -> Path:
    written = tmp_path / "a.parquet"
    write_background(written, [sensor(topic="/front"), sensor(True)], METADATA)
    return written


def test_the_schema_is_the_contract() -> None:
    assert [(field.name, str(field.type)) for field in BACKGROUND] == CONTRACT
    assert all(b"description" in field.metadata and b"unit" in field.metadata for field in BACKGROUND)


def test_what_is_written_is_read(path: Path) -> None:
    sensors, metadata = read_background(path)
    assert [(one.topic, len(one)) for one in sensors] == [("/front", 1), ("/scan", 2)]
    for got, expected in zip(sensors, (sensor(), sensor(True)), strict=True):
        for name in (*(field.name for field in fields(Estimate)), "sweeps"):
            assert np.array_equal(getattr(got, name), getattr(expected, name), equal_nan=True), name
        for field in fields(SweepPoses):
            values = [getattr(one.poses, field.name) for one in (got, expected)]
            if field.name in ("way", "reverse", "absent"):
                # A station stays where it is.
                assert values == [None, None]
            else:
                assert np.array_equal(*values, equal_nan=field.name != "upside_down")
        for field in fields(Grid):
            assert getattr(got.grid, field.name) == getattr(expected.grid, field.name)
        assert (got.range_max, got.distance, got.angle) == (10.0, 0.25, 0.1)
    assert metadata[PARAMETERS] == {"every": 1}
    assert metadata[SOURCE] == [{"name": "a.mcap"}]
    assert metadata[VERSION]


def test_every_reader_tells_open_from_unknown(path: Path) -> None:
    frame = pd.read_parquet(path)
    assert list(frame.columns) == BACKGROUND.names
    front = frame[frame.topic == "/front"]
    assert front.r_e.tolist() == pytest.approx([2.0, 5.0, np.inf, np.nan, 4.1], nan_ok=True, abs=0.05)
    assert np.isinf(front.r_e.to_numpy()[2])
    counts = "count(*), count(r_e), count(*) filter (isinf(r_e)), count(pose_x)"
    assert duckdb.sql(f"select {counts} from '{path}'").fetchall() == [(15, 12, 3, 10)]
    table = pl.read_parquet(path)
    assert table["r_e"].null_count() == 3
    assert table["r_e"].is_infinite().sum() == 3


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no such file"),
        (b"", "x.parquet: no Parquet file; give the table of lidarcli background build$"),
        (b"PAR1 and no more", "no background: "),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, content: bytes | None, message: str) -> None:
    file = tmp_path / "x.parquet"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(UnreadableError, match=message) as error:
        read_background(file)
    assert str(error.value).startswith(f"{file}: ")
    assert "\n" not in str(error.value)


def test_another_table_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "x.parquet"
    pq.write_table(pa.table({"theta": [0.0]}), file)
    with pytest.raises(UnreadableError, match="not a table of lidarcli background build: no column beam, frame_id"):
        read_background(file)


def rewritten(path: Path, table: pa.Table, geometry: object = None) -> None:
    metadata = dict(table.schema.metadata)
    if geometry is not None:
        metadata[GEOMETRY.encode()] = json.dumps(geometry).encode()
    pq.write_table(table.replace_schema_metadata(metadata), path)


def test_a_background_that_was_tampered_with_is_refused(path: Path) -> None:
    table = pq.read_table(path)
    geometry = json.loads(table.schema.metadata[GEOMETRY.encode()])
    broken = [
        (table.slice(1), None),
        (table, geometry[:1]),
        (table, [{**geometry[0], "angle_increment": 0.2}, geometry[1]]),
        (table, [{key: value for key, value in geometry[0].items() if key != "beams"}, geometry[1]]),
        (table, "nonsense"),
        (table, [1, 2]),
    ]
    for rows, told in broken:
        rewritten(path, rows, told)
        with pytest.raises(UnreadableError, match="do not agree; build it again"):
            read_background(path)
    rewritten(path, table)
    assert len(read_background(path)[0]) == 2
