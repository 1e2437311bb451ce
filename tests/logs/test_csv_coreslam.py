"""The logs that CoreSLAM and BreezySLAM are shown with, and tables that only look like them."""

from __future__ import annotations

import io

import numpy as np
import pytest

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import OpenOptions
from lidarcli.range_rules import RangeRules, normalise
from lidarcli.sweeps import Status, concatenate
from tests.logs.watched import CsvLog

STATE = "14710 29221 25178 0 0 0 170.1 9941 12750 8807 12749 475 255 0 0 255 0 0 178 61 126 255 0"
BEAMS = 682


def text_of(rows: int, state: str = STATE, end: str = " 0 \n", scale: float = 1) -> str:
    """A time [µs], 23 numbers of the robot, 682 ranges [mm], and one number more."""
    lines = []
    for row in range(rows):
        ranges = [f"{(1000 + row + beam) * scale:g}" for beam in range(BEAMS)]
        ranges[:3] = ["0", "7", "5200"] if scale == 1 else ranges[:3]
        lines.append(f"{212387282 + 100_000 * row} {state} {' '.join(ranges)}{end}")
    return "".join(lines)


@pytest.mark.parametrize("end", [" 0 \n", "\n", "\r\n"])
def test_ranges_of_a_urg_with_times_of_the_robot(end: str) -> None:
    with CsvLog(io.BytesIO(text_of(40, end=end).encode())) as log:
        got = concatenate(list(log.scans()))
    assert (log.format, log.report.damage) == ("csv (CoreSLAM)", [])
    assert got.beams.tolist() == [BEAMS] * 40
    assert got.stamp_ns[:2].tolist() == [212_387_282_000, 212_487_282_000]
    assert got.ranges[1, [3, -1]].tolist() == [np.float32(1.004), np.float32(1.682)]
    np.testing.assert_allclose(np.degrees(got.angle_increment[0]), 360 / 1024)
    # The middle of the view is ahead.
    np.testing.assert_allclose(got.angle_min + (BEAMS - 1) / 2 * got.angle_increment, 0.0, atol=1e-12)
    batch = normalise(got, np.arange(40), RangeRules())
    assert batch.status[0, :3].tolist() == [Status.NO_RETURN, Status.TOO_CLOSE, Status.VALID]


def test_a_table_of_that_width_alone_is_none() -> None:
    for text in (text_of(40, " ".join(["900"] * 23), end="\n"), text_of(40, scale=0.5)):
        with CsvLog(io.BytesIO(text.encode()), OpenOptions(fov=4.0)) as log:
            assert log.format == "csv (plain wide)"
    with pytest.raises(UnreadableError, match="without geometry"):
        CsvLog(io.BytesIO(text_of(40, scale=0.5).encode()))


def test_a_row_that_is_short_is_lost_alone() -> None:
    lines = text_of(20).splitlines()
    lines[5] = lines[5][:2000]
    with CsvLog(io.BytesIO(("\n".join(lines) + "\n").encode())) as log:
        assert sum(map(len, log.scans())) == 19
    assert [damage.place for damage in log.report.damage] == ["line 6"]
