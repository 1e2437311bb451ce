"""What sweeps show of the habits of their driver is found, and nothing where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lidarcli.logs.clock import ClockInfo
from lidarcli.logs.habits import MAX_ROWS, Thinned
from lidarcli.logs.log_stats import LogStats
from lidarcli.logs.scan_checks import ScanChecks
from lidarcli.sweeps.findings import Finding
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, RawSweeps
from tests.sweeping import raw_sweeps

COUNT, BEAMS = 120, 360


def drive() -> RawSweeps:
    """A corridor that a sensor passes, with a door in it and 10 beams without a return at one side."""
    bearing = TURN / BEAMS * np.arange(BEAMS)
    wall = np.minimum(2.0 / np.maximum(np.abs(np.sin(bearing)), 1e-3), 8.0)
    ranges = wall + 1.5 * np.sin(np.arange(COUNT) / 9.0)[:, None] * np.cos(bearing)
    ranges[:, 40:50] = np.inf
    return raw_sweeps(ranges)


def findings(raw: RawSweeps, blocks: int = 3) -> dict[str, Finding]:
    """Identifier → what `info` finds in sweeps that come in so many blocks."""
    stats, checks = LogStats(), ScanChecks()
    for rows in np.array_split(np.arange(len(raw)), blocks):
        block = raw.rows(rows)
        batch = normalise(block, rows, RangeRules())
        checks.add(block, batch)
        stats.add(block, batch)
    clock: ClockInfo = checks.clock(raw.topic, raw.frame_ids[0])
    found = stats.findings(checks.sensor(raw.topic, raw.frame_ids[0]), clock, (), lacks_frame=False)
    return {each.id: each for each in found}


def test_a_sound_drive_has_no_habits() -> None:
    assert findings(drive()).keys() & {"intensity", "codes", "pace", "body"} == set()


@pytest.mark.parametrize("is_reversed", [False, True])
def test_intensities_in_reverse(is_reversed: bool) -> None:
    raw = drive()
    strength = np.where(np.isfinite(raw.ranges), np.float32(47.0), np.float32(0.0))
    found = findings(replace(raw, intensities=strength[:, ::-1].copy() if is_reversed else strength))
    assert ("intensity" in found) == is_reversed
    if is_reversed:
        assert found["intensity"].mend == "intensities"
        assert found["intensity"].evidence == {"unlike": pytest.approx(20 / BEAMS), "reversed": 0.0}


@pytest.mark.parametrize(("code", "found"), [(0.004, True), (0.03, False)])
def test_codes_for_ranges(code: float, found: bool) -> None:
    raw = drive()
    raw.ranges[:, 100] = code
    one = findings(replace(raw, range_min=np.zeros(COUNT, np.float32))).get("codes")
    assert (one is not None) == found
    if one is not None:
        assert one.evidence["share"] == pytest.approx(1 / BEAMS)
        assert str(one.as_dict()["fix"]["text"]).startswith("--range 0.02 ")


@pytest.mark.parametrize(("pace", "found"), [(1.0, False), (1.05, False), (3.0, True), (0.5, True)])
def test_the_pace_of_the_record(pace: float, found: bool) -> None:
    raw = drive()
    passed = raw.stamp_ns - raw.stamp_ns[0]
    one = findings(replace(raw, record_ns=raw.stamp_ns[0] + (passed / pace).astype(np.int64))).get("pace")
    assert (one is not None) == found
    assert one is None or one.evidence["pace"] == pytest.approx(pace)


def test_a_record_that_pauses_has_no_pace() -> None:
    raw = drive()
    late = raw.stamp_ns + np.where(np.arange(COUNT) > 60, 20_000_000_000, 0)
    assert "pace" not in findings(replace(raw, record_ns=late))


@pytest.mark.parametrize(("moves", "found"), [(True, True), (False, False)])
def test_hits_on_the_robot(moves: bool, found: bool) -> None:
    raw = drive() if moves else raw_sweeps(np.tile(drive().ranges[:1], (COUNT, 1)))
    raw.ranges[:, 200:212] = 0.18 + np.random.default_rng(1).normal(0.0, 0.004, (COUNT, 12))
    one = findings(raw).get("body")
    assert (one is not None) == found
    if one is not None:
        assert (one.level, one.evidence["beams"]) == ("hint", 12)
        assert one.evidence["nearest"] == pytest.approx(0.18, abs=0.01)


@pytest.mark.parametrize(
    ("time_increment", "scan_time", "level"), [(0.0, 1 / 30, "hint"), (0.0, 0.1, None), (2e-4, 1 / 30, "warning")]
)
def test_a_scan_time_alone_is_a_parameter(time_increment: float, scan_time: float, level: str | None) -> None:
    times = {"time_increment": time_increment, "scan_time": scan_time}
    raw = replace(drive(), **{name: np.full(COUNT, value, np.float32) for name, value in times.items()})
    found = findings(raw).get("gaps")
    assert (found and found.level) == level


def test_segments_take_all_of_the_time_to_the_next_one() -> None:
    """Sweeps that each begin where the last one ended, a twelfth of a turn in a twelfth of the time."""
    raw = drive().narrowed(30)
    begins = raw.angle_min + TURN / 12 * (np.arange(COUNT) % 12)
    increment = np.full(COUNT, float(np.diff(raw.stamp_ns[:2])[0]) * 1e-9 / 30, np.float32)
    raw = replace(raw, beams=np.full(COUNT, 30, np.int32), time_increment=increment)
    assert "rolling" in findings(raw)
    assert "rolling" not in findings(replace(raw, angle_min=begins))


def test_few_rows_of_many_are_kept() -> None:
    thinned = Thinned()
    for number in range(5 * MAX_ROWS):
        if thinned.takes():
            thinned.rows.append(number)
    assert thinned.rows == list(range(0, 5 * MAX_ROWS, thinned.stride))
    assert MAX_ROWS // 2 <= len(thinned.rows) <= MAX_ROWS
