"""Votes on the cells of the ground: bodies give them their log-odds of being things, and a body is told by its cells.

A body is in all cells that its beams end in. Beams next to each other that end in one cell are one vote.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lidarcli import native, sweeps
from lidarcli.formalism import detection
from lidarcli.formalism.mapping import rays

SURFACE, NOTHING = -1, -2
"""Beams in no body: on a surface that is too wide for one, and all others."""
MOST_VOTES = (1 << 23) - 1
"""Greatest number of votes of a cell: the sum of so many has 32 bits, each up to 256. Later ones are not heard."""


class Ends:
    """Beams of a batch of S sweeps, the bodies that they belong to, and where they end in the world."""

    def __init__(
        self,
        batch: sweeps.SweepBatch,
        found: detection.Detection,
        poses: Any,
        way: Any,
        farthest: float,
        step: float,
    ) -> None:
        """
        Parameters
        ----------
        batch : S sweeps
        found : bodies in them
        poses : (S, 4) x, y, yaw and side of the sensor at the first beam, as of `rays.place`
        way : (S, 3) way of the sensor in x, y, yaw until the last beam
        farthest : greatest range of a beam that is of use [m]
        step : greatest difference of the ranges of neighbours on one surface [m]
        """
        geometry = np.column_stack([batch.angle_min, batch.angle_increment])
        shared = bool((geometry == geometry[:1]).all())
        theta = batch.rows(np.arange(len(batch))[: 1 if shared else None]).bearings()
        columns = (
            (batch.ranges, np.float32),
            (batch.beams, np.int32),
            (np.searchsorted(found.row, np.arange(len(batch) + 1)), np.int64),
            (found.beam_i, np.int32),
            (found.beam_f, np.int32),
            (np.cos(theta), np.float64),
            (np.sin(theta), np.float64),
            (batch.angle_min, np.float64),
            (batch.angle_increment, np.float64),
            (poses, np.float64),
            (np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])]), np.float64),
            (way, np.float64),
            (way.any(axis=1), np.uint8),
        )
        self.owner: list[Any] = [np.require(values, kind, ["C", "A"]) for values, kind in columns]
        self.width = batch.width
        self.farthest = farthest
        self.step = step
        self.ranges = native.at_singles(self.owner[0])
        self.beams = native.at_ints(self.owner[1])
        self.offsets = native.at_longs(self.owner[2])
        self.beam_i = native.at_ints(self.owner[3])
        self.beam_f = native.at_ints(self.owner[4])
        self.cos = native.at_doubles(self.owner[5])
        self.sin = native.at_doubles(self.owner[6])
        self.angle_min = native.at_doubles(self.owner[7])
        self.angle_increment = native.at_doubles(self.owner[8])
        self.poses = native.at_doubles(self.owner[9])
        self.heading = native.at_doubles(self.owner[10])
        self.way = native.at_doubles(self.owner[11])
        self.going = native.at_bytes(self.owner[12])
        self.directions = 0 if shared else self.width
        """From the directions of one sweep to those of the next."""
        self.body = native.integers(self.owner, self.width)
        """Body of each beam of the sweep at hand."""


def place(ends: Ends, rows: Any, end: Any) -> None:
    """Compute the ends of the beams of some sweeps.

    Parameters
    ----------
    rows : (R,) int64 rows of the sweeps
    end : (2, R, B) float64 to write to, x and y [m]; NaN where a beam is skipped
    """
    index, out = native.at_longs(rows), native.at_doubles(end)
    _, count, width = end.shape
    lock = native.release()
    for number in range(count):
        for k in range(width):
            at = number * width + k
            out[at], out[count * width + at] = rays.NAN, rays.NAN
            if ends.ranges[index[number] * width + k] <= ends.farthest:
                out[at], out[count * width + at] = _end(ends, index[number], k)
    native.resume(lock)


def cast(
    ends: Ends,
    rows: Any,
    vote: Any,
    building: int,
    odds: Any,
    votes: Any,
    resolution: float,
    column: int,
    row: int,
) -> None:
    """Add the votes of some sweeps.

    Parameters
    ----------
    rows : (R,) int64 rows of the sweeps, of which all beams end within the cells
    vote : (K,) int64 log-odds of each body, in any unit
    building : vote of a beam on a surface without a body
    odds, votes : (H, W) int32 sum of the votes, and number of them, to be added to
    resolution : side of a cell [m]
    column, row : lower left corner of cell (0, 0), in cells from the origin of the world
    """
    across = odds.shape[1]
    index, says = native.at_longs(rows), native.at_longs(vote)
    total, heard = native.at_ints(odds), native.at_ints(votes)
    cells = 1.0 / resolution
    first = (row + rays.ORIGIN) * across + column + rays.ORIGIN
    count = len(rows)
    lock = native.release()
    for number in range(count):
        _own(ends, index[number])
        last, body = -1, NOTHING
        for k in range(ends.beams[index[number]]):
            owner = _owner(ends, index[number], k)
            if owner == NOTHING:
                continue
            x, y = _end(ends, index[number], k)
            line, along = int(y * cells + rays.ORIGIN_CELLS), int(x * cells + rays.ORIGIN_CELLS)
            cell = line * across + along - first
            if cell == last and owner == body:
                continue
            last, body = cell, owner
            if heard[cell] < MOST_VOTES:
                heard[cell] += 1
                total[cell] += says[body] if body >= 0 else building
    native.resume(lock)


def poll(
    ends: Ends,
    rows: Any,
    odds: Any,
    votes: Any,
    line: Any,
    resolution: float,
    column: int,
    row: int,
    found: Any,
) -> None:
    """Sum up what the cells of each body say, and those around them.

    Parameters
    ----------
    rows, odds, votes, resolution, column, row : as of `cast`; no cell is at the edge
    line : (H, W) uint8, 1 for a cell on a line of the map
    found : (K, 4) int64 to be added to: sum of the votes, their number, number of cells on a line, and of all cells
    """
    across = odds.shape[1]
    index, out = native.at_longs(rows), native.at_longs(found)
    total, heard, on_line = native.at_ints(odds), native.at_ints(votes), native.at_bytes(line)
    cells = 1.0 / resolution
    first = (row + rays.ORIGIN) * across + column + rays.ORIGIN
    count = len(rows)
    lock = native.release()
    for number in range(count):
        _own(ends, index[number])
        last, body = -1, NOTHING
        for k in range(ends.beams[index[number]]):
            owner = ends.body[k]
            if owner < 0 or not ends.ranges[index[number] * ends.width + k] <= ends.farthest:
                continue
            x, y = _end(ends, index[number], k)
            high, along = int(y * cells + rays.ORIGIN_CELLS), int(x * cells + rays.ORIGIN_CELLS)
            cell = high * across + along - first
            if cell == last and owner == body:
                continue
            last, body = cell, owner
            for beside in range(9):
                near = cell + (beside // 3 - 1) * across + beside % 3 - 1
                out[4 * body] += total[near]
                out[4 * body + 1] += heard[near]
            out[4 * body + 2] += on_line[cell]
            out[4 * body + 3] += 1
    native.resume(lock)


def _own(ends: Ends, sweep: int) -> None:
    """Fill in the body of every beam of a sweep; where one lies within another, it has its own beams."""
    count = ends.beams[sweep]
    for k in range(count):
        ends.body[k] = NOTHING
    for body in range(ends.offsets[sweep], ends.offsets[sweep + 1]):
        k = ends.beam_i[body]
        for _ in range(count):
            ends.body[k] = body
            if k == ends.beam_f[body]:
                break
            k = k + 1 if k + 1 < count else 0


def _owner(ends: Ends, sweep: int, k: int) -> int:
    """Return the body of a beam, or `SURFACE` if both of its neighbours are, too: scraps of one or two beams are not.

    A beam that goes too far is of no use, whatever it hits.
    """
    at = sweep * ends.width + k
    if not ends.ranges[at] <= ends.farthest:
        return NOTHING
    if ends.body[k] >= 0:
        return ends.body[k]
    if (
        0 < k < ends.beams[sweep] - 1
        and ends.body[k - 1] < 0
        and ends.body[k + 1] < 0
        and abs(ends.ranges[at] - ends.ranges[at - 1]) < ends.step
        and abs(ends.ranges[at + 1] - ends.ranges[at]) < ends.step
    ):
        return SURFACE
    return NOTHING


def _end(ends: Ends, sweep: int, k: int) -> tuple[float, float]:
    """Return where a beam ends in the world, seen from the pose of the sensor at its own time [m]."""
    r = ends.ranges[sweep * ends.width + k] * 1.0
    x, y, side = ends.poses[4 * sweep], ends.poses[4 * sweep + 1], ends.poses[4 * sweep + 3]
    if ends.going[sweep]:
        share = k / (1.0 * max(ends.beams[sweep] - 1, 1))
        theta = ends.poses[4 * sweep + 2] + share * ends.way[3 * sweep + 2]
        theta += side * (ends.angle_min[sweep] + ends.angle_increment[sweep] * k)
        x, y = x + share * ends.way[3 * sweep], y + share * ends.way[3 * sweep + 1]
        return x + r * math.cos(theta), y + r * math.sin(theta)
    at = sweep * ends.directions + k
    ahead, left = r * ends.cos[at], r * (side * ends.sin[at])
    cos, sin = ends.heading[2 * sweep], ends.heading[2 * sweep + 1]
    return x + (cos * ahead - sin * left), y + (sin * ahead + cos * left)
