"""Several logs, one after the other: one that is bad does not stop the rest."""

from __future__ import annotations

from pathlib import Path

import pytest

from lidarcli.errors import UnreadableError
from lidarcli.logs.base import OpenOptions
from lidarcli.pipeline.detecting import detect_files
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.objects.options import DetectOptions
from lidarcli.pipeline.reading import one_log
from lidarcli.pipeline.runs.outcomes import Outcome, exit_code, outcome_of
from tests.fake_log import FakeLog
from tests.pipeline.in_memory import SCAN, SOURCE, block


def test_one_bad_log_does_not_stop_the_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def opens(source: Source, csv: OpenOptions) -> FakeLog:
        if source.path == "bad":
            raise UnreadableError("bad: byte 0: not a log")
        if source.path == "bug":
            raise ZeroDivisionError("oops")
        return FakeLog([block()], [SCAN])

    monkeypatch.setattr(one_log, "open_source", opens)
    sources = [Source(name, name) for name in ("bad", "bug", "good")]
    absent = MissingInput("absent", UnreadableError("no such file or folder"))
    outcomes = list(detect_files([*sources, absent], tmp_path, DetectOptions(jobs=1)))
    assert [(outcome.label, outcome.exit_code, outcome.error) for outcome in outcomes] == [
        ("bad", 3, "byte 0: not a log"),
        ("bug", 70, "internal error: ZeroDivisionError: oops"),
        ("good", 0, None),
        ("absent", 3, "no such file or folder"),
    ]
    assert "Traceback" in (outcomes[1].trace or "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["good.objects.parquet", "good.sweeps.parquet"]


def test_system_errors_while_reading_are_no_bugs() -> None:
    def fails(source: Source) -> one_log.RunSummary:
        raise OSError(5, "Input/output error")

    assert outcome_of(SOURCE, fails) == Outcome("run.fake", 3, error="Input/output error")


def test_a_closed_pipe_is_not_the_fault_of_a_log() -> None:
    def fails(source: Source) -> one_log.RunSummary:
        raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        outcome_of(SOURCE, fails)


def test_first_code_that_is_not_zero_wins() -> None:
    assert exit_code([0, 4, 3]) == 4
    assert exit_code([0, 0]) == 0
