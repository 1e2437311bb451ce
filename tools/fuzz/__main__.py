"""`make fuzz`: inputs of every kind that are mutated or made to harm, read for as long as one likes.

A failure prints the command that repeats it and keeps the input that caused it.
"""

from __future__ import annotations

import argparse
import fnmatch
import os
import sys
import time
from pathlib import Path

from tools.fuzz.place import Place
from tools.fuzz.run import Failure, Plan, fuzz
from tools.fuzz.targets import TARGETS


def main() -> None:
    """Parse the arguments, run, count."""
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"names or patterns of: {', '.join(TARGETS)}")
    parser.add_argument("--seconds", type=float, default=60.0, help="how long (default: %(default)s)")
    parser.add_argument("--cases", type=int, help="cases of each target, however long they take")
    parser.add_argument("--total", type=int, help="cases of all targets together, more of those that are cheap")
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="processes beside each other (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, help="default: the time, so that no two runs are alike")
    parser.add_argument("--first", type=int, default=0, help="number of the first case (default: %(default)s)")
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="default: %(default)s")
    arguments = parser.parse_args()
    if arguments.cases is not None and arguments.total is not None:
        parser.error("--cases and --total exclude each other")
    if unknown := [name for name in arguments.targets if not fnmatch.filter(TARGETS, name)]:
        parser.error(f"no such target: {', '.join(unknown)}; there are {', '.join(TARGETS)}")
    chosen = tuple(name for name in TARGETS if any(fnmatch.fnmatch(name, it) for it in arguments.targets or ["*"]))
    seed = int(time.time()) if arguments.seed is None else arguments.seed
    endless = arguments.cases is None and arguments.total is None
    plan = Plan(chosen, seed, arguments.first, arguments.cases, arguments.total, arguments.seconds if endless else None)
    print(f"seed {seed}, {len(chosen)} targets", flush=True)

    def tell(failure: Failure) -> None:
        place = Place(arguments.keep / f"{failure.case.target}-{seed}-{failure.case.number}")
        print(f"\n{place.input}: {failure.problem}\nagain: python -m tools.fuzz {failure.case}", flush=True)
        failure.case.write(Place(place.root.absolute()))

    def count(done: int) -> None:
        print(f"{done:,} cases in {time.monotonic() - started:,.0f} s", flush=True)

    started = time.monotonic()
    done, failures = fuzz(plan, tell, arguments.jobs, count)
    print(f"{done:,} cases, {len(failures)} failures")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
