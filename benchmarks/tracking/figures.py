"""Everything that was measured, in one place: the scores of all logs, summed up by method and condition, and as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np

from benchmarks.tracking.by_eye import OneLog
from benchmarks.tracking.cells import PERSONS, Cell
from benchmarks.tracking.real import Car, Legs
from benchmarks.tracking.scoring import Score, Share
from lidarcli.sweeps.types import Float64

NAN = float("nan")


@dataclass(frozen=True, eq=False, slots=True)
class Log:
    """One log by all methods."""

    cell: Cell
    seed: int
    scores: dict[str, Score]
    detect_seconds: float
    """Time of the detection per sweep."""


@dataclass(frozen=True, slots=True)
class Summary:
    """The figures of one method over several logs. Means over the logs; shares, errors and times over all rows."""

    logs: int
    hota: float
    hota_worst: float
    """Of the worst cell."""
    detection: float
    association: float
    idf1: float
    mota: float
    hota_of_all: float
    """With what was not detected."""
    switches: float
    """Per 100 bodies."""
    tracks: float
    """Per 100 bodies."""
    speed_rms: float
    """Error of the velocity of movers [m/s]."""
    speed_median: float
    paused_rms: float
    standing_rms: float
    movers_in_a: float
    movers_worst: float
    standing_in_a: float
    standing_worst: float
    microseconds: float
    """Per sweep."""


@dataclass(frozen=True, eq=False, slots=True)
class Figures:
    """The figures of a run."""

    command: str
    """What makes them again."""
    first_seed: int
    seeds: int
    """Logs of each cell."""
    logs: list[Log]
    cars: list[Car] = field(default_factory=list)
    """Empty without the recordings."""
    legs: list[Legs] = field(default_factory=list)
    by_eye: list[OneLog] = field(default_factory=list)

    @property
    def methods(self) -> list[str]:
        """In their order."""
        return list(self.logs[0].scores)

    @property
    def cells(self) -> list[Cell]:
        """In their order."""
        return list(dict.fromkeys(log.cell for log in self.logs))

    def of(self, wanted: Callable[[Cell], bool]) -> list[Log]:
        """The logs of some cells."""
        return [log for log in self.logs if wanted(log.cell)]


def rigid(cell: Cell) -> bool:
    """Whether all bodies of the cell's scenes are rigid."""
    return cell.kind != PERSONS


def persons(cell: Cell) -> bool:
    """Whether the cell's scenes hold persons."""
    return cell.kind == PERSONS


def summarise(logs: Sequence[Log], method: str) -> Summary:
    """The figures of one method over some logs."""
    scores = [log.scores[method] for log in logs]
    cells = [[one.scores[method] for one in logs if one.cell == cell] for cell in {log.cell for log in logs}]
    agreements = [one.agreement for one in scores]
    bodies = sum(one.entities for one in agreements) or NAN
    moving = np.concatenate([one.moving_errors for one in scores])
    return Summary(
        logs=len(logs),
        hota=mean(one.hota for one in agreements),
        hota_worst=min(mean(one.agreement.hota for one in cell) for cell in cells),
        detection=mean(one.detection for one in agreements),
        association=mean(one.association for one in agreements),
        idf1=mean(one.idf1 for one in agreements),
        mota=mean(one.mota for one in agreements),
        hota_of_all=mean(one.with_all.hota for one in scores),
        switches=100 * sum(one.switches for one in agreements) / bodies,
        tracks=100 * sum(one.tracks for one in agreements) / bodies,
        speed_rms=rms(moving),
        speed_median=median(moving),
        paused_rms=rms(np.concatenate([one.paused_errors for one in scores])),
        standing_rms=rms(np.concatenate([one.standing_errors for one in scores])),
        movers_in_a=_all(one.movers_in_a for one in scores).value,
        movers_worst=_extreme(min, (_all(one.movers_in_a for one in cell) for cell in cells)),
        standing_in_a=_all(one.standing_in_a for one in scores).value,
        standing_worst=_extreme(max, (_all(one.standing_in_a for one in cell) for cell in cells)),
        microseconds=1e6 * sum(one.seconds for one in scores) / sum(one.sweeps for one in scores),
    )


def mean(values: Iterable[float]) -> float:
    """Of at least one."""
    return float(np.mean(list(values)))


def rms(errors: Float64) -> float:
    """Root mean square, NaN of none."""
    return float(np.sqrt(np.mean(np.square(errors, dtype=float)))) if len(errors) else NAN


def median(errors: Float64) -> float:
    """NaN of none."""
    return float(np.median(errors)) if len(errors) else NAN


def _all(shares: Iterable[Share]) -> Share:
    return sum(shares, Share())


def _extreme(choose: Callable[[list[float]], float], shares: Iterable[Share]) -> float:
    values = [share.value for share in shares if share.all]
    return choose(values) if values else NAN


def as_json(figures: Figures) -> str:
    """All cells and methods, and the real recordings."""
    cells = [
        {**asdict(cell), "method": method, **asdict(summarise(figures.of(cell.__eq__), method))}
        for cell in figures.cells
        for method in figures.methods
    ]
    tables = {
        "command": figures.command,
        "cells": cells,
        "cars": [asdict(car) for car in figures.cars],
        "legs": [asdict(legs) for legs in figures.legs],
        "by_eye": [asdict(log) for log in figures.by_eye],
    }
    return json.dumps(tables, indent=1) + "\n"
