"""Fig. 7: the ends of beams in the world, and the cells that they pass on their way.

A cell counts once in a sweep: as hit where any beam ends in it, else as passed where any goes through it.
"""

from __future__ import annotations

import math
from typing import Any

from lidarcli import native
from lidarcli.formalism.mapping.occupancy import HIT, SKIPPED

NAN = float("nan")
ORIGIN = 1 << 33
"""Column and row of the origin of the world, in cells from a corner far outside."""
ORIGIN_CELLS = float(ORIGIN)


def place(ranges: Any, use: Any, beams: Any, angle_min: Any, angle_increment: Any, poses: Any, way: Any, end: Any) -> None:
    """Compute the ends of the beams of S sweeps, each from the pose of the sensor at its own time.

    Parameters
    ----------
    ranges, use : (S, B) float32 [m], and uint8 use of each beam (`occupancy.HIT`)
    beams : (S,) int32 number of beams of each sweep
    angle_min, angle_increment : (S,) float64 [rad]
    poses : (S, 4) float64 x, y, yaw and side of the sensor at the first beam, the side -1 where it hangs head down
    way : (S, 3) float64 way of the sensor in x, y, yaw until the last beam
    end : (2, S, B) float64 to write to, x and y [m]; NaN where a beam is skipped
    """
    rows, width = ranges.shape
    r, says, counted = native.at_singles(ranges), native.at_bytes(use), native.at_ints(beams)
    first, step = native.at_doubles(angle_min), native.at_doubles(angle_increment)
    pose, going, out = native.at_doubles(poses), native.at_doubles(way), native.at_doubles(end)
    lock = native.release()
    for row in range(rows):
        last = max(counted[row] - 1, 1)
        for k in range(width):
            at = row * width + k
            out[at] = out[rows * width + at] = NAN
            if says[at] == SKIPPED or r[at] != r[at]:
                continue
            share = k / (1.0 * last)
            theta = pose[4 * row + 2] + share * going[3 * row + 2]
            theta += pose[4 * row + 3] * (first[row] + step[row] * k)
            out[at] = pose[4 * row] + share * going[3 * row] + r[at] * math.cos(theta)
            out[rows * width + at] = pose[4 * row + 1] + share * going[3 * row + 1] + r[at] * math.sin(theta)
    native.resume(lock)


def trace(
    end: Any,
    use: Any,
    beams: Any,
    poses: Any,
    way: Any,
    hits: Any,
    passes: Any,
    stamps: Any,
    stamp: int,
    resolution: float,
    column: int,
    row: int,
) -> None:
    """Count the cells that the beams of S sweeps hit and pass.

    Parameters
    ----------
    end : (2, S, B) as in `place`; all ends and poses lie within the cells
    use, beams, poses, way : as in `place`
    hits, passes : (H, W) int32, to be added to
    stamps : (H, W) int32, the last sweep that counted for each cell
    stamp : of the first of these sweeps, greater than all before; each has the next one
    resolution : side of a cell [m]
    column, row : lower left corner of cell (0, 0), in cells from the origin of the world
    """
    _, sweeps, width = end.shape
    across = hits.shape[1]
    ends, says, counted = native.at_doubles(end), native.at_bytes(use), native.at_ints(beams)
    pose, going = native.at_doubles(poses), native.at_doubles(way)
    hit, passed, seen = native.at_ints(hits), native.at_ints(passes), native.at_ints(stamps)
    cells = 1.0 / resolution
    # Places are measured in cells from a corner far outside, so that the cell of a place depends on nothing else.
    column, row = column + ORIGIN, row + ORIGIN
    lock = native.release()
    for sweep in range(sweeps):
        begin = sweep * width
        for k in range(begin, begin + width):
            if says[k] == HIT and ends[k] == ends[k]:
                along, line = (int(ends[k] * cells + ORIGIN_CELLS), int(ends[sweeps * width + k] * cells + ORIGIN_CELLS))
                cell = (line - row) * across + along - column
                if seen[cell] != stamp + sweep:
                    seen[cell] = stamp + sweep
                    hit[cell] += 1
        last = max(counted[sweep] - 1, 1)
        for k in range(width):
            at = begin + k
            if says[at] == SKIPPED or ends[at] != ends[at]:
                continue
            share = k / (1.0 * last)
            x = (pose[4 * sweep] + share * going[3 * sweep]) * cells + ORIGIN_CELLS
            y = (pose[4 * sweep + 1] + share * going[3 * sweep + 1]) * cells + ORIGIN_CELLS
            to_x, to_y = ends[at] * cells + ORIGIN_CELLS, ends[sweeps * width + at] * cells + ORIGIN_CELLS
            _pass(passed, seen, stamp + sweep, across, row * across + column, x, y, to_x, to_y)
    native.resume(lock)


def _pass(
    passed: Any, seen: Any, stamp: int, across: int, first: int, x: float, y: float, to_x: float, to_y: float
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
            _count(passed, seen, stamp, line * across + column - first)
            column += step
    else:
        slope, steps = dx / dy, int(to_y)
        steps -= line
        step = 1 if steps > 0 else -1
        for _ in range(max(step * steps, 1)):
            column = int(x + (line + 0.5 - y) * slope)
            _count(passed, seen, stamp, line * across + column - first)
            line += step


def _count(passed: Any, seen: Any, stamp: int, cell: int) -> None:
    """Count a cell that was passed, unless this sweep has counted it already."""
    if seen[cell] != stamp:
        seen[cell] = stamp
        passed[cell] += 1
