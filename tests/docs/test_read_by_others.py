"""pandas, DuckDB and polars read every table directly, also one without rows."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path

import duckdb
import pandas as pd
import polars as pl
import pyarrow.parquet as pq
import pytest

from lidarcli.cli import run
from lidarcli.simulation.generate import START_NS
from tests.places import SAMPLES

SCENE = SAMPLES / "room.toml"
TABLES = ("objects", "sweeps", "tracks", "beams")


@pytest.fixture(scope="module", params=[3, 0], ids=["rows", "empty"])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tables of a log with some sweeps, and of one without any object."""
    path = tmp_path_factory.mktemp("tables")
    log = str(path / "room.mcap")
    widths = [] if request.param else ["--max-width", "1e-6", "--min-beams", "1000"]
    assert run(["-q", "simulate", str(SCENE), "-o", log, "--sweeps", "3"]) == 0
    assert run(["-q", "track", log, "-o", str(path), "--beams", *widths]) == 0
    return path


@pytest.mark.parametrize("table", TABLES)
def test_all_readers_agree(folder: Path, table: str) -> None:
    path = folder / f"room.{table}.parquet"
    arrow = pq.read_table(path)
    frames = {
        "pandas": list(pd.read_parquet(path).columns),
        "duckdb": [column[0] for column in duckdb.sql(f"describe select * from '{path}'").fetchall()],
        "polars": pl.read_parquet(path).columns,
    }
    assert frames == dict.fromkeys(frames, arrow.column_names)
    assert len(pd.read_parquet(path)) == arrow.num_rows
    assert duckdb.sql(f"select count(*) from '{path}'").fetchall() == [(arrow.num_rows,)]
    assert pl.read_parquet(path).height == arrow.num_rows


def test_stamps_and_nested_columns_survive(folder: Path) -> None:
    stamps = [START_NS + 100_000_000 * sweep for sweep in range(3)]
    path = folder / "room.sweeps.parquet"
    frame = pd.read_parquet(path)
    assert str(frame["stamp"].dtype) == "datetime64[ns, UTC]"
    assert frame["stamp"].astype("int64").tolist() == stamps
    polars_stamp = pl.read_parquet(path)["stamp"]
    assert polars_stamp.dtype == pl.Datetime("ns", "UTC")
    assert polars_stamp.dt.epoch("ns").to_list() == stamps
    assert duckdb.sql(f"select epoch_ns(stamp) from '{path}' order by sweep").fetchall() == [(stamp,) for stamp in stamps]


def test_the_queries_of_stamps(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = (SCENE.parent.parent / "docs" / "tables.md").read_text("utf-8")
    script = page.split("## Stamps in DuckDB")[1].split("```sql\n")[1].split("```")[0]
    queries = [query for query in script.split(";") if query.strip()]
    monkeypatch.chdir(folder)
    minutes, buckets, seconds, after = (duckdb.sql(query).pl() for query in queries)
    frame = pd.read_parquet("room.objects.parquet")
    near, objects = int((frame.r_min < 2).sum()), len(frame)
    assert minutes["objects"].to_list() == ([near] if near else [])
    assert buckets["objects"].to_list() == ([objects] if objects else [])
    assert minutes["minute"].dt.epoch("s").to_list() == ([START_NS // 10**9 // 60 * 60] if near else [])
    assert buckets["start"].dt.epoch("s").to_list() == ([START_NS // 10**9] if objects else [])
    assert seconds["seconds"].to_list() == [0.0, 0.1, 0.2]
    assert after["sweeps"].to_list() == [2]


def test_what_duckdb_does_with_stamps(folder: Path) -> None:
    """As docs/tables.md has it of the version that is installed, which is the newest."""
    of = f"from '{folder / 'room.sweeps.parquet'}'"
    assert duckdb.sql(f"select distinct typeof(stamp) {of}").fetchall() == [("TIMESTAMPTZ_NS",)]
    for taken in ("date_trunc('minute', stamp)", "time_bucket(interval 10 seconds, stamp)", "extract(minute from stamp)"):
        assert len(duckdb.sql(f"select {taken} {of}").fetchall()) == 3
    with pytest.raises(duckdb.BinderException, match="No function matches"):
        duckdb.sql(f"select max(stamp) - min(stamp) {of}")
    spans = duckdb.sql(f"select max(stamp::timestamptz) - min(stamp::timestamptz) {of}").fetchall()
    assert spans == [(timedelta(milliseconds=200),)]
