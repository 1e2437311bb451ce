"""Ranges are judged once: every marker of real drivers, every closing of a turn, blocks of any shape."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan, pi
from typing import Any

import numpy as np
import pytest

from lidarcli.errors import OptionError
from lidarcli.sweeps import (
    NO_RETURN_WORDS,
    TURN,
    Closure,
    RangeRules,
    RawSweeps,
    Status,
    SweepBatch,
    closure,
    concatenate,
    normalise,
    parse_no_return,
)
from tests.sweeping import raw_sweeps

VALID, NO_RETURN, TOO_CLOSE, INVALID, PADDING = Status


def ragged(rows: list[list[float]], **columns: Any) -> RawSweeps:
    """Rows of any length, padded with a plausible range."""
    beams = np.array([len(row) for row in rows], np.int32)
    ranges = np.full((len(rows), int(beams.max(initial=0))), 1.0, np.float32)
    for row, values in enumerate(rows):
        ranges[row, : len(values)] = values
    geometry = {"range_max": 8.0, "angle_min": -1.0, "angle_increment": 0.01, "stamp_ns": 5, "record_ns": 7}
    return raw_sweeps(ranges, beams=beams, **{**geometry, **columns})


def judged(values: list[float], rules: RangeRules | None = None, **limits: float) -> SweepBatch:
    """One sweep, normalised."""
    return normalise(ragged([values], **limits), np.arange(1), rules or RangeRules())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (1.0, VALID),
        (0.1, VALID),
        (float(np.nextafter(np.float32(8.0), np.float32(0.0))), VALID),
        (inf, NO_RETURN),
        (0.0, NO_RETURN),
        (-0.0, NO_RETURN),
        (8.0, NO_RETURN),
        (16.0, NO_RETURN),
        (81.91, NO_RETURN),
        (0.05, TOO_CLOSE),
        (-inf, TOO_CLOSE),
        (nan, INVALID),
        (-0.099, INVALID),
        (-1.0, INVALID),
    ],
)
def test_every_marker_has_one_status_by_default(value: float, expected: Status) -> None:
    batch = judged([2.0, value, 3.0])
    assert batch.status.tolist() == [[VALID, expected, VALID]]
    assert batch.ranges.dtype == np.float32
    kept = np.float32(value) if expected == VALID else np.float32(nan)
    np.testing.assert_array_equal(batch.ranges, np.array([[2.0, kept, 3.0]], np.float32))


@pytest.mark.parametrize(
    ("words", "value", "expected"),
    [
        ("nan", nan, NO_RETURN),
        ("negative", -0.5, NO_RETURN),
        ("negative", -inf, TOO_CLOSE),
        ("below", 0.05, NO_RETURN),
        ("zero", 0.0, NO_RETURN),
        ("max", 8.0, NO_RETURN),
        ("above", 9.0, NO_RETURN),
        ("inf", inf, NO_RETURN),
        # What a list leaves out is no longer "no return": a zero or infinity says nothing, a range at the limit counts.
        ("max", 0.0, INVALID),
        ("max", inf, INVALID),
        ("zero", 8.0, VALID),
        ("zero", 9.0, INVALID),
        ("zero", nan, INVALID),
        ("zero", 0.05, TOO_CLOSE),
    ],
)
def test_a_list_of_words_overrides_the_defaults(words: str, value: float, expected: Status) -> None:
    no_return, markers = parse_no_return(words)
    batch = judged([value], RangeRules(no_return, markers))
    assert batch.status.tolist() == [[expected]]
    assert np.isnan(batch.ranges[0, 0]) == (expected != VALID)


@pytest.mark.parametrize("marker", [81.91, 50.0, 32.767])
def test_a_magic_number_is_no_return_where_it_is_named(marker: float) -> None:
    values = [marker, marker - 0.001, 2.0]
    assert judged(values, range_max=100.0).status.tolist() == [[VALID, VALID, VALID]]
    no_return, markers = parse_no_return(f"inf,{marker}")
    batch = judged(values, RangeRules(no_return, markers), range_max=100.0)
    assert batch.status.tolist() == [[NO_RETURN, VALID, VALID]]
    assert np.isnan(batch.ranges[0, 0])
    # Above range_max it is no return as well, not merely invalid.
    batch = judged(values, RangeRules(no_return, markers), range_max=8.0)
    assert batch.status.tolist() == [[NO_RETURN, INVALID, VALID]]


@pytest.mark.parametrize(
    ("range_min", "range_max", "statuses"),
    [
        # inf, nan, 0 and nonsense as limits of a message are no limits.
        (0.0, inf, [VALID, VALID, VALID, NO_RETURN]),
        (0.0, nan, [VALID, VALID, VALID, NO_RETURN]),
        (0.0, 0.0, [VALID, VALID, VALID, NO_RETURN]),
        (nan, 8.0, [VALID, VALID, NO_RETURN, NO_RETURN]),
        (inf, 8.0, [VALID, VALID, NO_RETURN, NO_RETURN]),
        (-1.0, 8.0, [VALID, VALID, NO_RETURN, NO_RETURN]),
        (1.0, 0.5, [TOO_CLOSE, VALID, VALID, NO_RETURN]),
    ],
)
def test_limits_without_a_meaning_are_no_limits(
    range_min: float, range_max: float, statuses: list[Status]
) -> None:
    batch = judged([0.05, 2.0, 20.0, inf], range_min=range_min, range_max=range_max)
    assert batch.status.tolist() == [statuses]


@pytest.mark.parametrize("range_max", [inf, nan, 0.0, 3.4e38])
def test_there_is_nothing_beyond_a_thousand_kilometres(range_max: float) -> None:
    batch = judged([5e5, 2e6, 1e30, 3.4e38, inf], range_max=range_max)
    assert batch.status.tolist() == [[VALID, NO_RETURN, NO_RETURN, NO_RETURN, NO_RETURN]]


@pytest.mark.parametrize("range_min", [-1.0, 0.0, nan, 1e-30])
def test_there_is_nothing_within_a_micrometre(range_min: float) -> None:
    batch = judged([1e-45, 1e-30, 9e-7, 2e-6], range_min=range_min)
    assert batch.status.tolist() == [[TOO_CLOSE, TOO_CLOSE, TOO_CLOSE, VALID]]


def test_given_limits_replace_those_of_the_messages() -> None:
    batch = judged([0.3, 0.6, 4.0, 5.0, 9.0], RangeRules(limits=(0.5, 5.0)))
    assert batch.status.tolist() == [[TOO_CLOSE, VALID, VALID, NO_RETURN, NO_RETURN]]
    assert (batch.range_min.tolist(), batch.range_max.tolist()) == ([0.5], [5.0])


def test_the_raw_block_is_left_as_it_is() -> None:
    raw = ragged([[0.0, 2.0, inf, 9.0]])
    before = raw.ranges.copy()
    normalise(raw, np.arange(1), RangeRules())
    np.testing.assert_array_equal(raw.ranges, before)


def test_short_rows_are_padded_and_padding_is_no_beam() -> None:
    batch = normalise(ragged([[1.0, 0.0], [2.0, 3.0, inf, 4.0], []]), np.array([3, 5, 6]), RangeRules())
    assert batch.status.tolist() == [
        [VALID, NO_RETURN, PADDING, PADDING],
        [VALID, VALID, NO_RETURN, VALID],
        [PADDING] * 4,
    ]
    np.testing.assert_array_equal(
        batch.ranges, np.array([[1, nan, nan, nan], [2, 3, nan, 4], [nan] * 4], np.float32)
    )
    assert batch.beams.tolist() == [2, 4, 0]
    assert batch.sweep.tolist() == [3, 5, 6]
    assert (len(batch), batch.width) == (3, 4)
    np.testing.assert_allclose(batch.bearings()[1], [-1.0, -0.99, -0.98, -0.97], rtol=0, atol=1e-15)


def test_a_header_without_a_stamp_takes_the_time_of_the_record() -> None:
    raw = ragged([[1.0], [1.0]])
    raw = replace(raw, stamp_ns=np.array([0, 5]), record_ns=np.array([7, 9]))
    batch = normalise(raw, np.arange(2), RangeRules())
    assert batch.stamp_ns.tolist() == [7, 5]
    assert batch.record_ns.tolist() == [7, 9]


def test_seconds_count_from_the_first_sweep_of_the_topic() -> None:
    raw = ragged([[1.0]] * 4)
    stamps = np.array([5_000_000_000, 5_100_000_000, 3_000_000_000, 5_000_000_001])
    raw = replace(raw, stamp_ns=stamps, record_ns=stamps)
    batch = normalise(raw, np.arange(7, 11), RangeRules())
    assert batch.seconds().tolist() == [0.0, 0.1, -2.0, 1e-9]
    later = normalise(raw, np.arange(7, 11), RangeRules(), first_ns=4_000_000_000)
    assert later.seconds().tolist() == [1.0, 1.1, -1.0, 1.000000001]
    assert later.rows(np.array([3])).seconds().tolist() == [1.000000001]


def test_seconds_between_stamps_farther_apart_than_int64_counts() -> None:
    ends = np.array([-(2**63), 2**63 - 1, 0])
    raw = replace(ragged([[1.0]] * 3), stamp_ns=ends, record_ns=np.zeros(3, np.int64))
    seconds = normalise(raw, np.arange(3), RangeRules()).seconds()
    assert seconds.tolist() == [0.0, pytest.approx(2.0**64 / 1e9), pytest.approx(2.0**63 / 1e9)]
    raw = raw.rows(np.array([1, 0]))
    assert normalise(raw, np.arange(2), RangeRules()).seconds()[1] == pytest.approx(-(2.0**64) / 1e9)


def test_no_rows() -> None:
    batch = normalise(ragged([]), np.arange(0), RangeRules())
    assert (len(batch), batch.width) == (0, 0)
    assert batch.closure.tolist() == []
    assert batch.seconds().tolist() == []


OPEN, CLOSED, SHARED = Closure


@pytest.mark.parametrize(
    ("beams", "increment", "expected"),
    [
        # By definition.
        (360, TURN / 360, CLOSED),
        (361, TURN / 360, SHARED),
        (720, TURN / 720, CLOSED),
        (361, -TURN / 360, SHARED),
        (360, -TURN / 360, CLOSED),
        # Real sensors: the increment as their drivers write it, in float32.
        pytest.param(360, 0.017453292, CLOSED, id="360 beams over -3.1241..3.1416"),
        pytest.param(1080, 0.005807, CLOSED, id="1080 beams over -3.1241..3.1416: a seam of two beams"),
        pytest.param(1080, 0.0058070039, CLOSED, id="the same, not rounded"),
        pytest.param(360, 0.017493, SHARED, id="360 beams over 0..6.28"),
        pytest.param(360, 0.0175019, SHARED, id="360 beams over 0..2π, first and last the same"),
        pytest.param(361, 2 * pi / 360, SHARED, id="361 beams over ±π"),
        pytest.param(452, TURN / 452, CLOSED, id="a sensor with a count of its own each turn"),
        pytest.param(719, TURN / 718, SHARED, id="another"),
        # Partial views.
        pytest.param(681, 0.006136, OPEN, id="240°"),
        pytest.param(726, 0.006136, OPEN, id="asymmetric 255°"),
        pytest.param(1081, 1.5 * pi / 1080, OPEN, id="270°"),
        pytest.param(180, 0.017551, OPEN, id="180°"),
        pytest.param(640, 0.007101, OPEN, id="260°"),
        (350, TURN / 360, OPEN),
        (358, TURN / 360, OPEN),
        (359, TURN / 360, OPEN),
        # More than a turn is no turn.
        (370, TURN / 360, OPEN),
        (720, TURN / 360, OPEN),
        # Nothing that could close.
        (0, 0.01, OPEN),
        (1, TURN, OPEN),
        (2, TURN, OPEN),
        (3, TURN / 3, OPEN),
        (4, TURN / 4, CLOSED),
        (4, TURN / 3, SHARED),
        (360, 0.0, OPEN),
        (360, nan, OPEN),
    ],
)
def test_how_a_sweep_closes(beams: int, increment: float, expected: Closure) -> None:
    for sign in (1.0, -1.0):
        kind = closure(np.array([beams], np.int32), np.array([sign * increment]))
        assert kind.tolist() == [expected]
        assert kind.dtype == np.uint8


def test_each_row_closes_by_its_own_geometry() -> None:
    beams = np.array([360, 361, 270, 452], np.int32)
    steps = np.array([TURN / 360, -TURN / 360, TURN / 360, TURN / 452])
    assert closure(beams, steps).tolist() == [CLOSED, SHARED, OPEN, CLOSED]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("zero,max,81.91", (frozenset({"zero", "max"}), (81.91,))),
        (" Zero , MAX ", (frozenset({"zero", "max"}), ())),
        ("50, 32.767", (frozenset(), (50.0, 32.767))),
        ("", (frozenset(), ())),
        (",,", (frozenset(), ())),
        (",".join(NO_RETURN_WORDS), (frozenset(NO_RETURN_WORDS), ())),
    ],
)
def test_a_no_return_list(text: str, expected: tuple[frozenset[str], tuple[float, ...]]) -> None:
    assert parse_no_return(text) == expected


def test_a_no_return_list_with_a_word_that_means_nothing() -> None:
    with pytest.raises(OptionError) as caught:
        parse_no_return("zero,minimum")
    assert str(caught.value) == (
        "--no-return: 'minimum' is neither a number nor one of inf, zero, max, above, nan, negative, below"
    )
    assert caught.value.exit_code == 2


def test_blocks_of_different_widths_and_frames_join() -> None:
    narrow = ragged([[1.0, 2.0]], frame_ids=("front",), angle_min=-1.0, stamp_ns=1)
    wide = ragged([[3.0, 4.0, 5.0], [6.0]], frame_ids=("rear", "front"), frame=1, angle_min=-2.0, stamp_ns=2)
    other = ragged([[7.0]], frame_ids=("rear",), range_max=5.0, stamp_ns=3)
    joined = concatenate([narrow, wide, other])
    assert joined.frame_ids == ("front", "rear")
    assert [joined.frame_ids[code] for code in joined.frame] == ["front", "front", "front", "rear"]
    assert joined.frame.dtype == np.int32
    assert joined.stamp_ns.tolist() == [1, 2, 2, 3]
    assert joined.angle_min.tolist() == [-1.0, -2.0, -2.0, -1.0]
    assert joined.range_max.tolist() == [8.0, 8.0, 8.0, 5.0]
    assert joined.beams.tolist() == [2, 3, 1, 1]
    assert joined.ranges.dtype == np.float32
    rows = [row[:count].tolist() for row, count in zip(joined.ranges, joined.beams, strict=True)]
    assert rows == [[1.0, 2.0], [3.0, 4.0, 5.0], [6.0], [7.0]]
    assert joined.ranges.shape == (4, 3)
    # What is joined is judged like its parts.
    status = normalise(joined, np.arange(4), RangeRules()).status.tolist()
    assert status[0] == [VALID, VALID, PADDING]
    assert status[3] == [NO_RETURN, PADDING, PADDING]


def test_a_single_block_is_not_copied() -> None:
    block = ragged([[1.0]])
    assert concatenate([block]) is block


@pytest.mark.parametrize("index", [slice(1, 3), np.array([1, 2]), np.array([False, True, True])])
def test_rows_of_a_block(index: object) -> None:
    block = ragged([[1.0], [2.0, 3.0], [4.0]])
    part = block.rows(index)  # type: ignore[arg-type]
    assert len(part) == 2
    assert part.beams.tolist() == [2, 1]
    assert part.ranges[:, 0].tolist() == [2.0, 4.0]
    assert part.frame_ids == block.frame_ids


def test_times_within_sweeps_stay_with_their_rows_or_are_unknown() -> None:
    block = ragged([[1.0], [2.0], [3.0]])
    timed = replace(block, time_increment=np.array([0.1, 0.2, 0.3], np.float32))
    part = timed.rows(slice(1, 3))
    assert part.time_increment is not None
    assert part.time_increment.tolist() == pytest.approx([0.2, 0.3])
    assert part.scan_time is None
    joined = concatenate([part, timed])
    assert joined.time_increment is not None
    assert joined.time_increment.tolist() == pytest.approx([0.2, 0.3, 0.1, 0.2, 0.3])
    # What one of the parts has not told is not known of the whole.
    assert concatenate([timed, block]).time_increment is None
