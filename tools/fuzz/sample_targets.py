"""Mutated samples: logs of every container, written by our own writers and by other people's libraries."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from tools.fuzz.containers import CONTAINERS, Sample, sample_of
from tools.fuzz.libraries import LIBRARY_LOGS, library_sample
from tools.fuzz.logs import judge_log
from tools.fuzz.place import Place
from tools.fuzz.target import Random, Target


def sample_targets() -> list[Target]:
    """A target for each sample; number 0 is the sample as it is."""
    own = [_target(name, partial(sample_of, name), 40) for name in CONTAINERS]
    return own + [_target(name, partial(library_sample, name), 40) for name in LIBRARY_LOGS]


def _target(name: str, sample: Callable[[], Sample], weight: int) -> Target:
    def write(place: Place, number: int, random: Random) -> None:
        files = sample().mutated(random) if number else sample().files
        for file, data in files.items():
            path = place.input / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)

    return Target(name, write, lambda place: judge_log(place, place.input / sample().log), weight, known=1)
