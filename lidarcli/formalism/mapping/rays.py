"""Fig. 7: the ends of beams in the world, the cells that they pass, and the votes of bodies on the cells that they cover.

A cell counts once in a sweep: as hit where any beam ends in it, else as passed where any goes through it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lidarcli.formalism import detection, segmentation
from lidarcli.sweeps import types
from lidarcli.system import native

NAN = float("nan")
USES = 0, 1, 2
"""Uses of a beam: none, it ended in a cell, or it only passed cells."""
SKIPPED, HIT, _ = USES
ORIGIN = 1 << 33
"""Column and row of the origin of the world, in cells from a corner far outside."""
ORIGIN_CELLS = float(ORIGIN)


def place(ranges: Any, use: Any, beams: Any, angle_min: Any, angle_increment: Any, poses: Any, way: Any, end: Any) -> None:
    """Compute the ends of the beams of S sweeps, each from the pose of the sensor at its own time.

    Parameters
    ----------
    ranges, use : (S, B) float32 [m], and uint8 use of each beam (`grid.HIT`)
    beams : (S,) int32 number of beams of each sweep
    angle_min, angle_increment : (S,) float64 [rad]
    poses : (S, 4) float64 x, y, yaw and side of the sensor at the first beam, the side -1 where it hangs head down
    way : (S, 3) float64 way of the sensor in x, y, yaw until the last beam
    end : (2, S, B) float64 to write to, x and y [m]; NaN where a beam is skipped
    """
    rows, width = ranges.shape
    r, used_as, counted = native.at_singles(ranges), native.at_bytes(use), native.at_ints(beams)
    first, step = native.at_doubles(angle_min), native.at_doubles(angle_increment)
    pose, going, out = native.at_doubles(poses), native.at_doubles(way), native.at_doubles(end)
    lock = native.release()
    for row in range(rows):
        last = max(counted[row] - 1, 1)
        for k in range(width):
            at = row * width + k
            out[at] = out[rows * width + at] = NAN
            if used_as[at] == SKIPPED or r[at] != r[at]:
                continue
            share = k / (1.0 * last)
            theta = pose[4 * row + 2] + share * going[3 * row + 2]
            theta += pose[4 * row + 3] * (first[row] + step[row] * k)
            out[at] = pose[4 * row] + share * going[3 * row] + r[at] * math.cos(theta)
            out[rows * width + at] = pose[4 * row + 1] + share * going[3 * row + 1] + r[at] * math.sin(theta)
    native.resume(lock)


def trace(beams_of: Any, layers: Any, stamp: int, resolution: float, column: int, row: int) -> None:
    """Count the cells that the beams of S sweeps hit and pass.

    Parameters
    ----------
    beams_of : `end` (2, S, B), `use`, `beams`, `poses`, `way` as in `place`; all ends and poses lie within the cells
    layers : (H, W) int32 each: hits and passes, to be added to, and the last sweep that counted for each cell
    stamp : of the first of these sweeps, greater than all before; each has the next one
    resolution : side of a cell [m]
    column, row : lower left corner of cell (0, 0), in cells from the origin of the world
    """
    end, use, beams, poses, way = beams_of
    hits, passes, stamps = layers
    _, sweeps, width = end.shape
    across = hits.shape[1]
    ends, used_as, counted = native.at_doubles(end), native.at_bytes(use), native.at_ints(beams)
    pose, going = native.at_doubles(poses), native.at_doubles(way)
    hit, passed, stamped = native.at_ints(hits), native.at_ints(passes), native.at_ints(stamps)
    cells = 1.0 / resolution
    # Places are measured in cells from a corner far outside, so that the cell of a place depends on nothing else.
    column, row = column + ORIGIN, row + ORIGIN
    lock = native.release()
    for sweep in range(sweeps):
        begin = sweep * width
        for k in range(begin, begin + width):
            if used_as[k] == HIT and ends[k] == ends[k]:
                along, line = (int(ends[k] * cells + ORIGIN_CELLS), int(ends[sweeps * width + k] * cells + ORIGIN_CELLS))
                cell = (line - row) * across + along - column
                if stamped[cell] != stamp + sweep:
                    stamped[cell] = stamp + sweep
                    hit[cell] += 1
        last = max(counted[sweep] - 1, 1)
        for k in range(width):
            at = begin + k
            if used_as[at] == SKIPPED or ends[at] != ends[at]:
                continue
            share = k / (1.0 * last)
            x = (pose[4 * sweep] + share * going[3 * sweep]) * cells + ORIGIN_CELLS
            y = (pose[4 * sweep + 1] + share * going[3 * sweep + 1]) * cells + ORIGIN_CELLS
            to_x, to_y = ends[at] * cells + ORIGIN_CELLS, ends[sweeps * width + at] * cells + ORIGIN_CELLS
            _pass(passed, stamped, stamp + sweep, across, row * across + column, x, y, to_x, to_y)
    native.resume(lock)


def _pass(
    passed: Any, stamped: Any, stamp: int, across: int, first: int, x: float, y: float, to_x: float, to_y: float
) -> None:
    """Count the cells along a straight way without the last one, one in each column or row of its longer axis."""
    dx, dy = to_x - x, to_y - y
    column, line = int(x), int(y)
    if abs(dx) >= abs(dy):
        slope, steps = dy / dx if dx != 0.0 else 0.0, int(to_x)
        steps -= column
        step = 1 if steps > 0 else -1
        for _ in range(max(step * steps, 1)):
            line = int(y + (column + 0.5 - x) * slope)
            _count(passed, stamped, stamp, line * across + column - first)
            column += step
    else:
        slope, steps = dx / dy, int(to_y)
        steps -= line
        step = 1 if steps > 0 else -1
        for _ in range(max(step * steps, 1)):
            column = int(x + (line + 0.5 - y) * slope)
            _count(passed, stamped, stamp, line * across + column - first)
            line += step


def _count(passed: Any, stamped: Any, stamp: int, cell: int) -> None:
    """Count a cell that was passed, unless this sweep has counted it already."""
    if stamped[cell] != stamp:
        stamped[cell] = stamp
        passed[cell] += 1


# Votes on the cells of the map: bodies give them their log-odds of being objects, and a body is recognised by its cells. A
# body is in all cells that its beams end in. Beams next to each other that end in one cell are one vote.

NO_BODY = -1
"""Body of a beam that is in none."""
COUNT_BITS = 27
"""Bits of a cell for the number of its votes; those above hold their sum: room for 2 ** 27 votes of up to 256."""


class Ends:
    """Beams of a batch of S sweeps, the bodies that they belong to, and where they end in the world."""

    def __init__(
        self, batch: types.SweepBatch, found: detection.Detection, poses: Any, way: Any, farthest: float, step: float
    ) -> None:
        """`poses` (S, 4) and `way` (S, 3) as of `place`; beams of use end within `farthest` [m], and neighbours on one
        surface have ranges that differ by less than `step` [m].
        """
        geometry = np.column_stack([batch.angle_min, batch.angle_increment])
        shared = bool((geometry == geometry[:1]).all())
        theta = batch.rows(np.arange(len(batch))[: 1 if shared else None]).bearings
        self.owner: list[Any] = []
        self.width = batch.width
        self.farthest = farthest
        self.step = step
        self.ranges = native.at_singles(segmentation.kept(self.owner, batch.ranges, np.float32))
        self.beams = native.at_ints(segmentation.kept(self.owner, batch.beams, np.int32))
        self.offsets = native.at_longs(
            segmentation.kept(self.owner, np.searchsorted(found.row, np.arange(len(batch) + 1)), np.int64)
        )
        self.beam_i = native.at_ints(segmentation.kept(self.owner, found.beam_i, np.int32))
        self.beam_f = native.at_ints(segmentation.kept(self.owner, found.beam_f, np.int32))
        self.cos = native.at_doubles(segmentation.kept(self.owner, np.cos(theta), np.float64))
        self.sin = native.at_doubles(segmentation.kept(self.owner, np.sin(theta), np.float64))
        self.angle_min = native.at_doubles(segmentation.kept(self.owner, batch.angle_min, np.float64))
        self.angle_increment = native.at_doubles(segmentation.kept(self.owner, batch.angle_increment, np.float64))
        self.poses = native.at_doubles(segmentation.kept(self.owner, poses, np.float64))
        self.heading = native.at_doubles(
            segmentation.kept(self.owner, np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])]), np.float64)
        )
        self.way = native.at_doubles(segmentation.kept(self.owner, way, np.float64))
        self.going = native.at_bytes(segmentation.kept(self.owner, way.any(axis=1), np.uint8))
        self.directions = 0 if shared else self.width
        """From the directions of one sweep to those of the next."""
        self.body = native.integers(self.owner, self.width)
        """Body of each beam of the sweep at hand; where a body lies within another, it has its own beams."""
        self.beam = native.integers(self.owner, self.width)
        """Beams of the sweep at hand that are of use, and where they end [m]:"""
        self.x = native.doubles(self.owner, self.width)
        self.y = native.doubles(self.owner, self.width)


def cast(ends: Ends, rows: Any, vote: Any, building: int, votes: Any, resolution: float, column: int, row: int) -> None:
    """Add the votes of some sweeps.

    Parameters
    ----------
    rows : (R,) int64 rows of the sweeps, of which all beams end within the cells
    vote : (K,) int64 log-odds of each body, in any unit
    building : vote of a beam on a surface without a body
    votes : (H, W) int64 sum of the votes times 2 ** `COUNT_BITS`, and number of them, to be added to
    resolution : side of a cell [m]
    column, row : lower left corner of cell (0, 0), in cells from the origin of the world
    """
    across = votes.shape[1]
    index, votes_of = native.at_longs(rows), native.at_longs(vote)
    sums = native.at_longs(votes)
    cells = 1.0 / resolution
    first = (row + ORIGIN) * across + column + ORIGIN
    count = len(rows)
    lock = native.release()
    for number in range(count):
        last, body = -1, NO_BODY
        for k in range(_use(ends, index[number], True)):
            cell, owner = _cell(ends, k, cells, across) - first, ends.body[ends.beam[k]]
            # Without a branch, as nobody can foresee which beam is the first in its cell.
            is_new = (cell != last) | (owner != body)
            last, body = cell, owner
            sums[cell] += is_new * ((votes_of[owner] if owner >= 0 else building) * (1 << COUNT_BITS) + 1)
    native.resume(lock)


def poll(ends: Ends, rows: Any, votes: Any, resolution: float, column: int, row: int, found: Any) -> None:
    """Add what the cells of each body say, and those around them, to `found`.

    As of `cast`, but no cell is at the edge; `found` (K, 2) int64: sum of the votes, and their number.
    """
    across = votes.shape[1]
    index, out = native.at_longs(rows), native.at_longs(found)
    sums = native.at_longs(votes)
    cells = 1.0 / resolution
    first = (row + ORIGIN) * across + column + ORIGIN
    count = len(rows)
    lock = native.release()
    for number in range(count):
        last, body = -1, NO_BODY
        for k in range(_use(ends, index[number], False)):
            cell, owner = _cell(ends, k, cells, across) - first, ends.body[ends.beam[k]]
            if cell == last and owner == body:
                continue
            last, body, total = cell, owner, 0
            for line_step in range(-1, 2):
                near = cell + line_step * across
                total += sums[near - 1] + sums[near] + sums[near + 1]
            out[2 * body] += total >> COUNT_BITS
            out[2 * body + 1] += total & ((1 << COUNT_BITS) - 1)
    native.resume(lock)


def _use(ends: Ends, sweep: int, surfaces: bool) -> int:
    """List the beams of a sweep that are of use, those of bodies and perhaps on surfaces, and return their number.

    A beam without a body is on a surface if both of its neighbours are, too: scraps of one or two beams are not.
    """
    count, first, used = ends.beams[sweep], sweep * ends.width, 0
    for k in range(count):
        ends.body[k] = NO_BODY
    for body in range(ends.offsets[sweep], ends.offsets[sweep + 1]):
        k = ends.beam_i[body]
        for _ in range(count):
            ends.body[k] = body
            if k == ends.beam_f[body]:
                break
            k = k + 1 if k + 1 < count else 0
    goes_on, is_next_free = False, surfaces and count > 0 and ends.body[0] == NO_BODY
    for k in range(count):
        at, came, is_free = first + k, goes_on, is_next_free
        is_next_free = surfaces and k + 1 < count and ends.body[k + 1] == NO_BODY
        goes_on = is_free and is_next_free and abs(ends.ranges[at + 1] - ends.ranges[at]) < ends.step
        ends.beam[used] = k
        used += (ends.ranges[at] <= ends.farthest) & ((ends.body[k] >= 0) | (came & goes_on))
    _lay(ends, sweep, used)
    return used


def _lay(ends: Ends, sweep: int, used: int) -> None:
    """Compute where the beams of use end, each observed from the pose of the sensor at its own time."""
    x, y = ends.poses[4 * sweep], ends.poses[4 * sweep + 1]
    yaw, side = ends.poses[4 * sweep + 2], ends.poses[4 * sweep + 3]
    first = sweep * ends.width
    if not ends.going[sweep]:
        cos, sin, at = ends.heading[2 * sweep], ends.heading[2 * sweep + 1], sweep * ends.directions
        for k in range(used):
            beam = ends.beam[k]
            ahead = ends.ranges[first + beam] * ends.cos[at + beam]
            left = ends.ranges[first + beam] * (side * ends.sin[at + beam])
            ends.x[k] = x + (cos * ahead - sin * left)
            ends.y[k] = y + (sin * ahead + cos * left)
        return
    last = 1.0 * max(ends.beams[sweep] - 1, 1)
    for k in range(used):
        beam = ends.beam[k]
        share = beam / last
        theta = yaw + share * ends.way[3 * sweep + 2]
        theta += side * (ends.angle_min[sweep] + ends.angle_increment[sweep] * beam)
        r = ends.ranges[first + beam]
        ends.x[k] = x + share * ends.way[3 * sweep] + r * math.cos(theta)
        ends.y[k] = y + share * ends.way[3 * sweep + 1] + r * math.sin(theta)


def _cell(ends: Ends, k: int, cells: float, across: int) -> int:
    """Return the number of the cell of an end, from a corner far outside: `cells` are a metre, `across` a row."""
    line, along = int(ends.y[k] * cells + ORIGIN_CELLS), int(ends.x[k] * cells + ORIGIN_CELLS)
    return line * across + along
