"""The columnar decoder against a slow reader of single messages."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lidarcli.logs import blocks as block_bounds
from lidarcli.logs import laserscan
from lidarcli.logs.base import MAX_BEAMS, ReadReport
from lidarcli.logs.blocks import split_rows
from lidarcli.logs.laserscan import Locator, decode_blocks
from lidarcli.ros import cursor
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests.logs.scan_messages import GEOMETRY, scan


def decode(*arguments: Any, **options: Any) -> RawSweeps | None:
    """The blocks of some messages as one."""
    blocks = list(decode_blocks(*arguments, **options))
    return concatenate(blocks) if blocks else None


def pack(messages: list[bytes], gap: int = 3) -> tuple[Any, Any, Any, Any]:
    """Messages at unaligned places of one buffer."""
    buffer, offsets = b"", []
    for message in messages:
        buffer += b"\xaa" * gap
        offsets.append(len(buffer))
        buffer += message
    lengths = np.array([len(message) for message in messages], np.int64)
    record_ns = np.arange(len(messages), dtype=np.int64) * 100
    return np.frombuffer(buffer, np.uint8), np.array(offsets, np.int64), lengths, record_ns


def read(messages: list[bytes], encoding: str = "cdr", **kwargs: Any) -> tuple[RawSweeps | None, ReadReport]:
    report = ReadReport()
    return decode("/scan", *pack(messages), encoding, report, **kwargs), report


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
def test_every_field_of_a_message(encoding: str) -> None:
    raw, report = read([scan([1.0, 2.0, np.inf], encoding=encoding, intensities=[7.0, 8.5, 0.0])], encoding)
    assert raw is not None
    assert raw.topic == "/scan"
    assert raw.frame_ids == ("laser",)
    assert raw.frame.tolist() == [0]
    assert raw.stamp_ns.tolist() == [7_000_000_008]
    assert raw.record_ns.tolist() == [0]
    assert raw.angle_min.tolist() == [np.float32(-1.5)]
    assert raw.angle_increment.tolist() == [float(np.float32(0.01))]
    assert raw.range_min.tolist() == [np.float32(0.05)]
    assert raw.range_max.tolist() == [np.float32(12)]
    assert raw.beams.tolist() == [3]
    assert raw.ranges.tolist() == [[1.0, 2.0, np.inf]]
    assert raw.ranges.dtype == np.float32
    assert raw.intensities is not None
    assert raw.intensities.tolist() == [[7.0, 8.5, 0.0]]
    assert raw.intensities.dtype == np.float32
    assert not report.refused


def intensities_of(raw: RawSweeps) -> Any:
    """NaN where a block has none."""
    return np.full(raw.ranges.shape, np.nan) if raw.intensities is None else raw.intensities


messages = st.lists(
    st.tuples(
        st.lists(st.floats(width=32), max_size=12),
        st.sampled_from([b"", b"a", b"/laser", b"base", b"caf\xc3\xa9", b"\xff"]),
        st.integers(-(2**31), 2**31 - 1),
        st.booleans(),
        st.lists(st.floats(width=32), max_size=12),
    ),
    min_size=1,
    max_size=9,
)


@given(messages, st.sampled_from(["cdr", "ros1"]))
def test_any_mixture_equals_its_parts(rows: list[tuple[Any, ...]], encoding: str) -> None:
    cdr = encoding == "cdr"
    coded = [
        scan(ranges, encoding=encoding, frame=frame, sec=sec if cdr else abs(sec), big=big and cdr, intensities=intensities)
        for ranges, frame, sec, big, intensities in rows
    ]
    raw, report = read(coded, encoding)
    assert raw is not None
    assert not report.refused
    assert len(raw) == len(rows)
    for i, (ranges, frame, sec, _, intensities) in enumerate(rows):
        seen = raw.ranges[i, : raw.beams[i]]
        np.testing.assert_array_equal(seen, np.array(ranges, np.float32))
        assert np.isnan(raw.ranges[i, raw.beams[i] :]).all()
        kept = np.full(raw.ranges.shape[1], np.nan, np.float32)
        kept[: min(len(intensities), len(ranges))] = intensities[: len(ranges)]
        np.testing.assert_array_equal(intensities_of(raw)[i], kept)
        assert raw.frame_ids[raw.frame[i]] == frame.decode("utf-8", "replace")
        assert raw.stamp_ns[i] == (sec if cdr else abs(sec)) * 10**9 + 8
    assert len(set(raw.frame_ids)) == len(raw.frame_ids)


@pytest.mark.parametrize(
    ("bad", "cause"),
    [
        (b"", laserscan.SHORT),
        (scan([1.0])[:40], laserscan.SHORT),
        (b"\0\3" + scan([1.0])[2:], cursor.ENCAPSULATION),
        (b"\1\1" + scan([1.0])[2:], cursor.ENCAPSULATION),
        (scan([1.0])[:12] + b"\xff\xff\xff\xff" + scan([1.0])[16:], laserscan.FRAME_BEYOND),
        (scan([1.0], frame=b"x" * 5000), cursor.NAME_LONG),
        (scan([1.0], declared=3), laserscan.RANGES_BEYOND),
        (scan([1.0], declared=MAX_BEAMS + 1), block_bounds.TOO_MANY),
        (scan([1.0], declared=2**32 - 1), block_bounds.TOO_MANY),
        (scan([1.0], geometry=(np.nan, *GEOMETRY[1:])), block_bounds.ANGLE_MIN),
        (scan([1.0], geometry=(*GEOMETRY[:2], np.inf, *GEOMETRY[3:])), block_bounds.INCREMENT),
        (scan([1.0, 2.0], geometry=(*GEOMETRY[:2], 0.0, *GEOMETRY[3:])), block_bounds.INCREMENT_ZERO),
        (scan([1.0], geometry=(1e30, *GEOMETRY[1:])), block_bounds.BEARINGS),
        (scan([1.0], geometry=(-2e6, *GEOMETRY[1:])), block_bounds.BEARINGS),
        (scan([1.0], geometry=(*GEOMETRY[:2], 1e30, *GEOMETRY[3:])), block_bounds.BEARINGS),
    ],
)
def test_a_bad_message_is_refused_alone(bad: bytes, cause: str) -> None:
    raw, report = read([scan([1.0]), bad, scan([2.0, 3.0])])
    assert raw is not None
    assert raw.record_ns.tolist() == [0, 200]
    np.testing.assert_array_equal(raw.ranges, np.float32([[1, np.nan], [2, 3]]))
    assert report.refused == {("/scan", cause): 1}


def test_a_sweep_without_beams_is_a_sweep() -> None:
    still = (*GEOMETRY[:2], 0.0, *GEOMETRY[3:])
    raw, report = read([scan([], geometry=still), scan([1.0], geometry=still)])
    assert raw is not None
    assert raw.beams.tolist() == [0, 1]
    assert not report.refused
    alone, _ = read([scan([])])
    assert alone is not None
    assert alone.ranges.shape == (1, 0)


def test_every_cut_of_a_message_is_refused_or_whole() -> None:
    whole = scan(np.arange(9.0), frame=b"laser_link", intensities=np.arange(9.0))
    needed = len(whole) - 4 * 10
    for end in range(len(whole) + 1):
        raw, report = read([whole[:end]])
        assert (raw is not None) == (end >= needed)
        assert sum(report.refused.values()) == (end < needed)
        if raw is not None:
            assert (raw.intensities is not None) == (end == len(whole))


def test_one_wide_sweep_does_not_widen_its_neighbours() -> None:
    counts = [361] * 700 + [100_000] + [361] * 700
    blocks = list(decode_blocks("/scan", *pack([scan(np.full(n, 2.0)) for n in counts]), "cdr", ReadReport()))
    assert np.concatenate([block.beams for block in blocks]).tolist() == counts
    assert np.concatenate([block.record_ns for block in blocks]).tolist() == [100 * i for i in range(1401)]
    assert sum(block.ranges.size for block in blocks) < 5 * sum(counts)
    assert max(block.ranges.size for block in blocks) <= block_bounds.BLOCK_VALUES


@given(st.lists(st.integers(0, 5000), max_size=60), st.integers(1, 20), st.integers(1, 20_000))
def test_split_rows_covers_all_within_its_bounds(counts: list[int], rows: int, values: int) -> None:
    parts = list(split_rows(np.array(counts, np.int64), rows, values))
    assert [i for part in parts for i in range(part.start, part.stop)] == list(range(len(counts)))
    for part in parts:
        size = part.stop - part.start
        assert 1 <= size <= rows
        assert size == 1 or size * max(1, *counts[part]) <= values


def test_narrow_and_wide_publishers_on_one_topic_share_blocks() -> None:
    assert len(list(split_rows(np.tile(np.array([180, 1081], np.int64), 400)))) == 1


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
@pytest.mark.parametrize("declared", [4, 1 << 20, 1 << 31, (1 << 32) - 1])
def test_intensities_beyond_the_message_cost_no_sweep(encoding: str, declared: int) -> None:
    good = scan([1.0, 2.0, 3.0], encoding=encoding, intensities=[5.0, 6.0, 7.0])
    lying = good[:-16] + declared.to_bytes(4, "little") + good[-12:]
    raw, report = read([lying, good], encoding)
    assert raw is not None
    assert raw.ranges.tolist() == [[1.0, 2.0, 3.0]] * 2
    np.testing.assert_array_equal(intensities_of(raw), [[np.nan] * 3, [5.0, 6.0, 7.0]])
    assert not report.refused


@pytest.mark.parametrize("encoding", ["cdr", "ros1"])
def test_a_locator_takes_no_message_for_another_of_the_same_length(encoding: str) -> None:
    near = (*GEOMETRY[:6], 3.0)
    messages = [
        scan([1.0, 2.0], encoding=encoding, sec=sec, frame=frame, geometry=geometry, intensities=lit, big=big)
        for big in ((False, True) if encoding == "cdr" else (False,))
        for sec, frame, geometry in ((7, b"laser", GEOMETRY), (-9, b"laser", near), (9, b"rad", near), (9, b"radar", near))
        for lit in ((), (0.5,))
        if sec > 0 or encoding == "cdr"
    ]
    used = Locator(encoding, several=False)
    for message in [each for one in messages for each in (one, *messages, one[:-5])]:
        found, alone = used(message), Locator(encoding, several=False)(message)
        assert (found and [*map(repr, found)]) == (alone and [*map(repr, alone)])
