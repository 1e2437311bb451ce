"""Several runs: figures of each over time, and checks that each has to hold by itself."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.reports.browser import CHROMIUM, browser
from tests.reports.runs import START, TENTH, event, made, sweep, thing, watch, write_run, write_zones

Run = Callable[..., Any]
DAY = 864_000 * TENTH


def write_night(folder: Path, number: int, sweeps: int, near: float = 1.0, log: str = "") -> Path:
    """The tables of a run of the night of this number, with one object in each sweep."""
    name = log or f"night{number}"
    rows = [sweep(k, 1, log=name, stamp=START + number * DAY + k * TENTH, nearest=near) for k in range(sweeps)]
    objects = [thing(k, 1, log=name, stamp=START + number * DAY + k * TENTH) for k in range(sweeps)]
    return write_run(folder / name, rows, objects, name=name)


@pytest.fixture
def nights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Four runs of as many days, named backwards; the third is short, and something came near in the last."""
    monkeypatch.chdir(tmp_path)
    for number, (sweeps, near) in enumerate(((100, 1.0), (102, 1.1), (80, 1.05), (101, 0.4))):
        write_night(tmp_path / "tables", number, sweeps, near, "dcba"[number])
    (tmp_path / "checks.toml").write_text('checks = ["sweeps >= 90", "nearest.min between 0.5 and 2", "damage == 0"]\n')
    return tmp_path / "tables"


def rows_of(text: str) -> list[list[str]]:
    """The cells of the table of runs, from its head on."""
    lines = text[text.index("Run by run") :].partition("\n\n")[0].splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("start"))
    return [re.split(r"  +", line.strip()) for line in lines[first:]]


def test_runs_stand_in_the_order_of_their_time(lidarcli: Run, nights: Path) -> None:
    rows = rows_of(lidarcli("report", nights).out)
    assert rows[:5] == [
        ["start", "log", "sweeps", "nearest.min"],
        ["2023-11-14 22:13", "d", "100", "1.00 m"],
        ["2023-11-15 22:13", "c", "102", "1.10 m"],
        ["2023-11-16 22:13", "b", "80", "1.05 m"],
        ["2023-11-17 22:13", "a", "101", "0.40 m"],
    ]
    # What is the same in all takes no column.
    assert " ".join(rows[5]).startswith("The same in all: objects_per_sweep.mean 1, valid_share 99 %, gaps 0, damage 0")
    assert "Run by run" not in lidarcli("report", nights / "a").out
    local = lidarcli("report", nights, "--time-zone", "Asia/Tokyo").out
    assert "2023-11-15 07:13  d" in local


def test_each_run_has_to_hold_the_checks_of_a_file(lidarcli: Run, nights: Path) -> None:
    """And those of `--check` are of all runs together: these have 383 sweeps."""
    ran = lidarcli(
        "report", nights, "--checks", "checks.toml", "--check", "sweeps == 383", "-o", "-", "-o", "x.json", code=1
    )
    assert ran.out.startswith(
        "Checks: 2 of 4 failed\n"
        "ok    sweeps == 383  (found 383)\n"
        "FAIL  sweeps >= 90  (found 80 in b (1 of 4 logs))\n"
        "FAIL  nearest.min between 0.5 and 2  (found 0.4 in a (1 of 4 logs))\n"
        "ok    damage == 0  (found 0 in 4 logs)\n"
    )
    assert "lidarcli: check failed: sweeps is 80 in b (1 of 4 logs), expected >= 90\n" in ran.err
    rows = rows_of(ran.out)
    assert rows[3:6] == [
        ["2023-11-16 22:13", "b", "! 80", "1.05 m"],
        ["2023-11-17 22:13", "a", "101", "! 0.40 m"],
        ["limit", ">= 90", "0.5 to 2 m"],
    ]
    found = json.loads(Path("x.json").read_text())
    assert found["checks"][1] == {
        "check": "sweeps >= 90",
        "holds": False,
        "expected": ">= 90",
        "found": 80,
        "logs": [
            {"log": log, "holds": log != "b", "found": n} for log, n in (("a", 101), ("b", 80), ("c", 102), ("d", 100))
        ],
    }
    assert [(one["log"], one["figures"]["sweeps"]) for one in found["runs"]] == [
        ("a", 101),
        ("b", 80),
        ("c", 102),
        ("d", 100),
    ]
    # Of one run both are the same.
    for log, code in (("a", 1), ("b", 1), ("c", 0)):
        assert lidarcli("report", nights / log, "--checks", "checks.toml").code == code


def test_logs_of_one_name_are_told_apart_by_their_folders(lidarcli: Run, tmp_path: Path) -> None:
    """As where every night has its own folder with a run.mcap in it."""
    for number, count in enumerate((100, 80)):
        write_night(tmp_path / f"night{number}", number, count, log="run")
    (tmp_path / "checks.toml").write_text('checks = ["sweeps >= 90"]\n')
    words = ("report", tmp_path / "night0", tmp_path / "night1", "--checks", tmp_path / "checks.toml")
    ran = lidarcli(*words, "-o", tmp_path / "x.xml", "-o", "-", code=1)
    assert "sweeps is 80 in night1/run/run (1 of 2 logs)" in ran.err
    assert [row[1] for row in rows_of(ran.out)[1:3]] == ["night0/run/run", "night1/run/run"]
    assert cases_of(tmp_path / "x.xml") == {
        **{f"night{k}/run/run: read": "pass" for k in (0, 1)},
        "night0/run/run: sweeps >= 90": "pass",
        "night1/run/run: sweeps >= 90": "failure",
    }


def test_checks_of_rows_are_those_of_each_run_too(lidarcli: Run, nights: Path) -> None:
    Path("rows.toml").write_text('checks = ["sweeps where nearest < 0.5 <= 100", "objects where r_min < 5 <= 102"]\n')
    ran = lidarcli("report", nights, "--checks", "rows.toml", code=1)
    assert ran.out.splitlines()[1:3] == [
        "FAIL  sweeps where nearest < 0.5 <= 100  (found 101 in a (1 of 4 logs))",
        "ok    objects where r_min < 5 <= 102  (found 80 to 102 in 4 logs)",
    ]


def cases_of(path: Path) -> dict[str, str]:
    """Case → what became of it."""
    return {case.attrib["name"]: case[0].tag if len(case) else "pass" for case in ET.parse(path).iter("testcase")}


def test_junit_has_a_case_for_each_log_and_check(lidarcli: Run, nights: Path) -> None:
    (nights / "e").mkdir()
    (nights / "e" / "e.objects.parquet").write_bytes(b"PAR1")
    lidarcli("report", *(nights / log for log in "abe"), "--checks", "checks.toml", "-o", "x.xml", code=3)
    gone = nights / "e" / "e.sweeps.parquet"
    assert cases_of(Path("x.xml")) == {
        "a: read": "pass",
        "b: read": "pass",
        f"{gone}: read": "error",
        "a: sweeps >= 90": "pass",
        "b: sweeps >= 90": "failure",
        "a: nearest.min between 0.5 and 2": "failure",
        "b: nearest.min between 0.5 and 2": "pass",
        "a: damage == 0": "pass",
        "b: damage == 0": "pass",
        # Of what could not be read no check has passed.
        **{f"{gone}: {check}": "skipped" for check in ("sweeps >= 90", "nearest.min between 0.5 and 2", "damage == 0")},
    }
    assert {one.attrib["message"] for one in ET.parse("x.xml").iter("skipped")} == {
        f"not run: {gone}: not there; lidarcli detect writes it"
    }


def test_tables_of_zones_alone_are_runs_too(lidarcli: Run, tmp_path: Path) -> None:
    for number, count in enumerate((1, 3)):
        events = [event(k + 1, "stop", begin=k, last=k) for k in range(count)]
        zones = [watch(k, "stop", 5, stamp=START + number * DAY + k * TENTH) for k in range(10)]
        write_zones(tmp_path / "tables", events, zones, name=f"run{number}")
    (tmp_path / "checks.toml").write_text('checks = ["zones.stop.events <= 2"]\n')
    ran = lidarcli("report", tmp_path / "tables", "--checks", tmp_path / "checks.toml", code=1)
    assert ran.out.splitlines()[1] == "FAIL  zones.stop.events <= 2  (found 3 in run1 (1 of 2 logs))"
    assert rows_of(ran.out)[1:4] == [
        ["2023-11-14 22:13", "run0", "1"],
        ["2023-11-15 22:13", "run1", "! 3"],
        ["limit", "<= 2"],
    ]


def test_good_runs_set_limits_for_others(lidarcli: Run, nights: Path) -> None:
    """What was written is what is printed, a line for each check."""
    ran = lidarcli("report", *(nights / log for log in "cd"), "--init", "good.toml")
    assert ran.out == Path("good.toml").read_text()
    assert ran.out.splitlines()[:5] == [
        "# Checks of good runs (2 logs), for lidarcli report RUN --checks THIS_FILE",
        "checks = [",
        '  "topics >= 1",  # 1 in 2 runs',
        '  "sweeps >= 85.8",  # 100 to 102 in 2 runs',
        '  "valid_share >= 0.849",  # 0.99 in 2 runs',
    ]
    assert len(ran.out.splitlines()) < 15
    ran = lidarcli("report", nights, "--checks", "good.toml", code=1)
    assert re.findall(r"check failed: ([\w.]+) is (\S+) in (\w)", ran.err) == [
        ("sweeps", "80", "b"),
        ("nearest.min", "0.4", "a"),
    ]
    # Who asks for a report, too, gets it.
    assert lidarcli("report", nights, "--init", "good.toml", "--overwrite", "--brief").out.startswith("4 logs: 383 sweeps")


def test_of_many_runs_the_latest_are_told(tmp_path: Path) -> None:
    paths = [write_night(tmp_path, number, 2 + number % 3) for number in range(40)]
    (section,) = (one for one in made(*paths).sections().values() if one.title == "Run by run")
    table = next(block for block in section.blocks if hasattr(block, "head"))
    assert [row[1] for row in table.rows] == [f"night{number}" for number in range(10, 40)]
    assert table.more == "and 10 earlier runs, all of them in --format json"
    # Charts have all of them.
    assert [len(block.points) for block in section.blocks if hasattr(block, "points")] == [40]


@pytest.mark.slow
def test_charts_have_runs_and_limits(lidarcli: Run, nights: Path) -> None:
    assert lidarcli("report", nights, "--checks", "checks.toml", "-o", "runs.html", code=1)
    page = Path("runs.html").read_text()
    (chart,) = re.findall(r'<figure class="trend"><h3>sweeps.*?</figure>', page, re.DOTALL)
    assert "limit &gt;= 90" in chart
    assert "lidarcli report tables --checks checks.toml -o report.html" in page
    dots = re.findall(r'class="dot( fails)?" d="M(\S+) (\S+)h.01"><title>(.*?)</title>', chart)
    assert [(bool(fails), words[-6:]) for fails, *_, words in dots] == [
        *((False, "d: 100"), (False, "c: 102"), (True, " b: 80"), (False, "a: 101"))
    ]
    (limit,) = map(float, re.findall(r'class="limit" d="M-20 (\S+)H', chart))
    heights = [float(y) for *_, y, _ in dots]
    assert [y > limit for y in heights] == [False, False, True, False]
    assert limit == pytest.approx(heights[2] + 10 / 22 * (heights[1] - heights[2]), abs=0.2)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium")
@pytest.mark.parametrize("width", [1280, 400])
def test_charts_fit_the_window(lidarcli: Run, nights: Path, width: int) -> None:
    assert lidarcli("report", nights, "--checks", "checks.toml", "-o", "runs.html", code=1)
    with browser() as page:
        page.open(Path("runs.html").resolve(), width)
        boxes: Sequence[Sequence[float]] = page.evaluate(
            "[...document.querySelectorAll('.trend')].map("
            "one => [one.offsetLeft, one.offsetWidth, one.querySelector('svg').clientHeight])"
        )
        assert len(boxes) == 2
        assert all(left >= 0 and left + wide <= width and wide > 350 and high == 110 for left, wide, high in boxes)
        assert page.complaints == []
