"""The sweeps that were judged, read from their logs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import lidarcli
from benchmarks.annotations.choice import CHOSEN, Chosen
from benchmarks.annotations.table import LABELS, Sweep, read
from lidarcli.sweeps.types import Int64, SweepBatch

Row = tuple[SweepBatch, int]
"""A row of a batch."""


@dataclass(frozen=True, eq=False, slots=True)
class JudgedSweep:
    """A sweep with its judgements."""

    batch: SweepBatch
    row: int
    told: Sweep
    verdict: Int64
    """(B,) code into `VERDICTS`, or `NOT_JUDGED`."""
    thing: Int64
    """(B,)"""


def rows_of(folder: Path, chosen: Chosen) -> list[Row]:
    """All sweeps of a topic."""
    return [(batch, row) for batch in lidarcli.read(chosen.path(folder), topic=chosen.topic) for row in range(len(batch))]


def judged_sweeps(folder: Path, labels: Path = LABELS) -> Iterator[tuple[Chosen, JudgedSweep]]:
    """The judged sweeps, log by log."""
    told = {(each.log, each.topic, each.sweep): each for each in read(labels)}
    for chosen in CHOSEN:
        if not chosen.path(folder).exists():
            continue
        for batch in lidarcli.read(chosen.path(folder), topic=chosen.topic):
            for row, sweep in enumerate(batch.sweep.tolist()):
                mine = told.get((chosen.log, chosen.topic, sweep))
                if mine is not None:
                    yield chosen, JudgedSweep(batch, row, mine, *mine.beams(batch.width))
