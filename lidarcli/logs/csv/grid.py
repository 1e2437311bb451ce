"""BeamRuns of (bearing, range) rows as sweeps: an even step is recognised, an uneven one put on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.base import MAX_BEAMS
from lidarcli.sweeps import TURN, Bool, Float64, Int64

ONE_BEAM = "a sweep of one beam, whose increment nobody knows"
UNEVEN = "bearings without a common step"
TURNS = "bearings over more than a turn in one sweep: several layers or sweeps under one key"
BACK = "bearings start over within one sweep: several layers or sweeps under one key"
DOUBLED = "several ranges for most bearings of one sweep: layers or echoes under one key"
MOST_VIEW = 1.1 * TURN
"""Bearings of one sweep span no more than this [rad]; a turn whose start and end overlap does not reach it."""
MOST_DOUBLED = 0.25
"""Share of beams that may have the bearing of another."""
_USUAL = 1.5
"""A step of more than so many usual ones is a jump."""
JITTER = 0.25
"""Bearings may leave the even grid by this part of a step."""


@dataclass(frozen=True, slots=True)
class BeamRuns:
    """Rows of many sweeps, one after the other."""

    angle: Float64
    """(K,) bearings [rad]"""
    values: NDArray[np.floating]
    """(K,) ranges in the file's unit"""
    starts: Int64
    lengths: Int64


@dataclass(frozen=True, slots=True)
class EvenRuns:
    """Sweeps with an even step: ranges flat, geometry per sweep."""

    values: NDArray[np.floating]
    lengths: Int64
    first: Float64
    step: Float64


def cut_restarts(angle: Float64) -> Int64:
    """Where a new sweep begins in rows without a key: the bearing jumps back by most of the view.

    A single jump between two parts of the turn that do not overlap is the seam of one sweep.

    >>> cut_restarts(np.array([0.0, 0.1, 0.2, 0.0, 0.1, 0.2])).tolist()
    [0, 3]
    >>> cut_restarts(np.array([3.0, 3.1, -3.1, -3.0])).tolist()
    [0]
    """
    start = np.zeros(1, np.int64)
    if len(angle) < 3:
        return start
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.diff(angle)
        middle = np.nanmedian(steps) if np.isfinite(steps).any() else 0.0
        view = np.nanmax(angle) - np.nanmin(angle) if np.isfinite(angle).any() else 0.0
        back = (steps * np.sign(middle) < 0) & (np.abs(steps) > max(0.5 * view, 1.5 * abs(middle)))
    jumps = np.flatnonzero(back) + 1
    if len(jumps) == 1:
        before, after = angle[: jumps[0]], angle[jumps[0] :]
        if np.nanmin(before) > np.nanmax(after) or np.nanmax(before) < np.nanmin(after):
            return start
    return np.concatenate([start, jumps])


def cut_turns(angle: Float64, begins: Bool) -> Int64:
    """Where a new sweep begins in rows of which some are flagged as the first of a sweep.

    A flag may stand on the last beam before the bearing starts over, where beams were sorted by bearing. Where flags
    are missing, and sweeps would go on for more than a turn, these are cut by their bearings.

    >>> cut_turns(np.array([0.1, 3.0, 6.2, 0.2, 3.0, 6.1]), np.array([False, False, True, False, False, False])).tolist()
    [0, 3]
    """
    start = np.zeros(1, np.int64)
    with np.errstate(invalid="ignore", over="ignore"):
        steps = np.abs(np.diff(angle))
        usual = (
            steps <= _USUAL * np.median(np.minimum(steps, np.abs(TURN - steps))) if len(steps) else steps > 0
        )
        ahead, behind = np.append(steps, np.inf), np.append(False, usual)
        flags = np.flatnonzero(begins)
        # What ends a turn goes on as the turn did, and the bearing, if any follows, starts over.
        flags = flags + (behind[flags] & (ahead[flags] > 0.5 * TURN))
        flags = flags[flags < len(angle)]
        if not len(flags):
            return cut_restarts(angle)
        flags = np.unique(np.concatenate([start, flags]))
        turned = np.unwrap(angle)
        ends = np.append(flags[1:], len(angle))
        long = np.abs(turned[ends - 1] - turned[flags]) > MOST_VIEW
    parts = [cut_restarts(angle[flags[at] : ends[at]]) + flags[at] for at in np.flatnonzero(long).tolist()]
    return np.unique(np.concatenate([flags, *parts]))


def within_turns(angle: Float64, starts: Int64) -> Float64:
    """(K,) bearings that begin within half a turn to either side in each sweep, and go on from there without a jump."""
    with np.errstate(invalid="ignore", over="ignore"):
        turned = np.unwrap(angle)
        offset = TURN * np.rint(turned[starts] / TURN)
        within: Float64 = turned - np.repeat(offset, np.diff(np.append(starts, len(angle))))
    return within


def even_runs(runs: BeamRuns) -> tuple[EvenRuns, list[str], bool]:
    """Sweeps of even step from rows of bearings; per run why it is none (or ''), and whether a grid was needed."""
    starts, lengths = runs.starts, runs.lengths
    if not len(starts):
        none = np.empty(0)
        return EvenRuns(runs.values[:0], lengths, none, none), [], False
    begin, end = int(starts[0]), int(starts[-1] + lengths[-1])
    angle = runs.angle[begin:end]
    first = runs.angle[starts]
    steps = np.maximum(lengths - 1, 1)
    place = np.arange(end - begin) - np.repeat(starts - begin, lengths)
    with np.errstate(invalid="ignore", over="ignore"):
        step = (runs.angle[starts + lengths - 1] - first) / steps
        off = np.abs(angle - (np.repeat(first, lengths) + place * np.repeat(step, lengths)))
        even = np.maximum.reduceat(off, starts - begin) <= JITTER * np.abs(step)
        even &= (lengths > 1) & (np.abs(step) * steps <= MOST_VIEW)
    first, step = snap(first, first, np.ones(len(first))), snap(step, first, steps)
    if even.all():
        return EvenRuns(runs.values[begin:end], lengths, first, step), [""] * len(starts), False
    causes = [""] * len(starts)
    parts = []
    beams = lengths.copy()
    for run, (at, count) in enumerate(zip(starts.tolist(), lengths.tolist(), strict=True)):
        values = runs.values[at : at + count]
        if not even[run]:
            grid = _on_grid(runs.angle[at : at + count], values)
            if isinstance(grid, str):
                causes[run] = grid
                continue
            values, first[run], step[run] = grid
            beams[run] = len(values)
        parts.append(values)
    kept = np.array([not cause for cause in causes])
    flat = np.concatenate(parts) if parts else runs.values[:0]
    return EvenRuns(flat, beams[kept], first[kept], step[kept]), causes, True


def snap(values: Float64, angles: Float64, steps: NDArray[np.floating]) -> Float64:
    """Angles that are a float32 but for the rounding of decimal text, as that float32: what the sensor's message held."""
    with np.errstate(over="ignore", invalid="ignore"):
        single = values.astype(np.float32).astype(np.float64)
        slack = 16 * np.finfo(np.float64).eps * np.maximum(np.abs(angles), np.pi) / steps
        return np.where(np.abs(values - single) <= slack, single, values)


def _on_grid(angle: Float64, values: NDArray[np.floating]) -> tuple[NDArray[np.floating], float, float] | str:
    """One sweep of uneven bearings on a grid of their median step; beams that nothing falls on are NaN.

    Why it is none where there is no such grid.
    """
    known = np.isfinite(angle)
    if known.sum() < 2:
        return ONE_BEAM if len(angle) == 1 else UNEVEN
    turned = np.unwrap(angle[known])
    if np.ptp(turned) > MOST_VIEW:
        return TURNS
    if len(cut_restarts(turned)) > 1:
        return BACK
    values = values[known]
    steps = np.diff(turned)
    descending = np.median(steps) < 0
    order = np.argsort(turned, kind="stable")
    turned, values = turned[order], values[order]
    gaps = np.diff(turned)
    if (gaps <= 1e-9).mean() > MOST_DOUBLED:
        return DOUBLED
    gaps = gaps[gaps > 1e-9]
    step = float(np.median(gaps))
    place = np.rint((turned - turned[0]) / step)
    if place[-1] >= min(4 * len(turned) + 16, MAX_BEAMS):
        return UNEVEN
    step = float((turned[-1] - turned[0]) / place[-1])
    place = np.rint((turned - turned[0]) / step).astype(np.int64)
    grid = np.full(int(place[-1]) + 1, np.nan, values.dtype)
    # Of two beams on one place the nearer counts, and any return before none.
    with np.errstate(invalid="ignore"):
        far = np.where(values > 0, values, np.inf)
    order = np.lexsort((far, place))[::-1]
    grid[place[order]] = values[order]
    if descending:
        return grid[::-1], float(turned[-1]), -step
    return grid, float(turned[0]), step
