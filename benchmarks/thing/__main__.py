"""Grow the trees that tell things from building, and write them: `make trees`.

Drawn scenes of seeds that nothing is reported on, the labelled legs of two logs, and the sweeps judged by eye are the
examples. Without the recordings no trees are grown. What is reported on a log is that of trees that have seen none of its
recorder's (`left_out`).
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from benchmarks.accuracy.cells import Things
from benchmarks.annotations.sweeps import judged_sweeps
from benchmarks.annotations.table import BUILDING, THING
from benchmarks.scenes import building, random
from benchmarks.thing.examples import LEGS_BY, Examples, drawn, judged, legs, together
from benchmarks.thing.grow import Grown, grow, write

ROOT = Path(__file__).parents[2]
FOREST = ROOT / "lidarcli" / "formalism" / "forest.py"
REAL_LOGS = "LIDARCLI_REAL_LOGS"
SEEDS = 0
"""First seed; what is reported begins with 50,000."""
BUILDINGS, CLEAN = 120, 60
"""Scenes of each kind like real buildings, and of each kind with clean surfaces, both with and without legged things."""
REAL, LEGS = 1.5, 0.3
"""Weight of the sweeps judged by eye, and of the labelled legs, beside that of all drawn scenes."""
THINNED = 24
"""Of the drawn bodies every so many is enough for trees that are only reported on."""
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
    """Recorder → examples of the judged sweeps; a sweep weighs as the root of the number of its bodies."""
    found: dict[str, list[Examples]] = {}
    for chosen, sweep in judged_sweeps(recordings):
        one = judged(sweep.batch, sweep.row, sweep.verdict == THING, sweep.verdict == BUILDING)
        found.setdefault(chosen.recorder, []).append(one.scaled(float(np.sqrt(len(one.thing)))))
    return {recorder: together(parts) for recorder, parts in found.items()}


def weighed(drawn_ones: Sequence[Examples], by_eye: Sequence[Examples], on_legs: Sequence[Examples]) -> Examples:
    """All examples with their weights."""
    whole = sum(float(one.weight.sum()) for one in drawn_ones)
    return together([*drawn_ones, together([*by_eye]).scaled(REAL * whole), *(one.scaled(LEGS * whole) for one in on_legs)])


def left_out(recordings: Path, jobs: int) -> dict[str, Grown]:
    """Recorder → trees and prior that have seen none of its sweeps."""
    thinned = [one.thinned(THINNED) for one in scenes(jobs)]
    logs, on_legs = judged_logs(recordings), legs(recordings)
    others = {
        name: weighed(thinned, [told for log, told in logs.items() if log != name], [on_legs] if name != LEGS_BY else [])
        for name in logs
    }
    with ProcessPoolExecutor(jobs) as pool:
        return dict(zip(others, pool.map(grow, others.values()), strict=True))


def main() -> None:
    """Grow and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.thing", description=__doc__)
    parser.add_argument("--output", type=Path, default=FOREST, metavar="FILE", help="module to write")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    arguments = parser.parse_args()
    folder = os.environ.get(REAL_LOGS)
    if not folder:
        sys.exit(f"{REAL_LOGS} names no folder of recordings: nothing is grown without them")
    logs = judged_logs(Path(folder))
    write(arguments.output, *grow(weighed(scenes(arguments.jobs), [*logs.values()], [legs(Path(folder))])))
    print(
        f"wrote {arguments.output}: {sum(len(one.thing) for one in logs.values())} judged bodies of {len(logs)} recorders"
    )


if __name__ == "__main__":
    main()
