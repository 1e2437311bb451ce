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
    MAX_TRANSFORMS,
    ODOMETRY,
    TRANSFORMS,
    PoseRows,
    frame_name,
)
from lidarcli.ros.cursor import BadMessageError, Cursor
from lidarcli.sweeps import UInt8

TOO_MANY = f"more than {MAX_TRANSFORMS} transforms declared"

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
    fixed: list[tuple[int, int]] = field(default_factory=list)
    """Bytes that decide where all others stand."""
    entries: list[_Entry] = field(default_factory=list)

    def walk(self) -> None:
        """Find every pose of the message."""
        cursor = Cursor(self.data, self.encoding)
        self.order = cursor.order
        if cursor.at:
            self.fixed.append((0, 2))
        count = 1
        if self.kind in TRANSFORMS:
            start = cursor.at
            count = cursor.word()
            self.fixed.append((start, cursor.at))
            if count > MAX_TRANSFORMS:
                raise BadMessageError(TOO_MANY)
        for _ in range(count):
            self._entry(cursor)

    def _entry(self, cursor: Cursor) -> None:
        if self.encoding == "ros1":
            cursor.skip(4)  # the sequence number
        cursor.align(4)
        stamp = cursor.skip(8)
        parent = self._name(cursor)
        child = self._name(cursor) if self.kind in TRANSFORMS or self.kind == ODOMETRY else ""
        cursor.align(8)
        numbers = cursor.skip(_NUMBERS)
        self.entries.append(_Entry(stamp, numbers, frame_name(parent), frame_name(child)))

    def _name(self, cursor: Cursor) -> str:
        cursor.align(4)
        start = cursor.at
        text = cursor.text()
        self.fixed.append((start, cursor.at))
        return text


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
            except BadMessageError as err:
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
