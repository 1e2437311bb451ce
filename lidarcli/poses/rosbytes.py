"""Columnar decoding of the ROS messages that hold poses, in CDR and in ROS 1 serialisation.

One message is walked from field to field; all others that agree with it in every byte but times and numbers are
then read with the same offsets at once. A log has hundreds of thousands of poses, and hardly two such layouts per topic.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lidarcli.poses.rows import (
    MAX_NAME,
    MAX_TRANSFORMS,
    ODOMETRY,
    TRANSFORMS,
    BadPoseError,
    PoseRows,
    frame_name,
)
from lidarcli.sweeps import UInt8

SHORT = "shorter than its type"
ENCAPSULATION = "not plain CDR (unknown encapsulation)"
NAME_LONG = f"a frame name of more than {MAX_NAME} bytes"
TOO_MANY = f"more than {MAX_TRANSFORMS} transforms declared"

# Encapsulation → byte order and alignment of doubles, which XCDR2 puts on four bytes.
_CDR = {0: (">", 8), 1: ("<", 8), 6: (">", 4), 7: ("<", 4), 16: (">", 4), 17: ("<", 4)}
_NUMBERS = 56
"""Bytes of a position and a quaternion."""


@dataclass(frozen=True, slots=True)
class _Entry:
    """Where one pose stands in a message."""

    stamp: int
    numbers: int
    parent: str
    child: str


@dataclass(slots=True)
class _Walker:
    """Goes through one message and notes where things stand."""

    data: bytes
    kind: str
    encoding: str
    order: str = "<"
    align: int = 1
    base: int = 0
    at: int = 0
    fixed: list[tuple[int, int]] = field(default_factory=list)
    """Bytes that decide where all others stand."""
    entries: list[_Entry] = field(default_factory=list)

    def walk(self) -> None:
        """Find every pose of the message."""
        if self.encoding == "cdr":
            head = self.data[:4]
            if len(head) < 4 or head[0] or head[1] not in _CDR:
                raise BadPoseError(ENCAPSULATION)
            self.order, self.align = _CDR[head[1]]
            self.base = self.at = 4
            self.fixed.append((0, 2))
        count = 1
        if self.kind in TRANSFORMS:
            start = self.at
            count = self._word()
            self.fixed.append((start, self.at))
            if count > MAX_TRANSFORMS:
                raise BadPoseError(TOO_MANY)
        for _ in range(count):
            self._entry()

    def _entry(self) -> None:
        if self.encoding == "ros1":
            self.at += 4  # the sequence number
        self._to(4)
        stamp = self.at
        self.at += 8
        parent = self._text()
        child = self._text() if self.kind in TRANSFORMS or self.kind == ODOMETRY else ""
        self._to(8)
        numbers = self.at
        self.at += _NUMBERS
        if self.at > len(self.data):
            raise BadPoseError(SHORT)
        self.entries.append(_Entry(stamp, numbers, frame_name(parent), frame_name(child)))

    def _to(self, size: int) -> None:
        """Pass the padding before a value of this size."""
        self.at += -(self.at - self.base) % min(size, self.align)

    def _word(self) -> int:
        self._to(4)
        raw = self.data[self.at : self.at + 4]
        if len(raw) < 4:
            raise BadPoseError(SHORT)
        self.at += 4
        return int.from_bytes(raw, "little" if self.order == "<" else "big")

    def _text(self) -> str:
        self._to(4)
        start = self.at
        length = self._word()
        if length > MAX_NAME:
            raise BadPoseError(NAME_LONG)
        self.at += length
        if self.at > len(self.data):
            raise BadPoseError(SHORT)
        self.fixed.append((start, self.at))
        return self.data[self.at - length : self.at].split(b"\0")[0].decode("utf-8", "replace")


def decode(kind: str, encoding: str, messages: Sequence[bytes], refused: Counter[str]) -> Iterator[PoseRows]:
    """The poses of messages of one type; what cannot be a pose is counted in `refused` by its cause.

    Parameters
    ----------
    kind : message type as `ros_type` spells it
    encoding : `cdr` or `ros1`
    """
    by_length: dict[int, list[int]] = {}
    for index, message in enumerate(messages):
        by_length.setdefault(len(message), []).append(index)
    for length, indices in by_length.items():
        rows = np.array(indices, np.intp)
        joined = b"".join(messages[index] for index in indices)
        matrix = np.frombuffer(joined, np.uint8).reshape(len(indices), length)
        while len(rows):
            walker = _Walker(messages[rows[0]], kind, encoding)
            try:
                walker.walk()
            except BadPoseError as err:
                refused[str(err)] += 1
                rows, matrix = rows[1:], matrix[1:]
                continue
            alike = _alike(matrix, walker.fixed)
            yield from _read(matrix[alike], rows[alike], walker)
            rows, matrix = rows[~alike], matrix[~alike]


def _alike(matrix: UInt8, fixed: list[tuple[int, int]]) -> NDArray[np.bool_]:
    """The messages that have the bytes of the first one wherever these decide on the layout."""
    if not fixed or len(matrix) == 1:
        return np.ones(len(matrix), bool)
    columns = np.concatenate([np.arange(start, stop) for start, stop in fixed])
    alike: NDArray[np.bool_] = (matrix[:, columns] == matrix[0, columns]).all(axis=1)
    return alike


def _read(matrix: UInt8, rows: NDArray[np.intp], walker: _Walker) -> Iterator[PoseRows]:
    order = walker.order
    for entry in walker.entries:
        words = matrix[:, entry.stamp : entry.stamp + 8].copy().view(f"{order}u4")
        seconds = words[:, 0].astype(np.int64)
        if walker.encoding == "cdr":
            seconds = words[:, 0].astype(np.uint32).view(np.int32).astype(np.int64)
        numbers = matrix[:, entry.numbers : entry.numbers + _NUMBERS].copy().view(f"{order}f8")
        yield PoseRows(
            parent=entry.parent,
            child=entry.child,
            row=rows,
            stamp_ns=seconds * 1_000_000_000 + words[:, 1],
            numbers=numbers.astype(np.float64),
        )
