"""Throughput and memory of `lidarcli detect`, once of `track` and of `map`: containers, sensors, lengths; one process.

Every time is from file to Parquet, given per sweep and as a multiple of what others take in the same run: iterating the
raw messages of an MCAP with the same sweeps (`mcap`), only reading and decompressing it, DBSCAN on each sweep, and the
paper's formulas as a loop in Python. `--stages` also takes the time of each stage apart.
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
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from benchmarks.bench import HERE, LIDARCLI, MOVING, Result, detect, iterate, make_log, run

DECADES = (1_000, 10_000, 100_000, 1_000_000)
MAP = "map"
BEGIN, RATE = 1_700_000_000, 10
"""Stamp of the first sweep of a simulated log [s], and sweeps per second: `map` has to be told where the sensor was."""


@dataclass(frozen=True)
class Case:
    """One log, and how `detect` is to treat it."""

    name: str
    file: str
    sweeps: float = 1.0
    """Length, as a share of that of the run."""
    made: tuple[str, ...] = ()
    """Options of `make_log.py`."""
    options: tuple[str, ...] = ()
    """Options of `detect`."""
    yardstick: str = "361"
    """Beams of the MCAP whose iteration is the reference."""
    scene: str = "scene.toml"
    command: str = "detect"


CASES = (
    Case("361 beams", "361.mcap"),
    Case("720 beams", "720.mcap", 0.5, ("--beams", "720"), yardstick="720"),
    Case("1081 beams", "1081.mcap", 0.5, ("--beams", "1081"), yardstick="1081"),
    Case("361 beams, profile paper", "361.mcap", options=("--profile", "paper")),
    Case("1081 beams, profile paper", "1081.mcap", 0.5, (), ("--profile", "paper"), "1081"),
    Case("358 to 364 beams", "changing.mcap", made=("--jitter", "3")),
    Case("MCAP lz4", "lz4.mcap", made=("--compression", "lz4")),
    Case("MCAP, 95 % images", "images.mcap", 0.2, ("--share", "0.05")),
    Case("ROS 1 bag", "ros1.bag"),
    Case("ROS 2 bag, sqlite3", "ros2.db3"),
    Case("CSV", "csv.csv", 0.2),
    Case("things move", "moving.mcap", scene=MOVING),
    Case("things move, track", "moving.mcap", scene=MOVING, command="track"),
    Case("map, every sweep counts", "361.mcap", options=("--min-move", "0"), command=MAP),
)


@dataclass
class Report:
    """What was measured: seconds per sweep."""

    machine: str
    commit: str
    cases: dict[str, Result] = field(default_factory=dict)
    lengths: dict[str, Result] = field(default_factory=dict)
    references: dict[str, float] = field(default_factory=dict)
    yardstick: dict[str, str] = field(default_factory=dict)
    stages: dict[str, str] = field(default_factory=dict)

    def ratio(self, name: str) -> float:
        """Time per sweep of a case, as a multiple of iterating the messages of an MCAP of the same sweeps."""
        result = {**self.cases, **self.lengths}[name]
        return median(result.seconds) / result.sweeps / self.references[self.yardstick[name]]


def measure(sweeps: int, repeats: int, longest: int, stages: bool, folder: Path) -> Report:
    """Write every log, run everything, and gather the figures."""
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    report = Report(machine, run("git", "-C", str(HERE), "describe", "--always", "--dirty").output.strip())
    logs: dict[str, Path] = {}
    for case in CASES:
        length = round(sweeps * case.sweeps)
        if case.file not in logs:
            logs[case.file] = make_log(folder, case.file, length, *case.made, scene=case.scene)
        report.cases[case.name] = Result(case.name, length)
        report.yardstick[case.name] = f"iterate {case.yardstick}"
    looped = {name: Result(name, report.cases[f"{name} beams"].sweeps) for name in ("361", "720", "1081")}
    read = []
    for turn in range(repeats):
        print(f"round {turn + 1} of {repeats} ...", file=sys.stderr)
        for beams, result in looped.items():
            iterate(logs[f"{beams}.mcap"], result)
        read.append(_seconds("read", logs["361.mcap"])[0] / sweeps)
        for case in CASES:
            result = report.cases[case.name]
            if case.command == MAP:
                make_map(logs[case.file], folder, result, *case.options)
            else:
                detect(logs[case.file], folder, result, *case.options, command=case.command)
    for beams, result in looped.items():
        report.references[f"iterate {beams}"] = median(result.seconds) / result.sweeps
    report.references["read and decompress"] = median(read)
    for name in ("loop", "dbscan"):
        seconds, count = _seconds(name, logs["361.mcap"])
        report.references[name] = seconds / count
    if stages:
        for beams in looped:
            report.stages[beams] = run(
                sys.executable, "-m", "benchmarks.stages", str(logs[f"{beams}.mcap"])
            ).output
    for log in logs.values():
        log.unlink()
    for length in (decade for decade in DECADES if decade <= longest):
        name = f"{length:,} sweeps"
        report.lengths[name] = Result(name, length)
        report.yardstick[name] = "iterate 361"
        log = make_log(folder, "length.mcap", length)
        for _ in range(1 if length > sweeps else repeats):
            detect(log, folder, report.lengths[name])
        log.unlink()
    return report


def make_map(log: Path, folder: Path, result: Result, *options: str) -> None:
    """Time `lidarcli map` from the start of Python to its end: the sensor of these logs stands."""
    path = folder / "path.tum"
    times = BEGIN, BEGIN + result.sweeps / RATE
    path.write_text("".join(f"{second} 0 0 0 0 0 0 1\n" for second in times), encoding="utf-8")
    target = str(folder / "map.yaml")
    known = "--poses", str(path), "--pose-delay", "0"
    result.add(run(LIDARCLI, "-q", "map", str(log), *known, *options, "-o", target, "--overwrite"))


def _seconds(what: str, log: Path) -> tuple[float, int]:
    seconds, count = run(sys.executable, str(HERE / "references.py"), what, str(log)).output.split()
    return float(seconds), int(count)


def as_markdown(report: Report) -> str:
    """The figures as tables of a page."""
    lines = [f"{report.machine}, commit {report.commit}.", ""]
    lines += ["| reference | µs per sweep |", "|---|---:|"]
    lines += [f"| {name} | {1e6 * value:,.1f} |" for name, value in report.references.items()]
    for title, results in (("detect, track and map", report.cases), ("detect, by length", report.lengths)):
        lines += ["", f"| {title} | sweeps | sweeps/s | µs per sweep | x iterate | peak MB |"]
        lines += ["|---|---:|---:|---:|---:|---:|"]
        for name, result in results.items():
            micros = 1e6 * median(result.seconds) / result.sweeps
            lines.append(
                f"| {name} | {result.sweeps:,} | {result.per_second:,.0f} | {micros:.1f} "
                f"| {report.ratio(name):.2f} | {result.peak_mb:.0f} |"
            )
    for beams, text in report.stages.items():
        lines += ["", f"Stages, {beams} beams:", "", "```", text.rstrip(), "```"]
    return "\n".join(lines) + "\n"


def as_json(report: Report) -> str:
    """The same for programs: `benchmarks/compare.py` reads it."""
    results = {**report.cases, **report.lengths}
    figures = {
        name: {
            "sweeps": result.sweeps,
            "us_per_sweep": 1e6 * median(result.seconds) / result.sweeps,
            "cpu_us_per_sweep": result.cpu_us,
            "ratio": report.ratio(name),
            "peak_mb": result.peak_mb,
        }
        for name, result in results.items()
    }
    references = {name: 1e6 * value for name, value in report.references.items()}
    text = {"machine": report.machine, "commit": report.commit, "references_us": references, "cases": figures}
    return json.dumps(text, indent=2, ensure_ascii=False) + "\n"


def main() -> None:
    """Parse the arguments, measure, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sweeps", type=int, default=100_000, help="of a log (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each (default: %(default)s)")
    parser.add_argument(
        "--longest", type=int, default=DECADES[-1], help="longest log by length (default: %(default)s)"
    )
    parser.add_argument("--stages", action="store_true", help="also the time of each stage")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures as JSON")
    arguments = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="lidarcli-bench-"))
    try:
        report = measure(arguments.sweeps, arguments.repeats, arguments.longest, arguments.stages, folder)
    except subprocess.SubprocessError as err:
        sys.exit(str(err))
    finally:
        shutil.rmtree(folder)
    print(as_markdown(report), end="")
    if arguments.json:
        arguments.json.write_text(as_json(report), encoding="utf-8")


if __name__ == "__main__":
    main()
