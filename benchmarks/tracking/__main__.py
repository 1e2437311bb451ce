"""Measure how well things are followed and write docs/tracking.md (`make tracking`)."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from benchmarks.tracking.by_eye import LOGS, measure_by_eye
from benchmarks.tracking.cells import APART, CELLS, QUICK, REPORTING, TUNING, Cell
from benchmarks.tracking.figures import Figures, Log, as_json, median, rms
from benchmarks.tracking.methods import NAMES, ORACLE, OURS, PARAMETERS, follow
from benchmarks.tracking.page import page, summary
from benchmarks.tracking.plots import plot
from benchmarks.tracking.real import measure_cars, measure_legs
from benchmarks.tracking.recordings import detected, in_batches, record_cell
from benchmarks.tracking.scoring import Score, score

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "tracking.md"
COMMAND = "make tracking"
SEEDS = 4
REAL_LOGS = "LIDARCLI_REAL_LOGS"


@dataclass(frozen=True, slots=True)
class Part:
    """One log and what it is tried with."""

    cell: Cell
    seed: int
    methods: tuple[str, ...]


def parts(cells: Sequence[Cell], first: int, seeds: int, methods: Sequence[str]) -> Iterator[Part]:
    """The work in pieces: each cell has seeds of its own."""
    for number, cell in enumerate(cells):
        for seed in range(seeds):
            yield Part(cell, first + APART * number + seed, tuple(methods))


def measure(part: Part) -> Log:
    """All methods on one log."""
    recording = record_cell(part.cell, part.seed)
    found = detected(in_batches(recording.batch), PARAMETERS, recording.entity)
    scores = {name: score(recording, found, follow(name, recording, found)) for name in part.methods}
    return Log(part.cell, part.seed, scores, found.seconds / len(recording.batch))


HEAD = (
    f"{'log':47}{'method':26} HOTA  DetA  AssA  IDF1  MOTA  swi  ids/bodies  "
    "v RMSE  median  standing  movers in A  standing in A  us/sweep"
)


def line(log: str, method: str, one: Score) -> str:
    """The figures of one log for a terminal."""
    a = one.agreement
    return (
        f"{log:47}{method:26}{a.hota:5.3f} {a.detection:5.3f} {a.association:5.3f} {a.idf1:5.3f} {a.mota:5.3f} "
        f"{a.switches:4d} {a.tracks:6d}/{a.entities:<5d}"
        f"{rms(one.moving_errors):6.3f}  {median(one.moving_errors):6.3f}  {rms(one.standing_errors):8.3f}"
        f"  {one.movers_in_a.value:11.3f}  {one.standing_in_a.value:13.4f}"
        f"  {1e6 * one.seconds / one.sweeps:8.0f}"
    )


def measure_all(work: Sequence[Part], jobs: int, lines: bool) -> list[Log]:
    """Run everything, with a line for each log and method where that is asked for."""
    logs = []
    if lines:
        print(HEAD)
    with ProcessPoolExecutor(jobs) as pool:
        for log in pool.map(measure, work):
            logs.append(log)
            if lines:
                for name, one in log.scores.items():
                    print(line(f"{log.cell.label} #{log.seed}", name, one), flush=True)
    return logs


def write(figures: Figures, target: Path) -> None:
    """The page and its image."""
    plot(figures, target.parent / "images" / "tracking.png")
    before = target.read_text(encoding="utf-8") if target.exists() else ""
    target.write_text(page(figures, before), encoding="utf-8")


def main() -> None:
    """Parse the arguments, measure, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.tracking", description=__doc__)
    parser.add_argument(
        "--tune", action="store_true", help="logs that constants may be chosen on; a line for each, no page"
    )
    parser.add_argument("--quick", action="store_true", help="a handful of logs; a line for each, no page")
    parser.add_argument("--seeds", type=int, metavar="N", help=f"logs of each cell ({SEEDS}; --quick: 1)")
    parser.add_argument("--methods", nargs="+", choices=NAMES, metavar="METHOD", help=f"of {', '.join(NAMES)}; no page")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON")
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE", help="page to write (docs/tracking.md)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    arguments = parser.parse_args()
    seeds = (1 if arguments.quick else SEEDS) if arguments.seeds is None else arguments.seeds
    if not 1 <= seeds <= APART or arguments.jobs < 1:
        parser.error(f"--seeds is 1 to {APART}, --jobs at least 1")
    first = TUNING if arguments.tune else REPORTING
    lines = arguments.tune or arguments.quick
    methods = arguments.methods or ([OURS, ORACLE] if lines else NAMES)
    work = list(parts(QUICK if arguments.quick else CELLS, first, seeds, methods))
    logs = measure_all(work, arguments.jobs, lines)
    folder = os.environ.get(REAL_LOGS)
    figures = Figures(
        command=COMMAND if seeds == SEEDS else f'{COMMAND} TRACKING="--seeds {seeds}"',
        first_seed=first,
        seeds=seeds,
        logs=logs,
        cars=measure_cars(Path(folder)) if folder else [],
        legs=measure_legs(Path(folder)) if folder else [],
        by_eye=measure_by_eye(Path(folder), ["chosen"] if arguments.tune else list(LOGS), arguments.jobs) if folder else [],
    )
    print(summary(figures))
    if arguments.json:
        arguments.json.write_text(as_json(figures), encoding="utf-8")
    if not (lines or arguments.methods):
        write(figures, arguments.page)
        print(f"wrote {arguments.page}", file=sys.stderr)


if __name__ == "__main__":
    main()
