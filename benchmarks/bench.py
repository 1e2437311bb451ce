"""Throughput and memory of `lidarcli detect`, beside merely iterating the same log's messages, and of `track` beside it.

One process, whose threads use all cores unless said otherwise.

Every measurement is a process of its own; the contestants take turns, so that a busy machine hits all of them alike.
This process imports nothing heavy: on Linux the peak memory of a child counts from that of its parent.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from statistics import median

HERE = Path(__file__).parent
LIDARCLI = str(Path(sys.executable).with_name("lidarcli"))
MOVING = "scene_moving.toml"
"""The scene for `track`: things move in it."""
COMPILED_EACH_TIME = "PYTHONDONTWRITEBYTECODE"
"""Where this is set every start compiles all modules, which is not how Python is used."""
RSS_UNIT = 1 if sys.platform == "darwin" else 1024
"""Bytes in a unit of `ru_maxrss`."""


@dataclass(frozen=True)
class Run:
    """One process: seconds from start to end and of its processors, and its peak memory [MB]."""

    seconds: float
    cpu_seconds: float
    peak_mb: float
    output: str


@dataclass
class Result:
    """Repeated runs of one contestant over `sweeps` sweeps."""

    name: str
    sweeps: int
    seconds: list[float] = field(default_factory=list)
    cpu_seconds: list[float] = field(default_factory=list)
    peak_mb: float = 0.0

    @property
    def per_second(self) -> float:
        """Sweeps per second of the median run."""
        return self.sweeps / median(self.seconds)

    @property
    def best_per_second(self) -> float:
        """Sweeps per second of the fastest run."""
        return self.sweeps / min(self.seconds)

    @property
    def cpu_us(self) -> float:
        """Processor time per sweep of the median run [µs]: what a busy machine changes least."""
        return 1e6 * median(self.cpu_seconds) / self.sweeps

    def add(self, run: Run) -> None:
        """Count a run."""
        self.seconds.append(run.seconds)
        self.cpu_seconds.append(run.cpu_seconds)
        self.peak_mb = max(self.peak_mb, run.peak_mb)


@dataclass
class Figures:
    """Everything that was measured."""

    machine: str
    log_mb: float
    iterate: Result
    robust: Result
    paper: Result
    changing: Result
    short: Result
    long: Result
    pinned: Result
    alone: Result
    moving: Result
    track: Result
    matched: Result
    unposed: Result
    plain: Result
    plain_track: Result
    objects_per_sweep: float = 0.0
    moving_per_sweep: float = 0.0
    help_ms: dict[str, float] = field(default_factory=dict)

    def results(self) -> tuple[Result, ...]:
        """All contestants, the yardstick first."""
        logs = self.robust, self.paper, self.changing, self.short, self.long
        both = self.moving, self.track, self.matched, self.unposed, self.plain, self.plain_track
        return self.iterate, *logs, self.pinned, self.alone, *both

    def ratio(self, result: Result) -> float:
        """Time per sweep, as a multiple of the time that iterating takes."""
        return self.iterate.per_second / result.per_second

    @property
    def growth(self) -> float:
        """Peak memory of a log, as a multiple of that of a log a tenth as long."""
        return self.long.peak_mb / self.short.peak_mb

    @property
    def changing_geometry(self) -> float:
        """Throughput where the beam count changes from sweep to sweep, as a share of that where it does not."""
        return self.changing.per_second / self.robust.per_second

    @property
    def on_cores(self) -> float:
        """Throughput on all cores, as a multiple of that on one."""
        return gain(self.pinned, self.robust)

    @property
    def of_threads(self) -> float:
        """Throughput with threads that share the detection, as a multiple of that of one alone."""
        return gain(self.alone, self.robust)

    @property
    def tracking(self) -> float:
        """Time of `track`, as a multiple of that of `detect` on the same log."""
        return gain(self.track, self.moving)

    @property
    def plain_tracking(self) -> float:
        """The same where nothing is compiled."""
        return gain(self.plain_track, self.plain)

    @property
    def matching_us(self) -> float:
        """Processor time of matching a sweep, and of the second pass over the log: what `track` takes more with it [µs]."""
        pairs = zip(self.matched.cpu_seconds, self.unposed.cpu_seconds, strict=True)
        return 1e6 * median(one - two for one, two in pairs) / self.matched.sweeps


def gain(slow: Result, fast: Result) -> float:
    """Throughput of the one as a multiple of the other's: round by round, as the machine changes."""
    return median(one / two for one, two in zip(slow.seconds, fast.seconds, strict=True))


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


def make_log(folder: Path, name: str, sweeps: int, *options: str, scene: str = "scene.toml") -> Path:
    """Simulate a log of one of the benchmark's scenes; its name has the suffix of its container."""
    log = folder / name
    print(f"writing {name}: {sweeps:,} sweeps ...", file=sys.stderr)
    run(sys.executable, str(HERE / "make_log.py"), str(HERE / scene), str(sweeps), str(log), *options)
    return log


def iterate(log: Path, result: Result) -> None:
    """Time the loop over the raw messages alone, without the start of Python."""
    done = run(sys.executable, str(HERE / "iterate.py"), str(log))
    seconds, cpu, count = map(float, done.output.split())
    if count != result.sweeps:
        sys.exit(f"{log} holds {count:.0f} messages, not {result.sweeps}")
    result.add(replace(done, seconds=seconds, cpu_seconds=cpu))


def detect(
    log: Path,
    folder: Path,
    result: Result,
    *options: str,
    command: str = "detect",
    pinned: bool = False,
    compiled: bool = True,
) -> None:
    """Time `lidarcli detect`, or `track`, from the start of Python to its end."""
    out = folder / "tables"
    whole = LIDARCLI, "-q", command, str(log), *options, "-o", str(out), "--overwrite"
    result.add(run(*whole, pinned=pinned, compiled=compiled))


def count_objects(folder: Path, log: Path) -> int:
    """Objects in the table that `detect` wrote last."""
    script = "import sys, pyarrow.parquet as pq; print(pq.ParquetFile(sys.argv[1]).metadata.num_rows)"
    table = folder / "tables" / f"{log.stem}.objects.parquet"
    return int(run(sys.executable, "-c", script, str(table)).output)


def measure(sweeps: int, repeats: int, folder: Path) -> Figures:
    """Run everything and gather the figures."""
    log = make_log(folder, "fixed.mcap", sweeps)
    changing = make_log(folder, "changing.mcap", sweeps, "--jitter", "3")
    moving = make_log(folder, "moving.mcap", sweeps, scene=MOVING)
    few = max(sweeps // 50, 1)
    plain = make_log(folder, "plain.mcap", few, scene=MOVING)
    figures = Figures(
        machine=f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        log_mb=log.stat().st_size / 1e6,
        iterate=Result("iterate messages (mcap)", sweeps),
        paper=Result("detect --profile paper", sweeps),
        changing=Result("detect, 358 to 364 beams", sweeps),
        short=Result(f"detect, {sweeps // 5:,} sweeps", sweeps // 5),
        long=Result(f"detect, {sweeps * 2:,} sweeps", sweeps * 2),
        robust=Result("detect", sweeps),
        pinned=Result("detect, on one core", sweeps),
        alone=Result("detect --jobs 1", sweeps),
        moving=Result("detect, things move", sweeps),
        track=Result("track, things move", sweeps),
        matched=Result("track --pose match", sweeps),
        unposed=Result("track --pose none", sweeps),
        plain=Result("detect, not compiled", few),
        plain_track=Result("track, not compiled", few),
    )
    for turn in range(repeats):
        print(f"round {turn + 1} of {repeats} ...", file=sys.stderr)
        iterate(log, figures.iterate)
        detect(changing, folder, figures.changing)
        detect(log, folder, figures.paper, "--profile", "paper")
        detect(log, folder, figures.alone, "--jobs", "1")
        detect(log, folder, figures.pinned, pinned=True)
        detect(log, folder, figures.robust)
        detect(moving, folder, figures.moving)
        detect(moving, folder, figures.track, command="track")
        detect(moving, folder, figures.matched, "--pose", "match", command="track")
        detect(moving, folder, figures.unposed, "--pose", "none", command="track")
        detect(plain, folder, figures.plain, compiled=False)
        detect(plain, folder, figures.plain_track, command="track", compiled=False)
    figures.objects_per_sweep = count_objects(folder, log) / sweeps
    figures.moving_per_sweep = count_objects(folder, moving) / sweeps
    for result in (figures.short, figures.long):
        # The logs differ by ten times; both fill every buffer on the way.
        detect(make_log(folder, "other.mcap", result.sweeps), folder, result)
        (folder / "other.mcap").unlink()
    for command in ((), ("detect",)):
        times = [run(LIDARCLI, *command, "--help").seconds for _ in range(10)]
        figures.help_ms[" ".join(("lidarcli", *command, "--help"))] = 1e3 * min(times)
    return figures


def show(figures: Figures) -> None:
    """Print the figures as a table."""
    print(
        f"{figures.machine}; MCAP zstd, {figures.log_mb:.0f} MB, {figures.robust.sweeps:,} sweeps,", end=" "
    )
    print(
        f"{figures.objects_per_sweep:.1f} objects per sweep, {figures.moving_per_sweep:.1f} where things move\n"
    )
    print(f"{'':28}{'sweeps/s':>10}{'best':>10}{'x iterate':>11}{'cpu us':>8}{'peak MB':>9}")
    for result in figures.results():
        print(
            f"{result.name:28}{result.per_second:>10,.0f}{result.best_per_second:>10,.0f}"
            f"{figures.ratio(result):>11.2f}{result.cpu_us:>8.1f}{result.peak_mb:>9.0f}"
        )
    print(f"\npeak memory of a log / of one a tenth as long     {figures.growth:6.2f}")
    print(f"throughput of changing / of fixed geometry        {figures.changing_geometry:6.2f}")
    print(f"throughput on all cores / on one                  {figures.on_cores:6.2f}")
    print(f"throughput of threads for the detection / of one  {figures.of_threads:6.2f}")
    print(f"time of track / of detect                         {figures.tracking:6.2f}")
    print(f"the same where nothing is compiled                {figures.plain_tracking:6.2f}")
    print(f"processor time of matching, us a sweep            {figures.matching_us:6.1f}")
    for name, milliseconds in figures.help_ms.items():
        print(f"{name:50}{milliseconds:6.0f} ms")


def broken(figures: Figures) -> list[str]:
    """The limits that do not hold."""
    checks = (
        ("time of detect / of iterating", figures.ratio(figures.robust), 3.5),
        ("peak memory [MB]", max(result.peak_mb for result in figures.results()), 300.0),
        ("peak memory of a log / of one a tenth as long", figures.growth, 1.25),
        ("throughput of fixed / of changing geometry", 1 / figures.changing_geometry, 2.0),
        ("time of track / of detect", figures.tracking, 1.25),
        ("time of track / of detect, not compiled", figures.plain_tracking, 3.0),
        ("lidarcli --help [ms]", figures.help_ms["lidarcli --help"], 150.0),
    )
    return [f"{name}: {value:.2f} is above {limit:g}" for name, value, limit in checks if value > limit]


def as_json(figures: Figures) -> str:
    """The measurements and what follows from them."""
    derived = {
        "ratio": {result.name: figures.ratio(result) for result in figures.results()},
        "sweeps_per_second": {result.name: result.per_second for result in figures.results()},
        "growth": figures.growth,
        "changing_geometry": figures.changing_geometry,
        "on_cores": figures.on_cores,
        "of_threads": figures.of_threads,
        "tracking": figures.tracking,
        "plain_tracking": figures.plain_tracking,
        "matching_us": figures.matching_us,
    }
    return json.dumps({**asdict(figures), **derived}, indent=2) + "\n"


def main() -> None:
    """Parse the arguments, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--sweeps", type=int, default=100_000, help="length of the log (default: %(default)s)"
    )
    parser.add_argument("--repeats", type=int, default=3, help="runs of each (default: %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON")
    parser.add_argument(
        "--assert", dest="limits", action="store_true", help="exit code 1 unless the limits hold"
    )
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="lidarcli-bench-"))
    try:
        figures = measure(arguments.sweeps, arguments.repeats, folder)
    finally:
        shutil.rmtree(folder)
    show(figures)
    if arguments.json:
        arguments.json.write_text(as_json(figures), encoding="utf-8")
    if arguments.limits and (failures := broken(figures)):
        sys.exit("\n".join(failures))


if __name__ == "__main__":
    main()
