"""The figures of one method on one log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.tracking.methods import Result
from benchmarks.tracking.metrics import Agreement, agreement, overlaps
from benchmarks.tracking.recordings import Detected, Recording
from lidarcli.sweeps import Bool, Float64, Int64

LEAST = 3
"""Entities hit by fewer beams in a sweep are not asked for there: no object has fewer."""


@dataclass(frozen=True, slots=True)
class Share:
    """So many of so many; they add up."""

    some: int = 0
    all: int = 0

    def __add__(self, other: Share) -> Share:
        return Share(self.some + other.some, self.all + other.all)

    @property
    def value(self) -> float:
        """NaN of none."""
        return self.some / self.all if self.all else float("nan")


@dataclass(frozen=True, eq=False, slots=True)
class Score:
    """Figures of one method on one log."""

    agreement: Agreement
    moving_errors: Float64
    """Of the velocities of movers' rows [m/s], from the sweep on in which they begin."""
    standing_errors: Float64
    """Of the velocities of rows of what never moves, pieces of wall among them."""
    movers_in_a: Share
    """Rows of what has moved at `cells.SLOW` by then."""
    standing_in_a: Share
    """Rows of what never moves in the log, pieces of wall among them."""
    sweeps: int
    seconds: float


def score(recording: Recording, found: Detected, result: Result) -> Score:
    """Compare what a method says with the truth."""
    tracked = result.track > 0
    moves = np.asarray(recording.begun.any(axis=0))
    thing = (found.entity >= 0) & ~recording.wall[found.entity]
    begun = tracked & thing & recording.begun[found.row, found.entity]
    stands = tracked & (found.entity >= 0) & ~moves[found.entity]
    fast = thing & recording.fast[found.row, found.entity]
    error = np.hypot(*(result.velocity - recording.velocity[found.row, found.entity]).T)
    return Score(
        agreement=agreement(overlaps(*labels(recording, found, result.track))),
        moving_errors=_known(error[begun]),
        standing_errors=_known(error[stands]),
        movers_in_a=_share(result.agent[fast]),
        standing_in_a=_share(result.agent[(found.entity >= 0) & ~moves[found.entity]]),
        sweeps=len(recording.batch),
        seconds=result.seconds,
    )


def labels(recording: Recording, found: Detected, track: Int64) -> tuple[Int64, Int64, Bool]:
    """(S, B) entity and track of each beam, -1 for none, and beams on entities that are not asked for."""
    entity = recording.entity
    width = int(entity.max(initial=0)) + 1
    sweep, beam = np.nonzero((entity >= 0) & ~recording.wall[entity])
    cell = sweep * width + entity[sweep, beam]
    few = np.bincount(cell, minlength=len(entity) * width)[cell] < LEAST
    truth = np.full(entity.shape, -1)
    truth[sweep, beam] = entity[sweep, beam]
    ignored = np.zeros(entity.shape, np.bool_)
    ignored[sweep, beam] = few
    of_object = np.append(np.where(track > 0, track, -1), -1)
    return truth, of_object[found.labels], ignored


def _known(values: Float64) -> Float64:
    known: Float64 = values[np.isfinite(values)]
    return known


def _share(values: Bool) -> Share:
    return Share(int(np.count_nonzero(values)), len(values))
