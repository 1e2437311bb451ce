"""The agreement of the sweeps of a run with one static world under a path: a number that tells how good the path is.

What one part of the run hits, the other parts confirm or deny: they hit there as well, or look through it. Parts soon
after each other (near) tell of steps and jitter, parts far apart in time (far) of drift, jumps and resets.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from lidarcli.sweeps.types import Float64, Int64
from lidarcli.system import native

NAN = float("nan")
CELL = 0.05
"""Side of the cells in which hits are compared [m]."""
MIN_RANGE, MAX_RANGE = 0.15, 12.0
"""Ranges that are compared [m]: those of far walls tell the heading alone."""
BEFORE_HIT, BEFORE_HIT_GROWS = 0.3, 0.02
"""A beam denies nothing in its last piece of this length [m], and this share of its range more; nor in its first."""
STEP = 0.075
"""A beam is looked along in steps of this length [m]."""
NEAR = 2
"""Parts of the run that are at most so many apart are near."""
MIN_HITS = 50
"""Fewer hits that others confirm or deny tell nothing."""
FARTHEST = 1e8
"""Poses beyond this are none [m]."""
BITS = 60
"""Parts of the run of which one number holds a bit each."""
COLUMN = 1 << 31
"""Cells in a column of the plane, more than `FARTHEST` takes."""


class Agreement(NamedTuple):
    """Mean share, over hits, of the other parts of the run that confirm a hit, of those that confirm or deny it."""

    near: float
    """By parts soon before and after; NaN where too few hits have any."""
    far: float
    """By parts far apart: places that are visible again."""
    all: float
    again: float
    """Share of the hits that are confirmed or denied from afar."""
    placed: float
    """Share of the sweeps that have a pose."""


class Marks:
    """Cells that are hit, and the parts of the run that hit them, or look through them."""

    def __init__(self, hits: int, parts: int) -> None:
        self.owner: list[Any] = []
        size = 64
        while size < 3 * hits:
            size *= 2
        self.size, self.words, self.cells = size, parts // BITS + 1, 0
        self.keys = native.integers(self.owner, size)
        """Key of a cell plus 1; 0 where there is none."""
        self.number = native.integers(self.owner, size)
        self.confirmed = native.integers(self.owner, hits * self.words)
        self.denied = native.integers(self.owner, hits * self.words)


def agreement(
    ranges: Any, angle_min: Float64, angle_increment: Float64, poses: Float64, motion: Float64, part: Int64
) -> Agreement:
    """Measure how well sweeps agree with one static world under a path.

    Parameters
    ----------
    ranges : (S, B) of evenly chosen sweeps [m], NaN without a return
    angle_min, angle_increment : (S,) bearing of the first beam, and from beam to beam [rad]
    poses : (S, 3) x, y [m] and yaw [rad] of the sensor at the first beam, NaN without a pose
    motion : (S, 3) how these change until the last beam
    part : (S,) number of the part of the run

    Returns
    -------
    The agreement; NaN where fewer than `MIN_HITS` hits can be compared.
    """
    known = np.isfinite(poses).all(axis=1) & (np.abs(poses) < FARTHEST).all(axis=1)
    placed = float(known.mean()) if len(part) else 0.0
    poses, part = np.ascontiguousarray(poses[known], np.float64), part[known]
    if not len(part):
        return Agreement(NAN, NAN, NAN, 0.0, placed)
    used = np.asarray(ranges[known], np.float64)
    used = np.ascontiguousarray(np.where((used > MIN_RANGE) & (used < MAX_RANGE), used, 0.0))
    low = poses[:, :2].min(axis=0) - 2.0 * MAX_RANGE - CELL
    poses[:, :2] -= low
    numbers = np.ascontiguousarray(part - part.min(), np.int64)
    sums = np.zeros(7)
    count(
        used,
        np.ascontiguousarray(angle_min[known], np.float64),
        np.ascontiguousarray(angle_increment[known], np.float64),
        poses,
        np.ascontiguousarray(np.clip(np.nan_to_num(motion[known]), -MAX_RANGE, MAX_RANGE), np.float64),
        numbers,
        Marks(int(np.count_nonzero(used)), int(numbers.max()) + 1),
        sums,
    )
    near, far, every = (total / hits if hits > MIN_HITS else NAN for total, hits in sums[:6].reshape(3, 2).tolist())
    return Agreement(near, far, every, float(sums[3] / max(sums[6], 1.0)), placed)


def count(ranges: Any, first: Any, step: Any, poses: Any, motion: Any, part: Any, marks: Marks, sums: Any) -> None:
    """Write to `sums` (7,) the shares of confirmed hits and their number: near, far, all; and the number of hits.

    `ranges` (S, B) are 0 where nothing is compared, places (S, 3) are not negative, parts (S,) are not negative.
    """
    sweeps, beams = ranges.shape
    r, angle, increment = native.at_doubles(ranges), native.at_doubles(first), native.at_doubles(step)
    pose, moved = native.at_doubles(poses), native.at_doubles(motion)
    parts, out = native.at_longs(part), native.at_doubles(sums)
    share = 1.0 / (beams - 1.0) if beams > 1 else 0.0
    lock = native.release()
    for turn in range(3):
        for s in range(sweeps):
            word, bit = parts[s] // BITS, bit_of(parts[s] % BITS)
            for b in range(beams):
                reach = r[s * beams + b]
                if reach == 0.0:
                    continue
                late = share * b
                x, y = pose[3 * s] + late * moved[3 * s], pose[3 * s + 1] + late * moved[3 * s + 1]
                bearing = pose[3 * s + 2] + late * moved[3 * s + 2] + angle[s] + increment[s] * b
                cos, sin = math.cos(bearing), math.sin(bearing)
                key = key_of(x + reach * cos, y + reach * sin)
                if turn == 0:
                    add_cell(marks, key)
                elif turn == 1:
                    mark_beam(marks, x, y, cos, sin, reach, word, bit)
                else:
                    compare(marks, cell_at(marks, key) * marks.words, parts[s], out)
    native.resume(lock)


def key_of(x: float, y: float) -> int:
    """Return the key of the cell at a place, of which neither coordinate is negative."""
    column, row = int(x / CELL), int(y / CELL)
    return column * COLUMN + row + 1


def slot_of(marks: Marks, key: int) -> int:
    """Return where a key is kept, or would be."""
    slot = (key // COLUMN * 7919 + key % COLUMN * 40503) & (marks.size - 1)
    while marks.keys[slot] != 0 and marks.keys[slot] != key:
        slot = (slot + 1) & (marks.size - 1)
    return slot


def add_cell(marks: Marks, key: int) -> None:
    """Take a cell that is hit."""
    slot = slot_of(marks, key)
    if marks.keys[slot] == 0:
        marks.keys[slot], marks.number[slot] = key, marks.cells
        marks.cells += 1


def cell_at(marks: Marks, key: int) -> int:
    """Return the number of a cell, -1 of one that is never hit."""
    slot = slot_of(marks, key)
    return marks.number[slot] if marks.keys[slot] != 0 else -1


def bit_of(number: int) -> int:
    """Return a number with one bit."""
    one = 1
    return one << number


def mark_beam(marks: Marks, x: float, y: float, cos: float, sin: float, reach: float, word: int, bit: int) -> None:
    """Let a beam confirm the cells around its end, and deny those that it passes."""
    key = key_of(x + reach * cos, y + reach * sin)
    for k in range(9):
        cell = cell_at(marks, key + (k // 3 - 1) * COLUMN + k % 3 - 1)
        if cell >= 0:
            marks.confirmed[cell * marks.words + word] |= bit
    end = reach * (1.0 - BEFORE_HIT_GROWS) - BEFORE_HIT
    at = BEFORE_HIT
    while at <= end:
        cell = cell_at(marks, key_of(x + at * cos, y + at * sin))
        if cell >= 0:
            marks.denied[cell * marks.words + word] |= bit
        at += STEP


def compare(marks: Marks, at: int, part: int, out: Any) -> None:
    """Add what the other parts of the run say of a hit in a cell."""
    confirmed, denied, near_confirmed, near_denied = 0, 0, 0, 0
    for k in range(marks.words):
        confirmed += ones(marks.confirmed[at + k])
        denied += ones(marks.denied[at + k])
    for other in range(max(part - NEAR, 0), min(part + NEAR + 1, marks.words * BITS)):
        word = at + other // BITS
        is_confirmed = (marks.confirmed[word] >> (other % BITS)) & 1
        is_denied = (marks.denied[word] >> (other % BITS)) & 1
        if other == part:
            confirmed -= is_confirmed
            denied -= is_denied
        else:
            near_confirmed += is_confirmed
            near_denied += is_denied
    add_share(out, 0, near_confirmed, near_denied)
    add_share(out, 2, confirmed - near_confirmed, denied - near_denied)
    add_share(out, 4, confirmed, denied)
    out[6] += 1.0


def add_share(out: Any, at: int, confirmed: int, denied: int) -> None:
    """Add the share of those who confirm a hit, where there are any with an opinion."""
    if confirmed + denied > 0:
        out[at] += 1.0 * confirmed / (confirmed + denied)
        out[at + 1] += 1.0


def ones(number: int) -> int:
    """Return the number of bits that are 1."""
    found = 0
    while number:
        number &= number - 1
        found += 1
    return found
