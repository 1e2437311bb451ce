"""Sweeps as a Player log: for `simulate --container player` and for tests."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

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
from lidarcli.sweeps import RawSweeps

_HEADER = (
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
    write_lines(path, _lines(blocks, poses))


def _lines(blocks: Iterable[RawSweeps], poses: SimulatedPoses | None) -> Iterator[str]:
    yield from _HEADER
    if poses is not None:
        place = " ".join(f"{float(number)!r}" for number in poses.mount)
        yield f"{0:014.3f} {_ROBOT} laser 00 {_RESPONSE} {place} 0.150 0.150"
    scan, pose = 0, 0
    for block in only_topic(blocks, "a Player log"):
        for row, ranges in enumerate(texts(finite(block))):
            while poses is not None and pose < len(poses) and poses.stamp_ns[pose] <= block.record_ns[row]:
                yield _odometry(poses, pose)
                pose += 1
            scan += 1
            strengths = intensity_texts(block, row, "0")
            measured = "".join(
                f"{number} {strength} " for number, strength in zip(ranges, strengths, strict=True)
            )
            yield f"{_head(int(block.stamp_ns[row]), 'laser')} {scan:04d} {_geometry(block, row)} {measured}"


def _head(stamp: int, interface: str) -> str:
    return f"{seconds(stamp)} {_ROBOT} {interface} 00 {_DATA}"


def _geometry(block: RawSweeps, row: int) -> str:
    """First and last bearing, step, greatest range, and the number of ranges."""
    first, step, beams = (
        float(block.angle_min[row]),
        float(block.angle_increment[row]),
        int(block.beams[row]),
    )
    most = shortest(block.range_max[row : row + 1])[0]
    return f"{first!r} {first + (beams - 1) * step!r} {step!r} {most} {beams:04d}"


def _odometry(poses: SimulatedPoses, row: int) -> str:
    numbers = [*poses.poses[row].tolist(), float(poses.speed[row]), 0.0, float(poses.yaw_rate[row])]
    return f"{_head(int(poses.stamp_ns[row]), 'position2d')} {' '.join(map(repr, numbers))} 0"
