"""Measure how right the detection is and write docs/accuracy.md (`make accuracy`)."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from benchmarks.accuracy import boxes, driven, real
from benchmarks.accuracy.cells import Things
from benchmarks.accuracy.figures import Figures, as_json
from benchmarks.accuracy.objects import Part, Tally, measure
from benchmarks.accuracy.page import page, summary
from benchmarks.accuracy.plots import plot_cells, plot_scenes
from benchmarks.annotations.measure import measure as measure_by_eye
from benchmarks.scenes import building
from benchmarks.scenes.random import KINDS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "accuracy.md"
COMMAND = "make accuracy"

SEED, SCENES, QUICK = 50_000, 200, 16
LEGGED_SHARE = 2
"""Of every so many scenes one has a counterpart with legged things."""
BOXES, BOX_SWEEPS, CYLINDER_SWEEPS = 200, 10, 200
CHUNK = 25
"""Scenes of a part of the work."""
REAL_LOGS = "LIDARCLI_REAL_LOGS"


def parts(first: int, scenes: int, baselines: bool) -> Iterator[Part]:
    """The work in pieces, the same whatever the number of processes."""
    counts: dict[Things, int] = {"plain": scenes, "legs": -(-scenes // LEGGED_SHARE), "whole": -(-scenes // LEGGED_SHARE)}
    for things, count in counts.items():
        for kind in (*KINDS, *building.KINDS) if things == "plain" else KINDS:
            for start in range(0, count, CHUNK):
                seeds = range(first + start, first + min(start + CHUNK, count))
                yield Part(things, kind, tuple(seeds), baselines)


def measure_all(first: int, scenes: int, command: str, jobs: int, baselines: bool) -> Figures:
    """Run everything."""
    tally = Tally()
    with ProcessPoolExecutor(jobs) as pool:
        for part in pool.map(measure, parts(first, scenes, baselines)):
            tally.add(part)
    count = min(BOXES, scenes)
    folder = os.environ.get(REAL_LOGS)
    return Figures(
        command=command,
        first_seed=first,
        scenes=scenes,
        legged_scenes=-(-scenes // LEGGED_SHARE),
        box_sweeps=BOX_SWEEPS,
        tally=tally,
        boxes=boxes.measure_boxes(count, BOX_SWEEPS, first),
        cylinder=boxes.measure_cylinder(CYLINDER_SWEEPS, first),
        legs=real.measure_legs(Path(folder)) if folder else [],
        cars=real.measure_car(Path(folder)) if folder else [],
        driven=driven.measure(first, min(driven.SCENES, scenes), jobs),
        by_eye=measure_by_eye(Path(folder), baselines=baselines, jobs=jobs) if folder else None,
    )


def write(figures: Figures, target: Path) -> None:
    """The page and its images."""
    images = target.parent / "images"
    plot_cells(figures.tally, images / "accuracy.png")
    plot_scenes(figures.first_seed, images / "accuracy-scenes.png")
    before = target.read_text(encoding="utf-8") if target.exists() else ""
    target.write_text(page(figures, before), encoding="utf-8")


def main() -> None:
    """Parse the arguments, measure, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accuracy", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEED, metavar="FIRST", help="first seed (%(default)s)")
    parser.add_argument("--scenes", type=int, default=SCENES, metavar="N", help="scenes of each kind (%(default)s)")
    parser.add_argument("--quick", action="store_true", help=f"only {QUICK} scenes of each kind; no page")
    parser.add_argument("--ours", action="store_true", help="leave the baselines out; no page")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON")
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE", help="page to write (docs/accuracy.md)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    arguments = parser.parse_args()
    if arguments.scenes < 1 or arguments.jobs < 1 or arguments.seeds < 0:
        parser.error("--scenes and --jobs are at least 1, --seeds at least 0")
    scenes = QUICK if arguments.quick else arguments.scenes
    command = COMMAND
    if (arguments.seeds, scenes) != (SEED, SCENES):
        command += f' ACCURACY="--seeds {arguments.seeds} --scenes {scenes}"'
    figures = measure_all(arguments.seeds, scenes, command, arguments.jobs, not arguments.ours)
    print(summary(figures))
    if arguments.json:
        arguments.json.write_text(as_json(figures), encoding="utf-8")
    if not (arguments.quick or arguments.ours):
        write(figures, arguments.page)
        print(f"wrote {arguments.page}", file=sys.stderr)


if __name__ == "__main__":
    main()
