"""Gathers the pose messages of a log into tracks: one per topic and pair of frames, as sorted arrays."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from lidarcli.logs.base import Message
from lidarcli.logs.planar import ENCODING as PLANAR
from lidarcli.poses import foxglove, planar, rosbytes
from lidarcli.poses.motion import Motion, interpolate
from lidarcli.poses.rows import TRANSFORMS, PoseRows
from lidarcli.sweeps import Bool, Float64, Int64

MAX_POSES = 2_000_000
"""Most poses of one log that are kept, 64 bytes each; those after them are left out."""
MAX_TRACKS = 10_000
"""Most pairs of frames of one log that are followed."""
TOGETHER = 2048
TOGETHER_BYTES = 4 << 20
"""Messages of a topic that are decoded at once, and bytes of all that wait."""

FLAT = 0.02
"""Parts of a quaternion below this one are none, …"""
ROLLS = 0.05
"""… one whose greatest and least differ by more changes (6 degrees), …"""
GOES = 0.5
"""… and what has gone as far [m] is no joint."""

NOT_FINITE = "its pose is not finite"
_LARGEST = 1e12
"""Nobody is so far away [m]."""
NO_TURN = "its quaternion is zero"
ENCODING = "its encoding is not read"

SECOND_NS = 1_000_000_000
HOLD_STEPS = 2
"""The first and the last pose of a track hold for so many of its average steps outside of its span …"""
HOLD_NS = 100_000_000
"""… and this long [ns] at most: nobody gets far in a tenth of a second."""


@dataclass(frozen=True, eq=False, slots=True)
class Track:
    """The poses of one frame in another that one topic tells, by increasing stamp."""

    topic: str
    type: str
    parent: str
    child: str
    """Empty where the messages do not name it."""
    static: bool
    """Whether it holds for the whole log (/tf_static); the last one said holds."""
    messages: int
    """Poses told; runs of equal ones are kept by their ends alone."""
    stamp_ns: Int64
    """(N,) header stamps (record time where the header has none), each once."""
    motion: Motion
    """N poses."""
    record_ns: tuple[int, int]
    """First and last record time."""
    jumps_back: int
    """Stamps that are a second or more before the one that was told before them."""

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last stamp."""
        return int(self.stamp_ns[0]), int(self.stamp_ns[-1])

    @property
    def seems_w_first(self) -> bool:
        """Whether its quaternions seem to be written w first: what turns on the ground then only rolls.

        What goes straight ahead has 1 0 0 0 then, always; a sensor that hangs head down turns a little on its way.
        """
        x, y, z, w = np.abs(self.motion.rotation).T
        rolls = max(y.max(), z.max()) < FLAT and (np.ptp(x) > ROLLS or max(y.max(), z.max(), w.max()) == 0.0)
        return bool(rolls and np.ptp(self.motion.position[:, :2], axis=0).max() > GOES)

    @property
    def rate(self) -> float | None:
        """Poses per second, on average; None for a single one."""
        seconds = (self.span_ns[1] - self.span_ns[0]) / SECOND_NS
        return (self.messages - 1) / seconds if seconds > 0 else None

    @property
    def is_link(self) -> bool:
        """Whether it is part of the tree of frames."""
        return self.type in TRANSFORMS

    @property
    def hold_ns(self) -> int:
        """How long its first and last pose hold outside of its span [ns]; 0 for a single pose."""
        return min(round(HOLD_STEPS * SECOND_NS / self.rate), HOLD_NS) if self.rate else 0

    def at(self, stamp_ns: Int64) -> Motion:
        """The pose at each time, NaN where the track does not reach."""
        if self.static:
            last = np.full(len(stamp_ns), len(self.stamp_ns) - 1)
            return Motion(self.motion.position[last], self.motion.rotation[last])
        return interpolate(stamp_ns, self.stamp_ns, self.motion, self.hold_ns)


@dataclass(slots=True)
class _Growing:
    """A track while it is read, in log order."""

    stamps: list[Int64] = field(default_factory=list)
    numbers: list[Float64] = field(default_factory=list)
    messages: int = 0
    record_ns: tuple[int, int] = (np.iinfo(np.int64).max, np.iinfo(np.int64).min)
    latest: int = -(1 << 62)
    before: int = -(1 << 62)
    """Stamp of the pose before."""
    jumps_back: int = 0

    def add(self, stamp_ns: Int64, numbers: Float64, record_ns: Int64) -> int:
        """Take poses in log order; how many of them are kept."""
        self.messages += len(stamp_ns)
        self.record_ns = (
            min(self.record_ns[0], int(record_ns.min())),
            max(self.record_ns[1], int(record_ns.max())),
        )
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
            stamp_ns, numbers = stamp_ns[kept], numbers[kept]
        self.stamps.append(stamp_ns)
        self.numbers.append(numbers)
        return len(stamp_ns)

    def finish(self, key: tuple[str, str, str, str]) -> Track:
        """The track, sorted; of several poses at one stamp the last that was told."""
        topic, kind, parent, child = key
        stamps, numbers = np.concatenate(self.stamps), np.concatenate(self.numbers)
        static = topic.rpartition("/")[2] == "tf_static"
        if static:
            stamps, numbers = stamps[-1:], numbers[-1:]
        elif (np.diff(stamps) <= 0).any():
            order = np.argsort(stamps, kind="stable")
            stamps, numbers = stamps[order], numbers[order]
            last = np.append(stamps[1:] != stamps[:-1], True)
            stamps, numbers = stamps[last], numbers[last]
        motion = Motion(numbers[:, :3], numbers[:, 3:])
        return Track(
            topic, kind, parent, child, static, self.messages, stamps, motion, self.record_ns, self.jumps_back
        )


class Tracks:
    """Folds pose messages into tracks, in bounded memory."""

    def __init__(self, most: int = MAX_POSES) -> None:
        self.refused: Counter[tuple[str, str]] = Counter()
        """(topic, cause) → messages that cannot be a pose."""
        self.left_out = 0
        """Poses beyond the most that are kept, or of more frames than are followed."""
        self._room = most
        self._waiting: dict[tuple[str, str, str], list[Message]] = {}
        self._bytes = 0
        self._growing: dict[tuple[str, str, str, str], _Growing] = {}

    def add(self, messages: Iterable[Message]) -> None:
        """Take messages in log order."""
        for message in messages:
            key = message.topic, message.type, message.encoding
            if (waiting := self._waiting.get(key)) is None:
                waiting = self._waiting[key] = []
            waiting.append(message)
            self._bytes += len(message.data)
            if len(waiting) >= TOGETHER:
                self._flush(key)
            elif self._bytes >= TOGETHER_BYTES:
                self._flush_all()

    def finish(self) -> list[Track]:
        """All tracks, in the order in which they first appear."""
        self._flush_all()
        return [growing.finish(key) for key, growing in self._growing.items()]

    def _flush_all(self) -> None:
        for key in list(self._waiting):
            self._flush(key)

    def _flush(self, key: tuple[str, str, str]) -> None:
        topic, kind, encoding = key
        waiting = self._waiting.pop(key)
        data = [message.data for message in waiting]
        self._bytes -= sum(map(len, data))
        refused: Counter[str] = Counter()
        found: dict[tuple[str, str], list[PoseRows]] = {}
        for rows in _decode(kind, encoding, data, refused):
            found.setdefault((rows.parent, rows.child), []).append(rows)
        record_ns = np.array([message.record_ns for message in waiting], np.int64)
        for (parent, child), parts in found.items():
            self._take((topic, kind, parent, child), parts, record_ns, refused)
        for cause, count in refused.items():
            self.refused[(topic, cause)] += count

    def _take(
        self,
        key: tuple[str, str, str, str],
        parts: Sequence[PoseRows],
        record_ns: Int64,
        refused: Counter[str],
    ) -> None:
        row = np.concatenate([part.row for part in parts])
        stamps = np.concatenate([part.stamp_ns for part in parts])
        numbers = np.concatenate([part.numbers for part in parts])
        order = np.argsort(row, kind="stable")
        row, stamps, numbers = row[order], stamps[order], numbers[order]
        keep = _usable(numbers, refused)
        row, stamps, numbers = row[keep], stamps[keep], _with_units(numbers[keep])
        known = key in self._growing or len(self._growing) < MAX_TRACKS
        fits = max(self._room, 0) if known else 0
        self.left_out += max(len(row) - fits, 0)
        row, stamps, numbers = row[:fits], stamps[:fits], numbers[:fits]
        if not len(row):
            return
        stamps = np.where(stamps == 0, record_ns[row], stamps)
        self._room -= self._growing.setdefault(key, _Growing()).add(stamps, numbers, record_ns[row])


def gathered(
    key: tuple[str, str, str, str], stamp_ns: Int64, numbers: Float64, record_ns: Int64, refused: Counter[str]
) -> Track | None:
    """A track of N poses that are there already, None without a usable one.

    Parameters
    ----------
    key : topic, type, parent and child
    numbers : (N, 7) x, y, z [m] and the quaternion's x, y, z, w
    refused : takes the causes of poses that say nothing, which are left out
    """
    keep = _usable(numbers, refused)
    if not keep.any():
        return None
    growing = _Growing()
    growing.add(stamp_ns[keep], _with_units(numbers[keep]), record_ns[keep])
    return growing.finish(key)


def _with_units(numbers: Float64) -> Float64:
    """The same poses with quaternions of length 1."""
    turns = numbers[:, 3:] / np.linalg.norm(numbers[:, 3:], axis=1, keepdims=True)
    return np.concatenate([numbers[:, :3], turns], axis=1)


def _decode(kind: str, encoding: str, data: Sequence[bytes], refused: Counter[str]) -> Iterable[PoseRows]:
    if encoding in ("cdr", "ros1") and not kind.startswith("foxglove."):
        return rosbytes.decode(kind, encoding, data, refused)
    if encoding in ("json", "protobuf") and kind.startswith("foxglove."):
        return foxglove.decode(kind, encoding, data, refused)
    if encoding == PLANAR:
        return planar.decode(data)
    refused[ENCODING] += len(data)
    return ()


def _usable(numbers: Float64, refused: Counter[str]) -> Bool:
    """Poses that say something; the others are counted."""
    # Squares of larger numbers overflow; a comparison with NaN does not hold.
    finite = np.asarray((np.abs(numbers) < _LARGEST).all(axis=1))
    turns = np.abs(np.where(finite[:, None], numbers[:, 3:], 1.0)).max(axis=1, initial=0.0) > 1e-6
    for bad, cause in ((~finite, NOT_FINITE), (~turns, NO_TURN)):
        if bad.any():
            refused[cause] += int(np.count_nonzero(bad))
    usable: Bool = finite & turns
    return usable
