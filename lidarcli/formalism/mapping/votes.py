"""Votes on the cells of the ground: bodies give them their log-odds of being things, and a body is told by its cells.

A body is in all cells that its beams end in. Beams next to each other that end in one cell are one vote.
"""

from __future__ import annotations

from typing import Any

from lidarcli import native
from lidarcli.formalism.mapping import rays

SURFACE, NOTHING = -1, -2
"""Beams in no body: on a surface that is too wide for one, and all others."""


def own(
    ranges: Any, beams: Any, first: Any, stop: Any, beam_i: Any, beam_f: Any, step: float, owner: Any
) -> None:
    """Fill in the body of every beam of S sweeps; where one lies within another, it has its own beams.

    A beam without a body is on a surface if both of its neighbours are, too: scraps of one or two beams are not.

    Parameters
    ----------
    ranges : (S, B) float32 [m]
    beams : (S,) int32 number of beams of each sweep
    first, stop : (S,) int64 numbers of the first body of each sweep and of the first one after it
    beam_i, beam_f : (K,) int32 first and last beam of each body
    step : greatest difference of the ranges of neighbours on one surface [m]
    owner : (S, B) int64 to write to, `SURFACE` or `NOTHING` for no body
    """
    rows, width = ranges.shape
    r = native.at_singles(ranges)
    counted, begin, end = native.at_ints(beams), native.at_longs(first), native.at_longs(stop)
    one, other, out = native.at_ints(beam_i), native.at_ints(beam_f), native.at_longs(owner)
    lock = native.release()
    for row in range(rows):
        at = row * width
        for k in range(width):
            out[at + k] = NOTHING
        for body in range(begin[row], end[row]):
            k = one[body]
            for _ in range(counted[row]):
                out[at + k] = body
                if k == other[body]:
                    break
                k = k + 1 if k + 1 < counted[row] else 0
        for k in range(at + 1, at + counted[row] - 1):
            if (
                out[k] < 0
                and out[k - 1] < 0
                and out[k + 1] < 0
                and abs(r[k] - r[k - 1]) < step
                and abs(r[k + 1] - r[k]) < step
            ):
                out[k] = SURFACE
    native.resume(lock)


def cast(
    end: Any,
    owner: Any,
    vote: Any,
    building: int,
    odds: Any,
    votes: Any,
    resolution: float,
    column: int,
    row: int,
) -> None:
    """Add the votes of S sweeps.

    Parameters
    ----------
    end : (2, S, B) ends of the beams [m], all within the cells; NaN for a beam that is skipped
    owner : (S, B) as of `own`
    vote : (K,) int64 log-odds of each body, in any unit
    building : vote of a beam on a surface without a body
    odds, votes : (H, W) int64 sum of the votes, and int32 number of them, to be added to
    resolution : side of a cell [m]
    column, row : lower left corner of cell (0, 0), in cells from the origin of the world
    """
    _, sweeps, width = end.shape
    across = odds.shape[1]
    ends, owned, says = native.at_doubles(end), native.at_longs(owner), native.at_longs(vote)
    total, count = native.at_longs(odds), native.at_ints(votes)
    cells = 1.0 / resolution
    column, row = column + rays.ORIGIN, row + rays.ORIGIN
    lock = native.release()
    for sweep in range(sweeps):
        last, body = -1, -1
        for k in range(sweep * width, sweep * width + width):
            if owned[k] == NOTHING or ends[k] != ends[k]:
                continue
            along = int(ends[k] * cells + rays.ORIGIN_CELLS)
            line = int(ends[sweeps * width + k] * cells + rays.ORIGIN_CELLS)
            cell = (line - row) * across + along - column
            if cell == last and owned[k] == body:
                continue
            last, body = cell, owned[k]
            total[cell] += says[body] if body >= 0 else building
            count[cell] += 1
    native.resume(lock)


def poll(
    end: Any,
    owner: Any,
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
    end, owner, odds, votes, resolution, column, row : as of `cast`; no cell is at the edge
    line : (H, W) uint8, 1 for a cell on a line of the map
    found : (K, 4) int64 to be added to: sum of the votes, their number, number of cells on a line, and of all cells
    """
    _, sweeps, width = end.shape
    across = odds.shape[1]
    ends, owned, out = native.at_doubles(end), native.at_longs(owner), native.at_longs(found)
    total, count, on_line = native.at_longs(odds), native.at_ints(votes), native.at_bytes(line)
    cells = 1.0 / resolution
    column, row = column + rays.ORIGIN, row + rays.ORIGIN
    lock = native.release()
    for sweep in range(sweeps):
        last, body = -1, -1
        for k in range(sweep * width, sweep * width + width):
            if owned[k] < 0 or ends[k] != ends[k]:
                continue
            along = int(ends[k] * cells + rays.ORIGIN_CELLS)
            high = int(ends[sweeps * width + k] * cells + rays.ORIGIN_CELLS)
            cell = (high - row) * across + along - column
            if cell == last and owned[k] == body:
                continue
            last, body = cell, owned[k]
            for beside in range(-1, 2):
                near = cell + beside * across
                out[4 * body] += total[near - 1] + total[near] + total[near + 1]
                out[4 * body + 1] += count[near - 1] + count[near] + count[near + 1]
            out[4 * body + 2] += on_line[cell]
            out[4 * body + 3] += 1
    native.resume(lock)
