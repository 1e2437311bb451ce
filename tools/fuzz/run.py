"""Cases one after the other in a child process, which may die or hang: then the case that did it is known."""

from __future__ import annotations

import json
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from queue import Empty, Queue
from threading import Thread

import numpy as np

from tools.fuzz.containers import CONTAINERS, sample_of

ROOT = Path(__file__).parent.parent.parent
SILENCE = 60.0
"""A child that says nothing for so long hangs [s]; the judge counts processor time and is stricter."""
CHILD = ("-m", "tools.fuzz.run")
ADDRESS_SPACE = 6 << 30
"""A child that asks for more gets a MemoryError."""


@dataclass(frozen=True, slots=True)
class Case:
    """One mutated log: all of it follows from these."""

    container: str
    seed: int
    number: int

    def write(self, folder: Path) -> Path:
        """Make the log in a folder; the path to open."""
        sample = sample_of(self.container)
        random = np.random.default_rng([CONTAINERS.index(self.container), self.seed, self.number])
        for name, data in sample.mutated(random).items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return folder / sample.log

    def __str__(self) -> str:
        return f"{self.container} --seed {self.seed} --first {self.number} --cases 1"


@dataclass(frozen=True, slots=True)
class Failure:
    """A case that must not end as it did."""

    case: Case
    problem: str


@dataclass(frozen=True, slots=True)
class Plan:
    """Which cases to run: containers take turns, each with the numbers from `first` on."""

    containers: tuple[str, ...]
    seed: int
    first: int = 0
    cases: int | None = None
    """Of each container; None: until the time is over."""
    seconds: float | None = None

    def case(self, index: int) -> Case:
        """The case at a place in the order of the run."""
        turn, which = divmod(index, len(self.containers))
        return Case(self.containers[which], self.seed, self.first + turn)

    @property
    def length(self) -> float:
        """How many cases there are at most."""
        return float("inf") if self.cases is None else self.cases * len(self.containers)


def fuzz(plan: Plan, tell: Callable[[Failure], None] = lambda failure: None) -> tuple[int, list[Failure]]:
    """Run the plan; how many cases ran, and what failed, which is also told at once."""
    over = None if plan.seconds is None else time.monotonic() + plan.seconds
    failures: list[Failure] = []
    index = 0
    while index < plan.length and (over is None or time.monotonic() < over):
        for problems in _child(plan, index, over):
            for problem in problems:
                failures.append(Failure(plan.case(index), problem))
                tell(failures[-1])
            index += 1
    return index, failures


def _child(plan: Plan, index: int, over: float | None) -> Iterator[list[str]]:
    """The problems of each case from `index` on; ends after a case that killed the child."""
    with tempfile.TemporaryDirectory(prefix="lidarcli-fuzz-") as folder, tempfile.TemporaryFile("w+") as err:
        task = json.dumps([plan.containers, plan.seed, plan.first, index, folder])
        command = [sys.executable, "-W", "error", *CHILD, task]
        child = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=err, text=True)
        said: Queue[str] = Queue()
        listener = Thread(target=_listen, args=(child, said), daemon=True)
        listener.start()
        try:
            while index < plan.length and (over is None or time.monotonic() < over):
                index += 1
                try:
                    line = said.get(timeout=SILENCE)
                except Empty:
                    yield [f"hangs: nothing for {SILENCE:g} s"]
                    return
                if not line:
                    err.seek(0)
                    yield [f"killed the process, exit code {child.wait()}: {err.read()[-2000:]}"]
                    return
                yield json.loads(line)
        finally:
            child.kill()
            child.wait()
            listener.join()
            if child.stdout is not None:
                child.stdout.close()


def _listen(child: subprocess.Popen[str], said: Queue[str]) -> None:
    if child.stdout is None:
        raise RuntimeError("the child has no pipe")
    for line in child.stdout:
        said.put(line)
    said.put("")


def run_cases(containers: Sequence[str], seed: int, first: int, index: int, folder: str) -> None:
    """What the child does: case after case, until it is killed."""
    from tools.fuzz.judge import judge

    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    plan = Plan(tuple(containers), seed, first)
    here, scratch = Path(folder) / "log", Path(folder) / "scratch"
    tempfile.tempdir = str(scratch)
    for place in count(index):
        for path in (here, scratch):
            shutil.rmtree(path, ignore_errors=True)
            path.mkdir()
        print(json.dumps(judge(plan.case(place).write(here), scratch)), flush=True)


if __name__ == "__main__":
    run_cases(*json.loads(sys.argv[1]))
