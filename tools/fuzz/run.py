"""Cases one after the other in child processes, which may die or hang: then the case that did it is known."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from queue import Empty, Queue
from threading import Lock, Thread

import numpy as np

from tools.fuzz.place import Place
from tools.fuzz.target import Random
from tools.fuzz.targets import TARGETS

ROOT = Path(__file__).parent.parent.parent
WALL = 20.0
"""A case that takes longer hangs [s]; the judge counts processor time and is stricter."""
SETUP = 120.0
"""Time for a child to start, and to make a case [s]."""
COUNTED = 5_000
"""Cases from one word of progress to the next."""
CASES_PER_CHILD = 2000
"""Then a fresh child goes on, so that one that grows is not taken for a hungry case."""
CHILD = ("-m", "tools.fuzz.run")
ADDRESS_SPACE = 4 << 30
"""A child that asks for more gets a MemoryError [bytes]."""
MEMORY = Path("/dev/shm")
"""A folder in memory, where the system has one: no case has to wait for a disk."""
ROOM = 1 << 30
"""Room that has to be free there [bytes]."""
FILE_SIZE = 256 << 20
"""A child that writes more into one file gets an OSError [bytes]."""


@dataclass(frozen=True, slots=True)
class Case:
    """One input: all of it follows from these."""

    target: str
    seed: int
    number: int

    def write(self, place: Place) -> None:
        """Make the input in an empty place."""
        place.prepare()
        TARGETS[self.target].write(place, self.number, self.random)

    @property
    def random(self) -> Random:
        """The generator of this case alone."""
        return np.random.default_rng([zlib.crc32(self.target.encode()), self.seed, self.number])

    def __str__(self) -> str:
        return f"{self.target} --seed {self.seed} --first {self.number} --cases 1"


@dataclass(frozen=True, slots=True)
class Failure:
    """A case that must not end as it did."""

    case: Case
    problem: str


@dataclass(frozen=True)
class Plan:
    """Which cases to run: targets take turns, each with the numbers from `first` on."""

    targets: tuple[str, ...]
    seed: int
    first: int = 0
    cases: int | None = None
    """Of each target, whatever its weight."""
    total: int | None = None
    """Of all targets together, by weight; where neither is given it goes on until the time is over."""
    seconds: float | None = None

    def case(self, index: int) -> Case:
        """The case at a place in the order of the run."""
        turn, place = divmod(index, len(self._round))
        target, number, many = self._round[place]
        return Case(target, self.seed, self.first + turn * many + number)

    @property
    def length(self) -> float:
        """How many cases there are at most."""
        if self.cases is not None:
            return self.cases * len(self.targets)
        return float("inf") if self.total is None else self.total

    @cached_property
    def _round(self) -> list[tuple[str, int, int]]:
        """One round: target, the how many-eth of its turns, and how many it has. Heavy ones are spread evenly."""
        weights = {name: 1 if self.cases is not None else TARGETS[name].weight for name in self.targets}
        turns = [((turn + 0.5) / many, name, turn, many) for name, many in weights.items() for turn in range(many)]
        return [(name, turn, many) for _, name, turn, many in sorted(turns, key=lambda it: it[0])]


def fuzz(
    plan: Plan,
    tell: Callable[[Failure], None] = lambda failure: None,
    jobs: int = 1,
    count: Callable[[int], None] = lambda done: None,
) -> tuple[int, list[Failure]]:
    """Run the plan, `jobs` children beside each other; how many cases ran, and what failed, which is also told at once.

    `count` is told of every `COUNTED` cases.
    """
    over = None if plan.seconds is None else time.monotonic() + plan.seconds
    failed: list[tuple[int, Failure]] = []
    done: list[int] = []
    lock = Lock()
    broken: list[BaseException] = []

    def guarded(index: int) -> None:
        try:
            lane(index)
        except BaseException as err:
            # A lane that ends early must not look like one that found nothing.
            broken.append(err)

    def lane(index: int) -> None:
        while index < plan.length and (over is None or time.monotonic() < over):
            for problems in islice(_child(plan, index, jobs, over), CASES_PER_CHILD):
                with lock:
                    done.append(index)
                    if len(done) % COUNTED == 0:
                        count(len(done))
                    for problem in problems:
                        failed.append((index, Failure(plan.case(index), problem)))
                        tell(failed[-1][1])
                index += jobs

    lanes = [Thread(target=guarded, args=(number,), daemon=True) for number in range(jobs)]
    for thread in lanes:
        thread.start()
    for thread in lanes:
        thread.join()
    if broken:
        raise broken[0]
    return len(done), [failure for _, failure in sorted(failed, key=lambda it: it[0])]


def _child(plan: Plan, index: int, stride: int, over: float | None) -> Iterator[list[str]]:
    """The problems of every `stride`-th case from `index` on; ends after a case that failed, whose peak of memory
    and open files must not be blamed on the next."""
    with tempfile.TemporaryDirectory(prefix="lidarcli-fuzz-", dir=_fast()) as folder, tempfile.TemporaryFile("w+") as err:
        task = json.dumps({"plan": asdict(plan), "index": index, "stride": stride, "folder": folder})
        command = [sys.executable, "-W", "error", *CHILD, task]
        child = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=err, text=True)
        said: Queue[str] = Queue()
        listener = Thread(target=_listen, args=(child, said), daemon=True)
        listener.start()

        def killed() -> str:
            err.seek(0)
            return f"killed the process, exit code {child.wait()}: {err.read()[-2000:]}"

        try:
            while index < plan.length and (over is None or time.monotonic() < over):
                index += stride
                # First that the case is written, then what its judge says.
                try:
                    line = said.get(timeout=SETUP) and said.get(timeout=WALL)
                except Empty:
                    yield [f"hangs: nothing for {WALL:g} s"]
                    return
                problems = json.loads(line) if line else [killed()]
                yield problems
                if problems:
                    return
        finally:
            child.kill()
            child.wait()
            listener.join()
            if child.stdout is not None:
                child.stdout.close()


def _fast() -> Path | None:
    """Where to put cases, None for the usual place: TMPDIR, where it is set, counts first."""
    if "TMPDIR" in os.environ or not os.access(MEMORY, os.W_OK) or shutil.disk_usage(MEMORY).free < ROOM:
        return None
    return MEMORY


def _listen(child: subprocess.Popen[str], said: Queue[str]) -> None:
    if child.stdout is None:
        raise RuntimeError("the child has no pipe")
    for line in child.stdout:
        said.put(line)
    said.put("")
    said.put("")


def run_cases(task: str) -> None:
    """What the child does: case after case, until it is killed."""
    from tools.fuzz.judge import judge

    given = json.loads(task)
    plan = Plan(**given["plan"])
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    resource.setrlimit(resource.RLIMIT_FSIZE, (FILE_SIZE, FILE_SIZE))
    place = Place(Path(given["folder"]) / "case")
    place.prepare()
    # Command lines name files from here on, and what is imported later is found all the same.
    sys.path.insert(0, str(ROOT))
    os.chdir(place.root)
    tempfile.tempdir = str(place.scratch)
    # A command may close or replace the streams of the process: the answers have one of their own.
    with os.fdopen(os.dup(1), "w") as answers:
        index = given["index"]
        while True:
            case = plan.case(index)
            case.write(place)
            print("written", file=answers, flush=True)
            print(json.dumps(judge(TARGETS[case.target], place)), file=answers, flush=True)
            index += given["stride"]


if __name__ == "__main__":
    run_cases(sys.argv[1])
