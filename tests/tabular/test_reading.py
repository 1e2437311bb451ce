"""Tables that another program has written or somebody has changed: cast where nothing is lost, else one line and code 3."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.cli import run
from lidarcli.errors import UnreadableError
from lidarcli.pipeline.inputs.tables import TableSet, find_table_sets, read_table, table_files
from lidarcli.pipeline.objects import tracking
from lidarcli.tabular.background import GEOMETRY
from lidarcli.tabular.reading import MAX_VALUE, MAX_WHOLE, StoredTable, read_columns, read_schema
from lidarcli.tabular.schemas import BACKGROUND, NULLABLE, OBJECTS, SCHEMAS, TRACKS
from tests.pipeline.patient import Patient
from tests.places import SAMPLES

ALL = {**SCHEMAS, "background": BACKGROUND}


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tables and a background of a room of six sweeps, with the logs."""
    folder = tmp_path_factory.mktemp("original")
    for name in ("room", "room_empty"):
        scene = str(SAMPLES / f"{name}.toml")
        assert run(["-q", "simulate", scene, "-o", str(folder / f"{name}.mcap"), "--sweeps", "6"]) == 0
    background = ["-q", "background", "build", str(folder / "room_empty.mcap"), "-o", str(folder / "b.parquet")]
    assert run(background) == 0
    assert run(["-q", "detect", str(folder / "room.mcap"), "-o", str(folder), "--beams"]) == 0
    return folder


@pytest.fixture
def tables(original: Path, tmp_path: Path) -> Path:
    """A copy that may be changed."""
    folder = tmp_path / "tables"
    folder.mkdir()
    for file in original.glob("*.parquet"):
        (folder / file.name).write_bytes(file.read_bytes())
    (folder / "base").mkdir()
    for kind in ("objects", "sweeps"):
        (folder / "base" / f"room.{kind}.parquet").write_bytes((original / f"room.{kind}.parquet").read_bytes())
    return folder


def file_of(folder: Path, kind: str) -> Path:
    return folder / ("b.parquet" if kind == "background" else f"room.{kind}.parquet")


def replaced(table: pa.Table, name: str, values: Any) -> pa.Table:
    """The table with another column in the place of one."""
    at = table.schema.get_field_index(name)
    return table.set_column(at, name, values)


def by_pandas(path: Path) -> None:
    frame = pd.read_parquet(path)
    for name in frame.columns:
        if isinstance(frame[name].dtype, pd.CategoricalDtype):
            frame[name] = frame[name].astype(str if frame[name].notna().all() else object)
    frame.to_parquet(path)


def by_polars(path: Path) -> None:
    frame = pl.read_parquet(path)
    frame.with_columns(pl.col(pl.Categorical).cast(pl.String)).write_parquet(path)


def by_duckdb(path: Path) -> None:
    other = path.with_suffix(".other")
    duckdb.sql(f"copy (select * from '{path}') to '{other}' (format parquet)")
    other.replace(path)


def narrow(path: Path) -> None:
    """Other widths of everything: int64 for int32, text of other kinds, stamps in microseconds without a zone."""
    table = pq.read_table(path)
    for field in table.schema:
        kind = field.type
        column = table[field.name]
        if pa.types.is_dictionary(kind):
            column = column.cast(pa.string()).cast(pa.large_string())
        elif pa.types.is_int32(kind):
            column = column.cast(pa.int64())
        elif pa.types.is_int64(kind):
            column = column.cast(pa.int32())
        elif pa.types.is_timestamp(kind):
            column = column.cast(pa.timestamp("us"))
        elif pa.types.is_list(kind):
            column = column.cast(pa.large_list(kind.value_field))
        table = replaced(table, field.name, column)
    pq.write_table(table, path)


WRITERS = {"pandas": by_pandas, "polars": by_polars, "duckdb": by_duckdb, "narrow": narrow}


@pytest.mark.slow
@pytest.mark.parametrize("writer", WRITERS)
def test_what_other_programs_write_gives_the_same_report(
    tables: Path, writer: str, capfd: pytest.CaptureFixture[str]
) -> None:
    def report() -> dict[str, Any]:
        check = "objects where vertices > 0 and change is null and track is null > 0"
        assert run(["report", str(tables / "room.objects.parquet"), "--format", "json", "--check", check]) == 0
        found: dict[str, Any] = json.loads(capfd.readouterr().out)
        # The metadata of a table is not the other program's to keep.
        return {name: value for name, value in found.items() if name != "sources"}

    wanted = report()
    for kind in ("objects", "sweeps", "beams"):
        WRITERS[writer](file_of(tables, kind))
    assert report() == wanted
    page = tables / "r.html"
    assert run(["-q", "report", str(tables / "room.objects.parquet"), "-o", str(page)]) == 0
    assert '"raw":{' in page.read_text()


def test_a_background_by_another_program_needs_its_metadata(tables: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = file_of(tables, "background")
    table = pq.read_table(path)
    narrow(path)
    assert run(["-q", "info", str(path)]) == 0
    pq.write_table(table.replace_schema_metadata(None), path)
    capfd.readouterr()
    assert run(["info", str(path)]) == 3
    assert capfd.readouterr().err == (
        f"lidarcli: {path}: no {GEOMETRY} in its metadata, which other programs leave out when they write a table; "
        "build it again with lidarcli background build\n"
    )


def test_nan_is_null(tables: Path) -> None:
    path = file_of(tables, "objects")
    table = pq.read_table(path)
    values = np.full(table.num_rows, np.nan)
    pq.write_table(replaced(replaced(table, "width", pa.array(values)), "track", pa.array(values)), path)
    found = read_columns(path, "objects", OBJECTS, ["width", "track"])
    assert found["width"].null_count == found["track"].null_count == table.num_rows


@pytest.mark.parametrize(
    ("kind", "name", "change", "message"),
    [
        ("sweeps", "topic", lambda n: pa.array([0.5] * n), "column topic is double, not text"),
        ("objects", "width", lambda n: pa.array(["0.5"] * n), "column width is text, not float"),
        ("sweeps", "stamp", lambda n: pa.array([5] * n), "column stamp is int64, not timestamp"),
        (
            "sweeps",
            "beams",
            lambda n: pa.array([1.5] * n),
            "column beams holds a value that is no int32: Float value 1.500000 was truncated converting to int32",
        ),
        ("sweeps", "valid", lambda n: pa.array([-1] * n), "column valid holds -1; the least that it can be is 0"),
        (
            "sweeps",
            "sweep",
            lambda n: pa.array([MAX_WHOLE + 1] * n),
            f"column sweep holds {MAX_WHOLE + 1}; the most that it can be is {MAX_WHOLE:g}",
        ),
        (
            "objects",
            "width",
            lambda n: pa.array([np.inf] * n),
            f"column width holds inf; the most that it can be is {MAX_VALUE:g}",
        ),
        (
            "objects",
            "x",
            lambda n: pa.array([-1e300] * n),
            f"column x holds -1e+300; the least that it can be is {-MAX_VALUE:g}",
        ),
        (
            "sweeps",
            "sweep",
            lambda n: pa.array([None] + [1] * (n - 1), pa.int64()),
            "column sweep is empty (null) in 1 of 6 rows",
        ),
        (
            "objects",
            "vertices",
            lambda n: pa.array([[{"theta": 1.0, "r": 2.0}]] * n),
            "column vertices is list of struct (theta, r), not list of struct (theta, r, kind)",
        ),
    ],
)
def test_what_cannot_be_cast_is_one_line(
    tables: Path, kind: str, name: str, change: Callable[[int], Any], message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = file_of(tables, kind)
    table = pq.read_table(path)
    pq.write_table(replaced(table, name, change(table.num_rows)), path)
    check = "objects where vertices > 0 and sweep > 0 > 0"
    assert run(["report", str(tables / "room.objects.parquet"), "--check", check]) == 3
    ran = capfd.readouterr()
    assert (ran.out, ran.err) == ("", f"lidarcli: {path}: {message}\n")


def test_a_column_there_twice_and_one_that_is_missing(tables: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = file_of(tables, "sweeps")
    table = pq.read_table(path)
    pq.write_table(table.append_column("beams", table["beams"]), path)
    assert run(["report", str(path)]) == 3
    assert capfd.readouterr().err == f"lidarcli: {path}: column beams is there 2 times, not once\n"
    pq.write_table(table.drop_columns(["beams"]), path)
    assert run(["report", str(path)]) == 3
    assert capfd.readouterr().err == (f"lidarcli: {path}: not a table of lidarcli detect: no column beams\n")


@pytest.mark.slow
def test_a_beams_table_that_cannot_be_read_leaves_the_rest_of_the_page(
    tables: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = file_of(tables, "beams")
    table = pq.read_table(path)
    pq.write_table(replaced(table, "theta", table["topic"].cast(pa.string())), path)
    page = tables / "r.html"
    assert run(["-q", "report", str(tables / "room.objects.parquet"), "-o", str(page)]) == 3
    line = f"{path}: column theta is text, not float"
    assert capfd.readouterr().err == f"lidarcli: {line}\n"
    assert line in page.read_text()
    far = pa.array([2**31 - 1] * table.num_rows, pa.int32())
    pq.write_table(replaced(table, "beam", far), path)
    assert run(["-q", "report", str(tables / "room.objects.parquet"), "-o", str(page), "--overwrite"]) == 3
    assert capfd.readouterr().err == (
        f"lidarcli: {path}: column beam holds 2,147,483,647: 6 sweeps of so many beams are too many to show\n"
    )


def test_only_columns_that_say_so_may_be_null() -> None:
    for kind, schema in ALL.items():
        said = {field.name for field in schema if b"null" in field.metadata[b"description"]}
        assert said == NULLABLE[kind] == {field.name for field in schema if field.nullable}


TABLES = ("objects", "sweeps", "tracks")


@pytest.fixture
def tracked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Tables in which every second object is an agent; things that never moved have no stamp of it."""
    monkeypatch.setattr(tracking, "Tracker", Patient)
    assert run(["-q", "track", str(SAMPLES / "room.mcap"), "-o", str(tmp_path), "--end", "0.5", "--no-memory"]) == 0
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("table", TABLES)
def test_what_other_programs_write_is_read_as_it_was(tracked: Path, table: str, writer: str) -> None:
    path = tracked / f"room.{table}.parquet"
    wanted = pq.read_table(path)
    WRITERS[writer](path)
    found = read_columns(path, table, SCHEMAS[table])
    assert found.schema.equals(read_schema(SCHEMAS[table]))
    rows = [found.to_pylist(), wanted.to_pylist()]
    if writer == "narrow":
        for row in (row for some in rows for row in some):
            for name in [name for name in row if "stamp" in name or name == "moved_at"]:
                row[name] = row[name] and row[name].value // 1000
    assert rows[0] == rows[1]
    if table == "objects":
        assert {row["moving"] for row in rows[0]} == {False, True}


def test_a_missing_column_is_told(tracked: Path) -> None:
    path = tracked / "room.objects.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["track", "vx"]), path)
    with pytest.raises(UnreadableError, match=r"not a table of lidarcli detect: no column track, vx$"):
        read_columns(path, "objects", OBJECTS)
    path = tracked / "room.tracks.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["end"]), path)
    with pytest.raises(UnreadableError, match=r"not a table of lidarcli track: no column end$"):
        read_columns(path, "tracks", TRACKS)


def test_a_tracks_table_names_its_log(tracked: Path) -> None:
    pairs, problems = find_table_sets([str(tracked / "room.tracks.parquet"), str(tracked / "*.tracks.parquet")])
    assert (pairs, problems) == ([TableSet(f"{tracked}/room.", ".parquet")], [])
    assert pairs[0].tracks == tracked / "room.tracks.parquet"
    assert pairs[0].tracks in table_files([str(tracked)])
    assert read_table(pairs[0], "tracks", ["track", "set"]).to_pydict() == {
        "track": [1, 2, 3, 4, 5],
        "set": ["O", "A", "O", "A", "O"],
    }


def test_a_stored_table_has_the_same_columns_and_refuses_other_rows(tables: Path) -> None:
    path, names = file_of(tables, "objects"), ("topic", "sweep", "x", "moving", "vertices")
    whole, stored = read_columns(path, "objects", OBJECTS, names), StoredTable.of(path, "objects", names)
    assert (len(stored), stored.column_names, stored.schema) == (len(whole), whole.column_names, whole.schema)
    assert all(stored[name].equals(whole[name]) for name in names)
    for rows in (whole.slice(1), pa.concat_tables([whole, whole])):
        pq.write_table(rows, path)
        with pytest.raises(UnreadableError, match="written again"):
            stored["x"]
