"""Rules for ranges: which raw values are a range, and the status of each beam; closure and duration of sweeps."""

from __future__ import annotations

import math

import numpy as np

import lidarcli.sweeps.ranges
from lidarcli.options.choices import MAX_NUMBER, NO_RETURN_WORDS
from lidarcli.sweeps.masks import Masks
from lidarcli.sweeps.types import TURN, Bool, Closure, Float32, Float64, Int32, Int64, RawSweeps, Status, SweepBatch, UInt8
from lidarcli.system.records import dataclass


@dataclass(frozen=True, slots=True)
class RangeRules:
    """Rules by which raw ranges become a range and a status."""

    no_return: frozenset[str] = frozenset({"inf", "zero", "max", "above", "pile"})
    """Kinds of values that mean "no return", of `NO_RETURN_WORDS`."""
    markers: tuple[float, ...] = ()
    """Magic values [m] that mean "no return" on some drivers (81.91, 50, ...)."""
    limits: tuple[float, float] | None = None
    """Range limits [m] that replace those of the messages."""
    farthest: float = math.inf
    """Range from which on there is no return [m], because many beams tell this one (`logs.piles`)."""
    stuck: tuple[tuple[int, float], ...] = ()
    """Beams that always tell one range [m], which is none, because they do (`logs.piles`)."""
    masks: Masks | None = None
    """Masks of the robot itself, which its beams hit."""

    @property
    def words(self) -> frozenset[str]:
        """Kinds of values that are no return: the named ones, and those that a pile adds."""
        return self.no_return | {"max", "above"} if self.farthest < math.inf else self.no_return

    def in_order(self) -> list[str]:
        """Return the words and markers as `--no-return` takes them."""
        words = [word for word in NO_RETURN_WORDS if word in self.no_return]
        return words + [f"{marker:g}" for marker in sorted(self.markers)]


def closure(beams: Int32, angle_increment: Float64) -> UInt8:
    """Return the `Closure` of sweeps (S,), from their beam counts and increments.

    A turn may fall short by half an increment or by 0.25 % of the turn: drivers that round `angle_increment` leave a
    seam of up to three beams which no beam belongs to.

    >>> step = TURN / 360
    >>> closure(np.array([360, 361, 270], np.int32), np.array([step, -step, step])).tolist()
    [1, 2, 0]
    """
    step = np.abs(angle_increment)
    turn = np.asarray(beams) * step
    slack = np.maximum(0.5 * step, 0.0025 * TURN)
    enough = np.asarray(beams) > 3
    shared = np.abs(turn - step - TURN) <= 0.5 * step
    closed = (turn >= TURN - slack) & (turn <= TURN + 0.5 * step) & ~shared
    return np.where(shared & enough, Closure.SHARED, np.where(closed & enough, Closure.CLOSED, 0)).astype(np.uint8)


LONGEST_SWEEP = 1.0
"""Longest time of a sweep [s]; a header that tells more is not believed."""


def duration(raw: RawSweeps) -> Float64 | None:
    """Return the time of sweeps (S,) from the first beam to the last [s], by their headers; None where no header tells.

    `time_increment` tells, with its sign. `scan_time` is the time between sweeps and says nothing here: where
    `time_increment` is 0, a sweep was taken at once. What is not finite, or longer than `LONGEST_SWEEP`, counts as 0.
    """
    if raw.time_increment is None:
        return None
    # A header may say anything.
    with np.errstate(invalid="ignore", over="ignore"):
        seconds = raw.time_increment.astype(np.float64) * np.maximum(raw.beams - 1, 0)
        believed = np.abs(seconds) <= LONGEST_SWEEP
    return np.where(believed, seconds, 0.0) if bool((believed & (seconds != 0.0)).any()) else None


NEAREST, FARTHEST = 1e-6, MAX_NUMBER
"""Smallest and largest range [m]: some drivers call 3.4e38 their `range_max`, and squares of that overflow."""


def normalise(raw: RawSweeps, sweep: Int64, rules: RangeRules, first_ns: int | None = None) -> SweepBatch:
    """Evaluate every range once: `RawSweeps` → `SweepBatch`.

    Parameters
    ----------
    raw : RawSweeps
    sweep : (S,) int64, index of each row within its topic
    rules : RangeRules
    first_ns : stamp of the first sweep of the topic [ns], by default that of the first of these

    Notes
    -----
    By default NaN and negative values are INVALID, +inf, 0, exactly `range_max` and anything above are NO_RETURN, and
    -inf and values below `range_min` are TOO_CLOSE. What is a range then and lies under a mask is MASKED.
    A limit that is not finite, or not above the other, is no limit; outside of `NEAREST` to `FARTHEST` there is nothing
    all the same.
    """
    rows = len(raw)
    time_ns = raw.time_ns
    if first_ns is None:
        first_ns = int(time_ns[0]) if rows else 0
    range_min, range_max = raw.range_min, raw.range_max
    if rules.limits is not None:
        range_min = np.full(rows, rules.limits[0], np.float32)
        range_max = np.full(rows, rules.limits[1], np.float32)
    clean, status = judge(raw.ranges, raw.beams, *bounds(raw, rules), rules.words)
    if rules.markers or rules.stuck:
        marked = is_marked(raw.ranges, rules) & (status != Status.PADDING.value)
        clean[marked] = np.nan
        status[marked] = Status.NO_RETURN
    if rules.masks is not None:
        masked = rules.masks.under(raw, clean)
        clean[masked] = np.nan
        status[masked] = Status.MASKED
    return SweepBatch(
        topic=raw.topic,
        frame_ids=raw.frame_ids,
        frame=raw.frame,
        sweep=sweep,
        stamp_ns=time_ns,
        record_ns=raw.record_ns,
        angle_min=raw.angle_min,
        angle_increment=raw.angle_increment,
        range_min=range_min,
        range_max=range_max,
        beams=raw.beams,
        ranges=clean,
        status=status,
        closure=closure(raw.beams, raw.angle_increment),
        observed=(status == Status.VALID.value).any(axis=1),
        duration=duration(raw),
        first_ns=first_ns,
        intensities=_measured_intensities(raw.intensities),
        run=raw.run,
    )


def is_marked(ranges: Float32, rules: RangeRules) -> Bool:
    """Return a mask (S, B) of the ranges that mean no return, whatever the limits."""
    marked = np.zeros(ranges.shape, np.bool_)
    for marker in rules.markers:
        marked |= same_range(ranges, marker)
    for beam, value in rules.stuck:
        marked[:, beam : beam + 1] |= same_range(ranges[:, beam : beam + 1], value)
    return marked


def same_range(ranges: Float32, value: float | Float32) -> Bool:
    """Return a mask of the ranges that equal a value [m], as far as float32 and decimals allow."""
    with np.errstate(invalid="ignore"):
        same: Bool = np.abs(ranges - np.float64(value)) <= _SAME
    return same


_SAME = 1e-4


def bounds(raw: RawSweeps, rules: RangeRules) -> tuple[Float32, Float32]:
    """Return the least range of each sweep (S,), and the value from which on there is none (S,) [m]."""
    least, most = raw.range_min, raw.range_max
    if rules.limits is not None:
        least, most = (np.full(len(raw), limit, np.float32) for limit in rules.limits)
    low = np.where(np.isfinite(least), np.maximum(least, NEAREST), NEAREST).astype(np.float32)
    high = np.where(np.isfinite(most) & (most > low), np.minimum(most, FARTHEST), FARTHEST)
    return low, np.minimum(high, rules.farthest).astype(np.float32)


def _measured_intensities(intensities: Float32 | None) -> Float32 | None:
    """Return intensities (S, B) with NaN in sweeps where all are 0: drivers fill in so what they do not measure."""
    if intensities is None:
        return None
    measured = ((intensities != 0) & ~np.isnan(intensities)).any(axis=1)
    if measured.all():
        return intensities
    return np.where(measured[:, None], intensities, np.float32(np.nan)) if measured.any() else None


def judge(ranges: Float32, beams: Int32, low: Float32, high: Float32, words: frozenset[str]) -> tuple[Float32, UInt8]:
    """Return the ranges (S, B), NaN where there is none, and the status of each beam (S, B).

    Parameters
    ----------
    ranges : (S, B) raw values [m]
    beams : (S,) number of values of each row, the others are padding
    low, high : (S,) limits [m]
    words : kinds of values that are no return

    Raises
    ------
    ValueError
        There are not as many beams or limits as rows, or more beams than values.
    """
    rows, width = ranges.shape
    if not (len(beams) == len(low) == len(high) == rows) or (beams < 0).any() or (beams > width).any():
        raise ValueError(f"beams and limits do not fit {rows} sweeps of up to {width} ranges")
    # Messages lie in a log as they like.
    raw = np.require(ranges, np.float32, ["C", "A"])
    clean, status = np.empty(raw.shape, np.float32), np.empty(raw.shape, np.uint8)
    if raw.size:
        verdicts = np.array([_verdict(word, words) for word in _KINDS], np.uint8)
        most = np.nextafter(high, np.float32(-np.inf)) if "max" in words else high
        lidarcli.sweeps.ranges.judge(raw, np.ascontiguousarray(beams, np.int32), low, most, high, verdicts, clean, status)
    return clean, status


_KINDS = ("nan", "inf", "-inf", "negative", "zero", "below", "max", "above", "padding")
"""Kinds of values that are no range, in the order of `ranges`."""
_VERDICTS = {"-inf": Status.TOO_CLOSE, "below": Status.TOO_CLOSE, "padding": Status.PADDING}
"""Status of such values unless they are named as no return; all others are invalid."""


def _verdict(kind: str, words: frozenset[str]) -> int:
    return Status.NO_RETURN if kind in words else _VERDICTS.get(kind, Status.INVALID)


def count_statuses(status: UInt8) -> Int32:
    """Count the beams of each row of (S, B) by `Status`, as (6, S); `ValueError` where a code is no status."""
    if status.max(initial=0) >= len(Status):
        raise ValueError(f"{status.max()} is no status of a beam")
    counts = np.zeros((len(Status), len(status)), np.int32)
    lidarcli.sweeps.ranges.count_statuses(np.ascontiguousarray(status, np.uint8), counts)
    return counts
