"""Files of tables: whole or absent, and the same bytes for the same rows."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from lidarcli.errors import OutputError
from lidarcli.formalism import Detection
from lidarcli.sweeps import SweepBatch
from lidarcli.tabular import OBJECTS, SCHEMAS
from lidarcli.tabular.columns import objects_rows
from lidarcli.tabular.writing import TableFiles, table_metadata, table_paths
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


def test_metadata_marks_damage_only_when_there_is_any() -> None:
    assert b"lidarcli.damage" not in METADATA
    marked = table_metadata({}, {"name": "x"}, ["byte 12: cut off"])
    assert marked[b"lidarcli.damage"] == b'["byte 12: cut off"]'


def test_empty_tables_are_valid(tmp_path: Path) -> None:
    paths = table_paths(tmp_path, "run", tuple(SCHEMAS))
    with TableFiles(paths, None) as files:
        files.publish(METADATA)
    for table, path in paths.items():
        empty = pq.read_table(path)
        assert empty.num_rows == 0
        assert empty.schema.equals(SCHEMAS[table], check_metadata=False)
        assert list(empty.to_pandas().columns) == SCHEMAS[table].names


def test_same_rows_same_bytes_whatever_the_batches(tmp_path: Path, batch: SweepBatch, detection: Detection) -> None:
    rows = objects_rows("run", batch, detection)
    one = write_files(tmp_path / "one", [("/scan", rows)], "/scan").read_bytes()
    each = [("/scan", rows.slice(k, 1)) for k in range(rows.num_rows)]
    assert write_files(tmp_path / "each", each, "/scan").read_bytes() == one
    assert write_files(tmp_path / "spooled", each, None).read_bytes() == one


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_failure_leaves_nothing(
    tmp_path: Path, batch: SweepBatch, detection: Detection, error: type[BaseException]
) -> None:
    def interrupted() -> None:
        with TableFiles(table_paths(tmp_path, "run", ("objects", "sweeps")), None) as files:
            files.write("objects", "/scan", objects_rows("run", batch, detection))
            (scratch,) = tmp_path.iterdir()
            assert sorted(path.name for path in scratch.iterdir()) == ["run.objects.parquet", "run.sweeps.parquet"]
            raise error

    with pytest.raises(error):
        interrupted()
    assert list(tmp_path.iterdir()) == []


KILLED = """
import os, signal, sys
from pathlib import Path
from lidarcli.tabular.writing import TableFiles, table_paths
files = TableFiles(table_paths(Path(sys.argv[1]), "run", ("objects", "sweeps")), None)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_kill_leaves_no_final_name_and_a_rerun_works(tmp_path: Path) -> None:
    killed = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert re.fullmatch(r"\.lidarcli-[0-9a-f]{8}-[0-9a-f]{16}\.part", left.name)
    with TableFiles(table_paths(tmp_path, "run", ("objects", "sweeps")), None) as files:
        files.publish(METADATA)
    assert {path.name for path in tmp_path.iterdir()} == {"run.objects.parquet", "run.sweeps.parquet"}


def test_folder_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "out").touch()
    with pytest.raises(OutputError) as caught:
        TableFiles(table_paths(tmp_path / "out", "run", ("objects",)), None)
    assert str(caught.value) == f"cannot write below {tmp_path / 'out'}: it is not a folder"


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
