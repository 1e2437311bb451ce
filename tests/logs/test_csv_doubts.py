"""A CSV that holds no sweep per row, or more than one plane, is refused with what it is; scans are read all the same."""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.csv.long_form import BACK, DOUBLED, TURNS
from lidarcli.logs.csv.nameless import COUNTER_ROWS, LEAST_NUMBERS, MOST_UNLIKE, UNLIKE, no_ranges
from lidarcli.sweeps import RawSweeps, concatenate
from tests.logs.watched import CsvLog
from tests.places import REAL_LOGS, needs_real_logs

FOV = OpenOptions(fov=2 * np.pi)
Table = Sequence[Sequence[object]] | np.ndarray


def text_of(table: Table, names: str = "", separator: str = ",") -> bytes:
    lines = [separator.join(f"{cell:g}" if isinstance(cell, float) else str(cell) for cell in row) for row in table]
    return "\n".join([*([names] if names else []), *lines, ""]).encode()


def read(text: bytes, options: OpenOptions = FOV) -> tuple[RawSweeps, CsvLog]:
    with CsvLog(io.BytesIO(text), options) as log:
        return concatenate(list(log.scans())), log


def refusal(text: bytes, options: OpenOptions = FOV) -> str:
    with pytest.raises(UnreadableError) as error:
        CsvLog(io.BytesIO(text), options)
    message = str(error.value)
    assert "\n" not in message
    return message.partition(": ")[2]


def turns(sweeps: int, step: float = 1.5, unit: float = 1.0, jitter: float = 0.0) -> list[tuple[float, ...]]:
    """(bearing, range [mm], quality) of a scanner that turns."""
    random = np.random.default_rng(7)
    angles = np.arange(0, 360, step)
    rows = []
    for _ in range(sweeps):
        shaken = np.sort((angles + random.uniform(0, jitter, len(angles))) % 360) * unit
        rows += [
            (round(angle, 4), int(1500 + 900 * np.sin(angle)), int(random.integers(8, 48))) for angle in shaken.tolist()
        ]
    return rows


@pytest.mark.parametrize("options", [OpenOptions(), FOV, OpenOptions(angle_min=-1.0, angle_increment=0.1)])
@pytest.mark.parametrize("jitter", [0.0, 1.4])
def test_bearing_range_quality_without_names(options: OpenOptions, jitter: float) -> None:
    rows = turns(4, jitter=jitter)
    low, high = min(row[0] for row in rows), max(row[0] for row in rows)
    assert refusal(text_of(rows), options) == (
        f"a table without column names that looks like one beam per row (column 1 runs from {low:g} to {high:g} and"
        " starts over): name the columns in a first line, such as `angle,range,quality`;"
        " --range-unit mm says that ranges are millimetres; bearings of an RPLIDAR run clockwise: write"
        " `#RPLIDAR SCAN DATA` and `#Angle Distance Quality` as the first lines instead"
    )


def test_what_the_refusal_says_is_a_way_out() -> None:
    rows = turns(4)
    got, log = read(text_of(rows, "angle,range,quality"), OpenOptions(range_scale=0.001))
    assert got.beams.tolist() == [240] * 4
    np.testing.assert_allclose(np.rad2deg(got.angle_increment), 1.5)
    np.testing.assert_allclose(got.ranges.ravel(), np.array([row[1] / 1000 for row in rows], np.float32))
    assert log.report.damage == []
    timed = [(1700000000 + 0.001 * n, *row) for n, row in enumerate(rows)]
    assert "such as `time,angle,range,quality`" in refusal(text_of([(round(t, 3), a, r, q) for t, a, r, q in timed]))
    got, _ = read(text_of([(f"{t:.3f}", a, r, q) for t, a, r, q in timed], "time,angle,range,quality"))
    assert got.beams.tolist() == [240] * 4
    assert got.stamp_ns[:2].tolist() == [1_700_000_000_000_000_000, 1_700_000_000_240_000_000]


def test_a_long_table_in_radians_and_with_many_columns() -> None:
    rows = [(*row, *range(5)) for row in turns(3, unit=np.pi / 180)]
    assert refusal(text_of(rows)).startswith(
        "a table without column names that looks like one beam per row (column 1 runs from 0 to 6.257 and starts over)"
    )
    got, _ = read(text_of(rows, "angle,range,quality,c4,c5,c6,c7,c8"))
    assert got.beams.tolist() == [240] * 3


def test_two_columns_of_shaken_bearings_are_read() -> None:
    rows = [row[:2] for row in turns(5, jitter=1.4)]
    got, log = read(text_of(rows), OpenOptions())
    assert len(got) == 5
    assert log.format == "csv (one file per sweep)"
    assert (np.isfinite(got.ranges).sum(axis=1) > 190).all()


@pytest.mark.parametrize("numbers", range(3, LEAST_NUMBERS))
def test_a_row_of_few_numbers_is_no_sweep(numbers: int) -> None:
    row = [1.5 + place for place in range(numbers)]
    message = refusal(text_of([row, row[::-1], row]))
    shown = ",".join(f"{cell:g}" for cell in row)
    assert message == (
        f"rows of {numbers} numbers without column names, such as '{shown}', are too short for a sweep each: name the"
        " columns in a first line (`angle,range` for one beam per row, `time,r0,r1,r2` for one sweep per row)"
    )
    names = ",".join(["time", *(f"r{place}" for place in range(numbers - 1))])
    if numbers > 3:
        assert len(read(text_of([row, row, row], names))[0]) == 3
    assert len(read(text_of([row * 4, row * 4]))[0]) == 2


def test_a_key_that_comes_back_is_none() -> None:
    layers = [(elevation, angle, 2) for _ in range(2) for elevation in (-2, 0, 2) for angle in range(0, 360, 4)]
    assert "looks like one beam per row" in refusal(text_of(layers), OpenOptions())


# One sweep per row: what a scan looks like, and what does not.


def room(rows: int = 60, beams: int = 180, scale: float = 1.0) -> np.ndarray:
    """(R, B) ranges in a room from a sensor that drives away from a wall, a person walking off in front of it."""
    random = np.random.default_rng(rows + beams)
    bearings = np.linspace(-np.pi, np.pi, beams, endpoint=False)
    place = 0.5 + 0.04 * np.arange(rows)[:, None]
    with np.errstate(divide="ignore"):
        x = np.where(np.cos(bearings) > 0, (9.0 - place) / np.cos(bearings), -place / np.cos(bearings))
        y = 2.5 / np.abs(np.sin(bearings))
    ranges = np.minimum(x, y) + random.normal(0, 0.01, (rows, beams))
    ranges[:, beams // 2 : beams // 2 + 3] = 0.4 + 0.09 * np.arange(rows)[:, None]
    return np.round(ranges * scale, 3 if scale == 1 else 0)


def whole(table: np.ndarray) -> list[list[object]]:
    return [[int(cell) if cell == round(cell) else round(float(cell), 4) for cell in row] for row in table]


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 1000.0])
@pytest.mark.parametrize("beams", [8, 16, 180, 682])
@pytest.mark.parametrize("rows", [1, 2, 5, 60])
def test_scans_stay_scans(rows: int, beams: int, scale: float) -> None:
    ranges = room(rows, beams, scale)
    assert no_ranges(ranges, 0) == ""
    blind = ranges.copy()
    blind[:, : beams // 4] = 0
    open_quarter = np.where(np.arange(beams) < beams // 4, ranges * 20, 0.2)
    missing = np.where(np.random.default_rng(1).random(ranges.shape) < 0.7, np.inf, ranges)
    far = np.where(np.random.default_rng(2).random(ranges.shape) < 0.3, 65.533, ranges)
    marked = np.where(np.random.default_rng(3).random(ranges.shape) < 0.3, -1.0, ranges)
    marked[:, 3] = np.where(np.arange(rows) % 2, -1, -2)
    same = np.broadcast_to(ranges[:1], ranges.shape)
    for table in (blind, open_quarter, missing, far, marked, same, np.zeros_like(ranges), ranges[:, ::-1]):
        assert no_ranges(table, 0) == ""
    times = np.arange(rows) * 0.1 + 1_700_000_000
    got, log = read(text_of([[f"{t:.1f}", *row] for t, row in zip(times, whole(ranges), strict=True)]))
    assert (len(got), got.beams.tolist()) == (rows, [beams] * rows)
    assert log.report.damage == []


def test_a_range_that_climbs_and_falls_back_is_no_bearing() -> None:
    rows = [[round(0.1 * n, 1), *[1 + 2.0 * (n % 4)] * 9] for n in range(4)] + [[0.4, *[1.0] * 9]]
    got, _ = read(text_of(rows))
    assert got.ranges[:, 0].tolist() == [1, 3, 5, 7, 1]


def test_a_person_who_walks_away_in_the_open_is_no_counter() -> None:
    random = np.random.default_rng(5)
    for width in (1, 3, 8):
        ranges = np.zeros((80, 100))
        ranges[:, 40 : 40 + width] = 500 + 130 * np.arange(80)[:, None] + random.integers(-20, 20, (80, width))
        # What is at the edge of the person comes and goes.
        for edge in (39, 40 + width):
            ranges[:, edge] = np.where(random.random(80) < 0.5, ranges[:, 40], 0)
        assert no_ranges(ranges, 0) == ""


def odometry(rows: int = 60) -> dict[str, tuple[np.ndarray, str]]:
    """Columns before a scan that are none of its beams, and what tells them."""
    steps = np.arange(rows)
    turning = np.round(np.sin(steps / 9), 3)
    return {
        "pose": (np.column_stack([steps * 0.1, turning, -turning]), "below zero: columns 3, 4"),
        "yaw": (np.column_stack([turning]), "below zero: column 2"),
        "ticks": (np.column_stack([np.zeros(rows), 7 * steps, 8 * steps, np.zeros(rows)]), "counters: columns 3, 4"),
        "speed": (np.column_stack([1 + 0.01 * steps]), "decimals among whole numbers, or the reverse: column 2"),
        "time": (np.column_stack([1e8 + 99_000 * steps + steps % 7]), "far beyond all others: column 2"),
        "battery": (np.column_stack([1e6 + 99_000 * (steps % 11)]), "far beyond all others: column 2"),
    }


@pytest.mark.parametrize("kind", list(odometry()))
def test_odometry_before_the_ranges_is_no_beam(kind: str) -> None:
    before, why = odometry()[kind]
    ranges = room(len(before), 180, 1000.0)
    table = np.column_stack([np.arange(len(before)) * 100_000, before, ranges])
    message = refusal(text_of(whole(table), separator=" "))
    assert message.startswith(f"a table without column names in which not all numbers are ranges ({why})")
    assert message.endswith(": name the columns in a first line, the ranges r0, r1, ..., or take the other columns out")
    names = ["time", *(f"odometry{place}" for place in range(before.shape[1])), *(f"r{beam}" for beam in range(180))]
    got, log = read(text_of(whole(table), ",".join(names)), OpenOptions(fov=np.pi, range_scale=0.001))
    assert got.ranges.shape == (len(before), 180)
    np.testing.assert_allclose(got.ranges, ranges / 1000, atol=1e-6)
    assert got.stamp_ns[:3].tolist() == [0, 100_000_000, 200_000_000]
    assert "times are microseconds" in log.report.notes[0]


def test_whole_numbers_among_ranges_in_metres() -> None:
    ranges = room(COUNTER_ROWS, 60)
    ranges[:, 20] = np.arange(COUNTER_ROWS) % 9 + 1
    assert no_ranges(ranges, 1) == "decimals among whole numbers, or the reverse: column 22"


def test_a_table_of_measurements_is_no_scan() -> None:
    random = np.random.default_rng(9)
    size = np.array([0.3, 25.0, 1013.0, 4.2, 0.01, 300.0, 7.5, 0.2, 90.0])
    table = size * (1 + 0.05 * random.random((40, 9)))
    assert no_ranges(table, 1) == "columns far from their neighbours"
    assert UNLIKE > 2
    assert MOST_UNLIKE > 0.5
    points = random.normal(0, 3, (40, 24))
    assert no_ranges(points, 0) == "below zero: columns 1, 2, 3 and 21 more"


@pytest.mark.parametrize(
    ("step", "unit", "note"),
    [
        (1, 10**9, ""),
        (9, 10**9, ""),
        (100, 10**6, "times are milliseconds"),
        (25, 10**6, "times are milliseconds"),
        (100_000, 10**3, "times are microseconds"),
        (25_000, 10**3, "times are microseconds"),
        (100_000_000, 1, ""),
    ],
)
@pytest.mark.parametrize("start", [0, 12_345])
@pytest.mark.parametrize("names", ["", "time,", "timestamp,"])
def test_whole_times_tell_their_unit_by_their_steps(step: int, unit: int, note: str, start: int, names: str) -> None:
    times = [start + step * row for row in range(9)]
    # Small steps are those of a sequence number, too, where what follows rises like a time.
    ranges = whole(room(9, 20)[:: -1 if step < 10 else 1])
    text = text_of([[t, *row] for t, row in zip(times, ranges, strict=True)])
    header = (names + ",".join(f"r{beam}" for beam in range(20)) + "\n").encode() if names else b""
    got, log = read(header + text)
    assert got.stamp_ns.tolist() == [t * unit for t in times]
    assert ("times are" in log.report.notes[0]) == bool(note)
    assert note in log.report.notes[0]


def test_whole_seconds_since_1970_stay_seconds() -> None:
    times = [1_700_000_000 + 60 * row for row in range(9)]
    got, _ = read(text_of([[t, *row] for t, row in zip(times, whole(room(9, 20)), strict=True)]))
    assert got.stamp_ns.tolist() == [t * 10**9 for t in times]


# One beam per row, in several layers.


def layered(names: str, key: bool) -> bytes:
    rows = []
    for sweep in range(2):
        for layer in (-2, 0, 2, 4):
            for angle in range(0, 360, 2):
                rows.append([*([sweep] if key else []), layer, angle, 3.5])
    return text_of(rows, names)


@pytest.mark.parametrize(
    "name", ["elevation_deg", "layer", "ring", "channel", "laser_id", "vertical_angle", "Elevation (rad)"]
)
def test_a_column_of_layers_is_refused(name: str) -> None:
    message = refusal(layered(f"sweep,{name},azimuth_deg,range", True))
    assert message == (
        f"one beam per row, in several layers (column '{name}' holds '-2', '0', '2', ...); lidarcli reads scans of one"
        " plane: keep the rows of one layer"
    )
    one = text_of([[s, 2, a, 3.5] for s in range(2) for a in range(0, 360, 2)], f"sweep,{name},azimuth_deg,range")
    got, log = read(one)
    assert (got.beams.tolist(), log.report.damage, log.report.refused.total()) == ([180, 180], [], 0)


def test_a_sphere_is_refused() -> None:
    rows = [[phi, theta, 2] for phi in (80, 90, 100) for theta in range(0, 360, 2)]
    assert refusal(text_of(rows, "phi_deg,theta_deg,r")).startswith(
        "one beam per row, in several layers (column 'theta_deg' holds '0', '2', '4', ...)"
    )


def keyed(bearings: Any) -> bytes:
    rows = [[sweep, round(float(angle), 4), 2.5] for sweep in range(2) for angle in bearings]
    good = [[sweep, angle, 2.5] for sweep in (2, 3) for angle in range(0, 360, 2)]
    return text_of(rows + good, "sweep,angle_deg,range")


@pytest.mark.parametrize(
    ("bearings", "cause"),
    [
        (np.tile(np.arange(0, 360, 2), 4), TURNS),
        (np.arange(0, 1355, 0.25), TURNS),
        (np.tile(np.arange(-100, 101, 2), 4), TURNS),
        (np.tile(np.arange(-60, 61, 2), 4), BACK),
        (np.repeat(np.arange(0, 360, 2), 4), DOUBLED),
    ],
    ids=["turns", "on", "wide", "narrow", "interleaved"],
)
def test_layers_under_one_key_are_no_sweep(bearings: np.ndarray, cause: str) -> None:
    got, log = read(keyed(bearings))
    assert got.beams.tolist() == [180, 180]
    assert log.report.refused == {("/scan", cause): 2}


@pytest.mark.parametrize("start", [0, 100, 357])
def test_a_turn_that_overlaps_its_start_is_a_sweep(start: float) -> None:
    random = np.random.default_rng(2)
    bearings = (start + np.arange(0, 368, 1.0) + random.uniform(-0.3, 0.3, 368)) % 360
    got, log = read(keyed(bearings))
    assert len(got) == 4
    assert log.report.refused.total() == 0


def test_layers_end_with_exit_code_3(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from lidarcli.cli import run

    path = tmp_path / "layers.csv"
    path.write_bytes(layered("sweep,elevation_deg,azimuth_deg,range", True))
    assert run(["info", str(path)]) == 3
    assert capsys.readouterr().err == (
        f"lidarcli: {path}: one beam per row, in several layers (column 'elevation_deg' holds '-2', '0', '2', ...);"
        " lidarcli reads scans of one plane: keep the rows of one layer\n"
    )
    path.write_bytes(keyed(np.tile(np.arange(0, 360, 2), 4)))
    assert run(["info", str(path)]) == 3
    out, err = capsys.readouterr()
    assert err == f"lidarcli: {path}: topic /scan: 2 messages left out: {TURNS}\n"
    assert "360.00 deg from 0.00 deg" in out


@pytest.mark.slow
def test_numbers_beyond_all_bounds_are_no_reason_to_fail() -> None:
    random = np.random.default_rng(11)
    odd = np.array([np.nan, np.inf, -np.inf, 0.0, 1e308, -1e308, 5e-324, 65535.0, -1.0, 3.4e38])
    for rows in (1, 2, 5, 40):
        for _ in range(60):
            table = np.where(random.random((rows, 40)) < 0.5, random.choice(odd, (rows, 40)), 2.5)
            doubt = no_ranges(table, 0)
            assert doubt == "" or rows > 2
            text = text_of([[repr(float(cell)) for cell in row] for row in table])
            with suppress(UnreadableError), CsvLog(io.BytesIO(text), FOV) as log:
                assert all(block.ranges.shape[1] in (39, 40) for block in log.scans())


def test_a_few_beams_that_see_something_are_of_the_same_kind() -> None:
    ranges = np.full((60, 90), 30.0)
    ranges[:, 20:24] = room(60, 90)[:, 20:24]
    assert no_ranges(ranges, 0) == ""


@pytest.mark.parametrize("command", ["info", "detect"])
def test_whoever_gives_the_geometry_gets_no_sweeps_of_three_beams(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from lidarcli.cli import run

    path = tmp_path / "rplidar.txt"
    path.write_bytes(text_of(turns(3), separator=" "))
    output = ["-o", str(tmp_path / "tables")] if command == "detect" else []
    assert run([command, str(path), *output, "--fov", "360", "--degrees"]) == 3
    out, err = capsys.readouterr()
    assert (out, err.splitlines()[0]) == (
        "",
        f"lidarcli: {path}: a table without column names that looks like one beam per row (column 1 runs from 0 to"
        " 358.5 and starts over): name the columns in a first line, such as `angle,range,quality`;"
        " --range-unit mm says that ranges are millimetres; bearings of an RPLIDAR run clockwise: write"
        " `#RPLIDAR SCAN DATA` and `#Angle Distance Quality` as the first lines instead",
    )
    assert list(tmp_path.rglob("*.parquet")) == []


@pytest.mark.slow
@needs_real_logs
@pytest.mark.parametrize(
    "name",
    [
        "turtlebot/topics.bag",
        "pr2/mylaserdata.bag",
        "leg_tracker/positive_2_extracted.bag",
        "robots_ii/mylaserdata_20151128.bag",
        "my_gazebo_tutorials/20_46_08",
    ],
)
def test_sweeps_of_real_sensors_are_ranges(name: str) -> None:
    with open_log(REAL_LOGS / name) as log:
        ranges = concatenate(list(log.scans(None, ReadReport()))).ranges.astype(np.float64)
    judged = 0
    for table in (ranges, np.where(np.isfinite(ranges), np.rint(ranges * 1000), ranges)):
        for rows in (5, 30, len(ranges)):
            for start in range(0, len(ranges) - rows + 1, 40):
                for beams in (slice(None), slice(None, None, 5), slice(None, None, ranges.shape[1] // 16)):
                    assert no_ranges(table[start : start + rows, beams], 1) == "", (start, rows, beams)
                    judged += 1
    assert judged >= 6


def test_the_rows_of_an_rplidar_lead_to_its_names_and_its_unit(tmp_path: Path) -> None:
    rows = [f"{k}.5,{2000 + k},47,{turn + k / 360:.4f}\n" for turn in range(3) for k in range(360)]
    path = tmp_path / "turns.csv"
    path.write_text("".join(rows))
    with pytest.raises(UnreadableError) as caught:
        open_log(str(path))
    assert str(caught.value).endswith(
        "such as `angle,range,quality,time`; --range-unit mm says that ranges are millimetres; bearings of an RPLIDAR "
        "run clockwise: write `#RPLIDAR SCAN DATA` and `#Angle Distance Quality Time` as the first lines instead"
    )
    path.write_text("#RPLIDAR SCAN DATA\n#Angle Distance Quality Time\n" + "".join(rows))
    with CsvLog(path) as log:
        blocks = list(log.scans())
    assert [int(beams) for block in blocks for beams in block.beams] == [360, 360, 360]
    assert blocks[0].angle_increment[0] == pytest.approx(-np.pi / 180)
    assert blocks[0].ranges[0, :3] == pytest.approx([2.0, 2.001, 2.002])
    path.write_text("angle,range,quality,time\n" + "".join(rows))
    with CsvLog(path, OpenOptions(range_scale=0.001)) as log:
        assert [int(beams) for block in log.scans() for beams in block.beams] == [360, 360, 360]


@pytest.mark.parametrize("header", ["", "index,range\n"])
def test_the_numbers_of_beams_are_no_bearings(header: str, tmp_path: Path) -> None:
    path = tmp_path / "beams.csv"
    path.write_text(header + "".join(f"{k},{2 + k / 100:.2f}\n" for _ in range(3) for k in range(682)))
    with pytest.raises(
        UnreadableError, match="write the bearing in place of the number and `angle,range` as the first line"
    ):
        open_log(str(path))


@pytest.mark.parametrize(
    "text",
    [
        "sensor_msgs.msg.LaserScan(header=std_msgs.msg.Header(stamp=builtin_interfaces.msg.Time(sec=1)), ranges=[1.0])\n",
        "ranges: [1.0, 2.0, 3.0]\n---\nranges: [1.0, 2.0, 3.0]\n---\n",
        "header: \n  seq: 1\n  frame_id: laser\nangle_min: -1.57\nranges: [1.0, 2.0]\n---\n",
    ],
)
def test_messages_as_they_are_printed_are_no_log(text: str, tmp_path: Path) -> None:
    path = tmp_path / "echo.txt"
    path.write_text(text * 3)
    with pytest.raises(UnreadableError, match="or print with `ros2 topic echo --csv --full-length`"):
        open_log(str(path))
