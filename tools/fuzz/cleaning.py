"""`clean` over logs of every container that it copies: mutated ones, and databases made to harm."""

from __future__ import annotations

from tools.fuzz import databases
from tools.fuzz.commands import judge_commands
from tools.fuzz.containers import CONTAINERS, Sample, sample_of
from tools.fuzz.libraries import LIBRARY_LOGS, library_sample
from tools.fuzz.place import Place
from tools.fuzz.tables import LOG, tables
from tools.fuzz.target import Random, Target

_PREFIXES = ("mcap", "bag", "db3", "ros2")
KNOWN_OUTPUTS = (".", "in", "in/run.mcap", "victims", "out/a/b", "-")
"""Where no copy belongs, and odd places for one."""


def _samples() -> list[Sample]:
    """Logs of the containers that can be copied."""
    own = [sample_of(name) for name in CONTAINERS if name.startswith(_PREFIXES)]
    others = [library_sample(name) for name in LIBRARY_LOGS if name.startswith(_PREFIXES)]
    moving = Sample(LOG, {LOG: tables()[LOG]})
    return [moving, *own, *others]


def write(place: Place, number: int, random: Random) -> None:
    """The log with something that moves into odd places, then every sample as it is, then mutated ones."""
    samples = _samples()
    odd = number < len(KNOWN_OUTPUTS)
    drawn = number >= len(KNOWN_OUTPUTS) + len(samples)
    at = 0 if odd else int(random.integers(len(samples))) if drawn else number - len(KNOWN_OUTPUTS)
    sample = samples[at]
    for file, data in (sample.mutated(random) if drawn else sample.files).items():
        path = place.input / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    output = KNOWN_OUTPUTS[number] if odd else f"out/{sample.log}"
    place.note(commands=_commands(sample.log, output))


def write_database(place: Place, number: int, random: Random) -> None:
    """As for reading: each kind as it is, then any of them with bytes changed."""
    databases.write(place, number, random)
    log = place.noted()["log"]
    place.note(commands=_commands(log, f"out/{log}"))


def _commands(log: str, output: str) -> list[list[str]]:
    """Copy it, and read the copy."""
    return [["-q", "clean", f"in/{log}", "-o", output, "--overwrite"], ["-q", "info", output]]


def cleaning_targets() -> list[Target]:
    """Copies."""
    known = len(KNOWN_OUTPUTS) + len(_PREFIXES)
    return [
        Target("clean", write, judge_commands, weight=60, known=known),
        Target("clean-db3", write_database, judge_commands, weight=60, known=len(databases.KINDS)),
    ]
