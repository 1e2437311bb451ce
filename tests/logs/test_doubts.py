"""What looks wrong in sweeps is told: units, geometry, limits and stamps, and nothing of what is right."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.logs.base import LASERSCAN, OpenOptions, ReadReport
from lidarcli.logs.batches import ReadOptions, read_batches
from lidarcli.logs.blocks import IN_DEGREES
from lidarcli.logs.csv import CsvLog
from lidarcli.logs.log_stats import LogStats
from lidarcli.logs.scan_checks import MOST, ScanChecks
from lidarcli.options.times import as_time
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, Bool, Int64, RawSweeps, concatenate
from tests.fake_log import FakeLog
from tests.logs.scan_messages import scan
from tests.logs.test_odd_logs import written
from tests.sweeping import START, STEP, raw_sweeps
from tests.text_logs import write_log

COUNT = 40
HOUR = 3600 * 1_000_000_000
MILLIMETRES = "are beyond 1,000 m: they are probably millimetres (--range-unit mm)"


def room(count: int = COUNT, turned: int = 0) -> RawSweeps:
    """A square room of 6 m seen from its middle, with noise, by a sensor that is turned by so many beams."""
    bearing = TURN / 360 * (np.arange(360) + turned)
    wall = 3.0 / np.maximum(np.abs(np.cos(bearing)), np.abs(np.sin(bearing)))
    wall[20:60] -= 1.0
    noise = np.random.default_rng(4).normal(0.0, 0.01, (count, 360))
    return raw_sweeps(wall + noise)


def notes(*blocks: RawSweeps, **options: Any) -> list[str]:
    """What reading these sweeps tells."""
    report = ReadReport()
    for _ in read_batches(FakeLog(blocks), ReadOptions(**options), report):
        pass
    assert report.notes == []
    return report.doubted()


def scaled(by: float, limits: float = 1.0) -> RawSweeps:
    block = room()
    return replace(
        block,
        ranges=block.ranges * np.float32(by),
        range_min=block.range_min * np.float32(limits),
        range_max=block.range_max * np.float32(limits),
    )


def bearings(first: float, step: float) -> RawSweeps:
    return replace(room(), angle_min=np.full(COUNT, first), angle_increment=np.full(COUNT, step))


def stamped(change: Callable[[Any], Any]) -> RawSweeps:
    """The room with other stamps: `change` of the number of each sweep [ns]."""
    stamps = START + STEP * np.arange(COUNT)
    changed = np.asarray(change(np.arange(COUNT)), np.int64)
    return replace(room(), stamp_ns=changed, record_ns=stamps)


def in_turns() -> RawSweeps:
    """Two sensors that look elsewhere, one after the other."""
    other = room(turned=110)
    both = concatenate([room(), replace(other, stamp_ns=other.stamp_ns + STEP // 3)])
    return both.rows(np.argsort(both.stamp_ns, kind="stable"))


ODD = {
    "millimetres": (scaled(1000, 1000), MILLIMETRES),
    "millimetres, limits in metres": (scaled(1000), MILLIMETRES),
    "centimetres": (scaled(100, 100), "beyond 200 m: they are probably centimetres (--range-unit cm)"),
    "centimetres, near": (scaled(55, 100), "beyond 60 m: they are probably centimetres (--range-unit cm)"),
    "degrees": (bearings(-180.0, 0.5), "/scan sees 10,285 deg (40 of 40 sweeps)"),
    "no steps": (bearings(0.0, 1e-12), "beams of /scan are 1e-12 rad apart (40 of 40 sweeps)"),
    "no range": (
        replace(room(), ranges=np.full((COUNT, 360), np.nan, np.float32)),
        "/scan: 100.0% of the beams have no range (NaN): no ranges (--no-return nan)",
    ),
    "nothing near": (
        replace(room(), ranges=np.full((COUNT, 360), np.inf, np.float32)),
        "/scan: 100.0% of the beams have no range (infinite): nothing near, or nothing measured",
    ),
    "limits that are too near": (
        replace(room(), range_max=np.full(COUNT, 0.5, np.float32)),
        "beyond the greatest range of 0.5 m that the log tells, but look like measurements; --range 0 5 takes them",
    ),
    "limits that are too far": (
        replace(room(), range_min=np.full(COUNT, 10.0, np.float32)),
        "(below range_min): limits 10 to 12 m (--range, --range-unit)",
    ),
    "limits the other way round": (
        replace(room(), range_min=np.full(COUNT, 12.0, np.float32), range_max=np.full(COUNT, 0.1, np.float32)),
        "limits 12 to 0.1 m (--range, --range-unit)",
    ),
    "no beams": (raw_sweeps(np.zeros((COUNT, 0))), "the sweeps of /scan have no beams"),
    "angle_max": (
        replace(room(), angle_max=np.full(COUNT, 2 * np.pi)),
        "angle_max of /scan is 360.00 deg, by angle_increment 179.00 deg: that is used (40 of 40 sweeps)",
    ),
    "arrays that PlotJuggler has cut": (
        replace(
            room(),
            ranges=np.tile(room().ranges, 2)[:, :500],
            beams=np.full(COUNT, 500, np.int32),
            angle_increment=np.full(COUNT, 0.005),
            angle_max=np.full(COUNT, np.pi),
        ),
        "that is used, for 500 of 1,258 beams are there: PlotJuggler cuts arrays (40 of 40 sweeps)",
    ),
    "twice": (
        room().rows(np.repeat(np.arange(COUNT), 2)),
        "40 of 80 sweeps of /scan have stamp and ranges of the sweep before: --every 2 takes each once",
    ),
    "coarse stamps": (
        stamped(lambda k: START + k // 10 * 10 * STEP),
        "36 of 40 sweeps of /scan repeat a stamp: speeds are wrong (too coarse, or two sensors)",
    ),
    "shuffled": (room().rows(np.random.default_rng(1).permutation(COUNT)), "out of order, or of two sensors"),
    "in turns": (in_turns(), "sweeps of /scan come from two sensors in turns: --every 2 may take one alone"),
    "milliseconds": (stamped(lambda k: (START + STEP * k) // 1_000_000), "stamps of /scan are 100 ns apart"),
    "an hour back": (
        stamped(lambda k: START + STEP * k - HOUR * (k >= 20)),
        "the clock of /scan starts anew: run 1 from sweep 0 (2023-11-14T22:13:20.000Z), run 2 from sweep 20 "
        "(2023-11-14T21:13:22.000Z); path and tracks end at each, --run takes one",
    ),
    "a year ahead": (
        stamped(lambda k: START + STEP * k + 365 * 24 * HOUR * (k >= 20)),
        "stamps of /scan leap ahead by 365 days: the clock was set",
    ),
    "none with a stamp": (
        stamped(lambda k: 0 * k),
        "no sweep of /scan has a stamp: the times at which they were recorded are taken for them",
    ),
    "some without a stamp": (
        stamped(lambda k: np.where(k % 20 == 3, 0, START + STEP * k)),
        "2 of 40 sweeps of /scan have no stamp: the times at which they were recorded are taken for them",
    ),
}


KINDS = {
    **dict.fromkeys(
        ("millimetres", "millimetres, limits in metres", "centimetres", "centimetres, near", "degrees"), ("units", "error")
    ),
    **dict.fromkeys(("no steps", "no beams"), ("geometry", "error")),
    **dict.fromkeys(("angle_max", "arrays that PlotJuggler has cut"), ("geometry", "warning")),
    **dict.fromkeys(("no range", "nothing near"), ("no_return", "warning")),
    "limits that are too near": ("limits", "warning"),
    "limits that are too far": ("too_close", "error"),
    "limits the other way round": ("limits", "error"),
    "twice": ("duplicate", "warning"),
    "in turns": ("frames", "error"),
    **dict.fromkeys(("coarse stamps", "shuffled", "milliseconds"), ("clock", "error")),
    **dict.fromkeys(("an hour back", "a year ahead", "none with a stamp", "some without a stamp"), ("clock", "warning")),
}
"""Name of what is odd → rule and level of its finding."""


@pytest.mark.parametrize("name", ODD)
def test_what_is_odd_is_told_in_one_line(name: str) -> None:
    block, words = ODD[name]
    for _ in read_batches(FakeLog([block]), ReadOptions(), report := ReadReport()):
        pass
    (found,) = report.findings()
    assert (found.id, found.level) == KINDS[name]
    assert words in found.message


@pytest.mark.parametrize("rows", [1, 2, 3, 7])
@pytest.mark.parametrize("name", ODD)
def test_blocks_and_batches_do_not_matter(name: str, rows: int) -> None:
    block, _ = ODD[name]
    blocks = [block.rows(slice(k, k + rows)) for k in range(0, len(block), rows)]
    assert notes(*blocks, batch_size=3 * rows) == notes(block)
    # As `info` tells it, which passes blocks as they come.
    whole, parts = ScanChecks(), ScanChecks()
    for doubts, each in ((whole, [block]), (parts, blocks)):
        numbers = np.split(np.arange(len(block)), np.cumsum([len(part) for part in each])[:-1])
        for part, sweep in zip(each, numbers, strict=True):
            doubts.add(part, normalise(part, sweep, RangeRules()))
    assert told(parts) == told(whole)
    assert told(whole)


def told(doubts: ScanChecks) -> list[str]:
    doubts.report_to(report := ReadReport())
    return report.doubted()


def test_nothing_is_told_of_what_is_right() -> None:
    reach = room()
    reach.ranges[:, :340] = np.inf
    clockwise = bearings(np.pi, -TURN / 360)
    moving = room(400)
    for k in range(400):
        moving.ranges[k] = np.roll(moving.ranges[k], 3 * k)
    last = room().angle_min + 359 * room().angle_increment
    pause = stamped(lambda k: START + STEP * k + (k > 30) * HOUR // 2)
    late = stamped(lambda k: START + STEP * k - (k == 7) * (STEP + 7_000_000))
    four = raw_sweeps(np.ones((COUNT, 4)), angle_increment=TURN / 4)
    for block in (room(), reach, clockwise, moving, replace(room(), angle_max=last), pause, late, four):
        assert notes(block) == []
    # What the driver writes for "no return" is no range, whatever it is.
    marked = room()
    marked.ranges[:, 40:] = 65535.0
    assert notes(marked) == []


def test_the_way_out_ends_the_doubt() -> None:
    assert notes(ODD["twice"][0], every=2) == []
    assert notes(ODD["in turns"][0], every=2) == []
    hour = room().rows(np.arange(2, COUNT))
    shifted = replace(hour, stamp_ns=hour.stamp_ns - HOUR * (np.arange(COUNT - 2) >= 18))
    for run, count in ((1, 18), (2, 20)):
        batches = read_batches(FakeLog([shifted]), ReadOptions(run=run), report := ReadReport())
        assert sum(map(len, batches)) == count
        assert report.doubted() == []
    ahead = ODD["a year ahead"][0]
    (line,) = notes(ahead)
    assert "--end 2024-11-13T22:13:22Z takes what was before, --start 2024-11-13T22:13:22Z what came after" in line
    assert notes(ahead, start=as_time("2024-11-13T22:13:22Z")) == []
    nothing = ODD["no range"][0]
    (line,) = notes(nothing, rules=RangeRules(no_return=frozenset({"nan"})))
    assert "--no-return" not in line
    limits = RangeRules(limits=(0.1, 12.0))
    assert notes(ODD["limits that are too near"][0], rules=limits) == []


@pytest.mark.parametrize("every", [1, 2, 3])
def test_equal_stamps_of_text_are_too_coarse_however_few_are_read(every: int) -> None:
    """Readers of text put a nanosecond between them, so that poses find their sweeps."""
    (line,) = notes(stamped(lambda k: START + k), every=every)
    read = -(-COUNT // every)
    assert line.startswith(f"{read - 1} of {read} sweeps of /scan repeat a stamp")


@pytest.mark.parametrize(("times", "way"), [(2, "--every 2"), (3, "--every 3"), (5, "--every 5")])
def test_every_takes_each_once_where_all_are_there_as_often(times: int, way: str) -> None:
    copies = room().rows(np.repeat(np.arange(COUNT), times))
    (line,) = notes(copies)
    assert line.startswith(f"{COUNT * (times - 1)} of {COUNT * times} sweeps of /scan have stamp and ranges")
    assert line.endswith(f": {way} takes each once")
    assert notes(copies, every=times) == []
    # Where one is missing it does not, and nothing else does.
    for rows in (slice(1, None), [*range(10), *range(11, COUNT * times)], [*range(COUNT * times), -1]):
        odd = copies.rows(np.arange(COUNT * times)[rows])
        (line,) = notes(odd)
        assert line.endswith("have stamp and ranges of the sweep before")


def test_each_topic_and_frame_is_looked_at_by_itself() -> None:
    block = scaled(1000, 1000)
    (line,) = notes(replace(block, topic="/rear"), room())
    assert line == f"most ranges of /rear {MILLIMETRES}"
    # Two sensors with frames of their own may share a topic.
    mixed = replace(in_turns(), frame_ids=("left", "right"), frame=np.arange(2 * COUNT, dtype=np.int32) % 2)
    assert notes(mixed) == []
    assert notes(replace(mixed, ranges=mixed.ranges * 1000)) == [
        f"most ranges of /scan (frame {frame}) {MILLIMETRES}" for frame in ("left", "right")
    ]


def test_a_new_name_in_every_message_is_no_way_to_fill_the_memory() -> None:
    doubts = ScanChecks()
    for k in range(MOST + 5):
        block = replace(raw_sweeps(np.zeros((1, 0))), topic=f"/scan{k}")
        doubts.add(block, normalise(block, np.arange(1), RangeRules()))
    doubts.report_to(report := ReadReport())
    assert len(report.doubts) == MOST


@pytest.mark.parametrize("name", ["run.mcap", "run.bag", "run.db3"])
def test_angle_max_of_messages(name: str, tmp_path: Path) -> None:
    encoding = "ros1" if name == "run.bag" else "cdr"
    geometry = (-1.5, 3.0, 0.01, 0.0, 0.0, 0.05, 12.0)
    data = [scan([1.0, 2.0, 3.0], encoding=encoding, sec=k + 1, geometry=geometry) for k in range(3)]
    path = written(name, tmp_path, {"/scan": (LASERSCAN, data)})
    with pytest.warns(UserWarning, match=r"angle_max of /scan is 171\.89 deg, by .* -84\.80 deg: .* \(3 of 3 sweeps\)"):
        assert sum(map(len, lidarcli.read(path))) == 3


@pytest.mark.parametrize("suffix", ["mcap", "bag", "db3", "csv", "clf", "jsonl"])
def test_a_step_of_degrees_is_no_step_of_radians(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run.{suffix}"
    write_log(path, [bearings(-180.0, 1.0)])
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert list(lidarcli.read(path)) == []
    (line,) = (str(each.message) for each in told if "CSV layout" not in str(each.message))
    assert line.endswith(f": 40 messages left out: {IN_DEGREES}")


@pytest.mark.parametrize("suffix", ["mcap", "bag", "db3"])
def test_steps_that_are_said_to_be_degrees_are_so_in_every_part(suffix: str, tmp_path: Path) -> None:
    paths, block = [tmp_path / f"{name}.{suffix}" for name in "ab"], bearings(-180.0, 1.0)
    for seconds, path in zip((0, 100), paths, strict=True):
        later = seconds * 1_000_000_000
        write_log(path, [replace(block, stamp_ns=block.stamp_ns + later, record_ns=block.record_ns + later)])
    batches = [*lidarcli.read([*map(str, paths)], join=True, degrees=True)]
    assert sum(map(len, batches)) == 80
    assert np.allclose(batches[0].angle_increment, np.deg2rad(1.0))


@pytest.mark.parametrize("suffix", ["mcap", "bag", "db3", "jsonl", "csv", "clf"])
@pytest.mark.parametrize(("unit", "factor"), [("mm", 1000), ("cm", 100)])
def test_the_unit_of_ranges_is_that_of_any_log(suffix: str, unit: Any, factor: float, tmp_path: Path) -> None:
    path = tmp_path / f"run.{suffix}"
    write_log(path, [scaled(factor, factor)])
    (batch,) = lidarcli.read(path, range_unit=unit)
    expected = room()
    assert np.allclose(batch.ranges, expected.ranges, atol=1e-5)
    assert np.allclose(batch.range_max, expected.range_max)
    # Many a driver has its limits in metres all the same.
    path = tmp_path / f"metres.{suffix}"
    write_log(path, [scaled(factor)])
    (batch,) = lidarcli.read(path, range_unit=unit)
    assert np.allclose(batch.ranges, expected.ranges, atol=1e-5)
    assert np.allclose(batch.range_max, expected.range_max)


def test_points_of_clouds_have_no_unit_to_choose() -> None:
    doubts, block = ScanChecks(clouds=["/scan"]), scaled(1000)
    doubts.add(block, normalise(block, np.arange(COUNT), RangeRules()))
    assert told(doubts) == ["most ranges of /scan are beyond 200 m: the points of the clouds are probably not in metres"]


@pytest.mark.parametrize("stamp", [START, 0])
def test_stamps_that_are_all_equal(stamp: int) -> None:
    block = replace(room(), stamp_ns=np.full(COUNT, stamp), record_ns=np.full(COUNT, stamp))
    assert notes(block) == ["all 40 sweeps of /scan have one stamp: tracks cannot tell what moves"]
    assert notes(block.rows(slice(1))) == []


def test_a_window_counts_from_a_first_sweep_without_a_stamp() -> None:
    """As of a simulation, whose clock is not known yet when it begins."""
    stamps = 3_000_000_000 + STEP * np.arange(COUNT)
    stamps[0] = 0
    block = replace(room(), stamp_ns=stamps, record_ns=START + STEP * np.arange(COUNT))
    (batch,) = read_batches(FakeLog([block]), ReadOptions(start=0.95, end=2.05), ReadReport())
    assert batch.sweep.tolist() == [*range(10, 21)]
    assert batch.seconds[0] == pytest.approx(1.0)


def test_a_sensor_that_hangs_is_found_however_sweeps_are_cut() -> None:
    """Ranges are repeated from 0.6 s after their first sweep on, where they have noise; rounding to millimetres is none."""
    noise = np.random.default_rng(5).normal(0.0, 0.005, (40, 90)).astype(np.float32)
    noise[10:30] = noise[10]
    wall = (2.0 / np.cos(np.linspace(-0.7, 0.7, 90))).astype(np.float32)
    hung = raw_sweeps(wall + noise, angle_min=-0.7, angle_increment=1.4 / 89)
    still = raw_sweeps(np.tile(np.round(wall, 3), (40, 1)), angle_min=-0.7, angle_increment=1.4 / 89)
    for raw, expected in ((hung, [*range(16, 30)]), (still, [])):
        for size in (1, 7, 40):
            doubts, found = ScanChecks(), []
            for first in range(0, 40, size):
                some = raw.rows(slice(first, min(first + size, 40)))
                batch = normalise(some, np.arange(first, first + len(some)), RangeRules())
                found += (first + np.flatnonzero(doubts.add(some, batch))).tolist()
            assert found == expected
            report = ReadReport()
            doubts.report_to(report)
            told = [each.message for each in report.findings() if each.id == "observed"]
            line = "14 of 40 sweeps of /scan repeat an older one bit for bit: the driver hung"
            assert told == ([line] if expected else [])


def added(doubts: ScanChecks, raw: RawSweeps) -> list[int]:
    return np.flatnonzero(doubts.add(raw, normalise(raw, np.arange(len(raw)), RangeRules()))).tolist()


@pytest.mark.parametrize("turns", [1, 2, 3, 8])
def test_a_sensor_that_hangs_may_send_old_sweeps_in_turns(turns: int) -> None:
    ranges = 2.0 + np.random.default_rng(6).normal(0.0, 0.005, (60, 90)).astype(np.float32)
    ranges[20:] = ranges[20 + np.arange(40) % turns]
    # Each is first repeated when half a second has passed.
    assert added(ScanChecks(), raw_sweeps(ranges)) == [*range(20 + max(6, turns), 60)]


def test_sweeps_without_noise_repeat_old_ones_while_the_sensor_moves() -> None:
    """A simulation may stand; the told poses of this one go on from the 30th sweep."""
    raw = raw_sweeps(np.full((60, 90), 1.0, np.float32))
    begin = int(raw.stamp_ns[30])
    asked = []

    def went(topic: str, frame: str, since_ns: Int64, stamp_ns: Int64) -> Bool:
        asked.append((topic, frame))
        assert (since_ns == raw.stamp_ns[0]).all()
        return np.asarray(stamp_ns >= begin)

    assert added(ScanChecks(), raw) == []
    assert added(ScanChecks(went=went), raw) == [*range(30, 60)]
    assert set(asked) == {("/scan", "laser")}


@pytest.mark.parametrize(("beams", "told"), [(40, False), (140, True)])
def test_zeros_over_a_wide_view_are_told(beams: int, told: bool) -> None:
    ranges = np.full((40, 360), 3.0, np.float32)
    ranges[:, 100 : 100 + beams] = 0.0
    (line,) = notes(raw_sweeps(ranges)) or ("",)
    assert (
        line.startswith(
            "/scan: in 100% of the sweeps up to 140 degrees in a row are 0 or senseless: nothing there, or blind"
        )
        == told
    )
    assert not notes(raw_sweeps(ranges), rules=RangeRules(no_return=frozenset({"inf"})))


def test_sweeps_that_differ_in_one_beam_repeat_nothing() -> None:
    ranges = np.full((40, 360), 3.0, np.float32)
    ranges[np.arange(40), 3 + np.arange(40)] = 2.0
    raw, found = raw_sweeps(ranges), LogStats()
    found.add(raw, normalise(raw, np.arange(40), RangeRules()))
    assert (found.repeats, found.compared) == (0, 40)
    found.add(raw.rows(slice(39, 40)), normalise(raw.rows(slice(39, 40)), np.arange(1), RangeRules()))
    assert found.repeats == 1


def lists(*beams: int) -> str:
    """A CSV with a list of so many ranges for each sweep."""
    return "time,ranges\n" + "".join(f'{k},"{[1.0 + 0.01 * k] * many}"\n' for k, many in enumerate(beams, 1))


def wide(*beams: int) -> str:
    """A CSV with a column for each range; short rows are damage where most are alike."""
    rows = (",".join([str(k), *[f"{1.0 + 0.01 * k}"] * many]) for k, many in enumerate(beams, 1))
    return ",".join(["time", *(f"r{beam}" for beam in range(max(beams)))]) + "\n" + "\n".join(rows) + "\n"


def rows_of(*sweeps: list[int]) -> str:
    """A CSV with a row for each beam: time, number, range."""
    return "time,beam,range\n" + "".join(f"{k},{beam},1.0{k}\n" for k, beams in enumerate(sweeps, 1) for beam in beams)


SHIFTED = "lost beams shift all bearings after them (log the angle: --columns time,angle,range)"
UNEVEN = {
    "lists": (lists(90, 87, 90, 85, 90, 90), f"2 of 6 sweeps have 85 to 87 beams, not 90: {SHIFTED}"),
    "lists, the last one cut": (lists(90, 90, 87, 90, 40), f"1 of 5 sweeps have 87 beams, not 90: {SHIFTED}"),
    "short rows": (wide(88, 90, 87, 90, 90, 86), f"1 of 6 sweeps have 87 beams, not 90: {SHIFTED}"),
    "places in a list": (
        rows_of([*range(20)], [*range(17)], [*range(20)], [*range(20)]),
        f"1 of 4 sweeps have 17 beams, not 20: {SHIFTED}",
    ),
}
EVEN = {
    "alike": lists(90, 90, 90),
    "the last one cut": lists(90, 90, 90, 40),
    "the first one cut": lists(40, 90, 90, 90),
    "an empty one": lists(90, 0, 90, 90),
    "numbers with gaps": rows_of([*range(20)], [*range(5), *range(7, 19)], [*range(20)], [*range(20)]),
    "bearings that are told": 'time,angle_min,angle_increment,ranges\n1,0,0.1,"[1.0, 1.1, 1.2]"\n2,0,0.1,"[1.0, 1.1]"\n'
    '3,0,0.1,"[1.0, 1.1, 1.3]"\n',
}


def geometry_of(text: str) -> list[str]:
    """What is said of the geometry of a CSV over a turn of 360 degrees."""
    log = CsvLog(io.BytesIO(text.encode()), OpenOptions(fov=2 * np.pi))
    for _ in read_batches(log, ReadOptions(), report := ReadReport()):
        pass
    return [found.message for found in report.findings() if found.id == "geometry" and found.level == "warning"]


@pytest.mark.parametrize("name", UNEVEN)
def test_lists_of_uneven_length_have_no_bearings(name: str) -> None:
    text, words = UNEVEN[name]
    assert geometry_of(text) == [f"/scan: {words}"]


@pytest.mark.parametrize("name", EVEN)
def test_lengths_that_shift_no_bearing_are_not_told(name: str) -> None:
    assert geometry_of(EVEN[name]) == []
