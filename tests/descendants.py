"""Processes that a process has started, by /proc."""

from __future__ import annotations

import time
from pathlib import Path


def descendants(pid: int) -> set[int]:
    """Processes that a process has started, and those that these have."""
    parents = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            stat = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if stat[0] != "Z":
            parents[int(folder.name)] = int(stat[1])
    found = {pid}
    while more := {child for child, parent in parents.items() if parent in found} - found:
        found |= more
    return found - {pid}


def gone(pids: set[int]) -> bool:
    """Whether processes end within some seconds."""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        running = {pid for pid in pids if Path(f"/proc/{pid}").exists()}
        states = {(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]) for pid in running}
        if states <= {"Z"}:
            return True
        time.sleep(0.02)
    return False
