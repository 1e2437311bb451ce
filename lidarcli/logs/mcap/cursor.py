"""The bytes of an MCAP in order, from a file or from a pipe, behind one face.

Files are read, not mapped: a disk error or a file cut while it is read must end as a message, and through a mapping it
would end the process.
"""

from __future__ import annotations

from typing import BinaryIO

PIECE = 1 << 20
"""Most bytes asked of a pipe at once: a declared size is never allocated before the bytes are there."""


class Cursor:
    """A position in a stream of bytes. A file can also be read elsewhere (`read_at`), and ends where it ended at open."""

    def __init__(self, stream: BinaryIO, size: int | None) -> None:
        self.stream = stream
        self.size = size
        """None for a pipe."""
        self.position = 0
        self._ahead = b""

    def read_at(self, offset: int, length: int) -> bytes:
        """Bytes of a file, fewer at its end."""
        if self.size is None:
            raise ValueError("a pipe has no offsets")
        self.stream.seek(offset)
        wanted = max(0, min(length, self.size - offset))
        return _read(self.stream, wanted, wanted)

    def peek(self, length: int) -> bytes:
        """The next bytes without passing them; fewer only at the end. May return more."""
        missing = length - len(self._ahead)
        if missing > 0:
            if self.size is None:
                self._ahead += _read(self.stream, missing, PIECE)
            else:
                self._ahead = self.read_at(self.position, max(length, 1 << 12))
        return self._ahead

    def take(self, length: int) -> bytes:
        """Pass the next bytes and return them; fewer only at the end."""
        data = self._ahead[:length]
        if len(data) < length:
            more = length - len(data)
            if self.size is None:
                data += _read(self.stream, more, PIECE)
            else:
                data = self.read_at(self.position, length)
        self._ahead = self._ahead[length:]
        self.position += len(data)
        return data

    def back(self, data: bytes) -> None:
        """Undo `take`."""
        self._ahead = data + self._ahead if self.size is None else b""
        self.position -= len(data)

    def skip(self, length: int) -> int:
        """Pass the next bytes; how many there were."""
        if self.size is not None:
            return self._seek(min(length, self.size - self.position))
        passed = 0
        while passed < length:
            step = len(self.take(min(length - passed, PIECE)))
            if not step:
                break
            passed += step
        return passed

    def _seek(self, step: int) -> int:
        self._ahead = self._ahead[step:]
        self.position += step
        return step


def _read(stream: BinaryIO, length: int, piece: int) -> bytes:
    """Exactly `length` bytes unless the stream ends."""
    pieces = []
    while length > 0:
        data = stream.read(min(length, piece))
        if not data:
            break
        pieces.append(data)
        length -= len(data)
    return pieces[0] if len(pieces) == 1 else b"".join(pieces)
