"""`clean` over logs of every container that it copies: mutated ones, and databases made to harm."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from lidarcli.choices import FOUND, MENDS
from lidarcli.copying import Copy, Met, copy_log
from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import LASERSCAN
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


def write_mended(place: Place, number: int, random: Random) -> None:
    """As to be copied, in turns all faults, those that are found, and any of them."""
    write(place, len(KNOWN_OUTPUTS) + number, random)
    (_, _, log, *_), _ = place.noted()["commands"]
    some = [word for word in MENDS if word != "statics" and random.integers(2)]
    words = [FOUND] if number % 3 == 1 else [word for word in MENDS if word != "statics"] if number % 3 == 0 else some
    clean, info = _commands(log.removeprefix("in/"), log.replace("in/", "out/", 1))
    place.note(commands=[[*clean, "--remove", "none", "--mend", ",".join(words or MENDS[:1])], info])


def judge_mended(place: Place) -> Iterator[str]:
    """A copy can be read, and has as many sweeps, and beside them the messages of the log."""
    yield from judge_commands(place)
    (_, _, log, _, output, *_), _ = place.noted()["commands"]
    if (place.root / output).exists():
        try:
            before, after = _Seen.of(str(place.root / log)), _Seen.of(str(place.root / output))
        except UnreadableError as err:
            yield f"{output} cannot be read: {err}"
        else:
            if before.others != after.others or before.scans != after.scans:
                yield f"{output} has other messages than {log}"


@dataclass(slots=True)
class _Seen(Copy):
    """The messages of a log."""

    others: list[tuple[str, str, int, bytes]] = field(default_factory=list)
    scans: list[tuple[str, int]] = field(default_factory=list)

    @classmethod
    def of(cls, path: str) -> _Seen:
        """Read a log."""
        seen = cls()
        with open_log(path) as log:
            copy_log(log, [], seen)
        return seen

    def note(self, met: Met) -> None:
        """Take a message."""
        if met.type == LASERSCAN:
            self.scans.append((met.topic, met.record_ns))
        else:
            self.others.append((met.topic, met.type, met.record_ns, met.data))


def _commands(log: str, output: str) -> list[list[str]]:
    """Copy it, and read the copy."""
    return [["-q", "clean", f"in/{log}", "-o", output, "--overwrite"], ["-q", "info", output]]


def cleaning_targets() -> list[Target]:
    """Copies."""
    known = len(KNOWN_OUTPUTS) + len(_PREFIXES)
    return [
        Target("clean", write, judge_commands, weight=60, known=known),
        Target("clean-mend", write_mended, judge_mended, weight=60, known=len(_samples())),
        Target("clean-db3", write_database, judge_commands, weight=60, known=len(databases.KINDS)),
    ]
