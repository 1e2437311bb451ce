"""Sweeps against a map: how many of their beams it explains, and the correction of the pose that would explain more.

A window is half a second of sweeps, laid out as one body by the told poses. On the distances to the occupied cells of the
map it climbs from the told place; where the map explains little of it, places around are tried, too.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from lidarcli.formalism.mapping import grid as grid_cells
from lidarcli.formalism.mapping.grid import Occupancy, TooLargeError
from lidarcli.formalism.matching.free_space import MAX_CELLS, Nearest, of_map
from lidarcli.sweeps.types import Bool, Float64, Int8, Int64
from lidarcli.system import native

FIELD_CELL, MARGIN = 0.05, 5
"""Side of the cells of a field of distances [m], and cells of it around the map."""
UNIT, FARTHEST = 0.01, 63
"""Unit of these distances [m], and the greatest, which stands for all that are farther."""
OCCUPIED, KNOWN, BESIDE = 64, 128, 0.25
"""Flags of cells: occupied in the map; known to it, or within the distance of an occupied cell [m]."""
EXPLAINED = 0.12
"""A beam is explained that ends within this distance of an occupied cell [m]."""
SHARP, WIDE, FLAT = 0.08, 0.12, 0.05
"""Standard deviations of the worth of a distance, for climbing and for places around, which take the last as none [m]."""
STEP, STEP_TURN, SIZES, MAX_STEPS, MIN_STEP = 0.1, math.pi / 90.0, 4, 8, 1e-6
"""First steps of climbing [m, rad], how often they are halved, the most of each size, and what one has to gain."""
DOUBTFUL, HALF_KNOWN = 0.8, 0.6
"""Places around are tried where the map explains less than this share of the beams that end where it is known, or where
fewer than this share end there."""
STRIDE, STRIDE_TURN, PLACES, TURNS = 0.2, 2.5 * math.pi / 180.0, 7, 10
"""Places around are tried in such steps [m, rad], so many to each side: up to 1.4 m and 25 degrees."""
TRIED_POINTS, CLIMBED, BETTER = 80, 6, 0.03
"""Points by which they are evaluated, number of the best from which climbing begins, and by how much one has to be
better."""
SHORT, NEAREST = 0.35, 0.05
"""A beam goes through a wall that is more than this before its end [m], and than this share of it from the sensor."""
COLUMNS = 10
"""Numbers of each window in the result of `judge`."""

FITTING, OFF, LOST, UNSURE = range(4)
"""Codes of `MAP_STATES`."""
MIN_POINTS, MIN_KNOWN = 40, 0.5
"""A window of fewer points is unknown, and one of which fewer beams than this share end where the map is known."""
GAIN, LESS_AGAINST, MIN_AFTER = 0.08, 0.04, 0.65
"""A correction explains more of the beams by the first share, leaves fewer by the second that end in free space, explains
the third, …"""
MIN_OFF, MIN_TURN = 0.15, math.pi / 60.0
"""… and is more than this [m, rad]."""
LITTLE, THROUGH, SOME_KNOWN = 0.5, 0.15, 0.3
"""Lost: the map explains less than the first share, more than the second go through walls, and more than the third end
where it is known; …"""
RELATIVE, LESS_THROUGH = 0.6, 0.1
"""… or it explains less than this share of what it does in the median, and more than the second go through walls."""
FEWEST, MAX_GAP, ALIKE = 2, 2, 1.2
"""An interval has so many windows that are off or lost, each at most so many after the one before, and corrections that
differ by no more than this [m] from one to the next: those of rows of like shelves do."""
CLEAR_GAIN = 0.3
"""A window alone is one, too, where the correction explains so much more of the beams."""


class Field:
    """Distances to the occupied cells of a map, and the window that is evaluated."""

    def __init__(self, cells: Any, x: float, y: float) -> None:
        """`cells`: (H, W) uint8, as of `field_of`; `x`, `y`: lower left corner of cell (0, 0) [m]."""
        self.owner: list[Any] = [cells]
        self.cells = native.at_bytes(cells)
        self.height, self.width = cells.shape
        self.x, self.y = x, y
        self.columns = COLUMNS
        self.sharp, self.wide = native.doubles(self.owner, 256), native.doubles(self.owner, 256)
        """Worth of each value of a cell."""
        self.near = native.integers(self.owner, 256)
        """1 for values of cells that explain a beam."""
        for value in range(256):
            distance = UNIT * (value % OCCUPIED)
            if value % OCCUPIED < FARTHEST:
                self.sharp[value] = math.exp(-0.5 * (distance / SHARP) ** 2)
                self.wide[value] = math.exp(-0.5 * (max(distance - FLAT, 0.0) / WIDE) ** 2)
                self.near[value] = 1 if value >= KNOWN and distance <= EXPLAINED else 0
        self.best = native.doubles(self.owner, 4 * CLIMBED)
        """Worth, x, y and turn of the best places around."""
        self.found = native.doubles(self.owner, 4)
        """Those of the place that was found last."""
        self.total = self.begin = self.end = 0
        """Number of all points, and first and last of the window; the place about which it turns:"""
        self.pivot_x = self.pivot_y = 0.0


def judge(field: Field, points: Any, windows: Any, found: Any) -> None:
    """Evaluate W windows.

    Parameters
    ----------
    points : (4, P) float64 x and y of the ends of beams, and of the sensor, by the told poses [m]
    windows : (W + 1,) int64 first point of each window, and the number of all; no window is empty
    found : (W, 10) float64: share of the beams that the map explains as told; share that end where it is known; both after
        the correction; x, y [m] and turn [rad] of the correction; share of the beams that go through a wall (0 where the
        map explains most); x, y of the mean place of the sensor, about which the correction turns [m]
    """
    count = len(windows) - 1
    field.total = points.shape[1]
    p, first, out = native.at_doubles(points), native.at_longs(windows), native.at_doubles(found)
    lock = native.release()
    for window in range(count):
        field.begin, field.end = first[window], first[window + 1]
        judge_window(field, p, out, COLUMNS * window)
    native.resume(lock)


def judge_window(field: Field, p: Any, out: Any, to: int) -> None:
    """Evaluate the window of a field."""
    n = 1.0 * (field.end - field.begin)
    pivot_x, pivot_y = 0.0, 0.0
    for k in range(field.begin, field.end):
        pivot_x += p[2 * field.total + k]
        pivot_y += p[3 * field.total + k]
    field.pivot_x, field.pivot_y = pivot_x / n, pivot_y / n
    near, known = explained(field, p, 0.0, 0.0, 0.0)
    out[to], out[to + 1] = near / n, known / n
    climb(field, p, 0.0, 0.0, 0.0)
    worth, x, y, turn = field.found[0], field.found[1], field.found[2], field.found[3]
    out[to + 7], out[to + 8], out[to + 9] = 0.0, field.pivot_x, field.pivot_y
    if near < DOUBTFUL * known or known < HALF_KNOWN * n:
        out[to + 7] = through_walls(field, p) / n
        look_around(field, p)
        for k in range(CLIMBED):
            climb(field, p, field.best[4 * k + 1], field.best[4 * k + 2], field.best[4 * k + 3])
            if field.found[0] > worth + BETTER:
                worth, x, y, turn = field.found[0], field.found[1], field.found[2], field.found[3]
    near, known = explained(field, p, x, y, turn)
    out[to + 2], out[to + 3] = near / n, known / n
    out[to + 4], out[to + 5], out[to + 6] = x, y, turn


def value_at(field: Field, x: float, y: float) -> int:
    """Return the value of the cell of a place, `FARTHEST` outside."""
    across, up = (x - field.x) / FIELD_CELL, (y - field.y) / FIELD_CELL
    if across < 0.0 or up < 0.0 or across >= field.width or up >= field.height:
        return FARTHEST
    row, column = int(up), int(across)
    value: int = field.cells[row * field.width + column]
    return value


def explained(field: Field, p: Any, x: float, y: float, turn: float) -> tuple[float, float]:
    """Return the number of beams that the map explains after a motion, and of those that end where it is known."""
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = field.pivot_x + x, field.pivot_y + y
    near, known = 0, 0
    for k in range(field.begin, field.end):
        dx, dy = p[k] - field.pivot_x, p[field.total + k] - field.pivot_y
        value = value_at(field, x + cos * dx - sin * dy, y + sin * dx + cos * dy)
        known += value >= KNOWN
        near += field.near[value]
    return 1.0 * near, 1.0 * known


def worth_of(field: Field, p: Any, worths: Any, every: int, x: float, y: float, turn: float) -> float:
    """Return the mean worth after a motion of every so many points."""
    cos, sin = math.cos(turn), math.sin(turn)
    x, y = field.pivot_x + x, field.pivot_y + y
    worth, count, k = 0.0, 0, field.begin
    while k < field.end:
        dx, dy = p[k] - field.pivot_x, p[field.total + k] - field.pivot_y
        worth += worths[value_at(field, x + cos * dx - sin * dy, y + sin * dx + cos * dy)]
        count += 1
        k += every
    return worth / count


def climb(field: Field, p: Any, x: float, y: float, turn: float) -> None:
    """Climb from a motion to one of most worth around it, in `found` of the field."""
    found = field.found
    found[0] = worth_of(field, p, field.sharp, 1, x, y, turn)
    found[1], found[2], found[3] = x, y, turn
    step, step_turn = 2.0 * STEP, 2.0 * STEP_TURN
    for _ in range(SIZES):
        step, step_turn = 0.5 * step, 0.5 * step_turn
        for _ in range(MAX_STEPS):
            x, y, turn = found[1], found[2], found[3]
            moved = False
            for k in range(27):
                to_x, to_y = x + step * (k % 3 - 1), y + step * (k // 3 % 3 - 1)
                to_turn = turn + step_turn * (k // 9 - 1)
                worth = worth_of(field, p, field.sharp, 1, to_x, to_y, to_turn)
                if worth > found[0] + MIN_STEP:
                    found[0], found[1], found[2], found[3] = worth, to_x, to_y, to_turn
                    moved = True
            if not moved:
                break


def look_around(field: Field, p: Any) -> None:
    """Try all places around, and keep the best ones in `best` of the field."""
    best = field.best
    for k in range(CLIMBED):
        best[4 * k] = -1.0
    every = max((field.end - field.begin) // TRIED_POINTS, 1)
    for turned in range(-TURNS, TURNS + 1):
        for column in range(-PLACES, PLACES + 1):
            for row in range(-PLACES, PLACES + 1):
                x, y, turn = STRIDE * column, STRIDE * row, STRIDE_TURN * turned
                worth = worth_of(field, p, field.wide, every, x, y, turn)
                at = CLIMBED - 1
                if worth <= best[4 * at]:
                    continue
                while at > 0 and best[4 * at - 4] < worth:
                    for k in range(4):
                        best[4 * at + k] = best[4 * at - 4 + k]
                    at -= 1
                best[4 * at], best[4 * at + 1], best[4 * at + 2], best[4 * at + 3] = worth, x, y, turn


def through_walls(field: Field, p: Any) -> float:
    """Return the number of beams that pass an occupied cell clearly before their ends."""
    passing = 0
    for k in range(field.begin, field.end):
        x, y = p[2 * field.total + k], p[3 * field.total + k]
        dx, dy = p[k] - x, p[field.total + k] - y
        length = math.sqrt(dx * dx + dy * dy)
        at = max(NEAREST * length, FIELD_CELL)
        while at < length - SHORT:
            if value_at(field, x + at / length * dx, y + at / length * dy) & OCCUPIED:
                passing += 1
                break
            at += FIELD_CELL
    return 1.0 * passing


def field_of(grid: Occupancy) -> Field:
    """Return the distances to the occupied cells of a map, and where it is known.

    The field reaches beyond the map by the distance at which a cell is known. More than `MAX_CELLS` of cells raise a
    `TooLargeError`.
    """
    ground = of_map(grid)
    nearest = Nearest(ground)
    height, width = (int(np.ceil(side * ground.resolution / FIELD_CELL)) + 2 * MARGIN for side in ground.cells.shape)
    if height * width > MAX_CELLS:
        raise TooLargeError(f"{width * FIELD_CELL:,.0f} x {height * FIELD_CELL:,.0f} m")
    left, low = ground.x - MARGIN * FIELD_CELL, ground.y - MARGIN * FIELD_CELL
    cells = np.empty((height, width), np.uint8)
    x = np.asarray(left + (np.arange(width) + 0.5) * FIELD_CELL, np.float64)
    for row in range(height):
        y: Float64 = np.full(width, low + (row + 0.5) * FIELD_CELL)
        state = ground.state(x, y)
        away = nearest.of(x, y)[1]
        value = np.minimum(np.rint(np.minimum(away, 1.0) / UNIT), FARTHEST).astype(np.uint8)
        value[state == grid_cells.OCCUPIED] |= OCCUPIED
        value[(state != grid_cells.UNKNOWN) | (away < BESIDE)] |= KNOWN
        cells[row] = value
    return Field(cells, left, low)


def states_of(points: Int64, found: Float64) -> tuple[Int8, float, Bool]:
    """Return (W,) states of windows of so many points, by the result of `judge`; the median of the explained shares; and
    (W,) True where there are enough points.
    """
    share, known, after, known_after, x, y, turn, through, _, _ = found.T
    tells = points >= MIN_POINTS
    median = float(np.median(share[tells])) if tells.any() else 0.0
    state = np.where(known < MIN_KNOWN, UNSURE, FITTING)
    lost = (share < LITTLE) & (through > THROUGH) & (known > SOME_KNOWN)
    state[lost | ((share < RELATIVE * median) & (through > LESS_THROUGH))] = LOST
    better = (after >= np.maximum(share + GAIN, MIN_AFTER)) & (known - share >= known_after - after + LESS_AGAINST)
    state[better & ((np.hypot(x, y) > MIN_OFF) | (np.abs(turn) > MIN_TURN))] = OFF
    state[~tells] = UNSURE
    return state.astype(np.int8), median, tells


def intervals_of(window: Int64, state: Int8, found: Float64) -> list[Int64]:
    """Return the intervals in which a path is off or lost: the indices of their windows, by (W,) numbers and states."""
    bad = np.flatnonzero((state == OFF) | (state == LOST))
    apart = np.diff(window[bad]) > MAX_GAP
    step = np.hypot(*np.diff(found[bad, 4:6], axis=0).T)
    apart |= (step > ALIKE) & (state[bad[1:]] == OFF) & (state[bad[:-1]] == OFF)
    clear = (state == OFF) & (found[:, 2] - found[:, 0] >= CLEAR_GAIN)
    return [part for part in np.split(bad, np.flatnonzero(apart) + 1) if len(part) >= FEWEST or clear[part].any()]
