"""LaserScan messages written field by field, independently of the decoder."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np

GEOMETRY = (-1.5, 1.5, 0.01, 1e-4, 0.1, 0.05, 12.0)


def scan(
    ranges: list[float] | np.ndarray[Any, Any],
    *,
    encoding: str = "cdr",
    frame: bytes = b"laser",
    sec: int = 7,
    nsec: int = 8,
    geometry: tuple[float, ...] | None = None,
    big: bool = False,
    echoes: list[list[float]] | None = None,
    intensities: Sequence[float] | np.ndarray[Any, Any] = (),
    strengths: list[list[float]] | None = None,
    declared: int | None = None,
) -> bytes:
    """One message, written field by field; its geometry is by default `GEOMETRY` up to its last beam."""
    if geometry is None:
        first, _, step, *others = GEOMETRY
        geometry = (first, first + (len(ranges if echoes is None else echoes) - 1) * step, step, *others)
    order = ">" if big else "<"
    body = b""
    if encoding == "cdr":
        name = frame + b"\0"
        body += struct.pack(order + "iII", sec, nsec, len(name)) + name
        body += b"\0" * (-len(body) % 4)
    else:
        body += struct.pack("<IIII", 3, sec, nsec, len(frame)) + frame
    body += struct.pack(order + "7f", *geometry)
    if echoes is None:
        body += struct.pack(order + "I", len(ranges) if declared is None else declared)
        body += struct.pack(f"{order}{len(ranges)}f", *ranges)
    else:
        body += _lists(order, echoes)
    if strengths is None:
        body += struct.pack(f"{order}I{len(intensities)}f", len(intensities), *intensities)
    else:
        body += _lists(order, strengths)
    return (b"\0\0\0\0" if big else b"\0\1\0\0") + body if encoding == "cdr" else body


def _lists(order: str, echoes: list[list[float]]) -> bytes:
    """What a MultiEchoLaserScan holds of each beam: its number of echoes, and these."""
    parts = [struct.pack(f"{order}I{len(echo)}f", len(echo), *echo) for echo in echoes]
    return struct.pack(order + "I", len(echoes)) + b"".join(parts)
