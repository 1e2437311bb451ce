"""Sweeps as the SDK of RPLIDAR sensors prints them: for `simulate -o run.txt` and for tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from lidarcli.simulate.decimals import only_topic, write_lines
from lidarcli.sweeps import RawSweeps

_QUALITY = 47
"""That of every return; no return has 0."""


def write_rplidar(path: Path, blocks: Iterable[RawSweeps]) -> None:
    """Write sweeps of one topic to `path`, packed where it ends in `.gz`.

    Bearings are rounded to 0.01 degrees and run clockwise, distances to 0.25 mm; what is no return is 0. The format
    has no place for times, limits, names, and sweeps without beams.
    """
    write_lines(path, _lines(blocks))


def _lines(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    for block in only_topic(blocks, "RPLIDAR text"):
        for row, beams in enumerate(block.beams.tolist()):
            bearings = block.angle_min[row] + block.angle_increment[row] * np.arange(beams)
            ranges = block.ranges[row, :beams].astype(np.float64)
            if block.angle_increment[row] > 0:
                bearings, ranges = bearings[::-1], ranges[::-1]
            theta = np.round(-np.degrees(bearings), 2) % 360.0
            seen = np.isfinite(ranges) & (ranges > 0)
            distance = np.round(np.where(seen, ranges, 0.0) * 4000.0) / 4.0
            begin = "S "
            for angle, far in zip(theta.tolist(), distance.tolist(), strict=True):
                yield f"{begin} theta: {angle:.2f} Dist: {far:08.2f} Q: {_QUALITY if far else 0} "
                begin = "  "
