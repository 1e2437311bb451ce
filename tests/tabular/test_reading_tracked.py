"""Tables of tracking read back, by whomever they were written, and tables from before there was any."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from lidarcli.cli import run
from lidarcli.errors import UnreadableError
from lidarcli.pipeline.inputs.tables import TableSet, find_table_sets, read_table, table_files
from lidarcli.pipeline.objects import following
from lidarcli.reports.figures import STATISTICS
from lidarcli.tabular import SCHEMAS
from lidarcli.tabular.reading import read_columns, read_pieces, read_schema
from lidarcli.tabular.schemas import LATER, OBJECTS, TRACKS
from tests.pipeline.patient import Patient
from tests.places import SAMPLES
from tests.tabular.test_reading import WRITERS

TABLES = ("objects", "sweeps", "tracks")


@pytest.fixture
def tracked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Tables in which every second object is an agent; things that never moved have no stamp of it."""
    monkeypatch.setattr(following, "Tracker", Patient)
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


@pytest.mark.parametrize("table", ["objects", "sweeps"])
def test_a_table_from_before_has_nulls_for_what_it_did_not_know(tracked: Path, table: str) -> None:
    path = tracked / f"room.{table}.parquet"
    today = pq.read_table(path)
    pq.write_table(today.drop_columns([*LATER[table]]), path)
    found = read_columns(path, table, SCHEMAS[table])
    assert found.schema.equals(read_schema(SCHEMAS[table]))
    assert {name for name in found.column_names if found[name].null_count == today.num_rows > 0} >= LATER[table]
    kept = [name for name in today.column_names if name not in LATER[table]]
    assert found.select(kept).to_pylist() == today.select(kept).to_pylist()
    assert read_columns(path, table, SCHEMAS[table], ["t"])["t"].null_count == today.num_rows
    pieces = list(read_pieces(path, table, SCHEMAS[table], ["sweep", "t"]))
    assert sum(rows["t"].null_count for rows in pieces) == today.num_rows


def test_a_report_takes_tables_from_before(tracked: Path, capfd: pytest.CaptureFixture[str]) -> None:
    def report() -> dict[str, object]:
        assert run(["report", str(tracked), "--format", "json"]) == 0
        found: dict[str, object] = json.loads(capfd.readouterr().out)
        return found["figures"]  # type: ignore[return-value]

    assert run(["-q", "detect", str(SAMPLES / "room.mcap"), "-o", str(tracked), "--end", "0.5", "--overwrite"]) == 0
    (tracked / "room.tracks.parquet").unlink()
    wanted = report()
    for table in ("objects", "sweeps"):
        path = tracked / f"room.{table}.parquet"
        pq.write_table(pq.read_table(path).drop_columns([*LATER[table]]), path)
    # Nobody had measured it.
    assert report() == wanted | {f"nearest.{statistic}": None for statistic in STATISTICS}


def doubles(path: Path) -> None:
    """Write a table again as earlier versions did: every number double, with digits that single precision drops."""

    def kind_of(kind: pa.DataType) -> pa.DataType:
        if pa.types.is_list(kind):
            return pa.list_(kind_of(kind.value_type))
        if pa.types.is_struct(kind):
            return pa.struct([(part.name, kind_of(part.type)) for part in kind])
        return pa.float64() if pa.types.is_float32(kind) else kind

    table = pq.read_table(path)
    columns = []
    for field in table.schema:
        column = table[field.name].cast(kind_of(field.type))
        columns.append(pc.multiply(column, 1 + 1e-8) if pa.types.is_float32(field.type) else column)
    fields = [pa.field(field.name, column.type) for field, column in zip(table.schema, columns, strict=True)]
    schema = pa.schema(fields, metadata=table.schema.metadata)
    pq.write_table(pa.Table.from_arrays(columns, schema=schema), path)


@pytest.mark.slow
def test_tables_in_double_precision_say_the_same(tmp_path: Path) -> None:
    log = str(SAMPLES / "people.csv.gz")
    today, before = tmp_path / "today", tmp_path / "before"
    assert run(["-q", "track", log, "-o", str(today), "--beams"]) == 0
    other = tmp_path / "people.tracks.parquet"
    other.write_bytes((today / other.name).read_bytes())
    before.mkdir()
    for file in today.glob("*.parquet"):
        (before / file.name).write_bytes(file.read_bytes())
        doubles(before / file.name)
    assert str(pq.read_schema(before / "people.objects.parquet").field("vertices").type).count("double") == 2
    assert pq.read_schema(before / "people.tracks.parquet").field("length").type == pa.float64()
    for folder in (today, before):
        objects = str(folder / "people.objects.parquet")
        check = ["--check", "objects where thing > 0.5 and width <= 0.5 > 0", "--check", "d_th.min >= 0.08"]
        commands = [
            *(["report", objects, "-o", str(folder / name), *check] for name in ("r.json", "r.xml", "r.html")),
            ["overlay", log, "--objects", objects, "-o", str(folder / "o.mcap")],
            ["plot", log, "--sweep", "15", "--tracks", objects, "-o", str(folder / "p.svg")],
            ["diff", str(other), str(folder / "people.tracks.parquet"), "-o", str(folder / "m.csv")],
            ["export", objects, "-o", str(folder / "e.ndjson")],
        ]
        for command in commands:
            assert run(["-q", *command]) == 0, command
    for name in ("r.json", "r.xml", "o.mcap", "p.svg", "m.csv"):
        one, two = ((folder / name).read_bytes() for folder in (today, before))
        assert one == two.replace(bytes(before), bytes(today)), name


def test_a_column_that_was_always_there_is_missed(tracked: Path) -> None:
    path = tracked / "room.objects.parquet"
    pq.write_table(pq.read_table(path).drop_columns(["track", "vx"]), path)
    with pytest.raises(UnreadableError, match=r"not a table of lidarcli detect: no column track$"):
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
