"""`lidarcli info`: text and JSON, to the letter."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from lidarcli.simulation.writers import write_log
from tests.sweeping import raw_sweeps

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
    ran = lidarcli("info", "--brief", *(logs / name for name in ("run.mcap", "two.mcap", "cut.mcap")), empty)
    assert ran.code == 3
    run, two, cut, nothing = ran.out.splitlines()
    assert run == f"{logs / 'run.mcap'}: mcap, 1.9 s, /scan 20 x 360 beams at 10.00 Hz, no poses, 1 finding"
    assert two == (
        f"{logs / 'two.mcap'}: mcap, 1.9 s, /front 20 x 360 beams at 10.00 Hz, /rear 20 x 360 beams at 10.00 Hz, no poses, "
        "2 findings"
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
    ran = lidarcli("info", logs)
    assert ran.code == 3
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
