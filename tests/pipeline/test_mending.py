"""Each fault alone: `info` finds it, `clean --mend` mends it, other programs take the copy, all else stays."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli
from lidarcli.cli import run
from lidarcli.copying.copying import Copy, Cut, Edit, copy_log
from lidarcli.errors import NoScanError, OptionError
from lidarcli.logs import open_log
from lidarcli.logs.blocks import ScanLayout
from lidarcli.logs.registry import TopicChoice
from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.inspecting import inspect_log
from lidarcli.simulation.generate import SimulatedPoses, simulate_blocks
from lidarcli.simulation.scene import SceneSensor
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.findings import Finding
from lidarcli.sweeps.types import TURN, Float64, RawSweeps, concatenate
from tests.copying.accepting import decoded, refusals
from tests.copying.reading import Message, messages
from tests.pipeline.drawn import round_about, scene_of, standing, sweeps_of, told
from tests.places import REAL_LOGS, needs_real_logs

pytestmark = pytest.mark.usefixtures("paths_checked_once")

SECOND = 1_000_000_000
SWEEPS = 60
CONTAINERS: dict[str, tuple[str, dict[str, Any]]] = {
    "mcap": ("run.mcap", {}),
    "mcap ros1": ("run.mcap", {"encoding": "ros1"}),
    "bag": ("run.bag", {"compression": "lz4"}),
    "database": ("run.db3", {}),
    "folder": ("run", {}),
    "folder, packed": ("run", {"compression": "zstd-message"}),
}
FEW = ["mcap", "bag", "database"]


@cache
def sound() -> RawSweeps:
    """Sweeps of a parked sensor whose headers tell how long beams and sweeps take."""
    sensor = SceneSensor(beams=360, angle_increment=TURN / 360, noise=0.01, time_increment=0.1 / 360)
    scene = replace(scene_of(standing, sensor), sweeps=SWEEPS)
    return concatenate([block.raw for block in simulate_blocks(scene, SWEEPS, 0)])


Change = Callable[[RawSweeps], RawSweeps]


def scaled(**factors: float) -> Change:
    return lambda raw: replace(
        raw, **{name: (getattr(raw, name) * factor).astype(getattr(raw, name).dtype) for name, factor in factors.items()}
    )


def same(**values: float) -> Change:
    return lambda raw: replace(raw, **{name: np.full(SWEEPS, value, np.float32) for name, value in values.items()})


def filled(value: float) -> Change:
    some = np.random.default_rng(5).random((SWEEPS, 360)) < 0.2
    return lambda raw: replace(raw, ranges=np.where(some, np.float32(value), raw.ranges))


def lit_in_reverse(raw: RawSweeps) -> RawSweeps:
    """Some beams at one side are without a return; intensities are 0 at the other side."""
    ranges = raw.ranges.copy()
    ranges[:, 20:40] = np.inf
    return replace(
        raw, ranges=ranges, intensities=np.where(np.isfinite(ranges), np.float32(47.0), np.float32(0.0))[:, ::-1]
    )


def motor(raw: RawSweeps) -> RawSweeps:
    """A motor whose speed varies: some turns have fewer beams, further apart."""
    beams = np.where(np.arange(SWEEPS) % 3 == 2, 352, 360).astype(np.int32)
    step = TURN / beams
    seen = np.stack(
        [
            np.interp(np.arange(360) * each, np.arange(360) * TURN / 360, row)
            for each, row in zip(step, raw.ranges, strict=True)
        ]
    )
    return replace(
        raw,
        beams=beams,
        angle_increment=step,
        ranges=seen.astype(np.float32),
        time_increment=(0.1 / beams).astype(np.float32),
    )


def cut_short(raw: RawSweeps) -> RawSweeps:
    return replace(raw, beams=np.where(np.arange(SWEEPS) % 7 == 3, 200, 360).astype(np.int32))


def disordered(raw: RawSweeps) -> RawSweeps:
    """Some sweeps come after the next one, and one three sweeps early."""
    order = np.arange(SWEEPS)
    for first in (5, 12, 20, 33, 40):
        order[[first, first + 1]] = first + 1, first
    order[50:54] = 53, 50, 51, 52
    return replace(raw.rows(order), record_ns=raw.record_ns)


def clockless(raw: RawSweeps) -> RawSweeps:
    return replace(raw, stamp_ns=np.zeros(SWEEPS, np.int64), record_ns=raw.stamp_ns)


def once(raw: RawSweeps) -> RawSweeps:
    return replace(raw, stamp_ns=np.full(SWEEPS, raw.stamp_ns[0]), record_ns=raw.stamp_ns)


def later(raw: RawSweeps) -> RawSweeps:
    return replace(raw, record_ns=raw.record_ns + 2 * SECOND)


def coarse(raw: RawSweeps) -> RawSweeps:
    return replace(raw, stamp_ns=raw.stamp_ns // SECOND * SECOND, record_ns=raw.stamp_ns)


def named(name: str) -> Change:
    return lambda raw: replace(raw, frame_ids=(name,))


def wrong_end(topic: str, number: int, data: bytes, layout: ScanLayout) -> bytes:
    """`angle_max` one step further, as drivers write that take the number of beams for that of steps."""
    place = int(layout.place[0]) - 4 - 28 + 4
    end = struct.pack(f"{layout.kind[0]}f", np.float32(-np.pi + TURN))
    return data[:place] + end + data[place + 4 :]


@dataclass(frozen=True)
class Fault:
    """A fault, the rule that finds it, the word that mends it, and what of a message it changes."""

    rule: str
    word: str
    change: Change = lambda raw: raw
    edit: Edit | None = None
    refused: str = ""
    """By whom sweeps with it are refused; empty where no program does."""
    restores: bool = True
    """True if the mended messages are those of the sound log."""


FAULTS = {
    "beams by motor": Fault("geometry", "beams", motor, refused="slam_toolbox: beams", restores=False),
    "cut short": Fault("geometry", "beams", cut_short, refused="slam_toolbox: beams", restores=False),
    "disorder": Fault("clock", "stamps", disordered, refused="message filters: stamps"),
    "angle_max": Fault("geometry", "angles", edit=wrong_end),
    "milliseconds": Fault("rolling", "times", scaled(time_increment=1000.0), refused="laser_geometry: times"),
    "microseconds": Fault("rolling", "times", scaled(time_increment=1e-3, scan_time=1e-3)),
    "millimetres": Fault(
        "units",
        "units",
        scaled(ranges=1000.0, range_min=1000.0, range_max=1000.0),
        refused="slam_toolbox: limits",
        restores=False,
    ),
    "no limits": Fault("limits", "limits", same(range_min=0.0, range_max=0.0), refused="AMCL: range_max", restores=False),
    "intensities": Fault("intensity", "intensities", lit_in_reverse, restores=False),
    "near limit": Fault("limits", "limits", same(range_max=4.0), restores=False),
    "zeros": Fault("no_return", "no-return", filled(0.0), refused="AMCL: no return", restores=False),
    "range_max": Fault("no_return", "no-return", filled(12.0), restores=False),
    "no frame": Fault("frames", "frames", named(""), refused="tf2: frame"),
    "slash": Fault("frames", "frames", named("/laser"), refused="tf2: frame"),
    "no stamps": Fault("clock", "clock", clockless, refused="message filters: stamps"),
    "one stamp": Fault("clock", "clock", once, refused="message filters: stamps"),
    "seconds": Fault("clock", "clock", coarse, refused="message filters: stamps", restores=False),
    "another clock": Fault("clock", "clock", later, restores=False),
}


def written(path: Path, kind: str, raw: list[RawSweeps], edit: Any = None, poses: SimulatedPoses | None = None) -> Path:
    """A log of a container, whose messages are edited."""
    name, options = CONTAINERS[kind]
    plain = path / "plain" / name
    plain.parent.mkdir(exist_ok=True)
    write_log(plain, raw, poses=poses, **options)
    if edit is None:
        return plain
    with open_log(str(plain)) as log:
        copy_log(log, path / name, Copy(edit))
    return path / name


def findings_of(path: Path, *, deep: bool = False) -> tuple[Finding, ...]:
    return inspect_log(Source(str(path), path.name), deep=deep).findings


def mended(path: Path, *words: str) -> Path:
    out = path.with_name(f"mended{path.suffix}")
    lidarcli.clean(path, out, remove="none", mend=list(words) or "found", overwrite=not path.is_dir())
    return out


def plain_data(found: list[Message]) -> list[bytes]:
    return [each.data for each in found]


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("kind", FEW)
def test_a_fault_is_found_mended_and_found_no_more(fault: str, kind: str, tmp_path: Path) -> None:
    it = FAULTS[fault]
    log = written(tmp_path, kind, [it.change(sound())], it.edit)
    (found,) = findings_of(log)
    assert (found.id, found.mend) == (it.rule, it.word)
    assert (refusals(log) == set()) is (it.refused == "")
    assert it.refused in {"", *refusals(log)}
    out = mended(log)
    assert findings_of(out) == ()
    assert refusals(out) == set()
    before, after = messages(log), messages(out)
    assert [replace(each, data=b"") for each in before] == [replace(each, data=b"") for each in after]
    if it.restores:
        (tmp_path / "sound").mkdir()
        truth = messages(written(tmp_path / "sound", kind, [sound()]))
        for wanted, got in zip(decoded(truth), decoded(after), strict=True):
            assert wanted.ranges.tobytes() == got.ranges.tobytes()
            assert (wanted.header.stamp, wanted.header.frame_id) == (got.header.stamp, got.header.frame_id)
            names = ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
            assert [getattr(wanted, each) for each in names] == pytest.approx([getattr(got, each) for each in names])
    named_alone = tmp_path / f"alone{log.suffix}"
    lidarcli.clean(log, named_alone, remove="none", mend=it.word)
    assert plain_data(messages(named_alone)) == plain_data(after)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CONTAINERS)
def test_a_log_without_faults_keeps_every_byte(kind: str, tmp_path: Path) -> None:
    log = written(tmp_path, kind, [sound()])
    words = ("beams", "stamps", "angles", "times", "limits", "no-return", "frames", "clock")
    assert messages(mended(log)) == messages(log)
    lidarcli.clean(log, tmp_path / f"all{log.suffix}", remove="none", mend=words)
    assert messages(tmp_path / f"all{log.suffix}") == messages(log)


@pytest.mark.parametrize("fault", ["zeros", "range_max"])
def test_only_beams_without_a_return_change(fault: str, tmp_path: Path) -> None:
    log = written(tmp_path, "mcap", [FAULTS[fault].change(sound())])
    value = 0.0 if fault == "zeros" else 12.0
    for before, after in zip(decoded(messages(log)), decoded(messages(mended(log, "no-return"))), strict=True):
        empty = before.ranges == value
        assert np.isposinf(after.ranges[empty]).all()
        assert before.ranges[~empty].tobytes() == after.ranges[~empty].tobytes()


def test_sweeps_of_the_usual_number_stay_and_others_get_their_nearest_beams(tmp_path: Path) -> None:
    log = written(tmp_path, "mcap", [motor(sound())])
    before, after = decoded(messages(log)), decoded(messages(mended(log, "beams")))
    assert {len(each.ranges) for each in after} == {360}
    for number, (old, new) in enumerate(zip(before, after, strict=True)):
        if number % 3 != 2:
            assert old.ranges.tobytes() == new.ranges.tobytes()
            continue
        bearing = new.angle_min + np.arange(360) * new.angle_increment
        nearest = np.rint((bearing - old.angle_min) / old.angle_increment).astype(int) % 352
        assert new.ranges.tobytes() == old.ranges[nearest].tobytes()
        assert new.time_increment * 359 == pytest.approx(old.time_increment * 351, rel=0.01)
    (tmp_path / "short").mkdir()
    short = decoded(messages(mended(written(tmp_path / "short", "mcap", [cut_short(sound())]), "beams")))
    assert np.isnan(short[3].ranges[200:]).all()
    assert short[3].ranges[:200].tobytes() == sound().ranges[3, :200].tobytes()


def interlaced(phases: int, fewer: int) -> Change:
    """Every `phases`-th sweep lies on the beams of the first, the others between them, with fewer beams."""

    def change(raw: RawSweeps) -> RawSweeps:
        phase, step = np.arange(SWEEPS) % phases, TURN / 360
        first = raw.angle_min + phase / phases * step
        beams = np.where(phase > 0, 360 - fewer, 360).astype(np.int32)
        return replace(raw, angle_min=first, beams=beams)

    return change


@pytest.mark.parametrize(("phases", "fewer"), [(2, 1), (4, 1), (3, 40)])
def test_sweeps_between_the_beams_of_others_keep_their_bearings(phases: int, fewer: int, tmp_path: Path) -> None:
    log = written(tmp_path, "mcap", [interlaced(phases, fewer)(sound())])
    [found] = [each for each in findings_of(log) if each.id == "geometry"]
    assert (found.mend == "") is (fewer < 40)
    copy = decoded(messages(mended(log, "beams")))
    assert len({len(after.ranges) for after in copy}) == 1
    for before, after in zip(decoded(messages(log)), copy, strict=True):
        was, now = (each.angle_min + each.angle_increment * np.arange(len(each.ranges)) for each in (before, after))
        for bearing, value in zip(now, after.ranges, strict=True):
            nearest = int(np.argmin(np.abs(was - bearing)))
            if np.isfinite(value):
                assert abs(was[nearest] - bearing) < 1e-5
                assert before.ranges[nearest] == value


@pytest.mark.parametrize("kind", FEW)
def test_angles_in_degrees_become_radians(kind: str, tmp_path: Path) -> None:
    half = replace(sound(), angle_min=np.full(SWEEPS, -90.0), angle_increment=np.full(SWEEPS, 0.5))
    log = written(tmp_path, kind, [half])
    assert [(each.id, each.mend) for each in findings_of(log)] == [("units", "units")]
    out = mended(log)
    assert "units" not in {each.id for each in findings_of(out)}
    for before, after in zip(decoded(messages(log)), decoded(messages(out)), strict=True):
        assert before.ranges.tobytes() == after.ranges.tobytes()
        angles = after.angle_min, after.angle_max, after.angle_increment
        assert np.degrees(angles) == pytest.approx([-90.0, 89.5, 0.5], abs=1e-4)


def test_millimetres_beside_limits_in_metres(tmp_path: Path) -> None:
    log = written(tmp_path, "mcap", [scaled(ranges=1000.0)(sound())])
    assert [(each.id, each.mend) for each in findings_of(log)] == [("units", "units")]
    out = mended(log)
    assert findings_of(out) == ()
    assert {scan.range_max for scan in decoded(messages(out))} == {12.0}


def test_ranges_of_no_certain_unit_are_left(tmp_path: Path) -> None:
    """Some ranges are beyond what centimetres reach, and most are not: both units are likely."""
    raw = scaled(ranges=100.0, range_min=100.0, range_max=1000.0)(sound())
    raw.ranges[:, :36] = 1500.0 + np.arange(36)
    log = written(tmp_path, "mcap", [raw])
    assert [(each.id, each.mend) for each in findings_of(log)] == [("units", "")]


def test_centimetres_become_metres(tmp_path: Path) -> None:
    log = written(tmp_path, "mcap", [scaled(ranges=100.0, range_min=100.0, range_max=100.0)(sound())])
    assert [(each.id, each.mend) for each in findings_of(log)] == [("units", "units")]
    assert findings_of(mended(log)) == ()


def test_headers_that_say_anything_are_mended_without_a_warning(tmp_path: Path) -> None:
    """One beam without a step, angles that no float32 can tell, stamps of the far future."""
    raw = sound()
    beams = np.where(np.arange(SWEEPS) == 3, 1, 360).astype(np.int32)
    step = np.where(np.arange(SWEEPS) == 3, 0.0, raw.angle_increment)
    first = np.where(np.arange(SWEEPS) == 9, 3.4e38, raw.angle_min)
    late = np.where(np.arange(SWEEPS) == 12, ((1 << 31) - 1) * SECOND, raw.stamp_ns)
    odd = replace(raw, beams=beams, angle_increment=step, angle_min=first, stamp_ns=late, record_ns=raw.stamp_ns)
    words = ("beams", "stamps", "angles", "times", "order", "limits", "no-return", "frames", "clock")
    out = mended(written(tmp_path, "mcap", [odd]), *words)
    assert {len(each.ranges) for each in decoded(messages(out))} == {360}


# --- logs of a drive ------------------------------------------------------------------------------------------


def drive(*, tf: bool = False, late: float = 0.0) -> SimulatedPoses:
    times = 1_700_000_000 * SECOND + np.rint(np.arange(-10, 210) * 0.1 * SECOND).astype(np.int64)
    return replace(told(round_about(np.arange(-10, 210) * 0.1), times, tf=tf), stamp_ns=times + round(late * SECOND))


def clear(raw: RawSweeps) -> RawSweeps:
    return replace(raw, ranges=np.where(raw.ranges < raw.range_min[:, None], np.float32(np.inf), raw.ranges))


def turning(seconds: Float64) -> Float64:
    turn = 0.8 * seconds
    return np.column_stack([1.5 * np.cos(turn), 1.2 * np.sin(turn), turn + 0.5 * np.pi + np.sin(2.0 * seconds)])


@pytest.mark.slow
@pytest.mark.parametrize("kind", FEW)
def test_a_delay_of_the_poses_goes_into_the_stamps(kind: str, tmp_path: Path) -> None:
    log = written(tmp_path, kind, [clear(each) for each in sweeps_of(scene_of())], poses=drive(late=0.3))
    (found,) = findings_of(log)
    assert (found.id, found.mend) == ("delay", "stamps")
    assert found.fix is not None
    name, value = found.fix.text.split()
    assert (name, lidarcli.info(log, pose_delay=float(value))[0]["findings"]) == ("--pose-delay", [])
    out = mended(log)
    assert findings_of(out) == ()
    assert refusals(out) == set()
    shifts = {
        stamp_of(new) - stamp_of(old) for old, new in zip(decoded(messages(log)), decoded(messages(out)), strict=True)
    }
    assert len(shifts) == 1
    assert abs(shifts.pop() * 1e-9 - 0.3) < 0.011


def stamp_of(scan: Any) -> int:
    return int(scan.header.stamp.sec) * SECOND + int(scan.header.stamp.nanosec)


TURNING = SceneSensor(beams=360, angle_increment=TURN / 360, noise=0.01, time_increment=0.09 / 359)


@pytest.mark.slow
def test_stamps_of_the_last_beam_become_those_of_the_first(tmp_path: Path) -> None:
    scene = scene_of(turning, TURNING)
    sweeps = [replace(clear(each), stamp_ns=each.stamp_ns + 9 * SECOND // 100) for each in sweeps_of(scene)]
    times = sweeps[0].record_ns[0] + np.rint(np.arange(-10, 210) * 0.1 * SECOND).astype(np.int64)
    log = written(tmp_path, "mcap", sweeps, poses=told(turning(np.arange(-10, 210) * 0.1), times))
    assert ("stamp", "stamps") in {(each.id, each.mend) for each in findings_of(log, deep=True)}
    out = mended(log)
    assert "stamp" not in {each.id for each in findings_of(out, deep=True)}
    assert refusals(out) == set()
    for sweep, scan in zip(sweeps, decoded(messages(out)), strict=True):
        assert abs(stamp_of(scan) - int(sweep.stamp_ns[0]) + 9 * SECOND // 100) < SECOND // 100


@pytest.mark.slow
@pytest.mark.parametrize("kind", FEW)
def test_beams_in_the_wrong_order(kind: str, tmp_path: Path) -> None:
    sensor = SceneSensor(beams=360, angle_min=-np.pi + np.pi / 360, angle_increment=TURN / 360, noise=0.01)
    sweeps = [clear(each) for each in sweeps_of(scene_of(sensor=sensor))]
    wrong = [replace(each, ranges=each.ranges[:, ::-1].copy()) for each in sweeps]
    log = written(tmp_path, kind, wrong, poses=drive())
    assert ("mirror", "order") in {(each.id, each.mend) for each in findings_of(log, deep=True)}
    out = mended(log)
    assert findings_of(out, deep=True) == ()
    assert refusals(out) == set()
    for before, after in zip(decoded(messages(log)), decoded(messages(out)), strict=True):
        assert before.ranges.tobytes() == after.ranges.tobytes()
        assert (after.angle_min, after.angle_increment) == (-before.angle_min, -before.angle_increment)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("word", "options", "added"), [("order", [], "mirror"), ("stamps", ["--pose-delay", "-0.4"], "delay")]
)
def test_what_would_fit_less_is_left_out_by_name(
    word: str, options: list[str], added: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sensor = SceneSensor(beams=360, angle_min=-np.pi + np.pi / 360, angle_increment=TURN / 360, noise=0.01)
    sweeps = [clear(each) for each in sweeps_of(scene_of(sensor=sensor))]
    cut = [replace(each, frame_ids=("/laser",)) for each in sweeps]
    log = written(tmp_path, "mcap", cut, poses=drive())
    out = str(tmp_path / "out.mcap")
    assert run(["clean", str(log), "-o", out, "--remove", "none", "--mend", f"{word},frames", *options]) == 0
    assert re.search(rf"{word} is not mended: .* {added}", " ".join(capsys.readouterr().err.split()))
    (tmp_path / "want").mkdir()
    want = written(tmp_path / "want", "mcap", sweeps, poses=drive())
    assert plain_data(messages(tmp_path / "out.mcap")) == plain_data(messages(want))


def test_stamps_of_one_second_keep_the_clock_that_poses_share(tmp_path: Path) -> None:
    def coarsely(raw: RawSweeps) -> RawSweeps:
        return replace(raw, stamp_ns=raw.stamp_ns // SECOND * SECOND, record_ns=raw.stamp_ns + 40 * SECOND)

    log = written(tmp_path, "mcap", [coarsely(each) for each in sweeps_of(scene_of())], poses=drive())
    for before, after in zip(decoded(messages(log)), decoded(messages(mended(log, "clock"))), strict=True):
        assert abs(stamp_of(before) + SECOND // 2 - stamp_of(after)) < SECOND


def halves(tmp_path: Path, kind: str) -> tuple[Path, Path]:
    """The two parts of a recording, of which the first alone has the static transforms."""
    name, options = CONTAINERS[kind]
    suffix, whole = Path(name).suffix, tmp_path / f"whole{Path(name).suffix}"
    write_log(whole, [clear(each) for each in sweeps_of(scene_of())], poses=drive(tf=True), **options)
    first, second = tmp_path / f"trip_0{suffix}", tmp_path / f"trip_1{suffix}"
    middle = 1_700_000_010 * SECOND
    with open_log(str(whole)) as log:
        parts = [(first, Cut(((0, middle),))), (second, Cut(((middle, 1 << 62),), frozenset({"/tf_static"})))]
        copy_log(log, parts, Copy())
    return first, second


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["mcap", "mcap ros1", "bag", "database"])
def test_static_transforms_of_the_first_part(kind: str, tmp_path: Path) -> None:
    first, second = halves(tmp_path, kind)
    (found,) = findings_of(second)
    assert (found.id, found.mend) == ("frames", "statics")
    out = mended(second)
    assert findings_of(out) == ()
    assert refusals(out) == set()
    statics = [each for each in messages(first) if each.topic == "/tf_static"]
    before, after = messages(second), messages(out)
    assert (after[0].topic, after[0].data) == ("/tf_static", statics[0].data)
    assert plain_data(after[1:]) == plain_data(before)


# --- what is asked for, and refused ---------------------------------------------------------------------------


def test_mending_and_removing_together_is_mending_first(tmp_path: Path) -> None:
    log = written(tmp_path, "mcap", [FAULTS["microseconds"].change(sound())])
    table = lidarcli.clean(log, tmp_path / "both.mcap", mend="times", remove="agents")
    assert table["log"].unique().to_pylist() == ["run"]
    assert findings_of(tmp_path / "both.mcap") == ()


def test_limits_and_the_mask_of_the_robot_are_written(tmp_path: Path) -> None:
    log = written(tmp_path, "mcap", [sound()])
    (tmp_path / "robot.toml").write_text("[[mask]]\ncircle = { x = 4.0, y = 0.0, radius = 0.5 }\n")
    out = tmp_path / "out.mcap"
    lidarcli.clean(log, out, remove="none", mend="limits", range=(0.2, 9.0), mask=tmp_path / "robot.toml")
    for before, after in zip(decoded(messages(log)), decoded(messages(out)), strict=True):
        assert (after.range_min, after.range_max) == pytest.approx((0.2, 9.0))
        gone = np.isnan(after.ranges)
        assert 5 < np.count_nonzero(gone) < 30
        assert before.ranges[~gone].tobytes() == after.ranges[~gone].tobytes()


@pytest.mark.parametrize(("order", "increment"), [("forward", 0.1 / 360), ("reverse", 0.0), ("once", 0.0)])
def test_beams_that_are_not_taken_forward_are_told_to_be_taken_at_once(
    order: str, increment: float, tmp_path: Path
) -> None:
    log = written(tmp_path, "bag", [FAULTS["microseconds"].change(sound())])
    lidarcli.clean(log, tmp_path / "out.bag", remove="none", mend="times", beam_order=order)
    for scan in decoded(messages(tmp_path / "out.bag")):
        assert (scan.time_increment, scan.scan_time) == pytest.approx((increment, 0.1))


def test_messages_that_hold_more_than_a_laser_scan_stay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def longer(topic: str, number: int, data: bytes, layout: ScanLayout) -> bytes:
        return data + bytes(8) if number == 7 else data

    log, out = written(tmp_path, "mcap", [named("")(sound())], longer), tmp_path / "out.mcap"
    assert run(["clean", str(log), "-o", str(out), "--remove", "none", "--mend", "frames"]) == 0
    assert "1 message of /scan not mended: more or less than a LaserScan" in capsys.readouterr().err
    before, after = plain_data(messages(log)), plain_data(messages(out))
    assert [number for number in range(SWEEPS) if before[number] == after[number]] == [7]


def test_a_delay_that_is_given_goes_into_the_stamps(tmp_path: Path) -> None:
    log = written(tmp_path, "bag", [sound()])
    lidarcli.clean(log, tmp_path / "out.bag", remove="none", mend="stamps", pose_delay=-0.05)
    pairs = zip(decoded(messages(log)), decoded(messages(tmp_path / "out.bag")), strict=True)
    assert {stamp_of(after) - stamp_of(before) for before, after in pairs} == {-SECOND // 20}


def test_each_run_of_a_log_is_put_in_order_and_can_be_cut(tmp_path: Path) -> None:
    raw, order = sound(), np.arange(SWEEPS)
    order[[10, 11, 40, 41]] = 11, 10, 41, 40
    first = np.arange(SWEEPS) < 30
    stamps = np.where(first, raw.stamp_ns, raw.stamp_ns - 60 * SECOND)[order]
    log = written(tmp_path, "mcap", [replace(raw, stamp_ns=stamps, record_ns=raw.record_ns)])
    out = tmp_path / "out.mcap"
    lidarcli.clean(log, out, remove="none", mend="stamps")
    assert [stamp_of(each) for each in decoded(messages(out))] == [
        *np.where(first, raw.stamp_ns, raw.stamp_ns - 60 * SECOND)
    ]
    lidarcli.clean(log, tmp_path / "second.mcap", remove="none", run=2)
    assert messages(tmp_path / "second.mcap") == messages(log)[30:]
    with pytest.raises(NoScanError, match=r"^--run 3: the log holds 2 runs"):
        lidarcli.clean(log, tmp_path / "third.mcap", remove="none", run=3)


def test_a_clock_that_the_poses_share_is_left(tmp_path: Path) -> None:
    log = written(tmp_path, "mcap", [later(each) for each in sweeps_of(scene_of())], poses=drive())
    assert {each.mend for each in findings_of(log) if each.id == "clock"} == {""}
    with pytest.raises(OptionError, match=r"^/scan: clock cannot be mended: the poses have the same clock"):
        lidarcli.clean(log, tmp_path / "out.mcap", remove="none", mend="clock")


def test_beams_of_two_sensors_on_one_topic_are_not_put_on_one_grid(tmp_path: Path) -> None:
    raw = cut_short(sound())
    log = written(tmp_path, "mcap", [replace(raw, frame_ids=("a", "b"), frame=np.arange(SWEEPS, dtype=np.int32) % 2)])
    with pytest.raises(OptionError, match=r"^/scan: beams cannot be mended: several sensors send on it"):
        lidarcli.clean(log, tmp_path / "out.mcap", remove="none", mend="beams")


def test_messages_that_are_no_laser_scan_of_ros_are_refused(tmp_path: Path) -> None:
    write_log(tmp_path / "run.mcap", [sound()])
    from tests.text_logs import write_log as write_any

    write_any(tmp_path / "proto.mcap", [sound()], encoding="protobuf")
    with pytest.raises(OptionError, match=r"^/scan: only a LaserScan of ROS is mended, and this is a foxglove\.LaserScan"):
        lidarcli.clean(tmp_path / "proto.mcap", tmp_path / "out.mcap", remove="none", mend="angles")
    with pytest.raises(OptionError, match=r"^statics cannot be mended: no earlier part beside .*run\.mcap has /tf_static$"):
        lidarcli.clean(tmp_path / "run.mcap", tmp_path / "out.mcap", remove="none", mend="statics")
    assert run(["clean", str(tmp_path / "run.mcap"), "-o", str(tmp_path / "o.mcap"), "--mend", "angels"]) == 2


def test_info_names_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = written(tmp_path, "mcap", [scaled(time_increment=1e-3)(filled(0.0)(sound()))])
    assert run(["info", str(log)]) == 0
    line = capsys.readouterr().out.splitlines()[-1].strip()
    out = log.with_name("run.mended.mcap")
    assert line == f"lidarcli clean {log} -o {out} --mend times,no-return"
    assert run(line.split()[1:]) == 0
    assert findings_of(out) == ()
    assert "/scan: no-return 60, times 60" in capsys.readouterr().err


# --- real recordings ------------------------------------------------------------------------------------------

REAL = {
    "datmo/overtake_ego.bag": "frames",
    "datmo/parallel.bag": "frames drift mount",
    "leg_tracker/negative_2.bag": "too_close*3 body*3",
    "leg_tracker/positive_1_extracted.bag": "too_close gaps pace",
    "obstacle_detector/scans_demo.bag": "no_return*2 too_close*2",
    "real_clients/irs_a1scan.db3": "",
    "ros2_selfdriving/circular_bag_framed_0522/circular_bag_framed_0.db3": "gaps",
    "scan_tools/laser_scan_matcher_demo.bag": "",
    "pr2/mylaserdata.bag": "no_return",
}
"""Public recording → what is still found in its mended copy."""


@pytest.mark.slow
@needs_real_logs
@pytest.mark.parametrize("path", REAL)
def test_what_is_left_of_public_recordings(path: str, tmp_path: Path) -> None:
    from collections import Counter

    log, out = REAL_LOGS / path, tmp_path / f"out{Path(path).suffix}"
    lidarcli.clean(log, out, remove="none", mend="found")
    found = Counter(each.id for each in findings_of(out))
    assert " ".join(rule if n == 1 else f"{rule}*{n}" for rule, n in found.items()) == REAL[path]
    with open_log(str(log)) as before, open_log(str(out)) as after:
        topics = TopicChoice(None, before.topics()).chosen
        assert topics == TopicChoice(None, after.topics()).chosen
