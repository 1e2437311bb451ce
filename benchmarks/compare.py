"""Two commits side by side: `lidarcli detect` of the work tree against that of another commit, on the same logs.

The other commit is checked out into a temporary folder, its core is built there, and the two take turns. Where valgrind is,
instructions are counted besides: of a sweep, as the difference of two lengths of a log; of the shortest, the whole process.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median

from benchmarks.bench import HERE, LENGTHS, instructions_of, make_log, run

LOGS = {
    "361 beams": ("361.mcap", 1.0, ()),
    "1081 beams": ("1081.mcap", 0.5, ("--beams", "1081")),
    "ROS 1 bag": ("ros1.bag", 1.0, ()),
    "300 sweeps": ("short.mcap", 0.0, ()),
}
SHORT = 300
"""Sweeps of the shortest log: the start counts more than they do."""


def command(log: Path, out: Path) -> tuple[str, ...]:
    """Words of `detect`; the folder that this runs in must not come before the tree that `PYTHONPATH` names: -P."""
    return (sys.executable, "-P", "-m", "lidarcli", "-q", "detect", str(log), "--overwrite", "-o", str(out))


def detect(tree: Path, log: Path, folder: Path) -> tuple[float, float]:
    """Wall and processor time of a run with the code of a tree [s]."""
    os.environ["PYTHONPATH"] = str(tree)
    done = run(*command(log, folder / "tables"))
    return done.seconds, done.cpu_seconds


def instructions(trees: Sequence[Path], logs: Sequence[Path], sweeps: Sequence[int]) -> list[float]:
    """Thousands of instructions with the code of each tree: of a sweep, given logs of two lengths, or of the process."""

    def counts(tree: Path) -> float:
        taken = [instructions_of(*command(log, log.parent / f"of-{tree.name}"), PYTHONPATH=str(tree)) for log in logs]
        return taken[0] / 1e3 if len(taken) == 1 else (taken[1] - taken[0]) / (sweeps[1] - sweeps[0]) / 1e3

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return list(pool.map(counts, trees))


def check_out(base: str, tree: Path) -> None:
    """Put a commit into a folder and build what it has to build."""
    command = ["git", "-C", str(HERE.parent), "archive", base]
    archive = subprocess.run(command, capture_output=True, check=False)
    if archive.returncode:
        sys.exit(archive.stderr.decode().strip())
    tree.mkdir()
    subprocess.run(["tar", "-x", "-C", str(tree)], input=archive.stdout, check=True)
    if (tree / "setup.py").exists():
        target = tree / "built"
        build = [sys.executable, "-m", "pip", "-q", "install", "--no-deps", "--target", str(target), str(tree)]
        subprocess.run(build, check=True)
        for built in target.rglob("*.so"):
            built.replace(tree / built.relative_to(target))


def main() -> None:
    """Parse the arguments, measure, print a table of ratios."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", help="commit to compare with")
    parser.add_argument("--sweeps", type=int, default=30_000, help="of a log (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=5, help="runs of each (default: %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON")
    arguments = parser.parse_args()
    figures = {}
    with tempfile.TemporaryDirectory(prefix="lidarcli-bench-") as name:
        folder = Path(name)
        base, new = folder / "base", HERE.parent
        check_out(arguments.base, base)
        counting = bool(shutil.which("valgrind"))
        head = f"{'':14}{arguments.base[:12] + ' us':>16}{'here us':>10}{'here / base':>13}{'cpu':>7}"
        print(head + f"{'base k instr.':>16}{'here':>10}{'here / base':>13}" * counting)
        for title, (file, share, made) in LOGS.items():
            sweeps = round(arguments.sweeps * share) or SHORT
            log = make_log(folder, file, sweeps, *made)
            pairs = [(detect(base, log, folder), detect(new, log, folder)) for _ in range(arguments.repeats)]
            log.unlink()
            before, after = (1e6 * median(pair[k][0] for pair in pairs) / sweeps for k in (0, 1))
            ratio = median(one[0] / other[0] for other, one in pairs)
            cpu = median(one[1] / other[1] for other, one in pairs)
            figures[title] = {"base_us": before, "here_us": after, "ratio": ratio, "cpu_ratio": cpu}
            line = f"{title:14}{before:>16.1f}{after:>10.1f}{ratio:>13.2f}{cpu:>7.2f}"
            if counting:
                lengths = LENGTHS if share else (SHORT,)
                logs = [make_log(folder, f"{length}-{file}", length, *made) for length in lengths]
                was, now = instructions((base, new), logs, lengths)
                figures[title] |= {"base_instructions": was, "here_instructions": now, "instructions_ratio": now / was}
                line += f"{was:>16,.1f}{now:>10,.1f}{now / was:>13.3f}"
            print(line, flush=True)
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
