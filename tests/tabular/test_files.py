"""Files of tables: whole or absent, and the same bytes for the same rows."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq

from lidarcli.formalism import Detection
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular import OBJECTS
from lidarcli.tabular.columns import objects_rows
from tests.tabular.contract import OPEN
from tests.tabular.writing import METADATA, write_files


def test_file_read_back_equals_rows_and_metadata(tmp_path: Path, batch: SweepBatch, detection: Detection) -> None:
    rows = objects_rows("run", batch, detection)
    path = write_files(tmp_path, [("/scan", rows)], "/scan")
    table = pq.read_table(path)
    assert table.schema.equals(OBJECTS.with_metadata(METADATA), check_metadata=True)
    assert pq.read_schema(path).metadata == METADATA
    assert table.to_pylist() == rows.to_pylist()
    assert {path.name for path in tmp_path.iterdir()} == {"run.objects.parquet"}
    footer = pq.read_metadata(path).metadata
    assert json.loads(footer[b"lidarcli.source"]) == {"format": "mcap", "name": "run.mcap", "size": 12}


def test_same_rows_same_bytes_whatever_the_batches(tmp_path: Path, batch: SweepBatch, detection: Detection) -> None:
    rows = objects_rows("run", batch, detection)
    one = write_files(tmp_path / "one", [("/scan", rows)], "/scan").read_bytes()
    each = [("/scan", rows.slice(k, 1)) for k in range(rows.num_rows)]
    assert write_files(tmp_path / "each", each, "/scan").read_bytes() == one
    assert write_files(tmp_path / "spooled", each, None).read_bytes() == one


def test_columns_without_nulls_are_required(tmp_path: Path, batch: SweepBatch, detection: Detection) -> None:
    path = write_files(tmp_path, [("/scan", objects_rows("run", batch, detection))], "/scan")
    leaves = pq.ParquetFile(path).schema
    levels = {leaves.column(k).path: leaves.column(k).max_definition_level for k in range(len(leaves))}
    # Inside of a list one level tells an empty list from one with items, and none is for nulls.
    inside = {name: level for name, level in levels.items() if "." in name}
    assert len(inside) == 7
    assert set(inside.values()) == {1}
    flat = {name: level for name, level in levels.items() if "." not in name}
    assert {name for name, level in flat.items() if level} == set(OPEN["objects"].split())
    kinds = {leaves.column(k).path: leaves.column(k).physical_type for k in range(len(leaves))}
    assert {name for name, kind in kinds.items() if kind == "DOUBLE"} == {
        *("t", "vx", "vy", "world_x", "world_y", "world_yaw")
    }
