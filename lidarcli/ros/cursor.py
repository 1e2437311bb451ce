"""Going through one message in ROS serialisation from field to field: CDR of ROS 2, or that of ROS 1."""

from __future__ import annotations

import struct

from lidarcli.system.records import dataclass, field

# Encapsulation → byte order and alignment of doubles, which XCDR2 puts on four bytes.
_CDR = {0: (">", 8), 1: ("<", 8), 6: (">", 4), 7: ("<", 4), 16: (">", 4), 17: ("<", 4)}


class BadMessageError(ValueError):
    """A message that is not what its type says; the text is the cause."""


MAX_NAME = 4096
"""Longest name of a frame or a field [bytes] that is believed."""

SHORT = "shorter than its type"
NAME_LONG = f"a name of more than {MAX_NAME} bytes"
ENCAPSULATION = "not plain CDR (unknown encapsulation)"


@dataclass(slots=True)
class Cursor:
    """A place in a message; what is read moves it on."""

    data: bytes
    encoding: str
    order: str = field(default="<", init=False)
    at: int = field(default=0, init=False)
    _align: int = field(default=1, init=False)
    _base: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        """Read the encapsulation of CDR."""
        if self.encoding == "cdr":
            head = self.data[:4]
            if len(head) < 4 or head[0] or head[1] not in _CDR:
                raise BadMessageError(ENCAPSULATION)
            self.order, self._align = _CDR[head[1]]
            self._base = self.at = 4

    def align(self, size: int) -> None:
        """Pass the padding before a value of this size."""
        self.at += -(self.at - self._base) % min(size, self._align)

    def skip(self, size: int) -> int:
        """Pass bytes, and return where they begin."""
        start = self.at
        self.at += size
        if self.at > len(self.data):
            raise BadMessageError(SHORT)
        return start

    def byte(self) -> int:
        """Read one byte."""
        return self.data[self.skip(1)]

    def word(self) -> int:
        """Read four bytes as an unsigned integer."""
        self.align(4)
        (value,) = struct.unpack_from(f"{self.order}I", self.data, self.skip(4))
        return int(value)

    def text(self) -> str:
        """Read a string of at most `MAX_NAME` bytes."""
        length = self.word()
        if length > MAX_NAME:
            raise BadMessageError(NAME_LONG)
        start = self.skip(length)
        return self.data[start : self.at].split(b"\0")[0].decode("utf-8", "replace")

    def stamp_ns(self) -> int:
        """Read the stamp of a header [ns]; its sequence number in ROS 1 is passed over."""
        if self.encoding == "ros1":
            self.skip(4)
        seconds, nanoseconds = self.word(), self.word()
        if self.encoding == "cdr" and seconds >= 1 << 31:
            seconds -= 1 << 32
        return seconds * 1_000_000_000 + nanoseconds
