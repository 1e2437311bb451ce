"""Measure how right maps are and write docs/maps.md (`make maps`)."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from benchmarks.maps.costs import measure_costs
from benchmarks.maps.figures import Figures, as_json
from benchmarks.maps.measuring import measure_rolling, measure_way
from benchmarks.maps.page import page, summary
from benchmarks.maps.plots import plot
from benchmarks.maps.program import make_map
from benchmarks.maps.prose import REPORTING, TUNING
from benchmarks.maps.real import draw_recordings, measure_recordings
from benchmarks.maps.scenes import KINDS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "maps.md"
COMMAND = "make maps"
SEEDS, MOST_SEEDS = 2, 100
REAL_LOGS = "LIDARCLI_REAL_LOGS"


def measure(first: int, seeds: int, command: str, recordings: Path | None, images: Path | None) -> Figures:
    """Everything, one after the other: times are measured, too. Without `images` only the simulated drives."""
    figures = Figures(command, first, [], [], [], [])
    speed, recorded = None, []
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
    if recordings is not None and images is not None:
        print("recordings ...", file=sys.stderr)
        recorded = measure_recordings(recordings)
        draw_recordings(recordings, images)
    return Figures(
        command, first, figures.ways, figures.made, figures.matched, figures.rolled, speed, recorded
    )


def main() -> None:
    """Parse the arguments, measure, write."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.maps", description=__doc__)
    parser.add_argument(
        "--tune", action="store_true", help="drives that constants may be looked at on; no page"
    )
    parser.add_argument("--quick", action="store_true", help="one drive of each kind, no times; no page")
    parser.add_argument("--seeds", type=int, metavar="N", help=f"drives of each kind ({SEEDS}; --quick: 1)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON")
    parser.add_argument(
        "--page", type=Path, default=PAGE, metavar="FILE", help="page to write (docs/maps.md)"
    )
    arguments = parser.parse_args()
    seeds = (1 if arguments.quick else SEEDS) if arguments.seeds is None else arguments.seeds
    if not 1 <= seeds <= MOST_SEEDS:
        parser.error(f"--seeds is 1 to {MOST_SEEDS}")
    written = not (arguments.tune or arguments.quick)
    target: Path = arguments.page
    folder = os.environ.get(REAL_LOGS)
    figures = measure(
        TUNING if arguments.tune else REPORTING,
        seeds,
        COMMAND if seeds == SEEDS else f'{COMMAND} MAPS="--seeds {seeds}"',
        Path(folder) if folder else None,
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
