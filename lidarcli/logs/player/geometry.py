"""The bearings of the sweeps of Player, which lines tell in three places, or nowhere."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lidarcli.logs.lines import full_steps, sound_rows
from lidarcli.logs.numbers import Cells
from lidarcli.logs.player.words import DATA, Scan
from lidarcli.sweeps import Bool, Float64, Int64

CONFIG = 7
"""Numbers of a ranger's configuration: first and last bearing, step, least and greatest range, steps of ranges, rate."""
_UNEVEN = 0.25
"""Steps by which a bearing may be off where beams are evenly spread."""
_ROUNDED = 6e-5
"""By so much [rad] the fourth decimal of a step may be off."""


class Geometry(NamedTuple):
    """What is known of sweeps (R,), NaN where nothing is."""

    first: Float64
    step: Float64
    least: Float64
    most: Float64


def of_laser(cells: Cells, rows: Int64, beams: Int64, scan: Scan, bad: list[tuple[int, str]]) -> Geometry:
    """That of the lines of a laser; what is no number is told in `bad`."""
    known = np.full((len(rows), 4), np.nan)
    for at, width, into in ((scan.geometry, 3, slice(0, 3)), (scan.most, 1, slice(3, 4))):
        if at is not None:
            numbers = cells.numbers(rows, at, np.full(len(rows), width), np.float64)
            good, values = sound_rows(numbers, rows, width, bad)
            known[good, into] = values
    first, last, step, most = known.T
    step = np.where(step == 0.0, (last - first) / np.maximum(beams - 1, 1), step)
    return Geometry(first, step, np.zeros(len(rows)), most)


def of_bearings(bearings: Float64, beams: Int64) -> tuple[Float64, Float64, Bool]:
    """First bearing and step of sweeps (R,) whose beams each have one, one after the other; and which are not even."""
    begin = np.cumsum(beams) - beams
    some = beams > 0
    ends = np.append(bearings, np.nan)
    first = np.where(some, ends[np.where(some, begin, -1)], 0.0)
    last = np.where(some, ends[np.where(some, begin + beams - 1, -1)], 0.0)
    row = np.repeat(np.arange(len(beams)), beams)
    with np.errstate(over="ignore", invalid="ignore"):
        step = (last - first) / np.maximum(beams - 1, 1)
        step[beams < 2] = 1.0
        expected = first[row] + (np.arange(len(row)) - begin[row]) * step[row]
        odd = ~(np.abs(bearings - expected) <= _UNEVEN * np.abs(step[row]))
    return first, step, np.bincount(row, odd, len(beams)) > 0


def of_ranger(told: Float64, beams: Int64) -> Geometry:
    """That of configurations (R, 7) of a ranger; drivers that have none answer with zeros."""
    first, last, step, least, most = told.T[:5]
    first = np.where((first == last) & (step == 0.0), np.nan, first)
    return Geometry(first, full_steps(last - first, step, beams, _ROUNDED), least, most)


def tails(cells: Cells, rows: Int64, after: Int64, bad: list[tuple[int, str]]) -> tuple[Float64, Float64]:
    """Place (R, 3) x, y, yaw and configuration (R, 7) that lines of a ranger hold behind the ranges; NaN where none.

    Behind the ranges stands whether a geometry follows; the configuration is what is left, by some writers after a mark.
    """
    poses, configs = np.full((len(rows), 3), np.nan), np.full((len(rows), CONFIG), np.nan)
    left = cells.spans(rows, after, np.maximum(cells.count[rows] - after, 0))
    for at, text in enumerate(left):
        fields = text.split(b" ") if text else []
        try:
            config = _behind_geometry(fields)
            if len(config) not in (0, 1, CONFIG, CONFIG + 1):
                raise ValueError
            if len(config) >= CONFIG:
                configs[at] = [float(field) for field in config[-CONFIG:]]
            if fields and fields[0].strip(b"0"):
                poses[at] = [float(fields[cell]) for cell in (1, 2, 6)]
        except (ValueError, IndexError):
            bad.append((int(rows[at]), "what stands behind its ranges is no geometry"))
    return poses, configs


def _behind_geometry(fields: list[bytes]) -> list[bytes]:
    """What is left behind the geometry of a device: nine numbers, then poses and sizes of its parts, each with a count."""
    if not fields or not fields[0].strip(b"0"):
        return fields[1:]
    place = 1 + 9
    for width in (6, 3):
        place += 1 + width * int(fields[place])
    if place > len(fields):
        raise ValueError
    return fields[place:]


def configuration(cells: Cells, rows: Int64) -> list[tuple[int, list[float]]]:
    """Row and numbers of the responses that are configurations of a ranger."""
    some = rows[cells.count[rows] == DATA + CONFIG]
    numbers = cells.numbers(some, DATA, np.full(len(some), CONFIG), np.float64)
    good, values = sound_rows(numbers, some, CONFIG, [])
    return list(zip(some[good].tolist(), values.tolist(), strict=True))
