"""ARIA logs (`.2d`, also packed with gzip): lines of a tag, a word with a colon, and data in mm and degrees."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.aria_points import Points, Readings, by_bearing
from lidarcli.logs.base import LASERSCAN, MAX_BEAMS
from lidarcli.logs.beginnings import ARIA_TITLE
from lidarcli.logs.blocks import TOO_MANY, as_singles, pad, split_rows
from lidarcli.logs.lines import CUT, POSE, TELL_BEARINGS, WITHOUT_TIMES, Found, Framed, Grammar, LineBlock, LineLog
from lidarcli.logs.numbers import not_a_number, say
from lidarcli.logs.planar import MOUNT_TYPE, MOUNTS, ODOMETRY, ODOMETRY_TYPE, POSE_TYPE, ROBOT, PlanarPoses
from lidarcli.logs.text import TextBlock
from lidarcli.logs.times import S, to_ns
from lidarcli.sweeps import Bool, Float32, Float64, Int64, RawSweeps

_VERSION, _CREATED = b"version:", b"#Created"
_TIMES = (b"time:", b"logTime:")
"""Tags of seconds since the start of the log; since version 4 the second one is written."""
_ROBOT_POSE, _GLOBAL_POSE = b"robot:", b"robotGlobal:"
_POSES = {_ROBOT_POSE: (ODOMETRY, ODOMETRY_TYPE, "odom"), _GLOBAL_POSE: ("/corrected", POSE_TYPE, "map")}
"""Tag of x, y, heading of the robot → topic, type and parent frame. Only the odometry is used unless the user asks."""
_TAG = re.compile(rb"[A-Za-z_][\w-]{0,63}:")
"""Tag of a line; lines whose tags are not known are skipped."""
_SENSOR = re.compile(rb"(sick|scan|urg|laser|lms|lidar)(\d{0,3})(pose|conf)?:")
_LONGEST_TAG = 80

_OF_DAY = re.compile(rb"(\d{1,2}):(\d{1,2}):(\d{1,2})")
_ARIA = (b"ARIA", b"ArLaserLogger", b"ArSickLogger")
_PADDED = 4
"""First version in which milliseconds of times have leading zeros."""
_NO_TIME = "its time is none"

_MILLI = 0.001
"""Metres in the unit of lengths."""
_LEAST_STEP = 0.02
"""Least step between beams of any laser [degrees]."""
_FEW, _SPARSE = 1000, 2
"""Beams that a sweep of points may have, in all or for each number in its line, however few points there are."""
_FAR_FEWER = "far fewer points than the laser has beams"


@dataclass(frozen=True, slots=True)
class Sensor:
    """A laser by the tag of its lines."""

    name: str
    number: int
    part: str = ""
    """`pose`, `conf`, or empty for a sweep."""

    @property
    def topic(self) -> str:
        """The topic of its sweeps."""
        return f"/{self.name}{self.number}"

    @property
    def frame(self) -> str:
        """Its frame: `sick` and `scan` with the same number are one laser, written in two ways."""
        return f"{'laser' if self.is_points or self.name == 'sick' else self.name}{self.number}"

    @property
    def is_points(self) -> bool:
        """True where sweeps are points, unless their number of fields says otherwise."""
        return self.name == "scan"


def sensor_of(word: bytes) -> Sensor | None:
    """Return the sensor that a tag names; None where it names none.

    >>> sensor_of(b"sick1conf:")
    Sensor(name='sick', number=1, part='conf')
    >>> sensor_of(b"scan1Id:")
    """
    match = _SENSOR.fullmatch(word)
    if match is None:
        return None
    name, number, part = match.groups(b"")
    return Sensor(name.decode(), int(number or 1), part.decode())


def _is_unpadded(created: bytes, version: bytes) -> bool:
    """Tell whether milliseconds have no leading zeros: ARIA itself wrote them so up to version 3."""
    return any(name in created for name in _ARIA) and not (version.isdigit() and int(version[:9]) >= _PADDED)


def _seconds(cell: bytes, unpadded: bool) -> bytes:
    """Return a time in seconds: a time of day as other programs write it, milliseconds without leading zeros.

    >>> _seconds(b"12:30:01", False), _seconds(b"12.5", True)
    (b'45001', b'12.005')
    """
    if unpadded:
        whole, point, fraction = cell.partition(b".")
        return whole + point + fraction.rjust(3, b"0")
    match = _OF_DAY.fullmatch(cell)
    if match is None:
        return cell
    hours, minutes, seconds = map(int, match.groups())
    return b"%d" % (3600 * hours + 60 * minutes + seconds)


def _metres(poses: Float64) -> Float64:
    """Convert poses (K, 3) from mm and degrees to metres and radians."""
    return np.column_stack([poses[:, :2] * _MILLI, np.radians(poses[:, 2])])


AriaLines = Found[Sensor | bytes]
"""Sweeps of a sensor, or poses with one tag."""


@dataclass(frozen=True, eq=False, slots=True)
class _Sweeps(Framed[Sensor]):
    """R sweeps of one laser, whose numbers follow the tag."""

    points: Bool
    """(R,) True for sweeps of points."""
    conf: Float64
    """(R, 3) First and last angle [degrees], number of samples; NaN where they are not known."""

    @property
    def count(self) -> Int64:
        """(R,) Numbers in each line."""
        return self.after - 1


@dataclass(slots=True)
class _Clock:
    """Time that holds for the next line."""

    now_ns: int = 0
    known: bool = True
    """False where the last time could not be read."""
    robot_ns: int | None = None
    """Stamp of the robot's pose, where one has come since: sweeps behind it were taken there."""


@dataclass
class AriaGrammar(Grammar[AriaLines]):
    """One pass over an ARIA log."""

    _version: bytes = b""
    _created: bytes = b""
    _timed: bool = False
    """True once the log has had a time."""
    _clock: _Clock = field(default_factory=_Clock)
    _readings: Readings = field(init=False)

    def __post_init__(self) -> None:
        self._readings = Readings(self.report)

    def read(self, lines: LineBlock) -> list[AriaLines]:
        """Find sweeps and poses with the times before them; keep poses and angles of sensors."""
        by_tag = self._tags(lines)
        times = np.array(sorted(row for tag in _TIMES for row in by_tag.get(tag, [])), np.int64)
        stamps, known = self._times(lines, times)
        self._timed = self._timed or len(times) > 0
        robot = self._stamped(lines, _ROBOT_POSE, by_tag.pop(_ROBOT_POSE, []), times, stamps, known)
        found: list[AriaLines] = [robot]
        facts: list[tuple[int, tuple[str, str], list[float]]] = []
        sweeps: dict[Sensor, list[int]] = {}
        for tag, some in by_tag.items():
            sensor = sensor_of(tag)
            if sensor is not None and sensor.part:
                facts += _facts(lines, sensor, np.array(some, np.int64))
            elif sensor is not None:
                sweeps.setdefault(sensor, []).extend(some)
            elif tag == _GLOBAL_POSE:
                found.append(self._stamped(lines, tag, some, times, stamps, known, robot))
        for sensor, some in sweeps.items():
            found.append(self._stamped(lines, sensor, sorted(some), times, stamps, known, robot))
        if sweeps and not self._timed:
            self.note(WITHOUT_TIMES)
        if len(times):
            self._clock = _Clock(int(stamps[-1]), bool(known[-1]))
        if len(robot.rows) and (not len(times) or robot.rows[-1] > times[-1]):
            self._clock.robot_ns = int(robot.stamp_ns[-1])
        self.state.add(lines.line, sorted(facts, key=lambda fact: fact[0]))
        return found

    def _tags(self, lines: LineBlock) -> dict[bytes, list[int]]:
        """Return the rows of each tag; lines without one are bad."""
        by_tag = lines.by_keyword()
        for row in by_tag.get(_CREATED, []):
            self._created = self._created or _rest(lines, row)
        for word in [word for word in by_tag if not _TAG.fullmatch(word)]:
            rows = by_tag.pop(word)
            if word and word != ARIA_TITLE and word[:1] != b"#":
                lines.bad += [(row, CUT if row == lines.cut else f"{say(word)} is no tag") for row in rows]
        if lines.cut in by_tag.get(_ROBOT_POSE, []):
            by_tag[_ROBOT_POSE].remove(lines.cut)
            lines.bad.append((lines.cut, CUT))
        if _VERSION in by_tag:
            self._version = self._version or _rest(lines, by_tag[_VERSION][0])
        return by_tag

    def _times(self, lines: LineBlock, rows: Int64) -> tuple[Int64, Bool]:
        """Return the times [ns] in some lines, and (R,) True where they can be read."""
        unpadded = _is_unpadded(self._created, self._version)
        cells = lines.cells.spans(rows, 1, np.minimum(lines.cells.count[rows] - 1, 1))
        texts = [_seconds(cell, unpadded) for cell in cells]
        stamps, wrong = to_ns(texts, S)
        for at in np.flatnonzero(wrong).tolist():
            lines.bad.append((int(rows[at]), f"{say(texts[at])} is no time"))
        return stamps, ~wrong

    def _stamped(
        self,
        lines: LineBlock,
        kind: Sensor | bytes,
        some: list[int],
        times: Int64,
        stamps: Int64,
        known: Bool,
        robot: AriaLines | None = None,
    ) -> AriaLines:
        """Give lines the time before them, or that of the robot's pose which has come since."""
        rows = np.array(some, np.int64)
        at = np.searchsorted(times, rows) - 1
        clock = self._clock
        before = at < 0
        ns = np.where(before, clock.now_ns, np.append(stamps, 0)[at])
        good = np.where(before, clock.known, np.append(known, False)[at])
        if robot is not None:
            since = np.searchsorted(robot.rows, rows) - 1
            begin = np.where(before, -1, np.append(times, 0)[at])
            here = (since >= 0) & (np.append(robot.rows, 0)[since] > begin)
            ns = np.where(here, np.append(robot.stamp_ns, 0)[since], ns)
            if clock.robot_ns is not None:
                ns = np.where(before & (since < 0), clock.robot_ns, ns)
        lines.bad += [(row, _NO_TIME) for row in rows[~good].tolist()]
        name = kind if isinstance(kind, bytes) else kind.topic.encode()
        return Found(kind, rows[good], self.distinct.of(name, ns[good]))

    def frame(self, found: AriaLines) -> str | None:
        """Return the frame of a laser."""
        return found.kind.frame if isinstance(found.kind, Sensor) else None

    def sweeps_of(self, lines: LineBlock, found: AriaLines) -> Iterator[RawSweeps]:
        """Decode sweeps of one laser: ranges, or points."""
        sensor = found.kind
        if isinstance(sensor, Sensor) and (self.topics is None or sensor.topic in self.topics):
            sweeps = self._framed(lines, sensor, found)
            for part in split_rows(np.maximum(sweeps.beams, sweeps.count)):
                block = self._decode(lines, sweeps.of(part))
                if block is not None:
                    yield block

    def _framed(self, lines: LineBlock, sensor: Sensor, found: AriaLines) -> _Sweeps:
        """Return the sweeps of a laser with their numbers of beams; lines that are none are bad."""
        rows = found.rows
        conf = self.state.at((sensor.frame, "conf"), rows + lines.line, 3)
        # A logger that starts before its laser writes zeros.
        conf[~((conf[:, 2] >= 1) & (conf[:, 2] <= 1e9))] = np.nan
        samples = np.nan_to_num(conf[:, 2], nan=-1).astype(np.int64)
        count = lines.cells.count[rows] - 1
        points = _are_points(sensor, samples, count)
        # By their bearings points make as many beams as the laser has; in their order they are the beams.
        beams = np.where(points, np.where(samples < 0, count // 2, samples), count)
        many = np.maximum(beams, count // 2) > MAX_BEAMS
        sparse = points & ~many & (beams > np.maximum(_FEW, _SPARSE * count))
        self.refuse(sensor.topic, TOO_MANY, int(many.sum()))
        self.refuse(sensor.topic, _FAR_FEWER, int(sparse.sum()))
        odd = points & (count % 2 == 1) & ~many
        cut = rows == lines.cut
        lines.bad += [(row, "a point has one number only") for row in rows[odd & ~cut].tolist()]
        lines.bad += [(row, CUT) for row in rows[cut].tolist()]
        sweeps = _Sweeps(sensor, rows, found.stamp_ns, beams, count + 1, points, conf)
        return sweeps.of(~many & ~odd & ~sparse & ~cut)

    def _decode(self, lines: LineBlock, found: _Sweeps) -> RawSweeps | None:
        """Decode sweeps that may be padded to one width."""
        sensor, rows, conf = found.kind, found.rows, found.conf
        numbers = lines.cells.numbers(rows, 1, found.count, np.float64)
        lines.bad += [(int(rows[row]), not_a_number(cell)) for row, cell in numbers.bad.items()]
        good = np.ones(len(rows), np.bool_)
        good[[*numbers.bad]] = False
        with np.errstate(invalid="ignore", divide="ignore"):
            gaps = np.maximum(conf[:, 2] - 1, 1)
            # ARIA writes -180 degrees as 180: of a full circle hardly any view is left then.
            narrow = np.abs(conf[:, 1] - conf[:, 0]) < _LEAST_STEP * gaps
            begin = np.where(narrow & (conf[:, 2] > 1), conf[:, 0] - 360.0, conf[:, 0])
            first, step = np.radians(begin), np.radians(conf[:, 1] - begin) / gaps
        first, step = self.bearings(first, step, found.beams)
        if found.points.any():
            # Angles beyond all numbers are refused below.
            with np.errstate(over="ignore", invalid="ignore"):
                first, step, ranges = self._of_points(lines, found, numbers.values, first, step)
        else:
            ranges = pad(numbers.values, found.count, _MILLI)
        unknown = good & (np.isnan(first) | np.isnan(step))
        cause = f"no angles of {sensor.name}{sensor.number} before it {TELL_BEARINGS}"
        self.refuse(sensor.topic, cause, int(unknown.sum()))
        limits = np.zeros(len(rows), np.float32), np.full(len(rows), np.inf, np.float32)
        return self.block(sensor.topic, sensor.frame, found, (first, step), limits, ranges, good & ~unknown)

    def _of_points(
        self, lines: LineBlock, found: _Sweeps, values: Float64, first: Float64, step: Float64
    ) -> tuple[Float64, Float64, Float32]:
        """Return first bearings, steps and ranges of sweeps of which some or all are points."""
        sensor, rows, beams, points = found.kind, found.rows, found.beams, found.points
        version = int(self._version[:9]) if self._version.isdigit() else 0
        mount = _metres(np.nan_to_num(self.state.at((sensor.frame, "pose"), rows + lines.line, POSE)))
        sizes = np.where(points, found.count // 2, 0)
        row = np.repeat(np.arange(len(rows)), sizes)
        place = np.arange(len(row)) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        pairs = values[np.repeat(points, found.count)].reshape(-1, 2) * _MILLI
        cloud = Points(pairs[:, 0], pairs[:, 1], row, place, mount)
        last = first + (beams - 1) * step
        how = self._readings.of(sensor.topic, version, cloud, first[row] + place * step[row], last[row] - place * step[row])
        if how.backwards:
            first, step = np.where(points, last, first), np.where(points, -step, step)
        ranges, bearing = cloud.seen(how)
        ranges = np.where(cloud.there, ranges, 0.0)
        flat = np.empty(int(beams.sum()))
        in_order = points & (sizes == beams) & how.in_order
        beam_row = np.repeat(np.arange(len(rows)), beams)
        flat[in_order[beam_row]] = ranges[in_order[row]]
        flat[~points[beam_row]] = values[~np.repeat(points, found.count)] * _MILLI
        turned = points & ~in_order
        if turned.any():
            mine = turned[row]
            cloud = Points(cloud.x[mine], cloud.y[mine], row[mine], place[mine], mount)
            sizes = np.where(turned, beams, 0)
            placed, lost = by_bearing(ranges[mine], bearing[mine], cloud, first, step, sizes)
            flat[turned[beam_row]] = placed
            for at in np.flatnonzero(lost).tolist():
                self.report.add_damage(
                    f"line {lines.line + int(rows[at])}", f"{lost[at]} points are beside the view of the laser"
                )
        return first, step, pad(as_singles(flat), beams, 1.0)

    def poses_of(self, lines: LineBlock, found: AriaLines) -> Iterator[PlanarPoses]:
        """Decode poses of the robot."""
        if isinstance(found.kind, Sensor):
            return
        topic, kind, world = _POSES[found.kind]
        if kind in (self.types or ()):
            # A localisation that does not know where the robot is leaves its line empty.
            found = found.of(lines.cells.count[found.rows] > 1)
            good, poses = lines.poses(found.rows, 1)
            found = found.of(good)
            yield PlanarPoses(topic, kind, world, ROBOT, found.rows, found.stamp_ns, _metres(poses))

    def mount(self, frame: str) -> tuple[str, Sequence[float]] | None:
        """Return the latest place of a laser."""
        place = self.state.last((frame, "pose"))
        return None if place is None else (ROBOT, _metres(np.array([place]))[0].tolist())


def _rest(lines: LineBlock, row: int) -> bytes:
    """Return the text behind the tag of a line."""
    return lines.cells.spans(np.array([row]), 1, lines.cells.count[row : row + 1] - 1)[0]


def _facts(lines: LineBlock, sensor: Sensor, rows: Int64) -> list[tuple[int, tuple[str, str], list[float]]]:
    """Return row, name and three numbers of each fact: x, y, heading, or first and last angle and number of samples."""
    facts = []
    count = lines.cells.count[rows]
    # Poses of version 4 have a height before the heading.
    for width, columns in ((3, [0, 1, 2]), (4, [0, 1, 3] if sensor.part == "pose" else [0, 1, 2])):
        some = rows[count == width + 1]
        good, values = lines.numbers(some, 1, width)
        facts += [
            (row, (sensor.frame, sensor.part), each)
            for row, each in zip(some[good].tolist(), values[:, columns].tolist(), strict=True)
        ]
    odd = rows[(count != 4) & (count != 5)]
    lines.bad += [(row, "three numbers are expected here") for row in odd.tolist()]
    return facts


def _are_points(sensor: Sensor, samples: Int64, count: Int64) -> Bool:
    """(R,) True for lines of points: two numbers for each sample, or by their tag where numbers leave it open."""
    usual = np.full(len(count), sensor.is_points)
    told = (samples > 0) & ((count == samples) | (count == 2 * samples))
    return np.where(told, count == 2 * samples, usual)


class AriaLog(LineLog):
    """An ARIA log."""

    format = "aria"
    grammar = AriaGrammar

    def _count(self, blocks: Iterable[TextBlock]) -> dict[tuple[str, str], int | None]:
        sweeps: dict[Sensor, int] = {}
        poses: dict[bytes, int] = {}
        mounted: set[str] = set()
        for block in blocks:
            for line in block.text.split(b"\n"):
                first = line[:_LONGEST_TAG].split(None, 1)
                if not first or first[0][-1:] != b":":
                    continue
                sensor = sensor_of(first[0])
                if sensor is not None and sensor.part == "pose":
                    mounted.add(sensor.frame)
                elif sensor is not None and not sensor.part:
                    sweeps[sensor] = sweeps.get(sensor, 0) + 1
                elif first[0] in _POSES:
                    poses[first[0]] = poses.get(first[0], 0) + 1
        mounts = len({sensor.frame for sensor in sweeps} & mounted)
        found: dict[tuple[str, str], int | None] = {(sensor.topic, LASERSCAN): n for sensor, n in sweeps.items()}
        found |= {_POSES[tag][:2]: n for tag, n in poses.items()}
        return found | ({(MOUNTS, MOUNT_TYPE): mounts} if mounts else {})
