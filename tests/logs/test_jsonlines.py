"""Messages as the command line of MCAP prints them, of its versions in Go and in Rust."""

from __future__ import annotations

import io
import json
from typing import Any

import numpy as np
import pytest

from lidarcli.logs import open_log
from lidarcli.logs.base import MAX_BEAMS, POSE_TYPES, Damage, OpenOptions, ReadReport
from lidarcli.sweeps.types import RawSweeps

STAMP = 1_700_000_000_000_000_000
LASER = (
    '{"header":{"seq":3,"stamp":STAMP,"frame_id":"laser"},"angle_min":-0.5,"angle_max":0.5,"angle_increment":0.5,'
    '"time_increment":0.001,"scan_time":0.1,"range_min":0.1,"range_max":12.0,'
    '"ranges":[2.0999999046325684,"NaN","Infinity"],"intensities":[]}'
)
ODOMETRY = '{"header":{"stamp":{"sec":1,"nsec":2}},"pose":{"pose":{"position":{"x":1}}}}'


def line(data: str, topic: str = "/scan", time: str = '"2023-11-14T22:13:20.000000030Z"') -> str:
    return f'{{"topic":"{topic}","sequence":4,"log_time":{time},"publish_time":{time},"data":{data}}}\n'


def laser(stamp: str = '{"sec":1700000000,"nanosec":7}') -> str:
    return LASER.replace("STAMP", stamp)


def read(text: str | bytes) -> tuple[list[RawSweeps], ReadReport]:
    report = ReadReport()
    with open_log(io.BytesIO(text.encode() if isinstance(text, str) else text)) as log:
        assert log.format == "json lines"
        assert log.topics() is None
        return list(log.scans(None, report)), report


def one(text: str | bytes) -> RawSweeps:
    blocks, report = read(text)
    assert (report.damage, report.refused) == ([], {})
    [block] = blocks
    return block


@pytest.mark.parametrize(
    ("stamp", "time"),
    [
        ('{"sec":1700000000,"nanosec":7}', '"2023-11-14T22:13:20.000000030Z"'),
        ('{"secs":1700000000,"nsecs":7}', "1700000000.000000030"),
        ('{"sec":1700000000,"nsec":7}', '"1700000000000000030"'),
        ("1700000000.000000007", '"1700000000.000000030"'),
        ('"2023-11-14T22:13:20.000000007Z"', "1700000000.000000030"),
    ],
)
def test_times_are_exact_however_they_are_written(stamp: str, time: str) -> None:
    got = one(line(laser(stamp), time=time))
    assert got.stamp_ns.tolist() == [STAMP + 7]
    assert got.record_ns.tolist() == [STAMP + 30]


def test_a_laser_scan() -> None:
    got = one(line(laser()))
    assert (got.topic, got.frame_ids) == ("/scan", ("laser",))
    assert (got.angle_min.tolist(), got.angle_increment.tolist(), got.beams.tolist()) == ([-0.5], [0.5], [3])
    np.testing.assert_array_equal(got.ranges, np.array([[2.1, np.nan, np.inf]], np.float32))
    assert (got.range_min.tolist(), got.range_max.tolist()) == ([float(np.float32(0.1))], [12.0])
    assert got.time_increment is not None
    assert got.scan_time is not None
    assert got.time_increment.tolist() == [float(np.float32(0.001))]
    assert got.scan_time.tolist() == [float(np.float32(0.1))]


@pytest.mark.parametrize(
    "data",
    [
        '{"timestamp":"2023-11-14T22:13:20.000000007Z","frameId":"laser","pose":{},"startAngle":-0.5,"endAngle":0.5,'
        '"ranges":[2.5,"-Infinity",null],"intensities":[]}',
        '{"timestamp":{"sec":1700000000,"nsec":7},"frame_id":"laser","start_angle":-0.5,"end_angle":0.5,'
        '"ranges":[2.5,"-Infinity",null],"intensities":[]}',
    ],
    ids=["protobuf", "json"],
)
def test_a_foxglove_scan(data: str) -> None:
    got = one(line(data))
    assert got.stamp_ns.tolist() == [STAMP + 7]
    assert (got.angle_min.tolist(), got.angle_increment.tolist(), got.frame_ids) == ([-0.5], [0.5], ("laser",))
    np.testing.assert_array_equal(got.ranges, np.array([[2.5, -np.inf, np.nan]], np.float32))


@pytest.mark.parametrize(
    ("echo", "ranges", "intensities"),
    [
        ("first", [1.5, np.nan, np.inf, 3.0], [7.0, np.nan, 5.0, np.nan]),
        ("last", [2.5, np.nan, np.inf, 4.0], [9.0, np.nan, 5.0, np.nan]),
        ("strongest", [2.5, np.nan, np.inf, 3.0], [9.0, np.nan, 5.0, np.nan]),
    ],
)
def test_one_of_several_echoes_counts(echo: str, ranges: list[float], intensities: list[float]) -> None:
    data = json.loads(laser())
    data["ranges"] = [{"echoes": each} for each in ([1.5, 2.5], [], ["Infinity"], [3.0, 4.0])]
    data["intensities"] = [{"echoes": each} for each in ([7, 9], [], [5])]
    with open_log(io.BytesIO(line(json.dumps(data)).encode()), opening=OpenOptions(echo=echo)) as log:
        [got] = log.scans(None, ReadReport())
    np.testing.assert_array_equal(got.ranges, np.array([ranges], np.float32))
    assert got.intensities is not None
    np.testing.assert_array_equal(got.intensities, np.array([intensities], np.float32))


def test_lines_of_pymcap_cli() -> None:
    text = '{"topic":"/scan","sequence":4,"log_time":%d,"publish_time":%d,"schema":"s","message":%s}\n'
    bare = laser().replace('"NaN"', "NaN").replace('"Infinity"', "Infinity")
    got, want = one(text % (STAMP + 30, STAMP + 30, bare)), one(line(laser()))
    np.testing.assert_array_equal(got.ranges, want.ranges)
    assert (got.stamp_ns.tolist(), got.record_ns.tolist()) == ([STAMP + 7], [STAMP + 30])
    short = json.dumps(json.loads(laser()) | {"ranges": "<1,440 bytes>"})
    blocks, report = read(text % (STAMP, STAMP, short))
    cause = "the ranges are abbreviated (pymcap-cli cat: --bytes ints)"
    assert (blocks, report.damage, report.refused) == ([], [], {("/scan", cause): 1})


def test_topics_stay_apart_and_others_are_passed_over() -> None:
    text = (line(laser()) + line(ODOMETRY, "/odom") + line(laser(), "/rear \\u00e9")) * 300
    blocks, report = read(text)
    counts = {topic: sum(len(b) for b in blocks if b.topic == topic) for topic in ("/scan", "/rear é")}
    assert counts == {"/scan": 300, "/rear é": 300}
    assert (report.damage, report.refused) == ([], {})
    with open_log(io.BytesIO(text.encode())) as log:
        assert {block.topic for block in log.scans(["/scan"], report)} == {"/scan"}
    with open_log(io.BytesIO(text.encode())) as log:
        assert list(log.messages(POSE_TYPES, report)) == []


def test_bad_lines_are_named_by_number() -> None:
    good = line(laser())
    text = good + "Error: broken\n" + good[:90] + "\n" + good + '{"topic":"/scan"}\n' + good[:-9]
    blocks, report = read(text)
    assert sum(map(len, blocks)) == 2
    assert report.damage == [
        Damage("line 2", "no message of `mcap cat --json`"),
        Damage("line 3", "not JSON"),
        Damage("line 5", "no message of `mcap cat --json`"),
        Damage("line 6", "the file ends within this line: its message is dropped"),
    ]


def test_limits_that_are_null_are_none() -> None:
    none = {"range_min": None, "range_max": None, "time_increment": None, "scan_time": None}
    got = one(line(json.dumps(json.loads(laser()) | none)))
    assert (got.range_min[0], got.range_max[0]) == (0.0, np.inf)
    assert got.ranges[0, 0] == np.float32(2.1)


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        ({"ranges": "far"}, "not a LaserScan"),
        ({"ranges": [1.0, "far", 2.0]}, "not a LaserScan"),
        ({"ranges": [1.0, [2.0], 2.0]}, "not a LaserScan"),
        ({"angle_min": None}, "not a LaserScan"),
        ({"header": {"stamp": {"sec": "soon"}}}, "not a LaserScan"),
        ({"header": {"stamp": {"sec": 10**12}}}, "timestamp out of range"),
        ({"angle_increment": 0.0}, "angle_increment is zero"),
        ({"angle_increment": 1e308}, "the first or last bearing is beyond 1,000,000 rad"),
        ({"angle_min": float("nan")}, "angle_min is not finite"),
        ({"ranges": [1.0] * (MAX_BEAMS + 1)}, f"more than {MAX_BEAMS} beams declared"),
    ],
)
def test_a_message_that_can_be_no_sweep_is_counted(change: dict[str, Any], cause: str) -> None:
    bad = json.dumps(json.loads(laser()) | change)
    blocks, report = read(line(laser()) + line(bad) + line('{"nothing":1}'))
    assert sum(map(len, blocks)) == 1
    assert report.damage == []
    assert report.refused[("/scan", cause)] == 1 + (cause == "not a LaserScan")
