"""Times of text as people, spreadsheets and loggers write them."""

from __future__ import annotations

import numpy as np
import pytest

from lidarcli.logs.cells import DAYS, MINUTES, TIME_OF_DAY, going_on, time_notes, time_unit, to_ns
from lidarcli.options.times import Instant

NOON = "2026-11-26T13:05:10"


@pytest.mark.parametrize(
    ("text", "moment"),
    [
        ("13:05:10.1", "1970-01-01T13:05:10.1Z"),
        ("1:05:10,25 PM", "1970-01-01T13:05:10.25Z"),
        ("12:05:10 am", "1970-01-01T00:05:10Z"),
        ("13:05:10:123", "1970-01-01T13:05:10.123Z"),
        ("0:00:01.5", "1970-01-01T00:00:01.5Z"),
        ("1 day, 0:00:01.5", "1970-01-02T00:00:01.5Z"),
        ("1 days 00:00:01.500000", "1970-01-02T00:00:01.5Z"),
        ("5:10.1", "1970-01-01T00:05:10.1Z"),
        ("26.11.2026 13:05:10.1", f"{NOON}.1Z"),
        ("26/11/2026 13:05:10", f"{NOON}Z"),
        ("11/26/2026 01:05:10.1 PM", f"{NOON}.1Z"),
        ("11/26/26 1:05 PM", "2026-11-26T13:05:00Z"),
        ("26-Nov-2026 13:05:10.1", f"{NOON}.1Z"),
        ("26. Dez 2026 13:05:10", "2026-12-26T13:05:10Z"),
        ("Nov 26, 2026 1:05:10 p.m.", f"{NOON}Z"),
        ("Thu, 26 Nov 2026 13:05:10 GMT", f"{NOON}Z"),
        ("26.11.2026 14:05:10+01:00", f"{NOON}Z"),
        ("20261126T130510.25", f"{NOON}.25Z"),
        ("20261126130510", f"{NOON}Z"),
        ("20261126_130510_123", f"{NOON}.123Z"),
        ("2026-11-26 01:05:10.5 PM", f"{NOON}.5Z"),
    ],
)
def test_spellings(text: str, moment: str) -> None:
    unit = time_unit("time", [text.encode()])
    assert unit is not None
    times, bad = to_ns([text.encode()], unit)
    assert (str(Instant(int(times[0]))), bad.any()) == (moment, False)


@pytest.mark.parametrize(
    "text", ["noon", "13:05:10 CET", "32.13.2026 13:05", "5:10", "26-Foo-2026", "2026-13-45", "20261345130510x", "", "may"]
)
def test_what_is_not_understood_has_no_unit(text: str) -> None:
    assert time_unit("time", [text.encode()]) is None


@pytest.mark.parametrize(
    ("dates", "days", "note"),
    [
        # The day and the month, where one of them is above 12; else what goes on by small steps.
        (["11/26/2026 0:00:01", "11/26/2026 0:00:02"], "2026-11-26", "month, day, year"),
        (["01/02/2026 23:59:59", "02/02/2026 00:00:00"], "2026-02-01", "day, month, year"),
        (["01.02.2026 10:00:00", "01.02.2026 10:00:01"], "2026-02-01", "day, month, year"),
        (["01/02/2026 10:00:00", "01/02/2026 10:00:01"], "2026-01-02", "month, day, year"),
    ],
)
def test_the_order_of_day_and_month(dates: list[str], days: str, note: str) -> None:
    cells = [text.encode() for text in dates]
    unit = time_unit("time", cells)
    assert unit is not None
    times, _ = to_ns(cells, unit)
    assert str(Instant(int(times[0])))[:10] == days
    assert np.diff(times).tolist() == [10**9]
    assert f"dates are read as {note}" in time_notes([unit])


@pytest.mark.parametrize("first", [46352, 740312])
def test_days_of_spreadsheets_and_of_matlab(first: int) -> None:
    cells = [f"{first + (13.5 * 3600 + row / 10) / 86400:.11f}".encode() for row in range(9)]
    assert time_unit("time", cells) == DAYS
    times, _ = to_ns(cells, DAYS)
    assert str(Instant(int(times[0])))[:13] == "2026-11-26T13"
    np.testing.assert_allclose(np.diff(times), 1e8, atol=2e6)
    # Seconds of a clock that has run for half a day are none.
    assert time_unit("time", [f"{first + row / 10:.3f}".encode() for row in range(9)]) == 10**9


def test_a_clock_without_a_date_goes_on() -> None:
    texts = ["23:59:59.8", "23:59:59.9", "0:00:00.1", "23:59:59.95", "0:00:00.2"]
    times, _ = to_ns([text.encode() for text in texts], TIME_OF_DAY)
    whole, _ = going_on(times, TIME_OF_DAY, None)
    assert ((whole - times[0]) / 1e9).round(3).tolist() == [0.0, 0.1, 0.3, 0.15, 0.4]
    first, last = going_on(times[:2], TIME_OF_DAY, None)
    second, _ = going_on(times[2:], TIME_OF_DAY, last)
    assert [*first, *second] == whole.tolist()
    hours, _ = to_ns([b"59:59.9", b"0:00.1"], MINUTES)
    assert np.diff(going_on(hours, MINUTES, None)[0]).tolist() == [200_000_000]
    # A pause within a day is one.
    pause = np.array([1, 20]) * 3600 * 10**9
    assert going_on(pause, TIME_OF_DAY, None)[0].tolist() == pause.tolist()
