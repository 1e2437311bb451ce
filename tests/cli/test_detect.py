"""`lidarcli detect`: files, streams, summary."""

from __future__ import annotations

import csv
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.tabular import OBJECTS
from tests.tabular.writing import shortest
from tests.waiting import HANG

Run = Callable[..., Any]


def test_tables_and_summary(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    ran = lidarcli("detect", logs / "run.mcap", "-o", tmp_path / "out", "--beams")
    assert (ran.code, ran.out) == (0, "")
    lines = ran.err.splitlines()
    assert lines[0].startswith(f"{logs / 'run.mcap'}: 20 sweeps, 30 objects")
    assert lines[1:3] == [
        "  beams    7,200: valid 7,180 (99.7%), no return 20 (0.3%)",
        "  on       objects 700 (9.7%), walls and rest 6,500 (90.3%)",
    ]
    names = ["run.objects.parquet", "run.sweeps.parquet", "run.beams.parquet"]
    assert lines[3:] == [f"  wrote    {tmp_path}/out/run.{{objects,sweeps,beams}}.parquet"]
    objects = pq.read_table(tmp_path / "out" / names[0])
    assert objects.schema.equals(OBJECTS)
    assert objects["beam_i"].to_pylist() == [40, 200] * 10 + [40] * 10
    assert pq.read_table(tmp_path / "out" / names[2]).num_rows == 7200


def test_options_reach_the_tables(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    options = "--profile paper --threshold 0.5 --min-beams 2 --max-width 3 --max-gap 1 --group-gap 0.1 --walls"
    options += " --topic /scan --start 0.5 --end 1.5 --every 2 --range 0.5 10 --no-return zero,50"
    assert lidarcli("-q", "detect", logs / "run.mcap", "-o", tmp_path, *options.split()).code == 0
    table = pq.read_table(tmp_path / "run.sweeps.parquet")
    assert table["sweep"].to_pylist() == [6, 8, 10, 12, 14]
    assert json.loads(table.schema.metadata[b"lidarcli.parameters"]) == {
        "profile": "paper",
        "threshold": 0.5,
        "min_beams": 2,
        "max_width": 3.0,
        "min_thing": 0.3,
        "max_gap": 1,
        "group_gap": 0.1,
        "walls": True,
        "topics": ["/scan"],
        "start": 0.5,
        "end": 1.5,
        "every": 2,
        "range": [0.5, 10.0],
        "no_return": ["zero", 50.0],
    }
    source = json.loads(table.schema.metadata[b"lidarcli.source"])
    assert source.pop("recording").keys() == {"/scan"}
    assert source == {"format": "mcap", "name": "run.mcap", "size": (logs / "run.mcap").stat().st_size}


def test_logs_below_a_folder_keep_their_place(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    tree, out = tmp_path / "tree", tmp_path / "out"
    for name in ("run.mcap", "a/run.mcap", "a/b/run.mcap"):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_bytes((logs / "run.mcap").read_bytes())
    (tree / "bad.bag").write_bytes(b"\0\1\2" * 99)
    ran = lidarcli("detect", tree, "-o", out, "--jobs", "2")
    assert ran.code == 3
    found = sorted(path.relative_to(out).as_posix() for path in out.rglob("*.objects.parquet"))
    assert found == ["a/b/run.objects.parquet", "a/run.objects.parquet", "run.objects.parquet"]
    assert pq.read_table(out / "a/b/run.objects.parquet")["log"].to_pylist()[0] == "a/b/run"
    said = [line for line in ran.err.splitlines() if not line.startswith(" ")]
    assert [line.removeprefix("lidarcli: ").split(":")[0] for line in said[:-1]] == [
        str(tree / name) for name in ("a/b/run.mcap", "a/run.mcap", "bad.bag", "run.mcap")
    ]
    assert said[-1] == "4 logs, 1 with errors: 60 sweeps, 90 objects"


def expected_rows(logs: Path, tmp_path: Path, lidarcli: Run, log: str) -> list[dict[str, Any]]:
    assert lidarcli("-q", "detect", logs / log, "-o", tmp_path).code == 0
    rows: list[dict[str, Any]] = pq.read_table(next(tmp_path.glob("*.objects.parquet"))).to_pylist()
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("log", ["run.mcap", "two.mcap"])
@pytest.mark.parametrize("kind", ["arrow", "parquet", "ndjson", "csv"])
def test_streams_equal_the_table(logs: Path, tmp_path: Path, lidarcli: Run, process: Run, log: str, kind: str) -> None:
    expected = expected_rows(logs, tmp_path, lidarcli, log)
    files = pq.read_table(next(tmp_path.glob("*.objects.parquet")))
    ran = process("-q", "detect", logs / log, "-o", "-", "--format", kind)
    assert (ran.returncode, ran.stderr) == (0, b"")
    if kind == "arrow":
        assert pa.ipc.open_stream(ran.stdout).read_all().to_pylist() == expected
    elif kind == "parquet":
        table = pq.read_table(io.BytesIO(ran.stdout))
        assert table.to_pylist() == expected
        assert table.schema.equals(files.schema, check_metadata=True)
    elif kind == "ndjson":
        rows = [json.loads(line) for line in ran.stdout.splitlines()]
        assert [{**row, "stamp": None} for row in rows] == [{**row, "stamp": None} for row in shortest(files)]
    else:
        lines = list(csv.DictReader(io.StringIO(ran.stdout.decode())))
        assert [(row["topic"], int(row["sweep"]), float(row["x"])) for row in lines] == [
            (row["topic"], row["sweep"], row["x"]) for row in shortest(files)
        ]


def test_standard_input_equals_the_file(logs: Path, tmp_path: Path, lidarcli: Run, process: Run) -> None:
    expected = expected_rows(logs, tmp_path, lidarcli, "two.mcap")
    data = (logs / "two.mcap").read_bytes()
    ran = process("-q", "detect", "-", "-o", "-", "--format", "arrow", input=data)
    assert (ran.returncode, ran.stderr) == (0, b"")
    rows = pa.ipc.open_stream(ran.stdout).read_all().to_pylist()
    assert {row["log"] for row in rows} == {"stdin"}
    assert [{**row, "log": "two"} for row in rows] == expected


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["ndjson", "csv", "arrow", "parquet"])
def test_closed_pipe_ends_quietly(logs: Path, kind: str) -> None:
    """The reader takes a few bytes and goes away."""
    reader, writer = os.pipe()
    command = [sys.executable, "-m", "lidarcli", "-q", "detect", *[str(logs / "run.mcap")], "-o", "-"]
    running = subprocess.Popen([*command, "--format", kind], stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    os.close(reader)
    _, err = running.communicate(timeout=HANG)
    assert (running.returncode, err) == (0, b"")
