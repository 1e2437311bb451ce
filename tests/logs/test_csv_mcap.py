"""CSV as the command line of MCAP prints it: columns in the order of the alphabet, words of JSON, other messages' names."""

from __future__ import annotations

import io

import numpy as np
import pytest

from lidarcli.errors import UnreadableError
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests.logs.watched import CsvLog

HEAD = "log_time,publish_time,sequence"
TIMES = "2023-11-14T22:13:20.000000030Z,2023-11-14T22:13:20.000000020Z"
STAMP = 1_700_000_000_000_000_000


def read(text: str) -> tuple[RawSweeps, CsvLog]:
    with CsvLog(io.BytesIO(text.encode())) as log:
        found = concatenate(list(log.scans()))
    assert log.format == "csv (mcap cat --format=csv)"
    assert (log.report.damage, log.report.refused) == ([], {})
    return found, log


def test_a_laser_scan_of_ros_1() -> None:
    """Fields by the alphabet, intensities before ranges, the stamp as one number."""
    names = (
        "angle_increment,angle_max,angle_min,header.frame_id,header.seq,header.stamp,intensities.0,intensities.1,"
        "intensities.2,range_max,range_min,ranges.0,ranges.1,ranges.2,scan_time,time_increment"
    )
    row = "0.10000000149011612,0.2,0.0,laser,7,1700000000.25,1.0,2.0,3.0,12.0,0.1,2.5,NaN,Infinity,0.1,0.0"
    got, _ = read(f"{HEAD},{names}\n{TIMES},4,{row}\n")
    assert got.record_ns.tolist() == [STAMP + 30]
    assert got.stamp_ns.tolist() == [STAMP + 250_000_000]
    assert (got.frame_ids, got.topic) == (("laser",), "/scan")
    assert got.angle_increment.tolist() == [float(np.float32(0.1))]
    np.testing.assert_array_equal(got.ranges, np.array([[2.5, np.nan, np.inf]], np.float32))
    assert got.intensities is not None
    assert got.intensities.tolist() == [[1.0, 2.0, 3.0]]
    assert got.range_max.tolist() == [12.0]


@pytest.mark.parametrize(
    ("names", "time"),
    [
        ("endAngle,frameId,ranges.0,ranges.1,ranges.2,startAngle,timestamp", "2023-11-14T22:13:20.000000007Z"),
        ("end_angle,frame_id,ranges.0,ranges.1,ranges.2,start_angle,timestamp.nsec,timestamp.sec", "7,1700000000"),
    ],
    ids=["protobuf", "json"],
)
def test_a_foxglove_scan_tells_its_last_bearing(names: str, time: str) -> None:
    rows = [f"0.3,laser,2.5,2.0,-Infinity,-0.1,{time}", f"0.3,laser,2.5,2.0,,-0.1,{time}"]
    got, _ = read(f"{HEAD},{names}\n" + "".join(f"{TIMES},{n},{row}\n" for n, row in enumerate(rows)))
    assert got.stamp_ns.tolist() == [STAMP + 7] * 2
    assert got.record_ns.tolist() == [STAMP + 30] * 2
    assert got.beams.tolist() == [3, 2]
    np.testing.assert_allclose(got.angle_min, -0.1, rtol=0, atol=1e-15)
    np.testing.assert_allclose(got.angle_increment, [0.2, 0.4], rtol=0, atol=1e-15)
    assert got.ranges[0].tolist() == [2.5, 2.0, -np.inf]
    assert got.frame_ids == ("laser",)


def test_times_may_be_numbers() -> None:
    """`--time-format` makes seconds or nanoseconds of them."""
    names = f"{HEAD},angle_increment,angle_min,ranges.0,ranges.1,ranges.2"
    for time in ("1700000000.000000030", "1700000000000000030"):
        got, _ = read(f"{names}\n{time},{time},0,0.1,0,1,2,3\n")
        assert got.stamp_ns.tolist() == got.record_ns.tolist() == [STAMP + 30]


def test_another_topic_than_a_scan_holds_none() -> None:
    with CsvLog(io.BytesIO(f"{HEAD},child_frame_id,header.frame_id,pose.x\n{TIMES},0,a,b,1\n".encode())) as log:
        assert (log.topics(), list(log.scans())) == ([], [])
    with pytest.raises(UnreadableError, match="without geometry"):
        CsvLog(io.BytesIO(f"{HEAD},ranges.0,ranges.1,ranges.2\n{TIMES},0,1,2,3\n".encode()))
