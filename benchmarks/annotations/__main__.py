"""Draw the sweeps that are judged, or are to be: `python -m benchmarks.annotations draw FOLDER`."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from benchmarks.annotations.choice import CHOSEN
from benchmarks.annotations.draw import draw
from benchmarks.annotations.sweeps import rows_of
from benchmarks.annotations.table import read

REAL_LOGS = "LIDARCLI_REAL_LOGS"


def main() -> None:
    """Parse the arguments and draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.annotations", description=__doc__)
    parser.add_argument("command", choices=["draw"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", metavar="NAME", help="only what has this in its name")
    arguments = parser.parse_args()
    logs = Path(os.environ[REAL_LOGS])
    told: dict[tuple[str, str], set[int]] = {}
    for each in read():
        told.setdefault((each.log, each.topic), set()).add(each.sweep)
    for chosen in CHOSEN:
        if arguments.only not in chosen.name:
            continue
        sweeps = rows_of(logs, chosen)
        judged = told.get((chosen.log, chosen.topic), set())
        there = [at for at, (batch, row) in enumerate(sweeps) if int(batch.sweep[row]) in judged]
        for at in chosen.sweeps(len(sweeps), there):
            batch, row = sweeps[at]
            sweep = int(batch.sweep[row])
            draw(sweeps, at, f"{chosen.name}, sweep {sweep}", arguments.folder / chosen.name, f"{sweep:04d}")


if __name__ == "__main__":
    main()
