"""`lidarcli report` for those in a hurry: `--brief`, annotations of GitHub Actions, a warning of unlike sensors."""

from __future__ import annotations

import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

from lidarcli.reports.programs import command
from tests.reports.runs import START, TENTH, sweep, thing, write_run

Run = Callable[..., Any]
CHECKS = ("--check", "sweeps >= 20", "--check", "objects == 3")


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """The tables of a run of 20 sweeps with an object each."""
    rows = [sweep(k, 1) for k in range(20)]
    return write_run(tmp_path / "run", rows, [thing(k, 1) for k in range(20)])


@pytest.fixture
def baseline(tmp_path: Path) -> Path:
    """The same without objects in the first three sweeps, and without the last two."""
    rows = [sweep(k, int(k > 2)) for k in range(18)]
    return write_run(tmp_path / "base", rows, [thing(k, 1) for k in range(3, 18)])


@pytest.fixture
def unlike(tmp_path: Path) -> Path:
    """The tables of three logs: 5, 10 and 20 Hz, 100 and 360 beams, two frames."""
    for name, stride, other in (
        ("slow", 2, {}),
        ("usual", 1, {"beams": 360, "valid": 359, "noise_beams": 355}),
        ("fast", 0.5, {"frame_id": "front"}),
    ):
        sweeps = [sweep(k, 1, log=name, stamp=START + int(stride * TENTH) * k, **other) for k in range(len(name))]
        write_run(tmp_path / "unlike", sweeps, [thing(k, 1, log=name) for k in range(len(name))], name=name)
    return tmp_path / "unlike"


def test_brief_text(lidarcli: Run, run: Path, baseline: Path) -> None:
    ran = lidarcli("report", run, *CHECKS, "--brief")
    assert ran.code == 1
    assert ran.out == (
        "Checks: 1 of 2 failed\n"
        "ok    sweeps >= 20  (found 20)\n"
        "FAIL  objects == 3  (found 20)\n"
        "\n"
        "run: 20 sweeps in 1.9 s, 10 Hz, 20 objects (1 per sweep)\n"
    )
    ran = lidarcli("report", run, "--baseline", baseline, "--brief", "--check", "changed_sweeps == 3")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out == (
        "Checks: 1 of 1 passed\n"
        "ok    changed_sweeps == 3  (found 3)\n"
        "\n"
        "run: 20 sweeps in 1.9 s, 10 Hz, 20 objects (1 per sweep)\n"
        "Sweeps in both runs: 18, 3 of them (16.7 %) with another number of objects; only\n"
        "here: 2; only in the baseline: 0\n"
    )
    assert lidarcli("report", run, "--brief").out == "run: 20 sweeps in 1.9 s, 10 Hz, 20 objects (1 per sweep)\n"


def test_brief_markdown_in_a_file(lidarcli: Run, run: Path, tmp_path: Path) -> None:
    out = tmp_path / "report.md"
    assert lidarcli("-q", "report", run, *CHECKS, "--brief", "-o", out).code == 1
    assert out.read_text() == (
        "## lidarcli report: run\n\n"
        "**Checks: 1 of 2 failed.**\n\n"
        "|  | check | found |\n"
        "| --- | --- | ---: |\n"
        "| passed | `sweeps >= 20` | 20 |\n"
        "| **failed** | `objects == 3` | 20 |\n\n"
        "run: 20 sweeps in 1.9 s, 10 Hz, 20 objects (1 per sweep)\n"
    )


@pytest.mark.parametrize("kind", ["json", "junit", "html"])
def test_brief_is_not_for_programs(lidarcli: Run, run: Path, tmp_path: Path, kind: str) -> None:
    out = tmp_path / "report.md"
    ran = lidarcli("report", run, "--brief", "--format", kind, "-o", out)
    assert (ran.code, ran.out, out.exists()) == (2, "", False)
    assert f"--brief is for text, markdown, github; leave it out for {kind}" in ran.err


def test_github(lidarcli: Run, run: Path, tmp_path: Path) -> None:
    ran = lidarcli("report", run, tmp_path / "none.sweeps.parquet", *CHECKS, "--brief", "--format", "github")
    assert (ran.code, "no such file" in ran.err) == (3, False)
    assert ran.out.splitlines() == [
        f"::error title=lidarcli%3A not read::{tmp_path}/none.sweeps.parquet: no such file or folder",
        "::error title=lidarcli%3A check failed::objects == 3: expected == 3, found 20",
        "::notice title=lidarcli report::Checks: 1 of 2 failed, on part of the data%0A"
        "run: 20 sweeps in 1.9 s, 10 Hz, 20 objects (1 per sweep)",
        "::notice title=lidarcli%3A check passed::sweeps >= 20: found 20",
    ]


def test_github_folds_the_report_where_no_name_of_a_log_is_a_command(lidarcli: Run, tmp_path: Path) -> None:
    run = write_run(tmp_path, [sweep(0, 1, log="::error::boo")], [thing(0, 1)], name="run")
    lines = lidarcli("report", run, "--format", "github").out.splitlines()
    assert lines[1] == "::group::::error::boo"
    assert lines[2].startswith("::stop-commands::")
    word = lines[2].removeprefix("::stop-commands::")
    assert lines[-2:] == [f"::{word}::", "::endgroup::"]
    text = "\n".join(lines[3:-2]) + "\n"
    assert text == lidarcli("report", run).out
    assert word == hashlib.sha256(text.encode()).hexdigest()


@pytest.mark.parametrize("text", ["100 %", "a\nb", "a\r\nb", "%0A", "a:b,c", "::error::x"])
def test_what_github_reads_is_what_was_meant(text: str) -> None:
    line = command("notice", text, text)
    assert len(line.splitlines()) == 1
    _, properties, message = line.split("::", 2)
    assert unquote(message) == text
    kind, title = properties.split(" ", 1)
    assert (kind, unquote(title)) == ("notice", f"title={text}")
    assert not {":", ","} & set(title)


def test_github_spells_out_what_steers_a_terminal() -> None:
    assert command("error", "a", "\x1b[2J°\udcff") == "::error title=a::\\x1b[2J°\\udcff"


def test_unlike_sensors_are_told_and_not_pooled(lidarcli: Run, unlike: Path) -> None:
    warning = (
        "unlike sensors (5 to 20 Hz; 100 to 360 beams; frames front, laser): the figures pool all of them, and no map in "
        "the sensor frame is drawn; for figures of one sensor report its tables alone"
    )
    text = lidarcli("report", unlike).out
    assert max(map(len, text.splitlines())) <= 80
    assert " ".join(text.split()).startswith(f"warning: {warning} Logs log and topic")
    lines = text.splitlines()
    start = lines.index("Logs")
    assert lines[start + 1 : start + 6] == [
        "log and topic  sweeps  duration   rate  beams  objects",
        "fast /scan          4    0.15 s  20 Hz    100        4",
        "slow /scan          4    0.60 s   5 Hz    100        4",
        "usual /scan         5    0.40 s  10 Hz    360        5",
        "formats  3 mcap; 3,000 bytes",
    ]
    assert "clock             5 to 20 Hz, no gaps, all stamps increasing" in text
    for words in ("Where objects were", "step [s]", "beams_per_object"):
        assert words not in text
    assert f"::warning title=lidarcli::{warning}\n" in lidarcli("report", unlike, "--format", "github").out
    markdown = lidarcli("report", unlike, "--format", "markdown").out
    assert markdown.splitlines()[2].startswith("**Warning:** unlike sensors (5 to 20 Hz; ")
    assert "| 5 to 20 Hz |" in markdown
    ran = lidarcli("report", unlike, "--format", "json")
    assert ran.err == f"warning: {warning}\n"
    found = json.loads(ran.out)
    suite = ET.fromstring(lidarcli("report", unlike, "--format", "junit").out.encode())[0]
    assert suite.findtext("system-out") == f"warning: {warning}"
    assert f"Warning: {warning}</p>" in lidarcli("report", unlike, "--format", "html").out
    assert (found["warnings"], found["maps"]) == ([warning], [])
    assert [stream["beams"] for stream in found["streams"]] == [100, 100, 360]


def test_like_sensors_are_pooled(lidarcli: Run, tmp_path: Path) -> None:
    for name, beams, step in (("a", 100, 1.0), ("b", 101, 1.1)):
        sweeps = [sweep(k, 1, log=name, beams=beams, stamp=START + int(step * TENTH) * k) for k in range(5)]
        write_run(tmp_path, sweeps, [thing(k, 1, log=name) for k in range(5)], name=name)
    text = lidarcli("report", tmp_path).out
    assert "warning" not in text
    for words in ("Where objects were, 2 logs over each other (sensor", "step [s]", "beams_per_object"):
        assert words in text
    assert json.loads(lidarcli("report", tmp_path, "--format", "json").out)["warnings"] == []
