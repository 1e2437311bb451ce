"""`make bounds`: the core as plain Python with all indices checked, on random batches and logs, the samples and real logs.

Compiled, an index beyond its array reads or writes whatever is there. As plain Python the same lines raise an
`IndexError`; with `LIDARCLI_BOUNDS` they do for negative indices, too.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
REAL_LOGS = "LIDARCLI_REAL_LOGS"
ENVIRONMENT = {**os.environ, "LIDARCLI_COMPILED": "no", "LIDARCLI_BOUNDS": "1"}
WILD = """
from lidarcli.system import native
values = native.doubles([], 2)
for index in (-1, 2):
    try:
        values[index]
    except IndexError:
        print("noticed")
"""
READ = (0, 3, 4)
"""Exit codes of the commands for real logs: some are damaged, some have no LaserScan."""
SIGNS = ("IndexError", "Exception ignored")
"""What a wild index says where nobody raises it, too."""
RUNS = (
    ["detect", "--every", "20", "--walls", "--beams"],
    ["detect", "--every", "20", "--profile", "paper"],
    ["detect", "--every", "20", "--threshold", "0.2", "--group-gap", "0.3"],
    ["track", "--every", "5", "--group-gap", "0.3"],
)
"""Of logs one sweep in twenty, or in five to follow things: this takes a hundred times as long as compiled."""
HOSTILE = "1000"
"""Logs that no robot writes, which things are followed in."""


def main() -> None:
    """Make sure that bounds are checked, and run."""
    if python("-c", WILD).stdout.split() != ["noticed", "noticed"]:
        sys.exit("a wild index is not noticed")
    random = python("-m", "tests.formalism.digests")
    if random.returncode:
        sys.exit(f"random batches: {random.stderr}")
    print(f"{len(random.stdout.splitlines())} detections of random batches", flush=True)
    hostile = python("-m", "tests.formalism.tracking.digests", HOSTILE, "scenes")
    if hostile.returncode:
        sys.exit(f"hostile logs: {hostile.stderr}")
    print(f"{len(hostile.stdout.splitlines())} hostile and simulated logs with things to follow", flush=True)
    folders = [ROOT / "samples", *([Path(os.environ[REAL_LOGS])] if os.environ.get(REAL_LOGS) else [])]
    problems = [problem for folder in folders for options in RUNS for problem in detected(folder, options)]
    if problems:
        sys.exit("\n".join(problems))


def python(*arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python with all indices checked."""
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=ROOT, env=ENVIRONMENT, capture_output=True, text=True, check=False)


def detected(folder: Path, options: list[str]) -> list[str]:
    """What is wrong when all logs of a folder go through a command."""
    with tempfile.TemporaryDirectory() as out:
        ran = python("-m", "lidarcli", "-q", options[0], str(folder), "-o", out, *options[1:])
        tables = sum(1 for _ in Path(out).rglob("*.objects.parquet"))
    print(f"{' '.join(options)} {folder}: {tables} logs, exit {ran.returncode}", flush=True)
    wrong = ran.returncode not in READ or not tables or any(sign in ran.stderr for sign in SIGNS)
    return [f"{' '.join(options)} {folder}: exit {ran.returncode}\n{ran.stderr}"] if wrong else []


if __name__ == "__main__":
    main()
