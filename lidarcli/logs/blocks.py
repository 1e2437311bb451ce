"""Helpers of all decoders: sizes of blocks, padding, and reasons to refuse a message."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.base import MAX_BEAMS, OpenOptions, ReadReport
from lidarcli.sweeps.finding_rules import FAR, WIDEST_VIEW
from lidarcli.sweeps.types import TURN, Bool, Float32, Float64, Int32, Int64, RawSweeps

BLOCK_ROWS = 1024
BLOCK_VALUES = 1 << 20
"""Most ranges of one block, padding included, unless one sweep alone has more."""

TOO_MANY = f"more than {MAX_BEAMS} beams declared"
ANGLE_MIN = "angle_min is not finite"
INCREMENT = "angle_increment is not finite"
FARTHEST = 1e6
"""Greatest bearing [rad]: beyond it single precision has steps of degrees."""
BEARINGS = f"the first or last bearing is beyond {FARTHEST:,.0f} rad"
INCREMENT_ZERO = "angle_increment is zero"
WIDEST_STEP = 0.9
"""Steps between beams above this [rad] (52 degrees) are degrees taken as radians, if the view is too wide as well."""
IN_DEGREES = f"angle_increment is beyond {WIDEST_STEP} rad: probably degrees, where a LaserScan has radians (--degrees)"


class ScanLayout(NamedTuple):
    """Ranges of one sweep as they stand in its message."""

    stamp_ns: int
    beams: int
    range_min: float
    """[m], 0 where the message has none."""
    range_max: float
    """[m], infinite where the message has none."""
    beam: Int64
    """(K,) beam of each number: several for one beam that has several echoes, none for one without."""
    place: Int64
    """(K,) position of each number in the message [bytes]."""
    kind: str
    """Type of the numbers, as numpy spells it with its byte order."""


Locate = Callable[[bytes], ScanLayout | None]
"""Finds the ranges in a message; None for one that is no sweep."""


def in_degrees(beams: Int32 | Int64, angle_increment: Float32 | Float64) -> Bool:
    """Return (S,) True for sweeps whose steps can only be degrees taken as radians.

    >>> in_degrees(np.array([360, 360, 4]), np.array([1.0, 0.0175, 1.57])).tolist()
    [True, False, False]
    """
    step = np.abs(angle_increment.astype(np.float64))
    return np.asarray((step > WIDEST_STEP) & (step > WIDEST_VIEW / np.maximum(beams - 1, 1)) & (beams > 1))


def unsound(
    beams: Int32 | Int64, first: Float32 | Float64, step: Float32 | Float64, report: ReadReport
) -> Iterator[tuple[Bool, str]]:
    """Yield (S,) which headers are of no sweep, and why, by the number of beams, the first bearing and the step [rad]."""
    yield beams > MAX_BEAMS, TOO_MANY
    yield ~np.isfinite(first), ANGLE_MIN
    yield ~np.isfinite(step), INCREMENT
    yield (step == 0) & (beams > 1), INCREMENT_ZERO
    with np.errstate(over="ignore", invalid="ignore"):
        last = first + step.astype(np.float64) * beams
        yield ~(np.maximum(np.abs(first), np.abs(last)) <= FARTHEST), BEARINGS
    yield in_degrees(beams, step) & (not report.takes_degrees), IN_DEGREES


def limits_in_metres(least: Float32 | Float64, most: Float32 | Float64, scale: float) -> tuple[Float32, Float32]:
    """Return range_min and range_max (S,) in metres, for ranges in a unit of `scale` metres.

    Many a driver has its limits in metres, but ranges in millimetres. A range_max up to `FAR` is in metres: in
    centimetres it would be 2 m, and no sensor sees as little. Its range_min is in the same unit.

    >>> limits_in_metres(np.array([0.5, 500.0]), np.array([12.0, 12000.0]), 0.001)
    (array([0.5, 0.5], dtype=float32), array([12., 12.], dtype=float32))
    """
    factor = np.where(most <= FAR, 1.0, scale)
    return as_singles(least * factor), as_singles(most * factor)


def split_rows(counts: Int32 | Int64, max_rows: int = BLOCK_ROWS, max_values: int = BLOCK_VALUES) -> Iterator[slice]:
    """Cut sweeps of `counts` beams into runs that may be padded to one width.

    A run has at most `max_rows` sweeps and `max_values` values, more than three quarters of them padding
    only where the run is small. One sweep always fits.
    """
    first = 0
    while first < len(counts):
        ahead = np.maximum(counts[first : first + max_rows].astype(np.int64), 1)
        values = np.maximum.accumulate(ahead) * np.arange(1, len(ahead) + 1)
        fits = (values <= max_values) & (values <= np.maximum(4 * np.cumsum(ahead), max_values // 8))
        rows = len(ahead) if fits.all() else max(1, int(np.argmin(fits)))
        yield slice(first, first + rows)
        first += rows


def pad_rows(rows: list[Float32]) -> Float32:
    """Return rows of different lengths as one array, padded with NaN."""
    padded = np.full((len(rows), max(map(len, rows), default=0)), np.nan, np.float32)
    for values, row in zip(padded, rows, strict=True):
        values[: len(row)] = row
    return padded


def pad_intensities(rows: list[Float32], width: int) -> Float32 | None:
    """Return rows of intensities as (S, `width`), padded with NaN; None if there are none."""
    if not any(map(len, rows)):
        return None
    padded = np.full((len(rows), width), np.nan, np.float32)
    for values, row in zip(padded, rows, strict=True):
        values[: len(row)] = row[:width]
    return padded


def pad(flat: NDArray[np.floating], beams: Int64, scale: float) -> Float32:
    """Return (S, B) rows of `beams` values in metres, short ones padded with NaN; `flat` holds them one after the other."""
    values = as_singles(flat * scale if scale != 1.0 else flat)
    width = int(beams.max(initial=0))
    if (beams == width).all():
        return values.reshape(len(beams), width)
    ranges = np.full((len(beams), width), np.nan, np.float32)
    ranges[np.arange(width) < beams[:, None]] = values
    return ranges


def keep_sound(block: RawSweeps, good: Bool | None, report: ReadReport) -> RawSweeps | None:
    """Return the `good` rows that can be sweeps; count the others as refused."""
    if good is not None and not good.all():
        block = block.rows(good)
    whole = np.ones(len(block), np.bool_)
    for bad, cause in unsound(block.beams, block.angle_min, block.angle_increment, report):
        fresh = bad & whole
        if fresh.any():
            report.refused[(block.topic, cause)] += int(fresh.sum())
            whole &= ~fresh
    if not whole.any():
        return None
    return block if whole.all() else block.rows(whole)


def as_singles(values: NDArray[np.floating]) -> Float32:
    """Return values as float32; larger ones become infinite."""
    with np.errstate(over="ignore"):
        return values.astype(np.float32, copy=False)


def given_geometry(options: OpenOptions, beams: int) -> tuple[float, float] | None:
    """Return angle_min and angle_increment [rad] for a sweep of `beams` by the options; None without them.

    >>> given_geometry(OpenOptions(angle_min=-1.0, angle_increment=0.5), 5)
    (-1.0, 0.5)
    """
    options.used.update(("angle_min", "angle_increment", "fov"))
    if options.angle_min is not None and options.angle_increment is not None:
        return options.angle_min, options.angle_increment
    if options.fov is None:
        return None
    if abs(options.fov - TURN) <= 1e-6 * TURN:
        first, step = -np.pi, TURN / max(beams, 1)
    else:
        first, step = -0.5 * options.fov, options.fov / max(beams - 1, 1)
    return (first if options.angle_min is None else options.angle_min), step


def given_geometries(options: OpenOptions, beams: Int64) -> tuple[Float64, Float64]:
    """Return `given_geometry` for sweeps with `beams` (S,) each; nan where the options do not say."""
    distinct, inverse = np.unique(beams, return_inverse=True)
    pairs = [given_geometry(options, count) or (np.nan, np.nan) for count in distinct.tolist()]
    both = np.array(pairs, np.float64).reshape(-1, 2)[inverse.ravel()]
    return both[:, 0], both[:, 1]
