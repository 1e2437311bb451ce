"""What users wait for: time and memory of commands, each beside another one.

Each run is a process of its own, from the start of Python to the last byte on disk. The cases take turns, so that a busy
machine hits all of them alike. The table is Markdown: `x` is the time for a sweep as a multiple of that of the case
beside, the median of the rounds. After `≤` stands what is wanted; what does not hold is bold. A second table counts
instructions, which are the same on a busy machine, if valgrind is there.

This process imports nothing heavy: on Linux the peak memory of a child counts from that of its parent.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median

HERE = Path(__file__).parent
LIDARCLI = str(Path(sys.executable).with_name("lidarcli"))
REAL_LOGS = "LIDARCLI_REAL_LOGS"
"""Environment variable that names the folder of the public recordings."""
COMPILED_EACH_TIME = "PYTHONDONTWRITEBYTECODE"
"""Where this is set every start compiles all modules, which is not how Python is used."""
RSS_UNIT = 1 if sys.platform == "darwin" else 1024
"""Bytes in a unit of `ru_maxrss`."""
MANY = 400
"""Logs that one process goes through."""

FINDS = ("detect", "track")
COMMANDS = {
    **{name: f"{{python}} {{references}} {name} {{log}}" for name in ("iterate", "small", "segment")},
    **{name: f"{{python}} {{references}} {name} {{objects}}" for name in ("norfair", "hungarian")},
    "floor": "{floor} {log}",
    "figure": "{python} {references} figure",
    **{name: f"{{lidarcli}} -q {name} {{log}} -o {{out}} --overwrite" for name in FINDS},
    "many": "{lidarcli} -q detect {many} --jobs 1 -o {out} --overwrite",
    "info": "{lidarcli} -q info {log}",
    "plot": "{lidarcli} -q plot {log} -o {out}.png --overwrite",
    "gif": "{lidarcli} -q plot {log} --animate --sweeps 0:40 -o {out}.gif --overwrite",
    "report": "{lidarcli} -q report {objects} --log {log} -o {out}.html --overwrite",
    "clean": "{lidarcli} -q clean {log} -o {out}.mcap --overwrite",
    "overlay": "{lidarcli} -q overlay {log} -o {out}.mcap --overwrite",
    "page": "{lidarcli} -q report {objects} -o {out}.html --overwrite",
    "map": "{lidarcli} -q map {log} --min-move 0 --poses {path} --pose-delay 0 -o {out}.yaml --overwrite",
    "background": "{lidarcli} -q background build {log} -o {out}.parquet --overwrite",
    "zones": "{lidarcli} -q zones {log} --zones {zones} -o {out} --no-objects --overwrite",
    "lidarcli": "{lidarcli}",
    "libraries": "{python} -c __import__('numpy');__import__('pyarrow.parquet')",
}
"""First word of the command of a case → what is run; its other words follow."""
NEEDED = {"small": "small_mcap", "segment": "small_mcap", "norfair": "norfair", "hungarian": "filterpy"}
"""First word of a command → the package that it is there to measure, or to measure with."""
STANDS = "1000000000 0 0 0 0 0 0 1\n2000000000 0 0 0 0 0 0 1\n"
"""Path of the sensor for `map`: in the simulated logs it stands."""
WATCHED = "".join(
    f'[[zone]]\nname = "{name}"\nhold = 0\ncircle = {{ x = {x}, y = 0, radius = {radius} }}\n'
    for name, x, radius in (("about", 0, 1.5), ("ahead", 2, 1.0), ("behind", -2, 2.0))
)
"""Zones for `zones`."""


@dataclass(frozen=True)
class Log:
    """A log that is made for the run, or no log, without a name."""

    name: str = ""
    share: float = 1.0
    """Length, as a share of that of the run."""
    source: str = "scene.toml"
    """Scene of this folder, or recording below that of `REAL_LOGS`."""
    made: tuple[str, ...] = ()
    """Options of `make_log.py`."""
    suffix: str = ".mcap"
    sweeps: int = 0
    """Length, whatever that of the run; 0: the share of it."""

    @property
    def recorded(self) -> bool:
        """True if its sweeps are those of a recording."""
        return not self.source.endswith(".toml")


NO_LOG = Log()
ROOM = Log("room")
WIDE = Log("1081 beams", 0.5, made=("--beams", "1081"))
PEOPLE = Log("people", 0.36, "leg_tracker/demo_stationary_simple_environment.bag")
DRIVE = Log("drive", 0.1, "comprobo24/test-bag")
MOVING = Log("moving", source="scene_moving.toml")
FEW = Log("short", source="scene_moving.toml", sweeps=100)
TEN = Log("ten", source="scene_moving.toml", sweeps=10)
OFFICE = Log("office", source="../samples/office.toml", sweeps=480)
FLICKER, HALF = (Log(name, share, made=("--beams", "45", "--blank")) for name, share in (("flicker", 0.64), ("half", 0.32)))
PLAIN = Log("plain", 0.02, "scene_moving.toml")
BEAMS = Log("720 beams", 0.5, made=("--beams", "720"))
LONG = Log("long", 10, "scene_moving.toml")

PINNED, NOT_COMPILED, COUNTED = "on one processor", "not compiled", "instructions"
LENGTHS = (1000, 3000)
"""Sweeps of two logs: what a sweep takes is their difference, without the start."""
Figures = dict[str, float]
"""Figure → its value; `COLUMNS` names them."""
Most = dict[str, float | tuple[float, str]]
"""Figure → the most that is wanted: a value, or a multiple of the same figure of another case."""


@dataclass(frozen=True)
class Case:
    """One command on one log."""

    log: Log
    command: str
    beside: str = ""
    """Name of the case that is its reference."""
    most: Most = field(default_factory=dict)
    how: str = ""
    """`PINNED`, `NOT_COMPILED`, `COUNTED` or nothing."""
    after: str = ""
    """Name of the case whose tables it reads."""

    @property
    def name(self) -> str:
        """Log, command, and how it is run."""
        return ", ".join(filter(None, (self.log.name, self.command, self.how)))

    @property
    def needs(self) -> list[str]:
        """Names of the cases that have to run before it."""
        others = [most[1] for most in self.most.values() if isinstance(most, tuple)]
        return [name for name in (self.beside, self.after, *others) if name]


def counted(log: Log, command: str, most: float | tuple[float, str] = math.inf, beside: str = "iterate") -> Case:
    """A case of which instructions are counted, beside another command on the same log."""
    limit: Most = {} if most == math.inf else {"instructions_x": most}
    return Case(log, command, ", ".join((log.name, beside, COUNTED)) * (command != beside), limit, COUNTED)


CASES = (
    Case(ROOM, "iterate"),
    Case(ROOM, "detect", "room, iterate", {"x": 2.7, "cpu_x": 4.7, "bytes_per_object": 95}),
    Case(ROOM, "detect --jobs 1", "room, iterate"),
    Case(ROOM, "detect", "room, iterate", how=PINNED),
    Case(WIDE, "iterate"),
    Case(WIDE, "detect", "1081 beams, iterate", {"x": 2.8, "cpu_x": 4.7}),
    Case(PEOPLE, "iterate"),
    Case(PEOPLE, "detect", "people, iterate", dict.fromkeys(("x", "cpu_x"), (1.15, "room, detect"))),
    Case(PEOPLE, "track", "people, detect", {"cpu_us_more": 85}),
    Case(DRIVE, "detect"),
    Case(DRIVE, "track --pose none", "drive, detect"),
    Case(MOVING, "detect"),
    Case(MOVING, "track", "moving, detect", {"cpu_us_more": 45}),
    Case(MOVING, "clean", "moving, track", {"cpu_x": 1.5}),
    Case(MOVING, "overlay", "moving, track", {"cpu_x": 1.3}),
    Case(MOVING, "page", "moving, track", {"peak_mb": 200}, after="moving, track"),
    Case(MOVING, "track --pose none", "moving, detect", {"cpu_us_more": 45}),
    Case(MOVING, "track --pose match", "moving, track --pose none"),
    Case(OFFICE, "detect", most={"cpu_seconds": 0.8}),
    Case(OFFICE, "zones", most={"cpu_seconds": 1.6}),
    Case(OFFICE, "info --brief", most={"cpu_seconds": 0.3}),
    Case(HALF, "zones"),
    Case(FLICKER, "zones", "half, zones", {"cpu_x": 1.3}),
    Case(FEW, "many", most={"peak_mb": 110}),
    Case(FEW, "figure"),
    Case(FEW, "plot", "short, figure", {"cpu_x": 1.3}),
    Case(FEW, "gif", most={"seconds": 6}),
    Case(FEW, "detect", "short, figure"),
    Case(FEW, "track", "short, figure", {"cpu_x": 0.5}),
    Case(FEW, "report", "short, figure", {"cpu_x": 1.6}, after="short, track"),
    Case(FEW, "info", "short, figure"),
    Case(NO_LOG, "lidarcli --help", most={"seconds": 0.15}),
    Case(NO_LOG, "lidarcli detect --help"),
    counted(TEN, "libraries", beside="libraries"),
    counted(TEN, "detect", 1.35, "libraries"),
    *(counted(ROOM, command) for command in ("iterate", "small", "floor", "segment")),
    counted(ROOM, "detect", 4.3),
    counted(WIDE, "iterate"),
    counted(WIDE, "detect", 4.95),
    counted(PEOPLE, "iterate"),
    counted(PEOPLE, "detect", 6.75),
    counted(PEOPLE, "track", 21),
    *(counted(MOVING, command) for command in ("iterate", "detect")),
    counted(MOVING, "track", 12.2),
    counted(MOVING, "clean", (1.5, "moving, track, instructions")),
    counted(MOVING, "overlay", (1.3, "moving, track, instructions")),
)
"""`make bench`."""
MORE = (
    Case(ROOM, "small", "room, iterate"),
    Case(ROOM, "segment", "room, iterate"),
    Case(ROOM, "detect --profile paper", "room, iterate"),
    Case(ROOM, "map", "room, iterate"),
    Case(ROOM, "background", "room, iterate"),
    Case(ROOM, "zones", "room, background", {"cpu_x": 2}),
    Case(BEAMS, "iterate"),
    Case(BEAMS, "detect", "720 beams, iterate"),
    Case(WIDE, "detect --profile paper", "1081 beams, iterate"),
    Case(Log("358 to 364 beams", made=("--jitter", "3")), "detect", "room, detect", {"x": 2}),
    Case(Log("MCAP lz4", made=("--compression", "lz4")), "detect", "room, detect"),
    Case(Log("MCAP, 95 % images", 0.2, made=("--share", "0.05")), "detect", "room, detect"),
    Case(Log("ROS 1 bag", suffix=".bag"), "detect", "room, detect"),
    Case(Log("ROS 2 sqlite3", suffix=".db3"), "detect", "room, detect"),
    Case(Log("CSV", 0.2, suffix=".csv"), "detect", "room, detect"),
    *(Case(PEOPLE, command, "people, track", after="people, track") for command in ("norfair", "hungarian")),
    Case(LONG, "detect", "moving, detect", {"peak_mb": 250}),
    Case(LONG, "track", "long, detect", {"peak_mb": 260}),
    Case(PLAIN, "detect", how=NOT_COMPILED),
    Case(PLAIN, "track", "plain, detect, not compiled", {"x": 3}, NOT_COMPILED),
)
"""What `--all` adds."""

COLUMNS = {
    "seconds": ("s", ".2f"),
    "per_second": ("sweeps/s", ",.0f"),
    "cpu_seconds": ("processor s", ".2f"),
    "cpu_us": ("processor µs", ",.1f"),
    "peak_mb": ("peak MB", ".0f"),
    "x": ("x", ".2f"),
    "cpu_x": ("x processor", ".2f"),
    "cpu_us_more": ("processor µs more", ",.1f"),
    "instructions": ("k instructions", ",.1f"),
    "instructions_x": ("x instructions", ".2f"),
    "objects": ("objects", ".1f"),
    "bytes_per_object": ("bytes per object", ".0f"),
}
"""Figure → its column, and how it is written. Microseconds, objects and instructions are those of a sweep."""


@dataclass(frozen=True)
class Run:
    """One process: seconds from start to end and of its processors, and its peak memory [MB]."""

    seconds: float
    cpu_seconds: float
    peak_mb: float
    output: str
    sweeps: int = 0
    """Sweeps that it went through."""


def instructions_of(*command: str, **settings: str) -> int:
    """Return how many instructions a command takes once its bytecode is there, by valgrind, with these settings."""
    counting = ("valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null", *command)
    environment = {name: value for name, value in os.environ.items() if name != COMPILED_EACH_TIME}
    done = subprocess.run(
        counting, capture_output=True, text=True, check=True, env=environment | {"PYTHONHASHSEED": "0", **settings}
    )
    return int(re.findall(r"I +refs: +([\d,]+)", done.stderr)[0].replace(",", ""))


def run(*command: str, pinned: bool = False, compiled: bool = True) -> Run:
    """Run a command to its end, `pinned` on one core; a failure ends the benchmark with what it said."""
    environment = {name: value for name, value in os.environ.items() if name != COMPILED_EACH_TIME}
    if not compiled:
        environment["LIDARCLI_COMPILED"] = "no"
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        started = time.perf_counter()
        pin = _pin if pinned and hasattr(os, "sched_setaffinity") else None
        process = subprocess.Popen(command, stdout=out, stderr=err, env=environment, preexec_fn=pin)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        if process.returncode:
            err.seek(0)
            said = err.read().decode(errors="replace")
            sys.exit(f"{' '.join(command)}: exit code {process.returncode}\n{said}")
        cpu = usage.ru_utime + usage.ru_stime
        return Run(seconds, cpu, usage.ru_maxrss * RSS_UNIT / 1e6, out.read().decode())


def _pin() -> None:
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


def make_log(folder: Path, name: str, sweeps: int, *options: str, source: str | Path = "scene.toml") -> Path:
    """Make a log of a scene of this folder or of a recording; its name has the suffix of its container."""
    log = folder / name
    print(f"writing {name}: {sweeps:,} sweeps ...", file=sys.stderr)
    run(sys.executable, str(HERE / "make_log.py"), str(HERE / source), str(sweeps), str(log), *options)
    return log


def made(log: Log, folder: Path, sweeps: int, name: str) -> Path:
    """Make a log of a run."""
    source = Path(os.environ[REAL_LOGS], log.source).absolute() if log.recorded else log.source
    return make_log(folder, name + log.suffix, sweeps, *log.made, source=source)


def words_of(case: Case, log: Path, out: Path) -> list[str]:
    """Return the command of a case on a log, with its tables in `out`."""
    places = {
        "python": sys.executable,
        "lidarcli": LIDARCLI,
        "references": HERE / "references.py",
        "floor": log.parent / "floor",
        "path": log.parent / "path.tum",
        "zones": log.parent / "zones.toml",
        "many": log.parent / "many",
        "objects": out / f"{log.stem}.objects.parquet",
        "log": log,
        "out": out,
    }
    first, *options = case.command.split()
    return [word.format(**places) for word in COMMANDS[first].split()] + options


def once(case: Case, log: Path, sweeps: int) -> Run:
    """Run a case on a log of so many sweeps; a reference that tells its own figures is taken at its word."""
    words = words_of(case, log, log.parent / "out")
    done = run(*words, pinned=case.how == PINNED, compiled=case.how != NOT_COMPILED)
    if str(HERE / "references.py") in words and done.output:
        seconds, cpu, count = map(float, done.output.split())
        return replace(done, seconds=seconds, cpu_seconds=cpu, sweeps=int(count))
    return replace(done, sweeps=sweeps)


def count(cases: Sequence[Case], folder: Path) -> dict[str, Figures]:
    """Return the instructions of cases: those of a sweep, or of the process if the length of the log is given."""
    lengths = {case.log: (case.log.sweeps,) if case.log.sweeps else LENGTHS for case in cases}
    logs = {(log, n): made(log, folder, n, f"{log.name} {n}") for log, sizes in lengths.items() for n in sizes}

    def counts(case: Case) -> float:
        taken = []
        for sweeps in lengths[case.log]:
            words = words_of(case, logs[case.log, sweeps], folder / f"{case.name} {sweeps}")
            run(*words)  # what is not compiled yet becomes bytecode
            # A script has the interpreter in its first line.
            taken.append(instructions_of(*[sys.executable] * (words[0] == LIDARCLI), *words))
        return taken[0] if len(taken) == 1 else (taken[1] - taken[0]) / (LENGTHS[1] - LENGTHS[0])

    if cases:
        print(f"counting instructions of {len(cases)} cases ...", file=sys.stderr)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = {case.name: taken for case, taken in zip(cases, pool.map(counts, cases), strict=True)}
    beside = {case.name: {"instructions_x": found[case.name] / found[case.beside]} for case in cases if case.beside}
    return {name: {"instructions": taken / 1e3} | beside.get(name, {}) for name, taken in found.items()}


def figures_of(runs: Sequence[Run], others: Sequence[Run]) -> Figures:
    """Return the figures of a case, with its ratios to another: round by round, as the machine changes."""
    figures = {"seconds": median(one.seconds for one in runs), "peak_mb": max(one.peak_mb for one in runs)}
    if sweeps := runs[0].sweeps:
        figures["sweeps"] = sweeps
        figures["per_second"] = sweeps / figures["seconds"]
        figures["cpu_seconds"] = median(one.cpu_seconds for one in runs)
        figures["cpu_us"] = 1e6 * figures["cpu_seconds"] / sweeps
    if others:
        pairs = list(zip(runs, others, strict=True))
        share = sweeps / others[0].sweeps
        figures["x"] = median(one.seconds / other.seconds for one, other in pairs) / share
        figures["cpu_x"] = median(one.cpu_seconds / other.cpu_seconds for one, other in pairs) / share
        more = median(one.cpu_seconds - other.cpu_seconds * share for one, other in pairs)
        figures["cpu_us_more"] = 1e6 * more / sweeps
    return figures


def objects_in(table: Path, sweeps: int, recorded: bool) -> Figures:
    """Return the figures of an objects table; bytes of a recording that is repeated would tell of the repetition."""
    script = "import sys, pyarrow.parquet as pq; print(pq.ParquetFile(sys.argv[1]).metadata.num_rows)"
    rows = int(run(sys.executable, "-c", script, str(table)).output)
    return {"objects": rows / sweeps} | ({} if recorded else {"bytes_per_object": table.stat().st_size / rows})


def measure(cases: Sequence[Case], sweeps: int, repeats: int, folder: Path) -> dict[str, Figures]:
    """Make the logs, run all cases in turns, and return the figures of each by its name."""
    found = count([case for case in cases if case.how == COUNTED], folder)
    cases = [case for case in cases if case.how != COUNTED]
    lengths = {case.log: case.log.sweeps or round(case.log.share * sweeps) for case in cases} | {NO_LOG: 0}
    logs = {log: made(log, folder, n, log.name) if log != NO_LOG else folder for log, n in lengths.items()}
    (folder / "path.tum").write_text(STANDS, encoding="utf-8")
    (folder / "zones.toml").write_text(WATCHED, encoding="utf-8")
    if FEW in logs:
        (folder / "many").mkdir()
        for number in range(MANY):
            os.link(logs[FEW], folder / "many" / f"{number}.mcap")
    runs: dict[str, list[Run]] = {case.name: [] for case in cases}
    objects: dict[str, Figures] = {}
    for turn in range(repeats):
        print(f"round {turn + 1} of {repeats} ...", file=sys.stderr)
        for case in cases:
            length = lengths[case.log] * (MANY if case.command == "many" else 1)
            runs[case.name].append(once(case, logs[case.log], length))
            if turn == 0 and case.command.split()[0] in FINDS:
                table = folder / "out" / f"{case.log.name}.objects.parquet"
                objects[case.name] = objects_in(table, lengths[case.log], case.log.recorded)
    timed = {
        case.name: figures_of(runs[case.name], runs.get(case.beside, ())) | objects.get(case.name, {}) for case in cases
    }
    return timed | found


def possible(cases: Sequence[Case], folder: Path) -> list[Case]:
    """Leave out what cannot be measured here, with a word to stderr; build the program that some need."""
    lacks: dict[str, str] = {}
    for case in cases:
        needed = NEEDED.get(case.command)
        if case.log.recorded and not os.environ.get(REAL_LOGS):
            lacks[case.name] = f"{REAL_LOGS} names no folder of recordings"
        elif case.how == COUNTED and not shutil.which("valgrind"):
            lacks[case.name] = "there is no valgrind"
        elif needed and importlib.util.find_spec(needed) is None:
            lacks[case.name] = f"there is no package {needed}"
        elif case.command == "floor" and not built(folder / "floor"):
            lacks[case.name] = "there is no C compiler, or no libzstd.so.1"
    for why in sorted(set(lacks.values())):
        print(f"left out, as {why}: {'; '.join(name for name in lacks if lacks[name] == why)}", file=sys.stderr)
    return [case for case in cases if case.name not in lacks]


def built(program: Path) -> bool:
    """Compile the reference in C; return whether that went well."""
    build = ("cc", "-O2", "-o", str(program), str(HERE / "floor.c"), "-l:libzstd.so.1")
    return bool(shutil.which("cc")) and subprocess.run(build, capture_output=True, check=False).returncode == 0


def chosen(cases: Sequence[Case], words: str) -> list[Case]:
    """Return the cases whose names contain the words, and those that they need, in their order."""
    by_name = {case.name: case for case in cases}
    names = [name for name in by_name if words in name]
    for name in names:
        names += by_name[name].needs
    return [case for case in cases if case.name in names]


def wanted(case: Case, results: Mapping[str, Figures]) -> Figures:
    """Return the most that is wanted of the figures of a case."""
    return {
        figure: most[0] * results[most[1]][figure] if isinstance(most, tuple) else most
        for figure, most in case.most.items()
    }


def table(cases: Sequence[Case], results: Mapping[str, Figures]) -> Iterator[str]:
    """Yield the lines of the table of some cases, with the columns of which they have figures; all are counted, or none."""
    columns = [figure for figure in COLUMNS if any(figure in results[case.name] for case in cases)]
    timed = cases[0].how != COUNTED
    yield f"| case | {' | '.join(COLUMNS[figure][0] for figure in columns)} |{' beside |' * timed}"
    yield f"|---|{'---:|' * len(columns)}{'---|' * timed}"
    for case in cases:
        cells = [case.name.removesuffix(f", {COUNTED}")]
        for figure in columns:
            value, most = results[case.name].get(figure), wanted(case, results).get(figure)
            text = "" if value is None else format(value, COLUMNS[figure][1])
            if value is not None and most is not None:
                text = f"{text} ≤ {most:.3g}" if value <= most else f"**{text} > {most:.3g}**"
            cells.append(text)
        yield f"| {' | '.join(cells + [case.beside] * timed)} |"


def main() -> None:
    """Parse the arguments, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--sweeps", type=int, default=100_000, help="length of most logs (default: %(default)s)")
    add("--repeats", type=int, default=3, help="runs of each case (default: %(default)s)")
    add("--all", action="store_true", help="also more logs, one ten times as long, more references, and stages")
    add("--only", default="", metavar="WORDS", help="only the cases with these words in their names")
    add("--json", type=Path, metavar="FILE", help="also write the figures as JSON")
    add("--assert", dest="limits", action="store_true", help="exit code 1 unless all is as wanted")
    arguments = parser.parse_args()
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    commit = run("git", "-C", str(HERE), "describe", "--always", "--dirty").output.strip()
    folder = Path(tempfile.mkdtemp(prefix="lidarcli-bench-"))
    try:
        cases = possible(chosen(CASES + MORE if arguments.all else CASES, arguments.only), folder)
        if not cases:
            parser.error(f"no case that can be measured has '{arguments.only}' in its name")
        results = measure(cases, arguments.sweeps, arguments.repeats, folder)
        whole = [folder / (log.name + log.suffix) for log in (ROOM, WIDE) if arguments.all]
        stages = [
            f"\n```\n{log.stem}: {run(sys.executable, str(HERE / 'stages.py'), str(log)).output}```"
            for log in whole
            if log.exists()
        ]
    finally:
        shutil.rmtree(folder)
    print(f"{machine}, commit {commit}, {arguments.sweeps:,} sweeps, median of {arguments.repeats}.\n")
    for counting in (False, True):
        if some := [case for case in cases if (case.how == COUNTED) == counting]:
            print(*table(some, results), "", sep="\n")
    for each in stages:
        print(each)
    if arguments.json:
        told = {case.name: {**results[case.name], "beside": case.beside, "wanted": wanted(case, results)} for case in cases}
        text = {"machine": machine, "commit": commit, "sweeps": arguments.sweeps, "cases": told}
        arguments.json.write_text(json.dumps(text, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    broken = [
        f"{case.name}: {COLUMNS[figure][0]} {results[case.name][figure]:.3g} is above {most:.3g}"
        for case in cases
        for figure, most in wanted(case, results).items()
        if results[case.name].get(figure, 0) > most
    ]
    if arguments.limits and broken:
        sys.exit("\n".join(broken))


if __name__ == "__main__":
    main()
