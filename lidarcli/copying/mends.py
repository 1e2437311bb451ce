"""LaserScan messages that other programs refuse, mended by one rule each (docs/clean.md)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from lidarcli.options.times import SECOND_NS
from lidarcli.ros.messages import ROS1, ROS2, SCAN
from lidarcli.sweeps.finding_rules import ASIDE, FAR, OFF
from lidarcli.sweeps.range_rules import RangeRules, normalise
from lidarcli.sweeps.types import TURN, Float32, Int64, RawSweeps, Status

Step = Callable[[Any, int], bool]
"""Mends a message, of the sweep with a number, in place; True if it has changed something."""


@dataclass(slots=True)
class Mend:
    """Rules for the sweeps of one topic, and the number of sweeps that each has changed."""

    encoding: str
    """`cdr` or `ros1`."""
    steps: dict[str, Step] = field(default_factory=dict)
    """Word of `clean --mend`, or `mask` → its rule, in the order in which they are done."""
    order: Int64 | None = None
    """(S,) the sweep that comes at each place, where their stamps are in disorder."""
    held: dict[int, bytes] = field(default_factory=dict)
    """Number → message of each sweep whose place is another."""
    done: Counter[str] = field(default_factory=Counter)
    """Word → sweeps of the copy that it has changed in this pass; `odd`: messages with more or less than a LaserScan."""
    copies: Counter[int] | None = None
    """Number of times that the sweep at each place is copied; None: all are, once."""

    def mended(self, number: int, data: bytes) -> bytes:
        """Return the message at the place of a sweep, the same one where nothing is to be mended."""
        if not number:
            self.done.clear()
        changed, times = [], 1 if self.copies is None else self.copies[number]
        if self.order is not None and (wanted := int(self.order[number])) != number:
            number, data, changed = wanted, self.held[wanted], ["stamps"]
        is_cdr = self.encoding == "cdr"
        try:
            scan: Any = ROS2.deserialize_cdr(data, SCAN) if is_cdr else ROS1.deserialize_ros1(data, SCAN)
        except SerdeError:
            self.done["odd"] += times
            return data
        # A header may say anything.
        with np.errstate(over="ignore", invalid="ignore"):
            changed += [word for word, step in self.steps.items() if len(scan.ranges) and step(scan, number)]
        self.done.update(dict.fromkeys(changed if times else (), times))
        if is_cdr:
            return data[:4] + bytes(ROS2.serialize_cdr(scan, SCAN, little_endian=data[1] == 1)[4:]) if changed else data
        return bytes(ROS1.serialize_ros1(scan, SCAN)) if changed else data


def _set(scan: Any, **numbers: float) -> bool:
    """Set numbers of a header, and return whether one is another now."""
    singles = {name: float(np.float32(number)) for name, number in numbers.items()}
    changed = [name for name, single in singles.items() if getattr(scan, name) != single]
    for name in changed:
        setattr(scan, name, singles[name])
    return bool(changed)


def name_frame(scan: Any, _: int, frame: str) -> bool:
    """Take the slash from the name of a frame, and give a name to one without."""
    before = scan.header.frame_id
    scan.header.frame_id = before.lstrip("/") or frame
    return bool(scan.header.frame_id != before)


def stamp(scan: Any, number: int, stamp_ns: Int64) -> bool:
    """Give a sweep its stamp of (S,) `stamp_ns`; a negative one says that it keeps its own."""
    there, right = scan.header.stamp, divmod(int(stamp_ns[number]), SECOND_NS)
    if right[0] < 0 or right == (there.sec, there.nanosec):
        return False
    there.sec, there.nanosec = right
    return True


def limit(scan: Any, _: int, least: float | None, most: float) -> bool:
    """Set the limits of the ranges [m]; without a least one, messages keep theirs from 0 on, and a greater greatest one."""
    if least is not None:
        return _set(scan, range_min=least, range_max=most)
    least = scan.range_min if scan.range_min >= 0.0 else 0.0
    return _set(scan, range_min=least, range_max=scan.range_max if scan.range_max >= most else most)


def fill(scan: Any, _: int, topic: str, rules: RangeRules, status: Status, value: float | None) -> bool:
    """Give a value [m] to the beams of a status; None: range_max + 1."""
    value = scan.range_max + 1.0 if value is None else value
    chosen = (_status(scan, topic, rules) == status) & (scan.ranges != value)
    scan.ranges = np.where(chosen, np.float32(value), scan.ranges)
    return bool(chosen.any())


def _status(scan: Any, topic: str, rules: RangeRules) -> Any:
    """Return the `Status` of each beam (B,)."""
    none = np.zeros(1, np.int64)
    first, step = np.array([[scan.angle_min], [scan.angle_increment]])
    least, most = np.array([[scan.range_min], [scan.range_max]], np.float32)
    frames, beams = (scan.header.frame_id,), np.full(1, len(scan.ranges), np.int32)
    one = RawSweeps(topic, frames, none.astype(np.int32), none, none, first, step, least, most, beams, scan.ranges[None])
    return normalise(one, none, rules).status[0]


def put_on(scan: Any, _: int, first: float, spacing: float, beams: int) -> bool:
    """Give each of `beams` from a bearing on the range of the beam that is nearest within half a step, NaN without one.

    A sweep of the same step keeps its bearings: a whole sweep between the beams of others would seem turned.
    """
    count = len(scan.ranges)
    if count == beams:
        return False
    # A single beam may have no step.
    step = scan.angle_increment or spacing or 1.0
    if abs(step - spacing) * count <= ASIDE * abs(step):
        aside = (scan.angle_min - first) / step
        first, spacing = first + (aside - np.rint(aside)) * step, step
    bearing = first + spacing * np.arange(beams, dtype=np.float64)
    # Steps from the first beam on, within the turn that begins half a step before it.
    steps = np.mod((bearing - scan.angle_min) / step + 0.5, max(TURN / abs(step), count - 0.5)) - 0.5
    there = steps < count - 0.5
    at = np.where(there, np.rint(steps), 0).astype(np.intp)
    if len(scan.intensities) == count:
        scan.intensities = np.where(there, scan.intensities[at], np.float32(0.0))
    scan.ranges = np.where(there, scan.ranges[at], np.float32(np.nan))
    _set(scan, time_increment=scan.time_increment * abs(spacing / step))
    _set(scan, angle_min=first, angle_increment=spacing, angle_max=bearing[-1])
    return True


def end(scan: Any, _: int, steps: float = 1.0) -> bool:
    """Tell the bearing of the last beam in `angle_max`, where it is half a step off, after `steps` times as wide ones."""
    if steps != 1.0:
        # Where the view lies about the x axis, its first bearing is as wrong as the others.
        last = scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment
        is_centred = abs(scan.angle_min + last) < 3.0 * abs(scan.angle_increment)
        _set(scan, angle_min=scan.angle_min * (steps if is_centred else 1.0), angle_increment=scan.angle_increment * steps)
        return end(scan, 0) or True
    last = scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment
    return not abs(scan.angle_max - last) <= 0.5 * abs(scan.angle_increment) and _set(scan, angle_max=last)


def reverse_intensities(scan: Any, _: int) -> bool:
    """Give each beam the intensity of the beam at its mirrored place, where the sweep has as many of them."""
    if len(scan.intensities) != len(scan.ranges):
        return False
    scan.intensities = scan.intensities[::-1].copy()
    return True


def turn_round(scan: Any, _: int) -> bool:
    """Let the beams run the other way: in the order of time the ranges stay as they are."""
    return _set(scan, angle_min=-scan.angle_min, angle_max=-scan.angle_max, angle_increment=-scan.angle_increment)


def convert(scan: Any, _: int, angle: float, length: float) -> bool:
    """Bring angles to radians and ranges to metres, by factors."""
    scan.ranges = scan.ranges * np.float32(length)
    angles = {name: getattr(scan, name) * angle for name in ("angle_min", "angle_max", "angle_increment")}
    # Many a driver has its limits in metres, but ranges in millimetres.
    limits = length if scan.range_max > FAR else 1.0
    _set(scan, range_min=scan.range_min * limits, range_max=scan.range_max * limits, **angles)
    return True


def time(scan: Any, _: int, turn: float, at_once: bool) -> bool:
    """Tell how long beams, if not taken at once, and sweeps take, by the time of a turn [s], where that is off; 0 stays."""
    right = {"time_increment": 0.0 if at_once else turn * abs(scan.angle_increment) / TURN, "scan_time": turn}
    wrong = {
        name: math.copysign(number, given)
        for name, number in right.items()
        if (given := getattr(scan, name)) and not abs(abs(given) - number) <= OFF * number
    }
    return _set(scan, **wrong)


def merged(data: bytes, encoding: str, frame: str, ranges: Float32, most: float) -> bytes | None:
    """Return a message like another one with ranges (B,) up to `most` [m] all around a frame; None for an odd one."""
    is_cdr = encoding == "cdr"
    try:
        scan: Any = ROS2.deserialize_cdr(data, SCAN) if is_cdr else ROS1.deserialize_ros1(data, SCAN)
    except SerdeError:
        return None
    scan.header.frame_id, scan.ranges, scan.intensities = frame, ranges, np.zeros(0, np.float32)
    step = TURN / len(ranges)
    _set(scan, angle_min=-TURN / 2, angle_max=TURN / 2 - step, angle_increment=step, time_increment=0.0)
    _set(scan, range_min=0.0, range_max=most)
    return bytes(ROS2.serialize_cdr(scan, SCAN) if is_cdr else ROS1.serialize_ros1(scan, SCAN))
