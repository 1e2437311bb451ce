"""Tables that another program has written or somebody has changed: cast where nothing is lost, else one line and code 3."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator
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
from lidarcli.pipeline.reporting import VIEWER_COLUMNS
from lidarcli.pipeline.viewing import BEAM_COLUMNS
from lidarcli.reports.summary import OBJECT_COLUMNS, SWEEP_COLUMNS
from lidarcli.tabular.background import GEOMETRY
from lidarcli.tabular.reading import GREATEST_VALUE, MOST_WHOLE, read_columns
from lidarcli.tabular.schemas import BACKGROUND, NULLABLE, OBJECTS, SCHEMAS
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


def test_single_precision_is_read(tables: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for kind in ("objects", "sweeps", "background"):
        path = file_of(tables, kind)
        table = pq.read_table(path)
        for field in table.schema:
            if pa.types.is_floating(field.type):
                table = replaced(table, field.name, table[field.name].cast(pa.float32(), safe=False))
        pq.write_table(table, path)
    assert run(["report", str(tables / "room.objects.parquet"), "--check", "width.max > 0.5"]) == 0
    assert run(["info", str(tables / "b.parquet")]) == 0
    assert "/scan" in capfd.readouterr().out


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
        ("sweeps", "topic", lambda n: pa.array([True] * n), "column topic is bool, not text"),
        ("objects", "width", lambda n: pa.array(["0.5"] * n), "column width is text, not float"),
        ("objects", "sweep", lambda n: pa.array([b"1"] * n), "column sweep is binary, not int64"),
        ("sweeps", "stamp", lambda n: pa.array([5] * n), "column stamp is int64, not timestamp"),
        (
            "sweeps",
            "beams",
            lambda n: pa.array([1.5] * n),
            "column beams holds a value that is no int32: Float value 1.500000 was truncated converting to int32",
        ),
        (
            "sweeps",
            "beams",
            lambda n: pa.array([1 << 40] * n),
            "column beams holds a value that is no int32: Integer value 1099511627776 not in range: "
            "-2147483648 to 2147483647",
        ),
        ("sweeps", "valid", lambda n: pa.array([-1] * n), "column valid holds -1; the least that it can be is 0"),
        (
            "sweeps",
            "sweep",
            lambda n: pa.array([MOST_WHOLE + 1] * n),
            f"column sweep holds {MOST_WHOLE + 1}; the most that it can be is {MOST_WHOLE:g}",
        ),
        (
            "objects",
            "width",
            lambda n: pa.array([np.inf] * n),
            f"column width holds inf; the most that it can be is {GREATEST_VALUE:g}",
        ),
        (
            "objects",
            "x",
            lambda n: pa.array([-1e300] * n),
            f"column x holds -1e+300; the least that it can be is {-GREATEST_VALUE:g}",
        ),
        (
            "sweeps",
            "sweep",
            lambda n: pa.array([None] + [1] * (n - 1), pa.int64()),
            "column sweep is empty (null) in 1 of 6 rows",
        ),
        ("sweeps", "topic", lambda n: pa.array([None] * n), "column topic is empty (null) in 6 of 6 rows"),
        (
            "objects",
            "vertices",
            lambda n: pa.array([[1, 2]] * n),
            "column vertices is list of int64, not list of struct (theta, r, kind)",
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


def test_text_that_is_no_utf8(tables: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = file_of(tables, "sweeps")
    table = pq.read_table(path)
    broken = pa.array([b"/\xff"] * table.num_rows).view(pa.string())
    pq.write_table(replaced(table, "topic", broken), path)
    assert run(["report", str(path)]) == 3
    assert capfd.readouterr().err.startswith(f"lidarcli: {path}: column topic holds a value that is no text: ")


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


def changes(count: int, column: pa.ChunkedArray) -> Iterator[tuple[str, Any]]:
    """Columns that somebody may put in the place of a column."""
    yield "doubles", pa.array(np.linspace(-1, 1, count))
    yield "infinite", pa.array([np.inf, -np.inf] * count)[:count]
    yield "huge", pa.array([1.7e308, -1.7e308] * count)[:count]
    yield "tiny", pa.array([5e-324, -5e-324] * count)[:count]
    yield "large", pa.array([GREATEST_VALUE, -GREATEST_VALUE] * count)[:count]
    yield "nulls", pa.array([None] * count)
    yield "some nulls", pa.array([*column.to_pylist()[:-1], None], column.type)
    yield "ones", pa.array([1] * count)
    yield "extremes", pa.array([2**63 - 1, -(2**63)] * count)[:count]
    yield "greatest", pa.array([2**31 - 1] * count)
    yield "times", pa.array([2**52] * count, pa.timestamp("s"))
    yield "microseconds", pa.array([-(2**52)] * count, pa.timestamp("us", tz="Europe/Berlin"))
    yield "texts", pa.array(["a\x01\x1b[2J]]>"] * count)
    others = (
        pa.array([True] * count),
        pa.array([b"\xff"] * count),
        pa.array([{"theta": "x"}] * count),
        pa.array([[1.0]] * count),
        pa.array([[[{"theta": 1.0, "r": None, "kind": None}]]] * count),
        pa.array([2**64 - 1] * count, pa.uint64()),
    )
    yield "another type", others[hash_of(column) % len(others)]


def hash_of(column: pa.ChunkedArray) -> int:
    """A number that differs from column to column, not from run to run."""
    return len(str(column.type)) + len(column) + column.null_count


COMMANDS: dict[str, Callable[[Path, Path], list[list[str]]]] = {
    "report": lambda folder, logs: [
        *(
            ["report", str(folder / "room.objects.parquet"), "--format", form, "--check", CHECK]
            for form in ("text", "markdown", "json", "junit", "html")
        ),
        ["report", str(folder / "room.objects.parquet"), *("--format", "html", "--log", str(logs / "room.mcap"))],
        ["report", str(folder / "base"), "--baseline", str(folder / "room.objects.parquet")],
    ],
    "background": lambda folder, logs: [
        ["info", str(folder / "b.parquet")],
        ["info", str(folder / "b.parquet"), "--format", "json"],
        ["detect", str(logs / "room.mcap"), "--background", str(folder / "b.parquet"), "-o", "-"],
    ],
}
CHECK = (
    "objects where vertices > 0 and faces > 0 and track is null and world_x is null and frame_id != x "
    "and s_i is not null and beam_f > 0 >= 0"
)


def survive(commands: list[list[str]], capfd: pytest.CaptureFixture[str], what: str) -> None:
    """Every command ends with a documented code, one line per problem, and no warning."""
    for command in commands:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            code = run(["-q", *command])
        ran = capfd.readouterr()
        assert code in (0, 1, 2, 3), f"{what}: {' '.join(command)}: {ran.err}"
        lines = ran.err.splitlines()
        assert all(line.startswith("lidarcli: ") and line.isprintable() for line in lines), (what, lines)
        # A column is told of once, wherever it is used.
        assert len(lines) == len(set(lines)) <= 2, (what, lines)
        assert (code == 0) == (not lines), (what, code, lines)


READ = {
    "objects": {*OBJECT_COLUMNS, *VIEWER_COLUMNS, "vertices", "faces", "track", "frame_id", "s_i", "beam_f"},
    "sweeps": {*SWEEP_COLUMNS},
    "beams": {*BEAM_COLUMNS},
    "background": {*BACKGROUND.names},
}


@pytest.mark.whole
@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in READ for name in sorted(READ[kind])])
def test_any_change_of_a_column_ends_with_a_documented_code(
    original: Path, tables: Path, kind: str, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    path = file_of(tables, kind)
    table = pq.read_table(path)
    commands = COMMANDS["background" if kind == "background" else "report"](tables, original)
    if kind == "beams":
        # Only the page shows beams.
        commands = commands[4:5]
    for number, (what, values) in enumerate(changes(table.num_rows, table[name])):
        pq.write_table(replaced(table, name, values), path)
        # The figures are the same in all formats, which take turns.
        survive([commands[(number + len(name)) % len(commands)]], capfd, f"{kind}.{name}: {what}")


GEOMETRIES = [
    "nonsense",
    [1, 2],
    {"topic": 1},
    [[]],
    [{}],
    None,
    *(
        [{"topic": "/scan", "frame_id": "laser", **dict.fromkeys(("angle_min", "angle_increment"), 0.1), **more}]
        for more in ({"beams": "x"}, {"beams": 10**30}, {"beams": None}, {})
    ),
]
VALUES = [None, [], {}, "x", -1, 0, 0.5, 1e308, -1e308, 5e-324, 10**400, float("inf"), float("nan"), True, [[[]]]]


@pytest.mark.whole
def test_any_geometry_ends_with_a_documented_code(original: Path, tables: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = file_of(tables, "background")
    table = pq.read_table(path)
    entry = json.loads(table.schema.metadata[GEOMETRY.encode()])[0]
    geometries = [*GEOMETRIES, *([{**entry, key: value}] for key in entry for value in VALUES)]
    texts = [*map(json.dumps, geometries), "[" * 100_000, '[{"beams":' * 400, "\x00"]
    commands = COMMANDS["background"](tables, original)
    for number, text in enumerate(texts):
        metadata = {**table.schema.metadata, GEOMETRY.encode(): text.encode()}
        pq.write_table(table.replace_schema_metadata(metadata), path)
        survive([commands[number % 3]], capfd, text[:200])
    for key in ("lidarcli.source", "lidarcli.parameters", "lidarcli.damage", "lidarcli.version"):
        for value in (*map(json.dumps, VALUES), "[" * 100_000, "[" * 300 + "]" * 300, '[{"name": []}]'):
            metadata = {**table.schema.metadata, key.encode(): value.encode()}
            pq.write_table(table.replace_schema_metadata(metadata), path)
            survive(commands[:2], capfd, f"{key}: {value[:200]}")


@pytest.mark.whole
def test_any_metadata_of_a_run_ends_with_a_documented_code(
    original: Path, tables: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = file_of(tables, "sweeps")
    table = pq.read_table(path)
    parameters = [{name: value} for name in ("csv", "range", "no_return") for value in (*VALUES, [None, None])]
    parameters += [{"csv": {"fov": value, "range_scale": value}, "no_return": [value]} for value in VALUES]
    parameters += [{"range": [value, value], "no_return": ["inf"]} for value in VALUES]
    texts = [*map(json.dumps, [*VALUES, *parameters]), "[" * 100_000, "[" * 300 + "]" * 300]
    commands = COMMANDS["report"](tables, original)
    for number, (key, text) in enumerate(
        [
            *(("lidarcli.parameters", text) for text in texts),
            *((f"lidarcli.{key}", text) for key in ("source", "damage") for text in texts[: len(VALUES)]),
        ]
    ):
        metadata = {**table.schema.metadata, key.encode(): text.encode()}
        pq.write_table(table.replace_schema_metadata(metadata), path)
        # The parameters are what a log is read with.
        command = commands[5] if key == "lidarcli.parameters" and number % 2 else commands[number % 5]
        survive([command], capfd, f"{key}: {text[:200]}")


@pytest.mark.slow
def test_bad_names_of_tables(original: Path, tmp_path: Path, capfdbinary: pytest.CaptureFixture[bytes]) -> None:
    """`detect bad\\xff.mcap` writes such tables."""
    for kind in ("objects", "sweeps", "beams"):
        data = (original / f"room.{kind}.parquet").read_bytes()
        (tmp_path / f"bad\udcff.{kind}.parquet").write_bytes(data)
    (tmp_path / "worse\udcff.sweeps.parquet").write_bytes(b"")
    for form in ("text", "markdown", "json", "junit", "html", "github"):
        assert run(["report", str(tmp_path / "bad\udcff.objects.parquet"), "--format", form]) == 0, form
        ran = capfdbinary.readouterr()
        assert ran.err == b""
        assert ran.out.decode("utf-8")
        table = str(tmp_path / "worse\udcff.sweeps.parquet")
        assert run(["report", str(tmp_path / "bad\udcff.sweeps.parquet"), table, "--format", form]) == 3, form
        ran = capfdbinary.readouterr()
        line = f"{tmp_path}/worse\\udcff.sweeps.parquet: cannot be read as Parquet: ".encode()
        # Workflow commands are for the log of a step, which shows both streams.
        assert ran.err == b"" if form == "github" else ran.err.startswith(b"lidarcli: " + line)
        # In Markdown some signs have escapes of their own.
        plain = ran.out.replace(b"\\\\", b"\\").replace(b"\\_", b"_") if form == "markdown" else ran.out
        # The text is broken into lines of 80 characters, at spaces or in a long name.
        if form == "text":
            line, plain = line.replace(b" ", b""), b"".join(plain.split())
        assert line in plain, form
    background = tmp_path / "b\udcff\x1b.parquet"
    background.write_bytes((original / "b.parquet").read_bytes())
    assert run(["info", str(background)]) == 0
    assert capfdbinary.readouterr().out.startswith(f"{tmp_path}/b\\udcff\\x1b.parquet\n".encode())
    assert run(["info", str(background), "--format", "json"]) == 0
    assert json.loads(capfdbinary.readouterr().out)[0]["path"] == str(background)
