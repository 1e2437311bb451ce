"""Where the records of a ROS 1 bag come from, piece by piece: the file itself, or a compressed chunk of it."""

from __future__ import annotations

import bz2
from typing import BinaryIO, Protocol

from lz4.frame import LZ4FrameDecompressor

INPUT = 1 << 20
"""Compressed bytes taken at a time."""
CAREFUL_INPUT = 512
"""The same where the data is known to be broken, so that everything before the break comes out."""
CODECS = {"bz2": b"BZh", "lz4": b"\x04\x22\x4d\x18"}
"""Known compressions and how their data begins."""


def read_at(file: BinaryIO, at: int, size: int) -> bytes:
    """Bytes of the file at a position, fewer at its end."""
    file.seek(at)
    return file.read(size)


class Feed(Protocol):
    """A source of bytes: `read` gives as many as asked for, fewer only at the end."""

    @property
    def left(self) -> int:
        """Most bytes that are still to come."""

    def read(self, size: int) -> bytes: ...


class FileFeed:
    """The bytes of a file from a position on."""

    def __init__(self, file: BinaryIO, at: int, end: int) -> None:
        self._file, self._at, self._end = file, at, end

    @property
    def left(self) -> int:
        return max(0, self._end - self._at)

    def read(self, size: int) -> bytes:
        data = read_at(self._file, self._at, max(0, min(size, self._end - self._at)))
        self._at += len(data)
        return data


class ChunkFeed:
    """The unpacked bytes of a compressed chunk, at most `most`.

    A block of bz2 data comes out only after its checksum has been compared: from a broken block come plausible records of
    shuffled bytes.
    """

    def __init__(self, file: BinaryIO, start: int, end: int, codec: str, most: int) -> None:
        self._file, self._start, self._end, self._codec = file, start, end, codec
        self._limit = most
        self._step = INPUT
        self.error = ""
        """Why the data could not be unpacked to its end; empty where it could."""
        self._begin()
        self._unpacked = self._given = 0
        self._spare = b""
        """Unpacked already and not yet asked for."""

    def _begin(self) -> None:
        self._at = self._start
        self._codec_state: bz2.BZ2Decompressor | LZ4FrameDecompressor = (
            bz2.BZ2Decompressor() if self._codec == "bz2" else LZ4FrameDecompressor()
        )

    @property
    def left(self) -> int:
        return self._limit - self._given

    @property
    def unpacked(self) -> int:
        """How many bytes have been unpacked."""
        return self._unpacked

    @property
    def finished(self) -> bool:
        """Whether the compressed data came to its own end."""
        return bool(self._codec_state.eof)

    @property
    def stop(self) -> int:
        """Position in the file behind the compressed data, where `finished`."""
        return self._at - len(self._codec_state.unused_data or b"")

    def read(self, size: int) -> bytes:
        parts, missing = [self._spare], size - len(self._spare)
        while missing > 0 and self._unpacked < self._limit and not self.finished and not self.error:
            parts.append(self._unpack(min(missing, self._limit - self._unpacked)))
            missing -= len(parts[-1])
        data = b"".join(parts)
        end = min(size, self.left)
        data, self._spare = data[:end], data[end:]
        self._given += len(data)
        return data

    def _unpack(self, size: int) -> bytes:
        """The next `size` bytes at most, of bz2 the next whole blocks."""
        compressed = b""
        if self._codec_state.needs_input:
            compressed = read_at(self._file, self._at, max(0, min(self._step, self._end - self._at)))
            self._at += len(compressed)
            if not compressed:
                self.error = "it is cut off"
                return b""
        try:
            data = self._decompress(compressed, size)
        except (OSError, RuntimeError, ValueError) as err:
            if self._step == CAREFUL_INPUT:
                self.error = f"its {self._codec} data is broken ({err})"
                return b""
            return self._again(size)
        self._unpacked += len(data)
        return data

    def _decompress(self, compressed: bytes, size: int) -> bytes:
        data: bytes = self._codec_state.decompress(compressed, max_length=size)
        if self._codec == "bz2":
            room = self._limit - self._unpacked
            # Only where it wants more than it has been given it has come to the end of a block.
            while not self.finished and not self._codec_state.needs_input and len(data) <= room:
                data += self._codec_state.decompress(b"", max_length=INPUT)
        return data

    def _again(self, size: int) -> bytes:
        """Start over in small steps: a step that fails gives nothing, not even what is good in it."""
        self._step = CAREFUL_INPUT
        self._begin()
        skip, self._unpacked = self._unpacked, 0
        data = b""
        while self._unpacked < skip and not self.finished and not self.error:
            data = self._unpack(min(skip - self._unpacked, INPUT))
        if self._unpacked > skip:
            return data[skip - self._unpacked :]
        return b"" if self.error or self.finished else self._unpack(size)

    def drain(self) -> None:
        """Read on to the end mark of the compressed data, so that `finished` and `stop` can be asked for."""
        while self._unpacked == self._limit and not self.finished and not self.error:
            self._unpack(1)
        if self._unpacked > self._limit:
            self.error = self.error or "it holds more than it declares"
