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
from benchmarks.thing.grow import SECOND_PASS, Trees, grow, odds, write
from lidarcli.formalism import forest

ROOT = Path(__file__).parents[2]
FOREST = ROOT / "lidarcli" / "formalism" / "forest.py"
REAL_LOGS = "LIDARCLI_REAL_LOGS"
SEEDS = 0
"""First seed; what is reported begins with 50,000."""
BUILDINGS, CLEAN = 120, 60
"""Scenes of each kind like real buildings, and of each kind with clean surfaces, both with and without legged things."""
TREES, LEAVES = 80, 8
"""Of each pass."""
REAL, LEGS = 0.3, 0.1
"""Weight of the sweeps judged by eye, and of the labelled legs, beside that of four kinds of drawn scenes."""
CHUNK = 10

Grown = tuple[Trees, float]
NOTHING: Grown = ((), 0.0)


def parts() -> Iterator[tuple[str, list[int], Things]]:
    """The drawn scenes in pieces, the same whatever the number of processes."""
    kinds: list[tuple[str, int]] = [(kind, BUILDINGS) for kind in building.KINDS]
    kinds += [(kind, CLEAN) for kind in random.KINDS]
    both: tuple[Things, Things] = ("plain", "legs")
    for kind, count in kinds:
        for things in both:
            for first in range(SEEDS, SEEDS + count, CHUNK):
                yield kind, list(range(first, first + CHUNK)), things


def _measure(work: tuple[str, list[int], Things, Grown]) -> tuple[str, list[Examples]]:
    kind, seeds, things, first = work
    _use(first)
    return kind, list(drawn(kind, seeds, things))


def _use(first: Grown) -> None:
    """Let the core decide by these trees in its first pass."""
    forest.FIRST, forest.SECOND, forest.PRIOR = first[0], (), (first[1], 0.0)


def examples(first: Grown, recordings: Path, jobs: int) -> Examples:
    """All examples, with the features that the core measures after this first pass; each kind of scene counts alike."""
    kinds: dict[str, list[Examples]] = {}
    with ProcessPoolExecutor(jobs) as pool:
        for kind, found in pool.map(_measure, ((*part, first) for part in parts())):
            kinds.setdefault(kind, []).extend(found)
    _use(first)
    scenes = [together(found) for found in kinds.values()]
    each = sum(len(scene.thing) for scene in scenes) / len(scenes)
    by_eye = [
        judged(sweep.batch, sweep.row, sweep.verdict == THING, sweep.verdict == BUILDING)
        for sweep in judged_sweeps(recordings, "tuning")
    ]
    return together(
        [
            *(scene.scaled(each) for scene in scenes),
            together(by_eye).scaled(REAL * 4 * each),
            legs(recordings).scaled(LEGS * 4 * each),
        ]
    )


def _say(name: str, grown: Grown, told: Examples) -> None:
    """How far the trees tell apart what they were grown on."""
    found = odds(*grown, told.features)
    for least in (0.1, 0.3, 0.5):
        kept = found >= np.log(least / (1.0 - least))
        weight = told.weight
        right = weight[kept & told.thing].sum()
        print(
            f"{name}, thing >= {least}: precision {right / weight[kept].sum():.3f}, "
            f"recall {right / weight[told.thing].sum():.3f}"
        )


def main() -> None:
    """Grow and write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.thing", description=__doc__)
    parser.add_argument("--output", type=Path, default=FOREST, metavar="FILE", help="module to write")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    arguments = parser.parse_args()
    folder = os.environ.get(REAL_LOGS)
    if not folder:
        sys.exit(f"{REAL_LOGS} names no folder of recordings: nothing is grown without them")
    known = examples(NOTHING, Path(folder), arguments.jobs)
    first = grow(known, trees=TREES, leaves=LEAVES, without=SECOND_PASS)
    _say("first pass", first, known)
    known = examples(first, Path(folder), arguments.jobs)
    second = grow(known, trees=TREES, leaves=LEAVES)
    _say("second pass", second, known)
    write(arguments.output, first[0], second[0], (first[1], second[1]))
    print(f"wrote {arguments.output}")


if __name__ == "__main__":
    main()
