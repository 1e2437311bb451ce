"""Poses over time: rigid motions as arrays, the tracks that pose messages make, and trajectories as TUM text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple, TextIO

import numpy as np

from lidarcli.display.texts import clipped
from lidarcli.errors import UnreadableError
from lidarcli.logs.base import Message
from lidarcli.logs.clock import restarts
from lidarcli.options.times import SECOND_NS
from lidarcli.pose.messages import TRANSFORMS, PoseRows, _decode
from lidarcli.ros.foxglove import SCAN
from lidarcli.sweeps.types import Bool, Float64, Int64, SweepPoses

_STAMPS = np.iinfo(np.int64)


class PoseMotion(NamedTuple):
    """N poses of one frame in another; NaN where unknown."""

    position: Float64
    """(N, 3) metres."""
    rotation: Float64
    """(N, 4) unit quaternions x, y, z, w."""


def compose(outer: PoseMotion, inner: PoseMotion) -> PoseMotion:
    """Return the pose of c in a from that of b in a and that of c in b."""
    return PoseMotion(outer.position + rotate(outer.rotation, inner.position), multiply(outer.rotation, inner.rotation))


def inverse(motion: PoseMotion) -> PoseMotion:
    """Return the pose of a in b from that of b in a."""
    back = motion.rotation * np.array([-1.0, -1.0, -1.0, 1.0])
    return PoseMotion(-rotate(back, motion.position), back)


def multiply(first: Float64, second: Float64) -> Float64:
    """Return (N, 4) products of quaternions: the second rotation, then the first."""
    a, b = first[:, :3], second[:, :3]
    v, w = first[:, 3:], second[:, 3:]
    vector = v * b + w * a + np.cross(a, b)
    scalar = v * w - np.sum(a * b, axis=1, keepdims=True)
    return np.concatenate([vector, scalar], axis=1)


def rotate(rotation: Float64, vectors: Float64) -> Float64:
    """Return (N, 3) vectors turned by (N, 4) quaternions."""
    axis = rotation[:, :3]
    twice = 2.0 * np.cross(axis, vectors)
    turned: Float64 = vectors + rotation[:, 3:] * twice + np.cross(axis, twice)
    return turned


def interpolate(at_ns: Int64, stamp_ns: Int64, motion: PoseMotion, hold_ns: int = 0) -> PoseMotion:
    """Return poses at the times `at_ns` (S,) between those at `stamp_ns` (N, increasing), NaN outside their span.

    The first and the last pose hold for `hold_ns` before and after it: what stands there is no motion made up.

    Positions go along the straight line, rotations along the shortest arc at constant rate: in the plane that is linear
    in x, y and, by the shorter way round, in yaw.
    """
    if not len(stamp_ns):
        return PoseMotion(np.full((len(at_ns), 3), np.nan), np.full((len(at_ns), 4), np.nan))
    first, last = int(stamp_ns[0]), int(stamp_ns[-1])
    # A stamp may be as great as its type allows.
    earliest, latest = max(first - hold_ns, _STAMPS.min), min(last + hold_ns, _STAMPS.max)
    held = (at_ns >= earliest) & (at_ns <= latest)
    at_ns = np.where(held, np.clip(at_ns, first, last), at_ns)
    before = np.clip(np.searchsorted(stamp_ns, at_ns, side="right") - 1, 0, max(len(stamp_ns) - 2, 0))
    after = np.minimum(before + 1, len(stamp_ns) - 1)
    step = np.maximum(stamp_ns[after] - stamp_ns[before], 1)
    share = ((at_ns - stamp_ns[before]) / step)[:, None]
    share[(at_ns < first) | (at_ns > last)] = np.nan
    position = motion.position[before] * (1.0 - share) + motion.position[after] * share
    return PoseMotion(position, _arc(motion.rotation[before], motion.rotation[after], share))


def _arc(start: Float64, end: Float64, share: Float64) -> Float64:
    """Return (N, 4) rotations a share (N, 1) of the way from start to end."""
    cosine = np.sum(start * end, axis=1, keepdims=True)
    # A quaternion and its negative are one rotation; the nearer of the two is the shorter way.
    end = np.where(cosine < 0, -end, end)
    angle = np.arccos(np.clip(np.abs(cosine), 0.0, 1.0))
    # At smaller angles a straight line replaces the arc.
    wide = angle > 1e-4
    sine = np.where(wide, np.sin(angle), 1.0)
    first = np.where(wide, np.sin((1.0 - share) * angle) / sine, 1.0 - share)
    second = np.where(wide, np.sin(share * angle) / sine, share)
    between = first * start + second * end
    turned: Float64 = between / np.linalg.norm(between, axis=1, keepdims=True)
    return turned


UPRIGHT = 0.5
"""Sweeps are in a frame whose z axis is within 60 degrees of the vertical, either way up: the cosine of that."""


def planar(motion: PoseMotion) -> SweepPoses:
    """Return the poses viewed from above: the direction of the frame's x axis is the yaw.

    An upright frame is not upside down, on whichever side of 90 degrees rounding leaves it.
    """
    x, y, z, w = motion.rotation.T
    up = 1.0 - 2.0 * (x * x + y * y)
    yaw = np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return SweepPoses(x=motion.position[:, 0].copy(), y=motion.position[:, 1].copy(), yaw=yaw, upside_down=up < -UPRIGHT)


def flat(motion: PoseMotion) -> Float64:
    """Return x, y [m] and yaw [rad] (S, 3) of poses viewed from above."""
    there = planar(motion)
    return np.column_stack([there.x, there.y, there.yaw])


def lifted(pose: Sequence[float | Float64]) -> PoseMotion:
    """Return motions in the plane, x, y [m] and yaw [rad], as those in space."""
    x, y, yaw = map(np.atleast_1d, pose)
    none = np.zeros(len(x))
    return PoseMotion(np.column_stack([x, y, none]), np.column_stack([none, none, np.sin(0.5 * yaw), np.cos(0.5 * yaw)]))


def tilt(motion: PoseMotion) -> float:
    """Return the largest angle between the plane of the frame and the ground [rad], either way up; 0 without a pose."""
    x, y = motion.rotation[:, 0], motion.rotation[:, 1]
    flat = np.abs(1.0 - 2.0 * (x * x + y * y))
    known = flat[~np.isnan(flat)]
    return float(np.arccos(np.clip(known.min(), 0.0, 1.0))) if len(known) else 0.0


MAX_POSES, MAX_TRACKS = 2_000_000, 10_000
"""Most poses of one log that are kept, 64 bytes each, and most pairs of frames that are followed; others are left out."""
TOGETHER = 2048
TOGETHER_BYTES = 4 << 20
"""Messages of a topic that are decoded at once, and bytes of all that wait."""

SHIFTS, TURNS = 0.02, 0.02
"""Poses that differ by more show a motion [m, rad]."""

NOT_FINITE = "its pose is not finite"
NO_TURN = "its quaternion is zero"

HOLD_STEPS, HOLD_NS = 2, 100_000_000
"""Average steps for which the first and last pose of a track hold outside of its span, and longest such time [ns]: nobody
gets far in a tenth of a second."""


@dataclass(frozen=True, eq=False, slots=True)
class PoseTrack:
    """The poses of one frame in another that one topic gives, by increasing stamp."""

    topic: str
    type: str
    parent: str
    child: str
    """Empty where the messages do not name it."""
    static: bool
    """True if it holds for the whole log (/tf_static); the last pose counts."""
    messages: int
    """Number of poses; of runs of equal ones only the ends are kept."""
    stamp_ns: Int64
    """(N,) header stamps (record time where the header has none), each once."""
    motion: PoseMotion
    """N poses."""
    record_ns: tuple[int, int]
    """First and last record time."""
    jumps_back: int
    """Stamps at least a second before the previous one."""
    stretched: float = 0.0
    """Largest deviation of the length of a quaternion from 1, before it was made 1."""
    differs: bool = False
    """True for a static one that was sent with other numbers, too, and for one with several poses at one stamp."""
    parts: tuple[PoseTrack | None, ...] = ()
    """Its poses of each run of a log whose clock starts again, None for none; empty where all are of all runs."""

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last stamp."""
        return int(self.stamp_ns[0]), int(self.stamp_ns[-1])

    @property
    def seems_w_first(self) -> bool:
        """True if its quaternions seem to be written w first: a turning robot then only rolls.

        What goes straight ahead has 1 0 0 0 then, always; a sensor that hangs upside down turns a little as it goes.
        """
        x, y, z, w = np.abs(self.motion.rotation).T
        rolls = max(y.max(), z.max()) < 0.02 and (np.ptp(x) > 0.05 or max(y.max(), z.max(), w.max()) == 0.0)
        # A frame that has moved half a metre is no joint.
        return bool(rolls and np.ptp(self.motion.position[:, :2], axis=0).max() > 0.5)

    @property
    def rate(self) -> float | None:
        """Poses per second, on average; None for a single one."""
        if parts := [part for part in self.parts if part is not None]:
            return parts[0].rate
        seconds = (self.span_ns[1] - self.span_ns[0]) / SECOND_NS
        return (self.messages - 1) / seconds if seconds > 0 else None

    @property
    def moves(self) -> bool:
        """True if one of its frames moves in the other."""
        turned = np.abs(self.motion.rotation @ self.motion.rotation[0]).min() < np.cos(0.5 * TURNS)
        return bool(turned or np.ptp(self.motion.position, axis=0).max() > SHIFTS)

    @property
    def is_link(self) -> bool:
        """True for links of the tree of frames."""
        return self.type in TRANSFORMS or self.type == SCAN

    @property
    def is_identity(self) -> bool:
        """True if both frames are always one."""
        return not self.motion.position.any() and not self.motion.rotation[:, :3].any()

    @property
    def hold_ns(self) -> int:
        """Time for which its first and last pose hold outside of its span [ns]; 0 for a single pose."""
        return min(round(HOLD_STEPS * SECOND_NS / self.rate), HOLD_NS) if self.rate else 0

    def at(self, stamp_ns: Int64) -> PoseMotion:
        """Return the pose at each time, NaN where the track does not reach."""
        if self.static:
            last = np.full(len(stamp_ns), len(self.stamp_ns) - 1)
            return PoseMotion(self.motion.position[last], self.motion.rotation[last])
        return interpolate(stamp_ns, self.stamp_ns, self.motion, self.hold_ns)


TrackKey = tuple[str, str, str, str]
"""Topic, type, parent and child."""


@dataclass(slots=True)
class _Growing:
    """A track that is being read, in log order."""

    stamps: list[Int64] = field(default_factory=list)
    numbers: list[Float64] = field(default_factory=list)
    records: list[Int64] = field(default_factory=list)
    messages: int = 0
    record_ns: tuple[int, int] = (np.iinfo(np.int64).max, np.iinfo(np.int64).min)
    latest: int = -(1 << 62)
    before: int = -(1 << 62)
    """Stamp of the pose before."""
    jumps_back: int = 0
    stretched: float = 0.0

    def add(self, stamp_ns: Int64, numbers: Float64, record_ns: Int64) -> int:
        """Take poses in log order, and make their quaternions unit ones; return how many are kept."""
        numbers, off = _with_units(numbers)
        self.stretched = max(self.stretched, off)
        self.messages += len(stamp_ns)
        self.record_ns = (min(self.record_ns[0], int(record_ns.min())), max(self.record_ns[1], int(record_ns.max())))
        latest = np.maximum.accumulate(np.concatenate([[self.latest], stamp_ns]))
        before = np.maximum(np.concatenate([[self.before], stamp_ns[:-1]]), -(1 << 62))
        self.jumps_back += int(np.count_nonzero(stamp_ns <= before - SECOND_NS))
        self.before = max(int(stamp_ns[-1]), -(1 << 62))
        in_order = bool((stamp_ns >= latest[:-1]).all())
        self.latest = int(latest[-1])
        if in_order and len(stamp_ns) > 2:
            same = (numbers[1:] == numbers[:-1]).all(axis=1)
            kept = np.ones(len(stamp_ns), bool)
            kept[1:-1] = ~(same[:-1] & same[1:])
            stamp_ns, numbers, record_ns = stamp_ns[kept], numbers[kept], record_ns[kept]
        self.stamps.append(stamp_ns)
        self.numbers.append(numbers)
        self.records.append(record_ns)
        return len(stamp_ns)

    def restarts(self) -> list[int]:
        """Return the poses at which the clock starts again."""
        return restarts(np.concatenate(self.stamps)) if self.jumps_back else []

    def parts(self, key: TrackKey, lead: _Growing) -> tuple[PoseTrack | None, ...]:
        """Return the track of each run, by its own stamps or those of the track with most runs; none if nothing shows."""
        arrays = [np.concatenate(each) for each in (self.stamps, self.numbers, self.records)]
        cuts, borders = self.restarts(), lead.restarts()
        if len(cuts) != len(borders):
            records = np.concatenate(lead.records)
            if (np.diff(records) < 0).any():
                return ()
            cuts = np.searchsorted(arrays[2], records[borders]).tolist()
        parts = zip(*(np.split(each, cuts) for each in arrays), strict=True)
        return tuple(
            _Growing([stamps], [numbers], [records], len(stamps), (records.min(), records.max())).finish(key)
            if len(stamps)
            else None
            for stamps, numbers, records in parts
        )

    def finish(self, key: TrackKey) -> PoseTrack:
        """Return the sorted track; of several poses at one stamp the first counts, as in tf2; of static ones the last."""
        topic, kind, parent, child = key
        stamps, numbers = np.concatenate(self.stamps), np.concatenate(self.numbers)
        static = topic.rpartition("/")[2] == "tf_static"
        differs = static and bool(np.abs(numbers - numbers[-1:]).max() > 1e-6)
        if static:
            stamps, numbers = stamps[-1:], numbers[-1:]
        elif (np.diff(stamps) <= 0).any():
            order = np.argsort(stamps, kind="stable")
            stamps, numbers = stamps[order], numbers[order]
            is_first = np.append(True, stamps[1:] != stamps[:-1])
            firsts = numbers[is_first][np.cumsum(is_first) - 1]
            turned = np.abs((numbers[:, 3:] * firsts[:, 3:]).sum(axis=1)).min() < np.cos(0.5 * TURNS)
            differs = bool(turned or np.abs(numbers - firsts)[:, :3].max() > SHIFTS)
            stamps, numbers = stamps[is_first], numbers[is_first]
        motion = PoseMotion(numbers[:, :3], numbers[:, 3:])
        record = self.record_ns, self.jumps_back, self.stretched
        return PoseTrack(topic, kind, parent, child, static, self.messages, stamps, motion, *record, differs)


class PoseTracks:
    """Folds pose messages into tracks, in bounded memory."""

    def __init__(self, most: int = MAX_POSES) -> None:
        self.refused: Counter[tuple[str, str]] = Counter()
        """(topic, cause) → messages that cannot be a pose."""
        self.left_out = 0
        """Poses beyond the most that are kept, or of more frames than are followed."""
        self._room = most
        self._waiting: dict[tuple[str, str, str], tuple[list[int], list[bytes]]] = {}
        """Topic, type and encoding → record times and messages."""
        self._bytes = 0
        self._growing: dict[TrackKey, _Growing] = {}

    def add(self, messages: Iterable[Message]) -> None:
        """Take messages in log order."""
        for topic, kind, encoding, record_ns, message in messages:
            key = topic, kind, encoding
            if (waiting := self._waiting.get(key)) is None:
                waiting = self._waiting[key] = [], []
            waiting[0].append(record_ns)
            waiting[1].append(message)
            self._bytes += len(message)
            if len(waiting[0]) >= TOGETHER:
                self._flush(key)
            elif self._bytes >= TOGETHER_BYTES:
                self._flush_all()

    def finish(self) -> list[PoseTrack]:
        """Return all tracks, in the order in which they first appear."""
        self._flush_all()
        found = [growing.finish(key) for key, growing in self._growing.items()]
        lead = max(self._growing.values(), key=lambda growing: len(growing.restarts()), default=_Growing())
        if lead.jumps_back and lead.restarts():
            both = zip(found, self._growing.items(), strict=True)
            found = [one if one.static else replace(one, parts=its.parts(key, lead)) for one, (key, its) in both]
        return [track for track in found if track.type != SCAN or not track.is_identity]

    def _flush_all(self) -> None:
        for key in list(self._waiting):
            self._flush(key)

    def _flush(self, key: tuple[str, str, str]) -> None:
        topic, kind, encoding = key
        times, data = self._waiting.pop(key)
        self._bytes -= sum(map(len, data))
        refused: Counter[str] = Counter()
        found: dict[tuple[str, str], list[PoseRows]] = {}
        for rows in _decode(kind, encoding, data, refused):
            # No frame of a log begins with a slash: it is that of the sweeps of this topic.
            child = f"/{topic.strip('/')}" if kind == SCAN else rows.child
            found.setdefault((rows.parent, child), []).append(rows)
        record_ns = np.array(times, np.int64)
        for (parent, child), parts in found.items():
            self._take((topic, kind, parent, child), parts, record_ns, refused)
        for cause, count in refused.items():
            self.refused[(topic, cause)] += count

    def _take(self, key: TrackKey, parts: Sequence[PoseRows], record_ns: Int64, refused: Counter[str]) -> None:
        row = np.concatenate([part.row for part in parts])
        stamps = np.concatenate([part.stamp_ns for part in parts])
        numbers = np.concatenate([part.numbers for part in parts])
        order = np.argsort(row, kind="stable")
        row, stamps, numbers = row[order], stamps[order], numbers[order]
        keep = np.flatnonzero(_usable(numbers, refused))
        known = key in self._growing or len(self._growing) < MAX_TRACKS
        fits = max(self._room, 0) if known else 0
        self.left_out += max(len(keep) - fits, 0)
        row, stamps, numbers = row[keep[:fits]], stamps[keep[:fits]], numbers[keep[:fits]]
        if not len(row):
            return
        stamps = np.where(stamps == 0, record_ns[row], stamps)
        self._room -= self._growing.setdefault(key, _Growing()).add(stamps, numbers, record_ns[row])


def gathered(key: TrackKey, stamp_ns: Int64, numbers: Float64, record_ns: Int64, refused: Counter[str]) -> PoseTrack | None:
    """Return a track of N poses, (N, 7) x, y, z [m] and the quaternion's x, y, z, w; None without a usable one.

    `refused` counts the causes of poses that are left out.
    """
    keep = _usable(numbers, refused)
    if not keep.any():
        return None
    growing = _Growing()
    growing.add(stamp_ns[keep], numbers[keep], record_ns[keep])
    return growing.finish(key)


def _with_units(numbers: Float64) -> tuple[Float64, float]:
    """Return poses (N, 7) with quaternions of length 1, and the largest deviation of one from that."""
    lengths = np.linalg.norm(numbers[:, 3:], axis=1, keepdims=True)
    off = float(np.abs(lengths - 1.0).max(initial=0.0))
    return np.concatenate([numbers[:, :3], numbers[:, 3:] / lengths], axis=1), off


def _usable(numbers: Float64, refused: Counter[str]) -> Bool:
    """Return the mask of usable poses; count the others."""
    # Squares of larger numbers overflow; a comparison with NaN does not hold.
    finite = np.asarray((np.abs(numbers) < 1e12).all(axis=1))
    turns = np.abs(np.where(finite[:, None], numbers[:, 3:], 1.0)).max(axis=1, initial=0.0) > 1e-6
    for bad, cause in ((~finite, NOT_FINITE), (~turns, NO_TURN)):
        if bad.any():
            refused[cause] += int(np.count_nonzero(bad))
    usable: Bool = finite & turns
    return usable


GAP = "# gap"
"""Line between two poses between which none is known; other programs leave it out."""
TUM = "tum"
"""Type of a trajectory."""
WORLD = "world"
"""The frame of a trajectory, which its file does not name."""
LONGEST_LINE = 1000
"""Characters of a line that can be a pose."""
MAX_NS, MAX_DIGITS = 1 << 62, 11
"""Farthest stamp from 1970 [ns], 146 years, so that differences of two fit; its digits before the point."""


def read_trajectory(path: Path) -> tuple[PoseTrack, Int64]:
    """Read the path of a sensor from a file of TUM lines; empty lines and those that begin with `#` are left out.

    Returns
    -------
    The path, and (G, 2) stamps between which no pose is known [ns]: those around the lines `# gap`.

    Raises
    ------
    UnreadableError
        The file cannot be read, a line is no pose, or there is none.
    """
    stamps: list[int] = []
    numbers: list[list[float]] = []
    cuts: list[int] = []
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            for number, line in _lines(file):
                if not (text := line.strip()) or text.startswith("#"):
                    cuts += [len(stamps)] if text == GAP else []
                    continue
                if len(stamps) == MAX_POSES:
                    raise UnreadableError(f"{path}: more than {MAX_POSES:,} poses")
                stamp, values = _pose(path, number, text)
                stamps.append(stamp)
                numbers.append(values)
    except OSError as err:
        raise UnreadableError(f"{path}: {err.strerror or err}") from err
    if not stamps:
        raise UnreadableError(f"{path}: holds no pose; lines are timestamp x y z qx qy qz qw")
    at, poses = np.array(stamps, np.int64), np.array(numbers, np.float64)
    refused: Counter[str] = Counter()
    track = gathered((path.name, TUM, WORLD, ""), at, poses, at, refused)
    if track is None or refused:
        cause, count = next(iter(refused.items()))
        raise UnreadableError(f"{path}: {count:,} of {len(stamps):,} poses cannot be used: {cause}")
    gaps = [(stamps[cut - 1], stamps[cut]) for cut in dict.fromkeys(cuts) if 0 < cut < len(stamps)]
    return track, np.array(gaps, np.int64).reshape(-1, 2)


def _lines(file: TextIO) -> Iterator[tuple[int, str]]:
    """Yield the lines of a file with their numbers; only the beginning of one that is too long."""
    number = 0
    while line := file.readline(LONGEST_LINE):
        number += 1
        yield number, line
        while line and not line.endswith("\n"):
            line = file.readline(LONGEST_LINE)


def _pose(path: Path, number: int, text: str) -> tuple[int, list[float]]:
    """Return stamp [ns], and x, y, z [m] and quaternion x, y, z, w of a line."""
    words = text.replace(",", " ").split()
    try:
        if len(words) != 8:
            raise ValueError
        # Seconds since 1970 with nine decimals are more than a float holds.
        seconds = Decimal(words[0])
        if not seconds.is_finite() or seconds.adjusted() > MAX_DIGITS:
            raise ValueError
        stamp = int((seconds * SECOND_NS).to_integral_value())
        if abs(stamp) > MAX_NS:
            raise ValueError
        return stamp, [float(word) for word in words[1:]]
    except (ValueError, ArithmeticError):
        why = ""
        if len(words) == 12:
            why = " (KITTI files tell no times)"
        elif words and words[0].isdigit() and len(words[0]) > MAX_DIGITS:
            why = " (nanoseconds, as in EuRoC files, whose qw comes first: write seconds)"
        raise UnreadableError(
            f"{path}: line {number}: '{clipped(text)}' is no pose{why}; lines are timestamp x y z qx qy qz qw"
        ) from None


def trajectory_lines(stamp_ns: Int64, motion: PoseMotion) -> str:
    """Return N poses as TUM lines, without unknown ones."""
    known = ~np.isnan(motion.position).any(axis=1)
    numbers = motion.position[known].tolist(), upright(motion.rotation[known]).tolist()
    lines = []
    for stamp, position, turn in zip(stamp_ns[known].tolist(), *numbers, strict=True):
        whole, rest = divmod(abs(stamp), SECOND_NS)
        # What is rounded to 0 has no sign.
        words = [f"{round(value, 6) + 0.0:.6f}" for value in position]
        words += [f"{round(value, 9) + 0.0:.9f}" for value in turn]
        lines.append(f"{'-' if stamp < 0 else ''}{whole}.{rest:09d} {' '.join(words)}\n")
    return "".join(lines)


def upright(rotation: Float64) -> Float64:
    """Return the quaternion of each rotation with a non-negative last number."""
    turned: Float64 = np.where(rotation[:, 3:] < 0, -rotation, rotation)
    return turned


# Pose messages as arrays: those of ROS by column, those of foxglove one by one, plane poses of text logs.
