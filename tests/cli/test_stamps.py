"""`--stamps us`: stamps cut off to microseconds in every table, which our own commands read all the same."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.ipc
import pyarrow.parquet as pq
import pytest

import lidarcli as package
from lidarcli.simulation.writers import write_log
from lidarcli.tabular.columns import restamped
from tests.sweeping import START, STEP, raw_sweeps, round_room

Run = Callable[..., Any]

US = pa.timestamp("us", "UTC")
ZONE = '[[zone]]\nname = "near"\nframe = "sensor"\ncircle = {x = 0.0, y = 0.0, radius = 2.5}\n'
FOLLOWED = ("objects", "sweeps", "tracks", "trajectories", "beams")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`run.mcap`, in which a box goes round for 40 sweeps, with stamps between the microseconds; `zones.toml`."""
    folder = tmp_path_factory.mktemp("stamps")
    ranges = round_room(40)
    for sweep in range(40):
        ranges[sweep, 40 + 3 * sweep : 60 + 3 * sweep] = 2.0
    write_log(folder / "run.mcap", [raw_sweeps(ranges, stamp_ns=START + 789 + STEP * np.arange(40))])
    (folder / "zones.toml").write_text(ZONE)
    return folder


@pytest.fixture(scope="module")
def tables(scene: Path) -> Path:
    """A folder with `ns` and `us`: the tables of `track`, each with its stamps."""
    from lidarcli.cli import run

    for unit in ("ns", "us"):
        words = ["-q", "track", str(scene / "run.mcap"), "--beams", "-o", str(scene / unit), "--stamps", unit]
        assert run(words) == 0
    return scene


def kinds(schema: pa.Schema) -> set[str]:
    return {str(field.type) for field in schema if pa.types.is_timestamp(field.type)}


def test_only_the_stamps_differ(tables: Path) -> None:
    for name in FOLLOWED:
        ns, us = (pq.read_table(tables / unit / f"run.{name}.parquet") for unit in ("ns", "us"))
        assert us.cast(restamped(ns, "us").schema).equals(restamped(ns, "us"))
        assert kinds(ns.schema) == ({"timestamp[ns, tz=UTC]"} if name != "beams" else set())
        assert kinds(us.schema) == ({str(US)} if name != "beams" else set())
        for fine, coarse in zip(ns.schema, us.schema, strict=True):
            assert coarse.metadata == fine.metadata | ({b"unit": b"us"} if fine.type != coarse.type else {})
    stamps = us.schema.metadata, pq.read_table(tables / "us" / "run.sweeps.parquet")["stamp"]
    assert json.loads(stamps[0][b"lidarcli.parameters"])["stamps"] == "us"
    assert stamps[1].cast(pa.int64()).to_pylist()[1] == (START + STEP) // 1000
    # Readers that know nothing of Arrow's schema see it as well.
    column = pq.ParquetFile(tables / "us" / "run.sweeps.parquet").schema.column(4)
    assert "timeUnit=microseconds" in str(column.logical_type)


@pytest.mark.parametrize(
    ("words", "files"),
    [
        (("detect", "-o", "out"), ("out/run.objects.parquet", "out/run.sweeps.parquet")),
        (("detect", "-o", "out", "--partition", "table"), ("out/objects/run.parquet",)),
        (("detect", "-o", "one.parquet"), ("one.parquet",)),
        (("background", "subtract", "--background", "b.parquet", "-o", "out"), ("out/run.sweeps.parquet",)),
        (("zones", "--zones", "zones.toml", "-o", "out"), ("out/run.events.parquet", "out/run.zones.parquet")),
        (("clean", "--pose", "none", "-o", "c.mcap"), ("c.cleaned.parquet",)),
        (("poses", "--pose", "match", "-o", "poses.parquet"), ("poses.parquet",)),
        (("map", "--pose", "match", "-o", "cloud.parquet"), ("cloud.parquet",)),
    ],
)
def test_every_command_that_writes_tables_has_it(
    scene: Path,
    tmp_path: Path,
    lidarcli: Run,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    files: tuple[str, ...],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("zones.toml").write_text(ZONE)
    package.background(scene / "run.mcap", "b.parquet")
    ran = lidarcli("-q", *words, "--stamps", "us", scene / "run.mcap")
    assert (ran.code, ran.err) == (0, "")
    for file in files:
        assert kinds(pq.read_schema(file)) == {str(US)}


def test_our_commands_read_them(tables: Path, tmp_path: Path, lidarcli: Run) -> None:
    """What they make of tables in microseconds is what they make of those in nanoseconds."""
    log = tables / "run.mcap"

    def read_by(*words: Any) -> list[str]:
        found = []
        for unit in ("ns", "us"):
            ran = lidarcli(*(tables / unit / each[1:] if str(each)[0] == "@" else each for each in words))
            assert ran.code == 0, ran.err
            found.append(re.sub(r"\b(ns|us)/", "", ran.out + ran.err))
        return found

    one, other = (
        re.sub(r'\s+"stamps": "us",', "", each) for each in read_by("report", "@run.objects.parquet", "--format", "json")
    )
    assert '"objects":' in one
    assert other == re.sub(r"00789(?=Z|,)", "00000", one)
    ns, us = tables / "ns" / "run.objects.parquet", tables / "us" / "run.objects.parquet"
    assert lidarcli("report", us, "--baseline", ns, "--check", "delta.objects == 0").code == 0
    zones = ("zones", log, "--zones", tables / "zones.toml", "--overwrite", "-o", tmp_path)
    written = []
    for file in (ns, us):
        assert lidarcli(*zones, "--objects", file).code == 0
        written.append([pq.read_table(tmp_path / f"run.{name}.parquet") for name in ("events", "zones")])
    assert written[0] == written[1]
    drawn = []
    for file in (ns, us):
        assert lidarcli("overlay", log, "--objects", file, "-o", tmp_path / "o.mcap", "--overwrite").code == 0
        drawn.append((tmp_path / "o.mcap").read_bytes())
    assert drawn[0] == drawn[1]
    assert len({*read_by("diff", "@run.tracks.parquet", "@run.tracks.parquet", "--align", "as-is")}) == 1


def test_a_run_with_other_stamps_is_done_again(scene: Path, tmp_path: Path, lidarcli: Run) -> None:
    words = ("detect", scene / "run.mcap", "-o", tmp_path, "--resume")
    assert "done before" not in lidarcli(*words).err
    assert "done before" not in lidarcli(*words, "--stamps", "us").err
    assert "done before" in lidarcli(*words, "--stamps", "us").err
