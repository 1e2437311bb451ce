"""One case: it is read by everything that reads such files, and what is not allowed to happen is told."""

from __future__ import annotations

import gc
import os
import re
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path

from tools.fuzz.place import Place, differences, snapshot
from tools.fuzz.target import Target

SMALL = 1_000_000
"""Inputs below so many bytes have to keep to `SECONDS` and `PEAK_MB`."""
SECONDS = float(os.environ.get("FUZZ_SECONDS", 5.0))
"""Processor time that a case may take: more counts as a hang."""
PEAK_MB = 500.0
"""Resident memory of the process that reads; without any input it has 200 to 250 MB."""
RSS_UNIT = 1 if sys.platform == "darwin" else 1024
_RESET = Path("/proc/self/clear_refs")
_STATUS = Path("/proc/self/status")


@cache
def import_once() -> None:
    """Import what the commands import when they run: the case that comes first would be blamed for it."""
    import lidarcli.pipeline.detecting
    import lidarcli.pipeline.reporting
    import lidarcli.pipeline.viewing
    import lidarcli.reports.html  # noqa: F401


def judge(target: Target, place: Place) -> list[str]:
    """What went wrong with a case that lies in its place."""
    watched = {name: getattr(place, name) for name in ("input", "victims")}
    before = {name: snapshot(folder) for name, folder in watched.items()}
    beside = _names(place.root)
    small = sum(size for _, size, _, _ in before["input"].values()) < SMALL
    import_once()
    # Garbage of earlier cases that goes while this one works would make up for what it takes.
    gc.collect()
    reset_peak()
    held = peak_mb()
    started = time.process_time()
    problems = list(target.judge(place))
    seconds, peak = time.process_time() - started, peak_mb() - held
    if small and seconds > SECONDS:
        problems.append(f"took {seconds:.1f} s")
    if small and peak > PEAK_MB:
        problems.append(f"took {peak:.0f} MB of memory")
    for name, folder in watched.items():
        problems += [f"{name}: {line}" for line in differences(before[name], snapshot(folder))]
    problems += [f"made {name} beside the input" for name in _names(place.root) if name not in beside]
    if left := _names(place.scratch):
        problems.append(f"left temporary files: {', '.join(left)}")
    if list(_open_files(place.root)):
        # What only the traceback of an error still holds is not lost.
        gc.collect()
    return problems + [f"left open: {name}" for name in _open_files(place.root)]


def reset_peak() -> None:
    """Forget the greatest memory so far, where the system lets a process do so (Linux)."""
    with suppress(OSError):
        _RESET.write_text("5")


def peak_mb() -> float:
    """The greatest resident memory [MB] since `reset_peak`, or of the whole process where that is not to be had."""
    with suppress(OSError):
        found = re.search(r"VmHWM:\s+(\d+) kB", _STATUS.read_text())
        if found is not None:
            return int(found[1]) * 1024 / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * RSS_UNIT / 1e6


def _names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def _open_files(folder: Path) -> Iterator[str]:
    """Files below a folder that this process has open, where the system tells."""
    handles = Path("/proc/self/fd")
    if not handles.exists():
        return
    for handle in sorted(handles.iterdir()):
        with suppress(OSError):
            name = str(handle.readlink())
            if name.startswith(str(folder)):
                yield name
