"""Measure how well things are followed and write docs/tracking.md (`make tracking`)."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from benchmarks.tracking.cells import APART, QUICK, REPORTING, TUNING, Cell
from benchmarks.tracking.methods import AT_FIRST, METHODS, PARAMETERS
from benchmarks.tracking.recordings import detected, record_cell
from benchmarks.tracking.scoring import Score, score
from lidarcli.sweeps import Float64


@dataclass(frozen=True, slots=True)
class Part:
    """One log and what it is tried with."""

    cell: Cell
    seed: int
    methods: tuple[str, ...]


def measure(part: Part) -> dict[str, Score]:
    """All methods on one log."""
    recording = record_cell(part.cell, part.seed)
    found = detected(recording, PARAMETERS)
    return {name: score(recording, found, METHODS[name](recording, found)) for name in part.methods}


def measure_all(cells: Sequence[Cell], first: int, seeds: int, methods: Sequence[str], jobs: int) -> None:
    """Print a line for each log and method."""
    parts = [
        Part(cell, first + APART * number + seed, tuple(methods))
        for number, cell in enumerate(cells)
        for seed in range(seeds)
    ]
    print(HEAD)
    with ProcessPoolExecutor(jobs) as pool:
        for part, scores in zip(parts, pool.map(measure, parts), strict=True):
            for name, one in scores.items():
                print(line(f"{part.cell.label} #{part.seed}", name, one), flush=True)


HEAD = (
    f"{'log':48}{'method':26} HOTA  DetA  AssA  IDF1  MOTA  swi  ids/bodies  "
    "v RMSE  median  standing  movers in A  standing in A  us/sweep"
)


def line(log: str, method: str, one: Score) -> str:
    """The figures of one log for a terminal."""
    a = one.agreement
    return (
        f"{log:48}{method:26}{a.hota:5.3f} {a.detection:5.3f} {a.association:5.3f} {a.idf1:5.3f} {a.mota:5.3f} "
        f"{a.switches:4d} {a.tracks:6d}/{a.entities:<5d}"
        f"{rms(one.moving_errors):6.3f}  {median(one.moving_errors):6.3f}  {rms(one.standing_errors):8.3f}"
        f"  {one.movers_in_a.value:11.3f}  {one.standing_in_a.value:13.4f}"
        f"  {1e6 * one.seconds / one.sweeps:8.0f}"
    )


def rms(errors: Float64) -> float:
    """Root mean square, NaN of none."""
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")


def median(errors: Float64) -> float:
    """NaN of none."""
    return float(np.median(errors)) if len(errors) else float("nan")


def main() -> None:
    """Parse the arguments, measure, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tracking", description=__doc__)
    parser.add_argument("--tune", action="store_true", help="seeds that constants may be chosen on; no page")
    parser.add_argument("--quick", action="store_true", help="a handful of logs, a line each; no page")
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="logs of each cell (%(default)s)")
    parser.add_argument("--methods", nargs="+", default=list(AT_FIRST), choices=METHODS, metavar="METHOD")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    arguments = parser.parse_args()
    first = TUNING if arguments.tune else REPORTING
    measure_all(QUICK, first, arguments.seeds, arguments.methods, arguments.jobs)


if __name__ == "__main__":
    main()
