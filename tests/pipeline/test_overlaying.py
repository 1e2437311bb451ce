"""Rows of tables beside the sweeps of a log, and the order of messages."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import ReadReport
from lidarcli.pipeline.detecting import detect_to_files
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inputs.tables import TableSet
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.overlay import copies
from lidarcli.pipeline.overlay.copies import frames_in_transforms, in_order
from lidarcli.pipeline.overlay.tables import OverlayTables
from lidarcli.ros.messages import Outgoing
from tests.places import SAMPLES


def message(record_ns: int, topic: str = "/a") -> Outgoing:
    return Outgoing(topic, "type", record_ns, record_ns, b"")


def test_messages_of_several_topics_come_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(copies, "WINDOW", 20)
    # Stretches of ten of each of two topics, as a log gives them.
    given = [
        message(2 * k + (topic == "/b"), topic)
        for start in range(0, 100, 10)
        for topic in ("/a", "/b")
        for k in range(start, start + 10)
    ]
    assert [one.record_ns for one in in_order(given)] == list(range(200))


def test_what_is_beyond_the_window_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(copies, "WINDOW", 3)
    times = list(range(50))
    random.Random(1).shuffle(times)
    assert sorted(one.record_ns for one in in_order(map(message, times))) == list(range(50))
    same = [message(7, f"/{k}") for k in range(10)]
    assert list(in_order(same)) == same


@pytest.fixture
def two(logs: Path, tmp_path: Path) -> TableSet:
    """The tables of a log with two topics."""
    detect_to_files(Source(str(logs / "two.mcap"), "two"), tmp_path, DetectOptions())
    return TableSet(f"{tmp_path}/two.", ".parquet")


def test_every_row_is_beside_its_sweep(two: TableSet, logs: Path) -> None:
    counts: dict[str, int] = {}
    rows: list[tuple[str, int]] = []
    tables = OverlayTables(two)
    assert tables.topics == ("/front", "/rear")
    with open_log(logs / "two.mcap") as log:
        for joined in tables.join(log, ReadReport()):
            topic = joined.raw.topic
            first = counts.get(topic, 0)
            counts[topic] = first + len(joined.raw)
            rows += [(topic, first + row) for row in joined.row.tolist()]
            assert (np.diff(joined.row) >= 0).all()
    expected = pq.read_table(two.objects, columns=["topic", "sweep"]).to_pylist()
    assert sorted(rows) == [(row["topic"], row["sweep"]) for row in expected]
    assert tables.left() == 0
    assert sum(counts.values()) == pq.read_metadata(two.sweeps).num_rows


def joined(pair: TableSet, log: Path) -> int:
    with open_log(log) as opened:
        return sum(len(each.row) for each in OverlayTables(pair).join(opened, ReadReport()))


def test_rows_in_disorder_are_refused(two: TableSet, logs: Path) -> None:
    table = pq.read_table(two.objects)
    pq.write_table(table.take(pa.array(range(table.num_rows - 1, -1, -1))), two.objects)
    with pytest.raises(UnreadableError, match="not in the order of topic and sweep"):
        joined(two, logs / "two.mcap")


@pytest.mark.parametrize(("column", "step"), [("stamp", 1000), ("stamp", -1000), ("sweep", 1)])
def test_sweeps_of_another_log_are_refused(two: TableSet, logs: Path, column: str, step: int) -> None:
    table = pq.read_table(two.sweeps)
    at = table.schema.get_field_index(column)
    kind = table.schema.field(at)
    other = (table[column].cast(pa.int64()).to_numpy() + step).astype(np.int64)
    pq.write_table(table.set_column(at, kind, pa.array(other).cast(kind.type)), two.sweeps)
    with pytest.raises(UnreadableError, match="not the tables of this log"):
        joined(two, logs / "two.mcap")


def test_objects_of_sweeps_that_the_sweeps_table_has_not_are_refused(two: TableSet, logs: Path) -> None:
    table = pq.read_table(two.sweeps)
    pq.write_table(table.filter(pa.compute.not_equal(table["sweep"], 5)), two.sweeps)
    with pytest.raises(UnreadableError, match="not the tables of this log"):
        joined(two, logs / "two.mcap")


def test_frames_that_transforms_speak_of_are_found() -> None:
    with open_log(SAMPLES / "drive.db3") as log:
        assert frames_in_transforms(log, {"laser", "base_link", "las", "aser", "/laser", "camera"}) == {
            "laser",
            "/laser",
            "base_link",
        }
