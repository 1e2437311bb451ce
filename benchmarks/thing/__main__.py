"""Grow the trees that tell things from building, and write them: `make trees`.

Drawn scenes of seeds that nothing is reported on, the labelled legs of two logs and the tuning half of the sweeps judged
by eye are the examples. Without the recordings no trees are grown.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks.accuracy.cells import Things
from benchmarks.annotations.sweeps import judged_sweeps
from benchmarks.annotations.table import BUILDING, THING
from benchmarks.scenes import building, random
from benchmarks.thing.examples import Examples, drawn, judged, legs, together
from benchmarks.thing.grow import grow, odds, write

ROOT = Path(__file__).parents[2]
FOREST = ROOT / "lidarcli" / "formalism" / "forest.py"
REAL_LOGS = "LIDARCLI_REAL_LOGS"
SEEDS = 0
"""First seed; what is reported begins with 50,000."""
BUILDINGS, CLEAN = 120, 60
"""Scenes of each kind like real buildings, and of each kind with clean surfaces, both with and without legged things."""
REAL, LEGS = 0.6, 0.1
"""Weight of the sweeps judged by eye, and of the labelled legs, beside that of all drawn scenes."""
CHUNK = 10


def parts() -> Iterator[tuple[str, list[int], Things]]:
    """The drawn scenes in pieces, the same whatever the number of processes."""
    kinds: list[tuple[str, int]] = [(kind, BUILDINGS) for kind in building.KINDS]
    kinds += [(kind, CLEAN) for kind in random.KINDS]
    both: tuple[Things, Things] = ("plain", "legs")
    for kind, count in kinds:
        for things in both:
            for first in range(SEEDS, SEEDS + count, CHUNK):
                yield kind, list(range(first, first + CHUNK)), things


def _measure(work: tuple[str, list[int], Things]) -> tuple[str, list[Examples]]:
    kind, seeds, things = work
    return kind, list(drawn(kind, seeds, things))


def scenes(jobs: int) -> list[Examples]:
    """The examples of each kind of drawn scene, which all count alike."""
    kinds: dict[str, list[Examples]] = {}
    with ProcessPoolExecutor(jobs) as pool:
        for kind, found in pool.map(_measure, parts()):
            kinds.setdefault(kind, []).extend(found)
    found_of = [together(found) for found in kinds.values()]
    each = sum(len(one.thing) for one in found_of) / len(found_of)
    return [one.scaled(each) for one in found_of]


def judged_logs(recordings: Path) -> dict[str, Examples]:
    """Log of the tuning half → examples of its judged sweeps."""
    logs: dict[str, list[Examples]] = {}
    for sweep in judged_sweeps(recordings, "tuning"):
        found = judged(sweep.batch, sweep.row, sweep.verdict == THING, sweep.verdict == BUILDING)
        logs.setdefault(sweep.told.log, []).append(found)
    return {log: together(found) for log, found in logs.items()}


def weighed(drawn_ones: list[Examples], by_eye: list[Examples], on_legs: Examples) -> Examples:
    """All examples with their weights."""
    whole = sum(float(one.weight.sum()) for one in drawn_ones)
    return together([*drawn_ones, together(by_eye).scaled(REAL * whole), on_legs.scaled(LEGS * whole)])


def _say(drawn_ones: list[Examples], logs: dict[str, Examples], on_legs: Examples) -> None:
    """How far trees tell apart the bodies of each judged log that were grown without it."""
    found = []
    for left_out in logs:
        others = [told for log, told in logs.items() if log != left_out]
        found.append(odds(*grow(weighed(drawn_ones, others, on_legs)), logs[left_out].features))
    told, thing = np.concatenate(found), together(list(logs.values())).thing
    for least in (0.1, 0.3, 0.5):
        kept = told >= np.log(least / (1.0 - least))
        right = thing[kept].mean(), kept[thing].mean()
        print(f"logs left out, thing >= {least}: precision {right[0]:.3f}, recall {right[1]:.3f}")


def main() -> None:
    """Grow and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.thing", description=__doc__)
    parser.add_argument("--output", type=Path, default=FOREST, metavar="FILE", help="module to write")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    parser.add_argument("--left-out", action="store_true", help="tell, too, how right trees are that never saw a log")
    arguments = parser.parse_args()
    folder = os.environ.get(REAL_LOGS)
    if not folder:
        sys.exit(f"{REAL_LOGS} names no folder of recordings: nothing is grown without them")
    drawn_ones, logs, on_legs = scenes(arguments.jobs), judged_logs(Path(folder)), legs(Path(folder))
    write(arguments.output, *grow(weighed(drawn_ones, list(logs.values()), on_legs)))
    print(f"wrote {arguments.output}")
    if arguments.left_out:
        _say(drawn_ones, logs, on_legs)


if __name__ == "__main__":
    main()
