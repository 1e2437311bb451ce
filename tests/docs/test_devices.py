"""docs/devices.md: what drivers send, and what lidarcli makes of it.

`python -m tests.docs.test_devices` writes the page anew, from tests/docs/devices.toml.
"""

from __future__ import annotations

import io
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

import lidarcli
from lidarcli.logs.base import ReadReport
from lidarcli.logs.registry import open_log
from lidarcli.ros.messages import ros2_definition
from lidarcli.simulation.generate import simulate_blocks, simulate_odometry
from lidarcli.simulation.scene import load_scene
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.types import STATUSES, SweepBatch, concatenate
from tests.devices import DRIFT, OPEN, POST, RADIUS, SENT, TURN, Sent
from tests.logs.scan_messages import scan
from tests.places import REAL_LOGS, ROOT, needs_real_logs
from tests.test_deskew import SCENE

START_NS = 1_700_000_000_000_000_000
TURNS = 20
BEARING = np.degrees(np.arctan2(POST[1], POST[0]))
PAGE = ROOT / "docs" / "devices.md"


@dataclass(frozen=True)
class Driver:
    """A driver: what its source says, and what lidarcli makes of what it sends (tests/docs/devices.toml)."""

    name: str
    source: str
    order: str
    none: str
    stamp: str
    times: str
    intensities: str
    faults: str
    period: float
    empty: str
    lasts: float
    found: tuple[str, ...] = ()
    askew: float = 0.0
    bright: float | None = None
    taken: str = ""
    late: bool = False
    advice: str = ""
    range: tuple[float, float] | None = None


_RECORDS = tomllib.loads((Path(__file__).parent / "devices.toml").read_text(encoding="utf-8"))["driver"]
DRIVERS = {each["name"]: Driver(**{**each, "found": tuple(each.get("found", ()))}) for each in _RECORDS}
HABITS = sorted({(driver.taken, driver.late) for driver in DRIVERS.values() if driver.taken})

HEAD = """# Devices and drivers

What drivers put into a LaserScan, by their sources, and what lidarcli makes of it. No device was at hand: tests write
messages as the sources do, of a room with a post and an opening, and hold lidarcli to the second table; recordings of
rplidar_ros, an LMS 1xx, Stage and Gazebo agree.
`python -m tests.docs.test_devices` writes the page anew from `tests/docs/devices.toml`, which names the repository, the
commit and the files that were read for each driver. What holds for any sensor is in [formats](formats.md#sweeps).

## What is sent

"""
MADE = """
## What lidarcli makes of it

The findings are those of [`info`](info.md#findings); `geometry` is of angle_max, which is not used, or of the number of
beams. A sweep takes its share of the period, by the header. *Askew* is by how much too large a bearing the post is told at:
so the message says.

"""
LEARNED = """
Headers are often wrong about time. Where the robot turns enough, lidarcli learns from the sweeps in which order the beams
were taken ([poses](poses.md#a-sweep-takes-time)), and whether stamps are those of the end: `delay`, and with `--deep` also
`stamp`, tell the option.

"""
SOURCES = """
## Known faults

"""
TAIL = """
## Not looked at

Devices and their firmware. Other branches and releases than those named, `ldlidar_sl`, `ldlidar_ros2`, the single-beam and
solid-state models of YDLIDAR, NAV 350, several layers of MRS 1000 and LMS 1000, the last RaySensor of Gazebo classic,
rotating lidars of Webots, the order in time of velodyne_laserscan, Neato, Webots and Isaac Sim.
"""


def table(names: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines: list[tuple[str, ...]] = [names, ("---",) * len(names), *rows]
    return "".join(f"| {' | '.join(cells)} |\n" if cells[0] != "---" else f"|{'|'.join(cells)}|\n" for cells in lines)


def made(driver: Driver) -> tuple[str, ...]:
    found = ", ".join(f"`{name}`" for name in driver.found)
    takes = f"{driver.lasts / driver.period:.0%}" if driver.lasts else "no time"
    return (
        *(driver.name, driver.empty.replace("_", " "), takes, found),
        *(f"{driver.askew:+.1f}°" if driver.askew else "", driver.advice),
    )


def page() -> str:
    drivers = list(DRIVERS.values())
    sent = [(each.name, each.order, each.none, each.stamp, each.times, each.intensities) for each in drivers]
    learned = [
        (
            ", ".join(each.name for each in drivers if (each.taken, each.late) == habit),
            f"`{habit[0]}`",
            "`delay`, `stamp`: give `--pose-delay`" if habit[1] else "",
        )
        for habit in HABITS
    ]
    return "".join(
        (
            HEAD,
            table(("driver", "beams", "no return", "stamp", "`time_increment`, `scan_time`", "intensities"), sent),
            MADE,
            table(
                ("driver", "beams without a return", "a sweep takes", "findings", "askew", "to know"),
                [made(each) for each in drivers],
            ),
            LEARNED,
            table(("drivers", "`beam_order`", "findings"), learned),
            SOURCES,
            table(("driver", "known faults"), [(each.name, each.faults) for each in drivers]),
            TAIL,
        )
    )


def write(path: Path, turns: list[list[Sent]], period: float) -> Path:
    """A log of ROS 2 of the messages of turns, each recorded 20 ms after its stamp."""
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start("ros2", "a test")
    kind = f"sensor_msgs/msg/{'LaserScan' if turns[0][0].echoes is None else 'MultiEchoLaserScan'}"
    schema = writer.register_schema(kind, "ros2msg", ros2_definition(kind).encode())
    channel = writer.register_channel("/scan", "cdr", schema)
    for turn, messages in enumerate(turns):
        for each in messages:
            stamp_ns = START_NS + round((turn * period + each.after) * 1e9)
            sec, nsec = divmod(stamp_ns, 10**9)
            more: dict[str, Any] = {**each._asdict(), "sec": sec, "nsec": nsec}
            del more["after"]
            writer.add_message(channel, stamp_ns + 20_000_000, scan(more.pop("ranges"), **more), stamp_ns)
    writer.finish()
    path.write_bytes(stream.getvalue())
    return path


def sweeps(log: Path, **options: Any) -> SweepBatch:
    (batch,) = lidarcli.read(log, **options)
    return batch


def findings(log: Path, **options: Any) -> tuple[str, ...]:
    (told,) = lidarcli.info(log, **options)
    assert not told["damage"]
    return tuple(each["id"] for each in told["findings"])


def test_the_page_is_that_of_the_records() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run `python -m tests.docs.test_devices`"
    assert list(SENT) == list(DRIVERS)
    assert len(PAGE.read_bytes()) < 12_000


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", DRIVERS)
def test_what_is_sent_is_read_as_the_page_says(name: str, tmp_path: Path) -> None:
    driver = DRIVERS[name]
    log = write(tmp_path / "run.mcap", [SENT[name](turn) for turn in range(TURNS)], driver.period)
    assert findings(log) == driver.found
    batch = sweeps(log)
    assert len(batch) == TURNS
    theta = (batch.bearings + np.pi) % TURN - np.pi
    inside = (theta > OPEN[0] + 0.03) & (theta < OPEN[1] - 0.03) & (batch.status < len(STATUSES))
    assert {STATUSES[code] for code in batch.status[inside]} == {driver.empty}
    lasts = np.zeros(TURNS) if batch.duration is None else batch.duration
    np.testing.assert_allclose(lasts[1:], driver.lasts, rtol=0.01)
    rows = lidarcli.detect(log, range=driver.range).to_pylist()
    posts = [row for row in rows if np.hypot(row["x"] - POST[0], row["y"] - POST[1]) < 0.3]
    assert [row["sweep"] for row in posts] == [*range(TURNS)]
    off = [(row["theta_i"] + row["theta_f"]) / 2 - row["sweep"] * DRIFT for row in posts]
    assert np.degrees(np.mean(off)) - BEARING == pytest.approx(driver.askew, abs=0.05)
    assert np.mean([row["r_min"] for row in posts]) == pytest.approx(np.hypot(*POST) - RADIUS, abs=0.02)
    assert {row["intensity"] for row in posts} == {driver.bright}


def test_the_echoes_are_those_of_laser_proc(tmp_path: Path) -> None:
    turns = [SENT["laser_proc"](turn) for turn in range(3)]
    log = write(tmp_path / "run.mcap", turns, 0.025)
    for echo, place in (("first", 0), ("last", 1), ("strongest", 1)):
        told = [[each[place] if each else np.nan for each in turn[0].echoes or ()] for turn in turns]
        np.testing.assert_array_equal(sweeps(log, echo=echo).ranges, np.array(told, np.float32))


def test_no_return_and_the_first_time_of_isaac_sim(tmp_path: Path) -> None:
    """Beams without a hit are no return by an option, and the first time of SRTX is not believed."""
    turns = [SENT["Isaac Sim (RTX)"](turn) for turn in range(3)]
    for number, (each,) in enumerate(turns):
        first, _, step, seconds, *others = each.geometry
        geometry = (first, first + 359 * step, step, seconds if number else np.inf, *others)
        turns[number] = [each._replace(geometry=geometry)]
    batch = sweeps(write(tmp_path / "run.mcap", turns, 0.1), no_return="inf,zero,max,above,pile,negative")
    assert {STATUSES[code] for code in np.unique(batch.status)} == {"valid", "no_return"}
    assert batch.duration is not None
    np.testing.assert_allclose(batch.duration, [0.0, 0.09972, 0.09972], rtol=1e-3)


RECORDED = {
    "rplidar_ros (ros2)": "real_clients/irs_a1scan.db3",
    "sick_scan_xd (TiM, LMS)": "sick/rms_1xxx_lms_1xx_movement_off.bag",
    "stage_ros, stage_ros2": "robots_ii/mylaserdata_20151128.bag",
    "gazebo_ros_pkgs (classic)": "my_gazebo_tutorials/20_53_49/rosbag2_2024_11_22-20_53_49_0.db3",
}
"""Driver → a recording of it."""


@needs_real_logs
@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDED)
def test_recordings_are_as_the_sources_say(name: str) -> None:
    with open_log(str(REAL_LOGS / RECORDED[name])) as log:
        raw = next(log.scans(None, ReadReport()))
    (made,) = SENT[name](1)
    assert raw.time_increment is not None
    assert raw.scan_time is not None
    times = np.column_stack([raw.time_increment, raw.scan_time])
    without = {
        "rplidar_ros (ros2)": np.isposinf(raw.ranges),
        "sick_scan_xd (TiM, LMS)": raw.ranges == 0.0,
        "stage_ros, stage_ros2": raw.ranges >= raw.range_max[:, None],
        "gazebo_ros_pkgs (classic)": np.isposinf(raw.ranges),
    }[name]
    assert np.isfinite(raw.ranges[~without]).all()
    assert without.any()
    assert (times > 0.0).all() == (times > 0.0).any() == (made.geometry[4] > 0.0)
    if name == "stage_ros, stage_ros2":
        assert (raw.ranges > raw.range_max[:, None]).any()
    if name == "rplidar_ros (ros2)":
        first, _, step, *_, least, most = made.geometry
        shape = raw.beams[0], raw.angle_min[0], raw.angle_increment[0], raw.range_min[0], raw.range_max[0]
        assert shape == pytest.approx((len(made.ranges), first, step, least, most), rel=1e-6)
        np.testing.assert_allclose(raw.time_increment * (raw.beams - 1), raw.scan_time, rtol=1e-5)
        assert raw.intensities is not None
        assert ((raw.intensities[:, ::-1] == 0.0) == without).all()


@pytest.mark.slow
@pytest.mark.parametrize(("taken", "late"), HABITS)
def test_order_and_stamps_are_learned_where_the_robot_turns(taken: str, late: bool, tmp_path: Path) -> None:
    beams = 360
    seconds = 0.0 if taken == "once" else 0.1 / beams
    text = SCENE.format(beams=beams, increment=seconds, clockwise=str(taken == "reverse").lower())
    (tmp_path / "drive.toml").write_text(text, encoding="utf-8")
    scene = load_scene(tmp_path / "drive.toml")
    raw = concatenate([block.raw for block in simulate_blocks(scene, scene.sweeps, 0)])
    if taken == "reverse":
        # Taken clockwise, told counter-clockwise, as if the first beam of the message came first.
        last = raw.angle_min + (raw.beams - 1) * raw.angle_increment
        raw = replace(raw, ranges=raw.ranges[:, ::-1].copy(), angle_min=last, angle_increment=-raw.angle_increment)
    raw = replace(raw, stamp_ns=raw.stamp_ns + (100_000_000 if late else 0))
    log = tmp_path / "run.mcap"
    write_log(log, [raw], poses=simulate_odometry(scene, scene.sweeps, 0))
    (told,) = lidarcli.info(log, deep=True)
    assert told["scans"][0]["beam_order"] == taken
    assert [each["id"] for each in told["findings"]] == (["delay", "stamp"] if late else [])


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
