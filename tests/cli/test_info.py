"""`lidarcli info`: the contents of a log, and findings with their fixes, alike in every command."""

from __future__ import annotations

import argparse
import json
import math
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from lidarcli.pipeline.reading import deep
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.findings import Finding, Fix, transform_lines
from lidarcli.sweeps.masks import Mask, Masks, Mount, Sector
from tests.places import SAMPLES
from tests.sweeping import raw_sweeps, room_sweeps

Run = Callable[..., Any]
TEXT = """\
{path}
  format      mcap, compression zstd
  size        {size:,} bytes
  topics      /scan  sensor_msgs/msg/LaserScan  20
  /scan (frame laser)
    sweeps    20
    beams     360
    view      360.00 deg from -180.00 deg, step 1.0000 deg
    coverage  full turn
    limits    0.1 m to 12 m
    rate      10.00 Hz (median step)
    time      2023-11-14T22:13:20.000Z to 2023-11-14T22:13:21.900Z
    span      1.900 s
    stamps    increasing; recorded 0.050 s after the header stamp
    valid     7,180 beams (99.72%)
    no return 20 beams (0.28%)
    too close 0 beams (0.00%)
    invalid   0 beams (0.00%)
  findings
  hint     duplicate  /scan: 18 of 20 sweeps repeat the ranges before them
"""


def test_text(logs: Path, lidarcli: Run) -> None:
    path = logs / "run.mcap"
    ran = lidarcli("info", path)
    assert (ran.code, ran.err) == (0, "")
    assert ran.out == TEXT.format(path=path, size=path.stat().st_size)


def test_json(logs: Path, lidarcli: Run) -> None:
    ran = lidarcli("info", logs / "run.mcap", "--format", "json")
    assert (ran.code, ran.err) == (0, "")
    (info,) = json.loads(ran.out)
    assert info["topics"] == [{"name": "/scan", "type": "sensor_msgs/msg/LaserScan", "encoding": "cdr", "messages": 20}]
    (scan,) = info["scans"]
    assert scan.pop("field_of_view") == [pytest.approx(2 * math.pi)] * 2
    assert scan.pop("angle_min") == [pytest.approx(-math.pi)] * 2
    assert scan.pop("angle_increment") == [pytest.approx(math.radians(1))] * 2
    assert scan.pop("range_min") == [pytest.approx(0.1)] * 2
    assert scan.pop("rate") == pytest.approx(10)
    assert scan.pop("span") == pytest.approx(1.9)
    clock = scan.pop("clock")
    assert clock.pop("record_minus_header") == pytest.approx(0.05)
    assert clock == {
        "monotonic": True,
        "backward_steps": 0,
        "largest_backward_step": 0.0,
        "repeated_stamps": 0,
        "zero_stamps": 0,
    }
    assert scan == {
        "topic": "/scan",
        "frame_id": "laser",
        "sweeps": 20,
        "beams": [360, 360],
        "closure": ["closed"],
        "range_max": [12.0, 12.0],
        "start_ns": 1_700_000_000_000_000_000,
        "end_ns": 1_700_000_001_900_000_000,
        "beams_by_status": {"valid": 7180, "no_return": 20, "too_close": 0, "invalid": 0, "masked": 0},
        "pose": None,
        "pose_verdict": None,
        "pose_chain": None,
        "pose_agreement": None,
        "pose_again": None,
        "pose_drift": None,
        "pose_fit": None,
        "pose_delay": None,
        "beam_order": None,
        "made_of": None,
    }


def test_brief_is_a_line_per_log(logs: Path, tmp_path: Path, lidarcli: Run) -> None:
    empty = tmp_path / "empty.mcap"
    with empty.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.finish()
    ran = lidarcli("info", "--brief", *(logs / name for name in ("run.mcap", "two.mcap", "cut.mcap")), empty, code=3)
    run, two, cut, nothing = ran.out.splitlines()
    assert run == (
        f"{logs / 'run.mcap'}: mcap, 1.9 s from 2023-11-14T22:13:20.000Z, /scan 20 x 360 beams at 10.00 Hz, no poses, "
        "1 finding"
    )
    assert two == (
        f"{logs / 'two.mcap'}: mcap, 1.9 s from 2023-11-14T22:13:20.000Z, /front 20 x 360 beams at 10.00 Hz, "
        "/rear 20 x 360 beams at 10.00 Hz, no poses, 2 findings"
    )
    assert cut.startswith(f"{logs / 'cut.mcap'}: mcap, ")
    assert cut.endswith(", no poses, 1 finding, damaged")
    assert nothing == f"{empty}: mcap, no sweeps"


@pytest.mark.parametrize("greatest", [0.0, 0.1, np.inf, 3.4e38, 1e7])
def test_a_log_that_tells_no_greatest_range(greatest: float, tmp_path: Path, lidarcli: Run) -> None:
    ranges = np.full((2, 30), 2.0)
    write_log(tmp_path / "run.mcap", [raw_sweeps(ranges, range_min=0.15, range_max=greatest)])
    ran = lidarcli("info", tmp_path / "run.mcap")
    assert (ran.code, ran.err) == (0, "")
    (line,) = [line for line in ran.out.splitlines() if line.startswith("    limits")]
    assert line == "    limits    from 0.15 m; the log tells no greatest range"
    assert "valid     60 beams (100.00%)" in ran.out


def test_several_logs(logs: Path, lidarcli: Run) -> None:
    ran = lidarcli("info", logs, code=3)
    blocks = ran.out.split("\n\n")
    assert [block.splitlines()[0] for block in blocks] == [
        str(logs / name) for name in ("cut.mcap", "run.mcap", "two.mcap")
    ]
    assert ran.err.startswith(f"lidarcli: {logs / 'cut.mcap'}: byte ")
    assert all(len(line) <= 80 for line in blocks[1].splitlines()[1:])


@pytest.mark.parametrize("more", [(), ("--deep",)])
def test_one_topic_of_two(logs: Path, lidarcli: Run, more: tuple[str, ...]) -> None:
    both, rear = (
        json.loads(lidarcli("info", logs / "two.mcap", "--format", "json", *more, *topic).out)[0]
        for topic in ((), ("--topic", "rear"))
    )
    assert [scan["topic"] for scan in both["scans"]] == ["/front", "/rear"]
    assert rear["scans"] == both["scans"][1:]
    assert rear["topics"] == both["topics"]
    told = [one["id"] for one in both["findings"] if one["topic"] == "/front"]
    assert told
    assert {one["topic"] for one in rear["findings"]} == {"/rear"}


def test_hundreds_of_topics_do_not_hide_the_scans(tmp_path: Path, lidarcli: Run) -> None:
    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for index in range(300):
            name = f"sensor_msgs/msg/{'LaserScan' if index % 150 == 7 else 'Imu'}"
            name = "nav_msgs/msg/Odometry" if index == 250 else name
            writer.register_channel(f"/t{index:03}", "cdr", writer.register_schema(name, "ros2msg", b""))
        writer.finish()
    ran = lidarcli("info", path)
    assert (ran.code, ran.err) == (0, "")
    lines = [line[14:] for line in ran.out.splitlines()[3:]]
    assert [line.split()[0] for line in lines] == [*(f"/t{index:03}" for index in (*range(11), 157, 250)), "and", "/t250"]
    assert lines[13] == "and 287 other topics (--format json lists all)"
    (info,) = json.loads(lidarcli("info", path, "--format", "json").out)
    assert len(info["topics"]) == 300


def test_no_name_of_a_log_is_a_command_of_a_ci_server(
    tmp_path: Path, lidarcli: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for topic in ("::error file=x::y", "##[error]z"):
        Path("::warning::x.mcap").unlink(missing_ok=True)
        write_log(Path("::warning::x.mcap"), [raw_sweeps([[2.0] * 10] * 3, topic=topic)])
        ran = lidarcli("info", "::warning::x.mcap")
        lines = [line.lstrip() for line in ran.out.splitlines()]
        assert ran.code == 0
        assert lines[0] == "\\x3a:warning::x.mcap"
        assert f"\\x{ord(topic[0]):x}{topic[1:]} (frame laser)" in lines
        assert not [line for line in lines if line.startswith(("::", "##"))]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """`fine.mcap` has no finding, `odd.mcap` an error and a hint, in the working directory."""
    monkeypatch.chdir(tmp_path)
    good = room_sweeps()
    noise = np.random.default_rng(1).normal(0.0, 0.01, good.ranges.shape).astype(np.float32)
    fine = replace(good, ranges=good.ranges + noise)
    write_log(tmp_path / "fine.mcap", [fine])
    told = {name: getattr(fine, name) * np.float32(1000) for name in ("ranges", "range_min", "range_max")}
    write_log(tmp_path / "odd.mcap", [replace(fine, record_ns=fine.record_ns + 5 * 10**9, **told)])
    return tmp_path


@pytest.mark.usefixtures("folder")
def test_a_line_each(lidarcli: Run) -> None:
    ran = lidarcli("info", "odd.mcap")
    assert ran.out.splitlines()[-6:] == [
        "  findings",
        "  error    units      most ranges of /scan are beyond 1,000 m: they are probably millimetres (--range-unit mm)",
        "    fix: --range-unit mm",
        "  hint     clock      /scan: recorded 5.1 s after the stamps",
        "  to mend them in a copy:",
        "    lidarcli clean odd.mcap -o odd.mended.mcap --mend units,clock",
    ]
    assert "findings" not in lidarcli("info", "fine.mcap").out
    assert lidarcli("info", "odd.mcap", "--brief").out.endswith(" Hz, no poses, 2 findings\n")


def test_findings_that_are_alike_are_one_and_the_worst_comes_first(tmp_path: Path, lidarcli: Run) -> None:
    path, raw = tmp_path / "many.mcap", room_sweeps()
    degrees = replace(raw, angle_increment=raw.angle_increment * 14)
    write_log(
        path,
        [replace(degrees if k > 18 else raw, topic=f"/robot_{k}/scan", frame_ids=(f"/robot_{k}/l",)) for k in range(21)],
    )
    lines = lidarcli("info", path).out.partition("  findings\n")[2].splitlines()
    shown = [line for line in lines if not line.startswith("    ")]
    assert [line.split()[:2] for line in shown[:2]] == [["error", "units"]] * 2
    slash = "/robot_0/scan: tf2 takes no frame whose name begins with / (alike: /robot_1/scan, /robot_10/scan, "
    assert f"  hint     frames     {slash}/robot_11/scan, /robot_12/scan and 16 more)" in shown
    every = lidarcli("-v", "info", path).out.splitlines()
    assert sum("tf2 takes no frame" in line for line in every) == 21
    (info,) = json.loads(lidarcli("info", path, "--format", "json").out)
    assert sum("tf2 takes no frame" in each["message"] for each in info["findings"]) == 21


@pytest.mark.usefixtures("folder")
def test_findings_fill_a_screen_at_most(lidarcli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    fixes = [Fix("transform", transform_lines("base_link", f"laser_{k}", 0.1 * k, 0.0, 0.0)) for k in range(30)]
    findings = tuple(
        Finding("mount", "warning", "/scan", f"l_{k}", f"laser_{k} sits", fix=fix) for k, fix in enumerate(fixes)
    )
    monkeypatch.setattr(deep, "deep_findings", lambda *_: deep.DeepFindings(findings))
    lines = lidarcli("info", "fine.mcap", "--deep").out.partition("  findings\n")[2].splitlines()
    assert (len(lines), lines[-1]) == (31, "  and 20 more findings: lidarcli -v info ... shows all")
    assert len(lidarcli("-v", "info", "fine.mcap", "--deep").out.partition("  findings\n")[2].splitlines()) == 90


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("check", "code", "found"),
    [
        ("findings == 2", 0, ""),
        ("findings.errors == 0", 1, "1"),
        ("findings.errors == 1", 0, ""),
        ("findings.hints between 1 and 3", 0, ""),
        ("findings.too_close > 0", 1, "0"),
    ],
)
def test_checks_count_the_findings_of_all_logs(lidarcli: Run, check: str, code: int, found: str) -> None:
    ran = lidarcli("info", "fine.mcap", "odd.mcap", "--format", "json", "--check", check)
    figure, _, expected = check.partition(" ")
    words = f"lidarcli: check failed: {figure} is {found}, expected {expected}\n" if found else ""
    assert (ran.code, ran.err) == (code, words)
    assert [len(log["findings"]) for log in json.loads(ran.out)] == [0, 2]


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("check", "says"),
    [
        ("findings.eror == 0", "unknown figure 'findings.eror'; did you mean findings.errors"),
        ("sweeps > 0", "unknown figure 'sweeps'; there are "),
        ("objects where width > 1 == 0", "unknown figure 'objects'"),
        ("findings = 0", "findings = 0"),
        ("findings.flicker == 0", "only --deep looks for findings.flicker: add --deep"),
    ],
)
def test_a_check_that_means_nothing(lidarcli: Run, check: str, says: str) -> None:
    ran = lidarcli("info", "fine.mcap", "--check", check)
    assert (ran.code, ran.out) == (2, "")
    assert says in ran.err


def test_checks_of_what_cannot_be_read_do_not_pass(lidarcli: Run, logs: Path, folder: Path) -> None:
    assert lidarcli("info", logs / "cut.mcap", "--check", "findings.errors == 0").code == 3
    assert lidarcli("info", logs / "cut.mcap", "--check", "findings.errors == 1").code == 1
    (folder / "empty.csv").touch()
    lidarcli("info", "empty.csv", "fine.mcap", "--check", "findings == 0", code=3)
    assert lidarcli("info", "empty.csv", "fine.mcap", "--check", "findings == 7").code == 3
    # A background is no log in which anything could be found.
    lidarcli("background", "build", SAMPLES / "room_empty.mcap", "-o", "empty.parquet")
    assert lidarcli("info", "empty.parquet").code == 0
    ran = lidarcli("info", "empty.parquet", "--check", "findings == 0", code=3)
    assert "empty.parquet: no sweep was read, and the checks saw nothing of it" in ran.err


@pytest.mark.slow
def test_a_closer_look_reads_twice(process: Callable[..., Any], folder: Path) -> None:
    ran = process("info", "-", "--deep", input=(folder / "fine.mcap").read_bytes())
    assert (ran.returncode, ran.stdout) == (2, b"")
    assert ran.stderr.decode() == (
        "lidarcli: standard input: --deep reads a log twice, and a pipe is read only once: give the file's name\n"
    )


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--deep", "-o", "robot.json"], "-o robot.json: the suffix is none of .toml, .yaml"),
        (["odd.mcap", "--deep", "-o", "robot.toml"], "-o is for one log, and these are 2"),
    ],
)
def test_refusals(lidarcli: Run, words: list[str], says: str) -> None:
    ran = lidarcli("info", "fine.mcap", *words)
    assert (ran.code, ran.out) == (2, "")
    assert says in ran.err


def test_what_a_closer_look_mends_is_written(lidarcli: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = transform_lines("base_link", "laser", -0.13, 0.0, 0.0)
    looked = deep.DeepFindings(
        (
            Finding("body", "warning", "/scan", "laser", "/scan: 6 beams never change", fix=Fix("mask", "")),
            Finding("mount", "warning", "/scan", "laser", "laser sits 0.13 m behind", fix=Fix("transform", text)),
            Finding("units", "hint", "/scan", "laser", "a closer look counts"),
        ),
        Masks((Mask(Sector(-0.1, 0.1, 0.2, 0.3), "/scan"),)),
        (Mount("laser", "base_link", -0.13, 0.0, 0.0),),
    )
    monkeypatch.setattr(deep, "deep_findings", lambda *_: looked)
    ran = lidarcli("info", "odd.mcap", "--deep", "-o", "robot.toml", "-o", "filter.yaml", code=0)
    assert ran.out.splitlines()[-10:-2] == [
        "  findings",
        "  warning  mount      laser sits 0.13 m behind",
        *(f"    {line}" for line in text.splitlines()),
        "  warning  body       /scan: 6 beams never change",
        "    fix: --mask FILE.toml, which -o FILE.toml writes",
        "  hint     units      a closer look counts",
        "  hint     clock      /scan: recorded 5.1 s after the stamps",
    ]
    assert (folder / "robot.toml").read_text() == (
        '[[mask]]\ntopic = "/scan"\nsector = { from = -5.729578, to = 5.729578, nearest = 0.2, farthest = 0.3 }\n\n'
        '[[mount]]\nframe = "laser"\nparent = "base_link"\nx = -0.13\ny = 0.0\nyaw = 0.0\n'
    )
    assert "laser_filters/LaserScanSectorFilter" in (folder / "filter.yaml").read_text()
    assert lidarcli("info", "odd.mcap", "--mask", "robot.toml").code == 0
    again = lidarcli("info", "odd.mcap", "--deep", "-o", "robot.toml", "-o", "filter.yaml", code=5)
    assert "overwrite" in again.err
    # Without the closer look there is nothing of it.
    assert "never change" not in lidarcli("info", "odd.mcap").out


@pytest.mark.parametrize("pose", [(-0.13, 0.0, 0.0), (1.25, -0.000001, 3.141593), (0.0, 12.5, -1.5)])
@pytest.mark.parametrize("names", [("base_link", "laser"), ("my robot", "it's")])
def test_both_commands_tell_one_transform(pose: tuple[float, float, float], names: tuple[str, str]) -> None:
    """As their programs read them: ROS 2 by names, ROS 1 as x y z yaw pitch roll parent child."""
    new, old = (shlex.split(line) for line in transform_lines(*names, *pose).splitlines())
    assert new[:4] == ["ros2", "run", "tf2_ros", "static_transform_publisher"]
    assert old[:3] == ["rosrun", "tf2_ros", "static_transform_publisher"]
    parser = argparse.ArgumentParser()
    for name in ("x", "y", "z", "yaw"):
        parser.add_argument(f"--{name}", type=float)
    parser.add_argument("--frame-id")
    parser.add_argument("--child-frame-id")
    told = parser.parse_args(new[4:])
    x, y, z, yaw, pitch, roll = map(float, old[3:9])
    assert (told.x, told.y, told.z, told.yaw) == (x, y, z, yaw)
    assert (x, y, yaw) == pose
    assert (z, pitch, roll) == (0.0, 0.0, 0.0)
    assert tuple(old[9:]) == (told.frame_id, told.child_frame_id) == names


NOTE = "most ranges of /scan are beyond 1,000 m: they are probably millimetres (--range-unit mm)"
COMMANDS = {
    "info": ("info",),
    "detect": ("detect", "-o", "t"),
    "track": ("track", "-o", "t"),
    "background": ("background", "build", "-o", "t.parquet"),
    "map": ("map", "--poses", "p.tum", "-o", "m.yaml", "--resolution", "10", "--max-size", "100"),
    "overlay": ("overlay", "-o", "o.mcap"),
    "plot": ("plot", "-o", "p.png"),
    "poses": ("poses", "--poses", "p.tum", "-o", "q.tum"),
}


@pytest.fixture
def millimetres(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A log whose ranges are millimetres, and a trajectory, in the working directory."""
    monkeypatch.chdir(tmp_path)
    block = room_sweeps()
    told = {name: getattr(block, name) * np.float32(1000) for name in ("ranges", "range_min", "range_max")}
    write_log(tmp_path / "run.mcap", [replace(block, **told)])
    times = (1_700_000_000 + k / 10 for k in range(-1, 23))
    (tmp_path / "p.tum").write_text("".join(f"{time:.3f} 0 0 0 0 0 0 1\n" for time in times))
    return tmp_path


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_tells_it(lidarcli: Callable[..., Any], millimetres: Path, command: str) -> None:
    ran = lidarcli(*COMMANDS[command], "run.mcap", code=0)
    assert f"{ran.out}{ran.err}".count(NOTE) == 1
    again = lidarcli(
        *COMMANDS[command], "run.mcap", "--range-unit", "mm", *(("--overwrite",) * (command != "info")), code=0
    )
    assert "--range-unit" not in f"{again.out}{again.err}"


def test_degrees_are_refused(lidarcli: Callable[..., Any], tmp_path: Path) -> None:
    good = room_sweeps()
    many = replace(good, angle_increment=np.where(np.arange(20) < 5, 1.0, good.angle_increment))
    write_log(tmp_path / "run.mcap", [many])
    ran = lidarcli("detect", tmp_path / "run.mcap", "-o", tmp_path / "t", code=3)
    assert "topic /scan: 5 messages left out: angle_increment is beyond 0.9 rad: probably degrees" in ran.err
    assert ": 15 sweeps, " in ran.err
