"""Ranges are judged once: every marker of real drivers, every closing of a turn, blocks of any shape."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan, pi
from typing import Any

import numpy as np
import pytest

from lidarcli.options.choices import NO_RETURN_WORDS
from lidarcli.options.reading import parse_no_return
from lidarcli.sweeps.range_rules import RangeRules, closure, duration, normalise
from lidarcli.sweeps.types import TURN, Closure, RawSweeps, Status, SweepBatch, SweepPoses, concatenate
from tests.sweeping import raw_sweeps

VALID, NO_RETURN, TOO_CLOSE, INVALID, MASKED, PADDING = Status


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
def test_limits_without_a_meaning_are_no_limits(range_min: float, range_max: float, statuses: list[Status]) -> None:
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


def test_short_rows_are_padded_and_padding_is_no_beam() -> None:
    batch = normalise(ragged([[1.0, 0.0], [2.0, 3.0, inf, 4.0], []]), np.array([3, 5, 6]), RangeRules())
    assert batch.status.tolist() == [[VALID, NO_RETURN, PADDING, PADDING], [VALID, VALID, NO_RETURN, VALID], [PADDING] * 4]
    np.testing.assert_array_equal(batch.ranges, np.array([[1, nan, nan, nan], [2, 3, nan, 4], [nan] * 4], np.float32))
    assert batch.beams.tolist() == [2, 4, 0]
    assert batch.sweep.tolist() == [3, 5, 6]
    assert (len(batch), batch.width) == (3, 4)
    np.testing.assert_allclose(batch.bearings[1], [-1.0, -0.99, -0.98, -0.97], rtol=0, atol=1e-15)


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
    assert batch.seconds.tolist() == [0.0, 0.1, -2.0, 1e-9]
    later = normalise(raw, np.arange(7, 11), RangeRules(), first_ns=4_000_000_000)
    assert later.seconds.tolist() == [1.0, 1.1, -1.0, 1.000000001]
    assert later.rows(np.array([3])).seconds.tolist() == [1.000000001]


def test_seconds_between_stamps_farther_apart_than_int64_counts() -> None:
    ends = np.array([-(2**63), 2**63 - 1, 0])
    raw = replace(ragged([[1.0]] * 3), stamp_ns=ends, record_ns=np.zeros(3, np.int64))
    seconds = normalise(raw, np.arange(3), RangeRules()).seconds
    assert seconds.tolist() == [0.0, pytest.approx(2.0**64 / 1e9), pytest.approx(2.0**63 / 1e9)]
    raw = raw.rows(np.array([1, 0]))
    assert normalise(raw, np.arange(2), RangeRules()).seconds[1] == pytest.approx(-(2.0**64) / 1e9)


def test_no_rows() -> None:
    batch = normalise(ragged([]), np.arange(0), RangeRules())
    assert (len(batch), batch.width) == (0, 0)
    assert batch.closure.tolist() == []
    assert batch.seconds.tolist() == []


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


# How long a sweep takes, and where the sensor is meanwhile.


def lasting(beams: int = 361, **times: Any) -> Any:
    """The durations of sweeps of a degree from beam to beam whose headers tell these times, an array or one each."""
    count = max((len(np.atleast_1d(value)) for value in times.values()), default=1)
    block = raw_sweeps(np.ones((count, beams)), angle_increment=TURN / 360)
    told = {name: np.broadcast_to(np.asarray(value, np.float32), count).copy() for name, value in times.items()}
    return duration(replace(block, **told))


def test_a_sweep_takes_the_time_between_its_beams() -> None:
    assert lasting(time_increment=0.0002).tolist() == pytest.approx([0.072])
    # The last beam first.
    assert lasting(time_increment=-0.0002).tolist() == pytest.approx([-0.072])
    # What `time_increment` says counts, whatever the time from sweep to sweep.
    assert lasting(time_increment=0.0002, scan_time=0.1).tolist() == pytest.approx([0.072])
    assert lasting(time_increment=[0.0, 0.0001, -0.0001]).tolist() == pytest.approx([0.0, 0.036, -0.036])


@pytest.mark.parametrize(
    "times",
    [
        {},
        {"time_increment": 0.0},
        {"scan_time": 0.0},
        {"time_increment": 0.0, "scan_time": 0.0},
        # The time between sweeps moves no beam.
        {"scan_time": 0.1},
        {"time_increment": 0.0, "scan_time": 0.1},
        {"time_increment": [nan, inf, -inf, 0.01, -0.01, 3e38]},
        {"time_increment": nan, "scan_time": 0.1},
    ],
)
def test_times_that_say_nothing(times: dict[str, Any]) -> None:
    assert lasting(**times) is None


def test_nonsense_in_one_header_leaves_the_others() -> None:
    told = lasting(time_increment=[nan, 0.0001, 5.0, 0.0], scan_time=[0.1, 0.1, 0.1, 0.1])
    assert told.tolist() == pytest.approx([0.0, 0.036, 0.0, 0.0])
    assert np.isfinite(told).all()


def test_the_longest_sweep_is_believed() -> None:
    assert lasting(101, time_increment=0.01).tolist() == pytest.approx([1.0])
    assert lasting(103, time_increment=0.01) is None


def test_durations_stay_with_their_sweeps() -> None:
    block = raw_sweeps(np.ones((4, 11)))
    timed = replace(block, time_increment=np.array([0.001, 0.002, 0.003, 0.004], np.float32))
    batch = normalise(timed, np.arange(4), RangeRules())
    assert batch.duration is not None
    assert batch.duration.tolist() == pytest.approx([0.01, 0.02, 0.03, 0.04])
    part = batch.rows(np.array([3, 1]))
    assert part.duration is not None
    assert part.duration.tolist() == pytest.approx([0.04, 0.02])
    assert normalise(block, np.arange(4), RangeRules()).duration is None


def test_shares_of_a_sweep() -> None:
    batch = normalise(ragged([[1.0] * 5, [1.0] * 3, [1.0]]), np.arange(3), RangeRules())
    assert batch.all_shares().tolist() == [
        [0.0, 0.25, 0.5, 0.75, 1.0],
        [0.0, 0.5, 1.0, 1.5, 2.0],
        [0.0, 1.0, 2.0, 3.0, 4.0],
    ]
    row = np.array([0, 0, 1, 1, 2])
    assert batch.shares(row, np.array([0.0, 4.0, 0.5, 2.0, 0.0])).tolist() == [0.0, 1.0, 0.25, 1.0, 0.0]


def going(upside_down: bool = False) -> SweepPoses:
    """One sensor goes 1 m along y and turns by a quarter, the other stands."""
    way = np.array([[0.0, 1.0, pi / 2], [0.0, 0.0, 0.0]])
    return SweepPoses(np.array([2.0, 5.0]), np.array([3.0, 5.0]), np.array([0.0, 1.0]), np.full(2, upside_down), way)


def test_where_a_sensor_is_during_its_sweep() -> None:
    rows, share = np.array([0, 0, 0, 1]), np.array([0.0, 0.5, 1.0, 0.7])
    there = going().during(rows, share)
    assert there.x.tolist() == [2.0, 2.0, 2.0, 5.0]
    assert there.y.tolist() == [3.0, 3.5, 4.0, 5.0]
    assert there.yaw.tolist() == pytest.approx([0.0, pi / 4, pi / 2, 1.0])
    # It is there at that moment: there is no way left.
    assert there.way is None
    still = replace(going(), way=None).during(rows, share)
    assert still.y.tolist() == [3.0, 3.0, 3.0, 5.0]


@pytest.mark.parametrize("upside_down", [False, True])
def test_points_are_seen_from_where_the_sensor_was(upside_down: bool) -> None:
    side = -1.0 if upside_down else 1.0
    rows, share = np.array([0, 0, 0]), np.array([0.0, 0.5, 1.0])
    points = np.array([1.0, 1.0, 1.0]), np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.2, 0.3])
    x, y, yaw = going(upside_down).to_world(rows, *points, share)
    half = np.sqrt(0.5)
    assert x.tolist() == pytest.approx([3.0, 2.0 + half, 2.0 - side * 0.5])
    assert y.tolist() == pytest.approx([3.0, 3.5 + half, 5.0])
    assert np.sin(yaw - [0.0, pi / 4 + side * 0.2, pi / 2 + side * 0.3]) == pytest.approx(np.zeros(3), abs=1e-12)
    # Without a share they are seen from its start.
    x, y, _ = going(upside_down).to_world(rows, *points)
    assert x.tolist() == pytest.approx([3.0, 3.0, 3.0])
    assert y.tolist() == pytest.approx([3.0, 3.0, 3.0 + side * 0.5])


@pytest.mark.parametrize("upside_down", [False, True])
def test_the_way_as_the_sensor_has_it(upside_down: bool) -> None:
    random = np.random.default_rng(3)
    x, y, yaw = random.uniform(-3, 3, (3, 20))
    poses = SweepPoses(x, y, yaw, np.full(20, upside_down), random.uniform(-1, 1, (20, 3)))
    own = poses.own_way()
    assert own is not None
    # Where it is at the end, as its own point at the start.
    rows, ones = np.arange(20), np.ones(20)
    there = poses.during(rows, ones)
    end_x, end_y, heading = poses.to_world(rows, own[:, 0], own[:, 1], own[:, 2])
    np.testing.assert_allclose([end_x, end_y], [there.x, there.y])
    np.testing.assert_allclose(np.sin(heading - there.yaw), 0.0, atol=1e-12)
    assert replace(poses, way=None).own_way() is None
