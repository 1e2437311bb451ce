"""What is said of a log and of a run: to people, and as one document on standard output."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import lidarcli as package
from lidarcli.cli.messages import MessageWriter, show
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.runs.over_logs import Outcome
from lidarcli.simulation.writers import write_log
from tests.sweeping import raw_sweeps, round_room


def said(run: RunSummary, verbose: bool = False) -> list[str]:
    lines: list[str] = []
    show(Outcome("run.mcap", 0, run), MessageWriter(verbose=verbose, write=lines.append))
    return lines


def run_of(seconds: float, **counts: int) -> RunSummary:
    run = RunSummary(sweeps=1000, objects=2000, seconds=seconds)
    run.by_status = Counter(counts)
    run.by_set = Counter(O=600, A=0, S=sum(counts.values()) - 600)
    return run


@pytest.mark.parametrize(("seconds", "speed"), [(0.5, ""), (2.0, ", 500 sweeps/s")])
def test_a_speed_is_told_where_it_is_not_that_of_starting(seconds: float, speed: str) -> None:
    lines = said(run_of(seconds, valid=1000))
    assert lines[0] == "run.mcap: 1,000 sweeps, 2,000 objects"
    assert not any("sweeps/s" in line for line in lines)
    detailed = said(run_of(seconds, valid=1000), verbose=True)
    assert f"  time     {seconds:.3f} s{speed}" in detailed


def test_what_does_not_occur_is_left_out_and_lines_fit_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    lines = said(run_of(0.1, valid=71_962_000, no_return=136_000, too_close=100_000, invalid=102_000))
    assert lines[1:] == [
        "  beams    72,300,000: valid 71,962,000 (99.5%), no return 136,000 (0.2%),",
        "           too close 100,000 (0.1%), invalid 102,000 (0.1%)",
        "  on       objects 600 (0.0%), walls and rest 72,299,400 (100.0%)",
    ]
    run = run_of(0.1, valid=1000)
    run.things = 0
    assert said(run)[1:] == [
        "  beams    1,000: valid 1,000 (100.0%)",
        "  on       agents 0 (0.0%), other objects 600 (60.0%),",
        "           walls and rest 400 (40.0%)",
    ]


Run = Callable[..., Any]
ZONES = (
    '[[zone]]\nname = "near"\nframe = "sensor"\ncircle = {x = 0.0, y = 0.0, radius = 2.5}\n'
    '[[zone]]\nname = "door"\nframe = "sensor"\nline = [[1.0, 1.0], [1.0, 2.0]]\n'
)
OF_LOG = ["log", "exit_code", "error", "skipped", "sweeps", "topics", "missing_topics", "beams"]
AFTER = ["damage", "notes", "routine", "written"]
FOUND = ["objects", "on_agents", "tracks", "moving", "people", "sets"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory: `run.mcap`, a sensor at rest in whose room a box goes round, and zones."""
    monkeypatch.chdir(tmp_path)
    ranges = round_room(40)
    for sweep in range(40):
        ranges[sweep, 40 + 3 * sweep : 60 + 3 * sweep] = 2.0
    write_log(tmp_path / "run.mcap", [raw_sweeps(ranges)])
    (tmp_path / "zones.toml").write_text(ZONES)
    return tmp_path


def told(lidarcli: Run, *words: str, code: int = 0) -> dict[str, Any]:
    ran = lidarcli("-q", *words, "--format", "json")
    assert ran.code == code, ran.err
    document: dict[str, Any] = json.loads(ran.out)
    assert document["exit_code"] == code
    return document


def test_detect_tells_of_each_log(folder: Path, lidarcli: Run) -> None:
    document = told(lidarcli, "detect", "run.mcap", "none.mcap", "-o", "out", code=3)
    assert [*document] == ["exit_code", "logs", "notes", "routine", "written"]
    run, none = document["logs"]
    assert [*run] == [*OF_LOG, *FOUND, *AFTER]
    assert (run["log"], run["sweeps"], run["topics"], run["objects"]) == ("run.mcap", 40, ["/scan"], 40)
    assert (run["tracks"], run["beams"]["valid"], sum(run["sets"].values())) == (None, 14400, 14400)
    assert run["written"] == document["written"] == ["out/run.objects.parquet", "out/run.sweeps.parquet"]
    assert none == {"log": "none.mcap", "exit_code": 3, "error": "no such file or folder", "skipped": False}


def test_track_counts_as_the_text_does(folder: Path, lidarcli: Run) -> None:
    (run,) = told(lidarcli, "track", "run.mcap", "-o", "out")["logs"]
    text = lidarcli("track", "run.mcap", "-o", "out", "--overwrite").err.splitlines()[0]
    assert text == (
        f"run.mcap: {run['sweeps']} sweeps, {run['objects']} objects ({run['on_agents']} of agents), "
        f"{run['tracks']} track ({run['moving']} agent{'' if run['moving'] == 1 else 's'})"
    )
    assert run["moving"] == 1
    (again,) = told(lidarcli, "track", "run.mcap", "-o", "out", "--resume")["logs"]
    assert again == {"log": "run.mcap", "exit_code": 0, "error": None, "skipped": True}


def test_background_tells_what_it_learned_and_found(folder: Path, lidarcli: Run) -> None:
    document = told(lidarcli, "background", "build", "run.mcap", "-o", "b.parquet")
    (sensor,) = document["sensors"]
    (learned,) = json.loads(lidarcli("info", "b.parquet", "--format", "json").out)
    assert sensor == learned["sensors"][0]
    assert [*document["logs"][0]] == [*OF_LOG, *AFTER]
    assert document["written"] == ["b.parquet"]
    document = told(lidarcli, "background", "subtract", "run.mcap", "--background", "b.parquet", "-o", "out")
    assert document["logs"][0]["objects"] == 40
    assert document["notes"] == ["compared with b.parquet: 40 appeared"]


def test_zones_tell_figures_and_checks(folder: Path, lidarcli: Run) -> None:
    words = ("zones", "run.mcap", "--zones", "zones.toml", "--check", "zones.near.events == 0")
    document = told(lidarcli, *words, code=1)
    assert document["checks"] == [{"check": "zones.near.events == 0", "holds": False, "expected": "== 0", "found": 1}]
    (run,) = document["logs"]
    events = package.zones("run.mcap", zones="zones.toml").events
    assert run["figures"]["zones.near.events"] == events["kind"].to_pylist().count("occupied") == 1
    assert run["figures"]["zones.near.nearest"] == 2
    # An area is not crossed, and nobody dwells in a line.
    assert (run["figures"]["zones.near.in"], run["figures"]["zones.door.in"]) == (None, 0)
    assert run["written"] == []


def test_map_poses_clean_and_overlay(folder: Path, lidarcli: Run) -> None:
    document = told(lidarcli, "map", "run.mcap", "--pose", "match", "-o", "room.yaml")
    assert [*document["map"]] == ["sweeps", "worlds", "resolution", "width", "height", "occupied", "free"]
    pixels = np.frombuffer(Path("room.pgm").read_bytes()[-document["map"]["width"] * document["map"]["height"] :], np.uint8)
    assert np.count_nonzero(pixels == 0) == document["map"]["occupied"] > 100
    assert document["written"] == ["room.yaml", "room.pgm"]
    document = told(lidarcli, "poses", "run.mcap", "--pose", "match", "-o", "run.tum")
    assert document["logs"][0]["poses"] == 40 == len(Path("run.tum").read_text().splitlines())
    document = told(lidarcli, "clean", "run.mcap", "-o", "c.mcap")
    assert document["written"] == ["c.mcap", "c.cleaned.parquet"]
    assert document["logs"][0]["removed"]["agents"] > 700
    document = told(lidarcli, "overlay", "run.mcap", "-o", "o.mcap", "--no-layout")
    assert (document["logs"][0]["tracks"], document["written"]) == (1, ["o.mcap"])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("-o", "-"), "--format json is the summary, for -o DIR; objects as JSON are --format ndjson"),
        (("--dry-run",), "--dry-run prints a plan and no summary: leave out --format json"),
    ],
)
def test_what_has_no_summary_refuses(folder: Path, lidarcli: Run, words: tuple[str, ...], message: str) -> None:
    ran = lidarcli("detect", "run.mcap", *words, "--format", "json")
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.splitlines()[-1] == f"Error: {message}"
