"""Text of RPLIDAR sensors as the SDK prints it, as frame_grabber saves it, and as Python programs write it down."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import OpenOptions, ReadReport
from lidarcli.logs.csv import CsvLog as AnyCsvLog
from lidarcli.logs.csv.beam_rows import LISTED, MEASURED, PRINTED, SAVED
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import RawSweeps, Status, concatenate
from tests.logs.watched import CsvLog
from tests.sweeping import raw_sweeps
from tests.text_logs import write_rplidar

Beam = tuple[int, float, float]
"""Quality, bearing [deg, clockwise], distance [mm]."""
PREAMBLE = (
    "Ultra simple LIDAR data grabber for SLAMTEC LIDAR.\nVersion: 2.0.0\nSLAMTEC LIDAR S/N: 0123456789ABCDEF\n"
    "Firmware Ver: 1.29\nHardware Rev: 7\nSLAMTEC Lidar health status : 0\n"
)


def turn(beams: int = 40, far: float = 2000.0, first: float = 0.0) -> list[Beam]:
    """One turn of even bearings in 64ths of a degree, one beam of it without a return."""
    found = [(15, first + 360 / beams * n, far + n) for n in range(beams)]
    found[7] = (0, found[7][1], 0.0)
    return found


def printed(turns: Sequence[Sequence[Beam]]) -> str:
    return "".join(
        f"{'  ' if place else 'S '} theta: {angle:03.2f} Dist: {far:08.2f} Q: {quality} \n"
        for beams in turns
        for place, (quality, angle, far) in enumerate(beams)
    )


def measured(turns: Sequence[Sequence[Beam]]) -> str:
    return "".join("\t".join(map(str, (not place, *beam))) + "\n" for beams in turns for place, beam in enumerate(beams))


def listed(turns: Sequence[Sequence[Beam]]) -> str:
    return "".join(f"{list(beams)}\n" for beams in turns)


def saved(turns: Sequence[Sequence[Beam]]) -> str:
    return "".join(
        f"#RPLIDAR SCAN DATA\n#COUNT={len(beams)}\n#Angule\tDistance\tQuality\n"
        + "".join(f"{angle:.4f} {far:.1f} {quality}\n" for quality, angle, far in beams)
        for beams in turns
    )


def bare(turns: Sequence[Sequence[Beam]]) -> str:
    return "".join(f"{quality} {angle} {far}\n" for beams in turns for quality, angle, far in beams)


SPELLINGS: dict[str, Callable[[Sequence[Sequence[Beam]]], str]] = {
    PRINTED: printed,
    MEASURED: measured,
    LISTED: listed,
    SAVED: saved,
}
TURNS = [turn(far=far) for far in (2000.0, 2500.0, 3000.0)]


def read(text: str | bytes, options: OpenOptions | None = None) -> tuple[RawSweeps, CsvLog]:
    data = text.encode() if isinstance(text, str) else text
    with CsvLog(io.BytesIO(data), options) as log:
        return concatenate(list(log.scans())), log


def sound(text: str | bytes) -> RawSweeps:
    """The sweeps of a text of which nothing is lost."""
    got, log = read(text)
    assert (log.report.damage, log.report.refused) == ([], {})
    assert log.format in ("csv (RPLIDAR)", "csv (RPLIDAR, one file per sweep)")
    return got


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_every_spelling_is_mirrored_and_in_metres(spelling: str) -> None:
    got = sound(SPELLINGS[spelling](TURNS))
    assert got.beams.tolist() == [40] * 3
    # 9 degrees further clockwise are 9 degrees less counter-clockwise.
    np.testing.assert_allclose(np.degrees(got.angle_increment), [-9.0] * 3, rtol=0, atol=1e-12)
    np.testing.assert_allclose(got.angle_min, [0.0] * 3, rtol=0, atol=1e-12)
    want = np.array([[far / 1000 for _, _, far in beams] for beams in TURNS], np.float32)
    np.testing.assert_array_equal(got.ranges, want)
    batch = normalise(got, np.arange(3), RangeRules())
    assert batch.status[:, 7].tolist() == [Status.NO_RETURN] * 3
    assert got.stamp_ns.tolist() == [0, 0, 0]


def test_other_ways_to_write_the_same() -> None:
    want = sound(measured(TURNS)).ranges
    tuples = measured(TURNS).replace("\t", ", ")
    for text in (
        PREAMBLE + printed(TURNS),
        tuples,
        "".join(f"({line})\n" for line in tuples.splitlines()),
        "new_scan,quality,angle,distance\n" + tuples.replace(" ", ""),
        "#RPLIDAR SCAN DATA\n#Quality Angle Distance\n" + bare(TURNS),
        "\n# my room\n" + listed(TURNS),
    ):
        np.testing.assert_array_equal(sound(text).ranges, want)


@pytest.mark.parametrize(
    "text",
    [
        "".join(f"{place % 3 > 0} {place} {2 * place}.5 {3 * place}\n" for place in range(40)),
        "".join(f"{place % 3 > 0} 15 {place * 40.5} 2000\n" for place in range(40)),
        "[(1, 2.0, 3.0), (2, 3.0, 4.0)]\n" * 40,
        "[(1000, 2.0, 2000.0), (2000, 3.0, 2000.0)]\n" * 40,
    ],
)
def test_flags_and_lists_of_other_programs_are_no_beams(text: str) -> None:
    with (
        pytest.raises(UnreadableError, match=r"text, but no table|none of the CSV layouts"),
        open_log(io.BytesIO(text.encode())),
    ):
        pass


def test_bearings_that_pass_the_front_within_a_sweep_go_on(tmp_path: Path) -> None:
    """225 to 135 degrees clockwise: from the left behind over the front to the right behind."""
    angles = [*range(225, 360, 5), *range(0, 136, 5)]
    text = printed([[(15, float(angle), 1000.0 + angle) for angle in angles]] * 2)
    got = sound(text)
    assert got.beams.tolist() == [55, 55]
    np.testing.assert_allclose(np.degrees(got.angle_min), [135.0] * 2)
    np.testing.assert_allclose(np.degrees(got.angle_increment), [-5.0] * 2)
    assert got.ranges[0, :2].tolist() == [np.float32(1.225), np.float32(1.23)]
    # The simulator writes sweeps like this one.
    whole = raw_sweeps(np.full((2, 55), 1.5, np.float32), angle_min=np.radians(-135), angle_increment=np.radians(5))
    write_rplidar(tmp_path / "run.txt", [whole])
    written = (tmp_path / "run.txt").read_text()
    assert "theta: 225.00" in written.splitlines()[0]
    again = sound(written)
    np.testing.assert_allclose(again.angle_min + 54 * again.angle_increment, whole.angle_min, atol=1e-9)


def test_a_flag_may_stand_on_the_last_beam_of_a_sorted_turn() -> None:
    """The SDK sorts beams by bearing: the beam that began the turn just before the front comes last."""
    turns = [turn(40, far, 4.5) for far in (1000.0, 2000.0, 3000.0)]
    lines = [
        f"{'S ' if place == 39 else '  '} theta: {angle:03.2f} Dist: {far:08.2f} Q: {quality} \n"
        for beams in turns
        for place, (quality, angle, far) in enumerate(beams)
    ]
    got = sound("".join(lines))
    assert got.beams.tolist() == [40] * 3
    assert got.ranges[:, 0].tolist() == [1.0, 2.0, 3.0]


def test_a_turn_whose_flag_is_lost_is_a_sweep_all_the_same() -> None:
    lines = printed(TURNS).splitlines(keepends=True)
    assert lines[40].startswith("S ")
    lines[40] = lines[40].replace("S ", "  ")
    got = sound("".join(lines))
    assert got.beams.tolist() == [40] * 3


def test_uneven_bearings_are_placed_on_a_grid_and_of_two_returns_the_nearer_counts() -> None:
    random = np.random.default_rng(3)
    turns = []
    for _ in range(4):
        angles = np.sort((np.arange(0, 360, 0.9) + random.uniform(-0.25, 0.25, 400)) % 360)
        turns.append([(15, float(angle), 2000.0) for angle in np.round(angles * 64) / 64])
    # Beside beam 100: nearer, farther, and without a return.
    close = turns[0][100][1]
    turns[0][101:101] = [(15, close + 1 / 64, 1500.0), (15, close + 2 / 64, 2500.0), (0, close + 3 / 64, 0.0)]
    got, log = read(measured(turns))
    assert log.report.refused == {}
    assert any("placed on a grid" in note for note in log.report.notes)
    assert len(got) == 4
    seen = got.ranges[np.isfinite(got.ranges) & (got.ranges > 0)]
    assert sorted(set(seen.tolist())) == [1.5, 2.0]
    assert (seen == 1.5).sum() == 1
    batch = normalise(got, np.arange(4), RangeRules())
    bearing = got.angle_min[0] + got.angle_increment[0] * int(np.flatnonzero(batch.ranges[0] == 1.5)[0])
    assert abs(np.degrees(-bearing) - close) < 0.9


def test_turns_of_different_length_and_beams_left_out() -> None:
    """`iter_scans` keeps returns alone."""
    some = [[beam for beam in beams if beam[2]][:count] for beams, count in zip(TURNS, (39, 30, 12), strict=True)]
    got = sound(listed(some))
    assert got.beams.tolist() == [40, 31, 13]
    assert np.isnan(got.ranges[:, 7]).all()


@pytest.mark.parametrize("spelling", [PRINTED, MEASURED])
def test_a_recording_that_begins_and_ends_within_a_turn(spelling: str) -> None:
    lines = SPELLINGS[spelling](TURNS).splitlines(keepends=True)
    got = sound("".join(lines[30:95]))
    assert got.beams.tolist() == [10, 40, 15]
    np.testing.assert_allclose(np.degrees(got.angle_min), [90.0, 0.0, 0.0], atol=1e-12)


def test_bad_lines_are_named_and_cost_their_beam_alone() -> None:
    lines = printed(TURNS).splitlines()
    lines[50] = "   theta: 90.00 Dist: 0"
    lines[60] = "Failed to grab"
    lines[70] = "   theta: 1x.00 Dist: 01000.00 Q: 47 "
    got, log = read("\n".join(lines) + "\n")
    assert [damage.place for damage in log.report.damage] == ["line 51", "line 61", "line 71"]
    assert len(got) == 3
    seen = [row[:beams] for row, beams in zip(got.ranges, got.beams.tolist(), strict=True)]
    assert [int((np.isfinite(row) & (row > 0)).sum()) for row in seen] == [39, 36, 39]


def test_a_bad_list_costs_its_sweep() -> None:
    lines = listed(TURNS).splitlines()
    lines[1:1] = ["None", lines[0][:100], "[]"]
    got, log = read("\n".join(lines) + "\n")
    assert len(got) == 3
    assert [damage.place for damage in log.report.damage] == ["line 2", "line 3"]
    assert log.report.damage[0].cause == "'None' is no list of beams"
    lines[4] = lines[4].replace("2503.0", "far")
    got, log = read("\n".join(lines) + "\n")
    assert [(damage.place, damage.cause) for damage in log.report.damage][2:] == [("line 5", "'far' is not a number")]
    assert len(got) == 3
    assert np.flatnonzero(np.isnan(got.ranges[1])).tolist() == [3]


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_cut_anywhere_what_is_read_is_the_beginning(spelling: str) -> None:
    turns = [turn(36, 2000.0 + 100 * n) for n in range(6)]
    text = SPELLINGS[spelling](turns)
    whole = sound(text)
    for size in range(len(text) // 3, len(text), 41):
        got, log = read(text[:size])
        full = len(got) - 1
        np.testing.assert_array_equal(got.ranges[:full], whole.ranges[:full])
        # The beams of the last sweep are the first ones of the whole one; a cut number cannot be told.
        last = int(got.beams[full]) - 1
        np.testing.assert_array_equal(got.ranges[full, :last], whole.ranges[full, :last])
        assert len(log.report.damage) <= 1


def test_a_folder_of_saved_turns_is_one_log(tmp_path: Path) -> None:
    for number, beams in enumerate(TURNS):
        (tmp_path / f"{number + 100}.txt").write_text(saved([beams]))
    report = ReadReport()
    with open_log(tmp_path) as log:
        assert log.format == "csv (one file per sweep)"
        got = concatenate(list(log.scans(None, report)))
    assert report.damage == []
    assert got.stamp_ns.tolist() == [100_000_000_000, 101_000_000_000, 102_000_000_000]
    np.testing.assert_array_equal(got.ranges[:, 0], np.array([2.0, 2.5, 3.0], np.float32))
    (tmp_path / "101.txt").write_text(printed(TURNS))
    report = ReadReport()
    with open_log(tmp_path) as log:
        assert [int(stamp) for block in log.scans(None, report) for stamp in block.stamp_ns] == [10**11, 102 * 10**9]
    assert [(damage.place, damage.cause) for damage in report.damage] == [
        ("101.txt", "csv (RPLIDAR), not one sweep (bearing, range)")
    ]
    for name in ("100.txt", "102.txt"):
        (tmp_path / name).write_text(printed(TURNS))
    with pytest.raises(UnreadableError, match="is a log of its own"):
        AnyCsvLog(tmp_path)


def test_hostile_text_is_bounded() -> None:
    for text in (
        "[(15, 1.0, 2000.0), " + "(15, 1.0, 2000.0), " * 50_000,
        "[(15, 1.0, 2000.0)]\n" + "[(" * 100_000,
        "S  theta: 1.00 Dist: 1.00 Q: 1 \n" + "   theta: " * 100_000,
        "   theta: 1.00 Dist: 1.00 Q: 1 \n" * 450_000,
        "#RPLIDAR SCAN DATA\n" * 1000 + "#Angle Distance\n" + "1e999 1e999\n" * 100 + "nan nan\n" * 100,
        "True\t1\t1" + "0" * 400 + "\t2000\n" + "True\t1\t1\t2000\n" * 10,
    ):
        with open_log(io.BytesIO(text.encode())) as log:
            report = ReadReport()
            assert sum(int(block.beams.max(initial=0) > 400_000) for block in log.scans(None, report)) == 0
        assert report.damage or report.refused


def test_a_column_of_times() -> None:
    def text(time: Callable[[float], str]) -> str:
        rows = (f"{9 * (k % 40)} {2000 + k % 40} 15 {time(k / 400)}\n" for k in range(120))
        return "#RPLIDAR SCAN DATA\n#Angle Distance Quality Time\n" + "".join(rows)

    got = sound(text(lambda seconds: f"{1.7e9 + seconds:.4f}"))
    assert (got.stamp_ns - got.stamp_ns[0]).tolist() == [0, 100_000_000, 200_000_000]
    got, log = read(text(lambda seconds: "noon"))
    assert got.stamp_ns.tolist() == [0, 0, 0]
    assert log.report.unread == {
        "/scan": "times of column `time` are not understood (noon): stamps are 0, tracks cannot tell what moves"
    }
