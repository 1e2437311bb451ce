"""Ctrl-C at the moments at which it would leave something half done."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pyarrow as pa
import pytest

from lidarcli.files.newfiles import NewFiles
from lidarcli.tabular.writing import ROWS_PER_GROUP, ParquetSink
from tests.waiting import HANG


def said(script: str) -> str:
    """Standard output of a script that ends well and writes nothing else."""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=HANG, check=False)
    assert (ran.stderr, ran.returncode) == ("", 0)
    return ran.stdout


IMPORTED = """
import os, signal, time
os.kill(os.getpid(), signal.SIGINT)
time.sleep(0.1)
whole = True
"""
IMPORTING = """
import signal, sys, time
from lidarcli.system.interrupts import wait_for_imports
wait_for_imports()
try:
    import imported
    time.sleep(10)
except KeyboardInterrupt as err:
    print(type(err).__name__, sys.modules["imported"].whole)
"""


@pytest.mark.parametrize(("number", "raised"), [("SIGINT", "KeyboardInterrupt"), ("SIGTERM", "Terminated")])
def test_it_waits_for_an_import(tmp_path: Path, number: str, raised: str) -> None:
    (tmp_path / "imported.py").write_text(IMPORTED.replace("SIGINT", number))
    ran = subprocess.run(
        [sys.executable, "-c", IMPORTING],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )
    assert (ran.stdout, ran.stderr, ran.returncode) == (f"{raised} True\n", "", 0)


COMPARING = """
import enum, os, signal, sys, time
import numpy as np
from lidarcli.system.interrupts import wait_for_imports
from lidarcli.sweeps.types import Status
wait_for_imports()
def inside(frame, event, argument):
    if frame.f_code.co_filename == enum.__file__:
        sys.settrace(None)
        os.kill(os.getpid(), signal.NUMBER)
        time.sleep(0.005)
sys.settrace(inside)
try:
    same = np.zeros(3, np.uint8) == Status.VALID
    sys.settrace(None)
    time.sleep(10)
except KeyboardInterrupt as err:
    print(type(err).__name__, same.all())
"""


@pytest.mark.parametrize(("number", "raised"), [("SIGINT", "KeyboardInterrupt"), ("SIGTERM", "Terminated")])
def test_numpy_does_not_swallow_it_over_an_enumeration(number: str, raised: str) -> None:
    assert said(COMPARING.replace("NUMBER", number)) == f"{raised} True\n"


IGNORING = """
import os, signal, sys
from lidarcli.system.interrupts import wait_for_imports
wait_for_imports()
class Ends:
    def __del__(self):
        os.kill(os.getpid(), signal.NUMBER)
        print("never said")
ended = []
try:
    thing = Ends()
    del thing
    ended.append("the run")
except KeyboardInterrupt as err:
    print(type(err).__name__, ended)
"""


@pytest.mark.parametrize(("number", "raised"), [("SIGINT", "KeyboardInterrupt"), ("SIGTERM", "Terminated")])
def test_python_does_not_ignore_it_where_an_object_ends(number: str, raised: str) -> None:
    assert said(IGNORING.replace("NUMBER", number)) == f"{raised} []\n"


IMPATIENT = """
import os, signal, time
from lidarcli.system import interrupts
class Clock:
    now = 100.0
    def monotonic():
        return Clock.now
interrupts.time = Clock
interrupts.wait_for_imports()
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(10)
except KeyboardInterrupt:
    Clock.now += 0.99
    os.kill(os.getpid(), signal.SIGINT)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(0.1)
    print("cleared away")
Clock.now += 0.01
try:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(10)
except KeyboardInterrupt:
    print("again")
"""


def test_an_impatient_user_does_not_disturb_the_clearing_away() -> None:
    assert said(IMPATIENT) == "cleared away\nagain\n"


STARTING = """
import os, signal, time
from lidarcli.system.interrupts import wait_for_imports
from lidarcli.pipeline.runs import processes
wait_for_imports()
inside = []
if __name__ == "__main__":
    ensure = processes.resource_tracker.ensure_running
    def interrupted():
        os.kill(os.getpid(), signal.NUMBER)
        time.sleep(0.1)
        ensure()
        inside.append("the start goes on")
    processes.resource_tracker.ensure_running = interrupted
    try:
        processes.start_workers(1)
        time.sleep(10)
    except KeyboardInterrupt as err:
        print(*inside, type(err).__name__)
"""


@pytest.mark.parametrize(("number", "raised"), [("SIGINT", "KeyboardInterrupt"), ("SIGTERM", "Terminated")])
def test_it_waits_for_the_start_of_processes(tmp_path: Path, number: str, raised: str) -> None:
    script = tmp_path / "starting.py"
    script.write_text(STARTING.replace("NUMBER", number))
    ran = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=HANG, check=False)
    assert (ran.stdout, ran.stderr, ran.returncode) == (f"the start goes on {raised}\n", "", 0)


def test_where_it_is_ignored_it_stays_ignored() -> None:
    script = (
        "import signal; from lidarcli.system.interrupts import wait_for_imports; wait_for_imports();"
        "signal.raise_signal(signal.SIGINT); print('still here')"
    )
    ran = subprocess.run(
        ["sh", "-c", 'trap "" INT; exec "$@"', "sh", sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=HANG,
        check=True,
    )
    assert ran.stdout == "still here\n"


def interrupted_start(monkeypatch: pytest.MonkeyPatch) -> None:
    start = threading.Thread.start

    def interrupted(thread: threading.Thread) -> None:
        start(thread)
        time.sleep(0.002)
        raise KeyboardInterrupt

    monkeypatch.setattr(threading.Thread, "start", interrupted)


def test_no_thread_is_at_a_table_that_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupt while the writing thread starts: two at one file would crash the process."""
    schema = pa.schema([("x", pa.float64())])
    rows = pa.record_batch([pa.array(range(ROWS_PER_GROUP), pa.float64())], schema=schema)
    interrupted_start(monkeypatch)
    working: list[bool] = []
    monkeypatch.setattr("lidarcli.tabular.writing.ParquetSink._write", lambda *_: working.append(True))
    path = tmp_path / "x.parquet"
    with pytest.raises(KeyboardInterrupt), NewFiles([path]) as new, ParquetSink(new.part(path), schema) as file:
        file.write(rows)
    time.sleep(0.05)
    assert working == []
    assert list(tmp_path.iterdir()) == []


CLOSING = """
import os, signal, sys, threading, time
from lidarcli.system.machine import Threads
done, begun = [], threading.Event()
def closing():
    frame = sys._current_frames()[threading.main_thread().ident]
    while frame is not None and frame.f_code is not Threads.close.__code__:
        frame = frame.f_back
    return frame is not None
def work():
    begun.set()
    while not closing():
        time.sleep(0.001)
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.3)
    done.append("work")
thread = Threads("test")
thread.submit(work)
thread.submit(done.append, "what was to follow")
begun.wait()
try:
    thread.close()
except KeyboardInterrupt:
    print(done)
"""


def test_work_comes_to_its_end_whatever_interrupts() -> None:
    assert said(CLOSING) == "['work']\n"
