"""`clean` over logs of every container that it copies: mutated ones, and databases made to harm."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from lidarcli.copying.copying import Copy, Met, copy_log
from lidarcli.errors import UnreadableError
from lidarcli.logs import open_log
from lidarcli.logs.base import LASERSCAN
from lidarcli.options.choices import FOUND, MENDS
from tools.fuzz import databases
from tools.fuzz.commands import judge_commands, run
from tools.fuzz.containers import CONTAINERS, Sample, sample_of
from tools.fuzz.libraries import LIBRARY_LOGS, library_sample
from tools.fuzz.mutate import mutate
from tools.fuzz.place import Place
from tools.fuzz.tables import LOG, mutated_table, tables
from tools.fuzz.target import Random, Target
from tools.fuzz.words import mutate_words
from tools.fuzz.zones import ZONES

_PREFIXES = ("mcap", "bag", "db3", "ros2")
_OWN = [name for name in CONTAINERS if name.startswith(_PREFIXES)]
_OTHERS = [name for name in LIBRARY_LOGS if name.startswith(_PREFIXES)]
KNOWN_OUTPUTS = (".", "in", "in/run.mcap", "victims", "out/a/b", "-")
"""Where no copy belongs, and odd places for one."""


def _samples() -> list[Sample]:
    """Logs of the containers that can be copied."""
    moving = Sample(LOG, {LOG: tables()[LOG]})
    return [moving, *map(sample_of, _OWN), *map(library_sample, _OTHERS)]


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


_EVENTS = "run.events.parquet"
_AROUND = ("0", "0.5", "1ms", "1e9", "nan", "-1", "x")
_TWO = "two.bag"
_MERGED = ("/scan", "scan", "/front", "/tf", "", "/", "//", "a b", "/\x1b[31m", "/é", "/" + "a" * 5000, "~", "/scan/")
_FRAMES = ("base_link", "front", "laser", "odom", "map", "", "/", "nothing", "\x1b[31m", "/base_link")


@cache
def _events() -> bytes:
    """The events of some zones in the log."""
    with tempfile.TemporaryDirectory() as folder:
        log, zones = Path(folder) / LOG, Path(folder) / "zones.toml"
        log.write_bytes(tables()[LOG])
        zones.write_text(ZONES, encoding="utf-8")
        if (ran := run(["-q", "zones", str(log), "--zones", str(zones), "-o", folder])).code:
            raise RuntimeError(ran.err)
        return (Path(folder) / _EVENTS).read_bytes()


@cache
def _two_lasers() -> bytes:
    """A second of a robot with two lasers."""
    sample = Path(__file__).parents[2] / "samples" / "two_lasers.zip"
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(sample) as packed:
        (name,) = packed.namelist()
        part = Path(folder) / _TWO
        told = ["--remove", "none", "--start", "0", "--end", "1"]
        if (ran := run(["-q", "clean", packed.extract(name, folder), "-o", str(part), *told])).code:
            raise RuntimeError(ran.err)
        return part.read_bytes()


def write_clips(place: Place, number: int, random: Random) -> None:
    """A log in parts, by a table that is sound or changed; now and then the log is changed, too."""
    log, events = tables()[LOG], _events()
    if number >= len(_AROUND):
        events = mutated_table(_EVENTS, random, events)
        if not random.integers(4):
            log = mutate(log, random)
    (place.input / LOG).write_bytes(log)
    (place.input / _EVENTS).write_bytes(events)
    around = _AROUND[number % len(_AROUND) if number < 2 * len(_AROUND) else int(random.integers(4))]
    told = ["--remove", "none", "--clips", f"in/{_EVENTS}", "--around", around]
    place.note(commands=[["-q", "clean", f"in/{LOG}", "-o", "out/clips", "--overwrite", *told]])


def write_merged(place: Place, number: int, random: Random) -> None:
    """Two lasers as one under odd names, then of a log that is changed."""
    names, log, drawn = len(_MERGED) + len(_FRAMES), _two_lasers(), number >= len(_MERGED) + len(_FRAMES)
    topic = _MERGED[number] if number < len(_MERGED) else _MERGED[0]
    frame = _FRAMES[number - len(_MERGED)] if len(_MERGED) <= number < names else _FRAMES[0]
    if drawn:
        log = mutate(log, random)
        topic, frame = (each if random.integers(4) else mutate_words(each, random) for each in (topic, frame))
    (place.input / _TWO).write_bytes(log)
    # No argument of a process holds a zero byte.
    told = [each.replace("\0", "") for each in ("--merge", topic, "--merge-frame", frame)]
    clean, info = _commands(_TWO, f"out/{_TWO}")
    place.note(commands=[[*clean, "--remove", "none", *told], info])


def _commands(log: str, output: str) -> list[list[str]]:
    """Copy it, and read the copy."""
    return [["-q", "clean", f"in/{log}", "-o", output, "--overwrite"], ["-q", "info", output]]


def cleaning_targets() -> list[Target]:
    """Copies."""
    known = len(KNOWN_OUTPUTS) + len(_PREFIXES)
    return [
        Target("clean", write, judge_commands, weight=60, known=known),
        Target("clean-mend", write_mended, judge_mended, weight=60, known=1 + len(_OWN) + len(_OTHERS)),
        Target("clean-db3", write_database, judge_commands, weight=60, known=len(databases.KINDS)),
        Target("clips", write_clips, judge_commands, weight=60, known=len(_AROUND)),
        Target("merge", write_merged, judge_commands, weight=30, known=len(_MERGED) + len(_FRAMES)),
    ]
