"""Several logs side by side: worker processes that die cost no log."""

from __future__ import annotations

import os
import signal
from functools import partial
from pathlib import Path

import pytest

from lidarcli.pipeline.inputs.sources import Source
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.runs.processes import side_by_side

pytestmark = pytest.mark.slow


def _dies_once(source: Source, folder: Path) -> RunSummary:
    """Stands in for the work of a worker: the log `dies` kills its process the first time, `fatal` every time."""
    mark = folder / f"{source.label}.tried"
    if source.label == "fatal" or (source.label == "dies" and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return RunSummary()


def test_a_dead_worker_costs_no_log(tmp_path: Path) -> None:
    sources = [Source(name, name) for name in ("a", "dies", "b", "c")]
    outcomes = list(side_by_side(sources, partial(_dies_once, folder=tmp_path), 2))
    assert [(outcome.label, outcome.exit_code) for outcome in outcomes] == [(name.path, 0) for name in sources]
    assert outcomes[1].remark == "a worker process died; this log was done again"


def test_a_log_that_kills_every_worker(tmp_path: Path) -> None:
    sources = [Source(name, name) for name in ("a", "fatal", "b")]
    outcomes = list(side_by_side(sources, partial(_dies_once, folder=tmp_path), 2))
    assert [(outcome.label, outcome.exit_code) for outcome in outcomes] == [("a", 0), ("fatal", 70), ("b", 0)]
    assert outcomes[1].error == (
        "its worker process died twice, ended by the system (out of memory?); try it alone with --jobs 1"
    )
