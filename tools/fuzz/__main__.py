"""`make fuzz`: mutate small logs of every container and read them, for as long as one likes.

A failure prints the command that repeats it and keeps the log that caused it.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from tools.fuzz.containers import CONTAINERS
from tools.fuzz.run import Failure, Plan, fuzz


def main() -> None:
    """Parse the arguments, run, count."""
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument("containers", nargs="*", metavar="CONTAINER", help=", ".join(CONTAINERS))
    parser.add_argument("--seconds", type=float, default=60.0, help="how long (default: %(default)s)")
    parser.add_argument("--cases", type=int, help="cases of each container, however long they take")
    parser.add_argument("--seed", type=int, help="default: the time, so that no two runs are alike")
    parser.add_argument(
        "--first", type=int, default=0, help="number of the first case (default: %(default)s)"
    )
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="default: %(default)s")
    arguments = parser.parse_args()
    if unknown := sorted(set(arguments.containers) - set(CONTAINERS)):
        parser.error(f"no such container: {', '.join(unknown)}; there are {', '.join(CONTAINERS)}")
    seed = int(time.time()) if arguments.seed is None else arguments.seed
    plan = Plan(
        tuple(arguments.containers) or CONTAINERS,
        seed,
        arguments.first,
        arguments.cases,
        None if arguments.cases else arguments.seconds,
    )
    print(f"seed {seed}, {len(plan.containers)} containers", flush=True)

    def tell(failure: Failure) -> None:
        folder = arguments.keep / f"{failure.case.container}-{seed}-{failure.case.number}"
        log = failure.case.write(folder)
        print(f"\n{log}: {failure.problem}\nagain: python -m tools.fuzz {failure.case}", flush=True)

    done, failures = fuzz(plan, tell)
    print(f"{done:,} cases, {len(failures)} failures")
    sys.exit(bool(failures))


if __name__ == "__main__":
    main()
