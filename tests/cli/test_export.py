"""`lidarcli export` and `simulate`: tables in other formats, and a log made of a scene."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet as pq
import pytest

from tests.places import SAMPLES
from tests.tabular.writing import shortest

Run = Callable[..., Any]
FORMULAS = (
    "  note     text of column {} begins as a formula does, which a spreadsheet would run: "
    "import such columns as text; for other programs they are as the log has them"
)


@pytest.fixture
def tables(lidarcli: Run, logs: Path, tmp_path: Path) -> Path:
    assert lidarcli("-q", "detect", str(logs / "run.mcap"), "-o", str(tmp_path / "tables")).code == 0
    return tmp_path / "tables"


def test_every_format_holds_the_rows_of_the_table(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    source = tables / "run.objects.parquet"
    expected = pq.read_table(source)
    for suffix in ("csv", "ndjson", "arrow", "parquet"):
        ran = lidarcli("export", str(source), "-o", str(tmp_path / f"x.{suffix}"))
        assert ran.code == 0, ran.err
        assert ran.err == f"  wrote    {tmp_path / f'x.{suffix}'} ({expected.num_rows:,} rows)\n"
    rows = list(csv.DictReader(io.StringIO((tmp_path / "x.csv").read_text())))
    assert [row["width"] for row in rows] == [repr(row["width"]) for row in shortest(expected)]
    assert [json.loads(row["faces"]) for row in rows] == [row["faces"] for row in shortest(expected)]
    lines = [json.loads(line) for line in (tmp_path / "x.ndjson").read_text().splitlines()]
    assert [line["vertices"] for line in lines] == [row["vertices"] for row in shortest(expected)]
    assert lines[0]["stamp"].endswith("Z")
    assert pa.ipc.open_stream(tmp_path / "x.arrow").read_all().equals(expected)
    assert pq.read_table(tmp_path / "x.parquet").equals(expected)
    assert pq.read_schema(tmp_path / "x.parquet").metadata == pq.read_schema(source).metadata


def test_columns_in_the_order_asked_for(lidarcli: Run, tables: Path) -> None:
    ran = lidarcli("export", str(tables / "run.sweeps.parquet"), "-o", "-", "--columns", "objects, sweep")
    assert ran.out.splitlines()[0] == "objects,sweep"
    wrong = lidarcli("export", str(tables / "run.sweeps.parquet"), "-o", "-", "--columns", "objcts", code=2)
    assert wrong.err.endswith("run.sweeps.parquet: no column objcts; did you mean objects?\n")


def test_several_tables_of_one_kind(lidarcli: Run, tables: Path) -> None:
    source = tables / "run.sweeps.parquet"
    one = lidarcli("export", str(source), "-o", "-").out.splitlines()
    # A table that is named twice is one.
    assert lidarcli("export", str(source), str(tables / "*.sweeps.parquet"), "-o", "-").out.splitlines() == one
    table = pq.read_table(source)
    other = {**table.schema.metadata, b"lidarcli.source": b'{"name": "other.mcap"}'}
    pq.write_table(table.replace_schema_metadata(other), tables / "other.sweeps.parquet")
    ran = lidarcli("-q", "export", str(tables / "*.sweeps.parquet"), "-o", str(tables / "both.parquet"))
    assert ran.code == 0, ran.err
    both = pq.read_table(tables / "both.parquet")
    assert both.num_rows == 2 * table.num_rows
    # Of two logs neither is the source.
    assert both.schema.metadata.keys() == table.schema.metadata.keys() - {b"lidarcli.source"}
    (tables / "both.parquet").unlink()
    mixed = lidarcli("export", str(tables), "-o", "-", code=2)
    assert "export each kind of table by itself" in mixed.err


def test_what_is_refused(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    source = str(tables / "run.sweeps.parquet")
    assert (
        "x.xlsx: the suffix of a table has to be one of .parquet, .csv, " in lidarcli("export", source, "-o", "x.xlsx").err
    )
    assert "--format is for the stream" in lidarcli("export", source, "-o", "x.csv", "--format", "csv").err
    (tmp_path / "there.csv").write_text("mine")
    ran = lidarcli("export", source, "-o", str(tmp_path / "there.csv"))
    assert (ran.code, (tmp_path / "there.csv").read_text()) == (5, "mine")
    assert lidarcli("export", source, "-o", source, "--overwrite").code != 0
    (tmp_path / "text.parquet").write_text("no table")
    ran = lidarcli("export", str(tmp_path / "text.parquet"), "-o", "-")
    assert (ran.code, ran.out) == (3, "")
    assert "text.parquet: cannot be read as Parquet" in ran.err


@pytest.mark.parametrize("options", [[], ["--columns", "objects"], ["--columns", "sweep,objects"]])
def test_a_column_there_twice_is_refused(lidarcli: Run, tables: Path, tmp_path: Path, options: list[str]) -> None:
    found = pq.read_table(tables / "run.sweeps.parquet")
    odd = tmp_path / "odd.parquet"
    pq.write_table(found.append_column(found.schema.field("objects"), found["objects"]), odd)
    line = f"lidarcli: {odd}: column objects is there 2 times, not once\n"
    for given in ([odd], [tables / "run.sweeps.parquet", odd]):
        ran = lidarcli("export", *map(str, given), "-o", "-", *options)
        assert (ran.code, ran.out, ran.err) == (3, "", line)
    assert lidarcli("export", str(odd), "-o", "-", "--columns", "sweep").code == 0


def test_text_that_a_spreadsheet_would_run_is_told(lidarcli: Run, tmp_path: Path) -> None:
    """The data stay as the log has them, for pandas and joins by name; people are warned."""
    table = pa.table({"log": ["a", "-b"], "topic": pa.array(["=cmd|x", "/scan"]).dictionary_encode(), "x": [-1.0, 2.0]})
    pq.write_table(table, tmp_path / "odd.parquet")
    ran = lidarcli("export", tmp_path / "odd.parquet", "-o", tmp_path / "odd.csv", code=0)
    assert ran.err.splitlines()[0] == FORMULAS.format("log, topic")
    assert (tmp_path / "odd.csv").read_text() == "log,topic,x\na,=cmd|x,-1.0\n-b,/scan,2.0\n"
    assert "formula" not in lidarcli("export", tmp_path / "odd.parquet", "-o", tmp_path / "odd.ndjson").err
    words = (tmp_path / "odd.parquet", "--columns", "x", "-o", tmp_path / "x.csv")
    assert "formula" not in lidarcli("export", *words).err


@pytest.mark.slow
def test_the_path_of_one_track_as_tum(lidarcli: Run, tmp_path: Path) -> None:
    assert lidarcli("-q", "track", SAMPLES / "people.csv.gz", "-o", tmp_path).code == 0
    source = tmp_path / "people.trajectories.parquet"
    rows = pq.read_table(source)
    mine = rows.filter(pa.compute.equal(rows["track"], 1))
    ran = lidarcli("export", source, "--only", "1", "-o", tmp_path / "1.tum")
    assert ran.err == f"  wrote    {tmp_path / '1.tum'} ({len(mine)} rows)\n"
    path = np.loadtxt(tmp_path / "1.tum")
    assert path[:, 1:3] == pytest.approx(np.column_stack([mine["x"], mine["y"]]), abs=1e-6)
    yaw = np.arctan2(mine["vy"].to_numpy(), mine["vx"].to_numpy())
    assert np.abs(np.angle(np.exp(1j * (2.0 * np.arctan2(path[:, 6], path[:, 7]) - yaw)))).max() < 1e-6
    # Where no sweep saw it there is a gap.
    seen = ["hidden" if row in (5, 6) else word for row, word in enumerate(mine["seen"].to_pylist())]
    pq.write_table(mine.set_column(mine.column_names.index("seen"), "seen", pa.array(seen)), tmp_path / "gap.parquet")
    ran = lidarcli("export", tmp_path / "gap.parquet", "--only", "1", "-o", tmp_path / "gap.tum")
    assert "2 places left out, where no sweep saw it" in ran.err
    lines = (tmp_path / "gap.tum").read_text().splitlines()
    assert (len(lines), lines.index("# gap")) == (len(mine) - 2 + 1, 5)
    # Of any table with tracks the rows of some.
    some = lidarcli("export", source, "--only", "1,2", "-o", "-", "--columns", "sweep").out.splitlines()
    assert len(some) == 1 + sum(track in (1, 2) for track in rows["track"].to_pylist())


@pytest.mark.slow
def test_a_tum_has_one_track(lidarcli: Run, tables: Path, tmp_path: Path) -> None:
    assert lidarcli("-q", "track", SAMPLES / "people.csv.gz", "-o", tmp_path).code == 0
    source = tmp_path / "people.trajectories.parquet"
    for more in ((), ("--only", "1,2"), ("--only", "1", "--columns", "x,y")):
        ran = lidarcli("export", source, *more, "-o", tmp_path / "1.tum", code=2)
        assert "a .tum has the path of one track" in ran.err
    for name, only in (("1.tum", "99"), ("1.csv", "99"), ("1.csv", "1,99")):
        ran = lidarcli("export", source, "--only", only, "-o", tmp_path / name, code=2)
        assert "no track 99 in it" in ran.err
        assert not (tmp_path / name).exists()
    assert "no column track" in lidarcli("export", tables / "run.sweeps.parquet", "--only", "1", "-o", "-").err
    assert not (tmp_path / "1.tum").exists()


ROOM = SAMPLES / "room.toml"


def test_log_and_truth(tmp_path: Path, lidarcli: Run) -> None:
    log = tmp_path / "room.bag"
    ran = lidarcli("simulate", ROOM, "-o", log, "--sweeps", "5", "--compression", "lz4", "--seed", "3")
    assert (ran.code, ran.out) == (0, "")
    names = ["room.bag", "room.truth.parquet", "room.truth-beams.parquet"]
    wrote = f"  wrote    {tmp_path}/room.{{bag,truth.parquet,truth-beams.parquet}}"
    assert ran.err.splitlines() == [f"{ROOM}: 5 sweeps", wrote]
    assert set(pq.read_table(tmp_path / names[1])["sweep"].to_pylist()) == set(range(5))
    info = lidarcli("info", log).out
    assert "  format      ros1 bag, compression lz4\n" in info
    assert "    sweeps    5\n" in info


def test_what_simulate_refuses(tmp_path: Path, lidarcli: Run) -> None:
    log = tmp_path / "room.mcap"
    lidarcli("simulate", ROOM, "-o", log, "--sweeps", "5", "--duration", "1", code=2)
    absent = lidarcli("simulate", tmp_path / "absent.toml", "-o", log)
    line = f"lidarcli: {tmp_path / 'absent.toml'}: cannot read the scene: No such file or directory\n"
    assert (absent.code, absent.err) == (3, line)
    log.write_text("mine")
    taken = lidarcli("simulate", ROOM, "-o", log)
    assert (taken.code, taken.err) == (
        5,
        f"lidarcli: {log} exists; use --overwrite to replace it, or -o to write elsewhere\n",
    )
    assert log.read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ("--sweeps", "99999999999999999999"),
            "--sweeps must be at least 0 and at most 10,000,000, not 99999999999999999999",
        ),
        (("--duration", "1e300"), "--duration must be at least 0 and at most 400,000,000 seconds, not 1e+300"),
        (
            ("--duration", "2e6"),
            "--duration 2e+06: 20,000,000 sweeps at 10 per second are more than a log may have (10,000,000)",
        ),
        (("--seed", str(1 << 63)), f"--seed must be at least 0 and at most {(1 << 63) - 1}, not {1 << 63}"),
    ],
)
def test_a_log_has_bounds(tmp_path: Path, lidarcli: Run, options: tuple[str, str], message: str) -> None:
    ran = lidarcli("simulate", ROOM, "-o", tmp_path / "room.mcap", *options)
    assert (ran.code, ran.out, ran.err) == (2, "", f"lidarcli: {message}\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("container", ["mcap", "bag", "csv"])
def test_a_scene_at_its_bounds(tmp_path: Path, lidarcli: Run, container: str) -> None:
    scene = tmp_path / "far.toml"
    scene.write_text(
        "[sensor]\nnoise = 1e6\nrate = 0.001\nrange_max = 1e6\nmixed_pixels = 1\n"
        "[robot]\nspeed = 1e6\nwaypoints = [[-1e6, 1e6], [1e6, -1e6]]\n[robot.odometry]\nnoise = 1e6\nyaw_noise = 1e6\n"
        "[[wall]]\npoints = [[-1e6, -1e6], [1e6, -1e6], [1e6, 1e6]]\nclosed = true\n"
        "[[person]]\nx = 1e6\ny = -1e6\nvelocity = [1e6, 1e6]\nyaw_rate = 1e6\nstride = 1e6\n"
        "[[cylinder]]\nx = 1\ny = 1\nradius = 1e-300\n[[box]]\nx = 0\ny = 0\nlength = 1e-300\nwidth = 1e6\n"
    )
    ran = lidarcli("-q", "simulate", scene, "-o", tmp_path / f"far.{container}", "--sweeps", "5")
    assert (ran.code, ran.err) == (0, "")
    found = lidarcli("-q", "detect", tmp_path / f"far.{container}", "-o", "-")
    assert (found.code, found.err) == (0, "")
    long = lidarcli("simulate", scene, "-o", tmp_path / "long.mcap", "--sweeps", "400001")
    assert (long.code, long.err) == (
        2,
        f"lidarcli: {scene}: 400,001 sweeps at 0.001 per second take longer than a log may (400,000,000 seconds)\n",
    )
