"""Sweeps as text logs: CARMEN, ARIA, Player, RPLIDAR and JSON lines; and numbers, times and files of text."""

from __future__ import annotations

import gzip
import io
import json
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from lidarcli.errors import OptionError
from lidarcli.simulation.generate import SimulatedPoses
from lidarcli.sweeps import Float32, Float64, Int64, RawSweeps

_S = 1_000_000_000


@contextmanager
def opened(path: Path) -> Iterator[IO[str]]:
    """Open a text file with bare newlines; the gzip header has neither time nor name: equal input, equal bytes."""
    if path.suffix != ".gz":
        with path.open("w", encoding="utf-8", newline="") as out:
            yield out
        return
    with (
        path.open("wb") as raw,
        gzip.GzipFile("", "wb", 6, raw, mtime=0) as packed,
        io.TextIOWrapper(packed, encoding="utf-8", newline="") as out,
    ):
        yield out


def write_lines(path: Path, lines: Iterable[str]) -> None:
    """Write lines to a new text file, packed where its name ends in `.gz`."""
    with opened(path) as out:
        for line in lines:
            out.write(line)
            out.write("\n")


def only_topic(blocks: Iterable[RawSweeps], what: str, instead: str = "") -> Iterator[RawSweeps]:
    """Yield the blocks of a log of one topic; OptionError, with what to do `instead`, at a second topic."""
    topic = None
    for block in blocks:
        if topic not in (None, block.topic):
            hint = f": {instead}" if instead else ""
            raise OptionError(f"{what} holds one topic, not {topic} and {block.topic}{hint}")
        topic = block.topic
        yield block


def finite(block: RawSweeps) -> RawSweeps:
    """Return the block with infinity replaced by the greatest range."""
    return replace(block, ranges=np.where(np.isposinf(block.ranges), block.range_max[:, None], block.ranges))


def texts(block: RawSweeps) -> Iterator[list[str]]:
    """Yield the ranges of each sweep as shortest decimals."""
    for row, beams in zip(block.ranges, block.beams.tolist(), strict=True):
        yield shortest(row[:beams])


def intensity_texts(block: RawSweeps, row: int, otherwise: str | None = None) -> list[str]:
    """Return the intensities of a sweep as shortest decimals; without any, `otherwise` for each beam, or nothing."""
    beams = int(block.beams[row])
    if block.intensities is None:
        return [] if otherwise is None else [otherwise] * beams
    return shortest(block.intensities[row, :beams])


def shortest(values: Float32) -> list[str]:
    """Return the shortest decimals that read back as the same float32."""
    numbers: list[str] = values.astype("U").tolist()
    return numbers


def seconds(stamp_ns: int) -> str:
    """Return nanoseconds as seconds with nine decimals.

    >>> seconds(-1_500_000_000)
    '-1.500000000'
    """
    sign, rest = ("-", -stamp_ns) if stamp_ns < 0 else ("", stamp_ns)
    return f"{sign}{rest // _S}.{rest % _S:09d}"


def number_or_word(value: float) -> float | str:
    """Return a float as JSON has it: a word, as in the JSON mapping of protobuf, for what is no number there."""
    if math.isfinite(value):
        return value
    return "NaN" if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"


_CARMEN_HEADER = (
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
    write_lines(path, _carmen(blocks, poses))


def _carmen(blocks: Iterable[RawSweeps], poses: SimulatedPoses | None) -> Iterator[str]:
    yield from _CARMEN_HEADER
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
                yield f"RAWLASER1 {_carmen_head(block, row)} {lists} {_tail(stamp, begin)}"
                continue
            while pose < len(poses) and poses.stamp_ns[pose] <= block.record_ns[row]:
                yield _odom(poses, pose, begin)
                pose += 1
            both = " ".join(map(repr, placed[row].tolist()))
            if (view := _carmen_view(block, row)) is None:
                motion = "0.0 0.0 0.0 0.0 0.0"
                yield f"ROBOTLASER1 {_carmen_head(block, row)} {lists} {both} {motion} {_tail(stamp, begin)}"
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


def _carmen_head(block: RawSweeps, row: int) -> str:
    """Return the geometry of a sweep, as RAWLASER and ROBOTLASER have it in their lines."""
    first, step = float(block.angle_min[row]), float(block.angle_increment[row])
    view = (int(block.beams[row]) - 1) * step
    most = shortest(block.range_max[row : row + 1])[0]
    return f"{_SIMULATED} {first!r} {view!r} {step!r} {most} 0.01 0"


def _carmen_view(block: RawSweeps, row: int) -> dict[str, float] | None:
    """Return the geometry of a sweep as parameters; None unless the view begins at minus its half."""
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
    """Return the mount of the laser as parameters."""
    names = ("robot_frontlaser_offset", "robot_frontlaser_side_offset", "robot_frontlaser_angular_offset")
    return dict(zip(names, map(float, poses.mount), strict=True))


def _parameters(values: dict[str, float], stamp: int, begin: int) -> Iterator[str]:
    for name, value in values.items():
        yield f"PARAM {name} {value!r} {_tail(stamp, begin)}"


def _odom(poses: SimulatedPoses, row: int, begin: int) -> str:
    numbers = [*poses.poses[row].tolist(), float(poses.speed[row]), float(poses.yaw_rate[row]), 0.0]
    return f"ODOM {' '.join(map(repr, numbers))} {_tail(int(poses.stamp_ns[row]), begin)}"


def _placed(poses: SimulatedPoses, stamp_ns: Int64) -> Float64:
    """Return (S, 6) the pose of the laser at each stamp, then that of the robot."""
    robot = poses.at(stamp_ns)
    x, y, yaw = robot.T
    ahead, left, turn = poses.mount
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.column_stack([x + cos * ahead - sin * left, y + sin * ahead + cos * left, yaw + turn, robot])


_ARIA_HEADER = ("LaserOdometryLog", "#Created by lidarcli simulate", "version: 4")
_MM = 1000.0


def write_aria(path: Path, blocks: Iterable[RawSweeps], poses: SimulatedPoses | None = None) -> None:
    """Write sweeps of one topic and the odometry of a robot to `path`, packed where it ends in `.gz`.

    Sweeps are points in the frame of the laser; a beam without a return is 0 0. Times count from the first sweep. The
    format has no place for limits of ranges and the names of frames and topics. Decimals are as many as read back the same:
    more than ARIA writes, whose points are whole millimetres.
    """
    write_lines(path, _aria(blocks, poses))


def _aria(blocks: Iterable[RawSweeps], poses: SimulatedPoses | None) -> Iterator[str]:
    yield from _ARIA_HEADER
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
            view = _aria_view(block, row)
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
    """Return x, y [m] and heading [rad] as mm and degrees."""
    return [repr(float(number)) for number in (pose[0] * _MM, pose[1] * _MM, np.degrees(pose[2]))]


def _aria_view(block: RawSweeps, row: int) -> str:
    """Return first and last angle and the number of samples."""
    first, beams = float(block.angle_min[row]), int(block.beams[row])
    last = first + (beams - 1) * float(block.angle_increment[row])
    return f"{float(np.degrees(first))!r} {float(np.degrees(last))!r} {beams}"


def _points(block: RawSweeps, row: int) -> str:
    """Return the ends of the beams [mm], with blanks as ARIA sets them."""
    beams = int(block.beams[row])
    ranges = block.ranges[row, :beams].astype(np.float64)
    ranges = np.where(np.isposinf(ranges), 0.0, ranges) * _MM
    bearings = block.angle_min[row] + np.arange(beams) * block.angle_increment[row]
    both = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings)])
    return "".join("0 0  " if x == y == 0 else f"{x:.6f} {y:.6f}  " for x, y in both.tolist())


_PLAYER_HEADER = (
    "## Player version 3.0.2 ",
    "## File version 0.3.0 ",
    "## Format: ",
    "## - Messages are newline-separated",
    "## - Common header to each message is:",
    "##   time     host   robot  interface index  type   subtype",
    "##   (double) (uint) (uint) (string)  (uint) (uint) (uint)",
    "## - Following the common header is the message payload ",
)
_ROBOT = "16777343 6665"
"""This machine, and the usual port."""
_DATA, _RESPONSE = "001 001", "004 001"


def write_player(path: Path, blocks: Iterable[RawSweeps], poses: SimulatedPoses | None = None) -> None:
    """Write sweeps of one topic and the odometry of a robot to `path`, packed where it ends in `.gz`.

    The format has no place for `range_min` and the names of frames and topics; what is infinite is written as the greatest
    range; without intensities these are 0. Decimals are as many as read back the same: more than Player writes.
    """
    write_lines(path, _player(blocks, poses))


def _player(blocks: Iterable[RawSweeps], poses: SimulatedPoses | None) -> Iterator[str]:
    yield from _PLAYER_HEADER
    if poses is not None:
        place = " ".join(f"{float(number)!r}" for number in poses.mount)
        yield f"{0:014.3f} {_ROBOT} laser 00 {_RESPONSE} {place} 0.150 0.150"
    scan, pose = 0, 0
    for block in only_topic(blocks, "a Player log"):
        for row, ranges in enumerate(texts(finite(block))):
            while poses is not None and pose < len(poses) and poses.stamp_ns[pose] <= block.record_ns[row]:
                yield _player_odometry(poses, pose)
                pose += 1
            scan += 1
            strengths = intensity_texts(block, row, "0")
            measured = "".join(f"{number} {strength} " for number, strength in zip(ranges, strengths, strict=True))
            yield f"{_player_head(int(block.stamp_ns[row]), 'laser')} {scan:04d} {_player_geometry(block, row)} {measured}"


def _player_head(stamp: int, interface: str) -> str:
    return f"{seconds(stamp)} {_ROBOT} {interface} 00 {_DATA}"


def _player_geometry(block: RawSweeps, row: int) -> str:
    """Return first and last bearing, step, greatest range, and the number of ranges."""
    first, step, beams = (float(block.angle_min[row]), float(block.angle_increment[row]), int(block.beams[row]))
    most = shortest(block.range_max[row : row + 1])[0]
    return f"{first!r} {first + (beams - 1) * step!r} {step!r} {most} {beams:04d}"


def _player_odometry(poses: SimulatedPoses, row: int) -> str:
    numbers = [*poses.poses[row].tolist(), float(poses.speed[row]), 0.0, float(poses.yaw_rate[row])]
    return f"{_player_head(int(poses.stamp_ns[row]), 'position2d')} {' '.join(map(repr, numbers))} 0"


_QUALITY = 47
"""Quality of every return; no return has 0."""


def write_rplidar(path: Path, blocks: Iterable[RawSweeps]) -> None:
    """Write sweeps of one topic to `path`, packed where it ends in `.gz`.

    Bearings are rounded to 0.01 degrees and run clockwise, distances to 0.25 mm; what is no return is 0. The format
    has no place for times, limits, names, and sweeps without beams.
    """
    write_lines(path, _rplidar(blocks))


def _rplidar(blocks: Iterable[RawSweeps]) -> Iterator[str]:
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


def write_jsonlines(path: Path, blocks: Iterable[RawSweeps]) -> None:
    """Write sweeps as LaserScan messages to `path`, one a line, packed where it ends in `.gz`."""
    write_lines(path, _jsonlines(blocks))


def _jsonlines(blocks: Iterable[RawSweeps]) -> Iterator[str]:
    sequence = 0
    for block in blocks:
        for row in range(len(block)):
            time = f"{np.datetime64(int(block.record_ns[row]), 'ns')}Z"
            line = {
                "topic": block.topic,
                "sequence": sequence,
                "log_time": time,
                "publish_time": time,
                "data": _message(block, row),
            }
            yield json.dumps(line, separators=(",", ":"), allow_nan=False)
            sequence += 1


def _message(block: RawSweeps, row: int) -> dict[str, Any]:
    whole, rest = divmod(int(block.stamp_ns[row]), _S)
    beams = int(block.beams[row])
    first, step = float(block.angle_min[row]), float(block.angle_increment[row])
    times = [0.0 if each is None else float(each[row]) for each in (block.time_increment, block.scan_time)]
    return {
        "header": {"stamp": {"sec": whole, "nanosec": rest}, "frame_id": block.frame_ids[int(block.frame[row])]},
        "angle_min": first,
        "angle_max": first + (beams - 1) * step,
        "angle_increment": step,
        "time_increment": times[0],
        "scan_time": times[1],
        "range_min": number_or_word(float(block.range_min[row])),
        "range_max": number_or_word(float(block.range_max[row])),
        "ranges": [number_or_word(value) for value in block.ranges[row, :beams].tolist()],
        "intensities": []
        if block.intensities is None
        else [number_or_word(value) for value in block.intensities[row, :beams].tolist()],
    }
