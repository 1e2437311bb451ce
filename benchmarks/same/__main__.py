"""Compare what another commit and the work tree write: `detect`, `track`, `map` and backgrounds, file by file.

Both run on the same logs: the samples, random scenes, sweeps that no sensor gives, and the logs that are named. Files
with the same bytes are the same. In other tables what is counted or named has to be equal, numbers within 1e-9, those of
single precision within a millionth of their size, directions of lines within half a turn; with --exact the bytes have to
be equal. The logs and the results of the other commit are kept, so that the next comparison with it runs the work tree
alone.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from shutil import rmtree

from benchmarks.bench import HERE
from benchmarks.same.cases import Case, cases_of, outputs_in
from benchmarks.same.differences import Difference, compare_files
from benchmarks.same.logs import given_logs, odd_sweep_logs, sample_logs, scene_logs
from benchmarks.same.sides import Answer, Side, checkout

CACHE = HERE.parent / "build" / "same"


@dataclass
class Compared:
    """A case on both sides."""

    case: Case
    tables: int = 0
    same: int = 0
    differences: dict[str, list[Difference]] = field(default_factory=dict)
    """By kind of table."""

    @property
    def differs(self) -> bool:
        """Whether there is more between them than rounding."""
        return any(each.matters for found in self.differences.values() for each in found)


def compare(case: Case, one: Answer, other: Answer) -> Compared:
    """What two sides made of a case."""
    compared = Compared(case)
    if (one.codes, one.said) != (other.codes, other.said):
        told = f"{one.in_short} -> {other.in_short}"
        compared.differences["run"] = [Difference("exit code, words", 1, 0, 0.0, told)]
    tables = [outputs_in(answer.folder) for answer in (one, other)]
    for kind in sorted(tables[0].keys() | tables[1].keys()):
        compared.tables += 1
        paths = [table.get(kind) for table in tables]
        if paths[0] is None or paths[1] is None:
            there = " -> ".join("none" if path is None else "there" for path in paths)
            compared.differences[kind] = [Difference("(table)", 1, 0, 0.0, there)]
        elif found := list(compare_files(kind, paths[0], paths[1])):
            compared.differences[kind] = found
        else:
            compared.same += 1
    return compared


def summary(done: Iterable[Compared]) -> list[str]:
    """A line for each group of logs."""
    groups: dict[str, list[Compared]] = defaultdict(list)
    for compared in done:
        groups[compared.case.log.group].append(compared)
    lines = [f"{'':10}{'logs':>6}{'runs':>7}{'tables':>8}{'the same':>10}{'rounding':>10}{'differ':>8}"]
    for group, members in groups.items():
        logs = len({compared.case.log.path for compared in members})
        tables, same = (sum(getattr(each, name) for each in members) for name in ("tables", "same"))
        differ = sum(
            any(one.matters for one in found)
            for each in members
            for kind, found in each.differences.items()
            if kind != "run"
        )
        rounding = tables - same - differ
        lines.append(f"{group:10}{logs:>6}{len(members):>7}{tables:>8}{same:>10}{rounding:>10}{differ:>8}")
    return lines


def columns(done: Iterable[Compared]) -> list[str]:
    """Lines for each column that differs anywhere, and where it does so most."""
    by_column: dict[str, list[tuple[Difference, Case]]] = defaultdict(list)
    for compared in done:
        for kind, found in compared.differences.items():
            for each in found:
                by_column[f"{kind}: {each.column}"].append((each, compared.case))
    if not by_column:
        return []
    lines = ["", f"{'':30}{'runs':>6}{'other value':>13}{'beyond':>9}{'greatest':>11}"]
    for name, cases in by_column.items():
        other, beyond = (sum(getattr(each, part) for each, _ in cases) for part in ("other", "beyond"))
        greatest = max(each.greatest for each, _ in cases)
        lines.append(f"{name:30}{len(cases):>6}{other:>13}{beyond:>9}{greatest:>11.2g}")
        worst, case = max(cases, key=lambda pair: (pair[0].other > 0, pair[0].greatest))
        if worst.matters:
            lines.append(f"    {case.log.group}/{case.log.name} {case.label}: {worst.example}")
    return lines


def parsed() -> argparse.Namespace:
    """The arguments."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.same", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("base", help="commit to compare with, or the folder of a checkout that is built")
    parser.add_argument("logs", nargs="*", help="more logs, or folders to search")
    parser.add_argument("--scenes", type=int, default=1000, help="random scenes (default: %(default)s)")
    parser.add_argument("--odd", type=int, default=2000, help="odd sweeps of a log (default: %(default)s)")
    parser.add_argument("--thorough", action="store_true", help="all options on the logs that are named, too")
    parser.add_argument("--exact", action="store_true", help="rounding, too, is a difference")
    parser.add_argument("--only", metavar="TEXT", help="runs whose options contain this")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="(default: %(default)s)")
    parser.add_argument("--cache", type=Path, default=CACHE, help="folder of what is kept (default: %(default)s)")
    return parser.parse_args()


def main() -> None:
    """Run both sides and print what differs; exit code 1 where anything does."""
    arguments = parsed()
    cache: Path = arguments.cache.resolve()
    tree = checkout(arguments.base, cache / "trees")
    started = time.perf_counter()
    logs = [
        *sample_logs(),
        *scene_logs(cache / "logs", arguments.scenes),
        *odd_sweep_logs(cache / "logs", arguments.odd),
        *given_logs(arguments.logs),
    ]
    wanted = (case for case in cases_of(logs, arguments.thorough) if (arguments.only or "") in case.label)
    cases = list({case.digest: case for case in wanted}.values())
    print(f"{len(logs)} logs, {len(cases)} runs; logs made and read in {time.perf_counter() - started:.0f} s", flush=True)
    with tempfile.TemporaryDirectory(prefix="lidarcli-same-") as name:
        base, here = Side(tree, cache / "results"), Side(HERE.parent, Path(name))
        for side in (base, here):
            if old := side.older_than_their_sources():
                print(f"note: in {side.tree} older than their sources: {', '.join(old)}", file=sys.stderr)
        if base.digest == here.digest:
            print("note: both sides are the same code", file=sys.stderr)
        known = sum(base.knows(case) for case in cases)

        def both(case: Case) -> Compared:
            answers = base.answer(case), here.answer(case)
            compared = compare(case, *answers)
            rmtree(answers[1].folder)
            return compared

        started = time.perf_counter()
        with ThreadPoolExecutor(arguments.jobs) as pool:
            done = list(pool.map(both, cases))
        base.close()
        here.close()
    print(f"{time.perf_counter() - started:.0f} s; {known} of {len(cases)} runs of the base were known")
    print("\n".join([*summary(done), *columns(done)]))
    different = sum(compared.differs or (arguments.exact and bool(compared.differences)) for compared in done)
    print(f"\n{different} of {len(done)} runs differ" if different else "\nno run differs")
    sys.exit(bool(different))


if __name__ == "__main__":
    main()
