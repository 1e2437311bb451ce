"""Measure how right maps are and write docs/maps.md (`make maps`)."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from benchmarks.maps.costs import measure_costs
from benchmarks.maps.figures import Figures, as_json
from benchmarks.maps.measuring import measure_rolling, measure_way
from benchmarks.maps.page import page, summary
from benchmarks.maps.paths import measure_loop, measure_straight
from benchmarks.maps.plots import plot
from benchmarks.maps.program import make_map
from benchmarks.maps.prose import REPORTING, TUNING
from benchmarks.maps.real import draw_recordings, measure_recordings
from benchmarks.maps.real_paths import measure_real_paths
from benchmarks.maps.scenes import KINDS, Kind

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "maps.md"
COMMAND = "make maps"
SEEDS, MAX_SEEDS = 2, 100
LOOPS: dict[Kind, int] = {"corridors": 4, "rooms": 3}
"""Drives whose paths are measured."""
STRAIGHT = 4
"""Drives along straight corridors."""
REAL_LOGS = "LIDARCLI_REAL_LOGS"


def measure(first: int, seeds: int, command: str, recordings: Path | None, images: Path | None) -> Figures:
    """Everything, one after the other: times are measured, too. Without `images` only the simulated drives."""
    figures = Figures(command, first)
    speed = None
    with tempfile.TemporaryDirectory(prefix="lidarcli-maps-") as name:
        folder = Path(name)
        for kind in KINDS:
            for seed in range(first, first + seeds):
                print(f"{kind} {seed} ...", file=sys.stderr)
                way, made, matched, driven = measure_way(kind, seed, folder)
                figures.ways.append(way)
                figures.made.extend(made)
                figures.matched.append(matched)
                if images is not None and seed == first and kind == KINDS[-1]:
                    plot(driven, make_map(folder / f"{kind}-{seed}.mcap"), images / "simulated.png")
                if images is not None and seed == first and kind == KINDS[0]:
                    speed = measure_costs(driven, folder)
            print(f"{kind} {first}, fast ...", file=sys.stderr)
            figures.rolled.extend(measure_rolling(kind, first, folder))
    measure_paths(figures, recordings if images is not None else None, least=images is None)
    if recordings is not None and images is not None:
        print("recordings ...", file=sys.stderr)
        figures.recorded.extend(measure_recordings(recordings))
        draw_recordings(recordings, images)
    return replace(figures, speed=speed)


def measure_paths(figures: Figures, recordings: Path | None, *, least: bool = False) -> None:
    """The errors of matched paths; `least`: one drive of each kind."""
    with tempfile.TemporaryDirectory(prefix="lidarcli-maps-") as name:
        folder = Path(name)
        for kind in KINDS:
            for seed in range(figures.first_seed, figures.first_seed + (1 if least else LOOPS[kind])):
                print(f"path of {kind} {seed} ...", file=sys.stderr)
                figures.loops.extend(measure_loop(kind, seed, folder))
        for number in range(1 if least else STRAIGHT):
            print(f"path of straight corridor {figures.first_seed + number} ...", file=sys.stderr)
            figures.straight.extend(measure_straight(figures.first_seed + number, folder))
    if recordings is not None:
        figures.real_paths.extend(measure_real_paths(recordings))


def main() -> None:
    """Parse the arguments, measure, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.maps", description=__doc__)
    parser.add_argument("--tune", action="store_true", help="drives that constants may be looked at on; no page")
    parser.add_argument("--quick", action="store_true", help="one drive of each kind, no times; no page")
    parser.add_argument("--paths", action="store_true", help="the errors of matched paths alone; no page")
    parser.add_argument("--seeds", type=int, metavar="N", help=f"drives of each kind ({SEEDS}; --quick: 1)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON")
    parser.add_argument("--page", type=Path, default=PAGE, metavar="FILE", help="page to write (docs/maps.md)")
    arguments = parser.parse_args()
    seeds = (1 if arguments.quick else SEEDS) if arguments.seeds is None else arguments.seeds
    if not 1 <= seeds <= MAX_SEEDS:
        parser.error(f"--seeds is 1 to {MAX_SEEDS}")
    first = TUNING if arguments.tune else REPORTING
    written = not (arguments.tune or arguments.quick or arguments.paths)
    target: Path = arguments.page
    folder = os.environ.get(REAL_LOGS)
    recordings = Path(folder) if folder else None
    if arguments.paths:
        figures = Figures(COMMAND, first)
        measure_paths(figures, recordings, least=arguments.quick)
    else:
        figures = measure(
            first,
            seeds,
            COMMAND if seeds == SEEDS else f'{COMMAND} MAPS="--seeds {seeds}"',
            recordings,
            target.parent / "images" / "maps" if written else None,
        )
    print(summary(figures))
    if arguments.json:
        arguments.json.write_text(as_json(figures), encoding="utf-8")
    if written:
        before = target.read_text(encoding="utf-8") if target.exists() else ""
        target.write_text(page(figures, before), encoding="utf-8")
        print(f"wrote {target}", file=sys.stderr)


if __name__ == "__main__":
    main()
