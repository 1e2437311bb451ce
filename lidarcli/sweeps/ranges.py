"""Loops over raw ranges: valid ones are kept, others get a status. Only `range_rules.normalise` calls them."""

from __future__ import annotations

from typing import Any

from lidarcli.system import native

NAN, INFINITY = float("nan"), float("inf")
IS_NAN, IS_INF, IS_MINUS_INF, IS_NEGATIVE, IS_ZERO, IS_BELOW, IS_MAX, IS_ABOVE, IS_PADDING = range(9)
"""Kinds of raw values that are no range; `judge` gets the status of each."""


def judge(ranges: Any, beams: Any, low: Any, most: Any, limit: Any, verdicts: Any, clean: Any, status: Any) -> None:
    """Evaluate the raw ranges of a batch of S sweeps with up to B beams.

    Parameters
    ----------
    ranges, beams : (S, B) float32 raw values [m], and (S,) int32 number of beams of each row
    low, most : (S,) float32 least and greatest range [m]
    limit : (S,) float32 range_max of the sensor [m], which may itself count as no range
    verdicts : (9,) uint8, the status of each kind of value that is no range
    clean, status : (S, B) float32 and uint8 to write to: ranges, NaN without one, and statuses, 0 for a range
    """
    rows, width = ranges.shape
    raw, counted = native.at_singles(ranges), native.at_ints(beams)
    least, greatest, limits = native.at_singles(low), native.at_singles(most), native.at_singles(limit)
    says, target, codes = native.at_bytes(verdicts), native.at_singles(clean), native.at_bytes(status)
    lock = native.release()
    for row in range(rows):
        count = min(counted[row], width)
        judge_row(raw, target, codes, row * width, count, least[row], greatest[row])
        at, end = row * width, row * width + count
        while at < end:
            last = min(at + 32, end)
            if last < at + 32 or any_of_32(codes, at):
                for k in range(at, last):
                    if codes[k]:
                        codes[k] = says[_kind(raw[k], least[row], limits[row])]
            at = last
        for k in range(row * width + count, row * width + width):
            target[k] = NAN
            codes[k] = says[IS_PADDING]
    native.resume(lock)


def judge_row(raw: Any, clean: Any, status: Any, begin: int, count: int, least: float, most: float) -> None:
    """Copy the ranges of one sweep; other values become NaN with the status 1."""
    nothing = NAN
    for k in range(begin, begin + count):
        clean[k] = raw[k] if (raw[k] >= least) & (raw[k] <= most) else nothing
    for k in range(begin, begin + count):
        status[k] = clean[k] != clean[k]


def any_of_32(codes: Any, at: int) -> bool:
    """Return whether any of the 32 codes from a place on is not 0: most are."""
    some = 0
    for k in range(32):
        some |= codes[at + k]
    return some != 0


def _kind(value: float, least: float, limit: float) -> int:
    """Return the kind of a raw value that is no range."""
    if value != value:
        return IS_NAN
    if value <= 0.0:
        if value == -INFINITY:
            return IS_MINUS_INF
        return IS_NEGATIVE if value < 0.0 else IS_ZERO
    if value < least:
        return IS_BELOW
    if value == INFINITY:
        return IS_INF
    return IS_MAX if value == limit else IS_ABOVE


def count_statuses(status: Any, counts: Any) -> None:
    """Count the beams of each row of (S, B) uint8 by status, into (6, S) int32 that are 0."""
    rows, width = status.shape
    codes, out = native.at_bytes(status), native.at_ints(counts)
    lock = native.release()
    for row in range(rows):
        at, end, zeros = row * width, (row + 1) * width, 0
        while at < end:
            last = min(at + 32, end)
            if last < at + 32 or any_of_32(codes, at):
                for k in range(at, last):
                    out[codes[k] * rows + row] += 1
            else:
                zeros += 32
            at = last
        out[row] += zeros
    native.resume(lock)
