"""What a longer log, more beams and more logs cost: tables of docs/performance.md.

A cell has processor seconds, the least of three runs (one of a million sweeps), and the peak memory of the largest process.
Beams are compared by instructions, which valgrind counts.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks.bench import FEW, MOVING, WATCHED, Case, Log, count, counted, made, possible, run, words_of

COLUMNS = {"sweeps": (10_000, 100_000, 1_000_000), "beams": (180, 361, 1081, 2160, 4320, 8640), "logs": (10, 100, 1000)}
ONCE = 1_000_000
"""Sweeps of a log that is gone through once."""


def cell(words: Sequence[str], rounds: int = 3) -> str:
    """Return what a command takes."""
    runs = [run(*words) for _ in range(rounds)]
    told = f"{min(one.cpu_seconds for one in runs):.2f} s, {max(one.peak_mb for one in runs):.0f} MB"
    print(f"{' '.join(words[1:5])}: {told}", file=sys.stderr)
    return told


def table(title: str, columns: Sequence[int], rows: dict[str, list[str]]) -> None:
    """Print one as Markdown."""
    print(f"\n| {title} | {' | '.join(f'{column:,}' for column in columns)} |\n|---|{'---:|' * len(columns)}")
    print(*(f"| {name} | {' | '.join(cells)} |" for name, cells in rows.items()), sep="\n", flush=True)


def over_sweeps(folder: Path, lengths: Sequence[int]) -> None:
    """Commands on logs of a room in which things move."""
    (folder / "zones.toml").write_text(WATCHED, encoding="utf-8")
    rows: dict[str, list[str]] = {"detect": [], "track": [], "zones": [], "page": []}
    for sweeps in lengths:
        log = made(MOVING, folder, sweeps, "log")
        for command, cells in rows.items():
            cells.append(cell(words_of(Case(MOVING, command), log, folder / "out"), 1 if sweeps >= ONCE else 3))
        log.unlink()
    rows["report"] = rows.pop("page")
    table("sweeps of *moving*", lengths, rows)


def over_beams(folder: Path, numbers: Sequence[int]) -> None:
    """Instructions of `detect` on the room, as sensors of more beams see it."""
    logs = [Log(f"room of {beams}", made=("--beams", str(beams))) for beams in numbers]
    cases = possible([counted(log, name) for log in logs for name in ("iterate", "detect")], folder)
    if found := count(cases, folder):
        of = [found[case.name] for case in cases[1::2]]
        rows = {"k instructions": [f"{each['instructions']:,.0f}" for each in of]}
        table("beams", numbers, rows | {"x `iterate`": [f"{each['instructions_x']:.1f}" for each in of]})


def over_logs(folder: Path, numbers: Sequence[int]) -> None:
    """`detect` on many short logs, in processes of its own and on a Dask cluster of this machine."""
    short = made(FEW, folder, FEW.sweeps, "short")
    hows = ("--jobs 2", "--cluster local:2")
    rows: dict[str, list[str]] = {f"detect {how}": [] for how in hows}
    for number in numbers:
        many = folder / "many"
        many.mkdir()
        for name in range(number):
            os.link(short, many / f"{name}.mcap")
        for how, cells in zip(hows, rows.values(), strict=True):
            cells.append(cell(words_of(Case(FEW, f"detect {how}"), many, folder / "out")))
        shutil.rmtree(many)
    table(f"logs of {FEW.sweeps} sweeps", numbers, rows)


PARTS = {"sweeps": over_sweeps, "beams": over_beams, "logs": over_logs}


def main() -> None:
    """Parse the arguments, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in PARTS:
        parser.add_argument(f"--{name}", type=int, nargs="*", default=COLUMNS[name], help="none: leave that table out")
    asked = vars(parser.parse_args())
    for name, part in PARTS.items():
        with tempfile.TemporaryDirectory(prefix="lidarcli-bench-") as folder:
            if asked[name]:
                part(Path(folder), asked[name])


if __name__ == "__main__":
    main()
