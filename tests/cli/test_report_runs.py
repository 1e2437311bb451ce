"""`lidarcli report` over the manifests of runs: figures, formats, gates, exit codes."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from lidarcli.tabular.schemas import RUNS
from tests.places import ROOT
from tests.reports.runs import START, table

Run = Callable[..., Any]
FORMATS = ("text", "markdown", "html", "json", "junit", "github")


def row(name: str, outcome: str = "ok", message: str | None = None, **other: Any) -> dict[str, Any]:
    """What became of a log of 100 sweeps, which took half a second."""
    done = {} if outcome == "failed" else {"sweeps": 100, "rows": 600, "seconds": 0.5}
    return {
        "log": name,
        "url": f"/logs/{name}.mcap",
        "size": 1000,
        "parameters": "0",
        "version": "0.1.0",
        "outcome": outcome,
        "exit_code": 0 if outcome == "ok" else 3,
        "message": message,
        "outputs": [],
        "ended": START,
        **done,
        **other,
    }


def write_manifest(folder: Path, name: str, rows: list[dict[str, Any]]) -> Path:
    """A manifest below a folder of tables."""
    path = folder / "_lidarcli" / f"run-{name}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table(RUNS, rows), path)
    return path


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """Two runs over five logs: one failed and was then read, one failed, one is damaged."""
    write_manifest(
        tmp_path,
        "1",
        [row("a"), row("b", "failed", "no such topic"), row("c", "failed", "cut"), row("d", "damaged", "byte 9")],
    )
    later = {"version": "0.2.0", "ended": START + 1_000_000_000}
    write_manifest(tmp_path, "2", [row("b", **later), row("e", size=None, **later)])
    return tmp_path / "_lidarcli"


def test_text_on_standard_output(lidarcli: Run, fleet: Path) -> None:
    ran = lidarcli("report", fleet)
    assert (ran.code, ran.err) == (0, "")
    lines = ran.out.splitlines()
    assert lines[0] == "2 runs over 5 logs"
    assert [line.split()[::2] for line in lines[1:4]] == [
        ["ok", "60.0", "3"],
        ["damaged", "20.0", "1"],
        ["failed", "20.0", "1"],
    ]
    assert lines[4:] == [
        "runs      2",
        "lidarcli  0.1.0, 0.2.0",
        "from      2023-11-14T22:13:20.000Z",
        "to        2023-11-14T22:13:21.000Z",
        "size      4,000 bytes",
        "sweeps    400",
        "rows      2,400",
        "work      2 s",
        "rate      200 sweeps per second of work",
        "",
        "Failed logs",
        "1 log, exit code 3: cut",
        "   /logs/c.mcap",
        "",
        "Damaged logs",
        "1 log, exit code 3: byte 9",
        "   /logs/d.mcap",
    ]


def test_the_folder_its_files_and_patterns_are_the_same(
    lidarcli: Run, fleet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wanted = lidarcli("report", fleet, "--format", "json").out
    files = sorted(fleet.iterdir())
    patterns = (f"{fleet}/run-*.parquet", f"{fleet}/*", f"{str(fleet.parent)[:-1]}?/_lidarcli")
    for inputs in (files, files[::-1], [fleet, *files], *([pattern] for pattern in patterns)):
        assert lidarcli("report", *inputs, "--format", "json").out == wanted
    monkeypatch.chdir(fleet)
    assert lidarcli("report", ".", "--format", "json").out == wanted


def test_json(lidarcli: Run, fleet: Path) -> None:
    found = json.loads(lidarcli("report", fleet, "--format", "json", "--check", "failed == 1").out)
    assert found["schema"] == "lidarcli.runs/1"
    assert found["checks"] == [{"check": "failed == 1", "holds": True, "expected": "== 1", "found": 1}]
    assert found["figures"] == {
        "logs": 5,
        "ok": 3,
        "damaged": 1,
        "failed": 1,
        "bytes": 4000,
        "sweeps": 400,
        "rows": 2400,
        "seconds": 2,
        "sweeps_per_second": 200,
        "runs": 2,
    }
    assert (found["versions"], found["last"]) == (["0.1.0", "0.2.0"], "2023-11-14T22:13:21.000Z")
    assert [log["url"] for log in found["logs"]] == [f"/logs/{name}.mcap" for name in "abcde"]
    assert found["logs"][2] == {
        "url": "/logs/c.mcap",
        "log": "c",
        "outcome": "failed",
        "exit_code": 3,
        "message": "cut",
        "lidarcli": "0.1.0",
        "size": 1000,
        "sweeps": None,
        "rows": None,
        "seconds": None,
        "ended": "2023-11-14T22:13:20.000Z",
    }


def test_junit_has_a_case_per_log_and_per_check(lidarcli: Run, fleet: Path) -> None:
    ran = lidarcli("report", fleet, "--format", "junit", "--check", "failed == 0", "--check", "damaged < 2")
    assert ran.code == 1
    suite = ET.fromstring(ran.out.encode())[0]
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("7", "3", "0")
    cases = {case.get("name"): [child.get("message") for child in case] for case in suite.iter("testcase")}
    assert cases == {
        "/logs/a.mcap": [],
        "/logs/b.mcap": [],
        "/logs/c.mcap": ["failed, exit code 3: cut"],
        "/logs/d.mcap": ["damaged, exit code 3: byte 9"],
        "/logs/e.mcap": [],
        "failed == 0": ["expected == 0, found 1"],
        "damaged < 2": [],
    }
    properties = {item.get("name"): item.get("value") for item in suite.iter("property")}
    assert properties["sweeps_per_second"] == "200"


def test_checks_decide_the_exit_code(lidarcli: Run, fleet: Path) -> None:
    accepted = [word for check in ("failed <= 1", "damaged <= 1") for word in ("--check", check)]
    wanted = ("--check", "logs == 5", "--check", "seconds between 1 and 3")
    ran = lidarcli("report", fleet, *wanted, *accepted)
    assert (ran.code, ran.err) == (0, "")
    ran = lidarcli("report", fleet, "--check", "failed == 0", "--check", "damaged < 2")
    assert ran.code == 1
    assert ran.out.startswith("Checks: 1 of 2 failed\nFAIL  failed == 0  (found 1)\n")
    assert ran.err == "lidarcli: check failed: failed is 1, expected == 0\n"


@pytest.mark.parametrize(
    ("expression", "why"),
    [
        ("faild == 0", "unknown figure 'faild'; did you mean failed? docs/reports.md has all;"),
        ("objects > 1", "unknown figure 'objects'; docs/reports.md has all;"),
        ("sweeps where objects > 3 == 0", "expected a comparison (==, !=, <=, >=, <, >, between)"),
        ("delta.logs == 0", "unknown figure 'delta.logs'"),
    ],
)
def test_a_check_that_makes_no_sense_is_a_usage_error(lidarcli: Run, fleet: Path, expression: str, why: str) -> None:
    ran = lidarcli("report", fleet, "--check", expression)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.startswith(f"lidarcli: --check '{expression}': {why}")
    assert len(ran.err.splitlines()) == 1


def test_what_does_not_go_with_manifests_is_a_usage_error(lidarcli: Run, fleet: Path) -> None:
    tables = fleet.parent
    for words, why in (
        ((fleet, tables), f"{fleet} is a manifest of runs and {tables} is none"),
        ((tables, fleet), f"{fleet} is a manifest of runs and {tables} is none"),
        ((fleet, "--baseline", tables), f"{fleet}: --baseline compares tables"),
        ((tables, "--baseline", fleet), f"{fleet}: --baseline compares tables"),
        ((fleet, "--log", ROOT / "samples" / "room.mcap"), f"{fleet}: --log belongs to tables"),
    ):
        ran = lidarcli("report", *words)
        assert (ran.code, ran.out) == (2, "")
        assert f"Error: {why}" in ran.err


def test_a_manifest_that_cannot_be_read(lidarcli: Run, fleet: Path) -> None:
    bad = fleet / "run-0.parquet"
    bad.write_bytes(b"PAR1 is not enough")
    ran = lidarcli("report", fleet, "--check", "failed == 0")
    assert ran.code == 3
    assert ran.err.splitlines()[0].startswith(f"lidarcli: {bad}: cannot be read as Parquet: ")
    assert "2 runs over 5 logs" in ran.out
    odd = write_manifest(fleet.parent, "3", [row("f", "fine")])
    ran = lidarcli("report", odd)
    assert (ran.code, ran.out) == (3, "")
    assert ran.err == f"lidarcli: {odd}: column outcome holds 'fine', not ok, damaged or failed\n"
    for kind in FORMATS:
        assert lidarcli("report", fleet, "--format", kind).code == 3


def test_nothing_to_report_on(lidarcli: Run, tmp_path: Path) -> None:
    folder = tmp_path / "_lidarcli"
    folder.mkdir()
    for name, why in (
        (folder, "no manifest in this folder; detect --resume writes one"),
        (folder / "run-*.parquet", "no manifest matches this pattern; detect --resume writes one"),
        (folder / "run-1.parquet", "no such file or folder"),
        (tmp_path / "other" / "_lidarcli", "no such file or folder"),
    ):
        ran = lidarcli("report", name)
        assert (ran.code, ran.out, ran.err) == (3, "", f"lidarcli: {name}: {why}\n")


class Tags(HTMLParser):
    """Elements that are open, each of which has to be closed in turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag != "meta":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_texts_of_logs_stay_texts(lidarcli: Run, tmp_path: Path) -> None:
    odd = "<b>\x1b[2J\u202e & | `x`"
    path = write_manifest(tmp_path, "1", [row(odd, "failed", odd), row("d", "damaged", None)])
    page = lidarcli("report", path, "--format", "html", "--check", "failed == 0").out
    tags = Tags()
    tags.feed(page)
    assert tags.open == []
    assert ("<b>" in page, "<script" in page, page.startswith("<!doctype html>")) == (False, False, True)
    assert "&lt;b&gt;" in page
    for kind in ("text", "markdown"):
        out = lidarcli("report", path, "--format", kind).out
        assert all(line.isprintable() for line in out.splitlines())
        assert "exit code 3: no message" in out
    suite = ET.fromstring(lidarcli("report", path, "--format", "junit").out.encode())[0]
    assert suite.get("failures") == "2"
