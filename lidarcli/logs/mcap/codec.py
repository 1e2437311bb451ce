"""Decompression of MCAP chunks within bounds: whole ones, and what is left of those that are cut off."""

from __future__ import annotations

import io
import threading

import lz4.frame
import zstandard

from lidarcli.logs.unpacking import CHUNK_RATIO, SMALL, Unpacking, too_much

MAX_CHUNK = 1 << 30
"""A chunk that declares more than 1 GiB is refused, compressed or not: it is held as a whole."""

_LZ4_RATIO = 255
_STEP = 1 << 16
_LOCAL = threading.local()


class CodecError(ValueError):
    """A chunk that cannot be decompressed."""


def inflate(compression: str, data: bytes, size: int, unpacking: Unpacking) -> bytes:
    """The `size` bytes of a chunk; never more than was declared, nor than is believed of so little data."""
    if size > MAX_CHUNK:
        raise CodecError(f"it declares {size} bytes, more than the {MAX_CHUNK} that are believed")
    if compression == "":
        return data
    if compression == "lz4" and size > _LZ4_RATIO * len(data):
        raise CodecError(f"it declares {size} bytes, more than lz4 can make of {len(data)}")
    if size > min(unpacking.room(len(data)), SMALL + CHUNK_RATIO * len(data)):
        raise CodecError(too_much(size, len(data)))
    unpacking.used(size)
    if size == 0 and not data:
        return b""
    if compression == "zstd":
        inflated = _zstd(data, size)
    elif compression == "lz4":
        inflated = _lz4(data, size)
    else:
        raise CodecError(f"its compression '{compression}' is not one of none, lz4, zstd")
    if len(inflated) != size:
        raise CodecError(f"it declares {size} bytes and holds {len(inflated)}")
    return inflated


def _zstd(data: bytes, size: int) -> bytes:
    try:
        declared = zstandard.frame_content_size(data)
        if declared not in (-1, size):
            raise CodecError(f"it declares {size} bytes and holds {declared}")
        return _decompressor().decompress(data, max_output_size=max(size, 1))
    except zstandard.ZstdError as err:
        raise CodecError(f"zstd: {err}") from err


def _decompressor() -> zstandard.ZstdDecompressor:
    """One per thread: making one costs more than decompressing a small chunk."""
    if not hasattr(_LOCAL, "zstd"):
        _LOCAL.zstd = zstandard.ZstdDecompressor()
    kept: zstandard.ZstdDecompressor = _LOCAL.zstd
    return kept


def _lz4(data: bytes, size: int) -> bytes:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    try:
        inflated: bytes = decompressor.decompress(data, size + 1)
    except (RuntimeError, EOFError, ValueError) as err:
        raise CodecError(f"lz4: {err}") from err
    return inflated


def inflate_start(compression: str, data: bytes, size: int) -> bytes:
    """As much of the beginning of a damaged chunk as can be decompressed."""
    limit = min(size, SMALL + CHUNK_RATIO * len(data))
    if compression == "":
        return data[:limit]
    start = bytearray()
    try:
        if compression == "zstd":
            reader = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data))
            while len(start) < limit and (piece := reader.read(min(_STEP, limit - len(start)))):
                start += piece
        elif compression == "lz4":
            decompressor = lz4.frame.LZ4FrameDecompressor()
            for place in range(0, len(data), _STEP):
                start += decompressor.decompress(data[place : place + _STEP])
                if len(start) >= limit or decompressor.eof:
                    break
    except (zstandard.ZstdError, RuntimeError, EOFError, ValueError):
        pass  # what came before the damage is all there is
    return bytes(start[:limit])
