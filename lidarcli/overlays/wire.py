"""Messages as fixed bytes with numbers to fill in: CDR of ROS 2 with its alignment, and the packed bytes of ROS 1."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Structured = NDArray[np.void]


class Layout(NamedTuple):
    """Bytes of one kind of message or part of one, and where in them the numbers are that differ."""

    dtype: np.dtype[Any]
    template: bytes
    """What all have in common; 0 in the places of the fields."""

    def filled(self, count: int) -> Structured:
        """(count,) copies of the template, whose fields are to be set."""
        return np.frombuffer(bytearray(self.template * count), self.dtype)


@dataclass(slots=True)
class LayoutBuilder:
    """Puts a layout together, member after member.

    In CDR every number begins at a multiple of its size, counted from the end of the message's four bytes of encapsulation,
    and texts end with a zero. ROS 1 has neither.
    """

    cdr: bool
    start: int = 0
    """Where the first byte will be, from the same place; a multiple of 8 tells as much as 0."""
    _bytes: bytearray = field(default_factory=bytearray)
    _fields: list[tuple[str, str, int]] = field(default_factory=list)

    def number(self, code: str, *values: float) -> None:
        """Numbers that are the same in all; `code` is that of `struct`."""
        self._align(struct.calcsize(f"<{code}"))
        self._bytes += struct.pack(f"<{len(values)}{code}", *values)

    def field(self, name: str, code: str, shape: tuple[int, ...] = ()) -> None:
        """Numbers that differ."""
        size = struct.calcsize(f"<{code}")
        self._align(size)
        self._fields.append((name, f"{shape}<{np.dtype(code).str[1:]}", len(self._bytes)))
        self._bytes += bytes(size * int(np.prod(shape)))

    def text(self, value: bytes) -> None:
        """A text that is the same in all."""
        self.number("I", len(value) + self.cdr)
        self._bytes += value + bytes(self.cdr)

    def text_field(self, name: str, length: int) -> None:
        """A text of `length` bytes that differs."""
        self.number("I", length + self.cdr)
        if length:
            self._fields.append((name, f"S{length}", len(self._bytes)))
        self._bytes += bytes(length + self.cdr)

    def layout(self) -> Layout:
        """What has been put together."""
        names, formats, offsets = zip(*self._fields, strict=True)
        dtype = np.dtype(
            {"names": names, "formats": formats, "offsets": offsets, "itemsize": len(self._bytes)}
        )
        return Layout(dtype, bytes(self._bytes))

    def _align(self, size: int) -> None:
        if self.cdr:
            self._bytes += bytes(-(self.start + len(self._bytes)) % size)


def scatter(buffer: NDArray[np.uint8], places: NDArray[np.int64], items: Structured) -> None:
    """Put each of the `items` into the buffer where its first byte belongs."""
    size = items.dtype.itemsize
    # One window of this size begins at every byte: putting an item there is one copy of memory.
    windows = np.ndarray((len(buffer) - size + 1,), f"V{size}", buffer.data, strides=(1,))
    windows[places] = items.view(f"V{size}")
