"""One log into tables: rows, metadata, damage, topics, windows of time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from lidarcli.errors import NoScanError, OutputError, UnreadableError
from lidarcli.logs.base import ReadReport, Topic
from lidarcli.logs.batches import ReadOptions
from lidarcli.pipeline import detecting
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.one_log import damage_lines
from lidarcli.simulation.writers import write_log
from tests.pipeline.in_memory import CLOUD, SCAN, SOURCE, Opens, block


def asking(*topics: str) -> DetectOptions:
    return DetectOptions(read=ReadOptions(topics=frozenset(topics) if topics else None))


def test_messages_that_are_refused_count_as_damage(tmp_path: Path, opened: Opens) -> None:
    log = opened(block(), topics=[SCAN])
    log.met.refused["/scan", "NaN geometry"] = 2000
    log.met.refused["/rear", "NaN geometry"] = 1
    summary = detect_to_files(SOURCE, tmp_path, DetectOptions())
    assert (summary.sweeps, summary.exit_code) == (4, 3)
    assert summary.damage == [
        "topic /rear: 1 message left out: NaN geometry",
        "topic /scan: 2,000 messages left out: NaN geometry",
    ]
    metadata = pq.read_schema(tmp_path / "run.sweeps.parquet").metadata
    assert json.loads(metadata[b"lidarcli.damage"]) == summary.damage


def test_damage_lines_are_few_whatever_the_log_does() -> None:
    report = ReadReport()
    for index in range(100):
        report.refused[f"/topic{index:03}", "NaN geometry"] = 2
        report.add_damage(f"byte {index}", "broken")
    lines = damage_lines(report)
    assert len(lines) == 42
    assert lines[19:22] == [
        "byte 19: broken",
        "and 80 more damaged parts",
        "topic /topic000: 2 messages left out: NaN geometry",
    ]
    assert lines[41] == "and 160 more messages left out"


def test_topic_without_messages_gives_empty_tables(tmp_path: Path, opened: Opens) -> None:
    opened(topics=[replace(SCAN, messages=0)])
    summary = detect_to_files(SOURCE, tmp_path, DetectOptions())
    assert (summary.sweeps, summary.exit_code) == (0, 0)
    assert pq.read_table(tmp_path / "run.objects.parquet").num_rows == 0


SLICE = "; to read the point clouds of /cloud as sweeps, add --slice ZMIN ZMAX (heights in metres)"


@pytest.mark.parametrize(
    ("topics", "asked", "message"),
    [
        ([CLOUD], (), f"no LaserScan topic in this log (its topics: /cloud sensor_msgs/msg/PointCloud2){SLICE}"),
        ([], (), "no LaserScan topic in this log (it has no topics)"),
        (None, (), "no LaserScan in it"),
        ([SCAN], ("/front",), "no LaserScan topic /front in this log (its LaserScan topics: /scan)"),
        ([SCAN, CLOUD], ("/cloud",), f"topic /cloud is sensor_msgs/msg/PointCloud2, not a LaserScan{SLICE}"),
    ],
)
@pytest.mark.parametrize("damage", [None, "cut off"])
def test_no_scan(
    tmp_path: Path, opened: Opens, topics: list[Topic] | None, asked: tuple[str, ...], message: str, damage: str | None
) -> None:
    opened(topics=topics, damage=damage)
    with pytest.raises(UnreadableError if damage else NoScanError) as caught:
        detect_to_files(SOURCE, tmp_path, asking(*asked))
    if damage:
        named = f" topic {asked[0]}" if asked else ""
        message = f"no LaserScan{named} in the part that could be read; byte 99: cut off"
    assert str(caught.value).removeprefix("run.fake: ") == message
    assert list(tmp_path.iterdir()) == []


def test_existing_output_is_refused_before_the_log_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, opened: Opens
) -> None:
    (tmp_path / "run.sweeps.parquet").write_text("mine")
    monkeypatch.setattr(detecting, "open_source", lambda source, csv: pytest.fail("opened"))
    with pytest.raises(OutputError, match=r"run\.sweeps\.parquet exists"):
        detect_to_files(SOURCE, tmp_path, DetectOptions())
    opened(block(), topics=[SCAN])
    detect_to_files(SOURCE, tmp_path, DetectOptions(overwrite=True))
    assert pq.read_table(tmp_path / "run.sweeps.parquet").num_rows == 4


@pytest.mark.parametrize(
    ("start", "end", "window"),
    [(100.0, None, "from 100 s on"), (7.0, 9.0, "from 7 s on and before 9 s"), (None, 0.0, "before 0 s")],
)
def test_a_window_beyond_the_log_is_told(tmp_path: Path, start: float | None, end: float | None, window: str) -> None:
    path = tmp_path / "run.mcap"
    write_log(path, [block("/scan")])
    options = DetectOptions(read=ReadOptions(start=start, end=end))
    summary = detect_to_files(Source(str(path), "run"), tmp_path, options)
    assert (summary.sweeps, summary.exit_code) == (0, 0)
    assert summary.notes == [
        f"no sweep of /scan {window}: its sweeps lie between 0.0 and 0.3 s, counted from the first one"
    ]
