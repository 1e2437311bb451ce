"""Schemas and files of tables: whole or absent, the same bytes for the same rows, topic by topic, in equal row groups."""

from __future__ import annotations

import errno
import io
import json
import os
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.formalism import Detection
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular import OBJECTS, SCHEMAS
from lidarcli.tabular.columns import objects_rows, sweeps_rows
from lidarcli.tabular.writing import ROWS_PER_GROUP, ParquetSink, TableFiles, TopicOrder, table_paths
from tests.tabular.contract import CONTRACT, OPEN
from tests.tabular.writing import METADATA, write_files


@pytest.mark.parametrize("table", sorted(CONTRACT))
def test_schema_is_the_contract(table: str) -> None:
    assert [(field.name, str(field.type)) for field in SCHEMAS[table]] == CONTRACT[table]
    assert [field.name for field in SCHEMAS[table] if field.nullable] == OPEN[table].split()


@pytest.mark.parametrize("table", sorted(CONTRACT))
def test_every_column_has_unit_and_description(table: str) -> None:
    def leaves(field: pa.Field) -> list[pa.Field]:
        if pa.types.is_list(field.type):
            return [field, *field.type.value_type]
        return [field]

    units = {leaf.name: leaf.metadata[b"unit"] for field in SCHEMAS[table] for leaf in leaves(field)}
    assert all(leaf.metadata[b"description"] for field in SCHEMAS[table] for leaf in leaves(field))
    assert set(units.values()) <= {b"rad", b"m", b"m/s", b"s", b"1", b"ns", "m²".encode(), b""}
    assert all(units[name] == b"rad" for name in units if name.startswith("theta") or name.endswith("yaw"))


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


@pytest.mark.parametrize("first", ["/a", None])
def test_interleaved_topics_come_out_in_order(
    tmp_path: Path, batch: SweepBatch, detection: Detection, first: str | None
) -> None:
    topics = {name: objects_rows("run", replace(batch, topic=name), detection) for name in ("/a", "/b", "/c")}
    pieces = [(name, topics[name].slice(k, 1)) for k in range(len(detection)) for name in ("/c", "/a", "/b")]
    table = pq.read_table(write_files(tmp_path, pieces, first))
    expected = [row for name in ("/a", "/b", "/c") for row in topics[name].to_pylist()]
    assert table.to_pylist() == expected
    assert [path.name for path in tmp_path.iterdir()] == ["run.objects.parquet"]


def test_growing_frame_names_stay_right_over_batches(tmp_path: Path, batch: SweepBatch, detection: Detection) -> None:
    other = replace(batch, frame_ids=("c", "a"))
    rows = [objects_rows("run", batch, detection), objects_rows("run", other, detection)]
    table = pq.read_table(write_files(tmp_path, [("/scan", part) for part in rows], None))
    assert table["frame_id"].to_pylist() == rows[0]["frame_id"].to_pylist() + rows[1]["frame_id"].to_pylist()


def test_waiting_topics_leave_no_file_behind(tmp_path: Path, batch: SweepBatch, detection: Detection) -> None:
    class Nowhere:
        def write(self, rows: pa.RecordBatch) -> None:
            raise AssertionError("nothing may come out before drain")

    with TopicOrder({"objects": Nowhere()}, None, tmp_path) as order:
        order.write("objects", "/scan", objects_rows("run", batch, detection))
        assert list(tmp_path.iterdir()) == []


def test_thousands_of_topics_share_one_file_and_little_memory(
    tmp_path: Path, batch: SweepBatch, detection: Detection
) -> None:
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    rows = sweeps_rows("run", batch, detection)
    topics = [f"/t{number:04}" for number in range(1500)]
    resource.setrlimit(resource.RLIMIT_NOFILE, (200, limits[1]))
    try:
        with TableFiles(table_paths(tmp_path, "run", ("sweeps",)), None) as files:
            for topic in reversed(topics):
                index = rows.schema.get_field_index("topic")
                named = pa.DictionaryArray.from_arrays(pa.array([0] * rows.num_rows, pa.int32()), [topic])
                files.write("sweeps", topic, rows.set_column(index, rows.schema.field(index), named))
            files.publish(METADATA)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    found = pq.read_table(tmp_path / "run.sweeps.parquet")["topic"].to_pylist()
    assert found == [topic for topic in topics for _ in range(rows.num_rows)]


def test_row_groups_have_equal_size() -> None:
    out = io.BytesIO()
    schema = pa.schema([pa.field("x", pa.int64())])
    sink = ParquetSink(out, schema)
    total = 2 * ROWS_PER_GROUP + 10
    for first in range(0, total, 7001):
        values = np.arange(first, min(first + 7001, total))
        sink.write(pa.record_batch([pa.array(values)], schema=schema))
    sink.finish({})
    file = pq.ParquetFile(io.BytesIO(out.getvalue()))
    sizes = [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)]
    assert sizes == [ROWS_PER_GROUP, ROWS_PER_GROUP, 10]
    assert file.read()["x"].to_pylist() == list(range(total))


class Refusing(io.RawIOBase):
    """An output that takes the first few bytes alone."""

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        if memoryview(data).nbytes > 4:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return memoryview(data).nbytes


def test_an_error_of_the_writing_thread_comes_out() -> None:
    sink = ParquetSink(Refusing(), schema := pa.schema([pa.field("x", pa.float64())]))
    noise = np.random.default_rng(1).random(ROWS_PER_GROUP)
    rows = pa.record_batch([pa.array(noise)], schema=schema)
    sink.write(rows)
    with pytest.raises(OSError, match="No space left on device"):
        sink.write(rows)
    sink.abandon()


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    script = f"""
import resource, signal, sys
from pathlib import Path
import numpy as np, pyarrow as pa
from lidarcli.errors import OutputError
from lidarcli.files.newfiles import NewFiles
from lidarcli.tabular.writing import ParquetSink
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))
schema = pa.schema([pa.field("x", pa.float64())])
rows = pa.record_batch([pa.array(np.random.default_rng(1).random({ROWS_PER_GROUP}))], schema=schema)
try:
    path = Path(sys.argv[1])
    with NewFiles([path]) as new, ParquetSink(new.part(path), schema, path) as file:
        for _ in range(5):
            file.write(rows)
        file.finish({{}})
except OutputError as err:
    print(err)
"""
    path = tmp_path / "run.objects.parquet"
    done = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True)
    assert done.stdout == f"cannot write {path}: File too large\n"
    assert list(tmp_path.iterdir()) == []
