"""One to six changes to the bytes of a file, from a seeded generator."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np

Random = np.random.Generator

PAGE = 4096
_LENGTHS = ("<I", "<Q", ">I", ">H", "<H")
"""How containers write their lengths and counts."""
_TRIES = 64
_MOST = 1 << 20
"""A mutated file grows to no more than this many bytes."""


def mutate(data: bytes, random: Random) -> bytes:
    """The bytes after some changes; the same generator state gives the same bytes."""
    for _ in range(int(random.choice([1, 1, 1, 2, 3, 6]))):
        change = _CHANGES[int(random.integers(len(_CHANGES)))]
        if data:
            data = change(data, random)[:_MOST]
    return data


def _place(data: bytes, random: Random) -> int:
    return int(random.integers(len(data)))


def _span(data: bytes, random: Random) -> tuple[int, int]:
    """A slice: mostly short ones, which hit single fields and records."""
    first = _place(data, random)
    most = int(random.choice([4, 64, 1024, len(data)]))
    return first, min(len(data), first + 1 + int(random.integers(most)))


def _flip(data: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(int(random.choice([1, 1, 4, 30]))):
        changed[_place(data, random)] ^= 1 << int(random.integers(8))
    return bytes(changed)


def _set(data: bytes, random: Random) -> bytes:
    at = _place(data, random)
    return data[:at] + bytes([int(random.choice([0, 1, 0x7F, 0x80, 0xFF, 10, 44, 34]))]) + data[at + 1 :]


def _cut(data: bytes, random: Random) -> bytes:
    return data[: _place(data, random)]


def _cut_start(data: bytes, random: Random) -> bytes:
    return data[_place(data, random) :]


def _remove(data: bytes, random: Random) -> bytes:
    first, end = _span(data, random)
    return data[:first] + data[end:]


def _repeat(data: bytes, random: Random) -> bytes:
    first, end = _span(data, random)
    return data[:end] + data[first:end] * int(random.choice([1, 2, 50])) + data[end:]


def _move(data: bytes, random: Random) -> bytes:
    """Copy a slice over another place."""
    first, end = _span(data, random)
    at = _place(data, random)
    return data[:at] + data[first:end] + data[at + end - first :]


def _blank(data: bytes, random: Random) -> bytes:
    """A page lost by the disk, or any slice, filled with one byte or with noise."""
    first, end = _span(data, random)
    if random.integers(2):
        first -= first % PAGE
        end = min(len(data), first + PAGE)
    kind = int(random.integers(3))
    fill = random.bytes(end - first) if kind == 2 else bytes([255 * kind]) * (end - first)
    return data[:first] + fill + data[end:]


def _append(data: bytes, random: Random) -> bytes:
    return data + (data if random.integers(2) else random.bytes(int(random.integers(1, 300))))


def _length(data: bytes, random: Random) -> bytes:
    """A length or a count that lies: a place whose number could be the length of something in the file."""
    form = _LENGTHS[int(random.integers(len(_LENGTHS)))]
    size = struct.calcsize(form)
    at = 0
    for _ in range(_TRIES):
        at = _place(data, random)
        if at + size <= len(data) and 0 < struct.unpack_from(form, data, at)[0] <= len(data) - at:
            break
    if at + size > len(data):
        return data
    (value,) = struct.unpack_from(form, data, at)
    lies = (
        *(1 << bits for bits in (15, 16, 20, 24, 28, 30, 31, 32, 40, 60, 63)),
        *(0, value + 1, value - 1, value * 2, value // 2, len(data), len(data) - at, -1, -9),
    )
    lie = lies[int(random.integers(len(lies)))]
    return data[:at] + struct.pack(form, lie % (1 << 8 * size)) + data[at + size :]


_CHANGES: tuple[Callable[[bytes, Random], bytes], ...] = (
    *(_flip, _set, _cut, _cut_start, _remove, _repeat, _move, _blank, _append),
    *(_length, _length, _length),
)
