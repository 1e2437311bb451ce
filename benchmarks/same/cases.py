"""What is run on which log."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.same.logs import SAMPLES, NamedLog, digest_of

DONE = "done.json"
"""File beside the results of a case that has ended."""
OUT = "{out}"
"""Stands for the folder of the results."""
PROFILES = ("robust", "paper")
VARIANTS: tuple[tuple[str, ...], ...] = (
    ("--walls", "--beams"),
    ("--group-gap", "0.4"),
    ("--threshold", "0.2"),
    ("--threshold", "mean"),
    ("--max-gap", "0"),
    ("--max-gap", "5"),
    ("--min-beams", "1"),
    ("--max-width", "0.5"),
    ("--range", "0.5", "5"),
    ("--no-return", "nan,negative,below,9"),
)
BACKGROUND = f"{OUT}/background.parquet"
SUBTRACTED = ("--background", BACKGROUND, "--removed", "--beams")
TRACKED: tuple[tuple[str, ...], ...] = (
    (),
    ("--walls", "--beams", "--explain"),
    ("--profile", "paper"),
    ("--no-memory", "--agent-score", "0.9"),
    ("--group-gap", "0.4", "--every", "2"),
    ("--pose", "none"),
    ("--no-deskew", "--pose-delay", "0.05"),
)
MAPPED: tuple[tuple[str, ...], ...] = (
    (),
    ("--min-move", "0"),
    ("--without", "agents", "--voxel", "0.1", "--free-no-return", "3"),
    ("--pose", "match"),
)
MAPS = tuple(f"{OUT}/map.{suffix}" for suffix in ("yaml", "png", "ply", "pcd", "parquet", "mcap"))
BACKGROUNDS = {"room.mcap": "room_empty.mcap"}
"""Sample → the sample that shows the scene without objects; every other log is its own background."""


@dataclass(frozen=True)
class Case:
    """Commands of lidarcli, and the log that they are about."""

    log: NamedLog
    label: str
    """The options, for reports."""
    commands: tuple[tuple[str, ...], ...]
    digest: str
    """What the results depend on, but for the code."""


def cases_of(logs: Iterable[NamedLog], thorough: bool) -> Iterator[Case]:
    """Every case; `thorough` tries all options on the logs that were given, too."""
    for log in logs:
        for profile in PROFILES:
            yield _detect(log, "--profile", profile)
            if thorough or log.group != "given":
                for variant in VARIANTS:
                    yield _detect(log, "--profile", profile, *variant)
        yield from (_track(log, *variant) for variant in (TRACKED if thorough or log.group != "given" else TRACKED[:1]))
        if log.group in ("samples", "given"):
            yield _subtract(log)
            yield from (_map(log, *variant) for variant in (MAPPED if log.group == "samples" else MAPPED[:1]))


def _detect(log: NamedLog, *options: str) -> Case:
    return _case(log, " ".join(options), [_command(log, *options)])


def _track(log: NamedLog, *options: str) -> Case:
    return _case(log, " ".join(("track", *options)), [_command(log, *options, name="track")])


def _map(log: NamedLog, *options: str) -> Case:
    """Make a map in every format; where nothing tells the poses, the refusal is the result."""
    outputs = (word for path in MAPS for word in ("-o", path))
    command = ("-q", "map", str(log.path), *outputs, "--jobs", "1", "--overwrite", *options)
    return _case(log, " ".join(("map", *options)), [command])


def _subtract(log: NamedLog) -> Case:
    """Learn a background, then compare with it; what was learned is a result like others."""
    empty = log
    if log.group == "samples" and log.name in BACKGROUNDS:
        empty = NamedLog(log.group, SAMPLES / BACKGROUNDS[log.name])
    learn = ("-q", "background", "build", str(empty.path), "-o", BACKGROUND, "--overwrite")
    label = f"--background of {empty.name}"
    return _case(log, label, [learn, _command(log, *SUBTRACTED)], empty)


def _command(log: NamedLog, *options: str, name: str = "detect") -> tuple[str, ...]:
    return "-q", name, str(log.path), "-o", OUT, "--jobs", "1", "--overwrite", *options


def _case(log: NamedLog, label: str, commands: list[tuple[str, ...]], *others: NamedLog) -> Case:
    used = [log, *others]
    # A log may lie elsewhere, but its name is in the tables.
    paths = {str(each.path): each.name for each in used}
    words = "\0".join(paths.get(word, word) for command in commands for word in command)
    total = hashlib.sha256(words.encode())
    digest = digest_of([(total.hexdigest(), b""), *((each.name, each.digest.encode()) for each in used)])
    return Case(log, label, tuple(commands), digest)


def outputs_in(folder: Path) -> dict[str, Path]:
    """Return what a case wrote by its kind: objects, sweeps, tracks, beams, background, map.png ..."""
    paths = sorted(path for path in folder.iterdir() if path.name != DONE)
    return {path.name.split(".")[-2] if _is_table_of_log(path) else path.name: path for path in paths}


def _is_table_of_log(path: Path) -> bool:
    return path.suffix == ".parquet" and path.name != "map.parquet"
