"""Times as people write them."""

from __future__ import annotations

import time

import pytest

from lidarcli.display.texts import stamp, time_of_day, times_of_day
from lidarcli.errors import OptionError
from lidarcli.options.times import Instant, TimeOfDay, parse_time, parse_zone, window


@pytest.mark.parametrize(
    ("text", "seconds"), [("0", 0.0), ("12.5", 12.5), (" 12.5s ", 12.5), ("500 ms", 0.5), ("2min", 120.0), ("1.5H", 5400.0)]
)
def test_seconds_after_the_first_sweep(text: str, seconds: float) -> None:
    assert parse_time(text) == seconds


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("1970-01-01T00:00:01Z", 1_000_000_000),
        ("1970-01-01 00:00:01.000000001", 1_000_000_001),
        ("1970-01-01T01:00:00.5+01:00", 500_000_000),
        ("1970-01-02", 86_400_000_000_000),
        ("19700101T000001Z", 1_000_000_000),
        ("1700000000.123456789", 1_700_000_000_123_456_789),
        ("1969-12-31T23:59:59Z", -1_000_000_000),
        ("0001-01-01T00:00:00Z", -62_135_596_800_000_000_000),
        ("9999-12-31T23:59:59.999999999Z", 253_402_300_799_999_999_999),
    ],
)
def test_moments(text: str, ns: int) -> None:
    found = parse_time(text)
    assert found == Instant(ns)
    assert parse_time(str(found)) == found


@pytest.mark.parametrize(
    "text",
    [
        "",
        "soon",
        "12:60",
        "24:00",
        "12:3",
        "2026-11",
        "2026-13-01",
        "10 days",
        "1e400",
        "nan",
        "inf",
        "1e12",
        "2026-11-22T25:00Z",
    ],
)
def test_what_is_no_time_is_refused_with_a_way_out(text: str) -> None:
    with pytest.raises(OptionError, match=r"is no time: give seconds after the first sweep|is more than 1e\+09 seconds"):
        parse_time(text)


@pytest.mark.parametrize(
    ("text", "zone", "first", "moment"),
    [
        ("14:02", "UTC", "2026-11-22T10:00:00Z", "2026-11-22T14:02:00Z"),
        ("9:30:17.25", "UTC", "2026-11-22T10:00:00Z", "2026-11-23T09:30:17.25Z"),
        ("00:10", "UTC", "2026-12-31T23:50:00Z", "2027-01-01T00:10:00Z"),
        # Who writes 14:02 of a log that begins at 14:02:30 leaves out the seconds.
        ("14:02", "UTC", "2026-11-22T14:02:30Z", "2026-11-22T14:02:00Z"),
        ("14:02", "UTC", "2026-11-22T14:03:01Z", "2026-11-23T14:02:00Z"),
        ("14:02", "Europe/Berlin", "2026-07-01T10:00:00Z", "2026-07-01T12:02:00Z"),
        ("00:30", "+02:00", "2026-07-01T22:00:00Z", "2026-07-01T22:30:00Z"),
        ("14:02Z", "-03:30", "2026-07-01T10:00:00Z", "2026-07-01T14:02:00Z"),
        # On the day on which clocks are set back this hour comes twice.
        ("02:30", "Europe/Berlin", "2026-10-24T23:00:00Z", "2026-10-25T00:30:00Z"),
        ("02:30", "Europe/Berlin", "2026-10-25T01:00:00Z", "2026-10-25T01:30:00Z"),
        ("02:30", "Europe/Berlin", "2026-10-25T02:00:00Z", "2026-10-26T01:30:00Z"),
    ],
)
def test_a_time_of_day_is_the_first_one_in_the_log(text: str, zone: str, first: str, moment: str) -> None:
    found, begin = parse_time(text, parse_zone(zone)), parse_time(first)
    assert isinstance(found, TimeOfDay)
    assert isinstance(begin, Instant)
    assert str(found.after(begin.ns)) == moment


def test_a_clock_that_starts_near_zero_has_no_time_of_day() -> None:
    with pytest.raises(
        OptionError, match=r"^14:02:00: the clock of this log starts at 2\.5 s and has no time of day: give"
    ):
        window(parse_time("14:02"), None, 2_500_000_000)


def test_a_window_may_go_over_midnight() -> None:
    first = parse_time("2026-11-22T20:00:00Z")
    assert isinstance(first, Instant)
    found = window(parse_time("23:30"), parse_time("01:00"), first.ns)
    assert [*map(str, found)] == ["2026-11-22T23:30:00Z", "2026-11-23T01:00:00Z"]
    found = window(parse_time("2026-11-23T00:30Z"), parse_time("20:30"), first.ns)
    assert str(found[1]) == "2026-11-23T20:30:00Z"
    assert window(12.0, None, 0) == (12.0, None)


def test_a_moment_without_an_offset_is_meant_in_the_zone() -> None:
    assert str(parse_time("2026-07-01T14:02", parse_zone("Europe/Berlin"))) == "2026-07-01T12:02:00Z"
    assert str(parse_time("2026-07-01T14:02Z", parse_zone("Europe/Berlin"))) == "2026-07-01T14:02:00Z"


def test_the_zone_of_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "Asia/Kolkata")
    time.tzset()
    try:
        assert str(parse_time("2026-07-01T14:02", parse_zone("local"))) == "2026-07-01T08:32:00Z"
        assert time_of_day(1_700_000_000_000_000_000, parse_zone("local")) == "03:43:20.0"
    finally:
        monkeypatch.undo()
        time.tzset()


@pytest.mark.parametrize("text", ["", "Europa/Berlin", "Europe", "../UTC", "/etc/localtime", "+2", "+25:00", "14:02"])
def test_what_is_no_time_zone_is_refused_with_a_way_out(text: str) -> None:
    with pytest.raises(OptionError, match=r"is no time zone: give a name such as Europe/Berlin, an offset such as \+02:00"):
        parse_zone(text)


def test_times_are_shown_in_the_zone() -> None:
    ns, berlin = 1_700_000_000_123_456_789, parse_zone("Europe/Berlin")
    assert (stamp(ns), stamp(ns, berlin)) == ("2023-11-14T22:13:20.123Z", "2023-11-14T23:13:20.123+01:00")
    assert times_of_day([ns, ns + 3600 * 10**9], berlin) == (
        "time of day",
        ["2023-11-14 23:13:20.1", "2023-11-15 00:13:20.1"],
    )
