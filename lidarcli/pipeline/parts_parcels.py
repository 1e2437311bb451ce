"""Batches to worker processes and rows back: through memory that the processes share.

A pipe would do, but whoever writes to it waits until the other side has read, and that side has work of its own.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import pickle
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import pyarrow as pa

from lidarcli.pipeline.parts import Part
from lidarcli.pipeline.summary import RunSummary
from lidarcli.sweeps import SweepBatch
from lidarcli.tables.schemas import SCHEMAS

_ALIGNED = 64
_MEMORY = "/dev/shm"
"""Where Linux keeps files that are memory."""


@dataclass(frozen=True, slots=True)
class Parcel:
    """Pieces of bytes on their way to another process: in a slot of the shared memory, or along with the message."""

    lengths: tuple[int, ...]
    slot: int | None
    pieces: tuple[bytes, ...] = ()


@dataclass(frozen=True, slots=True)
class Answer:
    """A part on its way back."""

    topics: tuple[str, ...]
    """The topic of each batch."""
    rows: Parcel
    """An Arrow stream per table."""
    found: RunSummary
    counted: Any


class Area:
    """Memory that several processes share, in slots of equal size."""

    def __init__(self, path: str, size: int) -> None:
        self._size = size
        with Path(path).open("r+b") as file:
            self._view = memoryview(mmap.mmap(file.fileno(), 0))

    def pack(self, slot: int, pieces: Sequence[memoryview]) -> Parcel:
        """Put pieces into a slot; what does not fit travels with the message."""
        lengths = tuple(len(piece) for piece in pieces)
        *starts, end = accumulate(map(_padded, lengths), initial=0)
        if end > self._size:
            return packed(pieces)
        for start, piece in zip(starts, pieces, strict=True):
            at = slot * self._size + start
            self._view[at : at + len(piece)] = piece
        return Parcel(lengths, slot)

    def view(self, slot: int, lengths: Sequence[int]) -> list[memoryview]:
        """The pieces in a slot, where they lie."""
        starts = accumulate(map(_padded, lengths), initial=slot * self._size)
        return [self._view[at : at + length] for at, length in zip(starts, lengths, strict=False)]


class SharedFile:
    """The file behind an `Area`. It has a name only until the workers have opened it, so that nothing is left of it."""

    def __init__(self, size: int) -> None:
        self._file = tempfile.NamedTemporaryFile(prefix="lidarcli-", dir=_folder(size))  # noqa: SIM115
        self.path = self._file.name
        try:
            # Taken now: memory that is missing later would end the process without a word.
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(self._file.fileno(), 0, size)
            else:
                self._file.write(bytes(size))
                self._file.flush()
        except OSError:
            self.close()
            raise

    def close(self) -> None:
        """Take its name from it; who has opened it keeps the memory."""
        with contextlib.suppress(OSError):
            self._file.close()


def packed(pieces: Sequence[memoryview]) -> Parcel:
    """A parcel that travels with the message."""
    return Parcel(tuple(map(len, pieces)), None, tuple(map(bytes, pieces)))


def unpacked(parcel: Parcel, area: Area | None) -> list[memoryview]:
    """The pieces of a parcel."""
    if parcel.slot is None or area is None:
        return [memoryview(piece) for piece in parcel.pieces]
    return area.view(parcel.slot, parcel.lengths)


def dump(batches: Sequence[SweepBatch]) -> list[memoryview]:
    """Batches as pieces, their arrays uncopied."""
    buffers: list[pickle.PickleBuffer] = []
    head = pickle.dumps(list(batches), 5, buffer_callback=buffers.append)
    return [memoryview(head), *(buffer.raw() for buffer in buffers)]


def load(pieces: Sequence[memoryview]) -> list[SweepBatch]:
    """The batches of `dump`; their arrays are the pieces."""
    batches: list[SweepBatch] = pickle.loads(pieces[0], buffers=pieces[1:])
    return batches


def write_rows(part: Part, tables: Sequence[str]) -> list[memoryview]:
    """The rows of a part as one Arrow stream per table."""
    streams = []
    for table in tables:
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, SCHEMAS[table]) as stream:
            for name, _, rows in part.rows:
                if name == table:
                    stream.write_batch(rows)
        streams.append(memoryview(sink.getvalue()).cast("B"))
    return streams


def read_rows(
    tables: Sequence[str], topics: Sequence[str], streams: Sequence[memoryview]
) -> list[tuple[str, str, pa.RecordBatch]]:
    """The rows of a part, on memory of their own."""
    return [
        (table, topic, rows)
        for table, stream in zip(tables, streams, strict=True)
        for topic, rows in zip(topics, pa.ipc.open_stream(bytes(stream)), strict=True)
    ]


def _padded(length: int) -> int:
    """Whole units, so that every piece begins where arrays like to begin."""
    return -(-length // _ALIGNED) * _ALIGNED


def _folder(size: int) -> str | None:
    """Where memory lies in files, if there is room for `size` bytes; elsewhere such a file costs some writing to disk."""
    try:
        room = os.statvfs(_MEMORY)
        return _MEMORY if room.f_bavail * room.f_frsize >= size and os.access(_MEMORY, os.W_OK) else None
    except (OSError, AttributeError):
        return None
