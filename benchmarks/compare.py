"""Two commits side by side: `lidarcli detect` of the work tree against that of another commit, on the same logs.

The other commit is checked out into a temporary folder, its core is built there, and the two take turns.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

from benchmarks.bench import HERE, make_log, run

LOGS = {
    "361 beams": ("361.mcap", 1.0, ()),
    "1081 beams": ("1081.mcap", 0.5, ("--beams", "1081")),
    "ROS 1 bag": ("ros1.bag", 1.0, ()),
    "300 sweeps": ("short.mcap", 0.0, ()),
}
SHORT = 300
"""Sweeps of the shortest log: the start counts more than they do."""


def detect(tree: Path, log: Path, folder: Path) -> tuple[float, float]:
    """Wall and processor time of a run with the code of a tree [s]."""
    # The folder that this runs in must not come before the tree: -P.
    command = (sys.executable, "-P", "-m", "lidarcli", "-q", "detect", str(log), "--overwrite")
    os.environ["PYTHONPATH"] = str(tree)
    done = run(*command, "-o", str(folder / "tables"))
    return done.seconds, done.cpu_seconds


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
        print(f"{'':14}{arguments.base[:12] + ' us':>16}{'here us':>10}{'here / base':>13}{'cpu':>7}")
        for title, (file, share, made) in LOGS.items():
            sweeps = round(arguments.sweeps * share) or SHORT
            log = make_log(folder, file, sweeps, *made)
            pairs = [(detect(base, log, folder), detect(new, log, folder)) for _ in range(arguments.repeats)]
            before, after = (1e6 * median(pair[k][0] for pair in pairs) / sweeps for k in (0, 1))
            ratio = median(one[0] / other[0] for other, one in pairs)
            cpu = median(one[1] / other[1] for other, one in pairs)
            figures[title] = {"base_us": before, "here_us": after, "ratio": ratio, "cpu_ratio": cpu}
            print(f"{title:14}{before:>16.1f}{after:>10.1f}{ratio:>13.2f}{cpu:>7.2f}")
            log.unlink()
    if arguments.json:
        arguments.json.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
