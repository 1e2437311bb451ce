"""Times as people write them."""

from __future__ import annotations

import pytest

from lidarcli.errors import OptionError
from lidarcli.options.times import Instant, parse_time


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
    "text", ["", "soon", "12:30", "2026-13-01", "10 days", "1e400", "nan", "inf", "1e12", "2026-11-22T25:00Z"]
)
def test_what_is_no_time_is_refused_with_a_way_out(text: str) -> None:
    with pytest.raises(OptionError, match=r"is no time: give seconds after the first sweep|is more than 1e\+09 seconds"):
        parse_time(text)
