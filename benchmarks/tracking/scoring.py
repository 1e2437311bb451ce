"""The figures of one method on one log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.tracking.bodies import Bodies, bodies
from benchmarks.tracking.methods import Result
from benchmarks.tracking.metrics import Agreement, agreement, overlaps
from benchmarks.tracking.recordings import Detected, Recording
from lidarcli.sweeps.types import Bool, Float64, Int64

LEAST = 3
"""No object has fewer beams."""


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
    """With the entities of which something was detected in the sweep."""
    with_all: Agreement
    """With all that `LEAST` beams hit, detected or not."""
    moving_errors: Float64
    """Of the velocities of the rows of what moves in that sweep [m/s]."""
    paused_errors: Float64
    """Of the rows of what has moved before and stands in that sweep."""
    standing_errors: Float64
    """Of the velocities of rows of what never moves, pieces of wall among them."""
    movers_in_a: Share
    """Rows of what has moved at `cells.SLOW` by then."""
    standing_in_a: Share
    """Rows of what never moves in the log, pieces of wall among them."""
    sweeps: int
    seconds: float
    bodies: Bodies | None
    """None of a method that says nothing of them."""


def score(recording: Recording, found: Detected, result: Result) -> Score:
    """Compare what a method says with the truth."""
    tracked = result.track > 0
    moves = np.asarray(recording.begun.any(axis=0))
    thing = (found.entity >= 0) & ~recording.wall[found.entity]
    begun = tracked & thing & recording.begun[found.row, found.entity]
    stands = tracked & (found.entity >= 0) & ~moves[found.entity]
    fast = thing & recording.fast[found.row, found.entity]
    moving = recording.velocity[found.row, found.entity].any(axis=1)
    error = np.hypot(*(result.velocity - recording.velocity[found.row, found.entity]).T)
    truth, track = labels(recording, found, result.track)
    return Score(
        agreement=agreement(overlaps(truth, track, undetected(truth, found))),
        with_all=agreement(overlaps(truth, track, too_small(truth))),
        moving_errors=_known(error[begun & moving]),
        paused_errors=_known(error[begun & ~moving]),
        standing_errors=_known(error[stands]),
        movers_in_a=_share(result.agent[fast]),
        standing_in_a=_share(result.agent[(found.entity >= 0) & ~moves[found.entity]]),
        sweeps=len(recording.batch),
        seconds=result.seconds,
        bodies=None if result.tracks is None else bodies(recording, found, result),
    )


def labels(recording: Recording, found: Detected, track: Int64) -> tuple[Int64, Int64]:
    """(S, B) entity and track of each beam, -1 for none."""
    entity = recording.entity
    truth = np.where((entity >= 0) & ~recording.wall[entity], entity, -1)
    of_object = np.append(np.where(track > 0, track, -1), -1)
    return truth, of_object[found.labels]


def undetected(truth: Int64, found: Detected) -> Bool:
    """(S, B) beams on entities that no object of the sweep is of: what is not detected cannot be followed."""
    width = int(truth.max(initial=0)) + 2
    seen = np.zeros((len(truth), width), np.bool_)
    seen[found.row, found.entity] = True
    known: Bool = truth >= 0
    return known & ~np.take_along_axis(seen, truth, axis=1)


def too_small(truth: Int64) -> Bool:
    """(S, B) beams on entities that are hit by fewer than `LEAST` beams in the sweep."""
    width = int(truth.max(initial=0)) + 1
    sweep, beam = np.nonzero(truth >= 0)
    cell = sweep * width + truth[sweep, beam]
    result = np.zeros(truth.shape, np.bool_)
    result[sweep, beam] = np.bincount(cell, minlength=len(truth) * width)[cell] < LEAST
    return result


def _known(values: Float64) -> Float64:
    known: Float64 = values[np.isfinite(values)]
    return known


def _share(values: Bool) -> Share:
    return Share(int(np.count_nonzero(values)), len(values))
