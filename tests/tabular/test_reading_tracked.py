"""Tables of tracking read back, by whomever they were written."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest

from lidarcli.cli import run
from lidarcli.errors import UnreadableError
from lidarcli.pipeline.inputs.tables import TableSet, find_table_sets, read_table, table_files
from lidarcli.pipeline.objects import tracking
from lidarcli.tabular import SCHEMAS
from lidarcli.tabular.reading import read_columns, read_schema
from lidarcli.tabular.schemas import OBJECTS, TRACKS
from tests.pipeline.patient import Patient
from tests.places import SAMPLES
from tests.tabular.test_reading import WRITERS

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
