"""What is said of a log that was read."""

from __future__ import annotations

from collections import Counter

import pytest

from lidarcli.cli.messages import Messages, show
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.runs.over_logs import Outcome


def said(run: RunSummary, verbose: bool = False) -> list[str]:
    lines: list[str] = []
    show(Outcome("run.mcap", 0, run), Messages(verbose=verbose, write=lines.append))
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
