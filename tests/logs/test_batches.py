"""Numbering, filtering and batching of sweeps, on a log made of blocks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarcli.errors import NoScanError
from lidarcli.logs import batches
from lidarcli.logs.base import LASERSCAN, ReadReport, Topic
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.options.times import parse_zone
from lidarcli.sweeps.types import RawSweeps, Status, SweepBatch
from tests.fake_log import FakeLog
from tests.sweeping import raw_sweeps

SECOND = 10**9


def block(
    counts: list[int],
    *,
    topic: str = "/scan",
    first: int = 0,
    stamps: list[int] | None = None,
    frames: list[int] | None = None,
) -> RawSweeps:
    """Sweeps whose ranges say which sweep and beam they are; `counts` beams each, 10 Hz."""
    rows = len(counts)
    ranges = np.full((rows, max(counts, default=0)), np.nan, np.float32)
    for row, count in enumerate(counts):
        ranges[row, :count] = first + row + 1 + np.arange(count) / 1024
    numbers = np.arange(first, first + rows)
    return raw_sweeps(
        ranges,
        topic=topic,
        frame_ids=("left", "right"),
        frame=frames or 0,
        stamp_ns=SECOND * 100 + numbers * SECOND // 10 if stamps is None else stamps,
        record_ns=numbers * SECOND,
        angle_min=numbers / 10.0,
        angle_increment=0.01,
        range_min=0.0,
        range_max=np.inf,
        beams=counts,
    )


def run(blocks: list[RawSweeps], **options: Any) -> list[SweepBatch]:
    return list(read_batches(FakeLog(blocks), ReadOptions(**options), ReadReport()))


def sweeps(found: list[SweepBatch]) -> list[int]:
    return [int(sweep) for batch in found for sweep in batch.sweep]


@given(
    st.lists(st.lists(st.integers(0, 9), min_size=1, max_size=12), min_size=1, max_size=8),
    st.integers(1, 9),
    st.integers(1, 4),
)
def test_any_blocks_give_the_same_sweeps_in_full_batches(parts: list[list[int]], size: int, every: int) -> None:
    blocks, first = [], 0
    for counts in parts:
        blocks.append(block(counts, first=first))
        first += len(counts)
    found = run(blocks, batch_size=size, every=every)
    wanted = list(range(0, first, every))
    assert sweeps(found) == wanted
    assert [len(batch) for batch in found] == [size] * (len(wanted) // size) + (
        [len(wanted) % size] if len(wanted) % size else []
    )
    counts = [count for part in parts for count in part]
    for batch in found:
        assert batch.width == max(counts[sweep] for sweep in batch.sweep)
        for row, sweep in enumerate(batch.sweep.tolist()):
            seen = batch.ranges[row, : counts[sweep]]
            np.testing.assert_array_equal(seen, np.float32(sweep + 1 + np.arange(counts[sweep]) / 1024))
            assert (batch.status[row, counts[sweep] :] == Status.PADDING).all()
            assert batch.angle_min[row] == sweep / 10
            assert batch.record_ns[row] == sweep * SECOND


def test_topics_are_numbered_and_batched_apart() -> None:
    blocks = [
        block([3] * 5, topic="/a"),
        block([2] * 3, topic="/b"),
        block([3] * 4, topic="/a", first=5),
        block([2] * 3, topic="/b", first=3),
    ]
    found = run(blocks, batch_size=4)
    assert [(batch.topic, batch.sweep.tolist()) for batch in found] == [
        ("/a", [0, 1, 2, 3]),
        ("/a", [4, 5, 6, 7]),
        ("/b", [0, 1, 2, 3]),
        ("/a", [8]),
        ("/b", [4, 5]),
    ]


def test_seconds_count_from_the_first_sweep_of_each_topic_also_of_one_that_is_left_out() -> None:
    stamps = [0, 250, 60, 150, 300]
    blocks = [
        block([3] * 2, stamps=[SECOND * 7, SECOND * 9]),
        block([3], topic="/b", stamps=[SECOND * 20]),
        block([3] * 5, first=2, stamps=[SECOND * 8 + stamp for stamp in stamps]),
    ]
    found = {(batch.topic, int(batch.sweep[0])): batch.seconds.tolist() for batch in run(blocks, batch_size=2)}
    assert found == {
        ("/scan", 0): [0.0, 2.0],
        ("/scan", 2): [1.0, 1.00000025],
        ("/scan", 4): [1.00000006, 1.00000015],
        ("/scan", 6): [1.0000003],
        ("/b", 0): [0.0],
    }
    chosen = [batch.seconds.tolist() for batch in run(blocks, start=0.9, every=2)]
    assert chosen == [[1.0, 1.00000006, 1.0000003]]


def test_start_and_end_count_from_the_first_sweep() -> None:
    blocks = [block([3] * 30), block([3] * 30, first=30)]
    assert sweeps(run(blocks, start=1.0, end=2.0)) == list(range(10, 20))
    assert sweeps(run(blocks, start=5.5)) == list(range(55, 60))
    assert sweeps(run(blocks, end=0.0)) == []
    assert sweeps(run(blocks, start=1.0, end=2.0, every=4)) == [12, 16]


def test_each_frame_has_its_own_first_sweep() -> None:
    stamps = [0, 10**18, SECOND, 10**18 + SECOND, 2 * SECOND, 10**18 + 2 * SECOND]
    both = block([1] * 6, stamps=[stamp + 1 for stamp in stamps], frames=[0, 1] * 3)
    assert sweeps(run([both], start=1.0, end=2.0)) == [2, 3]


def test_very_wide_sweeps_use_smaller_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "BATCH_VALUES", 1000)
    blocks = [block([10] * 50), block([10, 400, 10, 400, 10, 400], first=50), block([10] * 44, first=56)]
    found = run(blocks, batch_size=32)
    assert sweeps(found) == list(range(100))
    assert max(batch.ranges.size for batch in found) <= 1000
    assert max(map(len, found)) == 32


def test_a_sweep_wider_than_a_batch_stands_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "BATCH_VALUES", 1000)
    found = run([block([5, 2000, 5])], batch_size=32)
    assert [batch.sweep.tolist() for batch in found] == [[0], [1], [2]]


SCANS = [Topic("/scan", LASERSCAN, "cdr"), Topic("/rear", LASERSCAN, "cdr"), Topic("/tf", "tf2_msgs/msg/TFMessage", "cdr")]


def blocks_of(*topics: str) -> list[RawSweeps]:
    return [block([3], topic=topic) for topic in topics]


def test_a_leading_slash_counts_where_both_names_are_there() -> None:
    topics = [Topic("/scan", LASERSCAN, "cdr"), Topic("scan", LASERSCAN, "cdr")]
    for name in ("/scan", "scan"):
        log = FakeLog(blocks_of("/scan", "scan"), topics)
        assert [batch.topic for batch in read_batches(log, ReadOptions(topics=(name,)), ReadReport())] == [name]


@pytest.mark.parametrize("wanted", ["/front", "/tf"])
def test_an_absent_topic_is_named_with_those_that_are_there(wanted: str) -> None:
    for topics in (SCANS, None):
        log = FakeLog(blocks_of("/scan", "/rear"), topics)
        with pytest.raises(NoScanError) as caught:
            list(read_batches(log, ReadOptions(topics=(wanted,)), ReadReport()))
        words = f"no LaserScan topic {wanted} in this log (its LaserScan topics: /rear, /scan)"
        if topics and wanted == "/tf":
            words = "topic /tf is tf2_msgs/msg/TFMessage, not a LaserScan"
        assert str(caught.value) == words
        assert log.asked == ("nothing" if topics else None)


def test_a_topic_without_a_message_is_no_error() -> None:
    assert list(read_batches(FakeLog([], SCANS), ReadOptions(), ReadReport())) == []


def test_a_damaged_or_refused_log_is_not_called_one_without_scans() -> None:
    log = FakeLog([])
    log.met.add_damage("byte 9", "cut off")
    assert list(read_batches(log, ReadOptions(), ReadReport())) == []
    log = FakeLog([])
    log.met.refused[("/scan", "angle_min is not finite")] += 1
    assert list(read_batches(log, ReadOptions(), ReadReport())) == []


def test_a_window_by_date_and_time() -> None:
    log = [block([3] * 20)]
    # The stamps begin 100 s after 1970, 10 Hz.
    assert sweeps(run(log, start="1970-01-01T00:01:40.5Z", end="1970-01-01T00:01:40.8Z")) == [5, 6, 7]
    assert sweeps(run(log, start="500ms", end="1970-01-01T00:01:40.8Z")) == [5, 6, 7]
    assert sweeps(run(log, start="1970-01-01T01:01:41.8+01:00")) == [18, 19]


def test_a_window_by_date_that_holds_nothing_is_told() -> None:
    report = ReadReport()
    options = ReadOptions(start="2026-01-01")
    assert list(read_batches(FakeLog([block([3] * 20)]), options, report)) == []
    assert report.notes == [
        "no sweep of /scan from 2026-01-01T00:00:00Z on: its sweeps lie between 1970-01-01T00:01:40.000Z and "
        "1970-01-01T00:01:41.900Z"
    ]


DAY = 1_700_000_000_000_000_000 - 100_000_000_000
"""Moves stamps so that they begin at 22:13:20 UTC."""


def dated(topic: str = "/scan", later: int = 0) -> RawSweeps:
    sweeps = block([3] * 20, topic=topic)
    return replace(sweeps, stamp_ns=sweeps.stamp_ns + DAY + later)


def test_a_window_by_time_of_day() -> None:
    assert sweeps(run([dated()], start="22:13:20.5", end="22:13:20.8")) == [5, 6, 7]
    assert sweeps(run([dated()], start="23:13:21.8", time_zone=parse_zone("Europe/Berlin"))) == [18, 19]
    # One moment for all topics, also where one begins later than that.
    front, rear = dated("/front"), dated("/rear", 1_000_000_000)
    assert [len(batch) for batch in run([front, rear], start="22:13:20.5")] == [15, 20]


@pytest.mark.parametrize(
    ("window", "note"),
    [
        ({"start": "22:20"}, "no sweep of /scan from 22:20:00 UTC on: its sweeps lie between {}"),
        ({"start": "22:10"}, "no sweep of /scan from 22:10:00 UTC on: its sweeps lie between {}"),
        ({"end": "22:10"}, "/scan has no sweep at 22:10:00 UTC or later: its sweeps lie between {}"),
    ],
)
def test_a_time_of_day_that_a_log_lacks_is_told(window: dict[str, str], note: str) -> None:
    report = ReadReport()
    list(read_batches(FakeLog([dated()]), ReadOptions(**window), report))  # type: ignore[arg-type]
    assert report.notes == [note.format("2023-11-14T22:13:20.000Z and 2023-11-14T22:13:21.900Z")]


@pytest.mark.parametrize("listed", [True, False])
@pytest.mark.parametrize(
    ("wanted", "read"),
    [
        (("/scan*",), ["/scan_front", "/scan_rear"]),
        (("scan_?ear",), ["/scan_rear"]),
        (("*",), ["/odd[1]", "/scan_front", "/scan_rear"]),
        (("/odd[1]", "/scan_[f]*"), ["/odd[1]", "/scan_front"]),
    ],
)
def test_topics_by_pattern(listed: bool, wanted: tuple[str, ...], read: list[str]) -> None:
    names = ("/scan_front", "/scan_rear", "/odd[1]")
    blocks = [block([3] * 5, topic=name) for name in names]
    topics = [Topic(name, LASERSCAN, "cdr", 5) for name in names] if listed else None
    log = FakeLog(blocks, topics)
    found = read_batches(log, ReadOptions(topics=wanted), ReadReport())
    assert sorted({batch.topic for batch in found}) == read


def test_a_pattern_that_means_nothing_is_a_topic_that_is_not_there() -> None:
    with pytest.raises(NoScanError, match=r"no LaserScan topic /front\*"):
        run([block([3] * 5)], topics=["/front*"])


def test_sweeps_of_a_pipe_do_not_wait_for_their_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    blocks = [block([9] * 20, first=20 * number) for number in range(20)]
    whole = run(blocks)
    assert len(whole) == 1
    monkeypatch.setattr(batches, "LATENCY", -1.0)
    assert len(run(blocks)) == 1
    pipe = FakeLog(blocks, size=None)
    found, read = [], []
    for batch in read_batches(pipe, ReadOptions(), ReadReport()):
        found.append(batch)
        read.append(pipe.position)
    # The first comes long before the pipe ends.
    assert read[0] < 2000
    assert sweeps(found) == sweeps(whole)
