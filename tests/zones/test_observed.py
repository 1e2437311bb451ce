"""In which sweeps a zone was observed, and what a check may claim of the others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from lidarcli.simulation.generate import START_NS
from lidarcli.sweeps.types import RawSweeps
from tests.cli.maps import Run
from tests.sweeping import STEP, raw_sweeps
from tests.zones.runs import column, polygon_at, scans, watched, write_bag, zone_file

NEAR = '[[zone]]\nname = "near"\ncircle = { x = 1.0, y = 0.0, radius = 0.5 }\n'
SWEEPS = 60
NOISE = np.random.default_rng(3).normal(0.0, 0.01, (SWEEPS, 360)).astype(np.float32)


def sweeps(noise: bool = True, **columns: object) -> RawSweeps:
    """A round room of 4 m about a sensor that turns fully."""
    return raw_sweeps(4.0 + NOISE * noise, **columns)


def log_of(path: Path, raw: RawSweeps, *more: object) -> Path:
    (path / "run.bag").unlink(missing_ok=True)
    return write_bag(path / "run.bag", scans([raw]), *more)  # type: ignore[arg-type]


def changed(raw: RawSweeps, some: slice | tuple[slice, slice], values: float | np.ndarray) -> RawSweeps:
    ranges = raw.ranges.copy()
    ranges[some] = values
    return replace(raw, ranges=ranges)


DEAD = {
    "zero": (changed(sweeps(), slice(10, 40), 0.0), 30, "30 of 60 sweeps of /scan have no range at all"),
    "infinite": (changed(sweeps(), slice(10, 40), np.inf), 30, "30 of 60 sweeps of /scan have no range at all"),
    "nan": (changed(sweeps(), slice(10, 40), np.nan), 30, "30 of 60 sweeps of /scan have no range at all"),
    # The first half second of the same ranges is no older than a driver may be.
    "frozen": (changed(sweeps(), slice(10, 40), 4.0 + NOISE[10]), 24, "24 of 60 sweeps of /scan repeat an older one"),
    "hidden": (changed(sweeps(), slice(10, 40), 0.3 + NOISE[0]), 30, ""),
    "nearer than the sensor measures": (
        replace(sweeps(), range_min=np.where(np.arange(SWEEPS) < 30, 0.1, 2.0).astype(np.float32)),
        30,
        "",
    ),
}


@pytest.mark.parametrize("case", DEAD)
def test_a_check_on_less_than_everything_ends_with_3(lidarcli: Run, case: str, tmp_path: Path) -> None:
    raw, missed, note = DEAD[case]
    log = log_of(tmp_path, raw)
    words = ("zones", log, "--zones", zone_file(tmp_path, NEAR), "--no-objects", "-o", tmp_path / "out")
    ran = lidarcli(*words, "--check", "zones.near.events == 0")
    assert ran.code == 3
    assert note in ran.err
    share = f"{np.floor(1000 * (SWEEPS - missed) / SWEEPS) / 1000:g}"
    accepted = f"--check 'zones.near.observed >= {share}' accepts that"
    line = f"run: zone near was observed in {SWEEPS - missed} of 60 sweeps; {accepted}"
    assert f"lidarcli: incomplete: {line}\n" in ran.err
    events = tmp_path / "out" / "run.events.parquet"
    assert column(pq.read_table(tmp_path / "out" / "run.zones.parquet"), "observed").count(False) == missed
    for checks, code in (
        (["zones.near.events == 0"], 3),
        (["events where kind == occupied == 0"], 3),
        (["zones.near.events == 0", f"zones.near.observed >= {share}"], 0),
        (["zones.near.observed > 0.9"], 1),
    ):
        told = [word for check in checks for word in ("--check", check)]
        assert lidarcli("report", events, *told).code == code
        assert lidarcli(*words, "--overwrite", *told).code == code


@pytest.mark.parametrize(
    ("raw", "what"),
    [
        (changed(sweeps(), slice(0, 1), np.nan), "one sweep"),
        (sweeps(noise=False), "a simulation without noise that stands"),
        (changed(sweeps(), slice(0, 60), 4.0 + np.repeat(NOISE[::2], 2, axis=0)), "a driver that sends all twice"),
        (changed(sweeps(), slice(10, 50), 1.8 + NOISE[10:50]), "something that hides a part"),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_what_proves_enough(lidarcli: Run, raw: RawSweeps, what: str, tmp_path: Path) -> None:
    zone = NEAR.replace("x = 1.0", "x = 2.0")
    words = ("zones", log_of(tmp_path, raw), "--zones", zone_file(tmp_path, zone), "--no-objects")
    checks = "zones.near.observed > 0.97", "zones.near.points.max < 400"
    assert lidarcli(*words, "--check", checks[0], "--check", checks[1]).code == 0, what
    assert lidarcli(*words, "--check", checks[1]).code == 0, what


NEVER = {
    "beyond the limits": NEAR.replace("x = 1.0", "x = 9.0"),
    "more points than beams": NEAR + "min_points = 361\n",
    "more points than beams that reach it": NEAR.replace("0.5", "0.02"),
    "more sweeps than there are": NEAR + "trigger = 61\n",
    "under a mask": NEAR + "[[mask]]\ncircle = { x = 1.0, y = 0.0, radius = 0.6 }\n",
    "behind a body under a mask": NEAR + "[[mask]]\ncircle = { x = 0.0, y = 0.0, radius = 5.0 }\n",
    "a line under a mask": '[[zone]]\nname = "near"\nline = [[1.0, -0.2], [1.0, 0.2]]\n'
    "[[mask]]\ncircle = { x = 1.0, y = 0.0, radius = 0.6 }\n",
}


@pytest.mark.parametrize("case", NEVER)
def test_what_cannot_be_seen_has_nothing_to_measure(case: str, tmp_path: Path) -> None:
    raw = changed(sweeps(), slice(0, 60), np.where(np.arange(360) < 170, np.inf, 4.0 + NOISE))
    log = log_of(tmp_path, replace(raw, range_max=np.full(SWEEPS, 8.0, np.float32)))
    tables = watched(log, NEVER[case], no_objects="line" not in case)
    assert set(column(tables.zones, "observed")) == {False}


def test_a_zone_that_is_under_a_mask_in_part_is_observed(tmp_path: Path) -> None:
    mask = "[[mask]]\ncircle = { x = 1.4, y = 0.0, radius = 0.6 }\n"
    assert set(column(watched(log_of(tmp_path, sweeps()), NEAR + mask, no_objects=True).zones, "observed")) == {True}


@pytest.mark.parametrize(("half", "share"), [(2, 60), (10, 0), (20, 0)])
@pytest.mark.parametrize("value", [np.nan, -1.0, 0.05])
def test_a_zone_of_which_beams_are_lost_side_by_side_is_not_observed(
    tmp_path: Path, half: int, share: int, value: float
) -> None:
    """It spans 60 degrees, of which 4, 20 or 40 in its middle have no value: behind 4 nobody can stand."""
    ranges = 4.0 + NOISE
    ranges[:, 180 - half : 180 + half] = value
    raw = raw_sweeps(ranges, range_min=np.full(SWEEPS, 0.1, np.float32))
    tables = watched(log_of(tmp_path, raw), NEAR, no_objects=True)
    assert column(tables.zones, "observed").count(True) == share
    mask = "[[mask]]\nsector = { from = -30, to = 30, farthest = 0.2 }\n"
    assert set(column(watched(log_of(tmp_path, raw), NEAR + mask, no_objects=True).zones, "observed")) == {half < 20}


def test_beams_that_are_lost_on_both_sides_of_the_seam_lie_side_by_side(tmp_path: Path) -> None:
    ranges = 4.0 + NOISE
    ranges[:, :9] = ranges[:, -9:] = np.nan
    behind = NEAR.replace("x = 1.0", "x = -1.0")
    assert set(column(watched(log_of(tmp_path, raw_sweeps(ranges)), behind, no_objects=True).zones, "observed")) == {False}


def test_single_beams_that_flicker_lose_nothing(tmp_path: Path) -> None:
    ranges = 4.0 + NOISE
    ranges[np.random.default_rng(4).random(ranges.shape) < 0.2] = np.nan
    assert set(column(watched(log_of(tmp_path, raw_sweeps(ranges)), NEAR, no_objects=True).zones, "observed")) == {True}


LASERS = "".join(
    f'[[mount]]\nframe = "{name}"\nparent = "base_link"\nx = {x}\ny = 0\nyaw = {yaw}\n'
    for name, x, yaw in (("front", 0.3, 0), ("rear", -0.3, 180))
)
AROUND = '[[zone]]\nname = "near"\nframe = "robot"\npolygon = [[-2.5, -1.5], [0.9, -1.5], [0.9, 1.5], [-2.5, 1.5]]\n'
REAR = {
    "sound": (sweeps(), 0),
    "dead": (changed(sweeps(), slice(0, 60), 0.0), 120),
    "dead, as its least range is beyond the room": (sweeps(range_min=5.0), 120),
    "dead, as its limits are no limits": (sweeps(range_min=99.0), 120),
    "dead, as its greatest range is far too short": (sweeps(range_max=0.3), 120),
    "dead but for a few beams": (changed(sweeps(range_min=3.0), np.s_[:, 5:], 2.9), 120),
    "sound, of a short range": (changed(sweeps(range_max=2.0), np.s_[:, 90:95], 1.9), 0),
    "dead for a while": (changed(sweeps(), slice(20, 40), np.nan), 40),
    "late": (sweeps().rows(slice(30, 60)), 25),
    "silent from a second on": (sweeps().rows(slice(0, 10)), 45),
    "silent for a while": (sweeps().rows(np.r_[0:20, 38:60]), 13),
}


@pytest.mark.parametrize("frame", ["robot", "sensor"])
@pytest.mark.parametrize("case", REAR)
def test_each_sensor_has_to_observe_its_part(lidarcli: Run, case: str, frame: str, tmp_path: Path) -> None:
    """Two lasers see 180 degrees each; what only the rear one could see is lost without it."""
    rear, missed = REAR[case]
    half, both = np.arange(90, 270), []
    for name, raw in (("front", sweeps()), ("rear", rear)):
        ranges = np.ascontiguousarray(raw.ranges[:, half])
        begin = raw.angle_min + raw.angle_increment * half[0]
        beams = np.full(len(raw), 180, np.int32)
        one = replace(raw, topic=f"/{name}", frame_ids=(name,), ranges=ranges, angle_min=begin, beams=beams)
        both.append(scans([one]))
    log = write_bag(tmp_path / "run.bag", *both)
    zones = zone_file(tmp_path, LASERS + AROUND.replace("robot", frame))
    words = "zones", log, "--zones", zones, "--no-objects", "-o", tmp_path / "out"
    ran = lidarcli(*words, "--check", "zones.near.events == 0")
    is_never = (missed, frame) == (120, "robot")
    assert ran.code == (0 if not missed else 1 if is_never else 3)
    assert ("of it is lost (no usable beams, or a sensor that hangs or is silent)" in ran.err) == (
        "dead" in case or (frame == "robot" and missed > 0)
    )
    observed = column(pq.read_table(tmp_path / "out" / "run.zones.parquet"), "observed")
    if frame == "robot":
        assert observed.count(False) == pytest.approx(missed, abs=2)


def test_a_trigger_needs_sweeps_in_a_row(tmp_path: Path) -> None:
    """Every third sweep is blind: three in a row never come together."""
    ranges = 4.0 + NOISE
    ranges[::3] = np.nan
    log = log_of(tmp_path, raw_sweeps(ranges))
    for trigger, share in ((2, 40), (3, 0)):
        tables = watched(log, NEAR + f"trigger = {trigger}\n", no_objects=True)
        assert column(tables.zones, "observed").count(True) == share


def test_sweeps_that_are_missing_are_not_observed(lidarcli: Run, tmp_path: Path) -> None:
    stamps = START_NS + STEP * np.arange(SWEEPS) + np.where(np.arange(SWEEPS) < 30, 0, 40 * STEP)
    log = log_of(tmp_path, sweeps(stamp_ns=stamps))
    words = ("zones", log, "--zones", zone_file(tmp_path, NEAR), "--no-objects")
    ran = lidarcli(*words, "--check", "zones.near.events == 0")
    assert (ran.code, "zone near was observed in 60 of 100 sweeps" in ran.err) == (3, True)
    assert lidarcli(*words, "--check", "zones.near.observed == 0.6").code == 0


TOLD = """monitor:
  ros__parameters:
    base_frame_id: laser
    polygons: [a, b]
    a: {type: polygon, polygon_sub_topic: /flat, action_type: stop}
    b: {type: circle, radius: 1.0, action_type: stop}
    observation_sources: [scan]
    scan: {type: scan, topic: /scan}
"""


def test_a_zone_without_area_and_one_that_cannot_be_judged(lidarcli: Run, tmp_path: Path) -> None:
    zones = zone_file(tmp_path, TOLD, "nav2.yaml")
    line: list[tuple[float, float]] = [(1.0, 0.0), (2.0, 0.0), (3.0, 0.0)]
    flat = log_of(tmp_path, sweeps(), [polygon_at(START_NS, "laser", line, "/flat")])
    ran = lidarcli("zones", flat, "--zones", zones, "--no-objects", "--check", "zones.a.observed == 0")
    assert (ran.code, "  a  never observed" in ran.err) == (0, True)
    bare = log_of(tmp_path, sweeps())
    words = ("zones", bare, "--zones", zones, "--no-objects", "--overwrite", "-o", tmp_path)
    for check, code in (
        ("zones.b.events == 0", 0),
        ("zones.a.events == 0", 1),
        ("events where kind == occupied == 0", 3),
        ("events where zone == b == 0", 0),
    ):
        ran = lidarcli(*words, "--check", check)
        assert ran.code == code, ran.err
        assert "note     zone 'a' has no shape without /flat: give --footprint" in ran.err
        assert lidarcli("report", tmp_path / "run.events.parquet", "--check", check).code in (code, 2)
    alone = zone_file(tmp_path, TOLD.replace("[a, b]", "[a]"), "alone.yaml")
    assert lidarcli("zones", bare, "--zones", alone, "--no-objects").code == 4


@pytest.mark.parametrize("increment", [0.0, np.nan])
@pytest.mark.parametrize("more", [(), ("--no-objects",), ("--topic", "/b")])
def test_why_no_sweep_was_read_is_told(lidarcli: Run, more: tuple[str, ...], increment: float, tmp_path: Path) -> None:
    refused = sweeps(topic="/b", angle_increment=increment)
    log = write_bag(tmp_path / "run.bag", scans([refused]), scans([sweeps()]) if "/b" in more else [])
    ran = lidarcli("zones", log, "--zones", zone_file(tmp_path, NEAR), *more)
    assert ran.code == 3
    assert (
        "run.bag: no sweep has been read: the log holds none, or none from --start to --end; topic /b: 60 mess" in ran.err
    )
    sound = log_of(tmp_path, sweeps())
    assert lidarcli("zones", sound, "--zones", zone_file(tmp_path, NEAR), "--no-objects", "--start", "100").code == 4
