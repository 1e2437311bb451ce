"""Two runs of `detect` into one folder at once: every table is whole and of one of the two."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

from lidarcli.simulation.writers import write_log
from tools.fuzz.commands import run
from tools.fuzz.containers import STEP_NS, SWEEPS, sweeps
from tools.fuzz.place import Place
from tools.fuzz.target import Random, Target

NAMES = ("run.objects.parquet", "run.sweeps.parquet", "run.beams.parquet")
LOGS = ("a", "b")
BLOCKS = 150
"""Blocks of `SWEEPS` sweeps in a log: enough for the two runs to meet."""
LATER = (0.0, 0.0, 0.05, 0.1, 0.2, 0.3)
"""How long after the first the second begins [s]."""
LONGEST = 15.0
"""A run that takes longer hangs [s]."""
CODES = (0, 5)


@cache
def log(which: str) -> bytes:
    """A log that takes a while."""
    blocks = []
    for number in range(BLOCKS):
        block = sweeps(seed=number + 1000 * LOGS.index(which))
        later = number * SWEEPS * STEP_NS
        blocks.append(replace(block, stamp_ns=block.stamp_ns + later, record_ns=block.record_ns + later))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        write_log(path, blocks)
        return path.read_bytes()


@cache
def alone(which: str) -> dict[str, bytes]:
    """The tables of a run of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        path.write_bytes(log(which))
        ran = run(["-q", "detect", str(path), "-o", folder, "--beams"])
        if ran.code:
            raise RuntimeError(ran.err)
        return {name: (Path(folder) / name).read_bytes() for name in NAMES}


def write(place: Place, number: int, random: Random) -> None:
    """The same log or two; number 0 and 1 are what broke tables first: two logs with and one without --overwrite."""
    same = bool(random.integers(2)) if number > 1 else False
    for which in LOGS:
        (place.input / which).mkdir()
        (place.input / which / "run.mcap").write_bytes(log(LOGS[0] if same else which))
    place.note(
        overwrite=number == 0 or (number > 1 and bool(random.integers(2))),
        same=same,
        later=float(random.choice(LATER)) if number > 1 else 0.0,
    )
    for which in LOGS:
        alone(which)


def judge(place: Place) -> Iterator[str]:
    """Start both, wait, compare with what each makes alone."""
    given = place.noted()
    runs = []
    for which in LOGS:
        command = [sys.executable, "-m", "lidarcli", "-q", "detect", f"in/{which}/run.mcap", "-o", "out", "--beams"]
        command += ["--overwrite"] if given["overwrite"] else []
        runs.append(
            subprocess.Popen(
                command,
                cwd=place.root,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            )
        )
        time.sleep(given["later"])
    codes = []
    over = time.monotonic() + LONGEST
    for which, process in zip(LOGS, runs, strict=True):
        try:
            _, said = process.communicate(timeout=max(0.1, over - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            yield f"{which}: hangs"
            continue
        codes.append(process.returncode)
        if process.returncode not in CODES:
            yield f"{which}: exit {process.returncode}: {said[-2000:]}"
    if given["overwrite"] and codes != [0, 0]:
        yield f"with --overwrite: exit codes {codes}"
    if 0 not in codes:
        yield f"neither run wrote its tables: exit codes {codes}"
    sources = LOGS[:1] if given["same"] else LOGS
    for path in sorted(place.out.iterdir()):
        if path.name not in NAMES:
            yield f"left {path.name}"
        elif path.read_bytes() not in [alone(which)[path.name] for which in sources]:
            yield f"{path.name} is of neither run"
    if 0 in codes:
        yield from (f"{name} is not there" for name in NAMES if not (place.out / name).exists())


def twice_targets() -> list[Target]:
    """Seldom, for it starts processes."""
    return [Target("twice", write, judge, weight=1, known=2)]
