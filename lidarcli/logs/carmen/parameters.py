"""What the parameters of a CARMEN log tell of its lasers, and what is taken where they tell nothing."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from lidarcli.logs.carmen.words import FRONT, REAR
from lidarcli.logs.lines import Told, is_number
from lidarcli.sweeps import Bool, Float64, Int64

MAX_RANGE = 80.0
"""The greatest range [m] of a sweep whose line does not tell it: what SICK lasers write for no return is beyond it.

The parameters `robot_front_laser_max` and `robot_rear_laser_max` do not tell it: they say up to where the programs of the
robot were set to use ranges, and the lines also hold what was measured beyond. A range of just this value is cut off.
"""

_SPOKEN = {FRONT: "front", REAR: "rear"}
_NAMES = {
    (frame, what): pattern.format(name).encode()
    for frame, name in _SPOKEN.items()
    for what, pattern in {
        "fov": "laser_{}_laser_fov",
        "resolution": "laser_{}_laser_resolution",
        "max": "robot_{}_laser_max",
        "forward": "robot_{}laser_offset",
        "side": "robot_{}laser_side_offset",
        "angular": "robot_{}laser_angular_offset",
    }.items()
}
"""Frame and what is told → the name of the parameter. Views and steps are degrees, offsets metres and radians."""
_KNOWN = frozenset(_NAMES.values())
_NUMBER_FIRST = re.compile(rb"[-+.\d]")

_STEPS = {181: 1.0, 180: 1.0, 361: 0.5, 360: 0.5, 401: 0.25, 400: 0.25}
"""Ranges → degrees from beam to beam of the SICK lasers that the logs without geometry come from."""
_WITHOUT_LAST = [beams for beams in _STEPS if beams % 2 == 0]
"""Of them those whose view goes one step beyond the last range."""
_FIRST = {401: -50.0, 400: -50.0}
_SLACK = 1.5
"""A view and a step that are told make the number of ranges, or miss it by less than this."""


class Parameters:
    """The values of parameters, line by line: what is told counts for what comes after it."""

    def __init__(self) -> None:
        self._told: Told[bytes] = Told()

    def add(self, first_line: int, parameters: Iterable[tuple[int, bytes, bytes]]) -> None:
        """Take row, name and value of some parameters of a block."""
        self._told.add(
            first_line,
            [
                (row, name, (float(value),))
                for row, name, value in parameters
                if name in _KNOWN and _NUMBER_FIRST.match(value) and is_number(value)
            ],
        )

    def at(self, frame: str, what: str, lines: Int64) -> Float64:
        """The value at each line (R,), NaN where none has been told yet."""
        return self._told.at(_NAMES.get((frame, what), b""), lines, 1)[:, 0]

    def mount(self, frame: str) -> tuple[float, float, float] | None:
        """x, y [m] and yaw [rad] of a laser on the robot by the last that was told; None where nothing was.

        A rear laser looks backwards, unless its angle is told and says so itself.
        """
        told = {
            what: value[0]
            for what in ("forward", "side", "angular")
            if (value := self._told.last(_NAMES.get((frame, what), b""))) is not None
        }
        if not told:
            return None
        yaw = told.get("angular", 0.0)
        if frame == REAR and abs(yaw) < 0.5 * np.pi:
            yaw += np.pi
        return told.get("forward", 0.0), told.get("side", 0.0), yaw


def geometry(beams: Int64, fov: Float64, resolution: Float64) -> tuple[Float64, Float64, Bool]:
    """First bearing and step [rad] of sweeps (R,) whose lines do not tell them, and which of them are guessed.

    Parameters
    ----------
    beams : (R,) ranges of each
    fov, resolution : (R,) view and step that parameters tell [degrees], NaN where they tell none
    """
    gaps = np.maximum(beams - 1, 1)
    with np.errstate(all="ignore"):
        fov, resolution = np.where(fov > 0, fov, np.nan), np.where(resolution > 0, resolution, np.nan)
        steps = fov / resolution
    fits = ~(np.abs(steps - beams + 0.5) >= _SLACK)
    by_step = np.isfinite(resolution) & fits
    by_view = np.isfinite(fov) & fits
    # 180 beams of a degree are those of half a turn without its last one.
    half = np.abs(beams * resolution - 180.0) < 1e-6
    view = np.where(by_view, fov, np.where(half, 180.0, gaps * resolution))
    guessed_step, guessed_first = _guess(beams)
    told = by_step | by_view
    step = np.where(by_step, resolution, view / np.where(np.isin(beams, _WITHOUT_LAST), beams, gaps))
    step = np.where(told, step, guessed_step)
    first = np.where(told, -0.5 * view, guessed_first)
    return np.radians(first), np.radians(step), ~told


def _guess(beams: Int64) -> tuple[Float64, Float64]:
    """Step and first bearing by the number of ranges alone [degrees]."""
    distinct, inverse = np.unique(beams, return_inverse=True)
    pairs = [
        (_STEPS.get(count, 180.0 / max(count - 1, 1)), _FIRST.get(count, -90.0))
        for count in distinct.tolist()
    ]
    both = np.array(pairs, np.float64).reshape(-1, 2)[inverse.ravel()]
    return both[:, 0], both[:, 1]
