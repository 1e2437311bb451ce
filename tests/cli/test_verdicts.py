"""Verdicts of checks as JUnit, by `report`, `zones` and `diff` alike; and the checks of a good run, for others."""

from __future__ import annotations

import json
import re
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from shutil import copytree
from typing import Any

import pytest

from lidarcli.cli import run
from lidarcli.reports.figures import GUARDED, guards
from tests.places import SAMPLES

Run = Callable[..., Any]

STOP = '[[zone]]\nname = "stop"\npolygon = [[0.2, 0.8], [2.6, 0.8], [2.6, -0.8], [0.2, -0.8]]\n'


def inputs() -> None:
    """A file of zones and the samples, in the current directory."""
    Path("zones.toml").write_text(STOP, "utf-8")
    for name in ("people.csv.gz", "room.mcap", "room_empty.mcap"):
        Path(name).symlink_to(SAMPLES / name)
    Path("cut.csv.gz").write_bytes((SAMPLES / "people.csv.gz").read_bytes()[:-60_000])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current directory, with the inputs."""
    monkeypatch.chdir(tmp_path)
    inputs()
    return tmp_path


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables of a run, made once."""
    with chdir(tmp_path_factory.mktemp("made")):
        inputs()
        assert run(["-q", "track", "people.csv.gz", "-o", "good"]) == 0
        assert run(["-q", "zones", "people.csv.gz", "--zones", "zones.toml", "-o", "good"]) == 0
        return Path("good").resolve()


@pytest.fixture
def tables(folder: Path, good: Path) -> Path:
    return Path(copytree(good, folder / "good"))


def counts(path: Path) -> tuple[int, int, int]:
    """(tests, failures, errors) as junitparser reads them, or by the schema of Jenkins where it is not installed."""
    [suite] = ET.fromstring(path.read_bytes())
    tags = [child.tag for child in suite]
    assert tags == ["properties", *["testcase"] * tags.count("testcase"), *["system-out"] * tags.count("system-out")]
    cases = suite.findall("testcase")
    assert all(case.attrib.keys() == {"name", "classname"} for case in cases)
    held = len(cases), *(sum(case.find(tag) is not None for case in cases) for tag in ("failure", "error"))
    assert held == tuple(int(suite.attrib[name]) for name in ("tests", "failures", "errors"))
    assert sum(case.find("skipped") is not None for case in cases) == int(suite.attrib["skipped"])
    try:
        from junitparser import Error, Failure, JUnitXml
    except ImportError:
        return held  # type: ignore[return-value]
    [read] = JUnitXml.fromfile(str(path))
    results = [result for case in read for result in case.result]
    found = len([*read]), *(sum(isinstance(one, kind) for one in results) for kind in (Failure, Error))
    assert (read.tests, read.failures, read.errors) == found == held
    return found  # type: ignore[return-value]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "code", "expected"),
    [
        ("zones people.csv.gz --zones zones.toml --check zones.stop.events==1", 0, (2, 0, 0)),
        ("zones people.csv.gz --zones zones.toml --check zones.stop.events==0 --check zones.stop.in==0", 1, (3, 2, 0)),
        ("zones people.csv.gz gone.bag --zones zones.toml --check zones.stop.events==1", 3, (3, 0, 1)),
        ("zones cut.csv.gz --zones zones.toml --check zones.stop.events==1", 3, (2, 0, 1)),
        ("zones room.mcap --topic /scan --topic /other --zones zones.toml", 4, (1, 0, 1)),
        ("diff room_empty.mcap room.mcap --check gone==0 --check new==5", 0, (4, 0, 0)),
        ("diff room_empty.mcap room.mcap --check gone==0 --check new==0", 1, (4, 1, 0)),
        ("diff people.csv.gz cut.csv.gz", 3, (2, 0, 1)),
        ("report good --check sweeps==80 --check zones.stop.events==1", 0, (3, 0, 0)),
        ("report good --check sweeps==81", 1, (2, 1, 0)),
        ("report good gone.objects.parquet --check sweeps==80", 3, (3, 0, 1)),
    ],
)
def test_junit_is_green_where_the_exit_code_is_0(
    tables: Path, lidarcli: Run, words: str, code: int, expected: tuple[int, int, int]
) -> None:
    ran = lidarcli(*words.split(), "-o", "verdicts.xml")
    assert ran.code == code, ran.err
    assert counts(Path("verdicts.xml")) == expected
    # The same file without a word on the machine, and not over what is there.
    before = Path("verdicts.xml").read_bytes()
    assert lidarcli(*words.split(), "-o", "verdicts.xml").code == 5
    assert lidarcli(*words.split(), "-o", "verdicts.xml", "--overwrite").code == code
    assert Path("verdicts.xml").read_bytes() == before


def test_junit_holds_figures_and_what_was_found(folder: Path, lidarcli: Run) -> None:
    words = ("zones", "people.csv.gz", "--zones", "zones.toml", "-o", "tables", "-o", "x.xml")
    assert lidarcli(*words, "--format", "json").code == 0
    suite = ET.fromstring(Path("x.xml").read_bytes())[0]
    figures = {one.attrib["name"]: one.attrib["value"] for one in suite.iter("property")}
    assert figures["zones.stop.events"] == "1"
    assert "people.csv.gz: stop  1 event" in str(suite.findtext("system-out"))
    assert {path.name for path in Path("tables").iterdir()} == {"people.events.parquet", "people.zones.parquet"}
    assert json.loads(lidarcli(*words, "--format", "json", "--overwrite").out)["written"][-1] == "x.xml"
    assert lidarcli("diff", "room_empty.mcap", "room.mcap", "-o", "y.xml").code == 0
    assert "new 5" in str(ET.fromstring(Path("y.xml").read_bytes())[0].findtext("system-out"))


def test_zones_take_one_folder(folder: Path, lidarcli: Run) -> None:
    ran = lidarcli("zones", "people.csv.gz", "--zones", "zones.toml", "-o", "a", "-o", "b", code=2)
    assert "one folder" in ran.err
    assert lidarcli("zones", "people.csv.gz", "--zones", "zones.toml", "-o", "a.xml", "--dry-run").out.endswith("a.xml\n")
    assert not Path("a.xml").exists()


@pytest.mark.slow
def test_checks_of_a_good_run_hold_for_it_and_refuse_a_worse_one(tables: Path, lidarcli: Run) -> None:
    assert lidarcli("-q", "diff", "room_empty.mcap", "room.mcap", "-o", "good/room.changes.parquet").code == 0
    assert lidarcli("report", "good", "--init", "checks.toml").code == 0
    checks = tomllib.loads(Path("checks.toml").read_text("utf-8"))["checks"]
    assert {*checks} >= {
        *("sweeps >= 64", "rate between 18 and 22", "step.max <= 0.1", "agents_at_once.max <= 6", "damage <= 0"),
        *("zones.stop.events <= 2", "zones.stop.observed >= 0.9", "new <= 8", "gone <= 0"),
    }
    assert lidarcli("report", "good", "--checks", "checks.toml").code == 0
    assert lidarcli("report", "good", "--checks", "checks.toml", "--check", "sweeps == 79").code == 1
    assert lidarcli("-q", "track", "people.csv.gz", "-o", "worse", "--every", "2").code == 0
    kept = [check for check in checks if check.split()[0] in ("sweeps", "rate", "step.max", "nearest.min")]
    Path("some.toml").write_text(f"checks = {json.dumps(kept)}\n", "utf-8")
    ran = lidarcli("report", "worse", "--checks", "some.toml", code=1)
    assert re.findall(r"check failed: ([\w.]+) is", ran.err) == ["sweeps"]
    assert lidarcli("-q", "track", "cut.csv.gz", "-o", "cut").code == 3
    assert "good.toml: learnt from logs that are damaged" in lidarcli("report", "cut", "--init", "good.toml").err
    # The file is no output of others, and is not written over.
    assert lidarcli("report", "good", "--init", "checks.toml").code == 5
    assert lidarcli("report", "good", "--checks", "checks.toml", "--init", "checks.toml", "--overwrite").code == 5


@pytest.mark.slow
def test_zones_and_diff_take_the_checks_of_a_file(folder: Path, lidarcli: Run) -> None:
    assert lidarcli("-q", "zones", "people.csv.gz", "--zones", "zones.toml", "-o", "good").code == 0
    assert lidarcli("report", "good", "--init", "zones.checks.toml").code == 0
    zones = ("zones", "people.csv.gz", "--zones", "zones.toml", "--checks")
    assert lidarcli(*zones, "zones.checks.toml").code == 0
    Path("none.toml").write_text('checks = ["zones.stop.events == 0"]\n', "utf-8")
    assert lidarcli(*zones, "none.toml").code == 1
    Path("gone.toml").write_text('checks = ["new == 0"]\n', "utf-8")
    assert lidarcli("diff", "room_empty.mcap", "room.mcap", "--checks", "gone.toml").code == 1


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("checks = 3", 2, "holds one list of texts"),
        ('checks = ["sweeps > 1", 2]', 2, "holds one list of texts"),
        ('check = ["sweeps > 1"]', 2, "holds one list of texts"),
        ('checks = ["sweps > 1"]', 2, "did you mean sweeps"),
        ("checks = [", 3, "not valid TOML"),
        (None, 3, "cannot read the file of checks"),
    ],
)
def test_files_of_checks_that_are_none(tables: Path, lidarcli: Run, text: str | None, code: int, words: str) -> None:
    if text is not None:
        Path("bad.toml").write_text(text, "utf-8")
    ran = lidarcli("report", "good", "--checks", "bad.toml", "-o", "x.html", code=code)
    assert words in ran.err
    assert not Path("x.html").exists()


def test_a_run_that_is_read_in_part_sets_no_checks(tables: Path, lidarcli: Run) -> None:
    assert lidarcli("report", "good", "gone.objects.parquet", "--init", "checks.toml").code == 3
    assert not Path("checks.toml").exists()


@pytest.mark.slow
def test_a_check_says_how_much_damage_of_zones_and_changes_is_accepted(folder: Path, lidarcli: Run) -> None:
    assert lidarcli("zones", "cut.csv.gz", "--zones", "zones.toml", "-o", "zones").code == 3
    assert lidarcli("diff", "people.csv.gz", "cut.csv.gz", "-o", "diff/run.changes.parquet").code == 3
    for tables, check in (("zones", "zones.stop.events == 1"), ("diff", "gone == 0")):
        for more, code in ((), 3), (("--check", "damage <= 2"), 0), (("--check", "damage <= 1"), 1):
            assert lidarcli("report", tables, "--check", check, *more).code == code, (tables, more)


def test_limits_leave_room_and_are_round() -> None:
    assert guards([dict.fromkeys(GUARDED, None)]) == {}
    assert [*guards([{"step.max": 0.10442, "observed": 1.0, "sweeps": 12_345, "new": 0, "known": 0}])] == [
        *("step.max <= 0.209", "observed >= 0.9", "sweeps >= 9870", "new <= 0")
    ]
    assert guards([{"delta.sweeps": 4.0, "zones.a-b.events": 1}]) == {"zones.a-b.events <= 2": [1]}


def test_more_runs_make_limits_closer_as_far_as_they_agree() -> None:
    """Of four runs a limit is half as far as of one, or as far as they are apart; what only some have counts, too."""
    runs = [{"sweeps": 1000, "rate": 10.1, "new": 0, "nearest.min": near} for near in (2.0, 1.9, 2.4, 2.1)]
    assert guards([*runs, {"f1": 0.9}]) == {
        "sweeps >= 900": [1000] * 4,
        "rate between 9.59 and 10.7": [10.1] * 4,
        "new <= 0": [0] * 4,
        "nearest.min >= 1.4": [1.9, 2.0, 2.1, 2.4],
        "f1 >= 0.855": [0.9],
    }
    # Runs that are farther apart than the worst is from zero set no least value.
    assert guards([{"sweeps": 10}, {"sweeps": 100}]) == {}


def test_the_page_tells_the_limits() -> None:
    page = (Path(__file__).parents[2] / "docs" / "ci.md").read_text("utf-8")
    rows = re.findall(r"^\| (`.+`) \| ([\d.]+|) \| ([\d.]+|) \|$", page, re.MULTILINE)
    told = {
        name: (float(low) if low else None, float(high) if high else None)
        for names, low, high in rows
        for name in re.findall(r"`([\w.]+)`", names)
    }
    assert told == GUARDED


@pytest.mark.parametrize(
    ("words", "check", "cause"),
    [
        (("diff", "room.mcap", "broken.mcap"), "gone == 0", "broken.mcap: "),
        (("diff", "room.mcap", "absent.mcap"), "gone == 0", "absent.mcap: "),
        (("report", "absent"), "sweeps >= 1", "absent: "),
        (("zones", "room.mcap", "--zones", "absent.toml"), "zones.stop.events == 0", "absent.toml: "),
    ],
)
def test_an_input_that_cannot_be_read_leaves_no_earlier_verdict(
    words: tuple[str, ...], check: str, cause: str, folder: Path, lidarcli: Run
) -> None:
    Path("broken.mcap").write_bytes(b"\x89MCAP0\r\n" + b"x" * 100)
    Path("out.xml").write_text("all is well")
    ran = lidarcli(*words, "--check", check, "-o", "out.xml", "--overwrite", code=3)
    assert ran.err.splitlines()[-1].startswith(f"lidarcli: {cause}")
    assert counts(folder / "out.xml") == (2, 0, 1)
    (case,) = (
        case for case in ET.fromstring(Path("out.xml").read_bytes()).iter("testcase") if case.find("skipped") is not None
    )
    assert case.attrib["name"] == check
    assert str(case.find("skipped").attrib["message"]).startswith(f"not run: {cause}")  # type: ignore[union-attr]
    Path("out.xml").write_text("mine")
    assert lidarcli(*words, "--check", check, "-o", "out.xml").code in (3, 5)
    assert Path("out.xml").read_text() == "mine"


def test_an_unread_report_on_standard_output_is_junit_too(folder: Path, lidarcli: Run) -> None:
    ran = lidarcli("report", "absent", "--format", "junit", code=3)
    assert ET.fromstring(ran.out).attrib["errors"] == "1"
