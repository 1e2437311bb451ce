"""People by line, direction and interval of time: the table, the text, the JSON and the report."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

import lidarcli as package
from lidarcli.errors import OptionError
from lidarcli.simulation.generate import START_NS
from tests.cli.maps import Run
from tests.zones.runs import rows, scans, scene_of, sound, sweeps_of, walker, write_bag, zone_file

DOOR = """
[[zone]]
name = "door"
line = [[2.0, 0.0], [5.0, 0.0]]

[[zone]]
name = "near"
circle = { x = 0.0, y = 0.0, radius = 1.0 }
"""
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people go through a door after 2 s and 3 s, and one of them back after 7 s; 0.8 s without sweeps from 9 s on."""
    folder = tmp_path_factory.mktemp("door")
    one, other = walker((3.0, -2.0), (3.0, 4.0), speed=1.0), walker((4.0, -3.0), (4.0, 1.5), (4.0, -3.0), speed=1.0)
    scene = scene_of(one, other, sweeps=120)
    messages = scans(sweeps_of(scene))
    kept = [each for each in messages if not 9.0 < (each.record_ns - START_NS) / SECOND < 9.8]
    zone_file(folder, DOOR)
    return write_bag(folder / "a.bag", kept)


def test_counts_are_those_of_the_crossings(log: Path) -> None:
    tables = sound(package.zones(log, zones=str(log.parent / "zones.toml"), every="5s"))
    crossings = rows(tables.events, kind="crossing")
    assert [event["direction"] for event in crossings] == ["in", "in", "out"]
    # 22:13:20 is a multiple of five seconds.
    found = tables.counts.to_pylist()
    starts = [(row["start"].value - START_NS) / SECOND for row in found]
    assert starts == [0, 0, 5, 5, 10, 10]
    assert [row["zone"] for row in found] == ["door"] * 6
    ends = [*dict.fromkeys((row["end"].value - START_NS) / SECOND for row in found)]
    assert ends == pytest.approx([5.0, 10.0, 11.9])
    for row in found:
        inside = [event for event in crossings if row["start"] <= event["start"] < row["end"]]
        assert row["count"] == sum(event["direction"] == row["direction"] for event in inside)
        assert row["low"] <= row["count"] <= row["high"]
    assert [row["count"] for row in found] == [2, 0, 0, 1, 0, 0]
    assert [row["observed"] for row in found[::2]] == pytest.approx([1.0, 1.0 - 0.8 / 5.0, 1.0], abs=0.02)
    assert found[3]["high"] > found[3]["count"], "not observed all the time"
    assert found[0]["agents"] == pytest.approx(2.0, abs=0.2)


def test_a_whole_number_is_still_every_nth_sweep(log: Path, lidarcli: Run) -> None:
    zones = str(log.parent / "zones.toml")
    assert [package.zones(log, zones=zones, every=each)._fields for each in (1, 2)] == [("events", "zones")] * 2
    alone, halved = (len(package.zones(log, zones=zones, every=each).zones) for each in (1, "2"))
    assert halved == (alone + 2) // 2
    for wrong in ("2.5", "x", "0.5s", "-1min", "2026-11-22"):
        ran = lidarcli("zones", log, "--zones", zones, "--every", wrong)
        assert ran.code == 2, wrong
        assert "30s, 15min, 1h" in ran.err or "is no time" in ran.err
    with pytest.raises(OptionError, match="no whole number"):
        package.zones(log, zones=zones, every=2.5)  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="no zone is a line"):
        package.zones(log, zones=str(zone_file(log.parent, DOOR.partition("\n\n")[2], "near.toml")), every="1min")


def test_text_json_and_report(log: Path, tmp_path: Path, lidarcli: Run) -> None:
    words = ("zones", log, "--zones", log.parent / "zones.toml", "--every", "5s")
    ran = lidarcli(*words, "-o", tmp_path)
    assert ran.code == 0
    told = [line.split() for line in ran.err.splitlines() if " door  " in line and "%" in line]
    assert [line[0] for line in told] == ["door"] * 4
    assert [line[1] for line in told] == ["22:13:20", "22:13:25", "22:13:30", "all"]
    assert [(line[2], line[4]) for line in told] == [("2", "0"), ("0", "1"), ("0", "0"), ("2", "1")]
    assert "wrote" in ran.err
    table = pq.read_table(tmp_path / "a.counts.parquet")
    (found,) = json.loads(lidarcli(*words, "--format", "json").out)["logs"]
    assert [(row["direction"], row["count"]) for row in found["counts"]] == [("in", 2), ("out", 1)]
    # What the report has is what the text has.
    text = lidarcli("report", tmp_path / "a.events.parquet").out
    shown = [line.split() for line in text.splitlines() if line.startswith("door  ")][-4:]
    assert [line[1:6] for line in shown] == [line[1:6] for line in told]
    assert "██" in text
    page = lidarcli("report", tmp_path / "a.events.parquet", "--format", "html").out
    assert "People through lines" in page
    in_memory = package.report(package.zones(log, zones=str(log.parent / "zones.toml"), every="5s"))
    assert "People through lines" in str(in_memory)
    assert table.num_rows == 6


def test_a_clock_without_dates_begins_with_the_first_sweep(log: Path, tmp_path: Path) -> None:
    scene = scene_of(walker((3.0, -2.0), (3.0, 4.0)), sweeps=60)
    early = [replace(block, stamp_ns=block.stamp_ns - START_NS) for block in sweeps_of(scene)]
    bag = write_bag(tmp_path / "a.bag", scans(early))
    counts = package.zones(bag, zones=str(log.parent / "zones.toml"), every="4s").counts.to_pylist()
    assert [row["start"].value / SECOND for row in counts] == [0.0, 0.0, 4.0, 4.0]
    assert [row["count"] for row in counts] == [1, 0, 0, 0]


@pytest.mark.parametrize(("same", "counted"), [(True, [2, 1]), (False, [3, 2])])
def test_tracks_of_one_person_cross_once(log: Path, tmp_path: Path, lidarcli: Run, same: bool, counted: list[int]) -> None:
    """A second track on the path of the one who comes back counts only where it is another person."""
    assert lidarcli("track", log, "-o", tmp_path).code == 0
    for kind in ("tracks", "trajectories"):
        path = tmp_path / f"a.{kind}.parquet"
        table = pq.read_table(path)
        more = table.filter(pc.equal(table["track"], 2))
        columns = {"track": 900, **({} if same or kind == "trajectories" else {"person": 900})}
        for name, value in columns.items():
            at = more.schema.get_field_index(name)
            more = more.set_column(at, more.schema.field(at), pa.array([value] * len(more), pa.int64()))
        pq.write_table(pa.concat_tables([table, more]).unify_dictionaries(), path)
    objects = str(tmp_path / "a.objects.parquet")
    tables = package.zones(log, zones=str(log.parent / "zones.toml"), every="1h", objects=objects)
    counts = dict.fromkeys(("in", "out"), 0)
    for row in tables.counts.to_pylist():
        counts[row["direction"]] += row["count"]
    assert [*counts.values()] == counted
    assert len(rows(tables.events, kind="crossing")) == sum(counted)
