"""CSV logs: every layout and every spelling reads back what was written, and nothing but errors of our own is raised."""

from __future__ import annotations

import gzip
import io
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.logs.base import LASERSCAN, Damage, OpenOptions, ReadReport, Topic
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.cells import shown
from lidarcli.logs.csv import CsvLog as AnyCsvLog
from lidarcli.logs.open_options import parse_columns
from lidarcli.options.choices import UNITS
from lidarcli.sweeps.types import RawSweeps, concatenate
from tests.logs.csv_sweeps import FIRST, START, STEP, sweeps
from tests.logs.watched import CsvLog
from tests.text_logs import LAYOUTS, write_csv

GEOMETRY = OpenOptions(angle_min=FIRST, angle_increment=STEP)
NAMED = replace(GEOMETRY, columns=("time", "ranges"))
NO_FRAME = ("plotjuggler", "wide", "drow", "long", "per-sweep")
OWN_RECORD = ("rostopic", "plotjuggler", "bagpy", "mcap", "list")
ROS2 = "1,5,laser,-0.5,0.5,0.5,0.0,0.1,0.1,8.0,"


def read(source: object, options: OpenOptions = GEOMETRY) -> tuple[RawSweeps, CsvLog]:
    """All sweeps of a log as one block."""
    with CsvLog(source, options) as log:  # type: ignore[arg-type]
        return concatenate(list(log.scans())), log


def read_text(text: str | bytes, options: OpenOptions = GEOMETRY) -> tuple[RawSweeps, CsvLog]:
    return read(io.BytesIO(text.encode() if isinstance(text, str) else text), options)


def opening(layout: str) -> OpenOptions:
    """What has to be told of a layout: its geometry, and of one without a header the names of its columns."""
    return replace(GEOMETRY, columns=("seq", "time", "ranges") if layout == "drow" else ())


def rows_of(raw: RawSweeps) -> list[list[float]]:
    return [row[:beams].tolist() for row, beams in zip(raw.ranges, raw.beams.tolist(), strict=True)]


def same_ranges(got: RawSweeps, want: RawSweeps) -> None:
    np.testing.assert_array_equal(got.beams, want.beams)
    for a, b, beams in zip(got.ranges, want.ranges, want.beams.tolist(), strict=True):
        np.testing.assert_array_equal(a[:beams].view(np.int32), b[:beams].view(np.int32))


def text_of(layout: str, tmp_path: Path, raw: RawSweeps | None = None) -> bytes:
    path = tmp_path / f"{layout}.csv"
    write_csv(path, [sweeps() if raw is None else raw], layout)
    return path.read_bytes()


@pytest.mark.parametrize("ragged", [False, True])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout_reads_back(layout: str, ragged: bool, tmp_path: Path) -> None:
    want = sweeps(ragged=ragged)
    path = tmp_path / ("run" if layout == "per-sweep" else "run.csv")
    write_csv(path, [want.rows(slice(0, 15)), want.rows(slice(15, None))], layout)
    got, log = read(path, opening(layout))
    same_ranges(got, want)
    np.testing.assert_array_equal(got.stamp_ns, want.stamp_ns)
    np.testing.assert_array_equal(got.record_ns, want.record_ns if layout in OWN_RECORD else want.stamp_ns)
    np.testing.assert_array_equal(got.angle_min, want.angle_min)
    np.testing.assert_array_equal(got.angle_increment, want.angle_increment)
    if layout not in NO_FRAME:
        assert got.frame_ids == ("laser",)
        np.testing.assert_array_equal(got.range_max, want.range_max)
        np.testing.assert_array_equal(got.range_min, want.range_min)
    else:
        assert got.frame_ids == ("",)
    assert log.topics() == [Topic("/scan", LASERSCAN, "csv")]
    assert (log.report.damage, log.report.refused.total()) == ([], 0)
    sizes = [file.stat().st_size for file in ([path] if path.is_file() else path.iterdir())]
    assert log.size == log.position == sum(sizes)


def test_plotjuggler_keeps_topics_apart(tmp_path: Path) -> None:
    front, rear = sweeps(6, 9, topic="/front/scan"), sweeps(5, 7, topic="/rear/scan")
    path = tmp_path / "both.csv"
    write_csv(path, [front, rear], "plotjuggler")
    with CsvLog(path) as log:
        assert [topic.name for topic in log.topics() or []] == ["/front/scan", "/rear/scan"]
        same_ranges(concatenate(list(log.scans(["/rear/scan"]))), rear)
        same_ranges(concatenate(list(log.scans(["/front/scan"]))), front)
        assert list(log.scans(["/scan"])) == []
        assert log.report.damage == []
    with pytest.raises(OptionError):
        write_csv(tmp_path / "no.csv", [front, rear], "bagpy")


def test_one_range_column_with_lists_as_people_write_them() -> None:
    cells = [
        '"[1.0, inf, nan]"',
        "\"array('f', [1.0, inf, nan])\"",
        '"[1.   inf nan]"',
        '"[1.0\n  inf\n  nan]"',
        '"[np.float32(1.0), np.float32(inf), np.float32(nan)]"',
        '"[1.0, Infinity, None]"',
        '"[1.0, .inf, .nan]"',
        '"array([1., inf, nan], dtype=float32)"',
        "[1.0, inf, nan]",
    ]
    head = "timestamp,frame_id,angle_min,angle_increment,range_max,ranges,intensities\n"
    text = head + "".join(f"{i}.25,base,-0.5,0.5,8.0,{cell},[]\n" for i, cell in enumerate(cells))
    got, log = read_text(text, OpenOptions())
    np.testing.assert_array_equal(got.ranges, np.tile(np.array([1, np.inf, np.nan], np.float32), (9, 1)))
    assert got.stamp_ns.tolist() == [i * 10**9 + 250_000_000 for i in range(9)]
    assert (got.frame_ids, log.report.damage) == (("base",), [])
    got, _ = read_text('t,angle_min,angle_increment,ranges\n1,0.0,0.1,"(1.0, 2.0,)"\n2,0.0,0.1,"()"\n')
    assert rows_of(got) == [[1.0, 2.0], []]


@pytest.mark.parametrize(
    "header",
    [
        "{'stamp': {'secs': 5, 'nsecs': 6}, 'frame_id': 'base'}",
        '{""stamp"": {""sec"": 5, ""nanosec"": 6}, ""frame_id"": ""base""}',
        "std_msgs.msg.Header(stamp=builtin_interfaces.msg.Time(sec=5, nanosec=6), frame_id='base')",
        'seq: 12\nstamp:\n  secs: 5\n  nsecs: 6\nframe_id: ""base""',
    ],
    ids=["dict", "json", "repr", "yaml"],
)
def test_printed_headers(header: str) -> None:
    row = f'"{header}",0.0,0.1,"array(\'f\', [1.0, 2.0])"\n'
    got, log = read_text("header,angle_min,angle_increment,ranges\n" + row * 3, OpenOptions())
    assert (rows_of(got), got.frame_ids) == ([[1.0, 2.0]] * 3, ("base",))
    assert got.stamp_ns.tolist() == got.record_ns.tolist() == [5_000_000_006] * 3
    assert log.report.damage == []


def test_fractions_that_are_counts_of_nanoseconds() -> None:
    times = ["7.945000000", "8.45000000", "8.145000000", "8.999999999"]
    got, log = read_text("time,r0,r1,r2\n" + "".join(f"{time},1,2,3\n" for time in times))
    assert got.stamp_ns.tolist() == [7_945_000_000, 8_045_000_000, 8_145_000_000, 8_999_999_999]
    assert "behind the point of times stand nanoseconds without leading zeros" in log.report.notes[0]


def test_list_damage_is_named_and_passed_over() -> None:
    good = "1.0,\"{'stamp': {'sec': 3, 'nanosec': 4}, 'frame_id': 'a'}\",0.0,0.1,\"[1.0, 2.0]\"\n"
    text = "time,header,angle_min,angle_increment,ranges\n" + good + '2.0,"{}",0.0,0.1,"[1.0, 2\n' + good
    text += "garbage\n" + good.replace("2.0]", "x]") + good + good[:-9]
    got, log = read_text(text, OpenOptions())
    assert rows_of(got) == [[1.0, 2.0]] * 3
    assert (got.stamp_ns.tolist(), got.frame_ids) == ([3_000_000_004] * 3, ("a",))
    assert got.record_ns.tolist() == [10**9] * 3
    assert log.report.damage == [
        Damage("line 3", "a quote without its end: the record is dropped"),
        Damage("line 5", "not a whole record: it is dropped"),
        Damage("line 6", "'x' is not a number"),
        Damage("line 8", "the file ends within this record"),
    ]


@pytest.mark.parametrize(
    ("times", "stamps"),
    [
        (["1714555596.445048407", "1714555596.545"], [1714555596445048407, 1714555596545000000]),
        (["1714555596445048407", "1714555596545048408"], [1714555596445048407, 1714555596545048408]),
        (["1714555596445", "1714555596545"], [1714555596445000000, 1714555596545000000]),
        (["1714555596445048", "1714555596545048"], [1714555596445048000, 1714555596545048000]),
        (["1.714555596445048407e9", "1.7145555965e+09"], [1714555596445048407, 1714555596500000000]),
        (["2024-05-01T09:26:36.445048407Z", "2024-05-01 11:26:36,5+02:00"], [START, START + 54951593]),
        (["2024/05/01 09:26:36", "2024/05/01 09:26:37.25"], [1714555596000000000, 1714555597250000000]),
        (["0.0", "0.1000000005"], [0, 100000000]),
        (["-1.5", "2"], [-1500000000, 2000000000]),
    ],
)
def test_times_are_exact(times: list[str], stamps: list[int]) -> None:
    got, log = read_text(f"time;r0;r1;r2\n{times[0]};1;2;3\n{times[1]};1;2;4\n")
    assert got.stamp_ns.tolist() == got.record_ns.tolist() == stamps
    assert log.report.damage == []


@pytest.mark.parametrize(
    ("columns", "text", "stamps", "ranges"),
    [
        ("sec,nsec,ranges", "1714555596,445048407,1,2,3\n1714555597,5,1,2,4\n", [START, 1714555597000000005], 3),
        ("seq,time,ranges", "7,100.5,1,2,3\n8,100.6,1,2,4\n", [100_500_000_000, 100_600_000_000], 3),
        ("date,time,ranges", "2026-11-26,23:59:59.9,1,2,3\n2026-11-27,00:00:00.0,1,2,4\n", [-100_000_000, 0], 3),
        ("ranges", "1,2,3\n1,2,4\n", [0, 0], 3),
        ("time_us,state*2,ranges*3,more", "500000,-1,-2,1,2,3,0\n600000,-1,-2,1,2,4,0\n", [500_000_000, 600_000_000], 3),
        ("time,ranges,intensities", "1,1,2,3,7,8,9\n2,1,2,4,7,8,9\n", [10**9, 2 * 10**9], 3),
        ("time,r0,r1,r2", "Zeit,Abstand,b,c\n1,1,2,3\n2,1,2,4\n", [10**9, 2 * 10**9], 3),
        ("time,ranges", '1,"[1, 2, 3]"\n2,"[1, 2, 4]"\n', [10**9, 2 * 10**9], 3),
        ("sweep,angle,range", "0,0,1\n0,1,2\n0,2,3\n1,0,1\n1,1,2\n1,2,4\n", [0, 0], 3),
        ("time,angle,range,quality", "1,0,1,9\n1,1,2,8\n1,2,3,9\n2,0,1,9\n2,1,2,9\n2,2,4,9\n", [10**9, 2 * 10**9], 3),
    ],
)
def test_columns_that_the_user_names(columns: str, text: str, stamps: list[int], ranges: int) -> None:
    got, log = read_text(text, replace(GEOMETRY, columns=parse_columns(columns)))
    zero = 1795737600000000000 if columns.startswith("date") else 0
    assert (got.stamp_ns - zero).tolist() == stamps
    assert rows_of(got) == [[1, 2, 3], [1, 2, 4]]
    assert log.report.damage == []
    if "intensities" in columns:
        assert got.intensities is not None
        assert got.intensities.tolist() == [[7, 8, 9]] * 2


def test_bearings_that_run_clockwise() -> None:
    text = "".join(f"15 {angle} {1000 + angle}\n" for _ in range(3) for angle in range(0, 360, 9))
    got, _ = read_text(text, OpenOptions(range_scale=0.001, columns=("quality", "clockwise", "range")))
    np.testing.assert_allclose(np.degrees(got.angle_increment), [-9.0] * 3, rtol=0, atol=1e-12)
    np.testing.assert_allclose(got.angle_min, [0.0] * 3, rtol=0, atol=1e-12)
    assert got.ranges[2, :2].tolist() == [1.0, np.float32(1.009)]


@pytest.mark.parametrize("columns", ["time,r*3", "time,a,b,c,d,ranges", "ranges,intensities", "time,ranges*3"])
def test_names_that_do_not_fit_the_columns(columns: str) -> None:
    with pytest.raises(UnreadableError, match=r"^-: --columns .* names .* columns, and rows have 5, such as '1,2,3,4,5'$"):
        read_text("1,2,3,4,5\n2,2,3,4,5\n", replace(GEOMETRY, columns=parse_columns(columns)))


@pytest.mark.parametrize("columns", ["time,,ranges", "r*0", "r*x", "time,ranges,ranges", "r*999999999"])
def test_names_without_a_meaning(columns: str) -> None:
    with pytest.raises(OptionError, match=r"^--columns: "):
        parse_columns(columns)


def turns(form: str, unit: float = 1.0, scale: float = 1.0) -> str:
    """Three turns of a sensor, one beam per row."""
    beams = [(turn, angle * unit, (2 + angle / 1000) * scale) for turn in range(3) for angle in range(0, 360, 3)]
    return "".join(form.format(turn=turn, angle=angle, range=far) + "\n" for turn, angle, far in beams)


@pytest.mark.parametrize(
    ("text", "columns"),
    [
        ("1.5,5,6,7,8,5,6,7,8\n2.5,5,6,7,8,5,6,7,9\n", "time,ranges"),
        ("7,1.5,5,6,7,8,5,6,7,8\n8,1.6,5,6,7,8,5,6,7,9\n", "seq,time,ranges"),
        ("1714555596,445048407,1,2,3,4,5,6\n1714555597,5,1,2,3,4,5,6\n", "sec,nsec,ranges"),
        ("2026-11-26,23:59:59.9,1,2,3,4,5,6\n2026-11-27,00:00:00.1,1,2,3,4,5,6\n", "date,time,ranges"),
        ("6,5,6,7,8,5,6,7,8\n5,5,6,7,8,5,6,7,9\n", "ranges"),
        ("1.5 500 600 700 800 500 600 700\n2.5 500 600 700 800 500 600 700\n", "time,ranges --range-unit mm"),
        ("0.1,2\n0.2,3\n", "angle,range"),
        (turns("{turn},{angle},{range}"), "sweep,angle,range"),
        (turns("{angle},{range},47", np.pi / 180), "angle,range,quality"),
        (turns("47 {angle} {range:.1f}", scale=1000), "quality,angle,range --range-unit mm"),
        (turns("{angle},{range},1,2,3,4,5,6,7,8"), "angle,range,other*8"),
    ],
)
def test_a_table_without_names_is_refused_and_read_with_names(text: str, columns: str) -> None:
    with pytest.raises(UnreadableError) as error:
        read_text(text, OpenOptions())
    assert f"columns without names, such as {shown(text.splitlines()[0].encode(), 60)}: name them" in str(error.value)
    assert "--columns time,ranges" in str(error.value)
    assert "--columns angle,range" in str(error.value)
    names, _, unit = columns.partition(" --range-unit ")
    got, log = read_text(text, replace(GEOMETRY, range_scale=UNITS[unit or "m"], columns=parse_columns(names)))
    assert (len(got) > 0, log.report.damage) == (True, [])
    assert np.nanmedian(got.ranges) < 10


def test_missing_cells_and_words() -> None:
    got, log = read_text("time,r0,r1,r2,r3,r4,r5\n1,,null,None,NaN,-inf,+Infinity\n2, 1.5 ,.inf,-.inf,1.#INF,--,1e3\n")
    nan, inf = np.nan, np.inf
    want = np.array([[nan, nan, nan, nan, -inf, inf], [1.5, inf, -inf, inf, nan, 1000]], np.float32)
    np.testing.assert_array_equal(got.ranges, want)
    assert log.report.damage == []


def test_short_rows_are_sweeps_of_fewer_beams() -> None:
    text = "1.0,5,6,7,8,5,6,7,8\n2.0,5,6\n3.0,5,6,7,8,5,6,7,8,9\n"
    got, log = read_text(text, OpenOptions(fov=np.pi, columns=("time", "ranges")))
    assert rows_of(got) == [[5, 6, 7, 8, 5, 6, 7, 8], [5, 6], [5, 6, 7, 8, 5, 6, 7, 8, 9]]
    np.testing.assert_array_equal(got.angle_increment, np.pi / np.array([7, 1, 8]))
    np.testing.assert_array_equal(got.angle_min, np.full(3, -np.pi / 2))
    assert log.report.damage == []


@pytest.mark.parametrize("head", ["time,r0,r1,r2,r3,r4,r5,r6,r7\n", ""], ids=["names", "none"])
@pytest.mark.parametrize("place", [0, 3])
def test_rows_that_are_not_as_long_as_the_others_are_damage(head: str, place: int) -> None:
    """Nothing in such a row tells its view: which beam is missing, or too many, nobody knows."""
    rows = [f"{at}.5,5,6,7,8,5,6,7,8" for at in range(10)]
    rows[place] += ",9"
    rows[place + 1] = rows[place + 1].removesuffix(",8")
    options = OpenOptions(fov=np.pi, columns=() if head else ("time", "ranges"))
    got, log = read_text(head + "".join(f"{row}\n" for row in rows), options)
    assert rows_of(got) == [[5, 6, 7, 8, 5, 6, 7, 8]] * 8
    first = place + 1 + bool(head)
    assert log.report.damage == [
        Damage(f"line {line}", f"{cells} cells where 9 are usual: the row is dropped")
        for line, cells in ((first + 1, 8), (first, 10))
    ]


def test_ros2_counts_ranges_by_the_view() -> None:
    text = f"{ROS2}1,2,3\n{ROS2}1,2\n{ROS2}1,2,3,4\n{ROS2}1,2,3,9,9,9\n{ROS2}1,2,3,\n{ROS2}1,2,9,9\n{ROS2}1,2,3,4,5\n"
    got, log = read_text(text, OpenOptions())
    assert rows_of(got) == [[1, 2, 3], [1, 2], [1, 2, 3, 4], [1, 2, 3], [1, 2, 3], [1, 2, 9, 9]]
    assert got.stamp_ns.tolist() == [1_000_000_005] * 6
    assert log.report.damage == [Damage("line 7", "15 cells where 13 are usual: the row is dropped")]


def test_abbreviated_arrays_are_explained() -> None:
    with pytest.raises(UnreadableError) as error:
        CsvLog(io.BytesIO(f"{ROS2}1,2,...\n".encode()))
    assert str(error.value) == (
        "-: CSV (ros2 topic echo --csv): the arrays are abbreviated ('...'):"
        " record again with `ros2 topic echo --csv --full-length`"
    )


def test_trailing_empty_cells_are_no_beams_where_the_view_says_so() -> None:
    text = "Time,header.seq,angle_min,angle_max,angle_increment,ranges_0,ranges_1,ranges_2,ranges_3\n"
    got, _ = read_text(text + "1,0,0,0.3,0.1,5,6,7,\n2,1,0,0.2,0.1,5,6,,\n3,2,0,0.1,0.1,5,6,,\n")
    assert got.beams.tolist() == [4, 3, 2]


@pytest.mark.parametrize(
    ("options", "first", "step"),
    [
        (OpenOptions(angle_min=-1.0, angle_increment=-0.5), -1.0, -0.5),
        (OpenOptions(fov=3.5), -1.75, 0.5),
        (OpenOptions(fov=2 * np.pi), -np.pi, np.pi / 4),
        (OpenOptions(fov=3.5, angle_min=0.0), 0.0, 0.5),
    ],
)
def test_given_geometry(options: OpenOptions, first: float, step: float) -> None:
    got, _ = read_text(
        "time,ranges0,ranges1,ranges2,ranges3,ranges4,ranges5,ranges6,ranges7\n1.0,5,6,7,8,5,6,7,8\n", options
    )
    assert (got.angle_min[0], got.angle_increment[0], got.range_max[0]) == (first, step, np.inf)


@pytest.mark.parametrize("options", [OpenOptions(), OpenOptions(angle_min=0.0), OpenOptions(angle_increment=0.1)])
def test_missing_geometry_names_the_options(options: OpenOptions, tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_text("time,r0,r1,r2\n1,2,3,4\n")
    with pytest.raises(UnreadableError) as error:
        CsvLog(path, options)
    assert str(error.value) == (
        f"{path}: CSV (plain wide) without geometry: give --angle-min and --angle-increment, or --fov"
        " (radians, or degrees with --degrees)"
    )


def test_long_form_in_any_order_of_columns_and_in_degrees() -> None:
    rows = [(s, a, s + 0.5 + a / 100) for s in range(3) for a in range(-90, 91, 30)]
    text = "distance\tbearing_deg\ttimestamp\n" + "".join(f"{r}\t{a}\t{s}.25\n" for s, a, r in rows)
    got, log = read_text(text, OpenOptions())
    np.testing.assert_array_equal(got.ranges.ravel(), np.array([r for *_, r in rows], np.float32))
    np.testing.assert_allclose(got.angle_min, np.full(3, -np.pi / 2))
    np.testing.assert_allclose(got.angle_increment, np.full(3, np.pi / 6))
    assert got.stamp_ns.tolist() == [250_000_000, 1_250_000_000, 2_250_000_000]
    assert log.format == "csv (long form)"
    bare = "".join(f"{s},{a},{r}\n" for s, a, r in rows)
    got, log = read_text(bare, OpenOptions(columns=("sweep", "angle", "range")))
    assert (got.beams.tolist(), got.stamp_ns.tolist()) == ([7, 7, 7], [0, 0, 0])
    assert "bearings beyond a turn in radians: taken as degrees" in log.report.notes[0]


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        *(("millis", 1000), ("micros", 10**6), ("elapsed_ms", 1000), ("us", 10**6), ("epoch_us", 10**6), ("uptime", 1)),
        *(("time_milliseconds", 1000), ("gps_time_ns", 10**9), ("unix_time", 1), ("Timestamp (microseconds)", 10**6)),
    ],
)
def test_a_time_for_each_beam_in_any_unit(name: str, unit: int) -> None:
    """Two beams in each millisecond, a turn in 0.36 s."""
    rows = [(0.18 * s + a / 2000, a) for s in range(3) for a in range(0, 360, 1)]
    text = f"{name},angle_deg,distance\n" + "".join(
        f"{round(t * unit) if unit > 1 else round(t, 4)},{a},{2 + a / 1000:.3f}\n" for t, a in rows
    )
    got, log = read_text(text, OpenOptions())
    assert got.stamp_ns.tolist() == [0, 180_000_000, 360_000_000]
    assert not log.report.unread


def test_long_form_across_blocks_and_with_damage(tmp_path: Path) -> None:
    want = sweeps(60, 500)
    text = text_of("long", tmp_path, want).split(b"\n")
    got, _ = read_text(b"\n".join(text))
    same_ranges(got, want)
    text[3] = b"garbage"
    text[700] = text[700].rsplit(b",", 1)[0] + b",abc"
    got, log = read_text(b"\n".join(text))
    assert log.report.damage[0] == Damage("line 4", "1 cells where 4 are usual: the row is dropped")
    assert log.report.damage[1] == Damage("line 701", "'abc' is not a number")
    assert got.beams.tolist() == [500] * 60
    assert np.isnan(got.ranges[0, 2])
    assert np.isnan(got.ranges[1, 199])
    np.testing.assert_array_equal(got.ranges[2:], want.ranges[2:])


def test_long_form_with_bearings_that_are_not_even() -> None:
    angles = np.delete(np.linspace(0, 2 * np.pi, 63, endpoint=False), [5, 6, 40])
    rows = [f"{s},{a},{1 + a}" for s in range(2) for a in np.roll(angles, 9) % (2 * np.pi)]
    got, log = read_text("scan,theta,r\n" + "\n".join(rows) + "\n", OpenOptions())
    assert got.beams.tolist() == [63, 63]
    assert np.isnan(got.ranges).sum(axis=1).tolist() == [3, 3]
    valid = ~np.isnan(got.ranges[0])
    bearings = got.angle_min[0] + got.angle_increment[0] * np.arange(63)
    np.testing.assert_allclose(got.ranges[0, valid], 1 + bearings[valid] % (2 * np.pi), atol=1e-5)
    assert log.report.notes[-1].startswith("bearings are not evenly spaced")


def test_one_sweep_per_file(tmp_path: Path) -> None:
    for name in ("scan_10.csv", "scan_9.csv", "scan_100.txt"):
        number = int(name[5:-4])
        (tmp_path / name).write_text("".join(f"{a / 10},{number + a}\n" for a in range(5)))
    (tmp_path / "README.md").write_text("three sweeps")
    (tmp_path / "scan_11.csv").write_text("what is this\n")
    named = OpenOptions(columns=("angle", "range"))
    got, log = read(tmp_path, named)
    assert got.ranges[:, 0].tolist() == [9, 10, 100]
    assert (got.stamp_ns.tolist(), got.angle_increment[0]) == ([0, 0, 0], 0.1)
    assert [damage.place for damage in log.report.damage] == ["scan_11.csv"]
    got, _ = read([tmp_path / "scan_9.csv", tmp_path / "scan_10.csv"], named)
    assert got.ranges[:, 0].tolist() == [9, 10]
    (tmp_path / "1714555596.445048407").write_text("theta,r\n0.0,1\n0.5,2\n")
    got, log = read(tmp_path / "1714555596.445048407", OpenOptions())
    assert (got.stamp_ns.tolist(), log.format) == ([START], "csv (one file per sweep)")


@pytest.mark.parametrize("layout", ["rostopic", "ros2", "wide", "bagpy", "plotjuggler", "drow"])
def test_garbage_in_the_middle_is_counted_by_line(layout: str, tmp_path: Path) -> None:
    want = sweeps()
    lines = text_of(layout, tmp_path, want).split(b"\n")
    first = len(lines) - 1 - len(want)
    broken = lines[first + 20].split(b",")
    broken[20] = b"0x1f"
    lines[first + 20] = b",".join(broken)
    lines[first + 30] = b"\0" * 50
    lines.insert(first + 5, b"Segmentation fault, core dumped")
    lines.insert(first + 9, lines[0] if first else b"")
    got, log = read_text(b"\n".join(lines), opening(layout))
    same_ranges(got, want.rows(np.delete(np.arange(len(want)), [20, 30])))
    assert sorted(int(damage.place.removeprefix("line ")) for damage in log.report.damage) == [
        first + 6,
        first + 23,
        first + 33,
    ]
    causes = {damage.place: damage.cause for damage in log.report.damage}
    assert causes[f"line {first + 23}"] == "'0x1f' is not a number"
    assert causes[f"line {first + 33}"] == "nothing but NUL bytes"


def test_flipped_bytes_in_gzip_lose_only_what_follows(tmp_path: Path) -> None:
    want = sweeps(3000, 37)
    data = bytearray(gzip.compress(text_of("rostopic", tmp_path, want), mtime=0))
    data[len(data) // 2] ^= 0xFF
    with CsvLog(io.BytesIO(bytes(data))) as log:
        got = concatenate(list(log.scans()))
        assert log.compression == "gzip"
        assert any(damage.place.startswith("compressed byte ") for damage in log.report.damage)
    assert 1000 < len(got) < 2999
    same_ranges(got.rows(slice(0, 1000)), want.rows(slice(0, 1000)))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "x.csv: empty file"),
        (b"\n\n", "x.csv: no data in it, only comments or blank lines"),
        (b"# nothing\n", "x.csv: no data in it, only comments or blank lines"),
        (b"hello\nworld\n", "x.csv: text, but no table with columns: 'hello'"),
        (bytes(range(256)) * 20, "x.csv: neither a known container nor text: not a log"),
        (b"\x1f\x8b\x08\0garbage", "x.csv: gzip data ends early"),
        (
            b"name,age\nbob,12\n",
            "x.csv: a table with the columns 'name, age' is none of the CSV layouts: rostopic echo -p; "
            "ros2 topic echo --csv; PlotJuggler; bagpy; mcap cat --format=csv; list of ranges; plain wide; long form; "
            "one file per sweep",
        ),
        (b"a b\n1 2\n", "x.csv: a table with the columns 'a, b' is none of the CSV layouts: rostopic echo -p"),
        (b"1,2,x\n5,1,y\n", "x.csv: lines like '1,2,x' is none of the CSV layouts: rostopic echo -p"),
    ],
)
def test_what_is_no_log_says_so_in_one_line(data: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "x.csv"
    path.write_bytes(data)
    with pytest.raises(UnreadableError) as error:
        CsvLog(path, GEOMETRY)
    text = str(error.value)
    assert text.removeprefix(f"{tmp_path}/").startswith(message)
    assert "\n" not in text


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("%time,field.header.seq,field.pose.x\n1,2,3\n", "rostopic echo -p"),
        ("__time,/odom/pose/x\n1.0,2.0\n", "PlotJuggler"),
        ("Time,header.seq,pose.x\n1.0,2,3.0\n", "bagpy"),
        ("1,5,odom,base_link,0.5,0.5,0.0,0.1,0.1,8.0,3.0\n", "ros2 topic echo --csv"),
    ],
)
def test_ros_tables_without_ranges_hold_no_scan(text: str, name: str) -> None:
    with CsvLog(io.BytesIO(text.encode())) as log:
        assert (log.topics(), list(log.scans()), log.format) == ([], [], f"csv ({name})")
        assert list(log.messages(["nav_msgs/msg/Odometry"])) == []


def test_header_without_rows_is_a_log_without_sweeps(tmp_path: Path) -> None:
    text = text_of("rostopic", tmp_path).split(b"\n")[0] + b"\n"
    with CsvLog(io.BytesIO(text)) as log:
        assert list(log.scans()) == []
        assert (log.report.damage, len(log.topics() or [])) == ([], 1)


class _Endless(io.RawIOBase):
    """A header, a row, then one line of 200 MB, then a row again."""

    def __init__(self, head: bytes, fill: bytes, end: bytes) -> None:
        self._parts = [head, *[fill] * (200_000_000 // len(fill)), end]

    def read(self, size: int = -1) -> bytes:
        if not self._parts:
            return b""
        part = self._parts.pop(0)
        if len(part) > size:
            self._parts.insert(0, part[size:])
        return part[:size]


@pytest.mark.parametrize("fill", [b"1.5," * 16384, b"x" * 65536], ids=["cells", "text"])
def test_a_line_without_end_stays_within_bounds(fill: bytes) -> None:
    head = b"time,r0,r1,r2\n1.0,5,6,7\n2.0,5,6,7\n"
    tracemalloc.start()
    got, log = read(_Endless(head, fill, b"\n4.0,5,6,8\n"), OpenOptions(fov=1.0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert got.ranges[:, 2].tolist() == [7, 7, 8]
    assert log.report.damage == [Damage("line 4", "longer than 8 MiB: skipped")]
    assert peak < 80e6


@pytest.mark.slow
def test_rows_of_very_different_length_are_not_padded_to_one_width() -> None:
    long_row = "0.5," + ",".join(["1"] * 200_000)
    text = "0.1,1,2,3,4,5,6,7\n" * 5000 + long_row + "\n" + "0.7,1,2,3,4,5,6,7\n" * 5000
    tracemalloc.start()
    with CsvLog(io.BytesIO(text.encode()), NAMED) as log:
        assert sum(map(len, log.scans())) == 10_001
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 60e6


def beams_of(times: list[str], names: str = "time,angle,range", sep: str = ",") -> str:
    """One beam per row, 20 beams of 18 degrees for each turn; `times` has one text per row."""
    rows = (f"{time}{sep}{18 * (k % 20)}{sep}{2 + k % 7}" for k, time in enumerate(times))
    return names.replace(",", sep) + "\n" + "\n".join(rows) + "\n"


def test_a_date_and_a_time_of_day_in_two_columns() -> None:
    rows = [("2026-11-26", "23:59:59.9"), ("2026-11-27", "00:00:00.0"), ("2026-11-27", "00:00:00.1")]
    got, log = read_text("Date,Time,r0,r1,r2\n" + "".join(f"{day},{time},1,2,3\n" for day, time in rows))
    assert ((got.stamp_ns - 1795737599900000000) / 1e9).tolist() == [0.0, 0.1, 0.2]
    assert "1970" not in log.report.notes[0]


def test_times_go_on_at_midnight_whatever_the_blocks() -> None:
    times = [f"23:{50 + k // 60}:{k % 60:02d}" if k < 600 else f"00:00:{k - 600:02d}" for k in range(640)]
    got, log = read_text("time;r0;r1;r2\n" + "".join(f"{time};1;2;3\n" for time in times))
    assert np.unique(np.diff(got.stamp_ns)).tolist() == [10**9]
    assert "times of day without a date: dates begin in 1970" in log.report.notes[0]


@pytest.mark.parametrize(
    ("text", "note"),
    [
        ("time;r0;r1;r2\n{0};1;2;3\n{0};1;2;4\n", "stamps are 0, tracks cannot tell what moves"),
        ("time;stamp;r0;r1;r2\n{0};1.5;1;2;3\n{0};2.5;1;2;4\n", "another column tells them"),
    ],
)
def test_times_that_are_not_understood_are_told(text: str, note: str) -> None:
    with AnyCsvLog(io.BytesIO(text.format("13:12:54 CET").encode()), GEOMETRY) as log:
        batches = list(read_batches(log, ReadOptions(), report := ReadReport()))
    assert [len(batch) for batch in batches] == [2]
    assert report.doubted() == [f"times of column `time` are not understood (13:12:54 CET): {note}"]


def test_a_coarse_time_is_no_number_of_a_turn() -> None:
    times = [f"{k // 20 / 10 + k % 20 / 200:.2f}" for k in range(200)]
    got, _ = read_text(beams_of(times), OpenOptions())
    assert got.beams.tolist() == [20] * 10
    np.testing.assert_allclose(got.stamp_ns / 1e9, np.arange(10) / 10)


def test_a_line_that_names_the_separator() -> None:
    times = [str(k // 20) for k in range(60)]
    want, _ = read_text(beams_of(times, sep=";"), OpenOptions())
    for line in ("sep=;\r\n", '"sep=;"\n'):
        got, log = read_text(line + beams_of(times, sep=";"), OpenOptions())
        same_ranges(got, want)
        assert (got.stamp_ns.tolist(), log.report.damage) == (want.stamp_ns.tolist(), [])
