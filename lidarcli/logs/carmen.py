"""CARMEN logs (`.log`, `.clf`, `.gfs`, also packed with gzip): sweeps, poses, and the parameters that describe lasers."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lidarcli.logs.base import LASERSCAN, ReadReport
from lidarcli.logs.blocks import as_singles, limits_in_metres, pad, split_rows
from lidarcli.logs.carmen_lines import FRONT, LASERS, ODOM, REAR, TRUEPOS, CarmenLines, Framing, Laser, has_pose
from lidarcli.logs.lines import POSE, Grammar, LineBlock, LineLog, count_in, full_steps, gives_geometry, is_number
from lidarcli.logs.numbers import Cells, not_a_number, pad_cells
from lidarcli.logs.planar import MOUNT_TYPE, MOUNTS, ODOMETRY, ODOMETRY_TYPE, POSE_TYPE, ROBOT, PlanarPoses, wrapped
from lidarcli.logs.text import TextBlock
from lidarcli.sweeps import Bool, Float32, Float64, Int64, RawSweeps

CORRECTED, TRUE = "/corrected", "/truepos"
TYPES = {ODOMETRY: ODOMETRY_TYPE, CORRECTED: POSE_TYPE, TRUE: POSE_TYPE, MOUNTS: MOUNT_TYPE}
"""Topic → its type. Poses are taken from the odometry unless the user asks for others."""
MAX_RANGE = 80.0
"""Greatest range [m] of a sweep whose line has none: SICK lasers write greater ones for no return.

The parameters `robot_front_laser_max` and `robot_rear_laser_max` are no such limit: they are the range up to which programs
of the robot used returns, and lines also hold what was measured beyond. A range of just this value is cut off.
"""
_GEOMETRY = 2
"""Cell with the first bearing; view, step and greatest range follow."""
_ROUNDED = 6e-7
"""Greatest error [rad] of a step with six decimals."""

_SPOKEN = {FRONT: "front", REAR: "rear"}
_PARAMETERS = {
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
"""Frame and quantity → name of the parameter. Views and steps are degrees, offsets metres and radians."""
_KNOWN = frozenset(_PARAMETERS.values())
_STARTS_NUMBER = re.compile(rb"[-+.\d]")

_STEPS = {181: 1.0, 180: 1.0, 361: 0.5, 360: 0.5, 401: 0.25, 400: 0.25}
"""Ranges → degrees from beam to beam of the SICK lasers that wrote logs without geometry."""
_WITHOUT_LAST = [beams for beams in _STEPS if beams % 2 == 0]
"""Those whose view ends one step beyond the last range."""
_FIRST = {401: -50.0, 400: -50.0}
"""Ranges → first bearing [degrees]; -90 for all others."""
_SLACK = 1.5
"""Greatest difference between the number of ranges and that of view and step."""

_FARTHEST = 2.0
"""Greatest distance of a laser from the middle of its robot [m]."""
_SAME = 1e-6
"""Greatest difference [m, rad] between poses of laser and robot that are one pose."""
_ALIKE = 0.01
"""Greatest change of a laser's place on its robot [m, rad]; with a greater one its pose has been corrected."""
_LONGEST_WORD = 17


@dataclass(slots=True)
class _Mount:
    """Place of a laser on its robot, as the poses of both give it."""

    first: Float64
    spread: float = 0.0
    """Greatest change since then [m, rad]."""


@dataclass
class CarmenGrammar(Grammar[CarmenLines]):
    """One pass over a CARMEN log; a kind of line is its first word."""

    with_odom: bool = True
    """True where lines of odometry are read as poses, because no sweep holds any."""
    _framing: Framing = field(init=False)
    _wanted: set[bytes] = field(init=False)
    _noted: set[str] = field(default_factory=set)
    """Topics whose guessed bearings have been noted."""
    _mounts: dict[str, _Mount] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._framing = Framing(self.report, self.distinct)
        if self.types is not None:
            self._wanted = {*LASERS, TRUEPOS, *([ODOM] if self.with_odom else [])}
        else:
            topics = self.topics
            self._wanted = {word for word, laser in LASERS.items() if topics is None or laser.topic in topics}

    def read(self, lines: LineBlock) -> list[CarmenLines]:
        """Find the wanted messages; keep the parameters of lasers."""
        found, parameters = self._framing.read(lines, self._wanted)
        self.state.add(
            lines.line,
            [
                (row, name, (float(value),))
                for row, name, value in parameters
                if name in _KNOWN and _STARTS_NUMBER.match(value) and is_number(value)
            ],
        )
        return found

    def frame(self, found: CarmenLines) -> str | None:
        """Return the frame of a laser."""
        return LASERS[found.kind].frame if found.kind in LASERS else None

    def sweeps_of(self, lines: LineBlock, found: CarmenLines) -> Iterator[RawSweeps]:
        """Decode sweeps of one laser."""
        for part in split_rows(found.beams):
            block = self._decode(lines, found.of(part))
            lines.report_bad(self.report)
            if block is not None:
                yield block

    def _decode(self, lines: LineBlock, found: CarmenLines) -> RawSweeps | None:
        laser, rows, beams = LASERS[found.kind], found.rows, found.beams
        scale = self.options.range_scale
        values = lines.flat(rows, laser.count + 1, laser.width * beams, scale)
        bad = dict(lines.bad)
        if laser.geometry:
            told = lines.cells.numbers(rows, _GEOMETRY, np.full(len(rows), 4), np.float64)
            bad |= {int(rows[at]): not_a_number(cell) for at, cell in told.bad.items()}
            first, step, most = _of_lines(told.values.reshape(-1, 4), beams)
        else:
            first, step = self._of_parameters(laser, rows + lines.line, beams)
            most = np.full(len(rows), MAX_RANGE)
        lines.bad = list(bad.items())
        good = ~np.isin(rows, list(bad))
        ranges = pad(values[:: laser.width], beams, scale)
        if not laser.geometry:
            cut = self._parameter(laser.frame, "max", rows + lines.line)
            ranges[ranges == as_singles(cut * scale)[:, None]] = np.inf
        return self.block(
            laser.topic,
            laser.frame,
            found,
            self.bearings(first, step, beams),
            limits_in_metres(np.zeros(len(rows)), most, scale),
            ranges,
            good,
            _remissions(lines.cells, laser, found, values),
        )

    def _parameter(self, frame: str, what: str, lines: Int64) -> Float64:
        """(R,) Value of a parameter at each line; NaN before the first one."""
        return self.state.at(_PARAMETERS.get((frame, what)), lines, 1)[:, 0]

    def _of_parameters(self, laser: Laser, lines: Int64, beams: Int64) -> tuple[Float64, Float64]:
        """Return first bearings and steps of sweeps whose lines have none."""
        fov, resolution = (self._parameter(laser.frame, what, lines) for what in ("fov", "resolution"))
        first, step, guessed = bearings_of(beams, fov, resolution)
        if guessed.any() and laser.topic not in self._noted and not gives_geometry(self.options):
            self._noted.add(laser.topic)
            row = int(np.argmax(guessed))
            degrees = np.degrees([first[row], step[row]])
            self.report.notes.append(
                f"{laser.topic}: no geometry in the log; by its {beams[row]} ranges it is taken to begin at "
                f"{degrees[0]:g} degrees and to go on by {degrees[1]:.4g}; --angle-min and --angle-increment tell better"
            )
        return first, step

    def poses_of(self, lines: LineBlock, found: CarmenLines) -> Iterator[PlanarPoses]:
        """Decode the poses of robot and laser."""
        if found.kind in (ODOM, TRUEPOS):
            topic, world = (ODOMETRY, "odom") if found.kind == ODOM else (TRUE, "world")
            whole, poses = self._poses(lines, found.of(found.behind >= POSE), POSE)
            yield _track(topic, world, ROBOT, whole, poses)
            return
        laser = LASERS[found.kind]
        if not laser.posed:
            return
        # Remissions and their number stand before the poses; old writers have left them out.
        if laser.geometry:
            count = _remission_counts(lines.cells, found)
            skip = np.where((count >= 0) & (count + 1 + 2 * POSE <= found.behind), count + 1, 0)
            found = replace(found, after=found.after + skip, behind=found.behind - skip)
        both = found.behind >= 2 * POSE
        whole, poses = self._poses(lines, found.of(both), 2 * POSE)
        if len(poses):
            self._compare(laser.frame, poses)
            yield _track(CORRECTED, "map", laser.frame, whole, poses[:, :POSE])
            yield _track(ODOMETRY, "odom", ROBOT, whole, poses[:, POSE:])
        whole, poses = self._poses(lines, found.of((found.behind >= POSE) & ~both), POSE)
        if len(poses):
            # In logs of old writers no other line says where the robot was.
            yield _track(ODOMETRY, "odom", laser.frame, whole, poses)

    def _poses(self, lines: LineBlock, found: CarmenLines, count: int) -> tuple[CarmenLines, Float64]:
        """Return the messages with `count` numbers behind their ranges, and these (K, `count`)."""
        good, values = lines.numbers(found.rows, found.after, count, "its pose: ")
        lines.report_bad(self.report)
        return found.of(good), values

    def _compare(self, frame: str, poses: Float64) -> None:
        """Keep the place of a laser on its robot by poses (K, 6) of both, and how much it changes."""
        poses = poses[(np.abs(poses) < 1e9).all(axis=1)]
        if not len(poses):
            return
        dx, dy = poses[:, 0] - poses[:, 3], poses[:, 1] - poses[:, 4]
        cos, sin = np.cos(poses[:, 5]), np.sin(poses[:, 5])
        turn = wrapped(poses[:, 2] - poses[:, 5])
        mounts = np.column_stack([cos * dx + sin * dy, cos * dy - sin * dx, turn])
        mount = self._mounts.setdefault(frame, _Mount(mounts[0]))
        off = mounts - mount.first
        off[:, 2] = wrapped(off[:, 2])
        far = float(np.abs(mounts[:, :2]).max()) > _FARTHEST
        mount.spread = np.inf if far else max(mount.spread, float(np.abs(off).max()))

    def mount(self, frame: str) -> tuple[str, Sequence[float]] | None:
        """Return the place of a laser by parameters, else by the poses of laser and robot."""
        pose: Sequence[float] | None = self._mount_of_parameters(frame)
        mount = self._mounts.get(frame)
        if mount is not None and mount.spread <= _ALIKE:
            same = frame == FRONT and float(np.abs(mount.first).max()) <= _SAME
            # Where lines have one pose for both, whoever wrote them took no notice of the parameters.
            if pose is None or same:
                pose = mount.first.tolist()
        return None if pose is None else (ROBOT, pose)

    def _mount_of_parameters(self, frame: str) -> tuple[float, float, float] | None:
        """Return x, y [m] and yaw [rad] of a laser by the latest parameters; None without any.

        A rear laser looks backwards, unless its angle is given and says so itself.
        """
        told = {
            what: value[0]
            for what in ("forward", "side", "angular")
            if (value := self.state.last(_PARAMETERS.get((frame, what)))) is not None
        }
        if not told:
            return None
        yaw = told.get("angular", 0.0)
        if frame == REAR and abs(yaw) < 0.5 * np.pi:
            yaw += np.pi
        return told.get("forward", 0.0), told.get("side", 0.0), yaw


def _track(topic: str, parent: str, child: str, found: CarmenLines, poses: Float64) -> PlanarPoses:
    return PlanarPoses(topic, TYPES[topic], parent, child, found.rows, found.stamp_ns, poses)


def _remission_counts(cells: Cells, found: CarmenLines) -> Int64:
    """(R,) Count in the cell behind the ranges of each message; -1 where there is none."""
    counts = [count_in(cell) for cell in cells.spans(found.rows, found.after, np.minimum(found.behind, 1))]
    return np.array([-1 if count is None else count for count in counts], np.int64)


def _remissions(cells: Cells, laser: Laser, found: CarmenLines, ranges: NDArray[np.floating]) -> Float32 | None:
    """(S, B) Remissions of sweeps, NaN where one has fewer of them than ranges; None where none has any.

    They follow each of the `ranges`, or all of them with their number first.
    """
    beams = found.beams
    if laser.pairs:
        return pad(ranges[1::2], beams, 1.0) if len(ranges) else None
    if not laser.geometry:
        return None
    count = _remission_counts(cells, found)
    count = np.where(count < found.behind, np.clip(count, 0, beams), 0)
    if not count.any():
        return None
    return pad_cells(cells, found.rows, found.after + 1, count, int(beams.max()))


def _of_lines(told: Float64, beams: Int64) -> tuple[Float64, Float64, Float64]:
    """Return first bearings, steps [rad] and greatest ranges [m] by lines (S, 4): first bearing, view, step, range.

    Bearings are guessed where view and step are zero.
    """
    first, view, step, most = told.T
    nothing = (view == 0.0) & (step == 0.0)
    step = full_steps(view, step, beams, _ROUNDED)
    if nothing.any():
        none = np.full(len(beams), np.nan)
        guessed_first, guessed_step, _ = bearings_of(beams, none, none)
        first, step = np.where(nothing, guessed_first, first), np.where(nothing, guessed_step, step)
    with np.errstate(invalid="ignore"):
        return first, step, np.where(most > 0, most, MAX_RANGE)


def bearings_of(beams: Int64, fov: Float64, resolution: Float64) -> tuple[Float64, Float64, Bool]:
    """Return first bearings and steps of sweeps whose lines have none.

    Parameters
    ----------
    beams : (R,) ranges of each sweep
    fov, resolution : (R,) view and step by parameters [degrees]; NaN without

    Returns
    -------
    first, step : (R,) [rad]
    guessed : (R,) True where parameters say nothing, or contradict the number of ranges
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
    distinct, inverse = np.unique(beams, return_inverse=True)
    guesses = [(_STEPS.get(count, 180.0 / max(count - 1, 1)), _FIRST.get(count, -90.0)) for count in distinct.tolist()]
    guessed_step, guessed_first = np.array(guesses, np.float64).reshape(-1, 2)[inverse.ravel()].T
    told = by_step | by_view
    step = np.where(by_step, resolution, view / np.where(np.isin(beams, _WITHOUT_LAST), beams, gaps))
    step = np.where(told, step, guessed_step)
    first = np.where(told, -0.5 * view, guessed_first)
    return np.radians(first), np.radians(step), ~told


class CarmenLog(LineLog):
    """A CARMEN log."""

    format = "carmen"
    grammar = CarmenGrammar
    _posed = False
    """True where sweeps of the log hold poses."""

    def _count(self, blocks: Iterable[TextBlock]) -> dict[tuple[str, str], int | None]:
        counts = dict.fromkeys((*LASERS, ODOM, TRUEPOS), 0)
        with_pose: set[bytes] = set()
        unsure = {word for word, laser in LASERS.items() if laser.posed}
        for block in blocks:
            for line in block.text.split(b"\n"):
                first = line[:_LONGEST_WORD].split(None, 1)
                if not first or first[0] not in counts:
                    continue
                counts[first[0]] += 1
                if first[0] in unsure and has_pose(line, LASERS[first[0]]):
                    with_pose.add(first[0])
                    unsure.discard(first[0])
        self._posed = bool(with_pose)
        posed = sum(counts[word] for word in with_pose)
        found: dict[tuple[str, str], int | None] = {
            (laser.topic, LASERSCAN): counts[word] for word, laser in LASERS.items() if counts[word]
        }
        told = {ODOMETRY: posed or counts[ODOM], CORRECTED: posed, TRUE: counts[TRUEPOS]}
        mounted = bool(found and told[ODOMETRY])
        found |= {(name, TYPES[name]): count for name, count in told.items() if count}
        return found | ({(MOUNTS, MOUNT_TYPE): None} if mounted else {})

    def _grammar(self, report: ReadReport, topics: Collection[str] | None, types: Collection[str] | None) -> CarmenGrammar:
        if types is not None:
            # Where sweeps hold the robot's poses, other lines of odometry are skipped.
            self.topics()
        return CarmenGrammar(self._options, report, topics, types, with_odom=not self._posed)
