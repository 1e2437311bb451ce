"""The `.dat` logs that come with CoreSLAM and BreezySLAM: a time, the state of the robot, ranges of a URG-04LX."""

from __future__ import annotations

import numpy as np

from lidarcli.logs.csv.head import Head, value_of
from lidarcli.logs.csv.layouts import CORESLAM, DEFAULT_TOPIC, MILLIMETRE, Columns, Layout
from lidarcli.logs.times import US

_STATE = 24
"""Cells before the ranges: a time [µs], wheel ticks, and what else the robot has measured."""
_BEAMS = 682
_STEP = np.pi / 512
"""Between beams; the middle one looks ahead [rad]."""
_NEAREST, _FARTHEST = 20.0, 6000.0
"""Smaller numbers are codes of errors, larger ones no ranges of this sensor [mm]."""
_ROWS = 2


def find_coreslam(head: Head) -> Layout | None:
    """The layout, where rows can be nothing else: by their length, a time that rises, ticks, and whole millimetres."""
    width = len(head.rows[0])
    rows = [row for row in head.rows if len(row) == width]
    if (
        width not in (_STATE + _BEAMS, _STATE + _BEAMS + 1)
        or len(rows) < _ROWS
        or head.dialect.separator != b" "
    ):
        return None
    table = np.array([[value_of(cell) for cell in row] for row in rows], np.float64)
    time, ticks, ranges = table[:, 0], table[:, 1:_STATE], table[:, _STATE:]
    if not ((np.diff(time) > 0).all() and (time == np.rint(time)).all() and (ticks > _FARTHEST).any()):
        return None
    if not ((ranges == np.rint(ranges)).all() and (ranges >= 0).all() and (ranges <= _FARTHEST).all()):
        return None
    scan = Columns(
        DEFAULT_TOPIC,
        {"record": 0},
        {"record": US},
        np.arange(_STATE, _STATE + _BEAMS),
        _STATE,
        geometry=(-0.5 * (_BEAMS - 1) * _STEP, _STEP),
        nearest=_NEAREST,
    )
    notes = ("682 ranges of a URG-04LX in millimetres, times in microseconds",)
    return Layout(
        CORESLAM, head.dialect, head.start, width=width, scans=(scan,), scale=MILLIMETRE, notes=notes
    )
