"""Draw the sweeps that are judged, or are to be, and add the answers to the table.

`python -m benchmarks.annotations draw FOLDER` writes `NAME/SWEEP.png` and its like, `add FOLDER` takes `NAME/SWEEP.txt`.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.annotations.choice import CHOSEN, Chosen
from benchmarks.annotations.draw import draw
from benchmarks.annotations.pieces import pieces
from benchmarks.annotations.sweeps import Row, rows_of
from benchmarks.annotations.table import Judged, answered, append, read

REAL_LOGS = "LIDARCLI_REAL_LOGS"


def judgements(folder: Path, chosen: Chosen, sweeps: Sequence[Row], judged: Collection[int]) -> Iterator[Judged]:
    """Yield what files of answers say of the sweeps of a topic that are not among those `judged`."""
    rows = {int(batch.sweep[row]): (batch, row) for batch, row in sweeps}
    for file in sorted((folder / chosen.name).glob("*.txt")):
        if (sweep := int(file.stem)) not in judged:
            batch, row = rows[sweep]
            told = answered(file.read_text(encoding="utf-8"), pieces(batch, row), np.isfinite(batch.ranges[row]))
            yield Judged(chosen.log, chosen.topic, sweep, *told)


def main() -> None:
    """Parse the arguments, and draw or add."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.annotations", description=__doc__)
    parser.add_argument("command", choices=["draw", "add"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", metavar="NAME", help="only what has this in its name")
    arguments = parser.parse_args()
    logs = Path(os.environ[REAL_LOGS])
    told: dict[tuple[str, str], set[int]] = {}
    for each in read():
        told.setdefault((each.log, each.topic), set()).add(each.sweep)
    for chosen in CHOSEN:
        if arguments.only not in chosen.name or not chosen.path(logs).exists():
            continue
        sweeps = rows_of(logs, chosen)
        judged = told.get((chosen.log, chosen.topic), set())
        if arguments.command == "add":
            append(judgements(arguments.folder, chosen, sweeps, judged))
            continue
        there = [at for at, (batch, row) in enumerate(sweeps) if int(batch.sweep[row]) in judged]
        for at in chosen.sweeps(len(sweeps), there):
            batch, row = sweeps[at]
            sweep = int(batch.sweep[row])
            draw(sweeps, at, f"{chosen.name}, sweep {sweep}", arguments.folder / chosen.name, f"{sweep:04d}")


if __name__ == "__main__":
    main()
