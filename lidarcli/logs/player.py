"""Player logs, as the writelog driver of Player/Stage writes them, also packed with gzip.

A line begins with time, host, robot, interface and index of the device. Type and subtype of the message follow, or, in logs
of file version 0.1, the time of the device.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from lidarcli.logs.base import LASERSCAN
from lidarcli.logs.blocks import limits_in_metres, pad, split_rows
from lidarcli.logs.lines import (
    CUT,
    POSE,
    TELL_BEARINGS,
    Declared,
    Found,
    Framed,
    Grammar,
    LineBlock,
    LineLog,
    cells_of,
    full_steps,
    left_over,
)
from lidarcli.logs.numbers import Cells, say
from lidarcli.logs.planar import MOUNT_TYPE, MOUNTS, ODOMETRY_TYPE, POSE_TYPE, ROBOT, PlanarPoses
from lidarcli.logs.text import TextBlock
from lidarcli.logs.times import S, to_ns
from lidarcli.sweeps import Bool, Float64, Int64, RawSweeps

_HOST, _KIND = 1, 5
"""Cells of the host (robot, interface and index follow), and of type and subtype."""
_DATA = 7
"""First cell of the data; in file version 0.1 it is the one before."""
_OLD = b"old"
"""Stands for type and subtype in file version 0.1, which has data alone."""
_TIME = re.compile(rb"\d+(?:\.\d*)?")
"""First cell of a line: its time [s]."""


@dataclass(frozen=True, slots=True)
class Scan:
    """A kind of sweep: the cells of its line."""

    count: int
    """Number of ranges, which follow it."""
    width: int
    """Cells for each range: itself, and last its intensity."""
    geometry: int | None = None
    """First and last bearing and step; None where lines have none."""
    most: int | None = None
    """Greatest range."""
    pose: int | None = None
    """Place of the laser."""
    angles: bool = False
    """True where the bearing of each beam follows its range."""
    tail: bool = False
    """True where pose and geometry may follow the ranges."""


_SCANS: dict[tuple[bytes, bytes], Scan] = {
    (b"laser", b"001 001"): Scan(count=12, width=2, geometry=8, most=11),
    (b"laser", b"001 002"): Scan(count=15, width=2, geometry=11, most=14, pose=8),
    (b"laser", b"001 003"): Scan(count=9, width=3, most=8, angles=True),
    (b"laser", _OLD): Scan(count=9, width=2, geometry=6),
    (b"ranger", b"001 001"): Scan(count=7, width=1),
    (b"ranger", b"001 002"): Scan(count=7, width=1, tail=True),
}
"""Interface, type and subtype → kind of sweep."""
_ODOMETRY: dict[tuple[bytes, bytes], int] = {
    (b"position2d", b"001 001"): _DATA,
    (b"position", b"001 001"): _DATA,
    (b"position", _OLD): _DATA - 1,
    (b"position2d", _OLD): _DATA - 1,
}
"""Interface, type and subtype of robots' poses → first cell of the pose."""
_GEOMETRY = b"004 001"
"""Type and subtype of the places of lasers and rangers on their robots."""
_RESPONSE = b"004 "
"""Start of type and subtype of other responses: that of a ranger with seven numbers is its configuration."""
_MOUNTS: dict[bytes, list[int]] = {b"laser": [0, 1, 2], b"ranger": [0, 1, 5, 3, 4]}
"""Interface → places of x, y and yaw among the data of such a line, and of roll and pitch if it has any."""

_CONFIG = 7
"""Numbers of a ranger's configuration: first and last bearing, step, least and greatest range, steps of ranges, rate."""
_PATH, _PLACE = "/pose", "/geometry"
"""Ends of the topics with the places of lasers and of rangers. The second may be a mount: it is read if the user asks."""

_NO_TIME = "no time at its beginning"
_NO_GEOMETRY = f"no geometry in the log {TELL_BEARINGS}"
_UNEVEN = "beams that are not evenly spread"
_MOST_UNEVEN = 0.25
"""Greatest error of a bearing, in steps, where beams are evenly spread."""
_ROUNDED = 6e-5
"""Greatest error [rad] of a step with four decimals."""
_LEVEL = 0.1
"""Greatest tilt of a ranger [rad] that looks along the plane of the poses."""


class Device(NamedTuple):
    """A device of a robot, and a kind of its messages."""

    robot: bytes
    """Host and robot."""
    interface: bytes
    number: int
    """Index among the devices with its interface."""
    kind: bytes
    """Type and subtype, or `_OLD`."""

    @property
    def scan(self) -> Scan | None:
        """Cells of its sweeps; None for other messages."""
        return _SCANS.get((self.interface, self.kind))

    @property
    def odometry(self) -> int | None:
        """First cell of the robot's pose; None for other messages."""
        return _ODOMETRY.get((self.interface, self.kind))

    @property
    def mount(self) -> list[int] | None:
        """Places of its mount among the data, as in `_MOUNTS`; None for other messages."""
        return _MOUNTS.get(self.interface) if self.kind == _GEOMETRY else None

    @property
    def is_config(self) -> bool:
        """True where a message may be the configuration of a ranger."""
        return self.interface == b"ranger" and self.kind.startswith(_RESPONSE) and self.kind != _GEOMETRY


def _device_of(head: bytes, kind: bytes) -> Device | None:
    """Return the device and the kind of message by cells 1 to 4 of a line and cells 5 and 6; None where they name none.

    >>> _device_of(b"16777343 6665 laser 00", b"001 001").number
    0
    """
    cells = head.split(b" ")
    if len(cells) != 4 or not cells[3].isdigit() or len(cells[3]) > 3 or not cells[2][:1].isalpha():
        return None
    first, _, second = kind.partition(b" ")
    if first.isdigit() and second.isdigit():
        kind = b"%03d %03d" % (int(first[:9]), int(second[:9]))
    elif _TIME.fullmatch(first):
        kind = _OLD
    else:
        return None
    return Device(b" ".join(cells[:2]), cells[2], int(cells[3]), kind)


def _by_device(cells: Cells, bad: list[tuple[int, str]], cut: int) -> dict[Device, list[int]]:
    """Return the rows of each device and kind of message; other lines are bad."""
    every = np.arange(len(cells.count))
    first = cells.column(every, 0)
    heads = cells.spans(every, _HOST, np.clip(cells.count - _HOST, 0, _KIND - _HOST))
    kinds = cells.spans(every, _KIND, np.clip(cells.count - _KIND, 0, 2))
    known: dict[tuple[bytes, bytes], Device | None] = {}
    devices: dict[Device, list[int]] = {}
    for row, (begin, head, kind) in enumerate(zip(first, heads, kinds, strict=True)):
        if not begin or begin[:1] == b"#":
            continue
        key = head, _OLD if b"." in kind.partition(b" ")[0] else kind
        if key not in known:
            known[key] = _device_of(head, kind)
        device = known[key]
        # Of a line that is cut before its data the type may be cut as well.
        if row == cut and (device is None or cells.count[row] <= _DATA):
            bad.append((row, CUT))
        elif device is not None and _TIME.fullmatch(begin):
            devices.setdefault(device, []).append(row)
        else:
            bad.append((row, f"{say(begin)} begins no message"))
    return devices


@dataclass(slots=True)
class _Names:
    """Names of devices: those of the first robot in a log are bare, others begin with the robot's."""

    _robots: dict[bytes, str] = field(default_factory=dict)
    _taken: set[str] = field(default_factory=set)

    def prefix(self, robot: bytes) -> str:
        """Return the start of the names of a robot's devices."""
        prefix = self._robots.get(robot)
        if prefix is None:
            host, _, port = robot.decode("utf-8", "replace").partition(" ")
            prefix = f"{port}/" if self._robots else ""
            if prefix in self._taken:
                prefix = f"{host}_{port}/"
            self._robots[robot] = prefix
            self._taken.add(prefix)
        return prefix

    def topic(self, device: Device) -> str:
        """Return the topic of a device's measurements."""
        return f"/{self.frame(device)}"

    def path(self, device: Device) -> str | None:
        """Return the topic of a sensor's own places; None where its lines hold none."""
        scan = device.scan
        if scan is None or not (scan.tail or scan.pose):
            return None
        return self.topic(device) + (_PLACE if scan.tail else _PATH)

    def frame(self, device: Device) -> str:
        """Return the frame of a device."""
        return f"{self.prefix(device.robot)}{device.interface.decode()}{device.number}"

    def base(self, device: Device) -> str:
        """Return the frame of a device's robot."""
        return f"{self.prefix(device.robot)}{ROBOT}"


class _Geometry(NamedTuple):
    """Bearings [rad] and limits of sweeps (R,); NaN where they are not known."""

    first: Float64
    step: Float64
    least: Float64
    most: Float64


@dataclass
class PlayerGrammar(Grammar[Found[Device]]):
    """One pass over a Player log."""

    _names: _Names = field(default_factory=_Names)
    _mounts: dict[str, tuple[str, list[float]]] = field(default_factory=dict)
    """Frame of a sensor → that of its robot, and its place there."""

    def read(self, lines: LineBlock) -> list[Found[Device]]:
        """Find the wanted messages and their times; keep the configurations of rangers."""
        found = []
        configs: list[tuple[int, str, list[float]]] = []
        for device, some in _by_device(lines.cells, lines.bad, lines.cut).items():
            # Robots are named in the order of their first lines.
            self._names.prefix(device.robot)
            if not self._is_wanted(device):
                continue
            rows = np.array(some, np.int64)
            stamps, wrong = to_ns(lines.cells.column(rows, 0), S)
            lines.bad += [(row, _NO_TIME) for row in rows[wrong].tolist()]
            rows, stamps = rows[~wrong], stamps[~wrong]
            kind = b" ".join([device.robot, device.interface, b"%d" % device.number, device.kind])
            found.append(Found(device, rows, self.distinct.of(kind, stamps)))
            if device.is_config:
                topic = self._names.topic(device)
                configs += [(row, topic, config) for row, config in _configs(lines.cells, rows)]
        self.state.add(lines.line, sorted(configs))
        return found

    def _is_wanted(self, device: Device) -> bool:
        if self.types is not None:
            return device.scan is not None or device.odometry is not None or device.mount is not None
        measures = device.scan is not None or device.is_config
        return measures and (self.topics is None or self._names.topic(device) in self.topics)

    def frame(self, found: Found[Device]) -> str | None:
        """Return the frame of a laser or a ranger."""
        return None if found.kind.scan is None else self._names.frame(found.kind)

    def sweeps_of(self, lines: LineBlock, found: Found[Device]) -> Iterator[RawSweeps]:
        """Decode sweeps of one laser or ranger."""
        if (scan := found.kind.scan) is not None:
            sweeps, declared = _framed(lines, found, scan)
            self.refuse_many(self._names.topic(found.kind), declared)
            for part in split_rows(sweeps.beams):
                block = self._decode(lines, sweeps.of(part), scan)
                if block is not None:
                    yield block

    def _decode(self, lines: LineBlock, found: Framed[Device], scan: Scan) -> RawSweeps | None:
        """Decode sweeps that may be padded to one width."""
        rows, beams = found.rows, found.beams
        scale, topic = self.options.range_scale, self._names.topic(found.kind)
        before = len(lines.bad)
        values = lines.flat(rows, scan.count + 1, scan.width * beams, scale)
        uneven = np.zeros(len(rows), np.bool_)
        if found.kind.interface == b"laser":
            known = _of_laser(lines, rows, beams, scan)
            if scan.angles:
                first, step, uneven = _of_bearings(values[1 :: scan.width].astype(np.float64), beams)
                known = known._replace(first=first, step=step)
        else:
            # Lines of a ranger say more than its configuration.
            configs = self.state.at(topic, rows + lines.line, _CONFIG)
            if scan.tail:
                _, own = _tails(lines, rows, found.after)
                configs = np.where(np.isnan(own[:, :1]), configs, own)
            known = _of_configs(configs, beams)
        first, step = self.bearings(known.first, known.step, beams)
        good = ~np.isin(rows, [row for row, _ in lines.bad[before:]])
        self.refuse(topic, _UNEVEN, int((good & uneven).sum()))
        good &= ~uneven
        unknown = np.isnan(first) | np.isnan(step)
        self.refuse(topic, _NO_GEOMETRY, int((good & unknown).sum()))
        with np.errstate(invalid="ignore"):
            least, most = (np.where(known.least > 0, known.least, 0.0), np.where(known.most > 0, known.most, np.inf))
            limits = limits_in_metres(least, most, scale)
        ranges = pad(values[:: scan.width], beams, scale)
        # The intensity of a return is the last cell of its beam.
        intensities = pad(values[scan.width - 1 :: scan.width], beams, 1.0) if scan.width > 1 else None
        frame = self._names.frame(found.kind)
        return self.block(topic, frame, found, (first, step), limits, ranges, good & ~unknown, intensities)

    def poses_of(self, lines: LineBlock, found: Found[Device]) -> Iterator[PlanarPoses]:
        """Decode poses of robots and places of sensors; keep the mounts of sensors."""
        device, types, names = found.kind, self.types or (), self._names
        if device.mount is not None:
            self._take_mount(lines, found, device.mount)
        elif device.odometry is not None and ODOMETRY_TYPE in types:
            good, poses = lines.poses(found.rows, device.odometry)
            found = found.of(good)
            world = f"{names.prefix(device.robot)}odom{device.number or ''}"
            yield PlanarPoses(
                names.topic(device), ODOMETRY_TYPE, world, names.base(device), found.rows, found.stamp_ns, poses
            )
        elif device.scan is not None and (path := names.path(device)) is not None and POSE_TYPE in types:
            sweeps, _ = _framed(lines, found, device.scan)
            if device.scan.pose is not None:
                good, poses = lines.poses(sweeps.rows, device.scan.pose)
            else:
                places, _ = _tails(lines, sweeps.rows, sweeps.after)
                good = np.flatnonzero(~np.isnan(places).any(axis=1))
                poses = places[good]
            sweeps = sweeps.of(good)
            world, frame = f"{names.prefix(device.robot)}map", names.frame(device)
            yield PlanarPoses(path, POSE_TYPE, world, frame, sweeps.rows, sweeps.stamp_ns, poses)

    def _take_mount(self, lines: LineBlock, found: Found[Device], columns: list[int]) -> None:
        """Keep the latest place of a sensor on its robot."""
        width = max(columns) + 1
        rows = found.rows[lines.cells.count[found.rows] >= _DATA + width]
        _, values = lines.numbers(rows, _DATA, width, "its place: ")
        if not len(values):
            return
        frame = self._names.frame(found.kind)
        told = values[-1, columns]
        if np.abs(told[POSE:]).max(initial=0.0) > _LEVEL:
            self.note(f"{frame}: mounted with a tilt, which is not read: its place is left out")
        else:
            self._mounts[frame] = self._names.base(found.kind), told[:POSE].tolist()

    def mount(self, frame: str) -> tuple[str, Sequence[float]] | None:
        """Return the latest place of a sensor."""
        return self._mounts.get(frame)


def _framed(lines: LineBlock, found: Found[Device], scan: Scan) -> tuple[Framed[Device], Declared]:
    """Return the sweeps whose ranges are whole; lines that are none are bad."""
    cells, rows = lines.cells, found.rows
    declared = lines.declared(rows, scan.count, scan.width)
    causes = declared.causes
    if not scan.tail:
        over = cells.count[rows] - declared.after
        for at in np.flatnonzero(over > 0).tolist():
            causes.setdefault(at, left_over(int(over[at]), int(declared.beams[at])))
    last = len(rows) - 1
    # Without a line end the last number may be cut: that matters unless it stands beside a range.
    if rows[last] == lines.cut and (scan.width == 1 or not declared.beams[last] or last in causes):
        causes[last] = CUT
    lines.bad += [(int(rows[at]), cause) for at, cause in causes.items() if at not in declared.refused]
    sweeps = Framed(found.kind, rows, found.stamp_ns, declared.beams, declared.after)
    return sweeps.of(declared.sound), declared


def _of_laser(lines: LineBlock, rows: Int64, beams: Int64, scan: Scan) -> _Geometry:
    """Return the geometry in lines of a laser; rows with a cell that is no number are bad."""
    known = np.full((len(rows), 4), np.nan)
    for at, width, into in ((scan.geometry, 3, slice(0, 3)), (scan.most, 1, slice(3, 4))):
        if at is not None:
            good, values = lines.numbers(rows, at, width)
            known[good, into] = values
    first, last, step, most = known.T
    step = np.where(step == 0.0, (last - first) / np.maximum(beams - 1, 1), step)
    return _Geometry(first, step, np.zeros(len(rows)), most)


def _of_bearings(bearings: Float64, beams: Int64) -> tuple[Float64, Float64, Bool]:
    """Return geometry by the bearings of all beams of R sweeps, one after the other.

    Returns
    -------
    first, step : (R,) [rad]
    uneven : (R,) True where beams are not evenly spread
    """
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
        odd = ~(np.abs(bearings - expected) <= _MOST_UNEVEN * np.abs(step[row]))
    return first, step, np.bincount(row, odd, len(beams)) > 0


def _of_configs(configs: Float64, beams: Int64) -> _Geometry:
    """Return the geometry in configurations (R, 7) of a ranger; drivers without one answer with zeros."""
    first, last, step, least, most = configs.T[:5]
    first = np.where((first == last) & (step == 0.0), np.nan, first)
    return _Geometry(first, full_steps(last - first, step, beams, _ROUNDED), least, most)


def _tails(lines: LineBlock, rows: Int64, after: Int64) -> tuple[Float64, Float64]:
    """Return the fields behind the ranges of a ranger; rows whose fields are something else are bad.

    The first field is 0 where no geometry follows; the configuration comes last, behind a mark of some writers.

    Returns
    -------
    (R, 3) places x, y, yaw and (R, 7) configurations; NaN without
    """
    cells = lines.cells
    places, configs = np.full((len(rows), POSE), np.nan), np.full((len(rows), _CONFIG), np.nan)
    left = cells.spans(rows, after, np.maximum(cells.count[rows] - after, 0))
    for at, text in enumerate(left):
        fields = text.split(b" ") if text else []
        try:
            config = _behind_geometry(fields)
            if len(config) not in (0, 1, _CONFIG, _CONFIG + 1):
                raise ValueError
            if len(config) >= _CONFIG:
                configs[at] = [float(field) for field in config[-_CONFIG:]]
            if fields and fields[0].strip(b"0"):
                places[at] = [float(fields[cell]) for cell in (1, 2, 6)]
        except (ValueError, IndexError):
            lines.bad.append((int(rows[at]), "what stands behind its ranges is no geometry"))
    return places, configs


def _behind_geometry(fields: list[bytes]) -> list[bytes]:
    """Return the fields behind a geometry: nine numbers, then poses and sizes of the parts, each with a count."""
    if not fields or not fields[0].strip(b"0"):
        return fields[1:]
    place = 1 + 9
    for width in (6, 3):
        place += 1 + width * int(fields[place])
    if place > len(fields):
        raise ValueError
    return fields[place:]


def _configs(cells: Cells, rows: Int64) -> Iterator[tuple[int, list[float]]]:
    """Yield row and numbers of each response that is the configuration of a ranger."""
    some = rows[cells.count[rows] == _DATA + _CONFIG]
    numbers = cells.numbers(some, _DATA, np.full(len(some), _CONFIG), np.float64)
    for at, values in enumerate(numbers.values.reshape(-1, _CONFIG).tolist()):
        if at not in numbers.bad:
            yield int(some[at]), values


class PlayerLog(LineLog):
    """A Player log."""

    format = "player"
    grammar = PlayerGrammar

    def _count(self, blocks: Iterable[TextBlock]) -> dict[tuple[str, str], int | None]:
        names, counts = _Names(), dict[Device, int]()
        for block in blocks:
            for device, rows in _by_device(cells_of(block.text), [], -1).items():
                names.prefix(device.robot)
                counts[device] = counts.get(device, 0) + len(rows)
        found = dict[tuple[str, str], int]()
        sensors, mounted = set[str](), set[str]()
        for device, lines in counts.items():
            topics = []
            if device.scan is not None:
                topics.append((names.topic(device), LASERSCAN))
                sensors.add(names.frame(device))
            if device.odometry is not None:
                topics.append((names.topic(device), ODOMETRY_TYPE))
            if (path := names.path(device)) is not None:
                topics.append((path, POSE_TYPE))
            if device.mount is not None:
                mounted.add(names.frame(device))
            for topic in topics:
                found[topic] = found.get(topic, 0) + lines
        if mounts := len(sensors & mounted):
            found[MOUNTS, MOUNT_TYPE] = mounts
        return {**found}
