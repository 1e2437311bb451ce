"""A log of segments and the same turns as one message each: what the commands find is the same."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer

import lidarcli
from lidarcli.cli import run
from lidarcli.ros.messages import SCAN, cdr_scans, ros2_definition
from lidarcli.sweeps.types import RawSweeps
from tests.logs.test_segments import DEGREE, TURN_NS, cut
from tests.sweeping import START, raw_sweeps

NOTE = "/scan: segments of 30 deg are joined to turns of 270 deg; --segments keep leaves them"
ZONE = '[[zone]]\nname = "near"\ncircle = { x = 0, y = 0, radius = 2.5 }\nmin_points = 12\ntrigger = 3\nhold = 0.1\n'


def room(count: int = 30) -> RawSweeps:
    """Turns of a round room in which somebody passes the border of two segments."""
    ranges = np.random.default_rng(3).normal(4.0, 0.005, (count, 270)).astype(np.float32)
    for row in range(count):
        ranges[row, 165 + row : 181 + row] = 2.0
    return replace(
        raw_sweeps(
            ranges, angle_min=-135 * DEGREE, angle_increment=np.float32(DEGREE), stamp_ns=START + TURN_NS * np.arange(count)
        ),
        time_increment=np.full(count, TURN_NS / 360e9, np.float32),
    )


def written(path: Path, raw: RawSweeps) -> Path:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        channel = writer.register_channel(
            "/scan", "cdr", writer.register_schema(SCAN, "ros2msg", ros2_definition(SCAN).encode())
        )
        for stamp, data in zip(raw.stamp_ns.tolist(), cdr_scans(raw), strict=True):
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    return path


@pytest.fixture
def logs(tmp_path: Path) -> tuple[Path, Path]:
    return written(tmp_path / "full.mcap", room()), written(tmp_path / "segments.mcap", cut(room(), 30))


def test_turns_of_segments_are_the_sweeps_of_the_full_log(
    logs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    full, segments = logs
    (tmp_path / "zones.toml").write_text(ZONE)
    zones = ["--zones", str(tmp_path / "zones.toml"), "--check", "zones.near.events == 1"]
    assert run(["zones", str(full), *zones]) == run(["-v", "zones", str(segments), *zones]) == 0
    assert run(["zones", str(segments), *zones, "--segments", "keep"]) == 1
    assert capsys.readouterr().err.count(NOTE) == 1
    assert run(["detect", str(full), str(segments), "-o", str(tmp_path)]) == 0
    one, other = (
        pq.read_table(tmp_path / f"{name}.objects.parquet").drop_columns(["log"]) for name in ("full", "segments")
    )
    assert one.num_rows == 30
    columns = ["sweep", "stamp", "x", "y"]
    assert one.select(columns) == other.select(columns)
    source = json.loads(other.schema.metadata[b"lidarcli.source"])
    assert source["segments"] == ["/scan"]


def test_clean_names_the_way_out(logs: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "clean.mcap"
    assert run(["clean", str(logs[1]), "-o", str(out)]) == 2
    assert (
        f"lidarcli: {logs[1]}: messages of /scan are segments of a turn, which clean cannot write back; --segments keep "
        "cleans each alone\n"
    ) == capsys.readouterr().err
    assert not out.exists()
    assert run(["clean", str(logs[1]), "-o", str(out), "--segments", "keep"]) == 0
    assert sum(map(len, lidarcli.read(out, segments="keep"))) == 270


@pytest.mark.parametrize("parts", [4, 9, 12])
def test_a_turn_in_any_number_of_segments_is_the_same_turn(parts: int, tmp_path: Path) -> None:
    """Objects, zones, map and background of the same scans in one message and in several."""
    turns = room(40)
    files = written(tmp_path / "one.mcap", turns), written(tmp_path / "cut.mcap", cut(turns, -(-270 // parts)))
    (tmp_path / "zones.toml").write_text(ZONE)
    found = []
    for log in files:
        tables = lidarcli.track(log)
        zones = lidarcli.zones(log, zones=str(tmp_path / "zones.toml"))
        grid = lidarcli.map(log)
        assert run(["background", "build", str(log), "-o", str(log.with_suffix(".parquet"))]) == 0
        model = pq.read_table(log.with_suffix(".parquet"))
        found.append((tables, zones, grid, model))
    (tables, zones, grid, model), (others, other_zones, other_grid, other_model) = found
    every = [*zip(tables, others, strict=True), *zip(zones, other_zones, strict=True), (model, other_model)]
    for table, other in every:
        assert table.num_rows == other.num_rows
        for name in table.column_names:
            ours, its = (each[name].to_pylist() for each in (table, other))
            if name != "log" and ours and isinstance(next((value for value in ours if value is not None), None), float):
                nan = float("nan")
                one, two = ([nan if value is None else value for value in values] for values in (ours, its))
                np.testing.assert_allclose(two, one, rtol=1e-5, atol=1e-5, err_msg=name)
            elif name not in ("log", "vertices", "faces"):
                assert its == ours, name
    assert zones.events.num_rows > 0
    np.testing.assert_array_equal(grid.cells, other_grid.cells)
