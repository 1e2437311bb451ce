"""Sweeps as an ARIA log: for `simulate -o run.2d` and for tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from lidarcli.simulate.decimals import only_topic, seconds, write_lines
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.sweeps import Float64, RawSweeps

_HEADER = ("LaserOdometryLog", "#Created by lidarcli simulate", "version: 4")
_MM = 1000.0


def write_aria(path: Path, blocks: Iterable[RawSweeps], poses: SimulatedPoses | None = None) -> None:
    """Write sweeps of one topic and the odometry of a robot to `path`, packed where it ends in `.gz`.

    Sweeps are points in the frame of the laser; a beam without a return is 0 0. Times count from the first sweep. The
    format has no place for limits of ranges and the names of frames and topics. Decimals are as many as read back the same:
    more than ARIA writes, whose points are whole millimetres.
    """
    write_lines(path, _lines(blocks, poses))


def _lines(blocks: Iterable[RawSweeps], poses: SimulatedPoses | None) -> Iterator[str]:
    yield from _HEADER
    begin, told, scan = None, "", 0
    for block in only_topic(blocks, "an ARIA log"):
        placed = None if poses is None else poses.at(block.stamp_ns)
        for row in range(len(block)):
            stamp = int(block.stamp_ns[row])
            if begin is None:
                begin = stamp
                x, y, turn = _lengths(np.array((0.0, 0.0, 0.0) if poses is None else poses.mount))
                yield f"sick1pose: {x} {y} {turn}"
                yield f"scan1pose: {x} {y} 0 {turn}"
            view = _view(block, row)
            if view != told:
                yield f"sick1conf: {view}"
                yield f"scan1conf: {view}"
                told = view
            yield f"scanId: {scan}"
            yield f"time: {seconds(stamp - begin)}"
            if placed is not None:
                yield f"robot: {' '.join(_lengths(placed[row]))}"
            yield f"scan1: {_points(block, row)}"
            scan += 1


def _lengths(pose: Float64) -> list[str]:
    """x, y [m] and heading [rad] as mm and degrees."""
    return [repr(float(number)) for number in (pose[0] * _MM, pose[1] * _MM, np.degrees(pose[2]))]


def _view(block: RawSweeps, row: int) -> str:
    """First and last angle and the number of samples."""
    first, beams = float(block.angle_min[row]), int(block.beams[row])
    last = first + (beams - 1) * float(block.angle_increment[row])
    return f"{float(np.degrees(first))!r} {float(np.degrees(last))!r} {beams}"


def _points(block: RawSweeps, row: int) -> str:
    """The ends of the beams [mm], with blanks as ARIA sets them."""
    beams = int(block.beams[row])
    ranges = block.ranges[row, :beams].astype(np.float64)
    ranges = np.where(np.isposinf(ranges), 0.0, ranges) * _MM
    bearings = block.angle_min[row] + np.arange(beams) * block.angle_increment[row]
    both = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings)])
    return "".join("0 0  " if x == y == 0 else f"{x:.6f} {y:.6f}  " for x, y in both.tolist())
