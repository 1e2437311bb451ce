"""Tables: schemas as the contract has them, rows equal to the detection, files whole or absent."""

from __future__ import annotations

import csv
import errno
import io
import json
import os
import re
import resource
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.errors import OutputError
from lidarcli.formalism import SETS, SHAPES, VERTEX_KINDS, VISIBILITIES, Detection, Parameters, detect, sweep
from lidarcli.newfiles import NewFiles
from lidarcli.sweeps import Status, SweepBatch
from lidarcli.tables import BEAMS, OBJECTS, SCHEMAS, SWEEPS
from lidarcli.tables.arrays import codes, floats, names_of
from lidarcli.tables.files import TableFiles
from lidarcli.tables.metadata import table_metadata
from lidarcli.tables.order import TopicOrder
from lidarcli.tables.parquet import ROWS_PER_GROUP, ParquetSink, TableFile
from lidarcli.tables.rows import beams_rows, objects_rows, sweeps_rows
from lidarcli.tables.stream import FORMATS, CountingOutput

TEXT = "dictionary<values=string, indices=int32, ordered=0>"
VERTICES = "list<element: struct<theta: double, r: double, kind: string>>"
FACES = "list<element: struct<theta_i: double, theta_f: double, length: double, rms: double>>"
SOURCE = [
    ("log", TEXT),
    ("topic", TEXT),
    ("frame_id", TEXT),
    ("sweep", "int64"),
    ("stamp", "timestamp[ns, tz=UTC]"),
]


def doubles(names: str) -> list[tuple[str, str]]:
    return [(name, "double") for name in names.split()]


def counts(names: str) -> list[tuple[str, str]]:
    return [(name, "int32") for name in names.split()]


CONTRACT = {
    "objects": [
        *SOURCE,
        ("object", "int32"),
        ("set", TEXT),
        ("shape", TEXT),
        ("visibility", TEXT),
        *counts("beam_i beam_f beams"),
        *doubles("theta_i theta_f r_i r_f s_i s_f d_th theta_min r_min x y width"),
        *doubles("box_x box_y box_length box_width box_yaw"),
        ("vertices", VERTICES),
        ("faces", FACES),
        ("difference", "double"),
        ("change", TEXT),
        ("track", "int64"),
        *doubles("world_x world_y world_yaw"),
    ],
    "sweeps": [
        *SOURCE,
        *counts("beams valid no_return too_close invalid"),
        *doubles("d_mean d_th noise"),
        *counts("objects agents object_beams agent_beams noise_beams"),
        *doubles("pose_x pose_y pose_yaw"),
        ("station", "int32"),
    ],
    "beams": [
        *SOURCE[:2],
        SOURCE[3],
        ("beam", "int32"),
        *doubles("theta r"),
        ("status", TEXT),
        ("s", "double"),
        ("set", TEXT),
        ("object", "int32"),
        ("difference", "double"),
    ],
}


@pytest.fixture
def batch() -> SweepBatch:
    """Three sweeps of a round room with two boxes in it, the second sweep without the boxes, one beam lost."""
    ranges = np.full((3, 360), 4.0, np.float32)
    ranges[::2, 40:55] = 2.0
    ranges[::2, 200:230] = 1.5
    ranges[0, 5] = np.inf
    ranges[2, 7] = np.nan
    made = sweep(ranges, angle_increment=np.pi / 180, range_min=0.1, range_max=12)
    return replace(
        made, topic="/scan", frame_ids=("a", "b"), frame=np.array([0, 1, 1], np.int32), stamp_ns=STAMPS
    )


STAMPS = np.array([1_700_000_000_123_456_789, 1_700_000_000_223_456_789, 1_700_000_000_323_456_789])
METADATA = table_metadata({"profile": "robust"}, {"name": "run.mcap", "size": 12, "format": "mcap"})


@pytest.fixture
def detection(batch: SweepBatch) -> Detection:
    return detect(batch, Parameters(), per_beam=True)


@pytest.mark.parametrize("table", sorted(CONTRACT))
def test_schema_is_the_contract(table: str) -> None:
    assert [(field.name, str(field.type)) for field in SCHEMAS[table]] == CONTRACT[table]


@pytest.mark.parametrize("table", sorted(CONTRACT))
def test_every_column_has_unit_and_description(table: str) -> None:
    def leaves(field: pa.Field) -> list[pa.Field]:
        if pa.types.is_list(field.type):
            return [field, *field.type.value_type]
        return [field]

    units = {leaf.name: leaf.metadata[b"unit"] for field in SCHEMAS[table] for leaf in leaves(field)}
    assert all(leaf.metadata[b"description"] for field in SCHEMAS[table] for leaf in leaves(field))
    assert set(units.values()) <= {b"rad", b"m", b"1", b"ns", b""}
    assert all(units[name] == b"rad" for name in units if name.startswith("theta") or name.endswith("yaw"))


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
            if value is not None and kind in ("double", "int32") and name not in ("row",):
                expected = None if np.isnan(value[k]) else value[k]
                assert row[name] == expected, name
        first, last = detection.vertex_offsets[k : k + 2]
        assert row["vertices"] == [
            {
                "theta": detection.vertex_theta[v],
                "r": detection.vertex_r[v],
                "kind": VERTEX_KINDS[detection.vertex_kind[v]],
            }
            for v in range(first, last)
        ]
        first, last = detection.face_offsets[k : k + 2]
        assert [face["length"] for face in row["faces"]] == detection.face_length[first:last].tolist()
        unknown = ("difference", "change", "track", "world_x", "world_y", "world_yaw")
        assert [row[name] for name in unknown] == [None] * 6


def test_undefined_difference_is_null(batch: SweepBatch, detection: Detection) -> None:
    undefined = replace(detection, s_i=np.full(len(detection), np.nan))
    rows = objects_rows("run", batch, undefined)
    assert rows["s_i"].null_count == len(detection)
    assert rows["s_f"].null_count == 0


def test_sweep_rows_count_beams(batch: SweepBatch, detection: Detection) -> None:
    rows = sweeps_rows("run", batch, detection).to_pylist()
    assert [row["beams"] for row in rows] == [360, 360, 360]
    assert [(row["valid"], row["no_return"], row["too_close"], row["invalid"]) for row in rows] == [
        (359, 1, 0, 0),
        (360, 0, 0, 0),
        (359, 0, 0, 1),
    ]
    assert [row["objects"] for row in rows] == detection.objects.tolist()
    assert [row["d_mean"] for row in rows] == detection.d_mean.tolist()
    assert [row["d_th"] for row in rows] == detection.sweep_d_th.tolist()
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
    assert beams_rows("run", padded, detection)["theta"][0].as_py() == padded.angle_min[0]


def test_beam_rows_need_the_beams(batch: SweepBatch) -> None:
    with pytest.raises(ValueError, match="needs a detection with per_beam"):
        beams_rows("run", batch, detect(batch, Parameters()))


def write_files(folder: Path, batches: list[tuple[str, pa.RecordBatch]], first: str | None) -> Path:
    with TableFiles(folder, "run", ("objects",), first) as files:
        for topic, rows in batches:
            files.write("objects", topic, rows)
        files.publish(METADATA)
    return files.paths[0]


def test_file_read_back_equals_rows_and_metadata(
    tmp_path: Path, batch: SweepBatch, detection: Detection
) -> None:
    rows = objects_rows("run", batch, detection)
    path = write_files(tmp_path, [("/scan", rows)], "/scan")
    table = pq.read_table(path)
    assert table.schema.equals(OBJECTS.with_metadata(METADATA), check_metadata=True)
    assert pq.read_schema(path).metadata == METADATA
    assert table.to_pylist() == rows.to_pylist()
    assert {path.name for path in tmp_path.iterdir()} == {"run.objects.parquet"}
    footer = pq.read_metadata(path).metadata
    assert json.loads(footer[b"lidarcli.source"]) == {"format": "mcap", "name": "run.mcap", "size": 12}


def test_metadata_marks_damage_only_when_there_is_any() -> None:
    assert b"lidarcli.damage" not in METADATA
    marked = table_metadata({}, {"name": "x"}, ["byte 12: cut off"])
    assert marked[b"lidarcli.damage"] == b'["byte 12: cut off"]'


def test_empty_tables_are_valid(tmp_path: Path) -> None:
    with TableFiles(tmp_path, "run", tuple(SCHEMAS), None) as files:
        files.publish(METADATA)
    for table, path in zip(SCHEMAS, files.paths, strict=True):
        empty = pq.read_table(path)
        assert empty.num_rows == 0
        assert empty.schema.equals(SCHEMAS[table], check_metadata=False)
        assert list(empty.to_pandas().columns) == SCHEMAS[table].names


def test_same_rows_same_bytes_whatever_the_batches(
    tmp_path: Path, batch: SweepBatch, detection: Detection
) -> None:
    rows = objects_rows("run", batch, detection)
    one = write_files(tmp_path / "one", [("/scan", rows)], "/scan").read_bytes()
    each = [("/scan", rows.slice(k, 1)) for k in range(rows.num_rows)]
    assert write_files(tmp_path / "each", each, "/scan").read_bytes() == one
    assert write_files(tmp_path / "spooled", each, None).read_bytes() == one


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


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    script = f"""
import resource, signal, sys
from pathlib import Path
import numpy as np, pyarrow as pa
from lidarcli.errors import OutputError
from lidarcli.newfiles import NewFiles
from lidarcli.tables.parquet import TableFile
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))
schema = pa.schema([pa.field("x", pa.float64())])
rows = pa.record_batch([pa.array(np.random.default_rng(1).random({ROWS_PER_GROUP}))], schema=schema)
try:
    path = Path(sys.argv[1])
    with NewFiles([path]) as new, TableFile(new.part(path), schema, path) as file:
        for _ in range(5):
            file.write(rows)
        file.finish({{}})
except OutputError as err:
    print(err)
"""
    path = tmp_path / "run.objects.parquet"
    done = subprocess.run(
        [sys.executable, "-c", script, str(path)], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"cannot write {path}: File too large\n"
    assert list(tmp_path.iterdir()) == []


def test_leaving_while_a_row_group_is_written(tmp_path: Path) -> None:
    schema = pa.schema([pa.field("x", pa.int64())])
    rows = pa.record_batch([pa.array(np.arange(3 * ROWS_PER_GROUP))], schema=schema)

    def interrupted() -> None:
        path = tmp_path / "x.parquet"
        with NewFiles([path]) as new, TableFile(new.part(path), schema) as file:
            file.write(rows)
            raise KeyboardInterrupt

    before = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert list(tmp_path.iterdir()) == []
    assert threading.active_count() == before


def test_codes_and_their_names() -> None:
    values = np.array([1, 3, 0, 2, 2], np.uint8)
    expected = ["end", "extremum", "start", "corner", "corner"]
    assert names_of(values, VERTEX_KINDS).to_pylist() == expected
    assert codes(values, VERTEX_KINDS).to_pylist() == expected
    assert names_of(values[:0], VERTEX_KINDS).to_pylist() == []


@pytest.mark.parametrize(
    "values", [[], [1.0, -2.0], [np.nan, 1.0], [np.inf, -np.inf], [-1.0, np.nan, np.inf]]
)
def test_only_nan_is_null(values: list[float]) -> None:
    assert floats(np.array(values)).to_pylist() == [None if np.isnan(value) else value for value in values]


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


def test_growing_frame_names_stay_right_over_batches(
    tmp_path: Path, batch: SweepBatch, detection: Detection
) -> None:
    other = replace(batch, frame_ids=("c", "a"))
    rows = [objects_rows("run", batch, detection), objects_rows("run", other, detection)]
    table = pq.read_table(write_files(tmp_path, [("/scan", part) for part in rows], None))
    assert table["frame_id"].to_pylist() == rows[0]["frame_id"].to_pylist() + rows[1]["frame_id"].to_pylist()


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_failure_leaves_nothing(
    tmp_path: Path, batch: SweepBatch, detection: Detection, error: type[BaseException]
) -> None:
    def interrupted() -> None:
        with TableFiles(tmp_path, "run", ("objects", "sweeps"), None) as files:
            files.write("objects", "/scan", objects_rows("run", batch, detection))
            (scratch,) = tmp_path.iterdir()
            assert sorted(path.name for path in scratch.iterdir()) == [
                "run.objects.parquet",
                "run.sweeps.parquet",
            ]
            raise error

    with pytest.raises(error):
        interrupted()
    assert list(tmp_path.iterdir()) == []


KILLED = """
import os, signal, sys
from pathlib import Path
from lidarcli.tables.files import TableFiles
files = TableFiles(Path(sys.argv[1]), "run", ("objects", "sweeps"), None)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_kill_leaves_no_final_name_and_a_rerun_works(tmp_path: Path) -> None:
    killed = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert re.fullmatch(r"\.lidarcli-[0-9a-f]{8}-[0-9a-f]{16}\.part", left.name)
    with TableFiles(tmp_path, "run", ("objects", "sweeps"), None) as files:
        files.publish(METADATA)
    assert {path.name for path in tmp_path.iterdir()} == {"run.objects.parquet", "run.sweeps.parquet"}


def test_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "out").touch()
    with pytest.raises(OutputError) as caught:
        TableFiles(tmp_path / "out", "run", ("objects",), None)
    assert str(caught.value) == f"cannot write below {tmp_path / 'out'}: it is not a folder"


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
    for row, expected in zip(read, rows.to_pylist(), strict=True):
        assert {**row, "stamp": None} == {**expected, "stamp": None}


def test_csv_reads_back(batch: SweepBatch, detection: Detection) -> None:
    rows = objects_rows("run", batch, detection)
    read = list(csv.DictReader(io.StringIO(streamed("csv", [rows.slice(0, 1), rows.slice(1)]).decode())))
    for row, expected in zip(read, rows.to_pylist(), strict=True):
        assert list(row) == OBJECTS.names
        assert float(row["theta_i"]) == expected["theta_i"]
        assert row["difference"] == ""
        assert json.loads(row["vertices"]) == expected["vertices"]
        assert json.loads(row["faces"]) == expected["faces"]
        assert (row["set"], row["shape"]) == (expected["set"], expected["shape"])


def test_empty_streams_are_valid() -> None:
    assert streamed("ndjson", []) == b""
    assert streamed("csv", []).decode() == ",".join(OBJECTS.names) + "\n"
    assert pq.read_table(io.BytesIO(streamed("parquet", []))).schema.equals(OBJECTS)
    assert pa.ipc.open_stream(streamed("arrow", [])).read_all().schema.equals(OBJECTS)


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


def test_waiting_topics_leave_no_file_behind(tmp_path: Path, batch: SweepBatch, detection: Detection) -> None:
    class Nowhere:
        def write(self, rows: pa.RecordBatch) -> None:
            raise AssertionError("nothing may come out before drain")

    with TopicOrder(Nowhere(), OBJECTS, None, tmp_path) as order:
        order.write("/scan", objects_rows("run", batch, detection))
        assert list(tmp_path.iterdir()) == []


def test_thousands_of_topics_share_one_file_and_little_memory(
    tmp_path: Path, batch: SweepBatch, detection: Detection
) -> None:
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    rows = sweeps_rows("run", batch, detection)
    topics = [f"/t{number:04}" for number in range(1500)]
    resource.setrlimit(resource.RLIMIT_NOFILE, (200, limits[1]))
    try:
        with TableFiles(tmp_path, "run", ("sweeps",), None) as files:
            for topic in reversed(topics):
                index = rows.schema.get_field_index("topic")
                named = pa.DictionaryArray.from_arrays(pa.array([0] * rows.num_rows, pa.int32()), [topic])
                files.write("sweeps", topic, rows.set_column(index, rows.schema.field(index), named))
            files.publish(METADATA)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)
    found = pq.read_table(tmp_path / "run.sweeps.parquet")["topic"].to_pylist()
    assert found == [topic for topic in topics for _ in range(rows.num_rows)]


def test_table_names() -> None:
    assert SCHEMAS == {"objects": OBJECTS, "sweeps": SWEEPS, "beams": BEAMS}
