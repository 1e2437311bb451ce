"""Rows of topics that alternate in a log come out topic by topic."""

from __future__ import annotations

import resource
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.formalism import Detection
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular.columns import objects_rows, sweeps_rows
from lidarcli.tabular.writing import TableFiles, TopicOrder, table_paths
from tests.tabular.writing import METADATA, write_files


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
