"""CSV as people write it: lists as Python prints them, numbers of beams, units in names, columns without a value."""

from __future__ import annotations

import io

import numpy as np
import pytest

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import OpenOptions
from lidarcli.logs.open_options import parse_columns
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests.logs.watched import CsvLog

GIVEN = {"angle_min": -0.5, "angle_increment": 0.5}
SWEEPS = [[2.5, 2.0, 2.25], [2.5, 2.0, 1.25]]
GEOMETRY = "angle_min,angle_increment,range_max"


def read(text: str, columns: str = "", **options: float) -> tuple[RawSweeps, CsvLog]:
    names = parse_columns(columns) if columns else ()
    with CsvLog(io.BytesIO(text.encode()), OpenOptions(columns=names, **(options or GIVEN))) as log:  # type: ignore[arg-type]
        return concatenate(list(log.scans())), log


def refusal(text: str, columns: str = "") -> str:
    with pytest.raises(UnreadableError) as error:
        read(text, columns)
    return str(error.value).removeprefix("-: ")


def rows(form: str) -> str:
    """A line for each sweep: `t` its time, `a` to `c` its ranges."""
    return "".join(form.format(t=f"{k}.5", a=a, b=b, c=c) + "\n" for k, (a, b, c) in enumerate(SWEEPS))


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize(
    ("head", "form", "columns"),
    [
        ("", "[{a}, {b}, {c}]", "ranges"),
        ("", "({a}, {b}, {c})", "ranges"),
        ("", "[{a} {b} {c}]", "ranges"),
        ("", "array([{a}, {b}, {c}], dtype=float32)", "ranges"),
        ("", "{t},[{a}, {b}, {c}]", "time,ranges"),
        ("", "{t} [{a},{b},{c}]", "time,ranges"),
        ("", "{t};({a}, {b}, {c})", "time,ranges"),
        ("time,ranges\n", "{t},({a}, {b}, {c})", ""),
        ("time,ranges\n", "{t},array('f', [{a}, {b}, {c}])", ""),
        ("time,ranges\n", "{t},(np.float32({a}), np.float32({b}), np.float32({c}))", ""),
        ("time,ranges\n", "{t},{a} {b} {c}", ""),
        ("time,ranges\n", "{t},{a}|{b}|{c}", ""),
        ("time,ranges\n", '{t},"{a}, {b}, {c}"', ""),
        ("time,ranges,intensities\n", "{t},[{a}, {b}, {c}],[7, 8, 9]", ""),
        ("time,ranges,intensities\n", "{t},{a},{b},{c},7,8,9", ""),
        (f"header,time,{GEOMETRY},ranges\n", '"",{t},-0.5,0.5,8,[{a}, {b}, {c}]', ""),
        (f"time,{GEOMETRY},ranges\n", "{t},-0.5,0.5,8,{a},{b},{c}", ""),
        ("", "b'{t},{a},{b},{c}\\r\\n'", "time,ranges"),
        ("b'time,r0,r1,r2'\n", 'b"{t},{a},{b},{c}"', ""),
        ("time,r0_mm,r1_mm,r2_mm,note\n", "{t},{a}e3,{b}e3,{c}e3,x", ""),
        ("sec,usec,ranges_cm[0],ranges_cm[1],ranges_cm[2]\n", "{t:.1},500000,{a}e2,{b}e2,{c}e2", ""),
        ("stamp,time,ranges_mm\n", ",{t},[{a}e3,{b}e3,{c}e3]", ""),
    ],
)
def test_a_sweep_in_a_row(head: str, form: str, columns: str, end: str) -> None:
    got, log = read((head + rows(form)).replace("\n", end), columns)
    assert got.ranges.tolist() == SWEEPS
    assert (got.angle_min.tolist(), got.angle_increment.tolist()) == ([-0.5] * 2, [0.5] * 2)
    assert got.stamp_ns.tolist() == ([500_000_000, 1_500_000_000] if "{t" in form else [0, 0])
    assert (log.report.damage, log.report.unread, "passed over" in log.report.notes[0]) == ([], {}, "note" in head)
    if "intensities" in head:
        assert got.intensities is not None
        assert got.intensities.tolist() == [[7, 8, 9]] * 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (rows("[{a}, {b}, {c}]"), "a table of 1 columns without names, such as '[2.5, 2.0, 2.25]': name them, for example "
         "--columns ranges with"),
        (rows("{t},({a}, {b}, {c})"), "a table of 2 columns without names, such as '0.5,(2.5, 2.0, 2.25)': name them, for "
         "example --columns time,ranges with"),
        ("header,time,ranges\n" + rows("{t},[{a}, {b}, {c}]"), "2 cells where the first line has 3 names, such as"),
        ("time,ranges,intensities\n" + rows("{t},{a},{b},{c},7,8"), "the first line time,ranges,intensities names 1 and"),
        ("".join(f"{k},20\n" + "".join(f"{n},2.5\n" for n in range(20)) for k in range(3)), "a table of 2 columns"),
        ("beam,range\n0,20\n" + "".join(f"{n},2.5\n" for n in range(20)), "lines such as '0,20' are no beams, but heads"),
        ("timestamp,x,y\n1.5,2.0,0.5\n", "columns x and y are points or poses, not beams: "),
        (rows("{t}," + ",".join(f"{20 * k}.1,{{b}},47" for k in range(12))), "rows such as '0.5,0.1,2.0,47,20.1,2.0,47,"),
        ("time,beam,range\n1,0,2.5\n1,1,2.5\n", ""),
    ],
)  # fmt: skip
def test_what_leads_on(text: str, message: str) -> None:
    if message:
        assert refusal(text).startswith(message)
    else:
        with pytest.raises(UnreadableError, match="without geometry: give --angle-min and"):
            CsvLog(io.BytesIO(text.encode()))


BEAMS = [(k, n, r) for k, ranges in enumerate(SWEEPS) for n, r in enumerate(ranges)]


@pytest.mark.parametrize(
    ("head", "form", "columns"),
    [
        ("sweep,beam,range\n", "{k},{n},{r}", ""),
        ("time,index,ring,dist_mm\n", "{k},{n},,{r}e3", ""),
        ("sweep,angle,beam_id,dist_cm\n", "{k},,{m},{r}e2", ""),
        ("", "{n},{r}", "beam,range"),
        ("", "{m} {r} 47", "beam,range,quality"),
    ],
)
def test_beams_by_their_numbers(head: str, form: str, columns: str) -> None:
    text = head + "".join(form.format(k=k, n=n, m=n + 44, r=r) + "\n" for k, n, r in BEAMS)
    for options in (GIVEN, {"angle_min": -0.5, "fov": 1.0}):
        got, log = read(text, columns, **options)
        assert got.ranges.tolist() == SWEEPS
        np.testing.assert_allclose([got.angle_min, got.angle_increment], [[-0.5] * 2, [0.5] * 2], atol=1e-12)
        assert log.report.damage == []
    # The second sweep lacks its first beam.
    lacking, _ = read(text.replace("\n1,0,2.5\n", "\n"), columns, **GIVEN)
    assert lacking.angle_min.tolist() == ([-0.5, 0.0] if head.startswith("sweep,beam") else [-0.5, -0.5])


@pytest.mark.parametrize(
    ("columns", "form", "cut"),
    [("angle,range", "{n}.5,{r}", 0), ("beam,range", "{n},{r}", 0), ("sweep,angle,range", "{k},{n}.5,{r}", 1)],
)
def test_who_stops_within_a_turn_loses_nothing(columns: str, form: str, cut: int) -> None:
    lines = [form.format(k=k, n=n, r=n + 1.25) for k in range(4) for n in range(20)][:-13]
    given = {"angle_min": -0.5, "angle_increment": 0.1}
    got, log = read("\n".join([*lines, ""]), columns, **given)
    assert (got.beams.tolist(), log.report.damage) == ([20, 20, 20, 7], [])
    # Within a line it is the end of a file that is cut.
    got, log = read("\n".join(lines)[:-4], columns, **given)
    assert (got.beams.tolist(), len(log.report.damage)) == ([20, 20, 20, 6][: 4 - cut], 1)


@pytest.mark.parametrize(("last", "beams"), [(0.5, 3), (1.0, 3), (0.0, 3)])
def test_cells_beyond_the_last_beam(last: float, beams: int) -> None:
    """bagpy has always as many columns; angle_max is right, a step past the last beam, or one short of it."""
    names = ",".join(
        ["Time", "header.seq", "angle_min", "angle_max", "angle_increment", *(f"ranges_{k}" for k in range(9))]
    )
    got, _ = read(names + "\n" + rows(f"{{t}},0,-0.5,{last},0.5,{{a}},{{b}},{{c}}" + "," * 6))
    assert (got.ranges[:, :3].tolist(), got.beams.tolist()) == (SWEEPS, [beams] * 2)
    got, _ = read(names + "\n" + rows(f"{{t}},0,-0.5,{last},0.5,{{a}},,{{c}}" + "," * 6))
    assert got.beams.tolist() == [beams] * 2


def test_columns_without_a_value_are_not_there() -> None:
    """`header` and `stamp` of bag2csv.py are always empty; so may be the time, the frame, or the limits."""
    head = "time,rosbagTimestamp,header,seq,stamp,secs,nsecs,frame_id,angle_min,angle_increment,range_max,ranges\n"
    got, log = read(head + ',1500000000,"",0,"",1,5,"""laser""",-0.5,0.5,,"[2.5, 2.0]"\n' * 3, fov=1.0)
    assert (log.report.unread, got.frame_ids, got.range_max[0]) == ({}, ("laser",), np.inf)
    assert (got.stamp_ns[0], got.record_ns[0]) == (1_000_000_005, 1_500_000_000 * 10**9)
    assert "passed over" not in log.report.notes[0]
    each = [f"/{topic}/{name}" for topic in "ab" for name in ("ranges[0]", "ranges[1]", "ranges[2]", "header/stamp")]
    got, log = read(",".join(["__time", *each]) + "\n" + "1.5,2,2,2,1.25,,,,\n" * 3, **GIVEN)
    assert (got.stamp_ns[0], log.report.unread) == (1_250_000_000, {})


def test_columns_that_are_passed_over_are_named() -> None:
    text = "when_us,angle_deg,dist_mm,hit,quality\n" + "".join(f"5,{n},{r},1,47\n" for _, n, r in BEAMS)
    _, log = read(text)
    said = "CSV layout: one file per sweep; ranges are millimetres; columns passed over: when_us, hit, quality"
    assert str(log.report.notes[0]).endswith("columns passed over: when_us, hit, quality")
    assert said.split("; ")[1] in log.report.notes[0]
