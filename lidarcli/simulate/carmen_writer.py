"""Sweeps as a CARMEN log: for `simulate -o run.log` and for tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from lidarcli.simulate.decimals import (
    finite,
    intensity_texts,
    only_topic,
    seconds,
    shortest,
    texts,
    write_lines,
)
from lidarcli.simulate.odometry import SimulatedPoses
from lidarcli.sweeps import Float64, Int64, RawSweeps

_HEADER = (
    "# CARMEN Logfile",
    "# file format is one message per line",
    "# message_name [message contents] ipc_timestamp ipc_hostname logger_timestamp",
    "# message formats defined: PARAM ODOM FLASER RAWLASER1 ROBOTLASER1",
)
_HOST = "simulator"
_SIMULATED = 3
"""The type of a laser that is simulated."""


def write_carmen(path: Path, blocks: Iterable[RawSweeps], poses: SimulatedPoses | None = None) -> None:
    """Write sweeps of one topic and the odometry of a robot to `path`, packed where it ends in `.gz`.

    With poses sweeps are FLASER lines, whose geometry is told by PARAM lines, or ROBOTLASER1 where their view is not
    centred; without any RAWLASER1. With intensities they are REMISSIONFLASER in the place of FLASER. The format has no
    place for `range_min` and the names of frames and topics; what is infinite is written as the greatest range. Decimals
    are as many as read back the same.
    """
    write_lines(path, _lines(blocks, poses))


def _lines(blocks: Iterable[RawSweeps], poses: SimulatedPoses | None) -> Iterator[str]:
    yield from _HEADER
    begin, told, pose = None, None, 0
    for block in only_topic(blocks, "a CARMEN log"):
        placed = None if poses is None else _placed(poses, block.stamp_ns)
        for row, ranges in enumerate(texts(finite(block))):
            stamp = int(block.stamp_ns[row])
            if begin is None:
                begin = stamp
                if poses is not None:
                    yield from _parameters(_mount(poses), stamp, begin)
            remissions = intensity_texts(block, row)
            lists = f"{_list(ranges)} {_list(remissions)}"
            if poses is None or placed is None:
                yield f"RAWLASER1 {_head(block, row)} {lists} {_tail(stamp, begin)}"
                continue
            while pose < len(poses) and poses.stamp_ns[pose] <= block.record_ns[row]:
                yield _odom(poses, pose, begin)
                pose += 1
            both = " ".join(map(repr, placed[row].tolist()))
            if (view := _view(block, row)) is None:
                motion = "0.0 0.0 0.0 0.0 0.0"
                yield f"ROBOTLASER1 {_head(block, row)} {lists} {both} {motion} {_tail(stamp, begin)}"
                continue
            if view != told:
                yield from _parameters(view, stamp, begin)
                told = view
            if remissions:
                pairs = " ".join(f"{far} {strong}" for far, strong in zip(ranges, remissions, strict=True))
                yield f"REMISSIONFLASER {len(ranges)} {pairs} {both} {_tail(stamp, begin)}"
                continue
            yield f"FLASER {_list(ranges)} {both} {_tail(stamp, begin)}"


def _list(ranges: list[str]) -> str:
    return " ".join([str(len(ranges)), *ranges])


def _tail(stamp: int, begin: int) -> str:
    return f"{seconds(stamp)} {_HOST} {seconds(stamp - begin)}"


def _head(block: RawSweeps, row: int) -> str:
    """The geometry of a sweep, as RAWLASER and ROBOTLASER have it in their lines."""
    first, step = float(block.angle_min[row]), float(block.angle_increment[row])
    view = (int(block.beams[row]) - 1) * step
    most = shortest(block.range_max[row : row + 1])[0]
    return f"{_SIMULATED} {first!r} {view!r} {step!r} {most} 0.01 0"


def _view(block: RawSweeps, row: int) -> dict[str, float] | None:
    """The geometry of a sweep as parameters, which know only views that begin at minus their half; None for others."""
    first, step = float(block.angle_min[row]), float(block.angle_increment[row])
    view, gaps = -2.0 * first, int(block.beams[row]) - 1
    if not (step > 0 and abs(view / step - gaps - 0.5) < 0.75):
        return None
    return {
        "laser_front_laser_fov": float(np.degrees(view)),
        "laser_front_laser_resolution": float(np.degrees(step)),
        "robot_front_laser_max": float(shortest(block.range_max[row : row + 1])[0]),
    }


def _mount(poses: SimulatedPoses) -> dict[str, float]:
    """Where the laser is on the robot."""
    names = ("robot_frontlaser_offset", "robot_frontlaser_side_offset", "robot_frontlaser_angular_offset")
    return dict(zip(names, map(float, poses.mount), strict=True))


def _parameters(values: dict[str, float], stamp: int, begin: int) -> Iterator[str]:
    for name, value in values.items():
        yield f"PARAM {name} {value!r} {_tail(stamp, begin)}"


def _odom(poses: SimulatedPoses, row: int, begin: int) -> str:
    numbers = [*poses.poses[row].tolist(), float(poses.speed[row]), float(poses.yaw_rate[row]), 0.0]
    return f"ODOM {' '.join(map(repr, numbers))} {_tail(int(poses.stamp_ns[row]), begin)}"


def _placed(poses: SimulatedPoses, stamp_ns: Int64) -> Float64:
    """(S, 6) the pose of the laser at each stamp, then that of the robot."""
    robot = poses.at(stamp_ns)
    x, y, yaw = robot.T
    ahead, left, turn = poses.mount
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.column_stack([x + cos * ahead - sin * left, y + sin * ahead + cos * left, yaw + turn, robot])
