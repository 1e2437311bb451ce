"""`lidarcli info`: findings as text, checks of them, `--deep`, and the files that mend a log."""

from __future__ import annotations

import argparse
import json
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lidarcli.pipeline.reading import deep
from lidarcli.simulation.writers import write_log
from lidarcli.sweeps.findings import Finding, Fix, transform_lines
from lidarcli.sweeps.masks import Mask, Masks, Mount, Sector
from tests.sweeping import room_sweeps

Run = Callable[..., Any]


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
        "    lidarcli clean odd.mcap -o odd.mended.mcap --remove none --mend units,clock",
    ]
    assert "findings" not in lidarcli("info", "fine.mcap").out
    assert lidarcli("info", "odd.mcap", "--brief").out.endswith(" Hz, no poses, 2 findings\n")


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
        ("findings.body == 0", "only --deep looks for findings.body: add --deep"),
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
    ran = lidarcli("info", "empty.csv", "fine.mcap", "--check", "findings == 0")
    assert ran.code == 3
    assert lidarcli("info", "empty.csv", "fine.mcap", "--check", "findings == 7").code == 3


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
    ran = lidarcli("info", "odd.mcap", "--deep", "-o", "robot.toml", "-o", "filter.yaml")
    assert ran.code == 0
    assert ran.out.splitlines()[-10:-2] == [
        "  findings",
        "  hint     units      a closer look counts",
        "  hint     clock      /scan: recorded 5.1 s after the stamps",
        "  warning  mount      laser sits 0.13 m behind",
        *(f"    {line}" for line in text.splitlines()),
        "  warning  body       /scan: 6 beams never change",
        "    fix: --mask FILE.toml, which -o FILE.toml writes",
    ]
    assert (folder / "robot.toml").read_text() == (
        '[[mask]]\ntopic = "/scan"\nsector = { from = -5.729578, to = 5.729578, nearest = 0.2, farthest = 0.3 }\n\n'
        '[[mount]]\nframe = "laser"\nparent = "base_link"\nx = -0.13\ny = 0.0\nyaw = 0.0\n'
    )
    assert "laser_filters/LaserScanSectorFilter" in (folder / "filter.yaml").read_text()
    assert lidarcli("info", "odd.mcap", "--mask", "robot.toml").code == 0
    again = lidarcli("info", "odd.mcap", "--deep", "-o", "robot.toml", "-o", "filter.yaml")
    assert again.code == 5
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
