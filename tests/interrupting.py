"""Commands that are told to end at a moment that is named, not hit: an event of which Python tells its audit hooks."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from signal import Signals

from tests.waiting import HANG

_CHILD = """
import os, signal, sys
event, about, number, *sys.argv[1:] = sys.argv[1:]
def hook(happens, arguments):
    global event
    if happens == event and any(about in str(argument) for argument in arguments):
        event = None
        os.kill(os.getpid(), int(number))
sys.addaudithook(hook)
from lidarcli.__main__ import main
main()
assert event is None, "it never came"
"""
MOMENTS = {
    "while modules are imported": ("import", "lidarcli.sweeps.types"),
    "before the log is read": ("open", "run."),
    "as a private folder is made": ("os.mkdir", ".part"),
    "before the outputs get their names": ("os.rename", ".part"),
}
"""Events (https://docs.python.org/3/library/audit_events.html), each with a word of its arguments."""


STARTS = {
    "before the processes for logs are known": ("import", "lidarcli.pipeline.runs.processes"),
    "before the tracker of resources starts": ("import", "multiprocessing.resource_tracker"),
    "before the first worker starts": ("import", "multiprocessing.popen_spawn_posix"),
}
"""The same of several logs and `--jobs 2`."""

ENDS = {"as a private folder is removed": ("os.rmdir", ".part")}
"""The same once the outputs have their names."""


def ended(moment: str, signal: Signals, *words: object) -> subprocess.CompletedProcess[str]:
    """Run `lidarcli WORDS`, and send it the signal at this moment.

    Parameters
    ----------
    moment : a name in `MOMENTS`, `STARTS` or `ENDS`
    words : command, options and a log whose name begins with `run.`
    """
    event, about = (MOMENTS | STARTS | ENDS)[moment]
    command: Sequence[str] = [sys.executable, "-c", _CHILD, event, about, str(int(signal)), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=False)


def left(folder: Path) -> list[str]:
    """Names of all that lies below a folder, which need not be there."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
