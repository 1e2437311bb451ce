"""Decompression within bounds: a kilobyte of a bomb unpacks to a gigabyte of nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import zstandard

from lidarcli.logs.base import MAX_MESSAGE
from lidarcli.system.records import dataclass, field

try:
    # By the processor's instruction for it, in a tenth of the steps.
    from isal.isal_zlib import crc32
except ImportError:
    from zlib import crc32

SMALL = 64 << 20
MAX_RATIO = 1000
"""Largest ratio of a whole log beyond these. Most logs stay below 50; 1,081 beams without any return, and as many
intensities, reach 530 as MCAP and 690 as bz2."""
CHUNK_RATIO = 64
"""Largest ratio of a part that is held in memory as a whole."""


@dataclass(slots=True)
class DecompressionBudget:
    """Remaining decompressed bytes that one pass over a log may produce."""

    left: int = field(default_factory=lambda: SMALL)

    def room(self, packed: int) -> int:
        """Return the most bytes that are believed of `packed` more compressed ones."""
        self.left += packed * MAX_RATIO
        return max(0, self.left)

    def used(self, size: int) -> None:
        """Subtract decompressed bytes."""
        self.left -= size


def too_much(size: int, packed: int) -> str:
    """Return the cause of a loss."""
    return f"it declares {size:,} bytes, more than is believed of {packed:,} packed ones"


def unpack_frames(make: Callable[[], Any], packed: bytes, magic: bytes, most: int) -> tuple[bytes, Any]:
    """Return what frames that follow each other hold, up to `most` bytes, and the decompressor of the last one."""
    state = make()
    data: bytes = state.decompress(packed, max_length=most)
    for _ in range(1000):
        if len(data) >= most or not state.eof or not (rest := state.unused_data or b"").startswith(magic):
            break
        state = make()
        data += state.decompress(rest, max_length=most - len(data))
    return data, state


LZ4_MAGIC = b"\x04\x22\x4d\x18"
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
PACKED_CAUSE = "zstd message that is broken or too long"
DISK_SHARE = 0.9
"""A storage file may unpack to this share of the free space of the temporary folder."""
PIECE = 1 << 12
"""Packed bytes taken at a time: at zstd's highest ratio 128 MiB come out of them."""
MAX_WINDOW = 1 << 27


def is_zstd(path: Path) -> bool:
    """Return True if a file begins as zstd data does."""
    with path.open("rb") as file:
        return file.read(4) == ZSTD_MAGIC


def unpack_file(source: Path, target: Path) -> str:
    """Unpack a storage file as far as it goes; why it ended early, or nothing."""
    from shutil import disk_usage

    room = int(disk_usage(target.parent).free * DISK_SHARE)
    limit = min(room, DecompressionBudget().room(source.stat().st_size))
    size = 0
    with source.open("rb") as packed, target.open("wb") as out:
        try:
            data = packed.read(PIECE)
            while data:
                frame = zstandard.ZstdDecompressor(max_window_size=MAX_WINDOW).decompressobj()
                while not frame.eof:
                    if not data:
                        return f"its zstd data is cut off after {size:,} unpacked bytes"
                    size += out.write(frame.decompress(data))
                    if size > limit:
                        return f"only its first {size:,} bytes were unpacked: more than that is not believed"
                    data = frame.unused_data if frame.eof else packed.read(PIECE)
                data = data or packed.read(PIECE)
        except zstandard.ZstdError as err:
            return f"its zstd data is broken after {size:,} unpacked bytes ({err})"
    return ""


def unpack_message(data: bytes, budget: DecompressionBudget) -> bytes | None:
    """Decompress a zstd message; None if it is broken or too long, or the bag has unpacked to too much."""
    if budget.room(len(data)) < MAX_MESSAGE:
        return None
    frame = zstandard.ZstdDecompressor(max_window_size=MAX_WINDOW)
    try:
        size = zstandard.frame_content_size(data)
        if size > MAX_MESSAGE:
            return None
        message = frame.decompress(data) if size >= 0 else b""
        steps = frame.decompressobj()
        for at in range(0, len(data) if size < 0 else 0, PIECE):
            message += steps.decompress(data[at : at + PIECE])
            if steps.eof or len(message) > MAX_MESSAGE:
                break
    except zstandard.ZstdError:
        return None
    budget.used(len(message))
    return message if (size >= 0 or steps.eof) and len(message) <= MAX_MESSAGE else None


MAX_CHUNK = 1 << 30
"""A chunk of an MCAP that declares more than 1 GiB is refused, compressed or not: it is held as a whole."""


class CodecError(ValueError):
    """A chunk that cannot be decompressed."""


def inflate(data: bytes, compression: str, size: int, crc: int, budget: DecompressionBudget) -> bytes:
    """Decompress a chunk of an MCAP within its declared size and `budget`, and compare its checksum, if any."""
    if size > MAX_CHUNK:
        raise CodecError(f"it declares {size} bytes, more than the {MAX_CHUNK} that are believed")
    if compression == "":
        content = data
    elif compression not in ("lz4", "zstd"):
        raise CodecError(f"its compression '{compression}' is not one of none, lz4, zstd")
    elif compression == "lz4" and size > 255 * len(data):
        raise CodecError(f"it declares {size} bytes, more than lz4 can make of {len(data)}")
    elif size > min(budget.room(len(data)), SMALL + CHUNK_RATIO * len(data)):
        raise CodecError(too_much(size, len(data)))
    else:
        budget.used(size)
        content = _unpacked(compression, data, size) if data else b""
        if len(content) != size:
            raise CodecError(f"it declares {size} bytes and holds {len(content)}")
    if crc and crc32(content) != crc:
        raise CodecError("its checksum does not hold")
    return content


def _unpacked(compression: str, data: bytes, size: int) -> bytes:
    """Decompress the frames of a chunk, most often one, up to a byte beyond the size that it declares."""
    try:
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            return unpack_frames(LZ4FrameDecompressor, data, LZ4_MAGIC, size + 1)[0]
        declared = zstandard.frame_content_size(data)
        if declared > size:
            raise CodecError(f"it declares {size} bytes and holds {declared}")
        zstd = zstandard.ZstdDecompressor()
        first = zstd.decompress(data, max_output_size=max(size, 1)) if declared in (-1, size) else b""
        return first if len(first) == size else zstd.stream_reader(data, read_across_frames=True).read(size + 1)
    except (zstandard.ZstdError, RuntimeError, EOFError) as err:
        raise CodecError(f"{compression}: {err}") from err
