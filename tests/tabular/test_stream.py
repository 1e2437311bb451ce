"""Tables on a stream: every format reads back, and a closed pipe stays one."""

from __future__ import annotations

import csv
import io
import json
import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.errors import OutputError
from lidarcli.formalism import Detection
from lidarcli.sweeps.types import SweepBatch
from lidarcli.tabular import OBJECTS
from lidarcli.tabular.columns import objects_rows
from lidarcli.tabular.streams import FORMATS, CountingOutput
from lidarcli.tabular.writing import table_metadata
from tests.tabular.writing import METADATA, shortest


def test_full_disk_is_one_line(batch: SweepBatch, detection: Detection) -> None:
    with Path("/dev/full").open("wb", buffering=0) as full:
        stream = FORMATS["ndjson"](CountingOutput(full, "standard output"), OBJECTS, {})
        with pytest.raises(OutputError, match=r"^cannot write standard output: No space left on device$"):
            stream.write(objects_rows("run", batch, detection))


def streamed(kind: str, parts: list[pa.RecordBatch]) -> bytes:
    out = io.BytesIO()
    stream = FORMATS[kind](CountingOutput(out, "out"), OBJECTS, table_metadata({"a": 1}))
    for rows in parts:
        stream.write(rows)
    stream.finish(METADATA)
    return out.getvalue()


@pytest.mark.parametrize("kind", ["arrow", "parquet"])
def test_binary_streams_read_back(kind: str, batch: SweepBatch, detection: Detection) -> None:
    rows = objects_rows("run", batch, detection)
    data = io.BytesIO(streamed(kind, [rows.slice(0, 2), rows.slice(2)]))
    table = pa.ipc.open_stream(data).read_all() if kind == "arrow" else pq.read_table(data)
    assert table.to_pylist() == rows.to_pylist()
    assert table.schema.equals(OBJECTS)
    assert table.schema.metadata == (table_metadata({"a": 1}) if kind == "arrow" else METADATA)


def test_ndjson_reads_back(batch: SweepBatch, detection: Detection) -> None:
    rows = objects_rows("run", batch, detection)
    lines = streamed("ndjson", [rows.slice(0, 1), rows.slice(1)]).decode().splitlines()
    read = [json.loads(line) for line in lines]
    assert list(read[0]) == OBJECTS.names
    assert read[0]["stamp"] == "2023-11-14T22:13:20.123456789Z"
    for row, expected in zip(read, shortest(rows), strict=True):
        assert {**row, "stamp": None} == {**expected, "stamp": None}


def test_csv_reads_back(batch: SweepBatch, detection: Detection) -> None:
    rows = objects_rows("run", batch, detection)
    read = list(csv.DictReader(io.StringIO(streamed("csv", [rows.slice(0, 1), rows.slice(1)]).decode())))
    for row, expected in zip(read, shortest(rows), strict=True):
        assert list(row) == OBJECTS.names
        assert row["theta_i"] == str(expected["theta_i"])
        assert row["difference"] == ""
        assert len(row["intensity"]) <= 9
        assert json.loads(row["vertices"]) == expected["vertices"]
        assert json.loads(row["faces"]) == expected["faces"]
        assert (row["set"], row["shape"]) == (expected["set"], expected["shape"])


@pytest.mark.parametrize("kind", sorted(FORMATS))
def test_closed_pipe_stays_a_broken_pipe(kind: str, batch: SweepBatch, detection: Detection) -> None:
    reader, writer = os.pipe()
    os.close(reader)

    def write() -> None:
        with os.fdopen(writer, "wb", buffering=0) as out:
            stream = FORMATS[kind](CountingOutput(out, "out"), OBJECTS, {})
            stream.write(objects_rows("run", batch, detection))
            stream.finish({})

    with pytest.raises(BrokenPipeError):
        write()


def test_discarded_output_writes_nothing_more() -> None:
    out = io.BytesIO()
    guard = CountingOutput(out, "out")
    guard.write(b"ab")
    guard.discard()
    guard.write(b"cd")
    assert out.getvalue() == b"ab"
    assert guard.tell() == 4
