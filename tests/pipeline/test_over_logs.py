"""Several logs, one after the other or in several processes: one that is bad does not stop the rest."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import threading
import weakref
from collections.abc import Generator
from functools import partial
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import cast

import pytest

from lidarcli.errors import UnreadableError
from lidarcli.files.newfiles import scratch_folder
from lidarcli.logs.base import OpenOptions
from lidarcli.pipeline import detecting
from lidarcli.pipeline.detecting import detect_files
from lidarcli.pipeline.inputs.sources import MissingInput, Source
from lidarcli.pipeline.objects.detection import DetectOptions
from lidarcli.pipeline.reading.one_log import RunSummary
from lidarcli.pipeline.runs.over_logs import Outcome, exit_code, outcome_of, over_logs
from tests.fake_log import FakeLog
from tests.pipeline.in_memory import SCAN, SOURCE, block
from tests.waiting import wait_until


def test_one_bad_log_does_not_stop_the_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def opens(source: Source, csv: OpenOptions) -> FakeLog:
        if source.path == "bad":
            raise UnreadableError("bad: byte 0: not a log")
        if source.path == "bug":
            raise ZeroDivisionError("oops")
        return FakeLog([block()], [SCAN])

    monkeypatch.setattr(detecting, "open_source", opens)
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
    def fails(source: Source) -> RunSummary:
        raise OSError(5, "Input/output error")

    assert outcome_of(SOURCE, fails) == Outcome("run.fake", 3, error="Input/output error")


def test_a_closed_pipe_is_not_the_fault_of_a_log() -> None:
    def fails(source: Source) -> RunSummary:
        raise BrokenPipeError

    with pytest.raises(BrokenPipeError):
        outcome_of(SOURCE, fails)


def test_first_code_that_is_not_zero_wins() -> None:
    assert exit_code([0, 4, 3]) == 4
    assert exit_code([0, 0]) == 0


def _dies_once(source: Source, folder: Path, *, progress: object = None) -> RunSummary:
    """Stands in for the work of a worker: the log `dies` kills its process the first time, `fatal` every time."""
    mark = folder / f"{source.label}.tried"
    if source.label == "fatal" or (source.label == "dies" and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return RunSummary()


@pytest.mark.slow
def test_a_dead_worker_costs_no_log(tmp_path: Path) -> None:
    sources = [Source(name, name) for name in ("a", "dies", "b", "c")]
    outcomes = list(over_logs(sources, partial(_dies_once, folder=tmp_path), at_once=2))
    assert [(outcome.label, outcome.exit_code) for outcome in outcomes] == [(name.path, 0) for name in sources]
    assert outcomes[1].remark == "a worker process died; this log was done again"


@pytest.mark.slow
def test_a_log_that_kills_every_worker(tmp_path: Path) -> None:
    sources = [Source(name, name) for name in ("a", "fatal", "b")]
    outcomes = list(over_logs(sources, partial(_dies_once, folder=tmp_path), at_once=2))
    assert [(outcome.label, outcome.exit_code) for outcome in outcomes] == [("a", 0), ("fatal", 70), ("b", 0)]
    assert outcomes[1].error == (
        "its worker process died twice, ended by the system (out of memory?); try it alone with --jobs 1"
    )


class _Ends:
    """Its end, at which Python ignores errors, comes only with a signal."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __del__(self) -> None:
        (self.folder / "begun").touch()
        signal.pause()


def _is_stopped(source: Source, folder: Path, *, progress: object = None) -> RunSummary:
    """Stands in for work that comes to no end by itself, but for that of the log `short`."""
    if source.label == "short":
        return RunSummary()
    with scratch_folder(folder) as scratch:
        if source.label == "ends":
            thing = _Ends(scratch)
            del thing
        try:
            (scratch / "begun").touch()
            signal.pause()
        except BaseException:
            if source.label == "writes":
                raise
            # As a library does that makes an error of its own of it.
        while source.label == "endless":
            signal.pause()
    return RunSummary()


def _at_work(name: str, folder: Path) -> Generator[Outcome]:
    """The outcomes that are left while a worker is busy with the log of this name."""
    sources = [Source(name, name) for name in ("short", name)]
    outcomes = cast("Generator[Outcome]", over_logs(sources, partial(_is_stopped, folder=folder), at_once=2))
    assert next(outcomes).label == "short"
    wait_until(lambda: [*folder.glob(".*.part/begun")])
    return outcomes


@pytest.mark.slow
@pytest.mark.parametrize("name", ["writes", "ends", "ignores"])
def test_a_worker_that_is_stopped_clears_away_however_long_it_takes(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every limit of time is over at once, as on a machine that is busy; and processes of others are left alone."""
    join = BaseProcess.join
    monkeypatch.setattr(BaseProcess, "join", lambda self, timeout=None: join(self) if timeout is None else None)
    other = multiprocessing.get_context("spawn").Process(target=signal.pause)
    other.start()
    try:
        _at_work(name, tmp_path).close()
        assert [*tmp_path.iterdir()] == []
        assert multiprocessing.active_children() == [other]
    finally:
        other.kill()
        other.join()


@pytest.mark.slow
def test_a_further_interrupt_waits_for_no_worker(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    join = BaseProcess.join

    def interrupted(self: BaseProcess, timeout: float | None = None) -> None:
        if threading.current_thread() is threading.main_thread():
            raise KeyboardInterrupt
        join(self, timeout)

    outcomes = _at_work("endless", tmp_path)
    with monkeypatch.context() as patching:
        patching.setattr(BaseProcess, "join", interrupted)
        with pytest.raises(KeyboardInterrupt):
            outcomes.close()
    assert multiprocessing.active_children() == []


class Reader:
    """Refers to itself, as what reads a log does."""

    def __init__(self) -> None:
        self.itself = self


@pytest.mark.parametrize("fails", [False, True])
def test_each_log_takes_its_garbage_along(fails: bool) -> None:
    left: list[weakref.ref[Reader]] = []
    still_there = []

    def work(log: Source, *, progress: object = None) -> RunSummary:
        still_there.append(sum(each() is not None for each in left))
        left.append(weakref.ref(Reader()))
        if fails:
            raise UnreadableError("no log")
        return RunSummary()

    gc.disable()
    try:
        outcomes = [*over_logs([Source(f"log{number}", str(number)) for number in range(5)], work)]
    finally:
        gc.enable()
    assert [outcome.exit_code for outcome in outcomes] == [3 * fails] * 5
    assert still_there == [0] * 5
